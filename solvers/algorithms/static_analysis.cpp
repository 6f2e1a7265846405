// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/algorithms/static_analysis.hpp"

#include "efree/assembly/loads.hpp"
#include "efree/core/concurrently.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/mesh/internal/flat_cells.hpp"
#include "efree/solvers/algorithms/linear_step.hpp"
#include "efree/solvers/equations/internal/side_by_side.hpp"
#include "efree/solvers/equations/internal/stiffness_terms.hpp"
#include "efree/solvers/linear/cholesky.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <array>
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

/// A quadrature with too few points leaves deformations without stiffness; solutions that hold such ones are refused.
/// Compares the distortion the quadrature sees with that of the field between the vertices of the fine mesh, slivers
/// left out.
template <int Dim>
void require_stable(const Approximation<Dim>& approximation, const std::vector<Solution<Dim>>& solutions) {
  constexpr double smallest_share = 0.05;
  const auto& space = approximation.space;
  const auto& mesh = space.mesh();
  const auto& rule = space.cell_rule();
  const auto& quadrature = approximation.quadrature;
  if (quadrature.size() >= mesh.num_cells() * static_cast<Index>(rule.weights.size())) return;  // sees everything
  const std::size_t count = solutions.size();
  std::vector<Points<Dim>> u(count, Points<Dim>(Dim, mesh.num_vertices()));
  parallel_for(mesh.num_vertices(), [&](Index v) {
    const auto row = approximation.shape.row(v);
    for (std::size_t k = 0; k < count; ++k) {
      Vec<Dim> sum = Vec<Dim>::Zero();
      for (std::size_t i = 0; i < row.nodes.size(); ++i) sum += row.N[i] * solutions[k].coefficients.col(row.nodes[i]);
      u[k].col(v) = sum;
    }
  });

  struct Distortion {
    double all = 0.0, largest = 0.0;
    Index cell = 0;  ///< where it is largest
  };
  constexpr Index chunk = 1024;
  std::vector<std::vector<Distortion>> parts((mesh.num_cells() + chunk - 1) / chunk, std::vector<Distortion>(count));
  parallel_chunks(mesh.num_cells(), chunk, [&](Index begin, Index end) {
    auto& part = parts[begin / chunk];
    for (Index c = begin; c < end; ++c) {
      if (is_sliver(mesh, c)) continue;
      const auto dN = mesh.hat_gradients(c);
      const auto dofs = space.cell(c);
      const double r = space.axisymmetric() ? mesh.centroid(c)[0] : 0.0;
      for (std::size_t k = 0; k < count; ++k) {
        Gradient<Dim> H = Gradient<Dim>::Zero();
        for (int i = 0; i <= Dim; ++i) {
          const Vec<Dim> at = u[k].col(dofs[i]);
          for (int J = 0; J < Dim; ++J) H.template segment<Dim>(Dim * J) += dN(J, i) * at;
          if constexpr (Dim == 2)
            if (r > 0.0) H[4] += at[0] / (3.0 * r);
        }
        const double of_cell = space.volume(c) * deviator_squared<Dim>(strain_of<Dim>(H), space.axisymmetric());
        part[k].all += of_cell;
        if (of_cell > part[k].largest) part[k].largest = of_cell, part[k].cell = c;
      }
    }
  });
  const double diameter = (mesh.vertices().rowwise().maxCoeff() - mesh.vertices().rowwise().minCoeff()).norm();
  for (std::size_t k = 0; k < count; ++k) {
    double seen = 0.0;
    for (Index K = 0; K < quadrature.size(); ++K)
      seen += quadrature.weights[K] * deviator_squared<Dim>(solutions[k].strain.col(K), space.axisymmetric());
    Distortion there;
    for (const auto& part : parts) {
      there.all += part[k].all;
      if (part[k].largest > there.largest) there.largest = part[k].largest, there.cell = part[k].cell;
    }
    const double rounding = 1e-20 * quadrature.weights.sum() * u[k].squaredNorm() /
                            (static_cast<double>(u[k].cols()) * diameter * diameter);
    if (there.all > rounding && seen < smallest_share * there.all)
      throw NumericalError(
          fmt::format("unstable: the {} quadrature points see {:.1g} % of the distortion of {} nodes, which is largest "
                      "around ({:.5g}); "
                      "raise the ratio M/N, or put more nodes there",
                      quadrature.size(), 100.0 * seen / there.all, approximation.shape.num_nodes(),
                      fmt::join(mesh.centroid(there.cell), ", ")));
  }
}

/// What a functional works with on displacements of finite elements.
template <int Dim> Points<Dim> forces_of(const Equilibrium<Dim>& problem, const Functional<Dim>& functional) {
  if (functional.weak_motion.size() == 0) return functional.forces;
  return functional.forces - problem.weak_forces(functional.weak_motion);
}

/// The energy of the field with coefficients U in some terms of the stiffness.
template <int Dim> double energy_of(const std::vector<StiffnessTerm<Dim>>& terms, const Points<Dim>& U) {
  double energy = 0.0;
  for (const auto& term : terms) {
    const Gradients<Dim> H = gradient(*term.discretization, U);
    for (Index K = 0; K < term.discretization->size(); ++K)
      energy += 0.5 * term.discretization->weights[K] * H.col(K).dot(term.tangents[K] * H.col(K));
  }
  return energy;
}

/// Strains, stresses and energies of the fields with these coefficients. All of them at a point before the next, so
/// that what is stored of the points is read once.
template <int Dim> std::vector<Solution<Dim>> derived(const Approximation<Dim>& approximation,
                                                      const Materials<Dim>& materials,
                                                      const std::vector<StiffnessTerm<Dim>>& terms,
                                                      std::vector<Points<Dim>> coefficients) {
  const auto& quadrature = approximation.quadrature;
  const bool averages = approximation.dilatation.size() > 0;
  const bool by_points = terms.size() == 1;  // the stiffness is that of the points, and so is the energy
  const std::size_t count = coefficients.size();
  std::vector<Solution<Dim>> solutions(count);
  std::vector<Vector> averaged(averages ? count : 0);  // dilatations by point
  for (std::size_t k = 0; k < count; ++k) {
    solutions[k].coefficients = std::move(coefficients[k]);
    solutions[k].strain.resize(voigt_size<Dim>, quadrature.size());
    solutions[k].stress.resize(voigt_size<Dim>, quadrature.size());
    if (averages)
      averaged[k] = approximation.pressures *
                    strain(approximation.dilatation, solutions[k].coefficients).topRows(3).colwise().sum().transpose();
  }
  std::vector<const Points<Dim>*> of_solutions;
  for (const auto& solution : solutions) of_solutions.push_back(&solution.coefficients);
  const auto displacements = internal::side_by_side(of_solutions);
  constexpr Index chunk = 1024;
  std::vector<std::vector<double>> energies((quadrature.size() + chunk - 1) / chunk, std::vector<double>(count));
  parallel_chunks(quadrature.size(), chunk, [&](Index begin, Index end) {
    std::vector<double>& energy = energies[begin / chunk];
    Stiffness<Dim> room;
    internal::PointResponse<Dim> there;
    std::array<double, internal::most_side_by_side> dilatations{};
    for (Index K = begin; K < end; ++K) {
      const Stiffness<Dim>& stiffness = materials.stiffness(quadrature.region[K], quadrature.points.col(K), room);
      const auto row = quadrature.shape.row(K);
      std::size_t k = 0;
      for (const auto& u : displacements) {
        for (Index lane = 0; averages && lane < u.count(); ++lane) dilatations[lane] = averaged[k + lane][K];
        internal::respond(u, row, stiffness, averages ? dilatations.data() : nullptr, there);
        for (Index lane = 0; lane < u.count(); ++lane, ++k) {
          double* const strain = solutions[k].strain.col(K).data();
          double* const stress = solutions[k].stress.col(K).data();
          for (int i = 0; i < voigt_size<Dim>; ++i) {
            strain[i] = there.strain[i * u.lanes() + lane];
            stress[i] = there.stress[i * u.lanes() + lane];
          }
          energy[k] += 0.5 * quadrature.weights[K] * there.work[lane];
        }
      }
    }
  });
  constexpr double least = 1e-290;
  for (std::size_t k = 0; k < count; ++k) {
    Solution<Dim>& solution = solutions[k];
    double of_points = 0.0;
    for (const auto& part : energies) of_points += part[k];
    solution.strain_energy = by_points ? of_points : energy_of(terms, solution.coefficients);
    // Products of stresses and strains are none where these are.
    if (!std::isfinite(solution.strain_energy) || !std::isfinite(of_points))
      throw NumericalError(
          fmt::format("the solution is not finite (strain energy {}): loads or displacements are too large for "
                      "floating-point numbers",
                      solution.strain_energy));
    // Errors are measured by energies.
    if (of_points >= least) continue;
    if (const double largest = solution.stress.cwiseAbs().maxCoeff(); largest > 0.0)
      throw NumericalError(
          fmt::format("the strain energy is {:.2g} with stresses of {:.2g}: loads or displacements are too small for "
                      "products of floating-point numbers, take other units",
                      of_points, largest));
  }
  return solutions;
}

/// By node, the largest stiffness of an unknown of its own; zero where all is held.
Vector stiffness_alone(const SymmetricMatrix& K, const std::vector<Index>& node_of, Index nodes) {
  Vector stiffness = Vector::Zero(nodes);
  for (Index i = 0; i < K.cols(); ++i) stiffness[node_of[i]] = std::max(stiffness[node_of[i]], K.coeff(i, i));
  return stiffness;
}

/// Refuses solutions of which rounding has left an error, in the energy norm, that counts: what the forces out of
/// balance move, and what the matrix has lost by its own rounding, which these do not see (linear elements in a beam
/// 3000 times as long as high: an energy 18 % off, 0.5 % by the forces). Looked for where the energy is so little of
/// what nodes would have that moved alone (`alone`: their stiffness) that rounding these may be much of it: bodies that
/// are very slender, or hardly held, or very soft beside stiff. Pivots do not tell: of a beam that is eliminated from
/// its free end all are alike. Bodies that supports move as a whole have no energy but that of rounding, and are
/// answers.
template <int Dim> void require_solved(const Cholesky& factor, const Vector& alone, const Equilibrium<Dim>& unloaded,
                                       const std::vector<Equilibrium<Dim>>& equations, const std::vector<State>& states,
                                       const std::vector<Solution<Dim>>& solutions) {
  // Error of the energy over 2^-53 of what nodes would have that moved alone: cantilevers 0.8 to 4.2.
  constexpr double of_matrix = 4.0 * 0x1p-53;
  constexpr double suspicious = 1e-3 * 0x1p53, as_a_whole = 1e-6 * 0x1p106, bearable = 0.01, nothing_else = 0.7;
  for (std::size_t k = 0; k < solutions.size(); ++k) {
    const double twice = 2.0 * solutions[k].strain_energy;
    const double one_by_one = solutions[k].coefficients.colwise().squaredNorm().dot(alone);
    if (one_by_one <= suspicious * twice) continue;
    const State begun = equations[k].under(1.0, equations[k].rest());
    const bool moved = !begun.u.isZero(0.0) || !equations[k].weak_prescribed().isZero(0.0);
    if (moved && one_by_one > as_a_whole * twice) continue;
    const Vector left = equations[k].residual(states[k]);
    Matrix forces(left.size(), 2);  // and those of the loads, springs' energy included
    forces << left, equations[k].residual(begun) - unloaded.residual(begun);
    const Matrix moves = factor.solve(forces);
    const double whole = std::max(twice, forces.col(1).dot(moves.col(1)));
    double error = std::sqrt(std::max(0.0, forces.col(0).dot(moves.col(0))) / whole);
    if (moved && error > nothing_else) continue;
    if (!moved) error = std::max(error, of_matrix * one_by_one / whole);
    if (whole > 0.0 && !(error < bearable))
      throw NumericalError(fmt::format(
          "the equations are so ill-conditioned that rounding leaves an error of {:.1g} % in the energy norm: the body "
          "is too slender for its mesh, moduli and springs are too far apart, or supports move it much further than "
          "they strain it",
          100.0 * error));
  }
}

}  // namespace

template <int Dim> struct ElasticSolver<Dim>::Impl {
  Equilibrium<Dim> equations;
  Cholesky factor;  ///< of the tangent
  Vector alone;     ///< stiffness_alone
};

template <int Dim> ElasticSolver<Dim>::ElasticSolver(const Approximation<Dim>& approximation, const ElasticModel& model,
                                                     const std::vector<DisplacementCondition<Dim>>& conditions,
                                                     const Monitor& monitor) {
  SymmetricMatrix K;
  {
    Stage stage("assembly", monitor);
    impl_.reset(new Impl{Equilibrium<Dim>(approximation, model, conditions), {}, {}});
    K = impl_->equations.tangent_pattern();
    concurrently([&] { impl_->factor.analyse(K, impl_->equations.node_of_unknowns()); },
                 [&] { impl_->equations.tangent(impl_->equations.rest(), K); });
  }
  if (!K.coeffs().allFinite())
    throw NumericalError("the stiffness is not finite: moduli or springs are too large for floating-point numbers");
  impl_->alone = stiffness_alone(K, impl_->equations.node_of_unknowns(), approximation.shape.num_nodes());
  Stage stage("solve", monitor);
  try {
    impl_->factor.factorize_definite(K);
  } catch (const NumericalError& error) {
    if (approximation.shape.num_nodes() == approximation.space.size())
      throw NumericalError(
          fmt::format("{}; {} nodes of finite elements: moduli, springs or sizes of cells are too far apart",
                      error.what(), approximation.shape.num_nodes()));
    throw NumericalError(fmt::format(
        "{}; {} nodes, {} quadrature points: too few quadrature points per node leave deformations without stiffness "
        "(raise the ratio M/N), as do euclidean weights across a slit (use geodesic ones) and moduli too far apart",
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
  std::vector<Points<Dim>> all;
  all.push_back(std::move(coefficients));
  return std::move(evaluate_all(approximation, model, std::move(all)).front());
}

template <int Dim> std::vector<Solution<Dim>> evaluate_all(const Approximation<Dim>& approximation,
                                                           const ElasticModel& model,
                                                           std::vector<Points<Dim>> coefficients) {
  const auto materials = materials_of(model, approximation.space.mesh());
  return derived(
      approximation, materials,
      stiffness_terms(approximation, materials, model.stabilisation, bearable_kappas(approximation, materials, model)),
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
  const std::vector<State> states = linear_steps(all, impl_->factor, impl_->equations.rest());
  std::vector<Points<Dim>> coefficients;
  for (const State& state : states) coefficients.emplace_back(state.u.reshaped(Dim, approximation.shape.num_nodes()));
  auto solutions =
      derived(approximation, impl_->equations.materials(), impl_->equations.stiffness_terms(), std::move(coefficients));
  require_stable(approximation, solutions);
  require_solved(impl_->factor, impl_->alone, impl_->equations, equations, states, solutions);
  return solutions;
}

template <int Dim>
std::vector<Resultants<Dim>> ElasticSolver<Dim>::reactions(const std::vector<const Solution<Dim>*>& solutions,
                                                           const std::vector<Loads<Dim>>& cases) const {
  std::vector<const Points<Dim>*> coefficients;
  std::vector<const VoigtPoints<Dim>*> stresses;
  for (const Solution<Dim>* solution : solutions) {
    coefficients.push_back(&solution->coefficients);
    stresses.push_back(&solution->stress);
  }
  return impl_->equations.reactions(cases, coefficients, stresses);
}

template <int Dim>
std::vector<Points<Dim>> ElasticSolver<Dim>::duals(const std::vector<Functional<Dim>>& functionals) const {
  const Equilibrium<Dim>& problem = impl_->equations;
  const auto& approximation = problem.approximation();
  require(approximation.shape.num_nodes() == approximation.space.size(),
          "dual solutions are of finite elements: correct the answer of a cloud");
  std::vector<Equilibrium<Dim>> duals;
  std::vector<State> states;
  Matrix forces(num_unknowns(), static_cast<Index>(functionals.size()));
  for (Index k = 0; k < forces.cols(); ++k) {
    const Equilibrium<Dim>& dual = duals.emplace_back(problem.homogeneous(forces_of(problem, functionals[k])));
    State& z = states.emplace_back(dual.under(1.0, dual.rest()));
    if (functionals[k].motion.size() > 0) z.u = -problem.held_part(functionals[k].motion).reshaped();
    forces.col(k) = -dual.residual(z);
  }
  const Matrix changes = impl_->factor.solve(forces);
  std::vector<Points<Dim>> displacements;
  for (Index k = 0; k < forces.cols(); ++k)
    displacements.emplace_back(
        duals[k].moved(states[k], changes.col(k)).u.reshaped(Dim, approximation.shape.num_nodes()));
  return displacements;
}

template <int Dim> double ElasticSolver<Dim>::value(const Functional<Dim>& functional, const Points<Dim>& u,
                                                    const Loads<Dim>& loads) const {
  const Equilibrium<Dim>& problem = impl_->equations;
  const auto& approximation = problem.approximation();
  double value = forces_of(problem, functional).cwiseProduct(u).sum();
  if (functional.weak_motion.size() > 0) value += problem.weak_prescribed().cwiseProduct(functional.weak_motion).sum();
  if (functional.motion.size() > 0)
    value += problem.held_part(functional.motion)
                 .cwiseProduct(problem.initial_tangent_times(u) -
                               load_vector(approximation.space, approximation.shape, loads))
                 .sum();
  return value;
}

template Solution<2> evaluate<2>(const Approximation<2>&, const ElasticModel&, Points<2>);
template std::vector<Solution<2>> evaluate_all<2>(const Approximation<2>&, const ElasticModel&, std::vector<Points<2>>);
template class ElasticSolver<2>;
template Solution<3> evaluate<3>(const Approximation<3>&, const ElasticModel&, Points<3>);
template std::vector<Solution<3>> evaluate_all<3>(const Approximation<3>&, const ElasticModel&, std::vector<Points<3>>);
template class ElasticSolver<3>;

}  // namespace efree
