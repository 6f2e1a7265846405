// SPDX-License-Identifier: GPL-3.0-or-later
/// Numbers at points of a body that people ask for by name.
#pragma once

#include "efree/analysis/result.hpp"
#include "efree/assembly/kinematics.hpp"
#include "efree/solvers/cells/cell_fields.hpp"

#include <optional>
#include <string>
#include <vector>

namespace efree {

/// "displacement_x", ..., "strain_xx", ..., "stress_xx", ...: components as component_names has them.
template <int Dim> std::vector<std::string> component_field_names(bool axisymmetric);

/// One number of the displacement, strain or stress at a point: "displacement" (its length), those of
/// component_field_names, "von_mises", "mean_stress", "principal_stress_1" (the largest), "principal_stress_2",
/// "principal_stress_3".
template <int Dim> class PointField {
 public:
  /// All names.
  static std::vector<std::string> names(bool axisymmetric);
  /// The field of that name, if there is one.
  static std::optional<PointField> find(const std::string& name, bool axisymmetric);

  double operator()(const Vec<Dim>& displacement, const Voigt<Dim>& strain, const Voigt<Dim>& stress) const;
  /// Whether it is of the displacement alone.
  bool is_of_displacement() const { return number_ <= Dim; }
  /// Likewise of the stress.
  bool is_of_stress() const { return number_ > Dim + voigt_size<Dim>; }

 private:
  explicit PointField(int number) : number_(number) {}
  int number_;  ///< in `names`
};

/// Ranges of the components and of the principal stresses on cells, as field_ranges has them on meshes.
std::vector<FieldRange<3>> field_ranges(const CellFields& fields);

}  // namespace efree
