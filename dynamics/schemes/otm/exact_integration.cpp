// SPDX-License-Identifier: GPL-3.0-or-later
/// Shape functions whose gradients, summed over the points, integrate exactly.
#include "efree/dynamics/internal/kernels.hpp"
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"

namespace efree::internal {
namespace {

/// Largest change of the logarithm of a shape function at once.
constexpr double largest_change = 1.0;
/// Least width of the shape functions of a point (the root of the smallest second moment) over that at first.
constexpr double narrowest = 0.5;
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
  bool is_done = false;
  for (int k = 0; k <= most_newton_iterations; ++k) {
    double sum = 0.0;
    Vec<Dim> mean = Vec<Dim>::Zero();
    moment.setZero();
    for (std::size_t a = 0; a < weight.size(); ++a) {
      sum += weight[a];
      mean += weight[a] * offset[a];
      moment += weight[a] * offset[a] * offset[a].transpose();
    }
    if (is_done) return true;
    mean /= sum;
    moment /= sum;
    const Vec<Dim> step = (moment - mean * mean.transpose()).inverse() * mean;
    const double decrement = step.dot(mean);
    if (!(decrement >= 0.0)) return false;
    is_done = decrement < 1e-10;
    const double length = 1.0 / (1.0 + std::sqrt(decrement));
    for (std::size_t a = 0; a < weight.size(); ++a)
      weight[a] *= (is_done ? 1.0 - step.dot(offset[a] - mean) : std::exp(-length * step.dot(offset[a]))) / sum;
  }
  return false;
}

/// As weight_changes takes and gives them.
struct WeightChanges {
  AlignedVector<double> x, at, multipliers;
  std::vector<Mat<3>> inverse, moment;
  std::vector<double> weight;  ///< by how much they change
};

template <int Dim> bool integrates(const World<Dim>& world, const Chunk<Dim>& chunk) {
  return world.bodies[chunk.body].cells.cols() != 0;
}

/// Sums over points by node: add_to(chunk) adds those of a chunk to its table's forces.
template <int Dim, class Add> Points<Dim> sum_over_points(World<Dim>& world, const Add& add_to) {
  for_each_chunk(world, [&](Chunk<Dim>& chunk) {
    std::fill(chunk.table.force.begin(), chunk.table.force.end(), 0.0);
    if (integrates(world, chunk)) add_to(chunk);
  });
  Points<Dim> result;
  collect_forces(world, result);
  return result;
}

/// What sums over points of volumes times gradients (and, in an axisymmetric section, values over the radius) lack of
/// those of the linear functions of the cells, which are integrals over the surface.
template <int Dim> Points<Dim> residual(World<Dim>& world) {
  const bool axisymmetric = world.axisymmetric();
  Points<Dim> result = sum_over_points(world, [&](Chunk<Dim>& chunk) {
    PointTable<Dim>& table = chunk.table;
    for (Index p = 0; p < chunk.size(); ++p)
      for (Index e = table.offsets[p]; e < table.offsets[p + 1]; ++e) {
        double* sum = table.force.data() + 4 * table.local[e];
        for (int i = 0; i < Dim; ++i) sum[i] -= chunk.matter.volume[p] * table.entries[e].dN[i];
        if (axisymmetric) sum[0] -= chunk.matter.volume[p] * table.entries[e].dN[2];
      }
  });
  for (const Chunk<Dim>& chunk : world.chunks) {
    if (!integrates(world, chunk)) continue;
    for (Index p = 0; p < chunk.size(); ++p) {
      const Eigen::Array<Index, Dim + 1, 1> cell =
          world.bodies[chunk.body].cells.col(chunk.number[p]).array() + world.first_node[chunk.body];
      Eigen::Matrix<double, Dim, Dim + 1> slope = slopes_of<Dim>(world.nodes.x(Eigen::all, cell));
      if (axisymmetric) slope.row(0).array() += 1.0 / ((Dim + 1) * chunk.matter.x(0, p));
      for (int k = 0; k <= Dim; ++k) result.col(cell[k]) += chunk.matter.volume[p] * slope.col(k);
    }
  }
  return result;
}

/// Changes of weights in a chunk by multipliers. What changes cost is the same at all points, however large: fine
/// parts of a mesh are no less well off than coarse ones.
template <int Dim>
const WeightChanges& find_changes(const World<Dim>& world, const Chunk<Dim>& chunk, const Points<Dim>& multipliers) {
  thread_local WeightChanges found;
  const PointTable<Dim>& table = chunk.table;
  const Index n = chunk.size();
  const auto put = [](AlignedVector<double>& numbers, const auto& columns) {
    numbers.assign(4 * columns.cols(), 0.0);
    Eigen::Map<Points<4>> result(numbers.data(), 4, columns.cols());
    result.template topRows<Dim>() = columns;
    return result;
  };
  put(found.x, world.nodes.x(Eigen::all, table.nodes));
  put(found.at, chunk.matter.x);
  auto put_multipliers = put(found.multipliers, multipliers(Eigen::all, table.nodes));
  if (world.axisymmetric()) put_multipliers.row(2) = put_multipliers.row(0);
  found.inverse.assign(n, Mat<3>::Zero());
  for (Index p = 0; p < n; ++p) found.inverse[p].template topLeftCorner<Dim, Dim>() = chunk.support.moment[p].inverse();
  found.moment.resize(n);
  found.weight.resize(table.entries.size());
  weight_changes(n, table.offsets.data(), table.local.data(), table.entries.data(), found.x.data(), found.at.data(),
                 found.inverse.data(), chunk.matter.volume.data(), world.axisymmetric(), found.multipliers.data(),
                 found.weight.data(), found.moment.data());
  return found;
}

/// Changes of the sums by multipliers, to first order.
template <int Dim> Points<Dim> integrated_changes(World<Dim>& world, const Points<Dim>& multipliers) {
  return sum_over_points(world, [&](Chunk<Dim>& chunk) {
    const WeightChanges& found = find_changes(world, chunk, multipliers);
    PointTable<Dim>& table = chunk.table;
    gradient_changes(chunk.size(), table.offsets.data(), table.local.data(), table.entries.data(), found.x.data(),
                     found.at.data(), found.inverse.data(), chunk.matter.volume.data(), world.axisymmetric(),
                     found.weight.data(), found.moment.data(), table.force.data());
  });
}

/// Changes weights as multipliers ask for, by factors, within bounds; gradients follow. Points whose shape functions
/// would become much narrower keep theirs: of functions on nodes of a plane, nearly, gradients are large without
/// bounds, and the stable step is short.
template <int Dim> void change_weights(World<Dim>& world, const OtmState<Dim>& state, const Points<Dim>& multipliers) {
  for_each_chunk(world, [&](Chunk<Dim>& chunk) {
    if (!integrates(world, chunk)) return;
    const WeightChanges& found = find_changes(world, chunk, multipliers);
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
        offset[k] = world.nodes.x.col(table.nodes[table.local[begin + k]]) - chunk.matter.x.col(p);
      }
      Mat<Dim> moment;
      if (!centre<Dim>(offset, weight, moment) ||
          !(smallest_width<Dim>(moment) > narrowest * state.points[world.number_of(chunk)].width[p]))
        continue;
      const Mat<Dim> inverse = moment.inverse();
      for (Index k = 0; k < count; ++k) {
        const double hoop = world.axisymmetric() ? weight[k] / chunk.matter.x(0, p) : 0.0;
        entries[k] = table_entry<Dim>(weight[k], weight[k] * (inverse * offset[k]), hoop);
      }
      complete_row<Dim>(count, [&](std::size_t k) -> TableEntry& { return entries[k]; });
      support.stabilisation[p] *= inverse.trace() / support.moment[p].inverse().trace();
      support.moment[p] = moment;
    }
  });
}

/// By node, the inverse of the changes of its sums by the weights of its own points, others apart.
template <int Dim> std::vector<Mat<Dim>> scales(const World<Dim>& world) {
  std::vector<Mat<Dim>> scale(world.nodes.size(), Mat<Dim>::Zero());
  for (const Chunk<Dim>& chunk : world.chunks) {
    if (!integrates(world, chunk)) continue;
    for (Index p = 0; p < chunk.size(); ++p)
      for (const auto& [a, entry] : chunk.table.row(p)) {
        if (!(entry.N > 0.0)) continue;
        const Vec<Dim> slope = chunk.matter.volume[p] * Eigen::Map<const Vec<Dim>>(entry.dN);
        scale[a] += slope * slope.transpose() / entry.N;
      }
  }
  for (Mat<Dim>& sum : scale)
    if (const double size = sum.trace(); size > 0.0) sum = (sum + 1e-6 * size * Mat<Dim>::Identity()).inverse().eval();
  return scale;
}

}  // namespace

/// Weights of points are changed, as little as it takes, until a stress that is the same everywhere is in balance
/// (variational consistency, Chen, Hillman & Rueter 2013). Newton's method; conjugate gradients on the multipliers of
/// each of its steps. Sums are measured by what weights change of them at each node.
template <int Dim> void integrate_exactly(World<Dim>& world, OtmState<Dim>& state) {
  double first = 0.0;
  for (int k = 0; k < most_times; ++k) {
    Points<Dim> rest = residual(world);
    const std::vector<Mat<Dim>> scale = scales(world);
    const auto scaled = [&](const Points<Dim>& sums) {
      Points<Dim> result(Dim, sums.cols());
      for (Eigen::Index a = 0; a < sums.cols(); ++a) result.col(a) = scale[a] * sums.col(a);
      return result;
    };
    Points<Dim> multipliers = Points<Dim>::Zero(Dim, rest.cols()), weighted = scaled(rest), direction = weighted;
    double size = rest.cwiseProduct(weighted).sum();
    const double start = size;
    if (k == 0) first = start;
    if (!(start > enough * enough * first)) break;
    for (int i = 0; i < most_iterations && size > enough_at_once * enough_at_once * start; ++i) {
      const Points<Dim> more = integrated_changes(world, direction);
      const double length = size / direction.cwiseProduct(more).sum();
      if (!std::isfinite(length)) break;
      multipliers += length * direction;
      rest -= length * more;
      weighted = scaled(rest);
      const double next = rest.cwiseProduct(weighted).sum();
      direction = weighted + next / size * direction;
      size = next;
    }
    change_weights(world, state, multipliers);
  }
  for (std::size_t c = 0; c < world.chunks.size(); ++c)
    for (Index p = 0; p < world.chunks[c].size(); ++p)
      state.points[c].width[p] = smallest_width<Dim>(world.chunks[c].support.moment[p]);
}

template void integrate_exactly(World<2>&, OtmState<2>&);
template void integrate_exactly(World<3>&, OtmState<3>&);

}  // namespace efree::internal
