// SPDX-License-Identifier: GPL-3.0-or-later
/// Pictures of images that were solved on cells.
#include "efree/io/pictures/internal/body_picture.hpp"
#include "efree/io/pictures/picture.hpp"

#include <array>
#include <map>
#include <set>
#include <string>

namespace efree {
namespace {

using namespace internal::drawing;

/// The faces of cells that are mostly material, between these and others, as triangles.
class CellSkin {
 public:
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
  std::vector<char> side_of;         ///< by triangle: of the frame, as 2 axis + upper; -1: inside

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
    const bool framed = side % 2 == 1 ? at[axis] + 1 == grid_.cubes[axis] : at[axis] == 0;
    side_of.insert(side_of.end(), 2, static_cast<char>(framed ? side : -1));
  }

  const Lattice& grid_;
  const CellFields& fields_;
  std::vector<Index> point_;  ///< by point of the grid
};

}  // namespace

void draw_fields(const std::filesystem::path& file, const Settings<3>& settings, const ImageResult& result) {
  const CellSolution& cells = *result.cells;
  CellSkin skin(cells.grid, result.by_cell);
  if (skin.triangles.empty()) return;  // all walls are thinner than half a cell
  BodyPicture<3> body{.undeformed = {Points<3>(3, std::ssize(skin.corners)), std::move(skin.triangles)},
                      .displacement = Points<3>(3, std::ssize(skin.corners)),
                      .values = Vector(std::ssize(skin.corners)),
                      .has_creases = false};
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
    for (const std::string& name : named) {
      const int side = result.side(name);
      for (std::size_t t = 0; t < skin.side_of.size(); ++t)
        if (skin.side_of[t] == side) pieces.push_back(body.undeformed.triangles[t]);
    }
    return pieces;
  };
  body.held = pieces_on(settings.supports);
  const Loads<3> loads = loads_by_case(settings).front();  // those of the answer that is drawn
  body.loaded = pieces_on(loads.tractions);
  for (const Triangle& piece : pieces_on(loads.resultants)) body.loaded.push_back(piece);
  draw_body(file, body, "von Mises stress", "stress");
}

}  // namespace efree
