/* Internals of the riser scene: matrices, laws of the foundation, waves, time stepping. docs/riser.md has the
 * equations.
 *
 * An array of one direction has LG_RISER_ROW entries; those beyond LG_RISER_DOF are zero. An array of both
 * directions has x before y. Degrees of freedom: 0 offset u, 1 rotation th, 2 + i riser node i. The water
 * acts at stations: 0 the BOP at h_cg, 1 the flex joint (half a segment), 2 + i riser node i.
 */
#ifndef LG_RISER_INTERNAL_H
#define LG_RISER_INTERNAL_H

#include "kernels/kernels.h"
#include "core/core.h"
#include "liegrad/riser.h"

#define LG_RISER_ROW    16
#define LG_RISER_MATRIX (LG_RISER_DOF * LG_RISER_DOF)
#define LG_RISER_STATE  (2 * LG_RISER_ROW)

/* The standard scene, intact, slack. */
void lg_riser_parameters_init(lg_riser_parameters *out);

double lg_riser_segment(const lg_riser_parameters *p);                /* length, m */
double lg_riser_height(const lg_riser_parameters *p, size_t station); /* above the sea floor, m */

/* Matrices of one direction, symmetric, row-major. Stiffness and damping leave out the springs of wellhead
 * and soil; damping includes their dashpots. */
typedef struct lg_riser_matrices {
    double mass[LG_RISER_MATRIX], stiffness[LG_RISER_MATRIX], damping[LG_RISER_MATRIX];
} lg_riser_matrices;
void lg_riser_matrices_make(const lg_riser_parameters *p, lg_riser_matrices *out);

/* ---- foundation: radial laws ---- */

/* The secant functions give force/deflection at deflection r >= 0, the energy functions the stored energy. */
typedef struct lg_wellhead {
    bool tight;
    double inner, outer;    /* N m/rad: below and beyond the gap */
    double gap, gap_moment; /* th_g rad, N m */
    double softening;       /* th_s rad */
} lg_wellhead;
void lg_wellhead_make(const lg_riser_parameters *p, lg_wellhead *out);
double lg_wellhead_secant(const lg_wellhead *w, double r);
double lg_wellhead_energy(const lg_wellhead *w, double r);
double lg_soil_secant(double stiffness, double strength, double r);
double lg_soil_energy(double stiffness, double strength, double r);

/* ---- waves and current ---- */

/* Returns the k > 0 with frequency^2 = gravity k tanh(k depth). */
double lg_dispersion(double frequency, double depth, double gravity);

/* One Airy component: elevation amplitude cos(frequency t - wavenumber (x cos direction + y sin direction)
 * + phase). The riser stands at x = y = 0, and t = 0 is `discard` seconds before the first sample. */
typedef struct lg_wave {
    double amplitude, frequency, wavenumber, direction, phase; /* m, rad/s, 1/m, rad, rad */
} lg_wave;
/* The waves of a run with this seed, by rising frequency. All n have the amplitude Hs/sqrt(8 n), so the
 * variance of the elevation is Hs^2/16. The spectrum is cut into n parts of equal energy, and one frequency
 * is drawn from each. Directions are drawn from cos^12 and phases uniformly; wavenumbers k solve
 * frequency^2 = g k tanh(k depth). Errors, with waves untouched: LG_INVALID_ARGUMENT
 * - a sea state that is not finite, a negative height
 * - a period or depth that is not positive (in a calm sea the period does not matter)
 * - a period, depth or gravity for which a frequency or wavenumber is zero or infinite */
lg_status lg_sea_components(const lg_sea_state *sea, double depth, double gravity, uint64_t seed,
                            lg_wave waves[LG_RISER_COMPONENTS]);

#define LG_WATER_BLOCK 256 /* steps computed together */
#define LG_WATER_HALF  (LG_WATER_BLOCK / 2)

/* Velocities of the water at stations and its inertia forces on degrees of freedom, at times n dt. They come
 * from tables of cos, sin (omega_j i dt), computed once, and the amplitudes at the middle of each block. */
typedef struct lg_water {
    const lg_kernels *kernels;
    bool calm;
    double dt, ramp;
    size_t block; /* number of the block in `rows`; SIZE_MAX: none */
    double *memory;
    double *frequency, *phase, *now, *c, *s; /* (components) */
    double *velocity, *inertia;              /* amplitudes (components, LG_RISER_STATE) */
    double *cosines, *sines;                 /* (LG_WATER_HALF + 1, components) */
    double *even_in, *odd_in;                /* (components, 2 LG_RISER_STATE) */
    double *even, *odd;                      /* (LG_WATER_HALF + 1, 2 LG_RISER_STATE) */
    double *rows;                            /* (LG_WATER_BLOCK, 2 LG_RISER_STATE): velocity, inertia */
    double current[LG_RISER_STATE];
} lg_water;
lg_status lg_water_create(const lg_context *context, const lg_riser_parameters *p, const lg_riser_run *run,
                          lg_water *out);
void lg_water_destroy(const lg_context *context, lg_water *water);
/* Row n of `rows`: 2 LG_RISER_STATE numbers, valid until the caller asks for a row of another block. */
const double *lg_water_at(lg_water *water, size_t n);

/* ---- motion ---- */

/* Newmark's acceleration as a product: a = [f, q~, v~] table, where f are the forces treated explicitly. For
 * dt = 0 this is the acceleration that belongs to (q, v). */
#define LG_RISER_INPUTS (3 * LG_RISER_ROW)
typedef struct lg_riser_operator {
    double table[LG_RISER_INPUTS * LG_RISER_ROW];
} lg_riser_operator;

typedef struct lg_riser_motion {
    double q[LG_RISER_STATE], v[LG_RISER_STATE], a[LG_RISER_STATE];
    double input[2 * LG_RISER_INPUTS], next[LG_RISER_STATE];
    lg_riser_operator step, start;
    double drag[LG_RISER_ROW]; /* N s^2/m^2 at stations */
    lg_riser_matrices matrices;
    lg_wellhead wellhead;
    double dt, bop_centre, bop_height, soil_stiffness, soil_strength;
    const lg_kernels *kernels;
} lg_riser_motion;
/* A motion at rest, for parameters that passed the check. `damped` false: no dashpots and no drag.
 * LG_INVALID_ARGUMENT: a matrix is not positive definite. */
lg_status lg_riser_motion_init(const lg_riser_parameters *p, double dt, bool damped, double drag_scale,
                               lg_riser_motion *out);
/* Changes the severity of the damage; the motion continues with its state. */
lg_status lg_riser_motion_change(lg_riser_motion *motion, const lg_riser_parameters *p, bool damped);
/* Sets the accelerations that belong to q, v; `water`: 2 LG_RISER_STATE numbers. */
void lg_riser_motion_start(lg_riser_motion *motion, const double *water);
/* Advances the motion by one step, to the time of `water`. */
void lg_riser_motion_step(lg_riser_motion *motion, const double *water);
double lg_riser_motion_energy(const lg_riser_motion *motion);

/* ---- for tests ---- */

/* Periods of the undamped linear system, s, longest first: periods (LG_RISER_DOF). `locked`: with the
 * stiffness of a housing beyond its gap or tight, else of one within its gap. Errors: LG_NO_CONVERGENCE,
 * LG_INVALID_ARGUMENT (also a structure that cannot stand with that stiffness). */
lg_status lg_riser_periods(const lg_riser_parameters *parameters, bool locked, double periods[LG_RISER_DOF]);

/* Free motion without waves, current and noise, for tests and pictures: integrates the state q, v
 * (2, LG_RISER_DOF), x before y, in place over `steps` steps of dt. energy (steps + 1) or NULL: kinetic plus
 * potential energy of the conservative part, J. Damping and drag are those of the parameters; `damped` false
 * leaves them out. */
lg_status lg_riser_free_motion(const lg_context *context, const lg_riser_parameters *parameters, double dt,
                               size_t steps, bool damped, double *q, double *v, double *energy,
                               lg_error *error);

/* ---- streams ---- */

/* The same piece by piece: a feed of any length in constant memory. The size of the pieces does not change
 * the samples. */
typedef struct lg_riser_stream lg_riser_stream;
lg_status lg_riser_stream_create(const lg_context *context, const lg_riser_parameters *parameters,
                                 const lg_riser_run *run, lg_riser_stream **out, lg_error *error);
void lg_riser_stream_destroy(lg_riser_stream *stream); /* NULL is fine */
/* The next `count` samples (count, LG_RISER_CHANNELS); allocates nothing. After LG_NOT_FINITE or
 * LG_CANCELLED some of them are written, and the stream may only be destroyed. */
lg_status lg_riser_stream_next(lg_riser_stream *stream, size_t count, float *samples, lg_error *error);

#endif
