// SPDX-License-Identifier: GPL-3.0-or-later
/// Stability of the projected form: smallest eigenvalue of Kbar u = lambda K u, with K integrated on every fine cell
/// and the rigid motions removed, over M/N and the support, for all secondary bases. Writes CSV to standard output.
///
///   bench_coercivity [spacing = 0.4] [seeds = 3]             the plate with a hole
///   bench_coercivity --solid [spacing = 0.5] [seeds = 3]     the eighth of a cube with a spherical cavity
///   bench_coercivity --pores [seeds = 2]                     defaults on graded clouds in porous images of 128 x 128
///                                                            pixels, on meshes with as few as 3 vertices to a node
///   bench_coercivity --pressure [seeds = 3]                  inf-sup values of pressures, on squares (2D)
///                                                            and cubes (3D)
#include "efree/bench/cavity.hpp"
#include "efree/bench/inf_sup.hpp"
#include "efree/geometry/meshing/image_mesh.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/quadrature/approximation.hpp"
#include "efree/tests/bodies.hpp"

#include <Eigen/Eigenvalues>

#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string_view>

using namespace efree;
using bench::inf_sup, bench::reduced_stiffness, bench::without_rigid_motions;

namespace {

template <int Dim> Materials<Dim> material() {
  return Materials<Dim>({LinearElastic(1.0, 0.3)}, Plane::stress);
}

/// Eigenvalues, ascending, of Kbar u = lambda K u.
Vector eigenvalues(const Matrix& Kbar, const Matrix& K) {
  return Eigen::GeneralizedSelfAdjointEigenSolver<Matrix>(Kbar, K, Eigen::EigenvaluesOnly).eigenvalues();
}

template <int Dim> void study(const FineMesh<Dim>& mesh, double spacing, int seeds) {
  std::printf("secondary,support,asked,seed,nodes,points,ratio,smallest,largest,zero_modes\n");
  for (const double support : {1.5, 2.0, 2.5, 3.0})
    for (int seed = 1; seed <= seeds; ++seed) {
      ApproximationOptions options{.spacing = spacing,
                                   .seed = static_cast<std::uint64_t>(seed),
                                   .support = support,
                                   .secondary = SecondaryKind::full};
      const auto reference = approximate(mesh, options);
      const Matrix basis = without_rigid_motions<Dim>(reference.nodes);
      const Matrix K = reduced_stiffness(reference.quadrature, material<Dim>(), basis);
      for (const auto secondary : {SecondaryKind::cells, SecondaryKind::linear, SecondaryKind::mls})
        for (const double ratio : {0.5, 0.7, 1.0, 1.4, 2.0, 2.5, 2.8, 4.0, 5.6, 8.0, 16.0, 24.0}) {
          if (ratio > 8.0 && (Dim == 2 || secondary != SecondaryKind::mls)) continue;
          options.secondary = secondary;
          options.ratio = ratio;
          const auto approximation = approximate(mesh, options);
          const Vector lambda = eigenvalues(reduced_stiffness(approximation.quadrature, material<Dim>(), basis), K);
          const Index points = approximation.quadrature.size();
          std::printf("%s,%g,%g,%d,%td,%d,%.3f,%.5f,%.12f,%td\n", testing::name_of(secondary), support, ratio, seed,
                      approximation.nodes.cols(), points,
                      static_cast<double>(points) / static_cast<double>(approximation.nodes.cols()), lambda.minCoeff(),
                      lambda.maxCoeff(), (lambda.array() < 1e-8).count());
          std::fflush(stdout);
        }
    }
}

void study_pores(int seeds) {
  std::printf("simplify,size,spacing,seed,vertices,nodes,points,smallest,below_a_fifth\n");
  for (const auto& [simplify, size] : {std::pair{0.7, 5.0}, {0.5, 4.0}, {0.5, 3.0}, {0.0, 1.2}})
    for (const double spacing : {16.0, 10.0, 7.0})
      for (int seed = 1; seed <= seeds; ++seed) {
        const auto image =
            keep_largest(
                random_spheres<2>(
                    128, {.porosity = 0.3, .r_min = 4.0, .r_max = 10.0, .seed = static_cast<std::uint64_t>(seed)}))
                .image;
        const FineMesh<2> mesh(mesh_image<2>(image, {.size = size, .contour = Contour::smooth, .simplify = simplify}));
        const auto approximation = approximate(mesh, {.spacing = spacing, .grading = {.features = true}, .fine = true});
        const Matrix basis = without_rigid_motions<2>(approximation.nodes);
        const Vector lambda = eigenvalues(reduced_stiffness(approximation.quadrature, material<2>(), basis),
                                          reduced_stiffness(approximation.fine, material<2>(), basis));
        std::printf("%g,%g,%g,%d,%d,%td,%d,%.4f,%td\n", simplify, size, spacing, seed, mesh.num_vertices(),
                    approximation.nodes.cols(), approximation.quadrature.size(), lambda.minCoeff(),
                    (lambda.array() < 0.2).count());
        std::fflush(stdout);
      }
}

template <int Dim> void study_pressure(const std::function<FineMesh<Dim>(double)>& mesh_of, int seeds) {
  for (const auto& [secondary, ratio] : {std::pair{SecondaryKind::cells, 4.0},
                                         {SecondaryKind::linear, 0.0},
                                         {SecondaryKind::linear, 2.5},
                                         {SecondaryKind::linear, 3.0}})
    for (const double spacing : Dim == 2 ? std::vector{0.2, 0.1, 0.05} : std::vector{0.4, 0.3, 0.2}) {
      const auto mesh = mesh_of(spacing / 3.0);
      for (int seed = 1; seed <= seeds; ++seed) {
        const auto approximation = approximate<Dim>(mesh, {.spacing = spacing,
                                                           .seed = static_cast<std::uint64_t>(seed),
                                                           .secondary = secondary,
                                                           .ratio = ratio,
                                                           .dilatation = Dilatation::averaged});
        const auto nodes = static_cast<double>(approximation.nodes.cols());
        std::printf("%d,%s,%g,%d,%g,%.2f,%.2f,%.3f\n", Dim, testing::name_of(secondary), spacing, seed, nodes,
                    approximation.ratio(), approximation.dilatation.size() / nodes,
                    inf_sup(approximation, material<Dim>()));
        std::fflush(stdout);
      }
    }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::string_view(argv[1]) == "--pores") {
    study_pores(argc > 2 ? std::atoi(argv[2]) : 2);
    return 0;
  }
  if (argc > 1 && std::string_view(argv[1]) == "--pressure") {
    const int seeds = argc > 2 ? std::atoi(argv[2]) : 3;
    std::printf("dim,secondary,spacing,seed,nodes,points_per_node,pressures_per_node,inf_sup\n");
    study_pressure<2>([](double h) { return triangulate(shapes::rectangle(0, 0, 1, 1), {.size = h}); }, seeds);
    study_pressure<3>([](double h) { return FineMesh<3>(solids::box({1, 1, 1}, h)); }, seeds);
    return 0;
  }
  const bool solid = argc > 1 && std::string_view(argv[1]) == "--solid";
  if (solid) --argc, ++argv;
  const double spacing = argc > 1 ? std::atof(argv[1]) : solid ? 0.5 : 0.4;
  const int seeds = argc > 2 ? std::atoi(argv[2]) : 3;
  if (solid)
    study<3>(bench::Cavity::mesh(spacing / 4.0), spacing, seeds);
  else
    study<2>(triangulate(shapes::quarter_plate_with_hole(1.0, 4.0, spacing / 8.0), {.size = spacing / 8.0}), spacing,
             seeds);
}
