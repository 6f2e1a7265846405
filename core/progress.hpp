// SPDX-License-Identifier: GPL-3.0-or-later
/// Stage names, fractions done and seconds spent: what a run tells whoever waits for it.
#pragma once

#include <chrono>
#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace efree {

/// Called when a stage begins (fraction 0), while it goes on, and when it ends (fraction 1).
using Progress = std::function<void(const std::string& stage, double fraction)>;

/// Wall-clock seconds per stage, in the order the stages first ran. A stage that runs twice adds up.
class StageTimes {
 public:
  void add(const std::string& stage, double seconds);
  void add(const StageTimes& other);
  double operator[](const std::string& stage) const;  ///< 0 if the stage never ran
  double total() const;
  const std::vector<std::pair<std::string, double>>& stages() const { return stages_; }

 private:
  std::vector<std::pair<std::string, double>> stages_;
};

/// Times one stage from construction to destruction, and announces it.
class Stage {
 public:
  Stage(std::string name, StageTimes& times, const Progress& progress);
  ~Stage();
  Stage(const Stage&) = delete;
  Stage& operator=(const Stage&) = delete;

 private:
  std::string name_;
  StageTimes& times_;
  Progress progress_;
  std::chrono::steady_clock::time_point start_;
};

}  // namespace efree
