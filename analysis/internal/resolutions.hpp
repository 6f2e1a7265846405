// SPDX-License-Identifier: GPL-3.0-or-later
/// One case at several resolutions.
#pragma once

#include "efree/analysis/settings.hpp"
#include "efree/geometry/mesh/fine_mesh.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace efree::internal {

/// Edges that the cells of a mesh have in the mean, of boxes cut into two triangles or six tetrahedra.
template <int Dim> double mean_edge(const FineMesh<Dim>& mesh) {
  return std::pow((Dim == 2 ? 2.0 : 6.0) * mesh.volumes().sum() / mesh.num_cells(), 1.0 / Dim);
}

/// Elements of this size have about as many vertices as a cloud of spacing 1 has nodes.
template <int Dim> inline constexpr double element_size = Dim == 2 ? 0.85 : 1.5;

/// The middle value, of an even number the mean of the two. values: at least one.
inline double median(std::vector<double> values) {
  std::ranges::sort(values);
  const std::size_t n = values.size();
  return 0.5 * (values[(n - 1) / 2] + values[n / 2]);
}

/// The grading of a case for clouds `factor` times as wide: spacings asked for at places, and how fast they grow from
/// there, so that the clouds of a study are similar.
inline Grading scaled(Grading grading, double factor) {
  if (!grading.has_places()) return grading;
  for (auto& part : grading.boxes) part.spacing *= factor;
  for (auto& part : grading.regions) part.spacing *= factor;
  for (auto& part : grading.boundaries) part.spacing *= factor;
  grading.growth *= factor;
  return grading;
}

}  // namespace efree::internal
