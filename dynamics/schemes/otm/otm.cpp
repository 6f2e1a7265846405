// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/otm/otm.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/dynamics/interaction.hpp"
#include "efree/dynamics/internal/stable_step.hpp"
#include "efree/dynamics/masses.hpp"
#include "efree/dynamics/points.hpp"
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace efree {
namespace {

void require_options(const OtmOptions& options) {
  options.lme.checked();
  require(options.reconnection_strain >= 0.0 && options.reconnection_strain <= 0.5,
          "reconnection_strain: expected 0 to 0.5");
  require(options.anisotropy >= 1.0, "anisotropy: expected at least 1");
  require(options.merging >= 0.0 && options.merging <= 0.9, "merging: expected 0 to 0.9");
  require(options.insertion == 0.0 || (options.insertion >= 1.3 && std::isfinite(options.insertion)),
          "insertion: expected 0, or 1.3 and more");
  require(options.stabilisation >= 0.0 && std::isfinite(options.stabilisation), "stabilisation: expected 0 or more");
}

template <int Dim> class Otm final : public Scheme<Dim> {
 public:
  explicit Otm(const OtmOptions& options) { state_.options = options; }
  std::string name() const override { return "otm"; }

  void begin(World<Dim>& world, std::span<const DeformableBody<Dim>> bodies) override;
  void refresh(World<Dim>& world, internal::StableStep<Dim>& stable) override;
  StrainBounds examine(const World<Dim>& world, Chunk<Dim>& chunk, double dt, StrainBounds bounds) override;
  void point_eroded(World<Dim>& world, Chunk<Dim>& chunk, Index point) override;
  void tally(const World<Dim>& world, EnergyBalance<Dim>& balance) const override;
  void pack(Archive& archive) override { archive(state_.points, state_.merged, state_.nodes_changed, state_.seized); }
  void resume(World<Dim>& world) override {
    for (Index b = 0; b < world.num_bodies(); ++b) state_.outer[b].clear();
  }

 private:
  void begin_supports(World<Dim>& world);
  void hold_inverted(const World<Dim>& world, Chunk<Dim>& chunk) const;

  internal::OtmState<Dim> state_;
};

template <int Dim> void Otm<Dim>::begin_supports(World<Dim>& world) {
  state_.points.resize(world.chunks.size());
  for (std::size_t c = 0; c < world.chunks.size(); ++c) {
    Chunk<Dim>& chunk = world.chunks[c];
    const Index n = chunk.size();
    chunk.support.gamma = state_.options.lme.gamma;
    chunk.support.has_moments = true;
    for (Index p = 0; p < n; ++p) {
      const Index nearest = state_.search.tree(chunk.body).nearest(chunk.matter.x.col(p));
      const double h = world.nodes.spacing[world.first_node[chunk.body] + nearest];
      chunk.support.metric[p] = state_.options.lme.gamma / (h * h) * Mat<Dim>::Identity();
    }
    state_.points[c].lambda.assign(n, Vec<Dim>::Zero());
    state_.points[c].count.setZero(n);
    state_.points[c].width.setZero(n);
  }
}

template <int Dim> void Otm<Dim>::begin(World<Dim>& world, std::span<const DeformableBody<Dim>> bodies) {
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const auto fail = [&](const char* what) { throw InputError(fmt::format("body {}: {}", b, what)); };
    if (bodies[b].nodes.cols() == 0 || bodies[b].points.cols() == 0) fail("expected nodes and points");
    if (bodies[b].shape || bodies[b].surface || bodies[b].mass_terms != 1)
      fail("otm computes shape functions of its own: expected none, or the total Lagrangian scheme");
    if (state_.options.seizing && bodies.size() > 1 && bodies[b].cells.cols() == 0)
      fail("it has no cells, and so no surface by which bodies could seize: expected cells, or no seizing");
    world.bodies[b].holds_inverted = !bodies[b].fracture.on();
  }
  state_.merged.assign(world.nodes.size(), -1);
  state_.outer.resize(bodies.size());
  for (Index b = 0; b < world.num_bodies(); ++b) state_.search.build(world, b);
  begin_supports(world);
  std::vector<std::int64_t> iterations(world.chunks.size());
  parallel_chunks(static_cast<Index>(world.chunks.size()), 1, [&](Index c, Index) {
    Chunk<Dim>& chunk = world.chunks[c];
    std::vector<Index> all(chunk.size());
    std::iota(all.begin(), all.end(), 0);
    const auto first = internal::compute_shape_functions<Dim>(world, state_, c, all, true);
    if (!first.lost.empty()) throw NumericalError(internal::no_shape_functions(world, chunk, first.lost.front()));
    iterations[c] = first.iterations;
    world.put_rows(chunk, all, first.rows);
  });
  for (const char* name : {"reconnections", "lme iterations", "enlarged supports", "kept supports", "shared supports",
                           "merged nodes", "inserted nodes", "merged points"})
    world.ledger.add_count(name, 0);
  world.ledger.add_energy("reconnection", EnergyKind::transfer, 0.0);
  world.ledger.add_count("lme iterations", std::accumulate(iterations.begin(), iterations.end(), std::int64_t{0}));
  world.find_node_chunks();
  if (state_.options.exact_integration && state_.options.reconnection_strain > 0.0)
    internal::integrate_exactly(world, state_);
  sum_lumped_masses(world);
  require_masses(world);
  if (state_.options.seizing) {
    world.options.contact.stiffness = 0.0;
    world.interactions.push_back(internal::seizing<Dim>(*this, state_));
  }
}

template <int Dim> void Otm<Dim>::refresh(World<Dim>& world, internal::StableStep<Dim>& stable) {
  Nodes<Dim>& nodes = world.nodes;
  for (Index a = 0; a < nodes.size(); ++a)
    if (const Index with = state_.merged[a]; with >= 0) {
      nodes.x.col(a) = nodes.x.col(with);
      nodes.x_rest.col(a) = nodes.x_rest.col(with);
      nodes.v.col(a) = nodes.v.col(with);
    }
  // Points are of no two pairs: what pairs them takes turns.
  const OtmOptions& options = state_.options;
  const Index turn = world.steps % 32;
  if (turn == 1 && options.merging > 0.0)
    internal::merge_detached_nodes(world, state_);
  else if (turn == 31 && world.stable_step < options.merging * world.first_stable_step)
    internal::merge_close_nodes(world, state_);
  else if (options.insertion > 0.0 && turn % 8 == 7)
    internal::insert_nodes(world, state_, stable);
  else if (options.insertion > 0.0 && turn % 8 == 3)
    internal::pair_points_to_merge(world, state_);
  internal::reconnect(world, state_, stable);
}

/// Points that the step would invert stay as they were, until they are reconnected.
template <int Dim> void Otm<Dim>::hold_inverted(const World<Dim>& world, Chunk<Dim>& chunk) const {
  double* columns = chunk.columns();
  Matter<Dim>& matter = chunk.matter;
  for (Index p = 0; p < chunk.size(); ++p) {
    if (chunk.is_eroded(p)) continue;
    double* column = columns + 16 * p;
    const bool was_inverted = chunk.is_inverted(p);
    if (!was_inverted && column[10] > least_volume_left) continue;
    const Mat<3> before = Eigen::Map<const Mat<3>>(column);
    if (was_inverted)
      matter.F_since[p] = before;
    else
      internal::hold(world, chunk, p, before);
    const Mat<3> now = before * Eigen::Map<const Mat<3>>(matter.F_table.col(p).data());
    Eigen::Map<Mat<3>>(matter.now.F.col(p).data()) = now;
    matter.J_ratio[p] = now.determinant();
    column[9] = 0.5 * (before.transpose() * before - Mat<3>::Identity()).norm();
    column[10] = 1.0;
  }
}

template <int Dim>
StrainBounds Otm<Dim>::examine(const World<Dim>& world, Chunk<Dim>& chunk, double dt, StrainBounds bounds) {
  if (!bounds.regular || !chunk.inverted.empty()) {
    bounds.regular = false;
    if (world.bodies[chunk.body].holds_inverted && dt > 0.0) hold_inverted(world, chunk);
    bounds = Scheme<Dim>::examine(world, chunk, dt, bounds);
  }
  // What is due soon is reconnected with what is due, as a chunk's tables are written anew at once.
  internal::OtmPoints<Dim>& points = state_.points[static_cast<std::size_t>(&chunk - world.chunks.data())];
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
template <int Dim> void Otm<Dim>::point_eroded(World<Dim>& world, Chunk<Dim>& chunk, Index point) {
  std::erase(state_.points[static_cast<std::size_t>(&chunk - world.chunks.data())].due, point);
  const Cells<Dim>& cells = world.bodies[chunk.body].cells;
  if (cells.cols() == 0) return;
  for (const Index corner : cells.col(chunk.number[point]))
    state_.mark_points_of(world, world.first_node[chunk.body] + corner);
}

template <int Dim> void Otm<Dim>::tally(const World<Dim>& world, EnergyBalance<Dim>& balance) const {
  for (const auto& chunk : world.chunks) balance.energies.add_energy("reconnection", EnergyKind::transfer, chunk.lost);
}

}  // namespace

template <int Dim> std::unique_ptr<Scheme<Dim>> otm(const OtmOptions& options) {
  require_options(options);
  return std::make_unique<Otm<Dim>>(options);
}

template std::unique_ptr<Scheme<2>> otm<2>(const OtmOptions&);
template std::unique_ptr<Scheme<3>> otm<3>(const OtmOptions&);

}  // namespace efree
