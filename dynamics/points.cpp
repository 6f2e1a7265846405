// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/points.hpp"

#include "efree/dynamics/fracture/internal/fracture.hpp"
#include "efree/dynamics/internal/kernels.hpp"
#include "efree/dynamics/internal/point_response.hpp"

#include <fmt/ranges.h>
#include <Eigen/Eigenvalues>
#include <iterator>

namespace efree {
namespace {

/// |F - I| beyond which what is linear in it is wrong by more than a few per cent.
constexpr double small_strains = 0.05;

/// How much of the damping of a step the next one still assumes: where points shrink is known when they have, and steps
/// that jump as these come and go would disturb the energy.
constexpr double kept_damping = 0.98;

/// J of a point over that of its pressure patch below which the point leaves the patch.
constexpr double least_J_ratio = 0.5;

/// Position of a point by the rows of interpolate_gradients.
template <int Dim> void place_point(Chunk<Dim>& chunk, Index p, const double* rows) {
  chunk.matter.x.col(p) = chunk.table.origin + Eigen::Map<const Vec<Dim>>(rows + 12);
}

/// Likewise with F_since.
template <int Dim> void update_position(const World<Dim>& world, Chunk<Dim>& chunk, Index p, const double* rows) {
  place_point(chunk, p, rows);
  if (!chunk.is_eroded(p) && !chunk.is_inverted(p)) chunk.matter.F_since[p] = gradient_by_rows(world, rows, 1.0);
}

/// Throws NumericalError where a material for small strains is strained or rotated by much.
template <int Dim> void require_small_strains(const World<Dim>& world, const Chunk<Dim>& chunk) {
  for (Index p = 0; p < chunk.size(); ++p) {
    const double strain = chunk.is_eroded(p) ? 0.0 : (chunk.matter.now.gradient(p) - Mat<3>::Identity()).norm();
    if (strain > small_strains)
      throw NumericalError(fmt::format(
          "at time {:.6g} the material point at ({:.6g}) is strained or rotated by {:.2g}, and its material is for "
          "small strains: take one for finite strains",
          world.time, fmt::join(chunk.matter.x.col(p), ", "), strain));
  }
}

/// F of the points of pressure patches with the dilatation of the patch. Nothing keeps one point from being compressed
/// to nothing while the others expand: where that begins, all leave the patch, each with the strain it has.
template <int Dim> void share_dilatation(Chunk<Dim>& chunk) {
  Matter<Dim>& matter = chunk.matter;
  std::vector<Index> leaving;
  chunk.for_each_patch([&](Index begin, Index end) {
    double volume = 0.0, deformed = 0.0;
    for (Index p = begin; p < end; ++p) {
      volume += matter.volume[p];
      if (!chunk.is_eroded(p)) deformed += matter.volume[p] * matter.J_ratio[p];
    }
    bool dissolves = false;
    for (Index p = begin; p < end && volume > 0.0; ++p) {
      if (chunk.is_eroded(p)) continue;
      const double own = matter.J_ratio[p] /= deformed / volume;
      dissolves = dissolves || own < least_J_ratio || chunk.is_inverted(p);
    }
    for (Index p = begin; p < end && dissolves; ++p) leaving.push_back(p);
  });
  internal::apply_patch_dilatation(chunk.size(), matter.J_ratio.data(), matter.volume.data(), matter.now.F.data());
  if (leaving.empty()) return;
  for (const Index p : leaving)
    if (!chunk.is_eroded(p)) matter.F_table.col(p) /= std::cbrt(std::exchange(matter.J_ratio[p], 1.0));
  std::vector<Index> patches;
  std::ranges::set_union(chunk.patches, leaving, std::back_inserter(patches));
  chunk.patches = std::move(patches);
}

/// Kinematics of a chunk, a step after the last time.
template <int Dim> void deform(const World<Dim>& world, Scheme<Dim>& scheme, Chunk<Dim>& chunk, double dt) {
  const BodyState<Dim>& body = world.bodies[chunk.body];
  Matter<Dim>& matter = chunk.matter;
  const Index n = chunk.size();
  matter.now.dt = dt;
  const double least = body.holds_inverted && dt > 0.0 ? least_volume_left : 0.0;
  const StrainBounds bounds = scheme.examine(world, chunk, dt, scheme.update_points(world, chunk, least));
  const double* columns = chunk.columns();
  if (!body.material->finite_strain()) require_small_strains(world, chunk);
  if (dt == 0.0) {
    // In no time nothing moves, not even by rounding: flow depends on the rate.
    if (!matter.F_since.empty()) matter.now.F = matter.F_table;
    for (Index p = 0; p < n; ++p) matter.J_ratio[p] = matter.now.gradient(p).determinant();
  } else {
    chunk.compression_rate = std::max(chunk.compression_rate, std::log(bounds.shrinkage) / dt);
    if (chunk.has_patches()) share_dilatation(chunk);
  }
  chunk.damping *= kept_damping;
  if (!world.options.shock.on() || !(dt > 0.0)) return;
  const Mat<3>* recent = chunk.recent_gradients();
  for (Index p = 0; p < n; ++p)
    if (!chunk.is_eroded(p) && !chunk.is_inverted(p))
      update_shock_pressure(world, chunk, p, recent[p], Eigen::Map<const Mat<3>>(columns + 16 * p), dt);
  chunk.viscous += matter.now.heat.dot(matter.volume);
}

/// Forces in a chunk's table of the stresses that its points have.
template <int Dim> void scatter_stresses(const World<Dim>& world, Scheme<Dim>& scheme, Chunk<Dim>& chunk) {
  const Matter<Dim>& matter = chunk.matter;
  const double reference = world.bodies[chunk.body].reference_pressure;
  const double* pressure = matter.shock.data();
  if (matter.shock.size() == 0 || reference != 0.0) {
    thread_local Vector less;
    less.setZero(chunk.size());
    if (matter.shock.size() != 0) less = matter.shock;
    for (Index p = 0; p < chunk.size() && reference != 0.0; ++p)
      less[p] -= reference * matter.now.gradient(p).determinant();
    pressure = less.data();
  }
  internal::kirchhoff_stresses(chunk.size(), matter.P.data(), matter.now.F.data(), pressure, chunk.columns());
  for (const Index p : chunk.inverted) std::fill_n(chunk.columns() + 16 * p, 12, 0.0);
  scheme.scatter_forces(world, chunk);
}

template <int Dim> void compute_forces_of(const World<Dim>& world, Scheme<Dim>& scheme, Chunk<Dim>& chunk, double dt) {
  const BodyState<Dim>& body = world.bodies[chunk.body];
  Matter<Dim>& matter = chunk.matter;
  auto start = std::chrono::steady_clock::now();
  deform(world, scheme, chunk, dt);
  chunk.seconds[0] += seconds_since(start);
  try {
    internal::update_stresses(*body.material, matter, [&](MaterialResponse& response) {
      internal::update_damage(world, chunk, response);
      chunk.stored = response.energy.dot(matter.volume);
      chunk.dissipated += response.dissipated.dot(matter.volume);
    });
  } catch (const NumericalError& error) {
    throw NumericalError(fmt::format("at time {:.6g}: {}", world.time, error.what()));
  }
  chunk.seconds[1] += seconds_since(start);
  scatter_stresses(world, scheme, chunk);
  chunk.seconds[2] += seconds_since(start);
}

}  // namespace

template <int Dim>
void interpolate_by_table(PointTable<Dim>& table, const Points<Dim>& values, bool axisymmetric, double* columns) {
  if (table.nodes.empty()) return;
  table.origin = values.col(table.nodes[table.nodes.size() / 2]);
  if (axisymmetric) table.origin[0] = 0.0;  // hoops are as long as radii
  for (std::size_t l = 0; l < table.nodes.size(); ++l)
    for (int i = 0; i < Dim; ++i) table.x[4 * l + i] = values(i, table.nodes[l]) - table.origin[i];
  internal::interpolate_gradients(static_cast<Index>(table.offsets.size()) - 1, table.offsets.data(),
                                  table.local.data(), table.entries.data(), table.x.data(), columns);
}
template <int Dim> void interpolate(const World<Dim>& world, Chunk<Dim>& chunk, const Points<Dim>& values) {
  interpolate_by_table(chunk.table, values, world.axisymmetric(), chunk.columns());
}

template <int Dim> Mat<3> gradient_by_rows(const World<Dim>& world, const double* rows, double out_of_plane) {
  Mat<3> result = Mat<3>::Zero();
  result(2, 2) = out_of_plane;
  for (int j = 0; j < Dim; ++j)
    for (int i = 0; i < Dim; ++i) result(i, j) = rows[4 * i + j];
  if (world.axisymmetric()) result(2, 2) = rows[2];
  return result;
}

template <int Dim> void update_position(const World<Dim>& world, Chunk<Dim>& chunk, Index p) {
  update_position(world, chunk, p, chunk.columns() + 16 * p);
}

template <int Dim> void update_position_again(const World<Dim>& world, Chunk<Dim>& chunk, Index p) {
  double rows[16];
  const PointTable<Dim>& table = chunk.table;
  internal::interpolate_gradients(1, table.offsets.data() + p, table.local.data(), table.entries.data(), table.x.data(),
                                  rows);
  update_position(world, chunk, p, rows);
}

template <int Dim> void compute_internal_forces(World<Dim>& world, Scheme<Dim>& scheme, double dt) {
  for_each_chunk(world, [&](Chunk<Dim>& chunk) { compute_forces_of(world, scheme, chunk, dt); });
  scheme.collect_forces(world);
  world.ledger.add_count("point updates", world.num_points());
}

template <int Dim> void assemble_internal_forces(World<Dim>& world, Scheme<Dim>& scheme, bool moved) {
  for_each_chunk(world, [&](Chunk<Dim>& chunk) {
    if (scheme.nodes_persist() && chunk.has_table()) {
      if (moved)
        update_positions(world, chunk);
      else
        interpolate(world, chunk, world.nodes.x);  // zero-energy modes are by the table's positions
    }
    scatter_stresses(world, scheme, chunk);
  });
  scheme.collect_forces(world);
}

template <int Dim> void share_patch_pressures(Chunk<Dim>& chunk) {
  if (!chunk.has_patches()) return;
  const Matter<Dim>& matter = chunk.matter;
  double* columns = chunk.columns();
  const auto trace = [&](Index p) { return columns[16 * p] + columns[16 * p + 5] + columns[16 * p + 10]; };
  chunk.for_each_patch([&](Index begin, Index end) {
    double volume = 0.0, pressure = 0.0;
    for (Index p = begin; p < end; ++p) {
      volume += matter.volume[p];
      pressure += matter.volume[p] * trace(p) / 3.0;
    }
    for (Index p = begin; p < end && volume > 0.0; ++p) {
      const double shift = pressure / volume * matter.J_ratio[p] - trace(p) / 3.0;
      for (const int d : {0, 5, 10}) columns[16 * p + d] += shift;
    }
  });
}

namespace {

/// internal::update_deformation of a chunk's points, by its columns.
template <int Dim> StrainBounds update_deformation(const World<Dim>& world, Chunk<Dim>& chunk, double least) {
  using internal::PlaneKind;
  const PlaneKind plane = Dim == 3               ? PlaneKind::none
                          : world.axisymmetric() ? PlaneKind::axisymmetric
                                                 : PlaneKind::strain;
  Matter<Dim>& matter = chunk.matter;
  const double* F_table = matter.F_since.empty() ? matter.now.F.data() : matter.F_table.data();
  return internal::update_deformation(chunk.size(), plane, least, matter.volume.data(), F_table,
                                      chunk.recent_gradients(), matter.now.F.data(), matter.J_ratio.data(),
                                      chunk.columns());
}

}  // namespace

template <int Dim> StrainBounds deform_by_table(const World<Dim>& world, Chunk<Dim>& chunk, PointTable<Dim>& table,
                                                const Points<Dim>& nodes, double least) {
  Matter<Dim>& matter = chunk.matter;
  double* columns = chunk.columns();
  interpolate_by_table(table, nodes, world.axisymmetric(), columns);
  for (Index p = 0; p < chunk.size(); ++p)
    matter.x.col(p) = table.origin + Eigen::Map<const Vec<Dim>>(columns + 16 * p + 12);
  return update_deformation(world, chunk, least);
}

template <int Dim> void take_increment(Chunk<Dim>& chunk, Index p, const Mat<Dim>& change) {
  Matter<Dim>& matter = chunk.matter;
  if (!matter.F_since.empty()) {
    Eigen::Map<Mat<3>> F(matter.F_table.col(p).data());
    if (chunk.has_patches())
      F = Mat<3>(matter.F_since[p] * F);
    else
      F = matter.now.gradient(p);  // the same, as it was computed
  }
  Mat<3>& recent = chunk.recent_gradients()[p];
  recent.setIdentity();
  if (!chunk.is_eroded(p)) recent.template topLeftCorner<Dim, Dim>() = change;
}

template <int Dim> StrainBounds deform_by_increments(const World<Dim>& world, Chunk<Dim>& chunk, double least) {
  Mat<3>* recent = chunk.recent_gradients();
  double* columns = chunk.columns();
  for (Index p = 0; p < chunk.size(); ++p) {
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) columns[16 * p + 4 * i + j] = recent[p](i, j);
    if (!chunk.is_eroded(p)) recent[p].setIdentity();
  }
  return update_deformation(world, chunk, least);
}

template <int Dim> void scatter_by_table(const World<Dim>& world, Chunk<Dim>& chunk, const std::vector<Mat<3>>& moved,
                                         PointTable<Dim>& table) {
  const Support<Dim>& support = chunk.support;
  double* columns = chunk.columns();
  internal::force_columns(chunk.size(), chunk.matter.volume.data(), chunk.matter.F_since.data(), moved.data(),
                          support.moment.data(), support.stabilisation.data(), columns);
  if (Dim == 2 && !world.axisymmetric())
    for (Index p = 0; p < chunk.size(); ++p) columns[16 * p + 8] = 0.0;
  std::fill(table.force.begin(), table.force.end(), 0.0);
  internal::scatter_forces(chunk.size(), table.offsets.data(), table.local.data(), table.entries.data(), table.x.data(),
                           columns, support.stabilisation.data(), world.axisymmetric(), table.force.data());
}
template <int Dim> void scatter_stresses(const World<Dim>& world, Chunk<Dim>& chunk, const std::vector<Mat<3>>& moved) {
  share_patch_pressures(chunk);
  scatter_by_table(world, chunk, moved, chunk.table);
}

template <int Dim> void collect_forces(const World<Dim>& world, Points<Dim>& forces, const std::vector<char>& of) {
  const NodeChunks& chunks = world.node_chunks;
  forces.resize(Dim, world.nodes.size());
  if (chunks.offsets.empty()) {
    forces.setZero();
    return;
  }
  parallel_for(world.nodes.size(), [&](Index a) {
    Vec<Dim> sum = Vec<Dim>::Zero();
    if (of.empty() || of[a] != 0)
      for (Index k = chunks.offsets[a]; k < chunks.offsets[a + 1]; ++k)
        sum += Eigen::Map<const Vec<Dim>>(chunks.forces[k]);
    forces.col(a) = sum;
  });
}

template <int Dim> double stabilisation_energy(const World<Dim>& world, const Chunk<Dim>& chunk, Index p, double ago) {
  if (chunk.support.stabilisation.size() == 0) return 0.0;
  double spread = 0.0;
  Vec<Dim> mean = Vec<Dim>::Zero();
  Mat<Dim> gradient = Mat<Dim>::Zero();
  for (const auto& [a, entry] : chunk.table.row(p)) {
    const Vec<Dim> d = world.nodes.x.col(a) - chunk.matter.x.col(p) - ago * world.nodes.v.col(a);
    mean += entry.N * d;
    gradient += d * Eigen::Map<const Vec<Dim>>(entry.dN).transpose();
    spread += entry.N * d.squaredNorm();
  }
  return 0.5 * chunk.support.stabilisation[p] *
         (spread - mean.squaredNorm() - (gradient * chunk.support.moment[p] * gradient.transpose()).trace());
}

template <int Dim> std::vector<double> stabilisation_energies(const World<Dim>& world) {
  std::vector<double> sums(world.chunks.size(), 0.0);
  parallel_chunks(static_cast<Index>(sums.size()), 1, [&](Index c, Index) {
    const Chunk<Dim>& chunk = world.chunks[c];
    for (Index p = 0; p < chunk.size(); ++p) sums[c] += stabilisation_energy(world, chunk, p);
  });
  return sums;
}

template <int Dim> double smallest_width(const Mat<Dim>& moment) {
  Eigen::SelfAdjointEigenSolver<Mat<Dim>> axes;
  axes.computeDirect(moment, Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(axes.eigenvalues()[0], 0.0));
}

#define EFREE_INSTANTIATE(Dim)                                                                                         \
  template void interpolate(const World<Dim>&, Chunk<Dim>&, const Points<Dim>&);                                       \
  template void interpolate_by_table(PointTable<Dim>&, const Points<Dim>&, bool, double*);                             \
  template StrainBounds deform_by_table(const World<Dim>&, Chunk<Dim>&, PointTable<Dim>&, const Points<Dim>&, double); \
  template void scatter_by_table(const World<Dim>&, Chunk<Dim>&, const std::vector<Mat<3>>&, PointTable<Dim>&);        \
  template void take_increment(Chunk<Dim>&, Index, const Mat<Dim>&);                                                   \
  template StrainBounds deform_by_increments(const World<Dim>&, Chunk<Dim>&, double);                                  \
  template Mat<3> gradient_by_rows(const World<Dim>&, const double*, double);                                          \
  template void update_position(const World<Dim>&, Chunk<Dim>&, Index);                                                \
  template void update_position_again(const World<Dim>&, Chunk<Dim>&, Index);                                          \
  template void compute_internal_forces(World<Dim>&, Scheme<Dim>&, double);                                            \
  template void assemble_internal_forces(World<Dim>&, Scheme<Dim>&, bool);                                             \
  template void share_patch_pressures(Chunk<Dim>&);                                                                    \
  template void scatter_stresses(const World<Dim>&, Chunk<Dim>&, const std::vector<Mat<3>>&);                          \
  template void collect_forces(const World<Dim>&, Points<Dim>&, const std::vector<char>&);                             \
  template double stabilisation_energy(const World<Dim>&, const Chunk<Dim>&, Index, double);                           \
  template std::vector<double> stabilisation_energies(const World<Dim>&);                                              \
  template double smallest_width(const Mat<Dim>&);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree
