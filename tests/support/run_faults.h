/* Runs every test many times: in run n, call n of a class (support/faults.h) that the library makes fails,
 * alone or with all later calls. So the tests are the list of functions that allocate or use files.
 *
 *     tests_ROOM --faults memory|files[:short|:interrupt]|hdf5[:SECONDS] SUITE [CLAIM]
 *
 * When assert_ok, assert_told or assert_status sees LG_OUT_OF_MEMORY, it makes the call again with enough
 * memory. So a test passes if the failed call returned the status and did not change its arguments. At the
 * end of the test, all blocks must be free and all identifiers of HDF5 closed. Each run is a separate
 * process. Verdicts:
 *
 *     passed    the test passed, and no block is left
 *     refused   an assertion failed after a status had said that memory or a file is the reason
 *               (hdf5: also LG_FORMAT or LG_NOT_FOUND)
 *     silent    an assertion failed, but no status had said why: a defect, or a test that does not check the
 *               status
 *     leaked    the test passed, but blocks or identifiers are left
 *     died      a signal or a sanitizer ended the run, or it took a minute more than 20 undisturbed runs
 *
 * All runs of a test take about SECONDS (default 10). If this is too short for all calls, only some calls
 * fail: first calls with different stacks, then calls at equal distances. If it is too short for all stacks,
 * the commit draws calls (support/seed.h), at least two. The exit code is 1 if a run leaked or died. */
#ifndef LG_RUN_FAULTS_H
#define LG_RUN_FAULTS_H

#include "test_support.h"

/* Removes "--faults WHAT" from the arguments. Returns the number of words removed. */
int run_faults_options(int *argc, char **argv);
bool run_faults_wanted(void);
int run_faults(lg_suite *suite, const char *claim);

/* Called before and after the body of every test. */
void run_faults_begin(void);
void run_faults_end(bool passed);

#endif
