// SPDX-License-Identifier: GPL-3.0-or-later
/// What the geometry tests share.
#pragma once

#include "efree/core/error.hpp"
#include "efree/geometry/mesh/fine_mesh.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

/// Expects InputError whose message contains `text`.
#define EXPECT_INPUT_ERROR(statement, text) \
  EXPECT_THAT([&] { statement; }, ::testing::ThrowsMessage<efree::InputError>(::testing::HasSubstr(text)))

namespace efree::test {

inline double length(const FineMesh<2>& mesh, const std::string& group) {
  double sum = 0.0;
  for (const Index f : mesh.group(group)) sum += mesh.facet_measure(f);
  return sum;
}

inline double boundary_length(const FineMesh<2>& mesh) {
  double sum = 0.0;
  for (Index f = 0; f < mesh.num_facets(); ++f) sum += mesh.facet_measure(f);
  return sum;
}

/// Vertices - edges + cells: the number of bodies less the number of holes.
inline Index euler_characteristic(const FineMesh<2>& mesh) {
  return mesh.num_vertices() - (3 * mesh.num_cells() + mesh.num_facets()) / 2 + mesh.num_cells();
}

/// Everything that must hold on any mesh.
inline void expect_consistent(const FineMesh<2>& mesh) {
  double longest = 0.0;
  Index wrong = 0;
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    wrong += !(mesh.volume(c) > 0.0);
    for (int i = 0; i < 3; ++i) {
      longest = std::max(longest, (mesh.vertex(mesh.cells()(i, c)) - mesh.vertex(mesh.cells()((i + 1) % 3, c))).norm());
      const Index other = mesh.neighbour(i, c);
      if (other < 0) continue;
      int back = 0;
      for (int j = 0; j < 3; ++j) back += mesh.neighbour(j, other) == c;
      wrong += back == 0;
    }
  }
  for (Index v = 0; v < mesh.num_vertices(); ++v)
    for (const Index c : mesh.cells_of(v)) wrong += !(mesh.cells().col(c).array() == v).any();
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    const Vec<2> middle = 0.5 * (mesh.vertex(mesh.facets()(0, f)) + mesh.vertex(mesh.facets()(1, f)));
    wrong += !((middle - mesh.centroid(mesh.facet_cell(f))).dot(mesh.facet_normal(f)) > 0.0);
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_DOUBLE_EQ(mesh.size(), longest);
}

}  // namespace efree::test
