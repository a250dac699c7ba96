/* A drilling riser, blowout preventer (BOP) and wellhead in waves and current: the scene that generates
 * sensor data of an intact and of a damaged well. Equations, parameters with units and sources:
 * docs/riser.md.
 *
 * Two horizontal directions x and y, each with 14 degrees of freedom: wellhead offset u, BOP rotation th, 12
 * riser nodes; top fixed. Coupled by drag, by the soil and by the wellhead, which act along the resultant.
 */
#ifndef LIEGRAD_RISER_H
#define LIEGRAD_RISER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/context.h"
#include "liegrad/export.h"
#include "liegrad/random.h"
#include "liegrad/status.h"

LG_BEGIN_DECLS

#define LG_RISER_NODES      12
#define LG_RISER_DOF        (LG_RISER_NODES + 2) /* of one direction */
#define LG_RISER_CHANNELS   6
#define LG_RISER_COMPONENTS 200 /* Airy waves of a sea state */

/* "acc_lower_x", "acc_lower_y", "acc_upper_x", "acc_upper_y", "moment_x", "moment_y": accelerations in m/s^2,
 * moments in N m. NULL beyond. */
LG_API const char *lg_riser_channel(uint32_t index);

typedef enum lg_housing { LG_HOUSING_SLACK, LG_HOUSING_TIGHT } lg_housing;
#define LG_HOUSING_COUNT 2
LG_API const char *lg_housing_name(lg_housing housing);               /* "slack", "tight" */
LG_API lg_status lg_housing_parse(const char *name, lg_housing *out); /* LG_NOT_FOUND */

/* SI units. See docs/riser.md for each. */
typedef struct lg_riser_parameters {
    size_t size;                /* sizeof(lg_riser_parameters) */
    double depth, rho, gravity; /* m, kg/m^3, m/s^2 */
    double bop_mass, bop_added_mass, bop_height, bop_centre, bop_weight, bop_diameter, bop_drag, bop_volume;
    double riser_mass, hydro_diameter, drag, added_mass, bending_stiffness, submerged_weight;
    double flex_joint;                                                /* N m/rad */
    double top_tension;                                               /* N */
    double housing_stiffness, housing_factor, housing_gap, softening; /* K_r N m/rad, K_sf, M_gap N m, th_s */
    double soil_stiffness, soil_strength;                             /* K_y N/m, P_u N */
    double damping_rotation, damping_offset, damping_riser;           /* zeta_r, zeta_u, beta s */
    double sensor_moment, sensor_lower, sensor_upper;                 /* h_s, z_L, z_U, m */
    double noise_acceleration, noise_moment; /* standard deviations at noise 1: m/s^2, N m */
    double current;                          /* at the surface, m/s */
    lg_housing housing;
    double severity; /* r of the broken casing: 1 is intact, 0.58 the standard crack */
} lg_riser_parameters;
/* The standard scene, intact, slack. */
LG_API void lg_riser_parameters_init(lg_riser_parameters *out);
/* LG_INVALID_ARGUMENT with a sentence that names the parameter, or for a structure that does not stand: mass
 * or stiffness, with the soil's initial spring and the housing beyond its gap, not positive definite, or
 * beyond floating point. One that stands only beyond the gap passes; it leans. */
LG_API lg_status lg_riser_parameters_check(const lg_riser_parameters *parameters, lg_error *error);

/* Periods of the undamped linear system, s, longest first; `locked`: the housing beyond its gap (or tight),
 * otherwise below it. periods (LG_RISER_DOF). Errors: LG_NO_CONVERGENCE, LG_INVALID_ARGUMENT (also a
 * structure that does not stand on that stiffness). */
LG_API lg_status lg_riser_periods(const lg_riser_parameters *parameters, bool locked,
                                  double periods[LG_RISER_DOF]);

/* ---- sea ---- */

/* JONSWAP (gamma 3.3), cos^12 spreading about `direction`. */
typedef struct lg_sea_state {
    double height;    /* Hs, m; 0: calm */
    double period;    /* Tp, s */
    double direction; /* rad, from x to y */
} lg_sea_state;

/* One Airy component: elevation amplitude cos(frequency t - wavenumber (x cos direction + y sin direction)
 * + phase). The riser stands at x = y = 0, and t = 0 is `discard` seconds before the first sample. */
typedef struct lg_wave {
    double amplitude, frequency, wavenumber, direction, phase; /* m, rad/s, 1/m, rad, rad */
} lg_wave;
/* The waves of a run with this seed, by rising frequency. All have the same amplitude, Hs/sqrt(8 n), so that
 * the variance of the elevation is Hs^2/16; one frequency is drawn from each n-th of the spectrum's energy,
 * the direction of each from cos^12, the phase uniformly; wavenumbers from frequency^2 = g k tanh(k depth).
 * LG_INVALID_ARGUMENT: a sea state that is not finite, a negative height, a period or depth that is not
 * positive (in a calm sea the period does not matter), a period, depth or gravity so small or large that a
 * frequency or wavenumber is zero or infinite; then waves are untouched. */
LG_API lg_status lg_sea_components(const lg_sea_state *sea, double depth, double gravity, uint64_t seed,
                                   lg_wave waves[LG_RISER_COMPONENTS]);

#define LG_SEA_STATES 18 /* Hs {1.5, 2, 2.5, 3, 3.5, 4.5} x directions {20, 45, 70} degrees */
/* Number `index` (modulo 18) of the standard ones, heights outermost, its period and direction drawn by rng:
 * Tp = 4.2 sqrt(Hs) U(.95, 1.25)
 * + 1, direction +- 10 degrees. */
LG_API lg_sea_state lg_sea_state_draw(uint32_t index, lg_rng *rng);

/* ---- simulation ---- */

typedef struct lg_riser_run {
    size_t size; /* sizeof(lg_riser_run) */
    lg_sea_state sea;
    uint64_t seed; /* of the waves; the noise has a stream of its own, so that runs may share their waves */
    uint64_t noise_seed;
    double noise;      /* factor on the noise of the sensors; 0: none; 1 */
    double dt;         /* 0.05 s; 1/(rate dt) must be whole */
    double rate;       /* 5 Hz */
    double discard;    /* 200 s before the first sample */
    double ramp;       /* 100 s over which the forcing grows */
    double crack_time; /* s after the first sample: the severity holds for samples from then on, before it the
                        * well is intact; 0: from the start; INFINITY: never */
    double drag_scale; /* 1; 0 and damping 0 for energy checks */
} lg_riser_run;
LG_API void lg_riser_run_init(lg_riser_run *out);

/* samples (count, LG_RISER_CHANNELS): at 0, 1/rate, ... Errors, with a sentence: LG_INVALID_ARGUMENT (also a
 * structure that does not stand, waves beyond floating point), LG_OUT_OF_MEMORY, LG_CANCELLED, LG_NOT_FINITE
 * (the step is too large). Same bits for the same seeds and instruction set; may be called by many threads at
 * once. */
LG_API lg_status lg_riser_simulate(const lg_context *context, const lg_riser_parameters *parameters,
                                   const lg_riser_run *run, size_t count, float *samples, lg_error *error);

/* The same, piece by piece: a feed of any length in constant memory. Samples do not depend on the pieces. */
typedef struct lg_riser_stream lg_riser_stream;
LG_API lg_status lg_riser_stream_create(const lg_context *context, const lg_riser_parameters *parameters,
                                        const lg_riser_run *run, lg_riser_stream **out, lg_error *error);
LG_API void lg_riser_stream_destroy(lg_riser_stream *stream); /* NULL is fine */
/* The next `count` samples (count, LG_RISER_CHANNELS); allocates nothing. After LG_NOT_FINITE or
 * LG_CANCELLED some of them are written, and the stream may only be destroyed. */
LG_API lg_status lg_riser_stream_next(lg_riser_stream *stream, size_t count, float *samples, lg_error *error);

/* The state for tests and pictures: q (2, LG_RISER_DOF) x then y, velocities likewise. Integrates freely (no
 * waves, no current, no noise) from (q, v), in place, `steps` steps of dt; energy (steps + 1) or NULL:
 * kinetic plus potential energy, J, of the conservative part. Damping and drag as in the parameters. */
LG_API lg_status lg_riser_free_motion(const lg_context *context, const lg_riser_parameters *parameters,
                                      double dt, size_t steps, bool damped, double *q, double *v,
                                      double *energy, lg_error *error);

/* ---- the standard set of runs ---- */

/* 54 conditions (3 top tensions with their flex joints x 18 sea states), each intact and broken: run number
 * `index` (modulo 108) has condition index / 2 and is broken when odd. Intact and broken share the waves; the
 * three tensions share period and direction of a sea state, not its waves. Noise is always another one.
 * *label: 0 intact, 1 broken; *sea_state: 0..17. */
#define LG_RISER_RUNS 108
LG_API void lg_riser_standard_run(uint32_t index, uint64_t seed, double severity,
                                  lg_riser_parameters *parameters, lg_riser_run *run, uint32_t *label,
                                  uint32_t *sea_state);

LG_END_DECLS

#endif
