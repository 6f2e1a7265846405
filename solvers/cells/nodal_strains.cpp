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
  LayerStrains(const CellSolution& solution, const RegionShare& share)
      : solution_(solution),
        share_(share),
        points_{solution.grid},
        n_(solution.grid.cubes),
        turned_(!solution.axes.isIdentity(0.0)) {
    for (int q = 0; q <= middle; ++q)
      for (int a = 0; a < 8; ++a)
        for (int d = 0; d < 3; ++d) {
          double slope = (a >> d & 1 ? 1.0 : -1.0) / solution.grid.spacing[d];
          for (int e = 0; e < 3; ++e)
            if (e != d) slope *= q == middle ? 0.5 : (a >> e & 1) == (q >> e & 1) ? 0.75 : 0.25;
          slopes_[q](a, d) = slope;
        }
  }
  void start(Index layer) {
    layer_ = layer;
    const auto cells = static_cast<std::size_t>(n_[0]) * n_[1];
    has_sums_.assign(cells, 0);
    has_middle_.assign(cells, 0);
    sums_.resize(cells);
    middles_.resize(6, static_cast<Eigen::Index>(cells));
  }
  /// In the middle of a cell.
  auto middle_of(Index i, Index j) {
    const auto cell = i + static_cast<Eigen::Index>(n_[0]) * j;
    if (!std::exchange(has_middle_[cell], 1)) middles_.col(cell) = strain(displacements(i, j), middle);
    return middles_.col(cell);
  }
  const FitSums& sums_of(Index i, Index j) {
    const auto cell = i + static_cast<std::size_t>(n_[0]) * j;
    FitSums& sums = sums_[cell];
    if (std::exchange(has_sums_[cell], 1)) return sums;
    sums = {};
    const Eigen::Matrix<double, 3, 8> u = displacements(i, j);
    std::array<Voigt<3>, 8> strains;
    double dilatation = 0.0, all = 0.0;
    for (int q = 0; q < 8; ++q) {
      const auto w = static_cast<double>(share_.at({i, j, layer_}, q));
      if (w == 0.0) continue;
      strains[q] = strain(u, q);
      dilatation += w * strains[q].head<3>().sum();
      all += w;
    }
    for (int q = 0; q < 8; ++q) {
      const auto w = static_cast<double>(share_.at({i, j, layer_}, q));
      if (w == 0.0) continue;
      if (solution_.mean_dilatation)
        strains[q].head<3>().array() += (dilatation / all - strains[q].head<3>().sum()) / 3.0;
      const Eigen::Vector4d p(1.0, q & 1 ? 0.25 : -0.25, q & 2 ? 0.25 : -0.25, q & 4 ? 0.25 : -0.25);
      sums.moments += w * p * p.transpose();
      sums.strains += w * p * strains[q].transpose();
    }
    return sums;
  }

 private:
  static constexpr int middle = 8;
  Eigen::Matrix<double, 3, 8> displacements(Index i, Index j) const {
    Eigen::Matrix<double, 3, 8> u;
    for (int a = 0; a < 8; ++a)
      u.col(a) = solution_.displacement.col(points_.at(i + (a & 1), j + (a >> 1 & 1), layer_ + (a >> 2)));
    return u;
  }
  Voigt<3> strain(const Eigen::Matrix<double, 3, 8>& u, int q) const {
    Mat<3> slope = u * slopes_[q];  // du_c / dx_d
    if (turned_) slope *= solution_.axes.transpose();
    return strain_of<3>(slope.reshaped());
  }

  const CellSolution& solution_;
  const RegionShare& share_;
  GridPoints points_;
  std::array<Index, 3> n_;
  bool turned_;
  std::array<Eigen::Matrix<double, 8, 3>, 9> slopes_;  ///< of the corners' functions, in the octants and the middle
  Index layer_ = 0;
  std::vector<char> has_sums_, has_middle_;
  std::vector<FitSums> sums_;
  Matrix middles_;
};

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

NodalStrains::NodalStrains(const CellSolution& solution, const RegionShare& share, Index first, Index last)
    : points_{solution.grid}, before_(points_.at(0, 0, first)), strains_(6, points_.at(0, 0, last) - before_) {
  const auto& n = solution.grid.cubes;
  parallel_chunks(last - first, 8, [&](Index begin, Index end) {
    LayerStrains one(solution, share), other(solution, share);
    std::array<LayerStrains*, 2> layers{&one, &other};  // below and above the points
    // By cell: whether all of it is of the region; those outside the grid are not.
    std::array<std::vector<char>, 2> whole;
    const auto start = [&](int side, Index layer) {
      if (layer < 0 || layer >= n[2]) {
        whole[side].assign(static_cast<std::size_t>(n[0]) * n[1], 0);
        return;
      }
      layers[side]->start(layer);
      whole[side].clear();
      for (Index j = 0; j < n[1]; ++j)
        for (Index i = 0; i < n[0]; ++i) whole[side].push_back(share.is_whole({i, j, layer}));
    };
    start(1, first + begin - 1);
    for (Index k = first + begin; k < first + end; ++k) {
      std::swap(layers[0], layers[1]);
      std::swap(whole[0], whole[1]);
      start(1, k);
      for (Index j = 0; j < points_.size[1]; ++j)
        for (Index i = 0; i < points_.size[0]; ++i) {
          const auto for_cells = [&](const auto& f) {
            for (int c = 0; c < 8; ++c) {
              const Index x = i - 1 + (c & 1), y = j - 1 + (c >> 1 & 1), z = k - 1 + (c >> 2);
              if (x >= 0 && y >= 0 && z >= 0 && x < n[0] && y < n[1] && z < n[2]) f(x, y, z, c >> 2);
            }
          };
          int whole_cells = 0;
          for_cells([&](Index x, Index y, Index, int side) {
            whole_cells += whole[side][x + static_cast<std::size_t>(n[0]) * y];
          });
          auto strain = strains_.col(points_.at(i, j, k) - before_);
          if (whole_cells == 8) {  // the fit is the mean
            strain.setZero();
            for_cells([&](Index x, Index y, Index, int side) { strain += 0.125 * layers[side]->middle_of(x, y); });
            continue;
          }
          FitSums fit;
          for_cells([&](Index x, Index y, Index z, int side) {
            const FitSums& sums = layers[side]->sums_of(x, y);
            if (sums.moments(0, 0) > 0.0) fit.add(sums, Vec<3>(x + 0.5 - i, y + 0.5 - j, z + 0.5 - k));
          });
          strain = fit.value();
        }
    }
  });
}

Voigt<3> NodalStrains::at(const Place& place) const {
  Voigt<3> strain = Voigt<3>::Zero();
  double all = 0.0;
  for (int a = 0; a < 8; ++a) {
    const Eigen::Index at =
        points_.at(place.cell[0] + (a & 1), place.cell[1] + (a >> 1 & 1), place.cell[2] + (a >> 2)) - before_;
    if (!std::isfinite(strains_(0, at))) continue;
    const double w = place.weight(a) + 1e-9;
    strain += w * strains_.col(at);
    all += w;
  }
  return all > 0.0 ? Voigt<3>(strain / all) : strain;
}

}  // namespace efree::internal
