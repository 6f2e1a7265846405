// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/effective_report.hpp"

#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"
#include "efree/io/records/internal/json_array.hpp"
#include "efree/io/records/internal/write_json.hpp"
#include "efree/io/records/writers.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

namespace efree {
namespace {

using internal::json_array, nlohmann::ordered_json;

constexpr std::array<const char*, 4> class_names{"isotropic", "cubic", "transversely_isotropic", "orthotropic"};
constexpr std::array<const char*, 3> plane_class_names{"isotropic", "square", "orthotropic"};

std::string name_of(FrameCondition frame) {
  return frame == FrameCondition::periodic ? "periodic" : frame == FrameCondition::kinematic ? "kinematic" : "static";
}

/// Entries that are rounding against the largest are zero.
std::vector<std::string> rows_of(const Matrix& tensor) {
  const double least = 1e-12 * tensor.cwiseAbs().maxCoeff();
  std::vector<std::string> rows;
  for (Index i = 0; i < tensor.rows(); ++i) {
    std::string row = " ";
    for (Index j = 0; j < tensor.cols(); ++j)
      row += fmt::format(" {:>12.6g}", std::abs(tensor(i, j)) < least ? 0.0 : tensor(i, j));
    rows.push_back(row);
  }
  return rows;
}

std::string text_of_constants(const EngineeringConstants& c) {
  return fmt::format(
      "E = {:.6g}, {:.6g}, {:.6g}; G_yz, G_xz, G_xy = {:.6g}, {:.6g}, {:.6g}; nu_yz, nu_xz, nu_xy = "
      "{:.4g}, {:.4g}, {:.4g}",
      c.E[0], c.E[1], c.E[2], c.G[0], c.G[1], c.G[2], c.nu[0], c.nu[1], c.nu[2]);
}

std::string text_of_bounds(const char* name, double value, const PhaseBounds& bounds) {
  return fmt::format("{} = {:.6g}; between {:.6g} and {:.6g} (Hashin-Shtrikman), {:.6g} and {:.6g} (Reuss, Voigt)",
                     name, value, bounds.hashin_shtrikman[0], bounds.hashin_shtrikman[1], bounds.voigt_reuss[0],
                     bounds.voigt_reuss[1]);
}

/// Young's modulus and Poisson's ratio of an isotropic tensor.
std::pair<double, double> young_and_poisson(const ElasticSymmetry& s) {
  return {9.0 * s.kappa * s.mu / (3.0 * s.kappa + s.mu), (3.0 * s.kappa - 2.0 * s.mu) / (2.0 * (3.0 * s.kappa + s.mu))};
}

Matrix compliance_of_orthotropy(const EffectiveResult& result) {
  // Stiffness and compliance turn alike once shears are not doubled: halves where the compliance has them twice.
  const Vector twice = (Vector(6) << 1, 1, 1, 2, 2, 2).finished();
  const Matrix halved = twice.cwiseInverse().asDiagonal() * result.inverse * twice.cwiseInverse().asDiagonal();
  return twice.asDiagonal() * Matrix(in_axes(ElasticTensor(halved), result.symmetry->axes)) * twice.asDiagonal();
}

void describe_elastic(const EffectiveResult& result, std::vector<std::string>& lines) {
  const ElasticSymmetry& symmetry = *result.symmetry;
  if (result.inverse.size() > 0) {
    lines.push_back("image axes: " + text_of_constants(engineering_constants(ElasticTensor(result.inverse))));
    if (!symmetry.axes.isIdentity()) {
      for (int d = 0; d < 3; ++d)
        lines.push_back(fmt::format("axis {} of orthotropy: ({:.4f})", d + 1, fmt::join(symmetry.axes.col(d), ", ")));
      lines.push_back("in these: " +
                      text_of_constants(engineering_constants(ElasticTensor(compliance_of_orthotropy(result)))));
    }
  }
  lines.push_back(fmt::format(
      "symmetry: {}; distance from isotropic {:.2g} %, cubic {:.2g} %, transversely isotropic {:.2g} %, orthotropic "
      "{:.2g} %",
      text_of(result.nearest), 100.0 * symmetry.distances[0], 100.0 * symmetry.distances[1],
      100.0 * symmetry.distances[2], 100.0 * symmetry.distances[3]));
  if (result.universal_anisotropy)
    lines.push_back(fmt::format("anisotropy: universal index {:.4g}, Zener's ratio {:.4g}",
                                *result.universal_anisotropy, symmetry.zener));
  const auto [E, nu] = young_and_poisson(symmetry);
  lines.push_back(fmt::format("isotropic part: E = {:.6g}, nu = {:.4g}", E, nu));
  if (result.kappa_bounds) lines.push_back(text_of_bounds("its kappa", symmetry.kappa, *result.kappa_bounds));
  if (result.mu_bounds) lines.push_back(text_of_bounds("its mu", symmetry.mu, *result.mu_bounds));
}

std::string text_of_constants(const PlaneEngineeringConstants& c) {
  return fmt::format("E = {:.6g}, {:.6g}; G_xy = {:.6g}; nu_xy = {:.4g}", c.E[0], c.E[1], c.G, c.nu);
}

/// Young's modulus and Poisson's ratio in the plane of an isotropic tensor.
std::pair<double, double> young_and_poisson(const PlaneSymmetry& s) {
  return {4.0 * s.kappa * s.mu / (s.kappa + s.mu), (s.kappa - s.mu) / (s.kappa + s.mu)};
}

void describe_in_plane(const EffectiveResult& result, std::optional<Plane> plane, std::vector<std::string>& lines) {
  const PlaneSymmetry& symmetry = *result.plane_symmetry;
  if (result.inverse.size() > 0) {
    const PlaneElasticTensor compliance = result.inverse;
    lines.push_back(fmt::format("axes x, y, in plane {}: {}", plane == Plane::stress ? "stress" : "strain",
                                text_of_constants(plane_engineering_constants(compliance))));
    if (symmetry.angle != 0.0)
      lines.push_back(
          fmt::format("axes of orthotropy, turned by {:.4g} degrees: {}", symmetry.angle * 180.0 / std::numbers::pi,
                      text_of_constants(plane_engineering_constants(compliance_in_axes(compliance, symmetry.angle)))));
  }
  lines.push_back(fmt::format("symmetry: {}; distance from isotropic {:.2g} %, square {:.2g} %, orthotropic {:.2g} %",
                              text_of(result.plane_nearest), 100.0 * symmetry.distances[0],
                              100.0 * symmetry.distances[1], 100.0 * symmetry.distances[2]));
  const auto [E, nu] = young_and_poisson(symmetry);
  lines.push_back(fmt::format("isotropic part in the plane: E = {:.6g}, nu = {:.4g}", E, nu));
  if (result.kappa_bounds) lines.push_back(text_of_bounds("its kappa", symmetry.kappa, *result.kappa_bounds));
  if (result.mu_bounds) lines.push_back(text_of_bounds("its mu", symmetry.mu, *result.mu_bounds));
}

ordered_json json_rows(const Matrix& tensor) {
  ordered_json rows = ordered_json::array();
  for (Index i = 0; i < tensor.rows(); ++i) rows.push_back(json_array(Vector(tensor.row(i))));
  return rows;
}

ordered_json constants_json(const ElasticTensor& compliance) {
  const EngineeringConstants c = engineering_constants(compliance);
  return {{"E", json_array(c.E)},
          {"G", {{"yz", c.G[0]}, {"xz", c.G[1]}, {"xy", c.G[2]}}},
          {"nu", {{"yz", c.nu[0]}, {"xz", c.nu[1]}, {"xy", c.nu[2]}}}};
}

ordered_json bounds_json(const PhaseBounds& bounds) {
  return {{"hashin_shtrikman", json_array(bounds.hashin_shtrikman)}, {"reuss_voigt", json_array(bounds.voigt_reuss)}};
}

ordered_json constants_json(const PlaneElasticTensor& compliance) {
  const PlaneEngineeringConstants c = plane_engineering_constants(compliance);
  return {{"E", json_array(c.E)}, {"G", {{"xy", c.G}}}, {"nu", {{"xy", c.nu}}}};
}

void add_elastic_in_plane(const EffectiveResult& result, ordered_json& json) {
  const PlaneSymmetry& symmetry = *result.plane_symmetry;
  if (result.inverse.size() > 0) {
    json["compliance"] = json_rows(result.inverse);
    json["engineering"] = constants_json(PlaneElasticTensor(result.inverse));
  }
  ordered_json& axes = json["orthotropic_axes"];
  axes["axes"] = {{std::cos(symmetry.angle), std::sin(symmetry.angle)},
                  {-std::sin(symmetry.angle), std::cos(symmetry.angle)}};
  axes["tensor"] = json_rows(symmetry.there);
  if (result.inverse.size() > 0)
    axes["engineering"] = constants_json(compliance_in_axes(PlaneElasticTensor(result.inverse), symmetry.angle));
  ordered_json& classes = json["symmetry"];
  classes["nearest"] = text_of(result.plane_nearest);
  classes["tolerance"] = result.class_tolerance;
  for (std::size_t c = 0; c < plane_class_names.size(); ++c)
    classes["distances"][plane_class_names[c]] = symmetry.distances[c];
  const auto [E, nu] = young_and_poisson(symmetry);
  json["isotropic_part"] = {{"kappa", symmetry.kappa}, {"mu", symmetry.mu}, {"E", E}, {"nu", nu}};
  if (result.kappa_bounds) json["bounds"]["kappa"] = bounds_json(*result.kappa_bounds);
  if (result.mu_bounds) json["bounds"]["mu"] = bounds_json(*result.mu_bounds);
}

void add_elastic(const EffectiveResult& result, ordered_json& json) {
  const ElasticSymmetry& symmetry = *result.symmetry;
  if (result.inverse.size() > 0) {
    json["compliance"] = json_rows(result.inverse);
    json["engineering"] = constants_json(ElasticTensor(result.inverse));
  }
  ordered_json& axes = json["orthotropic_axes"];
  axes["axes"] = json_rows(symmetry.axes.transpose());
  axes["tensor"] = json_rows(symmetry.there);
  if (result.inverse.size() > 0) axes["engineering"] = constants_json(ElasticTensor(compliance_of_orthotropy(result)));
  ordered_json& classes = json["symmetry"];
  classes["nearest"] = text_of(result.nearest);
  classes["tolerance"] = result.class_tolerance;
  for (std::size_t c = 0; c < class_names.size(); ++c) classes["distances"][class_names[c]] = symmetry.distances[c];
  const auto [E, nu] = young_and_poisson(symmetry);
  json["isotropic_part"] = {{"kappa", symmetry.kappa}, {"mu", symmetry.mu}, {"E", E}, {"nu", nu}};
  if (result.universal_anisotropy) json["anisotropy"]["universal"] = *result.universal_anisotropy;
  json["anisotropy"]["zener"] = symmetry.zener;
  if (result.kappa_bounds) json["bounds"]["kappa"] = bounds_json(*result.kappa_bounds);
  if (result.mu_bounds) json["bounds"]["mu"] = bounds_json(*result.mu_bounds);
}

}  // namespace

template <int Dim>
std::vector<std::string> describe_effective(const EffectiveSettings<Dim>& settings, const EffectiveResult& result) {
  const bool is_elastic = settings.property == EffectiveProperty::stiffness;
  const EffectiveTensor& found = result.tensor;
  const EffectiveLevel& grid = found.finest();
  std::vector<std::string> lines, parts;
  for (const VolumeFraction& part : result.fractions)
    parts.push_back(fmt::format("{} {:.4g} %", part.region, 100.0 * part.fraction));
  lines.push_back(fmt::format("volume fractions: {}", fmt::join(parts, ", ")));
  lines.push_back(result.on_mesh
                      ? fmt::format("{} quadratic cells, edges of {:.4g} in the mean", grid.cells, grid.edges[0])
                      : fmt::format("{} cells of {:.4g} x {:.4g} x {:.4g}, {} iterations for {} loads", grid.cells,
                                    grid.edges[0], grid.edges[1], grid.edges[2], grid.iterations, found.tensor.rows()));
  lines.push_back(fmt::format("effective {} under {} conditions{}; error {:.2g} % ({}), {:.1g} % (iterations)",
                              is_elastic ? "stiffness" : "conductivity", name_of(settings.frame),
                              !is_elastic ? ""
                              : Dim == 2  ? " (xx, yy, xy)"
                                          : " (xx, yy, zz, yz, xz, xy)",
                              100.0 * found.grid_error, result.on_mesh ? "mesh" : "grid",
                              100.0 * found.iteration_error));
  for (const std::string& row : rows_of(found.tensor)) lines.push_back(row);
  if (is_elastic) {
    if constexpr (Dim == 2)
      describe_in_plane(result, settings.common.model.plane, lines);
    else
      describe_elastic(result, lines);
  } else {
    lines.push_back(fmt::format("principal conductivities: {:.6g}", fmt::join(result.principal, ", ")));
    if (result.conductivity_bounds)
      lines.push_back(text_of_bounds("their mean", result.principal.mean(), *result.conductivity_bounds));
  }
  if (const auto& s = result.subvolumes)
    lines.push_back(
        fmt::format("{} subvolumes: standard deviation {:.2g} % of their mean, which is {:.2g} % from the whole's "
                    "tensor; tensors of "
                    "volumes like the whole would scatter by about {:.2g} %",
                    s->count, 100.0 * s->spread, 100.0 * s->bias, 100.0 * s->expected_spread));
  return lines;
}

template <int Dim> void write_effective_result(const std::filesystem::path& file,
                                               const EffectiveSettings<Dim>& settings, const EffectiveResult& result) {
  const EffectiveTensor& found = result.tensor;
  ordered_json json;
  json["title"] = settings.common.title;
  json["kind"] = "effective";
  json["property"] = settings.property == EffectiveProperty::stiffness ? "stiffness" : "conductivity";
  if (Dim == 2 && settings.property == EffectiveProperty::stiffness)
    json["plane"] = settings.common.model.plane == Plane::stress ? "stress" : "strain";
  json["boundary"] = name_of(settings.frame);
  for (const VolumeFraction& part : result.fractions) json["volume_fractions"][part.region] = part.fraction;
  json["tensor"] = json_rows(found.tensor);
  json["error"] = {{"grid", found.grid_error}, {"iterations", found.iteration_error}, {"asymmetry", found.asymmetry}};
  json["extrapolated"] = json_rows(found.extrapolated);
  for (const EffectiveLevel& level : found.levels)
    json["grids"].push_back({{"cells", level.cells},
                             {"edges", json_array(Vec<Dim>(level.edges.template head<Dim>()))},
                             {"iterations", level.iterations},
                             {"tensor", json_rows(level.tensor)},
                             {"seconds", level.seconds}});
  if (settings.property == EffectiveProperty::stiffness) {
    if constexpr (Dim == 2)
      add_elastic_in_plane(result, json);
    else
      add_elastic(result, json);
  } else {
    if (result.inverse.size() > 0) json["resistivity"] = json_rows(result.inverse);
    json["principal"] = {{"values", json_array(result.principal)},
                         {"axes", json_rows(result.principal_axes.transpose())}};
    if (result.conductivity_bounds) json["bounds"]["conductivity"] = bounds_json(*result.conductivity_bounds);
  }
  if (const auto& s = result.subvolumes)
    json["subvolumes"] = {{"count", s->count},
                          {"mean", json_rows(s->mean)},
                          {"deviation", json_rows(s->deviation)},
                          {"spread", s->spread},
                          {"bias", s->bias},
                          {"expected_spread", s->expected_spread}};
  json["warnings"] = result.warnings;
  for (const auto& [stage, seconds] : result.times.stages()) json["seconds"][stage] = seconds;
  json["seconds"]["total"] = result.times.total();
  json["peak_memory_mb"] = peak_memory_mb();
  json["threads"] = num_threads();
  json["version"] = version();
  internal::write_json(file, json);
}

template std::vector<std::string> describe_effective(const EffectiveSettings<2>&, const EffectiveResult&);
template std::vector<std::string> describe_effective(const EffectiveSettings<3>&, const EffectiveResult&);
template void write_effective_result(const std::filesystem::path&, const EffectiveSettings<2>&, const EffectiveResult&);
template void write_effective_result(const std::filesystem::path&, const EffectiveSettings<3>&, const EffectiveResult&);

}  // namespace efree
