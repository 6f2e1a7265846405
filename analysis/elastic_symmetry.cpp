// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/elastic_symmetry.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/spectrum.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace efree {
namespace {

/// In Kelvin's notation, where the Frobenius norm of the matrix is that of the tensor.
ElasticTensor kelvin(const ElasticTensor& stiffness) {
  ElasticTensor result = stiffness;
  result.bottomRows<3>() *= std::sqrt(2.0);
  result.rightCols<3>() *= std::sqrt(2.0);
  return result;
}
ElasticTensor voigt_of(const ElasticTensor& in_kelvin) {
  ElasticTensor result = in_kelvin;
  result.bottomRows<3>() /= std::sqrt(2.0);
  result.rightCols<3>() /= std::sqrt(2.0);
  return result;
}

/// Of tensors of second order in Kelvin's notation, by the axes that are the columns of R.
ElasticTensor kelvin_rotation(const Mat<3>& R) {
  static constexpr std::array<std::array<int, 2>, 3> shears{{{1, 2}, {0, 2}, {0, 1}}};
  ElasticTensor Q;
  for (int b = 0; b < 6; ++b) {
    // The basis tensor b of the new axes, in the old ones.
    Mat<3> tensor;
    if (b < 3) {
      tensor = R.col(b) * R.col(b).transpose();
    } else {
      const auto [i, j] = shears[b - 3];
      tensor = std::sqrt(0.5) * (R.col(i) * R.col(j).transpose() + R.col(j) * R.col(i).transpose());
    }
    for (int a = 0; a < 3; ++a) {
      Q(a, b) = tensor(a, a);
      Q(a + 3, b) = std::sqrt(2.0) * tensor(shears[a][0], shears[a][1]);
    }
  }
  return Q;
}
ElasticTensor rotated(const ElasticTensor& in_kelvin, const Mat<3>& R) {
  const ElasticTensor Q = kelvin_rotation(R);
  return Q.transpose() * in_kelvin * Q;
}

ElasticTensor orthotropic_part(const ElasticTensor& k) {
  ElasticTensor result = ElasticTensor::Zero();
  result.topLeftCorner<3, 3>() = k.topLeftCorner<3, 3>();
  for (int a = 3; a < 6; ++a) result(a, a) = k(a, a);
  return result;
}
ElasticTensor cubic_part(const ElasticTensor& k) {
  ElasticTensor result = ElasticTensor::Zero();
  const double same = (k(0, 0) + k(1, 1) + k(2, 2)) / 3.0, other = (k(0, 1) + k(0, 2) + k(1, 2)) / 3.0;
  result.topLeftCorner<3, 3>().setConstant(other);
  result.topLeftCorner<3, 3>().diagonal().setConstant(same);
  result.bottomRightCorner<3, 3>().diagonal().setConstant((k(3, 3) + k(4, 4) + k(5, 5)) / 3.0);
  return result;
}
ElasticTensor isotropic_part(const ElasticTensor& k) {
  const double three_kappa = k.topLeftCorner<3, 3>().sum() / 3.0, two_mu = (k.trace() - three_kappa) / 5.0;
  ElasticTensor result = two_mu * ElasticTensor::Identity();
  result.topLeftCorner<3, 3>().array() += (three_kappa - two_mu) / 3.0;
  return result;
}
ElasticTensor transversely_isotropic_part(const ElasticTensor& k, int axis) {
  const int a = (axis + 1) % 3, b = (axis + 2) % 3;
  const double sum = 0.5 * (k(a, a) + k(b, b)) + k(a, b),
               difference = 0.5 * (0.5 * (k(a, a) + k(b, b)) - k(a, b) + k(3 + axis, 3 + axis));
  ElasticTensor result = ElasticTensor::Zero();
  result(a, a) = result(b, b) = 0.5 * (sum + difference);
  result(a, b) = result(b, a) = 0.5 * (sum - difference);
  result(3 + axis, 3 + axis) = difference;
  result(axis, axis) = k(axis, axis);
  for (const int c : {a, b}) result(axis, c) = result(c, axis) = 0.5 * (k(axis, a) + k(axis, b));
  for (const int c : {a, b}) result(3 + c, 3 + c) = 0.5 * (k(3 + a, 3 + a) + k(3 + b, 3 + b));
  return result;
}

using Projection = ElasticTensor (*)(const ElasticTensor&);

/// Distance of a tensor in axes R from its projection.
double distance_in(const ElasticTensor& in_kelvin, const Mat<3>& R, Projection project) {
  const ElasticTensor there = rotated(in_kelvin, R);
  return (there - project(there)).norm();
}

/// Turns axes by smaller and smaller angles as long as that brings the tensor closer to its projection.
double improve(const ElasticTensor& in_kelvin, Mat<3>& R, Projection project) {
  double distance = distance_in(in_kelvin, R, project);
  for (double angle = 0.3; angle > 1e-8; angle *= 0.5) {
    bool better = true;
    for (int turns = 0; better && turns < 20; ++turns) {
      better = false;
      for (int d = 0; d < 3; ++d)
        for (const double sign : {1.0, -1.0}) {
          const Mat<3> turned = R * Eigen::AngleAxisd(sign * angle, Vec<3>::Unit(d)).toRotationMatrix();
          const double there = distance_in(in_kelvin, turned, project);
          if (!(there < distance * (1.0 - 1e-12))) continue;
          distance = there;
          R = turned;
          better = true;
        }
    }
  }
  return distance;
}

/// The axes of least distance from some starts; those of the image, the first, unless others are better by `worth`.
std::pair<Mat<3>, double> best_axes(const ElasticTensor& in_kelvin, const std::vector<Mat<3>>& starts,
                                    Projection project, double worth) {
  Mat<3> best = starts.front();
  double least = distance_in(in_kelvin, best, project);
  bool is_first = true;
  for (Mat<3> R : starts) {
    const double distance = improve(in_kelvin, R, project);
    if (!(distance < least - (is_first ? worth : 1e-6 * worth))) continue;
    is_first = false;
    least = distance;
    best = R;
  }
  return {best, least};
}

/// The same axes, in the order and with the signs that are next to x, y and z.
Mat<3> sorted_axes(const Mat<3>& R) {
  std::array<int, 3> order{0, 1, 2}, best = order;
  double most = -1.0;
  do {
    double sum = 0.0;
    for (int d = 0; d < 3; ++d) sum += std::abs(R(d, order[d]));
    if (sum <= most + 1e-9) continue;
    most = sum;
    best = order;
  } while (std::ranges::next_permutation(order).found);
  Mat<3> result;
  for (int d = 0; d < 3; ++d) result.col(d) = R(d, best[d]) < 0.0 ? Vec<3>(-R.col(best[d])) : Vec<3>(R.col(best[d]));
  return result;
}

}  // namespace

double norm_of(const ElasticTensor& stiffness) {
  return kelvin(stiffness).norm();
}

ElasticTensor in_axes(const ElasticTensor& stiffness, const Mat<3>& axes) {
  return voigt_of(rotated(kelvin(stiffness), axes));
}

EngineeringConstants engineering_constants(const ElasticTensor& S) {
  EngineeringConstants constants;
  for (int d = 0; d < 3; ++d) {
    constants.E[d] = 1.0 / S(d, d);
    constants.G[d] = 1.0 / S(3 + d, 3 + d);
  }
  constants.nu = {-S(1, 2) / S(1, 1), -S(0, 2) / S(0, 0), -S(0, 1) / S(0, 0)};
  return constants;
}

double youngs_modulus(const ElasticTensor& compliance, const Vec<3>& n) {
  Vec<6> nn;
  nn << n[0] * n[0], n[1] * n[1], n[2] * n[2], n[1] * n[2], n[0] * n[2], n[0] * n[1];
  return 1.0 / nn.dot(compliance * nn);
}

std::string text_of(SymmetryClass symmetry) {
  static const std::array<const char*, 5> names{"isotropic", "cubic", "transversely isotropic", "orthotropic",
                                                "lower than orthotropic"};
  return names[static_cast<std::size_t>(symmetry)];
}

ElasticSymmetry symmetry_of(const ElasticTensor& stiffness) {
  const ElasticTensor k = kelvin(stiffness);
  const double norm = k.norm();
  if (!(norm > 0.0)) throw InputError("a stiffness of zero has no symmetry");
  // Where the nearest orthotropic axes may be: those of the image, of the dilatational and of Voigt's tensor (Cowin &
  // Mehrabadi 1987), which say nothing where these are isotropic, and some in between.
  Mat<3> dilatational = Mat<3>::Zero(), voigt = Mat<3>::Zero();
  static constexpr std::array<std::array<int, 3>, 3> index{{{0, 5, 4}, {5, 1, 3}, {4, 3, 2}}};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      for (int m = 0; m < 3; ++m) {
        dilatational(i, j) += stiffness(index[i][j], m);
        voigt(i, j) += stiffness(index[i][m], index[j][m]);
      }
  std::vector<Mat<3>> starts{Mat<3>::Identity(), internal::spectrum<3>(dilatational).vectors,
                             internal::spectrum<3>(voigt).vectors};
  for (const double angle : {0.4, 0.8})
    for (const Vec<3>& axis : {Vec<3>(1, 0, 0), Vec<3>(0, 1, 0), Vec<3>(0, 0, 1), Vec<3>(1, 1, 1), Vec<3>(1, -1, 1)})
      starts.emplace_back(Eigen::AngleAxisd(angle, axis.normalized()).toRotationMatrix());
  // Axes that hardly improve on those of the image are noise. Of a cubic tensor two diagonals of faces and an edge are
  // axes of orthotropy as well as the three edges are.
  const double worth = 1e-3 * norm;
  const auto [orthotropic, least] = best_axes(k, starts, orthotropic_part, worth);
  const auto [edges, least_cubic] = best_axes(k, starts, cubic_part, worth);
  ElasticSymmetry result;
  result.axes = sorted_axes(least_cubic < least + worth ? edges : orthotropic);
  const ElasticTensor there = rotated(k, result.axes);
  result.there = voigt_of(there);
  const ElasticTensor isotropic = isotropic_part(there), cubic = cubic_part(rotated(k, edges));
  result.distances = {(there - isotropic).norm() / norm, least_cubic / norm, 2.0,
                      (there - orthotropic_part(there)).norm() / norm};
  for (int axis = 0; axis < 3; ++axis) {
    const double distance = (there - transversely_isotropic_part(there, axis)).norm() / norm;
    if (!(distance < result.distances[2] - 1e-12)) continue;
    result.distances[2] = distance;
    result.special_axis = axis;
  }
  result.mu = 0.5 * isotropic(3, 3);
  result.kappa = isotropic.topLeftCorner<3, 3>().sum() / 9.0;
  result.zener = cubic(3, 3) / (cubic(0, 0) - cubic(0, 1));
  return result;
}

SymmetryClass nearest_class(const ElasticSymmetry& symmetry, double tolerance) {
  for (int c = 0; c < 4; ++c)
    if (symmetry.distances[c] <= tolerance) return static_cast<SymmetryClass>(c);
  return SymmetryClass::none;
}

double universal_anisotropy(const ElasticTensor& C, const ElasticTensor& S) {
  const auto diagonal = [](const ElasticTensor& T) { return T(0, 0) + T(1, 1) + T(2, 2); };
  const auto across = [](const ElasticTensor& T) { return T(0, 1) + T(0, 2) + T(1, 2); };
  const auto shear = [](const ElasticTensor& T) { return T(3, 3) + T(4, 4) + T(5, 5); };
  const double kappa_V = (diagonal(C) + 2.0 * across(C)) / 9.0, kappa_R = 1.0 / (diagonal(S) + 2.0 * across(S)),
               G_V = (diagonal(C) - across(C) + 3.0 * shear(C)) / 15.0,
               G_R = 15.0 / (4.0 * diagonal(S) - 4.0 * across(S) + 3.0 * shear(S));
  return 5.0 * G_V / G_R + kappa_V / kappa_R - 6.0;
}

}  // namespace efree
