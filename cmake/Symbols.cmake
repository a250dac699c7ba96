# Versions of the symbols of the shared libraries. Names of the public headers have the version LIEGRAD_<major>, that of the
# SONAME. What the libraries of this project take from each other and no header installs has a version with the whole number of
# the release: libraries of two releases are refused by the loader.
#
# liegrad_symbols(out header...): a script for the linker, its path into `out` and its target liegrad_symbols; made again when a
# header changes. As a script: cmake -DOUT=... -DVERSION=... -DHEADERS=a|b -P Symbols.cmake.
if(CMAKE_SCRIPT_MODE_FILE)
  set(names "")
  string(REPLACE "|" ";" HEADERS "${HEADERS}")
  foreach(header IN LISTS HEADERS)
    file(READ ${header} text)
    string(REGEX MATCHALL "lg_[a-z0-9_]+" found "${text}")
    list(APPEND names ${found})
  endforeach()
  list(REMOVE_DUPLICATES names)
  list(SORT names)
  list(JOIN names ";\n    " names)
  string(REGEX REPLACE "[.].*" "" major ${VERSION})
  file(WRITE ${OUT} "LIEGRAD_${major} {\n  global:\n    ${names};\n};\nLIEGRAD_PRIVATE_${VERSION} {\n  global: lg_*;\n  local: *;\n};\n")
  return()
endif()

set(SYMBOLS_SCRIPT ${CMAKE_CURRENT_LIST_FILE})
function(liegrad_symbols out)
  list(JOIN ARGN "|" headers)
  set(map ${PROJECT_BINARY_DIR}/liegrad.map)
  add_custom_command(OUTPUT ${map} COMMAND ${CMAKE_COMMAND} -DOUT=${map} -DVERSION=${PROJECT_VERSION} "-DHEADERS=${headers}"
    -P ${SYMBOLS_SCRIPT} DEPENDS ${ARGN} ${SYMBOLS_SCRIPT} COMMENT "Versions of symbols" VERBATIM)
  add_custom_target(liegrad_symbols DEPENDS ${map})
  set(${out} ${map} PARENT_SCOPE)
endfunction()
