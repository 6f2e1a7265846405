// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/cell_fields.hpp"

#include "efree/assembly/kinematics.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/core/parallel.hpp"
#include "efree/solvers/cells/internal/nodal_strains.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

namespace efree {
namespace {

using internal::GridPoints, internal::NodalStrains, internal::Place, internal::RegionShare, internal::displacement_in,
    internal::place_of;

/// Averages of a region's part in the octants of the solution's cells.
BoxAverages part_of_region(const CellSolution& solution, const LabelImage<3>& image,
                           const std::vector<Index>& region_of_label, Index region) {
  std::vector<float> inside(region_of_label.size());
  for (std::size_t label = 0; label < inside.size(); ++label) inside[label] = region_of_label[label] == region;
  const auto& n = solution.grid.cubes;
  return {image, inside, {2 * n[0], 2 * n[1], 2 * n[2]}};
}

}  // namespace

Vec<3> displacement_at(const CellSolution& solution, std::size_t level, const Vec<3>& x) {
  Lattice grid = solution.grid;
  for (int d = 0; d < 3; ++d)
    grid.cubes[d] =
        static_cast<Index>(std::lround(grid.cubes[d] * solution.grid.spacing[d] / solution.levels[level].edges[d]));
  grid.spacing = solution.levels[level].edges;
  const Points<3>& displacement = level == 0 ? solution.displacement : solution.levels[level].displacement;
  const GridPoints points{grid};
  return displacement_in(points, displacement, place_of(grid, solution.axes, x));
}

Fields<3> recover_fields(const CellSolution& solution, const LabelImage<3>& image, const FineMesh<3>& mesh,
                         const std::vector<Index>& region_of_label, const std::vector<SharedMaterial>& materials) {
  const GridPoints points{solution.grid};
  const Materials<3> by_region(materials, Plane::strain);
  std::vector<Index> region_of(mesh.num_vertices(), -1);
  for (Index c = 0; c < mesh.num_cells(); ++c)
    for (int a = 0; a < 4; ++a) region_of[mesh.cells()(a, c)] = mesh.region(c);
  Fields<3> fields;
  fields.displacement.resize(3, mesh.num_vertices());
  fields.strain.resize(6, mesh.num_vertices());
  fields.stress.resize(6, mesh.num_vertices());
  const auto& n = solution.grid.cubes;
  for (Index region = 0; region < mesh.num_regions(); ++region) {
    const RegionShare share(part_of_region(solution, image, region_of_label, region), n, 0, n[2]);
    const NodalStrains strains(solution, share, 0, n[2] + 1);
    parallel_for(mesh.num_vertices(), [&](Index v) {
      if (region_of[v] != region) return;
      const Place place = place_of(solution.grid, solution.axes, mesh.vertex(v));
      fields.displacement.col(v) = displacement_in(points, solution.displacement, place);
      fields.strain.col(v) = strains.at(place);
      Stiffness<3> room;
      fields.stress.col(v) = by_region.stiffness(region, mesh.vertex(v), room).C * fields.strain.col(v);
    });
  }
  return fields;
}

namespace {

/// What one layer of cells adds to the ranges.
struct LayerRanges {
  std::vector<PlacedRange> components = std::vector<PlacedRange>(16);
  PlacedRange displacement;
  RegionStresses stresses;
  void add(const LayerRanges& later) {
    for (std::size_t r = 0; r < components.size(); ++r) components[r].add(later.components[r]);
    displacement.add(later.displacement);
    stresses.von_mises.add(later.stresses.von_mises);
    stresses.first.add(later.stresses.first);
    stresses.third.add(later.stresses.third);
    stresses.volume += later.stresses.volume;
  }
  void add(const Vec<3>& u, const Vec<3>& at) {
    for (int d = 0; d < 3; ++d) components[d].add(u[d], at);
    displacement.add(u.norm(), at);
  }
  void add(const Voigt<3>& strain, const Voigt<3>& stress, double von_mises_stress, const Vec<3>& at) {
    for (int i = 0; i < 6; ++i) {
      components[3 + i].add(strain[i], at);
      components[9 + i].add(stress[i], at);
    }
    stresses.von_mises.add(von_mises_stress, at);
    // The principal stresses are within two thirds of the von Mises stress of the mean, and a third of it or more away.
    const double mean = stress.head<3>().mean(), third_of = von_mises_stress / 3.0,
                 rounding = 1e-12 * (std::abs(mean) + von_mises_stress);
    const auto holds = [&](const PlacedRange& range, double low, double high) {
      return range.least <= low - rounding && high + rounding <= range.most;
    };
    if (holds(stresses.first, mean + third_of, mean + 2.0 * third_of) &&
        holds(stresses.third, mean - 2.0 * third_of, mean - third_of))
      return;
    const auto [first, third] = principal(stress);
    components[15].add(first, at);
    components[15].add(third, at);
    stresses.first.add(first, at);
    stresses.third.add(third, at);
  }

 private:
  static std::pair<double, double> principal(const Voigt<3>& s) {
    Mat<3> tensor;
    tensor << s[0], s[5], s[4], s[5], s[1], s[3], s[4], s[3], s[2];
    const auto values = internal::eigenvalues<3>(tensor);
    return {values[2], values[0]};
  }
};

}  // namespace

CellFields recover_cell_fields(const CellSolution& solution, const LabelImage<3>& image,
                               const std::vector<Index>& region_of_label, const std::vector<SharedMaterial>& materials,
                               const std::vector<Vec<3>>& probes) {
  constexpr Index slab = 32;  // layers of cells whose strains are held at once
  const GridPoints points{solution.grid};
  const Materials<3> by_region(materials, Plane::strain);
  const auto& n = solution.grid.cubes;
  const auto cells = static_cast<Eigen::Index>(n[0]) * n[1] * n[2];
  CellFields fields;
  fields.solid.assign(cells, 0.0F);
  fields.region.assign(cells, -1);
  fields.strain.setZero(6, cells);
  fields.stress.setZero(6, cells);
  fields.von_mises.assign(cells, 0.0F);
  fields.ranges.resize(16);
  std::vector<float> most(cells, 0.0F);  // part of the region with the most
  fields.probes.resize(probes.size());
  const double octant = solution.grid.spacing.prod() / 8.0;
  for (Index region = 0; region < static_cast<Index>(materials.size()); ++region) {
    const BoxAverages part = part_of_region(solution, image, region_of_label, region);
    LayerRanges all;
    for (Index first = 0; first < n[2]; first += slab) {
      const Index last = std::min(first + slab, n[2]);
      const RegionShare share(part, n, std::max(first - 1, 0), std::min(last + 1, n[2]));
      const NodalStrains strains(solution, share, first, last + 1);
      std::vector<LayerRanges> layers(last - first);
      parallel_chunks(last - first, 1, [&](Index begin, Index end) {
        Stiffness<3> room;
        for (Index k = first + begin; k < first + end; ++k)
          for (Index j = 0; j < n[1]; ++j)
            for (Index i = 0; i < n[0]; ++i) {
              LayerRanges& ranges = layers[k - first];
              const auto cell = i + static_cast<Eigen::Index>(n[0]) * (j + static_cast<Eigen::Index>(n[1]) * k);
              double sum = 0.0, of_von_mises = 0.0;
              Voigt<3> mean_strain = Voigt<3>::Zero(), mean_stress = mean_strain;
              std::array<double, 8> w;
              for (int q = 0; q < 8; ++q) w[q] = share.at({i, j, k}, q);
              // In a cell that is whole once, at its centre.
              const bool whole = std::ranges::all_of(w, [](double of) { return of == 1.0; });
              for (int q = 0; q < (whole ? 1 : 8); ++q) {
                if (w[q] == 0.0) continue;
                Place place{{i, j, k}, Vec<3>::Constant(0.5)};
                if (!whole) place.t << (q & 1 ? 0.75 : 0.25), (q & 2 ? 0.75 : 0.25), (q & 4 ? 0.75 : 0.25);
                const Vec<3> x = solution.grid.origin +
                                 solution.axes * solution.grid.spacing.cwiseProduct(Vec<3>(i, j, k) + place.t);
                const Voigt<3> strain = strains.at(place), stress = by_region.stiffness(region, x, room).C * strain;
                const double von_mises_stress = von_mises<3>(stress), of = whole ? 8.0 : w[q];
                sum += of;
                mean_strain += of * strain;
                mean_stress += of * stress;
                of_von_mises += of * von_mises_stress;
                if (w[q] >= 0.5) ranges.add(strain, stress, von_mises_stress, x);
              }
              for (int q = 0; q < 8; ++q) {  // the cell's corner in the octant
                if (w[q] < 0.5) continue;
                const std::array<Index, 3> corner{i + (q & 1), j + (q >> 1 & 1), k + (q >> 2)};
                ranges.add(solution.displacement.col(points.at(corner[0], corner[1], corner[2])),
                           solution.grid.origin + solution.axes * solution.grid.spacing.cwiseProduct(
                                                                      Vec<3>(corner[0], corner[1], corner[2])));
              }
              if (sum == 0.0) continue;
              ranges.stresses.volume += octant * sum;
              // Of several regions in a cell: means over all of them, the region with the most.
              const auto of_cell = static_cast<float>(sum / 8.0), before = fields.solid[cell],
                         filled = before + of_cell;
              const auto mix = [&](float old, double value) {
                return (before * old + of_cell * static_cast<float>(value / sum)) / filled;
              };
              for (int c = 0; c < 6; ++c) {
                fields.strain(c, cell) = mix(fields.strain(c, cell), mean_strain[c]);
                fields.stress(c, cell) = mix(fields.stress(c, cell), mean_stress[c]);
              }
              fields.von_mises[cell] = mix(fields.von_mises[cell], of_von_mises);
              if (of_cell > most[cell]) {
                most[cell] = of_cell;
                fields.region[cell] = static_cast<std::int16_t>(region);
              }
              fields.solid[cell] = filled;
            }
      });
      for (const LayerRanges& layer : layers) all.add(layer);
      for (std::size_t p = 0; p < probes.size(); ++p) {
        const Place place = place_of(solution.grid, solution.axes, probes[p]);
        const Label label = label_near(image, probes[p], probe_reach);
        if (place.cell[2] < first || place.cell[2] >= last || label == 0 || label >= region_of_label.size() ||
            region_of_label[label] != region)
          continue;
        Stiffness<3> room;
        ProbeValues<3>& values = fields.probes[p];
        values.displacement = displacement_in(points, solution.displacement, place);
        values.strain = strains.at(place);
        values.stress = by_region.stiffness(region, probes[p], room).C * values.strain;
      }
    }
    for (std::size_t r = 0; r < fields.ranges.size(); ++r) fields.ranges[r].add(all.components[r]);
    fields.displacement.add(all.displacement);
    fields.regions.push_back(all.stresses);
  }
  return fields;
}

}  // namespace efree
