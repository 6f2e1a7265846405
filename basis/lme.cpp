// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/basis/lme.hpp"

#include "efree/basis/internal/neighbours.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/core/internal/vectors.hpp"
#include "efree/core/parallel.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

namespace efree {
namespace {

using namespace internal;

constexpr int symmetric_size(int dim) {
  return dim * (dim + 1) / 2;
}

/// Sums over nodes, by whatever weighs them: of one, offsets d, and products d_i d_j (j <= i).
template <int Dim> struct Sums {
  double zeroth, first[Dim], second[symmetric_size(Dim)];
  double highest;  ///< exponent, by which all exponentials are divided
  double nearest;  ///< lambda . d of all
};

/// exp(exponent - lambda . d - highest) and their sums, of `count` nodes, a multiple of eight.
template <int Dim> EFREE_INLINE void exponentials(int count, const double* d, const double* exponent,
                                                  const double* lambda, double* weight, Sums<Dim>& sums) {
  Eight highest, nearest;
  for (int i = 0; i < 8; ++i) {
    highest[i] = -std::numeric_limits<double>::infinity();
    nearest[i] = std::numeric_limits<double>::infinity();
  }
  for (int k = 0; k < count; k += 8) {
    Eight along = {}, by, e;
    for (int i = 0; i < Dim; ++i) {
      load(by, d + Dim * k + 8 * i);
      along += lambda[i] * by;
    }
    load(e, exponent + k);
    nearest = along < nearest ? along : nearest;
    e -= along;
    highest = e > highest ? e : highest;
    store(weight + k, e);
  }
  sums.highest = largest(highest);
  sums.nearest = -largest(-nearest);
  Eight zeroth = {}, first[Dim] = {}, second[symmetric_size(Dim)] = {};
  for (int k = 0; k < count; k += 8) {
    Eight e, by[Dim];
    load(e, weight + k);
    e -= sums.highest;
    exp_of_negative(e);
    store(weight + k, e);
    zeroth += e;
    for (int i = 0, ij = 0; i < Dim; ++i) {
      load(by[i], d + Dim * k + 8 * i);
      const Eight ed = e * by[i];
      first[i] += ed;
      for (int j = 0; j <= i; ++j) second[ij++] += ed * by[j];
    }
  }
  sums.zeroth = sum(zeroth);
  for (int i = 0; i < Dim; ++i) sums.first[i] = sum(first[i]);
  for (int ij = 0; ij < symmetric_size(Dim); ++ij) sums.second[ij] = sum(second[ij]);
}

/// scale (constant + c . d) weight in the place of weight, and the first and second moments of these.
template <int Dim> EFREE_INLINE void rescaled(int count, const double* d, double scale, double constant,
                                              const double* c, double* weight, Sums<Dim>& sums) {
  Eight first[Dim] = {}, second[symmetric_size(Dim)] = {};
  for (int k = 0; k < count; k += 8) {
    Eight e, by[Dim], factor = {};
    factor += constant;
    load(e, weight + k);
    for (int i = 0; i < Dim; ++i) {
      load(by[i], d + Dim * k + 8 * i);
      factor += c[i] * by[i];
    }
    e *= scale * factor;
    store(weight + k, e);
    for (int i = 0, ij = 0; i < Dim; ++i) {
      const Eight ed = e * by[i];
      first[i] += ed;
      for (int j = 0; j <= i; ++j) second[ij++] += ed * by[j];
    }
  }
  for (int i = 0; i < Dim; ++i) sums.first[i] = sum(first[i]);
  for (int ij = 0; ij < symmetric_size(Dim); ++ij) sums.second[ij] = sum(second[ij]);
}

// Templates have no clones.
EFREE_FOR_EACH_MACHINE void exponentials_in_plane(int count, const double* d, const double* exponent,
                                                  const double* lambda, double* weight, Sums<2>& sums) {
  exponentials<2>(count, d, exponent, lambda, weight, sums);
}
EFREE_FOR_EACH_MACHINE void exponentials_in_space(int count, const double* d, const double* exponent,
                                                  const double* lambda, double* weight, Sums<3>& sums) {
  exponentials<3>(count, d, exponent, lambda, weight, sums);
}
EFREE_FOR_EACH_MACHINE void rescaled_in_plane(int count, const double* d, double scale, double constant,
                                              const double* c, double* weight, Sums<2>& sums) {
  rescaled<2>(count, d, scale, constant, c, weight, sums);
}
EFREE_FOR_EACH_MACHINE void rescaled_in_space(int count, const double* d, double scale, double constant,
                                              const double* c, double* weight, Sums<3>& sums) {
  rescaled<3>(count, d, scale, constant, c, weight, sums);
}

template <int Dim> Mat<Dim> symmetric_of(const double* second) {
  Mat<Dim> result;
  for (int i = 0, ij = 0; i < Dim; ++i)
    for (int j = 0; j <= i; ++j) result(i, j) = result(j, i) = second[ij++];
  return result;
}

}  // namespace

double LmeOptions::reach() const {
  return std::sqrt(-std::log(cutoff) / gamma);
}

const LmeOptions& LmeOptions::checked() const {
  const auto fail = [](const char* what, double is, const char* expected) {
    throw InputError(fmt::format("local maximum entropy: {} {}, expected {}", what, is, expected));
  };
  if (!(gamma > 0.0 && gamma <= 100.0)) fail("gamma", gamma, "more than 0, at most 100");
  if (!(cutoff > 0.0 && cutoff <= 0.1)) fail("cutoff", cutoff, "more than 0, at most 0.1");
  if (!(tolerance > 0.0 && tolerance <= 1e-3)) fail("tolerance", tolerance, "more than 0, at most 1e-3");
  if (max_iterations < 1) fail("max_iterations", max_iterations, "at least 1");
  return *this;
}

template <int Dim> void LmeFunctions<Dim>::add(const Vec<Dim>& offset) {
  if (count_ == static_cast<Index>(weight_.size())) {
    const std::size_t more = weight_.size() + 64;
    offsets_.resize(Dim * more);
    exponent_.resize(more);
    weight_.resize(more);
  }
  put(count_++, offset);
}

template <int Dim> LmeStatus LmeFunctions<Dim>::find_from(const Mat<Dim>& metric, Vec<Dim>& lambda) {
  iterations_ = 0;
  if (count_ <= Dim) return LmeStatus::outside;
  double reach = 0.0;
  for (Index a = 0; a < count_; ++a) {
    const Vec<Dim> d = at(a);
    exponent_[a] = -d.dot(metric * d);
    reach = std::max(reach, d.squaredNorm());
  }
  reach = std::sqrt(reach);
  const auto ahead = [&](const Vec<Dim>& direction) {
    for (Index a = 0; a < count_; ++a)
      if (!(at(a).dot(direction) > 0.0)) return false;
    return true;
  };
  const Index count = (count_ + 7) / 8 * 8;
  for (Index a = count_; a < count; ++a) {
    put(a, at(0));
    exponent_[a] = -1e300;
  }
  const auto sums_at = [&](const Vec<Dim>& where) {
    Sums<Dim> sums;
    if constexpr (Dim == 2)
      exponentials_in_plane(count, offsets_.data(), exponent_.data(), where.data(), weight_.data(), sums);
    else
      exponentials_in_space(count, offsets_.data(), exponent_.data(), where.data(), weight_.data(), sums);
    return sums;
  };
  Sums<Dim> sums = sums_at(lambda);
  for (iterations_ = 1; iterations_ <= options_.max_iterations; ++iterations_) {
    if (!std::isfinite(sums.zeroth)) break;
    const Vec<Dim> mean = Eigen::Map<const Vec<Dim>>(sums.first) / sums.zeroth;
    Mat<Dim> spread = symmetric_of<Dim>(sums.second) / sums.zeroth - mean * mean.transpose();
    spread.diagonal().array() += 1e-15 * spread.trace() + 1e-30 * reach * reach;
    Vec<Dim> step = spread.llt().solve(mean);
    double decrement = mean.dot(step);  // squared
    if (!std::isfinite(decrement)) break;
    // On the hull's boundary lambda has no end, and the last step would take all weight from what is behind.
    const bool there = mean.norm() <= 1e-13 * reach;
    if (decrement <= options_.tolerance * options_.tolerance && (there || step.norm() * reach <= 0.1)) {
      finish(there ? Vec<Dim>(Vec<Dim>::Zero()) : step, mean, sums.zeroth);
      return LmeStatus::found;
    }
    if (sums.nearest > 0.0 || (step.norm() * reach > 20.0 && ahead(step))) return LmeStatus::outside;
    constexpr double furthest = 20.0;  // of exponents; where one node has all the weight there is no telling
    if (const double far = step.norm() * reach; options_.line_search && far > furthest) {
      step *= furthest / far;
      decrement *= furthest / far;
    }
    const double value = sums.highest + std::log(sums.zeroth);
    double length = 1.0;
    Vec<Dim> next = lambda + step;
    sums = sums_at(next);
    // Close by, steps are good and differences of values are rounding.
    while (options_.line_search && decrement > 1e-4 && length > 1e-10 &&
           !(sums.highest + std::log(sums.zeroth) <= value - 1e-4 * length * decrement)) {
      length *= 0.5;
      next = lambda + length * step;
      sums = sums_at(next);
    }
    lambda = next;
  }
  return LmeStatus::not_converged;
}

template <int Dim> LmeStatus LmeFunctions<Dim>::find(const Mat<Dim>& metric, Vec<Dim>& lambda) {
  const bool warm = lambda != Vec<Dim>::Zero();
  LmeStatus status = find_from(metric, lambda);
  if (status == LmeStatus::not_converged && warm) {
    lambda.setZero();
    status = find_from(metric, lambda);
  }
  return status;
}

template <int Dim> void LmeFunctions<Dim>::finish(const Vec<Dim>& step, const Vec<Dim>& mean, double sum) {
  const Index count = (count_ + 7) / 8 * 8;
  Sums<Dim> sums;
  const auto rescale = [&](double scale, double constant, const Vec<Dim>& c) {
    if constexpr (Dim == 2)
      rescaled_in_plane(count, offsets_.data(), scale, constant, c.data(), weight_.data(), sums);
    else
      rescaled_in_space(count, offsets_.data(), scale, constant, c.data(), weight_.data(), sums);
    mean_ = Eigen::Map<const Vec<Dim>>(sums.first);
    return Mat<Dim>(symmetric_of<Dim>(sums.second) - mean_ * mean_.transpose());
  };
  moment_ = rescale(1.0 / sum, 1.0 + step.dot(mean), -step);
  inverse_moment_ = moment_.inverse();
  gradient_ = inverse_moment_;
  if (moment_.determinant() > 0.03 * std::pow(moment_.trace() / Dim, Dim)) return;
  // By a face of the hull: in J's axes, what lies on the face does not drown what lies across.
  const Mat<Dim> Q = internal::spectrum<Dim>(moment_).vectors;
  for (Index a = 0; a < count; ++a) put(a, Q.transpose() * at(a));
  const Mat<Dim> along = rescale(1.0, 1.0, Vec<Dim>::Zero());
  const Vec<Dim> scale = along.diagonal().cwiseSqrt().cwiseInverse();
  const Mat<Dim> scaled = scale.asDiagonal() * along * scale.asDiagonal();
  gradient_ = Q * (scale.asDiagonal() * scaled.inverse() * scale.asDiagonal());
  inverse_moment_ = gradient_ * Q.transpose();
}

template <int Dim>
ShapeTable<Dim> lme(const LmeNodes<Dim>& nodes, const Points<Dim>& points, const LmeOptions& options) {
  options.checked();
  if (nodes.positions.cols() != nodes.spacing.size() || !(nodes.spacing.array() > 0.0).all())
    throw InputError("local maximum entropy: expected a positive spacing for every node");
  Neighbours<Dim> tree;
  tree.build(nodes.positions);
  const auto n = static_cast<Index>(points.cols());
  struct Row {
    std::vector<Index> nodes;
    std::vector<double> N;
    std::vector<Vec<Dim>> dN;
  };
  std::vector<Row> rows(n);
  parallel_chunks(n, 256, [&](Index begin, Index end) {
    LmeFunctions<Dim> functions(options);
    for (Index p = begin; p < end; ++p) {
      const Vec<Dim> x = points.col(p);
      if (!x.allFinite()) throw InputError(fmt::format("local maximum entropy: point {} is no point", p));
      const double h = nodes.spacing[tree.nearest(x)];
      Row& row = rows[p];
      LmeStatus status = LmeStatus::outside;
      for (double reach = options.reach() * h; status != LmeStatus::found; reach *= std::sqrt(3.0)) {
        if (reach > 3.1 * options.reach() * h)
          throw NumericalError(fmt::format(
              "local maximum entropy: point {} at ({:.6g}) has {} nodes within {:.6g} and {}: the point has to lie "
              "between nodes, which may be too far apart for this spacing",
              p, fmt::join(x, ", "), row.nodes.size(), reach / std::sqrt(3.0),
              status == LmeStatus::outside ? "is outside their hull" : "Newton's method does not converge"));
        tree.within(x, reach, row.nodes);
        functions.clear();
        for (const Index a : row.nodes) functions.add(nodes.positions.col(a) - x);
        Vec<Dim> lambda = Vec<Dim>::Zero();
        status = functions.find(options.gamma / (h * h) * Mat<Dim>::Identity(), lambda);
      }
      for (Index a = 0; a < functions.size(); ++a) {
        row.N.push_back(functions.N(a));
        row.dN.push_back(functions.dN(a));
      }
    }
  });
  std::vector<Index> counts(n);
  for (Index p = 0; p < n; ++p) counts[p] = static_cast<Index>(rows[p].nodes.size());
  ShapeTable<Dim> table;
  table.reshape(static_cast<Index>(nodes.positions.cols()), counts, true);
  parallel_for(n, [&](Index p) {
    const auto room = table.room(p);
    std::copy(rows[p].nodes.begin(), rows[p].nodes.end(), room.nodes.begin());
    std::copy(rows[p].N.begin(), rows[p].N.end(), room.N.begin());
    std::copy(rows[p].dN.begin(), rows[p].dN.end(), room.dN.begin());
  });
  return table;
}

template class LmeFunctions<2>;
template class LmeFunctions<3>;
template ShapeTable<2> lme(const LmeNodes<2>&, const Points<2>&, const LmeOptions&);
template ShapeTable<3> lme(const LmeNodes<3>&, const Points<3>&, const LmeOptions&);

}  // namespace efree
