/* The C of a model as a CMake package (find_package(NAME), target NAME::NAME), which ROS 2 builds too:
 * package.xml says that it is plain CMake. */
#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include "lg-export/export.h"

static const char cmake[] =
    "# The model NAME_. as a library. Written by lg-export.\n"
    "cmake_minimum_required(VERSION 3.10)\n"
    "project(NAME_. VERSION 1.0.0 LANGUAGES C)\n"
    "include(GNUInstallDirs)\n"
    "include(CMakePackageConfigHelpers)\n"
    "if(NOT CMAKE_BUILD_TYPE)\n"
    "  set(CMAKE_BUILD_TYPE Release)\n"
    "endif()\n"
    "\n"
    "add_library(NAME_. NAME_.c NAME_weights.c)\n"
    "add_library(NAME_.::NAME_. ALIAS NAME_.)\n"
    "set_target_properties(NAME_. PROPERTIES C_STANDARD 99 POSITION_INDEPENDENT_CODE ON PUBLIC_HEADER "
    "NAME_.h)\n"
    "target_include_directories(NAME_. PUBLIC $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}>\n"
    "  $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)\n"
    "target_link_libraries(NAME_. PUBLIC -lm)\n"
    "\n"
    "set(config ${CMAKE_INSTALL_LIBDIR}/cmake/NAME_.)\n"
    "install(TARGETS NAME_. EXPORT NAME_.Config PUBLIC_HEADER DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})\n"
    "install(EXPORT NAME_.Config NAMESPACE NAME_.:: DESTINATION ${config})\n"
    "write_basic_package_version_file(NAME_.ConfigVersion.cmake COMPATIBILITY SameMajorVersion)\n"
    "install(FILES ${CMAKE_CURRENT_BINARY_DIR}/NAME_.ConfigVersion.cmake DESTINATION ${config})\n"
    "install(FILES package.xml DESTINATION ${CMAKE_INSTALL_DATADIR}/NAME_.)\n"
    "\n"
    "enable_testing()\n"
    "add_executable(NAME_test NAME_test.c)\n"
    "target_link_libraries(NAME_test NAME_.)\n"
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

/* "NAME_." is the name alone, "NAME_.c" the name with .c, "NAME_x" the name with _x. */
static void add_named(text *to, const char *name, const char *s) {
    for (; *s != '\0'; s++) {
        const bool here = strncmp(s, "NAME_", 5) == 0;
        if (!here) lg_text_append(to, s, 1);
        if (!here) continue;
        lg_text_add(to, "%s", name);
        const bool dot = s[5] == '.',
                   ending = dot && (s[6] == 'c' || s[6] == 'h') && !isalpha((unsigned char)s[7]);
        if (!dot) lg_text_add(to, "_");
        s += dot && !ending ? 5 : 4;
    }
}

/* Names of ROS packages have small letters. */
static void add_package(export_source *source) {
    const char *name = source->options->name;
    char *small = app_format("%s", name);
    for (char *s = small; *s != '\0'; s++) *s = (char)tolower((unsigned char)*s);
    add_named(export_add_file(source, "CMakeLists.txt"), name, cmake);
    lg_text_add(export_add_file(source, "package.xml"), manifest, small, lg_version());
    free(small);
}

const export_target export_target_package = {.add = add_package};
