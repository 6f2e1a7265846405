// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/lattice_mesh.hpp"

#include "efree/geometry/meshing/internal/image_regions.hpp"
#include "efree/geometry/meshing/internal/lattice_losses.hpp"
#include "efree/geometry/meshing/internal/lattice_vertices.hpp"

#include <array>
#include <vector>

namespace efree {
namespace {

using internal::kuhn_tets, internal::KuhnTet, internal::on_boundary, internal::Subdivision;

constexpr std::array<const char*, 7> group_names{"left", "right", "front", "back", "bottom", "top", "pores"};
constexpr int pores = 6;

/// Cells and groups of facets.
class LatticeCells : public internal::LatticeVertices {
 public:
  using internal::LatticeVertices::LatticeVertices;

  LatticeMesh make() {
    LatticeMesh out;
    find_lost(out.lost);
    cut_edges_and_snap();
    number_vertices();
    place_vertices(out);
    make_cells(out);
    internal::find_broken(image_, out);
    out.lattice = lattice();
    out.mesh.region_names = regions_.names;
    return out;
  }

 private:
  void make_cells(LatticeMesh& out) const {
    using Key = std::array<Index, 3>;
    out.mesh.cells.resize(4, static_cast<Index>(num_cells_));
    out.mesh.regions.resize(num_cells_);
    out.cube_of_cell.resize(num_cells_);
    std::vector<std::array<std::vector<Key>, 7>> facets(static_cast<std::size_t>(cubes_[2]));
    for_each_layer(cubes_[2], stride_[2], [&](Index k) {
      std::int64_t cell = first_cell_[k];
      for_each_point(k, [&](const std::array<Index, 3>& at, std::size_t cube) {
        if (upward(at) != 7) return;
        const auto corner = corners(cube);
        const bool uniform = is_uniform(corner);
        if (uniform && corner[0] == 0) return;
        const bool at_frame =
            downward(at) != 7 || at[0] + 1 == cubes_[0] || at[1] + 1 == cubes_[1] || at[2] + 1 == cubes_[2];
        const Index number_of_cube = static_cast<Index>(
            at[0] + static_cast<std::int64_t>(cubes_[0]) * (at[1] + static_cast<std::int64_t>(cubes_[1]) * at[2]));
        const auto emit = [&](const std::array<Index, 4>& points, bool is_odd, Label region) {
          const Index c = static_cast<Index>(cell++);
          out.mesh.cells.col(c) << points[0], points[1], points[is_odd ? 3 : 2], points[is_odd ? 2 : 3];
          out.mesh.regions[c] = region - 1;
          out.cube_of_cell[c] = number_of_cube;
        };
        if (uniform && !at_frame) {
          std::array<Index, 8> v;
          for (int c = 0; c < 8; ++c) v[c] = first_vertex_[cube + offset_[c]];
          for (const KuhnTet& tet : kuhn_tets())
            emit({v[tet.corner[0]], v[tet.corner[1]], v[tet.corner[2]], v[tet.corner[3]]}, tet.is_odd, corner[0]);
          return;
        }
        for (int t = 0; t < 6; ++t) {
          const KuhnTet& tet = kuhn_tets()[t];
          const Subdivision& parts = subdivision_of(corner, tet);
          const Label inside = parts.pieces[0].owner == 4 ? region_inside(cube, tet) : Label{0};
          const auto region = [&](int owner) { return owner == 4 ? inside : corner[tet.corner[owner]]; };
          for (const auto& piece : parts.pieces) {
            if (region(piece.owner) == 0) continue;
            std::array<Index, 4> points;
            for (int i = 0; i < 4; ++i) points[i] = vertex(cube, t, piece.points[i]);
            emit(points, tet.is_odd, region(piece.owner));
          }
          const auto add = [&](int group, const std::array<std::uint8_t, 3>& points) {
            facets[k][group].push_back(
                {vertex(cube, t, points[0]), vertex(cube, t, points[1]), vertex(cube, t, points[2])});
          };
          for (const auto& facet : parts.interfaces)
            if ((region(facet.owner) == 0) != (region(facet.other) == 0)) add(pores, facet.points);
          for (const auto& facet : parts.outer) {
            if (region(facet.owner) == 0) continue;
            const int axis = tet.beyond_axis[facet.face];
            if (axis >= 0 && facet.face == 3 && at[axis] == 0) {
              add(2 * axis, facet.points);
            } else if (axis >= 0 && facet.face == 0 && at[axis] + 1 == cubes_[axis]) {
              add(2 * axis + 1, facet.points);
            } else if (facet.is_whole) {
              std::size_t other = cube;
              if (axis >= 0) other = facet.face == 0 ? cube + stride_[axis] : cube - stride_[axis];
              const KuhnTet& beyond = kuhn_tets()[tet.beyond[facet.face]];
              // The corner of the other one that this one lacks.
              const int corner_beyond = facet.face == 0 ? 3 : facet.face == 3 ? 0 : facet.face;
              Label label = label_[other + offset_[beyond.corner[corner_beyond]]];
              if (label == on_boundary) label = region_inside(other, beyond);
              if (label == 0) add(pores, facet.points);
            }
          }
        }
      });
    });
    for (int g = 0; g < 7; ++g) {
      auto& group = out.mesh.groups.emplace_back();
      group.name = group_names[g];
      std::size_t count = 0;
      for (const auto& plane : facets) count += plane[g].size();
      group.facets.reserve(count);
      for (const auto& plane : facets) group.facets.insert(group.facets.end(), plane[g].begin(), plane[g].end());
    }
  }
};

}  // namespace

LatticeMesh mesh_on_lattice(const LabelImage<3>& image, const ImageMeshOptions& options) {
  LatticeMesh made = LatticeCells(image, options).make();
  internal::turn_to_world(image, made.mesh.vertices);
  for (Vec<3>* place : {&made.lost.worst_place, &made.lost.broken_place}) *place = image.in_world(*place);
  return made;
}

}  // namespace efree
