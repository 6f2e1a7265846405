// SPDX-License-Identifier: GPL-3.0-or-later
/// Error and time per source of every way to geodesic distances, at sources that do not see all of their patch.
///
///   bench_geodesics OUT.csv
///
/// Errors are in units of the radius, over vertices nearer than 0.9 radii. Times are medians over the sources, one by
/// one on one thread, patch included; "heat_geodesic_shared" solves all sources at once and divides. The outside
/// reference is CGAL's Heat_method_3 (intrinsic Delaunay) on the whole mesh: its time per source is that of one solve,
/// factorisation shared by all sources and not counted.
#include "clock.hpp"

#include "efree/core/parallel.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/heatgeo/geodesics.hpp"
#include "efree/heatgeo/internal/patch.hpp"

#include <CGAL/Heat_method_3/Surface_mesh_geodesic_distances_3.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>

#include <algorithm>
#include <fstream>
#include <iostream>
#include <numbers>
#include <random>

namespace {

using namespace efree;
using Exact = std::function<double(const FineMesh<2>&, Index, Index)>;

struct Domain {
  std::string name;
  std::function<FineMesh<2>(double)> mesh;
  Exact exact;  ///< empty: the visibility engine, which the tests prove exact, is the reference
};

double side(const FineMesh<2>& mesh, Index v) {
  double y = 0.0;
  for (Index c : mesh.cells_of(v)) y += mesh.centroid(c).y() - mesh.vertex(v).y();
  return mesh.vertex(v).y() != 0.0  ? mesh.vertex(v).y()
         : mesh.vertex(v).x() < 0.0 ? 1e-300 * std::copysign(1.0, y)
                                    : 0.0;
}

/// Slit from (-1, 0) to the origin.
double around_slit(const FineMesh<2>& mesh, Index a, Index b) {
  const Vec<2> x = mesh.vertex(a), y = mesh.vertex(b);
  const double sx = side(mesh, a), sy = side(mesh, b);
  const bool opposite = (sx > 0.0 && sy < 0.0) || (sx < 0.0 && sy > 0.0);
  const bool behind_tip = x.x() * std::abs(y.y()) + y.x() * std::abs(x.y()) < 0.0 || (x.y() == 0.0 && y.y() == 0.0);
  return opposite && behind_tip ? x.norm() + y.norm() : (x - y).norm();
}

double around_disc(const FineMesh<2>& mesh, Index s, Index v) {
  constexpr double radius = 0.5;
  const Vec<2> x = mesh.vertex(s), y = mesh.vertex(v);
  const double a = std::max(x.norm(), radius), b = std::max(y.norm(), radius);
  const double angle = std::acos(std::clamp(x.dot(y) / (x.norm() * y.norm()), -1.0, 1.0));
  const double arc = angle - std::acos(radius / a) - std::acos(radius / b);
  if (arc <= 0.0) return (x - y).norm();
  return std::sqrt(a * a - radius * radius) + std::sqrt(b * b - radius * radius) + radius * arc;
}

std::vector<Domain> domains() {
  return {
      {"square_with_slit",
       [](double h) {
         return triangulate(shapes::slit_rectangle(-1, -1, 1, 1, {-1.0, 0.0}, {0.0, 0.0}), {.size = h});
       },
       around_slit},
      {"annulus", [](double h) { return triangulate(shapes::annulus(0.5, 1.5, 0.25 * h), {.size = h}); }, around_disc},
      {"plate_with_holes",
       [](double h) {
         return triangulate(shapes::plate_with_random_holes(2.0, 12, 0.05, 0.25, 0.05, 1, 0.5 * h), {.size = h});
       },
       {}}};
}

struct Summary {
  double error_sum = 0.0, largest = 0.0;
  long count = 0;
  std::vector<double> seconds;

  void add(double found, double exact, double radius) {
    const double e = std::abs(found - exact) / radius;
    error_sum += e;
    largest = std::max(largest, e);
    ++count;
  }
  double median_ms() {
    std::nth_element(seconds.begin(), seconds.begin() + seconds.size() / 2, seconds.end());
    return 1e3 * seconds[seconds.size() / 2];
  }
};

class Study {
 public:
  Study(std::ostream& out, const Domain& domain, double h, double radius)
      : out_(out), domain_(domain), h_(h), radius_(radius), mesh_(domain.mesh(h)) {
    std::mt19937 generator(1);
    PatchFinder<2> finder(mesh_);
    while (sources_.size() < 60)
      if (const auto v = static_cast<Index>(generator() % mesh_.num_vertices()); finder.around(v, radius).obstructed)
        sources_.push_back(v);
    const Geodesics<2> visibility(mesh_, {.engine = Weight::visibility});
    for (Index s : sources_) {
      exact_.push_back(visibility.from(s, radius));
      if (!domain.exact) continue;
      for (std::size_t k = 0; k < exact_.back().vertices.size(); ++k)
        exact_.back().values[k] = domain.exact(mesh_, s, exact_.back().vertices[k]);
    }
  }

  void run() {
    for (const auto& [engine, name] : {std::pair{Weight::visibility, "visibility"},
                                       {Weight::fast_marching, "fast_marching"},
                                       {Weight::heat_geodesic, "heat_geodesic"},
                                       {Weight::euclidean, "euclidean"}})
      one_by_one(engine, name);
    shared_heat();
    cgal();
  }

 private:
  void one_by_one(Weight engine, const std::string& name) {
    const Geodesics<2> geodesics(mesh_, {.engine = engine});
    geodesics.from(sources_[0], radius_);  // scratch memory
    Summary summary;
    for (std::size_t s = 0; s < sources_.size(); ++s) {
      const double start = bench::wall_seconds();
      const LocalField field = geodesics.from(sources_[s], radius_);
      summary.seconds.push_back(bench::wall_seconds() - start);
      compare(s, field, summary);
    }
    write(name, summary);
  }

  void shared_heat() {
    const Geodesics<2> geodesics(mesh_, {.engine = Weight::heat_geodesic});
    Summary summary;
    const double start = bench::wall_seconds();
    const auto fields = geodesics.from(sources_, Vector::Constant(static_cast<Index>(sources_.size()), radius_));
    summary.seconds.assign(1, (bench::wall_seconds() - start) / static_cast<double>(sources_.size()));
    for (std::size_t s = 0; s < sources_.size(); ++s) compare(s, fields[s], summary);
    write("heat_geodesic_shared", summary);
  }

  void cgal() {
    using Point = CGAL::Simple_cartesian<double>::Point_3;
    using Surface = CGAL::Surface_mesh<Point>;
    Surface surface;
    for (Index v = 0; v < mesh_.num_vertices(); ++v)
      surface.add_vertex({mesh_.vertex(v).x(), mesh_.vertex(v).y(), 0.0});
    const auto descriptor = [](Index v) { return Surface::Vertex_index(static_cast<Surface::size_type>(v)); };
    for (Index c = 0; c < mesh_.num_cells(); ++c)
      surface.add_face(descriptor(mesh_.cells()(0, c)), descriptor(mesh_.cells()(1, c)),
                       descriptor(mesh_.cells()(2, c)));
    CGAL::Heat_method_3::Surface_mesh_geodesic_distances_3<Surface, CGAL::Heat_method_3::Intrinsic_Delaunay> method(
        surface);
    auto distance = surface.add_property_map<Surface::Vertex_index, double>("v:distance", 0.0).first;
    Summary summary;
    for (std::size_t s = 0; s < sources_.size(); ++s) {
      method.clear_sources();
      method.add_source(descriptor(sources_[s]));
      const double start = bench::wall_seconds();
      method.estimate_geodesic_distances(distance);
      summary.seconds.push_back(bench::wall_seconds() - start);
      LocalField field{exact_[s].vertices, {}};
      for (Index v : field.vertices) field.values.push_back(distance[descriptor(v)]);
      compare(s, field, summary);
    }
    write("cgal_heat_method", summary);
  }

  /// A vertex nearer than 0.9 radii that was not reached counts as an error of one radius.
  void compare(std::size_t s, const LocalField& field, Summary& summary) const {
    const auto& exact = exact_[s];
    for (std::size_t i = 0, j = 0; i < exact.vertices.size(); ++i) {
      if (exact.values[i] >= 0.9 * radius_) continue;
      while (j < field.vertices.size() && field.vertices[j] < exact.vertices[i]) ++j;
      const bool reached = j < field.vertices.size() && field.vertices[j] == exact.vertices[i];
      summary.add(reached ? field.values[j] : exact.values[i] + radius_, exact.values[i], radius_);
    }
  }

  void write(const std::string& engine, Summary& summary) const {
    out_ << engine << ',' << domain_.name << ',' << h_ << ',' << mesh_.num_vertices() << ','
         << summary.error_sum / static_cast<double>(summary.count) << ',' << summary.largest << ','
         << summary.median_ms() << '\n';
  }

  std::ostream& out_;
  const Domain& domain_;
  double h_, radius_;
  FineMesh<2> mesh_;
  std::vector<Index> sources_;
  std::vector<LocalField> exact_;
};

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: bench_geodesics OUT.csv\n";
    return 2;
  }
  set_num_threads(1);
  std::ofstream out(argv[1]);
  out << "engine,domain,h,vertices,mean_error,max_error,ms_per_source\n";
  for (const Domain& domain : domains())
    for (const double h : {0.1, 0.05, 0.025}) Study(out, domain, h, 0.5).run();
  return out ? 0 : 1;
}
