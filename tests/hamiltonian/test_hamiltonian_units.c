/* Learned Hamiltonians with scales: they are the same model in other units, and training does not depend on
 * units. */
#include "support/model_support.h"

#include "liegrad/mechanics.h"
#include "hamiltonian/internal.h"
#include "integrators/taped_internal.h"
#include "model/internal.h"

/* ---- a model with scales ---- */

typedef struct row {
    const lg_hamiltonian_family *family;
    uint32_t n;
    lg_potential_kind potential;
    lg_hamiltonian_scales scales;
} row;

static const row rows[] = {
    {&lg_hamiltonian_chain, 1, LG_POTENTIAL_MLP, {3.0, {1.0, 7.0}}},
    {&lg_hamiltonian_chain, 1, LG_POTENTIAL_DICTIONARY, {1e-3, {1.0, 1e5}}},
    {&lg_hamiltonian_chain, 3, LG_POTENTIAL_LINEAR, {1e4, {1.0, 0.01}}},
    {&lg_hamiltonian_separable, 1, LG_POTENTIAL_MLP, {3.0, {5.0, 7.0}}},
    {&lg_hamiltonian_separable, 3, LG_POTENTIAL_MLP, {1e3, {1e-6, 1e-2}}},
    {&lg_hamiltonian_separable, 2, LG_POTENTIAL_LINEAR, {0.2, {11.0, 0.3}}},
    {&lg_hamiltonian_rotation, 1, LG_POTENTIAL_MLP, {3.0, {1.0, 7.0}}},
    {&lg_hamiltonian_rotation_direction, 1, LG_POTENTIAL_MLP, {1e-3, {1.0, 1e5, 1.0, 1e5}}},
    {&lg_hamiltonian_pose, 1, LG_POTENTIAL_MLP, {20.0, {1.0, 0.3, 50.0, 0.3 / 50.0}}},
    {&lg_hamiltonian_direction_line, 1, LG_POTENTIAL_MLP, {0.1, {1.0, 5.0, 1e3, 5e-3}}},
};

/* A model with scales and the model inside it, with the same parameters. */
typedef struct pair {
    built scaled, inner;
    size_t d, m;
    double part[MOST_STATE]; /* the scale of each number of a state */
    double
        momentum[MOST_INPUT]; /* the scale of each momentum, in their order, which is the order of inputs */
    double energy, time;
} pair;

static pair make_pair(const row *r) {
    pair p = {.inner = build_hamiltonian(r->family, r->n, r->potential, LG_TANH)};
    lg_hamiltonian model = p.inner.hamiltonian;
    model.scales = r->scales;
    p.scaled = build_from(&model, p.inner.theta);
    p.d = lg_model_inputs(p.inner.model);
    p.m = lg_model_input_dim(p.inner.model);
    const lg_space space = space_of(&p.inner);
    uint8_t part[MOST_STATE];
    size_t count = 0;
    lg_taped_number_parts(&space, part);
    for (size_t i = 0; i < p.d; i++) p.part[i] = r->scales.part[part[i]];
    for (size_t i = 0; i < p.d; i++)
        if (part[i] % 2 == 1) p.momentum[count++] = p.part[i];
    assert_int_equal(count, p.m);
    p.time = r->scales.time;
    p.energy = r->scales.part[0] * r->scales.part[1] / r->scales.time;
    return p;
}

/* Draws a state, for the inner model and in units. Forces are momenta per time. */
static void draw(const pair *p, lg_rng *rng, double *inner, double *y, double *force, double *u) {
    draw_state(&p->inner, rng, inner);
    for (size_t i = 0; i < p->d; i++) y[i] = p->part[i] * inner[i];
    for (size_t i = 0; i < p->m; i++)
        force[i] = lg_rng_normal(rng), u[i] = force[i] * p->momentum[i] / p->time;
}

static void assert_scaled(const double *got, const double *expected, const double *part, double by,
                          size_t n) {
    double most = 0.0;
    for (size_t i = 0; i < n; i++) most = fmax(most, fabs(expected[i]));
    for (size_t i = 0; i < n; i++) assert_close(got[i] / (part[i] * by), expected[i], 1e-12, 1e-12 * most);
}

TEST("a model with scales has energy, gradient, velocity and steps of the inner model, in its units") {
    for (size_t k = 0; k < LG_COUNT(rows); k++) {
        const pair p = make_pair(&rows[k]);
        lg_rng rng = test_rng(5, k);
        for (int draws = 0; draws < 3; draws++) {
            double x[MOST_STATE], y[MOST_STATE], f[MOST_INPUT], u[MOST_INPUT], H, inner_H, one[MOST_STATE];
            double g[MOST_STATE], inner_g[MOST_STATE], v[MOST_STATE], inner_v[MOST_STATE];
            draw(&p, &rng, x, y, f, u);
            for (size_t i = 0; i < p.d; i++) one[i] = 1.0 / p.part[i];
            lg_model_jacobian(p.scaled.model, y, &H, g, p.scaled.work);
            lg_model_jacobian(p.inner.model, x, &inner_H, inner_g, p.inner.work);
            assert_close(H / p.energy, inner_H, 1e-13, 1e-13);
            assert_scaled(g, inner_g, one, p.energy, p.d);
            lg_model_velocity(p.scaled.model, y, u, v, NULL, p.scaled.work);
            lg_model_velocity(p.inner.model, x, f, inner_v, NULL, p.inner.work);
            assert_scaled(v, inner_v, p.part, 1.0 / p.time, p.d);
        }
    }
}

TEST("every scheme steps a model with scales as the inner model, with the step divided by T") {
    for (size_t k = 0; k < LG_COUNT(rows); k++)
        for (size_t s = 0; s < lg_scheme_count(); s++) {
            const lg_scheme *scheme = lg_scheme_at(s);
            const pair p = make_pair(&rows[k]);
            const size_t mark = lg_test_owned();
            double x[MOST_STATE], y[MOST_STATE], f[MOST_INPUT], u[MOST_INPUT];
            if (lg_model_stepper_size(p.inner.model, scheme) == 0 || scheme->kind == LG_SCHEME_VARIATIONAL)
                continue;
            lg_rng rng = test_rng(6, k);
            draw(&p, &rng, x, y, f, u);
            lg_stepper *scaled = stepper_of(&p.scaled, scheme), *inner = stepper_of(&p.inner, scheme);
            for (int n = 0; n < 3; n++) {
                assert_ok(lg_stepper_step(inner, 0.0, 0.01, x, f, x));
                assert_ok(lg_stepper_step(scaled, 0.0, 0.01 * p.time, y, u, y));
            }
            assert_scaled(y, x, p.part, 1.0, p.d);
            lg_test_give_back(mark);
        }
}

/* ---- training ---- */

enum { N = 9, M = 7 };

typedef struct system_row {
    const char *name, *form;
    size_t links;
    const lg_hamiltonian_family *family;
    uint32_t n;
    const char *scheme;
} system_row;

static const system_row systems[] = {
    {"pendulum-chain", "hamiltonian", 1, &lg_hamiltonian_chain, 1, "cf4"},
    {"pendulum-chain", "hamiltonian", 2, &lg_hamiltonian_chain, 2, "rk4"},
    {"quartic", NULL, 0, &lg_hamiltonian_separable, 2, "stormer-verlet"},
    {"coupled-oscillators", NULL, 0, &lg_hamiltonian_separable, 2, "rk4"},
    {"heavy-top", NULL, 0, &lg_hamiltonian_rotation, 1, "rkmk4"},
    {"satellite", NULL, 0, &lg_hamiltonian_rotation_direction, 1, "variational"},
};

/* Units of mass, length and time: numbers of the data are multiplied by these. */
typedef struct units {
    double mass, length, time;
} units;

typedef struct training {
    lg_hamiltonian model;
    lg_hamiltonian_problem problem;
    double *data, *theta;
    size_t d;
} training;

RELEASES(release_system, lg_system_destroy)

/* Directions and rotations have no unit. */
static training make_training(const system_row *r, units in) {
    const bool turns = r->family->manifold != NULL;
    const double q = turns ? 1.0 : in.length, p = in.mass * in.length * (turns ? in.length : 1.0) / in.time;
    const uint32_t hidden[1] = {6};
    uint8_t part[MOST_STATE];
    lg_space space;
    lg_system_options so;
    lg_trajectory_options to;
    lg_system *system;
    double t[M], H[N];
    training out;
    lg_system_options_init(&so);
    so.links = r->links;
    const double gravity = 1.0;
    const lg_named_values given = {"gravity", &gravity, 1};
    if (r->form != NULL) so.form = r->form, so.parameters = &given, so.parameter_count = 1;
    assert_ok(lg_system_create(NULL, r->name, &so, &system, NULL));
    lg_test_owns(system, release_system);
    out.d = lg_system_dim(system);
    out.data = room(N * M * out.d);
    lg_trajectory_options_init(&to);
    to.trajectories = N, to.points = M, to.t_end = 0.25, to.seed = 3;
    assert_ok(lg_system_generate(NULL, system, &to, t, out.data, H, NULL));
    assert_ok(lg_hamiltonian_space(r->family, r->n, &space));
    lg_taped_number_parts(&space, part);
    for (size_t i = 0; i < N * M * out.d; i++) out.data[i] *= part[i % out.d] % 2 == 0 ? q : p;
    assert_ok(lg_hamiltonian_init(&out.model, r->family, r->n, LG_POTENTIAL_MLP, hidden, 1, LG_TANH));
    out.theta = room(lg_hamiltonian_parameters(&out.model));
    lg_rng rng = test_rng(4, 0);
    lg_hamiltonian_initialise(&out.model, &rng, out.theta);
    out.problem = (lg_hamiltonian_problem){.scheme = lg_scheme_find(r->scheme),
                                           .substeps = 1,
                                           .trajectories = N,
                                           .points = M,
                                           .dt = t[1] * in.time,
                                           .data = out.data};
    return out;
}

/* Sets the scales found from the data. Sets `model` here, when the training no longer moves in memory. */
static void scale(training *s) {
    s->problem.model = &s->model;
    assert_ok(lg_hamiltonian_find_scales(&s->problem, &s->model.scales, NULL));
    assert_ok(lg_hamiltonian_weigh(&s->problem, NULL));
}

/* Bodies on lines: x moves by 0.3 in each step and px is 5. With mass 1, x moves as fast as in the data. */
TEST("in each pair of parts the product of the scales is the same action") {
    lg_hamiltonian model;
    lg_hamiltonian_scales scales;
    assert_ok(lg_hamiltonian_init(&model, &lg_hamiltonian_pose, 1, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH));
    const size_t d = lg_hamiltonian_state_dim(&model);
    double *data = room(N * M * d);
    lg_space space;
    assert_ok(lg_hamiltonian_space(model.family, 1, &space));
    lg_rng rng = test_rng(12, 0);
    for (size_t i = 0; i < N; i++)
        for (size_t j = 0; j < M; j++) {
            double *y = data + (i * M + j) * d;
            assert_ok(lg_space_draw_start(&space, NULL, &rng, y));
            for (size_t c = 0; c < 3; c++) y[12 + c] = c == 0 ? 0.3 * (double)j : 0.0;
            for (size_t c = 0; c < 3; c++) y[15 + c] = c == 0 ? 5.0 : 0.0;
        }
    const lg_hamiltonian_problem problem = {
        .model = &model, .trajectories = N, .points = M, .dt = 0.1, .data = data};
    assert_ok(lg_hamiltonian_find_scales(&problem, &scales, NULL));
    assert_close(scales.part[2] * scales.part[3], scales.part[0] * scales.part[1], 1e-14, 0.0);
    assert_close(scales.part[3] * 3.0 * scales.time / scales.part[2], 5.0, 1e-12, 0.0);
    assert_true(fabs(scales.part[2] - 1.0) > 1e-3);
}

/* Loss and gradient of the whole data set on a tape of this type. */
static double loss_of(const training *s, lg_dtype dtype, double *gradient) {
    uint32_t samples[N];
    lg_fit_problem fit;
    lg_tape *tape = test_tape(dtype);
    const size_t n = lg_hamiltonian_parameters(&s->model);
    float narrow[256] = {0};
    lg_var loss;
    double value;
    assert_true(n <= LG_COUNT(narrow));
    for (uint32_t i = 0; i < N; i++) samples[i] = i;
    for (size_t i = 0; i < n; i++) narrow[i] = (float)s->theta[i];
    lg_hamiltonian_fit_problem(&s->problem, &fit);
    const void *start = dtype == LG_F64 ? (const void *)s->theta : narrow;
    const lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)n), start);
    assert_ok(fit.loss(fit.user, tape, theta, samples, N, N, &loss));
    assert_ok(lg_read(tape, loss, 1, &value));
    lg_var g = LG_NONE;
    assert_ok(lg_grad(tape, loss, &theta, 1, &g));
    assert_ok(lg_read(tape, g, n, gradient));
    return value;
}

static void compare(const training *a, const training *b, lg_dtype dtype, double tolerance) {
    const size_t n = lg_hamiltonian_parameters(&a->model);
    double *ga = room(n), *gb = room(n), most = 0.0;
    const double la = loss_of(a, dtype, ga), lb = loss_of(b, dtype, gb);
    assert_close(lb, la, tolerance, 0.0);
    for (size_t i = 0; i < n; i++) most = fmax(most, fabs(ga[i]));
    for (size_t i = 0; i < n; i++) assert_close(gb[i], ga[i], tolerance, tolerance * most);
}

TEST("training has the same bits in units that differ by powers of two") {
    static const units in[] = {{8.0, 1.0, 1.0},        {1.0, 0.25, 1.0},     {1.0, 1.0, 0x1p-30},
                               {0x1p30, 0x1p-20, 2.0}, {0x1p-560, 1.0, 1.0}, {0x1p560, 1.0, 1.0}};
    for (size_t k = 0; k < LG_COUNT(systems); k++)
        for (size_t u = 0; u < LG_COUNT(in); u++)
            for (int f32 = 0; f32 < 2; f32++) {
                training a = make_training(&systems[k], (units){1.0, 1.0, 1.0}),
                         b = make_training(&systems[k], in[u]);
                scale(&a), scale(&b);
                assert_true(b.model.scales.time == a.model.scales.time * in[u].time);
                compare(&a, &b, f32 ? LG_F32 : LG_F64, 0.0);
            }
}

TEST("training is the same to rounding in units that differ by 1e9 and 1e-9") {
    static const double by[] = {1e-9, 1e-6, 1e3, 1e9};
    for (size_t k = 0; k < LG_COUNT(systems); k++)
        for (size_t i = 0; i < 3 * LG_COUNT(by); i++) {
            units in = {1.0, 1.0, 1.0};
            *(i % 3 == 0 ? &in.mass : i % 3 == 1 ? &in.length : &in.time) = by[i / 3];
            training a = make_training(&systems[k], (units){1.0, 1.0, 1.0}),
                     b = make_training(&systems[k], in);
            scale(&a), scale(&b);
            compare(&a, &b, LG_F64, 1e-11);
        }
}

/* A and V are zero. */
TEST("with the data's weights a model without motion has the loss 1") {
    for (size_t k = 0; k < LG_COUNT(systems); k++) {
        if (systems[k].family != &lg_hamiltonian_separable) continue;
        training s = make_training(&systems[k], (units){3.0, 1e4, 20.0});
        scale(&s);
        memset(s.theta, 0, lg_hamiltonian_parameters(&s.model) * sizeof *s.theta);
        assert_close(loss_of(&s, LG_F64, room(lg_hamiltonian_parameters(&s.model))), 1.0, 1e-13, 0.0);
    }
}

/* For the separable systems; a chain would leave the manifold with rk4. */
TEST("the mean squared error and the floor are in the units of the data") {
    for (size_t k = 0; k < LG_COUNT(systems); k++) {
        training s = make_training(&systems[k], (units){1e3, 1e-2, 30.0});
        scale(&s);
        const built b = build_from(&s.model, s.theta);
        double sum = 0.0, twice = 0.0, error, floor;
        if (lg_model_stepper_size(b.model, s.problem.scheme) == 0) continue;
        lg_stepper *stepper = stepper_of(&b, s.problem.scheme);
        const double power = ldexp(1.0, s.problem.scheme->order), factor = power / (power - 1.0);
        for (size_t i = 0; i < N; i++) {
            double once[MOST_STATE], finer[MOST_STATE];
            const double *y = s.data + i * M * s.d, h = s.problem.dt;
            memcpy(once, y, s.d * sizeof *y), memcpy(finer, y, s.d * sizeof *y);
            for (size_t j = 1; j < M; j++) {
                assert_ok(lg_stepper_step(stepper, 0.0, h, once, NULL, once));
                assert_ok(lg_stepper_step(stepper, 0.0, 0.5 * h, finer, NULL, finer));
                assert_ok(lg_stepper_step(stepper, 0.0, 0.5 * h, finer, NULL, finer));
                for (size_t c = 0; c < s.d; c++) {
                    sum += pow(once[c] - y[j * s.d + c], 2.0);
                    twice += pow(factor * (once[c] - finer[c]), 2.0);
                }
            }
        }
        assert_ok(lg_hamiltonian_mean_squared_error(NULL, &s.problem, s.theta, &error, NULL));
        assert_ok(lg_hamiltonian_floor(NULL, &s.problem, s.theta, &floor, NULL));
        assert_close(error, sum / (N * (M - 1.0) * (double)s.d), 1e-9, 0.0);
        assert_close(floor, twice / (N * (M - 1.0) * (double)s.d), 1e-4, 0.0);
    }
}

TEST("the squares of lm and the loss have the same weights") {
    for (size_t k = 0; k < LG_COUNT(systems); k++) {
        training s = make_training(&systems[k], (units){1e3, 1e-2, 30.0});
        uint32_t samples[N];
        lg_fit_problem fit;
        lg_tape *tape = test_tape(LG_F64);
        lg_var r;
        double sum;
        scale(&s);
        for (uint32_t i = 0; i < N; i++) samples[i] = i;
        lg_hamiltonian_fit_problem(&s.problem, &fit);
        const lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)fit.parameters), s.theta);
        assert_ok(fit.residuals(fit.user, tape, theta, samples, N, N, &r));
        assert_ok(lg_read(tape, lg_sum(tape, lg_square(tape, r)), 1, &sum));
        assert_close(sum, loss_of(&s, LG_F64, room(fit.parameters)), 1e-13, 0.0);
    }
}

TEST("a first integral is computed in the units of the data") {
    training s = make_training(&systems[2], (units){1.0, 1.0, 1.0});
    double plain[LG_HAMILTONIAN_MAX_POINTS], scaled[LG_HAMILTONIAN_MAX_POINTS];
    s.problem.model = &s.model;
    s.problem.penalty = 1.0;
    assert_ok(lg_hamiltonian_integral_changes(NULL, &s.problem, plain));
    s.model.scales = (lg_hamiltonian_scales){0.3, {17.0, 0.6}};
    assert_ok(lg_hamiltonian_integral_changes(NULL, &s.problem, scaled));
    assert_close(scaled[2], plain[2], 1e-12, 0.0);
}

/* q = a cos(w t), p = -m a w sin(w t) over ten periods: T = 1/w for any distance of the points. */
TEST("the scales of an oscillator are its amplitudes and 1/w, with many or few points") {
    enum { MOST = 512 };
    const double a = 3e-3, w = 40.0, mass = 7.0;
    for (size_t points = 64; points <= MOST; points *= 2) {
        double *data = room(MOST * 2), dt = 10.0 * 2.0 * 3.141592653589793 / (w * (double)points);
        lg_hamiltonian model;
        lg_hamiltonian_scales scales;
        for (size_t j = 0; j < points; j++) {
            data[2 * j] = a * cos(w * dt * (double)j);
            data[2 * j + 1] = -mass * a * w * sin(w * dt * (double)j);
        }
        assert_ok(
            lg_hamiltonian_init(&model, &lg_hamiltonian_separable, 1, LG_POTENTIAL_MLP, NULL, 0, LG_TANH));
        const lg_hamiltonian_problem problem = {
            .model = &model, .trajectories = 1, .points = points, .dt = dt, .data = data};
        assert_ok(lg_hamiltonian_find_scales(&problem, &scales, NULL));
        assert_true(scales.time * w > 1.0 && scales.time * w < 1.1);
        assert_close(scales.part[0], a / sqrt(2.0), 1e-12, 0.0);
        assert_close(scales.part[1], mass * a * w / sqrt(2.0), 1e-2, 0.0);
        for (size_t j = 0; j < points; j++) data[2 * j + 1] = 0.25; /* only q changes */
        assert_ok(lg_hamiltonian_find_scales(&problem, &scales, NULL));
        assert_true(scales.time * w > 1.0 && scales.time * w < 1.1);
    }
}

/* ---- data without motion ---- */

TEST("without motion the scales are sizes of the state and the duration of a trajectory") {
    training s = make_training(&systems[2], (units){1e5, 1e-4, 1e3});
    s.problem.model = &s.model;
    for (size_t i = 0; i < N * M * s.d; i++) s.data[i] = s.data[i % s.d];
    lg_hamiltonian_scales scales;
    assert_ok(lg_hamiltonian_find_scales(&s.problem, &scales, NULL));
    assert_close(scales.time, s.problem.dt * (M - 1), 1e-14, 0.0);
    assert_close(scales.part[0], hypot(s.data[0], s.data[1]) / sqrt(2.0), 1e-13, 0.0);
    assert_close(scales.part[1], hypot(s.data[2], s.data[3]) / sqrt(2.0), 1e-13, 0.0);
    s.model.scales = scales;
    assert_ok(lg_hamiltonian_weigh(&s.problem, NULL));
    assert_true(s.problem.weight[0] == 1.0 && s.problem.weight[1] == 1.0);
    memset(s.data, 0, N * M * s.d * sizeof *s.data);
    assert_ok(lg_hamiltonian_find_scales(&s.problem, &scales, NULL));
    assert_true(scales.part[0] == 1.0 && scales.part[1] == 1.0);
}

TEST("without motion the scale of a line is the size of its numbers, or 1 if all are 0") {
    for (int zero = 0; zero < 2; zero++) {
        lg_hamiltonian model;
        lg_hamiltonian_scales scales;
        assert_ok(lg_hamiltonian_init(&model, &lg_hamiltonian_rotation_line, 1, LG_POTENTIAL_MLP, NULL, 0,
                                      LG_TANH));
        const size_t d = lg_hamiltonian_state_dim(&model);
        double *data = room(2 * d);
        for (size_t i = 0; i < 2 * d; i++) data[i] = zero ? 0.0 : 0.5;
        const lg_hamiltonian_problem problem = {
            .model = &model, .trajectories = 1, .points = 2, .dt = 0.1, .data = data};
        assert_ok(lg_hamiltonian_find_scales(&problem, &scales, NULL));
        assert_true(scales.time == 0.1 && scales.part[0] == 1.0);
        assert_close(scales.part[2], zero ? 1.0 : 0.5, 1e-15, 0.0);
        if (zero) continue;
        /* A motion that is too slow for a scale does not count. */
        for (size_t i = 0; i < 2; i++) {
            for (size_t k = 9; k < 12; k++) data[i * d + k] = 1e-200;
            data[i * d + 12] = i == 0 ? 1e-200 : 1.5e-200, data[i * d + 13] = 1e200;
        }
        assert_ok(lg_hamiltonian_find_scales(&problem, &scales, NULL));
        assert_close(scales.part[2], sqrt(0.5 * (1.0 + 1.5 * 1.5)) * 1e-200, 1e-14, 0.0);
    }
}

TEST("scales are found for sizes from 1e-307 to 1e307, and others are refused") {
    lg_hamiltonian_family bare = lg_hamiltonian_separable;
    bare.scaled[0] = bare.scaled[1] = false;
    const struct {
        const lg_hamiltonian_family *family;
        double q[2], p[2], dt; /* two points */
        lg_status status;
        double part[2];
    } found[] = {
        {&lg_hamiltonian_separable, {1, 3}, {2, 2}, 0.1, LG_OK, {sqrt(5), 2 * sqrt(5)}},
        {&lg_hamiltonian_separable, {1e-307, 1e-307}, {1e307, 1e307}, 0.1, LG_OK, {1e-307, 1e307}},
        {&lg_hamiltonian_separable, {1e-309, 1e-309}, {1e307, 1e307}, 0.1, LG_NOT_FINITE, {0}},
        {&lg_hamiltonian_separable, {1e-200, 1e-200}, {1e-200, 1e-200}, 0.1, LG_NOT_FINITE, {0}},
        {&lg_hamiltonian_separable, {1, 1}, {1, 1}, 1e-320, LG_NOT_FINITE, {0}},
        {&lg_hamiltonian_separable, {1, 3}, {0, 0}, 0.1, LG_OK, {sqrt(5), 1}}, /* moves without a momentum */
        {&bare, {1, 3}, {2, 4}, 0.1, LG_OK, {1, 1}},
    };
    for (size_t i = 0; i < LG_COUNT(found); i++) {
        lg_hamiltonian model;
        lg_hamiltonian_scales scales;
        const double data[] = {found[i].q[0], found[i].p[0], found[i].q[1], found[i].p[1]};
        assert_ok(lg_hamiltonian_init(&model, found[i].family, 1, LG_POTENTIAL_MLP, NULL, 0, LG_TANH));
        const lg_hamiltonian_problem problem = {
            .model = &model, .trajectories = 1, .points = 2, .dt = found[i].dt, .data = data};
        assert_status(lg_hamiltonian_find_scales(&problem, &scales, NULL), found[i].status);
        for (size_t k = 0; found[i].status == LG_OK && k < 2; k++)
            assert_close(scales.part[k], found[i].part[k], 1e-12, 0.0);
    }
}

TEST("sizes beyond the range of a scale are refused, and a problem without data too") {
    training s = make_training(&systems[2], (units){1.0, 1.0, 1e-200});
    lg_hamiltonian_scales scales = {2.0, {3.0, 4.0}};
    s.problem.model = &s.model;
    assert_status(lg_hamiltonian_find_scales(&s.problem, &scales, NULL), LG_NOT_FINITE);
    lg_hamiltonian_problem bad[5];
    for (size_t i = 0; i < LG_COUNT(bad); i++) bad[i] = s.problem;
    bad[0].data = NULL, bad[1].model = NULL, bad[2].trajectories = 0, bad[3].points = 1, bad[4].dt = NAN;
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        assert_status(lg_hamiltonian_find_scales(&bad[i], &scales, NULL), LG_INVALID_ARGUMENT);
        assert_status(lg_hamiltonian_weigh(&bad[i], NULL), LG_INVALID_ARGUMENT);
        assert_false(lg_hamiltonian_moves(&bad[i]));
    }
    assert_true(scales.time == 2.0 && scales.part[0] == 3.0 && scales.part[1] == 4.0);
}
