// SPDX-License-Identifier: GPL-3.0-or-later
/// STEP, IGES and BREP files through OpenCASCADE in gmsh.
#pragma once

#include "efree/geometry/meshing/internal/gmsh_session.hpp"

#include <string>

namespace efree::internal {

/// Imports a CAD file in millimetres, which OpenCASCADE's tolerances are made for. Bodies become physical volumes, of
/// which touching ones share their faces; where bodies overlap, the common part is a physical volume of its own.
/// Returns the length unit that the file declares, in millimetres (1 if it declares none): divide by it to get the
/// file's numbers. Throws InputError.
double import_cad(const GmshSession& session, const std::string& path);

}  // namespace efree::internal
