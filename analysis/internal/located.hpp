// SPDX-License-Identifier: GPL-3.0-or-later
/// Messages that begin with where it was said what is wrong.
#pragma once

#include "efree/analysis/settings.hpp"
#include "efree/core/error.hpp"

#include <string>

namespace efree::internal {

/// "file:line: message", or the message alone if nobody knows where.
inline std::string said_at(const std::string& where, const std::string& message) {
  return where.empty() ? message : where + ": " + message;
}

/// Calls `work`; what is wrong with the input is said with the place where it was said in front, once.
template <int Dim, class Work> auto located(const Settings<Dim>& settings, const std::string& where, const Work& work) {
  try {
    return work();
  } catch (const InputError& error) {
    const std::string message = error.what();
    throw InputError(message.starts_with(settings.where + ":") ? message : said_at(where, message));
  }
}

}  // namespace efree::internal
