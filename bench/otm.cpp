// SPDX-License-Identifier: GPL-3.0-or-later
// bench_otm taylor 2|3 SIZE [key=value ...]: Taylor's bar, with what it costs. Keys: speed, until, gamma, cutoff,
// renewal, anisotropy, courant, stabilisation, merging, injection, linear, quadratic (shock viscosity), momentum (0
// affine, 1 nodes, 2 points), shared (0, 1), metal (0 linear hardening, 1 Johnson and Cook's, 2 with the pressure of
// shocks), threads, quarter (1: a quarter of the bar, between planes of symmetry).
// bench_otm chart [SIZE ...]: lengths and feet of the meridian section by one choice at a time and by the size [m], as
// CSV, with what they come to; a few minutes.
// bench_otm hertz N ...: a rigid ball pressed into a half-space of N x N cells.

#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"

#include "clock.hpp"
#include "indentation.hpp"
#include "taylor_bar.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <map>
#include <string>
#include <utility>
#include <vector>

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

/// What a sequence that is twice as fine every time comes to, of order 1 to 2 as its values say.
double limit_of(double coarse, double middle, double fine) {
  const double order = std::clamp(std::log2(std::abs((middle - coarse) / (fine - middle))), 1.0, 2.0);
  return fine + (fine - middle) / (std::exp2(order) - 1.0);
}

void chart(std::vector<double> sizes) {
  set_num_threads(1);
  struct End {
    double length = std::numeric_limits<double>::quiet_NaN(), foot = length;
  };
  const auto run = [](const char* choice, double value, const OtmOptions& options, double size) {
    const double start = bench::cpu_seconds();
    auto otm = bench::TaylorBar::bar<2>(bench::TaylorBar::mesh<2>(size), 227.0, options);
    End end;
    try {
      otm.run(80e-6);
      const auto shape = bench::TaylorBar::shape(otm);
      end = {1e3 * shape.length, 1e3 * shape.foot};
    } catch (const NumericalError& error) {
      std::fprintf(stderr, "%s %g, %g: %s\n", choice, value, size, error.what());
    }
    std::printf("%s,%g,%g,%d,%d,%.5f,%.5f,%d,%.4g\n", choice, value, 1e3 * size, otm.num_nodes(), otm.num_points(),
                end.length, end.foot, otm.counts().steps, bench::cpu_seconds() - start);
    std::fflush(stdout);
    return end;
  };
  std::printf("choice,value,size_mm,nodes,points,length_mm,foot_mm,steps,cpu_seconds\n");
  // With the defaults twice as fine as any other.
  std::sort(sizes.rbegin(), sizes.rend());
  std::vector<End> ends;
  for (const double factor : {2.0, 1.0, 0.5}) ends.push_back(run("default", 0, {}, factor * sizes.back()));
  std::printf("limit,0,0,0,0,%.5f,%.5f,0,0\n", limit_of(ends[0].length, ends[1].length, ends[2].length),
              limit_of(ends[0].foot, ends[1].foot, ends[2].foot));
  const std::vector<std::pair<const char*, std::vector<double>>> choices{
      {"gamma", {1.0, 1.8, 2.5, 3.0, 4.0}}, {"cutoff", {1e-2, 1e-4, 1e-6}}, {"renewal", {0.02, 0.05, 0.1, 0.2, 0.4}}};
  for (const auto& [choice, values] : choices)
    for (const double value : values)
      for (const double size : sizes) {
        OtmOptions options;
        const std::string name = choice;
        (name == "gamma" ? options.lme.gamma : name == "cutoff" ? options.lme.cutoff : options.renewal) = value;
        run(choice, value, options, size);
      }
}

}  // namespace
}  // namespace efree

int main(int argc, char** argv) {
  if (argc > 1 && std::strcmp(argv[1], "chart") == 0) {
    std::vector<double> sizes;
    for (int i = 2; i < argc; ++i) sizes.push_back(std::atof(argv[i]));
    if (sizes.empty()) sizes = {1.28e-3, 0.9e-3, 0.64e-3, 0.45e-3, 0.32e-3};
    return efree::chart(sizes), 0;
  }
  if (argc > 2 && std::strcmp(argv[1], "hertz") == 0) {
    efree::set_num_threads(1);
    for (int i = 2; i < argc; ++i) {
      const auto n = static_cast<efree::Index>(std::atoi(argv[i]));
      const double start = efree::bench::cpu_seconds();
      const auto answer = efree::bench::Indentation::press(n);
      std::printf("%d cells, contact radius of %.3g spacings: force over Hertz's %.4f, energy %.2g, %d steps, %.2f s\n",
                  n, 1.0 / efree::bench::Indentation::spacing(n), answer.force, answer.energy, answer.steps,
                  efree::bench::cpu_seconds() - start);
    }
    return 0;
  }
  if (argc < 4)
    return std::puts("bench_otm taylor 2|3 SIZE [key=value ...], bench_otm chart [SIZE ...], bench_otm hertz N ..."), 2;
  std::map<std::string, double> key;
  for (int i = 4; i < argc; ++i)
    if (const char* equals = std::strchr(argv[i], '='))
      key[std::string(argv[i], equals - argv[i])] = std::atof(equals + 1);
  if (std::atoi(argv[2]) == 2)
    efree::taylor<2>(std::atof(argv[3]), key);
  else
    efree::taylor<3>(std::atof(argv[3]), key);
}
