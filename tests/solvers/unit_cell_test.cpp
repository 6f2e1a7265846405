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

TEST(UnitCell, RefusesSidesWithOtherMeshesAndSidesThatNothingLiesOn) {
  const std::vector<SharedMaterial> material{LinearElastic(1.0, 0.3)};
  const FineMesh<2> mesh = triangulate(
      {.boundary = {{"all", {{0, 0}, {1, 0}, {1, 0.13}, {1, 0.31}, {1, 1}, {0, 1}, {0, 0}}}}}, {.size = 0.15});
  EXPECT_THAT([&] { stiffness_of<2>(mesh, material); },
              ThrowsMessage<InputError>(HasSubstr("opposite sides of the unit cell do not have the same mesh: (1, ")));
  // One material: its own tensor under all conditions that need no sides alike.
  for (const FrameCondition frame : {FrameCondition::kinematic, FrameCondition::uniform}) {
    const Matrix C = stiffness_of<2>(mesh, material, frame);
    EXPECT_NEAR(C(0, 0), 0.7 / (1.3 * 0.4), 1e-7);
    EXPECT_NEAR(C(0, 1), 0.3 / (1.3 * 0.4), 1e-7);
    EXPECT_NEAR(C(2, 2), 1.0 / 2.6, 1e-7);
    EXPECT_NEAR(conductivity_of<2>(mesh, {2.5}, frame)(1, 1), 2.5, 2e-7);
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
