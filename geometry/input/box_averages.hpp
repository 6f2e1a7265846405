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

/// The same layer by layer of boxes, where all at once would be too many.
class BoxAverages {
 public:
  /// Keeps a reference to the image. Throws as box_averages does.
  BoxAverages(const LabelImage<3>& image, const std::vector<float>& value_of_label, const std::array<Index, 3>& boxes,
              double grown = 0.0);
  BoxAverages(BoxAverages&&) noexcept;
  ~BoxAverages();
  /// Of the layers [begin, end) of boxes along z, x fastest.
  std::vector<float> layers(Index begin, Index end) const;

 private:
  struct Parts;
  std::unique_ptr<const Parts> parts_;
};

}  // namespace efree
