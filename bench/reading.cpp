// SPDX-License-Identifier: GPL-3.0-or-later
/// What it costs that geometries are read and meshed in a process of their own: bench_reading CASE.toml [RUNS]. Seconds
/// of reading and meshing there and in this process, and of the whole analysis; medians.
#include "clock.hpp"
#include "efree/core/internal/clock.hpp"
#include "efree/io/confined/internal/confined.hpp"

#include <cstdio>
#include <cstdlib>
#include <efree/efree.hpp>

using namespace efree;
using efree::bench::median;

namespace {

template <int Dim> void measure(const Case<Dim>& analysis, int runs) {
  const MeshSize size{.length = analysis.geometry.size};
  std::vector<double> apart, here, whole;
  for (int run = 0; run < runs; ++run) {
    internal::Stopwatch clock;
    const auto made = analysis.geometry.mesh(size, {"mesh", {}});
    apart.push_back(clock());
    // Work in such a process that asks for one is simply done there.
    here.push_back(internal::confined({.subject = "the case", .reader = "the mesher"}, [&] {
      const internal::Stopwatch inner;
      analysis.geometry.mesh(size, {"mesh", {}});
      return inner();
    }));
    clock = {};
    analyse(analysis);
    whole.push_back(clock());
  }
  const double cost = median(apart) - median(here);
  std::printf("mesh in a process of its own %.3f s, without %.3f s: %.3f s more, %.2f %% of the analysis's %.2f s\n",
              median(apart), median(here), cost, 100.0 * cost / median(whole), median(whole));
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc < 2) return std::fprintf(stderr, "usage: bench_reading CASE.toml [RUNS]\n"), 2;
  const int runs = argc > 2 ? std::atoi(argv[2]) : 5;
  std::visit([&](const auto& analysis) { measure(analysis, runs); }, read_static_case(argv[1]));
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
