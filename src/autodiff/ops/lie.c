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

static const lg_c_fragment c_vectors = {
    .text = LG_C(
        static real dot3(const real *a, const real *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

        static void cross3(const real *a, const real *b, real *out) {
            out[0] = a[1] * b[2] - a[2] * b[1];
            out[1] = a[2] * b[0] - a[0] * b[2];
            out[2] = a[0] * b[1] - a[1] * b[0];
        })};

static const lg_c_fragment c_so3 = {
    .comment = "out = b + g1 u x b + g2 u x (u x b); out may be b.",
    .text = LG_C(static void so3_function(real g1, real g2, const real *u, const real *b, real *out) {
        real ub[3];
        real uub[3];
        cross3(u, b, ub);
        cross3(u, ub, uub);
        for (int i = 0; i < 3; i++) out[i] = b[i] + (g1 * ub[i] + g2 * uub[i]);
    }),
    .needs = {&c_vectors}};

/* The Stumpff functions c_2 and c_3 for 0 <= w <= 4 by the series sum_i (-w)^i/(k + 2i)!, with as many terms
 * as the type can resolve. */
static const lg_c_fragment c_so3_coefficients = {
    .comment = "c[k] = c_k(w), k = 1, 2, 3: sin(x)/x, (1 - cos(x))/x^2, (x - sin(x))/x^3, x = sqrt(w)",
    .text =
        LG_C(static const real stumpff_2[12] = {REAL(0.5), REAL(0.041666666666666667),
                                                REAL(0.0013888888888888889), REAL(2.4801587301587302e-5),
                                                REAL(2.7557319223985891e-7), REAL(2.0876756987868099e-9),
                                                REAL(1.1470745597729725e-11), REAL(4.7794773323873853e-14),
                                                REAL(1.5619206968586226e-16), REAL(4.1103176233121649e-19),
                                                REAL(8.8967913924505733e-22), REAL(1.6117375710961183e-24)};
             static const real stumpff_3[12] = {REAL(0.16666666666666667), REAL(0.0083333333333333333),
                                                REAL(0.00019841269841269841), REAL(2.7557319223985891e-6),
                                                REAL(2.5052108385441719e-8), REAL(1.6059043836821615e-10),
                                                REAL(7.6471637318198165e-13), REAL(2.8114572543455208e-15),
                                                REAL(8.2206352466243297e-18), REAL(1.9572941063391261e-20),
                                                REAL(3.868170170630684e-23), REAL(6.4469502844843734e-26)};
             static void so3_coefficients(real w, real *c) {
                 if (w <= REAL(4.0)) {
                     real even = REAL(0.0);
                     real odd = REAL(0.0);
                     for (int i = sizeof w == sizeof(float) ? 6 : 11; i >= 0; i--) {
                         even = stumpff_2[i] - w * even;
                         odd = stumpff_3[i] - w * odd;
                     }
                     c[1] = REAL(1.0) - w * odd;
                     c[2] = even;
                     c[3] = odd;
                 } else {
                     const real x = SQRT(w);
                     const real half = SIN(REAL(0.5) * x);
                     c[1] = SIN(x) / x;
                     c[2] = REAL(2.0) * half * half / w;
                     c[3] = (REAL(1.0) - c[1]) / w;
                 }
             })};

static const lg_c_fragment c_so3_exp = {
    .comment = "y = exp(u) x for n rows; x: vectors (columns 1), or matrices by rows (columns 3)",
    .text = LG_C(static NOINLINE void so3_exp(int n, int columns, const real *u, const real *x, real *y) {
        for (int r = 0; r < n; r++, u += 3, x += 3 * columns, y += 3 * columns) {
            real c[4];
            real b[3];
            so3_coefficients(dot3(u, u), c);
            for (int j = 0; j < columns; j++) {
                for (int i = 0; i < 3; i++) b[i] = x[i * columns + j];
                so3_function(c[1], c[2], u, b, b);
                for (int i = 0; i < 3; i++) y[i * columns + j] = b[i];
            }
        }
    }),
    .needs = {&c_so3, &c_so3_coefficients}};

static const lg_c_fragment c_so3_dexp = {
    .comment = "y = dexp_u(v) for n rows",
    .text = LG_C(static NOINLINE void so3_dexp(int n, const real *u, const real *v, real *y) {
        for (int r = 0; r < n; r++, u += 3, v += 3, y += 3) {
            real c[4];
            so3_coefficients(dot3(u, u), c);
            so3_function(c[2], c[3], u, v, y);
        }
    }),
    .needs = {&c_so3, &c_so3_coefficients}};

static const lg_c_fragment c_se3_act = {
    .comment = "The second half of exp(u, v) . (q, p) for n rows: R p + r x R q, R = exp(u), r = dexp_u(v)",
    .text = LG_C(static NOINLINE void se3_act(int n, const real *u, const real *v, const real *q,
                                              const real *p, real *y) {
        for (int i = 0; i < n; i++, u += 3, v += 3, q += 3, p += 3, y += 3) {
            real c[4];
            real r[3];
            real turned[3];
            real moved[3];
            so3_coefficients(dot3(u, u), c);
            so3_function(c[2], c[3], u, v, r);
            so3_function(c[1], c[2], u, q, turned);
            cross3(r, turned, moved);
            so3_function(c[1], c[2], u, p, y);
            for (int k = 0; k < 3; k++) y[k] += moved[k];
        }
    }),
    .needs = {&c_so3, &c_so3_coefficients}};

static const lg_c_fragment c_so3_dexpinv = {
    .comment = "y = dexp_a^-1(b) for n rows",
    .text = LG_C(static NOINLINE void so3_dexpinv(int n, const real *a, const real *b, real *y) {
        for (int r = 0; r < n; r++, a += 3, b += 3, y += 3)
            so3_function(REAL(-0.5), dexpinv_coef(dot3(a, a), 0), a, b, y);
    }),
    .needs = {&c_so3, &lg_c_dexpinv}};

static const lg_c_fragment c_se3_dexpinv = {
    .comment =
        "The second half of dexp_(A, a)^-1(B, b) for n rows: b - m/2 + g2 (a x (A x B) + A x m) + A.a 2 "
        "g2' A x (A x B),\nm = a x B + A x b",
    .text = LG_C(static NOINLINE void se3_dexpinv(int n, const real *A, const real *a, const real *B,
                                                  const real *b, real *y) {
        for (int r = 0; r < n; r++, A += 3, a += 3, B += 3, b += 3, y += 3) {
            const real w = dot3(A, A);
            const real g = dexpinv_coef(w, 0);
            const real slope = REAL(2.0) * dot3(A, a) * dexpinv_coef(w, 1);
            real AB[3];
            real AAB[3];
            real m[3];
            real t[3];
            real part[3];
            cross3(A, B, AB);
            cross3(A, AB, AAB);
            cross3(a, B, m);
            cross3(A, b, part);
            for (int i = 0; i < 3; i++) m[i] += part[i];
            cross3(a, AB, t);
            cross3(A, m, part);
            for (int i = 0; i < 3; i++)
                y[i] = (b[i] - REAL(0.5) * m[i]) + (slope * AAB[i] + g * (t[i] + part[i]));
        }
    }),
    .needs = {&c_vectors, &lg_c_dexpinv}};

static void lie_c(lg_c *c, const lg_evaluation *e) {
    const size_t rows = lg_shape_count(*e->in[0]) / 3;
    switch ((lg_k_lie)e->attr->i[0]) {
    case LG_K_SO3_EXP:
        lg_c_call(c, &c_so3_exp, "so3_exp(%zu, %u, $0, $1, $y)", rows, columns_of(e->shape));
        break;
    case LG_K_SO3_DEXP:
        lg_c_call(c, &c_so3_dexp, "so3_dexp(%zu, $0, $1, $y)", rows);
        break;
    case LG_K_SE3_ACT:
        lg_c_call(c, &c_se3_act, "se3_act(%zu, $0, $1, $2, $3, $y)", rows);
        break;
    case LG_K_SO3_DEXPINV:
        lg_c_call(c, &c_so3_dexpinv, "so3_dexpinv(%zu, $0, $1, $y)", rows);
        break;
    case LG_K_SE3_DEXPINV:
        lg_c_call(c, &c_se3_dexpinv, "se3_dexpinv(%zu, $0, $1, $2, $3, $y)", rows);
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
