// SPDX-License-Identifier: GPL-3.0-or-later
/// A porous block, an image made in code, stretched along z; without a mesher, by two methods.
///
///   div sigma = 0,   sigma = C : sym(grad u)   in the white voxels, pores: sigma n = 0
///
///     ^ ^ ^ ^ ^ ^   top:    u_z = 1, free to slide
///    |  o   O  o |
///    | O  o  O   |  left, right, front, back: left and front slide, the others are free
///    |___o____O__|  bottom: u_z = 0, free to slide
///
/// Prints the effective modulus by trilinear displacements on cells of two voxels, extrapolated, and by a cloud,
/// corrected to the finite elements of a lattice that is cut where the material ends; and Voigt's bound E (1 -
/// porosity).
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <efree/efree.hpp>

using namespace efree;

int main() {
  constexpr double E = 1.0, nu = 0.3;
  constexpr Index n = 40;
  const LabelImage<3> image =
      keep_largest(random_spheres<3>(n, {.porosity = 0.3, .r_min = 5.0, .r_max = 9.0, .seed = 3})).image;
  const double solid = static_cast<double>(std::ranges::count(image.labels, 1)) / (n * n * n);
  const std::vector<DisplacementCondition<3>> supports{symmetry_plane<3>("left"),
                                                       symmetry_plane<3>("front"),
                                                       symmetry_plane<3>("bottom"),
                                                       {"top", {}, [](const Vec<3>&) { return 1.0; }}};
  // Twice the strain energy is the force on the top, which moves by one: that over n^2 is the stress, the strain 1 / n.
  const auto modulus = [](double energy) { return 2.0 * energy / n; };

  const CellSolution cells = solve_on_cells(image, {{}, LinearElastic(E, nu)}, supports, {});
  const double by_cells = modulus(cells.extrapolated_energy);

  const FineMesh<3> mesh(keep_largest(mesh_on_lattice(image, {.size = 2.0}).mesh).mesh);
  const Result<3> cloud =
      analyse(mesh, {.common = {.model = {.material = LinearElastic(E, nu)}}, .supports = supports});
  const double by_cloud = modulus(cloud.solution.strain_energy), left = cloud.estimates->total();

  std::printf("%.1f %% solid, Voigt's bound %.4f\n", 100 * solid, E * solid);
  std::printf("%d cells: modulus %.4f, extrapolated %.4f\n", cells.finest().cells,
              modulus(cells.finest().strain_energy), by_cells);
  std::printf(
      "%d nodes on %d tetrahedra: modulus %.4f, error in the energy norm about %.1f %%, in the modulus %.1f %%\n",
      cloud.approximation.shape.num_nodes(), mesh.num_cells(), by_cloud, 100 * left, 100 * left * left);
  return by_cells < E * solid && by_cloud < E * solid && std::abs(by_cloud / by_cells - 1.0) < 0.03 ? 0 : 1;
}
