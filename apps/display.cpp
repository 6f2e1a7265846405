// SPDX-License-Identifier: GPL-3.0-or-later
#include "display.hpp"

#include <fmt/format.h>
#include <unistd.h>
#include <algorithm>

namespace efree {
namespace {

using Clock = std::chrono::steady_clock;
double elapsed_seconds(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

}  // namespace

Display::Display(bool quiet)
    : quiet_(quiet), terminal_(isatty(STDERR_FILENO) != 0), start_(Clock::now()), detail_said_(start_) {}

Display::~Display() {
  clear_bar();
}

Monitor::Progress Display::stages(std::vector<std::string> names) {
  return [this, names = std::move(names)](const std::string& stage, double fraction) {
    const bool is_over = fraction >= 1.0, begins_again = stage_start_ == Clock::time_point{} && !is_over;
    if (stage != stage_ || begins_again) {
      finish_line();
      stage_ = stage;
      detail_.clear();
      stage_start_ = Clock::now();
    }
    const auto position = std::ranges::find(names, stage) - names.begin();
    if (terminal_) bar(stage, (static_cast<double>(position) + fraction) / static_cast<double>(names.size()));
    if (is_over) finish_line();
  };
}

Monitor::Progress Display::runs() {
  return [this](const std::string& run, double fraction) {
    const bool begins = run != stage_;
    if (begins) finish_line();
    stage_ = run;
    if (terminal_)
      bar(run, fraction);
    else if (begins && !quiet_)
      fmt::print(stderr, "{:3.0f} %  {}\n", 100.0 * fraction, run);
  };
}

Monitor::Progress Display::waiting() {
  return [this](const std::string& what, double fraction) {
    if (terminal_ && fraction < 1.0)
      bar(what, fraction);
    else
      clear_bar();
  };
}

void Display::detail(const std::string& how_far) {
  detail_ = how_far;
  constexpr double interval = 10.0;
  if (terminal_ || quiet_ || elapsed_seconds(detail_said_) < interval) return;
  detail_said_ = Clock::now();
  fmt::print(stderr, "{}\n", how_far);
}

void Display::line(const std::string& message) {
  if (quiet_) return;
  clear_bar();
  fmt::print(stderr, "{}\n", message);
}

void Display::say(const std::string& message) {
  clear_bar();
  fmt::print(stderr, "{}\n", message);
}

void Display::finish_line() {
  if (!terminal_ && !quiet_ && stage_start_ != Clock::time_point{})
    fmt::print(stderr, "{:<12}{:8.2f} s\n", stage_, elapsed_seconds(stage_start_));
  stage_start_ = {};
}

void Display::bar(const std::string& label, double fraction) {
  if (quiet_) return;
  constexpr int width = 30;
  fraction_ = std::clamp(fraction, fraction_, 1.0);  // a stage that comes back must not turn the bar around
  const int filled = static_cast<int>(width * fraction_);
  fmt::print(stderr, "\r\033[K[{:#<{}}{:.<{}}] {:5.1f} s  {}", "", filled, "", width - filled, elapsed_seconds(start_),
             detail_.empty() ? label : fmt::format("{}: {}", label, detail_));
  std::fflush(stderr);
  bar_shown_ = true;
}

void Display::clear_bar() {
  if (bar_shown_) fmt::print(stderr, "\r\033[K");
  bar_shown_ = false;
}

}  // namespace efree
