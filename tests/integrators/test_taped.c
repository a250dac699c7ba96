/* The taped interpreter against the plain one, on every scheme of the table. */
#include "test_support.h"

#include "liegrad/mechanics.h"
#include "liegrad/ops.h"
#include "liegrad/random.h"
#include "liegrad/taped.h"

/* A nonplanar field on (T*S^2)^2 and its twin with operations: u = a q + s (q_other x p), v = cos(t) p + c
 * q_other. */
enum { LINKS = 2, BATCH = 3, STEPS = 6 };

static const double a[3] = {0.3, -0.7, 0.5}, c[3] = {1.1, 0.2, -0.4};

static lg_status plain_field(void *user, double t, const double *y, const double *input, double *out) {
    (void)user, (void)input;
    for (int i = 0; i < LINKS; i++) {
        const double *q = y + 6 * i, *p = q + 3, *other = y + 6 * (1 - i);
        const double cross[3] = {other[1] * p[2] - other[2] * p[1], other[2] * p[0] - other[0] * p[2],
                                 other[0] * p[1] - other[1] * p[0]};
        for (int j = 0; j < 3; j++) {
            out[6 * i + j] = a[j] * q[j] + 0.8 * cross[j];
            out[6 * i + 3 + j] = cos(t) * p[j] + c[j] * other[j];
        }
    }
    return LG_OK;
}

static lg_var swapped(lg_tape *tape, lg_var x) {
    lg_var halves[2] = {lg_slice(tape, x, 1, 1, 1), lg_slice(tape, x, 1, 0, 1)};
    return lg_concat(tape, halves, 2, 1);
}

static lg_status taped_field(void *user, lg_tape *tape, double t, const lg_var *y, lg_var *out) {
    (void)user;
    lg_var other = swapped(tape, y[0]);
    lg_var va = lg_input_f64(tape, lg_shape1(3), a), vc = lg_input_f64(tape, lg_shape1(3), c);
    out[0] = lg_add(tape, lg_mul(tape, va, y[0]), lg_scale(tape, lg_cross(tape, other, y[1]), 0.8));
    out[1] = lg_add(tape, lg_scale(tape, y[1], cos(t)), lg_mul(tape, vc, other));
    return lg_tape_status(tape);
}

/* Ambient twin on R^12 for the classical schemes: any smooth field will do. */
static lg_status plain_ambient(void *user, double t, const double *y, const double *input, double *out) {
    return plain_field(user, t, y, input, out);
}

static void random_start(lg_rng *rng, double *y) {
    for (int i = 0; i < LINKS; i++, y += 6) {
        double norm = 0.0;
        for (int j = 0; j < 3; j++) {
            y[j] = lg_rng_normal(rng);
            norm += y[j] * y[j];
        }
        for (int j = 0; j < 3; j++) y[j] /= sqrt(norm);
        const double u[3] = {lg_rng_normal(rng), lg_rng_normal(rng), lg_rng_normal(rng)};
        y[3] = y[1] * u[2] - y[2] * u[1];
        y[4] = y[2] * u[0] - y[0] * u[2];
        y[5] = y[0] * u[1] - y[1] * u[0];
    }
}

/* (B, 12) with q1 p1 q2 p2 to one part (B, 2, 3) */
static lg_var part_of(lg_tape *tape, const double *y, int part, bool flat) {
    double values[BATCH * LINKS * 3];
    for (int b = 0; b < BATCH; b++)
        for (int i = 0; i < LINKS; i++)
            for (int j = 0; j < 3; j++) values[(b * LINKS + i) * 3 + j] = y[b * 12 + 6 * i + 3 * part + j];
    return lg_input_f64(tape, flat ? lg_shape2(BATCH, 6) : lg_shape3(BATCH, LINKS, 3), values);
}

static lg_status taped_ambient(void *user, lg_tape *tape, double t, const lg_var *y, lg_var *out) {
    lg_var q = lg_reshape(tape, y[0], lg_shape3(BATCH, LINKS, 3)),
           p = lg_reshape(tape, y[1], lg_shape3(BATCH, LINKS, 3));
    lg_var in[2] = {q, p}, f[2] = {LG_NONE, LG_NONE};
    lg_status status = taped_field(user, tape, t, in, f);
    out[0] = lg_reshape(tape, f[0], lg_shape2(BATCH, 6));
    out[1] = lg_reshape(tape, f[1], lg_shape2(BATCH, 6));
    return status;
}

static void compare(lg_tape *tape, const lg_scheme *scheme, lg_dtype dtype) {
    const double h = 0.05, t0 = 0.2;
    double y[BATCH * 12], expected[(STEPS + 1) * 12], got[BATCH * 6];
    lg_rng rng;
    lg_rng_seed(&rng, 5, 0);
    for (int b = 0; b < BATCH; b++) random_start(&rng, y + 12 * b);

    lg_ode plain = {.field = scheme->ambient ? plain_ambient : plain_field};
    lg_taped_ode taped = {.field = scheme->ambient ? taped_ambient : taped_field};
    if (scheme->ambient) {
        assert_ok(lg_space_init_rn(&plain.space, 12));
        assert_ok(lg_space_init(&taped.space, (lg_space_factor[]){{LG_SPACE_RN, 6}, {LG_SPACE_RN, 6}}, 2));
    } else {
        assert_ok(lg_space_init(&plain.space, &(lg_space_factor){LG_SPACE_TS2, LINKS}, 1));
        taped.space = plain.space;
    }
    lg_tape_reset(tape);
    lg_var start[2] = {part_of(tape, y, 0, scheme->ambient), part_of(tape, y, 1, scheme->ambient)};
    lg_var out[2 * STEPS / 2];
    assert_ok(lg_taped_integrate(tape, scheme, &taped, t0, h, STEPS, 2, start, out));

    lg_stepper *stepper;
    assert_ok(lg_stepper_create(NULL, scheme, &plain, &stepper));
    const double tolerance = dtype == LG_F64 ? 2e-14 : 3e-6;
    for (int b = 0; b < BATCH; b++) {
        assert_ok(lg_integrate_fixed(stepper, t0, h, STEPS, NULL, 0, 2, y + 12 * b, expected, NULL));
        for (int n = 0; n < STEPS / 2; n++)
            for (int part = 0; part < 2; part++) {
                assert_ok(lg_read(tape, out[2 * n + part], got, BATCH * 6));
                for (int i = 0; i < LINKS; i++)
                    for (int j = 0; j < 3; j++)
                        assert_close(got[b * 6 + 3 * i + j], expected[(n + 1) * 12 + 6 * i + 3 * part + j],
                                     0.0, tolerance);
            }
    }
    lg_stepper_destroy(NULL, stepper);
}

static void every_scheme(lg_dtype dtype) {
    lg_tape_options options;
    lg_tape *tape;
    lg_tape_options_init(&options);
    options.dtype = dtype;
    assert_ok(lg_tape_create(NULL, &options, &tape));
    int compared = 0;
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        if (lg_scheme_at(i)->kind == LG_SCHEME_SPLITTING) continue;
        compare(tape, lg_scheme_at(i), dtype);
        compared++;
    }
    lg_scheme truncated = *lg_scheme_find("rkmk4");
    for (truncated.dexpinv = 0; truncated.dexpinv <= 8; truncated.dexpinv++) compare(tape, &truncated, dtype);
    assert_true(compared >= 8);
    lg_tape_destroy(tape);
}

static void taped_equals_plain(void **state) {
    (void)state;
    every_scheme(LG_F64);
}

static void taped_equals_plain_f32(void **state) {
    (void)state;
    every_scheme(LG_F32);
}

/* ---- splitting: quartic oscillator, force counted ---- */

static int forces;

static lg_status force(void *user, lg_tape *tape, double t, lg_var q, lg_var *out) {
    (void)user, (void)t;
    forces++;
    *out = lg_neg(tape, lg_add(tape, q, lg_pow(tape, q, 3.0)));
    return lg_tape_status(tape);
}

static lg_status velocity(void *user, lg_tape *tape, double t, lg_var p, lg_var *out) {
    (void)user, (void)t;
    *out = lg_scale(tape, p, 1.0);
    return lg_tape_status(tape);
}

static lg_status plain_force(void *user, double t, const double *q, const double *input, double *out) {
    (void)user, (void)t, (void)input;
    for (int i = 0; i < 2; i++) out[i] = -(q[i] + q[i] * q[i] * q[i]);
    return LG_OK;
}

static lg_status plain_velocity(void *user, double t, const double *p, const double *input, double *out) {
    (void)user, (void)t, (void)input;
    for (int i = 0; i < 2; i++) out[i] = p[i];
    return LG_OK;
}

static void stormer_verlet_reuses_forces(void **state) {
    (void)state;
    const lg_scheme *scheme = lg_scheme_find("stormer-verlet");
    lg_taped_ode taped = {.force = force, .velocity = velocity};
    lg_ode plain = {.force = plain_force, .velocity = plain_velocity};
    const double y0[4] = {0.4, -0.9, 0.2, 0.7};
    double expected[11 * 4], got[2];
    lg_tape *tape;
    lg_stepper *stepper;
    assert_ok(lg_space_init(&taped.space, (lg_space_factor[]){{LG_SPACE_RN, 2}, {LG_SPACE_RN, 2}}, 2));
    assert_ok(lg_space_init_rn(&plain.space, 4));
    assert_ok(lg_tape_create(NULL, NULL, &tape));
    lg_var start[2] = {lg_input(tape, lg_shape2(1, 2), y0), lg_input(tape, lg_shape2(1, 2), y0 + 2)}, out[20];
    forces = 0;
    assert_ok(lg_taped_integrate(tape, scheme, &taped, 0.0, 0.1, 10, 1, start, out));
    assert_int_equal(forces, 11);
    assert_ok(lg_stepper_create(NULL, scheme, &plain, &stepper));
    assert_ok(lg_integrate_fixed(stepper, 0.0, 0.1, 10, NULL, 0, 1, y0, expected, NULL));
    for (int n = 0; n < 10; n++)
        for (int part = 0; part < 2; part++) {
            assert_ok(lg_read(tape, out[2 * n + part], got, 2));
            for (int i = 0; i < 2; i++)
                assert_close(got[i], expected[4 * (n + 1) + 2 * part + i], 0.0, 1e-15);
        }
    lg_stepper_destroy(NULL, stepper);
    lg_tape_destroy(tape);
}

/* Psi^T J Psi = J through the taped Jacobian; explicit Euler must fail. */
static double symplectic_defect(const char *name) {
    static const double y0[4] = {0.4, -0.9, 0.2, 0.7};
    const lg_scheme *scheme = lg_scheme_find(name);
    lg_taped_ode ode = {.force = force, .velocity = velocity};
    lg_tape *tape;
    double psi[16], defect = 0.0;
    assert_ok(lg_space_init(&ode.space, (lg_space_factor[]){{LG_SPACE_RN, 2}, {LG_SPACE_RN, 2}}, 2));
    assert_ok(lg_tape_create(NULL, NULL, &tape));
    lg_var y = lg_input(tape, lg_shape2(1, 4), y0);
    lg_var start[2] = {lg_slice(tape, y, 1, 0, 2), lg_slice(tape, y, 1, 2, 2)}, out[2];
    if (strcmp(name, "stormer-verlet") == 0) {
        assert_ok(lg_taped_integrate(tape, scheme, &ode, 0.0, 0.1, 5, 5, start, out));
    } else {
        lg_var f, v;
        assert_ok(force(NULL, tape, 0.0, start[0], &f));
        assert_ok(velocity(NULL, tape, 0.0, start[1], &v));
        out[0] = lg_add(tape, start[0], lg_scale(tape, v, 0.1));
        out[1] = lg_add(tape, start[1], lg_scale(tape, f, 0.1));
    }
    assert_ok(lg_read(tape, lg_jacobian(tape, lg_concat(tape, out, 2, 1), y), psi, 16));
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++) {
            double sum = 0.0;
            for (int l = 0; l < 2; l++)
                sum += psi[4 * l + i] * psi[4 * (l + 2) + j] - psi[4 * (l + 2) + i] * psi[4 * l + j];
            const double expected = j == i + 2 ? 1.0 : i == j + 2 ? -1.0 : 0.0;
            if (fabs(sum - expected) > defect) defect = fabs(sum - expected);
        }
    lg_tape_destroy(tape);
    return defect;
}

static void symplectic_through_the_jacobian(void **state) {
    (void)state;
    assert_true(symplectic_defect("stormer-verlet") <= 1e-14);
    assert_true(symplectic_defect("euler") > 1e-3);
}

static void bad_arguments(void **state) {
    (void)state;
    lg_tape *tape;
    lg_taped_ode ode = {.field = taped_field};
    assert_ok(lg_space_init(&ode.space, &(lg_space_factor){LG_SPACE_TS2, LINKS}, 1));
    assert_ok(lg_tape_create(NULL, NULL, &tape));
    double y[BATCH * 12] = {0};
    lg_var start[2] = {part_of(tape, y, 0, false), part_of(tape, y, 1, false)}, out[4];
    const lg_scheme *cf4 = lg_scheme_find("cf4");
    assert_status(lg_taped_integrate(tape, cf4, &ode, 0, 0.1, 0, 1, start, out), LG_INVALID_ARGUMENT);
    assert_status(lg_taped_integrate(tape, cf4, &ode, 0, 0.1, 3, 2, start, out), LG_INVALID_ARGUMENT);
    assert_status(lg_taped_integrate(tape, lg_scheme_find("rk4"), &ode, 0, 0.1, 1, 1, start, out),
                  LG_UNSUPPORTED);
    assert_status(lg_taped_integrate(tape, lg_scheme_find("stormer-verlet"), &ode, 0, 0.1, 1, 1, start, out),
                  LG_UNSUPPORTED);
    start[1] = LG_NONE;
    assert_status(lg_taped_integrate(tape, cf4, &ode, 0, 0.1, 1, 1, start, out), LG_STALE_HANDLE);
    lg_tape_destroy(tape);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(taped_equals_plain),
        cmocka_unit_test(taped_equals_plain_f32),
        cmocka_unit_test(stormer_verlet_reuses_forces),
        cmocka_unit_test(symplectic_through_the_jacobian),
        cmocka_unit_test(bad_arguments),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
