/* Declarations that the files of lg-simulate share: the scene, methods, runs, and what is observed along a
 * run. Wrong options and files end the command. Functions that return a status explain a failure in
 * `error`. */
#ifndef LG_APPS_SIMULATE_H
#define LG_APPS_SIMULATE_H

#include "common/app.h"
#include "liegrad/integrators.h"
#include "liegrad/mechanics.h"
#include "liegrad/taped.h"

typedef struct simulate_values {
    const char *scheme, *out, *schemes, *gradient;
    const char *vary, *members, *event, *task; /* options of --ensemble */
    uint64_t steps, points, checkpoints, levels, max_steps, ensemble;
    uint64_t save;    /* 0: none; all: more than there are members */
    uint64_t dexpinv; /* LG_DEXPINV_MAX + 1: exact */
    double tolerance, atol, t_end, theta;
    lg_reals times;
    bool work_precision;
} simulate_values;

/* ---- the scene (scene.c) ---- */

/* Consecutive numbers of a state or of a list of parameters, e.g. a vector or a matrix. */
typedef struct block {
    const char *key;
    size_t index;  /* from 1; 0 if there is only one block with this key */
    size_t offset; /* index of the block's first number */
    size_t count;
    size_t columns; /* columns of a matrix; 1 for a vector */
} block;

typedef struct simulation {
    app *self;
    const simulate_values *values;
    lg_scene scene;
    const lg_system *system;
    char title[64]; /* for example "heavy-top, cotangent" */
    size_t dim, reported;
    double t_end;
    double *work; /* work memory of the fields */
    lg_system_user user[2];
    lg_ode ode[2]; /* indexed by lg_coordinates */
    block *blocks; /* blocks of the reported part of the state, in order of their offsets */
    size_t block_count;
} simulation;

/* Reads the scene and checks --t-end and --times. */
void simulation_open(app *self, const simulate_values *values, const char *path, simulation *out);

/* Writes the name of a block, such as "q2" or "R". */
void block_name(const block *at, char *text, size_t size);
/* The name of one of its numbers, such as "x", "13" or "4"; "" if it has only one. */
void block_part(const block *at, size_t component, char *text, size_t size);
/* The values of the parameter with this key in scenes, *count of them. NULL if the system has no such
 * parameter. */
const double *parameter_values(const simulation *sim, const char *key, size_t *count);
/* The block of the state with this key and index; a block with index 0 fits any index. NULL if there is none.
 * Further blocks with the same key are in rising order of the index. */
const block *find_block(const simulation *sim, const char *key, size_t index);

/* ---- methods (method.c) ---- */

typedef struct method {
    lg_scheme scheme;
    lg_scheme *file; /* owned scheme that was read from a file, or NULL */
} method;

/* The method that --scheme, --theta and --dexpinv ask for; by default rkmk54, and dp54 on R^n. */
method method_choose(const simulation *sim);
/* The method of this name, or of this file: its path has a point or a slash. */
method method_named(const simulation *sim, const char *option, const char *name);
/* Changes the scheme as --theta and --dexpinv say; ends the command if it has no such parameter. */
void method_adjust(const simulation *sim, method *what);
void method_free(method *what);
/* Ends the command if the method cannot estimate its error and --steps is not given. */
void check_control(const simulation *sim, const lg_scheme *scheme);
/* Returns NULL if the scheme applies to the system, otherwise the reason why it does not. */
const char *method_obstacle(const simulation *sim, const lg_scheme *scheme);

/* ---- runs (run.c) ---- */

typedef struct plan {
    const lg_scheme *scheme;
    lg_step_controller control; /* its observer is called after each step; may be NULL */
    double t_end;               /* > 0 */
    /* (count): times at which the state is wanted, ascending in (0, t_end]; the last one is t_end. */
    const double *times;
    size_t count;
} plan;

typedef struct outcome {
    lg_run_stats stats;
    double seconds, cpu; /* time of the integration, including the observer */
    double t;            /* time that was reached */
} outcome;

/* Sets steps and tolerances from the command line. */
void plan_init(const simulation *sim, const lg_scheme *scheme, plan *out);
/* Sets the relative tolerance to `tol`, and the absolute one from --atol or, without --atol, from `tol`. */
void plan_tolerance(const simulation *sim, double tol, plan *out);
/* Integrates from y0 (dim) to each of the times; rows (count, dim) are the states there. Ctrl-C ends it with
 * LG_CANCELLED. On failure the rows that were not reached are NaN, and `out` is filled. `error` may be
 * NULL. */
lg_status integrate(const simulation *sim, const plan *how, const double *y0, double *rows, outcome *out,
                    lg_error *error);

/* A single run. */
void run_once(const simulation *sim);

/* ---- what is observed along a run (watch.c) ---- */

/* A list of rows (t, h, manifold error, drift of each invariant), one row per accepted step. If there are
 * many steps, a row stands for several of them and has their largest values. */
typedef struct trace {
    size_t width, count, stride, pending;
    double *rows; /* (count, width) */
} trace;

typedef struct watch {
    const simulation *sim;
    double *work;
    size_t invariants;
    double *start, *end, *drift; /* (invariants) each; drift: largest |I - I(start)| */
    bool energetic;              /* the first invariant is the energy */
    /* rest (dim): the state with velocities set to zero; kinetic: largest kinetic energy. */
    double *rest, kinetic;
    double manifold, placed; /* largest distance from the manifold; of the positions alone */
    double spent;            /* seconds spent on observing */
    bool traced;
    trace trace;
    bool recorded; /* t and h of all steps are kept */
    double *t, *h; /* (steps) */
    size_t steps, room;
} watch;

void watch_begin(watch *self, const simulation *sim, bool traced, bool recorded, const double *y0);
/* Begins another run, from y0. What was traced and recorded stays. */
void watch_again(watch *self, const double *y0);
lg_status watch_step(void *self, double t, double h, const double *y);
/* Whether the energy has changed more than its largest kinetic part allows; whether a constraint is
 * violated. */
bool watch_lost_energy(const watch *self, const lg_scheme *scheme);
bool watch_left_manifold(const watch *self);
/* Warns if the steps are too long: a rotation by more than pi in a step, or a change of the energy. */
void watch_warn(const watch *self, const plan *how, const outcome *run);

/* ---- times at which states are kept (samples.c) ---- */

/* All rows of a run: t (count), of which the first is the start and the last is t_end. The `kept` rows from
 * `first` on are those that the user asked for. */
typedef struct samples {
    size_t count, first, kept;
    double *t, *y; /* (count); (count, dim) */
} samples;

/* Only the times of --times, or of --points, `otherwise` by default. */
void samples_times(const simulation *sim, size_t otherwise, samples *out);

/* Chooses the times from --points, --times, or the steps of the method. Without `wanted`, only the start and
 * the end. */
void samples_choose(const simulation *sim, const plan *how, bool wanted, samples *out);

/* ---- results ---- */

typedef struct gradient {
    size_t count;    /* number of weights: sim->reported */
    double *weights; /* (dim); zero from `count` on */
    double j;
    double *dy0;         /* (dim): gradient in the start, projected onto the tangent space */
    double *dparameters; /* (lg_system_parameter_count) */
    lg_adjoint_stats stats;
} gradient;

/* In gradient.c: gradient_read reads the weights from --gradient; gradient_compute computes the gradient over
 * the recorded steps. */
void gradient_read(const simulation *sim, gradient *out);
void gradient_compute(const simulation *sim, const lg_scheme *scheme, const watch *seen, gradient *out);

typedef struct report {
    const simulation *sim;
    const plan *how;
    const outcome *run;
    const watch *seen;
    const samples *path;
    const gradient *slope; /* NULL without --gradient */
} report;

/* plots.c: the plots of a run, and the bits that they need. */
extern const app_plot_kind simulate_plots[];
unsigned simulate_has(const simulation *sim);

/* precision.c: compares methods, for --work-precision. */
void work_precision(simulation *sim);

#endif
