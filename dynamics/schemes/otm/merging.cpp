// SPDX-License-Identifier: GPL-3.0-or-later
/// Merges nodes that have come too near to each other or have left the points behind, and points of collapsed cells.
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"

#include <Eigen/Eigenvalues>
#include <set>

namespace efree::internal {
namespace {

/// Largest distance of nodes that are merged, over their spacing.
constexpr double reach = 0.5;
/// Width of shape functions, over the first, below which a point lies in a plane of its nodes.
constexpr double flat = 0.1;
/// Largest shape function of a node at any point, below which there is nothing of the body around it.
constexpr double least_shape_function = 0.02;

/// Whether all that is prescribed of the second node is of the first.
template <int Dim> bool has_supports_of(const World<Dim>& world, Index a, Index other) {
  return std::ranges::all_of(world.prescribed, [&](const PrescribedVelocity<Dim>& theirs) {
    const auto is_same = [&](const PrescribedVelocity<Dim>& own) {
      return own.node == a && own.axis == theirs.axis && own.velocity == theirs.velocity && own.law == theirs.law;
    };
    return theirs.node != other || std::ranges::any_of(world.prescribed, is_same);
  });
}

/// The search of merge_close_nodes.
template <int Dim> class CloseNodes {
 public:
  CloseNodes(World<Dim>& world, OtmState<Dim>& state) : world_(world), state_(state) {}

  void merge() {
    state_.visibility.update(world_);
    state_.search.follow(world_);
    for (Index c = 0; c < static_cast<Index>(world_.chunks.size()); ++c) {
      Chunk<Dim>& chunk = world_.chunks[c];
      bool has_positions = false;
      for (Index p = 0; p < chunk.size(); ++p) {
        const Mat<Dim> moment = current_moment(chunk, p);
        const double width = smallest_width<Dim>(moment);
        const double first = first_width(c, p);
        if (chunk.is_eroded(p) || width >= state_.options.merging * first) continue;
        if (on_surface_.empty()) on_surface_ = state_.surface_nodes(world_);
        if (!std::exchange(has_positions, true)) update_positions(world_, chunk);
        Eigen::SelfAdjointEigenSolver<Mat<Dim>> axes;
        axes.computeDirect(moment);
        const Vec<Dim> n = axes.eigenvectors().col(0);
        if (!merge_near(c, p, n, width) && width < flat * first) move_off_plane(c, p, n, width);
      }
    }
  }

 private:
  /// Width of a point's shape functions at first; of fluids as far as they are compressed, along one axis as by shocks:
  /// nodes that come nearer with the fluid are not too many for it.
  double first_width(Index c, Index p) const {
    const Chunk<Dim>& chunk = world_.chunks[c];
    const double width = state_.points[c].width[p];
    if (!world_.bodies[chunk.body].runs_together) return width;
    return width * std::min(1.0, chunk.matter.now.gradient(p).determinant());
  }
  /// Merges one of the nodes that make a point's shape functions narrow across n; whether it does.
  bool merge_near(Index c, Index p, const Vec<Dim>& n, double width) {
    const Chunk<Dim>& chunk = world_.chunks[c];
    const Nodes<Dim>& nodes = world_.nodes;
    const Mat<Dim> inverse = deformation_since_table(chunk, p).inverse();
    // What makes the shape functions narrow is what they change most by.
    std::vector<std::pair<double, Index>> slopes;
    for (const auto& [a, entry] : chunk.table.row(p)) {
      const Vec<Dim> dN = Eigen::Map<const Vec<Dim>>(entry.dN);
      if (!world_.nodes.follows(a)) slopes.emplace_back(-std::abs(n.dot(inverse.transpose() * dN)), a);
    }
    std::ranges::sort(slopes);
    if (slopes.size() > 4) slopes.resize(4);
    for (const auto& [slope, steep] : slopes) {
      const Index a = steep;
      const auto distance = [&](Index b) { return (nodes.x.col(b) - nodes.x.col(a)).squaredNorm(); };
      const Index with = find_nearest(chunk.table.row(p) | std::views::keys, distance, [&](Index b) {
        return b != a && !world_.nodes.follows(b) && nodes.body[b] == nodes.body[a];
      });
      if (with < 0 || std::sqrt(distance(with)) > reach * 0.5 * (nodes.spacing[a] + nodes.spacing[with])) continue;
      // The surface stays where it is.
      const bool is_inner = !on_surface_[a] || on_surface_[with];
      if (merge_if_wider(is_inner ? a : with, is_inner ? with : a, c, p, 1.3 * width)) return true;
    }
    return false;
  }

  /// Merges the first node with the other, if all points that have it in their support have shape functions without it,
  /// and this point of these has wider ones. Nodes that these count on are locked.
  bool merge_if_wider(Index a, Index with, Index of_chunk, Index of_point, double width) {
    if (locked_.contains(a) || locked_.contains(with) || !has_supports_of(world_, with, a)) return false;
    world_.nodes.master[a] = with;
    ShapeFunctions<Dim> tried(world_, state_);
    const auto has_shape_functions = [&](Index c, Index p) {
      Mat<Dim> metric = world_.chunks[c].support.metric[p];
      Vec<Dim> lambda = state_.points[c].lambda[p];
      return tried.find(c, p, metric, lambda);
    };
    // Where it fails it does so at that point nearly always.
    bool good = has_shape_functions(of_chunk, of_point) && smallest_width<Dim>(tried.moment()) >= width;
    std::set<Index> counted_on;
    if (good)
      for_each_point_of(world_, a, [&](Index c, Index p) {
        if (!good) return;
        good = has_shape_functions(c, p);
        counted_on.insert(tried.nodes().begin(), tried.nodes().end());
      });
    world_.nodes.master[a] = -1;
    if (!good) return false;
    locked_.merge(counted_on);
    state_.merge_node(world_, a, with);
    return true;
  }

  /// A point whose shape functions narrow across n, as it is all but in a plane of nodes, and the nearest out of that
  /// plane come nearer to each other, their centre of mass where it is.
  void move_off_plane(Index c, Index p, const Vec<Dim>& n, double width) {
    const Chunk<Dim>& chunk = world_.chunks[c];
    OtmPoints<Dim>& points = state_.points[c];
    const Points<Dim>& x = chunk.matter.x;
    const auto is_free = [&](Index q) {
      const auto has_q = [&](const auto& pair) { return pair.first == q || pair.second == q; };
      return !chunk.is_inverted(q) && std::ranges::none_of(points.pairs, has_q);
    };
    if (!is_free(p)) return;
    const auto distance = [&](Index q) { return (x.col(q) - x.col(p)).squaredNorm(); };
    const Index with = find_nearest(std::views::iota(0, chunk.size()), distance, [&](Index q) {
      return !chunk.is_eroded(q) && std::abs(n.dot(x.col(q) - x.col(p))) > 4.0 * width && is_free(q);
    });
    if (with < 0) return;
    const double share = chunk.matter.mass[with] / (chunk.matter.mass[p] + chunk.matter.mass[with]);
    points.pairs.push_back({.first = p, .second = with, .displacement = 0.3 * share * (x.col(with) - x.col(p))});
    points.mark(p);
    points.mark(with);
  }

  World<Dim>& world_;
  OtmState<Dim>& state_;
  std::vector<char> on_surface_;  ///< by node; empty: not yet known
  std::set<Index> locked_;        ///< nodes that shape functions found so far count on
};

template <int Dim> std::set<Index> corners(const World<Dim>& world, const Chunk<Dim>& chunk, Index p) {
  const auto cell = world.bodies[chunk.body].cells.col(chunk.number[p]);
  return {cell.begin(), cell.end()};
}

/// The point to merge with: of those not busy that of most corners in common, the nearest of these; -1: none.
template <int Dim>
Index find_partner(const World<Dim>& world, const Chunk<Dim>& chunk, Index p, const std::set<Index>& busy) {
  const std::set<Index> own = corners(world, chunk, p);
  const auto shared = [&](Index q) {
    const std::set<Index> other = corners(world, chunk, q);
    return std::ranges::count_if(own, [&](Index corner) { return other.contains(corner); });
  };
  const auto distance = [&](Index q) {
    return std::pair(-shared(q), (chunk.matter.x.col(q) - chunk.matter.x.col(p)).squaredNorm());
  };
  return find_nearest(std::views::iota(0, chunk.size()), distance,
                      [&](Index q) { return !busy.contains(q) && !chunk.is_eroded(q) && shared(q) > 0; });
}

/// Energy of the points of a chunk, each with the dilatation J of its pressure patch.
template <int Dim> double energy_with(const Vector& J, const World<Dim>& world, const Chunk<Dim>& chunk) {
  const Matter<Dim>& matter = chunk.matter;
  Deformation deformation = matter.now;
  deformation.heat.resize(0);
  for (Index p = 0; p < chunk.size(); ++p) {
    const Mat<3> F = matter.F_since[p] * table_gradient(matter, p);
    Eigen::Map<Mat<3>>(deformation.F.col(p).data()) = F * std::cbrt(J[p] / F.determinant());
  }
  const MaterialResponse response = respond(*world.bodies[chunk.body].material, deformation, false);
  const double dissipated = response.dissipated.size() == 0 ? 0.0 : matter.volume.dot(response.dissipated);
  return matter.volume.dot(response.energy) + dissipated;
}

/// The pairs of a chunk that merge. The first gets the volume and mass of both; its history is its own, but for the
/// dilatation, by which the volume that both fill stays what it is. Their part in the dilatation of a pressure patch
/// changes: its points are scaled, so that it stays. Returns the numbers of points that are gone, in the body, and adds
/// the energy lost.
template <int Dim>
std::vector<Index> merge_pairs(const World<Dim>& world, Chunk<Dim>& chunk, OtmPoints<Dim>& points, double& lost) {
  Matter<Dim>& matter = chunk.matter;
  Vector& volume = matter.volume;
  const auto own_J = [&](Index p) { return matter.F_since[p].determinant() * table_gradient(matter, p).determinant(); };
  const auto mean = [&](Index begin, Index end, const auto& value) {
    double sum = 0.0, whole = 0.0;
    for (Index p = begin; p < end; ++p) {
      sum += volume[p] * value(p);
      whole += volume[p];
    }
    return whole > 0.0 ? sum / whole : 1.0;
  };
  update_positions(world, chunk);
  Vector J(chunk.size());  // of the points' pressure patches
  chunk.for_each_patch(
      [&](Index begin, Index end) { J.segment(begin, end - begin).setConstant(mean(begin, end, own_J)); });
  const double before = energy_with(J, world, chunk);
  std::vector<Index> gone, from;
  for (const auto& [p, q, displacement, merges] : points.pairs) {
    if (!merges) continue;
    J[p] = (volume[p] * J[p] + volume[q] * J[q]) / (volume[p] + volume[q]);
    volume[p] += volume[q];
    matter.mass[p] += matter.mass[q];
    if (matter.added_mass.size() != 0) matter.added_mass[p] += std::exchange(matter.added_mass[q], 0.0);
    chunk.support.stabilisation[p] += chunk.support.stabilisation[q];
    volume[q] = matter.mass[q] = 0.0;
    gone.push_back(q);
  }
  chunk.for_each_patch([&](Index begin, Index end) {
    const double wanted = mean(begin, end, [&](Index p) { return J[p]; }), now = mean(begin, end, own_J);
    for (Index p = begin; p < end; ++p) {
      matter.F_table.col(p) *= std::cbrt(wanted / now);
      matter.J[p] = J[p] = wanted;
    }
  });
  lost += before - energy_with(J, world, chunk);
  for (Index p = 0; p < chunk.size(); ++p)
    if (std::ranges::count(gone, p) == 0) from.push_back(p);
  for (Index& q : gone) q = chunk.number[q];
  points.take(from, chunk.take(from));
  return gone;
}

}  // namespace

/// As at a rim that is thrown off, they bear next to no mass, and fly anywhere: each is merged with the nearest of the
/// nodes in the tables of its points, on the surface if it is on it.
template <int Dim> void merge_detached_nodes(World<Dim>& world, OtmState<Dim>& state) {
  const Nodes<Dim>& nodes = world.nodes;
  Vector largest = Vector::Zero(nodes.size());
  for (const auto& chunk : world.chunks)
    for (Index p = 0; p < chunk.size(); ++p)
      for (const auto& [a, entry] : chunk.table.row(p))
        largest[a] = std::max(largest[a], chunk.is_eroded(p) ? 1.0 : entry.N);
  const auto is_detached = [&](Index a) {
    return !nodes.follows(a) && largest[a] > 0.0 && largest[a] < least_shape_function;
  };
  std::vector<char> on_surface;
  for (Index a = 0; a < nodes.size(); ++a) {
    if (!is_detached(a)) continue;
    if (on_surface.empty()) on_surface = state.surface_nodes(world);
    std::vector<Index> near_by;
    for_each_point_of(world, a, [&](Index c, Index p) {
      std::ranges::copy(world.chunks[c].table.row(p) | std::views::keys, std::back_inserter(near_by));
    });
    const auto distance = [&](Index b) {
      const bool leaves = on_surface[a] != 0 && on_surface[b] == 0;
      return std::pair(leaves, (nodes.x.col(b) - nodes.x.col(a)).squaredNorm());
    };
    const Index with = find_nearest(near_by, distance, [&](Index b) {
      return b != a && !nodes.follows(b) && !is_detached(b) && nodes.body[b] == nodes.body[a] &&
             has_supports_of(world, b, a);
    });
    if (with >= 0) state.merge_node(world, a, with);
  }
}

template <int Dim> void merge_close_nodes(World<Dim>& world, OtmState<Dim>& state) {
  CloseNodes<Dim>(world, state).merge();
}

/// Of cells that have collapsed, as nodes of theirs were merged.
template <int Dim> void pair_points_to_merge(World<Dim>& world, OtmState<Dim>& state) {
  bool found = false;
  for (std::size_t c = 0; c < world.chunks.size(); ++c) {
    Chunk<Dim>& chunk = world.chunks[c];
    OtmPoints<Dim>& points = state.points[c];
    if (world.bodies[chunk.body].cells.cols() == 0) continue;
    std::vector<Index> collapsed;
    for (Index p = 0; p < chunk.size(); ++p)
      if (!chunk.is_eroded(p) && !chunk.is_inverted(p) && static_cast<int>(corners(world, chunk, p).size()) <= Dim)
        collapsed.push_back(p);
    if (collapsed.empty()) continue;
    std::set<Index> busy(collapsed.begin(), collapsed.end());
    busy.insert(chunk.inverted.begin(), chunk.inverted.end());
    update_positions(world, chunk);
    for (const Index p : collapsed) {
      const Index with = find_partner(world, chunk, p, busy);
      if (with < 0) continue;
      busy.insert(with);
      // The larger goes on, in the cell that is left.
      const bool is_larger = chunk.matter.mass[p] > chunk.matter.mass[with];
      if (is_larger) std::swap(chunk.number[p], chunk.number[with]);
      points.pairs.push_back({.first = is_larger ? p : with, .second = is_larger ? with : p, .merges = true});
      points.mark(p);
      points.mark(with);
      found = true;
    }
  }
  if (found) world.find_points();
}

template <int Dim> void merge_points(World<Dim>& world, OtmState<Dim>& state) {
  std::vector<std::vector<Index>> gone(world.num_bodies());
  double lost = 0.0;
  for (std::size_t c = 0; c < world.chunks.size(); ++c) {
    Chunk<Dim>& chunk = world.chunks[c];
    if (std::ranges::none_of(state.points[c].pairs, [](const auto& pair) { return pair.merges; })) continue;
    std::ranges::copy(merge_pairs(world, chunk, state.points[c], lost), std::back_inserter(gone[chunk.body]));
  }
  if (std::ranges::all_of(gone, [](const auto& numbers) { return numbers.empty(); })) return;
  for (std::vector<Index>& numbers : gone) std::ranges::sort(numbers);
  const auto num_gone_before = [&](Index body, Index number) {
    return static_cast<Index>(std::ranges::lower_bound(gone[body], number) - gone[body].begin());
  };
  for (Index b = 0; b < world.num_bodies(); ++b) {
    if (gone[b].empty()) continue;
    world.ledger.add_count("merged points", static_cast<Index>(gone[b].size()));
    Cells<Dim>& cells = world.bodies[b].cells;
    for (Index c = 0; c < cells.cols(); ++c) cells.col(c - num_gone_before(b, c)) = cells.col(c).eval();
    cells.conservativeResize(Eigen::NoChange, cells.cols() - static_cast<Index>(gone[b].size()));
    state.outer[b].clear();
  }
  for (auto& chunk : world.chunks)
    for (Index& number : chunk.number) number -= num_gone_before(chunk.body, number);
  world.ledger.add_energy("reconnection", EnergyKind::transfer, lost);
  world.find_points();
}

template void merge_detached_nodes(World<2>&, OtmState<2>&);
template void merge_detached_nodes(World<3>&, OtmState<3>&);
template void merge_close_nodes(World<2>&, OtmState<2>&);
template void merge_close_nodes(World<3>&, OtmState<3>&);
template void pair_points_to_merge(World<2>&, OtmState<2>&);
template void pair_points_to_merge(World<3>&, OtmState<3>&);
template void merge_points(World<2>&, OtmState<2>&);
template void merge_points(World<3>&, OtmState<3>&);

}  // namespace efree::internal
