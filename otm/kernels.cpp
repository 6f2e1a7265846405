// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/internal/vectors.hpp"
#include "efree/otm/internal/chunk.hpp"

namespace efree::internal {

EFREE_FOR_EACH_MACHINE void otm_deform(Index points, const Index* offsets, const std::uint16_t* local,
                                       const OtmEntry* entries, const double* x, double* columns) {
  for (Index p = 0; p < points; ++p) {
    Four sums[8] = {};
    const Index end = offsets[p + 1];
    Index e = offsets[p];
    // Two nodes at a time: sums that wait for each other are slow.
    for (; e + 1 < end; e += 2) {
      Four xa, xb;
      load(xa, x + 4 * local[e]);
      load(xb, x + 4 * local[e + 1]);
      const OtmEntry &a = entries[e], &b = entries[e + 1];
      for (int J = 0; J < 3; ++J) {
        sums[J] += xa * a.dN[J];
        sums[4 + J] += xb * b.dN[J];
      }
      sums[3] += xa * a.N;
      sums[7] += xb * b.N;
    }
    if (e < end) {
      Four xa;
      load(xa, x + 4 * local[e]);
      for (int J = 0; J < 3; ++J) sums[J] += xa * entries[e].dN[J];
      sums[3] += xa * entries[e].N;
    }
    for (int J = 0; J < 4; ++J) store(columns + 16 * p + 4 * J, sums[J] + sums[4 + J]);
  }
}

EFREE_FOR_EACH_MACHINE void otm_push(Index points, const Index* offsets, const std::uint16_t* local,
                                     const OtmEntry* entries, const double* x, const double* columns,
                                     const double* penalty, double* force) {
  for (Index p = 0; p < points; ++p) {
    Four column[4];
    for (int J = 0; J < 4; ++J) load(column[J], columns + 16 * p + 4 * J);
    for (Index e = offsets[p]; e < offsets[p + 1]; ++e) {
      const OtmEntry& a = entries[e];
      Four f, xa;
      load(f, force + 4 * local[e]);
      load(xa, x + 4 * local[e]);
      f += a.dN[0] * column[0] + a.dN[1] * column[1] + a.dN[2] * column[2] + a.N * (column[3] - penalty[p] * xa);
      store(force + 4 * local[e], f);
    }
  }
}

}  // namespace efree::internal
