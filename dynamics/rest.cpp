// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/internal/rest.hpp"

namespace efree::internal {
namespace {

template <int Dim> class Damping final : public Interaction<Dim> {
 public:
  /// After contact: what it stops is no motion.
  void apply_impulses(World<Dim>& world, double kick, double /*dt*/) override {
    Nodes<Dim>& nodes = world.nodes;
    const DynamicsOptions& options = world.options;
    double factor = 1.0 / (1.0 + kick * options.damping);
    if (world.time >= options.rest_from) {
      const double kinetic = 0.5 * nodes.mass.dot(nodes.v.cwiseProduct(nodes.free).colwise().squaredNorm());
      // Not twice in a row: it has to grow first.
      if (kinetic < last_ && last_ > before_last_) factor = 0.0;
      before_last_ = std::exchange(last_, factor * factor * kinetic);
    }
    changes_.resize(Dim, 0);
    if (factor == 1.0) return;
    changes_ = (factor - 1.0) * nodes.free.cwiseProduct(world.consistent_mass.any()
                                                            ? nodes.momentum
                                                            : Points<Dim>(nodes.v * nodes.mass.asDiagonal()));
    nodes.v += (factor - 1.0) * nodes.free.cwiseProduct(nodes.v);
    if (world.consistent_mass.any()) nodes.momentum += changes_;
  }
  void finish_kick(World<Dim>& world, double /*kick*/, double /*dt*/) override {
    if (changes_.cols() == 0) return;
    const Nodes<Dim>& nodes = world.nodes;
    world.ledger.add_energy("damping", EnergyKind::loss, -0.5 * changes_.cwiseProduct(nodes.v + nodes.v_before).sum());
  }
  void pack(Archive& archive) override { archive(last_, before_last_); }

 private:
  double last_ = 0.0, before_last_ = 0.0;  ///< kinetic energies of the last steps
  Points<Dim> changes_;                    ///< of momenta in this step; empty: none
};

}  // namespace

template <int Dim> std::unique_ptr<Interaction<Dim>> damping() {
  return std::make_unique<Damping<Dim>>();
}

namespace {

/// N, forces of stresses on nodes, of each point without regard to its neighbours, and the square of those of points
/// without a table.
template <int Dim> std::pair<Vector, double> stress_forces(const World<Dim>& world) {
  Vector forces = Vector::Zero(world.nodes.size());
  // Of points without a table, squared: stresses on the sides of a square (cube) of their volume.
  double of_points = 0.0;
  for (const auto& chunk : world.chunks) {
    if (!chunk.has_table()) {
      for (Index p = 0; p < chunk.size(); ++p)
        of_points += std::pow(chunk.matter.volume[p], 2.0 - 2.0 / Dim) * chunk.matter.P.col(p).squaredNorm();
      continue;
    }
    for (Index p = 0; p < chunk.size(); ++p)
      for (const auto& [a, entry] : chunk.table.row(p))
        forces[a] +=
            chunk.matter.volume[p] * chunk.matter.P.col(p).norm() * Eigen::Map<const Vec<Dim>>(entry.dN).norm();
  }
  return {std::move(forces), of_points};
}

}  // namespace

template <int Dim> double residual(const World<Dim>& world, double kick) {
  const Nodes<Dim>& nodes = world.nodes;
  if (!(kick > 0.0) || nodes.v.isZero(0.0)) return std::numeric_limits<double>::infinity();  // or just stopped
  const Points<Dim> change = nodes.free.cwiseProduct(nodes.v - nodes.v_before);
  const double net = (change * nodes.mass.asDiagonal()).norm() / kick;
  double stored = 0.0;
  for (const auto& chunk : world.chunks) stored += chunk.stored;
  const double kinetic = 0.5 * nodes.mass.dot(nodes.v.cwiseProduct(nodes.free).colwise().squaredNorm());
  const auto [forces, of_points] = stress_forces(world);
  const double all = of_points > 0.0 ? std::sqrt(forces.squaredNorm() + of_points) : forces.norm();
  return std::max(net / all, std::sqrt(kinetic / stored));
}

template <int Dim> double imbalance(const World<Dim>& world, const std::vector<Index>& in_contact) {
  Points<Dim> net = world.nodes.force;
  for (const auto& one : world.prescribed) net(one.axis, one.node) = 0.0;
  for (const Index a : in_contact) net.col(a).setZero();
  double weight = 0.0;
  for (Index a = 0; a < world.nodes.size(); ++a)
    if (world.nodes.mass[a] > 0.0)
      weight += world.real_mass(a) * (world.gravity + world.field_at(world.nodes.x.col(a), world.time)).norm();
  const double largest = stress_forces(world).first.maxCoeff();
  const double at_node = largest > 0.0 ? std::sqrt(net.colwise().squaredNorm().maxCoeff()) / largest : 0.0;
  return std::max(at_node, weight > 0.0 ? net.rowwise().sum().norm() / weight : 0.0);
}

template std::unique_ptr<Interaction<2>> damping<2>();
template std::unique_ptr<Interaction<3>> damping<3>();
template double imbalance(const World<2>&, const std::vector<Index>&);
template double imbalance(const World<3>&, const std::vector<Index>&);
template double residual(const World<2>&, double);
template double residual(const World<3>&, double);

}  // namespace efree::internal
