// SPDX-License-Identifier: GPL-3.0-or-later
/// Case files whose moduli depend on the grey values of their image.
#include "efree/analysis/analyse.hpp"
#include "efree/core/error.hpp"
#include "efree/io/case/case_file.hpp"
#include "workspace.hpp"

#include <gmock/gmock.h>
#include <cmath>

namespace efree::test {
namespace {

using ::testing::HasSubstr, ::testing::ThrowsMessage;

/// A bar of 20 pixels of length 0.1 by 4 (by 4), pulled along x: E = grey, which grows from 10 to 200 in steps of 10.
const std::string bar_case = R"([definitions]
density = "grey/100"
[geometry]
file = "bar.raw"
[geometry.image]
raw = { size = [20, 4], type = "uint8" }
spacing = 0.1
threshold = 1
[analysis]
plane = "stress"
[material]
E = "100*density"
nu = 0
[[boundary]]
on = "left"
normal_displacement = 0
[[boundary]]
on = "bottom"
normal_displacement = 0
[[boundary]]
on = "right"
traction = [1, 0]
[[probe]]
name = "end"
at = [2, 0.2]
)";

/// The same in space.
std::string in_space() {
  std::string text = replaced(bar_case, "[20, 4]", "[20, 4, 4]");
  text = replaced(text, "[analysis]\nplane = \"stress\"\n", "");
  text = replaced(text, "[1, 0]", "[1, 0, 0]");
  text = replaced(text, "[2, 0.2]", "[2, 0.2, 0.2]");
  return text + "[[boundary]]\non = \"front\"\nnormal_displacement = 0\n";
}

/// The integral of 1/E: linear between centres of pixels, constant in the outer halves of the outermost.
const double elongation = 0.05 * (1.0 / 10.0 + 1.0 / 200.0) + std::log(20.0) / 100.0;

struct Bar : Workspace {
  explicit Bar(const std::string& text) : Workspace(text) {
    std::string row;
    for (int i = 1; i <= 20; ++i) row.push_back(static_cast<char>(10 * i));
    std::string pixels;
    for (int k = 0; k < (text.find("[20, 4, 4]") == std::string::npos ? 4 : 16); ++k) pixels += row;
    write("bar.raw", pixels);
  }
};
template <int Dim> Result<Dim> solved(const std::string& text) {
  const Bar bar(text);
  return analyse(std::get<Case<Dim>>(read_case(bar / "case.toml")));
}

TEST(GreyCase, ABarWhoseGreyValueGrowsHasTheClosedFormElongationWithinTheErrorSaid) {
  const auto result = solved<2>(bar_case);
  const double off = std::abs(result.probes[0].second.displacement[0] - elongation);
  EXPECT_LT(off, 1e-3 * elongation);
  EXPECT_LT(off, 2.0 * result.probe_errors.at("end")[0]);
}

TEST(GreyCase, LikewiseByACloudAndInSpace) {
  const std::string cloud = "[cloud]\nspacing = 0.2\n";
  EXPECT_NEAR(solved<2>(bar_case + cloud).probes[0].second.displacement[0], elongation, 5e-3 * elongation);
  const std::string as_fine_as_voxels = replaced(in_space(), "[geometry]\n", "[geometry]\nmesh_size = 0.1\n");
  EXPECT_NEAR(solved<3>(as_fine_as_voxels + "[basis]\nkind = \"p2\"\n").probes[0].second.displacement[0], elongation,
              5e-3 * elongation);
  // A cell is as stiff as its mean modulus, which is too much: by 1 % if it is as large as a voxel, by a quarter of
  // that if it is half as large.
  const auto on_cells = solved<3>(replaced(in_space(), "[geometry]\n", "[geometry]\nmesh_size = 0.05\n"));
  ASSERT_TRUE(on_cells.cells);
  EXPECT_NEAR(on_cells.probes[0].second.displacement[0], elongation, 5e-3 * elongation);
  // The stress is the same everywhere.
  const auto& stress = on_cells.fields.stress;
  EXPECT_LT((stress.row(0).array() - 1.0).abs().maxCoeff(), 0.1);
}

TEST(GreyCase, NeedsAnImage) {
  const Workspace strip(replaced(strip_case, "E = 1.0", "E = \"1 + grey/255\""));
  EXPECT_THAT([&] { read_case(strip / "case.toml"); },
              ThrowsMessage<InputError>(HasSubstr("case.toml:16: expression \"1 + grey/255\": grey is the value of "
                                                  "an image at a point, and the geometry is no image")));
}

TEST(GreyCase, SaysWhereAModulusIsOutOfRange) {
  EXPECT_THAT([] { solved<2>(replaced(bar_case, "100*density", "100*density - 50")); },
              ThrowsMessage<InputError>(HasSubstr("E is -40 at (")));
  const Bar bar(replaced(bar_case, "density =", "grey ="));
  EXPECT_THAT([&] { read_case(bar / "case.toml"); },
              ThrowsMessage<InputError>(HasSubstr("\"grey\" already has a meaning, choose another name")));
}

}  // namespace
}  // namespace efree::test
