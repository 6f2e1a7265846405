// SPDX-License-Identifier: GPL-3.0-or-later
/// Points that bear given stresses at the start.
#include "efree/dynamics/internal/initial_stress.hpp"

#include "efree/dynamics/internal/driver.hpp"
#include "efree/dynamics/internal/point_response.hpp"
#include "efree/dynamics/points.hpp"

#include <fmt/ranges.h>
#include <Eigen/LU>
#include <limits>

namespace efree::internal {
namespace {

constexpr int voigt[6][2] = {{0, 0}, {1, 1}, {2, 2}, {1, 2}, {0, 2}, {0, 1}};
using Six = Vec<6>;

Six components_of(const Mat<3>& T) {
  Six result;
  for (int k = 0; k < 6; ++k) result[k] = T(voigt[k][0], voigt[k][1]);
  return result;
}
Mat<3> stretch_of(const Six& strain) {
  Mat<3> U = Mat<3>::Identity();
  for (int k = 0; k < 6; ++k) {
    U(voigt[k][0], voigt[k][1]) += strain[k];
    if (k > 2) U(voigt[k][1], voigt[k][0]) += strain[k];
  }
  return U;
}

/// The symmetric deformation gradient by which a material at rest bears a stress.
class BearingStretch {
 public:
  BearingStretch(const Material& material, const Vec<3>& X, double modulus)
      : material_(material), X_(X), modulus_(modulus) {}

  /// Newton's method; empty: there is none without flow.
  std::optional<Mat<3>> find(const Mat<3>& stress) const {
    constexpr int most_iterations = 50;
    constexpr double increment = 1e-7;  // of strains, for derivatives
    const Six wanted = components_of(stress);
    const double enough = 1e-15 * modulus_ + 1e-13 * wanted.norm();
    Six strain = Six::Zero();
    auto state = stresses_of(strain);
    if (!state) return {};
    for (int k = 0; k < most_iterations; ++k) {
      const Six rest = wanted - state->first;
      if (rest.norm() <= enough) break;
      Mat<6> slope;
      for (int j = 0; j < 6; ++j) {
        const auto moved = stresses_of(strain + increment * Six::Unit(j));
        if (!moved) return {};
        slope.col(j) = (moved->first - state->first) / increment;
      }
      Six step = slope.fullPivLu().solve(rest);
      if (!step.allFinite()) return {};
      if (step.norm() > largest_step) step *= largest_step / step.norm();
      std::optional<std::pair<Six, double>> next;
      for (int halving = 0; halving < 10 && !next; ++halving, step *= 0.5) {
        next = stresses_of(strain + step);
        if (next) strain += step;
      }
      if (!next) return {};
      // What is left is rounding.
      const bool stalls = (wanted - next->first).norm() >= 0.5 * rest.norm() && rest.norm() <= accepted(wanted);
      state = next;
      if (stalls) break;
    }
    if ((wanted - state->first).norm() > accepted(wanted) || state->second > 0.0) return {};
    return stretch_of(strain);
  }

 private:
  static constexpr double largest_step = 0.1;
  double accepted(const Six& wanted) const { return 1e-12 * modulus_ + 1e-10 * wanted.norm(); }

  /// Cauchy stress and what is dissipated; empty: the material bears no such deformation.
  std::optional<std::pair<Six, double>> stresses_of(const Six& strain) const {
    const Mat<3> U = stretch_of(strain);
    const double J = U.determinant();
    if (!(J > 0.0)) return {};
    Deformation deformation = Deformation::none(X_, material_.history_size());
    deformation.F.col(0) = U.reshaped();
    try {
      MaterialResponse response = respond(material_, deformation, false);
      const Mat<3> sigma = response.stress(0) * U.transpose() / J;
      if (!sigma.allFinite()) return {};
      // Rounding of materials that do not flow.
      const double dissipated = response.dissipated.size() == 0 ? 0.0 : response.dissipated[0];
      return std::pair(components_of(sigma), dissipated > 1e-9 * std::abs(response.energy[0]) ? dissipated : 0.0);
    } catch (const NumericalError&) {
      return {};
    }
  }

  const Material& material_;
  Vec<3> X_;
  double modulus_;
};

/// Gradients of the points of a chunk, with the mean dilatation of their pressure patches.
template <int Dim> void average_patches(const Chunk<Dim>& chunk, std::vector<Mat<3>>& gradients) {
  chunk.for_each_patch([&](Index begin, Index end) {
    double volume = 0.0, reference = 0.0;
    for (Index p = begin; p < end; ++p) {
      volume += chunk.matter.volume[p];
      reference += chunk.matter.volume[p] / gradients[p].determinant();
    }
    for (Index p = begin; p < end && end - begin > 1; ++p)
      gradients[p] *= std::cbrt(volume / reference / gradients[p].determinant());
  });
}

}  // namespace

template <int Dim> void Driver<Dim>::set_stresses(const InitialStressField<Dim>& stress) {
  for_each_chunk(world, [&](Chunk<Dim>& chunk) {
    const BodyState<Dim>& body = world.bodies[chunk.body];
    Matter<Dim>& matter = chunk.matter;
    std::vector<Mat<3>> gradients(chunk.size(), Mat<3>::Identity());
    bool any = false;
    for (Index p = 0; p < chunk.size(); ++p) {
      const std::optional<Mat<3>> wanted = stress(chunk.body, matter.x.col(p));
      if (!wanted) continue;
      const auto fail = [&](const char* why) {
        throw InputError(fmt::format("the stress (xx, yy, zz, yz, xz, xy) = ({:.6g}) at ({:.6g}) {}",
                                     fmt::join(components_of(*wanted), ", "), fmt::join(matter.x.col(p), ", "), why));
      };
      if (!wanted->allFinite()) fail("is not finite");
      const auto found = BearingStretch(*body.material, matter.now.X.col(p), body.modulus).find(*wanted);
      if (!found)
        fail(
            "is not borne by the material without flow: expected one within its yield surface, or of its elastic "
            "range");
      gradients[p] = *found;
      any = true;
    }
    if (!any) return;
    average_patches(chunk, gradients);
    for (Index p = 0; p < chunk.size(); ++p) {
      const double J = gradients[p].determinant();
      matter.now.F.col(p) = gradients[p].reshaped();
      if (!matter.F_since.empty()) {
        matter.F_table.col(p) = matter.now.F.col(p);
        matter.F_since[p].setIdentity();
      }
      matter.volume[p] /= J;
      if (matter.J.size() != 0) matter.J[p] = J;
      matter.J_ratio[p] = chunk.has_patches() ? 1.0 : J;
    }
    matter.now.dt = 0.0;
    update_stresses(*body.material, matter,
                    [&](MaterialResponse& response) { chunk.stored = response.energy.dot(matter.volume); });
  });
  stable.update_stiffness_ratios(world);
  world.stable_step = std::numeric_limits<double>::infinity();  // nothing is known
  constexpr Index products = 40;
  if (!scheme->stable_step(world)) stable.estimate(world, products);
  estimate_stable_step(products, false);
  world.first_stable_step = world.stable_step;
  assemble_internal_forces(world, *scheme, false);
  add_external_forces();
  lacks_walls = true;
  begin_watch();
}

template void Driver<2>::set_stresses(const InitialStressField<2>&);
template void Driver<3>::set_stresses(const InitialStressField<3>&);

}  // namespace efree::internal
