// SPDX-License-Identifier: GPL-3.0-or-later
/// Forces and moments of all that acts on a body, or on a part of it.
#pragma once

#include "efree/core/types.hpp"

#include <map>
#include <string>
#include <vector>

namespace efree {

/// A moment: in the plane its one component, about z.
template <int Dim> using Moment = Vec<Dim == 2 ? 1 : 3>;
/// Moment about the origin of a force at x.
template <int Dim> Moment<Dim> moment_of(const Vec<Dim>& x, const Vec<Dim>& force) {
  if constexpr (Dim == 2)
    return Moment<2>(x[0] * force[1] - x[1] * force[0]);
  else
    return {x[1] * force[2] - x[2] * force[1], x[2] * force[0] - x[0] * force[2], x[0] * force[1] - x[1] * force[0]};
}

/// What forces are together [force; in the plane per thickness]. Axisymmetric they are those of the whole turn: the
/// component along the axis is their resultant, the radial one their sum around the axis (forces that point all around
/// have none, and hoops balance them), and there is no moment.
template <int Dim> struct Resultant {
  Vec<Dim> force = Vec<Dim>::Zero();
  Moment<Dim> moment = Moment<Dim>::Zero();  ///< about the origin [force * length]

  void add(const Vec<Dim>& x, const Vec<Dim>& f) {
    force += f;
    moment += moment_of<Dim>(x, f);
  }
  Resultant& operator+=(const Resultant& other) {
    force += other.force;
    moment += other.moment;
    return *this;
  }
  Resultant operator*(double factor) const { return {factor * force, factor * moment}; }
};

/// By part of the boundary.
template <int Dim> using Resultants = std::map<std::string, Resultant<Dim>>;

/// What is out of balance, relative: the largest component of the sum of all resultants over the sum of their sizes,
/// and of moments over that or the sum of forces times `length` (the size of the body). Axisymmetric: along the axis.
/// Forces below `least` are rounding: what is out of balance is over no less than that.
template <int Dim>
double imbalance(const std::vector<Resultant<Dim>>& all, double length, bool axisymmetric = false, double least = 0.0);

}  // namespace efree
