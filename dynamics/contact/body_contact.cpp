// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/contact/internal/surfaces.hpp"

#include <iterator>

namespace efree::internal {
namespace {

/// Square of the highest frequency of contact springs alone, times that of the step: leapfrog is stable up to 4.
constexpr double stable_springs = 2.0;

/// Contact pairs of nodes of a surface and facets of other bodies.
template <int Dim> class BodyContact final : public Interaction<Dim> {
 public:
  explicit BodyContact(const Scheme<Dim>& scheme) : scheme_(scheme) {}

  /// Friction, by the contact forces at the beginning of the step.
  void apply_impulses(World<Dim>& world, double kick, double /*dt*/) override {
    if (!has_friction(world)) return;
    Points<Dim>& v = world.nodes.v;
    const Vector& mass = world.nodes.mass;
    friction_impulses_.setZero(Dim, world.nodes.size());
    for (const ContactPair& pair : pairs_) {
      Vec<Dim> slip = pair.relative([&](Index a) { return v.col(a); });
      double mobility = 1.0 / mass[pair.node];
      for (const auto& [b, weight, lever] : pair.facet) mobility += weight * weight / mass[b];
      slip -= pair.normal.dot(slip) * pair.normal;
      const double speed = slip.norm();
      if (!(speed > 0.0) || !std::isfinite(mobility)) continue;
      const double size =
          std::min(world.options.contact.friction * pair.stiffness * pair.depth * kick, speed / mobility);
      const Vec<Dim> friction = size / speed * slip;
      const auto apply = [&](Index a, const Vec<Dim>& impulse) {
        v.col(a) += impulse / mass[a];
        friction_impulses_.col(a) += impulse;
      };
      apply(pair.node, -friction);
      // Across the gap the two have a moment, which impulses along the normal balance.
      for (const auto& [b, weight, lever] : pair.facet)
        apply(b, weight * friction - pair.gap * lever.dot(friction) * pair.normal);
    }
  }

  void finish_kick(World<Dim>& world, double /*kick*/, double /*dt*/) override {
    if (!has_friction(world)) return;
    const Nodes<Dim>& nodes = world.nodes;
    world.ledger.add_energy("contact", EnergyKind::loss,
                            -(0.5 * friction_impulses_.cwiseProduct(nodes.v + nodes.v_before).sum()));
  }

  void add_forces(World<Dim>& world) override {
    if (!acts(world)) return;
    auto start = std::chrono::steady_clock::now();
    surfaces_.update(world, scheme_);
    find_pairs(world);
    world.ledger.add_energy("contact", EnergyKind::loss, apply_springs(world));
    std::swap(pairs_, new_pairs_);
    stored_ = 0.0;
    for (const ContactPair& pair : pairs_) stored_ += pair.energy;
    x_before_ = world.nodes.x;
    world.ledger.add_time("contact", seconds_since(start));
  }

  void add_stiffness(const World<Dim>&, const Points<Dim>& displacement, Points<Dim>& force) const override {
    for (const ContactPair& pair : pairs_) {
      const Vec<Dim> relative = pair.relative([&](Index a) { return displacement.col(a); });
      pair.add_force(pair.stiffness * pair.normal.dot(relative) * pair.normal, force);
    }
  }

  double longest_step(const World<Dim>& world) const override {
    return world.num_bodies() > 1 ? step_of_half_spacing(world) : Interaction<Dim>::longest_step(world);
  }

  void inspect(World<Dim>& world) override {
    if (!acts(world) || !surfaces_.is_current(world)) return;
    std::vector<Index> all;
    std::ranges::set_union(penetrated_, points_in_others(world, surfaces_), std::back_inserter(all));
    world.ledger.add_count("penetrated points", static_cast<std::int64_t>(all.size() - penetrated_.size()));
    penetrated_ = std::move(all);
  }

  void tally(const World<Dim>& world, EnergyBalance<Dim>& balance) const override {
    if (acts(world)) balance.energies.add_energy("contact", EnergyKind::loss, stored_);
  }

  void nodes_inserted(const World<Dim>& world, Index first, Index count) override {
    for (ContactPair& pair : pairs_) {
      shift_node(pair.node, first, count);
      for (FacetNode& other : pair.facet) shift_node(other.node, first, count);
    }
    insert_columns<Dim>(x_before_, first, world.nodes.x.middleCols(first, count));
  }

  bool stiffness_changes() const override { return !pairs_.empty(); }

  void pack(Archive& archive) override {
    surfaces_.pack(archive);
    archive(x_before_, pairs_, penetrated_, stored_);
  }

 private:
  /// A node of the facet in a contact pair.
  struct FacetNode {
    Index node;
    double weight;   ///< its shape function at the nearest point of the facet
    Vec<Dim> lever;  ///< forces lever . s along the normal, of all nodes, sum up to zero and to the moment s x normal
    friend auto fields(FacetNode& of) {
      auto& [node, weight, lever] = of;
      return std::tie(node, weight, lever);
    }
  };
  /// A penalty spring between a node and a facet that it has penetrated. Its depth is limited by the work done on it:
  /// it never releases more.
  struct ContactPair {
    Index node;
    double stiffness;
    Vec<Dim> normal;  ///< outwards of the other body
    std::array<FacetNode, Dim> facet;
    double gap = 0.0;     ///< negative
    double depth = 0.0;   ///< compression of the spring, at most -gap
    double energy = 0.0;  ///< work done on it and not released
    /// Values at nodes: the node's less that of the facet at its nearest point.
    template <class Values> Vec<Dim> relative(const Values& values) const {
      Vec<Dim> result = values(node);
      for (const FacetNode& other : facet) result -= other.weight * values(other.node);
      return result;
    }
    /// Calls visit(node, weight) for its nodes.
    template <class Visit> void for_each_node(const Visit& visit) const {
      visit(node, 1.0);
      for (const FacetNode& other : facet) visit(other.node, other.weight);
    }
    /// A force on the node and the opposite one on the facet.
    void add_force(const Vec<Dim>& force, Points<Dim>& forces) const {
      forces.col(node) += force;
      for (const FacetNode& other : facet) forces.col(other.node) -= other.weight * force;
    }
    friend auto fields(ContactPair& pair) {
      auto& [node, stiffness, normal, facet, gap, depth, energy] = pair;
      return std::tie(node, stiffness, normal, facet, gap, depth, energy);
    }
  };

  static bool acts(const World<Dim>& world) { return world.options.contact.stiffness > 0.0 && world.num_bodies() > 1; }
  bool has_friction(const World<Dim>& world) const { return world.options.contact.friction > 0.0 && !pairs_.empty(); }

  /// The nearest point of the other body's surface to a node inside that body. False if the node is not inside.
  bool find_pair(const World<Dim>& world, const typename BodySurfaces<Dim>::Near& near, ContactPair& pair) const {
    const Points<Dim>& x = world.nodes.x;
    const Vector& spacing = world.nodes.spacing;
    const Facets<Dim>& facets = surfaces_.surfaces()[near.body].facets;
    const Vec<Dim> at = x.col(near.node);
    NearestFacet<Dim> nearest(1e-9 * spacing[near.node], 1e-9 * std::pow(spacing[near.node], Dim - 1));
    for (const Index f : near.facets) nearest.compare(f, facet_corners(x, facets, f).colwise() - at);
    const Index best = nearest.facet();
    if (best < 0 || !nearest.is_inside() || nearest.distance() > largest_depth * spacing[facets(0, best)]) return false;
    pair.node = near.node;
    pair.gap = -nearest.to().norm();  // that of this facet: nearest.distance() may be that of another, within the slack
    pair.normal = nearest.to() / -pair.gap;
    const Mat<Dim> corner = facet_corners(x, facets, best).colwise() - at;
    const Vec<Dim> middle = corner.rowwise().mean();
    const Mat<Dim> tangential = Mat<Dim>::Identity() - pair.normal * pair.normal.transpose();
    const Mat<Dim> arms = tangential * (corner.colwise() - middle);
    const Mat<Dim> inverse =
        (arms * arms.transpose() + arms.squaredNorm() * pair.normal * pair.normal.transpose()).inverse();
    for (int i = 0; i < Dim; ++i) pair.facet[i] = {facets(i, best), nearest.weights()[i], inverse * arms.col(i)};
    const double modulus = std::min(world.bodies[world.nodes.body[near.node]].modulus, world.bodies[near.body].modulus);
    // Half of it, as the other body's nodes have springs, too.
    pair.stiffness = 0.5 * world.options.contact.stiffness * modulus * surfaces_.area()[near.node] / spacing[near.node];
    return true;
  }

  /// Limits the stiffness of springs to that at which they are all stable in the step, by the masses of their nodes
  /// (Gershgorin's circles).
  void limit_stiffnesses(const World<Dim>& world) {
    node_stiffness_.setZero(world.nodes.size());
    for (const ContactPair& pair : new_pairs_)
      pair.for_each_node([&](Index a, double weight) { node_stiffness_[a] += weight * pair.stiffness; });
    const auto factor = [&](Index a) {
      const double most = stable_springs * world.nodes.mass[a] / (2.0 * world.stable_step * world.stable_step);
      return node_stiffness_[a] > most ? most / node_stiffness_[a] : 1.0;
    };
    for (ContactPair& pair : new_pairs_) {
      double least = 1.0;
      pair.for_each_node([&](Index a, double weight) { least = weight > 0.0 ? std::min(least, factor(a)) : least; });
      pair.stiffness *= least;
    }
  }

  /// Pairs of this step, still without energy.
  void find_pairs(const World<Dim>& world) {
    const auto& near = surfaces_.near();
    new_pairs_.assign(near.size(), {});
    parallel_chunks(static_cast<Index>(near.size()), 64, [&](Index begin, Index end) {
      for (Index k = begin; k < end; ++k)
        if (!find_pair(world, near[k], new_pairs_[k])) new_pairs_[k].stiffness = 0.0;
    });
    const auto is_none = [](const ContactPair& pair) { return !(pair.stiffness > 0.0); };
    std::erase_if(new_pairs_, is_none);
    limit_stiffnesses(world);
    std::erase_if(new_pairs_, is_none);
  }

  /// Work of springs since the last step as in leapfrog: the mean of the forces at both ends times the relative
  /// displacement, so that the energy of the springs is the energy that bodies have lost, to rounding. Where the
  /// nearest point jumps, or points broke and a node is inside a new surface, the spring is compressed no further than
  /// its energy allows, and than the node has moved inwards. Adds the forces; returns the energy of springs that are no
  /// more.
  double apply_springs(World<Dim>& world) {
    Nodes<Dim>& nodes = world.nodes;
    const Points<Dim>& x = nodes.x;
    if (x_before_.size() == 0) x_before_ = x;
    const auto relative_displacement = [&](const ContactPair& pair) {
      return pair.normal.dot(pair.relative([&](Index a) -> Vec<Dim> { return x.col(a) - x_before_.col(a); }));
    };
    const auto key = [&](const ContactPair& pair) { return std::pair(pair.node, nodes.body[pair.facet.front().node]); };
    energies_.clear();
    for (const ContactPair& pair : pairs_)
      energies_.emplace_back(key(pair), pair.energy - 0.5 * pair.stiffness * pair.depth * relative_displacement(pair));
    std::ranges::sort(energies_);
    for (ContactPair& pair : new_pairs_) {
      const auto last =
          std::ranges::lower_bound(energies_, key(pair), {}, &std::pair<std::pair<Index, Index>, double>::first);
      if (last != energies_.end() && last->first == key(pair)) pair.energy = std::exchange(last->second, 0.0);
      // The energy stored afterwards, k depth^2 / 2, is at most that and the second half of the work, -k depth out / 2.
      const double out = relative_displacement(pair), square = out * out + 8.0 * pair.energy / pair.stiffness;
      pair.depth = std::min(-pair.gap, square > 0.0 ? std::max(0.0, 0.5 * (std::sqrt(square) - out)) : 0.0);
      pair.energy -= 0.5 * pair.stiffness * pair.depth * out;
      pair.add_force(pair.stiffness * pair.depth * pair.normal, nodes.force);
    }
    double lost = 0.0;
    for (const auto& [pair, energy] : energies_) lost += energy;
    return lost;
  }

  const Scheme<Dim>& scheme_;
  BodySurfaces<Dim> surfaces_;
  Points<Dim> x_before_;            ///< positions of the nodes when pairs were found
  std::vector<ContactPair> pairs_;  ///< of the last step
  std::vector<Index> penetrated_;   ///< points that were in another body so far, ascending
  double stored_ = 0.0;             ///< energy of the springs
  Points<Dim> friction_impulses_;   ///< on the nodes in this step
  // Room that steps do not have to allocate.
  std::vector<ContactPair> new_pairs_;
  std::vector<std::pair<std::pair<Index, Index>, double>> energies_;  ///< by node and other body
  Vector node_stiffness_;                                             ///< sum over the springs of a node
};

}  // namespace

template <int Dim> std::unique_ptr<Interaction<Dim>> body_contact(const Scheme<Dim>& scheme) {
  return std::make_unique<BodyContact<Dim>>(scheme);
}

template std::unique_ptr<Interaction<2>> body_contact(const Scheme<2>&);
template std::unique_ptr<Interaction<3>> body_contact(const Scheme<3>&);

}  // namespace efree::internal
