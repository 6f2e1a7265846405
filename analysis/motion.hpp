// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies in motion as an analysis: what they are told, from a geometry to Otm, and a run with its balance watched.
#pragma once

#include "efree/analysis/prepare.hpp"
#include "efree/geometry/mesh/summary.hpp"
#include "efree/otm/otm.hpp"

#include <array>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace efree {

/// Velocities at the start.
template <int Dim> struct InitialVelocity {
  std::string region;                                 ///< empty: of all bodies
  std::function<Vec<Dim>(const Vec<Dim>&)> velocity;  ///< by place [length/time]
  std::string where{};
};
/// When points break.
struct BodyFracture {
  std::string region{};  ///< empty: of all bodies
  OtmFracture fracture{};
  std::string where{};
};
/// A rigid wall.
template <int Dim> struct MotionWall {
  OtmWall<Dim> wall;
  std::string where{};
};
/// A rigid tool.
template <int Dim> struct MotionTool {
  OtmTool<Dim> tool;
  std::string where{};
};
/// Nodes of a part of the boundary whose velocities are prescribed, by place; those left empty are free.
template <int Dim> struct MovedPart {
  std::string on;
  std::array<ScalarField<Dim>, Dim> velocity;
};
/// Gas inside a part of the boundary that closes, by its name.
struct GasInside {
  std::string on;
  double pressure = 0.0, exponent = 1.4;  ///< as in OtmCavity
  std::string where{};
};
/// A number to report, or the motion of one node.
template <int Dim> struct MotionProbe {
  enum class Of {
    largest,
    smallest,
    extent,  ///< the largest less the smallest
    node,    ///< displacement and velocity of the node that is nearest to a place at the start
  };
  std::string name;
  Of of = Of::largest;
  std::string field{};       ///< of material points, as in point_scalars; empty: of nodes, by `place`
  ScalarField<Dim> place{};  ///< by where nodes are
  Vec<Dim> at = Vec<Dim>::Zero();
  std::string region{};    ///< empty: of all bodies
  BoundingBox<Dim> box{};  ///< only what is in there at the time; empty: everywhere
  std::string where{};
};

/// What bodies in motion are told besides Settings, of which title, materials, densities, model.plane, the parts of the
/// boundary, the approximation (see `cloud`) and where things were said count.
template <int Dim> struct MotionSettings {
  double end = 0.0;                                           ///< [time]
  double max_step = std::numeric_limits<double>::infinity();  ///< [time]
  double min_step = 0.0;  ///< [time], steps below it end the run; 0: a thousandth of the first stable one
  OtmOptions options{};   ///< but for the plane
  /// Nodes on the coarse cloud of settings.approximation with the functions of the static solver; else nodes at the
  /// vertices of the mesh, and a point in every cell.
  bool cloud = false;
  /// Whether points that are near each other share their dilatation, against locking. Empty: all but those of fluids
  /// with shock viscosity, which need none.
  std::optional<bool> shared_dilatation{};
  Vec<Dim> acceleration = Vec<Dim>::Zero();  ///< force per mass, as Otm::accelerate takes it [length/time^2]
  std::vector<InitialVelocity<Dim>> velocities{};
  std::vector<BodyFracture> fractures{};  ///< of a region one at most; that of all bodies is of those without
  std::vector<MotionWall<Dim>> walls{};
  std::vector<MotionTool<Dim>> tools{};
  std::vector<MovedPart<Dim>> moved{};
  std::vector<GasInside> gases{};
  std::vector<MotionProbe<Dim>> probes{};
  std::string colour{};      ///< field of points that pictures show; empty: plastic strain if known, else von Mises
  Index frames = 20;         ///< over the run, besides that of the start
  Index lines = 1000;        ///< of the history, likewise: as many at most
  double checkpoint = 60.0;  ///< [s] between checkpoints; infinity: none but where a run is stopped
  double time_limit = std::numeric_limits<double>::infinity();  ///< [s] after which it is stopped
};

/// Bodies that are ready to move.
template <int Dim> struct MovingBodies {
  Otm<Dim> otm;
  std::vector<std::string> names;      ///< of the bodies: regions of the mesh
  Points<Dim> start;                   ///< where nodes are at the start
  Vector size;                         ///< of points at the start: the edges of squares (cubes) as large [length]
  std::vector<Index> nodes_of_probes;  ///< -1: a probe of no node
  std::vector<std::string> remarks{}, warnings{};
};

/// A body for every region of the mesh, with its material, density, velocities, what moves it, walls and tools. Nodes
/// on the axis of an axisymmetric section stay there. Throws InputError beginning with where it was said, for forces in
/// the bodies among settings.loads, which are of statics, a material of small strains, a density that is missing, names
/// that are not there, velocities that are no numbers and bodies that reach into walls or tools at the start; and
/// NumericalError as Otm does. Stages of approximate, bodies.
template <int Dim> MovingBodies<Dim> set_in_motion(const PreparedMesh<Dim>& mesh, const Settings<Dim>& settings,
                                                   const MotionSettings<Dim>& motion, const Monitor& monitor = {});

/// The scalar fields of material points: von_mises, pressure (both of Cauchy's stress), J, damage (1: eroded) and what
/// histories hold (zero where a body's material knows of none).
template <int Dim> std::vector<std::pair<std::string, Vector>> point_scalars(const Otm<Dim>& otm);

/// What a probe says now: one number; of nodes the displacement, then the velocity. NaN where nothing is in its box.
template <int Dim> std::vector<double> measure(const MotionProbe<Dim>& probe, const MovingBodies<Dim>& bodies,
                                               const std::vector<std::pair<std::string, Vector>>& scalars, Index node);
/// All of them, in their order.
template <int Dim> std::vector<std::pair<std::string, std::vector<double>>> measure(const MotionSettings<Dim>& motion,
                                                                                    const MovingBodies<Dim>& bodies);

/// Error of the energy balance that is warned of.
inline constexpr double warned_imbalance = 0.01;
/// What changes of functions took, over the most energy there was, beyond which that is warned of.
inline constexpr double warned_renewal = 0.1;
/// Error of the energy balance with which a run that got to its end is none, or OtmOptions::imbalance if less.
inline constexpr double refused_imbalance = 0.05;

/// Who hears of a run; what is empty is not called.
struct MotionWatcher {
  std::function<void()> line, frame, checkpoint;
};

/// How a run went.
struct MotionEnd {
  std::string refusal{};   ///< why it ended before its time; empty: it did not
  bool can_go_on = false;  ///< it was stopped by the time limit
  double seconds = 0.0;    ///< of this run, by the clock
};

/// Steps until motion.end. `watcher.line` and `watcher.frame` are called at the start and after the steps that pass
/// their times, the last one included, so that steps do not depend on them; `checkpoint` by the clock, and before
/// Cancelled is thrown. monitor.detail hears of time, step, balance and time to go. Throws NumericalError as Otm does.
/// Stage: motion.
template <int Dim> MotionEnd run_motion(MovingBodies<Dim>& bodies, const MotionSettings<Dim>& motion,
                                        const MotionWatcher& watcher, const Monitor& monitor = {});

}  // namespace efree
