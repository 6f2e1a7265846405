// SPDX-License-Identifier: GPL-3.0-or-later
/// Gaps and slits: found on surfaces whatever their width, and kept, named or refused by the meshers.
#include "efree/geometry/input/surface_gaps.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/meshing/surface_image.hpp"
#include "meshes.hpp"
#include "surfaces.hpp"

#include <cmath>
#include <optional>

namespace efree {
namespace {

using namespace efree::test;

constexpr double widths[] = {1e-1, 1e-2, 1e-3, 1e-4, 2e-5};  // of bodies 20 large

/// What a mesher does with a surface: the gaps it closes, or its refusal.
struct Meshed {
  std::optional<FineMesh<3>> mesh;
  std::vector<SurfaceGap> closed;
  std::string refusal;
};
Meshed by_delaunay(const SurfaceSoup& soup, double size) {
  try {
    const MeshData<3> mesh = mesh_surface(soup, {.size = size});
    return {FineMesh<3>(mesh), closed_gaps(find_gaps(soup, 2.0 * size, 0.5 * size), mesh, 0.1 * size), ""};
  } catch (const InputError& error) {
    return {{}, {}, error.what()};
  }
}
Meshed on_lattice(const SurfaceSoup& soup, double size) {
  const MeshData<3> mesh = mesh_surface_on_lattice(soup, size).mesh;
  return {FineMesh<3>(mesh), closed_gaps(find_gaps(soup, 2.0 * size, 0.5 * size), mesh, 0.5 * size), ""};
}

TEST(SurfaceGaps, WidthAndPlaceAreFoundDownToAMillionthOfTheSize) {
  for (const double w : widths) {
    const auto slit = find_gaps(fork_surface(w), 0.5, 0.5);
    ASSERT_EQ(slit.size(), 1u) << w;
    EXPECT_NEAR(slit[0].narrowest, w, 1e-9) << w;
    EXPECT_NEAR(slit[0].widest, w, 1e-9) << w;
    EXPECT_NEAR(slit[0].at.z(), 5.0 + 0.5 * w, 1e-9) << w;
    EXPECT_NEAR(slit[0].area, 2.0 * 18.0 * 4.0, 1e-6) << w;
    const auto gap =
        find_gaps(together(box_surface({0, 0, 0}, {20, 10, 10}), box_surface({20 + w, 0, 0}, {40, 10, 10})), 0.5, 0.5);
    ASSERT_EQ(gap.size(), 1u) << w;
    EXPECT_NEAR(gap[0].narrowest, w, 1e-9) << w;
    EXPECT_NEAR(gap[0].area, 200.0, 1e-6) << w;
    for (const double slope : {0.0, 0.1}) {  // cylinders and cones
      const double across = w / std::sqrt(1.0 + slope * slope) * std::cos(std::numbers::pi / 24.0);
      for (const SurfaceSoup& soup : {ring_with_slit(w, slope, 24), rod_in_tube(w, slope, 24)}) {
        const auto curved = find_gaps(soup, 0.5, 1.0);
        ASSERT_EQ(curved.size(), 1u) << w;
        EXPECT_NEAR(curved[0].narrowest, across, 1e-3 * w + 1e-9) << w << ' ' << slope;
        EXPECT_NEAR(curved[0].at.head<2>().norm(), 5.5, 0.6) << w;
      }
    }
  }
}

TEST(SurfaceGaps, WallsCavitiesAndOpenNotchesAreNone) {
  EXPECT_TRUE(find_gaps(box_surface({0, 0, 0}, {1, 1, 0.01}), 0.1, 0.05).empty());  // a thin wall
  EXPECT_TRUE(
      find_gaps(together(box_surface({0, 0, 0}, {1, 1, 1}), box_surface({0.01, 0.2, 0.2}, {0.8, 0.8, 0.8})), 0.1, 0.05)
          .empty());
  EXPECT_TRUE(find_gaps(sphere_surface({0, 0, 0}, 1.0, 16), 0.5, 0.1).empty());
  // A pore narrower than what is looked for: as wide as it is long.
  EXPECT_TRUE(find_gaps(together(box_surface({0, 0, 0}, {1, 1, 1}), sphere_surface({0.5, 0.5, 0.5}, 0.1, 8)), 0.3, 0.1)
                  .empty());
  EXPECT_TRUE(find_gaps(fork_surface(0.6), 0.5, 0.5).empty());
  EXPECT_TRUE(find_gaps({}, 0.5, 0.5).empty());
}

TEST(SurfaceGaps, DelaunayMesherKeepsGapsBetweenBodiesOfAnyWidth) {
  for (const double w : widths) {
    const SurfaceSoup boxes =
        together(box_surface({0, 0, 0}, {20, 10, 10}), box_surface({20 + w, 0, 0}, {40 + w, 10, 10}));
    const Meshed flat = by_delaunay(boxes, 4.0);
    ASSERT_TRUE(flat.mesh) << flat.refusal;
    EXPECT_EQ(flat.mesh->num_components(), 2) << w;
    EXPECT_NEAR(flat.mesh->volumes().sum(), 4000.0, 1e-6) << w;
    EXPECT_LT(flat.mesh->num_cells(), 6000) << w;  // no more than without the gap
    EXPECT_TRUE(flat.closed.empty()) << w;
    for (const double slope : {0.0, 0.1}) {
      const Meshed curved = by_delaunay(rod_in_tube(w, slope, 24), 4.0);
      ASSERT_TRUE(curved.mesh) << curved.refusal;
      EXPECT_EQ(curved.mesh->num_components(), 2) << w << ' ' << slope;
      EXPECT_TRUE(curved.closed.empty()) << w << ' ' << slope;
    }
  }
}

TEST(SurfaceGaps, DelaunayMesherKeepsNamesOrRefusesSlitsWithinABody) {
  for (const double w : {0.3, 1e-1, 1e-3, 2e-5})
    for (const SurfaceSoup& soup : {fork_surface(w), ring_with_slit(w, 0.0, 24), ring_with_slit(w, 0.1, 24)}) {
      const Meshed slit = by_delaunay(soup, 3.0);
      if (slit.mesh)
        EXPECT_TRUE(!slit.closed.empty()) << w;
      else
        EXPECT_THAT(slit.refusal, testing::HasSubstr("wide at (")) << w;
    }
  const Meshed wide = by_delaunay(fork_surface(1.5), 3.0);
  ASSERT_TRUE(wide.mesh) << wide.refusal;
  EXPECT_TRUE(wide.closed.empty());
}

TEST(SurfaceGaps, LatticeNamesGapsThatItCloses) {
  for (const double w : {1e-1, 1e-3, 2e-5})
    for (const SurfaceSoup& soup :
         {fork_surface(w), ring_with_slit(w, 0.1, 24), rod_in_tube(w, 0.0, 24),
          together(box_surface({0, 0, 0}, {20, 10, 10}), box_surface({20 + w, 0, 0}, {40 + w, 10, 10}))}) {
      const Meshed meshed = on_lattice(soup, 1.5);
      ASSERT_EQ(meshed.closed.size(), 1u) << w;
      EXPECT_NEAR(meshed.closed[0].narrowest, w, 0.02 * w + 1e-9);
    }
  const Meshed wide = on_lattice(fork_surface(2.0), 0.9);
  EXPECT_TRUE(wide.closed.empty());
}

TEST(SurfaceGaps, WrapsCloseGapsThatAreNamed) {
  const SurfaceSoup fork = fork_surface(0.01);
  const SurfaceWrap wrap = wrap_surface(fork, {.alpha = 2.0, .offset = 0.1});
  const MeshData<3> mesh = mesh_surface(wrap.surface, {.size = 3.0, .feature_angle = 180.0});
  const auto closed = closed_gaps(find_gaps(fork, 2.2, 1.5), mesh, 0.4);
  ASSERT_EQ(closed.size(), 1u);
  EXPECT_NEAR(closed[0].narrowest, 0.01, 1e-9);
}

TEST(SurfaceGaps, OneAndTwoThreadsAgreeBitwise) {
  const SurfaceSoup soup = ring_with_slit(0.01, 0.1, 16);
  set_num_threads(1);
  const auto first = find_gaps(soup, 0.5, 1.0);
  set_num_threads(2);
  const auto second = find_gaps(soup, 0.5, 1.0);
  set_num_threads(1);
  ASSERT_EQ(first.size(), second.size());
  for (std::size_t g = 0; g < first.size(); ++g) {
    EXPECT_EQ(first[g].area, second[g].area);
    EXPECT_EQ(first[g].at, second[g].at);
  }
}

}  // namespace
}  // namespace efree
