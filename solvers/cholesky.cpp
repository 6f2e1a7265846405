// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cholesky.hpp"

#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"

#include <cholmod.h>
#include <fmt/format.h>

extern "C" void openblas_set_num_threads(int);

namespace efree {

struct Cholesky::Impl {
  mutable cholmod_common common{};
  cholmod_factor* factor = nullptr;

  Impl() {
    openblas_set_num_threads(1);  // threaded BLAS sums in an order that depends on the number of threads
    cholmod_start(&common);
    common.print = 0;
    common.supernodal = CHOLMOD_SUPERNODAL;
    common.quick_return_if_not_posdef = 1;
  }
  ~Impl() {
    cholmod_free_factor(&factor, &common);
    cholmod_finish(&common);
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  void check() const {
    if (common.status == CHOLMOD_OUT_OF_MEMORY) throw NumericalError("Cholesky factorisation: not enough memory");
    if (common.status < 0)
      throw NumericalError(fmt::format("Cholesky factorisation: CHOLMOD status {}", common.status));
  }
};

Cholesky::Cholesky(const SymmetricMatrix& lower) : impl_(std::make_unique<Impl>()) {
  cholmod_sparse view{};
  view.nrow = view.ncol = static_cast<std::size_t>(lower.rows());
  view.nzmax = static_cast<std::size_t>(lower.nonZeros());
  view.p = const_cast<Index*>(lower.outerIndexPtr());
  view.i = const_cast<Index*>(lower.innerIndexPtr());
  view.x = const_cast<double*>(lower.valuePtr());
  view.stype = -1;
  view.itype = CHOLMOD_INT;
  view.xtype = CHOLMOD_REAL;
  view.dtype = CHOLMOD_DOUBLE;
  view.sorted = view.packed = 1;
  impl_->factor = cholmod_analyze(&view, &impl_->common);
  if (impl_->common.status == CHOLMOD_TOO_LARGE)
    throw InputError(
        fmt::format("Cholesky factorisation: {} unknowns are too many; use a wider cloud spacing or a "
                    "coarser mesh",
                    lower.rows()));
  impl_->check();
  require_memory(sizeof(double) * factor_entries(), fmt::format("Cholesky factorisation: {} unknowns", lower.rows()),
                 "use a wider cloud spacing or a coarser mesh");
  cholmod_factorize(&view, impl_->factor, &impl_->common);
  impl_->check();
  if (impl_->common.status == CHOLMOD_NOT_POSDEF || impl_->factor->minor < impl_->factor->n) {
    const auto* permutation = static_cast<const int*>(impl_->factor->Perm);
    throw NumericalError(fmt::format("the matrix is not positive definite (at unknown {} of {})",
                                     permutation[impl_->factor->minor], lower.rows()));
  }
  // Rounding can hide a zero pivot; what it leaves is no stiffness.
  constexpr double smallest_pivot_ratio = 1e-13;
  if (const double ratio = cholmod_rcond(impl_->factor, &impl_->common); ratio < smallest_pivot_ratio)
    throw NumericalError(
        fmt::format("the matrix is singular to working precision (smallest over largest pivot {:.1e})", ratio));
}

Cholesky::~Cholesky() = default;
Cholesky::Cholesky(Cholesky&&) noexcept = default;
Cholesky& Cholesky::operator=(Cholesky&&) noexcept = default;

Matrix Cholesky::solve(const Eigen::Ref<const Matrix>& B) const {
  if (B.rows() != static_cast<Eigen::Index>(impl_->factor->n))
    throw InputError(fmt::format("Cholesky solve: {} rows, expected {}", B.rows(), impl_->factor->n));
  Matrix copy = B;
  cholmod_dense view{};
  view.nrow = view.d = static_cast<std::size_t>(copy.rows());
  view.ncol = static_cast<std::size_t>(copy.cols());
  view.nzmax = view.nrow * view.ncol;
  view.x = copy.data();
  view.xtype = CHOLMOD_REAL;
  view.dtype = CHOLMOD_DOUBLE;
  cholmod_dense* X = cholmod_solve(CHOLMOD_A, impl_->factor, &view, &impl_->common);
  impl_->check();
  copy = Eigen::Map<const Matrix>(static_cast<const double*>(X->x), copy.rows(), copy.cols());
  cholmod_free_dense(&X, &impl_->common);
  return copy;
}

double Cholesky::factor_entries() const {
  return static_cast<double>(impl_->factor->is_super ? impl_->factor->xsize : impl_->factor->nzmax);
}

}  // namespace efree
