// SPDX-License-Identifier: GPL-3.0-or-later
/// Effective tensors of unit cells that meshes fill, against closed forms and images.
#include "efree/solvers/algorithms/unit_cell.hpp"
#include "efree/core/error.hpp"
#include "efree/geometry/meshing/lattice_mesh.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/cells/effective.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <numbers>

namespace efree {
namespace {

using ::testing::HasSubstr, ::testing::ThrowsMessage;

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

/// A unit square whose right and upper sides have vertices where the others have none, cut at x = 0.37 into two
/// regions.
FineMesh<2> layers(double size) {
  PlanarDomain square{
      .boundary = {{"all",
                    {{0, 0}, {1, 0}, {1, 0.13}, {1, 0.31}, {1, 0.77}, {1, 1}, {0.71, 1}, {0.2, 1}, {0, 1}, {0, 0}}}},
      .embedded = {{"", {{0.37, 0}, {0.37, 1}}}}};
  MeshData<2> data = triangulate_data(square, {.size = size});
  for (Index c = 0; c < data.cells.cols(); ++c) {
    double x = 0.0;
    for (int i = 0; i < 3; ++i) x += data.vertices(0, data.cells(i, c)) / 3.0;
    data.regions.push_back(x < 0.37 ? 0 : 1);
  }
  data.region_names = {"one", "other"};
  return FineMesh<2>(std::move(data));
}

/// Of layers across x in plane strain (Backus 1962). Functions of the two sides are the same at points only, which is
/// an error of its own where sides have other meshes.
TEST(UnitCell, OfLayersConvergesWhereSidesHaveOtherMeshes) {
  const std::array<double, 2> f{0.37, 0.63}, E{10.0, 1.0}, nu{0.3, 0.2};
  const auto mean = [&](const auto& of) {
    double sum = 0.0;
    for (int k = 0; k < 2; ++k) {
      const double lambda = E[k] * nu[k] / ((1.0 + nu[k]) * (1.0 - 2.0 * nu[k])), mu = E[k] / (2.0 * (1.0 + nu[k]));
      sum += f[k] * of(lambda, mu);
    }
    return sum;
  };
  const double across = 1.0 / mean([](double l, double m) { return 1.0 / (l + 2.0 * m); }),
               share = mean([](double l, double m) { return l / (l + 2.0 * m); }),
               shear = 1.0 / mean([](double, double m) { return 1.0 / m; }),
               along = mean([](double l, double m) { return l + 2.0 * m - l * l / (l + 2.0 * m); }) +
                       share * share * across;
  Matrix exact = Matrix::Zero(3, 3);
  exact << across, share * across, 0.0, share * across, along, 0.0, 0.0, 0.0, shear;
  Matrix conducts = Matrix::Zero(2, 2);
  conducts.diagonal() << 1.0 / (0.37 / 3.0 + 0.63 / 0.5), 0.37 * 3.0 + 0.63 * 0.5;
  const std::vector<SharedMaterial> materials{LinearElastic(10.0, 0.3), LinearElastic(1.0, 0.2)};
  for (const double size : {0.15, 0.03}) {
    const double most = size == 0.15 ? 2e-3 : 5e-4;
    EXPECT_LT(off(stiffness_of<2>(layers(size), materials), exact), most) << size;
    EXPECT_LT(off(conductivity_of<2>(layers(size), {3.0, 0.5}), conducts), most) << size;
  }
}

/// On a lattice opposite sides have the same mesh.
TEST(UnitCell, OfLayersIsExactWhereSidesHaveTheSameMesh) {
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

/// A square with a round hole in the middle, or a quarter of it at each corner.
FineMesh<2> with_hole(double radius, bool at_corners, double size) {
  constexpr int chords = 48;
  PlanarDomain domain;
  if (!at_corners) {
    domain = shapes::rectangle(0, 0, 1, 1);
    Polyline hole{"hole", {}};
    for (int k = 0; k <= chords; ++k) {
      const double angle = 2.0 * std::numbers::pi * (k % chords) / chords;
      hole.points.push_back(Vec<2>(0.5 + radius * std::cos(angle), 0.5 + radius * std::sin(angle)));
    }
    domain.boundary.push_back(hole);
    return triangulate(domain, {.size = size});
  }
  Polyline outline{"all", {}};
  const std::array<Vec<2>, 4> corners{Vec<2>(0, 0), Vec<2>(1, 0), Vec<2>(1, 1), Vec<2>(0, 1)};
  for (int corner = 0; corner < 4; ++corner)
    for (int k = 0; k <= chords / 4; ++k) {
      // From the side before the corner to the one after it.
      const double angle = std::numbers::pi * (0.5 + 0.5 * corner) - 2.0 * std::numbers::pi * k / chords;
      Vec<2> x = corners[corner] + radius * Vec<2>(std::cos(angle), std::sin(angle));
      for (int d = 0; d < 2; ++d)
        for (const double side : {0.0, 1.0})
          if (std::abs(x[d] - side) < 1e-12) x[d] = side;
      outline.points.push_back(x);
    }
  outline.points.push_back(outline.points.front());
  domain.boundary.push_back(outline);
  return triangulate(domain, {.size = size});
}

TEST(UnitCell, DoesNotDependOnWhereItIsCutOut) {
  const std::vector<SharedMaterial> material{LinearElastic(1.0, 0.3)};
  for (const double size : {0.05, 0.02}) {
    const double most = size == 0.05 ? 5e-3 : 1e-3;
    EXPECT_LT(off(stiffness_of<2>(with_hole(0.3, true, size), material),
                  stiffness_of<2>(with_hole(0.3, false, size), material)),
              most);
    EXPECT_LT(off(conductivity_of<2>(with_hole(0.3, true, size), {1.0}),
                  conductivity_of<2>(with_hole(0.3, false, size), {1.0})),
              most);
  }
  // Square arrays of holes: Rayleigh (1892) by Perrins, McKenzie & McPhedran (1979), insulators at f = 0.2827.
  const double f = std::numbers::pi * 0.09,
               series = 1.0 - 2.0 * f /
                                  (1.0 + f - 0.305827 * std::pow(f, 4) / (1.0 - 1.402958 * std::pow(f, 8)) -
                                   0.013362 * std::pow(f, 8));
  EXPECT_NEAR(conductivity_of<2>(with_hole(0.3, false, 0.05), {1.0})(0, 0), series, 3e-3 * series)
      << "a polygon of 48 corners has 0.3 % less area";
}

TEST(UnitCell, IsThatOfAnImageOfItInTheSamePlane) {
  constexpr Index n = 128;
  LabelImage<3> image;
  image.size = {n, n, 1};
  for (Index j = 0; j < n; ++j)
    for (Index i = 0; i < n; ++i)
      image.labels.push_back(std::hypot(i + 0.5 - 0.5 * n, j + 0.5 - 0.5 * n) < 0.3 * n ? 0 : 1);
  const Matrix by_image =
      effective_stiffness(image, {SharedMaterial{}, SharedMaterial(LinearElastic(1.0, 0.3))}).extrapolated;
  const Matrix by_mesh = stiffness_of<2>(with_hole(0.3, false, 0.04), {LinearElastic(1.0, 0.3)});
  const std::array<int, 3> plane{0, 1, 5};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      EXPECT_NEAR(by_mesh(i, j), by_image(plane[i], plane[j]), 5e-3 * by_mesh(0, 0)) << i << j;
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

TEST(UnitCell, RefusesWhatDoesNotRepeatItself) {
  PlanarDomain notched{.boundary = {{"all", {{0, 0}, {1, 0}, {1, 1}, {0, 1}, {0, 0.7}, {0.3, 0.5}, {0, 0.3}, {0, 0}}}}};
  const FineMesh<2> mesh = triangulate(notched, {.size = 0.1});
  EXPECT_THAT([&] { stiffness_of<2>(mesh, {LinearElastic(1.0, 0.3)}); },
              ThrowsMessage<InputError>(HasSubstr("the geometry does not repeat itself: there is material at (1, ")));
  EXPECT_THAT([&] { stiffness_of<2>(mesh, {LinearElastic(1.0, 0.3)}, FrameCondition::uniform); },
              ThrowsMessage<InputError>(HasSubstr("void reaches the frame")));
  EXPECT_GT(stiffness_of<2>(mesh, {LinearElastic(1.0, 0.3)}, FrameCondition::kinematic)(0, 0), 0.5);
}

}  // namespace
}  // namespace efree
