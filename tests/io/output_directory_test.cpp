// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/files/output_directory.hpp"

#include "efree/core/error.hpp"
#include "workspace.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <csignal>
#include <set>

namespace efree::test {
namespace {

void put(const fs::path& file, const std::string& text) {
  std::ofstream(file) << text;
}

std::set<std::string> names_in(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.insert(entry.path().filename());
  return names;
}

TEST(OutputDirectory, FilesAppearTogetherAndThoseOfEarlierRunsGoWithThem) {
  const Workspace work;
  const fs::path folder = work / "out";
  {
    OutputDirectory out(folder);
    put(out.file("result.json"), "1");
    put(out.file("failure.json"), "1");
    EXPECT_FALSE(fs::exists(folder / "result.json"));
    out.commit();
  }
  {
    OutputDirectory out(folder);
    EXPECT_TRUE(out.has("failure.json"));
    put(out.file("result.json"), "2");
    out.supersede("failure.json");
    out.commit();
  }
  EXPECT_EQ(names_in(folder), std::set<std::string>{"result.json"});
  EXPECT_EQ(content(folder / "result.json"), "2");
}

TEST(OutputDirectory, ARunThatFailsLeavesEverythingAsItWas) {
  const Workspace work;
  {
    OutputDirectory out(work / "new/deep");
    put(out.file("result.json"), "1");
  }
  EXPECT_FALSE(fs::exists(work / "new"));
}

TEST(OutputDirectory, WhatKilledRunsLeftIsRemovedAndWhatTheyWereMovingIsMoved) {
  const Workspace work;
  const fs::path folder = work / "out";
  fs::create_directories(folder / ".efree-11");
  fs::create_directories(folder / ".efree-12.complete");
  put(folder / ".efree-11/result.json", "half written");
  put(folder / ".efree-12.complete/fields.vtu", "whole");
  put(folder / ".efree-12.complete/.superseded", "error.png\n");
  put(folder / "result.json", "whole");
  put(folder / "error.png", "old");
  { const OutputDirectory out(folder); }
  EXPECT_EQ(names_in(folder), (std::set<std::string>{"result.json", "fields.vtu"}));
  EXPECT_EQ(content(folder / "result.json"), "whole");
}

TEST(OutputDirectory, RunsThatGoOnAreLeftAlone) {
  const Workspace work;
  OutputDirectory first(work / "out");
  fs::rename(first.staging(), work / "out/.efree-other");  // as that of another process
  put(work / "out/.efree-other/result.json", "1");
  { const OutputDirectory second(work / "out"); }
  EXPECT_TRUE(fs::exists(work / "out/.efree-other/result.json"));
  fs::remove_all(work / "out/.efree-other");
}

TEST(OutputDirectory, RunsIntoOneDirectoryEndWithAllFilesOfOneOfThem) {
  const Workspace work;
  const fs::path folder = work / "out";
  constexpr int runs = 8, files = 20;
  for (int run = 0; run < runs; ++run)
    if (fork() == 0) {
      OutputDirectory out(folder);
      for (int k = 0; k < files; ++k) put(out.file(std::to_string(k)), std::to_string(run));
      out.commit();
      _exit(0);
    }
  for (int status = 0; wait(&status) > 0;) EXPECT_EQ(status, 0);
  EXPECT_EQ(names_in(folder).size(), files);
  for (int k = 1; k < files; ++k) EXPECT_EQ(content(folder / std::to_string(k)), content(folder / "0"));
}

TEST(OutputDirectory, ARunKilledAtAnyMomentLeavesNothingToTheNextOne) {
  const Workspace work;
  const fs::path folder = work / "out";
  constexpr int files = 20;
  const auto run = [&](int number) {
    OutputDirectory out(folder);
    for (int k = 0; k < files; ++k) put(out.file(std::to_string(k)), std::to_string(number));
    out.commit();
  };
  run(0);
  for (int number = 1; number <= 100; ++number) {
    const pid_t child = fork();
    if (child == 0) {
      run(number);
      _exit(0);
    }
    usleep(static_cast<useconds_t>(37 * number));
    kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
    { const OutputDirectory next(folder); }
    ASSERT_EQ(names_in(folder).size(), files) << number;
    for (int k = 1; k < files; ++k)
      ASSERT_EQ(content(folder / std::to_string(k)), content(folder / "0")) << number << ", file " << k;
  }
}

}  // namespace
}  // namespace efree::test
