// SPDX-License-Identifier: GPL-3.0-or-later
/// Case files: a whole analysis in one TOML file. docs/case-file.md describes every key.
#pragma once

#include "efree/analysis/analyse.hpp"
#include "efree/analysis/dynamics.hpp"
#include "efree/analysis/effective.hpp"
#include "efree/analysis/image_analysis.hpp"
#include "efree/io/case/picture_options.hpp"
#include "efree/io/confined/reading.hpp"

#include <cstdint>
#include <filesystem>
#include <functional>
#include <variant>

namespace efree {

/// Tells a case from others.
struct CaseMark {
  std::uint64_t what = 0;  ///< all that the case file says, and its files, but for the steps
  /// The steps. Static: of [time] all but `end` and `output`; `end` where loads are expressions of t. Dynamics: 0, and
  /// `what` is without [time] but for mass_scaling, and without [output].
  std::uint64_t how = 0;

  bool operator==(const CaseMark&) const = default;
};

/// A static analysis and its geometry, as read from a case file and before anything is computed.
template <int Dim> struct Case : Settings<Dim> {
  MeshSource<Dim> geometry;
  CaseMark mark{};
  bool with_mesh = false;                  ///< fields are wanted on a mesh, of images, too
  std::vector<PictureOptions> pictures{};  ///< instead of those that every case has; none: these
};
/// A case of explicit dynamics.
template <int Dim> struct DynamicsCase : DynamicsSettings<Dim> {
  MeshSource<Dim> geometry;
  CaseMark mark{};
  std::vector<PictureOptions> pictures{};  ///< of every frame, instead of one; none: that one
  std::string animation{};                 ///< of the pictures: "webm", "mp4", "gif"; empty: none
};

/// Name of the file in which a run of explicit dynamics leaves its state.
inline constexpr const char* dynamics_state_name = "dynamics.state";
/// That file in a directory: of the run that ended there, else of the one that was stopped; an empty path: none.
std::filesystem::path find_dynamics_state(const std::filesystem::path& directory);

/// Effective properties of an image in space, which nothing but `efree inspect` meshes, or of a unit cell.
template <int Dim> struct EffectiveCase : EffectiveSettings<Dim> { MeshSource<Dim> geometry; };

/// analysis.kind and the geometry decide which.
using AnyCase = std::variant<Case<2>, Case<3>, DynamicsCase<2>, DynamicsCase<3>, EffectiveCase<2>, EffectiveCase<3>>;
using StaticCase = std::variant<Case<2>, Case<3>>;

/// Reads and checks a case file. Throws InputError for a file that cannot be read, and beginning with "file:line:" for
/// a syntax error, keys that are unknown (naming the nearest known one) or missing, wrong types, values out of range
/// and bad expressions. Names of boundaries and regions, selections, points of probes and the mesh are checked by
/// prepare. Files are read, and the geometry is meshed, as `reading` says. Stage, where gmsh has to be asked for the
/// dimension: read.
AnyCase read_case(const std::filesystem::path& file, const Reading& reading = {}, const Monitor& monitor = {});
/// The same; throws InputError also for a case of another kind.
StaticCase read_static_case(const std::filesystem::path& file, const Reading& reading = {},
                            const Monitor& monitor = {});

/// prepare, analyse and analyse_to_accuracy with the case's own geometry.
template <int Dim> PreparedMesh<Dim> prepare(const Case<Dim>& analysis, const Monitor& monitor = {}) {
  return prepare<Dim>(analysis.geometry, analysis, monitor);
}
template <int Dim> PreparedMesh<Dim> prepare(const DynamicsCase<Dim>& dynamics_case, const Monitor& monitor = {}) {
  return prepare<Dim>(dynamics_case.geometry, dynamics_case, monitor);
}
template <int Dim> PreparedMesh<Dim> prepare(const EffectiveCase<Dim>& analysis, const Monitor& monitor = {}) {
  return prepare<Dim>(analysis.geometry, Settings<Dim>{.common = analysis.common}, monitor);
}
/// On the mesh, or the meshes, of its geometry.
template <int Dim> Result<Dim> analyse(const Case<Dim>& analysis, const Monitor& monitor = {}) {
  return analyse(analysis.geometry, analysis, monitor);
}
/// Without a mesh, on the grid of its image.
inline std::optional<ImageResult> analyse_image(const Case<3>& analysis, const Monitor& monitor = {}) {
  return analyse_image(analysis.geometry, analysis, monitor);
}
/// On as many meshes as it takes.
template <int Dim> Result<Dim> analyse_to_accuracy(const Case<Dim>& analysis, const Monitor& monitor = {}) {
  return analyse_to_accuracy(analysis.geometry, analysis, monitor);
}
/// prepare and build_dynamics_model with the case's own geometry.
template <int Dim>
DynamicsModel<Dim> build_dynamics_model(const DynamicsCase<Dim>& dynamics_case, const Monitor& monitor = {}) {
  return build_dynamics_model<Dim>(prepare(dynamics_case, monitor), dynamics_case, monitor);
}

/// find_effective with the case's own image, or meshes of its geometry. Stages: read, and those of find_effective.
template <int Dim> EffectiveResult find_effective(const EffectiveCase<Dim>& analysis, const Monitor& monitor = {});

}  // namespace efree
