// SPDX-License-Identifier: GPL-3.0-or-later
// Slits, thin ligaments, re-entrant corners: functions that leak, stress intensities.
#include "edge_crack.hpp"
#include "stability.hpp"

#include <fmt/format.h>

namespace efree::bench {

void crack(const StudyOf& study) {
  const auto seed_of = [](int seed) { return static_cast<std::uint64_t>(seed); };
  std::printf("Stress intensity of an edge crack against the handbook, J around the tip between 0.1 and 0.3\n\n");
  Table intensity(study.folder, "crack", {"a", "method", "a/H", "cloud", "nodes", "K", "error %"});
  for (const double a : {0.3, 0.5}) {
    const EdgeCrack plate{a};
    const auto add = [&](const char* method, int per_length, int seed, const FineMesh<2>& mesh,
                         const Settings<2>& settings) {
      const Result<2> result = analyse(mesh, settings);
      const double K = plate.stress_intensity(result, 0.1, 0.3 * std::min(1.0, a / 0.3));
      intensity.row({fmt::format("{}", a), method, fmt::format("{}", per_length), fmt::format("{}", seed),
                     fmt::format("{}", result.approximation.nodes.cols()), fmt::format("{:.4f}", K),
                     fmt::format("{:.2f}", 100.0 * (K / plate.handbook() - 1.0))});
    };
    for (const int per_length : {3, 5, 8, 12}) {
      const double H = a / per_length;
      const FineMesh<2> mesh = plate.mesh(H / 6.0);
      for (int seed = 1; seed <= study.seeds; ++seed) {
        Settings<2> settings = plate.settings(H, seed_of(seed));
        add("efree", per_length, seed, mesh, settings);
        settings.estimated = settings.corrected = false;
        add("cloud alone", per_length, seed, mesh, settings);
      }
      for (const bool quadratic : {false, true}) {
        Settings<2> settings = plate.settings(H);
        settings.common.approximation = {.kind = quadratic ? BasisKind::p2 : BasisKind::p1};
        add(quadratic ? "P2" : "P1", per_length, 1, plate.mesh((quadratic ? 2.9 : 1.45) * H), settings);
      }
    }
  }

  std::printf("\nFunctions that reach where no way shorter than their support leads\n\n");
  Table leaks(study.folder, "leaks",
              {"body", "H", "cloud", "pairs out of sight", "leaks", "largest", "supports grown"});
  const auto add = [&](const char* body, double H, int seed, const Approximation<2>& approximation, const Leak& leak) {
    leaks.row({body, fmt::format("{}", H), fmt::format("{}", seed), fmt::format("{}", leak.checked),
               fmt::format("{}", leak.pairs), fmt::format("{:.1e}", leak.largest),
               fmt::format("{}", approximation.mls.grown_nodes)});
  };
  for (const double H : {0.1, 0.05})
    for (int seed = 1; seed <= study.seeds; ++seed) {
      const ApproximationOptions options{.spacing = H, .seed = seed_of(seed)};
      const double support = (1.0 + 1e-12) * 2.5 * H;
      const EdgeCrack plate{0.5};
      const auto cracked = approximate(plate.mesh(H / 6.0), options);
      add("edge crack", H, seed, cracked, Leak(cracked, support, CutAlongAxis(cracked.space, plate.length, 2.0)));
      const Ligament thin{0.4 * H};
      const auto ligament = approximate(thin.mesh(H / 6.0), options);
      add("ligament of 0.4 H", H, seed, ligament,
          Leak(ligament, support, CutAlongAxis(ligament.space, thin.left(), thin.right())));
      const auto corner = approximate(triangulate(shapes::l_shape(1.0), {.size = H / 6.0}), options);
      add("re-entrant corner", H, seed, corner, Leak(corner, support, NotchOfL{corner.space}));
    }

  std::printf("\nStrain energy of two plates that hang together by a ligament of 0.04\n\n");
  Table energy(study.folder, "ligament", {"method", "H or h", "cloud", "nodes", "energy"});
  const Ligament thin;
  for (const double h : {0.02, 0.01, 0.005}) {
    Settings<2> settings = thin.settings();
    settings.common.approximation = {.kind = BasisKind::p2};
    const Result<2> result = analyse(thin.mesh(h), settings);
    energy.row({"P2", fmt::format("{}", h), "1", fmt::format("{}", result.approximation.nodes.cols()),
                fmt::format("{:.4f}", result.solution.strain_energy)});
  }
  for (const double H : {0.1, 0.05})
    for (int seed = 1; seed <= study.seeds; ++seed)
      for (const bool corrected : {true, false}) {
        Settings<2> settings = thin.settings();
        settings.common.approximation = {.spacing = H, .seed = seed_of(seed)};
        if (!corrected) settings.estimated = settings.corrected = false;
        const Result<2> result = analyse(thin.mesh(H / 6.0), settings);
        energy.row({corrected ? "efree" : "cloud alone", fmt::format("{}", H), fmt::format("{}", seed),
                    fmt::format("{}", result.approximation.nodes.cols()),
                    fmt::format("{:.4f}", result.solution.strain_energy)});
      }
}

}  // namespace efree::bench
