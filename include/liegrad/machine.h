/* Machines: forced, damped mechanical systems that are learned from logs: their description (coordinates,
 * terms, named systems), formulas on a tape, logs, training on windows of logs, errors of the identified
 * numbers, predictions, files. Library liegrad; from the section on machine files on liegrad_io. Guide:
 * docs/machines.md.
 *
 * The configuration is a product of coordinates. With velocities v, momenta p = M(q) v and H = 1/2 p^T
 * M(q)^-1 p + V(q):
 *
 *   q' = v,  p' = -dH/dq - D(q, v) v + B(q) u + r(q, v, u)
 *
 * For each kind of coordinate these equations have the following form. Here "body" means components along
 * the axes of the body, r_i are the rows of R, and f are the forces other than -dH/dq, in the order of the
 * velocities.
 *
 *   kind       position in logs         velocity in logs          equations
 *   line       q                        q'                        as above
 *   angle      q in radians, unwrapped  q'                        as above; terms see sin q and cos q
 *   direction  q on S^2                 omega in space, q.omega = 0
 *                                                                 p = M omega x q with one number M,
 *                                                                 q' = omega x q,
 *                                                                 p' = omega x p + (dV/dq x q + f) x q;
 *                                                                 for a chain of directions see below
 *   rotation   R, body to space         Omega in the body         R' = R hat(Omega),
 *                                                                 m' = m x Omega + sum_i r_i x dH/dr_i + f
 *   pose       x in space, R            w = R^T x', Omega, body   x' = R w, l' = l x Omega - R^T dH/dx + f_l,
 *                                                                 m' = m x Omega + l x w
 *                                                                      + sum_i r_i x dH/dr_i + f_m
 *
 * f has 3 torques in space for a direction, 3 torques in the body for a rotation, and 3 forces, then 3
 * torques, both in the body, for a pose.
 *
 * A system may couple directions by M(q), where v has q_i' of a direction (in a chain with M_ij = m_ij I).
 * Then p_i = P_i (M v)_i, P_i = I - q_i q_i^T, and with lambda_i = -q_i.(M v)_i, g_i = d(V - v.M v/2)/dq_i
 *   p_i' = omega_i x p_i + (g_i x q_i - lambda_i q_i' x q_i + q_i' x p_i + f_i) x q_i.
 *
 * A constant force may be added. M, V, D, B and r are sums of terms, whose kinds are entries of a table
 * (lg_term_kind_at): known terms are given, the others are learned. M and D are positive (semi)definite by
 * construction, so damping takes energy away. Sensors may have constant biases: positions (of lines, angles
 * and places of poses) and velocities in logs contain them, states do not.
 *
 * The state of an integrator has first the positions of all lines, angles and poses, in the order of the
 * coordinates; then q and p of each direction; then the rotation R of each rotation and pose; then the
 * momenta of all coordinates except directions. These are the factors of lg_machine_space. LuGre friction
 * adds a last factor, the deflections z of the bristles, one for each velocity v:
 *   z' = v - s0 |v| z/g(v), g(v) = c + (cs - c) e^(-(v/vs)^2), force -(s0 z + s1 z').
 * Logs do not have z: it follows from the measured velocities of the 200 rows before a window or run. Where a
 * state comes from positions and velocities alone, z is the one of steady sliding, tanh(v/w) g(v)/s0 with the
 * usual width w: 0 at rest. A step of length h moves z exactly with v constant, z+ = zs + (z - zs) e^(-s0 |v|
 * h/g), zs = sign(v) g/s0, for h/2 before and for h/2 after the rest of the state: an error of order h^2.
 *
 * Friction without a width (Coulomb, asymmetric, Stribeck, by load or position) of lines and angles sticks:
 * it is -c s with s = sign(v), and at v = 0 the s in [-1, 1] that keeps v = 0 if there is one. Whatever the
 * scheme, a step is a classical Runge-Kutta step with s constant, or v = 0, which is divided up to three
 * times (docs/mechanics.md, "Friction that sticks"). The field has s = 0 at v = 0.
 *
 * Scaled units. Internally all quantities are divided by the scales of the machine: times by T
 * (scales.time), positions and velocities of lines and of places of poses by L and L/T (L = 1 for angles,
 * directions and rotations), inputs by U, energies by E. Parameters are then numbers around 1. Everything
 * that is recorded on a tape is in scaled units. */
#ifndef LIEGRAD_MACHINE_H
#define LIEGRAD_MACHINE_H

#include "liegrad/fit.h"
#include "liegrad/mechanics.h"
#include "liegrad/model.h"

LG_BEGIN_DECLS

#define LG_MACHINE_NAME        32 /* Bytes of a name, with its terminator. */
#define LG_MACHINE_COORDINATES 12
#define LG_MACHINE_VELOCITIES  16 /* Most numbers in the velocities of all coordinates. */
#define LG_MACHINE_POSITIONS   48 /* Most numbers in the positions of all coordinates. */
#define LG_MACHINE_INPUTS      16
#define LG_MACHINE_LAGS        (2 * LG_MACHINE_INPUTS) /* An input with a second-order lag has two. */
#define LG_MACHINE_TERMS       16
#define LG_MACHINE_FEATURES    16 /* Most features in one term. */
#define LG_MACHINE_VALUES      (LG_MACHINE_VELOCITIES * LG_MACHINE_VELOCITIES)
#define LG_MACHINE_PARAMETERS  32 /* Most numbers in the parameters of a named system. */

/* ---- Coordinates ---- */

/* What the library knows about one kind of coordinate. A position in a log has `places` numbers on R^n,
 * then 3 numbers per direction or 9 numbers (R row-major) per rotation. */
typedef struct lg_coordinate_row {
    const char *name; /* Such as "line". */
    uint32_t places, directions, rotations;
    uint32_t velocities; /* Numbers in a velocity. */
} lg_coordinate_row;
LG_API const lg_coordinate_row *lg_coordinate_row_of(lg_coordinate_kind kind); /* NULL: unknown kind. */
/* Numbers in a position: places + 3 directions + 9 rotations. */
LG_API uint32_t lg_coordinate_positions(lg_coordinate_kind kind);

typedef struct lg_machine_coordinate {
    char name[LG_MACHINE_NAME];
    lg_coordinate_kind kind;
} lg_machine_coordinate;

/* ---- Features: what terms depend on ---- */

typedef enum lg_machine_sight {
    /* Written NAME. Line: q; angle: sin q, cos q; direction: q; rotation: R; pose: x, R. */
    LG_FEATURE_POSITION,
    LG_FEATURE_PLACE,    /* Written NAME.place: x of a pose. */
    LG_FEATURE_ROTATION, /* Written NAME.rotation: R of a pose. */
    LG_FEATURE_UP,       /* Written NAME.up: R^T e3 of a rotation or pose. */
    /* Written NAME.height. Line: q; angle: sin q, cos q; direction: q_3; rotation: R^T e3; pose: x_3. */
    LG_FEATURE_HEIGHT,
    LG_FEATURE_VELOCITY, /* Written NAME.velocity. */
    LG_FEATURE_INPUT     /* Written as the name of the input. */
} lg_machine_sight;

typedef struct lg_machine_feature {
    lg_machine_sight kind;
    uint32_t index; /* Index of the coordinate, or of the input. */
} lg_machine_feature;

/* ---- Terms ---- */

typedef enum lg_machine_part {
    LG_MACHINE_MASS,
    LG_MACHINE_POTENTIAL,
    LG_MACHINE_DAMPING,
    LG_MACHINE_INPUT_MAP,
    LG_MACHINE_RESIDUAL,
    LG_MACHINE_BIAS,   /* Biases of sensors: a log has the true number plus the bias. */
    LG_MACHINE_OFFSET, /* Constant forces. */
    /* What makes the input u that the other terms see out of the logged one: lag, then curve (input map
     * only). Its terms depend on inputs alone. */
    LG_MACHINE_ACTUATOR
} lg_machine_part;
#define LG_MACHINE_PART_COUNT 8
/* Such as "mass" or "input_map"; NULL: unknown. */
LG_API const char *lg_machine_part_name(lg_machine_part part);

/* An entry of the table of terms; docs/machines.md lists them. lg_term_kind_options returns a sum of the
 * LG_TERM_* below. */
typedef struct lg_term_kind lg_term_kind;
enum {
    LG_TERM_OF = 1,      /* The term has features (`of`). */
    LG_TERM_MOVING = 2,  /* Features may be velocities; in a residual also inputs. */
    LG_TERM_HIDDEN = 4,  /* The term is a network. */
    LG_TERM_DEGREE = 8,  /* The term has a degree (`degree`). */
    LG_TERM_VALUES = 16, /* The term has numbers (`values`): required if the term is known, else optional. */
    LG_TERM_KNOWN = 32,  /* The term has no parameters: all of it is given. */
    LG_TERM_WIDTH = 64,  /* The term has a width (`width`). */
    LG_TERM_SOME = 128,  /* The term may have features, but need not. */
    LG_TERM_INPUTS = 256 /* Features are inputs. */
};
/* NULL beyond the last. */
LG_API const lg_term_kind *lg_term_kind_at(lg_machine_part part, size_t index);
/* NULL: unknown name. */
LG_API const lg_term_kind *lg_term_kind_find(lg_machine_part part, const char *name);
LG_API const char *lg_term_kind_name(const lg_term_kind *kind); /* Its name in machine files. */
LG_API uint32_t lg_term_kind_options(const lg_term_kind *kind); /* The sum of LG_TERM_... that apply. */

#define LG_MACHINE_ENTRIES 32 /* Most unknown numbers among the values of a term. */
/* One of the values of a term that is unknown. Its value is where learning begins; NaN: the start that
 * numbers of the kind have. low < high: the number stays between them. sigma > 0: the standard deviation of
 * a Gaussian prior around the start. All are in the units of the log. */
typedef struct lg_machine_entry {
    uint32_t index; /* Among the values. */
    double low, high, sigma;
} lg_machine_entry;

#define LG_MACHINE_HIDDEN 4
typedef struct lg_machine_term {
    const lg_term_kind *kind; /* Static. */
    lg_machine_part part;
    uint32_t of_count;
    lg_machine_feature of[LG_MACHINE_FEATURES];
    uint32_t hidden_layers, hidden[LG_MACHINE_HIDDEN];
    lg_activation activation;
    uint32_t degree; /* Degree of a polynomial. */
    /* Friction near rest: the velocity w in f tanh(v/w), in the units of the log. 0: the friction sticks
     * (lg_machine.sticks); in machines with other coordinates than lines and angles, lg_machine_width. */
    double width;
    uint32_t value_count; /* Values are in the units of the log. */
    /* Matrices are row-major; mass and damping may also be a diagonal. The mass of a direction is one number
     * of the diagonal, or three equal numbers without couplings. */
    double values[LG_MACHINE_VALUES];
    uint32_t entry_count; /* How many of the values are unknown. */
    lg_machine_entry entries[LG_MACHINE_ENTRIES];
    /* The members below are filled by lg_machine_init. */
    lg_mlp net;
    size_t offset, parameters; /* The term's slice of theta. */
} lg_machine_term;

/* ---- Machines of a named system: formulas with parameters give M and V ---- */

/* The systems of machines, a row each (docs/machines.md); NULL beyond the last. */
LG_API const lg_energy_row *lg_grey_system_at(size_t index);

/* The named system of a machine, with all numbers of its parameters in the order of the table and in the
 * units of the log. For an unknown number, `start` is where learning begins. For unknown numbers theta
 * holds log(number/start) of a positive number; (number - start)/scale of other numbers, where scale is
 * the largest |start| of the parameter (1 where all are 0); and for a unit vector the two numbers of a
 * rotation of the start about axes across it, in radians. */
typedef struct lg_machine_grey {
    const lg_energy_row *system; /* Static; NULL: the machine has no named system. */
    uint32_t count;
    double start[LG_MACHINE_PARAMETERS]; /* A number that is NaN must still be given. */
    bool unknown[LG_MACHINE_PARAMETERS];
    /* Bounds and priors of unknown numbers, as in lg_machine_entry; zeros: none. A bounded number starts at 0
     * in theta. */
    double low[LG_MACHINE_PARAMETERS], high[LG_MACHINE_PARAMETERS], sigma[LG_MACHINE_PARAMETERS];
} lg_machine_grey;

/* ---- The machine ---- */

typedef struct lg_machine_scales {
    double time;                            /* T, seconds. */
    double place[LG_MACHINE_POSITIONS];     /* L of each place, in the order of the state. */
    double velocity[LG_MACHINE_VELOCITIES]; /* L of each velocity. */
    double input[LG_MACHINE_INPUTS];        /* U of each input. */
    double energy;                          /* E, the unit of energies. */
    /* For a normalised machine: which number of the mass is 1 in the units of the log; counts from 1. */
    double held;
    /* The largest speed of each velocity in the log, in the units of the log. Without a log it is 20. */
    double fastest[LG_MACHINE_VELOCITIES];
    /* Least and greatest time constant of a lag that is learned, seconds: 0.2 of the mean step, 0.2 of the
     * longest part. */
    double lag[2];
} lg_machine_scales;

/* A machine. Plain data, copied freely. The caller fills coordinates, inputs, terms and scales
 * (lg_machine_scales_init sets all scales to 1), and lg_machine_init fills the rest. */
typedef struct lg_machine {
    uint32_t coordinate_count, input_count, term_count;
    lg_machine_coordinate coordinates[LG_MACHINE_COORDINATES];
    char inputs[LG_MACHINE_INPUTS][LG_MACHINE_NAME];
    lg_machine_term terms[LG_MACHINE_TERMS];
    lg_machine_scales scales;
    lg_machine_grey grey; /* Filled by lg_machine_set_system. */
    /* Logs measure accelerations alone, of lines and angles (lg_machine_log.a). A bias of a velocity is then
     * the bias of the acceleration. */
    bool accelerations;
    /* The members below are filled by lg_machine_init. Velocities alone determine M, V, D and B only up to
     * a common factor. A term with values, or a known number of a system, fixes the factor (but a known
     * map of an input that never acts fixes nothing; lg_machine_identify finds that out). If there is
     * neither, and the mass is one constant or diagonal term, one mass is set to 1 in the units of the log
     * (normalised): in a diagonal mass that of the velocity with the largest acceleration, else the first.
     * Otherwise nothing fixes the factor (free_gauge). */
    bool normalised, free_gauge;
    /* How many positions are on R^n, copies of S^2, copies of SO(3). */
    uint32_t places, directions, rotations;
    uint32_t momenta;               /* Numbers in the momenta of all coordinates except directions. */
    uint32_t positions, velocities; /* How many positions and velocities a row of a log has. */
    /* The lagged inputs, and the input of each one, rising. An input with a first-order lag has one, tau x' =
     * u - x. An input with a second-order lag has two that follow each other, two equal lags in series
     * (critically damped): tau x_1' = u - x_1 and tau x_2' = x_1 - x_2. The terms see the last one. */
    uint32_t lags, lagged[LG_MACHINE_LAGS];
    uint32_t bristles; /* With LuGre friction: velocities; else 0. */
    uint32_t sticks;   /* Bit k: friction without a width may act on velocity k, and it sticks. */
    /* Length of theta; its first `weights` numbers belong to networks. */
    size_t parameters, weights;
} lg_machine;

LG_API void lg_machine_scales_init(lg_machine_scales *scales);
/* The width of a friction term at one velocity: that of the term or, if this is 0, a thousandth of the
 * largest speed in the log. Friction that sticks has this width in LG_SCHEME_VARIATIONAL alone. */
LG_API double lg_machine_width(const lg_machine *machine, const lg_machine_term *term, uint32_t velocity);
/* Checks a machine and fills its other members. Errors: LG_INVALID_ARGUMENT (no or too many coordinates, a
 * term that does not fit its part or the coordinates, a wrong number of values, features or widths, names
 * that are not unique, known masses or dampings that are not positive, inputs without an input map, no
 * mass, more than 64 numbers with a prior). */
LG_API lg_status lg_machine_init(lg_machine *machine, lg_error *error);
/* Adds the terms of a named system to a machine that already has its coordinates: a mass and, if the
 * system has one, a potential. Call it before lg_machine_init. All numbers of the system are then known
 * and have their defaults. Errors: LG_NOT_FOUND (no such system, or a system without a machine),
 * LG_INVALID_ARGUMENT (other coordinates than the system has, a second system, too many terms). */
LG_API lg_status lg_machine_set_system(lg_machine *machine, const char *name, lg_error *error);
/* Sets the numbers of one parameter of the named system. `values` has `count` numbers; a NaN among them
 * means the default, or 1 where a number has no default, is unknown and must be positive. count = 0 means
 * that all numbers have their defaults. `unknown` has `count` flags, or one flag for all numbers if count
 * is 0; NULL means that all are known. Errors: LG_INVALID_ARGUMENT (an unknown key, a wrong count, a
 * number against its rule, a number without a default, a unit vector of which only some numbers are
 * unknown). After an error nothing is changed. */
LG_API lg_status lg_machine_set_parameter(lg_machine *machine, const char *key, size_t count,
                                          const double *values, const bool *unknown, lg_error *error);
/* Gives unknown number `index` of a parameter bounds (low < high) and a prior (sigma > 0); zeros mean none.
 * Call it after lg_machine_set_parameter. Errors: LG_INVALID_ARGUMENT (an unknown key, a number that is known
 * or part of a unit vector, a start outside of the bounds, bounds against the parameter's rule). */
LG_API lg_status lg_machine_bound_parameter(lg_machine *machine, const char *key, size_t index, double low,
                                            double high, double sigma, lg_error *error);
/* Fills `space` with the space of the machine's mechanical states. Errors: those of lg_space_init. */
LG_API lg_status lg_machine_space(const lg_machine *machine, lg_space *space);
/* The same with a last factor R^lags, the lagged inputs: the states of lg_machine_program. Without lags it is
 * lg_machine_space. */
LG_API lg_status lg_machine_full_space(const lg_machine *machine, lg_space *space);

/* Draws theta (`parameters` numbers; here and below NULL is allowed for a machine without parameters).
 * Weights of networks are from U(+-1/sqrt(fan_in)), those of last layers multiplied by 0.1. In scaled
 * units masses are 1, dampings small, the input map 1 from input j to velocity j and 0 elsewhere,
 * potentials and residuals 0. */
LG_API void lg_machine_initialise(const lg_machine *machine, lg_rng *rng, double *theta);

/* ---- Formulas on a tape (batches of B rows, in scaled units) ---- */

/* Variables that depend on theta only. Borrows the machine; valid until the tape is rewound. */
typedef struct lg_machine_vars {
    const lg_machine *machine;
    lg_var theta[LG_MACHINE_TERMS];    /* Slices of theta; LG_NONE for terms without parameters. */
    lg_mlp_vars net[LG_MACHINE_TERMS]; /* The networks of terms that are networks. */
    /* Numbers of the named system in the units of the log; LG_NONE without a system. */
    lg_var grey;
    lg_var mass, inverse; /* (n, n) for the n momenta, or velocities; LG_NONE where M depends on q. */
    /* (1, directions, 1), for a chain (1, k, k); LG_NONE where `mass` or M(q) has the directions. */
    lg_var direction_mass;
    lg_var direction_inverse; /* (1, k, k) for a chain, else LG_NONE. */
    lg_var bias;              /* (1, positions + velocities), or LG_NONE. */
    lg_var lag;               /* (1, lags): log of the lags' time constants over T; LG_NONE without lags. */
    lg_var bristles[5]; /* c, cs - c, vs, s0 and s1 of LuGre friction, each (1, velocities), or LG_NONE. */
    bool soft;          /* Friction without a width has the default width, as in LG_SCHEME_VARIATIONAL. */
} lg_machine_vars;
LG_API lg_status lg_machine_bind(lg_tape *tape, const lg_machine *machine, lg_var theta,
                                 lg_machine_vars *vars);

/* Convert between positions (B, positions) and velocities (B, velocities) in the order of logs and the
 * parts of a state (liegrad/taped.h). Logs contain the biases, states do not: lg_machine_record_state
 * subtracts them, the other two functions add them. Errors stick to the tape. */
LG_API lg_status lg_machine_record_state(lg_tape *tape, const lg_machine_vars *vars, lg_var positions,
                                         lg_var velocities, lg_var *parts);
LG_API lg_var lg_machine_record_positions(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts);
LG_API lg_var lg_machine_record_velocities(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts);
/* Returns H (B, 1). */
LG_API lg_var lg_machine_record_energy(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts);
/* Returns the velocities v (B, velocities) of the state, without biases. */
LG_API lg_var lg_machine_record_rates(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts);
/* Returns the forces f (B, velocities) of one part: LG_MACHINE_DAMPING (-D v), LG_MACHINE_INPUT_MAP (B u),
 * LG_MACHINE_RESIDUAL or LG_MACHINE_OFFSET; LG_NONE when the machine has no such part. `rates` is v; u is
 * (B, inputs), after the lags, or LG_NONE. */
LG_API lg_var lg_machine_record_force(lg_tape *tape, const lg_machine_vars *vars, lg_machine_part part,
                                      const lg_var *parts, lg_var rates, lg_var u);
/* Writes the parts of the field, an algebra element. u is (B, inputs), after the lags, or LG_NONE. */
LG_API lg_status lg_machine_record_field(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts,
                                         lg_var u, lg_var *algebra);

/* ---- Logs ---- */

/* The rows of logs, in the machine's order and in the units of the log. A part is a stretch of rows
 * without a gap: part i has the rows first[i] .. first[i + 1] - 1. NaN marks a missing value; the position
 * of a direction or rotation is either complete or missing altogether. All arrays are borrowed by the
 * functions below. */
typedef struct lg_machine_log {
    size_t rows, parts;
    const size_t *first; /* (parts + 1); see above. */
    const double *t;     /* (rows), seconds; increases within a part. */
    const double *q;     /* (rows, positions): R row-major, angles unwrapped. */
    const double *v;     /* (rows, velocities); all NaN if only positions are measured. */
    /* (rows, 4, inputs), NULL without inputs: numbers u_0, u_1, u_2, u_3 per row. The input between row j
     * and the next is u(t_j + s h_j) = u_0 + s u_1 + s^2 u_2 + s^3 u_3 for 0 <= s <= 1, where h_j is the
     * time between them. If inputs are held, only u_0 is not 0. */
    const double *u;
    /* (parts, lags), lagged inputs at the first row of each part. NULL: u_0 of that row in a part that
     * begins at rest (velocities below 1/50 of the part's largest), else 0. */
    const double *lag;
    struct lg_machine_filter *filter; /* See below; NULL: lagged inputs are computed again in each call. */
    /* (rows, velocities), for machines of `accelerations`, else NULL: v' with its bias. q and v of such a log
     * are guesses without missing numbers. They only serve as first starts of windows and runs. */
    const double *a;
} lg_machine_log;

/* Keeps the lagged inputs (lg_machine.lagged) of a log, which must outlive it, at all rows for the last time
 * constants. Threads may share it. It reads t, u, lag and the velocities of the log. */
typedef struct lg_machine_filter lg_machine_filter;
LG_API lg_status lg_machine_filter_create(const lg_context *context, const lg_machine *machine,
                                          const lg_machine_log *log, lg_machine_filter **out,
                                          lg_error *error);
LG_API void lg_machine_filter_destroy(lg_machine_filter *filter);
/* Writes the lagged inputs (count, lags) at the rows at[0..count-1], in the log's units. */
LG_API lg_status lg_machine_lagged_inputs(const lg_context *context, const lg_machine *machine,
                                          const double *theta, const lg_machine_log *log, const size_t *at,
                                          size_t count, double *out, lg_error *error);
/* Returns the part to which a row belongs. */
LG_API size_t lg_machine_log_part(const lg_machine_log *log, size_t row);
/* Whether a row has all positions and, unless `positions_only`, all velocities. */
LG_API bool lg_machine_log_complete(const lg_machine *machine, const lg_machine_log *log, size_t row,
                                    bool positions_only);

/* Sets the scales of a machine from the root mean squares of a log: T from velocities and accelerations; L of
 * a line or pose as T times its velocity; U from the inputs; E such that masses are around 1. Call
 * lg_machine_init before; what it filled stays. Errors: LG_FORMAT (nothing moves, all velocities are
 * constant, or numbers overflow). */
LG_API lg_status lg_machine_find_scales(lg_machine *machine, const lg_machine_log *log, lg_error *error);

/* Finds the largest rate, in 1/s, at which damping slows a motion near rest: the largest slope of the force
 * over mass at rows of the log. Explicit steps over h come to rest where h rate <= 2.5. Errors: the tape. */
LG_API lg_status lg_machine_rest_rate(const lg_context *context, const lg_machine *machine,
                                      const double *theta, const lg_machine_log *log, double *rate,
                                      lg_error *error);

/* ---- Steps ----
 *
 * A step over an interval of a log is made by an explicit Lie group scheme (LG_SCHEME_RKMK,
 * LG_SCHEME_COMMUTATOR_FREE), or by LG_SCHEME_VARIATIONAL, of order 2, which does a kick over h/2, a drift
 * over h and a kick over h/2:
 *
 * - kick: p1 = p0 + h/2 f(q, (v0 + v1)/2, u), where f are all forces, with -dV/dq among them. u is taken at
 *   the start of the step for the first kick and at its end for the second. A kick is implicit where f
 *   depends on v. It changes the kinetic energy by h/2 f.(v0 + v1)/2, so damping adds no energy.
 * - drift: free motion. Lines, angles and directions move exactly. Bodies move by the variational integrator
 *   with the discrete Lagrangian h/2 v^T M v, g1 = g0 exp(h v) on SO(3) or SE(3), which is implicit in v:
 *     p0 = (dexp_{h v}^-1)^T M v,  p1 = Ad_{exp(h v)}^T p0
 *   Momenta in space are constant to rounding.
 *
 * If -dV/dq is the only force, these steps are symplectic and symmetric. M may be full and couple
 * coordinates. LG_UNSUPPORTED: M depends on the state, or directions are coupled. Newton's
 * method solves the implicit equations row by row; a row without a solution becomes NaN. First and second
 * derivatives are exact. */

/* ---- Training ---- */

typedef enum lg_machine_starts { LG_MACHINE_STARTS_MEASURED, LG_MACHINE_STARTS_ESTIMATED } lg_machine_starts;

/* A training problem on windows of M consecutive rows of logs. The model predicts each window from its first
 * row with the logged inputs. The loss is the mean over windows and points 2..M (with estimated starts,
 * points 1..M) of the sum over columns of ((predicted - logged)/scale)^2, with the scales below. A rotation
 * counts |R' - R|^2/2, which is the squared angle for small angles, and a direction |q' - q|^2. Of a
 * direction's omega only the part across the logged q counts, (1 - q q^T) omega: logs contain no omega along
 * q, and an error dq of the logged q would appear as |omega| dq along q. All pointers are borrowed.
 *
 * For a machine of `accelerations` the columns are the accelerations alone: those of the model at a row are
 * v' at the predicted state, with the input right after the row, and velocity_scale is a scale of
 * accelerations. Such windows must be long enough to show their starts; position_scale is not used.
 *
 * Only memory limits M. With d = 2 velocities (+ 1 for each direction), P parameters (of theta and of one
 * start) and B windows at once, Levenberg-Marquardt takes about 8 B M d P bytes, and from M = 512 on for
 * lines and angles 8 M d (d + P + 4) more; B M is at most about 65000 or one window. All rows of such a
 * window are solved for together (Newton's method on the equations of all intervals); if that does not
 * converge, row after row. The other minimisers keep the whole tape, 20 to 200 kB for a row of one window. */
typedef struct lg_machine_problem {
    const lg_machine *machine;
    const lg_scheme *scheme;
    uint32_t substeps; /* Integrator steps between two rows, >= 1. */
    uint32_t window;   /* M >= 2. */
    lg_machine_starts starts;
    /* NULL: theta is learned. Else the known parameters of the machine; then only the starts are learned. */
    const double *theta;
    /* Standard deviation of the residuals in units of the loss, which weighs the priors of numbers: the loss
     * gets residual^2 ((number - start)/sigma)^2 divided by the training part's windows and points. 0: 1, for
     * scales that are the noise. */
    double residual;
    lg_machine_log log;
    size_t windows;
    /* (windows): first rows of the windows; a window lies in one part. */
    const size_t *start;
    /* The last `validation` windows are the validation part. */
    size_t validation;
    /* Scales of the loss, one per coordinate, in the units of the log (radians for attitudes). */
    double position_scale[LG_MACHINE_COORDINATES];
    double velocity_scale[LG_MACHINE_COORDINATES];
} lg_machine_problem;

/* Finds the rows at which windows start and returns their number; `out` (NULL: only count) has room for
 * log->rows indices, which increase. Windows start at complete rows (velocities too, unless
 * `positions_only`), `stride` rows apart within a part, or closer, so that with stride <= window every row
 * that can be in a window is in one. With a longer stride windows are at most `stride` apart where that is
 * possible, and the last window of a part ends as late as possible. */
LG_API size_t lg_machine_windows(const lg_machine *machine, const lg_machine_log *log, uint32_t window,
                                 uint32_t stride, bool positions_only, size_t *out);
/* Checks a training problem. Errors: LG_INVALID_ARGUMENT (no windows, sizes, scales, nothing to learn),
 * LG_UNSUPPORTED (the scheme leaves the manifold, is implicit or does not fit the machine). */
LG_API lg_status lg_machine_problem_check(const lg_machine_problem *problem, lg_error *error);
/* lg_machine_problem_parameters returns the number of parameters of the fit, and lg_machine_fit_problem
 * fills a problem for lg_fit; `problem` is borrowed and must outlive the fit. The parameters are theta,
 * unless it is known; then, with estimated starts, for each window the offsets of its start from the
 * logged row: (places, 3 per direction, 3 per rotation, velocities), in units of the loss's scale times
 * the square root of the number of windows; for a machine of `accelerations` the scale of an acceleration is
 * multiplied by scales.time for velocities, and by its square for positions. */
LG_API size_t lg_machine_problem_parameters(const lg_machine_problem *problem);
LG_API void lg_machine_fit_problem(const lg_machine_problem *problem, lg_fit_problem *out);
/* Writes the loss over all windows except the validation part, for the parameters `theta` of the fit. `floor`
 * (may be NULL) becomes the loss that the integrator's error would make alone; a fit can hide a part of it in
 * its numbers and starts. Errors: those of lg_machine_problem_check and of the tape. */
LG_API lg_status lg_machine_loss(const lg_context *context, const lg_machine_problem *problem,
                                 const double *theta, double *loss, double *floor, lg_error *error);

/* ---- Identified numbers ---- */

/* A number that means something to the user, in the units of the log, with a name such as "m1", "mass.1.2",
 * "damping.x" or "lag.u" (docs/machines.md, "The identified numbers"). If a mass is a network, the numbers
 * are those of M at one position, by default the reference: places and angles 0, directions e3, attitudes 1.
 * `error` is one standard deviation, from the Gauss-Newton matrix and the residuals, without a prior;
 * infinite where the data do not determine the number. Residuals that are correlated in time are taken in
 * blocks of four correlation times, or of an eighth of the log, whichever makes larger errors. At most 8192
 * windows are used, 512 for more than 64 parameters. */
#define LG_IDENTIFIED_NAME 96
typedef struct lg_identified {
    char name[LG_IDENTIFIED_NAME];
    double value, error;
} lg_identified;
/* Writes the values of a machine's numbers (their `error` is NaN) to `out`, at most `room`; returns how
 * many there are. If memory runs out, the values of a system and of a network mass are NaN. */
LG_API size_t lg_machine_numbers(const lg_machine *machine, const double *theta, size_t room,
                                 lg_identified *out);
/* Chooses the position at which the mass of a network is reported, one where the logs can determine it:
 * the reference, if a training window begins within a tenth of the standard deviation of the positions on
 * which the mass depends; otherwise the start of the window that is nearest to the mean of all starts.
 * Writes it to `positions` in the order of logs. Returns false if no mass is a network; the position then
 * does not matter. */
LG_API bool lg_machine_mass_at(const lg_machine_problem *problem, double *positions);
/* What the logs say about the N numbers of lg_machine_numbers, where the mass of a network is taken at
 * lg_machine_mass_at. The caller provides the arrays. */
typedef struct lg_identification {
    lg_identified *numbers; /* (N), with errors. */
    /* (N, N): correlations of the errors; 0 where an error is 0 or infinite, 1 on the diagonal. NULL: not
     * computed. */
    double *correlations;
    /* Open directions: relative changes of the numbers that can be made together while the logs stay the
     * same to within their noise. Room for (N, N), of which open_count rows are filled; the largest change
     * in a row is 1, and each row changes one number that no other row changes. NULL: not computed. */
    double *open;
    size_t open_count;
    /* W (P, P), row-major, for P parameters: W W^T is the covariance of theta, so theta + W x, with x from
     * N(0, 1), is a machine that the logs allow as well. Only here weights of networks have the prior
     * N(0, 1). NULL: not computed. */
    double *spread;
    /* 0: the residuals are white. Otherwise they are correlated in time: seconds of the blocks that give the
     * errors, correlations, open directions and W. */
    double block;
    /* Input: standard deviation of the prior with which weights of networks were fitted; 0: none. */
    double prior;
    /* The largest change of a number by another Gauss-Newton step, in units of its error. Above 1 the fit has
     * not converged. 0 if a number is at the end of its range. */
    double step;
} lg_identification;
/* Fills `out`. `theta` has the parameters of the fit, with the starts if they are estimated;
 * problem->theta must be NULL. Errors: LG_CANCELLED, those of the tape. */
LG_API lg_status lg_machine_identify(const lg_context *context, const lg_machine_problem *problem,
                                     const double *theta, lg_identification *out, lg_error *error);

/* ---- A few numbers for a new log ----
 *
 * theta = theta0 + sum_k x_k direction_k: a learned machine is moved along a few directions only, such as
 * "all friction by a factor" and "a constant force". */

typedef struct lg_machine_restriction {
    const lg_machine_problem *problem; /* its theta is NULL */
    const double *theta;               /* (P): theta0, P parameters of the machine */
    size_t count;                      /* numbers x */
    const double *directions;          /* (count, P) */
} lg_machine_restriction;

/* All arrays have `count` numbers and belong to the caller. */
typedef struct lg_machine_adapted {
    double *x;
    double *error;        /* standard deviation with the prior */
    double *alone;        /* standard deviation from the logs alone, infinite where they show nothing */
    double before, after; /* losses with x = 0 and with x; the starts are estimated for each */
    double block;         /* as in lg_identification */
    /* x^T C^-1 x, where C is the covariance from the logs alone: chi-squared with `count` degrees of freedom
     * if nothing has changed */
    double change;
} lg_machine_adapted;
/* Finds the most probable x; before any data each x_k is from N(0, 1), so directions have the length of their
 * prior's standard deviation. Errors: those of lg_fit and of the tape, LG_NOT_FINITE (the runs). */
LG_API lg_status lg_machine_adapt(const lg_context *context, const lg_machine_restriction *restriction,
                                  lg_machine_adapted *out, lg_error *error);

/* ---- Predictions ---- */

/* Free runs: predicts `count` runs that begin at the logged rows start[0..count-1] and go over `steps`
 * intervals of the log each, all within one part. Writes positions (count, steps + 1, positions) and
 * velocities (count, steps + 1, velocities) in the units of the log; each may be NULL. The first point is
 * the logged row. For a machine of `accelerations` the velocities are accelerations, with the biases of
 * their sensors. A run that becomes infinite or NaN continues as NaN. With `steps` LG_MACHINE_TO_END each
 * run goes to the end of its part, and the results are positions (rows, positions) and velocities (rows,
 * velocities) at the rows of the log: NaN in rows that no run reaches, infinite where a run is NaN; count
 * may be 0. Errors: LG_CANCELLED, LG_INVALID_ARGUMENT, LG_UNSUPPORTED (the scheme), those of the tape. */
#define LG_MACHINE_TO_END SIZE_MAX
LG_API lg_status lg_machine_free_run(const lg_context *context, const lg_machine *machine,
                                     const double *theta, const lg_scheme *scheme, uint32_t substeps,
                                     const lg_machine_log *log, const size_t *start, size_t count,
                                     size_t steps, double *positions, double *velocities, lg_error *error);

/* Estimates the states at the rows start[0..count-1]: the states from which a run fits the log best over
 * `window` rows, of which the start row is the first. If the part has fewer rows, it uses these; there
 * must be at least 2. All positions of the rows start[0..count-1] must be there. The machine's scales
 * weigh positions against velocities; a machine of `accelerations` is compared with these alone. Writes
 * positions (count, positions) and velocities (count, velocities) in the units of the log. A state whose
 * run is not finite keeps the logged positions and velocities; difference quotients of the positions
 * replace missing velocities. Errors: LG_INVALID_ARGUMENT, LG_CANCELLED, those of the tape. */
LG_API lg_status lg_machine_estimate_starts(const lg_context *context, const lg_machine *machine,
                                            const double *theta, const lg_scheme *scheme, uint32_t substeps,
                                            const lg_machine_log *log, const size_t *start, size_t count,
                                            uint32_t window, double *positions, double *velocities,
                                            lg_error *error);

/* ---- The machine as a program ---- */

/* Makes a program (liegrad/program.h) of the machine with the parameter theta (no parameter when nothing is
 * unknown). It borrows nothing. Functions:
 *   value      (x) -> y           H
 *   grad       (x) -> y, g        H and dH/dx in the ambient space
 *   field      (x, u) -> f        the algebra element of lg_machine_space
 *   velocity   (x, u) -> f        x' in the ambient space
 *   jac_velocity (x, u) -> jac_f_x, jac_f_u   the Jacobians of velocity
 *   momenta    (q, v) -> x        the state, from positions and velocities in the order of logs
 *   velocities (x) -> v           the velocities of a state
 *   positions  (x) -> q           the positions of a state
 *   step       (x, u, h) -> next  one step of `scheme` (explicit; NULL: cf4), u constant, not projected; of
 *                                 a machine whose friction sticks, the step of this friction
 * with x (state of lg_machine_full_space), u (inputs; absent without inputs), h (1), q (positions), v
 * (velocities), all in the units of the log. `momenta` sets the lagged inputs, the last numbers of x, to 0;
 * `step` moves them exactly, and bristles as said above. With `lagged`, for a controller that knows the
 * lagged inputs (liegrad/policy.h), q of `momenta` and `positions` consists of the positions, then the lagged
 * inputs, and a machine with lags has a further function
 *   lag        (a, u, h) -> next  the lagged inputs a after the time h in which u is held
 * Momenta have the unit of dL/dv. Scales are constants of the program. With LG_SCHEME_VARIATIONAL six steps
 * of Newton's method solve each implicit equation; where the last one moves the scaled velocities by more
 * than 1e-5 of 1 and the largest, the result is not finite. With bristles and a lag, `step` takes lagged
 * inputs as parabolas, which is exact where stages are at 0, h/2 and h (rk4, cf4, rkmk4).
 * Errors: those of lg_program_build; LG_UNSUPPORTED (an implicit scheme, unless friction sticks, where the
 * step does not use the scheme; a classical scheme if there are directions or rotations;
 * LG_SCHEME_VARIATIONAL for a machine that it does not fit). */
LG_API lg_status lg_machine_program(const lg_context *context, const lg_machine *machine, const double *theta,
                                    const lg_scheme *scheme, bool lagged, lg_program **out, lg_error *error);

/* ---- Machine files and logs (library liegrad_io from here on; guide: docs/machines.md) ----
 *
 * A machine file is the YAML description of a machine and of the columns of its logs. Logs are CSV or HDF5
 * files; they become the rows of an lg_machine_log. */

#define LG_LOG_NAME    64 /* Bytes of a column's name, with its terminator. */
#define LG_LOG_COLUMNS (LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES + LG_MACHINE_INPUTS + 2)

/* ---- The machine file ---- */

typedef enum lg_log_role {
    LG_LOG_TIME,
    LG_LOG_RUN,
    LG_LOG_POSITION,
    LG_LOG_VELOCITY, /* A velocity; a momentum or an acceleration where these are measured. */
    LG_LOG_INPUT
} lg_log_role;

typedef struct lg_log_column {
    char name[LG_LOG_NAME]; /* Name of the column in the log. */
    lg_log_role role;
    uint32_t index; /* Index of the coordinate, or of the input. */
    double scale;   /* Numbers of the log are multiplied by it. */
    double noise;   /* Standard deviation, after scaling; 0: not given. */
} lg_log_column;

/* The columns of a coordinate: index of the first one in lg_machine_file.columns, and how many there are. */
typedef struct lg_log_coordinate {
    /* Place: 1 column for a line or angle, 3 for a pose, else 0. */
    uint32_t place, places;
    /* Attitude: 3 for a direction; 4 (w, x, y, z) or 9 (R row-major) for a rotation or pose; else 0. */
    uint32_t attitude, attitudes;
    /* Velocity or measured acceleration; a pose has 3 velocities, then 3 rates. 0: positions alone. */
    uint32_t velocity, velocities;
    bool space_frame; /* The velocity columns of a pose are x' in space. */
} lg_log_coordinate;

typedef enum lg_log_measured {
    LG_MEASURED_VELOCITIES,
    LG_MEASURED_MOMENTA,
    LG_MEASURED_POSITIONS,
    /* Lines and angles alone. Positions in logs are the integrals of the velocities from 0 at the start of
     * each part; no force may depend on them. */
    LG_MEASURED_VELOCITIES_ONLY,
    /* Lines and angles alone. Logs have an acceleration of each coordinate, and the machine has the flag
     * `accelerations`. Velocities and positions in logs are guesses: the integrals of the accelerations of
     * each part, each minus a straight line. */
    LG_MEASURED_ACCELERATIONS
} lg_log_measured;
typedef enum lg_input_hold { LG_HOLD_ZERO, LG_HOLD_LINEAR, LG_HOLD_CUBIC } lg_input_hold;
#define LG_LOG_MEASURED_COUNT 5
#define LG_INPUT_HOLD_COUNT   3

/* How an input acts between rows, and when. */
typedef struct lg_log_input {
    lg_input_hold hold;
    uint32_t delay; /* Rows by which the input acts later than it is logged. */
    /* `hold: auto` and `delay: auto`: fits choose; `hold` is then zero, `delay` 0. */
    bool choose_hold, choose_delay;
    bool estimate_delay; /* `delay: estimate`; `delay` is then 0. */
} lg_log_input;

typedef struct lg_machine_file {
    lg_machine machine; /* lg_machine_init has been called; all scales are 1. */
    lg_log_measured measured;
    bool hold_given; /* The file has the key `hold`. */
    /* Jumps of angles by more than pi are undone as turns; default true. Velocities bridge missing values. */
    bool unwrap;
    double max_step; /* Longer steps are gaps; seconds. 0: 1.4 times the median step. */
    /* Indices of the columns of time and run; `run` equals column_count when there is no such column. */
    uint32_t column_count, time, run;
    lg_log_column columns[LG_LOG_COLUMNS];
    lg_log_coordinate coordinates[LG_MACHINE_COORDINATES];
    lg_log_input inputs[LG_MACHINE_INPUTS];
    char *text; /* The exact text of the file with a terminator; owned. */
    size_t text_bytes;
    const lg_context *context;
} lg_machine_file;

/* Reads a machine file. YAML documents behind the first one are changes of the machine. Errors: LG_FORMAT
 * (with the line; also for a machine that lg_machine_init rejects). */
LG_API lg_status lg_machine_file_read(const lg_context *context, const char *path, lg_machine_file *out,
                                      lg_error *error);
/* The same from text in memory; `name` stands for the file in messages. */
LG_API lg_status lg_machine_file_parse(const lg_context *context, const char *name, const char *text,
                                       size_t bytes, lg_machine_file *out, lg_error *error);
LG_API void lg_machine_file_destroy(lg_machine_file *file);

/* ---- Logs of machines ---- */

typedef struct lg_log_options {
    size_t size; /* sizeof(lg_log_options) */
    lg_read_options read;
    uint32_t delay;   /* Rows, of inputs with `delay: estimate`; default 0. */
    bool consistency; /* Positions are compared with velocities; default true. */
    bool clocks;      /* Rows of other times are compared, too (lg_logs.lag); default false. */
} lg_log_options;
LG_API void lg_log_options_init(lg_log_options *options);

typedef struct lg_log_statistics {
    /* Smallest and largest value in the log, after scaling. NaN: all values are missing. */
    double low, high;
    size_t missing; /* Number of rows without a value. */
    /* Outliers: values of a velocity, or of the position of a line or angle, that jump away from their
     * neighbours for one or two rows. The log is without them; so are low and high, except for angles. */
    size_t outliers;
    /* Estimated standard deviation of the noise. For positions and velocities in coarse steps at least
     * step/sqrt(12). NaN: too few rows. All columns of an attitude have one number: the noise of its angles,
     * half of it for a quaternion. So has the velocity of a direction: the noise of omega across it. */
    double noise;
    bool noise_at_most; /* The column is smooth: `noise` is only an upper bound. */
} lg_log_statistics;

/* A run of rows in which a position stays as it is. */
typedef struct lg_standstill {
    size_t row, rows; /* rows is 0 if the position never stands still */
    double value;
} lg_standstill;

#define LG_LOG_SENTENCE 400 /* Bytes of a warning, with its terminator. */
typedef struct lg_logs {
    lg_machine_log log; /* Views of the arrays below. */
    uint32_t files, runs;
    size_t rows_read; /* Rows in all files; log.rows counts the rows that are kept. */
    /* Steps between rows of a run, seconds; gaps count in dt_max. */
    double dt_median, dt_max;
    double max_step; /* Steps longer than this are gaps, seconds. */
    size_t gaps;
    uint32_t delay[LG_MACHINE_INPUTS]; /* Of each input in rows, as it was applied. */
    /* In the order of the machine file's columns; zeros for the columns of time and run. */
    lg_log_statistics columns[LG_LOG_COLUMNS];
    /* With lg_log_options.clocks, for each coordinate: how badly the velocities explain its motion, the root
     * mean square of the changes from row to row minus integrated velocities, divided by that of the changes
     * (NaN: nothing to compare); the lag, within 12 rows, at which velocities of later rows explain it best,
     * 0 unless they leave less than half of what those of the same rows leave; what they leave then. */
    double motion[LG_MACHINE_COORDINATES], left[LG_MACHINE_COORDINATES];
    int lag[LG_MACHINE_COORDINATES];
    /* For each line or angle whose velocity is measured: the noise of its position, from its changes less the
     * integrated velocity (noise gives neighbouring differences opposite signs, curvature does not; 0: none);
     * the longest run of rows in which it stands still although the integrated velocity shows motion. */
    double position_noise[LG_MACHINE_COORDINATES];
    lg_standstill stuck[LG_MACHINE_COORDINATES];
    uint32_t warning_count;
    char (*warnings)[LG_LOG_SENTENCE];
    /* Owned arrays. */
    size_t *first; /* (parts + 1) */
    /* (parts): index of the part's file; index of its run, counted through all files. */
    uint32_t *part_file, *part_run;
    char *run_names;           /* The names of all runs as in the logs, each with its terminator. */
    double *t, *q, *v, *u, *a; /* a: NULL unless accelerations are measured */
    lg_machine_filter *filter; /* of machines with lags, else NULL */
    const lg_context *context;
} lg_logs;

/* Reads logs from CSV or HDF5 files. Errors: LG_FORMAT with file, line (HDF5: row, from 1) and column: text
 * instead of a number; a missing column; a number in whose rounding the rest of its column is lost; time that
 * does not increase; numbers that are not an attitude; columns that do not fit together. */
LG_API lg_status lg_logs_read(const lg_context *context, const lg_machine_file *file,
                              const char *const *paths, size_t count, const lg_log_options *options,
                              lg_logs *out, lg_error *error);
LG_API void lg_logs_destroy(lg_logs *logs);

/* ---- Model files of machines: YAML text, scales, ranges of the data, parameters ---- */

#define LG_MACHINE_TEXT 4096 /* Bytes of the YAML text in a model file, with its terminator. */

/* Smallest and largest number in the training logs of each position, then each velocity, then each input.
 * For states that the logs do not have, those of the model's runs over them. */
#define LG_MACHINE_RANGE (LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES + LG_MACHINE_INPUTS)
typedef struct lg_machine_range {
    double low[LG_MACHINE_RANGE], high[LG_MACHINE_RANGE];
} lg_machine_range;

typedef struct lg_machine_model_run {
    lg_machine machine;         /* Made from `text` and `scales`. */
    char text[LG_MACHINE_TEXT]; /* The machine's YAML without comments. */
    lg_machine_scales scales;
    lg_machine_range range;
    const lg_scheme *scheme; /* A scheme of the library: attribute `integrator`. */
    uint32_t substeps, window, stride;
    lg_machine_starts starts;
    double position_scale[LG_MACHINE_COORDINATES]; /* Scales of the loss, in the units of the log. */
    double velocity_scale[LG_MACHINE_COORDINATES];
    double residual; /* lg_machine_problem.residual; 0 in files without it. */
    /* Rows of delay of inputs with `delay: estimate`, else the greatest delay: attribute `delay`. */
    uint32_t estimated;
    uint32_t delay[LG_MACHINE_INPUTS]; /* Of each input, from `text` and `estimated`. */
    /* Rows that estimate the state at the start of a run; 0: the logs have it, or 50 (accelerations: 200). */
    uint32_t start_rows;
    lg_fit_settings training;
    uint64_t windows;
    double dt; /* Median step between rows, seconds. */
    char data_sha256[LG_SHA256_TEXT];
} lg_machine_model_run;

typedef struct lg_machine_model_file {
    LG_MODEL_FILE(lg_machine_model_run); /* theta is in scaled units */
    double *spread; /* (parameters, parameters): lg_identification.spread; NULL: unknown. */
} lg_machine_model_file;

/* The hyperparameters of lg_machine_model_run, and the recipe for lg_checkpoint_create and _open. */
LG_API extern const lg_field lg_machine_model_fields[];
LG_API extern const lg_recipe lg_recipe_machine_model;

LG_END_DECLS

#endif
