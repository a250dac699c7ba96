/* Declarations that the commands of lg-elastica share: boundary conditions as options, curves, learned
 * curves, plots. A function that does not return a status ends the command if it fails. */
#ifndef LG_APPS_BEAM_H
#define LG_APPS_BEAM_H

#include "common/app.h"
#include "elastica/elastica.h"

extern const app_command elastica_solve_command, elastica_generate_command, elastica_evaluate_command,
    elastica_predict_command;

/* ---- options for beams (boundary.c) ---- */

extern const char *const case_names[]; /* indexed by lg_elastica_case */

/* The options that commands share: their values and rows, as entries of a command's settings. */
typedef struct beam_values {
    double length, stiffness;
    uint64_t intervals;
    double q0[2], qN[2];
    int kind; /* index into case_names */
    double x, theta0, thetaN, rotation;
} beam_values;
extern beam_values beam_given;
extern const lg_field beam_rows[], end_rows[], boundary_rows[];
/* The rows of --case, for a member `kind`, and of --continuous. */
#define BEAM_CASE(type, ...) LG_OPTION(type, kind, NAME, NULL, __VA_ARGS__, .option = "case")
#define CONTINUOUS(type)                                                                                     \
    LG_OPTION(type, continuous, SWITCH, NULL,                                                                \
              "Solve the differential equation instead of the discrete problem", .usual = true,              \
              .without = "branches,sweep")
#define BEAM     APP_GIVEN(beam_rows, beam_given) /* length, stiffness, intervals */
#define ENDS     APP_GIVEN(end_rows, beam_given)
#define BOUNDARY APP_GIVEN(boundary_rows, beam_given)

#define BOUNDARY_ROTATIONS 3

/* Boundary conditions and the possible rotations: the given rotation, or B - A wrapped to (-pi, pi], one turn
 * less and one turn more. `chosen` is the rotation of the case or the given one; otherwise NaN. */
typedef struct boundary {
    lg_elastica problem; /* its rotation is `chosen`, or rotation[0] without a choice */
    size_t count;
    double rotation[BOUNDARY_ROTATIONS], chosen;
} boundary;

/* The beam of the options; the end angles are not set yet. */
lg_elastica beam_problem(const app *app);
/* Reads the boundary conditions. `problem` has the values that the options do not set. `kind` is the case if
 * --x is given without --case. */
void boundary_read(const app *app, const lg_elastica *problem, lg_elastica_case kind, boundary *out);
/* Sets all possible rotations for a pair of end angles. */
void boundary_rotations(double theta0, double thetaN, boundary *out);
/* Writes the boundary conditions as a vector: q0, v0, qN, vN. */
void boundary_vector(const lg_elastica *problem, double x[8]);

/* ---- curves (curves.c) ---- */

/* Points of a curve. */
typedef struct beam_nodes {
    size_t count;
    double *s, *q, *v, *theta; /* (count), (count, 2), (count, 2), (count) */
} beam_nodes;
beam_nodes beam_nodes_create(size_t count);

/* An equilibrium, given at its N + 1 nodes. */
typedef struct beam_curve {
    lg_elastica problem; /* with the rotation of this curve */
    beam_nodes at;
    lg_elastica_solution solution;
} beam_curve;

/* Solves for the equilibrium with the chosen rotation, or, without a choice, for the one with the lowest
 * energy. */
void beam_solve(const app *app, const boundary *where, const lg_elastica_options *options, bool continuous,
                beam_curve *out);

typedef struct beam_curves {
    size_t count;
    beam_curve *list; /* in rising order of energy */
    bool full;        /* the search stopped because the list was full */
} beam_curves;
/* Finds all equilibria of the discrete problem that the library can find, for all rotations of the boundary
 * conditions. */
lg_status beam_branches(const lg_context *context, const boundary *where, const lg_elastica_options *options,
                        bool saddles, beam_curves *out, lg_error *error);
/* Root mean square, over the nodes, of the difference of the tangents. Both curves must have the same N. */
double beam_distance(const beam_curve *a, const beam_curve *b);

/* Writes a CSV file with the columns s,x,y,vx,vy,theta; `numbered` puts a column `branch` first. Writes
 * nothing if `path` is NULL. */
const char *curves_head(bool numbered); /* the line of the column names */
void write_curves(const app *app, const char *path, const beam_curve *curves, size_t count, bool numbered);
/* Writes q, v and theta. For people it prints a table of about ten nodes, or of all nodes. */
void result_nodes(app_json *out, const beam_nodes *nodes, bool all);

/* ---- plots ---- */

/* Writes a data block with a beam, interpolated by cubic Hermite polynomials. */
void put_beam(app_plot *plot, const beam_curve *curve);

#endif
