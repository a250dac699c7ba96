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

/* Numbers with names (machine_numbers.c): those counted, of which `room` are kept. */
typedef struct lg_number_list {
    size_t count, room;
    lg_identified *out;
} lg_number_list;
typedef void lg_term_numbers(lg_number_list *list, const lg_machine *machine, const lg_machine_term *term,
                             const double *theta);
lg_term_numbers lg_numbers_diagonal_mass, lg_numbers_constant_mass, lg_numbers_potential,
    lg_numbers_diagonal_damping, lg_numbers_constant_damping, lg_numbers_coulomb, lg_numbers_quadratic,
    lg_numbers_constant_map;

/* A row of the table of terms. `record` gives, by part:
 *   mass       M of the momenta on R^n, (B, n, n) or (1, n, n)
 *   potential  V (B, 1)
 *   damping, input map, residual   forces (B, velocities) */
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
    bool heights;         /* sees heights where positions are listed */
    bool moving;          /* M depends on the state */
    uint32_t least, most; /* degrees of a potential's monomials; most 0: the term's degree */
};
extern const lg_term_kind lg_machine_mass_kinds[], lg_machine_potential_kinds[], lg_machine_force_kinds[];

/* Numbers of one feature, and their scales: a number of the log is the scaled one times its scale. */
uint32_t lg_machine_feature_count(const lg_machine *machine, lg_machine_feature feature);
uint32_t lg_machine_feature_scales(const lg_machine *machine, const lg_machine_term *term, double *scales);
/* The features of a term (B, numbers). */
lg_var lg_machine_record_features(lg_tape *tape, const lg_machine *machine, const lg_machine_term *term,
                                  const lg_machine_seen *seen);

bool lg_machine_mass_moves(const lg_machine *machine); /* M depends on the state */
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

/* ---- functions (machine_program.c) ---- */

/* lg_machine_program without step. */
lg_status lg_machine_bundle(const lg_context *context, const lg_machine *machine, const double *theta,
                            lg_program **out, lg_error *error);

/* ---- windows (machine_step.c) ---- */

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

#endif
