/* Band powers by Welch's method. */
#include "anomaly/series_support.h"

#include "liegrad/core.h"
#include "liegrad/series.h"

static const double PI = 3.14159265358979323846;

OWNED(lg_spectrum, lg_spectrum_destroy)

static lg_spectrum make(uint32_t length, uint32_t bands) {
    lg_spectrum s;
    assert_told(lg_spectrum_create(NULL, length, bands, &s, &told));
    return *own_lg_spectrum(s);
}

TEST("white noise has its variance in every band") {
    enum { LENGTH = 1 << 16, BANDS = 8 };
    const lg_spectrum s = make(LENGTH, BANDS);
    double *z = TEST_ARRAY(double, LENGTH), *work = TEST_ARRAY(double, lg_spectrum_work(&s)), power[BANDS];
    lg_rng rng = test_rng(3, 1);
    for (size_t t = 0; t < LENGTH; t++) z[t] = 2 * lg_rng_normal(&rng);
    lg_spectrum_powers(&s, z, power, work);
    for (uint32_t b = 0; b < BANDS; b++) assert_close(power[b], 4, 0.05, 0); /* 5 standard errors */
}

/* A sine of amplitude a whose frequency is that of a bin: its power is a^2/4 n/sum h^2 (sum h)^2/n, in three
 * bins that all belong to the band. sum h = n/2, sum h^2 = 3 n/8. */
TEST("the power of a sine is in its band") {
    enum { LENGTH = 300, BANDS = 8 };
    const lg_spectrum s = make(LENGTH, BANDS);
    const double n = s.segment, total = n / 4;
    double z[LENGTH], power[BANDS], *work = TEST_ARRAY(double, lg_spectrum_work(&s));
    assert_int_equal(s.segment, 128);
    assert_true((s.segments - 1) * s.hop + s.segment <= LENGTH);
    for (uint32_t b = 0; b < BANDS; b++) {
        const uint32_t bin = (s.edge[b] + s.edge[b + 1]) / 2;
        for (uint32_t t = 0; t < LENGTH; t++) z[t] = sin(2 * PI * bin * t / n + 0.3);
        lg_spectrum_powers(&s, z, power, work);
        assert_close(power[b] * (s.edge[b + 1] - s.edge[b]), total, 1e-12, 0);
        for (uint32_t other = 0; other < BANDS; other++)
            if (other != b) assert_close(power[other], 0, 0, 1e-20);
    }
}

/* Segments of all lengths: with two factors near the root, with others, and primes. */
TEST("powers follow their definition") {
    enum { LONGEST = 300, BANDS = 2 };
    lg_rng rng = test_rng(3, 2);
    double z[LONGEST], power[LG_SPECTRUM_BANDS];
    for (uint32_t t = 0; t < LONGEST; t++) z[t] = lg_rng_normal(&rng);
    for (uint32_t length = 4; length <= LONGEST; length += length < 128 ? 1 : 43) {
        const uint32_t bands = lg_spectrum_bands(length, length % 3 == 0 ? 8 : BANDS);
        const lg_spectrum s = make(length, bands);
        lg_spectrum_powers(&s, z, power, TEST_ARRAY(double, lg_spectrum_work(&s)));
        for (uint32_t b = 0; b < bands; b++) {
            double sum = 0, squares = 0;
            for (uint32_t t = 0; t < s.segment; t++) squares += pow(sin(PI * (t + 0.5) / s.segment), 4);
            for (uint32_t i = 0; i < s.segments; i++)
                for (uint32_t k = s.edge[b]; k < s.edge[b + 1]; k++) {
                    double re = 0, im = 0;
                    for (uint32_t t = 0; t < s.segment; t++) {
                        const double h = pow(sin(PI * (t + 0.5) / s.segment), 2) * z[i * s.hop + t],
                                     angle = 2 * PI * (k * t % s.segment) / s.segment;
                        re += h * cos(angle), im += h * sin(angle);
                    }
                    sum += re * re + im * im;
                }
            assert_close(power[b], sum / squares / s.segments / (s.edge[b + 1] - s.edge[b]), 1e-12, 1e-14);
        }
    }
}

TEST("every sample of a series except the last few is in a segment") {
    for (uint32_t length = 4; length < 700; length += 3) {
        const lg_spectrum s = make(length, 2);
        const uint32_t end = (s.segments - 1) * s.hop + s.segment;
        assert_true(end <= length && length - end < s.segments);
        assert_true(s.segments == 1 || 2 * s.hop <= s.segment + 1);
    }
}

TEST("bands divide the bins among themselves") {
    assert_int_equal(lg_spectrum_bands(3, 8), 0);
    assert_int_equal(lg_spectrum_bands(4, 8), 2);
    assert_int_equal(lg_spectrum_bands(300, 8), 8);
    assert_int_equal(lg_spectrum_bands(300, 1000), LG_SPECTRUM_BANDS);
    for (uint32_t bands = 1; bands <= LG_SPECTRUM_BANDS; bands++) {
        const lg_spectrum s = make(200, bands);
        assert_int_equal(s.edge[0], 1);
        assert_int_equal(s.edge[bands], s.bins + 1);
        for (uint32_t b = 0; b < bands; b++) assert_true(s.edge[b + 1] > s.edge[b]);
    }
    lg_spectrum s;
    lg_error error;
    assert_int_equal(lg_spectrum_create(NULL, 300, 0, &s, &error), LG_INVALID_ARGUMENT);
    assert_int_equal(lg_spectrum_create(NULL, 6, 4, &s, &error), LG_INVALID_ARGUMENT);
}
