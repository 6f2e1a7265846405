// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/internal/coarse_space.hpp"

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
constexpr double too_many = 10.0;

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
  if (turning * turning > too_many * static_cast<double>(count) * apart) std::ranges::fill(thin, 0);
  return thin;
}

template <int Dim>
CoarseSpace<Dim>::CoarseSpace(const BlockMatrix<Dim>& K, ShapeTable<Dim> shape, Points<Dim> places, Points<Dim> nodes,
                              const std::vector<char>& turning, const std::function<Mat<Dim>(Index)>& free,
                              std::optional<Lift<Dim>> lift)
    : shape_(std::move(shape)),
      places_(std::move(places)),
      nodes_(std::move(nodes)),
      lift_(std::move(lift)),
      held_(K.size(), free) {
  const Index n = shape_.num_nodes();
  first_.assign(n + 1, 0);
  for (Index I = 0; I < n; ++I) first_[I + 1] = first_[I] + (turning[I] ? 2 : 1);
  turning_ = first_.back() > n;
  if (lift_)
    followers_ = places_of_nodes(static_cast<Index>(lift_->points.cols()), K.size(), [&](Index node) {
      return lift_->parents[node] | std::views::transform(&Lift<Dim>::Parent::point);
    });
  factor_ = std::make_unique<ScaledCholesky>(lift_ ? stiffness(lifted_stiffness(K)) : stiffness(K), Dim);
}

/// The stiffness of the lift's points: of their translation, and, if nodes of the cloud turn, of their rotation next.
template <int Dim> BlockMatrix<Dim> CoarseSpace<Dim>::lifted_stiffness(const BlockMatrix<Dim>& K) const {
  const Index motions = turning_ ? 2 : 1;
  const auto arm = [&](Index node, Index point) -> Vec<Dim> { return places_.col(node) - lift_->points.col(point); };
  return gather_rows<Dim>(
      motions * static_cast<Index>(lift_->points.cols()), [&](Index f, Accumulator<Mat<Dim>>& sums) {
        const Index point = f / motions;
        sums[f];
        for (const Place& place : followers_[point]) {
          const Index node = place.row;
          Mat<Dim> move = lift_->parents[node][place.position].share * Mat<Dim>::Identity();
          if (f % motions == 1) move = move * rotations<Dim>(arm(node, point));
          if (const Mat<Dim>* open = held_.at(node)) move = *open * move;
          K.for_row(node, [&](Index other, const Mat<Dim>& block) {
            Mat<Dim> force = move.transpose() * block;
            if (const Mat<Dim>* open = held_.at(other)) force = force * *open;
            for (const auto& [parent, share] : lift_->parents[other]) {
              sums[motions * parent] += share * force;
              if (turning_) sums[2 * parent + 1].noalias() += share * force * rotations<Dim>(arm(other, parent));
            }
          });
        }
      });
}

template <int Dim> SymmetricMatrix CoarseSpace<Dim>::stiffness(const BlockMatrix<Dim>& K) const {
  std::vector<Index> node_of(first_.back());
  for (Index I = 0; I < shape_.num_nodes(); ++I)
    for (Index f = first_[I]; f < first_[I + 1]; ++f) node_of[f] = I;
  const Index motions = lift_ && turning_ ? 2 : 1;  // that K has for each point of the table
  const auto open_at = [&](Index v) { return lift_ ? nullptr : held_.at(v); };
  SymmetricMatrix result = gather_blocks<Dim>(first_.back(), [&](Index f, Accumulator<Mat<Dim>>& sums) {
    thread_local std::optional<Accumulator<Mat<Dim>>> scratch;  // K times the function
    if (!scratch || scratch->size() != K.size()) scratch.emplace(K.size());
    auto& forces = *scratch;
    forces.clear();
    const Index a = node_of[f];
    const bool turned = f > first_[a];
    const auto add = [&](Index v, const Mat<Dim>& move) {
      K.for_row(v, [&](Index w, const Mat<Dim>& block) { forces[w].noalias() += block.transpose() * move; });
    };
    for (const auto& [v, k] : shape_.by_node()[a]) {
      const double N = shape_.row(v).N[k];
      const Mat<Dim>* open = open_at(v);
      if (!turned && !open) {
        K.for_row(motions * v, [&](Index w, const Mat<Dim>& block) { forces[w] += N * block.transpose(); });
        continue;
      }
      Mat<Dim> move = N * Mat<Dim>::Identity();
      if (turned && motions == 2) add(2 * v + 1, move);
      if (turned) move = N * rotations<Dim>(points().col(v) - nodes_.col(a));
      if (open) move = *open * move;
      add(motions * v, move);
    }
    for (const Index of : forces.touched()) {
      const Index w = of / motions;
      const bool rotation = of % motions == 1;
      Mat<Dim> force = forces[of];
      if (const Mat<Dim>* open = open_at(w)) force = *open * force;
      const auto row = shape_.row(w);
      const auto from = std::ranges::lower_bound(row.nodes, a) - row.nodes.begin();
      for (std::size_t l = from; l < row.nodes.size(); ++l) {
        const Index b = row.nodes[l];
        if (first_[b] >= f && !rotation) sums[first_[b]] += row.N[l] * force;
        if (turns(b) && rotation) sums[first_[b] + 1] += row.N[l] * force;
        if (turns(b) && !rotation)
          sums[first_[b] + 1].noalias() +=
              row.N[l] * (rotations<Dim>(points().col(w) - nodes_.col(b)).transpose() * force);
      }
    }
  });
  // Functions that live on held nodes alone have no stiffness, and no part in the solution. Where all nodes of a body
  // turn alike nothing moves: those functions are not independent.
  for (Index i = 0; i < result.cols(); ++i) {
    double& pivot = result.coeffRef(i, i);
    if (!(pivot > 0.0))
      pivot = 1.0;
    else if (const Index f = i / Dim; f > first_[node_of[f]])
      pivot *= 1.0 + 1e-10;
  }
  return result;
}

namespace {

/// Several fields side by side: their columns at a node are next to each other; those that lack are zero.
template <int Dim, int lanes> Points<Dim> packed(std::span<const Points<Dim>* const> fields) {
  const Index count = static_cast<Index>(fields.front()->cols());
  Points<Dim> all(Dim, lanes * count);
  parallel_chunks(count, 4096, [&](Index begin, Index end) {
    for (Index node = begin; node < end; ++node) {
      auto there = all.template middleCols<lanes>(lanes * node);
      for (int lane = 0; lane < lanes; ++lane)
        if (lane < std::ssize(fields))
          there.col(lane) = fields[lane]->col(node);
        else
          there.col(lane).setZero();
    }
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
    if (some.size() == 1)
      solve_in<1>(some, displacements);
    else if (some.size() <= 4)
      solve_in<4>(some, displacements);
    else
      solve_in<most>(some, displacements);
  }
  return displacements;
}

template <int Dim> template <int lanes> void CoarseSpace<Dim>::solve_in(std::span<const Points<Dim>* const> forces,
                                                                        std::vector<Points<Dim>>& displacements) const {
  const Index nodes = static_cast<Index>(forces.front()->cols());
  const Points<Dim> own = lanes == 1 ? gathered<1>(*forces.front()) : gathered<lanes>(packed<Dim, lanes>(forces));
  Matrix columns(Dim * first_.back(), std::ssize(forces));
  for (Index f = 0; f < first_.back(); ++f)
    columns.middleRows<Dim>(Dim * f) = own.middleCols(lanes * f, std::ssize(forces));
  const Matrix solution = factor_->solve_all(columns);
  Points<Dim> moved = Points<Dim>::Zero(Dim, lanes * first_.back());
  for (Index f = 0; f < first_.back(); ++f)
    moved.middleCols(lanes * f, std::ssize(forces)) = solution.middleRows<Dim>(Dim * f);
  Points<Dim> all = spread<lanes>(moved, nodes);
  if constexpr (lanes == 1) {
    held_.release(displacements.emplace_back(std::move(all)));
  } else {
    for (Index lane = 0; lane < std::ssize(forces); ++lane) {
      Points<Dim>& z = displacements.emplace_back(Dim, nodes);
      parallel_chunks(nodes, 4096, [&](Index begin, Index end) {
        for (Index node = begin; node < end; ++node) z.col(node) = all.col(lanes * node + lane);
      });
      held_.release(z);
    }
  }
}

template <int Dim> template <int lanes> Points<Dim> CoarseSpace<Dim>::gathered(const Points<Dim>& r) const {
  using Forces = Eigen::Matrix<double, Dim, lanes>;
  const auto at = [](auto& fields, Index node) { return fields.template middleCols<lanes>(lanes * node); };
  const Index count = static_cast<Index>(points().cols());
  Points<Dim> lifted, moments;  // on the points of the lift
  if (lift_) {
    lifted.resize(Dim, lanes * count);
    if (turning_) moments.resize(Dim, lanes * count);
    parallel_for(count, [&](Index p) {
      Forces force = Forces::Zero(), moment = Forces::Zero();
      for (const Place& place : followers_[p]) {
        const Forces part = lift_->parents[place.row][place.position].share * at(r, place.row);
        force += part;
        if (turning_)
          moment.noalias() += rotations<Dim>(places_.col(place.row) - lift_->points.col(p)).transpose() * part;
      }
      at(lifted, p) = force;
      if (turning_) at(moments, p) = moment;
    });
  }
  const Points<Dim>& given = lift_ ? lifted : r;
  Points<Dim> forces(Dim, lanes * first_.back());
  parallel_for(shape_.num_nodes(), [&](Index I) {
    Forces force = Forces::Zero(), moment = Forces::Zero();
    for (const auto& [v, k] : shape_.by_node()[I]) {
      const double N = shape_.row(v).N[k];
      const Forces part = N * at(given, v);
      force += part;
      if (!turns(I)) continue;
      moment.noalias() += rotations<Dim>(points().col(v) - nodes_.col(I)).transpose() * part;
      if (lift_) moment += N * at(moments, v);
    }
    at(forces, first_[I]) = force;
    if (turns(I)) at(forces, first_[I] + 1) = moment;
  });
  return forces;
}

template <int Dim> template <int lanes>
Points<Dim> CoarseSpace<Dim>::spread(const Points<Dim>& moved, Index nodes) const {
  using Displacements = Eigen::Matrix<double, Dim, lanes>;
  const auto at = [](auto& fields, Index node) { return fields.template middleCols<lanes>(lanes * node); };
  const Index count = static_cast<Index>(points().cols());
  Points<Dim> z(Dim, lanes * count), turned;
  if (lift_ && turning_) turned.resize(Dim, lanes * count);
  parallel_for(count, [&](Index v) {
    const auto row = shape_.row(v);
    Displacements sum = Displacements::Zero(), turn = Displacements::Zero();
    for (std::size_t k = 0; k < row.nodes.size(); ++k) {
      const Index I = row.nodes[k];
      sum += row.N[k] * at(moved, first_[I]);
      if (!turns(I)) continue;
      sum.noalias() += row.N[k] * (rotations<Dim>(points().col(v) - nodes_.col(I)) * at(moved, first_[I] + 1));
      turn += row.N[k] * at(moved, first_[I] + 1);
    }
    at(z, v) = sum;
    if (turned.size() > 0) at(turned, v) = turn;
  });
  if (!lift_) return z;
  Points<Dim> followed(Dim, lanes * nodes);
  parallel_for(nodes, [&](Index node) {
    Displacements sum = Displacements::Zero();
    for (const auto& [point, share] : lift_->parents[node]) {
      sum += share * at(z, point);
      if (turning_)
        sum.noalias() += share * (rotations<Dim>(places_.col(node) - lift_->points.col(point)) * at(turned, point));
    }
    at(followed, node) = sum;
  });
  return followed;
}

template std::vector<char> thin_nodes<2>(const ShapeTable<2>&, const Points<2>&, Index, double);
template std::vector<char> thin_nodes<3>(const ShapeTable<3>&, const Points<3>&, Index, double);
template class CoarseSpace<2>;
template class CoarseSpace<3>;

}  // namespace efree
