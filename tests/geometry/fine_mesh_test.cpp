// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/largest_body.hpp"
#include "meshes.hpp"

#include <numbers>

namespace efree {
namespace {

using test::expect_consistent;

/// Unit square in n x n squares of two triangles; vertex (i, j) has the number j (n + 1) + i.
MeshData<2> grid(Index n) {
  MeshData<2> mesh;
  mesh.vertices.resize(2, (n + 1) * (n + 1));
  for (Index j = 0; j <= n; ++j)
    for (Index i = 0; i <= n; ++i) mesh.vertices.col(j * (n + 1) + i) = Vec<2>(i, j) / n;
  mesh.cells.resize(3, 2 * n * n);
  for (Index j = 0; j < n; ++j)
    for (Index i = 0; i < n; ++i) {
      const Index a = j * (n + 1) + i, b = a + 1, c = a + n + 1, d = c + 1;
      mesh.cells.col(2 * (j * n + i)) << a, b, d;
      mesh.cells.col(2 * (j * n + i) + 1) << a, c, d;  // the other way round
    }
  return mesh;
}

/// Facets along row j from column `from` to `to`, in the group "cut".
std::vector<std::array<Index, 2>> row_of_facets(Index n, Index j, Index from, Index to, MeshData<2>& mesh) {
  std::vector<std::array<Index, 2>> facets;
  for (Index i = from; i < to; ++i) facets.push_back({j * (n + 1) + i, j * (n + 1) + i + 1});
  mesh.groups.push_back({"cut", facets});
  return facets;
}

TEST(FineMesh, OrientsCellsAndFindsTheBoundary) {
  const FineMesh<2> mesh(grid(4));
  expect_consistent(mesh);
  EXPECT_EQ(mesh.num_vertices(), 25);
  EXPECT_EQ(mesh.num_cells(), 32);
  EXPECT_EQ(mesh.num_facets(), 16);
  EXPECT_EQ(mesh.num_components(), 1);
  EXPECT_DOUBLE_EQ(mesh.volumes().sum(), 1.0);
  EXPECT_DOUBLE_EQ(mesh.size(), std::sqrt(2.0) / 4.0);
}

TEST(FineMesh, HatGradientsReproduceLinearFunctions) {
  const FineMesh<2> mesh(grid(3));
  double worst = 0.0;
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    Mat<2> gradient = Mat<2>::Zero();
    for (int i = 0; i < 3; ++i) gradient += mesh.vertex(mesh.cells()(i, c)) * mesh.hat_gradients(c).col(i).transpose();
    worst = std::max(worst, (gradient - Mat<2>::Identity()).cwiseAbs().maxCoeff());
  }
  EXPECT_LT(worst, 1e-14);
}

TEST(FineMesh, DropsVerticesWithoutACell) {
  MeshData<2> data = grid(2);
  data.vertices.conservativeResize(2, 10);
  data.vertices.col(9) << 7.0, 7.0;
  EXPECT_EQ(FineMesh<2>(data).num_vertices(), 9);
}

TEST(FineMesh, LeavesOutGroupsInsideTheBody) {
  MeshData<2> data = grid(2);
  data.groups = {{"inside", {{1, 4}}}, {"mixed", {{1, 4}, {0, 1}}}};
  const FineMesh<2> mesh(data);
  EXPECT_EQ(mesh.groups().size(), 1u);
  EXPECT_EQ(mesh.group("mixed").size(), 1u);
  EXPECT_INPUT_ERROR(mesh.group("inside"), "named \"inside\"; the mesh has \"mixed\"");
}

TEST(FineMesh, RefusesMeshesThatAreNone) {
  MeshData<2> data = grid(2);
  data.cells.resize(3, 0);
  EXPECT_INPUT_ERROR(FineMesh<2>{data}, "no cell");
  data = grid(2);
  data.cells(0, 0) = 9;
  EXPECT_INPUT_ERROR(FineMesh<2>{data}, "names vertex 9, expected 0 to 8");
  data = grid(2);
  data.vertices(1, 3) = std::nan("");
  EXPECT_INPUT_ERROR(FineMesh<2>{data}, "not a finite number");
  data = grid(2);
  data.cells.col(0) << 0, 1, 2;
  EXPECT_INPUT_ERROR(FineMesh<2>{data}, "no volume");
  data = grid(2);
  data.cells.conservativeResize(3, 9);
  data.cells.col(8) << 0, 4, 2;
  EXPECT_INPUT_ERROR(FineMesh<2>{data}, "more than two cells");
  data = grid(2);
  data.groups = {{"far", {{0, 8}}}};
  EXPECT_INPUT_ERROR(FineMesh<2>{data}, "group \"far\"");
}

TEST(FineMesh, RefusesMeshesThatFoldOverThemselvesWithThePlace) {
  MeshData<2> data;
  data.vertices.resize(2, 4);
  data.vertices << 0, 1, 0, 0.2,  //
      0, 0, 1, 0.2;
  data.cells.resize(3, 2);
  data.cells << 0, 1,  //
      1, 2,            //
      2, 3;
  EXPECT_INPUT_ERROR(FineMesh<2>{data}, "folds over itself at (0.5, 0.5)");
  data.vertices.col(3) << 1, 1;
  EXPECT_NO_THROW(FineMesh<2>{data});

  // A fan that goes around its middle twice.
  constexpr int turns = 2, leaves = 12;
  MeshData<2> fan;
  fan.vertices.resize(2, 1 + leaves);
  fan.vertices.col(0) << 3, 4;
  fan.cells.resize(3, leaves);
  for (int k = 0; k < leaves; ++k) {
    const double angle = 2.0 * std::numbers::pi * turns * k / leaves;
    fan.vertices.col(1 + k) << 3 + (1 + 0.01 * k) * std::cos(angle), 4 + (1 + 0.01 * k) * std::sin(angle);
    fan.cells.col(k) << 0, 1 + k, 1 + (k + 1) % leaves;
  }
  EXPECT_INPUT_ERROR(FineMesh<2>{fan}, "folds over itself at (3, 4)");

  MeshData<3> solid;
  solid.vertices.resize(3, 5);
  solid.vertices << 0, 1, 0, 0, 0.1,  //
      0, 0, 1, 0, 0.1,                //
      0, 0, 0, 1, 0.5;
  solid.cells.resize(4, 2);
  solid.cells << 0, 0,  //
      1, 1,             //
      2, 2,             //
      3, 4;
  EXPECT_INPUT_ERROR(FineMesh<3>{solid}, "folds over itself at (0.333333, 0.333333, 0)");
  solid.vertices(2, 4) = -0.5;
  EXPECT_NO_THROW(FineMesh<3>{solid});
}

TEST(FineMesh, RefusesBodiesThatDoublePrecisionCannotHold) {
  const auto square = [](double scale, double height, double away) {
    MeshData<2> data = grid(2);
    data.vertices.row(1) *= height;
    data.vertices = (scale * data.vertices).colwise() + Vec<2>::Constant(away);
    return data;
  };
  EXPECT_NO_THROW(FineMesh<2>{square(1.0, 1e-4, 1e6)});
  EXPECT_NO_THROW(FineMesh<2>{square(1e-29, 1.0, 0.0)});
  EXPECT_INPUT_ERROR(FineMesh<2>{square(1e-31, 1.0, 0.0)}, "1e-31 large, expected 1e-30 to 1e+30");
  EXPECT_INPUT_ERROR(FineMesh<2>{square(1e31, 1.0, 0.0)}, "1e+31 large, expected 1e-30 to 1e+30");
  EXPECT_INPUT_ERROR(FineMesh<2>{square(1.0, 1.0, 1e9)}, "1 large and lies 1e+09 from the origin");
  EXPECT_INPUT_ERROR(FineMesh<2>{square(1.0, 1e-7, 0.0)}, "1 long and 1e-07 thick");
}

TEST(CutOpen, TipsStayWholeAndBothSidesAreInTheGroup) {
  MeshData<2> data = grid(8);
  const auto cut = row_of_facets(8, 4, 2, 6, data);
  const FineMesh<2> whole(data), open(cut_open<2>(data, cut));
  expect_consistent(open);
  EXPECT_EQ(open.num_vertices(), whole.num_vertices() + 3);  // four facets, three vertices between the tips
  EXPECT_EQ(open.num_facets(), whole.num_facets() + 8);
  EXPECT_EQ(open.group("cut").size(), 8u);
  EXPECT_EQ(open.num_components(), 1);
  EXPECT_EQ(test::euler_characteristic(open), 0);
  Vec<2> sum = Vec<2>::Zero();
  for (const Index f : open.group("cut")) sum += open.facet_normal(f);
  EXPECT_EQ(sum, Vec<2>::Zero().eval());  // as many facets look up as look down
  for (const double tip : {0.25, 0.75}) {
    int copies = 0;
    for (Index v = 0; v < open.num_vertices(); ++v) copies += open.vertex(v) == Vec<2>(tip, 0.5);
    EXPECT_EQ(copies, 1) << "at the tip " << tip;
  }
}

TEST(CutOpen, FromEdgeToEdgeSeparatesBodies) {
  MeshData<2> data = grid(6);
  const auto cut = row_of_facets(6, 2, 0, 6, data);
  const FineMesh<2> mesh(cut_open<2>(data, cut));
  expect_consistent(mesh);
  EXPECT_EQ(mesh.num_components(), 2);
  EXPECT_EQ(mesh.num_vertices(), 49 + 7);
  double lower = 0.0;
  for (Index c = 0; c < mesh.num_cells(); ++c)
    if (mesh.component()[mesh.cells()(0, c)] == mesh.component()[0]) lower += mesh.volume(c);
  EXPECT_NEAR(lower, 1.0 / 3.0, 1e-14);
}

TEST(CutOpen, CrossingCutsPartTheirCommonVertexInFour) {
  MeshData<2> data = grid(8);
  auto cut = row_of_facets(8, 4, 1, 7, data);
  for (Index j = 2; j < 6; ++j) cut.push_back({j * 9 + 4, (j + 1) * 9 + 4});
  const FineMesh<2> mesh(cut_open<2>(data, cut));
  expect_consistent(mesh);
  int copies = 0;
  for (Index v = 0; v < mesh.num_vertices(); ++v) copies += mesh.vertex(v) == Vec<2>(0.5, 0.5);
  EXPECT_EQ(copies, 4);
  EXPECT_EQ(mesh.num_components(), 1);
  EXPECT_EQ(test::euler_characteristic(mesh), 0);
}

/// Three vertical stripes, the outer two of the same region.
MeshData<2> stripes() {
  MeshData<2> data = grid(6);
  data.region_names = {"soft", "stiff"};
  for (Index c = 0; c < data.cells.cols(); ++c) {
    double x = 0.0;
    for (int i = 0; i < 3; ++i) x += data.vertices(0, data.cells(i, c)) / 3.0;
    data.regions.push_back(x > 1.0 / 3.0 && x < 2.0 / 3.0);
  }
  return data;
}

TEST(CutRegions, EveryRegionBecomesABodyTiedToItsNeighbours) {
  const FineMesh<2> whole(stripes()), parted(cut_regions<2>(stripes()));
  expect_consistent(parted);
  EXPECT_EQ(whole.num_components(), 1);
  EXPECT_TRUE(tied_facets(whole).empty());
  EXPECT_EQ(parted.num_components(), 3);
  EXPECT_EQ(parted.num_vertices(), whole.num_vertices() + 14);
  const auto ties = tied_facets(parted);
  ASSERT_EQ(ties.size(), 12u);
  for (const auto& [soft, stiff] : ties) {
    EXPECT_EQ(parted.region(parted.facet_cell(soft)), parted.region("soft"));
    EXPECT_EQ(parted.region(parted.facet_cell(stiff)), parted.region("stiff"));
    EXPECT_EQ(parted.vertex(parted.facets()(0, soft)), parted.vertex(parted.facets()(1, stiff)));
    EXPECT_EQ(parted.vertex(parted.facets()(1, soft)), parted.vertex(parted.facets()(0, stiff)));
  }
}

TEST(CutRegions, ACrackAlongAnInterfaceStaysOpen) {
  MeshData<2> data = stripes();
  data.groups.push_back({"crack", {{2, 9}, {9, 16}}});  // two edges of the line x = 1/3
  const FineMesh<2> mesh(cut_regions<2>(data));
  EXPECT_EQ(mesh.group("crack").size(), 4u);
  EXPECT_EQ(tied_facets(mesh).size(), 12u);
  EXPECT_EQ(tied_facets(mesh, "crack").size(), 10u);
}

TEST(FineMesh, RefusesRegionsThatAreNone) {
  MeshData<2> data = stripes();
  EXPECT_INPUT_ERROR(FineMesh<2>(data).region("hard"), "no region is named \"hard\"; the mesh has \"soft\", \"stiff\"");
  data.region_names[1] = "soft";
  EXPECT_INPUT_ERROR(FineMesh<2>{data}, "two regions are named \"soft\"");
  data.region_names.pop_back();
  EXPECT_INPUT_ERROR(FineMesh<2>{data}, "in region 1, but 1 regions have a name");
  data.regions.pop_back();
  EXPECT_INPUT_ERROR(FineMesh<2>{data}, "71 region numbers for 72 cells");
}

TEST(CutOpen, RefusesWhatItCannotCut) {
  MeshData<2> data = grid(4);
  EXPECT_INPUT_ERROR(cut_open<2>(data, {{0, 24}}), "no cell has a facet of vertices 0, 24");
  EXPECT_INPUT_ERROR(cut_open<2>(data, {{11, 12}}), "stays closed");
  data.cells(0, 0) = -1;
  EXPECT_INPUT_ERROR(cut_open<2>(data, {{0, 1}}), "names vertex -1, expected 0 to 24");
}

/// Two squares of different size that do not touch, one of two regions.
TEST(KeepLargest, LeavesIslandsOut) {
  MeshData<2> data;
  data.vertices.resize(2, 8);
  data.vertices << 5, 6, 6, 5, 0, 2, 2, 0,  //
      0, 0, 1, 1, 0, 0, 2, 2;
  data.cells.resize(3, 4);
  data.cells << 0, 0, 4, 4,  //
      1, 2, 5, 6,            //
      2, 3, 6, 7;
  data.groups = {{"both", {{0, 1}, {4, 5}}}, {"island", {{1, 2}}}};
  data.regions = {0, 0, 1, 0};
  data.region_names = {"a", "b"};
  const LargestMesh<2> body = keep_largest(data);
  EXPECT_EQ(body.islands, 1);
  EXPECT_NEAR(body.fraction, 0.2, 1e-15);
  const FineMesh<2> mesh(body.mesh);
  EXPECT_EQ(mesh.num_vertices(), 4);
  EXPECT_EQ(mesh.num_components(), 1);
  EXPECT_DOUBLE_EQ(mesh.volumes().sum(), 4.0);
  EXPECT_EQ(mesh.group("both").size(), 1u);
  EXPECT_EQ(mesh.region(0), 1);
  EXPECT_EQ(mesh.region(1), 0);
  EXPECT_EQ(keep_largest(body.mesh).islands, 0);
  data.cells(0, 0) = 9;
  EXPECT_INPUT_ERROR(keep_largest(data), "a cell names a vertex that there is not");
}

/// Squares (0, 0) and (1, 1) of 2 x 2 touch in the middle; its vertex is the last of the first group.
TEST(FineMesh, HingesAreCutAndGroupsFollow) {
  MeshData<2> data = grid(2);
  EXPECT_TRUE(cut_hinges(FineMesh<2>(data)).hinges.empty());
  data.cells = Cells<2>(data.cells(Eigen::all, std::vector<Index>{0, 1, 6, 7}));
  data.groups = {{"inner", {{1, 4}, {3, 4}, {4, 5}, {4, 7}}}};
  const FineMesh<2> hinged(data);
  ASSERT_EQ(hinged.num_components(), 1);
  const auto cut = cut_hinges(hinged);
  ASSERT_EQ(cut.hinges.size(), 1u);
  EXPECT_EQ(hinged.vertex(cut.hinges[0]), Vec<2>(0.5, 0.5));
  const FineMesh<2> mesh(cut.mesh);
  expect_consistent(mesh);
  EXPECT_EQ(mesh.num_components(), 2);
  EXPECT_EQ(mesh.num_vertices(), hinged.num_vertices() + 1);
  EXPECT_EQ(mesh.group("inner").size(), 4u);
  EXPECT_TRUE(cut_hinges(mesh).hinges.empty());
}

TEST(FineMesh, TetrahedraThatHangTogetherByAnEdgeAreParted) {
  MeshData<3> data{Points<3>(3, 6), Cells<3>(4, 2), {{"one", {{0, 1, 4}}}}};
  data.vertices << 0, 0, 1, 1, -1, -1, 0, 0, 0, 1, 0, -1, 0, 1, 0, 0, 0, 0;
  data.cells << 0, 0, 1, 1, 2, 4, 3, 5;
  const auto cut = cut_hinges(FineMesh<3>(data));
  EXPECT_EQ(cut.hinges.size(), 2u);
  const FineMesh<3> mesh(cut.mesh);
  EXPECT_EQ(mesh.num_components(), 2);
  EXPECT_EQ(mesh.num_vertices(), 8);
  EXPECT_EQ(mesh.facet_cell(mesh.group("one").front()), 1);
}

TEST(FineMesh, ExtractKeepsCellsWithTheirRegionsAndGroups) {
  MeshData<2> data = grid(2);
  data.regions = {0, 0, 1, 1, 1, 1, 0, 0};
  data.region_names = {"a", "b"};
  data.groups = {{"bottom", {{0, 1}, {1, 2}}}, {"top", {{6, 7}, {7, 8}}}};
  const FineMesh<2> mesh(extract(FineMesh<2>(data), {1, 1, 1, 1, 0, 0, 0, 0}));
  EXPECT_DOUBLE_EQ(mesh.volumes().sum(), 0.5);
  EXPECT_EQ(mesh.group("bottom").size(), 2u);
  EXPECT_EQ(mesh.groups().size(), 1u);
  EXPECT_EQ(mesh.region(0), 0);
  EXPECT_EQ(mesh.region(3), 1);
}

}  // namespace
}  // namespace efree
