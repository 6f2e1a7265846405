// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/path_record.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/fingerprint.hpp"
#include "efree/io/history.hpp"
#include "efree/io/internal/cannot_write.hpp"
#include "efree/io/writers.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>
#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <regex>
#include <stdexcept>
#include <type_traits>
#include <utility>

namespace efree {
namespace fs = std::filesystem;

namespace {

static_assert(std::endian::native == std::endian::little, "checkpoints are written as they are in memory");

constexpr std::string_view mark = "efree path 3\n";
constexpr const char *state_name = "path.state", *history_name = "history.csv", *series_name = "fields.pvd";

/// Values one after the other, as they are in memory.
class Packer {
 public:
  template <class T>
  requires std::is_arithmetic_v<T>
  void add(T value) { bytes_.append(reinterpret_cast<const char*>(&value), sizeof value); }
  void add(std::string_view text) {
    add(std::uint64_t{text.size()});
    bytes_ += text;
  }
  template <class Derived> void add(const Eigen::PlainObjectBase<Derived>& values) {
    add(static_cast<std::uint64_t>(values.size()));
    bytes_.append(reinterpret_cast<const char*>(values.data()), sizeof(double) * values.size());
  }
  std::string& bytes() { return bytes_; }

 private:
  std::string bytes_;
};

/// The same values back. Throws std::out_of_range where there is not as much.
class Unpacker {
 public:
  explicit Unpacker(std::string_view bytes) : bytes_(bytes) {}
  template <class T> T get() {
    T value;
    std::memcpy(&value, take(sizeof value).data(), sizeof value);
    return value;
  }
  std::string text() { return std::string(take(get<std::uint64_t>())); }
  template <class Values> void fill(Values& values) {
    const auto size = get<std::uint64_t>();
    const std::string_view from = take(size > bytes_.size() ? bytes_.size() + 1 : sizeof(double) * size);
    values.resize(static_cast<Eigen::Index>(size));
    std::memcpy(values.data(), from.data(), from.size());
  }
  template <int N> Vec<N> vector() {
    Vec<N> value;
    for (int i = 0; i < N; ++i) value[i] = get<double>();
    return value;
  }
  bool empty() const { return bytes_.empty(); }

 private:
  std::string_view take(std::size_t size) {
    if (size > bytes_.size()) throw std::out_of_range("there is not as much");
    const std::string_view taken = bytes_.substr(0, size);
    bytes_.remove_prefix(size);
    return taken;
  }

  std::string_view bytes_;
};

template <int N> void add(Packer& to, const Vec<N>& value) {
  for (int i = 0; i < N; ++i) to.add(value[i]);
}

template <int Dim> void add(Packer& to, const HistoryStep<Dim>& step) {
  for (const double value :
       {step.time, step.left, step.stored, step.dissipated, step.smallest_jacobian, step.plastic_share})
    to.add(value);
  to.add(std::int64_t{step.iterations});
  to.add(static_cast<std::int64_t>(step.negative_pivots));
  to.add(std::uint64_t{step.reactions.size()});
  for (const auto& [part, of] : step.reactions) {
    to.add(std::string_view(part));
    add(to, of.force);
    add(to, of.moment);
  }
  to.add(std::uint64_t{step.probes.size()});
  for (const auto& u : step.probes) add<Dim>(to, u);
}
template <int Dim> HistoryStep<Dim> history_step(Unpacker& from) {
  HistoryStep<Dim> step{};
  for (double* value :
       {&step.time, &step.left, &step.stored, &step.dissipated, &step.smallest_jacobian, &step.plastic_share})
    *value = from.get<double>();
  step.iterations = static_cast<int>(from.get<std::int64_t>());
  step.negative_pivots = static_cast<Index>(from.get<std::int64_t>());
  for (auto left = from.get<std::uint64_t>(); left > 0; --left) {
    Resultant<Dim>& of = step.reactions[from.text()];
    of.force = from.vector<Dim>();
    of.moment = from.vector < Dim == 2 ? 1 : 3 > ();
  }
  for (auto left = from.get<std::uint64_t>(); left > 0; --left) step.probes.push_back(from.vector<Dim>());
  return step;
}

void add(Packer& to, const PathPoint& at) {
  for (const Vector* values : {&at.u, &at.history, &at.came_by, &at.remembered}) to.add(*values);
  for (const double value : {at.time, at.dt, at.factor, at.next, at.per_time, at.began, at.lasted}) to.add(value);
  to.add(std::int64_t{at.steps});
}
PathPoint path_point(Unpacker& from) {
  PathPoint at;
  for (Vector* values : {&at.u, &at.history, &at.came_by, &at.remembered}) from.fill(*values);
  for (double* value : {&at.time, &at.dt, &at.factor, &at.next, &at.per_time, &at.began, &at.lasted})
    *value = from.get<double>();
  at.steps = static_cast<int>(from.get<std::int64_t>());
  return at;
}

void add(Packer& to, const LinearCheck& check) {
  for (const double value :
       {check.time, check.displacement, check.stress, check.overload, check.strain, check.rotation})
    to.add(value);
  to.add(static_cast<std::int64_t>(check.negative_pivots));
  to.add(std::uint64_t{check.enough});
  to.add(std::uint64_t{check.same});
  to.add(std::string_view(check.failure));
}
LinearCheck linear_check(Unpacker& from) {
  LinearCheck check;
  for (double* value :
       {&check.time, &check.displacement, &check.stress, &check.overload, &check.strain, &check.rotation})
    *value = from.get<double>();
  check.negative_pivots = static_cast<Index>(from.get<std::int64_t>());
  check.enough = from.get<std::uint64_t>() != 0;
  check.same = from.get<std::uint64_t>() != 0;
  check.failure = from.text();
  return check;
}

/// Writes a file beside, then puts it in place.
template <class Write> void replace(const fs::path& file, const Write& write) {
  fs::path part = file;
  part += ".part";
  std::error_code error;
  try {
    write(part);
  } catch (...) {
    fs::remove(part, error);
    throw;
  }
  fs::rename(part, file, error);
  if (error) internal::cannot_write(file);
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
/// The fields of these steps by time, as ParaView reads it.
template <int Dim>
void write_series(const fs::path& file, const std::vector<int>& steps, const std::vector<HistoryStep<Dim>>& history) {
  std::ofstream out(file);
  out << "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\">\n  <Collection>\n";
  for (const int step : steps)
    out << fmt::format("    <DataSet timestep=\"{}\" part=\"0\" file=\"{}\"/>\n", history[step - 1].time,
                       fields_name(step));
  out << "  </Collection>\n</VTKFile>\n";
  if (!out.flush()) internal::cannot_write(file);
}

/// The same file at another place, without its bytes where the file system can do that.
void link(const fs::path& from, const fs::path& to) {
  std::error_code error;
  fs::create_hard_link(from, to, error);
  if (error) fs::copy_file(from, to, fs::copy_options::overwrite_existing, error);
  if (error) internal::cannot_write(to);
}

}  // namespace

template <int Dim> void write_checkpoint(const fs::path& file, const Checkpoint<Dim>& there, CaseMark of) {
  Packer out;
  out.bytes() += mark;
  out.add(version());
  out.add(std::int64_t{Dim});
  for (const std::uint64_t value : {of.what, of.how, there.body}) out.add(value);
  add(out, there.at);
  out.add(std::uint64_t{there.history.size()});
  for (const auto& step : there.history) add<Dim>(out, step);
  out.add(std::uint64_t{there.linear_checks.size()});
  for (const auto& check : there.linear_checks) add(out, check);
  out.add(std::uint64_t{there.agreed.has_value()});
  if (there.agreed) add(out, *there.agreed);
  out.add(there.mode);
  out.add(internal::Fingerprint().add(out.bytes()).value());
  replace(file, [&](const fs::path& part) {
    std::ofstream stream(part, std::ios::binary);
    stream << out.bytes();
    if (!stream.flush()) internal::cannot_write(file);
  });
}

template <int Dim> Checkpoint<Dim> read_checkpoint(const fs::path& file, CaseMark of) {
  const auto fail = [&](const std::string& why) { throw InputError(fmt::format("{}: {}", file.string(), why)); };
  std::ifstream stream(file, std::ios::binary);
  const std::string bytes(std::istreambuf_iterator<char>(stream), {});
  if (!stream) fail("the steps of an earlier run cannot be read");
  if (!bytes.starts_with(mark)) fail("expected the steps of an earlier run of efree");
  constexpr std::size_t sum = sizeof(std::uint64_t);
  const std::string_view all(bytes);
  if (all.size() < mark.size() + sum || Unpacker(all.substr(all.size() - sum)).get<std::uint64_t>() !=
                                            internal::Fingerprint().add(all.substr(0, all.size() - sum)).value())
    fail("the file is damaged: run without --resume");
  Checkpoint<Dim> there;
  try {
    Unpacker in(all.substr(mark.size(), all.size() - mark.size() - sum));
    if (const std::string by = in.text(); by != version())
      fail(fmt::format("these steps are of efree {}, and this is {}: run without --resume", by, version()));
    const bool same_dimension = in.get<std::int64_t>() == Dim;
    CaseMark its;
    its.what = in.get<std::uint64_t>();
    its.how = in.get<std::uint64_t>();
    if (!same_dimension || its.what != of.what)
      fail(
          "these steps are of another case: the case file, or the geometry's, has changed by more than steps of "
          "[time]; "
          "run without --resume");
    there.body = in.get<std::uint64_t>();
    there.at = path_point(in);
    for (auto left = in.get<std::uint64_t>(); left > 0; --left) there.history.push_back(history_step<Dim>(in));
    for (auto left = in.get<std::uint64_t>(); left > 0; --left) there.linear_checks.push_back(linear_check(in));
    if (in.get<std::uint64_t>() != 0) there.agreed = path_point(in);
    in.fill(there.mode);
    if (its.how != of.how) there.at.next = 0.0;
    if (its.how != of.how && there.agreed) there.agreed->next = 0.0;
    const int steps = there.at.steps;
    if (!in.empty() || there.history.empty() || static_cast<int>(there.history.size()) != steps ||
        (there.agreed && (there.agreed->steps < 0 || there.agreed->steps > steps)))
      fail("the file is damaged: run without --resume");
  } catch (const std::out_of_range&) {
    fail("the file is damaged: run without --resume");
  }
  return there;
}

template <int Dim> PathRecord<Dim>::PathRecord(fs::path directory, const Case<Dim>& analysis)
    : directory_(std::move(directory)), folder_(directory_ / "unfinished"), case_(analysis) {}

template <int Dim> PathRecord<Dim>::~PathRecord() {
  if (lock_ >= 0) close(lock_);
}

template <int Dim> bool PathRecord<Dim>::is_unfinished() const {
  return fs::exists(folder_ / state_name);
}

/// The folder is there, and ours.
template <int Dim> void PathRecord<Dim>::begin() {
  if (lock_ >= 0) return;
  std::error_code error;
  fs::create_directory(folder_, error);
  lock_ = open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (error || lock_ < 0) internal::cannot_write(folder_ / state_name);
  if (flock(lock_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
    close(std::exchange(lock_, -1));
    throw InputError(fmt::format("{}: another run goes on here, expected another --out", folder_.string()));
  }
}

template <int Dim> Checkpoint<Dim> PathRecord<Dim>::resume() {
  const bool killed = is_unfinished();
  const fs::path file = (killed ? folder_ : directory_) / state_name;
  if (!fs::exists(file))
    throw InputError(
        fmt::format("{}: there are no steps of an earlier run to resume: run without --resume", file.string()));
  Checkpoint<Dim> there = read_checkpoint<Dim>(file, case_.mark);
  begin();
  if (!killed) {
    for (const int step : steps_in(folder_)) fs::remove(folder_ / fields_name(step));
    for (const int step : steps_in(directory_))
      if (step <= there.at.steps) link(directory_ / fields_name(step), folder_ / fields_name(step));
    write_checkpoint(folder_ / state_name, there, case_.mark);
  }
  take_back(there);  // fields of a step that was not the last yet
  steps_ = there.at.steps;
  return there;
}

template <int Dim> void PathRecord<Dim>::keep(const Checkpoint<Dim>& there, const Result<Dim>& so_far) {
  begin();
  if (steps_ == 0)
    for (const auto& entry : fs::directory_iterator(folder_)) fs::remove_all(entry.path());
  const int now = there.at.steps;
  const bool has_fields = so_far.fields.displacement.size() > 0;
  if (has_fields) replace(folder_ / fields_name(now), [&](const fs::path& part) { write_fields(part, case_, so_far); });
  write_checkpoint(folder_ / state_name, there, case_.mark);
  const bool again = now <= steps_;  // what followed is no more
  if (again) take_back(there);
  if (has_fields)
    replace(folder_ / series_name, [&](const fs::path& part) { write_series(part, steps_in(folder_), there.history); });
  if (!again) {
    std::ofstream table(folder_ / history_name, std::ios::app);
    if (steps_ == 0) table << history_header<Dim>(case_, there.history.back());
    table << history_line(there.history.back());
    if (!table.flush()) internal::cannot_write(folder_ / history_name);
  }
  steps_ = now;
}

/// Leaves no more than the steps up to there.
template <int Dim> void PathRecord<Dim>::take_back(const Checkpoint<Dim>& there) const {
  for (const int step : steps_in(folder_))
    if (step > there.at.steps) fs::remove(folder_ / fields_name(step));
  if (fs::exists(folder_ / series_name))
    replace(folder_ / series_name, [&](const fs::path& part) { write_series(part, steps_in(folder_), there.history); });
  replace(folder_ / history_name, [&](const fs::path& part) { write_history(part, case_, there.history); });
}

template <int Dim> void PathRecord<Dim>::finish(OutputDirectory& out, const Result<Dim>& result) const {
  for (const int step : steps_in(directory_)) out.supersede(fields_name(step));
  for (const char* name : {state_name, series_name}) out.supersede(name);
  if (result.history.empty() || steps_ == 0) return;
  link(folder_ / state_name, out.file(state_name));
  auto steps = steps_in(folder_);
  std::erase_if(steps, [&](int step) { return step > static_cast<int>(result.history.size()); });  // taken back
  for (const int step : steps) link(folder_ / fields_name(step), out.file(fields_name(step)));
  if (!steps.empty()) write_series(out.file(series_name), steps, result.history);
}

template <int Dim> void PathRecord<Dim>::forget() {
  if (lock_ < 0) return;
  std::error_code ignored;
  fs::remove_all(folder_, ignored);
  close(std::exchange(lock_, -1));
}

template void write_checkpoint<2>(const fs::path&, const Checkpoint<2>&, CaseMark);
template void write_checkpoint<3>(const fs::path&, const Checkpoint<3>&, CaseMark);
template Checkpoint<2> read_checkpoint<2>(const fs::path&, CaseMark);
template Checkpoint<3> read_checkpoint<3>(const fs::path&, CaseMark);
template class PathRecord<2>;
template class PathRecord<3>;

}  // namespace efree
