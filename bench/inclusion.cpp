// SPDX-License-Identifier: GPL-3.0-or-later
/// Circular and elliptical inclusions, 10 and 1000 times as stiff as the matrix, against the exact solution: errors of
/// efree on a fine mesh parted along the interface (H/h = 5), and of P1 elements of about as many nodes. Prints a
/// Markdown table; orders are those over all spacings.
///
///   bench_inclusion [finest spacing = 0.1] [seeds = 3]
#include "efree/bench/inclusion.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>

using namespace efree;

namespace {

using Values = std::array<double, 3>;  // errors: displacement in L2, energy norm, energy norm of the recovered stress

struct Run {
  Values errors;
  Index nodes;
};

Run solve(const bench::Inclusion& inclusion, const FineMesh<2>& mesh, const ApproximationOptions& options) {
  const auto approximation = approximate(mesh, options);
  const auto model = inclusion.model(options.kind == BasisKind::mls ? Essential::nitsche : Essential::strong);
  const ElasticSolver<2> solver(approximation, model, {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")});
  const auto fields = recover_fields(approximation, solver.solve(inclusion.loads()));
  const Errors errors = errors_against(approximation, fields, materials_of(model, mesh), inclusion.exact());
  return {{*errors.l2_displacement, *errors.energy_norm, *errors.energy_norm_recovered},
          approximation.shape.num_nodes()};
}

Values medians(std::vector<Values> values) {
  Values out;
  for (int e = 0; e < 3; ++e) {
    std::ranges::sort(values, {}, [e](const Values& v) { return v[e]; });
    out[e] = values[values.size() / 2][e];
  }
  return out;
}

}  // namespace

int main(int argc, char** argv) {
  const double finest = argc > 1 ? std::atof(argv[1]) : 0.1;
  const int seeds = argc > 2 ? std::atoi(argv[2]) : 3;
  std::printf(
      "| semi-axes | E / E matrix | method | nodes | displacement, L2 | order | energy norm | order | recovered | "
      "order |\n"
      "|---|---|---|---|---|---|---|---|---|---|\n");
  for (const double b : {1.0, 0.5})
    for (const double ratio : {10.0, 1000.0}) {
      const bench::Inclusion inclusion(1.0, b, ratio);
      for (const bool elements : {false, true}) {
        Values first{}, last{};
        Index nodes = 0;
        double coarsest = 0.4, H = coarsest;
        for (; H > 0.99 * finest; H *= 0.5) {
          std::vector<Values> of_seeds;
          const FineMesh<2> mesh(elements ? inclusion.mesh(1.6 * H) : cut_regions(inclusion.mesh(H / 5.0)));
          for (int seed = 1; seed <= (elements ? 1 : seeds); ++seed) {
            const Run run = solve(inclusion, mesh,
                                  {.kind = elements ? BasisKind::p1 : BasisKind::mls,
                                   .spacing = H,
                                   .seed = static_cast<std::uint64_t>(seed)});
            of_seeds.push_back(run.errors);
            nodes = run.nodes;
          }
          last = medians(of_seeds);
          if (H == coarsest) first = last;
        }
        const auto order = [&](int e) { return std::log(first[e] / last[e]) / std::log(coarsest / (2.0 * H)); };
        std::printf("| 1, %g | %g | %s | %d | %.1e | %.2f | %.1e | %.2f | %.1e | %.2f |\n", b, ratio,
                    elements ? "P1" : "cells", nodes, last[0], order(0), last[1], order(1), last[2], order(2));
        std::fflush(stdout);
      }
    }
}
