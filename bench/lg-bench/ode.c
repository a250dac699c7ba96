/* RKMK(5,4) on chains of pendulums in Lagrangian form: time against error for smaller and smaller tolerances,
 * then the cost of one step for 1 to 10^4 links. Every link starts at (q, omega) = (sqrt(1/2), 0, sqrt(1/2),
 * 0, 1, 0). Masses and lengths are 1, g = 9.81; time runs from 0 to 3. */
#include <stdlib.h>

#include "lg-bench/bench.h"
#include "liegrad/integrators.h"
#include "liegrad/mechanics.h"

static const double t_end = 3.0, gravity = 9.81, step_size = 1e-3;
static const double tolerances[] = {1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12};
static const double reference_tolerance = 1e-13;
static const char error_is[] =
    "largest difference at the end over the largest number of a reference, RKMK(5,4) at tolerance 1e-13";

typedef struct chain {
    const bench *bench;
    lg_system *system;
    lg_system_user user[2]; /* Index: lg_coordinates. */
    double *work[2];
    lg_ode ode[2];
    lg_stepper *stepper; /* Scheme rkmk54. */
    size_t dim;
    double tolerance;
    double *start, *end, *reference;
    lg_run_stats stats;
} chain;

static lg_stepper *stepper_of(const chain *c, const char *name) {
    const lg_scheme *scheme = lg_scheme_find(name);
    lg_stepper *stepper = NULL;
    bench_check(c->bench,
                lg_stepper_create(c->bench->app->context, scheme, &c->ode[lg_system_coordinates_for(scheme)],
                                  &stepper),
                "making a stepper");
    return stepper;
}

static void chain_make(chain *c, const bench *b, size_t links) {
    static const double upper_half[6] = {0.70710678118654752, 0, 0.70710678118654752, 0, 1, 0};
    const lg_named_values values = {"gravity", &gravity, 1};
    lg_system_options options;
    lg_error why;
    lg_system_options_init(&options);
    options.form = "lagrangian";
    options.links = links;
    options.parameters = &values;
    options.parameter_count = 1;
    *c = (chain){.bench = b};
    bench_check(b, lg_system_create(b->app->context, "pendulum-chain", &options, &c->system, &why),
                "making the chain");
    c->dim = lg_system_dim(c->system);
    for (int form = 0; form < 2; form++) {
        c->work[form] = app_alloc(lg_system_work_size(c->system), 1);
        bench_check(
            b, lg_system_ode(c->system, (lg_coordinates)form, &c->ode[form], &c->user[form], c->work[form]),
            "making the field");
    }
    c->start = app_alloc(c->dim, sizeof(double));
    c->end = app_alloc(c->dim, sizeof(double));
    c->reference = app_alloc(c->dim, sizeof(double));
    for (size_t i = 0; i < c->dim; i++) c->start[i] = upper_half[i % 6];
    c->stepper = stepper_of(c, "rkmk54");
}

static void chain_end(chain *c) {
    lg_stepper_destroy(c->stepper);
    lg_system_destroy(c->system);
    for (int form = 0; form < 2; form++) free(c->work[form]);
    free(c->start);
    free(c->end);
    free(c->reference);
}

static void integrate(chain *c, lg_stepper *stepper, double tolerance, double *end) {
    lg_step_controller control;
    lg_step_controller_init(&control);
    control.rtol = control.atol = tolerance;
    lg_stepper_reset(stepper);
    bench_check(c->bench, lg_integrate_adaptive(stepper, &control, 0, c->start, &t_end, 1, end, &c->stats),
                "integrating");
}

static void run_once(void *user) {
    chain *c = user;
    integrate(c, c->stepper, c->tolerance, c->end);
}

/* Computes the reference. Returns the difference between it and Dormand-Prince in ambient coordinates at the
 * same tolerance. */
static double make_reference(chain *c) {
    lg_stepper *classical = stepper_of(c, "dp54");
    integrate(c, c->stepper, reference_tolerance, c->reference);
    integrate(c, classical, reference_tolerance, c->end);
    lg_stepper_destroy(classical);
    return bench_difference(c->end, c->reference, c->dim);
}

static void work_against_error(bench *b, size_t links) {
    chain c;
    chain_make(&c, b, links);
    const double uncertain = make_reference(&c);
    for (size_t i = 0; i < LG_COUNT(tolerances) && !app_interrupted(); i++) {
        char name[64];
        (void)snprintf(name, sizeof name, "N=%zu tol=%.0e", links, tolerances[i]);
        c.tolerance = tolerances[i];
        bench_row *row = bench_measure(b, name, run_once, &c);
        if (row == NULL) continue;
        row->width = links;
        row->error = bench_difference(c.end, c.reference, c.dim);
        row->error_is = error_is;
        bench_note_add(row, "steps", (double)c.stats.steps);
        bench_note_add(row, "rejected", (double)c.stats.rejected);
        bench_note_add(row, "evaluations", (double)c.stats.evaluations);
        bench_note_add(row, "manifold_error", lg_space_manifold_error(lg_system_space(c.system), c.end));
        bench_note_add(row, "reference_error", uncertain);
    }
    chain_end(&c);
}

/* Makes one step, always from the same state. */
static void step_once(void *user) {
    chain *c = user;
    bench_check(c->bench, lg_stepper_step(c->stepper, 0, step_size, c->start, NULL, c->end), "a step");
}

static void cost_of_a_step(bench *b, size_t links) {
    chain c;
    char name[64];
    (void)snprintf(name, sizeof name, "step N=%zu", links);
    if (!bench_wanted(b, name)) return;
    chain_make(&c, b, links);
    bench_row *row = bench_measure(b, name, step_once, &c);
    if (row != NULL) {
        row->width = links;
        row->rate = 1e3 * row->min_us / (double)links;
        row->unit = "ns a link";
        bench_note_add(row, "manifold_error", lg_space_manifold_error(lg_system_space(c.system), c.end));
    }
    chain_end(&c);
}

void bench_ode(bench *b) {
    static const size_t chains[] = {2, 6, 10, 20};
    static const size_t lengths[] = {1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000};
    const size_t asked = (size_t)b->given->links;
    if (b->dtype != LG_F64) bench_check(b, LG_UNSUPPORTED, "integrators compute in f64");
    for (size_t i = 0; i < (asked > 0 ? 1 : LG_COUNT(chains)); i++)
        work_against_error(b, asked > 0 ? asked : chains[i]);
    for (size_t i = 0; i < LG_COUNT(lengths) && !app_interrupted(); i++) cost_of_a_step(b, lengths[i]);
}
