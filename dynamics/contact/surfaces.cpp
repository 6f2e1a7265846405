// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/contact/internal/surfaces.hpp"

#include <map>
#include <set>

namespace efree::internal {
namespace {

/// How far nodes may move before near facets are found again, over the spacing.
constexpr double search_skin = 0.25;
/// Cosine of the angle between the normals of a node and a facet at which they do not face each other; and at which
/// they do not before near facets are found again.
constexpr double not_facing = -0.1, never_facing = 0.5;
/// How far facets go on beyond their edges, over their size, for nodes no further from their plane than this over the
/// spacing, or than they come in a step: corners that lie on each other, or meet.
constexpr double beyond_edge = 0.05, beyond_depth = 0.05;

/// Largest spacing of the nodes of facets.
template <int Dim> double widest_spacing(const Nodes<Dim>& nodes, const Facets<Dim>& facets) {
  return nodes.spacing(facets.reshaped()).maxCoeff();
}

/// Takes away what two bodies have in common.
template <class Surface> void drop_tied_facets(std::vector<Surface>& surfaces) {
  const auto key = [](const auto& facet) {
    std::set<Index> nodes(facet.begin(), facet.end());
    return nodes;
  };
  std::map<std::set<Index>, int> count;
  for (const Surface& surface : surfaces)
    for (Index f = 0; f < surface.facets.cols(); ++f) ++count[key(surface.facets.col(f))];
  for (Surface& surface : surfaces) {
    std::vector<Index> kept;
    for (Index f = 0; f < surface.facets.cols(); ++f)
      if (count[key(surface.facets.col(f))] == 1) kept.push_back(f);
    surface.facets = surface.facets(Eigen::all, kept).eval();
  }
}

}  // namespace

template <int Dim> void BodySurfaces<Dim>::find(const World<Dim>& world, const Scheme<Dim>& scheme) {
  surfaces_.assign(world.bodies.size(), {});
  for (Index b = 0; b < world.num_bodies(); ++b) surfaces_[b].facets = scheme.surface(world, b);
  if (world.options.tied) drop_tied_facets(surfaces_);
  for (Index b = 0; b < world.num_bodies(); ++b) {
    Surface& surface = surfaces_[b];
    std::set<Index> nodes;
    for (const Index a : surface.facets.reshaped())
      if (world.nodes.body[a] == b) nodes.insert(a);  // tied ones are with the other body
    surface.nodes.assign(nodes.begin(), nodes.end());
    std::vector<std::vector<Index>> around(nodes.size());
    for (Index f = 0; f < surface.facets.cols(); ++f)
      for (const Index a : surface.facets.col(f))
        if (world.nodes.body[a] == b)
          around[std::ranges::lower_bound(surface.nodes, a) - surface.nodes.begin()].push_back(f);
    for (const std::vector<Index>& facets : around) {
      surface.around.items.insert(surface.around.items.end(), facets.begin(), facets.end());
      surface.around.close_row();
    }
  }
  near_.clear();
  x_near_.resize(Dim, 0);
  surface_changes_ = world.surface_changes;
}

template <int Dim> void BodySurfaces<Dim>::find_normals(const World<Dim>& world) {
  for (Surface& surface : surfaces_) {
    surface.normals.resize(Dim, surface.facets.cols());
    for (Index f = 0; f < surface.facets.cols(); ++f)
      surface.normals.col(f) = area_of<Dim>(facet_corners(world.nodes.x, surface.facets, f)).normalized();
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
    const auto body = static_cast<Index>(b);
    for (std::size_t other = 0; other < surfaces_.size(); ++other) {
      if (other == b && !world.has_self_contact(body)) continue;
      const std::vector<Index>& of_other = surfaces_[other].nodes;
      std::vector<std::vector<Index>> found(of_other.size());
      parallel_chunks(std::ssize(of_other), 64, [&](Index begin, Index end) {
        for (Index k = begin; k < end; ++k) {
          const Index a = of_other[k];
          const double skin = search_skin * (widest + nodes.spacing[a]);
          tree.centres.within(nodes.x.col(a), tree.reach + skin + largest_depth * widest, found[k]);
          if (other == b)
            keep_facing(world, body, k, found[k]);
          else if (world.options.tied)
            std::erase_if(found[k], [&](Index f) { return (facets.col(f).array() == a).any(); });
        }
      });
      for (std::size_t k = 0; k < found.size(); ++k)
        if (!found[k].empty()) near_.push_back({of_other[k], body, k, std::move(found[k])});
    }
  }
}

/// Of these facets of the node's own body, those that the node may face before near facets are found again.
template <int Dim> void BodySurfaces<Dim>::keep_facing(const World<Dim>& world, Index body, std::size_t number,
                                                       std::vector<Index>& facets) const {
  const Points<Dim>& x = world.nodes.x;
  const Surface& surface = surfaces_[body];
  const Index node = surface.nodes[number];
  const double deepest = -(largest_own_depth + 2.0 * search_skin) * world.nodes.spacing[node];
  std::erase_if(facets, [&](Index f) {
    const auto corners = surface.facets.col(f);
    const Vec<Dim> normal = surface.normals.col(f);
    return (corners.array() == node).any() || !is_opposed(surface, number, normal, never_facing) ||
           normal.dot(x.col(node) - x.col(corners[0])) < deepest;
  });
}

template <int Dim> bool BodySurfaces<Dim>::is_opposed(const Surface& of_node, std::size_t number,
                                                      const Vec<Dim>& normal, double cosine) const {
  return std::ranges::any_of(of_node.around[static_cast<Index>(number)],
                             [&](Index f) { return of_node.normals.col(f).dot(normal) < cosine; });
}

template <int Dim> FacingFacet<Dim> BodySurfaces<Dim>::facing(const World<Dim>& world, const Near& near, double dt,
                                                              const std::optional<double>& last_gap) const {
  const Nodes<Dim>& nodes = world.nodes;
  const double spacing = nodes.spacing[near.node];
  const bool is_own = nodes.body[near.node] == near.body;
  const double own_depth = last_gap ? std::max(0.0, -*last_gap) + largest_own_depth * spacing : closed_gap * spacing;
  const Facets<Dim>& facets = surfaces_[near.body].facets;
  const Surface& of_node = surfaces_[nodes.body[near.node]];
  FacingFacet<Dim> result;
  for (const Index f : near.facets) {
    const Mat<Dim> corner = facet_corners(nodes.x, facets, f).colwise() - Vec<Dim>(nodes.x.col(near.node));
    if (!(area_of<Dim>(corner).norm() > 1e-9 * std::pow(spacing, Dim - 1))) continue;
    const Vec<Dim> normal = surfaces_[near.body].normals.col(f);
    const double gap = -normal.dot(corner.col(0));
    if (!(std::abs(gap) < std::abs(result.gap)) || !is_opposed(of_node, near.number, normal, not_facing)) continue;
    const Vec<Dim> weights = weights_in<Dim>(corner);
    const Vec<Dim> relative = nodes.v.col(near.node) - nodes.v(Eigen::all, facets.col(f)) * weights;
    const double reached = beyond_depth * spacing + dt * std::abs(normal.dot(relative));
    if (weights.minCoeff() < (std::abs(gap) < reached ? -beyond_edge : 0.0)) continue;
    if (gap > (is_own ? -own_depth : -largest_depth * nodes.spacing[facets(0, f)]))
      result = {.facet = f, .weights = weights, .gap = gap, .normal = normal};
  }
  return result;
}

template <int Dim> Overlap deepest_overlap(const World<Dim>& world, const Scheme<Dim>& scheme) {
  BodySurfaces<Dim> surfaces;
  surfaces.update(world, scheme);
  Overlap result;
  for (const auto& near : surfaces.near()) {
    const double gap = surfaces.facing(world, near, 0.0).gap;
    if (world.nodes.body[near.node] != near.body && gap < -result.depth)
      result = {.node = near.node, .body = near.body, .depth = -gap};
  }
  return result;
}

template <int Dim> void BodySurfaces<Dim>::update(const World<Dim>& world, const Scheme<Dim>& scheme) {
  if (!is_current(world)) find(world, scheme);
  const Points<Dim>& x = world.nodes.x;
  const Vector& spacing = world.nodes.spacing;
  bool search = x_near_.size() == 0;
  for (Index a = 0; a < x.cols() && !search; ++a)
    search = (x.col(a) - x_near_.col(a)).squaredNorm() > search_skin * search_skin * spacing[a] * spacing[a];
  if (search || !near_.empty()) find_normals(world);
  if (search) find_near(world);
}

template <int Dim> std::vector<Index> points_in_others(const World<Dim>& world, const BodySurfaces<Dim>& surfaces) {
  const Nodes<Dim>& nodes = world.nodes;
  std::set<Index> result;
  std::vector<char> is_open(surfaces.surfaces().size(), 0);
  for (Index a = 0; a < nodes.size(); ++a)
    if (nodes.follows(a)) is_open[nodes.body[a]] = is_open[nodes.body[nodes.master[a]]] = 1;
  for (Index b = 0; b < static_cast<Index>(surfaces.surfaces().size()); ++b) {
    const Facets<Dim>& facets = surfaces.surfaces()[b].facets;
    const auto is_broken = [&](const auto& chunk) {
      return chunk.body == b && (chunk.matter.damage.array() >= 1.0).any();
    };
    if (facets.cols() == 0 || is_open[static_cast<std::size_t>(b)] != 0 || std::ranges::any_of(world.chunks, is_broken))
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
