/* Exports the observer and the adaptation of a controller: their descriptions, and reference runs for the
 * self-test. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "lg-export/policy/policy.h"

enum { OBSERVE_STREAM = 13, ADAPT_STREAM = 14, MOST = LG_POLICY_COORDINATES, PERIODS = 200 };

/* ---- runs of the library ---- */

/* A run of the library has states, positions and velocities as the controller sees them (periods + 1, 2
 * given), and inputs (periods, inputs). */
typedef struct run_of {
    double *state, *seen, *held;
    size_t periods; /* at least 1 */
    lg_rng rng;     /* goes on behind the start */
} run_of;

/* Returns positions and velocities (rows, 2 given), as the controller sees them, of these states. */
static double *see(const export_policy_job *j, const double *state, size_t rows) {
    double *seen = app_keep(rows * 2 * j->given, sizeof *seen);
    EXPORT_MUST(j, lg_program_eval(j->self->context, j->program, "sensed_by_control", rows,
                                   (const double *const[]){state}, (double *const[]){seen}, &error));
    return seen;
}

/* The run ends when a state has a norm of 1e6 or more, or is not finite. */
static run_of run_library(const export_policy_job *j, uint64_t stream) {
    const size_t n = j->state, steps = lg_policy_steps(j->policy), most = steps < PERIODS ? steps : PERIODS;
    bool succeeded;
    APP_FREE double *x = app_alloc(n, sizeof *x);
    run_of out = {.state = app_keep((most + 1) * n, sizeof *out.state),
                  .held = app_keep(most * j->inputs, sizeof *out.held)};
    lg_policy_runs runs = {
        .count = 1, .steps = most, .x = x, .succeeded = &succeeded, .motion = out.state, .input = out.held};
    lg_rng_seed(&out.rng, j->source->options->seed, stream);
    EXPORT_MUST(j, lg_policy_starts(j->policy, &out.rng, 1, x, NULL, &error));
    EXPORT_MUST(j, lg_policy_run(j->policy, &(lg_policy_trial){.theta = j->policy->theta, .threads = 1},
                                 &runs, &error));
    while (out.periods < most && export_norm(out.state + (out.periods + 1) * n, NULL, n) < 1e6) out.periods++;
    if (out.periods == 0) out.periods = 1;
    out.seen = see(j, out.state, out.periods + 1);
    return out;
}

static void round_all(const export_policy_job *j, double *x, size_t count) {
    for (size_t i = 0; i < count; i++) x[i] = export_round(j->source->options, x[i]);
}

/* ---- what both functions need ---- */

/* Refuses a plant whose state is more than lines, angles, and one momentum for each. */
static void check_simple(const export_policy_job *j, const char *function) {
    for (uint32_t i = 0; i < j->task->coordinate_count; i++) {
        const lg_policy_coordinate *c = &j->task->coordinate[i];
        if (c->motion > LG_POLICY_ANGLE)
            app_stop_usage(j->self,
                           "--functions %s: '%s' is a %s; this is for plants of lines and angles only",
                           function, c->name, lg_policy_motion_row_of(c->motion)->name);
    }
    if (j->velocities == j->given && j->state == 2 * j->given) return;
    app_stop_usage(j->self,
                   "--functions %s: the plant's state must be positions and one momentum for each position, "
                   "without lags of inputs",
                   function);
}

static double tiny_of(const export_policy_job *j) {
    return j->source->options->dtype == LG_F32 ? (double)FLT_MIN : DBL_MIN;
}

/* Adds the run of a function whose memory has `numbers` numbers, with rows of `width` inputs, and its
 * declarations, <function>.cin below code/policy. The caller fills the run. */
static export_memory *keep(export_policy_job *j, const char *function, size_t numbers, size_t rows,
                           size_t width) {
    export_source *source = j->source;
    APP_FREE char *declarations = app_format("%s.cin", function);
    export_memory *run = &source->run[source->runs++];
    *run = (export_memory){.function = function,
                           .inputs = app_keep(rows * width, sizeof *run->inputs),
                           .start = app_keep(numbers, sizeof *run->start),
                           .rows = rows,
                           .numbers = numbers,
                           .work = numbers};
    lg_text_add_named(&j->declarations, source->options->name, export_fragment_text(declarations));
    source->stack += 200;
    source->calls++;
    return run;
}

/* Adds the memory at the start as the array <function>_first, the function's fragment, and the memory's
 * size. */
static void start(const export_policy_job *j, const export_memory *run, const char *size, const char *what) {
    APP_FREE char *name = app_format("%s_first", run->function);
    export_reals(j->source, &j->source->further_code, name, run->start, run->numbers);
    lg_text_add_named(&j->source->further_code, j->source->options->name,
                      export_fragment_text(run->function));
    export_size(j->source, size, run->numbers, what);
}

/* ---- the observer ---- */

/* Returns number i of an option that has one number for all, or one for each. */
static double number_of(const lg_reals *option, size_t i, double otherwise) {
    return option->count == 0 ? otherwise : option->values[option->count == 1 ? 0 : i];
}

static lg_policy_filter filter_of(const export_policy_job *j) {
    const export_options *options = j->source->options;
    const lg_reals *const given[] = {&options->sensor, &options->drift};
    for (size_t i = 0; i < LG_COUNT(given); i++)
        if (given[i]->count > 1 && given[i]->count != j->given)
            app_stop_usage(j->self, "--noise and --drift take one number, or %zu: one for each position",
                           j->given);
    lg_policy_filter f = {.policy = j->policy, .tiny = tiny_of(j)};
    for (uint32_t i = 0; i < j->given; i++) {
        f.sensor[i] = export_round(options, number_of(&options->sensor, i, 1e-3));
        f.drift[i] = export_round(options, number_of(&options->drift, i, 0.1) * sqrt(j->task->period));
    }
    return f;
}

static void tell_observer(const export_policy_job *j, const lg_policy_filter *f) {
    text *about = &j->source->about;
    lg_text_add(about,
                "observer      NAME_observe estimates positions and velocities from noisy positions: an "
                "extended Kalman filter for noise of standard deviation");
    for (size_t i = 0; i < j->given; i++) lg_text_add(about, " %g", f->sensor[i]);
    lg_text_add(about, " (--noise) and velocities that stray from the machine's, in a second, by");
    for (size_t i = 0; i < j->given; i++) lg_text_add(about, " %g", f->drift[i] / sqrt(j->task->period));
    lg_text_add(about, " (--drift)\n");
}

/* The reference run has positions of a run of the library, with noise. The memory begins with the first. */
void export_policy_observe(export_policy_job *j) {
    const size_t n = j->given, all = 2 * n, m = j->inputs;
    check_simple(j, "observe");
    const lg_policy_filter f = filter_of(j);
    EXPORT_MUST(j, lg_policy_add_observer(&f, &error));
    run_of path = run_library(j, OBSERVE_STREAM);
    export_memory *run = keep(j, "observe", all * (all + 1), path.periods, all + m);
    run->work += all;
    for (size_t k = 0; k <= path.periods; k++)
        for (size_t i = 0; i < n; i++) path.seen[k * all + i] += f.sensor[i] * lg_rng_normal(&path.rng);
    for (size_t k = 0; k < path.periods; k++) {
        double *row = run->inputs + k * (all + m);
        for (size_t i = 0; i < all; i++) row[i] = i < n ? path.seen[(k + 1) * all + i] : 1;
        memcpy(row + all, path.held + k * m, m * sizeof *row);
    }
    round_all(j, run->inputs, run->rows * (all + m));
    for (size_t i = 0; i < n; i++) {
        const double *v = j->task->coordinate[i].start_velocity, first = fmax(fabs(v[0]), fabs(v[1]));
        run->start[all + i * (all + 1)] = f.sensor[i];
        run->start[all + (n + i) * (all + 1)] = export_round(j->source->options, first > 0 ? first : 1);
    }
    start(j, run, "OBSERVE_SIZE", "numbers of memory of the observer");
    for (size_t i = 0; i < n; i++) run->start[i] = export_round(j->source->options, path.seen[i]);
    tell_observer(j, &f);
}

/* ---- the adaptation ---- */

static void tell_adaptation(const export_policy_job *j, const lg_policy_adaptation *a) {
    text *about = &j->source->about;
    lg_text_add(about,
                "adaptation    NAME_adapt finds, by recursive least squares that forget in %g s (--forget):",
                j->source->options->forget);
    for (size_t i = 0; i < j->velocities; i++) {
        const double *r = a->range[i];
        lg_text_add(
            about,
            " of %s damping 0 to %.3g, Coulomb friction 0 to %.3g, offset -%.3g to %.3g, inertia %.3g "
            "to %.3g;",
            j->task->coordinate[i].velocity, r[0], r[1], r[2], r[2], lg_policy_adapt_lowest[3] * r[3], r[3]);
    }
    lg_text_add(about, " a payload whose inertia depends on other coordinates is outside this form\n");
}

/* Returns positions and velocities after each period, as the controller sees them, of a changed plant: 0.3 of
 * the largest offset and damping act in addition, as an impulse at the end of each period. */
static double *see_changed(const export_policy_job *j, const lg_policy_adaptation *a, const run_of *path) {
    const size_t n = j->given, count = path->periods * 2 * n;
    APP_FREE double *x = app_alloc(count, sizeof *x);
    memcpy(x, path->state + 2 * n, count * sizeof *x);
    for (size_t k = 0; k < count; k += 2 * n)
        for (size_t i = 0; i < n; i++) {
            const double *range = a->range[i];
            x[k + n + i] += 0.3 * j->task->period * (range[2] - range[0] * path->seen[k + n + i]);
        }
    return see(j, x, path->periods);
}

void export_policy_adapt(export_policy_job *j) {
    const size_t n = j->given, m = j->inputs, width = 4 * n + m;
    lg_policy_adaptation a = {.policy = j->policy, .tiny = tiny_of(j)};
    check_simple(j, "adapt");
    a.keep = export_round(j->source->options, exp(-j->task->period / j->source->options->forget));
    const run_of path = run_library(j, ADAPT_STREAM);
    lg_policy_find_ranges(&a, path.state, path.seen, path.periods);
    round_all(j, a.scale, n), round_all(j, a.speed, n), round_all(j, a.range[0], LG_POLICY_FOUND * n);
    EXPORT_MUST(j, lg_policy_add_adaptation(&a, &error));
    export_memory *run = keep(j, "adapt", LG_POLICY_ADAPT * n, path.periods, width);
    const double *next = see_changed(j, &a, &path);
    for (size_t k = 0; k < path.periods; k++) {
        double *row = run->inputs + k * width;
        memcpy(row, path.seen + k * 2 * n, 2 * n * sizeof *row);
        memcpy(row + 2 * n, path.held + k * m, m * sizeof *row);
        memcpy(row + 2 * n + m, next + k * 2 * n, 2 * n * sizeof *row);
    }
    round_all(j, run->inputs, run->rows * width);
    for (size_t i = 0; i < run->numbers; i++)
        run->start[i] =
            i % LG_POLICY_ADAPT >= LG_POLICY_FOUND && (i % LG_POLICY_ADAPT - LG_POLICY_FOUND) % 5 == 0;
    export_reals(j->source, &j->source->further_code, "adapt_range", a.range[0], LG_POLICY_FOUND * n);
    start(j, run, "ADAPT_SIZE", "numbers of memory of the adaptation");
    export_size(j->source, "FOUND", LG_POLICY_FOUND * n, "numbers that the adaptation finds");
    tell_adaptation(j, &a);
}
