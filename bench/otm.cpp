// SPDX-License-Identifier: GPL-3.0-or-later
// bench_otm taylor 2|3 SIZE [key=value ...]: Taylor's bar, with what it costs. Keys: speed, until, gamma, cutoff,
// renewal, anisotropy, courant, stabilisation, merging, injection, linear, quadratic (shock viscosity), momentum (0
// affine, 1 nodes, 2 points), shared (0, 1), metal (0 linear hardening, 1 Johnson and Cook's, 2 with the pressure of
// shocks), threads, quarter (1: a quarter of the bar, between planes of symmetry).
// bench_otm chart [SIZE ...]: lengths and feet of the meridian section by one choice at a time and by the size [m], as
// CSV, with what they come to; a few minutes.
// bench_otm hertz N ... [key=value ...]: a rigid ball pressed into a half-space of N x N cells; careless=0.2: the
// share of a spacing by which nodes are off their lattice, exact=0: without exact integration.
// bench_otm momenta 2|3 SIZE [steps=1e5]: what a block, 2 x 1 (x 1), loses of its momenta while it vibrates at 2 % of
// the speed of sound, and while it flies and spins as well.
// bench_otm bar 2|3 SIZE ... : frequency of a bar with free ends on careless triangles (tetrahedra) of these sizes.

#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"

#include "arguments.hpp"
#include "clock.hpp"
#include "elastic_block.hpp"
#include "indentation.hpp"
#include "taylor_bar.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <string>
#include <utility>
#include <vector>

namespace efree {
namespace {

using bench::Keys;

double value_of(const Keys& keys, const char* name, double otherwise) {
  const auto found = keys.find(name);
  return found == keys.end() ? otherwise : found->second;
}

OtmOptions options_of(const Keys& keys) {
  const auto value = [&](const char* name, double otherwise) { return value_of(keys, name, otherwise); };
  OtmOptions options;
  options.lme.gamma = value("gamma", options.lme.gamma);
  options.lme.cutoff = value("cutoff", options.lme.cutoff);
  options.renewal = value("renewal", options.renewal);
  options.exact_integration = value("exact", options.exact_integration) != 0.0;
  options.anisotropy = value("anisotropy", options.anisotropy);
  options.courant = value("courant", options.courant);
  options.merging = value("merging", options.merging);
  options.injection = value("injection", options.injection);
  options.shock = {value("linear", 0.0), value("quadratic", 0.0)};
  options.stabilisation = value("stabilisation", options.stabilisation);
  options.momentum = static_cast<OtmMomentum>(static_cast<int>(value("momentum", 0)));
  return options;
}

template <int Dim> void taylor(double size, const Keys& keys) {
  const auto value = [&](const char* name, double otherwise) { return value_of(keys, name, otherwise); };
  const OtmOptions options = options_of(keys);
  set_num_threads(static_cast<int>(value("threads", 1)));
  const double until = value("until", 80e-6);
  const bool quarter = Dim == 3 && value("quarter", 0.0) != 0.0;
  const auto mesh = [&]() -> FineMesh<Dim> {
    if constexpr (Dim == 3)
      if (quarter) return bench::TaylorBar::quarter(size);
    return bench::TaylorBar::mesh<Dim>(size);
  }();
  const double start = bench::cpu_seconds(), clock = bench::wall_seconds();
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
          "point, %.2f iterations each, %lld widened, %lld kept, %d merged, %d injected, %d fused, %d joined: %d "
          "nodes, %d "
          "points\n",
          1e6 * otm.time(), 1e3 * shape.length, 1e3 * shape.foot, shape.plastic_strain, now.dissipated / before.kinetic,
          now.kinetic / before.kinetic, now.stored / before.kinetic, now.stabilising / before.kinetic,
          now.contact / before.kinetic, now.renewal / before.kinetic, now.total() / before.kinetic, count.steps,
          seconds, static_cast<double>(count.updates) / seconds, static_cast<double>(count.renewals) / otm.num_points(),
          static_cast<double>(count.iterations) / static_cast<double>(count.renewals + otm.num_points()),
          static_cast<long long>(count.widened), static_cast<long long>(count.kept), count.merged, count.injected,
          count.fused, count.joined, otm.num_nodes() - count.merged, otm.num_points());
      std::fflush(stdout);
    }
    const OtmTimes times = otm.times();
    std::printf(
        "functions %.2f s, kinematics %.2f, materials %.2f, forces %.2f, stability %.2f, nodes %.2f; by the clock %.2f "
        "s, set up too; peak %.0f MB\n",
        times.functions, times.kinematics, times.materials, times.forces, times.stability, times.nodes,
        bench::wall_seconds() - clock, peak_memory_mb());
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

/// Momenta of a body, in sums that do not round, and what they are measured by.
template <int Dim> struct Momenta {
  std::array<long double, 3> linear{}, centre{}, angular{}, about_origin{};  ///< angular: about the centre of mass
  long double mass = 0.0L, size = 0.0L, moment = 0.0L, moment_about_origin = 0.0L;  ///< sums of |m v|, |x| |m v|

  explicit Momenta(const Otm<Dim>& otm) {
    const Points<Dim> v = otm.velocities(), &x = otm.nodes();
    const auto component = [](const Points<Dim>& of, Index a, int i) -> long double {
      return i < Dim ? of(i, a) : 0.0;
    };
    for (Index a = 0; a < otm.num_nodes(); ++a) {
      mass += otm.masses()[a];
      for (int i = 0; i < Dim; ++i) centre[i] += otm.masses()[a] * component(x, a, i);
    }
    for (auto& c : centre) c /= mass;
    for (Index a = 0; a < otm.num_nodes(); ++a) {
      const long double m = otm.masses()[a];
      std::array<long double, 3> l, d, r;
      for (int i = 0; i < 3; ++i) {
        l[i] = m * component(v, a, i);
        r[i] = component(x, a, i);
        d[i] = r[i] - centre[i];
        linear[i] += l[i];
      }
      for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        angular[i] += d[j] * l[k] - d[k] * l[j];
        about_origin[i] += r[j] * l[k] - r[k] * l[j];
      }
      const auto norm = [](const auto& of) { return std::sqrt(of[0] * of[0] + of[1] * of[1] + of[2] * of[2]); };
      size += norm(l);
      moment += norm(d) * norm(l);
      moment_about_origin += norm(r) * norm(l);
    }
  }
};
inline double distance(const std::array<long double, 3>& a, const std::array<long double, 3>& b) {
  return static_cast<double>(std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]));
}

template <int Dim> void momenta(double size, double steps, const OtmOptions& options) {
  struct Case {
    const char* name;
    double speed, spin;
  };
  for (const auto& [name, speed, spin] :
       {Case{"vibrates", 0.0, 0.0}, Case{"flies", 0.3, 0.0}, Case{"spins", 0.1, 0.1}}) {
    OtmBody<Dim> body = otm_body(bench::block<Dim>(2.0, size), bench::soft(), 1.0);
    body.velocity.setZero(Dim, body.nodes.cols());
    for (Index a = 0; a < body.nodes.cols(); ++a) {
      const auto x = body.nodes.col(a);
      body.velocity(0, a) = speed - spin * (x[1] - 0.5) + 0.02 * std::sin(2.0 * x[0]);
      body.velocity(1, a) = 0.5 * speed + spin * (x[0] - 1.0);
    }
    Otm<Dim> otm({body}, options);
    const Momenta<Dim> before(otm);
    std::printf("%s, %d nodes:", name, otm.num_nodes());
    double worst_linear = 0.0, worst_angular = 0.0, worst_about_origin = 0.0;
    for (int k = 1; k <= 10; ++k) {
      while (otm.counts().steps < 0.1 * k * steps) otm.step();
      const Momenta<Dim> now(otm);
      worst_linear = std::max(worst_linear, distance(now.linear, before.linear) / static_cast<double>(before.size));
      worst_angular =
          std::max(worst_angular, distance(now.angular, before.angular) / static_cast<double>(before.moment));
      worst_about_origin = std::max(worst_about_origin, distance(now.about_origin, before.about_origin) /
                                                            static_cast<double>(now.moment_about_origin));
      if (k == 1 || k == 10)
        std::printf(" after %d steps linear %.2g, angular %.2g (about the origin %.2g)%s", otm.counts().steps,
                    worst_linear, worst_angular, worst_about_origin, k == 10 ? "\n" : ";");
    }
    std::printf("  it was %.3g renewals a point, time %.4g, energy %.4f of that at the start\n",
                static_cast<double>(otm.counts().renewals) / otm.num_points(), otm.time(),
                otm.balance().total() / Otm<Dim>({body}, options).balance().total());
    std::fflush(stdout);
  }
}

template <int Dim> void bar(double size, const OtmOptions& options) {
  const double begin = bench::cpu_seconds();
  const OtmBody<Dim> body = otm_body(bench::block<Dim>(4.0, size), bench::soft(0.0), 1.0);
  const double meshed = bench::cpu_seconds();
  const Otm<Dim> otm({body}, options);
  const double made = bench::cpu_seconds();
  const double error = bench::frequency_error(body, 4.0, options);
  std::printf("size %g, %d nodes, %d points, set up in %.3f s, first step %.4g: frequency %.4f %% off (%.2f s)\n", size,
              otm.num_nodes(), otm.num_points(), made - meshed, otm.stable_step(), 100.0 * error,
              bench::cpu_seconds() - begin);
  std::fflush(stdout);
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
  const efree::Keys keys = efree::bench::arguments(argc, argv, 2).keys;
  if (argc > 2 && std::strcmp(argv[1], "hertz") == 0) {
    efree::set_num_threads(1);
    for (int i = 2; i < argc; ++i) {
      const auto n = static_cast<efree::Index>(std::atoi(argv[i]));
      if (n <= 0) continue;  // a key
      const double start = efree::bench::cpu_seconds();
      const auto answer =
          efree::bench::Indentation::press(n, efree::options_of(keys), efree::value_of(keys, "careless", 0.0));
      std::printf("%d cells, contact radius of %.3g spacings: force over Hertz's %.4f, energy %.2g, %d steps, %.2f s\n",
                  n, 1.0 / efree::bench::Indentation::spacing(n), answer.force, answer.energy, answer.steps,
                  efree::bench::cpu_seconds() - start);
    }
    return 0;
  }
  if (argc < 4)
    return std::puts(
               "bench_otm taylor|momenta|bar 2|3 SIZE [key=value ...], bench_otm chart [SIZE ...], bench_otm hertz N "
               "..."),
           2;
  const std::string what = argv[1];
  const bool in_plane = std::atoi(argv[2]) == 2;
  if (what == "bar") {
    for (int i = 3; i < argc; ++i)
      if (const double size = std::atof(argv[i]); size > 0.0)
        in_plane ? efree::bar<2>(size, efree::options_of(keys)) : efree::bar<3>(size, efree::options_of(keys));
    return 0;
  }
  const double size = std::atof(argv[3]);
  if (what == "momenta") {
    const double steps = efree::value_of(keys, "steps", 1e5);
    in_plane ? efree::momenta<2>(size, steps, efree::options_of(keys))
             : efree::momenta<3>(size, steps, efree::options_of(keys));
  } else {
    in_plane ? efree::taylor<2>(size, keys) : efree::taylor<3>(size, keys);
  }
}
