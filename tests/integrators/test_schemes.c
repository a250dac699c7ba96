/* Compares single steps of every scheme with an independent interpreter of the same coefficients: in long
 * double, with 4 x 4 matrices of SE(3), exponentials by scaling and squaring, and dexpinv by its series. The
 * coefficients themselves are tested by their orders in test_orders.c. */
#include "fields.h"
#include "support/fixtures.h"

#include "core/core.h"
#include "integrators/stepper.h"

/* ---- se(3)^2 by matrices ---- */

typedef struct mat {
    real a[4][4];
} mat;

typedef struct alg { /* an element of se(3)^2, or an ambient vector */
    real x[CHAIN_DIM];
} alg;

static mat mat_product(const mat *x, const mat *y) {
    mat out = {{{0}}};
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 4; k++)
            for (int j = 0; j < 4; j++) out.a[i][j] += x->a[i][k] * y->a[k][j];
    return out;
}

static mat hat(const real *a) {
    const mat m = {{{0, -a[2], a[1], a[3]}, {a[2], 0, -a[0], a[4]}, {-a[1], a[0], 0, a[5]}, {0}}};
    return m;
}

static mat mat_exp(const real *a) {
    mat x = hat(a), term = {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}}}, sum = term;
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++) x.a[i][j] /= 1024.0L;
    for (int k = 1; k < 16; k++) {
        term = mat_product(&term, &x);
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++) term.a[i][j] /= k, sum.a[i][j] += term.a[i][j];
    }
    for (int k = 0; k < 10; k++) sum = mat_product(&sum, &sum);
    return sum;
}

/* out = (R q, R w + r x R q) for both links */
static alg act(const alg *f, const alg *y) {
    alg out;
    for (int link = 0; link < 2; link++) {
        const mat e = mat_exp(f->x + 6 * link);
        const real r[3] = {e.a[0][3], e.a[1][3], e.a[2][3]};
        real *q = out.x + 6 * link, rq[3];
        for (int i = 0; i < 3; i++) {
            q[i] = dot_l(e.a[i], y->x + 6 * link);
            q[3 + i] = dot_l(e.a[i], y->x + 6 * link + 3);
        }
        cross_l(r, q, rq);
        for (int i = 0; i < 3; i++) q[3 + i] += rq[i];
    }
    return out;
}

static alg bracket(const alg *f, const alg *g) {
    alg out;
    for (int link = 0; link < 2; link++) {
        const mat a = hat(f->x + 6 * link), b = hat(g->x + 6 * link), ab = mat_product(&a, &b),
                  ba = mat_product(&b, &a);
        mat c;
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++) c.a[i][j] = ab.a[i][j] - ba.a[i][j];
        const real x[6] = {c.a[2][1], c.a[0][2], c.a[1][0], c.a[0][3], c.a[1][3], c.a[2][3]};
        memcpy(out.x + 6 * link, x, sizeof(x));
    }
    return out;
}

/* B_k. The odd ones except B_1 are 0. */
static real bernoulli(int k) {
    static const real even[][2] = {
        {1, 1}, {1, 6},       {-1, 30},     {1, 42},        {-1, 30},      {5, 66},           {-691, 2730},
        {7, 6}, {-3617, 510}, {43867, 798}, {-174611, 330}, {854513, 138}, {-236364091, 2730}};
    if (k % 2 == 1) return k == 1 ? -0.5L : 0.0L;
    return even[k / 2][0] / even[k / 2][1];
}

/* sum_{k <= K} B_k/k! ad_a^k b; K < 0: the whole series. */
static alg dexpinv(int K, const alg *a, const alg *b) {
    alg out = *b, term = *b;
    real factorial = 1.0L;
    for (int k = 1; k <= (K < 0 ? 24 : K); k++) {
        term = bracket(a, &term);
        factorial *= k;
        for (int i = 0; i < CHAIN_DIM; i++) out.x[i] += bernoulli(k) / factorial * term.x[i];
    }
    return out;
}

/* h (c1 k1 + c2 k2 + ...) */
static alg lin(real h, int n, const double *c, const alg *k) {
    alg out = {{0}};
    for (int j = 0; j < n; j++)
        for (int i = 0; i < CHAIN_DIM; i++) out.x[i] += h * c[j] * k[j].x[i];
    return out;
}

/* ---- the problem ---- */

static double swing = 0.4;

static alg field(real t, const alg *y) {
    alg f;
    chain_l(t, swing, y->x, f.x);
    return f;
}

static alg ambient(real t, const alg *y) {
    const alg f = field(t, y);
    alg v;
    chain_velocity_l(y->x, f.x, v.x);
    return v;
}

static alg add(const alg *x, const alg *y) {
    alg out;
    for (int i = 0; i < CHAIN_DIM; i++) out.x[i] = x->x[i] + y->x[i];
    return out;
}

/* ---- independent steps of the schemes ---- */

static real row_sum(const double *a, int n) {
    real s = 0.0L;
    for (int j = 0; j < n; j++) s += a[j];
    return s;
}

/* The end of a step. k gets the stages' values in the algebra, and after them one more for the end. */
static alg rkmk(const lg_scheme *s, real t, real h, const alg *y, alg *k) {
    for (int i = 0; i <= s->stages; i++) {
        const double *a = i < s->stages ? s->a[i] : s->b;
        alg sigma = lin(h, i, a, k);
        for (int c = 0; c < s->commutator_count; c++) {
            const lg_commutator *of = &s->commutators[c];
            if (of->row != i) continue;
            const alg x = bracket(&k[of->first], &k[of->second]);
            for (int j = 0; j < CHAIN_DIM; j++) sigma.x[j] += h * h * of->weight * x.x[j];
        }
        const alg point = act(&sigma, y);
        if (i == s->stages) return point;
        const alg f = field(t + h * row_sum(a, i), &point);
        k[i] = dexpinv(s->dexpinv, &sigma, &f);
    }
    return *y;
}

static alg explicit_rk(const lg_scheme *s, real t, real h, const alg *y, alg *k) {
    for (int i = 0; i < s->stages; i++) {
        const alg step = lin(h, i, s->a[i], k), point = add(y, &step);
        k[i] = ambient(t + h * row_sum(s->a[i], i), &point);
    }
    const alg step = lin(h, s->stages, s->b, k);
    return add(y, &step);
}

static alg projected(alg y) {
    for (int i = 0; i < 2; i++) {
        real *q = y.x + 6 * i;
        const real norm = sqrtl(dot_l(q, q));
        for (int j = 0; j < 3; j++) q[j] /= norm;
        const real along = dot_l(q, q + 3);
        for (int j = 0; j < 3; j++) q[3 + j] -= along * q[j];
    }
    return y;
}

/* The one-leg scheme: solves Y = y + theta h F(t + theta h, Y) by iteration; the end is y + h F. */
static alg one_leg(double theta, real t, real h, const alg *y) {
    const double whole = 1.0;
    alg point = *y, f = {{0}};
    for (int i = 0; i < 200; i++) {
        f = ambient(t + theta * h, &point);
        const alg step = lin(h, 1, &theta, &f);
        point = add(y, &step);
    }
    const alg step = lin(h, 1, &whole, &f);
    return add(y, &step);
}

static alg cf_point(const lg_cf_row *row, int known, real h, const alg *y, const alg *points, const alg *f) {
    alg point = row->base < 0 ? *y : points[row->base];
    for (int e = 0; e < row->exponentials; e++) {
        const alg sigma = lin(h, known, row->coefficient[e], f);
        point = act(&sigma, &point);
    }
    return point;
}

static alg commutator_free(const lg_scheme *s, real t, real h, const alg *y, alg *error) {
    alg points[LG_SCHEME_MAX_STAGES], f[LG_SCHEME_MAX_STAGES] = {{{0}}};
    for (int i = 0; i < s->stages; i++) {
        points[i] = cf_point(&s->rows[i], i, h, y, points, f);
        f[i] = field(t + h * s->c[i], &points[i]);
    }
    const alg end = cf_point(&s->rows[s->stages], s->stages, h, y, points, f);
    if (s->embedded_order > 0) *error = cf_point(&s->rows[s->stages + 1], s->stages, h, y, points, f);
    for (int i = 0; i < CHAIN_DIM; i++) error->x[i] = end.x[i] - error->x[i];
    return end;
}

/* The expected end of a step. `error` gets the difference to the embedded solution; for RKMK schemes it is
 * the difference in the algebra, mapped by the generator. */
static alg expected(const lg_scheme *s, real t, real h, const alg *y, alg *error) {
    alg k[LG_SCHEME_MAX_STAGES];
    double weight[LG_SCHEME_MAX_STAGES];
    if (s->kind == LG_SCHEME_IMPLICIT) return one_leg(s->theta, t, h, y);
    if (s->kind == LG_SCHEME_COMMUTATOR_FREE) return commutator_free(s, t, h, y, error);
    alg end = s->ambient ? explicit_rk(s, t, h, y, k) : rkmk(s, t, h, y, k);
    if (s->project) end = projected(end);
    for (int i = 0; i < s->stages; i++) weight[i] = s->b[i] - s->embedded[i];
    *error = lin(h, s->stages, weight, k);
    const alg sigma = *error;
    if (!s->ambient) chain_velocity_l(end.x, sigma.x, error->x);
    return end;
}

static double distance(const double *y, const alg *e) {
    double worst = 0.0;
    for (int i = 0; i < CHAIN_DIM; i++) worst = fmax(worst, fabs(y[i] - (double)e->x[i]));
    return isnan(worst) ? INFINITY : worst;
}

/* Distance of one step of size h by `scheme`, under varying gravity, from the expected step of the scheme
 * `of`. Also checks the error estimate. */
static double step_error(const lg_scheme *scheme, const lg_scheme *of, double h) {
    double y[CHAIN_DIM];
    alg start, error;
    const lg_ode ode = chain_ode(scheme, &swing);
    lg_stepper *stepper = test_stepper(scheme, &ode);
    chain_start(y);
    widen(CHAIN_DIM, y, start.x);
    const alg end = expected(of, 0.3L, h, &start, &error);
    assert_ok(lg_stepper_step(stepper, 0.3, h, y, NULL, y));
    if (scheme->embedded_order > 0) assert_true(distance(stepper->error, &error) <= 1e-14);
    return distance(y, &end);
}

TEST("a single step of every scheme agrees with an independent one in long double") {
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        if (scheme->kind != LG_SCHEME_RKMK && scheme->kind != LG_SCHEME_COMMUTATOR_FREE &&
            scheme->kind != LG_SCHEME_IMPLICIT)
            continue;
        for (double h = 0.02; h > -0.03; h -= 0.04) { /* forward and backward */
            const double off = step_error(scheme, scheme, h);
            print_message("  %-15s h = %5.2f: %.2g\n", scheme->name, h, off);
            assert_true(off <= 1e-12);
        }
    }
}

TEST("changing a scheme's truncation of dexpinv changes its steps as expected") {
    lg_scheme scheme = *lg_scheme_find("rkmk5"), less = scheme;
    for (scheme.dexpinv = LG_DEXPINV_EXACT; scheme.dexpinv <= LG_DEXPINV_MAX; scheme.dexpinv++)
        assert_true(step_error(&scheme, &scheme, 0.2) <= 1e-12);
    /* The terms are really used: with one term less the step differs. */
    scheme.dexpinv = 4;
    less.dexpinv = 2;
    assert_true(step_error(&scheme, &less, 0.2) > 1e-9);
}

/* ---- schemes of a user ---- */

static double uniform(lg_rng *rng) {
    return lg_rng_uniform_in(rng, -1.0, 1.0);
}

/* A random explicit scheme: c are the row sums, the weights sum to 1, there may be commutators, and dexpinv
 * is truncated anywhere. */
static lg_scheme random_rkmk(lg_rng *rng, int stages, lg_commutator *list) {
    lg_scheme s = {.name = "mine", .kind = LG_SCHEME_RKMK, .order = 1, .stages = stages, .commutators = list};
    double total = 0.0;
    for (int i = 0; i < stages; i++)
        for (int j = 0; j < i; j++) s.a[i][j] = uniform(rng), s.c[i] += s.a[i][j];
    for (int i = 1; i < stages; i++) total += s.b[i] = uniform(rng);
    s.b[0] = 1.0 - total;
    s.dexpinv = (int)(12.0 * lg_rng_uniform(rng)) - 1;
    s.commutator_count = stages > 1 ? (int)(4.0 * lg_rng_uniform(rng)) : 0;
    for (int i = 0; i < s.commutator_count; i++) {
        const int row = 2 + (int)((stages - 1) * lg_rng_uniform(rng));
        list[i] = (lg_commutator){row, (int)(row * lg_rng_uniform(rng)), (int)(row * lg_rng_uniform(rng)),
                                  uniform(rng)};
    }
    return s;
}

TEST("steps of random tableaux with brackets and truncations agree with long double") {
    double worst = 0.0;
    lg_rng rng = test_rng(5, 0);
    for (int repeat = 0; repeat < 40; repeat++) {
        lg_commutator list[4];
        const lg_scheme s = random_rkmk(&rng, 1 + repeat % LG_SCHEME_MAX_STAGES, list);
        lg_scheme plain = s;
        plain.ambient = true, plain.dexpinv = 0, plain.commutator_count = 0;
        worst = fmax(worst, fmax(step_error(&s, &s, 0.02), step_error(&plain, &plain, 0.02)));
    }
    print_message("  random tableaux: %.2g\n", worst);
    assert_true(worst <= 1e-12);
}

/* A random row with any earlier base and up to four exponentials; c is the sum of their coefficients. */
static void random_row(lg_rng *rng, int known, const double *c, double time, bool fixed, lg_cf_row *row,
                       double *total) {
    row->base = (int)((known + 1) * lg_rng_uniform(rng)) - 1;
    row->exponentials = known == 0 ? 0 : 1 + (int)(LG_SCHEME_MAX_EXPONENTIALS * lg_rng_uniform(rng));
    *total = row->base < 0 ? 0.0 : c[row->base];
    for (int e = 0; e < row->exponentials; e++)
        for (int j = 0; j < known; j++) *total += row->coefficient[e][j] = 0.5 * uniform(rng);
    if (fixed) row->coefficient[0][0] += time - *total, *total = time;
}

TEST("steps of random commutator-free schemes agree with long double") {
    double worst = 0.0, end;
    lg_rng rng = test_rng(6, 0);
    for (int repeat = 0; repeat < 32; repeat++) {
        const int stages = 1 + repeat % LG_SCHEME_MAX_STAGES;
        lg_cf_row rows[LG_SCHEME_MAX_STAGES + 2] = {{0}};
        lg_scheme s = {.name = "mine", .kind = LG_SCHEME_COMMUTATOR_FREE, .order = 2, .stages = stages};
        s.embedded_order = 1, s.rows = rows;
        for (int i = 0; i < stages; i++) random_row(&rng, i, s.c, 0.0, false, &rows[i], &s.c[i]);
        for (int i = 0; i < 2; i++) random_row(&rng, stages, s.c, 1.0, true, &rows[stages + i], &end);
        worst = fmax(worst, step_error(&s, &s, 0.02));
    }
    print_message("  random commutator-free schemes: %.2g\n", worst);
    assert_true(worst <= 1e-12);
}

/* ---- variational steps ---- */

static lg_status variational(void *user, double t, double h, double *y) {
    if (user) return *(lg_status *)user;
    y[0] += h * t;
    return LG_OK;
}

TEST("a variational step calls the system's own step") {
    double y[12];
    lg_status failure = LG_NO_CONVERGENCE;
    lg_ode ode = {.step = NULL};
    const lg_scheme *scheme = lg_scheme_find("variational");
    assert_ok(lg_space_init(&ode.space, &(lg_space_factor){LG_SPACE_TS2, 2}, 1));
    lg_stepper *stepper = NULL;
    assert_status(lg_stepper_create(NULL, scheme, &ode, &stepper), LG_INVALID_ARGUMENT);
    ode.step = variational;
    chain_start(y);
    stepper = test_stepper(scheme, &ode);
    assert_ok(lg_stepper_step(stepper, 3.0, 0.5, y, NULL, y));
    assert_close(y[0], 0.6 + 1.5, 1e-15, 0.0);
    assert_int_equal(lg_stepper_evaluations(stepper), 1);
    ode.user = &failure;
    stepper = test_stepper(scheme, &ode);
    assert_status(lg_stepper_step(stepper, 3.0, 0.5, y, NULL, y), LG_NO_CONVERGENCE);
    assert_close(y[0], 0.6 + 1.5, 1e-15, 0.0);
}

/* ---- implicit schemes ---- */

/* A stiff linear problem, whose implicit Euler step is known. */
FIELD(stiff_field, y) {
    out[0] = -1e6 * (y[0] - t);
    out[1] = y[0] - y[1];
}

/* y' = y^2 + 1e3: the stage of implicit Euler has a real solution for small steps only. */
FIELD(unsolvable_field, y) {
    out[0] = y[0] * y[0] + 1e3;
}

TEST("implicit steps are exact on stiff problems, or return LG_NO_CONVERGENCE") {
    double y[2] = {1.0, 2.0}, out[2];
    lg_ode ode = {.field = stiff_field};
    assert_ok(lg_space_init_rn(&ode.space, 2));
    lg_stepper *stepper = test_stepper(lg_scheme_find("implicit-euler"), &ode);
    assert_ok(lg_stepper_step(stepper, 0.5, 0.1, y, NULL, out));
    const double first = (1.0 + 1e5 * 0.6) / (1.0 + 1e5);
    assert_close(out[0], first, 1e-12, 0.0);
    assert_close(out[1], (2.0 + 0.1 * first) / 1.1, 1e-12, 0.0);
    y[0] = y[1] = 0.0; /* from the origin */
    assert_ok(lg_stepper_step(stepper, 0.0, 0.1, y, NULL, out));
    assert_close(out[0], 1e5 * 0.1 / (1.0 + 1e5), 1e-12, 0.0);
    ode.field = unsolvable_field;
    assert_ok(lg_space_init_rn(&ode.space, 1));
    stepper = test_stepper(lg_scheme_find("implicit-euler"), &ode);
    y[0] = out[0] = 0.5;
    assert_status(lg_stepper_step(stepper, 0.0, 1.0, y, NULL, out), LG_NO_CONVERGENCE);
    assert_true(out[0] == 0.5);
    assert_ok(lg_stepper_step(stepper, 0.0, 1e-3, y, NULL, out)); /* 1e-3 Y^2 - Y + 1.5 = 0 */
    assert_close(out[0], (1.0 - sqrt(1.0 - 4e-3 * 1.5)) / 2e-3, 1e-12, 0.0);
}

/* ---- symplectic Lie group integrators; test_orders.c has their orders, test_symplectic.c the symplectic
 * form ---- */

/* A pendulum on T*(R^m), next to SO(3) at rest. */
FIELD(resting_field, y) {
    memset(out, 0, 6 * sizeof(*out));
    out[6] = y[13], out[7] = -sin(y[12]);
}

/* The force is taken at (1 - theta) q0 + theta q1 and the velocity at theta p0 + (1 - theta) p1; solved by
 * iteration. */
TEST("slgi on R^m is symplectic Euler (p or q first) or, for theta = 1/2, the midpoint rule") {
    static const double thetas[] = {0.0, 0.5, 1.0};
    const double h = 0.2;
    for (size_t i = 0; i < LG_COUNT(thetas); i++) {
        const double theta = thetas[i];
        double x[14] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0.3, 0.2, 0.1, 0.4, 0.9}, q = 0.4, p = 0.9;
        lg_ode ode = {.field = resting_field};
        lg_scheme scheme = *lg_scheme_find("slgi");
        scheme.theta = theta;
        assert_ok(lg_space_init(&ode.space, (lg_space_factor[]){{LG_SPACE_SE3, 1}, {LG_SPACE_RN, 2}}, 2));
        lg_stepper *stepper = test_stepper(&scheme, &ode);
        for (int n = 0; n < 20; n++) {
            double q1 = q, p1 = p;
            assert_ok(lg_stepper_step(stepper, 0.0, h, x, NULL, x));
            for (int k = 0; k < 60; k++) {
                p1 = p - h * sin((1.0 - theta) * q + theta * q1);
                q1 = q + h * (theta * p + (1.0 - theta) * p1);
            }
            q = q1, p = p1;
        }
        assert_close(x[12], q, 1e-13, 0.0);
        assert_close(x[13], p, 1e-13, 0.0);
        assert_close(x[10], 0.2, 1e-15, 0.0);
    }
}

FIELD(nan_field, y) {
    for (int i = 0; i < 6; i++) out[i] = NAN;
}

TEST("spaces and fields that slgi cannot handle are refused") {
    static const lg_space_factor unfit[][2] = {{{LG_SPACE_TS2, 1}, {LG_SPACE_RN, 2}},
                                               {{LG_SPACE_SE3, 2}, {LG_SPACE_RN, 2}},
                                               {{LG_SPACE_SE3, 1}, {LG_SPACE_RN, 3}},
                                               {{LG_SPACE_RN, 2}, {LG_SPACE_SE3, 1}}};
    lg_stepper *stepper = NULL;
    lg_ode ode = {.field = top_field};
    for (size_t i = 0; i < 4; i++) {
        assert_ok(lg_space_init(&ode.space, unfit[i], 2));
        assert_status(lg_stepper_create(NULL, lg_scheme_find("slgi"), &ode, &stepper), LG_UNSUPPORTED);
    }
    assert_null(stepper);
    double y[12], before[12];
    top_start(150.0, y);
    memcpy(before, y, sizeof(y));
    ode.field = nan_field;
    assert_ok(lg_space_init(&ode.space, &(lg_space_factor){LG_SPACE_SE3, 1}, 1));
    stepper = test_stepper(lg_scheme_find("slgi"), &ode);
    assert_status(lg_stepper_step(stepper, 0.0, 0.01, y, NULL, y), LG_NOT_FINITE);
    assert_memory_equal(y, before, sizeof(y));
}
