/* The heavy top in four forms, compared with the equations in the axes of the body. */
#include "mechanics/body_check.h"

static const char *const forms[] = {"cotangent", "direct", "lie-poisson", "quadratic"};
enum { COTANGENT, DIRECT, POISSON, QUADRATIC, FORMS };

static const top symmetric = {{0.234375, 0.46875, 0.234375}, 15.0, 2.0, {0.0, 1.0, 0.0}, {0.0, 0.0, -9.81}};
static const top skew = {{1.1, 2.3, 2.9}, 1.7, 0.6, {0.48, 0.6, 0.64}, {1.5, -2.0, -9.0}};

static lg_system *make_top(const top *of, int form) {
    const lg_named_values parameters[] = {{"inertia", of->inertia, 3},
                                          {"mass", &of->mass, 1},
                                          {"length", &of->length, 1},
                                          {"chi", of->chi, 3},
                                          {"gamma0", of->gamma0, 3}};
    return make_system("heavy-top", forms[form], parameters, 5);
}

/* The state of a form for Q, pi. */
static void state_of(const lg_system *system, const top *of, const double *Q, const double *pi, double *y) {
    if (strcmp(lg_system_form(system), "lie-poisson") == 0) {
        for (int c = 0; c < 3; c++) {
            y[c] = Q[c] * of->gamma0[0] + Q[3 + c] * of->gamma0[1] + Q[6 + c] * of->gamma0[2];
            y[3 + c] = Q[c] * pi[0] + Q[3 + c] * pi[1] + Q[6 + c] * pi[2];
        }
        return;
    }
    memcpy(y, Q, 9 * sizeof(*y));
    memcpy(y + 9, pi, 3 * sizeof(*y));
    for (size_t i = 12; i < lg_system_dim(system); i++) y[i] = 0.0;
}

static void random_start(lg_rng *rng, double size, double *Q, double *pi) {
    random_rotation(rng, Q);
    for (int i = 0; i < 3; i++) pi[i] = lg_rng_uniform_in(rng, -size, size);
}

/* ---- flows compared with the equations in the axes of the body ---- */

static double largest_difference(const double *a, const double *b, size_t n) {
    double worst = 0.0;
    for (size_t i = 0; i < n; i++) worst = fmax(worst, fabs(a[i] - b[i]) / (1.0 + fabs(b[i])));
    return worst;
}

static void check_flow(const char *name, const top *of, const double *Q, const double *pi, int steps) {
    enum { POINTS = 4 };
    static const double times[POINTS] = {0.25, 0.5, 0.75, 1.0};
    double body[POINTS][12], y0[18], y[POINTS * 18], expected[18], spatial[3], work[SYSTEM_MAX_DIM];
    memcpy(body[0], Q, 9 * sizeof(*Q));
    for (int c = 0; c < 3; c++) body[0][9 + c] = Q[c] * pi[0] + Q[3 + c] * pi[1] + Q[6 + c] * pi[2];
    for (int n = 0; n < POINTS; n++) {
        if (n > 0) memcpy(body[n], body[n - 1], sizeof(body[n]));
        rk4_in_the_body(of, 0.25 / steps, steps, body[n]);
    }
    printf("%s:", name);
    for (int form = 0; form < FORMS; form++) {
        lg_system *system = make_top(of, form);
        const size_t dim = lg_system_dim(system), reported = lg_system_reported(system);
        double worst = 0.0, drift = 0.0;
        state_of(system, of, Q, pi, y0);
        integrate(system, 1e-12, y0, times, POINTS, y);
        for (int n = 0; n < POINTS; n++) {
            for (int r = 0; r < 3; r++) spatial[r] = lg_dot3(body[n] + 3 * r, body[n] + 9);
            state_of(system, of, body[n], spatial, expected);
            worst = fmax(worst, largest_difference(y + (size_t)n * dim, expected, reported));
            for (size_t k = 0; k < lg_system_invariants(system); k++) {
                const double start = lg_system_invariant(system, k, y0, work);
                const double now = lg_system_invariant(system, k, y + (size_t)n * dim, work);
                drift = fmax(drift, fabs(now - start) / (1.0 + fabs(start)));
            }
        }
        printf(" %s %.1e (invariants %.1e)", forms[form], worst, drift);
        assert_true(worst < 1e-8);
        assert_true(drift < 1e-8);
    }
    printf("\n");
}

TEST("the flow of every form agrees with the equations in the axes of the body") {
    static const double identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    const double fast[3] = {0.0, 0.46875 * 150.0, 0.234375 * -4.61538}, slow[3] = {0.3, -0.2, 0.5};
    double Q[9], pi[3];
    lg_rng rng = test_rng(14, 0);
    check_flow("fast", &symmetric, identity, fast, 8000);
    check_flow("slow", &symmetric, identity, slow, 4000);
    for (int i = 0; i < 3; i++) {
        random_start(&rng, 2.0 + 10.0 * i, Q, pi);
        check_flow("skew", &skew, Q, pi, 4000);
    }
}

/* With the symplectic integrator at theta = 1/2, (Q, pi) of the forms quadratic and cotangent agree to
 * rounding. */
TEST("slgi gives the same motion for the quadratic and the cotangent form") {
    static const int canonical[] = {COTANGENT, QUADRATIC};
    double end[2][18], start[18], Q[9], pi[3], work[SYSTEM_MAX_DIM];
    lg_rng rng = test_rng(18, 0);
    random_start(&rng, 2.0, Q, pi);
    for (int f = 0; f < 2; f++) {
        lg_system *system = make_top(&skew, canonical[f]);
        lg_system_user user;
        lg_ode ode;
        state_of(system, &skew, Q, pi, start);
        memcpy(end[f], start, sizeof(start));
        assert_ok(lg_system_ode(system, LG_COORDINATES_LIE, &ode, &user, work));
        lg_stepper *stepper = test_stepper(lg_scheme_find("slgi"), &ode);
        for (int n = 0; n < 50; n++)
            assert_ok(lg_stepper_step(stepper, 0.01 * n, 0.01, end[f], NULL, end[f]));
    }
    assert_all_close(end[1], end[0], 12, 0.0, 1e-12);
    assert_true(largest_difference(end[0], start, 12) > 0.1);
}
