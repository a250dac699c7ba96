/* The models of test_export_motion with every compiler and optimisation level. ctest-labels: study */
#define EVERY_WAY
#include "test_export_motion.c"
