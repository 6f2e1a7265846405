// SPDX-License-Identifier: GPL-3.0-or-later
// Where plastic, softening and strongly deformed bodies break methods, case by case (docs/stability.md).
//
//   bench_stability_plastic CASE [DIRECTORY] [FUNCTIONS]
//
// unload    a thick sphere is loaded past yield and unloaded: residual stress
// bend      a bar is bent past yield and let go: moment, residual stress
// cycle     a thick sphere that hardens kinematically is moved to and fro: load path, closed loops
// limit     strip footing, notched strip: limit load and what comes after
// wall      thick tube and sphere: the whole load path
// large     rubber and metal at large strains: how far methods come
// neck      the necking bar with functions that are dense where it necks
// tear      a strip that softens, torn: dissipated energy over the spacing of the cloud
//
// Prints a table; a DIRECTORY gets the paths as CSV (none: ""). FUNCTIONS: only those whose name contains this.
#include "clock.hpp"
#include "large_strains.hpp"
#include "plastic_limits.hpp"
#include "plastic_walls.hpp"

#include <efree/efree.hpp>

#include <fmt/format.h>
#include <fmt/ostream.h>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <string>
#include <vector>

using namespace efree;
using namespace efree::bench;

namespace {

/// What carries the solution; all the rest as the program takes it.
struct Method {
  std::string name;
  ApproximationOptions options;
};
/// Part of the names of those that are wanted.
std::string wanted;
bool left_out(const Method& method) {
  return method.name.find(wanted) == std::string::npos;
}
Method cloud(double spacing) {
  return {fmt::format("cloud H={:g}", spacing), {.spacing = spacing}};
}
Method on_linear(double spacing) {
  return {fmt::format("linear H={:g}", spacing), {.spacing = spacing, .secondary = SecondaryKind::linear}};
}
Method pointwise(double spacing) {
  return {fmt::format("pointwise H={:g}", spacing), {.spacing = spacing, .dilatation = Dilatation::pointwise}};
}
Method full(double spacing) {
  return {fmt::format("full H={:g}", spacing),
          {.spacing = spacing, .secondary = SecondaryKind::full, .dilatation = Dilatation::pointwise}};
}
Method elements(BasisKind kind, double size) {
  return {fmt::format("{} h={:g}", kind == BasisKind::p1 ? "P1" : "P2", size), {.kind = kind}};
}

/// Lines of a CSV, if there is a directory.
class Lines {
 public:
  Lines(const std::filesystem::path& directory, const std::string& name, const std::string& header) {
    if (directory.empty()) return;
    std::filesystem::create_directories(directory);
    file_.open(directory / (name + ".csv"));
    file_ << header << "\n";
  }
  template <class... T> void add(fmt::format_string<T...> format, T&&... values) {
    if (file_.is_open()) fmt::print(file_, "{}\n", fmt::format(format, std::forward<T>(values)...));
  }

 private:
  std::ofstream file_;
};

/// Linear between (0, 0), (1, values[0]), (2, values[1]), ...
std::function<double(double)> zigzag(std::vector<double> values) {
  return [values = std::move(values)](double t) {
    const int leg = std::clamp(static_cast<int>(std::ceil(t)) - 1, 0, static_cast<int>(values.size()) - 1);
    const double from = leg > 0 ? values[leg - 1] : 0.0;
    return from + (t - leg) * (values[leg] - from);
  };
}
std::vector<double> whole_times(int last) {
  std::vector<double> times;
  for (int t = 1; t <= last; ++t) times.push_back(t);
  return times;
}

template <int Dim> struct Run {
  Result<Dim> result;
  double seconds;
};
template <int Dim> Run<Dim> run(const FineMesh<Dim>& mesh, const Settings<Dim>& settings) {
  const double start = cpu_seconds();
  Run<Dim> run{analyse(mesh, settings), 0.0};
  run.seconds = cpu_seconds() - start;
  return run;
}

/// Radial and hoop components at x of a stress of the sphere.
template <int Dim> Vec<2> around_centre(const Voigt<Dim>& stress, const Vec<Dim>& x) {
  const Vec<Dim> n = x.normalized();
  const Vec<Dim> t = traction<Dim>(stress, n);
  const double radial = t.dot(n);
  double trace = 0.0;
  for (int i = 0; i < 3; ++i) trace += stress[i];
  return {radial, 0.5 * (trace - radial)};
}

template <int Dim> void unload_one(const Method& method, PressedWall wall, double size, Lines& lines) {
  if (left_out(method)) return;
  const Metal metal;
  const double most = 0.8 * sphere_limit(metal);
  const FineMesh<Dim> mesh = mesh_of<Dim>(wall, size);
  const auto [result, seconds] =
      run<Dim>(mesh, wall_settings<Dim>(wall, metal, method.options, {.pressure = zigzag({most, 0.0})},
                                        {.end = 2.0, .step = 0.1, .stops = {1.0}}));
  SphereInBothDirections exact(metal);
  exact.load(most);
  exact.load(0.0);
  const auto& space = result.approximation.space;
  double error = 0.0, size_of = 0.0, most_residual = 0.0;
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    const Vec<Dim> x = mesh.vertex(v);
    const Vec<2> is = around_centre<Dim>(result.fields.stress.col(v), x), should = exact.stress(x.norm());
    double weight = 0.0;
    for (const Index c : mesh.cells_of(v)) weight += mesh.volume(c) * space.measure(mesh.centroid(c));
    error += weight * (is - should).squaredNorm();
    size_of += weight * should.squaredNorm();
    most_residual = std::max(most_residual, should.cwiseAbs().maxCoeff());
    lines.add("{},{},{},{},{},{}", method.name, x.norm(), is[0], is[1], should[0], should[1]);
  }
  double worst = 0.0, moved = 0.0, mean = 0.0, area = 0.0;
  for (const Index f : mesh.group("inner"))
    for (int k = 0; k < Dim; ++k) {
      const Index v = mesh.facets()(k, f);
      const Vec<Dim> x = mesh.vertex(v);
      const double hoop = around_centre<Dim>(result.fields.stress.col(v), x)[1] / exact.stress(1.0)[1] - 1.0;
      const double w = mesh.facet_measure(f) * result.approximation.space.measure(x);
      worst = std::max(worst, std::abs(hoop));
      mean += w * hoop;
      moved += w * (result.fields.displacement.col(v).dot(x.normalized()) / exact.displacement() - 1.0);
      area += w;
    }
  fmt::print("| {} | {} | {} | {:.2f} | {:+.2f} | {:.2f} | {:+.2f} | {:.1f} |\n",
             Dim == 3 ? "in space" : "of revolution", method.name, result.approximation.nodes.cols(),
             100.0 * std::sqrt(error / size_of), 100.0 * mean / area, 100.0 * worst, 100.0 * moved / area, seconds);
  std::fflush(stdout);
}
void unload(const std::filesystem::path& directory) {
  Lines lines(directory, "unload", "method,r,radial,hoop,exact_radial,exact_hoop");
  fmt::print(
      "residual stress of a sphere after 0.8 of its limit pressure; errors in %\n"
      "| sphere | functions | nodes | stress, whole wall | hoop stress, bore, mean | worst | displacement, bore | "
      "CPU s |\n|---|---|---|---|---|---|---|---|\n");
  for (const double H : {0.1, 1.0 / 15.0, 0.05})
    for (const Method& method : {cloud(H), on_linear(H), pointwise(H)})
      unload_one<2>(method, PressedWall::sphere_of_revolution, H / 4.0, lines);
  for (const double H : {0.033, 0.025, 0.02, 0.0165, 0.014, 0.0125, 0.011})
    unload_one<2>(cloud(H), PressedWall::sphere_of_revolution, H / 4.0, lines);
  unload_one<2>(elements(BasisKind::p2, 0.1), PressedWall::sphere_of_revolution, 0.1, lines);
  unload_one<3>(cloud(0.2), PressedWall::sphere_in_space, 0.1, lines);
}

template <int Dim> void cycle_one(const Method& method, PressedWall wall, double size, Lines& lines) {
  if (left_out(method)) return;
  const Metal metal{.kinematic = 20.0};
  const double u = 0.008;
  const auto bore = zigzag({u, -u, u, -u, u});
  const FineMesh<Dim> mesh = mesh_of<Dim>(wall, size);
  const auto [result, seconds] =
      run<Dim>(mesh, wall_settings<Dim>(wall, metal, method.options, {.displacement = bore},
                                        {.end = 5.0, .step = 0.125, .max_step = 0.125, .stops = whole_times(5)}));
  SphereInBothDirections exact(metal);
  std::vector<double> at_turns, times;
  double worst = 0.0, largest = 0.0, loop = 0.0, exact_loop = 0.0, last = 0.0, exact_last = 0.0, u_last = 0.0;
  for (const auto& step : result.history) {
    exact.bore_to(bore(step.time));
    const double p = bore_pressure(wall, step), should = exact.pressure(), du = bore(step.time) - u_last;
    largest = std::max(largest, std::abs(should));
    worst = std::max(worst, std::abs(p - should));
    if (step.time > 3.0) {
      loop += 0.5 * (p + last) * du;
      exact_loop += 0.5 * (should + exact_last) * du;
    }
    if (step.time == std::floor(step.time)) at_turns.push_back(p);
    last = p, exact_last = should, u_last = bore(step.time);
    lines.add("{},{},{},{},{}", method.name, step.time, u_last, p, should);
  }
  if (at_turns.size() < 5) {
    fmt::print("| {} | {} | stops: {} |\n", Dim == 3 ? "in space" : "of revolution", method.name, result.stopped);
    return;
  }
  fmt::print("| {} | {} | {} | {:.2f} | {:+.2f} | {:.1e} | {:.1f} |\n", Dim == 3 ? "in space" : "of revolution",
             method.name, result.approximation.nodes.cols(), 100.0 * worst / largest, 100.0 * (loop / exact_loop - 1.0),
             std::abs(at_turns[4] / at_turns[2] - 1.0), seconds);
}
void cycle(const std::filesystem::path& directory) {
  Lines lines(directory, "cycle", "method,t,displacement,pressure,exact");
  fmt::print(
      "a sphere that hardens kinematically, its bore moved to and fro; errors in %\n"
      "| sphere | functions | nodes | pressure, largest on the whole path over the largest pressure | work of a "
      "loop | third loop against second | CPU s |\n|---|---|---|---|---|---|---|\n");
  for (const double H : {0.1, 1.0 / 15.0, 0.05})
    for (const Method& method : {cloud(H), on_linear(H), pointwise(H)})
      cycle_one<2>(method, PressedWall::sphere_of_revolution, H / 4.0, lines);
  cycle_one<2>(elements(BasisKind::p2, 0.1), PressedWall::sphere_of_revolution, 0.1, lines);
  cycle_one<3>(cloud(0.2), PressedWall::sphere_in_space, 0.1, lines);
}

void bend(const std::filesystem::path& directory) {
  Lines lines(directory, "bend", "method,y,stress,exact");
  fmt::print(
      "a bar in plane stress, bent to three times the curvature of first yield and let go; errors in %\n"
      "| functions | nodes | moment | residual stress, root of the mean square over its size | worst, over the "
      "largest | CPU s |\n|---|---|---|---|---|---|\n");
  const BentBar bar;
  const auto one = [&](const Method& method, double size) {
    if (left_out(method)) return;
    const FineMesh<2> mesh = bar.mesh(size);
    const auto [result, seconds] = run<2>(mesh, bar.settings(method.options));
    double moment = 0.0;
    for (const auto& step : result.history)
      if (step.time == 1.0) moment = std::abs(step.reactions.at("right").moment[0]);
    double error = 0.0, all = 0.0, worst = 0.0, most = 0.0;
    for (Index v = 0; v < mesh.num_vertices(); ++v) {
      const double y = mesh.vertex(v)[1], is = result.fields.stress(0, v), should = bar.residual_stress(y);
      double weight = 0.0;
      for (const Index c : mesh.cells_of(v)) weight += mesh.volume(c);
      error += weight * (is - should) * (is - should);
      all += weight * should * should;
      worst = std::max(worst, std::abs(is - should));
      most = std::max(most, std::abs(should));
      lines.add("{},{},{},{}", method.name, y, is, should);
    }
    fmt::print("| {} | {} | {:+.2f} | {:.2f} | {:.2f} | {:.1f} |\n", method.name, result.approximation.nodes.cols(),
               100.0 * (moment / bar.moment() - 1.0), 100.0 * std::sqrt(error / all), 100.0 * worst / most, seconds);
    std::fflush(stdout);
  };
  for (const double H : {0.1, 1.0 / 15.0, 0.05})
    for (const Method& method : {cloud(H), on_linear(H)}) one(method, H / 4.0);
  for (const double H : {0.033, 0.025}) one(cloud(H), H / 4.0);
  one(elements(BasisKind::p2, 0.1), 0.1);
}

using MakeLimit = LimitCase (*)(const ApproximationOptions&, const Resolution&);
void limit_one(const char* body, const Method& method, MakeLimit make, const Resolution& resolution, Lines& lines) {
  if (left_out(method)) return;
  LimitCase body_at_limit = make(method.options, resolution);
  body_at_limit.settings.time->path.max_steps = 100;  // of elements it takes many at the limit
  const auto [result, seconds] = run<2>(body_at_limit.mesh, body_at_limit.settings);
  const double limit = body_at_limit.limit;
  double most = 0.0, at_80 = 0.0;
  for (const auto& step : result.history) {
    const double stress = body_at_limit.stress(step);
    most = std::max(most, stress);
    if (step.time <= 0.8 + 1e-9) at_80 = stress;
    lines.add("{},{} {},{},{}", body, method.name, resolution.at_edge, step.time, stress / limit);
  }
  const auto& first = result.history.front();
  const double elastic = body_at_limit.stress(first) / first.time, end = body_at_limit.stress(result.history.back());
  fmt::print("| {} | {} | {:g} | {} | {:+.2f} | {:+.2f} | {} | {} | {:.1f} |\n", body, method.name, resolution.at_edge,
             result.approximation.nodes.cols(), 100.0 * (end / limit - 1.0), 100.0 * (end - at_80) / 0.2 / elastic,
             result.history.size(),
             result.stopped.empty() ? "end" : fmt::format("t={:.3f}", result.history.back().time), seconds);
  std::fflush(stdout);
}
void limit(const std::filesystem::path& directory) {
  Lines lines(directory, "limit", "body,method,t,stress");
  fmt::print(
      "limit loads in plane strain, (2 + pi) k\n"
      "| body | functions | spacing at the edge | nodes | load at the end, error in % | slope over the last fifth, % "
      "of the elastic "
      "one | steps | comes to | CPU s |\n|---|---|---|---|---|---|---|---|---|\n");
  std::fflush(stdout);
  const auto all = [&](const char* body, MakeLimit make, double width) {
    const auto at = [&](double H) { return Resolution{0.25, width * H}; };
    for (const double H : {1.0 / 8.0, 1.0 / 16.0, 1.0 / 32.0, 1.0 / 64.0})
      limit_one(body, cloud(0.25), make, at(H), lines);
    const double H = 1.0 / 16.0;
    for (const Method& method : {on_linear(0.25), pointwise(0.25), full(0.25)})
      limit_one(body, method, make, at(H), lines);
    limit_one(body, elements(BasisKind::p1, 0.1), make, {0.1, 0.4 * width * H, 1.0}, lines);
    limit_one(body, elements(BasisKind::p2, 0.25), make, {0.25, width * H, 1.0}, lines);
    limit_one(body, elements(BasisKind::p2, 0.125), make, {0.125, 0.5 * width * H, 1.0}, lines);
  };
  all("footing", footing, 1.0);
  all("notched strip", notched_strip, 0.5);
}

template <int Dim>
void wall_one(const char* name, PressedWall wall, const Metal& metal, const Method& method, double size, Lines& lines) {
  if (left_out(method)) return;
  const double u = is_sphere(wall) ? 0.015 : 0.006;
  const FineMesh<Dim> mesh = mesh_of<Dim>(wall, size);
  const auto [result, seconds] =
      run<Dim>(mesh, wall_settings<Dim>(wall, metal, method.options, {.displacement = [u](double t) { return u * t; }},
                                        {.step = 0.05}));
  SphereInBothDirections sphere(metal);
  const double limit = is_sphere(wall) ? sphere_limit(metal) : TubeYieldedTo::limit(metal);
  double worst = 0.0, at_80 = 0.0, end = 0.0;
  for (const auto& step : result.history) {
    const double p = bore_pressure(wall, step);
    if (is_sphere(wall)) sphere.bore_to(u * step.time);
    const double should = is_sphere(wall) ? sphere.pressure() : TubeYieldedTo::pressure_at(metal, u * step.time);
    worst = std::max(worst, std::abs(p - should));
    if (step.time <= 0.8 + 1e-9) at_80 = p;
    end = p;
    lines.add("{},{} nu={},{},{},{}", name, method.name, metal.nu, u * step.time, p, should);
  }
  const auto& first = result.history.front();
  const bool known = is_sphere(wall) || metal.nu > 0.49;
  fmt::print("| {} | {} | {} | {} | {} | {:+.2f} | {:+.2f} | {} | {:.1f} |\n", name, metal.nu, method.name,
             result.approximation.nodes.cols(), known ? fmt::format("{:.2f}", 100.0 * worst / limit) : "",
             100.0 * (end / limit - 1.0), 100.0 * (end - at_80) / 0.2 / (bore_pressure(wall, first) / first.time),
             result.stopped.empty() ? "end" : fmt::format("t={:.3f}", result.history.back().time), seconds);
  std::fflush(stdout);
}
void wall(const std::filesystem::path& directory) {
  Lines lines(directory, "wall", "body,method,displacement,pressure,exact");
  fmt::print(
      "thick walls, b = 2 a; errors over the limit pressure in % (the tube's path is known for nu = 1/2 only)\n"
      "| wall | nu | functions | nodes | largest on the path | at the end | slope over the last fifth, % of the "
      "elastic one | comes to | CPU s |\n|---|---|---|---|---|---|---|---|---|\n");
  const Metal metal, incompressible{.nu = 0.4999};
  const auto walls = [&](const Method& method, double H) {
    wall_one<2>("tube in plane strain", PressedWall::tube, metal, method, H / 4.0, lines);
    wall_one<2>("tube in plane strain", PressedWall::tube, incompressible, method, H / 4.0, lines);
    wall_one<2>("tube of revolution", PressedWall::tube_of_revolution, incompressible, method, H / 4.0, lines);
    wall_one<2>("sphere of revolution", PressedWall::sphere_of_revolution, metal, method, H / 4.0, lines);
  };
  for (const double H : {0.1, 1.0 / 15.0}) walls(cloud(H), H);
  for (const Method& method : {on_linear(0.1), pointwise(0.1)}) walls(method, 0.1);
  for (const Method& method : {full(0.1), elements(BasisKind::p1, 0.05), elements(BasisKind::p2, 0.1)}) {
    const double size = method.options.kind == BasisKind::p2   ? 0.1
                        : method.options.kind == BasisKind::p1 ? 0.05
                                                               : 0.025;
    wall_one<2>("tube in plane strain", PressedWall::tube, incompressible, method, size, lines);
    wall_one<2>("sphere of revolution", PressedWall::sphere_of_revolution, metal, method, size, lines);
  }
  wall_one<3>("tube in space", PressedWall::tube_in_space, incompressible, cloud(0.2), 0.1, lines);
  wall_one<3>("sphere in space", PressedWall::sphere_in_space, metal, cloud(0.2), 0.1, lines);
}

void large_one(const LargeCase& body, const Method& method, const FineMesh<2>& mesh, Lines& lines,
               Index max_steps = 400) {
  if (left_out(method)) return;
  Settings<2> settings = body.settings;
  settings.common.approximation = method.options;
  settings.time->path.max_steps = max_steps;
  const double start = cpu_seconds();
  try {
    const auto [result, seconds] = run<2>(mesh, settings);
    double least = 1.0, half = 0.0;
    for (const auto& step : result.history) {
      least = std::min(least, step.smallest_jacobian);
      if (step.time <= body.on_the_way + 1e-9) half = body.force(step);
      lines.add("{},{},{},{},{},{}", body.name, method.name, step.time, body.force(step), step.stored, step.dissipated);
    }
    const auto& last = result.history.back();
    fmt::print("| {} | {} | {} | {:.4g} | {:.5g} | {:.5g} | {:.5g} | {:.5g} | {:.3g} | {} | {:.1f} |\n", body.name,
               method.name, result.approximation.nodes.cols(), last.time, half, body.force(last),
               last.stored + last.dissipated, last.probes.empty() ? 0.0 : last.probes.front()[0], least,
               result.history.size(), seconds);
    if (!result.stopped.empty()) fmt::print("\n{}: {}\n\n", method.name, result.stopped);
  } catch (const NumericalError& error) {
    fmt::print("| {} | {} | | 0 | {} | | | | | | {:.1f} |\n", body.name, method.name, error.what(),
               cpu_seconds() - start);
  }
  std::fflush(stdout);
}
void head_of_large() {
  fmt::print(
      "| body | functions | nodes | comes to t | force (Cook: displacement) on the way | at the end | energy | "
      "probe, x | least J | steps | CPU s |\n|---|---|---|---|---|---|---|---|---|---|---|\n");
}
void large(const std::filesystem::path& directory) {
  Lines lines(directory, "large", "body,method,t,force,stored,dissipated");
  head_of_large();
  const auto all = [&](const LargeCase& body, double H) {
    const auto one = [&](const Method& method, double size) {
      large_one(body, method, triangulate(body.domain, {.size = size}), lines);
    };
    for (const double h : {H, 0.5 * H}) one(cloud(h), h / 3.0);
    for (const double h : {0.5 * H, 0.25 * H}) one(elements(BasisKind::p2, h), h);
    one(elements(BasisKind::p1, 0.25 * H), 0.25 * H);
  };
  all(pressed_block(), 0.2);
  all(pulled_square(), 0.2);
  all(bent_to_circle(), 0.4);
  all(necking_bar(), 1.6);
  all(cook_rubber(), 5.0);
}

/// The necking bar with clouds and elements that are dense where it necks.
void neck(const std::filesystem::path& directory) {
  Lines lines(directory, "neck", "body,method,t,force,stored,dissipated");
  head_of_large();
  const LargeCase body = necking_bar();
  const auto& side = body.domain.boundary[1].points;  // from the neck to the end
  const auto mesh = [&](double least, double most) {
    const double R = side[0].x(), end = side[1].y();
    std::vector<double> x;
    const int columns = static_cast<int>(std::ceil(R / least));
    for (int i = 0; i <= columns; ++i) x.push_back(R * i / columns);
    const NameOfPart name = [=](const Vec<2>& at) -> std::string {
      if (at[1] < 1e-9) return "bottom";
      return at[1] > end - 1e-9 ? "top" : at[0] < 1e-9 ? "axis" : "side";
    };
    return grid(x, graded_line(0.0, end, 0.0, least, most), name, [&](const Vec<2>& at) -> Vec<2> {
      return {at[0] * (1.0 + (side[1].x() / R - 1.0) * at[1] / end), at[1]};
    });
  };
  for (const double H : {0.8, 0.4, 0.25}) {
    Method method{fmt::format("cloud H={:g} at the neck", H), {.spacing = 1.6}};
    method.options.grading.boxes = {{{0.0, 0.0}, {6.5, 3.5}, H}};
    large_one(body, method, mesh(H / 4.0, H < 0.4 ? 0.2 : 0.4), lines, 1500);
  }
  for (const double h : {0.8, 0.4, 0.2}) {
    Method method = elements(BasisKind::p2, h);
    method.name += " at the neck";
    large_one(body, method, mesh(h, 3.0 * h), lines, 1500);
  }
}

/// A strip in plane strain with a soft middle, drawn apart: what it dissipates over G_c times its section. The width of
/// the band that tears is taken for 2.5 spacings.
void tear(const std::filesystem::path& directory) {
  constexpr double E = 100.0, strength = 0.3, Gc = 9e-4, apart = 0.03;
  Lines lines(directory, "tear", "method,displacement,force,dissipated");
  fmt::print(
      "a strip that softens, torn\n| functions | length said | nodes | displacement reached | force left | "
      "dissipated over G_c A | steps | CPU s |\n|---|---|---|---|---|---|---|---|\n");
  const auto one = [&](const Method& method, double H, double length, Control control) {
    Settings<2> settings;
    const Parameter weaker = [=](const Vec<3>& x) {
      return strength * (1.0 - 0.05 * std::exp(-std::pow((x[0] - 1.0) / 0.1, 2)));
    };
    settings.common.model.material = Rankine({.moduli = {.E = E, .nu = 0.0},
                                              .strength = weaker,
                                              .softening = softening_modulus(strength, Gc, length),
                                              .strain = Strain::small});
    settings.common.model.plane = Plane::strain;
    settings.common.approximation = method.options;
    settings.supports = {
        symmetry_plane<2>("left"), symmetry_plane<2>("bottom"), {"right", {[](const Vec<2>&) { return apart; }}, {}}};
    settings.time = TimeSettings<2>{.path = {.control = control, .step = 0.02, .min_step = 1e-6, .max_steps = 300}};
    const auto [result, seconds] =
        run<2>(triangulate(shapes::rectangle(0.0, 0.0, 2.0, 1.0), {.size = H / 4.0}), settings);
    const auto& last = result.history.back();
    for (const auto& step : result.history)
      lines.add("{} {}{},{},{},{}", method.name, length / H, control == Control::load ? "" : " arc", step.time * apart,
                step.reactions.at("right").force[0], step.dissipated / Gc);
    fmt::print("| {}{} | {:g} | {} | {:.4f} | {:.4f} | {:.3f} | {} | {:.1f} |\n", method.name,
               control == Control::load ? "" : ", arc length", length, result.approximation.nodes.cols(),
               last.time * apart, last.reactions.at("right").force[0], last.dissipated / Gc, result.history.size(),
               seconds);
    for (const auto& warning : result.warnings)
      if (warning.find("softens") != std::string::npos) fmt::print("\n{}\n\n", warning);
    if (!result.stopped.empty()) fmt::print("\n{}\n\n", result.stopped);
    std::fflush(stdout);
  };
  for (const Control control : {Control::load, Control::arc_length})
    for (const double H : {0.2, 0.1, 0.05}) {
      one(cloud(H), H, 2.5 * H, control);
      if (control == Control::load && H != 0.1) one(cloud(H), H, 0.25, control);
    }
}

}  // namespace

int main(int argc, char** argv) {
  const std::map<std::string, void (*)(const std::filesystem::path&)> cases{
      {"unload", unload}, {"bend", bend},   {"cycle", cycle}, {"limit", limit},
      {"wall", wall},     {"large", large}, {"neck", neck},   {"tear", tear}};
  const auto found = argc > 1 ? cases.find(argv[1]) : cases.end();
  if (found == cases.end()) {
    fmt::print(stderr, "expected a case: unload, bend, cycle, limit, wall, large, neck, tear\n");
    return 2;
  }
  if (argc > 3) wanted = argv[3];
  found->second(argc > 2 ? argv[2] : "");
}
