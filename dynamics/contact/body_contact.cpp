// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/contact/internal/friction.hpp"
#include "efree/dynamics/contact/internal/least_energy.hpp"
#include "efree/dynamics/contact/internal/surfaces.hpp"
#include "efree/dynamics/masses.hpp"

#include <iterator>
#include <optional>

namespace efree::internal {
namespace {

/// How fast nodes inside another body move out at most: this part of their depth in a stable step.
constexpr double push_out = 0.1;
/// Gap up to which a node and a facet that do not approach are still a pair, over the spacing: friction may be due.
constexpr double near_gap = 0.5;

/// A node of the facet in a contact pair.
template <int Dim> struct FacetNode {
  Index node;
  double weight;   ///< its shape function at the nearest point of the facet
  Vec<Dim> lever;  ///< forces lever . s along the normal, of all nodes, sum up to zero and to the moment s x normal
  friend auto fields(FacetNode& of) {
    auto& [node, weight, lever] = of;
    return std::tie(node, weight, lever);
  }
};

/// A node and the nearest point of another body's surface, or of its own.
template <int Dim> struct ContactPair {
  Index node;
  Vec<Dim> normal;  ///< outwards of the facet
  std::array<FacetNode<Dim>, Dim> facet;
  double gap = 0.0;                     ///< negative inside
  Vec<Dim> impulse = Vec<Dim>::Zero();  ///< on the node in the last step
  DelayedFriction friction{};
  double lost = 0.0;  ///< energy that impulses along the normal have taken so far, less what pushing out has given

  /// Calls visit(node, value) with the values by which an impulse on the node goes to all nodes of the pair. Across the
  /// gap the two have a moment, which impulses along the normal balance.
  template <class Visit> void for_each_node(const Visit& visit) const {
    visit(node, Mat<Dim>(Mat<Dim>::Identity()));
    for (const FacetNode<Dim>& other : facet)
      visit(other.node, Mat<Dim>(gap * normal * other.lever.transpose() - other.weight * Mat<Dim>::Identity()));
  }
  friend auto fields(ContactPair& pair) {
    auto& [node, normal, facet, gap, impulse, friction, lost] = pair;
    return std::tie(node, normal, facet, gap, impulse, friction, lost);
  }
};

/// Relative velocities of contact pairs by impulses on them. Both have R components: one along the normals, or all.
template <int Dim, int R> class PairMobility {
 public:
  using Block = Eigen::Matrix<double, Dim, R>;

  PairMobility(const World<Dim>& world, const std::vector<ContactPair<Dim>>& pairs) {
    std::vector<Index> number(world.nodes.size(), -1);
    for (const ContactPair<Dim>& pair : pairs) {
      pair.for_each_node([&](Index a, const Mat<Dim>& value) {
        if (number[a] < 0) {
          number[a] = static_cast<Index>(nodes_.size());
          nodes_.push_back(a);
        }
        if constexpr (R == 1)
          entries_.push_back({number[a], value * pair.normal});
        else
          entries_.push_back({number[a], value});
      });
    }
    mobility_ = world.nodes.free(Eigen::all, nodes_);
    for (std::size_t k = 0; k < nodes_.size(); ++k)
      mobility_.col(k) *= world.nodes.mass[nodes_[k]] > 0.0 ? 1.0 / world.nodes.mass[nodes_[k]] : 0.0;
    // Gershgorin's circles.
    Vector sums = Vector::Zero(std::ssize(nodes_));
    for (const auto& [node, block] : entries_) sums[node] += block.norm();
    bounds_.setZero(std::ssize(pairs));
    for (std::size_t e = 0; e < entries_.size(); ++e)
      bounds_[e / (Dim + 1)] +=
          entries_[e].block.norm() * sums[entries_[e].node] * mobility_.col(entries_[e].node).maxCoeff();
  }

  Index size() const { return bounds_.size(); }
  const Vector& bounds() const { return bounds_; }
  Points<R> velocities(const Points<R>& impulses) const { return at_pairs(mobility_.cwiseProduct(on_nodes(impulses))); }
  /// Relative velocities where the nodes have these.
  Points<R> relative(const Points<Dim>& v) const { return at_pairs(v(Eigen::all, nodes_)); }
  /// Adds what such impulses are on the nodes.
  void add(const Points<R>& impulses, Points<Dim>& sum) const {
    const Points<Dim> of = on_nodes(impulses);
    for (std::size_t k = 0; k < nodes_.size(); ++k) sum.col(nodes_[k]) += of.col(k);
  }

 private:
  struct Entry {
    Index node;
    Block block;
  };
  Points<Dim> on_nodes(const Points<R>& impulses) const {
    Points<Dim> result = Points<Dim>::Zero(Dim, std::ssize(nodes_));
    for (std::size_t e = 0; e < entries_.size(); ++e)
      result.col(entries_[e].node) += entries_[e].block * impulses.col(e / (Dim + 1));
    return result;
  }
  Points<R> at_pairs(const Points<Dim>& of_nodes) const {
    Points<R> result = Points<R>::Zero(R, size());
    for (std::size_t e = 0; e < entries_.size(); ++e)
      result.col(e / (Dim + 1)) += entries_[e].block.transpose() * of_nodes.col(entries_[e].node);
    return result;
  }

  std::vector<Index> nodes_;
  std::vector<Entry> entries_;  ///< Dim + 1 of every pair
  Points<Dim> mobility_;        ///< velocity of nodes by an impulse of one
  Vector bounds_;
};

/// Contact of nodes of a surface with facets of other bodies, or of their own, by impulses.
template <int Dim> class BodyContact final : public Interaction<Dim> {
 public:
  explicit BodyContact(const Scheme<Dim>& scheme) : scheme_(scheme) {}

  void apply_impulses(World<Dim>& world, double /*kick*/, double dt) override {
    on_nodes_.resize(Dim, 0);
    by_friction_.resize(Dim, 0);
    if (!acts(world)) return;
    auto start = std::chrono::steady_clock::now();
    surfaces_.update(world, scheme_);
    find_pairs(world, dt);
    if (!pairs_.empty()) find_impulses(world, dt);
    if (on_nodes_.cols() > 0) {
      Nodes<Dim>& nodes = world.nodes;
      const Points<Dim> on_free = nodes.free.cwiseProduct(on_nodes_);
      nodes.v += velocities_of(world, on_free);
      if (world.consistent_mass.any()) nodes.momentum += on_free;
    }
    world.ledger.add_time("contact", seconds_since(start));
  }

  void finish_kick(World<Dim>& world, double /*kick*/, double /*dt*/) override {
    if (on_nodes_.cols() == 0) return;
    const Nodes<Dim>& nodes = world.nodes;
    const Points<Dim> mean = 0.5 * (nodes.v + nodes.v_before);
    // Supports take what would change velocities that are prescribed.
    const Points<Dim> on_supports = on_nodes_ - nodes.free.cwiseProduct(on_nodes_);
    const double lost_by_friction = by_friction_.cols() > 0 ? -by_friction_.cwiseProduct(mean).sum() : 0.0;
    world.ledger.add_energy("contact", EnergyKind::loss, -on_nodes_.cwiseProduct(mean).sum() - lost_by_friction);
    world.ledger.add_energy("friction", EnergyKind::loss, lost_by_friction);
    world.ledger.add_energy("prescribed", EnergyKind::work, -on_supports.cwiseProduct(mean).sum());
  }

  double longest_step(const World<Dim>& world) const override {
    return world.num_bodies() > 1 ? step_of_half_spacing(world) : Interaction<Dim>::longest_step(world);
  }

  void inspect(World<Dim>& world) override {
    if (!acts(world) || world.num_bodies() < 2 || !surfaces_.is_current(world)) return;
    std::vector<Index> all;
    std::ranges::set_union(penetrated_, points_in_others(world, surfaces_), std::back_inserter(all));
    world.ledger.add_count("penetrated points", static_cast<std::int64_t>(all.size() - penetrated_.size()));
    penetrated_ = std::move(all);
  }

  void nodes_inserted(const World<Dim>&, Index first, Index count) override {
    for (ContactPair<Dim>& pair : pairs_) {
      shift_node(pair.node, first, count);
      for (FacetNode<Dim>& other : pair.facet) shift_node(other.node, first, count);
    }
  }

  void pack(Archive& archive) override {
    surfaces_.pack(archive);
    archive(pairs_, penetrated_);
  }

 private:
  static bool acts(const World<Dim>& world) {
    return world.options.contact.enabled && (world.num_bodies() > 1 || world.has_self_contact(0));
  }

  /// The pair of the last step; none: they were not in contact.
  const ContactPair<Dim>* last_of(const World<Dim>& world, const typename BodySurfaces<Dim>::Near& near) const {
    const auto key = [&](const ContactPair<Dim>& pair) {
      return std::pair(world.nodes.body[pair.facet.front().node], pair.node);
    };
    const std::pair wanted(near.body, near.node);
    const auto last = std::ranges::lower_bound(pairs_, wanted, {}, key);
    return last != pairs_.end() && key(*last) == wanted ? &*last : nullptr;
  }

  /// The facet that the node faces. False if they are not in contact in this step.
  bool find_pair(const World<Dim>& world, const typename BodySurfaces<Dim>::Near& near, double dt,
                 ContactPair<Dim>& pair) const {
    const Nodes<Dim>& nodes = world.nodes;
    const ContactPair<Dim>* last = last_of(world, near);
    const FacingFacet<Dim> facing = surfaces_.facing(world, near, dt, last ? std::optional(last->gap) : std::nullopt);
    if (facing.facet < 0) return false;
    const Facets<Dim>& facets = surfaces_.surfaces()[near.body].facets;
    pair.node = near.node;
    pair.gap = facing.gap;
    pair.normal = facing.normal;
    Vec<Dim> relative = nodes.v.col(near.node);
    for (int i = 0; i < Dim; ++i) relative -= facing.weights[i] * nodes.v.col(facets(i, facing.facet));
    const double approach = std::max(0.0, -pair.normal.dot(relative));
    if (pair.gap > near_gap * nodes.spacing[near.node] + 2.0 * dt * approach) return false;
    const Mat<Dim> corner = facet_corners(nodes.x, facets, facing.facet);
    const Vec<Dim> middle = corner.rowwise().mean();
    const Mat<Dim> tangential = Mat<Dim>::Identity() - pair.normal * pair.normal.transpose();
    const Mat<Dim> arms = tangential * (corner.colwise() - middle);
    const Mat<Dim> inverse =
        (arms * arms.transpose() + arms.squaredNorm() * pair.normal * pair.normal.transpose()).inverse();
    for (int i = 0; i < Dim; ++i) pair.facet[i] = {facets(i, facing.facet), facing.weights[i], inverse * arms.col(i)};
    if (last) std::tie(pair.impulse, pair.friction, pair.lost) = std::tie(last->impulse, last->friction, last->lost);
    return true;
  }

  /// Pairs of this step, ascending as surfaces_.near() is, with what is left of the last one's.
  void find_pairs(const World<Dim>& world, double dt) {
    const auto& near = surfaces_.near();
    new_pairs_.assign(near.size(), {});
    is_pair_.assign(near.size(), 0);
    parallel_chunks(static_cast<Index>(near.size()), 64, [&](Index begin, Index end) {
      for (Index k = begin; k < end; ++k) is_pair_[k] = find_pair(world, near[k], dt, new_pairs_[k]) ? 1 : 0;
    });
    std::size_t count = 0;
    for (std::size_t k = 0; k < near.size(); ++k)
      if (is_pair_[k] != 0) std::swap(new_pairs_[count++], new_pairs_[k]);
    new_pairs_.resize(count);
    std::swap(pairs_, new_pairs_);
  }

  /// How fast a node inside another body moves out of it: no faster than the energy that the pair has lost allows, if
  /// the impulse stays what it was, as contact would make energy otherwise.
  static double push_out_speed(const World<Dim>& world, const ContactPair<Dim>& pair, double impulse, double dt) {
    const double fastest = -push_out * pair.gap / std::max(dt, world.stable_step);
    return impulse > 0.0 ? std::clamp(pair.lost / impulse, 0.0, fastest) : 0.0;
  }

  /// Impulses by which no node enters another body within the step, and those of friction, into on_nodes_, unless there
  /// are none. Where surfaces are curved both act on each other, and bodies come to rest only where that counts: those
  /// along the normals with friction of the last step, and friction with them.
  void find_impulses(World<Dim>& world, double dt) {
    const auto n = std::ssize(pairs_);
    const PairMobility<Dim, 1> along(world, pairs_);
    const Points<1> velocity = along.relative(world.nodes.v);
    Points<1> approach = velocity, normal(1, n);
    Points<Dim> normals(Dim, n), before(Dim, n);
    for (Index k = 0; k < n; ++k) {
      const ContactPair<Dim>& pair = pairs_[k];
      normals.col(k) = pair.normal;
      before.col(k) = pair.impulse;
      normal[k] = std::max(0.0, pair.impulse.dot(pair.normal));
      approach[k] += pair.gap < 0.0 ? -push_out_speed(world, pair, normal[k], dt) : pair.gap / dt;
    }
    const bool is_coupled = world.time >= world.options.rest_from && world.options.contact.friction > 0.0;
    std::optional<PairMobility<Dim, Dim>> all;
    if (is_coupled) {
      all.emplace(world, pairs_);
      approach += normals.cwiseProduct(all->velocities(before - normals * normal.asDiagonal())).colwise().sum();
    }
    const double largest = -approach.minCoeff();
    const IterationEnd end = iteration_end(world, between_bodies);
    if (largest > 0.0)
      minimise_energy<1>(
          along, approach, largest, end, [](Index, const Vec<1>& q) { return Vec<1>(q.cwiseMax(0.0)); }, normal);
    else
      normal.setZero();
    const Points<1> twice_mean = along.relative(world.nodes.v_before) + velocity + along.velocities(normal);
    Points<Dim> impulses = normals * normal.asDiagonal();
    const Points<1> most = find_friction(world, normal, dt);
    if (largest > 0.0 || most.maxCoeff() > 0.0) {
      on_nodes_.setZero(Dim, world.nodes.size());
      along.add(normal, on_nodes_);
    }
    if (most.maxCoeff() > 0.0) {
      if (!all) all.emplace(world, pairs_);
      Points<Dim> slip = all->relative(world.nodes.v);
      if (is_coupled) slip += all->velocities(impulses);
      const Points<Dim> friction = friction_impulses<Dim>(*all, slip, normals, most, 0.0, end, before);
      by_friction_.setZero(Dim, world.nodes.size());
      all->add(friction, by_friction_);
      on_nodes_ += by_friction_;
      impulses += friction;
    }
    for (Index k = 0; k < n; ++k) {
      ContactPair<Dim>& pair = pairs_[k];
      pair.impulse = impulses.col(k);
      pair.lost -= 0.5 * normal[k] * twice_mean[k];
      const Index of = world.nodes.body[pair.node], with = world.nodes.body[pair.facet.front().node];
      if (of != with && !pair.impulse.isZero(0.0))
        world.contacts.add(body_partner(of), body_partner(with), world.nodes.x.col(pair.node), pair.impulse);
    }
  }

  /// The largest impulses of friction of the pairs, by those along the normal.
  Points<1> find_friction(const World<Dim>& world, const Points<1>& normal, double dt) {
    Points<1> most = Points<1>::Zero(1, normal.cols());
    const double mu = world.options.contact.friction;
    if (!(mu > 0.0)) return most;
    for (Index k = 0; k < normal.cols(); ++k) {
      DelayedFriction& friction = pairs_[k].friction;
      friction.press(mu * normal[k], dt, longest_delay(world));
      if (pairs_[k].gap > friction_gap * world.nodes.spacing[pairs_[k].node] && !(normal[k] > 0.0)) continue;
      most[k] = friction.limit();
      friction.grant();
    }
    return most;
  }

  const Scheme<Dim>& scheme_;
  BodySurfaces<Dim> surfaces_;
  std::vector<ContactPair<Dim>> pairs_;
  std::vector<Index> penetrated_;  ///< points that were in another body so far, ascending
  Points<Dim> on_nodes_;           ///< impulses in this step; empty: none
  Points<Dim> by_friction_;        ///< the part of friction; empty: none
  // Room that steps do not have to allocate.
  std::vector<ContactPair<Dim>> new_pairs_;
  std::vector<char> is_pair_;
};

}  // namespace

template <int Dim> std::unique_ptr<Interaction<Dim>> body_contact(const Scheme<Dim>& scheme) {
  return std::make_unique<BodyContact<Dim>>(scheme);
}

template std::unique_ptr<Interaction<2>> body_contact(const Scheme<2>&);
template std::unique_ptr<Interaction<3>> body_contact(const Scheme<3>&);

}  // namespace efree::internal
