/* The models of test_export_classes with every compiler and optimisation; stack. ctest-labels: study */
#define EVERY_WAY
#include "test_export_classes.c"
