// SPDX-License-Identifier: GPL-3.0-or-later
/// From a fine mesh to everything a solver needs to know of a basis, in one call.
#pragma once

#include "efree/basis/fine_space.hpp"
#include "efree/basis/mls.hpp"
#include "efree/core/monitor.hpp"
#include "efree/geometry/cloud/node_cloud.hpp"
#include "efree/geometry/cloud/spacing.hpp"
#include "efree/heatgeo/geodesics.hpp"
#include "efree/quadrature/discretization.hpp"

#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace efree {

/// Which functions carry the solution.
enum class BasisKind {
  mls,  ///< moving least squares on a coarse cloud of nodes
  p1,   ///< linear finite elements on the fine mesh
  p2,   ///< quadratic finite elements on the fine mesh
};

/// Where stresses live: the functions that gradients are projected on.
enum class SecondaryKind {
  cells,   ///< clusters of fine cells: diagonal Gram matrix, positive weights
  linear,  ///< linear functions on such clusters: the same, and exact for quadratics
  mls,     ///< MLS functions on a second cloud, lumped Gram matrix (Bishop 2022)
  full,    ///< every fine cell
};

/// Whether the volumetric part is averaged on coarser clusters (B-bar); of finite elements on the cells, which makes a
/// difference for quadratic ones. Without it functions lock where the material is nearly incompressible.
enum class Dilatation {
  automatic,  ///< where the material needs it. Who knows the material decides (`analyse`); `approximate` does not
              ///< average, and solvers refuse materials under which its functions then lock
  pointwise,  ///< never
  averaged,
};
/// One of the two that leave nothing open.
constexpr Dilatation averaged_if(bool averaged) {
  return averaged ? Dilatation::averaged : Dilatation::pointwise;
}

/// Which functions pressures are made of on a patch, where dilatations of a cloud are averaged; finite elements have
/// constant ones.
enum class PressureKind {
  linear,    ///< Dim + 1 functions on each patch of five nodes or more, about twelve; one on a body of fewer
  constant,  ///< one function on each patch of about two nodes, as explicit dynamics needs
};

/// Which functions and which quadrature; all may be left as it is.
struct ApproximationOptions {
  BasisKind kind = BasisKind::mls;
  bool axisymmetric = false;  ///< 2D: x is the radius, y the axis; goes with Plane::axisymmetric
  int order = 1;              ///< polynomials MLS reproduces: 1 or 2
  int interpolation = 0;      ///< degree of the fine space that holds the MLS functions: 1, or 2 (not heat_flow);
                              ///< 0: 2 in the plane with fewer than 50 fine vertices to a node, else 1
  double spacing = 0.0;       ///< H [length]; 0: default_spacing
  Grading grading{};          ///< where the cloud is denser than that
  std::uint64_t seed = 1;     ///< of the clouds
  double support = 0.0;       ///< radius in units of H; 0: 2.5 for order 1, 3 for order 2
  Weight weight = Weight::automatic;               ///< how nodes reach through the body
  Kernel kernel = Kernel::cubic_spline;            ///< weight by distance
  SecondaryKind secondary = SecondaryKind::cells;  ///< quadrature
  /// Quadrature points per node, M/N; 0: 4 for cells, 2.5 for linear ((Dim + 1) / 2 where dilatations are averaged),
  /// for mls 6 in the plane and 24 in space.
  double ratio = 0.0;
  Dilatation dilatation = Dilatation::automatic;
  PressureKind pressures = PressureKind::linear;
  bool fine = false;  ///< also build full integration (for the deviatoric stabilisation)
  /// Named boundary parts on which the functions of all other nodes vanish, so that nodal values there can be set
  /// strongly.
  std::vector<std::string> vanish_on{};
};

/// The options with numbers in place of the zeros that ask for a default: interpolation, support, ratio, of moving
/// least squares (kind == mls; finite elements have none of them). `vertices_per_node`: vertices of the fine mesh over
/// nodes of the cloud; it decides on the interpolation in the plane alone.
template <int Dim> ApproximationOptions with_defaults(ApproximationOptions options, double vertices_per_node);

/// Cloud spacing for those who do not say one [length]: 30 fine vertices to a node in the plane, 60 in space, but no
/// more than 10000 nodes by volume; no less than one and a half edges of the fine mesh.
template <int Dim> double default_spacing(const FineMesh<Dim>& mesh);

/// Immutable result; shares its mesh (space.shared_mesh()).
template <int Dim> struct Approximation {
  FineSpace<Dim> space;          ///< Lagrange space on the fine mesh that holds the functions
  ShapeTable<Dim> shape;         ///< space.size() x N: values of the basis at the fine degrees of freedom
  Points<Dim> nodes;             ///< Dim x N
  std::vector<Index> node_dofs;  ///< N, fine degree of freedom each node sits on, all different
  Quadrature<Dim> quadrature;    ///< secondary basis: points, weights, projected gradients, traces
  std::vector<Index> patch_of;   ///< M, pressure patch of each quadrature point; empty unless averaged
  SparseRows pressures;          ///< M x P: functions of the pressures, by patch; they sum to 1; empty unless averaged
  Quadrature<Dim> dilatation;    ///< P, the quadrature merged by them; empty unless averaged
  bool averaged = false;         ///< whether dilatations are averaged on patches (B-bar)
  bool undecided = false;        ///< Dilatation::automatic: nobody who knows the material said that it need not be
  Quadrature<Dim> fine;          ///< full integration; empty unless asked for
  MlsReport mls;                 ///< how often supports had to grow
  Index small_bodies = 0;        ///< too small for moving least squares: finite elements
  Index dropped_points = 0;      ///< quadrature nodes left out to keep every weight positive

  /// Quadrature points per node, M/N.
  double ratio() const { return static_cast<double>(quadrature.size()) / static_cast<double>(nodes.cols()); }
};

/// For moving least squares a mesh of several regions must be parted along its interfaces (cut_regions): every region
/// gets functions of its own, so that strains may jump. A body in which the cloud leaves too few nodes for polynomials
/// of the order (or nodes on one plane) gets a denser cloud; one with hardly more vertices than polynomials is left to
/// the finite elements of `space`, integrated in full. Stages: cloud, weights, basis,
/// quadrature. Throws InputError for options out of range (spacing missing or larger than the body, order, ratio,
/// support) and NumericalError where no basis can be built.
template <int Dim> Approximation<Dim> approximate(const std::shared_ptr<const FineMesh<Dim>>& mesh,
                                                  const ApproximationOptions& options, const Monitor& monitor = {});
/// The same on a mesh that somebody else keeps, and that must outlive the result.
template <int Dim> Approximation<Dim> approximate(const FineMesh<Dim>& mesh, const ApproximationOptions& options,
                                                  const Monitor& monitor = {}) {
  return approximate(borrowed(mesh), options, monitor);
}
/// The same on a mesh that the result takes: approximate(triangulate(...), ...).
template <int Dim>
Approximation<Dim> approximate(FineMesh<Dim>&& mesh, const ApproximationOptions& options, const Monitor& monitor = {}) {
  return approximate(std::make_shared<const FineMesh<Dim>>(std::move(mesh)), options, monitor);
}

/// Moving least squares on a given cloud (sample_cloud with any field of spacings, or one of your own);
/// options.spacing, grading and seed of the nodes mean nothing. Bodies whose nodes do not determine polynomials are
/// left to the finite elements. Throws InputError, besides, for a cloud that is not one of the mesh, and for finite
/// elements.
template <int Dim> Approximation<Dim> approximate(const std::shared_ptr<const FineMesh<Dim>>& mesh,
                                                  const NodeCloud<Dim>& cloud, const ApproximationOptions& options,
                                                  const Monitor& monitor = {});
/// The same on a mesh that somebody else keeps, and that must outlive the result.
template <int Dim> Approximation<Dim> approximate(const FineMesh<Dim>& mesh, const NodeCloud<Dim>& cloud,
                                                  const ApproximationOptions& options, const Monitor& monitor = {}) {
  return approximate(borrowed(mesh), cloud, options, monitor);
}

/// The same functions as members of the quadratic space of the mesh: space, nodes, node_dofs, averaged, and the shape
/// at the vertices alone, as they are linear along edges; the rest is empty. Throws InputError unless the space is of
/// degree 1.
template <int Dim> Approximation<Dim> in_quadratic_space(const Approximation<Dim>& approximation);

}  // namespace efree
