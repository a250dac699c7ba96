/* Taped integrators: two steps of every scheme, with respect to the start, which is moved along the manifold
 * by SE(3), and to the parameters of the field. */
#include "lg-gradcheck/tables.h"

#include <string.h>

#include "common/app.h"
#include "liegrad/geometry.h"
#include "liegrad/taped.h"

enum { BATCH = 2, COPIES = 2, STEPS = 2 };

typedef struct settings {
    const char *scheme;
    bool truncated; /* dexpinv after ad^2 */
} settings;

/* (q, p) of T*S^2, four of them: |q| = 1, q.p = 0 */
static const double starts[BATCH * COPIES * 6] = {
    2.0 / 3, -1.0 / 3, 2.0 / 3, 0.5, 1.0,  0.0, 0.0,      0.6,     0.8,     0.7, -0.8, 0.6,
    0.6,     0.0,      -0.8,    0.8, -0.5, 0.6, -1.0 / 3, 2.0 / 3, 2.0 / 3, 0.0, 0.9,  -0.9,
};

static lg_status move(const void *user, uint32_t argument, const double *y, const double *d, double h,
                      double *moved) {
    (void)user, (void)argument;
    for (int i = 0; i < BATCH * COPIES; i++) {
        double a[6];
        for (int j = 0; j < 6; j++) a[j] = h * d[6 * i + j];
        lg_se3_exp_act(a, y + 6 * i, moved + 6 * i);
    }
    return LG_OK;
}
static lg_status tangent(const void *user, uint32_t argument, const double *y, const double *d, double *dy) {
    (void)user, (void)argument;
    for (int i = 0; i < BATCH * COPIES; i++) lg_se3_generator(d + 6 * i, y + 6 * i, dy + 6 * i);
    return LG_OK;
}

/* The other copy of the pair. */
static lg_var exchanged(lg_tape *tape, lg_var x) {
    lg_var halves[2] = {lg_slice(tape, x, 1, 1, 1), lg_slice(tape, x, 1, 0, 1)};
    return lg_concat(tape, halves, 2, 1);
}

/* xi = a q + q' x p, eta = p / (1 + t) + c q' with the neighbour q'; user: the variables a and c, of shape
 * (3). */
static lg_status field(void *user, lg_tape *tape, double t, const lg_var *y, lg_var *out) {
    const lg_var *parameters = user;
    lg_var neighbour = exchanged(tape, y[0]);
    out[0] = lg_add(tape, lg_mul(tape, parameters[0], y[0]), lg_cross(tape, neighbour, y[1]));
    out[1] = lg_add(tape, lg_scale(tape, y[1], 1.0 / (1.0 + t)), lg_mul(tape, parameters[1], neighbour));
    return lg_tape_status(tape);
}

/* The same on R^6 x R^6. */
static lg_status flat_field(void *user, lg_tape *tape, double t, const lg_var *y, lg_var *out) {
    lg_var in[2], f[2] = {LG_NONE, LG_NONE};
    for (int i = 0; i < 2; i++) in[i] = lg_reshape(tape, y[i], lg_shape3(BATCH, COPIES, 3));
    lg_status status = field(user, tape, t, in, f);
    for (int i = 0; i < 2 && status == LG_OK; i++) out[i] = lg_reshape(tape, f[i], lg_shape2(BATCH, 6));
    return status;
}

static lg_status force(void *user, lg_tape *tape, double t, lg_var q, lg_var *out) {
    const lg_var *parameters = user;
    (void)t;
    *out = lg_neg(tape, lg_add(tape, lg_mul(tape, parameters[0], q), lg_pow(tape, q, 3.0)));
    return lg_tape_status(tape);
}
static lg_status velocity(void *user, lg_tape *tape, double t, lg_var p, lg_var *out) {
    const lg_var *parameters = user;
    (void)t;
    *out = lg_mul(tape, p, lg_shift(tape, lg_square(tape, parameters[1]), 1.0));
    return lg_tape_status(tape);
}

/* q and p of all copies, side by side */
static lg_var joined(lg_tape *tape, lg_status status, const lg_var *parts) {
    return status == LG_OK ? lg_concat(tape, parts, 2, -1) : LG_NONE;
}

static lg_var integrated(const settings *s, lg_tape *tape, lg_taped_ode *ode, const lg_space_factor *factors,
                         size_t count, const lg_var *y) {
    lg_scheme scheme = *lg_scheme_find(s->scheme);
    lg_var out[2] = {LG_NONE, LG_NONE};
    if (s->truncated) scheme.dexpinv = 2;
    lg_status status = lg_space_init(&ode->space, factors, count);
    if (status == LG_OK) status = lg_taped_integrate(tape, &scheme, ode, 0.1, 0.2, STEPS, STEPS, y, out);
    if (status != LG_OK) (void)lg_tape_fail(tape, status, s->scheme, "the integration failed");
    return joined(tape, status, out);
}

/* x: y (B, k, 6), a (3), c (3) */
static lg_var build_on_manifold(const void *user, lg_tape *tape, const lg_var *x) {
    lg_var y[2] = {lg_slice(tape, x[0], 2, 0, 3), lg_slice(tape, x[0], 2, 3, 3)},
           parameters[2] = {x[1], x[2]};
    lg_taped_ode ode = {.field = field, .user = parameters};
    return integrated(user, tape, &ode, &(lg_space_factor){LG_SPACE_TS2, COPIES}, 1, y);
}

/* x: q (B, 6), p (B, 6), a, c */
static lg_var build_ambient(const void *user, lg_tape *tape, const lg_var *x) {
    lg_var parameters[2] = {x[2], x[3]};
    lg_taped_ode ode = {.field = flat_field, .user = parameters};
    return integrated(user, tape, &ode, (const lg_space_factor[]){{LG_SPACE_RN, 6}, {LG_SPACE_RN, 6}}, 2, x);
}

static lg_var build_splitting(const void *user, lg_tape *tape, const lg_var *x) {
    lg_var parameters[2] = {x[2], x[3]};
    lg_taped_ode ode = {.force = force, .velocity = velocity, .user = parameters};
    return integrated(user, tape, &ode, (const lg_space_factor[]){{LG_SPACE_RN, 3}, {LG_SPACE_RN, 3}}, 2, x);
}

/* x: u, v of (B, k, 3), then the second argument in two parts */
static lg_var build_act(const void *user, lg_tape *tape, const lg_var *x) {
    lg_space space;
    lg_var out[2] = {LG_NONE, LG_NONE};
    lg_status status = lg_space_init(&space, &(lg_space_factor){LG_SPACE_TS2, COPIES}, 1);
    (void)user;
    if (status == LG_OK) status = lg_taped_act(tape, &space, x, x + 2, out);
    return joined(tape, status, out);
}
static lg_var build_dexpinv(const void *user, lg_tape *tape, const lg_var *x) {
    lg_space space;
    lg_var out[2] = {LG_NONE, LG_NONE};
    lg_status status = lg_space_init(&space, &(lg_space_factor){LG_SPACE_TS2, COPIES}, 1);
    if (status == LG_OK) status = lg_taped_dexpinv(tape, &space, *(const int *)user, x, x + 2, out);
    return joined(tape, status, out);
}

#define ON_MANIFOLD(label, ...)                                                                              \
    {                                                                                                        \
        .function = {                                                                                        \
            .name = "integrator " label,                                                                     \
            .build = build_on_manifold,                                                                      \
            .perturb = move,                                                                                 \
            .tangent = tangent,                                                                              \
            .user = &(const settings){__VA_ARGS__},                                                          \
            INPUTS({.shape = S3(BATCH, COPIES, 6), .values = starts, .algebra = BATCH * COPIES * 6},         \
                   {.shape = S1(3)}, {.shape = S1(3)})                                                       \
        }                                                                                                    \
    }
#define AMBIENT(label, builder, n, parameters)                                                               \
    {                                                                                                        \
        .function = {                                                                                        \
            .name = "integrator " label,                                                                     \
            .build = builder,                                                                                \
            .user = &(const settings){label, false},                                                         \
            INPUTS({.shape = S2(BATCH, n)}, {.shape = S2(BATCH, n)}, {.shape = S1(parameters)},              \
                   {.shape = S1(parameters)})                                                                \
        }                                                                                                    \
    }
#define PAIR(label, builder, data, ...)                                                                      \
    {                                                                                                        \
        .function = {                                                                                        \
            .name = label,                                                                                   \
            .build = builder,                                                                                \
            .user = data,                                                                                    \
            INPUTS(__VA_ARGS__, __VA_ARGS__, {.shape = S3(BATCH, COPIES, 3)},                                \
                   {.shape = S3(BATCH, COPIES, 3)})                                                          \
        }                                                                                                    \
    }

static const int closed_form = LG_DEXPINV_EXACT, truncated = 4;
static const double no_angle[BATCH * COPIES * 3] = {0};

static const lg_gradcheck_case rows[] = {
    ON_MANIFOLD("lie-euler", "lie-euler", false),
    ON_MANIFOLD("rkmk4", "rkmk4", false),
    ON_MANIFOLD("rkmk4, dexpinv truncated", "rkmk4", true),
    ON_MANIFOLD("rkmk5", "rkmk5", false),
    ON_MANIFOLD("rkmk54", "rkmk54", false),
    ON_MANIFOLD("cf4", "cf4", false),
    AMBIENT("euler", build_ambient, 6, 3),
    AMBIENT("rk4", build_ambient, 6, 3),
    AMBIENT("dp54", build_ambient, 6, 3),
    AMBIENT("stormer-verlet", build_splitting, 3, 3),
    PAIR("action of SE(3)", build_act, NULL, {.shape = S3(BATCH, COPIES, 3)}),
    PAIR("action of SE(3) at the identity", build_act, NULL,
         {.shape = S3(BATCH, COPIES, 3), .values = no_angle}),
    PAIR("dexpinv of se(3)", build_dexpinv, &closed_form, {.shape = S3(BATCH, COPIES, 3)}),
    PAIR("dexpinv of se(3) at zero", build_dexpinv, &closed_form,
         {.shape = S3(BATCH, COPIES, 3), .values = no_angle}),
    PAIR("dexpinv of se(3), truncated", build_dexpinv, &truncated, {.shape = S3(BATCH, COPIES, 3)}),
};

const lg_gradcheck_case *integrator_rows(size_t *count) {
    *count = APP_COUNT(rows);
    return rows;
}
