/* Maps of so(3) and se(3), one node each; attr.i = {map}. In recorded mode, derivatives are taken of the same
 * map built from row-wise vector operations and analytic functions of w = |u|^2. In unrecorded mode, kernels
 * compute the cotangents. */
#include "autodiff/ops/lie.h"

#include "autodiff/ops/op_c.h"
#include "autodiff/tape/tape_internal.h"

extern const lg_op lg_op_lie;

/* ---- the maps built from other operations ---- */

/* b + c1 u x b + c2 u x (u x b). */
static lg_var second_order(lg_tape *tape, lg_var u, lg_var b, lg_var c1, lg_var c2) {
    lg_var ub = lg_cross(tape, u, b);
    lg_var uub = lg_cross(tape, u, ub);
    lg_var sum = lg_add(tape, lg_mul(tape, c1, ub), lg_mul(tape, c2, uub));
    return lg_add(tape, b, sum);
}

/* The Stumpff functions c_1, c_2 and c_3 of w = |u|^2, each of shape (..., 1). */
typedef struct coefficients {
    lg_var c[4];
} coefficients;

static coefficients stumpff_of(lg_tape *tape, lg_var u) {
    lg_var all = lg_stumpff_functions(tape, lg_rownorm2(tape, u), 3);
    coefficients k;
    for (uint32_t i = 1; i < 4; i++) k.c[i] = lg_slice(tape, all, -1, i, 1);
    return k;
}

/* exp(u) X for matrices X (..., 9): the columns of X become rows of an array (n, 3, 3), and u is repeated for
 * each of them. */
static lg_var build_matrix_exp(lg_tape *tape, const lg_var *x) {
    const lg_shape shape = lg_var_shape(tape, x[1]);
    const uint32_t n = (uint32_t)(lg_shape_count(shape) / 9);
    const coefficients k = stumpff_of(tape, lg_reshape(tape, x[0], lg_shape3(n, 1, 3)));
    lg_var u = lg_broadcast_to(tape, lg_reshape(tape, x[0], lg_shape3(n, 1, 3)), lg_shape3(n, 3, 3));
    lg_var columns = lg_transpose(tape, lg_reshape(tape, x[1], lg_shape3(n, 3, 3)));
    lg_var moved = second_order(tape, u, columns, k.c[1], k.c[2]);
    return lg_reshape(tape, lg_transpose(tape, moved), shape);
}

static lg_var build_exp(lg_tape *tape, const lg_var *x, uint32_t columns) {
    if (columns == 3) return build_matrix_exp(tape, x);
    const coefficients k = stumpff_of(tape, x[0]);
    return second_order(tape, x[0], x[1], k.c[1], k.c[2]);
}

static lg_var build_dexp(lg_tape *tape, const lg_var *x, uint32_t columns) {
    const coefficients k = stumpff_of(tape, x[0]);
    return second_order(tape, x[0], x[1], k.c[2], k.c[3]);
}

static lg_var build_act(lg_tape *tape, const lg_var *x, uint32_t columns) {
    const coefficients k = stumpff_of(tape, x[0]);
    lg_var r = second_order(tape, x[0], x[1], k.c[2], k.c[3]);
    lg_var q = second_order(tape, x[0], x[2], k.c[1], k.c[2]);
    lg_var p = second_order(tape, x[0], x[3], k.c[1], k.c[2]);
    return lg_add(tape, p, lg_cross(tape, r, q));
}

lg_var lg_taped_moved(lg_tape *tape, lg_var from, double weight, lg_var by) {
    lg_var terms[2] = {from, by};
    const double c[2] = {1.0, weight};
    return lg_linear_combination(tape, terms, c, 2);
}

static lg_var build_dexpinv(lg_tape *tape, const lg_var *x, uint32_t columns) {
    lg_var g2 = lg_dexpinv_coefficient(tape, lg_rownorm2(tape, x[0]), 0);
    lg_var ab = lg_cross(tape, x[0], x[1]), aab = lg_cross(tape, x[0], ab);
    return lg_add(tape, lg_taped_moved(tape, x[1], -0.5, ab), lg_mul(tape, g2, aab));
}

/* The closed form of lg_se3_dexpinv with first argument (A, a) and second argument (B, b):
 *   b - 1/2 (a x B + A x b) + rho gt2 A x (A x B) + g2 (a x (A x B) + A x (a x B) + A x (A x b)), rho = A.a
 */
static lg_var build_dexpinv_second(lg_tape *tape, const lg_var *x, uint32_t columns) {
    lg_var A = x[0], a = x[1], B = x[2], b = x[3];
    lg_var w = lg_rownorm2(tape, A);
    lg_var g2 = lg_dexpinv_coefficient(tape, w, 0);
    lg_var gt2 = lg_scale(tape, lg_dexpinv_coefficient(tape, w, 1), 2.0);
    lg_var rho = lg_rowdot(tape, A, a);
    lg_var AB = lg_cross(tape, A, B), AAB = lg_cross(tape, A, AB);
    lg_var mixed = lg_add(tape, lg_cross(tape, a, B), lg_cross(tape, A, b));
    lg_var triple = lg_add(tape, lg_cross(tape, a, AB), lg_cross(tape, A, mixed));
    lg_var tail = lg_add(tape, lg_mul(tape, lg_mul(tape, rho, gt2), AAB), lg_mul(tape, g2, triple));
    return lg_add(tape, lg_taped_moved(tape, b, -0.5, mixed), tail);
}

typedef struct map_row {
    uint32_t inputs, widest; /* the last input has 3 or `widest` numbers per row */
    lg_var (*build)(lg_tape *tape, const lg_var *x, uint32_t columns);
} map_row;

static const map_row maps[LG_K_LIE_MAPS] = {
    [LG_K_SO3_EXP] = {2, 9, build_exp},
    [LG_K_SO3_DEXP] = {2, 3, build_dexp},
    [LG_K_SE3_ACT] = {4, 3, build_act},
    [LG_K_SO3_DEXPINV] = {2, 3, build_dexpinv},
    [LG_K_SE3_DEXPINV] = {4, 3, build_dexpinv_second},
};

/* ---- the operation ---- */

static lg_status lie_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr, lg_shape *out) {
    const lg_shape *u = in[0], *last = in[inputs - 1];
    if (attr->i[0] >= LG_K_LIE_MAPS || maps[attr->i[0]].inputs != inputs) return LG_INVALID_ARGUMENT;
    if (u->rank == 0 || u->dims[u->rank - 1] != 3 || last->rank != u->rank) return LG_SHAPE;
    lg_shape vector = *last;
    const uint32_t width = vector.dims[vector.rank - 1];
    vector.dims[vector.rank - 1] = 3;
    if (width != 3 && width != maps[attr->i[0]].widest) return LG_SHAPE;
    if (!lg_same_shape(u, &vector)) return LG_SHAPE;
    for (uint32_t k = 1; k + 1 < inputs; k++)
        if (!lg_same_shape(u, in[k])) return LG_SHAPE;
    *out = *last;
    return LG_OK;
}

static uint32_t columns_of(const lg_shape *shape) {
    return shape->dims[shape->rank - 1] / 3;
}

static lg_status lie_forward(lg_evaluation *e) {
    const void *values[LG_K_LIE_INPUTS];
    for (uint32_t k = 0; k < e->inputs; k++) values[k] = e->x[k];
    e->k->lie[e->attr->i[0]](lg_shape_count(*e->in[0]) / 3, columns_of(e->shape), values, e->y);
    return LG_OK;
}

static void reverse_in_place(lg_reverse *r) {
    lg_tape *tape = r->tape;
    const void *values[LG_K_LIE_INPUTS];
    void *out[LG_K_LIE_INPUTS];
    bool add[LG_K_LIE_INPUTS] = {false};
    for (uint32_t k = 0; k < r->inputs; k++) {
        out[k] = r->need[k] ? lg_reverse_into(r, k, &add[k]) : NULL;
        if (r->need[k] && out[k] == NULL) return;
        values[k] = lg_node_at(tape, r->in[k])->value;
    }
    const size_t n = lg_node_at(tape, r->in[0])->count / 3;
    const uint32_t columns = columns_of(&lg_node_at(tape, r->y)->shape);
    tape->k->lie_reverse[r->attr->i[0]](n, columns, values, lg_node_at(tape, r->g)->value, out, add);
}

/* Builds the map from copies x of its inputs, so that each x[k] can be differentiated by itself even if one
 * input depends on another or is the same variable. */
static lg_var build(lg_tape *tape, const lg_attr *attr, const lg_var *in, uint32_t inputs, lg_var *x) {
    for (uint32_t k = 0; k < inputs; k++) x[k] = lg_scale(tape, in[k], 1.0);
    const lg_shape last = lg_var_shape(tape, x[inputs - 1]);
    if (tape->status != LG_OK) return LG_NONE;
    return maps[attr->i[0]].build(tape, x, columns_of(&last));
}

static void lie_vjp(lg_reverse *r) {
    lg_var x[LG_K_LIE_INPUTS], wanted[LG_K_LIE_INPUTS], found[LG_K_LIE_INPUTS];
    size_t n = 0;
    if (lg_reverse_in_place(r)) {
        reverse_in_place(r);
        return;
    }
    lg_var y = build(r->tape, r->attr, r->in, r->inputs, x);
    for (uint32_t k = 0; k < r->inputs; k++)
        if (r->need[k]) wanted[n++] = x[k];
    if (n == 0 || lg_vjp(r->tape, &y, &r->g, 1, wanted, n, found) != LG_OK) return;
    for (uint32_t k = r->inputs; k-- > 0;)
        if (r->need[k]) r->out[k] = found[--n];
}

static lg_var lie_jvp(const lg_forward *f) {
    lg_var x[LG_K_LIE_INPUTS], moving[LG_K_LIE_INPUTS], direction[LG_K_LIE_INPUTS], tangent = LG_NONE;
    size_t n = 0;
    lg_var y = build(f->tape, f->attr, f->in, f->inputs, x);
    for (uint32_t k = 0; k < f->inputs; k++)
        if (!lg_is_none(f->tangents[k])) {
            moving[n] = x[k];
            direction[n++] = f->tangents[k];
        }
    return lg_jvp(f->tape, &y, 1, moving, direction, n, &tangent) == LG_OK ? tangent : LG_NONE;
}

/* ---- generated C ---- */

static void lie_c(lg_c *c, const lg_evaluation *e) {
    const size_t rows = lg_shape_count(*e->in[0]) / 3;
    switch ((lg_k_lie)e->attr->i[0]) {
    case LG_K_SO3_EXP:
        lg_c_call(c, "so3_exp(%zu, %u, $0, $1, $y)", rows, columns_of(e->shape));
        break;
    case LG_K_SO3_DEXP:
        lg_c_call(c, "so3_dexp(%zu, $0, $1, $y)", rows);
        break;
    case LG_K_SE3_ACT:
        lg_c_call(c, "se3_act(%zu, $0, $1, $2, $3, $y)", rows);
        break;
    case LG_K_SO3_DEXPINV:
        lg_c_call(c, "so3_dexpinv(%zu, $0, $1, $y)", rows);
        break;
    case LG_K_SE3_DEXPINV:
        lg_c_call(c, "se3_dexpinv(%zu, $0, $1, $2, $3, $y)", rows);
        break;
    case LG_K_LIE_MAPS:
        break;
    }
}

const lg_op lg_op_lie = {LG_OP("lie", 0, 2, LG_K_LIE_INPUTS, lie_shape, lie_forward, lie_vjp, lie_jvp),
                         .write_c = lie_c, .rows = lg_rows_each};

static lg_var apply(lg_tape *tape, lg_k_lie map, const lg_var *in) {
    const lg_attr attr = {.i = {map, 0, 0, 0}};
    return lg_record(tape, &lg_op_lie, in, maps[map].inputs, &attr);
}

lg_var lg_so3_exp_rows(lg_tape *tape, lg_var u, lg_var x) {
    return apply(tape, LG_K_SO3_EXP, (lg_var[]){u, x});
}

lg_var lg_so3_dexp_rows(lg_tape *tape, lg_var u, lg_var v) {
    return apply(tape, LG_K_SO3_DEXP, (lg_var[]){u, v});
}

lg_var lg_so3_dexpinv_rows(lg_tape *tape, lg_var u, lg_var v) {
    return apply(tape, LG_K_SO3_DEXPINV, (lg_var[]){u, v});
}

lg_var lg_se3_act_rows(lg_tape *tape, lg_var u, lg_var v, lg_var q, lg_var p) {
    return apply(tape, LG_K_SE3_ACT, (lg_var[]){u, v, q, p});
}

lg_var lg_se3_dexpinv_rows(lg_tape *tape, lg_var A, lg_var a, lg_var B, lg_var b) {
    return apply(tape, LG_K_SE3_DEXPINV, (lg_var[]){A, a, B, b});
}
