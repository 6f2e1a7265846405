// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/equations/internal/side_by_side.hpp"

#include "efree/assembly/internal/lanes.hpp"
#include "efree/assembly/kinematics.hpp"
#include "efree/basis/fine_space.hpp"
#include "efree/core/parallel.hpp"

#include <algorithm>

namespace efree::internal {
namespace {

template <class Lanes> EFREE_INLINE void put(double* to, const Lanes& from) {
  std::memcpy(to, &from, sizeof from);
}

template <int Dim, class Lanes> EFREE_INLINE void strain_in(const Lanes* H, Lanes* strain) {
  if constexpr (Dim == 2) {
    strain[0] = H[0], strain[1] = H[3], strain[2] = H[4], strain[3] = H[1] + H[2];
  } else {
    strain[0] = H[0], strain[1] = H[4], strain[2] = H[8];
    strain[3] = H[5] + H[7], strain[4] = H[2] + H[6], strain[5] = H[1] + H[3];
  }
}

/// Puts these dilatations in the place of a strain's.
template <int Dim, class Lanes>
EFREE_INLINE void replace_dilatation(const double* dilatations, const double* swelling, Lanes* strain) {
  Lanes more;
  std::memcpy(&more, dilatations, sizeof more);
  more -= strain[0] + strain[1] + strain[2];
  for (int i = 0; i < voigt_size<Dim>; ++i) strain[i] += swelling[i] * more;
}

/// b = A a; A by columns.
template <int size, class Lanes> EFREE_INLINE void multiply(const double* A, const Lanes* a, Lanes* b) {
  for (int i = 0; i < size; ++i) b[i] = A[i] * a[0];
  for (int j = 1; j < size; ++j)
    for (int i = 0; i < size; ++i) b[i] += A[i + size * j] * a[j];
}

/// sum += a . b.
template <int size, class Lanes> EFREE_INLINE void add_dot(const Lanes* a, const Lanes* b, Lanes& sum) {
  for (int i = 0; i < size; ++i) sum += a[i] * b[i];
}

template <int Dim> struct Point {
  Index count;         ///< nodes
  const Index* nodes;  ///< of the row
  const double* dN;    ///< by node and direction
  const double* hoop;  ///< by node; none: zero
  const double *C, *swelling, *thinning;
  const double *u, *dilatations;
  PointResponse<Dim>* to;
};

template <int Dim, int lanes> EFREE_INLINE void respond_at(const Point<Dim>& at) {
  using Lanes = typename LanesOf<double, lanes>::type;
  constexpr int size = voigt_size<Dim>;
  Lanes H[gradient_size<Dim>] = {}, strain[size], stress[size];
  for (Index k = 0; k < at.count; ++k) {
    NodeLanes<double, Dim, lanes> u;
    u.load(at.u, at.nodes[k]);
    for (int J = 0; J < Dim; ++J)
      for (int i = 0; i < Dim; ++i) H[Dim * J + i] += at.dN[Dim * k + J] * u.of[i];
    if constexpr (Dim == 2)
      if (at.hoop) H[4] += at.hoop[k] * u.of[0];
  }
  strain_in<Dim>(H, strain);
  Lanes across = at.thinning[0] * strain[0];
  for (int i = 1; i < size; ++i) across += at.thinning[i] * strain[i];
  for (int i = 0; i < size; ++i) put(at.to->strain + lanes * i, i == 2 ? strain[2] + across : strain[i]);
  if (at.dilatations) replace_dilatation<Dim>(at.dilatations, at.swelling, strain);
  multiply<size>(at.C, strain, stress);
  for (int i = 0; i < size; ++i) put(at.to->stress + lanes * i, stress[i]);
  Lanes work = {};
  add_dot<size>(stress, strain, work);
  put(at.to->work, work);
}

template <int Dim> struct Cell {
  const UniformCell<Dim>* of;
  const double *displacement, *stress;
  CellSquares* to;
};

/// From the difference at the degrees of freedom, by the mass matrix; strains are linear.
template <int Dim, int degree, int lanes> EFREE_INLINE void compare_in(const Cell<Dim>& at) {
  using Lanes = typename LanesOf<double, lanes>::type;
  constexpr int size = voigt_size<Dim>, corners = Dim + 1, n = degree == 1 ? corners : FineSpace<Dim>::max_cell_size;
  const UniformCell<Dim>& cell = *at.of;
  NodeLanes<double, Dim, lanes> u[n];
  NodeLanes<double, size, lanes> difference[n];
  Lanes largest = {};
  for (int i = 0; i < n; ++i) {
    u[i].load(at.displacement, cell.dofs[i]);
    difference[i].load(at.stress, cell.places[i]);
    Lanes square = {};
    add_dot<Dim>(u[i].of, u[i].of, square);
    largest = square > largest ? square : largest;
  }
  put(at.to->displacement, largest);
  Lanes strain[corners][size], stress[corners][size];
  for (int corner = 0; corner < corners; ++corner) {
    Lanes H[gradient_size<Dim>] = {};
    for (int i = 0; i < n; ++i)
      for (int J = 0; J < Dim; ++J)
        for (int d = 0; d < Dim; ++d) H[Dim * J + d] += cell.dN[corner][Dim * i + J] * u[i].of[d];
    strain_in<Dim>(H, strain[corner]);
    if (cell.dilatations) replace_dilatation<Dim>(cell.dilatations, cell.stiffness->swelling.data(), strain[corner]);
    multiply<size>(cell.stiffness->C.data(), strain[corner], stress[corner]);
    for (int c = 0; c < size; ++c) difference[corner].of[c] -= stress[corner][c];
  }
  for (int i = 0, middle = corners; i < corners && degree == 2; ++i)
    for (int j = i + 1; j < corners; ++j, ++middle)
      for (int c = 0; c < size; ++c) difference[middle].of[c] -= 0.5 * (stress[i][c] + stress[j][c]);
  Lanes error = {};
  for (int j = 0; j < n; ++j) {
    Lanes column[size], of_column[size];
    for (int c = 0; c < size; ++c) column[c] = cell.root[j + n * j] * difference[j].of[c];
    for (int i = j + 1; i < n; ++i)
      for (int c = 0; c < size; ++c) column[c] += cell.root[i + n * j] * difference[i].of[c];
    multiply<size>(cell.stiffness->S.data(), column, of_column);
    add_dot<size>(column, of_column, error);
  }
  put(at.to->error, error);
  Lanes all_strains[size] = {}, all_stresses[size] = {}, norm = {};
  for (int corner = 0; corner < corners; ++corner) {
    for (int c = 0; c < size; ++c) all_strains[c] += strain[corner][c], all_stresses[c] += stress[corner][c];
    add_dot<size>(strain[corner], stress[corner], norm);
  }
  add_dot<size>(all_strains, all_stresses, norm);
  put(at.to->norm, norm * (1.0 / (corners * (corners + 1))));
}

/// Rows of a table, and what they take sums of.
struct Sums {
  Index begin, end;
  const Index *offsets, *points;
  const double *weights, *strain, *stress;
  double *to_strain, *to_stress;
};

template <int size> EFREE_INLINE void sum_rows(const Sums& of) {
  for (Index row = of.begin; row < of.end; ++row) {
    double strain[size] = {}, stress[size] = {};
    for (Index k = of.offsets[row]; k < of.offsets[row + 1]; ++k) {
      const std::ptrdiff_t at = std::ptrdiff_t{size} * of.points[k];
      for (int i = 0; i < size; ++i) strain[i] += of.weights[k] * of.strain[at + i];
      for (int i = 0; i < size; ++i) stress[i] += of.weights[k] * of.stress[at + i];
    }
    std::memcpy(of.to_strain + std::ptrdiff_t{size} * row, strain, sizeof strain);
    std::memcpy(of.to_stress + std::ptrdiff_t{size} * row, stress, sizeof stress);
  }
}
EFREE_FOR_EACH_MACHINE void sum_rows_2(const Sums& of) {
  sum_rows<voigt_size<2>>(of);
}
EFREE_FOR_EACH_MACHINE void sum_rows_3(const Sums& of) {
  sum_rows<voigt_size<3>>(of);
}

/// A point whose stresses work on its nodes.
template <int Dim> struct Loaded {
  Index count;         ///< nodes
  const Index* nodes;  ///< of the row
  const double* dN;    ///< by node and direction
  const double* hoop;  ///< by node; none: zero
  const double* stress;
  double* forces;
};

template <int Dim, int lanes> EFREE_INLINE void spread_at(const Loaded<Dim>& at) {
  using Lanes = typename LanesOf<double, lanes>::type;
  constexpr auto component = [] {  // of a stress in Voigt order
    if constexpr (Dim == 2)
      return std::array{std::array{0, 3}, std::array{3, 1}};
    else
      return std::array{std::array{0, 5, 4}, std::array{5, 1, 3}, std::array{4, 3, 2}};
  }();
  Lanes stress[voigt_size<Dim>];
  std::memcpy(stress, at.stress, sizeof stress);
  NodeLanes<double, Dim, lanes> force;
  for (Index k = 0; k < at.count; ++k) {
    force.load(at.forces, at.nodes[k]);
    for (int i = 0; i < Dim; ++i)
      for (int J = 0; J < Dim; ++J) force.of[i] += at.dN[Dim * k + J] * stress[component[i][J]];
    if constexpr (Dim == 2)
      if (at.hoop) force.of[0] += at.hoop[k] * stress[2];
    force.store(at.forces, at.nodes[k]);
  }
}
EFREE_FOR_EACH_MACHINE void spread_2(Index lanes, const Loaded<2>& at) {
  lanes == 4 ? spread_at<2, 4>(at) : spread_at<2, 8>(at);
}
EFREE_FOR_EACH_MACHINE void spread_3(Index lanes, const Loaded<3>& at) {
  lanes == 4 ? spread_at<3, 4>(at) : spread_at<3, 8>(at);
}

template <int Dim> EFREE_INLINE void respond_in(Index lanes, const Point<Dim>& at) {
  if (lanes == 1)
    respond_at<Dim, 1>(at);
  else if (lanes == 4)
    respond_at<Dim, 4>(at);
  else
    respond_at<Dim, 8>(at);
}
EFREE_FOR_EACH_MACHINE void respond_2(Index lanes, const Point<2>& at) {
  respond_in<2>(lanes, at);
}
EFREE_FOR_EACH_MACHINE void respond_3(Index lanes, const Point<3>& at) {
  respond_in<3>(lanes, at);
}

template <int Dim, int degree> EFREE_INLINE void compare_lanes(Index lanes, const Cell<Dim>& at) {
  if (lanes == 1)
    compare_in<Dim, degree, 1>(at);
  else if (lanes == 4)
    compare_in<Dim, degree, 4>(at);
  else
    compare_in<Dim, degree, 8>(at);
}
EFREE_FOR_EACH_MACHINE void compare_2(int degree, Index lanes, const Cell<2>& at) {
  degree == 1 ? compare_lanes<2, 1>(lanes, at) : compare_lanes<2, 2>(lanes, at);
}
EFREE_FOR_EACH_MACHINE void compare_3(int degree, Index lanes, const Cell<3>& at) {
  degree == 1 ? compare_lanes<3, 1>(lanes, at) : compare_lanes<3, 2>(lanes, at);
}

}  // namespace

template <int Rows> SideBySide<Rows>::SideBySide(const std::vector<const Points<Rows>*>& all, std::size_t first)
    : count_(static_cast<Index>(std::min<std::size_t>(all.size() - first, most_side_by_side))),
      lanes_(count_ == 1   ? 1
             : count_ <= 4 ? 4
                           : most_side_by_side) {
  if (count_ == 1) {
    alone_ = all[first];
    return;
  }
  const Index columns = static_cast<Index>(all[first]->cols());
  values_.resize(static_cast<std::size_t>(Rows * lanes_) * columns);
  parallel_chunks(columns, 4096, [&](Index begin, Index end) {
    double* to = values_.data() + static_cast<std::ptrdiff_t>(Rows * lanes_) * begin;
    for (Index column = begin; column < end; ++column)
      for (int row = 0; row < Rows; ++row, to += lanes_)
        for (Index lane = 0; lane < count_; ++lane) to[lane] = (*all[first + lane])(row, column);
  });
}

template <int Dim> void respond(const SideBySide<Dim>& u, const ShapeRow<Dim>& row, const Stiffness<Dim>& stiffness,
                                const double* dilatations, PointResponse<Dim>& to) {
  const Point<Dim> at{.count = static_cast<Index>(row.nodes.size()),
                      .nodes = row.nodes.data(),
                      .dN = row.dN.front().data(),
                      .hoop = row.hoop.empty() ? nullptr : row.hoop.data(),
                      .C = stiffness.C.data(),
                      .swelling = stiffness.swelling.data(),
                      .thinning = stiffness.thinning.data(),
                      .u = u.data(),
                      .dilatations = dilatations,
                      .to = &to};
  if constexpr (Dim == 2)
    respond_2(u.lanes(), at);
  else
    respond_3(u.lanes(), at);
}

template <int Dim> void compare(const SideBySide<Dim>& displacement, const SideBySide<voigt_size<Dim>>& stress,
                                int degree, const UniformCell<Dim>& cell, CellSquares& to) {
  const Cell<Dim> at{.of = &cell, .displacement = displacement.data(), .stress = stress.data(), .to = &to};
  if constexpr (Dim == 2)
    compare_2(degree, displacement.lanes(), at);
  else
    compare_3(degree, displacement.lanes(), at);
}

template <int Dim> void weighted_sums(const SparseRows& weights, const VoigtPoints<Dim>& strain,
                                      const VoigtPoints<Dim>& stress, VoigtPoints<Dim>& to_strain,
                                      VoigtPoints<Dim>& to_stress) {
  parallel_chunks(static_cast<Index>(weights.rows()), 1024, [&](Index begin, Index end) {
    const Sums of{.begin = begin,
                  .end = end,
                  .offsets = weights.outerIndexPtr(),
                  .points = weights.innerIndexPtr(),
                  .weights = weights.valuePtr(),
                  .strain = strain.data(),
                  .stress = stress.data(),
                  .to_strain = to_strain.data(),
                  .to_stress = to_stress.data()};
    if constexpr (Dim == 2)
      sum_rows_2(of);
    else
      sum_rows_3(of);
  });
}

template <int Dim> std::vector<Points<Dim>> forces_of_stresses(const Discretization<Dim>& discretization,
                                                               const std::vector<const VoigtPoints<Dim>*>& stresses) {
  if (stresses.size() == 1) return {forces_of_stress(discretization, *stresses.front())};
  constexpr int size = voigt_size<Dim>;
  const auto count = static_cast<Index>(stresses.size());
  const Index nodes = discretization.shape.num_nodes();
  std::vector<Points<Dim>> forces(stresses.size());
  // Each thread has some of them, and all points.
  const Index share = std::clamp((count + num_threads() - 1) / num_threads(), Index{2}, most_side_by_side);
  parallel_chunks(count, share, [&](Index begin, Index end) {
    const Index lanes = end - begin <= 4 ? 4 : most_side_by_side;
    std::vector<double> packed(static_cast<std::size_t>(Dim * lanes) * nodes, 0.0);
    std::array<double, std::size_t{size} * most_side_by_side> stress{};
    for (Index K = 0; K < discretization.size(); ++K) {
      for (Index lane = 0; lane < end - begin; ++lane) {
        const double* const from = stresses[begin + lane]->col(K).data();
        for (int i = 0; i < size; ++i) stress[i * lanes + lane] = discretization.weights[K] * from[i];
      }
      const auto row = discretization.shape.row(K);
      const Loaded<Dim> at{.count = static_cast<Index>(row.nodes.size()),
                           .nodes = row.nodes.data(),
                           .dN = row.dN.front().data(),
                           .hoop = row.hoop.empty() ? nullptr : row.hoop.data(),
                           .stress = stress.data(),
                           .forces = packed.data()};
      if constexpr (Dim == 2)
        spread_2(lanes, at);
      else
        spread_3(lanes, at);
    }
    for (Index lane = 0; lane < end - begin; ++lane) {
      Points<Dim>& to = forces[begin + lane];
      to.resize(Dim, nodes);
      for (std::ptrdiff_t i = 0; i < to.size(); ++i) to.data()[i] = packed[i * lanes + lane];
    }
  });
  return forces;
}

template class SideBySide<2>;
template class SideBySide<3>;
template class SideBySide<4>;
template class SideBySide<6>;
template void respond<2>(const SideBySide<2>&, const ShapeRow<2>&, const Stiffness<2>&, const double*,
                         PointResponse<2>&);
template void respond<3>(const SideBySide<3>&, const ShapeRow<3>&, const Stiffness<3>&, const double*,
                         PointResponse<3>&);
template void compare<2>(const SideBySide<2>&, const SideBySide<4>&, int, const UniformCell<2>&, CellSquares&);
template void compare<3>(const SideBySide<3>&, const SideBySide<6>&, int, const UniformCell<3>&, CellSquares&);
template void weighted_sums<2>(const SparseRows&, const VoigtPoints<2>&, const VoigtPoints<2>&, VoigtPoints<2>&,
                               VoigtPoints<2>&);
template void weighted_sums<3>(const SparseRows&, const VoigtPoints<3>&, const VoigtPoints<3>&, VoigtPoints<3>&,
                               VoigtPoints<3>&);
template std::vector<Points<2>> forces_of_stresses<2>(const Discretization<2>&,
                                                      const std::vector<const VoigtPoints<2>*>&);
template std::vector<Points<3>> forces_of_stresses<3>(const Discretization<3>&,
                                                      const std::vector<const VoigtPoints<3>*>&);

}  // namespace efree::internal
