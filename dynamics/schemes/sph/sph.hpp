// SPDX-License-Identifier: GPL-3.0-or-later
/// Smoothed particle hydrodynamics (Lucy 1977; Gingold & Monaghan 1977) for solids and soil (Libersky & Petschek 1991;
/// Bui, Fukagawa, Sako & Ohno 2008): nodes and material points are the same particles.
#pragma once

#include "efree/dynamics/scheme.hpp"
#include "efree/dynamics/schemes/sph/smoothing_kernel.hpp"
#include "efree/dynamics/surface_load.hpp"

#include <array>
#include <memory>

namespace efree {

/// Artificial viscosity between particles that approach each other (Monaghan 1992): Pi = (-linear c q + quadratic q^2)
/// / rho, q = h v.x / (x^2 + 0.01 h^2), c the speed of pressure waves.
struct ParticleViscosity {
  double linear = 0.1, quadratic = 0.1;
  bool on() const { return linear > 0.0 || quadratic > 0.0; }
};

/// Artificial stress against the tensile instability (Monaghan 2000; Gray, Monaghan & Swift 2001): on the principal
/// axes with tension a pressure `strength` sigma / rho^2, on those with compression one of `compression` times it, so
/// that particles do not pair up; both times (W(r) / W(spacing))^n.
struct ArtificialStress {
  double strength = 0.0;  ///< e; 0: none of it at all
  double compression = 0.05;
  double exponent = 0.0;  ///< n; 0: W(0) / W(spacing)
};

/// Particles that are strained by much are split into 2^Dim daughters (Lopez, Roose & Recarey Morfa 2013), on a square
/// (cube) in the axes of the lattice. They share mass and volume and have the velocity of their parent; stresses,
/// strains and history are the parent's.
struct ParticleSplitting {
  /// Sum of the squared logarithmic strains along the axes from which a particle splits, times (splits so far + 1)^2;
  /// 0: none does.
  double strain = 0.0;
  double separation =
      0.5;                 ///< edge of the square over the distance that their parent had to its neighbours, 0.2 to 0.8
  double smoothing = 0.6;  ///< smoothing length of daughters over that of their parent, 0.4 to 0.9
  int levels = 1;          ///< how often, 1 to 3
};

struct SphOptions {
  double spacing = 0.0;            ///< of the particles at the start [length]
  std::array<double, 3> origin{};  ///< position of a corner of the lattice that cuts bodies into particles
  double smoothing = 1.2;          ///< smoothing length over the spacing
  SmoothingKernel kernel = SmoothingKernel::cubic_spline;
  /// Gradients of velocities that are exact where these are linear, at free surfaces too (Randles & Libersky 1996), and
  /// the forces of their adjoint (Bonet & Lok 1999): bodies that spin keep their angular momentum; steps are half as
  /// long.
  bool corrected = false;
  ParticleViscosity viscosity{};
  ArtificialStress artificial_stress{};
  ParticleSplitting splitting{};
};

/// The scheme in the updated configuration: gradients of velocities are 1/rho_i sum m_j (v_j - v_i) (x) grad W_ij,
/// forces m_i sum m_j (sigma_i / rho_i^2 + sigma_j / rho_j^2 - Pi_ij) grad W_ij, each the adjoint of the other. Nodes
/// are the particles; all bodies interact by the same sums, so that they stick where they meet. Walls act
/// by mirror images of the particles that are pressed on them, which keeps these about half a spacing away; with
/// infinite friction matter flows beside the wall by its own strength. Rigid bodies stop particles half a spacing away.
/// Throws InputError for options out of range, and from `begin` for bodies that are not as particles_on_lattice makes
/// them.
template <int Dim> std::unique_ptr<Scheme<Dim>> sph(const SphOptions& options);

/// What gradients of particles are taken in.
enum class SphFrame {
  updated,  ///< where the particles are: sph()
  total,    ///< the reference configuration: total_lagrangian()
};

/// Particles of a body: its mesh cut by a lattice of that spacing, pieces of less than half of a lattice cell joined
/// with a neighbour. In the total frame with shape functions, whose gradients are those of the kernel, corrected such
/// that gradients of linear functions are exact (Randles & Libersky 1996); values are those of the particles
/// themselves. Throws InputError as cut_by_lattice does, for a spacing of more than a tenth of the body's largest
/// extent, and in the total frame for particles whose neighbours do not enclose an area (a volume).
template <int Dim> DeformableBody<Dim> particles_on_lattice(const FineMesh<Dim>& mesh, SphFrame frame,
                                                            const SphOptions& options, SharedMaterial material,
                                                            double density);

/// A part of the surface of such a body for surface_load: these facets of its mesh, cut to half a spacing. Loads act on
/// the nearest particles, those less than half a spacing further away with less weight: the sum of forces is exact,
/// moments are off by up to half a spacing. Areas and normals follow the particles by moving least squares.
template <int Dim> SurfacePart<Dim> surface_of_particles(const FineMesh<Dim>& mesh, const std::vector<Index>& facets,
                                                         const SphOptions& options, const DeformableBody<Dim>& body);

}  // namespace efree
