// SPDX-License-Identifier: GPL-3.0-or-later
/// Geometric multigrid on grids of cells over the same box.
#pragma once

#include "efree/solvers/cells/internal/grid_level.hpp"

#include <array>
#include <vector>

namespace efree::internal {

/// Interpolation between two grids over the same box, trilinear, whatever their numbers of cells.
class Transfer {
 public:
  Transfer(const GridLevel& coarse, const GridLevel& fine);
  /// fine += P coarse, where something is free.
  template <class T> void prolong(const T* from, T* to) const;
  /// coarse = P^T fine, where something is free.
  void restrict_to_coarse(const float* from, float* to) const { transpose(from, to, false); }
  /// diag(P^T D P) of a diagonal D, where something is free.
  void restrict_diagonal(const float* from, float* to) const { transpose(from, to, true); }

 private:
  void transpose(const float* from, float* to, bool squared) const;
  struct Axis {
    std::vector<Index> lower;          ///< by fine node: coarse node below (or at) it
    std::vector<float> share;          ///< of the coarse node above
    std::vector<std::size_t> begin;    ///< by coarse node, and the end: of these
    std::vector<Index> fine;           ///< nodes that it has a share of
    std::vector<float> share_of_fine;  ///< which
  };
  const GridLevel *coarse_, *fine_;
  std::array<Axis, 3> axes_;
};

/// Adds to the diagonal of a coarse grid whose cells are not made of whole finer ones, where it has far less of
/// diag(P^T D P) than its nodes mostly have: a splinter of material in a coarse cell may be next to a whole finer one,
/// and corrections there would be far too large.
void raise_soft_diagonal(GridLevel& coarse, const GridLevel& fine);

/// V-cycles in single precision over grids from fine to coarse, on each of which they can start. Coarser grids than
/// that have local dilatations: what they would add to fields without mean dilatation is not free of it on finer ones.
class Multigrid {
 public:
  /// Keeps pointers to the grids.
  Multigrid(std::vector<const GridLevel*> grids, SmallInverse coarsest);

  /// To be filled before a cycle from grid l on, which leaves it as it is.
  SingleField& right(std::size_t l) { return work_[l].b; }
  /// An approximate inverse of K, symmetric and positive, times right(l): that of the isotropic parts of materials.
  const SingleField& cycle(std::size_t l);
  /// Free between cycles.
  SingleField& spare(std::size_t l) { return work_[l].rest; }
  /// Gives back the memory that cycles work in on grid l, but not right(l); the next one takes it again.
  void release(std::size_t l);
  /// P of a complete field on grid l + 1; zero where nothing is free.
  Field prolonged(std::size_t l, const Field& coarse) const;

 private:
  struct Work {
    SingleField b, x, step, rest;
  };
  void take(std::size_t l);
  const SingleField& cycle(std::size_t l, Dilatation dilatation);
  void smooth(std::size_t l, bool from_zero, Dilatation dilatation);
  void multiply(std::size_t l, Dilatation dilatation);

  std::vector<const GridLevel*> grids_;
  SmallInverse coarsest_;
  std::vector<Transfer> transfers_;  ///< from each grid but the last to the next one
  std::vector<Work> work_;
};

}  // namespace efree::internal
