// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/heatgeo/internal/box_tree.hpp"

#include <algorithm>

namespace efree {

BoxTree::BoxTree(const std::vector<Box>& boxes) {
  std::vector<Item> items(boxes.size());
  for (std::size_t k = 0; k < boxes.size(); ++k) items[k] = {boxes[k].center(), static_cast<Index>(k)};
  if (!boxes.empty()) part(boxes, items, 0, static_cast<Index>(boxes.size()));
  order_.reserve(items.size());
  for (const Item& item : items) order_.push_back(item.number);
}

void BoxTree::part(const std::vector<Box>& boxes, std::vector<Item>& items, Index begin, Index end) {
  constexpr Index leaf_size = 16;
  const std::size_t number = nodes_.size();
  nodes_.push_back({{}, begin, end, 0, end - begin <= leaf_size});
  if (nodes_[number].is_leaf) {
    for (Index k = begin; k < end; ++k) nodes_[number].box.extend(boxes[items[k].number]);
  } else {
    Box middles;
    for (Index k = begin; k < end; ++k) middles.extend(items[k].middle);
    Index axis = 0;
    middles.sizes().maxCoeff(&axis);
    const Index half = begin + (end - begin) / 2;
    std::nth_element(items.begin() + begin, items.begin() + half, items.begin() + end,
                     [axis](const Item& a, const Item& b) {
                       return a.middle[axis] != b.middle[axis] ? a.middle[axis] < b.middle[axis] : a.number < b.number;
                     });
    part(boxes, items, begin, half);
    const std::size_t second = nodes_.size();
    part(boxes, items, half, end);
    nodes_[number].box = nodes_[number + 1].box.merged(nodes_[second].box);
  }
  nodes_[number].skip = static_cast<Index>(nodes_.size());
}

}  // namespace efree
