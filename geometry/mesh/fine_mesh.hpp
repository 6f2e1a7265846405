// SPDX-License-Identifier: GPL-3.0-or-later
/// The fine triangulation: the domain as it is, with every hole, crack and pore. Its quality does not matter.
#pragma once

#include "efree/core/types.hpp"

#include <array>
#include <string>
#include <string_view>
#include <vector>

namespace efree {

/// Simplices: (Dim+1) x n vertex indices, column = cell.
template <int Dim> using Cells = Eigen::Matrix<Index, Dim + 1, Eigen::Dynamic>;
/// Facets (edges in 2D): Dim x n vertex indices, column = facet.
template <int Dim> using Facets = Eigen::Matrix<Index, Dim, Eigen::Dynamic>;

/// What a mesher or a reader hands over: plain arrays, nothing checked yet.
template <int Dim> struct MeshData {
  /// A named set of facets.
  struct Group {
    std::string name;
    std::vector<std::array<Index, Dim>> facets;  ///< vertex indices, in any order
  };
  Points<Dim> vertices;
  Cells<Dim> cells;                         ///< either orientation
  std::vector<Group> groups;                ///< named sets of facets; sets may overlap
  std::vector<Index> regions{};             ///< region of each cell, counted from 0; empty: one region
  std::vector<std::string> region_names{};  ///< by region; empty: one region without a name
};

/// Cuts the mesh open along facets inside it: every vertex of `facets` is split into one copy for each part of its star
/// that the cut separates, so that the ends of a cut (its tips) stay whole. Groups follow: a group that lies on the cut
/// afterwards holds the facets of both sides. Cost linear in the mesh.
/// Throws InputError if a cell's vertex is out of range, if a facet is not one of the mesh, or stays closed because
/// none of its vertices splits (a cut of a single facet between two tips).
template <int Dim> MeshData<Dim> cut_open(MeshData<Dim> mesh, const std::vector<std::array<Index, Dim>>& facets);

/// Cuts the mesh open along all facets between cells of different regions, so that every region is a body of its own;
/// tied_facets finds the two sides again.
template <int Dim> MeshData<Dim> cut_regions(MeshData<Dim> mesh);

/// Immutable simplicial mesh with adjacency and named parts of the boundary.
template <int Dim> class FineMesh {
 public:
  /// A named part of the boundary.
  struct Group {
    std::string name;
    std::vector<Index> facets;  ///< boundary facets, ascending
  };

  FineMesh() = default;
  /// Orients cells positively, drops vertices without a cell, finds the boundary facets and resolves the groups
  /// (facets inside the mesh are left out, and so are groups without any facet on the boundary). Throws InputError for
  /// an index out of range, a cell of zero volume, a facet shared by more than two cells, cells on the same side of a
  /// facet they share (a mesh that folds over itself), a body too large, small or far away for double precision, a
  /// group facet that is no facet of the mesh, a region without a name or with the name of another, or no cell.
  explicit FineMesh(MeshData<Dim> data);

  Index num_vertices() const { return static_cast<Index>(vertices_.cols()); }
  Index num_cells() const { return static_cast<Index>(cells_.cols()); }
  Index num_facets() const { return static_cast<Index>(facets_.cols()); }

  const Points<Dim>& vertices() const { return vertices_; }
  Vec<Dim> vertex(Index v) const { return vertices_.col(v); }
  const Cells<Dim>& cells() const { return cells_; }
  Vec<Dim> centroid(Index c) const;

  /// Volume (area in 2D) of cell c, positive.
  double volume(Index c) const { return volumes_[c]; }
  const Vector& volumes() const { return volumes_; }
  /// Gradients of the hats of cell c: Dim x (Dim+1), column i belongs to cells()(i, c) [1/length].
  Eigen::Matrix<double, Dim, Dim + 1> hat_gradients(Index c) const;

  /// Region (material) of cell c, counted from 0.
  Index region(Index c) const { return regions_.empty() ? 0 : regions_[c]; }
  Index num_regions() const { return static_cast<Index>(region_names_.size()); }
  /// By region; a mesh that came without regions has one, named "".
  const std::vector<std::string>& region_names() const { return region_names_; }
  /// Throws InputError that lists the names there are.
  Index region(std::string_view name) const;

  /// Cell on the other side of the facet opposite vertex i of cell c, or -1 on the boundary.
  Index neighbour(Index i, Index c) const { return neighbours_(i, c); }
  /// Cells around vertex v, ascending.
  std::span<const Index> cells_of(Index v) const { return vertex_cells_[v]; }

  /// Boundary facets. In 2D the body lies to the left of the edge from its first to its second vertex.
  const Facets<Dim>& facets() const { return facets_; }
  Index facet_cell(Index f) const { return facet_cells_[f]; }
  /// Length (area in 3D) of boundary facet f.
  double facet_measure(Index f) const;
  /// Unit outward normal of boundary facet f.
  Vec<Dim> facet_normal(Index f) const;
  /// Boundary facets at vertex v, ascending; empty inside the body.
  std::span<const Index> facets_of(Index v) const { return vertex_facets_[v]; }
  bool on_boundary(Index v) const { return !facets_of(v).empty(); }

  const std::vector<Group>& groups() const { return groups_; }
  /// Facets of the group of that name. Throws InputError that lists the names there are.
  const std::vector<Index>& group(std::string_view name) const;
  /// The same mesh with other named parts. Throws InputError for a facet that does not exist or two parts of one name.
  FineMesh with_groups(std::vector<Group> groups) &&;

  /// Connected bodies: component of each vertex, numbered from 0 in the order of their first vertices.
  const std::vector<Index>& component() const { return components_; }
  Index num_components() const { return num_components_; }

  /// Largest edge length.
  double size() const { return size_; }

 private:
  Points<Dim> vertices_;
  Cells<Dim> cells_;
  Vector volumes_;
  Cells<Dim> neighbours_;
  Ragged<Index> vertex_cells_;
  Facets<Dim> facets_;
  std::vector<Index> facet_cells_;
  Ragged<Index> vertex_facets_;
  std::vector<Group> groups_;
  std::vector<Index> regions_;
  std::vector<std::string> region_names_;
  std::vector<Index> components_;
  Index num_components_ = 0;
  double size_ = 0.0;
};

/// The cells that are kept (by cell, not 0) and what is left of the groups; all regions stay known.
template <int Dim> MeshData<Dim> extract(const FineMesh<Dim>& mesh, const std::vector<char>& kept);

/// A mesh without hinges: vertices (in space also edges) by which alone cells hang together, so that they turn freely.
template <int Dim> struct Unhinged {
  MeshData<Dim> mesh;
  std::vector<Index> hinges;  ///< vertices of the mesh given that were split, ascending; none: `mesh` is empty
};
/// Splits every vertex into one copy for each part of its star that hangs together through facets; so bodies hang
/// together through facets only, as in images (mesh_on_lattice). Cost linear in the boundary if there is no hinge.
template <int Dim> Unhinged<Dim> cut_hinges(const FineMesh<Dim>& mesh);

/// Two boundary facets in the same place that belong to different regions.
struct TiedFacets {
  Index first, second;  ///< first belongs to the region with the smaller number
};
/// The interfaces between the regions of a mesh made by cut_regions, ascending by their first facet; those with both
/// sides in the group `open` (a crack along an interface) are left out. Vertices must coincide exactly.
template <int Dim> std::vector<TiedFacets> tied_facets(const FineMesh<Dim>& mesh, std::string_view open = {});

}  // namespace efree
