// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/algorithms/internal/blend.hpp"

#include "efree/core/internal/vectors.hpp"
#include "efree/core/parallel.hpp"

namespace efree::internal {
namespace {

/// Rows of a table that follow each other, the first of them being that of x, displacement, strain and stress.
template <int Dim> struct Blended {
  Index count;
  const ShapeRow<Dim>* rows;
  const double *x, *nodes, *coefficients, *fits;
  double *displacement, *strain, *stress;
};

template <int Dim> EFREE_INLINE void blend_rows(const Blended<Dim>& points) {
  constexpr int size = voigt_size<Dim>, fours = size / 2;
  for (Index p = 0; p < points.count; ++p) {
    const ShapeRow<Dim>& row = points.rows[p];
    const double* x = points.x + Dim * p;
    Four sums[Dim + 1][fours] = {};
    double u[Dim] = {};
    for (std::size_t k = 0; k < row.nodes.size(); ++k) {
      const std::ptrdiff_t I = row.nodes[k];
      for (int d = 0; d < Dim; ++d) u[d] += row.N[k] * points.coefficients[Dim * I + d];
      const double* fit = points.fits + 2 * size * (Dim + 1) * I;
      for (int d = 0; d <= Dim; ++d) {
        const double factor = d == 0 ? row.N[k] : 0.5 * row.N[k] * (x[d - 1] - points.nodes[Dim * I + d - 1]);
        for (int i = 0; i < fours; ++i) {
          Four f;
          load(f, fit + 2 * size * d + 4 * i);
          sums[d][i] += factor * f;
        }
      }
    }
    double both[2 * size];
    for (int i = 0; i < fours; ++i) {
      for (int d = 1; d <= Dim; ++d) sums[0][i] += sums[d][i];
      store(both + 4 * i, sums[0][i]);
    }
    for (int d = 0; d < Dim; ++d) points.displacement[Dim * p + d] = u[d];
    for (int i = 0; i < size; ++i) points.strain[size * p + i] = both[i], points.stress[size * p + i] = both[size + i];
  }
}

EFREE_FOR_EACH_MACHINE void blend_2(const Blended<2>& points) {
  blend_rows<2>(points);
}
EFREE_FOR_EACH_MACHINE void blend_3(const Blended<3>& points) {
  blend_rows<3>(points);
}

}  // namespace

template <int Dim>
Fields<Dim> blend(const Approximation<Dim>& approximation, const Points<Dim>& coefficients, const Matrix& fits) {
  constexpr int size = voigt_size<Dim>;
  const Index count = approximation.shape.num_points();
  Fields<Dim> fields{Points<Dim>(Dim, count), VoigtPoints<Dim>(size, count), VoigtPoints<Dim>(size, count)};
  parallel_chunks(count, 256, [&](Index begin, Index end) {
    ShapeRow<Dim> rows[256];
    for (Index p = begin; p < end; ++p) rows[p - begin] = approximation.shape.row(p);
    const Blended<Dim> points{end - begin,
                              rows,
                              approximation.space.points().col(begin).data(),
                              approximation.nodes.data(),
                              coefficients.data(),
                              fits.data(),
                              fields.displacement.col(begin).data(),
                              fields.strain.col(begin).data(),
                              fields.stress.col(begin).data()};
    if constexpr (Dim == 2)
      blend_2(points);
    else
      blend_3(points);
  });
  return fields;
}

template Fields<2> blend<2>(const Approximation<2>&, const Points<2>&, const Matrix&);
template Fields<3> blend<3>(const Approximation<3>&, const Points<3>&, const Matrix&);

}  // namespace efree::internal
