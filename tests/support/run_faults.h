/* The tests as a table of what allocates and of what uses files: every test runs once for every call of the
 * class that the library makes in it (support/faults.h), and that call fails, alone or with all later ones.
 *
 *     tests_ROOM --faults memory|files[:fail|short|interrupt][:SECONDS] SUITE [CLAIM]
 *
 * Where a statement such as assert_ok sees LG_OUT_OF_MEMORY, it makes the call again with enough memory. So a
 * test passes if the failed call returned a status and left its arguments as they were, and nothing leaked:
 * then all blocks are free in the end. Each run is a process of its own. Verdicts:
 *
 *     passed   with the results of an undisturbed run
 *     refused  an assertion failed after a status told of memory or of a file
 *     silent   an assertion failed, and no status had told why: a defect, or a test whose own statements look
 *              at no status
 *     leaked   passed, but blocks are left
 *     died     by a signal or a sanitizer; or ran for over a minute
 *
 * The runs of a test take about SECONDS (default 10). Where that is not enough for all calls, those are
 * chosen whose stacks differ in their innermost frames, and others at equal distances. The exit code is 1 if
 * a run leaked or died. */
#ifndef LG_RUN_FAULTS_H
#define LG_RUN_FAULTS_H

#include "test_support.h"

/* Takes "--faults WHAT" off the arguments: the number of words taken. */
int run_faults_options(int *argc, char **argv);
bool run_faults_wanted(void);
int run_faults(lg_suite *suite, const char *claim);

/* Called before and after the body of every test. */
void run_faults_begin(void);
void run_faults_end(bool passed);

#endif
