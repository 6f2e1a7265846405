// SPDX-License-Identifier: GPL-3.0-or-later
// bench_dynamics taylor 2|3 SIZE [key=value ...]: Taylor's bar, with what it costs. Keys: speed, until, gamma, cutoff,
// reconnection_strain, anisotropy, courant, stabilisation, merging, insertion, linear, quadratic (artificial
// viscosity), momentum (0 affine, 1 nodes, 2 points), shared (0, 1), metal (0 linear hardening, 1 Johnson and Cook's, 2
// with the pressure of shocks), threads, quarter (1: a quarter of the bar, between planes of symmetry).
// bench_dynamics chart [SIZE ...]: lengths and feet of the meridian section by one choice at a time and by the size
// [m], as CSV, with what they come to; a few minutes. bench_dynamics hertz N ... [key=value ...]: a rigid ball pressed
// into a half-space of N x N cells; careless=0.2: the share of a spacing by which nodes are off their lattice, exact=0:
// without exact integration. bench_dynamics momenta 2|3 SIZE [steps=1e5]: what a block, 2 x 1 (x 1), loses of its
// momenta while it vibrates at 2 % of the speed of sound, and while it flies and spins as well. bench_dynamics bar 2|3
// SIZE ... : frequency of a bar with free ends on careless triangles (tetrahedra) of these sizes.

#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"

#include "arguments.hpp"
#include "clock.hpp"
#include "elastic_block.hpp"
#include "indentation.hpp"
#include "ledger_text.hpp"
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

DynamicsOptions dynamics_options(const Keys& keys) {
  DynamicsOptions options;
  options.courant = value_of(keys, "courant", options.courant);
  options.shock = {value_of(keys, "linear", 0.0), value_of(keys, "quadratic", 0.0)};
  return options;
}
OtmOptions otm_options(const Keys& keys) {
  const auto value = [&](const char* name, double otherwise) { return value_of(keys, name, otherwise); };
  OtmOptions options;
  options.lme.gamma = value("gamma", options.lme.gamma);
  options.lme.cutoff = value("cutoff", options.lme.cutoff);
  options.reconnection_strain = value("reconnection_strain", options.reconnection_strain);
  options.exact_integration = value("exact", options.exact_integration) != 0.0;
  options.anisotropy = value("anisotropy", options.anisotropy);
  options.merging = value("merging", options.merging);
  options.insertion = value("insertion", options.insertion);
  options.stabilisation = value("stabilisation", options.stabilisation);
  options.momentum = static_cast<MomentumTransfer>(static_cast<int>(value("momentum", 0)));
  return options;
}

template <int Dim> void taylor(double size, const Keys& keys) {
  const auto value = [&](const char* name, double otherwise) { return value_of(keys, name, otherwise); };
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
  auto dynamics = bench::TaylorBar::bar<Dim>(mesh, value("speed", 227.0), otm_options(keys), dynamics_options(keys),
                                             value("shared", 1.0) != 0.0,
                                             metal == 0   ? bench::TaylorBar::copper()
                                             : metal == 1 ? bench::TaylorBar::johnson_cook()
                                                          : bench::TaylorBar::shocked(),
                                             quarter);
  const double begin = bench::cpu_seconds();
  const auto before = dynamics.balance();
  std::printf("%d nodes, %d points, set up in %.2f s, first step %.3g ns, kinetic energy %.4g J\n",
              dynamics.num_nodes(), dynamics.num_points(), begin - start, 1e9 * dynamics.stable_step(),
              before["kinetic"]);
  const double every = value("every", until);
  try {
    for (double t = every; t <= until * 1.0001; t += every) {
      dynamics.run(t);
      const auto now = dynamics.balance();
      const auto shape = bench::TaylorBar::shape(dynamics);
      const double seconds = bench::cpu_seconds() - begin;
      const Ledger ledger = dynamics.ledger();
      const double reconnections = static_cast<double>(ledger.count("reconnections"));
      std::printf(
          "%5.1f us: length %.3f mm, foot %.3f mm, plastic strain %.3f | %s, total %.5f | %d steps, %.3f s, %.3g "
          "updates/s, %.1f reconnections a point, %.2f iterations each, %s: %d nodes, %d points\n",
          1e6 * dynamics.time(), 1e3 * shape.length, 1e3 * shape.foot, shape.plastic_strain,
          bench::energies_text(now.energies, before["kinetic"]).c_str(), now.total() / before["kinetic"],
          dynamics.steps(), seconds, static_cast<double>(ledger.count("point updates")) / seconds,
          reconnections / dynamics.num_points(),
          static_cast<double>(ledger.count("lme iterations")) / (reconnections + dynamics.num_points()),
          bench::counts_text(ledger).c_str(), dynamics.num_nodes() - static_cast<Index>(ledger.count("merged nodes")),
          dynamics.num_points());
      std::fflush(stdout);
    }
    std::printf("%s; by the clock %.2f s, set up too; peak %.0f MB\n", bench::times_text(dynamics.ledger()).c_str(),
                bench::wall_seconds() - clock, peak_memory_mb());
  } catch (const NumericalError& error) {
    std::printf("%s\n", error.what());
  }
}

/// Limit of a sequence that is twice as fine every time, with an order of 1 to 2 by its values (Richardson 1911).
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
    auto dynamics = bench::TaylorBar::bar<2>(bench::TaylorBar::mesh<2>(size), 227.0, options);
    End end;
    try {
      dynamics.run(80e-6);
      const auto shape = bench::TaylorBar::shape(dynamics);
      end = {1e3 * shape.length, 1e3 * shape.foot};
    } catch (const NumericalError& error) {
      std::fprintf(stderr, "%s %g, %g: %s\n", choice, value, size, error.what());
    }
    std::printf("%s,%g,%g,%d,%d,%.5f,%.5f,%d,%.4g\n", choice, value, 1e3 * size, dynamics.num_nodes(),
                dynamics.num_points(), end.length, end.foot, dynamics.steps(), bench::cpu_seconds() - start);
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
      {"gamma", {1.0, 1.8, 2.5, 3.0, 4.0}},
      {"cutoff", {1e-2, 1e-4, 1e-6}},
      {"reconnection_strain", {0.02, 0.05, 0.1, 0.2, 0.4}}};
  for (const auto& [choice, values] : choices)
    for (const double value : values)
      for (const double size : sizes) {
        OtmOptions options;
        const std::string name = choice;
        (name == "gamma"    ? options.lme.gamma
         : name == "cutoff" ? options.lme.cutoff
                            : options.reconnection_strain) = value;
        run(choice, value, options, size);
      }
}

/// Momenta of a body, in sums that do not round, and their scales.
template <int Dim> struct Momenta {
  std::array<long double, 3> linear{}, centre{}, angular{}, about_origin{};  ///< angular: about the centre of mass
  long double mass = 0.0L, size = 0.0L, moment = 0.0L, moment_about_origin = 0.0L;  ///< sums of |m v|, |x| |m v|

  explicit Momenta(const Dynamics<Dim>& dynamics) {
    const Points<Dim> v = dynamics.velocities(), &x = dynamics.nodes();
    const auto component = [](const Points<Dim>& of, Index a, int i) -> long double {
      return i < Dim ? of(i, a) : 0.0;
    };
    for (Index a = 0; a < dynamics.num_nodes(); ++a) {
      mass += dynamics.masses()[a];
      for (int i = 0; i < Dim; ++i) centre[i] += dynamics.masses()[a] * component(x, a, i);
    }
    for (auto& c : centre) c /= mass;
    for (Index a = 0; a < dynamics.num_nodes(); ++a) {
      const long double m = dynamics.masses()[a];
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

template <int Dim> void momenta(double size, double steps, const OtmOptions& scheme, const DynamicsOptions& options) {
  struct Case {
    const char* name;
    double speed, spin;
  };
  for (const auto& [name, speed, spin] :
       {Case{"vibrates", 0.0, 0.0}, Case{"flies", 0.3, 0.0}, Case{"spins", 0.1, 0.1}}) {
    DeformableBody<Dim> body = deformable_body(bench::block<Dim>(2.0, size), bench::soft(), 1.0);
    body.velocity.setZero(Dim, body.nodes.cols());
    for (Index a = 0; a < body.nodes.cols(); ++a) {
      const auto x = body.nodes.col(a);
      body.velocity(0, a) = speed - spin * (x[1] - 0.5) + 0.02 * std::sin(2.0 * x[0]);
      body.velocity(1, a) = 0.5 * speed + spin * (x[0] - 1.0);
    }
    Dynamics<Dim> dynamics({body}, otm<Dim>(scheme), options);
    const Momenta<Dim> before(dynamics);
    std::printf("%s, %d nodes:", name, dynamics.num_nodes());
    double worst_linear = 0.0, worst_angular = 0.0, worst_about_origin = 0.0;
    for (int k = 1; k <= 10; ++k) {
      while (dynamics.steps() < 0.1 * k * steps) dynamics.step();
      const Momenta<Dim> now(dynamics);
      worst_linear = std::max(worst_linear, distance(now.linear, before.linear) / static_cast<double>(before.size));
      worst_angular =
          std::max(worst_angular, distance(now.angular, before.angular) / static_cast<double>(before.moment));
      worst_about_origin = std::max(worst_about_origin, distance(now.about_origin, before.about_origin) /
                                                            static_cast<double>(now.moment_about_origin));
      if (k == 1 || k == 10)
        std::printf(" after %d steps linear %.2g, angular %.2g (about the origin %.2g)%s", dynamics.steps(),
                    worst_linear, worst_angular, worst_about_origin, k == 10 ? "\n" : ";");
    }
    std::printf("  %.3g reconnections a point, time %.4g, energy %.4f of that at the start\n",
                static_cast<double>(dynamics.count("reconnections")) / dynamics.num_points(), dynamics.time(),
                dynamics.balance().total() / Dynamics<Dim>({body}, otm<Dim>(scheme), options).balance().total());
    std::fflush(stdout);
  }
}

template <int Dim> void bar(double size, const OtmOptions& scheme, const DynamicsOptions& options) {
  const double begin = bench::cpu_seconds();
  const DeformableBody<Dim> body = deformable_body(bench::block<Dim>(4.0, size), bench::soft(0.0), 1.0);
  const double meshed = bench::cpu_seconds();
  const Dynamics<Dim> dynamics({body}, otm<Dim>(scheme), options);
  const double made = bench::cpu_seconds();
  const double error = bench::frequency_error(body, 4.0, scheme, options);
  std::printf("size %g, %d nodes, %d points, set up in %.3f s, first step %.4g: frequency %.4f %% off (%.2f s)\n", size,
              dynamics.num_nodes(), dynamics.num_points(), made - meshed, dynamics.stable_step(), 100.0 * error,
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
  const efree::OtmOptions scheme = efree::otm_options(keys);
  const efree::DynamicsOptions options = efree::dynamics_options(keys);
  if (argc > 2 && std::strcmp(argv[1], "hertz") == 0) {
    efree::set_num_threads(1);
    for (int i = 2; i < argc; ++i) {
      const auto n = static_cast<efree::Index>(std::atoi(argv[i]));
      if (n <= 0) continue;  // a key
      const double start = efree::bench::cpu_seconds();
      const auto answer = efree::bench::Indentation::press(n, scheme, efree::value_of(keys, "careless", 0.0), options);
      std::printf("%d cells, contact radius of %.3g spacings: force over Hertz's %.4f, energy %.2g, %d steps, %.2f s\n",
                  n, 1.0 / efree::bench::Indentation::spacing(n), answer.force, answer.energy, answer.steps,
                  efree::bench::cpu_seconds() - start);
    }
    return 0;
  }
  if (argc < 4)
    return std::puts(
               "bench_dynamics taylor|momenta|bar 2|3 SIZE [key=value ...], bench_dynamics chart [SIZE ...], "
               "bench_dynamics hertz N "
               "..."),
           2;
  const std::string what = argv[1];
  const bool in_plane = std::atoi(argv[2]) == 2;
  if (what == "bar") {
    for (int i = 3; i < argc; ++i)
      if (const double size = std::atof(argv[i]); size > 0.0)
        in_plane ? efree::bar<2>(size, scheme, options) : efree::bar<3>(size, scheme, options);
    return 0;
  }
  const double size = std::atof(argv[3]);
  if (what == "momenta") {
    const double steps = efree::value_of(keys, "steps", 1e5);
    in_plane ? efree::momenta<2>(size, steps, scheme, options) : efree::momenta<3>(size, steps, scheme, options);
  } else {
    in_plane ? efree::taylor<2>(size, keys) : efree::taylor<3>(size, keys);
  }
}
