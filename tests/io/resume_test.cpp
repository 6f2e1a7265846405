// SPDX-License-Identifier: GPL-3.0-or-later
/// Runs through time that are killed, or end, and go on: --resume; fields of every step.
#include "efree/core/error.hpp"
#include "efree/io/records/path_record.hpp"
#include "efree/tests/io/workspace.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

namespace efree {
namespace {

using test::content, test::json, test::replaced, test::Workspace;
using ::testing::HasSubstr, ::testing::ThrowsMessage;
namespace fs = std::filesystem;

/// A metal strip that is pulled past yield and let go: histories, loads that turn, changing steps.
const std::string metal = R"toml([geometry]
shape = "rectangle"
parameters = { width = 2, height = 1 }
mesh_size = 0.12
[cloud]
spacing = 0.25
[analysis]
plane = "strain"
[material]
model = "j2"
E = 1
nu = 0.3
yield = "0.01 + 0.25*a"
[time]
step = 0.025
max_step = 0.05
output = 5
[[boundary]]
on = "left"
displacement = [0, 0]
[[boundary]]
on = "right"
displacement = ["0.06*(1 - abs(1 - 2*t))", "0.02*t"]
[[probe]]
name = "end"
at = [2, 1]
)toml";

/// Bears no more than 1/e: by arc length past that, until there have been enough steps.
const std::string arc = R"toml([geometry]
shape = "rectangle"
parameters = { width = 2, height = 1 }
mesh_size = 0.12
[cloud]
spacing = 0.25
[analysis]
plane = "strain"
[material]
model = "hencky"
E = 1
nu = 0
[time]
step = 0.1
max_step = 0.1
max_steps = 24
control = "arc_length"
[[boundary]]
on = "left"
normal_displacement = 0
[[boundary]]
on = "bottom"
normal_displacement = 0
[[boundary]]
on = "right"
traction = [1, 0]
)toml";

/// Rubber that linear elasticity is enough for at first: the full model takes all of its steps again.
const std::string rubber = replaced(
    replaced(replaced(replaced(metal, "model = \"j2\"", "model = \"neo_hookean\""), "yield = \"0.01 + 0.25*a\"\n", ""),
             "output = 5", "output = 2"),
    "\"0.06*(1 - abs(1 - 2*t))\"", "\"0.04*t\"");

std::vector<std::string> solve(const std::string& out, bool resume = false, const char* threads = "1") {
  std::vector<std::string> words{"solve", "case.toml", "--out", out, "--no-picture", "--threads", threads};
  if (resume) words.emplace_back("--resume");
  return words;
}

/// Runs the case and kills it once history.csv has this many lines. Whether it was still there.
bool killed(const Workspace& work, const std::string& out, int lines, bool resume = false) {
  const std::string script = fmt::format(
      "\"{}\" solve case.toml --out {} --no-picture --quiet --threads 1 {} & p=$!\n"
      "while kill -0 $p 2>/dev/null && [ $(cat {}/unfinished/history.csv 2>/dev/null | wc -l) -lt {} ]; do sleep 0.01; "
      "done\n"
      "kill -KILL $p; wait $p",
      EFREE_PROGRAM, out, resume ? "--resume" : "", out, lines);
  std::string output;
  return run_program(work / "", {"/bin/sh", "-c", script}, &output) == 128 + 9;
}

/// But for times and memory.
nlohmann::json numbers(const fs::path& folder) {
  auto all = json(folder / "result.json");
  for (const char* key : {"seconds", "peak_memory_mb", "bytes_per_fine_vertex", "threads"}) all.erase(key);
  return all;
}

void expect_same_files(const fs::path& a, const fs::path& b) {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(a)) names.push_back(entry.path().filename());
  EXPECT_EQ(names.size(), std::distance(fs::directory_iterator(b), fs::directory_iterator{}));
  EXPECT_GE(names.size(), 5u);
  for (const auto& name : names) {
    ASSERT_TRUE(fs::exists(b / name)) << name;
    EXPECT_TRUE(name == "result.json" || content(a / name) == content(b / name)) << name;
  }
}
void expect_same(const fs::path& a, const fs::path& b) {
  expect_same_files(a, b);
  EXPECT_EQ(numbers(a), numbers(b));
}

TEST(Resume, AKilledRunGoesOnToTheSameEndBitForBit) {
  for (const std::string& text : {metal, rubber, arc}) {
    const Workspace work(text);
    const int status = text == arc ? 3 : 0;
    const auto whole = work.efree(solve("whole", false, "2"));
    ASSERT_EQ(whole.status, status) << whole.output;
    EXPECT_FALSE(fs::exists(work / "whole/unfinished"));
    int in_time = 0;
    for (const int lines : {2, 7, 12}) {
      const bool in_between = killed(work, "out", lines, in_time > 0) && !fs::exists(work / "out/result.json");
      if (!in_between) break;  // it was done before
      ++in_time;
      EXPECT_THAT(content(work / "out/unfinished/history.csv"), HasSubstr("t,iterations"));
    }
    ASSERT_GT(in_time, 0);
    const auto run = work.efree(solve("out", true));
    EXPECT_EQ(run.status, status) << run.output;
    EXPECT_THAT(run.output, HasSubstr("goes on from step"));
    expect_same(work / "whole", work / "out");
  }
}

/// Runs the case up to a call of Steps::done, or to its end. Of each call, whether linear elasticity was enough so far.
std::vector<bool> run_up_to(std::size_t calls, const Workspace& work, const std::string& out, bool resume = false) {
  struct Killed {};
  auto analysis = std::get<Case<2>>(read_case(work / "case.toml"));
  fs::create_directory(work / out);
  PathRecord<2> record(work / out, analysis);
  std::vector<bool> linear;
  analysis.steps.done = [&](const Checkpoint<2>& there, const Result<2>& so_far) {
    record.keep(there, so_far);
    linear.push_back(there.agreed.has_value());
    if (linear.size() == calls) throw Killed{};
  };
  if (resume) analysis.steps.from = record.resume();
  try {
    analyse(analysis);
  } catch (const Killed&) {
  }
  return linear;
}

TEST(Resume, LinearElasticityAndTheFullModelAreGoneOnWithBitForBit) {
  constexpr std::size_t never = 0;
  for (const std::string& text : {metal, rubber, replaced(metal, "0.01 + 0.25*a", "1 + a")}) {
    const Workspace work(text);
    const std::vector<bool> linear = run_up_to(never, work, "whole");
    const auto taken_over = static_cast<std::size_t>(std::ranges::count(linear, true));
    ASSERT_GT(taken_over, 2u);
    EXPECT_TRUE(std::ranges::is_sorted(linear, std::greater<>())) << "once the full model is taken it stays";
    EXPECT_EQ(linear.back(), text != metal && text != rubber);
    for (const std::size_t calls : {std::size_t{1}, taken_over, taken_over + 1, linear.size() - 1}) {
      const std::string out = fmt::format("out{}", calls);
      run_up_to(calls, work, out);
      run_up_to(1, work, out, true);
      run_up_to(never, work, out, true);
      expect_same_files(work / "whole/unfinished", work / out / "unfinished");
    }
  }
}

TEST(Resume, FieldsOfStepsAreASeriesThatNamesTheirTimes) {
  const Workspace work(metal);
  ASSERT_EQ(work.efree(solve("out")).status, 0);
  const auto steps = json(work / "out/result.json")["path"]["steps"].get<int>();
  const std::string series = content(work / "out/fields.pvd");
  for (int step = 1; step <= steps; ++step) {
    const std::string name = fmt::format("fields_{:04}.vtu", step);
    EXPECT_EQ(fs::exists(work / "out" / name), step % 5 == 0) << name;
    EXPECT_EQ(series.find(name) != std::string::npos, step % 5 == 0) << name;
  }
  std::istringstream lines(content(work / "out/history.csv"));
  std::string line;
  for (int k = 0; k <= 5; ++k) std::getline(lines, line);
  EXPECT_THAT(series, HasSubstr(fmt::format("timestep=\"{}\" part=\"0\" file=\"fields_0005.vtu\"",
                                            line.substr(0, line.find(',')))));
  work.write("case.toml", replaced(metal, "output = 5", "output = \"last\""));
  ASSERT_EQ(work.efree(solve("out")).status, 0);
  EXPECT_FALSE(fs::exists(work / "out/fields.pvd"));
  EXPECT_FALSE(fs::exists(work / "out/fields_0005.vtu")) << "of an earlier run";
  work.write("case.toml", replaced(metal, "output = 5", "output = \"each\""));
  EXPECT_THAT(work.efree(solve("out")).output, HasSubstr("case.toml:17: output is \"each\""));
}

TEST(Resume, ARunThatEndedWritesItsResultsAgainOrGoesFurther) {
  const Workspace work(replaced(metal, "output = 5", "output = \"all\""));
  ASSERT_EQ(work.efree(solve("whole")).status, 0);
  fs::copy(work / "whole", work / "out");
  ASSERT_EQ(work.efree(solve("out", true)).status, 0);
  expect_same(work / "whole", work / "out");
  // In two runs, the first of which comes to an earlier end.
  work.write("case.toml", replaced(metal, "step = 0.025", "end = 0.5\nstep = 0.025"));
  ASSERT_EQ(work.efree(solve("two")).status, 0);
  work.write("case.toml", replaced(metal, "step = 0.025", "end = 1.0\nstep = 0.025"));
  const auto run = work.efree(solve("two", true));
  ASSERT_EQ(run.status, 0) << run.output;
  EXPECT_EQ(json(work / "two/result.json")["path"]["time"], 1.0);
  EXPECT_TRUE(fs::exists(work / "two/fields_0005.vtu")) << "of the first";
}

TEST(Resume, ARunThatStoppedTriesAgainWithOtherSteps) {
  const Workspace work(replaced(arc, "max_steps = 24\ncontrol = \"arc_length\"", "min_step = 0.01"));
  ASSERT_EQ(work.efree(solve("out")).status, 3);
  const auto stopped = json(work / "out/result.json")["path"];
  const auto again = work.efree(solve("out", true));
  EXPECT_EQ(again.status, 3) << "nothing has changed";
  EXPECT_EQ(json(work / "out/result.json")["path"], stopped);
  work.write("case.toml", arc);
  EXPECT_EQ(work.efree(solve("out", true)).status, 3);
  const auto further = json(work / "out/result.json")["path"];
  EXPECT_EQ(further["steps"], 24);
  EXPECT_GT(further["negative_pivots"], 0) << "beyond the largest load";
}

TEST(Resume, CasesAreToldApartByAllButTheirSteps) {
  const std::string shape = "shape = \"rectangle\"\nparameters = { width = 2, height = 1 }";
  const Workspace work;
  const auto mark = [&](const std::string& text) {
    work.write("case.toml", text);
    return std::get<Case<2>>(read_case(work / "case.toml")).mark;
  };
  const CaseMark of = mark(metal);
  EXPECT_TRUE(mark("# the same\n" + metal) == of);
  EXPECT_TRUE(mark(replaced(metal, "output = 5\n", "")) == of);
  const std::string from_file = replaced(metal, shape, "file = \"strip.geo\"");
  const CaseMark of_file = mark(from_file);
  work.write("strip.geo", test::strip_geo + "Point(9) = {1, 0.5, 0};\n");
  EXPECT_NE(mark(from_file).what, of_file.what);
  EXPECT_NE(mark(replaced(metal, "nu = 0.3", "nu = 0.25")).what, of.what);
  EXPECT_EQ(mark(replaced(metal, "step = 0.025", "step = 0.02")).what, of.what);
  EXPECT_NE(mark(replaced(metal, "step = 0.025", "step = 0.02")).how, of.how);
  EXPECT_TRUE(mark(replaced(metal, "step = 0.025", "step = 0.025\nend = 2")) == of);
  EXPECT_NE(mark(arc).what, mark(replaced(arc, "step = 0.1", "step = 0.1\nend = 2")).what)
      << "loads in proportion to time are others";
}

TEST(Resume, CheckpointsComeBackBitForBitOrNotAtAll) {
  const Workspace work;
  Checkpoint<2> there{PathPoint({Vector::Random(37), Vector::Random(11), 0.1, 0.2, 0.3}), {}, 12345};
  there.at.steps = 2;
  there.at.next = 0.7;
  there.at.came_by = Vector::Random(5);
  there.at.remembered = Vector::Random(11);
  there.at.began = -0.1;
  there.at.lasted = 0.05;
  HistoryStep<2> step{};
  step.time = 1.0 / 3.0;
  step.reactions["left"].force = Vec<2>(1.0, 2.0);
  step.probes = {Vec<2>(3.0, 4.0)};
  there.history = {step, step};
  there.linear_checks = {{.time = 0.1, .enough = true, .displacement = 0.2, .stress = 0.3, .overload = 1.5},
                         {.strain = 0.4, .rotation = 0.5, .negative_pivots = 2, .same = true, .failure = "why"}};
  there.agreed = PathPoint({Vector::Random(37), Vector(), 0.05, 0.1, 0.2});
  there.agreed->steps = 1;
  there.agreed->next = 0.6;
  there.mode = Vector::Random(37);
  write_checkpoint(work / "a.state", there, {1, 2});
  const auto back = read_checkpoint<2>(work / "a.state", {1, 2});
  EXPECT_TRUE(back.at == there.at);
  EXPECT_EQ(back.body, there.body);
  ASSERT_EQ(back.history.size(), 2u);
  EXPECT_EQ(back.history[1].time, step.time);
  EXPECT_EQ(back.history[1].reactions.at("left").force, Vec<2>(1.0, 2.0));
  EXPECT_EQ(back.history[1].probes, step.probes);
  EXPECT_EQ(back.linear_checks, there.linear_checks);
  EXPECT_TRUE(back.agreed == there.agreed);
  EXPECT_EQ(back.mode, there.mode);
  const auto others = read_checkpoint<2>(work / "a.state", {1, 3});
  EXPECT_EQ(others.at.next, 0.0) << "the steps are others";
  EXPECT_EQ(others.agreed->next, 0.0);
  const auto refuses = [&](const std::string& why) {
    EXPECT_THAT([&] { read_checkpoint<2>(work / "a.state", {1, 2}); }, ThrowsMessage<InputError>(HasSubstr(why)));
  };
  EXPECT_THAT(
      [&] {
        read_checkpoint<2>(work / "a.state", {2, 2});
      },
      ThrowsMessage<InputError>(HasSubstr("another case")));
  EXPECT_THAT(
      [&] {
        read_checkpoint<3>(work / "a.state", {1, 2});
      },
      ThrowsMessage<InputError>(HasSubstr("another case")));
  const std::string whole = content(work / "a.state");
  for (double* number :
       {&there.at.u[3], &there.at.history[2], &there.history[0].stored, &there.history[1].probes[0][1]}) {
    const double before = std::exchange(*number, std::nan(""));
    write_checkpoint(work / "a.state", there, {1, 2});
    refuses("damaged");
    *number = before;
  }
  for (std::size_t k = 0; k < whole.size(); k += 7) {
    work.write("a.state", whole.substr(0, k));
    refuses("");
    std::string turned = whole;
    turned[k] = static_cast<char>(turned[k] ^ 4);
    work.write("a.state", turned);
    refuses("");
  }
  work.write("a.state", whole + "x");
  refuses("damaged");
  fs::remove(work / "a.state");
  refuses("cannot be read");
}

TEST(Resume, WhatCannotBeGoneOnWithIsRefused) {
  const Workspace work(replaced(metal, "step = 0.025", "end = 0.1\nstep = 0.025"));
  const auto refused = [&](const std::string& out) {
    const auto run = work.efree(solve(out, true));
    EXPECT_EQ(run.status, 2) << run.output;
    return run.output;
  };
  EXPECT_THAT(refused("none"), HasSubstr("there are no steps of an earlier run to resume"));
  EXPECT_FALSE(fs::exists(work / "none"));
  ASSERT_EQ(work.efree(solve("out")).status, 0);
  work.write("case.toml", replaced(metal, "nu = 0.3", "nu = 0.25"));
  EXPECT_THAT(refused("out"), HasSubstr("these steps are of another case"));
  EXPECT_EQ(json(work / "out/result.json")["path"]["time"], 0.1) << "what was there stays";
}

}  // namespace
}  // namespace efree
