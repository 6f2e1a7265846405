// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies in motion as bytes, and back.
#include "efree/core/internal/packer.hpp"
#include "efree/otm/internal/motion.hpp"

#include <fmt/format.h>

namespace efree {

// By structured bindings: what is added and not listed does not compile. What a step begins with by filling it is left
// out.
auto fields(OtmTimes& of) {
  auto& [functions, kinematics, materials, forces, stability, nodes, contact, fracture] = of;
  return std::tie(functions, kinematics, materials, forces, stability, nodes, contact, fracture);
}
auto fields(EnergyWatch& of) {
  auto& [start, scale, off, furthest, beyond, begun] = of;
  return std::tie(start, scale, off, furthest, beyond, begun);
}
auto fields(OtmCounts& of) {
  auto& [steps, updates, renewals, iterations, merged, injected, fused, joined, eroded, passed, kept, widened] = of;
  return std::tie(steps, updates, renewals, iterations, merged, injected, fused, joined, eroded, passed, kept, widened);
}
auto fields(Deformation& of) {
  auto& [X, F, history, dt, heat] = of;
  return std::tie(X, F, history, dt, heat);
}
auto fields(MaterialResponse& of) {
  auto& [P, history, energy, A, tangent, dissipated] = of;
  return std::tie(P, history, energy, A, tangent, dissipated);
}
template <int Dim> auto fields(OtmCavity<Dim>& of) {
  auto& [facets, pressure, exponent] = of;
  return std::tie(facets, pressure, exponent);
}
template <int Dim> auto fields(ToolState<Dim>& of) {
  auto& [centre, velocity, turned, spin, force, impulse, work] = of;
  return std::tie(centre, velocity, turned, spin, force, impulse, work);
}
namespace internal {

template <> inline constexpr bool is_plain<OtmEntry> = true;
static_assert(sizeof(OtmEntry) == 4 * sizeof(double));
template <> inline constexpr bool is_plain<OtmPairing> = true;

template <int Dim> auto fields(OtmPair<Dim>& of) {
  auto& [first, second, way, pairing] = of;
  return std::tie(first, second, way, pairing);
}
template <int Dim> auto fields(OtmChunk<Dim>& of) {
  auto& [body, number, offsets, local, entries, nodes, x, force, origin, now, response, made, since, at, volume, mass,
         metric, moment, lambda, count, width, growth, dilatation, shock, modulus, stiffening, penalty, damage, reach,
         unions, worn, stiffened, crushed, pairs, damping, squeeze, lost, seconds] = of;
  return std::tie(body, number, offsets, local, entries, nodes, now, response, made, since, at, volume, mass, metric,
                  moment, lambda, count, width, growth, dilatation, shock, modulus, stiffening, penalty, damage, reach,
                  unions, worn, stiffened, crushed, pairs, damping, squeeze, seconds);
}
template <class T>
concept IsPrescribed = requires(T of) {
  of.axis;
  of.velocity;
};
auto fields(IsPrescribed auto& of) {
  auto& [node, axis, velocity] = of;
  return std::tie(node, axis, velocity);
}
template <class T>
concept IsHeld = requires(T of) {
  of.lever;
};
auto fields(IsHeld auto& of) {
  auto& [node, weight, lever] = of;
  return std::tie(node, weight, lever);
}
template <class T>
concept IsTouch = requires(T of) {
  of.patch;
  of.gap;
};
auto fields(IsTouch auto& of) {
  auto& [node, stiffness, normal, patch, gap, depth, energy] = of;
  return std::tie(node, stiffness, normal, patch, gap, depth, energy);
}
template <class T>
concept IsCavity = requires(T cavity) {
  cavity.of;
  cavity.volume;
};
auto fields(IsCavity auto& cavity) {
  auto& [of, volume, stored] = cavity;
  return std::tie(of, volume, stored);
}
template <class T>
concept IsSurface = requires(T of) {
  of.facets;
  of.nodes;
};
auto fields(IsSurface auto& of) {
  auto& [facets, nodes] = of;
  return std::tie(facets, nodes);
}
template <class T>
concept IsNear = requires(T of) {
  of.facets;
  of.body;
};
auto fields(IsNear auto& of) {
  auto& [node, body, facets] = of;
  return std::tie(node, body, facets);
}
template <class T>
concept IsBody = requires(T of) {
  of.cells;
  of.first_point;
};
auto fields(IsBody auto& of) {
  auto& [material, tangent, compliance, shear, modulus, renewed, integrates, finite, has_surface, mass_terms, fracture,
         plastic_strain, temperature, plastic_metric, release, cells, first_node, first_point, outer] = of;
  return std::tie(cells, first_node, first_point);
}
template <class T>
concept IsTool = requires(T of) {
  of.is_wall;
  of.travelled;
};
auto fields(IsTool auto& of) {
  auto& [tool, is_wall, now, before, near, impulses, travelled, pushed, turned] = of;
  return std::tie(now, near, impulses, travelled);
}
template <int Dim> auto fields(Motion<Dim>& of) {
  return std::tie(of.sizes, of.bodies, of.x, of.x_rest, of.v, of.force, of.mass, of.chunks, of.tools, of.prescribed,
                  of.acceleration, of.held_anew, of.changed_nodes, of.spacing, of.time, of.last_step, of.stable,
                  of.first_stable, of.contact_loss, of.renewal_loss, of.fracture_loss, of.prescribed_work,
                  of.weight_work, of.dissipated, of.viscous, of.stored, of.shaken, of.next_look, of.looks_apart,
                  of.longest_seen, of.renewals_seen, of.watch, of.counts, of.times, of.merged, of.body_of_node,
                  of.place_of_point, of.surfaces, of.surface_area, of.approaching, of.seen_at, of.met, of.touches,
                  of.passed, of.seized, of.cavities, of.contact_stored, of.nodal_momentum, of.looked);
}

}  // namespace internal

template <int Dim> std::string Otm<Dim>::state() const {
  internal::Packer pack;
  pack(*motion_);
  return std::move(pack).bytes();
}

template <int Dim> void Otm<Dim>::restore(std::string_view state) {
  internal::Motion<Dim>& of = *motion_;
  const auto sizes = of.sizes;
  const auto bodies = of.bodies;
  const auto tools = of.tools;
  const std::string before = this->state();
  const auto take = [&](std::string_view bytes) {
    internal::Unpacker unpack(bytes);
    unpack(of);
    return unpack.empty();
  };
  bool same = false;
  try {
    same = take(state);
  } catch (const InputError&) {
  }
  same = same && of.sizes == sizes && of.bodies.size() == bodies.size() && of.tools.size() == tools.size();
  if (!same) {
    of.bodies = bodies;
    of.tools = tools;
    take(before);
  }
  for (auto& chunk : of.chunks) {
    chunk.x.assign(4 * chunk.nodes.size(), 0.0);
    chunk.force.assign(4 * chunk.nodes.size(), 0.0);
  }
  for (auto& body : of.bodies) body.outer.clear();
  of.find_places();
  of.find_free();
  of.ball_offsets.clear();
  of.move_tables();
  if (!same) throw InputError("the state is damaged, or not of bodies, walls and tools such as these");
}

template std::string Otm<2>::state() const;
template std::string Otm<3>::state() const;
template void Otm<2>::restore(std::string_view);
template void Otm<3>::restore(std::string_view);

}  // namespace efree
