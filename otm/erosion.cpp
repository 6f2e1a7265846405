// SPDX-License-Identifier: GPL-3.0-or-later
/// Points that break: when, and what is left of them.
#include "efree/core/parallel.hpp"
#include "efree/otm/internal/motion.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace efree::internal {

template <int Dim> bool Motion<Dim>::breaks() const {
  return std::any_of(bodies.begin(), bodies.end(), [](const BodyOf& body) { return body.fracture.on(); });
}

/// Which cells are around each node, once something is eroded.
template <int Dim> void Motion<Dim>::find_stars() {
  stars.clear();
  star_offsets.clear();
  if (counts.eroded == 0) return;
  for (std::size_t b = 0; b + 1 < bodies.size(); ++b) {
    const Cells<Dim>& cells = bodies[b].cells;
    std::vector<Index>& offsets = star_offsets.emplace_back(bodies[b + 1].first_node - bodies[b].first_node + 1, 0);
    const auto is_whole = [&](Eigen::Index c) {
      const auto [in, p] = place_of_point[bodies[b].first_point + c];
      return !chunks[in].is_eroded(p);
    };
    for (Eigen::Index c = 0; c < cells.cols(); ++c)
      for (const Index a : cells.col(c)) offsets[a + 1] += is_whole(c) ? 1 : 0;
    std::partial_sum(offsets.begin(), offsets.end(), offsets.begin());
    std::vector<Index>& star = stars.emplace_back(offsets.back());
    std::vector<Index> next(offsets.begin(), offsets.end() - 1);
    for (Eigen::Index c = 0; c < cells.cols(); ++c)
      for (const Index a : cells.col(c))
        if (is_whole(c)) star[next[a]++] = static_cast<Index>(c);
  }
}

/// Of these nodes, ascending, those that cells which are not eroded join to the point's own, by nodes among these:
/// functions do not reach across cracks.
template <int Dim> void Motion<Dim>::keep_connected(Index of_body, Index point, std::vector<Index>& nodes) const {
  const BodyOf& body = bodies[of_body];
  const std::vector<Index>&offsets = star_offsets[of_body], &star = stars[of_body];
  thread_local std::vector<char> reached;
  thread_local std::vector<Index> front;
  reached.assign(nodes.size(), 0);
  front.clear();
  for (const Index a : body.cells.col(point)) front.push_back(a);
  while (!front.empty()) {
    const Index from = front.back();
    front.pop_back();
    for (Index e = offsets[from]; e < offsets[from + 1]; ++e)
      for (const Index a : body.cells.col(star[e])) {
        const auto place = std::lower_bound(nodes.begin(), nodes.end(), body.first_node + a);
        if (place == nodes.end() || *place != body.first_node + a || reached[place - nodes.begin()] != 0) continue;
        reached[place - nodes.begin()] = 1;
        front.push_back(a);
      }
  }
  std::size_t kept = 0;
  for (std::size_t k = 0; k < nodes.size(); ++k)
    if (reached[k] != 0 || body_of_node[nodes[k]] != of_body) nodes[kept++] = nodes[k];
  nodes.resize(kept);
}

/// Which points were near each other at the start.
template <int Dim> void Motion<Dim>::find_balls() {
  std::vector<std::vector<Index>> found(place_of_point.size());
  for (std::size_t b = 0; b + 1 < bodies.size(); ++b) {
    const BodyOf& body = bodies[b];
    if (!(body.fracture.toughness > 0.0)) continue;
    const Index first = body.first_point, count = bodies[b + 1].first_point - first;
    Points<Dim> at(Dim, count);
    const auto chunk_of = [&](Index p) {
      const auto& [c, k] = place_of_point[first + p];
      return std::pair<const OtmChunk<Dim>&, Index>(chunks[c], k);
    };
    for (Index p = 0; p < count; ++p) {
      const auto [chunk, k] = chunk_of(p);
      at.col(p) = chunk.now.X.col(k).template head<Dim>();
    }
    Neighbours<Dim> tree;
    tree.build(at);
    parallel_for(count, [&](Index p) {
      const auto [chunk, k] = chunk_of(p);
      if (body.fracture.neighbourhood > 0.0)
        tree.within(at.col(p), chunk.reach[k], found[first + p]);
      else
        found[first + p].assign(1, p);
      for (Index& q : found[first + p]) q += first;
    });
  }
  ball_offsets.assign(1, 0);
  balls.clear();
  ball_mass.setZero(static_cast<Index>(found.size()));
  for (std::size_t p = 0; p < found.size(); ++p) {
    balls.insert(balls.end(), found[p].begin(), found[p].end());
    ball_offsets.push_back(static_cast<Index>(balls.size()));
    for (const Index q : found[p]) {
      const auto [c, k] = place_of_point[q];
      ball_mass[static_cast<Index>(p)] += chunks[c].mass[k];
    }
  }
}

/// Mass times stored energy of the points under tension.
template <int Dim> Vector Motion<Dim>::tension_energies() const {
  Vector result = Vector::Zero(static_cast<Index>(place_of_point.size()));
  parallel_chunks(static_cast<Index>(chunks.size()), 1, [&](Index c, Index) {
    const OtmChunk<Dim>& chunk = chunks[c];
    const BodyOf& body = bodies[chunk.body];
    if (!(body.fracture.toughness > 0.0)) return;
    for (Index p = 0; p < chunk.size(); ++p)
      if (!chunk.is_eroded(p) && chunk.response.P.col(p).dot(chunk.now.F.col(p)) > 0.0)
        result[body.first_point + chunk.number[p]] = chunk.mass[p] * chunk.response.energy[p];
  });
  return result;
}

template <int Dim> double Motion<Dim>::release_rate(Index point, const Vector& energies) const {
  if (!(energies[point] > 0.0)) return 0.0;
  const auto [c, k] = place_of_point[point];
  double sum = 0.0;
  for (Index e = ball_offsets[point]; e < ball_offsets[point + 1]; ++e) sum += energies[balls[e]];
  return bodies[chunks[c].body].release * chunks[c].reach[k] * sum / ball_mass[point];
}

template <int Dim> Vector Motion<Dim>::release_rates(const Vector& energies) const {
  Vector result(energies.size());
  parallel_for(static_cast<Index>(energies.size()), [&](Index p) { result[p] = release_rate(p, energies); });
  return result;
}

/// Damage of a chunk's points by the step that the material has answered to. Those that are eroded already answer
/// nothing, and remember what they did.
template <int Dim> void Motion<Dim>::wear_down(OtmChunk<Dim>& chunk) const {
  const BodyOf& body = bodies[chunk.body];
  MaterialResponse& now = chunk.response;
  for (Index p = 0; p < chunk.size(); ++p) {
    if (chunk.is_eroded(p)) {
      now.P.col(p).setZero();
      now.energy[p] = now.dissipated[p] = 0.0;
      now.history.col(p) = chunk.now.history.col(p);
      continue;
    }
    const Mat<3> F = chunk.now.gradient(p);
    if (body.fracture.stretch > 0.0) {
      Eigen::SelfAdjointEigenSolver<Mat<3>> axes;
      axes.computeDirect(F.transpose() * F, Eigen::EigenvaluesOnly);
      if (axes.eigenvalues()[2] >= body.fracture.stretch * body.fracture.stretch) chunk.damage[p] = 1.0;
    }
    if (!body.fracture.strain) continue;
    const Index row = body.plastic_strain;
    const double flow = now.history(row, p) - chunk.now.history(row, p);
    if (!(flow > 0.0)) continue;
    const auto& [D, reference, melting] = *body.fracture.strain;
    Mat<3> tau = now.stress(p) * F.transpose();
    const double mean = tau.trace() / 3.0;
    tau.diagonal().array() -= mean;
    const double triaxiality = mean / (std::sqrt(1.5) * tau.norm());
    const double rate = std::max(0.0, std::log(flow / (chunk.now.dt * reference)));
    const double warm = body.temperature >= 0 && melting > 0.0 ? now.history(body.temperature, p) / melting : 0.0;
    const double at_failure = (D[0] + D[1] * std::exp(D[2] * triaxiality)) * (1.0 + D[3] * rate) * (1.0 + D[4] * warm);
    chunk.damage[p] = at_failure > 0.0 ? std::min(1.0, chunk.damage[p] + flow / at_failure) : 1.0;
  }
}

/// Points break, those that release most energy first.
template <int Dim> void Motion<Dim>::fracture() {
  auto start = Clock::now();
  std::vector<Index> broken;
  for (const auto& chunk : chunks)
    for (Index p = 0; p < chunk.size(); ++p)
      if (!chunk.is_eroded(p) && chunk.damage[p] >= 1.0)
        broken.push_back(bodies[chunk.body].first_point + chunk.number[p]);
  if (ball_offsets.empty()) find_balls();
  if (!balls.empty()) {
    Vector energies = tension_energies();
    for (const Index p : broken) energies[p] = 0.0;
    const Vector rates = release_rates(energies);
    std::vector<std::pair<double, Index>> order;
    const auto toughness = [&](Index p) { return bodies[chunks[place_of_point[p].first].body].fracture.toughness; };
    for (Index p = 0; p < rates.size(); ++p)
      if (rates[p] > 0.0 && rates[p] >= toughness(p)) order.emplace_back(-rates[p] / toughness(p), p);
    std::sort(order.begin(), order.end());
    for (const auto& [minus, p] : order) {
      // What broke before releases no more.
      if (release_rate(p, energies) < toughness(p)) continue;
      energies[p] = 0.0;
      broken.push_back(p);
    }
  }
  times.fracture += lap(start);
  if (!broken.empty()) erode(broken);
}

/// They bear no stress from now on. Forces are found anew.
template <int Dim> void Motion<Dim>::erode(const std::vector<Index>& broken) {
  for (const Index point : broken) {
    const auto [c, p] = place_of_point[point];
    OtmChunk<Dim>& chunk = chunks[c];
    const double lost = chunk.volume[p] * chunk.response.energy[p];
    fracture_loss += lost + unseen(chunk, p);
    stored[c] -= lost;
    chunk.volume[p] = chunk.penalty[p] = chunk.shock[p] = 0.0;
    if (chunk.now.heat.size() != 0) chunk.now.heat[p] = 0.0;
    chunk.response.P.col(p).setZero();
    chunk.response.energy[p] = 0.0;
    chunk.damage[p] = 1.0;
    ++counts.eroded;
    // The others of its union go on from the dilatation that they shared with it.
    const auto last = std::upper_bound(chunk.unions.begin(), chunk.unions.end(), p);
    for (Index q = *std::prev(last); q < *last; ++q)
      if (!chunk.is_eroded(q)) chunk.made.col(q) /= std::cbrt(std::exchange(chunk.growth[q], 1.0));
    // Points that see nodes of its cell see them past it, perhaps.
    const BodyOf& body = bodies[chunk.body];
    if (!body.renewed || body.cells.cols() == 0) continue;
    for (const Index corner : body.cells.col(chunk.number[p])) {
      const Index a = body.first_node + corner;
      for (Index k = node_offsets[a]; k < node_offsets[a + 1]; ++k) {
        OtmChunk<Dim>& other = chunks[node_places[k].first];
        for (Index q = 0; q < other.size(); ++q)
          if (!other.is_eroded(q) &&
              std::find(other.local.begin() + other.offsets[q], other.local.begin() + other.offsets[q + 1],
                        node_places[k].second) != other.local.begin() + other.offsets[q + 1])
            other.wear(q);
      }
    }
  }
  // Those that broke after they were told to.
  for (auto& chunk : chunks)
    for (std::vector<Index>* points : {&chunk.worn, &chunk.crushed})
      std::erase_if(*points, [&](Index p) { return chunk.is_eroded(p); });
  parallel_chunks(static_cast<Index>(chunks.size()), 1, [&](Index c, Index) {
    deform(chunks[c], x);
    for (Index p = 0; p < chunks[c].size(); ++p) place(chunks[c], p);
    press(chunks[c]);
  });
  const Points<Dim> pulled = force;
  force = collected();
  weigh();
  surfaces.clear();
  seen_at.resize(Dim, 0);
  touch();
  inflate();
  // Leapfrog's next impulse, from half a step ago on, is without them: from then on they stored no more.
  fracture_loss -= 0.5 * last_step * v.cwiseProduct(force - pulled).sum();
}

template struct Motion<2>;
template struct Motion<3>;

}  // namespace efree::internal
