// SPDX-License-Identifier: GPL-3.0-or-later
/// What a run tells whoever waits for it: stages, fractions done, remarks, seconds spent; and whether anybody still
/// does.
#pragma once

#include <chrono>
#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace efree {

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

/// Who watches a run; whatever is left out is not told or asked. Called by the thread that runs the stages.
struct Monitor {
  using Progress = std::function<void(const std::string& stage, double fraction)>;

  Progress progress{};  ///< told when a stage begins (fraction 0), while it goes on, and when it ends (fraction 1)
  /// Asked when a stage begins and at every step of it that can be told: true ends the run, by Cancelled.
  std::function<bool()> cancelled{};
  std::function<void(const std::string& remark)> say{};      ///< told what people should know, a line each
  StageTimes* times = nullptr;                               ///< the seconds of every stage are added here
  std::function<void(const std::string& how_far)> detail{};  ///< told how far a long stage is, in words, every so often

  /// The same who hears of these times.
  Monitor timing(StageTimes& to) const;
};

/// Times one stage from construction to destruction, and announces it.
class Stage {
 public:
  /// Throws Cancelled, as `tick` and `check`, if the run is to end.
  Stage(std::string name, const Monitor& monitor);
  ~Stage();
  Stage(const Stage&) = delete;
  Stage& operator=(const Stage&) = delete;

  /// This fraction of the stage is done; 0 as long as nobody knows.
  void tick(double fraction) const;
  /// Asks whether the run is to end.
  void check() const;
  /// For what is a part of this stage: it can be cancelled, in this one's name, and says how far it is, but is neither
  /// announced nor timed. Not to be used longer than the stage.
  Monitor within() const;

 private:
  std::string name_;
  Monitor monitor_;
  std::chrono::steady_clock::time_point start_;
};

}  // namespace efree
