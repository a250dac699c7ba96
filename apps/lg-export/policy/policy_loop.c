/* The closed loop of a controller: runs of the library, and the same runs in the self-test. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-export/policy/policy.h"
#include "liegrad/geometry.h"

enum { RUNS = 4, SEGMENTS = 16, MOST_SEGMENTS = 64, LOOP_STREAM = 12, PERIODS = 200 };

/* ---- runs of the library ---- */

/* The closed loop in the library: the plant and the policy, which sees positions and velocities. */
typedef struct export_loop {
    export_evaluation period, positions, velocities, policy, narrow;
    bool moves;
    double *seen;    /* Positions, velocities and weights: the inputs of `policy`. */
    double *x, *row; /* State and input: the inputs of `period`; and a row of results. */
    const export_policy_job *job;
} export_loop;

static lg_status open_function(const export_policy_job *j, const char *name, lg_dtype dtype,
                               export_evaluation *out, lg_error *error) {
    size_t at;
    LG_TRY(lg_program_find(j->program, name, &at, error));
    return export_evaluation_open(j->program, at, dtype, 0, out, error);
}

static lg_status open_loop(const export_policy_job *j, export_loop *l, lg_error *error) {
    const size_t seen = j->positions + j->velocities, n = lg_program_parameters(j->program);
    const size_t weights = lg_policy_parameters(j->policy);
    *l = (export_loop){.job = j, .moves = j->velocities > 0};
    l->seen = app_alloc(seen + weights, sizeof *l->seen);
    l->x = app_alloc(j->state + j->inputs, sizeof *l->x);
    l->row = app_alloc(j->state + j->inputs + seen, sizeof *l->row);
    if (weights > 0)
        memcpy(l->seen + seen, lg_program_parameter(j->program, n - 1).values, weights * sizeof *l->seen);
    LG_TRY(open_function(j, "period", LG_F64, &l->period, error));
    LG_TRY(open_function(j, "policy", LG_F64, &l->policy, error));
    LG_TRY(open_function(j, "policy", LG_F32, &l->narrow, error));
    if (l->moves) LG_TRY(open_function(j, "positions", LG_F64, &l->positions, error));
    return l->moves ? open_function(j, "velocities", LG_F64, &l->velocities, error) : LG_OK;
}

static void close_loop(export_loop *l) {
    export_evaluation *const all[] = {&l->period, &l->positions, &l->velocities, &l->policy, &l->narrow};
    for (size_t i = 0; i < LG_COUNT(all); i++) export_evaluation_close(all[i]);
    free(l->seen);
    free(l->x);
    free(l->row);
}

/* Moves the state x by one period; u (inputs; may be NULL) becomes the input. `single`: the policy computes
 * in single precision; the plant computes in double precision. */
static void step(export_loop *l, bool single, double *x, double *u) {
    const export_policy_job *j = l->job;
    if (l->moves) {
        export_evaluate(&l->positions, x, l->seen);
        export_evaluate(&l->velocities, x, l->seen + j->positions);
    } else {
        memcpy(l->seen, x, j->positions * sizeof *x);
    }
    memcpy(l->x, x, j->state * sizeof *x);
    export_evaluate(single ? &l->narrow : &l->policy, l->seen, l->x + j->state);
    if (u != NULL) memcpy(u, l->x + j->state, j->inputs * sizeof *u);
    export_evaluate(&l->period, l->x, l->row);
    memcpy(x, l->row, j->state * sizeof *x);
}

lg_status export_loop_run(const export_policy_job *j, uint64_t stream, const double *noise,
                          const double *more, export_path *out, lg_error *error) {
    const size_t n = j->given, steps = lg_policy_steps(j->policy),
                 periods = steps < PERIODS ? steps : PERIODS;
    const export_options *options = j->source->options;
    export_loop l;
    lg_rng rng;
    APP_FREE double *x = app_alloc(j->state, sizeof *x);
    *out = (export_path){app_alloc((periods + 1) * 2 * n, sizeof *out->seen),
                         app_alloc(periods * j->inputs, sizeof *out->held), periods};
    lg_rng_seed(&rng, options->seed, stream);
    lg_status status = open_loop(j, &l, error);
    if (status == LG_OK) status = lg_policy_starts(j->policy, &rng, 1, x, NULL, error);
    for (size_t k = 0; status == LG_OK && k <= out->periods; k++) {
        double u[LG_POLICY_INPUTS];
        step(&l, false, x, u);
        for (size_t i = 0; i < 2 * n; i++) {
            const double by = noise != NULL && i < n ? noise[i] * lg_rng_normal(&rng) : 0;
            out->seen[k * 2 * n + i] = export_round(options, l.seen[i] + by);
        }
        for (size_t i = 0; i < j->inputs && k < out->periods; i++)
            out->held[k * j->inputs + i] = export_round(options, u[i]);
        for (size_t i = 0; more != NULL && i < n; i++)
            x[n + i] += 0.3 * j->task->period * (more[i] - more[n + i] * l.seen[n + i]);
        if (!(export_norm(x, NULL, j->state) < 1e6) && k < out->periods) out->periods = k > 0 ? k : 1;
    }
    close_loop(&l);
    return status;
}

void export_path_destroy(export_path *path) {
    free(path->seen);
    free(path->held);
}

/* ---- golden paths ---- */

typedef struct golden {
    size_t steps, stride;   /* Periods of a run, and of a segment. */
    double *path;           /* (RUNS, steps + 1, state) */
    size_t finite[RUNS];    /* Periods of a run while its numbers are finite and not huge. */
    double mean, tolerance; /* Root mean square of |x| over all of path. */
} golden;

static size_t segments(const golden *g, size_t run) {
    const size_t count = g->finite[run] / g->stride;
    return count < MOST_SEGMENTS ? count : MOST_SEGMENTS;
}

static lg_status run_library(export_loop *l, golden *g, lg_error *error) {
    const size_t n = l->job->state;
    lg_rng rng;
    double sum = 0;
    size_t states = 0;
    lg_rng_seed(&rng, l->job->source->options->seed, LOOP_STREAM);
    for (size_t r = 0; r < RUNS; r++) {
        double *x = g->path + r * (g->steps + 1) * n;
        LG_TRY(lg_policy_starts(l->job->policy, &rng, 1, x, NULL, error));
        for (size_t k = 0; k <= g->steps; k++, x += n) {
            const double size = export_norm(x, NULL, n);
            if (!(size < 1e6)) break;
            sum += size * size;
            states++;
            g->finite[r] = k;
            if (k == g->steps) break;
            memcpy(x + n, x, n * sizeof *x);
            step(l, false, x + n, NULL);
        }
    }
    g->mean = states > 0 ? sqrt(sum / (double)states) : 0;
    return LG_OK;
}

/* The largest error at the end of a segment when the policy computes in single precision, over eps. */
static double sensitivity(export_loop *l, const golden *g) {
    const size_t n = l->job->state;
    double worst = 0, *x = app_alloc(n, sizeof *x);
    for (size_t r = 0; r < RUNS; r++)
        for (size_t s = 0; s < segments(g, r); s++) {
            const double *from = g->path + (r * (g->steps + 1) + s * g->stride) * n;
            memcpy(x, from, n * sizeof *x);
            for (size_t k = 0; k < g->stride; k++) step(l, true, x, NULL);
            const double error = export_norm(x, from + g->stride * n, n) / (g->mean > 0 ? g->mean : 1);
            if (!(error <= worst)) worst = error;
        }
    free(x);
    return worst / (double)FLT_EPSILON;
}

/* Chooses segments as long as rounding cannot fail the test and a wrong sign cannot pass it. */
static void choose_stride(export_loop *l, golden *g) {
    g->stride = (g->steps + SEGMENTS - 1) / SEGMENTS;
    if (g->stride == 0) g->stride = 1;
    for (;; g->stride = (g->stride + 1) / 2) {
        const double by = sensitivity(l, g);
        g->tolerance = 20 * export_eps(l->job->source->options) * (by > 16 ? by : 16);
        if (g->tolerance <= 1e-3 || g->stride == 1) return;
    }
}

/* Warns if the policy has no value where an angle, direction or rotation is half a turn from the goal. */
static void warn_opposite(export_loop *l) {
    const export_policy_job *j = l->job;
    const bool single = j->source->options->dtype == LG_F32;
    size_t at = 0;
    memset(l->seen, 0, (j->positions + j->velocities) * sizeof *l->seen);
    for (uint32_t i = 0; i < j->task->coordinate_count; i++) {
        const lg_policy_coordinate *c = &j->task->coordinate[i];
        static const double pi = 3.14159265358979323846, axis[3] = {3.14159265358979323846, 0, 0};
        double *q = l->seen + at;
        at += lg_policy_motion_row_of(c->motion)->position;
        if (c->motion == LG_POLICY_LINE) q[0] = c->goal[0];
        if (c->motion == LG_POLICY_ANGLE) q[0] = c->goal[0] + pi;
        for (int k = 0; k < 3 && c->motion == LG_POLICY_DIRECTION; k++) q[k] = -c->goal[k];
        if (c->motion == LG_POLICY_ROTATION) lg_so3_exp_multiply(axis, c->goal, q);
    }
    export_evaluate(single ? &l->narrow : &l->policy, l->seen, l->row);
    for (size_t i = 0; i < j->inputs; i++)
        if (!isfinite(l->row[i])) {
            app_warn(
                j->self,
                "the controller gives no number in %s precision half a turn from the goal%s: it must not be "
                "called there",
                single ? "single" : "double", single ? "; export it with --dtype f64" : "");
            return;
        }
}

/* ---- the self-test ---- */

/* The plant in double precision, as static functions that begin with NAME_plant_. */
static lg_status add_plant(const export_policy_job *j, text *to, lg_error *error) {
    static const char *const names[] = {"period", "positions", "velocities"};
    static const bool hidden[LG_COUNT(names)] = {true, true, true};
    size_t functions[LG_COUNT(names)];
    lg_c_options how;
    lg_c_source *c;
    lg_c_options_init(&how);
    APP_FREE char *name = app_format("%s_plant", j->source->options->name);
    how.name = name;
    how.functions = functions;
    how.function_count = j->velocities > 0 ? LG_COUNT(names) : 1;
    how.hidden = hidden;
    how.compact = true;
    for (size_t i = 0; i < how.function_count; i++)
        (void)lg_program_find(j->program, names[i], &functions[i], NULL);
    const lg_status status = lg_program_write_c(j->program, &how, &c, error);
    if (status == LG_OK) {
        lg_text_add(to, "/* ---- the plant, for the closed loop: always in double precision ---- */\n\n%s\n",
                    c->sizes);
        /* The code calls its type of numbers `real`, which is the controller's type here. */
        lg_text_add(to, "#define real double_of_plant\n%s\n%s\n%s\n#undef real\n\n", c->arrays, c->weights,
                    c->code);
        lg_c_source_destroy(c);
    }
    return status;
}

static void add_whole(text *to, const char *name, size_t value) {
    lg_text_add(to, "enum { %s = %zu };\n", name, value);
}

static void add_numbers(text *to, const char *name, const double *values, size_t count) {
    lg_text_add(to, "static const double %s[%zu] = {\n", name, count);
    lg_text_add_reals(to, LG_F64, 4, values, count);
    lg_text_add(to, "};\n");
}

static void add_sizes(const export_policy_job *j, const golden *g, text *to) {
    const lg_policy_task *task = j->task;
    double limits[2 * LG_POLICY_INPUTS];
    bool rotations = false;
    lg_text_add(to,
                "enum { RUNS = %d, SEGMENT = %zu, STATE = %zu, POSITIONS = %zu, GIVEN = %zu, "
                "VELOCITIES = %zu, INPUT = %zu };\n",
                RUNS, g->stride, j->state, j->positions, j->given, j->velocities, j->inputs);
    add_whole(to, "COORDINATES", task->coordinate_count);
    lg_text_add(to, "static const int golden_motion[COORDINATES] = {");
    for (uint32_t i = 0; i < task->coordinate_count; i++) {
        rotations = rotations || task->coordinate[i].motion == LG_POLICY_ROTATION;
        lg_text_add(to, "%s%u", i > 0 ? ", " : "",
                    lg_policy_motion_row_of(task->coordinate[i].motion)->position);
    }
    lg_text_add(to, "}; /* numbers of a position */\n%s%s", j->velocities > 0 ? "#define MOVES\n" : "",
                rotations ? "#define ROTATIONS\n" : "");
    for (uint32_t l = 0; l < task->input_count; l++)
        limits[2 * l] = task->input[l].low, limits[2 * l + 1] = task->input[l].high;
    add_numbers(to, "golden_limits", limits, 2 * j->inputs);
    lg_text_add(to, "#define LOOP_TOLERANCE ");
    lg_text_add_real(to, LG_F64, g->tolerance);
    lg_text_add(to, "\n#define LOOP_SCALE ");
    lg_text_add_real(to, LG_F64, g->mean);
    lg_text_add(to, "\n");
}

static void add_path(const export_policy_job *j, const golden *g, text *to) {
    size_t total = 0, at = 0;
    for (size_t r = 0; r < RUNS; r++) total += segments(g, r) + 1;
    APP_FREE double *states = app_alloc(total * j->state, sizeof *states);
    lg_text_add(to, "static const int golden_segments[RUNS] = {");
    for (size_t r = 0; r < RUNS; r++) {
        lg_text_add(to, "%s%zu", r > 0 ? ", " : "", segments(g, r));
        for (size_t s = 0; s <= segments(g, r); s++, at += j->state)
            memcpy(states + at, g->path + (r * (g->steps + 1) + s * g->stride) * j->state,
                   j->state * sizeof *states);
    }
    lg_text_add(to, "};\n");
    add_numbers(to, "golden_path", states, total * j->state);
}

static lg_status add_loop(export_loop *l, golden *g, lg_error *error) {
    const export_policy_job *j = l->job;
    text *to = &j->source->further_test;
    LG_TRY(run_library(l, g, error));
    choose_stride(l, g);
    warn_opposite(l);
    LG_TRY(add_plant(j, to, error));
    add_sizes(j, g, to);
    add_path(j, g, to);
    lg_text_add(to, "\n");
    lg_text_add_named(to, j->source->options->name, export_fragment_text("test_closed"));
    return LG_OK;
}

void export_policy_loop(export_policy_job *j) {
    golden g = {.steps = lg_policy_steps(j->policy)};
    export_loop l;
    lg_error error = {LG_OK, ""};
    g.path = app_alloc(RUNS * (g.steps + 1) * j->state, sizeof *g.path);
    lg_status status = open_loop(j, &l, &error);
    if (status == LG_OK) status = add_loop(&l, &g, &error);
    close_loop(&l);
    free(g.path);
    app_must_file(j->self, status, &error, j->source->options->file);
}
