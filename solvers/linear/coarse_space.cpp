// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/linear/internal/coarse_space.hpp"

#include "efree/assembly/internal/gather.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/core/parallel.hpp"

#include <algorithm>
#include <ranges>
#include <span>

namespace efree {
namespace {

/// Extents of where a function acts, least over largest, squared, under which its node turns: half a ball, as at the
/// face of a thick body, has 0.3.
constexpr double slim = 0.25;
/// Turning nodes, squared, that are worth their factor, over what an iteration costs: nodes of the elements times
/// reach of the smoother. In space factors grow with the square.
constexpr double most_turning = 10.0;

/// Displacement at x for rotations about the origin, one in each column; in the plane there is only one.
template <int Dim> Mat<Dim> rotations(const Vec<Dim>& x) {
  Mat<Dim> result = Mat<Dim>::Zero();
  if constexpr (Dim == 2)
    result.col(0) << -x[1], x[0];
  else
    result << 0.0, x[2], -x[1], -x[2], 0.0, x[0], x[1], -x[0], 0.0;
  return result;
}

/// Least over largest extent of where a function acts, squared: its own square says how much a place counts. Not a
/// number for a function of one place.
template <int Dim>
double slimness(const ShapeTable<Dim>& shape, std::span<const NodePlace> rows, const Points<Dim>& places) {
  double total = 0.0;
  Vec<Dim> mean = Vec<Dim>::Zero();
  for (const auto& [v, k] : rows) {
    const double N = shape.row(v).N[k];
    total += N * N;
    mean += N * N * places.col(v);
  }
  mean /= total;
  Mat<Dim> spread = Mat<Dim>::Zero();
  for (const auto& [v, k] : rows) {
    const double N = shape.row(v).N[k];
    const Vec<Dim> away = places.col(v) - mean;
    spread += N * N * away * away.transpose();
  }
  const Vec<Dim> extents = internal::eigenvalues<Dim>(spread);
  return extents[0] / extents[Dim - 1];
}

}  // namespace

template <int Dim>
std::vector<char> thin_nodes(const ShapeTable<Dim>& shape, const Points<Dim>& places, Index count, double apart) {
  const NodePlaces& rows_at = shape.by_node();
  std::vector<char> thin(shape.num_nodes());
  parallel_for(shape.num_nodes(), [&](Index I) { thin[I] = slimness<Dim>(shape, rows_at[I], places) < slim; });
  const auto turning = static_cast<double>(std::ranges::count(thin, 1));
  if (turning * turning > most_turning * static_cast<double>(count) * apart) std::ranges::fill(thin, 0);
  return thin;
}

template <int Dim> struct CoarseSpace<Dim>::Functions {
  ShapeTable<Dim> shape;
  Points<Dim> places, nodes;
  std::optional<Lift<Dim>> lift;
  HeldNodes<Dim> held;
  std::vector<Index> first{};  ///< by node: its motion; if it turns, the next is that
  bool turning = false;        ///< whether one does
  Ragged<NodePlace>
      followers{};  ///< by point of the lift: the nodes that follow it, with its position among their parents

  Functions(const BlockMatrix<Dim>& K, ShapeTable<Dim> table, Points<Dim> at, Points<Dim> of_nodes,
            const std::vector<char>& turn, const std::function<Mat<Dim>(Index)>& free, std::optional<Lift<Dim>> lifted)
      : shape(std::move(table)),
        places(std::move(at)),
        nodes(std::move(of_nodes)),
        lift(std::move(lifted)),
        held(K.size(), free) {
    const Index n = shape.num_nodes();
    first.assign(n + 1, 0);
    for (Index I = 0; I < n; ++I) first[I + 1] = first[I] + (turn[I] ? 2 : 1);
    turning = first.back() > n;
    if (lift)
      followers = places_of_nodes(static_cast<Index>(lift->points.cols()), K.size(), [&](Index node) {
        return lift->parents[node] | std::views::transform(&Lift<Dim>::Parent::point);
      });
  }

  const Points<Dim>& points() const { return lift ? lift->points : places; }
  bool turns(Index I) const { return first[I + 1] - first[I] == 2; }
  BlockMatrix<Dim> lifted_stiffness(const BlockMatrix<Dim>& K) const;
  SymmetricMatrix stiffness(const BlockMatrix<Dim>& K) const;

  RigidMap<Dim> by_nodes() const {
    RigidMap<Dim> map{.rows = {}, .places = points(), .others = nodes};
    map.rows.items.reserve(shape.num_entries());
    for (Index v = 0; v < shape.num_points(); ++v) {
      const auto row = shape.row(v);
      for (std::size_t k = 0; k < row.nodes.size(); ++k) map.rows.items.push_back({row.nodes[k], row.N[k]});
      map.rows.close_row();
    }
    return map;
  }
  RigidMap<Dim> by_points() const {
    RigidMap<Dim> map{.rows = {}, .places = places, .others = lift->points};
    map.rows.items.reserve(lift->parents.items.size());
    for (Index node = 0; node < lift->parents.rows(); ++node) {
      for (const auto& [point, share] : lift->parents[node]) map.rows.items.push_back({point, share});
      map.rows.close_row();
    }
    return map;
  }
};

template <int Dim>
CoarseSpace<Dim>::CoarseSpace(const BlockMatrix<Dim>& K, ShapeTable<Dim> shape, Points<Dim> places, Points<Dim> nodes,
                              const std::vector<char>& turning, const std::function<Mat<Dim>(Index)>& free,
                              std::optional<Lift<Dim>> lift)
    : CoarseSpace(Functions(K, std::move(shape), std::move(places), std::move(nodes), turning, free, std::move(lift)),
                  K) {}

template <int Dim> CoarseSpace<Dim>::CoarseSpace(Functions functions, const BlockMatrix<Dim>& K)
    : held_(functions.held),
      first_(functions.first),
      turning_(functions.turning),
      by_nodes_(functions.by_nodes()),
      of_nodes_(by_nodes_.mirrored()) {
  if (functions.lift) {
    by_points_ = functions.by_points();
    of_points_ = by_points_->mirrored();
  }
  factor_ = std::make_unique<ScaledCholesky>(
      functions.lift ? functions.stiffness(functions.lifted_stiffness(K)) : functions.stiffness(K), Dim);
}

/// The stiffness of the lift's points: of their translation, and, if nodes of the cloud turn, of their rotation next.
template <int Dim> BlockMatrix<Dim> CoarseSpace<Dim>::Functions::lifted_stiffness(const BlockMatrix<Dim>& K) const {
  const Index motions = turning ? 2 : 1;
  const auto arm = [&](Index node, Index point) -> Vec<Dim> { return places.col(node) - lift->points.col(point); };
  return gather_rows<Dim>(motions * static_cast<Index>(lift->points.cols()), [&](Index f, Accumulator<Mat<Dim>>& sums) {
    const Index point = f / motions;
    sums[f];
    for (const NodePlace& place : followers[point]) {
      const Index node = place.point;
      Mat<Dim> move = lift->parents[node][place.position].share * Mat<Dim>::Identity();
      if (f % motions == 1) move = move * rotations<Dim>(arm(node, point));
      if (const Mat<Dim>* open = held.at(node)) move = *open * move;
      K.for_row(node, [&](Index other, const Mat<Dim>& block) {
        Mat<Dim> force = move.transpose() * block;
        if (const Mat<Dim>* open = held.at(other)) force = force * *open;
        for (const auto& [parent, share] : lift->parents[other]) {
          sums[motions * parent] += share * force;
          if (turning) sums[2 * parent + 1].noalias() += share * force * rotations<Dim>(arm(other, parent));
        }
      });
    }
  });
}

template <int Dim> SymmetricMatrix CoarseSpace<Dim>::Functions::stiffness(const BlockMatrix<Dim>& K) const {
  std::vector<Index> node_of(first.back());
  for (Index I = 0; I < shape.num_nodes(); ++I)
    for (Index f = first[I]; f < first[I + 1]; ++f) node_of[f] = I;
  const Index motions = lift && turning ? 2 : 1;  // that K has for each point of the table
  const auto open_at = [&](Index v) { return lift ? nullptr : held.at(v); };
  SymmetricMatrix result = gather_blocks<Dim>(first.back(), [&](Index f, Accumulator<Mat<Dim>>& sums) {
    thread_local std::optional<Accumulator<Mat<Dim>>> scratch;  // K times the function
    if (!scratch || scratch->size() != K.size()) scratch.emplace(K.size());
    auto& forces = *scratch;
    forces.clear();
    const Index a = node_of[f];
    const bool turned = f > first[a];
    const auto add = [&](Index v, const Mat<Dim>& move) {
      K.for_row(v, [&](Index w, const Mat<Dim>& block) { forces[w].noalias() += block.transpose() * move; });
    };
    for (const auto& [v, k] : shape.by_node()[a]) {
      const double N = shape.row(v).N[k];
      const Mat<Dim>* open = open_at(v);
      if (!turned && !open) {
        K.for_row(motions * v, [&](Index w, const Mat<Dim>& block) { forces[w] += N * block.transpose(); });
        continue;
      }
      Mat<Dim> move = N * Mat<Dim>::Identity();
      if (turned && motions == 2) add(2 * v + 1, move);
      if (turned) move = N * rotations<Dim>(points().col(v) - nodes.col(a));
      if (open) move = *open * move;
      add(motions * v, move);
    }
    for (const Index of : forces.touched()) {
      const Index w = of / motions;
      const bool rotation = of % motions == 1;
      Mat<Dim> force = forces[of];
      if (const Mat<Dim>* open = open_at(w)) force = *open * force;
      const auto row = shape.row(w);
      const auto from = std::ranges::lower_bound(row.nodes, a) - row.nodes.begin();
      for (std::size_t l = from; l < row.nodes.size(); ++l) {
        const Index b = row.nodes[l];
        if (first[b] >= f && !rotation) sums[first[b]] += row.N[l] * force;
        if (turns(b) && rotation) sums[first[b] + 1] += row.N[l] * force;
        if (turns(b) && !rotation)
          sums[first[b] + 1].noalias() +=
              row.N[l] * (rotations<Dim>(points().col(w) - nodes.col(b)).transpose() * force);
      }
    }
  });
  // Functions that live on held nodes alone have no stiffness, and no part in the solution. Where all nodes of a body
  // turn alike nothing moves: those functions are not independent.
  for (Index i = 0; i < result.cols(); ++i) {
    double& pivot = result.coeffRef(i, i);
    if (!(pivot > 0.0))
      pivot = 1.0;
    else if (const Index f = i / Dim; f > first[node_of[f]])
      pivot *= 1.0 + 1e-10;
  }
  return result;
}

namespace {

/// Several fields in lanes; those that lack are zero.
template <int Dim> Lanes packed(std::span<const Points<Dim>* const> fields, int lanes) {
  const Index size = static_cast<Index>(fields.front()->size());
  Lanes all(std::size_t{1} * lanes * size);
  parallel_chunks(size, 4096 * Dim, [&](Index begin, Index end) {
    double* to = all.data() + std::ptrdiff_t{lanes} * begin;
    for (Index i = begin; i < end; ++i, to += lanes)
      for (std::size_t lane = 0; lane < fields.size(); ++lane) to[lane] = fields[lane]->data()[i];
  });
  return all;
}

}  // namespace

template <int Dim>
std::vector<Points<Dim>> CoarseSpace<Dim>::solve(const std::vector<const Points<Dim>*>& forces) const {
  constexpr std::size_t most = 8;
  std::vector<Points<Dim>> displacements;
  for (std::size_t first = 0; first < forces.size(); first += most) {
    const auto some = std::span(forces).subspan(first, std::min(most, forces.size() - first));
    solve_in(some.size() == 1 ? 1 : some.size() <= 4 ? 4 : 8, some, displacements);
  }
  return displacements;
}

template <int Dim> void CoarseSpace<Dim>::solve_in(int lanes, std::span<const Points<Dim>* const> forces,
                                                   std::vector<Points<Dim>>& displacements) const {
  const Index count = std::ssize(forces), n = std::ssize(first_) - 1;
  LanesPair given{packed<Dim>(forces, lanes), {}};
  if (of_points_) given = gather(*of_points_, lanes, given, turning_);
  given = gather(of_nodes_, lanes, given, turning_);
  // Numbers of a node in lanes, and those of its motion in columns.
  const auto for_each_motion = [&](LanesPair& pair, const auto& visit) {
    for (Index I = 0; I < n; ++I)
      for (Index f = first_[I]; f < first_[I + 1]; ++f)
        for (int d = 0; d < Dim; ++d)
          visit((f > first_[I] ? pair.turns : pair.moves).data() + std::ptrdiff_t{lanes} * (Dim * I + d), Dim * f + d);
  };
  Matrix columns(Dim * first_.back(), count);
  for_each_motion(given, [&](const double* from, Index row) {
    for (Index lane = 0; lane < count; ++lane) columns(row, lane) = from[lane];
  });
  const Matrix solution = factor_->solve_all(columns);
  const std::size_t size = std::size_t{Dim} * lanes * n;
  LanesPair moved{Lanes(size), Lanes(turning_ ? size : 0)};
  for_each_motion(moved, [&](double* to, Index row) {
    for (Index lane = 0; lane < count; ++lane) to[lane] = solution(row, lane);
  });
  moved = follow(by_nodes_, lanes, moved, turning_ && by_points_);
  if (by_points_) moved = follow(*by_points_, lanes, moved, false);
  const Index nodes = static_cast<Index>(forces.front()->cols());
  for (Index lane = 0; lane < count; ++lane) {
    Points<Dim>& z = displacements.emplace_back(Dim, nodes);
    parallel_chunks(nodes * Dim, 4096 * Dim, [&](Index begin, Index end) {
      const double* from = moved.moves.data() + std::ptrdiff_t{lanes} * begin + lane;
      for (Index i = begin; i < end; ++i, from += lanes) z.data()[i] = *from;
    });
    held_.release(z);
  }
}

template std::vector<char> thin_nodes<2>(const ShapeTable<2>&, const Points<2>&, Index, double);
template std::vector<char> thin_nodes<3>(const ShapeTable<3>&, const Points<3>&, Index, double);
template class CoarseSpace<2>;
template class CoarseSpace<3>;

}  // namespace efree
