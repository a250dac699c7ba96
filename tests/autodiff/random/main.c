/* Compares random recordings on a tape with plans and compiled C:
 *
 *     random_programs [--seed N] [--count N] [--compiled N] [--checked]
 *
 * Recordings N, N + 1, ... are functions of random operations of the whole table, with shared and equal
 * operands, calls, loops and derivatives (recording.c). `count` of them are compared as plans with the tape's
 * results (rounding.c): in both types, with all options, and also after the program was stored and read again
 * (plans.c). `compiled` of them are compared as C, 100 recordings per file (compiled.c); with --checked,
 * undefined behaviour of the C ends the program. If a recording differs, the exit code is 1; the recording is
 * shrunk and printed, and --seed with its number repeats it. */
#include <getopt.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "autodiff/ops/op_table.h"
#include "autodiff/program/plan.h"
#include "autodiff/random/random.h"

enum { A_FILE = 100, MOST_FOUND = 5, ENOUGH = 2000 };

/* ---- recordings that differ ---- */

static bool passes(bool compiled, const recording *r, finding *out) {
    size_t at, one = 1;
    return compiled ? check_compiled(r, &one, out, &at) : check_plans(r, out);
}

static bool fails(void *user, const recording *r) {
    const bool *compiled = user;
    finding f;
    return !passes(*compiled, r, &f) && !f.refused;
}

static void tell(const recording *of, bool compiled, const finding *f) {
    recording r = *of;
    finding small = *f;
    printf("recording %" PRIu64 ": %s\n", r.number, f->sentence);
    if (!f->refused) shrink(&r, fails, &compiled);
    if (!passes(compiled, &r, &small)) printf("shrunk: %s\n", small.sentence);
    print_recording(&r);
    printf("again: random_programs --seed %" PRIu64 " --%s 1\n", r.number, compiled ? "compiled" : "count");
    (void)fflush(stdout);
}

/* ---- running all recordings ---- */

static size_t run_plans(uint64_t seed, uint64_t count) {
    size_t different = 0;
    static recording r;
    finding f;
    for (uint64_t i = 0; i < count && different < MOST_FOUND; i++) {
        looked_at = seed + i;
        draw_recording(seed + i, &r);
        if (check_plans(&r, &f)) continue;
        tell(&r, false, &f);
        different++;
    }
    return different;
}

static size_t run_compiled(uint64_t seed, uint64_t count) {
    static recording r[A_FILE];
    size_t different = 0, at = 0, some;
    finding f;
    for (uint64_t i = 0; i < count && different < MOST_FOUND; i += some) {
        const uint64_t rest = A_FILE - (seed + i) % A_FILE; /* files begin at multiples of 100 */
        some = (size_t)(count - i < rest ? count - i : rest);
        looked_at = seed + i;
        for (size_t k = 0; k < some; k++) draw_recording(seed + i + k, &r[k]);
        if (check_compiled(r, &some, &f, &at)) continue;
        tell(&r[at], true, &f);
        different++;
    }
    return different;
}

/* With enough recordings, every operation that a program can have must have been recorded. */
static bool all_rows_recorded(void) {
    bool all = true;
    size_t rows = 0;
    for (uint32_t i = 0; lg_ops[i] != NULL; i++) {
        const bool can = lg_ops[i]->forward != NULL && lg_ops[i]->payload != LG_PAYLOAD_IN_PROCESS;
        rows += can && operations_recorded[i] > 0;
        if (!can || operations_recorded[i] > 0 || counted.recordings < ENOUGH) continue;
        printf("operation %s was never recorded\n", lg_ops[i]->name);
        all = false;
    }
    printf("%zu of %zu operations recorded; steps of plans: %zu tensors, %zu layers, %zu of scalar code, %zu "
           "copies, %zu "
           "loops\n",
           rows, rows_with_pieces(), counted.steps[LG_STEP_TENSOR], counted.steps[LG_STEP_DENSE],
           counted.steps[LG_STEP_SCALARS], counted.steps[LG_STEP_COPY], counted.steps[LG_STEP_CALL]);
    return all;
}

int main(int argc, char **argv) {
    static const struct option options[] = {{"seed", 1, NULL, 's'},
                                            {"count", 1, NULL, 'n'},
                                            {"compiled", 1, NULL, 'c'},
                                            {"checked", 0, NULL, 'u'},
                                            {NULL, 0, NULL, 0}};
    uint64_t seed = 0, count = 0, compiled = 0;
    for (int c; (c = getopt_long(argc, argv, "", options, NULL)) != -1;) {
        if (c == 's') seed = strtoull(optarg, NULL, 10);
        if (c == 'n') count = strtoull(optarg, NULL, 10);
        if (c == 'c') compiled = strtoull(optarg, NULL, 10);
        if (c == 'u') compiled_checked = true;
        if (c == '?') return 2;
    }
    tell_crashes(compiled_checked ? argv : NULL);
    find_pieces();
    const size_t different = run_plans(seed, count) + run_compiled(seed, compiled);
    printf(
        "%zu recordings from seed %" PRIu64 ": %zu functions, of these %zu derivatives and %zu loops; %zu "
        "plans, %zu files of C; %zu functions without comparison, for their numbers are not finite or very "
        "large; %zu recordings without C, for their constants are not finite\n",
        counted.recordings, seed, counted.functions, counted.derivatives, counted.loops, counted.plans,
        counted.sources, counted.unfit, counted.refused);
    printf("%zu operations are packed in %zu bytes\n", counted.operations, counted.bytes);
    printf("%zu functions as plans of repeated recordings\n", counted.repeated);
    const bool all = all_rows_recorded();
    printf("%zu differ\n", different);
    return different == 0 && all ? 0 : 1;
}
