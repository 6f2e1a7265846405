// SPDX-License-Identifier: GPL-3.0-or-later
// The command line program. Exit status: 0 done, 2 bad input, 3 numerical failure, 1 anything else.
#include "display.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/io/output_directory.hpp"
#include "efree/io/writers.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>
#include <CLI/CLI.hpp>
#include <filesystem>

namespace {

using namespace efree;
namespace fs = std::filesystem;

struct Options {
  std::string case_file, out;
  int threads = 0;
  bool quiet = false;
  bool picture = true;
};

/// Draws fields.png by the program beside this one; whatever goes wrong there is a message here.
void draw_picture(OutputDirectory& out, Display& display) {
  out.supersede("fields.png");
  const fs::path program = fs::read_symlink("/proc/self/exe").parent_path() / "efree-picture";
  const std::string fields = out.file("fields.vtu").string(), picture = out.file("fields.png").string();
  const pid_t child = fork();
  if (child == 0) {
    const int nowhere = open("/dev/null", O_WRONLY);
    dup2(nowhere, STDERR_FILENO);  // VTK's own words help nobody who asked for an analysis
    execl(program.c_str(), program.c_str(), fields.c_str(), picture.c_str(), nullptr);
    _exit(127);
  }
  int status = -1;
  if (child > 0) waitpid(child, &status, 0);
  if (status != 0) {
    std::error_code ignored;
    fs::remove(picture, ignored);
    display.say("no picture of the fields (fields.png): that needs an X display or Xvfb; everything else is written");
  }
}

void solve(const Options& options, Display& display) {
  const Case analysis = read_case(options.case_file);
  OutputDirectory out(options.out);
  try {
    CaseResult result = solve_case(
        analysis, display.stages({"mesh", "cloud", "weights", "basis", "quadrature", "assembly", "solve", "output"}));
    {
      const Stage stage("output", result.times, {});
      write_fields(out.file("fields.vtu"), analysis, result);
      write_nodes(out.file("nodes.vtu"), result);
      if (options.picture) draw_picture(out, display);
    }
    write_result(out.file("result.json"), analysis, result);
    out.supersede("failure.json");
    out.commit();
  } catch (const NumericalError& error) {
    write_failure(out.file("failure.json"), analysis, error.what(), display.stage());
    out.commit();
    throw;
  }
  if (!options.quiet) display.say(fmt::format("results in {}", options.out));
}

void add_common(CLI::App& command, Options& options) {
  command.add_option("CASE", options.case_file, "case file (TOML, see docs/case-file.md)")->required();
  command.add_option("--out", options.out, "directory for the results, created if need be")
      ->required()
      ->type_name("DIR");
  command.add_option("--threads", options.threads, "number of threads; default: all cores")->check(CLI::Range(1, 4096));
  command.add_flag("--quiet", options.quiet, "no progress");
}

int run(int argc, char** argv) {
  CLI::App app("Solid mechanics without elements, on the geometry people actually have", "efree");
  app.set_version_flag("--version", "efree " + version());
  app.require_subcommand(1);
  Options options;
  CLI::App& solve_command =
      *app.add_subcommand("solve", "solve a case; writes result.json, fields.vtu, nodes.vtu and fields.png");
  add_common(solve_command, options);
  solve_command.add_flag("!--no-picture", options.picture, "do not draw fields.png");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  if (options.threads > 0) set_num_threads(options.threads);
  Display display(options.quiet);
  try {
    solve(options, display);
    return 0;
  } catch (const InputError& error) {
    display.say(fmt::format("error: {}", error.what()));
    return 2;
  } catch (const NumericalError& error) {
    display.say(fmt::format("error: {} failed: {}", display.stage(), error.what()));
    return 3;
  } catch (const std::exception& error) {
    display.say(fmt::format("error: {}", error.what()));
    return 1;
  }
}

}  // namespace

int main(int argc, char** argv) {
  return run(argc, argv);
}
