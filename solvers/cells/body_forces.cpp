// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/body_forces.hpp"

#include "efree/core/error.hpp"
#include "efree/solvers/cells/internal/cell_loads.hpp"
#include "efree/solvers/cells/internal/cell_stiffness.hpp"

#include <fmt/format.h>
#include <algorithm>

namespace efree::internal {
namespace {

constexpr Index layers_at_once = 32;  ///< layers of cells whose shares are held at once

/// Adds a layer of cells. Returns what its forces are together.
template <class Force> Resultant<3> add_layer(const CellProblem& problem, const float* share, Index k,
                                              const Force& force, const std::string& kind, Field& to) {
  const auto& n = problem.grid.cells;
  const PartOrder order(n);
  const double octant = problem.edges.prod() / 8.0;
  Resultant<3> sum;
  for (Index j = 0; j < n[1]; ++j)
    for (Index i = 0; i < n[0]; ++i)
      for (int q = 0; q < 8; ++q) {
        const auto part = static_cast<double>(share[order(i, j, 0, q)]);
        if (part == 0.0) continue;
        const Vec<3> at(i + (q & 1 ? 0.75 : 0.25), j + (q & 2 ? 0.75 : 0.25), k + (q & 4 ? 0.75 : 0.25)),
            x = problem.origin + problem.axes * problem.edges.cwiseProduct(at), of_octant = octant * part * force(x);
        if (!of_octant.allFinite())
          throw InputError(fmt::format("{} is {} at {}, expected finite numbers", kind, text_of(force(x)), text_of(x)));
        const Vec<3> along = problem.axes.transpose() * of_octant;
        for (int a = 0; a < 8; ++a) {
          double weight = 1.0;
          for (int d = 0; d < 3; ++d) weight *= (a >> d & 1) == (q >> d & 1) ? 0.75 : 0.25;
          const std::size_t node = problem.grid.node(i + (a & 1), j + (a >> 1 & 1), k + (a >> 2));
          for (int c = 0; c < 3; ++c) to[c * problem.grid.nodes() + node] += weight * along[c];
        }
        sum.add(x, of_octant);  // as the corners' functions reproduce what is linear
      }
  return sum;
}

}  // namespace

OctantShare::OctantShare(const LabelImage<3>& image, const std::vector<float>& value_of_label,
                         const std::array<Index, 3>& cells)
    : of_image_(image, value_of_label, {2 * cells[0], 2 * cells[1], 2 * cells[2]}), cells_(cells) {}

std::vector<float> OctantShare::layers(Index begin, Index end) const {
  if (is_finest_) return of_image_.layers(2 * begin, 2 * end);
  const PartOrder order(cells_);
  return {parts_.begin() + static_cast<std::ptrdiff_t>(order(0, 0, begin, 0)),
          parts_.begin() + static_cast<std::ptrdiff_t>(order(0, 0, end, 0))};
}

void OctantShare::coarsen(const std::array<int, 3>& ratio) {
  std::vector<float> coarse;
  for (Index first = 0; first < cells_[2]; first += layers_at_once) {
    const Index last = std::min(first + layers_at_once, cells_[2]);
    const std::vector<float> some = halved(layers(first, last), {cells_[0], cells_[1], last - first}, ratio);
    coarse.insert(coarse.end(), some.begin(), some.end());
  }
  parts_ = std::move(coarse);
  is_finest_ = false;
  for (int d = 0; d < 3; ++d) cells_[d] /= ratio[d];
}

BodyForces::BodyForces(const LabelImage<3>& image, const std::vector<Loads<3>>& cases,
                       const std::array<Index, 3>& cells) {
  for (const Loads<3>& loads : cases) {
    std::vector<Load>& of_case = loads_.emplace_back();
    if (loads.body_force) {
      std::vector<float> solid(count_labels(image).back().label + 1, 1.0F);
      solid[0] = 0.0F;
      of_case.push_back({"body_force", {{share_of(image, solid, cells), loads.body_force}}});
    }
    for (const MassForce<3>& load : loads.mass_forces) of_case.push_back(mass_force(image, load, loads.density, cells));
  }
}

std::size_t BodyForces::share_of(const LabelImage<3>& image, const std::vector<float>& values,
                                 const std::array<Index, 3>& cells) {
  const auto known = std::ranges::find(values_, values);
  if (known != values_.end()) return static_cast<std::size_t>(known - values_.begin());
  values_.push_back(values);
  shares_.emplace_back(image, values, cells);
  return shares_.size() - 1;
}

BodyForces::Load BodyForces::mass_force(const LabelImage<3>& image, const MassForce<3>& load,
                                        const std::vector<Parameter>& density, const std::array<Index, 3>& cells) {
  Load result{load.kind, {}};
  std::vector<double> constant;  // densities by label
  for (const LabelCount& count : count_labels(image)) {
    if (count.label == 0) continue;
    if (count.label >= density.size())
      throw InputError(fmt::format("{} needs the density of label {}", load.kind, count.label));
    const Parameter& of_label = density[count.label];
    if (of_label.is_constant()) {
      constant.resize(count.label + 1, 0.0);
      constant[count.label] = of_label.at(Vec<3>::Zero());
      continue;
    }
    result.terms.push_back(
        {share_of(image, ones_of({count.label}), cells),
         [&load, &of_label](const Vec<3>& x) -> Vec<3> { return of_label.at(x) * load.per_mass(x); }});
  }
  const double most = constant.empty() ? 0.0 : *std::ranges::max_element(constant);
  if (most == 0.0) return result;
  std::vector<float> values;
  for (const double of_label : constant) values.push_back(static_cast<float>(of_label / most));
  result.terms.push_back(
      {share_of(image, values, cells), [&load, most](const Vec<3>& x) -> Vec<3> { return most * load.per_mass(x); }});
  return result;
}

void BodyForces::coarsen(const std::array<int, 3>& ratio) {
  for (OctantShare& share : shares_) share.coarsen(ratio);
}

std::vector<AppliedLoad<3>> BodyForces::add(const CellProblem& problem, std::size_t load_case, Field& to) const {
  const Index layers = problem.grid.cells[2];
  const std::size_t of_layer = PartOrder(problem.grid.cells)(0, 0, 1, 0);
  std::vector<AppliedLoad<3>> applied;
  for (const Load& load : loads_[load_case]) {
    Resultant<3> sum;
    for (const Term& term : load.terms)
      for (Index first = 0; first < layers; first += layers_at_once) {
        const Index last = std::min(first + layers_at_once, layers);
        const std::vector<float> share = shares_[term.share].layers(first, last);
        std::vector<Resultant<3>> sums(last - first);
        for (const Index colour : {0, 1})  // layers of cells share points with those beside them
          parallel_chunks((last - first + 1 - colour) / 2, 1, [&](Index chunk, Index) {
            const Index layer = 2 * chunk + colour;
            sums[layer] = add_layer(problem, share.data() + of_layer * layer, first + layer, term.force, load.kind, to);
          });
        for (const Resultant<3>& one : sums) sum += one;
      }
    applied.push_back({"", load.kind, sum});
  }
  return applied;
}

}  // namespace efree::internal
