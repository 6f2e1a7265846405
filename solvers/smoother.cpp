// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/internal/smoother.hpp"

#include "efree/core/parallel.hpp"
#include "efree/solvers/internal/held_nodes.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace efree {
namespace {

/// Part of the spectrum below the largest eigenvalue that a polynomial leaves to others.
double lower_share(int degree) {
  return std::min(0.04, 1.0 / (degree * degree));
}

/// Inverse of D on the range of the projector, zero beyond it, and for nodes without stiffness.
template <int Dim> Mat<Dim> inverse_on(const Mat<Dim>& D, const Mat<Dim>& free) {
  if (D.isZero(0.0)) return D;
  if (free == Mat<Dim>::Identity()) return D.inverse();
  const Mat<Dim> held = Mat<Dim>::Identity() - free;
  const double scale = D.trace();
  return free * (free * D * free + scale * held).inverse() * free;
}

/// Numbers between -1 and 1 that look random (Steele, Lea & Flood 2014).
double noise(std::uint64_t i) {
  i = (i + 1) * 0x9e3779b97f4a7c15ull;
  i = (i ^ i >> 30) * 0xbf58476d1ce4e5b9ull;
  i = (i ^ i >> 27) * 0x94d049bb133111ebull;
  return 0x1p-63 * static_cast<double>(static_cast<std::int64_t>(i ^ i >> 31));
}

}  // namespace

int smoothing_degree(double reach) {
  return std::clamp(static_cast<int>(std::ceil(0.9 * reach)), 3, highest_degree);
}

template <int Dim>
Smoother<Dim>::Smoother(const BlockMatrix<Dim>& K, const std::function<Mat<Dim>(Index)>& free, int highest) {
  const Index n = K.size();
  inverse_diagonal_.resize(n);
  Points<Dim> r(Dim, n), z, p, q;
  parallel_for(n, [&](Index i) {
    const Mat<Dim> open = free(i);
    inverse_diagonal_[i] = inverse_on<Dim>(K.diagonal(i), open);
    Vec<Dim> start;
    for (int d = 0; d < Dim; ++d) start[d] = noise(static_cast<std::uint64_t>(Dim) * i + d);
    r.col(i) = open * start;
  });
  if (highest == 1) return;  // no polynomial to scale
  const HeldNodes<Dim> held(n, free);
  // Lanczos by conjugate gradients: the largest Ritz value of some steps is within 15 per cent of the eigenvalue.
  constexpr int steps = 10;
  Matrix T = Matrix::Zero(steps, steps);
  double rz = 0.0, beta = 0.0, alpha_before = 1.0;
  int done = 0;
  for (int k = 0; k < steps; ++k, ++done) {
    sweep(K, r, z);
    const double next = r.cwiseProduct(z).sum();
    if (!(next > 0.0)) break;
    beta = k == 0 ? 0.0 : next / rz;
    if (k == 0)
      p = z;
    else
      p = z + beta * p;
    rz = next;
    K.multiply(p, q);
    const double curvature = p.cwiseProduct(q).sum();
    if (!(curvature > 0.0)) break;
    const double alpha = rz / curvature;
    T(k, k) = 1.0 / alpha + (k == 0 ? 0.0 : beta / alpha_before);
    if (k > 0) T(k - 1, k) = T(k, k - 1) = std::sqrt(beta) / alpha_before;
    alpha_before = alpha;
    r -= alpha * q;
    held.release(r);  // what is held takes no part
  }
  if (done > 0)
    largest_ = 1.15 * Eigen::SelfAdjointEigenSolver<Matrix>(T.topLeftCorner(done, done)).eigenvalues().maxCoeff();
}

template <int Dim> void Smoother<Dim>::sweep(const BlockMatrix<Dim>& K, const Points<Dim>& r, Points<Dim>& z) const {
  z.resize(Dim, K.size());
  parallel_chunks(K.size(), BlockMatrix<Dim>::chunk_rows, [&](Index begin, Index end) {
    const auto& chunk = K.chunks[begin / BlockMatrix<Dim>::chunk_rows];
    for (Index i = begin; i < end; ++i) {
      const Index row = i - begin;
      Vec<Dim> rest = r.col(i);
      for (Index k = chunk.diagonal[row] - 1; k >= chunk.own[row]; --k)
        rest.noalias() -= chunk.blocks[k] * z.col(chunk.columns[k]);
      z.col(i).noalias() = inverse_diagonal_[i] * rest;
    }
    Points<Dim> ahead = Points<Dim>::Zero(Dim, end - begin);  // forces by the nodes that are done
    for (Index i = end - 1; i >= begin; --i) {
      const Index row = i - begin;
      z.col(i).noalias() -= inverse_diagonal_[i] * ahead.col(row);
      const Vec<Dim> moved = z.col(i);
      for (Index k = chunk.own[row]; k < chunk.diagonal[row]; ++k)
        ahead.col(chunk.columns[k] - begin).noalias() += chunk.blocks[k].transpose() * moved;
    }
  });
}

template <int Dim>
void Smoother<Dim>::apply(const BlockMatrix<Dim>& K, int degree, const Points<Dim>& r, Points<Dim>& z) const {
  const double lower = lower_share(degree);
  const double middle = 0.5 * (1.0 + lower) * largest_, half = 0.5 * (1.0 - lower) * largest_;
  Points<Dim> step, rest, swept;
  sweep(K, r, step);
  step /= middle;
  z = step;
  double rho = half / middle;
  for (int k = 1; k < degree; ++k) {
    K.multiply(z, rest);
    rest = r - rest;
    sweep(K, rest, swept);  // held directions of `rest` do not matter: the inverse diagonal knows nothing of them
    const double next = 1.0 / (2.0 * middle / half - rho);
    step = next * rho * step + (2.0 * next / half) * swept;
    z += step;
    rho = next;
  }
}

template class Smoother<2>;
template class Smoother<3>;

}  // namespace efree
