// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/heatgeo/marching_3d.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>

namespace efree {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

}  // namespace

SpatialSight::SpatialSight(const FineMesh<3>& mesh) : mesh_(mesh), tolerance_(length_tolerance(mesh)) {
  std::vector<Index> around;
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    around.clear();
    for (Index c : mesh.cells_of(v))
      for (Index w : mesh.cells().col(c))
        if (w != v) around.push_back(w);
    std::sort(around.begin(), around.end());
    around.erase(std::unique(around.begin(), around.end()), around.end());
    neighbours_.items.insert(neighbours_.items.end(), around.begin(), around.end());
    neighbours_.close_row();
  }
}

double SpatialSight::side(Index c, int i, const Vec<3>& x) const {
  const auto& cell = mesh_.cells();
  const Vec<3> a = mesh_.vertex(cell((i + 1) % 4, c)), b = mesh_.vertex(cell((i + 2) % 4, c)) - a,
               d = mesh_.vertex(cell((i + 3) % 4, c)) - a;
  const double height = b.cross(d).dot(x - a);
  return i % 2 == 0 ? -height : height;
}

/// Whether x lies on the far side of that facet, by more than rounding.
bool SpatialSight::beyond(Index c, int i, const Vec<3>& x) const {
  const auto& cell = mesh_.cells();
  const Vec<3> a = mesh_.vertex(cell((i + 1) % 4, c)), b = mesh_.vertex(cell((i + 2) % 4, c)) - a,
               d = mesh_.vertex(cell((i + 3) % 4, c)) - a, normal = b.cross(d), arm = x - a;
  const double height = i % 2 == 0 ? -normal.dot(arm) : normal.dot(arm);
  if (height >= 0.0) return false;
  const double longest = std::max(b.norm(), d.norm());
  return -height > 4.0 * tolerance_ * longest * (longest + arm.norm());
}

SpatialSight::Start SpatialSight::start(Index v, const Vec<3>& x) const {
  for (Index c : mesh_.cells_of(v)) {
    const auto cell = mesh_.cells().col(c);
    const int corner = cell[0] == v ? 0 : cell[1] == v ? 1 : cell[2] == v ? 2 : 3;
    bool inside = true;
    for (int i = 0; i < 4 && inside; ++i) inside = i == corner || !beyond(c, i, x);
    if (!inside) continue;
    // On the plane of a facet, in front of it or behind: the facet opposite v must be ahead, or x in the cell.
    const Vec<3> ahead = mesh_.vertex(v) + 0.5 * mesh_.size() / (x - mesh_.vertex(v)).norm() * (x - mesh_.vertex(v));
    if (side(c, corner, mesh_.vertex(v)) > side(c, corner, ahead)) return {c, corner};
  }
  return {};
}

bool SpatialSight::reaches(Start from, Index target) const {
  const Vec<3> x = mesh_.vertex(target);
  const Vec<3> start = mesh_.vertex(mesh_.cells()(from.corner, from.cell));
  Index cell = from.cell;
  Index behind = -1;
  // Much longer than any line through cells of one size; lines that circle an edge by rounding end here, unseen.
  for (int step = 0; step < 10000; ++step) {
    const auto corners = mesh_.cells().col(cell);
    if ((corners.array() == target).any()) return true;
    // Leave by the first facet that has the target on its far side.
    int exit = -1;
    double first = infinity;
    for (int i = 0; i < 4; ++i) {
      if (mesh_.neighbour(i, cell) == behind && behind >= 0) continue;
      if (!beyond(cell, i, x)) continue;
      const double here = side(cell, i, start), there = side(cell, i, x);
      const double at = here / (here - there);  // along the line, 0 at its start; there < 0
      if (at < first || exit < 0) first = at, exit = i;
    }
    if (exit < 0) return false;  // a twin of the target across a slit
    const Index next = mesh_.neighbour(exit, cell);
    if (next < 0) return false;
    behind = cell;
    cell = next;
  }
  return false;
}

Horizon::Horizon() : bounds_(6 * resolution * resolution) {
  for (int side = 0; side < 6; ++side)
    for (int j = 0; j < resolution; ++j)
      for (int i = 0; i < resolution; ++i) {
        Vec<3> middle;
        middle[side / 2] = side % 2 ? 1.0 : -1.0;
        middle[(side / 2 + 1) % 3] = (2.0 * i + 1.0) / resolution - 1.0;
        middle[(side / 2 + 2) % 3] = (2.0 * j + 1.0) / resolution - 1.0;
        directions_.push_back(middle.normalized());
      }
}

namespace {

/// Side of the cube around the origin that x projects to, and where on it, in [-1, 1]^2.
struct OnCube {
  int side;
  double u, v;

  explicit OnCube(const Vec<3>& x) {
    int axis = 0;
    const double longest = x.cwiseAbs().maxCoeff(&axis);
    side = 2 * axis + (x[axis] > 0.0);
    u = x[(axis + 1) % 3] / longest;
    v = x[(axis + 2) % 3] / longest;
  }
};

int square_of(double at, int resolution) {
  return std::clamp(static_cast<int>(0.5 * (at + 1.0) * resolution), 0, resolution - 1);
}

}  // namespace

void Horizon::look(const FineMesh<3>& mesh, const Patch<3>& patch) {
  const Vec<3> source = mesh.vertex(patch.source);
  const double tolerance = length_tolerance(mesh);
  std::fill(bounds_.begin(), bounds_.end(), infinity);
  blind_ = false;
  for (Index f : patch.facets) {
    const auto facet = mesh.facets().col(f);
    for (Index v : facet)
      blind_ = blind_ || (v != patch.source && (mesh.vertex(v) - source).cwiseAbs().maxCoeff() <= tolerance);
    if (shows_outer_side<3>(mesh, f, source, tolerance))
      lower(mesh.vertex(facet[0]) - source, mesh.vertex(facet[1]) - source, mesh.vertex(facet[2]) - source);
  }
}

/// Lowers the bounds in all directions of the triangle to a little less than its distance.
void Horizon::lower(const Vec<3>& a, const Vec<3>& b, const Vec<3>& c) {
  const Vec<3> normal = (b - a).cross(c - a).normalized();
  const double nearest_corner = std::min({a.norm(), b.norm(), c.norm()});
  const double longest = std::max({(b - a).norm(), (c - b).norm(), (a - c).norm()});
  const double distance = (1.0 - 1e-9) * std::max(std::abs(normal.dot(a)), nearest_corner - longest);
  const OnCube pa(a), pb(b), pc(c);
  if (pa.side == pb.side && pa.side == pc.side) {
    // Seen from the centre a triangle on one side of the cube is a triangle.
    const double slack = 1e-9;
    const int i0 = square_of(std::min({pa.u, pb.u, pc.u}) - slack, resolution),
              i1 = square_of(std::max({pa.u, pb.u, pc.u}) + slack, resolution),
              j0 = square_of(std::min({pa.v, pb.v, pc.v}) - slack, resolution),
              j1 = square_of(std::max({pa.v, pb.v, pc.v}) + slack, resolution);
    for (int j = j0; j <= j1; ++j)
      for (int i = i0; i <= i1; ++i) {
        double& bound = bounds_[(pa.side * resolution + j) * resolution + i];
        bound = std::min(bound, distance);
      }
    return;
  }
  // A cone around the triangle, wider by half the diagonal of a square.
  const Vec<3> axis = (a.normalized() + b.normalized() + c.normalized()).normalized();
  const double angle =
      std::acos(std::clamp(std::min({axis.dot(a.normalized()), axis.dot(b.normalized()), axis.dot(c.normalized())}),
                           -1.0, 1.0)) +
      std::sqrt(2.0) / resolution + 1e-9;
  // Wider than a half space, or through the source: in every direction.
  const double cosine = angle < 1.5 && axis.allFinite() ? std::cos(angle) : -2.0;
  for (std::size_t k = 0; k < bounds_.size(); ++k)
    if (cosine < -1.0 || directions_[k].dot(axis) >= cosine) bounds_[k] = std::min(bounds_[k], distance);
}

bool Horizon::in_sight(const Vec<3>& line, double distance) const {
  if (blind_) return false;
  const OnCube at(line);
  return distance <=
         bounds_[(at.side * resolution + square_of(at.v, resolution)) * resolution + square_of(at.u, resolution)];
}

SpatialMarching::SpatialMarching(const SpatialSight& sight)
    : sight_(sight), distance_(sight.mesh().num_vertices(), infinity), origin_(sight.mesh().num_vertices(), -1) {}

void SpatialMarching::clear(double radius) {
  for (Index v : reached_) distance_[v] = infinity;
  reached_.clear();
  radius_ = radius;
}

void SpatialMarching::march(const Patch<3>& patch) {
  const FineMesh<3>& mesh = sight_.mesh();
  clear(patch.radius);
  horizon_.look(mesh, patch);
  hidden_.clear();
  const Vec<3> source = mesh.vertex(patch.source);
  reach(patch.source, 0.0, patch.source);
  for (std::size_t k = 1; k < patch.vertices.size(); ++k) {
    const Index v = patch.vertices[k];
    const double distance = patch.distances[k];
    if (distance >= radius_) continue;
    if (horizon_.in_sight(mesh.vertex(v) - source, distance))
      reach(v, distance, patch.source);
    else
      hidden_.push_back(v);
  }
  // The march begins where what is in sight ends.
  for (Index v : hidden_)
    for (Index w : sight_.neighbours(v))
      if (distance_[w] < infinity && origin_[w] == patch.source) front_.push_back({distance_[w], w});
  std::ranges::sort(front_, [](const Front& a, const Front& b) { return b < a; });
  const auto same = std::ranges::unique(front_, {}, &Front::vertex);
  front_.erase(same.begin(), same.end());
  std::make_heap(front_.begin(), front_.end());
  spread();
}

void SpatialMarching::march(std::span<const Index> sources, double radius) {
  clear(radius);
  for (Index s : sources) offer(s, 0.0, s);
  spread();
}

void SpatialMarching::spread() {
  const FineMesh<3>& mesh = sight_.mesh();
  while (!front_.empty()) {
    std::pop_heap(front_.begin(), front_.end());
    const auto [distance, a] = front_.back();
    front_.pop_back();
    if (distance > distance_[a]) continue;
    const Index origin = origin_[a];
    const double before = distance_[origin];
    const bool may_bend = origin == a || mesh.on_boundary(a);
    for (Index v : sight_.neighbours(a)) {
      const double straight = before + (mesh.vertex(v) - mesh.vertex(origin)).norm();
      if (straight >= distance_[v] - sight_.tolerance() || straight >= radius_) continue;  // bends are longer still
      if (origin == a || sees(v, origin)) {
        offer(v, straight, origin);
      } else if (may_bend || distance_[v] == infinity) {
        // Paths bend at the boundary; inside only where nothing better has come yet.
        offer(v, distance + (mesh.vertex(v) - mesh.vertex(a)).norm(), a);
      }
    }
  }
}

/// Whether nothing lies between v and the origin. Where the facet through which the line leaves v's cells is in sight
/// of the origin the line is taken to be free: only a spike thinner than that facet could be in the way.
bool SpatialMarching::sees(Index v, Index origin) const {
  const FineMesh<3>& mesh = sight_.mesh();
  const auto start = sight_.start(v, mesh.vertex(origin));
  if (start.cell < 0) return false;
  bool facet_in_sight = true;
  for (int i = 0; i < 4 && facet_in_sight; ++i) {
    const Index w = mesh.cells()(i, start.cell);
    facet_in_sight = i == start.corner || w == origin || (distance_[w] < infinity && origin_[w] == origin);
  }
  return facet_in_sight || sight_.reaches(start, origin);
}

void SpatialMarching::reach(Index v, double distance, Index origin) {
  if (distance_[v] == infinity) reached_.push_back(v);
  distance_[v] = distance;
  origin_[v] = origin;
}

void SpatialMarching::offer(Index v, double distance, Index origin) {
  // Differences of rounding size would only send the same front around again.
  if (distance >= radius_ || distance >= distance_[v] - sight_.tolerance()) return;
  reach(v, distance, origin);
  front_.push_back({distance, v});
  std::push_heap(front_.begin(), front_.end());
}

}  // namespace efree
