// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/image_analysis.hpp"

#include "efree/analysis/internal/by_region.hpp"
#include "efree/analysis/internal/closed_gaps.hpp"
#include "efree/analysis/internal/grid_search.hpp"
#include "efree/analysis/internal/image_parts.hpp"
#include "efree/analysis/internal/judge.hpp"
#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/internal/mentions.hpp"
#include "efree/analysis/internal/told_errors.hpp"
#include "efree/analysis/prepare.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/clock.hpp"
#include "efree/materials/small_and_finite.hpp"
#include "efree/solvers/equations/locking.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <map>

namespace efree {

using namespace internal;

namespace {

/// Of the edges of the frame.
Vec<3> lengths_of(const LabelImage<3>& image) {
  return image.spacing.cwiseProduct(Vec<3>(image.size[0], image.size[1], image.size[2]));
}

/// Sets the names of the regions, in the order of their labels, and the region of each label.
void number_regions(const std::map<Label, std::string>& region_of_label, ImageResult& result) {
  result.region_of_label.assign(region_of_label.rbegin()->first + 1, -1);
  for (const auto& [label, name] : region_of_label) {
    auto place = std::ranges::find(result.regions, name);
    if (place == result.regions.end()) place = result.regions.insert(place, name);
    result.region_of_label[label] = static_cast<Index>(place - result.regions.begin());
  }
}

/// By region, as much of it as linear elasticity has.
std::vector<SharedMaterial> materials_by_region(const CommonSettings<3>& settings,
                                                const std::vector<std::string>& regions) {
  const auto linear = [](const SharedMaterial& material) {
    return material && !material->linear() ? SharedMaterial(Linearised(material)) : material;
  };
  if (settings.materials.empty()) return std::vector<SharedMaterial>(regions.size(), linear(settings.model.material));
  std::vector<SharedMaterial> materials(regions.size());
  for (const RegionMaterial& of : settings.materials) {
    const auto found = std::ranges::find(regions, of.region);
    if (found == regions.end())
      throw InputError(said_at(of.where, fmt::format("there is no region \"{}\"; the image has \"{}\"", of.region,
                                                     fmt::join(regions, "\", \""))));
    materials[found - regions.begin()] = linear(of.material);
  }
  for (std::size_t r = 0; r < materials.size(); ++r)
    if (!materials[r])
      throw InputError(
          said_at(settings.materials.back().where, fmt::format("no [[material]] for the region \"{}\"; the image has "
                                                               "\"{}\"",
                                                               regions[r], fmt::join(regions, "\", \""))));
  return materials;
}

/// The middle of a voxel.
Vec<3> middle_of(const LabelImage<3>& image, std::ptrdiff_t voxel) {
  Vec<3> at;
  for (int d = 0; d < 3; voxel /= image.size[d++]) at[d] = static_cast<double>(voxel % image.size[d]) + 0.5;
  return image.in_world(image.origin + at.cwiseProduct(image.spacing));
}

/// Why cells do not take a material as it is at the places `first` and x; empty: they take it.
std::string why_material_takes_mesh(const SharedMaterial& material, const Vec<3>& first, const Vec<3>& x) {
  if (!material->homogeneous() && !is_isotropic(material, x) && !is_multiple(material, first, x))
    return "anisotropic and differs from place to place by more than a factor";
  const MaterialResponse response = respond(*material, Deformation::none(Points<3>(x), material->history_size()), true);
  return incompressibility(response.tangent_at(0)) > bearable_on_cells ? "nearly incompressible" : "";
}

/// Why cells do not take a material; empty: they take it. What differs from place to place is looked at in some
/// thousands of its voxels.
std::string why_materials_take_mesh(const ImageResult& result) {
  constexpr std::int64_t looks = 4096;
  const LabelImage<3>& image = *result.image;
  for (const LabelCount& count : count_labels(image)) {
    if (count.label == 0) continue;
    const Index region = result.region_of_label[count.label];
    const SharedMaterial& material = result.materials[region];
    const std::int64_t step = material->homogeneous() ? count.pixels : std::max<std::int64_t>(1, count.pixels / looks);
    auto voxel = image.labels.begin();
    std::optional<Vec<3>> first;
    for (std::int64_t seen = 0; seen < count.pixels; ++seen, ++voxel) {
      voxel = std::find(voxel, image.labels.end(), count.label);
      if (seen % step != 0) continue;
      const Vec<3> middle = middle_of(image, voxel - image.labels.begin());
      if (!first) first = middle;
      if (const std::string why = why_material_takes_mesh(material, *first, middle); !why.empty())
        return fmt::format("the material of the region \"{}\" is {}", result.regions[region], why);
      if (step == count.pixels) break;
    }
  }
  return "";
}

/// Why supports keep the image off cells; empty if none does. Smoothed normals lean where flat faces end, so that a
/// face that is held along them is held along others, too, the more so the finer the cells are.
std::string why_supports_take_mesh(const LabelImage<3>& image, const Settings<3>& settings, const VoxelParts& facets) {
  for (const auto& support : settings.supports)
    if (support.normal && !support.stiffness &&
        !std::ranges::all_of(facets.at(support.on), [&](const VoxelFacet& facet) { return is_on_frame(image, facet); }))
      return fmt::format("the normal displacement prescribed on \"{}\" is not on the image's frame", support.on);
  return "";
}

/// About how many tetrahedra a lattice with these edges cuts the material into.
double tetrahedra(const LabelImage<3>& image, double size) {
  constexpr double in_a_cube = 6.0;
  std::int64_t voxels = 0;
  for (const LabelCount& count : count_labels(image))
    if (count.label != 0) voxels += count.pixels;
  return in_a_cube * static_cast<double>(voxels) * image.pixel_volume() / std::pow(size, 3);
}

std::vector<BoundaryPart> describe_parts(const Settings<3>& settings, const LabelImage<3>& image,
                                         const VoxelParts& facets) {
  std::vector<BoundaryPart> parts;
  for (const Mention& mention : boundaries(settings)) {
    const auto& of = facets.at(mention.name);
    parts.push_back({mention.name, static_cast<Index>(of.size()), surface_area(image, of)});
  }
  return parts;
}

/// Probes beside the voxels of the material are taken at the nearest place in these, which is remarked, or warned of
/// where smoothed boundaries of voxels do not explain it.
void place_probes(const LabelImage<3>& image, Settings<3>& settings, std::vector<std::string>& remarks,
                  std::vector<std::string>& warnings) {
  for (auto& probe : settings.probes) {
    const auto [label, x, distance] = material_near(image, probe.at, probe_reach);
    if (label == 0)
      throw InputError(said_at(probe.where, fmt::format("the probe \"{}\" at ({:.6g}) lies outside the body: there is "
                                                        "no material within a voxel",
                                                        probe.name, fmt::join(probe.at, ", "))));
    const double voxel = image.spacing.minCoeff();
    if (distance <= 1e-6 * voxel) continue;
    (distance <= 0.5 * voxel ? remarks : warnings)
        .push_back(fmt::format("the probe \"{}\" lies {:.2g} outside of the voxels of the material: taken at ({:.6g})",
                               probe.name, distance, fmt::join(x, ", ")));
    probe.at = x;
  }
}

/// Fields by cell, and the numbers that are asked for.
void tell(const Settings<3>& settings, const ImageResult& result, ImageAnswer& answer) {
  std::vector<Vec<3>> probes;
  for (const auto& probe : settings.probes) probes.push_back(probe.at);
  answer.by_cell = recover_cell_fields(*answer.cells, *result.image, result.region_of_label, result.materials, probes);
  answer.probes.clear();
  for (std::size_t p = 0; p < probes.size(); ++p)
    answer.probes.emplace_back(settings.probes[p].name, answer.by_cell.probes[p]);
  PlacedRange von_mises;
  for (const RegionStresses& region : answer.by_cell.regions) von_mises.add(region.von_mises);
  const PlacedRange& displacement = answer.by_cell.displacement;
  answer.extremes = {{"displacement", displacement.most, displacement.most_at, 0, std::nullopt},
                     {"von_mises", von_mises.most, von_mises.most_at, 0, std::nullopt}};
  tell_errors_on_cells(settings, *answer.cells, answer);
  // Cells smooth peaks at curved walls away, at first order.
  if (answer.cells->levels.size() > 1)
    answer.extremes[1].error = std::abs(
        von_mises.most - largest_von_mises(*answer.cells, 1, *result.image, result.region_of_label, result.materials));
}

/// Says so if reactions and loads do not balance to rounding, or, where nodes are held in directions that are not the
/// image's axes, to what iterations leave; far from it the answer is none.
void balance(ImageAnswer& answer, const std::string& of, ImageResult& result) {
  constexpr double bearable = 0.01;
  const double rounding = std::max(1e-8, result.image->is_turned() ? answer.cells->finest().iteration_error : 0.0);
  answer.balance = {answer.cells->finest().reactions, answer.cells->applied};
  std::vector<Resultant<3>> all;
  for (const auto& [part, reaction] : answer.balance.reactions) all.push_back(reaction);
  for (const auto& load : answer.balance.loads) all.push_back(load.of);
  const double length = lengths_of(*result.image).norm();
  Stiffness<3> room;
  const double modulus = Materials<3>(result.materials, Plane::strain).stiffness(0, result.image->origin, room).C(0, 0);
  const double least = 1e-6 * modulus * std::max(0.0, answer.by_cell.displacement.most) * length;
  answer.balance.error = imbalance(all, length, false, least);
  if (answer.balance.error <= rounding) return;
  const std::string what = fmt::format(
      "{}reactions and loads are out of balance by {:.2g}, relative: the equations are not solved to rounding", of,
      answer.balance.error);
  if (answer.balance.error <= bearable || !result.refusal.empty())
    result.warnings.push_back(what);
  else
    result.refusal = what;
}

/// All that acts in each case, with densities by label. Throws InputError for a density that is missing.
std::vector<Loads<3>> cases_by_label(const Settings<3>& settings, const ImageResult& result) {
  std::vector<Loads<3>> cases = loads_by_case(settings);
  for (Loads<3>& loads : cases) {
    loads.density.clear();
    if (loads.mass_forces.empty()) continue;
    for (const Index region : result.region_of_label) {
      if (region < 0) {
        loads.density.emplace_back(0.0);
        continue;
      }
      const std::string& name = result.regions[region];
      const RegionMaterial* own = material_of(settings.common, name);
      const Parameter& density = own == nullptr ? settings.common.density : own->density;
      if (density.is_constant() && !(density.at(Vec<3>::Zero()) > 0.0))
        throw InputError(
            said_at(own == nullptr ? settings.common.where : own->where,
                    fmt::format("analysis.{} needs the density of the material{}", loads.mass_forces.front().kind,
                                own == nullptr ? "" : fmt::format(" of the region \"{}\"", name))));
      loads.density.push_back(density);
    }
  }
  return cases;
}

/// What a grid makes of the image's bodies that it should not.
void warn_of_bodies(ImageResult& result) {
  const BodiesOnGrid& bodies = result.cells->bodies;
  const auto text_of = [](const Vec<3>& x) { return fmt::format("({:.4g})", fmt::join(x, ", ")); };
  if (bodies.left_out > 0) {
    result.reports.emplace_back("free_bodies", bodies.left_out);
    result.reports.emplace_back("free_bodies_fraction", bodies.left_out_part);
    result.warnings.push_back(
        fmt::format("{} that nothing holds or loads {} left out, {:.2g} % of the material, the largest at {}: "
                    "displacements and stresses are zero there",
                    bodies.left_out == 1 ? "a body" : fmt::format("{} bodies", bodies.left_out),
                    bodies.left_out == 1 ? "is" : "are", 100.0 * bodies.left_out_part, text_of(bodies.left_out_at)));
  }
  if (bodies.left_out > 0)
    for (const auto& [name, values] : result.probes)
      if (values.displacement.isZero(0.0) && values.strain.isZero(0.0))
        result.warnings.push_back(
            fmt::format("the probe \"{}\" is in a body that is left out: its displacement and stress are unknown, not "
                        "zero",
                        name));
  const double edge = result.cells->grid.spacing.maxCoeff();
  if (bodies.joined > 0)
    result.warnings.push_back(fmt::format(
        "bodies that do not hang together by faces of voxels are one on the grid, such as that at {}: cells join what "
        "is less than two of them apart; take a smaller mesh_size (now {:.3g}), or keep the largest body "
        "(largest_only)",
        text_of(bodies.joined_at), edge));
  if (std::string gaps = closed_gaps(*result.image, result.cells->grid.cubes); !gaps.empty())
    result.warnings.push_back(std::move(gaps));
}

/// What makes an answer doubtful, or none.
void judge_answer(const Settings<3>& settings, const std::string& of, ImageAnswer& answer, ImageResult& result) {
  if (!std::isfinite(answer.solution.strain_energy) || !answer.by_cell.stress.allFinite())
    throw NumericalError("the answer is not finite: moduli, loads or lengths leave the range of double precision");
  judge_grid(settings, *answer.estimates, of, result.warnings, result.refusal);
  if (answer.by_cell.displacement.most == 0.0) result.warnings.push_back(of + nothing_acts);
  constexpr double lost = 1e7;  // of the energies: as single precision rounds
  if (const CellLevel& finest = answer.cells->finest(); finest.support_energy > lost * finest.strain_energy)
    result.warnings.push_back(fmt::format(
        "{}springs store {:.2g} times the energy of the body: its stresses may be lost in rounding; hold it "
        "by stiffer ones, or prescribe displacements",
        of, finest.support_energy / finest.strain_energy));
  balance(answer, of, result);
}

}  // namespace

std::vector<const ImageAnswer*> ImageResult::answers() const {
  std::vector<const ImageAnswer*> all{this};
  for (const ImageAnswer& answer : more) all.push_back(&answer);
  return all;
}
std::vector<ImageAnswer*> ImageResult::answers() {
  std::vector<ImageAnswer*> all{this};
  for (ImageAnswer& answer : more) all.push_back(&answer);
  return all;
}

std::string why_image_takes_mesh(const MeshSource<3>& source, const Settings<3>& settings) {
  if (!source.image) return "the geometry is not an image in space on a lattice";
  if (settings.cells == OnCells::never) return "the case asks for other functions";
  if (settings.time) return "there is a [time]";
  if (settings.regime && *settings.regime != Regime::linear) return "the model is not linear";
  const auto is_linear = [&](const SharedMaterial& material) {
    return !material || material->linear() || settings.regime == Regime::linear;
  };
  if (!is_linear(settings.common.model.material) ||
      !std::ranges::all_of(settings.common.materials, is_linear, &RegionMaterial::material))
    return "a material is not linear";
  const auto follows = [](const Loads<3>& loads) { return !loads.followers.empty(); };
  if (std::ranges::any_of(loads_by_case(settings), follows)) return "a pressure follows the boundary";
  if (settings.has_exact()) return "there is an exact solution to compare with";
  return "";
}

std::optional<ImageResult> analyse_image(const MeshSource<3>& source, const Settings<3>& asked,
                                         const Monitor& watching) {
  Settings<3> settings = asked;
  const CommonSettings<3>& common = settings.common;
  const auto left_to_mesh = [&](const std::string& why) {
    if (settings.cells == OnCells::always)
      throw InputError(
          said_at(where_said(common, "basis.kind"), fmt::format("basis.kind = \"cells\" does not do here: {}", why)));
    return std::optional<ImageResult>();
  };
  if (const std::string why = why_image_takes_mesh(source, settings); !why.empty()) return left_to_mesh(why);
  ImageResult result;
  const Monitor monitor = watching.timing(result.times);
  const double cpu_start = process_cpu_seconds();
  std::optional<Stage> reading(std::in_place, "image", monitor);
  MadeImage<3> made = located(common, source.where, [&] { return source.image(*reading); });
  result.image = std::make_shared<const LabelImage<3>>(std::move(made.image));
  const LabelImage<3>& image = *result.image;
  number_regions(made.region_of_label, result);
  result.materials = materials_by_region(common, result.regions);
  const double said = mesh_size(source, common), size = said > 0.0 ? said : 2.0 * image.spacing.minCoeff();
  if (const double longest = lengths_of(image).maxCoeff(); size > longest)
    throw InputError(said_at(source.where, fmt::format("geometry.mesh_size = {:.6g}: cells would be larger than the "
                                                       "image, which is {:.6g} long",
                                                       size, longest)));
  std::string why = why_materials_take_mesh(result);
  if (why.empty()) {
    result.facets = image_parts(settings, image);
    why = why_supports_take_mesh(image, settings, result.facets);
  }
  if (!why.empty()) {
    if (monitor.say && settings.cells != OnCells::always)
      monitor.say(fmt::format("not on cells, as {}: a mesh of about {:.2g} tetrahedra takes more time and memory", why,
                              tetrahedra(image, size)));
    return left_to_mesh(why);
  }
  result.reports = std::move(made.reports);
  result.parts = describe_parts(settings, image, result.facets);
  place_probes(image, settings, made.remarks, made.warnings);
  reading.reset();
  if (monitor.say) {
    for (const std::string& remark : made.remarks) monitor.say(remark);
    for (const BoundaryPart& part : result.parts)
      monitor.say(
          fmt::format("boundary \"{}\": {} facets of voxels, area {:.6g}", part.name, part.facets, part.measure));
  }

  std::vector<SharedMaterial> of_label;
  for (const Index region : result.region_of_label)
    of_label.push_back(region < 0 ? SharedMaterial() : result.materials[region]);
  const GridProblem problem{image, of_label, result.facets, cases_by_label(settings, result), size, said > 0.0};
  result.more.resize(problem.cases.size() - 1);
  const auto tell_one = [&](ImageAnswer& answer) { tell(settings, result, answer); };
  located(common, common.where, [&] { search_grid(settings, problem, tell_one, result, monitor); });
  warn_of_bodies(result);
  const auto answers = result.answers();
  for (std::size_t k = 0; k < answers.size(); ++k) {
    const std::string of = settings.cases.empty() ? "" : fmt::format("case \"{}\": ", settings.cases[k].name);
    judge_answer(settings, of, *answers[k], result);
    answers[k]->utilisations = largest_utilisations(common, result.regions, answers[k]->by_cell);
  }
  result.warnings.insert(result.warnings.end(), made.warnings.begin(), made.warnings.end());
  result.cpu_seconds = process_cpu_seconds() - cpu_start;
  if (watching.times) watching.times->add(result.times);
  return result;
}

FieldsOnMesh fields_on_mesh(const MeshSource<3>& source, const Settings<3>& settings, const ImageResult& result,
                            const Monitor& monitor) {
  Settings<3> without_probes = settings;  // these are of voxels, whose mesh is smooth
  without_probes.probes.clear();
  FieldsOnMesh on_mesh{prepare(source, without_probes, monitor).mesh, {}};
  const FineMesh<3>& mesh = *on_mesh.mesh;
  std::vector<Index> region_of_label(result.region_of_label.size(), -1);
  std::vector<SharedMaterial> materials;
  for (const std::string& name : mesh.region_names()) {
    const auto region = std::ranges::find(result.regions, name) - result.regions.begin();
    for (std::size_t label = 0; label < region_of_label.size(); ++label)
      if (result.region_of_label[label] == region) region_of_label[label] = static_cast<Index>(materials.size());
    materials.push_back(result.materials[region]);
  }
  for (const ImageAnswer* answer : result.answers())
    on_mesh.fields.push_back(recover_fields(*answer->cells, *result.image, mesh, region_of_label, materials));
  return on_mesh;
}

}  // namespace efree
