// SPDX-License-Identifier: GPL-3.0-or-later
/// A lattice of masses and springs in the plane, as a scheme outside of the library that has neither shape functions
/// nor material points. A spring of stiffness k between a and b, at rest of length L: f = k (|x_b - x_a| - L) along it.
#pragma once

#include <efree/efree.hpp>

#include <cmath>

/// The nodes of the bodies are the masses, all alike.
class MassLattice final : public efree::Scheme<2> {
 public:
  explicit MassLattice(double mass) : mass_(mass) {}
  std::string name() const override { return "lattice"; }
  void begin(efree::World<2>& world, std::span<const efree::DeformableBody<2>>) override {
    world.nodes.mass.setConstant(mass_);
  }

 private:
  double mass_;
};

/// Springs between nodes.
class Springs final : public efree::Interaction<2> {
 public:
  struct Spring {
    efree::Index a, b;
    double length;
  };
  /// Between all nodes that are no further apart than `reach`.
  Springs(const efree::Points<2>& x, double reach, double stiffness) : stiffness_(stiffness) {
    for (efree::Index a = 0; a < static_cast<efree::Index>(x.cols()); ++a)
      for (efree::Index b = a + 1; b < static_cast<efree::Index>(x.cols()); ++b)
        if (const double length = (x.col(b) - x.col(a)).norm(); length <= reach) springs_.push_back({a, b, length});
  }

  void add_forces(efree::World<2>& world) override {
    for (const auto& [a, b, length] : springs_) {
      const efree::Vec<2> to = world.nodes.x.col(b) - world.nodes.x.col(a);
      const efree::Vec<2> pull = stiffness_ * (to.norm() - length) * to.normalized();
      world.nodes.force.col(a) += pull;
      world.nodes.force.col(b) -= pull;
    }
  }
  void add_stiffness(const efree::World<2>& world, const efree::Points<2>& displacement,
                     efree::Points<2>& force) const override {
    for (const auto& [a, b, length] : springs_) {
      const efree::Vec<2> n = (world.nodes.x.col(b) - world.nodes.x.col(a)).normalized();
      const efree::Vec<2> push = stiffness_ * n.dot(displacement.col(a) - displacement.col(b)) * n;
      force.col(a) += push;
      force.col(b) -= push;
    }
  }
  void tally(const efree::World<2>& world, efree::EnergyBalance<2>& balance) const override {
    double stored = 0.0;
    for (const auto& [a, b, length] : springs_) {
      const double longer = (world.nodes.x.col(b) - world.nodes.x.col(a)).norm() - length;
      stored += 0.5 * stiffness_ * longer * longer;
    }
    balance.energies.add_energy("stored", efree::EnergyKind::stored, stored);
  }

 private:
  std::vector<Spring> springs_;
  double stiffness_;
};
