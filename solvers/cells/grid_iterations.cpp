// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/grid_iterations.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>

namespace efree::internal {
namespace {

/// As part of the energy of the unknowns one by one.
constexpr double energy_of_rounding = 1e-18;

class Iterations {
 public:
  Iterations(const GridLevel& grid, std::size_t l, const Field& forces, Multigrid& precondition,
             const ReferenceEnergy& reference, Field& u)
      : grid_(grid), forces_(forces), level_(l), precondition_(precondition), reference_(reference), u_(u) {}

  Iterated run(const IterationLimits& limits, const Stage& stage) {
    Iterated found;
    const std::size_t dofs = u_.size();
    SingleField p = zeros<float>(dofs);
    find_residual();
    double before = 0.0, replaced = 0.0;  // r . z one iteration ago, and when the residual was last found anew
    for (;; ++found.iterations) {
      stage.check();
      if (size_ == 0.0) break;
      SingleField& r = residual();
      const SingleField& z = precondition_.cycle(level_);
      const double next = dot(r, z), error = size_ * size_ * next;
      if (!(next >= 0.0) || !std::isfinite(next)) throw NumericalError("the iterations on cells break down");
      found.error =
          error > rounding_energy(grid_, u_) ? std::sqrt(error / std::max(reference_.of(work_, own_), error)) : 0.0;
      if (found.error <= limits.tolerance) break;
      if (found.iterations == limits.most)
        throw NumericalError(fmt::format(
            "{} iterations on cells leave a relative error of {:.2g}: materials of very "
            "different stiffness, nearly incompressible or strongly anisotropic ones, or a body that hardly hangs "
            "together",
            limits.most, found.error));
      if (next < least_fall * replaced) {
        // Rounding has added up: the residual anew, in directions that go on.
        const double size = size_;
        find_residual();
        for_all(dofs, [&](std::size_t i) { p[i] *= static_cast<float>(size / size_); });
        before *= (size / size_) * (size / size_);
        replaced = 0.0;
        --found.iterations;
        continue;
      }
      if (replaced == 0.0) replaced = next;
      const auto beta = static_cast<float>(before > 0.0 ? next / before : 0.0);
      before = next;
      for_all(dofs, [&](std::size_t i) { p[i] = z[i] + beta * p[i]; });
      SingleField& Kp = precondition_.spare(level_);
      grid_.apply(p.data(), Kp.data());
      grid_.collect(Kp.data());
      const double alpha = next / summed(dofs, [&](std::size_t i) {
                             return grid_.is_free(i) ? static_cast<double>(p[i]) * static_cast<double>(Kp[i]) : 0.0;
                           });
      const double forward = size_ * alpha, work = forces_.empty() ? 0.0 : forward * dot(forces_, p);
      const auto back = static_cast<float>(alpha);
      for_all(dofs, [&](std::size_t i) {
        u_[i] += forward * static_cast<double>(p[i]);
        r[i] = grid_.is_free(i) ? r[i] - back * Kp[i] : 0.0F;
      });
      own_ += 2.0 * work - forward * size_ * next;
      work_ += work;
    }
    precondition_.release(level_);
    return found;
  }

 private:
  /// Fall of r . z after which the residual is found anew.
  static constexpr double least_fall = 1e-7;

  SingleField& residual() { return precondition_.right(level_); }
  /// The residual, of size 1, its size, and what the energy is made of.
  void find_residual() {
    precondition_.release(level_);
    Field Ku(u_.size());
    grid_.apply(u_.data(), Ku.data());
    own_ = dot(u_, Ku);
    work_ = forces_.empty() ? 0.0 : dot(forces_, u_);
    for_all(u_.size(), [&](std::size_t i) { Ku[i] = (forces_.empty() ? 0.0 : forces_[i]) - Ku[i]; });
    grid_.collect(Ku.data());
    for_all(u_.size(), [&](std::size_t i) {
      if (!grid_.is_free(i)) Ku[i] = 0.0;
    });
    size_ = std::sqrt(dot(Ku, Ku));
    SingleField& r = residual();
    if (r.empty()) r = zeros<float>(u_.size());
    const double scale = size_ > 0.0 ? 1.0 / size_ : 0.0;
    for_all(u_.size(), [&](std::size_t i) { r[i] = static_cast<float>(scale * Ku[i]); });
  }

  const GridLevel& grid_;
  const Field& forces_;
  std::size_t level_;
  Multigrid& precondition_;
  const ReferenceEnergy& reference_;
  Field& u_;
  double size_ = 0.0, own_ = 0.0, work_ = 0.0;  ///< of the residual; u . K u, f . u
};

}  // namespace

double rounding_energy(const GridLevel& grid, const Field& u) {
  return energy_of_rounding * summed(u.size(), [&](std::size_t i) {
           return grid.is_free(i) ? u[i] * u[i] / static_cast<double>(grid.inverse_diagonal[i]) : 0.0;
         });
}

Iterated iterate(const GridLevel& grid, std::size_t l, const Field& forces, Multigrid& precondition,
                 const ReferenceEnergy& reference, const IterationLimits& limits, const Stage& stage, Field& u) {
  return Iterations(grid, l, forces, precondition, reference, u).run(limits, stage);
}

}  // namespace efree::internal
