// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/result.hpp"

#include "efree/core/parallel.hpp"

#include <Eigen/Eigenvalues>
#include <array>

namespace efree {

template <int Dim> Vector von_mises_at_places(const Fields<Dim>& fields) {
  const auto& stress = fields.stress;
  Vector mises(stress.cols());
  for (Index p = 0; p < mises.size(); ++p) mises[p] = von_mises<Dim>(Voigt<Dim>(stress.col(p)));
  return mises;
}

template <int Dim> std::vector<FieldRange<Dim>> field_ranges(const FineSpace<Dim>& space, const Fields<Dim>& fields) {
  std::vector<FieldRange<Dim>> ranges;
  const auto add = [&](const std::string& of, const auto& most_values, const auto& least_values) {
    Index most = 0, least = 0;
    const double largest = most_values.maxCoeff(&most), smallest = least_values.minCoeff(&least);
    ranges.push_back(
        {of, largest, smallest, space.points().col(space.dof_at(most)), space.points().col(space.dof_at(least))});
  };
  constexpr std::array axes{"x", "y", "z"};
  for (int d = 0; d < Dim; ++d) {
    const Vector u = fields.displacement.row(d);
    add(std::string("displacement_") + axes[d], u, u);
  }
  const auto names = component_names<Dim>(space.axisymmetric());
  for (const auto& [what, values] : {std::pair("strain_", &fields.strain), std::pair("stress_", &fields.stress)})
    for (std::size_t i = 0; i < names.size(); ++i) {
      const Vector component = values->row(static_cast<Index>(i));
      add(std::string(what) + names[i], component, component);
    }
  Vector first(fields.stress.cols()), third(fields.stress.cols());
  parallel_for(static_cast<Index>(fields.stress.cols()), [&](Index p) {
    const auto s = fields.stress.col(p);
    Mat<3> sigma;
    if constexpr (Dim == 2)
      sigma << s[0], s[3], 0.0, s[3], s[1], 0.0, 0.0, 0.0, s[2];
    else
      sigma << s[0], s[5], s[4], s[5], s[1], s[3], s[4], s[3], s[2];
    const Vec<3> principal =
        Eigen::SelfAdjointEigenSolver<Mat<3>>().computeDirect(sigma, Eigen::EigenvaluesOnly).eigenvalues();
    first[p] = principal[2];
    third[p] = principal[0];
  });
  add("principal_stress", first, third);
  return ranges;
}

template std::vector<FieldRange<2>> field_ranges<2>(const FineSpace<2>&, const Fields<2>&);
template std::vector<FieldRange<3>> field_ranges<3>(const FineSpace<3>&, const Fields<3>&);
template Vector von_mises_at_places<2>(const Fields<2>&);
template Vector von_mises_at_places<3>(const Fields<3>&);

}  // namespace efree
