/* Writes the C of a model as a CMake package (find_package(NAME), target NAME::NAME). ROS 2 builds it too:
 * package.xml says that it is plain CMake. */
#include <ctype.h>

#include "lg-export/export.h"

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
    export_add_named(source, export_fragment_text("package.cmake"),
                     export_add_file(source, "CMakeLists.txt"));
    lg_text_add(export_add_file(source, "package.xml"), manifest, small, lg_version());
}

const export_target export_target_package = {.add = add_package};
