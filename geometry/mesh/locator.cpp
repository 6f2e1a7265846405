// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/locator.hpp"

#include "efree/core/error.hpp"
#include "efree/geometry/mesh/internal/box_tree.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <ranges>

namespace efree {
namespace {

constexpr double barycentric_tolerance = 1e-9;

/// Of these cells, ascending, the first that holds x, or that which x is least outside of.
template <int Dim, class Candidates>
Location<Dim> best_of(const FineMesh<Dim>& mesh, const Candidates& candidates, const Vec<Dim>& x) {
  using Barycentric = Eigen::Matrix<double, Dim + 1, 1>;
  Location<Dim> best{-1, Barycentric::Constant(-1e300)};
  for (const Index c : candidates) {
    Barycentric at = mesh.hat_gradients(c).transpose() * (x - mesh.centroid(c));
    at.array() += 1.0 / (Dim + 1);
    if (at.minCoeff() > best.at.minCoeff()) best = {c, at};
    if (best.at.minCoeff() >= 0.0) break;
  }
  return best;
}

/// The point of a boundary facet nearest to x.
template <int Dim> Vec<Dim> nearest_on(const FineMesh<Dim>& mesh, Index f, const Vec<Dim>& x) {
  const auto corners = mesh.facets().col(f);
  const auto on_edge = [&](Index from, Index to) -> Vec<Dim> {
    const Vec<Dim> a = mesh.vertex(from), edge = mesh.vertex(to) - a;
    return a + std::clamp((x - a).dot(edge) / edge.squaredNorm(), 0.0, 1.0) * edge;
  };
  if constexpr (Dim == 2) {
    return on_edge(corners[0], corners[1]);
  } else {
    const Vec<3> normal = mesh.facet_normal(f), a = mesh.vertex(corners[0]);
    const Vec<3> foot = x - (x - a).dot(normal) * normal;
    bool inside = true;
    Vec<3> best = a;
    for (int i = 0; i < 3; ++i) {
      const Index from = corners[i], to = corners[(i + 1) % 3];
      inside = inside && normal.dot((mesh.vertex(to) - mesh.vertex(from)).cross(foot - mesh.vertex(from))) >= 0.0;
      if (const Vec<3> p = on_edge(from, to); (p - x).squaredNorm() < (best - x).squaredNorm()) best = p;
    }
    return inside ? foot : best;
  }
}

/// Whether all of another facet lies behind this one, seen from outside.
template <int Dim> bool is_behind(const FineMesh<Dim>& mesh, Index f, Index other) {
  const Vec<Dim> normal = mesh.facet_normal(f), on_it = mesh.vertex(mesh.facets()(0, f));
  double ahead = 0.0;
  for (const Index v : mesh.facets().col(other)) ahead = std::max(ahead, normal.dot(mesh.vertex(v) - on_it));
  return ahead <= barycentric_tolerance * mesh.size();
}

}  // namespace

template <int Dim> struct Locator<Dim>::Tree {
  internal::BoxTree<Dim> boxes;

  explicit Tree(const FineMesh<Dim>& mesh) : boxes(entries(mesh)) {}
  static std::vector<internal::BoxEntry<Dim>> entries(const FineMesh<Dim>& mesh) {
    std::vector<internal::BoxEntry<Dim>> out;
    out.reserve(mesh.num_cells());
    for (Index c = 0; c < mesh.num_cells(); ++c) {
      const Eigen::Matrix<double, Dim, Dim + 1> corners = mesh.vertices()(Eigen::all, mesh.cells().col(c));
      const Vec<Dim> low = corners.rowwise().minCoeff(), high = corners.rowwise().maxCoeff();
      // Wider than what the tolerance lets in, and than rounding in flat cells.
      const double margin = 1000.0 * barycentric_tolerance * (high - low).maxCoeff();
      out.emplace_back(internal::box_between<Dim>(low.array() - margin, high.array() + margin), c);
    }
    return out;
  }
  /// Cells whose boxes hold x, ascending.
  std::vector<Index> around(const Vec<Dim>& x) const {
    std::vector<Index> cells;
    for (auto it = boxes.qbegin(boost::geometry::index::intersects(internal::box_corner<Dim>(x))); it != boxes.qend();
         ++it)
      cells.push_back(it->second);
    std::ranges::sort(cells);
    return cells;
  }
};

template <int Dim> Locator<Dim>::Locator(const FineMesh<Dim>& mesh, std::size_t points) : mesh_(&mesh) {
  constexpr std::size_t few = 16;  // measured: making the tree takes as long as walking all cells that often
  if (points >= few) tree_ = std::make_unique<const Tree>(mesh);
}
template <int Dim> Locator<Dim>::~Locator() = default;
template <int Dim> Locator<Dim>::Locator(Locator&&) noexcept = default;

/// Arrows of a circle over chords that turn by an angle: their length times the angle over 8; over triangles a little
/// more.
template <int Dim> std::optional<Location<Dim>> Locator<Dim>::beside_boundary(const Vec<Dim>& x) const {
  constexpr double share = Dim == 2 ? 0.15 : 0.3, sharpest = std::numbers::pi / 6.0;
  Index nearest = -1;
  Vec<Dim> foot;
  double least = std::numeric_limits<double>::infinity();
  for (Index f = 0; f < mesh_->num_facets(); ++f) {
    const Vec<Dim> p = nearest_on(*mesh_, f, x);
    if (const double distance = (p - x).norm(); distance < least) {
      least = distance;
      nearest = f;
      foot = p;
    }
  }
  if (nearest < 0) return {};  // so far away that the distance is no number
  double longest = 0.0, turn = 0.0;
  const auto corners = mesh_->facets().col(nearest);
  for (int i = 0; i < Dim; ++i) {
    longest = std::max(longest, (mesh_->vertex(corners[i]) - mesh_->vertex(corners[(i + 1) % Dim])).norm());
    for (const Index other : mesh_->facets_of(corners[i])) {
      if (!is_behind(*mesh_, nearest, other)) continue;  // chords of a hole leave nothing of the body out
      const double angle =
          std::acos(std::clamp(mesh_->facet_normal(nearest).dot(mesh_->facet_normal(other)), -1.0, 1.0));
      if (angle < sharpest) turn = std::max(turn, angle);
    }
  }
  // As much as OnPlane allows by default: STL files keep seven digits.
  const double rounded =
      1e-6 * (mesh_->vertices().rowwise().maxCoeff() - mesh_->vertices().rowwise().minCoeff()).norm();
  if (least > std::max(share * longest * turn, rounded)) return {};
  const std::array cell{mesh_->facet_cell(nearest)};
  Location<Dim> there = best_of(*mesh_, cell, foot);
  there.at = there.at.cwiseMax(0.0);
  there.at /= there.at.sum();
  return there;
}

template <int Dim> std::optional<Location<Dim>> Locator<Dim>::find(const Vec<Dim>& x) const {
  const Location<Dim> best =
      tree_ ? best_of(*mesh_, tree_->around(x), x) : best_of(*mesh_, std::views::iota(Index(0), mesh_->num_cells()), x);
  return best.at.minCoeff() >= -barycentric_tolerance ? std::optional(best) : std::nullopt;
}

template <int Dim> Location<Dim> Locator<Dim>::operator()(const Vec<Dim>& x) const {
  if (const auto found = find(x)) return *found;
  if (const auto beside = beside_boundary(x)) return *beside;
  Index nearest = 0;
  (mesh_->vertices().colwise() - x).colwise().stableNorm().minCoeff(&nearest);
  throw InputError(fmt::format("({:.6g}) lies outside the body; the nearest fine vertex is ({:.6g})",
                               fmt::join(x, ", "), fmt::join(mesh_->vertex(nearest), ", ")));
}

template class Locator<2>;
template class Locator<3>;

}  // namespace efree
