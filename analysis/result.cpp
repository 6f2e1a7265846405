// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/result.hpp"

namespace efree {

template <int Dim> Vector von_mises_at_places(const Result<Dim>& result) {
  const auto& stress = result.fields.stress;
  Vector mises(stress.cols());
  for (Index p = 0; p < mises.size(); ++p) mises[p] = von_mises<Dim>(Voigt<Dim>(stress.col(p)));
  return mises;
}

template Vector von_mises_at_places<2>(const Result<2>&);
template Vector von_mises_at_places<3>(const Result<3>&);

}  // namespace efree
