// SPDX-License-Identifier: GPL-3.0-or-later
/// Motion of the nodes, as far as walls, prescribed velocities and other bodies let them.
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/otm/internal/facet.hpp"
#include "efree/otm/internal/motion.hpp"

#include <fmt/format.h>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <set>
#include <utility>

namespace efree::internal {
namespace {

/// How far nodes may go before they look for other bodies again, over the spacing.
constexpr double contact_skin = 0.25;
/// How far nodes get into a body before they count as on its other side, over the spacing.
constexpr double deepest = 0.8;
/// How near bodies that seize have to come, over the spacing.
constexpr double seizes = 0.3;
/// Square of the highest frequency of springs between bodies alone, times that of the step: leapfrog bears 4.
constexpr double softest_step = 2.0;

/// Facets of a cell that is positively oriented, outwards.
constexpr int facets_of_cell[2][4][3] = {{{0, 1, -1}, {1, 2, -1}, {2, 0, -1}, {-1, -1, -1}},
                                         {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}};

/// A sum that remembers what rounding keeps from it (Kahan 1965): over many steps, moments of momentum would feel it.
template <int Dim> void add(const Points<Dim>& more, Points<Dim>& sum, Points<Dim>& rest) {
  for (Eigen::Index a = 0; a < sum.cols(); ++a)
    for (int i = 0; i < Dim; ++i) {
      const double change = more(i, a) + rest(i, a), before = sum(i, a);
      sum(i, a) += change;
      rest(i, a) = change - (sum(i, a) - before);
    }
}

}  // namespace

/// The facets that only one cell has, of those that are not eroded.
template <int Dim> void Motion<Dim>::find_surface() {
  surfaces.assign(bodies.size() - 1, {});
  surface_area.setZero(x.cols());
  for (std::size_t b = 0; b + 1 < bodies.size(); ++b) {
    const Cells<Dim>& cells = bodies[b].cells;
    std::map<std::array<Index, Dim>, std::pair<int, std::array<Index, Dim>>> sides;
    for (Eigen::Index c = 0; c < cells.cols(); ++c) {
      const auto [in, p] = place_of_point[bodies[b].first_point + c];
      if (chunks[in].is_eroded(p)) continue;
      std::set<Index> different;
      for (const Index a : cells.col(c)) different.insert(a);
      if (static_cast<int>(different.size()) <= Dim) continue;  // collapsed
      for (int side = 0; side <= Dim; ++side) {
        std::array<Index, Dim> facet;
        for (int i = 0; i < Dim; ++i) facet[i] = bodies[b].first_node + cells(facets_of_cell[Dim - 2][side][i], c);
        std::array<Index, Dim> key = facet;
        std::sort(key.begin(), key.end());
        auto& [count, as_seen] = sides[key];
        ++count;
        as_seen = facet;
      }
    }
    Surface& surface = surfaces[b];
    std::vector<std::array<Index, Dim>> outer;
    std::set<Index> nodes;
    for (const auto& [key, side] : sides) {
      const auto& [count, facet] = side;
      Mat<Dim> corner;
      for (int i = 0; i < Dim; ++i) corner.col(i) = x.col(facet[i]);
      const bool on_axis = axisymmetric() && !(corner.row(0).maxCoeff() > 1e-9 * spacing[facet[0]]);
      if (count > 1 || on_axis) continue;
      outer.push_back(facet);
      nodes.insert(facet.begin(), facet.end());
      const double around = across(corner.row(0).mean());
      for (const Index a : facet) surface_area[a] += around * area_of<Dim>(corner).norm() / Dim;
    }
    surface.facets.resize(Dim, static_cast<Eigen::Index>(outer.size()));
    for (std::size_t f = 0; f < outer.size(); ++f)
      for (int i = 0; i < Dim; ++i) surface.facets(i, static_cast<Eigen::Index>(f)) = outer[f][i];
    surface.nodes.assign(nodes.begin(), nodes.end());
  }
}

template <int Dim> Mat<Dim> Motion<Dim>::corners(const Facets<Dim>& facets, Eigen::Index f) const {
  Mat<Dim> result;
  for (int i = 0; i < Dim; ++i) result.col(i) = x.col(facets(i, f));
  return result;
}

/// The facets of a surface by where they are.
template <int Dim> struct Motion<Dim>::FacetTree {
  Neighbours<Dim> centres{};
  double widest = 0.0, reach = 0.0;  ///< of the spacings, and from a facet's centre to its corners [length]

  FacetTree(const Motion& of, const Facets<Dim>& facets) {
    Points<Dim> centre(Dim, facets.cols());
    for (Eigen::Index f = 0; f < facets.cols(); ++f) {
      const Mat<Dim> corner = of.corners(facets, f);
      centre.col(f) = corner.rowwise().mean();
      reach = std::max(reach, std::sqrt((corner.colwise() - centre.col(f)).colwise().squaredNorm().maxCoeff()));
      for (int i = 0; i < Dim; ++i) widest = std::max(widest, of.spacing[facets(i, f)]);
    }
    centres.build(centre);
  }
};

/// Points that are in another body, by half a spacing and more. Bodies whose cells have collapsed, or broken, have no
/// surface that says so.
template <int Dim> std::vector<Index> Motion<Dim>::points_in_others() const {
  std::set<Index> result;
  for (std::size_t b = 0; b < surfaces.size(); ++b) {
    const Facets<Dim>& facets = surfaces[b].facets;
    const BodyOf &body = bodies[b], &next = bodies[b + 1];
    const auto first = merged.begin() + body.first_node, last = merged.begin() + next.first_node;
    if (facets.cols() == 0 || std::any_of(first, last, [](Index with) { return with >= 0; })) continue;
    if (std::ranges::any_of(chunks, [&](const auto& chunk) {
          return chunk.body == static_cast<Index>(b) && (chunk.damage.array() >= 1.0).any();
        }))
      continue;
    const FacetTree tree(*this, facets);
    const auto nodes = x.middleCols(body.first_node, next.first_node - body.first_node);
    const Eigen::AlignedBox<double, Dim> box(nodes.rowwise().minCoeff(), nodes.rowwise().maxCoeff());
    std::vector<Index> found;
    for (const auto& chunk : chunks) {
      if (chunk.body == static_cast<Index>(b)) continue;
      for (Index p = 0; p < chunk.size(); ++p) {
        const Vec<Dim> at = chunk.at.col(p);
        if (chunk.is_eroded(p) || !box.contains(at)) continue;
        tree.centres.within(at, tree.reach + tree.widest, found);
        NearestFacet<Dim> nearest(1e-9 * tree.widest);
        for (const Index f : found) nearest.look(f, corners(facets, f).colwise() - at);
        if (nearest.facet() < 0 || !nearest.is_inside()) continue;
        if (nearest.distance() < 0.5 * spacing[facets(0, nearest.facet())]) continue;
        result.insert(bodies[chunk.body].first_point + chunk.number[p]);
      }
    }
  }
  return {result.begin(), result.end()};
}

/// Those that the surface of another body did not hold.
template <int Dim> void Motion<Dim>::find_passed() {
  if (!has_contact() || options.contact.seizing || surfaces.empty()) return;
  std::vector<Index> all;
  std::ranges::set_union(passed, points_in_others(), std::back_inserter(all));
  passed = std::move(all);
  counts.passed = static_cast<Index>(passed.size());
}

/// Which facets of other bodies are near which nodes.
template <int Dim> void Motion<Dim>::find_near() {
  seen_at = x;
  approaching.clear();
  for (std::size_t b = 0; b < surfaces.size(); ++b) {
    const Facets<Dim>& facets = surfaces[b].facets;
    if (facets.cols() == 0) continue;
    const FacetTree tree(*this, facets);
    std::vector<Index> found;
    for (std::size_t other = 0; other < surfaces.size(); ++other) {
      if (other == b) continue;
      for (const Index a : surfaces[other].nodes) {
        tree.centres.within(x.col(a), tree.reach + contact_skin * (tree.widest + spacing[a]) + deepest * tree.widest,
                            found);
        if (!found.empty()) approaching.push_back({a, static_cast<Index>(b), found});
      }
    }
  }
}

/// Where a node is inside another body: the nearest point of its surface. False if it is not.
template <int Dim> bool Motion<Dim>::find_touch(const Near& of, Touch& touch) const {
  const Facets<Dim>& facets = surfaces[of.body].facets;
  const Vec<Dim> at = x.col(of.node);
  NearestFacet<Dim> nearest(1e-9 * spacing[of.node], 1e-9 * std::pow(spacing[of.node], Dim - 1));
  for (const Index f : of.facets) nearest.look(f, corners(facets, f).colwise() - at);
  const Index best = nearest.facet();
  if (best < 0 || !nearest.is_inside() || nearest.distance() > deepest * spacing[facets(0, best)]) return false;
  touch.node = of.node;
  touch.gap = -nearest.to().norm();  // as good as the nearest, which may be none of those that say so
  touch.normal = nearest.to() / -touch.gap;
  const Mat<Dim> corner = corners(facets, best).colwise() - at;
  const Vec<Dim> middle = corner.rowwise().mean();
  const Mat<Dim> along = Mat<Dim>::Identity() - touch.normal * touch.normal.transpose();
  const Mat<Dim> arms = along * (corner.colwise() - middle);
  const Mat<Dim> about =
      (arms * arms.transpose() + arms.squaredNorm() * touch.normal * touch.normal.transpose()).inverse();
  for (int i = 0; i < Dim; ++i) touch.patch[i] = {facets(i, best), nearest.weights()[i], about * arms.col(i)};
  const double modulus = std::min(bodies[body_of_node[of.node]].modulus, bodies[of.body].modulus);
  // Half of it, as the other body's nodes push as well.
  touch.stiffness = 0.5 * options.contact.stiffness * modulus * surface_area[of.node] / spacing[of.node];
  return true;
}

/// Bodies whose nodes a point may see: its own, those it sees already, and those that nodes it sees have seized.
template <int Dim>
void Motion<Dim>::partners_of(const OtmChunk<Dim>& chunk, Index p, std::vector<Index>& partners) const {
  partners.assign(1, chunk.body);
  if (seized.empty()) return;
  const auto add = [&](Index body) {
    const auto place = std::lower_bound(partners.begin(), partners.end(), body);
    if (place == partners.end() || *place != body) partners.insert(place, body);
  };
  for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e) {
    const Index a = chunk.nodes[chunk.local[e]];
    add(body_of_node[a]);
    for (auto by = std::lower_bound(seized.begin(), seized.end(), std::pair(a, Index(0)));
         by != seized.end() && by->first == a; ++by)
      add(by->second);
  }
}

/// Where bodies come near each other their points are worn: renewal gives them nodes of both.
template <int Dim> void Motion<Dim>::seize() {
  std::vector<std::pair<Index, Index>> found;
  const auto is_seized = [&](Index a, Index body) {
    return std::binary_search(seized.begin(), seized.end(), std::pair(a, body));
  };
  for (const Near& of : approaching) {
    if (merged[of.node] >= 0 || is_seized(of.node, of.body)) continue;
    const Facets<Dim>& facets = surfaces[of.body].facets;
    NearestFacet<Dim> nearest(1e-9 * spacing[of.node]);
    for (const Index f : of.facets) nearest.look(f, corners(facets, f).colwise() - x.col(of.node));
    const Index f = nearest.facet(), body = body_of_node[of.node];
    if (f < 0 || nearest.distance() > seizes * 0.5 * (spacing[of.node] + spacing[facets(0, f)])) continue;
    found.push_back({of.node, of.body});
    for (const Index b : facets.col(f))
      if (!is_seized(b, body)) found.emplace_back(b, body);
  }
  if (found.empty()) return;
  std::sort(found.begin(), found.end());
  found.erase(std::unique(found.begin(), found.end()), found.end());
  for (const auto& [a, body] : found)
    for (Index k = node_offsets[a]; k < node_offsets[a + 1]; ++k) {
      const auto [c, l] = node_places[k];
      OtmChunk<Dim>& chunk = chunks[c];
      for (Index p = 0; p < chunk.size(); ++p)
        if (!chunk.is_eroded(p) &&
            std::any_of(chunk.local.begin() + chunk.offsets[p], chunk.local.begin() + chunk.offsets[p + 1],
                        [l = l](std::uint16_t local) { return local == l; }))
          chunk.wear(p);
    }
  const auto before = static_cast<std::ptrdiff_t>(seized.size());
  seized.insert(seized.end(), found.begin(), found.end());
  std::inplace_merge(seized.begin(), seized.begin() + before, seized.end());
  changed_nodes = true;
}

/// Springs no stiffer than the masses between them bear in the step, together (by Gershgorin's circles).
template <int Dim> void Motion<Dim>::soften(std::vector<Touch>& springs) {
  pressed.setZero(x.cols());
  for (const Touch& one : springs) {
    if (!(one.stiffness > 0.0)) continue;
    pressed[one.node] += one.stiffness;
    for (const auto& held : one.patch) pressed[held.node] += held.weight * one.stiffness;
  }
  const auto borne = [&](Index a) {
    const double most = softest_step * mass[a] / (2.0 * stable * stable);
    return pressed[a] > most ? most / pressed[a] : 1.0;
  };
  for (Touch& one : springs) {
    if (!(one.stiffness > 0.0)) continue;
    double least = borne(one.node);
    for (const auto& held : one.patch)
      if (held.weight > 0.0) least = std::min(least, borne(held.node));
    one.stiffness *= least;
  }
}

/// Forces between bodies that are in each other's way. Their work since the last step is that of leapfrog, the mean of
/// both ends' forces times the way, so that what springs have taken is what bodies have lost, to rounding. Where the
/// nearest point jumps, or points broke and a node is inside a surface that is new, the spring is compressed no further
/// than that pays for, and by what the node goes deeper.
template <int Dim> void Motion<Dim>::touch() {
  if (!has_contact()) return;
  auto start = Clock::now();
  if (surfaces.empty()) find_surface();
  bool look = seen_at.size() == 0;
  for (Index a = 0; a < x.cols() && !look; ++a)
    look = (x.col(a) - seen_at.col(a)).squaredNorm() > contact_skin * contact_skin * spacing[a] * spacing[a];
  if (look) find_near();
  if (options.contact.seizing) {
    seize();
    times.contact += lap(start);
    return;
  }
  touching.assign(approaching.size(), {});
  parallel_chunks(static_cast<Index>(approaching.size()), 64, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k)
      if (!find_touch(approaching[k], touching[k])) touching[k].stiffness = 0.0;
  });
  soften(touching);
  std::erase_if(touching, [](const Touch& one) { return !(one.stiffness > 0.0); });
  if (met.size() == 0) met = x;
  const auto way = [&](const Touch& one) {
    Vec<Dim> result = x.col(one.node) - met.col(one.node);
    for (const auto& held : one.patch) result -= held.weight * (x.col(held.node) - met.col(held.node));
    return one.normal.dot(result);
  };
  const auto pair_of = [&](const Touch& one) { return std::pair(one.node, body_of_node[one.patch.front().node]); };
  taken.clear();
  for (const Touch& one : touches)
    taken.emplace_back(pair_of(one), one.energy - 0.5 * one.stiffness * one.depth * way(one));
  std::ranges::sort(taken);
  for (Touch& one : touching) {
    const auto last =
        std::ranges::lower_bound(taken, pair_of(one), {}, &std::pair<std::pair<Index, Index>, double>::first);
    if (last != taken.end() && last->first == pair_of(one)) one.energy = std::exchange(last->second, 0.0);
    // What is stored afterwards, k depth^2 / 2, is at most that and the second half of the work, -k depth out / 2.
    const double out = way(one), square = out * out + 8.0 * one.energy / one.stiffness;
    one.depth = std::min(-one.gap, square > 0.0 ? std::max(0.0, 0.5 * (std::sqrt(square) - out)) : 0.0);
    one.energy -= 0.5 * one.stiffness * one.depth * out;
    const Vec<Dim> push = one.stiffness * one.depth * one.normal;
    force.col(one.node) += push;
    for (const auto& [b, weight, lever] : one.patch) force.col(b) -= weight * push;
  }
  for (const auto& [pair, energy] : taken) contact_loss += energy;
  std::swap(touches, touching);
  contact_stored = 0.0;
  for (const Touch& one : touches) contact_stored += one.energy;
  met = x;
  times.contact += lap(start);
}

/// Adds what the springs between bodies say against a motion of the nodes.
template <int Dim> void Motion<Dim>::resist(const Points<Dim>& moved, Points<Dim>& forces) const {
  for (const Touch& one : touches) {
    Vec<Dim> apart = moved.col(one.node);
    for (const auto& [b, weight, lever] : one.patch) apart -= weight * moved.col(b);
    const Vec<Dim> push = one.stiffness * one.normal.dot(apart) * one.normal;
    forces.col(one.node) += push;
    for (const auto& [b, weight, lever] : one.patch) forces.col(b) -= weight * push;
  }
}

/// Area or volume in closed facets, and its derivative by where each of their nodes is.
template <int Dim> double Motion<Dim>::enclosed(const Facets<Dim>& facets,
                                                const std::function<void(Index, const Vec<Dim>&)>& slope) const {
  const Vec<Dim> origin = x.col(facets(0, 0));
  double volume = 0.0;
  for (Eigen::Index f = 0; f < facets.cols(); ++f) {
    Mat<Dim> corners;
    for (int i = 0; i < Dim; ++i) corners.col(i) = x.col(facets(i, f)) - origin;
    const double share = Dim == 2 ? 0.5 : 1.0 / 6.0;
    volume += share * corners.determinant();
    if (!slope) continue;
    // Columns of the cofactors.
    for (int i = 0; i < Dim; ++i) {
      Vec<Dim> by;
      if constexpr (Dim == 2)
        by = i == 0 ? Vec<2>(corners(1, 1), -corners(0, 1)) : Vec<2>(-corners(1, 0), corners(0, 0));
      else
        by = corners.col((i + 1) % 3).cross(corners.col((i + 2) % 3));
      slope(facets(i, f), share * by);
    }
  }
  return volume;
}

/// Forces of the gas in cavities.
template <int Dim> void Motion<Dim>::inflate() {
  for (Cavity& cavity : cavities) {
    const double ratio = enclosed(cavity.of.facets, {}) / cavity.volume, exponent = cavity.of.exponent;
    if (!(ratio > 0.0))
      throw NumericalError(fmt::format("at time {:.6g} a cavity has collapsed: its walls cross each other", time));
    const double sign = cavity.volume > 0.0 ? 1.0 : -1.0, p = cavity.of.pressure * std::pow(ratio, -exponent);
    cavity.stored = std::abs(cavity.volume) * cavity.of.pressure *
                    (exponent == 1.0 ? -std::log(ratio) : (std::pow(ratio, 1.0 - exponent) - 1.0) / (exponent - 1.0));
    enclosed(cavity.of.facets, [&](Index a, const Vec<Dim>& by) { force.col(a) += sign * p * by; });
  }
}

/// Friction of bodies, of the pressures at the beginning of the step; `kick`: how long these act. Its impulses are
/// `rubbed`.
template <int Dim> void Motion<Dim>::rub(double kick) {
  rubbed.setZero(Dim, x.cols());
  for (const Touch& one : touches) {
    Vec<Dim> slide = v.col(one.node);
    double mobility = 1.0 / mass[one.node];
    for (const auto& [b, weight, lever] : one.patch) {
      slide -= weight * v.col(b);
      mobility += weight * weight / mass[b];
    }
    slide -= one.normal.dot(slide) * one.normal;
    const double speed = slide.norm();
    if (!(speed > 0.0) || !std::isfinite(mobility)) continue;
    const double impulse = std::min(options.contact.friction * one.stiffness * one.depth * kick, speed / mobility);
    const Vec<Dim> stop = impulse / speed * slide;
    const auto give = [&](Index a, const Vec<Dim>& what) {
      v.col(a) += what / mass[a];
      rubbed.col(a) += what;
    };
    give(one.node, -stop);
    // Across the gap the two have a moment, which forces along the normal take up.
    for (const auto& [b, weight, lever] : one.patch) give(b, weight * stop - one.gap * lever.dot(stop) * one.normal);
  }
}

/// The step in which nodes go half their spacing at the most where there is something they may meet: what is stopped
/// there while others fly on is turned inside out.
template <int Dim> double Motion<Dim>::longest_way() const {
  double longest = std::numeric_limits<double>::infinity(), nearest = longest;
  if (tools.empty() && bodies.size() <= 2) return longest;
  for (Index a = 0; a < x.cols(); ++a) {
    if (merged[a] >= 0 || !(mass[a] > 0.0)) continue;
    nearest = std::min(nearest, spacing[a]);
    if (const double speed = v.col(a).norm(); speed > 0.0) longest = std::min(longest, 0.5 * spacing[a] / speed);
  }
  for (const Tool& tool : tools)
    if (const double speed = tool.now.velocity.norm(); speed > 0.0) longest = std::min(longest, 0.5 * nearest / speed);
  return longest;
}

/// Nodes get their impulses, and move.
template <int Dim> void Motion<Dim>::move(double kick, double dt) {
  auto start = Clock::now();
  was = v;
  nodal_impulses = kick * force;
  find_velocities(nodal_impulses, nodal_changes);
  v += nodal_changes;
  if (fixed) nodal_momentum += nodal_impulses;
  const bool rubs = options.contact.friction > 0.0 && !touches.empty();
  if (rubs) rub(kick);
  // What a force that changes v at the end does is its impulse times the mean of the velocities around it.
  for (const auto& [node, axis, velocity] : prescribed) {
    prescribed_work += 0.5 * mass[node] * (velocity - v(axis, node)) * (velocity + was(axis, node));
    v(axis, node) = velocity;
    if (fixed) nodal_momentum(axis, node) = mass[node] * velocity;
  }
  hold_back(kick, dt);
  if (rubs) contact_loss -= 0.5 * rubbed.cwiseProduct(v + was).sum();
  move_tools(kick, dt);
  if (!acceleration.isZero(0.0)) {
    weight_work += dt * acceleration.dot(v * mass);
    for (const Tool& tool : tools) weight_work += dt * tool.of.mass * acceleration.dot(tool.now.velocity);
  }
  nodal_changes = dt * v;
  add<Dim>(nodal_changes, x, x_rest);
  for (Index a = 0; a < x.cols(); ++a)
    if (merged[a] >= 0) {
      x.col(a) = x.col(merged[a]);
      x_rest.col(a) = x_rest.col(merged[a]);
      v.col(a) = v.col(merged[a]);
    }
  if (axisymmetric())
    for (Index a = 0; a < x.cols(); ++a)
      if (x(0, a) < 0.0) x(0, a) = x_rest(0, a) = 0.0;
  times.nodes += lap(start);
}

template struct Motion<2>;
template struct Motion<3>;

}  // namespace efree::internal
