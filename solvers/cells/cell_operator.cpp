// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/cell_operator.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace efree::internal {
namespace {

/// Edges for eigenvalues of cells: along flat axes nothing varies.
Vec<3> edges_or_endless(const Vec<3>& edges, const std::array<bool, 3>& flat) {
  Vec<3> result = edges / edges.maxCoeff();
  for (int d = 0; d < 3; ++d)
    if (flat[d]) result[d] = 1e6;
  return result;
}

/// Moduli as they were before they were rounded, if they are those of one of the materials.
std::array<double, 2> before_rounding(const ExactStiffness& known, double a, double b) {
  for (std::size_t m = 0; m < known.rounded.size(); ++m) {
    const std::array<double, 2> one{known.rounded[m].shear, known.rounded[m].across};
    if (std::abs(a - one[0]) <= 4e-7 * std::abs(one[0]) && std::abs(b - one[1]) <= 4e-6 * std::abs(one[1]))
      return known.exact[m];
  }
  return {a, b};
}

/// What elasticity and conduction have in common; moduli are (shear, across) or (conductivity, 0).
template <class Grid, int Components> class GridOperator : public CellOperator {
 public:
  GridOperator(Grid grid, const std::array<bool, 3>& flat, const ExactStiffness& exact)
      : grid_(std::move(grid)), flat_(flat), exact_(exact), dilatation_(needed(grid_)) {
    for (int d = 0; d < 3; ++d)
      if (flat[d]) grid_.inverse_edges[d] = 0.0;
  }
  const CellLayout& layout() const override { return grid_; }
  int components() const override { return Components; }
  Dilatation dilatation() const override { return dilatation_; }
  void apply(const float* u, float* f, Dilatation dilatation) const override { multiply(grid_, u, f, dilatation); }
  void apply(const double* u, double* f, Dilatation dilatation) const override { multiply(grid_, u, f, dilatation); }
  void apply_isotropic(const float* u, float* f, Dilatation dilatation) const override {
    multiply_isotropic(grid_, u, f, dilatation);
  }
  void apply_isotropic(const double* u, double* f, Dilatation dilatation) const override {
    multiply_isotropic(grid_, u, f, dilatation);
  }

  Vector apply_strain(const Vector& strain, Field& f) override {
    Field u = zeros<double>(size());
    f = zeros<double>(size());
    add_affine(strain, u);
    apply_with_ends_apart(grid_, u, f, dilatation_);
    return moments(f);
  }

  CellAverages averages(const std::vector<Field>& u, const Matrix& applied) override {
    const Index loads = applied.cols();
    CellAverages means{Matrix::Zero(loads, loads), Matrix::Zero(strains(), loads)};
    std::optional<Grid> rounded_off;
    if (!exact_.rounded.empty()) rounded_off = what_rounding_took();
    Field total = zeros<double>(size()), f = zeros<double>(size()), more = zeros<double>(size());
    for (Index j = 0; j < loads; ++j) {
      for_all(size(), [&](std::size_t i) { total[i] = u[j][i]; });
      add_affine(applied.col(j), total);
      apply_with_ends_apart(grid_, total, f, dilatation_);
      if (rounded_off) {
        apply_with_ends_apart(*rounded_off, total, more, Dilatation::local);
        for_all(size(), [&](std::size_t i) { f[i] += more[i]; });
      }
      means.stress.col(j) = moments(f);
      for (Index i = 0; i < loads; ++i) means.energy(i, j) = applied.col(i).dot(means.stress.col(j)) + dot(u[i], f);
    }
    const double frame = grid_.edges.prod() * grid_.cells[0] * grid_.cells[1] * grid_.cells[2];
    means.energy /= frame;
    means.stress /= frame;
    return means;
  }

 protected:
  Grid grid_;
  std::array<bool, 3> flat_;
  ExactStiffness exact_;
  Dilatation dilatation_;

 private:
  static Dilatation needed(const CellGrid& grid) { return grid.needed(); }
  static Dilatation needed(const ConductionGrid&) { return Dilatation::local; }
  template <class T> static void multiply(const CellGrid& grid, const T* u, T* f, Dilatation dilatation) {
    grid.apply(u, f, dilatation);
  }
  template <class T> static void multiply(const ConductionGrid& grid, const T* u, T* f, Dilatation) {
    grid.apply(u, f);
  }
  template <class T> static void multiply_isotropic(const CellGrid& grid, const T* u, T* f, Dilatation dilatation) {
    grid.apply_isotropic(u, f, dilatation);
  }
  template <class T> static void multiply_isotropic(const ConductionGrid& grid, const T* u, T* f, Dilatation) {
    grid.apply(u, f);
  }
  /// f = K u, where nodes at both ends of a flat axis may have different values.
  void apply_with_ends_apart(Grid& grid, const Field& u, Field& f, Dilatation dilatation) const {
    const std::array<double, 3> inverse_edges = grid.inverse_edges;
    for (int d = 0; d < 3; ++d) grid.inverse_edges[d] = 1.0 / grid.edges[d];
    multiply(grid, u.data(), f.data(), dilatation);
    grid.inverse_edges = inverse_edges;
  }
  /// Calls f(node, x) for the nodes of a layer, x from the lowest corner.
  template <class F> void for_nodes_of(Index k, const F& f) const {
    for (Index j = 0; j <= grid_.cells[1]; ++j)
      for (Index i = 0; i <= grid_.cells[0]; ++i) f(grid_.node(i, j, k), grid_.edges.cwiseProduct(Vec<3>(i, j, k)));
  }
  /// u += E x for a strain E.
  void add_affine(const Vector& applied, Field& u) const {
    Mat<3> slope = Mat<3>::Zero();  // by component and axis
    if (Components == 1)
      slope.row(0) = applied.transpose();
    else
      slope << applied[0], 0.5 * applied[5], 0.5 * applied[4], 0.5 * applied[5], applied[1], 0.5 * applied[3],
          0.5 * applied[4], 0.5 * applied[3], applied[2];
    parallel_chunks(grid_.cells[2] + 1, 4, [&](Index begin, Index end) {
      for (Index k = begin; k < end; ++k)
        for_nodes_of(k, [&](std::size_t node, const Vec<3>& x) {
          for (int c = 0; c < Components; ++c) u[c * grid_.nodes() + node] += slope.row(c).dot(x);
        });
    });
  }
  /// E x . f for each unit strain.
  Vector moments(const Field& f) const {
    std::vector<Mat<3>> layers(grid_.cells[2] + 1, Mat<3>::Zero());
    parallel_chunks(grid_.cells[2] + 1, 4, [&](Index begin, Index end) {
      for (Index k = begin; k < end; ++k)
        for_nodes_of(k, [&](std::size_t node, const Vec<3>& x) {
          for (int c = 0; c < Components; ++c) layers[k].row(c) += f[c * grid_.nodes() + node] * x.transpose();
        });
    });
    Mat<3> sum = Mat<3>::Zero();
    for (const Mat<3>& layer : layers) sum += layer;
    if (Components == 1) return sum.row(0).transpose();
    Vector result(6);
    result << sum(0, 0), sum(1, 1), sum(2, 2), 0.5 * (sum(1, 2) + sum(2, 1)), 0.5 * (sum(0, 2) + sum(2, 0)),
        0.5 * (sum(0, 1) + sum(1, 0));
    return result;
  }
  /// A grid of the differences between exact weights and those in single precision.
  Grid what_rounding_took() const {
    Grid difference = grid_;
    const double volume = grid_.edges.prod() / 8.0;
    std::vector<PartStiffness> weights = grid_.parts.weights();
    for (PartStiffness& one : weights) {
      if (one.shear == 0.0F) continue;
      const double shear = one.shear, across = one.across;
      const auto exact = before_rounding(exact_, shear / volume, across / volume);
      one = {static_cast<float>(exact[0] * volume - shear), static_cast<float>(exact[1] * volume - across)};
    }
    difference.parts.set_weights(std::move(weights));
    leave_isotropic(difference);
    return difference;
  }
  static void leave_isotropic(CellGrid& grid) { grid.anisotropy = CellAnisotropy(grid, {}); }
  static void leave_isotropic(ConductionGrid&) {}
};

class ElasticOperator final : public GridOperator<CellGrid, 3> {
 public:
  using GridOperator::GridOperator;
  std::vector<float> bound() const override {
    return grid_.bound(largest_eigenvalues(edges_or_endless(grid_.edges, flat_), grid_.parts.ratios()));
  }
};

class ConductionOperator final : public GridOperator<ConductionGrid, 1> {
 public:
  using GridOperator::GridOperator;
  std::vector<float> bound() const override {
    return grid_.bound(largest_conduction_eigenvalues(edges_or_endless(grid_.edges, flat_)));
  }
};

}  // namespace

std::unique_ptr<CellOperator> elastic_operator(const std::array<Index, 3>& cells, const Vec<3>& edges,
                                               const std::array<bool, 3>& flat, const PartLayers& layers,
                                               const ExactStiffness& exact,
                                               const std::vector<VoigtMatrix<3>>& anisotropic) {
  return std::make_unique<ElasticOperator>(CellGrid(cells, edges, layers, exact.rounded, anisotropic), flat, exact);
}
std::unique_ptr<CellOperator> conduction_operator(const std::array<Index, 3>& cells, const Vec<3>& edges,
                                                  const std::array<bool, 3>& flat, const PartLayers& layers,
                                                  const ExactStiffness& exact) {
  return std::make_unique<ConductionOperator>(ConductionGrid(cells, edges, layers, exact.rounded), flat, exact);
}

}  // namespace efree::internal
