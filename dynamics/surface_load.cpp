// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/internal/surface_loads.hpp"

namespace efree {

template <int Dim> std::unique_ptr<Interaction<Dim>> surface_load(SurfaceLoad<Dim> load) {
  const auto valid = [](const Vec<Dim>& of) { return of.allFinite() && (of.array() >= 0.0).all(); };
  require(valid(load.stiffness) && valid(load.damping),
          "a load on a surface: expected stiffness and damping of 0 or more");
  require(load.traction || load.pressure || !load.stiffness.isZero(0.0) || !load.damping.isZero(0.0),
          "a load on a surface: expected a traction, a pressure, springs or dampers");
  return std::make_unique<internal::SurfaceLoads<Dim>>(std::move(load));
}

template std::unique_ptr<Interaction<2>> surface_load(SurfaceLoad<2>);
template std::unique_ptr<Interaction<3>> surface_load(SurfaceLoad<3>);

}  // namespace efree
