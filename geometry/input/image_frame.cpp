// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/internal/image_frame.hpp"

#include "efree/geometry/mesh/internal/extent.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace efree::internal {
namespace {

/// Headers have axes with five digits and more: what is farther from right angles is meant.
constexpr double most_shear = 1e-3;
/// Angles [rad] below which axes are those of the world: a thousandth of a voxel in a thousand.
constexpr double least_turn = 1e-6;

/// The rotation or reflection next to axes of length 1. Throws InputError for sheared ones.
template <int Dim> Mat<Dim> at_right_angles(const std::string& path, const Mat<Dim>& axes) {
  for (int d = 0; d < Dim; ++d)
    if (!(std::abs(axes.col(d).norm() - 1.0) <= most_shear))
      throw InputError(fmt::format("{}: its axis {}, ({:.4g}), has the length {:.4g}, expected 1: lengths are spacings",
                                   path, d + 1, fmt::join(axes.col(d), ", "), axes.col(d).norm()));
  const double shear = (axes.transpose() * axes - Mat<Dim>::Identity()).cwiseAbs().maxCoeff();
  if (!(shear <= most_shear)) {
    std::vector<std::string> columns;
    for (int d = 0; d < Dim; ++d) columns.push_back(fmt::format("({:.4g})", fmt::join(axes.col(d), ", ")));
    throw InputError(
        fmt::format("{}: its axes {} are not at right angles (the cosine between two is {:.2g}); resample it on a "
                    "grid that is not sheared",
                    path, fmt::join(columns, ", "), shear));
  }
  const Eigen::JacobiSVD<Mat<Dim>> svd(axes, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return svd.matrixU() * svd.matrixV().transpose();
}

/// Signs by which points of one anatomical world become those of another.
template <int Dim> Vec<Dim> change_of_world(const std::string& path, const std::string& from, const std::string& to) {
  if (to.empty() || from == to) return Vec<Dim>::Ones();
  if (from.empty())
    throw InputError(fmt::format("{}: it does not say its anatomical axes, so world = \"{}\" cannot be had", path, to));
  Vec<Dim> signs = Vec<Dim>::Ones();
  for (int d = 0; d < std::min(Dim, 2); ++d) signs[d] = from[d] == to[d] ? 1.0 : -1.0;
  return signs;
}

}  // namespace

template <int Dim>
ImageFrame<Dim>::ImageFrame(const std::string& path, const PixelValues& v, const ImageOptions<Dim>& options) {
  Vec<Dim> edges, in_file, corner;
  for (int d = 0; d < Dim; ++d) {
    in_file[d] = v.spacing[d];
    edges[d] = options.spacing.empty() ? v.spacing[d] : options.spacing[options.spacing.size() == 1 ? 0 : d];
    if (!(edges[d] > 0.0))
      throw InputError(fmt::format(
          "{}: the spacing of its pixels along {} is {}, expected a positive length ([geometry.image] spacing says "
          "another one)",
          path, "xyz"[d], edges[d]));
    corner[d] = v.origin[d];
  }
  Mat<Dim> axes = at_right_angles<Dim>(path, v.axes.topLeftCorner<Dim, Dim>());
  // The origin is a length as well, but not one in pixels: a spacing that is given leaves the first pixel's corner.
  if (v.centred && in_file.allFinite()) corner -= 0.5 * axes * in_file;
  if (v.top_first) {
    axes.col(1) *= -1.0;
    corner[1] += v.size[1] * edges[1];
  }
  const Vec<Dim> signs = change_of_world<Dim>(path, v.world, options.world);
  axes = signs.asDiagonal() * axes;
  corner = signs.asDiagonal() * corner;

  // Of the orders and signs that make a rotation of the axes, the one that turns least.
  std::array<int, Dim> order;
  std::iota(order.begin(), order.end(), 0);
  double nearest = -Dim - 1.0;
  Mat<Dim> turned;
  do {
    for (int signs_of = 0; signs_of < 1 << Dim; ++signs_of) {
      for (int d = 0; d < Dim; ++d) turned.col(d) = (signs_of >> d & 1 ? -1.0 : 1.0) * axes.col(order[d]);
      if (turned.determinant() < 0.0 || turned.trace() < nearest + 1e-9) continue;
      nearest = turned.trace();
      axes_ = turned;
      from_ = order;
      for (int d = 0; d < Dim; ++d) reversed_[d] = (signs_of >> d & 1) != 0;
    }
  } while (std::next_permutation(order.begin(), order.end()));
  if ((axes_ - Mat<Dim>::Identity()).cwiseAbs().maxCoeff() < least_turn) axes_.setIdentity();
  origin_ = corner;
  for (int d = 0; d < Dim; ++d) {
    size_[d] = v.size[from_[d]];
    spacing_[d] = edges[from_[d]];
    if (reversed_[d]) origin_ -= axes_.col(d) * (size_[d] * spacing_[d]);
  }
  Vec<Dim> far = origin_;
  for (int d = 0; d < Dim; ++d) far += axes_.col(d) * (size_[d] * spacing_[d]);
  require_extent<Dim>(origin_.cwiseMin(far), origin_.cwiseMax(far), path);
  describe(v, options, options.world.empty() ? v.world : options.world);
}

template <int Dim> bool ImageFrame<Dim>::is_as_in_file() const {
  for (int d = 0; d < Dim; ++d)
    if (from_[d] != d || reversed_[d]) return false;
  return true;
}

template <int Dim> Index ImageFrame<Dim>::size_in_file(int axis) const {
  for (int d = 0; d < Dim; ++d)
    if (from_[d] == axis) return size_[d];
  return 1;
}

template <int Dim>
void ImageFrame<Dim>::describe(const PixelValues& v, const ImageOptions<Dim>& options, const std::string& world) {
  const std::string from = !options.spacing.empty() ? "the case"
                           : v.spacing_from.empty() ? "nothing says it, taken as 1"
                                                    : v.spacing_from;
  remarks_.push_back(fmt::format("image: {} {}, spacing {:.6g} ({}), corner at ({:.6g}){}", fmt::join(size_, " x "),
                                 Dim == 2 ? "pixels" : "voxels", fmt::join(spacing_, " x "), from,
                                 fmt::join(origin_, ", "), world.empty() ? "" : fmt::format(", world {}", world)));
  std::vector<std::string> changed;
  for (int d = 0; d < Dim; ++d)
    if (from_[d] != d || (reversed_[d] && !(v.top_first && d == 1)))
      changed.push_back(fmt::format("{} is its {}{}", "xyz"[d], "ijk"[from_[d]], reversed_[d] ? " reversed" : ""));
  if (!changed.empty())
    remarks_.push_back(fmt::format("image: axes put in the order of the world's: {}", fmt::join(changed, ", ")));
  if (axes_ == Mat<Dim>::Identity()) return;
  std::vector<std::string> columns;
  for (int d = 0; d < Dim; ++d) columns.push_back(fmt::format("({:.4f})", fmt::join(axes_.col(d), ", ")));
  const double angle = std::acos(std::clamp(Dim == 2 ? axes_(0, 0) : 0.5 * (axes_.trace() - 1.0), -1.0, 1.0));
  remarks_.push_back(fmt::format(
      "image: turned by {:.4g} degrees, its axes are {}; conditions, loads, selections and results are in the world's "
      "axes, the sides (left, right, ...) are those of the turned frame",
      angle * 180.0 / std::numbers::pi, fmt::join(columns, ", ")));
}

template class ImageFrame<2>;
template class ImageFrame<3>;

}  // namespace efree::internal
