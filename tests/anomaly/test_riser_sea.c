/* Sea, sensors and runs of the riser.
 * ctest-labels: src/mechanics */
#include "test_support.h"

#include "liegrad/anomaly.h"
#include "support/dense_solve.h"
#include "anomaly/riser_check.h"
#include "anomaly/riser.h"
#include "support/fixtures.h"
#include "support/malloc_count.h"

enum { N = LG_RISER_DOF, C = LG_RISER_CHANNELS, WAVES = LG_RISER_COMPONENTS };

/* ---- waves ---- */

static double jonswap(double x) {
    const double sigma = x > 1.0 ? 0.09 : 0.07;
    return exp(-1.25 / (x * x * x * x)) / (x * x * x * x * x) *
           pow(3.3, exp(-(x - 1.0) * (x - 1.0) / (2.0 * sigma * sigma)));
}

/* By Simpson's rule. */
static double energy_between(double a, double b) {
    enum { CELLS = 2000 };
    const double h = (b - a) / CELLS;
    double sum = 0.0;
    for (int i = 0; i < CELLS; i++) {
        const double x = a + i * h;
        sum += h / 6.0 * (jonswap(x) + 4.0 * jonswap(x + 0.5 * h) + jonswap(x + h));
    }
    return sum;
}

TEST("wave components share the spectrum's energy, and have its spread of directions") {
    const lg_sea_state sea = {.height = 3.2, .period = 9.0, .direction = 0.4};
    const double total = energy_between(0.4, 1.0) + energy_between(1.0, 5.0);
    printf("energy above 5 peak frequencies: %.2f %%\n", 100.0 * energy_between(5.0, 60.0) / total);
    double variance = 0.0, squares = 0.0, phases = 0.0, shares = 0.0;
    lg_wave waves[WAVES], again[WAVES];
    enum { SEEDS = 40 };
    for (uint64_t seed = 0; seed < SEEDS; seed++) {
        assert_ok(lg_sea_components(&sea, 100.0, 9.81, seed, waves));
        variance = 0.0;
        for (int j = 0; j < WAVES; j++) {
            const double x = waves[j].frequency * sea.period / (2.0 * RISER_PI),
                         turn = waves[j].direction - 0.4;
            variance += 0.5 * waves[j].amplitude * waves[j].amplitude;
            squares += turn * turn;
            phases += waves[j].phase;
            assert_true(fabs(turn) < RISER_PI / 2.0);
            if (seed > 0) continue;
            const double below = energy_between(0.4, fmin(x, 1.0)) + (x > 1.0 ? energy_between(1.0, x) : 0.0);
            assert_true(below / total * WAVES > j - 1e-3 && below / total * WAVES < j + 1 + 1e-3);
            shares += below / total * WAVES - j;
        }
        assert_close(variance, 3.2 * 3.2 / 16.0, 1e-13, 0.0);
    }
    assert_close(shares / WAVES, 0.5, 0.0, 0.1);
    assert_close(phases / (WAVES * SEEDS), RISER_PI, 0.02, 0.0);
    double top = 0.0, bottom = 0.0; /* variance of an angle with density cos^12 */
    for (double x = -RISER_PI / 2.0; x < RISER_PI / 2.0; x += 1e-4) {
        top += x * x * pow(cos(x), 12.0);
        bottom += pow(cos(x), 12.0);
    }
    assert_close(squares / (WAVES * SEEDS), top / bottom, 0.05, 0.0);
    assert_ok(lg_sea_components(&sea, 100.0, 9.81, SEEDS - 1, again));
    assert_memory_equal(again, waves, sizeof waves);
}

TEST("wave numbers satisfy the dispersion relation") {
    for (double w = 1e-4; w < 50.0; w *= 1.3) {
        const double k = lg_dispersion(w, 100.0, 9.81);
        assert_close(9.81 * k * tanh(k * 100.0), w * w, 4e-15, 0.0);
        if (w > 2.0) assert_close(k, w * w / 9.81, 1e-13, 0.0);
        if (w < 1e-3) assert_close(k, w / sqrt(981.0), 2e-6, 0.0);
    }
}

/* ---- kinematics ---- */

/* The sums over waves computed directly with the C library. row: velocities at the stations, and the
 * generalised inertia force. */
static void direct_row(const lg_riser_parameters *p, const lg_wave *waves, double t, double *row) {
    const double l = (p->depth - p->bop_height) / 13.0, area = RISER_PI / 4.0 * pow(p->hydro_diameter, 2.0);
    memset(row, 0, 2 * LG_RISER_STATE * sizeof *row);
    for (int s = 0; s < N; s++) {
        const double z = s == 0 ? p->bop_centre : p->bop_height + l * (s - 1);
        double u[2] = {p->current * pow(z / p->depth, 1.0 / 7.0), 0.0}, a[2] = {0.0, 0.0};
        for (int j = 0; j < WAVES; j++) {
            const lg_wave *w = &waves[j];
            const double k = w->wavenumber,
                         speed = w->amplitude * w->frequency * cosh(k * z) / sinh(k * p->depth);
            for (int d = 0; d < 2; d++) {
                const double c = d ? sin(w->direction) : cos(w->direction);
                u[d] += c * speed * cos(w->frequency * t + w->phase);
                a[d] -= c * speed * w->frequency * sin(w->frequency * t + w->phase);
            }
        }
        const double mass = s == 0   ? p->rho * p->bop_volume + p->bop_added_mass
                            : s == 1 ? p->rho * area * (1.0 + p->added_mass) * l / 2.0
                                     : p->rho * area * (1.0 + p->added_mass) * l;
        for (int d = 0; d < 2; d++) {
            double *force = row + LG_RISER_STATE + d * LG_RISER_ROW;
            row[d * LG_RISER_ROW + s] = u[d];
            if (s > 1) {
                force[s] = mass * a[d];
            } else {
                force[0] += mass * a[d];
                force[1] += mass * a[d] * z; /* the lever above the sea floor */
            }
        }
    }
}

TEST("velocities and forces of the water agree with the direct sums") {
    static const size_t steps[] = {3999, 4000, 4095, 4096, 4097, 4223, 4224, 4225, 4351, 4352, 76000, 7};
    lg_riser_parameters p;
    lg_riser_run run;
    lg_water water;
    lg_wave waves[WAVES];
    double row[2 * LG_RISER_STATE], worst = 0.0;
    lg_riser_parameters_init(&p);
    lg_riser_run_init(&run);
    run.sea = (lg_sea_state){.height = 4.5, .period = 8.0, .direction = 0.9};
    assert_ok(lg_sea_components(&run.sea, p.depth, p.gravity, run.seed, waves));
    assert_ok(lg_water_create(NULL, &p, &run, &water));
    for (size_t i = 0; i < LG_COUNT(steps); i++) {
        const double t = (double)steps[i] * 0.05,
                     ramp = t < 100.0 ? 0.5 - 0.5 * cos(RISER_PI * t / 100.0) : 1.0;
        const double *at = lg_water_at(&water, steps[i]);
        direct_row(&p, waves, t, row);
        for (int k = 0; k < LG_RISER_STATE; k++) {
            const int force = LG_RISER_STATE + k;
            worst = fmax(worst, fabs(at[k] - ramp * row[k]));
            worst = fmax(worst, fabs(at[force] - ramp * row[force]) / 1e5);
        }
    }
    printf("kinematics against direct sums: %.1e\n", worst);
    assert_true(worst < 1e-12);
    lg_water_destroy(NULL, &water);
}

/* ---- sensors without waves ---- */

static void simulate(const lg_riser_parameters *p, const lg_riser_run *run, size_t count, float *out) {
    assert_told(lg_riser_simulate(NULL, p, run, count, out, &told));
}

static lg_riser_run quiet_run(void) {
    lg_riser_run run;
    lg_riser_run_init(&run);
    run.sea.height = 0.0;
    run.noise = 0.0;
    return run;
}

TEST("a calm sea moves nothing, and noise has its deviation") {
    enum { COUNT = 18001 };
    float *x = TEST_ARRAY(float, COUNT *C);
    lg_riser_parameters p;
    lg_riser_run run = quiet_run();
    lg_riser_parameters_init(&p);
    p.current = 0.0;
    simulate(&p, &run, 100, x);
    for (int i = 0; i < 100 * C; i++) assert_true(x[i] == 0.0f);
    run.noise = 10.0;
    simulate(&p, &run, COUNT, x);
    for (int c = 0; c < C; c++) {
        const double sigma = c < 4 ? 3e-3 : 5000.0;
        double sum = 0.0, squares = 0.0;
        for (int i = 0; i < COUNT; i++) {
            sum += (double)x[i * C + c] / COUNT;
            squares += (double)x[i * C + c] * (double)x[i * C + c] / COUNT;
        }
        assert_close(sqrt(squares), sigma, 0.03, 0.0);
        assert_close(sum, 0.0, 0.0, 4.0 * sigma / sqrt(COUNT));
    }
}

TEST("in a current alone the riser leans as the linear equations of riser_check.h predict") {
    lg_riser_parameters p;
    lg_riser_run run = quiet_run();
    lg_riser_parameters_init(&p);
    p.housing = LG_HOUSING_TIGHT;
    p.soil_strength = 1e30;
    p.severity = 0.7;
    const double k = 0.7 * 150e6, l = 90.0 / 13.0;
    double stiffness[N * N], force[N] = {0.0}, q[N];
    float x[C];
#define STIFFNESS(q) riser_potential(&p, k, q)
    RISER_MATRIX(STIFFNESS, stiffness);
    for (int s = 0; s < N; s++) {
        const double z = s == 0 ? 5.0 : 10.0 + l * (s - 1), u = 0.35 * pow(z / 100.0, 1.0 / 7.0);
        const double area = s == 0 ? 1.8 * 4.5 * 10.0 : 1.1 * 0.9 * l * (s == 1 ? 0.5 : 1.0);
        const double drag = 0.5 * 1025.0 * area * u * u;
        if (s > 1) {
            force[s] = drag;
        } else {
            force[0] += drag;
            force[1] += drag * z;
        }
    }
    dense_solve(N, stiffness, force, q);
    simulate(&p, &run, 1, x);
    const double expected[C] = {
        -9.81 * q[1], 0.0, -9.81 * (q[2] - q[0] - 10.0 * q[1]) / l, 0.0, k * q[1] + 1.2e8 * q[0], 0.0};
    for (int c = 0; c < C; c++) assert_close((double)x[c], expected[c], 1e-6, 1e-12);
}

/* The moments of a linear foundation determine u and th. Three places of the sensors determine u'', th'' and
 * the slope of the riser with its second derivative. Newmark's accelerations satisfy exactly (x_{n+1} - 2 x_n
 * + x_{n-1})/dt^2 = (x''_{n+1} + 2 x''_n + x''_{n-1})/4. */
TEST("all sensors measure the same motion") {
    enum { COUNT = 400, U = 0, TH, SLOPE, KINDS };
    lg_riser_parameters p;
    lg_riser_run run;
    float near[COUNT * C], far[COUNT * C];
    double x[KINDS][COUNT], acc[KINDS][COUNT], largest[KINDS] = {0.0}, worst[KINDS] = {0.0};
    lg_riser_parameters_init(&p);
    p.housing = LG_HOUSING_TIGHT;
    p.soil_strength = 1e30;
    lg_riser_run_init(&run);
    run.noise = 0.0;
    run.rate = 20.0;
    run.sea.height = 6.0;
    p.sensor_lower = p.sensor_upper = p.sensor_moment = 0.0;
    simulate(&p, &run, COUNT, near);
    p.sensor_lower = 9.0;
    p.sensor_upper = 2.0;
    p.sensor_moment = 1.0;
    simulate(&p, &run, COUNT, far);
    for (int d = 0; d < 2; d++) {
        for (int i = 0; i < COUNT; i++) {
            const float *a = near + i * C + d, *b = far + i * C + d;
            x[TH][i] = (double)a[4] / 150e6;
            x[U][i] = (double)(b[4] - a[4]) / 1.2e8;
            acc[TH][i] = (double)(b[0] - a[0]) / 9.0;
            acc[U][i] = (double)a[0] + 9.81 * x[TH][i];
            acc[SLOPE][i] = (double)(b[2] - a[2]) / 2.0;
            x[SLOPE][i] = (acc[U][i] + 10.0 * acc[TH][i] - (double)a[2]) / 9.81;
        }
        for (int k = 0; k < KINDS; k++)
            for (int i = 1; i + 1 < COUNT; i++) {
                const double mean = 0.25 * (acc[k][i - 1] + 2.0 * acc[k][i] + acc[k][i + 1]);
                const double second = (x[k][i - 1] - 2.0 * x[k][i] + x[k][i + 1]) / 0.0025;
                worst[k] = fmax(worst[k], fabs(second - mean));
                largest[k] = fmax(largest[k], fabs(mean));
            }
    }
    for (int k = 0; k < KINDS; k++) {
        printf("second derivative up to %.1e, within %.1e\n", largest[k], worst[k]);
        assert_true(worst[k] < 2e-3 * largest[k]);
    }
}

/* ---- responses to damage ---- */

static void deviations(const float *x, size_t first, size_t count, double out[C]) {
    for (size_t c = 0; c < C; c++) {
        double mean = 0.0, squares = 0.0;
        for (size_t i = first; i < first + count; i++) mean += (double)x[i * C + c] / (double)count;
        for (size_t i = first; i < first + count; i++)
            squares += ((double)x[i * C + c] - mean) * ((double)x[i * C + c] - mean) / (double)count;
        out[c] = sqrt(squares);
    }
}

TEST("the response grows with the severity") {
    enum { COUNT = 6000 };
    static const double severities[] = {1.0, 0.9, 0.75, 0.58, 0.45};
    float *x = TEST_ARRAY(float, COUNT *C);
    lg_riser_parameters p;
    lg_riser_run run;
    double slack_before = 0.0, tight_before = 0.0, sd[C];
    uint32_t label, sea;
    for (size_t i = 0; i < LG_COUNT(severities); i++) {
        lg_riser_standard_run(45, 7, severities[i], &p, &run, &label, &sea);
        simulate(&p, &run, COUNT, x);
        deviations(x, 0, COUNT, sd);
        const double slack = sd[0];
        p.housing = LG_HOUSING_TIGHT;
        simulate(&p, &run, COUNT, x);
        deviations(x, 0, COUNT, sd);
        printf("severity %.2f: lower acceleration %.2e slack, %.2e tight\n", severities[i], slack, sd[0]);
        assert_true(slack > 1.05 * sd[0] && slack > slack_before && sd[0] > tight_before);
        slack_before = slack;
        tight_before = sd[0];
    }
}

TEST("ratios of broken to intact are within their bounds") {
    enum { COUNT = 6000, CONDITIONS = 9 };
    static const double low[3] = {1.40, 1.05, 0.99}, high[3] = {1.65, 1.12, 1.06};
    float *x = TEST_ARRAY(float, COUNT *C);
    double ratio[C] = {0.0};
    for (uint32_t i = 0; i < CONDITIONS; i++) {
        double sd[2][C];
        for (uint32_t broken = 0; broken < 2; broken++) {
            lg_riser_parameters p;
            lg_riser_run run;
            uint32_t label, sea;
            lg_riser_standard_run(2 * (6 * i + 2) + broken, 11, 0.58, &p, &run, &label, &sea);
            simulate(&p, &run, COUNT, x);
            deviations(x, 0, COUNT, sd[broken]);
        }
        for (int c = 0; c < C; c++) ratio[c] += log(sd[1][c] / sd[0][c]) / CONDITIONS;
    }
    for (int c = 0; c < C; c++)
        printf("%s: broken/intact %.3f\n", lg_riser_channel((uint32_t)c), exp(ratio[c]));
    for (int c = 0; c < C; c++) assert_true(exp(ratio[c]) > low[c / 2] && exp(ratio[c]) < high[c / 2]);
}

TEST("wires calm the BOP and hide a part of the crack, in drilling and in completion") {
    enum { COUNT = 6000, CONDITIONS = 5 };
    static const double wires[] = {0.0, 2e6};
    float *x = TEST_ARRAY(float, COUNT *C);
    for (int completion = 0; completion < 2; completion++) {
        double ratio[2] = {0.0}, size[2] = {0.0};
        for (uint32_t i = 0; i < 4 * CONDITIONS; i++) {
            const uint32_t broken = i % 2, relief = i / 2 % 2;
            lg_riser_parameters p;
            lg_riser_run run;
            uint32_t label, sea;
            double sd[C];
            lg_riser_standard_run(2 * (11 * (i / 4) + 2) + broken, 11, 0.58, &p, &run, &label, &sea);
            if (completion) lg_riser_complete(&p);
            p.relief_stiffness = wires[relief];
            simulate(&p, &run, COUNT, x);
            deviations(x, 0, COUNT, sd);
            ratio[relief] += (broken ? 1.0 : -1.0) * log(sd[0]) / CONDITIONS;
            if (!broken) size[relief] += log(sd[0]) / CONDITIONS;
        }
        printf("%s: lower acceleration broken/intact %.3f, with wires %.3f; wires/none %.3f\n",
               completion ? "completion" : "drilling", exp(ratio[0]), exp(ratio[1]), exp(size[1] - size[0]));
        assert_true(size[1] < size[0] && ratio[1] < 0.8 * ratio[0] && ratio[1] > 0.05);
    }
}

/* ---- runs ---- */

TEST("a crack changes nothing before its time") {
    enum { COUNT = 1500, AT = 301, BYTES = COUNT * C * sizeof(float) };
    float *intact = lg_test_memory(BYTES), *broken = lg_test_memory(BYTES), *cracked = lg_test_memory(BYTES);
    lg_riser_parameters p;
    lg_riser_run run;
    double sd[2][C];
    lg_riser_parameters_init(&p);
    lg_riser_run_init(&run);
    run.noise = 0.0;
    run.discard = 120.0;
    simulate(&p, &run, COUNT, intact);
    p.severity = 0.58;
    simulate(&p, &run, COUNT, broken);
    run.crack_time = 60.1; /* between samples 300 and 301 */
    simulate(&p, &run, COUNT, cracked);
    assert_memory_equal(cracked, intact, AT * C * sizeof(float));
    assert_true(fabsf(cracked[AT * C] - intact[AT * C]) > 1e-6f);
    deviations(cracked, AT + 100, COUNT - AT - 100, sd[0]);
    deviations(broken, AT + 100, COUNT - AT - 100, sd[1]);
    assert_all_close(sd[0], sd[1], C, 0.02, 0.0);
    run.crack_time = INFINITY;
    simulate(&p, &run, COUNT, cracked);
    assert_memory_equal(cracked, intact, BYTES);
    run.crack_time = 1e6;
    simulate(&p, &run, COUNT, cracked);
    assert_memory_equal(cracked, intact, BYTES);
    run.crack_time = 60.0;
    simulate(&p, &run, COUNT, cracked);
    assert_memory_equal(cracked, intact, (AT - 1) * C * sizeof(float));
    assert_true(fabsf(cracked[(AT - 1) * C] - intact[(AT - 1) * C]) > 1e-6f);
}

TEST("a shorter run is the beginning of a longer one, and other seeds differ") {
    enum { COUNT = 700 };
    float whole[COUNT * C], pieces[COUNT * C], other[COUNT * C];
    lg_riser_parameters p;
    lg_riser_run run;
    lg_riser_parameters_init(&p);
    lg_riser_run_init(&run);
    simulate(&p, &run, COUNT, whole);
    simulate(&p, &run, COUNT, other);
    assert_memory_equal(whole, other, sizeof whole);
    for (size_t n = 1; n < COUNT; n = 2 * n + 1) {
        simulate(&p, &run, n, pieces);
        assert_memory_equal(whole, pieces, n * C * sizeof *whole);
    }
    run.noise_seed = 2;
    simulate(&p, &run, COUNT, other);
    double largest = 0.0;
    for (int i = 0; i < COUNT; i++) {
        const double difference = fabs((double)(other[i * C] - whole[i * C]));
        assert_true(difference < 3e-4 * 10.0);
        largest = fmax(largest, difference);
    }
    assert_true(largest > 3e-4);
    run.noise_seed = 1;
    run.seed = 2;
    simulate(&p, &run, COUNT, other);
    double sum = 0.0;
    for (int i = 0; i < COUNT; i++) sum += fabs((double)(other[i * C + 4] - whole[i * C + 4])) / COUNT;
    assert_true(sum > 1e3);
}

TEST("standard runs differ in sea state, direction and seed as they should") {
    static const double heights[6] = {1.5, 2.0, 2.5, 3.0, 3.5, 4.5}, directions[3] = {20.0, 45.0, 70.0};
    size_t states[LG_SEA_STATES] = {0};
    uint64_t seeds[LG_RISER_RUNS], noises[LG_RISER_RUNS];
    for (uint32_t i = 0; i < LG_RISER_RUNS; i++) {
        lg_riser_parameters p;
        lg_riser_run run;
        uint32_t label, sea;
        lg_riser_standard_run(i, 5, 0.58, &p, &run, &label, &sea);
        assert_ok(lg_riser_parameters_check(&p, NULL));
        assert_int_equal(label, i % 2);
        assert_true(p.severity == (label ? 0.58 : 1.0) && p.housing == LG_HOUSING_SLACK &&
                    sea < LG_SEA_STATES);
        assert_close(p.flex_joint / 2e6, 1.0 + 0.15 * (p.top_tension - 1.1e6) / 3e5, 1e-12, 0.0);
        assert_true(p.top_tension == 1.1e6 + 3e5 * (double)(i / 36));
        states[sea]++;
        seeds[i] = run.seed;
        noises[i] = run.noise_seed;
        assert_true(i % 2 == 0 || seeds[i] == seeds[i - 1]);
        for (uint32_t j = 0; j < i; j++) {
            assert_true(noises[j] != noises[i]);
            assert_true(j / 2 == i / 2 || seeds[j] != seeds[i]);
        }
        assert_close(run.sea.height, heights[sea / 3], 0.0, 0.0);
        assert_true(fabs(run.sea.direction * 180.0 / RISER_PI - directions[sea % 3]) <= 10.0);
        const double stretch = (run.sea.period - 1.0) / (4.2 * sqrt(run.sea.height));
        assert_true(stretch >= 0.95 && stretch < 1.25);
    }
    for (int s = 0; s < LG_SEA_STATES; s++) assert_int_equal(states[s], 6);
}

/* ---- bad input ---- */

TEST("invalid parameters, runs and seas are refused by name") {
    float x[3 * C] = {9.0f};
    lg_riser_parameters p;
    lg_riser_run run;
    lg_error error;
    lg_riser_parameters_init(&p);
#define REFUSED(member, value, word)                                                                         \
    do {                                                                                                     \
        lg_riser_run_init(&run);                                                                             \
        run.member = (value);                                                                                \
        assert_status(lg_riser_simulate(NULL, &p, &run, 3, x, &error), LG_INVALID_ARGUMENT);                 \
        assert_says(error.message, word);                                                                    \
    } while (0)
    REFUSED(size, 3, "size");
    REFUSED(sea.height, -1.0, "height");
    REFUSED(sea.height, NAN, "height");
    REFUSED(sea.period, 0.0, "period");
    REFUSED(sea.direction, INFINITY, "direction");
    REFUSED(noise, -1.0, "noise");
    REFUSED(dt, 0.0, "dt");
    REFUSED(dt, INFINITY, "dt");
    REFUSED(rate, INFINITY, "rate");
    REFUSED(discard, 1e13, "discard");
    REFUSED(dt, 0.03, "whole");
    REFUSED(dt, 1.0, "whole");
    REFUSED(dt, 1e-300, "whole");
    REFUSED(rate, NAN, "rate");
    REFUSED(discard, -1.0, "discard");
    REFUSED(ramp, INFINITY, "ramp");
    REFUSED(crack_time, NAN, "crack_time");
    REFUSED(drag_scale, -1.0, "drag_scale");
    lg_riser_run_init(&run);
    assert_status(lg_riser_simulate(NULL, &p, &run, SIZE_MAX / 8, x, &error), LG_OUT_OF_MEMORY);
    assert_status(lg_riser_simulate(NULL, &p, &run, 3, NULL, &error), LG_INVALID_ARGUMENT);
    p.drag = 1e4; /* too large for the explicit drag term */
    run.sea.height = 20.0;
    assert_status(lg_riser_simulate(NULL, &p, &run, 3, x, &error), LG_NOT_FINITE);
    assert_says(error.message, "too large");
    lg_riser_parameters_init(&p);
    /* the standard weight is 1.6e6; at 3e7 the moment m g h equals K_r */
    static const double weights[] = {3e7, 1e9, 1e12};
    for (int i = 0; i < 3; i++) {
        lg_riser_run_init(&run);
        p.bop_weight = 1.2 * weights[i];
        assert_status(lg_riser_simulate(NULL, &p, &run, 3, x, &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, "stand");
        assert_status(lg_riser_parameters_check(&p, &error), LG_INVALID_ARGUMENT);
    }
    p.bop_weight = 2.5e7;
    assert_ok(lg_riser_parameters_check(&p, &error));
    p.severity = 0.5; /* the broken casing does not hold it */
    assert_status(lg_riser_parameters_check(&p, &error), LG_INVALID_ARGUMENT);
    lg_riser_parameters_init(&p);
    p.submerged_weight = 1e6; /* the weight is larger than the tension */
    assert_status(lg_riser_parameters_check(&p, &error), LG_INVALID_ARGUMENT);
    assert_true(x[0] == 9.0f);
    const lg_sea_state calm = {0};
    lg_wave waves[WAVES];
    assert_ok(lg_sea_components(&calm, 100.0, 9.81, 1, waves));
    assert_true(waves[0].amplitude == 0.0 && isfinite(waves[0].wavenumber));
    assert_status(lg_sea_components(&calm, 0.0, 9.81, 1, waves), LG_INVALID_ARGUMENT);
    assert_status(lg_sea_components(NULL, 100.0, 9.81, 1, waves), LG_INVALID_ARGUMENT);
    assert_status(lg_sea_components(&calm, 100.0, 9.81, 1, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_sea_components(&calm, 100.0, 0.0, 1, waves), LG_INVALID_ARGUMENT);
    static const lg_sea_state no_seas[] = {{.height = -1.0, .period = 8.0},
                                           {.height = INFINITY, .period = 8.0},
                                           {.height = 1.0, .period = 8.0, .direction = INFINITY},
                                           {.height = 1.0, .period = 0.0}};
    for (size_t i = 0; i < LG_COUNT(no_seas); i++)
        assert_status(lg_sea_components(&no_seas[i], 100.0, 9.81, 1, waves), LG_INVALID_ARGUMENT);
    lg_riser_run_init(&run);
    lg_riser_parameters_init(&p);
    static const struct {
        double height, period, depth;
        bool good;
    } seas[] = {{2.0, 1e-160, 100.0, false}, {2.0, 1e-310, 100.0, false}, {2.0, 1e160, 100.0, true},
                {2.0, 1e308, 100.0, true},   {2.0, 8.0, 1e-300, true},    {2.0, 8.0, 1e300, true},
                {1e308, 8.0, 100.0, true},   {2.0, 1e150, 1e-320, true},  {2.0, 1e308, 1e308, false},
                {2.0, 1e-100, 1e200, false}};
    for (size_t i = 0; i < LG_COUNT(seas); i++) {
        const lg_sea_state sea = {.height = seas[i].height, .period = seas[i].period};
        waves[0].wavenumber = -7.0;
        assert_status(lg_sea_components(&sea, seas[i].depth, 9.81, 1, waves),
                      seas[i].good ? LG_OK : LG_INVALID_ARGUMENT);
        assert_true(seas[i].good || waves[0].wavenumber == -7.0);
        for (int j = 0; j < WAVES && seas[i].good; j++) {
            const double k = waves[j].wavenumber, w = waves[j].frequency;
            assert_true(k > 0.0 && isfinite(k) && isfinite(waves[j].amplitude));
            assert_close(w / sqrt(9.81 * k) / sqrt(tanh(k * seas[i].depth)), 1.0, 1e-3, 0);
        }
    }
    lg_riser_run_init(&run);
    run.sea.period = 1e-160;
    assert_status(lg_riser_simulate(NULL, &p, &run, 3, x, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "cannot be computed: numbers overflow");
    run.sea.period = 8.0;
    run.sea.height = 1e308; /* m; the waves are finite, their forces are not */
    assert_status(lg_riser_simulate(NULL, &p, &run, 3, x, &error), LG_INVALID_ARGUMENT);
    /* Without any damping and with twice the step the motion stays bounded. */
    lg_riser_parameters_init(&p);
    p.damping_offset = p.damping_rotation = p.damping_riser = 0.0;
    lg_riser_run_init(&run);
    run.dt = 0.1;
    assert_ok(lg_riser_simulate(NULL, &p, &run, 3, x, &error));
    assert_true(fabsf(x[0]) < 1.0f);
}

TEST("a run can be cancelled, and every allocation may fail") {
    volatile int cancel = 1;
    lg_context_options options;
    lg_context *context;
    lg_riser_parameters p;
    lg_riser_run run;
    float x[2 * C] = {9.0f};
    lg_riser_parameters_init(&p);
    lg_riser_run_init(&run);
    lg_context_options_init(&options);
    options.cancel = &cancel;
    assert_ok(lg_context_create(&options, &context));
    assert_status(lg_riser_simulate(context, &p, &run, 2, x, NULL), LG_CANCELLED);
    lg_context_destroy(context);
    EVERY_ALLOCATION_FAILS(failing, 2, {
        x[0] = 9.0f;
        status = lg_riser_simulate(failing, &p, &run, 2, x, NULL);
        assert_true(status == LG_OK || x[0] == 9.0f);
    });
}
