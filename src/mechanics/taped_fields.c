/* The fields of fields/NAME.inc on a tape. Numbers are (B, 1, 1), vectors (B, 1, 3), matrices (B, 3, 3);
 * parameters and constants are (1) and (3). */
#include "mechanics/system.h"

#include <float.h>

#include "liegrad/ops.h"

typedef lg_var number, vector, matrix;

enum { MOST = 10 }; /* vectors of an algebra element */

typedef struct field_at {
    lg_tape *tape;
    const lg_space *space;
    lg_taped_time t;
    lg_var parameter;
    const lg_var *y;
    lg_var out[MOST];
} field_at;

static uint32_t batch_of(const field_at *f) {
    return lg_var_shape(f->tape, f->y[0]).dims[0];
}

/* ---- parameters, states ---- */

#define n_parameter(f, i) lg_slice((f)->tape, (f)->parameter, 0, (uint32_t)(i), 1)
#define v_parameter(f, i) lg_slice((f)->tape, (f)->parameter, 0, (uint32_t)(i), 3)

/* The part of the state that has number i: the copies' part (B, count, n), or numbers of R^n (B, 1, 3). */
static lg_var part_at(const field_at *f, size_t i) {
    size_t part = 0, factor = 0;
    for (;; factor++) {
        const lg_space_factor of = f->space->factor[factor];
        const size_t own = lg_space_kind_entry(of.kind)->state, dim = own * of.count;
        const bool two = of.kind == LG_SPACE_TS2 || of.kind == LG_SPACE_SE3 || of.kind == LG_SPACE_SE3_DUAL;
        if (i >= dim) {
            i -= dim, part += two ? 2 : 1;
            continue;
        }
        lg_var x = f->y[part + (i % own > 0)];
        if (of.kind == LG_SPACE_RN) {
            x = lg_reshape(f->tape, x, lg_shape3(batch_of(f), 1, (uint32_t)of.count));
            return of.count == 3 ? x : lg_slice(f->tape, x, 2, (uint32_t)i, 3);
        }
        return of.count == 1 ? x : lg_slice(f->tape, x, 1, (uint32_t)(i / own), 1);
    }
}

#define v_state            part_at
#define matrix_state(f, i) lg_reshape((f)->tape, part_at(f, i), lg_shape3(batch_of(f), 3, 3))

/* ---- numbers ---- */

#define n_times(f, a, b)  lg_mul((f)->tape, a, b)
#define n_over(f, a, b)   lg_div((f)->tape, a, b)
#define n_plus(f, a, b)   lg_add((f)->tape, a, b)
#define n_less(f, a, b)   lg_sub((f)->tape, a, b)
#define n_scaled(f, c, a) lg_scale((f)->tape, a, c)
#define n_moved(f, a, c)  lg_add_scalar((f)->tape, a, c)
#define n_root(f, a)      lg_sqrt((f)->tape, a)
#define n_cosine(f, a)    lg_cos((f)->tape, a)
#define n_sine(f, a)      lg_sin((f)->tape, a)
#define n_positive(f, a)  (a)

static number n_time_after(const field_at *f, double begin) {
    const double t = f->t.value - begin;
    if (!lg_taped_time_varies(f->t)) return lg_input_f64(f->tape, lg_shape1(1), &t);
    const lg_var rows = lg_taped_time_rows(f->tape, f->t, batch_of(f));
    return lg_reshape(f->tape, lg_add_scalar(f->tape, rows, -begin), lg_shape3(batch_of(f), 1, 1));
}

/* ---- vectors ---- */

/* x in the shape (B, 1, 3) */
static vector whole(const field_at *f, vector x) {
    if (lg_var_shape(f->tape, x).rank == 3) return x;
    return lg_broadcast_to(f->tape, x, lg_shape3(batch_of(f), 1, 3));
}

#define v_plus                 n_plus
#define v_minus                n_less
#define v_times                n_times
#define v_over                 n_over
#define v_each_times           n_times
#define v_each_over            n_over
#define v_negative(f, a)       lg_neg((f)->tape, a)
#define v_second(f, a)         lg_slice((f)->tape, a, -1, 1, 1)
#define v_sum(f, a)            lg_sum_axis((f)->tape, a, -1, true)
#define v_dot(f, a, b)         lg_rowdot((f)->tape, whole(f, a), whole(f, b))
#define v_cross(f, a, b)       lg_cross((f)->tape, whole(f, a), whole(f, b))
#define v_turned(f, R, x)      lg_matmul_nt((f)->tape, whole(f, x), R)
#define v_turned_back(f, R, x) lg_matmul((f)->tape, whole(f, x), R)
#define v_constant(f, x, y, z) lg_input_f64((f)->tape, lg_shape1(3), (const double[]){x, y, z})

/* ---- the algebra element ---- */

static void put(field_at *f, size_t i, vector v) {
    f->out[i] = whole(f, v);
}

static lg_status finish(field_at *f, lg_var *algebra) {
    lg_var *at = f->out;
    for (size_t factor = 0, part = 0; factor < f->space->factors; factor++) {
        const lg_space_factor of = f->space->factor[factor];
        const bool flat = of.kind == LG_SPACE_RN;
        const size_t parts = flat ? 1 : lg_space_kind_entry(of.kind)->algebra / 3;
        const size_t count = flat ? of.count / 3 : of.count;
        for (size_t p = 0; p < parts; p++, part++) {
            lg_var of_part[MOST];
            for (size_t i = 0; i < count; i++) of_part[i] = at[i * parts + p];
            algebra[part] = count > 1 ? lg_concat(f->tape, of_part, count, flat ? 2 : 1) : of_part[0];
            if (flat) algebra[part] = lg_reshape(f->tape, algebra[part], lg_var_shape(f->tape, f->y[part]));
        }
        at += parts * count;
    }
    return lg_tape_status(f->tape);
}

/* ---- the fields ---- */

#include "mechanics/fields/rotations.inc"

#include "mechanics/fields/satellite.inc"

#include "mechanics/fields/quadrotors.inc"

#define DEFINE(name)                                                                                         \
    LG_TAPED_FIELD(name) {                                                                                   \
        field_at f = {.tape = tape, .space = &system->space, .t = t, .parameter = parameters, .y = y};       \
        name##_of(&f);                                                                                       \
        return finish(&f, algebra);                                                                          \
    }
LG_TAPED_FIELDS(DEFINE)
