// SPDX-License-Identifier: GPL-3.0-or-later
// bench_otm taylor 2|3 SIZE [key=value ...]: Taylor's bar, with what it costs. Keys: speed, until, gamma, cutoff,
// renewal, anisotropy, courant, stabilisation, merging, injection, linear, quadratic (shock viscosity), momentum (0
// affine, 1 nodes, 2 points), shared (0, 1), metal (0 linear hardening, 1 Johnson and Cook's, 2 with the pressure of
// shocks), threads, quarter (1: a quarter of the bar, between planes of symmetry).

#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"

#include "clock.hpp"
#include "taylor_bar.hpp"

#include <cstdio>
#include <cstring>
#include <map>
#include <string>

namespace efree {
namespace {

template <int Dim> void taylor(double size, std::map<std::string, double> key) {
  const auto value = [&](const char* name, double otherwise) { return key.contains(name) ? key[name] : otherwise; };
  OtmOptions options;
  options.lme.gamma = value("gamma", options.lme.gamma);
  options.lme.cutoff = value("cutoff", options.lme.cutoff);
  options.renewal = value("renewal", options.renewal);
  options.anisotropy = value("anisotropy", options.anisotropy);
  options.courant = value("courant", options.courant);
  options.merging = value("merging", options.merging);
  options.injection = value("injection", options.injection);
  options.shock = {value("linear", 0.0), value("quadratic", 0.0)};
  options.stabilisation = value("stabilisation", options.stabilisation);
  options.momentum = static_cast<OtmMomentum>(static_cast<int>(value("momentum", 0)));
  set_num_threads(static_cast<int>(value("threads", 1)));
  const double until = value("until", 80e-6);
  const bool quarter = Dim == 3 && value("quarter", 0.0) != 0.0;
  const auto mesh = [&]() -> FineMesh<Dim> {
    if constexpr (Dim == 3)
      if (quarter) return bench::TaylorBar::quarter(size);
    return bench::TaylorBar::mesh<Dim>(size);
  }();
  const double start = bench::cpu_seconds();
  const auto metal = static_cast<int>(value("metal", 0));
  auto otm = bench::TaylorBar::bar<Dim>(mesh, value("speed", 227.0), options, value("shared", 1.0) != 0.0,
                                        metal == 0   ? bench::TaylorBar::copper()
                                        : metal == 1 ? bench::TaylorBar::johnson_cook()
                                                     : bench::TaylorBar::shocked(),
                                        quarter);
  const double begin = bench::cpu_seconds();
  const auto before = otm.balance();
  std::printf("%d nodes, %d points, set up in %.2f s, first step %.3g ns, kinetic energy %.4g J\n", otm.num_nodes(),
              otm.num_points(), begin - start, 1e9 * otm.stable_step(), before.kinetic);
  const double every = value("every", until);
  try {
    for (double t = every; t <= until * 1.0001; t += every) {
      otm.run(t);
      const auto now = otm.balance();
      const auto shape = bench::TaylorBar::shape(otm);
      const double seconds = bench::cpu_seconds() - begin;
      const auto& count = otm.counts();
      std::printf(
          "%5.1f us: length %.3f mm, foot %.3f mm, plastic strain %.3f | plastic work %.3f, kinetic %.3f, stored %.3f, "
          "stabilising %.4f, contact %.3f, renewal %.4f, total %.5f | %d steps, %.3f s, %.3g updates/s, %.1f renewals "
          "a "
          "point, %.2f iterations each, %lld widened, %lld kept, %d merged, %d injected, %d fused: %d nodes, %d "
          "points\n",
          1e6 * otm.time(), 1e3 * shape.length, 1e3 * shape.foot, shape.plastic_strain, now.dissipated / before.kinetic,
          now.kinetic / before.kinetic, now.stored / before.kinetic, now.stabilising / before.kinetic,
          now.contact / before.kinetic, now.renewal / before.kinetic, now.total() / before.kinetic, count.steps,
          seconds, static_cast<double>(count.updates) / seconds, static_cast<double>(count.renewals) / otm.num_points(),
          static_cast<double>(count.iterations) / static_cast<double>(count.renewals + otm.num_points()),
          static_cast<long long>(count.widened), static_cast<long long>(count.kept), count.merged, count.injected,
          count.fused, otm.num_nodes() - count.merged, otm.num_points());
      std::fflush(stdout);
    }
    const OtmTimes times = otm.times();
    std::printf(
        "functions %.2f s, kinematics %.2f, materials %.2f, forces %.2f, stability %.2f, nodes %.2f; peak %.0f MB\n",
        times.functions, times.kinematics, times.materials, times.forces, times.stability, times.nodes,
        peak_memory_mb());
  } catch (const NumericalError& error) {
    std::printf("%s\n", error.what());
  }
}

}  // namespace
}  // namespace efree

int main(int argc, char** argv) {
  if (argc < 4) return std::puts("bench_otm taylor 2|3 SIZE [key=value ...]"), 2;
  std::map<std::string, double> key;
  for (int i = 4; i < argc; ++i)
    if (const char* equals = std::strchr(argv[i], '='))
      key[std::string(argv[i], equals - argv[i])] = std::atof(equals + 1);
  if (std::atoi(argv[2]) == 2)
    efree::taylor<2>(std::atof(argv[3]), key);
  else
    efree::taylor<3>(std::atof(argv[3]), key);
}
