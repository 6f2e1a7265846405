# SPDX-License-Identifier: GPL-3.0-or-later
# The gmsh API: target Gmsh::Gmsh.
find_path(Gmsh_INCLUDE_DIR gmsh.h)
find_library(Gmsh_LIBRARY gmsh)
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(Gmsh REQUIRED_VARS Gmsh_LIBRARY Gmsh_INCLUDE_DIR)
if(Gmsh_FOUND AND NOT TARGET Gmsh::Gmsh)
  add_library(Gmsh::Gmsh INTERFACE IMPORTED)
  set_target_properties(Gmsh::Gmsh PROPERTIES INTERFACE_INCLUDE_DIRECTORIES ${Gmsh_INCLUDE_DIR} INTERFACE_LINK_LIBRARIES ${Gmsh_LIBRARY})
endif()
