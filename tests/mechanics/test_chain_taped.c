/* The chains' fields on a tape, beyond what test_system_properties.c says of every system: float tapes, rows
 * that are not finite, inputs that depend on each other. */
#include "support/fixtures.h"
#include "system_check.h"

enum { MAX_LINKS = 4, BATCH = 3, MAX_DIM = 6 * MAX_LINKS, MAX_P = 1 + 2 * MAX_LINKS };

static const double masses[MAX_LINKS] = {1.0, 1.3, 0.7, 2.0}, lengths[MAX_LINKS] = {1.0, 0.8, 1.5, 0.6};

static lg_system *make(const char *form, size_t links) {
    return make_chain(form, links, 9.81, masses, lengths);
}

static void random_states(size_t links, double *y) {
    lg_rng rng;
    lg_rng_seed(&rng, 41, links);
    random_links(&rng, BATCH * links, y);
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
    assert_ok(lg_system_taped_ode(c->system, c->form, c->parameters, &c->ode, &c->user));
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

TEST("fields on a float tape are the plain ones") {
    for (size_t n = 0; n < 3; n++)
        for (size_t k = 1; k <= MAX_LINKS; k++) {
            lg_system *system = make(forms[n].form_name, k);
            const size_t d = lg_system_dim(system);
            double y[BATCH * MAX_DIM], got[BATCH * MAX_DIM], f[MAX_DIM], work[18 * MAX_LINKS];
            random_states(k, y);
            for (size_t i = 0; i < BATCH * d; i++) y[i] = (double)(float)y[i];
            taped_case c = {.tape = test_tape(LG_F32), .system = system, .form = forms[n].form};
            record(&c, y, lg_system_parameter_values(system));
            assert_ok(lg_read(c.tape, c.f, BATCH * d, got));
            lg_system_user user;
            lg_ode ode;
            assert_ok(lg_system_ode(system, c.form, &ode, &user, work));
            for (size_t b = 0; b < BATCH; b++) {
                assert_ok(ode.field(&user, 0.0, y + b * d, NULL, f));
                for (size_t i = 0; i < d; i++) assert_close(got[b * d + i], f[i], 2e-4, 2e-4);
            }
        }
}

TEST("the hand-written adjoint on a float tape is that of a double one") {
    lg_system *system = make("lagrangian", 3);
    double y[BATCH * 18], gy[BATCH * 18], gp[7];
    float fy[BATCH * 18], fp[7];
    void *const grad[2][2] = {{gy, gp}, {fy, fp}};
    random_states(3, y);
    for (int i = 0; i < BATCH * 18; i++) y[i] = (double)(float)y[i];
    for (int single = 0; single < 2; single++) {
        taped_case c = {
            .tape = test_tape(single ? LG_F32 : LG_F64), .system = system, .form = LG_COORDINATES_LIE};
        record(&c, y, lg_system_parameter_values(system));
        const lg_var wrt[2] = {c.y, c.parameters};
        assert_ok(lg_backward_set(c.tape, lg_sum(c.tape, c.f), wrt, 2, grad[single]));
    }
    for (int i = 0; i < BATCH * 18; i++) assert_close((double)fy[i], gy[i], 1e-3, 1e-3);
    for (int i = 0; i < 7; i++) assert_close((double)fp[i], gp[i], 1e-3, 1e-3);
}

TEST("NaN in one row is no error of the tape and stays in that row") {
    lg_system *system = make("lagrangian", 2);
    double y[BATCH * 12], f[BATCH * 12];
    random_states(2, y);
    y[12] = NAN;
    taped_case c = {.tape = test_tape(LG_F64), .system = system, .form = LG_COORDINATES_LIE};
    record(&c, y, lg_system_parameter_values(system));
    assert_ok(lg_read(c.tape, c.f, BATCH * 12, f));
    assert_true(isnan(f[12 + 3]));
    for (int i = 0; i < 12; i++) assert_true(isfinite(f[i]) && isfinite(f[24 + i]));
}

/* An input that depends on another one: q and omega are both made of x. Derivatives are partial inside, total
 * outside. */
TEST("inputs may depend on each other: derivatives are total outside") {
    lg_system *system = make("lagrangian", 2);
    lg_tape *t = test_tape(LG_F64);
    const double x0[6] = {0.6, 0.0, 0.8, 0.0, 1.0, 0.0};
    double recorded[6], swept[6];
    void *memory = swept;
    lg_system_taped_user user;
    lg_taped_ode ode;
    lg_var x = lg_input_f64(t, lg_shape3(1, 2, 3), x0), y[2] = {x, lg_square(t, lg_square(t, x))}, f[2], g;
    lg_var parameters = lg_input_f64(t, lg_shape1(5), lg_system_parameter_values(system));
    assert_ok(lg_system_taped_ode(system, LG_COORDINATES_LIE, parameters, &ode, &user));
    assert_ok(ode.field(ode.user, t, (lg_taped_time){0}, y, LG_NONE, f));
    lg_var S = lg_sum(t, lg_square(t, f[1]));
    assert_ok(lg_grad(t, S, &x, 1, &g));
    assert_ok(lg_read(t, g, 6, recorded));
    assert_ok(lg_backward_set(t, S, &x, 1, &memory));
    for (int i = 0; i < 6; i++) assert_close(recorded[i], swept[i], 1e-11, 1e-11);
}

TEST("forms that have no field on a tape are refused") {
    lg_system *system = make("hamiltonian", 1);
    lg_system_taped_user user;
    lg_taped_ode ode;
    assert_status(lg_system_taped_ode(system, LG_COORDINATES_AMBIENT, LG_NONE, &ode, &user), LG_UNSUPPORTED);
    assert_status(
        lg_system_taped_ode(system, (lg_coordinates)(LG_COORDINATES_AMBIENT + 1), LG_NONE, &ode, &user),
        LG_INVALID_ARGUMENT);
    assert_status(lg_system_taped_ode(NULL, LG_COORDINATES_LIE, LG_NONE, &ode, &user), LG_INVALID_ARGUMENT);
    assert_status(lg_system_taped_ode(system, LG_COORDINATES_LIE, LG_NONE, NULL, &user), LG_INVALID_ARGUMENT);
}
