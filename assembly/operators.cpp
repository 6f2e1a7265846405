// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/operators.hpp"

#include "efree/assembly/internal/gather.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"

#include <fmt/format.h>

namespace efree {
namespace {

template <int Dim> Ragged<Place> places_in(const ShapeTable<Dim>& shape) {
  return places_of_nodes(shape.num_nodes(), shape.num_points(), [&](Index p) { return shape.row(p).nodes; });
}

}  // namespace

template <> Eigen::Matrix<double, 3, 2> strain_matrix<2, 2>(const Vec<2>& dN, double) {
  Eigen::Matrix<double, 3, 2> B;
  B << dN.x(), 0.0, 0.0, dN.y(), dN.y(), dN.x();
  return B;
}

template <> Eigen::Matrix<double, 4, 2> strain_matrix<2, 3>(const Vec<2>& dN, double hoop) {
  Eigen::Matrix<double, 4, 2> B;
  B << dN.x(), 0.0,  //
      0.0, dN.y(),   //
      hoop, 0.0,     //
      dN.y(), dN.x();
  return B;
}

template <> Eigen::Matrix<double, 6, 3> strain_matrix<3, 3>(const Vec<3>& dN, double) {
  Eigen::Matrix<double, 6, 3> B;
  B << dN.x(), 0.0, 0.0,    //
      0.0, dN.y(), 0.0,     //
      0.0, 0.0, dN.z(),     //
      0.0, dN.z(), dN.y(),  //
      dN.z(), 0.0, dN.x(),  //
      dN.y(), dN.x(), 0.0;
  return B;
}

template <int Dim> VoigtPoints<Dim> strain(const Discretization<Dim>& discretization, const Points<Dim>& U) {
  return with_normals<Dim>(discretization.axisymmetric(), [&]<int Normals>(Number<Normals>) {
    VoigtPoints<Dim> result(voigt_size<Dim, Normals>, discretization.size());
    parallel_for(discretization.size(), [&](Index K) {
      const auto row = discretization.shape.row(K);
      Voigt<Dim, Normals> sum = Voigt<Dim, Normals>::Zero();
      for (std::size_t k = 0; k < row.nodes.size(); ++k)
        sum += strain_matrix<Dim, Normals>(row, k) * U.col(row.nodes[k]);
      result.col(K) = sum;
    });
    return result;
  });
}

template <int Dim>
Points<Dim> internal_force(const Discretization<Dim>& discretization, const VoigtPoints<Dim>& stress) {
  const auto by_node = places_in(discretization.shape);
  Points<Dim> force(Dim, discretization.shape.num_nodes());
  with_normals<Dim>(discretization.axisymmetric(), [&]<int Normals>(Number<Normals>) {
    parallel_for(discretization.shape.num_nodes(), [&](Index a) {
      Vec<Dim> sum = Vec<Dim>::Zero();
      for (const auto& [K, k] : by_node[a])
        sum += discretization.weights[K] *
               (strain_matrix<Dim, Normals>(discretization.shape.row(K), k).transpose() * stress.col(K));
      force.col(a) = sum;
    });
  });
  return force;
}

template <int Dim, int Size> SymmetricMatrix stiffness_matrix(const Discretization<Dim>& discretization,
                                                              const std::vector<Eigen::Matrix<double, Size, Size>>& C) {
  constexpr int Normals = Size - Dim * (Dim - 1) / 2;
  if ((Normals > Dim) != discretization.axisymmetric())
    throw InputError(fmt::format("stiffness: a matrix of {} rows for {} strains", Size,
                                 voigt_size<Dim> + (discretization.axisymmetric() ? 1 : 0)));
  const ShapeTable<Dim>& shape = discretization.shape;
  const auto by_node = places_in(shape);
  return gather_blocks<Dim>(shape.num_nodes(), [&](Index a, Accumulator<Mat<Dim>>& sums) {
    for (const auto& [K, k] : by_node[a]) {
      const auto row = shape.row(K);
      const Eigen::Matrix<double, Size, Dim> CBa =
          discretization.weights[K] * (C[discretization.region[K]] * strain_matrix<Dim, Normals>(row, k));
      for (std::size_t l = k; l < row.nodes.size(); ++l)
        sums[row.nodes[l]].noalias() += strain_matrix<Dim, Normals>(row, l).transpose() * CBa;
    }
  });
}

template VoigtPoints<2> strain<2>(const Discretization<2>&, const Points<2>&);
template Points<2> internal_force<2>(const Discretization<2>&, const VoigtPoints<2>&);
template SymmetricMatrix stiffness_matrix<2>(const Discretization<2>&, const std::vector<VoigtMatrix<2>>&);
template SymmetricMatrix stiffness_matrix<2>(const Discretization<2>&, const std::vector<VoigtMatrix<2, 3>>&);
template VoigtPoints<3> strain<3>(const Discretization<3>&, const Points<3>&);
template Points<3> internal_force<3>(const Discretization<3>&, const VoigtPoints<3>&);
template SymmetricMatrix stiffness_matrix<3>(const Discretization<3>&, const std::vector<VoigtMatrix<3>>&);

}  // namespace efree
