// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/internal/lattice_points.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>

namespace efree::internal {
namespace {

/// A feature that crosses an edge between two points of another region draws the nearer one in, if it begins within
/// this part of the edge; the point then goes into the middle of the feature, but not farther than the second number.
constexpr double reach = 0.2, farthest = 0.35;
/// Part of its volume that a tetrahedron of the lattice keeps when its corners are drawn into features.
constexpr double kept_volume = 0.5;

}  // namespace

LatticePoints::LatticePoints(const LabelImage<3>& image, const ImageMeshOptions& options)
    : LatticeGrid(image, options) {
  label_points();
  draw_in_points();
}

void LatticePoints::cut_edges_and_snap() {
  cut_edges();
  snap_points();
}

// --- regions of points -----------------------------------------------------------------------------------------------

void LatticePoints::label_points() {
  label_.resize(num_points_);
  for_each_plane([&](Index k) {
    for_each_point(k, [&](const std::array<Index, 3>& at, std::size_t point) { label_[point] = region_of(at); });
  });
}

Label LatticePoints::region_of(const std::array<Index, 3>& at) const {
  const Vec<3> u = place(at);
  const Label region = field_(u);
  if (!image_.grey.empty()) return region;
  for (int d = 0; d < 3; ++d) {
    const Index above = static_cast<Index>(u[d]);
    if (at[d] == 0 || at[d] == cubes_[d] || u[d] != above) continue;
    std::array<Index, 3> low, high;
    for (int e = 0; e < 3; ++e) {
      const Index next = static_cast<Index>(u[e] + 0.5);
      low[e] = std::max(next - 1, 0);
      high[e] = std::min(next, image_.size[e] - 1);
    }
    const auto side = [&](Index layer) -> int {  // its region, if it is one
      std::array<Index, 3> voxel;
      int found = -1;
      for (int c = 0; c < 4; ++c) {
        voxel[d] = layer;
        voxel[(d + 1) % 3] = (c & 1 ? high : low)[(d + 1) % 3];
        voxel[(d + 2) % 3] = (c & 2 ? high : low)[(d + 2) % 3];
        const int code = field_.at(voxel);
        if (found >= 0 && found != code) return -1;
        found = code;
      }
      return found;
    };
    const int below_region = side(above - 1), above_region = side(above);
    if (below_region < 0 || above_region < 0 || below_region == above_region) continue;
    const Index farthest_layer = static_cast<Index>(std::ceil(static_cast<double>(image_.size[d]) / cubes_[d]));
    const auto run = [&](Index layer, Index step, int of) {
      Index length = 0;
      while (length <= farthest_layer && layer >= 0 && layer < image_.size[d] && side(layer) == of)
        ++length, layer += step;
      return layer < 0 || layer >= image_.size[d] ? farthest_layer + 1 : length;  // the frame has points of its own
    };
    const Index run_below = run(above - 1, -1, below_region), run_above = run(above, 1, above_region);
    if (run_below != run_above) return static_cast<Label>(run_below < run_above ? below_region : above_region);
  }
  return region;
}

Label LatticePoints::region_inside(std::size_t cube, const KuhnTet& tet) const {
  Vec<3> sum = Vec<3>::Zero();
  for (const std::uint8_t corner : tet.corner) sum += position(cube + offset_[corner]);
  return field_(0.25 * sum);
}

// --- thin features draw points in ------------------------------------------------------------------------------------

std::vector<std::uint8_t> LatticePoints::mixed_cubes() const {
  std::vector<std::uint8_t> mixed(num_points_, 0);
  std::array<std::vector<std::array<Index, 2>>, 3> voxels;  // by cube along an axis, those that the field is made of
  for (int d = 0; d < 3; ++d)
    for (Index i = 0; i < cubes_[d]; ++i)
      voxels[d].push_back(
          {std::max(static_cast<Index>(coordinate(d, i) + 0.5) - 1, 0),
           std::min(static_cast<Index>(coordinate(d, i + 1) + 0.5), static_cast<Index>(image_.size[d] - 1))});
  const std::size_t row = image_.size[0], layer = row * image_.size[1];
  for_each_layer(cubes_[2], stride_[2], [&](Index k) {
    std::vector<std::array<Label, 2>> range(image_.size[0]);  // least and largest label of columns of voxels
    for (Index j = 0; j < cubes_[1]; ++j) {
      for (auto& [low, high] : range) low = on_boundary, high = 0;
      for (Index z = voxels[2][k][0]; z <= voxels[2][k][1]; ++z)
        for (Index y = voxels[1][j][0]; y <= voxels[1][j][1]; ++y) {
          const Label* const labels = image_.labels.data() + y * row + z * layer;
          for (std::size_t x = 0; x < row; ++x) {
            range[x][0] = std::min(range[x][0], labels[x]);
            range[x][1] = std::max(range[x][1], labels[x]);
          }
        }
      for (Index i = 0; i < cubes_[0]; ++i) {
        Label low = on_boundary, high = 0;
        for (Index x = voxels[0][i][0]; x <= voxels[0][i][1]; ++x) {
          low = std::min(low, range[x][0]);
          high = std::max(high, range[x][1]);
        }
        mixed[i + j * stride_[1] + k * stride_[2]] = low != high;
      }
    }
  });
  return mixed;
}

void LatticePoints::draw_in_points() {
  flags_.assign(num_points_, 0);
  moved_.resize(static_cast<std::size_t>(cubes_[2]) + 1);
  const auto mixed = mixed_cubes();
  move([&](const std::array<Index, 3>& at, std::size_t point) { return drawn_in(at, point, mixed); });
  let_go();
}

template <class Where> void LatticePoints::move(const Where& where) {
  std::vector<std::vector<Moved>> found(moved_.size());
  for_each_plane([&](Index k) {
    for_each_point(k, [&](const std::array<Index, 3>& at, std::size_t point) {
      if (flags_[point] != 0) return;
      if (std::optional<Moved> moved = where(at, point)) found[k].push_back(*moved);
    });
  });
  for_each_plane([&](Index k) {
    for (const Moved& moved : found[k]) {
      flags_[moved.point] = moved_now;
      label_[moved.point] = moved.region;
    }
    const auto middle = static_cast<std::ptrdiff_t>(moved_[k].size());
    moved_[k].insert(moved_[k].end(), found[k].begin(), found[k].end());
    std::ranges::inplace_merge(moved_[k], moved_[k].begin() + middle, {}, &Moved::point);
  });
}

void LatticePoints::let_go() {
  for (bool again = true; again;) {
    std::vector<std::vector<std::size_t>> back(moved_.size());
    for_each_plane([&](Index k) {
      for (const Moved& moved : moved_[k])
        if (squeezes(moved.point)) back[k].push_back(moved.point);
    });
    again = false;
    for (const auto& plane : back)
      for (const std::size_t point : plane) {
        flags_[point] = 0;
        again = true;
      }
    for (auto& plane : moved_) std::erase_if(plane, [&](const Moved& moved) { return flags_[moved.point] == 0; });
  }
}

std::optional<LatticePoints::Moved> LatticePoints::drawn_in(const std::array<Index, 3>& at, std::size_t point,
                                                            const std::vector<std::uint8_t>& mixed) const {
  const unsigned up = upward(at), down = downward(at), inside = up & down;
  const Label own = label_[point];
  const Vec<3> from = place(at);
  std::optional<Moved> best;
  double least = std::numeric_limits<double>::infinity();
  const auto try_edge = [&](unsigned axes, double sign, std::size_t other, std::size_t cube) {
    if ((axes & inside) != axes || mixed[cube] == 0 || label_[other] != own) return;
    const Vec<3> along = sign * edge(axes);
    const auto region = [&](double t) { return field_(from + t * along); };
    constexpr double step = reach / 2.0;
    double begin = step;
    while (begin < reach + step && region(begin) == own) begin += step;
    if (!(begin < reach + step)) return;
    const Label found = region(begin);
    double before = begin - step, end = begin + step;
    for (int n = 0; n < 6; ++n) {
      const double middle = 0.5 * (before + begin);
      (region(middle) == found ? begin : before) = middle;
    }
    while (end < 1.0 && region(end) == found) end += step;
    for (double after = end - step; end - after > 0.01;) {
      const double middle = 0.5 * (after + end);
      (region(middle) == found ? after : end) = middle;
    }
    // The other end is nearer, or just as near and first.
    if (begin > reach || begin > 1.0 - end || (begin == 1.0 - end && sign < 0.0)) return;
    const double t = std::min(0.5 * (begin + end), farthest), length = t * std::sqrt(std::popcount(axes));
    if (!(begin < t) || length >= least) return;
    const Vec<3> to = from + t * along;
    if (is_bulge(to, along, found)) return;
    least = length;
    best = Moved{point, to, found};
  };
  for (unsigned axes = 1; axes < 8; ++axes) {
    if ((axes & up) == axes) try_edge(axes, 1.0, point + offset_[axes], point);
    if ((axes & down) == axes) try_edge(axes, -1.0, point - offset_[axes], point - offset_[axes]);
  }
  return best;
}

bool LatticePoints::is_bulge(const Vec<3>& u, const Vec<3>& along, Label region) const {
  Vec<3> side = along.cross(along.cwiseAbs().x() < along.cwiseAbs().y() ? Vec<3>::UnitX() : Vec<3>::UnitY());
  for (int turn = 0; turn < 2; ++turn) {
    side *= snap * edge(7).minCoeff() / side.norm();
    if ((field_(u + side) == region) != (field_(u - side) == region)) return true;
    side = along.cross(side);
  }
  return false;
}

bool LatticePoints::squeezes(std::size_t point) const {
  const auto at = unpacked(point);
  const unsigned up = upward(at), down = downward(at);
  const double whole = edge(7).prod();
  for (const auto& [number, own, next] : kuhn_star().tets) {
    const KuhnTet& tet = kuhn_tets()[number];
    const unsigned below = tet.corner[own];
    if ((below & down) != below || ((7 ^ below) & up) != (7 ^ below)) continue;
    Mat<3> edges;
    const Vec<3> first = position(point - offset_[below]);
    for (int i = 1; i < 4; ++i) edges.col(i - 1) = position(point - offset_[below] + offset_[tet.corner[i]]) - first;
    if ((tet.is_odd ? -1.0 : 1.0) * edges.determinant() < kept_volume * whole) return true;
  }
  return false;
}

// --- where edges are cut ---------------------------------------------------------------------------------------------

double LatticePoints::cut(const Vec<3>& u, const Vec<3>& along, Label a, Label b) const {
  double low = 0.0, high = 1.0, lead_low = 0.0, lead_high = 0.0;
  for (int step = 0; step < 11; ++step) {
    const double middle = 0.5 * (low + high), lead = field_.lead(u + middle * along, a, b);
    if (lead > 0.0)
      low = middle, lead_low = lead;
    else
      high = middle, lead_high = lead;
  }
  if (low == 0.0 || high == 1.0) return low == 0.0 ? 0.0 : 1.0;
  return low + (high - low) * lead_low / (lead_low - lead_high);
}

void LatticePoints::cut_edges() {
  cut_mask_.resize(num_points_);
  first_.resize(num_points_);
  cuts_.resize(static_cast<std::size_t>(cubes_[2]) + 1);
  for_each_plane([&](Index k) {
    for_each_point(k, [&](const std::array<Index, 3>& at, std::size_t point) {
      const unsigned up = upward(at);
      const Label own = label_[point];
      unsigned mask = 0;
      first_[point] = static_cast<Index>(cuts_[k].size());
      for (unsigned axes = 1; axes < 8; ++axes) {
        if ((axes & up) != axes) continue;
        const std::size_t other = point + offset_[axes];
        if (label_[other] == own) continue;
        mask |= 1u << axes;
        const Vec<3> from = position(at, point);
        cuts_[k].push_back(static_cast<float>(cut(from, position(other) - from, own, label_[other])));
      }
      cut_mask_[point] = static_cast<std::uint8_t>(mask);
    });
  });
}

// --- points near a boundary go there ---------------------------------------------------------------------------------

void LatticePoints::snap_points() {
  for (auto& flag : flags_) flag = std::min(flag, moved_before);
  move([&](const std::array<Index, 3>& at, std::size_t point) -> std::optional<Moved> {
    const auto moved = settled(at, point);
    return moved && moved->region != on_boundary ? moved : std::nullopt;
  });
  let_go();
  cut_again();
  move([&](const std::array<Index, 3>& at, std::size_t point) -> std::optional<Moved> {
    const auto moved = settled(at, point);
    return moved && moved->region == on_boundary ? moved : std::nullopt;
  });
}

void LatticePoints::cut_again() {
  for_each_plane([&](Index k) {
    for_each_point(k, [&](const std::array<Index, 3>& at, std::size_t point) {
      float* next = cuts_[k].data() + first_[point];
      for (unsigned mask = cut_mask_[point]; mask != 0; mask &= mask - 1, ++next) {
        const std::size_t other = point + offset_[std::countr_zero(mask)];
        if (flags_[point] != moved_now && flags_[other] != moved_now) continue;
        const Vec<3> from = position(at, point);
        *next = static_cast<float>(cut(from, position(other) - from, label_[point], label_[other]));
      }
    });
  });
}

std::optional<LatticePoints::Moved> LatticePoints::settled(const std::array<Index, 3>& at, std::size_t point) const {
  struct Cut {
    double t;
    Vec<3> along;
  };
  std::array<Cut, 14> cuts;
  int count = 0, nearest = -1;
  double distance = 0.0;
  const unsigned up = upward(at), down = downward(at), inside = up & down;
  const Vec<3> from = place(at);
  const auto add = [&](double t, unsigned axes, std::size_t other) {
    cuts[count] = {t, position(other) - from};
    const double length = t * std::sqrt(std::popcount(axes));
    // What is on the frame stays there.
    if (t < snap && (axes & inside) == axes && (nearest < 0 || length < distance)) {
      nearest = count;
      distance = length;
    }
    ++count;
  };
  for (unsigned axes = 1; axes < 8; ++axes) {
    if (cut_mask_[point] >> axes & 1) add(cut_of(point, axes), axes, point + offset_[axes]);
    if ((axes & down) == axes && (cut_mask_[point - offset_[axes]] >> axes & 1))
      add(1.0 - cut_of(point - offset_[axes], axes), axes, point - offset_[axes]);
  }
  if (nearest < 0) return std::nullopt;
  const Label own = label_[point];
  const Vec<3> to = from + cuts[nearest].t * cuts[nearest].along, shift = snap * cuts[nearest].along;
  for (int c = 0; c < count; ++c) {
    if (cuts[c].t < snap) continue;
    const Vec<3> middle = 0.5 * (to + from + cuts[c].t * cuts[c].along);
    if (field_(middle + shift) == own || field_(middle - shift) != own)
      return away(point, from, cuts[nearest].along, cuts[nearest].t);
  }
  return Moved{point, to, on_boundary};
}

std::optional<LatticePoints::Moved> LatticePoints::away(std::size_t point, const Vec<3>& from, const Vec<3>& along,
                                                        double t) const {
  const Label own = label_[point];
  const double wanted = (snap - t) / (1.0 - snap);
  double inside = 0.0, outside = 2.0 * wanted + t;
  if (field_(from - outside * along) == own) return Moved{point, from - wanted * along, own};
  for (int step = 0; step < 6; ++step) {
    const double middle = 0.5 * (inside + outside);
    (field_(from - middle * along) == own ? inside : outside) = middle;
  }
  if (!(inside > t)) return std::nullopt;
  return Moved{point, from - 0.5 * (inside - t) * along, own};
}

}  // namespace efree::internal
