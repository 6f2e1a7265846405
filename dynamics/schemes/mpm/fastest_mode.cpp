// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/mpm/internal/fastest_mode.hpp"

#include "efree/dynamics/internal/power_iteration.hpp"
#include "efree/dynamics/points.hpp"
#include "efree/dynamics/schemes/mpm/internal/spline.hpp"

#include <algorithm>
#include <cmath>

namespace efree::internal {
namespace {

/// Random part mixed into the mode at each estimate, over its root mean square: another mode may become the fastest.
constexpr double mixed_in = 0.05;

/// A number from -1 to 1 for a site of a body (Steele, Lea & Flood 2014).
template <int Dim> double random_at(const Site<Dim>& site, Index body, int axis, std::int64_t estimate) {
  std::uint64_t z = static_cast<std::uint64_t>(4 * (estimate * 1021 + body) + axis);
  for (int i = 0; i < Dim; ++i) {
    z = (z ^ static_cast<std::uint64_t>(site[i] + (std::int64_t{1} << 32))) * 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
  }
  return static_cast<double>((z ^ z >> 31) >> 11) * 0x1p-52 - 1.0;
}

/// Forces to the slots by gradients of the mode times moduli, the stiffness of every point being the same along all
/// axes.
template <int Dim> void scatter_of_points(const PointGrid<Dim>& grid, const Points<Dim>& mode, Chunk<Dim>& chunk,
                                          const Particles<Dim>& of) {
  const Matter<Dim>& matter = chunk.matter;
  const double* gathered = grid.gather(chunk, of, mode);
  double* columns = chunk.columns();
  for (Index p = 0; p < chunk.size(); ++p, gathered += 4 * gathered_columns)
    for (int k = 0; k < 4 * Dim; ++k) columns[16 * p + k] = -matter.modulus[p] * gathered[4 + k];
  scatter(chunk.size(), of.box, {.x = matter.x.data(), .stress = columns, .volume = matter.volume.data()},
          grid.clear_slots(of));
}
template <int Dim> void scatter_of_mesh(const World<Dim>& world, const PointGrid<Dim>& grid, const Points<Dim>& mode,
                                        Chunk<Dim>& chunk, Particles<Dim>& of) {
  const double* values = grid.gather_values(chunk, of, mode);
  Points<Dim> at_vertices(Dim, of.count());
  for (Index l = 0; l < of.count(); ++l) at_vertices.col(l) = Eigen::Map<const Vec<Dim>>(values + 4 * l);
  const Points<Dim* Dim> gradients = of.mesh->spatial_gradients(chunk, at_vertices);
  double* columns = chunk.columns();
  for (Index p = 0; p < chunk.size(); ++p) {
    std::fill_n(columns + 16 * p, 16, 0.0);
    for (int j = 0; j < Dim; ++j)
      for (int i = 0; i < Dim; ++i) columns[16 * p + 4 * j + i] = -chunk.matter.modulus[p] * gradients(Dim * j + i, p);
  }
  scatter_values(of.count(), of.box, of.positions(chunk).data(), of.mesh->forces(world, chunk), grid.clear_slots(of));
}

}  // namespace

/// Moves the mode to the current grid: it keeps its values at sites of the previous grid, and gets a small random part
/// everywhere.
template <int Dim> void FastestMode<Dim>::move_to_grid(const World<Dim>& world, const PointGrid<Dim>& grid) {
  const double mean = mode_.size() == 0 ? 0.0 : std::sqrt(mode_.squaredNorm() / static_cast<double>(mode_.size()));
  const bool is_known = mean > 0.0 && std::isfinite(mean);
  const double amount = is_known ? mixed_in * mean : 1.0;
  Points<Dim> mode(Dim, world.nodes.size());
  for (Index b = 0; b < world.num_bodies(); ++b)
    grid.grids()[b].for_each([&](Index node, const Site<Dim>& site) {
      const Index before = is_known ? grids_[b].find(site) : -1;
      for (int i = 0; i < Dim; ++i)
        mode(i, node) = (before < 0 ? 0.0 : mode_(i, before)) + amount * random_at<Dim>(site, b, i, estimates_);
    });
  mode_ = std::move(mode);
  grids_ = grid.grids();
  ++estimates_;
}

template <int Dim> double FastestMode<Dim>::estimate(World<Dim>& world, PointGrid<Dim>& grid, int products) {
  move_to_grid(world, grid);
  // Forces of the chunks, which may be summed again.
  std::vector<AlignedVector<double>> kept;
  for (const Chunk<Dim>& chunk : world.chunks) kept.push_back(chunk.table.force);
  const auto multiply = [&](const Points<Dim>& mode, Points<Dim>& forces) {
    grid.for_each_chunk(world, [&](Chunk<Dim>& chunk, Particles<Dim>& of) {
      of.mesh ? scatter_of_mesh(world, grid, mode, chunk, of) : scatter_of_points(grid, mode, chunk, of);
      grid.take_forces(chunk, of);
    });
    collect_forces(world, forces);
  };
  const double squared = power_iteration<Dim>(world.nodes.mass, products, multiply, mode_);
  for (std::size_t c = 0; c < world.chunks.size(); ++c) std::ranges::copy(kept[c], world.chunks[c].table.force.begin());
  return squared;
}

template <int Dim> void HighestFrequency<Dim>::add_strains(const PointGrid<Dim>& grid) {
  strain_ = 0.0;
  for (const Particles<Dim>& of : grid.particles) strain_ = std::max(strain_, of.strain);
  strain_since_estimate_ += strain_;
}

template <int Dim> void HighestFrequency<Dim>::update(World<Dim>& world, PointGrid<Dim>& grid) {
  constexpr Index interval = 16;     // steps
  constexpr double margin = 1.25;    // points and grid move until the next estimate, which is from below
  constexpr double most = 0.1;       // strain of a point since the last estimate
  constexpr double violent = 0.03;   // strain of a point in a step, beyond which modes change too fast for estimates
  constexpr double forgotten = 0.9;  // what is left of the last estimate where the next one is lower
  auto start = std::chrono::steady_clock::now();
  double fastest = 0.0;
  for (const Particles<Dim>& of : grid.particles) fastest = std::max(fastest, of.fastest);
  const bool has_mesh = std::ranges::any_of(grid.particles, [](const auto& of) { return of.mesh.has_value(); });
  const auto estimate_now = [&] { return margin * std::sqrt(mode_.estimate(world, grid, value_ == 0.0 ? 8 : 2)); };
  const double bound = fastest * std::sqrt(Dim * spline_stiffness(grid.degree())) / grid.cell();
  if (has_mesh && strain_ > violent) {
    value_ = std::max(bound, estimate_now());  // cells may be thinner than those of the grid
  } else if (!has_mesh && (grid.degree() == 1 || strain_ > violent)) {
    value_ = bound;  // of degree 1 nodes with next to no mass come and go faster than estimates
  } else if (value_ == 0.0 || world.steps % interval == 0 || strain_since_estimate_ > most) {
    strain_since_estimate_ = 0.0;
    const double estimate = std::max(estimate_now(), forgotten * value_);
    value_ = has_mesh ? estimate : std::min(bound, estimate);
  } else if (fastest > wave_speed_) {
    value_ *= fastest / wave_speed_;  // stiffer than at the last step
  }
  wave_speed_ = fastest;
  world.ledger.add_time("stability", seconds_since(start));
}

template class FastestMode<2>;
template class FastestMode<3>;
template class HighestFrequency<2>;
template class HighestFrequency<3>;

}  // namespace efree::internal
