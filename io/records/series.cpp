// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/internal/series.hpp"

#include "efree/io/files/internal/cannot_write.hpp"

#include <fmt/format.h>
#include <fstream>

namespace efree::internal {

void write_series(const std::filesystem::path& file, const std::vector<std::pair<double, std::string>>& frames) {
  std::ofstream out(file);
  out << "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\">\n  <Collection>\n";
  for (const auto& [time, name] : frames)
    out << fmt::format("    <DataSet timestep=\"{}\" part=\"0\" file=\"{}\"/>\n", time, name);
  out << "  </Collection>\n</VTKFile>\n";
  if (!out.flush()) cannot_write(file);
}

}  // namespace efree::internal
