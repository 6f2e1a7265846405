// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/static_analysis.hpp"

#include "efree/assembly/loads.hpp"
#include "efree/core/concurrently.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/mesh/internal/flat_cells.hpp"
#include "efree/solvers/cholesky.hpp"
#include "efree/solvers/internal/stiffness_terms.hpp"
#include "efree/solvers/linear_step.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>

namespace efree {

namespace {

/// Twice the shear energy per shear modulus of a Voigt strain: |dev eps|^2.
template <int Dim> double deviator_squared(const Voigt<Dim>& strain, bool axisymmetric) {
  const int normals = Dim == 2 && !axisymmetric ? 2 : 3;  // that there are
  const double mean = strain.head(normals).mean();
  return (strain.head(normals).array() - mean).square().sum() +
         0.5 * strain.template tail<voigt_size<Dim> - 3>().squaredNorm();
}

/// Whether a cell is so flat that gradients in it are those of interpolation, not of the field: less than a thousandth
/// of the measure of the regular simplex with its longest edge.
template <int Dim> bool is_sliver(const FineMesh<Dim>& mesh, Index c) {
  const double regular = Dim == 2 ? std::sqrt(3.0) / 2.0 : 1.0 / std::sqrt(2.0);
  return internal::flatness<Dim>(mesh.vertices(), mesh.cells(), c) < 1e-3 * regular;
}

/// A quadrature with too few points leaves deformations without stiffness; a solution that holds such ones is refused.
/// Compares the distortion the quadrature sees with that of the field itself on the fine mesh, slivers left out.
template <int Dim>
void require_stable(const Approximation<Dim>& approximation, const Points<Dim>& U, const VoigtPoints<Dim>& strain) {
  constexpr double smallest_share = 0.05;
  const auto& space = approximation.space;
  const auto& mesh = space.mesh();
  double seen = 0.0;
  for (Index K = 0; K < approximation.quadrature.size(); ++K)
    seen += approximation.quadrature.weights[K] * deviator_squared<Dim>(strain.col(K), space.axisymmetric());
  const Points<Dim> u = interpolate(approximation.shape, U);
  const auto& rule = space.cell_rule();
  double there = 0.0, worst = 0.0;
  Vec<Dim> where = Vec<Dim>::Zero();
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    if (is_sliver(mesh, c)) continue;
    double of_cell = 0.0;
    for (Index q = 0; q < rule.weights.size(); ++q)
      of_cell += space.weight(c, q) *
                 deviator_squared<Dim>(strain_at<Dim>(space, c, rule.points.col(q), u), space.axisymmetric());
    there += of_cell;
    if (of_cell > worst) {
      worst = of_cell;
      where = mesh.vertices()(Eigen::all, mesh.cells().col(c)).rowwise().mean();
    }
  }
  const double diameter = (mesh.vertices().rowwise().maxCoeff() - mesh.vertices().rowwise().minCoeff()).norm();
  const double rounding = 1e-20 * approximation.quadrature.weights.sum() * u.squaredNorm() /
                          (static_cast<double>(u.cols()) * diameter * diameter);
  if (there > rounding && seen < smallest_share * there)
    throw NumericalError(
        fmt::format("unstable: the {} quadrature points see {:.1g} % of the distortion of {} nodes, which is largest "
                    "around ({:.5g}); "
                    "raise the ratio M/N, or put more nodes there",
                    approximation.quadrature.size(), 100.0 * seen / there, approximation.shape.num_nodes(),
                    fmt::join(where, ", ")));
}

/// Strains, stresses and energy of the field with these coefficients.
template <int Dim> Solution<Dim> derived(const Approximation<Dim>& approximation, const Materials<Dim>& materials,
                                         const std::vector<StiffnessTerm<Dim>>& terms, Points<Dim> coefficients) {
  Solution<Dim> solution;
  solution.coefficients = std::move(coefficients);
  for (const auto& term : terms) {
    const Gradients<Dim> H = gradient(*term.discretization, solution.coefficients);
    for (Index K = 0; K < term.discretization->size(); ++K)
      solution.strain_energy += 0.5 * term.discretization->weights[K] * H.col(K).dot(term.tangents[K] * H.col(K));
  }
  const auto& quadrature = approximation.quadrature;
  solution.strain = strain(quadrature, solution.coefficients);
  solution.stress.resizeLike(solution.strain);
  VoigtPoints<Dim> mean;
  if (approximation.dilatation.size() > 0) mean = strain(approximation.dilatation, solution.coefficients);
  parallel_for(quadrature.size(), [&](Index K) {
    Stiffness<Dim> room;
    const Stiffness<Dim>& stiffness = materials.stiffness(quadrature.region[K], quadrature.points.col(K), room);
    Voigt<Dim> eps = solution.strain.col(K);
    solution.strain(2, K) += stiffness.thinning.dot(eps);
    if (mean.size() > 0)  // the pressure lives on the unions
      eps += (mean.col(approximation.union_of[K]) - eps).template head<3>().sum() * stiffness.swelling;
    solution.stress.col(K) = stiffness.C * eps;
  });
  if (!std::isfinite(solution.strain_energy) || !solution.strain.allFinite() || !solution.stress.allFinite())
    throw NumericalError(
        fmt::format("the solution is not finite (strain energy {}): loads or displacements are too large for "
                    "floating-point numbers",
                    solution.strain_energy));
  return solution;
}

}  // namespace

template <int Dim> struct ElasticSolver<Dim>::Impl {
  Equilibrium<Dim> equations;
  Cholesky factor;  ///< of the tangent
};

template <int Dim> ElasticSolver<Dim>::ElasticSolver(const Approximation<Dim>& approximation, const ElasticModel& model,
                                                     const std::vector<DisplacementCondition<Dim>>& conditions,
                                                     const Monitor& monitor) {
  SymmetricMatrix K;
  {
    Stage stage("assembly", monitor);
    impl_.reset(new Impl{Equilibrium<Dim>(approximation, model, conditions), {}});
    K = impl_->equations.tangent_pattern();
    concurrently([&] { impl_->factor.analyse(K, impl_->equations.node_of_unknowns()); },
                 [&] { impl_->equations.tangent(impl_->equations.rest(), K); });
  }
  if (!K.coeffs().allFinite())
    throw NumericalError("the stiffness is not finite: moduli or springs are too large for floating-point numbers");
  Stage stage("solve", monitor);
  try {
    impl_->factor.factorize_definite(K);
  } catch (const NumericalError& error) {
    throw NumericalError(fmt::format(
        "{}; {} nodes, {} quadrature points: too few quadrature points per node leave deformations without stiffness "
        "(raise the ratio M/N), as do euclidean weights across a slit (use geodesic ones)",
        error.what(), approximation.shape.num_nodes(), approximation.quadrature.size()));
  }
}

template <int Dim> ElasticSolver<Dim>::~ElasticSolver() = default;
template <int Dim> ElasticSolver<Dim>::ElasticSolver(ElasticSolver&&) noexcept = default;

template <int Dim> Index ElasticSolver<Dim>::num_unknowns() const {
  return static_cast<Index>(impl_->equations.node_of_unknowns().size());
}

template <int Dim>
Solution<Dim> evaluate(const Approximation<Dim>& approximation, const ElasticModel& model, Points<Dim> coefficients) {
  const auto materials = materials_of(model, approximation.space.mesh());
  return derived(approximation, materials, stiffness_terms(approximation, materials, model.stabilisation),
                 std::move(coefficients));
}

template <int Dim> Solution<Dim> ElasticSolver<Dim>::solve(const Loads<Dim>& loads) const {
  return std::move(solve_all({loads}).front());
}

template <int Dim>
std::vector<Solution<Dim>> ElasticSolver<Dim>::solve_all(const std::vector<Loads<Dim>>& cases) const {
  std::vector<Equilibrium<Dim>> equations;
  for (const Loads<Dim>& loads : cases) equations.push_back(impl_->equations.with(loads));
  std::vector<const Equations*> all;
  for (const auto& one : equations) all.push_back(&one);
  const auto& approximation = impl_->equations.approximation();
  std::vector<Solution<Dim>> solutions;
  for (const State& state : linear_steps(all, impl_->factor, impl_->equations.rest())) {
    solutions.push_back(derived(approximation, impl_->equations.materials(), impl_->equations.stiffness_terms(),
                                Points<Dim>(state.u.reshaped(Dim, approximation.shape.num_nodes()))));
    require_stable<Dim>(approximation, solutions.back().coefficients, solutions.back().strain);
  }
  return solutions;
}

template <int Dim>
Resultants<Dim> ElasticSolver<Dim>::reactions(const Solution<Dim>& solution, const Loads<Dim>& loads) const {
  State state = impl_->equations.rest();
  state.u = solution.coefficients.reshaped();
  state.factor = 1.0;
  return impl_->equations.with(loads).reactions(state);
}

template <int Dim> Response<Dim> ElasticSolver<Dim>::respond(const Functional<Dim>& functional, const Solution<Dim>& u,
                                                             const Loads<Dim>& loads) const {
  const Equilibrium<Dim>& problem = impl_->equations;
  const auto& approximation = problem.approximation();
  require(approximation.shape.num_nodes() == approximation.space.size(),
          "dual solutions are of finite elements: correct the answer of a cloud");
  Points<Dim> forces = functional.forces;
  double value = 0.0;
  if (functional.weak_motion.size() > 0) {
    forces -= problem.weak_forces(functional.weak_motion);
    value += problem.weak_prescribed().cwiseProduct(functional.weak_motion).sum();
  }
  value += forces.cwiseProduct(u.coefficients).sum();
  const Equilibrium<Dim> dual = problem.homogeneous(forces);
  State z = dual.under(1.0, dual.rest());
  if (functional.motion.size() > 0) {
    const Points<Dim> held = -problem.held_part(functional.motion);
    const Points<Dim> load = load_vector(approximation.space, approximation.shape, loads);
    z.u = held.reshaped();
    value += held.cwiseProduct(load - problem.initial_tangent_times(u.coefficients)).sum();
  }
  z = dual.moved(z, impl_->factor.solve(-dual.residual(z)));
  return {.displacement = z.u.reshaped(Dim, approximation.shape.num_nodes()), .value = value};
}

template Solution<2> evaluate<2>(const Approximation<2>&, const ElasticModel&, Points<2>);
template class ElasticSolver<2>;
template Solution<3> evaluate<3>(const Approximation<3>&, const ElasticModel&, Points<3>);
template class ElasticSolver<3>;

}  // namespace efree
