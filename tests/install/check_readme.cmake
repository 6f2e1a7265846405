# SPDX-License-Identifier: GPL-3.0-or-later
# Installs efree into a prefix of its own, builds the program in the README against that copy, runs it and compares
# what it prints with what the README says it prints. Likewise two methods of explicit dynamics from outside of the
# library. Then runs the installed command line program.
cmake_minimum_required(VERSION 3.25)

# The lines of the fenced block that follows `marker` in the README.
function(readme_block marker result)
  file(READ ${README} rest)
  string(FIND "${rest}" "${marker}" at)
  if(at EQUAL -1)
    message(FATAL_ERROR "${README} lacks '${marker}'")
  endif()
  string(SUBSTRING "${rest}" ${at} -1 rest)
  if(NOT rest MATCHES "^[^`]*```[a-z]*\n")
    message(FATAL_ERROR "${README}: no fenced block after '${marker}'")
  endif()
  string(LENGTH "${CMAKE_MATCH_0}" begin)
  string(SUBSTRING "${rest}" ${begin} -1 rest)
  string(FIND "${rest}" "```" end)
  string(SUBSTRING "${rest}" 0 ${end} rest)
  set(${result} "${rest}" PARENT_SCOPE)
endfunction()

readme_block("<!-- snippet: plate -->" snippet)
readme_block("<!-- output: plate -->" expected)

set(prefix ${WORK}/prefix)
file(REMOVE_RECURSE ${WORK})
file(WRITE ${WORK}/plate.cpp "${snippet}")
file(COPY ${CMAKE_CURRENT_LIST_DIR}/consumer/ DESTINATION ${WORK})

execute_process(COMMAND ${CMAKE_COMMAND} --install ${EFREE_BUILD} --prefix ${prefix} OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
execute_process(
  COMMAND ${CMAKE_COMMAND} -S ${WORK} -B ${WORK}/build -G Ninja -DCMAKE_PREFIX_PATH=${prefix} -DCMAKE_BUILD_TYPE=${BUILD_TYPE}
          -DCMAKE_CXX_COMPILER=${CXX} -DCMAKE_CXX_FLAGS=${CXX_FLAGS}
  COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${CMAKE_COMMAND} --build ${WORK}/build COMMAND_ERROR_IS_FATAL ANY)

execute_process(COMMAND ${WORK}/build/plate OUTPUT_VARIABLE printed COMMAND_ERROR_IS_FATAL ANY)
if(NOT printed STREQUAL expected)
  message(FATAL_ERROR "the README promises\n${expected}but its program prints\n${printed}")
endif()

execute_process(COMMAND ${WORK}/build/outside_methods ${WORK}/outside_methods COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${prefix}/bin/efree --version OUTPUT_VARIABLE printed COMMAND_ERROR_IS_FATAL ANY)
message("${printed}")
