/* The Hamiltonian chain compared with dense linear algebra, difference quotients and the general equations of
 * a constrained Hamiltonian system. */
#include "support/dense_solve.h"
#include "mechanics/system_check.h"

#include "mechanics/chain.h"

#define MAX_LINKS 5
#define MAX_N     (3 * MAX_LINKS)

static const double masses[MAX_LINKS] = {1.0, 1.3, 0.7, 2.0, 0.4},
                    lengths[MAX_LINKS] = {1.0, 0.8, 1.5, 0.6, 1.1};
#define GRAVITY 9.81

/* M(q), 3k x 3k: blocks m_ij P_i P_j off the diagonal, m_ii I on it. q is (k, 3), contiguous. */
static void dense_mass(size_t k, const double *m, const double *q, double *M) {
    const size_t n = 3 * k;
    for (size_t i = 0; i < k; i++)
        for (size_t j = 0; j < k; j++)
            for (size_t a = 0; a < 3; a++)
                for (size_t b = 0; b < 3; b++) {
                    const double *qi = q + 3 * i, *qj = q + 3 * j;
                    double pp = 0.0;
                    for (size_t c = 0; c < 3; c++)
                        pp += ((a == c) - qi[a] * qi[c]) * ((c == b) - qj[c] * qj[b]);
                    M[(3 * i + a) * n + 3 * j + b] = m[i * k + j] * (i == j ? (double)(a == b) : pp);
                }
}

static double dense_hamiltonian(const lg_system *system, const double *q, const double *p, double *v) {
    const size_t k = lg_system_links(system), n = 3 * k;
    double m[MAX_LINKS * MAX_LINKS], weights[MAX_LINKS], M[MAX_N * MAX_N], b[MAX_N], x[MAX_N], H = 0.0;
    assert_ok(lg_chain_mass_matrix(system, m));
    assert_ok(lg_chain_potential_weights(system, weights));
    dense_mass(k, m, q, M);
    memcpy(b, p, n * sizeof(*b));
    dense_solve(n, M, b, x);
    for (size_t i = 0; i < n; i++) H += 0.5 * p[i] * x[i];
    for (size_t i = 0; i < k; i++) H += weights[i] * q[3 * i + 2];
    if (v) memcpy(v, x, n * sizeof(*x));
    return H;
}

/* Converts between pairs y = q1 p1 q2 p2 ... and the arrays q and p (k, 3). */
static void unpack(size_t k, const double *y, double *q, double *p) {
    for (size_t i = 0; i < k; i++) {
        memcpy(q + 3 * i, y + 6 * i, 3 * sizeof(*q));
        memcpy(p + 3 * i, y + 6 * i + 3, 3 * sizeof(*p));
    }
}

/* Weights of the fourth-order difference quotient at -2, -1, 1, 2. */
static const double stencil[4][2] = {{-2, 1.0 / 12}, {-1, -2.0 / 3}, {1, 2.0 / 3}, {2, -1.0 / 12}};
#define DELTA 1e-3

TEST("on the manifold gradient and energy agree with dense linear algebra") {
    lg_rng rng = test_rng(22, 0);
    for (size_t k = 1; k <= MAX_LINKS; k++) {
        lg_system *system = make_chain("hamiltonian", k, GRAVITY, masses, lengths);
        const lg_chain chain = lg_chain_of(system);
        double y[2 * MAX_N], q[MAX_N], p[MAX_N], v[MAX_N], g[MAX_N], dense[MAX_N], work[18 * MAX_LINKS];
        assert_ok(lg_system_draw_start(system, NULL, &rng, y));
        unpack(k, y, q, p);
        assert_close(lg_system_hamiltonian(system, y, work), dense_hamiltonian(system, q, p, dense), 1e-13,
                     1e-13);
        assert_ok(lg_chain_gradient(&chain, y, v, g, work));
        assert_all_close(v, dense, 3 * k, 1e-12, 1e-13);
        for (size_t j = 0; j < 3 * k; j++) { /* dH/dq, whose kinetic part comes from M(q) */
            double quotient = 0.0;
            for (size_t s = 0; s < 4; s++) {
                double shifted[MAX_N];
                memcpy(shifted, q, sizeof(shifted));
                shifted[j] += DELTA * stencil[s][0];
                quotient += stencil[s][1] / DELTA * dense_hamiltonian(system, shifted, p, NULL);
            }
            /* Both are gradients of extensions of the same function, so only the tangential parts agree. */
            dense[j] = quotient;
        }
        for (size_t i = 0; i < k; i++) {
            double a[3], b[3];
            lg_cross3(q + 3 * i, g + 3 * i, a);
            lg_cross3(q + 3 * i, dense + 3 * i, b);
            assert_all_close(a, b, 3, 1e-9, 1e-9);
        }
    }
}

/* The field that ambient schemes integrate. work: lg_system_work_size. */
static lg_status ambient_field(const lg_system *system, const double *y, double *out, double *work) {
    lg_ode ode;
    lg_system_user user;
    assert_ok(lg_system_ode(system, LG_COORDINATES_AMBIENT, &ode, &user, work));
    return ode.field(&user, 0.0, y, NULL, out);
}

TEST("off the manifold the ambient field comes from the gradient of the extended energy") {
    lg_rng rng = test_rng(23, 0);
    for (size_t k = 1; k <= MAX_LINKS; k++) {
        lg_system *system = make_chain("hamiltonian", k, GRAVITY, masses, lengths);
        double y[2 * MAX_N], out[2 * MAX_N], dH[2 * MAX_N], shifted[2 * MAX_N];
        double *work = lg_test_memory(lg_system_work_size(system));
        assert_ok(lg_system_draw_start(system, NULL, &rng, y));
        for (size_t i = 0; i < 6 * k; i++) y[i] += lg_rng_uniform_in(&rng, -0.03, 0.03);
        assert_ok(ambient_field(system, y, out, work));
        for (size_t j = 0; j < 6 * k; j++) {
            dH[j] = 0.0;
            for (size_t s = 0; s < 4; s++) {
                memcpy(shifted, y, sizeof(shifted));
                shifted[j] += DELTA * stencil[s][0];
                dH[j] += stencil[s][1] / DELTA * lg_system_hamiltonian(system, shifted, work);
            }
        }
        for (size_t i = 0; i < k; i++) { /* q' = v - q (q.v), p' = -g + q (q.g) + p (q.v) - q (p.v) */
            const double *q = y + 6 * i, *p = q + 3, *g = dH + 6 * i, *v = g + 3;
            const double qv = lg_dot3(q, v), qg = lg_dot3(q, g), pv = lg_dot3(p, v);
            for (size_t c = 0; c < 3; c++) {
                assert_close(out[6 * i + c], v[c] - q[c] * qv, 1e-8, 1e-8);
                assert_close(out[6 * i + 3 + c], -g[c] + q[c] * qg + p[c] * qv - q[c] * pv, 1e-8, 1e-8);
            }
        }
    }
}

TEST("for two links with all parameters 1 the mass matrix and the potential agree with those by hand") {
    lg_system *system = make_chain("hamiltonian", 2, 1.0, NULL, NULL);
    double m[4], weights[2];
    const double expected[4] = {2.0, 1.0, 1.0, 1.0};
    assert_ok(lg_chain_mass_matrix(system, m));
    assert_memory_equal(m, expected, sizeof(m));
    assert_ok(lg_chain_potential_weights(system, weights));
    assert_true(weights[0] == 2.0 && weights[1] == 1.0);
}

TEST("the outputs of a chain are the positions and velocities of its masses; other systems output the "
     "state") {
    const double L[2] = {2.0, 0.5}, m[2] = {1.0, 3.0};
    lg_system *chain = make_chain("lagrangian", 2, 1.0, m, L),
              *dual = make_chain("hamiltonian", 2, 1.0, m, L);
    /* q_1 = e1 turning about e3, q_2 = e2 turning about e1. */
    const double y[12] = {1, 0, 0, 0, 0, 3, 0, 1, 0, -4, 0, 0};
    const double expected[12] = {2, 0, 0, 2, 0.5, 0, 0, 6, 0, 0, 6, -2};
    double p[12], seen[12], work[64];
    assert_int_equal(lg_system_observed(chain), 12);
    assert_ok(lg_system_observe(chain, y, seen, work));
    assert_all_close(seen, expected, 12, 1e-15, 1e-15);
    assert_ok(lg_chain_momenta(chain, y, p, work));
    assert_ok(lg_system_observe(dual, p, seen, work));
    assert_all_close(seen, expected, 12, 1e-14, 1e-14);
    const double x[4] = {1, 2, 3, 4};
    lg_system *quartic = make_system("quartic", NULL, NULL, 0);
    assert_int_equal(lg_system_observed(quartic), 4);
    assert_ok(lg_system_observe(quartic, x, seen, work));
    assert_memory_equal(seen, x, sizeof(x));
}

TEST("chains of up to 200 links keep invariants and manifold, in both forms") {
    static const size_t links[] = {1, 2, 5, 20, 200};
    for (size_t n = 0; n < 2 * LG_COUNT(links); n++) {
        const bool lagrangian = n % 2 == 1;
        const size_t k = links[n / 2], d = 6 * k;
        if (lagrangian && k > 20) continue;
        lg_system *system = make_chain(lagrangian ? "lagrangian" : "hamiltonian", k, 1.0, NULL, NULL);
        double *y = TEST_ARRAY(double, d), *end = TEST_ARRAY(double, d);
        double *work = lg_test_memory(lg_system_work_size(system)), size = 1.0;
        const double time = k > 10 ? 0.5 : 3.0;
        lg_rng rng = test_rng(24, k);
        random_links(&rng, k, y);
        assert_ok(lg_system_solve(NULL, system, y, 1, &time, 1, 0.0, 0.0, end, NULL));
        for (size_t i = 0; i < lg_system_invariants(system); i++) {
            const double before = lg_system_invariant(system, i, y, work),
                         after = lg_system_invariant(system, i, end, work);
            print_message("  k = %zu: %s %.6g, drift %.2g\n", k, lg_system_invariant_name(system, i), before,
                          after - before);
            assert_close(after, before, 1e-10, 1e-10);
        }
        for (size_t i = 0; i < d; i++) size = fmax(size, fabs(end[i])); /* q.p = 0 is kept relative to |p| */
        assert_true(lg_space_manifold_error(lg_system_space(system), end) < 2e-14 * size);
    }
}

/* A pendulum that is 1e-8 off the upright position falls: theta grows like exp(t sqrt(g/L)). Only a tolerance
 * that is nearly relative resolves this. */
TEST("an upright pendulum falls as cosh, an equilibrium stays") {
    lg_system *system = make_chain("hamiltonian", 1, 1.0, NULL, NULL);
    const double y[6] = {1e-8, 0.0, 1.0, 0.0, 0.0, 0.0}, times[2] = {5.0, 10.0},
                 rest[6] = {0.0, 0.0, 1.0, 0.0, 0.0, 0.0};
    double out[12];
    assert_ok(lg_system_solve(NULL, system, y, 1, times, 2, 1e-10, 1e-30, out, NULL));
    assert_close(out[0], 1e-8 * cosh(5.0), 1e-9, 0.0);
    assert_close(out[3], 1e-8 * sinh(5.0), 1e-9, 0.0);
    assert_close(out[6], 1e-8 * cosh(10.0), 1e-7, 0.0); /* sin(theta) differs from theta by 1e-8 */
    assert_ok(lg_system_solve(NULL, system, rest, 1, times, 2, 0.0, 0.0, out, NULL));
    assert_memory_equal(out + 6, rest, sizeof(rest)); /* an equilibrium stays */
}

TEST("a state far off the manifold returns an error") {
    lg_system *system = make_chain("hamiltonian", 2, GRAVITY, masses, lengths);
    const lg_chain chain = lg_chain_of(system);
    double y[12] = {0}, v[6], g[6], out[12], work[64];
    assert_status(lg_chain_gradient(&chain, y, v, g, work), LG_NOT_FINITE); /* links of length 0 */
    y[2] = 20.0, y[8] = 20.0;
    assert_status(ambient_field(system, y, out, work), LG_NOT_FINITE);
    assert_true(isnan(lg_system_hamiltonian(system, y, work)));
    y[2] = NAN;
    assert_status(lg_chain_gradient(&chain, y, v, g, work), LG_NOT_FINITE);
}
