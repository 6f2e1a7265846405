// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/loads.hpp"

#include "efree/assembly/internal/boundary_points.hpp"

namespace efree {

using internal::BoundaryPoint;
using internal::for_each_point;
using internal::place_text;
using internal::to_nodes;

template <int Dim>
Points<Dim> load_vector(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape, const Loads<Dim>& loads) {
  Points<Dim> fine = Points<Dim>::Zero(Dim, space.size());
  for (const auto& load : loads.tractions)
    for_each_point<Dim>(space, space.mesh().group(load.on), [&](const BoundaryPoint<Dim>& point) {
      const Vec<Dim> t = load.traction(point.x, point.n);
      if (!t.allFinite())
        throw InputError(fmt::format("traction on \"{}\" is {} at {}, expected finite numbers", load.on,
                                     place_text<Dim>(t), place_text<Dim>(point.x)));
      for (std::size_t i = 0; i < point.dofs.size(); ++i) fine.col(point.dofs[i]) += point.weight * point.N[i] * t;
    });
  if (loads.body_force) {
    const auto rule = simplex_rule<Dim>(4);
    for (Index c = 0; c < space.mesh().num_cells(); ++c)
      for (Index q = 0; q < rule.weights.size(); ++q) {
        const Vec<Dim> x = space.position(c, rule.points.col(q)), b = loads.body_force(x);
        if (!b.allFinite())
          throw InputError(
              fmt::format("body force is {} at {}, expected finite numbers", place_text<Dim>(b), place_text<Dim>(x)));
        const auto N = space.values(rule.points.col(q));
        const auto dofs = space.cell(c);
        for (std::size_t i = 0; i < dofs.size(); ++i)
          fine.col(dofs[i]) += space.mesh().volume(c) * rule.weights[q] * space.measure(x) * N[i] * b;
      }
  }
  return to_nodes(shape, fine);
}

template Points<2> load_vector<2>(const FineSpace<2>&, const ShapeTable<2>&, const Loads<2>&);
template Points<3> load_vector<3>(const FineSpace<3>&, const ShapeTable<3>&, const Loads<3>&);

}  // namespace efree
