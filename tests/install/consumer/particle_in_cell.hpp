// SPDX-License-Identifier: GPL-3.0-or-later
/// The particle-in-cell method (Harlow 1964) in the plane, as a scheme outside of the library: bilinear functions on a
/// square grid whose nodes come and go with the particles.
///   to the grid:      m_a = sum N_a m_p,  v_a = sum N_a m_p v_p / m_a
///   to the particles: v_p = sum N_a v_a,  F = (sum x_a (x) grad N_a) F
#pragma once

#include <efree/efree.hpp>

#include <cmath>
#include <map>

class ParticleInCell final : public efree::Scheme<2> {
 public:
  ParticleInCell(double cell, efree::Vec<2> velocity) : cell_(cell), first_velocity_(velocity) {}
  std::string name() const override { return "particle_in_cell"; }

  void begin(efree::World<2>& world, std::span<const efree::DeformableBody<2>>) override {
    for (const auto& chunk : world.chunks) velocity_.push_back(first_velocity_.replicate(1, chunk.size()));
    build_grid(world);
  }

  void refresh(efree::World<2>& world, efree::internal::StableStep<2>&) override {
    const double before = kinetic_energy(world.nodes);
    for_each_entry(world, [&](auto c, auto p, auto node, const efree::TableEntry& entry, bool is_first) {
      if (is_first) velocity_[c].col(p).setZero();
      velocity_[c].col(p) += entry.N * world.nodes.v.col(node);
    });
    for (efree::Chunk<2>& chunk : world.chunks) {
      efree::update_positions(world, chunk);
      for (efree::Index p = 0; p < chunk.size(); ++p) {
        Eigen::Map<efree::Mat<3>> F(chunk.matter.F_table.col(p).data());
        F = efree::Mat<3>(chunk.matter.F_since[p] * F);
        chunk.matter.F_since[p].setIdentity();
      }
    }
    build_grid(world);
    world.ledger.add_energy("transfer", efree::EnergyKind::transfer, before - kinetic_energy(world.nodes));
  }

  std::optional<double> stable_step(const efree::World<2>& world) const override {
    double fastest = 0.0;
    for (const auto& chunk : world.chunks)
      fastest = std::max(
          fastest, (chunk.matter.modulus.array() * chunk.matter.volume.array() / chunk.matter.mass.array()).maxCoeff());
    return 0.3 * cell_ / std::sqrt(fastest);
  }

  void pack(efree::Archive& archive) override { archive(velocity_); }

 private:
  static double kinetic_energy(const efree::Nodes<2>& nodes) {
    return 0.5 * nodes.mass.dot(nodes.v.colwise().squaredNorm().transpose());
  }

  /// The corners of all cells with particles, their shape functions, masses and velocities.
  void build_grid(efree::World<2>& world) {
    std::map<std::pair<int, int>, efree::Index> number;
    std::vector<std::vector<efree::TableRow>> rows;
    for (const auto& chunk : world.chunks) {
      auto& of_chunk = rows.emplace_back(chunk.size());
      for (efree::Index p = 0; p < chunk.size(); ++p) {
        const efree::Vec<2> at = chunk.matter.x.col(p) / cell_, low(std::floor(at[0]), std::floor(at[1])), r = at - low;
        for (const int i : {0, 1})
          for (const int j : {0, 1}) {
            const double Nx = i == 1 ? r[0] : 1.0 - r[0], Ny = j == 1 ? r[1] : 1.0 - r[1], h = cell_;
            const std::pair corner(static_cast<int>(low[0]) + i, static_cast<int>(low[1]) + j);
            const auto node = number.try_emplace(corner, static_cast<efree::Index>(number.size())).first->second;
            of_chunk[p].push_back({node, {{(2 * i - 1) * Ny / h, (2 * j - 1) * Nx / h, 0.0}, Nx * Ny}});
          }
      }
    }
    efree::Points<2> x(2, number.size());
    for (const auto& [corner, node] : number) x.col(node) << cell_ * corner.first, cell_ * corner.second;
    world.replace_nodes(x, {0, static_cast<efree::Index>(number.size())}, cell_);
    for (std::size_t c = 0; c < world.chunks.size(); ++c) world.put_rows(world.chunks[c], rows[c]);
    world.find_node_chunks();
    efree::sum_lumped_masses(world);
    efree::Points<2>& v = world.nodes.v;
    for_each_entry(world, [&](auto c, auto p, auto node, const efree::TableEntry& entry, bool) {
      v.col(node) += entry.N * world.chunks[c].matter.mass[p] * velocity_[c].col(p);
    });
    v.array().rowwise() /= world.nodes.mass.transpose().array();
    for (const auto& one : world.prescribed) v(one.axis, one.node) = one.velocity;
    // Nodes with next to no mass would fly away.
    world.nodes.mass = world.nodes.mass.cwiseMax(0.3 * world.chunks.front().matter.mass.mean());
  }

  template <class Visit> static void for_each_entry(const efree::World<2>& world, const Visit& visit) {
    for (std::size_t c = 0; c < world.chunks.size(); ++c) {
      const auto& table = world.chunks[c].table;
      for (efree::Index p = 0; p < world.chunks[c].size(); ++p)
        for (efree::Index e = table.offsets[p]; e < table.offsets[p + 1]; ++e)
          visit(c, p, table.nodes[table.local[e]], table.entries[e], e == table.offsets[p]);
    }
  }
  double cell_;
  efree::Vec<2> first_velocity_;
  std::vector<efree::Points<2>> velocity_;  ///< of the particles, by chunk
};
