// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/mpm/internal/grid_contact.hpp"

#include "efree/dynamics/schemes/mpm/internal/spline.hpp"

#include <limits>
#include <map>

namespace efree::internal {
namespace {

/// Mass of a node, over that of a particle, below which the particle's contact does not act on it.
constexpr double least_mass = 1e-6;

/// A node of one body and one of another at the same place.
template <int Dim> struct SharedNode {
  Index node[2];
  Vec<Dim> normal = Vec<Dim>::Zero();  ///< from the first body to the second; zero: neither has a direction
  double front[2] = {-std::numeric_limits<double>::infinity(),
                     -std::numeric_limits<double>::infinity()};  ///< of each, along and against the normal
  Vec<Dim> impulse = Vec<Dim>::Zero();                           ///< on the first
  Vec<Dim> by_friction = Vec<Dim>::Zero();                       ///< the part of it across the normal
};

template <int Dim> class GridContact final : public Interaction<Dim> {
 public:
  GridContact(const PointGrid<Dim>& grid, double friction) : grid_(grid), friction_(friction) {}
  bool is_contact() const override { return true; }
  void apply_impulses(World<Dim>& world, double kick, double dt) override;
  void finish_kick(World<Dim>& world, double kick, double dt) override;

 private:
  void find_shared(const World<Dim>& world);
  void find_normals(const World<Dim>& world);
  void find_fronts(const World<Dim>& world);
  /// Calls visit(particle, gradient of a spline, number of a shared node, which of the two it is) for the particles of
  /// a chunk and the shared nodes around them.
  template <class Visit> void for_each_shared(const World<Dim>& world, std::size_t c, const Visit& visit) const;

  const PointGrid<Dim>& grid_;
  double friction_;
  std::vector<SharedNode<Dim>> shared_;
  std::vector<std::vector<std::pair<Index, int>>> at_node_;  ///< by node: shared nodes, and which of the two it is
};

template <int Dim> void GridContact<Dim>::find_shared(const World<Dim>& world) {
  shared_.clear();
  at_node_.assign(static_cast<std::size_t>(world.nodes.size()), {});
  for (Index b = 0; b < world.num_bodies(); ++b)
    for (Index c = b + 1; c < world.num_bodies(); ++c)
      grid_.grids()[b].for_each([&](Index node, const Site<Dim>& site) {
        const Index other = grid_.grids()[c].find(site);
        if (other < 0 || !(world.nodes.mass[node] > 0.0) || !(world.nodes.mass[other] > 0.0)) return;
        const auto k = static_cast<Index>(shared_.size());
        shared_.push_back({.node = {node, other}});
        at_node_[node].emplace_back(k, 0);
        at_node_[other].emplace_back(k, 1);
      });
}

template <int Dim> template <class Visit>
void GridContact<Dim>::for_each_shared(const World<Dim>& world, std::size_t c, const Visit& visit) const {
  const Chunk<Dim>& chunk = world.chunks[c];
  const Particles<Dim>& of = grid_.particles[c];
  const std::vector<Index>& nodes = chunk.table.nodes;
  if (std::ranges::all_of(nodes, [&](Index a) { return at_node_[a].empty(); })) return;
  thread_local std::vector<Index> node_at;
  node_at.assign(of.marked.size(), -1);
  for (std::size_t l = 0; l < nodes.size(); ++l) node_at[of.slots[l]] = nodes[l];
  for (Index p = 0; p < of.count(); ++p)
    for_each_site<Dim>(of.box, of.positions(chunk).col(p).data(),
                       [&](const std::array<std::ptrdiff_t, 3>& place, double, const Vec<Dim>& dN) {
                         std::ptrdiff_t slot = place[Dim - 1];
                         for (int i = 0; i + 1 < Dim; ++i)
                           slot += place[static_cast<std::size_t>(i)] * of.box.stride[i];
                         for (const auto& [k, side] : at_node_[node_at[slot]]) visit(p, dN, k, side);
                       });
}

/// Normals by the gradients of the mass: bodies end where it falls.
template <int Dim> void GridContact<Dim>::find_normals(const World<Dim>& world) {
  std::vector<std::array<Vec<Dim>, 2>> slope(shared_.size(), {Vec<Dim>::Zero(), Vec<Dim>::Zero()});
  for (std::size_t c = 0; c < world.chunks.size(); ++c)
    for_each_shared(world, c, [&](Index p, const Vec<Dim>& dN, Index k, int side) {
      slope[k][side] -= grid_.particles[c].masses(world.chunks[c])[p] * dN;  // with the node; dN is with the particle
    });
  for (std::size_t k = 0; k < shared_.size(); ++k) {
    // Of the two the one that is steeper for its mass knows better where it ends.
    Vec<Dim> sum = Vec<Dim>::Zero();
    for (const int side : {0, 1}) {
      const Vec<Dim> by_mass = slope[k][side] / world.nodes.mass[shared_[k].node[side]];
      sum += (side == 0 ? -1.0 : 1.0) * by_mass;
    }
    if (sum.norm() > 0.0) shared_[k].normal = sum.normalized();
  }
}

/// How far particles reach, from the node, along the normal (against it for the second body).
template <int Dim> void GridContact<Dim>::find_fronts(const World<Dim>& world) {
  for (std::size_t c = 0; c < world.chunks.size(); ++c) {
    const Chunk<Dim>& chunk = world.chunks[c];
    const Particles<Dim>& of = grid_.particles[c];
    for_each_shared(world, c, [&](Index p, const Vec<Dim>&, Index k, int side) {
      SharedNode<Dim>& shared = shared_[k];
      const Vec<Dim> along = side == 0 ? shared.normal : Vec<Dim>(-shared.normal);
      const double reach =
          along.dot(of.positions(chunk).col(p) - world.nodes.x.col(shared.node[side])) + of.reach(chunk, p, along);
      shared.front[side] = std::max(shared.front[side], reach);
    });
  }
}

template <int Dim> void GridContact<Dim>::apply_impulses(World<Dim>& world, double /*kick*/, double dt) {
  find_shared(world);
  if (shared_.empty()) return;
  find_normals(world);
  find_fronts(world);
  Nodes<Dim>& nodes = world.nodes;
  for (SharedNode<Dim>& shared : shared_) {
    const auto [a, b] = shared.node;
    const double gap = -(shared.front[0] + shared.front[1]);
    // What overlaps is not pushed out, which would make it fast: where a body ends is known to a part of a cell.
    const double allowed = std::max(gap, 0.0) / dt;
    const Vec<Dim> relative = nodes.v.col(a) - nodes.v.col(b);
    const double excess = relative.dot(shared.normal) - allowed;
    if (!(excess > 0.0)) continue;
    // Velocity along the normal by an impulse of one; none of what is prescribed.
    const auto mobility_of = [&](Index node) {
      return nodes.free.col(node).cwiseProduct(shared.normal).squaredNorm() / nodes.mass[node];
    };
    const double mobility = mobility_of(a) + mobility_of(b);
    if (!(mobility > 0.0)) continue;
    const Vec<Dim> slip = relative - relative.dot(shared.normal) * shared.normal;
    const double sliding = slip.norm(), most = friction_ * excess;
    shared.by_friction = -(sliding > most ? most / sliding : 1.0) / mobility * slip;
    shared.impulse = -excess / mobility * shared.normal + shared.by_friction;
    world.contacts.add(body_partner(nodes.body[a]), body_partner(nodes.body[b]), nodes.x.col(a), shared.impulse);
    nodes.v.col(a) += nodes.free.col(a).cwiseProduct(shared.impulse) / nodes.mass[a];
    nodes.v.col(b) -= nodes.free.col(b).cwiseProduct(shared.impulse) / nodes.mass[b];
  }
}

template <int Dim> void GridContact<Dim>::finish_kick(World<Dim>& world, double /*kick*/, double /*dt*/) {
  const Nodes<Dim>& nodes = world.nodes;
  double lost = 0.0, lost_by_friction = 0.0, held = 0.0;
  for (const SharedNode<Dim>& shared : shared_) {
    const auto [a, b] = shared.node;
    const Vec<Dim> twice_a = nodes.v.col(a) + nodes.v_before.col(a), twice_b = nodes.v.col(b) + nodes.v_before.col(b);
    lost_by_friction -= 0.5 * shared.by_friction.dot(twice_a - twice_b);
    for (const auto& [node, impulse] : {std::pair(a, shared.impulse), std::pair(b, Vec<Dim>(-shared.impulse))}) {
      // Supports take what would change velocities that are prescribed.
      const Vec<Dim> v = nodes.v.col(node), before = nodes.v_before.col(node),
                     on_support = impulse - nodes.free.col(node).cwiseProduct(impulse);
      held -= on_support.dot(v);
      lost -= 0.5 * impulse.dot(v + before) - 0.5 * on_support.dot(before - v);
    }
  }
  world.ledger.add_energy("contact", EnergyKind::loss, lost - lost_by_friction);
  world.ledger.add_energy("friction", EnergyKind::loss, lost_by_friction);
  world.ledger.add_energy("prescribed", EnergyKind::work, held);
}

}  // namespace

template <int Dim> std::unique_ptr<Interaction<Dim>> grid_contact(const PointGrid<Dim>& grid, double friction) {
  return std::make_unique<GridContact<Dim>>(grid, friction);
}

template <int Dim> ContactPoints<Dim> find_contact_points(const World<Dim>& world, const PointGrid<Dim>& grid,
                                                          const RigidShape<Dim>& gap_at, double reach) {
  std::vector<ContactPoints<Dim>> near(world.chunks.size());
  parallel_chunks(static_cast<Index>(world.chunks.size()), 1, [&](Index c, Index) {
    const Chunk<Dim>& chunk = world.chunks[c];
    const Particles<Dim>& of = grid.particles[c];
    const Points<Dim>& x = of.positions(chunk);
    const Vec<Dim> low = x.rowwise().minCoeff(), high = x.rowwise().maxCoeff();
    if (gap_at(0.5 * (low + high)).gap > 0.5 * (high - low).norm() + reach + grid.cell()) return;
    for (Index p = 0; p < of.count(); ++p) {
      Gap<Dim> gap = gap_at(x.col(p));
      if (!(gap.gap < reach + grid.cell())) continue;
      const double half = of.reach(chunk, p, gap.normal);
      if (!((gap.gap -= half) < reach)) continue;
      const Vec<Dim> at = x.col(p) - half * gap.normal;
      near[c].begin_point(of.identity(world, chunk, p), at, gap);
      // Splines there, of the nodes that there are.
      for_each_site<Dim>(of.box, at.data(), [&](const std::array<std::ptrdiff_t, 3>& place, double N, const Vec<Dim>&) {
        Site<Dim> site = of.low;
        for (int i = 0; i < Dim; ++i) site[i] += static_cast<Index>(place[static_cast<std::size_t>(i)]);
        const Index node = N > 0.0 ? grid.of_body(chunk.body).find(site) : -1;
        if (node >= 0 && world.nodes.mass[node] > least_mass * of.masses(chunk)[p]) near[c].add_node(node, N);
      });
      near[c].end_point();
    }
  });
  ContactPoints<Dim> result;
  for (const auto& part : near) result.append(part);
  return result;
}

#define EFREE_INSTANTIATE(Dim)                                                                                      \
  template std::unique_ptr<Interaction<Dim>> grid_contact(const PointGrid<Dim>&, double);                           \
  template ContactPoints<Dim> find_contact_points(const World<Dim>&, const PointGrid<Dim>&, const RigidShape<Dim>&, \
                                                  double);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree::internal
