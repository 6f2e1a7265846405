// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/operators.hpp"

#include "efree/assembly/internal/matrix_pattern.hpp"
#include "efree/core/parallel.hpp"

namespace efree {
template <int Dim> Gradients<Dim> gradient(const Discretization<Dim>& discretization, const Points<Dim>& U) {
  Gradients<Dim> result(gradient_size<Dim>, discretization.size());
  parallel_for(discretization.size(), [&](Index K) {
    const auto row = discretization.shape.row(K);
    Gradient<Dim> sum = Gradient<Dim>::Zero();
    for (std::size_t k = 0; k < row.nodes.size(); ++k) sum += nodal_gradient(row, k).of(U.col(row.nodes[k]));
    result.col(K) = sum;
  });
  return result;
}

template <int Dim> VoigtPoints<Dim> strain(const Discretization<Dim>& discretization, const Points<Dim>& U) {
  const Gradients<Dim> H = gradient(discretization, U);
  VoigtPoints<Dim> result(voigt_size<Dim>, H.cols());
  for (Index K = 0; K < discretization.size(); ++K) result.col(K) = strain_of<Dim>(H.col(K));
  return result;
}

template <int Dim> Points<Dim> internal_force(const Discretization<Dim>& discretization, const Gradients<Dim>& P) {
  const NodePlaces& by_node = discretization.shape.by_node();
  Points<Dim> force(Dim, discretization.shape.num_nodes());
  parallel_for(discretization.shape.num_nodes(), [&](Index a) {
    Vec<Dim> sum = Vec<Dim>::Zero();
    for (const auto& [K, k] : by_node[a])
      sum += discretization.weights[K] * nodal_gradient(discretization.shape.row(K), k).force(P.col(K));
    force.col(a) = sum;
  });
  return force;
}

template <int Dim>
Points<Dim> forces_of_stress(const Discretization<Dim>& discretization, const VoigtPoints<Dim>& stress) {
  const auto of = [&](Index K, const ShapeRow<Dim>& row, std::size_t k) {
    const Voigt<Dim> there = discretization.weights[K] * stress.col(K);
    Vec<Dim> f = traction<Dim>(there, row.dN[k]);
    if (Dim == 2 && !row.hoop.empty()) f[0] += row.hoop[k] * there[2];
    return f;
  };
  Points<Dim> force = Points<Dim>::Zero(Dim, discretization.shape.num_nodes());
  if (num_threads() == 1) {  // the same sums, from memory as it comes
    for (Index K = 0; K < discretization.size(); ++K) {
      const auto row = discretization.shape.row(K);
      for (std::size_t k = 0; k < row.nodes.size(); ++k) force.col(row.nodes[k]) += of(K, row, k);
    }
    return force;
  }
  const NodePlaces& by_node = discretization.shape.by_node();
  parallel_for(discretization.shape.num_nodes(), [&](Index a) {
    Vec<Dim> sum = Vec<Dim>::Zero();
    for (const auto& [K, k] : by_node[a]) sum += of(K, discretization.shape.row(K), k);
    force.col(a) = sum;
  });
  return force;
}

template <int Dim>
SymmetricMatrix stiffness_matrix(const Discretization<Dim>& discretization, const PointTangents<Dim>& A) {
  const Index nodes = discretization.shape.num_nodes();
  const internal::MatrixPattern<Dim> pattern(nodes, {&discretization.shape}, {});
  SymmetricMatrix K;
  pattern.sum(
      internal::Unknowns<Dim>(nodes, {}),
      [&](Index a, internal::BlockColumn<Dim>& column) { internal::add_stiffness(discretization, A, a, column); }, {},
      K);
  return K;
}

template Gradients<2> gradient<2>(const Discretization<2>&, const Points<2>&);
template VoigtPoints<2> strain<2>(const Discretization<2>&, const Points<2>&);
template Points<2> internal_force<2>(const Discretization<2>&, const Gradients<2>&);
template Points<2> forces_of_stress<2>(const Discretization<2>&, const VoigtPoints<2>&);
template SymmetricMatrix stiffness_matrix<2>(const Discretization<2>&, const PointTangents<2>&);
template Gradients<3> gradient<3>(const Discretization<3>&, const Points<3>&);
template VoigtPoints<3> strain<3>(const Discretization<3>&, const Points<3>&);
template Points<3> internal_force<3>(const Discretization<3>&, const Gradients<3>&);
template Points<3> forces_of_stress<3>(const Discretization<3>&, const VoigtPoints<3>&);
template SymmetricMatrix stiffness_matrix<3>(const Discretization<3>&, const PointTangents<3>&);

}  // namespace efree
