// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/basis/internal/neighbours.hpp"
#include "efree/core/error.hpp"
#include "efree/dynamics/internal/surface_functions.hpp"
#include "efree/dynamics/schemes/sph/sph.hpp"
#include "efree/geometry/mesh/internal/facet_samples.hpp"
#include "efree/quadrature/lattice.hpp"

#include <fmt/ranges.h>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace efree {

namespace {

/// Gradients at every particle of those around it, corrected.
template <int Dim> ShapeTable<Dim> corrected_kernels(const DeformableBody<Dim>& body, const SphOptions& options) {
  const double h = options.smoothing * options.spacing;
  const auto n = static_cast<Index>(body.nodes.cols());
  internal::Neighbours<Dim> tree;
  tree.build(body.nodes);
  std::vector<Offset> offsets{0};
  std::vector<Index> nodes;
  std::vector<double> N;
  std::vector<Vec<Dim>> dN;
  for (Index i = 0; i < n; ++i) {
    std::vector<Index> around;
    tree.within(body.nodes.col(i), kernel_support * h, around);
    std::ranges::sort(around);
    std::vector<Vec<Dim>> gradients;
    Mat<Dim> moment = Mat<Dim>::Zero();
    Vec<Dim> sum = Vec<Dim>::Zero();
    for (const Index j : around) {
      const Vec<Dim> d = body.nodes.col(i) - body.nodes.col(j);
      gradients.push_back(body.volumes[j] * kernel_slope_over_distance(options.kernel, Dim, d.norm(), h) * d);
      sum += gradients.back();
      moment -= d * gradients.back().transpose();
    }
    if (!(std::abs(moment.determinant()) > 1e-6))
      throw InputError(fmt::format(
          "smoothed particles: the one at ({:.6g}) has too few neighbours for gradients. Take a smaller spacing",
          fmt::join(body.nodes.col(i), ", ")));
    const Mat<Dim> correction = moment.inverse().transpose();
    for (std::size_t k = 0; k < around.size(); ++k) {
      const bool is_itself = around[k] == i;
      nodes.push_back(around[k]);
      N.push_back(is_itself ? 1.0 : 0.0);
      dN.push_back(correction * (is_itself ? Vec<Dim>(-sum) : gradients[k]));
    }
    offsets.push_back(static_cast<Offset>(nodes.size()));
  }
  return {n, std::move(offsets), std::move(nodes), std::move(N), std::move(dN)};
}

}  // namespace

template <int Dim> DeformableBody<Dim> particles_on_lattice(const FineMesh<Dim>& mesh, SphFrame frame,
                                                            const SphOptions& options, SharedMaterial material,
                                                            double density) {
  require(options.spacing > 0.0, "smoothed particles: expected a positive spacing");
  const double size = (mesh.vertices().rowwise().maxCoeff() - mesh.vertices().rowwise().minCoeff()).maxCoeff();
  if (options.spacing > 0.1 * (1.0 + 1e-3) * size)
    throw InputError(fmt::format(
        "smoothed particles: spacing {:.6g}, and the body is {:.6g} long. Expected a tenth of that, or less",
        options.spacing, size));
  Vec<Dim> origin;
  for (int i = 0; i < Dim; ++i) origin[i] = options.origin[static_cast<std::size_t>(i)];
  const LatticePieces<Dim> pieces = cut_by_lattice<Dim>(mesh, origin, options.spacing, 0.5);
  DeformableBody<Dim> body;
  body.nodes = body.points = pieces.centroids;
  body.volumes = pieces.volumes;
  body.material = std::move(material);
  body.density = density;
  body.radius = 0.5 * options.spacing;
  if (frame == SphFrame::total) body.shape = corrected_kernels(body, options);
  return body;
}

template <int Dim> SurfacePart<Dim> surface_of_particles(const FineMesh<Dim>& mesh, const std::vector<Index>& facets,
                                                         const SphOptions& options, const DeformableBody<Dim>& body) {
  const double half = 0.5 * options.spacing, h = options.smoothing * options.spacing;
  auto cut = internal::cut_facets(mesh, facets, half);
  SurfacePart<Dim> part{.facets = std::move(cut.facets), .positions = std::move(cut.vertices)};
  const auto count = static_cast<Index>(part.positions.cols());
  for (SparseRows* functions : {&part.functions, &part.places})
    functions->resize(count, static_cast<Index>(body.nodes.cols()));
  internal::Neighbours<Dim> tree;
  tree.build(body.nodes);
  std::vector<Index> around;
  for (Index k = 0; k < count; ++k) {
    const Vec<Dim> at = part.positions.col(k);
    const double least = (body.nodes.col(tree.nearest(at)) - at).norm();
    tree.within(at, std::max(kernel_support * h, least + half), around);
    std::vector<internal::WeightedNode<Dim>> nodes;
    std::vector<std::pair<Index, double>> nearest;
    double sum = 0.0;
    for (const Index p : around) {
      const Vec<Dim> apart = body.nodes.col(p) - at;
      nodes.push_back({p, apart / options.spacing, internal::kernel_shape(options.kernel, apart.norm() / h)});
      if (const double weight = least + half - apart.norm(); weight > 0.0) nearest.emplace_back(p, weight);
    }
    for (const auto& [p, weight] : nearest) sum += weight;
    for (auto& [p, weight] : nearest) weight /= sum;
    internal::append_row(std::move(nearest), k, part.functions);
    internal::append_row(internal::moving_least_squares(nodes), k, part.places);
  }
  part.functions.finalize();
  part.places.finalize();
  return part;
}

template SurfacePart<2> surface_of_particles(const FineMesh<2>&, const std::vector<Index>&, const SphOptions&,
                                             const DeformableBody<2>&);
template SurfacePart<3> surface_of_particles(const FineMesh<3>&, const std::vector<Index>&, const SphOptions&,
                                             const DeformableBody<3>&);
template DeformableBody<2> particles_on_lattice(const FineMesh<2>&, SphFrame, const SphOptions&, SharedMaterial,
                                                double);
template DeformableBody<3> particles_on_lattice(const FineMesh<3>&, SphFrame, const SphOptions&, SharedMaterial,
                                                double);

}  // namespace efree
