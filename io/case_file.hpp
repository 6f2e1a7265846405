// SPDX-License-Identifier: GPL-3.0-or-later
/// Case files: a whole analysis in one TOML file. docs/case-file.md describes every key.
#pragma once

#include "efree/geometry/mesh/selection.hpp"
#include "efree/io/case_geometry.hpp"
#include "efree/solvers/correction.hpp"
#include "efree/solvers/static_analysis.hpp"

#include <filesystem>
#include <limits>
#include <string>
#include <variant>
#include <vector>

namespace efree {

/// What a case says whatever its dimension.
struct CaseSettings {
  /// Whether an image in space is solved on a grid of cells (solve_on_cells), not by a cloud.
  enum class Cells { automatic, never, always };

  /// Something in the file that can only be checked later, and where it was said ("file:line").
  struct Mention {
    std::string name, where;
  };
  struct Material {
    std::string region;  ///< empty: everywhere
    SharedMaterial material;
    std::string where;
    /// efree::incompressibility, infinite if it depends on the place; 0 in plane stress.
    double incompressibility = 0.0;
  };

  /// A probe or a reaction and the error it may have, relative to its size.
  struct Goal {
    enum class Of { probe, reaction } of;
    std::string name;
    double error;
  };

  std::string title;
  std::filesystem::path file;  ///< the case file itself
  ApproximationOptions approximation;
  Cells cells = Cells::automatic;  ///< automatic: where it can be, nothing is said of a cloud
  bool estimated = true;           ///< say how far the answer is from the finite elements of the fine mesh
  bool corrected = true;           ///< hand out the corrected answer, not that of the cloud
  CorrectionOptions correction;    ///< towards the finite elements of the fine mesh
  double accuracy = 0.0;           ///< wanted relative error in the energy norm; 0: as the mesh gives
  std::vector<Goal> goals;         ///< wanted errors of probes and reactions
  double time_limit = std::numeric_limits<double>::infinity();  ///< [s] after which no finer mesh is begun
  bool largest_displacement = false, largest_stress = false;    ///< extremes to report
  double largest_error = 0.5;       ///< relative, in the energy norm, beyond which the answer is no answer
  ElasticModel model;               ///< without the materials of regions, which the mesh must be known for
  std::vector<Material> materials;  ///< one for everything, or one for each region
  std::vector<Mention> groups;      ///< every boundary that supports, loads and spacings name, once
  std::vector<Mention> graded;      ///< regions with a spacing of their own

  bool asks_for_accuracy() const { return accuracy > 0.0 || !goals.empty(); }
};

/// A static analysis in the plane or in space, as read from a case file and before anything is computed.
template <int Dim> struct Case : CaseSettings {
  struct Probe {
    std::string name;
    Vec<Dim> at;
    std::string where;
  };
  /// What holds a part of the boundary.
  struct Reaction {
    std::string name, on, where;
  };
  /// A part of the boundary that the case selects and names itself ("box 1").
  struct Selected {
    std::string name;
    Selection<Dim> how;
    std::string where;
  };

  CaseGeometry<Dim> geometry;
  std::vector<Selected> selections;
  std::vector<DisplacementCondition<Dim>> supports;
  Loads<Dim> loads;
  ExactSolution<Dim> exact;  ///< both fields empty if there is none
  std::vector<Probe> probes;
  std::vector<Reaction> reactions;

  bool has_exact() const { return exact.displacement || exact.stress; }
};

/// The geometry decides which.
using AnyCase = std::variant<Case<2>, Case<3>>;

/// Reads and checks a case file. Throws InputError beginning with "file:line:" for a file that cannot be read, a syntax
/// error, keys that are unknown (naming the nearest known one) or missing, wrong types, values out of range and bad
/// expressions. Names of boundaries and regions, selections, points of probes and the mesh are checked by read_mesh.
AnyCase read_case(const std::filesystem::path& file);

/// Throws InputError if the case has no error estimates, so that no accuracy can be asked for.
void require_estimates(const CaseSettings& analysis);

/// Whether the volumetric part should be averaged on coarser clusters where the file leaves it open (dilatation =
/// "auto"): moving least squares with nu > 0.4 (of other materials what resists dilatation as much), but not in plane
/// stress, where the body can always thin out, so that nothing locks.
bool locks_without_dilatation(const CaseSettings& analysis);

/// Makes the conditions strong or weak and prepares the basis for it: functions of moving least squares must vanish on
/// the supports of others for nodal values to be set there.
template <int Dim> void impose(Case<Dim>& analysis, Essential essential);

}  // namespace efree
