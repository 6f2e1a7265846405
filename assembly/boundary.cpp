// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/boundary.hpp"

#include "efree/assembly/internal/gather.hpp"
#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <numeric>
#include <optional>

namespace efree {
namespace {

/// One point of the facet rule on one boundary facet.
template <int Dim> struct BoundaryPoint {
  Index facet;
  Index row;      ///< of SecondaryBasis::on_facets
  Vec<Dim> x, n;  ///< position, outward normal
  double weight;  ///< area of the body's surface that the point stands for
  std::span<const Index> dofs;
  typename FineSpace<Dim>::CellValues N;  ///< of dofs
};

template <int Dim, class Visit>
void for_each_point(const FineSpace<Dim>& space, const std::vector<Index>& facets, const Visit& visit) {
  const auto& rule = space.facet_rule();
  const Index per_facet = static_cast<Index>(rule.weights.size());
  for (Index f : facets) {
    const Vec<Dim> normal = space.mesh().facet_normal(f);
    const double measure = space.mesh().facet_measure(f);
    const Index c = space.mesh().facet_cell(f);
    for (Index g = 0; g < per_facet; ++g) {
      const auto at = space.facet_point(f, rule.points.col(g));
      const Vec<Dim> x = space.position(c, at);
      visit(BoundaryPoint<Dim>{f, f * per_facet + g, x, normal, measure * rule.weights[g] * space.measure(x),
                               space.cell(c), space.values(at)});
    }
  }
}

template <int Dim> std::string at(const Vec<Dim>& x) {
  return fmt::format("({:.6g})", fmt::join(x, ", "));
}

/// Value of a restraint, checked.
template <int Dim> double prescribed(const Restraint<Dim>& restraint, const Vec<Dim>& x) {
  const double value = restraint.value(x);
  if (!std::isfinite(value))
    throw InputError(
        fmt::format("displacement on \"{}\" is {} at {}, expected a finite number", restraint.on, value, at<Dim>(x)));
  return value;
}

/// Adds sum_v phi_I(v) fine_v to the nodes.
template <int Dim> Points<Dim> to_nodes(const ShapeTable<Dim>& shape, const Points<Dim>& fine) {
  Points<Dim> nodal = Points<Dim>::Zero(Dim, shape.num_nodes());
  for (Index v = 0; v < shape.num_points(); ++v) {
    if (fine.col(v).isZero(0.0)) continue;
    const auto row = shape.row(v);
    for (std::size_t k = 0; k < row.nodes.size(); ++k) nodal.col(row.nodes[k]) += row.N[k] * fine.col(v);
  }
  return nodal;
}

/// Sums blocks with equal keys; input in any order, output sorted by key.
template <class Key, class Block> void combine(std::vector<std::pair<Key, Block>>& entries) {
  std::stable_sort(entries.begin(), entries.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::size_t out = 0;
  for (std::size_t in = 0; in < entries.size(); ++in) {
    if (out > 0 && entries[out - 1].first == entries[in].first)
      entries[out - 1].second += entries[in].second;
    else
      entries[out++] = entries[in];
  }
  entries.resize(out);
}

/// The same while the blocks come, so that there are never many more than different keys near each other.
template <class Key, class Block> class Combiner {
 public:
  void add(const Key& key, const Block& block) {
    recent_.emplace_back(key, block);
    if (recent_.size() == most) settle();
  }
  /// All of them, sorted by key.
  std::vector<std::pair<Key, Block>> take() {
    settle();
    combine(settled_);
    return std::move(settled_);
  }

 private:
  static constexpr std::size_t most = 1 << 16;
  void settle() {
    combine(recent_);
    settled_.insert(settled_.end(), recent_.begin(), recent_.end());
    recent_.clear();
  }
  std::vector<std::pair<Key, Block>> recent_, settled_;
};

/// A point of the boundary where displacements are held to a value (one side) or to each other (two sides).
template <int Dim> struct Constraint {
  struct Side {
    BoundaryPoint<Dim> point;
    double sign;  ///< of its displacement in the jump
  };
  std::vector<Side> sides;
  Vec<Dim> n;           ///< outward normal of the first side
  Mat<Dim> directions;  ///< sum of d d^T over an orthonormal set of directions held
  Vec<Dim> value;       ///< displacement along them
  double weight() const { return sides.front().point.weight; }
};

/// Coordinates on `other` of the facet rule's points on f; the two facets have their vertices in the same places.
template <int Dim>
std::vector<Eigen::Matrix<double, Dim, 1>> points_on_twin(const FineSpace<Dim>& space, Index f, Index other) {
  const auto& mesh = space.mesh();
  std::vector<Eigen::Matrix<double, Dim, 1>> points;
  for (Index g = 0; g < space.facet_rule().weights.size(); ++g) {
    Eigen::Matrix<double, Dim, 1> at;
    for (int k = 0; k < Dim; ++k)
      for (int l = 0; l < Dim; ++l)
        if (mesh.vertex(mesh.facets()(k, other)) == mesh.vertex(mesh.facets()(l, f)))
          at[k] = space.facet_rule().points(l, g);
    points.push_back(at);
  }
  return points;
}

/// The restraints on each restrained facet: (facet, number of the restraint), ascending.
template <int Dim> std::vector<std::pair<Index, std::size_t>> by_facet(const FineMesh<Dim>& mesh,
                                                                       const std::vector<Restraint<Dim>>& restraints) {
  std::vector<std::pair<Index, std::size_t>> pairs;
  for (std::size_t r = 0; r < restraints.size(); ++r)
    for (const Index f : mesh.group(restraints[r].on)) pairs.emplace_back(f, r);
  std::ranges::sort(pairs);
  return pairs;
}

/// The displacement that conditions d_k . u = g_k prescribe: a frame whose first `rank` columns span the directions,
/// and u in that span.
template <int Dim> struct Held {
  Mat<Dim> frame;
  int rank;
  Vec<Dim> value;
};
/// Nothing if the conditions contradict each other.
template <int Dim>
std::optional<Held<Dim>> held_by(const std::vector<Vec<Dim>>& directions, const std::vector<double>& values) {
  const Index count = static_cast<Index>(values.size());
  Eigen::Matrix<double, Dim, Eigen::Dynamic> d(Dim, count);
  for (Index k = 0; k < count; ++k) d.col(k) = directions[k];
  const Vector g = Eigen::Map<const Vector>(values.data(), count);
  const Eigen::SelfAdjointEigenSolver<Mat<Dim>> eigen(d * d.transpose());
  Held<Dim> held{eigen.eigenvectors().rowwise().reverse(), 0, Vec<Dim>::Zero()};
  const Vec<Dim> strength = eigen.eigenvalues().reverse();
  held.rank = static_cast<int>((strength.array() > 1e-12 * strength[0]).count());
  Vec<Dim> fixed = held.frame.transpose() * (d * g);
  for (int i = 0; i < Dim; ++i) fixed[i] = i < held.rank ? fixed[i] / strength[i] : 0.0;
  held.value = held.frame * fixed;
  if ((d.transpose() * held.value - g).norm() > 1e-9 * (g.norm() + 1e-300)) return std::nullopt;
  return held;
}

/// Degrees of freedom on a part with the normals of the facets they are on, ascending.
template <int Dim>
std::vector<std::pair<Index, Vec<Dim>>> normals_on(const FineSpace<Dim>& space, const std::string& part) {
  std::vector<std::pair<Index, Vec<Dim>>> normals;
  for (const Index f : space.mesh().group(part)) {
    const Vec<Dim> n = space.mesh().facet_normal(f);
    for (const Index dof : space.facet(f)) normals.emplace_back(dof, n);
  }
  std::ranges::stable_sort(normals, {}, &std::pair<Index, Vec<Dim>>::first);
  return normals;
}
/// The first of them at which the part is not flat.
template <int Dim> std::optional<Index> curved_at(const std::vector<std::pair<Index, Vec<Dim>>>& normals) {
  for (std::size_t k = 1; k < normals.size(); ++k)
    if (normals[k].first == normals[k - 1].first && (normals[k].second - normals[k - 1].second).norm() > 1e-6)
      return normals[k].first;
  return std::nullopt;
}

[[noreturn]] void contradict(const std::vector<std::string>& parts, const std::string& place) {
  std::vector<std::string> once;
  for (const std::string& part : parts)
    if (std::ranges::find(once, part) == once.end()) once.push_back(part);
  throw InputError(fmt::format("displacements prescribed on \"{}\" contradict each other at {}",
                               fmt::join(once, "\" and \""), place));
}

/// What all restraints on a facet hold at one of its points, every direction once however many prescribe it.
template <int Dim>
Constraint<Dim> constraint_at(const BoundaryPoint<Dim>& point, const std::vector<const Restraint<Dim>*>& restraints) {
  Constraint<Dim> result{{{point, 1.0}}, point.n, Mat<Dim>::Zero(), Vec<Dim>::Zero()};
  std::vector<Vec<Dim>> directions;
  std::vector<double> values;
  bool orthogonal = true;
  for (const Restraint<Dim>* restraint : restraints) {
    const Vec<Dim> d = restraint->direction(point.n);
    for (const Vec<Dim>& other : directions) orthogonal = orthogonal && d.dot(other) == 0.0;
    directions.push_back(d);
    values.push_back(prescribed(*restraint, point.x));
  }
  if (orthogonal) {
    for (std::size_t k = 0; k < values.size(); ++k) {
      result.directions += directions[k] * directions[k].transpose();
      result.value += values[k] * directions[k];
    }
    return result;
  }
  const auto held = held_by<Dim>(directions, values);
  if (!held) {
    std::vector<std::string> parts;
    for (const Restraint<Dim>* restraint : restraints) parts.push_back(restraint->on);
    contradict(parts, at<Dim>(point.x));
  }
  const auto span = held->frame.leftCols(held->rank);
  result.directions = span * span.transpose();
  result.value = held->value;
  return result;
}

/// Visits the constraints of all restraints, then those of the ties, always in the same order.
template <int Dim, class Visit> void for_each_constraint(const FineSpace<Dim>& space,
                                                         const std::vector<Restraint<Dim>>& restraints,
                                                         const std::vector<TiedFacets>& ties, const Visit& visit) {
  const auto pairs = by_facet(space.mesh(), restraints);
  for (std::size_t s = 0; s < pairs.size();) {
    const Index f = pairs[s].first;
    std::vector<const Restraint<Dim>*> on_facet;
    for (; s < pairs.size() && pairs[s].first == f; ++s) on_facet.push_back(&restraints[pairs[s].second]);
    for_each_point<Dim>(space, {f}, [&](const BoundaryPoint<Dim>& point) { visit(constraint_at(point, on_facet)); });
  }
  for (const auto& [f, other] : ties) {
    const auto twins = points_on_twin(space, f, other);
    const Index per_facet = static_cast<Index>(twins.size());
    const Index c = space.mesh().facet_cell(other);
    Index g = 0;
    for_each_point<Dim>(space, {f}, [&](const BoundaryPoint<Dim>& point) {
      BoundaryPoint<Dim> twin = point;
      twin.facet = other;
      // Phi_K of the far side at the rule point nearest to this one: the rule is symmetric, so it is the same place.
      Index row = 0;
      for (Index q = 0; q < per_facet; ++q)
        if ((space.facet_rule().points.col(q) - twins[g]).squaredNorm() <
            (space.facet_rule().points.col(row) - twins[g]).squaredNorm())
          row = q;
      twin.row = other * per_facet + row;
      twin.n = -point.n;
      twin.dofs = space.cell(c);
      twin.N = space.values(space.facet_point(other, twins[g]));
      visit(Constraint<Dim>{{{point, 1.0}, {twin, -1.0}}, point.n, Mat<Dim>::Identity(), Vec<Dim>::Zero()});
      ++g;
    });
  }
}

/// Whether all stress of a term is pressure: the volumetric part of a split stiffness.
bool is_pressure(const Lame& lame) {
  return lame.mu == 0.0;
}

/// beta_K of one term at all its quadrature points; zero away from the constraints, and for pressures, which
/// `consistency` holds by their own means.
template <int Dim> std::vector<double> penalties(const FineSpace<Dim>& space, const StiffnessTerm<Dim>& term,
                                                 const std::vector<Restraint<Dim>>& restraints,
                                                 const std::vector<TiedFacets>& ties) {
  const auto& discretization = *term.discretization;
  std::vector<double> measure(discretization.size(), 0.0);
  for_each_constraint(space, restraints, ties, [&](const Constraint<Dim>& constraint) {
    // Once for every direction held: more than the inequality asks for where all are.
    const double times = constraint.sides.size() == 1 ? std::round(constraint.directions.trace()) : 1.0;
    for (const auto& [point, sign] : constraint.sides)
      for (SparseRows::InnerIterator phi(discretization.on_facets, point.row); phi; ++phi)
        measure[phi.col()] += times * std::abs(point.weight * phi.value());
  });
  for (std::size_t K = 0; K < measure.size(); ++K) {
    // Largest (sigma n . d)^2 / (sigma : eps) of the term: lambda + 2 mu, at least what shear alone needs.
    const Lame& lame = term.lame[discretization.region[K]];
    const double normal = is_pressure(lame) ? 0.0 : std::max(lame.lambda + 2.0 * lame.mu, 2.0 * lame.mu);
    measure[K] *= 4.0 * normal / discretization.weights[static_cast<Index>(K)];
  }
  return measure;
}

/// beta at a boundary point: the sum over the terms.
template <int Dim> double penalty_at(const std::vector<StiffnessTerm<Dim>>& terms,
                                     const std::vector<std::vector<double>>& penalty, const BoundaryPoint<Dim>& point) {
  double beta = 0.0;
  for (std::size_t t = 0; t < terms.size(); ++t)
    for (SparseRows::InnerIterator phi(terms[t].discretization->on_facets, point.row); phi; ++phi)
      beta += std::abs(phi.value()) * penalty[t][phi.col()];
  return beta;
}

/// Share of each side in the flux, and the penalty of the constraint.
struct Shares {
  std::array<double, 2> flux;
  double beta;
};
template <int Dim> Shares shares(const std::vector<StiffnessTerm<Dim>>& terms,
                                 const std::vector<std::vector<double>>& penalty, const Constraint<Dim>& constraint) {
  const double first = penalty_at(terms, penalty, constraint.sides[0].point);
  if (constraint.sides.size() == 1) return {{1.0, 0.0}, first};
  const double second = penalty_at(terms, penalty, constraint.sides[1].point);
  return {{second / (first + second), first / (first + second)}, first * second / (first + second)};
}

/// -int (flux of u).[v] and its transpose, for one term of the stiffness; what belongs on the right goes to rhs. The
/// pressure lambda theta_K of a K sees of v only the volume J_K(v) = int Phi_K [v].n that crosses the boundary, so that
/// the penalty 4 lambda / w_K J_K(u) J_K(v) is enough for it. Held point by point, with a modulus that grows beyond all
/// bounds towards nu = 1/2, functions that are not interpolatory would lock.
template <int Dim, int Normals> SymmetricMatrix consistency(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                                            const std::vector<StiffnessTerm<Dim>>& terms,
                                                            const std::vector<std::vector<double>>& penalty,
                                                            const std::vector<Restraint<Dim>>& restraints,
                                                            const std::vector<TiedFacets>& ties,
                                                            const StiffnessTerm<Dim>& term, Points<Dim>& rhs) {
  using Strains = Voigt<Dim, Normals>;
  using Block = Eigen::Matrix<double, Dim, voigt_size<Dim, Normals>>;
  Combiner<std::pair<Index, Index>, Block> all_jumps;  // (K, fine v): int Phi_K eta_v sum_d d (B(n) d)^T
  Combiner<Index, Strains> all_values;                 // K: int Phi_K sum_d g B(n) d
  for_each_constraint(space, restraints, ties, [&](const Constraint<Dim>& constraint) {
    const Block normal = strain_matrix<Dim, Normals>(constraint.n).transpose();
    const Block block = constraint.directions * normal;
    const Shares share = shares(terms, penalty, constraint);
    for (std::size_t s = 0; s < constraint.sides.size(); ++s)
      for (SparseRows::InnerIterator phi(term.discretization->on_facets, constraint.sides[s].point.row); phi; ++phi) {
        const double factor = constraint.weight() * share.flux[s] * phi.value();
        all_values.add(phi.col(), factor * (normal.transpose() * constraint.value));
        for (const auto& [point, sign] : constraint.sides)
          for (std::size_t i = 0; i < point.dofs.size(); ++i)
            if (point.N[i] != 0.0)
              all_jumps.add(std::pair(phi.col(), point.dofs[i]), sign * factor * point.N[i] * block);
      }
  });
  const auto jumps = all_jumps.take();
  const auto values = all_values.take();

  std::vector<VoigtMatrix<Dim, Normals>> C;
  for (const Lame& lame : term.lame) C.push_back(stiffness<Dim, Normals>(lame));
  const auto& discretization = *term.discretization;
  for (const auto& [K, q] : values) {
    const auto row = discretization.shape.row(K);
    for (std::size_t k = 0; k < row.nodes.size(); ++k)
      rhs.col(row.nodes[k]) -= (C[discretization.region[K]] * strain_matrix<Dim, Normals>(row, k)).transpose() * q;
  }

  // One row for each K on the boundary: the nodes whose stress or whose jump it sees.
  struct Entry {
    Block jump = Block::Zero();  // int Phi_K phi_a sum_d d (B(n) d)^T
    Block flux = Block::Zero();  // (C B_a)^T
  };
  Ragged<Index> nodes;
  std::vector<Entry> entries;
  Accumulator<Block> nodal(shape.num_nodes());
  Strains trace = Strains::Zero();
  trace.template head<Normals>().setOnes();
  auto value = values.begin();
  for (std::size_t s = 0; s < jumps.size();) {
    const Index K = jumps[s].first.first;
    while (value->first != K) ++value;
    const Lame& lame = term.lame[discretization.region[K]];
    const double penalty_of_pressure = is_pressure(lame) ? 4.0 * lame.lambda / discretization.weights[K] : 0.0;
    nodal.clear();
    for (; s < jumps.size() && jumps[s].first.first == K; ++s) {
      const auto row = shape.row(jumps[s].first.second);
      for (std::size_t k = 0; k < row.nodes.size(); ++k) nodal[row.nodes[k]] += row.N[k] * jumps[s].second;
    }
    const auto row = discretization.shape.row(K);
    for (Index node : row.nodes) nodal[node];  // those that only the stress sees
    std::size_t k = 0;
    for (Index node : nodal.sorted()) {
      Entry entry{nodal[node]};
      if (k < row.nodes.size() && row.nodes[k] == node)
        entry.flux = (C[discretization.region[K]] * strain_matrix<Dim, Normals>(row, k++)).transpose();
      if (penalty_of_pressure > 0.0) {
        const Vec<Dim> crossing = entry.jump * trace;
        entry.flux -= 0.5 * penalty_of_pressure * crossing * trace.transpose();  // half of it from each of the two
        rhs.col(node) += penalty_of_pressure * trace.dot(value->second) * crossing;
      }
      nodes.items.push_back(node);
      entries.push_back(entry);
    }
    nodes.close_row();
  }
  const auto by_node = places_of_nodes(shape.num_nodes(), nodes.rows(), [&](Index row) { return nodes[row]; });
  return gather_blocks<Dim>(shape.num_nodes(), [&](Index a, Accumulator<Mat<Dim>>& sums) {
    for (const auto& [row, k] : by_node[a]) {
      const auto row_nodes = nodes[row];
      const Entry* of_row = entries.data() + nodes.offsets[row];
      for (std::size_t l = k; l < row_nodes.size(); ++l)
        sums[row_nodes[l]].noalias() -=
            of_row[l].jump * of_row[k].flux.transpose() + of_row[l].flux * of_row[k].jump.transpose();
    }
  });
}

/// int beta [u].[v] along the directions held.
template <int Dim> SymmetricMatrix penalty_matrix(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                                  const std::vector<StiffnessTerm<Dim>>& terms,
                                                  const std::vector<std::vector<double>>& penalty,
                                                  const std::vector<Restraint<Dim>>& restraints,
                                                  const std::vector<TiedFacets>& ties, Points<Dim>& rhs) {
  Combiner<std::pair<Index, Index>, Mat<Dim>> all;
  Points<Dim> fine_rhs = Points<Dim>::Zero(Dim, space.size());
  for_each_constraint(space, restraints, ties, [&](const Constraint<Dim>& constraint) {
    const double factor = constraint.weight() * shares(terms, penalty, constraint).beta;
    for (const auto& [at, sign] : constraint.sides)
      for (std::size_t i = 0; i < at.dofs.size(); ++i) {
        if (at.N[i] == 0.0) continue;
        fine_rhs.col(at.dofs[i]) += sign * factor * at.N[i] * constraint.value;
        for (const auto& [other, other_sign] : constraint.sides)
          for (std::size_t j = 0; j < other.dofs.size(); ++j)
            if (other.N[j] != 0.0)
              all.add(std::pair(at.dofs[i], other.dofs[j]),
                      (sign * other_sign * factor * at.N[i] * other.N[j]) * constraint.directions);
      }
  });
  const auto fine = all.take();
  rhs += to_nodes(shape, fine_rhs);

  // One row for each fine v on the boundary: its nodes against the sum over its neighbours w there.
  std::vector<Index> vertices;
  Ragged<Index> columns;
  std::vector<Mat<Dim>> sums_over_neighbours;
  Accumulator<Mat<Dim>> nodal(shape.num_nodes());
  for (std::size_t s = 0; s < fine.size();) {
    const Index v = fine[s].first.first;
    nodal.clear();
    for (; s < fine.size() && fine[s].first.first == v; ++s) {
      const auto row = shape.row(fine[s].first.second);
      for (std::size_t k = 0; k < row.nodes.size(); ++k) nodal[row.nodes[k]] += row.N[k] * fine[s].second;
    }
    vertices.push_back(v);
    for (Index node : nodal.sorted()) columns.items.push_back(node), sums_over_neighbours.push_back(nodal[node]);
    columns.close_row();
  }
  const auto by_node = places_of_nodes(shape.num_nodes(), static_cast<Index>(vertices.size()),
                                       [&](Index row) { return shape.row(vertices[row]).nodes; });
  return gather_blocks<Dim>(shape.num_nodes(), [&](Index a, Accumulator<Mat<Dim>>& sums) {
    for (const auto& [row, k] : by_node[a]) {
      const double N = shape.row(vertices[row]).N[k];
      const auto others = columns[row];
      const auto first = std::lower_bound(others.begin(), others.end(), a) - others.begin();
      for (std::size_t l = first; l < others.size(); ++l)
        sums[others[l]] += N * sums_over_neighbours[columns.offsets[row] + l].transpose();
    }
  });
}

/// Rigid motions of Dim dimensions: translations along the axes, then rotations about them (one in the plane).
template <int Dim> constexpr int rigid_motions = Dim*(Dim + 1) / 2;
template <int Dim> using Motion = Eigen::Matrix<double, rigid_motions<Dim>, 1>;

/// Displacement along d, at `arm` from the centre, of each rigid motion; rotations by 1/radius.
template <int Dim> Motion<Dim> motion_along(const Vec<Dim>& d, const Vec<Dim>& arm, double radius) {
  Motion<Dim> motion;
  motion.template head<Dim>() = d;
  if constexpr (Dim == 2)
    motion[2] = (arm.x() * d.y() - arm.y() * d.x()) / radius;
  else
    motion.template tail<3>() = arm.cross(d) / radius;
  return motion;
}

/// Names of motions that span the columns of `free` (orthonormal): translations along axes first, then the rest.
template <int Dim> std::vector<std::string> motion_names(const Matrix& free, const Vec<Dim>& centre, double radius) {
  std::vector<std::string> names;
  const auto is_free = [&](const Motion<Dim>& motion) {
    return free.cols() > 0 && (motion - free * (free.transpose() * motion)).norm() < 1e-4 * motion.norm();
  };
  Matrix rest = free;  // the named translations are taken out
  const char* axes = "xyz";
  for (int i = 0; i < Dim; ++i)
    if (is_free(Motion<Dim>::Unit(i))) {
      names.push_back(fmt::format("translation along {}", axes[i]));
      rest.row(i).setZero();
    }
  if (Dim == 2 && free.cols() == rigid_motions<Dim>) return {names[0], names[1], "rotation"};
  if (Dim == 3)
    for (int i = 0; i < 3; ++i)
      if (is_free(Motion<Dim>::Unit(Dim + i))) {
        names.push_back(fmt::format("rotation about an axis along {}", axes[i]));
        rest.row(Dim + i).setZero();
      }
  const Index missing = free.cols() - static_cast<Index>(names.size());
  if (missing <= 0) return names;
  // What is left has no axis of its own: the dominant motions of the remainder.
  const Eigen::SelfAdjointEigenSolver<Matrix> eigen(rest * rest.transpose());
  for (Index k = 0; k < missing; ++k) {
    const Motion<Dim> motion = eigen.eigenvectors().col(rigid_motions<Dim> - 1 - k);
    const Vec<Dim> shift = motion.template head<Dim>();
    const auto spin = motion.template tail<rigid_motions<Dim> - Dim>().eval();
    if (spin.norm() <= 1e-6) {
      names.push_back(fmt::format("translation along ({:.4g})", fmt::join(shift.normalized(), ", ")));
    } else if constexpr (Dim == 2) {
      const double rate = spin[0] / radius;
      names.push_back(
          fmt::format("rotation about ({:.4g}, {:.4g})", centre[0] - shift[1] / rate, centre[1] + shift[0] / rate));
    } else {
      const Vec<3> rate = spin / radius, at = centre + rate.cross(shift) / rate.squaredNorm();
      names.push_back(fmt::format("rotation about the axis through ({:.4g}) along ({:.4g})", fmt::join(at, ", "),
                                  fmt::join(rate.normalized(), ", ")));
    }
  }
  return names;
}

/// Number of the body each component of the mesh belongs to, tied ones together, counted from 0.
template <int Dim> std::vector<Index> tied_bodies(const FineMesh<Dim>& mesh, const std::vector<TiedFacets>& ties) {
  std::vector<Index> parent(mesh.num_components());
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&](Index c) {
    while (parent[c] != c) c = parent[c] = parent[parent[c]];
    return c;
  };
  for (const auto& [f, other] : ties) {
    const Index a = root(mesh.component()[mesh.facets()(0, f)]), b = root(mesh.component()[mesh.facets()(0, other)]);
    parent[std::max(a, b)] = std::min(a, b);
  }
  std::vector<Index> number(mesh.num_components(), -1), body;
  Index count = 0;
  for (Index c = 0; c < mesh.num_components(); ++c) {
    Index& of_root = number[root(c)];
    if (of_root < 0) of_root = count++;
    body.push_back(of_root);
  }
  return body;
}

}  // namespace

template <int Dim> std::vector<Restraint<Dim>> restraints(const std::vector<DisplacementCondition<Dim>>& conditions) {
  std::vector<Restraint<Dim>> list;
  for (const auto& condition : conditions) {
    const std::size_t before = list.size();
    for (int i = 0; i < Dim; ++i)
      if (condition.components[i]) list.push_back({condition.on, i, condition.components[i]});
    if (condition.normal && list.size() > before)
      throw InputError(
          fmt::format("displacement on \"{}\": give components or the normal one, not both", condition.on));
    if (condition.normal) list.push_back({condition.on, -1, condition.normal});
    if (list.size() == before) throw InputError(fmt::format("displacement on \"{}\" prescribes nothing", condition.on));
  }
  return list;
}

template <int Dim> Bodies<Dim> find_bodies(const FineSpace<Dim>& space, const std::vector<Restraint<Dim>>& restraints,
                                           const std::vector<TiedFacets>& ties) {
  const FineMesh<Dim>& mesh = space.mesh();
  Bodies<Dim> bodies;
  bodies.of_component = tied_bodies(mesh, ties);
  const Index count = 1 + *std::ranges::max_element(bodies.of_component);
  const auto body_at = [&](Index v) { return bodies.of_component[mesh.component()[v]]; };
  // Centre and radius of gyration of each body, so that translations and rotations weigh alike.
  Vector& volume = bodies.volumes;
  Points<Dim>& centre = bodies.centres;
  volume.setZero(count);
  centre.setZero(Dim, count);
  Vector polar = Vector::Zero(count);
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    const Index body = body_at(mesh.cells()(0, c));
    volume[body] += mesh.volume(c);
    centre.col(body) += mesh.volume(c) * mesh.centroid(c);
  }
  for (Index body = 0; body < count; ++body) centre.col(body) /= volume[body];
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    const Index body = body_at(mesh.cells()(0, c));
    double square = (mesh.centroid(c) - centre.col(body)).squaredNorm();
    for (int i = 0; i <= Dim; ++i)  // so that a single cell has a radius, too
      square += (mesh.vertex(mesh.cells()(i, c)) - mesh.centroid(c)).squaredNorm() / ((Dim + 1) * (Dim + 2));
    polar[body] += mesh.volume(c) * square;
  }
  const auto radius = [&](Index body) { return std::sqrt(polar[body] / volume[body]); };
  using Gram = Eigen::Matrix<double, rigid_motions<Dim>, rigid_motions<Dim>>;
  std::vector<Gram> gram(count, Gram::Zero());
  std::vector<double> held(count, 0.0);
  for (const auto& restraint : restraints)
    for_each_point<Dim>(space, mesh.group(restraint.on), [&](const BoundaryPoint<Dim>& point) {
      const Index body = body_at(mesh.facets()(0, point.facet));
      const Motion<Dim> motion =
          motion_along<Dim>(restraint.direction(point.n), point.x - centre.col(body), radius(body));
      gram[body] += point.weight * motion * motion.transpose();
      held[body] += point.weight;
    });

  bodies.free_motions.resize(count);
  for (Index body = 0; body < count; ++body) {
    if (space.axisymmetric()) {
      // Hoops resist every motion but the one along the axis.
      const double along_axis = gram[body](1, 1);
      gram[body] = std::max(held[body], 1e-300) * Gram::Identity();
      gram[body](1, 1) = along_axis;
    }
    const Eigen::SelfAdjointEigenSolver<Gram> eigen(gram[body]);
    const double scale = std::max(eigen.eigenvalues().maxCoeff(), 1e-300);
    const int nullity = static_cast<int>((eigen.eigenvalues().array() < 1e-10 * scale).count());
    if (nullity == 0) continue;
    bodies.free_motions[body] =
        space.axisymmetric()
            ? std::vector<std::string>{"translation along the axis of revolution, y"}
            : motion_names<Dim>(eigen.eigenvectors().leftCols(nullity), centre.col(body), radius(body));
  }
  return bodies;
}

template <int Dim> void require_restrained(const FineSpace<Dim>& space, const std::vector<Restraint<Dim>>& restraints,
                                           const std::vector<TiedFacets>& ties) {
  constexpr std::size_t most_named = 5;
  const Bodies<Dim> bodies = find_bodies(space, restraints, ties);
  std::vector<Index> free;
  for (Index body = 0; body < bodies.size(); ++body)
    if (bodies.is_free(body)) free.push_back(body);
  if (free.empty()) return;
  if (free.size() > most_named)
    std::ranges::stable_sort(free, std::greater<>{}, [&](Index body) { return bodies.volumes[body]; });
  std::vector<std::string> named;
  for (std::size_t k = 0; k < std::min(free.size(), most_named); ++k) {
    const std::string motions = fmt::format("{}", fmt::join(bodies.free_motions[free[k]], ", "));
    named.push_back(bodies.size() == 1 ? motions
                                       : fmt::format("body around ({:.4g}): {}",
                                                     fmt::join(bodies.centres.col(free[k]), ", "), motions));
  }
  if (free.size() > most_named) named.push_back(fmt::format("and {} smaller bodies", free.size() - most_named));
  throw InputError(
      fmt::format("underconstrained: free to move ({}); prescribe displacements that hold it", fmt::join(named, "; ")));
}

template <int Dim>
Points<Dim> load_vector(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape, const Loads<Dim>& loads) {
  Points<Dim> fine = Points<Dim>::Zero(Dim, space.size());
  for (const auto& load : loads.tractions)
    for_each_point<Dim>(space, space.mesh().group(load.on), [&](const BoundaryPoint<Dim>& point) {
      const Vec<Dim> t = load.traction(point.x, point.n);
      if (!t.allFinite())
        throw InputError(fmt::format("traction on \"{}\" is {} at {}, expected finite numbers", load.on, at<Dim>(t),
                                     at<Dim>(point.x)));
      for (std::size_t i = 0; i < point.dofs.size(); ++i) fine.col(point.dofs[i]) += point.weight * point.N[i] * t;
    });
  if (loads.body_force) {
    const auto rule = simplex_rule<Dim>(4);
    for (Index c = 0; c < space.mesh().num_cells(); ++c)
      for (Index q = 0; q < rule.weights.size(); ++q) {
        const Vec<Dim> x = space.position(c, rule.points.col(q)), b = loads.body_force(x);
        if (!b.allFinite())
          throw InputError(fmt::format("body force is {} at {}, expected finite numbers", at<Dim>(b), at<Dim>(x)));
        const auto N = space.values(rule.points.col(q));
        const auto dofs = space.cell(c);
        for (std::size_t i = 0; i < dofs.size(); ++i)
          fine.col(dofs[i]) += space.mesh().volume(c) * rule.weights[q] * space.measure(x) * N[i] * b;
      }
  }
  return to_nodes(shape, fine);
}

template <int Dim> NitscheSystem<Dim> nitsche(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                              const std::vector<StiffnessTerm<Dim>>& terms,
                                              const std::vector<Restraint<Dim>>& restraints,
                                              const std::vector<TiedFacets>& ties) {
  Points<Dim> rhs = Points<Dim>::Zero(Dim, shape.num_nodes());
  std::vector<std::vector<double>> penalty;
  for (const auto& term : terms) penalty.push_back(penalties(space, term, restraints, ties));
  NitscheSystem<Dim> system;
  system.matrix = penalty_matrix(space, shape, terms, penalty, restraints, ties, rhs);
  for (const auto& term : terms)
    with_normals<Dim>(space.axisymmetric(), [&]<int Normals>(Number<Normals>) {
      system.matrix += consistency<Dim, Normals>(space, shape, terms, penalty, restraints, ties, term, rhs);
    });
  system.rhs = rhs.reshaped();
  return system;
}

template <int Dim> bool can_be_nodal(const FineSpace<Dim>& space, const Restraint<Dim>& restraint) {
  return restraint.component >= 0 || !curved_at<Dim>(normals_on(space, restraint.on)).has_value();
}

template <int Dim> NodalConditions<Dim> nodal_conditions(const FineSpace<Dim>& space, const std::vector<Index>& node_at,
                                                         const std::vector<Restraint<Dim>>& restraints) {
  struct Condition {
    Index dof;
    std::vector<Vec<Dim>> directions;
    std::vector<double> values;
    std::vector<std::string> parts;
  };
  std::map<Index, Condition> by_node;
  for (const auto& restraint : restraints) {
    const auto normals = normals_on(space, restraint.on);
    if (restraint.component < 0)
      if (const auto dof = curved_at<Dim>(normals))
        throw InputError(
            fmt::format("normal displacement on \"{}\" cannot be set strongly: the part is not flat at {}; use "
                        "essential = \"nitsche\"",
                        restraint.on, at<Dim>(space.points().col(*dof))));
    for (std::size_t k = 0; k < normals.size(); ++k) {
      const auto& [dof, n] = normals[k];
      if (node_at[dof] < 0 || (k > 0 && normals[k - 1].first == dof)) continue;
      Condition& condition = by_node.try_emplace(node_at[dof], Condition{dof, {}, {}, {}}).first->second;
      condition.directions.push_back(restraint.direction(n));
      condition.values.push_back(prescribed(restraint, Vec<Dim>(space.points().col(dof))));
      condition.parts.push_back(restraint.on);
    }
  }

  NodalConditions<Dim> result;
  for (const auto& [I, condition] : by_node) {
    auto held = held_by<Dim>(condition.directions, condition.values);
    if (!held) contradict(condition.parts, at<Dim>(space.points().col(condition.dof)));
    if (held->rank == Dim) held->frame.setIdentity();
    result.nodes.push_back(I);
    result.frames.push_back(held->frame);
    result.fixed.push_back(held->rank);
    result.values.push_back(held->frame.transpose() * held->value);
  }
  return result;
}

template <int Dim> NodalConditions<Dim> nodal_conditions(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                                         const std::vector<Index>& node_dofs,
                                                         const std::vector<Restraint<Dim>>& restraints) {
  std::vector<Index> node_at(space.size(), -1);
  for (std::size_t I = 0; I < node_dofs.size(); ++I) node_at[node_dofs[I]] = static_cast<Index>(I);
  std::vector<char> on_part(space.size());
  for (const auto& restraint : restraints) {
    const auto normals = normals_on(space, restraint.on);
    std::ranges::fill(on_part, 0);
    for (const auto& [dof, n] : normals) on_part[dof] = 1;
    for (const auto& [dof, n] : normals)
      for (Index I : shape.row(dof).nodes)
        if (!on_part[node_dofs[I]])
          throw InputError(fmt::format(
              "displacement on \"{}\" cannot be set strongly: the function of the node at {} does not vanish at {}; "
              "build the basis with vanish_on = \"{}\", or use essential = \"nitsche\"",
              restraint.on, at<Dim>(space.points().col(node_dofs[I])), at<Dim>(space.points().col(dof)), restraint.on));
  }
  return nodal_conditions(space, node_at, restraints);
}

template std::vector<Restraint<2>> restraints<2>(const std::vector<DisplacementCondition<2>>&);
template Bodies<2> find_bodies<2>(const FineSpace<2>&, const std::vector<Restraint<2>>&,
                                  const std::vector<TiedFacets>&);
template void require_restrained<2>(const FineSpace<2>&, const std::vector<Restraint<2>>&,
                                    const std::vector<TiedFacets>&);
template Points<2> load_vector<2>(const FineSpace<2>&, const ShapeTable<2>&, const Loads<2>&);
template NitscheSystem<2> nitsche<2>(const FineSpace<2>&, const ShapeTable<2>&, const std::vector<StiffnessTerm<2>>&,
                                     const std::vector<Restraint<2>>&, const std::vector<TiedFacets>&);
template bool can_be_nodal<2>(const FineSpace<2>&, const Restraint<2>&);
template NodalConditions<2> nodal_conditions<2>(const FineSpace<2>&, const std::vector<Index>&,
                                                const std::vector<Restraint<2>>&);
template NodalConditions<2> nodal_conditions<2>(const FineSpace<2>&, const ShapeTable<2>&, const std::vector<Index>&,
                                                const std::vector<Restraint<2>>&);
template std::vector<Restraint<3>> restraints<3>(const std::vector<DisplacementCondition<3>>&);
template Bodies<3> find_bodies<3>(const FineSpace<3>&, const std::vector<Restraint<3>>&,
                                  const std::vector<TiedFacets>&);
template void require_restrained<3>(const FineSpace<3>&, const std::vector<Restraint<3>>&,
                                    const std::vector<TiedFacets>&);
template Points<3> load_vector<3>(const FineSpace<3>&, const ShapeTable<3>&, const Loads<3>&);
template NitscheSystem<3> nitsche<3>(const FineSpace<3>&, const ShapeTable<3>&, const std::vector<StiffnessTerm<3>>&,
                                     const std::vector<Restraint<3>>&, const std::vector<TiedFacets>&);
template bool can_be_nodal<3>(const FineSpace<3>&, const Restraint<3>&);
template NodalConditions<3> nodal_conditions<3>(const FineSpace<3>&, const std::vector<Index>&,
                                                const std::vector<Restraint<3>>&);
template NodalConditions<3> nodal_conditions<3>(const FineSpace<3>&, const ShapeTable<3>&, const std::vector<Index>&,
                                                const std::vector<Restraint<3>>&);

}  // namespace efree
