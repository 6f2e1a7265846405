// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/boundary.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <map>

namespace efree {
namespace {

/// One point of the facet rule on one boundary facet.
template <int Dim> struct BoundaryPoint {
  Index facet;
  Index row;      ///< of SecondaryBasis::on_facets
  Vec<Dim> x, n;  ///< position, outward normal
  double weight;  ///< measure of the facet times the rule's weight
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
      visit(BoundaryPoint<Dim>{f, f * per_facet + g, space.position(c, at), normal, measure * rule.weights[g],
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

using Triplets = std::vector<Eigen::Triplet<double, Index>>;

/// Adds the block at block row a, block column b of a matrix M to the lower triangle of M + M^T (sum of both halves).
template <int Dim> void add_symmetrised(Triplets& triplets, Index a, Index b, const Mat<Dim>& block) {
  for (int i = 0; i < Dim; ++i)
    for (int j = 0; j < Dim; ++j) {
      const Index r = Dim * a + i, c = Dim * b + j;
      triplets.emplace_back(std::max(r, c), std::min(r, c), r == c ? 2.0 * block(i, j) : block(i, j));
    }
}

/// int over the restrained boundary of Phi_K times things, for one term of the stiffness.
template <int Dim> struct BoundaryMoments {
  using Block = Eigen::Matrix<double, Dim, voigt_size<Dim>>;
  std::vector<std::pair<std::pair<Index, Index>, Block>> shape;  ///< (K, fine v): int Phi_K eta_v d (B(n) d)^T
  std::vector<std::pair<Index, Voigt<Dim>>> value;               ///< K: int Phi_K g B(n) d
  std::vector<double> penalty;                                   ///< beta_K, all K
};

template <int Dim> BoundaryMoments<Dim> boundary_moments(const FineSpace<Dim>& space, const StiffnessTerm<Dim>& term,
                                                         const std::vector<Restraint<Dim>>& restraints) {
  const auto& on_facets = term.discretization->on_facets;
  BoundaryMoments<Dim> moments;
  std::vector<double> measure(term.discretization->size(), 0.0);
  for (const auto& restraint : restraints)
    for_each_point<Dim>(space, space.mesh().group(restraint.on), [&](const BoundaryPoint<Dim>& point) {
      const Vec<Dim> d = restraint.direction(point.n);
      const Voigt<Dim> traction = strain_matrix<Dim>(point.n) * d;  // d . sigma n = traction . sigma
      const double g = prescribed(restraint, point.x);
      for (SparseRows::InnerIterator phi(on_facets, point.row); phi; ++phi) {
        const double factor = point.weight * phi.value();
        measure[phi.col()] += std::abs(factor);
        moments.value.emplace_back(phi.col(), factor * g * traction);
        for (std::size_t i = 0; i < point.dofs.size(); ++i)
          if (point.N[i] != 0.0)
            moments.shape.emplace_back(std::pair(phi.col(), point.dofs[i]),
                                       factor * point.N[i] * d * traction.transpose());
      }
    });
  combine(moments.shape);
  combine(moments.value);
  // Largest (sigma n . d)^2 / (sigma : eps) of the term: lambda + 2 mu, at least what shear alone needs.
  const double normal_stiffness = std::max(term.lame.lambda + 2.0 * term.lame.mu, 2.0 * term.lame.mu);
  moments.penalty.resize(measure.size());
  for (std::size_t K = 0; K < measure.size(); ++K)
    moments.penalty[K] = 4.0 * normal_stiffness * measure[K] / term.discretization->weights[static_cast<Index>(K)];
  return moments;
}

/// -int (sigma(u) n).v and its transpose, and the matching right-hand side.
template <int Dim> void add_consistency(const ShapeTable<Dim>& shape, const StiffnessTerm<Dim>& term,
                                        const BoundaryMoments<Dim>& moments, Triplets& triplets, Points<Dim>& rhs) {
  const VoigtMatrix<Dim> C = stiffness<Dim>(term.lame);
  const auto& table = term.discretization->shape;
  using Block = typename BoundaryMoments<Dim>::Block;
  std::vector<std::pair<Index, Block>> nodal;
  for (std::size_t s = 0; s < moments.shape.size();) {
    const Index K = moments.shape[s].first.first;
    nodal.clear();
    for (; s < moments.shape.size() && moments.shape[s].first.first == K; ++s) {
      const auto row = shape.row(moments.shape[s].first.second);
      for (std::size_t k = 0; k < row.nodes.size(); ++k)
        nodal.emplace_back(row.nodes[k], row.N[k] * moments.shape[s].second);
    }
    combine(nodal);
    const auto row = table.row(K);
    for (std::size_t k = 0; k < row.nodes.size(); ++k) {
      const Eigen::Matrix<double, voigt_size<Dim>, Dim> CB = C * strain_matrix<Dim>(row.dN[k]);
      for (const auto& [a, q] : nodal) add_symmetrised<Dim>(triplets, a, row.nodes[k], -(q * CB));
    }
  }
  for (const auto& [K, q] : moments.value) {
    const auto row = table.row(K);
    for (std::size_t k = 0; k < row.nodes.size(); ++k)
      rhs.col(row.nodes[k]) -= (C * strain_matrix<Dim>(row.dN[k])).transpose() * q;
  }
}

/// beta int u.v along the restrained directions.
template <int Dim>
void add_penalty(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                 const std::vector<StiffnessTerm<Dim>>& terms, const std::vector<BoundaryMoments<Dim>>& moments,
                 const std::vector<Restraint<Dim>>& restraints, Triplets& triplets, Points<Dim>& rhs) {
  std::vector<std::pair<std::pair<Index, Index>, Mat<Dim>>> fine;
  Points<Dim> fine_rhs = Points<Dim>::Zero(Dim, space.size());
  for (const auto& restraint : restraints)
    for_each_point<Dim>(space, space.mesh().group(restraint.on), [&](const BoundaryPoint<Dim>& point) {
      double beta = 0.0;
      for (std::size_t t = 0; t < terms.size(); ++t)
        for (SparseRows::InnerIterator phi(terms[t].discretization->on_facets, point.row); phi; ++phi)
          beta += std::abs(phi.value()) * moments[t].penalty[phi.col()];
      const Vec<Dim> d = restraint.direction(point.n);
      const double g = prescribed(restraint, point.x);
      for (std::size_t i = 0; i < point.dofs.size(); ++i) {
        if (point.N[i] == 0.0) continue;
        fine_rhs.col(point.dofs[i]) += point.weight * beta * point.N[i] * g * d;
        for (std::size_t j = 0; j < point.dofs.size(); ++j)
          if (point.N[j] != 0.0)
            fine.emplace_back(std::pair(point.dofs[i], point.dofs[j]),
                              (point.weight * beta * point.N[i] * point.N[j]) * (d * d.transpose()));
      }
    });
  combine(fine);
  // Expand the fine rows one at a time: nodes of v against the sum over its neighbours w on the boundary.
  std::vector<std::pair<Index, Mat<Dim>>> nodal;
  for (std::size_t s = 0; s < fine.size();) {
    const Index v = fine[s].first.first;
    nodal.clear();
    for (; s < fine.size() && fine[s].first.first == v; ++s) {
      const auto row = shape.row(fine[s].first.second);
      for (std::size_t k = 0; k < row.nodes.size(); ++k) nodal.emplace_back(row.nodes[k], row.N[k] * fine[s].second);
    }
    combine(nodal);
    const auto row = shape.row(v);
    for (std::size_t k = 0; k < row.nodes.size(); ++k)
      for (const auto& [b, block] : nodal) add_symmetrised<Dim>(triplets, row.nodes[k], b, 0.5 * row.N[k] * block);
  }
  rhs += to_nodes(shape, fine_rhs);
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

template <int Dim> void require_restrained(const FineSpace<Dim>& space, const std::vector<Restraint<Dim>>& restraints) {
  static_assert(Dim == 2, "rigid motions are written out for the plane");
  const FineMesh<Dim>& mesh = space.mesh();
  const Index bodies = mesh.num_components();
  // Centre and radius of gyration of each body, so that translations and the rotation weigh alike.
  std::vector<double> volume(bodies, 0.0), polar(bodies, 0.0);
  Points<2> centre = Points<2>::Zero(2, bodies);
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    const Index body = mesh.component()[mesh.cells()(0, c)];
    volume[body] += mesh.volume(c);
    centre.col(body) += mesh.volume(c) * mesh.centroid(c);
  }
  for (Index body = 0; body < bodies; ++body) centre.col(body) /= volume[body];
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    const Index body = mesh.component()[mesh.cells()(0, c)];
    polar[body] += mesh.volume(c) * (mesh.centroid(c) - centre.col(body)).squaredNorm();
  }
  std::vector<Eigen::Matrix3d> gram(bodies, Eigen::Matrix3d::Zero());
  for (const auto& restraint : restraints)
    for_each_point<2>(space, mesh.group(restraint.on), [&](const BoundaryPoint<2>& point) {
      const Index body = mesh.component()[mesh.facets()(0, point.facet)];
      const double radius = std::sqrt(polar[body] / volume[body]) + 1e-300;
      const Vec<2> d = restraint.direction(point.n), arm = point.x - centre.col(body);
      const Eigen::Vector3d motion(d.x(), d.y(), (arm.x() * d.y() - arm.y() * d.x()) / radius);
      gram[body] += point.weight * motion * motion.transpose();
    });

  std::vector<std::string> free_motions;
  for (Index body = 0; body < bodies; ++body) {
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(gram[body]);
    const double scale = std::max(eigen.eigenvalues().maxCoeff(), 1e-300);
    const double radius = std::sqrt(polar[body] / volume[body]);
    const int nullity = static_cast<int>((eigen.eigenvalues().array() < 1e-10 * scale).count());
    const Matrix basis = eigen.eigenvectors().leftCols(nullity);
    const auto is_free = [&](const Eigen::Vector3d& motion) {
      return nullity > 0 && (motion - basis * (basis.transpose() * motion)).norm() < 1e-4 * motion.norm();
    };
    std::vector<std::string> names;
    if (is_free(Eigen::Vector3d::UnitX())) names.push_back("translation along x");
    if (is_free(Eigen::Vector3d::UnitY())) names.push_back("translation along y");
    if (names.empty() || static_cast<int>(names.size()) < nullity) {
      if (nullity == 3) {
        names.push_back("rotation");
      } else if (nullity > static_cast<int>(names.size())) {
        // What is left of the free motions beside the named translations: a rotation about some point, or an oblique
        // translation.
        Eigen::Vector3d motion = basis.col(0);
        for (int k = 0; k < nullity; ++k)
          if (std::abs(basis(2, k)) > std::abs(motion[2])) motion = basis.col(k);
        if (std::abs(motion[2]) > 1e-6) {
          const double spin = motion[2] / radius;
          names.push_back(fmt::format("rotation about ({:.4g}, {:.4g})", centre(0, body) - motion[1] / spin,
                                      centre(1, body) + motion[0] / spin));
        } else {
          const Vec<2> along = motion.head<2>().normalized();
          names.push_back(fmt::format("translation along ({:.4g}, {:.4g})", along.x(), along.y()));
        }
      }
    }
    if (nullity > 0)
      free_motions.push_back(bodies == 1 ? fmt::format("{}", fmt::join(names, ", "))
                                         : fmt::format("body around ({:.4g}, {:.4g}): {}", centre(0, body),
                                                       centre(1, body), fmt::join(names, ", ")));
  }
  if (!free_motions.empty())
    throw InputError(fmt::format("underconstrained: free to move ({}); prescribe displacements that hold it",
                                 fmt::join(free_motions, "; ")));
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
          fine.col(dofs[i]) += space.mesh().volume(c) * rule.weights[q] * N[i] * b;
      }
  }
  return to_nodes(shape, fine);
}

template <int Dim> NitscheSystem<Dim> nitsche(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                              const std::vector<StiffnessTerm<Dim>>& terms,
                                              const std::vector<Restraint<Dim>>& restraints) {
  Triplets triplets;
  Points<Dim> rhs = Points<Dim>::Zero(Dim, shape.num_nodes());
  std::vector<BoundaryMoments<Dim>> moments;
  for (const auto& term : terms) {
    moments.push_back(boundary_moments(space, term, restraints));
    add_consistency(shape, term, moments.back(), triplets, rhs);
  }
  add_penalty(space, shape, terms, moments, restraints, triplets, rhs);
  NitscheSystem<Dim> system;
  const Index size = Dim * shape.num_nodes();
  system.matrix.resize(size, size);
  system.matrix.setFromTriplets(triplets.begin(), triplets.end());
  system.rhs = rhs.reshaped();
  return system;
}

template <int Dim> NodalConditions<Dim> nodal_conditions(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                                         const std::vector<Index>& node_dofs,
                                                         const std::vector<Restraint<Dim>>& restraints) {
  struct Condition {
    std::vector<Vec<Dim>> directions;
    std::vector<double> values;
  };
  std::map<Index, Condition> by_node;
  std::vector<Index> node_at(space.size(), -1);
  for (std::size_t I = 0; I < node_dofs.size(); ++I) node_at[node_dofs[I]] = static_cast<Index>(I);

  for (const auto& restraint : restraints) {
    std::map<Index, Vec<Dim>> normal_at;  // fine degrees of freedom on the part, with their normal
    for (Index f : space.mesh().group(restraint.on))
      for (Index dof : space.facet(f)) {
        const Vec<Dim> n = space.mesh().facet_normal(f);
        const auto [it, is_new] = normal_at.emplace(dof, n);
        if (!is_new && restraint.component < 0 && (it->second - n).norm() > 1e-6)
          throw InputError(
              fmt::format("normal displacement on \"{}\" cannot be set strongly: the part is not flat at {}; use "
                          "essential = \"nitsche\"",
                          restraint.on, at<Dim>(space.points().col(dof))));
      }
    for (const auto& [dof, n] : normal_at) {
      for (Index I : shape.row(dof).nodes)
        if (!normal_at.contains(node_dofs[I]))
          throw InputError(fmt::format(
              "displacement on \"{}\" cannot be set strongly: the function of the node at {} does not vanish at {}; "
              "build the basis with vanish_on = \"{}\", or use essential = \"nitsche\"",
              restraint.on, at<Dim>(space.points().col(node_dofs[I])), at<Dim>(space.points().col(dof)), restraint.on));
      if (node_at[dof] < 0) continue;
      Condition& condition = by_node[node_at[dof]];
      condition.directions.push_back(restraint.direction(n));
      condition.values.push_back(prescribed(restraint, Vec<Dim>(space.points().col(dof))));
    }
  }

  NodalConditions<Dim> result;
  for (const auto& [I, condition] : by_node) {
    const Index count = static_cast<Index>(condition.values.size());
    Matrix directions(count, Dim);
    for (Index k = 0; k < count; ++k) directions.row(k) = condition.directions[k].transpose();
    const Vector values = Eigen::Map<const Vector>(condition.values.data(), count);
    Eigen::CompleteOrthogonalDecomposition<Matrix> decomposition(directions);
    const Vec<Dim> u = decomposition.solve(values);
    if ((directions * u - values).norm() > 1e-9 * (values.norm() + 1e-300))
      throw InputError(fmt::format("displacements prescribed at {} contradict each other",
                                   at<Dim>(space.points().col(node_dofs[I]))));
    const int rank = static_cast<int>(decomposition.rank());
    Mat<Dim> frame = Mat<Dim>::Identity();
    if (rank < Dim) {
      const Vec<Dim>& d = condition.directions.front();
      if constexpr (Dim == 2) frame << d.x(), -d.y(), d.y(), d.x();
    }
    result.nodes.push_back(I);
    result.frames.push_back(frame);
    result.fixed.push_back(rank);
    result.values.push_back(frame.transpose() * u);
  }
  return result;
}

template std::vector<Restraint<2>> restraints<2>(const std::vector<DisplacementCondition<2>>&);
template void require_restrained<2>(const FineSpace<2>&, const std::vector<Restraint<2>>&);
template Points<2> load_vector<2>(const FineSpace<2>&, const ShapeTable<2>&, const Loads<2>&);
template NitscheSystem<2> nitsche<2>(const FineSpace<2>&, const ShapeTable<2>&, const std::vector<StiffnessTerm<2>>&,
                                     const std::vector<Restraint<2>>&);
template NodalConditions<2> nodal_conditions<2>(const FineSpace<2>&, const ShapeTable<2>&, const std::vector<Index>&,
                                                const std::vector<Restraint<2>>&);

}  // namespace efree
