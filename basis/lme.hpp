// SPDX-License-Identifier: GPL-3.0-or-later
/// Local maximum-entropy functions: of positions alone, smooth, positive, exact for linear functions (Arroyo & Ortiz
/// 2006).
#pragma once

#include "efree/basis/shape_table.hpp"

namespace efree {

/// How local the functions are, and how they are found.
struct LmeOptions {
  /// N_a ~ exp(-gamma |x - x_a|^2 / h^2 + ...), h the spacing of the nodes: 0.8 is wide, from about 4.8 on they are
  /// almost linear finite elements.
  double gamma = 1.8;
  double cutoff = 1e-6;      ///< nodes whose exponential is below this are left out
  double tolerance = 1e-6;   ///< of Newton's decrement before the last step
  int max_iterations = 200;  ///< of Newton's method at a point
  bool line_search = true;   ///< without it Newton's method fails near the hull's boundary; for comparison

  /// Distance over h beyond which nodes are left out: sqrt(-ln(cutoff) / gamma).
  double reach() const;
  /// Throws InputError for numbers out of range; returns the options.
  const LmeOptions& checked() const;
};

/// Whether a point has functions.
enum class LmeStatus {
  found,          ///< partition of unity and linear functions to rounding
  outside,        ///< there are none: a plane separates the point from all its nodes
  not_converged,  ///< not within LmeOptions::max_iterations
};

/// The functions at one point after the other, with scratch memory of its own: nothing is allocated unless a point has
/// more nodes than any before.
template <int Dim> class LmeFunctions {
 public:
  explicit LmeFunctions(const LmeOptions& options = {}) : options_(options.checked()) {}

  /// Forgets all nodes.
  void clear() { count_ = 0; }
  /// Adds a node at `offset` = x_a - x from the point.
  void add(const Vec<Dim>& offset);
  Index size() const { return count_; }

  /// The functions of the nodes added: N_a = exp(-d_a . metric d_a - lambda . d_a) / Z with d_a = x_a - x, lambda =
  /// argmin log Z, by Newton's method with line search from the lambda given (on return, the one found), and from zero
  /// where that leads nowhere. metric = gamma
  /// / h^2 times the identity, or any symmetric positive matrix [1/length^2]: lengths are measured by it. The last step
  /// is taken on the functions instead of lambda, so that linear functions are reproduced to rounding; they are off the
  /// exact ones by about LmeOptions::tolerance^2. A point is outside where lambda . d_a > 0 for all nodes, a proof.
  LmeStatus find(const Mat<Dim>& metric, Vec<Dim>& lambda);

  /// By node, in the order of add. Defined where the functions were found, as what follows.
  double N(Index a) const { return weight_[a]; }
  /// Its gradient: N_a J^-1 d_a (Arroyo & Ortiz 2006, eq. 36); d_a less its mean, which is zero but for rounding.
  Vec<Dim> dN(Index a) const { return weight_[a] * (gradient_ * (at(a) - mean_)); }
  /// J = sum N_a d_a d_a^T [length^2], and its inverse.
  const Mat<Dim>& moment() const { return moment_; }
  const Mat<Dim>& inverse_moment() const { return inverse_moment_; }
  int iterations() const { return iterations_; }  ///< that the last point took

 private:
  Vec<Dim> at(Index a) const {
    Vec<Dim> d;
    const double* first = offsets_.data() + static_cast<std::ptrdiff_t>(a / 8) * 8 * Dim + a % 8;
    for (int i = 0; i < Dim; ++i) d[i] = first[8 * i];
    return d;
  }
  void put(Index a, const Vec<Dim>& d) {
    double* first = offsets_.data() + static_cast<std::ptrdiff_t>(a / 8) * 8 * Dim + a % 8;
    for (int i = 0; i < Dim; ++i) first[8 * i] = d[i];
  }
  LmeStatus find_from(const Mat<Dim>& metric, Vec<Dim>& lambda);
  void finish(const Vec<Dim>& step, const Vec<Dim>& mean, double sum);

  LmeOptions options_;
  Index count_ = 0;
  std::vector<double> offsets_;            ///< in blocks of eight nodes: eight x, eight y, eight z
  std::vector<double> exponent_, weight_;  ///< by node, a multiple of eight
  Mat<Dim> moment_, inverse_moment_;
  Vec<Dim> mean_;
  Mat<Dim> gradient_;  ///< J^-1, of offsets as they are stored: in J's axes where it is nearly singular
  int iterations_ = 0;
};

/// Nodes and the spacing around each.
template <int Dim> struct LmeNodes {
  Points<Dim> positions;  ///< Dim x N
  Vector spacing;         ///< N, h of whatever is nearest to the node [length]
};

/// Functions and gradients at many points, `points` Dim x n: a table, n x N, that needs no mesh. Throws NumericalError
/// naming the first point that is outside the hull of all nodes within reach, where three times the reach does not help
/// either; such points have no functions.
template <int Dim>
ShapeTable<Dim> lme(const LmeNodes<Dim>& nodes, const Points<Dim>& points, const LmeOptions& options = {});

}  // namespace efree
