// SPDX-License-Identifier: GPL-3.0-or-later
/// The state of a run as bytes, and back.
#include "efree/core/memory.hpp"
#include "efree/dynamics/internal/parts.hpp"

namespace efree {

template <> inline constexpr bool is_plain<TableEntry> = true;
static_assert(sizeof(TableEntry) == 4 * sizeof(double));
template <> inline constexpr bool is_plain<EnergyKind> = true;

/// fields() of all members: one that is added and not listed does not compile.
#define EFREE_FIELDS(Type, ...)   \
  auto fields(Type& of) {         \
    auto& [__VA_ARGS__] = of;     \
    return std::tie(__VA_ARGS__); \
  }                               \
  static_assert(true)
EFREE_FIELDS(EnergyWatch, start, scale, off, furthest, beyond, begun);
EFREE_FIELDS(Deformation, X, F, history, dt, heat);
EFREE_FIELDS(MaterialResponse, P, history, energy, A, tangent, dissipated);
EFREE_FIELDS(PrescribedVelocity, node, axis, velocity);
template <int Dim> EFREE_FIELDS(Support<Dim>, metric, gamma, moment, has_moments, stabilisation);
template <int Dim> EFREE_FIELDS(Matter<Dim>, now, response, F_table, F_since, x, volume, mass, eroded, J_ratio, J,
                                shock, modulus, stiffness_ratio, damage, crack_radius);
template <int Dim> EFREE_FIELDS(Chunk<Dim>, body, number, table, support, matter, patches, inverted, damping,
                                compression_rate, stored, dissipated, viscous, lost, seconds);
#undef EFREE_FIELDS

// Without what is given again, found again, or filled by every step.
template <int Dim> auto fields(Nodes<Dim>& of) {
  return std::tie(of.x, of.v, of.force, of.x_rest, of.momentum, of.mass, of.spacing, of.body, of.active);
}
template <int Dim> auto fields(PointTable<Dim>& of) {
  return std::tie(of.offsets, of.local, of.entries, of.nodes);
}
template <int Dim> auto fields(BodyState<Dim>& of) {
  return std::tie(of.cells);
}
template <int Dim> auto fields(World<Dim>& of) {
  return std::tie(of.nodes, of.bodies, of.first_node, of.first_point, of.chunks, of.place_of_point, of.prescribed,
                  of.gravity, of.time, of.last_step, of.stable_step, of.first_stable_step, of.steps, of.reconnections,
                  of.surface_changes, of.num_eroded, of.new_supports, of.ledger);
}

template <int Dim> void internal::use_large_pages(const World<Dim>& world) {
  std::vector<std::span<const std::byte>> tables;
  const auto add = [&](const auto&... values) {
    (tables.push_back(std::as_bytes(std::span(values.data(), values.size()))), ...);
  };
  for (const Chunk<Dim>& chunk : world.chunks) {
    const Matter<Dim>& matter = chunk.matter;
    add(chunk.table.entries, chunk.table.local, matter.now.F, matter.response.P, matter.F_table, matter.now.history);
    add(matter.response.history, matter.F_since, chunk.support.metric, chunk.support.moment);
  }
  move_to_large_pages(tables);
}
template <int Dim> void Dynamics<Dim>::Parts::pack(Archive& archive) {
  archive(world, watch);
  stable.pack(archive);
  scheme->pack(archive);
  for (const auto& interaction : world.interactions) interaction->pack(archive);
}

template <int Dim> std::string Dynamics<Dim>::state() const {
  Packer packer;
  Archive archive(packer);
  std::string scheme = parts_->scheme->name();
  archive(scheme);
  parts_->pack(archive);
  return std::move(packer).bytes();
}

template <int Dim> void Dynamics<Dim>::restore(std::string_view state) {
  Parts& parts = *parts_;
  World<Dim>& world = parts.world;
  const auto bodies = world.bodies;
  const std::string before = this->state();
  const auto take = [&](std::string_view bytes) {
    Unpacker unpacker(bytes);
    Archive archive(unpacker);
    std::string scheme;
    archive(scheme);
    if (scheme != parts.scheme->name()) return false;
    parts.pack(archive);
    return world.bodies.size() == bodies.size() && unpacker.empty();
  };
  bool same = false;
  try {
    same = take(state);
  } catch (const InputError&) {
  }
  if (!same) {
    world.bodies = bodies;
    take(before);
  }
  for (auto& chunk : world.chunks) {
    chunk.table.x.assign(4 * chunk.table.nodes.size(), 0.0);
    chunk.table.force.assign(4 * chunk.table.nodes.size(), 0.0);
  }
  world.find_node_chunks();
  world.find_free_axes();
  ++world.point_changes;
  parts.scheme->resume(world);
  internal::use_large_pages(world);
  if (!same) throw InputError("the state is damaged, or not of bodies, walls and a scheme such as these");
}

#define EFREE_INSTANTIATE(Dim)                                \
  template std::string Dynamics<Dim>::state() const;          \
  template void Dynamics<Dim>::restore(std::string_view);     \
  template void internal::use_large_pages(const World<Dim>&); \
  template void Dynamics<Dim>::Parts::pack(Archive&);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree
