// SPDX-License-Identifier: GPL-3.0-or-later
/// The part of a fluid's pressure that is the same everywhere acts on its surface, where its integral is exact.
#include "efree/dynamics/contact/internal/facet.hpp"
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"

namespace efree::internal {
namespace {

/// Adds pressure times the derivative of the volume inside facets to forces; returns that volume.
template <int Dim>
double push_outwards(const World<Dim>& world, const Facets<Dim>& facets, double pressure, Points<Dim>& forces) {
  double volume = 0.0;
  if (facets.cols() == 0) return volume;
  const Vec<Dim> origin = world.nodes.x.col(facets(0, 0));
  for (Index f = 0; f < facets.cols(); ++f) {
    const Mat<Dim> corners = facet_corners<Dim>(world.nodes.x, facets, f);
    const Vec<Dim> area = area_of<Dim>(corners);
    if (world.axisymmetric()) {
      // Pappus: the ring of each node's share of the facet.
      const double r = corners(0, 0), s = corners(0, 1), third = std::numbers::pi / 3.0;
      volume += third * (r * r + r * s + s * s) * area[0];
      const double along = third * (r * r + r * s + s * s) * pressure;
      forces(0, facets(0, f)) += third * (2.0 * r + s) * area[0] * pressure;
      forces(0, facets(1, f)) += third * (r + 2.0 * s) * area[0] * pressure;
      forces(1, facets(0, f)) -= along;
      forces(1, facets(1, f)) += along;
    } else {
      volume += (corners.rowwise().mean() - origin).dot(area) / Dim;
      for (const Index a : facets.col(f)) forces.col(a) += pressure / Dim * area;
    }
  }
  return volume;
}

}  // namespace

template <int Dim> void begin_reference_pressures(World<Dim>& world, OtmState<Dim>& state) {
  state.references.resize(world.bodies.size());
  for (Index b = 0; b < world.num_bodies(); ++b) {
    BodyState<Dim>& body = world.bodies[b];
    if (!body.runs_together || body.cells.cols() == 0) continue;
    double least = std::numeric_limits<double>::infinity();
    for (const Chunk<Dim>& chunk : world.chunks) {
      if (chunk.body != b) continue;
      for (Index p = 0; p < chunk.size(); ++p)
        least = std::min(least, -kirchhoff_stress(world, chunk, p).trace() / 3.0);
    }
    body.reference_pressure = std::isfinite(least) ? std::max(0.0, least) : 0.0;
  }
}

template <int Dim> void add_reference_pressures(World<Dim>& world, OtmState<Dim>& state) {
  for (Index b = 0; b < world.num_bodies(); ++b) {
    ReferencePressure<Dim>& of = state.references[b];
    const double pressure = world.bodies[b].reference_pressure;
    if (pressure == 0.0 && of.pressure == 0.0) continue;
    bool goes_on = of.pressure > 0.0;
    if (of.surface_changes != world.surface_changes) {
      of.facets = outer_facets(world, b);
      of.surface_changes = world.surface_changes;
      goes_on = false;
    }
    double excess = 0.0;
    for (const Chunk<Dim>& chunk : world.chunks) {
      if (chunk.body != b) continue;
      for (Index p = 0; p < chunk.size(); ++p)
        excess += chunk.matter.volume[p] * chunk.matter.now.gradient(p).determinant();
    }
    excess -= push_outwards(world, of.facets, pressure, world.nodes.force);
    if (goes_on) of.energy += 0.5 * (of.pressure + pressure) * (excess - of.excess);
    of.excess = excess;
    of.pressure = pressure;
  }
}

template void begin_reference_pressures(World<2>&, OtmState<2>&);
template void begin_reference_pressures(World<3>&, OtmState<3>&);
template void add_reference_pressures(World<2>&, OtmState<2>&);
template void add_reference_pressures(World<3>&, OtmState<3>&);

}  // namespace efree::internal
