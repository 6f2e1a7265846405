// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/algorithms/unit_cell.hpp"

#include "efree/assembly/operators.hpp"
#include "efree/core/error.hpp"
#include "efree/solvers/algorithms/internal/frame.hpp"
#include "efree/solvers/algorithms/internal/opposite_sides.hpp"
#include "efree/solvers/algorithms/internal/periodic_coupling.hpp"
#include "efree/solvers/linear/cholesky.hpp"

#include <fmt/format.h>
#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <utility>

namespace efree {
namespace {

using internal::Frame;

/// Unknowns by degree of freedom of a scalar field: none of those that are held on the frame, one of those that are the
/// same on opposite sides.
template <int Dim> Eigen::SparseMatrix<double> unknowns(const FineSpace<Dim>& space, const Frame<Dim>& frame,
                                                        FrameCondition condition,
                                                        const std::vector<std::array<Index, 2>>& same) {
  std::vector<Index> stands(space.size());  // by degree of freedom, in trees whose roots are the lowest; -1: held
  for (Index dof = 0; dof < space.size(); ++dof)
    stands[dof] = condition == FrameCondition::kinematic && frame.is_on(space.points().col(dof)) ? -1 : dof;
  const auto root = [&](Index dof) {
    while (stands[dof] != dof) dof = stands[dof];
    return dof;
  };
  for (const auto& [upper, lower] : same) {
    const auto [first, last] = std::minmax({root(upper), root(lower)});
    stands[last] = first;
  }
  std::vector<Index> number(space.size(), -1);
  std::vector<Eigen::Triplet<double>> entries;
  Index count = 0;
  for (Index dof = 0; dof < space.size(); ++dof) {
    if (stands[dof] < 0) continue;
    if (stands[dof] == dof) number[dof] = count++;
    entries.emplace_back(dof, number[root(dof)], 1.0);
  }
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

/// Throws InputError for a side of the frame that no facet is on: what touches it in points or along lines, or is not
/// flat there, would not be held.
template <int Dim> void require_sides(const FineMesh<Dim>& mesh, const Frame<Dim>& frame) {
  std::array<double, 2 * Dim> area{};
  for (Index f = 0; f < mesh.num_facets(); ++f)
    if (const int side = frame.side_of(mesh, f); side >= 0) area[side] += mesh.facet_measure(f);
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
    const int side = frame.side_of(mesh, f);
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

/// Stiffness matrix, forces and mean of a problem with so many components.
struct UnitCellProblem {
  int components;
  SymmetricMatrix K;  ///< of all degrees of freedom
  Matrix forces;      ///< by which unit mean strains (gradients) are out of balance, or of unit mean stresses (fluxes)
  Matrix mean;        ///< stiffness averaged over the frame
};

/// UnitCellTensor::facet_change of fields w, by unit mean gradients: of all of the field.
template <int Dim> Matrix facet_change(const FineSpace<Dim>& space, const Frame<Dim>& frame, int components,
                                       const internal::TractionOperator<Dim>& traction, const Matrix& units,
                                       const Matrix& w, const Vector& shifts) {
  const FineMesh<Dim>& mesh = space.mesh();
  const SimplexRule<Dim - 1>& rule = space.facet_rule();
  Matrix change = Matrix::Zero(w.cols(), w.cols());
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    if (shifts[f] == 0.0 || frame.side_of(mesh, f) >= 0) continue;
    const Index cell = mesh.facet_cell(f);
    const auto dofs = space.cell(cell);
    for (Index q = 0; q < rule.weights.size(); ++q) {
      const auto at = space.facet_point(f, rule.points.col(q));
      const auto dN = space.gradients(cell, at);
      Matrix gradient = units;
      for (std::size_t i = 0; i < dofs.size(); ++i)
        for (int c = 0; c < components; ++c)
          gradient.middleRows<Dim>(c * Dim) += dN.col(static_cast<Index>(i)) * w.row(components * dofs[i] + c);
      const double weight = shifts[f] * mesh.facet_measure(f) * rule.weights[q] / frame.volume();
      for (int axis = 0; axis < Dim; ++axis) {
        const Matrix along = gradient(Eigen::seqN(axis, components, Dim), Eigen::all);
        change += weight * along.transpose() * (traction(mesh.region(cell), space.position(cell, at), axis) * gradient);
      }
    }
  }
  return change;
}

/// The tensor, on a periodic frame with opposite sides that are the same or coupled.
template <int Dim> UnitCellTensor tensor_of(const FineSpace<Dim>& space, const Frame<Dim>& frame,
                                            FrameCondition condition, UnitCellProblem problem,
                                            const internal::TractionOperator<Dim>& traction, const Matrix& units,
                                            const Vector& shifts) {
  constexpr double held = 1e-10;  // of the diagonal
  UnitCellTensor found{.tensor = {}, .mean = problem.mean};
  std::vector<std::array<Index, 2>> same;
  if (condition == FrameCondition::periodic) {
    for (int axis = 0; axis < Dim; ++axis)
      if (const auto pairs = internal::matching_dofs(space, frame, axis))
        same.insert(same.end(), pairs->begin(), pairs->end());
      else
        found.coupled_axes.push_back(axis);
  }
  if (!found.coupled_axes.empty()) {
    const auto coupling = internal::couple_sides(space, frame, found.coupled_axes, problem.components, traction, units);
    problem.K += coupling.matrix;
    problem.forces += coupling.forces;
    found.uncovered = coupling.uncovered;
  }
  const Eigen::SparseMatrix<double> T = for_components(unknowns(space, frame, condition, same), problem.components);
  const Eigen::SparseMatrix<double> all = Eigen::SparseMatrix<double>(problem.K).selfadjointView<Eigen::Lower>();
  Eigen::SparseMatrix<double> reduced = T.transpose() * all * T;
  const double largest = reduced.diagonal().maxCoeff();
  for (Index i = 0; i < reduced.cols(); ++i) {
    double& d = reduced.coeffRef(i, i);
    d = d > 0.0 ? d * (1.0 + held) : largest;  // nothing conducts there
  }
  SymmetricMatrix lower = reduced.triangularView<Eigen::Lower>();
  lower.makeCompressed();
  std::vector<Index> node_of(lower.cols());
  for (std::size_t i = 0; i < node_of.size(); ++i) node_of[i] = static_cast<Index>(i) / problem.components;
  const Cholesky factor(lower, node_of);
  if (factor.negative_pivots() > 0)
    throw NumericalError("the stiffness of the unit cell is not positive: moduli vary by more than 2 within a cell");
  const Matrix w = T * factor.solve(T.transpose() * problem.forces), Fw = problem.forces.transpose() * w;
  // The functional without the springs, whose effect on it is of second order.
  const Matrix work = (Fw + Fw.transpose() - w.transpose() * (all * w)) / frame.volume();
  found.unknowns = static_cast<Index>(lower.cols());
  if (condition == FrameCondition::uniform)
    found.tensor = work.ldlt().solve(Matrix(Matrix::Identity(work.rows(), work.cols())));
  else
    found.tensor = problem.mean - work;
  found.tensor = Matrix(0.5 * (found.tensor + found.tensor.transpose()));
  if (!found.tensor.allFinite()) throw NumericalError("the effective tensor is not finite");
  if (shifts.size() > 0)
    found.facet_change = condition == FrameCondition::uniform
                             ? facet_change<Dim>(space, frame, problem.components, traction,
                                                 Matrix::Zero(units.rows(), units.cols()), w * found.tensor, shifts)
                             : facet_change<Dim>(space, frame, problem.components, traction, units, w, shifts);
  return found;
}

/// Of a conductor, by cell.
template <int Dim>
SymmetricMatrix conduction_matrix(const FineSpace<Dim>& space, const std::vector<double>& conductivities) {
  const SimplexRule<Dim>& rule = space.cell_rule();
  std::vector<Eigen::Triplet<double, Index>> entries;
  for (Index c = 0; c < space.mesh().num_cells(); ++c) {
    const auto dofs = space.cell(c);
    Matrix local = Matrix::Zero(static_cast<Index>(dofs.size()), static_cast<Index>(dofs.size()));
    for (Index q = 0; q < rule.weights.size(); ++q) {
      const auto dN = space.gradients(c, rule.points.col(q));
      local += space.weight(c, q) * conductivities[space.mesh().region(c)] * dN.transpose() * dN;
    }
    for (std::size_t a = 0; a < dofs.size(); ++a)
      for (std::size_t b = 0; b < dofs.size(); ++b)
        if (dofs[a] >= dofs[b])
          entries.emplace_back(dofs[a], dofs[b], local(static_cast<Index>(a), static_cast<Index>(b)));
  }
  SymmetricMatrix K(space.size(), space.size());
  K.setFromTriplets(entries.begin(), entries.end());
  return K;
}

/// Rows and columns of Stiffness::C in the plane: of the strains that there are, by xx, yy, xy; in space all.
template <int Dim> int voigt_row(int i) {
  return Dim == 2 && i == 2 ? 3 : i;
}
/// Place of component (i, j) among the strains that there are.
template <int Dim> int strain_of_pair(int i, int j) {
  return i == j ? i : Dim == 2 ? 2 : 6 - i - j;
}
/// Displacement gradients of the unit strains, each symmetric, laid out as in TractionOperator.
template <int Dim> Matrix unit_strains() {
  Matrix units = Matrix::Zero(Dim * Dim, Dim * (Dim + 1) / 2);
  for (int i = 0; i < Dim; ++i)
    for (int j = 0; j < Dim; ++j) units(i * Dim + j, strain_of_pair<Dim>(i, j)) = i == j ? 1.0 : 0.5;
  return units;
}

}  // namespace

template <int Dim> UnitCellTensor effective_stiffness(const Approximation<Dim>& elements,
                                                      const Materials<Dim>& materials, FrameCondition condition,
                                                      const Vector& facet_shifts) {
  require_elements(elements);
  const Discretization<Dim>& points = elements.quadrature;
  const Frame<Dim> frame(elements.space.mesh());
  require_sides(elements.space.mesh(), frame);
  constexpr int strains = Dim * (Dim + 1) / 2;
  Matrix mean = Matrix::Zero(strains, strains);
  std::vector<VoigtPoints<Dim>> stress(strains, VoigtPoints<Dim>::Zero(Voigt<Dim>::RowsAtCompileTime, points.size()));
  for (Index q = 0; q < points.size(); ++q) {
    Stiffness<Dim> room;
    const auto& C = materials.stiffness(points.region[q], points.points.col(q), room).C;
    for (int j = 0; j < strains; ++j) {
      stress[j].col(q) = -C.col(voigt_row<Dim>(j));
      for (int i = 0; i < strains; ++i)
        mean(i, j) += points.weights[q] / frame.volume() * C(voigt_row<Dim>(i), voigt_row<Dim>(j));
    }
  }
  const Matrix units = unit_strains<Dim>();
  Matrix forces(Dim * elements.space.size(), strains);
  if (condition == FrameCondition::uniform) {
    std::vector<Mat<Dim>> stresses;  // with both shear stresses
    for (int j = 0; j < strains; ++j)
      stresses.emplace_back((units.col(j).array() > 0.0).template cast<double>().matrix().reshaped(Dim, Dim));
    forces = frame_forces<Dim>(elements.space, frame, Dim, stresses);
  } else {
    for (int j = 0; j < strains; ++j) forces.col(j) = forces_of_stress(points, stress[j]).reshaped();
  }
  const auto traction = [&](Index region, const Vec<Dim>& x, int axis) {
    Stiffness<Dim> room;
    const auto& C = materials.stiffness(region, x, room).C;
    Matrix by_gradient(Dim, Dim * Dim);
    for (int r = 0; r < Dim; ++r)
      for (int c = 0; c < Dim; ++c)
        for (int k = 0; k < Dim; ++k)
          by_gradient(r, c * Dim + k) =
              C(voigt_row<Dim>(strain_of_pair<Dim>(r, axis)), voigt_row<Dim>(strain_of_pair<Dim>(c, k)));
    return by_gradient;
  };
  return tensor_of<Dim>(elements.space, frame, condition,
                        {.components = Dim,
                         .K = stiffness_matrix<Dim>(points, materials.tangents(points)),
                         .forces = std::move(forces),
                         .mean = std::move(mean)},
                        traction, units, facet_shifts);
}

template <int Dim> UnitCellTensor effective_conductivity(const Approximation<Dim>& elements,
                                                         const std::vector<double>& conductivities,
                                                         FrameCondition condition, const Vector& facet_shifts) {
  require_elements(elements);
  const FineSpace<Dim>& space = elements.space;
  const FineMesh<Dim>& mesh = space.mesh();
  require(static_cast<Index>(conductivities.size()) == mesh.num_regions(),
          "effective_conductivity: a conductivity for each region of the mesh expected");
  const Frame<Dim> frame(mesh);
  require_sides(mesh, frame);
  double mean = 0.0;
  for (Index c = 0; c < mesh.num_cells(); ++c) mean += mesh.volume(c) / frame.volume() * conductivities[mesh.region(c)];
  SymmetricMatrix K = conduction_matrix(space, conductivities);
  Matrix forces(space.size(), Dim);
  if (condition == FrameCondition::uniform) {
    std::vector<Mat<Dim>> units(Dim, Mat<Dim>::Zero());
    for (int j = 0; j < Dim; ++j) units[j](0, j) = 1.0;
    forces = frame_forces<Dim>(space, frame, 1, units);
  } else {
    // Linear fields are in the space.
    forces = -(K.template selfadjointView<Eigen::Lower>() * Matrix(space.points().transpose()));
  }
  const auto traction = [&](Index region, const Vec<Dim>&, int axis) {
    Matrix by_gradient = Matrix::Zero(1, Dim);
    by_gradient(0, axis) = conductivities[region];
    return by_gradient;
  };
  return tensor_of<Dim>(
      space, frame, condition,
      {.components = 1, .K = std::move(K), .forces = std::move(forces), .mean = mean * Matrix::Identity(Dim, Dim)},
      traction, Matrix::Identity(Dim, Dim), facet_shifts);
}

template UnitCellTensor effective_stiffness<2>(const Approximation<2>&, const Materials<2>&, FrameCondition,
                                               const Vector&);
template UnitCellTensor effective_stiffness<3>(const Approximation<3>&, const Materials<3>&, FrameCondition,
                                               const Vector&);
template UnitCellTensor effective_conductivity<2>(const Approximation<2>&, const std::vector<double>&, FrameCondition,
                                                  const Vector&);
template UnitCellTensor effective_conductivity<3>(const Approximation<3>&, const std::vector<double>&, FrameCondition,
                                                  const Vector&);

}  // namespace efree
