// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/lattice_mesh.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/disjoint_sets.hpp"
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/mesh/internal/bodies.hpp"
#include "efree/geometry/meshing/internal/image_field.hpp"
#include "efree/geometry/meshing/internal/image_regions.hpp"
#include "efree/geometry/meshing/internal/kuhn.hpp"

#include <fmt/format.h>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

namespace efree {
namespace {

using internal::first_cell_bit;
using internal::first_edge_bit;
using internal::first_face_bit;
using internal::ImageField;
using internal::kuhn_faces;
using internal::kuhn_star;
using internal::kuhn_tets;
using internal::KuhnTet;
using internal::num_bits;
using internal::Subdivision;

/// In place of a region: the point has been moved onto a boundary.
constexpr Label on_boundary = std::numeric_limits<Label>::max();
/// A cut nearer than this to an end of its edge, in parts of it, takes that end along, or stays away so far.
constexpr double snap = 0.2;
/// A feature that crosses an edge between two points of another region draws the nearer one in, if it begins within
/// this part of the edge; the point then goes into the middle of the feature, but not farther than the second number.
constexpr double reach = 0.2, farthest = 0.35;
/// Part of its volume that a tetrahedron of the lattice keeps when its corners are drawn into features.
constexpr double kept_volume = 0.5;
/// Points in which three or four regions meet keep this far from the sides of their faces and cells (barycentric).
constexpr double junction_margin = 0.15;

constexpr std::array<const char*, 7> group_names{"left", "right", "front", "back", "bottom", "top", "pores"};
constexpr int pores = 6;

class LatticeMesher {
 public:
  LatticeMesher(const LabelImage<3>& image, const ImageMeshOptions& options)
      : image_(image), regions_(internal::image_regions(image, options)), field_(image, regions_, true) {
    if (!image.grey.empty() && regions_.names.size() > 1)
      throw InputError(
          fmt::format("image: grey values of an image with {} regions, expected one", regions_.names.size()));
    if (regions_.names.size() + 1 >= on_boundary)
      throw InputError(fmt::format("image: {} regions, at most {} fit", regions_.names.size(), on_boundary - 2));
    double points = 1.0, cubes = 1.0;
    std::array<double, 3> counts;
    for (int d = 0; d < 3; ++d) {
      counts[d] = std::max(1.0, std::round(image.size[d] * image.spacing[d] / options.size));
      points *= counts[d] + 1.0;
      cubes *= counts[d];
    }
    double material = 0.0;
    for (const LabelCount& count : count_labels(image))
      if (count.label != 0) material += static_cast<double>(count.pixels);
    material /= static_cast<double>(image.labels.size());
    const std::string what = fmt::format("image: meshing {} x {} x {} voxels with a size of {}", image.size[0],
                                         image.size[1], image.size[2], options.size);
    require_memory(16.0 * points + 300.0 * cubes * material, what, "take a larger size");
    if (points > largest_index)
      throw InputError(
          fmt::format("{} takes a lattice of {:.3g} points, at most {} can be numbered; take a larger size", what,
                      points, largest_index));
    for (int d = 0; d < 3; ++d) cubes_[d] = static_cast<Index>(counts[d]);
    stride_ = {1, static_cast<std::size_t>(cubes_[0]) + 1,
               (static_cast<std::size_t>(cubes_[0]) + 1) * (static_cast<std::size_t>(cubes_[1]) + 1)};
    num_points_ = stride_[2] * (static_cast<std::size_t>(cubes_[2]) + 1);
    for (std::size_t corner = 0; corner < 8; ++corner)
      offset_[corner] = (corner & 1) * stride_[0] + (corner >> 1 & 1) * stride_[1] + (corner >> 2) * stride_[2];
  }

  LatticeMesh make() {
    label_points();
    draw_in_points();
    LatticeMesh out;
    find_lost(out.lost);
    cut_edges();
    snap_points();
    number_vertices();
    place_vertices(out);
    make_cells(out);
    find_broken(out);
    for (int d = 0; d < 3; ++d) {
      out.lattice.origin[d] = image_.origin[d];
      out.lattice.spacing[d] = image_.spacing[d] * image_.size[d] / cubes_[d];
    }
    out.lattice.cubes = cubes_;
    out.mesh.region_names = regions_.names;
    return out;
  }

 private:
  static constexpr double largest_index = std::numeric_limits<Index>::max();

  // --- the lattice ---------------------------------------------------------------------------------------------------

  /// In voxels; exact on the frame.
  double coordinate(int d, Index i) const {
    return static_cast<double>(static_cast<std::int64_t>(i) * image_.size[d]) / cubes_[d];
  }
  Vec<3> place(const std::array<Index, 3>& at) const {
    return {coordinate(0, at[0]), coordinate(1, at[1]), coordinate(2, at[2])};
  }
  std::array<Index, 3> unpacked(std::size_t point) const {
    return {static_cast<Index>(point % stride_[1]), static_cast<Index>(point % stride_[2] / stride_[1]),
            static_cast<Index>(point / stride_[2])};
  }
  /// Voxels along the edge of the cubes that goes along the axes of a mask.
  Vec<3> edge(unsigned axes) const {
    Vec<3> out = Vec<3>::Zero();
    for (int d = 0; d < 3; ++d)
      if (axes >> d & 1) out[d] = static_cast<double>(image_.size[d]) / cubes_[d];
    return out;
  }
  /// Axes along which there is a next (previous) point.
  unsigned upward(const std::array<Index, 3>& at) const {
    return (at[0] < cubes_[0] ? 1u : 0u) | (at[1] < cubes_[1] ? 2u : 0u) | (at[2] < cubes_[2] ? 4u : 0u);
  }
  static unsigned downward(const std::array<Index, 3>& at) {
    return (at[0] > 0 ? 1u : 0u) | (at[1] > 0 ? 2u : 0u) | (at[2] > 0 ? 4u : 0u);
  }

  /// body(k) for k < layers, concurrently but for small layers, `each` items in each: threads are not worth it there.
  template <class Body> static void for_each_layer(Index layers, std::size_t each, const Body& body) {
    parallel_chunks(layers, static_cast<Index>(20000 / each + 1), [&](Index begin, Index end) {
      for (Index k = begin; k < end; ++k) body(k);
    });
  }
  /// body(k) for all planes of points.
  template <class Body> void for_each_plane(const Body& body) const { for_each_layer(cubes_[2] + 1, stride_[2], body); }
  /// body(at, point) for the points of a plane, in order.
  template <class Body> void for_each_point(Index k, const Body& body) const {
    std::array<Index, 3> at{0, 0, k};
    std::size_t point = stride_[2] * k;
    for (at[1] = 0; at[1] <= cubes_[1]; ++at[1])
      for (at[0] = 0; at[0] <= cubes_[0]; ++at[0]) body(at, point++);
  }
  std::array<Label, 8> corners(std::size_t cube) const {
    std::array<Label, 8> out;
    for (int c = 0; c < 8; ++c) out[c] = label_[cube + offset_[c]];
    return out;
  }

  // --- regions of points ---------------------------------------------------------------------------------------------

  void label_points() {
    label_.resize(num_points_);
    for_each_plane([&](Index k) {
      for_each_point(k, [&](const std::array<Index, 3>& at, std::size_t point) { label_[point] = region_of(at); });
    });
  }

  /// A point in the middle of a flat piece of boundary between faces of voxels could belong to either side: it goes to
  /// the thinner one, for which it may be the only one.
  Label region_of(const std::array<Index, 3>& at) const {
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

  // --- thin features draw points in ----------------------------------------------------------------------------------

  struct Moved {
    std::size_t point;
    Vec<3> u;
    Label region = on_boundary;
  };
  static constexpr std::uint8_t moved_before = 1, moved_now = 2;

  /// Marks the cubes in which more than one region has a say.
  std::vector<std::uint8_t> mixed_cubes() const {
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

  void draw_in_points() {
    flags_.assign(num_points_, 0);
    moved_.resize(static_cast<std::size_t>(cubes_[2]) + 1);
    const auto mixed = mixed_cubes();
    move([&](const std::array<Index, 3>& at, std::size_t point) { return drawn_in(at, point, mixed); });
    let_go();
  }

  /// Moves all points that `where` says, by what holds before any of them moves.
  template <class Where> void move(const Where& where) {
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

  /// Points that together squeeze a tetrahedron go back; their regions stay.
  void let_go() {
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

  /// Along the edge to which a point is drawn in the least.
  std::optional<Moved> drawn_in(const std::array<Index, 3>& at, std::size_t point,
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

  /// A bulge that an edge grazes goes on at one side of the edge and ends at the other; walls and necks do both alike.
  bool is_bulge(const Vec<3>& u, const Vec<3>& along, Label region) const {
    Vec<3> side = along.cross(along.cwiseAbs().x() < along.cwiseAbs().y() ? Vec<3>::UnitX() : Vec<3>::UnitY());
    for (int turn = 0; turn < 2; ++turn) {
      side *= snap * edge(7).minCoeff() / side.norm();
      if ((field_(u + side) == region) != (field_(u - side) == region)) return true;
      side = along.cross(side);
    }
    return false;
  }

  /// Whether a tetrahedron around a point has lost more than it may.
  bool squeezes(std::size_t point) const {
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

  /// Where a point of the lattice is, in voxels.
  Vec<3> position(std::size_t point) const { return position(unpacked(point), point); }
  Vec<3> position(const std::array<Index, 3>& at, std::size_t point) const {
    if (flags_[point] == 0) return place(at);
    return std::ranges::lower_bound(moved_[at[2]], point, {}, &Moved::point)->u;
  }

  // --- what no point sees --------------------------------------------------------------------------------------------

  void find_lost(LostFeatures& lost) const {
    std::array<std::vector<Index>, 3> cube_of;
    for (int d = 0; d < 3; ++d)
      for (Index v = 0; v < image_.size[d]; ++v)
        cube_of[d].push_back(
            std::min(static_cast<Index>((v + 0.5) * cubes_[d] / image_.size[d]), static_cast<Index>(cubes_[d] - 1)));
    const std::size_t row = image_.size[0], layer = row * image_.size[1];
    std::vector<std::vector<std::size_t>> found(image_.size[2]);
    for_each_layer(image_.size[2], layer, [&](Index k) {
      for (Index j = 0; j < image_.size[1]; ++j) {
        const std::size_t cubes = cube_of[1][j] * stride_[1] + cube_of[2][k] * stride_[2];
        const std::size_t voxels = j * row + k * layer;
        for (Index i = 0; i < image_.size[0];) {
          const Index cube = cube_of[0][i];
          const auto corner = corners(cubes + cube);
          for (; i < image_.size[0] && cube_of[0][i] == cube; ++i) {
            const Label region = field_.at(voxels + i);
            bool seen = false;
            for (const Label c : corner) seen = seen || c == region;
            if (!seen) found[k].push_back(voxels + i);
          }
        }
      }
    });
    std::vector<std::size_t> unseen;
    for (const auto& of_layer : found) unseen.insert(unseen.end(), of_layer.begin(), of_layer.end());
    if (unseen.empty()) return;

    internal::DisjointSets sets(static_cast<Index>(unseen.size()));
    std::vector<char> hangs_on(unseen.size(), 0);  // next to a voxel of its region that is seen
    const auto for_each_neighbour = [&](std::size_t voxel, const auto& body) {
      const std::size_t at[3] = {voxel % row, voxel % layer / row, voxel / layer}, step[3] = {1, row, layer};
      for (int d = 0; d < 3; ++d) {
        if (at[d] > 0) body(voxel - step[d]);
        if (at[d] + 1 < static_cast<std::size_t>(image_.size[d])) body(voxel + step[d]);
      }
    };
    for (std::size_t n = 0; n < unseen.size(); ++n)
      for_each_neighbour(unseen[n], [&](std::size_t next) {
        if (field_.at(next) != field_.at(unseen[n])) return;
        const auto it = std::lower_bound(unseen.begin(), unseen.end(), next);
        if (it == unseen.end() || *it != next) {
          hangs_on[n] = 1;
          return;
        }
        sets.join(static_cast<Index>(n), static_cast<Index>(it - unseen.begin()));
      });
    const std::vector<Index> cluster_of = std::move(sets).firsts();
    struct Cluster {
      std::size_t voxels = 0;
      bool hangs_on = false;
      Vec<3> sum = Vec<3>::Zero();
    };
    const auto centre = [&](std::size_t voxel) {
      return Vec<3>(static_cast<double>(voxel % row) + 0.5, static_cast<double>(voxel % layer / row) + 0.5,
                    static_cast<double>(voxel / layer) + 0.5);
    };
    std::vector<Cluster> clusters(unseen.size());
    for (std::size_t n = 0; n < unseen.size(); ++n) {
      Cluster& cluster = clusters[cluster_of[n]];
      ++cluster.voxels;
      cluster.hangs_on = cluster.hangs_on || hangs_on[n];
      cluster.sum += centre(unseen[n]);
    }
    std::size_t worst = 0;
    for (std::size_t n = 0; n < unseen.size(); ++n) {
      if (cluster_of[n] != static_cast<Index>(n)) continue;
      ++(clusters[n].hangs_on ? lost.pieces : lost.parts);
      const auto rank = [&](std::size_t of) { return std::pair(clusters[of].voxels, !clusters[of].hangs_on); };
      if (rank(n) > rank(worst)) worst = n;
    }
    const double volume = image_.pixel_volume();
    lost.volume = volume * static_cast<double>(unseen.size());
    lost.worst_volume = volume * static_cast<double>(clusters[worst].voxels);
    lost.worst_is_part = !clusters[worst].hangs_on;
    const Vec<3> mean = clusters[worst].sum / static_cast<double>(clusters[worst].voxels);
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t n = 0; n < unseen.size(); ++n)
      if (const double distance = (centre(unseen[n]) - mean).squaredNorm();
          cluster_of[n] == static_cast<Index>(worst) && distance < nearest) {
        nearest = distance;
        lost.worst_place = image_.origin + image_.spacing.cwiseProduct(centre(unseen[n]));
      }
    if (const Label region = field_.at(unseen[worst]); region != 0) lost.worst_region = regions_.names[region - 1];
  }

  // --- where edges are cut -------------------------------------------------------------------------------------------

  /// In parts of the edge from u to u + along, whose ends are in regions a and b.
  double cut(const Vec<3>& u, const Vec<3>& along, Label a, Label b) const {
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

  void cut_edges() {
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
  /// Of the edge from a point along the axes of a mask, if it has one; in parts of it.
  double cut_of(std::size_t point, unsigned axes) const {
    return cuts_[point / stride_[2]][first_[point] + std::popcount(cut_mask_[point] & ((1u << axes) - 1))];
  }
  /// The same, away from the ends.
  double kept_cut(std::size_t point, unsigned axes) const { return std::clamp(cut_of(point, axes), snap, 1.0 - snap); }

  // --- points near a boundary go there -------------------------------------------------------------------------------

  void snap_points() {
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

  /// The edges of points that have moved since.
  void cut_again() {
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

  /// Where a point near a boundary goes: onto it, if it is flat enough, and has no other side of a thin wall in reach:
  /// points on a boundary have no region, and what lies between them and farther cuts of their edges would be lost.
  /// Else away from it.
  std::optional<Moved> settled(const std::array<Index, 3>& at, std::size_t point) const {
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

  /// Back from a cut that is too near, but not beyond the middle of a wall.
  std::optional<Moved> away(std::size_t point, const Vec<3>& from, const Vec<3>& along, double t) const {
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

  // --- tetrahedra ----------------------------------------------------------------------------------------------------

  /// Region of a tetrahedron without a corner that has one.
  Label region_inside(std::size_t cube, const KuhnTet& tet) const {
    Vec<3> sum = Vec<3>::Zero();
    for (const std::uint8_t corner : tet.corner) sum += position(cube + offset_[corner]);
    return field_(0.25 * sum);
  }

  /// Region of a piece of a tetrahedron.
  Label region_of(std::size_t cube, const KuhnTet& tet, int owner) const {
    return owner == 4 ? region_inside(cube, tet) : label_[cube + offset_[tet.corner[owner]]];
  }

  static const Subdivision& subdivision_of(const std::array<Label, 8>& corner, const KuhnTet& tet) {
    std::array<Label, 4> label;
    std::array<int, 4> of;
    int most = 0, code = 0, power = 1;
    for (int i = 0; i < 4; ++i, power *= 5) {
      label[i] = corner[tet.corner[i]];
      of[i] = 0;
      if (label[i] != on_boundary) {
        for (int j = 0; j < i && of[i] == 0; ++j)
          if (label[j] == label[i]) of[i] = of[j];
        if (of[i] == 0) of[i] = ++most;
      }
      code += power * of[i];
    }
    return internal::subdivision(code);
  }

  // --- vertices ------------------------------------------------------------------------------------------------------

  /// A point in which parts of the body touch that do not hang together around it: one vertex for each part.
  struct Split {
    std::size_t point;
    std::int64_t first_copy;            // of the second part
    std::array<std::uint8_t, 24> part;  // by tetrahedron of the star
    int parts;
  };
  static constexpr std::uint32_t split_bit = 1u << num_bits;

  void number_vertices() {
    const std::size_t planes = static_cast<std::size_t>(cubes_[2]) + 1;
    bits_.resize(num_points_);
    splits_.resize(planes);
    std::vector<std::int64_t> vertices(planes + 1, 0), copies(planes + 1, 0), cells(planes + 1, 0);
    for_each_plane([&](Index k) {
      for_each_point(k, [&](const std::array<Index, 3>& at, std::size_t point) {
        const std::uint32_t bits = entities(at, point, splits_[k]);
        bits_[point] = bits;
        vertices[k + 1] += std::popcount(bits & (split_bit - 1));
        if (upward(at) == 7) cells[k + 1] += count_cells(point);
      });
      for (const Split& split : splits_[k]) copies[k + 1] += split.parts - 1;
    });
    std::partial_sum(vertices.begin(), vertices.end(), vertices.begin());
    std::partial_sum(copies.begin(), copies.end(), copies.begin());
    std::partial_sum(cells.begin(), cells.end(), cells.begin());
    num_main_ = vertices.back();
    num_vertices_ = vertices.back() + copies.back();
    num_cells_ = cells.back();
    if (static_cast<double>(num_vertices_) > largest_index || static_cast<double>(4 * num_cells_) > largest_index)
      throw InputError(fmt::format("image: it takes {} tetrahedra, at most {} can be numbered; take a larger size",
                                   num_cells_, static_cast<Index>(largest_index / 4)));
    if (num_cells_ == 0) throw NumericalError("image: with this size no material is found; take a smaller one");
    require_memory(28.0 * static_cast<double>(num_vertices_) + 24.0 * static_cast<double>(num_cells_),
                   fmt::format("image: a mesh of {} tetrahedra", num_cells_), "take a larger size");
    first_vertex_.resize(num_points_);
    for_each_plane([&](Index k) {
      std::int64_t next = vertices[k], copy = num_main_ + copies[k];
      for_each_point(k, [&](const std::array<Index, 3>&, std::size_t point) {
        first_vertex_[point] = static_cast<Index>(next);
        next += std::popcount(bits_[point] & (split_bit - 1));
      });
      for (Split& split : splits_[k]) {
        split.first_copy = copy;
        copy += split.parts - 1;
      }
    });
    first_cell_ = std::move(cells);
  }

  /// Bits of the vertices that a point is the lowest corner of.
  std::uint32_t entities(const std::array<Index, 3>& at, std::size_t point, std::vector<Split>& splits) const {
    const Label own = label_[point];
    if (own == on_boundary) return vertex_on_boundary(at, point, splits);
    std::uint32_t bits = own != 0 ? 1u : 0u;
    if (cut_mask_[point] == 0 && regions_.names.size() == 1) return bits;
    const unsigned up = upward(at);
    std::array<Label, 8> label;
    for (unsigned axes = 0; axes < 8; ++axes)
      label[axes] = (axes & up) == axes ? label_[point + offset_[axes]] : on_boundary;
    for (unsigned axes = 1; axes < 8; ++axes)
      if (label[axes] != on_boundary && label[axes] != own) bits |= 1u << (first_edge_bit - 1 + axes);
    if (regions_.names.size() == 1 || std::popcount(bits >> first_edge_bit) < 2) return bits;
    const auto all_different = [&](std::initializer_list<Label> labels) {
      for (auto a = labels.begin(); a != labels.end(); ++a)
        if (*a == on_boundary || std::find(labels.begin(), a, *a) != a) return false;
      return true;
    };
    for (int f = 0; f < 12; ++f)
      if (all_different({own, label[kuhn_faces()[f].middle], label[kuhn_faces()[f].far]}))
        bits |= 1u << (first_face_bit + f);
    for (int t = 0; t < 6; ++t) {
      const auto& corner = kuhn_tets()[t].corner;
      if (all_different({own, label[corner[1]], label[corner[2]], label[7]})) bits |= 1u << (first_cell_bit + t);
    }
    return bits;
  }

  std::uint32_t vertex_on_boundary(const std::array<Index, 3>& at, std::size_t point,
                                   std::vector<Split>& splits) const {
    const unsigned up = upward(at), down = downward(at);
    // Of every tetrahedron around the point: its solid corners, those without a region, whether it has any solid.
    std::array<std::uint8_t, 24> solid_corners{}, free_corners{};
    std::uint32_t solid = 0;
    for (int s = 0; s < 24; ++s) {
      const auto& [number, own, next] = kuhn_star().tets[s];
      const KuhnTet& tet = kuhn_tets()[number];
      const unsigned below = tet.corner[own];
      if ((below & down) != below || ((7 ^ below) & up) != (7 ^ below)) continue;
      const std::size_t cube = point - offset_[below];
      for (int i = 0; i < 4; ++i) {
        const Label label = label_[cube + offset_[tet.corner[i]]];
        if (label == on_boundary)
          free_corners[s] |= static_cast<std::uint8_t>(1 << i);
        else if (label != 0)
          solid_corners[s] |= static_cast<std::uint8_t>(1 << i);
      }
      const bool is_solid = free_corners[s] == 15 ? region_inside(cube, tet) != 0 : solid_corners[s] != 0;
      if (is_solid) solid |= 1u << s;
    }
    if (solid == 0) return 0;
    Split split{point, 0, {}, 0};
    for (std::uint32_t left = solid; left != 0; ++split.parts) {
      std::uint32_t front = left & -left;
      left &= ~front;
      while (front != 0) {
        const int s = std::countr_zero(front);
        front &= front - 1;
        split.part[s] = static_cast<std::uint8_t>(split.parts);
        for (int f = 0; f < 4; ++f) {
          const std::uint8_t next = kuhn_star().tets[s].next[f];
          if (next == 24 || !(left >> next & 1)) continue;
          const unsigned face = 15u ^ (1u << f);
          // The face has something solid: beside a corner of that kind, or all of it between two solid tetrahedra.
          if ((solid_corners[s] & face) == 0 && (free_corners[s] & face) != face) continue;
          left &= ~(1u << next);
          front |= 1u << next;
        }
      }
    }
    if (split.parts == 1) return 1u;
    splits.push_back(split);
    return 1u | split_bit;
  }

  int count_cells(std::size_t cube) const {
    const auto corner = corners(cube);
    if (is_uniform(corner)) return corner[0] != 0 ? 6 : 0;
    int count = 0;
    for (const KuhnTet& tet : kuhn_tets())
      for (const auto& piece : subdivision_of(corner, tet).pieces)
        if (region_of(cube, tet, piece.owner) != 0) ++count;
    return count;
  }
  static bool is_uniform(const std::array<Label, 8>& corner) {
    return corner[0] != on_boundary &&
           std::all_of(corner.begin() + 1, corner.end(), [&](Label l) { return l == corner[0]; });
  }

  void place_vertices(LatticeMesh& out) const {
    out.mesh.vertices.resize(3, static_cast<Index>(num_vertices_));
    out.point_of_vertex.assign(num_vertices_, -1);
    const auto set = [&](std::int64_t vertex, const Vec<3>& u) {
      out.mesh.vertices.col(vertex) = image_.origin + image_.spacing.cwiseProduct(u);
    };
    for_each_plane([&](Index k) {
      for_each_point(k, [&](const std::array<Index, 3>& at, std::size_t point) {
        std::uint32_t bits = bits_[point] & (split_bit - 1);
        if (bits == 0) return;
        std::int64_t vertex = first_vertex_[point];
        const Vec<3> u = position(at, point);
        for (; bits != 0; bits &= bits - 1, ++vertex) {
          const int bit = std::countr_zero(bits);
          if (bit == 0) {
            set(vertex, u);
            if (flags_[point] == 0) out.point_of_vertex[vertex] = static_cast<Index>(point);
          } else if (bit < first_face_bit) {
            const unsigned axes = static_cast<unsigned>(bit - first_edge_bit + 1);
            set(vertex, u + kept_cut(point, axes) * (position(point + offset_[axes]) - u));
          } else {
            set(vertex, junction(point, bit, u));
          }
        }
      });
      for (const Split& split : splits_[k])
        for (int copy = 0; copy + 1 < split.parts; ++copy) set(split.first_copy + copy, position(split.point));
    });
  }

  /// Where three or four regions meet: the mean of the cuts around, in barycentric coordinates, off the sides.
  Vec<3> junction(std::size_t point, int bit, const Vec<3>& u) const {
    std::array<unsigned, 4> corner{};
    int count = 3;
    if (bit < first_cell_bit) {
      const auto& face = kuhn_faces()[bit - first_face_bit];
      corner = {0, face.middle, face.far, 0};
    } else {
      const auto& tet = kuhn_tets()[bit - first_cell_bit];
      std::copy(tet.corner.begin(), tet.corner.end(), corner.begin());
      count = 4;
    }
    std::array<double, 4> weight{};
    for (int i = 0; i < count; ++i)
      for (int j = i + 1; j < count; ++j) {
        const double t = kept_cut(point + offset_[corner[i]], corner[i] ^ corner[j]);
        weight[i] += 1.0 - t;
        weight[j] += t;
      }
    double sum = 0.0;
    for (int i = 0; i < count; ++i) {
      weight[i] = std::max(weight[i], junction_margin * count * (count - 1) / 2);
      sum += weight[i];
    }
    Vec<3> out = u;
    for (int i = 1; i < count; ++i) out += weight[i] / sum * (position(point + offset_[corner[i]]) - u);
    return out;
  }

  // --- cells and groups ----------------------------------------------------------------------------------------------

  Index vertex(std::size_t cube, int number, std::uint8_t point) const {
    const KuhnTet& tet = kuhn_tets()[number];
    const std::size_t owner = cube + offset_[tet.owner[point]];
    const std::uint32_t bits = bits_[owner];
    if (bits & split_bit) {  // a point on the boundary owns nothing but itself
      const auto& plane = splits_[owner / stride_[2]];
      const Split& split = *std::ranges::lower_bound(plane, owner, {}, &Split::point);
      const int part = split.part[4 * number + std::countr_zero(static_cast<unsigned>(point))];
      if (part > 0) return static_cast<Index>(split.first_copy + part - 1);
    }
    return first_vertex_[owner] + std::popcount(bits & ((1u << tet.bit[point]) - 1));
  }

  void make_cells(LatticeMesh& out) const {
    using Key = std::array<Index, 3>;
    out.mesh.cells.resize(4, static_cast<Index>(num_cells_));
    out.mesh.regions.resize(num_cells_);
    out.cube_of_cell.resize(num_cells_);
    std::vector<std::array<std::vector<Key>, 7>> facets(static_cast<std::size_t>(cubes_[2]));
    for_each_layer(cubes_[2], stride_[2], [&](Index k) {
      std::int64_t cell = first_cell_[k];
      for_each_point(k, [&](const std::array<Index, 3>& at, std::size_t cube) {
        if (upward(at) != 7) return;
        const auto corner = corners(cube);
        const bool uniform = is_uniform(corner);
        if (uniform && corner[0] == 0) return;
        const bool at_frame =
            downward(at) != 7 || at[0] + 1 == cubes_[0] || at[1] + 1 == cubes_[1] || at[2] + 1 == cubes_[2];
        const Index number_of_cube = static_cast<Index>(
            at[0] + static_cast<std::int64_t>(cubes_[0]) * (at[1] + static_cast<std::int64_t>(cubes_[1]) * at[2]));
        const auto emit = [&](const std::array<Index, 4>& points, bool is_odd, Label region) {
          const Index c = static_cast<Index>(cell++);
          out.mesh.cells.col(c) << points[0], points[1], points[is_odd ? 3 : 2], points[is_odd ? 2 : 3];
          out.mesh.regions[c] = region - 1;
          out.cube_of_cell[c] = number_of_cube;
        };
        if (uniform && !at_frame) {
          std::array<Index, 8> v;
          for (int c = 0; c < 8; ++c) v[c] = first_vertex_[cube + offset_[c]];
          for (const KuhnTet& tet : kuhn_tets())
            emit({v[tet.corner[0]], v[tet.corner[1]], v[tet.corner[2]], v[tet.corner[3]]}, tet.is_odd, corner[0]);
          return;
        }
        for (int t = 0; t < 6; ++t) {
          const KuhnTet& tet = kuhn_tets()[t];
          const Subdivision& parts = subdivision_of(corner, tet);
          const Label inside = parts.pieces[0].owner == 4 ? region_inside(cube, tet) : Label{0};
          const auto region = [&](int owner) { return owner == 4 ? inside : corner[tet.corner[owner]]; };
          for (const auto& piece : parts.pieces) {
            if (region(piece.owner) == 0) continue;
            std::array<Index, 4> points;
            for (int i = 0; i < 4; ++i) points[i] = vertex(cube, t, piece.points[i]);
            emit(points, tet.is_odd, region(piece.owner));
          }
          const auto add = [&](int group, const std::array<std::uint8_t, 3>& points) {
            facets[k][group].push_back(
                {vertex(cube, t, points[0]), vertex(cube, t, points[1]), vertex(cube, t, points[2])});
          };
          for (const auto& facet : parts.interfaces)
            if ((region(facet.owner) == 0) != (region(facet.other) == 0)) add(pores, facet.points);
          for (const auto& facet : parts.outer) {
            if (region(facet.owner) == 0) continue;
            const int axis = tet.beyond_axis[facet.face];
            if (axis >= 0 && facet.face == 3 && at[axis] == 0) {
              add(2 * axis, facet.points);
            } else if (axis >= 0 && facet.face == 0 && at[axis] + 1 == cubes_[axis]) {
              add(2 * axis + 1, facet.points);
            } else if (facet.is_whole) {
              std::size_t other = cube;
              if (axis >= 0) other = facet.face == 0 ? cube + stride_[axis] : cube - stride_[axis];
              const KuhnTet& beyond = kuhn_tets()[tet.beyond[facet.face]];
              // The corner of the other one that this one lacks.
              const int corner_beyond = facet.face == 0 ? 3 : facet.face == 3 ? 0 : facet.face;
              Label label = label_[other + offset_[beyond.corner[corner_beyond]]];
              if (label == on_boundary) label = region_inside(other, beyond);
              if (label == 0) add(pores, facet.points);
            }
          }
        }
      });
    });
    for (int g = 0; g < 7; ++g) {
      auto& group = out.mesh.groups.emplace_back();
      group.name = group_names[g];
      std::size_t count = 0;
      for (const auto& plane : facets) count += plane[g].size();
      group.facets.reserve(count);
      for (const auto& plane : facets) group.facets.insert(group.facets.end(), plane[g].begin(), plane[g].end());
    }
  }

  // --- what hangs together in the image, but not in the mesh ---------------------------------------------------------

  void find_broken(LatticeMesh& out) const {
    const Cells<3>& cells = out.mesh.cells;
    const std::vector<Index> first = internal::first_of_body<3>(cells, static_cast<Index>(num_vertices_));
    struct Body {
      double volume = 0.0;
      Vec<3> moment = Vec<3>::Zero();
      Index part = -1;  // of the image
    };
    std::vector<Index> number(first.size(), -1);  // of the body, by its first vertex
    std::vector<Body> bodies;
    for (std::size_t v = 0; v < first.size(); ++v)
      if (first[v] == static_cast<Index>(v)) {
        number[v] = static_cast<Index>(bodies.size());
        bodies.emplace_back();
      }
    if (bodies.size() < 2) return;

    LabelImage<3> material{.size = image_.size, .labels = image_.labels};
    for (Label& label : material.labels) label = label != 0;
    const ConnectedPixels parts = connected_pixels(material);
    for (Index c = 0; c < cells.cols(); ++c) {
      Body& body = bodies[number[first[cells(0, c)]]];
      const Vec<3> corner = out.mesh.vertices.col(cells(0, c));
      Mat<3> edges;
      for (int i = 1; i < 4; ++i) edges.col(i - 1) = out.mesh.vertices.col(cells(i, c)) - corner;
      const double volume = edges.determinant() / 6.0;
      const Vec<3> centre = corner + 0.25 * edges.rowwise().sum();
      body.volume += volume;
      body.moment += volume * centre;
      if (body.part >= 0) continue;
      // Near the boundary cells may lie in voxels of void.
      std::array<Index, 3> voxel;
      for (int d = 0; d < 3; ++d)
        voxel[d] =
            std::clamp(static_cast<Index>((centre[d] - image_.origin[d]) / image_.spacing[d]), 0, image_.size[d] - 1);
      if (const Index part = parts.part_of[image_.index(voxel)]; parts.parts[part].label != 0) body.part = part;
    }
    std::vector<Index> largest(parts.parts.size(), -1);  // first of the largest bodies of each part
    for (std::size_t n = 0; n < bodies.size(); ++n)
      if (bodies[n].part >= 0)
        if (Index& of = largest[bodies[n].part]; of < 0 || bodies[n].volume > bodies[of].volume)
          of = static_cast<Index>(n);
    for (std::size_t n = 0; n < bodies.size(); ++n) {
      const Body& body = bodies[n];
      if (body.part < 0 || largest[body.part] == static_cast<Index>(n)) continue;
      ++out.lost.broken_off;
      if (body.volume <= out.lost.broken_volume) continue;
      out.lost.broken_volume = body.volume;
      out.lost.broken_place = body.moment / body.volume;
    }
  }

  const LabelImage<3>& image_;
  internal::ImageRegions regions_;
  ImageField field_;
  std::array<Index, 3> cubes_{};
  std::array<std::size_t, 3> stride_{};
  std::array<std::size_t, 8> offset_{};  // by mask of axes
  std::size_t num_points_ = 0;

  std::vector<Label> label_;                // by point: region from 1, void 0, or on_boundary
  std::vector<std::uint8_t> cut_mask_;      // by point: bit m if its edge along the axes m has ends in two regions
  std::vector<Index> first_;                // by point: its first cut in its plane
  std::vector<std::vector<float>> cuts_;    // by plane
  std::vector<std::vector<Moved>> moved_;   // by plane, ascending
  std::vector<std::uint8_t> flags_;         // by point: 0, moved_before or moved_now
  std::vector<std::uint32_t> bits_;         // by point: the vertices that it is the lowest corner of
  std::vector<std::vector<Split>> splits_;  // by plane, ascending
  std::vector<Index> first_vertex_;         // by point
  std::vector<std::int64_t> first_cell_;    // by plane
  std::int64_t num_main_ = 0, num_vertices_ = 0, num_cells_ = 0;
};

}  // namespace

LatticeMesh mesh_on_lattice(const LabelImage<3>& image, const ImageMeshOptions& options) {
  return LatticeMesher(image, options).make();
}

}  // namespace efree
