// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/result.hpp"

#include "efree/analysis/point_field.hpp"
#include "efree/core/parallel.hpp"

#include <fmt/format.h>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

namespace efree {

std::pair<double, std::string> PathErrors::largest() const {
  std::pair<double, std::string> most(work, "the work");
  const auto look_at = [&](const char* kind, const std::map<std::string, double>& all) {
    for (const auto& [name, error] : all)
      if (error > most.first) most = {error, fmt::format("{} \"{}\"", kind, name)};
  };
  look_at("reaction", reactions);
  look_at("probe", probes);
  if (limit && *limit > most.first) most = {*limit, "the largest time"};
  return most;
}

template <int Dim> Vector von_mises_at_places(const Fields<Dim>& fields) {
  const auto& stress = fields.stress;
  Vector mises(stress.cols());
  parallel_for(static_cast<Index>(mises.size()),
               [&](Index p) { mises[p] = von_mises<Dim>(Voigt<Dim>(stress.col(p))); });
  return mises;
}

namespace {

/// sqrt(a^2 + b^2) of any numbers, as std::hypot, but for the last bit.
double hypotenuse(double a, double b) {
  double longer = std::abs(a), shorter = std::abs(b);
  if (longer < shorter) std::swap(longer, shorter);
  const double share = shorter / longer;
  return longer == 0.0 ? shorter : longer * std::sqrt(1.0 + share * share);
}

}  // namespace

template <int Dim> std::pair<double, double> principal_stresses(const Voigt<Dim>& s) {
  if constexpr (Dim == 2) {
    const double middle = 0.5 * (s[0] + s[1]), radius = hypotenuse(0.5 * (s[0] - s[1]), s[3]);
    return {std::max(middle + radius, s[2]), std::min(middle - radius, s[2])};
  } else {
    Mat<3> sigma;
    sigma << s[0], s[5], s[4], s[5], s[1], s[3], s[4], s[3], s[2];
    const Vec<3> values =
        Eigen::SelfAdjointEigenSolver<Mat<3>>().computeDirect(sigma, Eigen::EigenvaluesOnly).eigenvalues();
    return {values[2], values[0]};
  }
}

namespace {

/// The largest and the smallest of some numbers, and which ones they are: of like ones the first.
struct Range {
  double most = -std::numeric_limits<double>::infinity(), least = std::numeric_limits<double>::infinity();
  Index most_at = 0, least_at = 0;

  void add(double value, Index at) {
    if (value > most) most = value, most_at = at;
    if (value < least) least = value, least_at = at;
  }
  void add(const Range& later) {
    if (later.most > most) most = later.most, most_at = later.most_at;
    if (later.least < least) least = later.least, least_at = later.least_at;
  }
};

/// Of some numbers at each of `count` places: values(place, add) calls add(number, value).
template <class Values> std::vector<Range> ranges_of(Index count, std::size_t numbers, const Values& values) {
  constexpr Index chunk = 4096;
  std::vector<std::vector<Range>> parts((count + chunk - 1) / chunk, std::vector<Range>(numbers));
  parallel_chunks(count, chunk, [&](Index begin, Index end) {
    auto& part = parts[begin / chunk];
    for (Index p = begin; p < end; ++p)
      values(p, [&](std::size_t number, double value) { part[number].add(value, p); });
  });
  std::vector<Range> all(numbers);
  for (const auto& part : parts)
    for (std::size_t k = 0; k < numbers; ++k) all[k].add(part[k]);
  return all;
}

}  // namespace

template <int Dim> std::vector<FieldRange<Dim>> field_ranges(const FineSpace<Dim>& space, const Fields<Dim>& fields) {
  constexpr std::size_t size = voigt_size<Dim>;
  std::vector<std::string> names = component_field_names<Dim>(space.axisymmetric());
  names.emplace_back("principal_stress");

  auto found = ranges_of(static_cast<Index>(fields.displacement.cols()), Dim, [&](Index p, const auto& add) {
    for (std::size_t d = 0; d < Dim; ++d) add(d, fields.displacement(static_cast<Index>(d), p));
  });
  auto of_stresses = ranges_of(static_cast<Index>(fields.stress.cols()), 2 * size + 2, [&](Index p, const auto& add) {
    for (std::size_t i = 0; i < size; ++i) {
      add(i, fields.strain(static_cast<Index>(i), p));
      add(size + i, fields.stress(static_cast<Index>(i), p));
    }
    const auto [first, third] = principal_stresses<Dim>(fields.stress.col(p));
    add(2 * size, first);
    add(2 * size + 1, third);
  });
  Range& first = of_stresses[2 * size];  // the most of the first principal stress, the least of the third
  first.least = of_stresses.back().least;
  first.least_at = of_stresses.back().least_at;
  of_stresses.pop_back();
  found.insert(found.end(), of_stresses.begin(), of_stresses.end());
  std::vector<FieldRange<Dim>> ranges;
  for (std::size_t k = 0; k < names.size(); ++k)
    ranges.push_back({names[k], found[k].most, found[k].least, space.points().col(space.dof_at(found[k].most_at)),
                      space.points().col(space.dof_at(found[k].least_at))});
  return ranges;
}

template std::vector<FieldRange<2>> field_ranges<2>(const FineSpace<2>&, const Fields<2>&);
template std::vector<FieldRange<3>> field_ranges<3>(const FineSpace<3>&, const Fields<3>&);
template std::pair<double, double> principal_stresses<2>(const Voigt<2>&);
template std::pair<double, double> principal_stresses<3>(const Voigt<3>&);
template Vector von_mises_at_places<2>(const Fields<2>&);
template Vector von_mises_at_places<3>(const Fields<3>&);

}  // namespace efree
