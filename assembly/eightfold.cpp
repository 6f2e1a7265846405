// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/internal/eightfold.hpp"

#include "efree/core/internal/vectors.hpp"
#include "efree/core/parallel.hpp"

#include <array>

namespace efree {

using internal::Eight;
using internal::load;
using internal::store;

template <int Dim> Eightfold<Dim>::Eightfold(std::span<const Points<Dim>* const> vectors)
    : Eightfold(static_cast<Index>(vectors.front()->cols())) {
  parallel_chunks(nodes_, 8192, [&](Index begin, Index end) {
    std::array<const double*, 8> from{};
    for (std::size_t c = 0; c < vectors.size(); ++c) from[c] = vectors[c]->data();
    double* to = at(begin);
    for (std::size_t i = Dim * static_cast<std::size_t>(begin); i < Dim * static_cast<std::size_t>(end); ++i, to += 8)
      for (std::size_t c = 0; c < 8; ++c) to[c] = from[c] ? from[c][i] : 0.0;
  });
}

template <int Dim> void Eightfold<Dim>::unpack(std::span<Points<Dim>* const> vectors) const {
  for (Points<Dim>* one : vectors) one->resize(Dim, nodes_);
  parallel_chunks(nodes_, 8192, [&](Index begin, Index end) {
    std::array<double*, 8> to{};
    for (std::size_t c = 0; c < vectors.size(); ++c) to[c] = vectors[c]->data();
    const double* from = at(begin);
    for (std::size_t i = Dim * static_cast<std::size_t>(begin); i < Dim * static_cast<std::size_t>(end); ++i, from += 8)
      for (std::size_t c = 0; c < vectors.size(); ++c) to[c][i] = from[c];
  });
}

namespace {

EFREE_INLINE const double* place(const double* of, int dim, Index node) {
  return of + 8 * dim * static_cast<std::ptrdiff_t>(node);
}
EFREE_INLINE double* place(double* of, int dim, Index node) {
  return of + 8 * dim * static_cast<std::ptrdiff_t>(node);
}

template <int Dim> EFREE_INLINE void multiply(const BlockRows& rows, const double* x, double* y) {
  for (Index i = 0; i < 8 * Dim * rows.count; ++i) place(y, Dim, rows.first)[i] = 0.0;
  for (Index r = 0; r < rows.count; ++r) {
    Eight moved[Dim], sum[Dim] = {};
    for (int p = 0; p < Dim; ++p) load(moved[p], place(x, Dim, rows.first + r) + 8 * p);
    for (Index k = rows.offsets[r]; k < rows.offsets[r + 1]; ++k) {
      const double* block = rows.blocks + Dim * Dim * static_cast<std::ptrdiff_t>(k);
      const double* from = place(x, Dim, rows.columns[k]);
      for (int q = 0; q < Dim; ++q) {
        Eight v;
        load(v, from + 8 * q);
        for (int p = 0; p < Dim; ++p) sum[p] += block[p + Dim * q] * v;
      }
      if (k < rows.own[r] || k >= rows.diagonal[r]) continue;
      double* mirrored = place(y, Dim, rows.columns[k]);
      for (int q = 0; q < Dim; ++q) {
        Eight v;
        load(v, mirrored + 8 * q);
        for (int p = 0; p < Dim; ++p) v += block[p + Dim * q] * moved[p];
        store(mirrored + 8 * q, v);
      }
    }
    double* to = place(y, Dim, rows.first + r);
    for (int p = 0; p < Dim; ++p) {
      Eight v;
      load(v, to + 8 * p);
      v += sum[p];
      store(to + 8 * p, v);
    }
  }
}

template <int Dim>
EFREE_INLINE void sweep(const BlockRows& rows, const double* inverse, const double* r, double* z, double* ahead) {
  for (Index i = 0; i < rows.count; ++i) {
    Eight rest[Dim];
    for (int p = 0; p < Dim; ++p) load(rest[p], place(r, Dim, rows.first + i) + 8 * p);
    for (Index k = rows.diagonal[i] - 1; k >= rows.own[i]; --k) {
      const double* block = rows.blocks + Dim * Dim * static_cast<std::ptrdiff_t>(k);
      const double* from = place(z, Dim, rows.columns[k]);
      for (int q = 0; q < Dim; ++q) {
        Eight v;
        load(v, from + 8 * q);
        for (int p = 0; p < Dim; ++p) rest[p] -= block[p + Dim * q] * v;
      }
    }
    const double* D = inverse + Dim * Dim * static_cast<std::ptrdiff_t>(rows.first + i);
    for (int p = 0; p < Dim; ++p) {
      Eight sum = D[p] * rest[0];
      for (int q = 1; q < Dim; ++q) sum += D[p + Dim * q] * rest[q];
      store(place(z, Dim, rows.first + i) + 8 * p, sum);
    }
  }
  for (Index i = 0; i < 8 * Dim * rows.count; ++i) ahead[i] = 0.0;
  for (Index i = rows.count - 1; i >= 0; --i) {
    Eight rest[Dim], moved[Dim];
    const double* D = inverse + Dim * Dim * static_cast<std::ptrdiff_t>(rows.first + i);
    double* at = place(z, Dim, rows.first + i);
    for (int p = 0; p < Dim; ++p) load(rest[p], place(ahead, Dim, i) + 8 * p), load(moved[p], at + 8 * p);
    for (int p = 0; p < Dim; ++p) {
      for (int q = 0; q < Dim; ++q) moved[p] -= D[p + Dim * q] * rest[q];
      store(at + 8 * p, moved[p]);
    }
    for (Index k = rows.own[i]; k < rows.diagonal[i]; ++k) {
      const double* block = rows.blocks + Dim * Dim * static_cast<std::ptrdiff_t>(k);
      double* to = place(ahead, Dim, rows.columns[k] - rows.first);
      for (int q = 0; q < Dim; ++q) {
        Eight v;
        load(v, to + 8 * q);
        for (int p = 0; p < Dim; ++p) v += block[p + Dim * q] * moved[p];
        store(to + 8 * q, v);
      }
    }
  }
}

}  // namespace

EFREE_FOR_EACH_MACHINE void multiply_eightfold_2(const BlockRows& rows, const double* x, double* y) {
  multiply<2>(rows, x, y);
}
EFREE_FOR_EACH_MACHINE void multiply_eightfold_3(const BlockRows& rows, const double* x, double* y) {
  multiply<3>(rows, x, y);
}
EFREE_FOR_EACH_MACHINE void sweep_eightfold_2(const BlockRows& rows, const double* inverse, const double* r, double* z,
                                              double* ahead) {
  sweep<2>(rows, inverse, r, z, ahead);
}
EFREE_FOR_EACH_MACHINE void sweep_eightfold_3(const BlockRows& rows, const double* inverse, const double* r, double* z,
                                              double* ahead) {
  sweep<3>(rows, inverse, r, z, ahead);
}

template class Eightfold<2>;
template class Eightfold<3>;

}  // namespace efree
