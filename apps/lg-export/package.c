/* Writes the C of a model as a CMake package (find_package(NAME), target NAME::NAME). ROS 2 builds it too:
 * package.xml says that it is plain CMake. */
#include <ctype.h>
#include <stdlib.h>

#include "lg-export/export.h"

static const char cmake[] =
    "# The model %NAME% as a library. Written by lg-export.\n"
    "cmake_minimum_required(VERSION 3.10)\n"
    "project(%NAME% VERSION 1.0.0 LANGUAGES C)\n"
    "include(GNUInstallDirs)\n"
    "include(CMakePackageConfigHelpers)\n"
    "if(NOT CMAKE_BUILD_TYPE)\n"
    "  set(CMAKE_BUILD_TYPE Release)\n"
    "endif()\n"
    "\n"
    "add_library(%NAME% NAME_.c NAME_weights.c)\n"
    "add_library(%NAME%::%NAME% ALIAS %NAME%)\n"
    "set_target_properties(%NAME% PROPERTIES C_STANDARD 99 POSITION_INDEPENDENT_CODE ON PUBLIC_HEADER "
    "NAME_.h)\n"
    "target_include_directories(%NAME% PUBLIC $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}>\n"
    "  $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)\n"
    "target_link_libraries(%NAME% PUBLIC -lm)\n"
    "\n"
    "set(config ${CMAKE_INSTALL_LIBDIR}/cmake/%NAME%)\n"
    "install(TARGETS %NAME% EXPORT %NAME%Config PUBLIC_HEADER DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})\n"
    "install(EXPORT %NAME%Config NAMESPACE %NAME%:: DESTINATION ${config})\n"
    "write_basic_package_version_file(%NAME%ConfigVersion.cmake COMPATIBILITY SameMajorVersion)\n"
    "install(FILES ${CMAKE_CURRENT_BINARY_DIR}/%NAME%ConfigVersion.cmake DESTINATION ${config})\n"
    "install(FILES package.xml DESTINATION ${CMAKE_INSTALL_DATADIR}/%NAME%)\n"
    "\n"
    "enable_testing()\n"
    "add_executable(NAME_test NAME_test.c)\n"
    "target_link_libraries(NAME_test %NAME%)\n"
    "add_test(NAME NAME_test COMMAND NAME_test)\n";

static const char manifest[] =
    "<package format=\"3\">\n"
    "  <name>%s</name>\n"
    "  <version>1.0.0</version>\n"
    "  <description>A trained model, exported by liegrad %s</description>\n"
    "  <maintainer email=\"nobody@example.org\">the owner of the model</maintainer>\n"
    "  <license>unknown</license>\n"
    "  <buildtool_depend>cmake</buildtool_depend>\n"
    "  <export>\n"
    "    <build_type>cmake</build_type>\n"
    "  </export>\n"
    "</package>\n";

/* The name in package.xml is in lower case, as ROS requires of package names. */
static void add_package(export_source *source) {
    const char *name = source->options->name;
    APP_FREE char *small = app_format("%s", name);
    for (char *s = small; *s != '\0'; s++) *s = (char)tolower((unsigned char)*s);
    export_add_named(source, cmake, export_add_file(source, "CMakeLists.txt"));
    lg_text_add(export_add_file(source, "package.xml"), manifest, small, lg_version());
}

const export_target export_target_package = {.add = add_package};
