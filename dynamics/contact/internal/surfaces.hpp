// SPDX-License-Identifier: GPL-3.0-or-later
/// Contact between deformable bodies: their surfaces, and the nodes that are near those of other bodies.
#pragma once

#include "efree/dynamics/contact/internal/facet.hpp"
#include "efree/dynamics/contact/overlap.hpp"
#include "efree/dynamics/interaction.hpp"
#include "efree/dynamics/scheme.hpp"

namespace efree::internal {

/// How deep a node may be inside a body, over the spacing, before it counts as on its other side.
inline constexpr double largest_depth = 0.8;

/// The facet of another body that a node faces: their normals are opposed.
template <int Dim> struct FacingFacet {
  Index facet = -1;                                      ///< of the body's surface; -1: there is none near
  Vec<Dim> weights = Vec<Dim>::Zero();                   ///< of its corners, in the point of its plane below the node
  double gap = std::numeric_limits<double>::infinity();  ///< from that point to the node, negative inside
  Vec<Dim> normal = Vec<Dim>::Zero();                    ///< of the facet, outwards
};

/// Surfaces of all bodies. They are found again after world.surface_changes, and near facets after nodes have moved.
template <int Dim> class BodySurfaces {
 public:
  struct Surface {
    Facets<Dim> facets;        ///< outwards; none on an axis
    std::vector<Index> nodes;  ///< of them, ascending
    friend auto fields(Surface& of) {
      auto& [facets, nodes] = of;
      return std::tie(facets, nodes);
    }
  };
  /// A node of a surface and the facets of another body that it may reach.
  struct Near {
    Index node, body;
    std::vector<Index> facets;  ///< of that body
    friend auto fields(Near& of) {
      auto& [node, body, facets] = of;
      return std::tie(node, body, facets);
    }
  };

  /// Finds what has changed: surfaces, near facets where that or the motion of the nodes requires it, and normals.
  void update(const World<Dim>& world, const Scheme<Dim>& scheme);
  /// Finds the surfaces where the nodes are now.
  void find(const World<Dim>& world, const Scheme<Dim>& scheme);
  /// The nearest facet that the node faces, after update().
  FacingFacet<Dim> facing(const World<Dim>& world, const Near& near) const;
  /// Whether surfaces have been found since they last changed.
  bool is_current(const World<Dim>& world) const { return surface_changes_ == world.surface_changes; }
  const std::vector<Surface>& surfaces() const { return surfaces_; }  ///< by body
  const std::vector<Near>& near() const { return near_; }
  void pack(Archive& archive) { archive(surfaces_, near_, x_near_, surface_changes_); }

 private:
  void find_near(const World<Dim>& world);
  void find_normals(const World<Dim>& world);

  std::vector<Surface> surfaces_;
  Points<Dim> normals_;  ///< Dim x N: unit vectors outwards by the facets around a node; of no meaning without near_
  std::vector<Near> near_;
  Points<Dim> x_near_;          ///< positions of the nodes when near_ was found; empty: not yet
  Index surface_changes_ = -1;  ///< of the world when surfaces_ were found
};

/// Material points that are inside another body by half a spacing and more, ascending. Bodies with merged nodes or
/// broken points are left out: their surface does not enclose them.
template <int Dim> std::vector<Index> points_in_others(const World<Dim>& world, const BodySurfaces<Dim>& surfaces);

/// The node that is deepest inside another body, no deeper than `largest_depth`; no node where there is none.
template <int Dim> Overlap deepest_overlap(const World<Dim>& world, const Scheme<Dim>& scheme);

/// Contact by impulses, with friction. Acts if ContactOptions::enabled and there are several bodies. The scheme, which
/// knows the surfaces, must outlive it.
template <int Dim> std::unique_ptr<Interaction<Dim>> body_contact(const Scheme<Dim>& scheme);

}  // namespace efree::internal
