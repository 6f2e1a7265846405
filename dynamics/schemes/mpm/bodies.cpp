// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies of the material point method by a mesh.
#include "efree/basis/internal/neighbours.hpp"
#include "efree/core/error.hpp"
#include "efree/dynamics/schemes/mpm/internal/sparse_grid.hpp"
#include "efree/dynamics/schemes/mpm/internal/spline.hpp"
#include "efree/dynamics/schemes/mpm/mpm.hpp"
#include "efree/geometry/mesh/internal/facet_samples.hpp"
#include "efree/quadrature/lattice.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <map>

namespace efree {
namespace {

using internal::GridBlock, internal::Site, internal::SparseGrid;

template <int Dim> Vec<Dim> origin_of(const MpmOptions& options) {
  Vec<Dim> origin;
  for (int i = 0; i < Dim; ++i) origin[i] = options.origin[static_cast<std::size_t>(i)];
  return origin;
}

/// Nodes around a position with their splines: site, N, dN.
template <int Dim> struct SplineEntry {
  Site<Dim> site;
  double N;
  Vec<Dim> dN;
};

template <int Dim> std::vector<SplineEntry<Dim>> splines_at(const Vec<Dim>& position, const MpmOptions& options) {
  internal::GridBox all{.dim = Dim, .degree = options.degree, .cell = options.cell};
  std::ranges::copy(options.origin, all.low);
  std::vector<SplineEntry<Dim>> result;
  internal::for_each_site<Dim>(all, position.data(), [&](const auto& place, double N, const Vec<Dim>& dN) {
    SplineEntry<Dim> entry{Site<Dim>::Zero(), N, dN};
    for (int i = 0; i < Dim; ++i) entry.site[i] = static_cast<Index>(place[static_cast<std::size_t>(i)]);
    if (N > 0.0) result.push_back(entry);
  });
  return result;
}

/// A table by rows of splines. Without gradients: of points of a surface, whose nodes are those of the grid there is.
template <int Dim> ShapeTable<Dim> table_of(const std::vector<std::vector<SplineEntry<Dim>>>& rows,
                                            const SparseGrid<Dim>& grid, bool gradients) {
  std::vector<Offset> offsets{0};
  std::vector<Index> nodes;
  std::vector<double> N;
  std::vector<Vec<Dim>> dN;
  for (const auto& row : rows) {
    std::vector<std::pair<Index, const SplineEntry<Dim>*>> sorted;
    double sum = 0.0;
    for (const auto& entry : row)
      if (const Index node = grid.find(entry.site); node >= 0) {
        sorted.emplace_back(node, &entry);
        sum += entry.N;
      }
    std::ranges::sort(sorted, {}, [](const auto& pair) { return pair.first; });
    for (const auto& [node, entry] : sorted) {
      nodes.push_back(node);
      N.push_back(entry->N / sum);
      if (gradients) dN.push_back(entry->dN);
    }
    offsets.push_back(static_cast<Offset>(nodes.size()));
  }
  return {grid.end(), std::move(offsets), std::move(nodes), std::move(N), std::move(dN)};
}

void require_cell(const MpmOptions& options) {
  require(options.cell > 0.0, "the material point method: expected a cell of positive length");
}

/// By point of a body, the number of the grid's cell that it is in. Throws InputError where the body fills less than
/// half of every cell: it is thinner than these.
template <int Dim> std::vector<Index> patches_of_cells(const DeformableBody<Dim>& body, const MpmOptions& options) {
  const Vec<Dim> origin = origin_of<Dim>(options);
  std::map<std::vector<Index>, std::pair<Index, double>> cells;  // number, and volume of the body there
  std::vector<Index> patches;
  double fullest = 0.0;
  for (Index p = 0; p < body.points.cols(); ++p) {
    std::vector<Index> cell;
    for (int i = 0; i < Dim; ++i)
      cell.push_back(static_cast<Index>(std::floor((body.points(i, p) - origin[i]) / options.cell)));
    auto& [patch, volume] = cells.try_emplace(cell, static_cast<Index>(cells.size()), 0.0).first->second;
    patches.push_back(patch);
    volume += body.volumes[p];
    fullest = std::max(fullest, volume / std::pow(options.cell, Dim));
  }
  if (fullest < 0.5)
    throw InputError(fmt::format(
        "the material point method: cell {:.6g} is thicker than the body, which fills no more than {:.2g} of any cell; "
        "take a cell of half of the body's thickness, or less",
        options.cell, fullest));
  return patches;
}

}  // namespace

template <int Dim> DeformableBody<Dim> points_on_lattice(const FineMesh<Dim>& mesh, const MpmOptions& options,
                                                         Index points_along, SharedMaterial material, double density) {
  require(points_along >= 1 && points_along <= 8, "points along a cell: expected 1 to 8");
  require_cell(options);
  const double spacing = options.cell / static_cast<double>(points_along);
  const LatticePieces<Dim> pieces = cut_by_lattice<Dim>(mesh, origin_of<Dim>(options), spacing);
  DeformableBody<Dim> body;
  body.points = pieces.centroids;
  body.volumes = pieces.volumes;
  body.material = std::move(material);
  body.density = density;
  body.patches = patches_of_cells(body, options);
  return body;
}

template <int Dim> DeformableBody<Dim> mesh_on_lattice(const FineMesh<Dim>& mesh, const MpmOptions& options,
                                                       SharedMaterial material, double density) {
  require_cell(options);
  DeformableBody<Dim> body = deformable_body(mesh, std::move(material), density);
  body.patches = patches_of_cells(body, options);
  return body;
}

template <int Dim> DeformableBody<Dim> splines_on_lattice(const FineMesh<Dim>& mesh, const MpmOptions& options,
                                                          Index points_along, SharedMaterial material, double density) {
  DeformableBody<Dim> body = points_on_lattice(mesh, options, points_along, std::move(material), density);
  const Vec<Dim> origin = origin_of<Dim>(options);
  const auto rows_at = [&](Index count, const auto& position) {
    std::vector<std::vector<SplineEntry<Dim>>> rows;
    for (Index p = 0; p < count; ++p) rows.push_back(splines_at<Dim>(position(p), options));
    return rows;
  };
  const auto rows =
      rows_at(static_cast<Index>(body.points.cols()), [&](Index p) { return Vec<Dim>(body.points.col(p)); });
  std::vector<GridBlock> blocks;
  for (const auto& row : rows)
    for (const auto& entry : row) {
      const auto [key, bit] = internal::locate_site<Dim>(entry.site);
      if (blocks.empty() || blocks.back().key != key) blocks.push_back({key, 0});
      blocks.back().nodes |= std::uint64_t{1} << bit;
    }
  const SparseGrid<Dim> grid(std::move(blocks), 0);
  body.nodes.resize(Dim, grid.end());
  grid.for_each([&](Index node, const Site<Dim>& site) {
    body.nodes.col(node) = origin + options.cell * site.template cast<double>();
  });
  body.shape = table_of(rows, grid, true);
  const Points<Dim> surface = internal::sample_boundary(mesh, 0.5 * options.cell);
  body.surface = table_of(
      rows_at(static_cast<Index>(surface.cols()), [&](Index s) { return Vec<Dim>(surface.col(s)); }), grid, false);
  return body;
}

template <int Dim> DeformableBody<Dim> body_on_lattice(const FineMesh<Dim>& mesh, MpmFrame frame,
                                                       const MpmOptions& options, Index points_along,
                                                       SharedMaterial material, double density) {
  switch (frame) {
    case MpmFrame::total:
      return splines_on_lattice(mesh, options, points_along, std::move(material), density);
    case MpmFrame::mesh:
      return mesh_on_lattice(mesh, options, std::move(material), density);
    default:
      return points_on_lattice(mesh, options, points_along, std::move(material), density);
  }
}

template <int Dim> std::vector<Index> points_near_facets(const FineMesh<Dim>& mesh, const std::vector<Index>& facets,
                                                         const Points<Dim>& points, double depth) {
  const Points<Dim> at = internal::sample_facets(mesh, facets, 0.25 * depth);
  std::vector<Index> result;
  if (at.cols() == 0) return result;
  internal::Neighbours<Dim> tree;
  tree.build(at);
  for (Index p = 0; p < points.cols(); ++p)
    if ((at.col(tree.nearest(points.col(p))) - points.col(p)).norm() <= depth) result.push_back(p);
  return result;
}

template <int Dim>
std::vector<Index> nodes_of_points(const DeformableBody<Dim>& body, const std::vector<Index>& points) {
  std::vector<char> is_one(body.points.cols(), 0);
  for (const Index p : points) is_one[p] = 1;
  Vector all = Vector::Zero(body.nodes.cols()), of_these = all;
  for (Index p = 0; p < body.points.cols(); ++p) {
    const ShapeRow<Dim> row = body.shape->row(p);
    for (std::size_t k = 0; k < row.nodes.size(); ++k) {
      all[row.nodes[k]] += row.N[k] * body.volumes[p];
      if (is_one[p] != 0) of_these[row.nodes[k]] += row.N[k] * body.volumes[p];
    }
  }
  std::vector<Index> result;
  for (Index a = 0; a < all.size(); ++a)
    if (of_these[a] > 0.0 && of_these[a] >= 0.5 * all[a]) result.push_back(a);
  return result;
}

#define EFREE_INSTANTIATE(Dim)                                                                                        \
  template DeformableBody<Dim> points_on_lattice(const FineMesh<Dim>&, const MpmOptions&, Index, SharedMaterial,      \
                                                 double);                                                             \
  template DeformableBody<Dim> mesh_on_lattice(const FineMesh<Dim>&, const MpmOptions&, SharedMaterial, double);      \
  template DeformableBody<Dim> body_on_lattice(const FineMesh<Dim>&, MpmFrame, const MpmOptions&, Index,              \
                                               SharedMaterial, double);                                               \
  template std::vector<Index> points_near_facets(const FineMesh<Dim>&, const std::vector<Index>&, const Points<Dim>&, \
                                                 double);                                                             \
  template std::vector<Index> nodes_of_points(const DeformableBody<Dim>&, const std::vector<Index>&);                 \
  template DeformableBody<Dim> splines_on_lattice(const FineMesh<Dim>&, const MpmOptions&, Index, SharedMaterial,     \
                                                  double);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree
