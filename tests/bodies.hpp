// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies and linear fields that the tests and the patch-test table share.
#pragma once

#include "efree/assembly/operators.hpp"
#include "efree/geometry/meshing/image_mesh.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/quadrature/approximation.hpp"
#include "efree/solvers/algorithms/static_analysis.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>
#include <stdexcept>
#include <string>
#include <vector>

namespace efree::testing {

inline double smallest_angle(const FineMesh<2>& mesh) {
  double least = 180.0;
  for (Index c = 0; c < mesh.num_cells(); ++c)
    for (int i = 0; i < 3; ++i) {
      const Vec<2> x = mesh.vertex(mesh.cells()(i, c));
      const Vec<2> a = mesh.vertex(mesh.cells()((i + 1) % 3, c)) - x, b = mesh.vertex(mesh.cells()((i + 2) % 3, c)) - x;
      least = std::min(least, std::atan2(std::abs(a.x() * b.y() - a.y() * b.x()), a.dot(b)) * 180.0 / std::numbers::pi);
    }
  return least;
}

/// The mesh with every third cell split in three at a point on the line from the middle of its first edge to its
/// centroid: the nearer to the edge (`share` of the way), the flatter the cell there. New vertices come last, so the
/// numbers of the others stay.
inline FineMesh<2> with_split_cells(const FineMesh<2>& mesh, double share) {
  const Index cells = mesh.num_cells(), vertices = mesh.num_vertices(), added = (cells + 2) / 3;
  MeshData<2> data{mesh.vertices(), mesh.cells(), {}};
  data.vertices.conservativeResize(2, vertices + added);
  data.cells.conservativeResize(3, cells + 2 * added);
  for (Index k = 0; k < added; ++k) {
    const Eigen::Vector3i cell = mesh.cells().col(3 * k);
    const Vec<2> middle = 0.5 * (mesh.vertex(cell[0]) + mesh.vertex(cell[1]));
    data.vertices.col(vertices + k) = middle + share * (mesh.centroid(3 * k) - middle);
    data.cells.col(3 * k) << cell[0], cell[1], vertices + k;
    data.cells.col(cells + 2 * k) << cell[1], cell[2], vertices + k;
    data.cells.col(cells + 2 * k + 1) << cell[2], cell[0], vertices + k;
  }
  for (const auto& group : mesh.groups()) {
    data.groups.push_back({group.name, {}});
    for (Index f : group.facets) data.groups.back().facets.push_back({mesh.facets()(0, f), mesh.facets()(1, f)});
  }
  return FineMesh<2>(data);
}

/// A fine mesh with a spacing for its clouds. Everything but `free` counts as outer boundary.
struct Body {
  FineMesh<2> mesh;
  double spacing;
  std::vector<std::string> outer;
  std::vector<std::string> inner;
};

/// Bodies by name: square, slivers (the square with cells as flat as 0.1 degree), plate_with_hole, l_shape, slit (open
/// at the lower side), random_holes, pores (of an image; the nodes lie nearly as dense as the fine vertices).
inline Body body(const std::string& name) {
  const std::vector<std::string> sides{"left", "bottom", "right", "top"};
  if (name == "square") return {triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.05}), 0.25, sides, {}};
  if (name == "slivers") return {with_split_cells(body("square").mesh, 0.003), 0.25, sides, {}};
  if (name == "plate_with_hole")
    return {triangulate(shapes::quarter_plate_with_hole(0.25, 1.0, 0.04), {.size = 0.04}), 0.2, sides, {"hole"}};
  if (name == "l_shape") return {triangulate(shapes::l_shape(1.0), {.size = 0.05}), 0.25, sides, {"notch"}};
  if (name == "slit")
    return {
        triangulate(shapes::slit_rectangle(0, 0, 1, 1, {0.4, 0.0}, {0.6, 0.6}), {.size = 0.05}), 0.25, sides, {"slit"}};
  if (name == "random_holes")
    return {triangulate(shapes::plate_with_random_holes(1.0, 25, 0.01, 0.1, 0.0075, 1, 0.02), {.size = 0.02}),
            0.1,
            sides,
            {"holes"}};
  if (name == "pores") {
    LabelImage<2> image = keep_largest(random_spheres<2>(32, {.porosity = 0.3, .r_min = 4.0, .r_max = 10.0})).image;
    image.spacing = Vec<2>::Constant(1.0 / 32.0);
    const auto mesh = mesh_image<2>(image, {.size = 5.0 / 32.0, .contour = Contour::smooth, .simplify = 0.7});
    return {FineMesh<2>(mesh), 10.0 / 32.0, sides, {"pores"}};
  }
  throw std::invalid_argument("no body named " + name);
}

/// Stiffness of an isotropic material.
template <int Dim> VoigtMatrix<Dim> hooke(const IsotropicModuli& moduli, Plane plane = Plane::strain) {
  return Materials<Dim>({LinearElastic(moduli)}, plane).stiffness(0, Vec<Dim>::Zero()).C;
}

/// For names of tests and rows of tables.
inline const char* name_of(SecondaryKind secondary) {
  switch (secondary) {
    case SecondaryKind::cells:
      return "cells";
    case SecondaryKind::linear:
      return "linear";
    case SecondaryKind::mls:
      return "mls";
    case SecondaryKind::full:
      return "full";
  }
  throw std::invalid_argument("a secondary basis without a name");
}

/// Of the displacement gradient H.
template <int Dim> Voigt<Dim> strain_of_gradient(const Mat<Dim>& H) {
  Gradient<Dim> gradient = Gradient<Dim>::Zero();
  gradient.template head<Dim * Dim>() = H.reshaped();
  return strain_of<Dim>(gradient);
}

/// u(x) = shift + H x.
template <int Dim> struct LinearField {
  const char* name;
  Mat<Dim> H;
  Vec<Dim> shift;

  Vec<Dim> displacement(const Vec<Dim>& x) const { return shift + H * x; }
  Mat<Dim> gradient(const Vec<Dim>&) const { return H; }
};
template <int Dim> std::vector<LinearField<Dim>> linear_fields() {
  Mat<Dim> tension = -0.3 * Mat<Dim>::Identity(), shear = Mat<Dim>::Zero(), rotation = Mat<Dim>::Zero();
  tension(0, 0) = 1.0;
  shear(0, Dim - 1) = 1.0;
  rotation(0, 1) = -1.0, rotation(1, 0) = 1.0;
  const Vec<Dim> shift = Vec<Dim>::LinSpaced(0.3, -0.2);
  return {{"tension", tension, shift}, {"shear", shear, shift}, {"rotation", rotation, shift}};
}

/// u_i(x) = x . Q_i x, Q_i symmetric: linear stresses, constant body forces.
template <int Dim> struct QuadraticField {
  const char* name;
  std::array<Mat<Dim>, Dim> Q;

  Vec<Dim> displacement(const Vec<Dim>& x) const {
    Vec<Dim> u;
    for (int i = 0; i < Dim; ++i) u[i] = x.dot(Q[i] * x);
    return u;
  }
  Mat<Dim> gradient(const Vec<Dim>& x) const {
    Mat<Dim> H;
    for (int i = 0; i < Dim; ++i) H.row(i) = 2.0 * (Q[i] * x).transpose();
    return H;
  }
};
/// Pure bending about the origin (nu = 0.3, plane stress), and one with every coefficient.
template <int Dim> std::vector<QuadraticField<Dim>> quadratic_fields() {
  QuadraticField<Dim> bending{"bending", {}}, all{"all", {}};
  for (auto& Q : bending.Q) Q.setZero();
  bending.Q[0](0, 1) = bending.Q[0](1, 0) = 0.5;
  bending.Q[1](0, 0) = -0.5;
  bending.Q[1](1, 1) = -0.15;
  for (int i = 0; i < Dim; ++i)
    for (int j = 0; j < Dim; ++j)
      for (int k = 0; k < Dim; ++k) all.Q[i](j, k) = 1.0 + 0.5 * i - 0.4 * (j + k) + 0.7 * (i == j || i == k);
  return {bending, all};
}

/// Every component prescribed.
template <int Dim> DisplacementCondition<Dim> displacement(std::string on, const VectorField<Dim>& u) {
  DisplacementCondition<Dim> condition{std::move(on), {}, {}};
  for (int i = 0; i < Dim; ++i) condition.components[i] = [u, i](const Vec<Dim>& x) { return u(x)[i]; };
  return condition;
}

/// Largest errors anywhere, relative to the largest displacement and to |C| times the largest |H|.
struct PatchError {
  double displacement = 0.0;  ///< at fine degrees of freedom
  double stress = 0.0;        ///< at quadrature points
  double recovered = 0.0;     ///< stress at fine degrees of freedom
};

/// Solves for a linear or quadratic field with its body force: displacements prescribed on some parts of the boundary,
/// its tractions on others.
template <int Dim, class Field>
PatchError patch_error(const Approximation<Dim>& approximation, const ElasticModel& model, const Field& field,
                       const std::vector<std::string>& held, const std::vector<std::string>& loaded) {
  const VoigtMatrix<Dim> C = materials_of(model, approximation.space.mesh()).stiffness(0, Vec<Dim>::Zero()).C;
  const auto stress = [&](const Vec<Dim>& x) -> Voigt<Dim> { return C * strain_of_gradient<Dim>(field.gradient(x)); };
  const VectorField<Dim> u = [&](const Vec<Dim>& x) { return field.displacement(x); };
  std::vector<DisplacementCondition<Dim>> conditions;
  for (const auto& part : held) conditions.push_back(displacement<Dim>(part, u));
  Loads<Dim> loads;
  for (const auto& part : loaded)
    loads.tractions.push_back(
        {part, [&](const Vec<Dim>& x, const Vec<Dim>& n) { return traction<Dim>(stress(x), n); }});
  Vec<Dim> force = Vec<Dim>::Zero();  // less the divergence of the stress
  for (int j = 0; j < Dim; ++j)
    force -= traction<Dim>(stress(Vec<Dim>::Unit(j)) - stress(Vec<Dim>::Zero()), Vec<Dim>::Unit(j));
  if (!force.isZero(0.0)) loads.body_force = [&](const Vec<Dim>&) { return force; };
  const auto solution = ElasticSolver<Dim>(approximation, model, conditions).solve(loads);
  const auto fields = recover_fields(approximation, solution);

  const auto& x = approximation.space.points();
  const auto& points = approximation.quadrature.points;
  PatchError error;
  double largest_displacement = 0.0, largest_gradient = 0.0;
  for (Index v = 0; v < x.cols(); ++v) {
    const Vec<Dim> exact = u(x.col(v));
    largest_displacement = std::max(largest_displacement, exact.cwiseAbs().maxCoeff());
    largest_gradient = std::max(largest_gradient, field.gradient(x.col(v)).norm());
    error.displacement = std::max(error.displacement, (fields.displacement.col(v) - exact).cwiseAbs().maxCoeff());
    error.recovered = std::max(error.recovered, (fields.stress.col(v) - stress(x.col(v))).cwiseAbs().maxCoeff());
  }
  for (Index K = 0; K < points.cols(); ++K)
    error.stress = std::max(error.stress, (solution.stress.col(K) - stress(points.col(K))).cwiseAbs().maxCoeff());
  const double scale = C(0, 0) * largest_gradient;
  return {error.displacement / largest_displacement, error.stress / scale, error.recovered / scale};
}

/// The approximation with gradients evaluated at the quadrature points instead of projected. Clusters of cells.
inline Approximation<2> with_point_evaluation(const FineMesh<2>& mesh, const ApproximationOptions& options) {
  Approximation<2> approximation = approximate(mesh, options);
  const auto points = sample_cloud(mesh, CloudOptions{options.spacing / std::sqrt(2.0), options.seed + 1000});
  approximation.quadrature =
      evaluate_at_points(approximation.space, approximation.shape, cell_clusters(approximation.space, points));
  return approximation;
}

}  // namespace efree::testing
