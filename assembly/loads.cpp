// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/loads.hpp"

#include "efree/assembly/internal/boundary_points.hpp"

#include <Eigen/Geometry>

namespace efree {
namespace {

using internal::BoundaryPoint;
using internal::for_each_point;
using internal::place_text;
using internal::to_nodes;

/// Calls put(degree of freedom of the space, force) for the forces of a traction; several at one degree of freedom.
template <int Dim, class Put>
void spread(const FineSpace<Dim>& space, const TractionCondition<Dim>& load, const Put& put) {
  for_each_point<Dim>(space, space.mesh().group(load.on), [&](const BoundaryPoint<Dim>& point) {
    const Vec<Dim> t = load.traction(point.x, point.n);
    if (!t.allFinite())
      throw InputError(fmt::format("{} on \"{}\" is {} at {}, expected finite numbers", load.kind, load.on,
                                   place_text<Dim>(t), place_text<Dim>(point.x)));
    for (std::size_t i = 0; i < point.dofs.size(); ++i) put(point.dofs[i], point.weight * point.N[i] * t);
  });
}
/// Likewise those of a resultant.
template <int Dim, class Put> void spread(const FineSpace<Dim>& space, const ResultantLoad<Dim>& load, const Put& put) {
  if (space.axisymmetric() && (load.force[0] != 0.0 || !load.moment.isZero(0.0) || (load.at && (*load.at)[0] != 0.0)))
    throw InputError(fmt::format(
        "force on \"{}\": around an axis of revolution only forces along it, [0, F], have a resultant", load.on));
  AreaMoments<Dim> part;
  for_each_point<Dim>(space, space.mesh().group(load.on),
                      [&](const BoundaryPoint<Dim>& point) { part.add(point.x, point.weight); });
  if (!space.axisymmetric()) return spread(space, part.traction(load), put);
  const Vec<Dim> t = load.force / part.area;
  spread(space, TractionCondition<Dim>{load.on, [t](const Vec<Dim>&, const Vec<Dim>&) { return t; }, "force"}, put);
}
/// Likewise those of a force per volume, from region and place.
template <int Dim, class Force, class Put>
void spread_inside(const FineSpace<Dim>& space, const std::string& kind, const Force& force, const Put& put) {
  const auto rule = simplex_rule<Dim>(4);
  for (Index c = 0; c < space.mesh().num_cells(); ++c)
    for (Index q = 0; q < rule.weights.size(); ++q) {
      const Vec<Dim> x = space.position(c, rule.points.col(q)), b = force(space.mesh().region(c), x);
      if (!b.allFinite())
        throw InputError(
            fmt::format("{} is {} at {}, expected finite numbers", kind, place_text<Dim>(b), place_text<Dim>(x)));
      const auto N = space.values(rule.points.col(q));
      const auto dofs = space.cell(c);
      for (std::size_t i = 0; i < dofs.size(); ++i)
        put(dofs[i], space.mesh().volume(c) * rule.weights[q] * space.measure(x) * N[i] * b);
    }
}

/// Calls visit(part, kind, what spreads it) for every load.
template <int Dim, class Visit>
void for_each_load(const FineSpace<Dim>& space, const Loads<Dim>& loads, const Visit& visit) {
  if (!loads.followers.empty())
    throw InputError(fmt::format("pressure on \"{}\" follows the body, which is taken to be at rest here",
                                 loads.followers.front().on));
  for (const auto& load : loads.tractions)
    visit(load.on, load.kind, [&](const auto& put) { spread(space, load, put); });
  for (const auto& load : loads.resultants)
    visit(load.on, std::string("force"), [&](const auto& put) { spread(space, load, put); });
  if (loads.body_force)
    visit("", std::string("body_force"), [&](const auto& put) {
      spread_inside(
          space, "body force", [&](Index, const Vec<Dim>& x) { return loads.body_force(x); }, put);
    });
  if (loads.mass_forces.empty()) return;
  require(static_cast<Index>(loads.density.size()) == space.mesh().num_regions(),
          "accelerations and rotations need a density for every region");
  for (const auto& load : loads.mass_forces)
    visit("", load.kind, [&](const auto& put) {
      spread_inside(
          space, "the force by the " + load.kind,
          [&](Index region, const Vec<Dim>& x) {
            Vec<3> place = Vec<3>::Zero();
            place.head<Dim>() = x;
            return Vec<Dim>(loads.density[region].at(place) * load.per_mass(x));
          },
          put);
    });
}

}  // namespace

template <int Dim> TractionCondition<Dim> AreaMoments<Dim>::traction(const ResultantLoad<Dim>& load) const {
  const Vec<Dim> c = first / area, a = load.force / area;
  const Mat<Dim> spread = second - area * c * c.transpose();  // about the centroid
  Moment<Dim> moment = load.moment;
  if (load.at) moment += moment_of<Dim>(*load.at - c, load.force);
  Vec<3> w = Vec<3>::Zero();
  if constexpr (Dim == 2)
    w[2] = moment[0] / spread.trace();
  else
    w = (spread.trace() * Mat<3>::Identity() - spread).ldlt().solve(moment);
  return {load.on,
          [a, c, w](const Vec<Dim>& x, const Vec<Dim>&) -> Vec<Dim> {
            Vec<3> arm = Vec<3>::Zero();
            arm.template head<Dim>() = x - c;
            return a + w.cross(arm).template head<Dim>();
          },
          "force"};
}

template <int Dim>
Points<Dim> load_vector(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape, const Loads<Dim>& loads) {
  Points<Dim> fine = Points<Dim>::Zero(Dim, space.size());
  for_each_load(space, loads, [&](const std::string&, const std::string&, const auto& spread) {
    spread([&](Index dof, const Vec<Dim>& force) { fine.col(dof) += force; });
  });
  return to_nodes(shape, fine);
}

template <int Dim> std::vector<AppliedLoad<Dim>> applied_loads(const FineSpace<Dim>& space, const Loads<Dim>& loads,
                                                               const Points<Dim>* moved_by) {
  std::vector<AppliedLoad<Dim>> applied;
  for_each_load(space, loads, [&](const std::string& on, const std::string& kind, const auto& spread) {
    Resultant<Dim> sum;
    spread([&](Index dof, const Vec<Dim>& force) {
      Vec<Dim> x = space.points().col(dof);
      if (moved_by) x += moved_by->col(dof);
      sum.add(x, force);
    });
    if (space.axisymmetric()) sum.moment.setZero();
    applied.push_back({on, kind, sum});
  });
  return applied;
}

template struct AreaMoments<2>;
template struct AreaMoments<3>;
template Points<2> load_vector<2>(const FineSpace<2>&, const ShapeTable<2>&, const Loads<2>&);
template Points<3> load_vector<3>(const FineSpace<3>&, const ShapeTable<3>&, const Loads<3>&);
template std::vector<AppliedLoad<2>> applied_loads<2>(const FineSpace<2>&, const Loads<2>&, const Points<2>*);
template std::vector<AppliedLoad<3>> applied_loads<3>(const FineSpace<3>&, const Loads<3>&, const Points<3>*);

}  // namespace efree
