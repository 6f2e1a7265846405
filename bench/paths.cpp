// SPDX-License-Identifier: GPL-3.0-or-later
/// Load paths with known answers, as the case files of bench/paths say them, by default and at two finer settings: true
/// and estimated errors, and time. The pipeline is that of the command line.
///
///   bench_paths [default | finer] [NAME...]
///
/// `default`: no finer settings. Finer settings say what was chosen by default (the spacing of a cloud, or mesh_size of
/// elements), divided by 1.5 and 1.5^2, with sagittas of curved walls divided by the squares of that. Errors: the
/// largest over the times of references, over the largest reference. Effectivity: estimated over true error, or
/// "reference" where the true error is below what the reference is known to.
#include "efree/io/case/case_file.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <numbers>
#include <optional>
#include <string>
#include <variant>
#include <vector>

using namespace efree;

namespace {

/// What a case is compared by.
enum class Of {
  probe,     ///< a component of a displacement
  reaction,  ///< a component of a force
  limit,     ///< the time at which the path stops, or first falls
};
struct Known {
  double time, value;
};
struct PathCase {
  std::string name;
  Of of;
  std::string what;  ///< of the probe or the reaction
  int component;
  double unit;               ///< references times this are values of the analysis
  std::vector<Known> known;  ///< ascending times; the last is the end unless it is a limit
  double uncertainty;        ///< of the references, over the largest of them
};

/// c / 490: mean pressure under the footing of half width 50 over the cohesion.
const double footing_unit = 50.0 * 848.7049 / std::sqrt(3.0);

/// References: closed forms and radial equations solved to more digits than are given here (cylinder: elastic and
/// perfectly plastic, steps to zero; spheres: Hill 1950; Mooney tube, follower sphere), the footing's limit load of
/// Prandtl 1920 (uniform pressure 2 + pi times the cohesion), else P2 on finer meshes, extrapolated (docs/evidence.md).
const std::vector<Known> cylinder{{0.10, 0.0577778}, {0.14, 0.087287}, {0.18, 0.154018}},
    sphere{{0.22, 0.0365732}, {0.28, 0.0626223}, {0.30, 0.0782325}};
const std::vector<PathCase> cases{
    {"plate_with_hole", Of::reaction, "force", 0, 1.0, {{1.0, 1.47588}}, 1e-5},
    {"random_holes", Of::reaction, "force", 0, 1.0, {{1.0, 1.972}}, 2e-3},
    {"cylinder_slice", Of::probe, "outer", 0, 1.0, cylinder, 2e-5},
    {"quarter_ring", Of::probe, "outer", 0, 1.0, cylinder, 2e-5},
    {"sphere_section", Of::probe, "outer", 0, 1.0, sphere, 1e-6},
    {"sphere_solid", Of::probe, "outer", 0, 1.0, sphere, 1e-6},
    {"mooney_tube", Of::probe, "bore", 0, 1.0, {{1.0, 7.204331}}, 1e-7},
    {"cook", Of::probe, "tip", 1, 1.0, {{1.0, 7.8927}}, 3e-5},
    {"circular_plate", Of::limit, "centre", 0, 1.0, {{0.0, 261.75}}, 3e-4},
    {"footing", Of::reaction, "load", 1, -footing_unit, {{0.200, 2.0 + std::numbers::pi}}, 1e-4},
    {"necking_bar", Of::probe, "neck", 0, 1.0, {{1.0, -3.89}}, 0.05},
    {"cantilever", Of::probe, "tip", 0, 1.0, {{1.0, -19.9657}}, 1e-5},
    {"shallow_arch", Of::limit, "crown", 0, 1.0, {{0.0, 0.0224702}}, 1e-5},
    {"follower_sphere", Of::probe, "bore", 0, 1.0, {{1.0, 30.00196}}, 1e-6},
};

template <int Dim> double at_end(const PathCase& of, const Settings<Dim>& settings, const Result<Dim>& result) {
  if (of.of == Of::probe) {
    for (const auto& [name, values] : result.probes)
      if (name == of.what) return values.displacement[of.component];
  } else {
    for (const auto& reaction : settings.reactions)
      if (reaction.name == of.what) return result.balance.reactions.at(reaction.on).force[of.component];
  }
  return std::numeric_limits<double>::quiet_NaN();
}

template <int Dim>
std::vector<double> values_of(const PathCase& of, const Settings<Dim>& settings, const Result<Dim>& result) {
  std::vector<double> values;
  if (of.of == Of::limit) {
    double most = 0.0;
    for (const auto& step : result.history) {
      if (step.time < most) break;
      most = step.time;
    }
    return {most};
  }
  std::size_t probe = 0;
  while (of.of == Of::probe && settings.probes[probe].name != of.what) ++probe;
  for (const Known& known : of.known) {
    const auto step = std::ranges::find_if(
        result.history, [&](const auto& one) { return std::abs(one.time - known.time) < 1e-9 * known.time; });
    if (step == result.history.end())
      values.push_back(std::numeric_limits<double>::quiet_NaN());
    else if (step + 1 == result.history.end())
      values.push_back(at_end(of, settings, result) / of.unit);
    else
      values.push_back(
          (of.of == Of::probe ? step->probes[probe][of.component] : step->reactions.at(of.what).force[of.component]) /
          of.unit);
  }
  if (result.history.empty()) values.back() = at_end(of, settings, result) / of.unit;
  return values;
}

/// What the result says of the error of the value; nothing where it is unknown.
template <int Dim> std::optional<double> stated(const PathCase& of, const Result<Dim>& result) {
  if (!result.path_errors) return std::nullopt;
  const PathErrors& errors = *result.path_errors;
  if (of.of == Of::limit && errors.limit) return *errors.limit;
  return (of.of == Of::reaction ? errors.reactions : errors.probes).at(of.what);
}

/// What a run has chosen.
struct Chosen {
  bool cloud = false;
  double size = 0.0;  ///< spacing of the cloud or edges of elements; 0: it failed
  double mesh = 0.0;  ///< edges of the mesh
};

template <int Dim> Chosen run(const PathCase& of, const std::string& setting, const Case<Dim>& analysis) {
  Result<Dim> result;
  try {
    result = analyse(analysis);
  } catch (const std::exception& error) {
    fmt::print("| {} | {} | {} |\n", of.name, setting, error.what());
    std::fflush(stdout);
    return {};
  }
  const auto values = values_of(of, analysis, result);
  double off = 0.0, largest = 0.0;  // the largest error over the largest value, as errors of paths are stated
  for (const Known& known : of.known) largest = std::max(largest, std::abs(known.value));
  std::string all, references;
  for (std::size_t k = 0; k < values.size(); ++k) {
    const double error = (values[k] - of.known[k].value) / largest;
    if (std::isnan(error) || std::abs(error) > std::abs(off)) off = error;
    all += fmt::format("{}{:.6g}", k == 0 ? "" : " ", values[k]);
    references += fmt::format("{}{:.6g}", k == 0 ? "" : " ", of.known[k].value);
  }
  const auto error = stated(of, result);
  const std::string effectivity = !error                            ? ""
                                  : std::abs(off) <= of.uncertainty ? "reference"
                                                                    : fmt::format("{:.2f}", *error / std::abs(off));
  Chosen chosen{.cloud = result.approximation.shape.num_nodes() < result.approximation.space.size(),
                .size = analysis.common.approximation.spacing > 0.0 ? analysis.common.approximation.spacing
                                                                    : analysis.geometry.size,
                .mesh = result.mesh->size()};
  if (!result.attempts.empty())
    chosen.size = chosen.cloud ? result.attempts.back().spacing : result.attempts.back().size;
  const auto& errors = result.path_errors;
  fmt::print("| {} | {} | {} {:.3g} | {} | {} | {} | {} | {:+.3g} | {} | {} | {} | {} | {:.1f} |\n", of.name, setting,
             chosen.cloud ? "cloud" : "P2", chosen.size, result.approximation.nodes.cols(), result.history.size(), all,
             references, 100.0 * off,
             error              ? fmt::format("{:.2g}", 100.0 * *error)
             : result.estimates ? fmt::format("{:.2g} in the energy norm", 100.0 * result.estimates->total())
                                : "unknown",
             effectivity, errors && errors->stress ? fmt::format("{:.2g}", 100.0 * *errors->stress) : "",
             result.refusal.empty() ? "" : "yes", result.cpu_seconds);
  std::fflush(stdout);
  return chosen;
}

template <int Dim> void study(const PathCase& of, const Case<Dim>& analysis, bool finer) {
  constexpr double edges_to_spacing = Dim == 2 ? 4.0 : 3.0;
  const Chosen chosen = run(of, "default", analysis);
  if (!finer || chosen.size == 0.0) return;
  double factor = 1.0;
  for (const char* setting : {"1.5 times finer", "2.25 times finer"}) {
    factor *= 1.5;
    Case<Dim> finer_case = analysis;
    const double size = chosen.size / factor;
    if (chosen.cloud) finer_case.common.approximation.spacing = size;
    finer_case.geometry.size = chosen.cloud ? std::min(chosen.mesh, size / edges_to_spacing) : size;
    finer_case.geometry.sagitta = default_sagitta / (factor * factor);  // else curves have 16 facets to a turn
    run(of, setting, finer_case);
  }
}

}  // namespace

int main(int argc, char** argv) {
  int first = 1;
  bool finer = true;
  if (argc > 1 && std::strcmp(argv[1], "default") == 0) finer = false, first = 2;
  if (argc > 1 && std::strcmp(argv[1], "finer") == 0) first = 2;
  fmt::print(
      "| case | setting | functions | nodes | steps | value | reference | true error [%] | estimated [%] | effectivity "
      "| "
      "of stresses [%] | status 3 | CPU [s] |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  for (const PathCase& of : cases) {
    const bool asked =
        first >= argc || std::any_of(argv + first, argv + argc, [&](const char* name) { return of.name == name; });
    if (!asked) continue;
    std::visit([&](auto analysis) { study(of, std::move(analysis), finer); },
               read_static_case(std::string(EFREE_PATHS) + "/" + of.name + ".toml"));
  }
}
