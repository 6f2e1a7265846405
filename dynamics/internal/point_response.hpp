// SPDX-License-Identifier: GPL-3.0-or-later
/// Stresses, energies and histories of material points by their material.
#pragma once

#include "efree/dynamics/state.hpp"

#include <utility>

namespace efree::internal {

/// The material's response to the deformation of some points: P and `energy` are theirs, and their history is that
/// after it. In between calls visit(response) while the history is still that before; `response` is of this thread.
/// Throws what Material::respond throws.
template <int Dim, class Visit>
void update_stresses(const Material& material, Matter<Dim>& matter, const Visit& visit) {
  thread_local MaterialResponse room;
  /// Stresses and energies are written where they stay.
  struct Lent {
    Matter<Dim>& of;
    explicit Lent(Matter<Dim>& from) : of(from) { swap(); }
    ~Lent() { swap(); }
    Lent(const Lent&) = delete;
    Lent& operator=(const Lent&) = delete;
    void swap() {
      room.P.swap(of.P);
      room.energy.swap(of.energy);
    }
  };
  const Lent lent(matter);
  room.history.resizeLike(matter.now.history);
  room.dissipated.setZero(matter.size());
  material.respond(matter.now, room);
  visit(room);
  matter.now.history.swap(room.history);
}

}  // namespace efree::internal
