// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/algorithms/elements_beside.hpp"

#include "efree/assembly/operators.hpp"
#include "efree/basis/internal/lifted.hpp"
#include "efree/core/error.hpp"
#include "efree/materials/internal/softened.hpp"
#include "efree/solvers/algorithms/correction.hpp"
#include "efree/solvers/equations/locking.hpp"
#include "efree/solvers/linear/cholesky.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace efree {
namespace {

/// Forces out of balance that are nothing beside what a cloud is off.
constexpr double nothing = 1e-7;

/// Stiffness against volume over that against shear (incompressibility) from which on bulk moduli begin there, and
/// their next values over the last ones: the second step has nothing to be foreseen from.
constexpr double lowest_ratio = 20.0, first_rise = 3.0, rise = 10.0;

template <int Dim> ApproximationOptions elements_of(const Approximation<Dim>& cloud, const ElasticModel& model) {
  return {.kind = ElementsBeside<Dim>::degree(cloud) == 2 ? BasisKind::p2 : BasisKind::p1,
          .axisymmetric = cloud.space.axisymmetric(),
          .dilatation = averaged_if(takes_mean_dilatation(cloud, model))};
}

/// By region, the stiffness of its material against volume over that against shear, in one of its cells; 0 of materials
/// of small strains, and in plane stress.
template <int Dim> std::vector<double> incompressibilities(const ElasticModel& model, const FineMesh<Dim>& mesh) {
  const auto count = std::max<std::size_t>(1, model.regions.size());
  if (model.plane == Plane::stress) return std::vector<double>(count, 0.0);
  std::vector<double> all(count, -1.0);
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    const std::size_t region = model.regions.empty() ? 0 : mesh.region(c);
    if (all[region] >= 0.0) continue;
    const Material& material = model.regions.empty() ? *model.material : *model.regions[region];
    Points<3> X = Points<3>::Zero(3, 1);
    X.template topRows<Dim>() = mesh.centroid(c);
    all[region] =
        !material.finite_strain()
            ? 0.0
            : incompressibility(respond(material, Deformation::none(X, material.history_size()), true).tangent_at(0));
  }
  return all;
}

/// The model with bulk moduli that are no more than so many times the shear moduli.
ElasticModel softened(ElasticModel model, const std::vector<double>& ratios, double most) {
  const auto soften = [&](SharedMaterial& material, double ratio) {
    if (ratio > most) material = internal::Softened(material, most / ratio);
  };
  if (model.regions.empty()) soften(model.material, ratios.front());
  for (std::size_t r = 0; r < model.regions.size(); ++r) soften(model.regions[r], ratios[r]);
  return model;
}

/// Factors of tangents that are positive definite. Where one is not, as in cells that a cloud's motion has crushed, as
/// much of the stiffness at rest is added as it takes (Levenberg 1944): changes then lead to less energy all the same.
class Steadied final : public LinearSolver {
 public:
  explicit Steadied(const Equations& equations) : equations_(equations) {}
  void analyse(const SymmetricMatrix& pattern, const std::vector<Index>& node_of) override {
    cholesky_.analyse(pattern, node_of);
  }
  void factorize(const SymmetricMatrix& lower) override {
    if (is_definite(lower)) return;
    if (at_rest_.size() == 0) equations_.tangent(equations_.rest(), at_rest_);
    constexpr double least = 0.1, most = 100.0, growth = 4.0;
    SymmetricMatrix more = lower;
    for (double share = least; share < most; share *= growth) {
      more.coeffs() = lower.coeffs() + share * at_rest_.coeffs();
      if (is_definite(more)) return;
    }
    throw NumericalError("the tangent is far from positive definite");
  }
  bool is_definite(const SymmetricMatrix& lower) { return cholesky_.factorize_if_definite(lower); }
  Index negative_pivots() const override { return cholesky_.negative_pivots(); }
  Matrix solve(const Eigen::Ref<const Matrix>& B) const override { return cholesky_.solve(B); }

 private:
  const Equations& equations_;
  SymmetricMatrix at_rest_;  ///< empty until it is needed
  Cholesky cholesky_;
};

/// Whether parts that are held along the same direction meet, so that the forces on the vertices between them are
/// nobody's.
template <int Dim> bool shared_holds(const FineMesh<Dim>& mesh, const Program<Dim>& program) {
  struct Hold {
    std::string part;
    Vec<Dim> direction;
  };
  std::vector<std::vector<Hold>> holds(mesh.num_vertices());
  for (const Restraint<Dim>& restraint : restraints(program.conditions(program.full_at))) {
    if (restraint.is_elastic()) continue;
    for (const Index f : mesh.group(restraint.on)) {
      const Vec<Dim> direction = restraint.direction(mesh.facet_normal(f));
      for (const Index v : mesh.facets().col(f)) {
        for (const Hold& other : holds[v])
          if (other.part != restraint.on && std::abs(other.direction.dot(direction)) > 1e-6) return true;
        holds[v].push_back({restraint.on, direction});
      }
    }
  }
  return false;
}

double mean_stress(const auto& stress) {
  return stress.template head<3>().sum() / 3.0;
}

}  // namespace

template <int Dim> ElementsBeside<Dim>::ElementsBeside(const Approximation<Dim>& cloud, const ElasticModel& model,
                                                       Program<Dim> program, const Monitor& monitor)
    : cloud_(cloud), model_(model), program_(std::move(program)) {
  require(is_elastic(model), "finite elements beside a cloud: elastic materials expected");
  elements_ = std::make_shared<const Approximation<Dim>>(
      approximate<Dim>(cloud.space.shared_mesh(), elements_of(cloud, model), monitor));
  if (!shared_holds(cloud.space.mesh(), program_)) model_.essential = Essential::strong;
  try {
    equations_ = equations_of(model_);
  } catch (const InputError&) {  // normal displacements on a part that is not flat
    if (model_.essential == model.essential) throw;
    model_.essential = model.essential;
    equations_ = equations_of(model_);
  }
}

template <int Dim> auto ElementsBeside<Dim>::equations_of(const ElasticModel& model) const -> SharedEquations {
  return std::make_shared<const NonlinearEquilibrium<Dim>>(*elements_, model, program_);
}

template <int Dim> BesideCloud<Dim> ElementsBeside<Dim>::balance_from(const State& start, LinearSolver& linear) const {
  BesideCloud<Dim> now{start};
  const auto solve = [&](const NonlinearEquilibrium<Dim>& equations, LinearSolver& by, double tolerance) {
    TangentSolver tangent(equations, by);
    Converged there =
        newton(equations, tangent, now.state, start.time, {.tolerance = tolerance, .max_iterations = 50, .keep = 0.3});
    now.iterations += there.iterations() + 1;
    now.state = std::move(there.state);
  };
  const std::vector<double> ratios = incompressibilities(model_, elements_->space.mesh());
  const double highest = std::ranges::max(ratios);
  constexpr double near = 1e-4;
  double softness = 0.0;  // 1 / ratio
  Vector slope;           // of the motion by that, where it is known
  const auto foresee = [&](double next) {
    if (slope.size() > 0) now.state.u += (next - softness) * slope;
  };
  for (double ratio = lowest_ratio, factor = first_rise; ratio < highest; ratio *= factor, factor = rise) {
    const Vector before = now.state.u;
    foresee(1.0 / ratio);
    const SharedEquations softer = equations_of(softened(model_, ratios, ratio));
    Steadied steadied(*softer);
    solve(*softer, steadied, near);
    if (softness > 0.0) slope = (now.state.u - before) / (1.0 / ratio - softness);
    softness = 1.0 / ratio;
  }
  foresee(1.0 / highest);
  solve(*equations_, linear, nothing);
  return now;
}

template <int Dim>
BesideCloud<Dim> ElementsBeside<Dim>::balance(const State& cloud, const VoigtPoints<Dim>& stress) const {
  State start = cloud;
  const Points<Dim> at_vertices =
      interpolate(cloud_.shape, Points<Dim>(cloud.u.reshaped(Dim, cloud_.shape.num_nodes())));
  start.u = internal::lifted<Dim>(elements_->space, at_vertices).reshaped();
  start.history = equations_->rest().history;
  Steadied linear(*equations_);
  BesideCloud<Dim> there = balance_from(start, linear);
  equations_->check(there.state);
  SymmetricMatrix K;
  equations_->tangent(there.state, K);
  if (!linear.is_definite(K)) throw NumericalError("the one that they find is not stable");
  const auto& points = elements_->quadrature;
  const PointFields<Dim> from = equations_->fields(start), to = equations_->fields(there.state);
  double work = 0.0;
  if (!cloud_.averaged) {
    const Vector apart = there.state.u - start.u;
    const Gradients<Dim> H = gradient(points, Points<Dim>(apart.reshaped(Dim, apart.size() / Dim)));
    for (Index p = 0; p < points.size(); ++p) work += points.weights[p] * (to.P.col(p) - from.P.col(p)).dot(H.col(p));
  } else {
    const Matrix recovered = internal::lifted<Dim>(elements_->space, stress.leftCols(cloud_.space.size()));
    Stiffness<Dim> room;
    for (Index p = 0; p < points.size(); ++p) {
      const Voigt<Dim> stress_apart = to.stress.col(p) - from.stress.col(p);
      const Voigt<Dim> strain_apart = to.strain.col(p) - from.strain.col(p);
      double pressure = mean_stress(Voigt<Dim>(to.stress.col(p)));
      const auto row = points.shape.row(p);
      for (std::size_t k = 0; k < row.nodes.size(); ++k)
        pressure -= row.N[k] * mean_stress(Voigt<Dim>(recovered.col(row.nodes[k])));
      const double kappa = equations_->materials().stiffness(points.region[p], points.points.col(p), room).kappa;
      work += points.weights[p] *
              (stress_apart.dot(strain_apart) - mean_stress(stress_apart) * strain_apart.template head<3>().sum() +
               pressure * pressure / kappa);
    }
  }
  const double done = 2.0 * points.weights.dot(to.energy);
  if (done > 0.0) there.distance = std::sqrt(std::abs(work) / done);
  return there;
}

template class ElementsBeside<2>;
template class ElementsBeside<3>;

}  // namespace efree
