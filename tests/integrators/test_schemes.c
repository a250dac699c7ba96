/* Single steps of every scheme against implementations that share nothing with the library: long double, 4 x
 * 4 matrices of SE(3), exponentials by scaling and squaring, dexpinv by its series, formulas as the sources
 * print them. */
#include "fields.h"
#include "support/fixtures.h"

#include "core/core.h"
#include "liegrad/random.h"

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

/* out = (R q, R w + r x R q) on both links */
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

/* B_k; the odd ones after the first are 0. */
static real bernoulli(int k) {
    static const real even[][2] = {
        {1, 1}, {1, 6},       {-1, 30},     {1, 42},        {-1, 30},      {5, 66},           {-691, 2730},
        {7, 6}, {-3617, 510}, {43867, 798}, {-174611, 330}, {854513, 138}, {-236364091, 2730}};
    if (k % 2 == 1) return k == 1 ? -0.5L : 0.0L;
    return even[k / 2][0] / even[k / 2][1];
}

/* sum_{k <= K} B_k/k! ad_a^k b; K < 0: the whole series */
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
static alg lin(real h, int n, const real *c, const alg *k) {
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

/* ---- the schemes, independently ---- */

typedef struct tableau {
    int stages;
    real a[8][8], b[8];
} tableau;

static const tableau one = {1, {{0}}, {1}};
static const tableau heun = {2, {{0}, {1}}, {0.5L, 0.5L}};
static const tableau kutta3 = {3, {{0}, {0.5L}, {-1, 2}}, {1.0L / 6, 4.0L / 6, 1.0L / 6}};
static const tableau classical = {
    4, {{0}, {0.5L}, {0, 0.5L}, {0, 0, 1}}, {1.0L / 6, 2.0L / 6, 2.0L / 6, 1.0L / 6}};
static const tableau dormand_prince = {
    6,
    {{0},
     {0.2L},
     {0.075L, 0.225L},
     {44.0L / 45, -56.0L / 15, 32.0L / 9},
     {19372.0L / 6561, -25360.0L / 2187, 64448.0L / 6561, -212.0L / 729},
     {9017.0L / 3168, -355.0L / 33, 46732.0L / 5247, 49.0L / 176, -5103.0L / 18656}},
    {35.0L / 384, 0, 500.0L / 1113, 125.0L / 192, -2187.0L / 6784, 11.0L / 84}};

static real row_sum(const real *a, int n) {
    real s = 0.0L;
    for (int j = 0; j < n; j++) s += a[j];
    return s;
}

/* Commutators as a list (row, first, second, weight), as the library has them. */
static alg rkmk(const tableau *T, int K, const lg_commutator *list, int count, real t, real h, const alg *y) {
    alg k[8];
    for (int i = 0; i <= T->stages; i++) {
        const real *a = i < T->stages ? T->a[i] : T->b;
        alg sigma = lin(h, i, a, k);
        for (int c = 0; c < count; c++) {
            if (list[c].row != i) continue;
            const alg x = bracket(&k[list[c].first], &k[list[c].second]);
            for (int j = 0; j < CHAIN_DIM; j++) sigma.x[j] += h * h * list[c].weight * x.x[j];
        }
        const alg point = act(&sigma, y);
        if (i == T->stages) return point;
        const alg f = field(t + h * row_sum(a, i), &point);
        k[i] = dexpinv(K, &sigma, &f);
    }
    return *y;
}

static alg explicit_rk(const tableau *T, real t, real h, const alg *y) {
    alg k[8];
    for (int i = 0; i < T->stages; i++) {
        const alg step = lin(h, i, T->a[i], k), point = add(y, &step);
        k[i] = ambient(t + h * row_sum(T->a[i], i), &point);
    }
    const alg step = lin(h, T->stages, T->b, k);
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

/* Y = y + theta h F(t + theta h, Y) by iteration, y + h F */
static alg one_leg(real theta, real t, real h, const alg *y) {
    alg point = *y, f = {{0}};
    for (int i = 0; i < 200; i++) {
        f = ambient(t + theta * h, &point);
        const real c = theta;
        const alg step = lin(h, 1, &c, &f);
        point = add(y, &step);
    }
    const real c = 1.0L;
    const alg step = lin(h, 1, &c, &f);
    return add(y, &step);
}

/* exp(h sum c_j f_j) . from */
static alg exp_of(real h, int n, const real *c, const alg *f, const alg *from) {
    const alg sigma = lin(h, n, c, f);
    return act(&sigma, from);
}
#define EXP(from, ...)                                                                                       \
    exp_of(h, (int)(sizeof((real[]){__VA_ARGS__}) / sizeof(real)), (real[]){__VA_ARGS__}, f, from)

static alg rkmk4_2c(real t, real h, const alg *y) {
    alg f[4], x, s;
    f[0] = field(t, y);
    x = EXP(y, 0.5L), f[1] = field(t + h / 2, &x);
    x = bracket(&f[0], &f[1]);
    for (int i = 0; i < CHAIN_DIM; i++) s.x[i] = h * f[1].x[i] / 2 - h * h * x.x[i] / 8;
    x = act(&s, y), f[2] = field(t + h / 2, &x);
    x = EXP(y, 0, 0, 1), f[3] = field(t + h, &x);
    x = bracket(&f[0], &f[3]);
    for (int i = 0; i < CHAIN_DIM; i++)
        s.x[i] = h * (f[0].x[i] + 2 * f[1].x[i] + 2 * f[2].x[i] + f[3].x[i] - h * x.x[i] / 2) / 6;
    return act(&s, y);
}

static alg crouch_grossman(real t, real h, const alg *y) {
    alg f[3], x;
    f[0] = field(t, y);
    x = EXP(y, 0.75L), f[1] = field(t + 0.75L * h, &x);
    x = EXP(y, 119.0L / 216), x = EXP(&x, 0, 17.0L / 108), f[2] = field(t + h * 17 / 24, &x);
    x = EXP(y, 13.0L / 51), x = EXP(&x, 0, -2.0L / 3);
    return EXP(&x, 0, 0, 24.0L / 17);
}

/* The embedded solution of order 3 too. */
static alg cf4(real t, real h, const alg *y, alg *embedded) {
    alg f[5], y2, x;
    f[0] = field(t, y);
    y2 = EXP(y, 0.5L), f[1] = field(t + h / 2, &y2);
    x = EXP(y, 0, 0.5L), f[2] = field(t + h / 2, &x);
    x = EXP(&y2, -0.5L, 0, 1), f[3] = field(t + h, &x);
    x = EXP(y, 0, 0.75L), f[4] = field(t + h * 3 / 4, &x);
    x = EXP(y, 1.0L / 3), *embedded = EXP(&x, -1.0L / 9, 3.0L / 9, 0, 0, 4.0L / 9);
    x = EXP(y, 3.0L / 12, 2.0L / 12, 2.0L / 12, -1.0L / 12);
    return EXP(&x, -1.0L / 12, 2.0L / 12, 2.0L / 12, 3.0L / 12);
}

static alg cf32a(real t, real h, const alg *y, alg *embedded) {
    alg f[3], y2, x;
    f[0] = field(t, y);
    y2 = EXP(y, 1.0L / 3), f[1] = field(t + h / 3, &y2);
    x = EXP(y, 0, 2.0L / 3), f[2] = field(t + 2 * h / 3, &x);
    *embedded = EXP(y, 0, 0.5L, 0.5L);
    return EXP(&y2, -1.0L / 12, 0, 0.75L);
}

static alg cf32b(real t, real h, const alg *y, alg *embedded) {
    alg f[3], x;
    f[0] = field(t, y);
    x = EXP(y, 2.0L / 3), f[1] = field(t + 2 * h / 3, &x);
    x = EXP(y, 5.0L / 12, 0.25L), f[2] = field(t + 2 * h / 3, &x);
    *embedded = EXP(y, 0.25L, 0, 0.75L);
    return EXP(&x, -1.0L / 6, -0.5L, 1);
}

static alg expected(const char *name, real t, real h, const alg *y, alg *embedded) {
    static const struct {
        const char *name;
        const tableau *T;
        int K;
    } lie[] = {{"lie-euler", &one, -1},   {"lie-heun", &heun, 0},         {"rkmk3", &kutta3, -1},
               {"rkmk4", &classical, -1}, {"rkmk5", &dormand_prince, -1}, {"rkmk54", &dormand_prince, -1}},
      plain[] = {{"euler", &one, 0}, {"rk4", &classical, 0}, {"dp54", &dormand_prince, 0}};
    for (size_t i = 0; i < LG_COUNT(lie); i++)
        if (strcmp(name, lie[i].name) == 0) return rkmk(lie[i].T, lie[i].K, NULL, 0, t, h, y);
    for (size_t i = 0; i < LG_COUNT(plain); i++)
        if (strcmp(name, plain[i].name) == 0) return explicit_rk(plain[i].T, t, h, y);
    if (strcmp(name, "rk4-projected") == 0) return projected(explicit_rk(&classical, t, h, y));
    if (strcmp(name, "implicit-euler") == 0) return one_leg(1.0L, t, h, y);
    if (strcmp(name, "midpoint") == 0) return one_leg(0.5L, t, h, y);
    if (strcmp(name, "rkmk4-2c") == 0) return rkmk4_2c(t, h, y);
    if (strcmp(name, "cg3") == 0) return crouch_grossman(t, h, y);
    if (strcmp(name, "cf4") == 0 || strcmp(name, "cf43") == 0) return cf4(t, h, y, embedded);
    if (strcmp(name, "cf32a") == 0) return cf32a(t, h, y, embedded);
    if (strcmp(name, "cf32b") == 0) return cf32b(t, h, y, embedded);
    fail_msg("no independent implementation of %s", name);
    return *y;
}

static bool on_the_chain(const lg_scheme *scheme) {
    return scheme->kind == LG_SCHEME_RKMK || scheme->kind == LG_SCHEME_COMMUTATOR_FREE ||
           scheme->kind == LG_SCHEME_IMPLICIT;
}

static double distance(const double *y, const alg *e) {
    double worst = 0.0;
    for (int i = 0; i < CHAIN_DIM; i++) worst = fmax(worst, fabs(y[i] - (double)e->x[i]));
    return isnan(worst) ? INFINITY : worst;
}

/* One step of a scheme from the start, at a time where gravity swings. */
static double step_error(const lg_scheme *scheme, double h, const alg *e, double *error) {
    double y[CHAIN_DIM];
    const lg_ode ode = chain_ode(scheme, &swing);
    lg_stepper *stepper = test_stepper(scheme, &ode);
    chain_start(y);
    assert_ok(lg_step(stepper, 0.3, h, y, NULL, y));
    if (error && lg_stepper_error(stepper))
        memcpy(error, lg_stepper_error(stepper), CHAIN_DIM * sizeof(*error));
    return distance(y, e);
}

TEST("every scheme's single step is an independent one, in long double") {
    double start[CHAIN_DIM];
    alg y;
    chain_start(start);
    widen(CHAIN_DIM, start, y.x);
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        if (!on_the_chain(scheme)) continue;
        for (double h = 0.02; h > -0.03; h -= 0.04) { /* forward and backward */
            double error[CHAIN_DIM];
            alg embedded;
            const alg e = expected(scheme->name, 0.3, h, &y, &embedded);
            const double off = step_error(scheme, h, &e, error);
            print_message("  %-15s h = %5.2f: %.2g\n", scheme->name, h, off);
            assert_true(off <= 1e-12);
            if (scheme->kind != LG_SCHEME_COMMUTATOR_FREE || scheme->embedded_order == 0) continue;
            for (int j = 0; j < CHAIN_DIM; j++)
                assert_close(error[j], (double)(e.x[j] - embedded.x[j]), 0.0, 1e-14);
        }
    }
}

TEST("any truncation of dexpinv, by changing a row") {
    double start[CHAIN_DIM];
    alg y;
    chain_start(start);
    widen(CHAIN_DIM, start, y.x);
    for (int K = LG_DEXPINV_EXACT; K <= LG_DEXPINV_MAX; K++) {
        lg_scheme scheme = *lg_scheme_find("rkmk5");
        scheme.dexpinv = K;
        const alg e = rkmk(&dormand_prince, K, NULL, 0, 0.3, 0.2, &y);
        assert_true(step_error(&scheme, 0.2, &e, NULL) <= 1e-12);
    }
    /* The terms are there: one less is another step. */
    lg_scheme scheme = *lg_scheme_find("rkmk5");
    scheme.dexpinv = 4;
    const alg e = rkmk(&dormand_prince, 2, NULL, 0, 0.3, 0.2, &y);
    assert_true(step_error(&scheme, 0.2, &e, NULL) > 1e-9);
}

TEST("the embedded difference in the algebra, mapped by the generator at the end") {
    static const real difference[7] = {71.0L / 57600,      0,           -71.0L / 16695, 71.0L / 1920,
                                       -17253.0L / 339200, 22.0L / 525, -1.0L / 40};
    const tableau *T = &dormand_prince;
    const real h = 0.1L, t = 0.3L;
    double start[CHAIN_DIM], error[CHAIN_DIM];
    alg y, k[7], sigma = {{0}}, end, v;
    chain_start(start);
    widen(CHAIN_DIM, start, y.x);
    for (int i = 0; i < 7; i++) {
        const real *a = i < 6 ? T->a[i] : T->b;
        sigma = lin(h, i, a, k);
        end = act(&sigma, &y);
        const alg f = field(t + h * row_sum(a, i), &end);
        k[i] = dexpinv(-1, &sigma, &f);
    }
    assert_true(step_error(lg_scheme_find("rkmk54"), 0.1, &end, error) <= 1e-13);
    sigma = lin(h, 7, difference, k);
    chain_velocity_l(end.x, sigma.x, v.x);
    for (int i = 0; i < CHAIN_DIM; i++) assert_close(error[i], (double)v.x[i], 1e-10, 1e-15);
}

/* ---- a user's own schemes ---- */

static double uniform(lg_rng *rng) {
    return 2.0 * lg_rng_uniform(rng) - 1.0;
}

/* Explicit, c the row sums, weights that sum to 1, perhaps commutators, any truncation. */
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

TEST("random tableaux with brackets and truncations are those of long double") {
    lg_rng rng;
    double start[CHAIN_DIM], worst = 0.0;
    alg y;
    lg_rng_seed(&rng, 5, 0);
    chain_start(start);
    widen(CHAIN_DIM, start, y.x);
    for (int repeat = 0; repeat < 40; repeat++) {
        lg_commutator list[4];
        const lg_scheme s = random_rkmk(&rng, 1 + repeat % LG_SCHEME_MAX_STAGES, list);
        tableau T = {.stages = s.stages};
        for (int i = 0; i < s.stages; i++) {
            T.b[i] = s.b[i];
            for (int j = 0; j < i; j++) T.a[i][j] = s.a[i][j];
        }
        const alg e = rkmk(&T, s.dexpinv, list, s.commutator_count, 0.3, 0.02, &y);
        worst = fmax(worst, step_error(&s, 0.02, &e, NULL));
        lg_scheme plain = s;
        plain.ambient = true, plain.dexpinv = 0, plain.commutator_count = 0;
        const alg classic = explicit_rk(&T, 0.3, 0.02, &y);
        worst = fmax(worst, step_error(&plain, 0.02, &classic, NULL));
    }
    print_message("  random tableaux: %.2g\n", worst);
    assert_true(worst <= 1e-12);
}

/* One row: any earlier base, up to four exponentials; c is what they add up to. */
static void random_row(lg_rng *rng, int known, const double *c, double time, bool fixed, lg_cf_row *row,
                       double *total) {
    row->base = (int)((known + 1) * lg_rng_uniform(rng)) - 1;
    row->exponentials = known == 0 ? 0 : 1 + (int)(LG_SCHEME_MAX_EXPONENTIALS * lg_rng_uniform(rng));
    *total = row->base < 0 ? 0.0 : c[row->base];
    for (int e = 0; e < row->exponentials; e++)
        for (int j = 0; j < known; j++) *total += row->coefficient[e][j] = 0.5 * uniform(rng);
    if (fixed) row->coefficient[0][0] += time - *total, *total = time;
}

static alg cf_point(const lg_cf_row *row, int stages, real h, const alg *y, const alg *points, const alg *f) {
    alg point = row->base < 0 ? *y : points[row->base];
    for (int e = 0; e < row->exponentials; e++) {
        real c[LG_SCHEME_MAX_STAGES];
        widen((size_t)stages, row->coefficient[e], c);
        point = exp_of(h, stages, c, f, &point);
    }
    return point;
}

TEST("random commutator-free schemes are those of long double") {
    lg_rng rng;
    double start[CHAIN_DIM], worst = 0.0;
    alg y;
    lg_rng_seed(&rng, 6, 0);
    chain_start(start);
    widen(CHAIN_DIM, start, y.x);
    for (int repeat = 0; repeat < 32; repeat++) {
        const int stages = 1 + repeat % LG_SCHEME_MAX_STAGES;
        lg_cf_row rows[LG_SCHEME_MAX_STAGES + 2] = {{0}};
        lg_scheme s = {.name = "mine", .kind = LG_SCHEME_COMMUTATOR_FREE, .order = 2, .stages = stages};
        double end;
        alg points[LG_SCHEME_MAX_STAGES], f[LG_SCHEME_MAX_STAGES] = {{{0}}};
        s.embedded_order = 1, s.rows = rows;
        for (int i = 0; i < stages; i++) {
            random_row(&rng, i, s.c, 0.0, false, &rows[i], &s.c[i]);
            points[i] = cf_point(&rows[i], i, 0.02L, &y, points, f);
            f[i] = field(0.3L + 0.02L * s.c[i], &points[i]);
        }
        for (int i = 0; i < 2; i++) random_row(&rng, stages, s.c, 1.0, true, &rows[stages + i], &end);
        const alg e = cf_point(&rows[stages], stages, 0.02L, &y, points, f),
                  embedded = cf_point(&rows[stages + 1], stages, 0.02L, &y, points, f);
        double error[CHAIN_DIM];
        worst = fmax(worst, step_error(&s, 0.02, &e, error));
        for (int j = 0; j < CHAIN_DIM; j++)
            worst = fmax(worst, fabs(error[j] - (double)(e.x[j] - embedded.x[j])));
    }
    print_message("  random commutator-free schemes: %.2g\n", worst);
    assert_true(worst <= 1e-12);
}

/* ---- splitting, variational ---- */

TEST("splitting schemes by hand") {
    const double h = 0.02;
    double y[4] = {0.4, -0.7, 0.3, 0.6}, e[4], f[2], out[4];
    lg_ode ode = {.field = quartic_field, .force = quartic_force, .velocity = quartic_velocity};
    assert_ok(lg_space_init_rn(&ode.space, 4));
    memcpy(e, y, sizeof(e));
    (void)quartic_force(NULL, 0, e, NULL, f);
    for (int i = 0; i < 2; i++) e[2 + i] += h * f[i], e[i] += h * e[2 + i];
    lg_stepper *stepper = test_stepper(lg_scheme_find("symplectic-euler"), &ode);
    assert_ok(lg_step(stepper, 0.0, h, y, NULL, out));
    for (int i = 0; i < 4; i++) assert_close(out[i], e[i], 0.0, 1e-15);
    memcpy(e, y, sizeof(e));
    for (int half = 0; half < 2; half++) {
        (void)quartic_force(NULL, 0, e, NULL, f);
        for (int i = 0; i < 2; i++) e[2 + i] += h / 2 * f[i];
        for (int i = 0; half == 0 && i < 2; i++) e[i] += h * e[2 + i];
    }
    stepper = test_stepper(lg_scheme_find("stormer-verlet"), &ode);
    assert_ok(lg_step(stepper, 0.0, h, y, NULL, out));
    for (int i = 0; i < 4; i++) assert_close(out[i], e[i], 0.0, 1e-15);
}

static lg_status variational(void *user, double t, double h, double *y) {
    if (user) return *(lg_status *)user;
    y[0] += h * t;
    return LG_OK;
}

TEST("a variational step is the system's own") {
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
    assert_ok(lg_step(stepper, 3.0, 0.5, y, NULL, y));
    assert_close(y[0], 0.6 + 1.5, 1e-15, 0.0);
    assert_int_equal(lg_stepper_evaluations(stepper), 1);
    ode.user = &failure;
    stepper = test_stepper(scheme, &ode);
    assert_status(lg_step(stepper, 3.0, 0.5, y, NULL, y), LG_NO_CONVERGENCE);
    assert_close(y[0], 0.6 + 1.5, 1e-15, 0.0);
}

/* ---- implicit schemes ---- */

/* A stiff linear problem, and its exact step. */
static lg_status stiff_field(void *user, double t, const double *y, const double *input, double *out) {
    out[0] = -1e6 * (y[0] - t);
    out[1] = y[0] - y[1];
    return LG_OK;
}

/* y' = y^2 + 1e3: the implicit Euler stage is real for small steps only */
static lg_status unsolvable_field(void *user, double t, const double *y, const double *input, double *out) {
    out[0] = y[0] * y[0] + 1e3;
    return LG_OK;
}

TEST("implicit steps are exact on stiff problems, or do not converge") {
    double y[2] = {1.0, 2.0}, out[2];
    lg_ode ode = {.field = stiff_field};
    assert_ok(lg_space_init_rn(&ode.space, 2));
    lg_stepper *stepper = test_stepper(lg_scheme_find("implicit-euler"), &ode);
    assert_ok(lg_step(stepper, 0.5, 0.1, y, NULL, out));
    const double first = (1.0 + 1e5 * 0.6) / (1.0 + 1e5);
    assert_close(out[0], first, 1e-12, 0.0);
    assert_close(out[1], (2.0 + 0.1 * first) / 1.1, 1e-12, 0.0);
    y[0] = y[1] = 0.0; /* from the origin */
    assert_ok(lg_step(stepper, 0.0, 0.1, y, NULL, out));
    assert_close(out[0], 1e5 * 0.1 / (1.0 + 1e5), 1e-12, 0.0);
    ode.field = unsolvable_field;
    assert_ok(lg_space_init_rn(&ode.space, 1));
    stepper = test_stepper(lg_scheme_find("implicit-euler"), &ode);
    y[0] = out[0] = 0.5;
    assert_status(lg_step(stepper, 0.0, 1.0, y, NULL, out), LG_NO_CONVERGENCE);
    assert_true(out[0] == 0.5);
    assert_ok(lg_step(stepper, 0.0, 1e-3, y, NULL, out)); /* 1e-3 Y^2 - Y + 1.5 = 0 */
    assert_close(out[0], (1.0 - sqrt(1.0 - 4e-3 * 1.5)) / 2e-3, 1e-12, 0.0);
}

/* ---- symplectic Lie group integrators: the residual of 6 equations in long double ---- */

/* sum_k sign^k ad_u^k b/(k + shift)!: shift 0 exp, 1 dexp */
static void so3_series(int shift, real sign, const real *u, const real *b, real *out) {
    real term[3] = {b[0], b[1], b[2]}, sum[3] = {b[0], b[1], b[2]};
    for (int k = 1; k < 60; k++) {
        cross_l(u, term, term);
        for (int i = 0; i < 3; i++) term[i] *= sign / (k + shift), sum[i] += term[i];
    }
    memcpy(out, sum, sizeof(sum));
}

/* Ad_{exp(u)}^* on so(3)* */
static void coadjoint(const real *u, const real *mu, real *out) {
    so3_series(0, -1.0L, u, mu, out);
}

/* dexp_{-u}^* */
static void dexp_minus_star(const real *u, const real *mu, real *out) {
    so3_series(1, 1.0L, u, mu, out);
}

static void rotate_columns(const real *u, const real *Q, real *out) {
    for (int j = 0; j < 3; j++) {
        real column[3] = {Q[j], Q[3 + j], Q[6 + j]};
        so3_series(0, 1.0L, u, column, column);
        for (int i = 0; i < 3; i++) out[3 * i + j] = column[i];
    }
}

static void slgi_residual(real theta, real h, const real *y, const real *z, real *r) {
    real turn[3], point[12], b[3], sum[3], c[3], f[6];
    for (int i = 0; i < 3; i++) turn[i] = theta * z[i];
    rotate_columns(turn, y, point);
    coadjoint(turn, z + 3, b);
    for (int i = 0; i < 3; i++) sum[i] = y[9 + i] + b[i];
    dexp_minus_star(z, sum, sum);
    dexp_minus_star(turn, b, c);
    for (int i = 0; i < 3; i++) point[9 + i] = sum[i] - theta * c[i];
    top_l(point, f);
    for (int i = 0; i < 6; i++) r[i] = z[i] - h * f[i];
}

static void gauss(real a[6][7]) {
    for (int k = 0; k < 6; k++) {
        int p = k;
        for (int i = k; i < 6; i++)
            if (fabsl(a[i][k]) > fabsl(a[p][k])) p = i;
        for (int j = 0; j < 7; j++) {
            const real swap = a[k][j];
            a[k][j] = a[p][j], a[p][j] = swap;
        }
        for (int i = 0; i < 6; i++) {
            const real factor = a[i][k] / a[k][k];
            for (int j = k; j < 7 && i != k; j++) a[i][j] -= factor * a[k][j];
        }
    }
    for (int k = 0; k < 6; k++) a[k][6] /= a[k][k];
}

/* By continuation from short steps, full Newton with central differences. */
static void slgi_step(real theta, real h, real *y) {
    enum { PARTS = 12 };
    real z[6] = {0}, r[6], up[6], down[6], a[6][7];
    for (int part = 1; part <= PARTS; part++) {
        for (int i = 0; i < 6 && part > 1; i++) z[i] *= (real)part / (part - 1);
        for (int iteration = 0; iteration < (part < PARTS ? 4 : 12); iteration++) {
            const real hp = h * part / PARTS;
            slgi_residual(theta, hp, y, z, r);
            for (int j = 0; j < 6; j++) {
                const real keep = z[j], delta = 1e-7L;
                z[j] = keep + delta, slgi_residual(theta, hp, y, z, up);
                z[j] = keep - delta, slgi_residual(theta, hp, y, z, down);
                z[j] = keep;
                for (int i = 0; i < 6; i++) a[i][j] = (up[i] - down[i]) / (2 * delta);
            }
            for (int i = 0; i < 6; i++) a[i][6] = r[i];
            gauss(a);
            for (int i = 0; i < 6; i++) z[i] -= a[i][6];
        }
    }
    real u[3], Q[9], mu[3], n[3], minus[3];
    for (int i = 0; i < 3; i++) u[i] = (theta - 1.0L) * z[i], minus[i] = -z[i];
    rotate_columns(z, y, Q);
    coadjoint(minus, y + 9, mu);
    coadjoint(u, z + 3, n);
    memcpy(y, Q, sizeof(Q));
    for (int i = 0; i < 3; i++) y[9 + i] = mu[i] + n[i];
}

static lg_stepper *top_stepper(double theta, lg_field f, bool quadratic, lg_scheme *scheme) {
    lg_ode ode = {.field = f};
    *scheme = *lg_scheme_find("slgi");
    scheme->theta = theta;
    assert_ok(lg_space_init(&ode.space, (lg_space_factor[]){{LG_SPACE_SE3, 1}, {LG_SPACE_RN, 6}},
                            quadratic ? 2 : 1));
    return test_stepper(scheme, &ode);
}

TEST("slgi solves its six equations in long double") {
    static const double thetas[] = {0.0, 0.3, 0.5, 1.0}, steps[] = {0.005, 0.01, 0.02};
    for (size_t i = 0; i < 4; i++) {
        for (size_t k = 0; k < 3; k++) {
            lg_scheme scheme;
            double y[12], worst = 0.0;
            real e[12];
            top_start(150.0, y);
            widen(12, y, e);
            lg_stepper *stepper = top_stepper(thetas[i], top_field, false, &scheme);
            for (int n = 0; n < 10; n++) {
                assert_ok(lg_step(stepper, 0.0, steps[k], y, NULL, y));
                slgi_step(thetas[i], steps[k], e);
            }
            for (int j = 0; j < 12; j++) worst = fmax(worst, fabs(y[j] - (double)e[j]));
            print_message(
                "  theta = %.1f, h = %.3f: %.2g after 10 steps, %.1f evaluations a step, angle %.2f\n",
                thetas[i], steps[k], worst, (double)lg_stepper_evaluations(stepper) / 10.0,
                lg_stepper_angle(stepper));
            assert_true(worst <= 1e-11);
        }
    }
}

TEST("the quadratic form with theta = 1/2 has the (Q, pi) of the cotangent form; its p stays") {
    lg_scheme scheme[2];
    double y[12], x[18] = {0};
    top_start(150.0, y);
    memcpy(x, y, sizeof(y));
    x[16] = -30.0;
    lg_stepper *top = top_stepper(0.5, top_field, false, &scheme[0]),
               *quadratic = top_stepper(0.5, top_quadratic_field, true, &scheme[1]);
    for (int n = 0; n < 50; n++) {
        assert_ok(lg_step(top, 0.0, 0.01, y, NULL, y));
        assert_ok(lg_step(quadratic, 0.0, 0.01, x, NULL, x));
    }
    for (int i = 0; i < 12; i++) assert_close(x[i], y[i], 0.0, 1e-10);
    assert_true(x[15] == 0.0 && x[16] == -30.0 && x[17] == 0.0);
    assert_true(fabs(x[12]) + fabs(x[13]) + fabs(x[14]) > 1e-3);
    assert_close(lg_stepper_angle(quadratic), lg_stepper_angle(top), 1e-12, 0.0);
}

/* T*(R^m) inside: with SO(3) at rest the rule theta = 1/2 is the midpoint rule. */
static lg_status resting_field(void *user, double t, const double *y, const double *input, double *out) {
    memset(out, 0, 6 * sizeof(*out));
    out[6] = y[13], out[7] = -sin(y[12]);
    return LG_OK;
}

static lg_status pendulum_field(void *user, double t, const double *y, const double *input, double *out) {
    out[0] = y[1], out[1] = -sin(y[0]);
    return LG_OK;
}

TEST("slgi on R^m is the midpoint rule") {
    double x[14] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0.3, 0.2, 0.1, 0.4, 0.9}, y[2] = {0.4, 0.9};
    lg_ode ode = {.field = resting_field}, plain = {.field = pendulum_field};
    assert_ok(lg_space_init(&ode.space, (lg_space_factor[]){{LG_SPACE_SE3, 1}, {LG_SPACE_RN, 2}}, 2));
    assert_ok(lg_space_init_rn(&plain.space, 2));
    lg_stepper *slgi = test_stepper(lg_scheme_find("slgi"), &ode),
               *midpoint = test_stepper(lg_scheme_find("midpoint"), &plain);
    for (int n = 0; n < 20; n++) {
        assert_ok(lg_step(slgi, 0.0, 0.2, x, NULL, x));
        assert_ok(lg_step(midpoint, 0.0, 0.2, y, NULL, y));
    }
    for (int i = 0; i < 2; i++) assert_close(x[12 + i], y[i], 1e-13, 0.0);
    assert_close(x[10], 0.2, 1e-15, 0.0);
}

TEST("theta = 0 is symplectic Euler with p first, theta = 1 with q first") {
    const double h = 0.2;
    for (int theta = 0; theta < 2; theta++) {
        double x[14] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0.3, 0.2, 0.1, 0.4, 0.9}, q = 0.4, p = 0.9;
        lg_ode ode = {.field = resting_field};
        lg_scheme scheme = *lg_scheme_find("slgi");
        scheme.theta = theta;
        assert_ok(lg_space_init(&ode.space, (lg_space_factor[]){{LG_SPACE_SE3, 1}, {LG_SPACE_RN, 2}}, 2));
        lg_stepper *stepper = test_stepper(&scheme, &ode);
        for (int n = 0; n < 20; n++) {
            assert_ok(lg_step(stepper, 0.0, h, x, NULL, x));
            if (theta == 1) q += h * p;
            p -= h * sin(q);
            if (theta == 0) q += h * p;
        }
        assert_close(x[12], q, 1e-13, 0.0);
        assert_close(x[13], p, 1e-13, 0.0);
    }
}

static lg_status nan_field(void *user, double t, const double *y, const double *input, double *out) {
    for (int i = 0; i < 6; i++) out[i] = NAN;
    return LG_OK;
}

TEST("spaces and fields that slgi cannot take are refused") {
    static const lg_space_factor unfit[][2] = {{{LG_SPACE_TS2, 1}, {LG_SPACE_RN, 2}},
                                               {{LG_SPACE_SE3, 2}, {LG_SPACE_RN, 2}},
                                               {{LG_SPACE_SE3, 1}, {LG_SPACE_RN, 3}},
                                               {{LG_SPACE_RN, 2}, {LG_SPACE_SE3, 1}}};
    lg_scheme scheme;
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
    stepper = top_stepper(0.5, nan_field, false, &scheme);
    assert_status(lg_step(stepper, 0.0, 0.01, y, NULL, y), LG_NOT_FINITE);
    assert_memory_equal(y, before, sizeof(y));
}
