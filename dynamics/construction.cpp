// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies as they are given become nodes and chunks of material points.
#include "efree/basis/internal/neighbours.hpp"
#include "efree/dynamics/fracture/internal/fracture.hpp"
#include "efree/dynamics/internal/world.hpp"
#include "efree/materials/equation_of_state.hpp"

#include <fmt/format.h>
#include <array>
#include <map>
#include <numeric>

namespace efree::internal {
namespace {

constexpr Index points_of_a_chunk = 256;

/// Place along a curve that fills space: what is near along it is near.
template <int Dim> std::uint64_t along_curve(const Vec<Dim>& unit) {
  std::uint64_t key = 0;
  std::uint32_t cell[Dim];
  for (int i = 0; i < Dim; ++i) cell[i] = static_cast<std::uint32_t>(std::clamp(unit[i], 0.0, 1.0) * 65535.0);
  for (int bit = 15; bit >= 0; --bit)
    for (int i = 0; i < Dim; ++i) key = key << 1 | (cell[i] >> bit & 1);
  return key;
}

/// Softest stiffness against shear without change of volume.
double softest_shear(const MaterialResponse::Tangent& A) {
  double least = std::numeric_limits<double>::infinity();
  for (const auto& [i, j] : {std::pair(0, 1), std::pair(1, 2), std::pair(0, 2)}) {
    Vec<9> shear = Vec<9>::Zero(), pure = shear;
    shear[i + 3 * j] = shear[j + 3 * i] = 0.5;
    pure[4 * i] = 0.5;
    pure[4 * j] = -0.5;
    least = std::min({least, shear.dot(A * shear), pure.dot(A * pure)});
  }
  return least;
}

/// The projection of gradients to their skew part.
MaterialResponse::Tangent skew_part() {
  MaterialResponse::Tangent skew = MaterialResponse::Tangent::Zero();
  for (int J = 0; J < 3; ++J)
    for (int i = 0; i < 3; ++i) {
      skew(i + 3 * J, i + 3 * J) += 0.5;
      skew(i + 3 * J, J + 3 * i) -= 0.5;
    }
  return skew;
}

/// As apply_tangent takes it.
std::array<double, 108> padded(const MaterialResponse::Tangent& tangent) {
  std::array<double, 108> columns{};
  for (int column = 0; column < 9; ++column)
    for (int row = 0; row < 9; ++row) columns[12 * column + row / 3 * 4 + row % 3] = tangent(row, column);
  return columns;
}

/// Inverse of the tangent, which knows no rotations and may know no shear, made stiff against both.
MaterialResponse::Tangent compliance_of(const MaterialResponse::Tangent& tangent, double shear, double modulus) {
  const double least = std::max(shear, 1e-3 * modulus);
  Vec<9> trace = Vec<9>::Zero();
  trace[0] = trace[4] = trace[8] = 1.0;
  MaterialResponse::Tangent added = least * skew_part();
  if (shear < least)
    added += least * (MaterialResponse::Tangent::Identity() - skew_part() - trace * trace.transpose() / 3.0);
  return (tangent + added).inverse();
}

/// First row of a number in the history of a material; -1: it has none of that name.
Index row_of(const Material& material, std::string_view name) {
  for (const auto& part : material.history_parts())
    if (part.name == name) return part.offset;
  return -1;
}

void require_options(const DynamicsOptions& options) {
  require(options.plane != Plane::stress, "explicit dynamics are of plane strain, axisymmetric or in space");
  require(options.courant > 0.0 && options.courant <= 1.0, "courant: expected more than 0, at most 1");
  const auto valid = [](double number) { return number >= 0.0 && std::isfinite(number); };
  require(valid(options.damping), "damping: expected 0 or more");
  require(options.rest_from >= 0.0, "rest_from: expected a time of 0 or more");
  require(valid(options.shock.linear) && valid(options.shock.quadratic), "shock viscosity: expected 0 or more");
  require(valid(options.contact.friction), "contact: expected a friction of 0 or more");
  require(options.mass_scaling.factor >= 1.0 && std::isfinite(options.mass_scaling.factor),
          "mass_scaling: expected a factor of 1 or more");
  require(valid(options.mass_scaling.step), "mass_scaling: expected a step of 0 or more");
  require(options.imbalance > 0.0, "imbalance: expected more than 0");
}

/// Throws what is wrong with a body.
using Fail = std::function<void(const std::string&)>;

template <int Dim> void require_geometry(const DeformableBody<Dim>& body, bool axisymmetric, const Fail& fail) {
  const auto N = static_cast<Index>(body.nodes.cols()), M = static_cast<Index>(body.points.cols());
  if (N == 0 && M == 0) fail("expected nodes or points");
  if (!body.nodes.allFinite() || !body.points.allFinite()) fail("positions that are no numbers");
  if (body.velocity.size() != 0 && (body.velocity.cols() != (N > 0 ? N : M) || !body.velocity.allFinite()))
    fail("expected a velocity for every node, or none; for every point where there are no nodes");
  if (body.volumes.size() != M || !(body.volumes.array() > 0.0).all() || !body.volumes.allFinite())
    fail("expected a positive volume for every point");
  if (!body.patches.empty() && static_cast<Index>(body.patches.size()) != M)
    fail("expected a pressure patch for every point, or none");
  for (const Index patch : body.patches)
    if (patch < 0) fail(fmt::format("a pressure patch has the number {}", patch));
  if (!(body.radius >= 0.0) || !std::isfinite(body.radius))
    fail(fmt::format("radius {} of the nodes, expected 0 or more", body.radius));
  if (body.densities.size() != 0) {
    if (body.densities.size() != M || !(body.densities.array() > 0.0).all() || !body.densities.allFinite())
      fail("expected a positive density for every point, or none");
  } else if (M > 0 && (!(body.density > 0.0) || !std::isfinite(body.density))) {
    fail(fmt::format("density {}, expected a positive number", body.density));
  }
  if (axisymmetric && N > 0 && body.nodes.row(0).minCoeff() < 0.0)
    fail("axisymmetric: expected radii x that are not negative");
  if (body.cells.size() != 0 && (body.cells.cols() != M || body.cells.minCoeff() < 0 || body.cells.maxCoeff() >= N))
    fail("expected a cell of the body's nodes for every point, or none");
}

void require_fracture(const FractureCriteria& fracture, bool has_plastic_strain, const Fail& fail) {
  if (!(fracture.toughness >= 0.0) || !std::isfinite(fracture.toughness))
    fail(fmt::format("fracture toughness {}, expected 0 or more", fracture.toughness));
  if (!(fracture.neighbourhood >= 0.0) || fracture.neighbourhood > 10.0)
    fail(fmt::format("fracture neighbourhood {}, expected 0 to 10", fracture.neighbourhood));
  if (fracture.stretch != 0.0 && !(fracture.stretch > 1.0))
    fail(fmt::format("fracture stretch {}, expected more than 1, or 0", fracture.stretch));
  if (!(fracture.spall >= 0.0) || !std::isfinite(fracture.spall))
    fail(fmt::format("spall strength {}, expected 0 or more", fracture.spall));
  if (fracture.strain && !has_plastic_strain)
    fail("a plastic strain at failure, and a material without plastic strain");
}

template <int Dim> BodyState<Dim> body_state(const DeformableBody<Dim>& body, const Fail& fail) {
  const Material& material = *body.material;
  const MaterialResponse rest =
      respond(material, Deformation::none(Points<3>::Zero(3, 1), material.history_size()), true);
  const MaterialResponse::Tangent tangent = rest.tangent_at(0);
  const double shear = softest_shear(tangent), modulus = std::max({tangent(0, 0), tangent(4, 4), tangent(8, 8)});
  if (!(modulus > 0.0)) fail("a material without stiffness");
  const Index plastic_strain = row_of(material, "equivalent_plastic_strain");
  require_fracture(body.fracture, plastic_strain >= 0, fail);
  return {.material = body.material,
          .tangent = padded(tangent),
          .compliance = padded(compliance_of(tangent, shear, modulus)),
          .shear = shear,
          .modulus = modulus,
          .fracture = body.fracture,
          .strength = body.strength,
          .plastic_strain = plastic_strain,
          .temperature = row_of(material, "temperature_rise"),
          .plastic_metric = row_of(material, "inverse_plastic_metric"),
          .release = release_factor<Dim>(shear, modulus),
          .cells = body.cells,
          .runs_together = dynamic_cast<const Fluid*>(&material) != nullptr};
}

/// Points along a curve that fills space, those of pressure patches together.
template <int Dim> std::vector<Index> order_points(const DeformableBody<Dim>& body, const std::vector<Index>& patches) {
  const auto M = static_cast<Index>(patches.size());
  const Points<Dim>& around = body.nodes.cols() > 0 ? body.nodes : body.points;
  const Vec<Dim> low = around.rowwise().minCoeff();
  const double extent = (around.rowwise().maxCoeff() - low).maxCoeff();
  std::vector<std::uint64_t> key(std::ranges::max(patches) + 1, std::numeric_limits<std::uint64_t>::max());
  for (Index p = 0; p < M; ++p)
    key[patches[p]] = std::min(key[patches[p]], along_curve<Dim>((body.points.col(p) - low) / extent));
  std::vector<Index> order(M);
  std::iota(order.begin(), order.end(), 0);
  std::ranges::sort(order, {}, [&](Index p) { return std::tuple(key[patches[p]], patches[p], p); });
  return order;
}

/// Radius of the ball (disk) that has the volume of a point.
template <int Dim> double radius_of_volume(const World<Dim>& world, const Matter<Dim>& matter, Index p) {
  if (Dim == 3) return std::cbrt(0.75 / std::numbers::pi * matter.volume[p]);
  return std::sqrt(matter.volume[p] / (world.out_of_plane(matter.x(0, p)) * std::numbers::pi));
}

template <int Dim> Mat<Dim> isotropic_metric(double spacing) {
  return 1.0 / (spacing * spacing) * Mat<Dim>::Identity();
}

/// A chunk of these points of a body, which are at rest.
template <int Dim> Chunk<Dim> make_chunk(const World<Dim>& world, const DeformableBody<Dim>& body, Index b,
                                         const PointStorage& storage, std::span<const Index> points,
                                         const Neighbours<Dim>& nodes) {
  const auto n = static_cast<Index>(points.size());
  Chunk<Dim> chunk;
  chunk.body = b;
  chunk.number.assign(points.begin(), points.end());
  Matter<Dim>& matter = chunk.matter;
  matter.x = body.points(Eigen::all, chunk.number);
  matter.volume = body.volumes(chunk.number);
  matter.mass = matter.volume * body.density;
  if (body.densities.size() != 0) matter.mass = matter.volume.cwiseProduct(body.densities(chunk.number));
  matter.mass *= world.options.mass_scaling.factor;
  Points<3> X = Points<3>::Zero(3, n);
  X.template topRows<Dim>() = matter.x;
  matter.now = Deformation::none(std::move(X), body.material->history_size());
  MaterialResponse response = efree::respond(*body.material, matter.now, false);
  matter.P = std::move(response.P);
  matter.energy = std::move(response.energy);
  if (storage.table_gradients) {
    matter.F_table = matter.now.F;
    matter.F_since.assign(n, Mat<3>::Identity());
  }
  matter.eroded.assign(n, 0);
  Vector spacing(n);
  for (Index p = 0; p < n; ++p)
    spacing[p] = body.nodes.cols() > 0 ? world.nodes.spacing[world.first_node[b] + nodes.nearest(matter.x.col(p))]
                                       : 2.0 * radius_of_volume(world, matter, p);
  if (storage.supports || world.options.shock.on())
    for (const double h : spacing) chunk.support.metric.push_back(isotropic_metric<Dim>(h));
  matter.J_ratio.setOnes(n);
  matter.modulus.setConstant(n, world.bodies[b].modulus);
  if (storage.supports) {
    chunk.support.moment.assign(n, Mat<Dim>::Identity());
    chunk.support.stabilisation.setZero(n);
    for (Vector* ones : {&matter.J, &matter.stiffness_ratio}) ones->setOnes(n);
    matter.shock.setZero(n);
  }
  if (body.fracture.on() && body.fracture.neighbourhood > 0.0)
    matter.crack_radius = body.fracture.neighbourhood * spacing;
  complete_storage(world, chunk);
  chunk.table.offsets.assign(n + 1, 0);
  return chunk;
}

/// Chunks of the points of a body.
template <int Dim> void add_chunks(World<Dim>& world, const DeformableBody<Dim>& body, Index b,
                                   const PointStorage& storage, const Neighbours<Dim>& nodes) {
  const auto M = static_cast<Index>(body.points.cols());
  if (M == 0) return;
  std::vector<Index> patches = body.patches;
  if (patches.empty())
    for (Index p = 0; p < M; ++p) patches.push_back(p);
  const std::vector<Index> order = order_points(body, patches);
  for (Index begin = 0; begin < M;) {
    Index end = begin;
    std::vector<Index> starts;
    const auto goes_on = [&] { return end > begin && patches[order[end]] == patches[order[end - 1]]; };
    for (; end < M && (end - begin < points_of_a_chunk || goes_on()); ++end)
      if (!goes_on()) starts.push_back(end - begin);
    starts.push_back(end - begin);
    world.chunks.push_back(
        make_chunk<Dim>(world, body, b, storage, std::span(order).subspan(begin, end - begin), nodes));
    world.chunks.back().patches.assign(starts.begin(), starts.end());
    begin = end;
  }
}

}  // namespace

template <int Dim> void complete_storage(const World<Dim>& world, Chunk<Dim>& chunk) {
  const Index n = chunk.size();
  Matter<Dim>& matter = chunk.matter;
  const auto radius = [&](Index p) { return radius_of_volume(world, matter, p); };
  if (world.options.shock.on() != (matter.now.heat.size() != 0)) {
    matter.now.heat.setZero(world.options.shock.on() ? n : 0);
    matter.shock.setZero(world.options.shock.on() || matter.shock.size() != 0 ? n : 0);
    matter.J = Vector::NullaryExpr(n, [&](Index p) { return matter.now.gradient(p).determinant(); });
    if (chunk.support.metric.empty())
      for (Index p = 0; p < n; ++p) chunk.support.metric.push_back(isotropic_metric<Dim>(2.0 * radius(p)));
  }
  if (!world.bodies[chunk.body].fracture.on()) return;
  if (matter.damage.size() == 0) matter.damage.setZero(n);
  if (matter.crack_radius.size() == 0) matter.crack_radius = Vector::NullaryExpr(n, radius);
}

template <int Dim> void construct(World<Dim>& world, const std::vector<DeformableBody<Dim>>& bodies,
                                  const std::vector<PointStorage>& storage, const DynamicsOptions& options) {
  require_options(options);
  require(!bodies.empty(), "no body is given");
  world.options = options;
  world.first_node.assign(1, 0);
  world.first_point.assign(1, 0);
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const auto fail = [b](const std::string& what) { throw InputError(fmt::format("body {}: {}", b, what)); };
    require_geometry(bodies[b], world.axisymmetric(), fail);
    world.bodies.push_back(body_state(bodies[b], fail));
    world.first_node.push_back(world.first_node.back() + static_cast<Index>(bodies[b].nodes.cols()));
    world.first_point.push_back(world.first_point.back() + static_cast<Index>(bodies[b].points.cols()));
  }
  const Index N = world.first_node.back();
  Nodes<Dim>& nodes = world.nodes;
  nodes.x.resize(Dim, N);
  for (Points<Dim>* values : {&nodes.x_rest, &nodes.v, &nodes.force}) values->setZero(Dim, N);
  nodes.mass.setZero(N);
  nodes.spacing.resize(N);
  nodes.master.assign(N, -1);
  nodes.body.reserve(N);
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const DeformableBody<Dim>& body = bodies[b];
    const Index first = world.first_node[b], count = static_cast<Index>(body.nodes.cols());
    nodes.x.middleCols(first, count) = body.nodes;
    if (count > 0 && body.velocity.size() != 0) nodes.v.middleCols(first, count) = body.velocity;
    if (body.radius > 0.0 && nodes.radius.size() == 0) nodes.radius.setZero(N);
    if (nodes.radius.size() != 0) nodes.radius.segment(first, count).setConstant(body.radius);
    nodes.body.insert(nodes.body.end(), count, static_cast<Index>(b));
    Neighbours<Dim> tree;
    if (count > 0) tree.build(body.nodes);
    for (Index a = 0; a < count; ++a) nodes.spacing[first + a] = tree.spacing(body.nodes.col(a));
    add_chunks<Dim>(world, body, static_cast<Index>(b), storage[b], tree);
  }
  world.find_points();
  world.find_free_axes();
}

template <int Dim> Index tie_bodies(World<Dim>& world) {
  if (world.consistent_mass.any())
    throw InputError("bodies with consistent masses cannot be tied: expected lumped ones");
  Nodes<Dim>& nodes = world.nodes;
  const auto place = [&](Index a) {
    std::array<double, Dim> of;
    for (int i = 0; i < Dim; ++i) of[i] = nodes.x(i, a);
    return of;
  };
  std::map<std::array<double, Dim>, Index> at;
  Index count = 0;
  for (Index a = 0; a < nodes.size(); ++a) {
    const auto [found, is_first] = at.try_emplace(place(a), a);
    const Index first = found->second;
    if (is_first || nodes.body[first] == nodes.body[a]) continue;
    const double mass = nodes.mass[first] + nodes.mass[a];
    if (mass > 0.0)
      nodes.v.col(first) = (nodes.mass[first] * nodes.v.col(first) + nodes.mass[a] * nodes.v.col(a)) / mass;
    nodes.mass[first] = mass;
    nodes.mass[a] = 0.0;
    nodes.v.col(a) = nodes.v.col(first);
    nodes.master[a] = first;
    ++count;
  }
  // A chunk is of one body: it has no two nodes at the same place.
  for (Chunk<Dim>& chunk : world.chunks)
    for (Index& node : chunk.table.nodes) node = nodes.master_of(node);
  return count;
}

template Index tie_bodies(World<2>&);
template Index tie_bodies(World<3>&);
template void complete_storage(const World<2>&, Chunk<2>&);
template void complete_storage(const World<3>&, Chunk<3>&);
template void construct(World<2>&, const std::vector<DeformableBody<2>>&, const std::vector<PointStorage>&,
                        const DynamicsOptions&);
template void construct(World<3>&, const std::vector<DeformableBody<3>>&, const std::vector<PointStorage>&,
                        const DynamicsOptions&);

}  // namespace efree::internal
