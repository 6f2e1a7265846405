// SPDX-License-Identifier: GPL-3.0-or-later
/// OpenBLAS with the kernels of this processor.
#pragma once

namespace efree {

/// OpenBLAS takes its slowest kernels for processors that are newer than itself, and keeps 128 MiB for each of its
/// threads, of which we use none. On processors with AVX2 it is made to choose again. If it cannot, or if memory is
/// limited, starts the program again (same process, same arguments) with OPENBLAS_CORETYPE or
/// OPENBLAS_NUM_THREADS set; returns if that need not be or cannot be, or if the user has set them.
void choose_fast_blas(char** argv);

}  // namespace efree
