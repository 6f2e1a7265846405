// SPDX-License-Identifier: GPL-3.0-or-later
/// Shape functions whose gradients, summed over the points, integrate exactly.
#include "efree/core/parallel.hpp"
#include "efree/dynamics/internal/kernels.hpp"
#include "efree/dynamics/points.hpp"
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace efree::internal {
namespace {

/// Largest change of the logarithm of a shape function at once.
constexpr double largest_change = 1.0;
/// Residual of the sums that may be left, over that at first and over that before each iteration of Newton's method.
constexpr double enough = 1e-2, enough_at_once = 0.1;
constexpr int most_times = 3, most_iterations = 15, most_newton_iterations = 30;

/// Gradients of the linear functions of a cell, by columns; no numbers if the cell is flat.
template <int Dim> Eigen::Matrix<double, Dim, Dim + 1> slopes_of(const Eigen::Matrix<double, Dim, Dim + 1>& corner) {
  Eigen::Matrix<double, Dim, Dim + 1> slope;
  const Mat<Dim> edges = corner.template rightCols<Dim>().colwise() - corner.col(0);
  slope.template rightCols<Dim>() = edges.inverse().transpose();
  slope.col(0) = -slope.template rightCols<Dim>().rowwise().sum();
  return slope;
}

/// Scales positive weights by factors exp(-lambda . offset) such that they sum up to one and have their mean at zero:
/// the least change by its entropy. Newton's method, whose last step is taken on the weights. Returns their second
/// moments in `moment`. False, and the weights are of no use, if it does not converge.
template <int Dim> bool centre(const std::vector<Vec<Dim>>& offset, std::vector<double>& weight, Mat<Dim>& moment) {
  const std::size_t count = weight.size();
  for (int k = 0; k < most_newton_iterations; ++k) {
    double sum = 0.0;
    Vec<Dim> mean = Vec<Dim>::Zero();
    moment.setZero();
    for (std::size_t a = 0; a < count; ++a) {
      sum += weight[a];
      mean += weight[a] * offset[a];
      moment += weight[a] * offset[a] * offset[a].transpose();
    }
    mean /= sum;
    moment /= sum;
    const Vec<Dim> step = (moment - mean * mean.transpose()).inverse() * mean;
    const double decrement = step.dot(mean);
    if (!(decrement >= 0.0)) return false;
    const bool is_last = decrement < 1e-10;
    const double length = 1.0 / (1.0 + std::sqrt(decrement));
    for (std::size_t a = 0; a < count; ++a)
      weight[a] *= (is_last ? 1.0 - step.dot(offset[a] - mean) : std::exp(-length * step.dot(offset[a]))) / sum;
    if (!is_last) continue;
    moment.setZero();
    for (std::size_t a = 0; a < count; ++a) moment += weight[a] * offset[a] * offset[a].transpose();
    return true;
  }
  return false;
}

/// Changes of the shape functions of a chunk, as weight_changes takes and gives them.
struct WeightChanges {
  AlignedVector<double> x, at, multipliers;
  std::vector<Mat<3>> inverse, moment;
  std::vector<double> weight;  ///< by how much they change
};

/// Newton's method on multipliers of the sums, of all nodes.
template <int Dim> class ExactIntegration {
 public:
  explicit ExactIntegration(World<Dim>& world) : world_(world) {}
  void run();

 private:
  bool integrates(const Chunk<Dim>& chunk) const { return world_.bodies[chunk.body].cells.cols() != 0; }
  template <class Body> void for_each_chunk(const Body& body) {
    parallel_chunks(static_cast<Index>(world_.chunks.size()), 1, [&](Index c, Index) { body(world_.chunks[c]); });
  }
  Points<Dim> residual();
  void find_changes(const Chunk<Dim>& chunk, const Points<Dim>& multipliers, WeightChanges& found) const;
  Points<Dim> integrated_changes(const Points<Dim>& multipliers);
  void change(const Points<Dim>& multipliers);
  std::vector<Mat<Dim>> scales() const;

  World<Dim>& world_;
};

/// What sums over points of volumes times gradients (and, in an axisymmetric section, values over the radius) lack of
/// those of the linear functions of the cells, which are integrals over the surface.
template <int Dim> Points<Dim> ExactIntegration<Dim>::residual() {
  const bool axisymmetric = world_.axisymmetric();
  for_each_chunk([&](Chunk<Dim>& chunk) {
    PointTable<Dim>& table = chunk.table;
    std::fill(table.force.begin(), table.force.end(), 0.0);
    if (!integrates(chunk)) return;
    for (Index p = 0; p < chunk.size(); ++p)
      for (Index e = table.offsets[p]; e < table.offsets[p + 1]; ++e) {
        const TableEntry& entry = table.entries[e];
        double* sum = table.force.data() + 4 * table.local[e];
        for (int i = 0; i < Dim; ++i) sum[i] -= chunk.matter.volume[p] * entry.dN[i];
        if (axisymmetric) sum[0] -= chunk.matter.volume[p] * entry.dN[2];
      }
  });
  Points<Dim> result;
  collect_forces(world_, result);
  for (const Chunk<Dim>& chunk : world_.chunks) {
    if (!integrates(chunk)) continue;
    const Index first = world_.first_node[chunk.body];
    for (Index p = 0; p < chunk.size(); ++p) {
      Eigen::Matrix<double, Dim, Dim + 1> corner;
      const auto cell = world_.bodies[chunk.body].cells.col(chunk.number[p]);
      for (int k = 0; k <= Dim; ++k) corner.col(k) = world_.nodes.x.col(first + cell[k]);
      Eigen::Matrix<double, Dim, Dim + 1> slope = slopes_of<Dim>(corner);
      if (axisymmetric) slope.row(0).array() += 1.0 / ((Dim + 1) * chunk.matter.x(0, p));
      for (int k = 0; k <= Dim; ++k) result.col(first + cell[k]) += chunk.matter.volume[p] * slope.col(k);
    }
  }
  return result;
}

/// Changes of weights in a chunk by multipliers. What changes cost is the same at all points, however large: fine parts
/// of a mesh are no less well off than coarse ones.
template <int Dim> void ExactIntegration<Dim>::find_changes(const Chunk<Dim>& chunk, const Points<Dim>& multipliers,
                                                            WeightChanges& found) const {
  const PointTable<Dim>& table = chunk.table;
  const Index n = chunk.size();
  found.x.assign(table.x.size(), 0.0);
  found.multipliers.assign(table.x.size(), 0.0);
  found.at.assign(4 * n, 0.0);
  found.inverse.assign(n, Mat<3>::Zero());
  found.moment.resize(n);
  found.weight.resize(table.entries.size());
  for (std::size_t l = 0; l < table.nodes.size(); ++l)
    for (int i = 0; i < Dim; ++i) {
      found.x[4 * l + i] = world_.nodes.x(i, table.nodes[l]);
      found.multipliers[4 * l + i] = multipliers(i, table.nodes[l]);
    }
  if (world_.axisymmetric())
    for (std::size_t l = 0; l < table.nodes.size(); ++l) found.multipliers[4 * l + 2] = found.multipliers[4 * l];
  for (Index p = 0; p < n; ++p) {
    for (int i = 0; i < Dim; ++i) found.at[4 * p + i] = chunk.matter.x(i, p);
    found.inverse[p].template topLeftCorner<Dim, Dim>() = chunk.support.moment[p].inverse();
  }
  weight_changes(n, table.offsets.data(), table.local.data(), table.entries.data(), found.x.data(), found.at.data(),
                 found.inverse.data(), chunk.matter.volume.data(), world_.axisymmetric(), found.multipliers.data(),
                 found.weight.data(), found.moment.data());
}

/// Changes of the sums by multipliers, to first order.
template <int Dim> Points<Dim> ExactIntegration<Dim>::integrated_changes(const Points<Dim>& multipliers) {
  for_each_chunk([&](Chunk<Dim>& chunk) {
    PointTable<Dim>& table = chunk.table;
    std::fill(table.force.begin(), table.force.end(), 0.0);
    if (!integrates(chunk)) return;
    thread_local WeightChanges found;
    find_changes(chunk, multipliers, found);
    gradient_changes(chunk.size(), table.offsets.data(), table.local.data(), table.entries.data(), found.x.data(),
                     found.at.data(), found.inverse.data(), chunk.matter.volume.data(), world_.axisymmetric(),
                     found.weight.data(), found.moment.data(), table.force.data());
  });
  Points<Dim> result;
  collect_forces(world_, result);
  return result;
}

/// Changes weights as multipliers ask for, by factors, within bounds; gradients follow.
template <int Dim> void ExactIntegration<Dim>::change(const Points<Dim>& multipliers) {
  const bool axisymmetric = world_.axisymmetric();
  for_each_chunk([&](Chunk<Dim>& chunk) {
    if (!integrates(chunk)) return;
    thread_local WeightChanges found;
    find_changes(chunk, multipliers, found);
    PointTable<Dim>& table = chunk.table;
    Support<Dim>& support = chunk.support;
    std::vector<Vec<Dim>> offset;
    std::vector<double> weight;
    for (Index p = 0; p < chunk.size(); ++p) {
      const Index begin = table.offsets[p], count = table.offsets[p + 1] - begin;
      TableEntry* entries = table.entries.data() + begin;
      offset.resize(count);
      weight.resize(count);
      for (Index k = 0; k < count; ++k) {
        const double share = entries[k].N > 0.0 ? found.weight[begin + k] / entries[k].N : 0.0;
        weight[k] = entries[k].N * std::exp(std::clamp(share, -largest_change, largest_change));
        offset[k] = world_.nodes.x.col(table.nodes[table.local[begin + k]]) - chunk.matter.x.col(p);
      }
      Mat<Dim> moment;
      if (!centre<Dim>(offset, weight, moment)) continue;
      const Mat<Dim> inverse = moment.inverse();
      for (Index k = 0; k < count; ++k) {
        entries[k].N = weight[k];
        Eigen::Map<Vec<Dim>>(entries[k].dN) = entries[k].N * (inverse * offset[k]);
        if (axisymmetric) entries[k].dN[2] = entries[k].N / chunk.matter.x(0, p);
      }
      complete_row<Dim>(count, [&](std::size_t k) -> TableEntry& { return entries[k]; });
      support.stabilisation[p] *= inverse.trace() / support.moment[p].inverse().trace();
      support.moment[p] = moment;
    }
  });
}

/// By node, the inverse of the changes of its sums by the weights of its own points, others apart.
template <int Dim> std::vector<Mat<Dim>> ExactIntegration<Dim>::scales() const {
  std::vector<Mat<Dim>> scale(world_.nodes.size(), Mat<Dim>::Zero());
  for (const Chunk<Dim>& chunk : world_.chunks) {
    if (!integrates(chunk)) continue;
    const PointTable<Dim>& table = chunk.table;
    for (Index p = 0; p < chunk.size(); ++p)
      for (Index e = table.offsets[p]; e < table.offsets[p + 1]; ++e) {
        const TableEntry& entry = table.entries[e];
        if (!(entry.N > 0.0)) continue;
        const Vec<Dim> slope = chunk.matter.volume[p] * Eigen::Map<const Vec<Dim>>(entry.dN);
        scale[table.nodes[table.local[e]]] += slope * slope.transpose() / entry.N;
      }
  }
  for (Mat<Dim>& of : scale)
    if (const double size = of.trace(); size > 0.0) of = (of + 1e-6 * size * Mat<Dim>::Identity()).inverse().eval();
  return scale;
}

template <int Dim> void ExactIntegration<Dim>::run() {
  double first = 0.0;
  for (int k = 0; k < most_times; ++k) {
    Points<Dim> off = residual();
    const std::vector<Mat<Dim>> scale = scales();
    const auto scaled = [&](const Points<Dim>& of) {
      Points<Dim> result(Dim, of.cols());
      for (Eigen::Index a = 0; a < of.cols(); ++a) result.col(a) = scale[a] * of.col(a);
      return result;
    };
    Points<Dim> multipliers = Points<Dim>::Zero(Dim, world_.nodes.size()), weighted = scaled(off), direction = weighted;
    double size = off.cwiseProduct(weighted).sum();
    const double start = size;
    if (k == 0) first = start;
    if (!(start > enough * enough * first)) return;
    for (int i = 0; i < most_iterations && size > enough_at_once * enough_at_once * start; ++i) {
      const Points<Dim> more = integrated_changes(direction);
      const double length = size / direction.cwiseProduct(more).sum();
      if (!std::isfinite(length)) break;
      multipliers += length * direction;
      off -= length * more;
      weighted = scaled(off);
      const double next = off.cwiseProduct(weighted).sum();
      direction = weighted + next / size * direction;
      size = next;
    }
    change(multipliers);
  }
}

}  // namespace

/// Weights of points are changed, as little as it takes, until a stress that is the same everywhere is in balance
/// (variational consistency, Chen, Hillman & Rueter 2013). Newton's method; conjugate gradients on the multipliers of
/// each of its steps. Sums are measured by what weights change of them at each node.
template <int Dim> void integrate_exactly(World<Dim>& world, OtmState<Dim>& state) {
  if (std::ranges::none_of(world.bodies, [](const auto& body) { return body.cells.cols() != 0; })) return;
  ExactIntegration<Dim>(world).run();
  for (std::size_t c = 0; c < world.chunks.size(); ++c)
    for (Index p = 0; p < world.chunks[c].size(); ++p)
      state.points[c].width[p] = smallest_width<Dim>(world.chunks[c].support.moment[p]);
}

template void integrate_exactly(World<2>&, OtmState<2>&);
template void integrate_exactly(World<3>&, OtmState<3>&);

}  // namespace efree::internal
