/* Machines: the features that terms take from a state, and building blocks for recording terms. */
#include <string.h>

#include "machine/internal.h"

lg_var lg_machine_columns(lg_tape *tape, lg_var x, uint32_t first, uint32_t count) {
    const lg_shape shape = lg_var_shape(tape, x);
    if (first == 0 && shape.dims[1] == count) return x;
    return lg_slice(tape, x, 1, first, count);
}

void lg_machine_split_positions(lg_tape *tape, const lg_machine *machine, lg_var positions, lg_var *parts) {
    lg_var x[LG_MACHINE_COORDINATES], q[LG_MACHINE_COORDINATES], R[LG_MACHINE_COORDINATES];
    uint32_t xs = 0, qs = 0, Rs = 0;
    const lg_machine_places part = lg_machine_parts(machine);
    const uint32_t rows = lg_rows_of(tape, positions);
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        if (at.places > 0) x[xs++] = lg_machine_columns(tape, positions, at.position, at.places);
        if (at.directions > 0) q[qs++] = lg_machine_columns(tape, positions, at.position, 3);
        if (at.rotations > 0) R[Rs++] = lg_machine_columns(tape, positions, at.position + at.places, 9);
    }
    if (part.x >= 0) parts[part.x] = lg_joined(tape, x, xs);
    if (part.q >= 0) parts[part.q] = lg_reshape(tape, lg_joined(tape, q, qs), lg_shape3(rows, qs, 3));
    if (part.R >= 0) parts[part.R] = lg_reshape(tape, lg_joined(tape, R, Rs), lg_shape3(rows, Rs, 9));
}

/* ---- features ---- */

enum { SIN_COS = 2, VECTOR = 3, MATRIX = 9 };

static bool is_angle(const lg_machine *machine, lg_machine_feature of) {
    return machine->coordinates[of.index].kind == LG_COORDINATE_ANGLE;
}

static const uint32_t height_counts[LG_COORDINATE_KIND_COUNT] = {[LG_COORDINATE_LINE] = 1,
                                                                 [LG_COORDINATE_ANGLE] = SIN_COS,
                                                                 [LG_COORDINATE_DIRECTION] = 1,
                                                                 [LG_COORDINATE_ROTATION] = VECTOR,
                                                                 [LG_COORDINATE_POSE] = 1};

uint32_t lg_machine_feature_count(const lg_machine *machine, lg_machine_feature of) {
    switch (of.kind) {
    case LG_FEATURE_POSITION:
        return is_angle(machine, of) ? SIN_COS : lg_coordinate_positions(machine->coordinates[of.index].kind);
    case LG_FEATURE_PLACE:
    case LG_FEATURE_UP:
        return VECTOR;
    case LG_FEATURE_ROTATION:
        return MATRIX;
    case LG_FEATURE_HEIGHT:
        return height_counts[machine->coordinates[of.index].kind];
    case LG_FEATURE_VELOCITY:
        return lg_coordinate_row_of(machine->coordinates[of.index].kind)->velocities;
    default:
        return 1;
    }
}

uint32_t lg_machine_feature_numbers(const lg_machine *machine, const lg_machine_term *term) {
    uint32_t sum = 0;
    for (uint32_t i = 0; i < term->of_count; i++) sum += lg_machine_feature_count(machine, term->of[i]);
    return sum;
}

uint32_t lg_machine_feature_scales(const lg_machine *machine, const lg_machine_term *term, double *scales) {
    const lg_machine_scales *s = &machine->scales;
    uint32_t used = 0;
    for (uint32_t i = 0; i < term->of_count; i++) {
        const lg_machine_feature of = term->of[i];
        const uint32_t count = lg_machine_feature_count(machine, of);
        const bool input = of.kind == LG_FEATURE_INPUT;
        const lg_machine_offsets at = lg_machine_offsets_of(machine, input ? 0 : of.index);
        const uint32_t places = input ? 0 : at.places;
        for (uint32_t k = 0; k < count; k++) {
            double scale = 1.0;
            const bool place = of.kind == LG_FEATURE_PLACE || of.kind == LG_FEATURE_POSITION;
            if ((place && k < places) || (of.kind == LG_FEATURE_HEIGHT && places > 0))
                scale = s->place[at.place + (is_angle(machine, of) ? 0 : place ? k : places - 1)];
            if (input) scale = s->input[of.index];
            scales[used++] = scale;
        }
    }
    return used;
}

lg_var lg_machine_copy(lg_tape *tape, lg_var part, uint32_t k) {
    const lg_shape shape = lg_var_shape(tape, part);
    const lg_var x = shape.dims[1] > 1 ? lg_slice(tape, part, 1, k, 1) : part;
    return lg_reshape(tape, x, lg_shape2(shape.dims[0], shape.dims[2]));
}

/* The height feature of a coordinate that is not an angle. */
static lg_var height(lg_tape *tape, const lg_machine_places *part, const lg_machine_offsets *at,
                     const lg_var *y) {
    if (at->places > 0) return lg_machine_columns(tape, y[part->x], at->place + at->places - 1, 1);
    if (at->directions > 0) return lg_slice(tape, lg_machine_copy(tape, y[part->q], at->direction), 1, 2, 1);
    return lg_slice(tape, lg_machine_copy(tape, y[part->R], at->rotation), 1, 6, VECTOR);
}

/* Writes the variables of one feature to `out`; returns their number. */
static uint32_t record_feature(lg_tape *tape, const lg_machine *machine, lg_machine_feature of,
                               const lg_machine_seen *seen, lg_var *out) {
    if (of.kind == LG_FEATURE_INPUT) {
        out[0] = lg_machine_columns(tape, seen->u, of.index, 1);
        return 1;
    }
    const lg_machine_offsets at = lg_machine_offsets_of(machine, of.index);
    const lg_machine_places part = lg_machine_parts(machine);
    const lg_var *y = seen->parts;
    uint32_t count = 0;
    if (of.kind == LG_FEATURE_VELOCITY) {
        out[count++] = lg_machine_columns(tape, seen->v, at.velocity, at.velocities);
    } else if (of.kind == LG_FEATURE_UP) {
        out[count++] = lg_slice(tape, lg_machine_copy(tape, y[part.R], at.rotation), 1, 6, VECTOR);
    } else if (is_angle(machine, of)) {
        const lg_var angle = lg_machine_columns(tape, y[part.x], at.place, 1);
        out[count++] = lg_sin(tape, angle);
        out[count++] = lg_cos(tape, angle);
    } else if (of.kind == LG_FEATURE_HEIGHT) {
        out[count++] = height(tape, &part, &at, y);
    } else {
        if (of.kind != LG_FEATURE_ROTATION && at.places > 0)
            out[count++] = lg_machine_columns(tape, y[part.x], at.place, at.places);
        if (at.directions > 0) out[count++] = lg_machine_copy(tape, y[part.q], at.direction);
        if (of.kind != LG_FEATURE_PLACE && at.rotations > 0)
            out[count++] = lg_machine_copy(tape, y[part.R], at.rotation);
    }
    return count;
}

lg_var lg_machine_record_features(const lg_term_at *at) {
    lg_var all[2 * LG_MACHINE_FEATURES];
    uint32_t count = 0;
    for (uint32_t i = 0; i < at->term->of_count; i++)
        count += record_feature(at->tape, at->machine, at->term->of[i], at->seen, all + count);
    return lg_joined(at->tape, all, count);
}

lg_var lg_machine_record_network(const lg_term_at *at) {
    const lg_var x = lg_machine_record_features(at);
    return lg_mlp_record_bound(at->tape, &at->term->net, &at->vars->net[at->index], x);
}

/* ---- monomials ---- */

/* Appends the monomials that begin with factors[0 .. degree - 1]. The indices of further factors do not
 * decrease. */
static bool add_monomials(lg_monomials *m, uint32_t variables, uint32_t least, uint32_t most,
                          uint32_t *factors, uint32_t degree) {
    if (degree >= least && degree > 0) {
        if (m->count == LG_MACHINE_MONOMIALS) return false;
        memcpy(m->factor[m->count], factors, degree * sizeof *factors);
        m->factor[m->count++][degree] = UINT32_MAX;
    }
    if (degree == most) return true;
    for (uint32_t i = degree > 0 ? factors[degree - 1] : 0; i < variables; i++) {
        factors[degree] = i;
        if (!add_monomials(m, variables, least, most, factors, degree + 1)) return false;
    }
    return true;
}

bool lg_machine_monomials(uint32_t variables, uint32_t least, uint32_t most, lg_monomials *out) {
    uint32_t factors[LG_MACHINE_DEGREE];
    out->count = 0;
    return add_monomials(out, variables, least, most, factors, 0);
}

lg_var lg_machine_record_monomials(lg_tape *tape, const lg_monomials *monomials, lg_var x) {
    lg_var columns[LG_MACHINE_MONOMIALS], all[LG_MACHINE_MONOMIALS];
    const uint32_t variables = lg_var_shape(tape, x).dims[1];
    bool linear = monomials->count == variables;
    for (uint32_t i = 0; i < monomials->count; i++) linear = linear && monomials->factor[i][1] == UINT32_MAX;
    if (linear) return x;
    for (uint32_t i = 0; i < variables && i < LG_MACHINE_MONOMIALS; i++)
        columns[i] = lg_machine_columns(tape, x, i, 1);
    for (uint32_t i = 0; i < monomials->count; i++) {
        const uint32_t *factor = monomials->factor[i];
        all[i] = columns[factor[0]];
        for (uint32_t k = 1; factor[k] != UINT32_MAX; k++) all[i] = lg_mul(tape, all[i], columns[factor[k]]);
    }
    return lg_joined(tape, all, monomials->count);
}

/* ---- matrices ---- */

void lg_machine_square_values(const lg_machine *machine, const lg_machine_term *term, size_t fits[2]) {
    fits[0] = machine->velocities;
    fits[1] = (size_t)machine->velocities * machine->velocities;
}

lg_var lg_machine_record_selection(lg_tape *tape, const uint32_t *at, uint32_t count, uint32_t columns) {
    void *memory;
    const lg_var out = lg_input_buffer(tape, lg_shape2(count, columns), &memory);
    if (lg_is_none(out)) return out;
    memset(memory, 0, (size_t)count * columns * sizeof(double));
    for (uint32_t i = 0; i < count; i++) ((double *)memory)[(size_t)i * columns + at[i]] = 1.0;
    return out;
}

/* Matrix S (triangle, n n) that unpacks triangles: row k has a 1 at the place of packed number k in the
 * row-major matrix (n, n). */
static lg_var selection(lg_tape *tape, uint32_t n) {
    uint32_t at[LG_MACHINE_VALUES], k = n;
    for (uint32_t i = 0; i < n; i++) {
        at[i] = i * n + i;
        for (uint32_t j = 0; j < i; j++) at[k++] = i * n + j;
    }
    return lg_machine_record_selection(tape, at, k, n * n);
}

lg_var lg_machine_record_triangle(lg_tape *tape, lg_var packed, uint32_t n, bool positive) {
    const uint32_t rows = lg_rows_of(tape, packed), count = lg_triangle(n);
    if (positive) {
        lg_var both[2];
        both[0] = lg_exp(tape, lg_machine_columns(tape, packed, 0, n));
        if (n > 1) both[1] = lg_slice(tape, packed, 1, n, count - n);
        packed = lg_joined(tape, both, n > 1 ? 2 : 1);
    }
    if (n > 1) packed = lg_matmul(tape, packed, selection(tape, n));
    return lg_reshape(tape, packed, lg_shape3(rows, n, n));
}
