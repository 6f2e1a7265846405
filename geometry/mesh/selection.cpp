// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/selection.hpp"

#include "efree/core/internal/disjoint_sets.hpp"
#include "efree/geometry/mesh/internal/select_facets.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>

namespace efree {
namespace {

template <int Dim> double squared_distance(const FineMesh<Dim>& mesh, Index f, const Vec<Dim>& x) {
  const Vec<Dim> a = mesh.vertex(mesh.facets()(0, f));
  const auto to_segment = [&](const Vec<Dim>& from, const Vec<Dim>& to) {
    const Vec<Dim> along = to - from;
    const double t = std::clamp((x - from).dot(along) / along.squaredNorm(), 0.0, 1.0);
    return (x - from - t * along).squaredNorm();
  };
  if constexpr (Dim == 2) {
    return to_segment(a, mesh.vertex(mesh.facets()(1, f)));
  } else {
    const Vec<3> b = mesh.vertex(mesh.facets()(1, f)), c = mesh.vertex(mesh.facets()(2, f));
    const Vec<3> n = mesh.facet_normal(f);
    const auto is_left = [&](const Vec<3>& from, const Vec<3>& to) { return n.dot((to - from).cross(x - from)) >= 0; };
    if (is_left(a, b) && is_left(b, c) && is_left(c, a)) return std::pow(n.dot(x - a), 2);
    return std::min({to_segment(a, b), to_segment(b, c), to_segment(c, a)});
  }
}

/// Facets that share an edge (a vertex in 2D). Vertices that ties put into one place count as one.
template <int Dim> class Neighbours {
 public:
  Neighbours(const FineMesh<Dim>& mesh, const std::vector<TiedFacets>& ties) : mesh_(mesh) {
    internal::DisjointSets places(mesh.num_vertices());
    for (const auto& [first, second] : ties)
      for (const Index v : mesh.facets().col(first))
        for (const Index w : mesh.facets().col(second))
          if (mesh.vertex(v) == mesh.vertex(w)) places.join(v, w);
    place_ = std::move(places).firsts();
    for (Index v = 0; v < mesh.num_vertices(); ++v)
      if (place_[v] != v) copies_.emplace_back(place_[v], v);
    std::ranges::sort(copies_);
  }

  /// Calls visit(g) for every neighbour g of f.
  template <class Visit> void visit(Index f, const Visit& visit) const {
    for (const Index v : mesh_.facets().col(f)) {
      const Index place = place_[v];
      visit_at(f, place, visit);
      for (auto copy = std::ranges::lower_bound(copies_, std::pair(place, Index(0)));
           copy != copies_.end() && copy->first == place; ++copy)
        visit_at(f, copy->second, visit);
    }
  }

 private:
  template <class Visit> void visit_at(Index f, Index v, const Visit& visit) const {
    for (const Index g : mesh_.facets_of(v)) {
      int shared = 0;
      for (const Index a : mesh_.facets().col(f))
        for (const Index b : mesh_.facets().col(g)) shared += place_[a] == place_[b];
      if (g != f && shared == Dim - 1) visit(g);
    }
  }

  const FineMesh<Dim>& mesh_;
  std::vector<Index> place_;                       ///< by vertex: the first of those in its place
  std::vector<std::pair<Index, Index>> copies_{};  ///< (first, other) of those, ascending
};

/// The boundary of a mesh without the facets between regions, which are none.
template <int Dim> class MeshBoundary {
 public:
  MeshBoundary(const FineMesh<Dim>& mesh, const std::vector<TiedFacets>& ties)
      : mesh_(mesh), ties_(ties), tied_(mesh.num_facets(), 0) {
    for (const auto& [first, second] : ties) tied_[first] = tied_[second] = 1;
  }

  Index size() const { return mesh_.num_facets(); }
  bool can_be_selected(Index f) const { return !tied_[f]; }
  template <class Predicate> bool all_corners(Index f, const Predicate& wanted) const {
    for (int k = 0; k < Dim; ++k)
      if (!wanted(mesh_.vertex(mesh_.facets()(k, f)))) return false;
    return true;
  }
  Vec<Dim> normal(Index f) const { return mesh_.facet_normal(f); }
  double squared_distance(Index f, const Vec<Dim>& x) const { return efree::squared_distance<Dim>(mesh_, f, x); }
  template <class Visit> void visit_neighbours(Index f, const Visit& visit) const {
    if (!neighbours_) neighbours_.emplace(mesh_, ties_);
    neighbours_->visit(f, [&](Index g) { visit(g, [&] { return normal(f).dot(normal(g)); }); });
  }
  double diagonal() const {
    return (mesh_.vertices().rowwise().maxCoeff() - mesh_.vertices().rowwise().minCoeff()).norm();
  }

 private:
  const FineMesh<Dim>& mesh_;
  const std::vector<TiedFacets>& ties_;
  std::vector<char> tied_;
  mutable std::optional<Neighbours<Dim>> neighbours_{};  ///< found when they are asked for
};

}  // namespace

template <int Dim>
std::vector<Index> select_facets(const FineMesh<Dim>& mesh, const Selection<Dim>& selection, std::string_view open) {
  const std::vector<TiedFacets> ties = tied_facets(mesh, open);
  const MeshBoundary<Dim> boundary(mesh, ties);
  return std::visit(internal::FacetSelector<Dim, MeshBoundary<Dim>>(boundary), selection);
}

template std::vector<Index> select_facets<2>(const FineMesh<2>&, const Selection<2>&, std::string_view);
template std::vector<Index> select_facets<3>(const FineMesh<3>&, const Selection<3>&, std::string_view);

}  // namespace efree
