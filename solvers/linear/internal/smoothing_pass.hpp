// SPDX-License-Identifier: GPL-3.0-or-later
/// The inner loop of the smoother, for one or several right-hand sides side by side, in single precision.
#pragma once

#include "efree/assembly/internal/lanes.hpp"

namespace efree {

/// One step of a polynomial in B K on a chunk of rows: z + keep * (z - next) + take * B (r - K z) takes the place of
/// next, which was z a step before; B a symmetric Gauss-Seidel sweep within the chunk. Vectors in lanes, of node 0.
struct SmoothingPass {
  BlockRows<float> rows;  ///< of K
  const float* inverse;   ///< of the diagonal blocks, by node
  const float* r;
  const float* z;  ///< none: zero, as it was before
  float* next;
  float keep, take;
  float *swept, *ahead;  ///< room for the rows
};

constexpr int most_lanes = 16;

/// Does it for blocks of dim x dim, dim 2 or 3, in 1, 4, 8 or 16 lanes.
void smooth_rows(int dim, int lanes, const SmoothingPass& pass);

}  // namespace efree
