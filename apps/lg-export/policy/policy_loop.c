/* The closed loop of a controller: runs of the library, and the same runs in the self-test. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "lg-export/policy/policy.h"

enum { PATHS = 8, SEGMENTS = 16, LOOP_STREAM = 12 };

/* ---- runs of the library ---- */

/* The closed loop in the library: the plant, and the controller, which sees what its sensors do. */
enum { SENSED, CONTROL, NARROW, PERIOD, EVALUATIONS }; /* NARROW: the controller in single precision */
typedef struct export_loop {
    export_evaluation e[EVALUATIONS];
    double *seen; /* What the controller takes. */
    double *x;    /* State and input: the inputs of `period`. */
    const export_policy_job *job;
} export_loop;

static void open_loop(const export_policy_job *j, export_loop *l) {
    static const char *const names[EVALUATIONS] = {"sensed_by_control", "control", "control", "period"};
    *l = (export_loop){.job = j};
    l->seen = app_keep(j->given + j->velocities, sizeof *l->seen);
    l->x = app_keep(j->state + j->inputs, sizeof *l->x);
    for (size_t i = 0; i < EVALUATIONS; i++)
        EXPORT_MUST(j, export_evaluation_open(j->program, names[i], i == NARROW ? LG_F32 : LG_F64, 0,
                                              &l->e[i], &error));
}

static void close_loop(export_loop *l) {
    for (size_t i = 0; i < EVALUATIONS; i++) export_evaluation_close(&l->e[i]);
}

/* Moves the state x. `single`: the controller computes in single precision; the plant computes in double
 * precision. */
static void move(export_loop *l, bool single, size_t periods, double *x) {
    const export_policy_job *j = l->job;
    for (size_t k = 0; k < periods; k++) {
        export_evaluate(&l->e[SENSED], x, l->seen);
        memcpy(l->x, x, j->state * sizeof *x);
        export_evaluate(&l->e[single ? NARROW : CONTROL], l->seen, l->x + j->state);
        export_evaluate(&l->e[PERIOD], l->x, x);
    }
}

/* ---- golden segments of paths ---- */

typedef struct golden {
    size_t count, stride; /* states; periods of a segment */
    double *x, *y;        /* (count, state): where segments begin and end */
    double tolerance;
} golden;

/* States of the exported type, at different times of runs from random starts. */
static void draw_states(export_loop *l, golden *g) {
    const export_policy_job *j = l->job;
    const size_t n = j->state, steps = lg_policy_steps(j->policy);
    lg_rng rng;
    lg_rng_seed(&rng, j->source->options->seed, LOOP_STREAM);
    EXPORT_MUST(j, lg_policy_starts(j->policy, &rng, g->count, g->x, NULL, &error));
    for (size_t i = 0; i < g->count; i++) {
        memcpy(g->y, g->x + i * n, n * sizeof *g->y);
        move(l, false, i % SEGMENTS * steps / SEGMENTS, g->y);
        if (export_norm(g->y, NULL, n) < 1e6) memcpy(g->x + i * n, g->y, n * sizeof *g->y);
    }
    for (size_t i = 0; i < g->count * n; i++) g->x[i] = export_round(j->source->options, g->x[i]);
}

/* Computes the ends of the segments. Returns the largest error at an end when the policy computes in single
 * precision, over eps and the mean size of a state. */
static double find_ends(export_loop *l, golden *g) {
    const size_t n = l->job->state;
    const double mean = export_norm(g->x, NULL, g->count * n) / sqrt((double)g->count);
    double worst = 0;
    APP_FREE double *single = app_alloc(n, sizeof *single);
    for (size_t i = 0; i < g->count; i++) {
        double *end = memcpy(g->y + i * n, g->x + i * n, n * sizeof *end);
        memcpy(single, end, n * sizeof *end);
        move(l, false, g->stride, end);
        move(l, true, g->stride, single);
        const double error = export_norm(single, end, n) / (mean > 0 ? mean : 1);
        if (!(error <= worst)) worst = error;
    }
    return worst / (double)FLT_EPSILON;
}

/* Chooses segments as long as rounding cannot fail the test and a wrong sign cannot pass it. */
static void choose_stride(export_loop *l, golden *g) {
    g->stride = (lg_policy_steps(l->job->policy) + SEGMENTS - 1) / SEGMENTS;
    for (;; g->stride = (g->stride + 1) / 2) {
        const double by = find_ends(l, g);
        /* One wrong segment of PATHS must be found. */
        g->tolerance = 20 * export_eps(l->job->source->options) * fmax(by, 16) / sqrt(PATHS);
        if (g->tolerance <= 1e-3 || g->stride == 1) break;
    }
    g->tolerance = export_bound_tolerance(l->job->source, g->tolerance);
}

/* Warns if the policy has no value where an angle, direction or rotation is half a turn from the goal. */
static void warn_opposite(export_loop *l) {
    const export_policy_job *j = l->job;
    const bool single = j->source->options->dtype == LG_F32;
    double z[LG_POLICY_ERRORS] = {0}, u[LG_POLICY_INPUTS];
    for (uint32_t i = 0; i < j->task->coordinate_count; i++)
        if (j->task->coordinate[i].motion != LG_POLICY_LINE && !j->task->coordinate[i].free)
            z[j->policy->layout.at[i].error] = 3.14159265358979323846;
    EXPORT_MUST(j, lg_policy_states(j->policy, z, 1, l->x, &error));
    export_evaluate(&l->e[SENSED], l->x, l->seen);
    export_evaluate(&l->e[single ? NARROW : CONTROL], l->seen, u);
    for (size_t i = 0; i < j->inputs; i++)
        if (!isfinite(u[i])) {
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
static void add_plant(const export_policy_job *j, text *to) {
    APP_FREE char *name = app_format("%s_plant", j->source->options->name);
    const export_options options = {.name = name, .dtype = LG_F64};
    export_function functions[] = {{.function = "period", .hidden = true},
                                   {.function = "sensed_by_control", .hidden = true}};
    export_source plant;
    lg_c_source *c;
    export_source_begin(&plant, &options);
    EXPORT_MUST(j, export_c(&plant, j->program, functions, LG_COUNT(functions), true, 0, &c, &error));
    lg_text_add(to, "/* ---- the plant, for the closed loop: always in double precision ---- */\n\n%s\n",
                c->sizes);
    /* The code calls its type of numbers `real`, which is the controller's type here. */
    lg_text_add(to, "#define real double_of_plant\n%s\n%s\n%s\n#undef real\n\n", c->arrays, c->weights,
                c->code);
    lg_c_source_destroy(c);
    export_source_free(&plant);
}

static void add_sizes(const export_policy_job *j, const golden *g, text *to) {
    double limits[2 * LG_POLICY_INPUTS];
    lg_text_add(to, "enum { PATHS = %d, SEGMENT = %zu, STATE = %zu };\n", PATHS, g->stride, j->state);
    for (uint32_t l = 0; l < j->inputs; l++)
        limits[2 * l] = j->task->input[l].low, limits[2 * l + 1] = j->task->input[l].high;
    lg_text_add(to, "static const double golden_limits[%zu] = {\n", 2 * j->inputs);
    lg_text_add_reals(to, LG_F64, 4, limits, 2 * j->inputs);
    lg_text_add(to, "};\n");
}

static void add_loop(export_loop *l, golden *g) {
    const export_policy_job *j = l->job;
    export_source *source = j->source;
    const size_t n = g->count * j->state;
    text *to = &source->further_test;
    draw_states(l, g);
    choose_stride(l, g);
    warn_opposite(l);
    add_plant(j, to);
    add_sizes(j, g, to);
    export_reals(source, to, "loop_golden_x", g->x, n);
    export_reals(source, to, "loop_golden_y", g->y, n);
    lg_text_add(to, "\n");
    lg_text_add_named(to, source->options->name, export_fragment_text("test_closed"));
    source->further_size = PATHS * j->state;
    lg_text_add(&source->further_row,
                "    {\"closed loop\", run_loop, loop_golden_x, loop_golden_y, %zu, %zu, %.17g, "
                "outputs_of_loop},\n",
                source->further_size, source->further_size, g->tolerance);
}

void export_policy_loop(export_policy_job *j) {
    golden g = {.count = PATHS * (size_t)j->source->options->golden};
    export_loop l;
    APP_FREE double *x = app_alloc(2 * g.count * j->state, sizeof *x);
    g.x = x, g.y = x + g.count * j->state;
    open_loop(j, &l);
    add_loop(&l, &g);
    close_loop(&l);
}
