// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/algorithms/unit_cell.hpp"

#include "efree/assembly/operators.hpp"
#include "efree/core/error.hpp"
#include "efree/geometry/mesh/locator.hpp"
#include "efree/solvers/linear/cholesky.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <utility>

namespace efree {
namespace {

using Row = std::map<Index, double>;

/// The box around a mesh.
template <int Dim> struct Frame {
  static constexpr double rounding = 1e-7;  // of its lengths
  Vec<Dim> low, lengths;

  explicit Frame(const FineMesh<Dim>& mesh)
      : low(mesh.vertices().rowwise().minCoeff()), lengths(mesh.vertices().rowwise().maxCoeff() - low) {}
  double volume() const { return lengths.prod(); }
  bool is_at_end(const Vec<Dim>& x, int axis) const {
    return std::abs(x[axis] - low[axis] - lengths[axis]) <= rounding * lengths[axis];
  }
  bool is_on(const Vec<Dim>& x) const {
    for (int d = 0; d < Dim; ++d)
      if (is_at_end(x, d) || std::abs(x[d] - low[d]) <= rounding * lengths[d]) return true;
    return false;
  }
};

/// What degrees of freedom are made of: themselves, or those opposite.
template <int Dim> class PeriodicRows {
 public:
  PeriodicRows(const FineSpace<Dim>& space, const Frame<Dim>& frame)
      : space_(space), frame_(frame), locate_(space.mesh()), rows_(space.size()) {}
  const Row& row(Index dof) {
    std::optional<Row>& known = rows_[dof];
    if (known) return *known;
    Vec<Dim> opposite = space_.points().col(dof);
    bool is_free = true;
    for (int d = 0; d < Dim; ++d)
      if (frame_.is_at_end(opposite, d)) {
        opposite[d] = frame_.low[d];
        is_free = false;
      }
    if (is_free) return known.emplace(Row{{dof, 1.0}});
    const Location<Dim> there = find(opposite, space_.points().col(dof));
    const auto dofs = space_.cell(there.cell);
    const auto values = space_.values(there.at);
    Row sum;
    for (std::size_t i = 0; i < dofs.size(); ++i) {
      const double value = values[static_cast<Index>(i)];
      if (std::abs(value) < 1e-9) continue;
      for (const auto& [master, weight] : Row(row(dofs[i]))) sum[master] += value * weight;
    }
    return rows_[dof].emplace(std::move(sum));
  }

 private:
  Location<Dim> find(const Vec<Dim>& opposite, const Vec<Dim>& x) const {
    try {
      return locate_(opposite);
    } catch (const InputError&) {
      throw InputError(
          fmt::format("the geometry does not repeat itself: there is material at ({:.6g}) on the frame, and none "
                      "opposite, at ({:.6g}); take kinematic conditions, or a unit cell whose sides match",
                      fmt::join(x, ", "), fmt::join(opposite, ", ")));
    }
  }
  const FineSpace<Dim>& space_;
  const Frame<Dim>& frame_;
  Locator<Dim> locate_;
  std::vector<std::optional<Row>> rows_;
};

/// Unknowns by degree of freedom of a scalar field: none of those that are held.
template <int Dim>
Eigen::SparseMatrix<double> unknowns(const FineSpace<Dim>& space, const Frame<Dim>& frame, FrameCondition condition) {
  std::vector<Row> rows(space.size());
  PeriodicRows<Dim> periodic(space, frame);
  for (Index dof = 0; dof < space.size(); ++dof) {
    if (condition == FrameCondition::periodic)
      rows[dof] = periodic.row(dof);
    else if (condition == FrameCondition::uniform || !frame.is_on(space.points().col(dof)))
      rows[dof] = {{dof, 1.0}};
  }
  std::vector<Index> number(space.size(), -1);
  for (const Row& row : rows)
    for (const auto& [master, weight] : row) number[master] = 0;
  Index count = 0;
  for (Index& of : number)
    if (of == 0) of = count++;
  std::vector<Eigen::Triplet<double>> entries;
  for (Index dof = 0; dof < space.size(); ++dof)
    for (const auto& [master, weight] : rows[dof]) entries.emplace_back(dof, number[master], weight);
  Eigen::SparseMatrix<double> T(space.size(), count);
  T.setFromTriplets(entries.begin(), entries.end());
  return T;
}

/// The same of fields of so many components, one degree of freedom after the other.
Eigen::SparseMatrix<double> for_components(const Eigen::SparseMatrix<double>& T, int components) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int k = 0; k < T.outerSize(); ++k)
    for (Eigen::SparseMatrix<double>::InnerIterator it(T, k); it; ++it)
      for (int c = 0; c < components; ++c)
        entries.emplace_back(components * it.row() + c, components * it.col() + c, it.value());
  Eigen::SparseMatrix<double> all(components * T.rows(), components * T.cols());
  all.setFromTriplets(entries.begin(), entries.end());
  return all;
}

template <int Dim> void require_elements(const Approximation<Dim>& elements) {
  require(elements.shape.num_nodes() == elements.space.size(), "effective tensors on a mesh: finite elements expected");
  require(!elements.space.axisymmetric(), "effective tensors on a mesh: no axisymmetry expected");
}

/// Forces of the unit mean stresses (fluxes) on the frame: Dim or 1 components by degree of freedom, a column each.
template <int Dim> Matrix frame_forces(const FineSpace<Dim>& space, const Frame<Dim>& frame, int components,
                                       const std::vector<Mat<Dim>>& units) {
  const FineMesh<Dim>& mesh = space.mesh();
  Matrix forces = Matrix::Zero(components * space.size(), static_cast<Index>(units.size()));
  const SimplexRule<Dim - 1>& rule = space.facet_rule();
  double filled = 0.0, all = 0.0;
  for (int d = 0; d < Dim; ++d) all += 2.0 * frame.volume() / frame.lengths[d];
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    const auto corners = mesh.facets().col(f);
    int axis = -1;
    bool upper = false;
    for (int d = 0; d < Dim; ++d)
      for (const bool end : {false, true}) {
        bool on = true;
        for (int i = 0; i < Dim; ++i) {
          const double way = mesh.vertex(corners[i])[d] - frame.low[d] - (end ? frame.lengths[d] : 0.0);
          on = on && std::abs(way) <= Frame<Dim>::rounding * frame.lengths[d];
        }
        if (on) axis = d, upper = end;
      }
    if (axis < 0) continue;
    const double area = mesh.facet_measure(f);
    filled += area;
    const auto dofs = space.cell(mesh.facet_cell(f));
    for (Index q = 0; q < rule.weights.size(); ++q) {
      const auto values = space.values(space.facet_point(f, rule.points.col(q)));
      for (std::size_t i = 0; i < dofs.size(); ++i)
        for (std::size_t j = 0; j < units.size(); ++j)
          for (int c = 0; c < components; ++c)
            forces(components * dofs[i] + c, static_cast<Index>(j)) +=
                (upper ? 1.0 : -1.0) * area * rule.weights[q] * values[static_cast<Index>(i)] * units[j](c, axis);
    }
  }
  if (filled < (1.0 - 1e-6) * all)
    throw InputError(
        "void reaches the frame, which then cannot bear uniform tractions: take periodic or kinematic conditions");
  return forces;
}

/// The tensor from the matrix K of all degrees of freedom, the forces of unit mean strains (gradients) by which these
/// are out of balance, and the mean stiffness.
template <int Dim> UnitCellTensor tensor_of(const Approximation<Dim>& elements, const Frame<Dim>& frame,
                                            FrameCondition condition, int components, const SymmetricMatrix& K,
                                            const Matrix& forces, const Matrix& mean) {
  constexpr double held = 1e-10;  // of the diagonal
  const Eigen::SparseMatrix<double> T = for_components(unknowns(elements.space, frame, condition), components);
  const Eigen::SparseMatrix<double> all = Eigen::SparseMatrix<double>(K).selfadjointView<Eigen::Lower>();
  Eigen::SparseMatrix<double> reduced = T.transpose() * all * T;
  const double largest = reduced.diagonal().maxCoeff();
  for (Index i = 0; i < reduced.cols(); ++i) {
    double& d = reduced.coeffRef(i, i);
    d = d > 0.0 ? d * (1.0 + held) : largest;  // nothing conducts there
  }
  SymmetricMatrix lower = reduced.triangularView<Eigen::Lower>();
  lower.makeCompressed();
  std::vector<Index> node_of(lower.cols());
  for (std::size_t i = 0; i < node_of.size(); ++i) node_of[i] = static_cast<Index>(i) / components;
  const Cholesky factor(lower, node_of);
  const Matrix F = T.transpose() * forces;
  const Matrix work = F.transpose() * factor.solve(F) / frame.volume();
  UnitCellTensor found{.tensor = {}, .mean = mean, .unknowns = static_cast<Index>(lower.cols())};
  if (condition == FrameCondition::uniform)
    found.tensor = work.ldlt().solve(Matrix(Matrix::Identity(work.rows(), work.cols())));
  else
    found.tensor = mean - work;
  found.tensor = Matrix(0.5 * (found.tensor + found.tensor.transpose()));
  if (!found.tensor.allFinite()) throw NumericalError("the effective tensor is not finite");
  return found;
}

}  // namespace

template <int Dim> UnitCellTensor effective_stiffness(const Approximation<Dim>& elements,
                                                      const Materials<Dim>& materials, FrameCondition condition) {
  require_elements(elements);
  const Discretization<Dim>& points = elements.quadrature;
  const Frame<Dim> frame(elements.space.mesh());
  constexpr int strains = Dim * (Dim + 1) / 2;
  // Voigt order; in the plane stresses have a fourth component, across it, which does no work.
  const auto row_of = [](int i) { return Dim == 2 && i == 2 ? 3 : i; };
  Matrix mean = Matrix::Zero(strains, strains);
  std::vector<VoigtPoints<Dim>> stress(strains, VoigtPoints<Dim>::Zero(Voigt<Dim>::RowsAtCompileTime, points.size()));
  for (Index q = 0; q < points.size(); ++q) {
    Stiffness<Dim> room;
    const auto& C = materials.stiffness(points.region[q], points.points.col(q), room).C;
    for (int j = 0; j < strains; ++j) {
      stress[j].col(q) = -C.col(row_of(j));
      for (int i = 0; i < strains; ++i) mean(i, j) += points.weights[q] / frame.volume() * C(row_of(i), row_of(j));
    }
  }
  Matrix forces(Dim * elements.space.size(), strains);
  if (condition == FrameCondition::uniform) {
    std::vector<Mat<Dim>> units;
    for (int j = 0; j < strains; ++j) {
      Mat<Dim> unit = Mat<Dim>::Zero();
      if (j < Dim)
        unit(j, j) = 1.0;
      else
        unit(Dim == 2 ? 0 : (j == 3 ? 1 : 0), j == 5 || Dim == 2 ? 1 : 2) = 1.0;
      units.emplace_back(j < Dim ? unit : Mat<Dim>(unit + unit.transpose()));
    }
    forces = frame_forces<Dim>(elements.space, frame, Dim, units);
  } else {
    for (int j = 0; j < strains; ++j) forces.col(j) = forces_of_stress(points, stress[j]).reshaped();
  }
  const SymmetricMatrix K = stiffness_matrix<Dim>(points, materials.tangents(points));
  return tensor_of(elements, frame, condition, Dim, K, forces, mean);
}

template <int Dim> UnitCellTensor effective_conductivity(const Approximation<Dim>& elements,
                                                         const std::vector<double>& conductivities,
                                                         FrameCondition condition) {
  require_elements(elements);
  require(static_cast<Index>(conductivities.size()) == elements.space.mesh().num_regions(),
          "effective_conductivity: a conductivity for each region of the mesh expected");
  const Discretization<Dim>& points = elements.quadrature;
  const Frame<Dim> frame(elements.space.mesh());
  Matrix mean = Matrix::Zero(Dim, Dim), forces = Matrix::Zero(elements.space.size(), Dim);
  std::vector<Eigen::Triplet<double, Index>> entries;
  for (Index q = 0; q < points.size(); ++q) {
    const auto row = points.shape.row(q);
    const double k = points.weights[q] * conductivities[points.region[q]];
    mean.diagonal().array() += k / frame.volume();
    for (std::size_t a = 0; a < row.nodes.size(); ++a) {
      forces.row(row.nodes[a]) -= k * row.dN[a].transpose();
      for (std::size_t b = 0; b <= a; ++b)
        entries.emplace_back(row.nodes[a], row.nodes[b], k * row.dN[a].dot(row.dN[b]));
    }
  }
  SymmetricMatrix K(elements.space.size(), elements.space.size());
  K.setFromTriplets(entries.begin(), entries.end());
  if (condition == FrameCondition::uniform) {
    std::vector<Mat<Dim>> units(Dim, Mat<Dim>::Zero());
    for (int j = 0; j < Dim; ++j) units[j](0, j) = 1.0;
    forces = frame_forces<Dim>(elements.space, frame, 1, units);
  }
  return tensor_of(elements, frame, condition, 1, K, forces, mean);
}

template UnitCellTensor effective_stiffness<2>(const Approximation<2>&, const Materials<2>&, FrameCondition);
template UnitCellTensor effective_stiffness<3>(const Approximation<3>&, const Materials<3>&, FrameCondition);
template UnitCellTensor effective_conductivity<2>(const Approximation<2>&, const std::vector<double>&, FrameCondition);
template UnitCellTensor effective_conductivity<3>(const Approximation<3>&, const std::vector<double>&, FrameCondition);

}  // namespace efree
