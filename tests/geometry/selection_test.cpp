// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/selection.hpp"

#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "meshes.hpp"

#include <numbers>

namespace efree {
namespace {

using Facets = std::vector<Index>;

template <int Dim> double measure(const FineMesh<Dim>& mesh, const Facets& facets) {
  double sum = 0.0;
  for (const Index f : facets) sum += mesh.facet_measure(f);
  return sum;
}
template <int Dim> Facets selected(const FineMesh<Dim>& mesh, const Selection<Dim>& selection) {
  return select_facets<Dim>(mesh, selection);
}

const FineMesh<2>& strip() {
  static const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.25});
  return mesh;
}
const FineMesh<2>& holed_plate() {
  static const FineMesh<2> mesh = triangulate(shapes::quarter_plate_with_hole(1, 4, 0.4), {.size = 0.4});
  return mesh;
}
const FineMesh<3>& block() {
  static const FineMesh<3> mesh(solids::box({3, 2, 1}, 0.5));
  return mesh;
}
const FineMesh<3>& cylinder() {
  static const FineMesh<3> mesh(solids::cylinder(1, 2, 0.5));
  return mesh;
}

TEST(Selection, BoxHoldsFacetsThatLieInItWithAllTheirVertices) {
  EXPECT_EQ(selected<2>(strip(), InBox<2>{{0, 0}, {0, 1}}), strip().group("left"));
  EXPECT_EQ(selected<2>(strip(), InBox<2>{{-1, -1}, {3, 3}}).size(), static_cast<std::size_t>(strip().num_facets()));
  // Of a facet that sticks out nothing belongs to it.
  const Facets part = selected<2>(strip(), InBox<2>{{-1, -1}, {1.2, 0.5}});
  Facets expected;
  for (Index f = 0; f < strip().num_facets(); ++f) {
    bool inside = true;
    for (int k = 0; k < 2; ++k) {
      const Vec<2> x = strip().vertex(strip().facets()(k, f));
      inside = inside && x[0] <= 1.2 + 1e-9 && x[1] <= 0.5 + 1e-9;
    }
    if (inside) expected.push_back(f);
  }
  EXPECT_EQ(part, expected);
  EXPECT_NEAR(measure(strip(), part), 1.5, 0.5);
  EXPECT_EQ(selected<3>(block(), InBox<3>{{3, 0, 0}, {3, 2, 1}}), block().group("right"));
  EXPECT_NEAR(measure(block(), selected<3>(block(), InBox<3>{{3, 0, 0}, {3, 2, 1}})), 2.0, 1e-12);
}

TEST(Selection, PlaneHasTheFacetsInItWhicheverWayItsNormalPoints) {
  for (const double sign : {1.0, -7.0}) {
    EXPECT_EQ(selected<2>(strip(), OnPlane<2>{{5, 1}, {0, sign}}), strip().group("top"));
    EXPECT_EQ(selected<3>(block(), OnPlane<3>{{9, 2, 9}, {0, sign, 0}}), block().group("back"));
  }
  EXPECT_NEAR(measure(block(), selected<3>(block(), OnPlane<3>{{0, 2, 0}, {0, 1, 0}})), 3.0, 1e-12);
  // A tolerance as thick as the body takes all of it.
  EXPECT_NEAR(measure(strip(), selected<2>(strip(), OnPlane<2>{{0, 0.5}, {0, 1}, 0.51})), 6.0, 1e-12);
  EXPECT_TRUE(selected<2>(strip(), OnPlane<2>{{0, 0.5}, {0, 1}}).empty());
}

TEST(Selection, FacingHasTheFacetsThatLookThatWay) {
  EXPECT_EQ(selected<2>(holed_plate(), Facing<2>{{-1, 0}, 1.0}), holed_plate().group("left"));
  EXPECT_EQ(selected<3>(cylinder(), Facing<3>{{0, 0, 3}, 30.0}), cylinder().group("top"));
  // Half of the shell of the cylinder looks to the right; facets exactly at the angle belong to it.
  const double half = measure(cylinder(), selected<3>(cylinder(), Facing<3>{{1, 0, 0}, 89.0}));
  EXPECT_NEAR(half, 0.5 * measure(cylinder(), cylinder().group("side")), 0.1 * half);
  EXPECT_NEAR(measure(block(), selected<3>(block(), Facing<3>{{1, 0, 0}, 90.0})), 20.0, 1e-12);
  EXPECT_NEAR(measure(block(), selected<3>(block(), Facing<3>{{1, 0, 0}, 180.0})), 22.0, 1e-12);
}

TEST(Selection, NearestStopsAtEdges) {
  EXPECT_EQ(selected<2>(holed_plate(), NearestPatch<2>{{0, 0}}), holed_plate().group("hole"));
  EXPECT_EQ(selected<2>(holed_plate(), NearestPatch<2>{{9, 3}}), holed_plate().group("right"));
  EXPECT_EQ(selected<3>(cylinder(), NearestPatch<3>{{0.1, 0.1, 2.5}}), cylinder().group("top"));
  EXPECT_EQ(selected<3>(cylinder(), NearestPatch<3>{{2, 0, 1}}), cylinder().group("side"));
  EXPECT_EQ(selected<3>(block(), NearestPatch<3>{{1, 1, -9}}), block().group("bottom"));
  // Chords of the shell turn by no more than 22.5 degrees, by no less than 1; what turns less is one facet's plane.
  const Facets strip_of_shell = selected<3>(cylinder(), NearestPatch<3>{{2, 0.01, 1}, 1.0});
  EXPECT_LT(measure(cylinder(), strip_of_shell), 2.0 * 2.0 * std::sin(std::numbers::pi / 16) + 1e-9);
  EXPECT_GT(strip_of_shell.size(), 0u);
}

TEST(Selection, InterfacesBetweenRegionsAreNoBoundaryUnlessTheyAreOpen) {
  MeshData<2> data = triangulate_data(
      {.boundary = shapes::rectangle(0, 0, 2, 1).boundary, .embedded = {{"middle", {{1, 0}, {1, 1}}}}}, {.size = 0.25});
  for (Index c = 0; c < data.cells.cols(); ++c) {
    double x = 0.0;
    for (int i = 0; i < 3; ++i) x += data.vertices(0, data.cells(i, c)) / 3;
    data.regions.push_back(x > 1.0);
  }
  data.region_names = {"soft", "stiff"};
  const FineMesh<2> mesh(cut_regions(data));
  const OnPlane<2> middle{{1, 0}, {1, 0}};
  EXPECT_TRUE(selected<2>(mesh, middle).empty());
  EXPECT_NEAR(measure(mesh, selected<2>(mesh, InBox<2>{{-1, -1}, {3, 3}})), 6.0, 1e-12);
  EXPECT_NEAR(measure(mesh, select_facets<2>(mesh, middle, "middle")), 2.0, 1e-12);
  // A side goes on where the material changes.
  EXPECT_NEAR(measure(mesh, selected<2>(mesh, NearestPatch<2>{{0.5, 2}})), 2.0, 1e-12);
}

TEST(Selection, NormalsHaveAnyLength) {
  for (const double length : {3.0, 3e300, 1e-310}) {
    EXPECT_EQ(selected<2>(strip(), OnPlane<2>{{0, 0}, {length, 0}}), strip().group("left")) << length;
    EXPECT_EQ(selected<3>(block(), Facing<3>{{length, 0, 0}}), block().group("right")) << length;
  }
}

TEST(Selection, RefusesWhatSelectsNothingByItself) {
  EXPECT_INPUT_ERROR(selected<2>(strip(), InBox<2>{{1, 0}, {0, 1}}), "expected its lowest corner first");
  EXPECT_INPUT_ERROR(selected<2>(strip(), OnPlane<2>{{0, 0}, {0, 0}}), "normal = (0, 0), expected a direction");
  EXPECT_INPUT_ERROR(selected<2>(strip(), OnPlane<2>{{0, 0}, {0, 1}, -1.0}), "tolerance = -1");
  EXPECT_INPUT_ERROR(selected<3>(block(), Facing<3>{{0, 0, 0}}), "normal = (0, 0, 0), expected a direction");
  EXPECT_INPUT_ERROR(selected<3>(block(), Facing<3>{{0, 0, 1}, 0.0}), "angle = 0, expected");
  EXPECT_INPUT_ERROR(selected<2>(strip(), NearestPatch<2>{{0, 0}, 181.0}), "angle = 181, expected");
}

}  // namespace
}  // namespace efree
