// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/elements_beside.hpp"

#include "efree/assembly/operators.hpp"
#include "efree/core/error.hpp"
#include "efree/solvers/cholesky.hpp"
#include "efree/solvers/correction.hpp"
#include "efree/solvers/locking.hpp"

#include <algorithm>
#include <cmath>

namespace efree {
namespace {

/// Forces out of balance that are nothing beside what a cloud is off.
constexpr double nothing = 1e-7;

template <int Dim> ApproximationOptions elements_of(const Approximation<Dim>& cloud) {
  return {.kind = cloud.averaged || cloud.space.degree() == 2 ? BasisKind::p2 : BasisKind::p1,
          .axisymmetric = cloud.space.axisymmetric(),
          .dilatation = Dilatation::pointwise};
}

/// Values (columns) of functions on the space of a cloud, or at its vertices and linear along edges, at the nodes of
/// finite elements on the same mesh.
template <int Dim> Matrix at_nodes(const Matrix& values, const Approximation<Dim>& elements) {
  const auto given = static_cast<Index>(values.cols());
  const auto edges = given < elements.space.size() ? elements.space.edges() : std::vector<std::array<Index, 2>>();
  Matrix result(values.rows(), static_cast<Index>(elements.node_dofs.size()));
  for (Index node = 0; node < result.cols(); ++node) {
    const Index dof = elements.node_dofs[node];
    if (dof < given) {
      result.col(node) = values.col(dof);
    } else {
      const auto& [a, b] = edges[dof - given];
      result.col(node) = 0.5 * (values.col(a) + values.col(b));
    }
  }
  return result;
}

/// Factors of tangents that are positive definite. Where one is not, as in cells that a cloud's motion has crushed, as
/// much of the stiffness at rest is added as it takes (Levenberg 1944): changes then lead to less energy all the same.
class Steadied final : public LinearSolver {
 public:
  explicit Steadied(const SymmetricMatrix& at_rest) : at_rest_(at_rest) {}
  void analyse(const SymmetricMatrix& pattern, const std::vector<Index>& node_of) override {
    cholesky_.analyse(pattern, node_of);
  }
  void factorize(const SymmetricMatrix& lower) override {
    added_ = 0.0;
    if (cholesky_.factorize_if_definite(lower)) return;
    constexpr double least = 0.1, most = 100.0, growth = 4.0;
    SymmetricMatrix more = lower;
    for (double share = least; share < most; share *= growth) {
      more.coeffs() = lower.coeffs() + share * at_rest_.coeffs();
      added_ = share;
      if (cholesky_.factorize_if_definite(more)) return;
    }
    throw NumericalError("the tangent is far from positive definite");
  }
  Index negative_pivots() const override { return added_ > 0.0 ? 1 : 0; }
  Matrix solve(const Eigen::Ref<const Matrix>& B) const override { return cholesky_.solve(B); }

 private:
  const SymmetricMatrix& at_rest_;
  Cholesky cholesky_;
  double added_ = 0.0;
};

double mean_stress(const auto& stress) {
  return stress.template head<3>().sum() / 3.0;
}

}  // namespace

template <int Dim> ElementsBeside<Dim>::ElementsBeside(const Approximation<Dim>& cloud, const ElasticModel& model,
                                                       Program<Dim> program, const Monitor& monitor)
    : cloud_(cloud) {
  require(is_elastic(model) && !takes_mean_dilatation(cloud, model),
          "finite elements beside a cloud: elastic materials expected that are not nearly incompressible");
  elements_ = std::make_shared<const Approximation<Dim>>(
      approximate<Dim>(cloud.space.shared_mesh(), elements_of(cloud), monitor));
  equations_ = std::make_shared<const NonlinearEquilibrium<Dim>>(*elements_, model, std::move(program));
}

template <int Dim>
BesideCloud<Dim> ElementsBeside<Dim>::balance(const State& cloud, const VoigtPoints<Dim>& stress) const {
  State start = cloud;
  const Points<Dim> at_vertices =
      interpolate(cloud_.shape, Points<Dim>(cloud.u.reshaped(Dim, cloud_.shape.num_nodes())));
  start.u = at_nodes<Dim>(at_vertices, *elements_).reshaped();
  start.history = equations_->rest().history;
  SymmetricMatrix at_rest;
  equations_->tangent(equations_->rest(), at_rest);
  Steadied linear(at_rest);
  TangentSolver tangent(*equations_, linear);
  Converged there =
      newton(*equations_, tangent, start, start.time, {.tolerance = nothing, .max_iterations = 50, .keep = 0.3});
  SymmetricMatrix K;
  equations_->tangent(there.state, K);
  if (Cholesky last; last.analyse(K, equations_->node_of_unknowns()), !last.factorize_if_definite(K))
    throw NumericalError("the one that they find is not stable");
  const auto& points = elements_->quadrature;
  const PointFields<Dim> from = equations_->fields(start), to = equations_->fields(there.state);
  double work = 0.0;
  if (!cloud_.averaged) {
    const Vector apart = there.state.u - start.u;
    const Gradients<Dim> H = gradient(points, Points<Dim>(apart.reshaped(Dim, apart.size() / Dim)));
    for (Index K = 0; K < points.size(); ++K) work += points.weights[K] * (to.P.col(K) - from.P.col(K)).dot(H.col(K));
  } else {
    const Matrix recovered = at_nodes<Dim>(stress.leftCols(cloud_.space.size()), *elements_);
    Stiffness<Dim> room;
    for (Index K = 0; K < points.size(); ++K) {
      const Voigt<Dim> stress_apart = to.stress.col(K) - from.stress.col(K);
      const Voigt<Dim> strain_apart = to.strain.col(K) - from.strain.col(K);
      double pressure = mean_stress(Voigt<Dim>(to.stress.col(K)));
      const auto row = points.shape.row(K);
      for (std::size_t k = 0; k < row.nodes.size(); ++k)
        pressure -= row.N[k] * mean_stress(Voigt<Dim>(recovered.col(row.nodes[k])));
      const double kappa = equations_->materials().stiffness(points.region[K], points.points.col(K), room).kappa;
      work += points.weights[K] *
              (stress_apart.dot(strain_apart) - mean_stress(stress_apart) * strain_apart.template head<3>().sum() +
               pressure * pressure / kappa);
    }
  }
  const double done = 2.0 * points.weights.dot(to.energy);
  BesideCloud<Dim> result{std::move(there.state), there.iterations() + 1};
  if (done > 0.0) result.distance = std::sqrt(std::abs(work) / done);
  return result;
}

template class ElementsBeside<2>;
template class ElementsBeside<3>;

}  // namespace efree
