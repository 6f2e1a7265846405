// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/internal/coarse_space.hpp"

#include "efree/core/parallel.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>

namespace efree {
namespace {

/// Extents of where a function acts, least over largest, squared, under which its node turns: half a ball, as at the
/// face of a thick body, has 0.3.
constexpr double slim = 0.25;
/// Turning nodes, squared, that are worth their factor, over what an iteration costs: nodes of the elements times
/// reach of the smoother. In space factors grow with the square.
constexpr double too_many = 10.0;

/// Displacement at x for rotations about the origin, one in each column; in the plane there is only one.
template <int Dim> Mat<Dim> rotations(const Vec<Dim>& x) {
  Mat<Dim> result = Mat<Dim>::Zero();
  if constexpr (Dim == 2)
    result.col(0) << -x[1], x[0];
  else
    result << 0.0, x[2], -x[1], -x[2], 0.0, x[0], x[1], -x[0], 0.0;
  return result;
}

/// Least over largest extent of where a function acts, squared: its own square says how much a place counts. Not a
/// number for a function of one place.
template <int Dim>
double slimness(const ShapeTable<Dim>& shape, std::span<const Place> rows, const Points<Dim>& places) {
  double total = 0.0;
  Vec<Dim> mean = Vec<Dim>::Zero();
  for (const auto& [v, k] : rows) {
    const double N = shape.row(v).N[k];
    total += N * N;
    mean += N * N * places.col(v);
  }
  mean /= total;
  Mat<Dim> spread = Mat<Dim>::Zero();
  for (const auto& [v, k] : rows) {
    const double N = shape.row(v).N[k];
    const Vec<Dim> away = places.col(v) - mean;
    spread += N * N * away * away.transpose();
  }
  const Vec<Dim> extents = Eigen::SelfAdjointEigenSolver<Mat<Dim>>(spread, Eigen::EigenvaluesOnly).eigenvalues();
  return extents[0] / extents[Dim - 1];
}

}  // namespace

template <int Dim> std::vector<char> thin_nodes(const ShapeTable<Dim>& shape, const Points<Dim>& places, double apart) {
  const auto rows_at =
      places_of_nodes(shape.num_nodes(), shape.num_points(), [&](Index v) { return shape.row(v).nodes; });
  std::vector<char> thin(shape.num_nodes());
  parallel_for(shape.num_nodes(), [&](Index I) { thin[I] = slimness<Dim>(shape, rows_at[I], places) < slim; });
  const auto count = static_cast<double>(std::ranges::count(thin, 1));
  if (count * count > too_many * static_cast<double>(places.cols()) * apart) std::ranges::fill(thin, 0);
  return thin;
}

template <int Dim>
CoarseSpace<Dim>::CoarseSpace(const BlockMatrix<Dim>& K, ShapeTable<Dim> shape, Points<Dim> places, Points<Dim> nodes,
                              const std::vector<char>& turning, const std::function<Mat<Dim>(Index)>& free)
    : shape_(std::move(shape)),
      places_(std::move(places)),
      nodes_(std::move(nodes)),
      rows_at_(places_of_nodes(shape_.num_nodes(), shape_.num_points(), [&](Index v) { return shape_.row(v).nodes; })),
      held_(K.size(), free) {
  const Index n = shape_.num_nodes();
  first_.assign(n + 1, 0);
  for (Index I = 0; I < n; ++I) first_[I + 1] = first_[I] + (turning[I] ? 2 : 1);
  factor_ = std::make_unique<ScaledCholesky>(stiffness(K), Dim);
}

template <int Dim> SymmetricMatrix CoarseSpace<Dim>::stiffness(const BlockMatrix<Dim>& K) const {
  std::vector<Index> node_of(first_.back());
  for (Index I = 0; I < shape_.num_nodes(); ++I)
    for (Index f = first_[I]; f < first_[I + 1]; ++f) node_of[f] = I;
  SymmetricMatrix result = gather_blocks<Dim>(first_.back(), [&](Index f, Accumulator<Mat<Dim>>& sums) {
    thread_local std::optional<Accumulator<Mat<Dim>>> scratch;  // K times the function
    if (!scratch || scratch->size() != K.size()) scratch.emplace(K.size());
    auto& forces = *scratch;
    forces.clear();
    const Index a = node_of[f];
    const bool turned = f > first_[a];
    for (const auto& [v, k] : rows_at_[a]) {
      const double N = shape_.row(v).N[k];
      const Mat<Dim>* open = held_.at(v);
      if (!turned && !open) {
        for (Index e = K.offsets[v]; e < K.offsets[v + 1]; ++e) forces[K.columns[e]] += N * K.blocks[e].transpose();
        continue;
      }
      Mat<Dim> move = N * Mat<Dim>::Identity();
      if (turned) move = N * rotations<Dim>(places_.col(v) - nodes_.col(a));
      if (open) move = *open * move;
      for (Index e = K.offsets[v]; e < K.offsets[v + 1]; ++e)
        forces[K.columns[e]].noalias() += K.blocks[e].transpose() * move;
    }
    for (const Index w : forces.touched()) {
      Mat<Dim> force = forces[w];
      if (const Mat<Dim>* open = held_.at(w)) force = *open * force;
      const auto row = shape_.row(w);
      const auto from = std::ranges::lower_bound(row.nodes, a) - row.nodes.begin();
      for (std::size_t l = from; l < row.nodes.size(); ++l) {
        const Index b = row.nodes[l];
        if (first_[b] >= f) sums[first_[b]] += row.N[l] * force;
        if (turns(b))
          sums[first_[b] + 1].noalias() +=
              row.N[l] * (rotations<Dim>(places_.col(w) - nodes_.col(b)).transpose() * force);
      }
    }
  });
  // Functions that live on held nodes alone have no stiffness, and no part in the solution. Where all nodes of a body
  // turn alike nothing moves: those functions are not independent.
  for (Index i = 0; i < result.cols(); ++i) {
    double& pivot = result.coeffRef(i, i);
    if (!(pivot > 0.0))
      pivot = 1.0;
    else if (const Index f = i / Dim; f > first_[node_of[f]])
      pivot *= 1.0 + 1e-10;
  }
  return result;
}

template <int Dim> Points<Dim> CoarseSpace<Dim>::solve(const Points<Dim>& r) const {
  Points<Dim> forces(Dim, first_.back());
  parallel_for(shape_.num_nodes(), [&](Index I) {
    Vec<Dim> force = Vec<Dim>::Zero(), moment = Vec<Dim>::Zero();
    for (const auto& [v, k] : rows_at_[I]) {
      const Vec<Dim> part = shape_.row(v).N[k] * r.col(v);
      force += part;
      if (turns(I)) moment += rotations<Dim>(places_.col(v) - nodes_.col(I)).transpose() * part;
    }
    forces.col(first_[I]) = force;
    if (turns(I)) forces.col(first_[I] + 1) = moment;
  });
  const Vector solution = factor_->solve(forces.reshaped());
  const Points<Dim> moved = solution.reshaped(Dim, first_.back());
  Points<Dim> z(Dim, shape_.num_points());
  parallel_for(shape_.num_points(), [&](Index v) {
    const auto row = shape_.row(v);
    Vec<Dim> sum = Vec<Dim>::Zero();
    for (std::size_t k = 0; k < row.nodes.size(); ++k) {
      const Index I = row.nodes[k];
      sum += row.N[k] * moved.col(first_[I]);
      if (turns(I)) sum += row.N[k] * (rotations<Dim>(places_.col(v) - nodes_.col(I)) * moved.col(first_[I] + 1));
    }
    z.col(v) = sum;
  });
  held_.release(z);
  return z;
}

template std::vector<char> thin_nodes<2>(const ShapeTable<2>&, const Points<2>&, double);
template std::vector<char> thin_nodes<3>(const ShapeTable<3>&, const Points<3>&, double);
template class CoarseSpace<2>;
template class CoarseSpace<3>;

}  // namespace efree
