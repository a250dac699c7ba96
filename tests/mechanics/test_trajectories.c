/* Systems on R^4, starts, sampled trajectories, and invalid input. */
#include "support/fixtures.h"
#include "mechanics/system_check.h"

/* Chains in Hamiltonian form with m = L = g = 1. */
static lg_system *make(const char *name, size_t links) {
    return strcmp(name, "pendulum-chain") == 0 ? make_chain("hamiltonian", links, 1.0, NULL, NULL)
                                               : make_system(name, NULL, NULL, 0);
}

TEST("the quartic system's energy at one point agrees with (4.3.4) computed by hand") {
    double work[1];
    lg_system *quartic = make("quartic", 1);
    assert_close(lg_system_hamiltonian(quartic, (double[]){1.0, 2.0, 1.0, -1.0}, work), 6.0 + 4.25 + 2.5,
                 1e-15, 0.0);
    assert_string_equal(lg_system_layout(quartic), "q p");
}

TEST("the first of the coupled oscillators is harmonic, and G is kept") {
    lg_system *system = make("coupled-oscillators", 1);
    const double y[4] = {0.4, -0.7, 0.3, 0.6}, times[2] = {0.1, 7.0};
    double out[8], work[1];
    assert_ok(lg_system_solve(NULL, system, y, 1, times, 2, 0.0, 0.0, out, NULL));
    for (int i = 0; i < 2; i++) {
        assert_close(out[4 * i], 0.4 * cos(times[i]) + 0.3 * sin(times[i]), 0.0, 2e-12);
        assert_close(out[4 * i + 2], 0.3 * cos(times[i]) - 0.4 * sin(times[i]), 0.0, 2e-12);
    }
    assert_int_equal(lg_system_invariants(system), 2);
    assert_string_equal(lg_system_invariant_name(system, 1), "G");
    assert_null(lg_system_invariant_name(system, 2));
    assert_true(isnan(lg_system_invariant(system, 2, y, work)));
    for (size_t i = 0; i < 2; i++)
        assert_close(lg_system_invariant(system, i, out + 4, work), lg_system_invariant(system, i, y, work),
                     1e-11, 0.0);
}

TEST("starts have the distributions of the thesis") {
    lg_system *chain = make("pendulum-chain", 3), *quartic = make("quartic", 1);
    double y[18], mean[3] = {0}, tangent[3] = {0}, square = 0.0, box[4], low = 1.0, high = -1.0;
    lg_rng rng = test_rng(1, 0);
    const int n = 2000;
    for (int i = 0; i < n; i++) {
        assert_ok(lg_system_draw_start(chain, NULL, &rng, y));
        for (int j = 0; j < 3; j++) {
            assert_close(lg_dot3(y + 6 * j, y + 6 * j), 1.0, 1e-15, 0.0);
            assert_close(lg_dot3(y + 6 * j, y + 6 * j + 3), 0.0, 0.0, 1e-15);
            for (int c = 0; c < 3; c++) mean[c] += y[6 * j + c] / (3 * n);
            /* p = q x u with u uniform in [0, 1)^3, so p x q = u - q (q.u) has the mean 1/3 and the mean
             * square 2/3. */
            double along[3];
            lg_cross3(y + 6 * j + 3, y + 6 * j, along);
            for (int c = 0; c < 3; c++) tangent[c] += along[c] / (3 * n);
            square += lg_dot3(along, along) / (3 * n);
        }
        assert_ok(lg_system_draw_start(quartic, NULL, &rng, box));
        for (int c = 0; c < 4; c++) low = fmin(low, box[c]), high = fmax(high, box[c]);
    }
    for (int c = 0; c < 3; c++)
        assert_close(mean[c], 0.0, 0.0, 4.0 / sqrt(3.0 * 3 * n)); /* uniform on the sphere */
    for (int c = 0; c < 3; c++) assert_close(tangent[c], 1.0 / 3.0, 0.0, 4.0 / sqrt(3.0 * 3 * n));
    assert_close(square, 2.0 / 3.0, 0.0, 4.0 / sqrt(3.0 * n));
    assert_true(low >= -1.0 && low < -0.99 && high <= 1.0 && high > 0.99);
    lg_system *dual = make("rigid-body", 1), *body = make("rigid-body-attitude", 1);
    for (int i = 0; i < 100; i++) {
        assert_ok(lg_system_draw_start(dual, NULL, &rng, y));
        for (int c = 0; c < 3; c++) assert_true(fabs(y[c]) <= 1.0 && y[c] != 0.0);
    }
    assert_ok(lg_system_draw_start(body, NULL, &rng, y));
}

/* For a uniform rotation E R_ij = 0, E R_ij^2 = 1/3, E tr R = 0, E (tr R)^2 = 1, and E det is 1. */
TEST("drawn rotations are uniform, and the momenta of bodies lie in the box") {
    static const char *const names[] = {"rigid-body-attitude", "heavy-top", "satellite"};
    const int n = 4000;
    for (size_t k = 0; k < LG_COUNT(names); k++) {
        lg_system *system = make(names[k], 1);
        lg_rng rng = test_rng(31, k);
        double y[18], mean[9] = {0}, square[9] = {0}, trace = 0, traces = 0, most = 0;
        for (int i = 0; i < n; i++) {
            assert_ok(lg_system_draw_start(system, NULL, &rng, y));
            assert_true(lg_space_manifold_error(lg_system_space(system), y) < 1e-14);
            double normal[3];
            lg_cross3(y, y + 3, normal);
            assert_close(lg_dot3(normal, y + 6), 1.0, 0.0, 1e-14);
            for (int c = 0; c < 9; c++) mean[c] += y[c] / n, square[c] += y[c] * y[c] / n;
            trace += (y[0] + y[4] + y[8]) / n;
            traces += (y[0] + y[4] + y[8]) * (y[0] + y[4] + y[8]) / n;
            for (int c = 9; c < 12; c++) most = fmax(most, fabs(y[c]));
        }
        for (int c = 0; c < 9; c++) {
            assert_close(mean[c], 0.0, 0.0, 4.0 * sqrt(1.0 / 3.0 / n));
            assert_close(square[c], 1.0 / 3.0, 0.0, 4.0 * sqrt(4.0 / 45.0 / n));
        }
        assert_close(trace, 0.0, 0.0, 4.0 / sqrt(n));
        assert_close(traces, 1.0, 0.0, 4.0 * sqrt(2.0 / n));
        assert_true(most <= 1.0 && most > 0.99);
    }
}

TEST("samples keep the energy and depend only on the seed") {
    lg_system *system = make("pendulum-chain", 2);
    lg_trajectory_options o;
    lg_trajectory_options_init(&o);
    o.trajectories = 7, o.points = 3, o.t_end = 0.2, o.seed = 5;
    enum { N = 7, M = 3, D = 12 };
    double t[M], y[N * M * D], H[N], t2[M], y2[N * M * D], H2[N], work[36];
    assert_ok(lg_system_generate(NULL, system, &o, t, y, H, NULL));
    assert_true(t[0] == 0.0 && t[1] == 0.1 && t[2] == 0.2);
    /* Another tolerance changes the states by less than 1e-8, and the energy is that of the start
     * everywhere. */
    o.rtol = 1e-9, o.atol = 1e-10;
    assert_ok(lg_system_generate(NULL, system, &o, t2, y2, H2, NULL));
    assert_all_close(y2, y, N * M * D, 0.0, 1e-8);
    for (int i = 0; i < N; i++)
        for (int j = 0; j < M; j++)
            assert_close(lg_system_hamiltonian(system, y + (i * M + j) * D, work), H[i], 1e-11, 1e-11);
    /* The same seed gives the same bits, and the same starts for other N, M, T and noise. */
    o.rtol = 1e-12, o.atol = -1e-13;
    assert_ok(lg_system_generate(NULL, system, &o, t2, y2, H2, NULL));
    assert_memory_equal(y, y2, sizeof(y));
    o.trajectories = 3, o.points = 2, o.t_end = 0.1, o.noise = 0.1;
    assert_ok(lg_system_generate(NULL, system, &o, t2, y2, H2, NULL));
    for (int i = 0; i < 3; i++) {
        assert_memory_equal(y2 + i * 2 * D, y + i * M * D, D * sizeof(double));
        assert_true(H2[i] == H[i]);
    }
    o.seed = 6;
    assert_ok(lg_system_generate(NULL, system, &o, t2, y2, H2, NULL));
    assert_true(y2[0] != y[0]);
}

TEST("noise has its distribution, and leaves the first point unchanged") {
    enum { N = 400, M = 3, D = 6 };
    lg_system *system = make("pendulum-chain", 1);
    lg_trajectory_options o;
    lg_trajectory_options_init(&o);
    o.trajectories = N, o.points = M;
    static double clean[N * M * D], noisy[N * M * D], H[N], t[M];
    assert_ok(lg_system_generate(NULL, system, &o, t, clean, H, NULL));
    for (int kind = 0; kind < 2; kind++) {
        double sum = 0, square = 0, largest = 0;
        o.noise = 1e-2, o.noise_kind = (lg_noise)kind;
        assert_ok(lg_system_generate(NULL, system, &o, t, noisy, H, NULL));
        for (int i = 0; i < N * M * D; i++) {
            const double e = (noisy[i] - clean[i]) / 1e-2;
            if (i / D % M == 0) {
                assert_true(e == 0.0);
                continue;
            }
            sum += e, square += e * e, largest = fmax(largest, fabs(e));
        }
        const double n = N * (M - 1) * D;
        assert_close(sum / n, 0.0, 0.0, 4.0 / sqrt(n));
        assert_close(square / n, kind == LG_NOISE_NORMAL ? 1.0 : 1.0 / 3.0, 0.1, 0.0);
        assert_true(kind == LG_NOISE_NORMAL ? largest > 2.5 : largest <= 1.0 + 1e-9);
    }
}

/* For the chain all u are near (2, 2, 2), so p = q x u is known to 1e-3. */
TEST("for starts in a box, u of a chain and states on R^d lie in the box and fill it") {
    lg_system *chain = make("pendulum-chain", 3), *quartic = make("quartic", 1);
    lg_trajectory_options o;
    lg_trajectory_options_init(&o);
    o.starts = LG_STARTS_BOX;
    lg_rng rng = test_rng(1, 0);
    double y[18], low = 3.0, high = -3.0;
    for (int i = 0; i < 200; i++) {
        o.low = 2.0, o.high = 2.0005;
        assert_ok(lg_system_draw_start(chain, &o, &rng, y));
        for (const double *q = y; q < y + 18; q += 6)
            for (int c = 0; c < 3; c++)
                assert_close(q[3 + c], 2.0 * (q[(c + 1) % 3] - q[(c + 2) % 3]), 0.0, 2e-3);
        o.low = -3.0, o.high = 2.0;
        assert_ok(lg_system_draw_start(quartic, &o, &rng, y));
        for (int c = 0; c < 4; c++) low = fmin(low, y[c]), high = fmax(high, y[c]);
    }
    assert_true(low >= -3.0 && low < -2.9 && high <= 2.0 && high > 1.9);
    o.low = o.high;
    assert_status(lg_system_draw_start(quartic, &o, &rng, y), LG_INVALID_ARGUMENT);
}

/* Links of length 2. The first node moves across its link with velocity 3 (.5 2 w + .4 N), w = N(0, 1), and
 * the second node relative to the first with 3 (.5 2 w + .4 N - .4 N'). So the angular rates have variances 9
 * (.25 + .04) and 9 (.25 + .08). The angle of the first link is N(0, 1) plus the contribution of .2 N, about
 * N(0, .01), so its mean cosine is exp(-.505). The bounds allow for the projection to the constraints. */
TEST("starts in a plane lie in it, on the manifold, and have their distribution in both forms") {
    enum { K = 2, N = 2000 };
    const double ones[K] = {1, 1}, lengths[K] = {2, 2};
    lg_system *system = make_chain("lagrangian", K, 1.0, ones, lengths);
    lg_system *dual = make_chain("hamiltonian", K, 1.0, ones, lengths);
    lg_trajectory_options o;
    lg_trajectory_options_init(&o);
    o.starts = LG_STARTS_PLANE;
    double y[6 * K], z[6 * K], p[6 * K], square[K] = {0}, cosine = 0, work[64];
    for (int i = 0; i < N; i++) {
        lg_rng rng, same;
        lg_rng_seed(&rng, 3, (uint64_t)i);
        same = rng;
        assert_ok(lg_system_draw_start(system, &o, &rng, y));
        assert_ok(lg_system_draw_start(dual, &o, &same, z));
        assert_ok(lg_chain_momenta(system, y, p, work));
        assert_all_close(z, p, 6 * K, 1e-14, 1e-14);
        cosine -= y[2] / N;
        for (int l = 0; l < K; l++) {
            const double *q = y + 6 * l, *omega = q + 3;
            assert_true(q[1] == 0 && omega[0] == 0 && omega[2] == 0);
            assert_close(lg_dot3(q, q), 1.0, 1e-15, 0);
            square[l] += omega[1] * omega[1] / N;
        }
    }
    assert_close(cosine, exp(-0.505), 0.12, 0);
    assert_close(square[0], 9 * 0.29, 0.12, 0);
    assert_close(square[1], 9 * 0.33, 0.12, 0);
    lg_rng rng = test_rng(1, 0);
    assert_status(lg_system_draw_start(make("quartic", 1), &o, &rng, y), LG_UNSUPPORTED);
    assert_status(lg_system_draw_start(make("pendulum-chain", LG_PLANE_LINKS + 1), &o, &rng, y),
                  LG_UNSUPPORTED);
    /* The tolerance 1e-13 is below the rounding of L^2 = 1e16; the squares of 1e200 overflow. */
    enum { MANY = 8 };
    double far[MANY], unit[MANY], kept[6 * MANY] = {7.0};
    for (int i = 0; i < 2; i++) {
        for (int k = 0; k < MANY; k++) far[k] = i == 0 ? 1e8 : 1e200, unit[k] = 1.0;
        assert_status(lg_system_draw_start(make_chain("lagrangian", MANY, 1.0, unit, far), &o, &rng, kept),
                      LG_NO_CONVERGENCE);
    }
    assert_true(kept[0] == 7.0);
}

TEST("trajectories begin a random time after their start") {
    enum { N = 400, M = 2, D = 4 };
    lg_system *system = make("coupled-oscillators", 1);
    lg_trajectory_options o;
    lg_trajectory_options_init(&o);
    o.trajectories = N, o.points = M;
    static double at[N * M * D], later[N * M * D], H[N], t[M];
    assert_ok(lg_system_generate(NULL, system, &o, t, at, H, NULL));
    o.ahead = 2.0;
    assert_ok(lg_system_generate(NULL, system, &o, t, later, H, NULL));
    double mean = 0, most = 0;
    for (int i = 0; i < N; i++) { /* the first oscillator turns by an angle equal to the time */
        const double *a = at + i * M * D, *b = later + i * M * D;
        const double time = atan2(a[2] * b[0] - a[0] * b[2], a[0] * b[0] + a[2] * b[2]);
        double y[D], work[1];
        if (time == 0.0) continue;
        assert_true(time > 0.0 && time <= 2.0);
        assert_ok(lg_system_solve(NULL, system, a, 1, &time, 1, 0, 0, y, NULL));
        assert_all_close(b, y, D, 0, 1e-10);
        assert_close(H[i], lg_system_hamiltonian(system, b, work), 0, 0);
        mean += time / N, most = fmax(most, time);
    }
    assert_close(mean, 1.0, 0, 4.0 * 2.0 / sqrt(12.0 * N));
    assert_true(most > 1.95);
}

/* The noise of a trajectory must not come from the random stream of its start, or of another start. */
TEST("noise is independent of the starts") {
    enum { N = 500, M = 2, D = 4 };
    lg_system *system = make("quartic", 1);
    lg_trajectory_options o;
    lg_trajectory_options_init(&o);
    o.trajectories = N, o.points = M, o.t_end = 1e-3, o.starts = LG_STARTS_BOX;
    static double clean[N * M * D], noisy[N * M * D], H[N], t[M];
    assert_ok(lg_system_generate(NULL, system, &o, t, clean, H, NULL));
    o.noise = 1.0, o.noise_kind = LG_NOISE_UNIFORM;
    assert_ok(lg_system_generate(NULL, system, &o, t, noisy, H, NULL));
    for (int shift = 0; shift < 3; shift++) {
        double correlation = 0.0; /* the variances are 1/3 and 1/3 */
        for (int i = 0; i + shift < N; i++)
            for (int c = 0; c < D; c++) {
                const double e = noisy[(i * M + 1) * D + c] - clean[(i * M + 1) * D + c];
                correlation += 3.0 * e * clean[(i + shift) * M * D + c] / ((N - shift) * D);
            }
        assert_close(correlation, 0.0, 0.0, 4.0 / sqrt((N - shift) * D));
    }
}

/* Each start gives three consecutive segments; the last start gives the rest. Noise is not passed on to the
 * next segment. */
TEST("segments of one start follow one another") {
    enum { N = 8, M = 6, D = 4 };
    lg_system *system = make("quartic", 1);
    lg_trajectory_options o;
    lg_trajectory_options_init(&o);
    o.trajectories = N, o.points = M, o.t_end = 0.3, o.segments = 3;
    double t[M], y[N * M * D], H[N], noisy[N * M * D], work[1];
    assert_ok(lg_system_generate(NULL, system, &o, t, y, H, NULL));
    for (int i = 0; i < N; i++) {
        const double *start = y + i * M * D;
        if (i % 3 > 0)
            assert_memory_equal(start, start - D, D * sizeof(double));
        else if (i > 0)
            assert_true(start[0] != start[-D]);
        assert_close(H[i], lg_system_hamiltonian(system, start, work), 0.0, 0.0);
        if (i % 3 > 0) assert_close(H[i], H[i - 1], 1e-11, 0.0);
    }
    o.noise = 0.1;
    assert_ok(lg_system_generate(NULL, system, &o, t, noisy, H, NULL));
    for (int i = 0; i < N; i++) assert_memory_equal(noisy + i * M * D, y + i * M * D, D * sizeof(double));
}

/* ---- invalid input ---- */

TEST("invalid sampling options are refused, and nothing is written") {
    lg_system *chain = make("pendulum-chain", 1);
    double t[8] = {7.0}, y[64] = {7.0}, H[8] = {7.0};
    lg_error error;
#define REFUSED(change, expected)                                                                            \
    do {                                                                                                     \
        lg_trajectory_options o;                                                                             \
        lg_trajectory_options_init(&o);                                                                      \
        o.trajectories = 2, o.points = 2;                                                                    \
        change;                                                                                              \
        assert_status(lg_system_generate(NULL, chain, &o, t, y, H, &error), expected);                       \
        assert_true(error.status == (expected) && strlen(error.message) > 0);                                \
    } while (0)
    REFUSED(o.size = 1, LG_INVALID_ARGUMENT);
    REFUSED(o.trajectories = 0, LG_INVALID_ARGUMENT);
    REFUSED(o.points = 1, LG_INVALID_ARGUMENT);
    REFUSED(o.t_end = 0.0, LG_INVALID_ARGUMENT);
    REFUSED(o.t_end = NAN, LG_INVALID_ARGUMENT);
    REFUSED(o.noise = -1.0, LG_INVALID_ARGUMENT);
    REFUSED(o.noise = INFINITY, LG_INVALID_ARGUMENT);
    REFUSED(o.noise_kind = (lg_noise)(LG_NOISE_UNIFORM + 1), LG_INVALID_ARGUMENT);
    REFUSED(o.segments = 0, LG_INVALID_ARGUMENT);
    REFUSED((o.segments = 2, o.first = 3), LG_INVALID_ARGUMENT);
    REFUSED(o.t_end = INFINITY, LG_INVALID_ARGUMENT);
    REFUSED(o.ahead = INFINITY, LG_INVALID_ARGUMENT);
    REFUSED(o.rtol = -1.0, LG_INVALID_ARGUMENT);
    REFUSED(o.rtol = INFINITY, LG_INVALID_ARGUMENT);
    REFUSED(o.atol = NAN, LG_INVALID_ARGUMENT);
    REFUSED(o.rtol = o.atol = 0.0, LG_INVALID_ARGUMENT);
    REFUSED(o.starts = (lg_starts)LG_STARTS_COUNT, LG_INVALID_ARGUMENT);
    REFUSED(o.ahead = -1.0, LG_INVALID_ARGUMENT);
    REFUSED(o.ahead = NAN, LG_INVALID_ARGUMENT);
    REFUSED((o.starts = LG_STARTS_BOX, o.low = o.high), LG_INVALID_ARGUMENT);
    REFUSED(o.trajectories = SIZE_MAX / 8, LG_OUT_OF_MEMORY);
    const double starts[6] = {0.0, 0.0, NAN, 0.0, 0.0, 0.0}, times[2] = {2.0, 1.0};
    assert_status(lg_system_solve(NULL, chain, starts, 1, times, 0, 0, 0, y, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_system_solve(NULL, chain, starts, 1, times, 1, NAN, 0, y, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_system_solve(NULL, chain, starts, 1, times, 1, 0, INFINITY, y, NULL),
                  LG_INVALID_ARGUMENT);
    assert_status(lg_system_solve(NULL, chain, starts, SIZE_MAX / 16, times, 1, 0, 0, y, &error),
                  LG_OUT_OF_MEMORY);
    assert_says(error.message, "too many points");
    assert_status(lg_system_generate(NULL, chain, NULL, NULL, y, H, &error), LG_INVALID_ARGUMENT);
    lg_rng rng = test_rng(1, 0);
    lg_trajectory_options plane;
    lg_trajectory_options_init(&plane);
    plane.starts = LG_STARTS_PLANE;
    assert_status(lg_system_draw_start(chain, &plane, NULL, y), LG_INVALID_ARGUMENT);
    assert_status(lg_system_draw_start(chain, &plane, &rng, NULL), LG_INVALID_ARGUMENT);
    plane.size = 1;
    assert_status(lg_system_draw_start(chain, &plane, &rng, y), LG_INVALID_ARGUMENT);
    assert_status(lg_system_solve(NULL, chain, starts, 1, times, 1, 0, 0, y, &error), LG_INVALID_ARGUMENT);
    assert_status(lg_system_solve(NULL, chain, starts, 0, times, 1, 0, 0, y, NULL), LG_INVALID_ARGUMENT);
    assert_true(t[0] == 7.0 && y[0] == 7.0 && H[0] == 7.0);
}

typedef struct sampling {
    double t[5], y[2 * 5 * 6], H[2];
} sampling;

static lg_status sample_chain(const lg_context *context, void *user) {
    sampling *s = user;
    const double gravity = 1.0;
    const lg_named_values given = {"gravity", &gravity, 1};
    lg_system *system = NULL;
    lg_trajectory_options o;
    lg_system_options chain;
    lg_trajectory_options_init(&o);
    lg_system_options_init(&chain);
    o.trajectories = 2;
    chain.form = "hamiltonian", chain.parameters = &given, chain.parameter_count = 1;
    s->t[0] = s->y[0] = 7.0;
    lg_status status = lg_system_create(context, "pendulum-chain", &chain, &system, NULL);
    if (status == LG_OK) status = lg_system_generate(context, system, &o, s->t, s->y, s->H, NULL);
    lg_system_destroy(system);
    if (status != LG_OK) assert_true(s->t[0] == 7.0 && s->y[0] == 7.0);
    return status;
}

TEST("every allocation may fail, and a run can be cancelled") {
    sampling s;
    const volatile int cancel = 1;
    lg_context_options options;
    lg_context *cancelled = NULL;
    EVERY_ALLOCATION_FAILS(context, 4, status = sample_chain(context, &s););
    lg_context_options_init(&options);
    options.cancel = &cancel;
    assert_ok(lg_context_create(&options, &cancelled));
    assert_status(sample_chain(cancelled, &s), LG_CANCELLED);
    const double hanging[6] = {0, 0, -1}, time = 1.0;
    assert_status(
        lg_system_solve(cancelled, make("pendulum-chain", 1), hanging, 1, &time, 1, 0, 0, s.y, NULL),
        LG_CANCELLED);
    lg_context_destroy(cancelled);
    lg_system *chain = make("pendulum-chain", 1);
    EVERY_ALLOCATION_FAILS(
        context, 3, { status = lg_system_solve(context, chain, hanging, 1, &time, 1, 0, 0, s.y, NULL); });
}
