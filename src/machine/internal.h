/* Declarations that the files of src/machine share. */
#ifndef LG_MACHINE_INTERNAL_H
#define LG_MACHINE_INTERNAL_H

#include "core/clean.h"
#include "integrators/taped_internal.h"
#include "liegrad/machine.h"
#include "mechanics/engine.h"
#include "nn/fit_errors.h"

/* Standard deviations by coordinate, in the units of the log (radians for attitudes), or parts of the
 * loss. */
typedef struct lg_machine_noise {
    double position[LG_MACHINE_COORDINATES], velocity[LG_MACHINE_COORDINATES];
    /* Of angles and rates alone; 0: as of positions and velocities. */
    double turn[LG_MACHINE_COORDINATES], rate[LG_MACHINE_COORDINATES];
} lg_machine_noise;

/* Sums for a root mean square (machine/scales.c). NaN is left out; without numbers the result is NaN. */
typedef struct lg_squares {
    double sum;
    size_t count;
} lg_squares;
LG_API void lg_squares_add(lg_squares *s, double x);
LG_API double lg_squares_root(const lg_squares *s);

/* Indices of the parts of a state in an array of parts; -1 where the machine has no such part. */
typedef struct lg_machine_places {
    int x, q, p, R, m, z;
} lg_machine_places;
lg_machine_places lg_machine_parts(const lg_machine *machine);

/* Where the numbers of coordinate `index` begin: among the places, directions, rotations and momenta of a
 * state, and among the positions and velocities of a log; and how many there are (0: no such coordinate). */
typedef struct lg_machine_offsets {
    uint32_t place, direction, rotation, momentum, position, velocity;
    uint32_t places, directions, rotations, positions, velocities;
    uint32_t index, next; /* next: of the next coordinate */
    bool angle;
} lg_machine_offsets;
/* Goes from {0} to the first coordinate and on to the next one, or behind the last one; returns whether there
 * is one. */
LG_API bool lg_machine_next(const lg_machine *machine, lg_machine_offsets *at);
LG_API lg_machine_offsets lg_machine_offsets_of(const lg_machine *machine, uint32_t coordinate);
/* The rows first .. end - 1 of a part of a log. lg_log_next goes from {0} to the first part and on to the
 * next one; returns whether there is one. */
typedef struct lg_log_part {
    size_t first, end, next;
} lg_log_part;
LG_API bool lg_log_next(const lg_machine_log *log, lg_log_part *at);
/* Goes from NULL to the first term of the part (LG_MACHINE_PART_COUNT: of any part) and on to the next one;
 * returns whether there is one. */
LG_API bool lg_machine_next_term(const lg_machine *machine, lg_machine_part part,
                                 const lg_machine_term **term);

/* What a term may depend on, for B rows: parts of the state (NULL: the term is a mass that does not depend on
 * it), velocities (B, velocities) and input (B, inputs). v and u are LG_NONE for parts of the machine that do
 * not depend on them. sign (B, velocities): the signs of velocities that friction without a width takes, 0
 * where it sticks; LG_NONE: those of v. */
typedef struct lg_machine_seen {
    const lg_var *parts;
    lg_var v, u, sign;
    uint32_t rows;
    bool directions; /* record the masses of the directions */
} lg_machine_seen;

/* A term that is recorded, the term's parameters (LG_NONE: none), and what it may depend on (`seen`; NULL for
 * lags, biases and lists of numbers). */
typedef struct lg_term_at {
    lg_tape *tape;
    const lg_machine_vars *vars;
    const lg_machine *machine;
    const lg_machine_term *term;
    uint32_t index, n;
    lg_var theta;
    const lg_machine_seen *seen;
} lg_term_at;
static inline lg_term_at lg_term_at_of(lg_tape *tape, const lg_machine_vars *vars,
                                       const lg_machine_term *term, const lg_machine_seen *seen) {
    const lg_machine *machine = vars->machine;
    const uint32_t n = machine->velocities, index = (uint32_t)(term - machine->terms);
    return (lg_term_at){tape, vars, machine, term, index, n, vars->theta[index], seen};
}

/* An entry of a term's values: its name, its unit (1 in scaled units), its start in scaled units, whether it
 * must be positive, and whether a machine file may leave this entry alone unknown. */
typedef struct lg_entry_about {
    char name[LG_IDENTIFIED_NAME];
    double unit, start;
    bool positive, single;
} lg_entry_about;

/* Rows of mass matrices: of momenta on R^n, one for each direction, or of all velocities. */
typedef enum lg_mass_rows { LG_MASS_MOMENTA, LG_MASS_DIRECTIONS, LG_MASS_ALL } lg_mass_rows;

/* A list of numbers with names (machine/numbers.c). `count` numbers were put; the first `room` of them are in
 * `out`. */
typedef struct lg_number_list {
    size_t count, room;
    lg_identified *out;
    lg_status status; /* LG_OK, or why the numbers that need the tape are NaN */
    lg_tape *tape;    /* has the machine's parameters */
    lg_machine_vars vars;
} lg_number_list;
typedef void lg_term_numbers(lg_number_list *list, const lg_machine *machine, const lg_machine_term *term,
                             const double *theta);
lg_term_numbers lg_numbers_mass, lg_numbers_each, lg_numbers_constant_damping, lg_numbers_bias,
    lg_numbers_grey;
/* lg_term_kind.entry of potentials that are sums of monomials. */
void lg_machine_potential_entry(const lg_machine *machine, const lg_machine_term *term, uint32_t index,
                                lg_entry_about *out);
/* Appends a number to the list. */
void __attribute__((format(printf, 3, 4)))
lg_numbers_put(lg_number_list *list, double value, const char *format, ...);
/* Reads a variable of the list's tape; NaN after a failure. */
void lg_numbers_read(lg_number_list *list, lg_var x, size_t count, double *out);
/* Reads a mass M (1, n, n), or of directions (1, n, 1), and appends its numbers: those on and above the
 * diagonal, or with `diagonal`, which directions need, those on it. */
void lg_numbers_put_mass(lg_number_list *list, const lg_machine *machine, lg_var M, lg_mass_rows rows,
                         bool diagonal);
/* Name of velocity k: "x", or "body.2" where its coordinate has several velocities. */
LG_API void lg_machine_velocity_name(const lg_machine *machine, uint32_t k, char *text, size_t size);
/* Name of one number of the term's features: "x", "sin(theta)", "rod.3", "body.up.1". */
void lg_machine_feature_name(const lg_machine *machine, const lg_machine_term *term, uint32_t number,
                             char *text, size_t size);

typedef struct lg_prior lg_prior;

/* A row of the table of terms. `record` returns, by part:
 *   mass       the mass matrix M, (B, n, n) or (1, n, n), of the coordinates whose momenta are in R^n; with
 *              seen->directions the masses of the k directions, (1, k, 1), or (1, k, k) of a chain, which all
 *              terms except networks have; of a system that is tied always the matrix of all velocities
 *   potential  V (B, 1)
 *   damping, input map, residual, offset   forces (B, velocities)
 *   bias       (1, positions + velocities), which logs have added to the true values
 *   actuator   the inputs (B, inputs) that the input map gets in place of seen->u */
struct lg_term_kind {
    const char *name;
    lg_machine_part part;
    uint32_t options;
    /* Number of outputs of the term's network; NULL: the term is not a network. */
    uint32_t (*outputs)(const lg_machine *machine);
    size_t (*parameters)(const lg_machine *machine, const lg_machine_term *term);
    /* Writes the initial parameters. NULL: they are the starts of `each`, zeros, or a network's initial
     * weights. */
    void (*initialise)(const lg_machine *machine, const lg_machine_term *term, double *theta);
    lg_var (*record)(const lg_term_at *at);
    /* Whether parameter i, or its square, is in scaled units the number that `entry` describes. */
    enum { LG_PARAMETER_OTHER, LG_PARAMETER_ITSELF, LG_PARAMETER_SQUARED } each;
    /* Appends the term's parameters in the units of logs; theta is the term's slice. NULL: they are those of
     * `each`, or there is nothing to append. */
    lg_term_numbers *numbers;
    /* The two allowed numbers of values (equal if there is only one). NULL: as many as `parameters`. */
    void (*values)(const lg_machine *machine, const lg_machine_term *term, size_t fits[2]);
    /* log(tau/T) of the lags, (1, of_count). NULL: the term has none. */
    lg_var (*lag)(const lg_term_at *at);
    uint32_t order; /* of the lags */
    bool heights;   /* positions in `of` become heights */
    /* Whether M depends on the state; NULL: it does not. */
    bool (*moving)(const lg_machine *machine);
    /* least: least degree of the monomials, and of a term with LG_TERM_DEGREE. most: greatest degree of the
     * monomials; 0: the term's degree. */
    uint32_t least, most;
    /* Friction (machine/friction.c): the kind whose coefficients the term changes, NULL: none; and how many
     * numbers per velocity it has besides coefficients. */
    const char *base;
    uint32_t blocks;
    const struct lg_friction *friction;
    /* Friction with the force -c S, S the sign of the velocity or tanh(v/w): c (B or 1, velocities). Of a
     * term that changes its base, what it adds to the c of the base. NULL: the force has another form. */
    lg_var (*limit)(const lg_term_at *at);
    bool bristles; /* the term has the state z */
    /* The reason why the term's values are wrong, or NULL. NULL: all values are right. */
    const char *(*fault)(const lg_machine *machine, const lg_machine_term *term);
    /* Describes one of the term's values. NULL: values cannot be unknown one by one. */
    void (*entry)(const lg_machine *machine, const lg_machine_term *term, uint32_t index,
                  lg_entry_about *out);
    /* Damping: writes how the term's parameters change, to first order by x times `direction`, when all
     * friction of the machine is multiplied by 1 + x. theta and direction are the term's slices. NULL: the
     * term has no parameters. */
    void (*scaling)(const lg_machine *machine, const lg_machine_term *term, const double *theta,
                    double *direction);
    /* Adds the priors of numbers that are no entries behind `count` others; returns the new count. NULL:
     * there are none. */
    uint32_t (*priors)(const lg_machine *machine, uint32_t term, lg_prior *out, uint32_t count);
};
/* Whether the term's kind has one of these options. */
static inline bool lg_term_has(const lg_machine_term *term, uint32_t options) {
    return (term->kind->options & options) != 0;
}

/* ---- bristles of LuGre friction (machine/friction.c), in scaled units; v and z are (B, velocities) ---- */

/* Counts the bristles of `machine`. False: it has two terms with bristles. */
bool lg_machine_find_bristles(lg_machine *machine);
void lg_machine_bind_bristles(lg_tape *tape, lg_machine_vars *vars);
/* z' at v and z. */
lg_var lg_machine_bristle_rate(lg_tape *tape, const lg_machine_vars *vars, lg_var v, lg_var z);
/* z after the time h, (B, 1) or (1, 1), with v constant. */
lg_var lg_machine_bristle_after(lg_tape *tape, const lg_machine_vars *vars, lg_var v, lg_var z, lg_var h);
/* Writes z of the machine's bristles, if it has them, at rows of a log into `parts` (machine/bristles.c). */
lg_status lg_machine_start_bristles(lg_tape *tape, const lg_machine_vars *vars, const lg_machine_log *log,
                                    const size_t *at, size_t count, lg_var *parts);
/* z of steady sliding with v. */
lg_var lg_machine_bristle_steady(lg_tape *tape, const lg_machine_vars *vars, lg_var v);

/* ---- friction without a width (machine/friction.c, machine/stick.c), in scaled units ---- */

/* The bits of the velocities on which friction without a width may act; 0 for machines with other coordinates
 * than lines and angles, whose friction always has a width. */
uint32_t lg_machine_find_sticking(const lg_machine *machine);
/* Whether a term of the machine is friction without a width. */
bool lg_machine_term_sticks(const lg_machine *machine, const lg_machine_term *term);
/* lg_term_kind.record of friction that has a `limit`. */
lg_var lg_machine_record_rubbing(const lg_term_at *at);
/* Of a machine of lines and angles: M (B, n, n), or LG_NONE where vars->mass has it; the forces F of M v' = F
 * (B, n), with what friction without a width does at the signs seen->sign; the limit c (B or 1, n) of this
 * friction. The positions in seen->parts must be variables that nothing else on the tape depends on. */
typedef struct lg_machine_motion {
    lg_var M, F, c;
} lg_machine_motion;
lg_status lg_machine_record_motion(lg_tape *tape, const lg_machine_vars *vars, const lg_machine_seen *seen,
                                   lg_machine_motion *out);
/* Moves `parts` by one step of length h (B, 1) or (1, 1) in which friction sticks. u: inputs (B, inputs) at
 * the start, the middle and the end of the step, which are joined by a parabola; u[1] LG_NONE: held; all
 * LG_NONE: no inputs. */
typedef struct lg_machine_stick {
    lg_var h, u[3];
} lg_machine_stick;
lg_status lg_machine_stick_step(lg_tape *tape, const lg_machine_vars *vars, const lg_machine_stick *over,
                                lg_var *parts);
/* Accelerations v' (B, velocities) with the inputs u of a machine whose friction sticks. */
lg_var lg_machine_stick_accelerations(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts,
                                      lg_var u);

/* ---- numbers that are unknown one by one (machine/entries.c) ---- */

/* A number x = a e^(g t) + b + s t + r/(1 + e^-(t + l)) of its parameter t. */
typedef struct lg_number_map {
    double a, g, b, s, r, l;
} lg_number_map;
lg_number_map lg_machine_entry_map(const lg_machine_entry *entry, double start, double unit, bool positive);
double lg_number_at(const lg_number_map *map, double t, double *slope); /* slope may be NULL */
/* Records the values x (1, count) at the parameters t (1, count); count <= LG_MACHINE_VALUES. */
lg_var lg_machine_record_maps(lg_tape *tape, const lg_number_map *maps, uint32_t count, lg_var t);
/* (1, count): number i is factor[i] times value index[i] of the term; 0 if index[i] is UINT32_MAX. `index`
 * NULL: value i. */
lg_var lg_machine_record_entries(const lg_term_at *at, uint32_t count, const uint32_t *index,
                                 const double *factor);
lg_term_numbers lg_numbers_entries;
/* Whether one of the entries stands for this value of the term. */
LG_API bool lg_machine_is_entry_of(const lg_machine_term *term, uint32_t index);
/* lg_term_kind.scaling of the unknown entries. */
void lg_machine_scale_entries(const lg_machine *machine, const lg_machine_term *term, const double *theta,
                              double *direction);
/* The reason why the entries are wrong, or NULL. */
const char *lg_machine_entries_fault(const lg_machine *machine, const lg_machine_term *term);

/* The prior of parameter `index` of a term, whose number is map(parameter). */
#define LG_MACHINE_PRIORS 64
struct lg_prior {
    uint32_t term, index;
    lg_number_map map;
    double centre, sigma;
};
/* Lists the machine's priors (room for LG_MACHINE_PRIORS), and returns how many there are. lg_machine_init
 * refuses a machine with more. */
uint32_t lg_machine_list_priors(const lg_machine *machine, lg_prior *out);
/* weight (number - start)/sigma of each prior, the same in all rows, (rows, priors). There must be one. */
lg_var lg_machine_record_priors(lg_tape *tape, const lg_machine_vars *vars, uint32_t rows, double weight);
/* Priors of a problem, 0 if theta is known; and their weight in residuals of a batch, see
 * lg_machine_problem. */
uint32_t lg_machine_problem_priors(const lg_machine_problem *problem);
double lg_machine_prior_weight(const lg_machine_problem *problem, size_t batch);

/* Damping coefficients (1, velocities) of a term of kind diagonal, coulomb, quadratic or cubic, in scaled
 * units: a force divided by a speed to the given power. */
lg_var lg_machine_record_drag(const lg_term_at *at, int power);
/* Unit of a force on velocity i, divided by the unit of velocity j to the given power. */
double lg_machine_drag_unit(const lg_machine *machine, uint32_t i, uint32_t j, int power);

/* ---- named systems (machine/grey.c) ---- */

/* The terms that lg_machine_set_system adds. */
extern const lg_term_kind lg_grey_mass_kind, lg_grey_potential_kind;
/* lg_machine_set_system for a row that need not be in the table. */
lg_status lg_grey_use(lg_machine *machine, const lg_energy_row *system, lg_error *error);
lg_status lg_grey_check(const lg_machine *machine, lg_error *error);
/* All numbers of the system, (P), from theta, the parameters of its mass term. theta is LG_NONE if no number
 * is unknown. */
lg_var lg_grey_record(lg_tape *tape, const lg_machine *machine, lg_var theta);
/* Whether the machine has a system with a known number. */
bool lg_grey_known(const lg_machine *machine);
/* Geometric mean of the masses at the initial parameters, times L^2/T^2: an energy in the log's units. 0: no
 * system, or its masses are not known. Errors: LG_OUT_OF_MEMORY. */
lg_status lg_grey_energy(const lg_machine *machine, double *out);

/* Splits positions (B, positions) in the order of logs into the parts x, q and R of a state. */
void lg_machine_split_positions(lg_tape *tape, const lg_machine *machine, lg_var positions, lg_var *parts);
/* Writes the reference position: places and angles are 0, directions e3, attitudes the unit matrix. */
LG_API void lg_machine_reference(const lg_machine *machine, double *positions);
/* The state (one row) at rest at `positions`, which are in the units of the log and contain its biases; NULL:
 * at the reference. */
lg_status lg_machine_record_rest(lg_tape *tape, const lg_machine_vars *vars, const double *positions,
                                 lg_var *parts);

/* Most numbers of a term's features. */
#define LG_MACHINE_FEATURE_NUMBERS (12 * LG_MACHINE_FEATURES)
/* lg_machine_feature_count: how many numbers a feature has. lg_machine_feature_scales writes the scales of
 * all numbers of a term's features, none of which is a velocity, and returns how many there are. A number in
 * the log's units is the scaled number times its scale. */
uint32_t lg_machine_feature_count(const lg_machine *machine, lg_machine_feature feature);
uint32_t lg_machine_feature_scales(const lg_machine *machine, const lg_machine_term *term, double *scales);
/* The features of a term, (B, numbers), in scaled units. */
lg_var lg_machine_record_features(const lg_term_at *at);
/* lg_term_kind.record of networks and of polynomials of the term's features; the number of parameters of a
 * polynomial (SIZE_MAX: too many monomials). */
lg_var lg_machine_record_network(const lg_term_at *at);
lg_var lg_machine_record_polynomial(const lg_term_at *at);
size_t lg_machine_polynomial_parameters(const lg_machine *machine, const lg_machine_term *term);

/* Whether M depends on the state. */
bool lg_machine_mass_moves(const lg_machine *machine);
/* Factor from M_ij in the log's units to scaled units, for velocities i and j: L_i L_j/(E T^2). */
double lg_machine_unit_mass(const lg_machine *machine, uint32_t i, uint32_t j);
/* Whether the mass matrix of the machine's system has three rows for each direction, q', among the rows of
 * all velocities: it couples the directions with other coordinates, or depends on the state. */
bool lg_machine_tied(const lg_machine *machine);
/* Indices of the velocities whose momenta are on R^n, in order; or the first of the 3 velocities of each
 * direction; or all. Returns their number. */
uint32_t lg_machine_mass_velocities(const lg_machine *machine, lg_mass_rows rows, uint32_t *list);
/* M of the momenta on R^n, or of all velocities of a machine that is tied, (B, n, n) or (1, n, n): the sum of
 * all mass terms. */
lg_var lg_machine_record_mass(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts);

/* Monomials of `least` <= degree <= `most`, in the order of the variables' indices. Each is a list of the
 * indices of its factors that ends with UINT32_MAX. */
#define LG_MACHINE_MONOMIALS 128
#define LG_MACHINE_DEGREE    8
typedef struct lg_monomials {
    uint32_t count;
    uint32_t factor[LG_MACHINE_MONOMIALS][LG_MACHINE_DEGREE + 1];
} lg_monomials;
/* Lists the monomials in `out`. False: there are more than LG_MACHINE_MONOMIALS. */
bool lg_machine_monomials(uint32_t variables, uint32_t least, uint32_t most, lg_monomials *out);
/* The values of all monomials at x (B, variables): (B, count). */
lg_var lg_machine_record_monomials(lg_tape *tape, const lg_monomials *monomials, lg_var x);

/* Number of entries of a lower triangle L (n, n). It is packed as the n diagonal entries, then the n(n - 1)/2
 * entries below the diagonal, row by row. */
static inline uint32_t lg_triangle(uint32_t n) {
    return n * (n + 1) / 2;
}
/* Index of M_ij among the values of a known mass; UINT32_MAX: M_ij is 0. The values are a matrix, its
 * diagonal, or a diagonal with one number for each direction. A known damping has the first two. */
uint32_t lg_machine_mass_place(const lg_machine *machine, const lg_machine_term *term, uint32_t i,
                               uint32_t j);
/* lg_term_kind.values for a matrix of all velocities or its diagonal. */
void lg_machine_square_values(const lg_machine *machine, const lg_machine_term *term, size_t fits[2]);
/* Unpacks triangles: packed (B, lg_triangle(n)) -> (B, n, n). With `positive` the diagonal is exp of its
 * packed numbers. */
lg_var lg_machine_record_triangle(lg_tape *tape, lg_var packed, uint32_t n, bool positive);
/* The matrix (count, columns) with a 1 in row i, column at[i]. */
lg_var lg_machine_record_selection(lg_tape *tape, const uint32_t *at, uint32_t count, uint32_t columns);
/* Columns first .. first + count - 1 of x (B, n); returns x itself if these are all columns. */
lg_var lg_machine_columns(lg_tape *tape, lg_var x, uint32_t first, uint32_t count);
/* Copy k of a part (B, copies, n) as (B, n). */
lg_var lg_machine_copy(lg_tape *tape, lg_var part, uint32_t k);

/* Puts the parameters of the machine on the tape; LG_NONE if it has none. */
static inline lg_var lg_machine_parameter(lg_tape *tape, const lg_machine *machine, const double *theta) {
    return machine->parameters > 0 ? lg_parameter(tape, lg_shape1((uint32_t)machine->parameters), theta)
                                   : LG_NONE;
}
/* The same of a problem: its known parameters, or the first ones of the fit, `theta`. */
static inline lg_var lg_machine_problem_parameter(lg_tape *tape, const lg_machine_problem *problem,
                                                  const double *theta) {
    return lg_machine_parameter(tape, problem->machine, problem->theta != NULL ? problem->theta : theta);
}
/* Writes to `out` the velocities on which a term of constant forces acts; returns their number. */
LG_API uint32_t lg_machine_offset_velocities(const lg_machine *machine, const lg_machine_term *term,
                                             uint32_t *out);
/* The potential's forces in the order of the velocities, (B, velocities); LG_NONE: no potential. */
lg_var lg_machine_record_pull(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts);
/* Adds an impulse (B, velocities), in the order of the velocities, to the momenta in `parts`. */
void lg_machine_push(lg_tape *tape, const lg_machine *machine, lg_var impulse, lg_var *parts);

/* ---- actuators (machine/actuators.c) and lags (machine/lags.c) ---- */

/* u (B, inputs) after the curves of the inputs; LG_NONE stays. */
lg_var lg_machine_record_actuated(lg_tape *tape, const lg_machine_vars *vars, const lg_machine_seen *seen);
/* log(tau/T) of all lags in the order of machine->lagged, (1, lags). */
lg_var lg_machine_record_lag(lg_tape *tape, const lg_machine_vars *vars);
/* How many lagged inputs from `first` on belong to the input of this one. */
uint32_t lg_machine_lag_order(const lg_machine *machine, uint32_t first);
/* Puts the last lagged input in x (B, lags) of each input into its column of u (B, inputs). */
lg_var lg_machine_put_lagged(lg_tape *tape, const lg_machine *machine, lg_var u, lg_var x);
/* Lists the inputs with a lag in `machine`. False: an input has two. */
bool lg_machine_find_lags(lg_machine *machine);

/* Weights with which a first-order lag moves over z = s h/tau: x(s) = E x(0) + sum_j g_j u_j s^j for
 * u = sum_j u_j s^j. Of each weight the value and the first three derivatives by log tau. */
typedef struct lg_lag_weights {
    double E[4], g[4][4];
} lg_lag_weights;
void lg_lag_weights_at(double z, lg_lag_weights *out);
/* The lagged inputs of one input and their derivatives at s, (order, 3); `u`: u_0 .. u_3, `stride` numbers
 * apart. `from`, at s = 0, may be `out`. */
void lg_lag_move(const lg_lag_weights *w, uint32_t order, double s, const double *u, size_t stride,
                 const double *from, double *out);
/* Lagged inputs and their derivatives by log tau, (count, lags, 3), at rows of a log, in its units; tau
 * (lags) in seconds. */
lg_status lg_machine_lag_states(const lg_machine *machine, const lg_machine_log *log, const double *tau,
                                const size_t *at, size_t count, double *out);

/* ---- correlations of numbers (machine/relations.c) ---- */

/* Fills `correlations` and `open` of `out` from the covariance (N, N) of the numbers' relative changes, which
 * is overwritten. If it is not finite, there are no open directions. Errors:
 * LG_OUT_OF_MEMORY. */
lg_status lg_machine_relate(const lg_context *context, size_t count, double *covariance,
                            lg_identification *out);

/* ---- intervals (machine/step.c) ---- */

/* The reason, as a sentence, why a machine cannot use LG_SCHEME_VARIATIONAL; NULL if it can. */
const char *lg_machine_variational_fault(const lg_machine *machine);

/* How to integrate a machine over intervals of logs. Each row of a batch has its own interval length and
 * inputs. */
typedef struct lg_machine_flow {
    const lg_machine_vars *vars;
    const lg_scheme *scheme;
    uint32_t substeps;
    lg_space space;
} lg_machine_flow;
/* Moves `parts` by one step of LG_SCHEME_VARIATIONAL (machine/variational.c). u: inputs (B, inputs) at its
 * start and end, or LG_NONE. After an error `parts` are of no use. */
lg_status lg_machine_variational_step(lg_tape *tape, const lg_machine_flow *flow, const lg_taped_span *over,
                                      const lg_var u[2], lg_var *parts);
/* Binds theta to `vars`, and makes the flow of the problem's machine, scheme and substeps that has these
 * parameters. */
lg_status lg_machine_begin_flow(lg_tape *tape, const lg_machine_problem *problem, lg_var theta,
                                lg_machine_vars *vars, lg_machine_flow *flow);
/* The state from z (B, numbers), positions and velocities in the order of logs and in scaled units; other
 * numbers may follow. lg_machine_join_row is z of a state, behind which the bristles follow. */
lg_status lg_machine_split_row(lg_tape *tape, const lg_machine_vars *vars, lg_var z, lg_var *parts);
lg_var lg_machine_join_row(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts);
/* Moves `parts` over one interval of the log: row i of the batch from row at[i] to the next one. */
lg_status lg_machine_record_interval(lg_tape *tape, const lg_machine_flow *flow, const lg_machine_log *log,
                                     const size_t *at, uint32_t count, lg_var *parts);
/* The same without lags, with the coefficients u[k] (B, inputs) of the inputs (LG_NONE: 0) and the length h
 * (B, 1) of each row's interval, all in scaled units. */
lg_status lg_machine_record_interval_of(lg_tape *tape, const lg_machine_flow *flow, const lg_var *u, lg_var h,
                                        lg_var *parts);
/* Accelerations v' (B, velocities) of the states `parts` with the inputs u, plus the biases of their sensors;
 * lines and angles only. `stuck`: v' of a machine that sticks, else LG_NONE. */
lg_var lg_machine_record_accelerations(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts,
                                       lg_var u, lg_var stuck);
/* What rows at[0..count-1] of a log show of the velocities: the velocities or the accelerations. */
lg_var lg_machine_record_shown(lg_tape *tape, const lg_machine_vars *vars, const lg_machine_log *log,
                               const size_t *at, uint32_t count, const lg_var *parts);
/* Rows at[0..count-1] of the log in scaled units: positions (count, positions) and velocities (count,
 * velocities). Missing numbers are 0, and a missing velocity is computed from the positions of neighbouring
 * rows. */
void lg_machine_scaled_rows(const lg_machine *machine, const lg_machine_log *log, const size_t *at,
                            size_t count, double *positions, double *velocities);
/* Records these rows, on a tape in double precision. */
lg_status lg_machine_record_rows(lg_tape *tape, const lg_machine *machine, const lg_machine_log *log,
                                 const size_t *at, size_t count, lg_var *positions, lg_var *velocities);
/* Converts one row of scaled numbers to the units of the log, in place; exported because lg-identify uses
 * it. */
LG_API void lg_machine_unscale_row(const lg_machine *machine, double *positions, double *velocities);

/* ---- windows (machine/windows.c, machine/starts.c, machine/train.c, machine/jacobian.c) ---- */

static inline bool lg_machine_starts_estimated(const lg_machine_problem *problem) {
    return problem->starts == LG_MACHINE_STARTS_ESTIMATED;
}
/* Number of the machine's parameters that are learned; in the fit they come before the parameters of the
 * starts. */
static inline size_t lg_machine_shared(const lg_machine_problem *problem) {
    return problem->theta == NULL ? problem->machine->parameters : 0;
}
/* Number of parameters of a start: places, 3 for each direction, 3 for each rotation, velocities. */
uint32_t lg_machine_start_numbers(const lg_machine *machine);
/* The same of a window of the problem: 0 if starts are not estimated. */
uint32_t lg_machine_own(const lg_machine_problem *problem);
/* The unit of each number of a start: the scale of the loss times the square root of the number of windows.
 * The loss is a mean over windows, so that its second derivatives in the parameters are then about 1. */
void lg_machine_start_units(const lg_machine_problem *problem, double *scale);
/* Sets the scales of the loss of a problem whose parameters are known to the machine's scales. */
void lg_machine_scale_loss(lg_machine_problem *problem);
/* Fits the starts of `count` windows from `first` on of a problem whose parameters are known. numbers: of all
 * its windows. A window whose run is not finite spoils the fit of its whole group: the group is then halved
 * until this window is alone, which keeps its numbers. */
lg_status lg_machine_fit_starts(const lg_context *context, const lg_machine_problem *problem, size_t first,
                                size_t count, double *numbers, lg_error *error);
/* The state `parts` from positions and velocities (B, ...), after these were moved by the starts' parameters
 * `numbers` (B, lg_machine_start_numbers). */
lg_status lg_machine_move_starts(lg_tape *tape, const lg_machine_problem *problem,
                                 const lg_machine_vars *vars, lg_var numbers, lg_var positions,
                                 lg_var velocities, lg_var *parts);
/* What a log shows of velocity k, the velocity or the acceleration, in its units where the scaled number is
 * 1. */
static inline double lg_machine_shown_unit(const lg_machine *machine, uint32_t k) {
    const lg_machine_scales *s = &machine->scales;
    return s->velocity[k] / (machine->accelerations ? s->time * s->time : s->time);
}
/* As lg_machine_scaled_rows for one row, with accelerations in place of velocities where the logs measure
 * these. */
void lg_machine_shown_row(const lg_machine *machine, const lg_machine_log *log, size_t row, double *positions,
                          double *shown);
/* The rotation vector of A^T B: the rotation from A to B, in the body axes of A. */
LG_API void lg_machine_turn_between(const double *A, const double *B, double *out);
/* Weights of the numbers of one row in the loss, in scaled units: factor/scale of the loss, 0 for a missing
 * number, and for positions where accelerations are measured. `velocities` are weights of what is shown. */
void lg_machine_weigh_row(const lg_machine_problem *problem, size_t row, double factor, double *positions,
                          double *velocities);
/* `along` (velocities): for a direction the logged q, 0 where it is missing; for other kinds 0. Logs have no
 * omega along q, so noise dq of q moves omega along q by |omega| dq: residuals of omega are taken across
 * q. */
void lg_machine_along_row(const lg_machine_problem *problem, size_t row, double *along);
/* lg_fit_problem.linearise and lg_fit_problem.rows of a problem of windows. */
lg_status lg_machine_linearise(void *user, lg_tape *tape, const double *theta, const uint32_t *samples,
                               size_t count, size_t batch, double *loss, double *r, double *jacobian);
/* Computes the loss of each window (windows), with the share of the priors that belongs to the window. */
LG_API lg_status lg_machine_losses(const lg_context *context, const lg_machine_problem *problem,
                                   const double *theta, double *losses, lg_error *error);
/* The same Jacobian, with the steps' own error in place of the residuals. */
lg_status lg_machine_linearise_steps(void *user, lg_tape *tape, const double *theta, const uint32_t *samples,
                                     size_t count, size_t batch, double *loss, double *r, double *jacobian);
size_t lg_machine_linearised_rows(const lg_machine_problem *problem);
/* Most windows from which errors of few and of many numbers, and expected losses, are computed. */
enum { LG_MACHINE_MOST_OF_SMALL = 8192, LG_MACHINE_MOST_WINDOWS = 512 };
/* Prepares lg_fit_errors for the windows of a problem without its validation part, of which `most` are
 * used. */
lg_fit_errors lg_machine_errors(const lg_context *context, const lg_machine_problem *problem,
                                const double *theta, size_t most);
/* Variances (factor noise/scale)^2, with the scales of the loss, of the residuals of one row of the log, in
 * the order of lg_machine_linearise and of the numbers of a start. The variance of a missing number is 0. The
 * three numbers of a direction q, or of its omega, have the covariance variance (1 - q q^T), and `part` is
 * the diagonal of (1 - q q^T). Along a column of the Jacobian, which is across q, the whole variance counts.
 * `part` of other numbers is 1. */
void lg_machine_row_variances(const lg_machine_problem *problem, const lg_machine_noise *noise, size_t row,
                              double factor, double *out, double *part);

/* ---- what the recipe calls (machine/files) ---- */

/* Give learned lags without a start or bounds the time constant tau, in seconds, within scales.lag, and
 * return how many there are; give learned bristles the stiffness at which sliding bends them by `part`, in
 * [0, 1], of the way from the largest to the smallest deflection in logarithms (false: there are none); move
 * the biases of angles to (-pi, pi]. */
size_t lg_machine_set_lags(const lg_machine *machine, double tau, double *theta);
bool lg_machine_set_bristles(const lg_machine *machine, double part, double *theta);
void lg_machine_wrap_biases(const lg_machine *machine, double *theta);
/* The term whose friction this term changes, such as a Coulomb friction; NULL: none. */
const lg_machine_term *lg_machine_base(const lg_machine *machine, const lg_machine_term *term);
/* Writes to `direction` how theta changes when all learned damping is multiplied by 1 + x, per x. */
bool lg_machine_scale_friction(const lg_machine *machine, const double *theta, double *direction);
/* As lg_machine_fit_problem, but the windows become a regression of momenta (machine/momentum.c). Starts are
 * measured, problem->theta is NULL; windows with an incomplete row do not count. */
void lg_machine_momentum_problem(const lg_machine_problem *problem, lg_fit_problem *out);
/* Replaces estimated starts that are far off, of lines and angles: where a window begins in the last row of
 * another, by the state that the other one predicts there if that at least halves its loss; likewise
 * backwards in time, except with lags and bristles. losses (windows): squared residuals with the starts of
 * theta. */
lg_status lg_machine_continue_starts(const lg_context *context, const lg_machine_problem *problem,
                                     double *theta, double *losses, lg_error *error);
/* Estimates the states at all rows of a log of accelerations from windows that touch, with these starts. q
 * and v, as in the log, get the runs of the windows; rows in no window keep the log's guesses. */
lg_status lg_machine_estimate_states(const lg_context *context, const lg_machine *machine,
                                     const double *theta, const lg_scheme *scheme, uint32_t substeps,
                                     const lg_machine_log *log, uint32_t window, double *q, double *v,
                                     lg_error *error);
/* The loss of a model that explains the logs except for white noise (standard deviations; machine/expect.c),
 * from at most 512 windows. More than 256 parameters are taken to reduce nothing. `steps`: what the starts
 * and parameters leave of the steps' own error. `change`: what the changes of velocities within a window
 * contribute to positions and velocities, about the loss of a model in which no force acts. */
typedef struct lg_machine_expected {
    double loss, steps;
    lg_machine_noise change;
} lg_machine_expected;
lg_status lg_machine_expect(const lg_context *context, const lg_machine_problem *problem, const double *theta,
                            const lg_machine_noise *noise, lg_machine_expected *out, lg_error *error);
/* How much of the loss missing forces could explain at a best fit (machine/missing.c); 0: not tested, as with
 * networks or more than 128 parameters. The F of chance is about 1, and hardly above 8 for the true
 * machine. */
typedef struct lg_machine_missing {
    double loss, ratio;
} lg_machine_missing;
lg_status lg_machine_find_missing(const lg_context *context, const lg_machine_problem *problem,
                                  const double *theta, lg_machine_missing *out, lg_error *error);
/* Writes row `row` of `open` in words, such as "m and L appear only as a product: give one of them"; `count`
 * is N. Returns how many numbers change in the row. */
size_t lg_identification_sentence(const lg_identification *of, size_t count, size_t row, char *text,
                                  size_t size);

/* How many numbers all features of a term have: the inputs of its network. */
uint32_t lg_machine_feature_numbers(const lg_machine *machine, const lg_machine_term *term);
/* lg_machine_numbers with a network mass reported at `positions`, in the units of the log; NULL: the
 * reference. If a number cannot be computed, *status gets the reason. `status` may be NULL. */
size_t lg_machine_numbers_at(const lg_machine *machine, const double *theta, const double *positions,
                             size_t room, lg_identified *out, lg_status *status);
/* The fit problem of x (count), then of the starts as in lg_machine_fit_problem. Borrows `restriction`. */
void lg_machine_restricted_problem(const lg_machine_restriction *restriction, lg_fit_problem *out);

static inline bool lg_machine_has_part(const lg_machine *machine, lg_machine_part part) {
    return lg_machine_next_term(machine, part, &(const lg_machine_term *){NULL});
}

/* Whether a term of the part (LG_MACHINE_PART_COUNT: of any part) depends on the position of a coordinate. */
static inline bool lg_machine_sees(const lg_machine *machine, lg_machine_part part, uint32_t coordinate) {
    for (const lg_machine_term *at = NULL; lg_machine_next_term(machine, part, &at);)
        for (uint32_t k = 0; k < at->of_count && at->part != LG_MACHINE_OFFSET; k++)
            if (at->of[k].index == coordinate && at->of[k].kind != LG_FEATURE_VELOCITY &&
                at->of[k].kind != LG_FEATURE_INPUT)
                return true;
    return false;
}

#endif
