/* The adaptation of a controller. The self-test's numbers come from the same source as the exported code,
 * compiled here in double precision with the library's plans; tests change a plant and see whether the change
 * is found. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-export/policy/policy.h"
#include "liegrad/ops.h"

enum { ADAPT_STREAM = 14, ADAPTATIONS = 200, NUMBERS = 4, MEMORY = 20, MOST = LG_POLICY_COORDINATES };

typedef struct adaptation {
    int velocities;
    double scale[MOST], speed[MOST], range[NUMBERS * MOST]; /* Of forces, of velocities, of the numbers. */
    double period, keep;
    bool single;                /* The program's function is computed in single precision. */
    export_evaluation force[2]; /* Double and single precision. */
    double *row;
    size_t n, m;
} adaptation;
static adaptation *now; /* The adaptation that the code below computes with. */

static void NAME_adapt_force(const double *x, const double *u, const double *next, double *force,
                             double *work) {
    const size_t n = now->n, m = now->m;
    memcpy(now->row, x, n * sizeof *x);
    memcpy(now->row + n, u, m * sizeof *u);
    memcpy(now->row + n + m, next, n * sizeof *next);
    export_evaluate(&now->force[now->single], now->row, force);
}

#define NAME_real    double
#define real         double
#define REAL(number) number
#define FABS         fabs
#define REAL_LARGEST DBL_MAX
#define VELOCITIES   now->velocities
#define PERIOD       now->period
#define ADAPT_KEEP   now->keep
#define ADAPT_NOISE  1e-4
#define adapt_scale  now->scale
#define adapt_speed  now->speed
#define adapt_range  now->range
static void NAME_adapt_start(double *memory);
static void NAME_adapt(const double *x, const double *u, const double *next, double *memory, double *found,
                       double *work);
#include "lg-export/code/policy/adapt.c"
#undef real

/* ---- the program's function ---- */

/* The force (velocities) that the machine lacks on the way from x under u to `next`: (p - p of the
 * machine)/period. */
static lg_status record_force(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const export_policy_job *j = user;
    const uint32_t n = (uint32_t)j->given;
    lg_var state[2];
    for (int k = 0; k < 2; k++) {
        const lg_var x = in[2 * k], parts[] = {lg_slice(tape, x, 1, 0, n), lg_slice(tape, x, 1, n, n)};
        state[k] = lg_program_call(tape, "momenta", 0, parts);
    }
    const lg_var free = lg_program_call(tape, "period", 0, (const lg_var[]){state[0], in[1]});
    out[0] = lg_scale(tape, lg_slice(tape, lg_sub(tape, state[1], free), 1, n, n), 1 / j->task->period);
    return lg_tape_status(tape);
}

static lg_status open_adaptation(const export_policy_job *j, adaptation *a, lg_error *error) {
    size_t count, at = 0;
    const lg_port *control = export_ports(j->program, "control", false, &count);
    const lg_port *period = export_ports(j->program, "period", false, &count);
    lg_port next = control[0];
    next.name = "next";
    const lg_port in[] = {control[0], period[1], next}, out = {.name = "force"};
    const lg_function_spec spec = {"adapt_force", in, 3, &out, 1, record_force, (void *)(uintptr_t)j};
    a->n = j->state, a->m = j->inputs, a->velocities = (int)j->velocities;
    a->period = export_round(j->source->options, j->task->period);
    a->keep = export_round(j->source->options, exp(-j->task->period / j->source->options->forget));
    a->row = app_alloc(2 * a->n + a->m, sizeof *a->row);
    LG_TRY(lg_program_add_function(j->program, &spec, error));
    (void)lg_program_find(j->program, "adapt_force", &at, NULL);
    for (int k = 0; k < 2; k++)
        LG_TRY(export_evaluation_open(j->program, at, k ? LG_F32 : LG_F64, 0, &a->force[k], error));
    return LG_OK;
}

static void close_adaptation(adaptation *a) {
    for (int k = 0; k < 2; k++) export_evaluation_close(&a->force[k]);
    free(a->row);
}

/* ---- ranges and golden numbers, from runs of the library ---- */

typedef struct golden {
    double *seen, *held,
        *found[2]; /* Rows: periods + 1 (controller's x), periods; double and single precision. */
    size_t periods;
} golden;

/* A run. `kick`: the plant has 0.3 of the range of damping and of offset more than the machine, as impulses
 * once a period. The numbers are rounded to the exported type. */
static lg_status run(export_loop *l, const adaptation *a, bool kick, golden *g, lg_error *error) {
    const export_policy_job *j = l->job;
    const size_t n = j->given;
    APP_FREE double *x = app_alloc(j->state, sizeof *x);
    lg_rng rng;
    lg_rng_seed(&rng, j->source->options->seed, ADAPT_STREAM);
    lg_status status = lg_policy_starts(j->policy, &rng, 1, x, NULL, error);
    for (size_t k = 0; status == LG_OK && k <= g->periods; k++) {
        double u[LG_POLICY_INPUTS];
        export_loop_step(l, false, x, u);
        for (size_t i = 0; i < 2 * n; i++)
            g->seen[k * 2 * n + i] = export_round(j->source->options, l->seen[i]);
        for (size_t i = 0; i < j->inputs && k < g->periods; i++)
            g->held[k * j->inputs + i] = export_round(j->source->options, u[i]);
        for (size_t i = 0; kick && i < n; i++)
            x[n + i] +=
                0.3 * j->task->period * (a->range[NUMBERS * i + 2] - a->range[NUMBERS * i] * l->seen[n + i]);
        if (!(export_norm(x, NULL, j->state) < 1e6) && k < g->periods) g->periods = k;
    }
    return status;
}

/* Root mean squares over the run of forces (changes of momenta), velocities and accelerations. */
static lg_status find_ranges(const export_policy_job *j, adaptation *a, const golden *g, lg_error *error) {
    const size_t n = j->given, rows = g->periods + 1;
    APP_FREE double *q = app_alloc(rows * n, sizeof *q), *v = app_alloc(rows * n, sizeof *v),
                    *p = app_alloc(rows * 2 * n, sizeof *p);
    for (size_t k = 0; k < rows; k++) {
        memcpy(q + k * n, g->seen + k * 2 * n, n * sizeof *q);
        memcpy(v + k * n, g->seen + k * 2 * n + n, n * sizeof *v);
    }
    const lg_status status = lg_program_eval(j->self->context, j->program, "momenta", rows,
                                             (const double *const[]){q, v}, (double *const[]){p}, error);
    for (size_t i = 0; i < n && status == LG_OK; i++) {
        double force = 0, speed = 0, rate = 0;
        for (size_t k = 0; k < g->periods; k++) {
            force += pow((p[(k + 1) * 2 * n + n + i] - p[k * 2 * n + n + i]) / a->period, 2);
            rate += pow((v[(k + 1) * n + i] - v[k * n + i]) / a->period, 2);
            speed += pow(v[k * n + i], 2);
        }
        const double count = g->periods > 0 ? (double)g->periods : 1;
        force = force > 0 ? sqrt(force / count) : 1;
        speed = speed > 0 ? sqrt(speed / count) : 1;
        rate = rate > 0 ? sqrt(rate / count) : 1;
        const double range[NUMBERS] = {2 * force / speed, 2 * force, 2 * force, 4 * force / rate};
        a->scale[i] = export_round(j->source->options, force);
        a->speed[i] = export_round(j->source->options, speed);
        for (int k = 0; k < NUMBERS; k++)
            a->range[NUMBERS * i + (size_t)k] = export_round(j->source->options, range[k]);
    }
    return status;
}

static void adapt(adaptation *a, const golden *g, bool single) {
    APP_FREE double *memory = app_alloc((size_t)(MEMORY * a->velocities), sizeof *memory);
    double work[MOST];
    now = a;
    a->single = single;
    NAME_adapt_start(memory);
    for (size_t k = 0; k < g->periods; k++) {
        const double *x = g->seen + k * a->n;
        NAME_adapt(x, g->held + k * a->m, x + a->n, memory, g->found[single], work);
        for (int i = 0; i < MEMORY * a->velocities && single; i++) memory[i] = (double)(float)memory[i];
    }
}

/* ---- texts ---- */

static const char declarations[] =
    "\n/* The adaptation: NAME_adapt_start once; then NAME_adapt once a period, with x and u of the last "
    "call of\n"
    " * NAME_control and `next`, the x now (all of them measured or estimated). found (NAME_FOUND): for each "
    "velocity\n"
    " * damping, Coulomb friction, offset and inertia that the plant has and the machine does not: its force "
    "is\n"
    " * larger by -damping v - coulomb sign(v) + offset - inertia v'. memory: NAME_ADAPT_SIZE numbers, kept "
    "between\n"
    " * calls. Numbers that are not finite change nothing. */\n"
    "void NAME_adapt_start(NAME_real *memory);\n"
    "void NAME_adapt(const NAME_real *x, const NAME_real *u, const NAME_real *next, NAME_real *memory,\n"
    "    NAME_real *found, NAME_real *work);\n";

static void add_code(export_policy_job *j, const adaptation *a) {
    export_source *source = j->source;
    text *to = &source->further_code;
    const size_t n = j->velocities;
    lg_text_add(to, "enum { VELOCITIES = %zu };\n", n);
    export_policy_real(j, to, "PERIOD", a->period);
    export_policy_real(j, to, "ADAPT_KEEP", a->keep);
    export_policy_real(j, to, "ADAPT_NOISE", ADAPT_NOISE);
    export_policy_reals(j, to, "real", "adapt_scale", a->scale, n);
    export_policy_reals(j, to, "real", "adapt_speed", a->speed, n);
    export_policy_reals(j, to, "real", "adapt_range", a->range, NUMBERS * n);
    lg_text_add_named(to, source->options->name, export_fragment_text("adapt"));
    lg_text_add(&source->hidden, "%sadapt_force", source->hidden.length > 0 ? "," : "");
    lg_text_add_named(&j->declarations, source->options->name, declarations);
    export_size(source, "ADAPT_SIZE", MEMORY * n, "numbers of memory of the adaptation");
    export_size(source, "FOUND", NUMBERS * n, "numbers that the adaptation finds");
    export_policy_need(source, n, 600, 2);
}

static void add_words(const export_policy_job *j, const adaptation *a) {
    text *about = &j->source->about;
    lg_text_add(about,
                "adaptation    NAME_adapt finds, by recursive least squares that forget in %g s (--forget):",
                j->source->options->forget);
    for (size_t i = 0; i < j->velocities; i++) {
        const double *r = a->range + NUMBERS * i;
        lg_text_add(
            about,
            " of %s damping 0 to %.3g, Coulomb friction 0 to %.3g, offset -%.3g to %.3g, inertia %.3g "
            "to %.3g;",
            j->task->coordinate[i].velocity, r[0], r[1], r[2], r[2], -0.2 * r[3], r[3]);
    }
    lg_text_add(about, " a payload whose inertia depends on other coordinates is outside this form\n");
}

static void add_test(const export_policy_job *j, const adaptation *a, const golden *g) {
    text *to = &j->source->further_test;
    const size_t count = NUMBERS * j->velocities;
    double worst = 0;
    for (size_t i = 0; i < count; i++)
        worst = fmax(worst, fabs(g->found[0][i] - g->found[1][i]) / a->range[i]);
    lg_text_add(to, "enum { ADAPTATIONS = %zu };\n#define ADAPT_TOLERANCE ", g->periods);
    lg_text_add_real(to, LG_F64, 20 * export_eps(j->source->options) * fmax(worst / (double)FLT_EPSILON, 16));
    lg_text_add(to, "\n");
    export_policy_reals(j, to, "real", "golden_moved", g->seen, (g->periods + 1) * j->state);
    export_policy_reals(j, to, "real", "golden_moved_by", g->held, g->periods * j->inputs);
    export_policy_reals(j, to, "double", "golden_found", g->found[0], count);
    export_policy_reals(j, to, "double", "golden_range", a->range, count);
    lg_text_add(to, "\n");
    lg_text_add_named(to, j->source->options->name, export_fragment_text("test_adapt"));
}

static lg_status write_adaptation(export_policy_job *j, adaptation *a, lg_error *error) {
    const size_t all = lg_policy_steps(j->policy), periods = all < ADAPTATIONS ? all : ADAPTATIONS;
    double found[2][NUMBERS * MOST] = {{0}};
    APP_FREE double *numbers = app_alloc((periods + 1) * (j->state + j->inputs), sizeof *numbers);
    golden g = {numbers, numbers + (periods + 1) * j->state, {found[0], found[1]}, periods};
    export_loop loop;
    lg_status status = export_loop_open(j, &loop, error);
    if (status == LG_OK) status = run(&loop, a, false, &g, error);
    if (status == LG_OK) status = find_ranges(j, a, &g, error);
    if (status == LG_OK) status = run(&loop, a, true, &g, error);
    export_loop_close(&loop);
    if (status == LG_OK) {
        adapt(a, &g, false);
        adapt(a, &g, true);
        add_code(j, a);
        add_words(j, a);
        add_test(j, a, &g);
    }
    return status;
}

void export_policy_adapt(export_policy_job *j) {
    adaptation a = {.single = false};
    lg_error error = {LG_OK, ""};
    export_policy_simple(j, "adapt");
    lg_status status = open_adaptation(j, &a, &error);
    if (status == LG_OK) status = write_adaptation(j, &a, &error);
    close_adaptation(&a);
    app_must_file(j->self, status, &error, j->source->options->file);
}
