# SPDX-License-Identifier: GPL-3.0-or-later
# Checks, by their text alone, that sources keep the rules of docs/development.md. Run in the root of the sources:
#   cmake -P tests/check_layers.cmake
cmake_minimum_required(VERSION 3.25)

# Rooms and the rooms they may include besides themselves.
set(rooms core geometry heatgeo basis quadrature materials assembly solvers io)
set(may_core)
set(may_geometry core)
set(may_heatgeo core geometry)
set(may_basis core geometry heatgeo)
set(may_quadrature core geometry heatgeo basis)
set(may_materials core)
set(may_assembly core geometry heatgeo basis quadrature materials)
set(may_solvers core geometry heatgeo basis quadrature materials assembly)
set(may_io core geometry heatgeo basis quadrature materials assembly solvers)

set(standard_headers
  algorithm array atomic bit bitset cassert cctype cfloat charconv chrono climits cmath complex concepts cstddef cstdint
  cstdio cstdlib cstring deque exception filesystem fstream functional initializer_list iomanip iosfwd iostream istream
  iterator limits list map memory mutex new numbers numeric optional ostream queue random ratio set span sstream stdexcept
  string string_view thread tuple type_traits unordered_map unordered_set utility variant vector)

set(broken 0)
macro(complain file text)
  message("${file}: ${text}")
  math(EXPR broken "${broken} + 1")
endmacro()

set(sources_seen 0)
foreach(room IN LISTS rooms)
  file(GLOB_RECURSE sources RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} ${room}/*.hpp ${room}/*.cpp)
  foreach(source IN LISTS sources)
    math(EXPR sources_seen "${sources_seen} + 1")
    file(STRINGS ${source} includes REGEX "^[ \t]*#[ \t]*include")
    foreach(line IN LISTS includes)
      if(NOT line MATCHES "[<\"]([^>\"]+)[>\"]")
        complain(${source} "cannot read '${line}'")
        continue()
      endif()
      set(header ${CMAKE_MATCH_1})
      if(header MATCHES "^efree/([a-z]+)/")
        set(other ${CMAKE_MATCH_1})
        if(NOT other STREQUAL room AND NOT other IN_LIST may_${room})
          complain(${source} "${room}/ may not include ${header}")
        endif()
      elseif(header MATCHES "^efree" OR line MATCHES "\"")
        complain(${source} "write headers of efree as \"efree/<folder>/<file>.hpp\", others in <>: ${header}")
      elseif(source MATCHES "\\.hpp$" AND NOT source MATCHES "/internal/" AND NOT header MATCHES "^Eigen/"
             AND NOT header IN_LIST standard_headers)
        complain(${source} "public headers include efree, Eigen and the standard library only, not <${header}>")
      elseif(header STREQUAL "omp.h" AND NOT source STREQUAL "core/parallel.cpp")
        complain(${source} "only core/parallel.cpp knows OpenMP")
      endif()
    endforeach()
    file(STRINGS ${source} pragmas REGEX "#[ \t]*pragma[ \t]+omp")
    if(pragmas AND NOT source STREQUAL "core/parallel.cpp")
      complain(${source} "only core/parallel.cpp knows OpenMP")
    endif()
  endforeach()
endforeach()
if(sources_seen EQUAL 0)
  message(FATAL_ERROR "no sources in ${CMAKE_CURRENT_SOURCE_DIR}")
endif()

# The umbrella header leaves nothing out.
list(TRANSFORM rooms APPEND /*.hpp OUTPUT_VARIABLE globs)
file(GLOB headers RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} ${globs})
file(READ efree.hpp umbrella)
foreach(header IN LISTS headers)
  string(FIND "${umbrella}" "#include \"efree/${header}\"" at)
  if(at EQUAL -1)
    complain(efree.hpp "does not include ${header}")
  endif()
endforeach()

# Every source says its licence and none a path of the machine it was written on.
file(GLOB_RECURSE texts RELATIVE ${CMAKE_CURRENT_SOURCE_DIR}
  apps/* bench/* cmake/* docs/*.md examples/* scripts/* tests/*
  core/* geometry/* heatgeo/* basis/* quadrature/* materials/* assembly/* solvers/* io/*)
list(APPEND texts CMakeLists.txt CMakePresets.json README.md CHANGELOG.md efree.hpp)
foreach(text IN LISTS texts)
  if(text MATCHES "\\.(hpp|cpp)$")
    file(STRINGS ${text} first LIMIT_COUNT 1)
    if(NOT first STREQUAL "// SPDX-License-Identifier: GPL-3.0-or-later")
      complain(${text} "the first line must be // SPDX-License-Identifier: GPL-3.0-or-later")
    endif()
  endif()
  if(EXISTS ${CMAKE_CURRENT_SOURCE_DIR}/${text} AND NOT text MATCHES "\\.(png|svg)$")
    file(STRINGS ${text} paths REGEX "(^|[^A-Za-z0-9_.}])/(home|work|root|Users|tmp|opt|mnt)/")
    foreach(line IN LISTS paths)
      complain(${text} "path of one machine: ${line}")
    endforeach()
  endif()
endforeach()

if(broken)
  message(FATAL_ERROR "${broken} rules broken")
endif()
message("${sources_seen} sources keep the rules")
