// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/algorithms/unit_cell.hpp"

#include "efree/assembly/operators.hpp"
#include "efree/core/error.hpp"
#include "efree/solvers/linear/cholesky.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <utility>

namespace efree {
namespace {

/// The box around a mesh.
template <int Dim> struct Frame {
  static constexpr double rounding = 1e-6;  // of its lengths
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

/// By degree of freedom the one that it is the same as on a periodic frame: itself, or the one opposite.
template <int Dim> std::vector<Index> opposite_dofs(const FineSpace<Dim>& space, const Frame<Dim>& frame) {
  // Places in units of the rounding, so that those of like meshes are equal but for one unit.
  using Key = std::array<std::int64_t, Dim>;
  const auto key_of = [&](const Vec<Dim>& x) {
    Key key;
    for (int d = 0; d < Dim; ++d)
      key[d] = std::llround((x[d] - frame.low[d]) / (4.0 * Frame<Dim>::rounding * frame.lengths[d]));
    return key;
  };
  std::map<Key, Index> dof_at;
  for (Index dof = 0; dof < space.size(); ++dof) dof_at.emplace(key_of(space.points().col(dof)), dof);
  const auto find = [&](const Vec<Dim>& x) {
    const Key key = key_of(x);
    Key near;
    for (int n = 0; n < (Dim == 2 ? 9 : 27); ++n) {
      int rest = n;
      for (int d = 0; d < Dim; ++d, rest /= 3) near[d] = key[d] + rest % 3 - 1;
      if (const auto found = dof_at.find(near); found != dof_at.end()) return found->second;
    }
    return Index(-1);
  };
  std::vector<Index> opposite(space.size());
  for (Index dof = 0; dof < space.size(); ++dof) {
    Vec<Dim> x = space.points().col(dof);
    opposite[dof] = dof;
    bool is_free = true;
    for (int d = 0; d < Dim; ++d)
      if (frame.is_at_end(x, d)) {
        x[d] = frame.low[d];
        is_free = false;
      }
    if (is_free) continue;
    opposite[dof] = find(x);
    if (opposite[dof] < 0)
      throw InputError(fmt::format(
          "opposite sides of the unit cell do not have the same mesh: ({:.6g}) has nothing opposite, at "
          "({:.6g}); mesh it periodically (gmsh: Periodic Surface), or take kinematic and static conditions, "
          "between which the periodic ones are",
          fmt::join(space.points().col(dof), ", "), fmt::join(x, ", ")));
  }
  return opposite;
}

/// Unknowns by degree of freedom of a scalar field: none of those that are held.
template <int Dim>
Eigen::SparseMatrix<double> unknowns(const FineSpace<Dim>& space, const Frame<Dim>& frame, FrameCondition condition) {
  std::vector<Index> stands(space.size());  // by degree of freedom; -1: held
  if (condition == FrameCondition::periodic)
    stands = opposite_dofs(space, frame);
  else
    for (Index dof = 0; dof < space.size(); ++dof)
      stands[dof] = condition == FrameCondition::kinematic && frame.is_on(space.points().col(dof)) ? -1 : dof;
  std::vector<Index> number(space.size(), -1);
  Index count = 0;
  for (Index dof = 0; dof < space.size(); ++dof)
    if (stands[dof] == dof) number[dof] = count++;
  std::vector<Eigen::Triplet<double>> entries;
  for (Index dof = 0; dof < space.size(); ++dof)
    if (stands[dof] >= 0) entries.emplace_back(dof, number[stands[dof]], 1.0);
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

/// The side of the frame that a facet is on: 2 axis, plus 1 at the upper end; -1: none.
template <int Dim> int side_of(const FineMesh<Dim>& mesh, const Frame<Dim>& frame, Index facet) {
  for (int side = 0; side < 2 * Dim; ++side) {
    const int axis = side / 2;
    const double end = frame.low[axis] + (side % 2) * frame.lengths[axis];
    bool is_on = true;
    for (const Index v : mesh.facets().col(facet))
      is_on = is_on && std::abs(mesh.vertex(v)[axis] - end) <= Frame<Dim>::rounding * frame.lengths[axis];
    if (is_on) return side;
  }
  return -1;
}

/// Throws InputError for a side of the frame that no facet is on: what touches it in points or along lines, or is not
/// flat there, would not be held.
template <int Dim> void require_sides(const FineMesh<Dim>& mesh, const Frame<Dim>& frame) {
  std::array<double, 2 * Dim> area{};
  for (Index f = 0; f < mesh.num_facets(); ++f)
    if (const int side = side_of(mesh, frame, f); side >= 0) area[side] += mesh.facet_measure(f);
  for (int side = 0; side < 2 * Dim; ++side)
    if (area[side] == 0.0)
      throw InputError(
          fmt::format("no facet of the unit cell lies on the {} end of its frame along {}: the frame is the box around "
                      "the mesh, and "
                      "its sides have to be flat to {:g} of its length",
                      side % 2 == 1 ? "upper" : "lower", "xyz"[side / 2], Frame<Dim>::rounding));
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
    const int side = side_of(mesh, frame, f);
    if (side < 0) continue;
    const int axis = side / 2;
    const bool upper = side % 2 == 1;
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
  require_sides(elements.space.mesh(), frame);
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
  require_sides(elements.space.mesh(), frame);
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
