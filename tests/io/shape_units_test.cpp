// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/case_file.hpp"
#include "workspace.hpp"

#include <fmt/format.h>

namespace efree {
namespace {

using test::Workspace;

/// A shape with these lengths, times a factor, and numbers that are none.
struct BuiltIn {
  std::string name;
  std::vector<std::pair<std::string, double>> lengths;
  std::string numbers{};
};

std::string case_of(const BuiltIn& shape, double factor, double size, bool planar) {
  std::string parameters = shape.numbers;
  for (const auto& [name, length] : shape.lengths)
    parameters += fmt::format("{}{} = {}", parameters.empty() ? "" : ", ", name, factor * length);
  return fmt::format(
      "[geometry]\nshape = \"{}\"\nparameters = {{ {} }}\nmesh_size = {}\n{}[material]\nE = 1\nnu = 0.3\n"
      "[[boundary]]\non = \"{}\"\ndisplacement = [0, 0{}]\n",
      shape.name, parameters, factor * size, planar ? "[analysis]\nplane = \"strain\"\n" : "",
      shape.name == "annulus" || shape.name == "thick_sphere" ? "inner"
      : planar                                                ? "left"
                                                              : "bottom",
      planar ? "" : ", 0");
}

template <int Dim> void expect_the_same_mesh(const BuiltIn& shape, double size) {
  const auto mesh_of = [&](double factor) {
    const Workspace work(case_of(shape, factor, size, Dim == 2));
    return prepare<Dim>(std::get<Case<Dim>>(read_case(work / "case.toml"))).mesh;
  };
  const auto reference = mesh_of(1.0);
  for (const double factor : {1e-3, 1e3, 25.4, 1.0 / 0.3048, 1e-6}) {
    const auto mesh = mesh_of(factor);
    ASSERT_EQ(mesh->num_vertices(), reference->num_vertices()) << shape.name << " " << factor;
    ASSERT_EQ(mesh->cells(), reference->cells()) << shape.name << " " << factor;
    const double largest = reference->vertices().cwiseAbs().maxCoeff();
    EXPECT_LT((mesh->vertices() / factor - reference->vertices()).cwiseAbs().maxCoeff(), 1e-13 * largest)
        << shape.name << " " << factor;
  }
}

TEST(ShapeUnits, PlanarShapesHaveTheSameMeshInMetresMillimetresInchesAndFeet) {
  expect_the_same_mesh<2>({"rectangle", {{"width", 3.2}, {"height", 12.8}}}, 0.8);
  expect_the_same_mesh<2>({"rectangle", {{"width", 3.81}, {"height", 23.47}, {"x", 0.1}}}, 0.6);
  expect_the_same_mesh<2>({"plate_with_hole", {{"radius", 1.0}, {"half_width", 4.1}}}, 0.3);
  expect_the_same_mesh<2>({"l_shape", {{"side", 1.7}}}, 0.1);
  expect_the_same_mesh<2>({"annulus", {{"inner", 0.7}, {"outer", 1.1}}}, 0.1);
  expect_the_same_mesh<2>(
      {"random_holes", {{"width", 10.0}, {"r_min", 0.3}, {"r_max", 0.7}, {"gap", 0.1}}, "count = 12, seed = 3"}, 0.3);
}

TEST(ShapeUnits, SolidShapesHaveTheSameMeshInMetresMillimetresInchesAndFeet) {
  expect_the_same_mesh<3>({"box", {{"width", 1.0}, {"depth", 0.7}, {"height", 2.3}}}, 0.4);
  expect_the_same_mesh<3>({"spherical_cavity", {{"radius", 1.0}, {"half_width", 3.0}, {"size_at_hole", 0.3}}}, 0.8);
  expect_the_same_mesh<3>({"thick_cylinder", {{"inner", 1.0}, {"outer", 1.9}, {"height", 0.6}}}, 0.4);
  expect_the_same_mesh<3>({"thick_sphere", {{"inner", 1.0}, {"outer", 1.9}}}, 0.5);
  expect_the_same_mesh<3>({"cylinder", {{"radius", 1.3}, {"height", 0.6}}}, 0.4);
}

}  // namespace
}  // namespace efree
