// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/heatgeo/internal/heat.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <array>
#include <cmath>

namespace efree {
namespace {

using SparseMatrix = Eigen::SparseMatrix<double, Eigen::ColMajor, Index>;
using Factorization = Eigen::SimplicialLLT<SparseMatrix, Eigen::Lower>;  // on patches faster than CHOLMOD

/// Beyond the radius by this many diffusion lengths, so that what happens at the rim is not felt inside.
constexpr double margin_in_diffusion_lengths = 3.0;

}  // namespace

template <int Dim> struct PatchHeat<Dim>::Impl {
  const FineMesh<Dim>& mesh;
  double heat_time;
  PatchFinder<Dim> finder;
  std::vector<Index> cells, vertices;  ///< of the patch in hand
  std::vector<Index> local, cell_seen;
  Factorization factorization;

  Impl(const FineMesh<Dim>& m, double time)
      : mesh(m), heat_time(time), finder(m), local(m.num_vertices(), -1), cell_seen(m.num_cells(), 0) {}

  void clear() {
    for (Index v : vertices) local[v] = -1;
    for (Index c : cells) cell_seen[c] = 0;
    vertices.clear();
    cells.clear();
  }

  void add(const Patch<Dim>& patch) {
    for (Index c : patch.cells)
      if (!cell_seen[c]) {
        cell_seen[c] = 1;
        cells.push_back(c);
      }
    for (Index v : patch.vertices)
      if (local[v] < 0) {
        local[v] = static_cast<Index>(vertices.size());
        vertices.push_back(v);
      }
  }

  double mean_squared_edge() const {
    double length = 0.0;
    for (Index c : cells)
      for (int i = 0; i <= Dim; ++i)
        for (int j = 0; j < i; ++j)
          length += (mesh.vertex(mesh.cells()(i, c)) - mesh.vertex(mesh.cells()(j, c))).norm();
    length /= 0.5 * Dim * (Dim + 1) * static_cast<double>(cells.size());
    return length * length;
  }

  Vector lumped_mass() const {
    Vector mass = Vector::Zero(static_cast<Index>(vertices.size()));
    for (Index c : cells)
      for (int i = 0; i <= Dim; ++i) mass[local[mesh.cells()(i, c)]] += mesh.volume(c) / (Dim + 1);
    return mass;
  }

  /// Lower triangle of the P1 stiffness plus a zero diagonal entry everywhere.
  SparseMatrix stiffness() const {
    std::vector<Eigen::Triplet<double, Index>> entries;
    entries.reserve((Dim + 1) * (Dim + 2) / 2 * cells.size());
    for (Index c : cells) {
      const auto gradients = mesh.hat_gradients(c);
      const Mat<Dim + 1> k = mesh.volume(c) * gradients.transpose() * gradients;
      for (int i = 0; i <= Dim; ++i)
        for (int j = 0; j <= Dim; ++j) {
          const Index row = local[mesh.cells()(i, c)], column = local[mesh.cells()(j, c)];
          if (row >= column) entries.emplace_back(row, column, k(i, j));
        }
    }
    const Index n = static_cast<Index>(vertices.size());
    SparseMatrix matrix(n, n);
    matrix.setFromTriplets(entries.begin(), entries.end());
    return matrix;
  }

  void factorize(const SparseMatrix& stiffness, double stiffness_factor, const Vector& diagonal) {
    SparseMatrix matrix = stiffness_factor * stiffness;
    matrix.diagonal() += diagonal;
    factorization.factorize(matrix);
    if (factorization.info() != Eigen::Success)
      throw NumericalError(fmt::format("heat: factorisation failed on a patch of {} vertices around vertex {}",
                                       vertices.size(), vertices.front()));
  }

  /// Integrated divergence of the unit vectors against the gradient of heat: right-hand side of the Poisson problem.
  Matrix divergence_of_directions(const Matrix& heat) const {
    Matrix divergence = Matrix::Zero(heat.rows(), heat.cols());
    for (Index c : cells) {
      const auto gradients = mesh.hat_gradients(c);
      std::array<Index, Dim + 1> rows;
      for (int i = 0; i <= Dim; ++i) rows[i] = local[mesh.cells()(i, c)];
      for (Index s = 0; s < heat.cols(); ++s) {
        Vec<Dim> gradient = Vec<Dim>::Zero();
        for (int i = 0; i <= Dim; ++i) gradient += heat(rows[i], s) * gradients.col(i);
        const double size = gradient.norm();
        if (!(size > 0.0)) continue;  // no heat got here
        for (int i = 0; i <= Dim; ++i) divergence(rows[i], s) -= mesh.volume(c) / size * gradient.dot(gradients.col(i));
      }
    }
    return divergence;
  }
};

template <int Dim> PatchHeat<Dim>::PatchHeat(const FineMesh<Dim>& mesh, double heat_time)
    : impl_(std::make_unique<Impl>(mesh, heat_time)) {}
template <int Dim> PatchHeat<Dim>::~PatchHeat() = default;

template <int Dim>
std::vector<LocalField> PatchHeat<Dim>::distances(std::span<const Index> sources, std::span<const double> radii) {
  Impl& p = *impl_;
  const Index count = static_cast<Index>(sources.size());
  p.clear();
  p.add(p.finder.around(sources[0], radii[0]));
  const double margin = margin_in_diffusion_lengths * std::sqrt(p.heat_time * p.mean_squared_edge());
  for (Index s = 0; s < count; ++s) p.add(p.finder.around(sources[s], radii[s] + margin));

  const Vector mass = p.lumped_mass();
  const SparseMatrix stiffness = p.stiffness();
  Matrix heat = Matrix::Zero(mass.size(), count);
  for (Index s = 0; s < count; ++s) heat(p.local[sources[s]], s) = 1.0;
  p.factorization.analyzePattern(stiffness);
  p.factorize(stiffness, p.heat_time * p.mean_squared_edge(), mass);
  heat = p.factorization.solve(heat).eval();

  // A trace of mass fixes the constant on every component of the patch; the shift below takes it out again.
  p.factorize(stiffness, 1.0, 1e-9 / mass.sum() * mass);
  const Matrix distance = p.factorization.solve(p.divergence_of_directions(heat));

  std::vector<LocalField> fields(sources.size());
  for (Index s = 0; s < count; ++s) {
    const Patch<Dim>& patch = p.finder.around(sources[s], radii[s]);
    const double shift = distance(p.local[sources[s]], s);
    for (std::size_t k = 0; k < patch.vertices.size(); ++k) {
      // No path is shorter than the straight line.
      const double d = std::max(distance(p.local[patch.vertices[k]], s) - shift, patch.distances[k]);
      if (!std::isfinite(d)) throw NumericalError(fmt::format("heat: no distance at vertex {}", patch.vertices[k]));
      if (d >= radii[s]) continue;
      fields[s].vertices.push_back(patch.vertices[k]);
      fields[s].values.push_back(d);
    }
  }
  return fields;
}

template <int Dim> LocalField PatchHeat<Dim>::flow(Index source, double radius, int steps, double time_factor) {
  Impl& p = *impl_;
  p.clear();
  const Patch<Dim>& patch = p.finder.around(source, radius);
  p.add(patch);
  // Zero heat outside the ball: an overwhelming mass there keeps the system's pattern simple and symmetric.
  Vector mass = p.lumped_mass(), fixed = Vector::Zero(mass.size());
  const SparseMatrix stiffness = p.stiffness();
  const double dt = time_factor * radius * radius / steps;
  const double huge = 1e12 * (mass.maxCoeff() + dt * stiffness.diagonal().maxCoeff());
  for (Index k = 0; k < mass.size(); ++k)
    if (patch.distances[k] >= radius) fixed[k] = huge;
  p.factorization.analyzePattern(stiffness);
  p.factorize(stiffness, dt, mass + fixed);
  Vector heat = Vector::Unit(mass.size(), p.local[source]);
  for (int step = 0; step < steps; ++step) {
    if (step > 0) heat.array() *= mass.array();
    heat = p.factorization.solve(heat).eval();
  }
  const double top = heat.maxCoeff();
  LocalField field;
  for (Index k = 0; k < mass.size(); ++k)
    if (patch.distances[k] < radius && heat[k] > 0.0) {
      field.vertices.push_back(patch.vertices[k]);
      field.values.push_back(heat[k] / top);
    }
  return field;
}

std::optional<FineMesh<2>> delaunay_mesh(const FineMesh<2>& mesh) {
  Cells<2> cells = delaunay_cells(mesh);
  if (cells == mesh.cells()) return std::nullopt;
  return FineMesh<2>(MeshData<2>{mesh.vertices(), std::move(cells), {}});
}

template class PatchHeat<2>;
template class PatchHeat<3>;

}  // namespace efree
