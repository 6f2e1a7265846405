// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/linear/internal/condensation.hpp"

#include "efree/core/parallel.hpp"

#include <Eigen/Cholesky>
#include <algorithm>

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
      K_.for_row(node, [&](Index other, const auto&) {
        if (const Index group = of_node_[other]; group >= 0) joined.push_back(group);
      });
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

template <int Dim> Condensation<Dim>::Condensation(BlockMatrix<Dim>& K, const std::vector<std::vector<Index>>& groups)
    : groups_(groups.size()) {
  if (groups.empty()) return;
  const Index n = K.size();
  std::vector<char> out(n, 0);
  for (const auto& group : groups)
    for (const Index node : group) out[node] = 1;

  std::vector<Matrix> couplings(groups.size());
  parallel_for(static_cast<Index>(groups.size()), [&](Index g) {
    Group& group = groups_[g];
    group.inner = groups[g];
    for (const Index node : group.inner)
      K.for_row(node, [&](Index other, const auto&) {
        if (!out[other]) group.outer.push_back(other);
      });
    std::ranges::sort(group.outer);
    group.outer.erase(std::unique(group.outer.begin(), group.outer.end()), group.outer.end());
    const Index inner = static_cast<Index>(group.inner.size()), outer = static_cast<Index>(group.outer.size());
    group.own = Matrix::Zero(Dim * inner, Dim * inner);
    couplings[g] = Matrix::Zero(Dim * inner, Dim * outer);
    for (Index i = 0; i < inner; ++i)
      K.for_row(group.inner[i], [&](Index other, const Mat<Dim>& block) {
        const bool beyond = !out[other];
        const auto& among = beyond ? group.outer : group.inner;
        const auto j = std::ranges::lower_bound(among, other) - among.begin();
        (beyond ? couplings[g] : group.own).template block<Dim, Dim>(Dim * i, Dim * j) = block;
      });
    const Eigen::LLT<Matrix> cholesky(group.own);
    group.inverse = cholesky.solve(Matrix::Identity(Dim * inner, Dim * inner));
    group.follow = cholesky.solve(couplings[g]);
  });

  places_ = places_of_nodes(n, static_cast<Index>(groups_.size()),
                            [&](Index g) -> const std::vector<Index>& { return groups_[g].outer; });

  // Chunk by chunk in place: rows need what groups know, and none of each other.
  parallel_chunks(n, BlockMatrix<Dim>::chunk_rows, [&](Index begin, Index end) {
    bool changes = false;
    for (Index i = begin; i < end && !changes; ++i) changes = out[i] || !places_[i].empty();
    if (!changes) return;
    typename BlockMatrix<Dim>::Chunk chunk;
    auto& before = K.chunks[begin / BlockMatrix<Dim>::chunk_rows];
    chunk.columns.reserve(before.columns.size());
    chunk.blocks.reserve(before.blocks.size());
    std::vector<Index> columns;
    for (Index i = begin; i < end; ++i) {
      const Index from = before.offsets[i - begin], to = before.offsets[i - begin + 1];
      if (out[i]) {
        chunk.columns.push_back(i);
        chunk.blocks.push_back(Mat<Dim>::Zero());
      } else if (places_[i].empty()) {  // none of those that are out is near
        chunk.columns.insert(chunk.columns.end(), before.columns.begin() + from, before.columns.begin() + to);
        chunk.blocks.insert(chunk.blocks.end(), before.blocks.begin() + from, before.blocks.begin() + to);
      } else {
        columns.assign(before.columns.begin() + from, before.columns.begin() + to);
        std::erase_if(columns, [&](Index j) { return out[j]; });
        for (const NodePlace& place : places_[i])
          for (const Index j : groups_[place.point].outer)
            if (BlockMatrix<Dim>::stores(i, j)) columns.push_back(j);
        std::ranges::sort(columns);
        columns.erase(std::unique(columns.begin(), columns.end()), columns.end());
        const std::size_t first = chunk.blocks.size();
        chunk.columns.insert(chunk.columns.end(), columns.begin(), columns.end());
        chunk.blocks.resize(first + columns.size(), Mat<Dim>::Zero());
        const auto block = [&](Index j) -> Mat<Dim>& {
          return chunk.blocks[first + (std::ranges::lower_bound(columns, j) - columns.begin())];
        };
        for (Index e = from; e < to; ++e)
          if (!out[before.columns[e]]) block(before.columns[e]) = before.blocks[e];
        for (const NodePlace& place : places_[i]) {
          const Group& group = groups_[place.point];
          const auto coupling = couplings[place.point].template middleCols<Dim>(Dim * place.position);
          for (std::size_t k = 0; k < group.outer.size(); ++k)
            if (BlockMatrix<Dim>::stores(i, group.outer[k]))
              block(group.outer[k]) -= coupling.transpose() * group.follow.template middleCols<Dim>(Dim * k);
        }
      }
      chunk.close_row(i);
    }
    chunk.close();
    before = std::move(chunk);
  });
}

template <int Dim> Points<Dim> Condensation<Dim>::reduced(Points<Dim> f) const {
  if (groups_.empty()) return f;
  parallel_for(static_cast<Index>(f.cols()), [&](Index i) {
    for (const NodePlace& place : places_[i]) {  // none at the groups' own nodes, which are read here
      const Group& group = groups_[place.point];
      for (std::size_t k = 0; k < group.inner.size(); ++k)
        f.col(i) -=
            group.follow.template block<Dim, Dim>(Dim * k, Dim * place.position).transpose() * f.col(group.inner[k]);
    }
  });
  for (const Group& group : groups_)
    for (const Index node : group.inner) f.col(node).setZero();
  return f;
}

template <int Dim> void Condensation<Dim>::follow(const Points<Dim>& f, Points<Dim>& u) const {
  parallel_for(static_cast<Index>(groups_.size()), [&](Index g) {
    const Group& group = groups_[g];
    const Points<Dim> forces = f(Eigen::all, group.inner), around = u(Eigen::all, group.outer);
    const Vector moved = group.inverse * forces.reshaped() - group.follow * around.reshaped();
    u(Eigen::all, group.inner) = moved.reshaped(Dim, static_cast<Index>(group.inner.size()));
  });
}

template <int Dim> double Condensation<Dim>::work(const Points<Dim>& a, const Points<Dim>& b) const {
  double sum = 0.0;
  for (const Group& group : groups_) {
    const auto apart = [&](const Points<Dim>& u) -> Vector {
      const Points<Dim> inner = u(Eigen::all, group.inner), outer = u(Eigen::all, group.outer);
      return inner.reshaped() + group.follow * outer.reshaped();
    };
    sum += apart(a).dot(group.own * apart(b));
  }
  return sum;
}

template std::vector<std::vector<Index>> flat_groups<2>(const FineSpace<2>&, const ElementNodes&, const BlockMatrix<2>&,
                                                        const std::function<bool(Index)>&);
template std::vector<std::vector<Index>> flat_groups<3>(const FineSpace<3>&, const ElementNodes&, const BlockMatrix<3>&,
                                                        const std::function<bool(Index)>&);
template class Condensation<2>;
template class Condensation<3>;

}  // namespace efree
