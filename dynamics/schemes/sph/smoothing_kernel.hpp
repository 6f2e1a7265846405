// SPDX-License-Identifier: GPL-3.0-or-later
/// Smoothing kernels of smoothed particle hydrodynamics. Their support is twice the smoothing length.
#pragma once

#include <cmath>
#include <numbers>

namespace efree {

enum class SmoothingKernel {
  cubic_spline,  ///< Monaghan & Lattanzio 1985
  wendland_c2,   ///< Wendland 1995: its Fourier transform is positive, so particles do not pair
};

/// Radius of the support over the smoothing length.
inline constexpr double kernel_support = 2.0;

namespace internal {

/// W = alpha w(q) / h^dim, q = r / h: alpha.
constexpr double kernel_norm(SmoothingKernel kernel, int dim) {
  constexpr double pi = std::numbers::pi;
  if (kernel == SmoothingKernel::cubic_spline) return dim == 2 ? 10.0 / (7.0 * pi) : 1.0 / pi;
  return dim == 2 ? 7.0 / (4.0 * pi) : 21.0 / (16.0 * pi);
}
/// w(q).
constexpr double kernel_shape(SmoothingKernel kernel, double q) {
  if (q >= 2.0) return 0.0;
  if (kernel == SmoothingKernel::cubic_spline) {
    if (q < 1.0) return 1.0 - 1.5 * q * q + 0.75 * q * q * q;
    return 0.25 * (2.0 - q) * (2.0 - q) * (2.0 - q);
  }
  const double s = 1.0 - 0.5 * q;
  return s * s * s * s * (2.0 * q + 1.0);
}
/// w'(q) / q, finite at 0.
constexpr double kernel_slope(SmoothingKernel kernel, double q) {
  if (q >= 2.0) return 0.0;
  if (kernel == SmoothingKernel::cubic_spline) return q < 1.0 ? -3.0 + 2.25 * q : -0.75 * (2.0 - q) * (2.0 - q) / q;
  const double s = 1.0 - 0.5 * q;
  return -5.0 * s * s * s;
}

}  // namespace internal

/// W(r) for the smoothing length h [1/length^dim].
inline double kernel_value(SmoothingKernel kernel, int dim, double r, double h) {
  return internal::kernel_norm(kernel, dim) / std::pow(h, dim) * internal::kernel_shape(kernel, r / h);
}
/// W'(r) / r [1/length^(dim + 2)]: the gradient by the position of one particle is that times its distance vector from
/// the other.
inline double kernel_slope_over_distance(SmoothingKernel kernel, int dim, double r, double h) {
  const double power = h * h * h * h * (dim == 3 ? h : 1.0);
  return internal::kernel_norm(kernel, dim) * internal::kernel_slope(kernel, r / h) / power;
}

}  // namespace efree
