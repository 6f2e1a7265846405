// SPDX-License-Identifier: GPL-3.0-or-later
/// OpenBLAS with the kernels of this processor.
#pragma once

namespace efree {

/// OpenBLAS takes its slowest kernels for processors that are newer than itself. Where it did and wider vectors are
/// there, starts the program again (same process, same arguments) with OPENBLAS_CORETYPE set; returns if that need not
/// be or cannot be, or if the user has set it.
void restart_with_fast_blas(char** argv);

}  // namespace efree
