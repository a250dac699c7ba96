/* Residuals of windows and their Jacobian, interval by interval: row_axes.c, chain.c, interval_plan.c,
 * long_windows.c, jacobian.c.
 *
 * z = (positions, velocities) of a row, in the order of logs. An interval maps z of one row to z of the
 * next row, z' = F(z, theta). A change of z has d components along axes: one for each place and velocity,
 * three rotations of a direction (a x q) and three of a rotation (R hat(a)). The bristles of LuGre
 * friction follow in z behind the velocities; they have no residuals. At its first row a window has the
 * bristles of lg_machine_start_bristles. S = dz/d(theta, numbers of the window's start) has the shape (d,
 * columns) and follows
 *   S' = A S + (dF/dtheta, 0),  A = dF/dz.
 * One row of A and dF/dtheta takes one reverse sweep over all windows of the chunk. If theta is known, S
 * has no columns for it. Where accelerations are measured, the residuals compare a = G(z, theta) with the log
 * in place of the velocities. The Jacobian of a is dG/dz S + (dG/dtheta, 0). */
#ifndef LG_MACHINE_CHAIN_H
#define LG_MACHINE_CHAIN_H

#include "kernels/kernels.h"
#include "machine/internal.h"

enum { LG_CHAIN_NUMBERS = LG_MACHINE_POSITIONS + 2 * LG_MACHINE_VELOCITIES };

/* ---- axes (row_axes.c) ---- */

typedef struct lg_row_axis {
    enum { LG_ALONG, LG_TURN_DIRECTION, LG_TURN_ROTATION } kind;
    uint32_t first; /* index in z of the only number that changes, or of the first of 3 or 9 */
    uint32_t turn;  /* index of the rotation axis, in space for a direction, in the body for a rotation */
    uint32_t coordinate; /* index; 0 for bristles */
    bool turns;          /* it is an attitude, or the rate of one; no meaning for bristles */
} lg_row_axis;

typedef struct lg_row_axes {
    uint32_t count, numbers, seen; /* d; numbers of z; axes with residuals */
    lg_row_axis each[LG_CHAIN_NUMBERS];
} lg_row_axes;

/* Axes in the order of the numbers of a start: places, directions, rotations, velocities. */
lg_row_axes lg_row_axes_of(const lg_machine *machine);
/* How many numbers of z, from a->first on, change along an axis. */
uint32_t lg_row_axis_width(const lg_row_axis *a);
/* The change of these numbers: 1 for a place or velocity, e_k x q for a direction, the rows r_i x e_k for a
 * rotation. */
void lg_row_axis_change(const lg_row_axis *a, const double *z, double *out);
/* Squared length of the change along an axis. */
double lg_row_axis_square(const lg_row_axis *a);
/* The change along an axis at z, times the numbers x. */
double lg_row_axis_component(const lg_row_axis *a, const double *z, const double *x);

/* ---- chains: windows that are passed from row to row (chain.c) ---- */

/* All rows of one window of M rows that are solved for together (long_windows.c). */
typedef struct lg_chain_run {
    double *z, *F, *A, *B; /* (M, numbers), (M - 1, numbers), (M - 1, d, d), (M - 1, d, shared) */
    double *dz, *apart;    /* of LG_FIT_CHUNK rows */
} lg_chain_run;

typedef struct lg_chain {
    const lg_machine_problem *problem;
    const double *theta;
    const uint32_t *samples;
    /* count: windows; shared: learned parameters of the machine; own: numbers of a start; columns: shared +
     * own; rows: residuals of one window. */
    size_t count, shared, own, columns, rows;
    double factor;
    lg_row_axes axes;
    size_t at[LG_FIT_CHUNK]; /* (count): the log's rows of the current points */
    uint32_t point;          /* of the windows, from 0 on */
    double *z, *next;        /* (count, numbers): z of the current and of the next points */
    double *dz;              /* (count, numbers): gradient with respect to z */
    double *A;               /* (count, d, d): dF/dz; of accelerations (count, velocities, d): dG/dz */
    double *apart;           /* (count, shared): gradient with respect to theta for each window */
    double *S, *moved;       /* (count, d, columns): S of the current and of the next points */
    /* Where accelerations are measured: those of the current points, (count, velocities), and their rows of
     * the Jacobian, (count, velocities, columns). */
    double *a, *of_a;
    double *r, *jacobian; /* NULL: only the loss is computed, of a machine without directions */
    double loss;
    size_t done;             /* rows of r and jacobian that are filled in each window */
    const lg_chain_run *run; /* NULL: each interval is computed when it is passed */
} lg_chain;

/* Places arrays one after the other in `memory` (NULL: only counts); returns how many numbers they have. */
typedef struct lg_chain_array {
    double **at;
    size_t length;
} lg_chain_array;
size_t lg_chain_place(const lg_chain_array *arrays, size_t count, double *memory);
/* The same for the arrays of a chain. */
size_t lg_chain_place_all(lg_chain *c, double *memory);
/* The first point of a window that has residuals: 0 if starts are estimated, else 1. */
uint32_t lg_chain_first(const lg_machine_problem *problem);
/* Sets z and S at the first points of all windows. */
lg_status lg_chain_first_points(lg_tape *tape, lg_chain *c);
/* Fills `next` and A of the intervals from the current points; `moved` becomes (dF/dtheta, 0). */
lg_status lg_chain_interval(lg_tape *tape, lg_chain *c);
/* The same by a plan (interval_plan.c). False: the machine has none. */
bool lg_chain_plan_interval(lg_tape *tape, lg_chain *c);
/* All points of all windows; intervals come from `run`, which has been solved for, if it is not NULL. */
lg_status lg_chain_pass_windows(lg_tape *tape, lg_chain *c);

/* ---- long windows (long_windows.c) ---- */

/* As lg_chain_pass_windows, each window by itself. floor: if not NULL, it is computed in place of everything
 * else. */
lg_status lg_chain_pass_long(lg_tape *tape, lg_chain *all, double *floor);

#endif
