/* Many spherical pendulums from random starts to t = 10: the library's ensembles on lanes, and SUNDIALS in a
 * loop. Each command writes doubles to FILE.
 *
 *     ensemble_peers starts N FILE                          the starts of members 0..N-1: (N, 6)
 *     ensemble_peers reference N FILE                       their ends by rkmk54 at 1e-13, one at a time
 *     ensemble_peers ours METHOD TOL N THREADS SAMPLE FILE  the ends of the first SAMPLE members
 *     ensemble_peers cvode|erk5|erk8 TOL N SAMPLE FILE      the same by SUNDIALS
 *
 * q is uniform on the sphere; omega is normal, projected to the tangent space; g = 9.81, L = 1. Relative and
 * absolute tolerance are equal. SUNDIALS has a single solver that is initialised again for each member,
 * serial vectors, and the field written out. All but the first print one JSON object: wall time and CPU time
 * in seconds, and steps per member.
 */
#define _GNU_SOURCE
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "liegrad/ensemble.h"

#if defined(HAVE_SUNDIALS)
#include <arkode/arkode_erkstep.h>
#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>
#endif

enum { DIM = 6 };
static const double t_end = 10.0, gravity = 9.81;

static void fail(const char *what) {
    (void)fprintf(stderr, "ensemble_peers: %s\n", what);
    exit(1);
}

static double *numbers(size_t count) {
    double *memory = calloc(count > 0 ? count : 1, sizeof(double));
    if (!memory) fail("out of memory");
    return memory;
}

static double clock_of(clockid_t id) {
    struct timespec t;
    (void)clock_gettime(id, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void save(const char *path, const double *values, size_t count) {
    FILE *file = fopen(path, "wb");
    if (!file || fwrite(values, sizeof(double), count, file) != count || fclose(file) != 0) fail(path);
}

static void report(double seconds, double cpu, double steps) {
    (void)printf("{\"seconds\": %.6g, \"cpu\": %.6g, \"steps\": %.6g}\n", seconds, cpu, steps);
}

static lg_status start_of(void *user, uint64_t member, double *y, double *parameters) {
    lg_rng rng;
    (void)user, (void)parameters;
    lg_rng_seed(&rng, 1, member);
    for (int c = 0; c < DIM; c++) y[c] = lg_rng_normal(&rng);
    const double size = sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2]);
    for (int c = 0; c < 3; c++) y[c] /= size;
    const double along = y[0] * y[3] + y[1] * y[4] + y[2] * y[5];
    for (int c = 0; c < 3; c++) y[3 + c] -= along * y[c];
    return LG_OK;
}

/* ---- the library ---- */

typedef struct kept {
    uint64_t sample;
    double *end; /* (sample, DIM) */
} kept;

static lg_status keep(void *user, const lg_ensemble_block *block) {
    kept *to = user;
    for (size_t m = 0; m < block->members; m++) {
        if (block->member[m].status != LG_OK) return block->member[m].status;
        for (size_t c = 0; c < DIM && block->first + m < to->sample; c++)
            to->end[(block->first + m) * DIM + c] = block->states[c * block->room + m];
    }
    return LG_OK;
}

static void run_ours(const char *method, double tolerance, uint64_t members, int threads, uint64_t sample,
                     bool one_by_one, const char *path) {
    const lg_named_values values = {"gravity", &gravity, 1};
    lg_system_options options;
    lg_ensemble_options o;
    lg_ensemble_stats stats;
    lg_system *system;
    lg_error error = {LG_OK, ""};
    kept to = {sample, numbers(sample * DIM)};
    lg_system_options_init(&options);
    options.parameters = &values;
    options.parameter_count = 1;
    if (lg_system_create(NULL, "pendulum-chain", &options, &system, &error) != LG_OK) fail(error.message);
    lg_ensemble_options_init(&o);
    o.members = members;
    o.threads = threads;
    o.scheme = lg_scheme_find(method);
    o.control.rtol = o.control.atol = tolerance;
    o.times = &t_end;
    o.count = 1;
    o.one_by_one = one_by_one;
    const double begin = clock_of(CLOCK_MONOTONIC), cpu = clock_of(CLOCK_PROCESS_CPUTIME_ID);
    if (lg_ensemble_run(NULL, system, &o, start_of, NULL, keep, &to, &stats, &error) != LG_OK)
        fail(error.message);
    report(clock_of(CLOCK_MONOTONIC) - begin, clock_of(CLOCK_PROCESS_CPUTIME_ID) - cpu,
           (double)(stats.steps + stats.rejected) / (double)members);
    save(path, to.end, sample * DIM);
    lg_system_destroy(system);
    free(to.end);
}

/* ---- SUNDIALS ---- */

#if defined(HAVE_SUNDIALS)
static int field(double t, N_Vector state, N_Vector rate, void *user) {
    const double *y = N_VGetArrayPointer(state);
    double *out = N_VGetArrayPointer(rate);
    (void)t, (void)user;
    out[0] = y[4] * y[2] - y[5] * y[1];
    out[1] = y[5] * y[0] - y[3] * y[2];
    out[2] = y[3] * y[1] - y[4] * y[0];
    out[3] = -gravity * y[1];
    out[4] = gravity * y[0];
    out[5] = 0.0;
    return 0;
}

typedef struct solver {
    SUNContext context;
    N_Vector y;
    void *memory;
    SUNNonlinearSolver nonlinear;
    bool adams;
} solver;

static void make_solver(solver *s, const char *name, double tolerance) {
    int status = 0;
    if (SUNContext_Create(NULL, &s->context) != 0) fail("SUNDIALS");
    s->y = N_VNew_Serial(DIM, s->context);
    s->adams = strcmp(name, "cvode") == 0;
    (void)start_of(NULL, 0, N_VGetArrayPointer(s->y), NULL);
    if (s->adams) {
        s->memory = CVodeCreate(CV_ADAMS, s->context);
        status |= CVodeInit(s->memory, field, 0.0, s->y);
        status |= CVodeSStolerances(s->memory, tolerance, tolerance);
        s->nonlinear = SUNNonlinSol_FixedPoint(s->y, 0, s->context);
        status |= CVodeSetNonlinearSolver(s->memory, s->nonlinear);
        status |= CVodeSetMaxNumSteps(s->memory, 1000000);
    } else {
        s->memory = ERKStepCreate(field, 0.0, s->y, s->context);
        status |= ERKStepSStolerances(s->memory, tolerance, tolerance);
        status |= ERKStepSetTableNum(s->memory, strcmp(name, "erk8") == 0 ? ARKODE_FEHLBERG_13_7_8
                                                                          : ARKODE_DORMAND_PRINCE_7_4_5);
        status |= ERKStepSetMaxNumSteps(s->memory, 1000000);
    }
    if (status != 0) fail("SUNDIALS: a solver could not be made");
}

static long run_member(solver *s, uint64_t member) {
    long steps = 0;
    double t = 0.0;
    int status;
    (void)start_of(NULL, member, N_VGetArrayPointer(s->y), NULL);
    if (s->adams) {
        status = CVodeReInit(s->memory, 0.0, s->y);
        if (status == 0) status = CVodeSetStopTime(s->memory, t_end);
        if (status == 0) status = CVode(s->memory, t_end, s->y, &t, CV_NORMAL);
        (void)CVodeGetNumSteps(s->memory, &steps);
    } else {
        status = ERKStepReInit(s->memory, field, 0.0, s->y);
        if (status == 0) status = ERKStepSetStopTime(s->memory, t_end);
        if (status == 0) status = ERKStepEvolve(s->memory, t_end, s->y, &t, ARK_NORMAL);
        (void)ERKStepGetNumSteps(s->memory, &steps);
    }
    if (status < 0) fail("SUNDIALS: a member failed");
    return steps;
}

static void run_sundials(const char *name, double tolerance, uint64_t members, uint64_t sample,
                         const char *path) {
    solver s = {.memory = NULL};
    double *end = numbers(sample * DIM), steps = 0.0;
    make_solver(&s, name, tolerance);
    const double begin = clock_of(CLOCK_MONOTONIC), cpu = clock_of(CLOCK_PROCESS_CPUTIME_ID);
    for (uint64_t m = 0; m < members; m++) {
        steps += (double)run_member(&s, m);
        if (m < sample) memcpy(end + m * DIM, N_VGetArrayPointer(s.y), DIM * sizeof(*end));
    }
    report(clock_of(CLOCK_MONOTONIC) - begin, clock_of(CLOCK_PROCESS_CPUTIME_ID) - cpu,
           steps / (double)members);
    save(path, end, sample * DIM);
}
#endif

int main(int argc, char **argv) {
    const char *what = argc > 1 ? argv[1] : "";
    if (strcmp(what, "starts") == 0 && argc == 4) {
        const uint64_t n = strtoull(argv[2], NULL, 10);
        double *y = numbers(n * DIM);
        for (uint64_t m = 0; m < n; m++) (void)start_of(NULL, m, y + m * DIM, NULL);
        save(argv[3], y, n * DIM);
    } else if (strcmp(what, "reference") == 0 && argc == 4) {
        const uint64_t n = strtoull(argv[2], NULL, 10);
        run_ours("rkmk54", 1e-13, n, 1, n, true, argv[3]);
    } else if (strcmp(what, "ours") == 0 && argc == 8) {
        run_ours(argv[2], atof(argv[3]), strtoull(argv[4], NULL, 10), atoi(argv[5]),
                 strtoull(argv[6], NULL, 10), false, argv[7]);
#if defined(HAVE_SUNDIALS)
    } else if (argc == 6) {
        run_sundials(what, atof(argv[2]), strtoull(argv[3], NULL, 10), strtoull(argv[4], NULL, 10), argv[5]);
#endif
    } else {
        fail("see the head of its source");
    }
    return 0;
}
