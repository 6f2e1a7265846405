// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/fracture/internal/fracture.hpp"

#include "efree/basis/internal/neighbours.hpp"
#include "efree/dynamics/points.hpp"

#include <Eigen/Eigenvalues>

namespace efree::internal {
namespace {

/// Mass times stored energy of the points under tension.
template <int Dim> Vector tension_energies(const World<Dim>& world) {
  Vector result = Vector::Zero(world.num_points());
  for_each_chunk(world, [&](const Chunk<Dim>& chunk) {
    const Matter<Dim>& matter = chunk.matter;
    if (!(world.bodies[chunk.body].fracture.toughness > 0.0)) return;
    for (Index p = 0; p < chunk.size(); ++p)
      if (!chunk.is_eroded(p) && matter.P.col(p).dot(matter.now.F.col(p)) > 0.0)
        result[world.point_number(chunk, p)] = matter.own_mass(p) * matter.energy[p];
  });
  return result;
}

/// Mean Cauchy stress [stress].
double mean_stress(const Deformation& now, const MaterialResponse& response, Index p) {
  return response.P.col(p).dot(now.F.col(p)) / (3.0 * now.gradient(p).determinant());
}

/// Damage by plastic strain over that at failure, by the rate, triaxiality and temperature now.
template <int Dim>
void add_plastic_damage(const BodyState<Dim>& body, MaterialResponse& now, Matter<Dim>& matter, Index p) {
  const double flow = now.history(body.plastic_strain, p) - matter.now.history(body.plastic_strain, p);
  if (!(flow > 0.0)) return;
  Mat<3> tau = now.stress(p) * matter.now.gradient(p).transpose();
  const double mean = tau.trace() / 3.0;
  tau.diagonal().array() -= mean;
  const double triaxiality = mean / (std::sqrt(1.5) * tau.norm());
  const double warmer = body.temperature >= 0 ? now.history(body.temperature, p) : 0.0;
  const double at_failure = body.fracture.strain->at(triaxiality, flow / matter.now.dt, warmer);
  matter.damage[p] = at_failure > 0.0 ? std::min(1.0, matter.damage[p] + flow / at_failure) : 1.0;
}

}  // namespace

template <int Dim> void update_damage(const World<Dim>& world, Chunk<Dim>& chunk, MaterialResponse& now) {
  const BodyState<Dim>& body = world.bodies[chunk.body];
  if (!body.fracture.on() && world.num_eroded == 0) return;
  Matter<Dim>& matter = chunk.matter;
  for (Index p = 0; p < chunk.size(); ++p) {
    if (chunk.is_eroded(p)) {
      now.P.col(p).setZero();
      now.energy[p] = now.dissipated[p] = 0.0;
      now.history.col(p) = matter.now.history.col(p);
      continue;
    }
    if (body.fracture.stretch > 0.0) {
      const Mat<3> F = matter.now.gradient(p);
      Eigen::SelfAdjointEigenSolver<Mat<3>> axes;
      axes.computeDirect(F.transpose() * F, Eigen::EigenvaluesOnly);
      if (axes.eigenvalues()[2] >= body.fracture.stretch * body.fracture.stretch) matter.damage[p] = 1.0;
    }
    if (body.fracture.strain) add_plastic_damage(body, now, matter, p);
    if (body.fracture.spall > 0.0 && mean_stress(matter.now, now, p) > body.fracture.spall) matter.damage[p] = 1.0;
  }
}

template <int Dim> double release_factor(double shear, double modulus) {
  const double nu = 0.5 * (modulus - 2.0 * shear) / (modulus - shear);
  const double disk = 4.0 * std::numbers::pi * (1.0 - nu) / (2.5 - 4.0 * nu);
  return Dim == 2 ? disk : disk * 8.0 / (3.0 * std::numbers::pi);
}

template <int Dim> void Fracture<Dim>::find_balls(const World<Dim>& world) {
  if (std::exchange(point_changes_, world.point_changes) == world.point_changes) return;
  std::vector<std::vector<Index>> found(world.num_points());
  for (Index b = 0; b < world.num_bodies(); ++b) {
    const FractureCriteria& fracture = world.bodies[b].fracture;
    if (!(fracture.toughness > 0.0)) continue;
    const Index first = world.first_point[b], count = world.first_point[b + 1] - first;
    Points<Dim> at(Dim, count);
    for (Index p = 0; p < count; ++p) {
      const auto [chunk, k] = world.locate(first + p);
      at.col(p) = chunk.matter.now.X.col(k).template head<Dim>();
    }
    Neighbours<Dim> tree;
    tree.build(at);
    parallel_for(count, [&](Index p) {
      const auto [chunk, k] = world.locate(first + p);
      std::vector<Index>& ball = found[first + p] = {p};
      if (fracture.neighbourhood > 0.0) tree.within(at.col(p), chunk.matter.crack_radius[k], ball);
      for (Index& q : ball) q += first;
    });
  }
  offsets_.assign(1, 0);
  balls_.clear();
  mass_.setZero(static_cast<Index>(found.size()));
  for (std::size_t p = 0; p < found.size(); ++p) {
    balls_.insert(balls_.end(), found[p].begin(), found[p].end());
    offsets_.push_back(static_cast<Index>(balls_.size()));
    for (const Index q : found[p]) {
      const auto [chunk, k] = world.locate(q);
      mass_[static_cast<Index>(p)] += chunk.matter.own_mass(k);
    }
  }
}

template <int Dim>
double Fracture<Dim>::release_rate(const World<Dim>& world, Index point, const Vector& energies) const {
  if (!(energies[point] > 0.0)) return 0.0;
  const auto [chunk, k] = world.locate(point);
  double sum = 0.0;
  for (Index e = offsets_[point]; e < offsets_[point + 1]; ++e) sum += energies[balls_[e]];
  return world.bodies[chunk.body].release * chunk.matter.crack_radius[k] * sum / mass_[point];
}

template <int Dim> Vector Fracture<Dim>::release_rates(const World<Dim>& world, const Vector& energies) const {
  Vector result(energies.size());
  parallel_for(static_cast<Index>(energies.size()), [&](Index p) { result[p] = release_rate(world, p, energies); });
  return result;
}

template <int Dim> Vector Fracture<Dim>::release_rates(const World<Dim>& world) {
  find_balls(world);
  return release_rates(world, tension_energies(world));
}

template <int Dim> std::vector<Index> Fracture<Dim>::find_broken(const World<Dim>& world) {
  std::vector<Index> broken;
  for (const auto& chunk : world.chunks)
    for (Index p = 0; p < chunk.size(); ++p)
      if (!chunk.is_eroded(p) && chunk.matter.damage_at(p) >= 1.0) broken.push_back(world.point_number(chunk, p));
  find_balls(world);
  if (balls_.empty()) return broken;
  Vector energies = tension_energies(world);
  for (const Index p : broken) energies[p] = 0.0;
  const Vector rates = release_rates(world, energies);
  std::vector<std::pair<double, Index>> order;
  const auto toughness = [&](Index p) { return world.bodies[world.locate(p).first.body].fracture.toughness; };
  for (Index p = 0; p < rates.size(); ++p)
    if (rates[p] > 0.0 && rates[p] >= toughness(p)) order.emplace_back(-rates[p] / toughness(p), p);
  std::ranges::sort(order);
  for (const auto& [minus, p] : order) {
    // What broke before releases no more.
    if (release_rate(world, p, energies) < toughness(p)) continue;
    energies[p] = 0.0;
    broken.push_back(p);
  }
  return broken;
}

template <int Dim> void erode_points(World<Dim>& world, Scheme<Dim>& scheme, const std::vector<Index>& broken) {
  for (const Index point : broken) {
    const auto [c, p] = world.place_of_point[point];
    Chunk<Dim>& chunk = world.chunks[c];
    Matter<Dim>& matter = chunk.matter;
    const double lost = matter.volume[p] * matter.energy[p];
    world.ledger.add_energy("fracture", EnergyKind::loss, lost + stabilisation_energy(world, chunk, p));
    chunk.stored -= lost;
    matter.eroded[p] = 1;
    matter.volume[p] = matter.energy[p] = 0.0;
    for (Vector* values : {&chunk.support.stabilisation, &matter.shock, &matter.now.heat})
      if (values->size() != 0) (*values)[p] = 0.0;
    matter.P.col(p).setZero();
    if (matter.damage.size() == 0) matter.damage.setZero(chunk.size());
    matter.damage[p] = 1.0;
    ++world.num_eroded;
    world.ledger.add_count("eroded points", 1);
    std::erase(chunk.inverted, p);
    // The others of its pressure patch go on from the dilatation that they shared with it.
    const auto last = std::upper_bound(chunk.patches.begin(), chunk.patches.end(), p);
    for (Index q = *std::prev(last); q < *last; ++q)
      if (!chunk.is_eroded(q)) matter.F_table.col(q) /= std::cbrt(std::exchange(matter.J_ratio[q], 1.0));
    scheme.point_eroded(world, chunk, p);
  }
  ++world.surface_changes;
}

#define EFREE_INSTANTIATE(Dim)                                                      \
  template void update_damage(const World<Dim>&, Chunk<Dim>&, MaterialResponse&);   \
  template double release_factor<Dim>(double, double);                              \
  template void erode_points(World<Dim>&, Scheme<Dim>&, const std::vector<Index>&); \
  template class Fracture<Dim>;
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree::internal
