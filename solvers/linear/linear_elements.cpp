// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/linear/internal/linear_elements.hpp"

#include "efree/assembly/internal/gather.hpp"
#include "efree/core/parallel.hpp"

#include <numeric>

namespace efree {

template <int Dim>
LinearElements<Dim>::LinearElements(const BlockMatrix<Dim>& K, const FineSpace<Dim>& space, const ElementNodes& nodes,
                                    const std::function<Mat<Dim>(Index)>& free)
    : ends_(K.size(), {-1, -1}), held_(K.size(), free) {
  const Index corners = space.mesh().num_vertices();
  for (Index v = 0; v < corners; ++v) ends_[nodes.at[v]] = {0, 0};
  Index vertices = 0;  // in the order of the nodes: neighbours stay near in memory
  for (auto& ends : ends_)
    if (ends[0] == 0) ends[0] = ends[1] = vertices++;
  Index dof = corners;
  for (const auto& [a, b] : space.edges()) ends_[nodes.at[dof++]] = {ends_[nodes.at[a]][0], ends_[nodes.at[b]][0]};

  around_.offsets.assign(vertices + 1, 0);
  const auto for_vertices_of = [&](Index node, const auto& visit) {
    const auto& [a, b] = ends_[node];
    visit(a);
    if (b != a) visit(b);
  };
  for (Index node = 0; node < K.size(); ++node) for_vertices_of(node, [&](Index v) { ++around_.offsets[v + 1]; });
  std::partial_sum(around_.offsets.begin(), around_.offsets.end(), around_.offsets.begin());
  around_.items.resize(around_.offsets.back());
  std::vector<Index> cursor(around_.offsets.begin(), around_.offsets.end() - 1);
  for (Index node = 0; node < K.size(); ++node)
    for_vertices_of(node, [&](Index v) { around_.items[cursor[v]++] = node; });

  factor_ = std::make_unique<ScaledCholesky>(stiffness(K), Dim);
}

template <int Dim> SymmetricMatrix LinearElements<Dim>::stiffness(const BlockMatrix<Dim>& K) const {
  SymmetricMatrix result = gather_blocks<Dim>(around_.rows(), [&](Index v, Accumulator<Mat<Dim>>& sums) {
    for (const Index node : around_[v]) {
      const double own = share(node);
      const Mat<Dim>* open = held_.at(node);
      K.for_row(node, [&](Index other, const Mat<Dim>& block) {
        const auto [a, b] = ends_[other];
        if (a < v && b < v) return;
        Mat<Dim> force = (own * share(other)) * block.transpose();
        if (open) force = force * *open;
        if (const Mat<Dim>* other_open = held_.at(other)) force = *other_open * force;
        if (a >= v) sums[a] += force;
        if (b >= v && b != a) sums[b] += force;
      });
    }
  });
  // What is held has no stiffness, and no part in the solution.
  for (Index i = 0; i < result.cols(); ++i)
    if (double& pivot = result.coeffRef(i, i); !(pivot > 0.0)) pivot = 1.0;
  return result;
}

template <int Dim>
std::vector<Points<Dim>> LinearElements<Dim>::solve(const std::vector<const Points<Dim>*>& forces) const {
  Matrix at_vertices(Dim * around_.rows(), static_cast<Index>(forces.size()));
  std::vector<Points<Dim>> displacements;
  for (std::size_t k = 0; k < forces.size(); ++k) {
    const Points<Dim>& r = *forces[k];
    Eigen::Map<Points<Dim>> to(at_vertices.col(static_cast<Index>(k)).data(), Dim, around_.rows());
    parallel_for(around_.rows(), [&](Index v) {
      Vec<Dim> force = Vec<Dim>::Zero();
      for (const Index node : around_[v]) force += share(node) * r.col(node);
      to.col(v) = force;
    });
  }
  const Matrix solution = factor_->solve_all(at_vertices);
  for (std::size_t k = 0; k < forces.size(); ++k) {
    const Eigen::Map<const Points<Dim>> moved(solution.col(static_cast<Index>(k)).data(), Dim, around_.rows());
    Points<Dim>& z = displacements.emplace_back(Dim, forces[k]->cols());
    parallel_for(static_cast<Index>(z.cols()), [&](Index node) {
      const auto& [a, b] = ends_[node];
      z.col(node) = 0.5 * (moved.col(a) + moved.col(b));
    });
    held_.release(z);
  }
  return displacements;
}

template class LinearElements<2>;
template class LinearElements<3>;

}  // namespace efree
