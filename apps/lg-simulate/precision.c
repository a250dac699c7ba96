/* --work-precision: error at the final time against CPU time and evaluations. Each method runs with numbers
 * of steps that double or, if it estimates its error, with tolerances that fall by factors of ten. */
#include "lg-simulate/simulate.h"

#include <math.h>
#include <string.h>

/* A run is repeated until MIN_SECONDS of CPU time have passed, and the fastest repetition counts. A method is
 * not refined further once a run needs more than MAX_SECONDS, or once its error is below FLOOR times the
 * error of the reference. */
#define MIN_SECONDS 0.01
#define MAX_SECONDS 1.0
#define FLOOR       3.0
enum { REPEATS = 200, CURVES = 32 };

/* Default methods; those that apply to the system are used. */
static const char on_manifolds[] = "rk4,dp54,rk4-projected,lie-euler,rkmk4,cf4,cf43,slgi,rkmk54",
                  on_rn[] = "euler,implicit-euler,symplectic-euler,midpoint,stormer-verlet,forest-ruth,"
                            "blanes-moan,rk4,dp54";

typedef struct point {
    lg_run_stats stats;
    double tol; /* 0 for equal steps */
    double seconds, error;
} point;

typedef struct curve {
    method what;
    bool adaptive;
    size_t count;
    point points[40];
} curve;

typedef struct diagram {
    simulation *sim;
    const char *reference; /* name of the method that computes the reference */
    double tol, reference_error, size;
    double *y; /* (dim): final state of the reference */
    size_t count;
    curve *curves;
} diagram;

/* ---- runs ---- */

static double distance(const diagram *d, const double *a, const double *b) {
    double sum = 0;
    for (size_t i = 0; i < d->sim->reported; i++) sum += (a[i] - b[i]) * (a[i] - b[i]);
    return sqrt(sum) / d->size;
}

static void plan_of(const diagram *d, const lg_scheme *scheme, size_t steps, double tol, plan *out) {
    plan_init(d->sim, scheme, out);
    out->control.steps = steps;
    plan_tolerance(d->sim, tol, out);
    out->times = &d->sim->t_end;
    out->count = 1;
}

/* Computes the reference with tolerance d->tol. Its error is its distance from a run with ten times this
 * tolerance. */
static void find_reference(diagram *d) {
    const app *self = d->sim->self;
    const lg_scheme *scheme = lg_scheme_find(d->reference);
    APP_FREE double *coarse = app_alloc(d->sim->dim, sizeof *coarse);
    outcome run;
    plan how;
    plan_of(d, scheme, 0, 10 * d->tol, &how);
    lg_status status = integrate(d->sim, &how, d->sim->scene.state, coarse, &run, NULL);
    plan_of(d, scheme, 0, d->tol, &how);
    if (status == LG_OK) status = integrate(d->sim, &how, d->sim->scene.state, d->y, &run, NULL);
    if (status == LG_CANCELLED) app_stop(self, status, "stopped by %s", app_stopper());
    if (status != LG_OK)
        app_stop(self, status, "the reference solution with %s at tolerance %g failed: %s (t = %g)",
                 scheme->name, d->tol, lg_status_sentence(status), run.t);
    d->size = 0;
    for (size_t i = 0; i < d->sim->reported; i++) d->size += d->y[i] * d->y[i];
    d->size = d->size > 0 ? sqrt(d->size) : 1;
    d->reference_error = distance(d, coarse, d->y);
}

/* Measures one point of a curve. If it fails, the point is left out, because with coarse steps a state may
 * overflow. */
static lg_status measure(const diagram *d, const plan *how, point *out) {
    APP_FREE double *y = app_alloc(d->sim->dim, sizeof *y);
    double spent = 0;
    outcome run;
    lg_status status = LG_OK;
    out->seconds = HUGE_VAL;
    for (int i = 0; i < REPEATS && (i == 0 || spent < MIN_SECONDS) && status == LG_OK; i++) {
        status = integrate(d->sim, how, d->sim->scene.state, y, &run, NULL);
        spent += run.cpu;
        out->seconds = fmin(out->seconds, run.cpu);
    }
    out->stats = run.stats;
    out->tol = how->control.steps > 0 ? 0 : how->control.rtol;
    out->error = distance(d, y, d->y);
    return status == LG_OK && !isfinite(out->error) ? LG_NOT_FINITE : status;
}

static lg_status fill_curve(const diagram *d, curve *at) {
    const bool given = d->sim->values->steps > 0;
    size_t steps = given ? (size_t)d->sim->values->steps : 16; /* at least, and h <= 1/8 */
    while (!given && (double)steps < 8 * d->sim->t_end && steps < (size_t)1 << 30) steps *= 2;
    double tol = app_given(d->sim->self, "tolerance") ? d->sim->values->tolerance : 1e-3;
    for (size_t level = 0; level < (size_t)d->sim->values->levels; level++, steps *= 2, tol /= 10) {
        point *to = &at->points[at->count];
        plan how;
        if (at->adaptive && tol < 0.5e-14) break;
        plan_of(d, &at->what.scheme, at->adaptive ? 0 : steps, tol, &how);
        const lg_status status = measure(d, &how, to);
        if (status == LG_CANCELLED || status == LG_OUT_OF_MEMORY || status == LG_UNSUPPORTED ||
            status == LG_INVALID_ARGUMENT)
            return status;
        if (status != LG_OK) continue;
        at->count++;
        if (to->error <= FLOOR * d->reference_error || to->seconds > MAX_SECONDS) break;
    }
    return LG_OK;
}

/* ---- choosing the methods ---- */

static void add_curve(diagram *d, const char *option, const char *name) {
    method what = method_named(d->sim, option, name);
    method_adjust(d->sim, &what);
    d->curves[d->count++] = (curve){.what = what, .adaptive = what.scheme.embedded_order > 0};
}

/* Adds the methods of a list; of the default list (not `asked`) those that apply. */
static void add_list(diagram *d, const char *list, bool asked) {
    APP_FREE char *names = app_format("%s", list);
    for (char *rest = names, *name; (name = strtok_r(rest, ",", &rest)) != NULL;) {
        if (!asked && method_obstacle(d->sim, lg_scheme_find(name)) != NULL) continue;
        if (d->count == CURVES)
            app_stop_usage(d->sim->self, "--schemes: at most %d schemes can be given", CURVES);
        add_curve(d, "schemes", name);
    }
    if (d->count == 0) app_stop_usage(d->sim->self, "--schemes: the list has no name");
}

/* ---- results ---- */

static void report_diagram(const diagram *d) {
    app_json *out = d->sim->self->out;
    APP_PUT(out, LG_TEXT("system", lg_system_name(d->sim->system), NULL),
            LG_TEXT("form", lg_system_form(d->sim->system), NULL), LG_REAL("t", d->sim->t_end, NULL));
    APP_OBJECT(out, "reference", LG_AS_TEXT("method", d->reference), LG_AS_REAL("tol", d->tol),
               LG_AS_REAL("error", d->reference_error));
    app_result_line(out,
                    "Error: |y - reference|/|reference| at the end; the reference is %s at tolerance "
                    "%.0e;\nit differs by %.1e from a run at tolerance %.0e. Seconds are CPU time.\n",
                    d->reference, d->tol, d->reference_error, 10 * d->tol);
    app_result_rows(out, "work_precision");
    for (const curve *at = d->curves; at < d->curves + d->count; at++)
        for (const point *p = at->points; p < at->points + at->count; p++) {
            const bool doubled = !at->adaptive && p > at->points && p->stats.steps == 2 * p[-1].stats.steps;
            app_json_open(out, NULL, '{');
            app_json_text(out, "method", at->what.scheme.name);
            if (p->tol > 0 || out->people) app_json_real(out, "tol", p->tol > 0 ? p->tol : (double)NAN);
            APP_PUT(out, LG_AS_WHOLE("steps", p->stats.steps), LG_AS_WHOLE("rejected", p->stats.rejected),
                    LG_AS_WHOLE("evaluations", p->stats.evaluations), LG_AS_REAL("seconds", p->seconds),
                    LG_AS_REAL("error", p->error));
            if (out->people)
                app_json_real(out, "order", doubled ? log2(p[-1].error / p->error) : (double)NAN);
            app_json_close(out, '}');
        }
    app_result_rows_end(out);
}

/* ---- the plot ---- */

static void put_precision(app_plot *plot, const void *shown) {
    const diagram *d = shown;
    app_plot_text(plot, "%s to t = %g", lg_system_name(d->sim->system), d->sim->t_end);
    for (const curve *at = d->curves; at < d->curves + d->count; at++) {
        if (at->count == 0) continue;
        app_plot_text(plot, "%s", at->what.scheme.name);
        for (size_t i = 0; i < at->count; i++)
            APP_PLOT_ROW(plot, 9, at->points[i].seconds, (double)at->points[i].stats.evaluations,
                         fmax(at->points[i].error, 1e-17));
        app_plot_block(plot);
    }
}

static const app_plot_kind plot = APP_PLOT("precision", NULL, "precision", put_precision);

/* ---- the command ---- */

static void fill(diagram *d) {
    const app *self = d->sim->self;
    app_progress progress;
    lg_status status = LG_OK;
    size_t c = 0, points = 0;
    app_progress_begin(&progress, 0, d->count);
    for (; c < d->count && status == LG_OK; c++) {
        app_progress_show(&progress, c, "%s", d->curves[c].what.scheme.name);
        status = fill_curve(d, &d->curves[c]);
        points += d->curves[c].count;
    }
    app_progress_end(&progress);
    if (status == LG_CANCELLED) app_stop(self, status, "stopped by %s", app_stopper());
    if (status != LG_OK)
        app_stop(self, status, "%s: %s", d->curves[c - 1].what.scheme.name, lg_status_sentence(status));
    if (points == 0) app_stop(self, LG_NOT_FINITE, "no run of any method ended with a finite state");
}

static void diagram_free(diagram *d) {
    for (size_t c = 0; c < d->count; c++) method_free(&d->curves[c].what);
}

void work_precision(simulation *sim) {
    const bool flat = lg_space_is_abelian(lg_system_space(sim->system));
    const simulate_values *values = sim->values;
    const char *list = values->schemes != NULL ? values->schemes : flat ? on_rn : on_manifolds;
    APP_CLEAN(diagram_free)
    diagram d = {.sim = sim, .reference = flat ? "dp54" : "rkmk54", .tol = 1e-13, .size = 1};
    d.y = app_keep(sim->dim, sizeof *d.y);
    d.curves = app_keep(CURVES + 1, sizeof *d.curves);
    add_list(&d, list, values->schemes != NULL);
    if (values->scheme != NULL) add_curve(&d, "scheme", values->scheme);
    find_reference(&d);
    fill(&d);
    app_plot_row(sim->self, &plot, &d);
    report_diagram(&d);
}
