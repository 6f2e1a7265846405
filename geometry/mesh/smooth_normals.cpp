// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/internal/smooth_normals.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

namespace efree::internal {
namespace {

template <int Dim> class SmoothNormals {
 public:
  SmoothNormals(const Points<Dim>& points, const Facets<Dim>& facets, double largest_angle)
      : points_(points),
        facets_(facets),
        smooth_(std::cos(largest_angle)),
        at_(points.cols() + 1, 0),
        normals_(Dim, facets.cols()),
        measures_(facets.cols()),
        plane_(facets.cols()) {
    find_facets_of_points();
    for (Index f = 0; f < size(); ++f) {
      const Vec<Dim> area = area_of(f);
      measures_[f] = area.norm();
      normals_.col(f) = measures_[f] > 0.0 ? Vec<Dim>(area / measures_[f]) : Vec<Dim>::Zero();
    }
    measure_planes();
  }

  Matrix at_corners() const {
    Matrix normals(Dim * Dim, size());
    for (Index f = 0; f < size(); ++f)
      for (int k = 0; k < Dim; ++k) normals.col(f).template segment<Dim>(Dim * k) = at_corner(f, k);
    return normals;
  }

 private:
  Index size() const { return static_cast<Index>(facets_.cols()); }
  Vec<Dim> point(int k, Index f) const { return points_.col(facets_(k, f)); }
  bool turns_smoothly(Index f, Index g) const { return normals_.col(f).dot(normals_.col(g)) > smooth_; }

  /// Normal, as long as the facet's measure.
  Vec<Dim> area_of(Index f) const {
    if constexpr (Dim == 2) {
      const Vec<2> along = point(1, f) - point(0, f);
      return Vec<2>(along.y(), -along.x());
    } else {
      return 0.5 * (point(1, f) - point(0, f)).cross(point(2, f) - point(0, f));
    }
  }

  void find_facets_of_points() {
    for (Index f = 0; f < size(); ++f)
      for (int k = 0; k < Dim; ++k) ++at_[facets_(k, f) + 1];
    std::partial_sum(at_.begin(), at_.end(), at_.begin());
    of_.resize(at_.back());
    std::vector<Index> cursor(at_.begin(), at_.end() - 1);
    for (Index f = 0; f < size(); ++f)
      for (int k = 0; k < Dim; ++k) of_[cursor[facets_(k, f)]++] = f;
  }
  std::span<const Index> facets_of(Index v) const { return {of_.data() + at_[v], of_.data() + at_[v + 1]}; }

  Index root(Index f) {
    while (plane_[f] != f) f = plane_[f] = plane_[plane_[f]];
    return f;
  }

  /// Calls visit(f, g, length) for facets f < g that share all corners but one: the length of the edge that they share,
  /// in the plane one.
  template <class Visit> void for_neighbours(const Visit& visit) const {
    for (Index f = 0; f < size(); ++f)
      for (int k = 0; k < Dim; ++k) {
        const Index v = facets_((k + 1) % Dim, f), w = facets_((k + Dim - 1) % Dim, f);
        for (const Index g : facets_of(v))
          if (g > f && (facets_.col(g).array() == w).any())
            visit(f, g, Dim == 2 ? 1.0 : (points_.col(v) - points_.col(w)).norm());
      }
  }

  /// Parts the facets by planes, and measures how wide each part is: twice its measure over the edges at which the
  /// surface turns smoothly. Infinite where it turns nowhere.
  void measure_planes() {
    constexpr double flat = 1.0 - 4e-5;  // cosine of half a degree
    std::iota(plane_.begin(), plane_.end(), 0);
    const auto is_flat = [&](Index f, Index g) { return normals_.col(f).dot(normals_.col(g)) > flat; };
    for_neighbours([&](Index f, Index g, double) {
      if (is_flat(f, g)) plane_[std::max(root(f), root(g))] = std::min(root(f), root(g));
    });
    for (Index f = 0; f < size(); ++f) plane_[f] = root(f);
    Vector areas = Vector::Zero(size()), turns = Vector::Zero(size());
    for (Index f = 0; f < size(); ++f) areas[plane_[f]] += measures_[f];
    for_neighbours([&](Index f, Index g, double length) {
      if (is_flat(f, g) || !turns_smoothly(f, g)) return;
      turns[plane_[f]] += length;
      turns[plane_[g]] += length;
    });
    widths_.resize(size());
    for (Index f = 0; f < size(); ++f)
      widths_[f] =
          turns[plane_[f]] > 0.0 ? 2.0 * areas[plane_[f]] / turns[plane_[f]] : std::numeric_limits<double>::infinity();
  }

  /// Of a facet at a point of it: the normal of the circle or sphere through the neighbours of the point is the sum of
  /// the facets' normals with these weights.
  double weight(Index f, Index v) const {
    if constexpr (Dim == 2) return 1.0 / measures_[f];
    double squares = 1.0;
    for (int k = 0; k < Dim; ++k)
      if (facets_(k, f) != v) squares *= (point(k, f) - points_.col(v)).squaredNorm();
    return measures_[f] / squares;
  }

  Vec<Dim> at_corner(Index f, int k) const {
    constexpr double wider = 4.0;
    const Index v = facets_(k, f);
    double widest = 0.0;
    for (const Index g : facets_of(v))
      if (turns_smoothly(f, g)) widest = std::max(widest, widths_[g]);
    Vec<Dim> sum = Vec<Dim>::Zero();
    for (const Index g : facets_of(v))
      if (turns_smoothly(f, g) && (widths_[g] == widest || wider * widths_[g] > widest))
        sum += weight(g, v) * normals_.col(g);
    return sum.squaredNorm() > 0.0 ? Vec<Dim>(sum.normalized()) : Vec<Dim>(normals_.col(f));
  }

  const Points<Dim>& points_;
  const Facets<Dim>& facets_;
  double smooth_;
  std::vector<Index> at_, of_;  ///< facets of the points
  Points<Dim> normals_;
  Vector measures_;
  std::vector<Index> plane_;  ///< by facet: the first one of those that make a plane with it
  Vector widths_;             ///< by facet: of its plane
};

}  // namespace

template <int Dim> Matrix smooth_normals(const Points<Dim>& points, const Facets<Dim>& facets, double largest_angle) {
  return SmoothNormals<Dim>(points, facets, largest_angle).at_corners();
}

template <int Dim>
Vec<Dim> edge_offset(const Vec<Dim>& a, const Vec<Dim>& b, const Vec<Dim>& normal_at_a, const Vec<Dim>& normal_at_b) {
  // How far the surface falls off towards the middle of the edge, by its slopes at the ends.
  double from_a = -normal_at_a.dot(b - a), from_b = normal_at_b.dot(b - a);
  constexpr double none = 0.02;
  if (std::abs(from_a) < none * std::abs(from_b)) from_a = from_b;
  if (std::abs(from_b) < none * std::abs(from_a)) from_b = from_a;
  const double height = (from_a + from_b) / 8.0;
  if (std::abs(height) < 1e-9 * (b - a).norm()) return Vec<Dim>::Zero();
  return height * (normal_at_a + normal_at_b).normalized();
}

template Matrix smooth_normals<2>(const Points<2>&, const Facets<2>&, double);
template Matrix smooth_normals<3>(const Points<3>&, const Facets<3>&, double);
template Vec<2> edge_offset<2>(const Vec<2>&, const Vec<2>&, const Vec<2>&, const Vec<2>&);
template Vec<3> edge_offset<3>(const Vec<3>&, const Vec<3>&, const Vec<3>&, const Vec<3>&);

}  // namespace efree::internal
