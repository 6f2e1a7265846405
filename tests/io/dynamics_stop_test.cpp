// SPDX-License-Identifier: GPL-3.0-or-later
/// Runs of explicit dynamics that are stopped or killed, and go on.
#include "efree/tests/io/dynamics_cases.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <set>

namespace efree {
namespace {

using test::between_rigid_bodies, test::column, test::content, test::json, test::names_in, test::refuses,
    test::replaced, test::rubber, test::run, test::with, test::Workspace;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

/// Of many steps, with a checkpoint every hundredth of a second.
std::string long_run() {
  return replaced(replaced(replaced(rubber, "mesh_size = 0.25", "mesh_size = 0.1"), "end = 4", "end = 12"),
                  "frames = 3\nhistory = 20", "frames = 12\nhistory = 300\ncheckpoint = 0.01");
}

/// Runs it, and sends a signal once history.csv has this many lines. The status it ends with.
int stopped(const Workspace& work, const std::string& out, int lines, int signal, bool resume = false) {
  const std::string script = fmt::format(
      "\"{}\" run case.toml --out {} --no-picture --quiet --threads 1 {} & p=$!\n"
      "while kill -0 $p 2>/dev/null && {{ [ ! -e {}/unfinished/dynamics.state ] || "
      "[ $(cat {}/unfinished/history.csv 2>/dev/null | wc -l) -lt {} ]; }}; do sleep 0.01; done\n"
      "kill -{} $p; wait $p",
      EFREE_PROGRAM, out, resume ? "--resume" : "", out, out, lines, signal);
  std::string output;
  return run_program(work / "", {"/bin/sh", "-c", script}, &output);
}

/// But for the clock.
nlohmann::json numbers(const fs::path& folder) {
  auto all = json(folder / "result.json");
  for (const char* key : {"seconds", "shares", "peak_memory_mb", "threads"}) all.erase(key);
  return all;
}

void expect_same(const fs::path& a, const fs::path& b) {
  EXPECT_EQ(names_in(a), names_in(b));
  for (const std::string& name : names_in(a))
    EXPECT_TRUE(name == "result.json" || name == "dynamics.state" || content(a / name) == content(b / name)) << name;
  EXPECT_EQ(numbers(a), numbers(b));
}

TEST(DynamicsRun, ThatWasStoppedGoesOnToTheSameEndBitForBit) {
  const Workspace work(long_run());
  ASSERT_EQ(work.efree({"run", "case.toml", "--out", "whole", "--no-picture", "--threads", "2"}).status, 0);
  ASSERT_EQ(stopped(work, "out", 100, 9), 128 + 9) << "it was done before";
  EXPECT_FALSE(fs::exists(work / "out/result.json"));
  ASSERT_EQ(stopped(work, "out", 150, 15, true), 128 + 15) << "it was done before";
  EXPECT_EQ(names_in(work / "out"), (std::set<std::string>{"unfinished"})) << "nothing else is left behind";
  const auto done = work.efree({"run", "case.toml", "--out", "out", "--no-picture", "--resume"});
  ASSERT_EQ(done.status, 0) << done.output;
  EXPECT_THAT(done.output, HasSubstr("goes on from step"));
  expect_same(work / "whole", work / "out");
}

TEST(DynamicsRun, WithRigidBodiesGoesOnToTheSameEndBitForBitToo) {
  const Workspace work(replaced(between_rigid_bodies, "mesh_size = 0.25", "mesh_size = 0.1"));
  ASSERT_EQ(work.efree({"run", "case.toml", "--out", "whole", "--no-picture"}).status, 0);
  const auto limited = work.efree({"run", "case.toml", "--out", "out", "--no-picture", "--time-limit", "0.02"});
  EXPECT_EQ(limited.status, 3);
  ASSERT_EQ(work.efree({"run", "case.toml", "--out", "out", "--no-picture", "--resume"}).status, 0);
  expect_same(work / "whole", work / "out");
}

TEST(DynamicsRun, ATimeLimitStopsItAndAResumedOneEndsAllTheSame) {
  const Workspace work(long_run());
  ASSERT_EQ(work.efree({"run", "case.toml", "--out", "whole", "--no-picture"}).status, 0);
  const auto limited = work.efree({"run", "case.toml", "--out", "out", "--no-picture", "--time-limit", "0.05"});
  EXPECT_EQ(limited.status, 3);
  EXPECT_THAT(limited.output, HasSubstr("--resume continues it"));
  EXPECT_TRUE(fs::exists(work / "out/failure.json"));
  ASSERT_EQ(work.efree({"run", "case.toml", "--out", "out", "--no-picture", "--resume"}).status, 0);
  expect_same(work / "whole", work / "out");
  // One that ended goes further.
  work.write("case.toml", replaced(long_run(), "end = 12", "end = 13"));
  const auto further = work.efree({"run", "case.toml", "--out", "out", "--no-picture", "--resume"});
  ASSERT_EQ(further.status, 0) << further.output;
  EXPECT_EQ(json(work / "out/result.json")["time"], 13.0);
  EXPECT_EQ(column(work / "out/history.csv", "t").front(), 0.0);
}

TEST(DynamicsRun, CheckpointsOfOtherCasesAndDamagedOnesAreRefused) {
  const Workspace work(rubber);
  const auto refuses = [&](const std::string& why) {
    const auto done = work.efree({"run", "case.toml", "--out", "out", "--no-picture", "--resume"});
    EXPECT_EQ(done.status, 2) << done.output;
    EXPECT_THAT(done.output, HasSubstr(why));
  };
  refuses("no steps of an earlier run");
  ASSERT_EQ(run(work, rubber).status, 0);
  work.write("case.toml", with("density = 1", "density = 2"));
  refuses("of another case");
  work.write("case.toml", rubber + "[dynamics]\ncourant = 0.4\n");
  refuses("of another case");
  work.write("case.toml", with("end = 4", "end = 2"));
  refuses("end is 2, and the steps of the earlier run are at 4 already");
  work.write("case.toml", rubber);
  const std::string whole = content(work / "out/dynamics.state");
  for (const std::size_t at : {whole.size() / 2, whole.size() - 20}) {
    std::string damaged = whole;
    damaged[at] = static_cast<char>(damaged[at] + 1);
    work.write("out/dynamics.state", damaged);
    refuses("damaged");
  }
  work.write("out/dynamics.state", whole.substr(0, whole.size() / 2));
  refuses("damaged");
  work.write("out/dynamics.state", "other");
  refuses("expected the steps");
}

}  // namespace
}  // namespace efree
