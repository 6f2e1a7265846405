// SPDX-License-Identifier: GPL-3.0-or-later
/// Case files whose moduli depend on the grey values of their image.
#include "efree/analysis/analyse.hpp"
#include "efree/core/error.hpp"
#include "efree/io/case/case_file.hpp"
#include "workspace.hpp"

#include <fmt/format.h>
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
  const Bar bar(replaced(in_space(), "[geometry]\n", "[geometry]\nmesh_size = 0.05\n"));
  const auto analysis = std::get<Case<3>>(read_case(bar / "case.toml"));
  const auto on_cells = analyse_image(analysis).value();
  EXPECT_NEAR(on_cells.probes[0].second.displacement[0], elongation, 5e-3 * elongation);
  // The stress is the same everywhere.
  const auto& stress = on_cells.by_cell.stress;
  EXPECT_LT((stress.row(0).array() - 1.0).abs().maxCoeff(), 0.1);
}

/// A cantilever of 160 x 16 x 16 voxels whose density grows over its height, scanned with a phantom: two inserts of
/// known density tell what a grey value means.
struct ScannedBeam : Workspace {
  static constexpr int length = 160, height = 16;
  static constexpr double lightest = 0.4, heaviest = 1.6, grey_of_nothing = 100.0, grey_per_density = 12000.0;

  static double density(double y) { return lightest + (heaviest - lightest) * y / height; }
  static double modulus(double y) { return 10.0 * std::pow(density(y), 1.7); }

  explicit ScannedBeam(const std::string& text) : Workspace(text) {
    std::string voxels;
    for (int k = 0; k < height; ++k)
      for (int j = 0; j < height; ++j)
        for (int i = 0; i < length; ++i) {
          const auto grey = static_cast<unsigned>(std::lround(grey_of_nothing + grey_per_density * density(j + 0.5)));
          voxels.push_back(static_cast<char>(grey & 255));
          voxels.push_back(static_cast<char>(grey >> 8));
        }
    write("beam.raw", voxels);
  }
  /// Of a force at the end, per unit: bending and shear of the section, whose modulus changes over its height
  /// (Jourawski's shear stress; Timoshenko), by quadrature. Without lateral strains, as a clamp that holds them, by 0.8
  /// % of this beam at nu = 0.3, is not in the equation.
  static double deflection() {
    constexpr int n = 4000;
    constexpr double dy = static_cast<double>(height) / n;
    double EA = 0.0, ES = 0.0, EI = 0.0, shear = 0.0, beyond = 0.0;
    for (int k = 0; k < n; ++k) {
      const double y = (k + 0.5) * dy, E = modulus(y) * height * dy;
      EA += E;
      ES += E * y;
    }
    const double middle = ES / EA;
    for (int k = 0; k < n; ++k) {
      const double y = (k + 0.5) * dy, E = modulus(y) * height * dy;
      EI += E * (y - middle) * (y - middle);
      beyond += E * (y - middle);  // first moment of what is below
      shear += beyond * beyond * 2.0 / modulus(y) * dy / height;
    }
    return std::pow(length, 3) / (3.0 * EI) + shear * length / (EI * EI);
  }
};

TEST(GreyCase, ABeamOfACalibratedScanBendsAsTheQuadratureOfItsSectionSays) {
  const ScannedBeam beam(R"case([definitions]
insert = 12100
water = 100
density = "(grey - water)/(insert - water)"
[geometry]
file = "beam.raw"
[geometry.image]
raw = { size = [160, 16, 16], type = "uint16" }
threshold = 2000
[material]
E = "10*density^1.7"
nu = 0
[accuracy.probes]
end = 0.01
[[boundary]]
on = "left"
displacement = [0, 0, 0]
[[boundary]]
on = "right"
force = [0, -1, 0]
[[probe]]
name = "end"
at = [160, 8, 8]
)case");
  const auto analysis = std::get<Case<3>>(read_case(beam / "case.toml"));
  const auto answer = analyse_image(analysis).value();
  EXPECT_TRUE(answer.warnings.empty()) << answer.warnings.front();
  const double exact = ScannedBeam::deflection(), found = -answer.probes[0].second.displacement.y();
  EXPECT_NEAR(found, exact, 0.01 * exact);
}

/// Voxels of two materials have the mean grey value; the modulus of the mixture is that of what they are: side by side
/// along the load, or one after the other.
TEST(GreyCase, MixturesInVoxelsHaveTheModulusOfTheirRule) {
  constexpr int n = 16;
  const auto modulus = [&](const std::string& rule, int normal) {
    const Workspace block(fmt::format(R"case([definitions]
share = "min(max(grey/200, 0), 1)"
[geometry]
file = "block.raw"
[geometry.image]
raw = {{ size = [16, 16, 16], type = "uint8" }}
threshold = 0
[material]
E = "{}"
nu = 0
[[boundary]]
on = "left"
displacement = [0, 0, 0]
[[boundary]]
on = "right"
displacement = [0.16, "free", "free"]
)case",
                                      rule));
    std::string voxels;
    for (int p = 0; p < n * n * n; ++p) {
      const int at = normal == 0 ? p % n : p / n % n;
      voxels.push_back(static_cast<char>(at < 5 ? 0 : at == 5 ? 80 : 200));  // the interface at 5.6
    }
    block.write("block.raw", voxels);
    const auto analysis = std::get<Case<3>>(read_case(block / "case.toml"));
    return analyse_image(analysis).value().cells->extrapolated_energy * 2.0 / (n * n * n * 1e-4);
  };
  const double share = (n - 5.6) / n, beside = 1.0 + 9.0 * share, behind = 1.0 / (1.0 - share + share / 10.0);
  EXPECT_NEAR(modulus("1 + 9*share", 1), beside, 0.01 * beside);
  EXPECT_NEAR(modulus("1/(1 - share + share/10)", 0), behind, 0.01 * behind);
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
