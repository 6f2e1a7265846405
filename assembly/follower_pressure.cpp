// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/follower_pressure.hpp"

#include "efree/assembly/internal/boundary_points.hpp"
#include "efree/core/parallel.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace efree {
namespace {

/// Displacement gradient of the row's functions, and the strain of the hoops.
template <int Dim> std::pair<Mat<Dim>, double> gradient(const ShapeRow<Dim>& row, const Points<Dim>& U) {
  Mat<Dim> H = Mat<Dim>::Zero();
  double hoop = 0.0;
  for (std::size_t k = 0; k < row.nodes.size(); ++k) {
    H += U.col(row.nodes[k]) * row.dN[k].transpose();
    if (!row.hoop.empty()) hoop += row.hoop[k] * U(0, row.nodes[k]);
  }
  return {H, hoop};
}

/// Of the force per function at a point.
template <int Dim>
Vec<Dim> change(const typename FollowerPressures<Dim>::Now& now, const ShapeRow<Dim>& row, const Points<Dim>& dU) {
  const auto [dH, dhoop] = gradient(row, dU);
  return -now.size * ((now.hoop * now.inverse_transposed.cwiseProduct(dH).sum() + dhoop) * now.m -
                      now.hoop * now.inverse_transposed * (dH.transpose() * now.m));
}

}  // namespace

template <int Dim> Loads<Dim> at_rest(Loads<Dim> loads) {
  for (const FollowerPressure<Dim>& follower : loads.followers) {
    loads.tractions.push_back(pressure<Dim>(follower.on, follower.pressure));
    loads.tractions.back().kind = "follower_pressure";
  }
  loads.followers.clear();
  return loads;
}

template <int Dim> FollowerPressures<Dim>::FollowerPressures(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                                             const std::vector<FollowerPressure<Dim>>& on) {
  struct Entry {
    Index node;
    double N, hoop;
    Vec<Dim> dN;
  };
  std::vector<Offset> offsets{0};
  std::vector<Index> nodes;
  std::vector<double> N, hoop;
  std::vector<Vec<Dim>> dN;
  std::vector<Entry> entries;
  const auto& rule = space.facet_rule();
  for (const auto& condition : on) {
    parts_.push_back(condition.on);
    internal::for_each_point<Dim>(
        space, space.mesh().group(condition.on), [&](const internal::BoundaryPoint<Dim>& point) {
          if (!(point.weight > 0.0)) return;  // on the axis
          points_.push_back({parts_.size() - 1, point.x, point.n, point.weight});
          const Index c = space.mesh().facet_cell(point.facet);
          const Index g = point.row - point.facet * static_cast<Index>(rule.weights.size());
          const auto gradients = space.gradients(c, space.facet_point(point.facet, rule.points.col(g)));
          entries.clear();
          for (std::size_t i = 0; i < point.dofs.size(); ++i) {
            const auto row = shape.row(point.dofs[i]);
            for (std::size_t k = 0; k < row.nodes.size(); ++k) {
              const double value = point.N[i] * row.N[k];
              entries.push_back({row.nodes[k], value, space.axisymmetric() ? value / point.x[0] : 0.0,
                                 row.N[k] * gradients.col(static_cast<Eigen::Index>(i))});
            }
          }
          std::ranges::stable_sort(entries, {}, &Entry::node);
          for (const Entry& entry : entries) {
            if (static_cast<Offset>(nodes.size()) > offsets.back() && nodes.back() == entry.node) {
              N.back() += entry.N;
              dN.back() += entry.dN;
              if (space.axisymmetric()) hoop.back() += entry.hoop;
            } else {
              nodes.push_back(entry.node);
              N.push_back(entry.N);
              dN.push_back(entry.dN);
              if (space.axisymmetric()) hoop.push_back(entry.hoop);
            }
          }
          offsets.push_back(static_cast<Offset>(nodes.size()));
        });
  }
  table_ = ShapeTable<Dim>(shape.num_nodes(), std::move(offsets), std::move(nodes), std::move(N), std::move(dN),
                           std::move(hoop));
}

template <int Dim> Vector FollowerPressures<Dim>::at_points(const std::vector<FollowerPressure<Dim>>& pressures) const {
  Vector result(static_cast<Eigen::Index>(points_.size()));
  for (std::size_t q = 0; q < points_.size(); ++q) {
    const auto& [part, x, n, weight] = points_[q];
    const double p = pressures.at(part).pressure(x);
    if (!std::isfinite(p))
      throw InputError(fmt::format("pressure on \"{}\" is {} at {}, expected a finite number", parts_[part], p,
                                   internal::place_text<Dim>(x)));
    result[static_cast<Eigen::Index>(q)] = p;
  }
  return result;
}

template <int Dim>
std::vector<typename FollowerPressures<Dim>::Now> FollowerPressures<Dim>::now(const Vector& pressure,
                                                                              const Points<Dim>& U) const {
  std::vector<Now> result(points_.size());
  parallel_for(static_cast<Index>(points_.size()), [&](Index q) {
    const auto [H, hoop] = gradient(table_.row(q), U);
    const Mat<Dim> F = Mat<Dim>::Identity() + H, inverse_transposed = F.inverse().transpose();
    result[q] = {pressure[q] * F.determinant() * points_[q].weight, 1.0 + hoop, inverse_transposed * points_[q].n,
                 inverse_transposed};
  });
  return result;
}

template <int Dim> Points<Dim> FollowerPressures<Dim>::forces(const Vector& pressure, const Points<Dim>& U) const {
  Points<Dim> result = Points<Dim>::Zero(Dim, U.cols());
  const auto here = now(pressure, U);
  for (Index q = 0; q < table_.num_points(); ++q) {
    const auto row = table_.row(q);
    const Vec<Dim> f = -here[q].size * here[q].hoop * here[q].m;
    for (std::size_t k = 0; k < row.nodes.size(); ++k) result.col(row.nodes[k]) += row.N[k] * f;
  }
  return result;
}

template <int Dim>
Points<Dim> FollowerPressures<Dim>::changes(const std::vector<Now>& now, const Points<Dim>& dU) const {
  Points<Dim> result = Points<Dim>::Zero(Dim, dU.cols());
  for (Index q = 0; q < table_.num_points(); ++q) {
    const auto row = table_.row(q);
    const Vec<Dim> df = change<Dim>(now[q], row, dU);
    for (std::size_t k = 0; k < row.nodes.size(); ++k) result.col(row.nodes[k]) += row.N[k] * df;
  }
  return result;
}

template <int Dim>
Points<Dim> FollowerPressures<Dim>::unsymmetric_changes(const std::vector<Now>& now, const Points<Dim>& dU) const {
  Points<Dim> result = Points<Dim>::Zero(Dim, dU.cols());
  for (Index q = 0; q < table_.num_points(); ++q) {
    const auto row = table_.row(q);
    const auto& [size, hoop, m, inverse_transposed] = now[q];
    const Vec<Dim> df = change<Dim>(now[q], row, dU);
    Vec<Dim> du = Vec<Dim>::Zero();
    for (std::size_t k = 0; k < row.nodes.size(); ++k) du += row.N[k] * dU.col(row.nodes[k]);
    for (std::size_t k = 0; k < row.nodes.size(); ++k) {
      const Vec<Dim> g = inverse_transposed * row.dN[k];
      Vec<Dim> transposed = -size * hoop * (m.dot(du) * g - g.dot(du) * m);
      if (!row.hoop.empty()) transposed[0] -= size * row.hoop[k] * m.dot(du);
      result.col(row.nodes[k]) += 0.5 * (row.N[k] * df - transposed);
    }
  }
  return result;
}

template <int Dim>
std::vector<std::pair<std::string, Resultant<Dim>>> FollowerPressures<Dim>::resultants(const Vector& pressure,
                                                                                       const Points<Dim>& U) const {
  std::vector<std::pair<std::string, Resultant<Dim>>> result;
  for (const std::string& part : parts_) result.emplace_back(part, Resultant<Dim>{});
  const auto here = now(pressure, U);
  for (Index q = 0; q < table_.num_points(); ++q) {
    const auto row = table_.row(q);
    const Vec<Dim> f = -here[q].size * here[q].hoop * here[q].m;
    Vec<Dim> x = points_[q].x;
    for (std::size_t k = 0; k < row.nodes.size(); ++k) x += row.N[k] * U.col(row.nodes[k]);
    Resultant<Dim>& of = result[points_[q].part].second;
    if (table_.has_hoop())
      of.force += f;
    else
      of.add(x, f);
  }
  return result;
}

template Loads<2> at_rest<2>(Loads<2>);
template Loads<3> at_rest<3>(Loads<3>);
template class FollowerPressures<2>;
template class FollowerPressures<3>;

}  // namespace efree
