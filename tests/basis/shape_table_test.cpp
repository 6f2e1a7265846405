// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/basis/shape_table.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

namespace efree {
namespace {

/// A table of random rows of random length, seeded.
void fill(ShapeTable<2>& table, Index points, Index nodes, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<std::vector<Index>> rows(points);
  std::vector<Index> counts;
  for (auto& row : rows) {
    for (Index node = 0; node < nodes; ++node)
      if (random() % 4 == 0) row.push_back(node);
    counts.push_back(static_cast<Index>(row.size()));
  }
  table.reshape(nodes, counts, true);
  for (Index p = 0; p < points; ++p) {
    const auto room = table.room(p);
    for (std::size_t k = 0; k < rows[p].size(); ++k) {
      room.nodes[k] = rows[p][k];
      room.N[k] = p + 0.001 * rows[p][k];
      room.dN[k] = {1.0 * p, 1.0 * rows[p][k]};
    }
  }
}

TEST(ShapeTable, TransposeHasEveryPlaceOfANodeInOrder) {
  ShapeTable<2> table;
  fill(table, 5000, 40, 7);  // more rows than one part
  const NodePlaces& places = table.by_node();
  std::vector<std::size_t> next(40, 0);
  for (Index p = 0; p < table.num_points(); ++p) {
    const auto row = table.row(p);
    for (std::size_t k = 0; k < row.nodes.size(); ++k) {
      const auto of_node = places[row.nodes[k]];
      const std::size_t at = next[row.nodes[k]]++;
      ASSERT_LT(at, of_node.size());
      ASSERT_EQ(of_node[at].point, p);
      ASSERT_EQ(of_node[at].position, static_cast<Index>(k));
    }
  }
  for (Index node = 0; node < 40; ++node) EXPECT_EQ(next[node], places[node].size());
}

TEST(ShapeTable, TransposeIsMadeOnceAndSharedByCopies) {
  ShapeTable<2> table;
  fill(table, 100, 10, 1);
  const ShapeTable<2> copy = table;
  EXPECT_EQ(&table.by_node(), &copy.by_node());
  EXPECT_EQ(table.by_node()[3].data(), copy.by_node()[3].data());
  const auto before = copy.by_node()[3].size();
  fill(table, 100, 10, 2);
  EXPECT_NE(&table.by_node(), &copy.by_node()) << "the copy keeps its own";
  EXPECT_EQ(copy.by_node()[3].size(), before);
}

TEST(ShapeTable, IsRetabulatedInItsOwnStorage) {
  ShapeTable<2> table;
  fill(table, 1000, 30, 1);
  table.by_node();
  const double* N = table.row(0).N.data();
  const auto* dN = table.row(0).dN.data();
  const auto* places = table.by_node()[0].data();
  for (unsigned seed = 2; seed < 6; ++seed) {
    fill(table, 900, 30, seed);
    EXPECT_EQ(table.row(0).N.data(), N);
    EXPECT_EQ(table.row(0).dN.data(), dN);
    EXPECT_EQ(table.by_node()[0].data(), places);
    EXPECT_EQ(table.num_points(), 900);
    const auto last = table.row(899);
    EXPECT_EQ(last.N[0], 899 + 0.001 * last.nodes[0]);
    EXPECT_EQ(table.by_node()[last.nodes[0]].back().point, 899);
  }
  EXPECT_THAT(
      [&] {
        table.reshape(3, std::vector<Index>{1, -1}, false);
      },
      ::testing::ThrowsMessage<InputError>(::testing::HasSubstr("-1 entries in row 1")));
}

TEST(ShapeTable, TransposeIsTheSameOnAnyNumberOfThreads) {
  std::vector<std::vector<Index>> seen;
  for (const int threads : {1, 2, 3}) {
    set_num_threads(threads);
    ShapeTable<2> table;
    fill(table, 5000, 40, 7);
    std::vector<Index> all;
    for (Index node = 0; node < 40; ++node)
      for (const auto& [point, position] : table.by_node()[node]) all.push_back(point), all.push_back(position);
    seen.push_back(std::move(all));
  }
  set_num_threads(2);
  EXPECT_EQ(seen[0], seen[1]);
  EXPECT_EQ(seen[0], seen[2]);
}

}  // namespace
}  // namespace efree
