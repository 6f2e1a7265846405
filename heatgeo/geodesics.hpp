// SPDX-License-Identifier: GPL-3.0-or-later
/// Geodesic distances and heat weights from single vertices, on local patches of the fine mesh.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"
#include "efree/heatgeo/kernel.hpp"

#include <limits>
#include <memory>

namespace efree {

/// How far a node reaches through the body.
enum class Weight {
  automatic,      ///< the best measured: visibility in 2D, fast marching in 3D
  heat_geodesic,  ///< distance by the heat method (Crane, Weischedel, Wardetzky 2013) and a kernel of it
  heat_flow,      ///< the heat itself after a few implicit steps, zero on the patch's rim (Bishop 2022)
  fast_marching,  ///< distance by fast marching with virtual sources, and a kernel of it
  visibility,     ///< exact distance by the visibility graph of the boundary in reach (2D), and a kernel of it
  euclidean,      ///< straight line through everything: the classical choice that sees through cracks
};

/// Values at the fine vertices in reach of one source.
struct LocalField {
  std::vector<Index> vertices;  ///< ascending
  std::vector<double> values;
};

/// How distances are found.
struct GeodesicOptions {
  Weight engine = Weight::automatic;
  double heat_time = 0.25;    ///< heat method: t in units of the squared mean edge length
  bool always_solve = false;  ///< march and heat also where the source sees all of its patch (to measure them)
};

/// Distances from single vertices. Holds what sources share: the corners of the boundary, the Delaunay cells, scratch
/// memory. Where a source sees all of its patch the distance is the straight line and nothing is solved. Const calls
/// may run concurrently; results do not depend on the number of threads.
template <int Dim> class Geodesics {
 public:
  /// Keeps a reference to the mesh. Throws InputError for heat_flow (no distance) and for visibility in 3D.
  Geodesics(const FineMesh<Dim>& mesh, const GeodesicOptions& options);
  ~Geodesics();
  Geodesics(const Geodesics&) = delete;
  Geodesics& operator=(const Geodesics&) = delete;

  /// Distances d < radius from `source`, inside the body (for Weight::euclidean: through everything).
  LocalField from(Index source, double radius) const;
  /// The same for many sources, each with its own radius; the heat method shares factorisations among neighbours.
  /// Throws InputError for a source that is no vertex or a radius that is not positive.
  std::vector<LocalField> from(const std::vector<Index>& sources, const Vector& radii) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Heat of a point source after `steps` implicit Euler steps to the time 0.1 radius^2 on the patch: zero at the radius,
/// natural condition on the body's boundary, normalised to a maximum of 1, positive (Bishop 2022).
template <int Dim> std::vector<LocalField> heat_flow_weights(const FineMesh<Dim>& mesh,
                                                             const std::vector<Index>& sources, const Vector& radii,
                                                             int steps = 6);

/// What a weight is a function of, and which.
struct WeightOptions {
  Weight weight = Weight::automatic;
  Kernel kernel = Kernel::cubic_spline;
};

/// Weights w_I in (0, 1] of all sources at the fine vertices: num_vertices x sources. Deterministic for any number of
/// threads.
template <int Dim> SparseRows node_weights(const FineMesh<Dim>& mesh, const std::vector<Index>& sources,
                                           const Vector& radii, const WeightOptions& options);

/// The distances behind them: entries d < radius, num_vertices x sources (0, stored, at a source). Throws InputError
/// for heat_flow, which has none.
template <int Dim> SparseRows node_distances(const FineMesh<Dim>& mesh, const std::vector<Index>& sources,
                                             const Vector& radii, Weight engine);

/// For each fine vertex, the source that is geodesically nearest and the distance to it (fast marching from all sources
/// at once; where three of their regions meet inside one cell the second nearest may be taken). num_vertices
/// entries; -1 and infinity where no source of the same body is nearer than `reach`.
struct NearestSource {
  std::vector<Index> source;  ///< index into `sources`
  Vector distance;
};
/// Of all fine vertices.
template <int Dim> NearestSource nearest_source(const FineMesh<Dim>& mesh, const std::vector<Index>& sources,
                                                double reach = std::numeric_limits<double>::infinity());

/// The same mesh with edges flipped until they are Delaunay (boundary kept). In a flat domain this is the intrinsic
/// Delaunay triangulation (Bobenko & Springborn 2007): same vertices, same P1 space on the boundary, cotangent weights
/// without negative sums.
Cells<2> delaunay_cells(const FineMesh<2>& mesh);

}  // namespace efree
