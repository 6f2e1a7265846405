// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/image_mesh.hpp"

#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/geometry/mesh/internal/flat_cells.hpp"
#include "efree/geometry/mesh/internal/spatial_order.hpp"
#include "efree/geometry/meshing/internal/image_field.hpp"
#include "efree/geometry/meshing/internal/image_regions.hpp"
#include "efree/geometry/meshing/lattice_mesh.hpp"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Labeled_mesh_domain_3.h>
#include <CGAL/Mesh_complex_3_in_triangulation_3.h>
#include <CGAL/Mesh_criteria_3.h>
#include <CGAL/Mesh_domain_with_polyline_features_3.h>
#include <CGAL/Mesh_triangulation_3.h>
#include <CGAL/make_mesh_3.h>
#include <fmt/format.h>
#include <algorithm>
#include <map>
#include <set>

namespace efree {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using ImageDomain = CGAL::Mesh_domain_with_polyline_features_3<CGAL::Labeled_mesh_domain_3<Kernel>>;
using ImageTriangulation = CGAL::Mesh_triangulation_3<ImageDomain>::type;
using ImageComplex =
    CGAL::Mesh_complex_3_in_triangulation_3<ImageTriangulation, ImageDomain::Corner_index, ImageDomain::Curve_index>;
using ImageCriteria = CGAL::Mesh_criteria_3<ImageTriangulation>;

/// The image as a domain for Mesh_3. Grey values are not used: they came later, for the lattice.
class Volume {
 public:
  Volume(const LabelImage<3>& image, const internal::ImageRegions& regions)
      : image_(image), field_(image, regions, false) {}

  /// Region of a voxel.
  Label at(const std::array<Index, 3>& v) const { return field_.at(v); }

  /// The region at a point, void outside the image.
  int operator()(const Kernel::Point_3& p) const {
    const Vec<3> u = (Vec<3>(p.x(), p.y(), p.z()) - image_.origin).cwiseQuotient(image_.spacing);
    for (int d = 0; d < 3; ++d)
      if (!(u[d] >= 0.0 && u[d] <= image_.size[d])) return 0;
    return field_(u);
  }

 private:
  const LabelImage<3>& image_;
  internal::ImageField field_;
};

/// The contours on the six sides of the image and the edges between these, which the mesh has to follow.
std::vector<std::vector<Kernel::Point_3>> features(const LabelImage<3>& image, const internal::ImageRegions& regions) {
  using Corner = std::array<double, 3>;  // in voxels
  std::vector<std::vector<Kernel::Point_3>> out;
  std::set<std::pair<Corner, Corner>> edges;  // those on the frame come from two sides
  for (int normal = 0; normal < 3; ++normal)
    for (const bool high : {false, true}) {
      const int u = (normal + 1) % 3, v = (normal + 2) % 3;
      LabelImage<2> side;
      side.size = {image.size[u], image.size[v]};
      std::array<Index, 3> at;
      at[normal] = high ? image.size[normal] - 1 : 0;
      for (at[v] = 0; at[v] < image.size[v]; ++at[v])
        for (at[u] = 0; at[u] < image.size[u]; ++at[u]) side.labels.push_back(image.at(at));
      const auto plane = internal::contours(side, regions, Contour::smooth);
      for (const auto& chain : plane.chains) {
        std::vector<Corner> corners;
        for (const Index p : chain.points) {
          Corner& corner = corners.emplace_back();
          corner[normal] = high ? image.size[normal] : 0;
          corner[u] = plane.points[p].x();
          corner[v] = plane.points[p].y();
        }
        if (chain.name != "pores" && !edges.insert(std::minmax(corners.front(), corners.back())).second) continue;
        auto& polyline = out.emplace_back();
        for (const Corner& c : corners)
          polyline.emplace_back(image.origin.x() + image.spacing.x() * c[0],
                                image.origin.y() + image.spacing.y() * c[1],
                                image.origin.z() + image.spacing.z() * c[2]);
      }
    }
  return out;
}

/// Segments between the centres of voxels on two sides of a boundary inside the image: to every pair of bodies in every
/// cube of `cube` voxels a side those farthest along the axes. Refinement alone finds no body smaller than its cells.
std::vector<std::pair<Vec<3>, Vec<3>>> seeds(const LabelImage<3>& image, const Volume& volume, Index cube) {
  using Voxel = std::array<Index, 3>;
  LabelImage<3> regions = image;
  std::size_t at = 0;
  for (Index k = 0; k < image.size[2]; ++k)
    for (Index j = 0; j < image.size[1]; ++j)
      for (Index i = 0; i < image.size[0]; ++i) regions.labels[at++] = volume.at({i, j, k});
  const std::vector<Index> number = connected_pixels(regions).part_of;
  struct Face {
    Voxel voxel;
    int axis;
  };
  const auto twice_centre = [](const Face& f, int d) { return 2 * f.voxel[d] + (f.axis == d); };
  std::map<std::array<Index, 5>, std::array<Face, 6>> extremes;
  Voxel v;
  for (v[2] = 0; v[2] < image.size[2]; ++v[2])
    for (v[1] = 0; v[1] < image.size[1]; ++v[1])
      for (v[0] = 0; v[0] < image.size[0]; ++v[0])
        for (int axis = 0; axis < 3; ++axis) {
          Voxel w = v;
          if (++w[axis] == image.size[axis] || volume.at(v) == volume.at(w)) continue;
          const auto [a, b] = std::minmax(number[image.index(v)], number[image.index(w)]);
          const Face face{v, axis};
          const auto [it, fresh] = extremes.insert({{v[2] / cube, v[1] / cube, v[0] / cube, a, b}, {}});
          for (int d = 0; d < 3; ++d) {
            Face &low = it->second[2 * d], &high = it->second[2 * d + 1];
            if (fresh || twice_centre(face, d) < twice_centre(low, d)) low = face;
            if (fresh || twice_centre(face, d) > twice_centre(high, d)) high = face;
          }
        }
  std::set<std::pair<Voxel, int>> chosen;
  for (const auto& [key, faces] : extremes)
    for (const Face& face : faces) chosen.insert({face.voxel, face.axis});
  std::vector<std::pair<Vec<3>, Vec<3>>> out;
  for (const auto& [voxel, axis] : chosen) {
    const Vec<3> from =
        image.origin + image.spacing.cwiseProduct(Vec<3>(voxel[0] + 0.5, voxel[1] + 0.5, voxel[2] + 0.5));
    Vec<3> to = from;
    to[axis] += image.spacing[axis];
    out.push_back({from, to});
  }
  return out;
}

Kernel::Point_3 to_cgal(const Vec<3>& p) {
  return {p.x(), p.y(), p.z()};
}

void insert_seeds(const std::vector<std::pair<Vec<3>, Vec<3>>>& segments, const LabelImage<3>& image, double size,
                  const ImageDomain& domain, ImageComplex& complex) {
  const Vec<3> low = image.origin,
               high = low + image.spacing.cwiseProduct(Vec<3>(image.size[0], image.size[1], image.size[2]));
  const auto intersection = domain.construct_intersection_object();
  ImageTriangulation& tr = complex.triangulation();
  const auto weighted = tr.geom_traits().construct_weighted_point_3_object();
  for (const auto& [from, to] : segments) {
    // The balls around the features on the frame have at most this radius; nothing may go into them.
    const Vec<3> middle = 0.5 * (from + to);
    if (std::min((middle - low).minCoeff(), (high - middle).minCoeff()) < 1.5 * size) continue;
    const auto hit = intersection(Kernel::Segment_3(to_cgal(from), to_cgal(to)));
    if (std::get<2>(hit) == 0) continue;
    const auto v = tr.insert(weighted(std::get<0>(hit)));
    if (v == ImageTriangulation::Vertex_handle()) continue;
    complex.set_dimension(v, 2);
    complex.set_index(v, std::get<1>(hit));
  }
}

/// Vertices along a space-filling curve, those on the frame exactly there.
MeshData<3> collect(const ImageComplex& complex, const LabelImage<3>& image) {
  const ImageTriangulation& tr = complex.triangulation();
  std::map<ImageTriangulation::Vertex_handle, Index> used;
  std::vector<ImageTriangulation::Vertex_handle> vertices;
  Points<3> points(3, tr.number_of_vertices());
  for (auto v = tr.finite_vertices_begin(); v != tr.finite_vertices_end(); ++v) {
    const auto& p = v->point().point();
    points.col(std::ssize(vertices)) << p.x(), p.y(), p.z();
    vertices.push_back(v);
  }
  const std::vector<std::size_t> order = internal::along_curve<3>(points);
  const Vec<3> extent = image.spacing.cwiseProduct(Vec<3>(image.size[0], image.size[1], image.size[2]));
  MeshData<3> mesh;
  mesh.vertices = points(Eigen::all, order);
  for (std::size_t k = 0; k < order.size(); ++k) {
    used[vertices[order[k]]] = static_cast<Index>(k);
    auto x = mesh.vertices.col(static_cast<Index>(k));
    for (int d = 0; d < 3; ++d) {
      const double low = image.origin[d], high = low + extent[d];
      if (vertices[order[k]]->in_dimension() < 3 && std::abs(x[d] - low) < 1e-3 * image.spacing[d]) x[d] = low;
      if (vertices[order[k]]->in_dimension() < 3 && std::abs(x[d] - high) < 1e-3 * image.spacing[d]) x[d] = high;
    }
  }
  std::vector<std::array<Index, 5>> cells;
  for (auto c = complex.cells_in_complex_begin(); c != complex.cells_in_complex_end(); ++c) {
    std::array<Index, 5> cell;
    for (int i = 0; i < 4; ++i) cell[i] = used.at(c->vertex(i));
    // Even permutations that bring the smallest number to the front keep the orientation.
    const auto least = std::min_element(cell.begin(), cell.begin() + 4) - cell.begin();
    if (least != 0) {
      std::swap(cell[0], cell[least]);
      std::swap(cell[least == 1 ? 2 : 1], cell[least == 3 ? 2 : 3]);
    }
    cell[4] = complex.subdomain_index(c) - 1;
    cells.push_back(cell);
  }
  std::sort(cells.begin(), cells.end());
  mesh.cells.resize(4, static_cast<Index>(cells.size()));
  for (std::size_t c = 0; c < cells.size(); ++c) {
    for (int i = 0; i < 4; ++i) mesh.cells(i, static_cast<Index>(c)) = cells[c][i];
    mesh.regions.push_back(cells[c][4]);
  }
  return mesh;
}

/// Drops cells that lie within one side of the frame: they are flat, and so is what comes to the surface below them.
void drop_flat_cells(const LabelImage<3>& image, MeshData<3>& mesh) {
  const Vec<3> low = image.origin,
               high = low + image.spacing.cwiseProduct(Vec<3>(image.size[0], image.size[1], image.size[2]));
  Index kept = 0;
  for (Index c = 0; c < mesh.cells.cols(); ++c) {
    bool flat = false;
    for (int d = 0; d < 3; ++d)
      for (const double plane : {low[d], high[d]}) {
        bool all = true;
        for (int i = 0; i < 4; ++i) all = all && mesh.vertices(d, mesh.cells(i, c)) == plane;
        flat = flat || all;
      }
    if (flat) continue;
    mesh.cells.col(kept) = mesh.cells.col(c).eval();
    mesh.regions[kept++] = mesh.regions[c];
  }
  mesh.cells.conservativeResize(4, kept);
  mesh.regions.resize(kept);
}

/// By vertex: whether it lies in the frame.
std::vector<char> on_frame(const LabelImage<3>& image, const MeshData<3>& mesh) {
  const Vec<3> low = image.origin,
               high = low + image.spacing.cwiseProduct(Vec<3>(image.size[0], image.size[1], image.size[2]));
  std::vector<char> is_on(mesh.vertices.cols());
  for (Index v = 0; v < mesh.vertices.cols(); ++v) {
    const auto x = mesh.vertices.col(v).array();
    is_on[v] = (x == low.array() || x == high.array()).any();
  }
  return is_on;
}

/// Boundary facets by the side of the frame that they lie in.
void name_facets(const LabelImage<3>& image, MeshData<3>& mesh) {
  using Key = std::array<Index, 3>;
  std::vector<Key> facets;
  for (Index c = 0; c < mesh.cells.cols(); ++c)
    for (int i = 0; i < 4; ++i) {
      Key key;
      for (int k = 0; k < 3; ++k) key[k] = mesh.cells((i + 1 + k) % 4, c);
      std::sort(key.begin(), key.end());
      facets.push_back(key);
    }
  std::sort(facets.begin(), facets.end());
  const std::array<const char*, 7> names{"left", "right", "front", "back", "bottom", "top", "pores"};
  for (const char* name : names) mesh.groups.push_back({name, {}});
  const Vec<3> low = image.origin,
               high = low + image.spacing.cwiseProduct(Vec<3>(image.size[0], image.size[1], image.size[2]));
  for (std::size_t f = 0; f < facets.size(); ++f) {
    if (f + 1 < facets.size() && facets[f] == facets[f + 1]) {
      ++f;
      continue;
    }
    int group = 6;
    for (int d = 0; d < 3; ++d)
      for (const int side : {0, 1}) {
        const double plane = side == 0 ? low[d] : high[d];
        if (std::all_of(facets[f].begin(), facets[f].end(), [&](Index v) { return mesh.vertices(d, v) == plane; }))
          group = 2 * d + side;
      }
    mesh.groups[group].facets.push_back(facets[f]);
  }
}

}  // namespace

template <> MeshData<3> mesh_image<3>(const LabelImage<3>& image, const ImageMeshOptions& options) {
  if (options.mesher == Mesher::lattice) return mesh_on_lattice(image, options).mesh;
  const internal::ImageRegions regions = internal::image_regions(image, options);
  double material = 0.0;
  for (const LabelCount& count : count_labels(image))
    if (count.label != 0) material += static_cast<double>(count.pixels) * image.pixel_volume();
  const double cells = 12.0 * material / std::pow(options.size, 3);
  require_memory(1000.0 * cells + 10.0 * static_cast<double>(image.labels.size()),
                 fmt::format("image: meshing {} x {} x {} voxels with a size of {}", image.size[0], image.size[1],
                             image.size[2], options.size));

  const Volume volume(image, regions);
  const Vec<3> extent = image.spacing.cwiseProduct(Vec<3>(image.size[0], image.size[1], image.size[2]));
  const Vec<3> low = image.origin - 0.01 * extent, high = image.origin + 1.01 * extent;
  const double voxel = image.spacing.minCoeff();
  ImageDomain domain([&](const Kernel::Point_3& p) { return volume(p); },
                     CGAL::Bbox_3(low.x(), low.y(), low.z(), high.x(), high.y(), high.z()),
                     1e-5 * voxel / extent.norm());
  const auto polylines = features(image, regions);
  domain.add_features(polylines.begin(), polylines.end());

  namespace p = CGAL::parameters;
  const double radius = 0.7 * options.size;  // of the ball around a cell: its edges are about 1.4 of these
  const ImageCriteria criteria(p::edge_size = options.size, p::facet_size = radius,
                               p::facet_distance = options.facet_distance * voxel, p::cell_size = radius);
  ImageComplex complex;
  CGAL::Mesh_3::internal::init_c3t3_with_features(complex, domain, criteria);
  const Index cube = std::max(2, static_cast<Index>(std::lround(2.0 * options.size / image.spacing.maxCoeff())));
  insert_seeds(seeds(image, volume, cube), image, options.size, domain, complex);
  if (complex.triangulation().dimension() < 3)
    throw NumericalError("image: the material has no volume that the mesher finds");
  CGAL::refine_mesh_3(complex, domain, criteria, p::no_exude(), p::no_perturb(), p::no_lloyd(), p::no_odt());
  if (complex.number_of_cells_in_complex() == 0)
    throw NumericalError(
        fmt::format("image: with a size of {} nothing of the material is found; take a smaller one", options.size));

  MeshData<3> mesh = collect(complex, image);
  complex.clear();
  drop_flat_cells(image, mesh);
  internal::inflate_flat_cells(mesh, 0.1 * options.facet_distance * voxel, on_frame(image, mesh));
  name_facets(image, mesh);
  internal::turn_to_world(image, mesh.vertices);
  mesh.region_names = regions.names;
  std::vector<std::array<Index, 3>> boundary;
  for (const auto& group : mesh.groups) boundary.insert(boundary.end(), group.facets.begin(), group.facets.end());
  return cut_open<3>(std::move(mesh), boundary);  // opens nothing but vertices in which parts of the body touch
}

}  // namespace efree
