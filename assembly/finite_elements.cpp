// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/internal/finite_elements.hpp"

#include "efree/assembly/internal/gather.hpp"
#include "efree/core/internal/disjoint_sets.hpp"
#include "efree/core/parallel.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace efree {
namespace {

/// Bits of three (two) coordinates taken in turns.
template <int Dim> std::uint64_t morton_code(const Vec<Dim>& at) {
  constexpr int bits = Dim == 2 ? 31 : 21;
  std::uint64_t code = 0;
  std::array<std::uint64_t, Dim> x;
  for (int d = 0; d < Dim; ++d) x[d] = static_cast<std::uint64_t>(at[d] * ((std::uint64_t{1} << bits) - 1));
  for (int b = bits - 1; b >= 0; --b)
    for (int d = Dim - 1; d >= 0; --d) code = code << 1 | (x[d] >> b & 1);
  return code;
}

/// A product of the gradients g_i, g_j of a cell's hats in the product of those of two of its functions, integrated
/// over the cell.
struct Share {
  std::size_t pair;  ///< of functions, as pair_of
  int i, j;
  double volumes;  ///< of the cell
};
constexpr std::size_t pair_of(std::size_t k, std::size_t l) {
  return l * (l + 1) / 2 + k;  // k <= l
}

/// Gradients on straight cells are those of the hats times the derivatives by barycentric coordinates, which know
/// nothing of the cell: all integrals are sums over pairs of hats.
template <int Dim> class HatShares {
 public:
  explicit HatShares(const FineSpace<Dim>& space) {
    const auto corners = static_cast<Index>(space.cell(0).size());
    const auto& rule = space.cell_rule();
    const std::size_t functions = corners, hats = Dim + 1;
    means_ = Matrix::Zero(Dim + 1, corners);
    std::vector<Matrix> sums(pair_of(0, functions), Matrix::Zero(Dim + 1, Dim + 1));
    for (Index q = 0; q < rule.weights.size(); ++q) {
      Matrix derivatives = Matrix::Zero(Dim + 1, corners);
      const auto at = rule.points.col(q);
      for (int i = 0, edge = Dim + 1; i <= Dim; ++i) {
        derivatives(i, i) = space.degree() == 1 ? 1.0 : 4.0 * at[i] - 1.0;
        if (space.degree() == 2)
          for (int j = i + 1; j <= Dim; ++j, ++edge)
            derivatives(i, edge) = 4.0 * at[j], derivatives(j, edge) = 4.0 * at[i];
      }
      means_ += rule.weights[q] * derivatives;
      for (std::size_t l = 0; l < functions; ++l)
        for (std::size_t k = 0; k <= l; ++k)
          sums[pair_of(k, l)] += rule.weights[q] * derivatives.col(k) * derivatives.col(l).transpose();
    }
    for (std::size_t pair = 0; pair < sums.size(); ++pair)
      for (std::size_t i = 0; i < hats; ++i)
        for (std::size_t j = 0; j < hats; ++j)
          if (std::abs(sums[pair](i, j)) > 1e-12)
            products_.push_back({pair, static_cast<int>(i), static_cast<int>(j), sums[pair](i, j)});
  }
  const std::vector<Share>& products() const { return products_; }
  /// Means of the derivatives: hats by functions.
  const Matrix& means() const { return means_; }

 private:
  std::vector<Share> products_;
  Matrix means_;
};

/// The gradients of a cell's nodes at its quadrature points, with their weights.
template <int Dim> class CellGradients {
 public:
  explicit CellGradients(const FineSpace<Dim>& space) : space_(space) {}
  template <class Visit> void at_points(Index c, const Visit& visit) {
    const auto& rule = space_.cell_rule();
    gradients_.resize(space_.cell(c).size());
    for (Index q = 0; q < rule.weights.size(); ++q) {
      const auto g = space_.gradients(c, rule.points.col(q));
      typename FineSpace<Dim>::CellValues h;
      if (space_.axisymmetric()) h = space_.values(rule.points.col(q)) / space_.position(c, rule.points.col(q))[0];
      for (std::size_t k = 0; k < gradients_.size(); ++k)
        gradients_[k] = {g.col(static_cast<Index>(k)), space_.axisymmetric() ? h[static_cast<Index>(k)] : 0.0};
      visit(space_.position(c, rule.points.col(q)), space_.weight(c, q), gradients_);
    }
  }

 private:
  const FineSpace<Dim>& space_;
  std::vector<NodalGradient<Dim>> gradients_;
};

}  // namespace

template <int Dim> ElementNodes element_nodes(const FineSpace<Dim>& space, const std::vector<TiedFacets>& ties) {
  const Index dofs = space.size();
  internal::DisjointSets places(dofs);
  for (const auto& [first, second] : ties) {
    const std::vector<Index> twins = space.facet(second);
    for (const Index dof : space.facet(first))
      for (const Index twin : twins)
        if (space.points().col(dof) == space.points().col(twin)) places.join(dof, twin);
  }
  const std::vector<Index> first = std::move(places).firsts();
  const Vec<Dim> low = space.points().rowwise().minCoeff();
  const double extent = (space.points().rowwise().maxCoeff() - low).maxCoeff();
  std::vector<std::pair<std::uint64_t, Index>> order;
  for (Index dof = 0; dof < dofs; ++dof)
    if (first[dof] == dof) order.emplace_back(morton_code<Dim>((space.points().col(dof) - low) / extent), dof);
  std::ranges::sort(order);
  ElementNodes nodes{std::vector<Index>(dofs, -1), static_cast<Index>(order.size())};
  for (Index i = 0; i < nodes.count; ++i) nodes.at[order[i].second] = i;
  for (Index dof = 0; dof < dofs; ++dof) nodes.at[dof] = nodes.at[first[dof]];
  return nodes;
}

template <int Dim> BlockMatrix<Dim> element_stiffness(const FineSpace<Dim>& space, const ElementNodes& nodes,
                                                      const Materials<Dim>& materials, bool mean_dilatation) {
  const FineMesh<Dim>& mesh = space.mesh();
  const StiffnessPart part = mean_dilatation ? StiffnessPart::deviatoric : StiffnessPart::all;

  const std::size_t corners = space.cell(0).size();
  std::vector<Index> cell_nodes;
  cell_nodes.reserve(mesh.num_cells() * corners);
  for (Index c = 0; c < mesh.num_cells(); ++c)
    for (const Index dof : space.cell(c)) cell_nodes.push_back(nodes.at[dof]);
  const auto nodes_of = [&](Index c) { return std::span(cell_nodes).subspan(c * corners, corners); };
  const Ragged<NodePlace> cells_at = places_of_nodes(nodes.count, mesh.num_cells(), nodes_of);

  const HatShares<Dim> shares(space);
  constexpr Index chunk_rows = BlockMatrix<Dim>::chunk_rows;
  BlockMatrix<Dim> K;
  K.chunks.resize((nodes.count + chunk_rows - 1) / chunk_rows);
  // Every chunk of rows goes through the cells that touch it once, then gathers its rows from them.
  parallel_chunks(nodes.count, chunk_rows, [&](Index begin, Index end) {
    auto& chunk = K.chunks[begin / chunk_rows];
    std::vector<Index> cells;
    std::vector<Index> entries;  // row by row, cell by cell: where the cell's nodes are in the columns, if at all
    std::vector<std::pair<Index, Index>> around;  // columns of a row, with where in `entries`
    for (Index i = begin; i < end; ++i) {
      around.clear();
      for (const NodePlace& place : cells_at[i]) {
        for (const Index j : nodes_of(place.point)) around.emplace_back(j, entries.size() + around.size());
        cells.push_back(place.point);
      }
      entries.resize(entries.size() + around.size());
      std::ranges::sort(around);
      const std::size_t first = chunk.columns.size();
      for (const auto& [j, at] : around) {
        if (!BlockMatrix<Dim>::stores(i, j)) {
          entries[at] = -1;
          continue;
        }
        if (chunk.columns.size() == first || chunk.columns.back() != j) chunk.columns.push_back(j);
        entries[at] = static_cast<Index>(chunk.columns.size()) - 1;
      }
      chunk.close_row(i);
    }
    chunk.close();
    chunk.blocks.assign(chunk.columns.size(), Mat<Dim>::Zero());
    std::ranges::sort(cells);
    cells.erase(std::unique(cells.begin(), cells.end()), cells.end());

    CellGradients<Dim> gradients(space);   // where those of the hats do not do
    Points<Dim> dilatation(Dim, corners);  // integral over a cell, by node
    const std::size_t pairs = pair_of(0, corners);
    std::vector<Mat<Dim>> stiffness(cells.size() * pairs, Mat<Dim>::Zero());  // of nodes k <= l of each cell
    for (std::size_t n = 0; n < cells.size(); ++n) {
      const Index c = cells[n];
      const Index region = mesh.region(c);
      double volume = 0.0, kappa = 0.0;  // kappa: of the cell, integrated
      if (space.axisymmetric() || !materials.is_uniform(region)) {
        dilatation.setZero();
        gradients.at_points(c, [&](const Vec<Dim>& x, double weight, const std::vector<NodalGradient<Dim>>& G) {
          const auto [tangent, stiff_by_dilatation] = materials.tangent_and_kappa(region, x, part);
          const Tangent<Dim> A = weight * tangent;
          for (std::size_t l = 0; l < corners; ++l) {
            const GradientBlock<Dim> stress = G[l].stress(A);
            for (std::size_t k = 0; k <= l; ++k) stiffness[n * pairs + pair_of(k, l)] += G[k].forces(stress);
          }
          if (!mean_dilatation) return;
          volume += weight;
          kappa += weight * stiff_by_dilatation;
          for (std::size_t k = 0; k < corners; ++k) dilatation.col(k) += weight * G[k].dilatation();
        });
      } else {
        volume = mesh.volume(c);
        const auto hats = mesh.hat_gradients(c);
        const auto [tangent, stiff_by_dilatation] = materials.tangent_and_kappa(region, mesh.vertex(0), part);
        const Tangent<Dim> A = volume * tangent;
        std::array<Mat<Dim>, (Dim + 1) * (Dim + 1)> of_hats;
        for (int j = 0; j <= Dim; ++j) {
          const GradientBlock<Dim> stress = NodalGradient<Dim>{hats.col(j)}.stress(A);
          for (int i = 0; i <= Dim; ++i) of_hats[i * (Dim + 1) + j] = NodalGradient<Dim>{hats.col(i)}.forces(stress);
        }
        for (const Share& share : shares.products())
          stiffness[n * pairs + share.pair] += share.volumes * of_hats[share.i * (Dim + 1) + share.j];
        if (mean_dilatation) {
          kappa = volume * stiff_by_dilatation;
          dilatation = volume * hats * shares.means();
        }
      }
      if (!mean_dilatation) continue;
      const double stiff = kappa / (volume * volume);
      for (std::size_t l = 0; l < corners; ++l)
        for (std::size_t k = 0; k <= l; ++k)
          stiffness[n * pairs + pair_of(k, l)] += (stiff * dilatation.col(k)) * dilatation.col(l).transpose();
    }

    const Index* entry = entries.data();
    for (Index i = begin; i < end; ++i)
      for (const NodePlace& place : cells_at[i]) {
        const auto n = std::ranges::lower_bound(cells, place.point) - cells.begin();
        const Mat<Dim>* of_cell = stiffness.data() + n * pairs;
        const auto k = static_cast<std::size_t>(place.position);
        for (std::size_t l = 0; l < corners; ++l) {
          const Index at = *entry++;
          if (at < 0) continue;
          Mat<Dim>& block = chunk.blocks[at];
          if (k <= l)
            block += of_cell[pair_of(k, l)];
          else
            block += of_cell[pair_of(l, k)].transpose();
        }
      }
  });
  return K;
}

template ElementNodes element_nodes<2>(const FineSpace<2>&, const std::vector<TiedFacets>&);
template ElementNodes element_nodes<3>(const FineSpace<3>&, const std::vector<TiedFacets>&);
template BlockMatrix<2> element_stiffness<2>(const FineSpace<2>&, const ElementNodes&, const Materials<2>&, bool);
template BlockMatrix<3> element_stiffness<3>(const FineSpace<3>&, const ElementNodes&, const Materials<3>&, bool);

}  // namespace efree
