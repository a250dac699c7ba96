/* The fixed last layer of modes: singular vectors compared with the covariance that they diagonalise,
 * targets, truncation, refusals. */
#include "elastica/surrogate_support.h"

enum { CURVES = 40, INTERVALS = 9, NUMBERS = 4 * (INTERVALS - 1), MODES = 5 };

/* A network with `modes` modes, which are not computed yet. */
static lg_surrogate network(uint32_t modes, uint32_t intervals, bool mirror) {
    const lg_surrogate_options options = {.kind = LG_SURROGATE_DISCRETE,
                                          .architecture = LG_NET_MLP,
                                          .hidden = 3,
                                          .activation = LG_TANH,
                                          .mirror = mirror,
                                          .modes = modes};
    lg_surrogate model;
    assert_ok(lg_surrogate_init(&model, &options, intervals, TEST_LENGTH, 1.5, NULL));
    return model;
}

static uint32_t *all_of(size_t count) {
    uint32_t *list = TEST_ARRAY(uint32_t, count);
    for (size_t i = 0; i < count; i++) list[i] = (uint32_t)i;
    return list;
}

static double *found(lg_surrogate *model, const lg_elastica_curves *set, size_t count) {
    double *modes = TEST_ARRAY(double, lg_surrogate_modes_size(model));
    assert_ok(lg_surrogate_find_modes(NULL, model, set, all_of(count), count, modes, NULL));
    model->modes = modes;
    return modes;
}

/* The numbers that the network must output for curve i: relative to q0, with y-components reflected if v0y <
 * vNy. */
static void numbers_of(const lg_elastica_curves *set, size_t i, bool mirror, double *y) {
    const double *x = set->boundary + 8 * i;
    const double sign = mirror && x[3] < x[7] ? -1.0 : 1.0;
    for (size_t k = 0; k < INTERVALS - 1; k++)
        for (size_t c = 0; c < 2; c++) {
            const size_t at = 2 * ((INTERVALS + 1) * i + k + 1) + c;
            y[2 * k + c] = (c == 1 ? sign : 1.0) * (set->q[at] - x[c]);
            y[NUMBERS / 2 + 2 * k + c] = (c == 1 ? sign : 1.0) * set->v[at];
        }
}

static double dot(const double *a, const double *b) {
    double sum = 0.0;
    for (size_t i = 0; i < NUMBERS; i++) sum += a[i] * b[i];
    return sum;
}

/* C v, where C is the covariance of the curves without the directions of the modes. */
static void rest_times(double (*rest)[NUMBERS], const double *v, double *out) {
    memset(out, 0, NUMBERS * sizeof *out);
    for (size_t i = 0; i < CURVES; i++) {
        const double along = dot(rest[i], v) / CURVES;
        for (size_t j = 0; j < NUMBERS; j++) out[j] += along * rest[i][j];
    }
}

TEST("modes are the leading eigenvectors of the curves' covariance, in decreasing order") {
    for (int mirror = 0; mirror < 2; mirror++) {
        const lg_elastica_curves set = make_curves(CURVES, INTERVALS);
        lg_surrogate model = network(MODES, INTERVALS, mirror);
        const double *modes = found(&model, &set, CURVES);
        static double rest[CURVES][NUMBERS];
        double image[NUMBERS], mean[NUMBERS] = {0.0}, largest = 0.0;
        for (size_t i = 0; i < CURVES; i++) {
            numbers_of(&set, i, mirror, rest[i]);
            for (size_t j = 0; j < NUMBERS; j++) mean[j] += rest[i][j] / CURVES;
        }
        for (size_t j = 0; j < NUMBERS; j++) assert_close(modes[j], mean[j], 1e-14, 1e-15);
        for (size_t i = 0; i < CURVES; i++)
            for (size_t j = 0; j < NUMBERS; j++) rest[i][j] -= mean[j];
        /* m = s u with |u| = 1 and C u = s^2 u, so C m = |m|^2 m. */
        for (size_t k = 0; k < MODES; k++) {
            const double *m = modes + NUMBERS * (k + 1), square = dot(m, m);
            rest_times(rest, m, image);
            for (size_t j = 0; j < NUMBERS; j++) assert_close(image[j], square * m[j], 0.0, 1e-13);
            for (size_t l = 0; l < k; l++) assert_close(dot(m, modes + NUMBERS * (l + 1)), 0.0, 0.0, 1e-14);
            if (k > 0) assert_true(square < dot(m - NUMBERS, m - NUMBERS));
        }
        const double last = dot(modes + NUMBERS * MODES, modes + NUMBERS * MODES);
        for (size_t k = 0; k < MODES; k++)
            for (size_t i = 0; i < CURVES; i++) {
                const double *m = modes + NUMBERS * (k + 1), along = dot(rest[i], m) / dot(m, m);
                for (size_t j = 0; j < NUMBERS; j++) rest[i][j] -= along * m[j];
            }
        for (size_t i = 0; i < CURVES; i++) largest = fmax(largest, dot(rest[i], rest[i]) / CURVES);
        assert_true(last > 1e-12 && largest < last * CURVES);
        double v[NUMBERS];
        for (size_t j = 0; j < NUMBERS; j++) v[j] = rest[0][j];
        for (int turn = 0; turn < 50; turn++) {
            rest_times(rest, v, image);
            const double norm = sqrt(dot(image, image));
            for (size_t j = 0; j < NUMBERS; j++) v[j] = image[j] / norm;
        }
        rest_times(rest, v, image);
        assert_true(dot(v, image) < last); /* the largest remaining variance */
    }
}

TEST("targets have mean 0 and deviation 1; curves are mean plus modes plus a remainder as large as the "
     "truncation") {
    const lg_elastica_curves set = make_curves(CURVES, INTERVALS);
    double before = INFINITY;
    for (uint32_t count = 1; count <= NUMBERS; count += 3) {
        lg_surrogate model = network(count, INTERVALS, true);
        const double *modes = found(&model, &set, CURVES);
        double *c = TEST_ARRAY(double, CURVES *count), truncation, sum = 0.0;
        assert_ok(
            lg_surrogate_coefficients(NULL, &model, &set, all_of(CURVES), CURVES, c, &truncation, NULL));
        for (size_t k = 0; k < count && k < MODES; k++) {
            double mean = 0.0, square = 0.0;
            for (size_t i = 0; i < CURVES; i++) {
                mean += c[count * i + k] / CURVES;
                square += c[count * i + k] * c[count * i + k] / CURVES;
            }
            assert_close(mean, 0.0, 0.0, 1e-8);
            assert_close(square, 1.0, 1e-8, 0.0);
        }
        for (size_t i = 0; i < CURVES; i++) {
            double y[NUMBERS];
            numbers_of(&set, i, true, y);
            for (size_t j = 0; j < NUMBERS; j++) y[j] -= modes[j];
            for (size_t k = 0; k < count; k++)
                for (size_t j = 0; j < NUMBERS; j++) y[j] -= c[count * i + k] * modes[NUMBERS * (k + 1) + j];
            sum += dot(y, y) / (CURVES * NUMBERS);
        }
        assert_close(truncation, sum, 1e-9, 1e-28);
        assert_true(truncation <= before);
        before = truncation;
    }
    assert_true(before < 1e-28);
}

static uint32_t counted(uint32_t most, const lg_elastica_curves *set, size_t count) {
    const lg_surrogate model = network(most, set->intervals, true);
    uint32_t modes = UINT32_MAX;
    assert_ok(lg_surrogate_count_modes(NULL, &model, set, all_of(count), count, &modes, NULL));
    return modes;
}

/* The variance that `modes` > 0 modes leave out. *first gets the part that the first mode leaves out. */
static double left_out(const lg_elastica_curves *set, uint32_t modes, double *first) {
    lg_surrogate model = network(modes, set->intervals, true);
    const size_t n = set->count, numbers = 4 * ((size_t)set->intervals - 1);
    double *c = TEST_ARRAY(double, n *modes), truncation;
    const double *mode = found(&model, set, n) + numbers;
    assert_ok(lg_surrogate_coefficients(NULL, &model, set, all_of(n), n, c, &truncation, NULL));
    *first = 0.0;
    for (size_t j = 0; j < numbers; j++) *first += mode[j] * mode[j] / (double)numbers;
    return truncation;
}

TEST("curves get as many modes as leave 1e-12 of their variance, and none for their noise") {
    enum { MANY = 100, FINE = 30, ALL = 4 * (FINE - 1) };
    lg_elastica_curves set = make_curves(MANY, FINE);
    double first;
    const double after_one = left_out(&set, 1, &first), least = 1e-12 * (first + after_one);
    const uint32_t clean = counted(ALL, &set, MANY);
    assert_true(clean > 3 && clean < ALL);
    assert_true(left_out(&set, clean, &first) <= least);
    assert_true(left_out(&set, clean - 1, &first) > least);
    assert_int_equal(counted(3, &set, MANY), 3); /* at most as many as the model may have */
    assert_int_equal(counted(ALL, &set, 3), 2);  /* fewer than there are curves */
    assert_int_equal(counted(ALL, &set, 1), 0);
    lg_rng rng = test_rng(1, 0);
    for (size_t i = 0; i < 2 * MANY * (FINE + 1); i++) {
        set.q[i] += 1e-4 * lg_rng_normal(&rng);
        set.v[i] += 1e-4 * lg_rng_normal(&rng);
    }
    const uint32_t noisy = counted(ALL, &set, MANY);
    assert_true(noisy > 2 && noisy < clean);
    const double rest = left_out(&set, noisy, &first);
    assert_true(rest > 0.5e-8 && rest < 2e-8);
}

TEST("a direction without variance has coefficient 0") {
    enum { SAME = 3 };
    lg_elastica_curves set = make_curves(SAME, INTERVALS);
    const size_t nodes = INTERVALS + 1;
    for (size_t i = 1; i < SAME; i++) {
        memcpy(set.boundary + 8 * i, set.boundary, 8 * sizeof *set.boundary);
        memcpy(set.q + 2 * nodes * i, set.q, 2 * nodes * sizeof *set.q);
        memcpy(set.v + 2 * nodes * i, set.v, 2 * nodes * sizeof *set.v);
    }
    lg_surrogate model = network(2, INTERVALS, false);
    double *modes = found(&model, &set, SAME), c[2 * SAME], truncation;
    memset(modes + NUMBERS, 0, 2 * NUMBERS * sizeof *modes);
    assert_ok(lg_surrogate_coefficients(NULL, &model, &set, all_of(SAME), SAME, c, &truncation, NULL));
    for (size_t i = 0; i < 2 * SAME; i++) assert_close(c[i], 0.0, 0.0, 0.0);
    assert_true(truncation < 1e-30);
    truncation = 1.0;
    assert_ok(lg_surrogate_coefficients(NULL, &model, &set, all_of(SAME), 0, c, &truncation, NULL));
    assert_close(truncation, 0.0, 0.0, 0.0);
}

TEST("models and curves without modes are refused, and the output stays unchanged") {
    static const uint32_t beyond[MODES + 1] = {0, 1, 2, 3, 4, CURVES};
    lg_elastica_curves set = make_curves(CURVES, INTERVALS), other = make_curves(CURVES, INTERVALS + 1);
    lg_surrogate model = network(MODES, INTERVALS, false), none = network(0, INTERVALS, false);
    const uint32_t *all = all_of(CURVES);
    double *modes = TEST_ARRAY(double, lg_surrogate_modes_size(&model)), c[MODES * CURVES];
    lg_error error;
    modes[0] = 7.0;
    assert_int_equal(lg_surrogate_modes_size(&none), 0);
    assert_status(lg_surrogate_find_modes(NULL, &none, &set, all, CURVES, modes, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_surrogate_find_modes(NULL, &model, &set, all, MODES, modes, &error),
                  LG_INVALID_ARGUMENT);
    assert_non_null(strstr(error.message, "5 modes need at least 6 curves"));
    assert_status(lg_surrogate_find_modes(NULL, &model, &set, beyond, MODES + 1, modes, NULL),
                  LG_INVALID_ARGUMENT);
    assert_status(lg_surrogate_find_modes(NULL, &model, &other, all, CURVES, modes, NULL), LG_SHAPE);
    assert_status(lg_surrogate_coefficients(NULL, &model, &set, all, CURVES, c, NULL, NULL),
                  LG_INVALID_ARGUMENT);
    uint32_t count = 7;
    assert_status(lg_surrogate_count_modes(NULL, &none, &set, all, CURVES, &count, NULL),
                  LG_INVALID_ARGUMENT);
    assert_status(lg_surrogate_count_modes(NULL, &model, &set, all, 0, &count, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_surrogate_count_modes(NULL, &model, &other, all, CURVES, &count, NULL), LG_SHAPE);
    set.q[2 * (INTERVALS + 1) + 5] = NAN;
    assert_status(lg_surrogate_find_modes(NULL, &model, &set, all, CURVES, modes, NULL), LG_NOT_FINITE);
    assert_status(lg_surrogate_count_modes(NULL, &model, &set, all, CURVES, &count, NULL), LG_NOT_FINITE);
    assert_int_equal(count, 7);
    assert_close(modes[0], 7.0, 0.0, 0.0);
}

TEST("every allocation for modes and targets may fail, and nothing leaks") {
    const lg_elastica_curves set = make_curves(CURVES, INTERVALS);
    const uint32_t *all = all_of(CURVES);
    lg_surrogate model = network(MODES, INTERVALS, true);
    double *modes = TEST_ARRAY(double, lg_surrogate_modes_size(&model)), c[MODES * CURVES];
    EVERY_ALLOCATION_FAILS(context, 2, {
        modes[0] = 7.0;
        status = lg_surrogate_find_modes(context, &model, &set, all, CURVES, modes, NULL);
        assert_true((modes[0] == 7.0) == (status != LG_OK));
    });
    uint32_t count;
    EVERY_ALLOCATION_FAILS(context, 2, {
        count = 7;
        status = lg_surrogate_count_modes(context, &model, &set, all, CURVES, &count, NULL);
        assert_true((count == 7) == (status != LG_OK));
    });
    model.modes = modes;
    EVERY_ALLOCATION_FAILS(context, 1, {
        status = lg_surrogate_coefficients(context, &model, &set, all, CURVES, c, NULL, NULL);
    });
}
