// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/progress.hpp"

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

Stage::Stage(std::string name, StageTimes& times, const Progress& progress)
    : name_(std::move(name)), times_(times), progress_(progress), start_(std::chrono::steady_clock::now()) {
  if (progress_) progress_(name_, 0.0);
}

Stage::~Stage() {
  times_.add(name_, std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count());
  try {
    if (progress_) progress_(name_, 1.0);
  } catch (...) {  // a display that fails must not end the analysis
  }
}

}  // namespace efree
