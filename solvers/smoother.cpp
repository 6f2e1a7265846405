// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/internal/smoother.hpp"

#include "efree/assembly/internal/few.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/core/parallel.hpp"
#include "efree/solvers/internal/held_nodes.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <span>

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
    sweep(K, {&r}, {&z});
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
  if (done > 0) largest_ = 1.15 * internal::eigenvalues<Eigen::Dynamic>(T.topLeftCorner(done, done)).maxCoeff();
}

template <int Dim> void Smoother<Dim>::sweep(const BlockMatrix<Dim>& K, const std::vector<const Points<Dim>*>& r,
                                             const std::vector<Points<Dim>*>& z) const {
  for (Points<Dim>* one : z) one->resize(Dim, K.size());
  for_few(r.size(), [&]<int n>(std::size_t first, std::integral_constant<int, n>) {
    using Column = Eigen::Map<Vec<Dim>>;
    std::array<const double*, n> from;
    std::array<double*, n> to;
    for (int c = 0; c < n; ++c) from[c] = r[first + c]->data(), to[c] = z[first + c]->data();
    parallel_chunks(K.size(), BlockMatrix<Dim>::chunk_rows, [&, from, to](Index begin, Index end) {
      const auto at = [](auto* data, Index i) { return data + static_cast<std::ptrdiff_t>(Dim) * i; };
      const auto& chunk = K.chunks[begin / BlockMatrix<Dim>::chunk_rows];
      for (Index i = begin; i < end; ++i) {
        const Index row = i - begin;
        std::array<Vec<Dim>, n> rest;
        for (int c = 0; c < n; ++c) rest[c] = Eigen::Map<const Vec<Dim>>(at(from[c], i));
        for (Index k = chunk.diagonal[row] - 1; k >= chunk.own[row]; --k)
          for (int c = 0; c < n; ++c) rest[c].noalias() -= chunk.blocks[k] * Column(at(to[c], chunk.columns[k]));
        for (int c = 0; c < n; ++c) Column(at(to[c], i)).noalias() = inverse_diagonal_[i] * rest[c];
      }
      std::array<Points<Dim>, n> ahead;  // forces by the nodes that are done
      for (auto& one : ahead) one = Points<Dim>::Zero(Dim, end - begin);
      for (Index i = end - 1; i >= begin; --i) {
        const Index row = i - begin;
        std::array<Vec<Dim>, n> moved;
        for (int c = 0; c < n; ++c) {
          Column at_node(at(to[c], i));
          at_node.noalias() -= inverse_diagonal_[i] * ahead[c].col(row);
          moved[c] = at_node;
        }
        for (Index k = chunk.own[row]; k < chunk.diagonal[row]; ++k)
          for (int c = 0; c < n; ++c)
            ahead[c].col(chunk.columns[k] - begin).noalias() += chunk.blocks[k].transpose() * moved[c];
      }
    });
  });
}

template <int Dim>
void Smoother<Dim>::sweep(const BlockMatrix<Dim>& K, const Eightfold<Dim>& r, Eightfold<Dim>& z) const {
  parallel_chunks(K.size(), BlockMatrix<Dim>::chunk_rows, [&](Index begin, Index end) {
    const BlockRows rows = K.rows_of(begin / BlockMatrix<Dim>::chunk_rows);
    Eightfold<Dim> ahead(end - begin);  // forces by the nodes that are done
    const double* inverse = inverse_diagonal_.front().data();
    if constexpr (Dim == 2)
      sweep_eightfold_2(rows, inverse, r.at(0), z.at(0), ahead.at(0));
    else
      sweep_eightfold_3(rows, inverse, r.at(0), z.at(0), ahead.at(0));
  });
}

template <int Dim>
void Smoother<Dim>::apply(const BlockMatrix<Dim>& K, int degree, const Eightfold<Dim>& r, Eightfold<Dim>& z) const {
  const double lower = lower_share(degree);
  const double middle = 0.5 * (1.0 + lower) * largest_, half = 0.5 * (1.0 - lower) * largest_;
  const Index n = K.size();
  const auto for_each_number = [&](const auto& work) {
    parallel_chunks(n, BlockMatrix<Dim>::chunk_rows, [&](Index begin, Index end) {
      const std::ptrdiff_t first = 8 * Dim * static_cast<std::ptrdiff_t>(begin);
      const std::ptrdiff_t last = 8 * Dim * static_cast<std::ptrdiff_t>(end);
      work(first, last);
    });
  };
  Eightfold<Dim> step(degree > 1 ? n : 0), rest(degree > 1 ? n : 0), swept(degree > 1 ? n : 0);
  sweep(K, r, z);
  for_each_number([&](std::ptrdiff_t first, std::ptrdiff_t last) {
    for (std::ptrdiff_t i = first; i < last; ++i) z.at(0)[i] /= middle;
    if (degree > 1) std::copy(z.at(0) + first, z.at(0) + last, step.at(0) + first);
  });
  double rho = half / middle;
  for (int k = 1; k < degree; ++k) {
    K.multiply(z, rest);
    for_each_number([&](std::ptrdiff_t first, std::ptrdiff_t last) {
      double* const of = rest.at(0);
      for (std::ptrdiff_t i = first; i < last; ++i) of[i] = r.at(0)[i] - of[i];
    });
    // Held directions of `rest` do not matter: the inverse diagonal knows nothing of them.
    sweep(K, rest, swept);
    const double next = 1.0 / (2.0 * middle / half - rho), keep = next * rho, take = 2.0 * next / half;
    for_each_number([&](std::ptrdiff_t first, std::ptrdiff_t last) {
      for (std::ptrdiff_t i = first; i < last; ++i) {
        step.at(0)[i] = keep * step.at(0)[i] + take * swept.at(0)[i];
        z.at(0)[i] += step.at(0)[i];
      }
    });
    rho = next;
  }
}

template <int Dim> void Smoother<Dim>::apply(const BlockMatrix<Dim>& K, int degree,
                                             const std::vector<const Points<Dim>*>& r,
                                             const std::vector<Points<Dim>*>& z) const {
  in_eights<Dim>(
      r, z, [&](const Eightfold<Dim>& from, Eightfold<Dim>& to) { apply(K, degree, from, to); },
      [&](const auto& from, const auto& to) { apply_to_few(K, degree, from, to); });
}

template <int Dim> void Smoother<Dim>::apply_to_few(const BlockMatrix<Dim>& K, int degree,
                                                    const std::vector<const Points<Dim>*>& r,
                                                    const std::vector<Points<Dim>*>& z) const {
  const double lower = lower_share(degree);
  const double middle = 0.5 * (1.0 + lower) * largest_, half = 0.5 * (1.0 - lower) * largest_;
  const std::size_t count = r.size();
  std::vector<Points<Dim>> step(count), rest(degree > 1 ? count : 0), swept(rest.size());
  const auto pointers = [](std::vector<Points<Dim>>& of) {
    std::vector<Points<Dim>*> all;
    for (auto& one : of) all.push_back(&one);
    return all;
  };
  sweep(K, r, pointers(step));
  for (std::size_t c = 0; c < count; ++c) *z[c] = step[c] /= middle;
  double rho = half / middle;
  for (int k = 1; k < degree; ++k) {
    K.multiply(std::vector<const Points<Dim>*>(z.begin(), z.end()), pointers(rest));
    for (std::size_t c = 0; c < count; ++c) rest[c] = *r[c] - rest[c];
    // Held directions of `rest` do not matter: the inverse diagonal knows nothing of them.
    const auto given = pointers(rest);
    sweep(K, {given.begin(), given.end()}, pointers(swept));
    const double next = 1.0 / (2.0 * middle / half - rho);
    for (std::size_t c = 0; c < count; ++c) {
      step[c] = next * rho * step[c] + (2.0 * next / half) * swept[c];
      *z[c] += step[c];
    }
    rho = next;
  }
}

template class Smoother<2>;
template class Smoother<3>;

}  // namespace efree
