// SPDX-License-Identifier: GPL-3.0-or-later
/// Linear elasticity of images in space on grids of cells, without a mesh.
#pragma once

#include "efree/analysis/utilisation.hpp"
#include "efree/solvers/cells/cell_fields.hpp"

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace efree {

/// What was found for one load case. Of Answer<3> the fields are empty: they are by cell.
struct ImageAnswer : Answer<3> {
  std::optional<CellSolution> cells;  ///< never empty once it is returned
  CellFields by_cell;                 ///< on its grid
  std::vector<Utilisation<3>> utilisations;
};

/// What an analysis on the grid of an image found; of several load cases it is the answer to the first.
struct ImageResult : ImageAnswer {
  std::vector<ImageAnswer> more;  ///< answers to the load cases after the first, in their order
  std::shared_ptr<const LabelImage<3>> image;
  std::vector<std::string> regions;         ///< names
  std::vector<Index> region_of_label;       ///< -1: none
  std::vector<SharedMaterial> materials{};  ///< by region
  std::vector<BoundaryPart> parts;          ///< of the boundary that the settings name; facets are those of voxels
  std::vector<std::pair<std::string, Reported>> reports;  ///< of the geometry
  std::vector<Attempt> attempts;                          ///< grids, in order; the answer is of the last
  std::vector<std::string> warnings;                      ///< what makes the numbers doubtful
  std::string refusal;                                    ///< why they are no answer; empty if they are one
  StageTimes times;                                       ///< image, assembly, solve, output
  double cpu_seconds = 0.0;
  VoxelParts facets{};  ///< of the parts

  /// The answers to all load cases.
  std::vector<const ImageAnswer*> answers() const;
  std::vector<ImageAnswer*> answers();
};

/// Why settings cannot be answered on the grid of an image alone, but take a mesh; empty if they can, as far as the
/// image itself does not matter (its labels' materials).
std::string why_image_takes_mesh(const MeshSource<3>& source, const Settings<3>& settings);

/// The answer, on a grid as fine as the source says; where it says nothing of two voxels, and half of that again and
/// again until the error is bearable. Nothing if a mesh has to do it: settings that are not for cells, a material that
/// is anisotropic and differs from place to place by more than a factor, or nearly incompressible, normal displacements
/// inside; as the monitor hears. Parts of the boundary are faces of voxels (ImageBoundary). Stages: image, assembly,
/// solve, output. Throws as prepare and solve_on_cells, and InputError instead of nothing with OnCells::always.
std::optional<ImageResult> analyse_image(const MeshSource<3>& source, const Settings<3>& settings,
                                         const Monitor& monitor = {});

/// Fields of all load cases at the vertices of the mesh that the source makes of its image, for programs that show
/// meshes.
struct FieldsOnMesh {
  std::shared_ptr<const FineMesh<3>> mesh;
  std::vector<Fields<3>> fields;
};
/// These of an answer. Throws as prepare.
FieldsOnMesh fields_on_mesh(const MeshSource<3>& source, const Settings<3>& settings, const ImageResult& result,
                            const Monitor& monitor = {});

}  // namespace efree
