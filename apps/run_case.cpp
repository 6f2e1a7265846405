// SPDX-License-Identifier: GPL-3.0-or-later
#include "run_case.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/io/files/output_directory.hpp"
#include "efree/io/pictures/effective_chart.hpp"
#include "efree/io/pictures/history_chart.hpp"
#include "efree/io/pictures/picture.hpp"
#include "efree/io/records/dynamics_report.hpp"
#include "efree/io/records/dynamics_run.hpp"
#include "efree/io/records/effective_report.hpp"
#include "efree/io/records/history.hpp"
#include "efree/io/records/image_record.hpp"
#include "efree/io/records/path_record.hpp"
#include "efree/io/records/static_report.hpp"
#include "efree/io/records/writers.hpp"
#include "on_interrupt.hpp"

#include <fmt/format.h>
#include <atomic>
#include <chrono>
#include <future>
#include <new>
#include <optional>
#include <regex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace efree {
namespace {

/// The pictures of a static case: those that it names, or von Mises' stress and the error, where the result has one.
/// Adds warnings of those that there cannot be.
template <int Dim, class AnyResult> void draw_pictures(const OutputDirectory& out, const Case<Dim>& analysis,
                                                       const AnyResult& result, std::vector<std::string>& warnings) {
  if (analysis.pictures.empty()) {
    draw_result(out.file("fields.png"), {.field = "von_mises"}, analysis, result);
    draw_result(out.file("error.png"), {.field = "error"}, analysis, result);
  }
  for (const PictureOptions& options : analysis.pictures)
    if (!draw_result(out.file(fmt::format("picture_{}.png", options.name)), options, analysis, result))
      warnings.push_back(fmt::format("{}: no picture \"{}\": the result has no field \"{}\"", options.where,
                                     options.name, options.field));
}
/// Older files of a static case that this run may not write.
void supersede_statics(OutputDirectory& out) {
  for (const char* other :
       {"fields.png", "error.png", "history.png", "history.csv", "fields.vtu", "fields.vti", "nodes.vtu", "slices.csv"})
    out.supersede(other);
  static const std::regex picture("picture_[-A-Za-z0-9_]+[.]png");
  out.supersede_all([](const std::string& name) { return std::regex_match(name, picture); });
}

/// How a run ended.
struct RunEnd {
  std::string failure{};      ///< why it ended before its time, or why its results are rejected; empty: neither
  std::string rejected_by{};  ///< stage whose results are rejected; empty: it was the last stage that failed
  bool has_results = false;   ///< results of this run are in the output directory
};

/// A run of a case, of any kind.
class CaseRun {
 public:
  CaseRun() = default;
  virtual ~CaseRun() = default;
  CaseRun(const CaseRun&) = delete;
  CaseRun& operator=(const CaseRun&) = delete;
  virtual const std::string& title() const = 0;
  /// In about the order that the run passes through them.
  virtual std::vector<std::string> stages() const = 0;
  /// Whether a signal waits for the end of a step: the run throws Cancelled then.
  virtual bool stops_at_steps() const = 0;
  /// Whether what it says of its steps is worth a line each.
  virtual bool has_few_steps() const = 0;
  /// Computes, and writes the results.
  virtual RunEnd run(OutputDirectory& out, const Monitor& monitor, Display& display) = 0;
  /// Writes what there is of a run that failed. Returns whether there is something.
  virtual bool save(OutputDirectory& out) = 0;
  /// Whether there are steps on the disk that --resume continues.
  virtual bool can_resume() const = 0;
  /// Removes these. Called once the results are in place.
  virtual void remove_unfinished() = 0;
};

void say_first_step(const Monitor& monitor, Index steps, double time) {
  monitor.say(fmt::format("goes on from step {} at time {:.6g}", steps, time));
}
void warn_of_unfinished(Display& display, const std::string& directory) {
  display.say(fmt::format(
      "warning: the steps of a run that did not end, in {}/unfinished, are deleted; --resume would have continued it",
      directory));
}
void say_warnings(const std::vector<std::string>& warnings, Display& display) {
  for (const std::string& warning : warnings) display.say(fmt::format("warning: {}", warning));
}

template <int Dim> class StaticRun final : public CaseRun {
 public:
  /// `remark`: to be said before it begins, unless it is empty.
  StaticRun(Case<Dim> analysis, const RunOptions& options, std::string remark)
      : case_(std::move(analysis)), options_(options), remark_(std::move(remark)), record_(options.out, case_) {
    case_.steps.done = [this](const Checkpoint<Dim>& there, const Result<Dim>& so_far) { record_.keep(there, so_far); };
  }

  const std::string& title() const override { return case_.common.title; }
  std::vector<std::string> stages() const override {
    return {"mesh",  "cloud", "weights",    "basis", "quadrature", "assembly",
            "solve", "path",  "correction", "duals", "output"};
  }
  bool stops_at_steps() const override { return false; }  // every step is on the disk already
  bool has_few_steps() const override { return true; }

  RunEnd run(OutputDirectory& out, const Monitor& monitor, Display& display) override {
    if (options_.resume) {
      case_.steps.from = record_.resume();
      say_first_step(monitor, case_.steps.from->at.steps, case_.steps.from->at.time);
    } else if (record_.is_unfinished()) {
      warn_of_unfinished(display, options_.out);
    }
    if (!remark_.empty()) monitor.say(remark_);
    Result<Dim> result = analyse(case_, monitor);
    for (const std::string& line : describe_result<Dim>(case_, result)) monitor.say(line);
    say_warnings(result.warnings, display);
    write(result, out, monitor, display);
    return {.failure = result.refusal,
            .rejected_by = result.refusal.empty()   ? ""
                           : result.history.empty() ? "correction"
                                                    : "path",
            .has_results = true};
  }
  bool save(OutputDirectory&) override { return false; }  // its steps are there for --resume
  bool can_resume() const override { return record_.is_unfinished(); }
  void remove_unfinished() override { record_.forget(); }

 private:
  void write(Result<Dim>& result, OutputDirectory& out, const Monitor& monitor, Display& display) const {
    std::vector<std::string> warnings;
    {
      const Stage stage("output", monitor.timing(result.times));
      supersede_statics(out);
      const auto draw = [&] {
        draw_pictures(out, case_, result, warnings);
        if (!result.history.empty()) draw_history(out.file("history.png"), case_, result.history);
      };
      const auto write_all = [&] {
        write_fields(out.file("fields.vtu"), case_, result);
        write_nodes(out.file("nodes.vtu"), result);
      };
      // Both only read the result.
      parallel_chunks(options_.no_picture ? 1 : 2, 1, [&](Index task, Index) { task == 0 ? write_all() : draw(); });
    }
    say_warnings(warnings, display);
    if (!result.history.empty()) write_history(out.file("history.csv"), case_, result.history);
    record_.finish(out, result);
    write_result(out.file("result.json"), case_, result);
  }

  Case<Dim> case_;
  const RunOptions& options_;
  std::string remark_;
  PathRecord<Dim> record_;
};

/// An image on the grid of its voxels. What takes a mesh is left to a StaticRun.
class ImageRun final : public CaseRun {
 public:
  ImageRun(const Case<3>& analysis, const RunOptions& options) : case_(analysis), options_(options) {}

  const std::string& title() const override { return case_.common.title; }
  std::vector<std::string> stages() const override { return {"image", "assembly", "solve", "mesh", "output"}; }
  bool stops_at_steps() const override { return false; }
  bool has_few_steps() const override { return true; }

  RunEnd run(OutputDirectory& out, const Monitor& monitor, Display& display) override {
    std::optional<ImageResult> result = analyse_image(case_, monitor);
    if (!result) {
      takes_mesh_ = true;
      return {};
    }
    for (const std::string& line : describe_result(case_, *result)) monitor.say(line);
    say_warnings(result->warnings, display);
    std::optional<FieldsOnMesh> on_mesh;
    if (case_.with_mesh) on_mesh = fields_on_mesh(case_.geometry, case_, *result, monitor.timing(result->times));
    std::vector<std::string> warnings;
    {
      const Stage stage("output", monitor.timing(result->times));
      supersede_statics(out);
      parallel_chunks(options_.no_picture ? 1 : 2, 1, [&](Index task, Index) {
        task == 0 ? write_fields(out.file("fields.vti"), case_, *result) : draw_pictures(out, case_, *result, warnings);
      });
      if (on_mesh) write_on_mesh(out.file("fields.vtu"), *on_mesh);
    }
    say_warnings(warnings, display);
    write_slices(out.file("slices.csv"), case_, *result);
    write_result(out.file("result.json"), case_, *result);
    return {.failure = result->refusal, .rejected_by = result->refusal.empty() ? "" : "solve", .has_results = true};
  }
  bool save(OutputDirectory&) override { return false; }
  bool can_resume() const override { return false; }
  void remove_unfinished() override {}
  /// Whether there was nothing that it could do.
  bool takes_mesh() const { return takes_mesh_; }

 private:
  void write_on_mesh(const std::filesystem::path& file, const FieldsOnMesh& on_mesh) const {
    std::vector<const Fields<3>*> by_case;
    for (const Fields<3>& fields : on_mesh.fields) by_case.push_back(&fields);
    write_fields<3>(file, case_, FineSpace<3>(on_mesh.mesh, 1), by_case);
  }

  const Case<3>& case_;
  const RunOptions& options_;
  bool takes_mesh_ = false;
};

template <int Dim> class ExplicitRun final : public CaseRun {
 public:
  ExplicitRun(const DynamicsCase<Dim>& dynamics_case, const RunOptions& options)
      : case_(dynamics_case), options_(options), record_(options.out, case_, !options.no_picture) {
    if (!case_.state_start) return;
    std::error_code none;
    if (std::filesystem::equivalent(case_.state_start->directory, options.out, none))
      throw InputError(
          fmt::format("{}: state is the directory of this run's results, {}, which would take the place of "
                      "those of the earlier run: expected another --out",
                      case_.state_start->where, options.out));
    read_state_start(case_);
  }

  const std::string& title() const override { return case_.common.title; }
  std::vector<std::string> stages() const override {
    return {"mesh", "cloud", "weights", "basis", "quadrature", "bodies", "dynamics"};
  }
  bool stops_at_steps() const override { return true; }
  bool has_few_steps() const override { return false; }

  RunEnd run(OutputDirectory& out, const Monitor& monitor_of_run, Display& display) override {
    StageTimes times;
    const Monitor monitor = monitor_of_run.timing(times);
    const PreparedMesh<Dim> mesh = prepare(case_, monitor);
    for (const std::string& remark : mesh.remarks) monitor.say(remark);
    DynamicsModel<Dim> model = build_dynamics_model<Dim>(mesh, case_, monitor);
    for (const std::string& remark : model.remarks) monitor.say(remark);
    monitor.say(describe_model(model));
    record_.check_pictures(model);
    if (options_.resume) {
      record_.resume(model);
      say_first_step(monitor, model.dynamics.steps(), model.dynamics.time());
    } else {
      if (record_.is_unfinished()) warn_of_unfinished(display, options_.out);
      record_.add_bodies(*mesh.mesh);
    }
    const DynamicsOutcome outcome = run_dynamics<Dim>(model, case_,
                                                      {.history_line = [&] { record_.add_history_line(model); },
                                                       .frame = [&] { record_.add_frame(model); },
                                                       .checkpoint = [&] { record_.write_checkpoint(model); }},
                                                      monitor);
    for (const std::string& line : describe_run<Dim>(case_, model)) monitor.say(line);
    if (outcome.at_rest)
      monitor.say(
          fmt::format("at rest at time {:.6g}: the residual is {:.2g}", model.dynamics.time(), *outcome.residual));
    const auto warnings = collect_warnings<Dim>(case_, model, outcome);
    say_warnings(warnings, display);
    if (outcome.can_resume) return {.failure = outcome.stop_reason};
    if (outcome.stop_reason.empty()) record_.write_checkpoint(model);
    if (const std::string none = record_.finish(out); !none.empty()) say_warnings({none}, display);
    write_dynamics_result(out.file("result.json"), case_, model, record_.contact_forces(), outcome, warnings, times);
    return {.failure = outcome.stop_reason, .has_results = true};
  }
  bool save(OutputDirectory& out) override {
    if (!record_.has_begun()) return false;
    record_.finish(out);
    out.supersede("result.json");
    return true;
  }
  bool can_resume() const override { return record_.is_unfinished(); }
  void remove_unfinished() override { record_.remove_unfinished(); }

 private:
  DynamicsCase<Dim> case_;
  const RunOptions& options_;
  DynamicsRun<Dim> record_;
};

template <int Dim> class EffectiveRun final : public CaseRun {
 public:
  EffectiveRun(const EffectiveCase<Dim>& analysis, const RunOptions& options) : case_(analysis), options_(options) {}

  const std::string& title() const override { return case_.common.title; }
  std::vector<std::string> stages() const override { return {"image", "mesh", "solve", "subvolumes"}; }
  bool stops_at_steps() const override { return false; }
  bool has_few_steps() const override { return true; }

  RunEnd run(OutputDirectory& out, const Monitor& monitor, Display& display) override {
    if (options_.resume) throw InputError("--resume means nothing for effective properties: leave it out");
    const EffectiveResult result = find_effective<Dim>(case_, monitor);
    for (const std::string& line : describe_effective<Dim>(case_, result)) monitor.say(line);
    say_warnings(result.warnings, display);
    if (!options_.no_picture)
      if (const std::string none = draw_directions(out, case_.property, result); !none.empty()) monitor.say(none);
    write_effective_result<Dim>(out.file("result.json"), case_, result);
    return {.has_results = true};
  }
  bool save(OutputDirectory&) override { return false; }
  bool can_resume() const override { return false; }
  void remove_unfinished() override {}

 private:
  const EffectiveCase<Dim>& case_;
  const RunOptions& options_;
};

/// Has the run stop at its next step when a signal ends the program, and waits for that.
class StopSignal {
 public:
  /// Confirms when it goes out of scope.
  struct OnExit {
    StopSignal& signal;
    ~OnExit() { signal.confirm(); }
  };
  /// Asks the run to stop, and waits for a step and a checkpoint.
  void request() {
    requested_ = true;
    stopped_.get_future().wait_for(std::chrono::seconds(20));
  }
  bool is_requested() const { return requested_.load(); }
  void confirm() {
    if (!std::exchange(is_confirmed_, true)) stopped_.set_value();
  }

 private:
  std::atomic<bool> requested_ = false;
  std::promise<void> stopped_;
  bool is_confirmed_ = false;
};

/// From the first stage to the results on the disk.
void run_into_directory(CaseRun& run, const RunOptions& options, Display& display) {
  OutputDirectory out(options.out);
  StopSignal stop;
  const OnInterrupt clean_up([&] {
    if (run.stops_at_steps()) stop.request();
    out.discard();
  });
  const StopSignal::OnExit on_exit{stop};
  const Monitor monitor{
      .progress = display.stages(run.stages()),
      .cancelled = [&] { return stop.is_requested(); },
      .say =
          [&](const std::string& remark) {
            if (!options.quiet) display.say(remark);
          },
      .detail =
          [&](const std::string& how_far) { run.has_few_steps() ? display.line(how_far) : display.detail(how_far); }};
  RunEnd end;
  try {
    end = run.run(out, monitor, display);
  } catch (const Cancelled&) {
    display.say(run.can_resume() ? "stopped: --resume continues the run" : "stopped");
    stop.confirm();
    for (;;) std::this_thread::sleep_for(std::chrono::hours(1));  // the signal ends it
  } catch (const NumericalError& error) {
    out.clear();
    end = {.failure = error.what(), .has_results = run.save(out)};
  } catch (const std::bad_alloc&) {
    out.clear();
    end.failure = "there is not enough memory; take a coarser mesh, or a wider spacing of the cloud";
  }
  const std::string stage = end.rejected_by.empty() ? display.stage() : end.rejected_by;
  const std::string results = end.has_results ? "of this run" : out.has("result.json") ? "of an earlier run" : "none";
  if (end.failure.empty())
    out.supersede("failure.json");
  else
    write_failure(out.file("failure.json"), run.title(), end.failure, stage, results);
  out.commit();
  if (end.has_results) run.remove_unfinished();
  if (!end.failure.empty()) {
    const char* state = !end.has_results ? "" : end.rejected_by.empty() ? " until then" : ", and rejected";
    throw NumericalError(
        fmt::format("{}{}{}", end.rejected_by.empty() ? stage + " failed: " : "", end.failure,
                    results == "none" ? "" : fmt::format("; the results in {} are {}{}", options.out, results, state)));
  }
  if (end.has_results && !options.quiet) display.say(fmt::format("results in {}", options.out));
}

}  // namespace

template <int Dim> void run_case(Case<Dim> analysis, const RunOptions& options, Display& display) {
  std::string remark;
  if constexpr (Dim == 3)
    if (!options.resume && (analysis.geometry.image || analysis.cells == OnCells::always) &&
        analysis.cells != OnCells::never) {
      const std::string why = why_image_takes_mesh(analysis.geometry, analysis);
      if (why.empty() || analysis.cells == OnCells::always) {
        ImageRun run(analysis, options);
        run_into_directory(run, options, display);
        if (!run.takes_mesh()) return;
      } else {
        remark = fmt::format("not on cells, as {}: a mesh takes more time and memory", why);
      }
    }
  StaticRun<Dim> run(std::move(analysis), options, std::move(remark));
  run_into_directory(run, options, display);
}
template <int Dim> void run_case(const DynamicsCase<Dim>& dynamics_case, const RunOptions& options, Display& display) {
  ExplicitRun<Dim> run(dynamics_case, options);
  run_into_directory(run, options, display);
}
template <int Dim> void run_case(const EffectiveCase<Dim>& analysis, const RunOptions& options, Display& display) {
  EffectiveRun<Dim> run(analysis, options);
  run_into_directory(run, options, display);
}

template void run_case(Case<2>, const RunOptions&, Display&);
template void run_case(Case<3>, const RunOptions&, Display&);
template void run_case(const DynamicsCase<2>&, const RunOptions&, Display&);
template void run_case(const DynamicsCase<3>&, const RunOptions&, Display&);
template void run_case(const EffectiveCase<2>&, const RunOptions&, Display&);
template void run_case(const EffectiveCase<3>&, const RunOptions&, Display&);

}  // namespace efree
