// SPDX-License-Identifier: GPL-3.0-or-later
/// What grids of cells keep of an image.
#include "efree/geometry/input/box_averages.hpp"
#include "efree/solvers/cells/internal/cell_grid.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <random>

using namespace efree;
using namespace efree::internal;

namespace {

constexpr std::array<Index, 3> cells{21, 17, 40};

Parts random_parts(bool two_ratios) {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> logarithm(-4.0F, 0.0F), ratio(0.5F, 2.5F);
  Parts parts;
  for (int part = 0; part < 8 * cells[0] * cells[1] * cells[2]; ++part) {
    parts.shear.push_back(part % 3 == 0 ? 1.0F : part % 3 == 1 ? 0.0F : std::pow(10.0F, logarithm(random)));
    parts.across.push_back((two_ratios && part % 3 == 2 ? ratio(random) : 1.5F) * parts.shear.back());
  }
  return parts;
}

}  // namespace

/// More than 50 000 different values of parts, of which a palette has 4096, and with random Poisson's ratios 65 535.
TEST(CellParts, RoundManyModuliByTwoThousandthsAtMostAndWholeMaterialsNever) {
  for (const bool two_ratios : {false, true}) {
    const Parts given = random_parts(two_ratios);
    const CellGrid grid(cells, Vec<3>::Ones(), layers_of(given, cells), {{1.0F, 1.5F}});
    const Parts kept = grid.layers(0, cells[2]);
    double largest = 0.0, sum = 0.0, all = 0.0;
    for (std::size_t part = 0; part < given.shear.size(); ++part) {
      if (part % 3 < 2) {
        ASSERT_EQ(kept.shear[part], given.shear[part]);
        ASSERT_EQ(kept.across[part], given.across[part]);
        continue;
      }
      const double error = kept.shear[part] / given.shear[part] - 1.0,
                   of_ratio = kept.across[part] / kept.shear[part] / (given.across[part] / given.shear[part]) - 1.0;
      largest = std::max({largest, std::abs(error), std::abs(of_ratio)});
      sum += given.shear[part] * error;
      all += given.shear[part];
    }
    EXPECT_GT(largest, 1e-5) << "so many have no room unless they are rounded";
    EXPECT_LT(largest, 2.2e-3);
    EXPECT_LT(std::abs(sum / all), 5e-5) << "rounding goes either way";
  }
}

TEST(CellParts, OfFewMaterialsAreKeptToTheLastDigitsOfAverages) {
  Parts parts = random_parts(false);
  std::mt19937 random(2);
  std::uniform_real_distribution<float> noise(-2e-7F, 2e-7F);
  for (std::size_t part = 0; part < parts.shear.size(); ++part) {
    parts.shear[part] = (1.0F + noise(random)) * (part % 5 == 0 ? 1.0F : part % 5 == 1 ? 0.3F : 1e-3F);
    parts.across[part] = 1.5F * parts.shear[part];
  }
  const CellGrid grid(cells, Vec<3>::Ones(), layers_of(parts, cells), {{1.0F, 1.5F}, {0.3F, 0.45F}});
  const Parts kept = grid.layers(0, cells[2]);
  for (std::size_t part = 0; part < parts.shear.size(); ++part) {
    if (part % 5 < 2) {
      ASSERT_EQ(kept.shear[part], part % 5 == 0 ? 1.0F : 0.3F);
    }
    ASSERT_NEAR(kept.shear[part] / parts.shear[part], 1.0, 8e-6);
  }
}

TEST(BoxAverages, OfSomeBoxesAreThoseOfTheWholeImage) {
  LabelImage<3> image = random_spheres<3>(24, {.porosity = 0.3, .r_min = 3.0, .r_max = 6.0});
  for (std::size_t p = 0; p < image.labels.size(); ++p)
    if (image.labels[p] != 0 && p % 24 > 15) image.labels[p] = 2;
  for (const std::array<Index, 3>& boxes : {std::array<Index, 3>{24, 24, 24}, {17, 11, 19}, {48, 48, 48}}) {
    const BoxAverages averages(image, {0.0F, 1.0F, 0.25F}, boxes);
    const std::vector<float> whole = averages.layers(0, boxes[2]);
    const BoxRange all{{0, 0, 0}, boxes};
    for (const BoxRange& range : {BoxRange{{0, 0, 0}, {4, 3, 2}}, BoxRange{{5, 3, 7}, {6, 9, 12}},
                                  BoxRange{{9, 0, 2}, {boxes[0], 5, boxes[2]}}}) {
      const std::vector<float> some = averages.in(range);
      ASSERT_EQ(some.size(), range.size());
      for (Index k = range.begin[2]; k < range.end[2]; ++k)
        for (Index j = range.begin[1]; j < range.end[1]; ++j)
          for (Index i = range.begin[0]; i < range.end[0]; ++i)
            ASSERT_EQ(some[range.index({i, j, k})], whole[all.index({i, j, k})]) << i << " " << j << " " << k;
    }
    // Outside of a label's boxes there is none of it.
    const std::vector<float> of_second = box_averages(image, {0.0F, 0.0F, 1.0F}, boxes);
    const BoxRange second = boxes_of_groups(image, {-1, -1, 0}, 1, boxes).front();
    EXPECT_GT(second.begin[0], boxes[0] / 2);
    for (Index k = 0; k < boxes[2]; ++k)
      for (Index j = 0; j < boxes[1]; ++j)
        for (Index i = 0; i < boxes[0]; ++i)
          if (!second.holds({i, j, k})) {
            ASSERT_EQ(of_second[all.index({i, j, k})], 0.0F);
          }
  }
}

TEST(BoxAverages, LayerByLayerAreThoseOfTheWholeImage) {
  const LabelImage<3> image = random_spheres<3>(24, {.porosity = 0.3, .r_min = 3.0, .r_max = 6.0});
  for (const std::array<Index, 3>& boxes : {std::array<Index, 3>{24, 24, 24}, {17, 11, 19}, {48, 48, 48}}) {
    const std::vector<float> whole = box_averages(image, {0.0F, 1.0F}, boxes);
    const BoxAverages averages(image, {0.0F, 1.0F}, boxes);
    std::vector<float> joined;
    for (Index first = 0; first < boxes[2]; first += 7) {
      const std::vector<float> some = averages.layers(first, std::min(first + 7, boxes[2]));
      joined.insert(joined.end(), some.begin(), some.end());
    }
    EXPECT_EQ(joined, whole);
  }
}
