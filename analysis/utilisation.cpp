// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/utilisation.hpp"

#include "efree/analysis/internal/by_region.hpp"
#include "efree/assembly/kinematics.hpp"
#include "efree/core/parallel.hpp"

#include <algorithm>

namespace efree {
namespace {

template <int Dim> double share_of_yield(const Strength& strength, const Voigt<Dim>& stress) {
  return strength.yield > 0.0 ? von_mises<Dim>(stress) / strength.yield : 0.0;
}
template <int Dim> double share_of_ultimate(const Strength& strength, const Voigt<Dim>& stress) {
  return strength.ultimate > 0.0 ? std::max(principal_stresses<Dim>(stress).first / strength.ultimate, 0.0) : 0.0;
}

/// The largest of a region, by each limit that its material has.
template <int Dim> class LargestUtilisation {
 public:
  LargestUtilisation(const std::string& region, const Strength& strength)
      : strength_(strength), yield_{region, "yield"}, ultimate_{region, "ultimate"} {}

  template <int StressDim> void add(const Voigt<StressDim>& stress, const Vec<Dim>& at) {
    raise(yield_, share_of_yield<StressDim>(strength_, stress), at);
    raise(ultimate_, share_of_ultimate<StressDim>(strength_, stress), at);
  }
  void put_into(std::vector<Utilisation<Dim>>& all) const {
    if (strength_.yield > 0.0) all.push_back(yield_);
    if (strength_.ultimate > 0.0) all.push_back(ultimate_);
  }

 private:
  void raise(Utilisation<Dim>& largest, double value, const Vec<Dim>& at) const {
    if (value <= largest.value) return;
    largest.value = value;
    largest.at = at;
  }

  Strength strength_;
  Utilisation<Dim> yield_, ultimate_;
};

/// By region of a mesh; empty: no material has one.
template <int Dim> std::vector<Strength> strengths(const CommonSettings<Dim>& settings, const FineMesh<Dim>& mesh) {
  std::vector<Strength> result;
  for (const std::string& region : mesh.region_names()) result.push_back(strength_of(settings, region));
  if (std::ranges::none_of(result, &Strength::is_given)) result.clear();
  return result;
}

}  // namespace

template <int Dim> double utilisation(const Strength& strength, const Voigt<Dim>& stress) {
  return std::max(share_of_yield<Dim>(strength, stress), share_of_ultimate<Dim>(strength, stress));
}

template <int Dim> Vector utilisation_at_places(const CommonSettings<Dim>& settings, const FineSpace<Dim>& space,
                                                const Fields<Dim>& fields) {
  const std::vector<Strength> limits = strengths(settings, space.mesh());
  if (limits.empty()) return {};
  const std::vector<Index> region = internal::regions_of_places(space);
  Vector result(fields.stress.cols());
  parallel_for(static_cast<Index>(result.size()),
               [&](Index p) { result[p] = utilisation<Dim>(limits[region[p]], Voigt<Dim>(fields.stress.col(p))); });
  return result;
}

template <int Dim> std::vector<Utilisation<Dim>> largest_utilisations(const CommonSettings<Dim>& settings,
                                                                      const FineSpace<Dim>& space,
                                                                      const Fields<Dim>& fields) {
  const std::vector<Strength> limits = strengths(settings, space.mesh());
  std::vector<Utilisation<Dim>> result;
  if (limits.empty()) return result;
  std::vector<LargestUtilisation<Dim>> largest;
  for (std::size_t r = 0; r < limits.size(); ++r) largest.emplace_back(space.mesh().region_names()[r], limits[r]);
  const std::vector<Index> region = internal::regions_of_places(space);
  for (Index p = 0; p < static_cast<Index>(fields.stress.cols()); ++p)
    largest[region[p]].template add<Dim>(Voigt<Dim>(fields.stress.col(p)), space.points().col(space.dof_at(p)));
  for (const auto& one : largest) one.put_into(result);
  return result;
}

std::vector<Utilisation<3>> largest_utilisations(const CommonSettings<3>& settings,
                                                 const std::vector<std::string>& regions, const CellFields& fields) {
  std::vector<Utilisation<3>> result;
  for (std::size_t r = 0; r < regions.size(); ++r) {
    const Strength strength = strength_of(settings, regions[r]);
    const RegionStresses& stresses = fields.regions[r];
    if (strength.yield > 0.0)
      result.push_back({regions[r], "yield", stresses.von_mises.most / strength.yield, stresses.von_mises.most_at});
    if (strength.ultimate > 0.0)
      result.push_back(
          {regions[r], "ultimate", std::max(stresses.first.most / strength.ultimate, 0.0), stresses.first.most_at});
  }
  return result;
}

std::vector<float> utilisation_of_cells(const CommonSettings<3>& settings, const std::vector<std::string>& regions,
                                        const CellFields& fields) {
  std::vector<Strength> strengths;
  for (const std::string& region : regions) strengths.push_back(strength_of(settings, region));
  if (std::ranges::none_of(strengths, &Strength::is_given)) return {};
  std::vector<float> all(fields.region.size(), 0.0F);
  parallel_for(static_cast<Index>(all.size()), [&](Index c) {
    if (fields.region[c] >= 0)
      all[c] = static_cast<float>(
          utilisation<3>(strengths[fields.region[c]], Voigt<3>(fields.stress.col(c).cast<double>())));
  });
  return all;
}

template <int Dim> std::vector<Utilisation<Dim>> largest_utilisations(const DynamicsModel<Dim>& model) {
  const Dynamics<Dim>& dynamics = model.dynamics;
  const Tensors sigma = dynamics.cauchy_stress();
  const Points<Dim> points = dynamics.points();
  std::vector<Utilisation<Dim>> result;
  for (Index b = 0; b < dynamics.num_bodies(); ++b) {
    LargestUtilisation<Dim> largest(model.names[b], dynamics.world().bodies[b].strength);
    for (Index p = dynamics.first_point(b); p < dynamics.first_point(b + 1); ++p)
      largest.template add<3>(stress_of<3>(sigma.col(p)), points.col(p));
    largest.put_into(result);
  }
  return result;
}

#define EFREE_INSTANTIATE(Dim)                                                                                   \
  template double utilisation<Dim>(const Strength&, const Voigt<Dim>&);                                          \
  template Vector utilisation_at_places(const CommonSettings<Dim>&, const FineSpace<Dim>&, const Fields<Dim>&);  \
  template std::vector<Utilisation<Dim>> largest_utilisations(const CommonSettings<Dim>&, const FineSpace<Dim>&, \
                                                              const Fields<Dim>&);                               \
  template std::vector<Utilisation<Dim>> largest_utilisations(const DynamicsModel<Dim>&);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree
