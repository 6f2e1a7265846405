// SPDX-License-Identifier: GPL-3.0-or-later
// The command line program. Exit status: 0 done, 2 bad input, 3 numerical failure, 1 anything else.
#include "blas_kernels.hpp"
#include "display.hpp"
#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"
#include "efree/io/case/case_file.hpp"
#include "efree/io/case/inspect.hpp"
#include "efree/io/files/output_directory.hpp"
#include "efree/io/pictures/history_chart.hpp"
#include "efree/io/pictures/picture.hpp"
#include "efree/io/pictures/study_charts.hpp"
#include "efree/io/records/convergence.hpp"
#include "efree/io/records/dynamics_report.hpp"
#include "efree/io/records/dynamics_run.hpp"
#include "efree/io/records/history.hpp"
#include "efree/io/records/path_record.hpp"
#include "efree/io/records/writers.hpp"
#include "on_interrupt.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <vtkObject.h>
#include <CLI/CLI.hpp>
#include <atomic>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <future>
#include <iostream>
#include <thread>
#include <tuple>
#include <utility>

namespace {

using namespace efree;
namespace fs = std::filesystem;

struct Options {
  std::string case_file, out;
  int threads = 0;
  bool quiet = false;
  bool no_picture = false;
  bool resume = false;
  bool json = false;
  Reading reading;
  std::string accuracy;
  double time_limit = 0.0;
  StudyOptions study;
};

template <int Dim> std::string estimates_text(const Result<Dim>& result) {
  const Estimates& estimates = *result.estimates;
  if (result.cells)
    return fmt::format(
        "{} cells, {} iterations; error in the energy norm: about {:.2g} %; strain energy {:.6g}, extrapolated {:.6g}; "
        "half a voxel changes it by {:.2g} %",
        result.cells->finest().cells, estimates.corrections, 100.0 * estimates.total(), result.solution.strain_energy,
        result.cells->extrapolated_energy, 100.0 * result.cells->half_voxel);
  const std::string of_facets =
      estimates.geometry > 0.0 ? fmt::format(", {:.2g} % of the facets of the boundary", 100.0 * estimates.geometry)
                               : "";
  if (estimates.cloud == 0.0 && estimates.uncorrected == 0.0)  // finite elements that are solved at once
    return fmt::format("error in the energy norm: about {:.2g} %{}", 100.0 * estimates.mesh, of_facets);
  const bool has_cloud = result.elements || result.approximation.shape.num_nodes() < result.approximation.space.size();
  const std::string of_cloud = fmt::format("error in the energy norm: {:.2g} % of {}", 100.0 * estimates.uncorrected,
                                           has_cloud ? "the cloud" : "linear elements");
  const std::string corrected = estimates.corrections == 0
                                    ? ""
                                    : fmt::format(", {:.2g} % after {} correction{}", 100.0 * estimates.cloud,
                                                  estimates.corrections, estimates.corrections == 1 ? "" : "s");
  return fmt::format("{}{}; about {:.2g} % of the fine mesh{}", of_cloud, corrected, 100.0 * estimates.mesh, of_facets);
}

std::string path_errors_text(const PathErrors& errors) {
  const auto [most, of] = errors.largest();
  return fmt::format(
      "error of the path, by one of {:.2g} times the spacing: about {:.2g} % of the work, at most {:.2g} % ({}); of "
      "the "
      "stresses at the end {}",
      errors.coarser, 100.0 * errors.work, 100.0 * most, of,
      errors.stress ? fmt::format("{:.2g} %", 100.0 * *errors.stress) : "unknown");
}

/// The components with those that are rounding, measured by `scale`, as 0.
template <class Values> Values rounded(Values values, double scale) {
  for (double& value : values)
    if (std::abs(value) <= 1e-10 * scale) value = 0.0;
  return values;
}
template <int Dim> std::string resultant_text(const Resultant<Dim>& of, const Resultant<Dim>& scale) {
  return fmt::format("force ({:.6g}), moment ({:.6g})", fmt::join(rounded(of.force, scale.force.norm()), ", "),
                     fmt::join(rounded(of.moment, scale.moment.norm()), ", "));
}

/// Probes, loads, reactions and extremes, with their errors where they are known, a line each.
template <int Dim> std::vector<std::string> numbers_text(const Result<Dim>& result, const Settings<Dim>& settings) {
  const auto& cases = settings.cases;
  std::vector<std::string> lines;
  const auto say = [&](const std::string& what, const Vec<Dim>& value, const Vec<Dim>* error) {
    lines.push_back(fmt::format("{} ({:.6g})", what, fmt::join(value, ", ")));
    if (error)
      lines.back() +=
          fmt::format(" +- ({:.2g}), {:.2g} %", fmt::join(*error, ", "), 100.0 * relative_error<Dim>(value, *error));
  };
  const auto say_wanted = [&](const Answer<Dim>& answer) {
    for (const auto& [name, values] : answer.probes) {
      const auto error = answer.probe_errors.find(name);
      say(fmt::format("probe \"{}\": displacement", name), values.displacement,
          error == answer.probe_errors.end() ? nullptr : &error->second);
    }
    for (const auto& reaction : answer.reactions)
      say(fmt::format("reaction \"{}\": force", reaction.name), reaction.force, &reaction.error);
  };
  const auto say_balance = [&](const auto& balance) {
    Resultant<Dim> scale;
    const auto add = [&](const Resultant<Dim>& of) { scale += {of.force.cwiseAbs(), of.moment.cwiseAbs()}; };
    for (const auto& load : balance.loads) add(load.of);
    for (const auto& [part, of] : balance.reactions) add(of);
    for (const auto& load : balance.loads)
      lines.push_back(fmt::format("load {}{}: {}", load.kind, load.on.empty() ? "" : fmt::format(" on \"{}\"", load.on),
                                  resultant_text<Dim>(load.of, scale)));
    for (const auto& [part, of] : balance.reactions)
      lines.push_back(fmt::format("reaction of \"{}\": {}", part, resultant_text<Dim>(of, scale)));
    lines.push_back(fmt::format("loads and reactions balance to {:.1g}, relative", balance.error));
  };
  const auto say_extremes = [&](const std::vector<Extreme<Dim>>& extremes) {
    for (const auto& extreme : extremes)
      lines.push_back(fmt::format(
          "largest {} {:.6g} at ({:.6g}){}", extreme.of == "displacement" ? "displacement" : "von Mises stress",
          extreme.value, fmt::join(extreme.at, ", "), extreme.error ? fmt::format(" +- {:.2g}", *extreme.error) : ""));
  };
  if (!cases.empty()) lines.push_back(fmt::format("case \"{}\":", cases.front().name));
  say_wanted(result);
  if (!result.history.empty())  // without errors
    for (const auto& reaction : settings.reactions)
      say(fmt::format("reaction \"{}\": force", reaction.name), result.balance.reactions.at(reaction.on).force,
          nullptr);
  say_balance(result.balance);
  say_extremes(result.extremes);
  for (std::size_t k = 1; k < cases.size(); ++k) {
    const Answer<Dim>& answer = result.more[k - 1];
    lines.push_back(fmt::format("case \"{}\":", cases[k].name));
    say_wanted(answer);
    say_balance(answer.balance);
    say_extremes(answer.extremes);
  }
  return lines;
}

/// Exit status.
template <int Dim>
int solve(Case<Dim> analysis, const Options& options, const Monitor::Progress& progress, Display& display) {
  OutputDirectory out(options.out);
  const OnInterrupt clean_up([&out] { out.discard(); });
  PathRecord<Dim> record(options.out, analysis);
  analysis.steps.done = [&record](const Checkpoint<Dim>& there, const Result<Dim>& so_far) {
    record.keep(there, so_far);
  };
  const auto fail = [&](const std::string& reason) {
    const bool is_earlier = out.has("result.json");
    out.clear();
    write_failure(out.file("failure.json"), analysis.title, reason, display.stage(),
                  is_earlier ? "of an earlier run" : "none");
    out.commit();
    throw NumericalError(
        fmt::format("{} failed: {}{}", display.stage(), reason,
                    is_earlier ? fmt::format("; the results in {} are of an earlier run", options.out) : ""));
  };
  try {
    const auto say = [&](const std::string& remark) {
      if (!options.quiet) display.say(remark);
    };
    const Monitor monitor{
        .progress = progress, .say = say, .detail = [&](const std::string& how_far) { display.line(how_far); }};
    if (options.resume) {
      analysis.steps.from = record.resume();
      say(fmt::format("goes on from step {} at time {:.6g}", analysis.steps.from->at.steps,
                      analysis.steps.from->at.time));
    } else if (record.is_unfinished()) {
      say(fmt::format("{} has the steps of a run that did not end: --resume goes on from them; they go now",
                      options.out));
    }
    Result<Dim> result = analyse(analysis, monitor);
    if (result.estimates) say(estimates_text(result));
    if (result.path_errors) say(path_errors_text(*result.path_errors));
    for (const std::string& line : numbers_text<Dim>(result, analysis)) say(line);
    for (const std::string& warning : result.warnings) display.say(fmt::format("warning: {}", warning));
    {
      const Stage stage("output", monitor.timing(result.times));
      out.supersede("fields.png");
      out.supersede("error.png");
      out.supersede("history.png");
      const auto draw = [&] {
        draw_fields(out.file("fields.png"), analysis, result);
        if (result.error_density.size() > 0) draw_error(out.file("error.png"), analysis, result);
        if (!result.history.empty()) draw_history(out.file("history.png"), analysis, result.history);
      };
      const auto write = [&] {
        write_fields(out.file("fields.vtu"), analysis, result);
        if (!result.cells) write_nodes(out.file("nodes.vtu"), result);
      };
      // Both only read the result.
      parallel_chunks(options.no_picture ? 1 : 2, 1, [&](Index task, Index) { task == 0 ? write() : draw(); });
    }
    if (result.history.empty())
      out.supersede("history.csv");
    else
      write_history(out.file("history.csv"), analysis, result.history);
    record.finish(out, result);
    write_result(out.file("result.json"), analysis, result);
    if (result.refusal.empty())
      out.supersede("failure.json");
    else
      write_failure(out.file("failure.json"), analysis.title, result.refusal,
                    result.history.empty() ? "correction" : "path", "of this run");
    out.commit();
    record.forget();
    if (!result.refusal.empty()) {
      display.say(fmt::format("error: {}; the results are in {} all the same", result.refusal, options.out));
      return 3;
    }
  } catch (const NumericalError& error) {
    fail(error.what());
  } catch (const std::bad_alloc&) {
    fail("there is not enough memory; take a coarser mesh, or a wider spacing of the cloud");
  }
  if (!options.quiet) display.say(fmt::format("results in {}", options.out));
  return 0;
}

/// Lets a signal's handler wait until the run has stopped.
class StopSignal {
 public:
  /// Confirms that the run has stopped when it goes out of scope.
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

/// Explicit dynamics of a case; its results are in `out`. Returns why the run ended before its time, or nothing, and
/// whether there are results of this run.
template <int Dim> std::pair<std::string, bool> run_case(const DynamicsCase<Dim>& dynamics_case, const Options& options,
                                                         const Monitor& monitor, OutputDirectory& out,
                                                         DynamicsRun<Dim>& run, Display& display) {
  const auto say = monitor.say;
  const PreparedMesh<Dim> mesh = prepare<Dim>(dynamics_case.geometry, dynamics_case, monitor);
  for (const std::string& remark : mesh.remarks) say(remark);
  DynamicsModel<Dim> model = build_dynamics_model(mesh, dynamics_case, dynamics_case.dynamics, monitor);
  for (const std::string& remark : model.remarks) say(remark);
  say(describe_model(model));
  if (options.resume) {
    run.resume(model);
    say(fmt::format("goes on from step {} at time {:.6g}", model.dynamics.steps(), model.dynamics.time()));
  } else if (run.is_unfinished()) {
    say(fmt::format("{} has the steps of a run that did not end: --resume goes on from them; they go now",
                    options.out));
  }
  const DynamicsOutcome outcome = run_dynamics(model, dynamics_case.dynamics,
                                               {.history_line = [&] { run.add_history_line(model); },
                                                .frame = [&] { run.add_frame(model); },
                                                .checkpoint = [&] { run.write_checkpoint(model); }},
                                               monitor);
  for (const std::string& line : describe_run(dynamics_case.dynamics, model)) say(line);
  const auto warnings = collect_warnings(dynamics_case.dynamics, model);
  for (const std::string& warning : warnings) display.say(fmt::format("warning: {}", warning));
  if (outcome.can_resume) return {outcome.stop_reason, false};
  if (outcome.stop_reason.empty()) run.write_checkpoint(model);
  run.finish(out);
  write_dynamics_result(out.file("result.json"), dynamics_case, model, outcome, warnings, *monitor.times);
  return {outcome.stop_reason, true};
}

/// Exit status. Signals end it after a checkpoint.
template <int Dim> int run_dynamics_case(const DynamicsCase<Dim>& dynamics_case, const Options& options,
                                         const Monitor::Progress& progress, Display& display) {
  OutputDirectory out(options.out);
  StopSignal stop;
  const OnInterrupt clean_up([&] {
    stop.request();
    out.discard();
  });
  const StopSignal::OnExit on_exit{stop};
  DynamicsRun<Dim> run(options.out, dynamics_case, !options.no_picture);
  StageTimes times;
  const Monitor monitor{.progress = progress,
                        .cancelled = [&] { return stop.is_requested(); },
                        .say =
                            [&](const std::string& remark) {
                              if (!options.quiet) display.say(remark);
                            },
                        .times = &times,
                        .detail = [&](const std::string& how_far) { display.detail(how_far); }};
  std::string failure;
  bool has_results = false;  // of this run
  try {
    std::tie(failure, has_results) = run_case(dynamics_case, options, monitor, out, run, display);
  } catch (const Cancelled&) {
    stop.confirm();
    for (;;) std::this_thread::sleep_for(std::chrono::hours(1));  // the signal ends it
  } catch (const NumericalError& error) {
    failure = error.what();
    out.clear();
    has_results = run.has_begun();
    if (has_results) run.finish(out);
    if (has_results) out.supersede("result.json");
  } catch (const std::bad_alloc&) {
    failure = "there is not enough memory; take a coarser mesh, or a wider spacing of the cloud";
    out.clear();
  }
  const std::string whose = has_results ? "of this run" : out.has("result.json") ? "of an earlier run" : "none";
  const std::string stage = display.stage();
  if (failure.empty())
    out.supersede("failure.json");
  else
    write_failure(out.file("failure.json"), dynamics_case.title, failure, stage, whose);
  out.commit();
  if (has_results) run.remove_unfinished();
  if (!failure.empty())
    throw NumericalError(fmt::format("{} failed: {}{}", stage, failure,
                                     has_results ? fmt::format("; the results until then are in {}", options.out)
                                     : whose == "none"
                                         ? ""
                                         : fmt::format("; the results in {} are {}", options.out, whose)));
  if (!options.quiet) display.say(fmt::format("results in {}", options.out));
  return 0;
}

/// What a file has put into a message cannot fill the terminal, nor tell it what to do.
std::string presentable(std::string message) {
  constexpr std::size_t longest = 1500;
  for (char& c : message)
    if (static_cast<unsigned char>(c) < ' ' || c == '\x7f') c = ' ';
  if (message.size() <= longest) return message;
  return fmt::format("{} ... {}", message.substr(0, longest / 2), message.substr(message.size() - longest / 2));
}

void inspect_file(const Options& options, Display& display) {
  std::visit(
      [&](const auto& inspection) {
        const std::string json = inspection_json(inspection);
        if (!options.out.empty()) {
          OutputDirectory out(options.out);
          write_pieces(out.file("geometry.vtu"), inspection);
          std::ofstream stream(out.file("inspection.json"));
          stream << json;
          if (!stream.flush()) throw InputError(fmt::format("cannot write inspection.json into {}", options.out));
          draw_pieces(out.file("geometry.png"), inspection);
          out.commit();
        }
        fmt::print("{}", options.json ? json : inspection_text(inspection));
      },
      inspect(options.case_file, options.reading, {.progress = display.waiting()}));
}

template <int Dim> void convergence(const Case<Dim>& analysis, const Options& options, Display& display) {
  OutputDirectory out(options.out);
  const OnInterrupt clean_up([&out] { out.discard(); });
  const Study study = run_study<Dim>(analysis.geometry, analysis, options.study, {.progress = display.runs()});
  write_study_csv(out.file("convergence.csv"), study);
  write_study_json(out.file("convergence.json"), analysis.title, study);
  const std::string no_charts = write_charts(out, study);
  if (!no_charts.empty()) display.say(no_charts);
  if (!analysis.has_exact()) display.say("the case has no [exact] solution: no errors, no observed orders");
  out.commit();
  if (!options.quiet) display.say(fmt::format("results in {}", options.out));
  if (analysis.has_exact()) fmt::print("{}", order_table(study));
}

/// 0.02 or 2%; 0 if it is no such number.
double accuracy_of(std::string text) {
  const bool percent = text.ends_with('%');
  if (percent) text.pop_back();
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return 0.0;
  value *= percent ? 0.01 : 1.0;
  return value >= 1e-6 && value < 1.0 ? value : 0.0;
}

/// Complaint about an element of a list of positive numbers; empty if there is none.
std::string not_positive(const std::string& text) {
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  const bool good = error == std::errc{} && end == text.data() + text.size() && value > 0.0 && std::isfinite(value);
  return good ? "" : fmt::format("\"{}\", expected positive numbers separated by commas", text);
}

void add_reading(CLI::App& command, Options& options) {
  command.add_flag("--trust", options.reading.trust,
                   "let .geo scripts run programs, write files and read those of other folders");
  command
      .add_option("--mesh-time-limit", options.reading.seconds,
                  "seconds that reading and meshing may take; default: 3600, of reading CAD files 20 and 20 per MB")
      ->type_name("SECONDS")
      ->check(CLI::PositiveNumber);
}

void add_common(CLI::App& command, Options& options) {
  command.add_option("CASE", options.case_file, "case file (TOML, see docs/case-file.md)")->required();
  command.add_option("--out", options.out, "directory for the results, created if need be")
      ->required()
      ->type_name("DIR");
  command.add_option("--threads", options.threads, "number of threads; default: all cores")->check(CLI::Range(1, 4096));
  command.add_flag("--quiet", options.quiet, "no progress");
  add_reading(command, options);
}

int run(int argc, char** argv) {
  CLI::App app("Solid mechanics without elements, on the geometry people actually have", "efree");
  app.set_version_flag("--version", "efree " + version());
  app.require_subcommand(1);
  Options options;
  CLI::App& solve_command = *app.add_subcommand(
      "solve", "solve a case, static or of explicit dynamics; writes result.json, fields and pictures");
  solve_command.alias("run");
  add_common(solve_command, options);
  solve_command.add_flag("--no-picture", options.no_picture, "draw no pictures");
  solve_command.add_flag("--resume", options.resume,
                         "go on from where an earlier run through time, or of explicit dynamics, was stopped");
  const CLI::Validator positive([](const std::string& text) { return not_positive(text); }, "");
  solve_command
      .add_option(
          "--accuracy", options.accuracy,
          "relative error in the energy norm to be reached, as 0.02 or 2%; without mesh_size and spacing in the "
          "case they are chosen")
      ->type_name("ERROR")
      ->check([](const std::string& text) { return accuracy_of(text) > 0.0 ? "" : "expected 0.02 or 2%, below 1"; });
  solve_command
      .add_option(
          "--time-limit", options.time_limit,
          "with an accuracy: seconds after which no finer mesh is begun; in explicit dynamics: after which a run is "
          "stopped, for --resume")
      ->type_name("SECONDS")
      ->check(CLI::PositiveNumber);
  CLI::App& convergence_command = *app.add_subcommand(
      "convergence", "solve a case on finer and finer clouds; writes convergence.csv, convergence.json and charts");
  add_common(convergence_command, options);
  convergence_command
      .add_option("--spacing", options.study.spacings,
                  "cloud spacings H, separated by commas (element sizes if basis.kind is p1 or p2)")
      ->required()
      ->delimiter(',')
      ->type_name("H")
      ->check(positive);
  CLI::Option* seeds =
      convergence_command
          .add_option("--seeds", options.study.seeds, "clouds per spacing; default: 1, with --compare 5")
          ->check(CLI::Range(1, 1000));
  convergence_command.add_flag("--compare", options.study.compare,
                               "all methods: both secondary bases at M/N = 1, 2, 4 (MLS also at 6), full integration, "
                               "P1 and P2 finite elements");
  CLI::App& inspect_command = *app.add_subcommand(
      "inspect", "say what a file holds: bodies, named parts of the boundary, smallest feature, faults");
  inspect_command
      .add_option("FILE", options.case_file, "gmsh, CAD, image or surface file, or a case file for its geometry")
      ->required();
  inspect_command.add_option("--out", options.out, "directory for geometry.png, geometry.vtu and inspection.json")
      ->type_name("DIR");
  inspect_command.add_flag("--json", options.json, "JSON instead of text");
  add_reading(inspect_command, options);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  if (!inspect_command.parsed()) restart_with_fast_blas(argv);
  keep_freed_memory();
  if (options.study.compare && seeds->empty()) options.study.seeds = 5;
  // What libraries say aside (CGAL, OpenCASCADE, VTK): it comes back as an error, once. Ours goes through stdio.
  std::cout.rdbuf(nullptr);
  std::cerr.rdbuf(nullptr);
  vtkObject::GlobalWarningDisplayOff();
  if (options.threads > 0) set_num_threads(options.threads);
  Display display(options.quiet);
  try {
    if (inspect_command.parsed()) {
      inspect_file(options, display);
      return 0;
    }
    if (solve_command.parsed() && is_dynamics_case(options.case_file)) {
      if (!options.accuracy.empty())
        throw InputError(fmt::format("{}: --accuracy means nothing in explicit dynamics", options.case_file));
      const Monitor::Progress progress =
          display.stages({"read", "mesh", "cloud", "weights", "basis", "quadrature", "bodies", "dynamics"});
      return std::visit(
          [&](auto dynamics_case) {
            if (options.time_limit > 0.0) dynamics_case.dynamics.time_limit = options.time_limit;
            return run_dynamics_case(dynamics_case, options, progress, display);
          },
          read_dynamics_case(options.case_file, options.reading, {.progress = progress}));
    }
    const Monitor::Progress progress = display.stages({"read", "mesh", "cloud", "weights", "basis", "quadrature",
                                                       "assembly", "solve", "path", "correction", "duals", "output"});
    return std::visit(
        [&](auto analysis) {
          if (!options.accuracy.empty()) analysis.accuracy = accuracy_of(options.accuracy);
          if (options.time_limit > 0.0) analysis.time_limit = options.time_limit;
          if (solve_command.parsed()) return solve(analysis, options, progress, display);
          convergence(analysis, options, display);
          return 0;
        },
        read_case(options.case_file, options.reading, {.progress = progress}));
  } catch (const InputError& error) {
    display.say(fmt::format("error: {}", presentable(error.what())));
    return 2;
  } catch (const NumericalError& error) {
    display.say(fmt::format("error: {}", presentable(error.what())));
    return 3;
  } catch (const std::bad_alloc&) {
    display.say("error: there is not enough memory");
    return 3;
  } catch (const std::exception& error) {
    display.say(fmt::format("error: {}", presentable(error.what())));
    return 1;
  }
}

}  // namespace

int main(int argc, char** argv) try { return run(argc, argv); } catch (...) {
  std::fputs("error: efree cannot go on\n", stderr);  // not even a message could be made
  return 1;
}
