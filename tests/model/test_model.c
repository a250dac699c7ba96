/* Models through lg_model: one type for all kinds; the field of a learned Hamiltonian with inputs, its steps,
 * and its linearisation compared with differences on the manifold and with closed forms. */
#include "support/model_support.h"

#include "liegrad/geometry.h"
#include "model/internal.h"

/* ---- value and derivative ---- */

TEST("a model has the sizes of its kind") {
    static const size_t sizes[LG_SURROGATE_KIND_COUNT][2] = {{8, 20}, {9, 2}, {9, 1}};
    for (size_t i = 0; i < motions(); i++) {
        const moving s = make_motion(i, LG_POTENTIAL_MLP, LG_TANH);
        const lg_hamiltonian_family *row = s.b.hamiltonian.family;
        assert_int_equal(s.d, space_of(&s.b).dim);
        assert_int_equal(lg_model_outputs(s.b.model), 1);
        assert_int_equal(lg_model_parameters(s.b.model), lg_hamiltonian_parameters(&s.b.hamiltonian));
        assert_int_equal(s.m, s.n * row->forces);
        assert_int_equal(s.r, space_of(&s.b).tangent_dim);
    }
    for (int kind = 0; kind < LG_SURROGATE_KIND_COUNT; kind++) {
        const built b = build_surrogate((lg_surrogate_kind)kind);
        assert_int_equal(lg_model_inputs(b.model), sizes[kind][0]);
        assert_int_equal(lg_model_outputs(b.model), sizes[kind][1]);
        assert_int_equal(lg_model_parameters(b.model), lg_surrogate_parameters(&b.surrogate));
    }
    const built b = build_detector(LG_SWISH);
    assert_true(lg_model_inputs(b.model) == 120 && lg_model_outputs(b.model) == 3);
    assert_int_equal(lg_model_parameters(b.model), lg_cnn_parameters(&b.detector.net));
}

TEST("of these kinds only Hamiltonians have fields, steps and a linearisation") {
    for (int which = 0; which < 2; which++) {
        built b = which == 0 ? build_surrogate(LG_SURROGATE_DISCRETE) : build_detector(LG_SWISH);
        const lg_model *m = b.model;
        const lg_scheme *cf4 = lg_scheme_find("cf4");
        lg_model_user user = {NULL, NULL};
        lg_ode ode = {.user = &b};
        lg_stepper *stepper = NULL;
        double numbers[300] = {0};
        assert_int_equal(lg_model_input_dim(m), 0);
        assert_int_equal(lg_model_tangent_dim(m), 0);
        assert_int_equal(lg_model_stepper_size(m, cf4), 0);
        assert_status(lg_model_field(m, numbers, NULL, numbers + 150, b.work), LG_UNSUPPORTED);
        assert_status(lg_model_ode(m, &ode, &user, b.work), LG_UNSUPPORTED);
        assert_true(user.model == NULL && ode.user == &b);
        assert_status(lg_model_stepper_init(m, cf4, &stepper, b.work, 1 << 20), LG_UNSUPPORTED);
        assert_null(stepper);
        assert_status(lg_model_linearise(m, numbers, NULL, numbers, numbers, numbers, b.work),
                      LG_UNSUPPORTED);
        assert_status(lg_model_deviation(m, numbers, numbers, numbers, b.work), LG_UNSUPPORTED);
    }
    assert_int_equal(lg_model_work_size(NULL) + lg_model_input_dim(NULL) + lg_model_tangent_dim(NULL), 0);
}

/* ---- the field ---- */

static void velocity(const built *b, const double *y, const double *input, double *out) {
    model_velocity(b->model, y, input, out, b->work);
}

/* The same system with a field computed here from the gradient. */
typedef struct by_hand {
    const built *b;
} by_hand;

/* Whether hand_field supports the family. */
static bool is_by_hand(const built *b) {
    return is_chain(b) || b->hamiltonian.family == &lg_hamiltonian_separable;
}

static lg_status hand_field(void *user, double t, const double *y, const double *input, double *out) {
    const built *b = ((const by_hand *)user)->b;
    const size_t n = b->hamiltonian.n;
    double dH[MOST_STATE];
    (void)t;
    lg_model_jacobian(b->model, y, NULL, dH, b->work);
    for (size_t i = 0; i < n && !is_chain(b); i++) {
        out[i] = dH[n + i];
        out[n + i] = -dH[i] + (input != NULL ? input[i] : 0.0);
    }
    for (size_t i = 0; i < 6 * n && is_chain(b); i += 6) {
        double gq[3], vp[3];
        lg_cross3(y + i, dH + i + 3, out + i);
        lg_cross3(dH + i, y + i, gq);
        lg_cross3(dH + i + 3, y + i + 3, vp);
        for (size_t c = 0; c < 3; c++)
            out[i + 3 + c] = gq[c] + vp[c] + (input != NULL ? input[i / 2 + c] : 0.0);
    }
    return LG_OK;
}

static lg_status hand_half(const by_hand *self, size_t at, const double *half, size_t wanted, double *out) {
    const size_t n = self->b->hamiltonian.n;
    double y[MOST_STATE] = {0}, field[MOST_STATE];
    memcpy(y + at, half, n * sizeof *y);
    (void)hand_field((void *)(uintptr_t)self, 0.0, y, NULL, field);
    memcpy(out, field + wanted, n * sizeof *out);
    return LG_OK;
}

static lg_status hand_force(void *user, double t, const double *q, const double *input, double *out) {
    const by_hand *self = user;
    const size_t n = self->b->hamiltonian.n;
    (void)t;
    const lg_status status = hand_half(self, 0, q, n, out);
    for (size_t i = 0; input != NULL && i < n; i++) out[i] += input[i];
    return status;
}

static lg_status hand_velocity(void *user, double t, const double *p, const double *input, double *out) {
    (void)t, (void)input;
    const by_hand *self = user;
    return hand_half(self, self->b->hamiltonian.n, p, 0, out);
}

/* q' must be the same as without an input. p_i' must have the additional term tau_i x q_i, or u. */
TEST("the field agrees with one computed from the gradient, and inputs push the momenta") {
    for (size_t i = 0; i < motions(); i++) {
        const moving s = make_motion(i, LG_POTENTIAL_MLP, LG_SWISH);
        const double zero[MOST_INPUT] = {0};
        double free_run[MOST_STATE], none[MOST_STATE], driven[MOST_STATE], field[MOST_STATE],
            expected[MOST_STATE];
        if (!is_by_hand(&s.b)) continue;
        assert_ok(lg_model_field(s.b.model, s.y, NULL, field, s.b.work));
        hand_field(&(by_hand){&s.b}, 0.0, s.y, NULL, expected);
        for (size_t j = 0; j < s.d; j++) assert_close(field[j], expected[j], 1e-13, 1e-13);
        velocity(&s.b, s.y, NULL, free_run);
        velocity(&s.b, s.y, zero, none);
        velocity(&s.b, s.y, s.u, driven);
        assert_memory_equal(free_run, none, s.d * sizeof *none);
        for (size_t j = 0; j < s.d; j++) {
            const size_t link = is_chain(&s.b) ? j / 6 : 0, at = is_chain(&s.b) ? j % 6 : j;
            double push[3] = {0};
            if (is_chain(&s.b)) lg_cross3(s.u + 3 * link, s.y + 6 * link, push);
            const bool momentum = at >= (is_chain(&s.b) ? 3 : s.n);
            const double more = !momentum ? 0.0 : is_chain(&s.b) ? push[at - 3] : s.u[at - s.n];
            assert_close(driven[j] - free_run[j], more, 1e-12, 1e-12);
        }
    }
}

TEST("without an input the fields of all families keep the energy, and inputs do work") {
    for (size_t i = 0; i < motions(); i++) {
        const moving s = make_motion(i, LG_POTENTIAL_MLP, LG_SWISH);
        double dy[MOST_STATE], driven[MOST_STATE], dH[MOST_STATE], power = 0.0, size = 0.0, given = 0.0;
        velocity(&s.b, s.y, NULL, dy);
        velocity(&s.b, s.y, s.u, driven);
        lg_model_jacobian(s.b.model, s.y, NULL, dH, s.b.work);
        for (size_t j = 0; j < s.d; j++) power += dH[j] * dy[j], size += fabs(dH[j] * dy[j]);
        for (size_t j = 0; j < s.d; j++) given += dH[j] * driven[j];
        assert_true(size > 1e-9);
        assert_close(power, 0.0, 0.0, 1e-14 * size);
        if (!is_by_hand(&s.b)) continue;
        double work = 0.0; /* tau.omega with omega = q x v, or u.dH/dp */
        for (size_t j = 0; j < s.n; j++) {
            double omega[3];
            if (is_chain(&s.b)) lg_cross3(s.y + 6 * j, dH + 6 * j + 3, omega);
            work += is_chain(&s.b) ? lg_dot3(s.u + 3 * j, omega) : s.u[j] * dH[s.n + j];
        }
        assert_true(fabs(work) > 1e-3);
        assert_close(given, work, 1e-12, 1e-12);
    }
}

/* ---- linearisation ---- */

/* The tangent frame e_1, e_2 at q, as the comment before lg_space_basis defines it. */
static void expected_frame(const double *q, double *e1, double *e2) {
    size_t least = 0;
    for (size_t c = 1; c < 3; c++)
        if (fabs(q[c]) < fabs(q[least])) least = c;
    double axis[3] = {0.0};
    axis[least] = 1.0;
    const double along = lg_dot3(axis, q);
    for (size_t c = 0; c < 3; c++) e1[c] = axis[c] - along * q[c];
    const double length = sqrt(lg_dot3(e1, e1));
    for (size_t c = 0; c < 3; c++) e1[c] /= length;
    lg_cross3(q, e1, e2);
}

/* For each link the columns must be e_1, e_2 of q, then of p. */
static void check_frame(const built *b, const double *y) {
    const size_t r = lg_model_tangent_dim(b->model);
    const lg_space space = space_of(b);
    double basis[MOST_STATE * MOST_TANGENT], e[2][3];
    lg_space_basis(&space, y, basis);
    for (size_t column = 0; is_chain(b) && column < r; column++) {
        const size_t at = column / 4 * 6, j = column % 4;
        double dq[3], dp[3];
        for (size_t c = 0; c < 3; c++)
            dq[c] = basis[(at + c) * r + column], dp[c] = basis[(at + 3 + c) * r + column];
        expected_frame(y + at, e[0], e[1]);
        for (size_t k = 0; k < 2; k++) {
            assert_close(lg_dot3(e[k], dq), k == j ? 1.0 : 0.0, 0.0, 1e-15);
            assert_close(lg_dot3(e[k], dp), k + 2 == j ? 1.0 : 0.0, 0.0, 1e-15);
        }
    }
}

/* Special cases of a random state; the tangent part of p is kept. */
enum { AS_IT_IS, AT_REST, UP, DOWN, NEAR_AXES, ON_AXES_AT_REST, SPECIAL };

static void place_link(int what, size_t link, double *q) {
    const size_t axis = what == UP || what == DOWN ? 2 : link % 3;
    for (size_t c = 0; c < 3; c++) q[c] = what == NEAR_AXES ? 1e-9 * (double)(c + 1) : 0.0;
    q[axis] = what == DOWN ? -1.0 : 1.0;
}

static void make_special(const built *b, int what, double *y) {
    const lg_space space = space_of(b);
    const size_t links = b->hamiltonian.n;
    const bool rest = what == AT_REST || what == ON_AXES_AT_REST;
    for (size_t i = 0; is_chain(b) && i < links; i++) {
        if (what >= UP) place_link(what, i, y + 6 * i);
        for (size_t c = 3; rest && c < 6; c++) y[6 * i + c] = 0.0;
    }
    for (size_t i = 0; !is_chain(b) && rest && i < links; i++) y[links + i] = 0.0;
    lg_space_project(&space, y);
}

TEST("linearisations agree with differences of the field along the manifold and in the input") {
    for (size_t i = 0; i < motions(); i++)
        for (int potential = 0; potential < LG_POTENTIAL_KIND_COUNT; potential++)
            for (int what = 0; what < SPECIAL; what++) {
                moving s = make_motion(i, (lg_potential_kind)potential, LG_TANH);
                make_special(&s.b, what, s.y);
                check_frame(&s.b, s.y);
                check_linearisation(s.b.model, s.y, NULL, 1e-7, s.b.work);
                check_linearisation(s.b.model, s.y, s.u, 1e-7, s.b.work);
            }
}

TEST("at its equilibria the linearisation of a pendulum agrees with the closed form") {
    const double m = 0.7, c = 2.3;
    const built b = build_pendulum(m, c);
    for (int sign = -1; sign <= 1; sign += 2) {
        const double y[6] = {0.0, 0.0, sign, 0.0, 0.0, 0.0};
        double A[16], B[12], square[16] = {0};
        assert_ok(lg_model_linearise(b.model, y, NULL, A, B, NULL, b.work));
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++) {
                const double expected = j == i + 2 ? 1.0 / m : i == j + 2 ? sign * c : 0.0;
                assert_close(A[4 * i + j], expected, 1e-14, 1e-15);
                for (int l = 0; l < 4; l++) square[4 * i + j] += A[4 * i + l] * A[4 * l + j];
            }
        for (int i = 0; i < 16; i++) assert_close(square[i], i % 5 == 0 ? sign * c / m : 0.0, 1e-14, 1e-14);
        /* e_1 = (1, 0, 0), e_2 = (0, sign, 0): a torque about y pushes along sign * x, a torque about x along
         * -y. */
        const double expected_B[12] = {0, 0, 0, 0, 0, 0, 0, sign, 0, -1, 0, 0};
        for (int i = 0; i < 12; i++) assert_close(B[i], expected_B[i], 0.0, 1e-15);
    }
}

TEST("a small swing about the hanging position is a sum of cosines") {
    const double m = 0.7, c = 2.3, h = 0.01, eps = 1e-5, omega = sqrt(c / m);
    const double rest[6] = {0.0, 0.0, -1.0, 0.0, 0.0, 0.0}, start[4] = {1.0, -0.5, 0.2, 0.8};
    const built b = build_pendulum(m, c);
    double y[6], basis[24], found[4];
    lg_stepper *stepper = stepper_of(&b, lg_scheme_find("cf4"));
    assert_ok(lg_model_linearise(b.model, rest, NULL, NULL, NULL, basis, b.work));
    memcpy(y, rest, sizeof y);
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 4; j++) y[i] += eps * basis[4 * i + j] * start[j];
    const lg_space space = space_of(&b);
    lg_space_project(&space, y);
    for (int n = 1; n <= 300; n++) {
        assert_ok(lg_stepper_step(stepper, 0.0, h, y, NULL, y));
        assert_ok(lg_model_deviation(b.model, rest, y, found, b.work));
        const double t = n * h;
        for (int j = 0; j < 2; j++) {
            const double a = start[j] * cos(omega * t) + start[2 + j] / (m * omega) * sin(omega * t);
            const double p = start[2 + j] * cos(omega * t) - start[j] * m * omega * sin(omega * t);
            assert_close(found[j] / eps, a, 0.0, 1e-8);
            assert_close(found[2 + j] / eps, p, 0.0, 1e-8);
        }
    }
}

TEST("y + basis c has the coordinates c") {
    for (size_t i = 0; i < motions(); i++) {
        const moving s = make_motion(i, LG_POTENTIAL_MLP, LG_TANH);
        double other[MOST_STATE], basis[MOST_STATE * MOST_TANGENT], c[MOST_TANGENT], found[MOST_TANGENT];
        assert_ok(lg_model_linearise(s.b.model, s.y, NULL, NULL, NULL, basis, s.b.work));
        for (size_t j = 0; j < s.r; j++) c[j] = sin(1.0 + (double)j);
        for (size_t k = 0; k < s.d; k++) {
            other[k] = s.y[k];
            for (size_t j = 0; j < s.r; j++) other[k] += basis[k * s.r + j] * c[j];
        }
        assert_ok(lg_model_deviation(s.b.model, s.y, other, found, s.b.work));
        for (size_t j = 0; j < s.r; j++) assert_close(found[j], c[j], 1e-13, 1e-14);
        assert_ok(lg_model_deviation(s.b.model, s.y, s.y, found, s.b.work));
        for (size_t j = 0; j < s.r; j++) assert_close(found[j], 0.0, 0.0, 0.0);
    }
}

/* ---- steps ---- */

static void check_scheme(const moving *s, const lg_scheme *scheme) {
    by_hand self = {&s->b};
    lg_ode ode = {.space = space_of(&s->b), .field = hand_field, .user = &self};
    if (!is_chain(&s->b)) {
        ode.force = hand_force, ode.velocity = hand_velocity;
        assert_ok(lg_space_init_rn(&ode.space, s->d));
    }
    lg_stepper *by_model = stepper_of(&s->b, scheme), *expected_stepper = test_stepper(scheme, &ode);
    double y[MOST_STATE], expected[MOST_STATE];
    memcpy(y, s->y, sizeof y);
    memcpy(expected, s->y, sizeof y);
    for (int n = 0; n < 5; n++) { /* alternately with and without the input */
        const double *u = n % 2 == 0 ? s->u : NULL;
        assert_ok(lg_stepper_step(by_model, 0.0, 0.02, y, u, y)); /* in place */
        assert_ok(lg_stepper_step(expected_stepper, 0.0, 0.02, expected, u, expected));
        for (size_t i = 0; i < s->d; i++) assert_close(y[i], expected[i], 1e-13, 1e-13);
        assert_true(lg_space_manifold_error(&ode.space, y) <= 1e-14);
    }
}

/* Whether the scheme can step the model: it stays on the manifold; on R^d it must not be made for groups
 * alone. */
static bool fits(const built *b, const lg_scheme *scheme) {
    if (scheme->kind == LG_SCHEME_VARIATIONAL || scheme->kind == LG_SCHEME_SLGI) return false;
    const lg_space space = space_of(b);
    if (scheme->kind == LG_SCHEME_SPLITTING) return b->hamiltonian.family->drift != NULL;
    return lg_space_is_abelian(&space) || !scheme->ambient;
}

TEST("every scheme steps as with the field computed here and stays on the manifold, or is refused") {
    for (size_t i = 0; i < motions() * lg_scheme_count(); i++) {
        const moving s = make_motion(i % motions(), LG_POTENTIAL_MLP, LG_SINE);
        const lg_scheme *scheme = lg_scheme_at(i / motions());
        lg_stepper *stepper = NULL;
        if (fits(&s.b, scheme)) {
            if (is_by_hand(&s.b)) check_scheme(&s, scheme);
            continue;
        }
        assert_int_equal(lg_model_stepper_size(s.b.model, scheme), 0);
        assert_status(lg_model_stepper_init(s.b.model, scheme, &stepper, s.b.work, 1 << 20), LG_UNSUPPORTED);
        assert_status(lg_model_stepper_init(s.b.model, scheme, &stepper, NULL, 0), LG_UNSUPPORTED);
        assert_null(stepper);
    }
}

/* Integrates the ambient velocity by classical Runge-Kutta in small steps, with projection to the
 * manifold. */
static void fine_flow(const built *b, const double *input, double t, double *y) {
    enum { STEPS = 2000 };
    const lg_space space = space_of(b);
    const double h = t / STEPS;
    static const double at[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0, 2.0, 2.0, 1.0};
    for (int n = 0; n < STEPS; n++) {
        double k[MOST_STATE] = {0}, z[MOST_STATE], sum[MOST_STATE] = {0};
        for (int stage = 0; stage < 4; stage++) {
            for (size_t i = 0; i < space.dim; i++) z[i] = y[i] + at[stage] * h * k[i];
            velocity(b, z, input, k);
            for (size_t i = 0; i < space.dim; i++) sum[i] += weight[stage] * h / 6.0 * k[i];
        }
        for (size_t i = 0; i < space.dim; i++) y[i] += sum[i];
        lg_space_project(&space, y);
    }
}

TEST("a step with an input follows the field with that input") {
    static const char *const names[] = {"cf4",         "rkmk4",      "rkmk54", "stormer-verlet",
                                        "forest-ruth", "blanes-moan"};
    static const double tolerance[] = {1e-8, 1e-8, 1e-10, 1e-4, 1e-7, 1e-10};
    for (size_t family = 0; family < lg_hamiltonian_family_count(); family++)
        for (size_t i = 0; i < LG_COUNT(names); i++) {
            moving s = make_motion(3 * family + 1, LG_POTENTIAL_MLP, LG_TANH);
            double fine[MOST_STATE], moved = 0.0;
            if (!fits(&s.b, lg_scheme_find(names[i]))) continue;
            lg_stepper *stepper = stepper_of(&s.b, lg_scheme_find(names[i]));
            memcpy(fine, s.y, sizeof fine);
            for (int n = 0; n < 50; n++) assert_ok(lg_stepper_step(stepper, 0.0, 0.01, s.y, s.u, s.y));
            fine_flow(&s.b, s.u, 0.5, fine);
            for (size_t j = 0; j < s.d; j++) {
                assert_close(s.y[j], fine[j], tolerance[i], tolerance[i]);
                moved = fmax(moved, fabs(s.y[j]));
            }
            assert_true(moved > 0.1);
        }
}

TEST("memory that is too small or misaligned is refused, and so are invalid schemes") {
    const built b = build_hamiltonian(&lg_hamiltonian_chain, 1, LG_POTENTIAL_MLP, LG_TANH);
    const lg_scheme *cf4 = lg_scheme_find("cf4");
    lg_scheme bad = *lg_scheme_find("rkmk4");
    lg_stepper *stepper = NULL;
    const size_t bytes = lg_model_stepper_size(b.model, cf4);
    char *memory = test_work(bytes);
    bad.b[0] += 0.5;
    const struct {
        char *memory;
        size_t bytes;
        const lg_model *model;
        const lg_scheme *scheme;
        lg_stepper **out;
    } cases[] = {{memory, bytes - 1, b.model, cf4, &stepper}, {memory, 0, b.model, cf4, &stepper},
                 {NULL, bytes, b.model, cf4, &stepper},       {memory + 8, bytes, b.model, cf4, &stepper},
                 {memory, bytes, b.model, cf4, NULL},         {memory, bytes, NULL, cf4, &stepper},
                 {memory, bytes, b.model, NULL, &stepper},    {memory, bytes, b.model, &bad, &stepper}};
    for (size_t i = 0; i < LG_COUNT(cases); i++)
        assert_status(lg_model_stepper_init(cases[i].model, cases[i].scheme, cases[i].out, cases[i].memory,
                                            cases[i].bytes),
                      LG_INVALID_ARGUMENT);
    assert_int_equal(lg_model_stepper_size(b.model, &bad), 0);
    assert_int_equal(lg_model_stepper_size(NULL, cf4) + lg_model_stepper_size(b.model, NULL), 0);
    assert_null(stepper);
}

/* ---- states and inputs that are not finite ---- */

static void check_nan(const moving *s, const double *input) {
    double value = 0.0, gradient[MOST_STATE], A[MOST_TANGENT * MOST_TANGENT], next[MOST_STATE];
    const built *b = &s->b;
    bool found = false;
    lg_model_eval(b->model, s->y, &value, b->work);
    assert_true(isnan(value) || input != NULL);
    lg_model_jacobian(b->model, s->y, NULL, gradient, b->work);
    assert_ok(lg_model_linearise(b->model, s->y, input, A, NULL, NULL, b->work));
    for (size_t i = 0; i < s->r * s->r; i++) found = found || isnan(A[i]);
    /* For a separable system A depends on q alone. */
    assert_true(found || (!is_chain(b) && !isnan(s->y[0])));
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        if (!fits(b, lg_scheme_at(i))) continue;
        memset(next, 0, sizeof next);
        const lg_status status =
            lg_stepper_step(stepper_of(b, lg_scheme_at(i)), 0.0, 0.01, s->y, input, next);
        assert_true(status == LG_NOT_FINITE || status == LG_NO_CONVERGENCE);
        for (size_t j = 0; j < s->d; j++) assert_true(next[j] == 0.0);
    }
}

TEST("a state or input that is NaN or infinite gives NaN and no step") {
    for (size_t family = 0; family < lg_hamiltonian_family_count(); family++)
        for (size_t end = 0; end < 2; end++) {
            const moving good = make_motion(3 * family + 1, LG_POTENTIAL_MLP, LG_TANH);
            moving bad = good, driven = good;
            bad.y[end == 0 ? 0 : bad.d - 1] = NAN;
            driven.u[0] = NAN;
            check_nan(&bad, NULL);
            if (driven.m > 0) check_nan(&driven, driven.u);
        }
}

static void check_unfit_inputs(built b) {
    double *x = room(lg_model_inputs(b.model));
    for (size_t i = 0; i < lg_model_inputs(b.model); i++) x[i] = 0.1 * (double)(1 + i % 7);
    check_unfit(b.model, x, b.work);
}

TEST("one input that is not finite makes all outputs NaN, even behind a ReLU") {
    for (size_t family = 0; family < lg_hamiltonian_family_count(); family++)
        check_unfit_inputs(build_hamiltonian(lg_hamiltonian_family_at(family), 2, LG_POTENTIAL_MLP, LG_RELU));
    for (int kind = 0; kind < LG_SURROGATE_KIND_COUNT; kind++)
        check_unfit_inputs(build_surrogate((lg_surrogate_kind)kind));
    check_unfit_inputs(build_detector(LG_RELU));
}

TEST("a singular mass gives NaN") {
    for (uint32_t links = 1; links <= 2; links++) {
        const built massive = build_hamiltonian(&lg_hamiltonian_chain, links, LG_POTENTIAL_MLP, LG_TANH);
        const size_t n = lg_model_parameters(massive.model), kinetic = links * links + links;
        memset(massive.theta + n - kinetic, 0, kinetic * sizeof *massive.theta);
        const moving s = put_in_motion(build_from(&massive.hamiltonian, massive.theta), links);
        double value = 0.0, field[MOST_STATE], gradient[MOST_STATE], A[MOST_TANGENT * MOST_TANGENT];
        lg_model_jacobian(s.b.model, s.y, &value, gradient, s.b.work);
        assert_true(isnan(value));
        assert_all_nan(gradient, s.d);
        assert_ok(lg_model_field(s.b.model, s.y, NULL, field, s.b.work));
        assert_all_nan(field, s.d);
        assert_ok(lg_model_linearise(s.b.model, s.y, NULL, A, NULL, NULL, s.b.work));
        assert_all_nan(A, s.r * s.r);
        check_nan(&s, NULL);
    }
}

/* ---- a program on a product of all spaces ---- */

enum { WIDE = 49, WIDE_INPUT = 2 };

/* f(x, u) = tanh((x - rest) W) + u V: without input, `rest` is an equilibrium. */
typedef struct wide {
    lg_space space;
    double W[WIDE * WIDE], V[WIDE_INPUT * WIDE], rest[WIDE];
    lg_model *model;
    void *work;
} wide;

static lg_status wide_field(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const wide *w = user;
    const uint32_t d = (uint32_t)w->space.dim, a = (uint32_t)w->space.algebra_dim;
    (void)theta;
    const lg_var away = lg_sub(tape, x[0], lg_input_f64(tape, lg_shape2(1, d), w->rest));
    const lg_var slow =
        lg_act(tape, lg_matmul(tape, away, lg_input_f64(tape, lg_shape2(d, a), w->W)), LG_TANH);
    const lg_var V = lg_input_f64(tape, lg_shape2(WIDE_INPUT, a), w->V);
    y[0] = lg_add(tape, slow, lg_matmul(tape, x[1], V));
    return lg_tape_status(tape);
}

static wide *make_wide(uint64_t seed) {
    lg_space_factor factors[LG_SPACE_KINDS];
    wide *w = TEST_ARRAY(wide, 1);
    lg_program_spec spec;
    lg_program *program;
    for (size_t kind = 0; kind < LG_SPACE_KINDS; kind++)
        factors[kind] = (lg_space_factor){(lg_space_kind)((kind + seed) % LG_SPACE_KINDS), 1 + (kind == 1)};
    assert_ok(lg_space_init(&w->space, factors, LG_SPACE_KINDS));
    assert_true(w->space.dim <= WIDE);
    lg_rng rng = test_rng(41, seed);
    for (size_t i = 0; i < WIDE * WIDE; i++) w->W[i] = 0.2 * lg_rng_normal(&rng);
    for (size_t i = 0; i < WIDE_INPUT * WIDE; i++) w->V[i] = lg_rng_normal(&rng);
    do { /* a matrix with determinant -1 has no rotation near it */
        for (size_t i = 0; i < w->space.dim; i++) w->rest[i] = lg_rng_normal(&rng);
        lg_space_project(&w->space, w->rest);
    } while (isnan(lg_space_manifold_error(&w->space, w->rest)));
    const lg_port in[] = {{.name = "x", .shape = lg_shape1((uint32_t)w->space.dim)},
                          {.name = "u", .shape = lg_shape1(WIDE_INPUT)}};
    const lg_port out = {.name = "f"};
    const lg_function_spec field = {"field", in, 2, &out, 1, wide_field, w};
    lg_program_spec_init(&spec);
    spec.functions = &field;
    spec.function_count = 1;
    assert_ok(lg_program_build(NULL, &spec, &program, NULL));
    assert_int_equal(lg_model_create(NULL, program, &w->space, &w->model, NULL), LG_OK); /* called once */
    lg_test_owns(w->model, release_model);
    w->work = test_work(lg_model_work_size(w->model));
    return w;
}

TEST("a program on any space is linearised, retracted and brought to rest in its coordinates") {
    for (uint64_t seed = 0; seed < LG_SPACE_KINDS; seed++) {
        const wide *w = make_wide(seed);
        const size_t d = w->space.dim, r = w->space.tangent_dim;
        double y[WIDE], c[WIDE] = {0}, at[WIDE], found[WIDE];
        const double u[WIDE_INPUT] = {0.4, -0.3};
        for (size_t i = 0; i < r; i++) c[i] = 0.05 * sin((double)(3 * i + 1));
        assert_ok(lg_model_retract(w->model, w->rest, c, y, w->work));
        check_linearisation(w->model, y, u, 1e-7, w->work);
        for (size_t i = 0; i < r; i++) c[i] = 1e-3 * cos((double)i);
        assert_ok(lg_model_retract(w->model, w->rest, c, y, w->work));
        assert_ok(lg_model_deviation(w->model, w->rest, y, found, w->work));
        assert_all_close(found, c, r, 0.0, 1e-5);
        assert_ok(lg_model_equilibrium(w->model, NULL, y, NULL, w->work));
        model_velocity(w->model, y, NULL, at, w->work);
        for (size_t i = 0; i < d; i++) assert_close(at[i], 0.0, 0.0, 1e-8);
        assert_true(lg_space_manifold_error(&w->space, y) < 1e-14);
    }
}

/* The first *user numbers of the concatenation of sin(x) and x. */
static lg_status first_numbers(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const uint32_t *count = user;
    const lg_var both[2] = {lg_sin(tape, x[0]), x[0]};
    (void)theta;
    y[0] = lg_slice(tape, lg_concat(tape, both, 2, 1), 1, 0, *count);
    return lg_tape_status(tape);
}

TEST("functions that do not fit each other or the space are refused") {
    static const struct {
        struct {
            const char *name;
            uint32_t in, out; /* numbers of x and of the result */
        } of[2];
        lg_status status;
    } rows[] = {{{{"field", 6, 6}}, LG_OK},
                {{{"field", 6, 5}}, LG_SHAPE},
                {{{"field", 5, 6}}, LG_SHAPE},
                {{{"value", 6, 1}}, LG_NOT_FOUND}, /* a space, but no field */
                {{{"other", 6, 6}}, LG_NOT_FOUND},
                {{{"field", 6, 6}, {"drift", 3, 3}}, LG_OK},
                {{{"field", 6, 6}, {"drift", 2, 3}}, LG_SHAPE},
                {{{"field", 6, 6}, {"drift", 3, 2}}, LG_SHAPE}};
    const lg_space_factor factor = {LG_SPACE_TS2, 1};
    lg_space space;
    assert_ok(lg_space_init(&space, &factor, 1));
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const lg_port out = {.name = "y"};
        lg_port in[2];
        lg_function_spec functions[2];
        size_t count = 0;
        for (; count < 2 && rows[i].of[count].name != NULL; count++) {
            in[count] = (lg_port){.name = "x", .shape = lg_shape1(rows[i].of[count].in)};
            functions[count] = (lg_function_spec){rows[i].of[count].name,
                                                  &in[count],
                                                  1,
                                                  &out,
                                                  1,
                                                  first_numbers,
                                                  (void *)(uintptr_t)&rows[i].of[count].out};
        }
        lg_program_spec spec;
        lg_program *program;
        lg_model *model = NULL;
        lg_program_spec_init(&spec);
        spec.functions = functions;
        spec.function_count = count;
        assert_ok(lg_program_build(NULL, &spec, &program, NULL));
        assert_int_equal(lg_model_create(NULL, program, &space, &model, NULL),
                         rows[i].status); /* called once */
        lg_model_destroy(model);
    }
}

/* (log x0, -x1): Newton's step from 5 leads to a negative x0, where the drift is (NaN, 0). */
static lg_status record_logarithm(void *user, lg_tape *t, const lg_var *theta, const lg_var *x, lg_var *out) {
    const lg_var rate[2] = {lg_log(t, lg_slice(t, x[0], 1, 0, 1)), lg_neg(t, lg_slice(t, x[0], 1, 1, 1))};
    (void)user;
    (void)theta;
    out[0] = lg_concat(t, rate, 2, 1);
    return lg_tape_status(t);
}

TEST("a drift that is not a number is never an equilibrium") {
    const lg_port in = {.name = "x", .shape = lg_shape1(2), .low = 0.5, .high = 1.5}, out = {.name = "rate"};
    const lg_function_spec field = {"field", &in, 1, &out, 1, record_logarithm, NULL};
    lg_program_spec spec;
    lg_program *program;
    lg_model *model;
    lg_space space;
    double x[2] = {5, 0}, drift = -1;
    lg_program_spec_init(&spec);
    spec.functions = &field, spec.function_count = 1;
    assert_told(lg_program_build(NULL, &spec, &program, &told));
    assert_ok(lg_space_init_rn(&space, 2));
    assert_int_equal(lg_model_create(NULL, program, &space, &model, NULL), LG_OK); /* called once */
    lg_test_owns(model, release_model);
    void *work = test_work(lg_model_work_size(model));
    assert_ok(lg_model_equilibrium(model, NULL, x, &drift, work));
    assert_float_equal(x[0], 1.0, 1e-9);
    assert_float_equal(x[1], 0.0, 1e-9);
    assert_true(drift <= 1e-9);
}

TEST("NULL has no numbers and is refused, and what does not move has no equilibrium") {
    const lg_port in = {.name = "x", .shape = lg_shape1(3)}, out = {.name = "y"};
    static const uint32_t one = 1;
    const lg_function_spec value = {"value", &in, 1, &out, 1, first_numbers, (void *)(uintptr_t)&one};
    lg_program_spec spec;
    lg_program *program = NULL;
    lg_model *model = NULL;
    lg_file_writer *writer = NULL;
    lg_file_reader *reader = NULL;
    double x[3] = {1, 2, 3}, y[3];
    lg_error error;
    const lg_recipe *recipe = &lg_recipe_hamiltonian;
    lg_program_spec_init(&spec);
    spec.functions = &value;
    spec.function_count = 1;
    assert_told(lg_program_build(NULL, &spec, &program, &told));
    assert_int_equal(lg_model_create(NULL, program, NULL, &model, NULL), LG_OK); /* called once */
    lg_test_owns(model, release_model);
    void *work = test_work(lg_model_work_size(model));
    assert_status(lg_model_retract(model, x, x, y, work), LG_UNSUPPORTED);
    assert_status(lg_model_equilibrium(model, NULL, x, NULL, work), LG_UNSUPPORTED);
    assert_int_equal(lg_model_inputs(NULL) + lg_model_outputs(NULL) + lg_model_parameters(NULL), 0);
    assert_null(lg_model_file_of(NULL, recipe));
    assert_status(lg_model_file_program(NULL, NULL, &program, &error), LG_INVALID_ARGUMENT);
    for (int k = 0; k < 4; k++) {
        const lg_recipe *kind = k == 0 ? NULL : recipe;
        double run[512] = {0}, *some = k == 1 ? NULL : run;
        const char *path = k == 2 ? NULL : "none.h5";
        assert_status(lg_checkpoint_create(NULL, path, kind, some, NULL, k == 3 ? NULL : &writer, &error),
                      LG_INVALID_ARGUMENT);
        if (k != 2)
            assert_status(lg_checkpoint_open(NULL, path, NULL, kind, some, k == 3 ? NULL : &reader, &error),
                          LG_INVALID_ARGUMENT);
        assert_status(lg_recipe_compare_runs(kind, some, k == 3 ? NULL : run, path, &error),
                      LG_INVALID_ARGUMENT);
    }
    assert_true(writer == NULL && reader == NULL);
}

TEST("the program of a model is copied with a step; where memory ends, nothing is left") {
    static const uint32_t three = 3;
    const lg_port in = {.name = "x", .shape = lg_shape1(3)}, out = {.name = "f"};
    const lg_function_spec field = {"field", &in, 1, &out, 1, first_numbers, (void *)(uintptr_t)&three};
    const lg_parameter_spec mass = {"mass", lg_shape1(2), NULL};
    lg_space space;
    lg_program_spec spec;
    lg_program_spec_init(&spec);
    spec.functions = &field;
    spec.function_count = 1;
    spec.parameters = &mass;
    spec.parameter_count = 1;
    assert_ok(lg_space_init_rn(&space, 3));
    EVERY_ALLOCATION_FAILS(context, 50, {
        lg_program *program = NULL;
        lg_program *copy = NULL;
        lg_model *model = NULL;
        status = lg_program_build(context, &spec, &program, NULL);
        if (status == LG_OK) status = lg_model_create(context, program, &space, &model, NULL);
        if (status == LG_OK) status = lg_model_copy_program(model, NULL, &copy, NULL);
        if (status == LG_OK) {
            double y[3] = {7, 7, 7};
            lg_plan *plan = NULL;
            assert_ok(lg_program_find(copy, "step", &(size_t){0}, NULL));
            assert_int_equal(lg_program_parameters(copy), 1);
            lg_model_eval(model, y, y, NULL); /* it has a field, but no value */
            lg_model_jacobian(model, y, y, y, NULL);
            assert_true(y[0] == 7);
            assert_status(lg_model_find(model, "value", NULL, &plan, NULL), LG_NOT_FOUND);
        }
        lg_program_destroy(copy);
        lg_model_destroy(model);
    });
}
