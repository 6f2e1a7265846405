// SPDX-License-Identifier: GPL-3.0-or-later
// Averaged dilatations where material flows (docs/evidence.md): a thick ring that has to stay round, a plate that has
// to be as stiff as an elastic one until it yields and to bear its limit load, and a strip footing.
//
//   bench_averaging [ring | plate | footing] [seeds = 10]
#include "clock.hpp"
#include "yielding_bodies.hpp"

#include <efree/efree.hpp>

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string>
#include <vector>

using namespace efree;
using namespace efree::bench;

namespace {

struct Functions {
  std::string name;
  ApproximationOptions options;
};

template <class... T> void row(fmt::format_string<T...> format, T&&... values) {
  fmt::print(format, std::forward<T>(values)...);
  std::fflush(stdout);
}
std::string ends(const Result<2>& result) {
  return result.stopped.empty() ? "end" : fmt::format("t={:.4g}", result.history.back().time);
}

void ring(const Functions& method, double H, int seeds) {
  const PressedRing body;
  const FineMesh<2> mesh = body.mesh(0.5 * H);
  for (int seed = 1; seed <= seeds; ++seed) {
    ApproximationOptions options = method.options;
    options.spacing = H;
    options.seed = seed;
    const auto result = analyse(mesh, body.settings(options));
    std::string errors;
    for (const auto& step : result.history)
      if (PressedRing::is_stop(step.time)) errors += fmt::format(" {:+.2f} |", 100.0 * body.worst(step));
    row("| {} | {:g} | {} |{} {} | {} |\n", method.name, H, seed, errors, result.history.size(), ends(result));
  }
}

void plate(const Functions& method, double H) {
  const BentPlate body;
  const FineMesh<2> mesh = body.mesh(H / 3.0);
  ApproximationOptions options = method.options;
  options.spacing = H;
  constexpr double elastic = 100.0, beyond_limit = 400.0;
  const auto bent = analyse(mesh, body.settings(options, elastic));
  const auto limit = analyse(mesh, body.settings(options, beyond_limit));
  row("| {} | {:g} | {} | {:+.2f} | {:+.2f} | {} |\n", method.name, H, bent.approximation.nodes.cols(),
      100.0 * (bent.history.back().probes.front()[1] / BentPlate::deflection(elastic) - 1.0),
      100.0 * (limit.history.back().time / BentPlate::limit - 1.0), limit.history.size());
}

void foot(const Functions& method, const Footing& body) {
  const double start = cpu_seconds();
  const auto result = analyse(body.mesh(), body.settings(method.options));
  std::string loads;
  for (const auto& step : result.history)
    for (const double u : Footing::stops)
      if (std::abs(step.time - u) < 1e-9) loads += fmt::format(" {:.3f} |", body.load(step));
  row("| {} |{} {} | {} | {:.1f} |\n", method.name, loads, result.history.size(), ends(result), cpu_seconds() - start);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string what = argc > 1 ? argv[1] : "all";
  const int seeds = argc > 2 ? std::atoi(argv[2]) : 10;
  const auto wants = [&](const char* body) { return what == "all" || what == body; };
  const std::vector<Functions> clouds{{"linear pressures", {}},
                                      {"constant pressures", {.pressures = PressureKind::constant}},
                                      {"pointwise", {.dilatation = Dilatation::pointwise}}};
  if (wants("ring")) {
    row("| dilatation | H / a | seed | error at p = 0.10, % | 0.14 | 0.18 | steps | comes to |\n"
        "|---|---|---|---|---|---|---|---|\n");
    for (const Functions& method : clouds)
      for (const double H : {0.12, 0.08}) ring(method, H, seeds);
  }
  if (wants("plate")) {
    row("| dilatation | H | nodes | elastic deflection, error in % | limit load, error in % | steps |\n"
        "|---|---|---|---|---|---|\n");
    for (const Functions& method : clouds)
      for (const double H : {0.25, 0.125}) plate(method, H);
  }
  if (wants("footing")) {
    row("| quadratic elements, dilatation | load at u = 0.02 | 0.045 | 0.075 | 0.08 | 0.2 | steps | comes to | CPU s "
        "|\n"
        "|---|---|---|---|---|---|---|---|---|\n");
    for (const Dilatation dilatation : {Dilatation::averaged, Dilatation::pointwise})
      foot({dilatation == Dilatation::averaged ? "mean of a cell" : "pointwise",
            {.kind = BasisKind::p2, .dilatation = dilatation}},
           {});
  }
}
