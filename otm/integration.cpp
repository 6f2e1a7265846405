// SPDX-License-Identifier: GPL-3.0-or-later
/// Gradients at points that sum up to what they are gradients of, as integrals do.
#include "efree/core/parallel.hpp"
#include "efree/otm/internal/motion.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace efree::internal {
namespace {

/// Logarithms of weights change by at most this at once.
constexpr double largest_change = 1.0;
/// What may be left of what sums are off, and of what is left each time.
constexpr double enough = 1e-2, enough_at_once = 0.1;
constexpr int most_times = 3, most_iterations = 15, most_tilts = 30;

/// Gradients of the linear functions of a cell, by columns; no numbers if the cell is flat.
template <int Dim> Eigen::Matrix<double, Dim, Dim + 1> slopes_of(const Eigen::Matrix<double, Dim, Dim + 1>& corner) {
  Eigen::Matrix<double, Dim, Dim + 1> slope;
  const Mat<Dim> edges = corner.template rightCols<Dim>().colwise() - corner.col(0);
  slope.template rightCols<Dim>() = edges.inverse().transpose();
  slope.col(0) = -slope.template rightCols<Dim>().rowwise().sum();
  return slope;
}

/// Makes positive weights sum up to one and have their mean at zero, by factors exp(-lambda . offset): the least change
/// by its entropy. Newton's method, whose last step is taken on the weights. Says their second moments. False, and the
/// weights are of no use, if that leads nowhere.
template <int Dim> bool centre(const std::vector<Vec<Dim>>& offset, std::vector<double>& weight, Mat<Dim>& moment) {
  const std::size_t count = weight.size();
  for (int k = 0; k < most_tilts; ++k) {
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

}  // namespace

/// What sums over points of volumes times gradients (and, around an axis, values over the radius) lack of those of the
/// linear functions of the cells, which are integrals over the surface.
template <int Dim> Points<Dim> Motion<Dim>::integration_error() {
  parallel_chunks(static_cast<Index>(chunks.size()), 1, [&](Index c, Index) {
    OtmChunk<Dim>& chunk = chunks[c];
    std::fill(chunk.force.begin(), chunk.force.end(), 0.0);
    if (!bodies[chunk.body].integrates) return;
    for (Index p = 0; p < chunk.size(); ++p)
      for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e) {
        const OtmEntry& entry = chunk.entries[e];
        double* sum = chunk.force.data() + 4 * chunk.local[e];
        for (int i = 0; i < Dim; ++i) sum[i] -= chunk.volume[p] * entry.dN[i];
        if (axisymmetric()) sum[0] -= chunk.volume[p] * entry.dN[2];
      }
  });
  Points<Dim> result = collected();
  for (const OtmChunk<Dim>& chunk : chunks) {
    const BodyOf& body = bodies[chunk.body];
    if (!body.integrates) continue;
    for (Index p = 0; p < chunk.size(); ++p) {
      Eigen::Matrix<double, Dim, Dim + 1> corner;
      const auto cell = body.cells.col(chunk.number[p]);
      for (int k = 0; k <= Dim; ++k) corner.col(k) = x.col(body.first_node + cell[k]);
      Eigen::Matrix<double, Dim, Dim + 1> slope = slopes_of<Dim>(corner);
      if (axisymmetric()) slope.row(0).array() += 1.0 / ((Dim + 1) * chunk.at(0, p));
      for (int k = 0; k <= Dim; ++k) result.col(body.first_node + cell[k]) += chunk.volume[p] * slope.col(k);
    }
  }
  return result;
}

/// Changes of weights in a chunk that multipliers ask for. What changes cost is the same at all points, however large:
/// fine parts of a mesh are no less well off than coarse ones.
template <int Dim>
void Motion<Dim>::find_changes(const OtmChunk<Dim>& chunk, const Points<Dim>& multipliers, WeightChanges& found) const {
  const Index n = chunk.size();
  found.x.assign(chunk.x.size(), 0.0);
  found.multipliers.assign(chunk.x.size(), 0.0);
  found.at.assign(4 * n, 0.0);
  found.inverse.assign(n, Mat<3>::Zero());
  found.moment.resize(n);
  found.weight.resize(chunk.entries.size());
  for (std::size_t l = 0; l < chunk.nodes.size(); ++l)
    for (int i = 0; i < Dim; ++i) {
      found.x[4 * l + i] = x(i, chunk.nodes[l]);
      found.multipliers[4 * l + i] = multipliers(i, chunk.nodes[l]);
    }
  if (axisymmetric())
    for (std::size_t l = 0; l < chunk.nodes.size(); ++l) found.multipliers[4 * l + 2] = found.multipliers[4 * l];
  for (Index p = 0; p < n; ++p) {
    for (int i = 0; i < Dim; ++i) found.at[4 * p + i] = chunk.at(i, p);
    found.inverse[p].template topLeftCorner<Dim, Dim>() = chunk.moment[p].inverse();
  }
  otm_weight_changes(n, chunk.offsets.data(), chunk.local.data(), chunk.entries.data(), found.x.data(), found.at.data(),
                     found.inverse.data(), chunk.volume.data(), axisymmetric(), found.multipliers.data(),
                     found.weight.data(), found.moment.data());
}

/// What changes that multipliers ask for change of the sums, to first order.
template <int Dim> Points<Dim> Motion<Dim>::integrated_changes(const Points<Dim>& multipliers) {
  parallel_chunks(static_cast<Index>(chunks.size()), 1, [&](Index c, Index) {
    OtmChunk<Dim>& chunk = chunks[c];
    std::fill(chunk.force.begin(), chunk.force.end(), 0.0);
    if (!bodies[chunk.body].integrates) return;
    thread_local WeightChanges found;
    find_changes(chunk, multipliers, found);
    otm_gradient_changes(chunk.size(), chunk.offsets.data(), chunk.local.data(), chunk.entries.data(), found.x.data(),
                         found.at.data(), found.inverse.data(), chunk.volume.data(), axisymmetric(),
                         found.weight.data(), found.moment.data(), chunk.force.data());
  });
  return collected();
}

/// Weights change as multipliers ask for, by factors, as far as they may; gradients follow.
template <int Dim> void Motion<Dim>::change_weights(const Points<Dim>& multipliers) {
  parallel_chunks(static_cast<Index>(chunks.size()), 1, [&](Index c, Index) {
    OtmChunk<Dim>& chunk = chunks[c];
    if (!bodies[chunk.body].integrates) return;
    thread_local WeightChanges found;
    find_changes(chunk, multipliers, found);
    std::vector<Vec<Dim>> offset;
    std::vector<double> weight;
    for (Index p = 0; p < chunk.size(); ++p) {
      const Index begin = chunk.offsets[p], count = chunk.offsets[p + 1] - begin;
      OtmEntry* entries = chunk.entries.data() + begin;
      offset.resize(count);
      weight.resize(count);
      for (Index k = 0; k < count; ++k) {
        const double share = entries[k].N > 0.0 ? found.weight[begin + k] / entries[k].N : 0.0;
        weight[k] = entries[k].N * std::exp(std::clamp(share, -largest_change, largest_change));
        offset[k] = x.col(chunk.nodes[chunk.local[begin + k]]) - chunk.at.col(p);
      }
      Mat<Dim> moment;
      if (!centre<Dim>(offset, weight, moment)) continue;
      const Mat<Dim> inverse = moment.inverse();
      for (Index k = 0; k < count; ++k) {
        entries[k].N = weight[k];
        Eigen::Map<Vec<Dim>>(entries[k].dN) = entries[k].N * (inverse * offset[k]);
        if (axisymmetric()) entries[k].dN[2] = entries[k].N / chunk.at(0, p);
      }
      otm_complete<Dim>(count, [&](std::size_t k) -> OtmEntry& { return entries[k]; });
      chunk.penalty[p] *= inverse.trace() / chunk.moment[p].inverse().trace();
      chunk.moment[p] = moment;
      chunk.width[p] = smallest_width<Dim>(moment);
    }
  });
}

/// Weights of points are changed, as little as it takes, until gradients integrate exactly: a stress that is the same
/// everywhere is in balance then (variational consistency, Chen, Hillman & Rueter 2013). Newton's method; conjugate
/// gradients on the multipliers of each of its steps. Sums are measured by what weights change of them at each node.
template <int Dim> void Motion<Dim>::integrate_exactly() {
  if (std::none_of(bodies.begin(), bodies.end(), [](const BodyOf& body) { return body.integrates; })) return;
  double first = 0.0;
  for (int k = 0; k < most_times; ++k) {
    Points<Dim> off = integration_error();
    // What the changes of a point's own weights do to its nodes, of others apart.
    std::vector<Mat<Dim>> scale(x.cols(), Mat<Dim>::Zero());
    for (const OtmChunk<Dim>& chunk : chunks) {
      if (!bodies[chunk.body].integrates) continue;
      for (Index p = 0; p < chunk.size(); ++p)
        for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e) {
          const OtmEntry& entry = chunk.entries[e];
          if (!(entry.N > 0.0)) continue;
          const Vec<Dim> slope = chunk.volume[p] * Eigen::Map<const Vec<Dim>>(entry.dN);
          scale[chunk.nodes[chunk.local[e]]] += slope * slope.transpose() / entry.N;
        }
    }
    for (Mat<Dim>& of : scale)
      if (const double size = of.trace(); size > 0.0) of = (of + 1e-6 * size * Mat<Dim>::Identity()).inverse().eval();
    const auto scaled = [&](const Points<Dim>& of) {
      Points<Dim> result(Dim, of.cols());
      for (Eigen::Index a = 0; a < of.cols(); ++a) result.col(a) = scale[a] * of.col(a);
      return result;
    };
    Points<Dim> multipliers = Points<Dim>::Zero(Dim, x.cols()), weighted = scaled(off), way = weighted;
    double size = off.cwiseProduct(weighted).sum();
    const double start = size;
    if (k == 0) first = start;
    if (!(start > enough * enough * first)) return;
    for (int i = 0; i < most_iterations && size > enough_at_once * enough_at_once * start; ++i) {
      const Points<Dim> change = integrated_changes(way);
      const double length = size / way.cwiseProduct(change).sum();
      if (!std::isfinite(length)) break;
      multipliers += length * way;
      off -= length * change;
      weighted = scaled(off);
      const double next = off.cwiseProduct(weighted).sum();
      way = weighted + next / size * way;
      size = next;
    }
    change_weights(multipliers);
  }
}

template struct Motion<2>;
template struct Motion<3>;

}  // namespace efree::internal
