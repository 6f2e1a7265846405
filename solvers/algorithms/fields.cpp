// SPDX-License-Identifier: GPL-3.0-or-later
/// Fields on the fine mesh, probes and errors.
#include "efree/assembly/operators.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/finite.hpp"
#include "efree/core/internal/setting_error.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/core/parallel.hpp"
#include "efree/solvers/algorithms/internal/blend.hpp"
#include "efree/solvers/algorithms/internal/cell_gradients.hpp"
#include "efree/solvers/algorithms/static_analysis.hpp"
#include "efree/solvers/equations/internal/side_by_side.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace efree {

using internal::SideBySide, internal::UniformCell, internal::CellSquares, internal::most_side_by_side;

namespace {

/// For each node the quadrature points its function acts on, with the cube of the overlap int phi_I Phi_K as weight.
/// Of points that share their cells none has less than half the mean overlap or more than twice that (so that it is
/// positive, and they carry their plane together). Narrow enough not to smear what varies over a few spacings
/// (measured: cubes lose a quarter of the error of plain overlaps), wide enough to hold a plane. For finite elements of
/// degree 1 all overlaps around an inner node are alike in size. Their nodes have a row for each place: at interfaces
/// points count for the place of their region only.
template <int Dim> SparseRows fit_weights(const FineSpace<Dim>& space, const Discretization<Dim>& quadrature) {
  // Only finite elements know meshes in which regions share degrees of freedom, which are their nodes.
  const bool shared = space.num_places() > space.size();
  const Index points = quadrature.size(), rows = shared ? space.num_places() : quadrature.shape.num_nodes();
  const auto row_of = [&](Index node, Index K) { return shared ? space.place(node, quadrature.region[K]) : node; };
  std::vector<Index> offsets(rows + 1, 0);
  for (Index K = 0; K < points; ++K)
    for (const Index I : quadrature.shape.row(K).nodes) ++offsets[row_of(I, K) + 1];
  std::partial_sum(offsets.begin(), offsets.end(), offsets.begin());
  SparseRows around(rows, points);
  around.resizeNonZeros(offsets.back());
  std::ranges::copy(offsets, around.outerIndexPtr());
  for (Index K = 0, end; K < points; K = end) {
    end = quadrature.end_of_cluster(K);
    const auto nodes = quadrature.shape.row(K).nodes;
    for (std::size_t k = 0; k < nodes.size(); ++k) {
      const auto overlap_of = [&](Index L) {
        // Axisymmetric: overlaps in the section, where points far from the axis count no more than those near it.
        const auto row = quadrature.shape.row(L);
        return quadrature.weights[L] * (quadrature.axisymmetric() ? row.hoop[k] : row.N[k]);
      };
      double mean = 0.0;
      for (Index L = K; L < end; ++L) mean += overlap_of(L) / (end - K);
      for (Index L = K; L < end; ++L) {
        const Index at = offsets[row_of(nodes[k], L)]++;
        const double overlap = mean > 0.0 ? std::clamp(overlap_of(L), 0.5 * mean, 2.0 * mean) : 0.0;
        around.innerIndexPtr()[at] = L;
        around.valuePtr()[at] = overlap * overlap * overlap;
      }
    }
  }
  return around;
}

/// Whether the functions of an approximation are 1 at their own node and 0 at all others: finite elements.
template <int Dim> bool is_nodal(const Approximation<Dim>& approximation) {
  const ShapeTable<Dim>& shape = approximation.shape;
  return shape.num_points() == shape.num_nodes() && shape.num_entries() == shape.num_nodes();
}

/// Sum over cells of f(cell), in an order that does not depend on the threads.
template <int Size, class F> Eigen::Array<double, Size, 1> sum_cells(Index cells, const F& f) {
  constexpr Index chunk = 1024;
  std::vector<Eigen::Array<double, Size, 1>> partial((cells + chunk - 1) / chunk);
  parallel_chunks(cells, chunk, [&](Index begin, Index end) {
    auto& sum = partial[begin / chunk];
    sum.setZero();
    for (Index c = begin; c < end; ++c) f(c, sum);
  });
  Eigen::Array<double, Size, 1> total = Eigen::Array<double, Size, 1>::Zero();
  for (const auto& sum : partial) total += sum;
  return total;
}

/// Columns `dofs` of a field with `Rows` components; stays on the stack.
template <int Dim, int Rows> auto gather(const Points<Rows>& values, std::span<const Index> dofs) {
  Eigen::Matrix<double, Rows, Eigen::Dynamic, 0, Rows, FineSpace<Dim>::max_cell_size> local(
      Rows, static_cast<Index>(dofs.size()));
  for (std::size_t i = 0; i < dofs.size(); ++i) local.col(static_cast<Index>(i)) = values.col(dofs[i]);
  return local;
}

/// Whether finite elements take the mean of the dilatation in each cell.
template <int Dim> bool averages_in_cells(const Approximation<Dim>& approximation) {
  return approximation.averaged && approximation.dilatation.size() == approximation.space.mesh().num_cells();
}

/// The mean dilatation in cell c, which `at_points` of the space's rule has entered.
template <int Dim> double mean_dilatation(const FineSpace<Dim>& space, Index c, const CellGradients<Dim>& at_points,
                                          const Points<Dim>& u) {
  double sum = 0.0, volume = 0.0;
  for (Index q = 0; q < space.cell_rule().weights.size(); ++q) {
    const double weight = space.weight(c, q);
    sum += weight * strain_of<Dim>(at_points.of(q, u)).template head<3>().sum();
    volume += weight;
  }
  return sum / volume;
}

/// Strains of a displacement at the fine degrees of freedom as the stiffness sees them: in finite elements with
/// averaged dilatations its mean in the cell takes the dilatation's place.
template <int Dim> class CellStrains {
 public:
  CellStrains(const Approximation<Dim>& approximation, const Points<Dim>& u)
      : space_(approximation.space), u_(u), averaged_(averages_in_cells(approximation)) {}
  /// Strain at any barycentric point of cell c, with the stiffness there.
  auto in(Index c) const {
    double mean = 0.0, volume = 0.0;
    const auto& rule = space_.cell_rule();
    for (Index q = 0; averaged_ && q < rule.weights.size(); ++q) {
      const double weight = space_.weight(c, q);
      mean += weight * at(c, rule.points.col(q)).template head<3>().sum();
      volume += weight;
    }
    if (averaged_) mean /= volume;
    return [this, c, mean](const typename FineSpace<Dim>::Barycentric& x, const Stiffness<Dim>& stiffness) {
      Voigt<Dim> eps = at(c, x);
      if (averaged_) eps += (mean - eps.template head<3>().sum()) * stiffness.swelling;
      return eps;
    };
  }

 private:
  Voigt<Dim> at(Index c, const typename FineSpace<Dim>::Barycentric& x) const {
    return strain_at<Dim>(space_, c, x, u_);
  }
  const FineSpace<Dim>& space_;
  const Points<Dim>& u_;
  bool averaged_;
};

}  // namespace

template <int Dim> Errors errors_against(const Approximation<Dim>& approximation, const Fields<Dim>& fields,
                                         const Materials<Dim>& materials, const ExactSolution<Dim>& exact) {
  const auto& space = approximation.space;
  const auto rule = simplex_rule<Dim>(4);
  enum { u_error, u_norm, energy_error, recovered_error, energy_norm, count };
  const CellStrains<Dim> strains(approximation, fields.displacement);
  const auto sums = sum_cells<count>(space.mesh().num_cells(), [&](Index c, auto& sum) {
    const auto dofs = space.cell(c);
    const auto strain = strains.in(c);
    const auto u = gather<Dim>(fields.displacement, dofs);
    const auto sigma = gather<Dim>(fields.stress, space.places(c));
    Stiffness<Dim> room;
    for (Index q = 0; q < rule.weights.size(); ++q) {
      const Vec<Dim> x = space.position(c, rule.points.col(q));
      const double dV = space.mesh().volume(c) * rule.weights[q] * space.measure(x);
      const auto N = space.values(rule.points.col(q));
      if (exact.displacement) {
        const Vec<Dim> reference = exact.displacement(x);
        sum[u_error] += dV * (u * N - reference).squaredNorm();
        sum[u_norm] += dV * reference.squaredNorm();
      }
      if (exact.stress) {
        const Voigt<Dim> reference = exact.stress(x);
        const Stiffness<Dim>& stiffness = materials.stiffness(space.mesh().region(c), x, room);
        const auto energy = [&](const Voigt<Dim>& stress) { return dV * stress.dot(stiffness.S * stress); };
        sum[energy_error] += energy(stiffness.C * strain(rule.points.col(q), stiffness) - reference);
        sum[recovered_error] += energy(sigma * N - reference);
        sum[energy_norm] += energy(reference);
      }
    }
  });
  const auto relative = [&](int error, int norm) {
    if (!std::isfinite(sums[norm]))
      throw internal::SettingError("exact", "the exact solution is not finite somewhere in the body");
    if (sums[norm] == 0.0)
      throw internal::SettingError("exact", "the exact solution is zero everywhere: there is no relative error");
    return std::sqrt(sums[error] / sums[norm]);
  };
  Errors errors;
  if (exact.displacement) errors.l2_displacement = relative(u_error, u_norm);
  if (exact.stress) {
    errors.energy_norm = relative(energy_error, energy_norm);
    errors.energy_norm_recovered = relative(recovered_error, energy_norm);
  }
  for (const auto& error : {errors.l2_displacement, errors.energy_norm, errors.energy_norm_recovered})
    if (error && !std::isfinite(*error)) throw NumericalError("the error against the exact solution is not finite");
  return errors;
}

namespace {

/// What recovered stresses are off those of the displacement's gradients.
template <int Dim> class RecoveryDifference {
 public:
  RecoveryDifference(const Approximation<Dim>& approximation, const Fields<Dim>& fields)
      : space_(approximation.space), stress_(fields.stress), strains_(approximation, fields.displacement) {}
  /// Difference of the stresses, and the strain, at a barycentric point of cell c with the stiffness there.
  auto in(Index c) const {
    return [this, strain = strains_.in(c), sigma = gather<Dim>(stress_, space_.places(c))](
               const typename FineSpace<Dim>::Barycentric& at, const Stiffness<Dim>& stiffness) {
      const Voigt<Dim> eps = strain(at, stiffness);
      return std::pair<Voigt<Dim>, Voigt<Dim>>(sigma * space_.values(at) - stiffness.C * eps, eps);
    };
  }

 private:
  const FineSpace<Dim>& space_;
  const VoigtPoints<Dim>& stress_;
  CellStrains<Dim> strains_;
};

/// Calls visit(point, its volume of the body, stiffness there) for the points of a rule that integrates squares of
/// strains in cell c.
template <int Dim, class Visit> void for_each_point(const FineSpace<Dim>& space, const SimplexRule<Dim>& rule, Index c,
                                                    const Materials<Dim>& materials, const Visit& visit) {
  Stiffness<Dim> room;
  for (Index q = 0; q < rule.weights.size(); ++q) {
    const typename FineSpace<Dim>::Barycentric at = rule.points.col(q);
    const Vec<Dim> x = space.position(c, at);
    visit(at, space.mesh().volume(c) * rule.weights[q] * space.measure(x),
          materials.stiffness(space.mesh().region(c), x, room));
  }
}

}  // namespace

template <int Dim> RecoveryError recovery_error(const Approximation<Dim>& approximation, const Fields<Dim>& fields,
                                                const Materials<Dim>& materials) {
  return std::move(recovery_errors<Dim>(approximation, {&fields}, materials).front());
}

namespace {

/// What a cell adds to the sums of recovery_errors.
struct RecoverySums {
  double error = 0.0, norm = 0.0, rounding = 0.0;

  void add(const RecoverySums& other) {
    error += other.error;
    norm += other.norm;
    rounding += other.rounding;
  }
};

/// These, cell by cell, for any number of fields in each.
template <int Dim> class RecoverySquares {
 public:
  RecoverySquares(const Approximation<Dim>& approximation, const Materials<Dim>& materials)
      : space_(approximation.space),
        materials_(materials),
        averaged_(averages_in_cells(approximation)),
        rule_(simplex_rule<Dim>(2 * space_.degree())),
        volumes_(rule_.weights.size()),
        rooms_(rule_.weights.size()),
        stiffness_(rule_.weights.size()),
        at_points_(space_, rule_),
        own_(space_, space_.cell_rule()) {
    for (Index q = 0; q < rule_.weights.size(); ++q) values_.push_back(space_.values(rule_.points.col(q)));
    const auto n = values_.front().size();
    Matrix mass = Matrix::Zero(n, n);
    for (Index q = 0; q < rule_.weights.size(); ++q) mass += rule_.weights[q] * values_[q] * values_[q].transpose();
    root_ = Eigen::LLT<Matrix>(mass).matrixL();
  }

  void enter(Index c) {
    cell_ = c;
    // Then the difference is a polynomial of the degree of the space.
    by_nodes_ = materials_.is_uniform(space_.mesh().region(c)) && !space_.axisymmetric();
    if (averaged_) own_.enter(c);
    if (by_nodes_) {
      for (int i = 0; i <= Dim; ++i) at_corners_[i] = space_.gradients(c, FineSpace<Dim>::Barycentric::Unit(i));
      stiffness_[0] = &materials_.stiffness(space_.mesh().region(c), space_.mesh().centroid(c), rooms_[0]);
    } else {
      at_points_.enter(c);
      for (Index q = 0; q < volumes_.size(); ++q) {
        const Vec<Dim> x = space_.position(c, rule_.points.col(q));
        volumes_[q] = space_.mesh().volume(c) * rule_.weights[q] * space_.measure(x);
        stiffness_[q] = &materials_.stiffness(space_.mesh().region(c), x, rooms_[q]);
      }
    }
    smallest_ = 1e-24 * space_.mesh().hat_gradients(c).squaredNorm();
  }

  /// Of each field, which `displacements` and `stresses` have, too.
  void find(const std::vector<const Fields<Dim>*>& fields, const std::vector<SideBySide<Dim>>& displacements,
            const std::vector<SideBySide<voigt_size<Dim>>>& stresses, std::vector<RecoverySums>& sums) const {
    const auto mean = [&](std::size_t k) {
      return averaged_ ? mean_dilatation(space_, cell_, own_, fields[k]->displacement) : 0.0;
    };
    if (!by_nodes_) {
      for (std::size_t k = 0; k < fields.size(); ++k) sums[k] = by_rule(*fields[k], mean(k));
      return;
    }
    const Stiffness<Dim>& stiffness = *stiffness_[0];
    const double volume = space_.mesh().volume(cell_), smallest = volume * stiffness.C(0, 0) * smallest_;
    std::array<double, most_side_by_side> dilatations{};
    UniformCell<Dim> cell{.dofs = space_.cell(cell_).data(),
                          .places = space_.places(cell_).data(),
                          .dN = {},
                          .stiffness = &stiffness,
                          .root = root_.data(),
                          .dilatations = averaged_ ? dilatations.data() : nullptr};
    for (int i = 0; i <= Dim; ++i) cell.dN[i] = at_corners_[i].data();
    CellSquares squares;
    std::size_t k = 0;
    for (std::size_t part = 0; part < displacements.size(); ++part) {
      const Index count = displacements[part].count();
      for (Index lane = 0; averaged_ && lane < count; ++lane) dilatations[lane] = mean(k + lane);
      compare(displacements[part], stresses[part], space_.degree(), cell, squares);
      for (Index lane = 0; lane < count; ++lane)
        sums[k++] = {volume * squares.error[lane], volume * squares.norm[lane], smallest * squares.displacement[lane]};
    }
  }

 private:
  Voigt<Dim> strain(const Gradient<Dim>& H, double mean, const Stiffness<Dim>& stiffness) const {
    Voigt<Dim> eps = strain_of<Dim>(H);
    if (averaged_) eps += (mean - eps.template head<3>().sum()) * stiffness.swelling;
    return eps;
  }

  RecoverySums by_rule(const Fields<Dim>& fields, double mean) const {
    const auto sigma = gather<Dim>(fields.stress, space_.places(cell_));
    const double smallest =
        smallest_ * gather<Dim>(fields.displacement, space_.cell(cell_)).colwise().squaredNorm().maxCoeff();
    RecoverySums sums;
    for (Index q = 0; q < volumes_.size(); ++q) {
      const Stiffness<Dim>& stiffness = *stiffness_[q];
      const Voigt<Dim> eps = strain(at_points_.of(q, fields.displacement), mean, stiffness);
      const Voigt<Dim> stress = stiffness.C * eps, difference = sigma * values_[q] - stress;
      sums.add({volumes_[q] * difference.dot(stiffness.S * difference), volumes_[q] * eps.dot(stress),
                volumes_[q] * stiffness.C(0, 0) * smallest});
    }
    return sums;
  }

  const FineSpace<Dim>& space_;
  const Materials<Dim>& materials_;
  bool averaged_;
  SimplexRule<Dim> rule_;
  std::vector<typename FineSpace<Dim>::CellValues> values_;  ///< at the points of the rule
  Matrix root_;                                              ///< of the mass matrix of a cell of volume 1
  Index cell_ = 0;
  bool by_nodes_ = false;
  Vector volumes_;  ///< by point of the rule
  std::vector<Stiffness<Dim>> rooms_;
  std::vector<const Stiffness<Dim>*> stiffness_;
  CellGradients<Dim> at_points_, own_;
  std::array<typename FineSpace<Dim>::CellGradients, Dim + 1> at_corners_;
  double smallest_ = 0.0;
};

}  // namespace

template <int Dim> std::vector<RecoveryError> recovery_errors(const Approximation<Dim>& approximation,
                                                              const std::vector<const Fields<Dim>*>& fields,
                                                              const Materials<Dim>& materials) {
  const Index cells = approximation.space.mesh().num_cells();
  constexpr Index chunk = 1024;
  std::vector<std::vector<RecoverySums>> parts((cells + chunk - 1) / chunk, std::vector<RecoverySums>(fields.size()));
  std::vector<RecoveryError> errors(fields.size());
  for (RecoveryError& one : errors) one.squares.resize(cells);
  std::vector<const Points<Dim>*> of_displacements;
  std::vector<const VoigtPoints<Dim>*> of_stresses;
  for (const Fields<Dim>* one : fields) {
    of_displacements.push_back(&one->displacement);
    of_stresses.push_back(&one->stress);
  }
  const auto displacements = internal::side_by_side(of_displacements);
  const auto stresses = internal::side_by_side(of_stresses);
  parallel_chunks(cells, chunk, [&](Index begin, Index end) {
    RecoverySquares<Dim> squares(approximation, materials);
    std::vector<RecoverySums> sums(fields.size());
    for (Index c = begin; c < end; ++c) {
      squares.enter(c);
      squares.find(fields, displacements, stresses, sums);
      for (std::size_t k = 0; k < fields.size(); ++k) {
        errors[k].squares[c] = sums[k].error;
        parts[begin / chunk][k].add(sums[k]);
      }
    }
  });
  for (std::size_t k = 0; k < fields.size(); ++k) {
    RecoverySums all;
    for (const auto& part : parts) all.add(part[k]);
    // Bodies that move as a whole have strains of rounding.
    errors[k].relative = all.norm > all.rounding ? std::sqrt(all.error / all.norm) : 0.0;
  }
  return errors;
}

template <int Dim> RecoveryError recovery_error_of_points(const Approximation<Dim>& elements,
                                                          const VoigtPoints<Dim>& stress, const Fields<Dim>& fields,
                                                          const Materials<Dim>& materials) {
  const auto& space = elements.space;
  const auto& points = space.cell_rule().points;
  const auto in_cell = static_cast<Index>(points.cols());
  require(stress.cols() == in_cell * space.mesh().num_cells(), "stresses of every point of every cell expected");
  // What interpolates values at the points, linearly as far as they go.
  const Matrix to_corners = points.transpose() * internal::pseudo_inverse<Eigen::Dynamic>(points * points.transpose());
  const auto rule = simplex_rule<Dim>(2 * space.degree());
  Vector squares(space.mesh().num_cells());
  enum { error, norm, count };
  const auto sums = sum_cells<count>(space.mesh().num_cells(), [&](Index c, auto& sum) {
    const auto sigma = gather<Dim>(fields.stress, space.places(c));
    const Matrix own = stress.middleCols(in_cell * c, in_cell) * to_corners;
    double square = 0.0;
    for_each_point(space, rule, c, materials, [&](const auto& at, double dV, const Stiffness<Dim>& stiffness) {
      const Voigt<Dim> there = own * at, difference = sigma * space.values(at) - there;
      square += dV * difference.dot(stiffness.S * difference);
      sum[norm] += dV * there.dot(stiffness.S * there);
    });
    squares[c] = square;
    sum[error] += square;
  });
  return {sums[norm] > 0.0 ? std::sqrt(sums[error] / sums[norm]) : 0.0, std::move(squares)};
}

template <int Dim> Vector recovery_products(const Approximation<Dim>& approximation, const Fields<Dim>& a,
                                            const Fields<Dim>& b, const Materials<Dim>& materials) {
  const auto& space = approximation.space;
  const auto rule = simplex_rule<Dim>(2 * space.degree());
  const RecoveryDifference<Dim> of_a(approximation, a), of_b(approximation, b);
  Vector products(space.mesh().num_cells());
  parallel_for(space.mesh().num_cells(), [&](Index c) {
    const auto first = of_a.in(c), second = of_b.in(c);
    double sum = 0.0;
    for_each_point(space, rule, c, materials, [&](const auto& at, double dV, const Stiffness<Dim>& stiffness) {
      sum += dV * first(at, stiffness).first.dot(stiffness.S * second(at, stiffness).first);
    });
    products[c] = sum;
  });
  return products;
}

template <int Dim> double functional_error(const Approximation<Dim>& elements, const Fields<Dim>& u,
                                           const Fields<Dim>& z, const Materials<Dim>& materials) {
  const auto& space = elements.space;
  const auto rule = simplex_rule<Dim>(2 * space.degree());
  const RecoveryDifference<Dim> of_u(elements, u), of_z(elements, z);
  enum { signed_sum, bound, count };
  const auto sums = sum_cells<count>(space.mesh().num_cells(), [&](Index c, auto& sum) {
    const auto first = of_u.in(c), second = of_z.in(c);
    double uz = 0.0, uu = 0.0, zz = 0.0;
    for_each_point(space, rule, c, materials, [&](const auto& at, double dV, const Stiffness<Dim>& stiffness) {
      const Voigt<Dim> a = first(at, stiffness).first, b = second(at, stiffness).first, strain = stiffness.S * b;
      uz += dV * a.dot(strain);
      uu += dV * a.dot(stiffness.S * a);
      zz += dV * b.dot(strain);
    });
    sum[signed_sum] += uz;
    sum[bound] += std::sqrt(std::max(0.0, uu) * std::max(0.0, zz));
  });
  return std::max(space.degree() * std::abs(sums[signed_sum]), 0.1 * sums[bound]);
}

template <int Dim> double mixed_distance(const Approximation<Dim>& elements, const Points<Dim>& displacement,
                                         const Fields<Dim>& fields, const Materials<Dim>& materials) {
  const auto& space = elements.space;
  const auto rule = simplex_rule<Dim>(2 * space.degree());
  enum { distance, norm, count };
  const CellStrains<Dim> strains(elements, displacement);
  const auto sums = sum_cells<count>(space.mesh().num_cells(), [&](Index c, auto& sum) {
    const auto strain = strains.in(c);
    const auto stress = gather<Dim>(fields.stress, space.places(c));
    for_each_point(space, rule, c, materials, [&](const auto& at, double dV, const Stiffness<Dim>& stiffness) {
      const double kappa = stiffness.kappa;
      // Energy of what a strain has beside its dilatation.
      const auto shear = [&](const Voigt<Dim>& eps) {
        const double dilatation = eps.template head<3>().sum();
        return eps.dot(stiffness.C * eps) - kappa * dilatation * dilatation;
      };
      const Voigt<Dim> eps = strain(at, stiffness);
      const double p = kappa * eps.template head<3>().sum();
      const double apart = stiffness.swelling.dot(stress * space.values(at)) - p;
      sum[distance] += dV * (shear(strain_at<Dim>(space, c, at, fields.displacement) - eps) + apart * apart / kappa);
      sum[norm] += dV * (shear(eps) + p * p / kappa);
    });
  });
  return sums[norm] > 0.0 ? std::sqrt(sums[distance] / sums[norm]) : 0.0;
}

template <int Dim> std::vector<VoigtPoints<Dim>> stress_differences(const Approximation<Dim>& approximation,
                                                                    const Fields<Dim>& fields,
                                                                    const Materials<Dim>& materials, Index place) {
  using Barycentric = typename FineSpace<Dim>::Barycentric;
  const auto& space = approximation.space;
  std::vector<Barycentric> at;  // of the degrees of freedom of a cell
  for (int i = 0; i <= Dim; ++i) at.push_back(Barycentric::Unit(i));
  for (int i = 0; i <= Dim && space.degree() == 2; ++i)
    for (int j = i + 1; j <= Dim; ++j) at.push_back(0.5 * (Barycentric::Unit(i) + Barycentric::Unit(j)));
  const RecoveryDifference<Dim> differences(approximation, fields);
  std::vector<VoigtPoints<Dim>> result;
  Stiffness<Dim> room;
  for (Index c = 0; c < space.mesh().num_cells(); ++c) {
    const auto around = space.places(c);
    if (std::ranges::find(around, place) == around.end()) continue;
    const auto difference_at = differences.in(c);
    VoigtPoints<Dim> in_cell(voigt_size<Dim>, static_cast<Index>(at.size()));
    for (std::size_t k = 0; k < at.size(); ++k)
      in_cell.col(static_cast<Index>(k)) =
          difference_at(at[k], materials.stiffness(space.mesh().region(c), space.position(c, at[k]), room)).first;
    result.push_back(std::move(in_cell));
  }
  return result;
}

template <int Dim> RecoveryFits<Dim> recovery_fits(const Approximation<Dim>& approximation) {
  using Fit = Eigen::Matrix<double, Dim + 1, Dim + 1>;
  using Linear = Eigen::Matrix<double, Dim + 1, 1>;
  RecoveryFits<Dim> fits{fit_weights(approximation.space, approximation.quadrature), {}};
  SparseRows& around = fits.values;
  const Index nodes = approximation.shape.num_nodes();
  if (!is_nodal(approximation)) fits.slopes = Points<Dim>::Zero(Dim, around.nonZeros());
  parallel_for(static_cast<Index>(around.rows()), [&](Index I) {
    const Vec<Dim> x = approximation.nodes.col(I < nodes ? I : approximation.space.dof_at(I));
    const Index begin = around.outerIndexPtr()[I], end = around.outerIndexPtr()[I + 1];
    double* const weights = around.valuePtr();
    const auto away = [&](Index k) -> Vec<Dim> {
      return approximation.quadrature.points.col(around.innerIndexPtr()[k]) - x;
    };
    double largest = 0.0, scale = 0.0, total = 0.0;
    for (Index k = begin; k < end; ++k) largest = std::max(largest, weights[k]);
    for (Index k = begin; k < end; ++k) {
      // A function of order 2 may be negative in the mean over every cluster it reaches: then all count alike.
      if (!(largest > 0.0)) weights[k] = 1.0;
      total += weights[k];
      scale += weights[k] * away(k).squaredNorm();
    }
    scale = scale > 0.0 ? std::sqrt(scale / total) : 1.0;
    const auto functions = [&](Index k) -> Linear { return (Linear() << 1.0, away(k) / scale).finished(); };
    Fit A = Fit::Zero();
    for (Index k = begin; k < end; ++k) {
      weights[k] /= total;
      const Linear g = functions(k);
      A += weights[k] * g * g.transpose();
    }
    const Eigen::LLT<Fit> cholesky(A);
    // The first pivot is 1; the others are those of the points' spread about their mean, in units of `scale`.
    const Vec<Dim> spread = cholesky.matrixLLT().diagonal().template tail<Dim>();
    if (cholesky.info() != Eigen::Success || !(spread.maxCoeff() > 1e-3) ||
        !(spread.minCoeff() > 0.1 * spread.maxCoeff()))
      return;  // the mean
    const Fit inverse = cholesky.solve(Fit::Identity());
    for (Index k = begin; k < end; ++k) {
      const Linear fit = weights[k] * (inverse * functions(k));
      weights[k] = fit[0];
      if (fits.slopes.size() > 0) fits.slopes.col(k) = fit.template tail<Dim>() / scale;
    }
  });
  return fits;
}

template <int Dim> Fields<Dim> recover_fields(const Approximation<Dim>& approximation, const Solution<Dim>& solution,
                                              const RecoveryFits<Dim>& fits) {
  const SparseRows& values = fits.values;
  const auto count = static_cast<Index>(values.rows());
  Fields<Dim> fields;
  if (is_nodal(approximation)) {
    fields = {solution.coefficients, VoigtPoints<Dim>(voigt_size<Dim>, count),
              VoigtPoints<Dim>(voigt_size<Dim>, count)};
    internal::weighted_sums<Dim>(values, solution.strain, solution.stress, fields.strain, fields.stress);
  } else {
    // Strains and stresses, then their derivatives.
    constexpr int rows = 2 * voigt_size<Dim>;
    Matrix at_nodes(rows * (Dim + 1), count);
    parallel_for(count, [&](Index I) {
      Eigen::Matrix<double, rows, Dim + 1> sum = Eigen::Matrix<double, rows, Dim + 1>::Zero();
      for (Index k = values.outerIndexPtr()[I]; k < values.outerIndexPtr()[I + 1]; ++k) {
        const Index K = values.innerIndexPtr()[k];
        Eigen::Matrix<double, rows, 1> there;
        there << solution.strain.col(K), solution.stress.col(K);
        sum.col(0) += values.valuePtr()[k] * there;
        sum.template rightCols<Dim>().noalias() += there * fits.slopes.col(k).transpose();
      }
      at_nodes.col(I) = sum.reshaped();
    });
    fields = internal::blend<Dim>(approximation, solution.coefficients, at_nodes);
  }
  if (!internal::all_finite(fields.strain) || !internal::all_finite(fields.stress))
    throw NumericalError("the recovered strains and stresses are not finite");
  return fields;
}

template <int Dim> Fields<Dim> recover_fields(const Approximation<Dim>& approximation, const Solution<Dim>& solution) {
  return recover_fields(approximation, solution, recovery_fits(approximation));
}

template <int Dim>
ProbeValues<Dim> probe(const FineSpace<Dim>& space, const Fields<Dim>& fields, const Location<Dim>& there) {
  const auto N = space.values(there.at);
  const auto places = space.places(there.cell);
  return {gather<Dim>(fields.displacement, space.cell(there.cell)) * N, gather<Dim>(fields.strain, places) * N,
          gather<Dim>(fields.stress, places) * N};
}

template double mixed_distance<2>(const Approximation<2>&, const Points<2>&, const Fields<2>&, const Materials<2>&);
template std::vector<RecoveryError> recovery_errors<2>(const Approximation<2>&, const std::vector<const Fields<2>*>&,
                                                       const Materials<2>&);
template RecoveryError recovery_error<2>(const Approximation<2>&, const Fields<2>&, const Materials<2>&);
template RecoveryError recovery_error_of_points<2>(const Approximation<2>&, const VoigtPoints<2>&, const Fields<2>&,
                                                   const Materials<2>&);
template Vector recovery_products<2>(const Approximation<2>&, const Fields<2>&, const Fields<2>&, const Materials<2>&);
template double functional_error<2>(const Approximation<2>&, const Fields<2>&, const Fields<2>&, const Materials<2>&);
template std::vector<VoigtPoints<2>> stress_differences<2>(const Approximation<2>&, const Fields<2>&,
                                                           const Materials<2>&, Index);
template RecoveryFits<2> recovery_fits<2>(const Approximation<2>&);
template Fields<2> recover_fields<2>(const Approximation<2>&, const Solution<2>&, const RecoveryFits<2>&);
template Fields<2> recover_fields<2>(const Approximation<2>&, const Solution<2>&);
template ProbeValues<2> probe<2>(const FineSpace<2>&, const Fields<2>&, const Location<2>&);
template Errors errors_against<2>(const Approximation<2>&, const Fields<2>&, const Materials<2>&,
                                  const ExactSolution<2>&);
template double mixed_distance<3>(const Approximation<3>&, const Points<3>&, const Fields<3>&, const Materials<3>&);
template std::vector<RecoveryError> recovery_errors<3>(const Approximation<3>&, const std::vector<const Fields<3>*>&,
                                                       const Materials<3>&);
template RecoveryError recovery_error<3>(const Approximation<3>&, const Fields<3>&, const Materials<3>&);
template RecoveryError recovery_error_of_points<3>(const Approximation<3>&, const VoigtPoints<3>&, const Fields<3>&,
                                                   const Materials<3>&);
template Vector recovery_products<3>(const Approximation<3>&, const Fields<3>&, const Fields<3>&, const Materials<3>&);
template double functional_error<3>(const Approximation<3>&, const Fields<3>&, const Fields<3>&, const Materials<3>&);
template std::vector<VoigtPoints<3>> stress_differences<3>(const Approximation<3>&, const Fields<3>&,
                                                           const Materials<3>&, Index);
template RecoveryFits<3> recovery_fits<3>(const Approximation<3>&);
template Fields<3> recover_fields<3>(const Approximation<3>&, const Solution<3>&, const RecoveryFits<3>&);
template Fields<3> recover_fields<3>(const Approximation<3>&, const Solution<3>&);
template ProbeValues<3> probe<3>(const FineSpace<3>&, const Fields<3>&, const Location<3>&);
template Errors errors_against<3>(const Approximation<3>&, const Fields<3>&, const Materials<3>&,
                                  const ExactSolution<3>&);

}  // namespace efree
