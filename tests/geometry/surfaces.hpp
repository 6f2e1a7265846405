// SPDX-License-Identifier: GPL-3.0-or-later
/// Triangulated surfaces for tests.
#pragma once

#include "efree/geometry/input/surface.hpp"

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

namespace efree::test {

inline SurfaceSoup together(const SurfaceSoup& a, const SurfaceSoup& b) {
  SurfaceSoup soup = a;
  const auto shift = static_cast<Index>(a.points.cols());
  soup.points.conservativeResize(3, shift + b.points.cols());
  soup.points.rightCols(b.points.cols()) = b.points;
  for (const auto& t : b.triangles) soup.triangles.push_back({t[0] + shift, t[1] + shift, t[2] + shift});
  return soup;
}

/// Surface of the box [low, high], every triangle with three points of its own as in an STL file.
inline SurfaceSoup box_surface(const Vec<3>& low, const Vec<3>& high) {
  SurfaceSoup soup;
  std::vector<Vec<3>> points;
  const auto corner = [&](int bits) {
    return Vec<3>(bits & 1 ? high.x() : low.x(), bits & 2 ? high.y() : low.y(), bits & 4 ? high.z() : low.z());
  };
  const int quads[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
  for (const auto& q : quads)
    for (const auto& t : {std::array{q[0], q[1], q[2]}, std::array{q[0], q[2], q[3]}}) {
      const auto first = static_cast<Index>(points.size());
      for (const int k : t) points.push_back(corner(k));
      soup.triangles.push_back({first, first + 1, first + 2});
    }
  soup.points.resize(3, static_cast<Index>(points.size()));
  for (std::size_t v = 0; v < points.size(); ++v) soup.points.col(static_cast<Index>(v)) = points[v];
  return soup;
}

/// Sphere of `n` rings with 2n points each.
inline SurfaceSoup sphere_surface(const Vec<3>& centre, double radius, int n) {
  constexpr double pi = std::numbers::pi;
  SurfaceSoup soup;
  soup.points.resize(3, 2 + (n - 1) * 2 * n);
  soup.points.col(0) = centre + Vec<3>(0, 0, radius);
  soup.points.col(1) = centre - Vec<3>(0, 0, radius);
  const auto at = [&](int ring, int k) { return ring == 0 ? 0 : ring == n ? 1 : 2 + (ring - 1) * 2 * n + k % (2 * n); };
  for (int ring = 1; ring < n; ++ring)
    for (int k = 0; k < 2 * n; ++k) {
      const double theta = pi * ring / n, phi = pi * k / n;
      soup.points.col(at(ring, k)) =
          centre + radius * Vec<3>(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta));
    }
  for (int ring = 0; ring < n; ++ring)
    for (int k = 0; k < 2 * n; ++k) {
      if (ring > 0) soup.triangles.push_back({at(ring, k), at(ring + 1, k), at(ring, k + 1)});
      if (ring < n - 1) soup.triangles.push_back({at(ring, k + 1), at(ring + 1, k), at(ring + 1, k + 1)});
    }
  return soup;
}

/// Body of revolution about z with n sides; its section has the corners (radius, z), counterclockwise, off the axis or
/// with one edge on it.
inline SurfaceSoup revolved_surface(const std::vector<Vec<2>>& section, int n) {
  SurfaceSoup soup;
  const auto corners = static_cast<Index>(section.size());
  soup.points.resize(3, corners * n);
  for (Index c = 0; c < corners; ++c)
    for (Index k = 0; k < n; ++k) {
      const double phi = 2.0 * std::numbers::pi * k / n;
      soup.points.col(c * n + k) << section[c].x() * std::cos(phi), section[c].x() * std::sin(phi), section[c].y();
    }
  for (Index c = 0; c < corners; ++c)
    for (Index k = 0; k < n; ++k) {
      const Index next = (c + 1) % corners, a = c * n + k, b = c * n + (k + 1) % n, d = next * n + k,
                  e = next * n + (k + 1) % n;
      const bool on_axis = section[c].x() == 0.0, next_on_axis = section[next].x() == 0.0;
      if (!on_axis) soup.triangles.push_back({a, b, next_on_axis ? next * n : e});
      if (!next_on_axis) soup.triangles.push_back({on_axis ? c * n : a, e, d});
    }
  return soup;
}

/// Tuning fork 20 x 4 x (10 + slit), prongs 18 long along x, the slit between z = 5 and 5 + slit. All of it times
/// `scale`.
inline SurfaceSoup fork_surface(double slit, double scale = 1.0) {
  const std::vector<Vec<2>> profile{{0, 0},        {20, 0},        {20, 10 + slit}, {0, 10 + slit},
                                    {0, 5 + slit}, {18, 5 + slit}, {18, 5},         {0, 5}};
  SurfaceSoup soup;
  soup.points.resize(3, 16);
  for (Index k = 0; k < 8; ++k) {
    soup.points.col(k) = scale * Vec<3>(profile[k].x(), 0.0, profile[k].y());
    soup.points.col(k + 8) = scale * Vec<3>(profile[k].x(), 4.0, profile[k].y());
  }
  for (const std::array<Index, 3>& t :
       {std::array<Index, 3>{0, 1, 6}, {0, 6, 7}, {1, 2, 5}, {1, 5, 6}, {2, 3, 4}, {2, 4, 5}}) {
    soup.triangles.push_back(t);
    soup.triangles.push_back({t[0] + 8, t[2] + 8, t[1] + 8});
  }
  for (Index k = 0; k < 8; ++k) {
    const Index next = (k + 1) % 8;
    soup.triangles.push_back({k, next + 8, next});
    soup.triangles.push_back({k, k + 8, next + 8});
  }
  return soup;
}

/// A ring 10 high of radii 3 and 8, with a slit around the axis, open at the top and 8 deep, whose walls have radii 5
/// and 5 + slit, growing by `slope` with z.
inline SurfaceSoup ring_with_slit(double slit, double slope, int n) {
  const double top = 5.0 + 8.0 * slope;
  return revolved_surface({{3, 0}, {8, 0}, {8, 10}, {top + slit, 10}, {5 + slit, 2}, {5, 2}, {top, 10}, {3, 10}}, n);
}

/// A rod of radius 5 and 10 long in a tube up to radius 8, a gap around it; both walls grow by `slope` with z.
inline SurfaceSoup rod_in_tube(double gap, double slope, int n) {
  const double top = 5.0 + 10.0 * slope;
  return together(revolved_surface({{0, 0}, {5, 0}, {top, 10}, {0, 10}}, n),
                  revolved_surface({{5 + gap, 0}, {8, 0}, {8, 10}, {top + gap, 10}}, n));
}

}  // namespace efree::test
