# SPDX-License-Identifier: GPL-3.0-or-later
# efree_AVX2 and efree_SSE2: the library with kernels for processors without AVX-512 (without AVX2) alone, in
# <build>/AVX2 and <build>/SSE2. scripts/test takes one of them (LD_LIBRARY_PATH), so that no test leans on the rounding
# of one processor. All but the kernels is taken from the library itself.
set(kernels assembly/block_column assembly/block_matrix basis/lme materials/internal/eight_metals dynamics/kernels
    dynamics/schemes/mpm/transfer_kernels dynamics/schemes/sph/pair_kernels
    solvers/algorithms/blend solvers/cells/cell_anisotropy solvers/cells/cell_grid solvers/cells/conduction_grid solvers/equations/side_by_side solvers/linear/conjugate_gradients
    solvers/linear/rigid_map solvers/linear/smoothing_pass solvers/linear/supernodes)
list(JOIN kernels "|" any_kernel)
list(TRANSFORM kernels APPEND .cpp)

# The list must be that of the sources with such functions.
file(GLOB_RECURSE sources RELATIVE ${PROJECT_SOURCE_DIR} ${PROJECT_SOURCE_DIR}/*.cpp)
list(FILTER sources EXCLUDE REGEX "^(build|out|tests|bench)")
foreach(source IN LISTS sources)
  file(STRINGS ${PROJECT_SOURCE_DIR}/${source} marks REGEX "EFREE_FOR_EACH_MACHINE|EFREE_AVX2_KERNELS" LIMIT_COUNT 1)
  if(marks AND NOT source IN_LIST kernels)
    message(FATAL_ERROR "cmake/KernelVariants.cmake does not list ${source}, which has kernels")
  endif()
endforeach()

foreach(newest AVX2 SSE2)
  add_library(efree_${newest} SHARED EXCLUDE_FROM_ALL ${kernels}
    "$<FILTER:$<TARGET_OBJECTS:efree>,EXCLUDE,(${any_kernel})[.]cpp>")
  efree_configure_library(efree_${newest})
  target_compile_definitions(efree_${newest} PRIVATE EFREE_${newest}_KERNELS)
  set_target_properties(efree_${newest} PROPERTIES LIBRARY_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/${newest})
endforeach()
