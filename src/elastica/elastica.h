/* Internals of the elastica: the problem in the frame of its chord, and the searches in that frame.
 *
 * Lengths are measured in L, energies in EI/L, and the chord q_N - q_0 = (d, 0) lies along the x axis. The
 * number of intervals, d and the two end angles describe the problem completely.
 */
#ifndef LG_ELASTICA_INTERNAL_H
#define LG_ELASTICA_INTERNAL_H

#include "core/core.h"
#include "liegrad/elastica.h"

#define LG_PI 3.14159265358979323846

typedef struct lg_beam {
    size_t n;     /* intervals, >= 2 */
    double d;     /* chord, in [0, 1) */
    double first; /* theta_0, in (-pi, pi] unless the caller's choice of turns is kept */
    double last;  /* theta_N */
} lg_beam;

/* The way back to the caller's frame: theta = theta_beam + turn, force = rotation(chord) force_beam *
 * EI/L^2. */
typedef struct lg_beam_frame {
    lg_beam beam;
    double turn, chord;
    double energy, force; /* EI/L, EI/L^2 */
} lg_beam_frame;

lg_beam_frame lg_beam_frame_make(const lg_elastica *problem);

/* A point theta with its force, all derivatives there and a factorisation. One block of memory serves beams
 * of up to `room` intervals. Arrays have n + 1 entries; arrays over inner angles use entries 1..n-1. */
typedef struct lg_beam_work {
    const lg_context *context;
    size_t room;
    void *memory;
    double tolerance;  /* of the relative gradient */
    uint32_t limit;    /* Newton steps for one problem */
    bool keep_saddles; /* a stationary point is a result, whatever its inertia */

    double *theta;
    double force[2];    /* lambda */
    double energy;      /* E(theta), with 2 P r for the force */
    double *gradient;   /* of E, with `force` in place of 2 P r */
    double largest;     /* the largest term in the gradient */
    double defect[2];   /* r - lambda/(2 P) */
    double *diag, *off; /* the tridiagonal part T of the Hessian; off[k] couples k and k + 1 */
    double *ux, *uy;    /* U = h (-sin theta, cos theta) */

    double *pivot, *factor;  /* of T + shift h */
    double *z, *yx, *yy;     /* its inverse on -gradient, U */
    double capacity[3], det; /* 1/(2 P) + U^T (T + shift h)^-1 U: xx, xy, yy; its determinant */
    uint32_t negative;       /* eigenvalues of the shifted Hessian */
    double *saved;           /* point of the line search */
    double *base, *way;      /* points of an escape */
    double *before;          /* the last point but one of a continuation */
    uint32_t iterations;     /* counted up by every Newton step */
    uint32_t problems;
} lg_beam_work;

lg_status lg_beam_work_create(const lg_context *context, size_t room, lg_beam_work *out);
void lg_beam_work_destroy(lg_beam_work *work);

/* max |dE/dtheta_k|, and the same over the largest term. */
double lg_beam_gradient(const lg_beam *beam, const lg_beam_work *work);
double lg_beam_relative_gradient(const lg_beam *beam, const lg_beam_work *work);

typedef enum lg_beam_end {
    LG_BEAM_MINIMUM,
    LG_BEAM_SADDLE,
    LG_BEAM_FOLDED, /* neighbouring angles differ by pi or more: not the rotation asked for */
    LG_BEAM_LOST    /* no stationary point within the limit */
} lg_beam_end;

/* Goes downhill from work->theta, whose ends are set, to a stationary point. The point stays in `work` with
 * force, energy, gradient and inertia. Unless saddles are kept, the search leaves a saddle along its
 * direction of lowest curvature, both ways, and takes the lower one of the two minima. */
lg_beam_end lg_beam_minimise(const lg_beam *beam, lg_beam_work *work);
/* Newton's method without regard to the energy; steps are limited to half a radian. */
lg_beam_end lg_beam_stationary(const lg_beam *beam, lg_beam_work *work);
/* Implicit steps of the gradient flow, each 1/rate long or shorter. The flow removes the short waves
 * first. */
void lg_beam_flow(const lg_beam *beam, lg_beam_work *work, double rate, int steps);
/* The number of negative eigenvalues of the second variation at `theta` under `force`, with q_N - q_0 held
 * exactly. */
uint32_t lg_beam_inertia(const lg_beam *beam, lg_beam_work *work, const double theta[],
                         const double force[2]);
double lg_beam_energy(const lg_beam *beam, const double *theta);
/* Cubic interpolation between equidistant nodes; `to` and `from` do not overlap. */
void lg_beam_prolong(size_t from_n, const double *from, size_t to_n, double *to);
/* Number of intervals, <= n, of the coarse problem that finds the branch before `beam` itself is solved. */
size_t lg_beam_coarse(const lg_beam *beam);

/* Continuation from a moderate problem to this one; angles change by at most `step` between two problems. The
 * result stays in `work`. Errors: LG_CANCELLED, LG_OUT_OF_MEMORY; *end has the outcome otherwise. */
lg_status lg_beam_follow(const lg_beam *beam, lg_beam_work *work, double step, lg_beam_end *end);
/* Continuation from the solution of `from`, which is in work->theta, to `beam`; both have the same n. */
lg_status lg_beam_continue(const lg_beam *from, const lg_beam *beam, lg_beam_work *work, double step,
                           lg_beam_end *end);
/* Calls lg_beam_follow, and searches from many starts when that finds no minimum. */
lg_status lg_beam_solve(const lg_beam *beam, lg_beam_work *work, double step, lg_beam_end *end);

typedef struct lg_beam_branch {
    double energy, gradient, force[2];
    uint32_t negative, iterations;
} lg_beam_branch;
/* Distinct stationary points found from many starts, sorted by rising energy: branches (room), theta (room,
 * n + 1). If there are more than `room`, the lowest are kept. `quick`: fewer starts. */
lg_status lg_beam_search(const lg_beam *beam, lg_beam_work *work, bool saddles, bool quick, size_t room,
                         double *theta, lg_beam_branch *branches, size_t *count);

/* Copies the options, or the defaults for NULL. Error: LG_INVALID_ARGUMENT. */
lg_status lg_elastica_options_take(const lg_elastica_options *options, lg_elastica_options *out,
                                   lg_error *error);
/* The failure of a search that ended at `end`. */
lg_status lg_elastica_no_minimum(lg_beam_end end, const lg_beam *beam, const lg_beam_work *work,
                                 lg_error *error);

/* ---- the continuous problem (elastica_collocation.c) ---- */

/* Solution of the continuous problem of a beam; create once, solve many. */
typedef struct lg_collocation lg_collocation;
lg_status lg_collocation_create(const lg_context *context, lg_collocation **out);
void lg_collocation_destroy(const lg_context *context, lg_collocation *collocation);
/* Starts from the angles at `beam->n` + 1 equidistant points and the force. Errors: LG_NO_CONVERGENCE,
 * LG_CANCELLED, LG_OUT_OF_MEMORY. */
lg_status lg_collocation_solve(lg_collocation *collocation, const lg_beam *beam, const double *theta,
                               const double force[2], double tolerance);
/* Starts from the solution of another problem that `collocation` holds: multiplies the angles by `factor` and
 * keeps the force. */
lg_status lg_collocation_solve_scaled(lg_collocation *collocation, const lg_beam *beam, double factor,
                                      double tolerance);
typedef struct lg_collocation_result {
    double force[2], energy, defect, gradient;
    uint32_t iterations;
} lg_collocation_result;
void lg_collocation_result_get(const lg_collocation *collocation, lg_collocation_result *out);
/* At n + 1 equidistant nodes: angles (n + 1), nodes from (0, 0) (n + 1, 2); q may be NULL. */
void lg_collocation_sample(const lg_collocation *collocation, size_t n, double *theta, double *q);

/* ---- from the discrete solution (elastica_continuous.c) ---- */

/* Intervals of the discrete problem that the collocation starts from. */
size_t lg_collocation_grid(const lg_beam *beam);
/* Starts from the discrete solution in `work`. LG_NO_CONVERGENCE also when the result is on another
 * branch. */
lg_status lg_collocation_polish(lg_collocation *collocation, const lg_beam *beam, lg_beam_work *work,
                                lg_beam_end *end);
/* Angles (N + 1) and nodes (N + 1, 2) of the problem; q may be NULL. */
void lg_collocation_export(const lg_collocation *collocation, const lg_elastica *problem,
                           const lg_beam_frame *frame, double *theta, double *q);

/* Solves one problem of a family, starting from the solution of `from` in work->theta (from NULL: no start is
 * given). On LG_OK the minimum is in `work`. */
lg_status lg_beam_next(const lg_beam *from, const lg_beam *beam, lg_beam_work *work, double step,
                       lg_beam_end *end);

/* Allocates boundary, q and v, with `optional` the other arrays too; numbers are zero. LG_INVALID_ARGUMENT,
 * LG_OUT_OF_MEMORY. */
lg_status lg_elastica_curves_create(const lg_context *context, size_t count, uint32_t intervals,
                                    bool optional, lg_elastica_curves *out);

#endif
