// SPDX-License-Identifier: GPL-3.0-or-later
/// From a geometry to a mesh that an analysis can run on.
#pragma once

#include "efree/analysis/mesh_source.hpp"
#include "efree/analysis/settings.hpp"
#include "efree/core/monitor.hpp"

#include <memory>
#include <string>
#include <vector>

namespace efree {

/// A part of the boundary that an analysis uses.
struct BoundaryPart {
  std::string name;
  Index facets = 0;
  double measure = 0.0;  ///< area, in 2D length
};

/// A mesh, what was found on it, and the time it took.
template <int Dim> struct PreparedMesh {
  std::shared_ptr<const FineMesh<Dim>> mesh;
  double size = 0.0;                      ///< edges it was made with; the longest of a file with sizes of its own
  std::vector<SharedMaterial> materials;  ///< by region of the mesh
  std::vector<Parameter> densities;       ///< likewise; empty if nothing asks for them
  Matrix offsets;  ///< of the facets from the true surface (facet_offsets); empty: the facets are the surface
  bool surface_is_known = false;    ///< by its source; else the offsets are guessed from angles, or none
  std::string open_interface;       ///< part along which regions are not tied; empty: tied wherever they touch
  std::vector<BoundaryPart> parts;  ///< in the order of the settings
  /// By region, relative, where gaps between bodies were closed (ClosedContacts::volume_change); empty: none were.
  Vector volume_change;
  std::vector<std::pair<std::string, Reported>> reports;  ///< of the geometry
  std::vector<std::string> remarks;                       ///< what to tell the user: the same in words, the parts
  std::vector<std::string> warnings;                      ///< of the geometry: what makes results doubtful
  double seconds = 0.0, cpu_seconds = 0.0;
};

/// Fine mesh size of a geometry under these settings [length]; 0 leaves it to the file.
template <int Dim> double mesh_size(const MeshSource<Dim>& source, const CommonSettings<Dim>& settings);

/// Reads or makes the mesh (stage "mesh"), for moving least squares parted along the interfaces between regions; finds
/// the selections, which become named parts of the boundary; and checks that every boundary and every region that the
/// settings name is there, that every region has a material and every probe lies inside the body. Small bodies that
/// nothing holds or loads are left out. Interfaces between regions belong to no part. Throws InputError beginning with
/// the place where it was said.
template <int Dim>
PreparedMesh<Dim> prepare(const MeshSource<Dim>& source, const Settings<Dim>& settings, const Monitor& monitor = {});

/// The settings with everything decided that they leave open and the mesh and its materials tell: regime,
/// model.regions (with Regime::automatic all that materials say), model.open_interface, loads.density; conditions
/// strong for finite elements, else by Nitsche, and where they are strong functions that vanish on the supports of
/// others; an axisymmetric basis and full integration where the model needs them; dilatations averaged where functions
/// would lock (bearable_incompressibility), but for linear elements, which that does not help.
template <int Dim> Settings<Dim> with_defaults(Settings<Dim> settings, const PreparedMesh<Dim>& mesh);

}  // namespace efree
