/* The structure of the riser: periods, matrices, foundation, energy, order of the time stepping.
 * ctest-labels: src/mechanics */
#include "test_support.h"

#include "liegrad/anomaly.h"
#include "support/dense_solve.h"
#include "anomaly/riser_check.h"
#include "anomaly/riser.h"
#include "anomaly/riser_motion.h"
#include "support/fixtures.h"

enum { N = LG_RISER_DOF };

static lg_riser_parameters standard(lg_housing housing, double severity) {
    lg_riser_parameters p;
    lg_riser_parameters_init(&p);
    p.housing = housing;
    p.severity = severity;
    return p;
}

static lg_riser_parameters odd_ones(void) {
    lg_riser_parameters p = standard(LG_HOUSING_TIGHT, 0.7);
    p.depth = 130.0;
    p.bop_height = 12.0;
    p.bop_centre = 4.5;
    p.hydro_diameter = 0.8;
    p.added_mass = 0.9;
    p.submerged_weight = 2.1e3;
    p.flex_joint = 4e6;
    p.relief_stiffness = 3e6;
    p.relief_height = 7.0;
    return p;
}

/* ---- linear part ---- */

TEST("periods agree with the published ones to half a digit") {
    static const struct {
        double severity;
        bool locked;
        double periods[3], half_digit;
    } rows[] = {{1.0, true, {4.868, 2.052, 1.607}, 5e-4},
                {0.58, true, {4.935, 2.324, 1.785}, 6e-4},
                {1.0, false, {4.91, 2.23, 1.76}, 5e-3},
                {0.58, false, {4.98, 2.53, 1.82}, 5e-3}};
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        const lg_riser_parameters slack = standard(LG_HOUSING_SLACK, rows[r].severity);
        const lg_riser_parameters tight = standard(LG_HOUSING_TIGHT, rows[r].severity);
        double periods[N], other[N];
        assert_ok(riser_periods(&slack, rows[r].locked, periods));
        printf("r = %.2f, %s: %.4f %.4f %.4f s\n", rows[r].severity, rows[r].locked ? "locked" : "free",
               periods[0], periods[1], periods[2]);
        assert_all_close(periods, rows[r].periods, 3, 0.0, rows[r].half_digit);
        for (int i = 1; i < N; i++) assert_true(periods[i] < periods[i - 1] && periods[i] > 0.0);
        assert_ok(riser_periods(&tight, !rows[r].locked, other));
        for (int i = 0; i < 3 && rows[r].locked; i++) assert_close(other[i], periods[i], 1e-14, 0.0);
    }
}

static double product(const double *a, const double *matrix, const double *b) {
    double sum = 0.0;
    for (size_t i = 0; i < N; i++)
        for (size_t j = 0; j < N; j++) sum += a[i] * matrix[i * N + j] * b[j];
    return sum;
}

/* Computes the longest periods by inverse iteration, orthogonal to the modes found so far. modes (count,
 * N). */
static void inverse_iteration(const double *mass, const double *stiffness, size_t count, double *modes,
                              double *periods) {
    for (size_t m = 0; m < count; m++) {
        double *x = modes + m * N;
        for (size_t i = 0; i < N; i++) x[i] = 1.0 + 0.3 * (double)((i * (m + 3)) % 5);
        for (int iteration = 0; iteration < 3000; iteration++) {
            double a[N * N], b[N] = {0.0};
            for (size_t k = 0; k < m; k++) {
                const double *mode = modes + k * N, c = product(mode, mass, x);
                for (size_t i = 0; i < N; i++) x[i] -= c * mode[i];
            }
            for (size_t i = 0; i < N; i++)
                for (size_t j = 0; j < N; j++) b[i] += mass[i * N + j] * x[j];
            memcpy(a, stiffness, sizeof a);
            dense_solve(N, a, b, x);
            const double norm = sqrt(product(x, mass, x));
            for (size_t i = 0; i < N; i++) x[i] /= norm;
        }
        periods[m] = 2.0 * RISER_PI / sqrt(product(x, stiffness, x));
    }
}

TEST("periods and matrices agree with those computed from the energies") {
    const lg_riser_parameters cases[] = {standard(LG_HOUSING_TIGHT, 1.0), odd_ones()};
    for (size_t c = 0; c < LG_COUNT(cases); c++) {
        const lg_riser_parameters *p = &cases[c];
        const double k = p->severity * p->housing_stiffness;
        double mass[N * N], stiffness[N * N], line[N * N], modes[5 * N], expected[5], periods[N];
#define KINETIC(v)   riser_kinetic(p, v)
#define POTENTIAL(q) riser_potential(p, k, q)
#define LINE(q)      riser_line_energy(p, q)
        RISER_MATRIX(KINETIC, mass);
        RISER_MATRIX(POTENTIAL, stiffness);
        RISER_MATRIX(LINE, line);
        inverse_iteration(mass, stiffness, 5, modes, expected);
        assert_ok(riser_periods(p, true, periods));
        assert_all_close(periods, expected, 5, 1e-10, 0.0);

        lg_riser_matrices m;
        lg_riser_matrices_make(p, &m);
        const double offset = 2.0 * p->damping_offset * sqrt(p->soil_stiffness * mass[0]);
        const double rotation = 2.0 * p->damping_rotation * sqrt(p->housing_stiffness * mass[N + 1]);
        for (size_t i = 0; i < N * N; i++) {
            const double dashpot = i == 0 ? offset : i == N + 1 ? rotation : 0.0;
            const double spring = i == 0 ? p->soil_stiffness : i == N + 1 ? k : 0.0;
            assert_close(m.mass[i], mass[i], 1e-11, 1e-5);
            assert_close(m.stiffness[i], stiffness[i] - spring, 1e-9, 1.0);
            assert_close(m.damping[i], p->damping_riser * line[i] + dashpot, 1e-9, 1e-2);
        }
    }
}

/* ---- setups ---- */

TEST("a completion adds a tree of 4 m below the BOP, and brine replaces mud") {
    const lg_riser_parameters before = standard(LG_HOUSING_SLACK, 1.0);
    lg_riser_parameters after = before;
    lg_riser_complete(&after);
    const double total = after.bop_mass + after.bop_added_mass;
    assert_close(total, 320e3 + 75e3, 1e-15, 0.0);
    assert_close(after.bop_added_mass, 145e3, 1e-15, 0.0);
    assert_close(total * after.bop_centre, 320e3 * 9.0 + 75e3 * 2.0, 1e-14, 0.0);
    assert_close(after.bop_height, 14.0, 1e-15, 0.0);
    assert_close(after.bop_volume, 70.0, 1e-15, 0.0);
    assert_close(after.bop_weight, 1.99e6, 1e-15, 0.0);
    assert_close(after.sensor_lower, 13.0, 1e-15, 0.0);
    assert_close(after.relief_height, 12.0, 1e-15, 0.0);
    assert_close(after.riser_mass, 493.0, 1e-14, 0.0);
    assert_close(after.submerged_weight, 1500.0 - 57.0 * 9.81, 1e-14, 0.0);
    assert_ok(lg_riser_parameters_check(&after, NULL));
}

TEST("wires shorten every period; very stiff wires hold the BOP where they are fastened") {
    for (int completion = 0; completion < 2; completion++) {
        lg_riser_parameters p = standard(LG_HOUSING_SLACK, 1.0);
        double free[N], held[N];
        if (completion) lg_riser_complete(&p);
        assert_ok(riser_periods(&p, true, free));
        p.relief_stiffness = 2e6;
        assert_ok(riser_periods(&p, true, held));
        printf("%s: %.4f %.4f %.4f s without, %.4f %.4f %.4f s with wires of 2e6 N/m\n",
               completion ? "completion" : "drilling", free[0], free[1], free[2], held[0], held[1], held[2]);
        for (int i = 0; i < N; i++) assert_true(held[i] <= free[i] * (1.0 + 1e-12));
        assert_true(held[1] * held[2] < 0.9 * free[1] * free[2]);
        p.relief_stiffness = 1e13;
        double q[2 * N] = {-p.relief_height * 1e-3, 1e-3}, v[2 * N] = {0.0};
        assert_ok(riser_free_motion(NULL, &p, 0.01, 20, true, q, v, NULL, NULL));
        printf("held at %g m: turned by %.2e rad, moved there by %.2e m\n", p.relief_height, q[1],
               q[0] + p.relief_height * q[1]);
        assert_true(fabs(q[1]) > 1e-4);
        assert_close(q[0] + p.relief_height * q[1], 0.0, 0.0, 1e-6);
    }
}

/* ---- foundation ---- */

TEST("moment and energy of the wellhead and of the soil are consistent") {
    lg_wellhead w;
    const lg_riser_parameters p = standard(LG_HOUSING_SLACK, 0.58);
    const double casing = 0.58 * 150e6, inner = 1.0 / (1.0 / 300e6 + 1.0 / casing), gap = 60e3 / inner;
    lg_wellhead_make(&p, &w);
    for (double r = 1e-7; r < 0.1; r *= 1.3) {
        double moment = r < gap ? inner * r : 60e3 + casing * (r - gap);
        moment /= 1.0 + r / 0.03;
        assert_close(lg_wellhead_secant(&w, r) * r, moment, 1e-13, 0.0);
        const double d = 1e-5 * r;
        if (fabs(r - gap) > 2.0 * d) /* energy is the integral of the moment */
            assert_close((wellhead_energy(&w, r + d) - wellhead_energy(&w, r - d)) / (2.0 * d), moment, 1e-7,
                         0.0);
    }
    assert_close(wellhead_energy(&w, gap * (1.0 + 1e-13)), wellhead_energy(&w, gap), 1e-12, 0.0);
    assert_close(lg_wellhead_secant(&w, 0.0), inner, 1e-14, 0.0);
    const lg_riser_parameters tight = standard(LG_HOUSING_TIGHT, 0.58);
    lg_wellhead_make(&tight, &w);
    assert_close(lg_wellhead_secant(&w, 0.02), casing, 0.0, 0.0);
    assert_close(wellhead_energy(&w, 0.02), 0.5 * casing * 4e-4, 1e-15, 0.0);
    for (double r = 1e-12; r < 10.0; r *= 3.0) {
        const double force = 3e6 * tanh(1.2e8 * r / 3e6), d = 1e-5 * r;
        assert_close(lg_soil_secant(1.2e8, 3e6, r) * r, force, 1e-13, 0.0);
        assert_close((soil_energy(1.2e8, 3e6, r + d) - soil_energy(1.2e8, 3e6, r - d)) / (2.0 * d), force,
                     1e-7, 0.0);
    }
}

/* ---- free motion ---- */

/* A linear riser: tight housing, and a soil that never yields. */
static lg_riser_parameters linear(void) {
    lg_riser_parameters p = standard(LG_HOUSING_TIGHT, 1.0);
    p.soil_strength = 1e30;
    return p;
}

static void kick(double *q, double *v) {
    memset(q, 0, 2 * N * sizeof *q);
    memset(v, 0, 2 * N * sizeof *v);
    for (size_t i = 0; i < N; i++) {
        q[i] = i == 1 ? 3e-3 : i == 0 ? 4e-3 : 0.2 * sin((double)i);
        v[N + i] = i == 1 ? 2e-3 : i == 0 ? 1e-3 : 0.1 * cos((double)i);
    }
}

/* max |E/E_0 - 1| over `time` seconds. */
static double drift(const lg_riser_parameters *p, double dt, double time) {
    const size_t steps = (size_t)llround(time / dt);
    double q[2 * N], v[2 * N], *energy = TEST_ARRAY(double, steps + 1), worst = 0.0;
    kick(q, v);
    assert_ok(riser_free_motion(NULL, p, dt, steps, false, q, v, energy, NULL));
    for (size_t i = 0; i <= steps; i++) worst = fmax(worst, fabs(energy[i] / energy[0] - 1.0));
    return worst;
}

TEST("a linear riser keeps its energy") {
    const lg_riser_parameters p = linear();
    const double worst = drift(&p, 0.05, 1000.0);
    printf("linear, tight: energy drifts by %.1e in 20000 steps\n", worst);
    assert_true(worst < 1e-11);
}

TEST("a slack riser keeps its energy to second order") {
    const lg_riser_parameters p = standard(LG_HOUSING_SLACK, 0.58);
    double before = 0.0;
    for (double dt = 0.04; dt > 0.002; dt /= 2.0) {
        const double worst = drift(&p, dt, 200.0);
        printf("slack: dt = %.4f, energy within %.2e\n", dt, worst);
        assert_true(worst < 60.0 * dt * dt);
        assert_true(before == 0.0 || worst < before / 2.5);
        before = worst;
    }
}

/* The energy at the start must agree with riser_check.h, and damping must reduce it in every step. */
TEST("damping reduces the energy in every step") {
    enum { STEPS = 4000 };
    const lg_riser_parameters p = linear();
    double q[2 * N], v[2 * N], energy[STEPS + 1], start = 0.0;
    kick(q, v);
    for (int d = 0; d < 2; d++) start += riser_kinetic(&p, v + d * N) + riser_potential(&p, 150e6, q + d * N);
    assert_ok(riser_free_motion(NULL, &p, 0.05, STEPS, true, q, v, energy, NULL));
    assert_close(energy[0], start, 1e-12, 0.0);
    for (int i = 0; i < STEPS; i++) assert_true(energy[i + 1] < energy[i]);
    assert_true(energy[STEPS] < 1e-3 * start);
}

TEST("in still water drag takes the power force times velocity") {
    lg_riser_parameters p = linear();
    p.damping_offset = p.damping_rotation = p.damping_riser = 0.0;
    const double l = 90.0 / 13.0, dt = 1e-5;
    double q[2 * N], v[2 * N], energy[2], power = 0.0;
    kick(q, v);
    for (int s = 0; s < N; s++) {
        const double z = s == 0 ? 5.0 : 10.0,
                     area = s == 0 ? 1.8 * 45.0 : 1.1 * 0.9 * l * (s == 1 ? 0.5 : 1.0);
        double w[2];
        for (int d = 0; d < 2; d++) w[d] = s < 2 ? v[d * N] + z * v[d * N + 1] : v[d * N + s];
        power += 0.5 * 1025.0 * area * pow(hypot(w[0], w[1]), 3.0);
    }
    assert_ok(riser_free_motion(NULL, &p, dt, 1, true, q, v, energy, NULL));
    assert_close((energy[1] - energy[0]) / dt, -power, 1e-3, 0.0);
}

TEST("free motion has order 2, and a mode keeps its shape") {
    enum { MODES = 3, HALVINGS = 6 };
    const lg_riser_parameters p = linear(), *const pp = &p;
    double mass[N * N], stiffness[N * N], modes[MODES * N], periods[MODES];
#define MASS(v)      riser_kinetic(pp, v)
#define STIFFNESS(q) riser_potential(pp, 150e6, q)
    RISER_MATRIX(MASS, mass);
    RISER_MATRIX(STIFFNESS, stiffness);
    inverse_iteration(mass, stiffness, MODES, modes, periods);
    for (int m = 0; m < MODES; m++) {
        fit_line fit = {0};
        for (int k = 0; k <= HALVINGS; k++) {
            const double dt = 0.05 / (double)(1 << k), time = 3.0;
            double q[2 * N] = {0.0}, v[2 * N] = {0.0}, error = 0.0, size = 0.0;
            memcpy(q, modes + m * N, N * sizeof *q);
            assert_ok(riser_free_motion(NULL, &p, dt, (size_t)llround(time / dt), false, q, v, NULL, NULL));
            for (size_t i = 0; i < N; i++) {
                const double exact = cos(2.0 * RISER_PI / periods[m] * time) * modes[m * N + i];
                error = fmax(error, fabs(q[i] - exact));
                size = fmax(size, fabs(modes[m * N + i]));
            }
            fit_add(&fit, log(dt), log(error / size));
        }
        const double slope = fit_slope(&fit);
        printf("free, mode %d (%.3f s): order %.3f over %d halvings\n", m + 1, periods[m], slope, HALVINGS);
        assert_close(slope, 2.0, 0.0, 0.05);
    }
}

/* ---- forced motion ---- */

/* The state (q, v) after `time` from rest, in waves and current. */
static void forced(const lg_riser_parameters *p, double drag_scale, double dt, double time, double *out) {
    lg_riser_run run;
    lg_water water;
    lg_riser_motion *motion = aligned_alloc(64, (sizeof *motion + 63) / 64 * 64);
    lg_riser_run_init(&run);
    run.sea = (lg_sea_state){.height = 3.0, .period = 8.0, .direction = 0.6};
    run.dt = dt;
    run.ramp = 15.0;
    assert_ok(lg_water_create(NULL, p, &run, &water));
    assert_ok(lg_riser_motion_init(p, dt, true, drag_scale, motion));
    lg_riser_motion_start(motion, lg_water_at(&water, 0));
    const size_t steps = (size_t)llround(time / dt);
    for (size_t i = 0; i < steps; i++) lg_riser_motion_step(motion, lg_water_at(&water, i + 1));
    memcpy(out, motion->q, sizeof motion->q);
    memcpy(out + LG_RISER_STATE, motion->v, sizeof motion->v);
    lg_water_destroy(NULL, &water);
    free(motion);
}

static double forced_order(const char *name, const lg_riser_parameters *p, double drag_scale) {
    enum { HALVINGS = 5, S = 2 * LG_RISER_STATE };
    const double time = 40.0;
    double reference[S];
    fit_line fit = {0};
    forced(p, drag_scale, 0.05 / 512, time, reference);
    for (int k = 0; k <= HALVINGS; k++) {
        const double dt = 0.05 / (double)(1 << k);
        double at[S], error = 0.0, size = 0.0;
        forced(p, drag_scale, dt, time, at);
        for (size_t i = 0; i < S; i++) {
            error += (at[i] - reference[i]) * (at[i] - reference[i]);
            size += reference[i] * reference[i];
        }
        printf("  dt %.5f: %.2e\n", dt, sqrt(error / size));
        fit_add(&fit, log(dt), 0.5 * log(error / size));
    }
    const double slope = fit_slope(&fit);
    printf("forced, %s: order %.3f over %d halvings\n", name, slope, HALVINGS);
    return slope;
}

TEST("forced motion has order 2") {
    lg_riser_parameters p = linear();
    assert_close(forced_order("linear, no drag", &p, 0.0), 2.0, 0.0, 0.05);
    assert_close(forced_order("linear, drag", &p, 1.0), 2.0, 0.0, 0.1);
    p = standard(LG_HOUSING_SLACK, 0.58);
    assert_close(forced_order("slack, broken, soil, drag", &p, 1.0), 2.0, 0.0, 0.25);
}

/* ---- bad input ---- */

TEST("invalid arguments of free motion are refused, and nothing is written") {
    lg_riser_parameters p = linear();
    double q[2 * N], v[2 * N], kept[2 * N], energy[3] = {7.0, 7.0, 7.0};
    lg_error error;
    kick(q, v);
    memcpy(kept, q, sizeof q);
    assert_status(riser_free_motion(NULL, &p, 0.0, 2, false, q, v, energy, &error), LG_INVALID_ARGUMENT);
    assert_status(riser_free_motion(NULL, &p, NAN, 2, false, q, v, energy, &error), LG_INVALID_ARGUMENT);
    assert_status(riser_free_motion(NULL, &p, INFINITY, 2, false, q, v, energy, NULL), LG_INVALID_ARGUMENT);
    assert_status(riser_free_motion(NULL, &p, 0.05, 2, false, q, NULL, energy, NULL), LG_INVALID_ARGUMENT);
    assert_status(riser_periods(&p, true, NULL), LG_INVALID_ARGUMENT);
    const volatile int stop = 1;
    lg_context_options options;
    lg_context *context;
    lg_context_options_init(&options);
    options.cancel = &stop;
    assert_ok(lg_context_create(&options, &context));
    assert_status(riser_free_motion(context, &p, 0.05, 2, false, q, v, energy, &error), LG_CANCELLED);
    lg_context_destroy(context);
    assert_status(riser_free_motion(NULL, &p, 0.05, 2, false, NULL, v, energy, NULL), LG_INVALID_ARGUMENT);
    assert_status(riser_free_motion(NULL, NULL, 0.05, 2, false, q, v, energy, NULL), LG_INVALID_ARGUMENT);
    assert_status(riser_free_motion(NULL, &p, 0.05, SIZE_MAX, false, q, v, energy, &error), LG_OUT_OF_MEMORY);
    q[3] = NAN;
    assert_status(riser_free_motion(NULL, &p, 0.05, 2, false, q, v, energy, &error), LG_NOT_FINITE);
    q[3] = kept[3];
    p.bop_weight = 1e12; /* so heavy that the stack falls over */
    assert_status(riser_free_motion(NULL, &p, 0.05, 2, false, q, v, energy, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "stand");
    assert_status(riser_periods(&p, true, kept), LG_INVALID_ARGUMENT);
    assert_status(riser_periods(NULL, true, kept), LG_INVALID_ARGUMENT);
    kick(kept, v);
    assert_memory_equal(q, kept, sizeof q);
    assert_true(energy[0] == 7.0 && energy[2] == 7.0);
    p = linear();
    assert_ok(riser_free_motion(NULL, &p, 0.05, 0, false, q, v, energy, NULL));
    assert_memory_equal(q, kept, sizeof q);
    assert_true(energy[0] > 0.0 && energy[1] == 7.0);
}

TEST("impossible parameters are refused by name") {
    lg_riser_parameters p;
    lg_error error;
#define REFUSED(member, value)                                                                               \
    do {                                                                                                     \
        lg_riser_parameters_init(&p);                                                                        \
        p.member = (value);                                                                                  \
        assert_status(lg_riser_parameters_check(&p, &error), LG_INVALID_ARGUMENT);                           \
        assert_non_null(strstr(error.message, #member));                                                     \
    } while (0)
    REFUSED(relief_stiffness, -1.0);
    REFUSED(relief_height, NAN);
    REFUSED(severity, 0.0);
    REFUSED(severity, 1.01);
    REFUSED(severity, NAN);
    REFUSED(depth, -1.0);
    REFUSED(bop_height, 100.0);
    REFUSED(top_tension, INFINITY);
    REFUSED(drag, -0.1);
    REFUSED(soil_strength, 0.0);
    REFUSED(current, NAN);
    REFUSED(housing, (lg_housing)LG_HOUSING_COUNT);
    REFUSED(size, 8);
    lg_riser_parameters_init(&p);
    assert_ok(lg_riser_parameters_check(&p, &error));
    assert_string_equal(error.message, "");
    assert_string_equal(lg_riser_channel(4), "moment_x");
    assert_null(lg_riser_channel(LG_RISER_CHANNELS));
}

TEST("every allocation may fail") {
    const lg_riser_parameters p = linear();
    double q[2 * N], v[2 * N], energy[3];
    EVERY_ALLOCATION_FAILS(context, 2, {
        kick(q, v);
        status = riser_free_motion(context, &p, 0.05, 2, true, q, v, energy, NULL);
    });
}
