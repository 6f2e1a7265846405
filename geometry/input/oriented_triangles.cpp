// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/internal/oriented_triangles.hpp"

#include "efree/geometry/input/internal/winding.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <numeric>
#include <span>
#include <tuple>
#include <unordered_set>

namespace efree::internal {
namespace {

/// Share of the area that must face alike, by more than the rest, for the file to be believed.
constexpr double agreed = 0.5;

/// Triangles that hang together across edges of two triangles.
struct Shell {
  std::vector<Index> triangles;
  double volume = 0.0;  ///< enclosed as the triangles face now
  bool closed = true;   ///< triangles meet at every edge of it, as many one way as the other
  Eigen::AlignedBox3d box{};
};

struct Hash {
  std::size_t operator()(const std::array<Index, 3>& t) const {
    std::size_t out = 0;
    for (const Index v : t) out = out * 0x9E3779B97F4A7C15ull + static_cast<std::size_t>(v) + 1;
    return out ^ out >> 29;
  }
};

/// A side of a triangle, from the point `low` to `high` if it ascends.
struct Side {
  Index low, high, triangle;
  bool ascending;
};

class Orientation {
 public:
  explicit Orientation(const SurfaceSoup& soup) : soup_(soup) {
    join_points();
    find_shells();
  }

  OrientedTriangles result() {
    OrientedTriangles out;
    double volume = 0.0;
    for (const Shell& shell : shells_) volume += shell.volume;
    const signed char as_given = volume < 0.0 ? -1 : 1;
    turn_by_nesting(as_given, out.shells_turned);
    for (Index t = 0; t < std::ssize(triangles_); ++t) {
      Triangle one = corners(t);
      if (side_[t] < 0) std::swap(one[1], one[2]);
      if (side_[t] != as_given) ++out.turned;
      out.triangles.push_back(one);
    }
    return out;
  }

 private:
  Triangle corners(Index t) const {
    const auto& [a, b, c] = triangles_[t];
    return {soup_.points.col(a), soup_.points.col(b), soup_.points.col(c)};
  }
  /// Six times the volume between a triangle, as it is given, and the mean of all points.
  double volume_below(Index t) const {
    const Triangle one = corners(t);
    return (one[0] - from_).dot((one[1] - from_).cross(one[2] - from_));
  }

  /// Points in the same place are one; triangles without area and copies go.
  void join_points() {
    std::vector<Index> order(soup_.points.cols()), joined(soup_.points.cols());
    std::iota(order.begin(), order.end(), Index(0));
    const auto place = [&](Index v) { return std::array{soup_.points(0, v), soup_.points(1, v), soup_.points(2, v)}; };
    std::ranges::stable_sort(order, {}, place);
    for (std::size_t k = 0; k < order.size(); ++k)
      joined[order[k]] = k > 0 && place(order[k]) == place(order[k - 1]) ? joined[order[k - 1]] : order[k];
    std::unordered_set<std::array<Index, 3>, Hash> known;
    known.reserve(soup_.triangles.size());
    for (const auto& given : soup_.triangles) {
      const std::array<Index, 3> t{joined[given[0]], joined[given[1]], joined[given[2]]};
      auto sorted = t;
      std::ranges::sort(sorted);
      const Vec<3> a = soup_.points.col(t[0]), b = soup_.points.col(t[1]), c = soup_.points.col(t[2]);
      const double area = 0.5 * (b - a).cross(c - a).norm();
      if (!(area > 0.0) || !known.insert(sorted).second) continue;
      triangles_.push_back(t);
      areas_.push_back(area);
    }
    from_ = soup_.points.rowwise().mean();
  }

  void find_shells() {
    std::vector<Side> sides;
    sides.reserve(3 * triangles_.size());
    for (Index t = 0; t < std::ssize(triangles_); ++t)
      for (int k = 0; k < 3; ++k) {
        const Index a = triangles_[t][k], b = triangles_[t][(k + 1) % 3];
        sides.push_back({std::min(a, b), std::max(a, b), t, a < b});
      }
    std::ranges::sort(sides, {}, [](const Side& side) { return std::tuple(side.low, side.high, side.triangle); });
    const auto for_edges = [&](const auto& visit) {  // visit(the sides of triangles at an edge)
      for (std::size_t begin = 0, end = 0; begin < sides.size(); begin = end) {
        while (end < sides.size() && sides[end].low == sides[begin].low && sides[end].high == sides[begin].high) ++end;
        visit(std::span(sides).subspan(begin, end - begin));
      }
    };
    constexpr std::pair<Index, bool> none{-1, false};
    std::vector<std::array<std::pair<Index, bool>, 3>> next(triangles_.size(), {none, none, none});
    const auto add_next = [&](Index t, Index other, bool alike) { *std::ranges::find(next[t], none) = {other, alike}; };
    for_edges([&](std::span<const Side> around) {
      if (around.size() != 2) return;
      const bool alike = around[0].ascending != around[1].ascending;
      add_next(around[0].triangle, around[1].triangle, alike);
      add_next(around[1].triangle, around[0].triangle, alike);
    });
    side_.assign(triangles_.size(), 0);
    std::vector<Index> shell_of(triangles_.size());
    for (Index first = 0; first < std::ssize(triangles_); ++first) {
      if (side_[first] != 0) continue;
      Shell shell{.triangles = {first}};
      side_[first] = 1;
      double balance = 0.0, total = 0.0;
      for (std::size_t k = 0; k < shell.triangles.size(); ++k) {
        const Index t = shell.triangles[k];
        shell_of[t] = static_cast<Index>(shells_.size());
        balance += side_[t] * areas_[t];
        total += areas_[t];
        shell.volume += side_[t] * volume_below(t);
        for (const Index v : triangles_[t]) shell.box.extend(soup_.points.col(v));
        for (const auto& [other, alike] : next[t])
          if (other >= 0 && side_[other] == 0) {
            side_[other] = static_cast<signed char>(alike ? side_[t] : -side_[t]);
            shell.triangles.push_back(other);
          }
      }
      const double turn = std::abs(balance) > agreed * total ? balance : shell.volume;
      if (turn < 0.0) turn_shell(shell);
      shells_.push_back(std::move(shell));
    }
    for_edges([&](std::span<const Side> around) {
      std::map<Index, int> sum;  // by shell, passes one way less those the other
      for (const Side& side : around)
        sum[shell_of[side.triangle]] += side.ascending ? side_[side.triangle] : -side_[side.triangle];
      for (const auto& [shell, passes] : sum)
        if (passes != 0) shells_[shell].closed = false;
    });
  }

  void turn_shell(Shell& shell) {
    for (const Index t : shell.triangles) side_[t] = static_cast<signed char>(-side_[t]);
    shell.volume = -shell.volume;
  }

  /// Whether all of a closed shell lies in another one, by some of its triangles.
  bool holds(Index outer, Index inner) {
    constexpr std::size_t samples = 50;
    if (outer == inner || !shells_[outer].closed ||
        std::abs(shells_[outer].volume) <= std::abs(shells_[inner].volume) ||
        !shells_[outer].box.contains(shells_[inner].box))
      return false;
    auto& winding = winding_[outer];
    if (!winding) {
      std::vector<Triangle> outward;
      for (const Index t : shells_[outer].triangles) {
        outward.push_back(corners(t));
        if (side_[t] * shells_[outer].volume < 0.0) std::swap(outward.back()[1], outward.back()[2]);
      }
      winding = std::make_unique<Winding>(std::move(outward));
    }
    const auto& triangles = shells_[inner].triangles;
    const std::size_t count = std::min(samples, triangles.size());
    for (std::size_t k = 0; k < count; ++k) {
      const Triangle one = corners(triangles[k * triangles.size() / count]);
      if ((*winding)((one[0] + one[1] + one[2]) / 3.0) < 0.5) return false;
    }
    return true;
  }

  void turn_by_nesting(signed char as_given, Index& turned) {
    const auto count = static_cast<Index>(shells_.size());
    winding_.resize(shells_.size());
    std::vector<char> turns(shells_.size(), 0);
    for (Index inner = 0; inner < count; ++inner) {
      const Shell& shell = shells_[inner];
      bool outward = true;
      if (shell.closed) {
        for (Index outer = 0; outer < count; ++outer) outward ^= holds(outer, inner);
        turns[inner] = (shell.volume > 0.0) != outward;
      } else {
        turns[inner] = as_given < 0;
      }
    }
    for (Index s = 0; s < count; ++s) {
      if (turns[s] != (as_given < 0)) ++turned;
      if (turns[s]) turn_shell(shells_[s]);
    }
  }

  const SurfaceSoup& soup_;
  Vec<3> from_ = Vec<3>::Zero();
  std::vector<std::array<Index, 3>> triangles_;
  std::vector<double> areas_;
  std::vector<signed char> side_;  ///< by triangle: 1 as given, -1 turned
  std::vector<Shell> shells_;
  std::vector<std::unique_ptr<Winding>> winding_;  ///< of shells that may hold others
};

}  // namespace

OrientedTriangles orient_triangles(const SurfaceSoup& soup) {
  return Orientation(soup).result();
}

}  // namespace efree::internal
