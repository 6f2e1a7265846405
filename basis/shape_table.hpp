// SPDX-License-Identifier: GPL-3.0-or-later
/// The one central type: which nodes act at a point, and how strongly.
#pragma once

#include "efree/core/types.hpp"

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <vector>

namespace efree {

/// Where a table's row begins in its flat arrays, which may hold more than 2^31 entries.
using Offset = std::int64_t;

/// One row: views into the table.
template <int Dim> struct ShapeRow {
  std::span<const Index> nodes;  ///< ascending
  std::span<const double> N;     ///< [-]
  std::span<const Vec<Dim>> dN;  ///< [1/length]; empty in a table without gradients
  std::span<const double> hoop;  ///< N over the radius [1/length]; empty unless axisymmetric
};

/// A row whose numbers are still to be written.
template <int Dim> struct ShapeRowRoom {
  std::span<Index> nodes;
  std::span<double> N;
  std::span<Vec<Dim>> dN;  ///< empty in a table without gradients
  std::span<double> hoop;  ///< empty unless axisymmetric
};

/// Where a node appears in a table.
struct NodePlace {
  Index point;     ///< the row
  Index position;  ///< within it
};
/// The transpose of a table: its places by node, each in ascending order of point.
class NodePlaces {
 public:
  std::span<const NodePlace> operator[](Index node) const {
    return {places_.data() + offsets_[node], places_.data() + offsets_[node + 1]};
  }

 private:
  template <int Dim> friend class ShapeTable;
  std::vector<Offset> offsets_;
  std::vector<NodePlace> places_;
};

/// Compressed rows: row = evaluation point (fine degree of freedom, quadrature point, moving point), columns = nodes.
/// MLS, finite elements and everything to come are tables of this kind; drivers never know which. A table needs no
/// mesh.
template <int Dim> class ShapeTable {
 public:
  ShapeTable() = default;
  /// Takes flat arrays. dN and hoop are empty or as long as N.
  ShapeTable(Index num_nodes, std::vector<Offset> offsets, std::vector<Index> nodes, std::vector<double> N,
             std::vector<Vec<Dim>> dN = {}, std::vector<double> hoop = {})
      : num_nodes_(num_nodes),
        offsets_(std::move(offsets)),
        nodes_(std::move(nodes)),
        N_(std::move(N)),
        dN_(std::move(dN)),
        hoop_(std::move(hoop)) {}

  /// Every point is a node of its own: finite elements.
  static ShapeTable identity(Index size);

  /// Makes room for other rows, with gradients (and values over the radius) or without, in the storage there is: where
  /// points move, and functions with them, nothing is allocated unless there is more than ever before. counts[p] =
  /// entries of row p. What the rows hold is not defined before they are filled (room). Throws InputError for a
  /// negative count.
  void reshape(Index num_nodes, std::span<const Index> counts, bool gradients, bool hoop = false);
  /// Row p to be filled; rows may be filled concurrently. Nodes must ascend. Only after reshape, and before anybody
  /// reads.
  ShapeRowRoom<Dim> room(Index p) {
    const auto [begin, count] = range(p);
    return {{nodes_.data() + begin, count},
            {N_.data() + begin, count},
            {dN_.data() + (dN_.empty() ? 0 : begin), dN_.empty() ? 0 : count},
            {hoop_.data() + (hoop_.empty() ? 0 : begin), hoop_.empty() ? 0 : count}};
  }

  Index num_points() const { return static_cast<Index>(offsets_.size()) - 1; }
  Index num_nodes() const { return num_nodes_; }
  Offset num_entries() const { return offsets_.back(); }
  bool has_gradients() const { return !dN_.empty(); }
  bool has_hoop() const { return !hoop_.empty(); }

  ShapeRow<Dim> row(Index p) const {
    const auto [begin, count] = range(p);
    return {{nodes_.data() + begin, count},
            {N_.data() + begin, count},
            {dN_.data() + (dN_.empty() ? 0 : begin), dN_.empty() ? 0 : count},
            {hoop_.data() + (hoop_.empty() ? 0 : begin), hoop_.empty() ? 0 : count}};
  }

  /// A copy of N, num_points x num_nodes. Throws InputError for more entries than SparseRows can number.
  SparseRows matrix() const;

  /// The transpose. Made in parallel when somebody first asks, from whatever thread, then kept, and shared by copies of
  /// the table.
  const NodePlaces& by_node() const;

 private:
  struct Transpose {
    std::mutex making;
    std::atomic<bool> is_made = false;
    NodePlaces places;
  };
  std::pair<std::size_t, std::size_t> range(Index p) const {
    const auto begin = static_cast<std::size_t>(offsets_[p]);
    return {begin, static_cast<std::size_t>(offsets_[p + 1]) - begin};
  }
  void transpose(NodePlaces& out) const;

  Index num_nodes_ = 0;
  std::vector<Offset> offsets_{0};
  std::vector<Index> nodes_;
  std::vector<double> N_;
  std::vector<Vec<Dim>> dN_;
  std::vector<double> hoop_;
  std::shared_ptr<Transpose> transpose_ = std::make_shared<Transpose>();
};

/// Values at the points of `shape` of the field with the given coefficients (rows x N): rows x num_points.
template <int Dim> Matrix interpolate(const ShapeTable<Dim>& shape, const Eigen::Ref<const Matrix>& coefficients);

}  // namespace efree
