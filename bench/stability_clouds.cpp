// SPDX-License-Identifier: GPL-3.0-or-later
// Bad triangulations and random clouds: how far results spread.
#include "bad_meshes.hpp"
#include "cook.hpp"
#include "stability.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <numeric>

namespace efree::bench {
namespace {

struct Case {
  std::string name;
  PlanarDomain domain;
  double spacing;
  Settings<2> settings;
};

std::vector<Case> cases() {
  constexpr double spacing = 0.25;
  Settings<2> plate{.common = {.model = {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress}},
                    .supports = {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
                    .loads = {.tractions = {tension<2>("right", 1.0)}},
                    .probes = {{"hole", {1.0, 0.0}}}};
  return {{"plate with a hole, displacement of the hole", shapes::quarter_plate_with_hole(1.0, 4.0, spacing / 6.0),
           spacing, plate},
          {"Cook, nu = 0.3, tip", shapes::cook(), 3.2, Cook{0.3}.settings()},
          {"Cook, nu = 0.4999, tip", shapes::cook(), 3.2, Cook{0.4999}.settings()},
          {"Cook, rubber, nu = 0.4999, tip", shapes::cook(), 3.2, Cook{0.4999, true}.settings()}};
}

}  // namespace

void random_clouds(const StudyOf& study) {
  Table table(study.folder, "clouds", {"case", "answer", "mesh", "cloud", "value", "energy"});
  const std::vector<std::string> meshes{"regular", "jittered", "slivers", "needles"};
  struct Summary {
    std::string what;
    std::vector<double> values, energies;
  };
  std::vector<Summary> summaries;
  for (const Case& one : cases())
    for (const bool corrected : {true, false}) {
      Summary& summary = summaries.emplace_back();
      summary.what = one.name + (corrected ? ": efree" : ": cloud alone");
      for (const std::string& how : meshes) {
        const FineMesh<2> mesh = careless(how, one.domain, one.spacing / 6.0);
        for (int seed = 1; seed <= study.seeds; ++seed) {
          Settings<2> settings = one.settings;
          settings.common.approximation = {.spacing = one.spacing, .seed = static_cast<std::uint64_t>(seed)};
          if (!corrected) settings.estimated = settings.corrected = false;
          const Result<2> result = analyse(mesh, settings);
          const Vec<2> u = result.probes.at(0).second.displacement;
          summary.values.push_back(one.name.starts_with("Cook") ? u.y() : u.x());
          summary.energies.push_back(result.solution.strain_energy);
          table.row({one.name, corrected ? "efree" : "cloud alone", how, fmt::format("{}", seed),
                     fmt::format("{:.5f}", summary.values.back()), fmt::format("{:.5f}", summary.energies.back())});
        }
      }
    }
  std::printf("\nSpread over the clouds, per cent of the mean: largest less smallest, and farthest from the mean\n\n");
  Table spread(study.folder, "clouds_spread",
               {"what", "mesh", "runs", "displacement", "farthest", "energy", "energy farthest"});
  const auto add = [&](const std::string& what, const std::string& mesh, const std::vector<double>& values,
                       const std::vector<double>& energies) {
    std::vector<std::string> cells{what, mesh, fmt::format("{}", values.size())};
    for (const auto& of : {values, energies}) {
      const auto [least, most] = std::ranges::minmax(of);
      const double mean = std::accumulate(of.begin(), of.end(), 0.0) / static_cast<double>(of.size());
      cells.push_back(fmt::format("{:.2f}", 100.0 * (most - least) / mean));
      cells.push_back(fmt::format("{:.2f}", 100.0 * std::max(most - mean, mean - least) / mean));
    }
    spread.row(cells);
  };
  for (const Summary& summary : summaries) {
    const std::string& what = summary.what;
    for (std::size_t k = 0; k < meshes.size(); ++k) {
      const auto part = [&](const std::vector<double>& all) {
        const auto begin = all.begin() + static_cast<std::ptrdiff_t>(k) * study.seeds;
        return std::vector<double>(begin, begin + study.seeds);
      };
      add(what, meshes[k], part(summary.values), part(summary.energies));
    }
    add(what, "all", summary.values, summary.energies);
  }
}

}  // namespace efree::bench
