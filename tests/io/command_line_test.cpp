// SPDX-License-Identifier: GPL-3.0-or-later
#include "workspace.hpp"

#include <vtkCellType.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLUnstructuredGridReader.h>
#include <regex>

namespace efree::test {
namespace {

const std::vector<std::string> solve_here{"solve", "case.toml", "--out", "out", "--quiet", "--no-picture"};

/// Runs the strip's case with `from` replaced by `to`.
Workspace::Run solve_with(const Workspace& work, const std::string& from, const std::string& to) {
  work.write("case.toml", replaced(strip_case, from, to));
  return work.efree(solve_here);
}

void expect_refused(const Workspace::Run& run, const std::string& message) {
  EXPECT_EQ(run.status, 2) << run.output;
  EXPECT_TRUE(std::regex_search(run.output, std::regex(message))) << run.output;
}

TEST(CommandLine, SaysWhatItIs) {
  const Workspace work;
  EXPECT_EQ(work.efree({"--version"}).output, "efree 0.1.0\n");
  const auto help = work.efree({"--help"});
  EXPECT_EQ(help.status, 0);
  EXPECT_NE(help.output.find("convergence"), std::string::npos);
}

TEST(CommandLine, RefusesWrongArguments) {
  const Workspace work;
  expect_refused(work.efree({}), "subcommand is required");
  expect_refused(work.efree({"solve", "case.toml"}), "--out is required");
  expect_refused(work.efree({"solve", "case.toml", "--out", "out", "--thread", "2"}), "--thread");
  expect_refused(work.efree({"solve", "case.toml", "--out", "out", "--threads", "0"}), "--threads");
  expect_refused(work.efree({"solve", "none.toml", "--out", "out"}), "^error: there is no case file none.toml");
  expect_refused(work.efree({"convergence", "case.toml", "--out", "out", "--spacing", "0.4"}),
                 "at least two different");
  expect_refused(work.efree({"convergence", "case.toml", "--out", "out", "--spacing", "0.4,x"}), "--spacing");
  expect_refused(work.efree({"convergence", "case.toml", "--out", "out", "--spacing", "0.4,-0.2"}), "--spacing");
  expect_refused(work.efree({"convergence", "case.toml", "--out", "out", "--spacing", "abc"}),
                 "\"abc\", expected positive numbers separated by commas\n");
  expect_refused(work.efree({"solve", "case.toml", "--out", ""}), "output directory is empty|--out");
  EXPECT_FALSE(fs::exists(work / "out"));
}

TEST(CommandLine, RefusesWhatOnlyTheMeshCanTell) {
  const Workspace work;
  expect_refused(solve_with(work, "on = \"right\"", "on = \"rigt\""),
                 "^error: case.toml:25: .*rigt.*bottom.*left.*right.*top");
  expect_refused(solve_with(work, "at = [2.0, 0.5]", "at = [2.1, 0.5]"),
                 "^error: case.toml:32: .*2.1.*outside the body");
  expect_refused(solve_with(work, "mesh_size = 0.1", "parameters = { lenght = 3 }"),
                 "^error: case.toml:3: .*lenght.*length");
  expect_refused(solve_with(work, "mesh_size = 0.1", "slits = [\"crack\"]"), "^error: case.toml:3: .*crack");
  expect_refused(solve_with(work, "traction = [\"1\", \"0\"]", "traction = [\"1/(y - y)\", \"0\"]"),
                 "^error: case.toml:26: expression \"1/\\(y - y\\)\" is inf at \\(2, ");
  EXPECT_FALSE(fs::exists(work / "out"));
}

TEST(CommandLine, NamesTheRigidMotionLeftFree) {
  const Workspace work;
  expect_refused(
      solve_with(work, "on = \"bottom\"\ndisplacement = [\"free\", \"0*x\"]", "on = \"bottom\"\npressure = 1"),
      "^error: case.toml: .*translation.*y");
  expect_refused(solve_with(work, "on = \"left\"\ndisplacement = [0, \"free\"]", "on = \"left\"\npressure = 1"),
                 "^error: case.toml: .*translation.*x");
}

TEST(CommandLine, RefusesADirectoryItCannotWriteTo) {
  const Workspace work;
  work.write("out", "a file");
  expect_refused(work.efree(solve_here), "^error: cannot create the output directory out");
  EXPECT_EQ(content(work / "out"), "a file");
}

TEST(CommandLine, ARunThatFailsLeavesOldResultsAlone) {
  const Workspace work;
  fs::create_directory(work / "out");
  work.write("out/result.json", "old");
  EXPECT_EQ(solve_with(work, "nu = 0.3", "nu = 0.5").status, 2);
  EXPECT_EQ(solve_with(work, "on = \"right\"", "on = \"rigt\"").status, 2);
  EXPECT_EQ(content(work / "out/result.json"), "old");
  EXPECT_EQ(std::distance(fs::directory_iterator(work / "out"), fs::directory_iterator{}), 1);
}

TEST(CommandLine, ARunThatIsStoppedLeavesNothingBehind) {
  const Workspace work(replaced(strip_case, "mesh_size = 0.1", "mesh_size = 0.004"));
  const std::string stop = std::string("\"") + EFREE_PROGRAM +
                           "\" solve case.toml --out $0 --quiet & p=$!; while ! ls -d $0/.efree-* >/dev/null 2>&1; do "
                           "sleep 0.02; done; sleep 0.1; kill -TERM $p; wait $p";
  fs::create_directory(work / "old");
  work.write("old/result.json", "old");
  for (const char* out : {"new", "old"}) {
    std::string output;
    EXPECT_EQ(run_program(work / "", {"/bin/sh", "-c", stop, out}, &output), 128 + 15) << output;
  }
  EXPECT_FALSE(fs::exists(work / "new"));
  EXPECT_EQ(content(work / "old/result.json"), "old");
  EXPECT_EQ(std::distance(fs::directory_iterator(work / "old"), fs::directory_iterator{}), 1);
}

TEST(CommandLine, SaysWhyTheNumbersFailed) {
  const Workspace work;
  work.write("case.toml", replaced(strip_case, "[\"1\", \"0\"]", "[\"1e305\", \"0\"]"));  // too large for products
  const auto run = work.efree(solve_here);
  EXPECT_EQ(run.status, 3) << run.output;
  const auto failure = json(work / "out/failure.json");
  EXPECT_EQ(failure["status"], "failed");
  EXPECT_EQ(failure["stage"], "solve");
  EXPECT_NE(run.output.find(failure["reason"].get<std::string>()), std::string::npos);
  EXPECT_FALSE(fs::exists(work / "out/result.json"));
}

TEST(CommandLine, LoadsWhoseProductsAreNoNumbersAreRefusedHoweverSmall) {
  const Workspace work;
  work.write("case.toml", replaced(strip_case, "[\"1\", \"0\"]", "[\"1e-170\", \"0\"]"));
  const auto run = work.efree(solve_here);
  EXPECT_EQ(run.status, 3) << run.output;
  EXPECT_NE(run.output.find("too small"), std::string::npos) << run.output;
  work.write("case.toml", replaced(strip_case, "[\"1\", \"0\"]", "[\"1e-140\", \"0\"]"));
  ASSERT_EQ(work.efree(solve_here).status, 0);
  EXPECT_NEAR(json(work / "out/result.json")["extremes"]["von_mises"]["value"].get<double>() / 1e-140, 1.0, 1e-9);
}

TEST(CommandLine, TensionOfAStripComesOutExactly) {
  for (const char* kind : {"mls", "p1", "p2"}) {
    const Workspace work(strip_case, "Räume mit Löchern");
    const auto run = solve_with(work, "kind = \"mls\"", std::string("kind = \"") + kind + "\"");
    ASSERT_EQ(run.status, 0) << run.output;
    EXPECT_EQ(run.output, "");
    const auto result = json(work / "out/result.json");
    for (const char* count : {"fine_vertices", "fine_cells", "nodes", "quadrature_points"})
      EXPECT_GT(result["counts"][count], 0) << count;
    for (const char* error : {"l2_displacement", "energy_norm", "energy_norm_recovered"})
      EXPECT_LT(result["errors"][error], 1e-10) << error;
    EXPECT_NEAR(result["strain_energy"], 1.0, 1e-10);
    const auto& probe = result["probes"]["end"];
    EXPECT_NEAR(probe["displacement"][0], 2.0, 1e-10);
    EXPECT_NEAR(probe["displacement"][1], -0.15, 1e-10);
    EXPECT_NEAR(probe["strain"][1], -0.3, 1e-10);
    EXPECT_NEAR(probe["stress"][0], 1.0, 1e-10);
    double total = 0.0;
    for (const auto& [stage, seconds] : result["seconds"].items())
      if (stage != "total") total += seconds.get<double>();
    EXPECT_NEAR(result["seconds"]["total"], total, 1e-9);
    for (const char* stage : {"mesh", "basis", "quadrature", "assembly", "solve", "output"})
      EXPECT_TRUE(result["seconds"].contains(stage)) << stage;
    EXPECT_GT(result["peak_memory_mb"], 1.0);
    EXPECT_GE(result["threads"], 1);
    EXPECT_EQ(result["version"], "0.1.0");
  }
}

TEST(CommandLine, TheResultSaysWhichInterpolationAndRatioWereUsed) {
  const Workspace work;
  const auto reports_with = [&](const std::string& line) {
    const auto run = solve_with(work, "basis = \"cells\"", line);
    EXPECT_EQ(run.status, 0) << run.output;
    const auto result = json(work / "out/result.json");
    if (result["reports"].contains("ratio_reached")) {
      EXPECT_NEAR(result["reports"]["ratio_reached"],
                  result["counts"]["quadrature_points"].get<double>() / result["counts"]["nodes"].get<double>(), 1e-12);
    }
    return result["reports"];
  };
  auto reports = reports_with("basis = \"cells\"");
  EXPECT_EQ(reports["interpolation"], 2);  // the default on a mesh as coarse as this
  EXPECT_EQ(reports["ratio_asked"], 4.0);
  EXPECT_NEAR(reports["ratio_reached"], 4.0, 0.4);
  reports = reports_with("basis = \"mls\"\nratio = 3");
  EXPECT_EQ(reports["ratio_asked"], 3.0);
  EXPECT_NEAR(reports["ratio_reached"], 3.0, 0.3);
  EXPECT_FALSE(reports_with("basis = \"full\"").contains("ratio_asked"));
}

TEST(CommandLine, WarnsOfAQuadratureWithTooFewPoints) {
  const Workspace work;
  const auto run = solve_with(work, "basis = \"cells\"", "basis = \"cells\"\nratio = 1.2");
  ASSERT_EQ(run.status, 0) << run.output;
  EXPECT_TRUE(std::regex_search(run.output, std::regex("^warning: M/N = [0-9.]+: under 1.4 .* too soft\n$")))
      << run.output;
  const auto warnings = json(work / "out/result.json")["reports"]["warnings"];
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_EQ(run.output, "warning: " + warnings[0].get<std::string>() + "\n");
  ASSERT_EQ(solve_with(work, "basis = \"cells\"", "basis = \"cells\"\nratio = 2").status, 0);
  EXPECT_TRUE(json(work / "out/result.json")["reports"]["warnings"].empty());
}

TEST(CommandLine, NodesOfQuadraticElementsAreCounted) {
  const Workspace work;
  ASSERT_EQ(solve_with(work, "kind = \"mls\"", "kind = \"p2\"").status, 0);
  const auto counts = json(work / "out/result.json")["counts"];
  // Euler: edges = vertices + cells - 1 on a body without holes; a node at each vertex and edge.
  EXPECT_EQ(counts["nodes"], 2 * counts["fine_vertices"].get<int>() + counts["fine_cells"].get<int>() - 1);
}

TEST(CommandLine, FieldsCanBeReadByVtk) {
  for (const auto& [basis, cell_type] : {std::pair("kind = \"mls\"\ninterpolation = 1", VTK_TRIANGLE),
                                         {"kind = \"mls\"", VTK_QUADRATIC_TRIANGLE},
                                         {"kind = \"p2\"", VTK_QUADRATIC_TRIANGLE}}) {
    const Workspace work;
    ASSERT_EQ(solve_with(work, "kind = \"mls\"", basis).status, 0);
    vtkNew<vtkXMLUnstructuredGridReader> reader;
    const std::string file = (work / "out/fields.vtu").string();
    reader->SetFileName(file.c_str());
    reader->Update();
    vtkUnstructuredGrid* grid = reader->GetOutput();
    ASSERT_GT(grid->GetNumberOfCells(), 0);
    EXPECT_EQ(grid->GetCellType(0), cell_type);
    vtkDataArray *u = grid->GetPointData()->GetArray("displacement"),
                 *stress = grid->GetPointData()->GetArray("stress"), *strain = grid->GetPointData()->GetArray("strain"),
                 *mises = grid->GetPointData()->GetArray("von_mises");
    ASSERT_TRUE(u && stress && strain && mises);
    EXPECT_STREQ(stress->GetComponentName(2), "zz");
    EXPECT_STREQ(stress->GetComponentName(3), "xy");
    for (vtkIdType p = 0; p < grid->GetNumberOfPoints(); ++p) {
      ASSERT_NEAR(u->GetComponent(p, 0), grid->GetPoint(p)[0], 1e-10);
      ASSERT_NEAR(u->GetComponent(p, 1), -0.3 * grid->GetPoint(p)[1], 1e-10);
      ASSERT_FLOAT_EQ(stress->GetComponent(p, 0), 1.0);  // these are written in single precision
      ASSERT_FLOAT_EQ(strain->GetComponent(p, 1), -0.3);
      ASSERT_FLOAT_EQ(mises->GetComponent(p, 0), 1.0);
    }
    // A quadratic triangle's point 3 + i lies in the middle of its edge (i, i + 1).
    for (vtkIdType c = 0; cell_type == VTK_QUADRATIC_TRIANGLE && c < grid->GetNumberOfCells(); ++c) {
      const vtkIdType* points = nullptr;
      vtkIdType size = 0;
      grid->GetCellPoints(c, size, points);
      ASSERT_EQ(size, 6);
      for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 2; ++k)
          ASSERT_NEAR(grid->GetPoints()->GetData()->GetComponent(points[3 + i], k),
                      0.5 * (grid->GetPoints()->GetData()->GetComponent(points[i], k) +
                             grid->GetPoints()->GetData()->GetComponent(points[(i + 1) % 3], k)),
                      1e-12);
    }
  }
}

TEST(CommandLine, ThreadsDoNotChangeABit) {
  const Workspace work(replaced(strip_case, "traction = [\"1\", \"0\"]", "traction = [\"y^2\", \"sin(y)\"]"));
  for (const char* threads : {"1", "2"})
    ASSERT_EQ(
        work.efree({"solve", "case.toml", "--out", threads, "--threads", threads, "--quiet", "--no-picture"}).status,
        0);
  auto one = json(work / "1/result.json"), two = json(work / "2/result.json");
  EXPECT_EQ(one["threads"], 1);
  EXPECT_EQ(two["threads"], 2);
  for (auto* result : {&one, &two})
    for (const char* key : {"threads", "seconds", "peak_memory_mb", "bytes_per_fine_vertex"}) result->erase(key);
  EXPECT_EQ(one, two);
  EXPECT_EQ(content(work / "1/fields.vtu"), content(work / "2/fields.vtu"));
}

TEST(CommandLine, StagesAreToldLineByLineWhereNobodyWatches) {
  const Workspace work;
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  for (const char* stage :
       {"mesh", "cloud", "weights", "basis", "quadrature", "assembly", "solve", "correction", "output"})
    EXPECT_TRUE(std::regex_search(run.output, std::regex(std::string("(^|\n)") + stage + " +[0-9.]+ s\n")))
        << run.output;
  EXPECT_EQ(run.output.find("weights"), run.output.rfind("weights")) << run.output;
  EXPECT_EQ(run.output.find('\r'), std::string::npos);
}

TEST(CommandLine, PicturesNeedNoDisplayAndAreTheSameOnAnyNumberOfThreads) {
  const Workspace work;
  // Neither a display nor, on this PATH, anything that could make one.
  std::string output;
  const int status = run_program(
      work / "",
      {"/usr/bin/env", "-u", "DISPLAY", "PATH=/nowhere", EFREE_PROGRAM, "solve", "case.toml", "--out", "out"}, &output);
  EXPECT_EQ(status, 0) << output;
  ASSERT_EQ(work.efree({"solve", "case.toml", "--out", "one", "--threads", "1", "--quiet"}).status, 0);
  for (const char* name : {"fields.png", "error.png"}) {
    const std::string picture = content(work / "out" / name);
    EXPECT_TRUE(picture.starts_with("\x89PNG\r\n")) << name;
    EXPECT_GT(picture.size(), 10000u) << name;
    EXPECT_EQ(content(work / "one" / name), picture) << name;
  }
}

TEST(CommandLine, ConvergenceReportsOrdersAndDrawsCharts) {
  const Workspace work;
  const std::string plate = std::string(EFREE_EXAMPLES) + "/plate_with_hole/case.toml";
  const auto run = work.efree({"convergence", plate, "--spacing", "0.8,0.4", "--seeds", "2", "--out", "out"});
  ASSERT_EQ(run.status, 0) << run.output;
  for (const char* said : {"\n  0 %  cells, spacing 0.8, seed 1\n", "cells, spacing 0.8, seed 2\n"})  // each once
    EXPECT_EQ(run.output.find(said), run.output.rfind(said)) << said << run.output;
  EXPECT_NE(run.output.find("cells, spacing 0.4, seed 2\n"), std::string::npos) << run.output;
  const std::string csv = content(work / "out/convergence.csv");
  EXPECT_EQ(std::ranges::count(csv, '\n'), 5);
  EXPECT_TRUE(csv.starts_with("spacing,seed,method,nodes,")) << csv;
  const auto method = json(work / "out/convergence.json")["methods"]["cells"];
  EXPECT_GT(method["orders"]["l2_displacement"], 1.5);
  EXPECT_GT(method["orders"]["energy_norm"], 0.6);
  EXPECT_EQ(method["medians"].size(), 2u);
  EXPECT_NE(run.output.find("observed orders"), std::string::npos);
  if (run.output.find("gnuplot is not installed") != std::string::npos) return;
  for (const char* chart : {"convergence", "error_against_time", "stages"})
    for (const char* type : {".svg", ".png"})
      EXPECT_GT(fs::file_size(work / ("out/" + std::string(chart) + type)), 1000u);
}

TEST(CommandLine, GradedCloudsOfAStudyAreSimilar) {
  const Workspace work;
  const std::string wall = std::string(EFREE_EXAMPLES) + "/thick_cylinder/axisymmetric.toml";
  const auto run = work.efree({"convergence", wall, "--spacing", "0.53,0.1325", "--seeds", "3", "--out", "out"});
  ASSERT_EQ(run.status, 0) << run.output;
  const auto method = json(work / "out/convergence.json")["methods"]["cells"];
  const double growth = method["medians"][1]["nodes"].get<double>() / method["medians"][0]["nodes"].get<double>();
  EXPECT_GT(growth, 6.0);  // 16 but for the boundary
  EXPECT_LT(growth, 16.0);
  EXPECT_GT(method["orders"]["energy_norm"], 1.0);
  EXPECT_LT(method["orders"]["energy_norm"], 2.0);
}

TEST(CommandLine, AComparisonEndsWithTheDefaultRatioOfItsDimension) {
  const Workspace work(R"([geometry]
shape = "box"
mesh_ratio = 2
parameters = { width = 1, depth = 1, height = 1 }
[cloud]
spacing = 1
[material]
E = 1
nu = 0.3
[[boundary]]
on = "left"
displacement = [0, 0, 0]
)");
  std::string output;
  const int status = run_program(work / "",
                                 {"/usr/bin/env", "PATH=/nowhere", EFREE_PROGRAM, "convergence", "case.toml",
                                  "--compare", "--seeds", "1", "--spacing", "0.9,0.8", "--out", "out", "--quiet"},
                                 &output);  // without charts
  ASSERT_EQ(status, 0) << output;
  const auto methods = json(work / "out/convergence.json")["methods"];
  for (const char* name : {"cells-1", "cells-2", "cells-4", "linear-1.5", "linear-2.5", "mls-1", "mls-2", "mls-4",
                           "mls-24", "full", "p1", "p2"})
    EXPECT_TRUE(methods.contains(name)) << name;
  EXPECT_EQ(methods.size(), 12u);
}

TEST(CommandLine, AStudyStartsFromTheSeedOfTheCase) {
  const Workspace work(replaced(replaced(strip_case, "seed = 1", "seed = 7"), "mesh_size = 0.1", "mesh_size = 0.2"));
  const auto run =
      work.efree({"convergence", "case.toml", "--spacing", "0.8,0.4", "--seeds", "2", "--out", "out", "--quiet"});
  ASSERT_EQ(run.status, 0) << run.output;
  const auto csv = content(work / "out/convergence.csv");
  for (const char* start : {"\n0.8,7,", "\n0.8,8,", "\n0.4,7,", "\n0.4,8,"})
    EXPECT_NE(csv.find(start), std::string::npos) << csv;
}

TEST(CommandLine, AStudyThatFailsNamesTheRunOnce) {
  const Workspace work(replaced(strip_case, "[\"1\", \"0\"]", "[\"1e305\", \"0\"]"));
  const auto run = work.efree({"convergence", "case.toml", "--spacing", "2,1", "--out", "out", "--quiet"});
  EXPECT_EQ(run.status, 3) << run.output;
  EXPECT_TRUE(run.output.starts_with("error: cells, spacing 2, seed 1: ")) << run.output;
  EXPECT_EQ(run.output.find("spacing 2"), run.output.rfind("spacing 2")) << run.output;
}

TEST(CommandLine, ATitleIsNeverRunAsACommand) {
  const Workspace work(replaced(
      replaced(strip_case, "title = \"strip\"", R"(title = "a\n! touch run\nsystem('touch run') `touch run` \\")"),
      "mesh_size = 0.1", "mesh_size = 0.2"));
  const auto run = work.efree({"convergence", "case.toml", "--spacing", "0.8,0.4", "--out", "out"});
  ASSERT_EQ(run.status, 0) << run.output;
  EXPECT_EQ(content(work / "out/charts.gp").find("touch"), std::string::npos);
  EXPECT_FALSE(fs::exists(work / "out/run"));
}

}  // namespace
}  // namespace efree::test
