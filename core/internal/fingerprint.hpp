// SPDX-License-Identifier: GPL-3.0-or-later
/// A number that tells whether two heaps of bytes are the same, as long as nobody means harm.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace efree::internal {

/// FNV-1a with 64 bits (Fowler, Noll & Vo 1991).
class Fingerprint {
 public:
  Fingerprint& add(std::string_view bytes) {
    for (const char c : bytes) value_ = (value_ ^ static_cast<unsigned char>(c)) * 0x100000001b3U;
    return *this;
  }
  template <class Derived> Fingerprint& add(const Eigen::PlainObjectBase<Derived>& values) {
    using Scalar = typename Derived::Scalar;
    return add(
        {reinterpret_cast<const char*>(values.data()), sizeof(Scalar) * static_cast<std::size_t>(values.size())});
  }
  std::uint64_t value() const { return value_; }

 private:
  std::uint64_t value_ = 0xcbf29ce484222325U;
};

}  // namespace efree::internal
