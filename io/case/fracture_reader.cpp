// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/internal/fracture_reader.hpp"

#include <fmt/format.h>

namespace efree::internal {
namespace {

/// A table over triaxiality, or the constants of Johnson and Cook.
FailureStrain read_failure_strain(const Section& entry) {
  if (!entry.is_table("strain")) return entry.tabulated("strain", FailureStrain::table);
  const Section law = entry.section("strain", {"D1", "D2", "D3", "D4", "D5", "rate", "melting"});
  JohnsonCookFailure failure;
  for (std::size_t i = 0; i < failure.D.size(); ++i)
    failure.D[i] = law.number(fmt::format("D{}", i + 1), any_number, 0.0);
  failure.reference = law.number("rate", positive, failure.reference);
  failure.melting = law.number("melting", not_negative, failure.melting);
  return failure;
}

}  // namespace

std::vector<RegionFracture> read_fractures(const std::vector<Section>& entries) {
  std::vector<RegionFracture> fractures;
  for (const Section& entry : entries) {
    RegionFracture fracture{.region = entry.text("region", ""), .where = entry.where("")};
    for (const auto& earlier : fractures)
      if (earlier.region == fracture.region || earlier.region.empty() || fracture.region.empty())
        entry.fail("region", fmt::format("there is fracture already, from {}", earlier.where));
    FractureCriteria& criteria = fracture.criteria;
    criteria.toughness = entry.number("toughness", not_negative, criteria.toughness);
    criteria.neighbourhood = entry.number("neighbourhood", {0.0, 10.0, true, true}, criteria.neighbourhood);
    criteria.stretch = entry.number("stretch", {1.0, 1e3, false, true}, criteria.stretch);
    if (entry.has("strain")) criteria.strain = read_failure_strain(entry);
    criteria.spall = entry.number("spall", positive, criteria.spall);
    if (!criteria.on()) entry.fail("", "[[fracture]]: expected toughness, stretch, strain or spall");
    fractures.push_back(std::move(fracture));
  }
  return fractures;
}

}  // namespace efree::internal
