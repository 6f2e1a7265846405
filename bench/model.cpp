// SPDX-License-Identifier: GPL-3.0-or-later
// What linear elasticity is off by where materials can do more, what Regime::automatic says of it and decides, and what
// that costs: seven scenes at loads over decades.
//
//   bench_model [scene]
//
// Lines of a table: the check (displacement, stress; stress over what is borne), the true errors of the linear answer
// against the full model on the same functions (largest displacement, stress at the points, strain energy, reactions),
// what is taken, and processor seconds: automatic and linear, corrected and with their errors; of the cloud alone
// linear, the check, full in ten steps, automatic in the same steps. "same": largest difference of displacements
// between automatic and full, where the full model is taken.
#include "clock.hpp"

#include <efree/efree.hpp>

#include <fmt/format.h>
#include <cmath>
#include <functional>
#include <numbers>
#include <string>
#include <vector>

using namespace efree;

namespace {

template <int Dim> struct Scene {
  std::string name;
  std::shared_ptr<const PreparedMesh<Dim>> mesh;
  std::function<Settings<Dim>(double load)> at;
  std::vector<double> loads;
};

template <int Dim>
std::shared_ptr<const PreparedMesh<Dim>> prepared(MeshData<Dim> data, double size, const Settings<Dim>& settings) {
  const MeshSource<Dim> source{
      .mesh = [&](const MeshSize&, const Stage&) { return MadeMesh<Dim>{.mesh = data, .size = size}; }, .size = size};
  return std::make_shared<const PreparedMesh<Dim>>(prepare(source, settings));
}

template <int Dim> double largest(const Points<Dim>& u) {
  return u.colwise().norm().maxCoeff();
}
/// Frobenius' norm of each stress.
template <int Dim> Vector sizes(const VoigtPoints<Dim>& stress) {
  return (stress.template topRows<3>().colwise().squaredNorm() +
          2.0 * stress.template bottomRows<voigt_size<Dim> - 3>().colwise().squaredNorm())
      .cwiseSqrt()
      .transpose();
}
template <int Dim> double reactions(const Result<Dim>& of, const Result<Dim>* other = nullptr) {
  double sum = 0.0;
  for (const auto& [part, reaction] : of.balance.reactions)
    sum += (reaction.force - (other ? other->balance.reactions.at(part).force : Vec<Dim>::Zero().eval())).norm();
  return sum;
}

/// The answer, and processor seconds.
template <int Dim>
std::pair<Result<Dim>, double> timed(const PreparedMesh<Dim>& mesh, Settings<Dim> settings, Regime regime) {
  settings.regime = regime;
  const double begin = bench::cpu_seconds();
  Result<Dim> result = analyse(mesh, settings);
  return {std::move(result), bench::cpu_seconds() - begin};
}

/// Of linear equations, at the end of the loads.
template <int Dim> Result<Dim> linear_answer(const NonlinearEquilibrium<Dim>& equations, const Result<Dim>& full) {
  Cholesky factor;
  TangentSolver tangent(equations, factor);
  const State state = newton(equations, tangent, equations.rest(), 1.0).state;
  const PointFields<Dim> points = equations.fields(state);
  Result<Dim> result;
  result.solution = {state.u.reshaped(Dim, full.approximation.shape.num_nodes()), points.strain, points.stress,
                     equations.energy(state)};
  result.fields = recover_fields(full.approximation, result.solution);
  result.balance.reactions = equations.reactions(state);
  return result;
}

template <int Dim> void run(const Scene<Dim>& scene) {
  for (const double load : scene.loads) {
    Settings<Dim> settings = scene.at(load);
    const auto [automatic, auto_seconds] = timed(*scene.mesh, settings, Regime::automatic);
    const LinearCheck& check = automatic.linear_checks.front();
    fmt::print("| {} | {:g} | {:.2g} | {:.2g} | {:.2g} % | {:.2g} % | {} |", scene.name, load, check.strain,
               180.0 / std::numbers::pi * check.rotation, 100.0 * check.displacement, 100.0 * check.stress,
               check.overload > 1.0 ? fmt::format("{:.3g}", check.overload) : "");
    const double linear_seconds = timed(*scene.mesh, settings, Regime::linear).second;
    Settings<Dim> alone = settings;
    alone.estimated = alone.corrected = false;
    const double alone_seconds = timed(*scene.mesh, alone, Regime::linear).second;
    try {
      const auto [full, full_seconds] = timed(*scene.mesh, alone, Regime::finite);
      const Points<Dim> chosen = timed(*scene.mesh, alone, Regime::automatic).first.fields.displacement;
      alone.time.emplace();
      alone.time->path.max_step = 0.1;
      const double steps_seconds = timed(*scene.mesh, alone, Regime::automatic).second;
      // By the same equations, on their own.
      const NonlinearEquilibrium<Dim> equations(full.approximation, full.model,
                                                Program<Dim>::grows(settings.supports, settings.loads));
      const Result<Dim> linear = linear_answer(equations.at_rest(), full);
      const auto& [u, v] = std::tie(linear.fields.displacement, full.fields.displacement);
      const double energy =
          linear.solution.strain_energy / (full.solution.strain_energy + full.history.back().dissipated);
      fmt::print(" {:.2g} % | {:.2g} % | {:.2g} % | {:.2g} % |", 100.0 * largest<Dim>(u - v) / largest<Dim>(v),
                 100.0 * sizes<Dim>(linear.solution.stress - full.solution.stress).maxCoeff() /
                     sizes<Dim>(full.solution.stress).maxCoeff(),
                 100.0 * std::abs(energy - 1.0), 100.0 * reactions(linear, &full) / reactions(full));
      const bool is_linear = automatic.regime == Regime::linear;
      fmt::print(" {} | {:.3f} | {:.3f} | {:.3f} | {:.3f} | {:.3f} | {:.3f} | {} |\n", is_linear ? "linear" : "full",
                 auto_seconds, linear_seconds, alone_seconds, automatic.times["model"], full_seconds, steps_seconds,
                 is_linear ? "" : fmt::format("{:.0e}", largest<Dim>(chosen - v) / largest<Dim>(v)));
    } catch (const NumericalError& error) {
      fmt::print(" the full model ends: {}\n", error.what());
    }
    std::fflush(stdout);
  }
}

template <int Dim> DisplacementCondition<Dim> moved(std::string on, int component, double by) {
  DisplacementCondition<Dim> condition{std::move(on), {}, {}};
  condition.components[component] = [by](const Vec<Dim>&) { return by; };
  return condition;
}
template <int Dim> TractionCondition<Dim> traction(std::string on, Vec<Dim> t) {
  return {std::move(on), [t](const Vec<Dim>&, const Vec<Dim>&) { return t; }};
}

Settings<2> plate(SharedMaterial material, Plane plane) {
  return {.common = {.model = {.material = std::move(material), .plane = plane}},
          .supports = {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")}};
}

}  // namespace

int main(int argc, char** argv) {
  const std::string only = argc > 1 ? argv[1] : "";
  const auto wanted = [&](const std::string& name) { return only.empty() || only == name; };
  const auto with = [](Settings<2> settings, TractionCondition<2> load) {
    settings.loads.tractions = {std::move(load)};
    return settings;
  };
  const ElasticModuli rubber{.E = 1.0, .nu = 0.3}, steel{.E = 210e3, .nu = 0.3};
  const auto holed = triangulate_data(shapes::quarter_plate_with_hole(1.0, 4.0, 0.06), {.size = 0.12});
  fmt::print(
      "| scene | load | strain | rotation | check: u | stress | overload | true: u | stress | energy | reactions | "
      "taken "
      "| auto s | linear s | linear, cloud alone s | check s | full s | auto, 10 steps s | same |\n"
      "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  if (wanted("rubber")) {
    const auto at = [&](double load) {
      Settings<2> settings = plate(NeoHookean(rubber), Plane::strain);
      settings.supports.push_back(moved<2>("right", 0, 4.0 * load));
      return settings;
    };
    run<2>({"rubber", prepared<2>(holed, 0.12, at(1.0)), at, {1e-5, 1e-4, 1e-3, 2e-3, 5e-3, 1e-2, 3e-2, 1e-1, 0.25}});
  }
  if (wanted("incompressible")) {
    const auto at = [&](double load) {
      Settings<2> settings =
          with(plate(NeoHookeanSplit({.E = 1.0, .nu = 0.499}), Plane::strain), traction<2>("right", {load, 0.0}));
      return settings;
    };
    run<2>({"incompressible", prepared<2>(holed, 0.12, at(1.0)), at, {1e-4, 1e-3, 1e-2, 1e-1}});
  }
  if (wanted("plasticity")) {
    const auto at = [&](double load) {
      return with(plate(J2({.moduli = steel, .yield = Hardening::linear(450.0, 129.24)}), Plane::strain),
                  traction<2>("right", {load, 0.0}));
    };
    run<2>(
        {"plasticity", prepared<2>(holed, 0.12, at(1.0)), at, {1.0, 100.0, 140.0, 150.0, 160.0, 200.0, 300.0, 400.0}});
  }
  if (wanted("finite plasticity")) {
    const auto at = [&](double load) {
      return with(plate(J2({.moduli = steel, .yield = Hardening::linear(450.0, 129.24), .strain = Strain::finite}),
                        Plane::strain),
                  traction<2>("right", {load, 0.0}));
    };
    run<2>({"finite plasticity", prepared<2>(holed, 0.12, at(1.0)), at, {1.0, 100.0, 140.0, 160.0, 300.0}});
  }
  if (wanted("tube")) {
    const auto at = [&](double load) {
      Settings<2> settings = plate(J2({.moduli = {.E = 210.0, .nu = 0.3}, .yield = 0.24}), Plane::axisymmetric);
      settings.supports = {symmetry_plane<2>("bottom"), symmetry_plane<2>("top")};
      settings.loads.tractions = {pressure<2>("left", [load](const Vec<2>&) { return load; })};
      return settings;
    };
    run<2>({"tube",
            prepared<2>(triangulate_data(shapes::rectangle(1.0, 0.0, 2.0, 0.5), {.size = 0.05}), 0.05, at(1.0)),
            at,
            {1e-3, 0.05, 0.1, 0.11, 0.15, 0.18}});
  }
  if (wanted("cantilever")) {
    const auto at = [&](double load) -> Settings<2> {
      return {.common = {.model = {.material = LinearElastic(rubber), .plane = Plane::stress}},
              .supports = {clamp<2>("left")},
              .loads = {.tractions = {traction<2>("right", {0.0, load})}, .body_force = {}}};
    };
    run<2>({"cantilever",
            prepared<2>(triangulate_data(shapes::rectangle(0.0, 0.0, 20.0, 1.0), {.size = 0.125}), 0.125, at(1.0)),
            at,
            {1e-8, 1e-7, 1e-6, 3e-6, 1e-5, 1e-4}});
  }
  if (wanted("block")) {
    const auto at = [&](double load) -> Settings<3> {
      return {.common = {.model = {.material = NeoHookean(rubber)}},
              .supports = {clamp<3>("left")},
              .loads = {.tractions = {traction<3>("right", {0.0, 0.0, -load})}, .body_force = {}}};
    };
    run<3>({"block",
            prepared<3>(solids::box({4.0, 1.0, 1.0}, 0.125), 0.125, at(1.0)),
            at,
            {1e-7, 1e-6, 1e-5, 1e-4, 1e-3}});
  }
}
