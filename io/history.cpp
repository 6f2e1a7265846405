// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/history.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <fmt/ostream.h>
#include <fstream>

namespace efree {

template <int Dim>
void write_history(const std::filesystem::path& file, const Settings<Dim>& settings, const Result<Dim>& result) {
  std::ofstream out(file);
  const auto cell = [&](const std::string& name) {  // names may hold commas and quotes
    std::string text;
    for (const char c : name) text += c == '"' ? "\"\"" : std::string(1, c);
    out << ',' << (name.find_first_of(",\"\n") == std::string::npos ? name : '"' + text + '"');
  };
  fmt::print(out, "t,iterations,residual,stored,dissipated,smallest_J,plastic_share,negative_pivots");
  for (const auto& [part, of] : result.history.front().reactions)
    for (int i = 0; i < Dim; ++i) cell(fmt::format("reaction.{}.{}", part, "xyz"[i]));
  for (const auto& probe : settings.probes)
    for (int i = 0; i < Dim; ++i) cell(fmt::format("probe.{}.u{}", probe.name, "xyz"[i]));
  fmt::print(out, "\n");
  for (const auto& step : result.history) {
    fmt::print(out, "{},{},{:.3g},{},{},{},{},{}", step.time, step.iterations, step.left, step.stored, step.dissipated,
               step.smallest_jacobian, step.plastic_share, step.negative_pivots);
    for (const auto& [part, of] : step.reactions)
      for (int i = 0; i < Dim; ++i) fmt::print(out, ",{}", of.force[i]);
    for (const auto& u : step.probes)
      for (int i = 0; i < Dim; ++i) fmt::print(out, ",{}", u[i]);
    fmt::print(out, "\n");
  }
  if (!out.flush()) throw InputError(fmt::format("cannot write {}", file.string()));
}

template void write_history<2>(const std::filesystem::path&, const Settings<2>&, const Result<2>&);
template void write_history<3>(const std::filesystem::path&, const Settings<3>&, const Result<3>&);

}  // namespace efree
