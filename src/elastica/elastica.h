/* Internals of the elastica: the problem in the frame of its chord, and the searches in that frame.
 *
 * In this frame lengths are in units of L, energies in units of EI/L, and the chord q_N - q_0 = (d, 0) lies
 * along the x axis. The number of intervals, d and the two end angles describe the problem completely. */
#ifndef LG_ELASTICA_INTERNAL_H
#define LG_ELASTICA_INTERNAL_H

#include "core/clean.h"
#include "liegrad/elastica.h"

#define LG_PI 3.14159265358979323846

LG_API double lg_elastica_wrap(double angle); /* to (-pi, pi] */

typedef struct lg_beam {
    size_t n;     /* number of intervals, >= 2 */
    double d;     /* length of the chord, in [0, 1) */
    double first; /* theta_0; lg_beam_frame_make puts it into (-pi, pi] if d > 0 */
    double last;  /* theta_N */
} lg_beam;

/* A beam with its conversion to the caller's frame and units:
 *   theta = theta_beam + turn,   force = rotation(chord) force_beam EI/L^2,
 * where rotation(chord) turns by the angle `chord` of the chord. */
typedef struct lg_beam_frame {
    lg_beam beam;
    double turn, chord;
    double energy, force; /* units: EI/L and EI/L^2 */
} lg_beam_frame;

lg_beam_frame lg_beam_frame_make(const lg_elastica *problem);

/* A point (the angles theta and the force), the energy and its derivatives there, and a factorisation of the
 * Hessian. One block of memory serves beams of up to `room` intervals. Arrays have n + 1 entries; arrays over
 * the inner angles use the entries 1 .. n - 1. */
typedef struct lg_beam_work {
    const lg_context *context;
    size_t room;
    void *memory;
    double tolerance;  /* a point is solved when its relative gradient is at most this */
    uint32_t limit;    /* largest number of Newton steps per problem */
    bool keep_saddles; /* true: a search may end at any stationary point, also at a saddle */

    double *theta;
    double force[2];    /* lambda */
    double energy;      /* E(theta), whose force is 2 P r and not `force` */
    double *gradient;   /* gradient of E with `force` in place of 2 P r */
    double largest;     /* largest term in the sums of the gradient */
    double defect[2];   /* r - lambda/(2 P) */
    double *diag, *off; /* T, the tridiagonal part of the Hessian; off[k] couples k, k + 1 */
    double *ux, *uy;    /* U = h (-sin theta, cos theta) */

    double *pivot, *factor; /* factorisation of T + shift h */
    double *z, *yx, *yy;    /* (T + shift h)^-1 times -gradient, and times the columns of U */
    /* C = 1/(2 P) + U^T (T + shift h)^-1 U: its entries xx, xy, yy, and its determinant. */
    double capacity[3], det;
    uint32_t negative;   /* number of negative eigenvalues of the shifted Hessian */
    double *saved;       /* theta where the line search or `polish` began */
    double *base, *way;  /* points of the search for a way down from a saddle */
    double *before;      /* the last but one point of a continuation */
    uint32_t iterations; /* total number of Newton steps */
    uint32_t problems;
} lg_beam_work;

lg_status lg_beam_work_create(const lg_context *context, size_t room, lg_beam_work *out);
void lg_beam_work_destroy(lg_beam_work *work);

/* lg_beam_gradient returns the largest |dE/dtheta_k|; lg_beam_relative_gradient divides it by
 * work->largest. */
double lg_beam_gradient(const lg_beam *beam, const lg_beam_work *work);
double lg_beam_relative_gradient(const lg_beam *beam, const lg_beam_work *work);

typedef enum lg_beam_end {
    LG_BEAM_MINIMUM,
    LG_BEAM_SADDLE,
    LG_BEAM_FOLDED, /* neighbouring angles differ by pi or more, so the rotation is not the one asked for */
    LG_BEAM_LOST    /* no stationary point found within the limit of steps */
} lg_beam_end;

/* Goes downhill in energy from work->theta, whose end angles must be set, to a stationary point. Point,
 * force, energy, gradient and inertia are then in `work`. If this is a saddle, and work->keep_saddles is
 * false, the search goes on downhill from both sides of it, along the direction of lowest curvature, and
 * takes the lower one of the two minima. */
lg_beam_end lg_beam_minimise(const lg_beam *beam, lg_beam_work *work);
/* Newton's method without regard to the energy, so it may end at any stationary point. Each step changes
 * angles by at most half a radian. */
lg_beam_end lg_beam_stationary(const lg_beam *beam, lg_beam_work *work);
/* Takes implicit steps of the gradient flow of the energy. Each step is 1/rate long in time, or shorter. The
 * flow damps short waves first. */
void lg_beam_flow(const lg_beam *beam, lg_beam_work *work, double rate, int steps);
/* Returns the number of negative eigenvalues of the second variation at `theta` with the multiplier `force`,
 * under the constraint that q_N - q_0 is fixed exactly. */
uint32_t lg_beam_inertia(const lg_beam *beam, lg_beam_work *work, const double theta[],
                         const double force[2]);
double lg_beam_energy(const lg_beam *beam, const double *theta);
/* Cubic interpolation at s in [0, 1] of the angles theta (n + 1) at equidistant points. */
double lg_beam_angle_at(size_t n, const double *theta, double s);
/* Interpolates angles from from_n + 1 to to_n + 1 equidistant nodes by cubics; `to` and `from` must not
 * overlap. */
void lg_beam_prolong(size_t from_n, const double *from, size_t to_n, double *to);
/* Number of intervals, at most beam->n, of the coarse problem on which the branch is found before `beam`
 * itself is solved. */
size_t lg_beam_coarse(const lg_beam *beam);

/* Follows the minimum from a moderate problem to `beam` by continuation. End angles change by at most `step`
 * between two problems. The result is in `work`. Errors: LG_CANCELLED, LG_OUT_OF_MEMORY; without an error
 * *end tells whether a minimum was found. */
lg_status lg_beam_follow(const lg_beam *beam, lg_beam_work *work, double step, lg_beam_end *end);
/* Calls lg_beam_follow; if that finds no minimum, searches from many starts. */
lg_status lg_beam_solve(const lg_beam *beam, lg_beam_work *work, double step, lg_beam_end *end);

typedef struct lg_beam_branch {
    double energy, gradient, force[2];
    uint32_t negative, iterations;
} lg_beam_branch;
/* Finds distinct stationary points from many starts and sorts them by rising energy: branches (room), theta
 * (room, n + 1). Without `saddles` only minima are kept. If there are more than `room`, the lowest are kept.
 * `quick` uses fewer starts. */
lg_status lg_beam_search(const lg_beam *beam, lg_beam_work *work, bool saddles, bool quick, size_t room,
                         double *theta, lg_beam_branch *branches, size_t *count);

/* Writes the angles of the beam in the frame of the problem, to theta (n + 1); if `solution` is not
 * NULL, also the solution of this branch. curve: work space for 4 (n + 1) numbers. */
void lg_beam_export(const lg_elastica *problem, const lg_beam_frame *frame, const lg_beam_branch *branch,
                    const double *beam, double *curve, double *theta, lg_elastica_solution *solution);
/* Converts the guess to the frame of the chord and sets its end angles. Error: LG_NOT_FINITE. */
lg_status lg_beam_take_guess(const lg_beam_frame *frame, const double *guess, double *out, lg_error *error);

/* Copies the options after checking them, or copies the defaults if `options` is NULL. Error:
 * LG_INVALID_ARGUMENT. */
lg_status lg_elastica_options_take(const lg_elastica_options *options, lg_elastica_options *out,
                                   lg_error *error);
/* Reports the failure of a search with the outcome `end`; LG_OK for a minimum. */
lg_status lg_elastica_no_minimum(lg_beam_end end, const lg_beam *beam, const lg_beam_work *work,
                                 lg_error *error);

/* ---- the continuous problem (elastica_collocation.c) ---- */

/* The solution of a beam's continuous problem, with the memory for computing it. It can be used for many
 * problems one after the other. */
typedef struct lg_collocation lg_collocation;
lg_status lg_collocation_create(const lg_context *context, lg_collocation **out);
void lg_collocation_destroy(const lg_context *context, lg_collocation *collocation);
/* Solves the problem of `beam`. Starts from the force and from theta, the angles at beam->n + 1 equidistant
 * points. Errors: LG_NO_CONVERGENCE, LG_CANCELLED, LG_OUT_OF_MEMORY. */
lg_status lg_collocation_solve(lg_collocation *collocation, const lg_beam *beam, const double *theta,
                               const double force[2], double tolerance);
/* Like lg_collocation_solve, but starts from the solution that `collocation` holds for another problem: its
 * angles are multiplied by `factor`, its force is kept. */
lg_status lg_collocation_solve_scaled(lg_collocation *collocation, const lg_beam *beam, double factor,
                                      double tolerance);
typedef struct lg_collocation_result {
    double force[2], energy, defect, gradient;
    uint32_t iterations;
} lg_collocation_result;
void lg_collocation_result_get(const lg_collocation *collocation, lg_collocation_result *out);
/* Evaluates the solution at n + 1 equidistant points: theta (n + 1), and positions q (n + 1, 2) relative to
 * the beginning of the beam. q may be NULL. */
void lg_collocation_sample(const lg_collocation *collocation, size_t n, double *theta, double *q);

/* ---- start from the discrete solution (elastica_continuous.c) ---- */

/* Number of intervals of the first discrete problem that the collocation starts from. */
size_t lg_collocation_grid(const lg_beam *beam);
/* Solves the continuous problem, starting from the discrete solution in `work`, and tells by *end whether the
 * result is a minimum. LG_NO_CONVERGENCE also means that the result was on another branch. */
lg_status lg_collocation_polish(lg_collocation *collocation, const lg_beam *beam, lg_beam_work *work,
                                lg_beam_end *end);
/* Writes the angles (N + 1) and nodes (N + 1, 2) in the frame and units of `problem`. q may be NULL. */
void lg_collocation_export(const lg_collocation *collocation, const lg_elastica *problem,
                           const lg_beam_frame *frame, double *theta, double *q);

/* Solves the next problem of a family. If `from` is not NULL, it has the n of `beam`, its solution must be
 * in work->theta, and continuation starts there. If that fails, or without `from`, lg_beam_solve is called.
 * If *end is LG_BEAM_MINIMUM, the result is in `work`. */
lg_status lg_beam_next(const lg_beam *from, const lg_beam *beam, lg_beam_work *work, double step,
                       lg_beam_end *end);

/* Allocates boundary, q and v, and if `optional` also energy, x and kind, all zeroed. Errors:
 * LG_INVALID_ARGUMENT, LG_OUT_OF_MEMORY. */
lg_status lg_elastica_curves_create(const lg_context *context, size_t count, uint32_t intervals,
                                    bool optional, lg_elastica_curves *out);

#endif
