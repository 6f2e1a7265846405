// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/mpm/internal/separation.hpp"

#include "efree/core/internal/spectrum.hpp"

#include <cmath>

namespace efree::internal {

template <int Dim> void find_separated(const MpmOptions& options, const Chunk<Dim>& chunk, const double* stress,
                                       Particles<Dim>& particles) {
  constexpr double failed = 1e-6;  // tension over the modulus that is none
  const double most = std::pow((options.degree == 3 ? 0.75 : 0.6) * options.cell, Dim);
  const Matter<Dim>& matter = chunk.matter;
  particles.newly_separated = 0;
  for (Index p = 0; p < chunk.size(); ++p) {
    if (particles.separated[p] != 0 || chunk.is_eroded(p)) continue;
    // Neighbours are as far away as a cube of the point's volume is long, stretched as the point is.
    const auto is_far = [&](double squared) {
      return matter.volume[p] * squared * (Dim == 2 ? 1.0 : std::sqrt(squared)) > most;
    };
    const Mat<Dim> F = matter.now.gradient(p).template topLeftCorner<Dim, Dim>();
    const Mat<Dim> C = F.transpose() * F;
    const double mean = C.trace() / Dim, spread = (C - mean * Mat<Dim>::Identity()).norm();
    if (!is_far(mean + std::sqrt((Dim - 1.0) / Dim) * spread)) continue;  // no less than the largest stretch squared
    const auto [stretches, axes] = spectrum<Dim>(C);
    if (!is_far(stretches[Dim - 1])) continue;
    // A material that has failed lets go of them itself.
    const Vec<Dim> along = F * axes.col(Dim - 1);
    double tension = 0.0;
    for (int i = 0; i < Dim; ++i)
      for (int j = 0; j < Dim; ++j) tension += along[i] * stress[16 * p + 4 * j + i] * along[j];
    if (!(tension > failed * matter.modulus[p] * along.squaredNorm())) continue;
    particles.separated[p] = 1;
    ++particles.newly_separated;
  }
}

template void find_separated(const MpmOptions&, const Chunk<2>&, const double*, Particles<2>&);
template void find_separated(const MpmOptions&, const Chunk<3>&, const double*, Particles<3>&);

}  // namespace efree::internal
