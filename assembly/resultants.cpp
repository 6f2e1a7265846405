// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/resultants.hpp"

#include <algorithm>

namespace efree {

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

template double imbalance<2>(const std::vector<Resultant<2>>&, double, bool, double);
template double imbalance<3>(const std::vector<Resultant<3>>&, double, bool, double);

}  // namespace efree
