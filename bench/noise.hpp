// SPDX-License-Identifier: GPL-3.0-or-later
/// Images of noise, where specks, shavings, islands and free bodies abound, and an analysis of them.
#pragma once

#include "efree/geometry/input/label_image.hpp"
#include "efree/geometry/meshing/image_mesh.hpp"
#include "efree/io/case/case_file.hpp"
#include "efree/materials/linear_elastic.hpp"

#include <algorithm>
#include <iterator>
#include <random>
#include <vector>

namespace efree::bench {

/// n^3 random numbers, smoothed over the neighbours this often.
inline std::vector<double> random_field(Index n, int passes, std::mt19937& generator) {
  std::vector<double> values(static_cast<std::size_t>(n) * n * n);
  for (double& value : values) value = static_cast<double>(generator()) / 4294967296.0;
  for (int pass = 0; pass < passes; ++pass) {
    const auto before = values;
    for (Index p = 0; p < n * n * n; ++p) {
      const Index x = p % n, y = p / n % n, z = p / n / n;
      double sum = 0.0, count = 0.0;
      for (Index c = std::max(z - 1, 0); c <= std::min(z + 1, n - 1); ++c)
        for (Index b = std::max(y - 1, 0); b <= std::min(y + 1, n - 1); ++b)
          for (Index a = std::max(x - 1, 0); a <= std::min(x + 1, n - 1); ++a)
            sum += before[a + n * (b + n * c)], ++count;
      values[p] = sum / count;
    }
  }
  return values;
}

/// White noise (kind 0), noise smoothed twice over the neighbours (1), and that as grey values (2), on n^3 voxels.
inline LabelImage<3> noise(int kind, double solid, unsigned seed, Index n = 24) {
  std::mt19937 generator(seed);
  LabelImage<3> image{.size = {n, n, n}};
  const std::vector<double> values = random_field(n, kind == 0 ? 0 : 2, generator);
  auto ordered = values;
  std::ranges::sort(ordered);
  const double threshold = ordered[static_cast<std::size_t>((1.0 - solid) * static_cast<double>(ordered.size() - 1))];
  for (const double value : values) {
    image.labels.push_back(value > threshold);
    const auto grey = static_cast<float>(value - threshold);
    if (kind == 2) image.grey.push_back(value > threshold ? std::max(grey, 1e-30f) : std::min(grey, -1e-30f));
  }
  return image;
}

/// Labels 1, 2, 3, each where its own smoothed noise is the largest of the three; n^3 voxels.
inline LabelImage<3> noise_of_three_labels(Index n, int passes, unsigned seed) {
  std::mt19937 generator(seed);
  const std::vector<double> fields[] = {random_field(n, passes, generator), random_field(n, passes, generator),
                                        random_field(n, passes, generator)};
  LabelImage<3> image{.size = {n, n, n}};
  for (std::size_t p = 0; p < fields[0].size(); ++p) {
    const auto largest = std::ranges::max_element(fields, {}, [p](const auto& field) { return field[p]; });
    image.labels.push_back(static_cast<Label>(1 + (largest - std::begin(fields))));
  }
  return image;
}

/// The image held on the left and pulled by a hundredth of its length on the right; moduli of its labels, in order.
inline Case<3> pulled(const LabelImage<3>& image, double size, const std::vector<double>& moduli) {
  Case<3> analysis;
  analysis.common.where = "noise";
  analysis.common.approximation.interpolation = 1;  // linear elements are the truth here
  analysis.geometry.mesh = [image](const MeshSize& h, const Stage&) {
    return MadeMesh<3>{mesh_image(image, {.size = h.length})};
  };
  analysis.geometry.size = size;
  analysis.common.model.material = LinearElastic(moduli.front(), 0.3);
  for (std::size_t k = 0; k < moduli.size() && moduli.size() > 1; ++k)
    analysis.common.materials.push_back({std::to_string(k + 1), LinearElastic(moduli[k], 0.3), "noise"});
  const auto moved = [](const char* on, double x) {
    return DisplacementCondition<3>{
        on,
        {[x](const Vec<3>&) { return x; }, [](const Vec<3>&) { return 0.0; }, [](const Vec<3>&) { return 0.0; }},
        nullptr};
  };
  analysis.supports = {moved("left", 0.0), moved("right", 0.01 * image.size[0])};
  analysis.common.groups = {{"left", "noise"}, {"right", "noise"}};
  return analysis;
}

}  // namespace efree::bench
