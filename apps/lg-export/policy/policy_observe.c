/* The observer of a controller: observe (seen, u, memory) -> kept as a function of the program, an
 * extended Kalman filter. The estimate (positions, then velocities) has the covariance L L^T; the memory
 * holds the estimate, then the rows of L. `seen` holds the positions, then a 1 for each position that was
 * measured and a 0 for each that was not. */
#include <math.h>
#include <string.h>

#include "lg-export/policy/policy.h"
#include "liegrad/ops.h"

enum { OBSERVE_STREAM = 13, MOST = LG_POLICY_COORDINATES };

typedef struct filter {
    const export_policy_job *job;
    uint32_t observed, estimate;
    double sensor[MOST], drift[MOST], first[MOST]; /* Of velocities: in a period; at the start. */
} filter;

/* ---- functions of the program ---- */

/* The next positions and velocities from positions, velocities (x) and u. */
static lg_status record_step(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const lg_var state = export_policy_state(tape, user, in[0]);
    const lg_var next = lg_program_call(tape, "period", 0, (const lg_var[]){state, in[1]});
    out[0] = lg_program_call(tape, "sensed_by_control", 0, &next);
    return lg_tape_status(tape);
}

/* Makes the rows of (estimate, columns) lower triangular by reflections from the right, which keep a a^T. The
 * rows have as many columns as there are rows then. */
static void make_triangular(const filter *f, lg_tape *tape, uint32_t columns, lg_var *row) {
    const uint32_t n = f->estimate;
    APP_FREE lg_var *low = app_alloc((size_t)n * n, sizeof *low);
    for (uint32_t i = 0; i < n; i++) {
        const lg_var square = lg_rownorm2(tape, row[i]), first = lg_slice(tape, row[i], 1, 0, 1),
                     end = lg_neg(tape, lg_mul(tape, lg_sqrt(tape, square), lg_sign(tape, first))),
                     /* Half of the square of the reflection's vector. */
            by = export_policy_inverse(tape, f->job, lg_sub(tape, square, lg_mul(tape, end, first))),
                     vector = lg_sub(tape, row[i], lg_pad(tape, end, 1, 0, columns - i - 1));
        low[i * n + i] = end;
        for (uint32_t j = i + 1; j < n; j++) {
            const lg_var part = lg_mul(tape, lg_rowdot(tape, row[j], vector), by);
            row[j] = lg_sub(tape, row[j], lg_mul(tape, vector, part));
            low[j * n + i] = lg_slice(tape, row[j], 1, 0, 1);
            row[j] = lg_slice(tape, row[j], 1, 1, columns - i - 1);
        }
    }
    for (uint32_t i = 0; i < n; i++)
        row[i] = lg_pad(tape, lg_concat(tape, low + i * n, i + 1, 1), 1, 0, n - i - 1);
}

/* Corrects the estimate x by the measurement of position i (Potter's square root update). */
static lg_var correct(const filter *f, lg_tape *tape, uint32_t i, lg_var seen, lg_var x, lg_var *row) {
    const lg_var square = lg_add_scalar(tape, lg_rownorm2(tape, row[i]), f->sensor[i] * f->sensor[i]),
                 size = lg_sqrt(tape, square), own = row[i],
                 part = lg_div(tape, size, lg_add_scalar(tape, size, f->sensor[i])),
                 on = lg_slice(tape, seen, 1, f->observed + i, 1);
    lg_var gains[2 * MOST], away = lg_sub(tape, lg_slice(tape, seen, 1, i, 1), lg_slice(tape, x, 1, i, 1));
    if (f->job->task->coordinate[i].motion == LG_POLICY_ANGLE)
        away = lg_atan2(tape, lg_sin(tape, away), lg_cos(tape, away));
    for (uint32_t j = 0; j < f->estimate; j++) gains[j] = lg_rowdot(tape, row[j], own);
    const lg_var gain = lg_mul(tape, lg_concat(tape, gains, f->estimate, 1), lg_div(tape, on, square));
    for (uint32_t j = 0; j < f->estimate; j++)
        row[j] = lg_sub(tape, row[j], lg_mul(tape, own, lg_mul(tape, part, lg_slice(tape, gain, 1, j, 1))));
    return lg_add(tape, x, lg_mul(tape, gain, away));
}

static lg_status record_observe(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in,
                                lg_var *out) {
    const filter *f = user;
    const uint32_t n = f->observed, all = f->estimate, rows = lg_var_shape(tape, in[0]).dims[0];
    const lg_var at[2] = {lg_slice(tape, in[2], 1, 0, all), in[1]},
                 F = lg_program_call(tape, "jac_observe_step", 0, at),
                 L = lg_reshape(tape, lg_slice(tape, in[2], 1, all, all * all), lg_shape3(rows, all, all));
    lg_var x = lg_program_call(tape, "observe_step", 0, at), parts[1 + 2 * MOST], *row = parts + 1;
    for (uint32_t i = 0; i < all; i++) { /* F L, then the drift of the velocities */
        double drift[3 * MOST] = {0};
        const lg_var own = lg_reshape(tape, lg_slice(tape, F, 1, i, 1), lg_shape3(rows, all, 1));
        if (i >= n) drift[all + i - n] = f->drift[i - n];
        row[i] = lg_pad(tape, lg_sum_axis(tape, lg_mul(tape, own, L), 1, false), 1, 0, n);
        row[i] = lg_add(tape, row[i], lg_input_f64(tape, lg_shape2(1, all + n), drift));
    }
    make_triangular(f, tape, all + n, row);
    for (uint32_t i = 0; i < n; i++) x = correct(f, tape, i, in[0], x, row);
    parts[0] = x;
    out[0] = lg_concat(tape, parts, 1 + all, 1);
    return lg_tape_status(tape);
}

static void add_functions(const filter *f) {
    const export_policy_job *j = f->job;
    const lg_port *control = export_ports_of(j->program, "control").in,
                  *period = export_ports_of(j->program, "period").in;
    const lg_port in[] = {control[0], period[1]}, out = {.name = "kept"},
                  seen[] = {{.name = "seen", .shape = lg_shape1(2 * f->observed)},
                            period[1],
                            {.name = "memory", .shape = lg_shape1(f->estimate * (f->estimate + 1))}};
    const lg_function_spec step = {"observe_step",      in, 2, &(lg_port){.name = "next"}, 1, record_step,
                                   (void *)(uintptr_t)j},
                           observe = {"observe", seen, 3, &out, 1, record_observe, (void *)(uintptr_t)f};
    EXPORT_MUST(j, lg_program_add_function(j->program, &step, &error));
    (void)export_derive(j->self, j->program, LG_DERIVATIVE_JACOBIAN, "observe_step");
    EXPORT_MUST(j, lg_program_add_function(j->program, &observe, &error));
}

/* ---- the filter's numbers ---- */

/* Number i of an option with one number for all, or one each. */
static double number_of(const lg_reals *option, size_t i, double otherwise) {
    return option->count == 0 ? otherwise : option->values[option->count == 1 ? 0 : i];
}

static filter filter_of(const export_policy_job *j) {
    const export_options *options = j->source->options;
    const lg_reals *const given[] = {&options->sensor, &options->drift};
    for (size_t i = 0; i < LG_COUNT(given); i++)
        if (given[i]->count > 1 && given[i]->count != j->given)
            app_stop_usage(j->self, "--noise and --drift take one number, or %zu: one for each position",
                           j->given);
    filter f = {.job = j, .observed = (uint32_t)j->given, .estimate = 2 * (uint32_t)j->given};
    for (uint32_t i = 0; i < j->given; i++) {
        const lg_policy_coordinate *c = &j->task->coordinate[i];
        const double first = fmax(fabs(c->start_velocity[0]), fabs(c->start_velocity[1]));
        f.sensor[i] = export_round(options, number_of(&options->sensor, i, 1e-3));
        f.drift[i] = export_round(options, number_of(&options->drift, i, 0.1) * sqrt(j->task->period));
        f.first[i] = export_round(options, first > 0 ? first : 1);
    }
    return f;
}

/* ---- texts ---- */

static void add_words(const filter *f) {
    const export_policy_job *j = f->job;
    text *about = &j->source->about;
    lg_text_add(about,
                "observer      NAME_observe estimates positions and velocities from noisy positions: an "
                "extended Kalman filter for noise of standard deviation");
    for (size_t i = 0; i < j->given; i++) lg_text_add(about, " %g", f->sensor[i]);
    lg_text_add(about, " (--noise) and velocities that stray from the machine's, in a second, by");
    for (size_t i = 0; i < j->given; i++) lg_text_add(about, " %g", f->drift[i] / sqrt(j->task->period));
    lg_text_add(about, " (--drift)\n");
}

/* Measurements with noise along a run of the library. */
static void add_run(export_policy_job *j, const filter *f) {
    const size_t n = j->given, all = f->estimate, m = j->inputs;
    export_memory *run = export_policy_keep(j, "observe", all * (all + 1));
    export_path path = export_loop_run(j, OBSERVE_STREAM, f->sensor, NULL);
    run->rows = path.periods;
    run->work += 2 * n;
    run->inputs = app_keep(path.periods * (all + m), sizeof *run->inputs);
    for (size_t k = 0; k < path.periods; k++) {
        double *row = run->inputs + k * (all + m);
        for (size_t i = 0; i < all; i++) row[i] = i < n ? path.seen[(k + 1) * all + i] : 1;
        memcpy(row + all, path.held + k * m, m * sizeof *row);
    }
    for (size_t i = 0; i < all; i++) run->start[all + i * (all + 1)] = i < n ? f->sensor[i] : f->first[i - n];
    export_policy_start(j, run);
    export_size(j->source, "OBSERVE_SIZE", run->numbers, "numbers of memory of the observer");
    for (size_t i = 0; i < n; i++) run->start[i] = path.seen[i];
}

void export_policy_observe(export_policy_job *j) {
    export_policy_simple(j, "observe");
    const filter f = filter_of(j);
    add_functions(&f);
    add_run(j, &f);
    add_words(&f);
}
