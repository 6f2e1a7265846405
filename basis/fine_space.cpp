// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/basis/fine_space.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/setting_error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>

namespace efree {

template <> SimplexRule<1> simplex_rule<1>(int degree) {
  if (degree < 1 || degree > 5)
    throw InputError(fmt::format("quadrature on segments of degree {}, expected 1 to 5", degree));
  // Gauss-Legendre points on [-1, 1].
  std::vector<double> x, w;
  if (degree == 1) {
    x = {0.0}, w = {1.0};
  } else if (degree <= 3) {
    x = {-std::sqrt(1.0 / 3.0), std::sqrt(1.0 / 3.0)}, w = {0.5, 0.5};
  } else {
    x = {-std::sqrt(0.6), 0.0, std::sqrt(0.6)}, w = {5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0};
  }
  SimplexRule<1> rule;
  const Index n = static_cast<Index>(x.size());
  rule.points.resize(2, n);
  rule.weights = Eigen::Map<const Vector>(w.data(), n);
  for (Index q = 0; q < n; ++q) rule.points.col(q) << 0.5 * (1.0 - x[q]), 0.5 * (1.0 + x[q]);
  return rule;
}

template <> SimplexRule<2> simplex_rule<2>(int degree) {
  if (degree < 1 || degree > 5)
    throw InputError(fmt::format("quadrature on triangles of degree {}, expected 1 to 5", degree));
  SimplexRule<2> rule;
  if (degree == 1) {
    rule.points = Eigen::Vector3d::Constant(1.0 / 3.0);
    rule.weights = Vector::Ones(1);
    return rule;
  }
  // Orbits of three points (1 - 2a, a, a); degree 4: Dunavant 1985, degree 5: Radon 1948.
  std::vector<std::pair<double, double>> orbits;
  if (degree == 2)
    orbits = {{1.0 / 6.0, 1.0 / 3.0}};
  else if (degree <= 4)
    orbits = {{0.44594849091596488632, 0.22338158967801146570}, {0.09157621350977074346, 0.10995174365532186764}};
  else
    orbits = {{(6.0 - std::sqrt(15.0)) / 21.0, (155.0 - std::sqrt(15.0)) / 1200.0},
              {(6.0 + std::sqrt(15.0)) / 21.0, (155.0 + std::sqrt(15.0)) / 1200.0}};
  const Index centre = degree == 5 ? 1 : 0;
  rule.points.resize(3, centre + 3 * orbits.size());
  rule.weights.resize(centre + 3 * orbits.size());
  Index q = centre;
  if (centre) rule.points.col(0).setConstant(1.0 / 3.0), rule.weights[0] = 9.0 / 40.0;
  for (const auto& [a, weight] : orbits)
    for (int i = 0; i < 3; ++i, ++q) {
      rule.points.col(q).setConstant(a);
      rule.points(i, q) = 1.0 - 2.0 * a;
      rule.weights[q] = weight;
    }
  return rule;
}

template <> SimplexRule<3> simplex_rule<3>(int degree) {
  if (degree < 1 || degree > 5)
    throw InputError(fmt::format("quadrature on tetrahedra of degree {}, expected 1 to 5", degree));
  SimplexRule<3> rule;
  if (degree == 1) {
    rule.points = Eigen::Vector4d::Constant(0.25);
    rule.weights = Vector::Ones(1);
    return rule;
  }
  // Orbits of four points (1 - 3a, a, a, a); beyond degree 2 the 14 points of Walkington 2000 with six points
  // (1/2 - a, 1/2 - a, a, a).
  std::vector<std::pair<double, double>> orbits;
  if (degree == 2)
    orbits = {{(5.0 - std::sqrt(5.0)) / 20.0, 0.25}};
  else
    orbits = {{0.31088591926330060980, 0.11268792571801585080}, {0.09273525031089122640, 0.07349304311636194954}};
  const Index size = degree == 2 ? 4 : 14;
  rule.points.resize(4, size);
  rule.weights.resize(size);
  Index q = 0;
  for (const auto& [a, weight] : orbits)
    for (int i = 0; i < 4; ++i, ++q) {
      rule.points.col(q).setConstant(a);
      rule.points(i, q) = 1.0 - 3.0 * a;
      rule.weights[q] = weight;
    }
  if (degree > 2)
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < i; ++j, ++q) {
        rule.points.col(q).setConstant(0.04550370412564964949);
        rule.points(i, q) = rule.points(j, q) = 0.5 - 0.04550370412564964949;
        rule.weights[q] = 0.04254602077708146644;
      }
  return rule;
}

namespace {

/// Local end vertices of the edges of a simplex, in the order (0,1), (0,2), ..., (Dim-1,Dim).
template <int Dim> constexpr auto local_edges() {
  std::array<std::array<int, 2>, Dim*(Dim + 1) / 2> edges{};
  int e = 0;
  for (int i = 0; i <= Dim; ++i)
    for (int j = i + 1; j <= Dim; ++j) edges[e++] = {i, j};
  return edges;
}

/// Throws InputError unless the mesh is half of a meridian section.
template <int Dim> void check_meridian(const FineMesh<Dim>& mesh) {
  if (Dim == 3) throw InputError("an axisymmetric analysis needs a mesh in the plane, half of a meridian section");
  Index v = 0;
  const double least = mesh.vertices().row(0).minCoeff(&v);
  const double extent = (mesh.vertices().rowwise().maxCoeff() - mesh.vertices().rowwise().minCoeff()).norm();
  if (least < -1e-12 * extent)
    throw internal::SettingError(
        "analysis.plane",
        fmt::format("axisymmetric: the vertex ({:.6g}) lies at a negative radius; x is the radius, expected "
                    "x >= 0 everywhere, and y the axis",
                    fmt::join(mesh.vertex(v), ", ")));
}

}  // namespace

template <int Dim> FineSpace<Dim>::FineSpace(std::shared_ptr<const FineMesh<Dim>> shared, int degree, bool axisymmetric)
    : mesh_(std::move(shared)), degree_(degree), axisymmetric_(axisymmetric) {
  require(mesh_ != nullptr, "a fine space without a mesh");
  const FineMesh<Dim>& mesh = *mesh_;
  if (degree != 1 && degree != 2) throw InputError(fmt::format("fine space of degree {}, expected 1 or 2", degree));
  if (axisymmetric) check_meridian(mesh);
  const auto edges = local_edges<Dim>();
  const int corner_count = Dim + 1;
  cell_size_ = degree == 1 ? corner_count : max_cell_size;
  cell_dofs_.resize(static_cast<std::size_t>(mesh.num_cells()) * cell_size_);
  for (Index c = 0; c < mesh.num_cells(); ++c)
    for (int i = 0; i < corner_count; ++i)
      cell_dofs_[static_cast<std::size_t>(c) * cell_size_ + i] = mesh.cells()(i, c);
  points_ = mesh.vertices();

  if (degree == 2) {
    struct Side {
      Index a, b;
      std::size_t slot;
      bool operator<(const Side& other) const { return std::tie(a, b, slot) < std::tie(other.a, other.b, other.slot); }
    };
    std::vector<Side> sides;
    sides.reserve(static_cast<std::size_t>(mesh.num_cells()) * edges.size());
    for (Index c = 0; c < mesh.num_cells(); ++c)
      for (std::size_t e = 0; e < edges.size(); ++e) {
        const Index a = mesh.cells()(edges[e][0], c), b = mesh.cells()(edges[e][1], c);
        sides.push_back({std::min(a, b), std::max(a, b), static_cast<std::size_t>(c) * cell_size_ + corner_count + e});
      }
    std::sort(sides.begin(), sides.end());
    std::vector<Vec<Dim>> midpoints;
    for (std::size_t s = 0; s < sides.size(); ++s) {
      if (s == 0 || sides[s].a != sides[s - 1].a || sides[s].b != sides[s - 1].b)
        midpoints.push_back(0.5 * (mesh.vertex(sides[s].a) + mesh.vertex(sides[s].b)));
      cell_dofs_[sides[s].slot] = mesh.num_vertices() + static_cast<Index>(midpoints.size()) - 1;
    }
    points_.conservativeResize(Dim, mesh.num_vertices() + static_cast<Index>(midpoints.size()));
    for (std::size_t m = 0; m < midpoints.size(); ++m)
      points_.col(mesh.num_vertices() + static_cast<Index>(m)) = midpoints[m];
  }
  cell_rule_ = simplex_rule<Dim>(degree == 1 ? 1 : 2);
  facet_rule_ = simplex_rule<Dim - 1>(5);

  if (mesh.num_regions() == 1) return;
  std::vector<Index> first(size(), -1);  // region of the first cell
  for (Index c = 0; c < mesh.num_cells(); ++c)
    for (const Index dof : cell(c)) {
      if (first[dof] < 0) first[dof] = mesh.region(c);
      if (first[dof] != mesh.region(c)) shared_.emplace_back(dof, mesh.region(c));
    }
  if (shared_.empty()) return;
  std::ranges::sort(shared_);
  shared_.erase(std::unique(shared_.begin(), shared_.end()), shared_.end());
  cell_places_ = cell_dofs_;
  for (Index c = 0; c < mesh.num_cells(); ++c)
    for (int i = 0; i < cell_size_; ++i) {
      Index& at = cell_places_[static_cast<std::size_t>(c) * cell_size_ + i];
      if (first[at] != mesh.region(c)) at = place(at, mesh.region(c));
    }
}

template <int Dim> std::span<const Index> FineSpace<Dim>::cell(Index c) const {
  return {cell_dofs_.data() + static_cast<std::size_t>(c) * cell_size_, static_cast<std::size_t>(cell_size_)};
}

template <int Dim> std::span<const Index> FineSpace<Dim>::places(Index c) const {
  if (cell_places_.empty()) return cell(c);
  return {cell_places_.data() + static_cast<std::size_t>(c) * cell_size_, static_cast<std::size_t>(cell_size_)};
}

template <int Dim> Index FineSpace<Dim>::place(Index dof, Index region) const {
  const std::pair wanted(dof, region);
  const auto found = std::ranges::lower_bound(shared_, wanted);
  return found != shared_.end() && *found == wanted ? size() + static_cast<Index>(found - shared_.begin()) : dof;
}

template <int Dim> Matrix FineSpace<Dim>::at_places(const Eigen::Ref<const Matrix>& values) const {
  Matrix result(values.rows(), num_places());
  result.leftCols(size()) = values;
  for (Index p = size(); p < num_places(); ++p) result.col(p) = values.col(dof_at(p));
  return result;
}

template <int Dim> std::vector<std::array<Index, 2>> FineSpace<Dim>::edges() const {
  std::vector<std::array<Index, 2>> ends(size() - mesh_->num_vertices());
  if (ends.empty()) return ends;
  for (Index c = 0; c < mesh_->num_cells(); ++c) {
    const auto dofs = cell(c);
    std::size_t k = Dim + 1;
    for (int i = 0; i <= Dim; ++i)
      for (int j = i + 1; j <= Dim; ++j) ends[dofs[k++] - mesh_->num_vertices()] = {dofs[i], dofs[j]};
  }
  return ends;
}

template <int Dim> std::vector<Index> FineSpace<Dim>::facet(Index f) const {
  std::vector<Index> dofs;
  for (int k = 0; k < Dim; ++k) dofs.push_back(mesh_->facets()(k, f));
  if (degree_ == 2) {
    const auto edges = local_edges<Dim>();
    const Index c = mesh_->facet_cell(f);
    const auto on_facet = [&](Index v) { return std::find(dofs.begin(), dofs.begin() + Dim, v) != dofs.begin() + Dim; };
    for (std::size_t e = 0; e < edges.size(); ++e)
      if (on_facet(mesh_->cells()(edges[e][0], c)) && on_facet(mesh_->cells()(edges[e][1], c)))
        dofs.push_back(cell(c)[Dim + 1 + e]);
  }
  return dofs;
}

template <int Dim> auto FineSpace<Dim>::values(const Barycentric& at) const -> CellValues {
  CellValues N(cell_size_);
  if (degree_ == 1) {
    N = at;
    return N;
  }
  for (int i = 0; i <= Dim; ++i) N[i] = at[i] * (2.0 * at[i] - 1.0);
  int k = Dim + 1;
  for (const auto& [i, j] : local_edges<Dim>()) N[k++] = 4.0 * at[i] * at[j];
  return N;
}

template <int Dim> auto FineSpace<Dim>::gradients(Index c, const Barycentric& at) const -> CellGradients {
  const auto hats = mesh_->hat_gradients(c);
  CellGradients dN(Dim, cell_size_);
  if (degree_ == 1) {
    dN = hats;
    return dN;
  }
  for (int i = 0; i <= Dim; ++i) dN.col(i) = (4.0 * at[i] - 1.0) * hats.col(i);
  int k = Dim + 1;
  for (const auto& [i, j] : local_edges<Dim>()) dN.col(k++) = 4.0 * (at[i] * hats.col(j) + at[j] * hats.col(i));
  return dN;
}

template <int Dim> Vec<Dim> FineSpace<Dim>::position(Index c, const Barycentric& at) const {
  Vec<Dim> x = Vec<Dim>::Zero();
  for (int i = 0; i <= Dim; ++i) x += at[i] * mesh_->vertices().col(mesh_->cells()(i, c));
  return x;
}

template <int Dim> Vec<Dim> FineSpace<Dim>::centre_of_mass(Index c) const {
  const Vec<Dim> centroid = mesh_->centroid(c);
  if (!axisymmetric_) return centroid;
  // int x r / int r over a triangle, from the mean of (x - centroid)(r - r_centroid).
  Vec<Dim> covariance = Vec<Dim>::Zero();
  for (int i = 0; i <= Dim; ++i) {
    const Vec<Dim> arm = mesh_->vertex(mesh_->cells()(i, c)) - centroid;
    covariance += arm[0] * arm / 12.0;
  }
  return centroid + covariance / centroid[0];
}

template <int Dim> auto FineSpace<Dim>::facet_point(Index f, const Eigen::Matrix<double, Dim, 1>& at) const
    -> Barycentric {
  Barycentric inside = Barycentric::Zero();
  const Index c = mesh_->facet_cell(f);
  for (int k = 0; k < Dim; ++k)
    for (int i = 0; i <= Dim; ++i)
      if (mesh_->cells()(i, c) == mesh_->facets()(k, f)) inside[i] = at[k];
  return inside;
}

template class FineSpace<2>;
template class FineSpace<3>;

}  // namespace efree
