// SPDX-License-Identifier: GPL-3.0-or-later
/// Walls and tools against surfaces whose points are no nodes.
#include "efree/core/parallel.hpp"
#include "efree/otm/internal/motion.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace efree::internal {
namespace {

/// Gap below which points of a surface are near a tool, over the smallest spacing of nodes.
constexpr double wall_skin = 0.1;
/// Of the velocity that is to be stopped this part may be left, and what so many iterations leave: gaps tell the next
/// step of it. What takes more of them are motions of nodes that surfaces hardly feel, and forces are no better.
constexpr double tolerance = 1e-3;
constexpr int most_iterations = 15;

/// What there is of bodies near a tool: impulses on points of surfaces make velocities of these points. R components of
/// both: one along the normal, or all along the axes.
template <int R> class Patch {
 public:
  using Values = Eigen::Matrix<double, R, Eigen::Dynamic>;
  using Value = Eigen::Matrix<double, R, 1>;

  /// `free`: of all nodes, 0 for what is prescribed, else 1.
  template <int Dim> Patch(const Motion<Dim>& motion, const std::vector<Index>& near, const Values& free) {
    std::vector<Index> number(motion.x.cols(), -1);
    const auto take = [&](Index a) {
      if (number[a] < 0) {
        number[a] = static_cast<Index>(nodes_.size());
        nodes_.push_back(a);
      }
      return number[a];
    };
    Index terms = 1;
    for (const Index s : near) {
      for (SparseRows::InnerIterator entry(motion.surface_points, s); entry; ++entry) {
        points_.push_back({take(entry.col()), entry.value()});
        terms = std::max(terms, motion.bodies[motion.body_of_node[entry.col()]].mass_terms);
      }
      point_offsets_.push_back(points_.size());
    }
    // As far as the terms of the series reach and come back from.
    for (Index ring = 0; ring < (terms - 1) / 2; ++ring)
      for (std::size_t k = 0, known = nodes_.size(); k < known; ++k)
        for (SparseRows::InnerIterator entry(motion.coupling, nodes_[k]); entry; ++entry) take(entry.col());
    const auto n = static_cast<Index>(nodes_.size());
    free_ = free(Eigen::all, nodes_);
    mass_ = motion.mass(nodes_);
    pull_.setZero(R, n);
    for (Index k = 0; k < n; ++k) {
      terms_.push_back(motion.bodies[motion.body_of_node[nodes_[k]]].mass_terms);
      for (SparseRows::InnerIterator entry(motion.coupling, nodes_[k]); entry; ++entry) {
        pull_.col(k) += entry.value() * free.col(entry.col());
        if (number[entry.col()] >= 0) coupling_.push_back({number[entry.col()], entry.value()});
      }
      coupling_offsets_.push_back(coupling_.size());
    }
    find_bounds();
  }

  Index size() const { return static_cast<Index>(point_offsets_.size()) - 1; }
  const std::vector<Index>& nodes() const { return nodes_; }
  /// By point, of the matrix from impulses to velocities: together they bound it (Gershgorin).
  const Vector& bounds() const { return bounds_; }

  /// Impulses on the nodes, by those on the points.
  Values on_nodes(const Values& impulses) const {
    Values result = Values::Zero(R, mass_.size());
    for (Index s = 0; s < size(); ++s)
      for (std::size_t e = point_offsets_[s]; e < point_offsets_[s + 1]; ++e)
        result.col(points_[e].node) += points_[e].value * impulses.col(s);
    return result;
  }
  /// What values at the nodes come to at the points.
  Values at_points(const Values& of_nodes) const {
    Values result = Values::Zero(R, size());
    for (Index s = 0; s < size(); ++s)
      for (std::size_t e = point_offsets_[s]; e < point_offsets_[s + 1]; ++e)
        result.col(s) += points_[e].value * of_nodes.col(points_[e].node);
    return result;
  }
  /// As Motion::velocities_of.
  Values velocities(const Values& impulses) const {
    const Values given = free_.cwiseProduct(on_nodes(impulses));
    Values result = given * mass_.cwiseInverse().asDiagonal();
    const Index most = *std::max_element(terms_.begin(), terms_.end());
    for (Index term = 1; term < most; ++term) {
      const Values before = result, seen = free_.cwiseProduct(before);
      for (Index k = 0; k < mass_.size(); ++k) {
        if (terms_[k] <= term) continue;
        Value drawn = pull_.col(k).cwiseProduct(before.col(k));
        for (std::size_t e = coupling_offsets_[k]; e < coupling_offsets_[k + 1]; ++e)
          drawn -= coupling_[e].value * seen.col(coupling_[e].node);
        result.col(k) = (given.col(k) + free_.col(k).cwiseProduct(drawn)) / mass_[k];
      }
    }
    return at_points(result);
  }

 private:
  struct Entry {
    Index node;
    double value;
  };
  /// The series is at most as many times D^-1 as it has terms.
  void find_bounds() {
    Vector sums = Vector::Zero(mass_.size());
    for (const auto& [node, value] : points_) sums[node] += std::abs(value);
    bounds_.setZero(size());
    for (Index s = 0; s < size(); ++s)
      for (std::size_t e = point_offsets_[s]; e < point_offsets_[s + 1]; ++e) {
        const auto& [node, value] = points_[e];
        bounds_[s] += static_cast<double>(terms_[node]) * std::abs(value) / mass_[node] * sums[node];
      }
  }

  std::vector<Index> nodes_, terms_;
  std::vector<std::size_t> point_offsets_{0}, coupling_offsets_{0};
  std::vector<Entry> points_, coupling_;
  Vector mass_, bounds_;
  Values free_, pull_;
};

/// The impulses that leave the least kinetic energy, of those that `project` lets be (accelerated projected gradients
/// with restarts: Nesterov 1983; O'Donoghue & Candes 2015; for contact Mazhar et al. 2015). `speeds`: those without
/// impulses; `impulses`: a first guess, and the result.
template <int R, class Project>
void stop(const Patch<R>& patch, const Points<R>& speeds, double largest, const Project& project, Points<R>& impulses) {
  Points<R> ahead = impulses;
  double theta = 1.0;
  for (int k = 0; k < most_iterations; ++k) {
    const Points<R> slope = speeds + patch.velocities(ahead);
    Points<R> next(R, patch.size());
    double left = 0.0, uphill = 0.0;
    for (Index s = 0; s < patch.size(); ++s) {
      next.col(s) = project(s, Vec<R>(ahead.col(s) - slope.col(s) / patch.bounds()[s]));
      const Vec<R> step = patch.bounds()[s] * (ahead.col(s) - next.col(s));
      left = std::max(left, step.norm());
      uphill += step.dot(next.col(s) - impulses.col(s));
    }
    const double before = uphill > 0.0 ? 1.0 : theta;
    theta = 0.5 * (1.0 + std::sqrt(1.0 + 4.0 * before * before));
    ahead = next + (uphill > 0.0 ? 0.0 : (before - 1.0) / theta) * (next - impulses);
    impulses = next;
    if (left <= tolerance * largest) break;
  }
}

}  // namespace

/// Points of surfaces, of all bodies that have such.
template <int Dim> void Motion<Dim>::take_surfaces(const std::vector<OtmBody<Dim>>& of) {
  if (!fixed) return;
  std::vector<Eigen::Triplet<double, Index>> entries;
  Index count = 0;
  surface_skin = std::numeric_limits<double>::infinity();
  for (std::size_t b = 0; b < of.size(); ++b) {
    if (!of[b].surface) continue;
    for (Index s = 0; s < of[b].surface->num_points(); ++s, ++count) {
      const ShapeRow<Dim> row = of[b].surface->row(s);
      double sum = 0.0;
      for (std::size_t k = 0; k < row.nodes.size(); ++k) {
        entries.emplace_back(count, bodies[b].first_node + row.nodes[k], row.N[k]);
        sum += std::abs(row.N[k]);
      }
      surface_reach = std::max(surface_reach, sum);
    }
    for (Index a = bodies[b].first_node; a < bodies[b + 1].first_node; ++a)
      surface_skin = std::min(surface_skin, wall_skin * spacing[a]);
  }
  surface_points.resize(count, static_cast<Index>(x.cols()));
  surface_points.setFromTriplets(entries.begin(), entries.end());
}

/// Points of surfaces within the skin of tools; found anew when nodes or tools have gone so far that others may get
/// there.
template <int Dim> void Motion<Dim>::find_near_tools() {
  if (looked.cols() != 0) {
    const double furthest = std::sqrt((x - looked).colwise().squaredNorm().maxCoeff());
    double travelled = 0.0;
    for (const Tool& tool : tools) travelled = std::max(travelled, tool.travelled);
    if (2.0 * (surface_reach * furthest + travelled) < surface_skin) return;
  }
  looked = x;
  const auto n = static_cast<Index>(surface_points.rows());
  std::vector<ToolGap<Dim>> gap(n);
  for (Tool& tool : tools) {
    parallel_for(n, [&](Index s) { gap[s] = gap_to<Dim>(tool.of, tool.now, at_surface_point(s, x)); });
    std::vector<Index> found;
    for (Index s = 0; s < n; ++s)
      if (gap[s].gap < surface_skin) found.push_back(s);
    Points<Dim> impulses = Points<Dim>::Zero(Dim, static_cast<Index>(found.size()));
    for (std::size_t k = 0; k < tool.near.size(); ++k) {
      const auto place = std::lower_bound(found.begin(), found.end(), tool.near[k]);
      if (place != found.end() && *place == tool.near[k])
        impulses.col(place - found.begin()) = tool.impulses.col(static_cast<Index>(k));
    }
    tool.near = std::move(found);
    tool.impulses = std::move(impulses);
    tool.travelled = 0.0;
  }
}

/// What values at the nodes come to at a point of a surface.
template <int Dim> Vec<Dim> Motion<Dim>::at_surface_point(Index s, const Points<Dim>& of) const {
  Vec<Dim> sum = Vec<Dim>::Zero();
  for (SparseRows::InnerIterator entry(surface_points, s); entry; ++entry) sum += entry.value() * of.col(entry.col());
  return sum;
}

/// Impulses on surfaces such that no point of them gets into the tool within the step, and those of friction, which
/// stop sliding as far as Coulomb's law lets them. What is normal and what is tangential do not depend on each other
/// where the tool is flat, as masses are the same along all axes.
template <int Dim> void Motion<Dim>::stop_surfaces(Tool& tool, double dt) {
  if (surface_points.rows() == 0) return;
  find_near_tools();
  if (tool.near.empty()) return;
  const auto n = static_cast<Index>(tool.near.size());
  Points<Dim> normals(Dim, n), at(Dim, n), speeds(Dim, n);
  Points<1> closing(1, n);
  for (Index k = 0; k < n; ++k) {
    at.col(k) = at_surface_point(tool.near[k], x);
    speeds.col(k) = at_surface_point(tool.near[k], v) - velocity_of<Dim>(tool.now, at.col(k));
    const ToolGap<Dim> gap = gap_to<Dim>(tool.of, tool.now, at.col(k));
    normals.col(k) = gap.normal;
    // What is inside comes out within a stable step, not at once where a step is cut short.
    closing(0, k) = gap.gap / (gap.gap < 0.0 ? std::max(dt, stable) : dt);
  }
  const auto along = [&](const Points<Dim>& of) { return Points<1>(normals.cwiseProduct(of).colwise().sum()); };
  const Points<1> approach = along(speeds) + closing;
  const double largest = -approach.minCoeff();
  if (largest <= 0.0) {
    tool.impulses.setZero();
    return;
  }
  Points<1> normal = along(tool.impulses);
  const Points<Dim> before = tool.impulses - normals * normal.asDiagonal();
  const Vec<Dim> one = normals.col(0);
  const bool is_flat = (normals.colwise() - one).isZero(0.0);
  std::optional<Patch<Dim>> patch;
  if (!is_flat || tool.of.friction > 0.0) patch.emplace(*this, tool.near, free);
  if (is_flat) {
    const Patch<1> flat(*this, tool.near, Points<1>(one.cwiseAbs2().transpose() * free));
    stop<1>(
        flat, approach, largest, [](Index, const Vec<1>& q) { return Vec<1>(q.cwiseMax(0.0)); }, normal);
  } else {
    Points<Dim> pushes = normals * normal.asDiagonal();
    stop<Dim>(
        *patch, normals * approach.asDiagonal(), largest,
        [&](Index s, const Vec<Dim>& q) { return Vec<Dim>(std::max(0.0, q.dot(normals.col(s))) * normals.col(s)); },
        pushes);
    normal = along(pushes);
  }
  tool.impulses = normals * normal.asDiagonal();
  if (tool.of.friction > 0.0) {
    Points<Dim> after = before;
    stop<Dim>(
        *patch, speeds - normals * along(speeds).asDiagonal(), largest,
        [&](Index s, const Vec<Dim>& q) {
          const Vec<Dim> held = q - q.dot(normals.col(s)) * normals.col(s);
          const double most = normal(0, s) > 0.0 ? tool.of.friction * normal(0, s) : 0.0, size = held.norm();
          return Vec<Dim>((size > most ? most / size : 1.0) * held);
        },
        after);
    tool.impulses += after;
  }
  Points<Dim> impulse = Points<Dim>::Zero(Dim, x.cols());
  for (Index k = 0; k < n; ++k) {
    Vec<Dim> pushes = Vec<Dim>::Zero();
    for (SparseRows::InnerIterator entry(surface_points, tool.near[k]); entry; ++entry) {
      const Vec<Dim> on_node = entry.value() * free.col(entry.col()).cwiseProduct(tool.impulses.col(k));
      impulse.col(entry.col()) += on_node;
      pushes += on_node;
    }
    contact_loss += pushes.dot(tool.mean_velocity(at.col(k)));
    tool.take(at.col(k), pushes);
  }
  v += velocities_of(impulse);
  nodal_momentum += impulse;
  contact_loss -= 0.5 * impulse.cwiseProduct(v + was).sum();
}

template struct Motion<2>;
template struct Motion<3>;

}  // namespace efree::internal
