// SPDX-License-Identifier: GPL-3.0-or-later
/// Momentum of material points, from the nodes of the shape functions they had to those of the new ones.
#include "efree/core/internal/spectrum.hpp"
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace efree::internal {
namespace {

/// The rotation whose angular momentum is that of first moments of velocities, on shape functions of that second
/// moment; as far as there is one (none about nodes that are in one place, nor about a line of them).
template <int Dim> Mat<Dim> rotation_of(const Mat<Dim>& velocities, const Mat<Dim>& moment) {
  const Mat<Dim> skew = velocities - velocities.transpose();
  if (!(moment.trace() > 0.0)) return Mat<Dim>::Zero();
  if constexpr (Dim == 2) {
    return skew / moment.trace();
  } else {
    const Mat<3> inertia = moment.trace() * Mat<3>::Identity() - moment;
    const Vec<3> spin = pseudo_inverse<3>(inertia) * Vec<3>(skew(2, 1), skew(0, 2), skew(1, 0));
    Mat<3> result;
    result << 0.0, -spin[2], spin[1], spin[2], 0.0, -spin[0], -spin[1], spin[0], 0.0;
    return result;
  }
}

/// An affine velocity about the centre of mass of points.
template <int Dim> struct AffineVelocity {
  Vec<Dim> shift = Vec<Dim>::Zero();
  Mat<Dim> gradient = Mat<Dim>::Zero();
};

/// What the nodes' velocities lack, on the new rows, of the momentum and the first moments of velocity that the points
/// have: mean and affine, per mass m.
template <int Dim> AffineVelocity<Dim> correction(const World<Dim>& world, const Chunk<Dim>& chunk,
                                                  const std::vector<PointRow>& rows, double m, const Vec<Dim>& at,
                                                  const Vec<Dim>& mean, const Mat<Dim>& affine) {
  const Points<Dim>&x = world.nodes.x, &v = world.nodes.v;
  Vec<Dim> shift = mean;
  Mat<Dim> turn = affine, moment = Mat<Dim>::Zero();
  for (const auto& [p, row] : rows)
    for (const auto& [a, entry] : *row) {
      const double part = chunk.matter.mass[p] * entry.N / m;
      const Vec<Dim> d = x.col(a) - at;
      shift -= part * v.col(a);
      turn -= part * v.col(a) * d.transpose();
      moment += part * d * d.transpose();
    }
  const Mat<Dim> rotation = rotation_of<Dim>(turn, moment);
  // Where shape functions are narrow the inverse would keep fewer digits of the angular momentum.
  turn = moment.ldlt().solve(turn.transpose()).transpose().eval();
  // No more of what is no rotation than gains no energy: on narrow shape functions it would be many times what there
  // was. Over half the mass, against the mean velocity.
  double before = 0.0, after = 0.0, mixed = 0.0, stretched = 0.0;
  for (const auto& [p, row] : rows) {
    for (Index e = chunk.table.offsets[p]; e < chunk.table.offsets[p + 1]; ++e)
      before += chunk.matter.mass[p] / m * chunk.table.entries[e].N *
                (v.col(chunk.table.nodes[chunk.table.local[e]]) - mean).squaredNorm();
    for (const auto& [a, entry] : *row) {
      const double part = chunk.matter.mass[p] * entry.N / m;
      const Vec<Dim> d = x.col(a) - at, speed = v.col(a) + shift + rotation * d - mean, stretch = (turn - rotation) * d;
      after += part * speed.squaredNorm();
      mixed += part * speed.dot(stretch);
      stretched += part * stretch.squaredNorm();
    }
  }
  if (after + 2.0 * mixed + stretched > before && stretched > 0.0) {
    const double root = mixed * mixed - stretched * (after - before);
    const double share = (std::sqrt(std::max(0.0, root)) - mixed) / stretched;
    turn = rotation + std::min(1.0, share) * (turn - rotation);
  }
  return {shift, turn};
}

}  // namespace

template <int Dim> void transfer_momentum(const World<Dim>& world, MomentumTransfer how, const Chunk<Dim>& chunk,
                                          const std::vector<PointRow>& rows, Vector& masses, Points<Dim>& momenta) {
  const Points<Dim>&x = world.nodes.x, &v = world.nodes.v;
  double m = 0.0;
  Vec<Dim> at = Vec<Dim>::Zero();
  for (const auto& [p, row] : rows) {
    m += chunk.matter.mass[p];
    at += chunk.matter.mass[p] * chunk.matter.x.col(p);
  }
  at /= m;
  Vec<Dim> mean = Vec<Dim>::Zero();
  Mat<Dim> affine = Mat<Dim>::Zero();
  for (const auto& [p, row] : rows)
    for (Index e = chunk.table.offsets[p]; e < chunk.table.offsets[p + 1]; ++e) {
      const Index a = chunk.table.nodes[chunk.table.local[e]];
      const double part = chunk.matter.mass[p] * chunk.table.entries[e].N;
      mean += part / m * v.col(a);
      affine += part / m * v.col(a) * (x.col(a) - at).transpose();
      masses[a] -= part;
      momenta.col(a) -= part * v.col(a);
    }
  AffineVelocity<Dim> added;
  if (how == MomentumTransfer::affine) added = correction(world, chunk, rows, m, at, mean, affine);
  for (const auto& [p, row] : rows)
    for (const auto& [a, entry] : *row) {
      const double part = chunk.matter.mass[p] * entry.N;
      masses[a] += part;
      if (how == MomentumTransfer::points)
        momenta.col(a) += part * mean;
      else
        momenta.col(a) += part * (v.col(a) + added.shift + added.gradient * (x.col(a) - at));
    }
}

template void transfer_momentum(const World<2>&, MomentumTransfer, const Chunk<2>&, const std::vector<PointRow>&,
                                Vector&, Points<2>&);
template void transfer_momentum(const World<3>&, MomentumTransfer, const Chunk<3>&, const std::vector<PointRow>&,
                                Vector&, Points<3>&);

}  // namespace efree::internal
