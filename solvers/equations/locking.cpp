// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/equations/locking.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <algorithm>

namespace efree {

template <int Dim> double incompressibility(const ElasticModel& model, const FineMesh<Dim>& mesh) {
  return Dim == 2 && model.plane == Plane::stress ? 0.0 : materials_of(model, mesh).incompressibility(mesh);
}

bool is_elastic(const ElasticModel& model) {
  const auto elastic = [](const SharedMaterial& material) { return !material || material->elastic(); };
  return elastic(model.material) && std::ranges::all_of(model.regions, elastic);
}

bool flows(const ElasticModel& model) {
  return model.plane != Plane::stress && !is_elastic(model);
}

double bearable_incompressibility(BasisKind kind) {
  return kind == BasisKind::p2 ? 50.0 : 4.67;
}

template <int Dim> void require_decided(const Approximation<Dim>& approximation, const ElasticModel& model) {
  if (!approximation.undecided) return;
  const FineSpace<Dim>& space = approximation.space;
  const bool elements = approximation.shape.num_nodes() == space.size();
  const BasisKind kind = !elements ? BasisKind::mls : space.degree() == 1 ? BasisKind::p1 : BasisKind::p2;
  const double there = incompressibility(model, space.mesh()), bearable = bearable_incompressibility(kind);
  const bool flow = flows(model);
  if (there <= bearable && !flow) return;
  const std::string why =
      flow ? "the material flows, which keeps its volume, and these functions lock under it"
           : fmt::format(
                 "the material is nearly incompressible: it resists dilatation {:.3g} times as much as shear, and "
                 "these functions lock beyond {:.3g}",
                 there, bearable);
  throw InputError(
      fmt::format("{}; {}, or leave the choice to `analyse` (Dilatation::pointwise takes them as they are)", why,
                  kind == BasisKind::p1 ? "take BasisKind::mls or p2 with dilatation = Dilatation::averaged"
                                        : "approximate with dilatation = Dilatation::averaged"));
}

template double incompressibility<2>(const ElasticModel&, const FineMesh<2>&);
template double incompressibility<3>(const ElasticModel&, const FineMesh<3>&);
template void require_decided<2>(const Approximation<2>&, const ElasticModel&);
template void require_decided<3>(const Approximation<3>&, const ElasticModel&);

}  // namespace efree
