// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/error.hpp"
#include "efree/geometry/meshing/gmsh_reader.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

namespace efree {
namespace {

namespace fs = std::filesystem;

const std::string square = R"(
Point(1) = {0, 0, 0}; Point(2) = {1, 0, 0}; Point(3) = {1, 1, 0}; Point(4) = {0, 1, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
)";

/// A folder of its own for a test; what scripts would leave behind is "mark".
class GmshScript : public testing::Test {
 protected:
  GmshScript() {
    fs::remove_all(folder);
    fs::create_directories(folder / "below");
  }
  ~GmshScript() override { fs::remove_all(folder); }

  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(folder / name, std::ios::binary) << text;
    return (folder / name).string();
  }
  bool left_a_mark() const { return fs::exists(mark); }
  /// The message that the file is refused with, by both that open it.
  std::string refusal(const std::string& path) const {
    std::vector<std::string> messages;
    for (const bool whole : {false, true}) try {
        whole ? static_cast<void>(read_gmsh<2>(path, {.size = path.ends_with(".geo") ? 0.5 : 0.0}))
              : static_cast<void>(gmsh_dimension(path));
        messages.push_back("none");
      } catch (const InputError& error) {
        messages.push_back(error.what());
      }
    EXPECT_EQ(messages[0], messages[1]);
    return messages[0];
  }

  const fs::path folder = fs::path(testing::TempDir()) / testing::UnitTest::GetInstance()->current_test_info()->name();
  const fs::path mark = folder / "mark";
};

TEST_F(GmshScript, CommandsThatTouchTheSystemAreRefusedWithTheirLineBeforeGmshSeesThem) {
  const std::string file = mark.string();
  const std::string long_text(2000, 'x');
  const std::vector<std::pair<std::string, std::string>> scripts{
      {"SystemCall \"touch " + file + "\";", "SystemCall runs a program"},
      {"System 'touch " + file + "';", "System runs a program"},
      {"NonBlockingSystemCall \"touch " + file + "\";", "NonBlockingSystemCall runs a program"},
      {"x = 1e5; /* not here: */ SystemCall \"touch " + file + "\";", "SystemCall"},
      {"x = 1e5SystemCall \"touch " + file + "\";", "SystemCall"},
      {"x = 1.SystemCall \"touch " + file + "\";", "SystemCall"},
      {"OnelabRun(\"a\", \"touch " + file + "\");", "OnelabRun runs a program"},
      {"Save \"" + file + "\";", "Save writes a file"},
      {"Print \"" + file + "\";", "Print writes a file"},
      {"Printf(\"%g\", Hypot(1, 2)) > \"" + file + "\";", "Printf writes a file"},
      {"Printf('a;b') >> '" + file + "';", "Printf writes a file"},
      {"Macro m SystemCall \"touch " + file + "\"; Return Call m;", "SystemCall"},
      {"If (0) EndIf SystemCall \"touch " + file + "\";", "SystemCall"},
      {"name = \"" + long_text + "\"; SystemCall \"touch " + file + "\";", "a string has more than 1000 characters"},
      {"Exit;", "Exit ends the program"},
      {"Sleep 1000;", "Sleep waits"},
      {"Merge \"/etc/passwd\";", "Merge takes \"/etc/passwd\", which is not below the folder of the script"},
      {"Include \"../other.geo\";", "Include takes \"../other.geo\", which is not below"},
      {"Include StrCat(\"/etc/\", \"passwd\");", "Include takes a file whose name is computed"},
      {"Merge Str(\"a\");", "Merge takes a file whose name is computed"},
      {"name = \"open", "a string has no end"},
  };
  for (const auto& [script, what] : scripts) {
    const std::string path = write("script.geo", square + script + "\n");
    EXPECT_THAT(refusal(path), testing::HasSubstr(what)) << script;
    EXPECT_THAT(refusal(path), testing::HasSubstr(path + ", line 5")) << script;
    EXPECT_FALSE(left_a_mark()) << script;
  }
  const auto no_text = testing::HasSubstr("no text, it has zeros or carriage returns");
  EXPECT_THAT(refusal(write("old.geo", "// \rSystemCall \"touch " + file + "\";\n")), no_text);
  EXPECT_THAT(refusal(write("zero.geo", std::string("x = 1;\0 y = 2;\n", 15))), no_text);
}

TEST_F(GmshScript, TheyRunIfTheUserTrustsThem) {
  const std::string path = write("script.geo", square + "SystemCall \"touch " + mark.string() + "\";\n");
  EXPECT_EQ(gmsh_dimension(path, true), 2);
  EXPECT_TRUE(left_a_mark());
  fs::remove(mark);
  EXPECT_GT(read_gmsh<2>(path, {.size = 0.5, .trust = true}).cells.cols(), 0);
  EXPECT_TRUE(left_a_mark());
}

TEST_F(GmshScript, IncludedFilesOptionFilesAndScriptsCalledMeshesAreReadAsWell) {
  const std::string command = "SystemCall \"touch " + mark.string() + "\";\n";
  write("below/two.geo", "x = 1;\n" + command);
  write("one.geo", "Include \"below/two.geo\";\n");
  EXPECT_THAT(refusal(write("chain.geo", square + "Include \"one.geo\";\n")),
              testing::HasSubstr("two.geo, line 2: SystemCall"));
  write("plate.geo.opt", command);
  EXPECT_THAT(refusal(write("plate.geo", square)), testing::HasSubstr("plate.geo.opt, line 1: SystemCall"));
  for (const std::string begin : {"", "\n$MeshFormat\n4.1 0 8\n$EndMeshFormat\n", "$Nothing\n"})
    EXPECT_THAT(refusal(write("script.msh", begin + square + command)), testing::HasSubstr("no gmsh mesh")) << begin;
  EXPECT_FALSE(left_a_mark());
}

TEST_F(GmshScript, DescriptionsOfGeometryAreReadWhateverTheyMention) {
  write("below/points.geo", square);
  const std::string path = write("harmless.geo", R"(
// SystemCall "touch mark"; Save "mark";
/* Exit; ' " */
Mesh.SaveAll = 1; Print.Background = 0; General.Terminal = 0;
Include "below/points.geo";
text = "Save, SystemCall and Exit; it's all right";
Saved = 3.5e-1; SystemCalls = .5; x = 2e3;
If (Saved > 0.1)
  Printf("%g is larger > than 0.1", Saved);
EndIf
Physical Curve("Save") = {1};
)");
  EXPECT_EQ(gmsh_dimension(path), 2);
  EXPECT_NEAR(read_gmsh<2>(path, {.size = 0.5}).vertices.row(0).maxCoeff(), 1.0, 1e-12);
}

}  // namespace
}  // namespace efree
