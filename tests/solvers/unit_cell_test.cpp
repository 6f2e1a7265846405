// SPDX-License-Identifier: GPL-3.0-or-later
/// Effective tensors of unit cells that meshes fill, against closed forms and images.
#include "efree/solvers/algorithms/unit_cell.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/meshing/lattice_mesh.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/cells/effective.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>

namespace efree {
namespace {

using ::testing::ElementsAre, ::testing::HasSubstr, ::testing::ThrowsMessage;

double off(const Matrix& a, const Matrix& b) {
  return (a - b).cwiseAbs().maxCoeff() / b.cwiseAbs().maxCoeff();
}

template <int Dim> Matrix stiffness_of(const FineMesh<Dim>& mesh, const std::vector<SharedMaterial>& materials,
                                       FrameCondition frame = FrameCondition::periodic) {
  const auto elements = approximate(mesh, {.kind = BasisKind::p2, .dilatation = Dilatation::pointwise});
  return effective_stiffness<Dim>(elements, Materials<Dim>(materials, Plane::strain), frame).tensor;
}
template <int Dim> Matrix conductivity_of(const FineMesh<Dim>& mesh, const std::vector<double>& conductivities,
                                          FrameCondition frame = FrameCondition::periodic) {
  const auto elements = approximate(mesh, {.kind = BasisKind::p2, .dilatation = Dilatation::pointwise});
  return effective_conductivity<Dim>(elements, conductivities, frame).tensor;
}

using Region = std::function<int(const Vec<2>&)>;
using SolidRegion = std::function<int(const Vec<3>&)>;

template <int Dim>
FineMesh<Dim> with_regions(MeshData<Dim> data, const std::function<int(const Vec<Dim>&)>& region_at_centroid) {
  data.region_names = {"1", "2"};
  for (Index c = 0; c < data.cells.cols(); ++c) {
    Vec<Dim> x = Vec<Dim>::Zero();
    for (int i = 0; i <= Dim; ++i) x += data.vertices.col(data.cells(i, c)) / (Dim + 1);
    data.regions.push_back(region_at_centroid(x));
  }
  return FineMesh<Dim>(std::move(data));
}

/// The outline of the unit square, sides divided differently.
Polyline uneven_square() {
  return {"all", {{0, 0}, {0.37, 0}, {1, 0}, {1, 0.13}, {1, 0.31}, {1, 1}, {0.81, 1}, {0, 1}, {0, 0.77}, {0, 0}}};
}

/// The unit cube in n^3 cubes of six tetrahedra. Uneven: planes at multiples of a quarter stay, vertices between them
/// move along themselves, so that no opposite sides have the same mesh.
FineMesh<3> cube(Index n, bool is_uneven, const SolidRegion& region_at_centroid) {
  MeshData<3> data;
  const auto vertex = [n](const std::array<Index, 3>& at) { return at[0] + (n + 1) * (at[1] + (n + 1) * at[2]); };
  data.vertices.resize(3, (n + 1) * (n + 1) * (n + 1));
  std::vector<std::array<Index, 4>> cells;
  std::array<Index, 3> at;
  for (at[2] = 0; at[2] <= n; ++at[2])
    for (at[1] = 0; at[1] <= n; ++at[1])
      for (at[0] = 0; at[0] <= n; ++at[0]) {
        Vec<3> x = Vec<3>(at[0], at[1], at[2]) / n;
        if (is_uneven)
          for (int d = 0; d < 3; ++d)
            x[d] += 0.02 * std::sin(4.0 * std::numbers::pi * at[d] / n) *
                    (1.0 + static_cast<double>(at[(d + 1) % 3] - 2 * at[(d + 2) % 3]) / n);
        data.vertices.col(vertex(at)) = x;
        if (std::ranges::max(at) == n) continue;
        std::array<int, 3> order{0, 1, 2};
        do {
          std::array<Index, 3> corner = at;
          std::array<Index, 4> cell{vertex(corner)};
          for (int i = 0; i < 3; ++i) {
            ++corner[order[i]];
            cell[i + 1] = vertex(corner);
          }
          cells.push_back(cell);
        } while (std::ranges::next_permutation(order).found);
      }
  data.cells.resize(4, static_cast<Index>(cells.size()));
  for (std::size_t c = 0; c < cells.size(); ++c)
    for (int i = 0; i < 4; ++i) data.cells(i, static_cast<Index>(c)) = cells[c][i];
  return with_regions<3>(std::move(data), region_at_centroid);
}

/// A regular polygon around a hole, of the area of the disk of that radius.
std::vector<Vec<2>> polygon(const Vec<2>& centre, double radius, int corners, double from = 0.0,
                            double to = 2.0 * std::numbers::pi) {
  const double turn = 2.0 * std::numbers::pi / corners, outer = radius * std::sqrt(turn / std::sin(turn));
  std::vector<Vec<2>> points;
  const int steps = static_cast<int>(std::lround((to - from) / turn));
  for (int i = 0; i <= steps; ++i)
    points.emplace_back(centre + outer * Vec<2>(std::cos(from + i * turn), std::sin(from + i * turn)));
  return points;
}

/// Isotropic stiffness in Dim dimensions, of plane strain in the plane.
template <int Dim> Matrix isotropic(double E, double nu) {
  constexpr int strains = Dim * (Dim + 1) / 2;
  const double mu = 0.5 * E / (1.0 + nu), lambda = 2.0 * mu * nu / (1.0 - 2.0 * nu);
  Matrix C = Matrix::Zero(strains, strains);
  C.topLeftCorner(Dim, Dim).setConstant(lambda);
  for (int i = 0; i < strains; ++i) C(i, i) += i < Dim ? 2.0 * mu : mu;
  return C;
}

TEST(UnitCell, OfOneMaterialIsItsOwnOnSidesWithOtherMeshes) {
  const FineMesh<2> square = triangulate({.boundary = {uneven_square()}}, {.size = 0.15});
  const FineMesh<3> block = cube(8, true, [](const Vec<3>& x) { return x[0] < 0.5 ? 0 : 1; });
  for (const double nu : {0.0, 0.3, 0.499}) {
    const SharedMaterial material = LinearElastic(1.0, nu);
    EXPECT_LT(off(stiffness_of<2>(square, {material}), isotropic<2>(1.0, nu)), 1e-8) << nu;
    EXPECT_LT(off(stiffness_of<3>(block, {material, material}), isotropic<3>(1.0, nu)), 1e-8) << nu;
  }
  EXPECT_LT(off(conductivity_of<2>(square, {2.5}), 2.5 * Matrix::Identity(2, 2)), 1e-8);
  EXPECT_LT(off(conductivity_of<3>(block, {2.5, 2.5}), 2.5 * Matrix::Identity(3, 3)), 1e-8);
}

/// Plane layers of Backus (1962), half and half, whose normal is (1, 1): strains are constant in each.
TEST(UnitCell, OfInclinedLayersIsExactOnSidesWithOtherMeshes) {
  const FineMesh<2> mesh = with_regions<2>(
      triangulate_data({.boundary = {uneven_square()},
                        .embedded = {{"", {{0.5, 0}, {0, 0.5}}}, {"", {{1, 0}, {0, 1}}}, {"", {{1, 0.5}, {0.5, 1}}}}},
                       {.size = 0.12}),
      [](const Vec<2>& x) { return std::fmod(x[0] + x[1], 1.0) < 0.5 ? 0 : 1; });
  for (const auto& [E, nu] : {std::pair(1e-3, 0.2), std::pair(1.0, 0.499), std::pair(1000.0, 0.1)}) {
    const Matrix a = isotropic<2>(1.0, 0.3), b = isotropic<2>(E, nu);
    // In the axes (normal, along).
    const double M = 2.0 / (1.0 / a(0, 0) + 1.0 / b(0, 0)), ratio = 0.5 * (a(0, 1) / a(0, 0) + b(0, 1) / b(0, 0)),
                 along = 0.5 * (a(0, 0) - a(0, 1) * a(0, 1) / a(0, 0) + b(0, 0) - b(0, 1) * b(0, 1) / b(0, 0)) +
                         ratio * ratio * M,
                 shear = 2.0 / (1.0 / a(2, 2) + 1.0 / b(2, 2));
    const Matrix C = (Matrix(3, 3) << M, ratio * M, 0, ratio * M, along, 0, 0, 0, shear).finished();
    // Strains xx, yy, xy in these axes, which are turned by 45 degrees.
    const Matrix turn = (Matrix(3, 3) << 0.5, 0.5, 0.5, 0.5, 0.5, -0.5, -1, 1, 0).finished();
    EXPECT_LT(off(stiffness_of<2>(mesh, {LinearElastic(1.0, 0.3), LinearElastic(E, nu)}), turn.transpose() * C * turn),
              1e-8)
        << E;
    const double across = 2.0 / (1.0 + 1.0 / E), mean = 0.5 * (1.0 + E);
    EXPECT_LT(off(conductivity_of<2>(mesh, {1.0, E}),
                  (Matrix(2, 2) << across + mean, across - mean, across - mean, across + mean).finished() / 2.0),
              1e-8)
        << E;
  }
}

/// Layers that end at four sides of the frame.
TEST(UnitCell, OfLayersInSpaceIsExactOnSidesWithOtherMeshes) {
  const FineMesh<3> mesh = cube(8, true, [](const Vec<3>& x) { return x[1] < 0.25 ? 0 : 1; });
  const Matrix a = isotropic<3>(1.0, 0.3), b = isotropic<3>(1000.0, 0.2);
  const Matrix C = stiffness_of<3>(mesh, {LinearElastic(1.0, 0.3), LinearElastic(1000.0, 0.2)});
  EXPECT_NEAR(C(1, 1), 1.0 / (0.25 / a(1, 1) + 0.75 / b(1, 1)), 1e-8);
  EXPECT_NEAR(C(3, 3), 1.0 / (0.25 / a(3, 3) + 0.75 / b(3, 3)), 1e-8);
  EXPECT_NEAR(C(4, 4), 0.25 * a(4, 4) + 0.75 * b(4, 4), 1e-8);
  EXPECT_NEAR(conductivity_of<3>(mesh, {1.0, 1000.0})(1, 1), 1.0 / (0.25 + 0.75 / 1000.0), 1e-8);
}

/// On a lattice opposite sides have the same mesh. Layers of Backus (1962).
TEST(UnitCell, OfLayersIsExact) {
  for (int axis = 0; axis < 3; ++axis) {
    LabelImage<3> image;
    image.size = {4, 4, 4};
    for (int p = 0; p < 64; ++p)
      image.labels.push_back((axis == 0 ? p % 4 : axis == 1 ? p / 4 % 4 : p / 16) < 1 ? 1 : 2);
    const std::vector<SharedMaterial> by_label{{}, LinearElastic(10.0, 0.3), LinearElastic(1.37, 0.17)};
    const FineMesh<3> mesh(mesh_on_lattice(image, {.size = 1.0, .names = {{1, "1"}, {2, "2"}}}).mesh);
    // What marching tetrahedra make of the image has its interface at another place.
    double first = 0.0;
    for (Index c = 0; c < mesh.num_cells(); ++c)
      if (mesh.region_names()[mesh.region(c)] == "1") first += mesh.volume(c) / 64.0;
    const double M1 = 10.0 * 0.7 / (1.3 * 0.4), M2 = 1.37 * 0.83 / (1.17 * 0.66), mu1 = 10.0 / 2.6, mu2 = 1.37 / 2.34;
    std::vector<SharedMaterial> by_region;
    std::vector<double> conductivities;
    for (const std::string& name : mesh.region_names()) {
      by_region.push_back(by_label[std::stoi(name)]);
      conductivities.push_back(name == "1" ? 5.0 : 0.2);
    }
    const Matrix C = stiffness_of<3>(mesh, by_region), k = conductivity_of<3>(mesh, conductivities);
    const int shear_along = 3 + axis, shear_across = 3 + (axis + 1) % 3;
    EXPECT_NEAR(C(axis, axis), 1.0 / (first / M1 + (1.0 - first) / M2), 1e-8) << axis;
    EXPECT_NEAR(C(shear_along, shear_along), first * mu1 + (1.0 - first) * mu2, 1e-8) << axis;
    EXPECT_NEAR(C(shear_across, shear_across), 1.0 / (first / mu1 + (1.0 - first) / mu2), 1e-8) << axis;
    EXPECT_NEAR(k(axis, axis), 1.0 / (first / 5.0 + (1.0 - first) / 0.2), 1e-8) << axis;
  }
}

TEST(UnitCell, OfAPoreInSpaceIsThatOfItsImageAndBoundsAreInOrder) {
  constexpr Index n = 16;
  LabelImage<3> image;
  image.size = {n, n, n};
  for (Index k = 0; k < n; ++k)
    for (Index j = 0; j < n; ++j)
      for (Index i = 0; i < n; ++i)
        image.labels.push_back((Vec<3>(i + 0.5, j + 0.5, k + 0.5) - Vec<3>::Constant(8.0)).norm() < 5.0 ? 2 : 1);
  const std::vector<SharedMaterial> by_label{{}, LinearElastic(1.0, 0.3), LinearElastic(8.0, 0.2)};
  const FineMesh<3> mesh(mesh_on_lattice(image, {.size = 2.0, .names = {{1, "1"}, {2, "2"}}}).mesh);
  std::vector<SharedMaterial> by_region;
  for (const std::string& name : mesh.region_names()) by_region.push_back(by_label[std::stoi(name)]);
  const Matrix periodic = stiffness_of<3>(mesh, by_region), exact = effective_stiffness(image, by_label).extrapolated;
  EXPECT_LT(off(periodic, exact), 0.025) << "marching tetrahedra cut corners off the ball";
  const auto above = [](const Matrix& a, const Matrix& b) {
    return Eigen::SelfAdjointEigenSolver<Matrix>(a - b).eigenvalues()[0] / b.norm();
  };
  const Matrix kinematic = stiffness_of<3>(mesh, by_region, FrameCondition::kinematic),
               uniform = stiffness_of<3>(mesh, by_region, FrameCondition::uniform);
  EXPECT_GT(above(kinematic, periodic), -1e-7);
  EXPECT_GT(above(periodic, uniform), -1e-7);
  EXPECT_LT(off(kinematic, uniform), 0.2);
  EXPECT_GT(off(kinematic, uniform), 1e-3);
}

/// Disks of a square array in the middle of the unit cell, and quarters of them in its corners.
FineMesh<2> array_of_disks(double radius, bool is_cut, double size) {
  const std::vector<Vec<2>> middle = polygon({0.5, 0.5}, radius, 24);
  std::vector<Polyline> outlines{{"", middle}};
  const double pi = std::numbers::pi;
  if (is_cut)
    outlines = {{"", polygon({0, 0}, radius, 24, 0, 0.5 * pi)},
                {"", polygon({1, 0}, radius, 24, 0.5 * pi, pi)},
                {"", polygon({1, 1}, radius, 24, pi, 1.5 * pi)},
                {"", polygon({0, 1}, radius, 24, 1.5 * pi, 2.0 * pi)}};
  const auto is_inside = [=](const Vec<2>& x) {
    // Of the polygon: by the edge that is next.
    const Vec<2> from = is_cut ? Vec<2>(x - x.array().round().matrix()) : Vec<2>(x - Vec<2>(0.5, 0.5));
    const double turn = pi / 12.0, angle = std::fmod(std::atan2(from[1], from[0]) + 2.0 * pi, turn) - 0.5 * turn;
    return from.norm() * std::cos(angle) < radius * std::sqrt(turn / std::sin(turn)) * std::cos(0.5 * turn) ? 1 : 0;
  };
  return with_regions<2>(triangulate_data({.boundary = {uneven_square()}, .embedded = outlines}, {.size = size}),
                         is_inside);
}

/// The frame may lie anywhere. In the second cell disks, and the jumps of the moduli, are on all sides.
TEST(UnitCell, DoesNotDependOnWhereTheFrameCutsInclusions) {
  struct Case {
    double E, nu_matrix, nu_disk;
  };
  for (const auto& [E, nu_matrix, nu_disk] : {Case{10.0, 0.3, 0.2}, Case{1000.0, 0.2, 0.499}, Case{1e-3, 0.3, 0.2},
                                              Case{10.0, 0.499, 0.2}, Case{1e-3, 0.499, 0.499}}) {
    const std::vector<SharedMaterial> materials{LinearElastic(1.0, nu_matrix), LinearElastic(E, nu_disk)};
    const std::vector<double> conductivities{1.0, E};
    const Matrix fine = stiffness_of<2>(array_of_disks(0.3, false, 0.02), materials),
                 fine_k = conductivity_of<2>(array_of_disks(0.3, false, 0.02), conductivities);
    std::vector<double> cut, cut_k;
    for (const double size : {0.08, 0.04}) {
      const FineMesh<2> corners = array_of_disks(0.3, true, size), middle = array_of_disks(0.3, false, size);
      cut.push_back(off(stiffness_of<2>(corners, materials), fine));
      cut_k.push_back(off(conductivity_of<2>(corners, conductivities), fine_k));
      EXPECT_LT(cut.back(), 1.5 * off(stiffness_of<2>(middle, materials), fine)) << E << ' ' << size;
      EXPECT_LT(cut_k.back(), 1.5 * off(conductivity_of<2>(middle, conductivities), fine_k)) << E << ' ' << size;
    }
    EXPECT_LT(cut[0], 1e-3) << E;
    for (const auto& errors : {cut, cut_k}) {
      EXPECT_GT(errors[0], 2.0 * errors[1]) << E << ": corners of the polygons";
      EXPECT_LT(errors[0], 16.0 * errors[1]) << E;
    }
  }
}

/// Halves of holes on two opposite sides, whose outlines differ. Rayleigh's square array by Perrins, McKenzie &
/// McPhedran (1979).
TEST(UnitCell, OfHolesOnTheFrameIsThatOfTheArray) {
  const double r = 0.3, f = std::numbers::pi * r * r,
               exact = 1.0 - 2.0 * f /
                                 (1.0 + f - 0.305827 * std::pow(f, 4) / (1.0 - 1.402958 * std::pow(f, 8)) -
                                  0.013362 * std::pow(f, 8));
  const auto square_with = [&](int left, int right) {
    Polyline outline{"all", {{0, 0}, {1, 0}}};
    const double pi = std::numbers::pi;
    const auto add_reversed = [&](std::vector<Vec<2>> arc) {
      outline.points.insert(outline.points.end(), arc.rbegin(), arc.rend());
    };
    add_reversed(polygon({1, 0.5}, r, right, 0.5 * pi, 1.5 * pi));
    outline.points.insert(outline.points.end(), {{1, 1}, {0.4, 1}, {0, 1}});
    add_reversed(polygon({0, 0.5}, r, left, -0.5 * pi, 0.5 * pi));
    outline.points.emplace_back(0, 0);
    return outline;
  };
  const FineMesh<2> centred =
      triangulate({.boundary = {uneven_square(), {"hole", polygon({0.5, 0.5}, r, 200)}}}, {.size = 0.03});
  const Matrix C = stiffness_of<2>(centred, {LinearElastic(1.0, 0.3)});
  EXPECT_NEAR(conductivity_of<2>(centred, {1.0})(0, 0), exact, 1e-6);
  std::vector<double> errors, errors_k;
  for (const int corners : {24, 48}) {
    const FineMesh<2> mesh = triangulate({.boundary = {square_with(corners, corners + 10)}}, {.size = 0.03});
    const auto elements = approximate(mesh, {.kind = BasisKind::p2, .dilatation = Dilatation::pointwise});
    const UnitCellTensor k = effective_conductivity<2>(elements, {1.0}, FrameCondition::periodic);
    EXPECT_THAT(k.coupled_axes, ElementsAre(0, 1));
    EXPECT_GT(k.uncovered, 1e-4) << "polygons of other numbers of corners, with the same area";
    EXPECT_LT(k.uncovered, 5e-3);
    errors_k.push_back(off(k.tensor, exact * Matrix::Identity(2, 2)));
    errors.push_back(off(stiffness_of<2>(mesh, {LinearElastic(1.0, 0.3)}), C));
  }
  EXPECT_LT(errors_k[0], 2e-4);
  EXPECT_LT(errors[0], 4e-4);
  for (const auto& each : {errors, errors_k}) {
    EXPECT_GT(each[0], 4.0 * each[1]) << "polygons are of second order or better";
    EXPECT_LT(each[0], 20.0 * each[1]);
  }
}

/// A polygon in a round hole, and what is between them.
TEST(UnitCell, ChangeFromFacetsToTheTrueSurfaceIsThatOfFinerFacets) {
  constexpr double r = 0.3;
  const Vec<2> centre(0.5, 0.5);
  const auto with_corners = [&](int corners) {
    const double turn = 2.0 * std::numbers::pi / corners;
    return triangulate(
        {.boundary = {uneven_square(), {"hole", polygon(centre, r * std::sqrt(std::sin(turn) / turn), corners)}}},
        {.size = 0.03});
  };
  const FineMesh<2> coarse = with_corners(24), fine = with_corners(480);
  Vector shifts = Vector::Zero(coarse.num_facets());
  for (const Index f : coarse.group("hole")) {
    const Vec<2> a = coarse.vertex(coarse.facets()(0, f)) - centre, b = coarse.vertex(coarse.facets()(1, f)) - centre;
    shifts[f] = (a.norm() + b.norm() + 4.0 * (0.5 * (a + b)).norm()) / 6.0 - r;  // the hole grows
  }
  const auto elements = approximate(coarse, {.kind = BasisKind::p2, .dilatation = Dilatation::pointwise});
  const std::vector<SharedMaterial> material{LinearElastic(1.0, 0.3)};
  // Bodies with a frame that can bear tractions.
  for (const FrameCondition frame : {FrameCondition::periodic, FrameCondition::kinematic, FrameCondition::uniform}) {
    const UnitCellTensor C = effective_stiffness<2>(elements, Materials<2>(material, Plane::strain), frame, shifts),
                         k = effective_conductivity<2>(elements, {2.5}, frame, shifts);
    EXPECT_LT(off(C.facet_change, stiffness_of<2>(fine, material, frame) - C.tensor), 0.06);
    EXPECT_LT(off(k.facet_change, conductivity_of<2>(fine, {2.5}, frame) - k.tensor), 0.06);
  }
}

/// Cubes of another material around the corners of the frame.
TEST(UnitCell, OfCubesOnSidesWithOtherMeshesIsAsExactAsOnMatchingOnes) {
  const auto corners = [](const Vec<3>& x) { return ((x.array() - 0.5).abs() > 0.25).all() ? 1 : 0; };
  const FineMesh<3> fine = cube(12, false, corners), even = cube(8, false, corners), uneven = cube(8, true, corners);
  const std::vector<SharedMaterial> materials{LinearElastic(1.0, 0.3), LinearElastic(1000.0, 0.499)};
  const Matrix C = stiffness_of<3>(fine, materials);
  EXPECT_LT(off(stiffness_of<3>(uneven, materials), C), 1.2 * off(stiffness_of<3>(even, materials), C));
  for (const double k : {1000.0, 1e-3}) {
    const Matrix exact = conductivity_of<3>(fine, {1.0, k});
    EXPECT_LT(off(conductivity_of<3>(uneven, {1.0, k}), exact), 1.2 * off(conductivity_of<3>(even, {1.0, k}), exact))
        << k;
  }
}

TEST(UnitCell, WithCoupledSidesIsBitwiseTheSameOnAnyNumberOfThreads) {
  const FineMesh<2> mesh = array_of_disks(0.3, true, 0.05);
  const std::vector<SharedMaterial> materials{LinearElastic(1.0, 0.3), LinearElastic(10.0, 0.2)};
  const int threads = num_threads();
  set_num_threads(1);
  const Matrix alone = stiffness_of<2>(mesh, materials);
  set_num_threads(3);
  const Matrix together = stiffness_of<2>(mesh, materials);
  set_num_threads(threads);
  EXPECT_EQ(alone, together);
}

/// Facets on both sides across x, none of which has another one opposite: columns that do not touch.
TEST(UnitCell, OfSidesWhoseFacetsHaveVoidOppositeHasNoStiffnessAcrossThem) {
  const FineMesh<2> mesh = triangulate(
      {.boundary = {{"all", {{0, 0}, {1, 0}, {0.6, 0.35}, {1, 0.7}, {1, 1}, {0, 1}, {0.4, 0.65}, {0, 0.3}, {0, 0}}}}},
      {.size = 0.1});
  const auto elements = approximate(mesh, {.kind = BasisKind::p2, .dilatation = Dilatation::pointwise});
  const UnitCellTensor C = effective_stiffness<2>(elements, Materials<2>({LinearElastic(1.0, 0.3)}, Plane::strain),
                                                  FrameCondition::periodic);
  EXPECT_DOUBLE_EQ(C.uncovered, 1.0);
  EXPECT_LT(C.tensor.row(0).cwiseAbs().maxCoeff(), 1e-8);
  EXPECT_GT(C.tensor(1, 1), 0.1);
  const Matrix k = conductivity_of<2>(mesh, {1.0});
  EXPECT_LT(k.row(0).cwiseAbs().maxCoeff(), 1e-8);
  EXPECT_GT(k(1, 1), 0.1);
}

TEST(UnitCell, RefusesSidesThatNothingLiesOn) {
  const std::vector<SharedMaterial> material{LinearElastic(1.0, 0.3)};
  const FineMesh<2> mesh = triangulate({.boundary = {uneven_square()}}, {.size = 0.15});
  // One material: its own tensor under all conditions.
  for (const FrameCondition frame : {FrameCondition::kinematic, FrameCondition::uniform}) {
    EXPECT_LT(off(stiffness_of<2>(mesh, material, frame), isotropic<2>(1.0, 0.3)), 1e-9);
    EXPECT_LT(off(conductivity_of<2>(mesh, {2.5}, frame), 2.5 * Matrix::Identity(2, 2)), 1e-9);
  }
  const FineMesh<2> notched = triangulate(
      {.boundary = {{"all", {{0, 0}, {1, 0}, {1, 1}, {0, 1}, {0, 0.7}, {0.3, 0.5}, {0, 0.3}, {0, 0}}}}}, {.size = 0.1});
  EXPECT_THAT([&] { stiffness_of<2>(notched, material, FrameCondition::uniform); },
              ThrowsMessage<InputError>(HasSubstr("void reaches the frame")));
  const FineMesh<2> leaning =
      triangulate({.boundary = {{"all", {{0, 0}, {1, 0.01}, {1, 1}, {0, 1}, {0, 0}}}}}, {.size = 0.2});
  for (const FrameCondition frame : {FrameCondition::periodic, FrameCondition::kinematic, FrameCondition::uniform})
    EXPECT_THAT(
        [&] { stiffness_of<2>(leaning, material, frame); },
        ThrowsMessage<InputError>(HasSubstr("no facet of the unit cell lies on the lower end of its frame along y")));
}

}  // namespace
}  // namespace efree
