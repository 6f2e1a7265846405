# SPDX-License-Identifier: GPL-3.0-or-later
# Run after a GoogleTest executable is built: cmake -D EXECUTABLE=... -D OUTPUT=... -D TIMEOUT=... -P DiscoverSuites.cmake
# Writes one ctest for every suite of it. A process for every test would spend a third of the time on starting. Threads
# that wait sleep: those of two tests at once would keep each other from the processor (plastic limits: 33 s, not 7).
execute_process(COMMAND ${EXECUTABLE} --gtest_list_tests OUTPUT_VARIABLE listed RESULT_VARIABLE status)
if(NOT status EQUAL 0)
  message(FATAL_ERROR "${EXECUTABLE} does not list its tests: ${status}")
endif()
get_filename_component(directory ${OUTPUT} DIRECTORY)
string(REGEX MATCHALL "[^\n]+" lines "${listed}")
set(tests "")
foreach(line IN LISTS lines)
  if(line MATCHES "^([A-Za-z0-9_/]+)\\.") # instances of typed suites are told apart by a comment: "Suite/0.  # TypeParam"
    set(suite ${CMAKE_MATCH_1})
    if(NOT suite MATCHES "^DISABLED_")
      string(APPEND tests "add_test([=[${suite}]=] [=[${EXECUTABLE}]=] [=[--gtest_filter=${suite}.*]=])\n"
                          "set_tests_properties([=[${suite}]=] PROPERTIES WORKING_DIRECTORY [=[${directory}]=] TIMEOUT ${TIMEOUT} ENVIRONMENT OMP_WAIT_POLICY=passive)\n")
    endif()
  endif()
endforeach()
if(tests STREQUAL "")
  message(FATAL_ERROR "${EXECUTABLE} has no tests")
endif()
file(WRITE ${OUTPUT} "${tests}")
