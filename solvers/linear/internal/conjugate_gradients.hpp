// SPDX-License-Identifier: GPL-3.0-or-later
/// Large symmetric systems without their factor.
#pragma once

#include "efree/assembly/operators.hpp"
#include "efree/solvers/linear/internal/node_graph.hpp"

#include <memory>
#include <optional>
#include <vector>

namespace efree {

/// Conjugate gradients (Hestenes & Stiefel 1952) in single precision, refined with residuals in double (Wilkinson
/// 1963), preconditioned by the inverses of the blocks of clusters of nodes (block Jacobi method): functions of wide
/// supports nearly depend on each other where they are, and that is what makes a cloud's matrix ill-conditioned.
/// Bitwise the same for any number of threads.
class ConjugateGradients {
 public:
  /// For matrices with a pattern of whole blocks, of which that is the graph.
  explicit ConjugateGradients(NodeGraph graph);

  /// What an iteration with a matrix of so many entries (lower triangle) reads.
  static double numbers(const NodeGraph& graph, double entries);
  /// Takes over from another matrix with that pattern. Whether the blocks of all clusters are positive definite: if
  /// not, there is nothing to solve with.
  bool take(const SymmetricMatrix& lower);
  /// x with |b - A x| <= tolerance |b|, A the matrix that was taken last; nothing if that takes more than so many
  /// products with A, as far as can be foreseen, for b that is not finite, or where a direction p has p A p <= 0.
  std::optional<Vector> solve(const SymmetricMatrix& A, const Vector& b, double tolerance, int most) const;

 private:
  using Floats = Eigen::VectorXf;
  /// The rows of a few nodes in the upper triangle, whose columns are gathered at once: those of these nodes, which
  /// have both triangles, and all beyond that one of them has. Values lie row by row, each as long as `stride`.
  struct Rows {
    Index first, width, columns, stride;
    std::size_t values;
  };
  /// Consecutive unknowns, and the inverse of their block.
  struct Cluster {
    Index first, size;
    Eigen::MatrixXf inverse;
  };
  struct Descent;

  void multiply(const Floats& x, Vector& y) const;
  void precondition(const Vector& r, Vector& z) const;
  Descent descend(const Vector& forces, double tolerance, int most) const;

  NodeGraph graph_;
  std::vector<std::size_t> blocks_;  ///< by entry of the graph: its first value
  std::vector<Index> rows_of_;       ///< by node of the graph
  // All that follows is in the order of the clusters.
  std::vector<Index> order_;  ///< the unknown in each place
  std::vector<Index> place_;  ///< of each unknown
  std::vector<Rows> rows_;
  std::vector<Index> columns_;  ///< by rows, filled up with zeros to whole vectors
  std::vector<float> values_;   ///< times scale_
  double scale_ = 1.0;          ///< one over the largest entry of the matrix
  std::vector<Cluster> clusters_;
};

}  // namespace efree
