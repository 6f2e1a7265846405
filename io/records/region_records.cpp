// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/internal/region_records.hpp"

#include "efree/assembly/kinematics.hpp"
#include "efree/io/records/internal/json_array.hpp"

#include <algorithm>
#include <cmath>
#include <string>

namespace efree::internal {

void StressSpread::add(double von_mises, double volume) {
  const double bin = largest_ > 0.0 ? von_mises / largest_ * bins : 0.0;
  volume_[std::min(bins - 1, static_cast<std::size_t>(std::max(bin, 0.0)))] += volume;
  all_ += volume;
}

double StressSpread::quantile(double share) const {
  double below = 0.0;
  for (std::size_t bin = 0; bin < bins; ++bin) {
    if (volume_[bin] > 0.0 && below + volume_[bin] >= share * all_)
      return largest_ / bins * (static_cast<double>(bin) + std::max(0.0, share * all_ - below) / volume_[bin]);
    below += volume_[bin];
  }
  return all_ > 0.0 ? largest_ : 0.0;
}

nlohmann::ordered_json StressSpread::json() const {
  return {{"50", quantile(0.5)}, {"90", quantile(0.9)}, {"99", quantile(0.99)}, {"99.9", quantile(0.999)}};
}

namespace {

template <int Dim> Parameter density_of(const CommonSettings<Dim>& settings, const std::string& region) {
  const auto found = std::ranges::find(settings.materials, region, &RegionMaterial::region);
  return found == settings.materials.end() ? settings.density : found->density;
}
bool is_said(const Parameter& density) {
  return !density.is_constant() || density.at(Vec<3>::Zero()) > 0.0;
}

/// What some points of a region with stresses add up to.
template <int Dim> struct RegionSums {
  double measure = 0.0, mass = 0.0, von_mises = 0.0, first = 0.0, third = 0.0;
  Vec<Dim> at = Vec<Dim>::Zero();
  bool any = false;

  template <int StressDim> void add(const Voigt<StressDim>& stress, const Vec<Dim>& x, double of_point) {
    measure += of_point;
    const double here = efree::von_mises<StressDim>(stress);
    const auto [most, least] = principal_stresses<StressDim>(stress);
    if (!any || here > von_mises) von_mises = here, at = x;
    first = any ? std::max(first, most) : most;
    third = any ? std::min(third, least) : least;
    any = true;
  }
  nlohmann::ordered_json json(const char* measured, bool has_mass, const StressSpread& spread) const {
    nlohmann::ordered_json json{{measured, measure}};
    if (has_mass) json["mass"] = mass;
    json["von_mises"] = von_mises;
    json["von_mises_at"] = json_array(at);
    json["principal_stress"] = {third, first};
    json["von_mises_quantiles"] = spread.json();
    return json;
  }
};

}  // namespace

template <int Dim>
void add_regions(const CommonSettings<Dim>& settings, const Result<Dim>& result, nlohmann::ordered_json& json) {
  const FineSpace<Dim>& space = result.basis().space;
  const FineMesh<Dim>& mesh = space.mesh();
  std::vector<Index> region(space.num_places(), 0);
  Vector measure = Vector::Zero(space.num_places());
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    const auto places = space.places(c);
    for (const Index place : places) {
      region[place] = mesh.region(c);
      measure[place] += space.volume(c) / static_cast<double>(places.size());
    }
  }
  std::vector<RegionSums<Dim>> sums(mesh.num_regions());
  std::vector<Parameter> density;
  for (const std::string& name : mesh.region_names()) density.push_back(density_of(settings, name));
  const auto for_places = [&](const auto& take) {
    for (Index p = 0; p < static_cast<Index>(result.fields.stress.cols()); ++p)
      take(region[p], Voigt<Dim>(result.fields.stress.col(p)), Vec<Dim>(space.points().col(space.dof_at(p))),
           measure[p]);
  };
  for_places([&](Index r, const Voigt<Dim>& stress, const Vec<Dim>& x, double of_place) {
    sums[r].template add<Dim>(stress, x, of_place);
    Vec<3> X = Vec<3>::Zero();
    X.template head<Dim>() = x;
    sums[r].mass += density[r].at(X) * of_place;
  });
  std::vector<StressSpread> spread;
  for (const RegionSums<Dim>& of : sums) spread.emplace_back(of.von_mises);
  for_places([&](Index r, const Voigt<Dim>& stress, const Vec<Dim>&, double of_place) {
    spread[r].add(von_mises<Dim>(stress), of_place);
  });
  for (std::size_t r = 0; r < sums.size(); ++r)
    json["by_region"][mesh.region_names()[r]] =
        sums[r].json(Dim == 2 && !space.axisymmetric() ? "area" : "volume", is_said(density[r]), spread[r]);
}

void add_regions(const CommonSettings<3>& settings, const ImageResult& result, nlohmann::ordered_json& json) {
  const CellFields& fields = result.by_cell;
  const double cell = result.cells->grid.spacing.prod();
  std::vector<StressSpread> spread;
  for (const RegionStresses& of : fields.regions) spread.emplace_back(std::max(0.0, of.von_mises.most));
  for (std::size_t c = 0; c < fields.region.size(); ++c)
    if (fields.region[c] >= 0) spread[fields.region[c]].add(fields.von_mises[c], fields.solid[c] * cell);
  for (std::size_t r = 0; r < result.regions.size(); ++r) {
    const RegionStresses& of = fields.regions[r];
    nlohmann::ordered_json& region = json["by_region"][result.regions[r]];
    region["volume"] = of.volume;
    if (const Parameter density = density_of(settings, result.regions[r]); density.is_constant() && is_said(density))
      region["mass"] = of.volume * density.at(Vec<3>::Zero());
    region["von_mises"] = of.von_mises.most;
    region["von_mises_at"] = json_array(of.von_mises.most_at);
    region["principal_stress"] = {of.third.least, of.first.most};
    region["von_mises_quantiles"] = spread[r].json();
  }
}

template <int Dim> void add_regions(const DynamicsModel<Dim>& model, nlohmann::ordered_json& json) {
  const Dynamics<Dim>& dynamics = model.dynamics;
  const Tensors sigma = dynamics.cauchy_stress();
  const Points<Dim> points = dynamics.points();
  Vector volume(points.cols()), mass(points.cols());
  for (const Chunk<Dim>& chunk : dynamics.world().chunks)
    for (Index p = 0; p < chunk.size(); ++p) {
      volume[dynamics.world().point_number(chunk, p)] = chunk.matter.volume[p];
      mass[dynamics.world().point_number(chunk, p)] = chunk.matter.mass[p];
    }
  for (Index b = 0; b < dynamics.num_bodies(); ++b) {
    RegionSums<Dim> sums;
    const Index begin = dynamics.first_point(b), end = dynamics.first_point(b + 1);
    for (Index p = begin; p < end; ++p) {
      sums.template add<3>(stress_of<3>(sigma.col(p)), points.col(p), volume[p]);
      sums.mass += mass[p];
    }
    StressSpread spread(sums.von_mises);
    for (Index p = begin; p < end; ++p) spread.add(von_mises<3>(stress_of<3>(sigma.col(p))), volume[p]);
    json["by_region"][model.names[b]] = sums.json("volume", true, spread);
  }
}

template void add_regions(const CommonSettings<2>&, const Result<2>&, nlohmann::ordered_json&);
template void add_regions(const CommonSettings<3>&, const Result<3>&, nlohmann::ordered_json&);
template void add_regions(const DynamicsModel<2>&, nlohmann::ordered_json&);
template void add_regions(const DynamicsModel<3>&, nlohmann::ordered_json&);

}  // namespace efree::internal
