// SPDX-License-Identifier: GPL-3.0-or-later
/// Explicit dynamics as an analysis: its settings, the model they make of a geometry, and a run that checks its energy
/// balance.
#pragma once

#include "efree/analysis/prepare.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/mpm/mpm.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/dynamics/schemes/sph/sph.hpp"
#include "efree/dynamics/surface_load.hpp"
#include "efree/geometry/mesh/summary.hpp"

#include <array>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace efree {

/// Initial velocities of a region.
template <int Dim> struct InitialVelocity {
  std::string region;                                 ///< empty: all of them
  std::function<Vec<Dim>(const Vec<Dim>&)> velocity;  ///< by position [length/time]
  std::string where{};
};
/// When points of a region break.
struct RegionFracture {
  std::string region{};  ///< empty: all that have none of their own
  FractureCriteria criteria{};
  std::string where{};
};
template <int Dim> struct WallSettings {
  Wall<Dim> wall;
  std::string where{};
};
template <int Dim> struct RigidBodySettings {
  RigidBody<Dim> body;
  std::string where{};
};
/// Prescribed velocities of the nodes on a part of the boundary (mpm, sph: of all within a cell, or spacing, of it), by
/// initial position and time. Empty components are free.
template <int Dim> struct BoundaryVelocity {
  std::string on;
  std::array<VelocityLaw<Dim>, Dim> velocity;
  bool depends_on_time = false;  ///< else the laws are asked once
  bool is_displacement = false;  ///< the laws are those of displacements, which begin with zero
  std::string where{};
};
/// Tractions, pressures, springs and dampers on a part of the boundary.
template <int Dim> struct BoundaryLoad {
  std::string on;
  SurfaceLoad<Dim> load;                         ///< without its part
  std::function<Vec<Dim>(double time)> force{};  ///< in all, spread evenly over the area at the start; empty: none
  std::string where{};
};
/// Gas inside a closed part of the boundary, as GasCavity has it.
struct GasFilling {
  std::string on;
  double pressure = 0.0, exponent = 1.4;
  std::string where{};
};
/// A number to report, or the motion of one node. Of the material point method points stand for nodes.
template <int Dim> struct DynamicsProbe {
  enum class Kind {
    largest,
    smallest,
    extent,      ///< the largest less the smallest
    node,        ///< displacement and velocity of the node (mpm: material point) nearest to a position at the start
    mean_force,  ///< component of the force of all bodies on a rigid body, mean over the time since the start
  };
  std::string name;
  Kind kind = Kind::largest;
  std::string field{};            ///< of material points, as in point_scalars; empty: of nodes, by `coordinate`
  ScalarField<Dim> coordinate{};  ///< by the positions of nodes
  Vec<Dim> at = Vec<Dim>::Zero();
  std::size_t rigid_body = 0;     ///< that the mean force is on
  int component = 0;              ///< of the mean force
  std::optional<double> truth{};  ///< of a number: what it would be without errors, where that is known
  /// Of a number: what this share of the nodes or points does not exceed (the smallest: fall below), above 0 to 1. 1:
  /// all of them.
  double share = 1.0;
  std::string region{};    ///< empty: all of them
  BoundingBox<Dim> box{};  ///< only nodes or points in it at the time count; empty: all do
  std::string where{};
};

enum class DynamicsMethod {
  otm,               ///< nodes at the vertices of the mesh, a material point in every cell
  total_lagrangian,  ///< shape functions of the static solver on the cloud of common.approximation
  mpm,               ///< material points on a lattice, splines of a grid
  sph,               ///< particles on a lattice, sums over their neighbours
};

/// Of the material point method.
struct MpmSettings {
  MpmOptions options{};    ///< the origin is a corner of the box around all bodies
  Index points_along = 2;  ///< material points along an edge of a cell
  MpmFrame frame = MpmFrame::updated;
};

/// Of smoothed particle hydrodynamics.
struct SphSettings {
  SphOptions options{};  ///< the origin is a corner of the box around all bodies
  SphFrame frame = SphFrame::updated;
};

/// A start from rest under the loads of time 0, before the initial velocities.
template <int Dim> struct StaticStart {
  double residual = 1e-7;  ///< as Dynamics::residual
  Index most_steps = 200000;
  Spin<Dim> spin = Spin<Dim>::Zero();  ///< of a rotation about the origin, in which the bodies are at rest [1/time]
  std::string where{};
};

/// A start from the state that an earlier run of the same bodies had at its end.
struct StateStart {
  std::string state{};      ///< as Dynamics::state of that run
  bool velocities = true;   ///< whether bodies begin with its velocities, or at rest
  std::string directory{};  ///< where its results are
  std::string where{};
};
/// Cauchy stresses of a region at the start [stress].
template <int Dim> struct InitialStress {
  std::string region{};  ///< empty: all that have none of their own
  std::function<Mat<3>(const Vec<Dim>&)> stress{};
  std::string where{};
};

/// An analysis by explicit dynamics. Of common.model the material and the plane count; common.approximation counts for
/// the total Lagrangian method.
template <int Dim> struct DynamicsSettings {
  CommonSettings<Dim> common{};
  DynamicsMethod method = DynamicsMethod::otm;
  OtmOptions otm{};                                           ///< of that method
  MpmSettings mpm{};                                          ///< likewise
  SphSettings sph{};                                          ///< likewise
  DynamicsOptions options{};                                  ///< of all methods; the plane is that of common.model
  double end = 0.0;                                           ///< [time]
  double max_step = std::numeric_limits<double>::infinity();  ///< [time]
  double residual = 0.0;  ///< Dynamics::residual at which a run after options.rest_from is at rest, and ends; 0: none
  double min_step = 0.0;  ///< [time], shorter steps end the run; 0: 1e-4 of the first, or of `end` if that is less
  /// Whether regions that share facets are one body there, as by otm and mpm they can be. Else they are in contact; by
  /// sph particles of bodies that meet are as those of one.
  bool tied = true;
  /// Gaps and overlaps between regions up to this are closed before the run begins (close_contacts) [length]; 0: none.
  double closed_gap = 0.0;
  /// Whether points near each other share their mean dilatation (pressure patches), against locking. Empty: all but
  /// those of fluids with artificial viscosity, which need none.
  std::optional<bool> pressure_patches{};
  std::function<Vec<Dim>(double time)> gravity{};  ///< force per mass [length/time^2]; empty: none
  bool gravity_depends_on_time = false;            ///< else it is asked once
  GravityField<Dim> gravity_field{};               ///< instead, where it depends on the position; empty: none
  std::vector<InitialVelocity<Dim>> initial_velocities{};
  std::optional<StaticStart<Dim>> static_start{};
  std::optional<StateStart> state_start{};
  std::vector<InitialStress<Dim>> initial_stresses{};  ///< at most one of a region
  std::vector<RegionFracture> fractures{};             ///< at most one of a region
  std::vector<WallSettings<Dim>> walls{};
  std::vector<RigidBodySettings<Dim>> rigid_bodies{};
  std::vector<BoundaryVelocity<Dim>> boundary_velocities{};
  std::vector<BoundaryLoad<Dim>> boundary_loads{};
  std::vector<GasFilling> gases{};
  std::vector<DynamicsProbe<Dim>> probes{};
  Index frames = 20;                  ///< over the run, besides that of the start
  Index history_lines = 1000;         ///< likewise, at most
  double checkpoint_interval = 60.0;  ///< [s]; infinity: no checkpoint but where a run is stopped
  double time_limit = std::numeric_limits<double>::infinity();  ///< [s] after which it is stopped
};

/// Whether bodies pass through each other.
template <int Dim> bool lacks_contact(const DynamicsSettings<Dim>& settings) {
  return settings.method == DynamicsMethod::total_lagrangian ||
         (settings.method == DynamicsMethod::mpm && settings.mpm.frame == MpmFrame::total) ||
         (settings.method == DynamicsMethod::sph && settings.sph.frame == SphFrame::total);
}

/// The mesh with its materials, as `prepare` makes it for static analyses; bodies that nothing holds stay, and
/// materials may be fluids. Throws InputError beginning with the place in the case file.
template <int Dim> PreparedMesh<Dim> prepare(const MeshSource<Dim>& source, const DynamicsSettings<Dim>& settings,
                                             const Monitor& monitor = {});

/// The node, or point, of a probe.
template <int Dim> struct ProbeNode {
  Index body = 0, number = 0;         ///< its number in its body
  Vec<Dim> start = Vec<Dim>::Zero();  ///< its position at the start
};

/// Bodies, boundary conditions and loads of a run.
template <int Dim> struct DynamicsModel {
  Dynamics<Dim> dynamics;
  std::vector<std::string> names;  ///< of the bodies: regions of the mesh
  BoundingBox<Dim> initial_box;    ///< of the nodes at the start
  /// By body, relative, where gaps were closed (ClosedContacts::volume_change); empty: none were.
  std::vector<double> volume_changes{};
  Vector point_sizes;  ///< edges of squares (cubes) with the areas (volumes) of the points at the start [length]
  std::vector<std::optional<ProbeNode<Dim>>> probe_nodes{};  ///< by probe
  bool probes_points = false;                                ///< whether probes look at material points, not at nodes
  std::vector<std::string> remarks{}, warnings{};

  /// The first node or point of a body, as probes look at them.
  Index first_probed(Index body) const {
    return probes_points ? dynamics.first_point(body) : dynamics.first_node(body);
  }
};

/// A body for every region of the mesh, with its material, density and velocities; walls, rigid bodies, prescribed
/// velocities and gases. Nodes on the axis of an axisymmetric section stay there. Throws InputError beginning with the
/// place in the case file for a material for small strains, a density that is missing,
/// unknown names, velocities that are not finite and bodies that overlap walls, rigid bodies or each other at the
/// start; and NumericalError as Dynamics does. Stages of approximate, bodies.
template <int Dim> DynamicsModel<Dim> build_dynamics_model(const PreparedMesh<Dim>& mesh,
                                                           const DynamicsSettings<Dim>& settings,
                                                           const Monitor& monitor = {});

/// Scalar fields of the material points: von_mises, pressure (both of Cauchy's stress), J, speed, damage (1: eroded)
/// the scalars of the materials' histories (0 in bodies without) and, where a body has a strength, utilisation.
template <int Dim> std::vector<std::pair<std::string, Vector>> point_scalars(const Dynamics<Dim>& dynamics);

/// Values of all probes now, in their order: one number; of nodes the displacement, then the velocity. NaN where no
/// node or point is in the box.
template <int Dim>
std::vector<std::pair<std::string, std::vector<double>>> measure_probes(const DynamicsSettings<Dim>& settings,
                                                                        const DynamicsModel<Dim>& model);

/// What outputs call a wall or a rigid body: "wall.0", "rigid_body.0".
std::string rigid_partner_name(const ContactPartner& partner);

/// Error of the energy balance from which on there is a warning.
inline constexpr double warned_imbalance = 0.01;
/// Estimated error of forces by mass scaling (AddedInertia::error) from which on there is a warning.
inline constexpr double warned_inertia = 0.05;
/// Change of a region's volume by closed gaps, relative, from which on there is a warning.
inline constexpr double warned_volume_change = 0.001;
/// Dynamics::imbalance of given stresses from which on there is a warning.
inline constexpr double warned_stress_imbalance = 0.1;
/// Share of clumped particles above which there is a warning.
inline constexpr double warned_clumped = 0.015;
/// Energy lost by reconnection, over the largest energy, from which on there is a warning.
inline constexpr double warned_reconnection = 0.1;
/// Error of the energy balance at the end of a run that rejects it, or DynamicsOptions::imbalance if that is less.
inline constexpr double rejected_imbalance = 0.05;

/// Functions that a run calls; empty ones are not called.
struct DynamicsObserver {
  std::function<void()> history_line, frame, checkpoint;
};

struct DynamicsOutcome {
  std::string stop_reason{};         ///< why it ended before its time, or was rejected; empty: neither
  bool can_resume = false;           ///< it was stopped by the time limit
  std::optional<double> residual{};  ///< the last that was looked at, of a run that is to come to rest
  bool at_rest = false;              ///< whether it has
  double seconds = 0.0;              ///< of this run, by the clock
};

/// Steps until settings.end, or rest. Calls the observer's `history_line` and `frame` at the start and after steps that
/// pass their times, the last one included, so that steps do not depend on them; `checkpoint` by the clock, and before
/// it throws Cancelled. monitor.detail gets time, step, error of the energy balance and time to go. Throws
/// NumericalError as Dynamics does. Stage: dynamics.
template <int Dim> DynamicsOutcome run_dynamics(DynamicsModel<Dim>& model, const DynamicsSettings<Dim>& settings,
                                                const DynamicsObserver& observer, const Monitor& monitor = {});

/// Why the result may be inaccurate; those of the model come first.
template <int Dim> std::vector<std::string> collect_warnings(const DynamicsSettings<Dim>& settings,
                                                             const DynamicsModel<Dim>& model,
                                                             const DynamicsOutcome& outcome = {});

}  // namespace efree
