/* Machines: forced, damped mechanical systems that are learned from logs. docs/machines.md is the guide.
 *
 * The configuration is a product of coordinates. With velocities v, momenta p = M(q) v and
 * H = 1/2 p^T M(q)^-1 p + V(q):
 *
 *   q' = v,  p' = -dH/dq - D(q, v) v + B(q) u + r(q, v, u)
 *
 * in the form of each kind of coordinate (body: components along the axes of the body; r_i: rows of R):
 *
 *   kind       position in logs         velocity in logs          equations
 *   line       q                        q'                        as above
 *   angle      q in radians, unwrapped  q'                        as above; terms see sin q and cos q
 *   direction  q on S^2                 omega in space, q.omega = 0
 *                                                                 p = M omega x q with one number M,
 *                                                                 q' = omega x q,
 *                                                                 p' = omega x p + (dV/dq x q + f) x q
 *                                                                 of a chain of k see below
 *   rotation   R, body to space         Omega in the body         R' = R hat(Omega),
 *                                                                 m' = m x Omega + sum_i r_i x dH/dr_i + f
 *   pose       x in space, R            w = R^T x', Omega, body   x' = R w, l' = l x Omega - R^T dH/dx + f_l,
 *                                                                 m' = m x Omega + l x w
 *                                                                      + sum_i r_i x dH/dr_i + f_m
 *
 * The directions of a chain have one constant mass matrix m (k, k): p_i = P_i sum_j m_ij q_j' with
 * P_i = I - q_i q_i^T, H = 1/2 sum_i p_i.q_i' + V, and with lambda_i = -q_i.sum_j m_ij q_j'
 *   p_i' = omega_i x p_i + (dV/dq_i x q_i - lambda_i q_i' x q_i + q_i' x p_i + f_i) x q_i.
 *
 * f are the forces other than -dH/dq, in the order of the velocities: of a direction 3 torques in space, of a
 * rotation 3 torques in the body, of a pose 3 forces, then 3 torques, in the body.
 *
 * M, V, D, B and r are sums of terms, rows of a table (lg_term_kind_at): what is known is given, the rest is
 * learned. M and D are positive (semi)definite by construction, so that damping takes energy away. Constant
 * biases of sensors are a part of their own: logs have positions (lines, angles, places of poses) and
 * velocities with them.
 *
 * States of integrators have all positions of lines, angles and poses (in the order of the coordinates), then
 * q and p of the directions, the rotations R of rotations and poses, and the momenta of all coordinates but
 * directions: the factors of lg_machine_space.
 *
 * Inside, quantities are divided by the scales of the machine: times by `time` T, positions and velocities of
 * lines by L and L/T (L = 1 for angles, directions, rotations), inputs by U, energies by E. Parameters are
 * numbers around 1. Everything that is recorded on a tape is in these units.
 */
#ifndef LIEGRAD_MACHINE_H
#define LIEGRAD_MACHINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/core.h"
#include "liegrad/files.h"
#include "liegrad/fit.h"
#include "liegrad/integrators.h"
#include "liegrad/mechanics.h"
#include "liegrad/model.h"
#include "liegrad/networks.h"
#include "liegrad/program.h"
#include "liegrad/settings.h"
#include "liegrad/tape.h"
#include "liegrad/taped.h"

LG_BEGIN_DECLS

#define LG_MACHINE_NAME        32 /* bytes of a name */
#define LG_MACHINE_COORDINATES 12
#define LG_MACHINE_VELOCITIES  16 /* numbers of all velocities together */
#define LG_MACHINE_POSITIONS   48 /* numbers of all positions in a log */
#define LG_MACHINE_INPUTS      16
#define LG_MACHINE_TERMS       16
#define LG_MACHINE_FEATURES    16 /* listed in one term */
#define LG_MACHINE_VALUES      (LG_MACHINE_VELOCITIES * LG_MACHINE_VELOCITIES)
#define LG_MACHINE_PARAMETERS  32 /* numbers of a named system's parameters */

/* ---- coordinates ---- */

typedef enum lg_coordinate_kind {
    LG_COORDINATE_LINE,
    LG_COORDINATE_ANGLE,
    LG_COORDINATE_DIRECTION,
    LG_COORDINATE_ROTATION,
    LG_COORDINATE_POSE
} lg_coordinate_kind;
#define LG_COORDINATE_KIND_COUNT 5

/* A row of the table of kinds. A position in a log has `places` numbers on R^n, then 3 for a direction or 9
 * (R row-major) for a rotation. */
typedef struct lg_coordinate_row {
    const char *name; /* "line" */
    uint32_t places, directions, rotations;
    uint32_t velocities; /* numbers of a velocity */
} lg_coordinate_row;
LG_API const lg_coordinate_row *lg_coordinate_row_of(lg_coordinate_kind kind); /* NULL: none */
/* places + 3 directions + 9 rotations */
LG_API uint32_t lg_coordinate_positions(lg_coordinate_kind kind);

typedef struct lg_machine_coordinate {
    char name[LG_MACHINE_NAME];
    lg_coordinate_kind kind;
} lg_machine_coordinate;

/* ---- features: what a term sees of state and input ---- */

typedef enum lg_machine_sight {
    LG_FEATURE_POSITION, /* NAME: line q; angle sin q, cos q; direction q; rotation R; pose x, R */
    LG_FEATURE_PLACE,    /* NAME.place: x of a pose */
    LG_FEATURE_ROTATION, /* NAME.rotation: R of a pose */
    LG_FEATURE_UP,       /* NAME.up: R^T e3 of a rotation or pose */
    LG_FEATURE_HEIGHT, /* NAME.height: line q; angle sin q, cos q; direction q_3; rotation R^T e3; pose x_3 */
    LG_FEATURE_VELOCITY, /* NAME.velocity */
    LG_FEATURE_INPUT     /* name of the input */
} lg_machine_sight;

typedef struct lg_machine_feature {
    lg_machine_sight kind;
    uint32_t index; /* of the coordinate, or of the input */
} lg_machine_feature;

/* ---- terms ---- */

typedef enum lg_machine_part {
    LG_MACHINE_MASS,
    LG_MACHINE_POTENTIAL,
    LG_MACHINE_DAMPING,
    LG_MACHINE_INPUT_MAP,
    LG_MACHINE_RESIDUAL,
    LG_MACHINE_BIAS /* of sensors: what logs have is true + bias */
} lg_machine_part;
#define LG_MACHINE_PART_COUNT 6
LG_API const char *lg_machine_part_name(lg_machine_part part); /* "mass", "input_map"; else NULL */

/* A row of the table of terms; docs/machines.md lists them. `options` is a sum of LG_TERM_*. */
typedef struct lg_term_kind lg_term_kind;
enum {
    LG_TERM_OF = 1,     /* takes features */
    LG_TERM_MOVING = 2, /* features may be velocities, and of a residual inputs */
    LG_TERM_HIDDEN = 4, /* a network */
    LG_TERM_DEGREE = 8,
    LG_TERM_VALUES = 16, /* needs values, or may have them */
    LG_TERM_KNOWN = 32,  /* has no parameters */
    LG_TERM_WIDTH = 64
};
LG_API const lg_term_kind *lg_term_kind_at(lg_machine_part part, size_t index);       /* NULL beyond */
LG_API const lg_term_kind *lg_term_kind_find(lg_machine_part part, const char *name); /* NULL: none */
LG_API const char *lg_term_kind_name(const lg_term_kind *kind);
LG_API uint32_t lg_term_kind_options(const lg_term_kind *kind);

#define LG_MACHINE_HIDDEN 4
typedef struct lg_machine_term {
    const lg_term_kind *kind; /* static */
    lg_machine_part part;
    uint32_t of_count;
    lg_machine_feature of[LG_MACHINE_FEATURES];
    uint32_t hidden_layers, hidden[LG_MACHINE_HIDDEN];
    lg_activation activation;
    uint32_t degree;                  /* of a polynomial */
    double width;                     /* of Coulomb friction: the velocity v0 in f tanh(v/v0) */
    uint32_t value_count;             /* in the units of the log */
    double values[LG_MACHINE_VALUES]; /* matrices row-major; of damping also a diagonal */
    /* Filled by lg_machine_init. */
    lg_mlp net;
    size_t offset, parameters; /* in theta */
} lg_machine_term;

/* ---- machines of a named system: M and V by formulas with parameters ---- */

/* A row of the table of systems; docs/machines.md lists them. */
typedef struct lg_grey_system lg_grey_system;
LG_API const lg_grey_system *lg_grey_system_at(size_t index); /* NULL beyond */
LG_API const char *lg_grey_system_name(const lg_grey_system *system);
/* Ended by a key NULL: those of lg_system_parameters; of systems that have none there, of their own. */
LG_API const lg_parameter_entry *lg_grey_system_parameters(const lg_grey_system *system);
/* Kind of coordinate `index` of a machine of this system with `count` coordinates, and the number of
 * coordinates that it wants: 0, any from 1 on. */
LG_API lg_coordinate_kind lg_grey_system_coordinate(const lg_grey_system *system, uint32_t index);
LG_API uint32_t lg_grey_system_coordinates(const lg_grey_system *system);

/* The system of a machine: all numbers of its parameters, in the order of the table and in the units of the
 * log. Of an unknown number `start` is where learning begins: theta holds log(number/start) of a positive
 * one, (number - start)/scale of another one, with the largest |start| of its parameter as the scale (1 where
 * all are 0), and of a unit vector the two numbers of a rotation across the start, in radians. */
typedef struct lg_machine_grey {
    const lg_grey_system *system; /* static; NULL: the machine has terms alone */
    uint32_t count;
    double start[LG_MACHINE_PARAMETERS]; /* NaN: must be given yet */
    bool unknown[LG_MACHINE_PARAMETERS];
} lg_machine_grey;

/* ---- the machine ---- */

typedef struct lg_machine_scales {
    double time;                            /* T */
    double place[LG_MACHINE_POSITIONS];     /* L of each place, in the order of the state */
    double velocity[LG_MACHINE_VELOCITIES]; /* L of each velocity */
    double input[LG_MACHINE_INPUTS];        /* U */
    double energy;                          /* E */
    double held; /* of a normalised machine: number of the mass that is 1 in the log's units, from 1 */
} lg_machine_scales;

/* Plain data, copied freely. The caller fills coordinates, inputs, terms and scales (lg_machine_scales_init
 * sets all to 1), lg_machine_init the rest. */
typedef struct lg_machine {
    uint32_t coordinate_count, input_count, term_count;
    lg_machine_coordinate coordinates[LG_MACHINE_COORDINATES];
    char inputs[LG_MACHINE_INPUTS][LG_MACHINE_NAME];
    lg_machine_term terms[LG_MACHINE_TERMS];
    lg_machine_scales scales;
    lg_machine_grey grey; /* filled by lg_machine_set_system */
    /* Filled by lg_machine_init. Velocities alone give M, V, D and B up to a common factor. It is fixed by a
     * term with values or a known number of a system (not by every one: lg_machine_identify). Else one mass
     * is 1 in the log's units (normalised) where the mass is one constant or diagonal term: of a diagonal one
     * that of the velocity that moves most, else the first. Else nothing fixes it (free_gauge). */
    bool normalised, free_gauge;
    uint32_t places, directions, rotations; /* numbers on R^n, and copies of S^2 and SO(3) */
    uint32_t momenta;                       /* on R^n: those of all coordinates but directions */
    uint32_t positions, velocities;         /* numbers in a log */
    size_t parameters, weights;             /* of theta: those of networks come first */
} lg_machine;

LG_API void lg_machine_scales_init(lg_machine_scales *scales);
/* Errors, with a sentence: LG_INVALID_ARGUMENT (no coordinate, too many, a term that does not fit its part or
 * the coordinates, a wrong number of values, features or widths; names that are not unique). */
LG_API lg_status lg_machine_init(lg_machine *machine, lg_error *error);
/* Before lg_machine_init, to a machine that has its coordinates: adds the terms of the system, a mass and
 * where it has one a potential; its numbers are known and have their defaults. Errors, with a sentence:
 * LG_NOT_FOUND (no such system, or one that has no machine), LG_INVALID_ARGUMENT (other coordinates than the
 * system has, a second system, too many terms). */
LG_API lg_status lg_machine_set_system(lg_machine *machine, const char *name, lg_error *error);
/* The numbers of one parameter, by its key: `count` of them, or 0 for all with their defaults. A number that
 * is NaN has its default, or where it is unknown and positive 1. `unknown` (count; of 0 one for all; NULL:
 * known). Errors, with a sentence: LG_INVALID_ARGUMENT (an unknown key, a wrong count, a number against its
 * rule, a number without a default, a unit vector of which only a part is unknown). */
LG_API lg_status lg_machine_set_parameter(lg_machine *machine, const char *key, size_t count,
                                          const double *values, const bool *unknown, lg_error *error);
LG_API lg_status lg_machine_space(const lg_machine *machine, lg_space *space);

/* theta (parameters; NULL is allowed for a machine without parameters, here and below): networks' weights
 * U(+-1/sqrt(fan_in)), last layers scaled by .1; masses 1, small damping, an input map of 0 but 1 for input j
 * of velocity j, potentials and residuals 0, in scaled units. */
LG_API void lg_machine_initialise(const lg_machine *machine, lg_rng *rng, double *theta);
/* Brings the biases of angles in theta to (-pi, pi]: full turns change nothing that a log shows. */
LG_API void lg_machine_wrap_biases(const lg_machine *machine, double *theta);

/* ---- recordings, batches of B rows, in scaled units ---- */

/* Variables that depend on theta alone. Borrows the machine; valid until the tape is rewound. */
typedef struct lg_machine_vars {
    const lg_machine *machine;
    lg_var theta[LG_MACHINE_TERMS];    /* slices; LG_NONE without parameters */
    lg_mlp_vars net[LG_MACHINE_TERMS]; /* of networks */
    lg_var grey;                       /* (numbers) of a system, in the units of the log; LG_NONE */
    lg_var mass, inverse;              /* (momenta, momenta), or LG_NONE where M depends on q */
    lg_var direction_mass;             /* (1, directions, 1), or LG_NONE; of a chain (1, k, k) */
    lg_var direction_inverse;          /* of a chain (1, k, k) */
    lg_var bias;                       /* (1, positions + velocities), or LG_NONE */
} lg_machine_vars;
LG_API lg_status lg_machine_bind(lg_tape *tape, const lg_machine *machine, lg_var theta,
                                 lg_machine_vars *vars);

/* From positions and velocities in the order of logs, (B, positions) and (B, velocities), to the parts of a
 * state (liegrad/taped.h), and back. Logs have biases, states have not. */
LG_API lg_status lg_machine_record_state(lg_tape *tape, const lg_machine_vars *vars, lg_var positions,
                                         lg_var velocities, lg_var *parts);
LG_API lg_var lg_machine_record_positions(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts);
LG_API lg_var lg_machine_record_velocities(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts);
/* H (B, 1). */
LG_API lg_var lg_machine_record_energy(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts);
/* v of the state (B, velocities), without biases. */
LG_API lg_var lg_machine_record_rates(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts);
/* Forces f of one part, (B, velocities): LG_MACHINE_DAMPING (-D v), LG_MACHINE_INPUT_MAP (B u) or
 * LG_MACHINE_RESIDUAL; LG_NONE when there is none. rates: v; u (B, inputs) or LG_NONE. */
LG_API lg_var lg_machine_record_force(lg_tape *tape, const lg_machine_vars *vars, lg_machine_part part,
                                      const lg_var *parts, lg_var rates, lg_var u);
/* The field: an algebra element. */
LG_API lg_status lg_machine_record_field(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts,
                                         lg_var u, lg_var *algebra);

/* ---- logs ---- */

/* Rows of logs in the machine's order, in the units of the log. Rows of one part follow each other without a
 * gap, part i has rows first[i] .. first[i + 1] - 1. NaN is a value that is not there; a position of a
 * direction or rotation is there as a whole or not at all. Borrowed by the functions below. */
typedef struct lg_machine_log {
    size_t rows, parts;
    const size_t *first; /* (parts + 1) */
    const double *t;     /* (rows), seconds, increasing within a part */
    const double *q;     /* (rows, positions): each coordinate's position, R row-major, angles unwrapped */
    const double *v;     /* (rows, velocities); all NaN where positions alone are measured */
    /* (rows, 4, inputs): from row j to the next u(t_j + s h_j) = u_0 + s u_1 + s^2 u_2 + s^3 u_3 with
     * 0 <= s <= 1; a held input has u_0 alone. NULL without inputs. */
    const double *u;
} lg_machine_log;
/* The part in which a row lies. */
LG_API size_t lg_machine_log_part(const lg_machine_log *log, size_t row);
/* Whether all positions of a row are there, and all velocities unless `positions_only`. */
LG_API bool lg_machine_log_complete(const lg_machine *machine, const lg_machine_log *log, size_t row,
                                    bool positions_only);

/* Sets the scales by the log: T from the root mean squares of velocities and accelerations, L = T times that
 * of a line's velocity, U those of the inputs, E so that masses are around 1. lg_machine_init must have been
 * called; its results stay. LG_FORMAT, with a sentence: nothing moves, all velocities are constant, or they
 * overflow. */
LG_API lg_status lg_machine_find_scales(lg_machine *machine, const lg_machine_log *log, lg_error *error);

/* ---- steps ----
 *
 * Steps over intervals are those of an explicit Lie group scheme (LG_SCHEME_RKMK, LG_SCHEME_COMMUTATOR_FREE),
 * or of LG_SCHEME_VARIATIONAL, of order 2: kick, drift, kick.
 *
 *   kick    p1 = p0 + h/2 f(q, (v0 + v1)/2, u), f: all forces, -dV/dq among them, u at the start of the step
 *           for the first kick and at its end for the second. It is implicit where f depends on v. The
 *           kinetic energy changes by h/2 (v0 + v1)/2 . f: damping never adds to it.
 *   drift   free motion: lines, angles and directions exactly, bodies by the variational integrator with the
 *           discrete Lagrangian h/2 v^T M v, g1 = g0 exp(h v) on SO(3) or SE(3):
 *             p0 = (dexp_{h v}^-1)^T M v,  p1 = Ad_{exp(h v)}^T p0
 *           It is implicit in v. Momenta in space are constant to rounding.
 *
 * Without forces but -dV/dq the steps are symplectic and symmetric. M may be full and couple coordinates, but
 * must not depend on the state: else LG_UNSUPPORTED. Newton's method solves what is implicit, row by row; a
 * row without a solution is NaN. First and second derivatives are exact. */

/* ---- training ---- */

typedef enum lg_machine_starts { LG_MACHINE_STARTS_MEASURED, LG_MACHINE_STARTS_ESTIMATED } lg_machine_starts;

#define LG_MACHINE_WINDOW 512 /* most points of a window */

/* Windows of M consecutive rows. The loss is the mean over windows and points 2..M of the sum over columns of
 * ((predicted - logged)/scale)^2, scales below, for R of |R' - R|^2/2 (the squared angle near 0), for q of a
 * direction |q' - q|^2, of its omega the part across the logged q (1 - q q^T); with estimated starts points
 * 1..M. Logs have no omega along q, so noise dq of q moves it by |omega| dq along q. */
typedef struct lg_machine_problem {
    const lg_machine *machine;
    const lg_scheme *scheme;
    uint32_t substeps; /* >= 1 steps between two rows */
    uint32_t window;   /* M >= 2 */
    lg_machine_starts starts;
    const double *theta; /* NULL, or known parameters of the machine: the starts alone are learned */
    lg_machine_log log;
    size_t windows;
    const size_t *start;                           /* (windows), rows; all of a window lies in one part */
    size_t validation;                             /* so many windows at the end are the validation part */
    double position_scale[LG_MACHINE_COORDINATES]; /* in the units of the log (radians) */
    double velocity_scale[LG_MACHINE_COORDINATES];
} lg_machine_problem;

/* The rows at which windows start, rising: complete rows (velocities too, unless `positions_only`), `stride`
 * apart in each part, and closer where incomplete rows and the end of a part would leave rows in no window.
 * With stride <= window every row is in a window that is in any; with a longer one windows are at most
 * `stride` apart, and the last one of a part ends as late as it can. `out` (NULL: only counts) has room for
 * log->rows. */
LG_API size_t lg_machine_windows(const lg_machine *machine, const lg_machine_log *log, uint32_t window,
                                 uint32_t stride, bool positions_only, size_t *out);
/* Errors: LG_INVALID_ARGUMENT, LG_UNSUPPORTED (the scheme). */
LG_API lg_status lg_machine_problem_check(const lg_machine_problem *problem, lg_error *error);
/* Parameters of the fit: theta unless it is known, then with estimated starts for each window the offsets of
 * its start, (places, directions 3, rotations 3, velocities) in units of the scales times the root of the
 * number of windows. `problem` is borrowed. */
LG_API size_t lg_machine_problem_parameters(const lg_machine_problem *problem);
LG_API void lg_machine_fit_problem(const lg_machine_problem *problem, lg_fit_problem *out);
/* The loss of all windows but the validation part; `floor` (may be NULL): of it, the part that
 * the steps make. */
LG_API lg_status lg_machine_loss(const lg_context *context, const lg_machine_problem *problem,
                                 const double *theta, double *loss, double *floor, lg_error *error);

/* Numbers of each coordinate in the units of the log: lines and places in metres, others in radians. */
typedef struct lg_machine_noise {
    double position[LG_MACHINE_COORDINATES], velocity[LG_MACHINE_COORDINATES];
} lg_machine_noise;
/* What a model leaves of the logs, in units of the loss. */
typedef struct lg_machine_expected {
    /* The loss that is expected of a model that explains the logs but for white noise: each number of a
     * column adds (noise/scale)^2, estimated starts and parameters that the logs determine take away what
     * they adapt to (their degrees of freedom), measured starts add what their noise makes of a window.
     * From at most 512 windows; of more than 256 parameters weights of networks count nothing, others an
     * average number each. */
    double loss;
    /* Of each coordinate, what changes of its velocities in the windows make of positions and velocities: the
     * loss of a model in which nothing acts, about. */
    lg_machine_noise change;
} lg_machine_expected;
/* noise: standard deviations. theta: as for lg_machine_identify. Errors: LG_OUT_OF_MEMORY, the tape's. */
LG_API lg_status lg_machine_expect(const lg_context *context, const lg_machine_problem *problem,
                                   const double *theta, const lg_machine_noise *noise,
                                   lg_machine_expected *out, lg_error *error);

/* What forces that the machine does not have would explain of the loss: constant ones, those linear in
 * heights, velocities and inputs, polynomials of degree 3 in the height and velocity of each coordinate (of
 * a degree below where these were more than 128 numbers). Angles enter by sine and cosine. */
typedef struct lg_machine_missing {
    /* Of the loss, to first order. 0: it was not looked, as for networks and for more than 128 parameters. */
    double loss;
    /* F of a test whether that is chance: about 1 for white residuals, next to never above 8 where the
     * machine is the true one. */
    double ratio;
} lg_machine_missing;
/* theta: as for lg_machine_identify, a best fit. Errors: LG_OUT_OF_MEMORY, the tape's. */
LG_API lg_status lg_machine_find_missing(const lg_context *context, const lg_machine_problem *problem,
                                         const double *theta, lg_machine_missing *out, lg_error *error);

/* ---- identified numbers ---- */

/* A number with a meaning, in the units of the log: an unknown one of a system by its label, "m1";
 * "mass.1.2" (of velocities 1 and 2, counted through the coordinates), "damping.x" or "damping.body.3"
 * (diagonal; also "coulomb.x", "quadratic.x"), "damping.1.2" (constant), "input_map.2.1", "potential.x^2",
 * "potential.sin(theta)", "bias.x", "bias.body.velocity.3". Where a mass is a network: M at one position, by
 * default the reference, where places and angles are 0, directions e3 and attitudes 1. `error` is one
 * standard deviation, from the Gauss-Newton matrix of at most 512 windows and the noise that the residuals
 * show, without a prior; infinite: the data do not determine it. */
#define LG_IDENTIFIED_NAME 96
typedef struct lg_identified {
    char name[LG_IDENTIFIED_NAME];
    double value, error;
} lg_identified;
/* The values of a machine's numbers alone; returns how many there are, at most `room` are written. */
LG_API size_t lg_machine_numbers(const lg_machine *machine, const double *theta, size_t room,
                                 lg_identified *out);
/* Where logs can tell M of a network: at the reference, if a window to be learned begins within a tenth of
 * the standard deviation of the positions that the mass sees; else where the window begins that is nearest to
 * the mean of all. Writes its positions, as logs have them. False: no mass is a network, and the positions do
 * not matter. */
LG_API bool lg_machine_mass_at(const lg_machine_problem *problem, double *positions);
/* What logs say of the N numbers of lg_machine_numbers, with M of a network at lg_machine_mass_at; the
 * caller's memory. */
typedef struct lg_identification {
    lg_identified *numbers; /* (N) with errors */
    double *correlations;   /* (N, N) of the errors, 0 where one is 0 or infinite; NULL: not wanted */
    /* Directions in which numbers can move together while the logs stay the same to their noise: relative
     * changes, (N, N) of which `open_count` rows are filled, each with the largest change 1; every row moves
     * one number that no other row moves. NULL: not wanted. */
    double *open;
    size_t open_count;
    /* W (P, P), P the machine's parameters: W W^T is the covariance of theta, so that theta + W x with x of
     * N(0, 1) is a machine that the logs allow; here weights of
     * networks have the prior N(0, 1). NULL: not wanted. */
    double *spread;
} lg_identification;
/* theta: parameters of the fit, with starts; problem->theta is NULL. Errors: LG_OUT_OF_MEMORY,
 * the tape's. */
LG_API lg_status lg_machine_identify(const lg_context *context, const lg_machine_problem *problem,
                                     const double *theta, lg_identification *out, lg_error *error);
/* A row of `open` in words: "m and L appear only as a product: give one of them". Returns how many numbers
 * move in it; `text` has room for `size` bytes. */
LG_API size_t lg_identification_sentence(const lg_identification *of, size_t count, size_t row, char *text,
                                         size_t size);

/* ---- predictions ---- */

/* Free runs from rows start[0..count-1] over `steps` intervals each, all within one part: positions
 * (count, steps + 1, positions) and velocities (count, steps + 1, velocities) in the units of the log, either
 * may be NULL; the first point is the logged one. Errors: LG_INVALID_ARGUMENT, LG_UNSUPPORTED (the scheme),
 * LG_OUT_OF_MEMORY, the tape's.
 * A run that is not finite goes on as NaN. */
LG_API lg_status lg_machine_free_run(const lg_context *context, const lg_machine *machine,
                                     const double *theta, const lg_scheme *scheme, uint32_t substeps,
                                     const lg_machine_log *log, const size_t *start, size_t count,
                                     size_t steps, double *positions, double *velocities, lg_error *error);

/* The states at rows start[0..count-1], all positions of which are there, whose runs fit the logs best: over
 * `window` rows each, at the end of a part over those that are left, at least 2. The machine's scales weigh
 * positions and velocities. positions (count, positions) and velocities (count, velocities) are in the units
 * of the log. A state whose run is not finite stays at the logged positions and their difference quotients.
 * Errors: LG_INVALID_ARGUMENT, LG_OUT_OF_MEMORY, LG_CANCELLED, the tape's. */
LG_API lg_status lg_machine_estimate_starts(const lg_context *context, const lg_machine *machine,
                                            const double *theta, const lg_scheme *scheme, uint32_t substeps,
                                            const lg_machine_log *log, const size_t *start, size_t count,
                                            uint32_t window, double *positions, double *velocities,
                                            lg_error *error);

/* ---- functions in the units of the log ---- */

/* The machine as a program (liegrad/program.h). Its parameter is theta; a machine without unknown numbers has
 * no parameter. Its functions:
 *   value      (x) -> y           H
 *   grad       (x) -> y, g        H and dH/dx in the ambient space
 *   field      (x, u) -> f        the algebra element of lg_machine_space
 *   velocity   (x, u) -> f        x' in the ambient space
 *   jac_velocity (x, u) -> jac_f_x, jac_f_u
 *   momenta    (q, v) -> x        the state of positions and velocities in the order of logs
 *   velocities (x) -> v           back
 *   positions  (x) -> q
 *   step       (x, u, h) -> next  one step of the explicit `scheme` (NULL: cf4), u held; not projected
 * with x (state), u (inputs; absent without inputs), h (1), q (positions), v (velocities), all in the units
 * of the log: momenta in those of dL/dv. Scales are numbers of the program. Nothing is borrowed. Errors:
 * those of lg_program_build; LG_UNSUPPORTED (an implicit scheme; a classical one where there are
 * directions or rotations; LG_SCHEME_VARIATIONAL). */
LG_API lg_status lg_machine_program(const lg_context *context, const lg_machine *machine, const double *theta,
                                    const lg_scheme *scheme, lg_program **out, lg_error *error);

/* ---- machine files and logs (library liegrad_io from here on) ----
 *
 * What a machine's YAML file says, and logs of machines: CSV or HDF5 in, rows of lg_machine_log out. The
 * guide is docs/machines.md. Library liegrad_io. */

#define LG_LOG_NAME    64 /* bytes of a column's name */
#define LG_LOG_COLUMNS (LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES + LG_MACHINE_INPUTS + 2)

/* ---- the machine file ---- */

typedef enum lg_log_role {
    LG_LOG_TIME,
    LG_LOG_RUN,
    LG_LOG_POSITION,
    LG_LOG_VELOCITY, /* or momentum */
    LG_LOG_INPUT
} lg_log_role;

typedef struct lg_log_column {
    char name[LG_LOG_NAME]; /* in the log */
    lg_log_role role;
    uint32_t index; /* of the coordinate, or of the input */
    double scale;   /* numbers of the file are multiplied by it */
    double noise;   /* standard deviation, after scaling; 0: not given */
} lg_log_column;

/* Where a coordinate's columns stand. */
typedef struct lg_log_coordinate {
    uint32_t place, places;        /* first column and how many: 1 of a line or angle, 3 of a pose, else 0 */
    uint32_t attitude, attitudes;  /* 3 of a direction; 4 (w, x, y, z) or 9 (row-major) of a rotation, pose */
    uint32_t velocity, velocities; /* of a pose 3 velocities, then 3 rates; 0: positions alone */
    bool space_frame;              /* the velocities of a pose are x' in space */
} lg_log_coordinate;

typedef enum lg_log_measured {
    LG_MEASURED_VELOCITIES,
    LG_MEASURED_MOMENTA,
    LG_MEASURED_POSITIONS
} lg_log_measured;
typedef enum lg_input_hold { LG_HOLD_ZERO, LG_HOLD_LINEAR, LG_HOLD_CUBIC } lg_input_hold;
#define LG_LOG_MEASURED_COUNT 3
#define LG_INPUT_HOLD_COUNT   3

typedef struct lg_machine_file {
    lg_machine machine; /* lg_machine_init has been called, with scales of 1 */
    lg_log_measured measured;
    lg_input_hold hold;
    uint32_t delay;                   /* rows by which inputs act later than they are logged */
    bool estimate_delay;              /* `delay: estimate`; delay is 0 */
    bool unwrap;                      /* jumps of angles by more than pi are turns; the default */
    double max_step;                  /* seconds; 0: 1.4 medians */
    uint32_t column_count, time, run; /* run: column_count when there is none */
    lg_log_column columns[LG_LOG_COLUMNS];
    lg_log_coordinate coordinates[LG_MACHINE_COORDINATES];
    char *text; /* the exact text of the file, terminated; owned */
    size_t text_bytes;
    const lg_context *context;
} lg_machine_file;

/* Errors: as for scenes, with the line; LG_UNSUPPORTED for `system:`; what lg_machine_init refuses. */
LG_API lg_status lg_machine_file_read(const lg_context *context, const char *path, lg_machine_file *out,
                                      lg_error *error);
/* The same from memory; `name` stands for the file in sentences. */
LG_API lg_status lg_machine_file_parse(const lg_context *context, const char *name, const char *text,
                                       size_t bytes, lg_machine_file *out, lg_error *error);
LG_API void lg_machine_file_destroy(lg_machine_file *file); /* NULL or zeros are fine */

/* ---- logs ---- */

typedef struct lg_log_options {
    size_t size; /* sizeof(lg_log_options) */
    lg_read_options read;
    int64_t delay;    /* rows; < 0: the machine file's */
    bool consistency; /* positions are compared with velocities; default true */
} lg_log_options;
LG_API void lg_log_options_init(lg_log_options *options);

typedef struct lg_log_statistics {
    double low, high; /* as in the log, after scaling; NaN: all values are missing */
    size_t missing;   /* rows without it */
    /* Estimated standard deviation; of coarse positions and velocities at least step/sqrt(12). NaN: too few
     * rows. */
    double noise;
    bool noise_at_most; /* the column is smooth: its noise is not more than that */
} lg_log_statistics;

#define LG_LOG_SENTENCE 400 /* bytes of a sentence */
typedef struct lg_logs {
    lg_machine_log log; /* views of the arrays below */
    uint32_t files, runs;
    size_t rows_read;         /* of all files; log.rows are those kept */
    double dt_median, dt_max; /* of steps between rows of a run; dt_max with gaps */
    double max_step;          /* longer steps are gaps */
    size_t gaps;
    uint32_t delay; /* rows, as applied */
    /* In the order of the machine file's columns; zeros for time and run. */
    lg_log_statistics columns[LG_LOG_COLUMNS];
    uint32_t warning_count;
    char (*warnings)[LG_LOG_SENTENCE];
    /* Owned. */
    size_t *first;                  /* (parts + 1) */
    uint32_t *part_file, *part_run; /* (parts): index of the file; of the run, counted through all files */
    double *t, *q, *v, *u;
    const lg_context *context;
} lg_logs;

/* Reads CSV or HDF5 files. options NULL: the defaults. Errors: LG_NOT_FOUND, LG_FILE, LG_OUT_OF_MEMORY;
 * LG_FORMAT with file, line (HDF5: row, from 1) and column: text; a missing column; a number so large that
 * the rest of its column is lost in its rounding; time that does not increase; numbers that are no attitude;
 * columns that do not belong together. */
LG_API lg_status lg_logs_read(const lg_context *context, const lg_machine_file *file,
                              const char *const *paths, size_t count, const lg_log_options *options,
                              lg_logs *out, lg_error *error);
LG_API void lg_logs_destroy(lg_logs *logs); /* NULL or zeros are fine */

/* ---- model files of machines ----
 *
 * Model files of machines, written by `lg-identify fit`: the machine's YAML, scales, ranges of the data and
 * parameters. Library liegrad_io. */

#define LG_MACHINE_TEXT 4096 /* bytes of a YAML text in a model file, with its terminator */

/* Smallest and largest number of each position, velocity and input in the training logs, in this order. */
#define LG_MACHINE_RANGE (LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES + LG_MACHINE_INPUTS)
typedef struct lg_machine_range {
    double low[LG_MACHINE_RANGE], high[LG_MACHINE_RANGE];
} lg_machine_range;

typedef struct lg_machine_model_run {
    lg_machine machine;         /* made from `text` and `scales` */
    char text[LG_MACHINE_TEXT]; /* the machine's YAML without comments */
    lg_machine_scales scales;
    lg_machine_range range;
    const lg_scheme *scheme; /* of the library: attribute `integrator` */
    uint32_t substeps, window, stride;
    lg_machine_starts starts;
    double position_scale[LG_MACHINE_COORDINATES]; /* of the loss, in the units of the log */
    double velocity_scale[LG_MACHINE_COORDINATES];
    uint32_t delay; /* rows by which inputs act later than they are logged */
    lg_training training;
    uint64_t windows;
    double dt; /* median */
    char data_sha256[LG_SHA256_TEXT];
} lg_machine_model_run;

typedef struct lg_machine_model_file {
    lg_machine_model_run run;
    size_t parameters; /* run.machine.parameters */
    double *theta;     /* (parameters), in the machine's scaled units */
    double *spread;    /* (parameters, parameters), of lg_identification; NULL: not known */
    size_t epochs_done;
    double *history[LG_FIT_SERIES_COUNT]; /* as in lg_hamiltonian_file */
    lg_provenance provenance;
    const lg_context *context; /* whose memory the arrays are in */
} lg_machine_model_file;

/* Hyperparameters of lg_machine_model_run, and its kind for lg_checkpoint_create and lg_checkpoint_open. */
LG_API extern const lg_field lg_machine_model_fields[];
LG_API extern const lg_recipe lg_recipe_machine_model;

/* The YAML without comments and blank lines; LG_FORMAT when it is longer than LG_MACHINE_TEXT. */
LG_API lg_status lg_machine_model_describe(lg_machine_model_run *run, const char *name, const char *text,
                                           lg_error *error);

/* SHA-256 of the rows of a log as little-endian doubles. */
LG_API void lg_machine_log_sha256(const lg_machine *machine, const lg_machine_log *log,
                                  char text[LG_SHA256_TEXT]);
/* The range of the rows of a log. */
LG_API void lg_machine_find_range(const lg_machine *machine, const lg_machine_log *log,
                                  lg_machine_range *out);

LG_API lg_status lg_model_save_machine_model(const lg_context *context, const char *path,
                                             const lg_machine_model_file *file, const lg_fit *fit,
                                             lg_error *error);
LG_API lg_status lg_model_load_machine_model(const lg_context *context, const char *path,
                                             const lg_read_options *options, lg_machine_model_file *out,
                                             lg_error *error);
LG_API void lg_machine_model_file_destroy(lg_machine_model_file *file);

LG_END_DECLS

#endif
