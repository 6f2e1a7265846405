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
#include <optional>

namespace efree {
namespace {

using internal::GridPoints, internal::NodalStrains, internal::Place, internal::RegionShare, internal::displacement_in,
    internal::octants_of, internal::place_of;

/// Averages of a region's part in the octants of the solution's cells.
BoxAverages part_of_region(const CellSolution& solution, const LabelImage<3>& image,
                           const std::vector<LabelCount>& counts, const std::vector<Index>& region_of_label,
                           Index region) {
  std::vector<float> inside(region_of_label.size());
  for (std::size_t label = 0; label < inside.size(); ++label) inside[label] = region_of_label[label] == region;
  const auto& n = solution.grid.cubes;
  return {image, counts, inside, octants_of(n)};
}

Lattice grid_of(const CellSolution& solution, std::size_t level) {
  Lattice grid = solution.grid;
  for (int d = 0; d < 3; ++d)
    grid.cubes[d] =
        static_cast<Index>(std::lround(grid.cubes[d] * solution.grid.spacing[d] / solution.levels[level].edges[d]));
  grid.spacing = solution.levels[level].edges;
  return grid;
}

}  // namespace

double largest_von_mises(const CellSolution& solution, std::size_t level, const LabelImage<3>& image,
                         const std::vector<Index>& region_of_label, const std::vector<SharedMaterial>& materials) {
  CellSolution coarser;
  coarser.grid = grid_of(solution, level);
  coarser.axes = solution.axes;
  coarser.displacement = solution.levels[level].displacement;
  coarser.mean_dilatation = solution.mean_dilatation;
  PlacedRange all;
  for (const RegionStresses& region : recover_cell_fields(coarser, image, region_of_label, materials).regions)
    all.add(region.von_mises);
  return all.most;
}

Vec<3> displacement_at(const CellSolution& solution, std::size_t level, const Vec<3>& x) {
  const Lattice grid = grid_of(solution, level);
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
  const BoxRange all{{0, 0, 0}, n};
  const std::vector<LabelCount> counts = count_labels(image);
  for (Index region = 0; region < mesh.num_regions(); ++region) {
    const RegionShare share(part_of_region(solution, image, counts, region_of_label, region), all);
    const NodalStrains strains(solution, share, all, true);
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

/// These cells and those beside them, as far as they are of a region.
BoxRange with_neighbours(const BoxRange& cells, const BoxRange& of_region) {
  BoxRange around;
  for (std::size_t d = 0; d < 3; ++d) {
    around.begin[d] = std::max(cells.begin[d] - 1, of_region.begin[d]);
    around.end[d] = std::min(cells.end[d] + 1, of_region.end[d]);
  }
  return around;
}

/// Scales the shares of all regions so that they add up to the material in each octant of these cells: each by itself
/// is bounded by a plane of its own, and where three or more meet these leave gaps or overlap.
template <class RegionAt> void normalise_shares(const BoxAverages& solid, const BoxRange& cells,
                                                const RegionAt& region_at,
                                                std::vector<std::optional<RegionShare>>& shares) {
  const BoxRange octants = octants_of(cells);
  std::vector<float> all = solid.in(octants), sum(octants.size(), 0.0F);
  const auto for_octants = [&](RegionShare& share, const auto& f) {
    const BoxRange& of = share.octants();
    parallel_chunks(of.end[2] - of.begin[2], 1, [&](Index layer, Index) {
      for (Index j = of.begin[1]; j < of.end[1]; ++j)
        for (Index i = of.begin[0]; i < of.end[0]; ++i) {
          const std::array<Index, 3> octant{i, j, of.begin[2] + layer};
          f(share.parts()[of.index(octant)], octants.index(octant));
        }
    });
  };
  for (auto& share : shares)
    if (share) for_octants(*share, [&](float part, std::size_t octant) { sum[octant] += part; });
  for (Index k = octants.begin[2]; k < octants.end[2]; ++k)
    for (Index j = octants.begin[1]; j < octants.end[1]; ++j)
      for (Index i = octants.begin[0]; i < octants.end[0]; ++i) {
        const std::size_t at = octants.index({i, j, k});
        if (sum[at] > 0.0F || all[at] == 0.0F) continue;
        const Index region = region_at({i, j, k});
        if (region < 0 || !shares[region] || !shares[region]->octants().holds({i, j, k})) continue;
        shares[region]->parts()[shares[region]->octants().index({i, j, k})] = sum[at] = all[at];
      }
  constexpr float rounding = 1e-5F;
  for (auto& share : shares)
    if (share)
      for_octants(*share, [&](float& part, std::size_t octant) {
        if (part > 0.0F && std::abs(sum[octant] - all[octant]) > rounding) part *= all[octant] / sum[octant];
        if (part > 1.0F - rounding) part = 1.0F;
      });
}

/// At a point of a region.
ProbeValues<3> probe(const CellSolution& solution, const BoxAverages& part, const Materials<3>& materials, Index region,
                     const Vec<3>& x) {
  const Place place = place_of(solution.grid, solution.axes, x);
  BoxRange cell{place.cell, place.cell};
  for (Index& end : cell.end) ++end;
  const RegionShare share(part, with_neighbours(cell, {{0, 0, 0}, solution.grid.cubes}));
  Stiffness<3> room;
  ProbeValues<3> values;
  values.displacement = displacement_in(GridPoints{solution.grid}, solution.displacement, place);
  values.strain = NodalStrains(solution, share, cell, true).at(place);
  values.stress = materials.stiffness(region, x, room).C * values.strain;
  return values;
}

/// What one region adds to the fields.
class RegionFields {
 public:
  RegionFields(const CellSolution& solution, const BoxRange& cells, Index region, const Materials<3>& materials,
               std::vector<float>& most, CellFields& fields)
      : solution_(solution),
        cells_(cells),
        region_(region),
        materials_(materials),
        most_(most),
        fields_(fields),
        points_{solution.grid} {}

  const BoxRange& cells() const { return cells_; }
  /// Of the layers of these cells; `share` has those beside them, too.
  void add(const BoxRange& cells, const RegionShare& share) {
    const NodalStrains strains(solution_, share, cells);
    std::vector<LayerRanges> layers(cells.end[2] - cells.begin[2]);
    parallel_chunks(cells.end[2] - cells.begin[2], 1, [&](Index layer, Index) {
      for (Index j = cells.begin[1]; j < cells.end[1]; ++j)
        for (Index i = cells.begin[0]; i < cells.end[0]; ++i)
          add_cell({i, j, cells.begin[2] + layer}, share, strains, layers[layer]);
    });
    for (const LayerRanges& layer : layers) ranges_.add(layer);
  }
  const LayerRanges& ranges() const { return ranges_; }

 private:
  Vec<3> place(const Vec<3>& at) const {
    return solution_.grid.origin + solution_.axes * solution_.grid.spacing.cwiseProduct(at);
  }
  void add_cell(const std::array<Index, 3>& cell, const RegionShare& share, const NodalStrains& strains,
                LayerRanges& ranges) const {
    std::array<double, 8> w;
    double filled = 0.0;
    for (int q = 0; q < 8; ++q) filled += w[q] = static_cast<double>(share.at(cell, q));
    if (filled == 0.0) return;
    const Vec<3> corner(cell[0], cell[1], cell[2]);
    Stiffness<3> room;
    Voigt<3> mean_strain = Voigt<3>::Zero(), mean_stress = mean_strain;
    double of_von_mises = 0.0;
    const auto add = [&](const Voigt<3>& strain, const Vec<3>& at, double weight, bool counts) {
      const Vec<3> x = place(corner + at);
      const Voigt<3> stress = materials_.stiffness(region_, x, room).C * strain;
      const double von_mises_stress = von_mises<3>(stress);
      mean_strain += weight * strain;
      mean_stress += weight * stress;
      of_von_mises += weight * von_mises_stress;
      if (counts) ranges.add(strain, stress, von_mises_stress, x);
    };
    if (filled == 8.0) {  // once, at its centre
      add(strains.in_middle(cell), Vec<3>::Constant(0.5), 8.0, true);
    } else {
      const Eigen::Matrix<double, 6, 8> in_octants = strains.in_octants(cell);
      for (int q = 0; q < 8; ++q)
        if (w[q] > 0.0)
          add(in_octants.col(q), Vec<3>(q & 1 ? 0.75 : 0.25, q & 2 ? 0.75 : 0.25, q & 4 ? 0.75 : 0.25), w[q],
              w[q] >= 0.5);
    }
    for (int q = 0; q < 8; ++q) {  // the cell's corner in the octant
      if (w[q] < 0.5) continue;
      const std::array<Index, 3> at{cell[0] + (q & 1), cell[1] + (q >> 1 & 1), cell[2] + (q >> 2)};
      ranges.add(solution_.displacement.col(points_.at(at[0], at[1], at[2])), place(Vec<3>(at[0], at[1], at[2])));
    }
    ranges.stresses.volume += solution_.grid.spacing.prod() / 8.0 * filled;
    mix(cell, filled, mean_strain, mean_stress, of_von_mises);
  }
  /// Of several regions in a cell: means over all of them, the region with the most.
  void mix(const std::array<Index, 3>& cell, double filled, const Voigt<3>& strain, const Voigt<3>& stress,
           double von_mises_stress) const {
    const auto& n = solution_.grid.cubes;
    const auto at = cell[0] + static_cast<Eigen::Index>(n[0]) * (cell[1] + static_cast<Eigen::Index>(n[1]) * cell[2]);
    const auto of_cell = static_cast<float>(filled / 8.0), before = fields_.solid[at], after = before + of_cell;
    const auto mean = [&](float old, double value) {
      return (before * old + of_cell * static_cast<float>(value / filled)) / after;
    };
    for (int c = 0; c < 6; ++c) {
      fields_.strain(c, at) = mean(fields_.strain(c, at), strain[c]);
      fields_.stress(c, at) = mean(fields_.stress(c, at), stress[c]);
    }
    fields_.von_mises[at] = mean(fields_.von_mises[at], von_mises_stress);
    if (of_cell > most_[at]) {
      most_[at] = of_cell;
      fields_.region[at] = static_cast<std::int16_t>(region_);
    }
    fields_.solid[at] = after;
  }

  const CellSolution& solution_;
  BoxRange cells_;
  Index region_;
  const Materials<3>& materials_;
  std::vector<float>& most_;  ///< by cell: part of the region with the most
  CellFields& fields_;
  GridPoints points_;
  LayerRanges ranges_;
};

}  // namespace

CellFields recover_cell_fields(const CellSolution& solution, const LabelImage<3>& image,
                               const std::vector<Index>& region_of_label, const std::vector<SharedMaterial>& materials,
                               const std::vector<Vec<3>>& probes) {
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
  std::vector<float> most(cells, 0.0F);
  fields.probes.resize(probes.size());
  const std::vector<LabelCount> counts = count_labels(image);
  const std::vector<BoxRange> of_region =
      boxes_of_groups(image, region_of_label, static_cast<Index>(materials.size()), n);
  std::vector<BoxAverages> parts;
  std::vector<RegionFields> regions;
  for (Index region = 0; region < static_cast<Index>(materials.size()); ++region) {
    parts.push_back(part_of_region(solution, image, counts, region_of_label, region));
    regions.emplace_back(solution, of_region[region], region, by_region, most, fields);
  }
  std::optional<BoxAverages> solid;
  if (regions.size() > 1) {
    std::vector<float> of_label(counts.back().label + 1, 1.0F);
    of_label[0] = 0.0F;
    solid.emplace(image, counts, of_label, octants_of(n));
  }
  const auto region_at = [&](const std::array<Index, 3>& octant) -> Index {
    const Vec<3> at = 0.5 * Vec<3>(octant[0] + 0.5, octant[1] + 0.5, octant[2] + 0.5);
    const Vec<3> x = solution.grid.origin + solution.axes * solution.grid.spacing.cwiseProduct(at);
    const Label label = material_near(image, x, probe_reach).label;
    return label != 0 && label < region_of_label.size() ? region_of_label[label] : -1;
  };
  constexpr Index slab = 32;  // layers of cells whose strains are held at once
  for (Index first = 0; first < n[2]; first += slab) {
    const auto within = [&](BoxRange layers) {
      layers.begin[2] = std::max(layers.begin[2], first);
      layers.end[2] = std::min({layers.end[2], first + slab, n[2]});
      return layers;
    };
    std::vector<std::optional<RegionShare>> shares(regions.size());
    for (std::size_t r = 0; r < regions.size(); ++r)
      if (const BoxRange some = within(regions[r].cells()); some.begin[2] < some.end[2])
        shares[r].emplace(parts[r], with_neighbours(some, regions[r].cells()));
    if (solid) normalise_shares(*solid, with_neighbours(within({{0, 0, 0}, n}), {{0, 0, 0}, n}), region_at, shares);
    for (std::size_t r = 0; r < regions.size(); ++r)
      if (shares[r]) regions[r].add(within(regions[r].cells()), *shares[r]);
  }
  for (const RegionFields& region : regions) {
    for (std::size_t r = 0; r < fields.ranges.size(); ++r) fields.ranges[r].add(region.ranges().components[r]);
    fields.displacement.add(region.ranges().displacement);
    fields.regions.push_back(region.ranges().stresses);
  }
  for (std::size_t p = 0; p < probes.size(); ++p)
    if (const Label label = material_near(image, probes[p], probe_reach).label;
        label != 0 && label < region_of_label.size())
      if (const Index region = region_of_label[label]; region >= 0)
        fields.probes[p] = probe(solution, parts[region], by_region, region, probes[p]);
  return fields;
}

}  // namespace efree
