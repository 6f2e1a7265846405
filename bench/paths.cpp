// SPDX-License-Identifier: GPL-3.0-or-later
/// Load paths with known answers, as the case files of bench/paths say them, by default and at two finer settings: true
/// and estimated errors, and time. The pipeline is that of the command line.
///
///   bench_paths [default | finer] [NAME...]
///
/// `default`: no finer settings. Finer settings say what was chosen by default (the spacing of a cloud, or mesh_size of
/// elements), divided by 1.5 and 1.5^2. References: docs/evidence.md.
#include "efree/io/case_file.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
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
};

/// c / 490: mean pressure under the footing of half width 50 over the cohesion.
const double footing_unit = 50.0 * 848.7049 / std::sqrt(3.0);

const std::vector<PathCase> cases{
    {"plate_with_hole", Of::reaction, "force", 0, 1.0, {{1.0, 1.4758}}},
    {"random_holes", Of::reaction, "force", 0, 1.0, {{1.0, 1.988}}},
    {"cylinder_slice", Of::probe, "outer", 0, 1.0, {{0.10, 0.05779}, {0.14, 0.08703}, {0.18, 0.15378}}},
    {"quarter_ring", Of::probe, "outer", 0, 1.0, {{0.10, 0.05779}, {0.14, 0.08703}, {0.18, 0.15378}}},
    {"sphere_section", Of::probe, "outer", 0, 1.0, {{0.22, 0.036573}, {0.28, 0.062622}, {0.30, 0.078233}}},
    {"sphere_solid", Of::probe, "outer", 0, 1.0, {{0.22, 0.036573}, {0.28, 0.062622}, {0.30, 0.078233}}},
    {"mooney_tube", Of::probe, "bore", 0, 1.0, {{1.0, 7.182}}},
    {"cook", Of::probe, "tip", 1, 1.0, {{1.0, 7.8923}}},
    {"circular_plate", Of::limit, "centre", 0, 1.0, {{0.0, 260.8}}},
    {"footing",
     Of::reaction,
     "load",
     1,
     -footing_unit,
     {{0.020, 3.62}, {0.045, 4.70}, {0.075, 5.12}, {0.080, 5.18}, {0.200, 5.20}}},
    {"necking_bar", Of::probe, "neck", 0, 1.0, {{1.0, -3.89}}},
    {"cantilever", Of::probe, "tip", 0, 1.0, {{1.0, -20.0}}},
    {"shallow_arch", Of::limit, "crown", 0, 1.0, {{0.0, 0.022474}}},
    {"follower_sphere", Of::probe, "bore", 0, 1.0, {{1.0, 30.0}}},
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

/// What the result says of the error, in per cent.
template <int Dim> std::string stated(const PathCase& of, const Result<Dim>& result) {
  if (result.estimates) return fmt::format("{:.2g} in the energy norm", 100.0 * result.estimates->total());
  if (!result.path_errors) return "unknown";
  const PathErrors& errors = *result.path_errors;
  if (of.of == Of::limit && errors.limit) return fmt::format("{:.2g}", 100.0 * *errors.limit);
  const auto& all = of.of == Of::reaction ? errors.reactions : errors.probes;
  const double error = all.at(of.what);
  return fmt::format("{:.2g}", 100.0 * error);
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
  double off = 0.0;
  std::string all, references;
  for (std::size_t k = 0; k < values.size(); ++k) {
    const double error = values[k] / of.known[k].value - 1.0;
    if (std::isnan(error) || std::abs(error) > std::abs(off)) off = error;
    all += fmt::format("{}{:.5g}", k == 0 ? "" : " ", values[k]);
    references += fmt::format("{}{:.5g}", k == 0 ? "" : " ", of.known[k].value);
  }
  Chosen chosen{.cloud = result.approximation.shape.num_nodes() < result.approximation.space.size(),
                .size = analysis.approximation.spacing > 0.0 ? analysis.approximation.spacing : analysis.geometry.size,
                .mesh = result.mesh->size()};
  if (!result.attempts.empty())
    chosen.size = chosen.cloud ? result.attempts.back().spacing : result.attempts.back().size;
  const auto& errors = result.path_errors;
  fmt::print("| {} | {} | {} {:.3g} | {} | {} | {} | {} | {:+.2f} | {} | {} | {} | {:.1f} |\n", of.name, setting,
             chosen.cloud ? "cloud" : "P2", chosen.size, result.approximation.nodes.cols(), result.history.size(), all,
             references, 100.0 * off, stated(of, result),
             errors && errors->stress ? fmt::format("{:.2g}", 100.0 * *errors->stress) : "",
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
    if (chosen.cloud) finer_case.approximation.spacing = size;
    finer_case.geometry.size = chosen.cloud ? std::min(chosen.mesh, size / edges_to_spacing) : size;
    run(of, setting, finer_case);
  }
}

}  // namespace

int main(int argc, char** argv) {
  int first = 1;
  bool finer = true;
  if (argc > 1 && std::strcmp(argv[1], "default") == 0) finer = false, first = 2;
  fmt::print(
      "| case | setting | functions | nodes | steps | value | reference | true error [%] | estimated [%] | of stresses "
      "[%] | status 3 | CPU [s] |\n|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  for (const PathCase& of : cases) {
    const bool asked =
        first >= argc || std::any_of(argv + first, argv + argc, [&](const char* name) { return of.name == name; });
    if (!asked) continue;
    std::visit([&](auto analysis) { study(of, std::move(analysis), finer); },
               read_case(std::string(EFREE_PATHS) + "/" + of.name + ".toml"));
  }
}
