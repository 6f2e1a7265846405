// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/contact/close_contacts.hpp"
#include "efree/core/error.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <numbers>

namespace efree {
namespace {

/// One mesh with a region for each.
template <int Dim> FineMesh<Dim> together(const std::vector<FineMesh<Dim>>& parts) {
  MeshData<Dim> data;
  for (const FineMesh<Dim>& part : parts) {
    const Index vertices = data.vertices.cols(), cells = data.cells.cols();
    data.vertices.conservativeResize(Dim, vertices + part.num_vertices());
    data.vertices.rightCols(part.num_vertices()) = part.vertices();
    data.cells.conservativeResize(Dim + 1, cells + part.num_cells());
    data.cells.rightCols(part.num_cells()) = part.cells().array() + vertices;
    data.regions.resize(static_cast<std::size_t>(data.cells.cols()), static_cast<Index>(data.region_names.size()));
    data.region_names.push_back(std::to_string(data.region_names.size()));
  }
  return FineMesh<Dim>(std::move(data));
}

TEST(CloseContacts, BlocksThatMissEachOtherTouchAndTheLaterOneIsStretched) {
  const auto block = [](double from, double to, double size) {
    return triangulate(shapes::rectangle(0.0, from, 2.0, to), {.size = size});
  };
  for (const double miss : {0.03, -0.03}) {
    auto mesh = together<2>({block(0.0, 1.0, 0.2), block(1.0 + miss, 2.0, 0.15)});
    const FineMesh<2> before = mesh;
    EXPECT_EQ(close_contacts(mesh, 0.02).vertices, 0) << "wider than the tolerance";
    const ClosedContacts closed = close_contacts(mesh, 0.04);
    EXPECT_GT(closed.vertices, 10);
    EXPECT_NEAR(closed.furthest, 0.03, 1e-6);
    EXPECT_LE(closed.overlap, 1e-7);
    ASSERT_EQ(closed.volume_change.size(), 2);
    EXPECT_EQ(closed.volume_change[0], 0.0) << "the first one stays as it is";
    EXPECT_NEAR(closed.volume_change[1], miss / (1.0 - miss), 0.01 * std::abs(miss)) << "the later one fills the gap";
    for (Index v = 0; v < mesh.num_vertices(); ++v) {
      const Vec<2> x = mesh.vertex(v), X = before.vertex(v);
      const bool is_upper = X[1] > 1.0 + std::min(miss, 0.0) - 1e-12 && mesh.region(mesh.cells_of(v)[0]) == 1;
      // Stretched evenly: what is at the far end stays.
      const double expected = is_upper ? X[1] - miss * (2.0 - X[1]) / (1.0 - miss) : X[1];
      EXPECT_NEAR(x[1], expected, 0.2 * std::abs(miss)) << X.transpose();
      if (is_upper && std::abs(X[1] - 1.0 - miss) < 1e-12) {
        EXPECT_NEAR(x[1], 1.0, 1e-7);
      }
      EXPECT_NEAR(x[0], X[0], 1e-15);
    }
    EXPECT_EQ(close_contacts(mesh, 0.04).vertices, 0) << "once is enough";
    EXPECT_TRUE(tied_facets(mesh).empty());
  }
}

/// The middle of its underside is above the joint of the other two, and faces both.
TEST(CloseContacts, ABlockOverTheJointOfTwoThatTouchStaysFlat) {
  const auto block = [](double x, double to, double y, double high) {
    return triangulate(shapes::rectangle(x, y, to, high), {.size = 0.2});
  };
  auto mesh = together<2>({block(0.0, 1.0, 0.0, 1.0), block(1.0, 2.0, 0.0, 1.0), block(0.2, 1.8, 1.08, 2.0)});
  const FineMesh<2> before = mesh;
  EXPECT_NEAR(close_contacts(mesh, 0.1).furthest, 0.08, 1e-6);
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    if (std::abs(before.vertex(v)[1] - 1.08) < 1e-12) {
      EXPECT_NEAR(mesh.vertex(v)[1], 1.0, 1e-6);
    }
    EXPECT_NEAR(mesh.vertex(v)[0], before.vertex(v)[0], 1e-12);
  }
}

Polyline circle(int corners) {
  Polyline line{.name = "", .points = {}};
  for (int k = 0; k <= corners; ++k) {
    const double angle = 2.0 * std::numbers::pi * (k % corners) / corners;
    line.points.emplace_back(std::cos(angle), std::sin(angle));
  }
  return line;
}

/// A shaft in a bore of the same radius, with other facets: corners of each are inside chords of the other.
TEST(CloseContacts, AShaftFitsItsBoreThoughTheirFacetsDiffer) {
  PlanarDomain shaft, plate = shapes::rectangle(-2.0, -2.0, 2.0, 2.0);
  shaft.boundary.push_back(circle(24));
  plate.boundary.push_back(circle(31));
  auto mesh = together<2>({triangulate(plate, {.size = 0.3}), triangulate(shaft, {.size = 0.3})});
  const double sagitta = 1.0 - std::cos(std::numbers::pi / 24);
  const ClosedContacts closed = close_contacts(mesh, 0.02);
  EXPECT_GT(closed.vertices, 20);
  EXPECT_LT(closed.furthest, 2.5 * sagitta);
  EXPECT_LT(closed.overlap, 1e-6);
}

/// A ring around a rod, in a section: volumes are those of the full revolution.
TEST(CloseContacts, ARingThatIsClosedOntoARodHasTheVolumeOfItsNewBore) {
  const auto section = [](double inner, double outer) {
    return triangulate(shapes::rectangle(inner, 0.0, outer, 1.0), {.size = 0.1});
  };
  auto mesh = together<2>({section(0.0, 1.0), section(1.02, 1.5)});
  const ClosedContacts closed = close_contacts(mesh, 0.03, true);
  EXPECT_EQ(closed.volume_change[0], 0.0);
  const double before = 1.5 * 1.5 - 1.02 * 1.02, after = 1.5 * 1.5 - 1.0;
  EXPECT_NEAR(closed.volume_change[1], after / before - 1.0, 1e-6);
}

TEST(CloseContacts, CubesInSpaceAndCellsThatWouldCollapse) {
  const auto cube = [](double from, double size) {
    MeshData<3> data = solids::box(Vec<3>::Ones(), size);
    data.vertices.row(2).array() += from;
    return FineMesh<3>(std::move(data));
  };
  auto mesh = together<3>({cube(0.0, 0.4), cube(0.98, 0.3)});
  const ClosedContacts closed = close_contacts(mesh, 0.05);
  EXPECT_GT(closed.vertices, 10);
  EXPECT_NEAR(closed.furthest, 0.02, 1e-6);
  EXPECT_LE(closed.overlap, 1e-6);
  EXPECT_THROW(close_contacts(mesh, 0.0), InputError);
  const auto layer = [](double from, double to) {
    return triangulate(shapes::rectangle(0.0, from, 1.0, to), {.size = 0.1});
  };
  auto squeezed = together<2>({layer(-1.0, 0.0), layer(0.001, 1.0), layer(-0.03, 0.05)});
  EXPECT_THROW(close_contacts(squeezed, 0.06), InputError) << "a hundredth of the thickness is left for the last one";
}

}  // namespace
}  // namespace efree
