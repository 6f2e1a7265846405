// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/equations/internal/stiffness_terms.hpp"

#include "efree/assembly/operators.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/core/parallel.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <optional>

namespace efree {

template <int Dim> double bearable_kappa(const Stiffness<Dim>& stiffness) {
  std::vector<int> there;
  Voigt<Dim> m = Voigt<Dim>::Zero(), mandel = Voigt<Dim>::Constant(std::sqrt(2.0));
  for (int k = 0; k < voigt_size<Dim>; ++k) {
    if (k < 3) mandel[k] = 1.0;
    if (!(stiffness.S(k, k) > 0.0)) continue;
    there.push_back(k);
    if (k < 3) m[k] = 1.0;
  }
  const VoigtMatrix<Dim> rest =
      mandel.asDiagonal() * (stiffness.C - stiffness.kappa * m * m.transpose()) * mandel.asDiagonal();
  // The smallest eigenvalue is that of the strain by pressure, zero; those of shear are twice the modulus.
  const Vector least = internal::eigenvalues<Eigen::Dynamic>(rest(there, there));
  return std::min(stiffness.kappa, least[1] / m.sum());
}

template <int Dim> std::vector<double> bearable_kappas(const Approximation<Dim>& approximation,
                                                       const Materials<Dim>& materials, const ElasticModel& model) {
  const auto& points = approximation.quadrature;
  const bool elements = approximation.shape.num_nodes() == approximation.space.size();
  if (approximation.dilatation.size() == 0 || elements) return {};
  std::vector<double> result(points.size(), 0.0);
  std::vector<std::optional<double>> uniform(materials.num_regions());
  for (Index K = 0; K < points.size(); ++K) {
    const Index region = points.region[K];
    if (!(model.regions.empty() ? model.material : model.regions[region])->elastic()) continue;
    if (uniform[region]) {
      result[K] = *uniform[region];
      continue;
    }
    Stiffness<Dim> room;
    result[K] = bearable_kappa(materials.stiffness(region, points.points.col(K), room));
    if (materials.is_uniform(region)) uniform[region] = result[K];
  }
  return result;
}

namespace {

/// By pressure function the mean of the values at points, weighted by its square: between the least and the largest of
/// the patch.
template <int Dim>
std::vector<double> means_by_function(const Approximation<Dim>& approximation, const Vector& values) {
  const Vector& weights = approximation.quadrature.weights;
  const SparseRows members = approximation.pressures.transpose();
  std::vector<double> means(members.rows());
  parallel_for(static_cast<Index>(members.rows()), [&](Index j) {
    // Of differences, so that pressure functions in a uniform material have one value, bit for bit, and share a
    // tangent.
    const double first = values[SparseRows::InnerIterator(members, j).col()];
    double sum = 0.0, all = 0.0;
    for (SparseRows::InnerIterator K(members, j); K; ++K) {
      const double weight = weights[K.col()] * K.value() * K.value();
      sum += weight * (values[K.col()] - first);
      all += weight;
    }
    means[j] = first + sum / all;
  });
  return means;
}

/// Adds kappa m m^T to the tangents at points.
template <int Dim>
void add_bulk(const Gradient<Dim>& m, const std::vector<double>& kappa, PointTangents<Dim>& tangents) {
  PointTangents<Dim> sum;
  for (std::size_t K = 0; K < kappa.size(); ++K) {
    // Points of one tangent mostly have one kappa, and follow each other.
    if (K > 0 && tangents.at[K] == tangents.at[K - 1] && kappa[K] == kappa[K - 1]) {
      sum.at.push_back(sum.at.back());
      continue;
    }
    sum.at.push_back(static_cast<Index>(sum.values.size()));
    sum.values.push_back(tangents[static_cast<Index>(K)] + kappa[K] * m * m.transpose());
  }
  tangents = std::move(sum);
}

/// A x at every point.
template <int Dim> Gradients<Dim> times(const PointTangents<Dim>& A, Gradients<Dim> x) {
  parallel_for(static_cast<Index>(x.cols()), [&](Index K) { x.col(K) = A[K] * Gradient<Dim>(x.col(K)); });
  return x;
}

}  // namespace

template <int Dim> std::vector<StiffnessTerm<Dim>> stiffness_terms(const Approximation<Dim>& approximation,
                                                                   const Materials<Dim>& materials,
                                                                   double stabilisation,
                                                                   const std::vector<double>& bearable) {
  if (!(stabilisation >= 0.0 && stabilisation <= 1.0))
    throw InputError(fmt::format("stabilisation = {}, expected a number from 0 to 1", stabilisation));
  const bool averages = approximation.dilatation.size() > 0;
  const bool stabilised = is_stabilised(approximation, stabilisation);
  if (!averages && !stabilised) return {{&approximation.quadrature, materials.tangents(approximation.quadrature)}};
  const double share = stabilised ? 1.0 - stabilisation : 1.0;
  std::vector<StiffnessTerm<Dim>> terms;
  terms.push_back(
      {&approximation.quadrature, materials.tangents(approximation.quadrature, StiffnessPart::deviatoric, share)});
  if (stabilised)
    terms.push_back(
        {&approximation.fine, materials.tangents(approximation.fine, StiffnessPart::deviatoric, stabilisation)});
  const auto& points = approximation.quadrature;
  if (!averages) {
    terms.push_back({&points, materials.tangents(points, StiffnessPart::volumetric), true});
    return terms;
  }
  Vector kappa(points.size());
  parallel_for(points.size(), [&](Index K) {
    Stiffness<Dim> room;
    kappa[K] = materials.stiffness(points.region[K], points.points.col(K), room).kappa;
    if (!bearable.empty()) kappa[K] -= bearable[K];
  });
  PointTangents<Dim> none{{Tangent<Dim>::Zero()}, std::vector<Index>(approximation.dilatation.size(), 0)};
  terms.push_back({&approximation.dilatation, std::move(none), true});
  add_bulk(materials.trace(), means_by_function(approximation, kappa), terms.back().tangents);
  if (!bearable.empty()) add_bulk(materials.trace(), bearable, terms.front().tangents);
  return terms;
}

template <int Dim> bool is_stabilised(const Approximation<Dim>& approximation, double stabilisation) {
  const auto all_points = approximation.space.mesh().num_cells() * approximation.space.cell_rule().weights.size();
  if (stabilisation == 0.0 || approximation.quadrature.size() >= all_points) return false;
  if (approximation.fine.size() == 0)
    throw InputError(
        fmt::format("stabilisation = {} needs full integration: approximate with fine = true", stabilisation));
  return true;
}

template <int Dim> Points<Dim> forces_of(const std::vector<StiffnessTerm<Dim>>& terms, const Points<Dim>& U) {
  Points<Dim> forces = Points<Dim>::Zero(Dim, U.cols());
  for (const auto& term : terms)
    forces += internal_force(*term.discretization, times(term.tangents, gradient(*term.discretization, U)));
  return forces;
}

template double bearable_kappa<2>(const Stiffness<2>&);
template double bearable_kappa<3>(const Stiffness<3>&);
template std::vector<double> bearable_kappas<2>(const Approximation<2>&, const Materials<2>&, const ElasticModel&);
template std::vector<double> bearable_kappas<3>(const Approximation<3>&, const Materials<3>&, const ElasticModel&);
template std::vector<StiffnessTerm<2>> stiffness_terms<2>(const Approximation<2>&, const Materials<2>&, double,
                                                          const std::vector<double>&);
template std::vector<StiffnessTerm<3>> stiffness_terms<3>(const Approximation<3>&, const Materials<3>&, double,
                                                          const std::vector<double>&);
template bool is_stabilised<2>(const Approximation<2>&, double);
template bool is_stabilised<3>(const Approximation<3>&, double);
template Points<2> forces_of<2>(const std::vector<StiffnessTerm<2>>&, const Points<2>&);
template Points<3> forces_of<3>(const std::vector<StiffnessTerm<3>>&, const Points<3>&);

}  // namespace efree
