// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies that move as one where they have met.
#include "efree/dynamics/contact/internal/facet.hpp"
#include "efree/dynamics/contact/internal/surfaces.hpp"
#include "efree/dynamics/interaction.hpp"
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"

#include <algorithm>
#include <utility>

namespace efree::internal {
namespace {

/// Distance at which bodies seize, over the spacing.
constexpr double seizing_distance = 0.3;

/// Points next to both bodies are due: reconnection gives them nodes of both.
template <int Dim> class Seizing final : public Interaction<Dim> {
 public:
  Seizing(const Scheme<Dim>& scheme, OtmState<Dim>& state) : scheme_(scheme), state_(state) {}

  bool is_contact() const override { return true; }
  void add_forces(World<Dim>& world) override {
    if (world.num_bodies() < 2) return;
    auto start = std::chrono::steady_clock::now();
    surfaces_.update(world, scheme_);
    seize(world);
    world.ledger.add_time("contact", seconds_since(start));
  }
  void pack(Archive& archive) override { surfaces_.pack(archive); }

 private:
  void seize(World<Dim>& world);

  const Scheme<Dim>& scheme_;
  OtmState<Dim>& state_;
  BodySurfaces<Dim> surfaces_;
};

template <int Dim> void Seizing<Dim>::seize(World<Dim>& world) {
  const Nodes<Dim>& nodes = world.nodes;
  auto& seized = state_.seized;
  std::vector<std::pair<Index, Index>> found;
  const auto is_seized = [&](Index a, Index body) {
    return std::binary_search(seized.begin(), seized.end(), std::pair(a, body));
  };
  for (const auto& near : surfaces_.near()) {
    if (state_.merged[near.node] >= 0 || is_seized(near.node, near.body)) continue;
    const Facets<Dim>& facets = surfaces_.surfaces()[near.body].facets;
    NearestFacet<Dim> nearest(1e-9 * nodes.spacing[near.node]);
    for (const Index f : near.facets)
      nearest.compare(f, facet_corners<Dim>(nodes.x, facets, f).colwise() - nodes.x.col(near.node));
    const Index f = nearest.facet(), body = nodes.body[near.node];
    if (f < 0 || nearest.distance() > seizing_distance * 0.5 * (nodes.spacing[near.node] + nodes.spacing[facets(0, f)]))
      continue;
    found.push_back({near.node, near.body});
    for (const Index b : facets.col(f))
      if (!is_seized(b, body)) found.emplace_back(b, body);
  }
  if (found.empty()) return;
  std::sort(found.begin(), found.end());
  found.erase(std::unique(found.begin(), found.end()), found.end());
  for (const auto& [a, body] : found) state_.mark_points_of(world, a);
  const auto before = static_cast<std::ptrdiff_t>(seized.size());
  seized.insert(seized.end(), found.begin(), found.end());
  std::inplace_merge(seized.begin(), seized.begin() + before, seized.end());
  state_.nodes_changed = true;
}

}  // namespace

template <int Dim> std::unique_ptr<Interaction<Dim>> seizing(const Scheme<Dim>& scheme, OtmState<Dim>& state) {
  return std::make_unique<Seizing<Dim>>(scheme, state);
}

template std::unique_ptr<Interaction<2>> seizing(const Scheme<2>&, OtmState<2>&);
template std::unique_ptr<Interaction<3>> seizing(const Scheme<3>&, OtmState<3>&);

}  // namespace efree::internal
