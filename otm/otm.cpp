// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/otm/otm.hpp"

#include "efree/basis/internal/neighbours.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/otm/internal/chunk.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <numeric>

namespace efree {
namespace {

using namespace internal;
using Clock = std::chrono::steady_clock;

/// Seconds since then, which is now from now on.
double lap(Clock::time_point& start) {
  const Clock::time_point now = Clock::now();
  return std::chrono::duration<double>(now - std::exchange(start, now)).count();
}

/// Place along a curve that fills space: what is near along it is near.
template <int Dim> std::uint64_t along_curve(const Vec<Dim>& unit) {
  std::uint64_t key = 0;
  std::uint32_t cell[Dim];
  for (int i = 0; i < Dim; ++i) cell[i] = static_cast<std::uint32_t>(std::clamp(unit[i], 0.0, 1.0) * 65535.0);
  for (int bit = 15; bit >= 0; --bit)
    for (int i = 0; i < Dim; ++i) key = key << 1 | (cell[i] >> bit & 1);
  return key;
}

template <int Dim> double smallest_eigenvalue(const Mat<Dim>& of) {
  return Eigen::SelfAdjointEigenSolver<Mat<Dim>>(of, Eigen::EigenvaluesOnly).eigenvalues()[0];
}

/// A node's function as kernels read it; `hoop` is over the radius.
template <int Dim> OtmEntry entry_of(double N, const Vec<Dim>& dN, double hoop) {
  OtmEntry entry{{0.0, 0.0, hoop}, N};
  for (int i = 0; i < Dim; ++i) entry.dN[i] = dN[i];
  return entry;
}

/// The metric with the same determinant whose axes have lengths of at most that ratio.
template <int Dim> Mat<Dim> rounded(const Mat<Dim>& metric, double ratio) {
  const Eigen::SelfAdjointEigenSolver<Mat<Dim>> axes(metric);
  Vec<Dim> value = axes.eigenvalues();  // ascending, 1 / length^2
  const double most = ratio * ratio;
  if (value[Dim - 1] <= most * value[0]) return metric;
  const double product = value.prod();
  // The two ends are brought in by as much, until the ratio is what it may be.
  Vec<Dim> log = value.array().log();
  const double excess = log[Dim - 1] - log[0] - std::log(most);
  log[0] += 0.5 * excess;
  log[Dim - 1] -= 0.5 * excess;
  if constexpr (Dim == 3) log[1] = std::clamp(log[1], log[0], log[2]);
  value = log.array().exp();
  value *= std::pow(product / value.prod(), 1.0 / Dim);
  return axes.eigenvectors() * value.asDiagonal() * axes.eigenvectors().transpose();
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

constexpr Index points_of_a_chunk = 256;
/// |F - I| beyond which what is linear in it is wrong by more than a few per cent.
constexpr double small_strains = 0.05;

}  // namespace

template <int Dim> struct Otm<Dim>::Parts {
  struct BodyOf {
    SharedMaterial material;
    MaterialResponse::Tangent tangent, compliance;  ///< at rest; of turns as of shear
    double shear;
    bool renewed;  ///< whether functions are
    bool finite;   ///< whether the material is for finite strains
    Index first_node, first_point;
  };
  struct Prescribed {
    Index node;
    int axis;
    double velocity;
  };

  /// Of points: nodes and functions.
  using Rows = std::vector<std::vector<std::pair<Index, OtmEntry>>>;

  OtmOptions options;
  std::vector<BodyOf> bodies;
  Points<Dim> x, v, force;
  Points<Dim> was;  ///< v a step ago
  Vector mass;
  std::vector<OtmChunk<Dim>> chunks;
  std::vector<std::pair<Index, Index>> place_of_point;  ///< chunk and number there
  // By node: where its forces are.
  std::vector<Index> node_offsets;
  std::vector<std::pair<Index, Index>> node_places;
  std::vector<OtmWall<Dim>> walls;
  Points<Dim> wall_forces;
  std::vector<Prescribed> prescribed;

  std::vector<std::unique_ptr<Neighbours<Dim>>> trees;  ///< by body, of nodes
  Vector spacing;                                       ///< by node, at the start
  double time = 0.0, last_step = 0.0, stable = 0.0;
  double contact_loss = 0.0, renewal_loss = 0.0, prescribed_work = 0.0;
  Vector dissipated;   ///< by chunk, so far
  Vector stored;       ///< by chunk
  Points<Dim> shaken;  ///< the shape of the fastest vibration, as far as it is known
  OtmCounts counts;
  OtmTimes times;

  bool axisymmetric() const { return Dim == 2 && options.plane == Plane::axisymmetric; }

  Parts(std::vector<OtmBody<Dim>> given, const OtmOptions& options_given);
  void make_functions(OtmChunk<Dim>& chunk, const std::vector<Index>& which, bool first, Rows& rows,
                      OtmCounts& counted) const;
  void take_functions(const OtmChunk<Dim>& chunk, const ShapeTable<Dim>& shape, Rows& rows) const;
  void put_rows(OtmChunk<Dim>& chunk, const std::vector<Index>& which, const Rows& rows);
  void find_places();
  void deform(OtmChunk<Dim>& chunk, const Points<Dim>& of) const;
  void place(OtmChunk<Dim>& chunk, Index p) const;
  Points<Dim> collected() const;
  Mat<3> gradient(const double* column, double across) const;
  template <class At, class Since> void push(OtmChunk<Dim>& chunk, const At& at, const Since& since) const;
  void sweep(double dt);
  void sweep(Index number, double dt);
  void renew();
  double unseen(const OtmChunk<Dim>& chunk, Index p) const;
  void move(double kick, double dt);
  void stiffen();
  void shake(Index repeats);
};

template <int Dim> Otm<Dim>::Parts::Parts(std::vector<OtmBody<Dim>> given, const OtmOptions& options_given)
    : options(options_given) {
  options.lme.checked();
  require(!given.empty(), "no body is given");
  require(options.plane != Plane::stress, "explicit dynamics are of plane strain, axisymmetric or in space");
  require(options.renewal >= 0.0 && options.renewal <= 0.5, "renewal: expected 0 to 0.5");
  require(options.anisotropy >= 1.0, "anisotropy: expected at least 1");
  require(options.courant > 0.0 && options.courant <= 1.0, "courant: expected more than 0, at most 1");
  require(options.stabilisation >= 0.0 && std::isfinite(options.stabilisation), "stabilisation: expected 0 or more");
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
    if (!(body.density > 0.0) || !std::isfinite(body.density))
      fail(fmt::format("density {}, expected a positive number", body.density));
    if (body.shape && (body.shape->num_points() != M || body.shape->num_nodes() != N || !body.shape->has_gradients() ||
                       body.shape->has_hoop() != axisymmetric()))
      fail(fmt::format("functions of {} points and {} nodes, expected {} and {}, with gradients{}",
                       body.shape->num_points(), body.shape->num_nodes(), M, N,
                       axisymmetric() ? " and values over the radius" : ""));
    if (axisymmetric() && body.nodes.row(0).minCoeff() < 0.0)
      fail("axisymmetric: expected radii x that are not negative");
    const Material& material = *body.material;
    const MaterialResponse rest =
        respond(material, Deformation::none(Points<3>::Zero(3, 1), material.history_size()), true);
    const MaterialResponse::Tangent tangent = rest.tangent_at(0);
    const double shear = softest_shear(tangent);
    bodies.push_back({body.material, tangent, (tangent + shear * turns()).inverse(), shear, !body.shape.has_value(),
                      material.finite_strain(), num_nodes, num_points});
    num_nodes += N;
    num_points += M;
  }
  bodies.push_back({{}, {}, {}, 0.0, false, true, num_nodes, num_points});
  x.resize(Dim, num_nodes);
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
    trees.push_back(std::make_unique<Neighbours<Dim>>());
    trees.back()->build(body.nodes);
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
      chunk.at.resize(Dim, n);
      for (Index p = 0; p < n; ++p) {
        const Index of = order[begin + p];
        X.col(p).template head<Dim>() = body.points.col(of);
        chunk.at.col(p) = body.points.col(of);
        chunk.number.push_back(of);
        chunk.volume[p] = body.volumes[of];
        place_of_point[bodies[b].first_point + of] = {static_cast<Index>(chunks.size()), p};
      }
      chunk.now = Deformation::none(std::move(X), body.material->history_size());
      chunk.response = respond(*body.material, chunk.now, false);
      chunk.made = chunk.now.F;
      chunk.since.assign(n, Mat<3>::Identity());
      chunk.mass = body.density * chunk.volume;
      chunk.metric.assign(n, Mat<Dim>::Identity());
      chunk.moment.assign(n, Mat<Dim>::Identity());
      chunk.lambda.assign(n, Vec<Dim>::Zero());
      chunk.growth.setOnes(n);
      chunk.stiffening.setOnes(n);
      chunk.penalty.setZero(n);
      chunk.columns.resize(16 * n);
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
    Rows rows(all.size());
    if (const auto& shape = given[chunk.body].shape)
      take_functions(chunk, *shape, rows);
    else
      make_functions(chunk, all, true, rows, counted[c]);
    put_rows(chunk, all, rows);
  });
  for (const auto& c : counted) counts.iterations += c.iterations;
  find_places();
  mass.setZero(num_nodes);
  for (const auto& chunk : chunks)
    for (Index p = 0; p < chunk.size(); ++p)
      for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e)
        mass[chunk.nodes[chunk.local[e]]] += chunk.mass[p] * chunk.entries[e].N;
  for (std::size_t b = 0; b + 1 < bodies.size(); ++b)
    for (Index a = bodies[b].first_node; a < bodies[b + 1].first_node; ++a)
      if (!(mass[a] > 0.0))
        throw NumericalError(fmt::format("node {} of body {} at ({:.6g}) has no mass: no material point is near it",
                                         a - bodies[b].first_node, b, fmt::join(x.col(a), ", ")));
  dissipated.setZero(static_cast<Index>(chunks.size()));
  stored.setZero(static_cast<Index>(chunks.size()));
  sweep(0.0);
  // Any shape that is nothing special to start with, the same every time.
  shaken.resize(Dim, num_nodes);
  std::uint64_t random = 88172645463325252u;
  for (Index a = 0; a < num_nodes; ++a)
    for (int i = 0; i < Dim; ++i) {
      random ^= random << 13, random ^= random >> 7, random ^= random << 17;
      shaken(i, a) = static_cast<double>(random >> 11) * 0x1p-53 - 0.5;
    }
  stiffen();
  shake(100);
}

template <int Dim> void Otm<Dim>::Parts::make_functions(OtmChunk<Dim>& chunk, const std::vector<Index>& which,
                                                        bool first, Rows& rows, OtmCounts& counted) const {
  const BodyOf& body = bodies[chunk.body];
  const Neighbours<Dim>& tree = *trees[chunk.body];
  LmeFunctions<Dim> functions(options.lme);
  std::vector<Index> near, used;
  const double furthest = -std::log(options.lme.cutoff);
  for (std::size_t k = 0; k < which.size(); ++k) {
    const Index p = which[k];
    const Vec<Dim> at = chunk.at.col(p);
    Mat<Dim>& metric = chunk.metric[p];
    Vec<Dim>& lambda = chunk.lambda[p];
    if (first) {
      const double h = spacing[body.first_node + tree.nearest(at)];
      metric = options.lme.gamma / (h * h) * Mat<Dim>::Identity();
    } else {
      const Mat<Dim> since = chunk.since[p].template topLeftCorner<Dim, Dim>();
      const Mat<Dim> inverse = since.inverse();
      metric = rounded<Dim>(inverse.transpose() * metric * inverse, options.anisotropy);
      lambda = inverse.transpose() * lambda;
    }
    const double least = smallest_eigenvalue<Dim>(metric);
    LmeStatus status = LmeStatus::outside;
    for (double share = 1.0; status != LmeStatus::found; share *= 3.0) {
      if (share > 10.0 || (share > 4.0 && !first))
        throw NumericalError(fmt::format("a material point at ({:.6g}) is outside of the nodes around it, {} of them",
                                         fmt::join(at, ", "), functions.size()));
      tree.within(at, std::sqrt(furthest * share / least), near);
      functions.clear();
      used.clear();
      for (const Index a : near) {
        const Vec<Dim> d = x.col(body.first_node + a) - at;
        if (d.dot(metric * d) > furthest * share) continue;
        functions.add(d);
        used.push_back(body.first_node + a);
      }
      if (share > 2.0 && !first) {
        // The nodes it had: it is a mean of them.
        const std::size_t found = used.size();
        for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e) {
          const Index a = chunk.nodes[chunk.local[e]];
          if (std::binary_search(used.begin(), used.begin() + static_cast<std::ptrdiff_t>(found), a)) continue;
          functions.add(x.col(a) - at);
          used.push_back(a);
        }
        ++counted.widened;
      }
      status = functions.find(metric, lambda);
      counted.iterations += functions.iterations();
      if (status != LmeStatus::found) lambda.setZero();
    }
    auto& row = rows[k];
    row.clear();
    for (std::size_t k_used = 0; k_used < used.size(); ++k_used) {
      const auto a = static_cast<Index>(k_used);
      const double N = functions.N(a);
      row.push_back({used[k_used], entry_of<Dim>(N, functions.dN(a), axisymmetric() ? N / at[0] : 0.0)});
    }
    if (!first) {
      const Mat<Dim> since = chunk.since[p].template topLeftCorner<Dim, Dim>();
      if (smallest_eigenvalue<Dim>(functions.moment()) <
          0.8 * smallest_eigenvalue<Dim>(since * chunk.moment[p] * since.transpose()))
        chunk.narrowed.push_back(p);
    }
    chunk.moment[p] = functions.moment();
    chunk.penalty[p] = options.stabilisation * body.shear * chunk.volume[p] * functions.inverse_moment().trace() / Dim;
  }
}

/// Functions that are given, for good. What LME functions say of motions that points do not see, others do not.
template <int Dim>
void Otm<Dim>::Parts::take_functions(const OtmChunk<Dim>& chunk, const ShapeTable<Dim>& shape, Rows& rows) const {
  for (Index p = 0; p < chunk.size(); ++p) {
    const ShapeRow<Dim> row = shape.row(chunk.number[p]);
    for (std::size_t k = 0; k < row.nodes.size(); ++k)
      rows[p].push_back({bodies[chunk.body].first_node + row.nodes[k],
                         entry_of<Dim>(row.N[k], row.dN[k], axisymmetric() ? row.hoop[k] : 0.0)});
  }
}

/// Replaces the rows of some points.
template <int Dim>
void Otm<Dim>::Parts::put_rows(OtmChunk<Dim>& chunk, const std::vector<Index>& which, const Rows& rows) {
  // Local numbers are given as nodes come up.
  thread_local std::vector<Index> number;
  thread_local std::vector<Index> nodes, offsets;
  thread_local std::vector<std::uint16_t> local;
  thread_local std::vector<OtmEntry> entries;
  number.resize(std::max(number.size(), static_cast<std::size_t>(x.cols())), -1);
  nodes.clear();
  offsets.assign(1, 0);
  local.clear();
  entries.clear();
  const auto put = [&](Index node, const OtmEntry& entry) {
    if (number[node] < 0) {
      number[node] = static_cast<Index>(nodes.size());
      nodes.push_back(node);
    }
    local.push_back(static_cast<std::uint16_t>(number[node]));
    entries.push_back(entry);
  };
  std::size_t next = 0;
  for (Index p = 0; p < chunk.size(); ++p) {
    if (next < which.size() && which[next] == p)
      for (const auto& [node, entry] : rows[next++]) put(node, entry);
    else
      for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e)
        put(chunk.nodes[chunk.local[e]], chunk.entries[e]);
    offsets.push_back(static_cast<Index>(entries.size()));
  }
  for (const Index node : nodes) number[node] = -1;
  if (nodes.size() > 65535) throw NumericalError("material points that lie together see more than 65535 nodes");
  chunk.offsets = offsets;
  chunk.local = local;
  chunk.entries = entries;
  chunk.nodes = nodes;
  chunk.x.assign(4 * nodes.size(), 0.0);
  chunk.force.assign(4 * nodes.size(), 0.0);
}

template <int Dim> void Otm<Dim>::Parts::find_places() {
  node_offsets.assign(x.cols() + 1, 0);
  for (const auto& chunk : chunks)
    for (const Index a : chunk.nodes) ++node_offsets[a + 1];
  std::partial_sum(node_offsets.begin(), node_offsets.end(), node_offsets.begin());
  node_places.resize(node_offsets.back());
  std::vector<Index> next(node_offsets.begin(), node_offsets.end() - 1);
  for (std::size_t c = 0; c < chunks.size(); ++c)
    for (std::size_t l = 0; l < chunks[c].nodes.size(); ++l)
      node_places[next[chunks[c].nodes[l]]++] = {static_cast<Index>(c), static_cast<Index>(l)};
}

/// What values at the nodes come to at the points, in their columns: gradients, and the values there.
template <int Dim> void Otm<Dim>::Parts::deform(OtmChunk<Dim>& chunk, const Points<Dim>& of) const {
  for (std::size_t l = 0; l < chunk.nodes.size(); ++l)
    for (int i = 0; i < Dim; ++i) chunk.x[4 * l + i] = of(i, chunk.nodes[l]);
  otm_deform(chunk.size(), chunk.offsets.data(), chunk.local.data(), chunk.entries.data(), chunk.x.data(),
             chunk.columns.data());
}

/// Where a point is and how it is deformed, after `deform` by where the nodes are.
template <int Dim> void Otm<Dim>::Parts::place(OtmChunk<Dim>& chunk, Index p) const {
  const double* column = chunk.columns.data() + 16 * p;
  chunk.since[p] = gradient(column, 1.0);
  for (int i = 0; i < Dim; ++i) chunk.at(i, p) = column[12 + i];
}

/// Deformations, stresses and forces where the nodes are now.
template <int Dim> void Otm<Dim>::Parts::sweep(double dt) {
  parallel_chunks(static_cast<Index>(chunks.size()), 1, [&](Index c, Index) { sweep(c, dt); });
  force = collected();
  counts.updates += static_cast<std::int64_t>(place_of_point.size());
}

/// What the chunks say of each node, summed in their order.
template <int Dim> Points<Dim> Otm<Dim>::Parts::collected() const {
  Points<Dim> result(Dim, x.cols());
  parallel_for(static_cast<Index>(x.cols()), [&](Index a) {
    Vec<Dim> sum = Vec<Dim>::Zero();
    for (Index k = node_offsets[a]; k < node_offsets[a + 1]; ++k) {
      const auto [c, l] = node_places[k];
      for (int i = 0; i < Dim; ++i) sum[i] += chunks[c].force[4 * l + i];
    }
    result.col(a) = sum;
  });
  return result;
}

template <int Dim> void Otm<Dim>::Parts::sweep(Index number, double dt) {
  OtmChunk<Dim>& chunk = chunks[number];
  const BodyOf& body = bodies[chunk.body];
  const Index n = chunk.size();
  auto start = Clock::now();
  deform(chunk, x);
  Tensors& F = chunk.now.F;
  chunk.now.dt = dt;
  chunk.worn.clear();
  const bool shared = chunk.shares_dilatation();
  double worst = 0.0;
  for (Index p = 0; p < n; ++p) {
    place(chunk, p);
    const Mat<3>& since = chunk.since[p];
    const Mat<3> now = since * Eigen::Map<const Mat<3>>(chunk.made.col(p).data());
    Eigen::Map<Mat<3>>(F.col(p).data()) = now;
    const double J = now.determinant();
    if (!(J > 0.0))
      throw NumericalError(fmt::format(
          "at time {:.6g} the material point at ({:.6g}) is turned inside out (J = {:.3g}): try a smaller step", time,
          fmt::join(chunk.at.col(p), ", "), J));
    if (!body.finite && (now - Mat<3>::Identity()).norm() > small_strains)
      throw NumericalError(
          fmt::format("at time {:.6g} the material point at ({:.6g}) is strained or turned by {:.2g}, and its material "
                      "is for small "
                      "strains: take one for finite strains",
                      time, fmt::join(chunk.at.col(p), ", "), (now - Mat<3>::Identity()).norm()));
    chunk.growth[p] = J;
    // Green's strain: turning is no wear.
    const double wear = 0.5 * (since.transpose() * since - Mat<3>::Identity()).norm();
    worst = std::max(worst, wear);
    if (body.renewed && wear > 0.7 * options.renewal) chunk.worn.push_back(p);
  }
  // What wears soon is renewed with what is worn, as a chunk's tables are written anew at once.
  if (worst <= options.renewal) chunk.worn.clear();
  if (shared)
    for (std::size_t u = 0; u + 1 < chunk.unions.size(); ++u) {
      const Index begin = chunk.unions[u], size = chunk.unions[u + 1] - begin;
      const auto volume = chunk.volume.segment(begin, size);
      const double mean = volume.dot(chunk.growth.segment(begin, size)) / volume.sum();
      for (Index p = begin; p < begin + size; ++p) {
        chunk.growth[p] /= mean;
        F.col(p) /= std::cbrt(chunk.growth[p]);
      }
    }
  chunk.seconds.kinematics += lap(start);
  try {
    body.material->respond(chunk.now, chunk.response);
  } catch (const NumericalError& error) {
    throw NumericalError(fmt::format("at time {:.6g}: {}", time, error.what()));
  }
  stored[number] = chunk.response.energy.dot(chunk.volume);
  dissipated[number] += chunk.response.dissipated.dot(chunk.volume);
  chunk.now.history.swap(chunk.response.history);
  chunk.seconds.materials += lap(start);
  for (Index p = 0; p < n; ++p)
    Eigen::Map<Mat<3>>(chunk.columns.data() + 16 * p) =
        chunk.response.stress(p) * Eigen::Map<const Mat<3>>(F.col(p).data()).transpose();
  push(
      chunk, [&](Index p) { return Vec<Dim>(chunk.at.col(p)); },
      [&](Index p) { return Mat<Dim>(chunk.since[p].template topLeftCorner<Dim, Dim>()); });
  chunk.seconds.forces += lap(start);
}

/// Deformation by the columns of otm_deform; across the plane there is none but `across`, or that around the axis.
template <int Dim> Mat<3> Otm<Dim>::Parts::gradient(const double* column, double across) const {
  Mat<3> result = Mat<3>::Zero();
  result(2, 2) = across;
  for (int j = 0; j < Dim; ++j)
    for (int i = 0; i < Dim; ++i) result(i, j) = column[4 * j + i];
  if (axisymmetric()) result(2, 2) = column[8];
  return result;
}

/// Forces of Kirchhoff stresses, which are the first nine numbers of each point's columns, and of motions that points
/// do not see. Points of a union share the work of its dilatation (growth: each one's J over the union's).
template <int Dim> template <class At, class Since>
void Otm<Dim>::Parts::push(OtmChunk<Dim>& chunk, const At& at, const Since& since) const {
  const bool shared = chunk.shares_dilatation();
  for (std::size_t u = 0; u + 1 < chunk.unions.size(); ++u) {
    const Index begin = chunk.unions[u], end = chunk.unions[u + 1];
    double volume = 0.0, pressure = 0.0;
    for (Index p = begin; p < end; ++p) {
      const double* tau = chunk.columns.data() + 16 * p;
      volume += chunk.volume[p];
      pressure += chunk.volume[p] * (tau[0] + tau[4] + tau[8]) / 3.0;
    }
    for (Index p = begin; p < end; ++p) {
      double* column = chunk.columns.data() + 16 * p;
      Mat<3> tau = Eigen::Map<const Mat<3>>(column);
      if (shared) tau.diagonal().array() += pressure / volume * chunk.growth[p] - tau.trace() / 3.0;
      Mat<3> columns = -chunk.volume[p] * tau * chunk.since[p].inverse().transpose();
      columns.template topLeftCorner<Dim, Dim>() += chunk.penalty[p] * since(p) * chunk.moment[p];
      std::fill_n(column, 16, 0.0);
      for (int j = 0; j < Dim; ++j)
        for (int i = 0; i < Dim; ++i) column[4 * j + i] = columns(i, j);
      if (axisymmetric()) column[8] = columns(2, 2);
      const Vec<Dim> where = at(p);
      for (int i = 0; i < Dim; ++i) column[12 + i] = chunk.penalty[p] * where[i];
    }
  }
  std::fill(chunk.force.begin(), chunk.force.end(), 0.0);
  otm_push(chunk.size(), chunk.offsets.data(), chunk.local.data(), chunk.entries.data(), chunk.x.data(),
           chunk.columns.data(), chunk.penalty.data(), chunk.force.data());
}

/// How many times stiffer than at rest points are now, at the most, by their tangents: the largest eigenvalue of one
/// by the other, by power iteration; at least one.
template <int Dim> void Otm<Dim>::Parts::stiffen() {
  auto begin = Clock::now();
  parallel_chunks(static_cast<Index>(chunks.size()), 1, [&](Index c, Index) {
    OtmChunk<Dim>& chunk = chunks[c];
    const BodyOf& body = bodies[chunk.body];
    if (body.material->linear()) return;
    const MaterialResponse response = respond(*body.material, chunk.now, true);
    for (Index p = 0; p < chunk.size(); ++p) {
      const Mat<3> F = chunk.now.gradient(p);
      Vec<9> h;
      h << 1.0, 0.3, -0.2, 0.25, 0.9, 0.15, -0.1, 0.2, 1.1;
      double most = 1.0;
      for (int k = 0; k < 6; ++k) {
        // A change of F by H F does the work of P : H F.
        Mat<3> change = Eigen::Map<const Mat<3>>(h.data()) * F;
        const Vec<9> stress = response.tangent_at(p) * Eigen::Map<const Vec<9>>(change.data());
        const Mat<3> pushed = Eigen::Map<const Mat<3>>(stress.data()) * F.transpose();
        const Vec<9> next = body.compliance * Eigen::Map<const Vec<9>>(pushed.data());
        most = next.norm() / h.norm();
        h = next / next.norm();
      }
      chunk.stiffening[p] = std::isfinite(most) ? std::max(1.0, most) : 1.0;
    }
  });
  times.stability += lap(begin);
}

/// Power iteration for the highest frequency of the bodies as they are now, were they elastic: the stable step is 2
/// over it.
template <int Dim> void Otm<Dim>::Parts::shake(Index repeats) {
  auto begin = Clock::now();
  double omega2 = 0.0;
  for (Index k = 0; k < repeats; ++k) {
    parallel_chunks(static_cast<Index>(chunks.size()), 1, [&](Index c, Index) {
      OtmChunk<Dim>& chunk = chunks[c];
      const BodyOf& body = bodies[chunk.body];
      deform(chunk, shaken);
      const bool shared = chunk.shares_dilatation();
      thread_local std::vector<Mat<3>> since;
      thread_local std::vector<Vec<Dim>> at;
      since.resize(chunk.size());
      at.resize(chunk.size());
      for (std::size_t u = 0; u + 1 < chunk.unions.size(); ++u) {
        double volume = 0.0, dilatation = 0.0;
        for (Index p = chunk.unions[u]; p < chunk.unions[u + 1]; ++p) {
          double* column = chunk.columns.data() + 16 * p;
          since[p] = gradient(column, 0.0);
          for (int i = 0; i < Dim; ++i) at[p][i] = column[12 + i];
          const Mat<3> now = since[p] * chunk.since[p].inverse();
          std::copy_n(now.data(), 9, column);
          volume += chunk.volume[p];
          dilatation += chunk.volume[p] * chunk.growth[p] * now.trace();
        }
        for (Index p = chunk.unions[u]; p < chunk.unions[u + 1]; ++p) {
          double* column = chunk.columns.data() + 16 * p;
          Vec<9> H = Eigen::Map<const Vec<9>>(column);
          if (shared) {
            const double shift = (dilatation / volume - H[0] - H[4] - H[8]) / 3.0;
            for (const int d : {0, 4, 8}) H[d] += shift;
          }
          const Vec<9> stress = chunk.stiffening[p] * (body.tangent * H);
          std::copy_n(stress.data(), 9, column);
        }
      }
      push(
          chunk, [&](Index p) { return at[p]; },
          [&](Index p) { return Mat<Dim>(since[p].template topLeftCorner<Dim, Dim>()); });
    });
    Points<Dim> next = -collected();
    for (const auto& [node, axis, velocity] : prescribed) next(axis, node) = 0.0;
    double norm2 = 0.0, before2 = 0.0;
    for (Index a = 0; a < mass.size(); ++a) {
      before2 += mass[a] * shaken.col(a).squaredNorm();
      if (mass[a] > 0.0) next.col(a) /= mass[a];
      norm2 += mass[a] * next.col(a).squaredNorm();
    }
    omega2 = std::sqrt(norm2 / before2);
    shaken = next / std::sqrt(norm2);
  }
  // Steps change no more than they have to: energy swings with their length.
  const double found = options.courant * 2.0 / std::sqrt(omega2);
  if (found < stable || found > 1.25 * stable) stable = 0.98 * found;
  times.stability += lap(begin);
}

/// Functions of worn points are made anew where nodes and points are now; what their nodes carry of them follows.
template <int Dim> void Otm<Dim>::Parts::renew() {
  std::vector<Index> worn_chunks;
  std::vector<char> body_is_worn(bodies.size(), 0);
  for (std::size_t c = 0; c < chunks.size(); ++c)
    if (!chunks[c].worn.empty()) {
      worn_chunks.push_back(static_cast<Index>(c));
      body_is_worn[chunks[c].body] = 1;
    }
  if (worn_chunks.empty()) return;
  auto start = Clock::now();
  for (std::size_t b = 0; b + 1 < bodies.size(); ++b)
    if (body_is_worn[b])
      trees[b]->build(x.middleCols(bodies[b].first_node, bodies[b + 1].first_node - bodies[b].first_node));
  struct Change {
    Rows rows;
    OtmCounts counted;
    double unseen = 0.0;
  };
  std::vector<Change> changes(worn_chunks.size());
  parallel_chunks(static_cast<Index>(worn_chunks.size()), 1, [&](Index k, Index) {
    OtmChunk<Dim>& chunk = chunks[worn_chunks[k]];
    // Where points are now, and how they are deformed, by the functions they had.
    deform(chunk, x);
    for (const Index p : chunk.worn) {
      place(chunk, p);
      changes[k].unseen += unseen(chunk, p);
    }
    changes[k].rows.resize(chunk.worn.size());
    make_functions(chunk, chunk.worn, false, changes[k].rows, changes[k].counted);
    for (const Index p : chunk.worn) {
      const Mat<3> made = chunk.since[p] * Eigen::Map<const Mat<3>>(chunk.made.col(p).data());
      Eigen::Map<Mat<3>>(chunk.made.col(p).data()) = made;
    }
  });
  // Masses and momenta of the nodes, in the order of the points.
  const auto energy = [&] {
    double sum = 0.0;
    for (Index a = 0; a < mass.size(); ++a) sum += 0.5 * mass[a] * v.col(a).squaredNorm();
    return sum;
  };
  const double before = energy();
  Points<Dim> momentum = Points<Dim>::Zero(Dim, x.cols());
  Vector change = Vector::Zero(mass.size());
  for (std::size_t k = 0; k < worn_chunks.size(); ++k) {
    const OtmChunk<Dim>& chunk = chunks[worn_chunks[k]];
    counts.renewals += static_cast<std::int64_t>(chunk.worn.size());
    counts.iterations += changes[k].counted.iterations;
    counts.widened += changes[k].counted.widened;
    renewal_loss += changes[k].unseen;
    for (std::size_t w = 0; w < chunk.worn.size(); ++w) {
      const Index p = chunk.worn[w];
      const Vec<Dim> at = chunk.at.col(p);
      const double m = chunk.mass[p];
      Vec<Dim> mean = Vec<Dim>::Zero();
      Mat<Dim> affine = Mat<Dim>::Zero();
      for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e) {
        const Index a = chunk.nodes[chunk.local[e]];
        const double N = chunk.entries[e].N;
        mean += N * v.col(a);
        affine += N * v.col(a) * (x.col(a) - at).transpose();
        change[a] -= m * N;
        momentum.col(a) -= m * N * v.col(a);
      }
      Vec<Dim> shift = Vec<Dim>::Zero();
      Mat<Dim> turn = Mat<Dim>::Zero();
      if (options.momentum == OtmMomentum::affine) {
        shift = mean;
        turn = affine;
        for (const auto& [a, entry] : changes[k].rows[w]) {
          shift -= entry.N * v.col(a);
          turn -= entry.N * v.col(a) * (x.col(a) - at).transpose();
        }
        turn *= chunk.moment[p].inverse();
      }
      for (const auto& [a, entry] : changes[k].rows[w]) {
        change[a] += m * entry.N;
        if (options.momentum == OtmMomentum::points)
          momentum.col(a) += m * entry.N * mean;
        else
          momentum.col(a) += m * entry.N * (v.col(a) + shift + turn * (x.col(a) - at));
      }
    }
  }
  for (Index a = 0; a < mass.size(); ++a) {
    if (change[a] == 0.0 && momentum.col(a).isZero(0.0)) continue;
    const Vec<Dim> l = mass[a] * v.col(a) + momentum.col(a);
    mass[a] += change[a];
    if (options.momentum != OtmMomentum::nodes && mass[a] > 0.0) v.col(a) = l / mass[a];
  }
  for (const auto& [node, axis, velocity] : prescribed) v(axis, node) = velocity;
  renewal_loss += before - energy();
  parallel_chunks(static_cast<Index>(worn_chunks.size()), 1, [&](Index k, Index) {
    OtmChunk<Dim>& chunk = chunks[worn_chunks[k]];
    put_rows(chunk, chunk.worn, changes[k].rows);
    for (const Index p : chunk.worn) chunk.since[p].setIdentity();
  });
  find_places();
  times.functions += lap(start);
  // Narrower functions may be stiffer than any before: the iteration is told where to look.
  const double size = 0.1 / std::sqrt(mass.sum());
  bool narrowed = false;
  for (const Index c : worn_chunks) {
    OtmChunk<Dim>& chunk = chunks[c];
    for (const Index p : chunk.narrowed)
      for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e) {
        const Index a = chunk.nodes[chunk.local[e]];
        for (int i = 0; i < Dim; ++i) shaken(i, a) += (e + a + i) % 2 == 0 ? size : -size;
      }
    narrowed = narrowed || !chunk.narrowed.empty();
    chunk.narrowed.clear();
    chunk.worn.clear();
  }
  if (narrowed) shake(3);
}

/// Energy of the motions of its nodes that a point does not see.
template <int Dim> double Otm<Dim>::Parts::unseen(const OtmChunk<Dim>& chunk, Index p) const {
  double spread = 0.0;
  for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e)
    spread += chunk.entries[e].N * (x.col(chunk.nodes[chunk.local[e]]) - chunk.at.col(p)).squaredNorm();
  const Mat<Dim> since = chunk.since[p].template topLeftCorner<Dim, Dim>();
  return 0.5 * chunk.penalty[p] * (spread - (since * chunk.moment[p] * since.transpose()).trace());
}

/// Nodes get their impulses, and move.
template <int Dim> void Otm<Dim>::Parts::move(double kick, double dt) {
  auto start = Clock::now();
  was = v;
  for (Index a = 0; a < mass.size(); ++a)
    if (mass[a] > 0.0) v.col(a) += kick / mass[a] * force.col(a);
  // What a force that changes v at the end does is its impulse times the mean of the velocities around it.
  for (const auto& [node, axis, velocity] : prescribed) {
    prescribed_work += 0.5 * mass[node] * (velocity - v(axis, node)) * (velocity + was(axis, node));
    v(axis, node) = velocity;
  }
  wall_forces.setZero(Dim, static_cast<Index>(walls.size()));
  for (std::size_t w = 0; w < walls.size(); ++w) {
    const OtmWall<Dim>& wall = walls[w];
    for (Index a = 0; a < mass.size(); ++a) {
      const double gap = x.col(a).dot(wall.normal) - wall.level;
      const double speed = v.col(a).dot(wall.normal);
      if (gap + dt * speed >= 0.0) continue;
      const Vec<Dim> before = v.col(a);
      const double stop = -gap / dt - speed;  // what brings it to the wall
      Vec<Dim> sliding = before - speed * wall.normal;
      const double slides = sliding.norm();
      const double hold = slides > 0.0 ? std::min(1.0, wall.friction * stop / slides) : 0.0;
      v.col(a) += stop * wall.normal - (std::isinf(wall.friction) ? 1.0 : hold) * sliding;
      contact_loss -= 0.5 * mass[a] * (v.col(a) - before).dot(v.col(a) + was.col(a));
      wall_forces.col(static_cast<Index>(w)) -= mass[a] / kick * (v.col(a) - before);
    }
  }
  x += dt * v;
  if (axisymmetric())
    for (Index a = 0; a < x.cols(); ++a)
      if (x(0, a) < 0.0) x(0, a) = 0.0;
  times.nodes += lap(start);
}

template <int Dim> Otm<Dim>::Otm(std::vector<OtmBody<Dim>> bodies, const OtmOptions& options)
    : parts_(std::make_unique<Parts>(std::move(bodies), options)) {}
template <int Dim> Otm<Dim>::Otm(Otm&&) noexcept = default;
template <int Dim> Otm<Dim>& Otm<Dim>::operator=(Otm&&) noexcept = default;
template <int Dim> Otm<Dim>::~Otm() = default;

template <int Dim> Index Otm<Dim>::num_nodes() const {
  return static_cast<Index>(parts_->x.cols());
}
template <int Dim> Index Otm<Dim>::num_points() const {
  return static_cast<Index>(parts_->place_of_point.size());
}
template <int Dim> Index Otm<Dim>::num_bodies() const {
  return static_cast<Index>(parts_->bodies.size()) - 1;
}
template <int Dim> const Material& Otm<Dim>::material(Index body) const {
  return *parts_->bodies.at(body).material;
}
template <int Dim> Index Otm<Dim>::first_node(Index body) const {
  return parts_->bodies.at(body).first_node;
}
template <int Dim> Index Otm<Dim>::first_point(Index body) const {
  return parts_->bodies.at(body).first_point;
}

template <int Dim> void Otm<Dim>::add_wall(const OtmWall<Dim>& wall) {
  if (std::abs(wall.normal.norm() - 1.0) > 1e-9) throw InputError("a wall's normal: expected a unit vector");
  if (!(wall.friction >= 0.0)) throw InputError(fmt::format("a wall's friction {}, expected 0 or more", wall.friction));
  parts_->walls.push_back(wall);
  parts_->wall_forces.setZero(Dim, static_cast<Index>(parts_->walls.size()));
}

template <int Dim> void Otm<Dim>::prescribe(Index node, int axis, double velocity) {
  if (node < 0 || node >= num_nodes() || axis < 0 || axis >= Dim)
    throw InputError(fmt::format("axis {} of node {}: there are {} nodes", axis, node, num_nodes()));
  parts_->prescribed.push_back({node, axis, velocity});
  parts_->v(axis, node) = velocity;
}

template <int Dim> double Otm<Dim>::step(double at_most) {
  Parts& of = *parts_;
  const double dt = std::min(of.stable, at_most);
  if (!(dt > 0.0) || !std::isfinite(dt))
    throw NumericalError(fmt::format("at time {:.6g} the stable step is {:.3g}", of.time, dt));
  of.move(0.5 * (of.last_step + dt), dt);
  of.time += dt;
  of.last_step = dt;
  of.renew();
  of.sweep(dt);
  if (++of.counts.steps % 64 == 0) of.stiffen();
  if (of.counts.steps % 4 == 0) of.shake(1);
  return dt;
}

template <int Dim> void Otm<Dim>::run(double until) {
  while (time() < until) {
    const double left = until - time();
    // The last two share what is left, so that no step is tiny.
    step(left > parts_->stable && left < 2.0 * parts_->stable ? 0.5 * left : left);
    if (until - time() < 1e-12 * until) break;
  }
}

template <int Dim> double Otm<Dim>::time() const {
  return parts_->time;
}
template <int Dim> double Otm<Dim>::stable_step() const {
  return parts_->stable;
}
template <int Dim> const Points<Dim>& Otm<Dim>::nodes() const {
  return parts_->x;
}
template <int Dim> Points<Dim> Otm<Dim>::velocities() const {
  return parts_->v;
}
template <int Dim> const Vector& Otm<Dim>::masses() const {
  return parts_->mass;
}
template <int Dim> Points<Dim> Otm<Dim>::points() const {
  Points<Dim> result(Dim, num_points());
  for (Index p = 0; p < num_points(); ++p) {
    const auto [c, k] = parts_->place_of_point[p];
    result.col(p) = parts_->chunks[c].at.col(k);
  }
  return result;
}
template <int Dim> Tensors Otm<Dim>::deformation() const {
  Tensors result(9, num_points());
  for (Index p = 0; p < num_points(); ++p) {
    const auto [c, k] = parts_->place_of_point[p];
    const auto& chunk = parts_->chunks[c];
    Eigen::Map<Mat<3>>(result.col(p).data()) = chunk.since[k] * Eigen::Map<const Mat<3>>(chunk.made.col(k).data());
  }
  return result;
}
template <int Dim> Tensors Otm<Dim>::cauchy_stress() const {
  Tensors result(9, num_points());
  for (Index p = 0; p < num_points(); ++p) {
    const auto [c, k] = parts_->place_of_point[p];
    auto& chunk = parts_->chunks[c];
    const Eigen::Map<const Mat<3>> F(chunk.now.F.col(k).data()), P(chunk.response.P.col(k).data());
    Eigen::Map<Mat<3>>(result.col(p).data()) = P * F.transpose() / F.determinant();
  }
  return result;
}
template <int Dim> Matrix Otm<Dim>::history(Index body) const {
  const Index begin = first_point(body), end = first_point(body + 1);
  Matrix result(parts_->bodies[body].material->history_size(), end - begin);
  for (Index p = begin; p < end; ++p) {
    const auto [c, k] = parts_->place_of_point[p];
    result.col(p - begin) = parts_->chunks[c].now.history.col(k);
  }
  return result;
}

template <int Dim> OtmBalance<Dim> Otm<Dim>::balance() const {
  const Parts& of = *parts_;
  OtmBalance<Dim> result;
  result.moment.setZero();
  result.stored = of.stored.sum();
  result.dissipated = of.dissipated.sum();
  result.contact = of.contact_loss;
  result.renewal = of.renewal_loss;
  result.prescribed = of.prescribed_work;
  for (Index a = 0; a < num_nodes(); ++a) {
    const double m = of.mass[a];
    if (!(m > 0.0)) continue;
    // Half a step ago, and half a step from now.
    const Vec<Dim> v = of.v.col(a), next = v + of.last_step / m * of.force.col(a);
    result.kinetic += 0.5 * m * v.dot(next);
    result.momentum += m * v;
    if constexpr (Dim == 2)
      result.moment[0] += m * (of.x(0, a) * v[1] - of.x(1, a) * v[0]);
    else
      result.moment += m * Vec<3>(of.x.col(a)).cross(v);
  }
  for (const auto& chunk : of.chunks)
    for (Index p = 0; p < chunk.size(); ++p) result.stabilising += of.unseen(chunk, p);
  return result;
}

template <int Dim> const OtmCounts& Otm<Dim>::counts() const {
  return parts_->counts;
}
template <int Dim> OtmTimes Otm<Dim>::times() const {
  OtmTimes result = parts_->times;
  for (const auto& chunk : parts_->chunks) {
    result.kinematics += chunk.seconds.kinematics;
    result.materials += chunk.seconds.materials;
    result.forces += chunk.seconds.forces;
  }
  return result;
}
template <int Dim> const Points<Dim>& Otm<Dim>::wall_forces() const {
  return parts_->wall_forces;
}

template class Otm<2>;
template class Otm<3>;

}  // namespace efree
