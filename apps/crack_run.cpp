// SPDX-License-Identifier: GPL-3.0-or-later
#include "crack_run.hpp"

#include "on_interrupt.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <filesystem>
#include <vector>

namespace efree {
namespace {

/// More than so many of all edges cut are a sign of flow rather than of cracks.
constexpr double doubtful_share = 0.1;

template <int Dim>
void follow(const CrackRunOptions& options, const std::string& directory, bool quiet, Display& display) {
  const RecordedRun<Dim> run(options.run);
  OutputDirectory out(directory);
  const OnInterrupt clean_up([&out] { out.discard(); });
  const std::vector<CrackRow> rows =
      write_cracks<Dim>(out, run, options.files, {.progress = display.stages({"mesh between points", "cracks"})});
  out.commit();
  if (!quiet) display.say(fmt::format("results in {}", directory));
  fmt::print("{:>12} {:>10} {:>12} {:>8} {:>14} {:>16}\n", "time", "cut edges",
             Dim == 2 ? "crack length" : "crack area", "parts", "largest part", "largest stretch");
  for (const CrackRow& row : rows)
    fmt::print("{:12.5g} {:10} {:12.5g} {:8} {:12.2f} % {:16.3f}\n", row.time, row.cut_edges, row.crack_area, row.parts,
               100.0 * row.largest_part, row.largest_stretch);
  const double share = static_cast<double>(rows.back().cut_edges) / std::max(1, rows.back().edges);
  if (share > doubtful_share)
    display.say(
        fmt::format("warning: {:.0f} % of all edges are cut: this looks like flow rather than cracks; a --stretch "
                    "of more than {:.3g} leaves whole what is only stretched",
                    100.0 * share, options.files.cracks.stretch));
}

}  // namespace

void run_cracks(const CrackRunOptions& options, bool quiet, Display& display) {
  const std::string directory = options.out.value_or((std::filesystem::path(options.run) / "cracks").string());
  if (recorded_dimension(options.run) == 2)
    follow<2>(options, directory, quiet, display);
  else
    follow<3>(options, directory, quiet, display);
}

}  // namespace efree
