// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/heatgeo/internal/panorama.hpp"

#include "efree/core/internal/infinity.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace efree {
namespace {

using internal::infinity;

/// Whether one of the planes between this side of the cube and the next keeps the triangle off it.
bool misses(const Vec<3>& a, const Vec<3>& b, const Vec<3>& c, int side) {
  const int axis = side / 2;
  const double sign = side % 2 ? 1.0 : -1.0, wa = sign * a[axis], wb = sign * b[axis], wc = sign * c[axis];
  for (int k = 1; k <= 2; ++k) {
    const int d = (axis + k) % 3;
    if ((wa < a[d] && wb < b[d] && wc < c[d]) || (wa < -a[d] && wb < -b[d] && wc < -c[d])) return true;
  }
  return false;
}

/// Part of the triangle that projects to one side of the cube: x = (along the side's axis, and the two after it).
class Clipped {
 public:
  Clipped(const Vec<3>& a, const Vec<3>& b, const Vec<3>& c, int side) {
    const int axis = side / 2;
    const double sign = side % 2 ? 1.0 : -1.0;
    const auto seen = [&](const Vec<3>& x) { return Vec<3>(sign * x[axis], x[(axis + 1) % 3], x[(axis + 2) % 3]); };
    points_[0] = seen(a), points_[1] = seen(b), points_[2] = seen(c);
    constexpr double wider = 1.0 + 1e-9;
    for (int d = 1; d <= 2; ++d)
      for (const double direction : {1.0, -1.0}) cut([&](const Vec<3>& x) { return wider * x[0] + direction * x[d]; });
  }
  bool empty() const { return size_ == 0; }
  /// Smallest box around it on the side.
  Eigen::AlignedBox2d box() const {
    Eigen::AlignedBox2d box;
    for (int k = 0; k < size_; ++k) {
      if (!(points_[k][0] > 0.0)) return {Eigen::Vector2d(-1.0, -1.0), Eigen::Vector2d(1.0, 1.0)};
      box.extend(Eigen::Vector2d(points_[k].tail<2>() / points_[k][0]));
    }
    return box;
  }

 private:
  template <class Height> void cut(const Height& height) {
    std::array<Vec<3>, 8> kept;
    int count = 0;
    for (int k = 0; k < size_; ++k) {
      const Vec<3>&x = points_[k], &y = points_[(k + 1) % size_];
      const double hx = height(x), hy = height(y);
      if (hx >= 0.0) kept[count++] = x;
      if ((hx >= 0.0) != (hy >= 0.0)) kept[count++] = x + hx / (hx - hy) * (y - x);
    }
    points_ = kept;
    size_ = count;
  }
  std::array<Vec<3>, 8> points_;
  int size_ = 3;
};

}  // namespace

Panorama::OnCube::OnCube(const Vec<3>& x) {
  const double ax = std::abs(x[0]), ay = std::abs(x[1]), az = std::abs(x[2]);
  const int axis = ax >= ay && ax >= az ? 0 : ay >= az ? 1 : 2;
  const double over = x[axis] != 0.0 ? 1.0 / std::abs(x[axis]) : 0.0;  // where another vertex lies at the source
  side = 2 * axis + (x[axis] > 0.0);
  u = x[axis == 2 ? 0 : axis + 1] * over;
  v = x[axis == 0 ? 2 : axis - 1] * over;
}

Panorama::Panorama(const SpatialSight& sight) : sight_(sight), corner_at_(sight.mesh().num_vertices(), -1) {}

Index Panorama::corner(Index v) {
  Index& at = corner_at_[v];
  if (at < 0) {
    at = static_cast<Index>(corners_.size());
    const Vec<3> x = sight_.mesh().vertex(v) - sight_.mesh().vertex(source_);
    corners_.push_back({v, x, x.norm(), OnCube(x), 0});
  }
  return at;
}

void Panorama::look(Index source, double radius) {
  for (const Corner& known : corners_) corner_at_[known.vertex] = -1;
  corners_.clear();
  screens_.clear();
  screen_corners_.clear();
  source_ = source;
  on_slit_ = false;
  const Vec<3> centre = sight_.mesh().vertex(source);
  const FineMesh<3>& mesh = sight_.mesh();
  const Index body = mesh.component()[source];
  sight_.for_each_facet_near(centre, radius, [&](const SpatialSight::PlacedFacet& placed) {
    if (placed.body != body) return;
    const SpatialSight::Facet& facet = placed.facet;
    const SpatialSight::Side side = sight_.side(facet, centre - placed.corner);
    if (side == SpatialSight::edge_on)
      for (const Index v : placed.corners)
        on_slit_ = on_slit_ || (v != source && (mesh.vertex(v) - centre).norm() <= sight_.tolerance());
    if (side != SpatialSight::outer) return;
    const std::array<Index, 3> at{corner(placed.corners[0]), corner(placed.corners[1]), corner(placed.corners[2])};
    for (const Index k : at) ++corners_[k].outer_facets;
    const Corner &a = corners_[at[0]], &b = corners_[at[1]], &c = corners_[at[2]];
    const double nearest =
        (1.0 - 1e-9) * std::max(-facet.normal.dot(a.x), std::min({a.distance, b.distance, c.distance}) - facet.longest);
    if (nearest >= radius) return;
    const double reach = std::max({a.distance, b.distance, c.distance}), rounding = 8.0 * sight_.tolerance();
    Screen& screen = screens_.emplace_back();
    screen_corners_.push_back(at);
    // From outside the corners turn to the left: changed in order, the normals point inwards.
    screen.edges.row(0) = b.x.cross(a.x);
    screen.edges.row(1) = c.x.cross(b.x);
    screen.edges.row(2) = a.x.cross(c.x);
    screen.depth = a.x.dot(c.x.cross(b.x)) + rounding * facet.longest * (facet.longest + reach);
    screen.nearest = nearest;
    screen.rim = rounding * reach;
  });
  sort_by_direction();
}

int Panorama::square(int side, double u, double v) const {
  const auto at = [&](double x) {
    return std::clamp(static_cast<int>(0.5 * (x + 1.0) * resolution_), 0, resolution_ - 1);
  };
  return (side * resolution_ + at(v)) * resolution_ + at(u);
}

template <class Emit>
void Panorama::for_each_square(const Corner& a, const Corner& b, const Corner& c, const Emit& emit) const {
  const auto cover = [&](int side, double u0, double u1, double v0, double v1) {
    constexpr double slack = 1e-9;
    const int low = square(side, u0 - slack, v0 - slack), high = square(side, u1 + slack, v1 + slack);
    const int width = (high - low) % resolution_;
    for (int row = low; row + width <= high; row += resolution_)
      for (int k = row; k <= row + width; ++k) emit(k);
  };
  // Seen from the source a triangle on one side of the cube is a triangle.
  const OnCube &pa = a.on_cube, &pb = b.on_cube, &pc = c.on_cube;
  if (pa.side == pb.side && pa.side == pc.side)
    return cover(pa.side, std::min({pa.u, pb.u, pc.u}), std::max({pa.u, pb.u, pc.u}), std::min({pa.v, pb.v, pc.v}),
                 std::max({pa.v, pb.v, pc.v}));
  for (int side = 0; side < 6; ++side) {
    if (misses(a.x, b.x, c.x, side)) continue;
    const Clipped part(a.x, b.x, c.x, side);
    if (part.empty()) continue;
    const auto box = part.box();
    cover(side, box.min()[0], box.max()[0], box.min()[1], box.max()[1]);
  }
}

void Panorama::sort_by_direction() {
  if (screens_.empty()) return;
  resolution_ = std::clamp(static_cast<int>(std::sqrt(0.25 * static_cast<double>(screens_.size()))), 4, 64);
  const int squares = 6 * resolution_ * resolution_;
  begin_.assign(squares + 1, 0);
  nearest_.assign(squares, infinity);
  covered_.clear();
  for (std::size_t k = 0; k < screens_.size(); ++k) {
    const auto& at = screen_corners_[k];
    for_each_square(corners_[at[0]], corners_[at[1]], corners_[at[2]], [&](int square) {
      covered_.push_back({square, static_cast<Index>(k)});
      ++begin_[square];
      nearest_[square] = std::min(nearest_[square], screens_[k].nearest);
    });
  }
  std::partial_sum(begin_.begin(), begin_.end(), begin_.begin());
  items_.resize(covered_.size());
  for (const auto& [square, screen] : covered_) items_[--begin_[square]] = screen;
}

Panorama::Cut Panorama::cut(const Vec<3>& line, double distance) const {
  const OnCube at(line);
  const int toward = square(at.side, at.u, at.v);
  Cut found = Cut::none;
  if (distance <= nearest_[toward]) return found;
  for (Index k = begin_[toward]; k < begin_[toward + 1]; ++k) {
    const Screen& screen = screens_[items_[k]];
    if (distance <= screen.nearest) continue;
    const Vec<3> over = screen.edges * line;
    const double least = over.minCoeff(), rim = screen.rim * distance;
    if (least < -rim || over.sum() <= screen.depth) continue;
    if (least > rim) return Cut::inside;
    found = Cut::rim;
  }
  return found;
}

bool Panorama::shows(Index v, const Vec<3>& line, double distance) const {
  const Cut found = screens_.empty() ? Cut::none : cut(line, distance);
  if (found == Cut::inside) return false;
  if (found == Cut::rim || on_slit_) return sight_.sees(v, source_);
  // The line arrives from inside where no facet at v turns its outer side to it, and from outside where all do.
  if (corner_at_[v] < 0) return true;
  const FineMesh<3>& mesh = sight_.mesh();
  return corners_[corner_at_[v]].outer_facets < static_cast<Index>(mesh.facets_of(v).size()) &&
         sight_.begins_inside(v, mesh.vertex(source_));
}

}  // namespace efree
