// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/resultants.hpp"

#include <algorithm>

namespace efree {

template <int Dim>
Resultant<Dim> resultant_of(const FineSpace<Dim>& space, const Points<Dim>& forces, const Points<Dim>* moved_by) {
  Resultant<Dim> sum;
  for (Index dof = 0; dof < space.size(); ++dof) {
    if (forces.col(dof).isZero(0.0)) continue;
    Vec<Dim> x = space.points().col(dof);
    if (moved_by) x += moved_by->col(dof);
    sum.add(x, forces.col(dof));
  }
  if (space.axisymmetric()) sum.moment.setZero();
  return sum;
}

template <int Dim>
double imbalance(const std::vector<Resultant<Dim>>& all, double length, bool axisymmetric, double least) {
  Resultant<Dim> sum;
  double forces = least, moments = 0.0;
  for (const Resultant<Dim>& one : all) {
    sum += one;
    forces += one.force.norm();
    moments += one.moment.norm();
  }
  if (axisymmetric) sum.force[0] = 0.0;
  const auto relative = [](double left, double scale) { return left > 0.0 ? left / scale : 0.0; };
  return std::max(relative(sum.force.cwiseAbs().maxCoeff(), forces + moments / length),
                  relative(sum.moment.cwiseAbs().maxCoeff(), moments + forces * length));
}

template Resultant<2> resultant_of<2>(const FineSpace<2>&, const Points<2>&, const Points<2>*);
template Resultant<3> resultant_of<3>(const FineSpace<3>&, const Points<3>&, const Points<3>*);
template double imbalance<2>(const std::vector<Resultant<2>>&, double, bool, double);
template double imbalance<3>(const std::vector<Resultant<3>>&, double, bool, double);

}  // namespace efree
