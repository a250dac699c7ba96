/* The walk of windows over the rows of a log, with residuals and their Jacobian: row_axes.c, chain.c,
 * interval_plan.c, jacobian.c.
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
 * in place of the velocities. The Jacobian of a is dG/dz S + (dG/dtheta, 0). Runs, losses and estimates of
 * states pass the same rows without derivatives. */
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

typedef struct lg_chain {
    lg_tape *tape;
    const lg_machine_problem *problem;
    const double *theta;
    uint32_t samples[LG_FIT_CHUNK]; /* (count): which windows of the problem */
    /* count: windows; shared: learned parameters of the machine; own: numbers of a start; columns: shared +
     * own, 0 without derivatives; rows: residuals of one window; powers: of the time in the inputs of the
     * log, 1 or 4; 0: not counted yet. */
    size_t count, shared, own, columns, rows;
    uint32_t powers;
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
    double loss, *losses;     /* squared residuals of all windows; (count): of each, or NULL */
    double *r, *jacobian;     /* NULL: only the loss is wanted */
    struct lg_chain *against; /* a chain of the same windows that residuals compare with; NULL: the log */
    size_t done;              /* rows of r and jacobian that are filled in each window */
    double *memory;
    size_t bytes;
} lg_chain;

/* Prepares `count` <= LG_FIT_CHUNK windows of a problem, those of `samples`, or with NULL those from `first`
 * on. `derived`: with derivatives. The memory is the tape's; lg_chain_close gives it back. */
lg_status lg_chain_open(lg_tape *tape, const lg_machine_problem *problem, const double *theta,
                        const uint32_t *samples, size_t first, size_t count, bool derived, lg_chain *c);
void lg_chain_close(lg_chain *c);
/* The first point of a window that has residuals: 0 if starts are estimated, else 1. */
uint32_t lg_chain_first(const lg_machine_problem *problem);
/* Sets z and S at the first points of all windows. */
lg_status lg_chain_first_points(lg_chain *c);
/* Moves z and S to the next points. */
lg_status lg_chain_advance(lg_chain *c);
/* If accelerations are measured, computes those of the current points (a), and their derivatives (of_a). */
lg_status lg_chain_show(lg_chain *c);
/* Row s of z with what the log shows in place of the velocities. */
void lg_chain_shown(const lg_chain *c, size_t s, double *out);
/* Row s of z in the units of the log. */
void lg_chain_read(const lg_chain *c, size_t s, double *positions, double *velocities);
/* Fills `next` and A of the intervals from the current points by a plan; `moved` becomes (dF/dtheta, 0)
 * (interval_plan.c). False: there is no plan. */
bool lg_chain_plan_interval(lg_chain *c);
/* Adds r^2 of window s to the loss. */
void lg_chain_add(lg_chain *c, size_t s, double r);
/* All points of all windows. */
lg_status lg_chain_pass_windows(lg_chain *c);

#endif
