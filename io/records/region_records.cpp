// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/internal/region_records.hpp"

#include "efree/analysis/internal/by_region.hpp"
#include "efree/assembly/kinematics.hpp"
#include "efree/io/records/internal/json_array.hpp"

#include <algorithm>
#include <optional>
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
  const RegionMaterial* own = material_of(settings, region);
  return own == nullptr ? settings.density : own->density;
}
bool is_given(const Parameter& density) {
  return !density.is_constant() || density.at(Vec<3>::Zero()) > 0.0;
}

/// Numbers of a region, from points with stresses or taken over from elsewhere.
template <int Dim> struct RegionNumbers {
  double measure = 0.0;             ///< area or volume
  std::optional<double> mass{};     ///< where it is known
  double von_mises = 0.0;           ///< the largest
  Vec<Dim> at = Vec<Dim>::Zero();   ///< where that is
  double first = 0.0, third = 0.0;  ///< the largest first and the smallest third principal stress
  bool any = false;                 ///< whether there was a point

  template <int StressDim> void add(const Voigt<StressDim>& stress, const Vec<Dim>& x, double of_point) {
    measure += of_point;
    const double here = efree::von_mises<StressDim>(stress);
    const auto [most, least] = principal_stresses<StressDim>(stress);
    if (!any || here > von_mises) von_mises = here, at = x;
    first = any ? std::max(first, most) : most;
    third = any ? std::min(third, least) : least;
    any = true;
  }
  nlohmann::ordered_json json(const char* measured, const StressSpread& spread) const {
    nlohmann::ordered_json json{{measured, measure}};
    if (mass) json["mass"] = *mass;
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
  const std::vector<Index> region = regions_of_places(space);
  Vector measure = Vector::Zero(space.num_places());
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    const auto places = space.places(c);
    for (const Index place : places) measure[place] += space.volume(c) / static_cast<double>(places.size());
  }
  std::vector<RegionNumbers<Dim>> numbers(mesh.num_regions());
  std::vector<Parameter> density;
  for (std::size_t r = 0; r < numbers.size(); ++r) {
    density.push_back(density_of(settings, mesh.region_names()[r]));
    if (is_given(density[r])) numbers[r].mass = 0.0;
  }
  const auto for_places = [&](const auto& take) {
    for (Index p = 0; p < static_cast<Index>(result.fields.stress.cols()); ++p)
      take(region[p], Voigt<Dim>(result.fields.stress.col(p)), Vec<Dim>(space.points().col(space.dof_at(p))),
           measure[p]);
  };
  for_places([&](Index r, const Voigt<Dim>& stress, const Vec<Dim>& x, double of_place) {
    numbers[r].template add<Dim>(stress, x, of_place);
    if (!numbers[r].mass) return;
    Vec<3> X = Vec<3>::Zero();
    X.template head<Dim>() = x;
    *numbers[r].mass += density[r].at(X) * of_place;
  });
  std::vector<StressSpread> spread;
  for (const RegionNumbers<Dim>& of : numbers) spread.emplace_back(of.von_mises);
  for_places([&](Index r, const Voigt<Dim>& stress, const Vec<Dim>&, double of_place) {
    spread[r].add(von_mises<Dim>(stress), of_place);
  });
  for (std::size_t r = 0; r < numbers.size(); ++r)
    json["by_region"][mesh.region_names()[r]] =
        numbers[r].json(Dim == 2 && !space.axisymmetric() ? "area" : "volume", spread[r]);
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
    RegionNumbers<3> numbers{.measure = of.volume,
                             .von_mises = of.von_mises.most,
                             .at = of.von_mises.most_at,
                             .first = of.first.most,
                             .third = of.third.least};
    if (const Parameter density = density_of(settings, result.regions[r]); density.is_constant() && is_given(density))
      numbers.mass = of.volume * density.at(Vec<3>::Zero());
    json["by_region"][result.regions[r]] = numbers.json("volume", spread[r]);
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
      mass[dynamics.world().point_number(chunk, p)] =
          chunk.matter.own_mass(p) / dynamics.world().options.mass_scaling.factor;
    }
  for (Index b = 0; b < dynamics.num_bodies(); ++b) {
    RegionNumbers<Dim> numbers{.mass = 0.0};
    const Index begin = dynamics.first_point(b), end = dynamics.first_point(b + 1);
    for (Index p = begin; p < end; ++p) {
      numbers.template add<3>(stress_of<3>(sigma.col(p)), points.col(p), volume[p]);
      *numbers.mass += mass[p];
    }
    StressSpread spread(numbers.von_mises);
    for (Index p = begin; p < end; ++p) spread.add(von_mises<3>(stress_of<3>(sigma.col(p))), volume[p]);
    json["by_region"][model.names[b]] = numbers.json("volume", spread);
    if (!model.volume_changes.empty())
      json["by_region"][model.names[b]]["volume_change_percent"] =
          100.0 * model.volume_changes[static_cast<std::size_t>(b)];
  }
}

template void add_regions(const CommonSettings<2>&, const Result<2>&, nlohmann::ordered_json&);
template void add_regions(const CommonSettings<3>&, const Result<3>&, nlohmann::ordered_json&);
template void add_regions(const DynamicsModel<2>&, nlohmann::ordered_json&);
template void add_regions(const DynamicsModel<3>&, nlohmann::ordered_json&);

}  // namespace efree::internal
