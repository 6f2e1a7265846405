// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/locator.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <boost/geometry.hpp>
#include <boost/geometry/index/rtree.hpp>
#include <ranges>

namespace efree {
namespace {

namespace bg = boost::geometry;

constexpr double tolerance = 1e-9;

template <int Dim> using Corner = bg::model::point<double, Dim, bg::cs::cartesian>;
template <int Dim> using Box = bg::model::box<Corner<Dim>>;

template <int Dim> Corner<Dim> corner(const Vec<Dim>& x) {
  if constexpr (Dim == 2)
    return {x[0], x[1]};
  else
    return {x[0], x[1], x[2]};
}

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

}  // namespace

template <int Dim> struct Locator<Dim>::Tree {
  using Entry = std::pair<Box<Dim>, Index>;
  bg::index::rtree<Entry, bg::index::linear<16>> boxes;  // packed, as it is made of all at once

  explicit Tree(const FineMesh<Dim>& mesh) : boxes(entries(mesh)) {}
  static std::vector<Entry> entries(const FineMesh<Dim>& mesh) {
    std::vector<Entry> out;
    out.reserve(mesh.num_cells());
    for (Index c = 0; c < mesh.num_cells(); ++c) {
      const Eigen::Matrix<double, Dim, Dim + 1> corners = mesh.vertices()(Eigen::all, mesh.cells().col(c));
      const Vec<Dim> low = corners.rowwise().minCoeff(), high = corners.rowwise().maxCoeff();
      // Wider than what the tolerance lets in, and than rounding in flat cells.
      const double margin = 1000.0 * tolerance * (high - low).maxCoeff();
      out.emplace_back(Box<Dim>(corner<Dim>(low.array() - margin), corner<Dim>(high.array() + margin)), c);
    }
    return out;
  }
  /// Cells whose boxes hold x, ascending.
  std::vector<Index> around(const Vec<Dim>& x) const {
    std::vector<Index> cells;
    for (auto it = boxes.qbegin(bg::index::intersects(corner<Dim>(x))); it != boxes.qend(); ++it)
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

template <int Dim> Location<Dim> Locator<Dim>::operator()(const Vec<Dim>& x) const {
  const Location<Dim> best =
      tree_ ? best_of(*mesh_, tree_->around(x), x) : best_of(*mesh_, std::views::iota(Index(0), mesh_->num_cells()), x);
  if (best.at.minCoeff() >= -tolerance) return best;
  Index nearest = 0;
  (mesh_->vertices().colwise() - x).colwise().squaredNorm().minCoeff(&nearest);
  throw InputError(fmt::format("({:.6g}) lies outside the body; the nearest fine vertex is ({:.6g})",
                               fmt::join(x, ", "), fmt::join(mesh_->vertex(nearest), ", ")));
}

template class Locator<2>;
template class Locator<3>;

}  // namespace efree
