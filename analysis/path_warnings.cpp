// SPDX-License-Identifier: GPL-3.0-or-later
/// Warnings of load paths besides those of their errors.
#include "efree/analysis/internal/judge.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/analysis/internal/steps_estimate.hpp"
#include "efree/materials/plasticity.hpp"
#include "efree/solvers/equations/locking.hpp"

#include <fmt/format.h>
#include <algorithm>

namespace efree::internal {
namespace {

/// The largest displacement gradient that a material of small strains sees.
template <int Dim> double largest_of_small(const NonlinearEquilibrium<Dim>& equations, const PointFields<Dim>& points) {
  const auto& quadrature = equations.approximation().quadrature;
  double largest = 0.0;
  for (Index K = 0; K < quadrature.size(); ++K)
    if (!equations.materials().finite_strain(quadrature.region[K]))
      largest = std::max(largest, (points.F.col(K) - trace_direction<Dim>()).norm());
  return largest;
}

/// Says where the path becomes unstable.
template <int Dim> void warn_of_instability(Result<Dim>& result) {
  Index before = 0;
  bool told = false;
  for (const HistoryStep<Dim>& step : result.history) {
    if (step.negative_pivots > 0 && before == 0) {
      result.warnings.push_back(fmt::format(
          "at time {:.6g} the body is not stable: its energy falls in {} direction{}{}", step.time,
          step.negative_pivots, step.negative_pivots == 1 ? "" : "s", told ? "" : " (instability_mode in fields.vtu)"));
      told = true;
    }
    before = step.negative_pivots;
  }
}

/// Notes how far held boundaries are from what is prescribed, and warns where that is more than a per cent.
template <int Dim> void warn_of_gap(const NonlinearEquilibrium<Dim>& equations, const State& at, Result<Dim>& result) {
  constexpr double bearable = 0.01;
  const auto& shape = equations.approximation().shape;
  const double moved =
      interpolate(shape, Points<Dim>(at.u.reshaped(Dim, shape.num_nodes()))).colwise().norm().maxCoeff();
  if (!(moved > 0.0)) return;
  result.gap = equations.largest_gap(at) / moved;
  if (result.gap > bearable)
    result.warnings.push_back(
        fmt::format("boundaries are up to {:.2g} % of the largest displacement away from what is prescribed on them: "
                    "analysis.essential = \"strong\" holds them at the nodes, a smaller spacing brings them nearer",
                    100.0 * result.gap));
}

/// Warns of what locks, and of too few quadrature points.
template <int Dim> void warn_of_functions(const Settings<Dim>& settings, Result<Dim>& result) {
  const ApproximationOptions& options = settings.common.approximation;
  if (options.kind == BasisKind::p1 &&
      (flows(result.model) || incompressibility(result.model, *result.mesh) > bearable_incompressibility(options.kind)))
    result.warnings.push_back(
        "linear elements lock where materials flow or are nearly incompressible (nu > 0.4): the body is far stiffer "
        "than it should be; take moving least squares, or quadratic elements");
  const auto doubtful = doubts(options, result.approximation);
  result.warnings.insert(result.warnings.end(), doubtful.begin(), doubtful.end());
}

/// Warns of pressures that do not follow the body, or only in part.
template <int Dim> void warn_of_pressures(bool finite_strain, bool plane_stress, Result<Dim>& result) {
  for (const auto& load : result.balance.loads) {
    if (finite_strain && load.kind == "pressure")
      result.warnings.push_back(
          fmt::format("pressure on \"{}\" acts on the area and along the normal at rest: it does not follow the "
                      "body, as it would with follower = true",
                      load.on));
    if (plane_stress && load.kind == "follower_pressure")
      result.warnings.push_back(fmt::format(
          "pressure on \"{}\" follows the body in its plane: it is per thickness at rest, not as it is", load.on));
  }
}

}  // namespace

bool softens(const ElasticModel& model) {
  const auto is_softening = [](const SharedMaterial& material) {
    const auto* plastic = dynamic_cast<const Plastic*>(&*material);
    return plastic != nullptr && plastic->softens();
  };
  return model.regions.empty() ? is_softening(model.material) : std::ranges::any_of(model.regions, is_softening);
}

template <int Dim> void warn_of_path(const Settings<Dim>& settings, const NonlinearEquilibrium<Dim>& equations,
                                     const State& end, Result<Dim>& result) {
  constexpr double small = 0.05;
  warn_of_instability(result);
  warn_of_gap(equations, end, result);
  warn_of_functions(settings, result);
  warn_of_pressures(equations.finite_strain(), settings.common.model.plane == Plane::stress, result);
  if (const double strain = largest_of_small(equations, equations.fields(end)); strain > small)
    result.warnings.push_back(
        fmt::format("a material of small strains has displacement gradients of {:.2g}: take one of finite strains "
                    "(strain = \"finite\", or a hyperelastic model)",
                    strain));
  if (result.history.back().dissipated > 0.0 && softens(result.model))
    result.warnings.push_back(
        "Loads beyond the peak and the dissipated energy may be too large by a factor of two and more (2.4 measured in "
        "a bar that tears): a material softens, and strains localise in bands a few spacings of the cloud wide. "
        "Compare clouds of several spacings");
}

template void warn_of_path<2>(const Settings<2>&, const NonlinearEquilibrium<2>&, const State&, Result<2>&);
template void warn_of_path<3>(const Settings<3>&, const NonlinearEquilibrium<3>&, const State&, Result<3>&);

}  // namespace efree::internal
