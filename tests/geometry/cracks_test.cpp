// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/bench/crack_scenes.hpp"
#include "efree/bench/elastic_block.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "meshes.hpp"

#include <Eigen/Geometry>

namespace efree {
namespace {

using namespace bench;

template <int Dim> class Cracks : public ::testing::Test {
 public:
  static constexpr Index along = Dim == 2 ? 20 : 9;
  const FineMesh<Dim> body = block<Dim>(1.0, 0.5);
  const Points<Dim> points = points_in_unit_box<Dim>(along, 0.2);
  const PointMesh<Dim> mesh = mesh_between<Dim>(points, body);
};
class CracksInThePlane : public Cracks<2> {};
class CracksInSpace : public Cracks<3> {};

template <int Dim> void expect_no_faults(const CrackedMesh<Dim>& mesh, double volume = 1.0) {
  const CrackFaults faults = find_faults<Dim>(mesh, volume);
  EXPECT_LT(faults.tiling, 1e-12);
  EXPECT_EQ(faults.inverted, 0);
  EXPECT_EQ(faults.open_edges, 0);
  EXPECT_EQ(faults.wrong_parts, 0);
  EXPECT_EQ(faults.inner_facets, 0);
  EXPECT_NEAR(mesh.volumes.sum(), volume, 1e-12 * volume);
}

template <int Dim> void expect_uncut_is_the_mesh(const Cracks<Dim>& scene) {
  CrackedBody<Dim> body(scene.mesh);
  Mat<Dim> F = 1.3 * Mat<Dim>::Identity();
  F(0, 1) = 0.4;
  body.move((F * scene.points).colwise() + Vec<Dim>::Constant(2.0));
  const CrackedMesh<Dim> mesh = body.mesh();
  EXPECT_EQ(body.num_cut_edges(), 0);
  EXPECT_EQ(mesh.cells, scene.mesh.cells);
  EXPECT_EQ(mesh.reference, scene.mesh.vertices);
  // Vertices on the surface too move as the body does.
  EXPECT_LT((mesh.current - ((F * mesh.reference).colwise() + Vec<Dim>::Constant(2.0))).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_EQ(mesh.volumes.size(), 1);
  EXPECT_EQ(mesh.crack_area, 0.0);
  expect_no_faults(mesh);
}
TEST_F(CracksInThePlane, UncutTheBodyIsItsMesh) {
  expect_uncut_is_the_mesh<2>(*this);
}
TEST_F(CracksInSpace, UncutTheBodyIsItsMesh) {
  expect_uncut_is_the_mesh<3>(*this);
}

template <int Dim> void expect_pieces_tile(const Cracks<Dim>& scene) {
  // From a few cuts to dust.
  Index cut_before = 0;
  CrackedBody<Dim> body(scene.mesh, {.stretch = 1.5});
  for (const double amplitude : {0.4, 0.5, 0.7, 1.0, 2.0}) {
    body.move(in_disorder<Dim>(scene.points, amplitude / static_cast<double>(scene.along)));
    EXPECT_GT(body.num_cut_edges(), cut_before);
    cut_before = body.num_cut_edges();
    EXPECT_LE(body.largest_stretch(), 1.5);
    const CrackedMesh<Dim> mesh = body.mesh();
    expect_no_faults(mesh);
    EXPECT_TRUE(std::ranges::is_sorted(mesh.volumes, std::greater<>()));
  }
  // What is cut stays cut.
  body.move(scene.points);
  EXPECT_EQ(body.num_cut_edges(), cut_before);
}
TEST_F(CracksInThePlane, PiecesTileTheBodyAndOnlyGetMore) {
  expect_pieces_tile<2>(*this);
}
TEST_F(CracksInSpace, PiecesTileTheBodyAndOnlyGetMore) {
  expect_pieces_tile<3>(*this);
}

template <int Dim> void expect_halves_move_rigidly(const Cracks<Dim>& scene) {
  CrackedBody<Dim> body(scene.mesh);
  const auto beyond = [](const auto& x) { return x[0] + 0.3 * x[1] > 0.63; };
  Mat<Dim> turn = Mat<Dim>::Identity();
  turn.template topLeftCorner<2, 2>() = Eigen::Rotation2Dd(0.5).toRotationMatrix();
  const Vec<Dim> shift = 2.0 * Vec<Dim>::Unit(0);
  Points<Dim> moved = scene.points;
  for (Index p = 0; p < moved.cols(); ++p)
    if (beyond(scene.points.col(p))) moved.col(p) = turn * scene.points.col(p) + shift;
  body.move(moved);
  const CrackedMesh<Dim> mesh = body.mesh();
  expect_no_faults(mesh);
  ASSERT_EQ(mesh.volumes.size(), 2);
  EXPECT_NEAR(mesh.volumes[0] + mesh.volumes[1], 1.0, 1e-12);
  // Faces of the crack too: what they are the middles of is extrapolated from either side.
  double worst = 0.0;
  for (Index n = 0; n < mesh.reference.cols(); ++n) {
    const Vec<Dim> X = mesh.reference.col(n);
    const bool moves = beyond(scene.points.col(scene.mesh.owner[mesh.vertices[n][0]]));
    const Vec<Dim> expected = moves ? Vec<Dim>(turn * X + shift) : X;
    worst = std::max(worst, (mesh.current.col(n) - expected).norm());
  }
  EXPECT_LT(worst, 1e-12);
}
TEST_F(CracksInThePlane, HalvesMoveRigidlyWithTheFacesOfTheCrack) {
  expect_halves_move_rigidly<2>(*this);
}
TEST_F(CracksInSpace, HalvesMoveRigidlyWithTheFacesOfTheCrack) {
  expect_halves_move_rigidly<3>(*this);
}

template <int Dim> void expect_plane_crack(const Cracks<Dim>& scene) {
  for (const double slope : {0.0, 0.15, 0.4}) {
    CrackedBody<Dim> smooth(scene.mesh), rough(scene.mesh, {.smoothing = 0});
    Vec<Dim> normal = Vec<Dim>::Constant(slope);
    normal[0] = 1.0;
    const double level = 0.5 + 0.5 * slope * (Dim - 1);
    for (CrackedBody<Dim>* body : {&smooth, &rough})
      body->move(torn_by_plane<Dim>(scene.points, normal.normalized(), level / normal.norm(), 5.0));
    const CrackedMesh<Dim> mesh = smooth.mesh();
    expect_no_faults(mesh);
    EXPECT_NEAR(mesh.crack_area / section_of_unit_box<Dim>(slope), 1.0, 0.05) << slope;
    // What smoothing is for.
    EXPECT_GT(rough.mesh().crack_area, 1.02 * mesh.crack_area) << slope;
    EXPECT_NEAR(mesh.volumes[0], 0.5, 0.05);
  }
}
TEST_F(CracksInThePlane, APlaneCrackHasTheAreaOfItsSection) {
  expect_plane_crack<2>(*this);
}
TEST_F(CracksInSpace, APlaneCrackHasTheAreaOfItsSection) {
  expect_plane_crack<3>(*this);
}

TEST_F(CracksInThePlane, PointsOfALatticeAreMeshedToTheBoundaryOfTheBody) {
  const FineMesh<2> ring = triangulate(shapes::annulus(0.3, 1.0, 0.1), {.size = 0.1});
  const Points<2> lattice = (2.0 * points_in_unit_box<2>(30, 0.0)).array() - 1.0;
  std::vector<Index> inside;
  for (Index p = 0; p < lattice.cols(); ++p)
    if (const double r = lattice.col(p).norm(); r > 0.33 && r < 0.97) inside.push_back(p);
  const Points<2> in_ring = lattice(Eigen::all, inside);
  const PointMesh<2> to_boundary = mesh_between<2>(in_ring, ring);
  EXPECT_NEAR(volumes_of_cells<2>(to_boundary.vertices, to_boundary.cells).sum(), ring.volumes().sum(),
              1e-3 * ring.volumes().sum());
  // Alone they end half a spacing before it.
  const PointMesh<2> alone = mesh_between<2>(in_ring);
  EXPECT_LT(volumes_of_cells<2>(alone.vertices, alone.cells).sum(), 0.95 * ring.volumes().sum());
  EXPECT_GT(volumes_of_cells<2>(alone.vertices, alone.cells).sum(), 0.8 * ring.volumes().sum());
}

TEST_F(CracksInThePlane, PointsOnTheBoundaryNeedNoOthersThere) {
  const FineMesh<2> square = bench::block<2>(1.0, 0.1);
  const PointMesh<2> own = mesh_between<2>(square.vertices(), square);
  EXPECT_NEAR(volumes_of_cells<2>(own.vertices, own.cells).sum(), 1.0, 1e-9);
  EXPECT_GT(volumes_of_cells<2>(own.vertices, own.cells).minCoeff(), 1e-4);
}

TEST_F(CracksInSpace, VerticesOfAMeshAreCutAsPointsAre) {
  CrackedBody<3> whole(mesh_of_vertices(body));
  whole.move(torn_by_plane<3>(body.vertices(), Vec<3>::UnitX(), 0.6, 3.0));
  const CrackedMesh<3> torn = whole.mesh();
  expect_no_faults(torn);
  EXPECT_EQ(torn.volumes.size(), 2);
  EXPECT_NEAR(torn.crack_area, 1.0, 0.05);
}

TEST_F(CracksInSpace, AreBitwiseTheSameOnAnyNumberOfThreads) {
  std::vector<CrackedMesh<3>> meshes;
  const int before = num_threads();
  for (const int threads : {1, 3}) {
    set_num_threads(threads);
    CrackedBody<3> torn(mesh_between<3>(points, body));
    torn.move(in_disorder<3>(points, 1.0 / along));
    meshes.push_back(torn.mesh());
  }
  set_num_threads(before);
  EXPECT_EQ(meshes[0].current, meshes[1].current);
  EXPECT_EQ(meshes[0].cells, meshes[1].cells);
  EXPECT_EQ(meshes[0].surface, meshes[1].surface);
}

TEST_F(CracksInThePlane, WrongInputIsRefused) {
  EXPECT_INPUT_ERROR(CrackedBody<2>(mesh, {.stretch = 1.0}), "expected a stretch of more than 1");
  EXPECT_INPUT_ERROR(CrackedBody<2>(mesh, {.smoothing = -1}), "expected no or some sweeps");
  PointMesh<2> wrong = mesh;
  wrong.owner[0] = wrong.num_points;
  EXPECT_INPUT_ERROR(CrackedBody<2>{wrong}, "owners that are no vertices or points");
  EXPECT_INPUT_ERROR(CrackedBody<2>(mesh).move(points.leftCols(3)), "expected the positions of all points");
  EXPECT_INPUT_ERROR(mesh_between<2>(points.leftCols(2)), "expected four points");
}

}  // namespace
}  // namespace efree
