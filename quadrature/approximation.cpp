// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/quadrature/approximation.hpp"

#include "efree/core/concurrently.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/setting_error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/quadrature/internal/pressure_patches.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace efree {
namespace {

/// Volume that a random sequential packing of spacing r leaves to each node, in units of r^Dim: coverage 0.547 by discs
/// of diameter r (Tanemura 1979), 0.384 by balls (Torquato, Uche & Stillinger 2006).
template <int Dim> constexpr double volume_per_node = Dim == 2 ? 1.436 : 1.363;

/// Edge of the regular simplex of mean volume.
template <int Dim> double mean_edge(const FineMesh<Dim>& mesh) {
  return std::pow(mesh.volumes().mean() * (Dim == 2 ? 4.0 / std::sqrt(3.0) : 6.0 * std::sqrt(2.0)), 1.0 / Dim);
}

template <int Dim> void check(const FineMesh<Dim>& mesh, const ApproximationOptions& options) {
  if (options.order != 1 && options.order != 2)
    throw InputError(fmt::format("basis order {}, expected 1 or 2", options.order));
  if (options.ratio != 0.0 && !(options.ratio >= 0.25 && options.ratio <= 100.0))
    throw InputError(fmt::format("quadrature ratio M/N = {}, expected a number from 0.25 to 100", options.ratio));
  const double extent = (mesh.vertices().rowwise().maxCoeff() - mesh.vertices().rowwise().minCoeff()).norm();
  if (options.kind == BasisKind::mls && !(options.spacing > 0.0 && options.spacing <= extent))
    throw internal::SettingError(
        "cloud.spacing",
        fmt::format("cloud spacing = {:.6g}, expected a positive length no larger than the body ({:.6g})",
                    options.spacing, extent));
  const double edge = mean_edge(mesh);  // nodes sit on fine vertices and need some to choose from
  if (options.kind == BasisKind::mls && options.spacing < edge)
    throw internal::SettingError(
        "cloud.spacing", fmt::format("cloud spacing = {:.6g} is below the edges of the fine mesh (about {:.6g}); "
                                     "expected a finer mesh (H/h of 3 or more) or a wider spacing",
                                     options.spacing, edge));
  if (options.kind == BasisKind::mls && mesh.num_regions() > 1)
    for (Index c = 0; c < mesh.num_cells(); ++c)
      for (Index i = 0; i <= Dim; ++i)
        if (const Index other = mesh.neighbour(i, c); other >= 0 && mesh.region(other) != mesh.region(c))
          throw InputError("the functions of a node must not span two regions: part the mesh with cut_regions first");
}

/// Nodes on every body, and what they are good for.
template <int Dim> struct BodyClouds {
  NodeCloud<Dim> all;           ///< at least one node on each body
  NodeCloud<Dim> determined;    ///< those on bodies where they determine polynomials
  std::vector<char> has_basis;  ///< by body: whether they do
};

/// By body: whether its nodes determine polynomials of the order, with some to spare.
template <int Dim>
std::vector<char> determined_bodies(const FineMesh<Dim>& mesh, const NodeCloud<Dim>& cloud, int order) {
  const Index polynomials = num_polynomials<Dim>(order);
  std::vector<std::vector<Index>> nodes(mesh.num_components());
  for (Index I = 0; I < cloud.size(); ++I) nodes[mesh.component()[cloud.vertices[I]]].push_back(I);
  std::vector<char> determined;
  for (const auto& of_body : nodes) {
    const auto count = static_cast<Index>(of_body.size());
    determined.push_back(
        count >= polynomials + Dim &&
        (count >= 4 * polynomials || determine_polynomials<Dim>(cloud.positions(Eigen::all, of_body), order)));
  }
  return determined;
}

template <int Dim>
BodyClouds<Dim> split_by_bodies(const FineMesh<Dim>& mesh, NodeCloud<Dim> cloud, std::vector<char> has_basis) {
  BodyClouds<Dim> clouds{std::move(cloud), {}, std::move(has_basis)};
  std::vector<Index> kept;
  for (Index I = 0; I < clouds.all.size(); ++I)
    if (clouds.has_basis[mesh.component()[clouds.all.vertices[I]]]) kept.push_back(I);
  for (const Index I : kept) clouds.determined.vertices.push_back(clouds.all.vertices[I]);
  clouds.determined.positions = clouds.all.positions(Eigen::all, kept);
  clouds.determined.spacing = clouds.all.spacing(kept);
  return clouds;
}

/// Samples the cloud; where a body gets too few nodes for polynomials of the order, or nodes that do not determine
/// them, with half the spacing as often as it takes, unless it has hardly more vertices than there are polynomials.
template <int Dim>
BodyClouds<Dim> sample_bodies(const FineMesh<Dim>& mesh, Vector spacing, int order, std::uint64_t seed) {
  const std::vector<Index>& body = mesh.component();
  std::vector<Index> vertices(mesh.num_components(), 0), nodes(mesh.num_components());
  for (const Index b : body) ++vertices[b];
  std::vector<char> has_basis(mesh.num_components(), 1);
  for (;;) {
    auto cloud = sample_cloud(mesh, spacing, seed);
    const auto determined = determined_bodies(mesh, cloud, order);
    std::ranges::fill(nodes, 0);
    for (const Index v : cloud.vertices) ++nodes[body[v]];
    std::vector<char> halved(mesh.num_components(), 0);
    for (Index b = 0; b < mesh.num_components(); ++b) {
      if (determined[b] || !has_basis[b]) continue;
      if (vertices[b] < 4 * num_polynomials<Dim>(order) || nodes[b] == vertices[b])
        has_basis[b] = 0;
      else
        halved[b] = 1;
    }
    if (std::ranges::count(halved, 1) == 0) return split_by_bodies(mesh, std::move(cloud), std::move(has_basis));
    for (Index v = 0; v < mesh.num_vertices(); ++v)
      if (halved[body[v]]) spacing[v] *= 0.5;
  }
}

/// Throws InputError for a cloud that is not one of this mesh.
template <int Dim> void check_cloud(const FineMesh<Dim>& mesh, const NodeCloud<Dim>& cloud) {
  const Index count = cloud.size();
  require(count > 0 && cloud.positions.cols() == count && cloud.spacing.size() == count,
          "a cloud with a vertex, a position and a spacing for each node expected");
  for (Index I = 0; I < count; ++I) {
    const Index v = cloud.vertices[I];
    if (v < 0 || v >= mesh.num_vertices() || (I > 0 && v <= cloud.vertices[I - 1]))
      throw InputError(fmt::format("node {} of the cloud sits on vertex {}: expected ascending ones of 0 to {}", I, v,
                                   mesh.num_vertices() - 1));
    if (cloud.positions.col(I) != mesh.vertex(v))
      throw InputError(fmt::format("node {} of the cloud is at ({:.6g}), and vertex {} of the mesh at ({:.6g})", I,
                                   fmt::join(cloud.positions.col(I), ", "), v, fmt::join(mesh.vertex(v), ", ")));
    if (!(cloud.spacing[I] > 0.0))
      throw InputError(
          fmt::format("node {} of the cloud has spacing {}, expected a positive length", I, cloud.spacing[I]));
  }
}

/// Packing size at every fine vertex that gives `ratio` points for each node of the cloud *locally*: a node's share of
/// the volume is that of the fine vertices nearest to it, however small the feature it sits on.
template <int Dim> Vector local_spacing(const FineMesh<Dim>& mesh, const NodeCloud<Dim>& cloud,
                                        const NearestSource& nearest, double ratio) {
  Vector share = Vector::Zero(cloud.size());
  for (Index c = 0; c < mesh.num_cells(); ++c)
    for (int i = 0; i <= Dim; ++i)
      if (const Index I = nearest.source[mesh.cells()(i, c)]; I >= 0) share[I] += mesh.volume(c) / (Dim + 1);
  Vector spacing(mesh.num_vertices());
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    const Index I = nearest.source[v];
    if (I < 0)
      throw NumericalError(fmt::format("the body around ({:.6g}) holds no node; use a smaller spacing",
                                       fmt::join(mesh.vertex(v), ", ")));
    const double full = volume_per_node<Dim> * std::pow(cloud.spacing[I], Dim);
    spacing[v] = std::pow(std::min(share[I], full) / (volume_per_node<Dim> * ratio), 1.0 / Dim);
  }
  return spacing;
}

/// Cloud of about `ratio` points per node, locally. Points on the boundary own little volume but count, so the density
/// asked for is corrected by what came out until the total is within five per cent (three passes at most).
template <int Dim> NodeCloud<Dim> sample_points(const FineMesh<Dim>& mesh, const NodeCloud<Dim>& cloud,
                                                const NearestSource& nearest, double ratio, std::uint64_t seed) {
  double asked = ratio;
  for (int pass = 0;; ++pass) {
    auto points = sample_cloud(mesh, local_spacing(mesh, cloud, nearest, asked), seed);
    const double got = static_cast<double>(points.size()) / cloud.size();
    if (std::abs(got - ratio) < 0.05 * ratio || pass == 2) return points;
    asked *= ratio / got;
  }
}

/// MLS functions on the quadrature cloud. Around small features the integral of a function can come out negative: such
/// nodes are left out, worst first, until every weight is positive.
template <int Dim> SecondaryBasis<Dim> mls_secondary(const FineSpace<Dim>& space, NodeCloud<Dim> cloud,
                                                     const ApproximationOptions& options, Index& dropped) {
  const MlsOptions mls{.order = 1, .support = 2.0, .weights = {options.weight, options.kernel}, .vanish_on = {}};
  for (;;) {
    const auto functions = moving_least_squares(space.mesh(), cloud, mls);
    auto secondary = secondary_from_table(
        space, functions.shape,
        NodeCloud<Dim>{functions.node_dofs, space.mesh().vertices()(Eigen::all, functions.node_dofs), {}});
    const Vector weights = secondary_weights(space, secondary);
    NodeCloud<Dim> kept;
    const double threshold = 1e-3 * weights.mean();
    for (Index K = 0; K < cloud.size(); ++K)
      if (weights[K] > threshold) kept.vertices.push_back(K);
    if (static_cast<Index>(kept.vertices.size()) == cloud.size()) return secondary;
    dropped += cloud.size() - static_cast<Index>(kept.vertices.size());
    kept.positions = cloud.positions(Eigen::all, kept.vertices);
    kept.spacing = cloud.spacing(kept.vertices);
    for (Index& K : kept.vertices) K = cloud.vertices[K];
    cloud = std::move(kept);
  }
}

/// Pressure patches: seeds to a node, and the nodes that a patch holds at least (docs/evidence.md, docs/stability.md).
struct PatchSizes {
  double seeds, fewest;
};
template <int Dim> constexpr PatchSizes patch_sizes(PressureKind pressures) {
  return pressures == PressureKind::linear ? PatchSizes{0.085, 5.0} : PatchSizes{0.65, 2.0 / Dim};
}
/// Linear functions on so many clusters per node integrate the rest well enough; constant pressures take them as
/// patches.
constexpr double linear_clusters_per_node = 0.5;

/// The coarser quadrature of the dilatations, once the patches are known.
template <int Dim> void average(std::vector<Index> patch_of, SparseRows pressures, Approximation<Dim>& result) {
  result.patch_of = std::move(patch_of);
  result.pressures = std::move(pressures);
  result.dilatation = merge(result.quadrature, result.pressures);
}

template <int Dim> Approximation<Dim> finite_elements(const std::shared_ptr<const FineMesh<Dim>>& mesh,
                                                      const ApproximationOptions& options, const Monitor& monitor) {
  Approximation<Dim> result;
  {
    Stage stage("basis", monitor);
    result.space = FineSpace<Dim>(mesh, options.kind == BasisKind::p1 ? 1 : 2, options.axisymmetric);
    result.shape = ShapeTable<Dim>::identity(result.space.size());
    result.nodes = result.space.points();
    result.node_dofs.resize(result.space.size());
    std::iota(result.node_dofs.begin(), result.node_dofs.end(), 0);
  }
  Stage stage("quadrature", monitor);
  result.quadrature = project(result.space, result.shape, every_cell(result.space));
  result.averaged = options.dilatation == Dilatation::averaged;
  result.undecided = options.dilatation == Dilatation::automatic;
  if (result.averaged) {
    const Index points = result.quadrature.size() / mesh->num_cells();
    std::vector<Index> cell_of(result.quadrature.size());
    for (Index K = 0; K < result.quadrature.size(); ++K) cell_of[K] = K / points;
    SparseRows constant = internal::constant_pressures(cell_of);
    average(std::move(cell_of), std::move(constant), result);
  }
  return result;
}

/// Quadrature points per node.
template <int Dim> double default_ratio(SecondaryKind secondary, Dilatation dilatation) {
  switch (secondary) {
    case SecondaryKind::linear:
      return dilatation == Dilatation::averaged ? linear_clusters_per_node * (Dim + 1) : 2.5;
    case SecondaryKind::mls:
      return Dim == 2 ? 6.0 : 24.0;
    default:
      return 4.0;
  }
}

}  // namespace

template <int Dim> ApproximationOptions with_defaults(ApproximationOptions options, double vertices_per_node) {
  const bool coarse = Dim == 2 && vertices_per_node < 50.0;  // linear cells would show: docs/evidence.md
  if (options.interpolation == 0) options.interpolation = coarse && options.weight != Weight::heat_flow ? 2 : 1;
  if (options.support == 0.0) options.support = options.order == 1 ? 2.5 : 3.0;
  if (options.ratio == 0.0) options.ratio = default_ratio<Dim>(options.secondary, options.dilatation);
  return options;
}

template <int Dim> double default_spacing(const FineMesh<Dim>& mesh) {
  const double nodes = std::min(mesh.num_vertices() / (Dim == 2 ? 30.0 : 60.0), 1e4);
  const double extent = (mesh.vertices().rowwise().maxCoeff() - mesh.vertices().rowwise().minCoeff()).norm();
  const double spacing = std::pow(mesh.volumes().sum() / (volume_per_node<Dim> * nodes), 1.0 / Dim);
  return std::min(extent, std::max(spacing, 1.5 * mean_edge(mesh)));
}

template <int Dim> Approximation<Dim> in_quadratic_space(const Approximation<Dim>& approximation) {
  const FineSpace<Dim>& linear = approximation.space;
  require(linear.degree() == 1, "in_quadratic_space: the functions are in a quadratic space already");
  Approximation<Dim> result;
  result.space = FineSpace<Dim>(linear.shared_mesh(), 2, linear.axisymmetric());
  result.nodes = approximation.nodes;
  result.node_dofs = approximation.node_dofs;
  result.averaged = approximation.averaged;
  result.undecided = approximation.undecided;
  result.shape = approximation.shape;
  return result;
}

namespace {

template <int Dim> Approximation<Dim> on_clouds(const std::shared_ptr<const FineMesh<Dim>>& shared,
                                                const BodyClouds<Dim>& clouds, const ApproximationOptions& asked,
                                                const Monitor& monitor) {
  const FineMesh<Dim>& mesh = *shared;
  const NodeCloud<Dim>& cloud = clouds.all;
  const auto options = with_defaults<Dim>(asked, static_cast<double>(mesh.num_vertices()) / cloud.size());
  Approximation<Dim> result;
  result.space = FineSpace<Dim>(shared, options.interpolation, options.axisymmetric);
  const MlsOptions mls_options{.order = options.order,
                               .support = options.support,
                               .weights = {options.weight, options.kernel},
                               .vanish_on = options.vanish_on};
  const bool clustered = options.secondary == SecondaryKind::cells || options.secondary == SecondaryKind::linear;
  const bool second_cloud = options.secondary != SecondaryKind::full;
  const double seeds_per_node = options.ratio / (options.secondary == SecondaryKind::linear ? Dim + 1 : 1);
  result.averaged = options.dilatation == Dilatation::averaged;
  result.undecided = options.dilatation == Dilatation::automatic;
  NearestSource nearest;
  NodeCloud<Dim> points;
  Clusters clusters;
  Mls<Dim> mls;
  // The second cloud needs no functions; beside them it is no stage of its own.
  const Monitor told = num_threads() == 1 ? monitor : Monitor{};
  concurrently(
      [&] {
        if (!second_cloud && !result.averaged) return;
        const Stage stage("quadrature", told);
        nearest = nearest_source(mesh, cloud.vertices);
        if (!second_cloud) return;
        // Another seed, so that the two clouds do not coincide.
        points = sample_points(mesh, cloud, nearest, seeds_per_node, options.seed + 0x9e3779b97f4a7c15ull);
        if (clustered) clusters = nearest_clusters(mesh, points);
        if (options.secondary == SecondaryKind::linear) clusters = levelled(mesh, std::move(clusters));
      },
      [&] { mls = moving_least_squares(result.space, clouds.determined, mls_options, monitor); });
  result.shape = std::move(mls.shape);
  result.mls = mls.report;
  result.small_bodies = static_cast<Index>(std::ranges::count(clouds.has_basis, 0));
  result.node_dofs = std::move(mls.node_dofs);
  result.nodes = result.space.points()(Eigen::all, result.node_dofs);

  Stage stage("quadrature", monitor);
  const auto secondary = options.secondary == SecondaryKind::cells
                             ? cell_clusters(result.space, clusters, result.shape, 0.5 * seeds_per_node)
                         : options.secondary == SecondaryKind::linear
                             ? linear_clusters(result.space, clusters, result.shape, 0.5 * seeds_per_node)
                         : options.secondary == SecondaryKind::mls
                             ? mls_secondary(result.space, std::move(points), options, result.dropped_points)
                             : every_cell(result.space);
  result.quadrature = project(result.space, result.shape, secondary);
  if (result.averaged) {
    const bool linear = options.pressures == PressureKind::linear;
    const auto [seeds, fewest] = patch_sizes<Dim>(options.pressures);
    const bool by_cluster = !linear && second_cloud && seeds_per_node <= linear_clusters_per_node;
    auto patch_of = by_cluster
                        ? internal::patches_of_clusters(secondary)
                        : internal::patches_around(mesh, sample_points(mesh, cloud, nearest, seeds, options.seed + 1),
                                                   secondary, result.quadrature, fewest);
    auto pressures = linear ? internal::linear_pressures(result.quadrature, patch_of, fewest)
                            : internal::constant_pressures(patch_of);
    average(std::move(patch_of), std::move(pressures), result);
  }
  if (options.fine && options.secondary != SecondaryKind::full)
    result.fine = project(result.space, result.shape, every_cell(result.space));
  return result;
}

}  // namespace

template <int Dim> Approximation<Dim> approximate(const std::shared_ptr<const FineMesh<Dim>>& shared,
                                                  const ApproximationOptions& wanted, const Monitor& monitor) {
  require(shared != nullptr, "approximate: no mesh");
  const FineMesh<Dim>& mesh = *shared;
  ApproximationOptions options = wanted;
  if (options.kind == BasisKind::mls && options.spacing == 0.0) options.spacing = default_spacing(mesh);
  check(mesh, options);
  if (options.kind != BasisKind::mls) return finite_elements(shared, options, monitor);
  BodyClouds<Dim> clouds;
  {
    Stage stage("cloud", monitor);
    clouds = sample_bodies(mesh, graded_spacing(mesh, options.spacing, options.grading), options.order, options.seed);
  }
  return on_clouds(shared, clouds, options, monitor);
}

template <int Dim> Approximation<Dim> approximate(const std::shared_ptr<const FineMesh<Dim>>& shared,
                                                  const NodeCloud<Dim>& cloud, const ApproximationOptions& options,
                                                  const Monitor& monitor) {
  require(shared != nullptr, "approximate: no mesh");
  require(options.kind == BasisKind::mls, "finite elements take no cloud");
  check_cloud(*shared, cloud);
  ApproximationOptions with_spacing = options;
  with_spacing.spacing = cloud.spacing.mean();
  check(*shared, with_spacing);
  return on_clouds(shared, split_by_bodies(*shared, cloud, determined_bodies(*shared, cloud, options.order)), options,
                   monitor);
}

template double default_spacing<2>(const FineMesh<2>&);
template Approximation<2> in_quadratic_space<2>(const Approximation<2>&);
template ApproximationOptions with_defaults<2>(ApproximationOptions, double);
template double default_spacing<3>(const FineMesh<3>&);
template Approximation<3> in_quadratic_space<3>(const Approximation<3>&);
template ApproximationOptions with_defaults<3>(ApproximationOptions, double);
template Approximation<2> approximate<2>(const std::shared_ptr<const FineMesh<2>>&, const ApproximationOptions&,
                                         const Monitor&);
template Approximation<2> approximate<2>(const std::shared_ptr<const FineMesh<2>>&, const NodeCloud<2>&,
                                         const ApproximationOptions&, const Monitor&);
template Approximation<3> approximate<3>(const std::shared_ptr<const FineMesh<3>>&, const ApproximationOptions&,
                                         const Monitor&);
template Approximation<3> approximate<3>(const std::shared_ptr<const FineMesh<3>>&, const NodeCloud<3>&,
                                         const ApproximationOptions&, const Monitor&);

}  // namespace efree
