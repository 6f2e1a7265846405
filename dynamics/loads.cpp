// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/internal/loads.hpp"

#include "efree/dynamics/contact/internal/surfaces.hpp"

#include <fmt/format.h>

namespace efree::internal {
namespace {

/// Area or volume inside closed facets. Calls `derivative` with its derivatives with respect to the positions of nodes,
/// once for each node of each facet.
template <int Dim> double enclosed_volume(const Points<Dim>& x, const Facets<Dim>& facets,
                                          const std::function<void(Index, const Vec<Dim>&)>& derivative) {
  const Vec<Dim> origin = x.col(facets(0, 0));
  const double share = Dim == 2 ? 0.5 : 1.0 / 6.0;
  double volume = 0.0;
  for (Index f = 0; f < facets.cols(); ++f) {
    const Mat<Dim> corners = facet_corners(x, facets, f).colwise() - origin;
    volume += share * corners.determinant();
    if (!derivative) continue;
    for (int i = 0; i < Dim; ++i) {
      Vec<Dim> cofactors;
      if constexpr (Dim == 2)
        cofactors = i == 0 ? Vec<2>(corners(1, 1), -corners(0, 1)) : Vec<2>(-corners(1, 0), corners(0, 0));
      else
        cofactors = corners.col((i + 1) % 3).cross(corners.col((i + 2) % 3));
      derivative(facets(i, f), share * cofactors);
    }
  }
  return volume;
}

/// Force per mass on a node, of a frame that spins about the origin.
template <int Dim> Vec<Dim> centrifugal(const World<Dim>& world, const Points<Dim>& at, Index node) {
  return -rotation_velocity<Dim>(world.frame_spin, rotation_velocity<Dim>(world.frame_spin, at.col(node)));
}

/// Adds the forces by World::gravity_field to nodes.force; forces: Dim x N, these. They are the masses, lumped or
/// consistent, times the field at the nodes, which are then accelerated as it says.
template <int Dim> void add_field(World<Dim>& world, Points<Dim>& forces) {
  Nodes<Dim>& nodes = world.nodes;
  Points<Dim> field = Points<Dim>::Zero(Dim, nodes.size());
  for (Index a = 0; a < nodes.size(); ++a)
    if (nodes.mass[a] > 0.0) field.col(a) = world.field_at(nodes.x.col(a), world.time);
  forces = field * world.real_masses().asDiagonal();
  const ConsistentMass<Dim>& consistent = world.consistent_mass;
  // Symmetric, so that the forces sum up to the field times the masses.
  const auto real = [&](Index a, Index b) {
    if (!world.options.mass_scaling.on()) return 1.0;
    return 0.5 * (world.real_mass(a) / nodes.mass[a] + world.real_mass(b) / nodes.mass[b]);
  };
  if (consistent.any())
    parallel_for(nodes.size(), [&](Index a) {
      if (consistent.terms[nodes.body[a]] == 1) return;
      for (SparseRows::InnerIterator entry(consistent.coupling, a); entry; ++entry)
        forces.col(a) += real(a, entry.col()) * entry.value() * (field.col(entry.col()) - field.col(a));
    });
  nodes.force += forces;
}

template <int Dim> class PrescribedVelocities final : public Interaction<Dim> {
 public:
  void apply_impulses(World<Dim>& world, double /*kick*/, double /*dt*/) override {
    if (world.prescribed.empty()) return;
    Nodes<Dim>& nodes = world.nodes;
    double work = 0.0;
    // The work of a force that changes v in the end is its impulse times the mean of the velocities before and after.
    for (const PrescribedVelocity<Dim>& one : world.prescribed) {
      const double mass = nodes.mass[one.node], velocity = world.stands_still ? 0.0 : one.velocity;
      double& v = nodes.v(one.axis, one.node);
      work += 0.5 * mass * (velocity - v) * (velocity + nodes.v_before(one.axis, one.node));
      v = velocity;
      if (world.consistent_mass.any()) nodes.momentum(one.axis, one.node) = mass * v;
    }
    world.ledger.add_energy("prescribed", EnergyKind::work, work);
  }
  /// Zero, as supports are at rest.
  void add_velocities(const World<Dim>& world, std::vector<Vec<Dim>>& velocities) const override {
    if (!world.prescribed.empty()) velocities.push_back(Vec<Dim>::Zero());
  }
  void edge_split(World<Dim>& world, Index a, Index b, Index middle) override {
    const std::vector<PrescribedVelocity<Dim>> prescribed = world.prescribed;
    for (const PrescribedVelocity<Dim>& one : prescribed)
      for (const PrescribedVelocity<Dim>& other : prescribed) {
        if (one.node != a || other.node != b || one.axis != other.axis || one.law != other.law) continue;
        if (one.law < 0 && one.velocity != other.velocity) continue;
        world.prescribed.push_back(
            {middle, one.axis, 0.5 * (one.velocity + other.velocity), one.law, 0.5 * (one.start + other.start)});
      }
  }
};

}  // namespace

template <int Dim> void split_facets(Facets<Dim>& facets, Index a, Index b, Index middle) {
  for (Index f = facets.cols() - 1; f >= 0; --f) {
    const auto has = [&](Index node) { return (facets.col(f).array() == node).any(); };
    if (!has(a) || !has(b)) continue;
    facets.conservativeResize(Eigen::NoChange, facets.cols() + 1);
    facets.rightCols(1) = facets.col(f);
    for (Index& corner : facets.col(f))
      if (corner == b) corner = middle;
    for (Index& corner : facets.rightCols(1).reshaped())
      if (corner == a) corner = middle;
  }
}

template <int Dim> void Gravity<Dim>::set_field(World<Dim>& world, GravityField<Dim> field) {
  Nodes<Dim>& nodes = world.nodes;
  if (by_field_.cols() == nodes.size()) nodes.force -= by_field_;
  by_field_.resize(Dim, 0);
  world.gravity_field = std::move(field);
  if (world.gravity_field) add_field(world, by_field_);
}

template <int Dim> void Gravity<Dim>::add_forces(World<Dim>& world) {
  if (world.gravity_law) world.gravity = world.gravity_law(world.time);
  if (world.axisymmetric() && world.gravity[0] != 0.0)
    throw InputError(fmt::format(
        "gravity of {:.6g} along the radius of an axisymmetric section, expected one along y alone", world.gravity[0]));
  Nodes<Dim>& nodes = world.nodes;
  if (!world.gravity.isZero(0.0)) nodes.force += world.gravity * world.real_masses().transpose();
  if (world.gravity_field) add_field(world, by_field_);
  if (world.frame_spin.isZero(0.0)) return;
  for (Index a = 0; a < nodes.size(); ++a) nodes.force.col(a) += world.real_mass(a) * centrifugal(world, nodes.x, a);
}

template <int Dim> void Gravity<Dim>::finish_kick(World<Dim>& world, double /*kick*/, double dt) {
  const Nodes<Dim>& nodes = world.nodes;
  if (const Vec<Dim> mean = world.mean_gravity(dt); !mean.isZero(0.0))
    world.ledger.add_energy("gravity", EnergyKind::work, dt * mean.dot(nodes.v * world.real_masses()));
  // The force at a time works along half of the way before and half of the way after.
  if (world.gravity_field && by_field_.cols() == nodes.size())
    world.ledger.add_energy("gravity", EnergyKind::work,
                            0.5 * by_field_.cwiseProduct(world.last_step * nodes.v_before + dt * nodes.v).sum());
  if (world.frame_spin.isZero(0.0)) return;
  // Linear in the place: its mean over the step is that in the middle.
  const Points<Dim> middle = nodes.x + 0.5 * dt * nodes.v;
  double work = 0.0;
  for (Index a = 0; a < nodes.size(); ++a)
    work += dt * world.real_mass(a) * centrifugal(world, middle, a).dot(nodes.v.col(a));
  world.ledger.add_energy("gravity", EnergyKind::work, work);
}

template <int Dim> void Gravity<Dim>::tally(const World<Dim>& world, EnergyBalance<Dim>& balance) const {
  if (world.gravity_field && by_field_.cols() == world.nodes.size())
    balance.energies.add_energy("gravity", EnergyKind::work,
                                0.5 * world.last_step * by_field_.cwiseProduct(world.nodes.v).sum());
}

template <int Dim> std::unique_ptr<Interaction<Dim>> prescribed_velocities() {
  return std::make_unique<PrescribedVelocities<Dim>>();
}

template <int Dim> void Cavities<Dim>::add(World<Dim>& world, const GasCavity<Dim>& cavity) {
  const Index N = world.nodes.size();
  if (world.axisymmetric()) throw InputError("a cavity: expected plane strain or space, not an axisymmetric section");
  if (!std::isfinite(cavity.pressure) || !(cavity.exponent > 0.0) || !std::isfinite(cavity.exponent))
    throw InputError("a cavity: expected a pressure and a positive exponent");
  if (cavity.facets.cols() == 0 || cavity.facets.minCoeff() < 0 || cavity.facets.maxCoeff() >= N)
    throw InputError(fmt::format("a cavity: expected facets of the {} nodes", N));
  // A translation changes no volume if the facets are closed.
  Vec<Dim> sum = Vec<Dim>::Zero();
  double size = 0.0;
  const double volume = enclosed_volume<Dim>(world.nodes.x, cavity.facets, [&](Index, const Vec<Dim>& derivative) {
    sum += derivative;
    size += derivative.norm();
  });
  if (!(sum.norm() < 1e-10 * size)) throw InputError("a cavity: its facets are not closed, or not oriented alike");
  if (!(std::abs(volume) > 0.0)) throw InputError("a cavity: its facets enclose nothing");
  cavities_.push_back({cavity, volume, 0.0});
  for (Index& corner : cavities_.back().gas.facets.reshaped()) corner = world.nodes.master_of(corner);
  add_forces(world);
}

template <int Dim> void Cavities<Dim>::add_forces(World<Dim>& world) {
  Nodes<Dim>& nodes = world.nodes;
  for (auto& [gas, initial_volume, stored] : cavities_) {
    const double ratio = enclosed_volume<Dim>(nodes.x, gas.facets, {}) / initial_volume, exponent = gas.exponent;
    if (!(ratio > 0.0))
      throw NumericalError(
          fmt::format("at time {:.6g} a cavity has collapsed: its walls cross each other", world.time));
    const double sign = initial_volume > 0.0 ? 1.0 : -1.0, p = gas.pressure * std::pow(ratio, -exponent);
    stored = std::abs(initial_volume) * gas.pressure *
             (exponent == 1.0 ? -std::log(ratio) : (std::pow(ratio, 1.0 - exponent) - 1.0) / (exponent - 1.0));
    enclosed_volume<Dim>(nodes.x, gas.facets,
                         [&](Index a, const Vec<Dim>& derivative) { nodes.force.col(a) += sign * p * derivative; });
  }
}

template <int Dim> void Cavities<Dim>::tally(const World<Dim>&, EnergyBalance<Dim>& balance) const {
  for (const Cavity& cavity : cavities_) balance.energies.add_energy("stored", EnergyKind::stored, cavity.stored);
}

template <int Dim> void Cavities<Dim>::nodes_inserted(const World<Dim>&, Index first, Index count) {
  for (Cavity& cavity : cavities_)
    for (Index& corner : cavity.gas.facets.reshaped()) shift_node(corner, first, count);
}

template <int Dim> void Cavities<Dim>::node_merged(const World<Dim>&, Index node, Index with) {
  for (Cavity& cavity : cavities_) std::ranges::replace(cavity.gas.facets.reshaped(), node, with);
}

template <int Dim> void Cavities<Dim>::edge_split(World<Dim>&, Index a, Index b, Index middle) {
  for (Cavity& cavity : cavities_) split_facets<Dim>(cavity.gas.facets, a, b, middle);
}

template void split_facets<2>(Facets<2>&, Index, Index, Index);
template void split_facets<3>(Facets<3>&, Index, Index, Index);
template class Gravity<2>;
template class Gravity<3>;
template std::unique_ptr<Interaction<2>> prescribed_velocities<2>();
template std::unique_ptr<Interaction<3>> prescribed_velocities<3>();
template class Cavities<2>;
template class Cavities<3>;

}  // namespace efree::internal
