// SPDX-License-Identifier: GPL-3.0-or-later
/// The elastic problem of an image on grids of cells, from fine to coarse.
#pragma once

#include "efree/solvers/cells/cell_solver.hpp"
#include "efree/solvers/cells/internal/cell_grid.hpp"
#include "efree/solvers/cells/internal/grid_fields.hpp"

#include <memory>
#include <optional>
#include <string>

namespace efree::internal {

/// A side of the image's frame: an axis, at its lower or upper end.
struct Side {
  int axis;
  bool upper;
  int first() const { return axis == 0 ? 1 : 0; }
  int second() const { return axis == 2 ? 1 : 2; }
};

/// A displacement that is prescribed on a side, in one direction.
struct HeldSide {
  std::string on;
  Side side;
  Vec<3> direction;  ///< in the image's axes
  int component;     ///< axis that it is along; -1: none, as of a component of the world where the image is turned
  ScalarField<3> value;
};

/// A node that is held in directions that are not the image's axes.
struct ObliqueNode {
  std::size_t node;
  Mat<3> free;   ///< projection onto the directions in which it may move
  Vec<3> value;  ///< displacement in the others
};

/// On one grid. Moduli and edges are scaled so that single precision holds them; forces with them.
struct CellProblem {
  CellGrid grid;
  Vec<3> origin, edges;      ///< unscaled [length]
  Mat<3> axes;               ///< of the image, in which fields have their components
  std::array<int, 3> ratio;  ///< cells of the next finer grid in one, 1 or 2 along each axis; of the finest 1
  const std::vector<HeldSide>* held;
  /// By condition in `held`: whether material reaches a node of its side, the side's first axis fastest.
  std::vector<std::vector<char>> reached;
  std::vector<float> inverse_diagonal;  ///< of a diagonal that is nowhere less than K; 0 where nothing is free
  std::vector<ObliqueNode> oblique;     ///< ascending; their three diagonals are the same
  std::vector<Field> loads;             ///< by case; empty without loads

  /// From the image's origin, along its axes.
  Vec<3> local(const std::array<Index, 3>& node) const { return edges.cwiseProduct(Vec<3>(node[0], node[1], node[2])); }
  /// In the world.
  Vec<3> place(const std::array<Index, 3>& node) const { return origin + axes * local(node); }
  /// Null: the node is held along the image's axes, if at all.
  const ObliqueNode* find_oblique(std::size_t node) const {
    const auto found = std::ranges::lower_bound(oblique, node, {}, &ObliqueNode::node);
    return found != oblique.end() && found->node == node ? &*found : nullptr;
  }
  /// Takes the directions off that oblique nodes are held in.
  template <class T> void project(Values<T>& field) const {
    for (const ObliqueNode& at : oblique) {
      Vec<3> v;
      for (int c = 0; c < 3; ++c) v[c] = static_cast<double>(field[c * grid.nodes() + at.node]);
      v = at.free * v;
      for (int c = 0; c < 3; ++c) field[c * grid.nodes() + at.node] = static_cast<T>(v[c]);
    }
  }
  std::size_t dof(int component, const std::array<Index, 3>& node) const {
    return component * grid.nodes() + grid.node(node[0], node[1], node[2]);
  }
  /// Calls f(node) for the nodes that a condition holds.
  template <class F> void for_held(std::size_t condition, const F& f) const {
    const Side& side = (*held)[condition].side;
    const int first = side.first(), second = side.second();
    std::array<Index, 3> node{};
    node[side.axis] = side.upper ? grid.cells[side.axis] : 0;
    std::size_t k = 0;
    for (node[second] = 0; node[second] <= grid.cells[second]; ++node[second])
      for (node[first] = 0; node[first] <= grid.cells[first]; ++node[first])
        if (reached[condition][k++]) f(node);
  }
  /// By side: the force and moment of what is out of balance (K u less the load), in the world's axes, scaled like
  /// these. A component at a node belongs to the sides that prescribe it, in inverse proportion to how far they are: at
  /// their nodes it is what they hold, and what iterations leave elsewhere is lost to none. Of directions that are not
  /// the image's axes the forces of least squares, weighted so.
  Resultants<3> reactions(const Field& out_of_balance) const;
  /// Sets what is prescribed. Throws InputError for values that are not finite.
  void set_held(Field& u) const;
  /// That are not void.
  Index num_cells() const;
};

struct CellProblems {
  std::vector<HeldSide> held;
  std::vector<std::unique_ptr<CellProblem>> grids;  ///< from fine to coarse
  double unit = 1.0;  ///< force over displacement: true forces and energies are this times the scaled ones
  std::vector<std::vector<AppliedLoad<3>>> applied;  ///< by case, as the finest grid has them, unscaled
  std::optional<CellGrid> shrunk;  ///< the second grid with half a voxel less of material, if asked for
};

/// Throws as solve_on_cells says, but for NumericalError.
CellProblems make_cell_problems(const LabelImage<3>& image, const std::vector<SharedMaterial>& materials,
                                const std::vector<DisplacementCondition<3>>& conditions,
                                const std::vector<Loads<3>>& cases, const CellOptions& options);

}  // namespace efree::internal
