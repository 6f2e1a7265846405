// SPDX-License-Identifier: GPL-3.0-or-later
/// Explicit dynamics by optimal transportation (Li, Habbal & Ortiz 2010; Mota et al. 2020, SAND2020-9716).
#pragma once

#include "efree/basis/lme.hpp"
#include "efree/otm/body.hpp"
#include "efree/otm/tool.hpp"

#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace efree {

namespace internal {
template <int Dim> struct Motion;
}

/// The functions of points that get no table.
enum class OtmFunctions {
  lme,  ///< local maximum entropy
  /// Smoothed particles, for comparison: nodes are the points, and gradients are those of a cubic spline as wide as 1.3
  /// spacings, made to reproduce linear functions (Randles & Libersky 1996), anew in every step. Bodies in tension
  /// clump (Swegle, Hicks & Attaway 1995).
  smoothed_particles,
};

/// What nodes get of a point's momentum when its functions change.
enum class OtmMomentum {
  /// Velocities of the nodes stand, corrected by the least affine motion that keeps the point's momentum and moment of
  /// momentum: both are conserved to rounding, and next to no energy is lost.
  affine,
  /// Velocities of the nodes stand, whatever their masses become (SAND2020-9716, eq. 2.14): momentum is not conserved.
  nodes,
  /// N_a times the point's momentum (Li 2009): momentum is conserved, moment of momentum is not, and energy is lost.
  points,
};

/// Pressure against compression, without which shocks ring and turn points inside out: rho l d (linear c + quadratic l
/// d) where volume shrinks at the rate d, with l the spacing of nodes along the fastest compression and c the speed of
/// pressure waves (von Neumann & Richtmyer 1950; Landshoff 1955). What it takes is heat of the point
/// (Deformation::heat).
struct ShockViscosity {
  double linear = 0.0, quadratic = 0.0;
  bool on() const { return linear > 0.0 || quadratic > 0.0; }
};

/// How bodies meet. Nodes of a surface that have got through another body's are pushed back to the nearest point of it
/// by springs, and its nodes from them: momenta are conserved to rounding, energy as far as the distance to a surface
/// of facets is smooth.
struct OtmContact {
  double stiffness = 1.0;  ///< of the surfaces against each other, over that of a layer of nodes; 0: bodies pass freely
  double friction = 0.0;   ///< Coulomb's coefficient
  /// No springs: where bodies come within three tenths of a spacing of each other, points next to both get functions of
  /// the nodes of both, and the bodies move as one from there on (Li, Habbal & Ortiz 2010). Momenta are conserved to
  /// rounding; what a sudden common motion takes is counted with renewals.
  bool seizing = false;
};

/// How bodies move.
struct OtmOptions {
  Plane plane = Plane::strain;  ///< strain or axisymmetric; of no meaning in space
  OtmFunctions functions = OtmFunctions::lme;
  LmeOptions lme{.gamma = 2.5, .cutoff = 1e-4};
  /// A point's functions are renewed when its strain since they were made (Green's, its norm) exceeds this. In between
  /// they stand still, as in a total Lagrangian method: exact in affine motions, and energy is conserved. 0: every
  /// step.
  double renewal = 0.2;
  /// Whether the functions that points of bodies with cells have at the start are changed, as little as it takes, so
  /// that gradients integrate exactly (Chen, Hillman & Rueter 2013). Without, bodies on careless meshes are too soft,
  /// and waves converge with order one at best. Not with renewal = 0.
  bool exact_integration = true;
  /// Largest ratio of the axes of a function's support, which the motion stretches; 1: balls.
  double anisotropy = 3.0;
  /// When the stable step gets shorter than this, over the first one, nodes that squeeze functions to less than this,
  /// over their first width, become one with the next. 0: never.
  double merging = 0.4;
  /// Where bodies with cells stretch, edges between nodes get a node into their middle when they are longer than this,
  /// over the spacing at the start, with no other node near; cells and points around them become two. 0: never.
  double injection = 0.0;
  OtmMomentum momentum = OtmMomentum::affine;
  double courant = 0.5;  ///< of the step that is stable by the highest frequency that is found
  /// Of what stiffness motions of the nodes get that their points do not see, by the shear modulus over the square of
  /// the functions' width (Weissenfels & Wriggers 2018). Under pressure they get more (docs/theory.md).
  double stabilisation = 0.1;
  /// Error of the energy balance, over the most energy there was so far, with which bodies go no further: what came out
  /// could be anything. Looked at every 64 steps, eight times in a row: where there is little of it, it may swing.
  double imbalance = 0.1;
  ShockViscosity shock{};
  OtmContact contact{};
};

/// Gas inside a closed surface of nodes, which keeps p V^exponent.
template <int Dim> struct OtmCavity {
  Facets<Dim> facets;     ///< of nodes, oriented alike; one way or the other
  double pressure = 0.0;  ///< at the start, over that outside
  double exponent = 1.4;
};

/// Sums over all bodies, and tools that have a mass. In the plane per unit thickness; axisymmetric per full turn.
template <int Dim> struct OtmBalance {
  double kinetic = 0.0, stored = 0.0, dissipated = 0.0;  ///< energies; stored: in materials and cavities
  double stabilising = 0.0;                              ///< energy of the motions that points do not see
  double viscous = 0.0;                                  ///< heat of shock viscosity
  double contact = 0.0;                                  ///< energy lost in contact, or stored in it
  double renewal = 0.0;                                  ///< energy lost where functions changed
  double fracture = 0.0;                                 ///< energy lost with points that broke
  double prescribed = 0.0;                               ///< work of prescribed velocities, of tools too
  double weight = 0.0;                                   ///< work of the force per mass (Otm::accelerate)
  Vec<Dim> momentum = Vec<Dim>::Zero();                  ///< half a step ago
  Vec<Dim == 2 ? 1 : 3> moment;                          ///< of momentum, about the origin
  /// All of it; constant but for the integration in time.
  double total() const {
    return kinetic + stored + dissipated + stabilising + viscous + contact + renewal + fracture - prescribed - weight;
  }
};

/// How well energy is accounted for.
struct EnergyWatch {
  double start = 0.0;     ///< what there was of it
  double scale = 0.0;     ///< the most there was of it so far, at least what rounding makes
  double off = 0.0;       ///< what is missing (negative) or too much now, with what changes of functions have made
  double furthest = 0.0;  ///< the same where it was worst
  Index beyond = 0;       ///< times in a row that it was off by more than OtmOptions::imbalance
  bool begun = false;

  double error() const { return scale > 0.0 ? off / scale : 0.0; }
  double largest_error() const { return scale > 0.0 ? furthest / scale : 0.0; }
  template <int Dim> void look(const OtmBalance<Dim>& now);
};

/// What a run has done so far.
struct OtmCounts {
  Index steps = 0;
  std::int64_t updates = 0;     ///< of material points
  std::int64_t renewals = 0;    ///< functions of a point made anew
  std::int64_t iterations = 0;  ///< of Newton's method for them
  Index merged = 0;             ///< nodes that became one with another
  Index injected = 0;           ///< nodes that came in
  Index fused = 0;              ///< points that became one with another
  Index joined = 0;             ///< points that had no functions, or were to be turned inside out, and took another's
  Index eroded = 0;             ///< points that broke
  Index passed = 0;             ///< points that got through the surface of another body
  std::int64_t kept = 0;        ///< of them those that a point had, as there were no others
  std::int64_t widened = 0;     ///< of them with the nodes they had, as the point was outside the hull of the new ones
};

/// Where time goes [seconds]: of all threads for what is done point by point (kinematics, materials, forces), else by
/// the clock.
struct OtmTimes {
  double functions = 0.0;   ///< search, Newton's method, hand-over of momentum
  double kinematics = 0.0;  ///< deformation gradients
  double materials = 0.0, forces = 0.0;
  double stability = 0.0;  ///< the stable step
  double nodes = 0.0;      ///< motion and walls
  double contact = 0.0;    ///< of bodies
  double fracture = 0.0;   ///< whether points break
};

/// Bodies in motion. Nodes carry positions and velocities, points F, stress and history; leapfrog in time, momentum
/// conserved. Bitwise the same on any number of threads.
template <int Dim> class Otm {
 public:
  /// Throws InputError for bodies or options that make no sense and NumericalError for a point outside of its nodes.
  Otm(std::vector<OtmBody<Dim>> bodies, const OtmOptions& options = {});
  Otm(Otm&&) noexcept;
  Otm& operator=(Otm&&) noexcept;
  ~Otm();

  /// Nodes are numbered body by body; points too, and both in the order of their body.
  Index num_nodes() const;
  Index num_points() const;
  Index num_bodies() const;
  const Material& material(Index body) const;
  Index first_node(Index body) const;   ///< body = number of bodies: one past the last of all
  Index first_point(Index body) const;  ///< likewise

  void add_wall(const OtmWall<Dim>& wall);
  /// Throws InputError for numbers that make no sense, and for a mass where bodies have surfaces of their own.
  void add_tool(const OtmTool<Dim>& tool);
  /// Throws InputError for facets that do not close or enclose nothing.
  void add_cavity(const OtmCavity<Dim>& cavity);
  /// The node's velocity along an axis is prescribed from now on.
  void prescribe(Index node, int axis, double velocity);
  /// Bodies, and tools that have a mass, get this force per mass from now on [length/time^2], such as gravity, in place
  /// of the one before. Throws InputError for what is no number, and around an axis for one along the radius.
  void accelerate(const Vec<Dim>& by);

  /// The point bears no stress from now on: its mass stays with its nodes, with their velocities, and what was stored
  /// in it is lost (OtmBalance::fracture). Nothing happens to a point that is eroded.
  void erode(Index point);
  bool is_eroded(Index point) const;
  /// M, energy release rates of the points as they are now [stress length]; 0 where a body has no toughness and at
  /// points that are eroded or not under tension.
  Vector release_rates() const;
  /// M, 1 where a point is eroded; else what has summed up of OtmFracture::strain, or 0.
  Vector damage() const;
  /// Points that are inside another body by half a spacing and more, ascending, if bodies touch each other: contact
  /// does not push those out that are there at the start.
  std::vector<Index> points_in_others() const;
  /// Points that the last step would have turned inside out: they are as they were, and join others in the next.
  Index num_held() const;

  /// One step, of at most this; returns its length. Throws NumericalError, with point, place and time, where it cannot
  /// go on, and where energy is lost or made (OtmOptions::imbalance).
  double step(double at_most = std::numeric_limits<double>::infinity());
  /// Steps until this time, the last of which is cut to end there.
  void run(double until);

  /// All that changes as bodies move, as bytes: what `restore` goes on from to bitwise the same results.
  std::string state() const;
  /// Goes on from there. Throws InputError for bytes that are not of bodies, options and walls such as these.
  void restore(std::string_view state);

  double time() const;
  double stable_step() const;        ///< the next one's bound
  const Points<Dim>& nodes() const;  ///< Dim x N, where they are
  Points<Dim> velocities() const;    ///< Dim x N, half a step ago
  const Vector& masses() const;      ///< N, lumped
  Points<Dim> points() const;        ///< Dim x M, where they are
  Tensors deformation() const;       ///< 9 x M, F; of metals that have flown far, since they forgot how (theory.md)
  Tensors cauchy_stress() const;     ///< 9 x M
  Matrix history(Index body) const;  ///< of the material x points of the body
  OtmBalance<Dim> balance() const;
  EnergyWatch energy() const;  ///< now, and where it was worst of what was looked at; from the first step on
  const OtmCounts& counts() const;
  OtmTimes times() const;
  /// Force of the bodies on each wall in the last step, in the order they were added.
  Points<Dim> wall_forces() const;
  /// All tools, in the order they were added.
  std::vector<ToolState<Dim>> tools() const;

 private:
  std::unique_ptr<internal::Motion<Dim>> motion_;
};

}  // namespace efree
