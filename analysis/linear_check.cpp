// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/linear_check.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

namespace efree {

std::string text_of(const LinearCheck& check) {
  std::string text = fmt::format(
      "strains up to {:.2g}, rotations up to {:.2g} degrees{}", check.strain, 180.0 / std::numbers::pi * check.rotation,
      check.overload > 1.0 ? fmt::format(", stresses up to {:.3g} times what the material bears", check.overload) : "");
  if (!check.failure.empty()) return check.strain > 0.0 ? fmt::format("{}: {}", text, check.failure) : check.failure;
  if (check.negative_pivots > 0) text += ", and the tangent there is not positive definite";
  if (check.same) return fmt::format("off by nothing ({})", text);
  return fmt::format("off by {:.2g} % of the largest displacement, {:.2g} % of the largest stress ({})",
                     100.0 * check.displacement, 100.0 * check.stress, text);
}

namespace internal {
namespace {

/// Frobenius' product of symmetric tensors in Voigt order.
template <int Dim> double product(const Voigt<Dim>& a, const Voigt<Dim>& b) {
  constexpr int normal = 3;  // in the plane xx, yy, zz
  double sum = 0.0;
  for (int i = 0; i < voigt_size<Dim>; ++i) sum += (i < normal ? 1.0 : 2.0) * a[i] * b[i];
  return sum;
}
template <int Dim> double norm(const Voigt<Dim>& a) {
  return std::sqrt(product<Dim>(a, a));
}

/// Largest change of a length, and the largest angle by which matter turns [rad], of deformation gradients.
template <int Dim> std::pair<double, double> stretch_and_turn(const Gradients<Dim>& F) {
  double stretch = 0.0, turn = 0.0;
  for (Index K = 0; K < static_cast<Index>(F.cols()); ++K) {
    Mat<3> at = Mat<3>::Zero();
    for (int a = 0; a < gradient_size<Dim>; ++a) at.data()[tensor_places<Dim>[a]] = F(a, K);
    const Eigen::JacobiSVD<Mat<3>> parts(at, Eigen::ComputeFullU | Eigen::ComputeFullV);
    stretch = std::max(stretch, (parts.singularValues().array() - 1.0).abs().maxCoeff());
    const Mat<3> R = parts.matrixU() * parts.matrixV().transpose();
    const double sine = 0.5 * Vec<3>(R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1)).norm();
    turn = std::max(turn, std::atan2(sine, 0.5 * (R.trace() - 1.0)));
  }
  return {stretch, turn};
}

/// Linear stresses over those that the materials bear, along the difference, where they flow: trial stress over yield
/// stress, of von Mises' cylinder. No less than 1, no more than 1000.
template <int Dim>
double overload(const VoigtPoints<Dim>& linear, const VoigtPoints<Dim>& borne, const Vector& dissipated) {
  constexpr double most = 1000.0;
  double largest = 1.0;
  for (Index K = 0; K < dissipated.size(); ++K) {
    if (!(dissipated[K] > 0.0)) continue;
    const Voigt<Dim> trial = linear.col(K), back = trial - borne.col(K);
    const double along = product<Dim>(trial, back), taken = product<Dim>(back, back);
    if (along > 0.0) largest = std::max(largest, along / std::max(along - taken, along / most));
  }
  return largest;
}

}  // namespace

template <int Dim> State LinearBeside<Dim>::as_full(const State& at) const {
  State state = full_.rest();
  state.u = at.u;
  state.time = state.dt = at.time;
  state.factor = at.factor;
  return state;
}

template <int Dim> LinearCheck LinearBeside<Dim>::operator()(const State& at) {
  constexpr double rounding = 1e-9;
  LinearCheck check{.time = at.time};
  const PointFields<Dim> of_linear = linear_.fields(at);
  std::tie(check.strain, check.rotation) = stretch_and_turn<Dim>(of_linear.F);
  const State state = as_full(at);
  try {
    const Vector r = full_.residual(state);
    const PointFields<Dim> there = full_.fields(state);
    check.overload = overload<Dim>(of_linear.stress, there.stress, there.dissipated);
    const auto& region = full_.approximation().quadrature.region;
    const auto stresses_off = [&](const VoigtPoints<Dim>& stress) {
      Vector largest = Vector::Zero(full_.materials().num_regions()), differs = largest;
      for (Index K = 0; K < static_cast<Index>(stress.cols()); ++K) {
        largest[region[K]] = std::max(largest[region[K]], norm<Dim>(of_linear.stress.col(K)));
        differs[region[K]] = std::max(differs[region[K]], norm<Dim>(stress.col(K) - of_linear.stress.col(K)));
      }
      const double least = 1e-6 * largest.maxCoeff();  // what a region without stress is compared with
      return least > 0.0 ? differs.cwiseQuotient(largest.cwiseMax(least)).maxCoeff() : 0.0;
    };
    // Balance alone says nothing: other stresses may be in balance, too.
    if (OutOfBalance(r, full_.force_scale(state)).share <= NewtonOptions{}.tolerance &&
        stresses_off(there.stress) <= rounding) {
      check.same = check.enough = true;
      return check;
    }
    const State next = full_.moved(state, tangent_.change(state, r).col(0));
    check.negative_pivots = tangent_.negative_pivots();
    const auto size = [&](const Vector& u) {
      const Points<Dim> U = u.reshaped(Dim, u.size() / Dim);
      return interpolate(full_.approximation().shape, U).colwise().norm().maxCoeff();
    };
    const double moved = size(state.u);
    check.displacement = moved > 0.0 ? size(next.u - state.u) / moved : 0.0;
    check.stress = stresses_off(full_.fields(next).stress);
    check.enough = check.displacement <= tolerance_ && check.stress <= tolerance_ &&
                   check.overload <= 1.0 + tolerance_ && check.negative_pivots == 0;
  } catch (const NumericalError& error) {
    check.failure = error.what();
  }
  return check;
}

template <int Dim>
LinearCheck check_linear(const Settings<Dim>& full, const Result<Dim>& result, const Monitor& monitor) {
  const Stage stage("model", monitor);
  const NonlinearEquilibrium<Dim> equations(result.approximation, full.common.model,
                                            Program<Dim>::grows(full.supports, full.loads));
  LinearBeside<Dim> beside(equations, full.regime_tolerance);
  Cholesky factor;
  TangentSolver tangent(beside.equations(), factor);
  std::optional<State> linear;
  try {
    linear = newton(beside.equations(), tangent, beside.equations().rest(), 1.0).state;
  } catch (const NumericalError& error) {
    return {.time = 1.0, .failure = fmt::format("linear elasticity has no answer: {}", error.what())};
  }
  return beside(*linear);
}

template <int Dim> void warn_of_overload(const Settings<Dim>& settings, const ElasticModel& full, Result<Dim>& result) {
  const auto& points = result.basis().quadrature;
  const Materials<Dim> materials = materials_of(full, *result.mesh);
  Gradients<Dim> H(gradient_size<Dim>, points.size());
  for (Index K = 0; K < points.size(); ++K) H.col(K) = gradient_of<Dim>(result.solution.strain.col(K));
  const auto of = materials.respond(points, H, Vector::Zero(materials.history_size(points)), 0.0, false);
  const double share = (of.dissipated.array() > 0.0).select(points.weights, 0.0).sum() / points.weights.sum();
  if (share == 0.0) return;
  VoigtPoints<Dim> stress(voigt_size<Dim>, points.size());
  for (Index K = 0; K < points.size(); ++K) stress.col(K) = stress_of<Dim>(of.P.col(K));
  const double over = overload<Dim>(result.solution.stress, stress, of.dissipated);
  if (over > 1.0 + settings.regime_tolerance)
    result.warnings.push_back(fmt::format(
        "stresses of the linear answer are up to {:.3g} times what the material bears, in {:.2g} % of the volume, "
        "where "
        "the cloud, which decided on the model, sees less: no flow is in the answer (analysis.model = \"finite\" or a "
        "smaller spacing has it)",
        over, 100.0 * share));
}

template class LinearBeside<2>;
template class LinearBeside<3>;
template LinearCheck check_linear<2>(const Settings<2>&, const Result<2>&, const Monitor&);
template LinearCheck check_linear<3>(const Settings<3>&, const Result<3>&, const Monitor&);
template void warn_of_overload<2>(const Settings<2>&, const ElasticModel&, Result<2>&);
template void warn_of_overload<3>(const Settings<3>&, const ElasticModel&, Result<3>&);

}  // namespace internal
}  // namespace efree
