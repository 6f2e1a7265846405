// SPDX-License-Identifier: GPL-3.0-or-later
/// The elliptical inclusion that studies and tests share: a quarter of a square plate with the exact tractions of the
/// infinite one on its outer sides (complex potentials of Muskhelishvili; Hardiman 1954).
#pragma once

#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/algorithms/static_analysis.hpp"

#include <cmath>
#include <complex>
#include <numbers>

namespace efree::bench {

/// Infinite plate in plane strain under unit tension along x, E = 1, nu = 0.3, with an inclusion of semi-axes a (along
/// x) and b, perfectly bonded, of `ratio` times its modulus.
///
/// With z = R (zeta + m / zeta) outside, zeta on the unit circle at the interface:
///   matrix:    phi = Gamma z + p / zeta, psi from continuity of tractions; inclusion: phi = D z, psi = E z;
///   2 mu (u + i v) = kappa phi - z conj(phi') - conj(psi).
class Inclusion {
 public:
  using Complex = std::complex<double>;
  static constexpr double half_width = 3.0;  ///< of the quarter that is analysed

  Inclusion(double a, double b, double ratio) : a_(a), b_(b), ratio_(ratio), R_(0.5 * (a + b)), m_((a - b) / (a + b)) {
    const double g = ratio, alpha = 2.0 + (kappa - 1.0) / g, beta = 1.0 - 1.0 / g, k = kappa + 1.0;
    // D alpha + m E beta = k Gamma;  2 m D + E - 2 Gamma m - p / R = Gamma';  p / R = (m D alpha + E beta) / k - Gamma
    // m
    Mat<2> M{{alpha, m_ * beta}, {2.0 * m_ - m_ * alpha / k, 1.0 - beta / k}};
    const Vec<2> rhs(k * Gamma, Gamma_prime + Gamma * m_);
    const double det = M(0, 0) * M(1, 1) - M(0, 1) * M(1, 0);
    D_ = (rhs[0] * M(1, 1) - M(0, 1) * rhs[1]) / det;
    E_ = (M(0, 0) * rhs[1] - rhs[0] * M(1, 0)) / det;
    p_ = R_ * ((m_ * D_ * alpha + E_ * beta) / k - Gamma * m_);
  }

  IsotropicModuli matrix() const { return {1.0, nu}; }
  IsotropicModuli inclusion() const { return {ratio_, nu}; }
  bool inside(const Vec<2>& x) const { return std::pow(x.x() / a_, 2) + std::pow(x.y() / b_, 2) < 1.0; }

  Vec<2> displacement(const Vec<2>& x) const {
    const Potentials f = at(x);
    const Complex z(x.x(), x.y());
    const Complex u = (kappa * f.phi - z * std::conj(f.dphi) - std::conj(f.psi)) / (2.0 * f.mu);
    return {u.real(), u.imag()};
  }
  Voigt<2> stress(const Vec<2>& x) const {
    const Potentials f = at(x);
    const double sum = 4.0 * f.dphi.real();
    const Complex difference = 2.0 * (Complex(x.x(), -x.y()) * f.ddphi + f.dpsi);
    return {0.5 * (sum - difference.real()), 0.5 * (sum + difference.real()), nu * sum, 0.5 * difference.imag()};
  }

  /// Quarter of the plate; regions "matrix" and "inclusion", sides left, bottom, right, top. Chords of the interface
  /// are no longer than `size`.
  MeshData<2> mesh(double size) const {
    PlanarDomain domain = shapes::rectangle(0.0, 0.0, half_width, half_width);
    const int chords = static_cast<int>(std::ceil(std::max(8.0, 0.5 * std::numbers::pi * std::max(a_, b_) / size)));
    Polyline arc{"", {}};
    for (int k = 0; k <= chords; ++k) {
      const double t = 0.5 * std::numbers::pi * k / chords;
      arc.points.push_back({k == chords ? 0.0 : a_ * std::cos(t), k == 0 ? 0.0 : b_ * std::sin(t)});
    }
    domain.embedded.push_back(arc);
    MeshData<2> data = triangulate_data(domain, {.size = size});
    data.region_names = {"matrix", "inclusion"};
    for (Index c = 0; c < data.cells.cols(); ++c) {
      const Vec<2> x = (data.vertices.col(data.cells(0, c)) + data.vertices.col(data.cells(1, c)) +
                        data.vertices.col(data.cells(2, c))) /
                       3.0;
      // Inside the chord that x lies in front of, seen from the centre.
      const double t = std::atan2(x.y() / b_, x.x() / a_) / (0.5 * std::numbers::pi) * chords;
      const auto k = std::min(static_cast<std::size_t>(t), static_cast<std::size_t>(chords - 1));
      const Vec<2> from = arc.points[k], along = arc.points[k + 1] - from, to = x - from;
      data.regions.push_back(along.x() * to.y() - along.y() * to.x() > 0.0);
    }
    return data;
  }

  ElasticModel model(Essential essential) const {
    return {.material = {},
            .plane = Plane::strain,
            .essential = essential,
            .regions = {LinearElastic(matrix()), LinearElastic(inclusion())}};
  }
  Loads<2> loads() const {
    const auto pulled = [this](const Vec<2>& x, const Vec<2>& n) { return traction<2>(stress(x), n); };
    return {.tractions = {{"right", pulled}, {"top", pulled}}, .body_force = {}};
  }
  ExactSolution<2> exact() const {
    return {[this](const Vec<2>& x) { return displacement(x); }, [this](const Vec<2>& x) { return stress(x); }};
  }

 private:
  static constexpr double nu = 0.3, kappa = 3.0 - 4.0 * nu, mu = 1.0 / (2.0 * (1.0 + nu));
  static constexpr double Gamma = 0.25, Gamma_prime = -0.5;

  struct Potentials {
    Complex phi, dphi, ddphi, psi, dpsi;
    double mu;
  };
  Potentials at(const Vec<2>& x) const {
    const Complex z(x.x(), x.y());
    if (inside(x)) return {D_ * z, D_, 0.0, E_ * z, E_, ratio_ * mu};
    Complex root = std::sqrt(z * z - 4.0 * R_ * R_ * m_);
    if ((std::conj(z) * root).real() < 0.0) root = -root;  // the branch outside the unit circle
    const Complex q = (z + root) / (2.0 * R_), q2 = q * q, dz = R_ * (1.0 - m_ / q2);
    const Complex s = 1.0 / q + m_ * q, ds = -1.0 / q2 + m_, t = p_ / (q2 - m_),
                  dt = -2.0 * q * p_ / ((q2 - m_) * (q2 - m_));
    const Complex psi = 2.0 * (D_ - Gamma) * R_ * s + E_ * z - p_ * q + s * t;
    const Complex dpsi = 2.0 * (D_ - Gamma) * R_ * ds + E_ * dz - p_ + ds * t + s * dt;
    return {Gamma * z + p_ / q, Gamma - t / R_, -dt / (R_ * dz), psi, dpsi / dz, mu};
  }

  double a_, b_, ratio_, R_, m_, D_ = 0.0, E_ = 0.0, p_ = 0.0;
};

}  // namespace efree::bench
