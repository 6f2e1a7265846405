// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/lattice_mesh.hpp"
#include "efree/bench/noise.hpp"
#include "efree/core/parallel.hpp"
#include "image_meshes.hpp"
#include "meshes.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>

namespace efree {
namespace {

using bench::noise;
using std::numbers::pi;
using test::flattest;
using test::side_area;
using test::volume;

/// label(centre of the voxel) for all voxels.
LabelImage<3> image_of(const std::array<Index, 3>& size, const std::function<int(const Vec<3>&)>& label) {
  LabelImage<3> image{.size = size};
  for (Index k = 0; k < size[2]; ++k)
    for (Index j = 0; j < size[1]; ++j)
      for (Index i = 0; i < size[0]; ++i)
        image.labels.push_back(static_cast<Label>(label(Vec<3>(i + 0.5, j + 0.5, k + 0.5))));
  return image;
}

/// With grey values: solid where `value` is positive.
LabelImage<3> grey_image_of(const std::array<Index, 3>& size, const std::function<double(const Vec<3>&)>& value) {
  LabelImage<3> image = image_of(size, [&](const Vec<3>& x) { return value(x) > 0.0; });
  image_of(size, [&](const Vec<3>& x) {
    const auto grey = static_cast<float>(value(x));
    image.grey.push_back(value(x) > 0.0 ? std::max(grey, 1e-30f) : std::min(grey, -1e-30f));
    return 0;
  });
  return image;
}

double pores(const FineMesh<3>& mesh) {
  return side_area(mesh, "pores");
}

TEST(LatticeMesh, ABlockIsABlock) {
  LabelImage<3> image{.size = {6, 4, 5}, .spacing = {0.5, 1.0, 0.25}, .origin = {1.0, -2.0, 3.0}};
  image.labels.assign(120, 7);
  const LatticeMesh made = mesh_on_lattice(image, {.size = 0.8});
  const FineMesh<3> mesh(made.mesh);
  test::expect_consistent(mesh, image);
  EXPECT_NEAR(mesh.volumes().sum(), 15.0, 1e-12 * 15.0);
  EXPECT_NEAR(side_area(mesh, "left"), 5.0, 1e-12);
  EXPECT_NEAR(side_area(mesh, "back"), 3.75, 1e-12);
  EXPECT_NEAR(side_area(mesh, "top"), 12.0, 1e-12);
  EXPECT_EQ(mesh.groups().size(), 6u);
  EXPECT_EQ(mesh.region_names(), std::vector<std::string>{"7"});
  // 3.75 cubes along x are 4, 5 along y, 1.56 along z are 2.
  EXPECT_EQ(made.lattice.cubes, (std::array<Index, 3>{4, 5, 2}));
  EXPECT_EQ(mesh.num_cells(), 4 * 5 * 2 * 6);
  EXPECT_EQ(made.lost.parts + made.lost.pieces + made.lost.broken_off, 0);
}

TEST(LatticeMesh, KnowsWhereItsCellsAndVerticesAreInTheLattice) {
  const auto image = random_spheres<3>(24, {.porosity = 0.3, .r_min = 3.0, .r_max = 6.0, .seed = 4});
  const LatticeMesh made = mesh_on_lattice(image, {.size = 2.0});
  const auto& [origin, spacing, cubes] = made.lattice;
  Index at_points = 0;
  for (Index v = 0; v < made.mesh.vertices.cols(); ++v) {
    const Index point = made.point_of_vertex[v];
    if (point < 0) continue;
    ++at_points;
    const Vec<3> at(point % (cubes[0] + 1), point / (cubes[0] + 1) % (cubes[1] + 1),
                    point / ((cubes[0] + 1) * (cubes[1] + 1)));
    EXPECT_EQ(Vec<3>(made.mesh.vertices.col(v)), origin + spacing.cwiseProduct(at));
  }
  EXPECT_GT(at_points, 1000);
  EXPECT_TRUE(std::is_sorted(made.cube_of_cell.begin(), made.cube_of_cell.end()));
  double farthest = 0.0;  // vertices move by less than half an edge
  for (Index c = 0; c < made.mesh.cells.cols(); ++c) {
    const Index cube = made.cube_of_cell[c];
    const Vec<3> centre(cube % cubes[0] + 0.5, cube / cubes[0] % cubes[1] + 0.5, cube / (cubes[0] * cubes[1]) + 0.5);
    for (int i = 0; i < 4; ++i)
      farthest =
          std::max(farthest, ((made.mesh.vertices.col(made.mesh.cells(i, c)) - origin).cwiseQuotient(spacing) - centre)
                                 .cwiseAbs()
                                 .maxCoeff());
  }
  EXPECT_LT(farthest, 1.0);
}

TEST(LatticeMesh, GreyBallsConvergeWithSecondOrder) {
  const double radius = 50.3;
  const Vec<3> centre(63.6, 64.3, 64.1);
  const auto image = grey_image_of({128, 128, 128}, [&](const Vec<3>& x) { return radius - (x - centre).norm(); });
  std::vector<double> volumes, areas;
  for (const double size : {16.0, 8.0, 4.0}) {
    const FineMesh<3> mesh(mesh_image(image, {.size = size}));
    test::expect_consistent(mesh, image);
    EXPECT_EQ(mesh.num_components(), 1);
    volumes.push_back(std::abs(mesh.volumes().sum() / (4.0 / 3.0 * pi * std::pow(radius, 3)) - 1.0));
    areas.push_back(std::abs(pores(mesh) / (4.0 * pi * radius * radius) - 1.0));
    double off = 0.0;  // trilinear interpolation of the distance is off by 1 / (4 radius) at most
    for (Index f = 0; f < mesh.num_facets(); ++f)
      for (int k = 0; k < 3; ++k)
        off = std::max(off, std::abs((mesh.vertex(mesh.facets()(k, f)) - centre).norm() - radius));
    EXPECT_LT(off, 0.01) << size;
  }
  EXPECT_LT(volumes[0], 0.05);
  for (int n = 0; n < 2; ++n) {
    EXPECT_GT(std::log2(volumes[n] / volumes[n + 1]), 1.75) << n;
    EXPECT_LT(std::log2(volumes[n] / volumes[n + 1]), 2.4) << n;
    EXPECT_GT(std::log2(areas[n] / areas[n + 1]), 1.6) << n;
    EXPECT_LT(std::log2(areas[n] / areas[n + 1]), 2.6) << n;
  }
}

TEST(LatticeMesh, ACylinderThroughTheFrameHasItsVolumeMantleAndEnds) {
  const double radius = 20.2;
  const auto image =
      grey_image_of({48, 48, 24}, [&](const Vec<3>& x) { return radius - (x - Vec<3>(24.3, 23.6, x.z())).norm(); });
  std::vector<double> errors;
  for (const double size : {6.0, 3.0}) {
    const FineMesh<3> mesh(mesh_image(image, {.size = size}));
    test::expect_consistent(mesh, image);
    errors.push_back(std::abs(mesh.volumes().sum() / (pi * radius * radius * 24.0) - 1.0));
    EXPECT_NEAR(pores(mesh), 2.0 * pi * radius * 24.0, 0.02 * 2.0 * pi * radius * 24.0);
    EXPECT_NEAR(side_area(mesh, "top"), side_area(mesh, "bottom"), 0.01 * pi * radius * radius);
    EXPECT_NEAR(side_area(mesh, "top"), pi * radius * radius, 0.02 * pi * radius * radius);
    EXPECT_EQ(mesh.groups().size(), 3u);
  }
  EXPECT_GT(std::log2(errors[0] / errors[1]), 1.6);
  EXPECT_LT(std::log2(errors[0] / errors[1]), 2.4);
}

TEST(LatticeMesh, ABallOfVoxelsKeepsItsVolumeWithinAVoxelOfItsSurface) {
  const double radius = 16.2;
  const Vec<3> centre(20.1, 19.8, 20.3);
  const auto image = image_of({40, 40, 40}, [&](const Vec<3>& x) { return (x - centre).norm() < radius; });
  for (const double size : {1.0, 1.7, 2.0, 3.0}) {
    const FineMesh<3> mesh(mesh_image(image, {.size = size}));
    test::expect_consistent(mesh, image);
    EXPECT_EQ(mesh.num_components(), 1);
    const double ball = 4.0 / 3.0 * pi * std::pow(radius, 3);
    EXPECT_NEAR(mesh.volumes().sum(), ball, 0.015 * ball) << size;
    double off = 0.0;
    for (Index f = 0; f < mesh.num_facets(); ++f)
      for (int k = 0; k < 3; ++k)
        off = std::max(off, std::abs((mesh.vertex(mesh.facets()(k, f)) - centre).norm() - radius));
    EXPECT_LT(off, 1.0) << size;
  }
}

TEST(LatticeMesh, LabelsThatMeetInEdgesAndPointsConform) {
  // Three sectors and a ball in the middle of them, above a layer of two halves: no void.
  const Vec<3> centre(10.2, 9.7, 11.1);
  const auto image = image_of({20, 20, 20}, [&](const Vec<3>& x) {
    if (x.z() < 4.0) return x.y() < 9.0 ? 5 : 6;
    if ((x - centre).norm() < 5.0) return 4;
    const double angle = std::atan2(x.y() - centre.y(), x.x() - centre.x());
    return angle < -pi / 3.0 ? 1 : angle < pi / 3.0 ? 2 : 3;
  });
  const auto counts = count_labels(image);
  for (const double size : {1.0, 1.6, 2.5}) {
    const LatticeMesh made = mesh_on_lattice(image, {.size = size});
    EXPECT_GT(flattest(made.mesh), 3e-4) << size;
    const FineMesh<3> mesh(made.mesh);
    test::expect_consistent(mesh, image);
    EXPECT_NEAR(mesh.volumes().sum(), 8000.0, 1e-8);
    EXPECT_EQ(mesh.num_components(), 1);
    EXPECT_EQ(mesh.groups().size(), 6u);  // no pores
    double interface = 0.0;
    for (Index c = 0; c < mesh.num_cells(); ++c)
      for (Index i = 0; i < 4; ++i)
        if (const Index other = mesh.neighbour(i, c); other > c && mesh.region(c) != mesh.region(other)) {
          const Vec<3> a = mesh.vertex(mesh.cells()((i + 1) % 4, c)), b = mesh.vertex(mesh.cells()((i + 2) % 4, c)),
                       d = mesh.vertex(mesh.cells()((i + 3) % 4, c));
          interface += 0.5 * (b - a).cross(d - a).norm();
        }
    const FineMesh<3> cut(cut_regions(made.mesh));
    EXPECT_GE(cut.num_components(), 6);
    double tied = 0.0;
    for (const auto& [first, second] : tied_facets(cut)) {
      EXPECT_NE(cut.region(cut.facet_cell(first)), cut.region(cut.facet_cell(second)));
      tied += cut.facet_measure(first);
    }
    EXPECT_NEAR(tied, interface, 1e-9 * interface);
    for (Index r = 0; r < 6; ++r) {
      const double voxels = static_cast<double>(counts[r].pixels);
      EXPECT_NEAR(volume(mesh, r), voxels, 0.05 * voxels) << size << ", " << mesh.region_names()[r];
    }
  }
}

TEST(LatticeMesh, LabelsOfOneNameAreOneRegionAndVoidMayTouchThreeOfThem) {
  const auto image = image_of({16, 16, 16}, [](const Vec<3>& x) {
    const int octant = (x.x() > 8.0) + 2 * (x.y() > 8.0) + 4 * (x.z() > 8.0);
    return octant == 7 ? 0 : octant < 4 ? 1 + octant : 1;
  });
  const LatticeMesh made = mesh_on_lattice(image, {.size = 1.9, .names = {{1, "a"}, {2, "b"}, {3, "c"}, {4, "a"}}});
  EXPECT_GT(flattest(made.mesh), 3e-4);
  const FineMesh<3> mesh(made.mesh);
  test::expect_consistent(mesh, image);
  EXPECT_EQ(mesh.region_names(), (std::vector<std::string>{"a", "b", "c"}));
  EXPECT_NEAR(mesh.volumes().sum(), 7.0 * 512.0, 0.01 * 7.0 * 512.0);
  // Edges of voxels are cut off by the lattice.
  EXPECT_NEAR(volume(mesh, 1), 512.0, 0.06 * 512.0);
  EXPECT_NEAR(pores(mesh), 3.0 * 64.0, 0.08 * 3.0 * 64.0);
  EXPECT_EQ(mesh.num_components(), 1);
}

TEST(LatticeMesh, AGyroidSheetStaysOneBodyOfItsVolume) {
  // Walls of 2.4 to 3.4 voxels.
  const auto image = image_of({96, 96, 96}, [](const Vec<3>& at) {
    const Vec<3> x = 2.0 * pi / 32.0 * at;
    return std::abs(std::sin(x[0]) * std::cos(x[1]) + std::sin(x[1]) * std::cos(x[2]) +
                    std::sin(x[2]) * std::cos(x[0])) < 0.4;
  });
  const double solid = static_cast<double>(count_labels(image).back().pixels);
  for (const auto& [size, tolerance] : {std::pair{1.0, 0.01}, {2.0, 0.02}, {3.0, 0.04}}) {
    const LatticeMesh made = mesh_on_lattice(image, {.size = size});
    EXPECT_GT(flattest(made.mesh), 1e-3) << size;
    const FineMesh<3> mesh(made.mesh);
    test::expect_consistent(mesh, image);
    EXPECT_NEAR(mesh.volumes().sum(), solid, tolerance * solid) << size;
    std::vector<double> bodies(mesh.num_components(), 0.0);
    for (Index c = 0; c < mesh.num_cells(); ++c) bodies[mesh.component()[mesh.cells()(0, c)]] += mesh.volume(c);
    EXPECT_GT(*std::ranges::max_element(bodies), 0.9997 * mesh.volumes().sum()) << size;
    EXPECT_EQ(made.lost.parts + made.lost.pieces, 0) << size;
    // The image itself has two specks apart from the sheet, in corners of the frame.
    EXPECT_EQ(made.lost.broken_off, mesh.num_components() - 3) << size;
  }
}

TEST(LatticeMesh, WallsOfOneVoxelStayWhereverTheLatticeIs) {
  for (Index at = 3; at < 9; ++at)
    for (const double size : {1.0, 1.2, 2.0}) {
      const auto wall = image_of({12, 12, 12}, [&](const Vec<3>& x) { return std::floor(x.z()) == at; });
      const LatticeMesh made = mesh_on_lattice(wall, {.size = size});
      if (made.lost.parts > 0) continue;  // 1.2: it lies between two planes of points
      const FineMesh<3> mesh(made.mesh);
      test::expect_consistent(mesh, wall);
      EXPECT_EQ(mesh.num_components(), 1) << at << ", " << size;
      EXPECT_NEAR(mesh.volumes().sum(), 144.0, size == 1.0 ? 1e-3 * 144.0 : 0.4 * 144.0) << at << ", " << size;
      // Pores as thin as that stay open.
      LabelImage<3> gap = wall;
      for (Label& label : gap.labels) label = label == 0;
      const FineMesh<3> halves(mesh_image(gap, {.size = size}));
      EXPECT_EQ(halves.num_components(), 2) << at << ", " << size;
    }
}

TEST(LatticeMesh, SaysWhatItLosesAndWhere) {
  // A plate of one voxel halfway between planes of points, and a bar whose neck is.
  auto image = image_of({24, 24, 24}, [](const Vec<3>& x) {
    const bool plate = std::floor(x.z()) == 18 && std::abs(x.x() - 12.0) < 6.0 && std::abs(x.y() - 12.0) < 6.0;
    const bool bar = std::abs(x.y() - 12.0) < 4.0 && std::abs(x.z() - 6.0) < 4.0;
    const bool neck = std::floor(x.y()) == 9 && std::floor(x.z()) == 5;
    return plate ? 2 : bar && (x.x() < 6.0 || x.x() > 18.0 || neck) ? 1 : 0;
  });
  image.spacing.setConstant(0.5);
  ASSERT_EQ(connected_pixels(image).parts.size(), 3u);
  const LatticeMesh made = mesh_on_lattice(image, {.size = 2.0, .names = {{1, "bar"}, {2, "plate"}}});
  EXPECT_EQ(made.lost.parts, 1);
  EXPECT_EQ(made.lost.pieces, 1);
  EXPECT_NEAR(made.lost.volume, (144.0 + 8.0) / 8.0, 1e-12);
  EXPECT_NEAR(made.lost.worst_volume, 144.0 / 8.0, 1e-12);
  EXPECT_TRUE(made.lost.worst_is_part);
  EXPECT_EQ(made.lost.worst_region, "plate");
  EXPECT_NEAR((made.lost.worst_place - Vec<3>(6.0, 6.0, 9.25)).norm(), 0.0, 0.5);
  EXPECT_EQ(made.lost.broken_off, 1);
  EXPECT_NEAR(made.lost.broken_volume, 384.0 / 8.0, 0.2 * 384.0 / 8.0);  // its edges are cut off
  const double x = made.lost.broken_place.x();
  EXPECT_NEAR(std::min(x, 12.0 - x), 1.5, 0.2);
  EXPECT_NEAR((made.lost.broken_place - Vec<3>(x, 6.0, 3.0)).norm(), 0.0, 0.2);
}

TEST(LatticeMesh, BodiesThatTouchInAnEdgeOrACornerOnlyAreApart) {
  for (const bool corner : {false, true})
    for (const double size : {1.0, 2.0, 3.0}) {
      const auto image = image_of({12, 12, 12}, [&](const Vec<3>& x) {
        const bool low = x.x() < 6.0, left = x.y() < 6.0, front = x.z() < 6.0;
        return corner ? low == left && left == front : low == left;
      });
      const FineMesh<3> mesh(mesh_image(image, {.size = size}));
      test::expect_consistent(mesh, image);
      EXPECT_EQ(mesh.num_components(), 2) << corner << ", " << size;
      EXPECT_NEAR(mesh.volumes().sum(), corner ? 432.0 : 864.0, 0.03 * 864.0) << corner << ", " << size;
    }
}

TEST(LatticeMesh, FrameFacetsAreThoseOfTheVoxels) {
  const auto image = image_of({12, 8, 8}, [](const Vec<3>& x) { return x.x() < 6.0 && x.y() > 4.0; });
  for (const double size : {1.0, 2.0}) {
    const FineMesh<3> mesh(mesh_image(image, {.size = size}));
    test::expect_consistent(mesh, image);
    EXPECT_NEAR(side_area(mesh, "left"), 32.0, 1e-12);
    EXPECT_NEAR(side_area(mesh, "back"), 48.0, 1e-12);
    // The edge along z is cut off: by half of a cube's face.
    EXPECT_NEAR(side_area(mesh, "top"), 24.0 - 0.5 * size * size, 1e-12);
    EXPECT_NEAR(side_area(mesh, "bottom"), 24.0 - 0.5 * size * size, 1e-12);
    EXPECT_NEAR(pores(mesh), (6.0 + 4.0 - (2.0 - std::sqrt(2.0)) * size) * 8.0, 1e-12);
    EXPECT_EQ(mesh.groups().size(), 5u);
  }
}

TEST(LatticeMesh, FiftyImagesOfNoiseAreMeshedWithoutFlatCells) {
  for (int n = 0; n < 51; ++n) {
    const double sizes[] = {1.0, 1.4, 2.0, 2.7};
    const auto image = noise(n % 3, 0.2 + 0.7 * (n / 3) / 16.0, static_cast<unsigned>(n));
    const MeshData<3> made = mesh_image(image, {.size = sizes[n % 4]});
    EXPECT_GT(flattest(made), 5e-4) << n;
    const FineMesh<3> mesh(made);  // refuses facets of more than two cells
    test::expect_consistent(mesh, image);
    std::size_t named = 0;
    for (const auto& group : made.groups) named += group.facets.size();
    EXPECT_EQ(named, static_cast<std::size_t>(mesh.num_facets())) << n;
  }
}

/// Whether the cells around every vertex hang together through facets.
bool has_no_hinges(const FineMesh<3>& mesh) {
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    const auto star = mesh.cells_of(v);
    std::vector<char> seen(star.size(), 0);
    std::vector<Index> stack{star[0]};
    seen[0] = 1;
    while (!stack.empty()) {
      const Index c = stack.back();
      stack.pop_back();
      for (Index i = 0; i < 4; ++i) {
        const Index next = mesh.neighbour(i, c);
        if (mesh.cells()(i, c) == v || next < 0) continue;
        char& there = seen[std::ranges::lower_bound(star, next) - star.begin()];
        if (there) continue;
        there = 1;
        stack.push_back(next);
      }
    }
    if (std::ranges::count(seen, 0) > 0) return false;
  }
  return true;
}

TEST(LatticeMesh, NoVertexIsAHinge) {
  for (int n = 0; n < 6; ++n)
    EXPECT_TRUE(has_no_hinges(FineMesh<3>(mesh_image(noise(n % 3, 0.5, 7), {.size = n < 3 ? 1.0 : 1.7})))) << n;
}

TEST(LatticeMesh, NoiseOfFourLabelsConforms) {
  LabelImage<3> image = noise(0, 0.5, 3);
  std::mt19937 generator(5);
  for (Label& label : image.labels) label = static_cast<Label>(generator() % 4);
  for (const double size : {1.0, 1.7}) {
    const MeshData<3> made = mesh_image(image, {.size = size});
    EXPECT_GT(flattest(made), 3e-4) << size;
    const FineMesh<3> mesh(made);
    test::expect_consistent(mesh, image);
    EXPECT_TRUE(has_no_hinges(mesh));
  }
}

TEST(LatticeMesh, IsTheSameOnAnyNumberOfThreads) {
  const int before = num_threads();
  const auto grey = noise(2, 0.5, 11);
  auto labels = noise(0, 0.5, 12);
  for (std::size_t p = 0; p < labels.labels.size(); p += 3) labels.labels[p] *= 2;
  for (const auto& image : {grey, labels}) {
    set_num_threads(1);
    const LatticeMesh one = mesh_on_lattice(image, {.size = 1.3});
    const FineMesh<3> mesh_of_one(one.mesh);
    for (const int threads : {2, 3}) {
      set_num_threads(threads);
      const LatticeMesh more = mesh_on_lattice(image, {.size = 1.3});
      EXPECT_EQ(more.mesh.vertices, one.mesh.vertices);
      EXPECT_EQ(more.mesh.cells, one.mesh.cells);
      EXPECT_EQ(more.mesh.regions, one.mesh.regions);
      for (std::size_t g = 0; g < one.mesh.groups.size(); ++g)
        EXPECT_EQ(more.mesh.groups[g].facets, one.mesh.groups[g].facets);
      EXPECT_EQ(more.lost.worst_place, one.lost.worst_place);
      const FineMesh<3> mesh(more.mesh);
      EXPECT_EQ(mesh.facets(), mesh_of_one.facets());
      EXPECT_EQ(mesh.component(), mesh_of_one.component());
    }
  }
  set_num_threads(before);
}

TEST(LatticeMesh, RefusesWhatCannotBeMeshed) {
  auto image = image_of({8, 8, 8}, [](const Vec<3>& x) { return x.x() < 4.0 ? 1 : 2; });
  EXPECT_INPUT_ERROR(mesh_image(image, {}), "size is 0, expected a positive length");
  EXPECT_INPUT_ERROR(mesh_image(image, {.size = 1e-3}), "GiB are available; take a larger size");
  EXPECT_INPUT_ERROR(mesh_image(image, {.size = 1.0, .names = {{1, "matrix"}}}), "label 2 has no region");
  image.grey.assign(511, 1.0f);
  EXPECT_INPUT_ERROR(mesh_image(image, {.size = 1.0}), "511 grey values for 8 x 8 x 8 pixels");
  image.grey.assign(512, 1.0f);
  EXPECT_INPUT_ERROR(mesh_image(image, {.size = 1.0}), "grey values of an image with 2 regions");
  for (Label& label : image.labels) label = 1;
  image.grey[7] = -0.5f;
  EXPECT_INPUT_ERROR(mesh_image(image, {.size = 1.0}),
                     "pixel 7 has the label 1 and the grey value -0.5, expected a positive one");
  image.grey.clear();
  for (Label& label : image.labels) label = 0;
  EXPECT_INPUT_ERROR(mesh_image(image, {.size = 1.0}), "all of it is void");
  image.labels[image.index({3, 3, 3})] = 1;
  EXPECT_THROW(mesh_image(image, {.size = 8.0}), NumericalError);
}

TEST(LabelImage, GreyValuesStayWithTheLargestBody) {
  auto image = grey_image_of({20, 8, 8}, [](const Vec<3>& x) {
    return std::max(3.2 - (x - Vec<3>(5, 4, 4)).norm(), 2.3 - (x - Vec<3>(14, 4, 4)).norm());
  });
  const auto kept = keep_largest(image);
  EXPECT_EQ(kept.islands, 1);
  check_image(kept.image);
  const FineMesh<3> mesh(mesh_image(kept.image, {.size = 0.5}));
  EXPECT_EQ(mesh.num_components(), 1);
  // The same as a ball without an island, but for what the island's voxels change where it is near: nothing.
  const auto ball = grey_image_of({20, 8, 8}, [](const Vec<3>& x) { return 3.2 - (x - Vec<3>(5, 4, 4)).norm(); });
  EXPECT_NEAR(mesh.volumes().sum(), FineMesh<3>(mesh_image(ball, {.size = 0.5})).volumes().sum(), 1e-9);
}

}  // namespace
}  // namespace efree
