// SPDX-License-Identifier: GPL-3.0-or-later
/// Asked for an accuracy (analyse_to_accuracy): what is said, what is true, what was tried, what it costs, and the
/// cheapest fixed setting with the same true error.
///
///   bench_accuracy table [part of a case's name = all] [folder of the real files] [most seconds of a setting = 20]
///   bench_accuracy fixed [...] [least error = 1.5 %]   the fixed settings one by one, and what is asked for: from 10 %
///                                down to there, each 1.4 times less than the last
///   bench_accuracy race [...]    with 3, 1 and 0.3 % of the strain energy asked for: against the cheapest fixed
///   setting
///                                and against P2 that are as near; medians of three
///   bench_accuracy truth [...]   strain energies that errors are measured against
///
/// Errors are relative, in the energy norm: against the closed form, or the root of the strain energy's relative error.
/// Fixed settings are ladders of meshes, each 1.4 times finer than the last: finite elements (P1, P2), clouds alone and
/// corrected, on linear and quadratic cells; of images in space, grids of cells. Costs in between are interpolated (as
/// powers of the error). CPU seconds of the process, geometry to fields: run it on one thread. The real files are
/// fetched by examples/real_files/run; without their folder elephant and assembly are left out.
#include "cavity.hpp"
#include "clock.hpp"
#include "efree/geometry/meshing/image_mesh.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/io/case/case_file.hpp"
#include "gyroid.hpp"
#include "inclusion.hpp"
#include "kirsch.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>
#include <string>

using namespace efree;
using namespace efree::bench;

namespace {

constexpr double asked[] = {0.1, 0.05, 0.02};
constexpr double coarsest_of_arcs = 4.0;  ///< as of shapes in case files

/// A case that says no sizes, the natural one of its geometry, and the strain energy that is true (0: it has an exact
/// solution). Quadratic elements of `truth_size`, twice and four times as fine lead to it; of images cells of that
/// size.
template <int Dim> struct Trial {
  Case<Dim> analysis;
  double natural, truth_size, energy;
};

/// What `work` returns, and the CPU seconds it takes: the least of five times where that is little.
template <class Work> auto timed(const Work& work) {
  double least = INFINITY;
  for (int k = 0;; ++k) {
    const double start = cpu_seconds();
    auto result = work();
    least = std::min(least, cpu_seconds() - start);
    if (k == 4 || least > 0.1) return std::pair(std::move(result), least);
  }
}

/// What `work` returns, and the median of the CPU seconds it takes three times.
template <class Work> auto median_timed(const Work& work) {
  std::array<double, 3> seconds;
  auto start = cpu_seconds();
  auto result = work();
  for (std::size_t k = 0; k < seconds.size(); ++k) {
    if (k > 0) start = cpu_seconds(), work();
    seconds[k] = cpu_seconds() - start;
  }
  std::ranges::sort(seconds);
  return std::pair(std::move(result), seconds[1]);
}

/// Of an analysis, on cells or on a mesh, what is compared.
struct Outcome {
  double strain_energy, extrapolated, said;  ///< energies; estimated error in the energy norm
  std::optional<double> error;               ///< in the energy norm, where an exact solution is known
  std::vector<Attempt> attempts;
  bool on_cells;
};
template <int Dim> Outcome answer(const Case<Dim>& analysis) {
  if constexpr (Dim == 3)
    if (analysis.cells == OnCells::always) {
      const ImageResult found = analyse_image(analysis).value();
      return {found.solution.strain_energy,
              found.cells->extrapolated_energy,
              found.estimates->total(),
              {},
              found.attempts,
              true};
    }
  const Result<Dim> found = analysis.asks_for_accuracy() ? analyse_to_accuracy(analysis) : analyse(analysis);
  return {found.solution.strain_energy,
          found.solution.strain_energy,
          found.estimates ? found.estimates->total() : 0.0,
          found.errors ? std::optional(*found.errors->energy_norm) : std::nullopt,
          found.attempts,
          false};
}

template <int Dim> double true_error(const Trial<Dim>& trial, const Outcome& outcome) {
  return outcome.error.value_or(std::sqrt(std::abs(outcome.strain_energy / trial.energy - 1.0)));
}

struct Setting {
  const char* name;
  BasisKind kind;
  int degree;
  bool corrected, cells;
};
constexpr Setting settings[] = {{"P2", BasisKind::p2, 0, false, false},
                                {"corrected, quadratic", BasisKind::mls, 2, true, false},
                                {"corrected, linear", BasisKind::mls, 1, true, false},
                                {"P1", BasisKind::p1, 0, false, false},
                                {"cloud, linear", BasisKind::mls, 1, false, false},
                                {"cloud, quadratic", BasisKind::mls, 2, false, false},
                                {"cells", BasisKind::mls, 0, true, true}};

struct Rung {
  double size, error, seconds;
};

template <int Dim>
Case<Dim> fixed_case(const Trial<Dim>& trial, const Setting& setting, double size, double tolerance) {
  Case<Dim> analysis = trial.analysis;
  analysis.geometry.size = size;
  analysis.common.approximation.kind = setting.kind;
  analysis.common.approximation.interpolation = setting.degree;
  analysis.estimated = analysis.corrected = setting.corrected;
  analysis.correction.tolerance = tolerance;
  analysis.cells = setting.cells ? OnCells::always : OnCells::never;
  analysis.common.model.essential.reset();  // what becomes the basis
  return analysis;
}

/// From far too coarse to `finest`, or until a rung takes `most_seconds`.
template <int Dim>
std::vector<Rung> ladder(const Trial<Dim>& trial, const Setting& setting, double finest, double most_seconds) {
  std::vector<Rung> rungs;
  for (double size = (Dim == 2 ? 8.0 : 4.0) * trial.natural;; size /= 1.4) {
    try {
      const auto [result, seconds] =
          timed([&] { return answer(fixed_case(trial, setting, size, std::min(0.01, 0.3 * finest))); });
      rungs.push_back({size, true_error(trial, result), seconds});
    } catch (const std::exception& error) {  // some meshes are too coarse for the geometry
      std::fprintf(stderr, "%s, size %g: %s\n", setting.name, size, error.what());
      if (size < 0.1 * trial.natural) return rungs;
      continue;
    }
    if (rungs.back().error < finest || rungs.back().seconds > most_seconds) return rungs;
  }
}

/// CPU seconds for this error, infinite if it is not reached; size of the mesh.
Rung cost(const std::vector<Rung>& rungs, double error) {
  for (std::size_t k = 0; k < rungs.size(); ++k) {
    const Rung& fine = rungs[k];
    if (fine.error > error) continue;
    if (k == 0) return fine;
    const Rung& coarse = rungs[k - 1];
    const double t = std::log(coarse.error / error) / std::log(coarse.error / fine.error);
    const auto between = [t](double a, double b) { return a * std::pow(b / a, t); };
    return {between(coarse.size, fine.size), error, between(coarse.seconds, fine.seconds)};
  }
  return {0.0, error, INFINITY};
}

template <int Dim> void tabulate(const std::string& name, const Trial<Dim>& trial, double most_seconds) {
  struct Row {
    double wanted, said, truth, seconds;
    std::string chosen;
  };
  std::vector<Row> rows;
  double finest = INFINITY;
  for (const double wanted : asked) {
    Case<Dim> analysis = trial.analysis;
    analysis.accuracy = wanted;
    analysis.time_limit = 5.0 * most_seconds;
    const auto [result, seconds] = timed([&] { return answer(analysis); });
    std::string chosen;
    for (const Attempt& attempt : result.attempts) {
      char text[100];
      std::snprintf(text, sizeof text, "%s%s %.3g: %.2g %%", chosen.empty() ? "" : ", ",
                    result.on_cells       ? "cells"
                    : attempt.degree == 1 ? "linear"
                                          : "quadratic",
                    attempt.size, 100.0 * attempt.error);
      chosen += text;
    }
    std::fprintf(stderr, "%s, %g: %s; %g s\n", name.c_str(), wanted, chosen.c_str(), seconds);
    rows.push_back({wanted, result.said, true_error(trial, result), seconds, chosen});
    finest = std::min(finest, rows.back().truth);
  }
  std::vector<std::vector<Rung>> ladders;
  double most = most_seconds;  // no need to climb on where another ladder is at the top for less
  for (const Setting& setting : settings) {
    bool fits = true;  // on images in space elements have another body than cells
    if constexpr (Dim == 3) fits = setting.cells == (trial.analysis.cells == OnCells::always);
    if (Dim == 2) fits = !setting.cells;
    // The energy of a cloud alone is not that of a Galerkin solution and says nothing about its error.
    if (setting.kind == BasisKind::mls && !setting.corrected) fits = fits && trial.analysis.has_exact();
    ladders.push_back(fits ? ladder(trial, setting, finest, most) : std::vector<Rung>{});
    if (fits && !ladders.back().empty() && ladders.back().back().error <= finest)
      most = std::min(most, ladders.back().back().seconds);
  }
  for (const Row& row : rows) {
    Rung cheapest{0.0, row.truth, INFINITY};
    std::string setting = "none";
    for (std::size_t k = 0; k < ladders.size(); ++k) {
      const Rung here = cost(ladders[k], row.truth);
      if (here.seconds < cheapest.seconds) cheapest = here, setting = settings[k].name;
    }
    std::printf("| %s | %g | %.2g | %.2g | %s | %.3g | %s %.3g | %.3g | %.2f |\n", name.c_str(), 100.0 * row.wanted,
                100.0 * row.said, 100.0 * row.truth, row.chosen.c_str(), row.seconds, setting.c_str(), cheapest.size,
                cheapest.seconds, row.seconds / cheapest.seconds);
  }
  std::fflush(stdout);
}

template <int Dim> void race(const std::string& name, const Trial<Dim>& trial, double most_seconds) {
  constexpr double energies[] = {0.03, 0.01, 0.003};
  constexpr int elements = 0, fixed = 4;  // of the settings: P2, and those that have an answer in the space of elements
  const double finest = std::sqrt(energies[2]);
  std::vector<std::vector<Rung>> ladders;
  for (int k = 0; k < fixed; ++k) {
    std::vector<Rung> rungs;  // outlines of many details dictate all meshes of larger edges
    for (const Rung& rung : ladder(trial, settings[k], finest, most_seconds))
      if (rungs.empty() || rung.error < 0.97 * rungs.back().error) rungs.push_back(rung);
    if (k == elements && !rungs.empty()) most_seconds = std::min(most_seconds, rungs.back().seconds);
    for (Rung& rung : rungs)
      rung.seconds =
          median_timed([&] { return answer(fixed_case(trial, settings[k], rung.size, 0.3 * finest)); }).second;
    ladders.push_back(std::move(rungs));
  }
  for (const double energy : energies) {
    const double wanted = std::sqrt(energy);
    Case<Dim> analysis = trial.analysis;
    analysis.accuracy = wanted;
    const auto [result, seconds] = median_timed([&] { return answer(analysis); });
    const double truth = true_error(trial, result);
    int best = 0;
    for (int k = 1; k < fixed; ++k)
      if (cost(ladders[k], wanted).seconds < cost(ladders[best], wanted).seconds) best = k;
    const Rung p2 = cost(ladders[elements], wanted), cheapest = cost(ladders[best], wanted);
    std::printf("| %s | %g | %.2g | %.2g | %zu | %.3g | %s %.3g | %.3g | %.3g | %.3g | %.2f |\n", name.c_str(),
                100.0 * energy, 100.0 * result.said * result.said, 100.0 * truth * truth, result.attempts.size(),
                seconds, settings[best].name, cheapest.size, cheapest.seconds, p2.size, p2.seconds,
                seconds / p2.seconds);
    std::fflush(stdout);
  }
}

template <int Dim>
void list_fixed(const std::string& name, const Trial<Dim>& trial, double most_seconds, double finest) {
  for (const Setting& setting : settings) {
    if (setting.cells != (trial.analysis.cells == OnCells::always)) continue;
    for (const Rung& rung : ladder(trial, setting, finest, most_seconds))
      std::printf("| %s | %s | %.3g | %.3g | %.3g |\n", name.c_str(), setting.name, rung.size, 100.0 * rung.error,
                  rung.seconds);
    std::fflush(stdout);
  }
  for (double wanted = asked[0]; wanted > 0.99 * finest; wanted /= 1.4) {
    Case<Dim> analysis = trial.analysis;
    analysis.accuracy = wanted;
    const auto [result, seconds] = timed([&] { return answer(analysis); });
    std::printf("| %s | asked for %.3g %% | %.3g | %.3g | %.3g |\n", name.c_str(), 100.0 * wanted,
                result.attempts.back().size, 100.0 * true_error(trial, result), seconds);
    std::fflush(stdout);
    if (seconds > most_seconds) break;
  }
}

template <int Dim> void find_truth(const std::string& name, const Trial<Dim>& trial) {
  if (trial.analysis.has_exact()) return;
  const bool on_cells = trial.analysis.cells == OnCells::always;
  double energies[3];
  for (int k = 0; k < 3; ++k) {
    const Case<Dim> analysis = fixed_case(trial, settings[on_cells ? 6 : 1], trial.truth_size / (1 << k), 1e-3);
    const double start = cpu_seconds();
    const Outcome result = answer(analysis);
    energies[k] = result.strain_energy;
    std::printf("%s, size %g: %.10g, %g s\n", name.c_str(), analysis.geometry.size, energies[k], cpu_seconds() - start);
    std::fflush(stdout);
    if (on_cells) {
      std::printf("%s, extrapolated: %.10g\n", name.c_str(), result.extrapolated);
      return;
    }
  }
  const double last = energies[2] - energies[1], share = std::clamp(last / (energies[1] - energies[0]), 0.05, 0.6);
  std::printf("%s, extrapolated: %.10g, halving keeps %.2f\n", name.c_str(), energies[2] + last * share / (1.0 - share),
              share);
}

/// What a case file says without sizes; the first mesh is at most `coarsest` times the natural size.
template <int Dim> Case<Dim> said(std::function<MeshData<Dim>(double size)> mesh, double natural,
                                  const ElasticModel& model, std::vector<DisplacementCondition<Dim>> supports,
                                  Loads<Dim> loads, double coarsest = 8.0) {
  Case<Dim> analysis;
  analysis.common.where = "bench_accuracy";
  analysis.geometry.mesh = [mesh = std::move(mesh), natural, coarsest](const MeshSize& size, const Stage&) {
    const double length = size.length > 0.0 ? size.length : std::min(size.coarsening, coarsest) * natural;
    return MadeMesh<Dim>{.mesh = mesh(length), .size = length};
  };
  analysis.common.model = model;
  analysis.supports = std::move(supports);
  analysis.loads = std::move(loads);
  analysis.largest_error = 1e9;
  return analysis;
}
std::function<MeshData<2>(double)> filling(const PlanarDomain& domain) {
  return [domain](double size) { return triangulate_data(domain, {.size = size}); };
}

ElasticModel plane_stress() {
  return {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress};
}
DisplacementCondition<2> moved(const char* on, double x, double y) {
  return {on, {[x](const Vec<2>&) { return x; }, [y](const Vec<2>&) { return y; }}, nullptr};
}

/// A cube of an image between sliding planes, its top moved by one per cent.
Case<3> pulled(const LabelImage<3>& image) {
  const double height = image.size[2];
  Case<3> analysis = said<3>({}, 2.0, {.material = LinearElastic(1.0, 0.3)},
                             {symmetry_plane<3>("left"),
                              symmetry_plane<3>("front"),
                              symmetry_plane<3>("bottom"),
                              {"top", {}, [=](const Vec<3>&) { return 0.01 * height; }}},
                             {});
  analysis.geometry.mesh = [image](const MeshSize& size, const Stage&) {
    MadeMesh<3> made;
    made.size = size.length > 0.0 ? size.length : 4.0;
    made.mesh = std::move(mesh_on_lattice(image, {.size = made.size}).mesh);
    return made;
  };
  analysis.geometry.image = [image](const Stage&) { return MadeImage<3>{image, {{1, "1"}}}; };
  analysis.cells = OnCells::always;
  return analysis;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string mode = argc > 1 ? argv[1] : "", part = argc > 2 ? argv[2] : "all";
  const std::filesystem::path folder = argc > 3 ? argv[3] : "";
  const double most_seconds = argc > 4 ? std::atof(argv[4]) : 20.0;
  const double finest = argc > 5 ? 0.01 * std::atof(argv[5]) : 0.015;
  if (mode == "table")
    std::printf(
        "| case | asked [%%] | said [%%] | true [%%] | meshes tried | CPU [s] | cheapest fixed setting, size | CPU [s] "
        "| "
        "ratio |\n|---|--:|--:|--:|---|--:|---|--:|--:|\n");
  else if (mode == "fixed")
    std::printf("| case | setting | size | true error [%%] | CPU [s] |\n|---|---|--:|--:|--:|\n");
  else if (mode == "race")
    std::printf(
        "| case | energy within [%%] | said [%%] | true [%%] | meshes | CPU [s] | cheapest fixed setting, size | CPU "
        "[s] "
        "| P2, size | CPU [s] | ratio to P2 |\n|---|--:|--:|--:|--:|--:|---|--:|--:|--:|--:|\n");
  else if (mode != "truth")
    return std::fprintf(stderr, "bench_accuracy table | fixed | race | truth [case] [folder] [seconds]\n"), 1;
  const auto run = [&]<int Dim>(const std::string& name, Case<Dim> analysis, double natural, double truth_size,
                                double energy) {
    if (part != "all" && name.find(part) == std::string::npos) return;
    const Trial<Dim> trial{std::move(analysis), natural, truth_size, energy};
    if (mode == "table")
      tabulate(name, trial, most_seconds);
    else if (mode == "fixed")
      list_fixed(name, trial, most_seconds, finest);
    else if (mode == "race")
      race(name, trial, most_seconds);
    else
      find_truth(name, trial);
  };
  const std::vector<DisplacementCondition<2>> quarter{symmetry_plane<2>("left"), symmetry_plane<2>("bottom")};
  {
    auto plate = said<2>(
        [](double size) {
          return triangulate_data(shapes::quarter_plate_with_hole(1.0, Kirsch::half_width, size), {.size = size});
        },
        0.2, {.material = LinearElastic(Kirsch::material), .plane = Plane::stress}, quarter, Kirsch::loads(),
        coarsest_of_arcs);
    plate.exact = {Kirsch::displacement, Kirsch::stress};
    run("plate", plate, 0.2, 0.0, 0.0);
  }
  {
    PlanarDomain domain = shapes::rectangle(-1.0, -1.0, 1.0, 1.0);
    domain.slits.push_back({"slit", {{-0.4, 0.0}, {0.4, 0.1}}});
    run("slit", said<2>(filling(domain), 0.1, plane_stress(), {clamp<2>("bottom")}, {{tension<2>("top", 1.0)}, {}}),
        0.1, 0.02, 2.58208);
  }
  run("L",
      said<2>(filling(shapes::l_shape(1.0)), 0.05, plane_stress(), {clamp<2>("top")},
              {{},
               [](const Vec<2>&) -> Vec<2> {
                 return {0.0, -1.0};
               }}),
      0.05, 0.01, 0.79354);
  run("Cook",
      said<2>(filling(shapes::cook()), 3.0, {.material = LinearElastic(1.0, 1.0 / 3.0), .plane = Plane::strain},
              {clamp<2>("left")},
              {{{"right",
                 [](const Vec<2>&, const Vec<2>&) -> Vec<2> {
                   return {0.0, 1.0};
                 }}},
               {}}),
      3.0, 0.8, 2763.59);
  // Chords of 0.05 whatever the mesh: what they cost is not what is asked for.
  run("160 holes",
      said<2>(filling(shapes::plate_with_random_holes(10.0, 160, 0.04, 0.4, 0.03, 1, 0.05)), 0.5, plane_stress(),
              quarter, {{tension<2>("right", 1.0)}, {}}),
      0.5, 0.08, 125.182);
  run("500 pores",
      said<2>(filling(shapes::plate_with_random_holes(5.0, 500, 0.02, 0.1, 0.01, 1, 0.015)), 0.15, plane_stress(),
              quarter, {{tension<2>("right", 1.0)}, {}}),
      0.15, 0.04, 28.4147);
  static const Inclusion stiff(1.0, 0.6, 1000.0), soft(1.0, 0.6, 0.001);
  for (const Inclusion* inclusion : {&stiff, &soft}) {
    auto analysis = said<2>([=](double size) { return inclusion->mesh(size); }, 0.15,
                            inclusion->model(Essential::nitsche), quarter, inclusion->loads(), coarsest_of_arcs);
    const MeshData<2> mesh = inclusion->mesh(0.5);
    for (std::size_t r = 0; r < mesh.region_names.size(); ++r)
      analysis.common.materials.push_back({mesh.region_names[r], analysis.common.model.regions[r], ""});
    analysis.exact = inclusion->exact();
    run(inclusion == &stiff ? "inclusion 1000 : 1" : "inclusion 1 : 1000", analysis, 0.15, 0.0, 0.0);
  }
  {
    const auto image = keep_largest(random_spheres<2>(128, {.porosity = 0.35, .r_min = 3.0, .r_max = 12.0})).image;
    run("porous image",
        said<2>([=](double size) { return mesh_image<2>(image, {.size = size}); }, 1.0, plane_stress(),
                {moved("left", 0.0, 0.0), moved("right", 1.0, 0.0)}, {}),
        1.0, 0.5, 0.10277);
  }
  {
    auto cavity =
        said<3>([](double size) { return solids::spherical_cavity(1.0, Cavity::half_width, size); }, 0.1,
                {.material = LinearElastic(Cavity::material)},
                {symmetry_plane<3>("left"), symmetry_plane<3>("front"), symmetry_plane<3>("bottom")}, Cavity::loads());
    cavity.exact = {Cavity::displacement, Cavity::stress};
    run("cavity", cavity, 0.1, 0.0, 0.0);
  }
  run("block", pulled(keep_largest(random_spheres<3>(64, {.porosity = 0.3, .r_min = 6.0, .r_max = 14.0})).image), 2.0,
      0.5, 5.9140);
  run("gyroid", pulled(gyroid_labels(64)), 2.0, 0.5, 1.0976);
  if (folder.empty()) return std::fprintf(stderr, "the real files are left out: no folder of theirs\n"), 0;
  run("elephant", std::get<Case<3>>(read_case(folder / "elephant.toml")), 0.03, 0.03, 0.0);
  run("assembly", std::get<Case<3>>(read_case(folder / "assembly.toml")), 6.0, 6.0, 0.0);
}
