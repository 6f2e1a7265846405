// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/static_analysis.hpp"

#include "efree/assembly/bodies.hpp"
#include "efree/assembly/loads.hpp"
#include "efree/assembly/nitsche.hpp"
#include "efree/assembly/nodal_conditions.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/mesh/internal/flat_cells.hpp"
#include "efree/solvers/cholesky.hpp"
#include "efree/solvers/internal/stiffness_terms.hpp"
#include "efree/solvers/locking.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>

namespace efree {

template <int Dim> std::vector<StiffnessTerm<Dim>> stiffness_terms(const Approximation<Dim>& approximation,
                                                                   const Materials<Dim>& materials,
                                                                   double stabilisation) {
  if (!(stabilisation >= 0.0 && stabilisation <= 1.0))
    throw InputError(fmt::format("stabilisation = {}, expected a number from 0 to 1", stabilisation));
  const bool unions = approximation.dilatation.size() > 0;
  const auto all_points = approximation.space.mesh().num_cells() * approximation.space.cell_rule().weights.size();
  const bool integrated_fully = approximation.quadrature.size() >= all_points;
  const bool stabilised = stabilisation > 0.0 && !integrated_fully;
  if (stabilised && approximation.fine.size() == 0)
    throw InputError(
        fmt::format("stabilisation = {} needs full integration: approximate with fine = true", stabilisation));
  if (!unions && !stabilised) return {{&approximation.quadrature, materials.tangents(approximation.quadrature)}};
  const double share = stabilised ? 1.0 - stabilisation : 1.0;
  std::vector<StiffnessTerm<Dim>> terms;
  terms.push_back(
      {&approximation.quadrature, materials.tangents(approximation.quadrature, StiffnessPart::deviatoric, share)});
  if (stabilised)
    terms.push_back(
        {&approximation.fine, materials.tangents(approximation.fine, StiffnessPart::deviatoric, stabilisation)});
  const auto& volumetric = unions ? approximation.dilatation : approximation.quadrature;
  terms.push_back({&volumetric, materials.tangents(volumetric, StiffnessPart::volumetric), true});
  return terms;
}

namespace {

/// Lower triangle of T^T K T for a block diagonal T of frames at a few nodes.
template <int Dim> SymmetricMatrix rotate(const SymmetricMatrix& K, const NodalConditions<Dim>& conditions) {
  Eigen::SparseMatrix<double, Eigen::ColMajor, Index> T(K.rows(), K.cols());
  std::vector<Eigen::Triplet<double, Index>> entries;
  std::vector<char> turned(K.rows() / Dim, 0);
  for (std::size_t k = 0; k < conditions.nodes.size(); ++k) {
    turned[conditions.nodes[k]] = 1;
    for (int i = 0; i < Dim; ++i)
      for (int j = 0; j < Dim; ++j)
        if (const double value = conditions.frames[k](i, j); value != 0.0)
          entries.emplace_back(Dim * conditions.nodes[k] + i, Dim * conditions.nodes[k] + j, value);
  }
  for (Index a = 0; a < K.rows() / Dim; ++a)
    for (int i = 0; i < Dim && !turned[a]; ++i) entries.emplace_back(Dim * a + i, Dim * a + i, 1.0);
  T.setFromTriplets(entries.begin(), entries.end());
  const SymmetricMatrix full = K.template selfadjointView<Eigen::Lower>();
  return SymmetricMatrix(T.transpose() * full * T).template triangularView<Eigen::Lower>();
}

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

template <int Dim> bool is_identity(const std::vector<Mat<Dim>>& frames) {
  for (const auto& frame : frames)
    if (frame != Mat<Dim>::Identity()) return false;
  return true;
}

}  // namespace

template <int Dim> Materials<Dim> materials_of(const ElasticModel& model, const FineMesh<Dim>& mesh) {
  require(Dim == 3 || model.plane.has_value(),
          "a model in 2D does not say what its plane stands for: expected Plane::stress, strain or axisymmetric");
  if (!model.regions.empty() && static_cast<Index>(model.regions.size()) != mesh.num_regions())
    throw InputError(fmt::format("{} materials for {} regions ({}), expected one for each", model.regions.size(),
                                 mesh.num_regions(), fmt::join(mesh.region_names(), ", ")));
  return {model.regions.empty() ? std::vector<SharedMaterial>(mesh.num_regions(), model.material) : model.regions,
          model.plane.value_or(Plane::strain)};
}

template <int Dim> struct ElasticSolver<Dim>::Impl {
  const Approximation<Dim>& approximation;
  Materials<Dim> materials;
  std::vector<StiffnessTerm<Dim>> terms;
  Vector prescribed_rhs;  ///< what the displacement conditions add to the right-hand side

  // Strong conditions: unknowns are the components, in the nodes' frames, that are not fixed.
  NodalConditions<Dim> nodal;
  std::vector<Index> unknown;  ///< number of each degree of freedom among the unknowns, or -1; empty if all are unknown
  Vector fixed;                ///< prescribed values in the frames, zero elsewhere

  SymmetricMatrix held_columns;  ///< of finite elements: those of the stiffness that belong to what nodal values hold
  /// Nitsche's conditions, for what they say of reactions; empty with nodal ones, and on bases that are not asked.
  NitscheSystem<Dim> weak;

  Index num_unknowns = 0;
  std::optional<Cholesky> factor;

  SymmetricMatrix assemble(const ElasticModel& model, const std::vector<DisplacementCondition<Dim>>& conditions) {
    const auto restrained = restraints(conditions);
    const auto ties = tied_facets(approximation.space.mesh(), model.open_interface);
    require_restrained(approximation.space, restrained, ties);
    SymmetricMatrix K;
    for (const auto& term : terms) {
      const SymmetricMatrix part = stiffness_matrix(*term.discretization, term.tangents);
      K = K.size() ? SymmetricMatrix(K + part) : part;
    }
    prescribed_rhs = Vector::Zero(K.rows());
    if (model.essential.value_or(Essential::nitsche) == Essential::nitsche) {
      auto system = nitsche(approximation.space, approximation.shape, terms, restrained, ties);
      prescribed_rhs = system.rhs;
      K += system.matrix;
      if (is_elements()) weak = std::move(system);
      return K;
    }
    if (!ties.empty()) K += nitsche<Dim>(approximation.space, approximation.shape, terms, {}, ties).matrix;
    nodal = nodal_conditions(approximation.space, approximation.shape, approximation.node_dofs, restrained);
    return eliminate(is_identity<Dim>(nodal.frames) ? K : rotate(K, nodal));
  }

  /// The columns of K that are not unknown; the others are empty.
  SymmetricMatrix columns_of_held(const SymmetricMatrix& K) const {
    std::vector<Eigen::Triplet<double, Index>> entries;
    for (Index c = 0; c < K.cols(); ++c)
      for (SymmetricMatrix::InnerIterator entry(K, c); entry; ++entry) {
        if (unknown[c] < 0) entries.emplace_back(entry.row(), c, entry.value());
        if (entry.row() != c && unknown[entry.row()] < 0) entries.emplace_back(c, entry.row(), entry.value());
      }
    SymmetricMatrix columns(K.rows(), K.cols());
    columns.setFromTriplets(entries.begin(), entries.end());
    return columns;
  }

  /// Keeps the rows and columns of the unknowns; what the fixed ones contribute goes to prescribed_rhs.
  SymmetricMatrix eliminate(const SymmetricMatrix& K) {
    unknown.assign(K.rows(), 0);
    fixed = Vector::Zero(K.rows());
    for (std::size_t k = 0; k < nodal.nodes.size(); ++k)
      for (int i = 0; i < nodal.fixed[k]; ++i) {
        unknown[Dim * nodal.nodes[k] + i] = -1;
        fixed[Dim * nodal.nodes[k] + i] = nodal.values[k][i];
      }
    Index count = 0;
    for (Index& number : unknown)
      if (number >= 0) number = count++;
    if (is_elements()) held_columns = columns_of_held(K);
    const Vector reaction = K.template selfadjointView<Eigen::Lower>() * fixed;
    prescribed_rhs = -reaction;
    std::vector<Index> offsets{0}, rows;
    std::vector<double> values;
    for (Index c = 0; c < K.cols(); ++c) {
      if (unknown[c] < 0) continue;
      for (SymmetricMatrix::InnerIterator entry(K, c); entry; ++entry)
        if (unknown[entry.row()] >= 0) rows.push_back(unknown[entry.row()]), values.push_back(entry.value());
      offsets.push_back(static_cast<Index>(rows.size()));
    }
    return Eigen::Map<const SymmetricMatrix>(count, count, static_cast<Index>(rows.size()), offsets.data(), rows.data(),
                                             values.data());
  }

  /// Whether the coefficients are the values at the fine degrees of freedom.
  bool is_elements() const { return approximation.shape.num_nodes() == approximation.space.size(); }

  /// `given`: what the prescribed displacements push with; `held`: these, in the nodes' frames.
  Points<Dim> solve(const Points<Dim>& loads, const Vector& given, const Vector& held) const {
    Points<Dim> f = loads;
    for (std::size_t k = 0; k < nodal.nodes.size(); ++k)
      f.col(nodal.nodes[k]) = nodal.frames[k].transpose() * f.col(nodal.nodes[k]);
    const Vector rhs = f.reshaped() + given;
    Vector u;
    if (unknown.empty()) {
      u = factor->solve(rhs);
    } else {
      Vector reduced(num_unknowns);
      for (std::size_t dof = 0; dof < unknown.size(); ++dof)
        if (unknown[dof] >= 0) reduced[unknown[dof]] = rhs[static_cast<Index>(dof)];
      const Vector free = factor->solve(reduced);
      u = held;
      for (std::size_t dof = 0; dof < unknown.size(); ++dof)
        if (unknown[dof] >= 0) u[static_cast<Index>(dof)] = free[unknown[dof]];
    }
    if (!u.allFinite()) throw NumericalError("the solution is not finite");
    Points<Dim> U = u.reshaped(Dim, u.size() / Dim);
    for (std::size_t k = 0; k < nodal.nodes.size(); ++k)
      U.col(nodal.nodes[k]) = nodal.frames[k] * Vec<Dim>(U.col(nodal.nodes[k]));
    return U;
  }

  /// The node of each unknown; ascending.
  std::vector<Index> node_of_unknowns() const {
    std::vector<Index> nodes;
    for (Index dof = 0; dof < Dim * approximation.shape.num_nodes(); ++dof)
      if (unknown.empty() || unknown[dof] >= 0) nodes.push_back(dof / Dim);
    return nodes;
  }
};

template <int Dim>
ElasticSolver<Dim>::ElasticSolver(const Approximation<Dim>& approximation, const ElasticModel& model,
                                  const std::vector<DisplacementCondition<Dim>>& conditions, const Monitor& monitor)
    : impl_(new Impl{
          approximation, materials_of(model, approximation.space.mesh()), {}, {}, {}, {}, {}, {}, {}, {}, {}}) {
  if (Dim == 2 && approximation.space.axisymmetric() != (model.plane == Plane::axisymmetric))
    throw InputError(approximation.space.axisymmetric()
                         ? "the basis is axisymmetric and the model is not: expected Plane::axisymmetric"
                         : "the model is axisymmetric: approximate with axisymmetric = true");
  require_decided(approximation, model);
  impl_->terms = stiffness_terms(approximation, impl_->materials, model.stabilisation);
  SymmetricMatrix K;
  {
    Stage stage("assembly", monitor);
    K = impl_->assemble(model, conditions);
    impl_->num_unknowns = static_cast<Index>(K.rows());
  }
  if (!K.coeffs().allFinite())
    throw NumericalError("the stiffness is not finite: moduli are too large for floating-point numbers");
  Stage stage("solve", monitor);
  try {
    impl_->factor.emplace(K, impl_->node_of_unknowns());
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
  return impl_->num_unknowns;
}

template <int Dim>
Solution<Dim> evaluate(const Approximation<Dim>& approximation, const ElasticModel& model, Points<Dim> coefficients) {
  const auto materials = materials_of(model, approximation.space.mesh());
  return derived(approximation, materials, stiffness_terms(approximation, materials, model.stabilisation),
                 std::move(coefficients));
}

template <int Dim> Solution<Dim> ElasticSolver<Dim>::solve(const Loads<Dim>& loads) const {
  const auto& approximation = impl_->approximation;
  Solution<Dim> solution = derived(
      approximation, impl_->materials, impl_->terms,
      impl_->solve(load_vector(approximation.space, approximation.shape, loads), impl_->prescribed_rhs, impl_->fixed));
  require_stable<Dim>(approximation, solution.coefficients, solution.strain);
  return solution;
}

template <int Dim> Response<Dim> ElasticSolver<Dim>::respond(const Functional<Dim>& functional, const Solution<Dim>& u,
                                                             const Loads<Dim>& loads) const {
  const Impl& problem = *impl_;
  const auto& approximation = problem.approximation;
  require(problem.is_elements(), "dual solutions are of finite elements: correct the answer of a cloud");
  Points<Dim> forces = functional.forces;
  Vector given = Vector::Zero(problem.prescribed_rhs.size()), held = Vector::Zero(problem.fixed.size());
  double value = 0.0;
  if (functional.weak_motion.size() > 0) {
    const Vector motion = functional.weak_motion.reshaped();
    forces -= (problem.weak.matrix.template selfadjointView<Eigen::Lower>() * motion).reshaped(Dim, forces.cols());
    value += problem.prescribed_rhs.dot(motion);
  }
  value += forces.cwiseProduct(u.coefficients).sum();
  if (functional.motion.size() > 0) {
    Points<Dim> moved = u.coefficients, load = load_vector(approximation.space, approximation.shape, loads);
    for (std::size_t k = 0; k < problem.nodal.nodes.size(); ++k) {
      const Index node = problem.nodal.nodes[k];
      const Mat<Dim> to_frame = problem.nodal.frames[k].transpose();
      moved.col(node) = to_frame * Vec<Dim>(moved.col(node));
      load.col(node) = to_frame * Vec<Dim>(load.col(node));
      const Vec<Dim> motion = to_frame * functional.motion.col(node);
      for (int i = 0; i < problem.nodal.fixed[k]; ++i) held[Dim * node + i] = -motion[i];
    }
    given = -problem.held_columns * held;
    value += held.dot(load.reshaped()) + given.dot(moved.reshaped());
  }
  return {.displacement = problem.solve(forces, given, held), .value = value};
}

template Materials<2> materials_of<2>(const ElasticModel&, const FineMesh<2>&);
template Materials<3> materials_of<3>(const ElasticModel&, const FineMesh<3>&);
template Solution<2> evaluate<2>(const Approximation<2>&, const ElasticModel&, Points<2>);
template class ElasticSolver<2>;
template Solution<3> evaluate<3>(const Approximation<3>&, const ElasticModel&, Points<3>);
template class ElasticSolver<3>;

template std::vector<StiffnessTerm<2>> stiffness_terms<2>(const Approximation<2>&, const Materials<2>&, double);
template std::vector<StiffnessTerm<3>> stiffness_terms<3>(const Approximation<3>&, const Materials<3>&, double);

}  // namespace efree
