# SPDX-License-Identifier: GPL-3.0-or-later
# CHOLMOD with OpenBLAS: target Cholmod::Cholmod.
find_path(Cholmod_INCLUDE_DIR cholmod.h PATH_SUFFIXES suitesparse)
find_library(Cholmod_LIBRARY cholmod)
find_library(Cholmod_OPENBLAS_LIBRARY openblas)
find_path(Cholmod_OPENBLAS_INCLUDE_DIR openblas_config.h PATH_SUFFIXES openblas-pthread openblas)
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(Cholmod REQUIRED_VARS Cholmod_LIBRARY Cholmod_INCLUDE_DIR Cholmod_OPENBLAS_LIBRARY)
if(Cholmod_FOUND AND NOT TARGET Cholmod::Cholmod)
  add_library(Cholmod::Cholmod INTERFACE IMPORTED)
  set_target_properties(Cholmod::Cholmod PROPERTIES
    INTERFACE_INCLUDE_DIRECTORIES ${Cholmod_INCLUDE_DIR}
    INTERFACE_LINK_LIBRARIES "${Cholmod_OPENBLAS_LIBRARY};${Cholmod_LIBRARY}")
endif()
