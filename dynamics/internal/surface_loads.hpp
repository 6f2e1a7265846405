// SPDX-License-Identifier: GPL-3.0-or-later
/// Loads on parts of the surface, behind surface_load.
#pragma once

#include "efree/dynamics/contact/internal/facet.hpp"
#include "efree/dynamics/internal/loads.hpp"
#include "efree/dynamics/masses.hpp"
#include "efree/dynamics/scheme.hpp"
#include "efree/dynamics/surface_load.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <set>
#include <utility>
#include <vector>

namespace efree::internal {

/// Tractions, pressures, springs and dampers on one part.
template <int Dim> class SurfaceLoads final : public Interaction<Dim> {
 public:
  explicit SurfaceLoads(SurfaceLoad<Dim> load)
      : facets_(std::move(load.part.facets)), functions_(std::move(load.part.functions)), load_(std::move(load)) {}

  /// Dampers, by the velocities that they leave: they shorten no step. Impulses q on the vertices solve
  /// q / (kick C) + N M^-1 N^T q = -N v, by conjugate gradients (one product where vertices are nodes).
  void apply_impulses(World<Dim>& world, double kick, double /*dt*/) override {
    if (load_.damping.isZero(0.0)) return;
    Nodes<Dim>& nodes = world.nodes;
    const Points<Dim> damping = kick * integrate(world, start_, [&](Index, const Vec<Dim>& area) {
                                  return Vec<Dim>(area.norm() * load_.damping);
                                });
    const auto is_damped = (damping.array() > 0.0).eval();
    const auto on_free = [&](const Points<Dim>& q) { return Points<Dim>(nodes.free.cwiseProduct(on_nodes(q))); };
    const auto product = [&](const Points<Dim>& q) {
      const Points<Dim> moved = at_vertices(velocities_of(world, on_free(q)));
      return Points<Dim>(is_damped.select(q.cwiseQuotient(damping) + moved, 0.0));
    };
    const Points<Dim> scale = is_damped.select((damping.cwiseInverse() + lumped_mobility(world)).cwiseInverse(), 0.0);
    Points<Dim> q = Points<Dim>::Zero(Dim, start_.cols()), rest = is_damped.select(-at_vertices(nodes.v), 0.0);
    Points<Dim> scaled = scale.cwiseProduct(rest), direction = scaled;
    double size = rest.cwiseProduct(scaled).sum();
    const double enough = 1e-20 * size;
    for (int k = 0; k < 50 && size > enough; ++k) {
      const Points<Dim> change = product(direction);
      const double length = size / direction.cwiseProduct(change).sum();
      q += length * direction;
      rest -= length * change;
      scaled = scale.cwiseProduct(rest);
      const double next = rest.cwiseProduct(scaled).sum();
      direction = scaled + next / size * direction;
      size = next;
    }
    by_dampers_ = on_free(q);
    nodes.v += velocities_of(world, by_dampers_);
    if (world.consistent_mass.any()) nodes.momentum += by_dampers_;
  }

  void finish_kick(World<Dim>& world, double /*kick*/, double dt) override {
    const Nodes<Dim>& nodes = world.nodes;
    // The force at a time works along half of the way before and half of the way after.
    const Points<Dim> way = 0.5 * (world.last_step * nodes.v_before + dt * nodes.v);
    if (is_carried())
      carry_vertices(world, dt);
    else if (has_forces())
      world.ledger.add_energy("loads", EnergyKind::work, forces_.cwiseProduct(way).sum());
    if (!load_.damping.isZero(0.0))
      world.ledger.add_energy("damping", EnergyKind::loss,
                              -0.5 * by_dampers_.cwiseProduct(nodes.v + nodes.v_before).sum());
  }

  void add_forces(World<Dim>& world) override {
    if (start_.cols() == 0) begin(world);
    if (std::exchange(num_eroded_, world.num_eroded) != world.num_eroded) drop_eroded(world);
    if (is_carried()) return add_carried_forces(world);
    if (has_forces()) {
      const Points<Dim> before = std::exchange(forces_, on_nodes(tractions(world) + pressures(world)));
      world.nodes.force += forces_;
      // Where a point has broken since, the force until then was another one: it worked along half of the way.
      if (std::exchange(time_, world.time) == world.time && before.cols() == forces_.cols())
        world.ledger.add_energy("loads", EnergyKind::work,
                                0.5 * world.last_step * (before - forces_).cwiseProduct(world.nodes.v).sum());
    }
    if (has_springs()) world.nodes.force -= on_nodes(spring_forces(world, displacements(world)));
  }

  /// By the largest row sum of M^-1 N^T K N, with absolute values of N.
  double squared_frequency(const World<Dim>& world) const override {
    if (!has_springs()) return 0.0;
    const SparseRows sizes = functions_.cwiseAbs();
    const Vector sums = sizes * Vector::Ones(sizes.cols());
    const Points<Dim> by_vertex = spring_forces(world, sums.transpose().replicate(Dim, 1));
    const Points<Dim> by_node = (sizes.transpose() * by_vertex.transpose()).transpose();
    double largest = 0.0;
    for (Index a = 0; a < world.nodes.size(); ++a)
      if (const double mass = world.nodes.mass[a]; mass > 0.0)
        largest = std::max(largest, by_node.col(a).maxCoeff() / mass);
    return largest;
  }

  void add_stiffness(const World<Dim>& world, const Points<Dim>& displacement, Points<Dim>& force) const override {
    if (has_springs()) force += on_nodes(spring_forces(world, at_vertices(displacement)));
  }

  void tally(const World<Dim>& world, EnergyBalance<Dim>& balance) const override {
    if (has_forces())
      balance.energies.add_energy(
          "loads", EnergyKind::work,
          0.5 * world.last_step * forces_.cwiseProduct(is_carried() ? velocities_ : world.nodes.v).sum());
    if (!has_springs()) return;
    const Points<Dim> moved = displacements(world);
    balance.energies.add_energy("springs", EnergyKind::stored,
                                0.5 * spring_forces(world, moved).cwiseProduct(moved).sum());
  }

  void nodes_inserted(const World<Dim>& world, Index first, Index count) override {
    renumber(world.nodes.size(), [&](Index a) { return a < first ? a : a + count; });
  }
  void node_merged(const World<Dim>& world, Index node, Index with) override {
    renumber(world.nodes.size(), [&](Index a) { return a == node ? with : a; });
  }
  /// Facets with both ends become two.
  void edge_split(World<Dim>& world, Index a, Index b, Index middle) override {
    const Index of_a = vertex_at(a), of_b = vertex_at(b), added = functions_.rows();
    const Eigen::Index before = facets_.cols();
    if (of_a >= 0 && of_b >= 0) split_facets<Dim>(facets_, of_a, of_b, added);
    if (facets_.cols() == before) return;
    if (!owner_.empty()) owner_.resize(static_cast<std::size_t>(facets_.cols()), -1);
    if (offset_.cols() > 0) {
      offset_.conservativeResize(Eigen::NoChange, added + 1);
      offset_.col(added) = 0.5 * (offset_.col(of_a) + offset_.col(of_b));
    }
    start_.conservativeResize(Eigen::NoChange, added + 1);
    start_.col(added) = 0.5 * (start_.col(of_a) + start_.col(of_b));
    std::vector<Entry> more = entries();
    more.push_back({added, middle, 1.0});
    assemble(added + 1, world.nodes.size(), more);
  }
  /// Laws are given again by whoever resumes a run.
  void pack(Archive& archive) override {
    std::vector<Entry> of = entries();
    auto num_nodes = static_cast<Index>(functions_.cols());
    archive(facets_, start_, forces_, time_, num_eroded_, num_nodes, of, owner_, offset_, at_, velocities_,
            transferred_);
    if (archive.reads()) assemble(static_cast<Index>(start_.cols()), num_nodes, of);
  }

 private:
  /// Of functions_, as Eigen takes it.
  struct Entry {
    Index vertex, node;
    double number;
    Index row() const { return vertex; }
    Index col() const { return node; }
    double value() const { return number; }
    friend auto fields(Entry& of) {
      auto& [vertex, node, number] = of;
      return std::tie(vertex, node, number);
    }
  };

  /// At vertices, if masses were lumped and each moved alone.
  Points<Dim> lumped_mobility(const World<Dim>& world) const {
    Points<Dim> result = Points<Dim>::Zero(Dim, start_.cols());
    for (Index k = 0; k < functions_.rows(); ++k)
      for (SparseRows::InnerIterator entry(functions_, k); entry; ++entry)
        if (const double mass = world.nodes.mass[entry.col()]; mass > 0.0)
          result.col(k) += entry.value() * entry.value() / mass * world.nodes.free.col(entry.col());
    return result;
  }
  bool has_forces() const { return load_.traction || load_.pressure; }
  bool has_springs() const { return !load_.stiffness.isZero(0.0); }
  /// Whether vertices move through the nodes, which do not stay with the material.
  bool is_carried() const { return !load_.part.bodies.empty(); }

  void begin(const World<Dim>& world) {
    const SurfacePart<Dim>& part = load_.part;
    const Eigen::Index count = is_carried() ? std::ssize(part.bodies) : functions_.rows();
    if ((!is_carried() && functions_.cols() != world.nodes.size()) || facets_.size() == 0 || facets_.minCoeff() < 0 ||
        facets_.maxCoeff() >= count)
      throw InputError(fmt::format("a load on a surface: expected facets of vertices that move with the {} nodes",
                                   world.nodes.size()));
    if (is_carried() != static_cast<bool>(world.functions_at))
      throw InputError(
          "a load on a surface: expected positions and bodies of the vertices where nodes do not stay with the "
          "material, and else functions of the nodes");
    if (part.positions.cols() != count && (is_carried() || part.positions.cols() != 0))
      throw InputError("a load on a surface: expected a position for every vertex");
    if (part.places.rows() != 0 && (part.places.rows() != count || part.places.cols() != world.nodes.size()))
      throw InputError(fmt::format("a load on a surface: expected places of vertices that move with the {} nodes",
                                   world.nodes.size()));
    keep_used_vertices(count);
    num_eroded_ = world.num_eroded;
    if (is_carried()) {
      start_ = at_ = part.positions;
      velocities_.setZero(Dim, start_.cols());
    } else {
      renumber(world.nodes.size(), [&](Index a) { return world.nodes.master_of(a); });
      start_ = at_vertices(world.nodes.x);
      if (part.positions.cols() > 0) {
        offset_ = part.positions - start_;
        start_ = part.positions;
      }
    }
    find_owners(world);
    if (load_.traction) law_.resize(Dim, start_.cols());
  }

  /// Positions of the vertices now.
  Points<Dim> positions(const World<Dim>& world) const {
    if (is_carried()) return at_;
    if (const SparseRows& places = load_.part.places; places.rows() > 0)
      return (places * world.nodes.x.transpose()).transpose();
    if (offset_.cols() > 0) return at_vertices(world.nodes.x) + offset_;
    return at_vertices(world.nodes.x);
  }
  /// Of the vertices, by the functions by which loads act.
  Points<Dim> displacements(const World<Dim>& world) const {
    if (is_carried()) return at_ - start_;
    if (offset_.cols() > 0) return at_vertices(world.nodes.x) + offset_ - start_;
    return at_vertices(world.nodes.x) - start_;
  }

  // Vertices that are carried (carried_loads.cpp).
  void find_owners(const World<Dim>& world);
  void add_carried_forces(World<Dim>& world);
  Points<Dim> carried_forces(const World<Dim>& world) const;
  void carry_vertices(World<Dim>& world, double dt);
  void follow_points(World<Dim>& world);

  void keep_used_vertices(Eigen::Index num_vertices) {
    std::vector<Index> number(static_cast<std::size_t>(num_vertices), -1), used_vertices, used_bodies;
    Index count = 0;
    for (Index& vertex : facets_.reshaped()) {
      if (number[vertex] < 0) {
        number[vertex] = count++;
        used_vertices.push_back(vertex);
      }
      vertex = number[vertex];
    }
    SurfacePart<Dim>& part = load_.part;
    if (part.positions.cols() > 0) part.positions = Points<Dim>(part.positions(Eigen::all, used_vertices));
    if (part.places.rows() > 0) {
      SparseRows places(count, static_cast<Index>(part.places.cols()));
      for (Index k = 0; k < count; ++k) {
        places.startVec(k);
        for (SparseRows::InnerIterator entry(part.places, used_vertices[k]); entry; ++entry)
          places.insertBack(k, entry.col()) = entry.value();
      }
      places.finalize();
      part.places = std::move(places);
    }
    for (std::size_t k = 0; k < used_vertices.size() && is_carried(); ++k)
      used_bodies.push_back(part.bodies[used_vertices[k]]);
    part.bodies = used_bodies;
    if (is_carried()) return;
    std::vector<Entry> used = entries();
    std::erase_if(used, [&](const Entry& entry) { return number[entry.vertex] < 0; });
    for (Entry& entry : used) entry.vertex = number[entry.vertex];
    assemble(count, static_cast<Index>(functions_.cols()), used);
  }

  Points<Dim> at_vertices(const Points<Dim>& of_nodes) const { return (functions_ * of_nodes.transpose()).transpose(); }
  Points<Dim> on_nodes(const Points<Dim>& of_vertices) const {
    return (functions_.transpose() * of_vertices.transpose()).transpose();
  }

  /// Forces on the vertices (Dim x K) by what acts on facets where their vertices are `at`, linear between these:
  /// density(vertex, area of the facet along its normal).
  template <class Density>
  Points<Dim> integrate(const World<Dim>& world, const Points<Dim>& at, const Density& density) const {
    Points<Dim> result = Points<Dim>::Zero(Dim, at.cols());
    for (Index f = 0; f < facets_.cols(); ++f) {
      const Vec<Dim> area = area_of<Dim>(facet_corners(at, facets_, f));
      for (const Index j : facets_.col(f)) {
        const Vec<Dim> at_corner = density(j, area) / (Dim * (Dim + 1));
        for (const Index i : facets_.col(f))
          result.col(i) += (i == j ? 2.0 : 1.0) * world.out_of_plane(0.5 * (at(0, i) + at(0, j))) * at_corner;
      }
    }
    return result;
  }
  Points<Dim> tractions(const World<Dim>& world) {
    if (!load_.traction) return Points<Dim>::Zero(Dim, start_.cols());
    for (Index k = 0; k < start_.cols(); ++k) law_.col(k) = load_.traction(start_.col(k), world.time);
    return integrate(world, start_, [&](Index k, const Vec<Dim>& area) { return Vec<Dim>(area.norm() * law_.col(k)); });
  }
  Points<Dim> pressures(const World<Dim>& world) {
    if (!load_.pressure) return Points<Dim>::Zero(Dim, start_.cols());
    Vector pressure(start_.cols());
    for (Index k = 0; k < start_.cols(); ++k) pressure[k] = load_.pressure(start_.col(k), world.time);
    return integrate(world, load_.follows ? positions(world) : start_,
                     [&](Index k, const Vec<Dim>& area) { return Vec<Dim>(-pressure[k] * area); });
  }
  Points<Dim> spring_forces(const World<Dim>& world, const Points<Dim>& moved) const {
    return integrate(world, start_, [&](Index k, const Vec<Dim>& area) {
      return Vec<Dim>(area.norm() * load_.stiffness.cwiseProduct(moved.col(k)));
    });
  }

  /// Takes away facets that are no longer on the surface of what is not broken.
  void drop_eroded(const World<Dim>& world) {
    std::set<std::array<Index, Dim>> outer;
    const auto key = [](const auto& nodes) {
      std::array<Index, Dim> sorted;
      std::ranges::copy(nodes, sorted.begin());
      std::ranges::sort(sorted);
      return sorted;
    };
    for (Index b = 0; b < world.num_bodies(); ++b)
      if (world.bodies[b].cells.cols() > 0 && !is_carried()) {
        const Facets<Dim> facets = outer_facets(world, b);
        for (Index f = 0; f < facets.cols(); ++f) outer.insert(key(facets.col(f)));
      }
    std::vector<Index> kept, owners;
    for (Index f = 0; f < facets_.cols(); ++f) {
      if (!owner_.empty() && owner_[f] >= 0) {
        const auto [chunk, p] = world.locate(owner_[f]);
        if (chunk.is_eroded(p)) continue;
        kept.push_back(f);
        owners.push_back(owner_[f]);
        continue;
      }
      std::array<Index, Dim> nodes;
      for (int i = 0; i < Dim; ++i) nodes[i] = SparseRows::InnerIterator(functions_, facets_(i, f)).col();
      if (!outer.contains(key(nodes))) continue;
      kept.push_back(f);
      if (!owner_.empty()) owners.push_back(-1);
    }
    owner_ = owners;
    facets_ = Facets<Dim>(facets_(Eigen::all, kept));
  }

  /// The vertex that is this node; -1: none is.
  Index vertex_at(Index node) const {
    for (Index k = 0; k < functions_.rows(); ++k)
      if (SparseRows::InnerIterator entry(functions_, k); entry && entry.col() == node && entry.value() == 1.0)
        return k;
    return -1;
  }
  std::vector<Entry> entries() const {
    std::vector<Entry> result;
    for (Index k = 0; k < functions_.rows(); ++k)
      for (SparseRows::InnerIterator entry(functions_, k); entry; ++entry)
        result.push_back({k, static_cast<Index>(entry.col()), entry.value()});
    return result;
  }
  void assemble(Index num_vertices, Index num_nodes, const std::vector<Entry>& from) {
    functions_.resize(num_vertices, num_nodes);
    functions_.setFromTriplets(from.begin(), from.end());
  }
  template <class Renumber> void renumber(Index num_nodes, const Renumber& now) {
    std::vector<Entry> renumbered = entries();
    for (Entry& entry : renumbered) entry.node = now(entry.node);
    assemble(static_cast<Index>(functions_.rows()), num_nodes, renumbered);
  }

  Facets<Dim> facets_;
  SparseRows functions_;        ///< as of SurfacePart
  Points<Dim> start_;           ///< positions of the vertices at the start; empty: it has not begun
  SurfaceLoad<Dim> load_;       ///< of its part the positions at the start and the bodies
  Points<Dim> offset_;          ///< start_ less positions by the functions then; empty: none
  Index num_eroded_ = 0;        ///< of the world when facets were dropped
  Points<Dim> forces_;          ///< of tractions and pressures, on nodes or, where vertices are carried, on these
  double time_ = -1.0;          ///< of these
  std::vector<Index> owner_{};  ///< by facet the point with which it breaks; -1, or empty: it does with its cell
  // Where vertices are carried.
  Points<Dim> at_, velocities_;  ///< of the vertices: positions, velocities half a step ago
  double transferred_ = 0.0;     ///< energy in the last transfer of velocities
  SparseRows by_points_{};       ///< K x M: functions of the points that vertices move with; empty: they do with nodes
  Points<Dim> by_grid_{};        ///< velocities by the nodes in a step before the points have moved
  // In this step.
  Points<Dim> by_dampers_;  ///< impulses on nodes
  Points<Dim> law_;         ///< tractions by vertex
};

}  // namespace efree::internal
