// SPDX-License-Identifier: GPL-3.0-or-later
/// The state of a run of explicit dynamics, as plain data: nodes, chunks of material points with their shape functions,
/// bodies. The driver, a scheme and interactions read and change it.
#pragma once

#include "efree/core/aligned.hpp"
#include "efree/core/parallel.hpp"
#include "efree/dynamics/body.hpp"
#include "efree/dynamics/contact/contact_sums.hpp"
#include "efree/dynamics/contact/rigid_body.hpp"
#include "efree/dynamics/ledger.hpp"
#include "efree/dynamics/mass_scaling.hpp"
#include "efree/dynamics/options.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <numbers>
#include <ranges>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace efree {

template <int Dim> class Interaction;

/// Nodes of all bodies, one after the other. A scheme may add, take away or replace them.
template <int Dim> struct Nodes {
  Points<Dim> x, v, force;    ///< Dim x N: positions, velocities half a step ago, forces of all but impulses
  Points<Dim> x_rest;         ///< what rounding has kept from x so far (compensated sums)
  Points<Dim> v_before;       ///< v a step ago
  Points<Dim> free;           ///< 0 along axes with prescribed velocity, else 1
  Points<Dim> momentum;       ///< where masses are not lumped; empty: mass times v
  Vector mass;                ///< N, lumped; 0: the node follows another
  Vector added_mass;          ///< N, part of it that MassScaling::step adds; empty: none
  Vector spacing;             ///< N, mean distance of the nodes around it at the start
  Vector radius;              ///< N, how far walls stay away from it [length]; empty: 0
  std::vector<Index> body;    ///< N
  std::vector<Index> master;  ///< N, the node that it moves with, tied to or merged with it; -1: it moves by itself

  Index size() const { return static_cast<Index>(x.cols()); }
  bool follows(Index a) const { return master[a] >= 0; }
  /// The node whose motion it has.
  Index master_of(Index a) const { return follows(a) ? master[a] : a; }
};

/// A node in a point's row: the gradient of its shape function in the configuration where the table was computed, and
/// the shape function. In the plane the third component is the function over the radius (axisymmetric), or zero.
struct TableEntry {
  double dN[3];
  double N;
};
/// A row before it is put into a table: nodes and entries.
using TableRow = std::vector<std::pair<Index, TableEntry>>;

/// Shape functions that sum up to one and gradients that sum up to nothing, to far below rounding: what is missing is
/// added to the smallest that is no smaller than a thousandth of the largest. Forces of a point would sum up to
/// something else, and to the same in every step. entry(k): that of the k-th node, of `count`.
template <int Dim, class Entry> void complete_row(std::size_t count, const Entry& entry) {
  const auto complete = [&](double whole, const auto& number) {
    double largest = 0.0, sum = -whole, rest = 0.0;  // the sum of both is exact (Neumaier 1974)
    for (std::size_t k = 0; k < count; ++k) {
      const double more = number(entry(k)), next = sum + more;
      rest += std::abs(sum) >= std::abs(more) ? (sum - next) + more : (more - next) + sum;
      sum = next;
      largest = std::max(largest, std::abs(more));
    }
    double* least = nullptr;
    for (std::size_t k = 0; k < count; ++k)
      if (double& of = number(entry(k)); std::abs(of) >= 1e-3 * largest && (!least || std::abs(of) < std::abs(*least)))
        least = &of;
    if (least) *least -= sum + rest;
  };
  complete(1.0, [](TableEntry& of) -> double& { return of.N; });
  for (int i = 0; i < Dim; ++i) complete(0.0, [i](TableEntry& of) -> double& { return of.dN[i]; });
}

/// A node's shape function as kernels read it; `hoop` is over the radius.
template <int Dim> TableEntry table_entry(double N, const Vec<Dim>& dN, double hoop) {
  TableEntry entry{{0.0, 0.0, hoop}, N};
  for (int i = 0; i < Dim; ++i) entry.dN[i] = dN[i];
  return entry;
}

/// Shape functions of the points of a chunk. Row p: entries offsets[p] .. offsets[p + 1], of the nodes that `local`
/// numbers.
template <int Dim> struct PointTable {
  std::vector<Index> offsets{0};
  std::vector<std::uint16_t> local;
  AlignedVector<TableEntry> entries;
  std::vector<Index> nodes;            ///< by local number
  AlignedVector<double> x, force;      ///< four numbers for each of these; x: from `origin` on
  Vec<Dim> origin = Vec<Dim>::Zero();  ///< near them, so that no place is a small difference of large numbers

  /// Nodes and entries of a point's row.
  auto row(Index p) const {
    return std::views::iota(offsets[p], offsets[p + 1]) | std::views::transform([this](Index e) {
             return std::pair<Index, const TableEntry&>(nodes[local[e]], entries[e]);
           });
  }
  /// Whether a point's row has that node, by its local number.
  bool has(Index p, Index local_node) const {
    const auto end = local.begin() + offsets[p + 1];
    return std::find(local.begin() + offsets[p], end, local_node) != end;
  }
};

/// How wide the shape functions of the points are, and what resists zero-energy modes of their nodes. Empty by schemes
/// without them (PointStorage), but for the metric with shock viscosity.
template <int Dim> struct Support {
  /// By point: metric of the supports, `gamma` over the square of the spacing along its axes.
  std::vector<Mat<Dim>> metric;
  double gamma = 1.0;
  /// By point: second moments sum N_a (x_a - x) (x_a - x)^T [length^2] where the table was computed, if known.
  std::vector<Mat<Dim>> moment;
  bool has_moments = false;
  Vector stabilisation;  ///< by point: stiffness against zero-energy modes [force/length]
};

/// What points store from one step to the next, beside what every scheme needs.
struct PointStorage {
  bool table_gradients = true;  ///< Matter::F_table and F_since; else a scheme takes increments in every step
  bool supports = true;         ///< Support, and the stiffness ratios that estimates of StableStep take
};

/// Material points. Arrays that may be empty are so where neither the scheme (PointStorage) nor an option needs them.
template <int Dim> struct Matter {
  Deformation now;              ///< reference positions, F, history
  Tensors P;                    ///< first Piola-Kirchhoff stresses
  Vector energy;                ///< stored energy [stress]
  Tensors F_table;              ///< F when the table was computed; may be empty
  std::vector<Mat<3>> F_since;  ///< the deformation gradient since then: F = F_since F_table; may be empty
  Points<Dim> x;                ///< positions
  Vector volume, mass;          ///< in the reference configuration; the volume of eroded points is 0
  Vector added_mass;            ///< part of the mass that MassScaling::step adds; empty: none
  std::vector<char> eroded;     ///< 1: bears no stress any more
  Vector J_ratio;               ///< J over that of the pressure patch
  Vector J;                     ///< of the pressure patch, a step ago; may be empty without shock viscosity
  Vector shock;                 ///< viscous pressure times J; may be empty without shock viscosity
  Vector modulus;               ///< of pressure waves
  Vector stiffness_ratio;       ///< largest stiffness over that at rest; may be empty
  Vector damage;                ///< at 1 the point breaks; empty: 0 everywhere
  Vector crack_radius;  ///< of the ball whose energy is released with the point's; may be empty without fracture

  Index size() const { return now.size(); }
  double damage_at(Index p) const { return damage.size() == 0 ? 0.0 : damage[p]; }
  /// Deformation gradient of a point, without the mean dilatation of its pressure patch.
  Mat<3> own_gradient(Index p) const {
    return F_since.empty() ? now.gradient(p) : Mat<3>(F_since[p] * Eigen::Map<const Mat<3>>(F_table.col(p).data()));
  }
  /// Mass of a point without the part that MassScaling::step adds.
  double own_mass(Index p) const { return added_mass.size() == 0 ? mass[p] : mass[p] - added_mass[p]; }
};

/// Some hundred material points of a body that lie together, with the nodes in their table: what one thread works on at
/// a time.
template <int Dim> struct Chunk {
  Index body = 0;
  std::vector<Index> number;  ///< of the points, in their body
  PointTable<Dim> table;
  Support<Dim> support;
  Matter<Dim> matter;
  std::vector<Index> patches;     ///< where each pressure patch begins, and the end of the last
  std::vector<Index> inverted;    ///< points that the last step would have inverted, ascending: they exert no force
  double damping = 0.0;           ///< largest viscous pressure over that of sound
  double compression_rate = 0.0;  ///< largest
  double stored = 0.0, dissipated = 0.0, viscous = 0.0;  ///< energies
  /// So far: work on inverted points that nothing has stored, less the energy of zero-energy modes that stays with
  /// shape functions that are kept.
  double lost = 0.0;
  std::array<double, 3> seconds{};  ///< of kinematics, materials, forces

  Index size() const { return matter.size(); }
  bool is_eroded(Index p) const { return matter.eroded[p] != 0; }
  bool is_inverted(Index p) const { return std::binary_search(inverted.begin(), inverted.end(), p); }
  /// Calls visit(begin, end) for the points of every pressure patch.
  template <class Visit> void for_each_patch(const Visit& visit) const {
    for (std::size_t k = 0; k + 1 < patches.size(); ++k) visit(patches[k], patches[k + 1]);
  }
  /// Whether its points have shape functions in the table: by some schemes they have none.
  bool has_table() const { return !table.entries.empty(); }
  /// Whether there are pressure patches of more than one point.
  bool has_patches() const { return static_cast<Index>(patches.size()) != size() + 1; }
  /// Points go on as those of `from`, ascending, of which some may be left out and some may be there twice. Returns of
  /// the points so far where each begins now (one more than there were).
  std::vector<Index> take(const std::vector<Index>& from);
  /// Sixteen numbers a point, what kernels hand over: of this thread, for whatever chunk it works on.
  double* columns() const;
  /// By point, the deformation gradient since tables were computed, or, where points do not store it, since a step ago:
  /// then of this thread, for whatever chunk it works on.
  Mat<3>* recent_gradients();
};

/// Properties that all points of a body share.
template <int Dim> struct BodyState {
  SharedMaterial material;
  std::array<double, 108> tangent;     ///< at rest, as internal::apply_tangent takes it
  std::array<double, 108> compliance;  ///< likewise; of rotations as of shear
  double shear, modulus;               ///< at rest, against shear and of pressure waves
  FractureCriteria fracture;
  Strength strength;
  Index plastic_strain, temperature;  ///< rows of the history, equivalent and its rise; -1: none
  Index plastic_metric;               ///< first of the rows of C_p^-1 - 1; -1: none
  double release;                     ///< C of energy release rates
  Cells<Dim> cells;                   ///< around the points; nodes as the body numbers them
  bool holds_inverted = false;        ///< whether the scheme deals with points that a step would invert
  /// Pressure taken off the stresses of its points, which acts on its surface instead; 0: none.
  double reference_pressure = 0.0;
  bool runs_together = false;  ///< whether parts of it that meet become one, as those of a fluid do
};

/// Consistent masses: the first terms of the series D^-1 + D^-1 (D - M) D^-1 + ... of M^-1, D lumped.
template <int Dim> struct ConsistentMass {
  std::vector<Index> terms;  ///< by body, 1: lumped; empty: lumped in all
  SparseRows coupling;       ///< M between nodes of bodies with more than one term
  Points<Dim> free_sum;      ///< Dim x N, rows of M summed over nodes that are free
  bool any() const { return !terms.empty(); }
};

/// Points of the surface that walls act on where nodes are not on it.
struct SurfacePoints {
  SparseRows shape;          ///< shape functions, by point and node
  std::vector<char> bodies;  ///< by body, 1: it has such points; empty: none has
  double skin = 0.0;         ///< gap below which points are near [length]
  double reach = 1.0;        ///< how much further than nodes such points may move
  bool of(Index body) const { return !bodies.empty() && bodies[body] != 0; }
};

/// Velocity along an axis by a position at the start and by the time. Called by one thread.
template <int Dim> using VelocityLaw = std::function<double(const Vec<Dim>& start, double time)>;

/// A prescribed motion along an axis.
template <int Dim> struct MotionLaw {
  VelocityLaw<Dim> law;
  bool is_displacement = false;  ///< the law is that of a displacement, which is then as it says after every step

  /// In a step from `time` on.
  double velocity(const Vec<Dim>& start, double time, double dt) const {
    return is_displacement ? (law(start, time + dt) - law(start, time)) / dt : law(start, time + 0.5 * dt);
  }
};

/// Force per mass by the position at the time [length/time^2]. Called by one thread.
template <int Dim> using GravityField = std::function<Vec<Dim>(const Vec<Dim>& x, double time)>;

/// Velocities of nodes along an axis.
template <int Dim> struct PrescribedVelocity {
  Index node;
  int axis;
  double velocity;
  Index law = -1;                     ///< of World::motion_laws; -1: it stays as it is
  Vec<Dim> start = Vec<Dim>::Zero();  ///< position that the law is asked for
};

/// Velocities along an axis of points, ascending, for schemes whose nodes do not stay with the material.
template <int Dim> struct PrescribedPoints {
  std::vector<Index> points;
  int axis;
  Vector velocity;         ///< of each
  Index law = -1;          ///< as of PrescribedVelocity
  Points<Dim> start = {};  ///< positions that the law is asked for
};

/// Which chunks have a node in their table: row a of offsets, chunk and local number, and the forces there.
struct NodeChunks {
  std::vector<Index> offsets;
  std::vector<std::pair<Index, Index>> places;
  std::vector<const double*> forces;
};

template <int Dim> struct World {
  DynamicsOptions options;
  Nodes<Dim> nodes;
  std::vector<BodyState<Dim>> bodies;
  std::vector<Index> first_node, first_point;  ///< by body, and one past the last of all
  std::vector<Chunk<Dim>> chunks;
  std::vector<std::pair<Index, Index>> place_of_point;  ///< by point: chunk and number there
  NodeChunks node_chunks;
  /// Where nodes do not stay with the material: K x N, shape functions of the nodes of a body at each position (Dim x
  /// K) on its surface, for loads there. Empty: nodes do.
  std::function<SparseRows(const World&, const Points<Dim>& at, const std::vector<Index>& bodies)> functions_at;
  ConsistentMass<Dim> consistent_mass;
  SurfacePoints surface_points;
  std::vector<PrescribedVelocity<Dim>> prescribed;
  /// Velocities prescribed by place, for nodes that come later; `where` is asked for positions.
  struct PrescribedPlace {
    std::function<bool(const Vec<Dim>&)> where;
    int axis;
    double velocity;
  };
  std::vector<PrescribedPlace> prescribed_places;
  std::vector<PrescribedPoints<Dim>> prescribed_points;
  std::vector<MotionLaw<Dim>> motion_laws;
  std::vector<Wall<Dim>> walls;
  Vec<Dim> gravity = Vec<Dim>::Zero();               ///< force per mass on all that has a mass
  std::function<Vec<Dim>(double time)> gravity_law;  ///< that it follows; empty: it stays as it is
  GravityField<Dim> gravity_field;                   ///< in addition, where it depends on the position; empty: none
  std::vector<std::unique_ptr<Interaction<Dim>>> interactions;
  double time = 0.0, last_step = 0.0;
  double stable_step = 0.0, first_stable_step = 0.0;
  double unscaled_step = 0.0;  ///< stable step of the bodies as they are given, without mass scaling
  Index steps = 0;
  Index steps_of_earlier_run = 0;  ///< of these steps, those of the run whose state this one started from
  bool stands_still = false;       ///< prescribed motions of nodes and rigid bodies are none: bodies come to rest first
  Spin<Dim> frame_spin = Spin<Dim>::Zero();  ///< then: of a frame about the origin whose centrifugal forces act
  std::int64_t reconnections = 0;            ///< tables of points computed again
  Index surface_changes = 0;                 ///< times that nodes or cells of surfaces changed
  Index point_changes = 0;                   ///< times that points got other numbers
  Index num_eroded = 0;
  bool new_supports = false;  ///< velocities were prescribed since the last step
  Ledger ledger;
  ContactSums<Dim> contacts;
  AddedInertia added_inertia;  ///< of mass scaling

  World();
  World(const World&) = delete;
  World& operator=(const World&) = delete;
  ~World();

  Index num_bodies() const { return static_cast<Index>(bodies.size()); }
  /// Whether facets of a body do not pass other facets of it.
  bool has_self_contact(Index body) const {
    return options.contact.enabled && options.contact.self && !bodies[body].runs_together;
  }
  Index num_points() const { return static_cast<Index>(place_of_point.size()); }
  /// The nodes of a body.
  auto nodes_of(Index body) const { return std::views::iota(first_node[body], first_node[body + 1]); }
  /// A point of a chunk, as all bodies number their points.
  Index point_number(const Chunk<Dim>& chunk, Index p) const { return first_point[chunk.body] + chunk.number[p]; }
  /// The number of a chunk among these.
  std::size_t number_of(const Chunk<Dim>& chunk) const { return static_cast<std::size_t>(&chunk - chunks.data()); }
  /// The chunk that has a point, and the point's number there.
  std::pair<const Chunk<Dim>&, Index> locate(Index point) const {
    return {chunks[place_of_point[point].first], place_of_point[point].second};
  }
  /// The mean of gravity over a step from now on.
  Vec<Dim> mean_gravity(double dt) const {
    return gravity_law ? Vec<Dim>(0.5 * (gravity + gravity_law(time + dt))) : gravity;
  }
  /// The force per mass at a position at a time, of gravity_field alone. Throws InputError where it is not finite.
  Vec<Dim> field_at(const Vec<Dim>& x, double time) const;
  /// Mass of a node without mass scaling, on which gravity acts.
  double real_mass(Index node) const {
    const double added = nodes.added_mass.size() == 0 ? 0.0 : nodes.added_mass[node];
    return (nodes.mass[node] - added) / options.mass_scaling.factor;
  }
  /// N, likewise of all nodes.
  Vector real_masses() const {
    if (!options.mass_scaling.on()) return nodes.mass;
    const Vector own = nodes.added_mass.size() == 0 ? nodes.mass : Vector(nodes.mass - nodes.added_mass);
    return own / options.mass_scaling.factor;
  }
  bool axisymmetric() const { return Dim == 2 && options.plane == Plane::axisymmetric; }
  /// Length of the body out of the plane at a radius: of the full revolution, or one.
  double out_of_plane(double radius) const { return axisymmetric() ? 2.0 * std::numbers::pi * radius : 1.0; }

  /// Puts rows into the table of a chunk for these points, ascending; those of the others stay. Call find_node_chunks
  /// afterwards.
  void put_rows(Chunk<Dim>& chunk, const std::vector<Index>& points, const std::vector<TableRow>& rows) const;
  /// Likewise for all points.
  void put_rows(Chunk<Dim>& chunk, const std::vector<TableRow>& rows) const;
  /// Finds node_chunks, after tables have changed.
  void find_node_chunks();
  /// Finds first_point and place_of_point, after points were added to chunks or taken away.
  void find_points();
  /// A chunk gives these points, ascending and of whole pressure patches, to a new one after the last. Call find_points
  /// afterwards.
  void split_chunk(std::size_t chunk, const std::vector<Index>& points);
  /// Finds nodes.free, after velocities were prescribed or nodes have changed.
  void find_free_axes();
  /// Nodes of a scheme that makes them anew, at rest. bounds: the first node of each body, and one past the last.
  /// Velocities are prescribed by place.
  void replace_nodes(const Points<Dim>& x, const std::vector<Index>& bounds, double spacing);
  /// Asks the laws for the velocities in a step.
  void follow_motion_laws(double time, double dt);
  /// Forgets prescribed velocities of nodes and finds those by place.
  void find_prescribed_places();
  /// Room for more nodes after those of a body, at rest and without mass; others get later numbers.
  void insert_nodes(Index body, const Points<Dim>& at, const Points<Dim>& velocity, const Vector& spacing);
};

/// Calls visit(chunk) for all chunks of a world, concurrently.
template <class World, class Visit> void for_each_chunk(World& world, const Visit& visit) {
  parallel_chunks(static_cast<Index>(world.chunks.size()), 1, [&](Index c, Index) { visit(world.chunks[c]); });
}

/// Inserts columns before that one; no columns stay none.
template <int Dim> void insert_columns(Points<Dim>& columns, Index before, const Points<Dim>& more) {
  if (columns.cols() == 0) return;
  Points<Dim> result(Dim, columns.cols() + more.cols());
  result << columns.leftCols(before), more, columns.rightCols(columns.cols() - before);
  columns = std::move(result);
}

/// Where these points, ascending, are after Chunk::take, which returned `first`.
inline std::vector<Index> renumbered(const std::vector<Index>& points, const std::vector<Index>& first) {
  std::vector<Index> result;
  for (const Index p : points)
    for (Index q = first[p]; q < first[p + 1]; ++q) result.push_back(q);
  return result;
}

/// Renumbers a node after `count` new ones got the numbers from `first` on.
inline void shift_node(Index& node, Index first, Index count) {
  if (node >= first) node += count;
}

/// Seconds since `start`, which is now from now on.
double seconds_since(std::chrono::steady_clock::time_point& start);

}  // namespace efree
