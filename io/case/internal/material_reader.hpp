// SPDX-License-Identifier: GPL-3.0-or-later
/// [material] and [[material]] of a case file.
#pragma once

#include "efree/analysis/settings.hpp"
#include "efree/io/case/expression.hpp"
#include "efree/io/case/internal/section.hpp"
#include "efree/materials/equation_of_state.hpp"
#include "efree/materials/hardening.hpp"
#include "efree/materials/moduli.hpp"

#include <string>
#include <utility>
#include <vector>

namespace efree::internal {

/// Keys that a material of some model may have.
const Section::Keys& material_keys();

/// Materials from tables of numbers and expressions of the place.
template <int Dim> class MaterialReader {
 public:
  /// Refers to the expressions. Where something `asks_for_finite` strains materials that do not say their strain have
  /// finite ones, and those that say small ones are refused in its name.
  explicit MaterialReader(const Expressions<Dim>& expressions, std::string asks_for_finite = {})
      : expressions_(expressions), asks_for_finite_(std::move(asks_for_finite)) {}

  /// The material of the whole body, or of each region. Throws InputError that begins with "file:line: ".
  void read(const Section& root, CommonSettings<Dim>& result) const;

 private:
  SharedMaterial read(const Section& section) const;
  Parameter density(const Section& section) const;
  std::vector<RegionMaterial> read_regions(const Section& root) const;
  SharedMaterial orthotropic(const Section& section) const;
  SharedMaterial ogden(const Section& section) const;
  SharedMaterial drucker_prager(const Section& section) const;
  SharedMaterial rankine(const Section& section) const;
  SharedMaterial metal(const Section& section, bool johnson_cook) const;
  SharedMaterial fluid(const Section& section, const EquationOfState& state, Parameter at_rest) const;
  EquationOfState shocks(const Section& section) const;
  Parameter pressure(const Section& section) const;
  Hardening hardening(const Section& section, const char* key) const;
  Strain strain(const Section& section, Strain fallback) const;
  ElasticModuli moduli(const Section& section) const;
  Mat<3> axes(const Section& section) const;
  Parameter parameter(const Section& section, const char* key, const Interval& range) const;

  const Expressions<Dim>& expressions_;
  std::string asks_for_finite_;  ///< empty: nothing
};

}  // namespace efree::internal
