// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/linear/internal/smoother.hpp"

#include "efree/core/internal/random.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/core/parallel.hpp"
#include "efree/solvers/linear/internal/held_nodes.hpp"
#include "efree/solvers/linear/internal/smoothing_pass.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>

namespace efree {
namespace {

/// The part of a spectrum up to `largest` that a polynomial of this degree takes on.
struct Range {
  double middle, half;

  Range(int degree, double largest) {
    const double lower = std::min(0.04, 1.0 / (degree * degree));
    middle = 0.5 * (1.0 + lower) * largest;
    half = 0.5 * (1.0 - lower) * largest;
  }
};

/// Lanes that hold so many vectors.
Index lanes_for(Index count) {
  for (const Index lanes : {1, 4, 8})
    if (count <= lanes) return lanes;
  return most_lanes;
}

/// Inverse of D on the range of the projector, zero beyond it, and for nodes without stiffness.
template <int Dim> Mat<Dim> inverse_on(const Mat<Dim>& D, const Mat<Dim>& free) {
  if (D.isZero(0.0)) return D;
  if (free == Mat<Dim>::Identity()) return D.inverse();
  const Mat<Dim> held = Mat<Dim>::Identity() - free;
  const double scale = D.trace();
  return free * (free * D * free + scale * held).inverse() * free;
}

}  // namespace

int smoothing_degree(double reach) {
  return std::clamp(static_cast<int>(std::ceil(0.9 * reach)), 3, highest_degree);
}

template <int Dim>
Smoother<Dim>::Smoother(const BlockMatrix<Dim>& K, const std::function<Mat<Dim>(Index)>& free, int highest) {
  const Index n = K.size();
  inverse_diagonal_.resize(n);
  scale_.resize(n);
  Points<Dim> r(Dim, n), z, p, q;
  parallel_for(n, [&](Index i) {
    const Mat<Dim> open = free(i), &D = K.diagonal(i);
    const double mean = D.trace() / Dim;
    scale_[i] = mean > 0.0 ? std::sqrt(mean) : 1.0;
    inverse_diagonal_[i] = (scale_[i] * inverse_on<Dim>(D, open) * scale_[i]).template cast<float>();
    Vec<Dim> start;
    for (int d = 0; d < Dim; ++d) start[d] = internal::random_number(static_cast<std::uint64_t>(Dim) * i + d);
    r.col(i) = open * start;
  });
  blocks_.resize(K.chunks.size());
  parallel_chunks(n, BlockMatrix<Dim>::chunk_rows, [&](Index begin, Index end) {
    const Index number = begin / BlockMatrix<Dim>::chunk_rows;
    const auto& chunk = K.chunks[number];
    blocks_[number].reserve(chunk.blocks.size());
    for (Index row = 0; row < end - begin; ++row)
      for (Index k = chunk.offsets[row]; k < chunk.offsets[row + 1]; ++k)
        blocks_[number].push_back(
            (chunk.blocks[k] / scale_[begin + row] / scale_[chunk.columns[k]]).template cast<float>());
  });
  if (highest == 1) return;  // no polynomial to scale
  const HeldNodes<Dim> held(n, free);
  // Lanczos by conjugate gradients: the largest Ritz value of some steps is within 15 per cent of the eigenvalue.
  constexpr int steps = 10;
  Matrix T = Matrix::Zero(steps, steps);
  double rz = 0.0, beta = 0.0, alpha_before = 1.0;
  int done = 0;
  for (int k = 0; k < steps; ++k, ++done) {
    apply(K, 1, {&r}, {&z});
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
  // `apply` has divided by the middle of the spectrum of an eigenvalue of 1.
  if (done > 0)
    largest_ =
        1.15 * Range(1, 1.0).middle * internal::eigenvalues<Eigen::Dynamic>(T.topLeftCorner(done, done)).maxCoeff();
}

template <int Dim> void Smoother<Dim>::apply(const BlockMatrix<Dim>& K, int degree,
                                             const std::vector<const Points<Dim>*>& r,
                                             const std::vector<Points<Dim>*>& z) const {
  for (std::size_t first = 0; first < r.size(); first += most_lanes) {
    const std::size_t count = std::min<std::size_t>(r.size() - first, most_lanes);
    apply_at_once(K, degree, std::span(r).subspan(first, count), std::span(z).subspan(first, count));
  }
}

template <int Dim> void Smoother<Dim>::apply_at_once(const BlockMatrix<Dim>& K, int degree,
                                                     std::span<const Points<Dim>* const> r,
                                                     std::span<Points<Dim>* const> z) const {
  constexpr Index chunk = BlockMatrix<Dim>::chunk_rows;
  const Index n = K.size(), count = static_cast<Index>(r.size());
  const Index lanes = lanes_for(count);
  const auto vectors = [&] { return std::make_unique_for_overwrite<float[]>(std::size_t{Dim} * lanes * n); };
  // As the scaled matrix has them, divided by their largest component: single precision may not hold it.
  std::array<double, most_lanes> size{};
  for (Index lane = 0; lane < count; ++lane) {
    const double most =
        n > 0 ? (r[lane]->colwise().template lpNorm<Eigen::Infinity>().array() / scale_.transpose().array()).maxCoeff()
              : 0.0;
    size[lane] = most > 0.0 ? most : 1.0;
  }
  const auto forces = vectors();
  parallel_chunks(n, chunk, [&](Index begin, Index end) {
    float* to = forces.get() + std::ptrdiff_t{Dim} * lanes * begin;
    for (Index i = begin; i < end; ++i)
      for (int d = 0; d < Dim; ++d, to += lanes)
        for (Index lane = 0; lane < lanes; ++lane)
          to[lane] = lane < count ? static_cast<float>((*r[lane])(d, i) / scale_[i] / size[lane]) : 0.0f;
  });
  auto now = vectors(), next = vectors();
  const Range range(degree, largest_);
  double rho = range.half / range.middle, keep = 0.0, take = 1.0 / range.middle;
  for (int k = 0; k < degree; ++k) {
    if (k > 0) {
      const double after = 1.0 / (2.0 * range.middle / range.half - rho);
      keep = after * rho;
      take = 2.0 * after / range.half;
      rho = after;
    }
    // Held directions of what is left do not matter: the inverse diagonal knows nothing of them.
    parallel_chunks(n, chunk, [&](Index begin, Index end) {
      const auto& rows = K.chunks[begin / chunk];
      const std::size_t of_chunk = std::size_t{Dim} * lanes * (end - begin);
      const auto room = std::make_unique_for_overwrite<float[]>(2 * of_chunk);
      if (k == 1) std::fill_n(next.get() + std::ptrdiff_t{Dim} * lanes * begin, of_chunk, 0.0f);
      smooth_rows(Dim, lanes,
                  {.rows = rows.with(begin, blocks_[begin / chunk].front().data()),
                   .inverse = inverse_diagonal_.front().data(),
                   .r = forces.get(),
                   .z = k == 0 ? nullptr : now.get(),
                   .next = next.get(),
                   .keep = static_cast<float>(keep),
                   .take = static_cast<float>(take),
                   .swept = room.get(),
                   .ahead = room.get() + of_chunk});
    });
    std::swap(now, next);
  }
  for (Points<Dim>* one : z) one->resize(Dim, n);
  parallel_chunks(n, chunk, [&](Index begin, Index end) {
    const float* from = now.get() + std::ptrdiff_t{Dim} * lanes * begin;
    for (Index i = begin; i < end; ++i)
      for (int d = 0; d < Dim; ++d, from += lanes)
        for (Index lane = 0; lane < count; ++lane) (*z[lane])(d, i) = from[lane] * size[lane] / scale_[i];
  });
}

template class Smoother<2>;
template class Smoother<3>;

}  // namespace efree
