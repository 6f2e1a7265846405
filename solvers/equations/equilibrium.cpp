// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/equations/equilibrium.hpp"

#include "efree/assembly/bodies.hpp"
#include "efree/assembly/internal/matrix_pattern.hpp"
#include "efree/assembly/loads.hpp"
#include "efree/assembly/nodal_conditions.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/materials/small_and_finite.hpp"
#include "efree/solvers/equations/internal/side_by_side.hpp"
#include "efree/solvers/equations/internal/stiffness_terms.hpp"
#include "efree/solvers/equations/locking.hpp"
#include "efree/solvers/equations/nodal_reactions.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <mutex>
#include <optional>

namespace efree {

using internal::add_stiffness;
using internal::BlockColumn;
using internal::MatrixPattern;
using internal::Unknowns;

ElasticModel linearised(ElasticModel model) {
  const auto linearise = [](SharedMaterial& material) {
    if (material && !material->linear()) material = Linearised(material);
  };
  linearise(model.material);
  std::ranges::for_each(model.regions, linearise);
  return model;
}

template <int Dim> Materials<Dim> materials_of(const ElasticModel& model, const FineMesh<Dim>& mesh) {
  require(Dim == 3 || model.plane.has_value(),
          "a model in 2D does not say what its plane stands for: expected Plane::stress, strain or axisymmetric");
  if (!model.regions.empty() && static_cast<Index>(model.regions.size()) != mesh.num_regions())
    throw InputError(fmt::format("{} materials for {} regions ({}), expected one for each", model.regions.size(),
                                 mesh.num_regions(), fmt::join(mesh.region_names(), ", ")));
  return {model.regions.empty() ? std::vector<SharedMaterial>(mesh.num_regions(), model.material) : model.regions,
          model.plane.value_or(Plane::strain)};
}

namespace {

/// A share of the materials' work on strains at points.
template <int Dim> struct WorkTerm {
  enum class Trace { own, averaged, none };
  const Discretization<Dim>* points;
  double share;
  Trace trace;
};

template <int Dim>
std::vector<WorkTerm<Dim>> work_terms(const Approximation<Dim>& approximation, double stabilisation) {
  using Trace = typename WorkTerm<Dim>::Trace;
  std::vector<WorkTerm<Dim>> terms{
      {&approximation.quadrature, 1.0, approximation.dilatation.size() > 0 ? Trace::averaged : Trace::own}};
  if (is_stabilised(approximation, stabilisation)) {
    terms.push_back({&approximation.quadrature, -stabilisation, Trace::none});
    terms.push_back({&approximation.fine, stabilisation, Trace::none});
  }
  return terms;
}

}  // namespace

template <int Dim> struct Equilibrium<Dim>::Data {
  const Approximation<Dim>& approximation;
  Materials<Dim> materials;
  bool linear;
  bool weakly;  ///< rigid restraints are set by Nitsche
  std::vector<Restraint<Dim>> rigid, elastic;
  std::vector<TiedFacets> ties;
  std::vector<double> bearable;             ///< by point: bearable_kappas
  std::vector<StiffnessTerm<Dim>> initial;  ///< the stiffness where nothing has happened yet
  std::vector<WorkTerm<Dim>> work;
  SymmetricMatrix weak;         ///< what holds the boundary weakly, and ties regions; empty if nothing does
  Points<Dim> weak_prescribed;  ///< the forces by which it prescribes displacements
  Unknowns<Dim> unknowns;
  MatrixPattern<Dim> pattern;
  /// What tells reactions; made when they are first asked for.
  struct Holding {
    std::once_flag once;
    std::optional<NitscheReactions<Dim>> by_nitsche;
    std::optional<NodalReactions<Dim>> by_nodes;
  };
  std::unique_ptr<Holding> holding = std::make_unique<Holding>();

  Points<Dim> displacements(const State& state) const { return state.u.reshaped(Dim, state.u.size() / Dim); }
  Points<Dim> weak_forces(const Points<Dim>& U) const {
    if (weak.size() == 0) return Points<Dim>::Zero(Dim, U.cols());
    const Vector forces = weak.template selfadjointView<Eigen::Lower>() * U.reshaped();
    return forces.reshaped(Dim, U.cols());
  }

  /// What the materials say at the points of one term, with what takes that back to the gradients of the points and of
  /// the patches.
  struct Answer {
    PointResponses<Dim> of;
    Gradients<Dim> swelling;  ///< by point: strain s that pressure makes, per dilatation; empty: own dilatations
    Gradient<Dim> trace;
    std::vector<double> bearable{};  ///< by point; empty: nothing
    Vector uneven{};                 ///< by point: the stress by which it resists another dilatation than its patch's

    /// s . P, the stress that works on the averaged dilatation (or on none).
    double pressure(Index K) const { return swelling.col(K).dot(of.P.col(K)) - (bearable.empty() ? 0.0 : uneven[K]); }
    Gradient<Dim> borne(Index K) const { return bearable.empty() ? 0.0 * trace : bearable[K] * trace; }
    /// What works on the gradient of the point itself.
    Gradient<Dim> stress(Index K) const {
      return swelling.cols() == 0 ? Gradient<Dim>(of.P.col(K)) : Gradient<Dim>(of.P.col(K) - pressure(K) * trace);
    }
    Tangent<Dim> tangent(Index K) const {
      if (swelling.cols() == 0) return of.A[K];
      const Tangent<Dim> left = Tangent<Dim>::Identity() - swelling.col(K) * trace.transpose();
      return left.transpose() * of.A[K] * left + borne(K) * trace.transpose();
    }
    /// Change of `stress` by the averaged dilatation.
    Gradient<Dim> stress_by_dilatation(Index K) const {
      const Gradient<Dim> change = of.A[K] * swelling.col(K);
      return change - swelling.col(K).dot(change) * trace - borne(K);
    }
    double bulk(Index K) const {
      return swelling.col(K).dot(of.A[K] * swelling.col(K)) + (bearable.empty() ? 0.0 : bearable[K]);
    }
  };

  Answer ask(const WorkTerm<Dim>& term, const State& state, Index first_history, bool tangents) const {
    using Trace = typename WorkTerm<Dim>::Trace;
    const Discretization<Dim>& points = *term.points;
    const Points<Dim> U = displacements(state);
    Answer answer{{}, {}, materials.trace()};
    Gradients<Dim> H = gradient(points, U);
    if (term.trace != Trace::own) {
      Vector averaged = Vector::Zero(points.size());
      if (term.trace == Trace::averaged)
        averaged = approximation.pressures * (gradient(approximation.dilatation, U).transpose() * Vector(answer.trace));
      answer.swelling.resizeLike(H);
      if (term.trace == Trace::averaged) answer.bearable = bearable;
      answer.uneven = Vector::Zero(static_cast<Index>(answer.bearable.size()));
      parallel_for(points.size(), [&](Index K) {
        Stiffness<Dim> room;
        const Gradient<Dim> s =
            gradient_of<Dim>(materials.stiffness(points.region[K], points.points.col(K), room).swelling);
        const double off = answer.trace.dot(H.col(K)) - averaged[K];
        answer.swelling.col(K) = s;
        if (!answer.bearable.empty()) answer.uneven[K] = bearable[K] * off;
        H.col(K) -= off * s;
      });
    }
    answer.of = materials.respond(points, H, state.history.segment(first_history, materials.history_size(points)),
                                  state.dt, tangents);
    for (Index K = 0; K < answer.uneven.size(); ++K)
      if (bearable[K] > 0.0) answer.of.energy[K] += 0.5 * answer.uneven[K] * answer.uneven[K] / bearable[K];
    return answer;
  }

  /// Calls visit(term, answer, first of its histories) for every term of the work.
  template <class Visit> void for_each_answer(const State& state, bool tangents, const Visit& visit) const {
    Index first = 0;
    for (const auto& term : work) {
      visit(term, ask(term, state, first, tangents), first);
      first += materials.history_size(*term.points);
    }
  }

  /// The tangent where nothing has happened yet, of all coefficients, times U.
  Points<Dim> initial_forces(const Points<Dim>& U) const {
    if (U.isZero(0.0)) return Points<Dim>::Zero(Dim, U.cols());
    return weak_forces(U) + forces_of(initial, U);
  }

  Points<Dim> internal_forces(const State& state) const {
    if (linear && state.u.isZero(0.0)) return Points<Dim>::Zero(Dim, state.u.size() / Dim);
    const Points<Dim> U = displacements(state);
    if (linear) return initial_forces(U);
    Points<Dim> forces = weak_forces(U);
    for_each_answer(state, false, [&](const WorkTerm<Dim>& term, const Answer& answer, Index) {
      Gradients<Dim> P(gradient_size<Dim>, term.points->size());
      for (Index K = 0; K < term.points->size(); ++K) P.col(K) = term.share * answer.stress(K);
      forces += internal_force(*term.points, P);
      if (term.trace != WorkTerm<Dim>::Trace::averaged) return;
      Vector pressure(term.points->size());
      for (Index K = 0; K < pressure.size(); ++K)
        pressure[K] = term.share * term.points->weights[K] * answer.pressure(K);
      const Vector by_function =
          (approximation.pressures.transpose() * pressure).cwiseQuotient(approximation.dilatation.weights);
      forces += internal_force(approximation.dilatation, Gradients<Dim>(answer.trace * by_function.transpose()));
    });
    return forces;
  }

  /// By coefficients under `factor` times what is prescribed, and forces that are internal less external; these are of
  /// no use where all is held weakly.
  Resultants<Dim> reactions(const Points<Dim>& U, double factor, const Points<Dim>& forces) const {
    const FineSpace<Dim>& space = approximation.space;
    const std::vector<Index>& nodes = approximation.node_dofs;
    auto& [once, by_nitsche, by_nodes] = *holding;
    std::call_once(once, [&, &by_nitsche = by_nitsche, &by_nodes = by_nodes] {
      std::vector<Restraint<Dim>> others = elastic;
      if (weakly) others.insert(others.end(), rigid.begin(), rigid.end());
      by_nitsche.emplace(space, approximation.shape, initial, others, ties);
      if (weakly) return;
      std::vector<Index> node_at(space.size(), -1);
      for (std::size_t I = 0; I < nodes.size(); ++I) node_at[nodes[I]] = static_cast<Index>(I);
      by_nodes.emplace(space, node_at, rigid, others);
    });
    Resultants<Dim> reactions = (*by_nitsche)(U, factor);
    if (weakly) return reactions;
    for (const auto& [part, of] : (*by_nodes)(forces)) reactions[part] += of;
    return reactions;
  }

  void initial_tangent(SymmetricMatrix& K) const {
    pattern.sum(
        unknowns,
        [&](Index a, BlockColumn<Dim>& column) {
          for (const auto& term : initial) add_stiffness(*term.discretization, term.tangents, a, column);
        },
        weak, K);
  }

  /// One term of the tangent at a state, before it is summed.
  struct TangentTerm {
    const Discretization<Dim>* points;
    std::vector<Tangent<Dim>> A;   ///< by point, times the share
    std::vector<Vec<Dim>> forces;  ///< by entry of the dilatations' table: those that such a dilatation makes, half of
                                   ///< its work on itself and on others of its patch included; empty without averages
  };

  TangentTerm tangent_term(const WorkTerm<Dim>& term, const Answer& answer) const {
    const Discretization<Dim>& points = *term.points;
    TangentTerm result{&points, std::vector<Tangent<Dim>>(points.size()), {}};
    parallel_for(points.size(), [&](Index K) { result.A[K] = term.share * answer.tangent(K); });
    if (term.trace != WorkTerm<Dim>::Trace::averaged) return result;
    const auto& table = approximation.dilatation.shape;
    const auto first_entry = [&](Index j) {
      return static_cast<std::size_t>(table.row(j).N.data() - table.row(0).N.data());
    };
    using Pressure = typename SparseRows::InnerIterator;
    result.forces.assign(static_cast<std::size_t>(table.num_entries()), Vec<Dim>::Zero());
    Matrix bulk = Matrix::Zero(Dim + 1, approximation.dilatation.size());  // column = function, row = one of its patch
    std::vector<Index> first_of_patch(approximation.dilatation.size());
    for (Index K = 0; K < points.size(); ++K) {
      const double weight = term.share * points.weights[K], on_itself = weight * answer.bulk(K);
      const Gradient<Dim> change = weight * answer.stress_by_dilatation(K);
      const auto row = points.shape.row(K);
      const auto first = static_cast<Index>(Pressure(approximation.pressures, K).col());
      const auto nodes = table.row(first).nodes;  // of all functions of the patch, and of all its points
      for (std::size_t k = 0, at = 0; k < row.nodes.size(); ++k) {
        while (nodes[at] != row.nodes[k]) ++at;
        const NodalGradient<Dim> by_node = nodal_gradient(row, k);
        for (Pressure j(approximation.pressures, K); j; ++j)
          result.forces[first_entry(static_cast<Index>(j.col())) + at] +=
              by_node.force(Gradient<Dim>(j.value() * change));
      }
      for (Pressure j(approximation.pressures, K); j; ++j) {
        first_of_patch[j.col()] = first;
        for (Pressure i(approximation.pressures, K); i; ++i)
          bulk(i.col() - first, j.col()) += on_itself * i.value() * j.value();
      }
    }
    const Gradient<Dim> trace = materials.trace();
    for (Index j = 0; j < approximation.dilatation.size(); ++j)
      for (Index i = 0; i <= Dim; ++i) {
        if (bulk(i, j) == 0.0) continue;  // patches of constant pressures have one function
        const auto other = table.row(first_of_patch[j] + i);
        for (std::size_t k = 0; k < other.nodes.size(); ++k)
          result.forces[first_entry(j) + k] += 0.5 * bulk(i, j) * nodal_gradient(other, k).force(trace);
      }
    return result;
  }

  void tangent(const State& state, SymmetricMatrix& K) const {
    std::vector<TangentTerm> terms;
    for_each_answer(state, true, [&](const WorkTerm<Dim>& term, const Answer& answer, Index) {
      terms.push_back(tangent_term(term, answer));
    });
    const Gradient<Dim> trace = materials.trace();
    const auto& table = approximation.dilatation.shape;
    pattern.sum(
        unknowns,
        [&](Index a, BlockColumn<Dim>& column) {
          for (const TangentTerm& term : terms) {
            add_stiffness(*term.points, term.A, a, column);
            if (term.forces.empty()) continue;
            for (const auto& [j, k] : table.by_node()[a]) {
              const auto row = table.row(j);
              const Vec<Dim>* forces = term.forces.data() + (row.N.data() - table.row(0).N.data());
              const Vec<Dim> along = nodal_gradient(row, k).force(trace);
              for (std::size_t l = k; l < row.nodes.size(); ++l) {
                const Vec<Dim> other = nodal_gradient(row, l).force(trace);
                column[row.nodes[l]] += forces[l] * along.transpose() + other * forces[k].transpose();
              }
            }
          }
        },
        weak, K);
  }
};

template <int Dim> Equilibrium<Dim>::Equilibrium(const Approximation<Dim>& approximation, const ElasticModel& model,
                                                 const std::vector<DisplacementCondition<Dim>>& conditions)
    : forces_(Points<Dim>::Zero(Dim, approximation.shape.num_nodes())) {
  if (Dim == 2 && approximation.space.axisymmetric() != (model.plane == Plane::axisymmetric))
    throw InputError(approximation.space.axisymmetric()
                         ? "the basis is axisymmetric and the model is not: expected Plane::axisymmetric"
                         : "the model is axisymmetric: approximate with axisymmetric = true");
  require_decided(approximation, model);
  const Index nodes = approximation.shape.num_nodes();
  auto materials = materials_of(model, approximation.space.mesh());
  auto bearable = bearable_kappas(approximation, materials, model);
  auto initial = efree::stiffness_terms(approximation, materials, model.stabilisation, bearable);
  const auto restrained = restraints(conditions);
  std::vector<Restraint<Dim>> rigid, elastic;
  for (const auto& restraint : restrained) (restraint.is_elastic() ? elastic : rigid).push_back(restraint);
  const auto ties = tied_facets(approximation.space.mesh(), model.open_interface);
  require_restrained(approximation.space, restrained, ties);
  const bool weakly = model.essential.value_or(Essential::nitsche) == Essential::nitsche;
  NitscheSystem<Dim> weak;
  if (weakly || !elastic.empty() || !ties.empty())
    weak = nitsche(approximation.space, approximation.shape, initial, weakly ? restrained : elastic, ties);
  const Points<Dim> prescribed =
      weak.rhs.size() > 0 ? Points<Dim>(weak.rhs.reshaped(Dim, nodes)) : Points<Dim>(Points<Dim>::Zero(Dim, nodes));
  Unknowns<Dim> unknowns(
      nodes, weakly ? NodalConditions<Dim>{}
                    : nodal_conditions(approximation.space, approximation.shape, approximation.node_dofs, rigid));
  std::vector<const ShapeTable<Dim>*> tables;
  for (const auto& term : initial) tables.push_back(&term.discretization->shape);
  MatrixPattern<Dim> pattern(nodes, tables, weak.matrix);
  const bool linear = materials.linear();
  data_ = std::make_shared<const Data>(Data{approximation, std::move(materials), linear, weakly, rigid, elastic, ties,
                                            std::move(bearable), std::move(initial),
                                            work_terms(approximation, model.stabilisation), std::move(weak.matrix),
                                            prescribed, std::move(unknowns), std::move(pattern)});
}

template <int Dim> Equilibrium<Dim> Equilibrium<Dim>::with(const Loads<Dim>& loads) const {
  Equilibrium result = *this;
  result.forces_ = load_vector(approximation().space, approximation().shape, loads);
  return result;
}

template <int Dim> Equilibrium<Dim> Equilibrium<Dim>::homogeneous(Points<Dim> forces) const {
  Equilibrium result = *this;
  result.forces_ = std::move(forces);
  result.prescribes_ = false;
  return result;
}

template <int Dim> State Equilibrium<Dim>::rest() const {
  Index remembered = 0;
  for (const auto& term : data_->work) remembered += data_->materials.history_size(*term.points);
  return {.u = Vector::Zero(Dim * approximation().shape.num_nodes()), .history = Vector::Zero(remembered)};
}

template <int Dim> State Equilibrium<Dim>::under(double factor, State state) const {
  state.factor = factor;
  state.u = data_->unknowns.prescribe(prescribes_ ? factor : 0.0, data_->displacements(state)).reshaped();
  return state;
}

template <int Dim> State Equilibrium<Dim>::moved(State state, const Vector& change) const {
  state.u += data_->unknowns.to_nodes(change).reshaped();
  return state;
}

template <int Dim> Vector Equilibrium<Dim>::residual(const State& state) const {
  Points<Dim> forces = data_->internal_forces(state) - state.factor * forces_;
  if (prescribes_) forces -= state.factor * data_->weak_prescribed;
  return data_->unknowns.of(forces);
}

template <int Dim> Vector Equilibrium<Dim>::force_scale(const State& state) const {
  double largest = (state.factor * forces_).cwiseAbs().maxCoeff();
  data_->for_each_answer(state, false, [&](const WorkTerm<Dim>& term, const auto& answer, Index) {
    const ShapeTable<Dim>& shape = term.points->shape;
    Vector sums = Vector::Zero(shape.num_nodes());
    for (Index K = 0; K < shape.num_points(); ++K) {
      const auto row = shape.row(K);
      for (std::size_t k = 0; k < row.nodes.size(); ++k)
        sums[row.nodes[k]] += term.points->weights[K] * nodal_gradient(row, k).force(answer.of.P.col(K)).norm();
    }
    largest = std::max(largest, sums.maxCoeff());
  });
  return Vector::Constant(static_cast<Index>(node_of_unknowns().size()), largest);
}

template <int Dim> void Equilibrium<Dim>::tangent(const State& state, SymmetricMatrix& K) const {
  if (data_->linear)
    data_->initial_tangent(K);
  else
    data_->tangent(state, K);
}

template <int Dim> SymmetricMatrix Equilibrium<Dim>::tangent_pattern() const {
  return data_->pattern.layout(data_->unknowns);
}

template <int Dim> State Equilibrium<Dim>::commit(State state) const {
  Vector history = state.history;
  data_->for_each_answer(state, false, [&](const WorkTerm<Dim>&, const auto& answer, Index first) {
    history.segment(first, answer.of.history.size()) = answer.of.history;
  });
  state.history = std::move(history);
  state.dt = 0.0;
  return state;
}

template <int Dim> bool Equilibrium<Dim>::linear() const {
  return data_->linear;
}
template <int Dim> const std::vector<Index>& Equilibrium<Dim>::node_of_unknowns() const {
  return data_->unknowns.node_of();
}

template <int Dim> double Equilibrium<Dim>::energy(const State& state) const {
  double energy = 0.0;
  data_->for_each_answer(state, false, [&](const WorkTerm<Dim>& term, const auto& answer, Index) {
    energy += term.share * term.points->weights.dot(answer.of.energy);
  });
  return energy;
}

template <int Dim> Resultants<Dim> Equilibrium<Dim>::reactions(const State& state) const {
  const Points<Dim> U = data_->displacements(state);
  if (data_->weakly) return data_->reactions(U, state.factor, {});
  return data_->reactions(U, state.factor,
                          data_->internal_forces(state) - state.factor * (forces_ + data_->weak_prescribed));
}

template <int Dim>
std::vector<Resultants<Dim>> Equilibrium<Dim>::reactions(const std::vector<Loads<Dim>>& loads,
                                                         const std::vector<const Points<Dim>*>& coefficients,
                                                         const std::vector<const VoigtPoints<Dim>*>& stresses) const {
  std::vector<Resultants<Dim>> reactions;
  // Else that of other points counts as well, or that on the boundary alone.
  const bool by_stress = data_->linear && data_->initial.size() == 1 && !data_->weakly;
  while (reactions.size() < loads.size()) {
    const std::size_t first = reactions.size(), end = std::min(first + internal::most_side_by_side, loads.size());
    std::vector<Points<Dim>> forces;
    if (by_stress)
      forces = internal::forces_of_stresses<Dim>(approximation().quadrature,
                                                 {stresses.begin() + first, stresses.begin() + end});
    for (std::size_t k = first; k < end; ++k) {
      const Points<Dim>& U = *coefficients[k];
      if (!by_stress) {
        State state = rest();
        state.u = U.reshaped();
        state.factor = 1.0;
        reactions.push_back(with(loads[k]).reactions(state));
        continue;
      }
      Points<Dim>& left = forces[k - first];
      if (data_->weak.size() > 0) left += data_->weak_forces(U) - data_->weak_prescribed;
      left -= load_vector(approximation().space, approximation().shape, loads[k]);
      reactions.push_back(data_->reactions(U, 1.0, left));
    }
  }
  return reactions;
}

template <int Dim> const Approximation<Dim>& Equilibrium<Dim>::approximation() const {
  return data_->approximation;
}
template <int Dim> const Materials<Dim>& Equilibrium<Dim>::materials() const {
  return data_->materials;
}
template <int Dim> const std::vector<StiffnessTerm<Dim>>& Equilibrium<Dim>::stiffness_terms() const {
  return data_->initial;
}

template <int Dim> Points<Dim> Equilibrium<Dim>::initial_tangent_times(const Points<Dim>& U) const {
  return data_->initial_forces(U);
}
template <int Dim> Points<Dim> Equilibrium<Dim>::weak_forces(const Points<Dim>& U) const {
  return data_->weak_forces(U);
}
template <int Dim> const Points<Dim>& Equilibrium<Dim>::weak_prescribed() const {
  return data_->weak_prescribed;
}
template <int Dim> Points<Dim> Equilibrium<Dim>::held_part(const Points<Dim>& U) const {
  return data_->unknowns.fixed_part(U);
}

template Materials<2> materials_of<2>(const ElasticModel&, const FineMesh<2>&);
template Materials<3> materials_of<3>(const ElasticModel&, const FineMesh<3>&);
template class Equilibrium<2>;
template class Equilibrium<3>;

}  // namespace efree
