// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/image_analysis.hpp"

#include "efree/analysis/internal/grid_search.hpp"
#include "efree/analysis/internal/image_parts.hpp"
#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/internal/mentions.hpp"
#include "efree/core/error.hpp"
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

/// Names of the regions, in the order of their labels, and the region of each label.
struct Regions {
  std::vector<std::string> names;
  std::vector<Index> of_label;

  explicit Regions(const std::map<Label, std::string>& region_of_label) {
    of_label.assign(region_of_label.rbegin()->first + 1, -1);
    for (const auto& [label, name] : region_of_label) {
      auto place = std::ranges::find(names, name);
      if (place == names.end()) place = names.insert(place, name);
      of_label[label] = static_cast<Index>(place - names.begin());
    }
  }
};

/// By region, as much of it as linear elasticity has.
std::vector<SharedMaterial> materials_by_region(const CommonSettings<3>& settings, const Regions& regions) {
  const auto linear = [](const SharedMaterial& material) {
    return material && !material->linear() ? SharedMaterial(Linearised(material)) : material;
  };
  if (settings.materials.empty())
    return std::vector<SharedMaterial>(regions.names.size(), linear(settings.model.material));
  std::vector<SharedMaterial> materials(regions.names.size());
  for (const RegionMaterial& of : settings.materials) {
    const auto found = std::ranges::find(regions.names, of.region);
    if (found == regions.names.end())
      throw InputError(said_at(of.where, fmt::format("there is no region \"{}\"; the image has \"{}\"", of.region,
                                                     fmt::join(regions.names, "\", \""))));
    materials[found - regions.names.begin()] = linear(of.material);
  }
  for (std::size_t r = 0; r < materials.size(); ++r)
    if (!materials[r])
      throw InputError(
          said_at(settings.materials.back().where, fmt::format("no [[material]] for the region \"{}\"; the image has "
                                                               "\"{}\"",
                                                               regions.names[r], fmt::join(regions.names, "\", \""))));
  return materials;
}

/// Why cells do not take the material of some label, at the middle of its first voxel; empty: they take all.
std::string why_materials_take_mesh(const LabelImage<3>& image, const Regions& regions,
                                    const std::vector<SharedMaterial>& materials) {
  for (const LabelCount& count : count_labels(image)) {
    if (count.label == 0) continue;
    auto pixel = static_cast<std::size_t>(std::ranges::find(image.labels, count.label) - image.labels.begin());
    Vec<3> at;
    for (int d = 0; d < 3; pixel /= image.size[d++]) at[d] = static_cast<double>(pixel % image.size[d]) + 0.5;
    const Vec<3> x = image.in_world(image.origin + at.cwiseProduct(image.spacing));
    const Index region = regions.of_label[count.label];
    const SharedMaterial& material = materials[region];
    const std::string of = fmt::format("the material of the region \"{}\"", regions.names[region]);
    if (!is_isotropic(material, x)) return of + " is not isotropic";
    const MaterialResponse response =
        respond(*material, Deformation::none(Points<3>(x), material->history_size()), true);
    if (incompressibility(response.tangent_at(0)) > bearable_on_cells) return of + " is nearly incompressible";
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

void check_probes_of_image(const Settings<3>& settings, const LabelImage<3>& image) {
  for (const auto& probe : settings.probes)
    if (label_near(image, probe.at, probe_reach) == 0)
      throw InputError(said_at(probe.where, fmt::format("the probe \"{}\" at ({:.6g}) lies outside the body: there is "
                                                        "no material within {} voxels",
                                                        probe.name, fmt::join(probe.at, ", "), probe_reach)));
}

/// Fields by cell, and the numbers that are asked for.
void tell(const Settings<3>& settings, const LabelImage<3>& image, const Regions& regions,
          const std::vector<SharedMaterial>& materials, ImageAnswer& result) {
  std::vector<Vec<3>> probes;
  for (const auto& probe : settings.probes) probes.push_back(probe.at);
  result.by_cell = recover_cell_fields(*result.cells, image, regions.of_label, materials, probes);
  result.probes.clear();
  for (std::size_t p = 0; p < probes.size(); ++p)
    result.probes.emplace_back(settings.probes[p].name, result.by_cell.probes[p]);
  PlacedRange von_mises;
  for (const RegionStresses& region : result.by_cell.regions) von_mises.add(region.von_mises);
  const PlacedRange& displacement = result.by_cell.displacement;
  result.extremes = {{"displacement", displacement.most, displacement.most_at, 0, std::nullopt},
                     {"von_mises", von_mises.most, von_mises.most_at, 0, std::nullopt}};
  tell_errors_on_cells(settings, *result.cells, result);
}

/// Says so if reactions and loads do not balance to rounding; far from it the answer is none.
void balance(const std::vector<SharedMaterial>& materials, ImageAnswer& answer, const std::string& of,
             ImageResult& result) {
  constexpr double rounding = 1e-8, bearable = 0.01;
  answer.balance = {answer.cells->finest().reactions, answer.cells->applied};
  std::vector<Resultant<3>> all;
  for (const auto& [part, reaction] : answer.balance.reactions) all.push_back(reaction);
  for (const auto& load : answer.balance.loads) all.push_back(load.of);
  const double length = lengths_of(*result.image).norm();
  Stiffness<3> room;
  const double modulus = Materials<3>(materials, Plane::strain).stiffness(0, result.image->origin, room).C(0, 0);
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
std::vector<Loads<3>> cases_by_label(const Settings<3>& settings, const Regions& regions) {
  std::vector<Loads<3>> cases = loads_by_case(settings);
  for (Loads<3>& loads : cases) {
    loads.density.clear();
    if (loads.mass_forces.empty()) continue;
    for (const Index region : regions.of_label) {
      if (region < 0) {
        loads.density.emplace_back(0.0);
        continue;
      }
      const std::string& name = regions.names[region];
      const auto of = std::ranges::find(settings.common.materials, name, &RegionMaterial::region);
      const bool found = of != settings.common.materials.end();
      const Parameter& density = found ? of->density : settings.common.density;
      if (density.is_constant() && !(density.at(Vec<3>::Zero()) > 0.0))
        throw InputError(
            said_at(found ? of->where : settings.common.where,
                    fmt::format("analysis.{} needs the density of the material{}", loads.mass_forces.front().kind,
                                found ? fmt::format(" of the region \"{}\"", name) : "")));
      loads.density.push_back(density);
    }
  }
  return cases;
}

}  // namespace

std::vector<const ImageAnswer*> ImageResult::answers() const {
  std::vector<const ImageAnswer*> all{this};
  for (const ImageAnswer& answer : more) all.push_back(&answer);
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

std::optional<ImageResult> analyse_image(const MeshSource<3>& source, const Settings<3>& settings,
                                         const Monitor& watching) {
  if (!why_image_takes_mesh(source, settings).empty()) return {};
  ImageResult result;
  const Monitor monitor = watching.timing(result.times);
  const double cpu_start = process_cpu_seconds();
  const CommonSettings<3>& common = settings.common;
  std::optional<Stage> reading(std::in_place, "image", monitor);
  MadeImage<3> made = located(common, source.where, [&] { return source.image(*reading); });
  result.image = std::make_shared<const LabelImage<3>>(std::move(made.image));
  const LabelImage<3>& image = *result.image;
  const Regions regions(made.region_of_label);
  const std::vector<SharedMaterial> materials = materials_by_region(common, regions);
  const double said = mesh_size(source, common), size = said > 0.0 ? said : 2.0 * image.spacing.minCoeff();
  std::string why = why_materials_take_mesh(image, regions, materials);
  if (why.empty()) {
    result.facets = image_parts(settings, image);
    why = why_supports_take_mesh(image, settings, result.facets);
  }
  if (!why.empty()) {
    if (monitor.say)
      monitor.say(fmt::format("not on cells, as {}: a mesh of about {:.2g} tetrahedra takes more time and memory", why,
                              tetrahedra(image, size)));
    return {};
  }
  result.regions = regions.names;
  result.reports = std::move(made.reports);
  result.parts = describe_parts(settings, image, result.facets);
  check_probes_of_image(settings, image);
  reading.reset();
  if (monitor.say) {
    for (const std::string& remark : made.remarks) monitor.say(remark);
    for (const BoundaryPart& part : result.parts)
      monitor.say(
          fmt::format("boundary \"{}\": {} facets of voxels, area {:.6g}", part.name, part.facets, part.measure));
  }

  std::vector<SharedMaterial> of_label;
  for (const Index region : regions.of_label) of_label.push_back(region < 0 ? SharedMaterial() : materials[region]);
  const GridProblem problem{image, of_label, result.facets, cases_by_label(settings, regions), size, said > 0.0};
  result.more.resize(problem.cases.size() - 1);
  const auto answer_to = [&](std::size_t k) -> ImageAnswer& { return k == 0 ? result : result.more[k - 1]; };
  const auto take = [&](std::vector<CellSolution> solutions) {
    for (std::size_t k = 0; k < solutions.size(); ++k) {
      ImageAnswer& answer = answer_to(k);
      answer.estimates = estimates_on_cells(solutions[k]);
      answer.solution.strain_energy = solutions[k].finest().strain_energy;
      answer.cells = std::move(solutions[k]);
    }
  };
  const auto tell_all = [&] {
    const Stage stage("output", monitor);
    for (std::size_t k = 0; k < problem.cases.size(); ++k) tell(settings, image, regions, materials, answer_to(k));
  };
  located(common, common.where, [&] { search_grid(settings, problem, take, tell_all, result, monitor); });
  for (std::size_t k = 0; k < problem.cases.size(); ++k) {
    ImageAnswer& answer = answer_to(k);
    if (!std::isfinite(answer.solution.strain_energy) || !answer.by_cell.stress.allFinite())
      throw NumericalError("the answer is not finite: moduli, loads or lengths leave the range of double precision");
    judge_grid(settings, *answer.estimates, result.warnings, result.refusal);
    constexpr double lost = 1e7;  // of the energies: as single precision rounds
    if (const CellLevel& finest = answer.cells->finest(); finest.support_energy > lost * finest.strain_energy)
      result.warnings.push_back(fmt::format(
          "springs store {:.2g} times the energy of the body: its stresses may be lost in rounding; hold it "
          "by stiffer ones, or prescribe displacements",
          finest.support_energy / finest.strain_energy));
    balance(materials, answer, k == 0 ? "" : fmt::format("case \"{}\": ", settings.cases[k].name), result);
    answer.utilisations = largest_utilisations(common, result.regions, answer.by_cell);
  }
  result.warnings.insert(result.warnings.end(), made.warnings.begin(), made.warnings.end());
  result.cpu_seconds = process_cpu_seconds() - cpu_start;
  if (watching.times) watching.times->add(result.times);
  return result;
}

}  // namespace efree
