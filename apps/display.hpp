// SPDX-License-Identifier: GPL-3.0-or-later
/// Progress on stderr: a bar on a terminal, a line per stage elsewhere.
#pragma once

#include "efree/core/monitor.hpp"

#include <chrono>
#include <string>
#include <vector>

namespace efree {

class Display {
 public:
  explicit Display(bool quiet);
  ~Display();
  Display(const Display&) = delete;
  Display& operator=(const Display&) = delete;

  /// For one run that passes through these stages, in about this order.
  Monitor::Progress stages(std::vector<std::string> names);
  /// For many runs: the fraction is that of them all, the stage says which one begins.
  Monitor::Progress runs();
  /// For one that says nothing else: a bar while it goes on, on a terminal.
  Monitor::Progress waiting();
  /// How far the stage is, in words: beside the bar, elsewhere a line every ten seconds.
  void detail(const std::string& how_far);
  /// A line about the stage under way, which goes on.
  void line(const std::string& message);
  /// A message of its own line, said even if quiet.
  void say(const std::string& message);
  /// The stage that began last.
  const std::string& stage() const { return stage_; }

 private:
  void bar(const std::string& label, double fraction);
  void clear_bar();
  /// Says how long the stage took that is over now.
  void finish_line();

  bool quiet_, terminal_;
  bool bar_shown_ = false;
  double fraction_ = 0.0;
  std::string stage_, detail_;
  std::chrono::steady_clock::time_point start_;
  std::chrono::steady_clock::time_point detail_said_;
  std::chrono::steady_clock::time_point stage_start_{};  ///< zero if nothing is under way
};

}  // namespace efree
