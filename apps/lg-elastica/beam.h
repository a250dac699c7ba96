/* Declarations that the commands of lg-elastica share: boundary conditions as options, curves, models,
 * pictures. Functions that return int return an exit code, and have printed a message when it is not
 * APP_EXIT_OK. Functions that return a status explain a failure in `error`. */
#ifndef LG_APPS_BEAM_H
#define LG_APPS_BEAM_H

#include "common/app.h"
#include "liegrad/elastica.h"
#include "liegrad/io.h"

extern const app_command solve_command, generate_command, train_command, evaluate_command, predict_command,
    search_command;

/* ---- boundary conditions as options (boundary.c) ---- */

extern const char *const case_names[]; /* in the order of lg_elastica_case */

/* A part of a command's values. */
typedef struct boundary_values {
    int kind; /* position in case_names */
    double x, theta0, thetaN, rotation;
    lg_reals q0, qN;
} boundary_values;

#define BOUNDARY_ROWS(type, field, case_default, end_default)                                                \
    LG_OPTION(type, field.kind, NAME, NULL,                                                                  \
              "both-ends (theta0 = x, theta(L) = -x) or right-end (theta0 = 0, theta(L) = -x), x "           \
              "wrapped to (-pi, pi] (default " case_default ")",                                             \
              .option = "case", .names = case_names),                                                        \
        LG_OPTION(type, field.x, REAL, "X", "The case's parameter, radians", .option = "x", .low = -1e6,     \
                  .high = 1e6),                                                                              \
        LG_OPTION(type, field.theta0, REAL, "A", "Instead: tangent angle at s = 0, radians",                 \
                  .option = "theta0", .low = -1e6, .high = 1e6),                                             \
        LG_OPTION(type, field.thetaN, REAL, "B", "and at s = L", .option = "thetaN", .low = -1e6,            \
                  .high = 1e6),                                                                              \
        LG_OPTION(type, field.rotation, REAL, "R",                                                           \
                  "Turning of the tangent along the beam: B - A and whole turns (default: that of lowest "   \
                  "energy among B - A and one turn more or less)",                                           \
                  .option = "rotation", .low = -1e6, .high = 1e6),                                           \
        LG_OPTION(type, field.q0, REALS, "X,Y", "Where the beam begins (default " end_default ")",           \
                  .option = "q0", LG_ANY_REAL),                                                              \
        LG_OPTION(type, field.qN, REALS, "X,Y", "Where it ends (default likewise)", .option = "qN",          \
                  LG_ANY_REAL)

#define BOUNDARY_ROTATIONS 3

/* Boundary conditions and the possible rotations: the given one, or B - A wrapped to (-pi, pi], one turn less
 * and one turn more. `chosen` is the rotation of the case or the given one; NaN otherwise. */
typedef struct boundary {
    lg_elastica problem; /* with the first rotation */
    size_t count;
    double rotation[BOUNDARY_ROTATIONS], chosen;
} boundary;

/* `problem`: what the options do not say. `kind`: the case when --x is given alone. */
int boundary_read(const app *app, const boundary_values *values, const lg_elastica *problem,
                  lg_elastica_case kind, boundary *out);
/* --q0 and --qN, where given, into *problem. */
int boundary_ends(const app *app, const boundary_values *values, lg_elastica *problem);
/* All rotations of a pair of end angles. */
void boundary_rotations(double theta0, double thetaN, boundary *out);
/* An angle wrapped to (-pi, pi]. */
double wrap_angle(double angle);
/* q0, v0, qN, vN. */
void boundary_vector(const lg_elastica *problem, double x[8]);

/* ---- curves (curves.c) ---- */

/* An equilibrium at the N + 1 nodes, arrays owned. */
typedef struct beam_curve {
    lg_elastica problem; /* with the curve's own rotation */
    double *theta, *q, *v;
    lg_elastica_solution solution;
} beam_curve;
beam_curve beam_curve_create(const lg_elastica *problem);
void beam_curve_free(beam_curve *curve);

/* The equilibrium with the chosen rotation, or without one the equilibrium of lowest energy. Prints
 * failures. */
int beam_solve(const app *app, const boundary *where, const lg_elastica_options *options, bool continuous,
               beam_curve *out);

typedef struct beam_curves {
    size_t count;
    beam_curve *list; /* by rising energy */
    bool full;        /* the search stopped because the list was full */
} beam_curves;
/* All equilibria of the discrete problem that the library finds, over the boundary's rotations. */
lg_status beam_branches(const lg_context *context, const boundary *where, const lg_elastica_options *options,
                        bool saddles, beam_curves *out, lg_error *error);
void beam_curves_free(beam_curves *curves);
/* Root of the mean square of the tangents' differences; equal N. */
double beam_distance(const beam_curve *a, const beam_curve *b);

/* Columns s,x,y,vx,vy,theta; with more than one curve `branch` before them. */
lg_status write_curves(const char *path, const beam_curve *curves, size_t count, bool numbered,
                       lg_error *error);
/* (count, 2) as an array of pairs. */
void json_pairs(app_json *json, const char *key, const double *values, size_t count);

/* lg-elastica solve --sweep (sweep.c): `where` tells everything but x. */
typedef struct sweep_values {
    size_t points;
    lg_elastica problem;
    lg_elastica_case kind;
    bool saddles;
    const char *out, *plot;
} sweep_values;
int sweep_run(const app *app, const sweep_values *values, const lg_elastica_options *options);

/* ---- data (families.c) ---- */

/* Curves whose boundary conditions lie farther from the trained ones than twice their reach. */
typedef struct outside {
    double reach, largest; /* largest distance */
    size_t count;
} outside;
outside count_outside(const lg_surrogate *model, const double *trained, size_t trained_count,
                      const double *boundary, const uint32_t *chosen, size_t count);

/* ---- pictures (pictures.c) ---- */

/* Curves in the plane, equal axes; `labels` (count) may be NULL. */
lg_status draw_curves(const app *app, const char *picture, const beam_curve *curves, size_t count,
                      char *const *labels, lg_error *error);
/* Curves of a set, evenly chosen. */
lg_status draw_set(const app *app, const char *picture, const lg_elastica_curves *curves, lg_error *error);

typedef struct sweep_point {
    double x, energy;
    uint32_t negative_eigenvalues;
    double rotation;
    size_t branch;
} sweep_point;
/* Ordered by branch, then x. */
lg_status draw_sweep(const app *app, const char *picture, const sweep_point *points, size_t count,
                     lg_error *error);

/* `shown` curves of (intervals + 1) nodes each, true and learned; node_error (N + 1, 2). */
typedef struct comparison {
    size_t shown;
    uint32_t intervals;
    double length;
    const double *true_q, *true_v, *q, *v; /* (shown, N + 1, 2) */
    const double *node_error;
    const char *title;
} comparison;
lg_status draw_comparison(const app *app, const char *picture, const comparison *what, lg_error *error);

/* A learned curve (points, 2) and, when not NULL, a solution. */
lg_status draw_prediction(const app *app, const char *picture, const double *q, size_t points,
                          const beam_curve *truth, lg_error *error);

#endif
