// SPDX-License-Identifier: GPL-3.0-or-later
/// What the tests of meshes of images in space share.
#pragma once

#include "efree/geometry/input/label_image.hpp"
#include "efree/geometry/mesh/fine_mesh.hpp"
#include "efree/geometry/mesh/internal/flat_cells.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace efree::test {

/// Everything that must hold on any mesh in three dimensions.
inline void expect_consistent(const FineMesh<3>& mesh, const LabelImage<3>& image) {
  EXPECT_GT(mesh.volumes().minCoeff(), 0.0);
  // Frame facets are flat and on the frame; named facets together are the whole boundary; the surface is closed.
  const char* sides[] = {"left", "right", "front", "back", "bottom", "top"};
  std::vector<int> named(mesh.num_facets(), 0);
  for (const auto& group : mesh.groups())
    for (const Index f : group.facets) ++named[f];
  EXPECT_EQ(std::count(named.begin(), named.end(), 1), mesh.num_facets());
  for (int s = 0; s < 6; ++s) {
    const auto group =
        std::find_if(mesh.groups().begin(), mesh.groups().end(), [&](const auto& g) { return g.name == sides[s]; });
    if (group == mesh.groups().end()) continue;
    const int d = s / 2;
    const double plane = image.origin[d] + (s % 2 == 1 ? image.size[d] * image.spacing[d] : 0.0);
    Index off = 0;
    for (const Index f : group->facets) {
      for (int k = 0; k < 3; ++k) off += mesh.vertex(mesh.facets()(k, f))[d] != plane;
      off += !(std::abs(std::abs(mesh.facet_normal(f)[d]) - 1.0) < 1e-12);
    }
    EXPECT_EQ(off, 0) << sides[s];
  }
  Vec<3> closed = Vec<3>::Zero();
  double volume = 0.0;
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    closed += mesh.facet_measure(f) * mesh.facet_normal(f);
    volume += mesh.facet_measure(f) * mesh.facet_normal(f).dot(mesh.vertex(mesh.facets()(0, f))) / 3.0;
  }
  EXPECT_LT(closed.norm(), 1e-9 * mesh.volumes().sum());
  EXPECT_NEAR(volume, mesh.volumes().sum(), 1e-9 * volume);  // cells do not overlap
}

/// Area of a named part of the boundary.
inline double side_area(const FineMesh<3>& mesh, const std::string& group) {
  double sum = 0.0;
  for (const Index f : mesh.group(group)) sum += mesh.facet_measure(f);
  return sum;
}

/// Of a region.
inline double volume(const FineMesh<3>& mesh, Index region) {
  double sum = 0.0;
  for (Index c = 0; c < mesh.num_cells(); ++c)
    if (mesh.region(c) == region) sum += mesh.volume(c);
  return sum;
}

/// The least flatness of all cells.
inline double flattest(const MeshData<3>& mesh) {
  double least = 1.0;
  for (Index c = 0; c < mesh.cells.cols(); ++c)
    least = std::min(least, internal::flatness<3>(mesh.vertices, mesh.cells, c));
  return least;
}

}  // namespace efree::test
