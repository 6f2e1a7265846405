// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/internal/material_reader.hpp"

#include "efree/core/error.hpp"
#include "efree/materials/drucker_prager.hpp"
#include "efree/materials/equation_of_state.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/materials/rankine.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <numbers>
#include <optional>
#include <regex>
#include <string_view>
#include <system_error>

namespace efree::internal {
namespace {

enum class Model {
  linear_elastic,
  orthotropic,
  st_venant_kirchhoff,
  neo_hookean,
  neo_hookean_split,
  mooney_rivlin,
  ogden,
  hencky,
  j2,
  johnson_cook,
  drucker_prager,
  rankine,
  ideal_gas,
  stiffened_gas,
  tait,
  mie_grueneisen,
};
const std::vector<std::pair<std::string_view, Model>> models{{"linear_elastic", Model::linear_elastic},
                                                             {"orthotropic", Model::orthotropic},
                                                             {"st_venant_kirchhoff", Model::st_venant_kirchhoff},
                                                             {"neo_hookean", Model::neo_hookean},
                                                             {"neo_hookean_split", Model::neo_hookean_split},
                                                             {"mooney_rivlin", Model::mooney_rivlin},
                                                             {"ogden", Model::ogden},
                                                             {"hencky", Model::hencky},
                                                             {"j2", Model::j2},
                                                             {"johnson_cook", Model::johnson_cook},
                                                             {"drucker_prager", Model::drucker_prager},
                                                             {"rankine", Model::rankine},
                                                             {"ideal_gas", Model::ideal_gas},
                                                             {"stiffened_gas", Model::stiffened_gas},
                                                             {"tait", Model::tait},
                                                             {"mie_grueneisen", Model::mie_grueneisen}};
const std::vector<std::string_view> constants{"E", "nu", "mu", "kappa", "lambda"};
const std::vector<std::string_view> heat_keys{
    "heat_capacity", "melting_temperature", "reference_temperature", "initial_temperature", "m", "taylor_quinney"};
const std::vector<std::string_view> rate_keys{"C", "reference_rate", "D", "q", "rate_factor"};
const Interval more_than_one{1.0};
const std::vector<std::string_view> shock_keys{"sound_speed", "slope", "gamma"};

/// Keys that a model has besides model, region, density and conductivity.
std::vector<std::string_view> keys_of(Model model) {
  const auto and_constants = [](std::vector<std::string_view> own) {
    own.insert(own.begin(), constants.begin(), constants.end());
    return own;
  };
  const auto together = [](std::vector<std::string_view> all, const auto&... more) {
    (all.insert(all.end(), more.begin(), more.end()), ...);
    return all;
  };
  switch (model) {
    case Model::linear_elastic:
      return {"E", "nu"};
    case Model::orthotropic:
      return {"E", "nu", "G", "axes", "angle", "factor"};
    case Model::mooney_rivlin:
      return {"c10", "c01", "kappa"};
    case Model::ogden:
      return {"terms", "kappa"};
    case Model::j2:
      return together(and_constants({"yield", "kinematic", "strain"}), rate_keys, heat_keys, shock_keys);
    case Model::johnson_cook:
      return together(and_constants({"A", "B", "n", "strain"}), rate_keys, heat_keys, shock_keys);
    case Model::ideal_gas:
      return {"gamma", "pressure", "viscosity", "bulk_viscosity"};
    case Model::stiffened_gas:
      return {"gamma", "stiffening", "pressure", "viscosity", "bulk_viscosity"};
    case Model::tait:
      return {"kappa", "exponent", "pressure", "viscosity", "bulk_viscosity"};
    case Model::mie_grueneisen:
      return together(shock_keys, std::vector<std::string_view>{"pressure", "viscosity", "bulk_viscosity"});
    case Model::drucker_prager:
      return and_constants({"cohesion", "friction", "dilatancy", "fit", "strain"});
    case Model::rankine:
      return and_constants(
          {"strength", "softening", "fracture_energy", "length", "damage_threshold", "failed_shear", "strain"});
    default:
      return constants;
  }
}
/// Those of all models, each once.
const Section::Keys all_keys = [] {
  Section::Keys keys{"model", "density", "conductivity"};
  for (const auto& [name, model] : models)
    for (const std::string_view key : keys_of(model))
      if (std::ranges::find(keys, key) == keys.end()) keys.push_back(key);
  return keys;
}();

/// Refuses keys of other models.
void check_keys(const Section& section, Model model) {
  const auto own = keys_of(model);
  const auto name = std::ranges::find(models, model, [](const auto& entry) { return entry.second; })->first;
  if (model != Model::rankine) section.section("strength", {});  // a table: of rankine a parameter of its own
  for (const std::string_view key : all_keys)
    if (key != "model" && key != "density" && key != "conductivity" && key != "strength" && section.has(key) &&
        std::ranges::find(own, key) == own.end())
      section.fail(key,
                   fmt::format("{} means nothing for model = \"{}\", which has {}", key, name, fmt::join(own, ", ")));
}

/// Limits of the stress, where `strength` is a table.
Strength strength(const Section& section) {
  if (!section.is_table("strength")) return {};
  const Section limits = section.section("strength", {"yield", "ultimate"});
  const Strength result{limits.number("yield", positive, 0.0), limits.number("ultimate", positive, 0.0)};
  if (!result.is_given()) section.fail("strength", "strength is empty, expected yield, ultimate or both");
  return result;
}

}  // namespace

const Section::Keys& material_keys() {
  return all_keys;
}

template <int Dim> void MaterialReader<Dim>::read(const Section& root, CommonSettings<Dim>& result) const {
  if (root.has("material") && !root.is_table("material")) {
    result.materials = read_regions(root);
    return;
  }
  const Section section = root.required_section("material", all_keys);
  result.model.material = read(section);
  result.density = density(section);
  result.strength = strength(section);
}

/// 0 if nothing is said.
template <int Dim> Parameter MaterialReader<Dim>::density(const Section& section) const {
  return section.has("density") ? parameter(section, "density", positive) : Parameter(0.0);
}

template <int Dim> std::vector<RegionMaterial> MaterialReader<Dim>::read_regions(const Section& root) const {
  Section::Keys with_region = all_keys;
  with_region.push_back("region");
  std::vector<RegionMaterial> materials;
  for (const Section& section : root.sections("material", with_region)) {
    const std::string region = section.text("region");
    for (const auto& earlier : materials)
      if (earlier.region == region)
        section.fail("region", fmt::format("the region \"{}\" has a material already, from {}", region, earlier.where));
    materials.push_back({region, read(section), section.where("region"), density(section), strength(section)});
  }
  if (materials.empty()) root.fail("material", "[[material]] is empty, expected at least one entry");
  return materials;
}

template <int Dim> SharedMaterial MaterialReader<Dim>::read(const Section& section) const {
  const auto model = section.choice<Model>("model", models, Model::linear_elastic);
  check_keys(section, model);
  try {
    switch (model) {
      case Model::linear_elastic:
        return LinearElastic(parameter(section, "E", positive), parameter(section, "nu", {-1.0, 0.5}));
      case Model::orthotropic:
        return orthotropic(section);
      case Model::st_venant_kirchhoff:
        return StVenantKirchhoff(moduli(section));
      case Model::neo_hookean:
        return NeoHookean(moduli(section));
      case Model::neo_hookean_split:
        return NeoHookeanSplit(moduli(section));
      case Model::mooney_rivlin:
        return MooneyRivlin(parameter(section, "c10", any_number),
                            section.has("c01") ? parameter(section, "c01", any_number) : Parameter(0.0),
                            parameter(section, "kappa", positive));
      case Model::ogden:
        return ogden(section);
      case Model::hencky:
        return Hencky(moduli(section));
      case Model::j2:
      case Model::johnson_cook:
        return metal(section, model == Model::johnson_cook);
      case Model::drucker_prager:
        return drucker_prager(section);
      case Model::ideal_gas:
        return fluid(section, EquationOfState::ideal_gas(section.number("gamma", more_than_one)),
                     parameter(section, "pressure", positive));
      case Model::stiffened_gas:
        return fluid(section,
                     EquationOfState::stiffened_gas(section.number("gamma", more_than_one),
                                                    section.number("stiffening", not_negative)),
                     pressure(section));
      case Model::tait:
        return fluid(section,
                     EquationOfState::tait(section.number("kappa", positive), section.number("exponent", positive)),
                     pressure(section));
      case Model::mie_grueneisen:
        return fluid(section, shocks(section), pressure(section));
      case Model::rankine:
        return rankine(section);
    }
  } catch (const InputError& error) {
    if (std::string_view(error.what()).starts_with(section.where().substr(0, section.where().rfind(':')))) throw;
    section.fail("model", error.what());
  }
  throw std::logic_error("a model that is not read");
}

/// Any two elastic constants; the material checks that they are two.
template <int Dim> ElasticModuli MaterialReader<Dim>::moduli(const Section& section) const {
  ElasticModuli result;
  if (section.has("E")) result.E = parameter(section, "E", positive);
  if (section.has("nu")) result.nu = parameter(section, "nu", {-1.0, 0.5});
  if (section.has("mu")) result.mu = parameter(section, "mu", positive);
  if (section.has("kappa")) result.kappa = parameter(section, "kappa", positive);
  if (section.has("lambda")) result.lambda = parameter(section, "lambda", any_number);
  return result;
}

template <int Dim> Strain MaterialReader<Dim>::strain(const Section& section, Strain fallback) const {
  const auto said = section.choice<Strain>("strain", {{"small", Strain::small}, {"finite", Strain::finite}},
                                           asks_for_finite_.empty() ? fallback : Strain::finite);
  if (!asks_for_finite_.empty() && said == Strain::small)
    section.fail("strain", fmt::format("strain is \"small\", and {} for finite strains", asks_for_finite_));
  return said;
}

namespace {

/// A + B*a and A + B*a^n, whose slopes are known, and which take a small part of the time of an expression.
std::optional<Hardening> known_hardening(const std::string& expression) {
  const std::string number = R"(\s*([0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?)\s*)";
  static const std::regex form(number + R"(\+)" + number + R"(\*\s*a\s*(?:\^)" + number + ")?");
  std::smatch found;
  if (!std::regex_match(expression, found, form)) return std::nullopt;
  std::array<double, 3> numbers{0.0, 0.0, 1.0};
  for (std::size_t k = 0; k < numbers.size(); ++k)
    if (const std::string text = found[k + 1]; !text.empty()) {
      const auto end = text.data() + text.size();
      if (const auto read = std::from_chars(text.data(), end, numbers[k]); read.ec != std::errc() || read.ptr != end)
        return std::nullopt;
    }
  const auto [yield, modulus, exponent] = numbers;
  if (!(yield > 0.0 && exponent > 0.0)) return std::nullopt;
  return exponent == 1.0 ? Hardening::linear(yield, modulus) : Hardening::ludwik(yield, modulus, exponent);
}

}  // namespace

/// A stress by the equivalent plastic strain a: a number, an expression of a, or a table [[a, stress], ...].
template <int Dim> Hardening MaterialReader<Dim>::hardening(const Section& section, const char* key) const {
  if (section.has(key) && section.table().get(key)->is_array()) return section.tabulated(key, Hardening::table);
  if (!section.has(key) || !section.table().get(key)->is_string()) return section.number(key, positive);
  static const std::regex place("(^|[^A-Za-z0-9_])[xyz]($|[^A-Za-z0-9_])");
  if (std::regex_search(section.expression(key), place))
    section.fail(key, fmt::format("{} is a function of the equivalent plastic strain a, not of the place", key));
  if (const auto law = known_hardening(section.expression(key))) return *law;
  Expressions<2> of_strain;
  of_strain.define("a", [](const Vec<2>& x) { return x[0]; });
  const auto field = of_strain.field(section.expression(key), section.where(key));
  const auto stress = [field](double a) { return field(Vec<2>(a, 0.0)); };
  // The cube root of rounding balances it against the rule's error.
  const auto slope = [stress](double a) {
    const double h = 6e-6 * std::max(a, 1e-3);
    if (a < h) return (4.0 * stress(a + h) - 3.0 * stress(a) - stress(a + 2.0 * h)) / (2.0 * h);
    return (stress(a + h) - stress(a - h)) / (2.0 * h);
  };
  if (!(stress(0.0) > 0.0))
    section.fail(key, fmt::format("{} is {:.6g} where a = 0, expected a stress > 0", key, stress(0.0)));
  return Hardening(stress, slope);
}

namespace {

/// The effect of the rate of strain on a metal, by one law at most.
RateFactor rate_factor(const Section& section) {
  std::string_view chosen;
  for (const std::string_view law : {"C", "D", "rate_factor"}) {
    if (!section.has(law)) continue;
    if (!chosen.empty())
      section.fail(law, fmt::format("{} and {} are two laws of the rate of strain: give one of them", chosen, law));
    chosen = law;
  }
  for (const auto& [key, needs] : {std::pair{"reference_rate", "C"}, {"q", "D"}})
    if (section.has(key) && !section.has(needs)) section.fail(key, fmt::format("{} is given without {}", key, needs));
  if (chosen == "C")
    return RateFactor::johnson_cook(section.number("C", not_negative), section.number("reference_rate", positive));
  if (chosen == "D") return RateFactor::cowper_symonds(section.number("D", positive), section.number("q", positive));
  return chosen.empty() ? RateFactor() : section.tabulated("rate_factor", RateFactor::table);
}

}  // namespace

/// J2, with what it depends on; with a sound speed its pressure is that of shocks.
template <int Dim> SharedMaterial MaterialReader<Dim>::metal(const Section& section, bool johnson_cook) const {
  const bool shocked = section.has("sound_speed");
  const Strain strains = strain(section, johnson_cook || shocked ? Strain::finite : Strain::small);
  if (shocked && strains == Strain::small)
    section.fail("strain", "strain is \"small\", and the equation of state asks for finite strains");
  for (const std::string_view key : shock_keys)
    if (!shocked && section.has(key)) section.fail(key, fmt::format("{} is given without a sound_speed", key));
  J2Parameters parameters{
      .moduli = moduli(section),
      .yield = johnson_cook ? Hardening::ludwik(section.number("A", positive), section.number("B", not_negative, 0.0),
                                                section.number("n", positive, 1.0))
                            : hardening(section, "yield"),
      .kinematic = section.number("kinematic", not_negative, 0.0),
      .strain = strains,
      .rate = rate_factor(section)};
  if (section.has("heat_capacity")) {
    Heating heating{.capacity = section.number("heat_capacity", positive),
                    .melting = section.number("melting_temperature", any_number),
                    .reference = section.number("reference_temperature", any_number),
                    .exponent = section.number("m", positive, 1.0),
                    .fraction = section.number("taylor_quinney", {0.0, 1.0, true, true}, 0.9)};
    if (section.has("initial_temperature")) heating.initial = section.number("initial_temperature", any_number);
    parameters.heating = heating;
  } else {
    for (const std::string_view key : heat_keys)
      if (section.has(key)) section.fail(key, fmt::format("{} is given without a heat_capacity", key));
  }
  if (shocked) return WithPressure(J2(parameters), shocks(section));
  return J2(parameters);
}

/// Of the line U_s = sound_speed + slope u_p. The density is a number.
template <int Dim> EquationOfState MaterialReader<Dim>::shocks(const Section& section) const {
  return EquationOfState::mie_grueneisen({.density = section.number("density", positive),
                                          .sound_speed = section.number("sound_speed", positive),
                                          .slope = section.number("slope", not_negative),
                                          .gamma = section.number("gamma", not_negative)});
}

template <int Dim> Parameter MaterialReader<Dim>::pressure(const Section& section) const {
  return section.has("pressure") ? parameter(section, "pressure", any_number) : Parameter(0.0);
}

template <int Dim> SharedMaterial MaterialReader<Dim>::fluid(const Section& section, const EquationOfState& state,
                                                             Parameter at_rest) const {
  return Fluid({.state = state,
                .pressure = std::move(at_rest),
                .viscosity = section.number("viscosity", not_negative, 0.0),
                .bulk_viscosity = section.number("bulk_viscosity", not_negative, 0.0)});
}

template <int Dim> SharedMaterial MaterialReader<Dim>::drucker_prager(const Section& section) const {
  constexpr double degree = std::numbers::pi / 180.0;
  const double friction = section.number("friction", {0.0, 90.0, true});
  const auto* given = section.has("cohesion") ? section.table().get("cohesion") : nullptr;
  // Dry sand has none.
  const bool has_none =
      friction > 0.0 && given && given->is_number() && section.number("cohesion", not_negative) == 0.0;
  DruckerPragerParameters parameters{.moduli = moduli(section),
                                     .cohesion = has_none ? Hardening(0.0) : hardening(section, "cohesion"),
                                     .friction = degree * friction};
  if (section.has("dilatancy")) {
    const double dilatancy = section.number("dilatancy", {0.0, 90.0, true});
    if (dilatancy > friction)
      section.fail("dilatancy", fmt::format("dilatancy is {}, expected no more than the friction of {} degrees",
                                            dilatancy, friction));
    parameters.dilatancy = degree * dilatancy;
  }
  parameters.fit = section.choice<ConeFit>("fit",
                                           {{"compression", ConeFit::compression},
                                            {"extension", ConeFit::extension},
                                            {"plane_strain", ConeFit::plane_strain}},
                                           ConeFit::compression);
  parameters.strain = strain(section, Strain::small);
  return DruckerPrager(parameters);
}

/// Softening as a modulus, or by the energy that tearing takes and the width that it happens in.
template <int Dim> SharedMaterial MaterialReader<Dim>::rankine(const Section& section) const {
  RankineParameters parameters{.moduli = moduli(section), .strength = parameter(section, "strength", not_negative)};
  if (section.has("fracture_energy")) {
    if (section.has("softening")) section.fail("softening", "softening follows from fracture_energy: say one of them");
    parameters.softening =
        softening_modulus(section.number("strength", positive), section.number("fracture_energy", positive),
                          section.number("length", positive));
  } else if (section.has("softening")) {
    parameters.softening = parameter(section, "softening", not_negative);
  }
  if (section.has("damage_threshold") && !section.has("failed_shear"))
    section.fail("damage_threshold",
                 "damage_threshold is where the shear modulus falls to failed_shear, and that key is missing");
  const Interval share{0.0, 1.0, false, true};
  parameters.damage_threshold = section.number("damage_threshold", share, parameters.damage_threshold);
  parameters.failed_shear = section.number("failed_shear", share, parameters.failed_shear);
  parameters.strain = strain(section, Strain::finite);
  return Rankine(parameters);
}

/// terms = [[mu, alpha], ...].
template <int Dim> SharedMaterial MaterialReader<Dim>::ogden(const Section& section) const {
  std::vector<OgdenTerm> terms;
  for (const auto& [mu, alpha] : section.pairs("terms")) terms.push_back({mu, alpha});
  return Ogden(terms, parameter(section, "kappa", positive));
}

template <int Dim> SharedMaterial MaterialReader<Dim>::orthotropic(const Section& section) const {
  const auto three = [&](const char* key, const Interval& range) {
    const std::vector<double> numbers = section.numbers(key, range);
    if (numbers.size() != 3) section.fail(key, fmt::format("{} has {} numbers, expected 3", key, numbers.size()));
    return Vec<3>(numbers[0], numbers[1], numbers[2]);
  };
  const OrthotropicModuli moduli{three("E", positive), three("nu", any_number), three("G", positive), axes(section)};
  const Parameter factor = section.has("factor") ? parameter(section, "factor", positive) : Parameter(1.0);
  try {
    return OrthotropicElastic(moduli, factor);
  } catch (const InputError& error) {
    section.fail("nu", error.what());
  }
}

/// In space the first two axes; in the plane the angle from x to the first.
template <int Dim> Mat<3> MaterialReader<Dim>::axes(const Section& section) const {
  Mat<3> result = Mat<3>::Identity();
  if (Dim == 2) {
    if (section.has("axes")) section.fail("axes", "in the plane axes are given by their angle to x [degrees]");
    const double angle = section.number("angle", any_number, 0.0) * std::numbers::pi / 180.0;
    result.topLeftCorner<2, 2>() << std::cos(angle), -std::sin(angle), std::sin(angle), std::cos(angle);
    return result;
  }
  if (section.has("angle")) section.fail("angle", "in space axes are given as two vectors: axes = [[...], [...]]");
  if (!section.has("axes")) return result;
  const auto [first, second] = section.corners<3>("axes");
  if (!(first.norm() > 0.0 && second.norm() > 0.0 && std::abs(first.dot(second)) < 1e-9 * first.norm() * second.norm()))
    section.fail("axes", "the first two axes are not at right angles to each other");
  result.col(0) = first.normalized();
  result.col(1) = (second - result.col(0).dot(second) * result.col(0)).normalized();
  result.col(2) = result.col(0).cross(result.col(1));
  return result;
}

template <int Dim>
Parameter MaterialReader<Dim>::parameter(const Section& section, const char* key, const Interval& range) const {
  if (section.has(key) && section.table().get(key)->is_string()) {
    const std::string text = section.expression(key);
    const auto field = expressions_.field(text, section.where(key));
    if (!expressions_.varies(text, section.where(key))) {
      const double value = field(Vec<Dim>::Zero());
      if (!range.contains(value)) section.fail(key, fmt::format("{} is {:.6g}, expected {}", key, value, range.text()));
      return value;
    }
    return [field, range, what = fmt::format("{}: {}", section.where(key), key)](const Vec<3>& X) {
      const double value = field(X.head<Dim>());
      if (!range.contains(value))
        throw InputError(fmt::format("{} is {:.6g} at ({:.6g}), expected {}", what, value,
                                     fmt::join(X.head<Dim>(), ", "), range.text()));
      return value;
    };
  }
  return section.number(key, range);
}

template class MaterialReader<2>;
template class MaterialReader<3>;

}  // namespace efree::internal
