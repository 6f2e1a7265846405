// SPDX-License-Identifier: GPL-3.0-or-later
/// Case files: a whole analysis in one TOML file. docs/case-file.md describes every key.
#pragma once

#include "efree/geometry/gmsh_reader.hpp"
#include "efree/solvers/static_analysis.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace efree {

/// A planar static analysis, as read from a case file and before anything is computed.
struct Case {
  /// Something in the file that can only be checked later, and where it was said ("file:line").
  struct Mention {
    std::string name, where;
  };
  struct Probe {
    std::string name;
    Vec<2> at;
    std::string where;
  };

  std::string title;
  std::filesystem::path file;  ///< the case file itself

  std::filesystem::path mesh_file;  ///< .geo or .msh
  GmshOptions mesh;                 ///< size is 0 if mesh_ratio says it
  double mesh_ratio = 0.0;          ///< H/h, cloud spacing over fine mesh size; 0: mesh.size holds
  std::string mesh_where;           ///< where the geometry was named

  ApproximationOptions approximation;
  ElasticModel model;
  std::vector<DisplacementCondition<2>> supports;
  Loads<2> loads;
  std::vector<Mention> groups;  ///< every boundary named by supports and loads

  ExactSolution<2> exact;  ///< both fields empty if there is none
  std::vector<Probe> probes;

  bool has_exact() const { return exact.displacement || exact.stress; }
};

/// Reads and checks a case file. Throws InputError beginning with "file:line:" for a file that cannot be read, a syntax
/// error, keys that are unknown (naming the nearest known one) or missing, wrong types, values out of range and bad
/// expressions. Names of boundaries, points of probes and the mesh are checked by solve_case.
Case read_case(const std::filesystem::path& file);

/// Whether the volumetric part should be averaged on coarser clusters where the file leaves it open (dilatation =
/// "auto"): moving least squares in plane strain with nu > 0.4. In plane stress the body can always thin out, so
/// nothing locks.
bool locks_without_dilatation(const Case& analysis);

/// Makes the conditions strong or weak and prepares the basis for it: functions of moving least squares must vanish on
/// the supports of others for nodal values to be set there.
void impose(Case& analysis, Essential essential);

}  // namespace efree
