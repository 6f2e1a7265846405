// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/history.hpp"

#include "efree/io/files/internal/cannot_write.hpp"
#include "efree/io/records/internal/csv.hpp"

#include <fmt/format.h>
#include <fstream>

namespace efree {

using internal::csv_cell;
template <int Dim> std::string history_header(const Settings<Dim>& settings, const HistoryStep<Dim>& any) {
  std::string line = "t,iterations,residual,stored,dissipated,smallest_J,plastic_share,negative_pivots";
  for (const auto& [part, of] : any.reactions)
    for (int i = 0; i < Dim; ++i) line += ',' + csv_cell(fmt::format("reaction.{}.{}", part, "xyz"[i]));
  for (const auto& probe : settings.probes)
    for (int i = 0; i < Dim; ++i) line += ',' + csv_cell(fmt::format("probe.{}.u{}", probe.name, "xyz"[i]));
  return line + '\n';
}

template <int Dim> std::string history_line(const HistoryStep<Dim>& step) {
  std::string line = fmt::format("{},{},{:.3g},{},{},{},{},{}", step.time, step.iterations, step.left, step.stored,
                                 step.dissipated, step.smallest_jacobian, step.plastic_share, step.negative_pivots);
  for (const auto& [part, of] : step.reactions)
    for (int i = 0; i < Dim; ++i) line += fmt::format(",{}", of.force[i]);
  for (const auto& u : step.probes)
    for (int i = 0; i < Dim; ++i) line += fmt::format(",{}", u[i]);
  return line + '\n';
}

template <int Dim> void write_history(const std::filesystem::path& file, const Settings<Dim>& settings,
                                      const std::vector<HistoryStep<Dim>>& history) {
  std::ofstream out(file);
  out << history_header(settings, history.front());
  for (const auto& step : history) out << history_line(step);
  if (!out.flush()) internal::cannot_write(file);
}

template std::string history_header<2>(const Settings<2>&, const HistoryStep<2>&);
template std::string history_header<3>(const Settings<3>&, const HistoryStep<3>&);
template std::string history_line<2>(const HistoryStep<2>&);
template std::string history_line<3>(const HistoryStep<3>&);
template void write_history<2>(const std::filesystem::path&, const Settings<2>&, const std::vector<HistoryStep<2>>&);
template void write_history<3>(const std::filesystem::path&, const Settings<3>&, const std::vector<HistoryStep<3>>&);

}  // namespace efree
