// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/point_field.hpp"

#include "efree/analysis/result.hpp"

#include <algorithm>

namespace efree {

template <int Dim> std::vector<std::string> PointField<Dim>::names(bool axisymmetric) {
  std::vector<std::string> all{"displacement"};
  for (const char axis : {'x', 'y', 'z'})
    if (static_cast<int>(all.size()) <= Dim) all.push_back(std::string("displacement_") + axis);
  for (const char* what : {"strain_", "stress_"})
    for (const char* component : component_names<Dim>(axisymmetric)) all.push_back(what + std::string(component));
  for (const char* one : {"von_mises", "mean_stress", "principal_stress_1", "principal_stress_2", "principal_stress_3"})
    all.emplace_back(one);
  return all;
}

template <int Dim> std::optional<PointField<Dim>> PointField<Dim>::find(const std::string& name, bool axisymmetric) {
  const std::vector<std::string> all = names(axisymmetric);
  const auto found = std::ranges::find(all, name);
  return found == all.end() ? std::nullopt : std::optional(PointField(static_cast<int>(found - all.begin())));
}

template <int Dim> double PointField<Dim>::operator()(const Vec<Dim>& displacement, const Voigt<Dim>& strain,
                                                      const Voigt<Dim>& stress) const {
  constexpr int size = voigt_size<Dim>, first_strain = Dim + 1, first_stress = first_strain + size;
  if (number_ == 0) return displacement.norm();
  if (number_ < first_strain) return displacement[number_ - 1];
  if (number_ < first_stress) return strain[number_ - first_strain];
  const double trace = stress[0] + stress[1] + stress[2];
  switch (const int scalar = number_ - first_stress - size; scalar) {
    case 0:
      return von_mises<Dim>(stress);
    case 1:
      return trace / 3.0;
    case 2:
    case 3:
    case 4: {
      const auto [first, third] = principal_stresses<Dim>(stress);
      return scalar == 2 ? first : scalar == 4 ? third : trace - first - third;
    }
    default:
      return stress[number_ - first_stress];
  }
}

template class PointField<2>;
template class PointField<3>;

}  // namespace efree
