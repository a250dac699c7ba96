# liegrad_pc(name description requires private component): installs NAME.pc. `requires` are other modules, `private` the
# flags of a static link. The file finds its prefix from where it lies, so an installed tree may be moved.
function(liegrad_pc PC_NAME PC_DESCRIPTION requires private component)
  file(RELATIVE_PATH PC_PREFIX ${CMAKE_INSTALL_FULL_LIBDIR}/pkgconfig ${CMAKE_INSTALL_PREFIX})
  string(REGEX REPLACE "/$" "" PC_PREFIX "${PC_PREFIX}")
  list(JOIN requires " " PC_REQUIRES)
  list(JOIN private " " PC_LIBS_PRIVATE)
  set(file ${PROJECT_BINARY_DIR}/pkgconfig/${PC_NAME}.pc)
  configure_file(${PROJECT_SOURCE_DIR}/cmake/library.pc.in ${file} @ONLY)
  install(FILES ${file} DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT ${component})
endfunction()

# The SONAME of a shared library, "" for another file.
function(liegrad_soname out library)
  execute_process(COMMAND ${CMAKE_READELF} -d ${library} OUTPUT_VARIABLE dynamic ERROR_QUIET)
  set(soname "")
  if(dynamic MATCHES "SONAME[^[]*\\[([^]]+)")
    set(soname ${CMAKE_MATCH_1})
  endif()
  set(${out} "${soname}" PARENT_SCOPE)
endfunction()

# The folders of shared libraries among these files (absolute names) which the system's loader does not search: those whose SONAME
# none of its folders has.
function(liegrad_foreign_folders out)
  set(folders)
  foreach(library IN LISTS ARGN)
    liegrad_soname(soname ${library})
    if(soname)
      get_filename_component(folder ${library} DIRECTORY)
      foreach(searched IN LISTS CMAKE_C_IMPLICIT_LINK_DIRECTORIES)
        if(EXISTS ${searched}/${soname})
          set(folder "")
        endif()
      endforeach()
      list(APPEND folders ${folder})
    endif()
  endforeach()
  list(REMOVE_DUPLICATES folders)
  set(${out} "${folders}" PARENT_SCOPE)
endfunction()

# liegrad_search_paths(TARGET folder): a shared library or a program looks for libraries in this folder, and in LIEGRAD_FOREIGN,
# in the build as where it is installed. Otherwise CMake writes another list in the build, and ends it by an empty entry, which is
# the current folder: whoever can write there could bring a library.
function(liegrad_search_paths target folder)
  set(folders ${folder} ${LIEGRAD_FOREIGN})
  set_target_properties(${target} PROPERTIES BUILD_WITH_INSTALL_RPATH ON INSTALL_RPATH "${folders}")
endfunction()

# liegrad_library(NAME SOURCES ... [OBJECTS ...] [LIEGRAD other...] PACKAGES pkg... LIBRARIES flag... [ARCHIVES flag...]
#   DESCRIPTION text)
#
# One library of the project, compiled once and linked twice: NAME_shared (with a SONAME) and NAME_static. The plain
# NAME is another name of one of them, by BUILD_SHARED_LIBS. Inside another project the other one is built on demand
# only. All are also called liegrad::..., inside a build and where they are installed, and NAME.pc describes both.
# PACKAGES are suffixes of pkg_check_modules(LIEGRAD_...): private, they appear on the consumer's command line in a
# static link only. LIEGRAD are other libraries of the project. ARCHIVES are what the archives of PACKAGES need and their .pc
# files do not say: NAME.pc says it.
#
# Components of an installation: runtime (shared libraries, executables, scenes, licence), development (headers,
# archives, what CMake and pkg-config read, examples), tools (lg-bench, lg-gradcheck), documentation.
function(liegrad_library name)
  cmake_parse_arguments(ARG "" "DESCRIPTION" "SOURCES;OBJECTS;LIEGRAD;PACKAGES;LIBRARIES;ARCHIVES" ${ARGN})
  set(packages ${ARG_PACKAGES})
  list(TRANSFORM packages PREPEND PkgConfig::LIEGRAD_)

  add_library(${name}_objects OBJECT ${ARG_SOURCES})
  target_include_directories(${name}_objects PRIVATE ${PROJECT_SOURCE_DIR}/include)
  target_link_libraries(${name}_objects PRIVATE liegrad_flags ${packages})

  add_library(${name}_shared SHARED $<TARGET_OBJECTS:${name}_objects> ${ARG_OBJECTS})
  add_library(${name}_static STATIC $<TARGET_OBJECTS:${name}_objects> ${ARG_OBJECTS})
  foreach(kind shared static)
    set(target ${name}_${kind})
    set(needed ${ARG_LIEGRAD})
    list(TRANSFORM needed APPEND _${kind})
    target_include_directories(${target} PUBLIC $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include>
      $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
    target_link_libraries(${target} PUBLIC ${needed} PRIVATE ${packages} ${ARG_LIBRARIES})
    set_target_properties(${target} PROPERTIES OUTPUT_NAME ${name})
    add_library(liegrad::${target} ALIAS ${target})
  endforeach()
  set_target_properties(${name}_shared PROPERTIES VERSION ${PROJECT_VERSION} SOVERSION ${PROJECT_VERSION_MAJOR}
    LIBRARY_OUTPUT_DIRECTORY ${LIEGRAD_LIBRARY_FOLDER} LINK_DEPENDS ${LIEGRAD_SYMBOLS})
  liegrad_search_paths(${name}_shared "$ORIGIN")
  target_link_options(${name}_shared PRIVATE LINKER:--version-script=${LIEGRAD_SYMBOLS})
  target_link_libraries(${name}_shared PRIVATE liegrad_hardening)
  add_dependencies(${name}_shared liegrad_symbols)
  if(LIEGRAD_SANITIZE)
    target_link_options(${name}_shared PRIVATE -fsanitize=${LIEGRAD_SANITIZE})
  else()
    target_link_options(${name}_shared PRIVATE -Wl,--no-undefined)
  endif()

  set(plain static)
  set(other shared)
  if(BUILD_SHARED_LIBS)
    set(plain shared)
    set(other static)
  endif()
  add_library(${name} ALIAS ${name}_${plain})
  add_library(liegrad::${name} ALIAS ${name}_${plain})
  if(NOT LIEGRAD_INSTALL)
    if(NOT PROJECT_IS_TOP_LEVEL)
      set_target_properties(${name}_${other} PROPERTIES EXCLUDE_FROM_ALL TRUE)
    endif()
    return()
  endif()

  install(TARGETS ${name}_shared EXPORT liegradShared
    LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT runtime NAMELINK_COMPONENT development)
  install(TARGETS ${name}_static EXPORT liegradStatic ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT development)

  set(flags)
  foreach(package IN LISTS ARG_PACKAGES)
    list(APPEND flags ${LIEGRAD_${package}_LDFLAGS})
  endforeach()
  foreach(library IN LISTS ARG_ARCHIVES ARG_LIBRARIES)
    list(APPEND flags -l${library})
  endforeach()
  liegrad_pc(${name} "${ARG_DESCRIPTION}" "${ARG_LIEGRAD}" "${flags}" development)
endfunction()

# liegrad_plugin(NAME SOURCES ... PACKAGE prefix COMPONENT component DESCRIPTION text): a shared library on liegrad_shared
# and a package of pkg-config, installed as a component of its own: what find_package(liegrad) gives as liegrad::NAME where
# it is there, and pkg-config by NAME.pc.
function(liegrad_plugin name)
  cmake_parse_arguments(ARG "" "PACKAGE;COMPONENT;DESCRIPTION" "SOURCES" ${ARGN})
  add_library(${name} SHARED ${ARG_SOURCES})
  add_library(liegrad::${name} ALIAS ${name})
  target_link_libraries(${name} PUBLIC liegrad_shared PRIVATE liegrad_flags PkgConfig::${ARG_PACKAGE})
  set_target_properties(${name} PROPERTIES VERSION ${PROJECT_VERSION} SOVERSION ${PROJECT_VERSION_MAJOR}
    LIBRARY_OUTPUT_DIRECTORY ${LIEGRAD_LIBRARY_FOLDER} LINK_DEPENDS ${LIEGRAD_SYMBOLS})
  liegrad_search_paths(${name} "$ORIGIN")
  target_link_options(${name} PRIVATE LINKER:--version-script=${LIEGRAD_SYMBOLS})
  add_dependencies(${name} liegrad_symbols)
  if(LIEGRAD_INSTALL)
    install(TARGETS ${name} EXPORT ${name} LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT ${ARG_COMPONENT}
      NAMELINK_COMPONENT development)
    install(EXPORT ${name} NAMESPACE liegrad:: DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/liegrad COMPONENT ${ARG_COMPONENT})
    liegrad_pc(${name} "${ARG_DESCRIPTION}" liegrad "" ${ARG_COMPONENT})
  endif()
endfunction()

# Headers, the files that find_package(liegrad) reads, and the target `uninstall`.
function(liegrad_install_package)
  install(FILES ${LIEGRAD_HEADERS} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/liegrad COMPONENT development)
  include(CMakePackageConfigHelpers)
  set(directory ${CMAKE_INSTALL_LIBDIR}/cmake/liegrad)
  set(LIEGRAD_SHARED_BY_DEFAULT OFF)
  if(BUILD_SHARED_LIBS)
    set(LIEGRAD_SHARED_BY_DEFAULT ON)
  endif()
  set(LIEGRAD_IO_PACKAGES "")
  if(LIEGRAD_IO)
    set(LIEGRAD_IO_PACKAGES "HDF5=hdf5-serial YAML=yaml-0.1")
    if(LIEGRAD_SANDBOX)
      string(APPEND LIEGRAD_IO_PACKAGES " SECCOMP=libseccomp")
    endif()
  endif()
  configure_package_config_file(${PROJECT_SOURCE_DIR}/cmake/liegradConfig.cmake.in
    ${PROJECT_BINARY_DIR}/liegradConfig.cmake INSTALL_DESTINATION ${directory} NO_SET_AND_CHECK_MACRO)
  write_basic_package_version_file(${PROJECT_BINARY_DIR}/liegradConfigVersion.cmake COMPATIBILITY SameMajorVersion)
  install(FILES ${PROJECT_BINARY_DIR}/liegradConfig.cmake ${PROJECT_BINARY_DIR}/liegradConfigVersion.cmake
    DESTINATION ${directory} COMPONENT development)
  foreach(set liegradShared liegradStatic)
    install(EXPORT ${set} NAMESPACE liegrad:: DESTINATION ${directory} COMPONENT development)
  endforeach()
  if(NOT TARGET uninstall)
    add_custom_target(uninstall COMMENT "Removing what was installed" VERBATIM
      COMMAND ${CMAKE_COMMAND} -DBUILD=${CMAKE_BINARY_DIR} -P ${PROJECT_SOURCE_DIR}/cmake/Uninstall.cmake)
  endif()
endfunction()

# Scenes, ranges of searches, pages, examples and licence.
function(liegrad_install_texts)
  set(data ${CMAKE_INSTALL_DATADIR}/liegrad)
  set(pages ${CMAKE_INSTALL_DATAROOTDIR}/doc/liegrad)
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/scenes ${PROJECT_SOURCE_DIR}/searches DESTINATION ${data} COMPONENT runtime)
  install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${pages} COMPONENT runtime)
  install(FILES ${PROJECT_SOURCE_DIR}/README.md ${PROJECT_SOURCE_DIR}/CHANGELOG.md DESTINATION ${pages}
    COMPONENT documentation)
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/docs DESTINATION ${pages} COMPONENT documentation
    FILES_MATCHING PATTERN "*.md" PATTERN "*.svg" PATTERN "*.png" PATTERN "*.json" PATTERN "*.csv" PATTERN site EXCLUDE)
  install(DIRECTORY ${PROJECT_BINARY_DIR}/site/ DESTINATION ${pages}/html COMPONENT documentation OPTIONAL) # scripts/docs
  # Links of pages to headers lead to where these are installed.
  file(RELATIVE_PATH headers ${CMAKE_INSTALL_FULL_DATAROOTDIR}/doc/liegrad/docs ${CMAKE_INSTALL_FULL_INCLUDEDIR})
  install(CODE "
    file(GLOB pages \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${pages}/docs/*.md\")
    foreach(page IN LISTS pages)
      file(READ \${page} text)
      string(REPLACE \"](../include/\" \"](${headers}/\" text \"\${text}\")
      file(WRITE \${page} \"\${text}\")
    endforeach()" COMPONENT documentation)
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/examples DESTINATION ${pages} COMPONENT development USE_SOURCE_PERMISSIONS
    PATTERN "build*" EXCLUDE PATTERN exported EXCLUDE)
endfunction()
