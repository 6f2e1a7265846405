// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/state.hpp"

#include "efree/core/error.hpp"
#include "efree/dynamics/interaction.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <cmath>
#include <numeric>

namespace efree {
namespace {

// What there is of every point, for points that go on as those.

template <int R> void gather(Eigen::Matrix<double, R, Eigen::Dynamic>& columns, const std::vector<Index>& from) {
  if (columns.cols() != 0) columns = columns(Eigen::all, from).eval();
}
void gather(Vector& values, const std::vector<Index>& from) {
  if (values.size() != 0) values = values(from).eval();
}
template <class T, class A> void gather(std::vector<T, A>& values, const std::vector<Index>& from) {
  if (values.empty()) return;
  std::vector<T, A> result;
  result.reserve(from.size());
  for (const Index p : from) result.push_back(values[p]);
  values = std::move(result);
}

template <int Dim> void gather(PointTable<Dim>& table, const std::vector<Index>& from) {
  std::vector<Index> offsets{0}, rows;  // entries in their new order
  for (const Index p : from) {
    for (Index e = table.offsets[p]; e < table.offsets[p + 1]; ++e) rows.push_back(e);
    offsets.push_back(static_cast<Index>(rows.size()));
  }
  table.offsets = std::move(offsets);
  gather(table.local, rows);
  gather(table.entries, rows);
}

template <int Dim> void gather(Matter<Dim>& matter, const std::vector<Index>& from) {
  auto& [now, P, energy, F_table, F_since, x, volume, mass, added_mass, eroded, J_ratio, J, shock, modulus,
         stiffness_ratio, damage, crack_radius] = matter;
  const auto gather_all = [&](auto&... values) { (gather(values, from), ...); };
  gather_all(now.X, now.F, now.history, now.heat, P, energy, F_table, F_since, x, volume, mass, added_mass, eroded);
  gather_all(J_ratio, J, shock, modulus, stiffness_ratio, damage, crack_radius);
}

/// Inserts values before that one; no values stay none.
void insert(Vector& values, Index before, const Vector& more) {
  if (values.size() == 0) return;
  Vector result(values.size() + more.size());
  result << values.head(before), more, values.tail(values.size() - before);
  values = std::move(result);
}

}  // namespace

template <int Dim> std::vector<Index> Chunk<Dim>::take(const std::vector<Index>& from) {
  std::vector<Index> first(size() + 1);
  for (const Index p : from) ++first[p + 1];
  for (Index p = 0; p < size(); ++p) first[p + 1] += first[p];
  gather(table, from);
  gather(number, from);
  gather(support.metric, from);
  gather(support.moment, from);
  gather(support.stabilisation, from);
  gather(matter, from);
  for (Index& begin : patches) begin = first[begin];
  patches.erase(std::unique(patches.begin(), patches.end()), patches.end());
  inverted = renumbered(inverted, first);
  return first;
}

template <int Dim> double* Chunk<Dim>::columns() const {
  thread_local AlignedVector<double> room;
  room.resize(std::max(room.size(), 16 * static_cast<std::size_t>(size())));
  return room.data();
}

template <int Dim> Mat<3>* Chunk<Dim>::recent_gradients() {
  if (!matter.F_since.empty()) return matter.F_since.data();
  thread_local std::vector<Mat<3>> room;
  room.resize(std::max(room.size(), static_cast<std::size_t>(size())));
  return room.data();
}

template <int Dim> World<Dim>::World() = default;
template <int Dim> World<Dim>::~World() = default;

template <int Dim> void World<Dim>::put_rows(Chunk<Dim>& chunk, const std::vector<Index>& points,
                                             const std::vector<TableRow>& rows) const {
  // Local numbers are given as nodes come up.
  thread_local std::vector<Index> number, seen, offsets;
  thread_local std::vector<std::uint16_t> local;
  thread_local AlignedVector<TableEntry> entries;
  number.resize(std::max(number.size(), static_cast<std::size_t>(nodes.size())), -1);
  seen.clear();
  offsets.assign(1, 0);
  local.clear();
  entries.clear();
  const auto put = [&](Index node, const TableEntry& entry) {
    if (number[node] < 0) {
      number[node] = static_cast<Index>(seen.size());
      seen.push_back(node);
    }
    local.push_back(static_cast<std::uint16_t>(number[node]));
    entries.push_back(entry);
  };
  PointTable<Dim>& table = chunk.table;
  std::size_t next = 0;
  for (Index p = 0; p < chunk.size(); ++p) {
    if (next < points.size() && points[next] == p)
      for (const auto& [node, entry] : rows[next++]) put(node, entry);
    else
      for (const auto& [node, entry] : table.row(p)) put(node, entry);
    offsets.push_back(static_cast<Index>(entries.size()));
  }
  for (const Index node : seen) number[node] = -1;
  if (seen.size() > 65535) throw NumericalError("material points of one chunk have more than 65535 nodes");
  table.offsets = offsets;
  table.local = local;
  table.entries = entries;
  table.nodes = seen;
  table.x.assign(4 * seen.size(), 0.0);
  table.force.assign(4 * seen.size(), 0.0);
}

template <int Dim> void World<Dim>::put_rows(Chunk<Dim>& chunk, const std::vector<TableRow>& rows) const {
  std::vector<Index> all(chunk.size());
  std::iota(all.begin(), all.end(), 0);
  put_rows(chunk, all, rows);
}

template <int Dim> void World<Dim>::find_node_chunks() {
  auto& [offsets, places, forces] = node_chunks;
  if (std::ranges::all_of(chunks, [](const auto& chunk) { return chunk.table.nodes.empty(); })) {
    node_chunks = {};
    return;
  }
  offsets.assign(nodes.size() + 1, 0);
  for (const auto& chunk : chunks)
    for (const Index a : chunk.table.nodes) ++offsets[a + 1];
  std::partial_sum(offsets.begin(), offsets.end(), offsets.begin());
  places.resize(offsets.back());
  forces.resize(places.size());
  std::vector<Index> next(offsets.begin(), offsets.end() - 1);
  for (std::size_t c = 0; c < chunks.size(); ++c)
    for (std::size_t l = 0; l < chunks[c].table.nodes.size(); ++l)
      places[next[chunks[c].table.nodes[l]]++] = {static_cast<Index>(c), static_cast<Index>(l)};
  parallel_for(static_cast<Index>(places.size()), [&](Index k) {
    const auto [chunk, local] = places[k];
    forces[k] = chunks[chunk].table.force.data() + 4 * local;
  });
}

template <int Dim> void World<Dim>::find_points() {
  for (Index b = 0; b < num_bodies(); ++b) {
    Index count = 0;
    for (const auto& chunk : chunks) count += chunk.body == b ? chunk.size() : 0;
    const Index change = count - (first_point[b + 1] - first_point[b]);
    for (Index later = b + 1; later <= num_bodies(); ++later) first_point[later] += change;
  }
  ++point_changes;
  place_of_point.resize(first_point.back());
  for (std::size_t c = 0; c < chunks.size(); ++c)
    for (Index p = 0; p < chunks[c].size(); ++p)
      place_of_point[first_point[chunks[c].body] + chunks[c].number[p]] = {static_cast<Index>(c), p};
}

template <int Dim> void World<Dim>::split_chunk(std::size_t chunk, const std::vector<Index>& points) {
  Chunk<Dim> part = chunks[chunk];
  std::vector<Index> rest;
  for (Index p = 0; p < part.size(); ++p)
    if (!std::ranges::binary_search(points, p)) rest.push_back(p);
  chunks[chunk].take(rest);
  part.take(points);
  // What it has counted so far is of the points before.
  part.dissipated = part.viscous = part.lost = 0.0;
  part.seconds = {};
  chunks.push_back(std::move(part));
}

template <int Dim> void World<Dim>::find_free_axes() {
  nodes.free.setOnes(Dim, nodes.size());
  for (const auto& one : prescribed) nodes.free(one.axis, one.node) = 0.0;
  if (consistent_mass.any()) consistent_mass.free_sum = (consistent_mass.coupling * nodes.free.transpose()).transpose();
}

template <int Dim>
void World<Dim>::replace_nodes(const Points<Dim>& x, const std::vector<Index>& bounds, double spacing) {
  const auto N = static_cast<Index>(x.cols());
  nodes.x = x;
  for (Points<Dim>* values : {&nodes.v, &nodes.force, &nodes.x_rest, &nodes.v_before}) values->setZero(Dim, N);
  nodes.mass.setZero(N);
  nodes.spacing.setConstant(N, spacing);
  nodes.body.resize(N);
  for (Index b = 0; b < num_bodies(); ++b)
    std::fill(nodes.body.begin() + bounds[b], nodes.body.begin() + bounds[b + 1], b);
  nodes.master.assign(N, -1);
  first_node = bounds;
  find_prescribed_places();
}

template <int Dim> void World<Dim>::follow_motion_laws(double at, double dt) {
  const auto velocity = [&](Index law, const Vec<Dim>& start) {
    const double value = motion_laws[law].velocity(start, at, dt);
    if (!std::isfinite(value))
      throw InputError(
          fmt::format("the prescribed velocity at ({:.6g}) is not finite at time {:.6g}", fmt::join(start, ", "), at));
    return value;
  };
  for (auto& one : prescribed)
    if (one.law >= 0) one.velocity = velocity(one.law, one.start);
  for (auto& group : prescribed_points)
    for (Index k = 0; group.law >= 0 && k < group.velocity.size(); ++k)
      group.velocity[k] = velocity(group.law, group.start.col(k));
}

template <int Dim> Vec<Dim> World<Dim>::field_at(const Vec<Dim>& x, double at) const {
  if (!gravity_field) return Vec<Dim>::Zero();
  const Vec<Dim> value = gravity_field(x, at);
  if (!value.allFinite())
    throw InputError(fmt::format("gravity at ({:.6g}) is not finite at time {:.6g}", fmt::join(x, ", "), at));
  return value;
}

template <int Dim> void World<Dim>::find_prescribed_places() {
  prescribed.clear();
  for (const auto& [where, axis, velocity] : prescribed_places)
    for (Index a = 0; a < nodes.size(); ++a)
      if (where(nodes.x.col(a))) prescribed.push_back({a, axis, velocity});
  find_free_axes();
}

template <int Dim>
void World<Dim>::insert_nodes(Index body, const Points<Dim>& at, const Points<Dim>& velocity, const Vector& spacing) {
  const Index first = first_node[body + 1], count = static_cast<Index>(at.cols());
  insert_columns<Dim>(nodes.x, first, at);
  insert_columns<Dim>(nodes.v, first, velocity);
  const Points<Dim> nothing = Points<Dim>::Zero(Dim, count);
  for (Points<Dim>* values : {&nodes.force, &nodes.x_rest}) insert_columns<Dim>(*values, first, nothing);
  insert(nodes.spacing, first, spacing);
  insert(nodes.radius, first, Vector(Vector::Zero(count)));
  insert(nodes.mass, first, Vector(Vector::Zero(count)));
  insert(nodes.added_mass, first, Vector(Vector::Zero(count)));
  for (Index& master : nodes.master) shift_node(master, first, count);
  nodes.master.insert(nodes.master.begin() + first, count, -1);
  nodes.body.insert(nodes.body.begin() + first, count, body);
  for (auto& chunk : chunks)
    for (Index& node : chunk.table.nodes) shift_node(node, first, count);
  for (auto& one : prescribed) shift_node(one.node, first, count);
  for (Index b = body + 1; b <= num_bodies(); ++b) first_node[b] += count;
  for (const auto& interaction : interactions) interaction->nodes_inserted(*this, first, count);
  ++surface_changes;
}

double seconds_since(std::chrono::steady_clock::time_point& start) {
  const auto now = std::chrono::steady_clock::now();
  return std::chrono::duration<double>(now - std::exchange(start, now)).count();
}

template struct Chunk<2>;
template struct Chunk<3>;
template struct World<2>;
template struct World<3>;

}  // namespace efree
