// SPDX-License-Identifier: GPL-3.0-or-later
/// Messages that begin with where it was said what is wrong.
#pragma once

#include "efree/analysis/settings.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/setting_error.hpp"

#include <string>

namespace efree::internal {

/// "file:line: message", or the message alone if nobody knows where.
inline std::string said_at(const std::string& where, const std::string& message) {
  return where.empty() ? message : where + ": " + message;
}

/// Where a setting was said; if nobody knows, where all of them were.
template <int Dim> std::string where_said(const CommonSettings<Dim>& settings, const std::string& setting) {
  const auto found = settings.said.find(setting);
  return found == settings.said.end() ? settings.where : found->second;
}

/// Calls `work`; what is wrong with the input is said with the place where it was said in front, once: that of the
/// setting if it is known, else `where`.
template <int Dim, class Work>
auto located(const CommonSettings<Dim>& settings, const std::string& where, const Work& work) {
  try {
    return work();
  } catch (const SettingError& error) {
    throw InputError(
        said_at(settings.said.contains(error.setting) ? where_said(settings, error.setting) : where, error.what()));
  } catch (const InputError& error) {
    const std::string message = error.what();
    throw InputError(message.starts_with(settings.where + ":") ? message : said_at(where, message));
  }
}

}  // namespace efree::internal
