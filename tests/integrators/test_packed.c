/* Steps on copies of T*S^2 use special kernels. They must agree with the interpreter, which is still used for
 * the same space given as a product of two factors, and the result for a copy must not depend on its
 * place. */
#include "support/fixtures.h"

#include "integrators/stepper.h"

enum { MOST = 17, DIM = 6 * MOST };

typedef struct field_data {
    size_t copies;
    double scale; /* of the algebra elements */
    int coupled;
    size_t broken; /* number of evaluations until the last copy gets a NaN; 0: never */
    size_t calls;
} field_data;

/* The algebra element of copy i is u_i = scale (q_i x p_i + (t, input, -1/4)), where a missing input is
 * 1/2, and v_i = scale (p_i + (y, z, x)), where (x, y, z) is q of the next copy; without `coupled` it is
 * q_i. */
FIELD(swirl, y) {
    field_data *d = user;
    d->calls++;
    for (size_t i = 0; i < d->copies; i++) {
        const double *q = y + 6 * i, *p = q + 3, *next = d->coupled ? y + 6 * ((i + 1) % d->copies) : q;
        double *f = out + 6 * i;
        const double extra[3] = {t, input ? input[0] : 0.5, -0.25};
        for (int j = 0; j < 3; j++) {
            const int k = (j + 1) % 3, l = (j + 2) % 3;
            f[j] = d->scale * (q[k] * p[l] - q[l] * p[k] + extra[j]);
            f[3 + j] = d->scale * (p[j] + next[(j + 1) % 3]);
        }
    }
    if (d->broken > 0 && d->calls >= d->broken) out[6 * d->copies - 2] = NAN;
}

static void fill(size_t copies, double *y) {
    for (size_t i = 0; i < copies; i++, y += 6) {
        const double a = 0.3 + (double)i, b = 1.1 * (double)i - 0.7;
        const double q[3] = {cos(a) * cos(b), sin(a) * cos(b), sin(b)};
        const double p[3] = {-sin(a), cos(a), 0.0};
        for (int j = 0; j < 3; j++) y[j] = q[j], y[3 + j] = (0.5 + 0.1 * (double)i) * p[j];
    }
}

static lg_stepper *make(const lg_scheme *scheme, field_data *data, int whole) {
    const lg_space_factor factors[2] = {{LG_SPACE_TS2, whole ? data->copies : 1},
                                        {LG_SPACE_TS2, data->copies - 1}};
    lg_ode ode = {.field = swirl, .user = data};
    assert_ok(lg_space_init(&ode.space, factors, whole ? 1 : 2));
    return test_stepper(scheme, &ode);
}

static double largest(size_t n, const double *x) {
    double most = 1.0;
    for (size_t i = 0; i < n; i++) most = fmax(most, fabs(x[i]));
    return most;
}

/* The difference must be small relative to the largest number. */
static void assert_same(size_t n, const double *x, const double *y, double relative) {
    const double size = largest(n, y);
    assert_all_close(x, y, n, 0.0, relative * size);
}

/* Compares steps of several sizes. The third step starts from the same state as the second, as after a
 * rejection. */
static void compare(const lg_scheme *scheme, size_t copies, double scale, const double *input) {
    static const double sizes[] = {0.1, 0.3, 0.2, -0.1};
    field_data data[2] = {{.copies = copies, .scale = scale, .coupled = 1},
                          {.copies = copies, .scale = scale, .coupled = 1}};
    lg_stepper *packed = make(scheme, &data[0], 1), *plain = make(scheme, &data[1], 0);
    double y[DIM], a[DIM], b[DIM], t = 0.5;
    const size_t n = 6 * copies;
    const double close = scale > 1.0 ? 1e-9 : 1e-13; /* large steps amplify different roundings */
    fill(copies, y);
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        assert_ok(lg_stepper_step(packed, t, sizes[i], y, input, a));
        assert_ok(lg_stepper_step(plain, t, sizes[i], y, input, b));
        assert_same(n, a, b, close);
        assert_close(lg_stepper_angle(packed), lg_stepper_angle(plain), close, 0.0);
        lg_space space;
        assert_ok(lg_space_init(&space, &(lg_space_factor){LG_SPACE_TS2, copies}, 1));
        assert_true(lg_space_manifold_error(&space, a) <=
                    4e-15 * largest(n, b) + 4.0 * lg_space_manifold_error(&space, b));
        /* y has exactly the bits of the last step's end, so its field value is reused */
        assert_true(data[0].calls <= data[1].calls);
        if (scheme->embedded_order > 0) assert_same(n, packed->error, plain->error, close);
        if (scheme->dense_order > 0) {
            double c[DIM], d[DIM];
            assert_ok(lg_stepper_dense(packed, 0.4, c));
            assert_ok(lg_stepper_dense(plain, 0.4, d));
            assert_same(n, c, d, close);
            if (scheme->embedded_order > 0) /* the error estimate is still available */
                assert_same(n, packed->error, plain->error, close);
        }
        if (i != 1) memcpy(y, a, n * sizeof *y), t += sizes[i];
    }
}

TEST("steps by the special kernels agree with the interpreter") {
    static const char *const names[] = {"lie-euler", "lie-heun", "rkmk3", "rkmk4", "rkmk5", "rkmk54"};
    static const size_t copies[] = {2, 7, 8, 9, 16, 17};
    /* Angles so small that only the short series are used; so that short and long ones are used; so large
     * that only the long ones are used. */
    static const double scales[] = {0.1, 1.0, 3.0};
    const double input = 0.9;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        for (size_t j = 0; j < sizeof copies / sizeof *copies; j++)
            for (size_t k = 0; k < sizeof scales / sizeof *scales; k++) {
                compare(lg_scheme_find(names[i]), copies[j], scales[k], NULL);
                compare(lg_scheme_find(names[i]), copies[j], scales[k], &input);
            }
}

TEST("a changed input is noticed, and no field value of the last step is reused") {
    const double inputs[2] = {0.9, -2.0};
    field_data data = {.copies = 3, .scale = 1.0}, fresh = data;
    lg_stepper *stepper = make(lg_scheme_find("rkmk54"), &data, 1);
    double y[18], a[18], b[18];
    fill(3, y);
    assert_ok(lg_stepper_step(stepper, 0.0, 0.1, y, &inputs[0], y));
    assert_ok(lg_stepper_step(stepper, 0.1, 0.1, y, NULL, a));
    lg_stepper *other = make(lg_scheme_find("rkmk54"), &fresh, 1);
    assert_ok(lg_stepper_step(other, 0.1, 0.1, y, NULL, b));
    assert_memory_equal(a, b, sizeof a);
    assert_ok(lg_stepper_step(stepper, 0.1, 0.1, y, &inputs[1], a));
    lg_stepper_reset(other);
    assert_ok(lg_stepper_step(other, 0.1, 0.1, y, &inputs[1], b));
    assert_memory_equal(a, b, sizeof a);
}

/* Copies that do not depend on each other have the same bits at every place and for every number of copies,
 * whatever the angles of the others. */
TEST("the bits of a copy do not depend on its place") {
    double y[DIM], out[DIM], one[6];
    field_data data = {.copies = MOST, .scale = 1.0};
    fill(MOST, y);
    for (size_t i = 0; i < MOST; i++)
        for (int j = 3; j < 6; j++) y[6 * i + (size_t)j] *= i % 3 == 0 ? 0.01 : i % 3 == 1 ? 1.0 : 9.0;
    lg_stepper *all = make(lg_scheme_find("rkmk54"), &data, 1);
    assert_ok(lg_stepper_step(all, 0.0, 0.2, y, NULL, out));
    for (size_t i = 0; i < MOST; i++) {
        field_data alone = {.copies = 1, .scale = 1.0};
        lg_stepper *single = make(lg_scheme_find("rkmk54"), &alone, 1);
        assert_ok(lg_stepper_step(single, 0.0, 0.2, y + 6 * i, NULL, one));
        assert_memory_equal(one, out + 6 * i, sizeof one);
        for (int j = 0; j < 6; j++) assert_true(single->error[j] == all->error[6 * i + (size_t)j]);
        assert_true(lg_stepper_angle(single) <= lg_stepper_angle(all));
    }
}

TEST("a number in one copy that is not finite is noticed at every stage") {
    for (size_t broken = 1; broken <= 7; broken++) {
        field_data data = {.copies = 9, .scale = 1.0, .broken = broken};
        lg_stepper *stepper = make(lg_scheme_find("rkmk54"), &data, 1);
        double y[54], out[54] = {0.0};
        fill(9, y);
        const lg_status status = lg_stepper_step(stepper, 0.0, 0.1, y, NULL, out);
        assert_int_equal(status, broken <= 6 ? LG_NOT_FINITE : LG_OK);
        if (status == LG_OK) /* only the error estimate uses the last stage */
            assert_true(isnan(stepper->error[52]));
        else
            assert_true(out[0] == 0.0);
        data.broken = 0; /* no trace of the NaN is left */
        lg_stepper_reset(stepper);
        assert_ok(lg_stepper_step(stepper, 0.0, 0.1, y, NULL, out));
        assert_true(lg_stepper_angle(stepper) < 1.0 && isfinite(stepper->error[52]));
    }
}
