// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/otm/otm.hpp"

#include "efree/core/error.hpp"
#include "efree/dynamics/contact/internal/facet.hpp"
#include "efree/dynamics/contact/internal/surfaces.hpp"
#include "efree/dynamics/interaction.hpp"
#include "efree/dynamics/internal/stable_step.hpp"
#include "efree/dynamics/masses.hpp"
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"

#include <fmt/format.h>
#include <numeric>
#include <set>

namespace efree::internal {

template <int Dim> void OtmPoints<Dim>::take(const std::vector<Index>& from, const std::vector<Index>& first) {
  std::vector<Vec<Dim>> lambdas;
  for (const Index p : from) lambdas.push_back(lambda[p]);
  lambda = std::move(lambdas);
  count = count(from).eval();
  width = width(from).eval();
  due = renumbered(due, first);
  stiffened = renumbered(stiffened, first);
}

template <int Dim> const std::vector<NodePair>& OtmState<Dim>::outer_edges(const World<Dim>& world, Index body) {
  std::vector<NodePair>& edges = outer[body];
  if (!edges.empty()) return edges;
  const Cells<Dim>& cells = world.bodies[body].cells;
  std::vector<std::array<Index, Dim>> sides;
  for (Eigen::Index c = 0; c < cells.cols(); ++c) {
    std::array<Index, Dim + 1> corners;
    std::ranges::copy(cells.col(c), corners.begin());
    std::ranges::sort(corners);
    if (std::ranges::adjacent_find(corners) != corners.end()) continue;  // collapsed
    for (const Index opposite : corners) std::ranges::remove_copy(corners, sides.emplace_back().begin(), opposite);
  }
  std::ranges::sort(sides);
  for (std::size_t k = 0; k < sides.size(); ++k) {
    const auto& side = sides[k];
    if ((k > 0 && sides[k - 1] == side) || (k + 1 < sides.size() && sides[k + 1] == side)) continue;
    for (int i = 0; i < Dim; ++i)
      for (int j = 0; j < i; ++j) edges.emplace_back(side[j], side[i]);
  }
  std::ranges::sort(edges);
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  return edges;
}

template <int Dim> std::vector<char> OtmState<Dim>::surface_nodes(const World<Dim>& world) {
  std::vector<char> on_surface(world.nodes.size(), 0);
  for (Index b = 0; b < world.num_bodies(); ++b)
    for (const auto& [a, e] : outer_edges(world, b))
      on_surface[world.first_node[b] + a] = on_surface[world.first_node[b] + e] = 1;
  return on_surface;
}

template <int Dim> void OtmState<Dim>::mark_points_of(const World<Dim>& world, Index node) {
  for_each_point_of(world, node, [&](Index c, Index p) {
    if (!world.chunks[c].is_eroded(p)) points[c].mark(p);
  });
}

template <int Dim> void OtmState<Dim>::merge_node(World<Dim>& world, Index a, Index with) {
  std::ranges::replace(world.nodes.master, a, with);
  world.nodes.master[a] = with;
  // Cells collapse with their edge.
  const Index body = world.nodes.body[a], first = world.first_node[body];
  for (Index& corner : world.bodies[body].cells.reshaped())
    if (corner == a - first) corner = with - first;
  outer[body].clear();
  for_each_point_of(world, a, [&](Index c, Index p) { points[c].mark(p); });
  for (const auto& interaction : world.interactions) interaction->node_merged(world, a, with);
  nodes_changed = true;
  ++world.surface_changes;
  world.ledger.add_count("merged nodes", 1);
}

template <int Dim> void OtmState<Dim>::hold(const World<Dim>& world, Chunk<Dim>& chunk, Index p, const Mat<3>& before) {
  Matter<Dim>& matter = chunk.matter;
  const Mat<3> rate = (matter.F_since[p] - before) * before.inverse();
  const Mat<3> tau = kirchhoff_stress(world, chunk, p);
  chunk.lost += 0.5 * matter.volume[p] * (tau.cwiseProduct(rate).sum() - matter.shock[p] * rate.trace());
  chunk.lost += stabilisation_energy(world, chunk, p, 0.5 * world.last_step);
  chunk.support.stabilisation[p] = matter.shock[p] = 0.0;
  if (matter.now.heat.size() > 0) matter.now.heat[p] = 0.0;
  matter.F_since[p] = before;
  chunk.inverted.insert(std::ranges::lower_bound(chunk.inverted, p), p);
}

template <int Dim> bool OtmState<Dim>::hold_if_inverted(const World<Dim>& world, Chunk<Dim>& chunk, Index p) {
  if (!world.bodies[chunk.body].holds_inverted || chunk.is_eroded(p) || chunk.is_inverted(p)) return false;
  const Mat<3> before = chunk.matter.now.gradient(p) * table_gradient(chunk.matter, p).inverse();
  if (chunk.matter.F_since[p].determinant() / before.determinant() > least_volume_left) return false;
  hold(world, chunk, p, before);
  return true;
}

template struct OtmPoints<2>;
template struct OtmPoints<3>;
template struct OtmState<2>;
template struct OtmState<3>;

namespace {

/// Distance at which bodies seize, over the spacing.
constexpr double seizing_distance = 0.3;

/// Points next to both bodies are due: reconnection gives them nodes of both.
template <int Dim> class Seizing final : public Interaction<Dim> {
 public:
  Seizing(const Scheme<Dim>& scheme, OtmState<Dim>& state) : scheme_(scheme), state_(state) {}

  bool is_contact() const override { return true; }
  void pack(Archive& archive) override { surfaces_.pack(archive); }
  void add_forces(World<Dim>& world) override {
    if (world.num_bodies() < 2) return;
    auto start = std::chrono::steady_clock::now();
    surfaces_.update(world, scheme_);
    seize(world);
    world.ledger.add_time("contact", seconds_since(start));
  }

 private:
  void seize(const World<Dim>& world) {
    const Nodes<Dim>& nodes = world.nodes;
    std::vector<NodePair>& seized = state_.seized;
    std::set<NodePair> found;
    const auto is_seized = [&](Index a, Index body) { return std::ranges::binary_search(seized, NodePair(a, body)); };
    for (const auto& near : surfaces_.near()) {
      const Index a = near.node;
      if (world.nodes.follows(a) || is_seized(a, near.body)) continue;
      const Facets<Dim>& facets = surfaces_.surfaces()[near.body].facets;
      NearestFacet<Dim> nearest(1e-9 * nodes.spacing[a]);
      for (const Index f : near.facets)
        nearest.compare(f, facet_corners<Dim>(nodes.x, facets, f).colwise() - nodes.x.col(a));
      const Index f = nearest.facet();
      if (f < 0 || nearest.distance() > seizing_distance * 0.5 * (nodes.spacing[a] + nodes.spacing[facets(0, f)]))
        continue;
      found.emplace(a, near.body);
      for (const Index b : facets.col(f))
        if (!is_seized(b, nodes.body[a])) found.emplace(b, nodes.body[a]);
    }
    if (found.empty()) return;
    for (const auto& [a, body] : found) state_.mark_points_of(world, a);
    seized.insert(seized.end(), found.begin(), found.end());
    std::ranges::sort(seized);
    state_.nodes_changed = true;
  }

  const Scheme<Dim>& scheme_;
  OtmState<Dim>& state_;
  BodySurfaces<Dim> surfaces_;
};

void require_options(const OtmOptions& options) {
  options.lme.checked();
  require(options.reconnection_strain >= 0.0 && options.reconnection_strain <= 0.5,
          "reconnection_strain: expected 0 to 0.5");
  require(options.anisotropy >= 1.0, "anisotropy: expected at least 1");
  require(options.merging >= 0.0 && options.merging <= 0.9, "merging: expected 0 to 0.9");
  require(options.insertion == 0.0 || (options.insertion >= 1.3 && std::isfinite(options.insertion)),
          "insertion: expected 0, or 1.3 and more");
  require(options.stabilisation >= 0.0 && std::isfinite(options.stabilisation), "stabilisation: expected 0 or more");
  require(options.pressure_diffusion >= 0.0 && options.pressure_diffusion <= 10.0,
          "pressure_diffusion: expected 0 to 10");
}

template <int Dim> class Otm final : public Scheme<Dim> {
 public:
  explicit Otm(const OtmOptions& options) { state_.options = options; }
  std::string name() const override { return "otm"; }
  void pack(Archive& archive) override {
    archive(state_.points, state_.nodes_changed, state_.seized, state_.references);
  }
  void resume(World<Dim>&) override { state_.outer.assign(state_.outer.size(), {}); }

  void begin(World<Dim>& world, std::span<const DeformableBody<Dim>> bodies) override {
    require_bodies(bodies);
    state_.outer.resize(bodies.size());
    for (Index b = 0; b < world.num_bodies(); ++b) world.bodies[b].holds_inverted = !bodies[b].fracture.on();
    state_.search.follow(world);
    if (state_.options.seizing) world.options.contact.enabled = false;
    require(!world.options.tied || state_.options.insertion == 0.0,
            "tied bodies get no new nodes: expected no insertion");
    state_.visibility.update(world);
    begin_reference_pressures(world, state_);
    begin_supports(world);
    std::vector<std::int64_t> iterations(world.chunks.size());
    parallel_chunks(static_cast<Index>(world.chunks.size()), 1, [&](Index c, Index) {
      Chunk<Dim>& chunk = world.chunks[c];
      std::vector<TableRow> rows(chunk.size());
      ShapeFunctions<Dim> shape_functions(world, state_);
      for (Index p = 0; p < chunk.size(); ++p) {
        const PointChange first = shape_functions.compute(c, p, rows[p]);
        if (first.lost) shape_functions.fail_at(chunk, p);
        iterations[c] += first.iterations;
      }
      world.put_rows(chunk, rows);
    });
    for (const char* name : {"reconnections", "lme iterations", "enlarged supports", "kept supports", "shared supports",
                             "merged nodes", "inserted nodes", "merged points"})
      world.ledger.add_count(name, 0);
    world.ledger.add_energy("reconnection", EnergyKind::transfer, 0.0);
    world.ledger.add_count("lme iterations", std::accumulate(iterations.begin(), iterations.end(), std::int64_t{0}));
    world.find_node_chunks();
    if (state_.options.exact_integration && state_.options.reconnection_strain > 0.0) integrate_exactly(world, state_);
    sum_lumped_masses(world);
    require_masses(world);
    if (state_.options.seizing) world.interactions.push_back(std::make_unique<Seizing<Dim>>(*this, state_));
  }

  void find_masses(World<Dim>& world) override { sum_lumped_masses(world); }

  void refresh(World<Dim>& world, StableStep<Dim>& stable) override {
    const auto changes = [&] {
      return std::tuple(world.reconnections, world.surface_changes, world.ledger.count("merged nodes"));
    };
    const auto before = changes();
    // Points are of no two pairs: what pairs them takes turns.
    diffuse_pressures(world, state_);
    const OtmOptions& options = state_.options;
    const Index turn = world.steps % 32;
    if (turn == 1 && options.merging > 0.0)
      merge_detached_nodes(world, state_);
    else if (turn == 31 && world.stable_step < options.merging * world.first_stable_step)
      merge_close_nodes(world, state_);
    else if (options.insertion > 0.0 && turn % 8 == 7)
      insert_nodes(world, state_, stable);
    else if (options.insertion > 0.0 && turn % 8 == 3)
      pair_points_to_merge(world, state_);
    reconnect(world, state_, stable);
    if (world.nodes.added_mass.size() != 0 && changes() != before) sum_added_masses(world);
  }

  void collect_forces(World<Dim>& world) override {
    Scheme<Dim>::collect_forces(world);
    add_reference_pressures(world, state_);
  }

  StrainBounds examine(const World<Dim>& world, Chunk<Dim>& chunk, double dt, StrainBounds bounds) override {
    if (!bounds.regular || !chunk.inverted.empty()) {
      bounds.regular = false;
      if (world.bodies[chunk.body].holds_inverted && dt > 0.0) hold_inverted(world, chunk);
      bounds = Scheme<Dim>::examine(world, chunk, dt, bounds);
    }
    // What is due soon is reconnected with what is due, as a chunk's tables are written anew at once.
    OtmPoints<Dim>& points = points_of(world, chunk);
    const double limit = state_.options.reconnection_strain;
    const double* columns = chunk.columns();
    points.due.clear();
    if (bounds.since_table > limit)
      for (Index p = 0; p < chunk.size(); ++p)
        if (!chunk.is_eroded(p) && columns[16 * p + 9] > 0.7 * limit) points.due.push_back(p);
    for (const Index p : chunk.inverted) points.mark(p);
    return bounds;
  }

  /// Points with nodes of its cell in their support have them past it, perhaps.
  void point_eroded(World<Dim>& world, Chunk<Dim>& chunk, Index point) override {
    std::erase(points_of(world, chunk).due, point);
    const Cells<Dim>& cells = world.bodies[chunk.body].cells;
    if (cells.cols() == 0) return;
    for (const Index corner : cells.col(chunk.number[point]))
      state_.mark_points_of(world, world.nodes.master_of(world.first_node[chunk.body] + corner));
  }

  void tally(const World<Dim>& world, EnergyBalance<Dim>& balance) const override {
    for (const auto& chunk : world.chunks)
      balance.energies.add_energy("reconnection", EnergyKind::transfer, chunk.lost);
    for (const auto& reference : state_.references)
      balance.energies.add_energy("stored", EnergyKind::stored, reference.energy);
  }

 private:
  OtmPoints<Dim>& points_of(const World<Dim>& world, const Chunk<Dim>& chunk) {
    return state_.points[world.number_of(chunk)];
  }

  void require_bodies(std::span<const DeformableBody<Dim>> bodies) const {
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      const auto fail = [&](const char* what) { throw InputError(fmt::format("body {}: {}", b, what)); };
      if (bodies[b].nodes.cols() == 0 || bodies[b].points.cols() == 0) fail("expected nodes and points");
      if (bodies[b].shape || bodies[b].surface || bodies[b].mass_terms != 1)
        fail("otm computes shape functions of its own: expected none, or the total Lagrangian scheme");
      if (state_.options.seizing && bodies.size() > 1 && bodies[b].cells.cols() == 0)
        fail("it has no cells, and so no surface by which bodies could seize: expected cells, or no seizing");
    }
  }

  void begin_supports(World<Dim>& world) {
    for (auto& chunk : world.chunks) {
      const Index n = chunk.size();
      chunk.support.gamma = state_.options.lme.gamma;
      chunk.support.has_moments = true;
      for (Index p = 0; p < n; ++p) {
        const Index nearest = state_.search.nearest(chunk.body, chunk.matter.x.col(p));
        const double h = world.nodes.spacing[world.first_node[chunk.body] + nearest];
        chunk.support.metric[p] = state_.options.lme.gamma / (h * h) * Mat<Dim>::Identity();
      }
      OtmPoints<Dim>& points = state_.points.emplace_back();
      points.lambda.assign(n, Vec<Dim>::Zero());
      points.count.setZero(n);
      points.width.setZero(n);
    }
  }

  /// Points that the step would invert stay as they were, until they are reconnected.
  void hold_inverted(const World<Dim>& world, Chunk<Dim>& chunk) {
    Matter<Dim>& matter = chunk.matter;
    for (Index p = 0; p < chunk.size(); ++p) {
      if (chunk.is_eroded(p)) continue;
      double* column = chunk.columns() + 16 * p;
      const Mat<3> before = Eigen::Map<const Mat<3>>(column);
      if (chunk.is_inverted(p))
        matter.F_since[p] = before;
      else if (column[10] > least_volume_left)
        continue;
      else
        state_.hold(world, chunk, p, before);
      const Mat<3> now = before * table_gradient(matter, p);
      Eigen::Map<Mat<3>>(matter.now.F.col(p).data()) = now;
      matter.J_ratio[p] = now.determinant();
      column[9] = 0.5 * (before.transpose() * before - Mat<3>::Identity()).norm();
      column[10] = 1.0;
    }
  }

  OtmState<Dim> state_;
};

}  // namespace
}  // namespace efree::internal

namespace efree {

template <int Dim> std::unique_ptr<Scheme<Dim>> otm(const OtmOptions& options) {
  internal::require_options(options);
  return std::make_unique<internal::Otm<Dim>>(options);
}

template std::unique_ptr<Scheme<2>> otm<2>(const OtmOptions&);
template std::unique_ptr<Scheme<3>> otm<3>(const OtmOptions&);

}  // namespace efree
