// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/cracks/cracked_body.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/disjoint_sets.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/cracks/internal/pieces.hpp"
#include "efree/geometry/mesh/internal/signed_volume.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <utility>

namespace efree {

using internal::CrackMiddle, internal::CrackMiddles, internal::Skeleton;

template <int Dim> struct CrackedBody<Dim>::Topology {
  PointMesh<Dim> mesh;
  Skeleton<Dim> skeleton;
  Ragged<Index> edges_to_points{};  ///< by vertex: edges whose other end is a point

  explicit Topology(PointMesh<Dim> of) : mesh(std::move(of)), skeleton(mesh.cells) {
    std::vector<std::vector<Index>> found(mesh.vertices.cols());
    for (std::size_t e = 0; e < skeleton.edges.vertices.size(); ++e) {
      const auto [a, b] = skeleton.edges.vertices[e];
      if (b < mesh.num_points) found[a].push_back(static_cast<Index>(e));
      if (a < mesh.num_points) found[b].push_back(static_cast<Index>(e));
    }
    for (const auto& edges : found) {
      edges_to_points.items.insert(edges_to_points.items.end(), edges.begin(), edges.end());
      edges_to_points.close_row();
    }
  }
};

namespace {

/// The deformation gradient that takes edges at the start, dX, to those now, dx, by least squares with equal weights
/// for their directions. Along directions that no edge has it stays as it was.
template <int Dim> class FittedGradient {
 public:
  void add(const Vec<Dim>& dX, const Vec<Dim>& dx) {
    moments_ += dX * dX.transpose() / dX.squaredNorm();
    product_ += dx * dX.transpose() / dX.squaredNorm();
  }
  Mat<Dim> fit(const Mat<Dim>& before) const {
    Eigen::SelfAdjointEigenSolver<Mat<Dim>> axes;
    axes.computeDirect(moments_);
    constexpr double least = 0.05;  // of the largest moment: less is but noise of the directions
    const Mat<Dim> missing = product_ - before * moments_;
    Mat<Dim> result = before;
    for (int i = 0; i < Dim; ++i) {
      const double moment = axes.eigenvalues()[i];
      const Vec<Dim> axis = axes.eigenvectors().col(i);
      if (moment > least * axes.eigenvalues()[Dim - 1]) result += missing * axis * axis.transpose() / moment;
    }
    return result.allFinite() ? result : before;
  }

 private:
  Mat<Dim> moments_ = Mat<Dim>::Zero(), product_ = Mat<Dim>::Zero();
};

}  // namespace

template <int Dim> CrackedBody<Dim>::CrackedBody(PointMesh<Dim> mesh, const CrackOptions& options) : options_(options) {
  require(options.stretch > 1.0 && std::isfinite(options.stretch), "cracks: expected a stretch of more than 1");
  require(options.smoothing >= 0, "cracks: expected no or some sweeps of smoothing");
  const auto V = static_cast<Index>(mesh.vertices.cols());
  require(mesh.num_points >= 0 && mesh.num_points <= V && static_cast<Index>(mesh.owner.size()) == V &&
              std::ranges::all_of(mesh.owner, [&](Index p) { return p >= 0 && p < mesh.num_points; }) &&
              (mesh.cells.size() == 0 || (mesh.cells.minCoeff() >= 0 && mesh.cells.maxCoeff() < V)),
          "cracks: cells or owners that are no vertices or points of the mesh");
  topology_ = std::make_unique<Topology>(std::move(mesh));
  x_ = topology_->mesh.vertices;
  F_.assign(topology_->mesh.owner.size(), Mat<Dim>::Identity());
  is_cut_.assign(topology_->skeleton.edges.vertices.size(), 0);
}
template <int Dim> CrackedBody<Dim>::~CrackedBody() = default;
template <int Dim> CrackedBody<Dim>::CrackedBody(CrackedBody&&) noexcept = default;

template <int Dim> Index CrackedBody<Dim>::num_edges() const {
  return static_cast<Index>(is_cut_.size());
}
template <int Dim> Index CrackedBody<Dim>::num_cut_edges() const {
  return static_cast<Index>(std::ranges::count(is_cut_, 1));
}
template <int Dim> double CrackedBody<Dim>::largest_stretch() const {
  return largest_stretch_;
}

template <int Dim> void CrackedBody<Dim>::move(const Points<Dim>& points) {
  const PointMesh<Dim>& mesh = topology_->mesh;
  const auto& edges = topology_->skeleton.edges.vertices;
  const Points<Dim>& X = mesh.vertices;
  require(points.cols() == mesh.num_points, "cracks: expected the positions of all points");
  std::vector<double> stretch(edges.size(), 1.0);
  parallel_for(num_edges(), [&](Index e) {
    const Index a = mesh.owner[edges[e][0]], b = mesh.owner[edges[e][1]];
    if (a == b) return;
    stretch[e] = (points.col(a) - points.col(b)).norm() / (X.col(a) - X.col(b)).norm();
    if (!(stretch[e] <= options_.stretch)) is_cut_[e] = 1;
  });
  largest_stretch_ = 0.0;
  for (Index e = 0; e < num_edges(); ++e)
    if (is_cut_[e] == 0) largest_stretch_ = std::max(largest_stretch_, stretch[e]);

  parallel_for(mesh.num_points, [&](Index p) {
    FittedGradient<Dim> gradient;
    for (const Index e : topology_->edges_to_points[p]) {
      if (is_cut_[e] != 0) continue;
      const Index q = edges[e][0] + edges[e][1] - p;
      gradient.add(X.col(q) - X.col(p), points.col(q) - points.col(p));
    }
    F_[p] = gradient.fit(F_[p]);
  });
  x_.leftCols(mesh.num_points) = points;
  // Other vertices: the mean of the affine motions of their point and of those that uncut edges connect them to.
  parallel_for(static_cast<Index>(X.cols()) - mesh.num_points, [&](Index k) {
    const Index v = mesh.num_points + k;
    double weights = 0.0;
    x_.col(v).setZero();
    F_[v].setZero();
    const auto add = [&](Index p) {
      const double weight = 1.0 / (X.col(v) - X.col(p)).squaredNorm();
      x_.col(v) += weight * (points.col(p) + F_[p] * (X.col(v) - X.col(p)));
      F_[v] += weight * F_[p];
      weights += weight;
    };
    add(mesh.owner[v]);
    for (const Index e : topology_->edges_to_points[v])
      if (const Index p = edges[e][0] + edges[e][1] - v; is_cut_[e] == 0 && p != mesh.owner[v]) add(p);
    x_.col(v) /= weights;
    F_[v] /= weights;
  });
}

namespace {

/// Columns of an integer matrix.
template <int K> Eigen::Matrix<Index, K, Eigen::Dynamic> columns_of(const std::vector<std::array<Index, K>>& arrays) {
  Eigen::Matrix<Index, K, Eigen::Dynamic> result(K, static_cast<Index>(arrays.size()));
  for (std::size_t c = 0; c < arrays.size(); ++c)
    for (int i = 0; i < K; ++i) result(i, static_cast<Index>(c)) = arrays[c][i];
  return result;
}

/// The nodes of a mesh: its vertices, and the middles for each group.
template <int Dim> void place_nodes(const Points<Dim>& X, const Points<Dim>& x, const std::vector<Mat<Dim>>& F,
                                    const CrackMiddles<Dim>& middles, CrackedMesh<Dim>& result) {
  auto count = static_cast<Index>(X.cols());
  for (const CrackMiddle<Dim>& middle : middles.all()) count += middle.groups;
  result.reference.resize(Dim, count);
  result.reference.leftCols(X.cols()) = X;
  result.current = result.reference;
  result.current.leftCols(X.cols()) = x;
  for (Index v = 0; v < X.cols(); ++v) {
    result.vertices.items.push_back(v);
    result.vertices.close_row();
  }
  Index next = static_cast<Index>(X.cols());
  for (const CrackMiddle<Dim>& middle : middles.all()) {
    const Vec<Dim> place = middle.position(X);
    for (int group = 0; group < middle.groups; ++group, ++next) {
      Vec<Dim> sum = Vec<Dim>::Zero();
      for (int i = 0; i < middle.size; ++i) {
        const Index v = middle.vertices[i];
        if (middle.group[i] != group) continue;
        sum += x.col(v) + F[v] * (place - X.col(v));
        result.vertices.items.push_back(v);
      }
      result.vertices.close_row();
      result.reference.col(next) = place;
      result.current.col(next) = sum / static_cast<double>(result.vertices[next].size());
    }
  }
}

/// Parts of the cells by the first vertex of what hangs together with theirs, `first`, by vertex.
template <int Dim>
void number_parts(const std::vector<Index>& first, const std::vector<Index>& vertex_of_cell, CrackedMesh<Dim>& result) {
  Vector volume = Vector::Zero(std::ssize(first));
  std::vector<Index> parts;
  for (Index c = 0; c < result.cells.cols(); ++c) {
    parts.push_back(first[vertex_of_cell[c]]);
    volume[parts.back()] += internal::signed_volume<Dim>(result.reference, result.cells, c);
  }
  result.part = parts;
  std::ranges::sort(parts);
  parts.erase(std::unique(parts.begin(), parts.end()), parts.end());
  std::ranges::stable_sort(parts, [&](Index a, Index b) { return volume[a] > volume[b]; });
  std::vector<Index> number(first.size(), -1);
  for (std::size_t k = 0; k < parts.size(); ++k) number[parts[k]] = static_cast<Index>(k);
  for (Index& part : result.part) part = number[part];
  result.volumes = volume(parts);
}

}  // namespace

template <int Dim> CrackedMesh<Dim> CrackedBody<Dim>::mesh() const {
  const PointMesh<Dim>& mesh = topology_->mesh;
  const Skeleton<Dim>& skeleton = topology_->skeleton;
  CrackMiddles<Dim> middles(mesh.cells, skeleton, is_cut_);
  middles.smooth(mesh.vertices, options_.smoothing);
  CrackedMesh<Dim> result;
  result.crack_area = middles.area(mesh.vertices);
  place_nodes(mesh.vertices, x_, F_, middles, result);

  const auto V = static_cast<Index>(mesh.vertices.cols());
  internal::Pieces<Dim> pieces = internal::cut_into_pieces(mesh.cells, skeleton, middles, V);
  result.cells = columns_of<Dim + 1>(pieces.cells);
  result.surface = columns_of<Dim>(pieces.surface);
  result.is_crack = std::move(pieces.is_crack);

  internal::DisjointSets sets(V);
  for (Index e = 0; e < num_edges(); ++e)
    if (is_cut_[e] == 0) sets.join(skeleton.edges.vertices[e][0], skeleton.edges.vertices[e][1]);
  for (Index v = mesh.num_points; v < V; ++v) sets.join(v, mesh.owner[v]);
  number_parts(std::move(sets).firsts(), pieces.vertex, result);
  return result;
}

template class CrackedBody<2>;
template class CrackedBody<3>;

}  // namespace efree
