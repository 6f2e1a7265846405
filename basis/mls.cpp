// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/basis/mls.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/setting_error.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/core/parallel.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>

namespace efree {
namespace {

/// g(xi) = {1, xi, eta, ...}, quadratic terms after the linear ones.
template <int Dim, int Order> Eigen::Matrix<double, num_polynomials<Dim>(Order), 1> monomials(const Vec<Dim>& xi) {
  Eigen::Matrix<double, num_polynomials<Dim>(Order), 1> g;
  g[0] = 1.0;
  g.template segment<Dim>(1) = xi;
  if constexpr (Order == 2) {
    int k = Dim + 1;
    for (int i = 0; i < Dim; ++i)
      for (int j = i; j < Dim; ++j) g[k++] = xi[i] * xi[j];
  }
  return g;
}

enum class RowQuality { good, badly_placed, singular };

/// One row of the table: N from the weights w of the nodes around X, by Cholesky; where the moment matrix is (nearly)
/// singular by its pseudo-inverse, which still reproduces polynomials if the nodes allow it at X (nodes on a line
/// through X do).
template <int Dim, int Order> RowQuality solve_row(const Vec<Dim>& X, const Points<Dim>& positions,
                                                   std::span<const Index> nodes, std::span<const double> w,
                                                   double largest_sum, std::span<double> N, double& sum) {
  constexpr int n = num_polynomials<Dim>(Order);
  using VecG = Eigen::Matrix<double, n, 1>;
  using MatG = Eigen::Matrix<double, n, n>;
  sum = 0.0;
  if (nodes.empty()) return RowQuality::singular;
  double reach = 0.0;
  for (Index node : nodes) reach = std::max(reach, (positions.col(node) - X).squaredNorm());
  const double scale = reach > 0.0 ? 1.0 / std::sqrt(reach) : 1.0;

  thread_local std::vector<VecG> g;
  g.resize(nodes.size());
  MatG A = MatG::Zero();
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    g[k] = monomials<Dim, Order>((positions.col(nodes[k]) - X) * scale);
    A.noalias() += (w[k] * g[k]) * g[k].transpose();
  }

  const auto apply = [&](const auto& inverse) {  // two steps of refinement bring the residual to rounding
    VecG residual = VecG::Unit(0);
    std::fill(N.begin(), N.end(), 0.0);
    for (int step = 0; step < 3; ++step) {
      const VecG c = inverse(residual);
      for (std::size_t k = 0; k < nodes.size(); ++k) N[k] += w[k] * g[k].dot(c);
      residual = VecG::Unit(0);
      for (std::size_t k = 0; k < nodes.size(); ++k) residual -= N[k] * g[k];
      if (residual.template lpNorm<Eigen::Infinity>() < 1e-15) break;
    }
    return residual.template lpNorm<Eigen::Infinity>();
  };

  double residual = 1.0;
  const Eigen::LLT<MatG> cholesky(A);
  const VecG pivots = cholesky.matrixLLT().diagonal();
  if (cholesky.info() == Eigen::Success && pivots.minCoeff() > 1e-4 * pivots.maxCoeff()) {
    residual = apply([&](const VecG& r) -> VecG { return cholesky.solve(r); });
  } else {
    const auto eigen = internal::spectrum<VecG::RowsAtCompileTime>(A);
    VecG inverse = eigen.values;
    const double cutoff = 1e-11 * inverse.maxCoeff();
    inverse = inverse.unaryExpr([&](double x) { return x > cutoff ? 1.0 / x : 0.0; });
    residual = apply([&](const VecG& r) -> VecG {
      return eigen.vectors * (inverse.asDiagonal() * (eigen.vectors.transpose() * r));
    });
  }
  if (!(residual < 1e-13)) return RowQuality::singular;
  for (double value : N) sum += std::abs(value);
  return sum > largest_sum ? RowQuality::badly_placed : RowQuality::good;
}

template <int Dim> std::vector<RowQuality> solve_rows(const Points<Dim>& points, const NodeCloud<Dim>& cloud,
                                                      const MlsOptions& options, const SparseRows& weights,
                                                      std::vector<double>& N, Vector& sums) {
  std::vector<RowQuality> quality(points.cols());
  N.resize(weights.nonZeros());
  sums.resize(points.cols());
  const auto solve = options.order == 1 ? &solve_row<Dim, 1> : &solve_row<Dim, 2>;
  parallel_for(static_cast<Index>(points.cols()), [&](Index v) {
    const auto begin = static_cast<std::size_t>(weights.outerIndexPtr()[v]);
    const auto count = static_cast<std::size_t>(weights.outerIndexPtr()[v + 1]) - begin;
    quality[v] = solve(points.col(v), cloud.positions, {weights.innerIndexPtr() + begin, count},
                       {weights.valuePtr() + begin, count}, options.largest_sum, {N.data() + begin, count}, sums[v]);
  });
  return quality;
}

/// The matrix with the given columns replaced by those of `fresh` (column k of `fresh` becomes column changed[k]).
SparseRows replace_columns(const SparseRows& matrix, const std::vector<Index>& changed, const SparseRows& fresh) {
  std::vector<char> is_changed(matrix.cols(), 0);
  for (Index c : changed) is_changed[c] = 1;
  std::vector<Index> offsets{0}, columns;
  std::vector<double> values;
  offsets.reserve(matrix.rows() + 1);
  columns.reserve(matrix.nonZeros());
  values.reserve(matrix.nonZeros());
  for (Index r = 0; r < matrix.rows(); ++r) {
    SparseRows::InnerIterator kept(matrix, r), added(fresh, r);
    while (kept || added) {
      if (kept && is_changed[kept.col()]) {
        ++kept;
      } else if (kept && (!added || kept.col() < changed[added.col()])) {
        columns.push_back(kept.col()), values.push_back(kept.value());
        ++kept;
      } else {
        columns.push_back(changed[added.col()]), values.push_back(added.value());
        ++added;
      }
    }
    offsets.push_back(static_cast<Index>(columns.size()));
  }
  return Eigen::Map<const SparseRows>(matrix.rows(), matrix.cols(), static_cast<Index>(columns.size()), offsets.data(),
                                      columns.data(), values.data());
}

/// Distance to the middle of an edge of the given length from those to its ends.
double median(double a, double b, double length) {
  return std::sqrt(std::max(0.0, 0.5 * (a * a + b * b) - 0.25 * length * length));
}

/// Distances at the vertices (rows) with rows for the middles of edges added. Where one end is out of reach its
/// distance is at least the radius, unless the other end sees the node, and then so does the middle.
template <int Dim> SparseRows with_midpoints(const SparseRows& distances, const FineSpace<Dim>& space,
                                             const std::vector<std::array<Index, 2>>& edges,
                                             const NodeCloud<Dim>& cloud, const Vector& radii) {
  struct Part {
    std::vector<Index> sizes, nodes;
    std::vector<double> values;
  };
  const Index vertices = space.mesh().num_vertices(), count = static_cast<Index>(edges.size());
  const Index chunk = std::max<Index>(1024, (count + 31) / 32);
  std::vector<Part> parts((count + chunk - 1) / chunk);
  parallel_chunks(count, chunk, [&](Index begin, Index end) {
    Part& part = parts[begin / chunk];
    for (Index e = begin; e < end; ++e) {
      const std::size_t before = part.nodes.size();
      const auto [a, b] = edges[e];
      const Vec<Dim> xa = space.points().col(a), xb = space.points().col(b), middle = space.points().col(vertices + e);
      const double length = (xb - xa).norm();
      SparseRows::InnerIterator at_a(distances, a), at_b(distances, b);
      while (at_a || at_b) {
        const Index I = !at_b ? at_a.col() : !at_a ? at_b.col() : std::min(at_a.col(), at_b.col());
        const bool has_a = at_a && at_a.col() == I, has_b = at_b && at_b.col() == I;
        const Vec<Dim> node = cloud.positions.col(I);
        double d = (middle - node).norm();
        if (has_a && has_b) {
          d = std::max(d, median(at_a.value(), at_b.value(), length));
        } else {
          const double near = has_a ? at_a.value() : at_b.value();
          const double straight = ((has_a ? xa : xb) - node).norm();
          if (near > straight * (1.0 + 1e-9)) d = std::max(d, median(near, radii[I], length));
        }
        if (d < radii[I]) part.nodes.push_back(I), part.values.push_back(d);
        if (has_a) ++at_a;
        if (has_b) ++at_b;
      }
      part.sizes.push_back(static_cast<Index>(part.nodes.size() - before));
    }
  });
  std::vector<Index> offsets(distances.outerIndexPtr(), distances.outerIndexPtr() + vertices + 1);
  std::vector<Index> columns(distances.innerIndexPtr(), distances.innerIndexPtr() + distances.nonZeros());
  std::vector<double> values(distances.valuePtr(), distances.valuePtr() + distances.nonZeros());
  for (const Part& part : parts) {
    for (const Index size : part.sizes) offsets.push_back(offsets.back() + size);
    columns.insert(columns.end(), part.nodes.begin(), part.nodes.end());
    values.insert(values.end(), part.values.begin(), part.values.end());
  }
  return Eigen::Map<const SparseRows>(space.size(), distances.cols(), static_cast<Index>(columns.size()),
                                      offsets.data(), columns.data(), values.data());
}

/// Scales the weights of nodes off a boundary part by a ramp that is zero on it and one at the node's spacing away.
template <int Dim> SparseRows vanish(SparseRows weights, const FineSpace<Dim>& space,
                                     const std::vector<std::array<Index, 2>>& edges, const NodeCloud<Dim>& cloud,
                                     const std::vector<std::string>& parts) {
  const FineMesh<Dim>& mesh = space.mesh();
  if (cloud.size() == 0) return weights;
  for (const std::string& part : parts) {
    std::vector<char> on_part(space.size(), 0);
    for (Index f : mesh.group(part))
      for (const Index dof : space.facet(f)) on_part[dof] = 1;
    std::vector<Index> sources;
    for (Index v = 0; v < mesh.num_vertices(); ++v)
      if (on_part[v]) sources.push_back(v);
    if (sources.empty()) throw InputError(fmt::format("boundary part \"{}\" is empty", part));
    const Vector distance = nearest_source(mesh, sources, cloud.spacing.maxCoeff()).distance;
    for (Index dof = 0; dof < space.size(); ++dof) {
      double away = dof < mesh.num_vertices() ? distance[dof] : 0.0;
      if (dof >= mesh.num_vertices()) {
        const auto [a, b] = edges[dof - mesh.num_vertices()];
        // An edge through the body from one place on the part to another is off it in the middle.
        away = std::max(0.5 * (distance[a] + distance[b]), 0.25 * (mesh.vertex(a) - mesh.vertex(b)).norm());
      }
      for (SparseRows::InnerIterator entry(weights, dof); entry; ++entry)
        if (!on_part[cloud.vertices[entry.col()]]) {
          const double q = std::min(1.0, away / cloud.spacing[entry.col()]);
          entry.valueRef() *= on_part[dof] ? 0.0 : q * (2.0 - q);
        }
    }
  }
  if (!parts.empty()) weights.prune([](Index, Index, double value) { return value > 0.0; });
  return weights;
}

/// Raises the radii of the nodes geodesically nearest to the bad vertices to 1.25 times their distance. Returns the
/// nodes changed, ascending.
template <int Dim> std::vector<Index> grow_supports(const FineMesh<Dim>& mesh, const NodeCloud<Dim>& cloud,
                                                    const MlsOptions& options, const std::vector<Index>& bad,
                                                    Vector& radii) {
  const std::size_t wanted = num_polynomials<Dim>(options.order) + 2;
  std::vector<Index> node_at(mesh.num_vertices(), -1), nodes_in(mesh.num_components(), 0);
  for (Index I = 0; I < cloud.size(); ++I) {
    node_at[cloud.vertices[I]] = I;
    ++nodes_in[mesh.component()[cloud.vertices[I]]];
  }
  const Weight engine = options.weights.weight == Weight::heat_flow ? Weight::fast_marching : options.weights.weight;
  const Geodesics<Dim> geodesics(mesh, {.engine = engine});
  const double diameter = (mesh.vertices().rowwise().maxCoeff() - mesh.vertices().rowwise().minCoeff()).norm();
  const Vector before = radii;
  std::vector<char> handled(mesh.num_vertices(), 0);
  for (Index v : bad) {
    if (handled[v]) continue;
    const auto available = static_cast<std::size_t>(nodes_in[mesh.component()[v]]);
    std::vector<std::pair<double, Index>> near;
    LocalField field;
    for (double reach = 1.5 * radii.maxCoeff();; reach *= 1.5) {
      field = geodesics.from(v, reach);
      near.clear();
      for (std::size_t k = 0; k < field.vertices.size(); ++k)
        if (node_at[field.vertices[k]] >= 0) near.emplace_back(field.values[k], node_at[field.vertices[k]]);
      if (near.size() >= std::min(wanted, available) || reach > 8.0 * diameter) break;
    }
    // Nodes that see the vertex already come first; what lacks are further ones, so count the wanted among all.
    std::sort(near.begin(), near.end());
    std::size_t taken = 0;
    double farthest = 0.0;
    bool grew = false;
    for (const auto& [distance, I] : near) {
      if (taken >= wanted && grew) break;
      ++taken;
      farthest = distance;
      if (1.25 * distance > radii[I]) {
        radii[I] = 1.25 * distance;
        grew = true;
      }
    }
    for (std::size_t k = 0; k < field.vertices.size(); ++k)
      if (field.values[k] < 0.25 * farthest) handled[field.vertices[k]] = 1;
  }
  std::vector<Index> changed;
  for (Index I = 0; I < cloud.size(); ++I)
    if (radii[I] > before[I]) changed.push_back(I);
  return changed;
}

/// Whether the body that each degree of freedom of the space is in has as many nodes as there are polynomials.
template <int Dim> std::vector<char> has_enough_nodes(const FineSpace<Dim>& space,
                                                      const std::vector<std::array<Index, 2>>& edges,
                                                      const NodeCloud<Dim>& cloud, int order) {
  const FineMesh<Dim>& mesh = space.mesh();
  std::vector<Index> nodes_in(mesh.num_components(), 0);
  for (const Index v : cloud.vertices) ++nodes_in[mesh.component()[v]];
  std::vector<char> enough(space.size());
  for (Index dof = 0; dof < space.size(); ++dof) {
    const Index v = dof < mesh.num_vertices() ? dof : edges[dof - mesh.num_vertices()][0];
    enough[dof] = nodes_in[mesh.component()[v]] >= num_polynomials<Dim>(order);
  }
  return enough;
}

/// The table with rows for all degrees of freedom, each of `own` a node of its own after those of the cloud.
template <int Dim> ShapeTable<Dim> with_own_functions(const SparseRows& weights, std::vector<double> N, Index nodes,
                                                      const std::vector<Index>& own) {
  if (own.empty())
    return ShapeTable<Dim>(nodes, {weights.outerIndexPtr(), weights.outerIndexPtr() + weights.rows() + 1},
                           {weights.innerIndexPtr(), weights.innerIndexPtr() + weights.nonZeros()}, std::move(N));
  std::vector<Offset> offsets{0};
  std::vector<Index> columns;
  std::vector<double> values;
  Index number = 0;
  for (Index row = 0; row < weights.rows(); ++row) {
    const auto first = weights.outerIndexPtr()[row], last = weights.outerIndexPtr()[row + 1];
    if (number < static_cast<Index>(own.size()) && own[number] == row) {
      columns.push_back(nodes + number++);
      values.push_back(1.0);
    } else {
      columns.insert(columns.end(), weights.innerIndexPtr() + first, weights.innerIndexPtr() + last);
      values.insert(values.end(), N.begin() + first, N.begin() + last);
    }
    offsets.push_back(static_cast<Offset>(columns.size()));
  }
  return {nodes + number, std::move(offsets), std::move(columns), std::move(values)};
}

}  // namespace

template <int Dim> bool determine_polynomials(const Points<Dim>& points, int order) {
  const Index n = num_polynomials<Dim>(order), count = static_cast<Index>(points.cols());
  if (count < n) return false;
  const Vec<Dim> centre = points.rowwise().mean();
  const double radius = (points.colwise() - centre).colwise().norm().maxCoeff();
  Matrix values(count, n);
  for (Index k = 0; k < count; ++k) {
    const Vec<Dim> xi = (points.col(k) - centre) / radius;
    if (order == 1)
      values.row(k) = monomials<Dim, 1>(xi).transpose();
    else
      values.row(k) = monomials<Dim, 2>(xi).transpose();
  }
  const Vector spread = internal::eigenvalues<Eigen::Dynamic>(values.transpose() * values);
  return spread[0] > 1e-8 * spread[n - 1];
}

template <int Dim> Mls<Dim> moving_least_squares(const FineSpace<Dim>& space, const NodeCloud<Dim>& cloud,
                                                 const MlsOptions& options, const Monitor& monitor) {
  if (options.order != 1 && options.order != 2)
    throw InputError(fmt::format("MLS of order {}, expected 1 or 2", options.order));
  if (!(options.support > 0.5 && options.support < 100.0))
    throw InputError(
        fmt::format("support = {} (in units of the spacing), expected a number in (0.5, 100)", options.support));
  const FineMesh<Dim>& mesh = space.mesh();
  const bool by_distance = space.degree() == 2;
  if (by_distance && options.weights.weight == Weight::heat_flow)
    throw internal::SettingError(
        "cloud.weight",
        "moving least squares: heat_flow weights have no distances, which degree 2 needs; use degree 1");
  const auto edges = space.edges();
  Mls<Dim> result;
  result.radii = options.support * cloud.spacing;

  // Of vertices: weights, or distances where those of midpoints are made of them.
  const auto measure = [&](const std::vector<Index>& sources, const Vector& radii) {
    return by_distance ? node_distances(mesh, sources, radii, options.weights.weight)
                       : node_weights(mesh, sources, radii, options.weights);
  };
  const auto all_weights = [&](const SparseRows& at_vertices) {
    if (!by_distance) return vanish(at_vertices, space, edges, cloud, options.vanish_on);
    SparseRows all = with_midpoints(at_vertices, space, edges, cloud, result.radii);
    parallel_for(all.rows(), [&](Index row) {
      for (SparseRows::InnerIterator entry(all, row); entry; ++entry)
        entry.valueRef() = kernel_value(options.weights.kernel, entry.value() / result.radii[entry.col()]);
    });
    return vanish(std::move(all), space, edges, cloud, options.vanish_on);
  };
  SparseRows plain, weights;
  {
    Stage stage("weights", monitor);
    plain = measure(cloud.vertices, result.radii);
    weights = all_weights(plain);
  }
  Stage stage("basis", monitor);
  std::vector<double> N;
  Vector sums;
  std::vector<RowQuality> quality;
  std::vector<char> asked(space.size(), 0);
  const std::vector<char> can_grow = has_enough_nodes(space, edges, cloud, options.order);
  constexpr int max_rounds = 12;
  for (int round = 0;; ++round) {
    stage.check();
    quality = solve_rows(space.points(), cloud, options, weights, N, sums);
    if (round == max_rounds) break;
    std::vector<Index> places;  // a bad midpoint counts as one end of its edge
    for (Index v = 0; v < space.size(); ++v) {
      if (quality[v] == RowQuality::good || !can_grow[v]) continue;
      asked[v] = 1;
      places.push_back(v < mesh.num_vertices() ? v : edges[v - mesh.num_vertices()][0]);
    }
    if (places.empty()) break;
    const auto changed = grow_supports(mesh, cloud, options, places, result.radii);
    if (changed.empty()) break;  // every node in the body takes part already; report::largest_sum tells how well
    std::vector<Index> sources;
    Vector radii(changed.size());
    for (std::size_t k = 0; k < changed.size(); ++k) {
      sources.push_back(cloud.vertices[changed[k]]);
      radii[static_cast<Index>(k)] = result.radii[changed[k]];
    }
    plain = replace_columns(plain, changed, measure(sources, radii));
    weights = all_weights(plain);
  }

  result.report.grown_vertices = static_cast<Index>(std::count(asked.begin(), asked.end(), 1));
  const Vector growth = result.radii.cwiseQuotient(options.support * cloud.spacing);
  result.report.grown_nodes = static_cast<Index>((growth.array() > 1.0).count());
  if (growth.size() > 0) result.report.largest_growth = growth.maxCoeff();
  std::vector<Index> own;
  for (Index v = 0; v < space.size(); ++v)
    if (quality[v] == RowQuality::singular) own.push_back(v), sums[v] = 1.0;
  result.report.own_functions = static_cast<Index>(own.size());
  result.report.largest_sum = sums.maxCoeff();
  result.shape = with_own_functions<Dim>(weights, std::move(N), cloud.size(), own);
  result.node_dofs = cloud.vertices;
  result.node_dofs.insert(result.node_dofs.end(), own.begin(), own.end());
  return result;
}

template <int Dim> Mls<Dim> moving_least_squares(const FineMesh<Dim>& mesh, const NodeCloud<Dim>& cloud,
                                                 const MlsOptions& options, const Monitor& monitor) {
  return moving_least_squares(FineSpace<Dim>(mesh, 1), cloud, options, monitor);
}

template bool determine_polynomials<2>(const Points<2>&, int);
template bool determine_polynomials<3>(const Points<3>&, int);
template Mls<2> moving_least_squares<2>(const FineSpace<2>&, const NodeCloud<2>&, const MlsOptions&, const Monitor&);
template Mls<3> moving_least_squares<3>(const FineSpace<3>&, const NodeCloud<3>&, const MlsOptions&, const Monitor&);
template Mls<2> moving_least_squares<2>(const FineMesh<2>&, const NodeCloud<2>&, const MlsOptions&, const Monitor&);
template Mls<3> moving_least_squares<3>(const FineMesh<3>&, const NodeCloud<3>&, const MlsOptions&, const Monitor&);

}  // namespace efree
