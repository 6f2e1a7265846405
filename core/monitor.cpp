// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/monitor.hpp"

#include "efree/core/error.hpp"

namespace efree {

void StageTimes::add(const std::string& stage, double seconds) {
  for (auto& [name, spent] : stages_)
    if (name == stage) {
      spent += seconds;
      return;
    }
  stages_.emplace_back(stage, seconds);
}

void StageTimes::add(const StageTimes& other) {
  for (const auto& [name, spent] : other.stages_) add(name, spent);
}

double StageTimes::operator[](const std::string& stage) const {
  for (const auto& [name, spent] : stages_)
    if (name == stage) return spent;
  return 0.0;
}

double StageTimes::total() const {
  double sum = 0.0;
  for (const auto& entry : stages_) sum += entry.second;
  return sum;
}

Monitor Monitor::timing(StageTimes& to) const {
  Monitor result = *this;
  result.times = &to;
  return result;
}

Stage::Stage(std::string name, const Monitor& monitor)
    : name_(std::move(name)), monitor_(monitor), start_(std::chrono::steady_clock::now()) {
  tick(0.0);
}

Stage::~Stage() {
  try {
    if (monitor_.times)
      monitor_.times->add(name_, std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count());
    if (monitor_.progress) monitor_.progress(name_, 1.0);
  } catch (...) {  // a display that fails must not end the analysis
  }
}

void Stage::tick(double fraction) const {
  check();
  if (monitor_.progress) monitor_.progress(name_, fraction);
}

void Stage::check() const {
  if (monitor_.cancelled && monitor_.cancelled()) throw Cancelled(name_);
}

Monitor Stage::within() const {
  Monitor result{.detail = monitor_.detail};
  if (monitor_.cancelled)
    result.cancelled = [this] {
      check();
      return false;
    };
  return result;
}

}  // namespace efree
