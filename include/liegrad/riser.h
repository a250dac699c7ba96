/* A drilling riser, blowout preventer (BOP) and wellhead in waves and current. The scene generates sensor
 * data of an intact and of a damaged well. docs/riser.md has the equations, and the parameters with their
 * units and sources.
 *
 * Each of the two horizontal directions x and y has 14 degrees of freedom: wellhead offset u, BOP rotation th
 * and 12 riser nodes; the top is fixed. Drag, soil and wellhead act along the resultant and so couple the
 * directions.
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
/* LG_INVALID_ARGUMENT with a sentence that names the parameter, or for a structure that cannot stand: the
 * mass or stiffness matrix (with the soil's initial spring, and the housing beyond its gap) is not positive
 * definite or overflows. A structure that is stable only beyond the gap passes; it leans. */
LG_API lg_status lg_riser_parameters_check(const lg_riser_parameters *parameters, lg_error *error);

/* ---- sea ---- */

/* JONSWAP (gamma 3.3), cos^12 spreading about `direction`. */
typedef struct lg_sea_state {
    double height;    /* Hs, m; 0: calm */
    double period;    /* Tp, s */
    double direction; /* rad, from x to y */
} lg_sea_state;

#define LG_SEA_STATES 18 /* Hs {1.5, 2, 2.5, 3, 3.5, 4.5} x directions {20, 45, 70} degrees */
/* Standard sea state `index` (modulo 18); the direction changes fastest. The rng draws the period
 * Tp = 4.2 sqrt(Hs) U(0.95, 1.25) + 1 and adds up to 10 degrees either way to the direction. */
LG_API lg_sea_state lg_sea_state_draw(uint32_t index, lg_rng *rng);

/* ---- simulation ---- */

typedef struct lg_riser_run {
    size_t size; /* sizeof(lg_riser_run) */
    lg_sea_state sea;
    uint64_t seed;       /* of the waves */
    uint64_t noise_seed; /* of the sensors' noise; runs with the same waves may differ in noise */
    double noise;        /* factor on the noise of the sensors; 0: none; 1 */
    double dt;           /* 0.05 s; 1/(rate dt) must be whole */
    double rate;         /* 5 Hz */
    double discard;      /* 200 s before the first sample */
    double ramp;         /* 100 s over which the forcing grows */
    double crack_time;   /* s after the first sample: the well is intact before and has the severity from then
                        * on. 0: damaged from the start; INFINITY: never */
    double drag_scale;   /* factor on drag; 1. Energy checks take 0, and no damping */
} lg_riser_run;
LG_API void lg_riser_run_init(lg_riser_run *out);

/* samples (count, LG_RISER_CHANNELS) at times 0, 1/rate, ... Equal seeds give equal bits on one instruction
 * set. Threads may call it at the same time. Errors, with a sentence: LG_INVALID_ARGUMENT (also a structure
 * that cannot stand, waves that overflow), LG_OUT_OF_MEMORY, LG_CANCELLED, LG_NOT_FINITE (the step is too
 * large). */
LG_API lg_status lg_riser_simulate(const lg_context *context, const lg_riser_parameters *parameters,
                                   const lg_riser_run *run, size_t count, float *samples, lg_error *error);

/* ---- the standard set of runs ---- */

/* There are 54 conditions: 3 top tensions with their flex joints times 18 sea states. Run `index` (modulo
 * 108) has condition index/2; it is intact when even and broken when odd. The two runs of a condition share
 * the waves. The three tensions share the period and direction of a sea state but have different waves. Every
 * run has its own noise. *label: 0 intact, 1 broken; *sea_state: 0..17. */
#define LG_RISER_RUNS 108
LG_API void lg_riser_standard_run(uint32_t index, uint64_t seed, double severity,
                                  lg_riser_parameters *parameters, lg_riser_run *run, uint32_t *label,
                                  uint32_t *sea_state);

LG_END_DECLS

#endif
