/* An integration with equal or adaptive steps, which Ctrl-C can end, and the run that the program is for,
 * which is observed, written to --out, drawn and reported. */
#include "common/train.h"
#include "lg-simulate/simulate.h"

#include <math.h>
#include <string.h>
#include <time.h>

static double cpu_seconds(void) {
    struct timespec now;
    if (clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now) != 0) return 0;
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

void plan_init(const simulation *sim, const lg_scheme *scheme, plan *out) {
    const simulate_values *values = sim->values;
    *out = (plan){.scheme = scheme, .t_end = sim->t_end};
    lg_step_controller_init(&out->control);
    out->control.steps = (size_t)values->steps;
    out->control.max_steps = (size_t)values->max_steps;
    out->control.dense = true;
    plan_tolerance(sim, values->tolerance, out);
}

void plan_tolerance(const simulation *sim, double tol, plan *out) {
    out->control.rtol = tol;
    out->control.atol = sim->values->atol >= 0 ? sim->values->atol : -fmax(1e-4 * tol, 1e-16);
}

typedef struct runner {
    const plan *how;
    outcome *out;
} runner;

static lg_status observe_step(void *user, double t, double h, const double *y) {
    const runner *run = user;
    const lg_step_controller *own = &run->how->control;
    run->out->t = t + h;
    if (app_interrupted()) return LG_CANCELLED;
    return own->observe != NULL ? own->observe(own->observer, t, h, y) : LG_OK;
}

lg_status integrate(const simulation *sim, const plan *how, const double *y0, double *rows, outcome *out,
                    lg_error *error) {
    lg_stepper *stepper = NULL;
    *out = (outcome){.t = 0};
    for (size_t i = 0; i < how->count * sim->dim; i++) rows[i] = (double)NAN;
    const lg_ode *ode = &sim->ode[lg_system_coordinates_for(how->scheme)];
    LG_TRY(lg_scheme_check(how->scheme, error));
    LG_TRY(lg_stepper_create(sim->self->context, how->scheme, ode, &stepper));
    runner run = {how, out};
    lg_step_controller control = how->control;
    control.observe = observe_step;
    control.observer = &run;
    const double begin = app_seconds(), begin_cpu = cpu_seconds();
    const lg_status status =
        lg_integrate_adaptive(stepper, &control, 0, y0, how->times, how->count, rows, &out->stats);
    out->seconds = app_seconds() - begin;
    out->cpu = cpu_seconds() - begin_cpu;
    lg_stepper_destroy(stepper);
    return status;
}

/* ---- whether a result can be known at its tolerance ---- */

/* Number of times at which two runs are compared, to find when they separate. */
enum { MOMENTS = 200 };

/* A warning is printed if the relative difference exceeds both TOLD and the square root of the larger of the
 * two tolerances. */
#define TOLD 1e-2

/* Sizes of the parts of a state. All blocks with the same key form a part: all q_i, or all omega_i. */
typedef struct sizes {
    const simulation *sim;
    size_t *part; /* (blocks): index of the first block with the same key */
    /* (blocks), used at first blocks only: largest |y_i| in the run; largest difference of two states. */
    double *largest, *apart;
} sizes;

static sizes sizes_of(const simulation *sim) {
    const size_t count = sim->block_count;
    sizes self = {sim, app_keep(count, sizeof *self.part), app_keep(count, sizeof *self.largest),
                  app_keep(count, sizeof *self.apart)};
    for (size_t b = 0; b < count; b++)
        while (strcmp(sim->blocks[self.part[b]].key, sim->blocks[b].key) != 0) self.part[b]++;
    return self;
}

/* into[part] = max(into[part], |x_i - y_i| over the part); if y is NULL, y_i = 0. */
static void widen(const sizes *self, const double *x, const double *y, double *into) {
    for (size_t b = 0; b < self->sim->block_count; b++) {
        const block *at = &self->sim->blocks[b];
        double *most = &into[self->part[b]];
        for (size_t i = at->offset; i < at->offset + at->count; i++)
            *most = fmax(*most, fabs(x[i] - (y != NULL ? y[i] : 0)));
    }
}

static lg_status look_at_sizes(void *user, double t, double h, const double *y) {
    const sizes *self = user;
    widen(self, y, NULL, self->largest);
    return LG_OK;
}

/* Relative difference of two states, in the part of the state where it is smallest. Other parts can mislead:
 * the velocities of a body at rest are only rounding errors, and differ by as much as their size. */
static double difference(const sizes *self, const double *x, const double *y) {
    double least = INFINITY;
    for (size_t b = 0; b < self->sim->block_count; b++) self->apart[b] = 0;
    widen(self, x, y, self->apart);
    for (size_t b = 0; b < self->sim->block_count; b++)
        if (self->largest[b] > 0) least = fmin(least, self->apart[b] / self->largest[b]);
    return isfinite(least) ? least : 0;
}

/* The first of the compared times at which the runs differ by more than `bound`; t_end if there is none. */
static double parting(const simulation *sim, plan fine, plan coarse, const sizes *size, double bound) {
    double t[MOMENTS], found = fine.t_end;
    APP_FREE double *a = app_alloc(2 * MOMENTS * sim->dim, sizeof *a);
    double *b = a + MOMENTS * sim->dim;
    outcome run;
    for (size_t i = 0; i < MOMENTS; i++) t[i] = fine.t_end * ((double)(i + 1) / MOMENTS);
    fine.times = coarse.times = t;
    fine.count = coarse.count = MOMENTS;
    fine.control.observe = coarse.control.observe = NULL;
    if (integrate(sim, &fine, sim->scene.state, a, &run, NULL) == LG_OK &&
        integrate(sim, &coarse, sim->scene.state, b, &run, NULL) == LG_OK)
        for (size_t i = MOMENTS; i-- > 0;)
            if (difference(size, a + i * sim->dim, b + i * sim->dim) > bound) found = t[i];
    return found;
}

/* If the steps are adaptive, repeats the run with ten times the tolerance. Warns if the final state y (dim)
 * differs so much that only few of its digits can be right. */
static void horizon_warn(const simulation *sim, const plan *how, const double *y) {
    const double coarse_tolerance = 10 * how->control.rtol, bound = fmax(TOLD, sqrt(coarse_tolerance));
    plan coarse = *how;
    outcome run;
    if (how->control.steps > 0 || coarse_tolerance >= 1) return;
    sizes size = sizes_of(sim);
    APP_FREE double *end = app_alloc(sim->dim, sizeof *end);
    (void)look_at_sizes(&size, 0, 0, sim->scene.state);
    coarse.control.rtol = coarse_tolerance;
    coarse.control.atol *= 10;
    coarse.times = &how->t_end;
    coarse.count = 1;
    coarse.control.observe = look_at_sizes;
    coarse.control.observer = &size;
    if (integrate(sim, &coarse, sim->scene.state, end, &run, NULL) == LG_OK) {
        const double apart = difference(&size, y, end);
        if (apart > bound)
            app_warn(sim->self,
                     "from t = %.4g on the result is not reliable: a run at ten times the tolerance differs "
                     "from it by %.2g of the size of the state there, and by %.2g at the end; give a "
                     "smaller --tolerance, or ask for statistics of many runs (--ensemble)",
                     parting(sim, *how, coarse, &size, bound), bound, apart);
    }
}

/* ---- the file of --out; the writer remembers the first error, and the commit returns it ---- */

/* Writes texts, /t (M), /trajectory (M, d), and /invariants/NAME (M) for each invariant. */
static void put_run(const report *what, const lg_archive_writer *to) {
    const lg_system *system = what->sim->system;
    const size_t d = what->sim->reported, dim = what->sim->dim, kept = what->path->kept;
    const double *t = what->path->t + what->path->first, *y = what->path->y + what->path->first * dim;
    const uint64_t dims[] = {kept, d};
    APP_FREE double *rows = app_alloc(kept, (d + 1) * sizeof *rows);
    double *values = rows + kept * d;
    APP_FREE char *steps = app_format("%zu", what->run->stats.steps);
    const char *const texts[][2] = {{"system", lg_system_name(system)},
                                    {"form", lg_system_form(system)},
                                    {"layout", lg_system_layout(system)},
                                    {"method", what->how->scheme->name},
                                    {"steps", steps}};
    for (size_t i = 0; i < LG_COUNT(texts); i++)
        if (texts[i][1] != NULL) (void)to->text(to->user, texts[i][0], texts[i][1]);
    for (size_t i = 0; i < kept; i++) memcpy(rows + i * d, y + i * dim, d * sizeof *rows);
    (void)to->array(to->user, "t", LG_ELEMENT_F64, 1, dims, t);
    (void)to->array(to->user, "trajectory", LG_ELEMENT_F64, 2, dims, rows);
    for (size_t k = 0; k < what->seen->invariants; k++) {
        APP_FREE char *name = app_format("invariants/%s", lg_system_invariant_name(system, k));
        for (size_t i = 0; i < kept; i++)
            values[i] = lg_system_invariant(system, k, y + i * dim, what->seen->work);
        (void)to->array(to->user, name, LG_ELEMENT_F64, 1, dims, values);
    }
}

static lg_status write_trajectory(const report *what, lg_error *error) {
    const app *self = what->sim->self;
    lg_provenance provenance = app_provenance(self, 0);
    lg_archive_writer to;
    APP_CLEAN(lg_file_writer_destroy_at) lg_file_writer *writer = NULL;
    provenance.has_seed = false;
    LG_TRY(lg_file_writer_create(self->context, what->sim->values->out, "trajectory", &provenance, &writer,
                                 error));
    (void)app_had_memory(lg_file_writer_archive(writer, "", &to));
    put_run(what, &to);
    return lg_file_writer_commit(writer, error);
}

/* ---- what is printed ---- */

enum { SHOWN_BLOCKS = 14 };

static void show_block(FILE *to, const block *at, const double *y) {
    char name[48];
    block_name(at, name, sizeof name);
    for (size_t i = 0; i < at->count; i++) {
        if (i % at->columns == 0 && (i == 0 || at->columns > 1))
            (void)fprintf(to, "%s%-8s", i > 0 ? "\n" : "", i > 0 ? "" : name);
        (void)fprintf(to, " %23.16g", y[at->offset + i]);
    }
    (void)fputc('\n', to);
}

/* Writes a state. For people each block is printed on its own lines; of many blocks only the first ones and
 * the last. */
static void put_state(app_json *out, const char *key, const simulation *sim, const double *y) {
    const size_t n = sim->block_count, shown = n <= SHOWN_BLOCKS ? n : SHOWN_BLOCKS - 2;
    app_json_reals(out, key, y, sim->reported);
    app_result_line(out, "%s:", key);
    for (size_t i = 0; i < shown && out->people; i++) show_block(out->stream, &sim->blocks[i], y);
    if (shown == n || !out->people) return;
    app_result_line(out, "... (--json prints all, --out writes them)");
    show_block(out->stream, &sim->blocks[n - 1], y);
}

static void put_gradient(app_json *out, const report *what) {
    const simulation *sim = what->sim;
    const gradient *slope = what->slope;
    char label[64];
    app_result_real(out, "J", slope->j, "its gradient by the start, projected onto the tangent space,");
    put_state(out, "dJ_dy0", sim, slope->dy0);
    app_result_line(out, "and in the parameters:");
    app_json_open(out, "dJ_dparameters", '{');
    for (size_t i = 0; i < lg_system_parameter_count(sim->system); i++) {
        lg_system_parameter_label(sim->system, i, label);
        app_result_real(out, label, slope->dparameters[i], NULL);
    }
    app_json_close(out, '}');
    APP_PUT(out, LG_WHOLE("checkpoints", slope->stats.checkpoints, NULL),
            LG_WHOLE("state_bytes", slope->stats.states_size, NULL),
            LG_WHOLE("tape_bytes", slope->stats.tape_size, NULL),
            LG_REAL("gradient_seconds", slope->stats.seconds, NULL));
}

static void report_run(const report *what) {
    const simulation *sim = what->sim;
    const plan *how = what->how;
    const watch *seen = what->seen;
    const lg_scheme *scheme = how->scheme;
    app_json *out = sim->self->out;
    APP_PUT(out, LG_TEXT("system", lg_system_name(sim->system), NULL),
            LG_TEXT("form", lg_system_form(sim->system), NULL),
            LG_AS_TEXT("layout", lg_system_layout(sim->system)), LG_TEXT("method", scheme->name, NULL));
    if (scheme->kind == LG_SCHEME_SLGI || scheme->kind == LG_SCHEME_IMPLICIT)
        app_result_real(out, "theta", scheme->theta, NULL);
    if (how->control.steps > 0) {
        app_result_real(out, "h", how->t_end / (double)how->control.steps, NULL);
    } else {
        APP_PUT(out, LG_REAL("rtol", how->control.rtol, NULL),
                LG_REAL(how->control.atol < 0 ? "atol_of_size" : "atol", fabs(how->control.atol), NULL));
    }
    APP_PUT(out, LG_WHOLE("steps", what->run->stats.steps, NULL),
            LG_WHOLE("rejected", what->run->stats.rejected, NULL),
            LG_WHOLE("evaluations", what->run->stats.evaluations, "of the field"),
            LG_REAL("seconds", what->run->seconds, NULL), LG_REAL("t", how->t_end, NULL));
    put_state(out, "y", sim, what->path->y + (what->path->count - 1) * sim->dim);
    app_result_named(out, "invariants", "invariant");
    for (size_t i = 0; i < seen->invariants; i++)
        APP_OBJECT(out, lg_system_invariant_name(sim->system, i), LG_AS_REAL("start", seen->start[i]),
                   LG_AS_REAL("end", seen->end[i]), LG_AS_REAL("max_drift", seen->drift[i]));
    app_result_rows_end(out);
    APP_PUT(out, LG_REAL("manifold_error", seen->manifold, "largest violation of a constraint"),
            LG_AS_REAL("max_angle", what->run->stats.max_angle));
    if (sim->scene.projected) app_json_real(out, "projection", sim->scene.projection);
    if (what->slope != NULL) put_gradient(out, what);
    if (sim->values->out != NULL)
        APP_PUT(out, LG_TEXT("out", sim->values->out, NULL), LG_WHOLE("points", what->path->kept, NULL));
}

/* ---- one run ---- */

static void fail_run(const simulation *sim, const plan *how, const outcome *run, lg_status status,
                     const lg_error *error) {
    const app *self = sim->self;
    const char *name = how->scheme->name;
    switch (status) {
    case LG_CANCELLED:
        app_stop(self, status, "stopped by %s at t = %g", app_stopper(), run->t);
    case LG_STEP_TOO_SMALL:
        app_stop(
            self, status,
            "%s: the step size fell below the rounding of time at t = %.17g, after %zu steps; try a larger "
            "--tolerance or --atol",
            name, run->t, run->stats.steps);
    case LG_TOO_MANY_STEPS:
        app_stop(self, status, "%s: reached only t = %g in %zu steps (--max-steps); t_end is %g", name,
                 run->t, how->control.max_steps, how->t_end);
    case LG_NOT_FINITE:
        app_stop(self, status, "%s: the state is not finite in the step from t = %g, after %zu steps", name,
                 run->t, run->stats.steps);
    case LG_NO_CONVERGENCE:
        app_stop(self, status,
                 "%s: Newton's method does not converge in the step from t = %g; give more steps", name,
                 run->t);
    default:
        app_stop(self, status, "%s: %s", name, app_sentence(status, error));
    }
}

/* Integrates from the start to the times of `path`, observed by `seen`. Writes the points that were reached
 * before Ctrl-C to --out. */
static void run_plan(const report *what, const plan *how, watch *seen, samples *path, outcome *out) {
    const simulation *sim = what->sim;
    const char *file = sim->values->out;
    lg_error error = {LG_OK, ""};
    memcpy(path->y, sim->scene.state, sim->dim * sizeof *path->y);
    const lg_status status = integrate(sim, how, path->y, path->y + sim->dim, out, &error);
    out->seconds -= seen->spent;
    if (out->seconds < 0) out->seconds = 0;
    while (status == LG_CANCELLED && path->kept > 0 && path->t[path->first + path->kept - 1] > out->t)
        path->kept--;
    if (status == LG_CANCELLED && file != NULL && path->kept > 0 && write_trajectory(what, &error) == LG_OK)
        app_warn(sim->self, "%s holds the %zu points reached", file, path->kept);
    if (status != LG_OK) fail_run(sim, how, out, status, &error);
    watch_warn(seen, how, out);
}

void run_once(const simulation *sim) {
    plan how;
    outcome run = {.t = 0};
    samples path = {0};
    gradient slope = {0};
    watch seen = {.sim = NULL};
    app_plot_check(sim->self, simulate_has(sim));
    APP_CLEAN(method_free) method chosen = method_choose(sim);
    const bool sloped = sim->values->gradient != NULL;
    const report what = {sim, &how, &run, &seen, &path, sloped ? &slope : NULL};
    plan_init(sim, &chosen.scheme, &how);
    check_control(sim, &chosen.scheme);
    samples_choose(sim, &how, sim->values->out != NULL || app_plot_given.plot != NULL, &path);
    if (sloped) gradient_read(sim, &slope);
    watch_begin(&seen, sim, app_plot_given.plot != NULL, sloped, sim->scene.state);
    how.times = path.t + 1;
    how.count = path.count - 1;
    how.control.observe = watch_step;
    how.control.observer = &seen;
    run_plan(&what, &how, &seen, &path, &run);
    if (sloped)
        gradient_compute(sim, &chosen.scheme, &seen, &slope);
    else
        horizon_warn(sim, &how, path.y + (path.count - 1) * sim->dim);
    if (sim->values->out != NULL) APP_MUST_FILE(sim->self, sim->values->out, write_trajectory(&what, &error));
    app_plot_draw(sim->self, simulate_has(sim), &what);
    report_run(&what);
}
