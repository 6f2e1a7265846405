// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/point_field.hpp"
#include "efree/io/pictures/internal/load_arrows.hpp"
#include "workspace.hpp"

#include <gmock/gmock.h>

namespace efree {
namespace {

using namespace internal::drawing;
using test::replaced;
using test::strip_case;
using test::Workspace;

/// The surface of [0, 1]^3, and a wall in front of it at y = -1 on the right.
Surface cube(bool with_wall) {
  Surface surface{Points<3>(3, with_wall ? 12 : 8), {}};
  for (int k = 0; k < 8; ++k) surface.points.col(k) << (k & 1), (k >> 1 & 1), (k >> 2 & 1);
  const std::array<std::array<Index, 4>, 6> sides{
      {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}}};
  for (const auto& [a, b, c, d] : sides) surface.triangles.insert(surface.triangles.end(), {{a, b, c}, {a, c, d}});
  if (with_wall) {
    for (int k = 0; k < 4; ++k) surface.points.col(8 + k) << (k & 1 ? 3.0 : 0.5), -1.0, (k >> 1 ? 3.0 : -1.0);
    surface.triangles.insert(surface.triangles.end(), {{8, 9, 11}, {8, 11, 10}});
  }
  return surface;
}

TEST(PointField, NamesAreThoseOfComponentsAndInvariants) {
  const Vec<3> u(3.0, -4.0, 12.0);
  Voigt<3> strain, stress;
  strain << 1.0, 2.0, 3.0, 4.0, 5.0, 6.0;
  stress << 5.0, -1.0, 2.0, 0.0, 0.0, 4.0;  // principal stresses 7, 2, -3
  const auto value = [&](const char* name) { return PointField<3>::find(name, false).value()(u, strain, stress); };
  EXPECT_DOUBLE_EQ(value("displacement"), 13.0);
  EXPECT_DOUBLE_EQ(value("displacement_z"), 12.0);
  EXPECT_DOUBLE_EQ(value("strain_xx"), 1.0);
  EXPECT_DOUBLE_EQ(value("strain_xy"), 6.0);
  EXPECT_DOUBLE_EQ(value("stress_yy"), -1.0);
  EXPECT_DOUBLE_EQ(value("mean_stress"), 2.0);
  EXPECT_NEAR(value("principal_stress_1"), 7.0, 1e-12);
  EXPECT_NEAR(value("principal_stress_2"), 2.0, 1e-12);
  EXPECT_NEAR(value("principal_stress_3"), -3.0, 1e-12);
  EXPECT_NEAR(value("von_mises"), std::sqrt(75.0), 1e-12);
  EXPECT_FALSE(PointField<3>::find("stress_rr", false));
  EXPECT_FALSE(PointField<2>::find("displacement_z", false));
  Voigt<2> hoop;
  hoop << 1.0, 2.0, 5.0, 0.0;
  EXPECT_DOUBLE_EQ(PointField<2>::find("stress_tt", true).value()({0.0, 0.0}, hoop, hoop), 5.0);
  EXPECT_DOUBLE_EQ(PointField<2>::find("principal_stress_2", true).value()({0.0, 0.0}, hoop, hoop), 2.0);
}

TEST(View, AnglesTurnTheViewerAboutZAndRaiseHim) {
  const View front = view_from({-90.0, 0.0}), above = view_from({-90.0, 90.0}), corner = view_from({45.0, 30.0});
  EXPECT_LT((front.towards - Vec3(0.0, -1.0, 0.0)).norm(), 1e-15);
  EXPECT_LT((front.axes().row(0).transpose() - Vec3::UnitX()).norm(), 1e-15);
  EXPECT_LT((front.up - Vec3::UnitZ()).norm(), 1e-15);
  // As a plan: x to the right, y upwards.
  EXPECT_LT((above.axes() - Mat<3>::Identity()).cwiseAbs().maxCoeff(), 1e-15);
  EXPECT_NEAR(corner.towards.z(), 0.5, 1e-15);
  EXPECT_NEAR(corner.towards.x(), corner.towards.y(), 1e-15);
  EXPECT_LT((corner.axes() * corner.axes().transpose() - Mat<3>::Identity()).cwiseAbs().maxCoeff(), 1e-15);
}

TEST(View, TheLargestValueIsSeenFromWhateverSideItIsOn) {
  const Surface body = cube(false);
  for (const Vec3& at : {Vec3(0.5, 0.0, 0.5), Vec3(0.5, 1.0, 0.5), Vec3(0.0, 0.5, 0.5), Vec3(1.0, 0.5, 0.5),
                         Vec3(0.5, 0.5, 1.0), Vec3(0.5, 0.5, 0.0)}) {
    const Vec3 normal = 2.0 * (at - Vec3::Constant(0.5));
    EXPECT_GT(best_view(body, {}, at).towards.dot(normal), 0.1) << at.transpose();
  }
  // From above unless there is a reason, and not through what stands before the place.
  EXPECT_GT(best_view(body, {}).towards.z(), 0.0);
  const Vec3 place(0.5, 0.0, 0.9);
  EXPECT_GT(best_view(body, {}, place).towards.x(), 0.0);
  EXPECT_LT(best_view(cube(true), {}, place).towards.x(), 0.0);
  EXPECT_LT(best_view(cube(true), {}, place).towards.y(), 0.0);
}

TEST(LoadArrows, PointAlongTractionsAndPressAgainstTheBody) {
  Loads<2> loads;
  loads.tractions = {{"top",
                      [](const Vec<2>& x, const Vec<2>&) -> Vec<2> {
                        return {x[0], -2.0};
                      }},
                     pressure<2>("side", [](const Vec<2>&) { return -3.0; })};
  loads.resultants = {{.on = "side", .force = {0.0, 4.0}}};
  loads.followers = {{"top", [](const Vec<2>&) { return 5.0; }}};
  const auto facets_of = [](const std::string& part) {
    std::vector<LoadedFacet<2>> facets;
    for (Index k = 0; k < 2; ++k) {
      const double along = k + 0.5;
      facets.push_back(part == "top" ? LoadedFacet<2>{{along, 2.0}, Vec<2>::UnitY(), 1.0, k}
                                     : LoadedFacet<2>{{2.0, along}, Vec<2>::UnitX(), 1.0, k});
    }
    return facets;
  };
  const auto arrows = load_arrows<2>(loads, facets_of, 0.1);
  // Those of a part add up: first the side, then the top.
  ASSERT_EQ(arrows.size(), 4u);
  EXPECT_LT((arrows[0].traction - Vec3(3.0, 2.0, 0.0)).norm(), 1e-15);
  EXPECT_FALSE(arrows[0].presses);
  EXPECT_EQ(arrows[3].traction, Vec3(1.5, -7.0, 0.0));
  EXPECT_TRUE(arrows[3].presses);
  EXPECT_EQ(load_arrows<2>(loads, facets_of, 10.0).size(), 2u);  // one for each part
}

TEST(Pictures, AreThoseThatTheCaseNamesAndNoOthers) {
  const Workspace work(strip_case + R"([output]
pictures = [{ field = "stress_xx", unit = "MPa", range = [0, 2] }, { name = "u", field = "displacement_x", deformation = 0 },
            { field = "error" }]
)");
  ASSERT_EQ(work.efree({"solve", "case.toml", "--out", "out"}).status, 0);
  for (const char* name : {"picture_stress_xx.png", "picture_u.png", "picture_error.png"})
    EXPECT_GT(test::fs::file_size(work / ("out/" + std::string(name))), 1000u) << name;
  EXPECT_FALSE(test::fs::exists(work / "out/fields.png"));
  // Pictures of the run before are gone; those of others stay.
  work.write("out/mine.png", "mine");
  work.write("case.toml", strip_case);
  ASSERT_EQ(work.efree({"solve", "case.toml", "--out", "out"}).status, 0);
  EXPECT_GT(test::fs::file_size(work / "out/fields.png"), 1000u);
  EXPECT_FALSE(test::fs::exists(work / "out/picture_u.png"));
  EXPECT_TRUE(test::fs::exists(work / "out/mine.png"));
  // Folders are nobody's pictures, and where one is in the way results stay as they are.
  test::fs::create_directory(work / "out/picture_u.png");
  ASSERT_EQ(work.efree({"solve", "case.toml", "--out", "out"}).status, 0);
  EXPECT_TRUE(test::fs::exists(work / "out/picture_u.png"));
  test::fs::create_directory(work / "out/picture_x.png");
  work.write("case.toml", strip_case + "[output]\npictures = [{ name = \"x\", field = \"displacement_x\" }]\n");
  const std::string before = test::content(work / "out/result.json");
  const auto run = work.efree({"solve", "case.toml", "--out", "out"});
  EXPECT_EQ(run.status, 2);
  EXPECT_THAT(run.output, testing::HasSubstr("picture_x.png: there is a folder of that name"));
  EXPECT_EQ(test::content(work / "out/result.json"), before);
  EXPECT_TRUE(test::fs::exists(work / "out/fields.vtu"));
}

TEST(Pictures, OfWhatThereIsNotAreRefusedBeforeAnythingIsComputed) {
  const auto refused = [](const std::string& picture) {
    const Workspace work(strip_case + "[output]\npictures = [" + picture + "]\n");
    const auto run = work.efree({"solve", "case.toml", "--out", "out"});
    EXPECT_EQ(run.status, 2) << picture;
    return run.output;
  };
  using testing::HasSubstr;
  EXPECT_THAT(refused("{ field = \"stress_zx\" }"),
              HasSubstr("case.toml:34: there is no field \"stress_zx\"; did you"));
  EXPECT_THAT(refused("{ field = \"utilisation\" }"), HasSubstr("no field \"utilisation\""));
  EXPECT_THAT(refused("{ name = \"a\" }"), HasSubstr("\"field\" is missing"));
  EXPECT_THAT(refused("{ field = \"von_mises\", name = \"../x\" }"), HasSubstr("expected at most 60 letters, digits"));
  EXPECT_THAT(refused("{ field = \"von_mises\" }, { field = \"von_mises\" }"), HasSubstr("two pictures are called"));
  EXPECT_THAT(refused("{ field = \"von_mises\", view = [0, 0] }"), HasSubstr("unknown key \"view\""));
  EXPECT_THAT(refused("{ field = \"von_mises\", range = [1, 1] }"), HasSubstr("a smaller and a larger number"));
  EXPECT_THAT(refused("{ field = \"von_mises\", range = [1] }"), HasSubstr("range has 1 numbers"));
  EXPECT_THAT(refused("{ field = \"von_mises\", case = \"wind\" }"), HasSubstr("the case has no load case"));
  EXPECT_THAT(refused("{ field = \"von_mises\", deformation = -1 }"), HasSubstr("deformation"));
  EXPECT_THAT(refused("\"von_mises\""), HasSubstr("array of tables"));
}

}  // namespace
}  // namespace efree
