/* Compares gradients of trajectories with differences, with a closed form, and with gradients computed with
 * other numbers of checkpoints. */
#include "mechanics/system_check.h"

#include "liegrad/ops.h"
#include "liegrad/taped.h"

enum { MOST = 16, STEPS = 23 };

/* A functional J = final.y_N + along/2 sum_n |y_n|^2 of a trajectory. */
typedef struct setup {
    const char *scheme;
    lg_ode ode;
    lg_taped_ode taped;
    double parameters[MOST];
    size_t parameter_count, fixed; /* the last `fixed` parameters are not varied */
    double y0[MOST], final[MOST], along;
    const double *t, *h;
    size_t steps, checkpoints;
    lg_var theta; /* the parameters on the tape */
    /* A system of the library with these parameters; NULL: the fields above are used. */
    const char *system, *form;
    size_t links;
    lg_system *made;
    lg_system_user plain_user;
    lg_system_taped_user taped_user;
    double work[SYSTEM_MAX_DIM];
    /* called before the plain field and the taped field are evaluated; may be NULL */
    lg_status (*watch[2])(double t);
    /* (steps + 1, dim): gets the states that the source was called with; may be NULL */
    double *seen;
    /* Planted errors. */
    size_t stop_at; /* index of the source call that returns `stop` */
    lg_status stop;
    double bind_shift; /* added to parameter 0 on the tape only */
    bool bind_dimension;
} setup;

static lg_status bind(void *user, lg_tape *tape, lg_var parameters, lg_taped_ode *ode) {
    setup *s = user;
    s->theta = parameters;
    if (s->bind_shift != 0.0) s->theta = lg_add_scalar(tape, parameters, s->bind_shift);
    *ode = s->taped;
    ode->user = s;
    if (s->bind_dimension) ode->space.dim++;
    return LG_OK;
}

static lg_status source(void *user, size_t n, double t, const double *y, double *gradient) {
    const setup *s = user;
    if (s->stop != LG_OK && n == s->stop_at) return s->stop;
    const double expected = n < s->steps ? s->t[n] : s->t[n - 1] + s->h[n - 1];
    if (t != expected) return LG_CHECK_FAILED;
    for (size_t i = 0; i < s->ode.space.dim; i++) {
        if (gradient[i] != 0.0) return LG_CHECK_FAILED;
        gradient[i] += s->along * y[i] + (n == s->steps ? s->final[i] : 0.0);
    }
    return LG_OK;
}

static lg_status system_field(void *user, double t, const double *y, const double *input, double *out) {
    setup *s = user;
    lg_ode ode;
    lg_status status = s->watch[0] != NULL ? s->watch[0](t) : LG_OK;
    if (status == LG_OK) status = lg_system_ode(s->made, LG_COORDINATES_LIE, &ode, &s->plain_user, s->work);
    return status != LG_OK ? status : ode.field(ode.user, t, y, input, out);
}

static lg_status system_taped(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                              lg_var *out) {
    setup *s = user;
    lg_taped_ode ode;
    lg_status status = s->watch[1] != NULL ? s->watch[1](t.value) : LG_OK;
    if (status == LG_OK)
        status = lg_system_taped_ode(s->made, LG_COORDINATES_LIE, s->theta, &ode, &s->taped_user);
    return status != LG_OK ? status : ode.field(ode.user, tape, t, y, input, out);
}

static void use_parameters(setup *s) {
    s->ode.user = s;
    if (s->system != NULL) s->made = make_system_of(s->system, s->form, s->links, s->parameters);
}

static lg_adjoint_problem problem_of(setup *s) {
    lg_adjoint_problem p;
    lg_adjoint_problem_init(&p);
    if (isfinite(s->parameters[1])) use_parameters(s);
    p.scheme = lg_scheme_find(s->scheme);
    p.ode = &s->ode;
    p.bind = bind;
    p.parameters = s->parameters;
    p.parameter_count = s->parameter_count;
    p.source = source;
    p.user = s;
    p.t = s->t;
    p.h = s->h;
    p.steps = s->steps;
    p.checkpoints = s->checkpoints;
    return p;
}

typedef struct result {
    double y_end[MOST], dy0[MOST], dparameters[MOST];
    lg_adjoint_stats stats;
} result;

static lg_status try_gradient(const lg_context *context, setup *s, result *r, lg_error *error) {
    lg_adjoint_problem p = problem_of(s);
    return lg_adjoint_gradient(context, &p, s->y0, r->y_end, r->dy0, r->dparameters, &r->stats, error);
}

static void gradient_of(setup *s, result *r) {
    lg_error error = {LG_OK, ""};
    memset(r, 0, sizeof *r);
    if (try_gradient(NULL, s, r, &error) != LG_OK)
        fail_msg("%s: %s: %s", s->scheme, lg_status_name(error.status), error.message);
}

/* J computed by the plain stepper with the same steps. */
static double functional(setup *s) {
    const size_t mark = lg_test_owned();
    double y[MOST], J = 0.0;
    use_parameters(s);
    const size_t d = s->ode.space.dim;
    lg_stepper *stepper = test_stepper(lg_scheme_find(s->scheme), &s->ode);
    memcpy(y, s->y0, d * sizeof *y);
    for (size_t n = 0; n <= s->steps; n++) {
        for (size_t i = 0; i < d; i++) J += 0.5 * s->along * y[i] * y[i];
        if (n < s->steps) assert_ok(lg_stepper_step(stepper, s->t[n], s->h[n], y, NULL, y));
    }
    for (size_t i = 0; i < d; i++) J += s->final[i] * y[i];
    lg_test_give_back(mark);
    return J;
}

/* dJ/dx by a five-point formula with an error of O(e^4). */
static double difference(setup *s, double *x) {
    static const double weight[4] = {1.0, -8.0, 8.0, -1.0}, place[4] = {-2.0, -1.0, 1.0, 2.0};
    const double x0 = *x, e = 5e-4;
    double sum = 0.0;
    for (int i = 0; i < 4; i++) {
        *x = x0 + place[i] * e;
        sum += weight[i] * functional(s);
    }
    *x = x0;
    return sum / (12.0 * e);
}

static double largest(const double *x, size_t n) {
    double most = 0.0;
    for (size_t i = 0; i < n; i++) most = fmax(most, fabs(x[i]));
    return most;
}

/* The largest error of `g` against differences, relative to the largest number of g. */
static double worst(setup *s, const double *g, double *x, size_t n) {
    double most = 0.0;
    for (size_t i = 0; i < n; i++) most = fmax(most, fabs(g[i] - difference(s, &x[i])));
    return n > 0 ? most / largest(g, n) : 0.0;
}

static void against_differences(setup *s, const char *what) {
    result r;
    gradient_of(s, &r);
    const double in_y0 = worst(s, r.dy0, s->y0, s->ode.space.dim);
    const double in_parameters = worst(s, r.dparameters, s->parameters, s->parameter_count - s->fixed);
    print_message("%-16s %-34s start %.1e, parameters %.1e\n", s->scheme, what, in_y0, in_parameters);
    assert_true(in_y0 < 1e-9 && in_parameters < 1e-9);
}

/* ---- steps ---- */

/* Steps of different lengths from t = 0.3. */
static void unequal_steps(double h, double *times, double *sizes, size_t steps) {
    double t = 0.3;
    for (size_t n = 0; n < steps; n++) {
        times[n] = t;
        sizes[n] = h * (1.0 + 0.3 * sin(1.7 * (double)n));
        t += sizes[n];
    }
}

static double times[STEPS], sizes[STEPS];

static void use_steps(setup *s, double h) {
    unequal_steps(h, times, sizes, STEPS);
    s->t = times;
    s->h = sizes;
    s->steps = STEPS;
}

/* ---- y' = A y ---- */

enum { LINEAR = 3 };

FIELD(linear_field, y) {
    const setup *s = user;
    for (int i = 0; i < LINEAR; i++) {
        out[i] = 0.0;
        for (int j = 0; j < LINEAR; j++) out[i] += s->parameters[LINEAR * i + j] * y[j];
    }
}

TAPED_FIELD(linear_taped) {
    const setup *s = user;
    out[0] = lg_matmul_nt(tape, y[0], lg_reshape(tape, s->theta, lg_shape2(LINEAR, LINEAR)));
}

static setup linear_setup(void) {
    setup s = {.scheme = "rk4",
               .ode.field = linear_field,
               .taped.field = linear_taped,
               .parameters = {-0.2, 1.3, 0.4, -1.1, 0.1, 0.7, 0.3, -0.9, -0.3},
               .parameter_count = LINEAR * LINEAR,
               .y0 = {1.0, -0.4, 0.6},
               .final = {0.7, 1.2, -0.5},
               .along = 0.3};
    assert_ok(lg_space_init_rn(&s.ode.space, LINEAR));
    s.taped.space = s.ode.space;
    use_steps(&s, 0.1);
    return s;
}

TEST("gradients of a linear system agree with differences, also for implicit schemes with Newton's method") {
    static const char *const schemes[] = {"rk4", "implicit-euler", "midpoint"};
    for (size_t i = 0; i < LG_COUNT(schemes); i++) {
        setup s = linear_setup();
        s.scheme = schemes[i];
        against_differences(&s, "linear");
    }
}

/* ---- systems ---- */

static setup system_setup(const char *scheme, const char *system, const char *form, size_t links) {
    setup s = {.scheme = scheme,
               .system = system,
               .form = form,
               .links = links,
               .ode.field = system_field,
               .taped.field = system_taped,
               .along = 0.2};
    for (int i = 0; i < 12; i++) s.final[i] = cos(2.0 * i + 0.5);
    use_steps(&s, 0.05);
    return s;
}

/* Two links on (T*S^2)^2. Parameters: gravity, masses, lengths. */
static setup chain_setup(const char *scheme) {
    static const double parameters[] = {2.0, 1.0, 0.7, 1.0, 1.2},
                        y0[] = {0.6, 0.0, 0.8, 0.8, 0.5, -0.6, 0.0, -0.6, 0.8, 0.9, 0.4, 0.3};
    setup s = system_setup(scheme, "pendulum-chain", "hamiltonian", 2);
    memcpy(s.parameters, parameters, sizeof parameters);
    memcpy(s.y0, y0, sizeof y0);
    s.parameter_count = LG_COUNT(parameters);
    assert_ok(lg_space_init(&s.ode.space, &(lg_space_factor){LG_SPACE_TS2, 2}, 1));
    s.taped.space = s.ode.space;
    return s;
}

TEST("gradients of two links agree with differences, for six schemes") {
    static const char *const schemes[] = {"lie-euler", "rkmk3", "rkmk4", "cf4", "rkmk54", "cf32a"};
    for (size_t i = 0; i < sizeof schemes / sizeof *schemes; i++) {
        setup s = chain_setup(schemes[i]);
        against_differences(&s, "two links");
        s.along = 0.0;
        against_differences(&s, "two links, the end only");
    }
}

/* A top on T*SO(3). Parameters: inertia, mass, length, direction of the centre of mass (a unit vector),
 * gravity. */
TEST("gradients of a top agree with differences, for slgi, RKMK and commutator-free schemes") {
    static const char *const schemes[] = {"slgi", "rkmk4", "cf4"};
    static const double parameters[] = {1.0, 1.6, 0.9, 0.7, 0.5, 0.0, 0.6, 0.8, 0.4, -0.7, -1.1},
                        y0[] = {0.8, -0.6, 0.0, 0.48, 0.64, -0.6, 0.36, 0.48, 0.8, 0.5, -1.2, 0.9};
    for (size_t k = 0; k < LG_COUNT(schemes); k++) {
        setup s = system_setup(schemes[k], "heavy-top", "cotangent", 0);
        memcpy(s.parameters, parameters, sizeof parameters);
        memcpy(s.y0, y0, sizeof y0);
        s.parameter_count = LG_COUNT(parameters);
        s.fixed = 6;
        assert_ok(lg_space_init(&s.ode.space, &(lg_space_factor){LG_SPACE_SE3, 1}, 1));
        s.taped.space = s.ode.space;
        against_differences(&s, "top");
    }
}

/* ---- H = p^2/2 + a q^4 with the force b cos t ---- */

FIELD(quartic_force, q) {
    const setup *s = user;
    out[0] = -4.0 * s->parameters[0] * q[0] * q[0] * q[0];
    if (s->parameters[1] != 0.0) out[0] += s->parameters[1] * cos(t);
}

FIELD(plain_velocity, p) {
    out[0] = p[0];
}

static lg_status quartic_force_taped(void *user, lg_tape *tape, lg_taped_time t, lg_var q, lg_var input,
                                     lg_var *out) {
    const setup *s = user;
    lg_var a = lg_slice(tape, s->theta, 0, 0, 1), b = lg_slice(tape, s->theta, 0, 1, 1);
    lg_var cube = lg_mul(tape, lg_square(tape, q), q);
    *out = lg_add(tape, lg_scale(tape, lg_mul(tape, a, cube), -4.0), lg_scale(tape, b, cos(t.value)));
    return lg_tape_status(tape);
}

static lg_status velocity_taped(void *user, lg_tape *tape, lg_taped_time t, lg_var p, lg_var input,
                                lg_var *out) {
    *out = p;
    return lg_tape_status(tape);
}

static void split_plane(setup *s) {
    const lg_space_factor two[2] = {{LG_SPACE_RN, 1}, {LG_SPACE_RN, 1}};
    assert_ok(lg_space_init_rn(&s->ode.space, 2));
    assert_ok(lg_space_init(&s->taped.space, two, 2));
}

static setup quartic_setup(const char *scheme) {
    setup s = {.scheme = scheme,
               .ode = {.force = quartic_force, .velocity = plain_velocity},
               .taped = {.force = quartic_force_taped, .velocity = velocity_taped},
               .parameters = {0.8, 0.6},
               .parameter_count = 2,
               .y0 = {1.1, 0.3},
               .final = {1.0, -0.7},
               .along = 0.4};
    split_plane(&s);
    use_steps(&s, 0.1);
    return s;
}

TEST("gradients of splitting schemes agree with differences") {
    setup verlet = quartic_setup("stormer-verlet"), euler = quartic_setup("symplectic-euler");
    against_differences(&verlet, "quartic, driven");
    against_differences(&euler, "quartic, driven");
}

/* ---- adaptive and single steps ---- */

enum { ADAPTIVE = 400 };

typedef struct accepted {
    double t[ADAPTIVE], h[ADAPTIVE];
    size_t count;
} accepted;

static lg_status observe(void *user, double t, double h, const double *y) {
    accepted *a = user;
    if (a->count == ADAPTIVE) return LG_TOO_MANY_STEPS;
    a->t[a->count] = t;
    a->h[a->count++] = h;
    return LG_OK;
}

TEST("gradients for the recorded steps of an adaptive run, forward or backward, agree with differences") {
    static accepted steps;
    static const double ends[] = {2.0, -1.5};
    for (int i = 0; i < 2; i++) {
        setup s = chain_setup("rkmk54");
        lg_step_controller control;
        lg_run_stats stats;
        double y_end[12];
        result r;
        lg_step_controller_init(&control);
        control.rtol = control.atol = 1e-8;
        control.h_initial = 0.2;
        control.observe = observe;
        control.observer = &steps;
        steps.count = 0;
        use_parameters(&s);
        lg_stepper *stepper = test_stepper(lg_scheme_find(s.scheme), &s.ode);
        assert_ok(lg_integrate_adaptive(stepper, &control, 0.0, s.y0, &ends[i], 1, y_end, &stats));
        print_message("%zu steps accepted, %zu rejected, from %.3g to %.3g\n", stats.steps, stats.rejected,
                      steps.h[0], steps.h[steps.count - 1]);
        assert_int_equal(steps.count, stats.steps);
        assert_true(steps.count > 10 && stats.rejected > 0);
        s.t = steps.t;
        s.h = steps.h;
        s.steps = steps.count;
        against_differences(&s, "two links, accepted steps");
        gradient_of(&s, &r);
        assert_memory_equal(r.y_end, y_end, sizeof y_end);
        s.along = 0.0;
        against_differences(&s, "two links, accepted steps, the end");
    }
}

TEST("a run of one step needs one checkpoint") {
    setup s = chain_setup("cf4");
    s.steps = 1;
    against_differences(&s, "two links, one step");
    result r;
    gradient_of(&s, &r);
    assert_int_equal(r.stats.checkpoints, 1);
}

/* ---- checkpoints ---- */

static void assert_bits(const result *a, const result *b) {
    assert_memory_equal(a->y_end, b->y_end, sizeof a->y_end);
    assert_memory_equal(a->dy0, b->dy0, sizeof a->dy0);
    assert_memory_equal(a->dparameters, b->dparameters, sizeof a->dparameters);
}

TEST("the number of checkpoints does not change the gradient") {
    static const size_t counts[] = {1, 2, 7, STEPS - 1, STEPS, 0};
    static const char *const schemes[] = {"rkmk54", "rkmk4", "cf4",
                                          "cf43"}; /* the first scheme reuses stages of the step before */
    for (size_t k = 0; k < sizeof schemes / sizeof *schemes; k++) {
        setup s = chain_setup(schemes[k]);
        result first, r;
        s.checkpoints = 1;
        gradient_of(&s, &first);
        for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) {
            s.checkpoints = counts[i];
            gradient_of(&s, &r);
            assert_bits(&r, &first);
            const size_t used = counts[i] > 0 ? counts[i] : 5, longest = (STEPS + used - 1) / used;
            assert_int_equal(r.stats.checkpoints, used);
            assert_int_equal(r.stats.states_size, 8 * 12 * (used + 1 + longest));
        }
    }
}

/* If the field depends on time, a segment that starts at a checkpoint differs by the rounding of t + h. */
TEST("for a driven system, gradients with other checkpoints differ only by the rounding of times") {
    setup s = quartic_setup("stormer-verlet");
    result first, r;
    size_t moved = 0;
    for (size_t n = 0; n < STEPS; n++) times[n] = 0.3 + 0.1 * (double)n, sizes[n] = 0.1;
    s.checkpoints = 1;
    gradient_of(&s, &first);
    for (s.checkpoints = 2; s.checkpoints <= STEPS; s.checkpoints++) {
        gradient_of(&s, &r);
        moved += memcmp(r.y_end, first.y_end, sizeof r.y_end) != 0;
        assert_all_close(r.y_end, first.y_end, 2, 1e-13, 1e-14);
        assert_all_close(r.dy0, first.dy0, 2, 1e-13, 1e-14);
        assert_all_close(r.dparameters, first.dparameters, 2, 1e-13, 1e-13);
    }
    assert_true(moved > 0); /* otherwise the comparison would prove nothing */
}

/* ---- a long run ---- */

FIELD(pendulum_force, q) {
    const setup *s = user;
    out[0] = -s->parameters[0] * sin(q[0]);
}

static lg_status pendulum_force_taped(void *user, lg_tape *tape, lg_taped_time t, lg_var q, lg_var input,
                                      lg_var *out) {
    const setup *s = user;
    *out = lg_neg(tape, lg_mul(tape, s->theta, lg_sin(tape, q)));
    return lg_tape_status(tape);
}

enum { LONG = 100000 };

/* p <- p - h/2 a sin q; q <- q + h p; p <- p - h/2 a sin q, and the hand-written adjoint, which stores all
 * states. */
static void pendulum_by_hand(const setup *s, double y[][2], double *lambda, double *da) {
    const double a = s->parameters[0];
    memcpy(y[0], s->y0, sizeof y[0]);
    for (size_t n = 0; n < s->steps; n++) {
        const double half = 0.5 * s->h[n], p = y[n][1] - half * a * sin(y[n][0]);
        y[n + 1][0] = y[n][0] + s->h[n] * p;
        y[n + 1][1] = p - half * a * sin(y[n + 1][0]);
    }
    *da = 0.0;
    for (int i = 0; i < 2; i++) lambda[i] = s->final[i] + s->along * y[s->steps][i];
    for (size_t n = s->steps; n-- > 0;) {
        const double half = 0.5 * s->h[n];
        *da -= half * sin(y[n + 1][0]) * lambda[1];
        lambda[0] -= half * a * cos(y[n + 1][0]) * lambda[1];
        lambda[1] += s->h[n] * lambda[0];
        *da -= half * sin(y[n][0]) * lambda[1];
        lambda[0] -= half * a * cos(y[n][0]) * lambda[1];
        for (int i = 0; i < 2; i++) lambda[i] += s->along * y[n][i];
    }
}

TEST("the gradient of 10^5 steps agrees with a hand-written one, in memory as the formula says") {
    static double t[LONG], h[LONG], y[LONG + 1][2];
    setup s = {.scheme = "stormer-verlet",
               .ode = {.force = pendulum_force, .velocity = plain_velocity},
               .taped = {.force = pendulum_force_taped, .velocity = velocity_taped},
               .parameters = {1.3},
               .parameter_count = 1,
               .y0 = {2.1, 0.0},
               .final = {1.0, -0.7},
               .along = 1e-5,
               .t = t,
               .h = h,
               .steps = LONG};
    split_plane(&s);
    for (size_t n = 0; n < LONG; n++) t[n] = 0.02 * (double)n, h[n] = 0.02;
    result r;
    gradient_of(&s, &r);
    double lambda[2], da;
    pendulum_by_hand(&s, y, lambda, &da);
    print_message("%d steps: dJ/dy0 %.15g %.15g, dJ/da %.15g\n", LONG, r.dy0[0], r.dy0[1], r.dparameters[0]);
    print_message("  relative errors %.1e %.1e %.1e\n", r.dy0[0] / lambda[0] - 1.0,
                  r.dy0[1] / lambda[1] - 1.0, r.dparameters[0] / da - 1.0);
    print_message("  C = %zu, states %zu bytes, tape %zu bytes, %.3g s\n", r.stats.checkpoints,
                  r.stats.states_size, r.stats.tape_size, r.stats.seconds);
    for (int i = 0; i < 2; i++) {
        assert_close(r.y_end[i], y[LONG][i], 1e-9, 1e-9);
        assert_close(r.dy0[i], lambda[i], 1e-9, 0.0);
    }
    assert_close(r.dparameters[0], da, 1e-9, 0.0);
    assert_true(r.stats.states_size + r.stats.tape_size < 10000000);
    assert_int_equal(r.stats.states_size, 8 * 2 * (317 + 1 + 316));
    assert_true(r.stats.seconds > 0.0);
    /* The tape holds a single step, whatever the number of steps. */
    const size_t tape_bytes = r.stats.tape_size;
    s.steps = 10;
    gradient_of(&s, &r);
    assert_int_equal(r.stats.tape_size, tape_bytes);
}

/* ---- outputs that are left out, errors ---- */

TEST("any output may be left out") {
    setup s = chain_setup("rkmk4");
    result r, part = {.stats = {0}};
    gradient_of(&s, &r);
    lg_adjoint_problem p = problem_of(&s);
    assert_ok(lg_adjoint_gradient(NULL, &p, s.y0, NULL, part.dy0, NULL, NULL, NULL));
    assert_memory_equal(part.dy0, r.dy0, sizeof r.dy0);
    assert_ok(lg_adjoint_gradient(NULL, &p, s.y0, NULL, NULL, part.dparameters, NULL, NULL));
    assert_memory_equal(part.dparameters, r.dparameters, sizeof r.dparameters);
    /* If only the end is requested, neither bind nor source is called. */
    s.stop = LG_CHECK_FAILED;
    s.bind_dimension = true;
    assert_ok(lg_adjoint_gradient(NULL, &p, s.y0, part.y_end, NULL, NULL, NULL, NULL));
    assert_memory_equal(part.y_end, r.y_end, sizeof r.y_end);
    assert_ok(lg_adjoint_gradient(NULL, &p, s.y0, NULL, NULL, NULL, NULL, NULL));
    /* A field without parameters; the gradient may overwrite the start. */
    setup linear = linear_setup();
    linear.scheme = "rkmk4";
    gradient_of(&linear, &r);
    p = problem_of(&linear);
    assert_ok(lg_adjoint_gradient(NULL, &p, linear.y0, NULL, linear.y0, NULL, NULL, NULL));
    assert_memory_equal(linear.y0, r.dy0, LINEAR * sizeof *r.dy0);
}

FIELD(drift_field, y) {
    out[0] = 2.0;
}

TAPED_FIELD(drift_taped) {
    const setup *s = user;
    out[0] = lg_full(tape, lg_shape2(1, 1), lg_is_none(s->theta) ? 2.0 : NAN);
}

TEST("a field that depends on neither the state nor a parameter has a gradient") {
    setup s = {
        .scheme = "rk4", .ode.field = drift_field, .taped.field = drift_taped, .y0 = {0.5}, .final = {3.0}};
    assert_ok(lg_space_init_rn(&s.ode.space, 1));
    s.taped.space = s.ode.space;
    use_steps(&s, 0.1);
    result r;
    gradient_of(&s, &r);
    assert_close(r.dy0[0], 3.0, 0.0, 0.0);
    assert_close(r.y_end[0], 0.5 + 2.0 * (sizes[STEPS - 1] + times[STEPS - 1] - times[0]), 1e-14, 0.0);
}

/* The call must fail with this status and a message that contains the word, and must not write anything. */
static void refused(const lg_context *context, setup *s, const lg_adjoint_problem *p, lg_status expected,
                    const char *word) {
    result r, untouched;
    lg_error error = {LG_OK, ""};
    memset(&r, 0x5a, sizeof r);
    memset(&untouched, 0x5a, sizeof untouched);
    const lg_status status =
        lg_adjoint_gradient(context, p, s->y0, r.y_end, r.dy0, r.dparameters, &r.stats, &error);
    if (status != expected || error.status != status || strstr(error.message, word) == NULL)
        fail_msg("%s: %s, expected %s with '%s'", lg_status_name(status), error.message,
                 lg_status_name(expected), word);
    assert_memory_equal(&r, &untouched, sizeof r);
    assert_status(lg_adjoint_gradient(context, p, s->y0, NULL, r.dy0, r.dparameters, NULL, NULL), expected);
}

static void refused_setup(setup *s, lg_status expected, const char *word) {
    const lg_adjoint_problem p = problem_of(s);
    refused(NULL, s, &p, expected, word);
}

TEST("invalid problems are refused with a message, and nothing is written") {
    setup s = chain_setup("rkmk4");
    const lg_adjoint_problem good = problem_of(&s);
    double bad[STEPS];
    memcpy(bad, s.h, sizeof bad);
    bad[STEPS - 1] = NAN;
    lg_adjoint_problem p;
    refused(NULL, &s, NULL, LG_INVALID_ARGUMENT, "initialised");
#define WITH(change, word) p = good, change, refused(NULL, &s, &p, LG_INVALID_ARGUMENT, word)
    WITH(p.size = 0, "initialised");
    WITH(p.scheme = NULL, "NULL");
    WITH(p.ode = NULL, "NULL");
    WITH(p.bind = NULL, "NULL");
    WITH(p.source = NULL, "NULL");
    WITH(p.t = NULL, "NULL");
    WITH(p.h = NULL, "NULL");
    WITH(p.steps = 0, "the number of steps is 0");
    WITH(p.checkpoints = STEPS + 1, "checkpoints");
    WITH(p.parameters = NULL, "`parameters` is NULL");
    WITH(p.h = bad, "finite");
    WITH(p.t = bad, "finite");
    lg_ode large = s.ode;
    large.space.dim = (size_t)UINT32_MAX + 1;
    WITH(p.ode = &large, "too large");
    large.space.dim = 0;
    WITH(p.ode = &large, "too large");
    WITH(p.parameter_count = (size_t)UINT32_MAX + 1, "too large");
#undef WITH
    assert_status(lg_adjoint_gradient(NULL, &good, NULL, NULL, NULL, NULL, NULL, NULL), LG_INVALID_ARGUMENT);
    s.y0[3] = INFINITY;
    refused_setup(&s, LG_INVALID_ARGUMENT, "initial state");
    s = chain_setup("rkmk4");
    s.parameters[1] = NAN;
    refused_setup(&s, LG_INVALID_ARGUMENT, "parameter");
    s = chain_setup("rk4"); /* a classical scheme on a manifold */
    refused_setup(&s, LG_UNSUPPORTED, "scheme");
    s = chain_setup("rkmk4");
    s.bind_dimension = true;
    refused_setup(&s, LG_INVALID_ARGUMENT, "dimension");
    s = chain_setup("rkmk4");
    s.bind_shift = 1e-4; /* the gradient would be taken at other parameters */
    refused_setup(&s, LG_INVALID_ARGUMENT, "the recorded and the plain equation differ");
    s = chain_setup("rkmk4");
    s.taped.field = NULL;
    refused_setup(&s, LG_INVALID_ARGUMENT, "step 1");
}

TAPED_FIELD(wrong_shape) {
    out[0] = y[0];
    out[1] = lg_full(tape, lg_shape3(1, 5, 3), 1.0);
}

static lg_status refusing(double t) {
    return t > 0.8 ? LG_NO_CONVERGENCE : LG_OK;
}

/* y' = y^2 */
FIELD(steep_field, y) {
    out[0] = y[0] * y[0];
}

TAPED_FIELD(steep_taped) {
    out[0] = lg_square(tape, y[0]);
}

static lg_status own_step(void *user, double t, double h, double *y) {
    return LG_OK;
}

TEST("schemes whose steps cannot be recorded on a tape are refused") {
    setup s = chain_setup("variational");
    s.ode.step = own_step;
    refused_setup(&s, LG_UNSUPPORTED, "a variational scheme cannot be recorded");
}

TEST("failures of callbacks end the run, and nothing is written") {
    setup s = chain_setup("rkmk4");
    for (size_t n = 0; n <= STEPS; n += STEPS) {
        s.stop_at = n;
        s.stop = LG_NOT_FOUND;
        refused_setup(&s, LG_NOT_FOUND, "source");
    }
    s.stop = LG_OK;
    s.final[2] = NAN;
    refused_setup(&s, LG_NOT_FINITE, "source");
    s = chain_setup("rkmk4");
    s.taped.field = wrong_shape;
    refused_setup(&s, LG_SHAPE, "(1, 5, 3)");
    for (int taped = 0; taped < 2; taped++) {
        s = chain_setup("rkmk4");
        s.watch[taped] = refusing;
        refused_setup(&s, LG_NO_CONVERGENCE, "converge");
    }
    /* The solution of y' = y^2 becomes infinite. */
    s = (setup){
        .scheme = "rk4", .ode.field = steep_field, .taped.field = steep_taped, .y0 = {1.5}, .final = {1.0}};
    assert_ok(lg_space_init_rn(&s.ode.space, 1));
    s.taped.space = s.ode.space;
    use_steps(&s, 0.9);
    refused_setup(&s, LG_NOT_FINITE, "NaN");
    /* The states stay finite, but the derivative overflows. */
    use_steps(&s, 0.02);
    s.y0[0] = 1.7;
    s.final[0] = 1e308;
    s.along = 0.0;
    refused_setup(&s, LG_NOT_FINITE, "finite");
}

TEST("every allocation may fail, and nothing is written") {
    setup s = chain_setup("rkmk54");
    s.steps = 4;
    EVERY_ALLOCATION_FAILS(context, 5, {
        result r;
        result untouched;
        memset(&r, 0x5a, sizeof r);
        memset(&untouched, 0x5a, sizeof untouched);
        status = try_gradient(context, &s, &r, NULL);
        if (status != LG_OK) assert_memory_equal(&r, &untouched, sizeof r);
    });
}

static volatile int cancel_flag;
static size_t fields_left;

static lg_status cancelling(double t) {
    if (fields_left > 0 && --fields_left == 0) cancel_flag = 1;
    return LG_OK;
}

TEST("a run can be cancelled at any time") {
    lg_context_options options;
    lg_context_options_init(&options);
    options.cancel = &cancel_flag;
    lg_context *context;
    assert_ok(lg_context_create(&options, &context));
    setup s = chain_setup("rkmk4");
    s.watch[0] = s.watch[1] = cancelling;
    const lg_adjoint_problem p = problem_of(&s);
    /* Lower bound on the evaluations of the field: 4 stages, once forward and once on the tape per step,
     * and in the two computations of the first step that are compared. */
    const size_t all = 4 * (2 + 2 * STEPS);
    for (size_t at = 1; at < all; at += 5) {
        result r, untouched;
        memset(&r, 0x5a, sizeof r);
        memset(&untouched, 0x5a, sizeof untouched);
        cancel_flag = 0;
        fields_left = at;
        assert_status(lg_adjoint_gradient(context, &p, s.y0, r.y_end, r.dy0, r.dparameters, &r.stats, NULL),
                      LG_CANCELLED);
        assert_memory_equal(&r, &untouched, sizeof r);
    }
    cancel_flag = 0;
    fields_left = 0;
    result r;
    assert_ok(try_gradient(context, &s, &r, NULL));
    lg_context_destroy(context);
}
