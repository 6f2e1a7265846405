// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/equations/internal/patch_shear.hpp"

#include "efree/core/parallel.hpp"
#include "efree/solvers/equations/internal/stiffness_terms.hpp"
#include "efree/solvers/equations/locking.hpp"

#include <algorithm>
#include <cmath>
#include <span>

namespace efree::internal {
namespace {

/// F(3, 1) in a tensor flattened by columns.
constexpr int out_of_plane = 2;

const SharedMaterial& material_of(const ElasticModel& model, Index region) {
  return model.regions.empty() ? model.material : model.regions[region];
}
/// Of isotropic materials.
template <int Dim> double shear_modulus(const Stiffness<Dim>& stiffness) {
  return stiffness.C(voigt_size<Dim> - 1, voigt_size<Dim> - 1);
}

}  // namespace

template <int Dim> std::vector<double> patch_moduli(const Approximation<Dim>& approximation,
                                                    const Materials<Dim>& materials, const ElasticModel& model) {
  if (approximation.dilatation.size() == 0 || !flows(model)) return bearable_kappas(approximation, materials, model);
  const auto& points = approximation.quadrature;
  const bool elements = approximation.shape.num_nodes() == approximation.space.size();
  const double most = bearable_incompressibility(elements ? BasisKind::p2 : BasisKind::mls);
  std::vector<double> moduli(points.size(), 0.0);
  Stiffness<Dim> room;
  for (Index K = 0; K < points.size(); ++K) {
    const Index region = points.region[K];
    const bool elastic = material_of(model, region)->elastic();
    if (!elastic && Dim == 3) continue;
    const Stiffness<Dim>& stiffness = materials.stiffness(region, points.points.col(K), room);
    const double G = shear_modulus(stiffness), bulk = stiffness.C(0, 0) - 4.0 / 3.0 * G;
    if (bulk <= most * G)
      moduli[K] = stiffness.kappa;
    else if (!elastic || !elements)
      moduli[K] = bearable_kappa(stiffness);
  }
  return moduli;
}

template <int Dim> std::vector<double> patch_shears(const Approximation<Dim>& approximation,
                                                    const Materials<Dim>& materials, const ElasticModel& model,
                                                    const std::vector<double>& moduli) {
  if (Dim == 3 || moduli.empty() || !flows(model)) return {};
  const auto& points = approximation.quadrature;
  std::vector<double> shears(points.size(), 0.0);
  Stiffness<Dim> room;
  for (Index K = 0; K < points.size(); ++K) {
    const Index region = points.region[K];
    if (!material_of(model, region)->elastic())
      shears[K] = std::sqrt(moduli[K] / shear_modulus(materials.stiffness(region, points.points.col(K), room)));
  }
  return shears;
}

template <int Dim> ShearedResponses<Dim> respond(const Materials<Dim>& materials, const ElasticModel& model,
                                                 const Discretization<Dim>& points, const Gradients<Dim>& H,
                                                 const Vector& shears, const Vector& history, double dt,
                                                 bool tangents) {
  if (shears.size() == 0) return {materials.respond(points, H, history, dt, tangents), {}, {}, {}, {}};
  constexpr Index batch = 256;
  const Index all = points.size();
  ShearedResponses<Dim> result;
  result.P.resize(gradient_size<Dim>, all);
  result.history.resize(history.size());
  for (Vector* values : {&result.energy, &result.dissipated, &result.shear_stress}) values->resize(all);
  if (tangents) {
    result.A.resize(all);
    result.stress_by_shear.resize(gradient_size<Dim>, all);
    result.shear_by_gradient.resize(gradient_size<Dim>, all);
    result.shear_stiffness.resize(all);
  }
  const auto places = materials.history_places(points);
  std::vector<std::vector<Index>> by_region(materials.num_regions());
  for (Index K = 0; K < all; ++K) by_region[points.region[K]].push_back(K);
  for (Index region = 0; region < materials.num_regions(); ++region) {
    const Material& material = *material_of(model, region);
    const std::vector<Index>& of = by_region[region];
    const Index remembered = material.history_size();
    parallel_chunks(static_cast<Index>(of.size()), batch, [&](Index begin, Index end) {
      const Index n = end - begin;
      const std::span<const Index> here(of.data() + begin, of.data() + end);
      Points<3> X = Points<3>::Zero(3, n);
      X.topRows(Dim) = points.points(Eigen::all, here);
      auto deformation = Deformation::none(std::move(X), remembered);
      deformation.dt = dt;
      for (Index k = 0; k < n; ++k) {
        const Index K = here[k];
        deformation.history.col(k) = history.segment(places[K], remembered);
        for (int a = 0; a < gradient_size<Dim>; ++a) deformation.F(tensor_places<Dim>[a], k) += H(a, K);
        deformation.F(out_of_plane, k) += shears[K];
      }
      const MaterialResponse response = efree::respond(material, deformation, tangents);
      for (Index k = 0; k < n; ++k) {
        const Index K = here[k];
        result.history.segment(places[K], remembered) = response.history.col(k);
        result.energy[K] = response.energy[k];
        result.dissipated[K] = response.dissipated[k];
        result.shear_stress[K] = response.P(out_of_plane, k);
        for (int a = 0; a < gradient_size<Dim>; ++a) result.P(a, K) = response.P(tensor_places<Dim>[a], k);
        if (!tangents) continue;
        const auto A = response.tangent_at(k);
        result.shear_stiffness[K] = A(out_of_plane, out_of_plane);
        for (int a = 0; a < gradient_size<Dim>; ++a) {
          result.stress_by_shear(a, K) = A(tensor_places<Dim>[a], out_of_plane);
          result.shear_by_gradient(a, K) = A(out_of_plane, tensor_places<Dim>[a]);
          for (int b = 0; b < gradient_size<Dim>; ++b)
            result.A[K](a, b) = A(tensor_places<Dim>[a], tensor_places<Dim>[b]);
        }
      }
    });
  }
  return result;
}

template std::vector<double> patch_shears<2>(const Approximation<2>&, const Materials<2>&, const ElasticModel&,
                                             const std::vector<double>&);
template std::vector<double> patch_shears<3>(const Approximation<3>&, const Materials<3>&, const ElasticModel&,
                                             const std::vector<double>&);
template std::vector<double> patch_moduli<2>(const Approximation<2>&, const Materials<2>&, const ElasticModel&);
template std::vector<double> patch_moduli<3>(const Approximation<3>&, const Materials<3>&, const ElasticModel&);
template ShearedResponses<2> respond<2>(const Materials<2>&, const ElasticModel&, const Discretization<2>&,
                                        const Gradients<2>&, const Vector&, const Vector&, double, bool);
template ShearedResponses<3> respond<3>(const Materials<3>&, const ElasticModel&, const Discretization<3>&,
                                        const Gradients<3>&, const Vector&, const Vector&, double, bool);

}  // namespace efree::internal
