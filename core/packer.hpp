// SPDX-License-Identifier: GPL-3.0-or-later
/// Values as bytes and back, for another process on the same machine, or a later one.
#pragma once

#include "efree/core/error.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <variant>
#include <vector>

namespace efree {

/// Numbers that any bytes stand for, and arrays of them.
template <class T> inline constexpr bool is_plain = std::is_arithmetic_v<T> && !std::is_same_v<T, bool>;
template <class T, std::size_t N> inline constexpr bool is_plain<std::array<T, N>> = is_plain<T>;

/// Appends values to a string of bytes. Takes numbers, strings, Eigen's matrices and boxes, the standard containers
/// below and aggregates that have `fields`.
class Packer {
 public:
  std::string bytes() && { return std::move(bytes_); }

  template <class T>
  requires is_plain<T>
  void operator()(T& value) { put(&value, 1); }
  void operator()(bool& value) { count(value); }
  void operator()(std::string& text) { list(text.data(), text.size()); }
  template <class T, std::size_t N> void operator()(std::array<T, N>& values) {
    for (T& value : values) (*this)(value);
  }
  template <class T, class A> void operator()(std::vector<T, A>& values) {
    if constexpr (is_plain<T>) return list(values.data(), values.size());
    count(values.size());
    for (T& value : values) (*this)(value);
  }
  template <class S> void operator()(Eigen::Matrix<S, Eigen::Dynamic, 1>& values) {
    list(values.data(), static_cast<std::size_t>(values.size()));
  }
  template <class S, int R, int C> void operator()(Eigen::Matrix<S, R, C>& matrix) {
    if constexpr (R == Eigen::Dynamic) count(static_cast<std::size_t>(matrix.rows()));
    count(static_cast<std::size_t>(matrix.cols()));
    put(matrix.data(), static_cast<std::size_t>(matrix.size()));
  }
  template <class S, int Dim> void operator()(Eigen::AlignedBox<S, Dim>& box) {
    (*this)(box.min()), (*this)(box.max());
  }
  template <class A, class B> void operator()(std::pair<A, B>& pair) { (*this)(pair.first), (*this)(pair.second); }
  template <class K, class V> void operator()(std::map<K, V>& map) {
    std::vector<std::pair<K, V>> entries(map.begin(), map.end());
    (*this)(entries);
  }
  template <class... T> void operator()(std::variant<T...>& value) {
    count(value.index());
    std::visit(*this, value);
  }
  template <class T> void operator()(std::optional<T>& value) {
    count(value.has_value());
    if (value) (*this)(*value);
  }
  /// What it points to.
  template <class T> void operator()(std::shared_ptr<const T>& value) {
    std::optional<T> copy;
    if (value) copy = *value;
    (*this)(copy);
  }
  template <class T>
  requires requires(T& value) { fields(value); }
  void operator()(T& value) {
    std::apply([&](auto&... field) { ((*this)(field), ...); }, fields(value));
  }

 private:
  void count(std::uint64_t n) { put(&n, 1); }
  template <class T> void put(const T* values, std::size_t n) {
    bytes_.append(reinterpret_cast<const char*>(values), n * sizeof(T));
  }
  template <class T> void list(const T* values, std::size_t n) {
    count(n);
    put(values, n);
  }

  std::string bytes_;
};

/// The other way round. Whoever wrote the bytes need not be trusted: InputError for those that no Packer wrote.
class Unpacker {
 public:
  explicit Unpacker(std::string_view bytes) : rest_(bytes) {}
  /// Whether there is nothing left.
  bool empty() const { return rest_.empty(); }
  /// What is left.
  std::string_view rest() const { return rest_; }

  template <class T>
  requires is_plain<T>
  void operator()(T& value) { take(&value, 1); }
  void operator()(bool& value) {
    std::uint64_t set = 0;
    take(&set, 1);
    value = set != 0;
  }
  void operator()(std::string& text) {
    text.resize(count(1));
    take(text.data(), text.size());
  }
  template <class T, std::size_t N> void operator()(std::array<T, N>& values) {
    for (T& value : values) (*this)(value);
  }
  template <class T, class A> void operator()(std::vector<T, A>& values) {
    values.resize(count(is_plain<T> ? sizeof(T) : 1));
    if constexpr (is_plain<T>) return take(values.data(), values.size());
    for (T& value : values) (*this)(value);
  }
  template <class S> void operator()(Eigen::Matrix<S, Eigen::Dynamic, 1>& values) {
    values.resize(static_cast<Eigen::Index>(count(sizeof(S))));
    take(values.data(), static_cast<std::size_t>(values.size()));
  }
  template <class S, int R, int C> void operator()(Eigen::Matrix<S, R, C>& matrix) {
    auto rows = static_cast<Eigen::Index>(R);
    if constexpr (R == Eigen::Dynamic) rows = static_cast<Eigen::Index>(count(1));
    const auto columns = static_cast<Eigen::Index>(count(std::max<std::size_t>(rows, 1) * sizeof(S)));
    check(C == Eigen::Dynamic || columns == C);
    matrix.resize(rows, columns);
    take(matrix.data(), static_cast<std::size_t>(matrix.size()));
  }
  template <class S, int Dim> void operator()(Eigen::AlignedBox<S, Dim>& box) {
    (*this)(box.min()), (*this)(box.max());
  }
  template <class A, class B> void operator()(std::pair<A, B>& pair) { (*this)(pair.first), (*this)(pair.second); }
  template <class K, class V> void operator()(std::map<K, V>& map) {
    std::vector<std::pair<K, V>> entries;
    (*this)(entries);
    map = {entries.begin(), entries.end()};
  }
  template <class... T> void operator()(std::variant<T...>& value) {
    std::uint64_t which = 0;
    take(&which, 1);
    check(which < sizeof...(T));
    std::uint64_t k = 0;
    ((k++ == which ? (*this)(value.template emplace<T>()) : void()), ...);
  }
  template <class T> void operator()(std::optional<T>& value) {
    std::uint64_t there = 0;
    take(&there, 1);
    check(there <= 1);
    if (there == 1) (*this)(value.emplace());
  }
  template <class T> void operator()(std::shared_ptr<const T>& value) {
    std::optional<T> copy;
    (*this)(copy);
    value = copy ? std::make_shared<const T>(std::move(*copy)) : nullptr;
  }
  template <class T>
  requires requires(T& value) { fields(value); }
  void operator()(T& value) {
    std::apply([&](auto&... field) { ((*this)(field), ...); }, fields(value));
  }

 private:
  static void check(bool good) { require(good, "what was packed is damaged"); }
  /// Of things that take at least so many bytes each.
  std::size_t count(std::size_t each) {
    std::uint64_t n = 0;
    take(&n, 1);
    check(n <= rest_.size() / each);
    return n;
  }
  template <class T> void take(T* values, std::size_t n) {
    check(n <= rest_.size() / sizeof(T));
    if (n > 0) std::memcpy(values, rest_.data(), n * sizeof(T));
    rest_.remove_prefix(n * sizeof(T));
  }

  std::string_view rest_;
};

/// Either of both, for a part that names its members once: what a checkpoint has of it.
class Archive {
 public:
  explicit Archive(Packer& packer) : packer_(&packer) {}
  explicit Archive(Unpacker& unpacker) : unpacker_(&unpacker) {}
  /// Whether values are read from bytes.
  bool reads() const { return unpacker_ != nullptr; }
  /// Writes these values or reads them, in their order. Throws InputError for bytes that no Packer wrote.
  template <class... T> void operator()(T&... values) {
    if (unpacker_)
      ((*unpacker_)(values), ...);
    else
      ((*packer_)(values), ...);
  }

 private:
  Packer* packer_ = nullptr;
  Unpacker* unpacker_ = nullptr;
};

}  // namespace efree
