// SPDX-License-Identifier: GPL-3.0-or-later
/// The elastic problem of an image on grids of cells, from fine to coarse.
#pragma once

#include "efree/solvers/cells/cell_solver.hpp"
#include "efree/solvers/cells/internal/cell_boundary.hpp"
#include "efree/solvers/cells/internal/grid_level.hpp"
#include "efree/solvers/cells/internal/springs.hpp"

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>

namespace efree::internal {

/// A node that a rigid restraint holds.
struct HeldNode {
  std::size_t node;
  std::uint32_t restraint;  ///< in CellProblem::restraints
  Eigen::Vector3f normal;   ///< mean outward unit normal of the part there, along the image's axes
};

/// A node that is held in directions that are not the image's axes.
struct ObliqueNode {
  std::size_t node;
  Mat<3> free;   ///< projection onto the directions in which it may move
  Vec<3> value;  ///< displacement in the others
};

/// On one grid. Moduli and edges are scaled so that single precision holds them; forces with them.
struct CellProblem final : GridLevel {
  CellGrid grid;
  Vec<3> origin, edges;  ///< unscaled [length]
  Mat<3> axes;           ///< of the image, in which fields have their components
  Dilatation dilatation_of_answers;
  const std::vector<Restraint<3>>* restraints;
  std::vector<HeldNode> held{};        ///< ascending by node, those of a node by restraint
  Springs springs{};                   ///< of elastic restraints
  std::vector<ObliqueNode> oblique{};  ///< ascending; their three diagonals are the same
  std::vector<Field> loads{};          ///< by case; empty without loads
  /// Whether the body is held as on the finest grid: a part of the boundary may have too few of a coarse grid's nodes.
  bool holds = true;

  /// Without conditions.
  CellProblem(CellGrid grid, const Vec<3>& origin, const Vec<3>& edges, const Mat<3>& axes, Dilatation dilatation,
              const std::vector<Restraint<3>>& restraints);

  const CellLayout& layout() const override { return grid; }
  int components() const override { return 3; }
  Dilatation dilatation() const override { return dilatation_of_answers; }
  /// With the springs.
  void apply(const float* u, float* f) const override { multiply(u, f); }
  void apply(const double* u, double* f) const override { multiply(u, f); }
  void apply_isotropic(const float* u, float* f, Dilatation of) const override { multiply_isotropic(u, f, of); }
  void apply_isotropic(const double* u, double* f, Dilatation of) const override { multiply_isotropic(u, f, of); }
  /// Takes the directions off that oblique nodes are held in.
  void complete(float* u) const override { project(u); }
  void complete(double* u) const override { project(u); }
  void collect(float* f) const override { project(f); }
  void collect(double* f) const override { project(f); }

  /// From the image's origin, along its axes.
  Vec<3> local(const std::array<Index, 3>& node) const { return edges.cwiseProduct(Vec<3>(node[0], node[1], node[2])); }
  std::array<Index, 3> point(std::size_t node) const {
    const auto pitch = static_cast<std::size_t>(grid.pitch), rows = static_cast<std::size_t>(grid.cells[1]) + 1;
    return {static_cast<Index>(node % pitch), static_cast<Index>(node / pitch % rows),
            static_cast<Index>(node / pitch / rows)};
  }
  /// In the world.
  Vec<3> place(const std::array<Index, 3>& node) const { return origin + axes * local(node); }
  Vec<3> centroid(const BoundaryPatch& patch) const { return origin + axes * patch.at; }
  /// Where its loads act together, in the world: for_corners.
  Vec<3> acting_place(const BoundaryPatch& patch) const {
    Vec<3> at = Vec<3>::Zero();
    for_corners(patch, [&](const std::array<Index, 3>& node, double value) { at += value * place(node); });
    return at;
  }
  /// Calls f(node, value) for the corners of a patch's cell, with their functions where the stiffness has the octant
  /// (on the frame: at that side of it). Loads elsewhere would move corners that hardly any material holds.
  template <class F> void for_corners(const BoundaryPatch& patch, const F& f) const {
    const std::array<Index, 3> cell = patch.cell();
    for (int a = 0; a < 8; ++a) {
      std::array<Index, 3> node = cell;
      double value = 1.0;
      for (int d = 0; d < 3; ++d) {
        double at = patch.at[d] / edges[d] - cell[d];
        if (!patch.on_frame && d == patch.side / 2) at = patch.octant[d] % 2 == 1 ? 0.75 : 0.25;
        node[d] += a >> d & 1;
        value *= (a >> d & 1) == 1 ? at : 1.0 - at;
      }
      f(node, value);
    }
  }
  /// In which a node is held, along the image's axes.
  Vec<3> direction(const HeldNode& at) const {
    const int component = (*restraints)[at.restraint].component;
    return component < 0 ? Vec<3>(at.normal.cast<double>().normalized()) : Vec<3>(axes.row(component).transpose());
  }
  /// Null: the node is held along the image's axes, if at all.
  const ObliqueNode* find_oblique(std::size_t node) const {
    const auto found = std::ranges::lower_bound(oblique, node, {}, &ObliqueNode::node);
    return found != oblique.end() && found->node == node ? &*found : nullptr;
  }
  std::size_t dof(int component, const std::array<Index, 3>& node) const {
    return component * grid.nodes() + grid.node(node[0], node[1], node[2]);
  }
  /// Of the displacement u, by part on which something is prescribed: the force and moment by which that holds the
  /// body, in the world's axes, scaled like what is out of balance (K u with the springs, less all that pulls). Springs
  /// have their own forces. What is out of balance at a held node belongs to the restraints that hold it, in like
  /// shares; what iterations leave elsewhere goes to all parts that hold its direction, in inverse proportion to how
  /// far they are, so that none is lost. Of directions that are not the image's axes the forces of least squares,
  /// weighted so.
  Resultants<3> reactions(const Field& u, const Field& out_of_balance) const;
  /// Sets what is prescribed. Throws InputError for values that are not finite.
  void set_held(Field& u) const;
  /// That are not void.
  Index num_cells() const;

 private:
  template <class T> void multiply(const T* u, T* f) const {
    grid.apply(u, f, dilatation_of_answers);
    springs.add_to(u, f);
  }
  template <class T> void multiply_isotropic(const T* u, T* f, Dilatation of) const {
    grid.apply_isotropic(u, f, of);
    springs.add_to(u, f);
    add_to_diagonal(u, f);
  }
  template <class T> void project(T* field) const {
    for (const ObliqueNode& at : oblique) {
      Vec<3> v;
      for (int c = 0; c < 3; ++c) v[c] = static_cast<double>(field[c * grid.nodes() + at.node]);
      v = at.free * v;
      for (int c = 0; c < 3; ++c) field[c * grid.nodes() + at.node] = static_cast<T>(v[c]);
    }
  }
};

/// By a factor of the matrix.
SmallInverse inverse_of(const CellProblem& problem);

/// Patches by part of the boundary.
using PartPatches = std::map<std::string, std::vector<BoundaryPatch>>;

/// Finds the nodes that rigid restraints hold, takes them out of the diagonal, and those held obliquely aside.
/// `patches` by part of the boundary, the frame's sides among them. Throws InputError for displacements that are not
/// finite, or, on the `finest` grid, contradict each other.
void hold_nodes(CellProblem& problem, const PartPatches& patches, bool finest);
/// The springs of elastic restraints, scaled by `unit`. Throws InputError for a stiffness that is negative or not
/// finite.
Springs make_springs(const CellProblem& problem, const PartPatches& patches, double unit);
/// Whether bodies are held. Those that nothing holds and nothing loads are taken out of the unknowns. `finest`: throws
/// InputError naming the place of a body that is loaded, but not held against the motion its loads ask for, and of the
/// largest one if it has to be `held` but may move. Bodies are cells with a point in common.
BodiesOnGrid examine_bodies(CellProblem& problem, const LabelImage<3>& image, bool finest, bool largest_is_held);

struct CellProblems {
  std::vector<Restraint<3>> restraints;
  std::vector<std::unique_ptr<CellProblem>> grids;  ///< from fine to coarse
  double unit = 1.0;  ///< force over displacement: true forces and energies are this times the scaled ones
  std::vector<std::vector<AppliedLoad<3>>> applied;  ///< by case, as the finest grid has them, unscaled
  std::optional<CellGrid> shrunk;  ///< the second grid with half a voxel less of material, if asked for
  BodiesOnGrid bodies{};           ///< of the finest grid
};

/// Throws as solve_on_cells says, but for NumericalError.
CellProblems make_cell_problems(const LabelImage<3>& image, const std::vector<SharedMaterial>& materials,
                                const std::vector<DisplacementCondition<3>>& conditions,
                                const std::vector<Loads<3>>& cases, const CellOptions& options);

}  // namespace efree::internal
