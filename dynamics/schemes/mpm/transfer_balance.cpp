// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/mpm/internal/transfer_balance.hpp"

#include <cmath>
#include <limits>

namespace efree::internal {
namespace {

template <int Dim> double lumped_kinetic_energy(const Nodes<Dim>& nodes) {
  return 0.5 * nodes.mass.dot(nodes.v.colwise().squaredNorm().transpose());
}

/// Momentum of a body's nodes. Sums in more digits: what they miss would be drift.
template <int Dim> std::array<long double, Dim> sum_momentum(const World<Dim>& world, Index body) {
  std::array<long double, Dim> sum{};
  for (const Index a : world.nodes_of(body))
    for (int i = 0; i < Dim; ++i)
      sum[i] += static_cast<long double>(world.nodes.mass[a]) * static_cast<long double>(world.nodes.v(i, a));
  return sum;
}

}  // namespace

template <int Dim> void TransferBalance<Dim>::begin(Index num_bodies) {
  momentum_before_.resize(static_cast<std::size_t>(num_bodies));
  owed_.setZero(Dim, num_bodies);
}

template <int Dim> void TransferBalance<Dim>::leave_grid(const World<Dim>& world) {
  energy_before_ = lumped_kinetic_energy(world.nodes);
  for (Index b = 0; b < world.num_bodies(); ++b) momentum_before_[b] = sum_momentum(world, b);
}

template <int Dim> void TransferBalance<Dim>::return_momentum(World<Dim>& world) {
  for (Index b = 0; b < world.num_bodies(); ++b) {
    const auto nodes = world.nodes_of(b);
    const auto after = sum_momentum(world, b);
    double mass = 0.0, fastest = 0.0;
    for (const Index a : nodes) {
      mass += world.nodes.mass[a];
      fastest = std::max(fastest, world.nodes.v.col(a).cwiseAbs().maxCoeff());
    }
    for (int i = 0; i < Dim; ++i) {
      owed_(i, b) += static_cast<double>(momentum_before_[b][i] - after[i]);
      const double change = owed_(i, b) / mass;
      if (!(std::abs(change) > 4.0 * std::numeric_limits<double>::epsilon() * fastest)) continue;
      for (const Index a : nodes) {
        const double before = world.nodes.v(i, a);
        world.nodes.v(i, a) += change;
        owed_(i, b) -= world.nodes.mass[a] * (world.nodes.v(i, a) - before);
      }
    }
  }
}

template <int Dim> void TransferBalance<Dim>::take_grid(World<Dim>& world, const PointGrid<Dim>& grid) {
  if (!energy_before_) return;
  return_momentum(world);
  // Of velocities half a step ago, and half a step of the forces now, as everywhere in the balance: that half is of
  // velocities before and after the transfer, too.
  double power = -world.nodes.force.cwiseProduct(world.nodes.v).sum();
  for (const Particles<Dim>& of : grid.particles) power += of.power + of.lost_power;
  world.ledger.add_energy("transfer", EnergyKind::transfer,
                          *energy_before_ - lumped_kinetic_energy(world.nodes) + 0.5 * world.last_step * power);
  energy_before_.reset();
}

template class TransferBalance<2>;
template class TransferBalance<3>;

}  // namespace efree::internal
