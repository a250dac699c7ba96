/* Declarations that the commands of lg-elastica share: boundary conditions as options, curves, learned
 * curves, pictures. A function without a status ends the command where it fails. */
#ifndef LG_APPS_BEAM_H
#define LG_APPS_BEAM_H

#include "common/app.h"
#include "liegrad/elastica.h"
#include "liegrad/io.h"

extern const app_command solve_command, generate_command, train_command, evaluate_command, predict_command,
    search_command;

/* ---- beams as options (boundary.c) ---- */

extern const char *const case_names[]; /* in the order of lg_elastica_case */

/* Parts of a command's values. */
typedef struct end_values {
    lg_reals q0, qN;
} end_values;

typedef struct beam_values {
    double length, stiffness;
    uint64_t intervals;
} beam_values;

typedef struct boundary_values {
    int kind; /* position in case_names */
    double x, theta0, thetaN, rotation;
    end_values ends;
} boundary_values;

#define END_ROWS(type, field, begins, ends_at)                                                               \
    LG_OPTION(type, field.q0, REALS, "X,Y", "Where the beam begins (default " begins ")", .option = "q0",    \
              LG_ANY_REAL),                                                                                  \
        LG_OPTION(type, field.qN, REALS, "X,Y", "Where it ends (default " ends_at ")", .option = "qN",       \
                  LG_ANY_REAL)

#define BEAM_ROWS(type, field)                                                                               \
    LG_OPTION(type, field.length, REAL, "L", "Length of the beam", .option = "length", LG_POSITIVE,          \
              .value = "3.3"),                                                                               \
        LG_OPTION(type, field.stiffness, REAL, "EI", "Bending stiffness", .option = "stiffness",             \
                  LG_POSITIVE, .value = "10"),                                                               \
        LG_OPTION(type, field.intervals, U64, "N", "Number of equal intervals between the nodes",            \
                  .option = "intervals", .low = LG_ELASTICA_MIN_INTERVALS,                                   \
                  .high = LG_ELASTICA_MAX_INTERVALS, .value = "50")

#define BOUNDARY_ROWS(type, field, case_default, begins, ends_at)                                            \
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
        END_ROWS(type, field.ends, begins, ends_at)

#define BOUNDARY_ROTATIONS 3

/* Boundary conditions and the possible rotations: the given one, or B - A wrapped to (-pi, pi], one turn less
 * and one turn more. `chosen` is the rotation of the case or the given one; NaN otherwise. */
typedef struct boundary {
    lg_elastica problem; /* with the first rotation */
    size_t count;
    double rotation[BOUNDARY_ROTATIONS], chosen;
} boundary;

/* A beam with these ends, without angles. */
lg_elastica beam_problem(const app *app, const beam_values *beam, const end_values *ends);
/* `problem`: what the options do not say. `kind`: the case when --x is given alone. */
void boundary_read(const app *app, const boundary_values *values, const lg_elastica *problem,
                   lg_elastica_case kind, boundary *out);
/* All rotations of a pair of end angles. */
void boundary_rotations(double theta0, double thetaN, boundary *out);
/* An angle wrapped to (-pi, pi]. */
double wrap_angle(double angle);
/* q0, v0, qN, vN. */
void boundary_vector(const lg_elastica *problem, double x[8]);

/* ---- curves (curves.c) ---- */

/* Points of a curve, arrays owned. */
typedef struct beam_nodes {
    size_t count;
    double *s, *q, *v, *theta; /* (count), (count, 2), (count, 2), (count) */
} beam_nodes;
beam_nodes beam_nodes_create(size_t count);
void beam_nodes_destroy(beam_nodes *nodes);

/* An equilibrium at the N + 1 nodes. */
typedef struct beam_curve {
    lg_elastica problem; /* with the curve's own rotation */
    beam_nodes at;
    lg_elastica_solution solution;
} beam_curve;
beam_curve beam_curve_create(const lg_elastica *problem);
void beam_curve_destroy(beam_curve *curve);

/* The equilibrium with the chosen rotation, or without one the equilibrium of lowest energy. */
void beam_solve(const app *app, const boundary *where, const lg_elastica_options *options, bool continuous,
                beam_curve *out);

typedef struct beam_curves {
    size_t count;
    beam_curve *list; /* by rising energy */
    bool full;        /* the search stopped because the list was full */
} beam_curves;
/* All equilibria of the discrete problem that the library finds, over the boundary's rotations. `out` is
 * destroyed after failures too. */
lg_status beam_branches(const lg_context *context, const boundary *where, const lg_elastica_options *options,
                        bool saddles, beam_curves *out, lg_error *error);
void beam_curves_destroy(beam_curves *curves);
/* Root of the mean square of the tangents' differences; equal N. */
double beam_distance(const beam_curve *a, const beam_curve *b);

/* Columns s,x,y,vx,vy,theta; with `numbered` `branch` before them. No file where `path` is NULL. */
void write_curves(const app *app, const char *path, const beam_curve *curves, size_t count, bool numbered);
/* q, v and theta; people see a table of about ten points, or of all. */
void result_nodes(app_json *out, const beam_nodes *nodes, bool all);

/* lg-elastica solve --sweep (sweep.c): `problem` tells everything but x. */
typedef struct sweep_values {
    size_t points;
    lg_elastica problem;
    lg_elastica_case kind;
    bool saddles;
    const char *out, *plot;
} sweep_values;
void sweep_run(const app *app, const sweep_values *values, const lg_elastica_options *options);

/* ---- learned curves (learned.c) ---- */

/* Curves whose boundary conditions lie farther from the trained ones than twice their reach. NaN for a model
 * without the boundary conditions of its training part: it has no range. */
typedef struct outside {
    double reach, largest; /* largest distance */
    size_t count;
} outside;
/* `chosen`: rows of `boundary`; NULL: the first ones. */
outside count_outside(const lg_surrogate_file *file, const double *boundary, const uint32_t *chosen,
                      size_t count);

/* A network's curves at `points` points, or fewer. */
typedef struct learned {
    lg_surrogate_curves *curves;
    void *work;
} learned;
learned learned_open(const app *app, const lg_surrogate_file *file, size_t points);
void learned_close(learned *curves);
/* Arc length k of n equidistant ones on [0, length]. */
double equidistant(double length, size_t k, size_t n);

/* ---- pictures (pictures.c); where `picture` is NULL nothing is drawn ---- */

/* Curves in the plane, equal axes; `labelled`: with their energies. */
void draw_curves(const app *app, const char *picture, const beam_curve *curves, size_t count, bool labelled);
/* Curves of a set, evenly chosen. */
void draw_set(const app *app, const char *picture, const lg_elastica_curves *curves);

typedef struct sweep_point {
    double x, energy;
    uint32_t negative_eigenvalues;
    double rotation;
    size_t branch;
} sweep_point;
/* Ordered by branch, then x. */
void draw_sweep(const app *app, const char *picture, const sweep_point *points, size_t count);

/* `shown` curves of (intervals + 1) nodes each, true and learned; node_error (N + 1, 2). */
typedef struct comparison {
    size_t shown;
    uint32_t intervals;
    double length;
    const double *true_q, *true_v, *q, *v; /* (shown, N + 1, 2) */
    const double *node_error;
    const char *title;
} comparison;
void draw_comparison(const app *app, const char *picture, const comparison *what);

/* A learned curve and, when not NULL, a solution. */
void draw_prediction(const app *app, const char *picture, const beam_curve *curve, const beam_curve *truth);

#endif
