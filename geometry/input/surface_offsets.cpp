// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/surface_offsets.hpp"

#include "efree/core/internal/spectrum.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/input/internal/triangle_tree.hpp"
#include "efree/geometry/mesh/internal/smooth_normals.hpp"

#include <algorithm>
#include <array>
#include <map>
#include <optional>

namespace efree {
namespace {

using internal::Triangle, internal::TriangleTree;

/// A plane that the true surface touches beside a point: normal . offset = height.
struct Tangent {
  Vec<3> normal;
  double height;
};

/// Triangles and the quadratic patches over them.
class SmoothSurface {
 public:
  SmoothSurface(std::vector<Triangle> triangles, double largest_angle) : triangles_(triangles), tree_(triangles) {
    std::map<std::array<double, 3>, Index> number;
    Facets<3> corners(3, std::ssize(triangles_));
    for (Index t = 0; t < corners.cols(); ++t)
      for (int k = 0; k < 3; ++k) {
        const Vec<3>& x = triangles_[t][k];
        corners(k, t) = number.try_emplace({x[0], x[1], x[2]}, static_cast<Index>(number.size())).first->second;
      }
    Points<3> points(3, std::ssize(number));
    for (const auto& [x, v] : number) points.col(v) << x[0], x[1], x[2];
    normals_ = internal::smooth_normals<3>(points, corners, largest_angle);
  }

  /// At the point of the surface nearest to x whose triangle faces as a facet at x does; none within reach.
  std::optional<Tangent> tangent(const Vec<3>& x, const Vec<3>& facing, double reach) const {
    const auto near = tree_.nearest(x, facing, reach);
    if (!near) return {};
    const Triangle& corner = triangles_[near->triangle];
    const auto normal = [&](int k) -> Vec<3> { return normals_.col(near->triangle).segment<3>(3 * k); };
    const Vec<3>& at = near->weights;
    Vec<3> shift = at[0] * corner[0] + at[1] * corner[1] + at[2] * corner[2] - x, mean = Vec<3>::Zero();
    for (int i = 0; i < 3; ++i) {
      mean += at[i] * normal(i);
      for (int j = i + 1; j < 3; ++j)
        shift += 4.0 * at[i] * at[j] * internal::edge_offset<3>(corner[i], corner[j], normal(i), normal(j));
    }
    mean.normalize();
    return Tangent{mean, shift.dot(mean)};
  }

 private:
  std::vector<Triangle> triangles_;
  TriangleTree tree_;
  Matrix normals_;  ///< by triangle, at its corners
};

/// The shortest vector to where planes that touch the surface beside a point meet; planes that are nearly parallel
/// count as one.
Vec<3> to_all(const std::vector<Tangent>& tangents) {
  Mat<3> normals = Mat<3>::Zero();
  Vec<3> heights = Vec<3>::Zero();
  for (const Tangent& of : tangents) {
    normals += of.normal * of.normal.transpose();
    heights += of.height * of.normal;
  }
  const auto [values, axes] = internal::spectrum<3>(normals);
  Vec<3> offset = Vec<3>::Zero();
  constexpr double parallel = 0.15;  // directions of facets that meet at 40 degrees are 0.13
  for (int k = 0; k < 3; ++k)
    if (values[k] > parallel * values[2]) offset += axes.col(k).dot(heights) / values[k] * axes.col(k);
  return offset;
}

}  // namespace

BoundaryOffsets<3> surface_offsets(const FineMesh<3>& mesh, const SurfaceSoup& surface, double largest_angle,
                                   double reach) {
  const SmoothSurface smooth(internal::orient_triangles(surface).triangles, largest_angle);
  // The points of facets: vertices as edges without length.
  struct Place {
    Index first, second, facet;
    auto operator<=>(const Place&) const = default;
  };
  std::vector<Place> places;
  for (Index f = 0; f < mesh.num_facets(); ++f)
    for (int i = 0; i < 3; ++i)
      for (int j = i; j < 3; ++j) {
        const auto [first, second] = std::minmax(mesh.facets()(i, f), mesh.facets()(j, f));
        places.push_back({first, second, f});
      }
  std::ranges::sort(places);
  std::vector<std::size_t> begins;
  for (std::size_t k = 0; k < places.size(); ++k)
    if (k == 0 || places[k].first != places[k - 1].first || places[k].second != places[k - 1].second)
      begins.push_back(k);
  begins.push_back(places.size());
  const auto count = static_cast<Index>(begins.size()) - 1;
  Points<3> points(3, count), offsets = Points<3>::Zero(3, count);
  parallel_for(count, [&](Index p) {
    const Place& place = places[begins[p]];
    points.col(p) = place.first == place.second ? mesh.vertex(place.first)
                                                : edge_midpoint<3>(mesh.vertex(place.first), mesh.vertex(place.second));
    std::vector<Tangent> tangents;
    for (std::size_t k = begins[p]; k < begins[p + 1]; ++k)
      if (const auto tangent = smooth.tangent(points.col(p), mesh.facet_normal(places[k].facet), reach))
        tangents.push_back(*tangent);
    if (!tangents.empty()) offsets.col(p) = to_all(tangents);
  });
  std::vector<Index> off;
  const double rounding = 1e-9 * mesh.size();
  for (Index p = 0; p < count; ++p)
    if (offsets.col(p).norm() > rounding && offsets.col(p).norm() <= reach) off.push_back(p);
  return {points(Eigen::all, off), offsets(Eigen::all, off)};
}

}  // namespace efree
