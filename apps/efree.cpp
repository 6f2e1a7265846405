// SPDX-License-Identifier: GPL-3.0-or-later
// The command line program. Exit status: 0 done, 2 bad input, 3 numerical failure, 1 anything else.
#include "blas_kernels.hpp"
#include "crack_run.hpp"
#include "display.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/printable.hpp"
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"
#include "efree/io/case/case_file.hpp"
#include "efree/io/case/inspect.hpp"
#include "efree/io/files/output_directory.hpp"
#include "efree/io/pictures/comparison_charts.hpp"
#include "efree/io/pictures/picture.hpp"
#include "efree/io/pictures/study_charts.hpp"
#include "efree/io/records/comparison.hpp"
#include "efree/io/records/convergence.hpp"
#include "efree/io/records/writers.hpp"
#include "on_interrupt.hpp"
#include "run_case.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <vtkObject.h>
#include <CLI/CLI.hpp>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <utility>

namespace {

using namespace efree;

struct Options {
  std::string case_file;
  RunOptions run;  ///< `out` and `quiet` of all commands
  int threads = 0;
  bool json = false;
  Reading reading;
  std::string accuracy;
  double time_limit = 0.0;
  StudyOptions study;
  ComparisonOptions comparison;
  CrackRunOptions cracks;
};

/// What a file has put into a message cannot fill the terminal, nor tell it what to do.
std::string presentable(std::string message) {
  constexpr std::size_t longest = 1500;
  message = internal::printable(std::move(message));
  if (message.size() <= longest) return message;
  return fmt::format("{} ... {}", message.substr(0, longest / 2), message.substr(message.size() - longest / 2));
}

void inspect_file(const Options& options, Display& display) {
  std::visit(
      [&](const auto& inspection) {
        const std::string json = inspection_json(inspection);
        if (!options.run.out.empty()) {
          OutputDirectory out(options.run.out);
          write_pieces(out.file("geometry.vtu"), inspection);
          std::ofstream stream(out.file("inspection.json"));
          stream << json;
          if (!stream.flush()) throw InputError(fmt::format("cannot write inspection.json into {}", options.run.out));
          draw_pieces(out.file("geometry.png"), inspection);
          out.commit();
        }
        fmt::print("{}", options.json ? json : inspection_text(inspection));
      },
      inspect(options.case_file, options.reading, {.progress = display.waiting()}));
}

template <int Dim> void convergence(const Case<Dim>& analysis, const Options& options, Display& display) {
  OutputDirectory out(options.run.out);
  const OnInterrupt clean_up([&out] { out.discard(); });
  const Study study = run_study<Dim>(analysis.geometry, analysis, options.study, {.progress = display.runs()});
  write_study_csv(out.file("convergence.csv"), study);
  write_study_json(out.file("convergence.json"), analysis.common.title, study);
  const std::string no_charts = write_charts(out, study);
  if (!no_charts.empty()) display.say(no_charts);
  if (!analysis.has_exact()) display.say("the case has no [exact] solution: no errors, no observed orders");
  out.commit();
  if (!options.run.quiet) display.say(fmt::format("results in {}", options.run.out));
  if (analysis.has_exact()) fmt::print("{}", order_table(study));
}

template <int Dim> void compare(const DynamicsCase<Dim>& dynamics_case, const Options& options, Display& display) {
  OutputDirectory out(options.run.out);
  const OnInterrupt clean_up([&out] { out.discard(); });
  const Comparison comparison =
      compare_methods<Dim>(dynamics_case.geometry, dynamics_case, options.comparison, {.progress = display.runs()});
  write_comparison_csv(out.file("comparison.csv"), comparison);
  write_comparison_json(out.file("comparison.json"), dynamics_case.common.title, comparison);
  const std::string no_charts = write_charts(out, comparison);
  if (!no_charts.empty()) display.say(no_charts);
  if (comparison.probes.empty()) display.say("the case has no [[probe]]: energies are compared, and nothing else");
  out.commit();
  if (!options.run.quiet) display.say(fmt::format("results in {}", options.run.out));
  fmt::print("{}", comparison_table(comparison));
  if (!comparison.has_results()) throw NumericalError("no run came to its end; the table says why");
}
template <int Dim> void compare(const Case<Dim>&, const Options& options, Display&) {
  throw InputError(fmt::format(
      "{}: methods of explicit dynamics are compared, and this case is static: see efree convergence --compare",
      options.case_file));
}

template <int Dim> void compare(const EffectiveCase<Dim>&, const Options& options, Display&) {
  throw InputError(fmt::format(
      "{}: methods of explicit dynamics are compared, and this case is of effective properties", options.case_file));
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

/// A case as the command line asks for it.
template <int Dim> Case<Dim> with_options(Case<Dim> analysis, const Options& options) {
  if (!options.accuracy.empty()) analysis.accuracy = accuracy_of(options.accuracy);
  if (options.time_limit > 0.0) analysis.time_limit = options.time_limit;
  return analysis;
}
template <int Dim> DynamicsCase<Dim> with_options(DynamicsCase<Dim> dynamics_case, const Options& options) {
  if (!options.accuracy.empty())
    throw InputError(fmt::format("{}: --accuracy means nothing in explicit dynamics: leave it out", options.case_file));
  if (options.time_limit > 0.0) dynamics_case.time_limit = options.time_limit;
  return dynamics_case;
}

template <int Dim> EffectiveCase<Dim> with_options(EffectiveCase<Dim> analysis, const Options& options) {
  if (!options.accuracy.empty() || options.time_limit > 0.0)
    throw InputError(
        fmt::format("{}: --accuracy and --time-limit mean nothing for effective properties, whose error is reported: "
                    "take a smaller mesh_size",
                    options.case_file));
  return analysis;
}

/// Whether all of a text is a finite number above that.
bool is_number_above(double bound, const std::string& text) {
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc{} && end == text.data() + text.size() && value > bound && std::isfinite(value);
}
/// Complaint about an element of a list of positive numbers; empty if there is none.
std::string not_positive(const std::string& text) {
  return is_number_above(0.0, text) ? "" : fmt::format("\"{}\", expected positive numbers separated by commas", text);
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
  command.add_option("--out", options.run.out, "directory for the results, created if need be")
      ->required()
      ->type_name("DIR");
  command.add_option("--threads", options.threads, "number of threads; default: all cores")->check(CLI::Range(1, 4096));
  command.add_flag("--quiet", options.run.quiet, "no progress");
  add_reading(command, options);
}

int run(int argc, char** argv) {
  CLI::App app("Solid mechanics without elements, on the geometry people actually have", "efree");
  app.set_version_flag("--version", "efree " + version());
  app.require_subcommand(1);
  Options options;
  CLI::App& solve_command = *app.add_subcommand(
      "solve",
      "solve a case, static, of explicit dynamics or of effective properties; writes result.json, fields and pictures");
  solve_command.alias("run");
  add_common(solve_command, options);
  solve_command.add_flag("--no-picture", options.run.no_picture, "draw no pictures");
  solve_command.add_flag("--resume", options.run.resume,
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
      ->allow_extra_args(false)
      ->type_name("H")
      ->check(positive);
  CLI::Option* seeds =
      convergence_command
          .add_option("--seeds", options.study.seeds, "clouds per spacing; default: 1, with --compare 5")
          ->check(CLI::Range(1, 1000));
  convergence_command.add_flag("--compare", options.study.compare,
                               "all methods: both secondary bases at M/N = 1, 2, 4 (MLS also at 6), full integration, "
                               "P1 and P2 finite elements");
  CLI::App& compare_command = *app.add_subcommand(
      "compare", "run a case of explicit dynamics by several methods, coarse to fine: errors and energies over time");
  add_common(compare_command, options);
  std::vector<std::string> method_names;
  for (const ComparedMethod& method : compared_methods()) method_names.push_back(method.name);
  compare_command
      .add_option("--methods", options.comparison.methods,
                  fmt::format("of {}, separated by commas; default: all", fmt::join(method_names, ", ")))
      ->delimiter(',')
      ->allow_extra_args(false)
      ->type_name("METHODS");
  compare_command
      .add_option("--resolutions", options.comparison.resolutions,
                  "runs of each method: that of the case and coarser ones, spacings times the root of two each")
      ->check(CLI::Range(1, 10))
      ->capture_default_str();
  compare_command
      .add_option("--time-limit", options.time_limit, "seconds after which a run is stopped and counts as failed")
      ->type_name("SECONDS")
      ->check(CLI::PositiveNumber);
  CLI::App& cracks_command = *app.add_subcommand(
      "cracks",
      "mesh the cracks of a finished run of explicit dynamics; writes VTU, OBJ, glTF, pictures and cracks.csv");
  cracks_command.add_option("DIR", options.cracks.run, "results of efree run")->required();
  cracks_command
      .add_option("--out", options.cracks.out, "directory for the results, created if need be; default: DIR/cracks")
      ->type_name("DIR");
  cracks_command
      .add_option("--stretch", options.cracks.files.cracks.stretch,
                  "edges between points are cut once they are so many times as long as at the start; more than 1")
      ->check([](const std::string& text) {
        return is_number_above(1.0, text) ? "" : fmt::format("{}, expected a number of more than 1", text);
      })
      ->capture_default_str();
  cracks_command
      .add_option("--smoothing", options.cracks.files.cracks.smoothing, "sweeps that make the faces of cracks even")
      ->check(CLI::Range(0, 10000))
      ->capture_default_str();
  cracks_command.add_option(
      "--colour", options.cracks.files.colour,
      "field of the points to colour by; default: plastic strain if there is one, else von Mises");
  bool no_crack_pictures = false;
  cracks_command.add_flag("--no-picture", no_crack_pictures, "draw no pictures");
  cracks_command.add_flag("--quiet", options.run.quiet, "no progress");
  cracks_command.add_option("--threads", options.threads, "number of threads; default: all cores")
      ->check(CLI::Range(1, 4096));
  CLI::App& inspect_command = *app.add_subcommand(
      "inspect", "say what a file holds: bodies, named parts of the boundary, smallest feature, faults");
  inspect_command
      .add_option("FILE", options.case_file, "gmsh, CAD, image or surface file, or a case file for its geometry")
      ->required();
  inspect_command.add_option("--out", options.run.out, "directory for geometry.png, geometry.vtu and inspection.json")
      ->type_name("DIR");
  inspect_command.add_flag("--json", options.json, "JSON instead of text");
  add_reading(inspect_command, options);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  if (!inspect_command.parsed()) choose_fast_blas(argv);
  keep_freed_memory();
  if (options.study.compare && seeds->empty()) options.study.seeds = 5;
  // What libraries say aside (CGAL, OpenCASCADE, VTK): it comes back as an error, once. Ours goes through stdio.
  std::cout.rdbuf(nullptr);
  std::cerr.rdbuf(nullptr);
  vtkObject::GlobalWarningDisplayOff();
  if (options.threads > 0) set_num_threads(options.threads);
  Display display(options.run.quiet);
  try {
    if (cracks_command.parsed()) {
      options.cracks.files.pictures = !no_crack_pictures;
      run_cracks(options.cracks, options.run.quiet, display);
      return 0;
    }
    if (inspect_command.parsed()) {
      inspect_file(options, display);
      return 0;
    }
    const Monitor reading{.progress = display.waiting()};
    if (convergence_command.parsed()) {
      std::visit([&](const auto& analysis) { convergence(analysis, options, display); },
                 read_static_case(options.case_file, options.reading, reading));
      return 0;
    }
    if (compare_command.parsed()) {
      std::visit([&](auto any) { compare(with_options(std::move(any), options), options, display); },
                 read_case(options.case_file, options.reading, reading));
      return 0;
    }
    std::visit([&](auto any) { run_case(with_options(std::move(any), options), options.run, display); },
               read_case(options.case_file, options.reading, reading));
    return 0;
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
