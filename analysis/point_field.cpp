// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/point_field.hpp"

#include <algorithm>
#include <array>

namespace efree {

template <int Dim> std::vector<std::string> component_field_names(bool axisymmetric) {
  std::vector<std::string> names;
  constexpr std::array axes{"x", "y", "z"};
  for (std::size_t d = 0; d < Dim; ++d) names.push_back(std::string("displacement_") + axes[d]);
  for (const char* what : {"strain_", "stress_"})
    for (const char* component : component_names<Dim>(axisymmetric)) names.push_back(what + std::string(component));
  return names;
}

template <int Dim> std::vector<std::string> PointField<Dim>::names(bool axisymmetric) {
  std::vector<std::string> all = component_field_names<Dim>(axisymmetric);
  all.insert(all.begin(), "displacement");
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

std::vector<FieldRange<3>> field_ranges(const CellFields& fields) {
  std::vector<std::string> names = component_field_names<3>(false);
  names.emplace_back("principal_stress");
  std::vector<FieldRange<3>> ranges;
  for (std::size_t r = 0; r < names.size(); ++r) {
    const PlacedRange& range = fields.ranges[r];
    ranges.push_back({names[r], range.most, range.least, range.most_at, range.least_at});
  }
  return ranges;
}

template std::vector<std::string> component_field_names<2>(bool);
template std::vector<std::string> component_field_names<3>(bool);
template class PointField<2>;
template class PointField<3>;

}  // namespace efree
