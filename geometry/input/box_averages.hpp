// SPDX-License-Identifier: GPL-3.0-or-later
/// What an image has in the boxes of a grid that need not be that of its voxels.
#pragma once

#include "efree/geometry/input/label_image.hpp"

#include <array>
#include <memory>
#include <vector>

namespace efree {

/// Means over boxes of a quantity that each label has its value of: the image's frame is cut into boxes[0] x boxes[1] x
/// boxes[2] equal boxes; by box, x fastest. `value_of_label[l]` is the value of label l, of void 0 usually; labels
/// beyond its end have 0.
///
/// Boundaries are planes within a voxel (within an eighth of it where boxes are smaller than voxels): where the grey
/// values change their sign, between the centres of voxels quadratic along each axis; without grey values where the
/// label's part of the 27 voxels around, weighted with 1, 2, 1 along each axis, is a half. So the steps of voxels are
/// smoothed away (but not walls, slits and specks a voxel thick): bodies of voxels with steps are softer than what they
/// picture. What a plane cuts off is taken from distance over slope, exact for planes along the voxels' sides. Voxels
/// count by the volume they share with a box, exactly. Bitwise the same on any number of threads. `grown` [voxels]
/// moves the boundaries between void and the rest outwards. Throws as check_image does, and InputError without boxes.
std::vector<float> box_averages(const LabelImage<3>& image, const std::vector<float>& value_of_label,
                                const std::array<Index, 3>& boxes, double grown = 0.0);

/// Boxes [begin, end) along each axis.
struct BoxRange {
  std::array<Index, 3> begin{}, end{};

  bool holds(const std::array<Index, 3>& box) const {
    for (std::size_t d = 0; d < 3; ++d)
      if (box[d] < begin[d] || box[d] >= end[d]) return false;
    return true;
  }
  /// Of a box, x fastest.
  std::size_t index(const std::array<Index, 3>& box) const {
    return box[0] - begin[0] +
           static_cast<std::size_t>(end[0] - begin[0]) *
               (box[1] - begin[1] + static_cast<std::size_t>(end[1] - begin[1]) * (box[2] - begin[2]));
  }
  std::size_t size() const { return index({begin[0], begin[1], end[2]}); }
};

/// The same for some of the boxes, where all at once would be too many.
class BoxAverages {
 public:
  /// Keeps a reference to the image. Throws as box_averages does.
  BoxAverages(const LabelImage<3>& image, const std::vector<float>& value_of_label, const std::array<Index, 3>& boxes,
              double grown = 0.0);
  /// The same of an image that was checked and whose labels were counted, as for many of its labels one by one.
  BoxAverages(const LabelImage<3>& image, const std::vector<LabelCount>& counts,
              const std::vector<float>& value_of_label, const std::array<Index, 3>& boxes, double grown = 0.0);
  BoxAverages(BoxAverages&&) noexcept;
  ~BoxAverages();
  /// Of the layers [begin, end) of boxes along z, x fastest.
  std::vector<float> layers(Index begin, Index end) const;
  /// Of these boxes, x fastest; what is outside of them takes no time.
  std::vector<float> in(const BoxRange& range) const;

 private:
  struct Parts;
  std::unique_ptr<const Parts> parts_;
};

/// Of each group of labels the boxes, out of so many along each axis, that may have some of it: those around its
/// voxels, as averages smooth boundaries. `group_of_label` by label, -1 for none. A group without voxels has no boxes.
std::vector<BoxRange> boxes_of_groups(const LabelImage<3>& image, const std::vector<Index>& group_of_label,
                                      Index groups, const std::array<Index, 3>& boxes);

}  // namespace efree
