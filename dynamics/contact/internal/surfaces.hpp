// SPDX-License-Identifier: GPL-3.0-or-later
/// Contact between deformable bodies: their surfaces, and the nodes that are near those of other bodies.
#pragma once

#include "efree/dynamics/contact/internal/facet.hpp"
#include "efree/dynamics/contact/overlap.hpp"
#include "efree/dynamics/interaction.hpp"
#include "efree/dynamics/scheme.hpp"

#include <optional>

namespace efree::internal {

/// How deep a node may be inside another body, over the spacing, before it counts as on its other side.
inline constexpr double largest_depth = 0.8;
/// Likewise inside its own, and how much deeper than in the last step: the other side of a thin body is as near.
inline constexpr double largest_own_depth = 0.25, closed_gap = 0.01;

/// The facet that a node faces, of another body or of its own: the normal of a facet of the node is opposed to its.
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
    Ragged<Index> around;      ///< by number in `nodes`: the facets of a node
    Points<Dim> normals;       ///< of the facets, unit vectors; of no meaning without near_
    friend auto fields(Surface& of) {
      auto& [facets, nodes, around, normals] = of;
      return std::tie(facets, nodes, around.offsets, around.items, normals);
    }
  };
  /// A node of a surface and the facets of another body, or of its own, that it may reach.
  struct Near {
    Index node, body;
    std::size_t number;         ///< of the node in its surface
    std::vector<Index> facets;  ///< of that body, without those of the node
    friend auto fields(Near& of) {
      auto& [node, body, number, facets] = of;
      return std::tie(node, body, number, facets);
    }
  };

  /// Finds what has changed: surfaces, near facets where that or the motion of the nodes requires it, and normals.
  void update(const World<Dim>& world, const Scheme<Dim>& scheme);
  /// Finds the surfaces where the nodes are now.
  void find(const World<Dim>& world, const Scheme<Dim>& scheme);
  /// The nearest facet that the node faces, after update(). dt: the step to come. last_gap: between both in the last
  /// step, if they were a pair, by which a node inside its own body is told from one on its other side.
  FacingFacet<Dim> facing(const World<Dim>& world, const Near& near, double dt,
                          const std::optional<double>& last_gap = {}) const;
  /// Whether surfaces have been found since they last changed.
  bool is_current(const World<Dim>& world) const { return surface_changes_ == world.surface_changes; }
  const std::vector<Surface>& surfaces() const { return surfaces_; }  ///< by body
  const std::vector<Near>& near() const { return near_; }             ///< ascending by bodies, then by nodes
  void pack(Archive& archive) { archive(surfaces_, near_, x_near_, surface_changes_); }

 private:
  void find_near(const World<Dim>& world);
  /// Whether the normal of a facet is opposed to that of one around the node: its cosine is less.
  bool is_opposed(const Surface& of_node, std::size_t number, const Vec<Dim>& normal, double cosine) const;
  void keep_facing(const World<Dim>& world, Index body, std::size_t number, std::vector<Index>& facets) const;
  void find_normals(const World<Dim>& world);

  std::vector<Surface> surfaces_;
  std::vector<Near> near_;
  Points<Dim> x_near_;          ///< positions of the nodes when near_ was found; empty: not yet
  Index surface_changes_ = -1;  ///< of the world when surfaces_ were found
};

/// Material points that are inside another body by half a spacing and more, ascending. Bodies with merged or
/// tied nodes, or broken points, are left out: their surface does not enclose them.
template <int Dim> std::vector<Index> points_in_others(const World<Dim>& world, const BodySurfaces<Dim>& surfaces);

/// The node that is deepest inside another body, no deeper than `largest_depth`; no node where there is none.
template <int Dim> Overlap deepest_overlap(const World<Dim>& world, const Scheme<Dim>& scheme);

/// Contact by impulses, with friction, as ContactOptions say. The scheme, which knows the surfaces, must outlive it.
template <int Dim> std::unique_ptr<Interaction<Dim>> body_contact(const Scheme<Dim>& scheme);

}  // namespace efree::internal
