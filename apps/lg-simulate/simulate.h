/* What the parts of lg-simulate share: the scene at hand, methods, runs, what is seen along a run.
 * Options and files that are wrong end the command. Functions that return a status explain a failure in
 * `error`. */
#ifndef LG_APPS_SIMULATE_H
#define LG_APPS_SIMULATE_H

#include "common/app.h"
#include "liegrad/adjoint.h"
#include "liegrad/integrators.h"
#include "liegrad/io.h"
#include "liegrad/mechanics.h"

typedef enum picture_kind {
    PICTURE_OVERVIEW,
    PICTURE_COMPONENTS,
    PICTURE_INVARIANTS,
    PICTURE_MANIFOLD,
    PICTURE_STEPS,
    PICTURE_SPACE
} picture_kind;

typedef struct simulate_values {
    const char *method, *scheme, *dexpinv, *out, *plot, *methods, *gradient;
    const char *vary, *starts, *event, *save, *task; /* of --ensemble */
    uint64_t steps, points, checkpoints, levels, max_steps, ensemble;
    double tol, atol, t_end, theta;
    lg_reals times;
    int plot_kind;
    bool work_precision;
} simulate_values;

/* ---- the scene (scene.c) ---- */

/* Consecutive numbers of a state or of a list of parameters. */
typedef struct block {
    const char *key;
    size_t index;  /* from 1; 0: the key alone names it */
    size_t offset; /* of the first number */
    size_t count;
    size_t columns; /* of a matrix; 1 for vectors */
} block;

typedef struct simulation {
    app *self;
    const simulate_values *values;
    lg_scene scene;
    const lg_system *system;
    char title[64]; /* "heavy-top, cotangent" */
    size_t dim, reported;
    double t_end;
    double *work; /* of the fields */
    lg_system_user user[2];
    lg_ode ode[2]; /* by lg_coordinates */
    block *blocks; /* of what is reported, by offset */
    size_t block_count;
} simulation;

/* Reads the scene and looks at --t-end and --times. */
void simulation_open(app *self, const simulate_values *values, const char *path, simulation *out);
void simulation_close(simulation *sim); /* a zeroed one may be closed */

/* "q2", "R" */
void block_name(const block *at, char *text, size_t size);
/* The numbers of a parameter by its key in scenes, *count of them; NULL when the system has none of that
 * name. */
const double *parameter_values(const simulation *sim, const char *key, size_t *count);
/* First block of the state with this key, NULL when there is none; those with it follow in order of the
 * index. */
const block *find_block(const simulation *sim, const char *key, size_t index);

/* ---- methods (method.c) ---- */

typedef struct method {
    lg_scheme scheme;
    lg_scheme *file; /* owned, or NULL */
} method;

/* What --method, --scheme, --theta and --dexpinv say; the default is rkmk54, and dp54 on R^n. */
method method_choose(const simulation *sim);
method method_named(const simulation *sim, const char *option, const char *name);
method method_read(const simulation *sim, const char *path);
void method_free(method *what);
/* Equal or adaptive steps must fit the method. */
void check_control(const simulation *sim, const lg_scheme *scheme);
/* NULL when the scheme applies to the system, else why it does not. */
const char *method_obstacle(const simulation *sim, const lg_scheme *scheme);

/* ---- runs (run.c) ---- */

typedef struct plan {
    const lg_scheme *scheme;
    size_t steps;        /* > 0: equal ones; 0: adaptive */
    double rtol, atol;   /* as in lg_step_controller */
    size_t max_steps;    /* adaptive */
    double t_end;        /* > 0 */
    const double *times; /* (count) where the state is wanted, ascending in (0, t_end], the last is t_end */
    size_t count;
    lg_step_observer observe; /* NULL: nobody */
    void *observer;
} plan;

typedef struct outcome {
    lg_run_stats stats;
    double seconds, cpu; /* of the integration, the observer included */
    double t;            /* reached */
} outcome;

/* Tolerances and steps from the command line. */
void plan_init(const simulation *sim, const lg_scheme *scheme, plan *out);
/* A relative tolerance, and what --atol makes of it. */
void plan_tolerance(const simulation *sim, double tol, plan *out);
/* From y0 (dim) to each of the times: rows (count, dim). Ctrl-C ends it with LG_CANCELLED. On failure the
 * rows not reached are NaN; `out` is filled. */
lg_status integrate(const simulation *sim, const plan *how, const double *y0, double *rows, outcome *out,
                    lg_error *error);

/* Runs once more at ten times the tolerance of adaptive steps, and warns where the end y (dim) of the run
 * differs so much that few of its digits can be right (horizon.c). */
void horizon_warn(const simulation *sim, const plan *how, const double *y);

/* ---- what is seen along a run (watch.c) ---- */

/* A list of (t, h, manifold error, drifts): every accepted step, thinned out to the largest values of
 * neighbours when there are many. */
typedef struct trace {
    size_t width, count, room, stride, pending;
    double *rows; /* (count, width) */
} trace;

typedef struct watch {
    const simulation *sim;
    double *work;
    size_t invariants;
    double *start, *end, *drift; /* (invariants); drift: largest |I - I(start)| */
    bool energetic;              /* the first invariant is the energy */
    double *rest, kinetic;       /* (dim): a state without its velocities; the largest kinetic energy */
    double manifold;             /* largest */
    double spent;                /* seconds */
    bool traced;
    trace trace;
    bool recorded; /* keeps all steps */
    double *t, *h; /* (steps) */
    size_t steps, room;
} watch;

void watch_begin(watch *self, const simulation *sim, bool traced, bool recorded, const double *y0);
lg_status watch_step(void *self, double t, double h, const double *y);
/* Warns of steps that are too long: rotations beyond pi in a step, an energy that changes. */
void watch_warn(const watch *self, const plan *how, const outcome *run);
void watch_end(watch *self);

/* ---- where states are kept (samples.c) ---- */

/* t (count) of all rows; the first is the start, the last t_end. Those from `first` on, `kept` of them, were
 * asked for. */
typedef struct samples {
    size_t count, first, kept;
    double *t, *y; /* (count), (count, dim) */
} samples;

/* By --points, --times, and the steps of the method; without `wanted` the start and the end alone. */
void samples_choose(const simulation *sim, const plan *how, bool wanted, samples *out);
void samples_free(samples *self);

/* ---- results ---- */

typedef struct gradient {
    size_t count;    /* of weights: sim->reported */
    double *weights; /* (dim), zero beyond */
    double j;
    double *dy0;         /* (dim), projected */
    double *dparameters; /* (lg_system_parameter_count) */
    lg_adjoint_stats stats;
} gradient;

/* gradient.c: weights from --gradient; then the gradient over the recorded steps. */
void gradient_read(const simulation *sim, gradient *out);
void gradient_compute(const simulation *sim, const lg_scheme *scheme, const watch *seen, gradient *out);
void gradient_free(gradient *self);

typedef struct report {
    const simulation *sim;
    const plan *how;
    const outcome *run;
    const watch *seen;
    const samples *path;
    const gradient *slope; /* NULL: none */
} report;
void report_run(const report *what); /* report.c */

/* output.c: --out */
lg_status write_trajectory(const report *what, lg_error *error);

/* pictures.c: --plot. 3d: whether there is a picture in space of this system. */
bool has_space_picture(const simulation *sim);
lg_status draw_run(const report *what, lg_error *error);

/* precision.c: --work-precision */
void work_precision(simulation *sim);

#endif
