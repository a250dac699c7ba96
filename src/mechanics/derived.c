/* Systems that are given by their energies alone (lg_energy_row): the field follows from M(q) and V(q).
 *
 * v = (body rates of rotations, q' of directions, x' of lines and angles) and P, their momenta: R^T pi, p, p.
 * With the columns N of the constraints q.q' = 0, v and the multipliers l solve
 *   M v + N l = P,  N^T v = 0,
 * which makes H = P.v - v.M v/2 - l.N^T v + V stationary in v and l. So the derivatives of H by the state are
 * its partial derivatives with v and l fixed, and the bracket of the space gives the field
 * (lg_bracket_rate). */
#include <pthread.h>
#include <string.h>

#include "mechanics/engine.h"
#include "mechanics/system.h"

/* A state: pairs of a position and its momentum, and the positions on which M and V depend. */
typedef struct state {
    lg_tape *tape;
    const lg_energy_row *row;
    lg_var y[LG_TAPED_MAX_PARTS], seen[3];
    size_t parts;
    uint32_t rows, size; /* B; numbers of v */
    lg_at at;
} state;

static uint32_t width_of(const state *s, size_t part) {
    return (uint32_t)(lg_shape_count(lg_var_shape(s->tape, s->y[part])) / s->rows);
}

/* Lines and angles (B, n), directions (B, k, 3), rotations (B, c, 9): 0, 1, 2. */
static int kind_of(const state *s, size_t part) {
    const lg_shape shape = lg_var_shape(s->tape, s->y[part]);
    return shape.rank < 3 ? 0 : shape.dims[2] == 3 ? 1 : 2;
}

/* `copied`: the parts are copies, so that dH/dy leaves v and l fixed. */
static void open_state(lg_tape *tape, const lg_system *system, const lg_var *parts, lg_var parameters,
                       bool copied, state *s) {
    const uint32_t n = (uint32_t)system->space.dim / 2;
    size_t seen = 0;
    *s = (state){.tape = tape, .row = system->row->energy, .parts = lg_taped_parts(&system->space)};
    s->rows = lg_rows_of(tape, parts[0]);
    memcpy(s->y, parts, s->parts * sizeof *parts);
    if (s->parts == 1) { /* R^2n: q before p */
        s->y[0] = lg_slice(tape, parts[0], 1, 0, n);
        s->y[1] = lg_slice(tape, parts[0], 1, n, n);
        s->parts = 2;
    }
    for (size_t i = 0; i < s->parts; i++) {
        if (copied) s->y[i] = lg_scale(tape, s->y[i], 1.0);
        if (i % 2 == 1) s->size += width_of(s, i);
    }
    for (size_t i = s->parts; i > 0; i -= 2) s->seen[seen++] = s->y[i - 2];
    s->at = (lg_at){.rows = s->rows, .size = s->size, .parameters = parameters, .state = s->seen};
}

/* P (B, size, 1). */
static lg_var momenta(const state *s) {
    lg_var each[LG_TAPED_MAX_PARTS / 2];
    for (size_t i = 0; i < s->parts; i += 2) {
        const uint32_t width = width_of(s, i + 1), copies = s->rows * width / 3;
        lg_var p = s->y[i + 1];
        if (kind_of(s, i) == 2)
            p = lg_matmul_tn(s->tape, lg_reshape(s->tape, s->y[i], lg_shape3(copies, 3, 3)),
                             lg_reshape(s->tape, p, lg_shape3(copies, 3, 1)));
        each[i / 2] = lg_reshape(s->tape, p, lg_shape3(s->rows, width, 1));
    }
    return lg_concat(s->tape, each, s->parts / 2, 1);
}

/* N (B, size, directions), or LG_NONE. */
static lg_var constraints(const state *s) {
    for (size_t i = 0, first = 0; i < s->parts; first += width_of(s, i + 1), i += 2)
        if (kind_of(s, i) == 1) return lg_tie_columns(s->tape, s->y[i], (uint32_t)first, s->size);
    return LG_NONE;
}

/* M (B, size, size); one direction alone may have one number. */
static lg_var mass(const state *s) {
    lg_var M = s->row->mass(s->tape, &s->at);
    if (lg_var_shape(s->tape, M).dims[1] < s->size) M = lg_mul(s->tape, M, lg_unit_matrix(s->tape, s->size));
    return lg_broadcast_to(s->tape, M, lg_shape3(s->rows, s->size, s->size));
}

/* v and l; returns v. */
static lg_var velocities(const state *s, lg_var *multipliers) {
    const lg_var P = momenta(s), N = constraints(s), M = mass(s);
    *multipliers = LG_NONE;
    return lg_is_none(N) ? lg_spd_solve(s->tape, M, P)
                         : lg_tied_velocities(s->tape, M, LG_NONE, P, N, multipliers);
}

/* H (B, 1) at v and l: v.(P - M v/2 - N l) + V. */
static lg_var energy(const state *s, lg_var v, lg_var multipliers) {
    const lg_var N = constraints(s), half = lg_scale(s->tape, lg_matmul(s->tape, mass(s), v), 0.5);
    lg_var rest = lg_sub(s->tape, momenta(s), half);
    if (!lg_is_none(N)) rest = lg_sub(s->tape, rest, lg_matmul(s->tape, N, multipliers));
    const lg_var T = lg_reshape(s->tape, lg_matmul_tn(s->tape, v, rest), lg_shape2(s->rows, 1));
    return s->row->potential == NULL ? T : lg_add(s->tape, T, s->row->potential(s->tape, &s->at));
}

/* H of the state that is opened in *out. */
static lg_var record_energy(const lg_system *system, lg_tape *tape, const lg_var *parts, lg_var parameters,
                            bool copied, state *out) {
    state s;
    lg_var multipliers;
    open_state(tape, system, parts, parameters, false, &s);
    const lg_var v = velocities(&s, &multipliers);
    open_state(tape, system, parts, parameters, copied, out);
    return energy(out, v, multipliers);
}

static lg_var taped_energy(const lg_system *system, lg_tape *tape, const lg_var *y, lg_var parameters) {
    state s;
    if (lg_tape_status(tape) != LG_OK) return LG_NONE;
    return record_energy(system, tape, y, parameters, false, &s);
}

LG_TAPED_FIELD(taped) {
    state s;
    lg_var dH[LG_TAPED_MAX_PARTS], out[LG_TAPED_MAX_PARTS];
    LG_TRY(lg_tape_status(tape)); /* after a failure there are no parts */
    const lg_var H = record_energy(system, tape, y, numbers, true, &s);
    LG_TRY(lg_grad(tape, lg_sum(tape, H), s.y, s.parts, dH));
    for (size_t i = 0; i < s.parts; i += 2) {
        out[i] = lg_bracket_rate(tape, s.y + i, dH + i);
        out[i + 1] = lg_bracket_change(tape, s.y + i, dH + i);
    }
    if (lg_taped_parts(&system->space) == 1) out[0] = lg_concat(tape, out, 2, 1);
    memcpy(algebra, out, lg_taped_parts(&system->space) * sizeof *out);
    return lg_tape_status(tape);
}

/* ---- rows ---- */

#define ROW(name) &lg_energy_##name,
static const lg_energy_row *const energies[] = {LG_DERIVED_SYSTEMS(ROW)};
static struct made {
    lg_state_entry state[7];
    lg_system_row row;
} made[LG_COUNT(energies)];

static void make_row(const lg_energy_row *energy, struct made *m) {
    static const char *const invariants[] = {"energy", NULL};
    size_t copies[LG_COORDINATE_KIND_COUNT] = {0};
    for (uint32_t i = 0; i < energy->count; i++) copies[energy->coordinates[i]]++;
    const size_t c = copies[LG_COORDINATE_ROTATION], k = copies[LG_COORDINATE_DIRECTION], at = 12 * c + 6 * k,
                 n = copies[LG_COORDINATE_LINE] + copies[LG_COORDINATE_ANGLE];
    m->row = (lg_system_row){.name = energy->name,
                             .energy = energy,
                             .parameters = energy->parameters,
                             .state = m->state,
                             .invariants = invariants,
                             .invariant = lg_recorded_energy,
                             .structure = LG_STRUCTURE_HAMILTONIAN,
                             .taped_energy = taped_energy,
                             LG_RECORDED(taped)};
    lg_state_entry *part = m->state;
    lg_space_factor *factor = m->row.factor;
    if (c > 0) {
        *part++ = (lg_state_entry){"R", c, 3, 3, 0, 9, lg_row_attitude};
        *part++ = (lg_state_entry){"pi", c, 1, 3, 9 * c, 3, NULL};
        *factor++ = (lg_space_factor){LG_SPACE_SO3, c};
        *factor++ = (lg_space_factor){LG_SPACE_RN, 3 * c};
    }
    if (k > 0) {
        *part++ = (lg_state_entry){"q", k, 1, 3, 12 * c, 6, NULL};
        *part++ = (lg_state_entry){"p", k, 1, 3, 12 * c + 3, 6, NULL};
        *factor++ = (lg_space_factor){LG_SPACE_TS2, k};
    }
    if (n == 0) return;
    *part++ = (lg_state_entry){at > 0 ? "x" : "q", 1, 1, n, at, n, NULL};
    *part = (lg_state_entry){at > 0 ? "px" : "p", 1, 1, n, at + n, n, NULL};
    *factor++ = (lg_space_factor){LG_SPACE_RN, at > 0 ? n : 2 * n};
    if (at > 0) *factor = (lg_space_factor){LG_SPACE_RN, n};
}

static void make_rows(void) {
    for (size_t i = 0; i < LG_COUNT(energies); i++) make_row(energies[i], &made[i]);
}

const lg_system_row *lg_derived_row(size_t index) {
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    (void)pthread_once(&once, make_rows);
    return index < LG_COUNT(energies) ? &made[index].row : NULL;
}
