// SPDX-License-Identifier: GPL-3.0-or-later
/// Entries of a run of explicit dynamics in a line of text, for benchmarks.
#pragma once

#include "efree/dynamics/ledger.hpp"

#include <cstdio>
#include <string>

namespace efree::bench {

/// "NAME VALUE, NAME VALUE, ...", values as `format` prints them.
template <class Entries, class ValueOf>
std::string entries_text(const Entries& entries, const char* format, const ValueOf& value) {
  std::string text;
  for (const auto& entry : entries) {
    char number[64];
    std::snprintf(number, sizeof number, format, static_cast<double>(value(entry)));
    text += (text.empty() ? "" : ", ") + entry.name + " " + number;
  }
  return text;
}
/// Energies over a scale.
inline std::string energies_text(const Ledger& ledger, double scale) {
  return entries_text(ledger.energies(), "%.4f", [scale](const auto& entry) { return entry.value / scale; });
}
inline std::string counts_text(const Ledger& ledger) {
  return entries_text(ledger.counts(), "%.0f", [](const auto& entry) { return entry.value; });
}
/// In seconds.
inline std::string times_text(const Ledger& ledger) {
  return entries_text(ledger.times(), "%.2f s", [](const auto& entry) { return entry.seconds; });
}

}  // namespace efree::bench
