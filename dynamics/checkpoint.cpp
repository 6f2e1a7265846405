// SPDX-License-Identifier: GPL-3.0-or-later
/// The state of a run as bytes, and back.
#include "efree/core/memory.hpp"
#include "efree/core/packer.hpp"
#include "efree/dynamics/internal/world.hpp"

namespace efree {

template <> inline constexpr bool is_plain<TableEntry> = true;
static_assert(sizeof(TableEntry) == 4 * sizeof(double));
template <> inline constexpr bool is_plain<EnergyKind> = true;
template <> inline constexpr bool is_plain<ContactPartner::Kind> = true;

/// fields() of all members: one that is added and not listed does not compile.
#define EFREE_FIELDS(Type, ...)   \
  auto fields(Type& of) {         \
    auto& [__VA_ARGS__] = of;     \
    return std::tie(__VA_ARGS__); \
  }                               \
  static_assert(true)
EFREE_FIELDS(EnergyWatch, start, scale, residual, largest_residual, beyond, begun);
EFREE_FIELDS(Deformation, X, F, history, dt, heat);
template <int Dim> EFREE_FIELDS(Support<Dim>, metric, gamma, moment, has_moments, stabilisation);
template <int Dim> EFREE_FIELDS(Matter<Dim>, now, P, energy, F_table, F_since, x, volume, mass, added_mass, eroded,
                                J_ratio, J, shock, modulus, stiffness_ratio, damage, crack_radius);
template <int Dim> EFREE_FIELDS(Chunk<Dim>, body, number, table, support, matter, patches, inverted, damping,
                                compression_rate, stored, dissipated, viscous, lost, seconds);
#undef EFREE_FIELDS

// Without what is given again, found again, or filled by every step.
template <int Dim> auto fields(Nodes<Dim>& of) {
  auto& [x, v, force, x_rest, v_before, free, momentum, mass, added_mass, spacing, radius, body, master] = of;
  return std::tie(x, v, force, x_rest, momentum, mass, added_mass, spacing, radius, body, master);
}
template <int Dim> auto fields(PointTable<Dim>& of) {
  auto& [offsets, local, entries, nodes, x, force, origin] = of;
  return std::tie(offsets, local, entries, nodes);
}
template <int Dim> auto fields(PrescribedVelocity<Dim>& of) {
  auto& [node, axis, velocity, law, start] = of;
  return std::tie(node, axis, velocity, law, start);
}
template <int Dim> auto fields(BodyState<Dim>& of) {
  auto& [material, tangent, compliance, shear, modulus, fracture, strength, plastic_strain, temperature, plastic_metric,
         release, cells, holds_inverted, reference_pressure, runs_together] = of;
  return std::tie(cells, reference_pressure);
}
template <int Dim> auto fields(World<Dim>& of) {
  return std::tie(of.nodes, of.bodies, of.first_node, of.first_point, of.chunks, of.place_of_point, of.prescribed,
                  of.gravity, of.time, of.last_step, of.stable_step, of.first_stable_step, of.steps, of.reconnections,
                  of.surface_changes, of.num_eroded, of.new_supports, of.ledger, of.contacts, of.steps_of_earlier_run,
                  of.added_inertia);
}

template <int Dim> void internal::use_large_pages(const World<Dim>& world) {
  std::vector<std::span<const std::byte>> tables;
  const auto add = [&](const auto&... values) {
    (tables.push_back(std::as_bytes(std::span(values.data(), values.size()))), ...);
  };
  for (const Chunk<Dim>& chunk : world.chunks) {
    const Matter<Dim>& matter = chunk.matter;
    add(chunk.table.entries, chunk.table.local, matter.now.F, matter.P, matter.F_table, matter.now.history);
    add(matter.F_since, chunk.support.metric, chunk.support.moment);
  }
  move_to_large_pages(tables);
}
template <int Dim> void internal::pack(World<Dim>& world, EnergyWatch& watch, Archive& archive) {
  if (!archive.reads()) return archive(world, watch);
  unpack_world(world, watch, archive);
  for (const auto& one : world.prescribed)
    if (one.law >= std::ssize(world.motion_laws))
      throw InputError("the state is of a run with other prescribed velocities");
}
template <int Dim> void internal::unpack_world(World<Dim>& world, EnergyWatch& watch, Archive& archive) {
  archive(world, watch);
  for (Chunk<Dim>& chunk : world.chunks)
    for (auto* numbers : {&chunk.table.x, &chunk.table.force}) numbers->assign(4 * chunk.table.nodes.size(), 0.0);
}

template void internal::pack(World<2>&, EnergyWatch&, Archive&);
template void internal::pack(World<3>&, EnergyWatch&, Archive&);
template void internal::unpack_world(World<2>&, EnergyWatch&, Archive&);
template void internal::unpack_world(World<3>&, EnergyWatch&, Archive&);
template void internal::use_large_pages(const World<2>&);
template void internal::use_large_pages(const World<3>&);

}  // namespace efree
