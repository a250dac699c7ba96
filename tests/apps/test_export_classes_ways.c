/* The models of test_export_classes with every compiler and optimisation level; also their stack.
 * ctest-labels: study */
#define EVERY_WAY
#include "test_export_classes.c"
