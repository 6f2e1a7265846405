// SPDX-License-Identifier: GPL-3.0-or-later
/// Effective properties of meshed unit cells: which meshes the error comes from.
#include "efree/analysis/effective.hpp"
#include "efree/core/error.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/linear_elastic.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <string>
#include <vector>

namespace efree {
namespace {

using ::testing::Contains, ::testing::HasSubstr;

/// A square with a hole that takes cells of at most this size.
MeshSource<2> square_with_hole(double coarsest) {
  return {.mesh =
              [coarsest](const MeshSize& size, const Stage&) {
                if (size.length > coarsest) throw InputError("cells are larger than the hole");
                PlanarDomain domain = shapes::rectangle(0, 0, 1, 1);
                domain.boundary.push_back({"hole", {{0.4, 0.4}, {0.6, 0.4}, {0.6, 0.6}, {0.4, 0.6}, {0.4, 0.4}}});
                return MadeMesh<2>{.mesh = triangulate_data(domain, {.size = size.length}), .size = size.length};
              },
          .size = 0.1};
}

EffectiveSettings<2> elastic() {
  EffectiveSettings<2> settings;
  settings.common.model.plane = Plane::strain;
  settings.common.model.material = LinearElastic(1.0, 0.3);
  return settings;
}

}  // namespace

TEST(EffectiveOnMeshes, SaysWhichCoarserMeshesCannotBeMade) {
  std::vector<std::string> said;
  const Monitor monitor{.say = [&](const std::string& remark) { said.push_back(remark); }};
  const EffectiveResult all = find_effective(elastic(), square_with_hole(1.0), monitor);
  EXPECT_EQ(all.tensor.levels.size(), 3);
  EXPECT_THAT(said, Not(Contains(HasSubstr("no error from"))));
  const EffectiveResult two = find_effective(elastic(), square_with_hole(0.3), monitor);
  EXPECT_EQ(two.tensor.levels.size(), 2);
  EXPECT_THAT(said, Contains(HasSubstr("no error from a mesh of 4 times the size: cells are larger than the hole")));
  EXPECT_EQ(two.tensor.tensor, all.tensor.tensor);
  const EffectiveResult one = find_effective(elastic(), square_with_hole(0.15), monitor);
  EXPECT_EQ(one.tensor.levels.size(), 1);
  EXPECT_THAT(one.warnings, Contains(HasSubstr("the error is the distance from linear elements")));
  // The same norm for all: linear elements are further away than quadratic ones of twice the size.
  EXPECT_GT(one.tensor.grid_error, all.tensor.grid_error / 3.0);
  EXPECT_LT(one.tensor.grid_error, 0.2);
}

TEST(EffectiveOnMeshes, HidesNoErrorOfTheMeshThatWasAskedFor) {
  EXPECT_THROW(find_effective(elastic(), square_with_hole(0.05)), InputError);
  EffectiveSettings<2> settings = elastic();
  settings.common.materials = {{"nowhere", LinearElastic(1.0, 0.3)}};
  EXPECT_THROW(find_effective(settings, square_with_hole(1.0)), InputError);
  settings = elastic();
  settings.common.model.plane.reset();
  EXPECT_THROW(find_effective(settings, square_with_hole(1.0)), InputError);
}

}  // namespace efree
