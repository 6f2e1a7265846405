// SPDX-License-Identifier: GPL-3.0-or-later
/// Where methods are known to break, and whether efree's defaults do. A table for each row of docs/stability.md.
///
///   bench_stability ROW [folder for CSV files] [clouds = as the row says]
///
///   truth     Cook's membrane by P2 elements on fine meshes
///   locking   Cook's membrane, nu = 0.3 to 0.499999, small and finite strains
///   surface   first zero eigenvalue of a compressed block
///   points    modes that few quadrature points do not see, at rest, at large strains and after yield
///   crack     stress intensity of an edge crack; functions that leak across slits and around corners
///   clouds    spread of results over clouds and bad triangulations
///   pressure  inf-sup values, swings and total variation of nearly incompressible pressures
#include "stability.hpp"

#include <cstdlib>
#include <map>

using namespace efree::bench;

int main(int argc, char** argv) {
  const std::map<std::string, std::pair<void (*)(const StudyOf&), int>> rows{{"truth", {cook_truth, 1}},
                                                                             {"locking", {volumetric_locking, 5}},
                                                                             {"surface", {surface_instability, 5}},
                                                                             {"points", {too_few_points, 3}},
                                                                             {"crack", {crack, 5}},
                                                                             {"clouds", {random_clouds, 20}},
                                                                             {"pressure", {pressure_oscillation, 3}}};
  const auto row = argc > 1 ? rows.find(argv[1]) : rows.end();
  if (row == rows.end()) {
    std::fprintf(stderr, "bench_stability ROW [folder] [clouds]; ROW is one of");
    for (const auto& [name, what] : rows) std::fprintf(stderr, " %s", name.c_str());
    std::fprintf(stderr, "\n");
    return 2;
  }
  row->second.first({argc > 2 ? argv[2] : "", argc > 3 ? std::atoi(argv[3]) : row->second.second});
}
