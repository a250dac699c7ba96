/* Gradient-check cases of the taped integrators. For every scheme in the library's table: two steps,
 * differentiated with respect to the start and to the parameters of the field, and one step, differentiated
 * also with respect to step size, time and input, which differ between the rows of the batch. On T*S^2 the
 * start is moved along the manifold by SE(3). Then one step on every space, from starts that need not lie on
 * the manifold, and the maps of the spaces. */
#include <stdio.h>
#include <string.h>

#include "gradcheck/table.h"
#include "liegrad/geometry.h"
#include "liegrad/ops.h"
#include "liegrad/taped.h"

enum { BATCH = 2, COPIES = 2, STEPS = 2 };

typedef lg_status (*pair_fn)(lg_tape *, const lg_space *, const lg_var *, const lg_var *, lg_var *);
typedef struct settings {
    lg_scheme scheme;
    bool rows;              /* one step; the last variables are h (B, 1), t (B, 1) and input (B, 3) */
    lg_space_factor factor; /* the space, for build_on_space */
    pair_fn pair;           /* the map, for build_pair */
} settings;

/* Four points (q, p) of T*S^2: |q| = 1, q.p = 0. */
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

/* Exchanges the two copies in x (B, 2, 3). */
static lg_var exchanged(lg_tape *tape, lg_var x) {
    lg_var halves[2] = {lg_slice(tape, x, 1, 1, 1), lg_slice(tape, x, 1, 0, 1)};
    return lg_concat(tape, halves, 2, 1);
}

/* Adds to each vector of `part`, (B, k, 3) or (B, 3), the input, and the time if it varies over the rows. */
static lg_var driven(lg_tape *tape, lg_taped_time t, lg_var input, lg_var part) {
    const bool tall = lg_var_shape(tape, part).rank == 3;
    if (lg_taped_time_varies(t)) {
        lg_var rows = lg_taped_time_rows(tape, t, BATCH);
        part = lg_add(tape, part, tall ? lg_reshape(tape, rows, lg_shape3(BATCH, 1, 1)) : rows);
    }
    if (lg_is_none(input)) return part;
    return lg_add(tape, part, tall ? lg_reshape(tape, input, lg_shape3(BATCH, 1, 3)) : input);
}

/* xi = a q + q' x p, eta = p / (1 + t) + c q', where q' is the q of the other copy; driven() then adds input
 * and time to eta. If the time varies over the rows, t in the fraction is only its constant part t.value.
 * `user` points to the variables a and c, of shape (3). */
static lg_status field(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                       lg_var *out) {
    const lg_var *parameters = user;
    lg_var neighbour = exchanged(tape, y[0]);
    out[0] = lg_add(tape, lg_mul(tape, parameters[0], y[0]), lg_cross(tape, neighbour, y[1]));
    lg_var damped = lg_scale(tape, y[1], 1.0 / (1.0 + t.value));
    out[1] = driven(tape, t, input, lg_add(tape, damped, lg_mul(tape, parameters[1], neighbour)));
    return lg_tape_status(tape);
}

/* The same formulas on R^6 x R^6. */
static lg_status flat_field(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                            lg_var *out) {
    lg_var in[2], f[2] = {LG_NONE, LG_NONE};
    for (int i = 0; i < 2; i++) in[i] = lg_reshape(tape, y[i], lg_shape3(BATCH, COPIES, 3));
    lg_status status = field(user, tape, t, in, input, f);
    for (int i = 0; i < 2 && status == LG_OK; i++) out[i] = lg_reshape(tape, f[i], lg_shape2(BATCH, 6));
    return status;
}

static lg_status force(void *user, lg_tape *tape, lg_taped_time t, lg_var q, lg_var input, lg_var *out) {
    const lg_var *parameters = user;
    lg_var pull = lg_add(tape, lg_mul(tape, parameters[0], q), lg_pow(tape, q, 3.0));
    *out = driven(tape, t, input, lg_neg(tape, pull));
    return lg_tape_status(tape);
}
static lg_status velocity(void *user, lg_tape *tape, lg_taped_time t, lg_var p, lg_var input, lg_var *out) {
    const lg_var *parameters = user;
    (void)t, (void)input;
    *out = lg_mul(tape, p, lg_add_scalar(tape, lg_square(tape, parameters[1]), 1.0));
    return lg_tape_status(tape);
}

/* The two parts q and p of all copies, concatenated along the last axis. */
static lg_var joined(lg_tape *tape, lg_status status, const lg_var *parts) {
    return status == LG_OK ? lg_concat(tape, parts, 2, -1) : LG_NONE;
}

/* `steps` steps of size 0.2 from t = 0.1. If s->rows, one step with the variables rows = {h, t, input}. */
static lg_status advance(const settings *s, lg_tape *tape, const lg_taped_ode *ode, size_t steps,
                         const lg_var *rows, const lg_var *y, lg_var *out) {
    if (!s->rows) return lg_taped_integrate(tape, &s->scheme, ode, 0.1, 0.2, steps, steps, y, out);
    const lg_taped_interval over = {.t = {.rows = rows[1]}, .h_rows = rows[0], .input = rows[2]};
    return lg_taped_step(tape, &s->scheme, ode, &over, y, out);
}

static lg_var integrated(const settings *s, lg_tape *tape, lg_taped_ode *ode, const lg_space_factor *factors,
                         size_t count, const lg_var *y, const lg_var *rows) {
    const lg_space_factor sphere = {LG_SPACE_TS2, COPIES};
    lg_var out[2] = {LG_NONE, LG_NONE};
    lg_status status = lg_space_init(&ode->space, factors, count);
    if (status == LG_OK && s->scheme.project) status = lg_space_init(&ode->manifold, &sphere, 1);
    if (status == LG_OK) status = advance(s, tape, ode, STEPS, rows, y, out);
    if (status != LG_OK) (void)lg_tape_fail(tape, status, s->scheme.name, "the integration failed");
    return joined(tape, status, out);
}

/* Variables x: y (B, k, 6), a (3), c (3). */
static lg_var build_on_manifold(const void *user, lg_tape *tape, const lg_var *x) {
    lg_var y[2] = {lg_slice(tape, x[0], 2, 0, 3), lg_slice(tape, x[0], 2, 3, 3)},
           parameters[2] = {x[1], x[2]};
    lg_taped_ode ode = {.field = field, .user = parameters};
    return integrated(user, tape, &ode, &(lg_space_factor){LG_SPACE_TS2, COPIES}, 1, y, x + 3);
}

/* Variables x: q (B, 6), p (B, 6), a (3), c (3). */
static lg_var build_ambient(const void *user, lg_tape *tape, const lg_var *x) {
    lg_var parameters[2] = {x[2], x[3]};
    lg_taped_ode ode = {.field = flat_field, .user = parameters};
    return integrated(user, tape, &ode, (const lg_space_factor[]){{LG_SPACE_RN, 6}, {LG_SPACE_RN, 6}}, 2, x,
                      x + 4);
}

static lg_var build_splitting(const void *user, lg_tape *tape, const lg_var *x) {
    lg_var parameters[2] = {x[2], x[3]};
    lg_taped_ode ode = {.force = force, .velocity = velocity, .user = parameters};
    return integrated(user, tape, &ode, (const lg_space_factor[]){{LG_SPACE_RN, 3}, {LG_SPACE_RN, 3}}, 2, x,
                      x + 4);
}

/* ---- any space ---- */

/* The first three numbers of every copy in a part; a part (B, n) of R^n is returned whole. */
static lg_var vector_of(lg_tape *tape, lg_var part) {
    return lg_var_shape(tape, part).rank == 3 ? lg_slice(tape, part, 2, 0, 3) : part;
}

/* The field c x + x_next x (elementwise), x the vectors of a part, x_next the vectors of the next part. */
typedef struct mixture {
    size_t parts;
    lg_var c; /* (3) */
} mixture;

static lg_status mix(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input, lg_var *out) {
    const mixture *own = user;
    for (size_t p = 0; p < own->parts; p++) {
        lg_var x = vector_of(tape, y[p]), next = vector_of(tape, y[(p + 1) % own->parts]);
        out[p] = driven(tape, t, input, lg_add(tape, lg_mul(tape, own->c, x), lg_mul(tape, next, x)));
    }
    return lg_tape_status(tape);
}

/* Variables x: y (B, dim), c (3). */
static lg_var build_on_space(const void *user, lg_tape *tape, const lg_var *x) {
    const settings *s = user;
    lg_var y[LG_TAPED_MAX_PARTS];
    mixture own = {.c = x[1]};
    lg_taped_ode ode = {.field = mix, .user = &own};
    lg_status status = lg_space_init(&ode.space, &s->factor, 1);
    own.parts = lg_taped_parts(&ode.space);
    if (status == LG_OK) status = lg_taped_split(tape, &ode.space, x[0], y);
    if (status == LG_OK) status = advance(s, tape, &ode, 1, x + 2, y, y);
    if (status != LG_OK) return lg_tape_fail(tape, status, s->scheme.name, "the step failed");
    return lg_taped_join(tape, &ode.space, y);
}

static lg_status dexpinv_exact(lg_tape *tape, const lg_space *space, const lg_var *a, const lg_var *b,
                               lg_var *out) {
    return lg_taped_dexpinv(tape, space, LG_DEXPINV_EXACT, a, b, out);
}
static lg_status dexpinv_truncated(lg_tape *tape, const lg_space *space, const lg_var *a, const lg_var *b,
                                   lg_var *out) {
    return lg_taped_dexpinv(tape, space, 4, a, b, out);
}

/* Variables x: the parts u, v (B, k, 3) of the map's first argument, then the two parts of its second one. */
static lg_var build_pair(const void *user, lg_tape *tape, const lg_var *x) {
    const settings *s = user;
    lg_space space;
    lg_var out[2] = {LG_NONE, LG_NONE};
    lg_status status = lg_space_init(&space, &(lg_space_factor){LG_SPACE_TS2, COPIES}, 1);
    if (status == LG_OK) status = s->pair(tape, &space, x, x + 2, out);
    return joined(tape, status, out);
}

/* ---- the cases ---- */

static const double no_angle[BATCH * COPIES * 3] = {0};

#define SPHERES                                                                                              \
    { .shape = S3(BATCH, COPIES, 6), .values = starts, .algebra = BATCH * COPIES * 6 }
#define VECTORS                                                                                              \
    { .shape = S3(BATCH, COPIES, 3) }
#define ON_MANIFOLD                                                                                          \
    .build = build_on_manifold, .perturb = move, .tangent = tangent,                                         \
    INPUTS(SPHERES, {.shape = S1(3)}, {.shape = S1(3)})
#define ON_SPACE(dim) .build = build_on_space, INPUTS({.shape = S2(BATCH, dim)}, {.shape = S1(3)})
#define PAIR(...)     .build = build_pair, INPUTS(__VA_ARGS__, __VA_ARGS__, VECTORS, VECTORS)

/* Step size, time and input: the last variables of the one-step cases. */
static const lg_gradcheck_argument of_a_step[] = {
    {.shape = S2(BATCH, 1), .low = 0.1, .high = 0.3},
    {.shape = S2(BATCH, 1)},
    {.shape = S2(BATCH, 3)},
};

/* The functions with which schemes are checked; function_of chooses one. */
static const lg_gradcheck_function on_manifold = {ON_MANIFOLD}, on_group = {ON_SPACE(12)};
static const lg_gradcheck_function ambient = {
    .build = build_ambient,
    INPUTS({.shape = S2(BATCH, 6)}, {.shape = S2(BATCH, 6)}, {.shape = S1(3)}, {.shape = S1(3)})};
static const lg_gradcheck_function projected = {.build = build_ambient,
                                                INPUTS({.shape = S2(BATCH, 6), .low = 0.4, .high = 0.9},
                                                       {.shape = S2(BATCH, 6)}, {.shape = S1(3)},
                                                       {.shape = S1(3)})};
static const lg_gradcheck_function split = {
    .build = build_splitting,
    INPUTS({.shape = S2(BATCH, 3)}, {.shape = S2(BATCH, 3)}, {.shape = S1(3)}, {.shape = S1(3)})};

typedef struct extra_row {
    lg_gradcheck_function function;
    const char *scheme;
    int truncation;
    lg_space_factor factor;
    pair_fn pair;
} extra_row;

static const extra_row extras[] = {
    {{.name = "integrator rkmk4, dexpinv truncated", ON_MANIFOLD}, "rkmk4", .truncation = 2},
    {{.name = "integrator rkmk4 on R^n", ON_SPACE(3)}, "rkmk4", .factor = {LG_SPACE_RN, 3}},
    {{.name = "integrator rkmk4 on T*S^2, anywhere", ON_SPACE(12)}, "rkmk4", .factor = {LG_SPACE_TS2, 2}},
    {{.name = "integrator rkmk4 on SO(3)", ON_SPACE(18)}, "rkmk4", .factor = {LG_SPACE_SO3, 2}},
    {{.name = "integrator rkmk4 on SE(3)", ON_SPACE(24)}, "rkmk4", .factor = {LG_SPACE_SE3, 2}},
    {{.name = "integrator rkmk4 on so(3)*", ON_SPACE(6)}, "rkmk4", .factor = {LG_SPACE_SO3_DUAL, 2}},
    {{.name = "integrator rkmk4 on se(3)*", ON_SPACE(12)}, "rkmk4", .factor = {LG_SPACE_SE3_DUAL, 2}},
    {{.name = "action of SE(3)", PAIR(VECTORS)}, .pair = lg_taped_act},
    {{.name = "action of SE(3) at the identity", PAIR({.shape = S3(BATCH, COPIES, 3), .values = no_angle})},
     .pair = lg_taped_act},
    {{.name = "generator of SE(3)", PAIR(VECTORS)}, .pair = lg_taped_generator},
    {{.name = "dexpinv of se(3)", PAIR(VECTORS)}, .pair = dexpinv_exact},
    {{.name = "dexpinv of se(3) at zero", PAIR({.shape = S3(BATCH, COPIES, 3), .values = no_angle})},
     .pair = dexpinv_exact},
    {{.name = "dexpinv of se(3), truncated", PAIR(VECTORS)}, .pair = dexpinv_truncated},
};

/* Memory of one case: its name, settings and arguments. */
typedef struct made_row {
    char name[64];
    settings settings;
    lg_gradcheck_argument arguments[LG_GRADCHECK_MAX_INPUTS];
} made_row;

static const lg_gradcheck_function *function_of(const lg_scheme *scheme) {
    if (scheme->kind == LG_SCHEME_SPLITTING) return &split;
    if (scheme->kind == LG_SCHEME_SLGI) return &on_group;
    if (scheme->project) return &projected;
    return scheme->ambient || scheme->kind == LG_SCHEME_IMPLICIT ? &ambient : &on_manifold;
}

static lg_gradcheck_case complete(const lg_gradcheck_function *function, made_row *own) {
    const lg_scheme_kind kind = own->settings.scheme.kind;
    lg_gradcheck_case row = {.function = *function};
    if (kind == LG_SCHEME_IMPLICIT || kind == LG_SCHEME_SLGI) row.no_program = "solves equations";
    row.function.name = own->name;
    row.function.user = &own->settings;
    return row;
}

static lg_gradcheck_case row_of_scheme(const lg_scheme *scheme, made_row *own) {
    own->settings = (settings){.scheme = *scheme, .factor = {LG_SPACE_SE3, 1}};
    (void)snprintf(own->name, sizeof own->name, "integrator %s", scheme->name);
    return complete(function_of(scheme), own);
}

static lg_gradcheck_case row_of_step(const lg_scheme *scheme, made_row *own) {
    lg_gradcheck_case row = row_of_scheme(scheme, own);
    const uint32_t known = row.function.inputs;
    own->settings.rows = true;
    (void)snprintf(own->name, sizeof own->name, "integrator %s, step, time, input", scheme->name);
    memcpy(own->arguments, row.function.arguments, known * sizeof *own->arguments);
    memcpy(own->arguments + known, of_a_step, sizeof of_a_step);
    row.function.arguments = own->arguments;
    row.function.inputs = known + LG_COUNT(of_a_step);
    return row;
}

static lg_gradcheck_case row_of_extra(const extra_row *extra, made_row *own) {
    own->settings = (settings){.factor = extra->factor, .pair = extra->pair};
    if (extra->scheme != NULL) own->settings.scheme = *lg_scheme_find(extra->scheme);
    if (extra->truncation != 0) own->settings.scheme.dexpinv = extra->truncation;
    (void)snprintf(own->name, sizeof own->name, "%s", extra->function.name);
    return complete(&extra->function, own);
}

/* The cases are made in the first call and kept until the program ends. */
const lg_gradcheck_case *lg_gradcheck_integrators(size_t *count) {
    static lg_gradcheck_case *rows;
    static made_row *own;
    static size_t used;
    if (rows == NULL) {
        const size_t most = 2 * lg_scheme_count() + LG_COUNT(extras);
        rows = lg_gradcheck_alloc(most, sizeof *rows);
        own = lg_gradcheck_alloc(most, sizeof *own);
        for (size_t i = 0; i < lg_scheme_count(); i++) {
            const lg_scheme *scheme = lg_scheme_at(i);
            if (scheme->kind == LG_SCHEME_VARIATIONAL) continue; /* cannot be recorded */
            rows[used] = row_of_scheme(scheme, &own[used]);
            used++;
            rows[used] = row_of_step(scheme, &own[used]);
            used++;
        }
        for (size_t i = 0; i < LG_COUNT(extras); i++, used++)
            rows[used] = row_of_extra(&extras[i], &own[used]);
    }
    *count = used;
    return rows;
}
