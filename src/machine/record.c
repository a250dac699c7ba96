/* Machines: states, energy and field on a tape, in scaled units. */
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "machine/internal.h"

/* ---- parameters ---- */

/* A mass term; LG_NONE if it has none for the directions. Directions that a system couples have a matrix. */
static lg_var mass_of(const lg_term_at *at) {
    const uint32_t k = at->machine->directions;
    const bool directions = at->seen->directions, coupled = at->machine->grey.system != NULL && k > 1;
    if (directions && at->term->kind->outputs != NULL) return LG_NONE;
    const lg_var m = at->term->kind->record(at);
    const bool diagonal = directions && coupled && lg_var_shape(at->tape, m).dims[2] == 1;
    return diagonal ? lg_mul(at->tape, m, lg_unit_matrix(at->tape, k)) : m;
}

/* A mass term of a machine that is tied, as a matrix of all velocities: the sum of S^T M S with selections S
 * of its rows, of each direction one row after the other. */
static lg_var widened(const lg_term_at *term) {
    lg_tape *tape = term->tape;
    const uint32_t all = term->n;
    uint32_t list[LG_MACHINE_VELOCITIES];
    lg_machine_seen seen = *term->seen;
    lg_term_at at = *term;
    lg_var sum = LG_NONE;
    at.seen = &seen;
    for (lg_mass_rows rows = LG_MASS_MOMENTA; rows <= LG_MASS_DIRECTIONS; rows++) {
        const uint32_t n = lg_machine_mass_velocities(at.machine, rows, list);
        seen.directions = rows == LG_MASS_DIRECTIONS;
        const lg_var M = n > 0 ? mass_of(&at) : LG_NONE;
        for (uint32_t component = 0; component < (seen.directions ? 3 : 1) && !lg_is_none(M); component++) {
            const lg_var S =
                lg_reshape(tape, lg_machine_record_selection(tape, list, n, all), lg_shape3(1, n, all));
            sum = lg_add_or(tape, sum, lg_matmul_tn(tape, S, lg_matmul(tape, M, S)));
            for (uint32_t i = 0; i < n; i++) list[i]++;
        }
    }
    return sum;
}

/* The sum of the terms of one part, or LG_NONE. Input maps see the inputs after their curves. */
static lg_var sum_of(lg_tape *tape, const lg_machine_vars *vars, lg_machine_part part,
                     const lg_machine_seen *seen) {
    const lg_machine *machine = vars->machine;
    lg_machine_seen actuated;
    lg_var sum = LG_NONE;
    if (part == LG_MACHINE_INPUT_MAP) {
        actuated = *seen;
        actuated.u = lg_machine_record_actuated(tape, vars, seen);
        seen = &actuated;
    }
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, part, &term);) {
        const lg_term_at at = lg_term_at_of(tape, vars, term, seen);
        const lg_term_kind *kind = term->kind;
        const bool wide = kind != &lg_grey_mass_kind && lg_machine_tied(machine);
        sum = lg_add_or(tape, sum,
                        part != LG_MACHINE_MASS ? kind->record(&at)
                        : wide                  ? widened(&at)
                                                : mass_of(&at));
    }
    return sum;
}

static uint32_t mass_size(const lg_machine *machine) {
    return lg_machine_tied(machine) ? machine->velocities : machine->momenta;
}

/* The parameters of the system: the slice of theta of its mass term. */
static lg_var grey_theta(const lg_machine_vars *vars) {
    uint32_t i = 0;
    while (vars->machine->terms[i].kind != &lg_grey_mass_kind) i++;
    return vars->theta[i];
}

bool lg_machine_mass_moves(const lg_machine *machine) {
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);)
        if (term->kind->moving != NULL && term->kind->moving(machine)) return true;
    return false;
}

lg_status lg_machine_bind(lg_tape *tape, const lg_machine *machine, lg_var theta, lg_machine_vars *vars) {
    LG_TRY(lg_tape_needs(tape, "machine", machine != NULL && vars != NULL));
    *vars = (lg_machine_vars){.machine = machine};
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);) {
        const uint32_t i = (uint32_t)(term - machine->terms);
        if (term->parameters == 0) continue;
        vars->theta[i] = lg_slice(tape, theta, 0, (uint32_t)term->offset, (uint32_t)term->parameters);
        if (term->kind->outputs != NULL)
            LG_TRY(lg_mlp_bind(tape, &term->net, theta, term->offset, &vars->net[i]));
    }
    if (machine->grey.system != NULL) vars->grey = lg_grey_record(tape, machine, grey_theta(vars));
    const uint32_t n = mass_size(machine);
    vars->bias = sum_of(tape, vars, LG_MACHINE_BIAS, NULL);
    if (machine->lags > 0) vars->lag = lg_machine_record_lag(tape, vars);
    if (machine->bristles > 0) lg_machine_bind_bristles(tape, vars);
    const bool alone = machine->directions > 0 && !lg_machine_tied(machine);
    const lg_machine_seen directions = {.rows = 1, .directions = true};
    if (alone) vars->direction_mass = sum_of(tape, vars, LG_MACHINE_MASS, &directions);
    if (alone && machine->directions > 1 && machine->grey.system != NULL)
        vars->direction_inverse =
            lg_spd_solve(tape, vars->direction_mass, lg_unit_matrix(tape, machine->directions));
    if (n > 0 && !lg_machine_mass_moves(machine)) {
        const lg_var m = sum_of(tape, vars, LG_MACHINE_MASS, &(lg_machine_seen){.rows = 1});
        vars->mass = lg_reshape(tape, m, lg_shape2(n, n));
        vars->inverse = lg_reshape(tape, lg_spd_solve(tape, m, lg_unit_matrix(tape, n)), lg_shape2(n, n));
    }
    return lg_tape_status(tape);
}

/* ---- rows of 3-vectors ---- */

/* Three-vectors out of v (B, velocities), (B, copies, 3): the velocities of the directions, or the last 3
 * velocities of each rotation and pose. */
static lg_var rates(lg_tape *tape, const lg_machine *machine, lg_var v, bool directions) {
    lg_var each[LG_MACHINE_COORDINATES];
    uint32_t count = 0;
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);)
        if ((directions ? at.directions : at.rotations) > 0)
            each[count++] = lg_machine_columns(tape, v, at.velocity + at.velocities - 3, 3);
    return lg_reshape(tape, lg_joined(tape, each, count), lg_shape3(lg_rows_of(tape, v), count, 3));
}

/* ---- velocities and momenta on R^n ---- */

/* Drops the velocities of directions from v in log order; with_directions puts them in again. */
static lg_var without_directions(lg_tape *tape, const lg_machine *machine, lg_var v) {
    lg_var each[LG_MACHINE_COORDINATES];
    uint32_t count = 0;
    if (machine->directions == 0) return v;
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);)
        if (at.directions == 0) each[count++] = lg_machine_columns(tape, v, at.velocity, at.velocities);
    return count == 0 ? LG_NONE : lg_joined(tape, each, count);
}

static lg_var with_directions(lg_tape *tape, const lg_machine *machine, lg_var v, lg_var omega) {
    lg_var each[LG_MACHINE_COORDINATES];
    if (machine->directions == 0) return v;
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        if (at.directions > 0)
            each[at.index] = lg_machine_copy(tape, omega, at.direction);
        else
            each[at.index] = lg_machine_columns(tape, v, at.momentum, at.velocities);
    }
    return lg_joined(tape, each, machine->coordinate_count);
}

/* ---- states ---- */

static uint32_t rows_of(lg_tape *tape, const lg_var *parts) {
    return lg_rows_of(tape, parts[0]);
}

/* M of the state (B or 1, n, n). LG_NONE where M does not depend on the state: then vars->mass has it. */
static lg_var moving_mass(lg_tape *tape, const lg_machine_vars *vars, const lg_machine_seen *seen) {
    const bool bound = mass_size(vars->machine) == 0 || !lg_is_none(vars->mass);
    return bound ? LG_NONE : sum_of(tape, vars, LG_MACHINE_MASS, seen);
}

/* times_mass: p = M v; by_mass: v = M^-1 p; both (B, n). M is the result of moving_mass. */
static lg_var times_mass(lg_tape *tape, const lg_machine_vars *vars, lg_var M, lg_var v) {
    if (lg_is_none(M)) return lg_matmul(tape, v, vars->mass);
    const lg_shape shape = lg_var_shape(tape, v);
    const lg_var column = lg_reshape(tape, v, lg_shape3(shape.dims[0], shape.dims[1], 1));
    return lg_reshape(tape, lg_matmul(tape, M, column), shape);
}

static lg_var by_mass(lg_tape *tape, const lg_machine_vars *vars, lg_var M, lg_var p) {
    if (lg_is_none(M)) return lg_matmul(tape, p, vars->inverse);
    const lg_shape shape = lg_var_shape(tape, p);
    if (shape.dims[1] == 1) return lg_div(tape, p, lg_reshape(tape, M, shape));
    const lg_var column = lg_reshape(tape, p, lg_shape3(shape.dims[0], shape.dims[1], 1));
    return lg_reshape(tape, lg_spd_solve(tape, M, column), shape);
}

/* ---- directions: q' and p (B, k, 3) ---- */

static bool are_coupled(const lg_machine_vars *vars) {
    return !lg_is_none(vars->direction_inverse);
}

/* q' = omega x q in place of omega in v (B, velocities), or with `back` omega = q x q' in place of q'. */
static lg_var turning(lg_tape *tape, const lg_machine *machine, const lg_var *parts, lg_var v, bool back) {
    if (machine->directions == 0) return v;
    const lg_var q = parts[lg_machine_parts(machine).q], x = rates(tape, machine, v, true);
    return with_directions(tape, machine, without_directions(tape, machine, v),
                           back ? lg_cross(tape, q, x) : lg_cross(tape, x, q));
}

/* The biases of positions or of velocities, (1, numbers), or LG_NONE. */
static lg_var bias_of(lg_tape *tape, const lg_machine_vars *vars, bool velocities) {
    const lg_machine *machine = vars->machine;
    if (lg_is_none(vars->bias)) return vars->bias;
    return velocities ? lg_slice(tape, vars->bias, 1, machine->positions, machine->velocities)
                      : lg_slice(tape, vars->bias, 1, 0, machine->positions);
}

/* x with its bias added (lg_add) or subtracted (lg_sub). */
static lg_var biased(lg_tape *tape, const lg_machine_vars *vars, bool velocities, lg_var x,
                     lg_var (*apply)(lg_tape *tape, lg_var x, lg_var bias)) {
    const lg_var bias = vars->machine->accelerations ? LG_NONE : bias_of(tape, vars, velocities);
    return lg_is_none(bias) ? x : apply(tape, x, bias);
}

/* The momenta of v, which has q' in place of omega: p_i = P_i (M v)_i with P_i = 1 - q_i q_i^T, in which the
 * directions of a chain have the mass matrix of their own. */
static void put_momenta(lg_tape *tape, const lg_machine_vars *vars, lg_var M, lg_var v, lg_var *parts) {
    const lg_machine *machine = vars->machine;
    const lg_machine_places at = lg_machine_parts(machine);
    const bool tied = lg_machine_tied(machine);
    const lg_var all = tied ? times_mass(tape, vars, M, v) : v, x = without_directions(tape, machine, all);
    if (at.m >= 0) parts[at.m] = tied ? x : times_mass(tape, vars, M, x);
    if (at.p < 0) return;
    const lg_var q = parts[at.q], x3 = rates(tape, machine, all, true);
    lg_var p = x3;
    if (!tied)
        p = are_coupled(vars) ? lg_matmul(tape, vars->direction_mass, x3)
                              : lg_mul(tape, x3, vars->direction_mass);
    const bool free = !tied && !are_coupled(vars);
    parts[at.p] = free ? p : lg_sub(tape, p, lg_mul(tape, lg_rowdot(tape, q, p), q));
}

/* The state from positions and velocities without biases. */
static lg_status record_true_state(lg_tape *tape, const lg_machine_vars *vars, lg_var positions,
                                   lg_var velocities, lg_var *parts) {
    const lg_machine *machine = vars->machine;
    const lg_machine_places at = lg_machine_parts(machine);
    lg_machine_split_positions(tape, machine, positions, parts);
    const lg_machine_seen seen = {.parts = parts, .rows = lg_rows_of(tape, positions)};
    put_momenta(tape, vars, moving_mass(tape, vars, &seen), turning(tape, machine, parts, velocities, false),
                parts);
    if (at.z >= 0) parts[at.z] = lg_machine_bristle_steady(tape, vars, velocities);
    return lg_tape_status(tape);
}

lg_status lg_machine_record_state(lg_tape *tape, const lg_machine_vars *vars, lg_var positions,
                                  lg_var velocities, lg_var *parts) {
    LG_TRY(lg_tape_needs(tape, "state", vars != NULL && parts != NULL));
    return record_true_state(tape, vars, biased(tape, vars, false, positions, lg_sub),
                             biased(tape, vars, true, velocities, lg_sub), parts);
}

lg_status lg_machine_record_rest(lg_tape *tape, const lg_machine_vars *vars, const double *positions,
                                 lg_var *parts) {
    const lg_machine *machine = vars->machine;
    double q[LG_MACHINE_POSITIONS] = {0.0}, v[LG_MACHINE_VELOCITIES] = {0.0};
    if (positions == NULL) lg_machine_reference(machine, q);
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at) && positions != NULL;) {
        for (uint32_t k = 0; k < at.positions; k++)
            q[at.position + k] =
                positions[at.position + k] / (k < at.places ? machine->scales.place[at.place + k] : 1.0);
    }
    lg_var q0 = lg_input_f64(tape, lg_shape2(1, machine->positions), q);
    if (positions != NULL) q0 = biased(tape, vars, false, q0, lg_sub);
    return record_true_state(tape, vars, q0, lg_input_f64(tape, lg_shape2(1, machine->velocities), v), parts);
}

/* Positions of the state, without biases. */
static lg_var true_positions(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts) {
    const lg_machine *machine = vars->machine;
    const lg_machine_places at = lg_machine_parts(machine);
    lg_var all[2 * LG_MACHINE_COORDINATES];
    uint32_t count = 0;
    if (at.q < 0 && at.R < 0) return parts[at.x];
    for (lg_machine_offsets offset = {0}; lg_machine_next(machine, &offset);) {
        if (offset.places > 0)
            all[count++] = lg_machine_columns(tape, parts[at.x], offset.place, offset.places);
        if (offset.directions > 0) all[count++] = lg_machine_copy(tape, parts[at.q], offset.direction);
        if (offset.rotations > 0) all[count++] = lg_machine_copy(tape, parts[at.R], offset.rotation);
    }
    return lg_joined(tape, all, count);
}

lg_var lg_machine_record_positions(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts) {
    return biased(tape, vars, false, true_positions(tape, vars, parts), lg_add);
}

/* The momenta of all coordinates in the order of the velocities, (B, velocities). */
static lg_var all_momenta(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts) {
    const lg_machine_places at = lg_machine_parts(vars->machine);
    return with_directions(tape, vars->machine, at.m < 0 ? LG_NONE : parts[at.m],
                           at.p < 0 ? LG_NONE : parts[at.p]);
}

/* v (B, velocities) with q' in place of omega. *lambda gets the multipliers (B, k, 1) of the ties q.q' = 0;
 * LG_NONE: directions are not coupled. */
static lg_var velocities_with(lg_tape *tape, const lg_machine_vars *vars, lg_var M, const lg_var *parts,
                              lg_var *lambda) {
    const lg_machine *machine = vars->machine;
    const lg_machine_places at = lg_machine_parts(machine);
    const uint32_t rows = rows_of(tape, parts), n = machine->velocities;
    lg_var v = LG_NONE, moved = LG_NONE;
    *lambda = LG_NONE;
    if (lg_machine_tied(machine)) {
        lg_machine_offsets first = {0};
        while (lg_machine_next(machine, &first) && first.directions == 0) continue;
        const lg_var P = lg_reshape(tape, all_momenta(tape, vars, parts), lg_shape3(rows, n, 1)),
                     N = lg_tie_columns(tape, parts[at.q], first.velocity, n),
                     W = lg_is_none(M) ? lg_reshape(tape, vars->inverse, lg_shape3(1, n, n)) : LG_NONE;
        return lg_reshape(tape, lg_tied_velocities(tape, M, W, P, N, lambda), lg_shape2(rows, n));
    }
    if (at.m >= 0) v = by_mass(tape, vars, M, parts[at.m]);
    if (at.q >= 0)
        moved = are_coupled(vars)
                    ? lg_tied_velocity(tape, vars->direction_inverse, parts[at.q], parts[at.p], lambda)
                    : lg_div(tape, parts[at.p], vars->direction_mass);
    return with_directions(tape, machine, v, moved);
}

lg_var lg_machine_record_mass(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts) {
    const lg_machine_seen seen = {.parts = parts, .rows = rows_of(tape, parts)};
    return sum_of(tape, vars, LG_MACHINE_MASS, &seen);
}

lg_var lg_machine_record_velocities(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts) {
    return biased(tape, vars, true, lg_machine_record_rates(tape, vars, parts), lg_add);
}

/* ---- energy and forces ---- */

lg_var lg_machine_record_energy(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts) {
    const lg_machine_seen seen = {.parts = parts, .rows = rows_of(tape, parts)};
    const lg_var V = sum_of(tape, vars, LG_MACHINE_POTENTIAL, &seen), M = moving_mass(tape, vars, &seen);
    lg_var lambda;
    const lg_var v = velocities_with(tape, vars, M, parts, &lambda),
                 T = lg_scale(tape, lg_rowdot(tape, all_momenta(tape, vars, parts), v), 0.5);
    return lg_add_or(tape, T, V);
}

lg_var lg_machine_record_rates(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts) {
    const lg_machine_seen seen = {.parts = parts, .rows = rows_of(tape, parts)};
    lg_var lambda;
    const lg_var v = velocities_with(tape, vars, moving_mass(tape, vars, &seen), parts, &lambda);
    return turning(tape, vars->machine, parts, v, true);
}

lg_var lg_machine_record_force(lg_tape *tape, const lg_machine_vars *vars, lg_machine_part part,
                               const lg_var *parts, lg_var rates, lg_var u) {
    const lg_machine_seen seen = {.parts = parts, .v = rates, .u = u, .rows = rows_of(tape, parts)};
    return sum_of(tape, vars, part, &seen);
}

/* The sum of all forces except the potential's, (B, velocities), or LG_NONE. */
static lg_var all_forces(lg_tape *tape, const lg_machine_vars *vars, const lg_machine_seen *seen) {
    lg_var f = LG_NONE;
    static const lg_machine_part parts[] = {LG_MACHINE_DAMPING, LG_MACHINE_INPUT_MAP, LG_MACHINE_RESIDUAL,
                                            LG_MACHINE_OFFSET};
    for (size_t i = 0; i < LG_COUNT(parts); i++) {
        if (parts[i] == LG_MACHINE_INPUT_MAP && lg_is_none(seen->u)) continue;
        f = lg_add_or(tape, f, sum_of(tape, vars, parts[i], seen));
    }
    return f;
}

/* ---- the field ---- */

/* g = -dH/d(x, q, R) at fixed momenta without the ties, which is the derivative of 1/2 v^T M v - V at fixed v
 * (with q' in place of omega). All of g is LG_NONE when nothing depends on positions. */
static lg_status conservative_force(lg_tape *tape, const lg_machine_vars *vars, lg_var M, lg_var v,
                                    const lg_machine_seen *seen, lg_var *g) {
    const lg_machine *machine = vars->machine;
    const lg_machine_places at = lg_machine_parts(machine);
    const int positions[] = {at.x, at.q, at.R};
    lg_var y[2], cotangent[2], wrt[3], out[3];
    size_t outputs = 0, count = 0;
    for (int i = 0; i < LG_TAPED_MAX_PARTS; i++) g[i] = LG_NONE;
    if (!lg_is_none(M)) {
        const lg_var p = lg_machine_tied(machine) ? v : without_directions(tape, machine, v);
        const lg_var column = lg_reshape(tape, p, lg_shape3(seen->rows, mass_size(machine), 1));
        y[outputs] = M;
        cotangent[outputs++] = lg_scale(tape, lg_matmul_nt(tape, column, column), 0.5);
    }
    const lg_var V = sum_of(tape, vars, LG_MACHINE_POTENTIAL, seen);
    if (!lg_is_none(V)) {
        y[outputs] = V;
        cotangent[outputs] = lg_full(tape, lg_shape2(seen->rows, 1), -1.0);
        lg_tape_mark_rows(tape, cotangent[outputs++]);
    }
    if (outputs == 0) return lg_tape_status(tape);
    for (size_t i = 0; i < LG_COUNT(positions); i++)
        if (positions[i] >= 0) wrt[count++] = seen->parts[positions[i]];
    LG_TRY(lg_vjp(tape, y, cotangent, outputs, wrt, count, out));
    count = 0;
    for (size_t i = 0; i < LG_COUNT(positions); i++)
        if (positions[i] >= 0) g[positions[i]] = out[count++];
    return LG_OK;
}

static lg_var rotation_matrix(lg_tape *tape, lg_var R, uint32_t k, uint32_t rows) {
    return lg_reshape(tape, lg_slice(tape, R, 1, k, 1), lg_shape3(rows, 3, 3));
}

/* What the equations of one coordinate use. */
typedef struct body {
    const lg_machine *machine;
    lg_machine_places at;
    const lg_var *parts, *g;
    lg_var v, f, plain, lambda; /* plain: v with q' in place of omega */
    uint32_t rows;
} body;

/* sum_i r_i x g_i of rotation k, (B, 3) */
static lg_var moment_of(lg_tape *tape, const body *b, uint32_t k) {
    const lg_var R = rotation_matrix(tape, b->parts[b->at.R], k, b->rows);
    const lg_var g = rotation_matrix(tape, b->g[b->at.R], k, b->rows);
    return lg_sum_axis(tape, lg_cross(tape, R, g), 1, false);
}

/* R w or R^T w with the coordinate's R, (B, 3). */
static lg_var turned(lg_tape *tape, const body *b, const lg_machine_offsets *at, lg_var w, bool back) {
    const lg_var R = rotation_matrix(tape, b->parts[b->at.R], at->rotation, b->rows);
    const lg_var column = lg_reshape(tape, w, lg_shape3(b->rows, 3, 1));
    const lg_var out = back ? lg_matmul_tn(tape, R, column) : lg_matmul(tape, R, column);
    return lg_reshape(tape, out, lg_shape2(b->rows, 3));
}

/* Appends the potential's forces on a coordinate in the order of its velocities. */
static void pull_of(lg_tape *tape, const body *b, const lg_machine_offsets *at, lg_var *each,
                    uint32_t *count) {
    if (at->directions > 0) {
        const lg_var q = lg_slice(tape, b->parts[b->at.q], 1, at->direction, 1),
                     g = lg_slice(tape, b->g[b->at.q], 1, at->direction, 1);
        each[(*count)++] = lg_reshape(tape, lg_cross(tape, q, g), lg_shape2(b->rows, 3));
        return;
    }
    if (at->places > 0) {
        const lg_var force = lg_machine_columns(tape, b->g[b->at.x], at->place, at->places);
        each[(*count)++] = at->rotations > 0 ? turned(tape, b, at, force, true) : force;
    }
    if (at->rotations > 0) each[(*count)++] = lg_neg(tape, moment_of(tape, b, at->rotation));
}

/* The potential's forces on all coordinates, or on all except directions, or LG_NONE if there are none. */
static lg_var pull(lg_tape *tape, const body *b, bool directions) {
    const int first = b->at.x >= 0 ? b->at.x : b->at.q >= 0 ? b->at.q : b->at.R;
    lg_var each[2 * LG_MACHINE_COORDINATES];
    uint32_t count = 0;
    if (lg_is_none(b->g[first])) return LG_NONE;
    if (b->machine->rotations == 0 && !directions) return b->g[b->at.x];
    for (lg_machine_offsets at = {0}; lg_machine_next(b->machine, &at);)
        if (directions || at.directions == 0) pull_of(tape, b, &at, each, &count);
    return lg_joined(tape, each, count);
}

/* Appends x' of a pose to x, and the change of its momenta, or of a rotation's, without forces to p:
 * l x Omega, and m x Omega + l x w. */
static void move_body(lg_tape *tape, const body *b, const lg_machine_offsets *at, lg_var *x, uint32_t *xs,
                      lg_var *p, uint32_t *ps) {
    const lg_var Omega = lg_machine_columns(tape, b->v, at->velocity + at->places, 3);
    const lg_var m = lg_machine_columns(tape, b->parts[b->at.m], at->momentum + at->places, 3);
    lg_var moment = lg_cross(tape, m, Omega);
    if (at->places > 0) {
        const lg_var w = lg_machine_columns(tape, b->v, at->velocity, 3);
        const lg_var l = lg_machine_columns(tape, b->parts[b->at.m], at->momentum, 3);
        x[(*xs)++] = turned(tape, b, at, w, false);
        p[(*ps)++] = lg_cross(tape, l, Omega);
        moment = lg_add(tape, moment, lg_cross(tape, l, w));
    }
    p[(*ps)++] = moment;
}

/* Fills the parts of the algebra element that belong to places and momenta. */
static void move_places(lg_tape *tape, const body *b, lg_var *algebra) {
    lg_var x[LG_MACHINE_COORDINATES], p[2 * LG_MACHINE_COORDINATES];
    lg_var f = lg_is_none(b->f) ? LG_NONE : without_directions(tape, b->machine, b->f);
    uint32_t xs = 0, ps = 0;
    f = lg_add_or(tape, f, pull(tape, b, false));
    if (b->machine->rotations == 0) {
        algebra[b->at.x] = without_directions(tape, b->machine, b->v);
        algebra[b->at.m] = lg_is_none(f) ? lg_full(tape, lg_var_shape(tape, algebra[b->at.x]), 0.0) : f;
        return;
    }
    for (lg_machine_offsets at = {0}; lg_machine_next(b->machine, &at);) {
        if (at.rotations > 0) move_body(tape, b, &at, x, &xs, p, &ps);
        if (at.rotations > 0 || at.directions > 0) continue;
        x[xs++] = lg_machine_columns(tape, b->v, at.velocity, 1);
        p[ps++] = lg_full(tape, lg_shape2(b->rows, 1), 0.0);
    }
    if (xs > 0) algebra[b->at.x] = lg_joined(tape, x, xs);
    algebra[b->at.m] = lg_add_or(tape, f, lg_joined(tape, p, ps));
}

/* xi = omega and eta = f - g x q. Coupled directions add q x lambda q' + q' x p, with lambda as in
 * liegrad/machine.h. */
static void move_directions(lg_tape *tape, const body *b, lg_var *algebra) {
    const lg_var omega = rates(tape, b->machine, b->v, true), g = b->g[b->at.q], q = b->parts[b->at.q];
    lg_var eta = lg_is_none(b->f) ? LG_NONE : rates(tape, b->machine, b->f, true);
    if (!lg_is_none(g)) eta = lg_add_or(tape, eta, lg_cross(tape, q, g));
    if (!lg_is_none(b->lambda)) {
        const lg_var v = rates(tape, b->machine, b->plain, true);
        eta = lg_add_or(tape, eta, lg_cross(tape, q, lg_mul(tape, b->lambda, v)));
        eta = lg_add_or(tape, eta, lg_cross(tape, v, b->parts[b->at.p]));
    }
    algebra[b->at.q] = omega;
    algebra[b->at.p] = lg_is_none(eta) ? lg_full(tape, lg_var_shape(tape, omega), 0.0) : eta;
}

/* Fills the rotations' part of the algebra element, R Omega. */
static void move_rotations(lg_tape *tape, const body *b, lg_var *algebra) {
    const uint32_t copies = b->rows * b->machine->rotations;
    const lg_var Omega = rates(tape, b->machine, b->v, false), R = b->parts[b->at.R];
    const lg_var spatial = lg_matmul(tape, lg_reshape(tape, R, lg_shape3(copies, 3, 3)),
                                     lg_reshape(tape, Omega, lg_shape3(copies, 3, 1)));
    algebra[b->at.R] = lg_reshape(tape, spatial, lg_var_shape(tape, Omega));
}

lg_status lg_machine_record_field(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts, lg_var u,
                                  lg_var *algebra) {
    LG_TRY(lg_tape_needs(tape, "field", vars != NULL && parts != NULL && algebra != NULL));
    const lg_machine *machine = vars->machine;
    lg_machine_seen seen = {.parts = parts, .u = u, .rows = rows_of(tape, parts)};
    if (lg_is_none(u) && machine->input_count > 0) {
        seen.u = lg_full(tape, lg_shape2(seen.rows, machine->input_count), 0.0);
        lg_tape_mark_rows(tape, seen.u);
    }
    lg_var g[LG_TAPED_MAX_PARTS], lambda;
    const lg_var M = moving_mass(tape, vars, &seen), v = velocities_with(tape, vars, M, parts, &lambda);
    seen.v = turning(tape, machine, parts, v, true);
    LG_TRY(conservative_force(tape, vars, M, v, &seen, g));
    const body b = {.machine = machine,
                    .at = lg_machine_parts(machine),
                    .parts = parts,
                    .g = g,
                    .v = seen.v,
                    .f = all_forces(tape, vars, &seen),
                    .plain = v,
                    .lambda = lambda,
                    .rows = seen.rows};
    if (machine->momenta > 0) move_places(tape, &b, algebra);
    if (machine->directions > 0) move_directions(tape, &b, algebra);
    if (machine->rotations > 0) move_rotations(tape, &b, algebra);
    if (b.at.z >= 0) algebra[b.at.z] = lg_machine_bristle_rate(tape, vars, seen.v, parts[b.at.z]);
    return lg_tape_status(tape);
}

lg_status lg_machine_record_motion(lg_tape *tape, const lg_machine_vars *vars, const lg_machine_seen *seen,
                                   lg_machine_motion *out) {
    const lg_machine *machine = vars->machine;
    const int x = lg_machine_parts(machine).x;
    lg_var g[LG_TAPED_MAX_PARTS], change;
    *out = (lg_machine_motion){moving_mass(tape, vars, seen), all_forces(tape, vars, seen), LG_NONE};
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);) {
        const lg_term_at at = lg_term_at_of(tape, vars, term, seen);
        if (term->kind->limit != NULL && lg_machine_term_sticks(machine, term))
            out->c = lg_add_or(tape, out->c, term->kind->limit(&at));
    }
    if (lg_is_none(out->c)) out->c = lg_full(tape, lg_shape2(1, machine->velocities), 0.0);
    LG_TRY(conservative_force(tape, vars, out->M, seen->v, seen, g));
    out->F = lg_add_or(tape, out->F, g[x]);
    if (lg_is_none(out->M)) return lg_tape_status(tape);
    const lg_var p = times_mass(tape, vars, out->M, seen->v);
    LG_TRY(lg_jvp(tape, &p, 1, &seen->parts[x], &seen->v, 1, &change));
    out->F = lg_sub(tape, out->F, change);
    return lg_tape_status(tape);
}

/* ---- accelerations ---- */

/* v' = dv/d(state) state' of the momenta's machine: the tangent of the velocities along the field. The copies
 * make the parts of the state independent of each other. */
static lg_var along_field(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts,
                          const lg_var *algebra, size_t count) {
    lg_var copies[LG_TAPED_MAX_PARTS], out = LG_NONE;
    for (size_t i = 0; i < count; i++) copies[i] = lg_scale(tape, parts[i], 1.0);
    const lg_var v = lg_machine_record_rates(tape, vars, copies);
    return lg_jvp(tape, &v, 1, copies, algebra, count, &out) == LG_OK ? out : LG_NONE;
}

lg_var lg_machine_record_accelerations(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts,
                                       lg_var u, lg_var stuck) {
    lg_var algebra[LG_TAPED_MAX_PARTS];
    lg_space space;
    lg_var a = stuck;
    if (lg_is_none(a) && lg_machine_record_field(tape, vars, parts, u, algebra) == LG_OK &&
        lg_machine_space(vars->machine, &space) == LG_OK)
        a = along_field(tape, vars, parts, algebra, lg_taped_parts(&space));
    const lg_var bias = bias_of(tape, vars, true);
    return lg_is_none(bias) || lg_is_none(a) ? a : lg_add(tape, a, bias);
}

/* ---- potential forces and impulses ---- */

lg_var lg_machine_record_pull(lg_tape *tape, const lg_machine_vars *vars, const lg_var *parts) {
    const lg_machine *machine = vars->machine;
    const lg_machine_seen seen = {.parts = parts, .rows = rows_of(tape, parts)};
    lg_var g[LG_TAPED_MAX_PARTS];
    if (conservative_force(tape, vars, LG_NONE, LG_NONE, &seen, g) != LG_OK) return LG_NONE;
    const body b = {
        .machine = machine, .at = lg_machine_parts(machine), .parts = parts, .g = g, .rows = seen.rows};
    return pull(tape, &b, true);
}

void lg_machine_push(lg_tape *tape, const lg_machine *machine, lg_var impulse, lg_var *parts) {
    const lg_machine_places at = lg_machine_parts(machine);
    if (at.m >= 0) parts[at.m] = lg_add(tape, parts[at.m], without_directions(tape, machine, impulse));
    if (at.p >= 0) {
        const lg_var torque = rates(tape, machine, impulse, true);
        parts[at.p] = lg_add(tape, parts[at.p], lg_cross(tape, torque, parts[at.q]));
    }
}
