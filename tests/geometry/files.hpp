// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <gtest/gtest.h>
#include <fstream>
#include <string>

namespace efree::test {

/// Writes a file for the running test and returns its path.
inline std::string file(const std::string& name, const std::string& text) {
  const std::string path =
      ::testing::TempDir() + ::testing::UnitTest::GetInstance()->current_test_info()->name() + "_" + name;
  std::ofstream(path, std::ios::binary) << text;
  return path;
}

}  // namespace efree::test
