// SPDX-License-Identifier: GPL-3.0-or-later
/// What Otm is made of.
#pragma once

#include "efree/basis/internal/neighbours.hpp"
#include "efree/otm/internal/chunk.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <functional>
#include <memory>
#include <numbers>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace efree::internal {

using Clock = std::chrono::steady_clock;

/// Seconds since then, which is now from now on.
inline double lap(Clock::time_point& start) {
  const Clock::time_point now = Clock::now();
  return std::chrono::duration<double>(now - std::exchange(start, now)).count();
}

/// Of functions with that moment J, along the axis where they are narrowest.
template <int Dim> double smallest_width(const Mat<Dim>& moment) {
  Eigen::SelfAdjointEigenSolver<Mat<Dim>> axes;
  axes.computeDirect(moment, Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(axes.eigenvalues()[0], 0.0));
}

/// Moment of a force about the origin.
template <int Dim> Spin<Dim> torque_of(const Vec<Dim>& at, const Vec<Dim>& force) {
  if constexpr (Dim == 2)
    return Spin<2>(at[0] * force[1] - at[1] * force[0]);
  else
    return at.cross(force);
}

template <int Dim> struct Motion {
  struct BodyOf {
    SharedMaterial material;
    std::array<double, 108> tangent;     ///< at rest, as otm_stiffness takes it
    std::array<double, 108> compliance;  ///< likewise; of turns as of shear
    double shear, modulus;               ///< against shear, and of pressure waves
    bool renewed;                        ///< whether functions are
    bool integrates;                     ///< whether gradients are made to integrate exactly
    bool finite;                         ///< whether the material is for finite strains
    bool has_surface;                    ///< that walls act on; else they act on the nodes
    Index mass_terms;                    ///< 1: lumped masses
    OtmFracture fracture;
    Index plastic_strain, temperature;  ///< rows of the history, equivalent and its rise; -1: none
    Index plastic_metric;               ///< first of the rows of C_p^-1 - 1; -1: none
    double release;                     ///< C of its energy release rates
    Cells<Dim> cells;                   ///< around the points; nodes as the body numbers them
    Index first_node, first_point;
    std::vector<std::pair<Index, Index>> outer{};  ///< edges of the cells (outer_edges); none: not known
  };
  struct Prescribed {
    Index node;
    int axis;
    double velocity;
  };

  /// Of points: nodes and functions.
  using Rows = std::vector<std::vector<std::pair<Index, OtmEntry>>>;

  OtmOptions options;
  std::vector<Index> sizes;  ///< nodes and points of each body at the start
  std::vector<BodyOf> bodies;
  Points<Dim> x, v, force;  ///< force: of all but walls, tools and what is prescribed
  Points<Dim> x_rest;       ///< what rounding has kept from x so far
  Points<Dim> was;          ///< v a step ago
  Vector mass;
  std::vector<OtmChunk<Dim>> chunks;
  std::vector<Index> all_chunks;                        ///< their numbers
  std::vector<std::pair<Index, Index>> place_of_point;  ///< chunk and number there
  // By node: who sees it.
  std::vector<Index> node_offsets;
  std::vector<std::pair<Index, Index>> node_places;  ///< chunk and number there
  std::vector<const double*> node_forces;            ///< of these, as find_places finds them
  std::vector<Prescribed> prescribed;
  Vec<Dim> acceleration = Vec<Dim>::Zero();  ///< force per mass on all that has a mass
  Points<Dim> free;                          ///< 0 for what is prescribed, else 1
  bool changed_nodes = false;                ///< nodes are about to become one, or to come in
  bool held_anew = false;                    ///< more is prescribed than the shape of the fastest vibration knows of

  std::vector<std::unique_ptr<Neighbours<Dim>>> trees;  ///< by body, of nodes
  std::vector<double> drift;                            ///< by body, how far nodes have gone since then, at the most
  Vector spacing;                                       ///< by node, at the start
  double time = 0.0, last_step = 0.0, stable = 0.0, first_stable = 0.0;
  double contact_loss = 0.0, renewal_loss = 0.0, fracture_loss = 0.0, prescribed_work = 0.0, weight_work = 0.0;
  Vector dissipated;                     ///< by chunk, so far
  Vector viscous;                        ///< likewise
  Vector stored;                         ///< by chunk
  Points<Dim> shaken;                    ///< the shape of the fastest vibration, as far as it is known
  Index next_look = 0, looks_apart = 0;  ///< steps: when it is looked for again
  double longest_seen = 0.0;             ///< stable step, the last time
  std::int64_t renewals_seen = 0;        ///< of all points until then
  /// Room that steps do not have to allocate.
  Points<Dim> nodal_impulses, nodal_changes, rubbed;
  std::vector<Points<Dim>> krylov_shapes;
  std::array<Points<Dim>, 2> krylov_impulses;
  mutable Points<Dim> seen_by_mass;
  EnergyWatch watch;  ///< of energy, when it was last looked at
  OtmCounts counts;
  OtmTimes times;

  bool axisymmetric() const { return Dim == 2 && options.plane == Plane::axisymmetric; }
  /// Length of what lies across the plane at a radius: of the turn around the axis, or one.
  double across(double radius) const { return axisymmetric() ? 2.0 * std::numbers::pi * radius : 1.0; }

  Motion(std::vector<OtmBody<Dim>> given, const OtmOptions& options_given);
  bool find_functions(const OtmChunk<Dim>& chunk, Index p, bool first, Mat<Dim>& metric, Vec<Dim>& lambda,
                      LmeFunctions<Dim>& functions, std::vector<Index>& used, OtmCounts& counted) const;
  void make_particles(OtmChunk<Dim>& chunk, std::span<const Index> which, Rows& rows) const;
  bool keep_functions(OtmChunk<Dim>& chunk, Index p, std::vector<std::pair<Index, OtmEntry>>& row,
                      std::vector<Index>& kept) const;
  std::string has_no_functions(const OtmChunk<Dim>& chunk, Index p) const;
  /// Of points of a chunk.
  struct Change {
    Rows rows;                     ///< their functions from now on
    std::vector<Index> lost;       ///< those that have none, nor any to keep, or are crushed: rows are empty
    std::vector<Index> kept;       ///< those that go on with the functions they had, and what they do not see
    std::vector<Index> stiffened;  ///< those whose functions are stiffer than they were
    OtmCounts counted;
    double unseen = 0.0;  ///< energy of the motions that they do not see
    void add(Change&& more);
  };
  Change make_functions(OtmChunk<Dim>& chunk, std::span<const Index> which, bool first) const;
  void join(OtmChunk<Dim>& chunk, Change& change) const;
  Rows rows_of(const OtmChunk<Dim>& chunk, const ShapeTable<Dim>& shape) const;
  void put_rows(OtmChunk<Dim>& chunk, const std::vector<Index>& which, const Rows& rows);
  void find_places();
  void move_tables() const;
  // Gradients that integrate exactly.
  Points<Dim> integration_error();
  /// Of a chunk, as otm_weight_changes takes and gives them.
  struct WeightChanges {
    OtmTable<double> x, at, multipliers;
    std::vector<Mat<3>> inverse, moment;
    std::vector<double> weight;  ///< by how much they change
  };
  void find_changes(const OtmChunk<Dim>& chunk, const Points<Dim>& multipliers, WeightChanges& found) const;
  Points<Dim> integrated_changes(const Points<Dim>& multipliers);
  void change_weights(const Points<Dim>& multipliers);
  void integrate_exactly();
  void deform(OtmChunk<Dim>& chunk, const Points<Dim>& of) const;
  void place(OtmChunk<Dim>& chunk, Index p) const;
  void place_anew(OtmChunk<Dim>& chunk, Index p) const;
  void place(OtmChunk<Dim>& chunk, Index p, const double* rows) const;
  void hold(OtmChunk<Dim>& chunk, Index p, const Mat<3>& before) const;
  bool hold_crushed(OtmChunk<Dim>& chunk, Index p) const;
  void collect(Points<Dim>& forces, const std::vector<char>& of = {}) const;
  Points<Dim> collected() const;
  Mat<3> gradient(const double* rows, double across) const;
  void push(OtmChunk<Dim>& chunk, const std::vector<Mat<3>>& since) const;
  void sweep(double dt);
  void sweep(Index number, double dt);
  OtmStrains examine(OtmChunk<Dim>& chunk, bool holds) const;
  void require_small_strains(const OtmChunk<Dim>& chunk) const;
  void share_dilatation(OtmChunk<Dim>& chunk) const;
  void press(OtmChunk<Dim>& chunk) const;
  void weigh();
  void build_tree(Index body);
  void follow_nodes(Index body);
  void renew();
  void follow_others();
  void become_one(Index a, Index with);
  /// Between two nodes of a body, and the cells around it.
  struct Split {
    Index a, b;
    Vec<Dim> middle;
    std::vector<Index> cells;
  };
  std::vector<Split> overlong_edges(Index body);
  void add_nodes(Index body, const Points<Dim>& at, const Points<Dim>& velocity, const Vector& spacings);
  void inject();
  void pair_points();
  void fuse_pairs();
  void find_points();
  bool holds_as(Index a, Index other) const;
  void give_up_nodes();
  void merge_nodes();
  void spread(OtmChunk<Dim>& chunk, Index p, const Vec<Dim>& n, double width) const;
  const std::vector<std::pair<Index, Index>>& outer_edges(Index of_body);
  bool merge(Index a, Index with, Index of_chunk, Index of_point, std::set<Index>& locked, double wide);
  struct PointRow {
    Index point;
    const std::vector<std::pair<Index, OtmEntry>>* row;  ///< its functions from now on
  };
  void hand_over(const OtmChunk<Dim>& chunk, const std::vector<PointRow>& rows, Vector& masses,
                 Points<Dim>& momenta) const;
  double unseen(const OtmChunk<Dim>& chunk, Index p, double ago = 0.0) const;
  // Fracture. Points are numbered through all bodies.
  std::vector<Index> ball_offsets, balls;               ///< by point: those in its ball, itself too; empty: not known
  Vector ball_mass;                                     ///< by point
  std::vector<std::vector<Index>> star_offsets, stars;  ///< by body and node: cells around it that are not eroded
  bool breaks() const;
  /// Whether points of this body that have no functions, or would be turned inside out, join another (functions.cpp).
  bool joins(const BodyOf& body) const {
    return body.renewed && !body.fracture.on() && options.functions == OtmFunctions::lme;
  }
  static constexpr double least_left = 0.3;  ///< of a point's volume by a step that does not crush it
  /// Whether a step turns a point inside out, or nearly so, by its volume over that before.
  static bool would_crush(double shrinks) { return !(shrinks > least_left); }
  void find_stars();
  void keep_connected(Index body, Index point, std::vector<Index>& nodes) const;
  void find_balls();
  void wear_down(OtmChunk<Dim>& chunk) const;
  Vector tension_energies() const;
  double release_rate(Index point, const Vector& energies) const;
  Vector release_rates(const Vector& energies) const;
  void fracture();
  void erode(const std::vector<Index>& broken);
  double longest_way() const;
  void move(double kick, double dt);
  void stiffen();
  void stiffness_times(const Points<Dim>& shape, std::span<const Index> in, const std::vector<char>& moving,
                       Points<Dim>& result);
  double highest_frequency2(Points<Dim>& shape, Index most, std::span<const Index> in, const std::vector<char>& moving);
  void shake(Index most);
  void shake_near(const std::vector<char>& nodes, Points<Dim> shape, Index most);
  static constexpr Index least_apart = 4;  ///< steps from one look to the next
  bool is_time_to_look() const {
    return counts.steps % least_apart == 0 &&
           (counts.steps >= next_look || counts.renewals != renewals_seen || !touches.empty());
  }
  /// Of a point's viscous pressure.
  struct Viscosity {
    double length;   ///< spacing of nodes along the fastest compression
    double sound;    ///< speed
    double highest;  ///< frequency that the point may have, at the most
    /// Of the critical one at that frequency, by a pressure of density times length times this times rate.
    double damping(double speed) const { return 0.5 * highest * length * speed / (sound * sound); }
  };
  Viscosity viscosity_of(const OtmChunk<Dim>& chunk, Index p, const Mat<3>& before) const;
  void foresee_damping();
  void shock(OtmChunk<Dim>& chunk, Index p, const Mat<3>& before, double dt) const;

  // Contact of bodies.
  /// A node and its patch of another body's surface.
  struct Held {
    Index node;
    double weight;   ///< of it in the point below the touching node
    Vec<Dim> lever;  ///< forces along the normal of this times s sum up to nothing, and to the moment s x normal
  };
  /// A spring between them. It is compressed as far as the work it has taken allows: it gives back no more.
  struct Touch {
    Index node;
    double stiffness;
    Vec<Dim> normal;              ///< out of the other body
    std::array<Held, Dim> patch;  ///< the nodes of a facet
    double gap = 0.0;             ///< negative
    double depth = 0.0;           ///< how far it is compressed, at most -gap
    double energy = 0.0;          ///< work it has taken and not given back
  };
  struct Surface {
    Facets<Dim> facets;        ///< outwards; none on an axis
    std::vector<Index> nodes;  ///< of them
  };
  struct Near {
    Index node, body;
    std::vector<Index> facets;  ///< of that body
  };
  std::vector<Surface> surfaces;  ///< by body
  Vector surface_area;            ///< by node; axisymmetric of the full turn
  std::vector<Near> approaching;
  Points<Dim> seen_at;                                            ///< where nodes were when these were found
  Points<Dim> met;                                                ///< where nodes were when touches were found
  std::vector<Touch> touches, touching;                           ///< of the last step; room for those of this one
  std::vector<std::pair<std::pair<Index, Index>, double>> taken;  ///< room: energies by node and other body
  Vector pressed;                                                 ///< room: stiffness of springs by node
  std::vector<Index> passed;                                      ///< points that were in another body; ascending
  std::vector<std::pair<Index, Index>> seized;  ///< nodes, and bodies whose nodes their points see too; ascending
  void seize();
  void partners_of(const OtmChunk<Dim>& chunk, Index p, std::vector<Index>& partners) const;
  struct Cavity {
    OtmCavity<Dim> of;
    double volume;  ///< at the start; negative by orientation
    double stored = 0.0;
  };
  std::vector<Cavity> cavities;
  double contact_stored = 0.0;
  std::vector<Index> body_of_node;
  std::vector<Index> merged;  ///< the node that it is one with, which is none of these; -1: it is its own
  // Bodies with masses that are not lumped, or a surface of their own. Their nodes stay the same.
  bool fixed = false;   ///< whether there are any; else what follows is empty
  SparseRows coupling;  ///< consistent mass between nodes of bodies with more than one term
  Points<Dim> nodal_momentum;
  Points<Dim> pull;  ///< coupling with all nodes that are free
  void find_masses();
  void raise_light_masses(Index body);
  void find_free();
  void find_momenta();
  void find_velocities(const Points<Dim>& impulses, Points<Dim>& velocities) const;
  Points<Dim> velocities_of(const Points<Dim>& impulses) const;
  Vec<Dim> momentum_of(Index a) const {
    return bodies[body_of_node[a]].mass_terms > 1 ? Vec<Dim>(nodal_momentum.col(a)) : Vec<Dim>(mass[a] * v.col(a));
  }

  // Walls and tools.
  struct Tool {
    OtmTool<Dim> of;
    bool is_wall;  ///< a plane that stays where it is
    ToolState<Dim> now, before;
    std::vector<Index> near{};  ///< points of surfaces that may come to it soon, ascending
    Points<Dim> impulses{};     ///< on them in the last step
    double travelled = 0.0;     ///< since these were found [length]
    // In this step.
    Vec<Dim> pushed = Vec<Dim>::Zero();    ///< impulse of the bodies
    Spin<Dim> turned = Spin<Dim>::Zero();  ///< its moment about the centre
    void take(const Vec<Dim>& at, const Vec<Dim>& impulse);
    /// Of what moves with it, a step ago and now, on average.
    Vec<Dim> mean_velocity(const Vec<Dim>& at) const {
      return 0.5 * (velocity_of<Dim>(before, at) + velocity_of<Dim>(now, at));
    }
  };
  /// A node that a tool holds back.
  struct Hit {
    std::size_t tool;
    Index node;
    Vec<Dim> impulse;
  };
  std::vector<Tool> tools;
  std::vector<ToolGap<Dim>> gaps;  ///< by node, to the tool that is looked at
  std::vector<Hit> hits;           ///< in this step
  void add_tool(const OtmTool<Dim>& tool, bool is_wall);
  void lead(Tool& tool, double at_time) const;
  void find_gaps(const Tool& tool);
  Vec<Dim> stop_at(const Tool& tool, Index a, double dt, Mat<Dim>* slope) const;
  void yield_to_nodes(Tool& tool, double dt) const;
  void hold_back(double kick, double dt);
  void move_tools(double kick, double dt);

  // The surfaces of bodies that have them, which walls and tools act on.
  SparseRows surface_points;   ///< functions at the points of all surfaces
  double surface_skin = 0.0;   ///< gap below which points are near [length]
  double surface_reach = 1.0;  ///< how much further than nodes such points may go, at the most
  Points<Dim> looked;          ///< where nodes were when the points near tools were found
  void take_surfaces(const std::vector<OtmBody<Dim>>& of);
  Vec<Dim> at_surface_point(Index s, const Points<Dim>& of) const;
  void find_near_tools();
  void stop_surfaces(Tool& tool, double dt);
  bool has_contact() const { return (options.contact.seizing || options.contact.stiffness > 0.0) && bodies.size() > 2; }
  void find_surface();
  Mat<Dim> corners(const Facets<Dim>& facets, Eigen::Index f) const;
  void find_near();
  bool find_touch(const Near& of, Touch& touch) const;
  struct FacetTree;
  std::vector<Index> points_in_others() const;
  void find_passed();
  void soften(std::vector<Touch>& springs);
  void touch();
  double enclosed(const Facets<Dim>& facets, const std::function<void(Index, const Vec<Dim>&)>& slope) const;
  void inflate();
  void rub(double kick);
  void resist(const Points<Dim>& moved, Points<Dim>& forces) const;
};

}  // namespace efree::internal
