// SPDX-License-Identifier: GPL-3.0-or-later
/// Pictures of images that were solved on cells.
#include "efree/analysis/point_field.hpp"
#include "efree/analysis/utilisation.hpp"
#include "efree/io/pictures/internal/body_picture.hpp"
#include "efree/io/pictures/picture.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
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
  std::vector<Face> faces;           ///< by two triangles

  std::size_t cell(const std::array<Index, 3>& at) const {
    return at[0] +
           static_cast<std::size_t>(grid_.cubes[0]) * (at[1] + static_cast<std::size_t>(grid_.cubes[1]) * at[2]);
  }
  /// By point: means of what by_cell(cell) returns over the faces around it.
  template <class ByCell> Vector means(const ByCell& by_cell) const {
    Vector sums = Vector::Zero(std::ssize(corners)), counts = sums;
    for (std::size_t f = 0; f < faces.size(); ++f) {
      const double value = by_cell(cell(faces[f].cell));
      const Triangle &one = triangles[2 * f], &other = triangles[2 * f + 1];
      for (const Index p : {one[0], one[1], one[2], other[2]}) sums[p] += value, counts[p] += 1.0;
    }
    return sums.cwiseQuotient(counts);
  }

 private:
  bool is_solid(const std::array<Index, 3>& at) const {
    for (int d = 0; d < 3; ++d)
      if (at[d] < 0 || at[d] >= grid_.cubes[d]) return false;
    return fields_.solid[cell(at)] >= 0.5F;
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
      }
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

/// A field on the grid of an answer: its values at points of the skin, and its extremes in the whole body.
class FieldOnCells {
 public:
  /// Of points of the grid `corners` by point of the skin, at `points`.
  FieldOnCells(const ImageAnswer& answer, const CellSkin& skin, const Points<3>& points)
      : answer_(answer), skin_(skin), points_(points) {}

  Vector values{};
  std::optional<Peak> largest{}, smallest{};

  /// Of the displacements of the skin.
  void set_displacement(const PointField<3>& field, const Points<3>& displacement) {
    values.resize(displacement.cols());
    for (Index p = 0; p < values.size(); ++p)
      values[p] = field(displacement.col(p), Voigt<3>::Zero(), Voigt<3>::Zero());
  }
  /// Of by_cell(cell).
  template <class ByCell> void set_cells(const ByCell& by_cell) {
    values = skin_.means(by_cell);
    const Lattice& grid = answer_.cells->grid;
    const auto& n = grid.cubes;
    PlacedRange range;
    std::array<Index, 3> at;
    for (at[2] = 0; at[2] < n[2]; ++at[2])
      for (at[1] = 0; at[1] < n[1]; ++at[1])
        for (at[0] = 0; at[0] < n[0]; ++at[0])
          if (const std::size_t cell = skin_.cell(at); answer_.by_cell.solid[cell] >= 0.5F) {
            const Vec<3> middle(at[0] + 0.5, at[1] + 0.5, at[2] + 0.5);
            range.add(by_cell(cell), grid.origin + answer_.cells->axes * grid.spacing.cwiseProduct(middle));
          }
    largest = peak(range.most, range.most_at);
    smallest = peak(range.least, range.least_at);
  }
  /// Takes the extremes that the results have, which are of parts of cells, in place of those of means.
  void take_known_extremes(const std::string& field) {
    for (const auto& extreme : answer_.extremes)
      if (extreme.of == field) largest = peak(extreme.value, extreme.at);
    for (const FieldRange<3>& range : field_ranges(answer_.by_cell)) {
      const bool principal = range.of == "principal_stress";  // the most of the first, the least of the third
      if (range.of == field || (principal && field == "principal_stress_1")) largest = peak(range.most, range.most_at);
      if (range.of == field || (principal && field == "principal_stress_3"))
        smallest = peak(range.least, range.least_at);
    }
    const auto most = std::ranges::max_element(answer_.utilisations, {}, &Utilisation<3>::value);
    if (field == "utilisation" && most != answer_.utilisations.end()) largest = peak(most->value, most->at);
  }

 private:
  /// With the point of the skin that is nearest to it, if one is as near as the diagonal of a cell.
  Peak peak(double value, const Vec<3>& at) const {
    Index nearest = 0;
    const double distance = std::sqrt((points_.colwise() - at).colwise().squaredNorm().minCoeff(&nearest));
    return {value, at, distance <= answer_.cells->grid.spacing.norm() ? nearest : -1};
  }

  const ImageAnswer& answer_;
  const CellSkin& skin_;
  const Points<3>& points_;
};

/// The field that the options name; false if there is none.
bool find_field(const PictureOptions& options, const Settings<3>& settings, const ImageResult& result,
                const ImageAnswer& answer, const Points<3>& displacement, FieldOnCells& field) {
  const CellFields& cells = answer.by_cell;
  if (const auto at_points = PointField<3>::find(options.field, false)) {
    if (at_points->is_of_displacement())
      field.set_displacement(*at_points, displacement);
    else
      field.set_cells([&](std::size_t c) {
        const auto cell = static_cast<Eigen::Index>(c);
        return (*at_points)(Vec<3>::Zero(), cells.strain.col(cell).cast<double>(),
                            cells.stress.col(cell).cast<double>());
      });
    field.take_known_extremes(options.field);
    return true;
  }
  if (options.field != "utilisation") return false;
  const std::vector<float> utilised = utilisation_of_cells(settings.common, result.regions, cells);
  field.set_cells([&](std::size_t c) { return static_cast<double>(utilised[c]); });
  field.take_known_extremes(options.field);
  return true;
}

}  // namespace

bool draw_result(const std::filesystem::path& file, const PictureOptions& options, const Settings<3>& settings,
                 const ImageResult& result) {
  const std::size_t number = case_number(options, settings);
  const ImageAnswer& answer = *result.answers()[number];
  const CellSolution& cells = *answer.cells;
  CellSkin skin(cells.grid, answer.by_cell);
  if (skin.triangles.empty()) return true;  // all walls are thinner than half a cell
  BodyPicture<3> body{.undeformed = {Points<3>(3, std::ssize(skin.corners)), skin.triangles, Skin::faces},
                      .displacement = Points<3>(3, std::ssize(skin.corners)),
                      .values = {},
                      .largest_displacement = answer.extremes[0].value};
  const auto& n = cells.grid.cubes;
  for (std::size_t p = 0; p < skin.corners.size(); ++p) {
    const std::size_t at = skin.corners[p], row = n[0] + 1, layer = row * (n[1] + 1);
    const Vec<3> place(static_cast<double>(at % row), static_cast<double>(at / row % (n[1] + 1)),
                       static_cast<double>(at / layer));
    const auto point = static_cast<Eigen::Index>(p);
    body.undeformed.points.col(point) = cells.grid.origin + cells.axes * cells.grid.spacing.cwiseProduct(place);
    body.displacement.col(point) = cells.displacement.col(static_cast<Eigen::Index>(at));
  }
  FieldOnCells field(answer, skin, body.undeformed.points);
  if (!find_field(options, settings, result, answer, body.displacement, field)) return false;
  body.values = field.values;
  body.largest = field.largest;
  body.smallest = field.smallest;

  std::map<std::string, std::vector<std::size_t>> known;
  const auto faces_on = [&](const std::string& part) -> const std::vector<std::size_t>& {
    const auto [found, is_new] = known.try_emplace(part);
    if (is_new)
      for (std::size_t f = 0; f < skin.faces.size(); ++f)
        if (is_near(skin.faces[f], result.facets.at(part), *result.image, cells.grid)) found->second.push_back(f);
    return found->second;
  };
  const auto pieces_on = [&](const auto& conditions) {
    std::vector<Triangle> pieces;
    std::set<std::string> named;
    for (const auto& condition : conditions) named.insert(condition.on);
    for (const std::string& name : named)
      for (const std::size_t f : faces_on(name))
        for (const std::size_t t : {2 * f, 2 * f + 1}) pieces.push_back(body.undeformed.triangles[t]);
    return pieces;
  };
  body.held = pieces_on(settings.supports);
  const Loads<3> loads = loads_by_case(settings)[number];
  body.loaded = pieces_on(loads.tractions);
  for (const Triangle& piece : pieces_on(loads.resultants)) body.loaded.push_back(piece);
  const auto loaded_facets = [&](const std::string& part) {
    std::vector<LoadedFacet<3>> facets;
    for (const std::size_t f : faces_on(part)) {
      const Triangle& half = body.undeformed.triangles[2 * f];
      const Vec3 normal = body.undeformed.normal(half);  // as long as the area
      facets.push_back({0.5 * (body.undeformed.points.col(half[0]) + body.undeformed.points.col(half[2])),
                        normal.normalized(), normal.norm(), half[0]});
    }
    return facets;
  };
  body.arrows = load_arrows<3>(loads, loaded_facets, arrow_gap(body.undeformed));
  draw_body(file, body, options, title_of(options, settings));
  return true;
}

}  // namespace efree
