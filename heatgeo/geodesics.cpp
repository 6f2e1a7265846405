// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/heatgeo/geodesics.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/infinity.hpp"
#include "efree/core/internal/setting_error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/heatgeo/internal/fast_marching.hpp"
#include "efree/heatgeo/internal/heat.hpp"
#include "efree/heatgeo/internal/marching_3d.hpp"
#include "efree/heatgeo/internal/patch.hpp"
#include "efree/heatgeo/internal/visible_distance.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>
#include <numeric>
#include <optional>
#include <type_traits>

namespace efree {
namespace {

using internal::infinity;
constexpr Index sources_per_chunk = 8;
constexpr double cluster_width_in_radii = 1.5;
constexpr int flow_steps = 6;
constexpr double flow_time = 0.1;  // in squared radii

/// Lends scratch objects to concurrent callers, so that a call costs no allocation of the size of the mesh.
template <class T> class Pool {
 public:
  template <class Make, class Use> void use(const Make& make, const Use& body) {
    std::unique_ptr<T> item = take();
    if (!item) item = make();
    body(*item);
    const std::lock_guard lock(mutex_);
    idle_.push_back(std::move(item));
  }

 private:
  std::unique_ptr<T> take() {
    const std::lock_guard lock(mutex_);
    if (idle_.empty()) return nullptr;
    auto item = std::move(idle_.back());
    idle_.pop_back();
    return item;
  }

  std::mutex mutex_;
  std::vector<std::unique_ptr<T>> idle_;
};

template <int Dim>
void check_sources(const FineMesh<Dim>& mesh, const std::vector<Index>& sources, const Vector& radii) {
  if (static_cast<std::size_t>(radii.size()) != sources.size())
    throw InputError(fmt::format("geodesics: {} sources but {} radii", sources.size(), radii.size()));
  for (std::size_t i = 0; i < sources.size(); ++i) {
    if (sources[i] < 0 || sources[i] >= mesh.num_vertices())
      throw InputError(
          fmt::format("geodesics: source {} is vertex {}, expected 0 to {}", i, sources[i], mesh.num_vertices() - 1));
    if (!(radii[i] > 0.0))
      throw InputError(fmt::format("geodesics: the radius of source {} is {}, expected > 0", i, radii[i]));
  }
}

void sort_by_vertex(LocalField& field) {
  std::vector<std::pair<Index, double>> pairs(field.vertices.size());
  for (std::size_t k = 0; k < pairs.size(); ++k) pairs[k] = {field.vertices[k], field.values[k]};
  std::sort(pairs.begin(), pairs.end());
  for (std::size_t k = 0; k < pairs.size(); ++k) std::tie(field.vertices[k], field.values[k]) = pairs[k];
}

/// Matrix whose column i is field i, as compressed rows.
SparseRows transposed(Index rows, const std::vector<LocalField>& fields) {
  SparseRows table(rows, static_cast<Index>(fields.size()));
  Index* offsets = table.outerIndexPtr();
  std::fill_n(offsets, rows + 1, 0);
  for (const LocalField& field : fields)
    for (Index v : field.vertices) ++offsets[v + 1];
  std::partial_sum(offsets, offsets + rows + 1, offsets);
  table.resizeNonZeros(offsets[rows]);
  std::vector<Index> cursor(offsets, offsets + rows);
  for (std::size_t i = 0; i < fields.size(); ++i)
    for (std::size_t k = 0; k < fields[i].vertices.size(); ++k) {
      const Index at = cursor[fields[i].vertices[k]]++;
      table.innerIndexPtr()[at] = static_cast<Index>(i);
      table.valuePtr()[at] = fields[i].values[k];
    }
  return table;
}

/// Groups of neighbours among the `chosen` sources: those in the same square of a grid as wide as the largest radius.
template <int Dim> Ragged<Index> clusters(const FineMesh<Dim>& mesh, const std::vector<Index>& sources,
                                          const Vector& radii, const std::vector<Index>& chosen) {
  if (chosen.empty()) return {};
  const double width = cluster_width_in_radii * radii.maxCoeff();
  using Square = std::array<double, Dim>;
  const auto square = [&](Index i) {
    Square at;
    for (int d = 0; d < Dim; ++d) at[d] = std::floor(mesh.vertex(sources[i])[d] / width);
    return at;
  };
  std::vector<std::pair<Square, Index>> sorted;
  for (Index i : chosen) sorted.push_back({square(i), i});
  std::sort(sorted.begin(), sorted.end());
  Ragged<Index> groups;
  for (std::size_t k = 0; k < sorted.size(); ++k) {
    if (k > 0 && sorted[k].first != sorted[k - 1].first) groups.close_row();
    groups.items.push_back(sorted[k].second);
  }
  if (!sorted.empty()) groups.close_row();
  return groups;
}

/// The engine that `automatic` stands for.
template <int Dim> Weight resolved(Weight weight) {
  if (weight == Weight::automatic) return Dim == 2 ? Weight::visibility : Weight::fast_marching;
  if (Dim == 3 && weight == Weight::visibility)
    throw internal::SettingError(
        "cloud.weight",
        "weights by exact visibility exist in 2D only; in 3D take fast_marching, heat_geodesic or heat_flow");
  return weight;
}

/// The mesh that heat flows on, where it is another one.
std::optional<FineMesh<2>> mesh_for_heat(const FineMesh<2>& mesh) {
  return delaunay_mesh(mesh);
}
std::optional<FineMesh<3>> mesh_for_heat(const FineMesh<3>&) {
  return std::nullopt;  // flips in space move the surface
}

/// Finds patches and asks the engine chosen for the distances on them.
template <int Dim> class PatchGeodesics {
 public:
  using Sight = std::conditional_t<Dim == 2, SightLines, SpatialSight>;
  using Marching = std::conditional_t<Dim == 2, FastMarching, SpatialMarching>;

  PatchGeodesics(const FineMesh<Dim>& mesh, const GeodesicOptions& options) : options_(options) {
    options_.engine = resolved<Dim>(options.engine);
    if (is(Weight::heat_geodesic)) delaunay_ = mesh_for_heat(mesh);
    mesh_ = delaunay_ ? &*delaunay_ : &mesh;
    if (is(Weight::euclidean)) grid_.emplace(mesh);
    if (is(Weight::visibility) || is(Weight::fast_marching)) {
      if constexpr (Dim == 2)
        sight_.emplace(mesh);
      else
        sight_.emplace(mesh, SpatialSight::Search::patches);
    }
  }

  /// Unsorted fields of all sources, each handed to `finish` as soon as it is there.
  template <class Finish>
  std::vector<LocalField> solve(const std::vector<Index>& sources, const Vector& radii, const Finish& finish) const {
    check_sources(*mesh_, sources, radii);
    std::vector<LocalField> fields(sources.size());
    std::vector<char> put_off(sources.size(), 0);
    parallel_chunks(static_cast<Index>(sources.size()), sources_per_chunk, [&](Index begin, Index end) {
      use_scratch([&](Scratch& scratch) {
        for (Index i = begin; i < end; ++i) {
          auto field = distances(scratch, sources[i], radii[i]);
          put_off[i] = !field;
          if (field) finish(i, fields[i] = std::move(*field));
        }
      });
    });
    solve_heat(sources, radii, put_off, [&](Index i, LocalField field) { finish(i, fields[i] = std::move(field)); });
    return fields;
  }

 private:
  struct Scratch {
    std::optional<PatchFinder<Dim>> finder;
    std::optional<VisibleDistance> visible;  // 2D
    std::optional<Marching> marching;
    std::optional<PatchHeat<Dim>> heat;
  };

  bool is(Weight engine) const { return options_.engine == engine; }

  template <class Use> void use_scratch(const Use& body) const {
    const auto make = [&] {
      auto scratch = std::make_unique<Scratch>();
      if ((Dim == 2 && is(Weight::fast_marching)) || is(Weight::heat_geodesic)) scratch->finder.emplace(*mesh_);
      if constexpr (Dim == 2)
        if (is(Weight::visibility)) scratch->visible.emplace(*sight_);
      if (is(Weight::fast_marching)) scratch->marching.emplace(*sight_);
      if (is(Weight::heat_geodesic)) scratch->heat.emplace(*mesh_, options_.heat_time);
      return scratch;
    };
    pool_.use(make, body);
  }

  /// Nothing where heat has to be solved.
  std::optional<LocalField> distances(Scratch& scratch, Index source, double radius) const {
    if (is(Weight::euclidean)) return straight_distances(source, radius);
    if constexpr (Dim == 2)
      if (is(Weight::visibility)) {
        scratch.visible->measure(source, radius);
        return reached_by(*scratch.visible);
      }
    if constexpr (Dim == 3)
      if (is(Weight::fast_marching)) {
        scratch.marching->march(source, radius);
        return reached_by(*scratch.marching);
      }
    const Patch<Dim>& patch = scratch.finder->around(source, radius);
    if (!patch.obstructed && !options_.always_solve) return straight_distances(patch);
    if (is(Weight::heat_geodesic)) return std::nullopt;
    scratch.marching->march({&source, 1}, radius);
    return reached_by(*scratch.marching);
  }

  LocalField straight_distances(Index source, double radius) const {
    LocalField field;
    const Vec<Dim> x = mesh_->vertex(source);
    grid_->for_each({x.array() - radius, x.array() + radius},
                    [&](Index v, const Vec<Dim>& position) { append(field, v, (position - x).norm(), radius); });
    return field;
  }

  static LocalField straight_distances(const Patch<Dim>& patch) {
    LocalField field;
    for (std::size_t k = 0; k < patch.vertices.size(); ++k)
      append(field, patch.vertices[k], patch.distances[k], patch.radius);
    return field;
  }

  static void append(LocalField& field, Index v, double distance, double radius) {
    if (distance >= radius) return;
    field.vertices.push_back(v);
    field.values.push_back(distance);
  }

  static LocalField reached_by(const VisibleDistance& visible) {
    LocalField field{visible.reached(), {}};
    field.values.reserve(field.vertices.size());
    for (Index v : field.vertices) field.values.push_back(visible.distance(v));
    return field;
  }
  static LocalField reached_by(const Marching& marching) {
    LocalField field;
    field.vertices.reserve(marching.num_reached());
    field.values.reserve(marching.num_reached());
    marching.for_each_reached([&](const Reached& at) {
      field.vertices.push_back(at.vertex);
      field.values.push_back(at.distance);
    });
    return field;
  }

  template <class Finish> void solve_heat(const std::vector<Index>& sources, const Vector& radii,
                                          const std::vector<char>& put_off, const Finish& finish) const {
    std::vector<Index> chosen;
    for (std::size_t i = 0; i < sources.size(); ++i)
      if (put_off[i]) chosen.push_back(static_cast<Index>(i));
    const Ragged<Index> groups = clusters(*mesh_, sources, radii, chosen);
    parallel_chunks(groups.rows(), 1, [&](Index group, Index) {
      std::vector<Index> members;
      std::vector<double> reach;
      for (Index i : groups[group]) {
        members.push_back(sources[i]);
        reach.push_back(radii[i]);
      }
      use_scratch([&](Scratch& scratch) {
        auto fields = scratch.heat->distances(members, reach);
        for (std::size_t k = 0; k < fields.size(); ++k) finish(groups[group][k], std::move(fields[k]));
      });
    });
  }

  GeodesicOptions options_;
  std::optional<FineMesh<Dim>> delaunay_;
  const FineMesh<Dim>* mesh_;
  std::optional<VertexGrid<Dim>> grid_;
  std::optional<Sight> sight_;
  mutable Pool<Scratch> pool_;
};

template <int Dim> std::vector<LocalField> unsorted_flow(const FineMesh<Dim>& mesh, const std::vector<Index>& sources,
                                                         const Vector& radii, int steps) {
  check_sources(mesh, sources, radii);
  if (steps < 1) throw InputError(fmt::format("heat flow: {} steps, expected at least 1", steps));
  const std::optional<FineMesh<Dim>> delaunay = mesh_for_heat(mesh);
  Pool<PatchHeat<Dim>> pool;
  std::vector<LocalField> fields(sources.size());
  parallel_chunks(static_cast<Index>(sources.size()), sources_per_chunk, [&](Index begin, Index end) {
    pool.use([&] { return std::make_unique<PatchHeat<Dim>>(delaunay ? *delaunay : mesh, 1.0); },
             [&](PatchHeat<Dim>& heat) {
               for (Index i = begin; i < end; ++i) fields[i] = heat.flow(sources[i], radii[i], steps, flow_time);
             });
  });
  return fields;
}

}  // namespace

template <int Dim> struct Geodesics<Dim>::Impl : PatchGeodesics<Dim> { using PatchGeodesics<Dim>::PatchGeodesics; };

template <int Dim> Geodesics<Dim>::Geodesics(const FineMesh<Dim>& mesh, const GeodesicOptions& options) {
  if (options.engine == Weight::heat_flow)
    throw InputError("geodesics: heat_flow gives weights, no distance; use heat_flow_weights");
  impl_ = std::make_unique<Impl>(mesh, options);
}

template <int Dim> Geodesics<Dim>::~Geodesics() = default;

template <int Dim>
std::vector<LocalField> Geodesics<Dim>::from(const std::vector<Index>& sources, const Vector& radii) const {
  return impl_->solve(sources, radii, [](Index, LocalField& field) { sort_by_vertex(field); });
}

template <int Dim> LocalField Geodesics<Dim>::from(Index source, double radius) const {
  return std::move(from(std::vector<Index>{source}, Vector::Constant(1, radius)).front());
}

template <int Dim> std::vector<LocalField> heat_flow_weights(const FineMesh<Dim>& mesh,
                                                             const std::vector<Index>& sources, const Vector& radii,
                                                             int steps) {
  auto fields = unsorted_flow(mesh, sources, radii, steps);
  for (LocalField& field : fields) sort_by_vertex(field);
  return fields;
}

template <int Dim> SparseRows node_weights(const FineMesh<Dim>& mesh, const std::vector<Index>& sources,
                                           const Vector& radii, const WeightOptions& options) {
  if (options.weight == Weight::heat_flow)
    return transposed(mesh.num_vertices(), unsorted_flow(mesh, sources, radii, flow_steps));
  const PatchGeodesics<Dim> geodesics(mesh, {.engine = options.weight});
  return transposed(mesh.num_vertices(), geodesics.solve(sources, radii, [&](Index i, LocalField& field) {
    for (double& value : field.values) value = kernel_value(options.kernel, value / radii[i]);
  }));
}

template <int Dim> SparseRows node_distances(const FineMesh<Dim>& mesh, const std::vector<Index>& sources,
                                             const Vector& radii, Weight engine) {
  if (engine == Weight::heat_flow) throw InputError("geodesics: heat_flow gives weights, no distance");
  const PatchGeodesics<Dim> geodesics(mesh, {.engine = engine});
  return transposed(mesh.num_vertices(), geodesics.solve(sources, radii, [](Index, LocalField&) {}));
}

template <int Dim>
NearestSource nearest_source(const FineMesh<Dim>& mesh, const std::vector<Index>& sources, double reach) {
  check_sources(mesh, sources, Vector::Ones(static_cast<Index>(sources.size())));
  const auto sight = [&] {
    if constexpr (Dim == 2)
      return SightLines(mesh);
    else
      return SpatialSight(mesh, SpatialSight::Search::none);
  }();
  typename PatchGeodesics<Dim>::Marching marching(sight);
  marching.march(sources, reach);
  NearestSource nearest;
  nearest.source.assign(mesh.num_vertices(), -1);
  nearest.distance.setConstant(mesh.num_vertices(), infinity);
  for (std::size_t i = sources.size(); i-- > 0;) nearest.source[sources[i]] = static_cast<Index>(i);
  // An origin is nearer than what it reaches.
  std::vector<Reached> reached;
  reached.reserve(marching.num_reached());
  marching.for_each_reached([&](const Reached& at) { reached.push_back(at); });
  std::ranges::sort(reached, {}, &Reached::distance);
  for (const Reached& at : reached) {
    nearest.distance[at.vertex] = at.distance;
    nearest.source[at.vertex] = nearest.source[at.origin];
  }
  return nearest;
}

template class Geodesics<2>;
template class Geodesics<3>;
template std::vector<LocalField> heat_flow_weights<2>(const FineMesh<2>&, const std::vector<Index>&, const Vector&,
                                                      int);
template std::vector<LocalField> heat_flow_weights<3>(const FineMesh<3>&, const std::vector<Index>&, const Vector&,
                                                      int);
template SparseRows node_weights<2>(const FineMesh<2>&, const std::vector<Index>&, const Vector&, const WeightOptions&);
template SparseRows node_weights<3>(const FineMesh<3>&, const std::vector<Index>&, const Vector&, const WeightOptions&);
template SparseRows node_distances<2>(const FineMesh<2>&, const std::vector<Index>&, const Vector&, Weight);
template SparseRows node_distances<3>(const FineMesh<3>&, const std::vector<Index>&, const Vector&, Weight);
template NearestSource nearest_source<2>(const FineMesh<2>&, const std::vector<Index>&, double);
template NearestSource nearest_source<3>(const FineMesh<3>&, const std::vector<Index>&, double);

}  // namespace efree
