// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/heatgeo/geodesics.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/heatgeo/fast_marching.hpp"
#include "efree/heatgeo/patch.hpp"
#include "efree/heatgeo/visible_distance.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <limits>
#include <mutex>
#include <numeric>
#include <optional>

namespace efree {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr Index sources_per_chunk = 8;

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

/// Finds patches and asks the engine chosen for the distances on them.
class PlanarGeodesics {
 public:
  PlanarGeodesics(const FineMesh<2>& mesh, const GeodesicOptions& options) : mesh_(mesh), options_(options) {
    if (options.engine == Weight::heat_geodesic || options.engine == Weight::heat_flow)
      throw InputError("geodesics: the heat engines are not there yet");
    if (options.engine == Weight::visibility || options.engine == Weight::fast_marching) sight_.emplace(mesh);
  }

  /// Unsorted fields of all sources, each handed to `finish` as soon as it is there.
  template <class Finish>
  std::vector<LocalField> solve(const std::vector<Index>& sources, const Vector& radii, const Finish& finish) const {
    check_sources(mesh_, sources, radii);
    std::vector<LocalField> fields(sources.size());
    parallel_chunks(static_cast<Index>(sources.size()), sources_per_chunk, [&](Index begin, Index end) {
      pool_.use([&] { return make_scratch(); },
                [&](Scratch& scratch) {
                  for (Index i = begin; i < end; ++i) {
                    fields[i] = distances(scratch, sources[i], radii[i]);
                    finish(i, fields[i]);
                  }
                });
    });
    return fields;
  }

 private:
  struct Scratch {
    PatchFinder<2> finder;
    std::optional<VisibleDistance> visible;
    std::optional<FastMarching> marching;
  };

  std::unique_ptr<Scratch> make_scratch() const {
    auto scratch = std::make_unique<Scratch>(Scratch{PatchFinder<2>(mesh_), std::nullopt, std::nullopt});
    if (options_.engine == Weight::visibility) scratch->visible.emplace(*sight_);
    if (options_.engine == Weight::fast_marching) scratch->marching.emplace(*sight_);
    return scratch;
  }

  LocalField distances(Scratch& scratch, Index source, double radius) const {
    const Patch<2>& patch = scratch.finder.around(source, radius);
    LocalField field;
    if (options_.engine == Weight::fast_marching && (patch.obstructed || options_.always_solve)) {
      scratch.marching->march({&source, 1}, radius);
      field.vertices = scratch.marching->reached();
      for (Index v : field.vertices) field.values.push_back(scratch.marching->distance(v));
      return field;
    }
    const auto& d = options_.engine == Weight::visibility ? scratch.visible->from(patch) : patch.distances;
    field.vertices.reserve(d.size());
    field.values.reserve(d.size());
    for (std::size_t k = 0; k < d.size(); ++k)
      if (d[k] < radius) {
        field.vertices.push_back(patch.vertices[k]);
        field.values.push_back(d[k]);
      }
    return field;
  }

  const FineMesh<2>& mesh_;
  GeodesicOptions options_;
  std::optional<SightLines> sight_;
  mutable Pool<Scratch> pool_;
};

}  // namespace

template <> struct Geodesics<2>::Impl : PlanarGeodesics { using PlanarGeodesics::PlanarGeodesics; };

template <> Geodesics<2>::Geodesics(const FineMesh<2>& mesh, const GeodesicOptions& options) {
  if (options.engine == Weight::heat_flow)
    throw InputError("geodesics: heat_flow gives weights, no distance; use heat_flow_weights");
  impl_ = std::make_unique<Impl>(mesh, options);
}

template <int Dim> Geodesics<Dim>::~Geodesics() = default;

template <> std::vector<LocalField> Geodesics<2>::from(const std::vector<Index>& sources, const Vector& radii) const {
  return impl_->solve(sources, radii, [](Index, LocalField& field) { sort_by_vertex(field); });
}

template <int Dim> LocalField Geodesics<Dim>::from(Index source, double radius) const {
  return std::move(from(std::vector<Index>{source}, Vector::Constant(1, radius)).front());
}

template <> SparseRows node_weights<2>(const FineMesh<2>& mesh, const std::vector<Index>& sources, const Vector& radii,
                                       const WeightOptions& options) {
  const PlanarGeodesics geodesics(mesh, {.engine = options.weight});
  return transposed(mesh.num_vertices(), geodesics.solve(sources, radii, [&](Index i, LocalField& field) {
    for (double& value : field.values) value = kernel_value(options.kernel, value / radii[i]);
  }));
}

template <> NearestSource nearest_source<2>(const FineMesh<2>& mesh, const std::vector<Index>& sources) {
  check_sources(mesh, sources, Vector::Ones(static_cast<Index>(sources.size())));
  const SightLines sight(mesh);
  FastMarching marching(sight);
  marching.march(sources, infinity);
  NearestSource nearest;
  nearest.source.assign(mesh.num_vertices(), -1);
  nearest.distance.setConstant(mesh.num_vertices(), infinity);
  for (std::size_t i = sources.size(); i-- > 0;) nearest.source[sources[i]] = static_cast<Index>(i);
  // An origin is nearer than what it reaches.
  std::vector<Index> order = marching.reached();
  std::sort(order.begin(), order.end(), [&](Index a, Index b) { return marching.distance(a) < marching.distance(b); });
  for (Index v : order) {
    nearest.distance[v] = marching.distance(v);
    nearest.source[v] = nearest.source[marching.origin(v)];
  }
  return nearest;
}

template class Geodesics<2>;

}  // namespace efree
