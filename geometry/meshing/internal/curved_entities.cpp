// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/internal/curved_entities.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/infinity.hpp"
#include "efree/geometry/mesh/walls.hpp"

#include <gmsh.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>

namespace efree::internal {
namespace {

/// By node of an entity, its ends and outlines included: unit vectors there, of any sign; none where it has none.
std::map<std::size_t, Vec<3>> directions(int dim, int entity) {
  std::vector<std::size_t> tags;
  std::vector<double> coordinates, parametric, vectors;
  gmsh::model::mesh::getNodes(tags, coordinates, parametric, dim, entity, /*includeBoundary=*/true);
  std::map<std::size_t, Vec<3>> found;
  if (tags.empty() || parametric.size() != dim * tags.size()) return found;
  if (dim == 1)
    gmsh::model::getDerivative(1, entity, parametric, vectors);
  else
    gmsh::model::getNormal(entity, parametric, vectors);
  if (vectors.size() != 3 * tags.size()) return found;
  std::vector<double> back;  // parameters may be made up where gmsh knows no way back
  gmsh::model::getValue(dim, entity, parametric, back);
  double extent = 0.0;
  for (const double x : coordinates) extent = std::max(extent, std::abs(x));
  for (std::size_t k = 0; k < tags.size(); ++k) {
    const Eigen::Map<const Vec<3>> vector(&vectors[3 * k]), x(&coordinates[3 * k]), y(&back[3 * k]);
    if (vector.allFinite() && vector.norm() > 0.0 && (x - y).norm() < 1e-6 * extent)
      found.emplace(tags[k], vector.normalized());
  }
  return found;
}

bool is_straight(int dim, int entity) {
  std::string type;
  gmsh::model::getType(dim, entity, type);
  return type == "Line" || type == "Plane";
}

template <int Dim> std::vector<CurvedEdge<Dim>> edges_of_curves(const GmshSession& session) {
  GmshNodes<3> nodes(session);  // which takes curves outside of the plane, of which nothing may be meant
  std::vector<CurvedEdge<Dim>> edges;
  for (const int curve : all_entities(1)) {
    const auto ends = gmsh_simplices(1, curve);
    if (is_straight(1, curve) || ends.empty()) continue;
    const auto tangents = directions(1, curve);
    for (std::size_t k = 0; k + 1 < ends.size(); k += 2) {
      const auto at_a = tangents.find(ends[k]), at_b = tangents.find(ends[k + 1]);
      if (at_a == tangents.end() || at_b == tangents.end()) continue;
      const Vec<Dim> a = nodes.at(ends[k]).template head<Dim>(), b = nodes.at(ends[k + 1]).template head<Dim>();
      const auto along = [&](const Vec<3>& tangent) -> Vec<Dim> {
        const Vec<Dim> t = tangent.template head<Dim>();
        return t.dot(b - a) < 0.0 ? Vec<Dim>(-t) : t;
      };
      edges.push_back({a, b, (b - a).norm() / 8.0 * (along(at_a->second) - along(at_b->second)), curve});
    }
  }
  return edges;
}

/// The offset of an edge's midpoint from a surface, and the normal it is along.
struct NormalOffset {
  double height;
  Vec<3> normal;
  int surface;
};

std::vector<CurvedEdge<3>> edges_of_surfaces(const GmshSession& session) {
  using Edge = std::pair<std::size_t, std::size_t>;
  GmshNodes<3> nodes(session);
  std::map<Edge, std::vector<NormalOffset>> by_edge;
  for (const bool curved : {true, false})
    for (const int surface : all_entities(2)) {
      const auto corners = gmsh_simplices(2, surface);
      if (is_straight(2, surface) == curved || corners.empty()) continue;
      const auto normals = directions(2, surface);
      const auto add = [&](std::size_t from, std::size_t to) {
        const auto [i, j] = std::minmax(from, to);
        const auto found = by_edge.find({i, j});
        if (!curved && found == by_edge.end()) return;  // of planes those only that end at something curved
        if (found != by_edge.end() && found->second.back().surface == surface) return;
        const auto at_a = normals.find(i), at_b = normals.find(j);
        if (at_a == normals.end() && at_b == normals.end()) return;
        const Vec<3> d = nodes.at(j) - nodes.at(i);
        // Where one end has no normal, such as a pole, as of an arc of a circle.
        Vec<3> normal = Vec<3>::Zero();
        double height = 0.0;
        if (at_a != normals.end() && at_b != normals.end()) {
          const Vec<3> n = at_b->second.dot(at_a->second) < 0.0 ? Vec<3>(-at_b->second) : at_b->second;
          height = (n - at_a->second).dot(d) / 8.0;
          normal = (n + at_a->second).normalized();
        } else {
          const Vec<3>& n = at_a != normals.end() ? at_a->second : at_b->second;
          height = (at_a != normals.end() ? -0.25 : 0.25) * n.dot(d);
          normal = (n - n.dot(d) / d.squaredNorm() * d).normalized();
        }
        if (std::abs(height) > 0.25 * d.norm() || (curved && std::abs(height) < 1e-12 * d.norm())) return;
        by_edge[{i, j}].push_back({height, normal, surface});
      };
      for (std::size_t k = 0; k + 2 < corners.size(); k += 3)
        for (int i = 0; i < 3; ++i) add(corners[k + i], corners[k + (i + 1) % 3]);
    }
  std::vector<CurvedEdge<3>> edges;
  for (const auto& [edge, surfaces] : by_edge) {
    const NormalOffset& first = surfaces.front();
    Vec<3> offset = first.height * first.normal;
    if (surfaces.size() > 1) {
      // v . n = height on both; where they are tangent to each other the first does.
      const NormalOffset& second = surfaces.back();
      const double c = first.normal.dot(second.normal), det = 1.0 - c * c;
      if (det > 0.01)
        offset = (first.height - c * second.height) / det * first.normal +
                 (second.height - c * first.height) / det * second.normal;
    }
    edges.push_back({nodes.at(edge.first), nodes.at(edge.second), offset, first.surface});
  }
  return edges;
}

}  // namespace

template <int Dim> std::vector<CurvedEdge<Dim>> curved_edges(const GmshSession& session) {
  if constexpr (Dim == 2)
    return edges_of_curves<2>(session);
  else
    return edges_of_surfaces(session);
}

template <int Dim> BoundaryOffsets<Dim> offsets_of(const std::vector<CurvedEdge<Dim>>& edges, double unit) {
  const auto count = static_cast<Index>(edges.size());
  BoundaryOffsets<Dim> out{Points<Dim>(Dim, count), Points<Dim>(Dim, count)};
  for (Index k = 0; k < count; ++k) {
    const auto& edge = edges[k];
    out.points.col(k) = edge_midpoint<Dim>(edge.a / unit, edge.b / unit);
    out.offsets.col(k) = edge.offset / unit;
  }
  return out;
}

namespace {

template <int Dim> std::array<double, Dim> key_of(const Vec<Dim>& x) {
  std::array<double, Dim> key;
  std::copy_n(x.data(), Dim, key.begin());
  return key;
}

/// Calls visit(facet, edge) for the boundary facets that an edge is a side of, in 2D for those that it was split into.
template <int Dim, class Visit>
void for_each_facet(const FineMesh<Dim>& mesh, const std::vector<CurvedEdge<Dim>>& edges, const Visit& visit) {
  if constexpr (Dim == 2) {
    std::map<std::array<double, 2>, Index> vertices;
    for (Index v = 0; v < mesh.num_vertices(); ++v)
      if (mesh.on_boundary(v)) vertices.emplace(key_of<2>(mesh.vertex(v)), v);
    for (const CurvedEdge<2>& edge : edges) {
      const auto start = vertices.find(key_of<2>(edge.a));
      const Vec<2> along = edge.b - edge.a;
      for (Index at = start == vertices.end() ? -1 : start->second; at >= 0 && mesh.vertex(at) != edge.b;) {
        Index next = -1;
        for (const Index f : mesh.facets_of(at)) {
          const Index other = mesh.facets()(mesh.facets()(0, f) == at ? 1 : 0, f);
          const Vec<2> step = mesh.vertex(other) - mesh.vertex(at);
          if (step.dot(along) < (1.0 - 1e-12) * step.norm() * along.norm()) continue;
          visit(f, edge);
          next = other;
        }
        at = next;
      }
    }
  } else {
    std::map<std::array<double, 3>, const CurvedEdge<3>*> at;
    for (const auto& edge : edges) at.emplace(key_of<3>(edge_midpoint<3>(edge.a, edge.b)), &edge);
    for (Index f = 0; f < mesh.num_facets(); ++f)
      for (int i = 0; i < 3; ++i) {
        const Vec<3> a = mesh.vertex(mesh.facets()(i, f)), b = mesh.vertex(mesh.facets()((i + 1) % 3, f));
        if (const auto found = at.find(key_of<3>(edge_midpoint<3>(a, b))); found != at.end()) visit(f, *found->second);
      }
  }
}

}  // namespace

template <int Dim> std::map<int, double> chords_of_walls(const MeshData<Dim>& data,
                                                         const std::vector<CurvedEdge<Dim>>& edges, double sagitta) {
  if (edges.empty()) return {};
  const FineMesh<Dim> mesh(data);
  const Vector thickness = wall_thickness(mesh);
  std::vector<std::pair<double, int>> of_facet(mesh.num_facets(), {infinity, -1});  // shortest chord, entity
  for_each_facet<Dim>(mesh, edges, [&](Index f, const CurvedEdge<Dim>& edge) {
    const double height = std::abs(edge.offset.dot(mesh.facet_normal(f))), length = (edge.b - edge.a).norm();
    if (!(height > 1e-9 * length)) return;
    const double radius = length * length / (8.0 * height);
    const double chord = std::sqrt(8.0 * radius * sagitta * std::min(thickness[f], radius));
    if (chord < of_facet[f].first) of_facet[f] = {chord, edge.entity};
  });
  std::map<int, std::vector<std::pair<double, double>>> wanted;  // chords and areas
  for (Index f = 0; f < mesh.num_facets(); ++f)
    if (of_facet[f].second >= 0) wanted[of_facet[f].second].emplace_back(of_facet[f].first, mesh.facet_measure(f));
  std::map<int, double> chords;
  for (auto& [entity, facets] : wanted) {
    std::ranges::sort(facets);
    double area = 0.0, passed = 0.0;
    for (const auto& [chord, measure] : facets) area += measure;
    for (const auto& [chord, measure] : facets)
      if ((passed += measure) >= 0.05 * area) {
        chords[entity] = chord;
        break;
      }
  }
  return chords;
}

namespace {

/// Longest edges by entity, of each dimension.
using Sizes = std::array<std::map<int, double>, 3>;

/// Those of the entities, and of all that bounds them.
Sizes with_boundaries(int dim, const std::map<int, double>& sizes) {
  Sizes all;
  all[dim] = sizes;
  for (int d = dim; d > 0; --d)
    for (const auto& [entity, size] : all[d]) {
      std::vector<int> upward, downward;
      gmsh::model::getAdjacencies(d, entity, upward, downward);
      for (const int below : downward) {
        const auto [found, is_new] = all[d - 1].try_emplace(std::abs(below), size);
        found->second = std::min(found->second, size);
      }
    }
  return all;
}

}  // namespace

template <int Dim> void mesh_with_walls(const GmshSession& session, double sagitta, const std::function<void()>& mesh,
                                        const std::function<MeshData<Dim>()>& make) {
  constexpr double most_facets = 6e4, worth_it = 0.8;
  if (!(sagitta > 0.0)) return mesh();
  std::optional<MeshData<Dim>> first;
  for (double turn = 64.0; !first; turn *= 4.0) {
    try {
      mesh();
      first = make();
      FineMesh<Dim> checked(*first);
    } catch (const InputError&) {
      if (turn > 64.0) throw;
      first.reset();
      session.forget();
      require_elements_per_turn(turn);
    }
  }
  const auto edges = curved_edges<Dim>(session);
  std::map<int, double> chords = chords_of_walls<Dim>(*first, edges, sagitta);
  // The longest chords there are, to know where finer ones are wanted, and the areas, which bound their number.
  std::map<int, double> longest;
  for (const auto& edge : edges) {
    double& most = longest[edge.entity];
    most = std::max(most, (edge.b - edge.a).norm());
  }
  std::erase_if(chords, [&](const auto& of) { return of.second > worth_it * longest[of.first]; });
  if (chords.empty()) return;
  double facets = 0.0;
  for (const auto& [entity, chord] : chords) {
    double measure = 0.0;
    for (const auto& edge : edges)
      if (edge.entity == entity) measure += std::pow((edge.b - edge.a).norm(), Dim - 1) / (Dim == 2 ? 1.0 : 3.5);
    facets += measure / std::pow(chord, Dim - 1) * (Dim == 2 ? 1.0 : 2.3);
  }
  const double wider = std::max(1.0, std::pow(facets / most_facets, 1.0 / (Dim - 1)));
  const double factor = gmsh_option("Mesh.MeshSizeFactor");  // on the sizes of the callback too
  for (auto& [entity, chord] : chords) chord *= wider / factor / (Dim == 2 ? 1.0 : finer_than_told);
  const Sizes sizes = with_boundaries(Dim - 1, chords);
  double least = infinity;
  for (const auto& [entity, chord] : chords) least = std::min(least, chord);
  gmsh::option::setNumber("Mesh.MeshSizeMin", std::min(gmsh_option("Mesh.MeshSizeMin"), least));
  session.forget();
  gmsh::model::mesh::setSizeCallback([sizes](int dim, int entity, double, double, double) {
    if (dim > 2) return 1e22;
    const auto found = sizes[dim].find(entity);
    return found == sizes[dim].end() ? 1e22 : found->second;
  });
  mesh();
  gmsh::model::mesh::removeSizeCallback();
}

template std::vector<CurvedEdge<2>> curved_edges<2>(const GmshSession&);
template std::vector<CurvedEdge<3>> curved_edges<3>(const GmshSession&);
template BoundaryOffsets<2> offsets_of<2>(const std::vector<CurvedEdge<2>>&, double);
template BoundaryOffsets<3> offsets_of<3>(const std::vector<CurvedEdge<3>>&, double);
template std::map<int, double> chords_of_walls<2>(const MeshData<2>&, const std::vector<CurvedEdge<2>>&, double);
template std::map<int, double> chords_of_walls<3>(const MeshData<3>&, const std::vector<CurvedEdge<3>>&, double);
template void mesh_with_walls<2>(const GmshSession&, double, const std::function<void()>&,
                                 const std::function<MeshData<2>()>&);
template void mesh_with_walls<3>(const GmshSession&, double, const std::function<void()>&,
                                 const std::function<MeshData<3>()>&);

}  // namespace efree::internal
