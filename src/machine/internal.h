/* Shared by the files of machines. */
#ifndef LG_MACHINE_INTERNAL_H
#define LG_MACHINE_INTERNAL_H

#include "liegrad/machine.h"

/* Where the parts of a state stand in an array of parts; -1: there is none. */
typedef struct lg_machine_places {
    int x, q, p, R, m;
} lg_machine_places;
lg_machine_places lg_machine_parts(const lg_machine *machine);

/* Where the numbers of a coordinate begin: among places, directions, rotations, momenta; in a log, among
 * positions and velocities. */
typedef struct lg_machine_offsets {
    uint32_t place, direction, rotation, momentum, position, velocity;
} lg_machine_offsets;
lg_machine_offsets lg_machine_offsets_of(const lg_machine *machine, uint32_t coordinate);

/* What a term may see of B rows: parts of the state, velocities (B, velocities) and input (B, inputs), each
 * LG_NONE where the part of the machine does not depend on it. */
typedef struct lg_machine_seen {
    const lg_var *parts;
    lg_var v, u;
    uint32_t rows;
} lg_machine_seen;

/* Numbers with names (machine/numbers.c): those counted, of which `room` are kept. */
typedef struct lg_number_list {
    size_t count, room;
    lg_identified *out;
} lg_number_list;
typedef void lg_term_numbers(lg_number_list *list, const lg_machine *machine, const lg_machine_term *term,
                             const double *theta);
lg_term_numbers lg_numbers_diagonal_mass, lg_numbers_constant_mass, lg_numbers_potential,
    lg_numbers_diagonal_damping, lg_numbers_constant_damping, lg_numbers_coulomb, lg_numbers_quadratic,
    lg_numbers_constant_map, lg_numbers_bias, lg_numbers_grey;
/* Appends a number. */
void __attribute__((format(printf, 3, 4)))
lg_numbers_put(lg_number_list *list, double value, const char *format, ...);

/* A row of the table of terms. `record` gives, by part:
 *   mass       M of the momenta on R^n, (B, n, n) or (1, n, n)
 *   potential  V (B, 1)
 *   damping, input map, residual   forces (B, velocities)
 *   bias       (1, positions + velocities), added to what logs have */
struct lg_term_kind {
    const char *name;
    lg_machine_part part;
    uint32_t options;
    /* Numbers that a network gives; NULL: no network. */
    uint32_t (*outputs)(const lg_machine *machine);
    size_t (*parameters)(const lg_machine *machine, const lg_machine_term *term);
    /* Parameters to start with; NULL: zeros, or a network's. */
    void (*initialise)(const lg_machine *machine, const lg_machine_term *term, double *theta);
    lg_var (*record)(lg_tape *tape, const lg_machine_vars *vars, uint32_t term, const lg_machine_seen *seen);
    /* Masses of the directions (1, directions, 1); NULL: the term has none. */
    lg_var (*directions)(lg_tape *tape, const lg_machine_vars *vars, uint32_t term);
    lg_term_numbers *numbers; /* the term's parameters (theta: its own) in the units of logs; NULL: none */
    /* How many values are fitting: one of two numbers. NULL: none. */
    void (*values)(const lg_machine *machine, const lg_machine_term *term, size_t fits[2]);
    bool heights;                              /* sees heights where positions are listed */
    bool (*moving)(const lg_machine *machine); /* M depends on the state; NULL: it does not */
    uint32_t least, most; /* degrees of a potential's monomials; most 0: the term's degree */
};

/* ---- systems (machine/files/grey.c, machine/grey_rows.c) ---- */

/* What the functions of a row see: B rows in the units of the log. */
typedef struct lg_grey_view {
    uint32_t rows;
    lg_var parameters; /* (P), in the order of the table */
    lg_var x, q, R;    /* (B, places), (B, k, 3), (B, 1, 9); LG_NONE where M does not depend on them */
    uint32_t links;    /* k */
} lg_grey_view;

/* M of the momenta on R^n (B or 1, n, n), M of the directions (1, k, k), V (B, 1), in the units of the log.
 */
struct lg_grey_system {
    const char *name;
    const lg_parameter_entry *parameters; /* NULL: those of lg_system_parameters */
    uint32_t count;                       /* coordinates; 0: any number of the first kind */
    lg_coordinate_kind coordinates[2];
    unsigned seen; /* bits of the coordinates on which M or V depends */
    bool moving;   /* M depends on the state */
    lg_var (*mass)(lg_tape *tape, const lg_grey_view *at);
    lg_var (*directions)(lg_tape *tape, const lg_grey_view *at);
    lg_var (*potential)(lg_tape *tape, const lg_grey_view *at); /* NULL: none */
};
extern const lg_grey_system lg_grey_systems[]; /* ended by a name NULL */
/* Systems of lg-simulate that are no machines, and why; ended by a name NULL. */
typedef struct lg_grey_refused {
    const char *name, *why;
} lg_grey_refused;
extern const lg_grey_refused lg_grey_refusals[];

/* The terms that lg_machine_set_system adds. */
extern const lg_term_kind lg_grey_mass_kind, lg_grey_potential_kind;
lg_status lg_grey_check(const lg_machine *machine, lg_error *error);
/* The numbers (P) from the parameters of its mass term (LG_NONE: none is unknown). */
lg_var lg_grey_record(lg_tape *tape, const lg_machine *machine, lg_var theta);
bool lg_grey_known(const lg_machine *machine); /* there is a system with a known number */
/* The geometric mean of the masses at the start, in energies of the log's units; 0: no system. */
double lg_grey_energy(const lg_machine *machine);

/* The reference: places and angles are 0, directions e3, attitudes 1. */
void lg_machine_reference(const lg_machine *machine, double *positions);
/* One row at rest at the positions, in the units of the log and with its biases; NULL: at the reference. */
lg_status lg_machine_record_rest(lg_tape *tape, const lg_machine_vars *vars, const double *positions,
                                 lg_var *parts);
bool lg_machine_mass_learned(const lg_machine *machine); /* a mass is a network */

/* Numbers of one feature, and their scales: a number of the log is the scaled one times its scale. */
uint32_t lg_machine_feature_count(const lg_machine *machine, lg_machine_feature feature);
uint32_t lg_machine_feature_scales(const lg_machine *machine, const lg_machine_term *term, double *scales);
/* The features of a term (B, numbers). */
lg_var lg_machine_record_features(lg_tape *tape, const lg_machine *machine, const lg_machine_term *term,
                                  const lg_machine_seen *seen);

bool lg_machine_mass_moves(const lg_machine *machine); /* M depends on the state */
/* The unit mass of velocities i and j in scaled numbers. */
double lg_machine_unit_mass(const lg_machine *machine, uint32_t i, uint32_t j);
/* Velocities whose momenta are on R^n, in order; those of the directions, the first of 3 each. */
uint32_t lg_machine_mass_velocities(const lg_machine *machine, bool directions, uint32_t *list);
/* M of the momenta on R^n, (B, n, n) or (1, n, n). */
lg_var lg_machine_record_mass(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts);

/* Monomials of `least` <= degree <= `most` in f variables, in the order of the variables' indices: a list of
 * factors each, ended by UINT32_MAX. */
#define LG_MACHINE_MONOMIALS 128
#define LG_MACHINE_DEGREE    8
typedef struct lg_monomials {
    uint32_t count;
    uint32_t factor[LG_MACHINE_MONOMIALS][LG_MACHINE_DEGREE + 1];
} lg_monomials;
/* False: too many. */
bool lg_machine_monomials(uint32_t variables, uint32_t least, uint32_t most, lg_monomials *out);
/* All of them at x (B, variables): (B, count). */
lg_var lg_machine_record_monomials(lg_tape *tape, const lg_monomials *monomials, lg_var x);

/* Lower triangles L (n, n): n numbers of the diagonal, then n(n - 1)/2 below it, row by row. */
static inline uint32_t lg_triangle(uint32_t n) {
    return n * (n + 1) / 2;
}
lg_var lg_machine_unit_matrix(lg_tape *tape, uint32_t n); /* (1, n, n) */
/* lg_term_kind.values of a matrix of velocities, or its diagonal. */
void lg_machine_square_values(const lg_machine *machine, const lg_machine_term *term, size_t fits[2]);
/* packed (B, triangle) -> (B, n, n); `positive`: the diagonal is exp of its numbers. */
lg_var lg_machine_record_triangle(lg_tape *tape, lg_var packed, uint32_t n, bool positive);
/* Values of a term as a matrix (rows, columns) of scaled numbers: each times left[i] right[j]; a single row
 * of `rows` values is a diagonal. */
lg_var lg_machine_record_values(lg_tape *tape, const lg_machine_term *term, uint32_t rows, uint32_t columns,
                                const double *left, const double *right);

/* Columns first .. first + count - 1 of x (B, n); x itself when these are all. */
lg_var lg_machine_columns(lg_tape *tape, lg_var x, uint32_t first, uint32_t count);

/* The parameters of the machine on a tape; LG_NONE where it has none. */
static inline lg_var lg_machine_parameter(lg_tape *tape, const lg_machine *machine, const double *theta) {
    return machine->parameters > 0 ? lg_parameter(tape, lg_shape1((uint32_t)machine->parameters), theta)
                                   : LG_NONE;
}
/* The potential's forces in the order of the velocities, (B, velocities); LG_NONE: no potential. */
lg_var lg_machine_record_pull(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts);
/* The momenta change by an impulse (B, velocities). */
void lg_machine_push(lg_tape *tape, const lg_machine *machine, lg_var impulse, lg_var *parts);

/* ---- relations of numbers (machine/relations.c) ---- */

/* Eigenvalues (n, rising) and eigenvectors, the columns of the symmetric matrix (n, n) one after the other in
 * its place. False: no convergence, or no memory. */
bool lg_machine_eigen(const lg_context *context, size_t n, double *matrix, double *values);
/* covariance (N, N) of relative changes of the numbers: fills correlations and open of `out`; it is spoiled.
 */
lg_status lg_machine_relate(const lg_context *context, size_t count, double *covariance,
                            lg_identification *out);

/* ---- intervals (machine/step.c) ---- */

/* Equations r(x) = 0 of independent rows, x and r (B, n): records r at x. */
typedef lg_status (*lg_row_equations)(void *user, lg_tape *tape, lg_var x, lg_var *r);
/* x near `first` (B, n) by Newton's method; values are around 1. First and second derivatives of *x are
 * exact. Rows without a solution are NaN. The equations may use variables made before, and must keep none. */
lg_status lg_machine_root(lg_tape *tape, lg_row_equations equations, void *user, lg_var first, lg_var *x);

/* A step of LG_SCHEME_VARIATIONAL (machine/variational.c), its length h, times `rows` (B, 1) unless that is
 * LG_NONE; inputs (B, inputs) at its start and end, or LG_NONE. `parts` move on. */
typedef struct lg_machine_span {
    double h;
    lg_var rows, u[2];
} lg_machine_span;
lg_status lg_machine_variational_step(lg_tape *tape, const lg_machine_vars *vars, const lg_machine_span *over,
                                      lg_var *parts);
/* What keeps a machine from LG_SCHEME_VARIATIONAL, a sentence; NULL: nothing. */
const char *lg_machine_variational_fault(const lg_machine *machine);

/* The equation of a machine over intervals of logs: rows of a batch have their own lengths and inputs. */
typedef struct lg_machine_flow {
    const lg_machine_vars *vars;
    const lg_scheme *scheme;
    uint32_t substeps;
    lg_space space;
} lg_machine_flow;
/* One interval from each row at[0..count-1] of the log: `parts` move on. */
lg_status lg_machine_record_interval(lg_tape *tape, const lg_machine_flow *flow, const lg_machine_log *log,
                                     const size_t *at, uint32_t count, lg_var *parts);
/* Rows at[0..count-1] of the log in scaled units: positions (count, positions) and velocities (count,
 * velocities); missing numbers are 0, and a missing velocity is the difference quotient of positions. */
void lg_machine_scaled_rows(const lg_machine *machine, const lg_machine_log *log, const size_t *at,
                            size_t count, double *positions, double *velocities);
/* One row of scaled numbers in the units of the log. */
void lg_machine_unscale_row(const lg_machine *machine, double *positions, double *velocities);

/* ---- windows (machine/windows.c, machine/starts.c, machine/train.c, machine/jacobian.c) ---- */

static inline bool lg_machine_starts_estimated(const lg_machine_problem *problem) {
    return problem->starts == LG_MACHINE_STARTS_ESTIMATED;
}
/* Parameters of the fit before those of the starts. */
static inline size_t lg_machine_shared(const lg_machine_problem *problem) {
    return problem->theta == NULL ? problem->machine->parameters : 0;
}
/* Parameters of a start: places, 3 for each direction, 3 for each rotation, velocities. */
uint32_t lg_machine_start_numbers(const lg_machine *machine);
/* The state from positions and velocities (B, ...) that move by the parameters (B, numbers) of their
 * starts. */
lg_status lg_machine_move_starts(lg_tape *tape, const lg_machine_problem *problem,
                                 const lg_machine_vars *vars, lg_var numbers, lg_var positions,
                                 lg_var velocities, lg_var *parts);
/* Weights of the numbers of one row: factor/scale where a number is there, in scaled units. */
void lg_machine_weigh_row(const lg_machine_problem *problem, size_t row, double factor, double *positions,
                          double *velocities);
/* The logged direction q in the place of its velocity, 0 where it is missing and of other kinds (velocities).
 * Logs have no omega along q, so the noise of q moves omega along q by |omega| dq: residuals of omega are
 * those across q. */
void lg_machine_along_row(const lg_machine_problem *problem, size_t row, double *along);
/* lg_fit_problem.linearise of windows, and its rows for each. */
lg_status lg_machine_linearise(void *user, lg_tape *tape, const double *theta, const uint32_t *samples,
                               size_t count, size_t batch, double *loss, double *r, double *jacobian);
size_t lg_machine_linearised_rows(const lg_machine_problem *problem);
/* Most windows that errors of numbers and what is expected of a loss are taken from. */
enum { LG_MACHINE_MOST_WINDOWS = 512 };
/* R (n, n), column-major, of [J r] = Q R with n - 1 parameters of the machine: the Jacobian and, last, the
 * residuals, starts eliminated window by window. From at most LG_MACHINE_MOST_WINDOWS windows, but in units
 * of the loss of all. `lagged` (n, n), zeros before: [J r]^T [J r], the second factor a row of the log later;
 * of these windows alone, as is `numbers`, how many residuals are not 0. */
lg_status lg_machine_triangle(const lg_context *context, const lg_machine_problem *problem,
                              const double *theta, double *triangle, double *lagged, double *numbers,
                              lg_error *error);
/* Variances of the residuals of one row of the log, in the order of lg_machine_linearise and of the numbers
 * of a start, for the noise of its numbers times `factor`. The variance of a missing number is 0. The
 * covariance of the three numbers of a direction q or of omega is variance (1 - q q^T), `part` has the
 * diagonal of (1 - q q^T): along a column of the Jacobian, which is across q, the whole variance counts.
 * Other parts are 1. */
void lg_machine_row_variances(const lg_machine_problem *problem, const lg_machine_noise *noise, size_t row,
                              double factor, double *out, double *part);

/* Numbers of the features of a term: how many inputs its network has. */
uint32_t lg_machine_feature_numbers(const lg_machine *machine, const lg_machine_term *term);
/* lg_machine_numbers with M of a network at `positions` (of a log, in its units; NULL: the reference). */
size_t lg_machine_numbers_at(const lg_machine *machine, const double *theta, const double *positions,
                             size_t room, lg_identified *out);

#endif
