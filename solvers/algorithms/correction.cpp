// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/algorithms/correction.hpp"

#include "efree/assembly/bodies.hpp"
#include "efree/assembly/internal/finite_elements.hpp"
#include "efree/assembly/internal/gather.hpp"
#include "efree/assembly/loads.hpp"
#include "efree/assembly/nitsche.hpp"
#include "efree/assembly/nodal_conditions.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/solvers/equations/internal/stiffness_terms.hpp"
#include "efree/solvers/equations/locking.hpp"
#include "efree/solvers/linear/internal/coarse_space.hpp"
#include "efree/solvers/linear/internal/combinations.hpp"
#include "efree/solvers/linear/internal/condensation.hpp"
#include "efree/solvers/linear/internal/hats.hpp"
#include "efree/solvers/linear/internal/in_step.hpp"
#include "efree/solvers/linear/internal/linear_elements.hpp"
#include "efree/solvers/linear/internal/smoother.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <mutex>
#include <numeric>
#include <optional>
#include <span>

namespace efree {
namespace {

/// Iterations that an estimate of the error takes, and those of them beyond the answer (Strakos & Tichy 2002): without
/// any, what is said to be left was 0.48 to 1.60 times the truth, with one 0.71 to 1.35. Where dilatations are averaged
/// it takes more: the nearer to nu = 1/2, the more convergence slows down after the first ones.
constexpr int least_iterations = 2, least_iterations_averaged = 4, delay = 1;
/// Iterations after which it is asked whether the cloud is too coarse to help, and what the set-up of hats costs in
/// iterations; they take a tenth of the squared error and less in each (docs/evidence.md, "Iterations").
constexpr int probation = 5;
constexpr double cost_of_hats = 15.0;
/// Iterations after which elements few enough for it are solved directly: no coarse space helps.
constexpr int patience = 20;
/// Blocks stored of the stiffness that are few enough for a direct solver.
template <int Dim> constexpr double few_entries = Dim == 2 ? 5e6 : 5e5;
/// Squared error, relative, that is rounding.
constexpr double error_rounding = 1e-20;
/// Energy that is rounding, and a step's that is, relative to what it would be if nodes moved one by one: a body that
/// moves as a whole has no more.
constexpr double no_energy = 1e-24, no_step = 1e-28;
/// Share of an energy beside a coarse space that is rounding.
constexpr double dependent = 1e-12;

/// Sum of a . b over all columns, in an order that does not depend on the threads.
template <int Dim> double dot(const Points<Dim>& a, const Points<Dim>& b) {
  constexpr Index chunk = 8192;
  const Index n = static_cast<Index>(a.cols());
  std::vector<double> sums((n + chunk - 1) / chunk);
  parallel_chunks(n, chunk, [&](Index begin, Index end) {
    sums[begin / chunk] = a.middleCols(begin, end - begin).cwiseProduct(b.middleCols(begin, end - begin)).sum();
  });
  return std::accumulate(sums.begin(), sums.end(), 0.0);
}

/// a += factor * b.
template <int Dim> void add(Points<Dim>& a, double factor, const Points<Dim>& b) {
  parallel_chunks(static_cast<Index>(a.cols()), 8192, [&](Index begin, Index end) {
    a.middleCols(begin, end - begin) += factor * b.middleCols(begin, end - begin);
  });
}

/// b = a - b.
template <int Dim> void subtract_from(const Points<Dim>& a, Points<Dim>& b) {
  parallel_chunks(static_cast<Index>(a.cols()), 8192, [&](Index begin, Index end) {
    b.middleCols(begin, end - begin) = a.middleCols(begin, end - begin) - b.middleCols(begin, end - begin);
  });
}

/// b = a + factor * b.
template <int Dim> void add_to_multiple(const Points<Dim>& a, double factor, Points<Dim>& b) {
  parallel_chunks(static_cast<Index>(a.cols()), 8192, [&](Index begin, Index end) {
    b.middleCols(begin, end - begin) = a.middleCols(begin, end - begin) + factor * b.middleCols(begin, end - begin);
  });
}

/// What nodal values hold: some directions at some nodes.
template <int Dim> struct Supports {
  struct Support {
    Index node;
    Mat<Dim> free;   ///< projector onto the directions that are not held
    Vec<Dim> value;  ///< displacement along those that are
  };
  std::vector<Support> supports;  ///< nodes ascending
  std::vector<Index> of_node;     ///< by node: index into supports, -1 if it is free

  Supports(const NodalConditions<Dim>& conditions, Index nodes) : of_node(nodes, -1) {
    for (std::size_t k = 0; k < conditions.nodes.size(); ++k) {
      const auto& frame = conditions.frames[k];
      const auto held = frame.leftCols(conditions.fixed[k]);
      Vec<Dim> value = held * conditions.values[k].head(conditions.fixed[k]);
      of_node[conditions.nodes[k]] = static_cast<Index>(k);
      supports.push_back({conditions.nodes[k], Mat<Dim>::Identity() - held * held.transpose(), value});
    }
  }
  bool is_free(Index node) const { return of_node[node] < 0; }
  /// What is held of x, support by support.
  Points<Dim> held(const Points<Dim>& x) const {
    Points<Dim> result(Dim, std::ssize(supports));
    for (std::size_t k = 0; k < supports.size(); ++k) {
      const Vec<Dim> there = x.col(supports[k].node);
      result.col(static_cast<Index>(k)) = there - supports[k].free * there;
    }
    return result;
  }
  Mat<Dim> free(Index node) const {
    return is_free(node) ? Mat<Dim>(Mat<Dim>::Identity()) : supports[of_node[node]].free;
  }
  /// Takes out what is held.
  void release(Points<Dim>& x) const {
    for (const Support& s : supports) x.col(s.node) = s.free * Vec<Dim>(x.col(s.node));
  }
  /// Leaves what is held alone.
  void keep_held(Points<Dim>& x) const {
    const Points<Dim> kept = held(x);
    x.setZero();
    for (std::size_t k = 0; k < supports.size(); ++k) x.col(supports[k].node) = kept.col(static_cast<Index>(k));
  }
  /// Sets what is held.
  void impose(Points<Dim>& x) const {
    for (const Support& s : supports) x.col(s.node) = s.free * Vec<Dim>(x.col(s.node)) + s.value;
  }
};

/// What each further iteration takes off, over the one before, after at least two that took these squares off: between
/// the mean ratio of the last three and the slowest mean up to there.
double convergence(std::span<const double> taken) {
  const auto n = taken.size();
  double slowest = 0.0, mean = 0.0;
  for (std::size_t back = 1; back <= std::min<std::size_t>(3, n - 1); ++back) {
    mean = std::pow(taken[n - 1] / taken[n - 1 - back], 1.0 / static_cast<double>(back));
    slowest = std::max(slowest, mean);
  }
  return std::min(std::sqrt(slowest * mean), 0.9);
}

/// Squared error left after iterations that took these squares off (Hestenes & Stiefel 1952): those to come, as a
/// geometric series. After a single iteration, Radau's rule for nine tenths of the one Ritz value there is (Meurant &
/// Tichy 2013). All chosen on the cases of bench_correction.
double error_left(std::span<const double> taken) {
  const auto n = taken.size();
  if (n < 2) return n == 0 ? std::numeric_limits<double>::infinity() : taken[0] / 9.0;
  const double ratio = convergence(taken);
  return taken[n - 1] * ratio / (1.0 - ratio);
}

/// Whether hats would end it sooner, set-up included, with this squared error to be reached.
bool hats_are_faster(std::span<const double> taken, double aim) {
  const double decades = std::log10(error_left(taken) / aim);
  return decades / -std::log10(convergence(taken)) > decades + cost_of_hats;
}

/// What Nitsche adds to the system: right-hand side at the element nodes, matrix at the degrees of freedom of the space
/// (empty if there is none).
template <int Dim> struct WeakConditions {
  Points<Dim> rhs;
  SymmetricMatrix matrix;
};

/// Degrees of freedom of the space by element node, with their shares in its displacement: where regions meet, each has
/// its own, and the stiffer side hardly follows the softer one.
template <int Dim> struct Members {
  Ragged<Index> dofs;
  std::vector<double> shares;  ///< by item of `dofs`, summing to one at every node
};
template <int Dim>
Members<Dim> members(const FineSpace<Dim>& space, const ElementNodes& nodes, const Materials<Dim>& materials) {
  std::vector<double> stiffness(space.size(), 1.0), total(nodes.count, 0.0);
  Stiffness<Dim> room;
  if (materials.num_regions() > 1)
    for (Index c = 0; c < space.mesh().num_cells(); ++c)
      for (const Index dof : space.cell(c))
        stiffness[dof] = materials.stiffness(space.mesh().region(c), space.points().col(dof), room).C(0, 0);
  Members<Dim> result;
  result.dofs.offsets.assign(nodes.count + 1, 0);
  for (Index dof = 0; dof < space.size(); ++dof) {
    ++result.dofs.offsets[nodes.at[dof] + 1];
    total[nodes.at[dof]] += stiffness[dof];
  }
  std::partial_sum(result.dofs.offsets.begin(), result.dofs.offsets.end(), result.dofs.offsets.begin());
  result.dofs.items.resize(space.size());
  result.shares.resize(space.size());
  std::vector<Index> cursor(result.dofs.offsets.begin(), result.dofs.offsets.end() - 1);
  for (Index dof = 0; dof < space.size(); ++dof) {
    const Index at = cursor[nodes.at[dof]]++;
    result.dofs.items[at] = dof;
    result.shares[at] = stiffness[dof] / total[nodes.at[dof]];
  }
  return result;
}

/// Values of the cloud's functions at the nodes of the elements.
template <int Dim> ShapeTable<Dim> shape_at_nodes(const ShapeTable<Dim>& shape, const Members<Dim>& members) {
  std::vector<Offset> offsets{0};
  std::vector<Index> columns;
  std::vector<double> N;
  columns.reserve(shape.num_entries());
  N.reserve(shape.num_entries());
  std::vector<std::pair<Index, double>> row;
  for (Index node = 0; node < members.dofs.rows(); ++node) {
    row.clear();
    for (Index m = members.dofs.offsets[node]; m < members.dofs.offsets[node + 1]; ++m) {
      const auto of_dof = shape.row(members.dofs.items[m]);
      for (std::size_t k = 0; k < of_dof.nodes.size(); ++k)
        row.emplace_back(of_dof.nodes[k], members.shares[m] * of_dof.N[k]);
    }
    // Twins belong to different bodies: no function acts on both.
    if (members.dofs[node].size() > 1) std::ranges::sort(row);
    for (const auto& [I, value] : row) columns.push_back(I), N.push_back(value);
    offsets.push_back(static_cast<Offset>(columns.size()));
  }
  return {shape.num_nodes(), std::move(offsets), std::move(columns), std::move(N)};
}

/// K on what the supports leave free, lower triangle; what they hold, or what has no stiffness, is alone.
template <int Dim> SymmetricMatrix held_matrix(const BlockMatrix<Dim>& K, const Supports<Dim>& supports) {
  return gather_blocks<Dim>(K.size(), [&](Index a, Accumulator<Mat<Dim>>& sums) {
    const Mat<Dim> free = supports.free(a);
    K.for_row(a, [&](Index b, const Mat<Dim>& block) {
      if (b >= a) sums[b] += supports.free(b) * block.transpose() * free;
    });
    const double stiffness = K.diagonal(a).trace();
    sums[a] += stiffness > 0.0 ? Mat<Dim>(stiffness * (Mat<Dim>::Identity() - free)) : Mat<Dim>::Identity();
  });
}

/// How far the nodes of the cloud are from each other, in nodes of the elements: twice the mean number of steps through
/// K to the nearest of them. Along walls and around pores that is farther than their volume tells.
template <int Dim>
double steps_apart(const BlockMatrix<Dim>& K, const std::vector<Index>& cloud, const ElementNodes& nodes, int degree) {
  std::vector<Index> steps(K.size(), -1), front;
  for (const Index dof : cloud)
    if (Index& step = steps[nodes.at[dof]]; step < 0) step = 0, front.push_back(nodes.at[dof]);
  double sum = 0.0;
  for (std::size_t k = 0; k < front.size(); ++k) {
    const Index node = front[k];
    sum += steps[node];
    K.for_row(node, [&](Index other, const auto&) {
      if (Index& step = steps[other]; step < 0) step = steps[node] + 1, front.push_back(other);
    });
  }
  return 2.0 * degree * sum / static_cast<double>(front.size());
}

/// Where the nodes of the elements are.
template <int Dim> Points<Dim> element_places(const FineSpace<Dim>& space, const ElementNodes& nodes) {
  Points<Dim> places(Dim, nodes.count);
  for (Index dof = 0; dof < space.size(); ++dof) places.col(nodes.at[dof]) = space.points().col(dof);
  return places;
}

/// Whether the functions of an approximation are given at the vertices alone, and linear along edges.
template <int Dim> bool is_lifted(const Approximation<Dim>& approximation) {
  return approximation.shape.num_points() < approximation.space.size();
}

/// Functions that are linear along edges at the vertices of a mesh, in the order in which the nodes meet them, and how
/// the nodes follow.
template <int Dim> struct AtVertices {
  ShapeTable<Dim> shape;
  Lift<Dim> lift;
};
template <int Dim>
AtVertices<Dim> shape_at_vertices(const Approximation<Dim>& approximation, const Members<Dim>& members) {
  const FineSpace<Dim>& space = approximation.space;
  const Index vertices = space.mesh().num_vertices();
  const auto edges = space.edges();
  AtVertices<Dim> result;
  std::vector<Index> number(vertices, -1), order;
  const auto add = [&](Index vertex, double share) {
    if (number[vertex] < 0) number[vertex] = static_cast<Index>(order.size()), order.push_back(vertex);
    result.lift.parents.items.push_back({number[vertex], share});
  };
  result.lift.parents.items.reserve(2 * members.shares.size());
  for (Index node = 0; node < members.dofs.rows(); ++node) {
    for (Index m = members.dofs.offsets[node]; m < members.dofs.offsets[node + 1]; ++m) {
      const Index dof = members.dofs.items[m];
      if (dof < vertices) {
        add(dof, members.shares[m]);
      } else {
        for (const Index end : edges[dof - vertices]) add(end, 0.5 * members.shares[m]);
      }
    }
    result.lift.parents.close_row();
  }
  result.lift.points = space.points()(Eigen::all, order);
  std::vector<Offset> offsets{0};
  std::vector<Index> columns;
  std::vector<double> N;
  columns.reserve(approximation.shape.num_entries());
  N.reserve(approximation.shape.num_entries());
  for (const Index vertex : order) {
    const auto row = approximation.shape.row(vertex);
    columns.insert(columns.end(), row.nodes.begin(), row.nodes.end());
    N.insert(N.end(), row.N.begin(), row.N.end());
    offsets.push_back(static_cast<Offset>(columns.size()));
  }
  result.shape = {approximation.shape.num_nodes(), std::move(offsets), std::move(columns), std::move(N)};
  return result;
}

/// What takes off the smooth part of an error, and the degree of the smoother that takes the rest.
template <int Dim> struct Level {
  std::unique_ptr<const CoarseSolver<Dim>> space;
  int degree;
  bool is_of_elements = false;
};

}  // namespace

template <int Dim> struct Corrector<Dim>::Impl {
  const Approximation<Dim>& approximation;
  bool mean_dilatation;
  ElementNodes nodes;
  Members<Dim> members;
  Supports<Dim> supports;
  WeakConditions<Dim> weak;
  BlockMatrix<Dim> K;  ///< of the nodes that the condensation leaves
  Condensation<Dim> condensation;
  std::vector<Mat<Dim>> diagonal;  ///< of K
  Level<Dim> first;
  Smoother<Dim> smoother;
  mutable std::once_flag has_hats{};
  mutable std::optional<Level<Dim>> hats_{};
  mutable std::optional<ScaledCholesky> direct{};  ///< of all, once it was needed

  /// The displacement at the element nodes of one at the degrees of freedom of the space, or at the vertices and linear
  /// along edges.
  Points<Dim> at_nodes(const Points<Dim>& u) const {
    const FineSpace<Dim>& space = approximation.space;
    const auto given = static_cast<Index>(u.cols());
    require(given == space.size() || given == space.mesh().num_vertices(),
            "correction: a displacement for each degree of freedom, or each vertex, expected");
    const auto edges = given < space.size() ? space.edges() : std::vector<std::array<Index, 2>>();
    Points<Dim> result = Points<Dim>::Zero(Dim, nodes.count);
    for (Index node = 0; node < nodes.count; ++node)
      for (Index m = members.dofs.offsets[node]; m < members.dofs.offsets[node + 1]; ++m) {
        const Index dof = members.dofs.items[m];
        if (dof < given) {
          result.col(node) += members.shares[m] * u.col(dof);
        } else {
          const auto [first_end, second_end] = edges[dof - given];
          result.col(node) += 0.5 * members.shares[m] * (u.col(first_end) + u.col(second_end));
        }
      }
    return result;
  }
  /// For errors that the cloud cannot see: made when they are first asked for.
  const Level<Dim>& hats() const {
    std::call_once(has_hats, [&] {
      Points<Dim> places = element_places(approximation.space, nodes);
      Hats<Dim> hats = make_hats(K, places);
      const int degree = smoothing_degree(approximation.space.degree() * hats.apart);
      const std::vector<char> all(hats.shape.num_nodes(), 1);
      hats_.emplace(Level<Dim>{
          std::make_unique<CoarseSpace<Dim>>(K, std::move(hats.shape), std::move(places), std::move(hats.nodes), all,
                                             [&](Index node) { return supports.free(node); }),
          degree});
    });
    return *hats_;
  }
  /// a^T K b with all nodes.
  double work(const Points<Dim>& a, const Points<Dim>& b) const {
    Points<Dim> forces;
    K.multiply(b, forces);
    return dot<Dim>(a, forces) + condensation.work(a, b);
  }
  /// Twice the sum over the nodes of the energy if they alone had their displacement.
  double energy_one_by_one(const Points<Dim>& u) const {
    double sum = 0.0;
    for (Index node = 0; node < nodes.count; ++node) sum += u.col(node).dot(diagonal[node] * u.col(node));
    return sum;
  }
  /// Loads at the element nodes.
  Points<Dim> loads(const Loads<Dim>& given, const ShapeTable<Dim>& identity) const {
    return weak.rhs + gathered(load_vector(approximation.space, identity, given));
  }
  ShapeTable<Dim> identity() const { return ShapeTable<Dim>::identity(approximation.space.size()); }
  /// Forces at the degrees of freedom of the space as forces at the element nodes.
  Points<Dim> gathered(const Points<Dim>& forces) const {
    Points<Dim> f = Points<Dim>::Zero(Dim, nodes.count);
    for (Index dof = 0; dof < approximation.space.size(); ++dof) f.col(nodes.at[dof]) += forces.col(dof);
    return f;
  }
  /// Nitsche's matrix times a displacement at the degrees of freedom of the space.
  Points<Dim> held_weakly(const Points<Dim>& u) const {
    if (weak.matrix.size() == 0) return Points<Dim>::Zero(Dim, u.cols());
    const Vector forces = weak.matrix.template selfadjointView<Eigen::Lower>() * u.reshaped();
    return forces.reshaped(Dim, u.cols());
  }
  /// Nitsche's part in the energy of a displacement at the degrees of freedom of the space.
  double energy_held_weakly(const Points<Dim>& u) const {
    return weak.matrix.size() == 0 ? 0.0 : 0.5 * dot<Dim>(u, held_weakly(u));
  }
  /// What a functional works with on displacements, at the element nodes.
  Points<Dim> forces_of(const Functional<Dim>& functional) const {
    Points<Dim> forces = gathered(functional.forces);
    if (functional.weak_motion.size() > 0) forces -= gathered(held_weakly(functional.weak_motion));
    return forces;
  }
  /// What iterations begin with: the displacement u, which has what is held, and forces; `start` is what errors are
  /// said of.
  struct Beginning {
    Points<Dim> forces, start, u;
  };
  /// Where they end.
  struct End {
    Correction<Dim> correction;
    bool is_term = false;  ///< of a sum, which needs
    Points<Dim> forces;    ///< K times the answer
    Points<Dim> off;       ///< and times what `start` is off it
  };
  /// All of them in step.
  std::vector<Correction<Dim>> iterate(const std::vector<Beginning>& from, const CorrectionOptions& options,
                                       const Stage& stage) const;
  struct Iterates;
  /// Which of them are sums of others: their terms.
  std::vector<std::vector<internal::Term>> sums_among(const std::vector<Beginning>& from) const;
  /// Those of these numbers.
  void iterate(const std::vector<Beginning>& from, const std::vector<std::size_t>& numbers,
               const CorrectionOptions& options, const Stage& stage, std::vector<End>& ends) const;
  Iteration iterate(InStep<Dim>& in_step, const Beginning& from, const CorrectionOptions& options, const Stage& stage,
                    End& end) const;
  /// The sum of answers to other forces.
  void combine(const Beginning& from, const std::vector<internal::Term>& terms, const std::vector<End>& ends,
               End& end) const;
};

namespace {

/// Adds what holds restraints weakly.
template <int Dim>
WeakConditions<Dim> hold_weakly(const FineSpace<Dim>& space, const ElementNodes& nodes, const Materials<Dim>& materials,
                                const std::vector<Restraint<Dim>>& weak, bool mean_dilatation, BlockMatrix<Dim>& K) {
  WeakConditions<Dim> conditions{Points<Dim>::Zero(Dim, nodes.count), {}};
  if (weak.empty()) return conditions;
  const auto elements = approximate<Dim>(space.mesh(), {.kind = space.degree() == 1 ? BasisKind::p1 : BasisKind::p2,
                                                        .axisymmetric = space.axisymmetric(),
                                                        .dilatation = averaged_if(mean_dilatation)});
  auto system = nitsche<Dim>(space, elements.shape, stiffness_terms(elements, materials), weak);
  for (Index dof = 0; dof < space.size(); ++dof)
    conditions.rhs.col(nodes.at[dof]) += system.rhs.template segment<Dim>(Dim * dof);
  for (Index column = 0; column < system.matrix.cols(); ++column)
    for (SymmetricMatrix::InnerIterator entry(system.matrix, column); entry; ++entry) {
      const Index i = nodes.at[entry.row() / Dim], j = nodes.at[column / Dim];
      const int p = entry.row() % Dim, q = column % Dim;
      if (K.stores(i, j)) K.block(i, j)(p, q) += entry.value();
      if (entry.row() != column && K.stores(j, i)) K.block(j, i)(q, p) += entry.value();
    }
  conditions.matrix = std::move(system.matrix);
  return conditions;
}

}  // namespace

template <int Dim> bool takes_mean_dilatation(const Approximation<Dim>& approximation, const ElasticModel& model) {
  const double bearable = bearable_incompressibility(BasisKind::p2);
  const FineMesh<Dim>& mesh = approximation.space.mesh();
  return approximation.averaged && materials_of(model, mesh).incompressibility(mesh) > bearable;
}

template <int Dim> Corrector<Dim>::Corrector(const Approximation<Dim>& approximation, const ElasticModel& model,
                                             const std::vector<DisplacementCondition<Dim>>& conditions,
                                             const Monitor& monitor) {
  const Stage stage("correction", monitor);
  const FineSpace<Dim>& space = approximation.space;
  require_decided(approximation, model);
  require(!approximation.averaged || space.degree() == 2,
          "correction: linear elements lock where the dilatation has to be averaged (nearly incompressible materials): "
          "in_quadratic_space");
  const auto materials = materials_of(model, space.mesh());
  const auto ties = tied_facets(space.mesh(), model.open_interface);
  const auto restrained = restraints(conditions);
  require_restrained(space, restrained, ties);
  const bool mean_dilatation = takes_mean_dilatation(approximation, model);
  ElementNodes nodes = element_nodes(space, ties);
  auto K = element_stiffness(space, nodes, materials, mean_dilatation);
  std::vector<Restraint<Dim>> nodal, others;
  for (const auto& restraint : restrained) (can_be_nodal(space, restraint) ? nodal : others).push_back(restraint);
  auto weak = hold_weakly(space, nodes, materials, others, mean_dilatation, K);
  const Supports<Dim> supports(nodal_conditions(space, nodes.at, nodal), nodes.count);
  Members<Dim> dofs_of = members(space, nodes, materials);
  const auto free = [&](Index node) { return supports.free(node); };
  const bool on_elements = Dim == 2 && space.degree() == 2 && !approximation.averaged;
  const double nodes_apart = on_elements ? 0.0 : steps_apart(K, approximation.node_dofs, nodes, space.degree());
  Condensation<Dim> condensation(K, flat_groups(space, nodes, K, [&](Index node) { return supports.is_free(node); }));
  const auto first = [&]() -> Level<Dim> {
    if (on_elements) return {std::make_unique<LinearElements<Dim>>(K, space, nodes, free), 1, true};
    Points<Dim> places = element_places(space, nodes);
    if (is_lifted(approximation)) {
      auto [shape, lift] = shape_at_vertices(approximation, dofs_of);
      const auto turning = thin_nodes(shape, lift.points, K.size(), nodes_apart);
      return {std::make_unique<CoarseSpace<Dim>>(K, std::move(shape), std::move(places), approximation.nodes, turning,
                                                 free, std::move(lift)),
              smoothing_degree(nodes_apart)};
    }
    ShapeTable<Dim> shape = shape_at_nodes(approximation.shape, dofs_of);
    const auto turning = thin_nodes(shape, places, K.size(), nodes_apart);
    return {
        std::make_unique<CoarseSpace<Dim>>(K, std::move(shape), std::move(places), approximation.nodes, turning, free),
        smoothing_degree(nodes_apart)};
  };
  Level<Dim> level = first();
  Smoother<Dim> smoother(K, free, level.is_of_elements ? 1 : highest_degree);
  std::vector<Mat<Dim>> diagonal;
  diagonal.reserve(nodes.count);
  for (Index node = 0; node < nodes.count; ++node) diagonal.push_back(K.diagonal(node));
  impl_.reset(new Impl{approximation, mean_dilatation, std::move(nodes), std::move(dofs_of), supports, std::move(weak),
                       std::move(K), std::move(condensation), std::move(diagonal), std::move(level),
                       std::move(smoother)});
}

template <int Dim> Corrector<Dim>::~Corrector() = default;
template <int Dim> Corrector<Dim>::Corrector(Corrector&&) noexcept = default;

template <int Dim> Correction<Dim> Corrector<Dim>::correct(const Points<Dim>& given, const Loads<Dim>& loads,
                                                           const CorrectionOptions& options,
                                                           const Monitor& monitor) const {
  return std::move(correct_all({given}, {loads}, options, monitor).front());
}

template <int Dim> std::vector<Correction<Dim>> Corrector<Dim>::correct_all(const std::vector<Points<Dim>>& starts,
                                                                            const std::vector<Loads<Dim>>& cases,
                                                                            const CorrectionOptions& options,
                                                                            const Monitor& monitor) const {
  const Stage stage("correction", monitor);
  require(starts.size() == cases.size(), "correction: as many displacements to start from as load cases expected");
  std::vector<typename Impl::Beginning> from;
  const ShapeTable<Dim> identity = impl_->identity();
  for (std::size_t k = 0; k < cases.size(); ++k) {
    const Points<Dim> start = impl_->at_nodes(starts[k]);
    from.push_back({impl_->loads(cases[k], identity), start, start});
    impl_->supports.impose(from.back().u);
  }
  return impl_->iterate(from, options, stage);
}

template <int Dim>
std::vector<std::vector<internal::Term>> Corrector<Dim>::Impl::sums_among(const std::vector<Beginning>& from) const {
  // In the order of their energies, so that none is left over from others of more energy that cancel.
  std::vector<double> energies;
  for (const Beginning& one : from) energies.push_back(std::abs(dot<Dim>(one.start, one.forces)));
  std::vector<std::size_t> order(from.size());
  std::iota(order.begin(), order.end(), 0);
  std::ranges::stable_sort(order, {}, [&](std::size_t k) { return energies[k]; });
  std::vector<Points<Dim>> held;
  for (const std::size_t k : order) held.push_back(supports.held(from[k].u));
  const auto numbers = [](const Points<Dim>& of) { return std::span(of.data(), static_cast<std::size_t>(of.size())); };
  std::vector<internal::Parts> causes;
  for (std::size_t k = 0; k < order.size(); ++k) causes.push_back({numbers(from[order[k]].forces), numbers(held[k])});
  const auto found = internal::combinations(causes);
  std::vector<std::vector<internal::Term>> sums(from.size());
  for (std::size_t k = 0; k < from.size(); ++k)
    for (const auto& [vector, factor] : found[k]) sums[order[k]].push_back({order[vector], factor});
  return sums;
}

template <int Dim> std::vector<Correction<Dim>> Corrector<Dim>::Impl::iterate(const std::vector<Beginning>& from,
                                                                              const CorrectionOptions& options,
                                                                              const Stage& stage) const {
  std::vector<End> ends(from.size());
  // Only those that are to take answers to a tolerance, from wherever.
  const auto sums = options.iterations < 0 && from.size() > 1 ? sums_among(from)
                                                              : std::vector<std::vector<internal::Term>>(from.size());
  std::vector<std::size_t> alone, left;
  for (std::size_t k = 0; k < from.size(); ++k) {
    if (sums[k].empty()) alone.push_back(k);
    for (const auto& term : sums[k]) ends[term.vector].is_term = true;
  }
  iterate(from, alone, options, stage, ends);
  for (std::size_t k = 0; k < from.size(); ++k)
    if (!sums[k].empty()) combine(from[k], sums[k], ends, ends[k]);
  for (std::size_t k = 0; k < from.size(); ++k)  // most of the sum may cancel
    if (!sums[k].empty() && !(ends[k].correction.error <= options.tolerance)) left.push_back(k);
  iterate(from, left, options, stage, ends);
  std::vector<Correction<Dim>> results;
  for (End& end : ends) results.push_back(std::move(end.correction));
  return results;
}

template <int Dim>
void Corrector<Dim>::Impl::iterate(const std::vector<Beginning>& from, const std::vector<std::size_t>& numbers,
                                   const CorrectionOptions& options, const Stage& stage, std::vector<End>& ends) const {
  InStep<Dim> in_step(K, smoother);
  std::vector<Iteration> iterations;
  for (const std::size_t k : numbers) {
    ends[k].correction = {};
    iterations.push_back(iterate(in_step, from[k], options, stage, ends[k]));
  }
  in_step.run();
  for (const Iteration& one : iterations) one.check();
}

template <int Dim> void Corrector<Dim>::Impl::combine(const Beginning& from, const std::vector<internal::Term>& terms,
                                                      const std::vector<End>& ends, End& end) const {
  Correction<Dim>& result = end.correction;
  result.displacement = Points<Dim>::Zero(Dim, approximation.space.size());
  Points<Dim> forces = Points<Dim>::Zero(Dim, nodes.count), of_start = forces;
  double off = 0.0;  // at most
  for (const auto& [k, factor] : terms) {
    const Correction<Dim>& term = ends[k].correction;
    add<Dim>(result.displacement, factor, term.displacement);
    add<Dim>(forces, factor, ends[k].forces);
    add<Dim>(of_start, factor, ends[k].off);
    off += std::abs(factor) * term.error * std::sqrt(std::max(0.0, term.whole));
    result.iterations = std::max(result.iterations, term.iterations);
  }
  const Points<Dim> u = at_nodes(result.displacement), moved = from.start - u;
  result.whole = dot<Dim>(u, forces) + condensation.work(u, u) - 2.0 * energy_held_weakly(result.displacement);
  const double start = dot<Dim>(moved, of_start) + condensation.work(moved, moved);
  const bool deformed = result.whole > no_energy * energy_one_by_one(u);
  result.error = deformed ? off / std::sqrt(result.whole) : std::numeric_limits<double>::infinity();
  result.start_error = deformed ? std::sqrt(std::max(0.0, start) / result.whole) : 0.0;
  result.strain_energy = 0.5 * result.whole;
}

/// The iterates for one right-hand side, and what is known of their errors. All is done on the nodes that the
/// condensation leaves; the others follow in the end, exactly. Products that iterations share (InStep) are awaited
/// between the members.
template <int Dim> struct Corrector<Dim>::Impl::Iterates {
  const Impl& problem;
  const Points<Dim>&forces, &start;
  const CorrectionOptions& options;
  End& end;
  Correction<Dim>& result = end.correction;

  const bool open = options.iterations < 0;  ///< as many iterations as it takes
  const int least = problem.approximation.averaged ? least_iterations_averaged : least_iterations;
  /// The answer is iterate `wanted`, or an earlier one that is good; what comes after it only tells how good it is.
  const int wanted = open ? options.most : options.iterations, last = std::max(wanted + delay, least);

  const Level<Dim>* level = &problem.first;
  Points<Dim> f;        ///< forces on the nodes that are left
  Points<Dim> u, g, r;  ///< the iterate, K u, and f - K u on what is free
  Points<Dim> p;        ///< the direction of the last step
  Points<Dim> z, q, rest;
  double rz = 0.0, alpha = 0.0, curvature = 0.0;  ///< of the last step: r . z, its length along p, p . K p
  double one_by_one = 0.0, scale = 0.0;           ///< energy_one_by_one; what squared errors are relative to

  /// The answer that there was before a coarse space other than the cloud's, beside that space, and K times it: all
  /// later iterates stay the best ones with it, too, so that their energy is off by the square of their error only.
  Points<Dim> own, pull;
  double own_stiffness = 0.0;

  /// What iterations were given, if they do not begin with it, and K times it; the squared error that coarse solution
  /// and smoother see of it; whether that is small enough.
  Points<Dim> given, pull_of_given;
  double off_given = 0.0;
  bool suffices = false;

  Points<Dim> of_start;               ///< K start, if that is where iterations begin
  std::vector<double> taken, recent;  ///< squared errors, by the iterations; by those of the present level alone
  double entering = 0.0;              ///< what entering the present level took off
  bool solved = false;                ///< exactly
  Points<Dim> answer;
  double answer_work = 0.0;  ///< u . K u of it

  Iterates(const Impl& of, const Beginning& from, const CorrectionOptions& given_options, End& to)
      : problem(of),
        forces(from.forces),
        start(from.start),
        options(given_options),
        end(to),
        f(of.condensation.reduced(from.forces)),
        u(from.u) {
    // Where nothing pulls nothing moves, whatever rounding there is in the start.
    if (!problem.supports.held(u).isZero(0.0)) return;
    Points<Dim> pulls = f;
    problem.supports.release(pulls);
    if (pulls.isZero(0.0)) u.setZero();
  }

  Points<Dim> with_all_nodes(Points<Dim> of) const {
    problem.condensation.follow(forces, of);
    return of;
  }
  void update_residual() {
    r = f - g;
    problem.supports.release(r);
  }
  /// q = r - q on what is free.
  void subtract_from_residual() {
    subtract_from<Dim>(r, q);
    problem.supports.release(q);
  }
  /// Of u . K u what is not in springs, or else holds the boundary weakly.
  double strained(double work, const Points<Dim>& of) const {
    if (problem.weak.matrix.size() == 0) return work;
    return work - 2.0 * problem.energy_held_weakly(with_all_nodes(of)(Eigen::all, problem.nodes.at));
  }

  // Linear elements do not hold the cloud's answer and are mostly nearer than it: begun with what is held alone all
  // iterates are in the spaces they are the best of, so that their energy is off by the square of their error. That of
  // quadratic functions may be nearer than they ever come: it is what there is, if its error is small enough, or else
  // is compared with them.

  /// Whether the given answer is to be judged, which needs pull_of_given.
  bool keep_given() {
    if (is_lifted(problem.approximation) || u.isZero(0.0)) return false;
    given = u;
    return true;
  }
  /// Puts the residual of the given answer into r, unless its strains are of the size of what rounding leaves of its
  /// motion: then it is dropped.
  bool begin_judging_given() {
    const double work = dot<Dim>(given, pull_of_given), bearable = options.tolerance * options.tolerance;
    if (bearable * work > std::numeric_limits<double>::epsilon() * problem.energy_one_by_one(given)) {
      g = pull_of_given;
      update_residual();
      return true;
    }
    given.resize(Dim, 0);
    return false;
  }
  /// With q what the coarse solution leaves of the residual, and z = M q.
  void judge_given() {
    off_given = std::max(0.0, off_given + dot<Dim>(q, z));
    const double work = dot<Dim>(given, pull_of_given), bearable = options.tolerance * options.tolerance;
    suffices = open && off_given < bearable * strained(work, given);
  }

  /// Once u is the best answer in the first space around where iterations begin.
  void begin() {
    one_by_one = problem.energy_one_by_one(u);
    scale = std::max(dot<Dim>(u, g), no_energy * one_by_one);
    update_residual();
    if (wanted == 0) take_answer();
  }
  void take_answer() {
    answer = u;
    answer_work = dot<Dim>(u, g);
    if (end.is_term) end.forces = g;
  }

  /// With z = M r and `rest` the coarse solution for r - K z: the next direction. Returns whether there is one: the
  /// first iterate that is exact up to rounding leaves none. Throws NumericalError.
  bool find_direction() {
    add<Dim>(z, 1.0, rest);
    if (own_stiffness > 0.0) add<Dim>(z, -dot<Dim>(pull, z) / own_stiffness, own);
    const double next = dot<Dim>(r, z);
    if (const double nothing = std::max(error_rounding * scale, no_step * one_by_one); !(next > nothing)) {
      if (!(next >= -nothing)) throw NumericalError("correction: the smoother is not positive definite");
      solved = true;
      return false;
    }
    if (recent.empty())
      p = z;
    else
      add_to_multiple<Dim>(z, next / rz, p);
    rz = next;
    return true;
  }
  /// Iterate k, with q = K p.
  void step(int k) {
    curvature = dot<Dim>(p, q);
    alpha = rz / curvature;
    if (!std::isfinite(alpha)) throw NumericalError("correction: the iterations broke down");
    add<Dim>(u, alpha, p);
    add<Dim>(g, alpha, q);
    add<Dim>(r, -alpha, q);
    problem.supports.release(r);
    recent.push_back(alpha * rz);
    taken.push_back(entering + recent.back());
    entering = 0.0;
    if (k == wanted) take_answer();
    if (k <= wanted) result.iterations = k;
  }
  /// Whether the iterate before the last one is within the tolerance.
  bool is_good() const { return recent.back() + error_left(recent) < options.tolerance * options.tolerance * scale; }
  /// Takes the iterate before k as the answer if it is good.
  bool take_if_good(int k) {
    if (!open || std::ssize(recent) < least || !is_good()) return false;
    const double work = dot<Dim>(u, g);
    scale = std::max(strained(work, u), no_energy * one_by_one);  // what is prescribed makes it fall on the way
    if (!is_good()) return false;
    result.iterations = k - delay;
    answer = u;
    add<Dim>(answer, -alpha, p);
    answer_work = work - 2.0 * alpha * dot<Dim>(p, g) + alpha * alpha * curvature;
    if (end.is_term) {
      end.forces = g;
      add<Dim>(end.forces, -alpha, q);
    }
    return true;
  }

  bool is_to_be_solved_directly(int k) const {
    return open && k == patience && static_cast<double>(problem.K.num_entries()) < few_entries<Dim>;
  }
  void solve_directly() {
    if (!problem.direct) problem.direct.emplace(held_matrix(problem.K, problem.supports), Dim);
    const Vector left = problem.direct->solve(r.reshaped());
    z = left.reshaped(Dim, problem.K.size());
    taken.push_back(dot<Dim>(r, z));
    u += z;
    ++result.iterations;
    solved = true;
  }

  /// Where dilatations are averaged hats lock as the cloud does.
  bool needs_hats(int k) const {
    return open && k >= probation && level == &problem.first && !level->is_of_elements && !problem.mean_dilatation &&
           hats_are_faster(recent, options.tolerance * options.tolerance * scale);
  }
  void enter_hats() {
    level = &problem.hats();
    keep_own();
    entering = move_to_best();
    recent.clear();
  }
  void keep_own() {
    own = u;
    problem.supports.release(own);
    problem.K.multiply(own, q);
    problem.supports.release(q);
    const double energy = dot<Dim>(own, q);
    own -= level->space->solve(q);
    problem.K.multiply(own, pull);
    problem.supports.release(pull);
    own_stiffness = dot<Dim>(own, pull);
    if (!(own_stiffness > dependent * energy)) own_stiffness = 0.0;
  }
  /// Makes u the best answer in the space of the level around it. Returns the squared error that takes off.
  double move_to_best() {
    update_residual();
    z = level->space->solve(r);
    double square = dot<Dim>(r, z);
    u += z;
    problem.K.multiply(u, g);
    update_residual();
    if (own_stiffness > 0.0) {
      const double factor = dot<Dim>(own, r) / own_stiffness;
      add<Dim>(u, factor, own);
      square += factor * factor * own_stiffness;
      problem.K.multiply(u, g);
      update_residual();
    }
    return square;
  }

  /// Squared error of the last iterate.
  double error_beyond() const {
    return suffices ? off_given : recent.empty() || solved ? 0.0 : std::max(0.0, error_left(recent));
  }
  /// Takes the last iterate as the answer if there is none, and what was given if that is nearer. Returns the squared
  /// error of the answer.
  double choose_answer() {
    const double beyond = error_beyond();
    if (answer.size() == 0) take_answer();
    double after = beyond;
    for (std::size_t k = result.iterations; k < taken.size(); ++k) after += taken[k];
    update_residual();
    if (given.size() == 0 || suffices) return after;
    // How much more potential energy there is in what was given than in the last iterate: half of what its squared
    // error is larger.
    const double more = dot<Dim>(given - u, pull_of_given - g) - 2.0 * dot<Dim>(given - u, r);
    if (!(more + beyond < after)) return after;
    answer = std::move(given);
    answer_work = dot<Dim>(answer, pull_of_given);
    if (end.is_term) end.forces = pull_of_given;
    result.iterations = 0;
    return std::min(after, std::max(off_given, more + beyond));
  }
  /// Fills the result: with all nodes in u and the answer, `off` = start - u and q = K off; `work` is u . K u of the
  /// nodes left, `after` the squared error of the answer. Throws NumericalError if it is not finite, or off by more
  /// than it may.
  void report(double work, double after, const Points<Dim>& off) {
    const Condensation<Dim>& condensation = problem.condensation;
    const double best_energy = result.whole =
        work + condensation.work(u, u) - 2.0 * problem.energy_held_weakly(u(Eigen::all, problem.nodes.at));
    const bool deformed = best_energy > no_energy * one_by_one;
    const auto relative = [&](double square) {
      return deformed ? std::sqrt(std::max(0.0, square) / best_energy) : 0.0;
    };
    if (end.is_term) end.off = q + g - end.forces;
    result.start_error =
        relative(dot<Dim>(off, q) + condensation.work(off, off) - 2.0 * dot<Dim>(off, r) + error_beyond());
    result.error = relative(after);
    result.strain_energy = 0.5 * (answer_work + condensation.work(answer, answer));
    for (const double one : taken) result.taken.push_back(one);
    for (double& one : result.taken) one = deformed ? one / best_energy : 0.0;
    result.displacement = answer(Eigen::all, problem.nodes.at);
    result.strain_energy -= problem.energy_held_weakly(result.displacement);
    if (!result.displacement.allFinite() || !std::isfinite(result.error) || !std::isfinite(result.start_error))
      throw NumericalError("correction: the solution is not finite");
    if (open && result.error > options.tolerance)
      throw NumericalError(
          fmt::format("correction: an error of {:.2g} is left after {} iterations, {:.2g} was asked for", result.error,
                      result.iterations, options.tolerance));
  }
};

template <int Dim> Iteration Corrector<Dim>::Impl::iterate(InStep<Dim>& in_step, const Beginning& from,
                                                           const CorrectionOptions& options, const Stage& stage,
                                                           End& end) const {
  Iterates at(*this, from, options, end);
  if (first.is_of_elements) {
    if (at.keep_given()) {
      co_await in_step.multiply(at.given, at.pull_of_given);
      if (at.begin_judging_given()) {
        co_await in_step.solve(*first.space, at.r, at.z);
        at.off_given = dot<Dim>(at.r, at.z);
        co_await in_step.multiply(at.z, at.q);
        at.subtract_from_residual();
        co_await in_step.smooth(first.degree, at.q, at.z);
        at.judge_given();
      }
    }
    if (!at.suffices) supports.keep_held(at.u);
  }
  // The best answer in the first space around it.
  if (at.u.isZero(0.0))
    at.g = Points<Dim>::Zero(Dim, at.u.cols());
  else if (!at.suffices)
    co_await in_step.multiply(at.u, at.g);
  if (at.start == at.u) at.of_start = at.g;
  at.update_residual();
  if (!at.suffices) {
    co_await in_step.solve(*first.space, at.r, at.z);
    at.result.taken.push_back(dot<Dim>(at.r, at.z));
    add<Dim>(at.u, 1.0, at.z);
    co_await in_step.multiply(at.z, at.q);
    add<Dim>(at.g, 1.0, at.q);
  }
  at.begin();
  for (int k = 1; !at.suffices && k <= at.last; ++k) {
    stage.check();
    co_await in_step.smooth(at.level->degree, at.r, at.z);
    co_await in_step.multiply(at.z, at.q);
    at.subtract_from_residual();
    co_await in_step.solve(*at.level->space, at.q, at.rest);
    if (!at.find_direction()) break;
    co_await in_step.multiply(at.p, at.q);
    at.step(k);
    if (at.take_if_good(k)) break;
    if (at.is_to_be_solved_directly(k)) {
      at.solve_directly();
      co_await in_step.multiply(at.u, at.g);
      break;
    }
    if (at.needs_hats(k)) at.enter_hats();
  }
  const double work = dot<Dim>(at.u, at.g), after = at.choose_answer();
  at.u = at.with_all_nodes(std::move(at.u));
  at.answer = at.with_all_nodes(std::move(at.answer));
  const Points<Dim> off = at.start - at.u;
  if (at.of_start.size() > 0)
    at.q = at.of_start - at.g;
  else
    co_await in_step.multiply(off, at.q);
  at.report(work, after, off);
}

template <int Dim> std::vector<DualSolution<Dim>> Corrector<Dim>::duals(const std::vector<Functional<Dim>>& functionals,
                                                                        const CorrectionOptions& options,
                                                                        const Monitor& monitor) const {
  const Stage stage("correction", monitor);
  std::vector<typename Impl::Beginning> from;
  for (const Functional<Dim>& functional : functionals) {
    Points<Dim> start = Points<Dim>::Zero(Dim, impl_->nodes.count);
    if (functional.motion.size() > 0) start = -impl_->at_nodes(functional.motion);
    from.push_back({impl_->forces_of(functional), start, start});
  }
  std::vector<DualSolution<Dim>> solutions;
  for (Correction<Dim>& z : impl_->iterate(from, options, stage))
    solutions.push_back({.displacement = std::move(z.displacement), .error = z.error, .iterations = z.iterations});
  return solutions;
}

template <int Dim> double Corrector<Dim>::value(const Functional<Dim>& functional, const Points<Dim>& z,
                                                const Points<Dim>& u, const Loads<Dim>& loads) const {
  const Impl& problem = *impl_;
  const Points<Dim> u_at = problem.at_nodes(u), z_at = problem.at_nodes(z);
  double value = dot<Dim>(problem.forces_of(functional), u_at) +
                 dot<Dim>(z_at, problem.loads(loads, problem.identity())) - problem.work(z_at, u_at);
  if (functional.weak_motion.size() > 0) value += dot<Dim>(problem.weak.rhs, problem.at_nodes(functional.weak_motion));
  return value;
}

template bool takes_mean_dilatation<2>(const Approximation<2>&, const ElasticModel&);
template bool takes_mean_dilatation<3>(const Approximation<3>&, const ElasticModel&);
template class Corrector<2>;
template class Corrector<3>;

}  // namespace efree
