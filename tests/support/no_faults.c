/* In place of run_faults.c and faults.c, for tests without HDF5 and libyaml (alone.cmake): no call fails. */
#include "support/faults.h"
#include "support/run_faults.h"

int run_faults_options(int *argc, char **argv) {
    (void)argc, (void)argv;
    return 0;
}

bool run_faults_wanted(void) {
    return false;
}

int run_faults(lg_suite *suite, const char *claim) {
    (void)suite, (void)claim;
    return 2;
}

void run_faults_begin(void) {
}

void run_faults_end(bool passed) {
    (void)passed;
}

void faults_spare(bool spared) {
    (void)spared;
}

bool lg_test_again(lg_status status) {
    (void)status;
    return false;
}

bool lg_test_faulty(void) {
    return false;
}
