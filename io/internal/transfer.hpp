// SPDX-License-Identifier: GPL-3.0-or-later
/// Values as bytes and back, for another process on the same machine, or a later one.
#pragma once

#include "efree/analysis/mesh_source.hpp"
#include "efree/core/error.hpp"
#include "efree/geometry/input/grey_image.hpp"
#include "efree/io/inspect.hpp"

#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <tuple>

namespace efree::internal {

// What aggregates are made of. By structured bindings, so that a member that is added and not listed does not compile.
template <class T>
concept IsMeshGroup = requires(T group) {
  group.name;
  group.facets.front().front();
};
auto fields(IsMeshGroup auto& group) {
  auto& [name, facets] = group;
  return std::tie(name, facets);
}
template <int Dim> auto fields(MeshData<Dim>& mesh) {
  auto& [vertices, cells, groups, regions, region_names] = mesh;
  return std::tie(vertices, cells, groups, regions, region_names);
}
template <int Dim> auto fields(LabelImage<Dim>& image) {
  auto& [size, spacing, origin, labels, grey] = image;
  return std::tie(size, spacing, origin, labels, grey);
}
template <int Dim> auto fields(GreyImage<Dim>& image) {
  auto& [size, spacing, origin, values] = image;
  return std::tie(size, spacing, origin, values);
}
template <int Dim> auto fields(MadeMesh<Dim>& made) {
  auto& [mesh, reports, remarks, size, image, region_of_label] = made;
  return std::tie(mesh, reports, remarks, size, image, region_of_label);
}
template <int Dim> auto fields(BodySummary<Dim>& body) {
  auto& [name, num_cells, volume, box] = body;
  return std::tie(name, num_cells, volume, box);
}
template <int Dim> auto fields(GroupSummary<Dim>& group) {
  auto& [name, num_facets, measure, normal, box, mean_normal] = group;
  return std::tie(name, num_facets, measure, normal, box, mean_normal);
}
template <class T>
concept IsFeature = requires(T feature) {
  feature.what;
  feature.size;
  feature.at;
};
auto fields(IsFeature auto& feature) {
  auto& [what, size, at] = feature;
  return std::tie(what, size, at);
}
template <class T>
concept IsWalls = requires(T walls) {
  walls.thickness;
  walls.share;
};
auto fields(IsWalls auto& walls) {
  auto& [thickness, nodes, edges, spacing, at, share] = walls;
  return std::tie(thickness, nodes, edges, spacing, at, share);
}
template <class T>
concept IsSuggestion = requires(T suggestion) {
  suggestion.mesh_size;
  suggestion.cells;
};
auto fields(IsSuggestion auto& suggestion) {
  auto& [mesh_size, cells, spacing, limited] = suggestion;
  return std::tie(mesh_size, cells, spacing, limited);
}
template <class T>
concept IsPiece = requires(T piece) {
  piece.corners;
  piece.region;
};
auto fields(IsPiece auto& piece) {
  auto& [corners, region, group] = piece;
  return std::tie(corners, region, group);
}
template <int Dim> auto fields(Inspection<Dim>& inspection) {
  auto& [file, kind, box, volume, boundary, bodies, groups, smallest, walls, suggestion, facts, remarks, points,
         pieces] = inspection;
  return std::tie(file, kind, box, volume, boundary, bodies, groups, smallest, walls, suggestion, facts, remarks,
                  points, pieces);
}

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
  template <class T> void operator()(std::vector<T>& values) {
    if constexpr (is_plain<T>) return list(values.data(), values.size());
    count(values.size());
    for (T& value : values) (*this)(value);
  }
  template <class S> void operator()(Eigen::Matrix<S, Eigen::Dynamic, 1>& values) {
    list(values.data(), static_cast<std::size_t>(values.size()));
  }
  template <class S, int R, int C> void operator()(Eigen::Matrix<S, R, C>& matrix) {
    count(static_cast<std::size_t>(matrix.cols()));
    put(matrix.data(), static_cast<std::size_t>(matrix.size()));
  }
  template <int Dim> void operator()(BoundingBox<Dim>& box) { (*this)(box.min()), (*this)(box.max()); }
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
  template <class T> void operator()(std::vector<T>& values) {
    values.resize(count(is_plain<T> ? sizeof(T) : 1));
    if constexpr (is_plain<T>) return take(values.data(), values.size());
    for (T& value : values) (*this)(value);
  }
  template <class S> void operator()(Eigen::Matrix<S, Eigen::Dynamic, 1>& values) {
    values.resize(static_cast<Eigen::Index>(count(sizeof(S))));
    take(values.data(), static_cast<std::size_t>(values.size()));
  }
  template <class S, int R, int C> void operator()(Eigen::Matrix<S, R, C>& matrix) {
    static_assert(R != Eigen::Dynamic);
    const auto columns = static_cast<Eigen::Index>(count(R * sizeof(S)));
    check(C == Eigen::Dynamic || columns == C);
    matrix.resize(R, columns);
    take(matrix.data(), static_cast<std::size_t>(matrix.size()));
  }
  template <int Dim> void operator()(BoundingBox<Dim>& box) { (*this)(box.min()), (*this)(box.max()); }
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
  static void check(bool good) { require(good, "what the process that read the file handed over is damaged"); }
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

}  // namespace efree::internal
