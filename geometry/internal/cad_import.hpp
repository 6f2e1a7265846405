// SPDX-License-Identifier: GPL-3.0-or-later
/// STEP, IGES and BREP files through OpenCASCADE in gmsh.
#pragma once

#include "efree/geometry/internal/gmsh_session.hpp"

#include <string>

namespace efree::internal {

/// The length unit in which a STEP or IGES file gives its coordinates, in OpenCASCADE's words ("MM"); "MM", which is
/// what OpenCASCADE takes unitless numbers for, if the file declares none. Throws InputError for a unit that
/// OpenCASCADE does not know.
std::string declared_unit(const std::string& path);

/// Imports a CAD file with its coordinates as they are. Bodies become physical volumes, of which touching ones share
/// their faces; where bodies overlap, the common part is a physical volume of its own. Throws InputError.
void import_cad(const GmshSession& session, const std::string& path);

}  // namespace efree::internal
