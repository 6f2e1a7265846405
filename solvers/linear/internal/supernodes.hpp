// SPDX-License-Identifier: GPL-3.0-or-later
/// The numbers of a supernodal Cholesky factor, on several threads.
#pragma once

#include "efree/assembly/operators.hpp"
#include "efree/core/types.hpp"

#include <cstddef>
#include <limits>
#include <span>
#include <vector>

struct cholmod_factor_struct;

namespace efree {

/// CHOLMOD orders the unknowns and finds the supernodes; what it does on one thread, or on many with other bits, and
/// for one right-hand side after the other, is done here. Supernodes are cut into panels of columns and these into
/// tiles of rows, none of which depends on the number of threads; every tile takes its updates in ascending order
/// (left-looking: Ng, Peyton 1993). Branches of the elimination tree are factored side by side, each by one thread, the
/// panels of its trunk one after the other with their tiles side by side.
class Supernodes {
 public:
  /// `symbolic` is a supernodal analysis of `lower`, whose values do not count. Consecutive unknowns of a node are
  /// consecutive in the factor; `first_of_nodes`: the first unknown of each, and one past the last.
  Supernodes(const cholmod_factor_struct& symbolic, const SymmetricMatrix& lower,
             std::span<const Index> first_of_nodes);

  Supernodes(const Supernodes&) = delete;
  Supernodes& operator=(const Supernodes&) = delete;

  static constexpr Index none = std::numeric_limits<Index>::max();
  /// Writes the factor of a matrix with that pattern to L, as long as CHOLMOD's xsize: L L^T, or with `signs`, one for
  /// each column of the factor, L diag(signs) L^T, of matrices that are not positive definite. Returns the first column
  /// of the factor where the pivot is not positive, or zero, or `none`; else L is no factor.
  Index factorize(const SymmetricMatrix& lower, double* L, double* signs = nullptr) const;

  /// Solves L diag(signs) L^T x = b for every column of B, in place; no signs: all are positive. Row order[i] of it is
  /// row i of the factor. What is read of L is read for up to 16 columns at once.
  void solve(const double* L, std::span<const double> signs, std::span<const Index> order, Eigen::Ref<Matrix> B) const;

 private:
  /// Consecutive columns of a supernode, and its rows from the first of them on.
  struct Panel {
    Index first, width;
    std::span<const Index> rows;  ///< the columns' own first
    std::size_t values;           ///< the first in L, column by column
    Index stride;                 ///< between columns
    bool is_shared = false;       ///< in the trunk: threads share its tiles

    Index num_tiles() const;
    std::pair<Index, Index> tile(Index t) const;  ///< range of rows; tile 0 is square
  };
  /// What a panel takes off: the product of these rows, of all columns of a supernode below it in the tree or of those
  /// before it in its own, with the first `num_columns` of the rows, which are columns of the panel.
  struct Update {
    std::span<const Index> rows;
    std::size_t values;                       ///< of the first row, the first in L
    Index stride, first, depth, num_columns;  ///< `first`: of the columns
  };
  /// Where a factor goes.
  struct Factor {
    double* L;
    double* signs;  ///< null: positive definite
  };
  struct Workspace;
  class Workspaces;

  /// Cuts the supernodes into panels. Returns the panel of each column.
  std::vector<Index> cut_panels(const cholmod_factor_struct& symbolic);
  void list_updates(const cholmod_factor_struct& symbolic, const std::vector<Index>& panel_of);
  /// Parts the tree of panels into branches and the trunk above them.
  void part_tree(const std::vector<Index>& panel_of);
  /// Finds the place of each entry of the matrix; `order`: the unknown of each column.
  void place_entries(const int* order, const SymmetricMatrix& lower, std::span<const Index> first_of_nodes,
                     const std::vector<Index>& panel_of);

  void update(const Panel& panel, Index tile, std::span<const Update> updates, Workspace& space,
              const Factor& to) const;
  Index factorize_first(const Panel& panel, const Factor& to) const;
  void divide_tile(const Panel& panel, Index tile, const Factor& to) const;
  Index factorize_alone(Index panel, Workspace& space, const Factor& to) const;
  Index factorize_together(Index panel, Workspaces& spaces, const Factor& to) const;
  Index factorize_branch(std::span<const Index> branch, Workspaces& spaces, const Factor& to) const;
  Index factorize_trunk(Workspaces& spaces, const Factor& to) const;

  std::vector<Index> rows_;  ///< of all supernodes
  std::vector<Panel> panels_;
  Ragged<Update> updates_;    ///< of every panel, in ascending order of supernodes
  std::vector<Index> place_;  ///< in L, of every entry of the matrix
  Ragged<Index> branches_;    ///< their panels in ascending order; the branch with most work comes first
  std::vector<Index> trunk_;  ///< panels above them, ascending
  std::size_t size_;          ///< of L
};

}  // namespace efree
