/* Drift off the manifold over 1e5 steps: rounding for every Lie group scheme, not for the classical ones.
 * ctest-labels: slow */
#include "fields.h"

enum { STEPS = 100000 };

static double swing = 0.0;

static bool is_lie(const lg_scheme *scheme) {
    return !scheme->ambient && (scheme->kind == LG_SCHEME_RKMK || scheme->kind == LG_SCHEME_COMMUTATOR_FREE);
}

/* The largest error of any state, and the run keeps moving. */
static double drift(const lg_scheme *scheme, const lg_ode *ode, const lg_space *manifold, double h,
                    const double *y0) {
    double y[CHAIN_DIM], before[CHAIN_DIM] = {0}, worst = 0.0;
    lg_stepper *stepper = NULL;
    assert_ok(lg_stepper_create(NULL, scheme, ode, &stepper));
    memcpy(y, y0, ode->space.dim * sizeof(*y));
    for (int n = 0; n < STEPS; n++) {
        memcpy(before, y, sizeof(before));
        assert_ok(lg_step(stepper, n * h, h, y, NULL, y));
        const double error = lg_space_manifold_error(manifold, y);
        worst = isnan(error) ? INFINITY : fmax(worst, error);
    }
    assert_memory_not_equal(before, y, ode->space.dim * sizeof(*y));
    lg_stepper_destroy(NULL, stepper);
    return worst;
}

static double step_of(const lg_scheme *scheme) {
    return scheme->order == 1 ? 1e-4 : scheme->order == 2 ? 1e-3 : 0.01; /* short where energy grows */
}

TEST("chain") {
    double y0[CHAIN_DIM];
    lg_space space;
    assert_ok(lg_space_init(&space, &(lg_space_factor){LG_SPACE_TS2, 2}, 1));
    chain_start(y0);
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        const lg_ode ode = chain_ode(scheme, &swing);
        const bool lie = is_lie(scheme), projected = strcmp(scheme->name, "rk4-projected") == 0;
        if (!lie && !projected && strcmp(scheme->name, "rk4") != 0) continue;
        const double error = drift(scheme, &ode, &space, step_of(scheme), y0);
        print_message("  %-13s: %.2g\n", scheme->name, error);
        assert_true((error <= 1e-13) == (lie || projected));
    }
}

/* R' = hat(R J^-1 R^T pi) R, pi constant */
static lg_status attitude(void *user, double t, const double *y, const double *input, double *out) {
    static const double pi[3] = {0.4, 1.1, -0.7}, inertia[3] = {0.8, 1.3, 2.1};
    double body[3];
    for (int j = 0; j < 3; j++) body[j] = (y[j] * pi[0] + y[3 + j] * pi[1] + y[6 + j] * pi[2]) / inertia[j];
    for (int i = 0; i < 3; i++) out[i] = y[3 * i] * body[0] + y[3 * i + 1] * body[1] + y[3 * i + 2] * body[2];
    return LG_OK;
}

TEST("attitude") {
    const double identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    lg_ode ode = {.field = attitude};
    assert_ok(lg_space_init(&ode.space, &(lg_space_factor){LG_SPACE_SO3, 1}, 1));
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        if (!is_lie(scheme)) continue;
        const double error = drift(scheme, &ode, &ode.space, 0.1, identity);
        print_message("  %-13s: %.2g\n", scheme->name, error);
        assert_true(error <= 1e-13);
    }
}

TEST("slgi") {
    double y0[12];
    lg_ode ode = {.field = top_field};
    assert_ok(lg_space_init(&ode.space, &(lg_space_factor){LG_SPACE_SE3, 1}, 1));
    for (int fast = 0; fast < 2; fast++) {
        top_start(fast ? 150.0 : 5.0, y0);
        const double error = drift(lg_scheme_find("slgi"), &ode, &ode.space, 0.01, y0);
        print_message("  slgi, %s: %.2g\n", fast ? "fast" : "slow", error);
        assert_true(error <= 1e-13);
    }
}
