// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/equations/nonlinear_equilibrium.hpp"

#include "efree/assembly/bodies.hpp"
#include "efree/assembly/follower_pressure.hpp"
#include "efree/assembly/held_gradient.hpp"
#include "efree/assembly/internal/gather.hpp"
#include "efree/assembly/internal/matrix_pattern.hpp"
#include "efree/assembly/internal/no_follower.hpp"
#include "efree/assembly/loads.hpp"
#include "efree/assembly/nodal_conditions.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/groups.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/solvers/equations/internal/patch_shear.hpp"
#include "efree/solvers/equations/internal/stiffness_terms.hpp"
#include "efree/solvers/equations/locking.hpp"
#include "efree/solvers/equations/nodal_reactions.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <mutex>
#include <optional>
#include <tuple>
#include <utility>

namespace efree {

using internal::BlockColumn;
using internal::MatrixPattern;
using internal::Unknowns;

namespace {

template <int Dim> Mat<3> in_space(const Gradient<Dim>& F) {
  Mat<3> result = Mat<3>::Zero();
  for (int a = 0; a < gradient_size<Dim>; ++a) result.data()[tensor_places<Dim>[a]] = F[a];
  return result;
}
template <int Dim> Gradient<Dim> components(const Mat<3>& F) {
  Gradient<Dim> result;
  for (int a = 0; a < gradient_size<Dim>; ++a) result[a] = F.data()[tensor_places<Dim>[a]];
  return result;
}

/// Volume over that at rest, and what its change is made of: dJ = J g . dF, dg = - G dF.
template <int Dim> struct Volume {
  double J;
  Gradient<Dim> g;
  Mat<3> inverse;

  explicit Volume(const Gradient<Dim>& F) : J(in_space<Dim>(F).determinant()), inverse(in_space<Dim>(F).inverse()) {
    g = components<Dim>(inverse.transpose());
  }
  Tangent<Dim> G() const {
    Tangent<Dim> result;
    for (int a = 0; a < gradient_size<Dim>; ++a)
      for (int b = 0; b < gradient_size<Dim>; ++b) {
        const int i = tensor_places<Dim>[a] % 3, J_ = tensor_places<Dim>[a] / 3;
        const int k = tensor_places<Dim>[b] % 3, L = tensor_places<Dim>[b] / 3;
        result(a, b) = inverse(L, i) * inverse(J_, k);
      }
    return result;
  }
};

/// The pressure patches of an approximation.
template <int Dim> struct Patches {
  Ragged<Index> points;       ///< by patch, ascending; no rows without averages
  Ragged<double> functions;   ///< by patch: values at its points, point by point; orthonormal under their weights
  Ragged<Index> nodes;        ///< by patch: those that its dilatations depend on, ascending
  Ragged<NodePlace> of_node;  ///< by node: (patch, position)
  std::vector<Index> entry;   ///< by patch: where its numbers by function and node begin

  using Values = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, Dim + 1, 1>;  ///< by function of a patch

  Patches() = default;
  Patches(const Approximation<Dim>& of, const HeldGradient<Dim>& held)
      : points(internal::members_of(of.patch_of, 1 + *std::ranges::max_element(of.patch_of))), entry{0} {
    const Vector integrals = of.dilatation.weights.cwiseSqrt();
    std::vector<Index> all;
    for (Index g = 0; g < size(); ++g) {
      all.clear();
      for (const Index K : points[g]) {
        for (SparseRows::InnerIterator j(of.pressures, K); j; ++j)
          functions.items.push_back(j.value() / integrals[j.col()]);
        const auto row = held.nodes(K);
        all.insert(all.end(), row.begin(), row.end());
      }
      functions.close_row();
      std::ranges::sort(all);
      all.erase(std::unique(all.begin(), all.end()), all.end());
      nodes.items.insert(nodes.items.end(), all.begin(), all.end());
      nodes.close_row();
      entry.push_back(entry.back() + num_functions(g) * static_cast<Index>(all.size()));
    }
    of_node = places_of_nodes(held.num_nodes(), size(), [&](Index g) { return nodes[g]; });
  }

  Index size() const { return points.rows(); }
  Index num_functions(Index g) const { return static_cast<Index>(functions[g].size() / points[g].size()); }
  /// Of patch g, at its k-th point.
  Eigen::Map<const Values> at(Index g, Index k) const {
    const Index count = num_functions(g);
    return {functions[g].data() + k * count, count};
  }
  /// Replaces values at the points of patch g by their best approximation by its functions, under these weights.
  void project(Index g, const Vector& weights, Vector& values) const {
    Values sums = Values::Zero(num_functions(g));
    Index k = 0;
    for (const Index K : points[g]) sums += weights[K] * values[K] * at(g, k++);
    k = 0;
    for (const Index K : points[g]) values[K] = sums.dot(at(g, k++));
  }
};

}  // namespace

template <int Dim> struct NonlinearEquilibrium<Dim>::Data {
  /// What acts at one time.
  struct Acting {
    Points<Dim> loads;  ///< on coefficients
    Vector pressures;   ///< that follow the body, by point of theirs
    PrescribedMotion<Dim> motion;
    NodalConditions<Dim> nodal;
    std::vector<Restraint<Dim>> restraints;  ///< that are not nodal
    std::vector<Restraint<Dim>> rigid;

    Acting scaled(double factor) const {
      Acting result{factor * loads, factor * pressures, motion * factor, nodal, restraints, rigid};
      for (auto& values : result.nodal.values) values *= factor;
      for (auto* all : {&result.restraints, &result.rigid})
        for (auto& restraint : *all)
          restraint.value = [value = restraint.value, factor](const Vec<Dim>& x) { return factor * value(x); };
      return result;
    }
  };

  /// Gradients, and what the materials say to those that they see.
  struct Answer {
    Gradients<Dim> H;     ///< of the points themselves
    Gradients<Dim> seen;  ///< by the materials
    internal::ShearedResponses<Dim> of;
    Vector dilatation;  ///< by point: averaged ln J (finite strains) or trace (small ones); empty without averages
    Vector pressure;    ///< by point: likewise averaged, work on that dilatation per volume
  };

  /// What was found out last. A copy begins with none.
  struct Kept {
    std::mutex finding;
    std::vector<std::pair<double, std::shared_ptr<const Acting>>> acting;  ///< for the last times asked for
    std::shared_ptr<const std::pair<State, Answer>> answer;                ///< of the materials
    Kept() = default;
    Kept(const Kept& /*other*/) {}
  };

  const Approximation<Dim>& approximation;
  ElasticModel model;
  Program<Dim> program;
  bool weakly;
  Materials<Dim> materials;
  std::vector<double> moduli;  ///< by point: patch_moduli
  std::vector<double> shear;   ///< by point: patch_shears
  std::vector<StiffnessTerm<Dim>> initial;
  HeldGradient<Dim> held;
  FollowerPressures<Dim> followers;
  std::vector<bool> finite;  ///< by region
  std::vector<bool> swells;  ///< by region: averages of dilatations change lengths alike in all directions
  Patches<Dim> patches;
  SymmetricMatrix weak;  ///< penalties, springs, and room for what else meets
  Unknowns<Dim> unknowns;
  MatrixPattern<Dim> pattern;
  mutable Kept kept;

  Data(const Approximation<Dim>& of, const ElasticModel& made_of, Program<Dim> acts)
      : approximation(of),
        model(made_of),
        program(std::move(acts)),
        weakly(model.essential.value_or(Essential::nitsche) == Essential::nitsche),
        materials(materials_of(model, of.space.mesh())),
        moduli(internal::patch_moduli(of, materials, model)),
        shear(internal::patch_shears(of, materials, model, moduli)),
        initial(stiffness_terms(of, materials, 0.0, moduli)),
        held(of.space, of.shape, initial.front(), not_nodal(restraints(program.conditions(program.full_at))),
             tied_facets(of.space.mesh(), model.open_interface)),
        followers(of.space, of.shape, program.loads(program.full_at).followers),
        unknowns(of.shape.num_nodes(), nodal(restraints(program.conditions(program.full_at)))),
        pattern(of.shape.num_nodes(), {}, {}) {
    for (Index region = 0; region < materials.num_regions(); ++region)
      finite.push_back(materials.finite_strain(region));
    swells = finite;
    const Index nodes = of.shape.num_nodes();
    weak = held.penalty();
    if (of.dilatation.size() > 0) {
      patches = Patches<Dim>(of, held);
      weak += gather_blocks<Dim>(nodes, [&](Index a, Accumulator<Mat<Dim>>& sums) {
        for (const auto& [g, k] : patches.of_node[a])
          for (const Index node : patches.nodes[g].subspan(k)) sums[node];
      });
    }
    pattern = MatrixPattern<Dim>(nodes, {&held.quadrature().shape, &followers.table()}, weak);
  }

  std::vector<Restraint<Dim>> not_nodal(std::vector<Restraint<Dim>> all) const {
    if (!weakly) std::erase_if(all, [](const auto& restraint) { return !restraint.is_elastic(); });
    return all;
  }
  NodalConditions<Dim> nodal(std::vector<Restraint<Dim>> all) const {
    if (weakly) return {};
    std::erase_if(all, [](const auto& restraint) { return restraint.is_elastic(); });
    return nodal_conditions(approximation.space, approximation.shape, approximation.node_dofs, all);
  }

  std::shared_ptr<const Acting> make(double time) const {
    const auto all = restraints(program.conditions(time));
    auto rigid = all;
    std::erase_if(rigid, [](const auto& restraint) { return restraint.is_elastic(); });
    Loads<Dim> loads = program.loads(time);
    const auto following = std::exchange(loads.followers, {});
    return std::make_shared<const Acting>(Acting{load_vector(approximation.space, approximation.shape, loads),
                                                 followers.at_points(following), held.prescribed(not_nodal(all)),
                                                 nodal(all), not_nodal(all), rigid});
  }
  /// What acts at a time; the same for the same time.
  std::shared_ptr<const Acting> acting(double time) const {
    constexpr std::size_t most = 4;
    const std::lock_guard lock(kept.finding);
    auto& made = kept.acting;
    for (const auto& [when, what] : made)
      if (when == time) return what;
    std::shared_ptr<const Acting> result;
    const double full = program.full_at;
    if (full != 0.0 && time != full) {
      std::shared_ptr<const Acting> one;
      for (const auto& [when, what] : made)
        if (when == full) one = what;
      if (!one) made.emplace(made.begin(), full, one = make(full));
      result = std::make_shared<const Acting>(one->scaled(time / full));
    } else {
      result = make(time);
    }
    made.emplace_back(time, result);
    if (made.size() > most) made.erase(made.begin() + (full != 0.0 ? 1 : 0));
    return result;
  }

  Points<Dim> displacements(const State& state) const { return state.u.reshaped(Dim, state.u.size() / Dim); }
  Points<Dim> weak_forces(const Points<Dim>& U) const {
    if (weak.size() == 0) return Points<Dim>::Zero(Dim, U.cols());
    const Vector forces = weak.template selfadjointView<Eigen::Lower>() * U.reshaped();
    return forces.reshaped(Dim, U.cols());
  }
  bool averaged() const { return patches.size() > 0; }
  /// Replaces values at the points of patch g by their best approximation by its functions.
  void average(Index g, Vector& values) const { patches.project(g, held.quadrature().weights, values); }
  /// Whether tangents of all materials are.
  bool symmetric() const {
    const auto is = [](const SharedMaterial& material) { return !material || material->symmetric(); };
    return is(model.material) && std::ranges::all_of(model.regions, is);
  }

  /// 1 + H.
  Gradient<Dim> deformation(const Gradients<Dim>& H, Index K) const { return H.col(K) + trace_direction<Dim>(); }
  bool is_finite(Index K) const { return finite[held.quadrature().region[K]]; }
  Gradient<Dim> swelling(Index K) const {
    Stiffness<Dim> room;
    const auto& points = held.quadrature();
    if (swells[points.region[K]]) return trace_direction<Dim>() / 3.0;
    return gradient_of<Dim>(materials.stiffness(points.region[K], points.points.col(K), room).swelling);
  }
  Volume<Dim> volume(const Gradients<Dim>& H, Index K) const {
    const Volume<Dim> result(deformation(H, K));
    if (!(result.J > 0.0))
      throw NumericalError(fmt::format("the body is turned inside out at ({:.6g}): J = {:.3g}",
                                       fmt::join(Vec<Dim>(held.quadrature().points.col(K)), ", "), result.J));
    return result;
  }

  /// What is averaged on a patch.
  double dilatation(const Gradients<Dim>& H, Index K) const {
    return is_finite(K) ? std::log(volume(H, K).J) : materials.trace().dot(H.col(K));
  }
  /// The energy by which a dilatation at a point resists being another than the averaged one, k/2 (own - averaged)^2,
  /// of finite strains times I - 2, I = J^(-2/3) F : F: pressures that feed such dilatations grow with what distorts
  /// the body. With its derivatives by the gradient and the averaged one, second ones (averaged_twice, mixed, A) if
  /// asked for.
  struct Unevenness {
    double energy = 0.0, by_averaged = 0.0, averaged_twice = 0.0;
    Gradient<Dim> P = Gradient<Dim>::Zero(), mixed = Gradient<Dim>::Zero();
    Tangent<Dim> A = Tangent<Dim>::Zero();
  };
  Unevenness unevenness(const Answer& answer, Index K, bool second = false) const {
    Unevenness result;
    const double k = moduli.empty() ? 0.0 : moduli[K];
    if (k == 0.0 || (!shear.empty() && shear[K] > 0.0)) return result;  // shears have it instead
    const double off = dilatation(answer.H, K) - answer.dilatation[K];
    Gradient<Dim> g = materials.trace(), dI = Gradient<Dim>::Zero();  // by F: of the point's dilatation, of I
    Tangent<Dim> G = Tangent<Dim>::Zero(), ddI = G;                   // and second ones, -G of the dilatation
    double grown = k;
    if (is_finite(K)) {
      const Gradient<Dim> F = deformation(answer.H, K);
      const Volume<Dim> of(F);
      const double scale = std::pow(of.J, -2.0 / 3.0), I = scale * in_space<Dim>(F).squaredNorm();
      g = of.g;
      dI = 2.0 * scale * F - 2.0 / 3.0 * I * g;
      grown = k * (I - 2.0);
      if (second) {
        const Tangent<Dim> gF = g * F.transpose();
        G = of.G();
        ddI = 2.0 * scale * (Tangent<Dim>::Identity() - 2.0 / 3.0 * (gF + gF.transpose())) +
              I * (4.0 / 9.0 * g * g.transpose() + 2.0 / 3.0 * G);
      }
    }
    result.energy = 0.5 * grown * off * off;
    result.by_averaged = -grown * off;
    result.P = grown * off * g + 0.5 * k * off * off * dI;
    if (!second) return result;
    const Tangent<Dim> gI = g * dI.transpose();
    result.averaged_twice = grown;
    result.mixed = -grown * g - k * off * dI;
    result.A = grown * (g * g.transpose() - off * G) + k * off * (gI + gI.transpose() + 0.5 * off * ddI);
    return result;
  }

  /// Stored at the points, per volume.
  Vector energies(const Answer& answer) const {
    Vector result = answer.of.energy;
    if (averaged())
      for (Index K = 0; K < held.size(); ++K) result[K] += unevenness(answer, K).energy;
    return result;
  }

  /// What averages make of a point of finite strains: it sees F stretched by r, which gives it the averaged volume.
  struct Stretch {
    Gradient<Dim> F;
    Volume<Dim> of;
    double r;
    Stretch(const Gradient<Dim>& at, double averaged) : F(at), of(at), r(std::exp(averaged / 3.0) / std::cbrt(of.J)) {}
  };
  Stretch stretch(const Answer& answer, Index K) const { return {deformation(answer.H, K), answer.dilatation[K]}; }

  Gradients<Dim> gradients(const State& state) const {
    return held.of(displacements(state)) + acting(state.time)->motion.gradients;
  }

  /// What a material works on the averaged dilatation, per volume.
  double work_of_averaged(const Answer& answer, Index K) const {
    const Gradient<Dim> P = answer.of.P.col(K);
    const double work = is_finite(K) ? P.dot(deformation(answer.seen, K)) / 3.0 : swelling(K).dot(P);
    return shear.empty() ? work : work - shear[K] * answer.of.shear_stress[K];
  }

  Answer respond(const State& state, bool tangents) const {
    Answer answer;
    answer.H = gradients(state);
    answer.seen = answer.H;
    const auto& points = held.quadrature();
    Vector shears;
    if (averaged()) {
      const Gradient<Dim> trace = materials.trace();
      answer.dilatation.resize(points.size());
      shears.resize(static_cast<Index>(shear.size()));
      parallel_for(patches.size(), [&](Index g) {
        for (const Index K : patches.points[g]) {
          answer.dilatation[K] = dilatation(answer.H, K);
          if (!shear.empty()) shears[K] = shear[K] * answer.dilatation[K];
        }
        average(g, answer.dilatation);
        for (const Index K : patches.points[g]) {
          if (!shear.empty()) shears[K] -= shear[K] * answer.dilatation[K];
          if (is_finite(K)) {
            const Stretch at = stretch(answer, K);
            answer.seen.col(K) += (at.r - 1.0) * at.F;
          } else {
            answer.seen.col(K) += (answer.dilatation[K] - trace.dot(answer.H.col(K))) * swelling(K);
          }
        }
      });
    }
    answer.of = internal::respond(materials, model, points, answer.seen, shears, state.history, state.dt, tangents);
    if (averaged()) {
      answer.pressure.resize(points.size());
      parallel_for(patches.size(), [&](Index g) {
        for (const Index K : patches.points[g])
          answer.pressure[K] = work_of_averaged(answer, K) + unevenness(answer, K).by_averaged;
        average(g, answer.pressure);
      });
    }
    return answer;
  }

  /// The same for the last state asked about: residual, scale and tangent, or all that is wanted of a step.
  std::shared_ptr<const Answer> ask(const State& state, bool tangents) const {
    const auto answers = [&](const auto& last) {
      return last && last->first == state && (!tangents || !last->second.of.A.empty());
    };
    std::shared_ptr<const std::pair<State, Answer>> last;
    {
      const std::lock_guard lock(kept.finding);
      last = kept.answer;
    }
    if (!answers(last)) {
      last = std::make_shared<const std::pair<State, Answer>>(state, respond(state, tangents));
      const std::lock_guard lock(kept.finding);
      kept.answer = last;
    }
    return {last, &last->second};
  }

  /// The stress that works on the gradient of a point, that through averaged dilatations included.
  Gradients<Dim> stresses(const Answer& answer) const {
    if (!averaged()) return answer.of.P;
    Gradients<Dim> P(gradient_size<Dim>, held.size());
    const Gradient<Dim> trace = materials.trace();
    parallel_for(held.size(), [&](Index K) {
      const Gradient<Dim> of = answer.of.P.col(K);
      const double pressure = answer.pressure[K];
      if (is_finite(K)) {
        const Stretch at = stretch(answer, K);
        P.col(K) = at.r * of + (pressure - work_of_averaged(answer, K)) * at.of.g;
      } else {
        P.col(K) = of + (pressure - work_of_averaged(answer, K)) * trace;
      }
      P.col(K) += unevenness(answer, K).P;
    });
    return P;
  }

  /// How what a material sees changes with the gradient of its point, M, and with the averaged dilatation, s, and how
  /// the point's own changes with its gradient, d.
  struct Seen {
    Tangent<Dim> M;
    Gradient<Dim> s, d;
  };
  Seen seen(const Answer& answer, Index K, const Stretch& at) const {
    return {at.r * (Tangent<Dim>::Identity() - at.F * at.of.g.transpose() / 3.0), deformation(answer.seen, K) / 3.0,
            at.of.g};
  }
  Seen seen(const Answer& answer, Index K) const {
    if (is_finite(K)) return seen(answer, K, stretch(answer, K));
    const Gradient<Dim> trace = materials.trace(), s = swelling(K);
    return {Tangent<Dim>::Identity() - s * trace.transpose(), s, trace};
  }

  /// Second derivatives of the energy by the gradient of a point and the averaged dilatation there, per volume.
  struct PointTangent {
    Tangent<Dim> A;
    Gradient<Dim> dilatation;  ///< change of the point's dilatation by its gradient
    Gradient<Dim> mixed;
    double bulk;
  };
  PointTangent point_tangent(const Answer& answer, Index K) const {
    const Tangent<Dim> A = 0.5 * (answer.of.A[K] + answer.of.A[K].transpose());
    PointTangent result{A, Gradient<Dim>::Zero(), Gradient<Dim>::Zero(), 0.0};
    if (!averaged()) return result;
    std::optional<Stretch> at;
    if (is_finite(K)) at = stretch(answer, K);
    const auto [M, s, d] = at ? seen(answer, K, *at) : seen(answer, K);
    const Gradient<Dim> change = A * s;
    const Unevenness uneven = unevenness(answer, K, true);
    result = {M.transpose() * A * M + uneven.A, d, M.transpose() * change + uneven.mixed,
              s.dot(change) + uneven.averaged_twice};
    if (!shear.empty()) {  // gamma = c (dilatation of the point - averaged one)
      const double c = shear[K], stiffness = answer.of.shear_stiffness[K];
      const Gradient<Dim> by_shear = 0.5 * (answer.of.stress_by_shear.col(K) + answer.of.shear_by_gradient.col(K));
      const Gradient<Dim> seen_by_shear = M.transpose() * by_shear;
      const double of_averaged = by_shear.dot(s) - c * stiffness;
      const Tangent<Dim> both = seen_by_shear * d.transpose();
      result.A += c * (both + both.transpose()) + c * c * stiffness * d * d.transpose();
      result.mixed += c * (of_averaged * d - seen_by_shear);
      result.bulk -= c * (by_shear.dot(s) + of_averaged);
    }
    if (!at) return result;
    const double pressure = answer.pressure[K];
    const Gradient<Dim> P = answer.of.P.col(K), &g = at->of.g;
    const double work = P.dot(deformation(answer.seen, K));
    const Tangent<Dim> G = at->of.G(), gg = g * g.transpose(), Pg = P * g.transpose();
    result.A += -at->r / 3.0 * (Pg + Pg.transpose()) + work / 9.0 * gg + (work_of_averaged(answer, K) - pressure) * G;
    result.mixed += M.transpose() * P / 3.0;
    result.bulk += work / 9.0;
    return result;
  }

  /// Change of the internal forces by a small change of coefficients, as far as tangents of materials are not
  /// symmetric.
  Points<Dim> skew_forces(const State& state, const Points<Dim>& dU) const {
    const auto asked = ask(state, true);
    const Answer& answer = *asked;
    const auto skew = [&](Index K) { return Tangent<Dim>(0.5 * (answer.of.A[K] - answer.of.A[K].transpose())); };
    Gradients<Dim> change = held.of(dU);  // of gradients, then of stresses
    if (!averaged()) {
      parallel_for(held.size(), [&](Index K) { change.col(K) = skew(K) * Gradient<Dim>(change.col(K)); });
      return held.force(change);
    }
    Vector dilatation(held.size()), pressure(held.size());
    parallel_for(patches.size(), [&](Index g) {
      std::vector<Seen> by_point;
      by_point.reserve(patches.points[g].size());
      for (const Index K : patches.points[g]) {
        by_point.push_back(seen(answer, K));
        dilatation[K] = by_point.back().d.dot(change.col(K));
      }
      average(g, dilatation);
      auto point = by_point.begin();
      for (const Index K : patches.points[g]) {
        const auto& [M, s, d] = *point++;
        const Gradient<Dim> seen_change = M * change.col(K) + dilatation[K] * s;
        Gradient<Dim> stress = skew(K) * seen_change;
        double on_shear = 0.0;
        if (!shear.empty()) {
          const Gradient<Dim> b = 0.5 * (answer.of.stress_by_shear.col(K) - answer.of.shear_by_gradient.col(K));
          stress += shear[K] * (d.dot(change.col(K)) - dilatation[K]) * b;
          on_shear = -shear[K] * b.dot(seen_change);
        }
        pressure[K] = s.dot(stress) - on_shear;
        change.col(K) = M.transpose() * stress + on_shear * d;
      }
      average(g, pressure);
      point = by_point.begin();
      for (const Index K : patches.points[g]) change.col(K) += pressure[K] * (point++)->d;
    });
    return held.force(change);
  }

  /// Of loads at a time, on a body with these displacements.
  Points<Dim> external_forces(const Acting& at, const Points<Dim>& U) const {
    if (followers.empty()) return at.loads;
    return at.loads + followers.forces(at.pressures, U);
  }
  Points<Dim> external_forces(const State& state) const {
    return external_forces(*acting(state.time), displacements(state));
  }
  Points<Dim> internal_forces(const State& state) const {
    return weak_forces(displacements(state)) - acting(state.time)->motion.forces +
           held.force(stresses(*ask(state, false)));
  }

  void tangent(const State& state, SymmetricMatrix& result) const {
    const auto asked = ask(state, true);
    const Answer& answer = *asked;
    const Index size = held.size();
    std::vector<Tangent<Dim>> A(size);
    // By function and node of a patch: what the function's dilatation changes by, and the forces that a change of it
    // makes, half of its work on itself and on others of the patch included.
    std::vector<Vec<Dim>> along, forces;
    if (!averaged()) {
      parallel_for(size, [&](Index K) { A[K] = point_tangent(answer, K).A; });
    } else {
      along.assign(patches.entry.back(), Vec<Dim>::Zero());
      forces = along;
      parallel_for(patches.size(), [&](Index g) {
        const auto nodes = patches.nodes[g];
        const auto count = static_cast<Index>(nodes.size()), functions = patches.num_functions(g);
        const Index first = patches.entry[g];
        Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, Dim + 1, Dim + 1> bulk;
        bulk.setZero(functions, functions);
        Index place = 0;
        for (const Index K : patches.points[g]) {
          const PointTangent point = point_tangent(answer, K);
          A[K] = point.A;
          const auto at_point = patches.at(g, place++);
          const double w = held.quadrature().weights[K];
          bulk += w * point.bulk * at_point * at_point.transpose();
          const auto row = held.nodes(K);
          for (std::size_t k = 0, at = 0; k < row.size(); ++k) {
            while (nodes[at] != row[k]) ++at;
            const GradientBlock<Dim> block = held.block(K, k);
            const Vec<Dim> by_node = w * (block.transpose() * point.dilatation);
            const Vec<Dim> force = w * (block.transpose() * point.mixed);
            for (Index j = 0; j < functions; ++j) {
              along[first + j * count + at] += at_point[j] * by_node;
              forces[first + j * count + at] += at_point[j] * force;
            }
          }
        }
        for (Index j = 0; j < functions; ++j)
          for (Index i = 0; i < functions; ++i)
            for (Index at = 0; at < count; ++at)
              forces[first + j * count + at] += 0.5 * bulk(i, j) * along[first + i * count + at];
      });
    }
    const auto pressed = followers.now(acting(state.time)->pressures, displacements(state));
    pattern.sum(
        unknowns,
        [&](Index a, BlockColumn<Dim>& column) {
          held.add_stiffness(A, a, column);
          if (!followers.empty()) followers.add_stiffness(pressed, a, column);
          if (!averaged()) return;
          for (const auto& [g, k] : patches.of_node[a]) {
            const auto nodes = patches.nodes[g];
            const auto count = static_cast<Index>(nodes.size());
            for (Index first = patches.entry[g]; first < patches.entry[g + 1]; first += count)
              for (std::size_t l = k; l < nodes.size(); ++l)
                column[nodes[l]] +=
                    along[first + l] * forces[first + k].transpose() + forces[first + l] * along[first + k].transpose();
          }
        },
        weak, result);
  }

  /// Change of the internal forces by small changes of coefficients and of what is prescribed.
  Points<Dim> linearised(const State& state, const Points<Dim>& dU, const PrescribedMotion<Dim>& motion) const {
    const auto asked = ask(state, true);
    const Answer& answer = *asked;
    const Gradients<Dim> dH = held.of(dU) + motion.gradients;
    Gradients<Dim> dP(gradient_size<Dim>, held.size());
    if (!averaged()) {
      parallel_for(held.size(), [&](Index K) { dP.col(K) = point_tangent(answer, K).A * dH.col(K); });
    } else {
      Vector change(held.size()), pressure(held.size());
      parallel_for(patches.size(), [&](Index g) {
        const auto& points = patches.points[g];
        std::vector<PointTangent> tangents;
        tangents.reserve(points.size());
        for (const Index K : points) {
          tangents.push_back(point_tangent(answer, K));
          change[K] = tangents.back().dilatation.dot(dH.col(K));
        }
        average(g, change);
        auto point = tangents.begin();
        for (const Index K : points) {
          pressure[K] = point->mixed.dot(dH.col(K)) + point->bulk * change[K];
          ++point;
        }
        average(g, pressure);
        point = tangents.begin();
        for (const Index K : points) {
          dP.col(K) = point->A * dH.col(K) + change[K] * point->mixed + pressure[K] * point->dilatation;
          ++point;
        }
      });
    }
    return weak_forces(dU) - motion.forces + held.force(dP);
  }
};

template <int Dim> NonlinearEquilibrium<Dim>::NonlinearEquilibrium(const Approximation<Dim>& approximation,
                                                                   const ElasticModel& model, Program<Dim> program) {
  if (Dim == 2 && approximation.space.axisymmetric() != (model.plane == Plane::axisymmetric))
    throw InputError(approximation.space.axisymmetric()
                         ? "the basis is axisymmetric and the model is not: expected Plane::axisymmetric"
                         : "the model is axisymmetric: approximate with axisymmetric = true");
  if (model.stabilisation != 0.0)
    throw internal::SettingError("quadrature.stabilisation", "a stabilisation is for linear materials: expected 0");
  require_decided(approximation, model);
  const auto conditions = restraints(program.conditions(program.full_at));
  require_restrained(approximation.space, conditions, tied_facets(approximation.space.mesh(), model.open_interface));
  data_ = std::make_shared<const Data>(approximation, model, std::move(program));
  const FineMesh<Dim>& mesh = approximation.space.mesh();
  for (const auto& follower : data_->program.loads(data_->program.full_at).followers)
    for (const Index f : mesh.group(follower.on))
      if (!data_->finite[mesh.region(mesh.facet_cell(f))]) internal::refuse_follower(follower.on);
  if (Dim == 2 && model.plane == Plane::stress && data_->averaged() && finite_strain())
    throw internal::SettingError(
        "quadrature.dilatation",
        "averaged dilatations of finite strains are not for plane stress: expected Dilatation::pointwise");
}

template <int Dim> NonlinearEquilibrium<Dim> NonlinearEquilibrium<Dim>::at_rest() const {
  const auto data = std::make_shared<Data>(*data_);
  data->model = linearised(std::move(data->model));
  data->materials = materials_of(data->model, approximation().space.mesh());
  data->finite.assign(data->finite.size(), false);
  data->program.loads = [loads = data_->program.loads](double time) { return efree::at_rest(loads(time)); };
  data->followers = FollowerPressures<Dim>(approximation().space, approximation().shape, {});
  NonlinearEquilibrium result(*this);
  result.data_ = data;
  return result;
}

template <int Dim> State NonlinearEquilibrium<Dim>::rest() const {
  return {.u = Vector::Zero(Dim * approximation().shape.num_nodes()),
          .history = Vector::Zero(data_->materials.history_size(data_->held.quadrature()))};
}

template <int Dim> State NonlinearEquilibrium<Dim>::under(double time, State state) const {
  state.dt = time - (state.time - state.dt);
  state.time = time;
  state.factor = time;
  const auto acting = data_->acting(time);
  state.u =
      Unknowns<Dim>(data_->unknowns.num_nodes(), acting->nodal).prescribe(1.0, data_->displacements(state)).reshaped();
  return state;
}

template <int Dim> State NonlinearEquilibrium<Dim>::moved(State state, const Vector& change) const {
  state.u += data_->unknowns.to_nodes(change).reshaped();
  return state;
}

template <int Dim> Vector NonlinearEquilibrium<Dim>::residual(const State& state) const {
  return data_->unknowns.of(data_->internal_forces(state) - data_->external_forces(state));
}

template <int Dim> Vector NonlinearEquilibrium<Dim>::first_residual(const State& from, const State& to) const {
  const auto before = data_->acting(from.time), after = data_->acting(to.time);
  const PrescribedMotion<Dim> motion{after->motion.gradients - before->motion.gradients,
                                     after->motion.forces - before->motion.forces};
  State start = from;  // its history, with the step's duration
  start.dt = to.dt;
  const Points<Dim> U = data_->displacements(from), change = data_->displacements(to) - U;
  Points<Dim> forces =
      data_->internal_forces(start) + data_->linearised(start, change, motion) - data_->external_forces(*after, U);
  if (!data_->followers.empty()) forces -= data_->followers.changes(data_->followers.now(after->pressures, U), change);
  return data_->unknowns.of(forces);
}

template <int Dim> bool NonlinearEquilibrium<Dim>::loads_change(double from, double to) const {
  const auto before = data_->acting(from), after = data_->acting(to);
  return before->loads != after->loads || before->pressures != after->pressures;
}

template <int Dim> Vector NonlinearEquilibrium<Dim>::force_scale(const State& state) const {
  // Stresses of smaller strains are not told from rounding where the body turns, nor those of a gradient by which large
  // displacements cancel.
  constexpr double least_strain = 1e-4;
  const Points<Dim> U = data_->displacements(state);
  const Vector moved_by = U.colwise().norm();
  const auto answer = data_->ask(state, false);
  const auto& points = data_->held.quadrature();
  Vector sums = Vector::Zero(points.shape.num_nodes());
  for (Index K = 0; K < points.size(); ++K) {
    Stiffness<Dim> room;
    const double stiffness = materials().stiffness(points.region[K], points.points.col(K), room).C(0, 0);
    const auto row = points.shape.row(K);
    double cancelling = 0.0;
    for (std::size_t k = 0; k < row.nodes.size(); ++k) cancelling += moved_by[row.nodes[k]] * row.dN[k].norm();
    const double stress = std::max(answer->of.P.col(K).norm(), least_strain * stiffness * std::max(1.0, cancelling));
    for (std::size_t k = 0; k < row.nodes.size(); ++k)
      sums[row.nodes[k]] += points.weights[K] * stress * row.dN[k].norm();
  }
  sums = sums.cwiseMax(data_->external_forces(*data_->acting(state.time), U).colwise().norm().transpose());
  return sums(node_of_unknowns());
}

template <int Dim> void NonlinearEquilibrium<Dim>::tangent(const State& state, SymmetricMatrix& K) const {
  data_->tangent(state, K);
}

template <int Dim> Vector NonlinearEquilibrium<Dim>::not_in_tangent(const State& state, const Vector& change) const {
  const FollowerPressures<Dim>& followers = data_->followers;
  if (followers.empty() && data_->symmetric()) return {};
  const Points<Dim> moved = data_->unknowns.to_nodes(change);
  Points<Dim> forces = Points<Dim>::Zero(Dim, moved.cols());
  if (!data_->symmetric()) forces += data_->skew_forces(state, moved);
  if (!followers.empty()) {
    const auto now = followers.now(data_->acting(state.time)->pressures, data_->displacements(state));
    forces -= followers.unsymmetric_changes(now, moved);
  }
  return data_->unknowns.of(forces);
}

template <int Dim> State NonlinearEquilibrium<Dim>::commit(State state) const {
  state.history = data_->ask(state, false)->of.history;
  state.dt = 0.0;
  return state;
}

template <int Dim> bool NonlinearEquilibrium<Dim>::linear() const {
  return data_->materials.linear();
}

template <int Dim> const std::vector<Index>& NonlinearEquilibrium<Dim>::node_of_unknowns() const {
  return data_->unknowns.node_of();
}

template <int Dim> double NonlinearEquilibrium<Dim>::energy(const State& state) const {
  return data_->held.quadrature().weights.dot(data_->energies(*data_->ask(state, false)));
}

template <int Dim> PointFields<Dim> NonlinearEquilibrium<Dim>::fields(const State& state) const {
  const auto answer = data_->ask(state, false);
  const auto& points = data_->held.quadrature();
  const Index size = points.size();
  PointFields<Dim> result{answer->seen,
                          data_->stresses(*answer),
                          VoigtPoints<Dim>(voigt_size<Dim>, size),
                          VoigtPoints<Dim>(voigt_size<Dim>, size),
                          data_->energies(*answer),
                          answer->of.dissipated,
                          answer->of.history};
  if constexpr (Dim == 2)
    if (data_->materials.plane() == Plane::stress) {  // PlaneStress remembers its strains last, zz first of them
      const auto places = data_->materials.history_places(points);
      for (Index K = 0; K < size; ++K)
        result.F(4, K) = result.history[places[K] + data_->materials.history_size(points.region[K]) - 3];
    }
  for (Index K = 0; K < size; ++K) {
    const Gradient<Dim> P = answer->of.P.col(K);
    result.strain.col(K) = strain_of<Dim>(result.F.col(K));
    result.stress.col(K) = stress_of<Dim>(P);
    result.F.col(K) += trace_direction<Dim>();
    if (!data_->is_finite(K)) continue;
    const Mat<3> F = in_space<Dim>(result.F.col(K));
    const auto [squares, axes] = internal::spectrum<3>(F * F.transpose());
    const Mat<3> log = axes * (0.5 * squares.array().log()).matrix().asDiagonal() * axes.transpose();
    result.strain.col(K) = strain_of<Dim>(components<Dim>(log));
    result.stress.col(K) = stress_of<Dim>(components<Dim>(in_space<Dim>(P) * F.transpose() / F.determinant()));
  }
  return result;
}

template <int Dim> Resultants<Dim> NonlinearEquilibrium<Dim>::reactions(const State& state) const {
  const auto acting = data_->acting(state.time);
  const Points<Dim> U = data_->displacements(state);
  const Gradients<Dim> P = data_->stresses(*data_->ask(state, false));
  Resultants<Dim> reactions = data_->held.reactions(acting->restraints, P, U, finite_strain());
  if (data_->weakly) return reactions;
  const auto& [space, nodes] = std::tie(approximation().space, approximation().node_dofs);
  std::vector<Index> node_at(space.size(), -1);
  for (std::size_t I = 0; I < nodes.size(); ++I) node_at[nodes[I]] = static_cast<Index>(I);
  const Points<Dim> forces = data_->internal_forces(state) - data_->external_forces(state);
  Points<Dim> moved_by = interpolate(approximation().shape, U);
  moved_by(Eigen::all, nodes) = U;  // forces on coefficients have these as arms: functions reproduce x + u
  const NodalReactions<Dim> nodal(space, node_at, acting->rigid, acting->restraints);
  for (const auto& [part, of] : nodal(forces, finite_strain() ? &moved_by : nullptr)) reactions[part] += of;
  return reactions;
}

template <int Dim> double NonlinearEquilibrium<Dim>::largest_gap(const State& state) const {
  return data_->held.largest_gap(data_->acting(state.time)->restraints, data_->displacements(state));
}

template <int Dim> std::vector<AppliedLoad<Dim>> NonlinearEquilibrium<Dim>::applied(const State& state) const {
  const auto& program = data_->program;
  const double full = program.full_at;
  Points<Dim> moved_by;
  if (finite_strain()) moved_by = interpolate(approximation().shape, data_->displacements(state));
  Loads<Dim> dead = program.loads(full != 0.0 ? full : state.time);
  dead.followers.clear();
  auto loads = applied_loads(approximation().space, dead, finite_strain() ? &moved_by : nullptr);
  if (full != 0.0)
    for (auto& load : loads) load.of = load.of * (state.time / full);
  for (auto& [on, of] : data_->followers.resultants(data_->acting(state.time)->pressures, data_->displacements(state)))
    loads.push_back({on, "follower_pressure", of});
  return loads;
}

template <int Dim> double NonlinearEquilibrium<Dim>::smallest_jacobian(const State& state) const {
  const Gradients<Dim> H = data_->gradients(state);
  double smallest = std::numeric_limits<double>::infinity();
  for (Index K = 0; K < data_->held.size(); ++K)
    smallest = std::min(smallest, in_space<Dim>(data_->deformation(H, K)).determinant());
  return smallest;
}

template <int Dim> void NonlinearEquilibrium<Dim>::check(const State& balanced) const {
  const Gradients<Dim> H = data_->gradients(balanced);
  for (Index K = 0; K < data_->held.size(); ++K)
    if (data_->is_finite(K)) data_->volume(H, K);  // small strains know no J
}

template <int Dim> bool NonlinearEquilibrium<Dim>::finite_strain() const {
  return std::ranges::find(data_->finite, true) != data_->finite.end();
}
template <int Dim> const Approximation<Dim>& NonlinearEquilibrium<Dim>::approximation() const {
  return data_->approximation;
}
template <int Dim> const ElasticModel& NonlinearEquilibrium<Dim>::model() const {
  return data_->model;
}
template <int Dim> const Materials<Dim>& NonlinearEquilibrium<Dim>::materials() const {
  return data_->materials;
}

template class NonlinearEquilibrium<2>;
template class NonlinearEquilibrium<3>;

}  // namespace efree
