// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/effective_interpretation.hpp"

#include "efree/assembly/materials.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/solvers/cells/cell_solver.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace efree::internal {
namespace {

/// Part of the mean moduli below which there are none.
constexpr double none_of_mean = 1e-6;
/// Distance from a class of symmetry that counts as none.
constexpr double class_tolerance = 0.01;

/// Compliance or resistivity, unless it is infinite along something.
Matrix inverse_of(const Matrix& tensor, const Matrix& mean) {
  // Scaled by the mean moduli, so that soft axes of stiff bodies do not count as none.
  const Vector scale = mean.diagonal().cwiseSqrt().cwiseInverse();
  const Matrix scaled = scale.asDiagonal() * tensor * scale.asDiagonal();
  if (!(eigenvalues<Eigen::Dynamic>(scaled)[0] > none_of_mean)) return {};
  return scale.asDiagonal() * pseudo_inverse<Eigen::Dynamic>(scaled) * scale.asDiagonal();
}

/// Bounds of phases with moduli m by fraction; `add(extreme)` is what Hashin-Shtrikman's bounds add to each modulus.
PhaseBounds bounds_of(const std::vector<std::pair<double, double>>& phases, double lower_add, double upper_add) {
  const auto generalised = [&](double add) {
    double sum = 0.0;
    for (const auto& [fraction, m] : phases) {
      if (m + add <= 0.0) return 0.0;
      sum += fraction / (m + add);
    }
    return 1.0 / sum - add;
  };
  double voigt = 0.0;
  for (const auto& [fraction, m] : phases) voigt += fraction * m;
  return {{generalised(0.0), voigt}, {generalised(lower_add), generalised(upper_add)}};
}

/// kappa, mu of an isotropic material; in the plane those of the plane, kappa with respect to the change of area.
template <int Dim> std::pair<double, double> moduli_of(const SharedMaterial& material, Plane plane) {
  const VoigtMatrix<Dim> C = Materials<Dim>({material}, plane).stiffness(0, Vec<Dim>::Zero()).C;
  const double mu = Dim == 2 ? C(3, 3) : C(5, 5);
  return {C(0, 1) + 2.0 / Dim * mu, mu};
}

/// The least and the largest modulus.
std::pair<double, double> extremes_of(const std::vector<std::pair<double, double>>& phases) {
  const auto [low, high] = std::ranges::minmax(phases, {}, [](const auto& one) { return one.second; });
  return {low.second, high.second};
}

}  // namespace

double size_of(const Matrix& tensor, EffectiveProperty property) {
  if (property == EffectiveProperty::conductivity) return tensor.norm();
  return tensor.rows() == 6 ? norm_of(ElasticTensor(tensor)) : plane_norm_of(tensor);
}

void interpret(EffectiveProperty property, EffectiveResult& result) {
  const Matrix& tensor = result.tensor.tensor;
  const bool is_elastic = property == EffectiveProperty::stiffness;
  bool any = false;
  for (int d = 0; d < tensor.rows(); ++d) {
    const bool is_none = !(tensor(d, d) > none_of_mean * result.tensor.mean(d, d));
    if (d < result.dim) result.is_cut[d] = is_none;
    any = any || !is_none;
  }
  const char* what = is_elastic ? "stiffness" : "conductivity";
  if (!any)
    throw InputError(
        fmt::format("the volume has no {0}: void cuts it along all axes, so that nothing in it hangs together from one "
                    "side to the other. A threshold that leaves more material, or another part of the image, may help",
                    what));
  for (int d = 0; d < result.dim; ++d)
    if (result.is_cut[d])
      result.warnings.push_back(
          fmt::format("there is no {} along {}: void cuts the volume across this axis", what, "xyz"[d]));
  result.inverse = inverse_of(tensor, result.tensor.mean);
  if (!is_elastic) {
    const auto [values, vectors] = spectrum<Eigen::Dynamic>(tensor);
    result.principal = values.reverse();
    result.principal_axes = vectors.rowwise().reverse();
    for (int d = 0; d < result.dim; ++d)
      if (result.principal_axes.col(d).sum() < 0.0) result.principal_axes.col(d) *= -1.0;
    return;
  }
  if (result.inverse.size() == 0)
    result.warnings.emplace_back("the stiffness is singular: there are no engineering constants");
  result.class_tolerance = std::max(class_tolerance, 2.0 * result.tensor.grid_error);
  if (result.dim == 2) {
    result.plane_symmetry = plane_symmetry_of(tensor);
    result.plane_nearest = nearest_class(*result.plane_symmetry, result.class_tolerance);
    return;
  }
  const ElasticTensor C = tensor;
  result.symmetry = symmetry_of(C);
  result.nearest = nearest_class(*result.symmetry, result.class_tolerance);
  if (result.inverse.size() > 0) result.universal_anisotropy = universal_anisotropy(C, ElasticTensor(result.inverse));
}

void find_bounds(EffectiveProperty property, Plane plane, const std::vector<EffectivePhase>& phases,
                 EffectiveResult& result) {
  const int dim = result.dim;
  std::vector<std::pair<double, double>> first, second;  // kappa and mu, or conductivities
  bool is_isotropic_throughout = true;
  for (const EffectivePhase& phase : phases) {
    if (property == EffectiveProperty::conductivity) {
      first.emplace_back(phase.fraction, phase.conductivity);
      continue;
    }
    double kappa = 0.0, mu = 0.0;
    if (phase.material) {
      if (!phase.material->linear())
        result.warnings.push_back(
            fmt::format("the tensor is that of small strains from rest: the material of \"{}\" is not linear, and its "
                        "stiffness where nothing has happened yet is taken",
                        phase.region));
      if (!phase.material->homogeneous() || !is_isotropic(phase.material, Vec<3>::Zero())) {
        is_isotropic_throughout = false;
        continue;
      }
      std::tie(kappa, mu) = dim == 2 ? moduli_of<2>(phase.material, plane) : moduli_of<3>(phase.material, plane);
      if (kappa - 2.0 / dim * mu > 9.0 * mu)  // nu > 0.45
        result.warnings.push_back(
            fmt::format("the stiffness may be too high: \"{}\" is nearly incompressible, and {} lock", phase.region,
                        result.on_mesh ? "quadratic elements" : "trilinear cells"));
    }
    first.emplace_back(phase.fraction, kappa);
    second.emplace_back(phase.fraction, mu);
  }
  if (!is_isotropic_throughout) return;
  const auto [low, high] = extremes_of(first);
  if (property == EffectiveProperty::conductivity) {
    result.conductivity_bounds = bounds_of(first, (dim - 1.0) * low, (dim - 1.0) * high);
    return;
  }
  const auto [soft, stiff] = extremes_of(second);
  const auto zeta = [dim](double kappa, double mu) {
    if (mu <= 0.0) return 0.0;
    return dim == 2 ? kappa * mu / (kappa + 2.0 * mu) : mu / 6.0 * (9.0 * kappa + 8.0 * mu) / (kappa + 2.0 * mu);
  };
  const double share = 2.0 * (dim - 1.0) / dim;  // of mu: 4 / 3, in the plane 1
  result.kappa_bounds = bounds_of(first, share * soft, share * stiff);
  result.mu_bounds = bounds_of(second, zeta(low, soft), zeta(high, stiff));
}

}  // namespace efree::internal
