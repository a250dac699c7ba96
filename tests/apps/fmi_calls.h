/* Calls of the functions of an FMU (fuzz/fmu_model.h): TRY makes a call without an instance, and in every
 * mode of both kinds of instance with each set of its pointers missing. A suite includes the model before,
 * and defines OK, ERROR and log_call, the logger of its instances. */
#ifndef LG_FMI_CALLS_H
#define LG_FMI_CALLS_H

#include "test_support.h"

/* Modes and their letters: new, initialization, event, continuous, step, terminated. */
static const uint64_t modes[] = {INSTANTIATED, INITIALIZATION, EVENT, CONTINUOUS, STEP, TERMINATED};
static const char letters[] = "NIECST";

/* The call has to return `good` in the modes of these letters, if no pointer of the bits `needed` is missing;
 * else `bad`. */
typedef struct expected {
    const char *exchanged, *stepped;
    unsigned pointers, needed;
    int good, bad;
} expected;

/* Run `number` of a call. */
typedef struct fmi_run {
    size_t number;
    instance *c; /* NULL in run 0 */
    size_t mode;
    unsigned missing; /* bit k: pointer k is NULL */
    int status;
} fmi_run;

static size_t messages; /* what the instance has told */

static void check_run(const char *call, const expected *e, const fmi_run *run) {
    const char *allowed = run->c == NULL ? "" : run->c->exchange ? e->exchanged : e->stepped;
    const bool good = strchr(allowed, letters[run->mode]) != NULL && (run->missing & e->needed) == 0;
    if (run->status != (good ? e->good : e->bad) || (run->status == OK && messages > 0))
        fail_msg("%s: run %zu, mode %c, missing %u: status %d, %zu messages", call, run->number,
                 letters[run->mode], run->missing, run->status, messages);
}

/* Checks the last run and prepares the next one. Returns false after the last one. */
static bool next_run(const char *call, const expected *e, fmi_run *run) {
    const size_t sets = (size_t)1 << e->pointers, kinds = 2, most = sets * kinds * LG_COUNT(modes);
    if (run->number > 0) check_run(call, e, run);
    free(run->c);
    messages = 0;
    if (run->number++ == 0) return true;
    for (; run->number - 2 < most; run->number++) {
        const size_t n = run->number - 2;
        const int exchange = n / sets % kinds == 0;
        run->missing = (unsigned)(n % sets);
        run->mode = n / sets / kinds;
        if (strchr(exchange ? "NIECT" : "NIST", letters[run->mode]) == NULL) continue;
        run->c = create(exchange, NULL, log_call);
        assert_non_null(run->c);
        run->c->m.mode = modes[run->mode];
        return true;
    }
    return false;
}

#define TRY(text, call, ...)                                                                                 \
    for (fmi_run run_ = {0}; next_run(text, &(expected){__VA_ARGS__}, &run_);) {                             \
        void *const c = run_.c;                                                                              \
        (void)c;                                                                                             \
        run_.status = (int)(call);                                                                           \
    }

/* Sets of modes, of model exchange and of co-simulation. */
#define ALL            "NIECT", "NIST"
#define NEW            "N", "N"
#define INITIALIZING   "I", "I"
#define RUNS           "EC", "S"
#define SETTING        "NIEC", "NIS"
#define READING        "IECT", "IST"
#define EXCHANGE       "IECT", ""
#define NEW_OR_CHANGED "NIECT", ""
#define AT_EVENT       "E", ""
#define MOVING         "C", ""
#define MOVES          "EC", ""
#define STEPPING       "", "S"
/* Calls that are allowed in a set of modes, that are always refused, and that have one answer. */
#define ALLOWED(modes, pointers, needed, call) TRY(#call, call, modes, pointers, needed, OK, ERROR)
#define REFUSED(call)                          TRY(#call, call, "", "", 0, 0, OK, ERROR)
#define ANSWERED(answer, call)                 TRY(#call, call, ALL, 0, 0, answer, answer)

/* Pointer k of the call, which may be missing. */
#define P(k, pointer) ((run_.missing >> (k)&1) != 0 ? NULL : (pointer))

#endif
