/* The networks of test_export_curve: each kind with every architecture and activation, with and without an
 * embedding; one of each kind by every compiler at every optimisation level.
 * ctest-labels: study */
#define EVERY_WAY
#include "test_export_curve.c"
