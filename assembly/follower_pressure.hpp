// SPDX-License-Identifier: GPL-3.0-or-later
/// Pressure that follows the body: on its boundary as it is now, against its normal as it is now.
#pragma once

#include "efree/assembly/conditions.hpp"
#include "efree/assembly/resultants.hpp"
#include "efree/basis/fine_space.hpp"
#include "efree/basis/shape_table.hpp"

#include <string>
#include <utility>
#include <vector>

namespace efree {

/// The same loads with these pressures on the area and along the normal at rest, to first order in displacements: as
/// tractions of the kind "follower_pressure".
template <int Dim> Loads<Dim> at_rest(Loads<Dim> loads);

/// The parts of a boundary under such pressures, f_a = - int phi_a p J F^-T N dA (Nanson's formula; Bonet & Wood 2008,
/// section 8.5), F from the displacement of the fine mesh, axisymmetric with the stretch of the hoops. In the plane
/// pressures are forces per length as it is and per thickness at rest.
template <int Dim> class FollowerPressures {
 public:
  /// Throws InputError for an unknown boundary.
  FollowerPressures(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                    const std::vector<FollowerPressure<Dim>>& on);

  /// Functions at the points where pressures are integrated.
  const ShapeTable<Dim>& table() const { return table_; }
  bool empty() const { return points_.empty(); }
  /// Pressure by point, of conditions on the same parts in the same order. Throws InputError where it is not finite.
  Vector at_points(const std::vector<FollowerPressure<Dim>>& pressures) const;
  /// Forces of the pressures on coefficients (Dim x N), which are U.
  Points<Dim> forces(const Vector& pressure, const Points<Dim>& U) const;
  /// By part, in their order: what they amount to, moments about the origin of forces where they are now.
  std::vector<std::pair<std::string, Resultant<Dim>>> resultants(const Vector& pressure, const Points<Dim>& U) const;

  /// What the stiffness of the load at a point is made of.
  struct Now {
    double size;  ///< pressure times volume ratio and area at rest
    double hoop;  ///< stretch
    Vec<Dim> m;   ///< F^-T N
    Mat<Dim> inverse_transposed;
  };
  std::vector<Now> now(const Vector& pressure, const Points<Dim>& U) const;
  /// d(forces) / dU dU.
  Points<Dim> changes(const std::vector<Now>& now, const Points<Dim>& dU) const;
  /// Of the part that is not symmetric, which vanishes for a pressure that is the same everywhere on a closed surface
  /// or one that ends where the body is held or at planes of symmetry.
  Points<Dim> unsymmetric_changes(const std::vector<Now>& now, const Points<Dim>& dU) const;
  /// Adds the symmetric part of - d(forces) / dU to the blocks of the column of node a.
  template <class Column> void add_stiffness(const std::vector<Now>& now, Index a, Column& column) const {
    for (const auto& [q, k] : table_.by_node()[a]) {
      const auto row = table_.row(q);
      const Vec<Dim> ga = now[q].inverse_transposed * row.dN[k];
      for (std::size_t l = k; l < row.nodes.size(); ++l) {
        const Vec<Dim> gb = now[q].inverse_transposed * row.dN[l];
        Mat<Dim> block = now[q].hoop * (now[q].m * (row.N[l] * ga - row.N[k] * gb).transpose() -
                                        (row.N[l] * ga - row.N[k] * gb) * now[q].m.transpose());
        if (!row.hoop.empty()) {
          block.col(0) += row.N[l] * row.hoop[k] * now[q].m;
          block.row(0) += row.N[k] * row.hoop[l] * now[q].m.transpose();
        }
        column[row.nodes[l]] += 0.5 * now[q].size * block;
      }
    }
  }

 private:
  struct Point {
    std::size_t part;
    Vec<Dim> x, n;
    double weight;
  };

  std::vector<std::string> parts_;
  std::vector<Point> points_;
  ShapeTable<Dim> table_;
};

}  // namespace efree
