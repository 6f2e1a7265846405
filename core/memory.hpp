// SPDX-License-Identifier: GPL-3.0-or-later
/// Says that memory is short before it is asked for.
#pragma once

#include <cstddef>
#include <span>
#include <string_view>

namespace efree {

/// Bytes that this process can still allocate without swapping: what the system has (Linux: MemAvailable), its control
/// group and its own limits leave. Infinite where nothing is said.
double available_memory();
/// Bytes of private memory that this process may write to, used or not: what RLIMIT_DATA counts. 0 where the system
/// does not say.
double data_memory();

/// Throws InputError "`what` takes about ... of memory, ... are available; `advice`" if `bytes` are more than there
/// are.
void require_memory(double bytes, std::string_view what, std::string_view advice = {});

/// Throws InputError if this process may not have the buffers of OpenBLAS for all threads (parallel.hpp), 128 MiB of
/// addresses each: OpenBLAS would ask for them again and again for ever.
void require_blas_memory();

/// Largest resident memory of this process so far [MiB].
double peak_memory_mb();

/// From now on memory that is freed stays with the process, for the next who asks: to get pages from the system anew
/// takes a tenth of a run with many load cases and more. For programs, once.
void keep_freed_memory();

/// Moves these tables, with what lies beside them, to large pages as far as the system has some (Linux 6.1 and later):
/// who goes through many megabytes again and again would wait for addresses to be found otherwise, a tenth of the time.
/// What is in them, and where, stays. Pages of 2 MiB are taken whole, some ms each: for tables that fill them.
void move_to_large_pages(std::span<const std::span<const std::byte>> tables);

}  // namespace efree
