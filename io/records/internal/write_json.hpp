// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "efree/io/files/internal/cannot_write.hpp"

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

namespace efree::internal {

/// Writes JSON, indented by two; what is no UTF-8 is replaced. Throws InputError if the file cannot be written.
inline void write_json(const std::filesystem::path& file, const nlohmann::ordered_json& json) {
  std::ofstream stream(file);
  stream << json.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) << '\n';
  if (!stream.flush()) cannot_write(file);
}

}  // namespace efree::internal
