// SPDX-License-Identifier: GPL-3.0-or-later
/// What a body is made of: the one seam between physics and everything else.
#pragma once

#include "efree/core/types.hpp"

#include <concepts>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace efree {

/// What a mesh in the plane stands for.
enum class Plane {
  stress,        ///< a thin plate, per unit thickness
  strain,        ///< a slice of a body that cannot stretch along z, per unit thickness
  axisymmetric,  ///< half of a meridian section, x the radius and y the axis: the body of revolution
};

/// Tensors of second order flattened by columns: T(i, J) is component i + 3 J. Column = point.
using Tensors = Points<9>;

/// Points of a body and how they are deformed.
struct Deformation {
  Points<3> X;      ///< 3 x n, where they are in the reference configuration [length]; in the plane z = 0
  Tensors F;        ///< 9 x n, deformation gradients
  Matrix history;   ///< Material::history_size() x n, before
  double dt = 0.0;  ///< since then [time]
  /// n, energy that came from elsewhere since then, as from shock viscosity [stress]; empty: none. Internal energies
  /// and temperatures rise by it; whoever brings it counts it.
  Vector heat{};

  /// Nothing has happened to the points yet.
  static Deformation none(Points<3> X, Index history_size = 0);
  Index size() const { return static_cast<Index>(F.cols()); }
  double heat_at(Index p) const { return heat.size() == 0 ? 0.0 : heat[p]; }
  Mat<3> gradient(Index p) const { return Eigen::Map<const Mat<3>>(F.col(p).data()); }
};

/// What a material answers to a deformation. The work of P is the change of `energy`, and what is `dissipated`.
struct MaterialResponse {
  Tensors P;             ///< 9 x n, first Piola-Kirchhoff stress
  Matrix history;        ///< Material::history_size() x n, after
  Vector energy;         ///< n, stored energy: without heat, whether it came or was dissipated [stress]
  Points<81> A;          ///< 81 x n, dP(i,J)/dF(k,L) in row (i + 3 J) + 9 (k + 3 L); empty if it is not wanted
  bool tangent = false;  ///< whether A is wanted
  Vector dissipated;     ///< n, energy turned into heat or new surface by this step [stress]

  using Tangent = Eigen::Matrix<double, 9, 9>;
  Eigen::Map<Mat<3>> stress(Index p) { return Eigen::Map<Mat<3>>(P.col(p).data()); }
  /// By component i + 3 J of P and k + 3 L of F.
  Eigen::Map<Tangent> tangent_at(Index p) { return Eigen::Map<Tangent>(A.col(p).data()); }
  Eigen::Map<const Tangent> tangent_at(Index p) const { return Eigen::Map<const Tangent>(A.col(p).data()); }
};

/// Rows of a history that belong together.
struct HistoryPart {
  std::string name;  ///< as in "equivalent_plastic_strain"
  Index offset;      ///< the first of them
  Index size;        ///< one: a scalar; six: a symmetric tensor, in Voigt order xx, yy, zz, yz, xz, xy
};

/// How strains are measured: by the symmetric part of F - I, or by what F makes of lengths, whatever the rotation.
enum class Strain { small, finite };

/// A material in three dimensions. Whoever asks brings the kinematics: plane strain has F with a z of its own, plane
/// stress is a material around another (PlaneStress).
class Material {
 public:
  virtual ~Material() = default;

  /// Numbers that a point remembers; all zero where nothing has happened yet.
  virtual Index history_size() const { return 0; }
  /// Whether points differ in nothing but F and history: then one of them is asked for all.
  virtual bool homogeneous() const { return false; }
  /// Whether P is linear in F - I and nothing is remembered: then the tangent where nothing has happened says all, and
  /// is asked for once.
  virtual bool linear() const { return false; }
  /// Whether it is meant for finite strains and rotations: P turns with the body. Else P is a stress of sym(F - I).
  virtual bool finite_strain() const { return !linear(); }
  /// Whether nothing is ever dissipated: `energy` is the potential of P.
  virtual bool elastic() const { return history_size() == 0; }
  /// Whether A is symmetric. Then energy + dissipated is, for a given history, the potential of P.
  virtual bool symmetric() const { return true; }
  /// What the rows of a history mean, for output.
  virtual std::vector<HistoryPart> history_parts() const { return {}; }
  /// Fills `response` (which has the right sizes) for all points. Pure: the same for the same deformation, from any
  /// number of threads. Throws InputError for parameters out of range and NumericalError for deformations to which
  /// there is no answer, with the place.
  virtual void respond(const Deformation& deformation, MaterialResponse& response) const = 0;
};

/// A response with the sizes that a deformation takes, and what the material says.
MaterialResponse respond(const Material& material, const Deformation& deformation, bool tangent);

/// Stiffness against dilatation over that against shear, of a symmetric tangent: K / G of an isotropic material. From 5
/// (nu = 0.4) on functions begin to lock, beyond 50 (nu = 0.49) quadratic elements do. K is 1 / (I : A^-1 : I), G half
/// of the smallest eigenvalue of A - K I I beside the zero of the strain by pressure: soft shear is what locks.
double incompressibility(const MaterialResponse::Tangent& A);

/// A material of which there may be many copies.
class SharedMaterial {
 public:
  SharedMaterial() = default;
  template <std::derived_from<Material> M> SharedMaterial(M material)
      : material_(std::make_shared<const M>(std::move(material))) {}

  explicit operator bool() const { return material_ != nullptr; }
  /// Throws InputError if there is none.
  const Material& operator*() const;
  const Material* operator->() const { return &**this; }

 private:
  std::shared_ptr<const Material> material_;
};

/// A number, or one that depends on the place.
class Parameter {
 public:
  Parameter(double value) : value_(value) {}
  Parameter(ScalarField<3> field) : field_(std::move(field)) {}
  template <std::invocable<Vec<3>> Field> Parameter(Field field) : field_(std::move(field)) {}

  bool is_constant() const { return !field_; }
  double at(const Vec<3>& X) const { return field_ ? field_(X) : value_; }

 private:
  double value_ = 0.0;
  ScalarField<3> field_;
};

/// Another material in plane stress: the strains across the plane, zz, yz and xz, are such that their stresses vanish
/// (found by Newton's method; at once if the material is linear). P and A are what is left for the others. Remembers
/// the three strains beside the other's history. Throws NumericalError naming the point where none are found.
class PlaneStress final : public Material {
 public:
  explicit PlaneStress(SharedMaterial of) : of_(std::move(of)) {}
  Index history_size() const override { return of_->history_size() + 3; }
  bool homogeneous() const override { return of_->homogeneous(); }
  bool linear() const override { return of_->linear(); }
  bool finite_strain() const override { return of_->finite_strain(); }
  bool elastic() const override { return of_->elastic(); }
  bool symmetric() const override { return of_->symmetric(); }
  std::vector<HistoryPart> history_parts() const override;
  void respond(const Deformation& deformation, MaterialResponse& response) const override;

  /// The strains zz, yz, xz that make the stresses across the plane vanish, by the gradient, from the other's tangent.
  static Eigen::Matrix<double, 3, 9> strains_across(const MaterialResponse::Tangent& A);
  /// What is left of that tangent.
  static MaterialResponse::Tangent condensed(const MaterialResponse::Tangent& A);

 private:
  SharedMaterial of_;
};

}  // namespace efree
