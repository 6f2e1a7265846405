// SPDX-License-Identifier: GPL-3.0-or-later
/// Motion of the nodes, as far as walls, prescribed velocities and other bodies let them.
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/otm/internal/motion.hpp"

#include <fmt/format.h>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <set>

namespace efree::internal {
namespace {

/// How far nodes may go before they look for other bodies again, over the spacing.
constexpr double skin = 0.25;
/// How far nodes get into a body before they count as on its other side, over the spacing.
constexpr double deepest = 0.8;

/// Facets of a cell that is positively oriented, outwards.
constexpr int facets_of_cell[2][4][3] = {{{0, 1, -1}, {1, 2, -1}, {2, 0, -1}, {-1, -1, -1}},
                                         {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}};

/// Weights of the corners in the point of a segment or triangle that is nearest to the origin (Ericson 2005, section
/// 5.1.5).
template <int Dim> Vec<Dim> nearest_in(const Mat<Dim>& corner) {
  if constexpr (Dim == 2) {
    const Vec<2> along = corner.col(1) - corner.col(0);
    const double t = std::clamp(-corner.col(0).dot(along) / along.squaredNorm(), 0.0, 1.0);
    return {1.0 - t, t};
  } else {
    const Vec<3> a = corner.col(0), b = corner.col(1), c = corner.col(2), ab = b - a, ac = c - a;
    const double d1 = -ab.dot(a), d2 = -ac.dot(a);
    if (d1 <= 0.0 && d2 <= 0.0) return {1.0, 0.0, 0.0};
    const double d3 = -ab.dot(b), d4 = -ac.dot(b);
    if (d3 >= 0.0 && d4 <= d3) return {0.0, 1.0, 0.0};
    const double vc = d1 * d4 - d3 * d2;
    if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return {1.0 - d1 / (d1 - d3), d1 / (d1 - d3), 0.0};
    const double d5 = -ab.dot(c), d6 = -ac.dot(c);
    if (d6 >= 0.0 && d5 <= d6) return {0.0, 0.0, 1.0};
    const double vb = d5 * d2 - d1 * d6;
    if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return {1.0 - d2 / (d2 - d6), 0.0, d2 / (d2 - d6)};
    const double va = d3 * d6 - d5 * d4;
    if (va <= 0.0 && d4 >= d3 && d5 >= d6) {
      const double t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
      return {0.0, 1.0 - t, t};
    }
    const double sum = va + vb + vc;
    return {va / sum, vb / sum, vc / sum};
  }
}

/// Outwards, as long as the facet is large; per unit of depth in the plane.
template <int Dim> Vec<Dim> area_of(const Mat<Dim>& corner) {
  if constexpr (Dim == 2) {
    const Vec<2> along = corner.col(1) - corner.col(0);
    return {along[1], -along[0]};
  } else {
    return 0.5 * Vec<3>(corner.col(1) - corner.col(0)).cross(Vec<3>(corner.col(2) - corner.col(0)));
  }
}

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
      const double around = axisymmetric() ? 2.0 * std::numbers::pi * corner.row(0).mean() : 1.0;
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

/// Which facets of other bodies are near which nodes.
template <int Dim> void Motion<Dim>::find_near() {
  seen = x;
  near.clear();
  for (std::size_t b = 0; b < surfaces.size(); ++b) {
    const Facets<Dim>& facets = surfaces[b].facets;
    Points<Dim> centre(Dim, facets.cols());
    double widest = 0.0, reach = 0.0;
    for (Eigen::Index f = 0; f < facets.cols(); ++f) {
      const Mat<Dim> corner = corners(facets, f);
      centre.col(f) = corner.rowwise().mean();
      reach = std::max(reach, std::sqrt((corner.colwise() - centre.col(f)).colwise().squaredNorm().maxCoeff()));
      for (int i = 0; i < Dim; ++i) widest = std::max(widest, spacing[facets(i, f)]);
    }
    if (facets.cols() == 0) continue;
    Neighbours<Dim> tree;
    tree.build(centre);
    std::vector<Index> found;
    for (std::size_t other = 0; other < surfaces.size(); ++other) {
      if (other == b) continue;
      for (const Index a : surfaces[other].nodes) {
        tree.within(x.col(a), reach + skin * (widest + spacing[a]) + deepest * widest, found);
        if (!found.empty()) near.push_back({a, static_cast<Index>(b), found});
      }
    }
  }
}

/// Where a node is inside another body: the nearest point of its surface. False if it is not.
template <int Dim> bool Motion<Dim>::find_touch(const Near& of, Touch& touch) const {
  const Facets<Dim>& facets = surfaces[of.body].facets;
  const Vec<Dim> at = x.col(of.node);
  double nearest = std::numeric_limits<double>::infinity(), facing = 0.0;
  Index best = -1;
  Vec<Dim> best_weights, to;
  for (const Index f : of.facets) {
    const Mat<Dim> corner = corners(facets, f).colwise() - at;
    const Vec<Dim> weights = nearest_in<Dim>(corner), point = corner * weights;
    const double distance = point.norm();
    // Of facets that share the nearest point the one that faces the node most says on which side it is.
    const Vec<Dim> area = area_of<Dim>(corner);
    const double faces = distance > 0.0 ? point.dot(area) / (area.norm() * distance) : 0.0;
    const double slack = 1e-9 * spacing[of.node];
    if (distance > nearest + slack || (distance > nearest - slack && std::abs(faces) <= std::abs(facing))) continue;
    nearest = std::min(nearest, distance);
    facing = faces;
    best = f;
    best_weights = weights;
    to = point;
  }
  if (best < 0 || !(facing > 0.0) || nearest > deepest * spacing[facets(0, best)]) return false;
  touch.node = of.node;
  touch.normal = to / nearest;
  touch.gap = -nearest;
  const Mat<Dim> corner = corners(facets, best).colwise() - at;
  const Vec<Dim> middle = corner.rowwise().mean();
  const Mat<Dim> along = Mat<Dim>::Identity() - touch.normal * touch.normal.transpose();
  const Mat<Dim> arms = along * (corner.colwise() - middle);
  const Mat<Dim> about =
      (arms * arms.transpose() + arms.squaredNorm() * touch.normal * touch.normal.transpose()).inverse();
  touch.patch.clear();
  for (int i = 0; i < Dim; ++i) touch.patch.push_back({facets(i, best), best_weights[i], about * arms.col(i)});
  const double modulus = std::min(bodies[body_of_node[of.node]].modulus, bodies[of.body].modulus);
  // Half of it, as the other body's nodes push as well.
  touch.stiffness = 0.5 * options.contact.stiffness * modulus * surface_area[of.node] / spacing[of.node];
  return true;
}

/// Forces between bodies that are in each other's way.
template <int Dim> void Motion<Dim>::touch() {
  if (!has_contact()) return;
  auto start = Clock::now();
  if (surfaces.empty()) find_surface();
  bool look = seen.size() == 0;
  for (Index a = 0; a < x.cols() && !look; ++a)
    look = (x.col(a) - seen.col(a)).squaredNorm() > skin * skin * spacing[a] * spacing[a];
  if (look) find_near();
  std::vector<Touch> found(near.size());
  parallel_chunks(static_cast<Index>(near.size()), 64, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k)
      if (!find_touch(near[k], found[k])) found[k].stiffness = 0.0;
  });
  // Where points broke, nodes may be inside a surface that is new: they touch it when they have come to it.
  std::set<std::pair<Index, Index>> touched;
  for (const Touch& one : touches) touched.insert({one.node, body_of_node[one.patch.front().node]});
  const auto may_begin = [&](const Touch& one) {
    if (counts.eroded == 0 || touched.contains({one.node, body_of_node[one.patch.front().node]})) return true;
    Vec<Dim> speed = v.col(one.node);
    for (const auto& held : one.patch) speed -= held.weight * v.col(held.node);
    return -one.gap <= 1.5 * last_step * speed.norm();
  };
  touches.clear();
  contact_stored = 0.0;
  for (Touch& one : found) {
    if (!(one.stiffness > 0.0) || !may_begin(one)) continue;
    const Vec<Dim> push = -one.stiffness * one.gap * one.normal;
    force.col(one.node) += push;
    for (const auto& [b, weight, lever] : one.patch) force.col(b) -= weight * push;
    contact_stored += 0.5 * one.stiffness * one.gap * one.gap;
    touches.push_back(std::move(one));
  }
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

/// Friction of bodies, of the pressures at the beginning of the step; `kick`: how long these act. Returns the impulses.
template <int Dim> Points<Dim> Motion<Dim>::rub(double kick) {
  Points<Dim> impulses = Points<Dim>::Zero(Dim, x.cols());
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
    const double impulse = std::min(-options.contact.friction * one.stiffness * one.gap * kick, speed / mobility);
    const Vec<Dim> stop = impulse / speed * slide;
    const auto give = [&](Index a, const Vec<Dim>& what) {
      v.col(a) += what / mass[a];
      impulses.col(a) += what;
    };
    give(one.node, -stop);
    // Across the gap the two have a moment, which forces along the normal take up.
    for (const auto& [b, weight, lever] : one.patch) give(b, weight * stop - one.gap * lever.dot(stop) * one.normal);
  }
  return impulses;
}

/// Nodes get their impulses, and move.
template <int Dim> void Motion<Dim>::move(double kick, double dt) {
  auto start = Clock::now();
  was = v;
  v += velocities_of(kick * force);
  if (fixed) nodal_momentum += kick * force;
  Points<Dim> rubbed(Dim, 0);
  if (options.contact.friction > 0.0 && !touches.empty()) rubbed = rub(kick);
  // What a force that changes v at the end does is its impulse times the mean of the velocities around it.
  for (const auto& [node, axis, velocity] : prescribed) {
    prescribed_work += 0.5 * mass[node] * (velocity - v(axis, node)) * (velocity + was(axis, node));
    v(axis, node) = velocity;
    if (fixed) nodal_momentum(axis, node) = mass[node] * velocity;
  }
  wall_forces.setZero(Dim, static_cast<Index>(walls.size()));
  for (std::size_t w = 0; w < walls.size(); ++w) {
    const OtmWall<Dim>& wall = walls[w];
    stop_surfaces(static_cast<Index>(w), kick, dt);
    for (Index a = 0; a < mass.size(); ++a) {
      if (bodies[body_of_node[a]].has_surface) continue;
      const double gap = x.col(a).dot(wall.normal) - wall.level;
      const double speed = v.col(a).dot(wall.normal);
      if (gap + dt * speed >= 0.0) continue;
      const Vec<Dim> before = v.col(a);
      const double stop = -gap / dt - speed;  // what brings it to the wall
      Vec<Dim> sliding = before - speed * wall.normal;
      const double slides = sliding.norm();
      const double hold = slides > 0.0 ? std::min(1.0, wall.friction * stop / slides) : 0.0;
      v.col(a) += stop * wall.normal - (std::isinf(wall.friction) ? 1.0 : hold) * sliding;
      contact_loss -= 0.5 * mass[a] * (v.col(a) - before).dot(v.col(a) + was.col(a));
      wall_forces.col(static_cast<Index>(w)) -= mass[a] / kick * (v.col(a) - before);
    }
  }
  if (rubbed.size() != 0) contact_loss -= 0.5 * rubbed.cwiseProduct(v + was).sum();
  add<Dim>(dt * v, x, x_rest);
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
