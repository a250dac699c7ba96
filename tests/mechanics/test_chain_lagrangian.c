/* The Lagrangian chain compared with the Hamiltonian form and its invariants; its field on a tape; the
 * variational integrator of both forms. test_system_properties.c derives the field from the energy;
 * test_chain.c compares the energy with dense linear algebra. */
#include "mechanics/system_check.h"

#include "liegrad/ops.h"

#define GRAVITY   9.81
#define MAX_LINKS 20

static const double masses[MAX_LINKS] = {1.0, 1.3, 0.7, 2.0, 0.4, 1.1, 0.9, 1.6, 0.5, 1.2,
                                         0.8, 1.5, 1.0, 0.6, 1.4, 0.7, 1.9, 1.1, 0.3, 1.2},
                    lengths[MAX_LINKS] = {1.0, 0.8, 1.5, 0.6, 1.1, 0.7, 1.2, 0.9, 1.0, 0.5,
                                          1.3, 0.8, 0.6, 1.1, 0.9, 1.4, 0.7, 1.0, 1.2, 0.8};

TEST("momenta and velocities are converted back and forth exactly, and both forms have the same "
     "invariants") {
    lg_rng rng = test_rng(32, 0);
    for (size_t k = 1; k <= 3; k++) {
        lg_system *first = make_chain("lagrangian", k, GRAVITY, masses, lengths),
                  *second = make_chain("hamiltonian", k, GRAVITY, masses, lengths);
        double y[18], z[18], back[18], work[18 * 3];
        for (int repeat = 0; repeat < 5; repeat++) {
            random_links(&rng, k, y);
            assert_ok(lg_chain_momenta(first, y, z, work));
            assert_ok(lg_chain_velocities(second, z, back, work));
            assert_all_close(back, y, 6 * k, 1e-12, 1e-12);
            for (size_t i = 0; i < 2; i++) {
                assert_string_equal(lg_system_invariant_name(first, i), lg_system_invariant_name(second, i));
                assert_close(lg_system_invariant(first, i, y, work), lg_system_invariant(second, i, z, work),
                             1e-12, 1e-12);
            }
        }
    }
}

/* ---- the field on a tape, an operation with an adjoint by hand ---- */

TEST("NaN in one row of a tape is no error and stays in that row") {
    lg_system *system = make_chain("lagrangian", 2, GRAVITY, masses, lengths);
    lg_system_taped_user user;
    lg_taped_ode ode;
    double y[3 * 12], f[3 * 12];
    lg_rng rng = test_rng(41, 0);
    random_links(&rng, 6, y);
    y[12] = NAN;
    lg_tape *t = test_tape(LG_F64);
    lg_var parts[2], p = lg_input_f64(t, lg_shape1(5), lg_system_parameter_values(system));
    assert_ok(lg_system_taped_ode(system, LG_COORDINATES_LIE, p, &ode, &user));
    assert_ok(lg_taped_split(t, &ode.space, lg_input_f64(t, lg_shape2(3, 12), y), parts));
    assert_ok(ode.field(ode.user, t, (lg_taped_time){0}, parts, LG_NONE, parts));
    assert_ok(lg_read(t, lg_taped_join(t, &ode.space, parts), 36, f));
    assert_true(isnan(f[12 + 3]));
    for (int i = 0; i < 12; i++) assert_true(isfinite(f[i]) && isfinite(f[24 + i]));
}

/* q and omega are both computed from x. */
TEST("q and omega may depend on each other: derivatives are total, recorded and swept") {
    lg_system *system = make_chain("lagrangian", 2, GRAVITY, masses, lengths);
    lg_tape *t = test_tape(LG_F64);
    const double x0[6] = {0.6, 0.0, 0.8, 0.0, 1.0, 0.0};
    double swept[6];
    lg_system_taped_user user;
    lg_taped_ode ode;
    lg_var x = lg_input_f64(t, lg_shape3(1, 2, 3), x0), y[2] = {x, lg_square(t, lg_square(t, x))}, f[2], g;
    lg_var parameters = lg_input_f64(t, lg_shape1(5), lg_system_parameter_values(system));
    assert_ok(lg_system_taped_ode(system, LG_COORDINATES_LIE, parameters, &ode, &user));
    assert_ok(ode.field(ode.user, t, (lg_taped_time){0}, y, LG_NONE, f));
    lg_var S = lg_sum(t, lg_square(t, f[1]));
    assert_ok(lg_grad(t, S, &x, 1, &g));
    assert_ok(lg_backward_set(t, S, &x, 1, (void *[]){swept}));
    assert_reads(t, g, 6, swept, 1e-11, 1e-11);
}

/* ---- the variational integrator ---- */

static void steps(const lg_system *system, double h, size_t n, double *y, double *work) {
    lg_system_user user;
    lg_ode ode;
    assert_ok(lg_system_ode(system, LG_COORDINATES_AMBIENT, &ode, &user, work));
    assert_non_null(ode.step);
    for (size_t i = 0; i < n; i++) assert_ok(ode.step(&user, (double)i * h, h, y));
}

TEST("the variational integrator has order 2") {
    lg_system *system = make_chain("lagrangian", 2, GRAVITY, masses, lengths);
    double start[12], exact[12], y[12], work[36];
    fit_line fit = {0};
    const double time = 0.5;
    lg_rng rng = test_rng(35, 0);
    random_links(&rng, 2, start);
    assert_ok(lg_system_solve(NULL, system, start, 1, &time, 1, 0.0, 0.0, exact, NULL));
    for (int i = 0; i < 6; i++) {
        const size_t count = (size_t)32 << i;
        const double h = time / (double)count;
        double error = 0.0;
        memcpy(y, start, sizeof(y));
        steps(system, h, count, y, work);
        for (int j = 0; j < 12; j++) error = fmax(error, fabs(y[j] - exact[j]));
        assert_true(error < 1e-1 && error > 1e-11);
        fit_add(&fit, log(h), log(error));
    }
    const double slope = fit_slope(&fit);
    print_message("  variational: order %.3f\n", slope);
    assert_true(slope > 1.85 && slope < 2.85);
}

/* 2000 steps forward and then back. Manifold and vertical angular momentum must be kept to rounding, the
 * energy within a band. */
TEST("the variational integrator is reversible and keeps manifold and momentum") {
    enum { N = 2000 };
    for (size_t k = 1; k <= 5; k += 2) {
        lg_system *system = make_chain("lagrangian", k, GRAVITY, masses, lengths);
        double start[30], y[30], work[18 * 5], manifold = 0.0, momentum = 0.0, energy = 0.0;
        lg_rng rng = test_rng(36, k);
        random_links(&rng, k, start);
        memcpy(y, start, sizeof(y));
        const double h0 = lg_system_invariant(system, 0, y, work),
                     j0 = lg_system_invariant(system, 1, y, work);
        for (int i = 0; i < N; i++) {
            steps(system, 2e-3, 1, y, work);
            manifold = fmax(manifold, lg_space_manifold_error(lg_system_space(system), y));
            energy = fmax(energy, fabs(lg_system_invariant(system, 0, y, work) - h0));
            momentum = fmax(momentum, fabs(lg_system_invariant(system, 1, y, work) - j0));
        }
        print_message("  k = %zu: manifold error %.2g, angular momentum %.2g, energy %.2g of %.3g\n", k,
                      manifold, momentum, energy, h0);
        assert_true(manifold < 5e-14 && momentum < 1e-10 && energy < 0.1 * (1.0 + fabs(h0)) && energy > 1e-9);
        memcpy(y, start, sizeof(y));
        steps(system, 5e-3, 20, y, work);
        steps(system, -5e-3, 20, y, work);
        assert_all_close(y, start, 6 * k, 1e-11, 1e-11);
    }
}

TEST("the variational integrators of both forms agree") {
    enum { K = 3 };
    lg_system *first = make_chain("lagrangian", K, GRAVITY, masses, lengths),
              *second = make_chain("hamiltonian", K, GRAVITY, masses, lengths);
    double y[6 * K], z[6 * K], work[18 * K];
    lg_rng rng = test_rng(37, 0);
    random_links(&rng, K, y);
    assert_ok(lg_chain_momenta(first, y, z, work));
    steps(first, 0.01, 10, y, work);
    steps(second, 0.01, 10, z, work);
    assert_ok(lg_chain_momenta(first, y, y, work));
    assert_all_close(z, y, 6 * K, 1e-11, 1e-11);
}

TEST("a variational step that fails leaves the state unchanged") {
    lg_system *system = make_chain("lagrangian", 2, GRAVITY, masses, lengths);
    double y[12] = {1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0}, before[12], work[36];
    lg_system_user user;
    lg_ode ode;
    assert_ok(lg_system_ode(system, LG_COORDINATES_LIE, &ode, &user, work));
    memcpy(before, y, sizeof(y));
    assert_ok(ode.step(&user, 0.0, 0.0, y));
    assert_memory_equal(y, before, sizeof(y));
    /* a fall by 490 m, which no multiplier can bring back to the manifold */
    assert_true(ode.step(&user, 0.0, 10.0, y) != LG_OK);
    assert_memory_equal(y, before, sizeof(y));
    assert_status(ode.step(&user, 0.0, NAN, y), LG_NOT_FINITE);
    assert_memory_equal(y, before, sizeof(y));
}

/* Only the state or only the parameters vary: the derivative is the part of the whole one. */
TEST("the chain's operation has derivatives with respect to some of its inputs") {
    enum { K = 2, N = 12, P = 5 };
    lg_system *system = make_chain("lagrangian", K, GRAVITY, masses, lengths);
    lg_tape *t = test_tape(LG_F64);
    double y0[N], whole[3][N], part[N];
    lg_rng rng = test_rng(43, 0);
    random_links(&rng, K, y0);
    lg_system_taped_user user;
    lg_taped_ode ode;
    lg_var parts[3], f[2], g[3];
    parts[2] = lg_input_f64(t, lg_shape1(P), lg_system_parameter_values(system));
    assert_ok(lg_system_taped_ode(system, LG_COORDINATES_LIE, parts[2], &ode, &user));
    assert_ok(lg_taped_split(t, &ode.space, lg_input_f64(t, lg_shape2(1, N), y0), parts));
    assert_ok(ode.field(ode.user, t, (lg_taped_time){0}, parts, LG_NONE, f));
    const lg_var S = lg_sum(t, lg_square(t, f[1]));
    static const size_t sizes[3] = {N / 2, N / 2, P};
    assert_ok(lg_backward_set(t, S, parts, 3, (void *[]){whole[0], whole[1], whole[2]}));
    assert_ok(lg_grad(t, S, parts, 3, g));
    for (size_t i = 0; i < 3; i++) {
        assert_ok(lg_backward_set(t, S, &parts[i], 1, (void *[]){part}));
        assert_all_close(part, whole[i], sizes[i], 1e-14, 1e-14);
        const lg_var ones = lg_full(t, lg_var_shape(t, parts[i]), 1.0);
        lg_var slope;
        double sum = 0;
        for (size_t j = 0; j < sizes[i]; j++) sum += whole[i][j];
        assert_ok(lg_jvp(t, &S, 1, &parts[i], &ones, 1, &slope));
        assert_reads(t, slope, 1, &sum, 1e-12, 1e-12);
    }
}
