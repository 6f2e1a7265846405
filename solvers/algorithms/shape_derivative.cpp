// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/algorithms/shape_derivative.hpp"

#include "efree/assembly/internal/boundary_points.hpp"
#include "efree/assembly/loads.hpp"
#include "efree/assembly/operators.hpp"
#include "efree/core/parallel.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace efree {
namespace {

/// Values of the quadratic functions of a facet's points (facet_offsets) at a barycentric point of it.
template <int Dim> Vec<facet_points<Dim>> facet_functions(const Vec<Dim>& at) {
  Vec<facet_points<Dim>> N;
  int row = 0;
  for (; row < Dim; ++row) N[row] = at[row] * (2.0 * at[row] - 1.0);
  for (int i = 0; i < Dim; ++i)
    for (int j = i + 1; j < Dim; ++j) N[row++] = 4.0 * at[i] * at[j];
  return N;
}

/// Their derivatives by the barycentric coordinates.
template <int Dim> Eigen::Matrix<double, facet_points<Dim>, Dim> facet_slopes(const Vec<Dim>& at) {
  Eigen::Matrix<double, facet_points<Dim>, Dim> dN = Eigen::Matrix<double, facet_points<Dim>, Dim>::Zero();
  int row = 0;
  for (; row < Dim; ++row) dN(row, row) = 4.0 * at[row] - 1.0;
  for (int i = 0; i < Dim; ++i)
    for (int j = i + 1; j < Dim; ++j, ++row) dN(row, i) = 4.0 * at[j], dN(row, j) = 4.0 * at[i];
  return dN;
}

/// The area vector of a facet's surface beside a point of it, over the area of the facet. `offsets`: as vectors, column
/// = point of the facet.
template <int Dim>
Vec<Dim> area_vector(const FineMesh<Dim>& mesh, Index f, const Points<Dim>& offsets, const Vec<Dim>& at) {
  Points<Dim> corners(Dim, Dim);
  for (int k = 0; k < Dim; ++k) corners.col(k) = mesh.vertex(mesh.facets()(k, f));
  const Mat<Dim> by_barycentric = corners + offsets * facet_slopes<Dim>(at);
  if constexpr (Dim == 2) {
    const Vec<2> along = by_barycentric.col(1) - by_barycentric.col(0);
    return Vec<2>(along.y(), -along.x()) / mesh.facet_measure(f);
  } else {
    const Vec<3> a = by_barycentric.col(1) - by_barycentric.col(0), b = by_barycentric.col(2) - by_barycentric.col(0);
    return 0.5 * a.cross(b) / mesh.facet_measure(f);
  }
}

/// A displacement at a point of a facet.
template <int Dim> struct FacetState {
  Vec<Dim> u;
  Mat<Dim> gradient;  ///< du_i / dX_j
  Voigt<Dim> strain, stress;
};

/// A point of the facet rule on a curved facet.
template <int Dim> struct FacetPoint {
  typename FineSpace<Dim>::Barycentric at;  ///< in the facet's cell
  Vec<Dim> x, shift;                        ///< position, and from it to the surface
  double weight;                            ///< area that the point stands for
  double offset;                            ///< to the surface along the normal
  Vec<Dim> area;                            ///< normal of the surface, times its area over the facet's
};

}  // namespace

double ShapeChange::size() const {
  return std::max(std::abs(sum), 0.05 * magnitude);
}

template <int Dim> struct ShapeDerivative<Dim>::Impl {
  const FineSpace<Dim>& space;
  const Materials<Dim>& materials;
  std::vector<Restraint<Dim>> springs{};
  std::vector<Index> curved{};               ///< facets
  std::vector<FacetPoint<Dim>> points{};     ///< as many for each of them
  std::vector<char> held{};                  ///< by curved facet: rigidly, or by the region beyond
  std::vector<Index> number{};               ///< by facet of the mesh: among the curved ones, or -1
  std::vector<std::vector<Index>> sprung{};  ///< by curved facet: springs on it

  /// By curved facet: the tractions on it.
  using Tractions = std::vector<std::vector<TractionCondition<Dim>>>;

  Index points_per_facet() const { return static_cast<Index>(space.facet_rule().weights.size()); }
  Vec<Dim> normal(Index k) const { return space.mesh().facet_normal(curved[k]); }

  template <class Body> void for_each_curved(const std::string& part, const Body& body) const {
    for (const Index f : space.mesh().group(part))
      if (number[f] >= 0) body(number[f]);
  }

  void add_facet(Index f, const Points<Dim>& offsets) {
    const auto& rule = space.facet_rule();
    const FineMesh<Dim>& mesh = space.mesh();
    const Vec<Dim> n = mesh.facet_normal(f);
    for (Index q = 0; q < rule.weights.size(); ++q) {
      const Vec<Dim> on_facet = rule.points.col(q);
      const auto at = space.facet_point(f, on_facet);
      const Vec<Dim> x = space.position(mesh.facet_cell(f), at), shift = offsets * facet_functions<Dim>(on_facet);
      points.push_back({at, x, shift, mesh.facet_measure(f) * rule.weights[q] * space.measure(x), shift.dot(n),
                        area_vector(mesh, f, offsets, on_facet)});
    }
    number[f] = static_cast<Index>(curved.size());
    curved.push_back(f);
  }

  Tractions tractions_of(const Loads<Dim>& loads) const {
    Tractions on(curved.size());
    const auto add = [&](const TractionCondition<Dim>& load) {
      for_each_curved(load.on, [&](Index k) { on[k].push_back(load); });
    };
    for (const auto& load : loads.tractions) add(load);
    for (const auto& load : loads.resultants) {
      AreaMoments<Dim> part;
      internal::for_each_point<Dim>(space, space.mesh().group(load.on),
                                    [&](const auto& point) { part.add(point.x, point.weight); });
      if (space.axisymmetric())
        add({load.on, [t = Vec<Dim>(load.force / part.area)](const Vec<Dim>&, const Vec<Dim>&) { return t; }});
      else
        add(part.traction(load));
    }
    return on;
  }

  Vec<Dim> body_force(const Loads<Dim>& loads, Index region, const Vec<Dim>& x) const {
    Vec<Dim> force = Vec<Dim>::Zero();
    if (loads.body_force) force += loads.body_force(x);
    Vec<3> place = Vec<3>::Zero();
    place.template head<Dim>() = x;
    for (const auto& load : loads.mass_forces) force += loads.density[region].at(place) * load.per_mass(x);
    return force;
  }

  /// Of a displacement on curved facet k, where its traction is t unless it is held.
  FacetState<Dim> state(Index k, const FacetPoint<Dim>& point, const Points<Dim>& u, Vec<Dim> t) const {
    const Index c = space.mesh().facet_cell(curved[k]);
    const Vec<Dim> n = normal(k);
    FacetState<Dim> out;
    out.u.setZero();
    const auto dofs = space.cell(c);
    const auto N = space.values(point.at);
    for (std::size_t i = 0; i < dofs.size(); ++i) out.u += N[static_cast<Index>(i)] * u.col(dofs[i]);
    Gradient<Dim> H = gradient_at(space, c, point.at, u);
    Eigen::Map<Mat<Dim>> G(H.data());
    Stiffness<Dim> room;
    const VoigtMatrix<Dim>& C = materials.stiffness(space.mesh().region(c), point.x, room).C;
    if (!held[k]) {
      for (const Index s : sprung[k]) {
        const Vec<Dim> d = springs[s].direction(n);
        t -= springs[s].stiffness(point.x) * (d.dot(out.u) - springs[s].value(point.x)) * d;
      }
      G -= (G * n).eval() * n.transpose();
      Mat<Dim> acoustic;
      for (int j = 0; j < Dim; ++j) {
        Gradient<Dim> one = Gradient<Dim>::Zero();
        Eigen::Map<Mat<Dim>>(one.data()).row(j) = n.transpose();
        acoustic.col(j) = traction<Dim>(C * strain_of<Dim>(one), n);
      }
      const Vec<Dim> rest = t - traction<Dim>(C * strain_of<Dim>(H), n);
      G += acoustic.partialPivLu().solve(rest) * n.transpose();
    }
    out.gradient = G;
    out.strain = strain_of<Dim>(H);
    out.stress = C * out.strain;
    return out;
  }

  /// Work of the stresses of one displacement on the strains of the other, less that of what holds them.
  double pair(Index k, const FacetState<Dim>& a, const FacetState<Dim>& b) const {
    double work = a.stress.dot(b.strain);
    if (held[k]) {
      const Vec<Dim> n = normal(k);
      work -= traction<Dim>(a.stress, n).dot(b.gradient * n) + traction<Dim>(b.stress, n).dot(a.gradient * n);
    }
    return work;
  }

  /// What the loads do more on a displacement at the surface than at the facet, per area of the facet.
  double load_work(Index k, const FacetPoint<Dim>& point, const FacetState<Dim>& of, const Loads<Dim>& loads,
                   const std::vector<TractionCondition<Dim>>& on) const {
    const Vec<Dim> n = normal(k);
    double work = 0.0;
    if (loads.inside())
      work +=
          point.offset * body_force(loads, space.mesh().region(space.mesh().facet_cell(curved[k])), point.x).dot(of.u);
    if (held[k]) return work;
    const double area = point.area.norm();
    for (const auto& load : on)
      work += area * load.traction(point.x + point.shift, point.area / area).dot(of.u + of.gradient * point.shift) -
              load.traction(point.x, n).dot(of.u);
    return work;
  }

  /// Sums visit(k, point, its traction, tractions on the facet), work of stresses and of loads, times the weights of
  /// the points.
  template <class Visit> ShapeChange sum(const Loads<Dim>& loads, const Visit& visit) const {
    const Tractions tractions = tractions_of(loads);
    Vector stresses(static_cast<Index>(curved.size())), forces(stresses.size());
    parallel_for(static_cast<Index>(curved.size()), [&](Index k) {
      std::pair<double, double> total{0.0, 0.0};
      for (Index q = 0; q < points_per_facet(); ++q) {
        const FacetPoint<Dim>& point = points[k * points_per_facet() + q];
        Vec<Dim> t = Vec<Dim>::Zero();
        for (const auto& load : tractions[k]) t += load.traction(point.x, normal(k));
        const std::pair<double, double> there = visit(k, point, t, tractions[k]);
        total.first += point.weight * there.first;
        total.second += point.weight * there.second;
      }
      std::tie(stresses[k], forces[k]) = total;
    });
    return {stresses.sum() + forces.sum(), stresses.cwiseAbs().sum()};
  }
};

template <int Dim> ShapeDerivative<Dim>::ShapeDerivative(const FineSpace<Dim>& space, const Matrix& offsets,
                                                         const Materials<Dim>& materials,
                                                         const std::vector<DisplacementCondition<Dim>>& conditions,
                                                         const std::vector<TiedFacets>& ties)
    : impl_(new Impl{.space = space, .materials = materials}) {
  const FineMesh<Dim>& mesh = space.mesh();
  require(offsets.cols() == mesh.num_facets() && offsets.rows() == Dim * facet_points<Dim>,
          "shape derivative: offsets of every facet expected");
  impl_->number.assign(mesh.num_facets(), -1);
  for (Index f = 0; f < mesh.num_facets(); ++f)
    if (!offsets.col(f).isZero(0.0)) impl_->add_facet(f, offsets.col(f).reshaped(Dim, facet_points<Dim>));
  impl_->held.assign(impl_->curved.size(), 0);
  impl_->sprung.resize(impl_->curved.size());
  for (Restraint<Dim>& restraint : restraints(conditions)) {
    const auto spring = static_cast<Index>(impl_->springs.size());
    impl_->for_each_curved(restraint.on, [&](Index k) {
      if (restraint.is_elastic())
        impl_->sprung[k].push_back(spring);
      else
        impl_->held[k] = 1;
    });
    if (restraint.is_elastic()) impl_->springs.push_back(std::move(restraint));
  }
  for (const auto& [first, second] : ties)
    for (const Index f : {first, second})
      if (impl_->number[f] >= 0) impl_->held[impl_->number[f]] = 1;
}
template <int Dim> ShapeDerivative<Dim>::~ShapeDerivative() = default;
template <int Dim> ShapeDerivative<Dim>::ShapeDerivative(ShapeDerivative&&) noexcept = default;

template <int Dim> bool ShapeDerivative<Dim>::is_flat() const {
  return impl_->curved.empty();
}

template <int Dim>
ShapeChange ShapeDerivative<Dim>::potential_energy(const Points<Dim>& u, const Loads<Dim>& loads) const {
  return impl_->sum(loads, [&](Index k, const FacetPoint<Dim>& point, const Vec<Dim>& t, const auto& tractions) {
    const auto state = impl_->state(k, point, u, t);
    return std::pair(0.5 * point.offset * impl_->pair(k, state, state),
                     -impl_->load_work(k, point, state, loads, tractions));
  });
}

template <int Dim> ShapeChange ShapeDerivative<Dim>::functional(const Points<Dim>& u, const Points<Dim>& z,
                                                                const Loads<Dim>& loads) const {
  return impl_->sum(loads, [&](Index k, const FacetPoint<Dim>& point, const Vec<Dim>& t, const auto& tractions) {
    const auto of_u = impl_->state(k, point, u, t), of_z = impl_->state(k, point, z, Vec<Dim>::Zero());
    return std::pair(-point.offset * impl_->pair(k, of_u, of_z), impl_->load_work(k, point, of_z, loads, tractions));
  });
}

template class ShapeDerivative<2>;
template class ShapeDerivative<3>;

}  // namespace efree
