// SPDX-License-Identifier: GPL-3.0-or-later
/// One scene of explicit dynamics by several methods, coarse to fine: errors over CPU time.
#pragma once

#include "efree/analysis/dynamics.hpp"

#include <optional>
#include <string>
#include <vector>

namespace efree {

/// A method under comparison. Options that the case does not give have their defaults.
struct ComparedMethod {
  /// "otm", "total_lagrangian", "mpm" and with other frames "mpm_total", "mpm_mesh", "sph", with artificial stress
  /// "sph_stress", with splitting "sph_split", in the total frame "sph_total".
  std::string name;
  std::string label;  ///< for charts
  DynamicsMethod method = DynamicsMethod::otm;
  MpmFrame frame = MpmFrame::updated;      ///< of mpm
  SphFrame sph_frame = SphFrame::updated;  ///< of sph, as the next
  double artificial_stress = 0.0;          ///< ArtificialStress::strength
  double splitting = 0.0;                  ///< ParticleSplitting::strain
};
/// All methods that can be compared.
const std::vector<ComparedMethod>& compared_methods();

struct ComparisonOptions {
  std::vector<std::string> methods{};  ///< names, each once; empty: all
  int resolutions = 3;                 ///< runs of each method: the case's spacing, then coarser by sqrt(2) each
};

/// One run.
struct ComparisonRow {
  std::size_t method = 0;    ///< index into Comparison::methods
  double spacing = 0.0;      ///< of nodes [length]
  std::string failure{};     ///< why it ended before its time or was rejected; empty: neither
  bool has_numbers = false;  ///< whether it began; else only cpu_seconds is measured
  Index nodes = 0, points = 0, steps = 0;
  double time = 0.0;                          ///< that it reached
  double cpu_seconds = 0.0;                   ///< of all threads, from the mesh to the end
  double energy_error = 0.0;                  ///< the largest in the run, as EnergyWatch has it
  std::vector<std::vector<double>> probes{};  ///< at the end, by probe: a number or a displacement; empty: no value
  std::vector<std::string> warnings{};
};

/// Reference value of a probe.
struct ProbeReference {
  std::string name;
  /// DynamicsProbe::truth, or the medians of the finest runs of all methods that came to their end; empty: none did.
  std::vector<double> value{};
  bool given = false;        ///< it is DynamicsProbe::truth
  int runs = 0;              ///< number of runs whose median the value is
  double uncertainty = 0.0;  ///< largest relative distance of these runs from it; of a truth 0
  double scale = 1.0;        ///< norm of the reference, or the largest of all runs where that is next to nothing
};

struct Comparison {
  std::vector<ComparedMethod> methods{};
  std::vector<ComparisonRow> rows{};  ///< by method, coarse to fine
  std::vector<ProbeReference> probes{};

  /// Whether a run came to its end.
  bool has_results() const;
  /// Relative error of a probe in a row; empty where either has no value, or the run failed.
  std::optional<double> error(const ComparisonRow& row, std::size_t probe) const;
};

/// Runs every method at every resolution. Methods that cannot run the scene, or fail, have rows that say why. Throws
/// InputError for unknown methods, a case without a spacing (mesh_size of OTM, spacing of a cloud or of particles, cell
/// of the material point method), or input with which no method can begin; Cancelled.
template <int Dim> Comparison compare_methods(const MeshSource<Dim>& source, const DynamicsSettings<Dim>& settings,
                                              const ComparisonOptions& options, const Monitor& monitor = {});

}  // namespace efree
