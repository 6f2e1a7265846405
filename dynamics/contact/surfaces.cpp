// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/contact/internal/surfaces.hpp"

#include <set>

namespace efree::internal {
namespace {

/// How far nodes may move before near facets are found again, over the spacing.
constexpr double search_skin = 0.25;
/// Cosine of the angle between the normals of a node and a facet at which they do not face each other.
constexpr double not_facing = -0.1;
/// How far facets go on beyond their edges, over their size, for nodes no further from their plane than this over the
/// spacing: corners that lie on each other.
constexpr double beyond_edge = 0.05, beyond_depth = 0.05;

/// Largest spacing of the nodes of facets.
template <int Dim> double widest_spacing(const Nodes<Dim>& nodes, const Facets<Dim>& facets) {
  return nodes.spacing(facets.reshaped()).maxCoeff();
}

}  // namespace

template <int Dim> void BodySurfaces<Dim>::find(const World<Dim>& world, const Scheme<Dim>& scheme) {
  surfaces_.assign(world.bodies.size(), {});
  for (Index b = 0; b < world.num_bodies(); ++b) {
    Surface& surface = surfaces_[b];
    surface.facets = scheme.surface(world, b);
    std::set<Index> nodes;
    for (const Index a : surface.facets.reshaped()) nodes.insert(a);
    surface.nodes.assign(nodes.begin(), nodes.end());
  }
  near_.clear();
  x_near_.resize(Dim, 0);
  surface_changes_ = world.surface_changes;
}

template <int Dim> void BodySurfaces<Dim>::find_normals(const World<Dim>& world) {
  normals_.setZero(Dim, world.nodes.size());
  for (const Surface& surface : surfaces_) {
    for (Index f = 0; f < surface.facets.cols(); ++f) {
      const Vec<Dim> area = area_of<Dim>(facet_corners(world.nodes.x, surface.facets, f));
      for (const Index a : surface.facets.col(f)) normals_.col(a) += area;
    }
    for (const Index a : surface.nodes) normals_.col(a).normalize();
  }
}

template <int Dim> void BodySurfaces<Dim>::find_near(const World<Dim>& world) {
  const Nodes<Dim>& nodes = world.nodes;
  x_near_ = nodes.x;
  near_.clear();
  for (std::size_t b = 0; b < surfaces_.size(); ++b) {
    const Facets<Dim>& facets = surfaces_[b].facets;
    if (facets.cols() == 0) continue;
    const FacetTree<Dim> tree(nodes.x, facets);
    const double widest = widest_spacing(nodes, facets);
    std::vector<Index> found;
    for (std::size_t other = 0; other < surfaces_.size(); ++other) {
      if (other == b) continue;
      for (const Index a : surfaces_[other].nodes) {
        const double skin = search_skin * (widest + nodes.spacing[a]);
        tree.centres.within(nodes.x.col(a), tree.reach + skin + largest_depth * widest, found);
        if (!found.empty()) near_.push_back({a, static_cast<Index>(b), found});
      }
    }
  }
}

template <int Dim> FacingFacet<Dim> BodySurfaces<Dim>::facing(const World<Dim>& world, const Near& near) const {
  const Nodes<Dim>& nodes = world.nodes;
  const double spacing = nodes.spacing[near.node];
  const Facets<Dim>& facets = surfaces_[near.body].facets;
  FacingFacet<Dim> result;
  for (const Index f : near.facets) {
    const Mat<Dim> corner = facet_corners(nodes.x, facets, f).colwise() - Vec<Dim>(nodes.x.col(near.node));
    const Vec<Dim> area = area_of<Dim>(corner);
    if (!(area.norm() > 1e-9 * std::pow(spacing, Dim - 1))) continue;
    const Vec<Dim> normal = area.normalized();
    const double gap = -normal.dot(corner.col(0));
    if (!(std::abs(gap) < std::abs(result.gap)) || !(normal.dot(normals_.col(near.node)) < not_facing)) continue;
    const Vec<Dim> weights = weights_in<Dim>(corner);
    if (weights.minCoeff() < (std::abs(gap) < beyond_depth * spacing ? -beyond_edge : 0.0)) continue;
    if (gap > -largest_depth * nodes.spacing[facets(0, f)])
      result = {.facet = f, .weights = weights, .gap = gap, .normal = normal};
  }
  return result;
}

template <int Dim> Overlap deepest_overlap(const World<Dim>& world, const Scheme<Dim>& scheme) {
  BodySurfaces<Dim> surfaces;
  surfaces.update(world, scheme);
  Overlap result;
  for (const auto& near : surfaces.near())
    if (const double gap = surfaces.facing(world, near).gap; gap < -result.depth)
      result = {.node = near.node, .body = near.body, .depth = -gap};
  return result;
}

template <int Dim> void BodySurfaces<Dim>::update(const World<Dim>& world, const Scheme<Dim>& scheme) {
  if (!is_current(world)) find(world, scheme);
  const Points<Dim>& x = world.nodes.x;
  const Vector& spacing = world.nodes.spacing;
  bool search = x_near_.size() == 0;
  for (Index a = 0; a < x.cols() && !search; ++a)
    search = (x.col(a) - x_near_.col(a)).squaredNorm() > search_skin * search_skin * spacing[a] * spacing[a];
  if (search) find_near(world);
  if (!near_.empty()) find_normals(world);
}

template <int Dim> std::vector<Index> points_in_others(const World<Dim>& world, const BodySurfaces<Dim>& surfaces) {
  const Nodes<Dim>& nodes = world.nodes;
  std::set<Index> result;
  for (Index b = 0; b < static_cast<Index>(surfaces.surfaces().size()); ++b) {
    const Facets<Dim>& facets = surfaces.surfaces()[b].facets;
    const auto is_merged = [&](Index a) { return nodes.active[a] == 0; };
    const auto is_broken = [&](const auto& chunk) {
      return chunk.body == b && (chunk.matter.damage.array() >= 1.0).any();
    };
    if (facets.cols() == 0 || std::ranges::any_of(world.nodes_of(b), is_merged) ||
        std::ranges::any_of(world.chunks, is_broken))
      continue;
    const FacetTree<Dim> tree(nodes.x, facets);
    const double widest = widest_spacing(nodes, facets);
    Eigen::AlignedBox<double, Dim> box;
    for (const Index a : world.nodes_of(b)) box.extend(Vec<Dim>(nodes.x.col(a)));
    std::vector<Index> found;
    for (const auto& chunk : world.chunks) {
      if (chunk.body == b) continue;
      for (Index p = 0; p < chunk.size(); ++p) {
        const Vec<Dim> at = chunk.matter.x.col(p);
        if (chunk.is_eroded(p) || !box.contains(at)) continue;
        tree.centres.within(at, tree.reach + widest, found);
        NearestFacet<Dim> nearest(1e-9 * widest);
        for (const Index f : found) nearest.compare(f, facet_corners(nodes.x, facets, f).colwise() - at);
        if (nearest.facet() < 0 || !nearest.is_inside() ||
            nearest.distance() < 0.5 * nodes.spacing[facets(0, nearest.facet())])
          continue;
        result.insert(world.point_number(chunk, p));
      }
    }
  }
  return {result.begin(), result.end()};
}

template class BodySurfaces<2>;
template class BodySurfaces<3>;
template Overlap deepest_overlap(const World<2>&, const Scheme<2>&);
template Overlap deepest_overlap(const World<3>&, const Scheme<3>&);
template std::vector<Index> points_in_others(const World<2>&, const BodySurfaces<2>&);
template std::vector<Index> points_in_others(const World<3>&, const BodySurfaces<3>&);

}  // namespace efree::internal
