// SPDX-License-Identifier: GPL-3.0-or-later
/// Pressures of fluids that differ from point to point by more than the nodes feel even out.
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"

namespace efree::internal {
namespace {

/// Largest share of the difference of pressures that is taken at once. (1 - S)^2 is at most four times the largest
/// pressure, and that at most the stiffness: below a quarter no volume becomes negative.
constexpr double most_at_once = 0.2;
/// Rows of a fluid's history: internal energy, that of heat, and where it is viscous F - 1.
constexpr std::array<Index, 2> heat_rows{1, 2};
constexpr Index gradient_row = 3;

template <int Dim> bool diffuses(const World<Dim>& world, const Chunk<Dim>& chunk) {
  return world.bodies[chunk.body].runs_together;
}

/// A point's pressure, its stiffness against changes of volume, at least that of a gas, and J.
struct PointState {
  double pressure = 0.0, stiffness = 0.0, J = 1.0;
};
template <int Dim> PointState point_state(const Chunk<Dim>& chunk, Index p) {
  const Matter<Dim>& matter = chunk.matter;
  if (chunk.is_eroded(p) || chunk.is_inverted(p)) return {};
  const double J = matter.now.gradient(p).determinant();
  const double pressure = -matter.P.col(p).dot(matter.now.F.col(p)) / (3.0 * J);
  return {pressure, std::max(matter.modulus[p] / J, std::abs(pressure)), J};
}

/// Values at nodes, by the first of the four numbers of a chunk's table there: add(chunk) puts them, join(a, b) has
/// those of several chunks become one.
template <int Dim, class Add, class Join> Vector collect(World<Dim>& world, const Add& add, const Join& join) {
  for_each_chunk(world, [&](Chunk<Dim>& chunk) {
    std::fill(chunk.table.force.begin(), chunk.table.force.end(), 0.0);
    if (diffuses(world, chunk)) add(chunk);
  });
  const NodeChunks& chunks = world.node_chunks;
  Vector result(world.nodes.size());
  parallel_for(world.nodes.size(), [&](Index a) {
    Vec<2> sum = Vec<2>::Zero();
    for (Index k = chunks.offsets[a]; k < chunks.offsets[a + 1]; ++k)
      join(sum, Eigen::Map<const Vec<2>>(chunks.forces[k]));
    result[a] = sum[1] > 0.0 ? sum[0] / sum[1] : sum[0];
  });
  return result;
}

/// Diffusion of the pressures of all fluids, over the last step.
template <int Dim> class PressureDiffusion {
 public:
  PressureDiffusion(World<Dim>& world, double rate) : world_(world), values_(world.chunks.size()), weights_(values_) {
    find_weights(rate);
  }

  /// Means of values_ at the nodes.
  Vector node_means() const {
    return collect(
        world_,
        [&](Chunk<Dim>& chunk) {
          PointTable<Dim>& table = chunk.table;
          const Vector &value = values_[world_.number_of(chunk)], &weight = weights_[world_.number_of(chunk)];
          for (Index p = 0; p < chunk.size(); ++p)
            for (Index e = table.offsets[p]; e < table.offsets[p + 1]; ++e) {
              double* sum = table.force.data() + 4 * table.local[e];
              const double part = weight[p] * table.entries[e].N;
              sum[0] += part * value[p];
              sum[1] += part;
            }
        },
        [](Vec<2>& sum, const auto& more) { sum += more; });
  }
  /// Takes off values_ what the means at the nodes interpolate.
  void subtract(const Vector& means) {
    for_each_chunk(world_, [&](Chunk<Dim>& chunk) {
      Vector& value = values_[world_.number_of(chunk)];
      if (!diffuses(world_, chunk)) return;
      for (Index p = 0; p < chunk.size(); ++p)
        for (const auto& [a, entry] : chunk.table.row(p)) value[p] -= entry.N * means[a];
    });
  }
  const std::vector<Vector>& values() const { return values_; }

  /// Exchanges volume by values_; `rough`: pressures less the first means. Returns what becomes heat.
  double exchange(const std::vector<Vector>& rough) {
    std::vector<double> lost(world_.chunks.size(), 0.0);
    parallel_chunks(static_cast<Index>(lost.size()), 1, [&](Index c, Index) {
      Chunk<Dim>& chunk = world_.chunks[c];
      if (!diffuses(world_, chunk)) return;
      Matter<Dim>& matter = chunk.matter;
      for (Index p = 0; p < chunk.size(); ++p) {
        const double weight = weights_[c][p];
        if (!(weight > 0.0)) continue;
        const PointState at = point_state(chunk, p);
        const double volume = matter.volume[p] * at.J, growth = weight / volume * values_[c][p];
        const double heat = weight * rough[c][p] * rough[c][p] - 0.5 * volume * at.stiffness * growth * growth;
        lost[c] += heat;
        for (const Index row : heat_rows) matter.now.history(row, p) += heat / matter.volume[p];
        const double along = std::cbrt(1.0 + growth);
        matter.F_table.col(p) *= along;
        matter.now.F.col(p) *= along;
        if (matter.now.history.rows() > gradient_row) {
          // No strain that viscosity resists.
          auto rest = matter.now.history.col(p).template segment<9>(gradient_row);
          rest = along * rest + (along - 1.0) * Vec<9>(Mat<3>::Identity().reshaped());
        }
        matter.J[p] *= 1.0 + growth;
      }
    });
    double sum = 0.0;
    for (const double of : lost) sum += of;
    return sum;
  }

 private:
  /// The largest of values_ among the points that share its nodes, for each.
  void spread_maxima() {
    const Vector most = collect(
        world_,
        [&](Chunk<Dim>& chunk) {
          PointTable<Dim>& table = chunk.table;
          const Vector& value = values_[world_.number_of(chunk)];
          for (Index p = 0; p < chunk.size(); ++p)
            for (Index e = table.offsets[p]; e < table.offsets[p + 1]; ++e) {
              double& largest = table.force[4 * table.local[e]];
              largest = std::max(largest, value[p]);
            }
        },
        [](Vec<2>& sum, const auto& more) { sum = sum.cwiseMax(more); });
    for_each_chunk(world_, [&](Chunk<Dim>& chunk) {
      if (!diffuses(world_, chunk)) return;
      for (Index p = 0; p < chunk.size(); ++p)
        for (const auto& [a, entry] : chunk.table.row(p))
          values_[world_.number_of(chunk)][p] = std::max(values_[world_.number_of(chunk)][p], most[a]);
    });
  }
  /// Volume that a point gives for a difference of pressure: by the compressibility of the stiffest point whose
  /// pressure it feels, as the weakest would have to be compressed to nothing.
  void find_weights(double rate) {
    const auto for_each_value = [&](const auto& visit) {
      for_each_chunk(world_, [&](Chunk<Dim>& chunk) {
        if (!diffuses(world_, chunk)) return;
        const std::size_t c = world_.number_of(chunk);
        for (Index p = 0; p < chunk.size(); ++p) visit(chunk, p, point_state(chunk, p), values_[c][p], weights_[c][p]);
      });
    };
    for (std::size_t c = 0; c < values_.size(); ++c) {
      values_[c].setZero(world_.chunks[c].size());
      weights_[c].setZero(world_.chunks[c].size());
    }
    for_each_value(
        [](const Chunk<Dim>&, Index, const PointState& at, double& value, double&) { value = at.stiffness; });
    for (int k = 0; k < 2; ++k) spread_maxima();
    for_each_value([&](const Chunk<Dim>& chunk, Index p, const PointState& at, double& value, double& weight) {
      const Matter<Dim>& matter = chunk.matter;
      if (at.stiffness > 0.0) {
        const double volume = matter.volume[p] * at.J, sound = std::sqrt(at.stiffness * volume / matter.mass[p]);
        const double size = std::pow(volume / world_.out_of_plane(matter.x(0, p)), 1.0 / Dim);
        weight = std::min(most_at_once, -std::expm1(-rate * sound * world_.last_step / size)) * volume / value;
      }
      value = at.pressure;
    });
  }

  World<Dim>& world_;
  std::vector<Vector> values_, weights_;  ///< by chunk and point
};

}  // namespace

template <int Dim> void diffuse_pressures(World<Dim>& world, OtmState<Dim>& state) {
  if (state.options.pressure_diffusion == 0.0) return;
  if (std::ranges::none_of(world.bodies, [](const auto& body) { return body.runs_together; })) return;
  PressureDiffusion<Dim> diffusion(world, state.options.pressure_diffusion);
  const Vector means = diffusion.node_means();
  for (Index b = 0; b < world.num_bodies(); ++b) {
    if (!world.bodies[b].runs_together || world.bodies[b].cells.cols() == 0) continue;
    double least = std::numeric_limits<double>::infinity();
    for (Index a = world.first_node[b]; a < world.first_node[b + 1]; ++a)
      if (world.node_chunks.offsets[a + 1] > world.node_chunks.offsets[a]) least = std::min(least, means[a]);
    world.bodies[b].reference_pressure = std::isfinite(least) ? std::max(0.0, least) : 0.0;
  }
  diffusion.subtract(means);
  const std::vector<Vector> rough = diffusion.values();
  diffusion.subtract(diffusion.node_means());
  world.ledger.add_energy("pressure diffusion", EnergyKind::loss, diffusion.exchange(rough));
}

template void diffuse_pressures(World<2>&, OtmState<2>&);
template void diffuse_pressures(World<3>&, OtmState<3>&);

}  // namespace efree::internal
