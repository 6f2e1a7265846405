// SPDX-License-Identifier: GPL-3.0-or-later
/// Utilisation of materials as JSON and as text.
#pragma once

#include "efree/analysis/utilisation.hpp"
#include "efree/io/records/internal/json_array.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace efree::internal {

/// As json["utilisation"], which is left out where no material has a strength.
template <int Dim> void add_utilisations(const std::vector<Utilisation<Dim>>& all, nlohmann::ordered_json& json) {
  for (const auto& one : all)
    json["utilisation"].push_back({{"region", one.region},
                                   {"limit", one.limit},
                                   {"value", one.value},
                                   {"safety_factor", one.safety_factor()},
                                   {"at", json_array(one.at)}});
}

template <int Dim> std::string utilisation_text(const Utilisation<Dim>& one) {
  return fmt::format("utilisation{} {:.3g} by {} strength at ({:.6g}): safety factor {:.3g}",
                     one.region.empty() ? "" : fmt::format(" of \"{}\"", one.region), one.value, one.limit,
                     fmt::join(one.at, ", "), one.safety_factor());
}

}  // namespace efree::internal
