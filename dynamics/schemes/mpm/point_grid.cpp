// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/mpm/internal/point_grid.hpp"
#include "efree/core/error.hpp"

#include <fmt/ranges.h>
#include <atomic>
#include <limits>
#include <numeric>

namespace efree::internal {
namespace {

/// Numbers of the first node along an axis of a point at so many cells from node 0.
Index first_site(double position, int degree) {
  return static_cast<Index>(std::floor(degree == 2 ? position - 0.5 : position)) - (degree == 3 ? 1 : 0);
}

/// Slots of a box beyond which a chunk is split: clearing them takes as long as the step of its points.
constexpr double most_slots = 4096;
/// Slots around a single cell of a Lagrangian mesh.
constexpr double most_slots_of_one = 1e6;
/// Sites that a grid can number, on either side of its origin.
constexpr double most_cells = 4e6;

/// What rounding takes from a velocity that all nodes share is the same in every step, and drift: kernels get
/// velocities less the mean of the points.
template <int Dim> Vec<Dim> common_velocity(const Particles<Dim>& of) {
  return of.v.rowwise().mean();
}
template <int Dim> void add_common(const Vec<Dim>& common, Index points, int stride, double* values) {
  for (Index p = 0; p < points; ++p)
    for (int i = 0; i < Dim; ++i) values[4 * stride * p + i] += common[i];
}

double* room(AlignedVector<double>& of, std::size_t size) {
  if (of.size() < size) of.resize(size);
  return of.data();
}

}  // namespace

template <int Dim> typename PointGrid<Dim>::Box PointGrid<Dim>::find_box(const World<Dim>& world,
                                                                         const Chunk<Dim>& chunk,
                                                                         Particles<Dim>& of) const {
  const Points<Dim>& x = of.positions(chunk);
  const Vec<Dim> low = (x.rowwise().minCoeff() - origin_) / cell_, high = (x.rowwise().maxCoeff() - origin_) / cell_;
  if (!x.allFinite() || !(low.cwiseAbs().maxCoeff() < most_cells) || !(high.cwiseAbs().maxCoeff() < most_cells)) {
    Index at = 0;
    const auto distance = [&](Index p) { return ((x.col(p) - origin_) / cell_).cwiseAbs().maxCoeff(); };
    for (Index p = 1; p < of.count() && std::isfinite(distance(at)); ++p)
      if (!(distance(p) <= distance(at))) at = p;
    throw NumericalError(fmt::format(
        "at time {:.6g} bodies fly apart: {} is at ({:.6g}), {:.3g} cells away from where the grid began, which "
        "has no more than {:.3g}. Try smaller steps (courant), or end the run earlier",
        world.time, of.mesh ? "a vertex" : fmt::format("the material point {}", world.point_number(chunk, at)),
        fmt::join(x.col(at), ", "), distance(at), most_cells));
  }
  const double slots = (high - low + Vec<Dim>::Constant(degree_ + 4)).prod();
  if (chunk.size() > 1 && slots > most_slots) return Box::too_large;
  if (slots > most_slots_of_one)
    throw NumericalError(fmt::format(
        "at time {:.6g} bodies fly apart: the cell at ({:.6g}) is {:.3g} cells of the grid long. Try smaller steps "
        "(courant), a larger cell of the grid, or end the run earlier",
        world.time, fmt::join(x.col(0), ", "), (high - low).maxCoeff()));
  Site<Dim> first, size;
  for (int i = 0; i < Dim; ++i) {
    // One more on either side: kernels round otherwise where a point is at a knot.
    first[i] = first_site(low[i], degree_) - 1;
    size[i] = first_site(high[i], degree_) + degree_ + 1 - first[i] + 1;
  }
  of.box.dim = Dim;
  of.box.degree = degree_;
  of.box.cell = cell_;
  const Vec<Dim> corner = position(first);
  for (int i = 0; i < Dim; ++i) of.box.low[i] = corner[i];
  std::ptrdiff_t stride = 1;
  for (int i = Dim - 1; i > 0; --i) of.box.stride[i - 1] = stride *= size[i];
  thread_local std::vector<char> marked;
  marked.assign(static_cast<std::size_t>(stride) * static_cast<std::size_t>(size[0]), 0);
  mark_slots(of.count(), of.box, x.data(), marked.data());
  const bool same = !of.marked.empty() && first == of.low && size == of.size && marked == of.marked;
  if (same) return Box::same;
  of.low = first;
  of.size = size;
  of.marked = marked;
  of.slots.clear();
  for (std::size_t s = 0; s < marked.size(); ++s)
    if (marked[s] != 0) of.slots.push_back(static_cast<Index>(s));
  return Box::changed;
}

/// Splits a chunk along the longest axis of its box where the gap between pressure patches is widest, or in the middle.
/// The points of a single patch share no dilatation from then on.
template <int Dim> void PointGrid<Dim>::split(World<Dim>& world, std::size_t c) {
  Chunk<Dim>& chunk = world.chunks[c];
  const Points<Dim>& x = chunk.matter.x;
  int axis = 0;
  (x.rowwise().maxCoeff() - x.rowwise().minCoeff()).maxCoeff(&axis);
  if (chunk.patches.size() == 2) {
    chunk.patches.resize(static_cast<std::size_t>(chunk.size()) + 1);
    std::iota(chunk.patches.begin(), chunk.patches.end(), 0);
  }
  std::vector<std::pair<double, std::size_t>> along;  // patches, by where they begin
  for (std::size_t k = 0; k + 1 < chunk.patches.size(); ++k) along.emplace_back(x(axis, chunk.patches[k]), k);
  std::ranges::sort(along);
  std::size_t cut = along.size() / 2;
  double widest = 2.0 * cell_;
  for (std::size_t k = 1; k < along.size(); ++k)
    if (const double gap = along[k].first - along[k - 1].first; gap > widest) {
      widest = gap;
      cut = k;
    }
  std::vector<Index> kept, given;
  for (std::size_t k = 0; k < along.size(); ++k)
    for (Index p = chunk.patches[along[k].second]; p < chunk.patches[along[k].second + 1]; ++p)
      (k < cut ? kept : given).push_back(p);
  std::ranges::sort(kept);
  std::ranges::sort(given);
  world.split_chunk(c, given);
  const double lost_power = particles[c].lost_power;
  particles.push_back(particles[c].select(given));
  particles.back().complete(world.chunks.back());
  particles[c] = particles[c].select(kept);
  particles[c].complete(world.chunks[c]);
  particles[c].lost_power = lost_power;
}

template <int Dim> void PointGrid<Dim>::rebuild(World<Dim>& world, bool replaces) {
  std::atomic<bool> changed = grids_.empty();
  std::vector<char> too_large(particles.size(), 0);
  parallel_chunks(static_cast<Index>(particles.size()), 1, [&](Index c, Index) {
    const Box box = find_box(world, world.chunks[c], particles[c]);
    if (box != Box::same) changed = true;
    too_large[c] = box == Box::too_large ? 1 : 0;
  });
  const std::size_t before = particles.size();
  for (std::size_t c = 0; c < particles.size(); ++c)
    while ((c >= before || too_large[c] != 0) && find_box(world, world.chunks[c], particles[c]) == Box::too_large)
      split(world, c);
  if (particles.size() > before) world.find_points();
  if (changed) {
    number_nodes(world, replaces);
  } else if (replaces) {
    world.nodes.x = x_;
    world.nodes.x_rest.setZero();
  }
}

template <int Dim> void PointGrid<Dim>::tie(const std::vector<std::pair<Index, Index>>& pairs, Index num_bodies) {
  first_tied_.resize(static_cast<std::size_t>(num_bodies));
  std::iota(first_tied_.begin(), first_tied_.end(), 0);
  for (const auto& [a, b] : pairs) {
    require(std::min(a, b) >= 0 && std::max(a, b) < num_bodies, "ties: expected bodies that there are");
    const auto [first, later] = std::minmax(first_tied_[a], first_tied_[b]);
    std::ranges::replace(first_tied_, Index(later), Index(first));
  }
}

template <int Dim> void PointGrid<Dim>::number_nodes(World<Dim>& world, bool replaces) {
  // Sites of a chunk's nodes, in the order of their local numbers.
  const auto site_at = [](const Particles<Dim>& of, Index slot) {
    Site<Dim> site;
    for (int i = Dim - 1; i >= 0; --i) {
      site[i] = of.low[i] + slot % of.size[i];
      slot /= of.size[i];
    }
    return site;
  };
  std::vector<std::vector<GridBlock>> blocks(particles.size());
  parallel_chunks(static_cast<Index>(particles.size()), 1, [&](Index c, Index) {
    std::vector<GridBlock>& own = blocks[c];
    for (const Index slot : particles[c].slots) {
      const auto [key, bit] = locate_site<Dim>(site_at(particles[c], slot));
      const std::uint64_t mask = std::uint64_t{1} << bit;
      if (own.empty() || own.back().key != key)
        own.push_back({key, mask});
      else
        own.back().nodes |= mask;
    }
  });
  grids_.clear();
  std::vector<Index> first{0};
  std::vector<std::vector<GridBlock>> blocks_of(world.num_bodies());
  for (std::size_t c = 0; c < blocks.size(); ++c) {
    auto& all = blocks_of[first_tied_[world.chunks[c].body]];
    all.insert(all.end(), blocks[c].begin(), blocks[c].end());
  }
  for (auto& all : blocks_of) {
    grids_.emplace_back(std::move(all), first.back());
    first.push_back(grids_.back().end());
  }
  x_.resize(Dim, first.back());
  for (const SparseGrid<Dim>& grid : grids_)
    grid.for_each([&](Index node, const Site<Dim>& site) { x_.col(node) = position(site); });
  if (replaces) world.replace_nodes(x_, first, cell_);
  for_each_chunk(world, [&](Chunk<Dim>& chunk, Particles<Dim>& of) {
    PointTable<Dim>& table = chunk.table;
    table.nodes.clear();
    for (const Index slot : of.slots) table.nodes.push_back(of_body(chunk.body).find(site_at(of, slot)));
    table.force.assign(4 * table.nodes.size(), 0.0);
    of.momentum.assign(4 * table.nodes.size(), 0.0);
    if (of.mesh && of.moved.cols() != of.count()) of.moved.setZero(Dim, of.count());
  });
  world.find_node_chunks();
}

template <int Dim> const double* PointGrid<Dim>::slot_velocities(const Chunk<Dim>& chunk, const Particles<Dim>& of,
                                                                 const Points<Dim>& velocity) const {
  thread_local AlignedVector<double> rooms;
  double* slots = room(rooms, 4 * of.marked.size());
  const Vec<Dim> common = common_velocity(of);
  for (std::size_t l = 0; l < of.slots.size(); ++l) {
    double* to = slots + 4 * of.slots[l];
    const double* from = velocity.data() + static_cast<std::ptrdiff_t>(Dim) * chunk.table.nodes[l];
    for (int i = 0; i < Dim; ++i) to[i] = from[i] - common[i];
    for (int i = Dim; i < 4; ++i) to[i] = 0.0;
  }
  return slots;
}

template <int Dim> const double* PointGrid<Dim>::gather(const Chunk<Dim>& chunk, const Particles<Dim>& of,
                                                        const Points<Dim>& velocity) const {
  thread_local AlignedVector<double> rooms;
  double* result = room(rooms, 4 * gathered_columns * static_cast<std::size_t>(of.count()));
  internal::gather(of.count(), of.box, of.positions(chunk).data(), slot_velocities(chunk, of, velocity), result);
  add_common<Dim>(common_velocity(of), of.count(), gathered_columns, result);
  return result;
}

template <int Dim> const double* PointGrid<Dim>::gather_values(const Chunk<Dim>& chunk, const Particles<Dim>& of,
                                                               const Points<Dim>& velocity) const {
  thread_local AlignedVector<double> rooms;
  double* result = room(rooms, 4 * static_cast<std::size_t>(of.count()));
  internal::gather_values(of.count(), of.box, of.positions(chunk).data(), slot_velocities(chunk, of, velocity), result);
  add_common<Dim>(common_velocity(of), of.count(), 1, result);
  return result;
}

template <int Dim> const double* PointGrid<Dim>::gather_modes(const Chunk<Dim>& chunk, const Particles<Dim>& of,
                                                              const Points<Dim>& velocity) const {
  double* result = modes(of, num_modes(Dim, degree_));
  internal::gather_modes(of.count(), of.box, of.positions(chunk).data(), slot_velocities(chunk, of, velocity), result);
  add_common<Dim>(common_velocity(of), of.count(), num_modes(Dim, degree_), result);
  return result;
}

template <int Dim> double* PointGrid<Dim>::modes(const Particles<Dim>& of, int count) const {
  thread_local AlignedVector<double> rooms;
  return room(rooms, 4 * static_cast<std::size_t>(count) * static_cast<std::size_t>(of.count()));
}

namespace {

AlignedVector<double>& scatter_room() {
  thread_local AlignedVector<double> rooms;
  return rooms;
}

/// Four of the eight numbers of every slot, by local number of a node.
template <int Dim> void copy_slots(const Particles<Dim>& of, int first, AlignedVector<double>& to) {
  const double* slots = scatter_room().data() + first;
  for (std::size_t l = 0; l < of.slots.size(); ++l)
    std::copy_n(slots + 8 * static_cast<std::ptrdiff_t>(of.slots[l]), 4, to.data() + 4 * l);
}

template <int Dim> Vec<Dim> velocity_by(const Eigen::Vector4d& momentum) {
  return momentum[3] > 0.0 ? Vec<Dim>(momentum.head<Dim>() / momentum[3]) : Vec<Dim>::Zero();
}

}  // namespace

template <int Dim> double* PointGrid<Dim>::clear_slots(const Particles<Dim>& of) const {
  double* slots = room(scatter_room(), 8 * of.marked.size());
  std::fill_n(slots, 8 * of.marked.size(), 0.0);
  return slots;
}

template <int Dim> void PointGrid<Dim>::take_slots(Chunk<Dim>& chunk, Particles<Dim>& of) const {
  take_momenta(of, of.momentum);
  take_forces(chunk, of);
}

template <int Dim> void PointGrid<Dim>::take_momenta(const Particles<Dim>& of, AlignedVector<double>& momenta) const {
  copy_slots(of, 0, momenta);
}

template <int Dim> void PointGrid<Dim>::take_forces(Chunk<Dim>& chunk, const Particles<Dim>& of) const {
  copy_slots(of, 4, chunk.table.force);
}

template <int Dim> Eigen::Vector4d PointGrid<Dim>::sum_at_node(const World<Dim>& world,
                                                               AlignedVector<double> Particles<Dim>::*momenta,
                                                               Index node) const {
  Eigen::Vector4d sum = Eigen::Vector4d::Zero();
  const NodeChunks& chunks = world.node_chunks;
  for (Index k = chunks.offsets[node]; k < chunks.offsets[node + 1]; ++k) {
    const auto [chunk, local] = chunks.places[k];
    sum += Eigen::Map<const Eigen::Vector4d>((particles[chunk].*momenta).data() + 4 * local);
  }
  return sum;
}

template <int Dim> void PointGrid<Dim>::collect_velocities(World<Dim>& world) const {
  Nodes<Dim>& nodes = world.nodes;
  parallel_for(nodes.size(), [&](Index a) {
    const Eigen::Vector4d sum = sum_at_node(world, &Particles<Dim>::momentum, a);
    nodes.mass[a] = sum[3];
    nodes.v.col(a) = velocity_by<Dim>(sum);
  });
}

template <int Dim>
Points<Dim> PointGrid<Dim>::velocities_of(World<Dim>& world,
                                          const std::function<const Points<Dim>&(const Particles<Dim>&)>& of_points) {
  for_each_chunk(world, [&](Chunk<Dim>& chunk, Particles<Dim>& of) {
    scatter(of.count(), of.box, of.moving(chunk, of_points(of)), clear_slots(of));
    take_slots(chunk, of);
  });
  Points<Dim> result(Dim, world.nodes.size());
  parallel_for(world.nodes.size(),
               [&](Index a) { result.col(a) = velocity_by<Dim>(sum_at_node(world, &Particles<Dim>::momentum, a)); });
  return result;
}

template class PointGrid<2>;
template class PointGrid<3>;

}  // namespace efree::internal
