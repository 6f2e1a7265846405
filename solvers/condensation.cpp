// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/internal/condensation.hpp"

#include "efree/core/internal/accumulator.hpp"
#include "efree/core/parallel.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <numeric>

namespace efree {
namespace {

/// Longest edge over height from which on a cell is flat.
constexpr double flat = 20.0;
/// Heights that are small: up to this times the smallest.
constexpr double alike = 3.0;
/// Nodes of a group, at most.
constexpr std::size_t largest_group = 24;

/// Groups that grow by nodes; those that would be coupled become one.
template <int Dim> class Groups {
 public:
  explicit Groups(const BlockMatrix<Dim>& K) : K_(K), of_node_(K.size(), -1) {}

  bool has(Index node) const { return of_node_[node] >= 0; }
  /// The nodes in a group, or nothing if it would be too large.
  bool add(const std::vector<Index>& nodes) {
    std::vector<Index> joined;
    for (const Index node : nodes)
      for (Index e = K_.offsets[node]; e < K_.offsets[node + 1]; ++e)
        if (const Index group = of_node_[K_.columns[e]]; group >= 0) joined.push_back(group);
    std::ranges::sort(joined);
    joined.erase(std::unique(joined.begin(), joined.end()), joined.end());
    std::vector<Index> all;
    for (const Index node : nodes)
      if (!has(node)) all.push_back(node);
    for (const Index group : joined) all.insert(all.end(), members_[group].begin(), members_[group].end());
    if (all.size() > largest_group) return false;
    for (const Index group : joined) members_[group].clear();
    for (const Index node : all) of_node_[node] = static_cast<Index>(members_.size());
    members_.push_back(std::move(all));
    return true;
  }
  std::vector<std::vector<Index>> take() && {
    std::erase_if(members_, [](const auto& group) { return group.empty(); });
    for (auto& group : members_) std::ranges::sort(group);
    return std::move(members_);
  }

 private:
  const BlockMatrix<Dim>& K_;
  std::vector<Index> of_node_;
  std::vector<std::vector<Index>> members_;
};

}  // namespace

template <int Dim> std::vector<std::vector<Index>> flat_groups(const FineSpace<Dim>& space, const ElementNodes& nodes,
                                                               const BlockMatrix<Dim>& K,
                                                               const std::function<bool(Index)>& is_free) {
  const FineMesh<Dim>& mesh = space.mesh();
  std::vector<std::pair<double, Index>> cells;  // flattest first
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    double longest = 0.0;
    for (int i = 0; i <= Dim; ++i)
      for (int j = 0; j < i; ++j)
        longest = std::max(longest, (mesh.vertex(mesh.cells()(i, c)) - mesh.vertex(mesh.cells()(j, c))).norm());
    const double flatness = longest * mesh.hat_gradients(c).colwise().norm().maxCoeff();
    if (flatness > flat) cells.emplace_back(-flatness, c);
  }
  std::ranges::sort(cells);

  Groups<Dim> groups(K);
  for (const auto& [flatness, c] : cells) {
    const auto dofs = space.cell(c);
    const Eigen::Matrix<double, Dim + 1, 1> steep = mesh.hat_gradients(c).colwise().norm().transpose();
    // What is in a group already comes first: then it only has to grow.
    std::vector<std::pair<double, int>> candidates;
    for (int i = 0; i <= Dim; ++i)
      if (const Index node = nodes.at[dofs[i]]; is_free(node) && alike * steep[i] >= steep.maxCoeff())
        candidates.emplace_back(groups.has(node) ? -2.0 * steep.maxCoeff() : -steep[i], i);
    std::ranges::sort(candidates);
    for (const auto& [order, corner] : candidates) {
      std::vector<Index> group{nodes.at[dofs[corner]]};
      if (space.degree() == 2)
        for (int i = 0, edge = Dim + 1; i <= Dim; ++i)
          for (int j = i + 1; j <= Dim; ++j, ++edge)
            if (const Index node = nodes.at[dofs[edge]]; (i == corner || j == corner) && is_free(node))
              group.push_back(node);
      if (groups.add(group)) break;
    }
  }
  return std::move(groups).take();
}

template <int Dim>
Condensation<Dim>::Condensation(const BlockMatrix<Dim>& K, const std::vector<std::vector<Index>>& groups)
    : groups_(groups.size()) {
  std::vector<Index> number(K.size(), 0);
  for (const auto& group : groups)
    for (const Index node : group) number[node] = -1;
  for (Index node = 0; node < K.size(); ++node)
    if (number[node] == 0) {
      number[node] = static_cast<Index>(kept_.size());
      kept_.push_back(node);
    }
  const Index n = static_cast<Index>(kept_.size());

  std::vector<Matrix> couplings(groups.size());
  parallel_for(static_cast<Index>(groups.size()), [&](Index g) {
    Group& group = groups_[g];
    group.inner = groups[g];
    for (const Index node : group.inner)
      for (Index e = K.offsets[node]; e < K.offsets[node + 1]; ++e)
        if (const Index other = number[K.columns[e]]; other >= 0) group.outer.push_back(other);
    std::ranges::sort(group.outer);
    group.outer.erase(std::unique(group.outer.begin(), group.outer.end()), group.outer.end());
    const Index inner = static_cast<Index>(group.inner.size()), outer = static_cast<Index>(group.outer.size());
    Matrix own = Matrix::Zero(Dim * inner, Dim * inner);
    couplings[g] = Matrix::Zero(Dim * inner, Dim * outer);
    for (Index i = 0; i < inner; ++i)
      for (Index e = K.offsets[group.inner[i]]; e < K.offsets[group.inner[i] + 1]; ++e) {
        const Index other = number[K.columns[e]];
        const auto& among = other >= 0 ? group.outer : group.inner;
        const auto j = std::ranges::lower_bound(among, other >= 0 ? other : K.columns[e]) - among.begin();
        (other >= 0 ? couplings[g] : own).template block<Dim, Dim>(Dim * i, Dim * j) = K.blocks[e];
      }
    const Eigen::LLT<Matrix> cholesky(own);
    group.inverse = cholesky.solve(Matrix::Identity(Dim * inner, Dim * inner));
    group.follow = cholesky.solve(couplings[g]);
  });

  places_.offsets.assign(n + 1, 0);
  for (const Group& group : groups_)
    for (const Index node : group.outer) ++places_.offsets[node + 1];
  std::partial_sum(places_.offsets.begin(), places_.offsets.end(), places_.offsets.begin());
  places_.items.resize(places_.offsets.back());
  std::vector<Index> cursor(places_.offsets.begin(), places_.offsets.end() - 1);
  for (std::size_t g = 0; g < groups_.size(); ++g)
    for (std::size_t k = 0; k < groups_[g].outer.size(); ++k)
      places_.items[cursor[groups_[g].outer[k]]++] = {static_cast<Index>(g), static_cast<Index>(k)};

  struct Part {
    std::vector<Index> counts, columns;
    std::vector<Mat<Dim>> blocks;
  };
  constexpr Index chunk = 4096;
  std::vector<Part> parts((n + chunk - 1) / chunk);
  parallel_chunks(n, chunk, [&](Index begin, Index end) {
    Part& part = parts[begin / chunk];
    Accumulator<Mat<Dim>> row(n);
    for (Index i = begin; i < end; ++i) {
      row.clear();
      for (Index e = K.offsets[kept_[i]]; e < K.offsets[kept_[i] + 1]; ++e)
        if (const Index j = number[K.columns[e]]; j >= 0) row[j] += K.blocks[e];
      for (const Place& place : places_[i]) {
        const Group& group = groups_[place.group];
        const auto coupling = couplings[place.group].template middleCols<Dim>(Dim * place.position);
        for (std::size_t k = 0; k < group.outer.size(); ++k)
          row[group.outer[k]] -= coupling.transpose() * group.follow.template middleCols<Dim>(Dim * k);
      }
      const auto& touched = row.sorted();
      part.counts.push_back(static_cast<Index>(touched.size()));
      for (const Index j : touched) part.columns.push_back(j), part.blocks.push_back(row[j]);
    }
  });
  for (const Part& part : parts) {
    std::size_t first = matrix_.columns.size();
    matrix_.columns.insert(matrix_.columns.end(), part.columns.begin(), part.columns.end());
    matrix_.blocks.insert(matrix_.blocks.end(), part.blocks.begin(), part.blocks.end());
    for (const Index count : part.counts) {
      const auto row = matrix_.columns.begin() + static_cast<std::ptrdiff_t>(first);
      const auto i = static_cast<Index>(matrix_.diagonal.size());
      matrix_.diagonal.push_back(static_cast<Index>(std::lower_bound(row, row + count, i) - matrix_.columns.begin()));
      matrix_.offsets.push_back(static_cast<Index>(first += count));
    }
  }
}

template <int Dim> Points<Dim> Condensation<Dim>::restrict(const Points<Dim>& r) const {
  Points<Dim> result(Dim, kept_.size());
  parallel_for(static_cast<Index>(kept_.size()), [&](Index i) {
    Vec<Dim> sum = r.col(kept_[i]);
    for (const Place& place : places_[i]) {
      const Group& group = groups_[place.group];
      for (std::size_t k = 0; k < group.inner.size(); ++k)
        sum -= group.follow.template block<Dim, Dim>(Dim * k, Dim * place.position).transpose() * r.col(group.inner[k]);
    }
    result.col(i) = sum;
  });
  return result;
}

template <int Dim> Points<Dim> Condensation<Dim>::extend(const Points<Dim>& z, const Points<Dim>& r) const {
  Points<Dim> result(Dim, r.cols());
  parallel_for(static_cast<Index>(kept_.size()), [&](Index i) { result.col(kept_[i]) = z.col(i); });
  parallel_for(static_cast<Index>(groups_.size()), [&](Index g) {
    const Group& group = groups_[g];
    const Points<Dim> forces = r(Eigen::all, group.inner), around = z(Eigen::all, group.outer);
    const Vector moved = group.inverse * forces.reshaped() - group.follow * around.reshaped();
    result(Eigen::all, group.inner) = moved.reshaped(Dim, static_cast<Index>(group.inner.size()));
  });
  return result;
}

template std::vector<std::vector<Index>> flat_groups<2>(const FineSpace<2>&, const ElementNodes&, const BlockMatrix<2>&,
                                                        const std::function<bool(Index)>&);
template std::vector<std::vector<Index>> flat_groups<3>(const FineSpace<3>&, const ElementNodes&, const BlockMatrix<3>&,
                                                        const std::function<bool(Index)>&);
template class Condensation<2>;
template class Condensation<3>;

}  // namespace efree
