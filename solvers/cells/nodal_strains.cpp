// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/nodal_strains.hpp"

#include "efree/assembly/kinematics.hpp"
#include "efree/core/parallel.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <limits>
#include <utility>

namespace efree::internal {
namespace {

/// Sums over the octants of a cell that a linear fit needs, weighted with how much of a region is in them; places p =
/// (1, x, y, z) from a point, in edges of cells.
struct FitSums {
  Eigen::Matrix4d moments = Eigen::Matrix4d::Zero();                          ///< of p p^T; the lower triangle
  Eigen::Matrix<double, 4, 6> strains = Eigen::Matrix<double, 4, 6>::Zero();  ///< of p strain^T

  /// Adds those of a cell, whose middle is its origin, `to` from here.
  void add(const FitSums& cell, const Eigen::Vector3d& to) {
    const double all = cell.moments(0, 0);
    moments(0, 0) += all;
    strains.row(0) += cell.strains.row(0);
    for (int d = 0; d < 3; ++d) {
      moments(1 + d, 0) += cell.moments(1 + d, 0) + all * to[d];
      strains.row(1 + d) += cell.strains.row(1 + d) + to[d] * cell.strains.row(0);
      for (int e = 0; e <= d; ++e)
        moments(1 + d, 1 + e) += cell.moments(1 + d, 1 + e) + to[d] * cell.moments(1 + e, 0) +
                                 to[e] * cell.moments(1 + d, 0) + all * to[d] * to[e];
    }
  }
  /// The fit's value at the origin.
  Voigt<3> value() const {
    if (moments(0, 0) == 0.0) return Voigt<3>::Constant(std::numeric_limits<double>::quiet_NaN());
    Eigen::Matrix4d held = moments;
    // Slopes are held back where points are few or on one side.
    for (int d = 1; d < 4; ++d) held(d, d) += 0.005 * held(0, 0);
    return held.ldlt().solve(strains).row(0).transpose();
  }
};

/// Strains in the cells of a layer, found when they are first asked for.
class LayerStrains {
 public:
  LayerStrains(const CellStrains& strain, bool mean_dilatation, const RegionShare& share)
      : strain_(strain), mean_dilatation_(mean_dilatation), share_(share) {
    layer_ = share.cells();
    layer_.end[2] = layer_.begin[2] + 1;
  }
  void start(Index layer) {
    layer_.begin[2] = layer;
    layer_.end[2] = layer + 1;
    has_sums_.assign(layer_.size(), 0);
    has_middle_.assign(layer_.size(), 0);
    sums_.resize(layer_.size());
    middles_.resize(6, static_cast<Eigen::Index>(layer_.size()));
  }
  /// In the middle of a cell.
  auto middle_of(Index i, Index j) {
    const std::array<Index, 3> cell{i, j, layer_.begin[2]};
    const std::size_t at = layer_.index(cell);
    auto middle = middles_.col(static_cast<Eigen::Index>(at));
    if (!std::exchange(has_middle_[at], 1)) middle = strain_.strain(strain_.displacements(cell), CellStrains::middle);
    return middle;
  }
  const FitSums& sums_of(Index i, Index j) {
    const std::array<Index, 3> cell{i, j, layer_.begin[2]};
    const std::size_t at = layer_.index(cell);
    FitSums& sums = sums_[at];
    if (std::exchange(has_sums_[at], 1)) return sums;
    sums = {};
    const Eigen::Matrix<double, 3, 8> u = strain_.displacements(cell);
    std::array<Voigt<3>, 8> strains;
    double dilatation = 0.0, all = 0.0;
    for (int q = 0; q < 8; ++q) {
      const auto w = static_cast<double>(share_.at(cell, q));
      if (w == 0.0) continue;
      strains[q] = strain_.strain(u, q);
      dilatation += w * strains[q].head<3>().sum();
      all += w;
    }
    for (int q = 0; q < 8; ++q) {
      const auto w = static_cast<double>(share_.at(cell, q));
      if (w == 0.0) continue;
      if (mean_dilatation_) strains[q].head<3>().array() += (dilatation / all - strains[q].head<3>().sum()) / 3.0;
      const Eigen::Vector4d p(1.0, q & 1 ? 0.25 : -0.25, q & 2 ? 0.25 : -0.25, q & 4 ? 0.25 : -0.25);
      sums.moments += w * p * p.transpose();
      sums.strains += w * p * strains[q].transpose();
    }
    return sums;
  }

 private:
  const CellStrains& strain_;
  bool mean_dilatation_;
  const RegionShare& share_;
  BoxRange layer_;
  std::vector<char> has_sums_, has_middle_;
  std::vector<FitSums> sums_;
  Matrix middles_;
};

/// Weights of a cell's corners in the middles of its octants.
Eigen::Matrix<double, 8, 8> octant_weights() {
  Eigen::Matrix<double, 8, 8> weights;
  for (int q = 0; q < 8; ++q)
    for (int a = 0; a < 8; ++a) {
      weights(a, q) = 1.0;
      for (int d = 0; d < 3; ++d) weights(a, q) *= (a >> d & 1) == (q >> d & 1) ? 0.75 : 0.25;
    }
  return weights;
}

}  // namespace

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

Vec<3> displacement_in(const GridPoints& points, const Points<3>& displacement, const Place& place) {
  Vec<3> u = Vec<3>::Zero();
  for (int a = 0; a < 8; ++a)
    u += place.weight(a) *
         displacement.col(points.at(place.cell[0] + (a & 1), place.cell[1] + (a >> 1 & 1), place.cell[2] + (a >> 2)));
  return u;
}

CellStrains::CellStrains(const CellSolution& solution)
    : solution_(solution), points_{solution.grid}, turned_(!solution.axes.isIdentity(0.0)) {
  for (int q = 0; q <= middle; ++q)
    for (int a = 0; a < 8; ++a)
      for (int d = 0; d < 3; ++d) {
        double slope = (a >> d & 1 ? 1.0 : -1.0) / solution.grid.spacing[d];
        for (int e = 0; e < 3; ++e)
          if (e != d) slope *= q == middle ? 0.5 : (a >> e & 1) == (q >> e & 1) ? 0.75 : 0.25;
        slopes_[q](a, d) = slope;
      }
}
Eigen::Matrix<double, 3, 8> CellStrains::displacements(const std::array<Index, 3>& cell) const {
  Eigen::Matrix<double, 3, 8> u;
  for (int a = 0; a < 8; ++a)
    u.col(a) = solution_.displacement.col(points_.at(cell[0] + (a & 1), cell[1] + (a >> 1 & 1), cell[2] + (a >> 2)));
  return u;
}
Voigt<3> CellStrains::strain(const Eigen::Matrix<double, 3, 8>& displacements, int q) const {
  Mat<3> slope = displacements * slopes_[q];  // du_c / dx_d
  if (turned_) slope *= solution_.axes.transpose();
  return strain_of<3>(slope.reshaped());
}

NodalStrains::NodalStrains(const CellSolution& solution, const RegionShare& share, const BoxRange& cells,
                           bool everywhere)
    : strain_(solution), cells_(cells), points_(cells), deep_(cells.size(), 0) {
  for (int d = 0; d < 3; ++d) ++points_.end[d];
  strains_.resize(6, static_cast<Eigen::Index>(points_.size()));
  find_deep(share);
  const auto is_needed = [&](const std::array<Index, 3>& point) {
    if (everywhere) return true;
    for (int c = 0; c < 8; ++c) {
      const std::array<Index, 3> cell{point[0] - 1 + (c & 1), point[1] - 1 + (c >> 1 & 1), point[2] - 1 + (c >> 2)};
      if (cells_.holds(cell) && !is_deep(cell)) return true;
    }
    return false;
  };
  const BoxRange& known = share.cells();
  parallel_chunks(points_.end[2] - points_.begin[2], 8, [&](Index begin, Index end) {
    LayerStrains one(strain_, solution.mean_dilatation, share), other(strain_, solution.mean_dilatation, share);
    std::array<LayerStrains*, 2> layers{&one, &other};  // below and above the points
    const auto start = [&](int side, Index layer) {
      if (layer >= known.begin[2] && layer < known.end[2]) layers[side]->start(layer);
    };
    start(1, points_.begin[2] + begin - 1);
    for (Index k = points_.begin[2] + begin; k < points_.begin[2] + end; ++k) {
      std::swap(layers[0], layers[1]);
      start(1, k);
      for (Index j = points_.begin[1]; j < points_.end[1]; ++j)
        for (Index i = points_.begin[0]; i < points_.end[0]; ++i) {
          if (!is_needed({i, j, k})) continue;
          int cells_around = 0, whole_cells = 0;
          std::array<std::array<Index, 3>, 8> around;
          for (int c = 0; c < 8; ++c) {
            const std::array<Index, 3> cell{i - 1 + (c & 1), j - 1 + (c >> 1 & 1), k - 1 + (c >> 2)};
            if (!known.holds(cell)) continue;
            around[cells_around++] = cell;
            whole_cells += share.is_whole(cell);
          }
          auto strain = strains_.col(static_cast<Eigen::Index>(points_.index({i, j, k})));
          if (whole_cells == 8) {  // the fit is the mean
            strain.setZero();
            for (const auto& cell : around) strain += 0.125 * layers[cell[2] - k + 1]->middle_of(cell[0], cell[1]);
            continue;
          }
          FitSums fit;
          for (int c = 0; c < cells_around; ++c) {
            const auto& [x, y, z] = around[c];
            const FitSums& sums = layers[z - k + 1]->sums_of(x, y);
            if (sums.moments(0, 0) > 0.0) fit.add(sums, Vec<3>(x + 0.5 - i, y + 0.5 - j, z + 0.5 - k));
          }
          strain = fit.value();
        }
    }
  });
}

void NodalStrains::find_deep(const RegionShare& share) {
  const BoxRange& known = share.cells();
  std::vector<char> whole(known.size());
  parallel_chunks(known.end[2] - known.begin[2], 1, [&](Index layer, Index) {
    const Index k = known.begin[2] + layer;
    for (Index j = known.begin[1]; j < known.end[1]; ++j)
      for (Index i = known.begin[0]; i < known.end[0]; ++i) whole[known.index({i, j, k})] = share.is_whole({i, j, k});
  });
  parallel_chunks(cells_.end[2] - cells_.begin[2], 1, [&](Index layer, Index) {
    const Index k = cells_.begin[2] + layer;
    for (Index j = cells_.begin[1]; j < cells_.end[1]; ++j)
      for (Index i = cells_.begin[0]; i < cells_.end[0]; ++i) {
        bool all = known.holds({i - 1, j - 1, k - 1}) && known.holds({i + 1, j + 1, k + 1});
        for (int n = 0; n < 27 && all; ++n)
          all = whole[known.index({i - 1 + n % 3, j - 1 + n / 3 % 3, k - 1 + n / 9})] != 0;
        deep_[cells_.index({i, j, k})] = static_cast<char>(all);
      }
  });
}

Voigt<3> NodalStrains::in_middle(const std::array<Index, 3>& cell) const {
  if (is_deep(cell)) return strain_.strain(strain_.displacements(cell), CellStrains::middle);
  Voigt<3> strain = Voigt<3>::Zero();
  for (int a = 0; a < 8; ++a)
    strain += 0.125 * strains_.col(static_cast<Eigen::Index>(
                          points_.index({cell[0] + (a & 1), cell[1] + (a >> 1 & 1), cell[2] + (a >> 2)})));
  return strain;
}

Eigen::Matrix<double, 6, 8> NodalStrains::in_octants(const std::array<Index, 3>& cell) const {
  static const Eigen::Matrix<double, 8, 8> weights = octant_weights();
  Eigen::Matrix<double, 6, 8> corners;
  Eigen::Matrix<double, 1, 8> known;
  for (int a = 0; a < 8; ++a) {
    corners.col(a) = strains_.col(
        static_cast<Eigen::Index>(points_.index({cell[0] + (a & 1), cell[1] + (a >> 1 & 1), cell[2] + (a >> 2)})));
    known[a] = std::isfinite(corners(0, a)) ? 1.0 : 0.0;
    if (known[a] == 0.0) corners.col(a).setZero();
  }
  Eigen::Matrix<double, 6, 8> strains = corners * weights;
  if (known.sum() < 8.0) {
    const Eigen::Matrix<double, 1, 8> all = known * weights;
    for (int q = 0; q < 8; ++q)
      if (all[q] > 0.0) strains.col(q) /= all[q];
  }
  return strains;
}

Voigt<3> NodalStrains::at(const Place& place) const {
  Voigt<3> strain = Voigt<3>::Zero();
  double all = 0.0;
  for (int a = 0; a < 8; ++a) {
    const auto at = static_cast<Eigen::Index>(
        points_.index({place.cell[0] + (a & 1), place.cell[1] + (a >> 1 & 1), place.cell[2] + (a >> 2)}));
    if (!std::isfinite(strains_(0, at))) continue;
    const double w = place.weight(a) + 1e-9;
    strain += w * strains_.col(at);
    all += w;
  }
  return all > 0.0 ? Voigt<3>(strain / all) : strain;
}

}  // namespace efree::internal
