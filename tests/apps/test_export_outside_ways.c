/* The models of test_export_outside, each compiled by all compilers. ctest-labels: study */
#define EVERY_WAY
#include "../../examples/programs/programs.h"
#include "export_support.h"

#define EVERY_MODEL
#include "test_export_outside.c"
