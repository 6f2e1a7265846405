// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/confined/internal/confined.hpp"

#include "efree/core/internal/reading_bound.hpp"
#include "efree/core/parallel.hpp"
#include "efree/io/case/case_file.hpp"
#include "efree/io/case/inspect.hpp"
#include "efree/io/confined/internal/transfer.hpp"
#include "workspace.hpp"

#include <gmock/gmock.h>

#include <fcntl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <atomic>
#include <csignal>
#include <cstdlib>
#include <thread>

namespace efree::test {
namespace {

using internal::confined, internal::Confinement, internal::run_confined;

Confinement of(const std::string& subject) {
  return {.subject = subject, .reader = "the test's reader", .limits = {.seconds = 20.0}};
}

std::string refusal(const Confinement& confinement, const std::function<std::string()>& work) {
  try {
    run_confined(confinement, work);
  } catch (const InputError& error) {
    return error.what();
  }
  return "not refused";
}

TEST(Confined, WorkHandsItsValueBackWhateverItHolds) {
  MadeMesh<3> made;
  made.mesh.vertices = Points<3>::Random(3, 1000);
  made.mesh.cells = Cells<3>::Constant(4, 77, 5);
  made.mesh.groups = {{"left", {{0, 1, 2}, {3, 4, 5}}}, {"", {}}};
  made.mesh.regions = {1, 0};
  made.mesh.region_names = {"a", std::string("b\0c", 3)};
  made.reports = {{"cells", Index{77}}, {"size", 0.5}};
  made.remarks = {"one"};
  made.size = -0.0;
  const MadeMesh<3> got = confined(of("a mesh"), [&] { return made; });
  EXPECT_EQ(got.mesh.vertices, made.mesh.vertices);
  EXPECT_EQ(got.mesh.cells, made.mesh.cells);
  ASSERT_EQ(got.mesh.groups.size(), 2u);
  EXPECT_EQ(got.mesh.groups[0].name, "left");
  EXPECT_EQ(got.mesh.groups[0].facets, made.mesh.groups[0].facets);
  EXPECT_EQ(got.mesh.regions, made.mesh.regions);
  EXPECT_EQ(got.mesh.region_names, made.mesh.region_names);
  EXPECT_EQ(got.reports, made.reports);
  EXPECT_EQ(got.remarks, made.remarks);
  EXPECT_TRUE(std::signbit(got.size));
}

TEST(Confined, WorkHandsImagesBackWhateverTheyHold) {
  MadeImage<3> made;
  made.image = {.size = {1, 1, 2}, .spacing = {1, 2, 3}, .labels = {7, 65535}, .grey = {1.0F, -1.0F}};
  made.region_of_label = {{7, "seven"}};
  const MadeImage<3> got = confined(of("an image"), [&] { return made; });
  EXPECT_EQ(got.image.labels, made.image.labels);
  EXPECT_EQ(got.image.grey, made.image.grey);
  EXPECT_EQ(got.image.spacing, made.image.spacing);
  EXPECT_EQ(got.region_of_label, made.region_of_label);
}

TEST(Confined, BytesThatNobodyPackedAreRefusedWhereverTheyEndAndWhateverTheyCount) {
  MeshData<2> mesh;
  mesh.vertices = Points<2>::Random(2, 4);
  mesh.groups = {{"left", {{0, 1}}}};
  mesh.region_names = {"a"};
  Packer pack;
  pack(mesh);
  const std::string bytes = std::move(pack).bytes();
  for (std::size_t n = 0; n < bytes.size(); ++n) {
    MeshData<2> out;
    EXPECT_THROW(Unpacker(std::string_view(bytes).substr(0, n))(out), InputError) << n;
  }
  std::string huge = bytes;
  huge[7] = '\x7f';  // the number of vertices
  MeshData<2> out;
  EXPECT_THROW(Unpacker{huge}(out), InputError);
}

TEST(Confined, ErrorsComeBackAsTheyAreAndOthersNameTheFileAndItsReader) {
  EXPECT_EQ(refusal(of("f.x"), []() -> std::string { throw InputError("f.x:3: bad"); }), "f.x:3: bad");
  EXPECT_THROW(run_confined(of("f.x"), []() -> std::string { throw NumericalError("bad"); }), NumericalError);
  EXPECT_EQ(refusal(of("f.x"), []() -> std::string { throw std::out_of_range("index 7"); }),
            "f.x: the test's reader failed: index 7");
  EXPECT_EQ(refusal(of("f.x"), []() -> std::string { throw 7; }),
            "f.x: the test's reader failed: for a reason it does not say");
}

TEST(Confined, WorkThatDiesIsOneMessage) {
  const auto failed = [](const std::string& why) { return "f.x: the test's reader failed: " + why; };
  EXPECT_EQ(refusal(of("f.x"),
                    [] {
                      std::signal(SIGSEGV, SIG_DFL);
                      std::raise(SIGSEGV);
                      return std::string();
                    }),
            failed("it used memory that is not its own"));
  EXPECT_EQ(refusal(of("f.x"), []() -> std::string { std::abort(); }), failed("it gave up"));
  EXPECT_EQ(refusal(of("f.x"), []() -> std::string { _exit(4); }), failed("it left with status 4"));
}

TEST(Confined, WorkThatDoesNotEndIsEnded) {
  Confinement short_time = of("f.x");
  short_time.limits.seconds = 0.3;
  const auto start = std::chrono::steady_clock::now();
  EXPECT_EQ(refusal(short_time,
                    []() -> std::string {
                      while (true) std::this_thread::sleep_for(std::chrono::milliseconds(10));
                    }),
            "f.x: the test's reader failed: it was not done after 0.3 s (--mesh-time-limit)");
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(10));
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1) << "a child is left";
}

TEST(Confined, ReadersThatGoRoundForEverEndByTheLengthOfTheFile) {
  const Workspace work;
  work.write("a.brep", "short");
  Confinement automatic = of("a.brep");
  automatic.limits.seconds.reset();
  const auto spin = [&](double limit) {
    return [&, limit]() -> std::string {
      const internal::ReadingTime bound((work / "a.brep").string(), limit);
      const auto start = std::chrono::steady_clock::now();
      while (std::chrono::steady_clock::now() - start < std::chrono::seconds(limit < 1.0 ? 20 : 0)) {
      }
      return "read";
    };
  };
  EXPECT_THAT(refusal(automatic, spin(0.1)), ::testing::HasSubstr("should be read in less time: it is damaged, or"));
  EXPECT_EQ(run_confined(automatic, spin(5.0)), "read");
  // Whoever says how long it may take is believed.
  Confinement told = of("a.brep");
  told.limits.seconds = 0.5;
  EXPECT_THAT(refusal(told, spin(0.1)), ::testing::HasSubstr("not done after 0.5 s"));
}

TEST(Confined, WhoeverWaitsIsAskedAgainAndAgainAndCanEndIt) {
  int asked = 0;
  const auto sleep = [](int milliseconds) {
    std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
    return std::string("done");
  };
  const auto count = [&] { ++asked; };
  EXPECT_EQ(run_confined(
                of("f.x"), [&] { return sleep(1000); }, count),
            "done");
  EXPECT_GE(asked, 3);
  const auto start = std::chrono::steady_clock::now();
  const auto end_it = [&] { throw Cancelled("mesh"); };
  EXPECT_THROW(run_confined(
                   of("f.x"), [&] { return sleep(15000); }, end_it),
               Cancelled);
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(10));
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1) << "a child is left";
}

TEST(Confined, MeshingThatTakesLongIsToldOfAndCanBeCancelled) {
  const Workspace work;
  auto analysis = std::get<Case<2>>(read_case(work / "case.toml"));
  analysis.geometry.size = 1e-3;  // millions of cells
  int told = 0, asked = 0;
  const Monitor monitor{.progress = [&](const std::string& stage, double) { told += stage == "mesh"; },
                        .cancelled = [&] { return ++asked > 4; }};
  try {
    prepare(analysis, monitor);
    ADD_FAILURE() << "not cancelled";
  } catch (const Cancelled& cancelled) {
    EXPECT_EQ(cancelled.stage, "mesh");
  }
  EXPECT_EQ(told, 5) << "its beginning, three ticks, its end";
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1) << "a child is left";
}

TEST(Confined, FilesThatAreReadForTheirDimensionAreAStage) {
  const Workspace work;
  std::vector<std::string> stages;
  const Monitor monitor{.progress = [&](const std::string& stage, double) { stages.push_back(stage); }};
  read_case(work / "case.toml", {}, monitor);
  ASSERT_FALSE(stages.empty());
  EXPECT_EQ(stages.front(), "read");
  stages.clear();
  inspect(work / "strip.geo", {}, monitor);
  ASSERT_FALSE(stages.empty());
  EXPECT_EQ(stages.front(), "inspect");
}

#if !defined(__SANITIZE_ADDRESS__)
TEST(Confined, WorkThatTakesMoreMemoryThanThereIsIsOneMessage) {
  EXPECT_EQ(refusal(of("f.x"),
                    []() -> std::string {
                      std::vector<std::unique_ptr<char[]>> all;
                      while (true) all.emplace_back(new char[std::size_t{1} << 28U]);
                    }),
            "f.x: the test's reader failed: it needs more memory than there is");
}
#endif

/// What is asked of the system by one who means harm; each returns 0 or more if it is let.
std::map<std::string, std::function<long()>> harms(const fs::path& folder, pid_t parent) {
  const std::string file = folder / "strip.geo", fresh = folder / "new";
  return {{"write a file", [=] { return open(file.c_str(), O_WRONLY); }},
          {"read and write a file", [=] { return open(file.c_str(), O_RDWR); }},
          {"append to a file", [=] { return open(file.c_str(), O_WRONLY | O_APPEND); }},
          {"make a file", [=] { return open(fresh.c_str(), O_RDONLY | O_CREAT, 0600); }},
          {"empty a file", [=] { return truncate(file.c_str(), 0); }},
          {"empty a file by opening it", [=] { return open(file.c_str(), O_RDONLY | O_TRUNC); }},
          {"remove a file", [=] { return unlink(file.c_str()); }},
          {"rename a file", [=] { return rename(file.c_str(), fresh.c_str()); }},
          {"make a folder", [=] { return mkdir(fresh.c_str(), 0700); }},
          {"make a link", [=] { return symlink(file.c_str(), fresh.c_str()); }},
          {"change rights", [=] { return chmod(file.c_str(), 0777); }},
          {"start a process", [] { return fork(); }},
          {"start a program", [] { return execl("/bin/true", "true", nullptr); }},
          {"run a command", [] { return std::system("true") == 0 ? 0L : -1L; }},
          {"reach the network", [] { return socket(AF_INET, SOCK_STREAM, 0); }},
          {"end its parent", [=] { return kill(parent, 0); }}};
}

TEST(Confined, WorkCanReadFilesAndNothingElse) {
  const Workspace work;
  const fs::path folder = work / "";
  for (const auto& [name, harm] : harms(folder, getpid())) {
    const std::string got = run_confined(of("f.x"), [&, harm = harm] { return std::to_string(harm()); });
    EXPECT_EQ(got, "-1") << name;
  }
  EXPECT_EQ(content(folder / "strip.geo"), strip_geo);
  EXPECT_FALSE(fs::exists(folder / "new"));
  EXPECT_EQ(run_confined(of("f.x"), [&] { return content(folder / "strip.geo"); }), strip_geo);
}

TEST(Confined, TrustedWorkMayDoWhatItsParentMay) {
  const Workspace work;
  Confinement trusted = of("f.x");
  trusted.limits.trust = true;
  run_confined(trusted, [&] {
    work.write("new", "text");
    return std::string();
  });
  EXPECT_EQ(content(work / "new"), "text");
}

TEST(Confined, WorkHasAllThreadsAlsoAfterItsParentUsedThem) {
  if (std::thread::hardware_concurrency() < 2) GTEST_SKIP() << "one core";
  set_num_threads(2);
  /// Whether two chunks were under way at once, each waiting for the other (not for ever).
  const auto two_at_once = [] {
    std::atomic<int> there = 0;
    std::atomic<int> met = 0;
    parallel_chunks(2, 1, [&](Index, Index) {
      ++there;
      for (int k = 0; k < 2000 && there < 2; ++k) std::this_thread::sleep_for(std::chrono::milliseconds(1));
      met += there == 2;
    });
    return met == 2;
  };
  ASSERT_TRUE(two_at_once());
  for (int k = 0; k < 3; ++k) {
    EXPECT_EQ(run_confined(of("f.x"), [&] { return std::string(two_at_once() ? "yes" : "no"); }), "yes");
    EXPECT_TRUE(two_at_once());
  }
}

TEST(Confined, MeshesOfCasesAreTheSameAsWithoutAProcessOfTheirOwn) {
  const Workspace work;
  const auto analysis = std::get<Case<2>>(read_case(work / "case.toml"));
  const MadeMesh<2> first = analysis.geometry.mesh({.length = 0.1}, {"mesh", {}});
  const MadeMesh<2> second = confined(of("f.x"), [&] { return analysis.geometry.mesh({.length = 0.1}, {"mesh", {}}); });
  EXPECT_GT(first.mesh.cells.cols(), 100);
  EXPECT_EQ(first.mesh.vertices, second.mesh.vertices);
  EXPECT_EQ(first.mesh.cells, second.mesh.cells);
}

}  // namespace
}  // namespace efree::test
