// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/mentions.hpp"

#include <algorithm>

namespace efree::internal {
namespace {

void mention(std::vector<Mention>& all, const std::string& name) {
  if (std::ranges::find(all, name, &Mention::name) == all.end()) all.push_back({name, ""});
}

template <int Dim> std::vector<Mention> with_graded(std::vector<Mention> all, const CommonSettings<Dim>& settings) {
  for (const auto& graded : settings.approximation.grading.boundaries) mention(all, graded.boundary);
  return all;
}

}  // namespace

template <int Dim> std::vector<Mention> boundaries(const CommonSettings<Dim>& settings) {
  return with_graded(settings.groups, settings);
}

template <int Dim> std::vector<Mention> boundaries(const Settings<Dim>& settings) {
  std::vector<Mention> all = settings.common.groups;
  for (const auto& support : settings.supports) mention(all, support.on);
  for (const auto& loads : loads_by_case(settings)) {
    for (const auto& load : loads.tractions) mention(all, load.on);
    for (const auto& load : loads.followers) mention(all, load.on);
    for (const auto& load : loads.resultants) mention(all, load.on);
  }
  for (const auto& reaction : settings.reactions) mention(all, reaction.on);
  return with_graded(std::move(all), settings.common);
}

template <int Dim> std::vector<Mention> graded_regions(const CommonSettings<Dim>& settings) {
  std::vector<Mention> all = settings.graded;
  for (const auto& graded : settings.approximation.grading.regions) mention(all, graded.region);
  return all;
}

template std::vector<Mention> boundaries<2>(const CommonSettings<2>&);
template std::vector<Mention> boundaries<2>(const Settings<2>&);
template std::vector<Mention> boundaries<3>(const CommonSettings<3>&);
template std::vector<Mention> boundaries<3>(const Settings<3>&);
template std::vector<Mention> graded_regions<2>(const CommonSettings<2>&);
template std::vector<Mention> graded_regions<3>(const CommonSettings<3>&);

}  // namespace efree::internal
