// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/frame_grids.hpp"

#include "efree/core/internal/spectrum.hpp"

#include <algorithm>
#include <cmath>

namespace efree::internal {
namespace {

/// Calls f(lower, upper) for pairs of nodes at both ends of an axis.
template <class F> void for_ends(const CellLayout& grid, int axis, const F& f) {
  const int first = axis == 0 ? 1 : 0, second = axis == 2 ? 1 : 2;
  parallel_chunks(grid.cells[second] + 1, 64, [&](Index begin, Index end) {
    std::array<Index, 3> at{};
    for (at[second] = begin; at[second] < end; ++at[second])
      for (at[first] = 0; at[first] <= grid.cells[first]; ++at[first]) {
        at[axis] = 0;
        const std::size_t lower = grid.node(at[0], at[1], at[2]);
        at[axis] = grid.cells[axis];
        f(lower, grid.node(at[0], at[1], at[2]));
      }
  });
}

/// Calls f(node) for the nodes of all sides, those of edges more than once.
template <class F> void for_frame(const CellLayout& grid, const F& f) {
  for (int axis = 0; axis < 3; ++axis)
    for_ends(grid, axis, [&](std::size_t lower, std::size_t upper) {
      f(lower);
      f(upper);
    });
}

}  // namespace

FrameGrid::FrameGrid(std::unique_ptr<CellOperator> matrix_, FrameCondition frame_)
    : matrix(std::move(matrix_)), frame(frame_), inverse_diagonal(matrix->bound()) {
  const std::size_t nodes = matrix->layout().nodes();
  fold(inverse_diagonal.data());
  if (frame == FrameCondition::kinematic)
    for (int c = 0; c < matrix->components(); ++c)
      for_frame(matrix->layout(), [&](std::size_t node) { inverse_diagonal[c * nodes + node] = 0.0F; });
  for_all(inverse_diagonal.size(), [&](std::size_t i) {
    float& d = inverse_diagonal[i];
    d = d > 0.0F ? 1.0F / d : 0.0F;
  });
}

template <class T> void FrameGrid::spread(T* u) const {
  if (frame != FrameCondition::periodic) return;
  const CellLayout& grid = matrix->layout();
  for (int axis = 0; axis < 3; ++axis)
    for (int c = 0; c < matrix->components(); ++c) {
      T* of = u + c * grid.nodes();
      for_ends(grid, axis, [&](std::size_t lower, std::size_t upper) { of[upper] = of[lower]; });
    }
}

template <class T> void FrameGrid::fold(T* f) const {
  if (frame != FrameCondition::periodic) return;
  const CellLayout& grid = matrix->layout();
  for (int axis = 0; axis < 3; ++axis)
    for (int c = 0; c < matrix->components(); ++c) {
      T* of = f + c * grid.nodes();
      for_ends(grid, axis, [&](std::size_t lower, std::size_t upper) {
        of[lower] += of[upper];
        of[upper] = T(0);
      });
    }
}

template void FrameGrid::spread(float*) const;
template void FrameGrid::spread(double*) const;
template void FrameGrid::fold(float*) const;
template void FrameGrid::fold(double*) const;

Transfer::Transfer(const FrameGrid& coarse, const FrameGrid& fine) : coarse_(&coarse), fine_(&fine) {
  for (int d = 0; d < 3; ++d) {
    Axis& axis = axes_[d];
    const Index m = coarse.matrix->layout().cells[d], n = fine.matrix->layout().cells[d];
    std::vector<std::vector<std::pair<Index, float>>> shares(m + 1);
    for (Index i = 0; i <= n; ++i) {
      const std::int64_t place = static_cast<std::int64_t>(i) * m;
      const auto lower = static_cast<Index>(std::min<std::int64_t>(place / n, m - 1));
      const auto share = static_cast<float>(static_cast<double>(place - static_cast<std::int64_t>(lower) * n) /
                                            static_cast<double>(n));
      axis.lower.push_back(lower);
      axis.share.push_back(share);
      if (share < 1.0F) shares[lower].emplace_back(i, 1.0F - share);
      if (share > 0.0F) shares[lower + 1].emplace_back(i, share);
    }
    axis.begin.push_back(0);
    for (const auto& of_node : shares) {
      for (const auto& [i, share] : of_node) {
        axis.fine.push_back(i);
        axis.share_of_fine.push_back(share);
      }
      axis.begin.push_back(axis.fine.size());
    }
  }
}

template <class T> void Transfer::prolong(T* from, T* to) const {
  const CellLayout &coarse = coarse_->matrix->layout(), &fine = fine_->matrix->layout();
  const float* inverse = fine_->inverse_diagonal.data();
  coarse_->spread(from);
  const auto& [x, y, z] = axes_;
  parallel_chunks(fine.cells[2] + 1, 4, [&](Index begin, Index end) {
    std::vector<T> line(coarse.cells[0] + 1);
    for (int c = 0; c < fine_->matrix->components(); ++c)
      for (Index k = begin; k < end; ++k)
        for (Index j = 0; j <= fine.cells[1]; ++j) {
          const T* base = from + c * coarse.nodes();
          const Index j0 = y.lower[j], k0 = z.lower[k];
          const T a = y.share[j], b = z.share[k];
          const T weights[4] = {(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b};
          const T* rows[4] = {base + coarse.node(0, j0, k0), base + coarse.node(0, j0 + 1, k0),
                              base + coarse.node(0, j0, k0 + 1), base + coarse.node(0, j0 + 1, k0 + 1)};
          for (Index i = 0; i <= coarse.cells[0]; ++i)
            line[i] =
                weights[0] * rows[0][i] + weights[1] * rows[1][i] + weights[2] * rows[2][i] + weights[3] * rows[3][i];
          const std::size_t node = c * fine.nodes() + fine.node(0, j, k);
          for (Index i = 0; i <= fine.cells[0]; ++i) {
            const Index low = x.lower[i];
            const T value = line[low] + x.share[i] * (line[low + 1] - line[low]);
            to[node + i] += inverse[node + i] > 0.0F ? value : T(0);
          }
        }
  });
}
template void Transfer::prolong(float*, float*) const;
template void Transfer::prolong(double*, double*) const;

void Transfer::restrict_to_coarse(const float* from, float* to) const {
  const CellLayout &coarse = coarse_->matrix->layout(), &fine = fine_->matrix->layout();
  const auto& [x, y, z] = axes_;
  parallel_chunks(coarse.cells[2] + 1, 2, [&](Index begin, Index end) {
    std::vector<float> line(fine.cells[0] + 1);
    for (int c = 0; c < fine_->matrix->components(); ++c)
      for (Index k = begin; k < end; ++k)
        for (Index j = 0; j <= coarse.cells[1]; ++j) {
          std::ranges::fill(line, 0.0F);
          for (std::size_t s = z.begin[k]; s < z.begin[k + 1]; ++s)
            for (std::size_t t = y.begin[j]; t < y.begin[j + 1]; ++t) {
              const float weight = z.share_of_fine[s] * y.share_of_fine[t];
              const float* row = from + c * fine.nodes() + fine.node(0, y.fine[t], z.fine[s]);
              for (Index i = 0; i <= fine.cells[0]; ++i) line[i] += weight * row[i];
            }
          float* row = to + c * coarse.nodes() + coarse.node(0, j, k);
          for (Index i = 0; i <= coarse.cells[0]; ++i) {
            float sum = 0.0F;
            for (std::size_t s = x.begin[i]; s < x.begin[i + 1]; ++s) sum += x.share_of_fine[s] * line[x.fine[s]];
            row[i] = sum;
          }
        }
  });
  coarse_->fold(to);
  for_all(coarse_->inverse_diagonal.size(), [&](std::size_t i) {
    if (coarse_->inverse_diagonal[i] == 0.0F) to[i] = 0.0F;
  });
}

FrameMultigrid::FrameMultigrid(const std::vector<FrameGrid>& grids, int most) : grids_(grids), work_(grids.size()) {
  for (std::size_t l = 0; l + 1 < grids.size(); ++l) transfers_.emplace_back(grids[l + 1], grids[l]);
  for (std::size_t l = 0; l < grids.size(); ++l) {
    work_[l].resize(most);
    for (Work& work : work_[l])
      for (auto* field : {&work.b, &work.x, &work.step, &work.rest}) *field = zeros<float>(grids[l].matrix->size());
  }
  invert_coarsest();
}

void FrameMultigrid::invert_coarsest() {
  const FrameGrid& grid = grids_.back();
  const std::size_t size = grid.matrix->size();
  for (std::size_t i = 0; i < size; ++i)
    if (grid.inverse_diagonal[i] > 0.0F) coarsest_dofs_.push_back(i);
  const auto unknowns = static_cast<Index>(coarsest_dofs_.size());
  Matrix K(unknowns, unknowns);
  Field u = zeros<double>(size), f = zeros<double>(size);
  double *from = u.data(), *to = f.data();
  for (Index column = 0; column < unknowns; ++column) {
    for_all(size, [&](std::size_t i) { u[i] = 0.0; });
    u[coarsest_dofs_[column]] = 1.0;
    grid.multiply_isotropic(&from, &to, 1, Dilatation::local);
    for (Index row = 0; row < unknowns; ++row) K(row, column) = f[coarsest_dofs_[row]];
  }
  if (unknowns == 0) return;
  // Scaled, so that soft materials do not count as none.
  Vector scale(unknowns);
  for (Index i = 0; i < unknowns; ++i) scale[i] = std::sqrt(grid.inverse_diagonal[coarsest_dofs_[i]]);
  const Matrix scaled = scale.asDiagonal() * K * scale.asDiagonal();
  coarsest_inverse_ = scale.asDiagonal() * pseudo_inverse<Eigen::Dynamic>(scaled) * scale.asDiagonal();
}

void FrameMultigrid::multiply(std::size_t l, int count, Dilatation dilatation) {
  std::vector<float*> u(count), f(count);
  for (int r = 0; r < count; ++r) {
    u[r] = work_[l][r].x.data();
    f[r] = work_[l][r].rest.data();
  }
  grids_[l].multiply_isotropic(u.data(), f.data(), count, dilatation);
}

/// x += a polynomial of b - K x (chebyshev_steps).
void FrameMultigrid::smooth(std::size_t l, int count, bool from_zero, Dilatation dilatation) {
  const float* inverse = grids_[l].inverse_diagonal.data();
  const auto steps = chebyshev_steps();
  for (std::size_t s = 0; s < steps.size(); ++s) {
    const float keep = steps[s].keep, take = steps[s].take;
    const bool zero = from_zero && s == 0;
    if (!zero) multiply(l, count, dilatation);
    for (int r = 0; r < count; ++r) {
      Work& w = work_[l][r];
      if (zero)
        for_all(w.b.size(), [&](std::size_t i) { w.x[i] = w.step[i] = take * inverse[i] * w.b[i]; });
      else if (s == 0)
        for_all(w.b.size(), [&](std::size_t i) {
          w.step[i] = take * inverse[i] * (w.b[i] - w.rest[i]);
          w.x[i] += w.step[i];
        });
      else
        for_all(w.b.size(), [&](std::size_t i) {
          w.step[i] = keep * w.step[i] + take * inverse[i] * (w.b[i] - w.rest[i]);
          w.x[i] += w.step[i];
        });
    }
  }
}

void FrameMultigrid::cycle(std::size_t l, int count) {
  cycle(l, count, grids_[l].matrix->dilatation());
}
void FrameMultigrid::cycle(std::size_t l, int count, Dilatation dilatation) {
  if (l + 1 == grids_.size()) {
    for (int r = 0; r < count; ++r) {
      Work& w = work_[l][r];
      Vector b(coarsest_dofs_.size());
      for (std::size_t i = 0; i < coarsest_dofs_.size(); ++i) b[i] = w.b[coarsest_dofs_[i]];
      const Vector x = coarsest_inverse_ * b;
      std::ranges::fill(w.x, 0.0F);
      for (std::size_t i = 0; i < coarsest_dofs_.size(); ++i) w.x[coarsest_dofs_[i]] = static_cast<float>(x[i]);
    }
    return;
  }
  const float* inverse = grids_[l].inverse_diagonal.data();
  smooth(l, count, true, dilatation);
  multiply(l, count, dilatation);
  for (int r = 0; r < count; ++r) {
    Work& w = work_[l][r];
    for_all(w.b.size(), [&](std::size_t i) { w.rest[i] = inverse[i] > 0.0F ? w.b[i] - w.rest[i] : 0.0F; });
    transfers_[l].restrict_to_coarse(w.rest.data(), work_[l + 1][r].b.data());
  }
  cycle(l + 1, count, Dilatation::local);
  for (int r = 0; r < count; ++r) transfers_[l].prolong(work_[l + 1][r].x.data(), work_[l][r].x.data());
  smooth(l, count, false, dilatation);
}

void FrameMultigrid::prolong(std::size_t l, Field& coarse, Field& fine) const {
  transfers_[l].prolong(coarse.data(), fine.data());
}

}  // namespace efree::internal
