/* Internals of the riser scene: matrices, force laws of the foundation, waves, time stepping.
 * docs/detectors.md has the equations.
 *
 * An array for one direction has LG_RISER_ROW entries; the entries from LG_RISER_DOF on are zero. An array
 * for both directions has the x part before the y part. Degrees of freedom of a direction: 0 is the offset u,
 * 1 the rotation th, 2 + i riser node i. The water acts at stations: station 0 is the BOP at height h_cg,
 * station 1 the flex joint (with half a riser segment), station 2 + i riser node i. */
#ifndef LG_RISER_INTERNAL_H
#define LG_RISER_INTERNAL_H

#include "kernels/kernels.h"
#include "core/core.h"
#include "liegrad/anomaly.h"

#define LG_RISER_ROW    16
#define LG_RISER_MATRIX (LG_RISER_DOF * LG_RISER_DOF)
#define LG_RISER_STATE  (2 * LG_RISER_ROW)

/* Sets the standard parameters: drilling on an intact well with a slack housing, no load relief. */
void lg_riser_parameters_init(lg_riser_parameters *out);

double lg_riser_segment(const lg_riser_parameters *p); /* length of a riser segment, m */
/* Height of a station above the sea floor, m. */
double lg_riser_height(const lg_riser_parameters *p, size_t station);

/* Matrices of one direction, symmetric, row-major. Stiffness and damping leave out the springs of wellhead
 * and soil. Damping includes the dashpots of wellhead and soil. */
typedef struct lg_riser_matrices {
    double mass[LG_RISER_MATRIX], stiffness[LG_RISER_MATRIX], damping[LG_RISER_MATRIX];
} lg_riser_matrices;
void lg_riser_matrices_make(const lg_riser_parameters *p, lg_riser_matrices *out);

/* ---- foundation: force laws of the radial deflection ---- */

/* Law of the wellhead: moment against rotation. The functions below take the deflection r >= 0 of the
 * wellhead or the soil. "secant" functions return force/deflection (for the wellhead, moment/rotation). */
typedef struct lg_wellhead {
    bool tight;
    double inner, outer;    /* stiffness below and beyond the gap, N m/rad */
    double gap, gap_moment; /* rotation th_g at the gap, rad; moment there, N m */
    double softening;       /* th_s rad */
} lg_wellhead;
void lg_wellhead_make(const lg_riser_parameters *p, lg_wellhead *out);
double lg_wellhead_secant(const lg_wellhead *w, double r);
double lg_soil_secant(double stiffness, double strength, double r);

/* ---- waves and current ---- */

/* Returns the wavenumber k > 0 with frequency^2 = gravity k tanh(k depth). */
double lg_dispersion(double frequency, double depth, double gravity);

/* One Airy wave with the surface elevation amplitude cos(frequency t - wavenumber (x cos direction + y sin
 * direction) + phase). The riser stands at x = y = 0. t = 0 is `discard` seconds before the first sample. */
typedef struct lg_wave {
    double amplitude, frequency, wavenumber, direction, phase; /* m, rad/s, 1/m, rad, rad, in this order */
} lg_wave;
/* Computes the waves of a run with this seed, in order of rising frequency. All n waves have the amplitude
 * Hs/sqrt(8 n), so the variance of the elevation is Hs^2/16. The spectrum is cut into n parts of equal
 * energy, and one frequency is drawn from each part. Directions are drawn from a density proportional to
 * cos^12, phases uniformly. Wavenumbers k solve frequency^2 = g k tanh(k depth). Error LG_INVALID_ARGUMENT,
 * with `waves` unchanged:
 * - a sea state that is not finite, or a negative height
 * - a period or depth that is not positive (in a calm sea the period does not matter)
 * - a period, depth or gravity for which a frequency or wavenumber is zero or infinite */
lg_status lg_sea_components(const lg_sea_state *sea, double depth, double gravity, uint64_t seed,
                            lg_wave waves[LG_RISER_COMPONENTS]);

#define LG_WATER_BLOCK 256 /* time steps whose water rows are computed together */
#define LG_WATER_HALF  (LG_WATER_BLOCK / 2)

/* Velocities of the water at the stations, and inertia forces of the water on the degrees of freedom, at the
 * times n dt. A block of steps is computed at once, from tables of cos(omega_j i dt) and sin(omega_j i dt),
 * made once per run, and from the phases of the waves at the middle of the block. */
typedef struct lg_water {
    const lg_kernels *kernels;
    bool calm;
    double dt, ramp;
    size_t block; /* number of the block that `rows` holds; SIZE_MAX: no block yet */
    /* (components); now: angle of each wave, c and s: its cosine and sine */
    double *frequency, *phase, *now, *c, *s;
    double *velocity, *inertia; /* amplitudes of each wave (components, LG_RISER_STATE) */
    double *cosines, *sines;    /* cos and sin(omega_j i dt): (LG_WATER_HALF + 1, components) */
    double *even_in, *odd_in;   /* amplitudes at the block's middle (components, 2 LG_RISER_STATE) */
    /* Parts of velocity and inertia force that are even and odd in the time from the middle of the block:
     * (LG_WATER_HALF + 1, 2 LG_RISER_STATE). */
    double *even, *odd;
    double *rows; /* (LG_WATER_BLOCK, 2 LG_RISER_STATE): velocities, then inertia forces */
    double current[LG_RISER_STATE];
} lg_water;
lg_status lg_water_create(const lg_context *context, const lg_riser_parameters *p, const lg_riser_run *run,
                          lg_water *out);
void lg_water_destroy(const lg_context *context, lg_water *water);
/* Returns the water at time n dt, a row of `rows`: 2 LG_RISER_STATE numbers. The row stays valid until the
 * caller asks for a step in another block. */
const double *lg_water_at(lg_water *water, size_t n);

/* ---- motion ---- */

/* Newmark's acceleration as a matrix product: a = [f, q~, v~] table. f are the forces treated explicitly, q~
 * and v~ Newmark's predictors of position and velocity. A table made for dt = 0 gives the acceleration at the
 * state (q, v). */
#define LG_RISER_INPUTS (3 * LG_RISER_ROW)
typedef struct lg_riser_operator {
    double table[LG_RISER_INPUTS * LG_RISER_ROW];
} lg_riser_operator;

typedef struct lg_riser_motion {
    double q[LG_RISER_STATE], v[LG_RISER_STATE], a[LG_RISER_STATE];
    double input[2 * LG_RISER_INPUTS], next[LG_RISER_STATE];
    lg_riser_operator step, start;
    double drag[LG_RISER_ROW]; /* drag force at each station per squared relative velocity, N s^2/m^2 */
    lg_riser_matrices matrices;
    lg_wellhead wellhead;
    double dt, bop_centre, bop_height, soil_stiffness, soil_strength;
    const lg_kernels *kernels;
} lg_riser_motion;
/* Initialises a motion at rest. `p` must have passed lg_riser_parameters_check. damped = false leaves out
 * dashpots and drag. Error LG_INVALID_ARGUMENT: a matrix is not positive definite. */
lg_status lg_riser_motion_init(const lg_riser_parameters *p, double dt, bool damped, double drag_scale,
                               lg_riser_motion *out);
/* Computes the accelerations at the current positions and velocities. water: 2 LG_RISER_STATE numbers of
 * lg_water_at. */
void lg_riser_motion_start(lg_riser_motion *motion, const double *water);
/* Advances the motion by one step dt; `water` is the water at the end of the step. */
void lg_riser_motion_step(lg_riser_motion *motion, const double *water);

#endif
