// SPDX-License-Identifier: GPL-3.0-or-later
/// Moduli from the grey values of an image.
#include "efree/geometry/input/grey_image.hpp"
#include "efree/geometry/meshing/image_mesh.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/algorithms/static_analysis.hpp"

#include <gtest/gtest.h>
#include <cmath>

namespace efree {
namespace {

/// A bar of n pixels along x and 4 across, whose grey value grows linearly from 50 to 200, as an image.
constexpr Index pixels = 24;
constexpr double pixel = 0.25, bar_length = pixels * pixel, steepness = 150.0 / bar_length;

template <int Dim> std::array<Index, Dim> bar_size() {
  std::array<Index, Dim> size;
  size.fill(4);
  size[0] = pixels;
  return size;
}
template <int Dim> GreyImage<Dim> grey_bar() {
  GreyImage<Dim> image{.size = bar_size<Dim>(), .spacing = Vec<Dim>::Constant(pixel)};
  for (int row = 0; row < (Dim == 2 ? 4 : 16); ++row)
    for (Index i = 0; i < pixels; ++i) image.values.push_back(static_cast<float>(50.0 + steepness * (i + 0.5) * pixel));
  return image;
}
template <int Dim> FineMesh<Dim> bar_mesh() {
  LabelImage<Dim> image{.size = bar_size<Dim>(), .spacing = Vec<Dim>::Constant(pixel)};
  image.labels.assign(Dim == 2 ? 4 * pixels : 16 * pixels, 1);
  return FineMesh<Dim>(mesh_image<Dim>(image, {.size = pixel}));
}

/// How much it gets longer under a unit stress with E = grey/100: the integral of 1/E, where E is constant in the outer
/// halves of the first and the last pixel.
double elongation() {
  const double first = (50.0 + 0.5 * steepness * pixel) / 100.0, last = (200.0 - 0.5 * steepness * pixel) / 100.0;
  return 0.5 * pixel * (1.0 / first + 1.0 / last) + 100.0 / steepness * std::log(last / first);
}

/// What is computed over what is exact, less one.
template <int Dim> double error_of(const ApproximationOptions& options, Essential essential) {
  const FineMesh<Dim> mesh = bar_mesh<Dim>();
  const auto approximation = approximate<Dim>(mesh, options);
  const ScalarField<Dim> grey = grey_value(grey_bar<Dim>());
  ElasticModel model{
      .material = LinearElastic([grey](const Vec<3>& X) { return grey(X.template head<Dim>()) / 100.0; }, 0.0),
      .plane = Plane::stress,
      .essential = essential};
  std::vector<DisplacementCondition<Dim>> held{symmetry_plane<Dim>("left"), symmetry_plane<Dim>("bottom")};
  if constexpr (Dim == 3) held.push_back(symmetry_plane<3>("front"));
  Loads<Dim> pull;
  pull.tractions.push_back({"right", [](const Vec<Dim>&, const Vec<Dim>&) { return Vec<Dim>(Vec<Dim>::Unit(0)); }});
  const auto solution = ElasticSolver<Dim>(approximation, model, held).solve(pull);
  Vec<Dim> end = Vec<Dim>::Constant(0.5);
  end[0] = bar_length;
  const auto there = probe(approximation.space, recover_fields(approximation, solution), end);
  return there.displacement[0] / elongation() - 1.0;
}

TEST(GreyModuli, ABarWhoseGreyValueGrowsHasTheClosedFormElongationOnEveryBasis) {
  const ApproximationOptions cloud{.spacing = 0.5};
  ApproximationOptions quadratic = cloud;
  quadratic.order = 2;
  EXPECT_LT(std::abs(error_of<2>({.kind = BasisKind::p1}, Essential::strong)), 1e-3);
  EXPECT_LT(std::abs(error_of<2>({.kind = BasisKind::p2}, Essential::strong)), 1e-4);
  EXPECT_LT(std::abs(error_of<2>(cloud, Essential::nitsche)), 5e-3);
  EXPECT_LT(std::abs(error_of<2>(quadratic, Essential::nitsche)), 5e-3);
  // On a lattice edges are up to twice as long.
  EXPECT_LT(std::abs(error_of<3>({.kind = BasisKind::p1}, Essential::strong)), 1e-3);
  EXPECT_LT(std::abs(error_of<3>({.kind = BasisKind::p2}, Essential::strong)), 4e-4);
  EXPECT_LT(std::abs(error_of<3>(cloud, Essential::nitsche)), 5e-3);
}

}  // namespace
}  // namespace efree
