// SPDX-License-Identifier: GPL-3.0-or-later
/// What an analysis is told: what the body is made of, what holds and loads it, what is asked, and how far to go for
/// it.
#pragma once

#include "efree/analysis/steps.hpp"
#include "efree/geometry/mesh/selection.hpp"
#include "efree/materials/strength.hpp"
#include "efree/solvers/algorithms/correction.hpp"
#include "efree/solvers/algorithms/newton.hpp"
#include "efree/solvers/algorithms/static_analysis.hpp"

#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace efree {

/// Something that can only be checked on the mesh, and where it was said.
struct Mention {
  std::string name, where;
};
/// What a region is made of, and where that was said.
struct RegionMaterial {
  std::string region;
  SharedMaterial material;
  std::string where{};
  Parameter density = 0.0;  ///< [mass / volume]; 0: not said
  Strength strength{};
};
/// A point to report.
template <int Dim> struct Probe {
  std::string name;
  Vec<Dim> at;
  std::string where{};
};
/// What holds a part of the boundary.
struct Reaction {
  std::string name, on, where{};
};
/// A part of the boundary that is selected on the mesh, and the name it gets.
template <int Dim> struct NamedSelection {
  std::string name;
  Selection<Dim> how;
  std::string where{};
  std::vector<std::string> parts{};  ///< unless empty: the union of these parts instead of `how`
};
/// Loads that act together, by themselves: a case.
template <int Dim> struct LoadCase {
  std::string name;
  Loads<Dim> loads{};
};
/// What holds and loads a body at one moment.
template <int Dim> struct Acting {
  std::vector<DisplacementCondition<Dim>> supports;
  Loads<Dim> loads;  ///< but for their density
};
/// The end of a path by a component of the displacement of a probe or of a reaction: the first step at which it is
/// beyond a bound that it was not beyond before. At the beginning it is 0.
struct PathEnd {
  enum class Of { probe, reaction } of;
  std::string name;    ///< of the probe; of the reaction, or the part whose reaction it is
  int component = -1;  ///< -1: the length
  std::optional<double> above{}, below{};
};
/// What it is the end of, and where, for people.
std::string text_of(const PathEnd& end);
/// How an analysis goes through pseudo-time.
template <int Dim> struct TimeSettings {
  PathOptions path{};
  std::optional<PathEnd> until{};                    ///< besides path.end
  std::function<Acting<Dim>(double time)> acting{};  ///< empty: settings.supports and loads, in proportion to the time
  /// Loads that the body bears elastically over the largest: how far steps that are left open follow loads that turn.
  double elastic_range = 1.0;
};
/// A probe or a reaction and the error it may have, relative to its size.
struct Goal {
  enum class Of { probe, reaction } of;
  std::string name;
  double error;
};
/// Whether an image in space is left to the grid of its voxels (analyse_image), not to a mesh (analyse).
enum class OnCells {
  automatic,  ///< analyse_image answers where it can be, if nothing is said of a cloud
  never,
  always,  ///< analyse_image throws where it cannot be, and analyse does
};

/// How much of what materials can do is modelled.
enum class Regime {
  automatic,  ///< linear, until that is off by more than Settings::regime_tolerance: then as `finite`
  linear,     ///< of all materials the tangent where nothing has happened yet, at small strains (Linearised)
  finite,     ///< all that materials say; those that are linear at finite strains (GreenElastic)
};

/// Settings of analyses of all kinds; all but the material and, in 2D, model.plane may be left as it is. `where`,
/// here and in what it holds, is where something was said ("file:line"): messages begin with it unless it is empty.
template <int Dim> struct CommonSettings {
  std::string title{};                            ///< for people
  std::string where{};                            ///< all of it: the case file
  ElasticModel model{};                           ///< but for `regions` and `open_interface`, which the mesh tells
  std::vector<RegionMaterial> materials{};        ///< one for each region; empty: model.material everywhere
  Parameter density = 0.0;                        ///< of model.material [mass / volume]; 0: not said
  Strength strength{};                            ///< of model.material
  std::vector<NamedSelection<Dim>> selections{};  ///< parts of the boundary besides those the mesh has
  ApproximationOptions approximation{};           ///< functions and quadrature
  /// Boundaries that settings name, in the order to report them, and regions with a spacing of their own, each with its
  /// place in the case file, if it has one.
  std::vector<Mention> groups{}, graded{};
  /// Where single settings were said, by what a case file calls them: "cloud.spacing", "accuracy", ...
  std::map<std::string, std::string> said{};
};

/// A static analysis in the plane or in space.
template <int Dim> struct Settings {
  CommonSettings<Dim> common{};
  std::vector<DisplacementCondition<Dim>> supports{};  ///< displacements that are prescribed
  Loads<Dim> loads{};                                  ///< forces; but for their density, which the materials tell
  /// Load cases, each besides `loads`: solved with one matrix, each by itself. Empty: `loads` alone.
  std::vector<LoadCase<Dim>> cases{};
  ExactSolution<Dim> exact{};                                 ///< to compare with; both fields empty if there is none
  std::vector<Probe<Dim>> probes{};                           ///< points to report
  std::vector<Reaction> reactions{};                          ///< parts whose forces to report
  bool largest_displacement = false, largest_stress = false;  ///< extremes whose errors to report

  /// Steps to take; empty: one step if what is modelled is linear, else those of TimeSettings.
  std::optional<TimeSettings<Dim>> time{};
  /// Empty: linear materials as they are, whatever the strains, others as `automatic`.
  std::optional<Regime> regime{};
  /// By which linear elasticity may be off where Regime::automatic leaves it at that (LinearCheck).
  double regime_tolerance = 0.01;
  Steps<Dim> steps{};  ///< where these begin, and who hears of them

  OnCells cells = OnCells::automatic;
  bool estimated = true;           ///< say how far the answer is from the finite elements of the fine mesh
  bool corrected = true;           ///< hand out the corrected answer, not that of the cloud
  CorrectionOptions correction{};  ///< towards the finite elements of the fine mesh
  double accuracy = 0.0;           ///< wanted relative error in the energy norm; 0: as the mesh gives
  std::vector<Goal> goals{};       ///< wanted errors of probes and reactions
  double time_limit = std::numeric_limits<double>::infinity();  ///< [s] after which no finer mesh is begun
  double largest_error = 0.5;  ///< relative, in the energy norm, beyond which the result is rejected

  bool asks_for_accuracy() const { return accuracy > 0.0 || !goals.empty(); }
  bool has_exact() const { return exact.displacement || exact.stress; }
};

/// The strength of the material of a region.
template <int Dim> Strength strength_of(const CommonSettings<Dim>& settings, const std::string& region);

/// What acts in each case, one after the other; without cases settings.loads alone.
template <int Dim> std::vector<Loads<Dim>> loads_by_case(const Settings<Dim>& settings);

/// Throws InputError if the analysis has no error estimates, so that no accuracy can be asked for.
template <int Dim> void require_estimates(const Settings<Dim>& settings);

}  // namespace efree
