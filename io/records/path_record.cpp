// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/path_record.hpp"

#include "efree/core/error.hpp"
#include "efree/io/confined/internal/transfer.hpp"
#include "efree/io/files/internal/cannot_write.hpp"
#include "efree/io/records/history.hpp"
#include "efree/io/records/internal/series.hpp"
#include "efree/io/records/internal/unfinished.hpp"
#include "efree/io/records/writers.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <regex>
#include <tuple>
#include <utility>

namespace efree {
namespace fs = std::filesystem;
using internal::link, internal::replace;

// What a checkpoint is made of, for Packer and Unpacker.
template <int Dim> static auto fields(Resultant<Dim>& of) {
  auto& [force, moment] = of;
  return std::tie(force, moment);
}
template <int Dim> static auto fields(HistoryStep<Dim>& step) {
  auto& [time, iterations, left, stored, dissipated, smallest_jacobian, plastic_share, negative_pivots, reactions,
         probes] = step;
  return std::tie(time, iterations, left, stored, dissipated, smallest_jacobian, plastic_share, negative_pivots,
                  reactions, probes);
}
static auto fields(LinearCheck& check) {
  auto& [time, enough, displacement, stress, overload, strain, rotation, negative_pivots, same, failure] = check;
  return std::tie(time, enough, displacement, stress, overload, strain, rotation, negative_pivots, same, failure);
}
static auto fields(State& state) {
  auto& [u, history, time, dt, factor] = state;
  return std::tie(u, history, time, dt, factor);
}
static auto fields(PathPoint& at) {  // no aggregate: a member that is added has to be listed
  return std::tuple_cat(fields(static_cast<State&>(at)),
                        std::tie(at.steps, at.next, at.per_time, at.began, at.lasted, at.came_by, at.remembered));
}
template <int Dim> static auto fields(Checkpoint<Dim>& there) {
  auto& [at, history, body, linear_checks, agreed, scale, elastic_range, mode] = there;
  return std::tie(at, history, body, linear_checks, agreed, scale, elastic_range, mode);
}

namespace {

constexpr std::string_view path_state_kind = "efree path 6\n";
constexpr const char *path_state_name = "path.state", *path_history_name = "history.csv", *series_name = "fields.pvd";

/// Whether where the path is, and all it says of its steps, are numbers.
template <int Dim> bool is_finite(const Checkpoint<Dim>& there) {
  const auto is_number = [](const HistoryStep<Dim>& step) {
    double sum = step.time + step.left + step.stored + step.dissipated + step.smallest_jacobian + step.plastic_share;
    for (const auto& [part, of] : step.reactions) sum += of.force.sum() + of.moment.sum();
    for (const auto& u : step.probes) sum += u.sum();
    return std::isfinite(sum);
  };
  return there.at.u.allFinite() && there.at.history.allFinite() && std::ranges::all_of(there.history, is_number);
}

/// The fields of a step.
std::string fields_name(int step) {
  return fmt::format("fields_{:04}.vtu", step);
}
/// Which step's fields a file has; 0: it is no such file.
int step_of(const fs::path& file) {
  static const std::regex name(R"(fields_([0-9]{4,9})\.vtu)");
  std::smatch found;
  const std::string text = file.filename().string();
  return std::regex_match(text, found, name) ? std::stoi(found[1]) : 0;
}
/// Steps with fields in a folder, ascending.
std::vector<int> steps_in(const fs::path& folder) {
  std::vector<int> steps;
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(folder, ignored))
    if (const int step = step_of(entry.path()); step > 0) steps.push_back(step);
  std::ranges::sort(steps);
  return steps;
}
/// The fields of these steps by time.
template <int Dim>
void write_series(const fs::path& file, const std::vector<int>& steps, const std::vector<HistoryStep<Dim>>& history) {
  std::vector<std::pair<double, std::string>> frames;
  for (const int step : steps) frames.emplace_back(history[step - 1].time, fields_name(step));
  internal::write_series(file, frames);
}

}  // namespace

template <int Dim> void write_checkpoint(const fs::path& file, const Checkpoint<Dim>& there, CaseMark of) {
  Packer pack;
  Checkpoint<Dim> all = there;
  pack(all);
  internal::write_sealed(file, path_state_kind, Dim, of, {std::move(pack).bytes()});
}

template <int Dim> Checkpoint<Dim> read_checkpoint(const fs::path& file, CaseMark of) {
  const internal::Sealed sealed = internal::read_sealed(file, path_state_kind, Dim, of);
  Unpacker unpack(sealed.packed());
  Checkpoint<Dim> there;
  try {
    unpack(there);
  } catch (const InputError&) {
    internal::is_damaged(file);
  }
  if (sealed.of.how != of.how) there.at.next = 0.0;
  if (sealed.of.how != of.how && there.agreed) there.agreed->next = 0.0;
  const int steps = there.at.steps;
  if (!unpack.empty() || !is_finite(there) || !(there.scale > 0.0) || !(there.elastic_range > 0.0) ||
      there.history.empty() || static_cast<int>(there.history.size()) != steps ||
      (there.agreed && (there.agreed->steps < 0 || there.agreed->steps > steps)))
    internal::is_damaged(file);
  return there;
}

template <int Dim> PathRecord<Dim>::PathRecord(fs::path directory, const Case<Dim>& analysis)
    : directory_(std::move(directory)),
      unfinished_(std::make_unique<internal::Unfinished>(directory_)),
      folder_(unfinished_->folder()),
      case_(analysis) {}

template <int Dim> PathRecord<Dim>::~PathRecord() = default;

template <int Dim> bool PathRecord<Dim>::is_unfinished() const {
  return fs::exists(folder_ / path_state_name);
}

template <int Dim> Checkpoint<Dim> PathRecord<Dim>::resume() {
  const bool killed = is_unfinished();
  const fs::path file = (killed ? folder_ : directory_) / path_state_name;
  if (!fs::exists(file))
    throw InputError(
        fmt::format("{}: there are no steps of an earlier run to resume: run without --resume", file.string()));
  Checkpoint<Dim> there = read_checkpoint<Dim>(file, case_.mark);
  unfinished_->begin();
  if (!killed) {
    for (const int step : steps_in(folder_)) fs::remove(folder_ / fields_name(step));
    for (const int step : steps_in(directory_))
      if (step <= there.at.steps) link(directory_ / fields_name(step), folder_ / fields_name(step));
    write_checkpoint(folder_ / path_state_name, there, case_.mark);
  }
  take_back(there);  // fields of a step that was not the last yet
  steps_ = there.at.steps;
  return there;
}

template <int Dim> void PathRecord<Dim>::keep(const Checkpoint<Dim>& there, const Result<Dim>& so_far) {
  unfinished_->begin();
  if (steps_ == 0)
    for (const auto& entry : fs::directory_iterator(folder_)) fs::remove_all(entry.path());
  const int now = there.at.steps;
  const bool has_fields = so_far.fields.displacement.size() > 0;
  if (has_fields) replace(folder_ / fields_name(now), [&](const fs::path& part) { write_fields(part, case_, so_far); });
  write_checkpoint(folder_ / path_state_name, there, case_.mark);
  const bool again = now <= steps_;  // what followed is no more
  if (again) take_back(there);
  if (has_fields)
    replace(folder_ / series_name, [&](const fs::path& part) { write_series(part, steps_in(folder_), there.history); });
  if (!again) {
    std::ofstream table(folder_ / path_history_name, std::ios::app);
    if (steps_ == 0) table << history_header<Dim>(case_, there.history.back());
    table << history_line(there.history.back());
    if (!table.flush()) internal::cannot_write(folder_ / path_history_name);
  }
  steps_ = now;
}

/// Leaves no more than the steps up to there.
template <int Dim> void PathRecord<Dim>::take_back(const Checkpoint<Dim>& there) const {
  for (const int step : steps_in(folder_))
    if (step > there.at.steps) fs::remove(folder_ / fields_name(step));
  if (fs::exists(folder_ / series_name))
    replace(folder_ / series_name, [&](const fs::path& part) { write_series(part, steps_in(folder_), there.history); });
  replace(folder_ / path_history_name, [&](const fs::path& part) { write_history(part, case_, there.history); });
}

template <int Dim> void PathRecord<Dim>::finish(OutputDirectory& out, const Result<Dim>& result) const {
  for (const int step : steps_in(directory_)) out.supersede(fields_name(step));
  for (const char* name : {path_state_name, series_name}) out.supersede(name);
  if (result.history.empty() || steps_ == 0) return;
  link(folder_ / path_state_name, out.file(path_state_name));
  auto steps = steps_in(folder_);
  std::erase_if(steps, [&](int step) { return step > static_cast<int>(result.history.size()); });  // taken back
  for (const int step : steps) link(folder_ / fields_name(step), out.file(fields_name(step)));
  if (!steps.empty()) write_series(out.file(series_name), steps, result.history);
}

template <int Dim> void PathRecord<Dim>::forget() {
  unfinished_->forget();
}

template void write_checkpoint<2>(const fs::path&, const Checkpoint<2>&, CaseMark);
template void write_checkpoint<3>(const fs::path&, const Checkpoint<3>&, CaseMark);
template Checkpoint<2> read_checkpoint<2>(const fs::path&, CaseMark);
template Checkpoint<3> read_checkpoint<3>(const fs::path&, CaseMark);
template class PathRecord<2>;
template class PathRecord<3>;

}  // namespace efree
