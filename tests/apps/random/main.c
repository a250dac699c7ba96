/* Compares exports of random recordings with their programs:
 *
 *     random_exports [--seed N] [--count N] [--target NAME]
 *
 * One function of each of the recordings N, N + 1, ... (autodiff/random/recording.c) is exported by
 * lg-export for each target (default: all that are listed below), built with the exported Makefile by gcc
 * with checks of undefined behaviour, and called through the target's interface: values and derivatives must
 * be the program's, but for rounding (autodiff/random/rounding.c). FMUs also get random calls in right and
 * wrong order (calls.c). FMPy checks and simulates them, and onnxruntime runs ONNX files (peers.py), if the
 * python that LG_PYTHON names (default python3) has these packages. Programs that lg-export refuses are
 * counted by reason. If an export differs, the exit code is 1. */
#include <getopt.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "apps/random/exports.h"

enum { MOST_FOUND = 5 };
export_tally tallied;

static const target *const targets[] = {&target_c, &target_casadi, &target_fmu2, &target_fmu3, &target_onnx};

/* Each line of lg-export's standard error is a reason. */
static void add_warnings(const target *t, char *lines) {
    for (char *save = NULL, *line = strtok_r(lines, "\n", &save); line != NULL;
         line = strtok_r(NULL, "\n", &save))
        add_reason(t->name, line);
}

static bool run_one(const target *t, uint64_t number) {
    static recording r;
    static model m;
    finding f = {.refused = false};
    open_model(number, t->blocks, &r, &m);
    bool good = export_model(&m, t, &f);
    if (good) {
        tallied.exported++;
        good = t->check(&m, &f);
    }
    tallied.refused += f.refused;
    add_warnings(t, m.warnings);
    if (!good && !f.refused) {
        printf("%s, recording %" PRIu64 ", function %s: %s\n", t->name, number, m.function, f.sentence);
        print_recording(&r);
        printf("again: random_exports --seed %" PRIu64 " --count 1 --target %s\n", number, t->name);
    }
    close_model(&m);
    return good || f.refused;
}

static size_t run_target(const target *t, uint64_t seed, uint64_t count) {
    tallied = (export_tally){.exported = 0};
    for (uint64_t i = 0; i < count && tallied.different < MOST_FOUND; i++) {
        tallied.different += !run_one(t, seed + i);
        (void)fflush(stdout);
    }
    printf("%s: %" PRIu64 " recordings from seed %" PRIu64
           ", %zu exported, %zu refused; %zu functions compared, "
           "%zu without comparison, for their numbers are not finite or very large\n",
           t->name, count, seed, tallied.exported, tallied.refused, tallied.functions - tallied.unfit,
           tallied.unfit);
    if (tallied.calls > 0)
        printf("%s: %zu calls, %zu of them wrong and refused, %zu states put back\n", t->name, tallied.calls,
               tallied.illegal, tallied.states);
    if (tallied.peers > 0) printf("%s: %zu given to a tool\n", t->name, tallied.peers);
    printf("%s: %zu differ\n", t->name, tallied.different);
    return tallied.different;
}

int main(int argc, char **argv) {
    static const struct option options[] = {
        {"seed", 1, NULL, 's'}, {"count", 1, NULL, 'n'}, {"target", 1, NULL, 't'}, {NULL, 0, NULL, 0}};
    uint64_t seed = 0, count = 0;
    const char *only = NULL;
    size_t different = 0, ran = 0;
    for (int c; (c = getopt_long(argc, argv, "", options, NULL)) != -1;) {
        if (c == 's') seed = strtoull(optarg, NULL, 10);
        if (c == 'n') count = strtoull(optarg, NULL, 10);
        if (c == 't') only = optarg;
        if (c == '?') return 2;
    }
    tell_crashes(argv);
    find_pieces();
    for (size_t t = 0; t < LG_COUNT(targets); t++) {
        if (only != NULL && strcmp(only, targets[t]->name) != 0) continue;
        different += run_target(targets[t], seed, count);
        ran++;
    }
    print_reasons();
    return ran > 0 && different == 0 ? 0 : 1;
}
