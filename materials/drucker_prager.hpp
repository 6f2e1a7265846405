// SPDX-License-Identifier: GPL-3.0-or-later
/// Plasticity of soil, rock and concrete.
#pragma once

#include "efree/materials/hardening.hpp"
#include "efree/materials/plasticity.hpp"

#include <optional>

namespace efree {

/// Where the cone of Drucker and Prager touches the pyramid of Mohr and Coulomb.
enum class ConeFit {
  compression,   ///< at its outer edges: the same strength in triaxial compression
  extension,     ///< at its inner edges: the same strength in triaxial extension
  plane_strain,  ///< the same limit load in plane strain, of associated flow
};

/// What a material with cohesion and friction is given by.
struct DruckerPragerParameters {
  ElasticModuli moduli;
  Hardening cohesion;                    ///< [stress], of the equivalent plastic strain
  double friction = 0.0;                 ///< angle [rad], in [0, pi / 2)
  std::optional<double> dilatancy = {};  ///< angle [rad], in [0, friction]; associated flow if it is not given
  ConeFit fit = ConeFit::compression;
  Strain strain = Strain::small;
};

/// sqrt(J2) + eta p <= xi c(a), flow along the derivative of sqrt(J2) + eta' p, a the work over the cohesion, p the
/// mean stress, positive in tension (Drucker & Prager 1952; de Souza Neto, Peric & Owen 2008, section 8.3). With dg the
/// plastic multiplier da = xi dg on the cone. Stresses beyond the apex p = xi c / eta return there, by plastic strains
/// of which what the cone does not make, dv, is volumetric; da = xi dg + xi / eta dv, the same for stresses that reach
/// the apex from the cone and for associated flow the book's. Dilatancy below friction makes A unsymmetric.
///
/// Without cohesion dv opens gaps between grains, which bear nothing until they have closed again (Tampubolon et al.
/// 2017): stress is by the trial strains and what is open. One number more is remembered for that.
class DruckerPrager final : public Plastic {
 public:
  /// Throws InputError for parameters out of range.
  explicit DruckerPrager(DruckerPragerParameters parameters);
  bool symmetric() const override { return eta_ == eta_flow_; }
  bool softens() const override { return cohesion_.falls(); }
  Index history_size() const override { return Plastic::history_size() + 1; }
  /// "opening_strain" besides: logarithmic volume strain of what is open.
  std::vector<HistoryPart> history_parts() const override;
  void respond(const Deformation& deformation, MaterialResponse& response) const override;

 private:
  struct Return;
  Return return_to_cone(double theta, double e, double a, double open, const ElasticConstants& elastic) const;
  void respond_in_axes(Index p, const Deformation& given, MaterialResponse& response) const;
  void respond_near_identity(Index begin, int count, const std::optional<ElasticConstants>& alike,
                             const Deformation& given, MaterialResponse& response) const;

  Hardening cohesion_;
  double eta_, eta_flow_, xi_;
};

}  // namespace efree
