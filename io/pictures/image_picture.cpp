// SPDX-License-Identifier: GPL-3.0-or-later
/// Pictures of images that were solved on cells.
#include "efree/io/pictures/internal/body_picture.hpp"
#include "efree/io/pictures/picture.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <string>

namespace efree {
namespace {

using namespace internal::drawing;

/// The faces of cells that are mostly material, between these and others, as triangles.
class CellSkin {
 public:
  struct Face {
    std::array<Index, 3> cell;
    int side;  ///< 2 axis, plus 1 at its upper end
  };
  CellSkin(const Lattice& grid, const CellFields& fields)
      : grid_(grid),
        fields_(fields),
        point_(static_cast<std::size_t>(grid.cubes[0] + 1) * (grid.cubes[1] + 1) * (grid.cubes[2] + 1), -1) {
    std::array<Index, 3> at;
    for (at[2] = 0; at[2] < grid.cubes[2]; ++at[2])
      for (at[1] = 0; at[1] < grid.cubes[1]; ++at[1])
        for (at[0] = 0; at[0] < grid.cubes[0]; ++at[0])
          if (is_solid(at))
            for (int side = 0; side < 6; ++side) {
              auto next = at;
              next[side / 2] += side % 2 == 1 ? 1 : -1;
              if (!is_solid(next)) add_face(at, side);
            }
  }

  std::vector<Triangle> triangles;
  std::vector<std::size_t> corners;  ///< by point: of the grid
  std::vector<double> sums, counts;  ///< by point: von Mises stresses of the cells behind, and how many
  std::vector<Face> faces;           ///< by two triangles

 private:
  bool is_solid(const std::array<Index, 3>& at) const {
    for (int d = 0; d < 3; ++d)
      if (at[d] < 0 || at[d] >= grid_.cubes[d]) return false;
    return fields_.solid[cell(at)] >= 0.5F;
  }
  std::size_t cell(const std::array<Index, 3>& at) const {
    return at[0] +
           static_cast<std::size_t>(grid_.cubes[0]) * (at[1] + static_cast<std::size_t>(grid_.cubes[1]) * at[2]);
  }
  void add_face(const std::array<Index, 3>& at, int side) {
    const int axis = side / 2, first = (axis + 1) % 3, second = (axis + 2) % 3;
    std::array<Index, 4> of;
    for (int c = 0; c < 4; ++c) {
      auto corner = at;
      corner[axis] += side % 2;
      corner[first] += c == 1 || c == 2;
      corner[second] += c >= 2;
      const std::size_t place = corner[0] + static_cast<std::size_t>(grid_.cubes[0] + 1) *
                                                (corner[1] + static_cast<std::size_t>(grid_.cubes[1] + 1) * corner[2]);
      Index& point = point_[place];
      if (point < 0) {
        point = static_cast<Index>(corners.size());
        corners.push_back(place);
        sums.push_back(0.0);
        counts.push_back(0.0);
      }
      sums[point] += static_cast<double>(fields_.von_mises[cell(at)]);
      counts[point] += 1.0;
      of[c] = point;
    }
    if (side % 2 == 0) std::swap(of[1], of[3]);
    triangles.push_back({of[0], of[1], of[2]});
    triangles.push_back({of[0], of[2], of[3]});
    faces.push_back({at, side});
  }

  const Lattice& grid_;
  const CellFields& fields_;
  std::vector<Index> point_;  ///< by point of the grid
};

/// Whether a part of the boundary has a face of a voxel that faces the same way, no farther than a cell before or
/// behind the middle of a face of a cell.
bool is_near(const CellSkin::Face& face, const std::vector<VoxelFacet>& part, const LabelImage<3>& image,
             const Lattice& grid) {
  const int axis = face.side / 2;
  Vec<3> middle(face.cell[0] + 0.5, face.cell[1] + 0.5, face.cell[2] + 0.5);
  middle[axis] = face.cell[axis] + face.side % 2;
  const Vec<3> at = middle.cwiseProduct(grid.spacing).cwiseQuotient(image.spacing);
  const double reach = std::max(1.0, grid.spacing[axis] / image.spacing[axis]);
  std::array<Index, 3> voxel;
  for (int d = 0; d < 3; ++d) voxel[d] = std::clamp(static_cast<Index>(at[d]), 0, image.size[d] - 1);
  const auto first = static_cast<Index>(std::floor(at[axis] - reach)),
             last = static_cast<Index>(std::ceil(at[axis] + reach));
  for (voxel[axis] = std::max(first, 0); voxel[axis] < std::min(last, image.size[axis]); ++voxel[axis])
    if (std::ranges::binary_search(part, VoxelFacet{6 * image.index(voxel) + static_cast<std::size_t>(face.side)}))
      return true;
  return false;
}

}  // namespace

void draw_fields(const std::filesystem::path& file, const Settings<3>& settings, const ImageResult& result) {
  const CellSolution& cells = *result.cells;
  CellSkin skin(cells.grid, result.by_cell);
  if (skin.triangles.empty()) return;  // all walls are thinner than half a cell
  BodyPicture<3> body{.undeformed = {Points<3>(3, std::ssize(skin.corners)), std::move(skin.triangles), Skin::faces},
                      .displacement = Points<3>(3, std::ssize(skin.corners)),
                      .values = Vector(std::ssize(skin.corners)),
                      .largest_displacement = result.extremes[0].value,
                      .largest_value = result.extremes[1].value};
  const auto& n = cells.grid.cubes;
  for (std::size_t p = 0; p < skin.corners.size(); ++p) {
    const std::size_t at = skin.corners[p], row = n[0] + 1, layer = row * (n[1] + 1);
    const Vec<3> place(static_cast<double>(at % row), static_cast<double>(at / row % (n[1] + 1)),
                       static_cast<double>(at / layer));
    const auto point = static_cast<Eigen::Index>(p);
    body.undeformed.points.col(point) = cells.grid.origin + cells.axes * cells.grid.spacing.cwiseProduct(place);
    body.displacement.col(point) = cells.displacement.col(static_cast<Eigen::Index>(at));
    body.values[point] = skin.sums[p] / skin.counts[p];
  }
  const auto pieces_on = [&](const auto& conditions) {
    std::vector<Triangle> pieces;
    std::set<std::string> named;
    for (const auto& condition : conditions) named.insert(condition.on);
    for (const std::string& name : named)
      for (std::size_t f = 0; f < skin.faces.size(); ++f)
        if (is_near(skin.faces[f], result.facets.at(name), *result.image, cells.grid))
          for (const std::size_t t : {2 * f, 2 * f + 1}) pieces.push_back(body.undeformed.triangles[t]);
    return pieces;
  };
  body.held = pieces_on(settings.supports);
  const Loads<3> loads = loads_by_case(settings).front();  // those of the answer that is drawn
  body.loaded = pieces_on(loads.tractions);
  for (const Triangle& piece : pieces_on(loads.resultants)) body.loaded.push_back(piece);
  draw_body(file, body, "von Mises stress", "stress");
}

}  // namespace efree
