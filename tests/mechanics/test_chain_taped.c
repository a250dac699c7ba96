/* The chains' fields on a tape: values against the plain ones, hand-written and recorded derivatives against
 * each other and against differences, in the state and in all parameters. */
#include "test_support.h"

#include "liegrad/geometry.h"
#include "liegrad/mechanics.h"
#include "liegrad/ops.h"

enum { MAX_LINKS = 4, BATCH = 3, MAX_DIM = 6 * MAX_LINKS, MAX_P = 1 + 2 * MAX_LINKS };

static const double masses[MAX_LINKS] = {1.0, 1.3, 0.7, 2.0}, lengths[MAX_LINKS] = {1.0, 0.8, 1.5, 0.6};

static lg_system *make(const char *form, size_t links) {
    const double gravity = 9.81;
    const lg_named_values given[] = {
        {"gravity", &gravity, 1}, {"masses", masses, links}, {"lengths", lengths, links}};
    lg_system *system = NULL;
    lg_system_options options;
    lg_system_options_init(&options);
    options.form = form;
    options.links = links;
    options.parameters = given;
    options.parameter_count = 3;
    assert_ok(lg_system_create(NULL, "pendulum-chain", &options, &system, NULL));
    return system;
}

static void random_states(size_t links, double *y) {
    lg_rng rng;
    lg_rng_seed(&rng, 41, links);
    for (size_t i = 0; i < BATCH * links; i++, y += 6) {
        double u[3];
        for (int c = 0; c < 3; c++) y[c] = lg_rng_normal(&rng), u[c] = lg_rng_uniform_in(&rng, -2.0, 2.0);
        const double norm = sqrt(lg_dot3(y, y));
        for (int c = 0; c < 3; c++) y[c] /= norm;
        lg_cross3(y, u, y + 3);
    }
}

static lg_tape *new_tape(lg_dtype dtype) {
    lg_tape *tape = NULL;
    lg_tape_options options;
    lg_tape_options_init(&options);
    options.dtype = dtype;
    assert_ok(lg_tape_create(NULL, &options, &tape));
    return tape;
}

typedef struct taped_case {
    lg_tape *tape;
    const lg_system *system;
    lg_coordinates form;
    lg_var y, parameters; /* (B, dim), (P) */
    lg_var f;             /* (B, dim) */
    lg_system_taped_user user;
    lg_taped_ode ode;
} taped_case;

/* f as (B, dim) in the order of the state, from states and parameters. */
static void record(taped_case *c, const double *y, const double *parameters) {
    lg_var parts[2], algebra[2];
    const uint32_t d = (uint32_t)lg_system_dim(c->system);
    c->y = lg_input_f64(c->tape, lg_shape2(BATCH, d), y);
    c->parameters =
        lg_input_f64(c->tape, lg_shape1((uint32_t)lg_system_parameter_count(c->system)), parameters);
    assert_ok(lg_system_taped_ode(c->system, c->form, c->parameters, &c->user, &c->ode));
    if (c->form == LG_COORDINATES_AMBIENT) {
        assert_ok(c->ode.field(c->ode.user, c->tape, (lg_taped_time){0}, &c->y, LG_NONE, &c->f));
        return;
    }
    assert_ok(lg_taped_split(c->tape, &c->ode.space, c->y, parts));
    assert_ok(c->ode.field(c->ode.user, c->tape, (lg_taped_time){0}, parts, LG_NONE, algebra));
    c->f = lg_taped_join(c->tape, &c->ode.space, algebra);
    assert_ok(lg_tape_status(c->tape));
}

static const struct {
    const char *form_name;
    lg_coordinates form;
} forms[] = {{"lagrangian", LG_COORDINATES_LIE},
             {"lagrangian", LG_COORDINATES_AMBIENT},
             {"hamiltonian", LG_COORDINATES_LIE}};

TEST("values") {
    for (size_t n = 0; n < 6; n++)
        for (size_t k = 1; k <= MAX_LINKS; k++) {
            const bool single = n >= 3;
            lg_system *system = make(forms[n % 3].form_name, k);
            const size_t d = lg_system_dim(system);
            double y[BATCH * MAX_DIM], got[BATCH * MAX_DIM], f[MAX_DIM], work[18 * MAX_LINKS];
            random_states(k, y);
            for (size_t i = 0; single && i < BATCH * d; i++) y[i] = (double)(float)y[i];
            taped_case c = {
                .tape = new_tape(single ? LG_F32 : LG_F64), .system = system, .form = forms[n % 3].form};
            record(&c, y, lg_system_parameter_values(system));
            assert_ok(lg_read(c.tape, c.f, got, BATCH * d));
            lg_system_user user;
            lg_ode ode;
            assert_ok(lg_system_ode(system, c.form, &user, work, &ode));
            for (size_t b = 0; b < BATCH; b++) {
                assert_ok(ode.field(&user, 0.0, y + b * d, NULL, f));
                for (size_t i = 0; i < d; i++)
                    assert_close(got[b * d + i], f[i], single ? 2e-4 : 1e-12, single ? 2e-4 : 1e-12);
            }
            lg_tape_destroy(c.tape);
            lg_system_destroy(NULL, system);
        }
}

/* S(y, parameters) = sum of weights times f, and its gradients by the unrecorded sweep. */
static double weighted(const lg_system *system, lg_coordinates form, const double *y,
                       const double *parameters, const double *weights, double *gy, double *gp) {
    const uint32_t d = (uint32_t)lg_system_dim(system);
    taped_case c = {.tape = new_tape(LG_F64), .system = system, .form = form};
    record(&c, y, parameters);
    lg_var w = lg_input_f64(c.tape, lg_shape2(BATCH, d), weights), wrt[2] = {c.y, c.parameters};
    lg_var S = lg_sum(c.tape, lg_mul(c.tape, w, c.f));
    void *const grad[2] = {gy, gp};
    double value;
    assert_ok(lg_read(c.tape, S, &value, 1));
    if (gy) assert_ok(lg_backward_set(c.tape, S, wrt, 2, grad));
    lg_tape_destroy(c.tape);
    return value;
}

/* Fourth-order difference quotient weights at -2, -1, 1, 2. */
static const double stencil[4][2] = {{-2, 1.0 / 12}, {-1, -2.0 / 3}, {1, 2.0 / 3}, {2, -1.0 / 12}};
#define DELTA 1e-3

TEST("first derivatives") {
    for (size_t n = 0; n < 3; n++)
        for (size_t k = 1; k <= MAX_LINKS; k++) {
            lg_system *system = make(forms[n].form_name, k);
            const size_t d = lg_system_dim(system), p = lg_system_parameter_count(system);
            double y[BATCH * MAX_DIM], w[BATCH * MAX_DIM], gy[BATCH * MAX_DIM], gp[MAX_P], x[BATCH * MAX_DIM],
                q[MAX_P];
            lg_rng rng;
            lg_rng_seed(&rng, 42, k);
            random_states(k, y);
            for (size_t i = 0; i < BATCH * d; i++) w[i] = lg_rng_uniform_in(&rng, -1.0, 1.0);
            (void)weighted(system, forms[n].form, y, lg_system_parameter_values(system), w, gy, gp);
            for (size_t j = 0; j < BATCH * d + p; j++) {
                double quotient = 0.0;
                for (int s = 0; s < 4; s++) {
                    memcpy(x, y, sizeof(x));
                    memcpy(q, lg_system_parameter_values(system), p * sizeof(*q));
                    *(j < BATCH * d ? &x[j] : &q[j - BATCH * d]) += DELTA * stencil[s][0];
                    quotient += stencil[s][1] / DELTA * weighted(system, forms[n].form, x, q, w, NULL, NULL);
                }
                assert_close(j < BATCH * d ? gy[j] : gp[j - BATCH * d], quotient, 1e-7, 1e-7);
            }
            lg_system_destroy(NULL, system);
        }
}

/* Recorded derivatives are the hand-written ones; forward and reverse mode agree; so do second derivatives,
 * of the recorded gradient by the unrecorded sweep, and of forward mode. */
TEST("second derivatives") {
    for (size_t n = 0; n < 3; n++)
        for (size_t k = 1; k <= MAX_LINKS; k++) {
            lg_system *system = make(forms[n].form_name, k);
            const uint32_t d = (uint32_t)lg_system_dim(system),
                           p = (uint32_t)lg_system_parameter_count(system);
            const double *parameters = lg_system_parameter_values(system);
            double y[BATCH * MAX_DIM], w[BATCH * MAX_DIM], a[BATCH * MAX_DIM], b[MAX_P], gy[BATCH * MAX_DIM],
                gp[MAX_P], got[BATCH * MAX_DIM];
            lg_rng rng;
            lg_rng_seed(&rng, 43, k);
            random_states(k, y);
            for (size_t i = 0; i < BATCH * d; i++) {
                w[i] = lg_rng_uniform_in(&rng, -1.0, 1.0);
                a[i] = lg_rng_uniform_in(&rng, -1.0, 1.0);
            }
            for (size_t i = 0; i < p; i++) b[i] = lg_rng_uniform_in(&rng, -1.0, 1.0);
            (void)weighted(system, forms[n].form, y, parameters, w, gy, gp);

            taped_case c = {.tape = new_tape(LG_F64), .system = system, .form = forms[n].form};
            record(&c, y, parameters);
            lg_tape *t = c.tape;
            lg_var wrt[2] = {c.y, c.parameters}, g[2], moved;
            lg_var direction[2] = {lg_input_f64(t, lg_shape2(BATCH, d), a), lg_input_f64(t, lg_shape1(p), b)};
            lg_var weights = lg_input_f64(t, lg_shape2(BATCH, d), w), S = lg_sum(t, lg_mul(t, weights, c.f));
            assert_ok(lg_grad(t, S, wrt, 2, g));
            assert_ok(lg_read(t, g[0], got, BATCH * d));
            for (size_t i = 0; i < BATCH * d; i++) assert_close(got[i], gy[i], 1e-11, 1e-11);
            assert_ok(lg_read(t, g[1], got, p));
            for (size_t i = 0; i < p; i++) assert_close(got[i], gp[i], 1e-11, 1e-11);

            double along = 0.0, forward;
            for (size_t i = 0; i < BATCH * d; i++) along += gy[i] * a[i];
            for (size_t i = 0; i < p; i++) along += gp[i] * b[i];
            assert_ok(lg_jvp(t, &S, 1, wrt, direction, 2, &moved));
            assert_ok(lg_read(t, moved, &forward, 1));
            assert_close(forward, along, 1e-11, 1e-11);

            /* grad(<grad S, a>) three ways: reverse over reverse, reverse over forward, forward over reverse
             */
            lg_var inner =
                lg_add(t, lg_sum(t, lg_mul(t, g[0], direction[0])), lg_sum(t, lg_mul(t, g[1], direction[1])));
            double hy[2][BATCH * MAX_DIM], hp[2][MAX_P];
            void *first[2] = {hy[0], hp[0]}, *second[2] = {hy[1], hp[1]};
            assert_ok(lg_backward_set(t, inner, wrt, 2, first));
            assert_ok(lg_backward_set(t, moved, wrt, 2, second));
            lg_var pushed[2];
            assert_ok(lg_jvp(t, g, 2, wrt, direction, 2, pushed));
            assert_ok(lg_read(t, pushed[0], got, BATCH * d));
            for (size_t i = 0; i < BATCH * d; i++) {
                assert_close(hy[0][i], hy[1][i], 1e-9, 1e-9);
                assert_close(hy[0][i], got[i], 1e-9, 1e-9);
            }
            assert_ok(lg_read(t, pushed[1], got, p));
            for (size_t i = 0; i < p; i++) {
                assert_close(hp[0][i], hp[1][i], 1e-9, 1e-9);
                assert_close(hp[0][i], got[i], 1e-9, 1e-9);
            }
            /* Against differences of the hand-written gradient along the direction. */
            double quotient[BATCH * MAX_DIM] = {0}, quotient_p[MAX_P] = {0};
            for (int s = 0; s < 4; s++) {
                double x[BATCH * MAX_DIM], q[MAX_P];
                for (size_t i = 0; i < BATCH * d; i++) x[i] = y[i] + DELTA * stencil[s][0] * a[i];
                for (size_t i = 0; i < p; i++) q[i] = parameters[i] + DELTA * stencil[s][0] * b[i];
                (void)weighted(system, forms[n].form, x, q, w, gy, gp);
                for (size_t i = 0; i < BATCH * d; i++) quotient[i] += stencil[s][1] / DELTA * gy[i];
                for (size_t i = 0; i < p; i++) quotient_p[i] += stencil[s][1] / DELTA * gp[i];
            }
            for (size_t i = 0; i < BATCH * d; i++) assert_close(hy[0][i], quotient[i], 1e-6, 1e-6);
            for (size_t i = 0; i < p; i++) assert_close(hp[0][i], quotient_p[i], 1e-6, 1e-6);

            /* Third: forward over forward over reverse is there. */
            lg_var twice, again;
            assert_ok(lg_jvp(t, &moved, 1, wrt, direction, 2, &twice));
            assert_ok(lg_jvp(t, &twice, 1, wrt, direction, 2, &again));
            lg_tape_destroy(t);
            lg_system_destroy(NULL, system);
        }
}

TEST("the hand-written adjoint on a float tape") {
    lg_system *system = make("lagrangian", 3);
    double y[BATCH * 18], w[BATCH * 18], gy[BATCH * 18], gp[7];
    float fy[BATCH * 18], fp[7];
    void *const grad[2] = {fy, fp};
    random_states(3, y);
    for (int i = 0; i < BATCH * 18; i++) y[i] = (double)(float)y[i], w[i] = 1.0;
    (void)weighted(system, LG_COORDINATES_LIE, y, lg_system_parameter_values(system), w, gy, gp);
    taped_case c = {.tape = new_tape(LG_F32), .system = system, .form = LG_COORDINATES_LIE};
    record(&c, y, lg_system_parameter_values(system));
    lg_var wrt[2] = {c.y, c.parameters};
    assert_ok(lg_backward_set(c.tape, lg_sum(c.tape, c.f), wrt, 2, grad));
    for (int i = 0; i < BATCH * 18; i++) assert_close((double)fy[i], gy[i], 1e-3, 1e-3);
    for (int i = 0; i < 7; i++) assert_close((double)fp[i], gp[i], 1e-3, 1e-3);
    lg_tape_destroy(c.tape);
    lg_system_destroy(NULL, system);
}

TEST("NaN in one row is no error of the tape and stays in that row") {
    lg_system *system = make("lagrangian", 2);
    double y[BATCH * 12], f[BATCH * 12];
    random_states(2, y);
    y[12] = NAN;
    taped_case c = {.tape = new_tape(LG_F64), .system = system, .form = LG_COORDINATES_LIE};
    record(&c, y, lg_system_parameter_values(system));
    assert_ok(lg_read(c.tape, c.f, f, BATCH * 12));
    assert_true(isnan(f[12 + 3]));
    for (int i = 0; i < 12; i++) assert_true(isfinite(f[i]) && isfinite(f[24 + i]));
    lg_tape_destroy(c.tape);
    lg_system_destroy(NULL, system);
}

/* An input that depends on another one: q and omega are both made of x. Derivatives are partial inside, total
 * outside. */
TEST("dependent inputs") {
    lg_system *system = make("lagrangian", 2);
    lg_tape *t = new_tape(LG_F64);
    const double x0[6] = {0.6, 0.0, 0.8, 0.0, 1.0, 0.0};
    double recorded[6], swept[6];
    void *memory = swept;
    lg_system_taped_user user;
    lg_taped_ode ode;
    lg_var x = lg_input_f64(t, lg_shape3(1, 2, 3), x0), y[2] = {x, lg_square(t, lg_square(t, x))}, f[2], g;
    lg_var parameters = lg_input_f64(t, lg_shape1(5), lg_system_parameter_values(system));
    assert_ok(lg_system_taped_ode(system, LG_COORDINATES_LIE, parameters, &user, &ode));
    assert_ok(ode.field(ode.user, t, (lg_taped_time){0}, y, LG_NONE, f));
    lg_var S = lg_sum(t, lg_square(t, f[1]));
    assert_ok(lg_grad(t, S, &x, 1, &g));
    assert_ok(lg_read(t, g, recorded, 6));
    assert_ok(lg_backward_set(t, S, &x, 1, &memory));
    for (int i = 0; i < 6; i++) assert_close(recorded[i], swept[i], 1e-11, 1e-11);
    lg_tape_destroy(t);
    lg_system_destroy(NULL, system);
}

TEST("refused") {
    lg_system *system = make("hamiltonian", 1);
    lg_system_taped_user user;
    lg_taped_ode ode;
    assert_status(lg_system_taped_ode(system, LG_COORDINATES_AMBIENT, LG_NONE, &user, &ode), LG_UNSUPPORTED);
    assert_status(
        lg_system_taped_ode(system, (lg_coordinates)(LG_COORDINATES_AMBIENT + 1), LG_NONE, &user, &ode),
        LG_INVALID_ARGUMENT);
    assert_status(lg_system_taped_ode(NULL, LG_COORDINATES_LIE, LG_NONE, &user, &ode), LG_INVALID_ARGUMENT);
    assert_status(lg_system_taped_ode(system, LG_COORDINATES_LIE, LG_NONE, &user, NULL), LG_INVALID_ARGUMENT);
    lg_system_destroy(NULL, system);
}

TEST("Oscillators: the whole field and its halves are the plain ones") {
    static const char *const names[] = {"oscillator", "quartic", "coupled-oscillators"};
    for (size_t n = 0; n < 3; n++) {
        const double y0[4] = {0.4, -0.7, 0.3, 0.6};
        lg_system *system = NULL;
        lg_tape *t = new_tape(LG_F64);
        double work[1], f[4], half[2], got[4];
        lg_system_user plain_user;
        lg_system_taped_user user;
        lg_taped_ode ode;
        lg_ode plain;
        assert_ok(lg_system_create(NULL, names[n], NULL, &system, NULL));
        const uint32_t d = (uint32_t)lg_system_dim(system), h = d / 2;
        lg_var y = lg_input_f64(t, lg_shape2(1, d), y0), out;
        assert_ok(lg_system_ode(system, LG_COORDINATES_AMBIENT, &plain_user, work, &plain));
        for (int form = 0; form < 2; form++) {
            assert_ok(lg_system_taped_ode(system, (lg_coordinates)form, LG_NONE, &user, &ode));
            assert_ok(ode.field(ode.user, t, (lg_taped_time){0}, &y, LG_NONE, &out));
            assert_ok(lg_read(t, out, got, d));
            assert_ok(plain.field(&plain_user, 0.0, y0, NULL, f));
            for (size_t i = 0; i < d; i++) assert_close(got[i], f[i], 1e-15, 0.0);
        }
        assert_ok(ode.force(ode.user, t, (lg_taped_time){0}, lg_slice(t, y, 1, 0, h), LG_NONE, &out));
        assert_ok(lg_read(t, out, got, h));
        assert_ok(plain.force(&plain_user, 0.0, y0, NULL, half));
        for (size_t i = 0; i < h; i++) assert_close(got[i], half[i], 1e-15, 0.0);
        assert_ok(ode.velocity(ode.user, t, (lg_taped_time){0}, lg_slice(t, y, 1, h, h), LG_NONE, &out));
        assert_ok(lg_read(t, out, got, h));
        assert_ok(plain.velocity(&plain_user, 0.0, y0 + h, NULL, half));
        for (size_t i = 0; i < h; i++) assert_close(got[i], half[i], 1e-15, 0.0);
        lg_tape_destroy(t);
        lg_system_destroy(NULL, system);
    }
}
