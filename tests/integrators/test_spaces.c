/* Checks the same properties for every kind of space: axioms of the action, generator, bracket, projections,
 * and the drift from the manifold in 10^5 steps. test_geometry compares the maps of the groups with matrix
 * functions.
 * ctest-labels: src/integrators */
#include "fields.h"
#include "support/fixtures.h"

#include "liegrad/geometry.h"
#include "liegrad/taped.h"
#include "integrators/stepper.h"

#define PI 3.14159265358979323846

enum { COPIES = 11, MAX_STATE = 12 * COPIES, MAX_ALGEBRA = 6 * COPIES };

static const double angles[] = {0.0, 1e-9, 1e-4, 1.0, 1.99, 2.01, 3.0, PI - 1e-9, PI, 2.0 * PI - 1e-3};
#define ANGLES (sizeof(angles) / sizeof(angles[0]))

static void random_vector(lg_rng *rng, size_t n, double *x) {
    for (size_t i = 0; i < n; i++) x[i] = lg_rng_uniform_in(rng, -1.0, 1.0);
}

/* ---- kinds of spaces ---- */

static void random_ts2(lg_rng *rng, double *y) {
    random_vector(rng, 6, y);
    const double norm = sqrt(lg_dot3(y, y));
    for (int i = 0; i < 3; i++) y[i] /= norm;
    const double along = lg_dot3(y, y + 3);
    for (int i = 0; i < 3; i++) y[3 + i] -= along * y[i];
}

static void random_rotation(lg_rng *rng, double *y) {
    double u[3];
    random_vector(rng, 3, u);
    for (int i = 0; i < 3; i++) u[i] *= 3.0;
    lg_so3_exp(u, y);
}

static void random_motion(lg_rng *rng, double *y) {
    random_rotation(rng, y);
    random_vector(rng, 3, y + 9);
}

static void random_3(lg_rng *rng, double *y) {
    random_vector(rng, 3, y);
}

static void random_6(lg_rng *rng, double *y) {
    random_vector(rng, 6, y);
}

static const struct space_case {
    lg_space_kind kind;
    size_t state, algebra;
    void (*point)(lg_rng *rng, double *y);
    bool constrained;
} cases[] = {
    {LG_SPACE_TS2, 6, 6, random_ts2, true},     {LG_SPACE_SO3, 9, 3, random_rotation, true},
    {LG_SPACE_SE3, 12, 6, random_motion, true}, {LG_SPACE_SO3_DUAL, 3, 3, random_3, false},
    {LG_SPACE_SE3_DUAL, 6, 6, random_6, false},
};
#define CASES (sizeof(cases) / sizeof(cases[0]))

typedef struct fixture {
    const struct space_case *of;
    const lg_space_entry *row;
    lg_space space;
    size_t dim, algebra; /* of all copies together */
    lg_rng rng;
} fixture;

static fixture make(const struct space_case *c, size_t copies) {
    fixture f = {.of = c, .row = lg_space_kind_entry(c->kind)};
    assert_ok(lg_space_init(&f.space, &(lg_space_factor){c->kind, copies}, 1));
    f.dim = c->state * copies;
    f.algebra = c->algebra * copies;
    lg_rng_seed(&f.rng, 40 + c->kind, 0);
    return f;
}

static void random_point(fixture *f, double *y) {
    for (size_t at = 0; at < f->dim; at += f->of->state) f->of->point(&f->rng, y + at);
}

/* A random element in which the rotation of each copy has this angle. */
static void random_element(fixture *f, double angle, double *a) {
    random_vector(&f->rng, f->algebra, a);
    for (size_t at = 0; at < f->algebra; at += f->of->algebra) {
        const double norm = sqrt(lg_dot3(a + at, a + at));
        for (int i = 0; i < 3; i++) a[at + (size_t)i] *= angle / norm;
    }
}

static void scaled(const fixture *f, double c, const double *a, double *out) {
    for (size_t i = 0; i < f->algebra; i++) out[i] = c * a[i];
}

/* ---- properties ---- */

TEST("every kind of space has the right dimensions") {
    for (size_t k = 0; k < CASES; k++) {
        fixture f = make(&cases[k], COPIES);
        assert_true(f.row->state == cases[k].state && f.row->algebra == cases[k].algebra && !f.row->abelian);
        assert_true(f.space.dim == f.dim && f.space.algebra_dim == f.algebra &&
                    !lg_space_is_abelian(&f.space));
    }
}

/* exp(0) y = y, exp(-a) exp(a) y = y, exp(.7 a) exp(.3 a) y = exp(a) y, also in place. |u| must be the result
 * of lg_space_angle. */
TEST("every action is a group action: exp(0) = 1, exp(-a) exp(a) = 1, exp(sa) exp(ta) = exp((s + t)a)") {
    for (size_t k = 0; k < CASES; k++)
        for (size_t n = 0; n < ANGLES; n++) {
            fixture f = make(&cases[k], COPIES);
            double a[MAX_ALGEBRA], part[MAX_ALGEBRA], y[MAX_STATE], out[MAX_STATE], back[MAX_STATE];
            random_point(&f, y);
            random_element(&f, angles[n], a);
            assert_close(lg_space_angle(&f.space, a), angles[n], 1e-15, 0.0);
            lg_space_act(&f.space, a, y, out);
            scaled(&f, -1.0, a, part);
            lg_space_act(&f.space, part, out, back);
            assert_all_close(back, y, f.dim, 0.0, 1e-14);
            scaled(&f, 0.3, a, part);
            lg_space_act(&f.space, part, y, back);
            scaled(&f, 0.7, a, part);
            lg_space_act(&f.space, part, back, back);
            assert_all_close(back, out, f.dim, 0.0, 1e-14);
            scaled(&f, 0.0, a, part);
            lg_space_act(&f.space, part, y, out);
            /* points have rounding errors, which the action may correct */
            assert_all_close(out, y, f.dim, 0.0, 1e-15);
        }
}

TEST("the bits of a copy's result do not depend on its place or on the number of copies") {
    for (size_t k = 0; k < CASES; k++)
        for (size_t copies = 1; copies <= COPIES; copies++) {
            fixture f = make(&cases[k], copies);
            double a[MAX_ALGEBRA], b[MAX_ALGEBRA], y[MAX_STATE], out[MAX_STATE], one[MAX_STATE],
                x[MAX_ALGEBRA];
            random_point(&f, y);
            random_vector(&f.rng, f.algebra, a);
            random_vector(&f.rng, f.algebra, b);
            /* too large for the series of the fast kernels; the angles of its neighbours are not */
            a[0] = 2.5;
            lg_space_act(&f.space, a, y, out);
            lg_space_dexpinv(&f.space, LG_DEXPINV_EXACT, a, b, x);
            const lg_space_entry *row = f.row;
            for (size_t i = 0; i < copies; i++) {
                row->act(1, a + i * row->algebra, y + i * row->state, one);
                assert_memory_equal(one, out + i * row->state, row->state * sizeof(*one));
                row->dexpinv(1, a + i * row->algebra, b + i * row->algebra, one);
                assert_memory_equal(one, x + i * row->algebra, row->algebra * sizeof(*one));
            }
        }
}

TEST("the generator is the derivative of the action, and is tangent") {
    for (size_t k = 0; k < CASES; k++) {
        fixture f = make(&cases[k], 3);
        double a[MAX_ALGEBRA], part[MAX_ALGEBRA], y[MAX_STATE], g[MAX_STATE], plus[MAX_STATE],
            minus[MAX_STATE];
        random_point(&f, y);
        random_element(&f, 1.0, a);
        lg_space_generator(&f.space, a, y, g);
        scaled(&f, 1e-5, a, part);
        lg_space_act(&f.space, part, y, plus);
        scaled(&f, -1e-5, a, part);
        lg_space_act(&f.space, part, y, minus);
        for (size_t i = 0; i < f.dim; i++) assert_close((plus[i] - minus[i]) / 2e-5, g[i], 0.0, 2e-10);
        memcpy(plus, g, f.dim * sizeof(*g));
        lg_space_project_gradient(&f.space, y, plus);
        assert_all_close(plus, g, f.dim, 0.0, 3e-15);
        lg_space_generator(&f.space, a, y, y); /* out may be the input */
        assert_all_close(y, g, f.dim, 0.0, 0.0);
    }
}

/* Antisymmetry and Jacobi's identity. With the action: exp(a) exp(b) exp(-a) = exp(Ad b), and the bracket is
 * the commutator of the flows to second order. */
TEST("every bracket is antisymmetric, a derivation, and the commutator of the flows") {
    for (size_t k = 0; k < CASES; k++) {
        fixture f = make(&cases[k], COPIES);
        double v[5][MAX_ALGEBRA], x[MAX_ALGEBRA], sum[MAX_ALGEBRA] = {0}, y[MAX_STATE], z[MAX_STATE];
        for (int i = 0; i < 3; i++) random_vector(&f.rng, f.algebra, v[i]);
        memcpy(v[3], v[0], sizeof(v[0]));
        memcpy(v[4], v[1], sizeof(v[1]));
        for (int i = 0; i < 3; i++) {
            lg_space_bracket(&f.space, v[i + 1], v[i + 2], x);
            lg_space_bracket(&f.space, v[i], x, x);
            for (size_t j = 0; j < f.algebra; j++) sum[j] += x[j];
        }
        for (size_t j = 0; j < f.algebra; j++) assert_close(sum[j], 0.0, 0.0, 1e-15);
        random_point(&f, y);
        const double e = 1e-4;
        memcpy(z, y, sizeof(z));
        const double signs[4] = {-e, -e, e, e};
        for (int i = 0; i < 4; i++) { /* exp(ea) exp(eb) exp(-ea) exp(-eb) y = y + e^2 [a, b] . y + O(e^3) */
            scaled(&f, signs[i], v[1 - i % 2], x);
            lg_space_act(&f.space, x, z, z);
        }
        double g[MAX_STATE];
        lg_space_bracket(&f.space, v[0], v[1], x);
        lg_space_generator(&f.space, x, y, g);
        for (size_t i = 0; i < f.dim; i++) assert_close((z[i] - y[i]) / (e * e), g[i], 0.0, 5e-3);
    }
}

/* exp(a) (R, r) = (E R, E r + s) with (E, s) = exp(a). */
static void exp_multiply(const double a[6], const double from[12], double out[12]) {
    double E[9], s[3];
    lg_se3_exp(a, E, s);
    for (int i = 0; i < 3; i++) {
        out[9 + i] = lg_dot3(E + 3 * i, from + 9) + s[i];
        for (int j = 0; j < 3; j++)
            out[3 * i + j] = E[3 * i] * from[j] + E[3 * i + 1] * from[3 + j] + E[3 * i + 2] * from[6 + j];
    }
}

TEST("every action and dexpinv agrees with the group's, also in place") {
    for (size_t k = 0; k < CASES; k++)
        for (size_t n = 0; n < ANGLES; n++) {
            fixture f = make(&cases[k], COPIES);
            const double distance = fmin(1.0, 2.0 * PI - angles[n]); /* distance to the pole of dexpinv */
            double a[MAX_ALGEBRA], b[MAX_ALGEBRA], x[MAX_ALGEBRA], y[MAX_STATE], e[12];
            random_point(&f, y);
            random_element(&f, angles[n], a);
            random_vector(&f.rng, f.algebra, b);
            lg_space_dexpinv(&f.space, LG_DEXPINV_EXACT, a, b, x);
            double before[MAX_STATE];
            memcpy(before, y, sizeof y);
            lg_space_act(&f.space, a, y, y);
            for (size_t i = 0; i < COPIES; i++) {
                const double *u = a + i * f.of->algebra, *v = b + i * f.of->algebra;
                const double *from = before + i * f.of->state;
                if (f.of->state == 3) lg_so3_exp_act(u, from, e);
                if (f.of->state == 6) lg_se3_exp_act(u, from, e);
                if (f.of->state == 9) lg_so3_exp_multiply(u, from, e);
                if (f.of->state == 12) exp_multiply(u, from, e);
                assert_all_close(y + i * f.of->state, e, f.of->state, 0.0, 1e-14);
                (f.of->algebra == 3 ? lg_so3_dexpinv : lg_se3_dexpinv)(u, v, e);
                assert_all_close(x + i * f.of->algebra, e, f.of->algebra, 2e-14 / distance, 2e-14);
            }
            lg_space_dexpinv(&f.space, LG_DEXPINV_EXACT, a, b, b); /* out may be the input */
            assert_all_close(b, x, f.algebra, 0.0, 0.0);
        }
}

/* ---- a constant field ---- */

FIELD(constant_field, y) {
    const fixture *f = user;
    for (size_t i = 0; i < f->algebra; i++) out[i] = 0.1 * (double)(i % 5) - 0.2 + 0.05 * (double)(i % 3);
}

/* The largest factor of h f in an exponent if all f_i are equal. */
static double largest_share(const lg_scheme *scheme) {
    double largest = scheme->kind == LG_SCHEME_RKMK ? 1.0 : 0.0;
    for (int i = 0; scheme->kind == LG_SCHEME_RKMK && i < scheme->stages; i++)
        largest = fmax(largest, fabs(scheme->c[i]));
    const int rows = scheme->stages + 1 + (scheme->embedded_order > 0);
    for (int i = 0; scheme->kind == LG_SCHEME_COMMUTATOR_FREE && i < rows; i++) {
        for (int e = 0; e < scheme->rows[i].exponentials; e++) {
            double share = 0.0;
            for (int j = 0; j < scheme->stages; j++) share += scheme->rows[i].coefficient[e][j];
            largest = fmax(largest, fabs(share));
        }
    }
    return largest;
}

TEST("every scheme is exact for a constant field on every space, and reports its angle") {
    for (size_t k = 0; k < CASES; k++) {
        fixture f = make(&cases[k], 2);
        const lg_ode ode = {.space = f.space, .field = constant_field, .user = &f};
        double y[MAX_STATE], e[MAX_STATE], out[MAX_STATE], a[MAX_ALGEBRA], zeros[MAX_STATE] = {0};
        random_point(&f, y);
        assert_ok(constant_field(&f, 0.0, y, NULL, a));
        scaled(&f, 2.0, a, a);
        lg_space_act(&f.space, a, y, e);
        for (size_t s = 0; s < lg_scheme_count(); s++) {
            const lg_scheme *scheme = lg_scheme_at(s);
            if (scheme->ambient || largest_share(scheme) == 0.0) continue;
            lg_stepper *stepper = test_stepper(scheme, &ode);
            assert_ok(lg_stepper_step(stepper, 0.0, 2.0, y, NULL, out));
            assert_all_close(out, e, f.dim, 0.0, 1e-14);
            assert_close(lg_stepper_angle(stepper), largest_share(scheme) * lg_space_angle(&f.space, a),
                         1e-14, 0.0);
            if (scheme->embedded_order > 0) assert_all_close(stepper->error, zeros, f.dim, 0.0, 1e-14);
        }
    }
}

/* ---- projections ---- */

TEST("every projection gives a point of its manifold, and a NaN is noticed") {
    for (size_t k = 0; k < CASES; k++) {
        fixture f = make(&cases[k], COPIES);
        double y[MAX_STATE], off[MAX_STATE];
        random_point(&f, y);
        assert_true(lg_space_manifold_error(&f.space, y) <= 4e-15);
        for (size_t i = 0; i < f.dim; i++) off[i] = y[i] + lg_rng_uniform_in(&f.rng, -1e-3, 1e-3);
        if (f.of->constrained) assert_true(lg_space_manifold_error(&f.space, off) > 1e-4);
        lg_space_project(&f.space, off);
        assert_true(lg_space_manifold_error(&f.space, off) <= 2e-15);
        assert_all_close(off, y, f.dim, 0.0, 5e-3);
        off[f.dim - 1] = NAN; /* in p, r or R, which must all be checked */
        assert_true(isnan(lg_space_manifold_error(&f.space, off)));
    }
    lg_space space;
    double reflection[9] = {1, 0, 0, 0, 1, 0, 0, 0, -1};
    assert_ok(lg_space_init(&space, &(lg_space_factor){LG_SPACE_SO3, 1}, 1));
    assert_close(lg_space_manifold_error(&space, reflection), 2.0, 0.0, 0.0);
    double a[3] = {0.1, NAN, 0.2};
    assert_true(isnan(lg_space_angle(&space, a)));
}

/* Let P be the projection of gradients. For tangent t = a . y, g.t = (P g).t; P P = P; and P g is a tangent
 * vector: it keeps the constraints to first order. */
TEST("the projected gradient is tangent and has the same product with tangent vectors") {
    for (size_t k = 0; k < CASES; k++) {
        fixture f = make(&cases[k], COPIES);
        double y[MAX_STATE], g[MAX_STATE], p[MAX_STATE], pp[MAX_STATE], t[MAX_STATE], a[MAX_ALGEBRA],
            moved = 0.0;
        random_point(&f, y);
        random_vector(&f.rng, f.dim, g);
        memcpy(p, g, sizeof(g));
        lg_space_project_gradient(&f.space, y, p);
        for (int repeat = 0; repeat < 5; repeat++) {
            double before = 0.0, after = 0.0;
            random_vector(&f.rng, f.algebra, a);
            lg_space_generator(&f.space, a, y, t);
            for (size_t i = 0; i < f.dim; i++) {
                before += g[i] * t[i];
                after += p[i] * t[i];
            }
            assert_close(after, before, 0.0, 1e-14);
        }
        memcpy(pp, p, sizeof(p));
        lg_space_project_gradient(&f.space, y, pp);
        assert_all_close(pp, p, f.dim, 0.0, 2e-15);
        for (size_t i = 0; i < f.dim; i++) {
            moved = fmax(moved, fabs(p[i] - g[i]));
            t[i] = y[i] + 1e-6 * p[i];
        }
        assert_true(f.of->constrained ? moved > 0.1 : moved == 0.0);
        assert_true(lg_space_manifold_error(&f.space, t) < 2e-11);
    }
}

/* ---- drift ---- */

/* The largest manifold error, measured every 1000 steps, over 10^5 steps. All steps have the same |u|, so
 * that each has the same error of the coefficients. */
static double drift(fixture *f, const double *speed, bool turning, double *y) {
    enum { STEPS = 100000 };
    double a[12], worst = 0.0;
    memcpy(a, speed, f->algebra * sizeof(*a));
    for (int n = 1; n <= STEPS; n++) {
        if (turning)
            for (size_t i = 0; i < f->algebra; i++) a[i] = speed[i] * lg_rng_uniform_in(&f->rng, -1.0, 1.0);
        lg_space_act(&f->space, a, y, y);
        if (n % 1000 == 0) worst = fmax(worst, lg_space_manifold_error(&f->space, y));
    }
    return worst;
}

/* Makes v orthogonal to u and of the same size; otherwise r and p would grow along the axis of a screw
 * motion. */
static void bounded_orbit(double *a) {
    const double w = lg_dot3(a, a), rho = lg_dot3(a, a + 3);
    for (int i = 0; i < 3; i++) a[3 + i] = 0.3 * sqrt(w) * (a[3 + i] - rho / w * a[i]);
}

TEST("every action stays on its manifold over 10^5 steps") {
    static const double speeds[] = {1e-3, 0.05, 0.3, 1.0, 2.3};
    for (size_t k = 0; k < CASES; k++) {
        if (!cases[k].constrained) continue;
        double worst = 0.0;
        for (size_t s = 0; s < sizeof(speeds) / sizeof(speeds[0]); s++)
            for (int turning = 0; turning < 2; turning++) {
                fixture f = make(&cases[k], 1);
                double y[12], a[6];
                random_point(&f, y);
                random_element(&f, speeds[s], a);
                if (f.algebra == 6) bounded_orbit(a);
                worst = fmax(worst, drift(&f, a, turning != 0, y));
            }
        print_message("%-8s off by %.1e after 10^5 steps\n", lg_space_kind_entry(cases[k].kind)->name, worst);
        assert_true(worst <= 2e-14);
    }
}

/* A spherical pendulum (q, omega), and a body that turns with it: rotations of 0.05 to 0.6 per step. */
FIELD(turning_field, y) {
    for (int j = 0; j < 3; j++) {
        out[j] = y[3 + j];
        out[3 + j] = j == 2 ? 9.81 : 0.0;
        out[6 + j] = y[j] + y[3 + j];
    }
}

TEST("every Lie group scheme stays on the manifold over 10^5 steps") {
    enum { STEPS = 100000 };
    const lg_space_factor factors[] = {{LG_SPACE_TS2, 1}, {LG_SPACE_SO3, 1}};
    lg_ode ode = {.field = turning_field};
    assert_ok(lg_space_init(&ode.space, factors, 2));
    for (size_t k = 0; k < lg_scheme_count(); k++) {
        const lg_scheme *scheme = lg_scheme_at(k);
        double y[15] = {0.6, 0.0, 0.8, -0.8, 2.0, 0.6, 1, 0, 0, 0, 1, 0, 0, 0, 1}, worst = 0.0;
        if (scheme->ambient || (scheme->kind != LG_SCHEME_RKMK && scheme->kind != LG_SCHEME_COMMUTATOR_FREE))
            continue;
        lg_stepper *stepper = test_stepper(scheme, &ode);
        for (int n = 0; n < STEPS; n++) {
            assert_ok(lg_stepper_step(stepper, 0.05 * n, 0.05, y, NULL, y));
            if (n % 100 == 0 || n + 1 == STEPS) worst = fmax(worst, lg_space_manifold_error(&ode.space, y));
        }
        print_message("%-12s off by %.1e in 10^5 steps\n", scheme->name, worst);
        assert_true(worst <= 1e-13);
    }
}

/* SE(2) in SE(3): turning about e3 and moving in the plane, both as functions of the place. */
FIELD(plane, y) {
    const double turning = cos(y[9]) + y[0], f[6] = {0, 0, turning, y[10] * y[0], sin(y[9] + y[1]), 0};
    (void)user, (void)t, (void)input;
    memcpy(out, f, sizeof f);
}

TEST("every Lie group scheme keeps a motion of SE(2) in the plane exactly") {
    lg_ode ode = {.field = plane};
    size_t schemes = 0;
    assert_ok(lg_space_init(&ode.space, &(lg_space_factor){LG_SPACE_SE3, 1}, 1));
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        double y[12] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0.3, 0.2, 0};
        lg_stepper *stepper;
        if (lg_scheme_at(i)->ambient) continue;
        if (lg_stepper_create(NULL, lg_scheme_at(i), &ode, &stepper) != LG_OK) continue;
        lg_test_owns(stepper, release_stepper);
        for (int k = 0; k < 300; k++) assert_ok(lg_stepper_step(stepper, 0.0, 0.01, y, NULL, y));
        assert_true(y[2] == 0 && y[5] == 0 && y[6] == 0 && y[7] == 0 && y[8] == 1 && y[11] == 0);
        assert_true(fabs(y[1]) > 0.1);
        schemes++;
    }
    assert_true(schemes > 5);
}

/* With a fast and a slow top. */
TEST("slgi keeps a heavy top on T*SO(3) over 10^5 steps") {
    enum { STEPS = 100000 };
    lg_ode ode = {.field = top_field};
    assert_ok(lg_space_init(&ode.space, &(lg_space_factor){LG_SPACE_SE3, 1}, 1));
    for (int fast = 0; fast < 2; fast++) {
        double y[12], worst = 0.0;
        lg_stepper *stepper = test_stepper(lg_scheme_find("slgi"), &ode);
        top_start(fast ? 150.0 : 5.0, y);
        for (int n = 0; n < STEPS; n++) {
            assert_ok(lg_stepper_step(stepper, 0.01 * n, 0.01, y, NULL, y));
            if (n % 100 == 0) worst = fmax(worst, lg_space_manifold_error(&ode.space, y));
        }
        assert_true(worst <= 1e-13);
    }
}

TEST("the dual spaces keep |G|^2 and G.P, relative to |G|^2 and |G| |P|") {
    static const lg_space_kind kinds[] = {LG_SPACE_SO3_DUAL, LG_SPACE_SE3_DUAL};
    for (int k = 0; k < 2; k++) {
        fixture f = make(&cases[3 + k], 1);
        double y[6] = {0}, start[6] = {0}, a[6];
        assert_int_equal(cases[3 + k].kind, kinds[k]);
        random_point(&f, y);
        for (size_t i = 0; i < f.dim; i++) y[i] *= 5.0;
        memcpy(start, y, sizeof(y));
        random_element(&f, 1.0, a);
        for (size_t i = 3; i < f.algebra; i++) a[i] = 0.0;
        (void)drift(&f, a, false, y);
        const double norm = lg_dot3(start, start), size = sqrt(norm * lg_dot3(start + 3, start + 3));
        const double first = fabs(lg_dot3(y, y) / norm - 1.0);
        const double second = k == 0 ? 0.0 : fabs(lg_dot3(y, y + 3) - lg_dot3(start, start + 3)) / size;
        print_message("%-8s Casimirs off by %.1e and %.1e\n", f.row->name, first, second);
        assert_true(first <= 2e-13 && second <= 2e-13); /* a random walk; without k_low it would be 1e-12 */
    }
}

TEST("a start that is not on the manifold keeps its distance, since the action is linear") {
    lg_space space;
    double a[6] = {0.3, -0.2, 0.1, 0.5, 0.4, -0.3}, y[6] = {0.6, 0.0, 0.9, 0.3, 0.1, 0.2}, out[6], e[6];
    assert_ok(lg_space_init(&space, &(lg_space_factor){LG_SPACE_TS2, 1}, 1));
    lg_space_act(&space, a, y, out);
    lg_se3_exp_act(a, y, e);
    assert_all_close(out, e, 6, 0.0, 1e-15);
    double R[9], S[9];
    lg_so3_exp(a, R);
    for (int i = 0; i < 9; i++) R[i] *= 1.001;
    assert_ok(lg_space_init(&space, &(lg_space_factor){LG_SPACE_SO3, 1}, 1));
    lg_space_act(&space, a, R, S);
    lg_so3_exp_multiply(a, R, R);
    assert_all_close(S, R, 9, 0.0, 0.0);
    assert_close(lg_space_manifold_error(&space, S), 1.001 * 1.001 - 1.0, 0.0, 1e-15);
    double zero[6] = {0};
    assert_ok(lg_space_init(&space, &(lg_space_factor){LG_SPACE_SE3_DUAL, 1}, 1));
    lg_space_act(&space, a, zero, out);
    assert_all_close(out, zero, 6, 0.0, 0.0);
}

/* ---- tangent coordinates ---- */

enum { ROOM = LG_SPACE_MAX_FACTORS * 3 * LG_SPACE_MAX_STATE, PRODUCTS = 80 };

/* A product of factors of all kinds, at a state where every copy is difficult. */
typedef struct tangents {
    lg_space space;
    lg_rng rng;
    double y[ROOM], size; /* size: the largest number of y, at least 1 */
    double *basis;        /* (dim, tangent_dim) */
} tangents;

static void draw(lg_rng *rng, size_t n, double scale, double *x) {
    for (size_t i = 0; i < n; i++) x[i] = scale * lg_rng_uniform_in(rng, -1.0, 1.0);
}

/* Poles, directions near them, and directions with equal components, where the tangent frame changes. */
static void hard_direction(lg_rng *rng, double *q) {
    const uint64_t what = lg_rng_below(rng, 4), axis = lg_rng_below(rng, 3);
    random_vector(rng, 3, q);
    for (int i = 0; i < 3 && what > 0; i++) q[i] = what == 1 ? 0.0 : what == 2 ? 1e-9 * q[i] : 1.0;
    if (what < 3) q[axis] = q[axis] < 0.0 ? -1.0 : 1.0;
}

static void hard_rotation(lg_rng *rng, double *R) {
    double u[3];
    random_vector(rng, 3, u);
    const double angle = angles[lg_rng_below(rng, ANGLES)], norm = sqrt(lg_dot3(u, u));
    for (int i = 0; i < 3; i++) u[i] *= angle / norm;
    lg_so3_exp(u, R);
}

static void hard_copy(lg_rng *rng, lg_space_kind kind, double scale, double *y) {
    draw(rng, lg_space_kind_entry(kind)->state, scale, y);
    if (kind == LG_SPACE_TS2) hard_direction(rng, y);
    if (kind == LG_SPACE_SO3 || kind == LG_SPACE_SE3) hard_rotation(rng, y);
}

/* The first products consist of a single kind, one for each scale. */
static tangents *make_tangents(uint64_t number) {
    static const double scales[] = {1.0, 1e-9, 1e9, 0.0}; /* of places and momenta */
    tangents *t = lg_test_memory(sizeof *t);
    lg_space_factor factors[LG_SPACE_MAX_FACTORS];
    size_t count = 1, at = 0;
    lg_rng_seed(&t->rng, 60, number);
    const bool single = number < 4 * LG_SPACE_KINDS;
    if (!single) count += lg_rng_below(&t->rng, LG_SPACE_MAX_FACTORS);
    for (size_t f = 0; f < count; f++) {
        const uint64_t kind = single ? number / 4 : lg_rng_below(&t->rng, LG_SPACE_KINDS);
        factors[f] = (lg_space_factor){(lg_space_kind)kind, 1 + lg_rng_below(&t->rng, 3)};
    }
    assert_ok(lg_space_init(&t->space, factors, count));
    for (size_t f = 0; f < count; f++)
        for (size_t i = 0; i < factors[f].count; i++, at += lg_space_kind_entry(factors[f].kind)->state)
            hard_copy(&t->rng, factors[f].kind, scales[number % 4], t->y + at);
    lg_space_project(&t->space, t->y);
    t->size = 1.0;
    for (size_t i = 0; i < t->space.dim; i++) t->size = fmax(t->size, fabs(t->y[i]));
    t->basis = TEST_ARRAY(double, t->space.dim * t->space.tangent_dim);
    lg_space_basis(&t->space, t->y, t->basis);
    return t;
}

/* vector = basis c */
static void combine(const tangents *t, const double *c, double *vector) {
    const size_t r = t->space.tangent_dim;
    for (size_t i = 0; i < t->space.dim; i++) {
        vector[i] = 0.0;
        for (size_t j = 0; j < r; j++) vector[i] += t->basis[i * r + j] * c[j];
    }
}

static void column_of(const tangents *t, size_t j, double *out) {
    for (size_t i = 0; i < t->space.dim; i++) out[i] = t->basis[i * t->space.tangent_dim + j];
}

TEST("columns of a basis are tangent and have unit coordinates; every generator is a combination of them") {
    for (uint64_t number = 0; number < PRODUCTS; number++) {
        tangents *t = make_tangents(number);
        double column[ROOM], flat[ROOM], c[ROOM], a[ROOM];
        for (size_t j = 0; j < t->space.tangent_dim; j++) {
            column_of(t, j, column);
            lg_space_coordinates(&t->space, t->y, column, c);
            for (size_t i = 0; i < t->space.tangent_dim; i++)
                assert_close(c[i], i == j ? 1.0 : 0.0, 0.0, 1e-15 * t->size);
            memcpy(flat, column, sizeof flat);
            lg_space_project_gradient(&t->space, t->y, flat);
            assert_all_close(flat, column, t->space.dim, 0.0, 3e-15 * t->size);
        }
        draw(&t->rng, t->space.algebra_dim, 1.0, a);
        lg_space_generator(&t->space, a, t->y, flat);
        lg_space_coordinates(&t->space, t->y, flat, c);
        combine(t, c, column);
        assert_all_close(column, flat, t->space.dim, 0.0, 3e-15 * t->size);
    }
}

/* Differences of the constraints, which are polynomials of degree 2, at states of size 1. */
TEST("along the columns of a basis the constraints do not change to first order") {
    for (uint64_t number = 0; number < PRODUCTS; number++) {
        tangents *t = make_tangents(number);
        double column[ROOM], at[ROOM];
        for (size_t j = 0; j < t->space.tangent_dim && t->size < 2.0; j++) {
            column_of(t, j, column);
            for (size_t i = 0; i < t->space.dim; i++) at[i] = t->y[i] + 1e-5 * column[i];
            assert_true(lg_space_manifold_error(&t->space, at) < 5e-10);
        }
    }
}

TEST("the generator of a lifted vector is the vector") {
    for (uint64_t number = 0; number < PRODUCTS; number++) {
        tangents *t = make_tangents(number);
        double c[ROOM], vector[ROOM], a[ROOM], back[ROOM], *y = t->y, *v = vector;
        draw(&t->rng, t->space.tangent_dim, 1.0, c);
        combine(t, c, vector);
        for (size_t f = 0; f < t->space.factors; f++) {
            const lg_space_entry *row = lg_space_kind_entry(t->space.factor[f].kind);
            const size_t n = t->space.factor[f].count;
            assert_true((row->lift == NULL) == (row->tangent == row->state));
            if (row->lift != NULL) {
                row->lift(n, y, v, a);
                row->generator(n, a, y, back);
                assert_all_close(back, v, n * row->state, 0.0, 3e-15 * t->size);
            }
            y += n * row->state;
            v += n * row->state;
        }
    }
}

TEST("a retraction stays on the manifold, and its derivative at 0 is the vector") {
    for (uint64_t number = 0; number < PRODUCTS; number++) {
        tangents *t = make_tangents(number);
        double c[ROOM], vector[ROOM], step[ROOM] = {0}, sides[2][ROOM];
        lg_space_retract(&t->space, t->y, step, sides[0], NULL);
        assert_all_close(sides[0], t->y, t->space.dim, 0.0, 1e-15 * t->size);
        draw(&t->rng, t->space.tangent_dim, 1.0, c);
        combine(t, c, vector);
        for (int side = 0; side < 2; side++) {
            for (size_t i = 0; i < t->space.dim; i++) step[i] = (side == 0 ? 1e-5 : -1e-5) * vector[i];
            memcpy(sides[side], t->y, sizeof t->y);
            lg_space_retract(&t->space, sides[side], step, sides[side], NULL); /* in place */
            assert_true(lg_space_manifold_error(&t->space, sides[side]) <= 2e-15 * t->size);
        }
        for (size_t i = 0; i < t->space.dim; i++)
            assert_close((sides[0][i] - sides[1][i]) / 2e-5, vector[i], 0.0, 3e-10 * t->size);
    }
}

/* exp(a) is affine, so differences along whole columns are exact. */
TEST("a retraction also gives the basis columns moved by the group, in coordinates at the new point") {
    for (uint64_t number = 0; number < PRODUCTS; number++) {
        tangents *t = make_tangents(number);
        const size_t r = t->space.tangent_dim, d = t->space.dim;
        double c[ROOM], vector[ROOM], out[ROOM], a[ROOM], sides[2][ROOM], *carried = TEST_ARRAY(double, r *r);
        draw(&t->rng, r, 2.0, c);
        combine(t, c, vector);
        lg_space_retract(&t->space, t->y, vector, out, carried);
        for (size_t j = 0; j < r; j++) {
            size_t at = 0;
            for (int side = 0; side < 2; side++) {
                column_of(t, j, sides[side]);
                for (size_t i = 0; i < d; i++)
                    sides[side][i] = t->y[i] + (side == 0 ? 1.0 : -1.0) * sides[side][i];
            }
            for (size_t f = 0; f < t->space.factors; f++) {
                const lg_space_entry *row = lg_space_kind_entry(t->space.factor[f].kind);
                const size_t n = t->space.factor[f].count;
                if (row->lift != NULL) row->lift(n, t->y + at, vector + at, a);
                for (int side = 0; side < 2 && row->lift != NULL; side++)
                    row->act(n, a, sides[side] + at, sides[side] + at);
                at += n * row->state;
            }
            for (size_t i = 0; i < d; i++) sides[0][i] = 0.5 * (sides[0][i] - sides[1][i]);
            lg_space_coordinates(&t->space, out, sides[0], c);
            for (size_t i = 0; i < r; i++) assert_close(carried[i * r + j], c[i], 0.0, 1e-14 * t->size);
        }
    }
}

TEST("the bits of a copy's basis, coordinates and retraction do not depend on its place") {
    for (size_t k = 0; k < CASES; k++) {
        fixture f = make(&cases[k], COPIES), one = make(&cases[k], 1);
        double y[MAX_STATE], vector[MAX_STATE], c[MAX_STATE], out[MAX_STATE], alone[MAX_STATE];
        const size_t t = one.space.tangent_dim;
        random_point(&f, y);
        random_vector(&f.rng, f.dim, vector);
        lg_space_coordinates(&f.space, y, vector, c);
        lg_space_retract(&f.space, y, vector, out, NULL);
        for (size_t i = 0; i < COPIES; i++) {
            lg_space_coordinates(&one.space, y + i * one.dim, vector + i * one.dim, alone);
            assert_memory_equal(alone, c + i * t, t * sizeof *c);
            lg_space_retract(&one.space, y + i * one.dim, vector + i * one.dim, alone, NULL);
            assert_memory_equal(alone, out + i * one.dim, one.dim * sizeof *out);
        }
    }
}

TEST("retractions on S^2 follow great circles, on SO(3) they turn about an axis fixed in the body") {
    lg_rng rng = test_rng(61, 0);
    for (int repeat = 0; repeat < 20; repeat++) {
        lg_space sphere, body;
        double y[6], R[9], c[4], basis[36], vector[9], out[9], e[9], turn[9];
        assert_ok(lg_space_init(&sphere, &(lg_space_factor){LG_SPACE_TS2, 1}, 1));
        assert_ok(lg_space_init(&body, &(lg_space_factor){LG_SPACE_SO3, 1}, 1));
        random_ts2(&rng, y);
        random_rotation(&rng, R);
        random_vector(&rng, 4, c);
        lg_space_basis(&sphere, y, basis);
        for (int i = 0; i < 6; i++) vector[i] = basis[4 * i] * c[0] + basis[4 * i + 1] * c[1];
        lg_space_retract(&sphere, y, vector, out, NULL);
        const double angle = sqrt(lg_dot3(vector, vector));
        for (int i = 0; i < 3; i++)
            assert_close(out[i], cos(angle) * y[i] + sin(angle) / angle * vector[i], 0.0, 1e-15);
        lg_space_basis(&body, R, basis);
        for (int i = 0; i < 9; i++)
            vector[i] = basis[3 * i] * c[0] + basis[3 * i + 1] * c[1] + basis[3 * i + 2] * c[2];
        lg_space_retract(&body, R, vector, out, NULL);
        lg_so3_exp(c, turn);
        for (int i = 0; i < 9; i++)
            e[i] = R[i / 3 * 3] * turn[i % 3] + R[i / 3 * 3 + 1] * turn[3 + i % 3] +
                   R[i / 3 * 3 + 2] * turn[6 + i % 3];
        assert_all_close(out, e, 9, 0.0, 2e-15);
    }
}

/* ---- texts of spaces ---- */

/* A text that can be read must be the text that the space is written as, so that no two texts mean one
 * space. */
static void check_text(const char *text) {
    lg_space space;
    lg_error error = {LG_OK, ""};
    char again[LG_SPACE_TEXT];
    if (lg_space_read(text, &space, &error) == LG_OK) {
        lg_space_text(&space, again);
        assert_string_equal(again, text);
    } else {
        assert_int_equal(error.status, LG_FORMAT);
        assert_true(strlen(error.message) > 20);
    }
}

/* Changes, removes or doubles a character. */
static void damage(lg_rng *rng, const char *text, char *out) {
    static const char marks[] = "R^nTSOE(3)*, x0129";
    const size_t length = strlen(text), at = lg_rng_below(rng, length);
    const uint64_t what = lg_rng_below(rng, 3);
    memcpy(out, text, length + 1);
    if (what == 0) out[at] = marks[lg_rng_below(rng, sizeof marks - 1)];
    if (what > 0) memcpy(out + at + (what == 2), text + at + (what == 1), length - at + (what == 2));
}

TEST("every product is read back from its text, and a damaged text is refused or is another space's text") {
    lg_rng rng = test_rng(62, 0);
    for (int repeat = 0; repeat < 2000; repeat++) {
        lg_space_factor factors[LG_SPACE_MAX_FACTORS];
        lg_space space, again;
        char text[LG_SPACE_TEXT], broken[LG_SPACE_TEXT + 1];
        const size_t count = 1 + lg_rng_below(&rng, LG_SPACE_MAX_FACTORS);
        for (size_t f = 0; f < count; f++)
            factors[f] = (lg_space_factor){(lg_space_kind)lg_rng_below(&rng, LG_SPACE_KINDS),
                                           1 + lg_rng_below(&rng, lg_rng_below(&rng, 2) ? 3 : 1u << 31)};
        assert_ok(lg_space_init(&space, factors, count));
        lg_space_text(&space, text);
        assert_ok(lg_space_read(text, &again, NULL));
        assert_int_equal(again.factors, space.factors);
        for (size_t f = 0; f < count; f++)
            assert_true(again.factor[f].kind == factors[f].kind && again.factor[f].count == factors[f].count);
        assert_true(again.dim == space.dim && again.algebra_dim == space.algebra_dim &&
                    again.tangent_dim == space.tangent_dim);
        damage(&rng, text, broken);
        check_text(broken);
    }
}

TEST("a text that is not a space is refused, and the message shows where it is wrong") {
    static const char *const rows[][2] = {
        {"", "found ''"},
        {"R^", "found 'R^'"},
        {"R^n", "found 'R^n'"},
        {"R^0", "found 'R^0'"},
        {"R^-1", "found 'R^-1'"},
        {"R^02", "found 'R^02'"},
        {"R^2 x 2", "found 'R^2 x 2'"},
        {"SO(3), T*S^2 x 1", "found 'T*S^2 x 1'"},
        {"SO(3), T*S^2 x", "found 'T*S^2 x'"},
        {"SO(3),R^2", "found 'SO(3),R^2'"},
        {"SO(3), ", "found ''"},
        {"so(3)", "found 'so(3)'"},
        {"R^2, R^99999999999999999999999", "found 'R^9999"},
        {"R^9999999999999999", "more copies"},
        {"R^1, R^1, R^1, R^1, R^1, R^1, R^1, R^1, R^1", "at most 8 factors"},
    };
    const lg_space_factor factors[] = {{LG_SPACE_TS2, 3}, {LG_SPACE_RN, 2}};
    lg_space space;
    char text[LG_SPACE_TEXT];
    assert_ok(lg_space_init(&space, factors, 2));
    lg_space_text(&space, text);
    assert_string_equal(text, "T*S^2 x 3, R^2");
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        lg_error error = {LG_OK, ""};
        assert_status(lg_space_read(rows[i][0], &space, &error), LG_FORMAT);
        if (strstr(error.message, rows[i][1]) == NULL) fail_msg("'%s': %s", rows[i][0], error.message);
    }
    assert_int_equal(space.dim, 20); /* unchanged */
}
