// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/cell_fields.hpp"

#include "efree/assembly/kinematics.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/input/box_averages.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

namespace efree {
namespace {

/// The points of a grid as a row of columns.
struct GridPoints {
  const Lattice& grid;
  std::array<Index, 3> size{grid.cubes[0] + 1, grid.cubes[1] + 1, grid.cubes[2] + 1};
  Eigen::Index at(Index i, Index j, Index k) const {
    return i + static_cast<Eigen::Index>(size[0]) * (j + static_cast<Eigen::Index>(size[1]) * k);
  }
  Eigen::Index count() const { return at(0, 0, size[2]); }
};

/// A point's cell and where it is in it.
struct Place {
  std::array<Index, 3> cell;
  Vec<3> t;
  double weight(int corner) const {
    double w = 1.0;
    for (int d = 0; d < 3; ++d) w *= corner >> d & 1 ? t[d] : 1.0 - t[d];
    return w;
  }
};
Place place_of(const Lattice& grid, const Mat<3>& axes, const Vec<3>& x) {
  Place place;
  const Vec<3> along = axes.transpose() * (x - grid.origin);
  for (int d = 0; d < 3; ++d) {
    const double u = std::clamp(along[d] / grid.spacing[d], 0.0, static_cast<double>(grid.cubes[d]));
    place.cell[d] = std::min(static_cast<Index>(u), grid.cubes[d] - 1);
    place.t[d] = u - place.cell[d];
  }
  return place;
}

/// Gradient of the displacement on the grid, du_c / dx_d, in the world's axes.
Mat<3> slope_at(const CellSolution& solution, const GridPoints& points, const Place& place) {
  Mat<3> slope = Mat<3>::Zero();
  for (int a = 0; a < 8; ++a) {
    const auto u = solution.displacement.col(
        points.at(place.cell[0] + (a & 1), place.cell[1] + (a >> 1 & 1), place.cell[2] + (a >> 2)));
    for (int d = 0; d < 3; ++d) {
      double w = (a >> d & 1 ? 1.0 : -1.0) / points.grid.spacing[d];
      for (int e = 0; e < 3; ++e)
        if (e != d) w *= a >> e & 1 ? place.t[e] : 1.0 - place.t[e];
      slope.col(d) += w * u;
    }
  }
  return slope * solution.axes.transpose();
}

/// Strains at the eight points of the cells of a layer (6 x 8 cells), each cell's points together.
void strains_of_layer(const CellSolution& solution, Index k, Matrix& strains) {
  const GridPoints points{solution.grid};
  const auto& n = solution.grid.cubes;
  const bool turned = !solution.axes.isIdentity(0.0);
  strains.resize(6, static_cast<Eigen::Index>(8) * n[0] * n[1]);
  Eigen::Index column = 0;
  for (Index j = 0; j < n[1]; ++j)
    for (Index i = 0; i < n[0]; ++i) {
      Eigen::Matrix<double, 3, 8> u;
      for (int a = 0; a < 8; ++a)
        u.col(a) = solution.displacement.col(points.at(i + (a & 1), j + (a >> 1 & 1), k + (a >> 2)));
      for (int q = 0; q < 8; ++q, ++column) {
        Mat<3> slope = Mat<3>::Zero();  // du_c / dx_d
        for (int a = 0; a < 8; ++a)
          for (int d = 0; d < 3; ++d) {
            double w = (a >> d & 1 ? 1.0 : -1.0) / solution.grid.spacing[d];
            for (int e = 0; e < 3; ++e)
              if (e != d) w *= (a >> e & 1) == (q >> e & 1) ? 0.75 : 0.25;
            slope.col(d) += w * u.col(a);
          }
        strains.col(column) = strain_of<3>((turned ? Mat<3>(slope * solution.axes.transpose()) : slope).reshaped());
      }
    }
}

/// Strains at the points of the grid from those at the points of the cells around, weighted with how much of a region
/// is there: linear fits, means where there is too little for one. Without any of the region: not a number.
Matrix nodal_strains(const CellSolution& solution, const std::vector<float>& part) {
  const GridPoints points{solution.grid};
  const auto& n = solution.grid.cubes;
  const std::size_t along = 2 * static_cast<std::size_t>(n[0]), plane = along * 2 * n[1];
  Matrix result(6, points.count());
  parallel_chunks(points.size[2], 8, [&](Index begin, Index end) {
    std::array<Matrix, 2> layers;  // below and above the points
    if (begin > 0) strains_of_layer(solution, begin - 1, layers[1]);
    for (Index k = begin; k < end; ++k) {
      std::swap(layers[0], layers[1]);
      if (k < n[2]) strains_of_layer(solution, k, layers[1]);
      for (Index j = 0; j < points.size[1]; ++j)
        for (Index i = 0; i < points.size[0]; ++i) {
          Eigen::Matrix4d moments = Eigen::Matrix4d::Zero();
          Eigen::Matrix<double, 4, 6> sums = Eigen::Matrix<double, 4, 6>::Zero();
          for (int c = 0; c < 8; ++c) {
            const Index x = i - 1 + (c & 1), y = j - 1 + (c >> 1 & 1), z = k - 1 + (c >> 2);
            if (x < 0 || y < 0 || z < 0 || x >= n[0] || y >= n[1] || z >= n[2]) continue;
            const auto cell = x + static_cast<Eigen::Index>(n[0]) * y;
            for (int q = 0; q < 8; ++q) {
              const double w = part[2 * x + (q & 1) + along * (2 * y + (q >> 1 & 1)) + plane * (2 * z + (q >> 2))];
              if (w == 0.0) continue;
              Eigen::Vector4d p(1.0, x + (q & 1 ? 0.75 : 0.25) - i, y + (q & 2 ? 0.75 : 0.25) - j,
                                z + (q & 4 ? 0.75 : 0.25) - k);
              moments.noalias() += w * p * p.transpose();
              sums.noalias() += w * p * layers[c >> 2].col(8 * cell + q).transpose();
            }
          }
          auto strain = result.col(points.at(i, j, k));
          if (moments(0, 0) == 0.0) {
            strain.setConstant(std::numeric_limits<double>::quiet_NaN());
            continue;
          }
          // Slopes are held back where points are few or on one side.
          for (int d = 1; d < 4; ++d) moments(d, d) += 0.005 * moments(0, 0);
          strain = moments.ldlt().solve(sums).row(0).transpose();
        }
    }
  });
  return result;
}

/// Nodal strains at a place in a cell: a point without material still has a strain if another corner has one.
Voigt<3> strain_at(const GridPoints& points, const Matrix& strains, const Place& place) {
  Voigt<3> strain = Voigt<3>::Zero();
  double all = 0.0;
  for (int a = 0; a < 8; ++a) {
    const Eigen::Index at = points.at(place.cell[0] + (a & 1), place.cell[1] + (a >> 1 & 1), place.cell[2] + (a >> 2));
    if (!std::isfinite(strains(0, at))) continue;
    const double w = place.weight(a) + 1e-9;
    strain += w * strains.col(at);
    all += w;
  }
  return all > 0.0 ? Voigt<3>(strain / all) : strain;
}

Vec<3> displacement_in(const GridPoints& points, const Points<3>& displacement, const Place& place) {
  Vec<3> u = Vec<3>::Zero();
  for (int a = 0; a < 8; ++a)
    u += place.weight(a) *
         displacement.col(points.at(place.cell[0] + (a & 1), place.cell[1] + (a >> 1 & 1), place.cell[2] + (a >> 2)));
  return u;
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

Vector recovery_errors(const CellSolution& solution, const Fields<3>& fields, const FineMesh<3>& mesh,
                       const std::vector<SharedMaterial>& materials) {
  const GridPoints points{solution.grid};
  const Materials<3> by_region(materials, Plane::strain);
  Vector errors(mesh.num_cells());
  parallel_for(mesh.num_cells(), [&](Index c) {
    const Voigt<3> strain =
        strain_of<3>(slope_at(solution, points, place_of(solution.grid, solution.axes, mesh.centroid(c))).reshaped());
    Stiffness<3> room;
    const auto& stiffness = by_region.stiffness(mesh.region(c), mesh.centroid(c), room);
    Voigt<3> difference = -stiffness.C * strain;
    for (int a = 0; a < 4; ++a) difference += 0.25 * fields.stress.col(mesh.cells()(a, c));
    errors[c] = mesh.volume(c) * difference.dot(stiffness.S * difference);
  });
  return errors;
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
    std::vector<float> inside(region_of_label.size());
    for (std::size_t label = 0; label < inside.size(); ++label) inside[label] = region_of_label[label] == region;
    const Matrix strains = nodal_strains(solution, box_averages(image, inside, {2 * n[0], 2 * n[1], 2 * n[2]}));
    parallel_for(mesh.num_vertices(), [&](Index v) {
      if (region_of[v] != region) return;
      const Place place = place_of(solution.grid, solution.axes, mesh.vertex(v));
      fields.displacement.col(v) = displacement_in(points, solution.displacement, place);
      fields.strain.col(v) = strain_at(points, strains, place);
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
    const auto [first, third] = principal(stress);
    components[15].add(first, at);
    components[15].add(third, at);
    stresses.von_mises.add(von_mises_stress, at);
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
  const std::size_t along = 2 * static_cast<std::size_t>(n[0]), plane = along * 2 * n[1];
  for (Index region = 0; region < static_cast<Index>(materials.size()); ++region) {
    std::vector<float> inside(region_of_label.size());
    for (std::size_t label = 0; label < inside.size(); ++label) inside[label] = region_of_label[label] == region;
    const std::vector<float> part = box_averages(image, inside, {2 * n[0], 2 * n[1], 2 * n[2]});
    const Matrix strains = nodal_strains(solution, part);
    std::vector<LayerRanges> layers(n[2]);
    parallel_chunks(n[2], 1, [&](Index begin, Index end) {
      Stiffness<3> room;
      for (Index k = begin; k < end; ++k)
        for (Index j = 0; j < n[1]; ++j)
          for (Index i = 0; i < n[0]; ++i) {
            const auto cell = i + static_cast<Eigen::Index>(n[0]) * (j + static_cast<Eigen::Index>(n[1]) * k);
            double sum = 0.0, of_von_mises = 0.0;
            Voigt<3> mean_strain = Voigt<3>::Zero(), mean_stress = mean_strain;
            std::array<double, 8> w;
            for (int q = 0; q < 8; ++q)
              w[q] = part[2 * i + (q & 1) + along * (2 * j + (q >> 1 & 1)) + plane * (2 * k + (q >> 2))];
            // In a cell that is whole once, at its centre.
            const bool whole = std::ranges::all_of(w, [](double of) { return of == 1.0; });
            for (int q = 0; q < (whole ? 1 : 8); ++q) {
              if (w[q] == 0.0) continue;
              Place place{{i, j, k}, Vec<3>::Constant(0.5)};
              if (!whole) place.t << (q & 1 ? 0.75 : 0.25), (q & 2 ? 0.75 : 0.25), (q & 4 ? 0.75 : 0.25);
              const Vec<3> x =
                  solution.grid.origin + solution.axes * solution.grid.spacing.cwiseProduct(Vec<3>(i, j, k) + place.t);
              const Voigt<3> strain = strain_at(points, strains, place),
                             stress = by_region.stiffness(region, x, room).C * strain;
              const double von_mises_stress = von_mises<3>(stress), share = whole ? 8.0 : w[q];
              sum += share;
              mean_strain += share * strain;
              mean_stress += share * stress;
              of_von_mises += share * von_mises_stress;
              if (w[q] >= 0.5) layers[k].add(strain, stress, von_mises_stress, x);
            }
            for (int q = 0; q < 8; ++q) {  // the cell's corner in the octant
              if (w[q] < 0.5) continue;
              const std::array<Index, 3> corner{i + (q & 1), j + (q >> 1 & 1), k + (q >> 2)};
              layers[k].add(solution.displacement.col(points.at(corner[0], corner[1], corner[2])),
                            solution.grid.origin + solution.axes * solution.grid.spacing.cwiseProduct(
                                                                       Vec<3>(corner[0], corner[1], corner[2])));
            }
            if (sum == 0.0) continue;
            layers[k].stresses.volume += octant * sum;
            // Of several regions in a cell: means over all of them, the region with the most.
            const auto share = static_cast<float>(sum / 8.0), before = fields.solid[cell], all = before + share;
            const auto mix = [&](float old, double value) {
              return (before * old + share * static_cast<float>(value / sum)) / all;
            };
            for (int c = 0; c < 6; ++c) {
              fields.strain(c, cell) = mix(fields.strain(c, cell), mean_strain[c]);
              fields.stress(c, cell) = mix(fields.stress(c, cell), mean_stress[c]);
            }
            fields.von_mises[cell] = mix(fields.von_mises[cell], of_von_mises);
            if (share > most[cell]) {
              most[cell] = share;
              fields.region[cell] = static_cast<std::int16_t>(region);
            }
            fields.solid[cell] = all;
          }
    });
    LayerRanges all;
    for (const LayerRanges& layer : layers) all.add(layer);
    for (std::size_t r = 0; r < fields.ranges.size(); ++r) fields.ranges[r].add(all.components[r]);
    fields.displacement.add(all.displacement);
    fields.regions.push_back(all.stresses);
    for (std::size_t p = 0; p < probes.size(); ++p) {
      const Label label = label_near(image, probes[p], probe_reach);
      if (label == 0 || label >= region_of_label.size() || region_of_label[label] != region) continue;
      const Place place = place_of(solution.grid, solution.axes, probes[p]);
      Stiffness<3> room;
      ProbeValues<3>& values = fields.probes[p];
      values.displacement = displacement_in(points, solution.displacement, place);
      values.strain = strain_at(points, strains, place);
      values.stress = by_region.stiffness(region, probes[p], room).C * values.strain;
    }
  }
  return fields;
}

}  // namespace efree
