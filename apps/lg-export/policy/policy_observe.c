/* The observer of a controller. The self-test's numbers come from the same source as the exported code,
 * compiled here in double precision with the library's plans; tests compare the exported code with lg_ekf. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-export/policy/policy.h"
#include "liegrad/ops.h"

enum { OBSERVE_STREAM = 13, OBSERVATIONS = 200 };

/* ---- the filter in this program ---- */

typedef struct filter {
    int observed, estimate, held;
    double sensor[LG_POLICY_COORDINATES],
        turn[LG_POLICY_COORDINATES]; /* Noise of the sensors; 2 pi of an angle. */
    double drift[LG_POLICY_COORDINATES],
        first[LG_POLICY_COORDINATES]; /* Of velocities: in a period; at the start. */
    bool single;                      /* The functions of the program are computed in single precision. */
    export_evaluation step[2], jacobian[2]; /* Double and single precision. */
    double *row, *out;                      /* Inputs and outputs of the functions. */
} filter;
static filter *now; /* The filter that the code below computes with. */

static const double *inputs_of(const double *x, const double *u) {
    memcpy(now->row, x, (size_t)now->estimate * sizeof *x);
    memcpy(now->row + now->estimate, u, (size_t)now->held * sizeof *u);
    return now->row;
}

static void NAME_observe_step(const double *x, const double *u, double *next, double *work) {
    export_evaluate(&now->step[now->single], inputs_of(x, u), next);
}

static void NAME_jac_observe_step(const double *x, const double *u, double *F, double *by_u, double *work) {
    export_evaluate(&now->jacobian[now->single], inputs_of(x, u), now->out);
    memcpy(F, now->out, (size_t)(now->estimate * now->estimate) * sizeof *F);
}

#define NAME_real      double
#define real           double
#define REAL(number)   number
#define SQRT           sqrt
#define FLOOR          floor
#define OBSERVED       now->observed
#define ESTIMATE       now->estimate
#define observe_sensor now->sensor
#define observe_turn   now->turn
#define observe_drift  now->drift
#define observe_first  now->first
static void NAME_observe_start(const double *y, double *memory);
static void NAME_observe(const double *y, const double *u, double *memory, double *x, double *work);
#include "lg-export/code/policy/observe.c"
#undef real

/* ---- functions of the program ---- */

/* The next positions and velocities from positions, velocities (x) and u. */
static lg_status record_step(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const export_policy_job *j = user;
    const uint32_t n = (uint32_t)j->given;
    const lg_var parts[] = {lg_slice(tape, in[0], 1, 0, n), lg_slice(tape, in[0], 1, n, n)};
    const lg_var state = lg_program_call(tape, "momenta", 0, parts);
    const lg_var next = lg_program_call(tape, "period", 0, (const lg_var[]){state, in[1]});
    const lg_var seen[] = {lg_program_call(tape, "positions", 0, &next),
                           lg_program_call(tape, "velocities", 0, &next)};
    out[0] = lg_concat(tape, seen, 2, 1);
    return lg_tape_status(tape);
}

static lg_status add_functions(const export_policy_job *j, lg_error *error) {
    size_t count;
    const lg_port *control = export_ports(j->program, "control", false, &count);
    const lg_port *period = export_ports(j->program, "period", false, &count);
    const lg_port in[] = {control[0], period[1]}, out = {.name = "next"};
    const lg_function_spec step = {"observe_step", in, 2, &out, 1, record_step, (void *)(uintptr_t)j};
    lg_derivative jacobian;
    LG_TRY(lg_program_add_function(j->program, &step, error));
    lg_derivative_init(&jacobian);
    jacobian.kind = LG_DERIVATIVE_JACOBIAN;
    jacobian.function = "observe_step";
    return lg_program_derive(j->program, &jacobian, error);
}

/* ---- the filter's numbers ---- */

/* Number i of an option with one number for all, or one each. */
static double number_of(const lg_reals *option, size_t i, double otherwise) {
    return option->count == 0 ? otherwise : option->values[option->count == 1 ? 0 : i];
}

static void check(const export_policy_job *j) {
    const export_options *options = j->source->options;
    const lg_reals *const given[] = {&options->sensor, &options->drift};
    for (size_t i = 0; i < LG_COUNT(given); i++)
        if (given[i]->count > 1 && given[i]->count != j->given)
            app_stop_usage(j->self, "--sensor and --drift take one number, or %zu: one for each position",
                           j->given);
}

static void fill_numbers(const export_policy_job *j, filter *f) {
    const export_options *options = j->source->options;
    static const double pi = 3.14159265358979323846;
    f->observed = (int)j->given, f->estimate = 2 * f->observed, f->held = (int)j->inputs;
    for (uint32_t i = 0; i < j->given; i++) {
        const lg_policy_coordinate *c = &j->task->coordinate[i];
        const double first = fmax(fabs(c->start_velocity[0]), fabs(c->start_velocity[1]));
        f->sensor[i] = export_round(options, number_of(&options->sensor, i, 1e-3));
        f->drift[i] = export_round(options, number_of(&options->drift, i, 0.1) * sqrt(j->task->period));
        f->turn[i] = c->motion == LG_POLICY_ANGLE ? export_round(options, 2 * pi) : 0;
        f->first[i] = export_round(options, first > 0 ? first : 1);
    }
}

static lg_status open_filter(const export_policy_job *j, filter *f, lg_error *error) {
    size_t step = 0, jacobian = 0;
    const size_t n = j->state;
    fill_numbers(j, f);
    f->row = app_alloc(n + j->inputs, sizeof *f->row);
    f->out = app_alloc(n * (n + j->inputs), sizeof *f->out);
    (void)lg_program_find(j->program, "observe_step", &step, NULL);
    (void)lg_program_find(j->program, "jac_observe_step", &jacobian, NULL);
    for (int k = 0; k < 2; k++) {
        LG_TRY(export_evaluation_open(j->program, step, k ? LG_F32 : LG_F64, 0, &f->step[k], error));
        LG_TRY(export_evaluation_open(j->program, jacobian, k ? LG_F32 : LG_F64, 0, &f->jacobian[k], error));
    }
    return LG_OK;
}

static void close_filter(filter *f) {
    for (int k = 0; k < 2; k++) {
        export_evaluation_close(&f->step[k]);
        export_evaluation_close(&f->jacobian[k]);
    }
    free(f->row);
    free(f->out);
}

/* ---- golden estimates ---- */

typedef struct golden {
    double *seen, *held, *estimate, *single; /* Rows: periods + 1, periods, periods, periods. */
    size_t periods;
} golden;

/* The run's noisy measurements and inputs, rounded to the exported type. */
static lg_status run(export_loop *l, const filter *f, golden *g, lg_error *error) {
    const export_policy_job *j = l->job;
    APP_FREE double *x = app_alloc(j->state, sizeof *x);
    lg_rng rng;
    lg_rng_seed(&rng, j->source->options->seed, OBSERVE_STREAM);
    lg_status status = lg_policy_starts(j->policy, &rng, 1, x, NULL, error);
    for (size_t k = 0; status == LG_OK && k <= g->periods; k++) {
        double u[LG_POLICY_INPUTS];
        const size_t size = j->given;
        double *seen = g->seen + k * size, *held = g->held + k * j->inputs;
        export_loop_step(l, false, x, u);
        for (size_t i = 0; i < size; i++)
            seen[i] = export_round(j->source->options, l->seen[i] + f->sensor[i] * lg_rng_normal(&rng));
        for (size_t i = 0; i < j->inputs && k < g->periods; i++)
            held[i] = export_round(j->source->options, u[i]);
        if (!(export_norm(x, NULL, j->state) < 1e6) && k < g->periods) g->periods = k;
    }
    return status;
}

static void estimate(filter *f, const golden *g, bool single, double *out) {
    const size_t n = (size_t)f->estimate, size = n + n * n;
    APP_FREE double *memory = app_alloc(size, sizeof *memory), *work = app_alloc(n + 4 * n * n, sizeof *work);
    now = f;
    f->single = single;
    NAME_observe_start(g->seen, memory);
    for (size_t k = 0; k < g->periods; k++) {
        NAME_observe(g->seen + (k + 1) * (size_t)f->observed, g->held + k * (size_t)f->held, memory,
                     out + k * n, work);
        for (size_t i = 0; i < size && single; i++) memory[i] = (double)(float)memory[i];
    }
}

/* 20 times the error of single precision, as a number of eps. */
static double tolerance_of(const export_policy_job *j, const golden *g) {
    const size_t count = g->periods * j->state;
    const double mean = export_norm(g->estimate, NULL, count) / sqrt((double)g->periods);
    double worst = 0;
    for (size_t k = 0; k < g->periods; k++)
        worst =
            fmax(worst, export_norm(g->estimate + k * j->state, g->single + k * j->state, j->state) / mean);
    worst /= (double)FLT_EPSILON;
    return 20 * export_eps(j->source->options) * fmax(worst, 16);
}

/* ---- texts ---- */

static void add_code(const export_policy_job *j, const filter *f) {
    export_source *source = j->source;
    text *to = &source->further_code;
    const size_t n = j->given;
    lg_text_add(to, "enum { OBSERVED = %zu, ESTIMATE = %zu };\n", n, 2 * n);
    export_policy_reals(j, to, "real", "observe_sensor", f->sensor, n);
    export_policy_reals(j, to, "real", "observe_turn", f->turn, n);
    export_policy_reals(j, to, "real", "observe_drift", f->drift, n);
    export_policy_reals(j, to, "real", "observe_first", f->first, n);
    lg_text_add_named(to, source->options->name, export_fragment_text("observe"));
    lg_text_add(&source->hidden, "%sobserve_step,jac_observe_step", source->hidden.length > 0 ? "," : "");
    export_size(source, "OBSERVE_SIZE", 2 * n * (2 * n + 1), "numbers of memory of the observer");
    export_policy_need(source, 2 * n + 4 * n * n + 6 * n * n, 1200, 3);
}

static void add_words(const export_policy_job *j, const filter *f) {
    text *about = &j->source->about;
    lg_text_add(about,
                "observer      NAME_observe estimates positions and velocities from noisy positions: an "
                "extended Kalman filter for noise of standard deviation");
    for (size_t i = 0; i < j->given; i++) lg_text_add(about, " %g", f->sensor[i]);
    lg_text_add(about, " (--sensor) and velocities that stray from the machine's, in a second, by");
    for (size_t i = 0; i < j->given; i++) lg_text_add(about, " %g", f->drift[i] / sqrt(j->task->period));
    lg_text_add(about, " (--drift)\n");
}

static const char declarations[] =
    "\n/* The observer: NAME_observe_start once, with the first positions y (NAME_GIVEN), in the order of x; "
    "then\n"
    " * NAME_observe once a period. u is what was held since the last call, y the positions now, x "
    "(NAME_INPUTS)\n"
    " * the estimate for NAME_control. A number of y that is not finite counts as not measured. A u that is "
    "not\n"
    " * finite leaves the estimate as it was. memory: NAME_OBSERVE_SIZE numbers, kept between calls. */\n"
    "void NAME_observe_start(const NAME_real *y, NAME_real *memory);\n"
    "void NAME_observe(const NAME_real *y, const NAME_real *u, NAME_real *memory, NAME_real *x, NAME_real "
    "*work);\n";

static void add_test(const export_policy_job *j, const golden *g) {
    text *to = &j->source->further_test;
    lg_text_add(to, "enum { OBSERVATIONS = %zu };\n#define OBSERVE_TOLERANCE ", g->periods);
    lg_text_add_real(to, LG_F64, tolerance_of(j, g));
    lg_text_add(to, "\n");
    export_policy_reals(j, to, "real", "golden_seen", g->seen, (g->periods + 1) * j->given);
    export_policy_reals(j, to, "real", "golden_held", g->held, g->periods * j->inputs);
    export_policy_reals(j, to, "double", "golden_estimate", g->estimate, g->periods * j->state);
    lg_text_add(to, "\n");
    lg_text_add_named(to, j->source->options->name, export_fragment_text("test_observe"));
}

static lg_status write_observer(export_policy_job *j, filter *f, lg_error *error) {
    const size_t periods =
        lg_policy_steps(j->policy) < OBSERVATIONS ? lg_policy_steps(j->policy) : OBSERVATIONS;
    const size_t width = j->given + j->inputs + 2 * j->state;
    APP_FREE double *numbers = app_alloc((periods + 1) * width, sizeof *numbers);
    golden g = {.periods = periods, .seen = numbers};
    export_loop loop;
    g.held = g.seen + (periods + 1) * j->given;
    g.estimate = g.held + periods * j->inputs;
    g.single = g.estimate + periods * j->state;
    lg_status status = export_loop_open(j, &loop, error);
    if (status == LG_OK) status = run(&loop, f, &g, error);
    export_loop_close(&loop);
    if (status == LG_OK) {
        estimate(f, &g, false, g.estimate);
        estimate(f, &g, true, g.single);
        add_code(j, f);
        add_words(j, f);
        add_test(j, &g);
        lg_text_add_named(&j->declarations, j->source->options->name, declarations);
    }
    return status;
}

void export_policy_observe(export_policy_job *j) {
    filter f = {.single = false};
    lg_error error = {LG_OK, ""};
    export_policy_simple(j, "observe");
    check(j);
    lg_status status = add_functions(j, &error);
    if (status == LG_OK) status = open_filter(j, &f, &error);
    if (status == LG_OK) status = write_observer(j, &f, &error);
    close_filter(&f);
    app_must_file(j->self, status, &error, j->source->options->file);
}
