// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies as they are given become chunks of points.
#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"
#include "efree/otm/internal/motion.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <span>
#include <string_view>

namespace efree::internal {
namespace {

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

/// What makes a gradient skew.
MaterialResponse::Tangent turns() {
  MaterialResponse::Tangent skew = MaterialResponse::Tangent::Zero();
  for (int J = 0; J < 3; ++J)
    for (int i = 0; i < 3; ++i) {
      skew(i + 3 * J, i + 3 * J) += 0.5;
      skew(i + 3 * J, J + 3 * i) -= 0.5;
    }
  return skew;
}

/// As otm_stiffness takes it.
std::array<double, 108> padded(const MaterialResponse::Tangent& tangent) {
  std::array<double, 108> columns{};
  for (int column = 0; column < 9; ++column)
    for (int row = 0; row < 9; ++row) columns[12 * column + row / 3 * 4 + row % 3] = tangent(row, column);
  return columns;
}

/// Inverse of the tangent, which knows no turns and may know no shear, made stiff against both.
MaterialResponse::Tangent compliance_of(const MaterialResponse::Tangent& tangent, double shear, double modulus) {
  const double least = std::max(shear, 1e-3 * modulus);
  Vec<9> trace = Vec<9>::Zero();
  trace[0] = trace[4] = trace[8] = 1.0;
  MaterialResponse::Tangent added = least * turns();
  if (shear < least)
    added += least * (MaterialResponse::Tangent::Identity() - turns() - trace * trace.transpose() / 3.0);
  return (tangent + added).inverse();
}

/// C of energy release rates by the mean energy of a ball of radius r, G = C r mean(W). About a crack tip in plane
/// strain W is G (3 - 4 nu - c) (1 + c) / (8 pi (1 - nu) s) at the distance s, c the cosine to the crack's direction
/// (Sih 1974): (5/2 - 4 nu) on average, and the mean of 1 / s is 2 / r in a disk, 3 pi / (4 r) in a ball.
template <int Dim> double release_factor(double shear, double modulus) {
  const double nu = 0.5 * (modulus - 2.0 * shear) / (modulus - shear);
  const double disk = 4.0 * std::numbers::pi * (1.0 - nu) / (2.5 - 4.0 * nu);
  return Dim == 2 ? disk : disk * 8.0 / (3.0 * std::numbers::pi);
}

/// Where a number is in the history of a material; -1: nowhere.
Index row_of(const Material& material, std::string_view name) {
  for (const auto& part : material.history_parts())
    if (part.name == name) return part.offset;
  return -1;
}

constexpr Index points_of_a_chunk = 256;

}  // namespace

template <int Dim> Motion<Dim>::Motion(std::vector<OtmBody<Dim>> given, const OtmOptions& options_given)
    : options(options_given) {
  if (options.functions == OtmFunctions::smoothed_particles)
    options.renewal = options.merging = options.injection = 0.0;
  options.lme.checked();
  require(!given.empty(), "no body is given");
  require(options.plane != Plane::stress, "explicit dynamics are of plane strain, axisymmetric or in space");
  require(options.renewal >= 0.0 && options.renewal <= 0.5, "renewal: expected 0 to 0.5");
  require(options.anisotropy >= 1.0, "anisotropy: expected at least 1");
  require(options.courant > 0.0 && options.courant <= 1.0, "courant: expected more than 0, at most 1");
  require(options.shock.linear >= 0.0 && options.shock.quadratic >= 0.0 && std::isfinite(options.shock.linear) &&
              std::isfinite(options.shock.quadratic),
          "shock viscosity: expected 0 or more");
  require(options.merging >= 0.0 && options.merging <= 0.9, "merging: expected 0 to 0.9");
  require(options.injection == 0.0 || (options.injection >= 1.3 && std::isfinite(options.injection)),
          "injection: expected 0, or 1.3 and more");
  require(options.contact.stiffness >= 0.0 && std::isfinite(options.contact.stiffness) &&
              options.contact.friction >= 0.0 && std::isfinite(options.contact.friction),
          "contact: expected a stiffness and a friction of 0 or more");
  require(!options.contact.seizing || options.functions == OtmFunctions::lme,
          "contact: bodies seize by functions of maximum entropy, not as smoothed particles");
  require(options.stabilisation >= 0.0 && std::isfinite(options.stabilisation), "stabilisation: expected 0 or more");
  require(options.imbalance > 0.0, "imbalance: expected more than 0");
  Index num_nodes = 0, num_points = 0;
  for (const auto& body : given) {
    const auto b = static_cast<Index>(&body - given.data());
    const auto N = static_cast<Index>(body.nodes.cols()), M = static_cast<Index>(body.points.cols());
    const auto fail = [&](const std::string& what) { throw InputError(fmt::format("body {}: {}", b, what)); };
    if (N == 0 || M == 0) fail("expected nodes and points");
    if (!body.nodes.allFinite() || !body.points.allFinite()) fail("places that are no numbers");
    if (body.velocity.size() != 0 && (body.velocity.cols() != N || !body.velocity.allFinite()))
      fail("expected a velocity for every node, or none");
    if (body.volumes.size() != M || !(body.volumes.array() > 0.0).all() || !body.volumes.allFinite())
      fail("expected a positive volume for every point");
    if (!body.unions.empty() && static_cast<Index>(body.unions.size()) != M)
      fail("expected a union for every point, or none");
    if (body.densities.size() != 0) {
      if (body.densities.size() != M || !(body.densities.array() > 0.0).all() || !body.densities.allFinite())
        fail("expected a positive density for every point, or none");
    } else if (!(body.density > 0.0) || !std::isfinite(body.density)) {
      fail(fmt::format("density {}, expected a positive number", body.density));
    }
    if (body.shape && (body.shape->num_points() != M || body.shape->num_nodes() != N || !body.shape->has_gradients() ||
                       body.shape->has_hoop() != axisymmetric()))
      fail(fmt::format("functions of {} points and {} nodes, expected {} and {}, with gradients{}",
                       body.shape->num_points(), body.shape->num_nodes(), M, N,
                       axisymmetric() ? " and values over the radius" : ""));
    if (!body.shape && (body.surface || body.mass_terms != 1))
      fail("points of a surface and terms of the mass are for functions that are given for good");
    if (body.mass_terms > 1 && (!body.surface || body.cells.size() != 0))
      fail("more than one term of the mass: expected points of a surface, and no cells");
    if (body.mass_terms < 1 || body.mass_terms > 8)
      fail(fmt::format("{} terms of the mass, expected 1 to 8", body.mass_terms));
    if (body.surface && body.surface->num_nodes() != N)
      fail(fmt::format("functions of {} nodes on the surface, expected {}", body.surface->num_nodes(), N));
    fixed = fixed || body.surface || body.mass_terms > 1;
    if (fixed && options.injection > 0.0) fail("injection is for functions that are made anew, expected 0");
    if (axisymmetric() && body.nodes.row(0).minCoeff() < 0.0)
      fail("axisymmetric: expected radii x that are not negative");
    if (body.cells.size() != 0) {
      if (body.cells.cols() != M || body.cells.minCoeff() < 0 || body.cells.maxCoeff() >= N)
        fail("expected a cell of the body's nodes for every point, or none");
    } else if (given.size() > 1 && (options.contact.seizing || options.contact.stiffness > 0.0)) {
      fail(
          "it has no cells, so nobody knows the surface that other bodies touch: give it cells, or take "
          "contact.stiffness = 0");
    }
    if (options.contact.seizing && body.shape)
      fail("its functions are given for good, and bodies seize by functions that are made anew; expected no seizing");
    if (options.functions == OtmFunctions::smoothed_particles && !body.shape && body.nodes != body.points)
      fail("smoothed particles: expected nodes that are the points");
    const Material& material = *body.material;
    const MaterialResponse rest =
        respond(material, Deformation::none(Points<3>::Zero(3, 1), material.history_size()), true);
    const MaterialResponse::Tangent tangent = rest.tangent_at(0);
    const double shear = softest_shear(tangent), modulus = std::max({tangent(0, 0), tangent(4, 4), tangent(8, 8)});
    if (!(modulus > 0.0)) fail("a material without stiffness");
    if (options.injection > 0.0 && body.shape)
      fail("injection: its functions are given, and nodes that come in have none; expected injection = 0");
    const OtmFracture& fracture = body.fracture;
    if (!(fracture.toughness >= 0.0) || !std::isfinite(fracture.toughness))
      fail(fmt::format("fracture toughness {}, expected 0 or more", fracture.toughness));
    if (!(fracture.neighbourhood >= 0.0) || fracture.neighbourhood > 10.0)
      fail(fmt::format("fracture neighbourhood {}, expected 0 to 10", fracture.neighbourhood));
    if (fracture.stretch != 0.0 && !(fracture.stretch > 1.0))
      fail(fmt::format("fracture stretch {}, expected more than 1, or 0", fracture.stretch));
    const Index plastic_strain = row_of(material, "equivalent_plastic_strain");
    if (fracture.strain) {
      if (plastic_strain < 0) fail("a plastic strain at failure, and a material that knows of no plastic strain");
      if (!(fracture.strain->reference > 0.0) || !(fracture.strain->melting >= 0.0))
        fail("plastic strain at failure: expected a positive rate of reference, and a rise to melting of 0 or more");
    }
    const bool integrates = options.functions == OtmFunctions::lme && !body.shape && body.cells.size() != 0 &&
                            options.exact_integration && options.renewal > 0.0;
    bodies.push_back({body.material, padded(tangent), padded(compliance_of(tangent, shear, modulus)), shear, modulus,
                      !body.shape.has_value(), integrates, material.finite_strain(), body.surface.has_value(),
                      body.mass_terms, fracture, plastic_strain, row_of(material, "temperature_rise"),
                      row_of(material, "inverse_plastic_metric"), release_factor<Dim>(shear, modulus), body.cells,
                      num_nodes, num_points});
    num_nodes += N;
    num_points += M;
    sizes.insert(sizes.end(), {N, M});
  }
  bodies.push_back(
      {{}, {}, {}, 0.0, 0.0, false, false, true, false, 1, {}, -1, -1, -1, 0.0, {}, num_nodes, num_points});
  x.resize(Dim, num_nodes);
  merged.assign(num_nodes, -1);
  x_rest.setZero(Dim, num_nodes);
  v.setZero(Dim, num_nodes);
  force.setZero(Dim, num_nodes);
  spacing.resize(num_nodes);
  place_of_point.resize(num_points);
  for (std::size_t b = 0; b < given.size(); ++b) {
    const auto& body = given[b];
    const Index N = static_cast<Index>(body.nodes.cols()), M = static_cast<Index>(body.points.cols());
    const Index first = bodies[b].first_node;
    x.middleCols(first, N) = body.nodes;
    if (body.velocity.size() != 0) v.middleCols(first, N) = body.velocity;
    body_of_node.insert(body_of_node.end(), N, static_cast<Index>(b));
    trees.push_back(std::make_unique<Neighbours<Dim>>());
    trees.back()->build(body.nodes);
    drift.push_back(0.0);
    for (Index a = 0; a < N; ++a) spacing[first + a] = trees.back()->spacing(body.nodes.col(a));
    // Points in the order of a curve, unions together.
    const Vec<Dim> low = body.nodes.rowwise().minCoeff();
    const double extent = (body.nodes.rowwise().maxCoeff() - low).maxCoeff();
    std::vector<Index> order(M), unions = body.unions;
    if (unions.empty()) {
      unions.resize(M);
      std::iota(unions.begin(), unions.end(), 0);
    }
    const Index num_unions = *std::max_element(unions.begin(), unions.end()) + 1;
    std::vector<std::uint64_t> key(num_unions, std::numeric_limits<std::uint64_t>::max());
    for (Index p = 0; p < M; ++p) {
      if (unions[p] < 0) throw InputError(fmt::format("body {}: a union of points has the number {}", b, unions[p]));
      key[unions[p]] = std::min(key[unions[p]], along_curve<Dim>((body.points.col(p) - low) / extent));
    }
    const auto ball_as_large = [&](const OtmChunk<Dim>& chunk, Index p) {
      if (Dim == 3) return std::cbrt(0.75 / std::numbers::pi * chunk.volume[p]);
      return std::sqrt(chunk.volume[p] / (across(chunk.at(0, p)) * std::numbers::pi));
    };
    std::iota(order.begin(), order.end(), 0);
    std::sort(order.begin(), order.end(), [&](Index p, Index q) {
      return std::tuple(key[unions[p]], unions[p], p) < std::tuple(key[unions[q]], unions[q], q);
    });
    for (Index begin = 0; begin < M;) {
      Index end = begin;
      std::vector<Index> starts;
      while (end < M && (end - begin < points_of_a_chunk || unions[order[end]] == unions[order[end - 1]])) {
        if (starts.empty() || unions[order[end]] != unions[order[end - 1]]) starts.push_back(end - begin);
        ++end;
      }
      const Index n = end - begin;
      starts.push_back(n);
      OtmChunk<Dim> chunk;
      chunk.body = static_cast<Index>(b);
      chunk.unions = std::move(starts);
      Points<3> X = Points<3>::Zero(3, n);
      chunk.volume.resize(n);
      chunk.mass.resize(n);
      chunk.at.resize(Dim, n);
      for (Index p = 0; p < n; ++p) {
        const Index of = order[begin + p];
        X.col(p).template head<Dim>() = body.points.col(of);
        chunk.at.col(p) = body.points.col(of);
        chunk.number.push_back(of);
        chunk.volume[p] = body.volumes[of];
        chunk.mass[p] = body.volumes[of] * (body.densities.size() != 0 ? body.densities[of] : body.density);
        place_of_point[bodies[b].first_point + of] = {static_cast<Index>(chunks.size()), p};
      }
      chunk.now = Deformation::none(std::move(X), body.material->history_size());
      chunk.response = respond(*body.material, chunk.now, false);
      chunk.made = chunk.now.F;
      chunk.since.assign(n, Mat<3>::Identity());
      chunk.reach.resize(n);
      for (Index p = 0; p < n; ++p) {
        const double h = spacing[first + trees.back()->nearest(chunk.at.col(p))];
        chunk.metric.push_back(options.lme.gamma / (h * h) * Mat<Dim>::Identity());
        chunk.reach[p] = body.fracture.neighbourhood > 0.0 ? body.fracture.neighbourhood * h : ball_as_large(chunk, p);
      }
      chunk.moment.assign(n, Mat<Dim>::Identity());
      chunk.lambda.assign(n, Vec<Dim>::Zero());
      chunk.count.setZero(n);
      chunk.width.setZero(n);
      chunk.growth.setOnes(n);
      chunk.dilatation.setOnes(n);
      chunk.shock.setZero(n);
      if (options.shock.on()) chunk.now.heat.setZero(n);
      chunk.modulus.setConstant(n, bodies[b].modulus);
      chunk.stiffening.setOnes(n);
      chunk.penalty.setZero(n);
      chunk.damage.setZero(n);
      chunk.offsets.assign(n + 1, 0);
      chunks.push_back(std::move(chunk));
      begin = end;
    }
  }
  std::vector<OtmCounts> counted(chunks.size());
  parallel_chunks(static_cast<Index>(chunks.size()), 1, [&](Index c, Index) {
    OtmChunk<Dim>& chunk = chunks[c];
    std::vector<Index> all(chunk.size());
    std::iota(all.begin(), all.end(), 0);
    if (const auto& shape = given[chunk.body].shape) return put_rows(chunk, all, rows_of(chunk, *shape));
    const Change made = make_functions(chunk, all, true);
    if (!made.lost.empty()) throw NumericalError(has_no_functions(chunk, made.lost.front()));
    counted[c] = made.counted;
    put_rows(chunk, all, made.rows);
  });
  for (const auto& c : counted) counts.iterations += c.iterations;
  find_places();
  if (!fixed) find_free();
  integrate_exactly();
  find_masses();
  find_momenta();
  take_surfaces(given);
  dissipated.setZero(static_cast<Index>(chunks.size()));
  viscous.setZero(static_cast<Index>(chunks.size()));
  stored.setZero(static_cast<Index>(chunks.size()));
  sweep(0.0);
  // Energies of bodies at rest are rounding: some 1e-17 of moduli times volumes.
  for (const auto& chunk : chunks) watch.scale += 1e-15 * chunk.modulus.dot(chunk.volume);
  // Any shape that is nothing special to start with, the same every time.
  shaken.resize(Dim, num_nodes);
  std::uint64_t random = 88172645463325252u;
  for (Index a = 0; a < num_nodes; ++a)
    for (int i = 0; i < Dim; ++i) {
      random ^= random << 13, random ^= random >> 7, random ^= random << 17;
      shaken(i, a) = static_cast<double>(random >> 11) * 0x1p-53 - 0.5;
    }
  move_tables();
  stiffen();
  shake(40);
  first_stable = stable;
}

/// To large pages: every step goes through all of them.
template <int Dim> void Motion<Dim>::move_tables() const {
  std::vector<std::span<const std::byte>> tables;
  for (const OtmChunk<Dim>& chunk : chunks) chunk.add_tables(tables);
  move_to_large_pages(tables);
}

template struct Motion<2>;
template struct Motion<3>;

}  // namespace efree::internal
