// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/otm/otm.hpp"

#include "efree/core/error.hpp"
#include "efree/otm/internal/motion.hpp"

#include <fmt/format.h>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

namespace efree {
namespace {

/// How much smaller (its logarithm) a point may get in a step, at the rate of the last one: what is squeezed faster is
/// turned inside out before its pressure says a word.
constexpr double most_squeezed = 0.2;
/// Of the stable step, to which that may shorten it: what asks for more joins another point, or breaks.
constexpr double least_step = 0.05;

/// Steps between looks at the energy, and at how stiff points are.
constexpr Index between_looks = 64;
/// Looks at an energy that is off after which it is: where there is little of it, as at the start, it may swing.
constexpr Index looks_in_a_row = 8;

}  // namespace

template <int Dim> void EnergyWatch::look(const OtmBalance<Dim>& now) {
  // What has come in where functions changed is accounted for, and nobody has brought it.
  const double made = std::max(0.0, -now.renewal), total = now.total() + made;
  // What is told in between may bring energy, and none of it is off.
  if (!begun) start = total - off;
  begun = true;
  scale = std::max({scale, now.kinetic + std::abs(now.stored) + now.dissipated - made, std::abs(now.prescribed),
                    std::abs(now.weight)});
  off = total - start;
  if (!(std::abs(off) <= std::abs(furthest))) furthest = off;
}
template void EnergyWatch::look(const OtmBalance<2>&);
template void EnergyWatch::look(const OtmBalance<3>&);

template <int Dim> Otm<Dim>::Otm(std::vector<OtmBody<Dim>> bodies, const OtmOptions& options)
    : motion_(std::make_unique<internal::Motion<Dim>>(std::move(bodies), options)) {}
template <int Dim> Otm<Dim>::Otm(Otm&&) noexcept = default;
template <int Dim> Otm<Dim>& Otm<Dim>::operator=(Otm&&) noexcept = default;
template <int Dim> Otm<Dim>::~Otm() = default;

template <int Dim> Index Otm<Dim>::num_nodes() const {
  return static_cast<Index>(motion_->x.cols());
}
template <int Dim> Index Otm<Dim>::num_points() const {
  return static_cast<Index>(motion_->place_of_point.size());
}
template <int Dim> Index Otm<Dim>::num_bodies() const {
  return static_cast<Index>(motion_->bodies.size()) - 1;
}
template <int Dim> const Material& Otm<Dim>::material(Index body) const {
  return *motion_->bodies.at(body).material;
}
template <int Dim> Index Otm<Dim>::first_node(Index body) const {
  return motion_->bodies.at(body).first_node;
}
template <int Dim> Index Otm<Dim>::first_point(Index body) const {
  return motion_->bodies.at(body).first_point;
}

template <int Dim> void Otm<Dim>::add_wall(const OtmWall<Dim>& wall) {
  motion_->add_tool({.shape = tools::half_space<Dim>(wall.normal, wall.level), .friction = wall.friction}, true);
}
template <int Dim> void Otm<Dim>::add_tool(const OtmTool<Dim>& tool) {
  motion_->add_tool(tool, false);
  motion_->watch.begun = false;
}

template <int Dim> void Otm<Dim>::add_cavity(const OtmCavity<Dim>& cavity) {
  internal::Motion<Dim>& of = *motion_;
  if (of.axisymmetric()) throw InputError("a cavity: expected plane strain or space, not an axisymmetric section");
  if (!std::isfinite(cavity.pressure) || !(cavity.exponent > 0.0) || !std::isfinite(cavity.exponent))
    throw InputError("a cavity: expected a pressure and a positive exponent");
  if (cavity.facets.cols() == 0 || cavity.facets.minCoeff() < 0 || cavity.facets.maxCoeff() >= num_nodes())
    throw InputError(fmt::format("a cavity: expected facets of nodes, of which there are {}", num_nodes()));
  // Moving all nodes alike changes nothing if the facets close.
  Vec<Dim> sum = Vec<Dim>::Zero();
  double size = 0.0;
  const double volume = of.enclosed(cavity.facets, [&](Index, const Vec<Dim>& by) {
    sum += by;
    size += by.norm();
  });
  if (!(sum.norm() < 1e-10 * size)) throw InputError("a cavity: its facets are not closed, or not oriented alike");
  if (!(std::abs(volume) > 0.0)) throw InputError("a cavity: its facets enclose nothing");
  of.cavities.push_back({cavity, volume, 0.0});
  of.inflate();
  of.watch.begun = false;
}

template <int Dim> void Otm<Dim>::prescribe(Index node, int axis, double velocity) {
  if (node < 0 || node >= num_nodes() || axis < 0 || axis >= Dim)
    throw InputError(fmt::format("axis {} of node {}: there are {} nodes", axis, node, num_nodes()));
  motion_->prescribed.push_back({node, axis, velocity});
  motion_->v(axis, node) = velocity;
  motion_->held_anew = true;
  motion_->watch.begun = false;
}

template <int Dim> void Otm<Dim>::accelerate(const Vec<Dim>& by) {
  internal::Motion<Dim>& of = *motion_;
  if (!by.allFinite()) throw InputError("an acceleration: expected numbers");
  if (of.axisymmetric() && by[0] != 0.0)
    throw InputError(fmt::format(
        "an acceleration of {:.6g} along the radius of an axisymmetric section, expected one along y alone", by[0]));
  of.force += (by - of.acceleration) * of.mass.transpose();
  of.acceleration = by;
  of.watch.begun = false;
}

template <int Dim> void Otm<Dim>::erode(Index point) {
  if (point < 0 || point >= num_points())
    throw InputError(fmt::format("point {} is to be eroded, and there are {}", point, num_points()));
  if (!is_eroded(point)) motion_->erode({point});
}

template <int Dim> bool Otm<Dim>::is_eroded(Index point) const {
  const auto [c, p] = motion_->place_of_point.at(point);
  return motion_->chunks[c].is_eroded(p);
}

template <int Dim> Vector Otm<Dim>::release_rates() const {
  if (motion_->ball_offsets.empty()) motion_->find_balls();
  return motion_->release_rates(motion_->tension_energies());
}

template <int Dim> Vector Otm<Dim>::damage() const {
  Vector result(num_points());
  for (Index p = 0; p < num_points(); ++p) {
    const auto [c, k] = motion_->place_of_point[p];
    result[p] = motion_->chunks[c].damage[k];
  }
  return result;
}

template <int Dim> std::vector<Index> Otm<Dim>::points_in_others() const {
  internal::Motion<Dim>& of = *motion_;
  if (!of.has_contact()) return {};
  const bool known = !of.surfaces.empty();
  if (!known) of.find_surface();
  std::vector<Index> result = of.points_in_others();
  if (!known) of.surfaces.clear();  // as steps make them, where nodes are by then
  return result;
}

template <int Dim> Index Otm<Dim>::num_held() const {
  std::size_t held = 0;
  for (const auto& chunk : motion_->chunks) held += chunk.crushed.size();
  return static_cast<Index>(held);
}

template <int Dim> double Otm<Dim>::step(double at_most) {
  internal::Motion<Dim>& of = *motion_;
  if (of.held_anew) {
    of.held_anew = false;
    of.find_free();
    of.find_momenta();
    // What is left of that shape where nodes are held is slow: the bound would be too long until it is found anew.
    of.shake(40);
    if (of.counts.steps == 0) of.first_stable = of.stable;
  }
  if (!of.watch.begun) of.watch.look(balance());
  if (of.counts.steps == 0) of.foresee_damping();
  // Viscous forces lag behind by half a step: the bound of damped vibrations by the fastest.
  double damping = 0.0, squeezed = std::numeric_limits<double>::infinity();
  for (auto& chunk : of.chunks) {
    damping = std::max(damping, chunk.damping);
    const auto& body = of.bodies[chunk.body];
    const double least = of.joins(body) || body.fracture.on() ? least_step * of.stable : 0.0;
    if (const double squeeze = std::exchange(chunk.squeeze, 0.0); squeeze > 0.0)
      squeezed = std::min(squeezed, std::max(most_squeezed / squeeze, least));
  }
  const double damped = of.stable * (std::sqrt(1.0 + damping * damping) - damping);
  const double dt = std::min({damped, squeezed, of.longest_way(), at_most});
  if (!(dt > 0.0) || !std::isfinite(dt))
    throw NumericalError(
        fmt::format("at time {:.6g} the stable step is {:.3g}, where nodes move at up to {:.3g} along an axis", of.time,
                    dt, of.v.cwiseAbs().maxCoeff()));
  of.move(0.5 * (of.last_step + dt), dt);
  of.time += dt;
  of.last_step = dt;
  // Points are of no two pairs: what pairs them takes turns.
  const Index turn = of.counts.steps % 32;
  if (turn == 1 && of.options.merging > 0.0)
    of.give_up_nodes();
  else if (turn == 31 && of.stable < of.options.merging * of.first_stable)
    of.merge_nodes();
  else if (of.options.injection > 0.0 && turn % 8 == 7)
    of.inject();
  else if (of.options.injection > 0.0 && turn % 8 == 3)
    of.pair_points();
  of.renew();
  of.sweep(dt);
  of.weigh();
  of.touch();
  of.inflate();
  if (of.breaks()) of.fracture();
  if (++of.counts.steps % between_looks == 0) {
    of.stiffen();
    of.find_passed();
    of.watch.look(balance());
    const double error = of.watch.error();
    of.watch.beyond = std::abs(error) <= of.options.imbalance ? 0 : of.watch.beyond + 1;
    if (!std::isfinite(error))
      throw NumericalError(fmt::format("at time {:.6g} energies are no numbers any more", of.time));
    if (of.watch.beyond >= looks_in_a_row)
      throw NumericalError(fmt::format(
          "at time {:.6g} the energy is off by {:.2g} %, more than the imbalance of {:.2g} %: smaller steps (courant) "
          "or finer bodies may help",
          of.time, 100.0 * error, 100.0 * of.options.imbalance));
  }
  if (of.is_time_to_look()) of.shake(1);
  return dt;
}

template <int Dim> void Otm<Dim>::run(double until) {
  while (time() < until) {
    const double left = until - time();
    // The last two share what is left, so that no step is tiny.
    step(left > motion_->stable && left < 2.0 * motion_->stable ? 0.5 * left : left);
    if (until - time() < 1e-12 * until) break;
  }
}

template <int Dim> double Otm<Dim>::time() const {
  return motion_->time;
}
template <int Dim> double Otm<Dim>::stable_step() const {
  return motion_->stable;
}
template <int Dim> const Points<Dim>& Otm<Dim>::nodes() const {
  return motion_->x;
}
template <int Dim> Points<Dim> Otm<Dim>::velocities() const {
  return motion_->v;
}
template <int Dim> const Vector& Otm<Dim>::masses() const {
  return motion_->mass;
}
template <int Dim> Points<Dim> Otm<Dim>::points() const {
  Points<Dim> result(Dim, num_points());
  for (Index p = 0; p < num_points(); ++p) {
    const auto [c, k] = motion_->place_of_point[p];
    result.col(p) = motion_->chunks[c].at.col(k);
  }
  return result;
}
template <int Dim> Tensors Otm<Dim>::deformation() const {
  Tensors result(9, num_points());
  for (Index p = 0; p < num_points(); ++p) {
    const auto [c, k] = motion_->place_of_point[p];
    const auto& chunk = motion_->chunks[c];
    Eigen::Map<Mat<3>>(result.col(p).data()) = chunk.since[k] * Eigen::Map<const Mat<3>>(chunk.made.col(k).data());
  }
  return result;
}
template <int Dim> Tensors Otm<Dim>::cauchy_stress() const {
  Tensors result(9, num_points());
  for (Index p = 0; p < num_points(); ++p) {
    const auto [c, k] = motion_->place_of_point[p];
    auto& chunk = motion_->chunks[c];
    const Eigen::Map<const Mat<3>> F(chunk.now.F.col(k).data()), P(chunk.response.P.col(k).data());
    Eigen::Map<Mat<3>>(result.col(p).data()) = P * F.transpose() / F.determinant();
  }
  return result;
}
template <int Dim> Matrix Otm<Dim>::history(Index body) const {
  const Index begin = first_point(body), end = first_point(body + 1);
  Matrix result(motion_->bodies[body].material->history_size(), end - begin);
  for (Index p = begin; p < end; ++p) {
    const auto [c, k] = motion_->place_of_point[p];
    result.col(p - begin) = motion_->chunks[c].now.history.col(k);
  }
  return result;
}

template <int Dim> OtmBalance<Dim> Otm<Dim>::balance() const {
  const internal::Motion<Dim>& of = *motion_;
  OtmBalance<Dim> result;
  result.moment.setZero();
  result.stored = of.stored.sum();
  for (const auto& cavity : of.cavities) result.stored += cavity.stored;
  result.dissipated = of.dissipated.sum();
  result.viscous = of.viscous.sum();
  result.contact = of.contact_loss + of.contact_stored;
  result.renewal = of.renewal_loss;
  result.fracture = of.fracture_loss;
  result.prescribed = of.prescribed_work;
  result.weight = of.weight_work;
  for (Index a = 0; a < num_nodes(); ++a) {
    if (!(of.mass[a] > 0.0)) continue;
    // Half a step ago; and the energy with that half a step from now.
    const Vec<Dim> l = of.momentum_of(a);
    result.kinetic += 0.5 * of.v.col(a).dot(l + of.last_step * of.force.col(a));
    result.momentum += l;
    result.moment += internal::torque_of<Dim>(of.x.col(a), l);
  }
  // What falls freely has the energy of its velocity now, whatever steps there were.
  const Vec<Dim> faster = 0.5 * of.last_step * of.acceleration;
  result.kinetic += 0.5 * of.mass.sum() * faster.squaredNorm();
  for (const auto& tool : of.tools) {
    const Vec<Dim> l = tool.of.mass * tool.now.velocity;
    const Spin<Dim> turns = tool.of.inertia * tool.now.spin;
    result.kinetic += 0.5 * (tool.of.mass * (tool.now.velocity + faster).squaredNorm() + turns.dot(tool.now.spin));
    result.momentum += l;
    result.moment += internal::torque_of<Dim>(tool.now.centre, l) + turns;
  }
  for (const auto& chunk : of.chunks)
    for (Index p = 0; p < chunk.size(); ++p) result.stabilising += of.unseen(chunk, p);
  return result;
}

template <int Dim> EnergyWatch Otm<Dim>::energy() const {
  EnergyWatch result = motion_->watch;
  result.look(balance());
  return result;
}

template <int Dim> const OtmCounts& Otm<Dim>::counts() const {
  return motion_->counts;
}
template <int Dim> OtmTimes Otm<Dim>::times() const {
  OtmTimes result = motion_->times;
  for (const auto& chunk : motion_->chunks) {
    result.kinematics += chunk.seconds.kinematics;
    result.materials += chunk.seconds.materials;
    result.forces += chunk.seconds.forces;
  }
  return result;
}
template <int Dim> Points<Dim> Otm<Dim>::wall_forces() const {
  Points<Dim> result(Dim, std::ranges::count(motion_->tools, true, &internal::Motion<Dim>::Tool::is_wall));
  Index wall = 0;
  for (const auto& tool : motion_->tools)
    if (tool.is_wall) result.col(wall++) = tool.now.force;
  return result;
}
template <int Dim> std::vector<ToolState<Dim>> Otm<Dim>::tools() const {
  std::vector<ToolState<Dim>> result;
  for (const auto& tool : motion_->tools)
    if (!tool.is_wall) result.push_back(tool.now);
  return result;
}

template class Otm<2>;
template class Otm<3>;

}  // namespace efree
