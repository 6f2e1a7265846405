// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/pictures/internal/scene.hpp"

#include "efree/core/internal/disjoint_sets.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

namespace efree::internal::drawing {
namespace {

const double crease = std::cos(std::numbers::pi / 6.0);  ///< edges with a larger angle are drawn and not shaded over
constexpr double lift = 4.0;                             ///< of lines on faces towards the viewer [pixels]

/// Whether no triangle is between a point and a viewer far away in that direction, but for what is as near to the point
/// as `slack`.
bool is_seen(const Surface& surface, const Vec3& point, const Vec3& towards, double slack) {
  const Vec3 right = towards.unitOrthogonal(), up = towards.cross(right);
  const auto seen_from_there = [&](Index p) {
    const Vec3 x = surface.points.col(p) - point;
    return Vec3(right.dot(x), up.dot(x), towards.dot(x));
  };
  return std::ranges::none_of(surface.triangles, [&](const Triangle& t) {
    const Vec3 a = seen_from_there(t[0]), b = seen_from_there(t[1]), c = seen_from_there(t[2]);
    if (std::max({a.z(), b.z(), c.z()}) < slack) return false;
    const auto twice_area = [](const Vec3& p, const Vec3& q) { return p.x() * q.y() - p.y() * q.x(); };
    const Vec3 weights(twice_area(b, c), twice_area(c, a), twice_area(a, b));
    const double sum = weights.sum();
    if (sum == 0.0 || (weights / sum).minCoeff() < 0.0) return false;
    return weights.dot(Vec3(a.z(), b.z(), c.z())) / sum > slack;
  });
}

}  // namespace

std::string text_of(const Box& box) {
  const Vec3 s = box.sizes();
  return is_flat(box) ? fmt::format("{:.4g} x {:.4g}", s[0], s[1])
                      : fmt::format("{:.4g} x {:.4g} x {:.4g}", s[0], s[1], s[2]);
}

View view_from(const std::array<double, 2>& angles) {
  const double turn = angles[0] * std::numbers::pi / 180.0, rise = angles[1] * std::numbers::pi / 180.0;
  return {{std::cos(rise) * std::cos(turn), std::cos(rise) * std::sin(turn), std::sin(rise)},
          {-std::sin(rise) * std::cos(turn), -std::sin(rise) * std::sin(turn), std::cos(rise)}};
}

View best_view(const Surface& surface, const std::vector<Triangle>& marked, const std::optional<Vec3>& shown) {
  const Box box = box_of(surface.points);
  const Vec3 size = box.sizes();
  const Vec3 area{size[1] * size[2], size[0] * size[2], size[0] * size[1]};
  const Vec3 share = 0.35 + 0.65 * area.array() / area.maxCoeff();
  std::vector<Vec3> directions;
  for (const double upwards : {1.0, -1.0})
    for (std::size_t side = 0; side < 4; ++side)
      directions.push_back(
          Vec3((side % 2 ? -0.6 : 0.6) * share[0], (side < 2 ? -1.0 : 1.0) * share[1], 0.75 * upwards * share[2])
              .normalized());
  // From above, else from below, else from above without seeing the place.
  constexpr std::size_t above = 4;
  std::vector<std::size_t> choice;
  for (std::size_t k = 0; shown && k < directions.size(); ++k) {
    if (k == above && !choice.empty()) break;
    if (is_seen(surface, *shown, directions[k], 1e-3 * size.norm())) choice.push_back(k);
  }
  if (choice.empty()) choice = {0, 1, 2, 3};
  // Only a clear gain is worth leaving the usual side for.
  std::size_t best = choice.front();
  double most = -1.0;
  for (const std::size_t k : choice) {
    double seen = 0.0;
    for (const Triangle& t : marked) seen += std::max(0.0, surface.normal(t).dot(directions[k]));
    if (most < 0.0 || seen > 1.1 * most) best = k, most = seen;
  }
  View view{directions[best], {}};
  view.up = view.towards.cross(Vec3::UnitZ().cross(view.towards).normalized());
  return view;
}

Projection::Projection(const View& view, const std::vector<const Points<3>*>& points, const Eigen::Array4d& viewport)
    : axes_(view.axes()) {
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (const Points<3>* some : points)
    for (Index p = 0; p < some->cols(); ++p) {
      const Vec3 x = axes_ * some->col(p);
      low = low.cwiseMin(x);
      high = high.cwiseMax(x);
    }
  const Eigen::Array2d room = viewport.tail<2>() - viewport.head<2>();
  const double widest = ((high - low).head<2>().array() / room).maxCoeff();
  scale_ = widest > 0.0 ? 1.0 / (1.08 * widest) : 1.0;
  offset_ << 0.5 * (viewport.head<2>() + viewport.tail<2>()), 0.0;
  offset_ -= 0.5 * scale_ * (low + high);
}

Colour brightness(Vec3 normal) {
  struct Light {
    double elevation, azimuth;
    float strength;
    Colour colour;
  };
  constexpr float key = 0.85F;
  static const std::array<Light, 5> lights{{{50.0, 10.0, key, {1.0F, 0.972F, 0.902F}},
                                            {-75.0, -10.0, key / 2.2F, {0.908F, 0.933F, 1.0F}},
                                            {0.0, 110.0, key / 3.5F, {1.0F, 1.0F, 1.0F}},
                                            {0.0, -110.0, key / 3.5F, {1.0F, 1.0F, 1.0F}},
                                            {0.0, 0.0, key / 3.0F, {1.0F, 1.0F, 1.0F}}}};
  static const auto directions = [] {
    std::array<Vec3, 5> out;
    constexpr double degree = std::numbers::pi / 180.0;
    for (std::size_t i = 0; i < out.size(); ++i) {
      const double e = lights[i].elevation * degree, a = lights[i].azimuth * degree;
      out[i] = {std::cos(e) * std::sin(a), std::sin(e), std::cos(e) * std::cos(a)};
    }
    return out;
  }();
  if (normal.z() < 0.0) normal = -normal;
  constexpr float ambient = 0.35F, diffuse = 0.75F;
  Colour sum = Colour::Constant(ambient);
  for (std::size_t i = 0; i < lights.size(); ++i)
    sum +=
        diffuse * lights[i].strength * static_cast<float>(std::max(0.0, normal.dot(directions[i]))) * lights[i].colour;
  return sum;
}

std::vector<std::array<Vec3, 3>> corner_normals(const Surface& surface) {
  std::vector<Vec3> normals;
  for (const Triangle& t : surface.triangles) normals.push_back(surface.normal(t).stableNormalized());
  std::vector<Index> begin(surface.points.cols() + 1, 0);
  for (const Triangle& t : surface.triangles)
    for (const Index p : t) ++begin[p + 1];
  std::partial_sum(begin.begin(), begin.end(), begin.begin());
  std::vector<Index> around(begin.back()), next(begin.begin(), begin.end() - 1);
  for (std::size_t i = 0; i < surface.triangles.size(); ++i)
    for (const Index p : surface.triangles[i]) around[next[p]++] = static_cast<Index>(i);
  std::vector<std::array<Vec3, 3>> out(surface.triangles.size());
  for (std::size_t i = 0; i < out.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k) {
      const Index p = surface.triangles[i][k];
      Vec3 sum = Vec3::Zero();
      for (Index j = begin[p]; j < begin[p + 1]; ++j) {
        const double turn = normals[around[j]].dot(normals[i]);
        // Triangles of a surface from a file may face either way.
        if (std::abs(turn) >= crease) sum += std::copysign(1.0, turn) * normals[around[j]];
      }
      out[i][k] = sum.stableNormalized();
    }
  return out;
}

std::vector<Segment> edges_of(const Surface& surface, const std::vector<Triangle>& triangles, bool creases) {
  struct Side {
    Segment ends;
    Index triangle;
    bool operator<(const Side& other) const { return ends < other.ends; }
  };
  std::vector<Side> sides;
  for (std::size_t i = 0; i < triangles.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k) {
      const Index a = triangles[i][k], b = triangles[i][(k + 1) % 3];
      sides.push_back({{std::min(a, b), std::max(a, b)}, static_cast<Index>(i)});
    }
  std::sort(sides.begin(), sides.end());
  std::vector<Segment> out;
  for (std::size_t i = 0, end = 0; i < sides.size(); i = end) {
    while (end < sides.size() && sides[end].ends == sides[i].ends) ++end;
    const auto bent = [&] {
      const Vec3 one = surface.normal(triangles[sides[i].triangle]).stableNormalized();
      return std::abs(one.dot(surface.normal(triangles[sides[i + 1].triangle]).stableNormalized())) < crease;
    };
    if (end - i == 1 || (creases && end - i == 2 && bent())) out.push_back(sides[i].ends);
  }
  return out;
}

std::vector<Segment> long_chains(const Points<3>& points, std::vector<Segment> lines, double least) {
  internal::DisjointSets sets(static_cast<Index>(points.cols()));
  for (const auto& [a, b] : lines) sets.join(a, b);
  const std::vector<Index> chain = std::move(sets).firsts();
  std::vector<double> total(chain.size(), 0.0);
  for (const auto& [a, b] : lines) total[chain[a]] += (points.col(b) - points.col(a)).norm();
  std::erase_if(lines, [&](const Segment& line) { return total[chain[line[0]]] < least; });
  return lines;
}

std::vector<Segment> shape_edges(const Surface& surface) {
  const auto is_rough = [&](const std::vector<Segment>& lines) {
    return static_cast<double>(lines.size()) > 0.18 * static_cast<double>(surface.triangles.size());
  };
  const std::vector<Segment> edges = edges_of(surface, surface.triangles, true);
  if (!is_rough(edges)) return long_chains(surface.points, edges, 0.15 * box_of(surface.points).diagonal().norm());
  std::vector<Segment> ends = edges_of(surface, surface.triangles, false);
  return is_rough(ends) ? std::vector<Segment>{} : ends;
}

void draw_lines(Canvas& canvas, const Projection& at, const Points<3>& points, const std::vector<Segment>& lines,
                double line_width, const Colour& colour) {
  for (const auto& [a, b] : lines) canvas.line(at(points.col(a)), at(points.col(b)), line_width, colour, lift);
}

}  // namespace efree::internal::drawing
