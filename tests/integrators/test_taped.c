/* Compares the taped interpreter with the plain one for every scheme of the table and every kind of space;
 * also which values it reuses and what it refuses. lg-gradcheck compares the derivatives of every scheme with
 * differences. */
#include "support/narrow_tape.h"
#include "support/fixtures.h"

#include "autodiff/ops/op.h"
#include "autodiff/tape/tape_internal.h"
#include "integrators/taped_internal.h"

enum { BATCH = 3, STEPS = 4, EVERY = 2, MAX_DIM = 72, INPUTS = 2 };

/* ---- a nonlinear field that depends on time and input, for any space ---- */

/* f_j(t, y, u) = 0.6 sin(sum_i W_ij y_i + phase_j + 0.7 t + sum_l U_lj u_l). W is (dim, m) with m the
 * dimension of the algebra, U is (INPUTS, m). */
typedef struct wave {
    lg_space space;
    size_t dim, m;
    double W[MAX_DIM * MAX_DIM], phase[MAX_DIM], U[INPUTS * MAX_DIM];
    int evaluations; /* evaluations on the tape */
} wave;

static void wave_init(wave *w, const lg_space *space, size_t dim, size_t m, uint64_t seed) {
    lg_rng rng = test_rng(seed, 0);
    *w = (wave){.space = *space, .dim = dim, .m = m};
    assert_true(dim <= MAX_DIM && m <= MAX_DIM);
    for (size_t i = 0; i < dim * m; i++) w->W[i] = lg_rng_normal(&rng) / sqrt((double)dim);
    for (size_t j = 0; j < m; j++) w->phase[j] = lg_rng_normal(&rng);
    for (size_t i = 0; i < INPUTS * m; i++) w->U[i] = lg_rng_normal(&rng);
}

FIELD(plain_wave, y) {
    const wave *w = user;
    for (size_t j = 0; j < w->m; j++) {
        double sum = w->phase[j] + 0.7 * t;
        for (size_t i = 0; i < w->dim; i++) sum += w->W[i * w->m + j] * y[i];
        for (size_t l = 0; input != NULL && l < INPUTS; l++) sum += w->U[l * w->m + j] * input[l];
        out[j] = 0.6 * sin(sum);
    }
}

static lg_var taped_waves(wave *w, lg_tape *tape, lg_taped_time t, lg_var y, lg_var input) {
    const uint32_t batch = lg_var_shape(tape, y).dims[0], m = (uint32_t)w->m;
    lg_var W = lg_input_f64(tape, lg_shape2((uint32_t)w->dim, m), w->W);
    lg_var phase = lg_input_f64(tape, lg_shape1(m), w->phase);
    if (lg_taped_time_varies(t))
        phase = lg_add(tape, phase, lg_scale(tape, lg_taped_time_rows(tape, t, batch), 0.7));
    else
        phase = lg_add_scalar(tape, phase, 0.7 * t.value);
    if (!lg_is_none(input))
        phase = lg_add(tape, phase, lg_matmul(tape, input, lg_input_f64(tape, lg_shape2(INPUTS, m), w->U)));
    w->evaluations++;
    return lg_scale(tape, lg_sin(tape, lg_add(tape, lg_matmul(tape, y, W), phase)), 0.6);
}

static lg_status taped_wave(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                            lg_var *out) {
    wave *w = user;
    lg_var f = taped_waves(w, tape, t, lg_taped_join(tape, &w->space, y), input);
    return lg_taped_split_algebra(tape, &w->space, f, out);
}

static lg_status taped_half_wave(void *user, lg_tape *tape, lg_taped_time t, lg_var half, lg_var input,
                                 lg_var *out) {
    *out = taped_waves(user, tape, t, half, input);
    return lg_tape_status(tape);
}

/* ---- spaces and starts ---- */

static const lg_space_factor all_kinds[] = {{LG_SPACE_RN, 2},       {LG_SPACE_TS2, 2},      {LG_SPACE_SO3, 2},
                                            {LG_SPACE_SE3, 1},      {LG_SPACE_SO3_DUAL, 1}, {LG_SPACE_RN, 1},
                                            {LG_SPACE_SE3_DUAL, 1}, {LG_SPACE_SE3, 1}};
static const lg_space_factor cotangent[] = {{LG_SPACE_SE3, 1}, {LG_SPACE_RN, 4}};
static const lg_space_factor constrained[] = {
    {LG_SPACE_TS2, 1}, {LG_SPACE_SO3, 2}, {LG_SPACE_SE3, 1}, {LG_SPACE_SE3_DUAL, 1}, {LG_SPACE_RN, 1}};

/* A point for each kind of factor; a random group element then moves it. */
static const double origin[LG_SPACE_KINDS][12] = {
    [LG_SPACE_RN] = {0.4},
    [LG_SPACE_TS2] = {0.6, 0.0, 0.8, 0.8, 1.0, -0.6},
    [LG_SPACE_SO3] = {1, 0, 0, 0, 1, 0, 0, 0, 1},
    [LG_SPACE_SE3] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0.3, -0.5, 0.9},
    [LG_SPACE_SO3_DUAL] = {0.9, -0.4, 1.3},
    [LG_SPACE_SE3_DUAL] = {0.2, 1.1, -0.7, 0.5, 0.8, -1.2},
};

static void random_numbers(lg_rng *rng, size_t n, double scale, double *x) {
    for (size_t i = 0; i < n; i++) x[i] = scale * lg_rng_normal(rng);
}

static void random_start(lg_rng *rng, const lg_space *space, double *y) {
    double a[MAX_DIM];
    size_t at = 0;
    for (size_t f = 0; f < space->factors; f++) {
        const size_t width = lg_space_kind_entry(space->factor[f].kind)->state;
        for (size_t i = 0; i < space->factor[f].count; i++, at += width)
            memcpy(y + at, origin[space->factor[f].kind], width * sizeof(*y));
    }
    random_numbers(rng, space->algebra_dim, 0.8, a);
    lg_space_act(space, a, y, y);
}

/* ---- every scheme ---- */

/* The equation for a scheme, plain and taped. */
typedef struct pair {
    wave wave;
    lg_ode plain;
    lg_taped_ode taped;
    double start[BATCH * MAX_DIM];
} pair;

static void make_flat(pair *p, const lg_space_factor *factors, size_t count) {
    assert_ok(lg_space_init(&p->plain.manifold, factors, count));
    assert_ok(lg_space_init_rn(&p->plain.space, p->plain.manifold.dim));
}

static void make_pair(pair *p, const lg_scheme *scheme) {
    memset(p, 0, sizeof(*p));
    if (scheme->kind == LG_SCHEME_SPLITTING)
        assert_ok(lg_space_init_rn(&p->plain.space, 12));
    else if (scheme->kind == LG_SCHEME_SLGI)
        assert_ok(lg_space_init(&p->plain.space, cotangent, LG_COUNT(cotangent)));
    else if (scheme->ambient)
        make_flat(p, constrained, LG_COUNT(constrained));
    else
        assert_ok(lg_space_init(&p->plain.space, all_kinds, LG_COUNT(all_kinds)));
    p->taped = (lg_taped_ode){.space = p->plain.space, .manifold = p->plain.manifold, .user = &p->wave};
    p->plain.user = &p->wave;
    lg_rng rng = test_rng(5, 0);
    const lg_space *starts = scheme->ambient ? &p->plain.manifold : &p->plain.space;
    for (int b = 0; b < BATCH; b++) random_start(&rng, starts, p->start + (size_t)b * starts->dim);
    const lg_space *space = &p->plain.space;
    if (scheme->kind != LG_SCHEME_SPLITTING) {
        wave_init(&p->wave, space, space->dim, space->algebra_dim, 7);
        p->plain.field = plain_wave;
        p->taped.field = taped_wave;
        return;
    }
    wave_init(&p->wave, space, space->dim / 2, space->dim / 2, 7);
    assert_ok(lg_space_init(&p->taped.space, (lg_space_factor[]){{LG_SPACE_RN, 6}, {LG_SPACE_RN, 6}}, 2));
    p->plain.force = p->plain.velocity = plain_wave;
    p->taped.force = p->taped.velocity = taped_half_wave;
}

static void assert_states(const char *name, const double *got, const double *expected, size_t n,
                          double tolerance) {
    for (size_t i = 0; i < n; i++)
        if (!lg_is_close(got[i], expected[i], tolerance, tolerance))
            fail_msg("%s: number %zu is %.17g on the tape and %.17g without (difference %.3g)", name, i,
                     got[i], expected[i], got[i] - expected[i]);
}

static void compare(lg_tape *tape, const lg_scheme *scheme, double tolerance) {
    static pair p;
    static double expected[(STEPS / EVERY + 1) * MAX_DIM], got[BATCH * MAX_DIM];
    const double h = 0.1, t0 = 0.2;
    make_pair(&p, scheme);
    const size_t dim = p.plain.space.dim, parts = lg_taped_parts(&p.taped.space);
    lg_var y[LG_TAPED_MAX_PARTS], out[STEPS / EVERY * LG_TAPED_MAX_PARTS];
    lg_tape_reset(tape);
    lg_var start = lg_input_f64(tape, lg_shape2(BATCH, (uint32_t)dim), p.start);
    assert_ok(lg_taped_split(tape, &p.taped.space, start, y));
    const lg_status status = lg_taped_integrate(tape, scheme, &p.taped, t0, h, STEPS, EVERY, y, out);
    if (status != LG_OK) fail_msg("%s: %s (%s)", scheme->name, lg_status_name(status), lg_tape_message(tape));
    lg_stepper *stepper = test_stepper(scheme, &p.plain);
    for (size_t b = 0; b < BATCH; b++) {
        assert_ok(
            lg_integrate_fixed(stepper, t0, h, STEPS, NULL, 0, EVERY, p.start + b * dim, expected, NULL));
        for (size_t n = 0; n < STEPS / EVERY; n++) {
            lg_var joined = lg_taped_join(tape, &p.taped.space, out + n * parts);
            assert_ok(lg_read(tape, joined, BATCH * dim, got));
            assert_states(scheme->name, got + b * dim, expected + (n + 1) * dim, dim, tolerance);
        }
    }
}

typedef void (*comparison)(lg_tape *tape, const lg_scheme *scheme, double tolerance);

static void variants(lg_tape *tape, comparison compared, double tolerance) {
    lg_scheme s = *lg_scheme_find("rkmk4");
    for (s.dexpinv = 0; s.dexpinv <= 8; s.dexpinv++) compared(tape, &s, tolerance);
    s = *lg_scheme_find("dp54"); /* a field value that FSAL reuses is invalid after a projection */
    s.project = true;
    compared(tape, &s, tolerance);
    s = *lg_scheme_find("symplectic-euler"); /* positions at more than one time inside the step */
    s.stages = 3;
    for (int i = 0; i < s.stages; i++) s.kick[i] = s.drift[i] = (i + 1) / 6.0;
    compared(tape, &s, tolerance);
    static const double theta[] = {0.0, 0.3, 1.0};
    for (size_t i = 0; i < LG_COUNT(theta); i++) {
        s = *lg_scheme_find("slgi");
        s.theta = theta[i];
        compared(tape, &s, tolerance);
        s = *lg_scheme_find("midpoint");
        s.theta = theta[i];
        compared(tape, &s, tolerance);
    }
}

/* Compares all schemes of the table, then variants of some. */
static void every_scheme(comparison compared, lg_dtype dtype, double tolerance) {
    lg_tape_options options;
    lg_tape *tape;
    lg_tape_options_init(&options);
    options.dtype = dtype;
    assert_ok(lg_tape_create(NULL, &options, &tape));
    for (size_t i = 0; i < lg_scheme_count(); i++)
        if (lg_scheme_at(i)->kind != LG_SCHEME_VARIATIONAL) compared(tape, lg_scheme_at(i), tolerance);
    variants(tape, compared, tolerance);
    lg_tape_destroy(tape);
}

TEST("every scheme on a tape agrees with the plain one") {
    every_scheme(compare, LG_F64, 1e-13);
}

TEST("every scheme on a float tape agrees with the plain one") {
    every_scheme(compare, LG_F32, 1e-5);
}

/* ---- times, steps and inputs that differ from row to row ---- */

enum { ROW_TIMES = 1, ROW_STEPS = 2, INPUT = 4, EVERYTHING = 7 };

static const double row_t[BATCH] = {0.2, -0.4, 1.1}, row_h[BATCH] = {0.1, 0.25, -0.17};
static const double row_u[BATCH * INPUTS] = {0.3, -0.8, 1.2, 0.1, -0.5, 0.9};

static lg_taped_interval make_interval(lg_tape *tape, int given, double t, double h) {
    const lg_shape column = lg_shape2(BATCH, 1);
    lg_taped_interval over = {.t = {.value = t}, .h = h};
    if (given & ROW_TIMES) over.t = (lg_taped_time){.rows = lg_input_f64(tape, column, row_t)};
    if (given & ROW_STEPS) over.h_rows = lg_input_f64(tape, column, row_h);
    if (given & INPUT) over.input = lg_input_f64(tape, lg_shape2(BATCH, INPUTS), row_u);
    return over;
}

/* Compares one step, with each combination of given times, steps and inputs, with the plain stepper, row by
 * row. */
static void compare_rows(lg_tape *tape, const lg_scheme *scheme, double tolerance) {
    static pair p;
    static double expected[MAX_DIM], got[BATCH * MAX_DIM];
    const double h = 0.1, t = 0.2;
    make_pair(&p, scheme);
    const size_t dim = p.plain.space.dim;
    lg_stepper *stepper = test_stepper(scheme, &p.plain);
    for (int given = 0; given <= EVERYTHING; given++) {
        lg_var y[LG_TAPED_MAX_PARTS];
        lg_tape_reset(tape);
        const lg_taped_interval over = make_interval(tape, given, t, h);
        lg_var start = lg_input_f64(tape, lg_shape2(BATCH, (uint32_t)dim), p.start);
        assert_ok(lg_taped_split(tape, &p.taped.space, start, y));
        const lg_status status = lg_taped_step(tape, scheme, &p.taped, &over, y, y);
        if (status != LG_OK) fail_msg("%s: %s", scheme->name, lg_tape_message(tape));
        assert_ok(lg_read(tape, lg_taped_join(tape, &p.taped.space, y), BATCH * dim, got));
        for (size_t b = 0; b < BATCH; b++) {
            lg_stepper_reset(stepper);
            assert_ok(lg_stepper_step(stepper, given & ROW_TIMES ? row_t[b] : t,
                                      given & ROW_STEPS ? row_h[b] : h, p.start + b * dim,
                                      given & INPUT ? row_u + b * INPUTS : NULL, expected));
            assert_states(scheme->name, got + b * dim, expected, dim, tolerance);
        }
    }
}

TEST("steps with times, lengths and inputs of each row agree with plain steps") {
    every_scheme(compare_rows, LG_F64, 1e-13);
}

TEST("steps with times, lengths and inputs of each row agree with plain steps on a float tape") {
    every_scheme(compare_rows, LG_F32, 1e-5);
}

TEST("a time is the sum of its parts; a time that contains an earlier step length is a start like any "
     "other") {
    const lg_scheme *scheme = lg_scheme_find("rkmk4");
    static pair p;
    static double expected[BATCH * MAX_DIM], got[BATCH * MAX_DIM];
    lg_var y[LG_TAPED_MAX_PARTS], out[LG_TAPED_MAX_PARTS];
    const double other[BATCH] = {0.5, -0.2, 0.8};
    double column[BATCH], sum[BATCH];
    make_pair(&p, scheme);
    const size_t dim = p.plain.space.dim;
    lg_tape *tape = test_tape(LG_F64);
    lg_var rows = lg_input(tape, lg_shape2(BATCH, 1), row_t),
           step = lg_input(tape, lg_shape2(BATCH, 1), other);
    const lg_taped_time all = {.value = 0.6, .rows = rows, .weight = 3.0, .step = step};
    assert_ok(lg_read(tape, lg_taped_time_rows(tape, all, BATCH), BATCH, column));
    for (int b = 0; b < BATCH; b++) assert_close(column[b], 0.6 + row_t[b] + 3.0 * other[b], 0.0, 1e-15);
    assert_ok(lg_read(tape, lg_taped_time_rows(tape, (lg_taped_time){.value = 0.6}, BATCH), BATCH, column));
    for (int b = 0; b < BATCH; b++) assert_close(column[b], 0.6, 0.0, 0.0);
    lg_var start = lg_input(tape, lg_shape2(BATCH, (uint32_t)dim), p.start);
    assert_ok(lg_taped_split(tape, &p.taped.space, start, y));
    for (int b = 0; b < BATCH; b++) sum[b] = 0.6 + row_t[b] + 3.0 * other[b];
    /* the interval's step length is another variable */
    lg_taped_interval over = make_interval(tape, ROW_STEPS, 0.0, 0.0);
    over.t = (lg_taped_time){.rows = lg_input(tape, lg_shape2(BATCH, 1), sum)};
    assert_ok(lg_taped_step(tape, scheme, &p.taped, &over, y, out));
    assert_ok(lg_read(tape, lg_taped_join(tape, &p.taped.space, out), BATCH * dim, expected));
    over.t = all;
    assert_ok(lg_taped_step(tape, scheme, &p.taped, &over, y, out));
    assert_ok(lg_read(tape, lg_taped_join(tape, &p.taped.space, out), BATCH * dim, got));
    assert_states("times", got, expected, BATCH * dim, 1e-14);
}

/* y' = a y + c t^3; `user` points to a and c. */
TAPED_FIELD(cubic) {
    const double *of = user;
    lg_var rows = lg_taped_time_rows(tape, t, lg_var_shape(tape, y[0]).dims[0]);
    lg_var terms[2] = {y[0], lg_mul(tape, rows, lg_square(tape, rows))};
    out[0] = lg_linear_combination(tape, terms, of, 2);
}

/* d^n y1/dx^n for one step of RK4 from y = 0.7, t = 0.4, h = 0.3, where x is h or t. */
static double nth_derivative(double a, double c, int n, bool by_h) {
    const double y0 = 0.7, t0 = 0.4, h0 = 0.3;
    double of[2] = {a, c}, got;
    lg_taped_ode ode = {.field = cubic, .user = of};
    assert_ok(lg_space_init_rn(&ode.space, 1));
    lg_tape *tape = test_tape(LG_F64);
    lg_var y = lg_input(tape, lg_shape2(1, 1), &y0);
    const lg_taped_interval over = {.t = {.rows = lg_parameter(tape, lg_shape2(1, 1), &t0)},
                                    .h_rows = lg_parameter(tape, lg_shape2(1, 1), &h0)};
    const lg_var x = by_h ? over.h_rows : over.t.rows;
    assert_ok(lg_taped_step(tape, lg_scheme_find("rk4"), &ode, &over, &y, &y));
    for (; n > 0; n--) assert_ok(lg_grad(tape, lg_sum(tape, y), &x, 1, &y));
    assert_ok(lg_read(tape, y, 1, &got));
    return got;
}

/* y' = a y: y1 = y sum_{k <= 4} (a h)^k/k!. y' = t^3: Simpson's rule is exact, y1 = y + ((t + h)^4 -
 * t^4)/4. */
TEST("derivatives by h and t up to order 4 agree with closed forms") {
    const double a = -1.3, z = a * 0.3, t = 0.4, e = 0.7;
    const double series[] = {1 + z + z * z / 2 + z * z * z / 6 + z * z * z * z / 24,
                             a * (1 + z + z * z / 2 + z * z * z / 6), a * a * (1 + z + z * z / 2),
                             a * a * a * (1 + z), a * a * a * a};
    for (int n = 0; n < (int)LG_COUNT(series); n++)
        assert_close(nth_derivative(a, 0.0, n, true), 0.7 * series[n], 1e-14, 1e-14);
    const double by_h[] = {0.7 + (e * e * e * e - t * t * t * t) / 4, e * e * e, 3 * e * e, 6 * e, 6};
    const double by_t[] = {by_h[0], e * e * e - t * t * t, 3 * (e * e - t * t), 6 * (e - t)};
    for (int n = 0; n < (int)LG_COUNT(by_h); n++)
        assert_close(nth_derivative(0.0, 1.0, n, true), by_h[n], 1e-13, 1e-14);
    for (int n = 0; n < (int)LG_COUNT(by_t); n++)
        assert_close(nth_derivative(0.0, 1.0, n, false), by_t[n], 1e-13, 1e-14);
}

/* ---- every kind of factor ---- */

typedef struct operands {
    lg_space space;
    double y[BATCH * MAX_DIM], a[BATCH * MAX_DIM], b[BATCH * MAX_DIM], expected[BATCH * MAX_DIM];
    lg_var yv[LG_TAPED_MAX_PARTS], av[LG_TAPED_MAX_PARTS], bv[LG_TAPED_MAX_PARTS];
} operands;

static void make_operands(operands *o, lg_tape *tape, const lg_space_factor *factors, size_t count) {
    lg_rng rng = test_rng(11, 0);
    assert_ok(lg_space_init(&o->space, factors, count));
    const size_t d = o->space.dim, m = o->space.algebra_dim;
    for (size_t b = 0; b < BATCH; b++) random_start(&rng, &o->space, o->y + b * d);
    random_numbers(&rng, BATCH * m, 0.8, o->a);
    random_numbers(&rng, BATCH * m, 0.8, o->b);
    lg_tape_reset(tape);
    assert_ok(lg_taped_split(tape, &o->space, lg_input(tape, lg_shape2(BATCH, (uint32_t)d), o->y), o->yv));
    assert_ok(
        lg_taped_split_algebra(tape, &o->space, lg_input(tape, lg_shape2(BATCH, (uint32_t)m), o->a), o->av));
    assert_ok(
        lg_taped_split_algebra(tape, &o->space, lg_input(tape, lg_shape2(BATCH, (uint32_t)m), o->b), o->bv));
}

static void assert_joined(const char *name, lg_tape *tape, const operands *o, bool algebra,
                          const lg_var *parts) {
    double got[BATCH * MAX_DIM];
    const size_t width = algebra ? o->space.algebra_dim : o->space.dim;
    lg_var joined =
        algebra ? lg_taped_join_algebra(tape, &o->space, parts) : lg_taped_join(tape, &o->space, parts);
    assert_ok(lg_read(tape, joined, BATCH * width, got));
    assert_states(name, got, o->expected, BATCH * width, 1e-14);
}

static void check_maps(lg_tape *tape, const lg_space_factor *factors, size_t count) {
    static operands o;
    lg_var out[LG_TAPED_MAX_PARTS];
    make_operands(&o, tape, factors, count);
    const lg_space *s = &o.space;
    const size_t d = s->dim, m = s->algebra_dim;
    memcpy(o.expected, o.y, sizeof(o.y));
    assert_joined("split and join", tape, &o, false, o.yv);
    for (size_t i = 0; i < BATCH; i++) lg_space_act(s, o.a + i * m, o.y + i * d, o.expected + i * d);
    assert_ok(lg_taped_act(tape, s, o.av, o.yv, out));
    assert_joined("action", tape, &o, false, out);
    memcpy(out, o.yv, sizeof(out));
    assert_ok(lg_taped_act(tape, s, o.av, out, out));
    assert_joined("action in place", tape, &o, false, out);
    for (size_t i = 0; i < BATCH; i++) lg_space_generator(s, o.a + i * m, o.y + i * d, o.expected + i * d);
    assert_ok(lg_taped_generator(tape, s, o.av, o.yv, out));
    assert_joined("generator", tape, &o, false, out);
    for (size_t i = 0; i < BATCH; i++) lg_space_bracket(s, o.a + i * m, o.b + i * m, o.expected + i * m);
    assert_ok(lg_taped_bracket(tape, s, o.av, o.bv, out));
    assert_joined("bracket", tape, &o, true, out);
    for (int K = LG_DEXPINV_EXACT; K <= LG_DEXPINV_MAX; K++) {
        for (size_t i = 0; i < BATCH; i++)
            lg_space_dexpinv(s, K, o.a + i * m, o.b + i * m, o.expected + i * m);
        assert_ok(lg_taped_dexpinv(tape, s, K, o.av, o.bv, out));
        assert_joined("dexpinv", tape, &o, true, out);
    }
}

/* Projects points that are off the manifold by 1e-6 and by 0.2. */
static void check_projection(lg_tape *tape, const lg_space_factor *factors, size_t count) {
    static operands o;
    for (double off = 1e-6; off < 1.0; off *= 2e5) {
        lg_var out[LG_TAPED_MAX_PARTS];
        double noise[BATCH * MAX_DIM];
        make_operands(&o, tape, factors, count);
        const size_t d = o.space.dim;
        lg_rng rng = test_rng(13, 0);
        random_numbers(&rng, BATCH * d, off, noise);
        for (size_t i = 0; i < BATCH * d; i++) o.y[i] += noise[i];
        memcpy(o.expected, o.y, sizeof(o.y));
        for (size_t b = 0; b < BATCH; b++) lg_space_project(&o.space, o.expected + b * d);
        assert_ok(lg_taped_split(tape, &o.space, lg_input(tape, lg_shape2(BATCH, (uint32_t)d), o.y), o.yv));
        assert_ok(lg_taped_project(tape, &o.space, o.yv, out));
        assert_joined("projection", tape, &o, false, out);
        assert_ok(lg_taped_project(tape, &o.space, o.yv, o.yv));
        assert_joined("projection in place", tape, &o, false, o.yv);
    }
}

TEST("the taped maps of every kind of space agree with the plain ones") {
    lg_tape *tape = test_tape(LG_F64);
    for (int kind = 0; kind < LG_SPACE_KINDS; kind++)
        for (size_t copies = 1; copies <= 3; copies += 2) {
            const lg_space_factor factor = {(lg_space_kind)kind, copies};
            check_maps(tape, &factor, 1);
            check_projection(tape, &factor, 1);
        }
    check_maps(tape, all_kinds, LG_COUNT(all_kinds));
    check_projection(tape, all_kinds, LG_COUNT(all_kinds));
}

/* ---- values that are reused ---- */

/* Checks the number of evaluations of the field in one step, and in three steps in a row. */
static void evaluations(const char *name, int one, int three) {
    static pair p;
    const lg_scheme *scheme = lg_scheme_find(name);
    lg_var y[LG_TAPED_MAX_PARTS], out[LG_TAPED_MAX_PARTS];
    make_pair(&p, scheme);
    const lg_shape shape = lg_shape2(1, (uint32_t)p.plain.space.dim);
    lg_tape *tape = test_tape(LG_F64);
    assert_ok(lg_taped_split(tape, &p.taped.space, lg_input(tape, shape, p.start), y));
    assert_ok(lg_taped_step(tape, scheme, &p.taped, OVER(0.0, 0.1), y, out));
    assert_int_equal(p.wave.evaluations, one);
    p.wave.evaluations = 0;
    assert_ok(lg_taped_integrate(tape, scheme, &p.taped, 0.0, 0.1, 3, 3, y, out));
    assert_int_equal(p.wave.evaluations, three);
}

TEST("known values are not evaluated again") {
    evaluations("rkmk54", 6, 18);
    evaluations("dp54", 6, 18);
    evaluations("cf43", 4, 12);
    evaluations("cf32a", 3, 9);
    evaluations("rkmk4-2c", 4, 12);
    evaluations("stormer-verlet", 3, 7); /* forces and velocities */
}

/* y' = -y; time and input are ignored. */
TAPED_FIELD(decay) {
    out[0] = lg_neg(tape, y[0]);
}
static lg_status half_decay(void *user, lg_tape *tape, lg_taped_time t, lg_var half, lg_var input,
                            lg_var *out) {
    return decay(user, tape, t, &half, input, out);
}

/* Number of nodes of one step on R^6 or on two copies of so(3)*. `given`: flags ROW_TIMES, ROW_STEPS,
 * INPUT. */
static size_t nodes_over(const lg_scheme *scheme, int given) {
    lg_taped_ode ode = {.field = decay, .force = half_decay, .velocity = half_decay};
    lg_var y;
    const bool flat_only =
        scheme->ambient || scheme->kind == LG_SCHEME_SPLITTING || scheme->kind == LG_SCHEME_IMPLICIT;
    const lg_space_factor factor =
        flat_only ? (lg_space_factor){LG_SPACE_RN, 6} : (lg_space_factor){LG_SPACE_SO3_DUAL, 2};
    assert_ok(lg_space_init(&ode.space, &factor, 1));
    lg_tape *tape = test_tape(LG_F64);
    lg_var start = lg_full(tape, lg_shape2(BATCH, 6), 0.4);
    assert_ok(lg_taped_split(tape, &ode.space, start, &y));
    const lg_taped_interval over = make_interval(tape, given, 0.2, 0.1);
    const size_t before = tape->count;
    assert_ok(lg_taped_step(tape, scheme, &ode, &over, &y, &y));
    const size_t nodes = tape->count - before;
    return nodes;
}

TEST("a field that uses neither time nor input adds no nodes for them") {
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        if (scheme->kind == LG_SCHEME_VARIATIONAL || scheme->kind == LG_SCHEME_SLGI) continue;
        assert_int_equal(nodes_over(scheme, ROW_TIMES | INPUT), nodes_over(scheme, 0));
        assert_int_equal(nodes_over(scheme, EVERYTHING), nodes_over(scheme, ROW_STEPS));
    }
}

/* Two recordings must have the same number of nodes and the same results. */
static void assert_recorded_alike(lg_tape *tape, size_t nodes, lg_var got, size_t expected_nodes,
                                  lg_var expected) {
    double a[2 * BATCH], b[2 * BATCH];
    assert_int_equal(nodes, expected_nodes);
    assert_ok(lg_read(tape, got, LG_COUNT(a), a));
    assert_ok(lg_read(tape, expected, LG_COUNT(b), b));
    assert_memory_equal(a, b, sizeof a);
}

/* With a constant step length each stage is a single combination with the weights h a_ij, as it was before
 * step lengths could be variables. So trained models keep their bits. */
static void check_combinations(double h) {
    const double start[2 * BATCH] = {0.3, -0.7, 1.1, 0.2, -0.9, 0.5};
    const double weights[] = {h * (1.0 / 6), h * (1.0 / 3), h * (1.0 / 3), h * (1.0 / 6)}, half = h * 0.5,
                 whole = h * 1.0;
    lg_taped_ode ode = {.field = decay, .force = half_decay, .velocity = half_decay};
    lg_var k[4], got;
    assert_ok(lg_space_init_rn(&ode.space, 2));
    lg_tape *tape = test_tape(LG_F64);
    const lg_var y = lg_parameter(tape, lg_shape2(BATCH, 2), start);
    size_t from = tape->count;
    assert_ok(lg_taped_step(tape, lg_scheme_find("rk4"), &ode, OVER(0.0, h), &y, &got));
    const size_t nodes = tape->count - from;
    from = tape->count;
    k[0] = lg_neg(tape, y);
    k[1] = lg_neg(tape, lg_add(tape, y, lg_linear_combination(tape, &k[0], &half, 1)));
    k[2] = lg_neg(tape, lg_add(tape, y, lg_linear_combination(tape, &k[1], &half, 1)));
    k[3] = lg_neg(tape, lg_add(tape, y, lg_linear_combination(tape, &k[2], &whole, 1)));
    lg_var expected = lg_add(tape, y, lg_linear_combination(tape, k, weights, 4));
    assert_recorded_alike(tape, nodes, got, tape->count - from, expected);

    from = tape->count;
    assert_ok(lg_taped_step(tape, lg_scheme_find("stormer-verlet"), &ode, OVER(0.0, h), &y, &got));
    const size_t split_nodes = tape->count - from;
    from = tape->count;
    lg_var q = lg_slice(tape, y, 1, 0, 1), p = lg_slice(tape, y, 1, 1, 1);
    p = lg_linear_combination(tape, (lg_var[]){p, lg_neg(tape, q)}, (double[]){1.0, 0.5 * h}, 2);
    q = lg_linear_combination(tape, (lg_var[]){q, lg_neg(tape, p)}, (double[]){1.0, 1.0 * h}, 2);
    p = lg_linear_combination(tape, (lg_var[]){p, lg_neg(tape, q)}, (double[]){1.0, 0.5 * h}, 2);
    expected = lg_concat(tape, (lg_var[]){q, p}, 2, 1);
    assert_recorded_alike(tape, split_nodes, got, tape->count - from, expected);
}

TEST("with constant steps a stage is a single combination") {
    check_combinations(0.1);
    check_combinations(1.0);
}

/* Number of nodes of one step of size h. */
static size_t nodes_of(const char *name, double h) {
    static pair p;
    lg_var y[LG_TAPED_MAX_PARTS];
    make_pair(&p, lg_scheme_find(name));
    const lg_shape shape = lg_shape2(1, (uint32_t)p.plain.space.dim);
    lg_tape *tape = test_tape(LG_F64);
    assert_ok(lg_taped_split(tape, &p.taped.space, lg_input(tape, shape, p.start), y));
    const size_t before = tape->count;
    assert_ok(lg_taped_step(tape, lg_scheme_find(name), &p.taped, OVER(0.0, h), y, y));
    const size_t nodes = tape->count - before;
    return nodes;
}

TEST("splitting schemes give the same bits on R^2n as one part and on R^n x R^n") {
    static pair p;
    const lg_scheme *scheme = lg_scheme_find("stormer-verlet");
    lg_var two[2], ends[2], one;
    double expected[12], got[12];
    make_pair(&p, scheme);
    lg_tape *tape = test_tape(LG_F64);
    lg_var y = lg_input(tape, lg_shape2(1, 12), p.start);
    assert_ok(lg_taped_split(tape, &p.taped.space, y, two));
    assert_ok(lg_taped_integrate(tape, scheme, &p.taped, 0.0, 0.1, 3, 3, two, ends));
    assert_ok(lg_read(tape, lg_taped_join(tape, &p.taped.space, ends), 12, expected));
    p.taped.space = p.plain.space;
    p.wave.evaluations = 0;
    assert_ok(lg_taped_integrate(tape, scheme, &p.taped, 0.0, 0.1, 3, 3, &y, &one));
    assert_int_equal(p.wave.evaluations, 7);
    assert_ok(lg_read(tape, one, 12, got));
    assert_memory_equal(got, expected, sizeof(got));
    assert_ok(lg_space_init_rn(&p.taped.space, 11));
    assert_status(lg_taped_step(tape, scheme, &p.taped, OVER(0.0, 0.1), &y, &one), LG_UNSUPPORTED);
}

TEST("the nodes of Newton's method are removed from the tape, whatever the number of iterations") {
    assert_int_equal(nodes_of("slgi", 1e-9), nodes_of("slgi", 0.5));
    assert_int_equal(nodes_of("midpoint", 1e-9), nodes_of("midpoint", 0.5));
}

/* ---- refusals ---- */

/* The state of the pair, on the tape after a reset. */
static void fresh_state(lg_tape *tape, const pair *p, lg_var *y) {
    lg_tape_reset(tape);
    lg_var whole = lg_input(tape, lg_shape2(BATCH, (uint32_t)p->plain.space.dim), p->start);
    assert_ok(lg_taped_split(tape, &p->taped.space, whole, y));
}

/* The tape must have the status of the call, and a message with these words. */
#define REFUSED(tape, call, status, words)                                                                   \
    do {                                                                                                     \
        assert_status(call, status);                                                                         \
        assert_status(lg_tape_status(tape), status);                                                         \
        assert_says(lg_tape_message(tape), words);                                                           \
    } while (0)

TEST("schemes, spaces and functions that do not fit are refused, and the tape keeps the message") {
    static const struct {
        const char *scheme, *other; /* the pair is made for `scheme`, the step is taken with `other` */
        lg_status status;
        const char *words;
    } rows[] = {{"cf4", "rk4", LG_UNSUPPORTED, "for R^n"},
                {"cf4", "midpoint", LG_UNSUPPORTED, "for R^n"},
                {"cf4", "stormer-verlet", LG_UNSUPPORTED, "for R^n"},
                {"rk4", "stormer-verlet", LG_UNSUPPORTED, "R^n x R^n or R^2n"},
                {"cf4", "slgi", LG_UNSUPPORTED, "for T*G"},
                {"cf4", "variational", LG_UNSUPPORTED, "cannot be recorded"},
                {"stormer-verlet", "rk4", LG_INVALID_ARGUMENT, "the scheme needs `field`"},
                {"midpoint", "stormer-verlet", LG_INVALID_ARGUMENT, "needs `force` and `velocity`"}};
    static pair p;
    lg_var y[LG_TAPED_MAX_PARTS], out[4 * LG_TAPED_MAX_PARTS] = {LG_NONE};
    lg_tape *tape = test_tape(LG_F64);
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const lg_scheme *other = lg_scheme_find(rows[i].other);
        make_pair(&p, lg_scheme_find(rows[i].scheme));
        if (strcmp(rows[i].words, "R^n x R^n or R^2n") == 0) assert_ok(lg_space_init_rn(&p.taped.space, 3));
        if (strcmp(rows[i].words, "needs `force` and `velocity`") == 0)
            assert_ok(lg_space_init_rn(&p.taped.space, 4));
        for (int integrates = 0; integrates < 2; integrates++) {
            lg_tape_reset(tape);
            REFUSED(tape,
                    integrates ? lg_taped_integrate(tape, other, &p.taped, 0, 0.1, 2, 1, y, out)
                               : lg_taped_step(tape, other, &p.taped, OVER(0, 0.1), y, out),
                    rows[i].status, rows[i].words);
        }
    }
    make_pair(&p, lg_scheme_find("stormer-verlet")); /* a force without a velocity; halves of two sizes */
    p.taped.velocity = NULL;
    fresh_state(tape, &p, y);
    REFUSED(tape, lg_taped_step(tape, lg_scheme_find("stormer-verlet"), &p.taped, OVER(0, 0.1), y, out),
            LG_INVALID_ARGUMENT, "needs `force` and `velocity`");
    p.taped.velocity = p.taped.force;
    assert_ok(lg_space_init(&p.taped.space, (lg_space_factor[]){{LG_SPACE_RN, 5}, {LG_SPACE_RN, 7}}, 2));
    fresh_state(tape, &p, y);
    REFUSED(tape, lg_taped_step(tape, lg_scheme_find("stormer-verlet"), &p.taped, OVER(0, 0.1), y, out),
            LG_UNSUPPORTED, "R^n x R^n or R^2n");
    lg_scheme bent = *lg_scheme_find("cf4");
    bent.c[1] += 0.1;
    make_pair(&p, &bent);
    fresh_state(tape, &p, y);
    REFUSED(tape, lg_taped_step(tape, &bent, &p.taped, OVER(0, 0.1), y, out), LG_INVALID_ARGUMENT, "step: ");
    static const size_t counts[][2] = {{0, 1}, {3, 2}, {3, 0}};
    for (size_t i = 0; i < LG_COUNT(counts); i++) {
        fresh_state(tape, &p, y);
        REFUSED(tape,
                lg_taped_integrate(tape, lg_scheme_find("cf4"), &p.taped, 0, 0.1, counts[i][0], counts[i][1],
                                   y, out),
                LG_INVALID_ARGUMENT, "`steps` must be a multiple of `every`");
    }
    for (int truncation = -2; truncation < 12; truncation += 13) {
        fresh_state(tape, &p, y);
        REFUSED(tape, lg_taped_dexpinv(tape, &p.taped.space, truncation, y, y, out), LG_INVALID_ARGUMENT,
                "truncation");
    }
    fresh_state(tape, &p, y);
    REFUSED(tape, lg_taped_split(tape, &p.taped.space, LG_NONE, out), LG_STALE_HANDLE, "LG_NONE");
    lg_tape_reset(tape);
    REFUSED(tape, lg_taped_split(tape, &p.taped.space, lg_input(tape, lg_shape2(1, 2), p.start), out),
            LG_SHAPE, "(B, dim)");
    lg_tape_reset(tape);
    REFUSED(tape,
            lg_taped_split(tape, &p.taped.space,
                           lg_input(tape, lg_shape1((uint32_t)p.taped.space.dim), p.start), out),
            LG_SHAPE, "(B, dim)");
    assert_true(lg_is_none(out[0]));
}

typedef struct narrow_step {
    const lg_scheme *scheme;
    const pair *pair;
    bool rows; /* each row has a time, a step length and another input */
} narrow_step;

static lg_status record_step(lg_tape *tape, const void *user) {
    const narrow_step *s = user;
    const pair *p = s->pair;
    static const double steps[BATCH] = {0.1};
    lg_var y[LG_TAPED_MAX_PARTS], out[LG_TAPED_MAX_PARTS];
    const lg_var whole = lg_input_f64(tape, lg_shape2(BATCH, (uint32_t)p->plain.space.dim), p->start);
    const lg_status split = lg_taped_split(tape, &p->taped.space, whole, y);
    if (split != LG_OK) return split;
    if (!s->rows) return lg_taped_step(tape, s->scheme, &p->taped, OVER(0.2, 0.1), y, out);
    const lg_var rows = lg_input_f64(tape, lg_shape2(BATCH, 1), steps);
    const lg_taped_interval over = {.t = {.rows = rows}, .h_rows = rows};
    return lg_taped_step(tape, s->scheme, &p->taped, &over, y, out);
}

TEST("a step may run out of memory at any point, for every scheme") {
    static pair p;
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        if (scheme->kind == LG_SCHEME_VARIATIONAL) continue;
        make_pair(&p, scheme);
        for (int rows = 0; rows < 2; rows++) {
            const narrow_step s = {scheme, &p, rows};
            assert_true(record_narrow(LG_F64, record_step, &s) > 0);
            assert_true(record_narrow(LG_F32, record_step, &s) > 0);
        }
    }
}

static lg_status stops(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                       lg_var *out) {
    return LG_CANCELLED;
}

static lg_status half_stops(void *user, lg_tape *tape, lg_taped_time t, lg_var half, lg_var input,
                            lg_var *out) {
    return LG_CANCELLED;
}

TEST("a field that fails without a message still fails the tape, for every scheme") {
    static pair p;
    lg_var y[LG_TAPED_MAX_PARTS], out[2 * LG_TAPED_MAX_PARTS] = {LG_NONE};
    lg_tape *tape = test_tape(LG_F64);
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        if (scheme->kind == LG_SCHEME_VARIATIONAL) continue;
        make_pair(&p, scheme);
        p.taped.field = stops;
        p.taped.force = p.taped.velocity = half_stops;
        for (int integrates = 0; integrates < 2; integrates++) {
            fresh_state(tape, &p, y);
            REFUSED(tape,
                    integrates ? lg_taped_integrate(tape, scheme, &p.taped, 0, 0.1, 2, 1, y, out)
                               : lg_taped_step(tape, scheme, &p.taped, OVER(0, 0.1), y, out),
                    LG_CANCELLED, lg_status_sentence(LG_CANCELLED));
            assert_true(lg_is_none(out[0]));
        }
    }
}

/* ---- shapes ---- */

enum { BENDS = 6 };

/* v with another shape: one row more, a single row, one number more, one axis more or fewer, or two axes
 * exchanged. LG_NONE if this does not change the shape. */
static lg_var bent(lg_tape *tape, lg_var v, int how) {
    lg_shape s = lg_var_shape(tape, v);
    const lg_shape was = s;
    if (how == 0) s.dims[0]++;
    if (how == 1) s.dims[0] = 1;
    if (how == 2) s.dims[s.rank - 1]++;
    if (how == 3) s.dims[s.rank++] = 1;
    if (how == 4) s.dims[s.rank - 2] *= s.dims[s.rank - 1], s.rank--;
    if (how == 5) s.dims[0] = was.dims[s.rank - 1], s.dims[s.rank - 1] = was.dims[0];
    return lg_same_shape(&s, &was) ? LG_NONE : lg_full(tape, s, 0.1);
}

/* One call of the table; each part of each argument is changed by `bent` in turn. */
typedef struct shaped {
    lg_tape *tape;
    const lg_space *space;
    lg_var *arguments[2]; /* parts */
    lg_status (*call)(struct shaped *s, lg_var *out);
    const lg_scheme *scheme;
    const lg_taped_ode *ode;
} shaped;

static lg_status call_act(shaped *s, lg_var *out) {
    return lg_taped_act(s->tape, s->space, s->arguments[0], s->arguments[1], out);
}

static lg_status call_generator(shaped *s, lg_var *out) {
    return lg_taped_generator(s->tape, s->space, s->arguments[0], s->arguments[1], out);
}

static lg_status call_bracket(shaped *s, lg_var *out) {
    return lg_taped_bracket(s->tape, s->space, s->arguments[0], s->arguments[1], out);
}

static lg_status call_dexpinv(shaped *s, lg_var *out) {
    return lg_taped_dexpinv(s->tape, s->space, 4, s->arguments[0], s->arguments[1], out);
}

static lg_status call_exact_dexpinv(shaped *s, lg_var *out) {
    return lg_taped_dexpinv(s->tape, s->space, LG_DEXPINV_EXACT, s->arguments[0], s->arguments[1], out);
}

static lg_status call_join(shaped *s, lg_var *out) {
    const lg_var joined = lg_taped_join(s->tape, s->space, s->arguments[1]);
    if (!lg_is_none(joined)) *out = joined;
    return lg_tape_status(s->tape);
}

static lg_status call_step(shaped *s, lg_var *out) {
    return lg_taped_step(s->tape, s->scheme, s->ode, OVER(0, 0.1), s->arguments[1], out);
}

static lg_status call_integrate(shaped *s, lg_var *out) {
    return lg_taped_integrate(s->tape, s->scheme, s->ode, 0, 0.1, 2, 2, s->arguments[1], out);
}

/* Whether a changed shape is valid all the same: for a single argument, another number of rows of its only
 * part, or a tensor on R^n. */
static bool is_sound(const shaped *s, size_t argument, size_t part, int how) {
    if (s->arguments[1 - argument] != NULL) return false;
    return (how <= 1 && lg_taped_parts(s->space) == 1) ||
           (how == 3 && lg_var_shape(s->tape, s->arguments[argument][part]).rank == 2);
}

static void refuse_bent(shaped *s, size_t *refused) {
    const size_t parts = lg_taped_parts(s->space);
    for (size_t a = 0; a < 2; a++)
        for (size_t p = 0; s->arguments[a] != NULL && p < parts; p++)
            for (int how = 0; how < BENDS; how++) {
                lg_var out[LG_TAPED_MAX_PARTS] = {LG_NONE};
                const lg_mark mark = lg_tape_mark(s->tape);
                const lg_var kept = s->arguments[a][p], other = bent(s->tape, kept, how);
                if (lg_is_none(other) || is_sound(s, a, p, how)) continue;
                s->arguments[a][p] = other;
                REFUSED(s->tape, s->call(s, out), LG_SHAPE, "part ");
                assert_true(lg_is_none(out[0]));
                assert_ok(lg_tape_rewind(s->tape, mark));
                s->arguments[a][p] = kept;
                assert_ok(s->call(s, out));
                assert_ok(lg_tape_rewind(s->tape, mark));
                (*refused)++;
            }
}

TEST("parts of a wrong shape are refused by the maps on every kind of space and by every scheme") {
    static lg_status (*const maps[])(shaped *, lg_var *) = {call_act,     call_generator,     call_bracket,
                                                            call_dexpinv, call_exact_dexpinv, call_join};
    static operands o;
    static pair p;
    lg_var y[LG_TAPED_MAX_PARTS];
    size_t refused = 0;
    lg_tape *tape = test_tape(LG_F64);
    for (int kind = 0; kind <= LG_SPACE_KINDS; kind++)
        for (size_t i = 0; i < LG_COUNT(maps); i++) {
            const lg_space_factor factor = {(lg_space_kind)kind, 2};
            if (kind < LG_SPACE_KINDS)
                make_operands(&o, tape, &factor, 1);
            else
                make_operands(&o, tape, all_kinds, LG_COUNT(all_kinds));
            const bool algebra =
                maps[i] == call_bracket || maps[i] == call_dexpinv || maps[i] == call_exact_dexpinv;
            shaped s = {.tape = tape,
                        .space = &o.space,
                        .arguments = {maps[i] == call_join ? NULL : o.av, algebra ? o.bv : o.yv},
                        .call = maps[i]};
            refuse_bent(&s, &refused);
        }
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        if (scheme->kind == LG_SCHEME_VARIATIONAL) continue;
        make_pair(&p, scheme);
        fresh_state(tape, &p, y);
        shaped s = {.tape = tape,
                    .space = &p.taped.space,
                    .arguments = {NULL, y},
                    .call = call_step,
                    .scheme = scheme,
                    .ode = &p.taped};
        refuse_bent(&s, &refused);
        s.call = call_integrate;
        refuse_bent(&s, &refused);
    }
    print_message("%zu refused\n", refused);
    assert_true(refused > 1000);
}

/* A field whose result has part `part` changed by `bent`. */
typedef struct bending {
    wave wave; /* first member, because it is the `user` of the fields */
    size_t part;
    int how;
    bool bent;
} bending;

static void bend(bending *b, lg_tape *tape, lg_var *out) {
    const lg_var other = bent(tape, *out, b->how);
    b->bent = !lg_is_none(other);
    if (b->bent) *out = other;
}

static lg_status bent_wave(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                           lg_var *out) {
    bending *b = user;
    LG_TRY(taped_wave(&b->wave, tape, t, y, input, out));
    bend(b, tape, &out[b->part]);
    return lg_tape_status(tape);
}

static lg_status bent_half_wave(void *user, lg_tape *tape, lg_taped_time t, lg_var half, lg_var input,
                                lg_var *out) {
    LG_TRY(taped_half_wave(user, tape, t, half, input, out));
    bend(user, tape, out);
    return lg_tape_status(tape);
}

TEST("results of a field that have a wrong shape are refused, for every scheme") {
    static pair p;
    static bending b;
    lg_var y[LG_TAPED_MAX_PARTS], out[LG_TAPED_MAX_PARTS] = {LG_NONE};
    lg_tape *tape = test_tape(LG_F64);
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        if (scheme->kind == LG_SCHEME_VARIATIONAL) continue;
        make_pair(&p, scheme);
        const bool splits = scheme->kind == LG_SCHEME_SPLITTING;
        for (b.part = 0; b.part < (splits ? 1 : lg_taped_parts(&p.taped.space)); b.part++)
            for (b.how = 0; b.how < BENDS; b.how++) {
                b.wave = p.wave;
                p.taped.field = bent_wave;
                p.taped.force = p.taped.velocity = bent_half_wave;
                p.taped.user = &b;
                fresh_state(tape, &p, y);
                const lg_status status = lg_taped_step(tape, scheme, &p.taped, OVER(0, 0.1), y, out);
                assert_status(status, b.bent ? LG_SHAPE : LG_OK);
                assert_status(lg_tape_status(tape), status);
                if (b.bent) assert_says(lg_tape_message(tape), "field: ");
            }
    }
}

typedef struct bad_interval {
    lg_shape rows, step, h, input; /* rank 0: LG_NONE */
    const char *fault;
} bad_interval;

TEST("times, steps and inputs of a wrong shape are refused") {
    static const bad_interval rows[] = {
        {.rows = {1, {BATCH}}, .fault = "the time must have shape (B, 1)"},
        {.rows = {2, {BATCH, 2}}, .fault = "the time must have shape (B, 1)"},
        {.step = {2, {1, 1}}, .fault = "the time must have shape (B, 1)"},
        {.h = {2, {BATCH + 1, 1}}, .fault = "the step size must have shape (B, 1)"},
        {.h = {2, {1, 1}}, .fault = "the step size must have shape (B, 1)"},
        {.h = {3, {BATCH, 1, 1}}, .fault = "the step size must have shape (B, 1)"},
        {.input = {2, {1, 4}}, .fault = "the input must have shape (B, m)"},
        {.input = {1, {BATCH}}, .fault = "the input must have shape (B, m)"},
    };
    static pair p;
    const lg_scheme *cf4 = lg_scheme_find("cf4");
    make_pair(&p, cf4);
    lg_tape *tape = test_tape(LG_F64);
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const lg_shape shapes[] = {rows[i].rows, rows[i].step, rows[i].h, rows[i].input};
        lg_var y[LG_TAPED_MAX_PARTS], given[4], out[LG_TAPED_MAX_PARTS] = {LG_NONE};
        lg_tape_reset(tape);
        lg_var whole = lg_input(tape, lg_shape2(BATCH, (uint32_t)p.plain.space.dim), p.start);
        assert_ok(lg_taped_split(tape, &p.taped.space, whole, y));
        for (int j = 0; j < 4; j++) given[j] = shapes[j].rank > 0 ? lg_full(tape, shapes[j], 0.1) : LG_NONE;
        const lg_taped_interval over = {
            .t = {.rows = given[0], .step = given[1]}, .h = 0.1, .h_rows = given[2], .input = given[3]};
        assert_status(lg_taped_step(tape, cf4, &p.taped, &over, y, out), LG_SHAPE);
        assert_true(lg_is_none(out[0]));
        assert_says(lg_tape_message(tape), rows[i].fault);
    }
}

TEST("a time with the wrong number of rows is refused") {
    static const lg_shape shapes[] = {{2, {BATCH + 1, 1}}, {2, {1, 1}}, {2, {BATCH, 2}}, {1, {BATCH}}};
    lg_tape *tape = test_tape(LG_F64);
    for (size_t i = 0; i < LG_COUNT(shapes); i++)
        for (int step = 0; step < 2; step++) {
            lg_tape_reset(tape);
            const lg_var v = lg_full(tape, shapes[i], 0.1);
            const lg_taped_time t =
                step ? (lg_taped_time){.weight = 0.5, .step = v} : (lg_taped_time){.rows = v};
            assert_true(lg_is_none(lg_taped_time_rows(tape, t, BATCH)));
            assert_status(lg_tape_status(tape), LG_SHAPE);
        }
}

TEST("a projection to a manifold that does not fit is refused") {
    static pair p;
    const lg_scheme *scheme = lg_scheme_find("rk4-projected");
    make_pair(&p, scheme);
    lg_tape *tape = test_tape(LG_F64);
    lg_var y = lg_input(tape, lg_shape2(BATCH, (uint32_t)p.plain.space.dim), p.start), out;
    assert_ok(lg_taped_step(tape, scheme, &p.taped, OVER(0, 0.1), &y, &out));
    assert_ok(lg_space_init(&p.taped.manifold, &(lg_space_factor){LG_SPACE_TS2, 1}, 1));
    REFUSED(tape, lg_taped_step(tape, scheme, &p.taped, OVER(0, 0.1), &y, &out), LG_INVALID_ARGUMENT,
            "the dimension of the manifold differs");
}

/* y' = 1 + y^2: for h > 1/2 and y0 = 0 the equation y1 = y0 + h (1 + y1^2) has no real solution. */
TAPED_FIELD(without_solution) {
    out[0] = lg_add_scalar(tape, lg_square(tape, y[0]), 1.0);
}

TEST("implicit steps that do not converge return an error") {
    const lg_scheme *scheme = lg_scheme_find("implicit-euler");
    const double y0 = 0.0;
    lg_taped_ode ode = {.field = without_solution};
    lg_var out = LG_NONE;
    double y1;
    assert_ok(lg_space_init_rn(&ode.space, 1));
    lg_tape *tape = test_tape(LG_F64);
    lg_var y = lg_input(tape, lg_shape2(1, 1), &y0);
    assert_ok(lg_taped_step(tape, scheme, &ode, OVER(0.0, 0.4), &y, &out));
    assert_ok(lg_read(tape, out, 1, &y1));
    assert_close(y1, 0.5, 1e-15, 0.0); /* the smaller root of 0.4 y^2 - y + 0.4 */
    out = LG_NONE;
    assert_status(lg_taped_step(tape, scheme, &ode, OVER(0.0, 0.6), &y, &out), LG_NO_CONVERGENCE);
    assert_true(lg_is_none(out));
    assert_status(lg_tape_status(tape), LG_NO_CONVERGENCE);
    const double nowhere = NAN;
    lg_tape_reset(tape);
    y = lg_input(tape, lg_shape2(1, 1), &nowhere);
    assert_status(lg_taped_step(tape, scheme, &ode, OVER(0.0, 0.4), &y, &out), LG_NOT_FINITE);
    assert_true(lg_is_none(out));
}

/* ---- a step as a function of a program ---- */

static const char *const step_spaces[] = {"R^3", "so(3)*"};

/* f = u - x/2 + (x_2, x_3, x_1)/3, with u (B, 1) in all three numbers. */
static lg_status program_field(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *f) {
    const lg_var turned = lg_concat(
        tape, (const lg_var[]){lg_slice(tape, in[0], 1, 1, 2), lg_slice(tape, in[0], 1, 0, 1)}, 2, 1);
    f[0] = lg_add(
        tape,
        lg_linear_combination(tape, (const lg_var[]){in[0], turned}, (const double[]){-0.5, 1.0 / 3.0}, 2),
        in[1]);
    return lg_tape_status(tape);
}

static lg_status plain_field(void *user, double t, const double *x, const double *u, double *f) {
    for (int i = 0; i < 3; i++) f[i] = -0.5 * x[i] + x[(i + 1) % 3] / 3.0 + u[0];
    return LG_OK;
}

static lg_program *field_program(void) {
    const lg_port in[] = {{.name = "x", .shape = lg_shape1(3)}, {.name = "u", .shape = lg_shape1(1)}},
                  out = {.name = "f"};
    const lg_function_spec field = {"field", in, 2, &out, 1, program_field, NULL};
    const lg_program_spec spec = {sizeof spec, NULL, 0, &field, 1, NULL};
    lg_program *program;
    lg_error error;
    assert_ok(lg_program_build(NULL, &spec, &program, &error));
    return program;
}

TEST("the function step of a program makes the steps of every scheme, and is refused where a stepper is") {
    const double x[3] = {0.4, -1.1, 0.7}, u[1] = {0.3}, h[1] = {0.15};
    double got[3], expected[3];
    lg_error error;
    size_t made = 0;
    for (size_t k = 0; k < 2; k++)
        for (size_t i = 0; i < lg_scheme_count(); i++) {
            const lg_scheme *scheme = lg_scheme_at(i);
            lg_ode ode = {.field = plain_field};
            lg_stepper *stepper = NULL;
            lg_program *program = field_program();
            assert_ok(lg_space_read(step_spaces[k], &ode.space, &error));
            const lg_status plain = lg_stepper_create(NULL, scheme, &ode, &stepper),
                            status = lg_program_add_step(program, &ode.space, scheme, 0.0, 0.2, &error);
            if (scheme->kind == LG_SCHEME_IMPLICIT) {
                assert_int_not_equal(status, LG_OK); /* its iteration depends on values */
            } else if (plain == LG_OK) {
                assert_ok(status);
                assert_ok(lg_program_eval(NULL, program, "step", 1, (const double *const[]){x, u, h},
                                          (double *const[]){got}, &error));
                assert_ok(lg_stepper_step(stepper, 0.0, h[0], x, u, expected));
                assert_states(scheme->name, got, expected, 3, 1e-14);
                made++;
            } else {
                assert_int_not_equal(status, LG_OK);
                assert_int_equal(lg_program_functions(program), 1);
            }
            lg_stepper_destroy(stepper);
            lg_program_destroy(program);
        }
    assert_true(made > 20);
}

TEST("steps of a program without a field, or with a field of another space, are refused") {
    lg_space space;
    lg_error error;
    lg_program *program = field_program();
    const lg_scheme *rk4 = lg_scheme_find("rk4");
    assert_ok(lg_space_init_rn(&space, 2));
    assert_status(lg_program_add_step(program, &space, rk4, 0.0, 0.1, &error), LG_SHAPE);
    assert_says(error.message, "2 numbers of a state");
    assert_ok(lg_space_init_rn(&space, 3));
    assert_status(lg_program_add_step(program, &space, rk4, 0.2, 0.1, &error), LG_INVALID_ARGUMENT);
    assert_status(lg_program_add_step(program, &space, rk4, 0.0, NAN, &error), LG_INVALID_ARGUMENT);
    assert_status(lg_program_add_step(program, &space, lg_scheme_find("implicit-euler"), 0.0, 0.1, &error),
                  LG_UNSUPPORTED);
    assert_says(error.message, "solves equations in each step, which a program cannot do");
    assert_status(lg_program_add_step(program, &space, lg_scheme_find("rk5"), 0.0, 0.1, &error),
                  LG_INVALID_ARGUMENT);
    assert_says(error.message, "a name that it does not know");
    assert_ok(lg_program_add_step(program, &space, rk4, 0.0, 0.1, &error));
    assert_status(lg_program_add_step(program, &space, rk4, 0.0, 0.1, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "step");
    lg_program_destroy(program);
}
