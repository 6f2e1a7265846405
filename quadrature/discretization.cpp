// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/quadrature/discretization.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/accumulator.hpp"
#include "efree/core/internal/groups.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/core/parallel.hpp"
#include "efree/heatgeo/geodesics.hpp"
#include "efree/quadrature/internal/regular_simplex.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

namespace efree {

using internal::from_rows, internal::indicators, internal::members_of, internal::regular_simplex;

namespace {

/// What one fine function or node contributes to a quadrature point: value, gradient, and (axisymmetric) value over r:
/// four numbers in 2D and in 3D.
using Moment = Vec<4>;
/// The same for several points, whose functions live on the same cells.
template <int Count> using Moments = Eigen::Matrix<double, 4, Count>;

/// Volume of the body that point q of a rule stands for in cell c.
template <int Dim> double weight(const FineSpace<Dim>& space, const SimplexRule<Dim>& rule, Index c, Index q) {
  const double flat = space.mesh().volume(c) * rule.weights[q];
  return space.axisymmetric() ? flat * space.measure(space.position(c, rule.points.col(q))) : flat;
}

/// Rows of a table with gradients, built in chunks that run concurrently and are joined in order.
template <int Dim> class TableBuilder {
 public:
  TableBuilder(Index rows, Index num_nodes, bool axisymmetric)
      : rows_(rows), num_nodes_(num_nodes), axisymmetric_(axisymmetric) {}

  /// fill(begin, end, emit): calls emit.close() after the entries of every row in [begin, end).
  template <class Fill> ShapeTable<Dim> build(const Fill& fill) const {
    // Chunks large enough that scratch memory does not dominate, in waves, so that no more than one of these is there
    // twice; neither depends on the threads.
    const Index chunk = std::max<Index>(64, (rows_ + 63) / 64), wave = 8 * chunk;
    Part all(axisymmetric_);
    all.offsets.reserve(rows_ + 1);
    for (Index first = 0; first < rows_; first += wave) {
      const Index last = std::min(rows_, first + wave);
      std::vector<Part> parts((last - first + chunk - 1) / chunk, Part(axisymmetric_));
      parallel_chunks(last - first, chunk,
                      [&](Index begin, Index end) { fill(first + begin, first + end, parts[begin / chunk]); });
      for (const Part& part : parts) {
        const auto shift = static_cast<Offset>(all.nodes.size());
        for (std::size_t r = 1; r < part.offsets.size(); ++r) all.offsets.push_back(shift + part.offsets[r]);
        all.nodes.insert(all.nodes.end(), part.nodes.begin(), part.nodes.end());
        all.N.insert(all.N.end(), part.N.begin(), part.N.end());
        all.dN.insert(all.dN.end(), part.dN.begin(), part.dN.end());
        all.hoop.insert(all.hoop.end(), part.hoop.begin(), part.hoop.end());
      }
      if (first > 0) continue;
      // Rows are much alike: room is reserved as for the first ones, and taken only as it is filled.
      const auto entries = static_cast<std::size_t>(1.1 * rows_ / last * static_cast<double>(all.nodes.size()));
      all.nodes.reserve(entries);
      all.N.reserve(entries);
      all.dN.reserve(entries);
      if (!all.hoop.empty()) all.hoop.reserve(entries);
    }
    return {num_nodes_,       std::move(all.offsets), std::move(all.nodes),
            std::move(all.N), std::move(all.dN),      std::move(all.hoop)};
  }

  struct Part {
    bool axisymmetric;
    std::vector<Offset> offsets{0};
    std::vector<Index> nodes{};
    std::vector<double> N{};
    std::vector<Vec<Dim>> dN{};
    std::vector<double> hoop{};
    explicit Part(bool is_axisymmetric) : axisymmetric(is_axisymmetric) {}
    void add(Index node, const Moment& moment) {
      nodes.push_back(node);
      N.push_back(moment[0]);
      dN.push_back(moment.template segment<Dim>(1));
      if (axisymmetric) hoop.push_back(moment[3]);
    }
    void close() { offsets.push_back(static_cast<Offset>(nodes.size())); }
  };

 private:
  Index rows_, num_nodes_;
  bool axisymmetric_;
};

/// Adds the value and gradient of the fine functions at a point of cell c, times a factor for each quadrature point.
template <int Dim, int Count>
void add_cell_point(const FineSpace<Dim>& space, Index c, const typename FineSpace<Dim>::Barycentric& at,
                    const Eigen::Matrix<double, 1, Count>& factors, Accumulator<Moments<Count>>& fine) {
  const auto N = space.values(at);
  const auto dN = space.gradients(c, at);
  const auto dofs = space.cell(c);
  const double over_r = space.axisymmetric() ? 1.0 / space.position(c, at)[0] : 0.0;
  for (std::size_t i = 0; i < dofs.size(); ++i) {
    Moment moment = Moment::Zero();
    moment[0] = N[i];
    moment.template segment<Dim>(1) = dN.col(i);
    if constexpr (Dim == 2) moment[3] = over_r * N[i];
    fine[dofs[i]].noalias() += moment * factors;
  }
}

/// Turns moments of the fine functions into moments of the nodes, phi_I = sum_v eta_v phi_I(v), and these into the
/// first `rows` rows of a table.
template <int Dim, int Count> void emit_nodes(const ShapeTable<Dim>& shape, Accumulator<Moments<Count>>& fine,
                                              Accumulator<Moments<Count>>& nodal, int rows,
                                              typename TableBuilder<Dim>::Part& out) {
  nodal.clear();
  for (Index v : fine.touched()) {
    const Moments<Count> moments = fine[v];
    const auto row = shape.row(v);
    for (std::size_t k = 0; k < row.nodes.size(); ++k) nodal[row.nodes[k]] += row.N[k] * moments;
  }
  const auto& nodes = nodal.sorted();
  for (int row = 0; row < rows; ++row) {
    for (Index I : nodes) out.add(I, nodal[I].col(row));
    out.close();
  }
}

/// In place of a cluster's number: the cell is in none and integrated point by point.
constexpr Index alone = -1;

/// Around each of the points at these vertices: how many of them a node has to itself, in the mean over the nodes that
/// act there. With the values phi of the nodes' functions at the points (a partition of unity): phi phi^T 1.
template <int Dim> Vector points_per_node_around(const ShapeTable<Dim>& shape, const std::vector<Index>& vertices) {
  Vector of_node = Vector::Zero(shape.num_nodes()), at_point = Vector::Zero(static_cast<Index>(vertices.size()));
  for (const Index v : vertices) {
    const auto row = shape.row(v);
    for (std::size_t k = 0; k < row.nodes.size(); ++k) of_node[row.nodes[k]] += row.N[k];
  }
  for (Index K = 0; K < at_point.size(); ++K) {
    const auto row = shape.row(vertices[K]);
    for (std::size_t k = 0; k < row.nodes.size(); ++k) at_point[K] += row.N[k] * of_node[row.nodes[k]];
  }
  return at_point;
}

/// Whether each cell has a function of one fine degree of freedom alone: as a finite element, which a cluster as wide
/// as it is would not see.
template <int Dim> std::vector<char> has_elements(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape) {
  std::vector<Index> places(shape.num_nodes(), 0);
  for (Index dof = 0; dof < shape.num_points(); ++dof)
    for (const Index I : shape.row(dof).nodes) ++places[I];
  const auto is_element = [&](Index dof) {
    const auto row = shape.row(dof);
    return row.nodes.size() == 1 && places[row.nodes[0]] == 1;
  };
  std::vector<char> result(space.mesh().num_cells());
  parallel_for(space.mesh().num_cells(), [&](Index c) { result[c] = std::ranges::any_of(space.cell(c), is_element); });
  return result;
}

/// Takes clusters apart around which nodes have fewer than `fewest` to themselves because fine vertices run out there
/// (they hold no more cells than there are around a vertex), and those of no more than `small` cells: into their cells,
/// and those of one cell into the points of the cell rule. Cells with functions of finite elements stand alone in any
/// case.
template <int Dim> Clusters take_apart(const Clusters& clusters, const FineSpace<Dim>& space,
                                       const ShapeTable<Dim>& shape, double fewest, Index small = 0) {
  constexpr Index around_a_vertex = Dim == 2 ? 6 : 24;
  const Vector points = points_per_node_around(shape, clusters.vertices);
  const Index size = static_cast<Index>(points.size()),
              parts_of_a_cell = static_cast<Index>(space.cell_rule().weights.size());
  const std::vector<char> elements = has_elements(space, shape);
  std::vector<Index> cells(size, 0), renumbered(size, -1);
  for (Index c = 0; c < space.mesh().num_cells(); ++c) cells[clusters.of_cell[c]] += !elements[c];
  Clusters parts{{}, {}};
  for (Index K = 0; K < size; ++K) {
    const bool indivisible = cells[K] == 1 && parts_of_a_cell == 1;
    const bool soft = points[K] < fewest && cells[K] <= around_a_vertex;
    if (cells[K] == 0 || ((soft || cells[K] <= small) && !indivisible)) continue;
    renumbered[K] = static_cast<Index>(parts.vertices.size());
    parts.vertices.push_back(clusters.vertices[K]);
  }
  for (Index c = 0; c < space.mesh().num_cells(); ++c) {
    const Index K = clusters.of_cell[c];
    if (elements[c]) {
      parts.of_cell.push_back(alone);
    } else if (renumbered[K] >= 0) {
      parts.of_cell.push_back(renumbered[K]);
    } else if (cells[K] == 1) {
      parts.of_cell.push_back(alone);
    } else {
      parts.of_cell.push_back(static_cast<Index>(parts.vertices.size()));
      parts.vertices.push_back(clusters.vertices[K]);
    }
  }
  return parts;
}

/// Region of each cluster. Throws InputError for a cluster that spans two.
template <int Dim> std::vector<Index> regions_of(const FineMesh<Dim>& mesh, const Clusters& clusters) {
  std::vector<Index> regions(clusters.vertices.size(), -1);
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    const Index K = clusters.of_cell[c];
    if (K == alone) continue;
    Index& region = regions[K];
    if (region >= 0 && region != mesh.region(c))
      throw InputError(
          fmt::format("quadrature: the cluster around ({:.6g}) spans regions \"{}\" and \"{}\"; part the "
                      "mesh with cut_regions first",
                      fmt::join(mesh.vertex(clusters.vertices[K]), ", "), mesh.region_names()[region],
                      mesh.region_names()[mesh.region(c)]));
    region = mesh.region(c);
  }
  return regions;
}

/// The functions of clusters, and after them those of the rule points of all cells that stand alone.
template <int Dim> SecondaryBasis<Dim> indicators_of(const FineSpace<Dim>& space, const Clusters& clusters) {
  const FineMesh<Dim>& mesh = space.mesh();
  const auto& rule = space.cell_rule();
  const Index per_cell = static_cast<Index>(rule.weights.size());
  const Index whole = static_cast<Index>(clusters.vertices.size());
  SecondaryBasis<Dim> secondary;
  secondary.rule = rule;
  secondary.vertices = clusters.vertices;
  secondary.region = regions_of(mesh, clusters);
  std::vector<double> volume(whole, 0.0);
  Points<Dim> moment = Points<Dim>::Zero(Dim, whole);
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    const Index K = clusters.of_cell[c];
    if (K == alone) continue;
    volume[K] += space.volume(c);
    moment.col(K) += space.volume(c) * space.centre_of_mass(c);
  }

  const Index size = whole + per_cell * static_cast<Index>(std::ranges::count(clusters.of_cell, alone));
  secondary.points.resize(Dim, size);
  for (Index K = 0; K < whole; ++K) secondary.points.col(K) = moment.col(K) / volume[K];
  std::vector<Index> column;                    // function of each rule point
  std::vector<Index> first = clusters.of_cell;  // function of the first rule point of each cell
  for (Index c = 0, next = whole; c < mesh.num_cells(); ++c) {
    if (first[c] != alone) {
      column.insert(column.end(), per_cell, first[c]);
      continue;
    }
    first[c] = next;
    for (Index q = 0; q < per_cell; ++q, ++next) {
      secondary.points.col(next) = space.position(c, rule.points.col(q));
      secondary.vertices.push_back(mesh.cells()(q % (Dim + 1), c));
      secondary.region.push_back(mesh.region(c));
      column.push_back(next);
    }
  }
  secondary.in_cells = indicators(column, size);

  // On the boundary the functions of a cell that stands alone are linear, one at their own rule point and zero at the
  // others, so that gradients (linear in a cell of degree 2) are carried there exactly.
  require(per_cell == 1 || per_cell == Dim + 1, "a cell rule of 1 or Dim + 1 points expected");
  Matrix nodal;
  if (per_cell > 1) nodal = Mat<Dim + 1>(rule.points).inverse();
  std::vector<Index> offsets{0}, columns;
  std::vector<double> values;
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    const Index c = mesh.facet_cell(f);
    for (Index g = 0; g < space.facet_rule().weights.size(); ++g) {
      if (clusters.of_cell[c] == alone && per_cell > 1) {
        const Vector phi = nodal * space.facet_point(f, space.facet_rule().points.col(g));
        for (Index q = 0; q < per_cell; ++q) columns.push_back(first[c] + q), values.push_back(phi[q]);
      } else {
        columns.push_back(first[c]), values.push_back(1.0);
      }
      offsets.push_back(static_cast<Index>(columns.size()));
    }
  }
  secondary.on_facets = from_rows(size, offsets, columns, values);
  return secondary;
}

/// Linear functions on a set of cells, one at the point of their own and zero at the others.
template <int Dim> struct LinearFunctions {
  using Values = Eigen::Matrix<double, Dim + 1, 1>;
  Vec<Dim> centroid;
  Mat<Dim> root;  ///< L, the covariance being L L^T; lower triangle

  LinearFunctions(const FineSpace<Dim>& space, std::span<const Index> cells, const SimplexRule<Dim>& exact) {
    const Index per_cell = static_cast<Index>(exact.weights.size()), size = per_cell * static_cast<Index>(cells.size());
    Eigen::Matrix<double, Eigen::Dynamic, Dim> x(size, Dim);
    Vector weights(size);
    for (Index p = 0; p < size; ++p) {
      const Index c = cells[p / per_cell], q = p % per_cell;
      weights[p] = weight(space, exact, c, q);
      x.row(p) = space.position(c, exact.points.col(q)).transpose();
    }
    weights /= weights.sum();
    centroid = x.transpose() * weights;
    x.rowwise() -= centroid.transpose();
    x.array().colwise() *= weights.array().sqrt();
    // L by the QR decomposition of its factors, not from the covariance itself: flat cells keep twice the digits.
    root = internal::triangular_factor(x).transpose();
  }
  Eigen::Matrix<double, Dim, Dim + 1> points() const { return (root * regular_simplex<Dim>()).colwise() + centroid; }
  Values at(const Vec<Dim>& x) const {
    const Vec<Dim> y = root.template triangularView<Eigen::Lower>().solve(x - centroid);
    return (Values::Ones() + regular_simplex<Dim>().transpose() * y) / (Dim + 1);
  }
};

/// The linear functions of clusters, those of one cluster one after the other; cells that stand alone are clusters. One
/// cell has a single function, its indicator, if gradients are constant there.
template <int Dim> SecondaryBasis<Dim> linear_functions_of(const FineSpace<Dim>& space, Clusters clusters) {
  const FineMesh<Dim>& mesh = space.mesh();
  for (Index c = 0; c < mesh.num_cells(); ++c)
    if (clusters.of_cell[c] == alone) {
      clusters.of_cell[c] = static_cast<Index>(clusters.vertices.size());
      clusters.vertices.push_back(mesh.cells()(0, c));
    }
  const Index count = static_cast<Index>(clusters.vertices.size());
  const Ragged<Index> cells = members_of(clusters.of_cell, count);
  const std::vector<Index> regions = regions_of(mesh, clusters);
  std::vector<Index> first(count + 1, 0);  // function of each cluster
  for (Index K = 0; K < count; ++K)
    first[K + 1] = first[K] + (space.degree() == 1 && cells[K].size() == 1 ? 1 : Dim + 1);

  SecondaryBasis<Dim> secondary;
  secondary.points.resize(Dim, first[count]);
  secondary.rule = simplex_rule<Dim>(space.degree() + (space.axisymmetric() ? 1 : 0));
  const auto exact = simplex_rule<Dim>(space.axisymmetric() ? 3 : 2);  // for second moments
  std::vector<std::optional<LinearFunctions<Dim>>> functions(count);
  parallel_for(count, [&](Index K) {
    if (first[K + 1] - first[K] == 1) {
      secondary.points.col(first[K]) = space.centre_of_mass(cells[K].front());
    } else {
      functions[K].emplace(space, cells[K], exact);
      secondary.points.template middleCols<Dim + 1>(first[K]) = functions[K]->points();
    }
  });
  for (Index K = 0; K < count; ++K) {
    secondary.vertices.insert(secondary.vertices.end(), first[K + 1] - first[K], clusters.vertices[K]);
    secondary.region.insert(secondary.region.end(), first[K + 1] - first[K], regions[K]);
    secondary.cluster.insert(secondary.cluster.end(), first[K + 1] - first[K], K);
  }

  /// Rows of the functions at `per_item` points of every cell or facet.
  const auto rows_at = [&](Index items, Index per_item, const auto& cell_of, const auto& position) {
    std::vector<Index> offsets{0};
    offsets.reserve(static_cast<std::size_t>(items) * per_item + 1);
    for (Index item = 0; item < items; ++item)
      for (Index q = 0; q < per_item; ++q) {
        const Index K = clusters.of_cell[cell_of(item)];
        offsets.push_back(offsets.back() + first[K + 1] - first[K]);
      }
    std::vector<Index> columns(offsets.back());
    std::vector<double> values(offsets.back(), 1.0);
    parallel_for(items * per_item, [&](Index row) {
      const Index K = clusters.of_cell[cell_of(row / per_item)];
      std::iota(columns.begin() + offsets[row], columns.begin() + offsets[row + 1], first[K]);
      if (functions[K])
        Eigen::Map<typename LinearFunctions<Dim>::Values>(values.data() + offsets[row]) =
            functions[K]->at(position(row / per_item, row % per_item));
    });
    return from_rows(first[count], offsets, columns, values);
  };
  secondary.in_cells = rows_at(
      mesh.num_cells(), static_cast<Index>(secondary.rule.weights.size()), [](Index c) { return c; },
      [&](Index c, Index q) { return space.position(c, secondary.rule.points.col(q)); });
  secondary.on_facets = rows_at(
      mesh.num_facets(), static_cast<Index>(space.facet_rule().weights.size()),
      [&](Index f) { return mesh.facet_cell(f); },
      [&](Index f, Index g) {
        return space.position(mesh.facet_cell(f), space.facet_point(f, space.facet_rule().points.col(g)));
      });
  return secondary;
}

}  // namespace

template <int Dim> Clusters nearest_clusters(const FineMesh<Dim>& mesh, const NodeCloud<Dim>& cloud) {
  const NearestSource nearest = nearest_source(mesh, cloud.vertices);
  Clusters clusters{std::vector<Index>(mesh.num_cells(), -1), {}};
  parallel_for(mesh.num_cells(), [&](Index c) {
    double best = std::numeric_limits<double>::infinity();
    for (int i = 0; i <= Dim; ++i) {
      const Index v = mesh.cells()(i, c), K = nearest.source[v];
      if (K < 0) continue;
      const double detour = std::max(0.0, nearest.distance[v] - (mesh.vertex(v) - cloud.positions.col(K)).norm());
      const double distance = (mesh.centroid(c) - cloud.positions.col(K)).norm() + detour;
      if (distance < best || (distance == best && K < clusters.of_cell[c])) {
        best = distance;
        clusters.of_cell[c] = K;
      }
    }
  });
  std::vector<char> holds_cells(cloud.size(), 0);
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    if (clusters.of_cell[c] < 0)
      throw NumericalError(
          fmt::format("quadrature: the body around ({:.6g}) holds no quadrature node; use a smaller spacing",
                      fmt::join(mesh.centroid(c), ", ")));
    holds_cells[clusters.of_cell[c]] = 1;
  }
  std::vector<Index> renumbered(cloud.size(), -1);
  for (Index K = 0; K < cloud.size(); ++K)
    if (holds_cells[K]) {
      renumbered[K] = static_cast<Index>(clusters.vertices.size());
      clusters.vertices.push_back(cloud.vertices[K]);
    }
  for (Index& K : clusters.of_cell) K = renumbered[K];
  return clusters;
}

template <int Dim> Clusters levelled(const FineMesh<Dim>& mesh, Clusters clusters) {
  const Index cells = mesh.num_cells(), count = static_cast<Index>(clusters.vertices.size());
  Vector volumes = Vector::Zero(count);
  Points<Dim> moments = Points<Dim>::Zero(Dim, count), centres(Dim, count);
  const auto add = [&](Index c, Index K, double sign) {
    volumes[K] += sign * mesh.volume(c);
    moments.col(K) += sign * mesh.volume(c) * mesh.centroid(c);
  };
  for (Index c = 0; c < cells; ++c) add(c, clusters.of_cell[c], 1.0);
  const int layers = static_cast<int>(std::ceil(2.0 * std::pow(static_cast<double>(cells) / count, 1.0 / Dim)));
  std::vector<Index> next(cells);
  for (int layer = 0; layer < layers; ++layer) {
    for (Index K = 0; K < count; ++K) centres.col(K) = moments.col(K) / volumes[K];
    parallel_for(cells, [&](Index c) {
      const Index own = next[c] = clusters.of_cell[c];
      double least = -1.0;  // distance, once it is needed
      for (int i = 0; i <= Dim; ++i) {
        const Index other = mesh.neighbour(i, c);
        if (other < 0 || clusters.of_cell[other] == own) continue;
        const Vec<Dim> x = mesh.centroid(c);
        if (least < 0.0) least = (x - centres.col(own)).squaredNorm();
        const Index K = clusters.of_cell[other];
        if (const double distance = (x - centres.col(K)).squaredNorm(); distance < least) least = distance, next[c] = K;
      }
    });
    for (Index c = 0; c < cells; ++c)
      if (next[c] != clusters.of_cell[c]) add(c, clusters.of_cell[c], -1.0), add(c, next[c], 1.0);
    std::swap(clusters.of_cell, next);
  }

  // Those that lost all of their cells are left out; the others have a vertex in their middle.
  std::vector<double> least(count, std::numeric_limits<double>::infinity());
  for (Index c = 0; c < cells; ++c)
    for (const Index v : mesh.cells().col(c)) {
      const Index K = clusters.of_cell[c];
      if (const double distance = (mesh.vertex(v) - centres.col(K)).squaredNorm(); distance < least[K])
        least[K] = distance, clusters.vertices[K] = v;
    }
  std::vector<Index> number(count, -1);
  Index kept = 0;
  for (Index K = 0; K < count; ++K)
    if (std::isfinite(least[K])) {
      clusters.vertices[kept] = clusters.vertices[K];
      number[K] = kept++;
    }
  clusters.vertices.resize(kept);
  for (Index& K : clusters.of_cell) K = number[K];
  return clusters;
}

template <int Dim> SecondaryBasis<Dim> cell_clusters(const FineSpace<Dim>& space, const NodeCloud<Dim>& cloud) {
  return indicators_of(space, nearest_clusters(space.mesh(), cloud));
}

template <int Dim> SecondaryBasis<Dim> cell_clusters(const FineSpace<Dim>& space, const Clusters& clusters,
                                                     const ShapeTable<Dim>& shape, double fewest) {
  return indicators_of(space, take_apart(clusters, space, shape, fewest));
}

template <int Dim> SecondaryBasis<Dim> linear_clusters(const FineSpace<Dim>& space, const Clusters& clusters,
                                                       const ShapeTable<Dim>& shape, double fewest) {
  const Index small = space.degree() == 1 ? Dim + 1 : 0;
  return linear_functions_of(space, take_apart(clusters, space, shape, fewest, small));
}

template <int Dim> SecondaryBasis<Dim> secondary_from_table(const FineSpace<Dim>& space, const ShapeTable<Dim>& table,
                                                            const NodeCloud<Dim>& cloud) {
  const FineMesh<Dim>& mesh = space.mesh();
  const Index functions = table.num_nodes();
  SecondaryBasis<Dim> secondary{cloud.positions, cloud.vertices, {}, {}, space.cell_rule(), {}, {}};
  for (Index v : cloud.vertices) secondary.region.push_back(mesh.region(mesh.cells_of(v).front()));
  // Rows at points inside cells or facets are means of the rows at their vertices, weighted by barycentric coordinates.
  const auto interpolate_rows = [&](Index items, const auto& vertex_of, const auto& points) {
    const Index corners = static_cast<Index>(points.rows());
    std::vector<Index> offsets{0}, columns;
    std::vector<double> values;
    Accumulator<Eigen::Matrix<double, 1, 1>> row(functions);
    for (Index item = 0; item < items; ++item)
      for (Index q = 0; q < points.cols(); ++q) {
        row.clear();
        for (Index i = 0; i < corners; ++i) {
          const auto at_vertex = table.row(vertex_of(i, item));
          for (std::size_t k = 0; k < at_vertex.nodes.size(); ++k)
            row[at_vertex.nodes[k]][0] += points(i, q) * at_vertex.N[k];
        }
        for (Index K : row.sorted()) columns.push_back(K), values.push_back(row[K][0]);
        offsets.push_back(static_cast<Index>(columns.size()));
      }
    return from_rows(functions, offsets, columns, values);
  };
  secondary.in_cells = interpolate_rows(
      mesh.num_cells(), [&](Index i, Index c) { return mesh.cells()(i, c); }, space.cell_rule().points);
  secondary.on_facets = interpolate_rows(
      mesh.num_facets(), [&](Index i, Index f) { return mesh.facets()(i, f); }, space.facet_rule().points);
  return secondary;
}

template <int Dim> SecondaryBasis<Dim> every_cell(const FineSpace<Dim>& space) {
  return indicators_of(space, Clusters{std::vector<Index>(space.mesh().num_cells(), alone), {}});
}

template <int Dim> Vector secondary_weights(const FineSpace<Dim>& space, const SecondaryBasis<Dim>& secondary) {
  const Index per_cell = static_cast<Index>(secondary.rule.weights.size());
  Vector weights = Vector::Zero(secondary.in_cells.cols());
  for (Index p = 0; p < secondary.in_cells.rows(); ++p) {
    const double volume = weight(space, secondary.rule, p / per_cell, p % per_cell);
    for (SparseRows::InnerIterator entry(secondary.in_cells, p); entry; ++entry)
      weights[entry.col()] += volume * entry.value();
  }
  return weights;
}

namespace {

/// All of a discretization but its table.
template <int Dim> Quadrature<Dim> without_table(const FineSpace<Dim>& space, const SecondaryBasis<Dim>& secondary) {
  Quadrature<Dim> result;
  result.points = secondary.points;
  result.on_facets = secondary.on_facets;
  result.region = secondary.region;
  result.cluster = secondary.cluster;
  result.weights = secondary_weights(space, secondary);
  return result;
}

/// The projected table, up to `Count` points at a time where their functions live on the same cells.
template <int Count, int Dim> ShapeTable<Dim> projected_table(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                                              const SecondaryBasis<Dim>& secondary,
                                                              const Discretization<Dim>& discretization) {
  const SparseRows points_of = secondary.in_cells.transpose();  // M x rule points
  const auto& rule = secondary.rule;
  const Index per_cell = static_cast<Index>(rule.weights.size());
  const auto fill = [&](Index begin, Index end, auto& out) {
    Accumulator<Moments<Count>> fine(space.size()), nodal(shape.num_nodes());
    for (Index K = begin, next; K < end; K = next) {
      next = std::min({end, K + Count, discretization.end_of_cluster(K)});
      fine.clear();
      const Index *offsets = points_of.outerIndexPtr(), length = offsets[K + 1] - offsets[K];
      for (Index e = 0; e < length; ++e) {
        const Index point = points_of.innerIndexPtr()[offsets[K] + e], c = point / per_cell, q = point % per_cell;
        Eigen::Matrix<double, 1, Count> factors = Eigen::Matrix<double, 1, Count>::Zero();
        for (Index k = K; k < next; ++k)
          factors[k - K] = points_of.valuePtr()[offsets[k] + e] * weight(space, rule, c, q) / discretization.weights[k];
        add_cell_point<Dim, Count>(space, c, rule.points.col(q), factors, fine);
      }
      emit_nodes<Dim, Count>(shape, fine, nodal, static_cast<int>(next - K), out);
    }
  };
  return TableBuilder<Dim>(discretization.size(), shape.num_nodes(), space.axisymmetric()).build(fill);
}

}  // namespace

template <int Dim> Quadrature<Dim> project(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                           const SecondaryBasis<Dim>& secondary) {
  Quadrature<Dim> result = without_table(space, secondary);
  for (Index K = 0; K < result.size(); ++K)
    if (!(result.weights[K] > 0.0))
      throw NumericalError(
          fmt::format("quadrature: the weight of the point at ({:.6g}) is {:.3g}, expected a positive number",
                      fmt::join(result.points.col(K), ", "), result.weights[K]));
  result.shape = result.cluster.empty() ? projected_table<1>(space, shape, secondary, result)
                                        : projected_table<Dim + 1>(space, shape, secondary, result);
  return result;
}

template <int Dim> Quadrature<Dim> evaluate_at_points(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                                      const SecondaryBasis<Dim>& secondary) {
  const auto& rule = secondary.rule;
  const Index per_cell = static_cast<Index>(rule.weights.size());
  const SparseRows points_of = secondary.in_cells.transpose();
  Quadrature<Dim> result = without_table(space, secondary);
  result.shape = TableBuilder<Dim>(result.size(), shape.num_nodes(), space.axisymmetric())
                     .build([&](Index begin, Index end, auto& out) {
                       Accumulator<Moments<1>> fine(space.size()), nodal(shape.num_nodes());
                       for (Index K = begin; K < end; ++K) {
                         Index nearest = -1;
                         double best = std::numeric_limits<double>::infinity();
                         for (SparseRows::InnerIterator entry(points_of, K); entry; ++entry) {
                           const Vec<Dim> x =
                               space.position(entry.col() / per_cell, rule.points.col(entry.col() % per_cell));
                           if (const double distance = (x - result.points.col(K)).norm(); distance < best)
                             best = distance, nearest = entry.col();
                         }
                         fine.clear();
                         add_cell_point<Dim, 1>(space, nearest / per_cell, rule.points.col(nearest % per_cell),
                                                Eigen::Matrix<double, 1, 1>(1.0), fine);
                         emit_nodes<Dim, 1>(shape, fine, nodal, 1, out);
                       }
                     });
  return result;
}

template <int Dim> Quadrature<Dim> merge(const Quadrature<Dim>& fine, const SparseRows& functions) {
  if (functions.rows() != fine.size())
    throw InputError(
        fmt::format("merge: {} rows of functions for {} quadrature points", functions.rows(), fine.size()));
  const auto count = static_cast<Index>(functions.cols());
  const SparseRows members = functions.transpose();
  Quadrature<Dim> result;
  result.weights = members * fine.weights;
  if (!(result.weights.minCoeff() > 0.0)) throw InputError("merge: a function without quadrature points");
  result.points = Points<Dim>::Zero(Dim, count);
  for (Index g = 0; g < count; ++g) {
    result.region.push_back(fine.region[SparseRows::InnerIterator(members, g).col()]);
    for (SparseRows::InnerIterator K(members, g); K; ++K) {
      result.points.col(g) += fine.weights[K.col()] * K.value() / result.weights[g] * fine.points.col(K.col());
      if (fine.region[K.col()] != result.region[g]) throw InputError("merge: a function spans two regions");
    }
  }
  result.on_facets = fine.on_facets * functions;
  result.shape = TableBuilder<Dim>(count, fine.shape.num_nodes(), fine.axisymmetric())
                     .build([&](Index begin, Index end, auto& out) {
                       Accumulator<Moment> nodal(fine.shape.num_nodes());
                       for (Index g = begin; g < end; ++g) {
                         nodal.clear();
                         for (SparseRows::InnerIterator K(members, g); K; ++K) {
                           const double share = fine.weights[K.col()] * K.value() / result.weights[g];
                           const auto row = fine.shape.row(static_cast<Index>(K.col()));
                           for (std::size_t k = 0; k < row.nodes.size(); ++k) {
                             auto& moment = nodal[row.nodes[k]];
                             moment[0] += share * row.N[k];
                             moment.template segment<Dim>(1) += share * row.dN[k];
                             if (!row.hoop.empty()) moment[3] += share * row.hoop[k];
                           }
                         }
                         for (Index I : nodal.sorted()) out.add(I, nodal[I]);
                         out.close();
                       }
                     });
  return result;
}

template struct Quadrature<2>;
template Clusters nearest_clusters<2>(const FineMesh<2>&, const NodeCloud<2>&);
template Clusters levelled<2>(const FineMesh<2>&, Clusters);
template SecondaryBasis<2> cell_clusters<2>(const FineSpace<2>&, const NodeCloud<2>&);
template SecondaryBasis<2> cell_clusters<2>(const FineSpace<2>&, const Clusters&, const ShapeTable<2>&, double);
template SecondaryBasis<2> linear_clusters<2>(const FineSpace<2>&, const Clusters&, const ShapeTable<2>&, double);
template SecondaryBasis<2> secondary_from_table<2>(const FineSpace<2>&, const ShapeTable<2>&, const NodeCloud<2>&);
template SecondaryBasis<2> every_cell<2>(const FineSpace<2>&);
template Vector secondary_weights<2>(const FineSpace<2>&, const SecondaryBasis<2>&);
template Quadrature<2> project<2>(const FineSpace<2>&, const ShapeTable<2>&, const SecondaryBasis<2>&);
template Quadrature<2> evaluate_at_points<2>(const FineSpace<2>&, const ShapeTable<2>&, const SecondaryBasis<2>&);
template Quadrature<2> merge<2>(const Quadrature<2>&, const SparseRows&);
template struct Quadrature<3>;
template Clusters nearest_clusters<3>(const FineMesh<3>&, const NodeCloud<3>&);
template Clusters levelled<3>(const FineMesh<3>&, Clusters);
template SecondaryBasis<3> cell_clusters<3>(const FineSpace<3>&, const NodeCloud<3>&);
template SecondaryBasis<3> cell_clusters<3>(const FineSpace<3>&, const Clusters&, const ShapeTable<3>&, double);
template SecondaryBasis<3> linear_clusters<3>(const FineSpace<3>&, const Clusters&, const ShapeTable<3>&, double);
template SecondaryBasis<3> secondary_from_table<3>(const FineSpace<3>&, const ShapeTable<3>&, const NodeCloud<3>&);
template SecondaryBasis<3> every_cell<3>(const FineSpace<3>&);
template Vector secondary_weights<3>(const FineSpace<3>&, const SecondaryBasis<3>&);
template Quadrature<3> project<3>(const FineSpace<3>&, const ShapeTable<3>&, const SecondaryBasis<3>&);
template Quadrature<3> evaluate_at_points<3>(const FineSpace<3>&, const ShapeTable<3>&, const SecondaryBasis<3>&);
template Quadrature<3> merge<3>(const Quadrature<3>&, const SparseRows&);

}  // namespace efree
