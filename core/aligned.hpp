// SPDX-License-Identifier: GPL-3.0-or-later
/// Arrays that begin at a line of the cache.
#pragma once

#include <cstddef>
#include <new>
#include <vector>

namespace efree {

/// Allocates at multiples of 64 bytes.
template <class T> struct AlignedAllocator {
  using value_type = T;
  AlignedAllocator() = default;
  template <class U> AlignedAllocator(const AlignedAllocator<U>&) {}
  T* allocate(std::size_t count) { return static_cast<T*>(::operator new (count * sizeof(T), std::align_val_t{64})); }
  void deallocate(T* memory, std::size_t) { ::operator delete (memory, std::align_val_t{64}); }
  bool operator==(const AlignedAllocator&) const { return true; }
};

/// For kernels that read or write four numbers at a time: no four of them lie in two lines of the cache.
template <class T> using AlignedVector = std::vector<T, AlignedAllocator<T>>;

}  // namespace efree
