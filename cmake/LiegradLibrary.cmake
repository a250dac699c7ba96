# liegrad_library(NAME SOURCES ... [OBJECTS ...] [LIEGRAD other...] PACKAGES pkg... LIBRARIES flag... DESCRIPTION text)
#
# One library of the project, compiled once and linked twice: NAME (shared, with SONAME) and NAME_static. Both are
# installed and exported as liegrad::NAME and liegrad::NAME_static, and described by NAME.pc. PACKAGES are prefixes of
# pkg_check_modules(... IMPORTED_TARGET): private, they appear on the consumer's command line in a static link only.
function(liegrad_library name)
  cmake_parse_arguments(ARG "" "DESCRIPTION" "SOURCES;OBJECTS;LIEGRAD;PACKAGES;LIBRARIES" ${ARGN})
  set(packages ${ARG_PACKAGES})
  list(TRANSFORM packages PREPEND PkgConfig::)

  add_library(${name}_objects OBJECT ${ARG_SOURCES})
  target_include_directories(${name}_objects PRIVATE ${PROJECT_SOURCE_DIR}/include)
  target_link_libraries(${name}_objects PRIVATE liegrad_flags ${packages})

  add_library(${name} SHARED $<TARGET_OBJECTS:${name}_objects> ${ARG_OBJECTS})
  add_library(${name}_static STATIC $<TARGET_OBJECTS:${name}_objects> ${ARG_OBJECTS})
  foreach(suffix "" _static)
    set(target ${name}${suffix})
    set(needed ${ARG_LIEGRAD})
    list(TRANSFORM needed APPEND "${suffix}")
    target_include_directories(${target} PUBLIC $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include>
      $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
    target_link_libraries(${target} PUBLIC ${needed} PRIVATE ${packages} ${ARG_LIBRARIES})
    add_library(liegrad::${target} ALIAS ${target})
  endforeach()
  set_target_properties(${name} PROPERTIES VERSION ${PROJECT_VERSION} SOVERSION ${PROJECT_VERSION_MAJOR})
  set_target_properties(${name}_static PROPERTIES OUTPUT_NAME ${name})
  if(LIEGRAD_SANITIZE)
    target_link_options(${name} PRIVATE -fsanitize=${LIEGRAD_SANITIZE})
  else()
    target_link_options(${name} PRIVATE -Wl,--no-undefined)
  endif()

  install(TARGETS ${name} EXPORT liegradShared LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR})
  install(TARGETS ${name}_static EXPORT liegradStatic ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})

  # The .pc file finds its prefix from where it lies, so an installed tree may be moved.
  file(RELATIVE_PATH PC_PREFIX ${CMAKE_INSTALL_FULL_LIBDIR}/pkgconfig ${CMAKE_INSTALL_PREFIX})
  string(REGEX REPLACE "/$" "" PC_PREFIX "${PC_PREFIX}")
  set(PC_NAME ${name})
  set(PC_DESCRIPTION "${ARG_DESCRIPTION}")
  list(JOIN ARG_LIEGRAD " " PC_REQUIRES)
  set(flags)
  foreach(package IN LISTS ARG_PACKAGES)
    list(APPEND flags ${${package}_LDFLAGS})
  endforeach()
  foreach(library IN LISTS ARG_LIBRARIES)
    string(REPLACE "Threads::Threads" "pthread" library "${library}")
    list(APPEND flags -l${library})
  endforeach()
  list(JOIN flags " " PC_LIBS_PRIVATE)
  configure_file(${PROJECT_SOURCE_DIR}/cmake/library.pc.in ${PROJECT_BINARY_DIR}/pkgconfig/${name}.pc @ONLY)
  install(FILES ${PROJECT_BINARY_DIR}/pkgconfig/${name}.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
endfunction()

# Headers and the files that find_package(liegrad) reads.
function(liegrad_install_package)
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/include/liegrad DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}
    FILES_MATCHING PATTERN "*.h")
  include(CMakePackageConfigHelpers)
  set(directory ${CMAKE_INSTALL_LIBDIR}/cmake/liegrad)
  configure_package_config_file(${PROJECT_SOURCE_DIR}/cmake/liegradConfig.cmake.in
    ${PROJECT_BINARY_DIR}/liegradConfig.cmake INSTALL_DESTINATION ${directory} NO_SET_AND_CHECK_MACRO)
  write_basic_package_version_file(${PROJECT_BINARY_DIR}/liegradConfigVersion.cmake COMPATIBILITY SameMajorVersion)
  install(FILES ${PROJECT_BINARY_DIR}/liegradConfig.cmake ${PROJECT_BINARY_DIR}/liegradConfigVersion.cmake
    DESTINATION ${directory})
  install(EXPORT liegradShared NAMESPACE liegrad:: DESTINATION ${directory})
  install(EXPORT liegradStatic NAMESPACE liegrad:: DESTINATION ${directory})
endfunction()
