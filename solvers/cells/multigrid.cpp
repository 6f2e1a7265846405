// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/multigrid.hpp"

#include <algorithm>
#include <cstdint>
#include <utility>

namespace efree::internal {

Transfer::Transfer(const GridLevel& coarse, const GridLevel& fine) : coarse_(&coarse), fine_(&fine) {
  for (int d = 0; d < 3; ++d) {
    Axis& axis = axes_[d];
    const Index m = coarse.layout().cells[d], n = fine.layout().cells[d];
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

template <class T> void Transfer::prolong(const T* from, T* to) const {
  const CellLayout &coarse = coarse_->layout(), &fine = fine_->layout();
  const auto& [x, y, z] = axes_;
  parallel_chunks(fine.cells[2] + 1, 4, [&](Index begin, Index end) {
    std::vector<T> line(coarse.cells[0] + 1);
    for (int c = 0; c < fine_->components(); ++c)
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
            to[node + i] += fine_->is_free(node + i) ? value : T(0);
          }
        }
  });
}
template void Transfer::prolong(const float*, float*) const;
template void Transfer::prolong(const double*, double*) const;

void Transfer::transpose(const float* from, float* to, bool squared) const {
  const auto used = [&](float share) { return squared ? share * share : share; };
  const CellLayout &coarse = coarse_->layout(), &fine = fine_->layout();
  const auto& [x, y, z] = axes_;
  parallel_chunks(coarse.cells[2] + 1, 2, [&](Index begin, Index end) {
    std::vector<float> line(fine.cells[0] + 1);
    for (int c = 0; c < fine_->components(); ++c)
      for (Index k = begin; k < end; ++k)
        for (Index j = 0; j <= coarse.cells[1]; ++j) {
          std::ranges::fill(line, 0.0F);
          for (std::size_t s = z.begin[k]; s < z.begin[k + 1]; ++s)
            for (std::size_t t = y.begin[j]; t < y.begin[j + 1]; ++t) {
              const float weight = used(z.share_of_fine[s] * y.share_of_fine[t]);
              const float* row = from + c * fine.nodes() + fine.node(0, y.fine[t], z.fine[s]);
              for (Index i = 0; i <= fine.cells[0]; ++i) line[i] += weight * row[i];
            }
          float* row = to + c * coarse.nodes() + coarse.node(0, j, k);
          for (Index i = 0; i <= coarse.cells[0]; ++i) {
            float sum = 0.0F;
            for (std::size_t s = x.begin[i]; s < x.begin[i + 1]; ++s) sum += used(x.share_of_fine[s]) * line[x.fine[s]];
            row[i] = sum;
          }
        }
  });
  coarse_->collect(to);
  for_all(coarse_->size(), [&](std::size_t i) {
    if (!coarse_->is_free(i)) to[i] = 0.0F;
  });
}

void raise_soft_diagonal(GridLevel& coarse, const GridLevel& fine) {
  constexpr float least = 0.65F;  // of what the coarse grid mostly has of the finer one's
  SingleField of_fine(fine.size()), wanted(coarse.size());
  for_all(fine.size(), [&](std::size_t i) { of_fine[i] = fine.is_free(i) ? 1.0F / fine.inverse_diagonal[i] : 0.0F; });
  Transfer(coarse, fine).restrict_diagonal(of_fine.data(), wanted.data());
  const std::size_t nodes = coarse.layout().nodes();
  // How much softer a coarse node is that the finer grid sees whole depends on the axes that are halved and on nu.
  std::vector<float> mostly;
  for (int c = 0; c < coarse.components(); ++c) {
    std::vector<float> softer;
    for (std::size_t i = c * nodes; i < (c + 1) * nodes; ++i)
      if (coarse.is_free(i) && wanted[i] > 0.0F) softer.push_back(wanted[i] * coarse.inverse_diagonal[i]);
    const auto median = softer.begin() + static_cast<std::ptrdiff_t>(softer.size() / 2);
    std::nth_element(softer.begin(), median, softer.end());
    mostly.push_back(softer.empty() ? 1.0F : *median);
  }
  for (std::size_t node = 0; node < nodes; ++node) {
    float softer = 1.0F;  // the same for all components: these may depend on each other
    for (int c = 0; c < coarse.components(); ++c)
      softer =
          std::max(softer, least * wanted[c * nodes + node] * coarse.inverse_diagonal[c * nodes + node] / mostly[c]);
    if (softer == 1.0F) continue;
    for (std::size_t i = node; i < coarse.size(); i += nodes) {
      if (!coarse.is_free(i)) continue;
      coarse.added.emplace_back(i, (softer - 1.0F) / coarse.inverse_diagonal[i]);
      coarse.inverse_diagonal.set(i, coarse.inverse_diagonal[i] / softer);
    }
  }
}

Multigrid::Multigrid(std::vector<const GridLevel*> grids, SmallInverse coarsest)
    : grids_(std::move(grids)), coarsest_(std::move(coarsest)), work_(grids_.size()) {
  for (std::size_t l = 0; l + 1 < grids_.size(); ++l) transfers_.emplace_back(*grids_[l + 1], *grids_[l]);
}

void Multigrid::take(std::size_t l) {
  for (auto* field : {&work_[l].b, &work_[l].x, &work_[l].step, &work_[l].rest})
    if (field->empty()) *field = zeros<float>(grids_[l]->size());
}
void Multigrid::release(std::size_t l) {
  for (auto* field : {&work_[l].x, &work_[l].step, &work_[l].rest}) *field = SingleField();
}
Field Multigrid::prolonged(std::size_t l, const Field& coarse) const {
  Field fine = zeros<double>(grids_[l]->size());
  transfers_[l].prolong(coarse.data(), fine.data());
  return fine;
}

/// rest = K x.
void Multigrid::multiply(std::size_t l, Dilatation dilatation) {
  Work& w = work_[l];
  grids_[l]->complete(w.x.data());
  grids_[l]->apply_isotropic(w.x.data(), w.rest.data(), dilatation);
  grids_[l]->collect(w.rest.data());
}

/// x += a polynomial of b - K x (chebyshev_steps).
void Multigrid::smooth(std::size_t l, bool from_zero, Dilatation dilatation) {
  const ShortNumbers& inverse = grids_[l]->inverse_diagonal;
  Work& w = work_[l];
  const auto steps = chebyshev_steps();
  for (std::size_t s = 0; s < steps.size(); ++s) {
    const float keep = steps[s].keep, take = steps[s].take;
    if (from_zero && s == 0) {
      for_all(w.b.size(), [&](std::size_t i) { w.x[i] = w.step[i] = take * inverse[i] * w.b[i]; });
      continue;
    }
    multiply(l, dilatation);
    if (s == 0)
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

const SingleField& Multigrid::cycle(std::size_t l) {
  return cycle(l, grids_[l]->dilatation());
}
const SingleField& Multigrid::cycle(std::size_t l, Dilatation dilatation) {
  take(l);
  Work& w = work_[l];
  const GridLevel& grid = *grids_[l];
  if (l + 1 == grids_.size()) {
    coarsest_(w.b, w.x);
  } else {
    smooth(l, true, dilatation);
    multiply(l, dilatation);
    for_all(w.b.size(), [&](std::size_t i) { w.rest[i] = grid.is_free(i) ? w.b[i] - w.rest[i] : 0.0F; });
    take(l + 1);
    transfers_[l].restrict_to_coarse(w.rest.data(), work_[l + 1].b.data());
    transfers_[l].prolong(cycle(l + 1, Dilatation::local).data(), w.x.data());
    smooth(l, false, dilatation);
  }
  grid.complete(w.x.data());
  return w.x;
}

}  // namespace efree::internal
