/* Models in a loop: one handle for all kinds; a learned Hamiltonian's field with inputs, its steps, and its
 * linearisation against differences along the manifold and closed forms. */
#include "model_support.h"

#include "liegrad/geometry.h"

/* ---- value and derivative ---- */

static void sizes_are_those_of_the_kind(void **state) {
    (void)state;
    static const size_t sizes[LG_SURROGATE_KIND_COUNT + 1][2] = {{8, 20}, {9, 2}, {9, 1}, {120, 3}};
    built b;
    for (size_t family = 0; family < lg_hamiltonian_family_count(); family++)
        for (uint32_t n = 1; n <= 3; n++) {
            const lg_hamiltonian_family *row = lg_hamiltonian_family_at(family);
            build_hamiltonian(&b, row, n, LG_POTENTIAL_MLP, LG_TANH);
            assert_int_equal(lg_model_inputs(b.model), space_of(&b).dim);
            assert_int_equal(lg_model_outputs(b.model), 1);
            assert_int_equal(lg_model_parameters(b.model), lg_hamiltonian_parameters(&b.hamiltonian));
            assert_int_equal(lg_model_input_size(b.model), n * row->forces);
            assert_int_equal(lg_model_tangent_size(b.model), n * row->tangent);
            build_free(&b);
        }
    for (int kind = 0; kind <= LG_SURROGATE_KIND_COUNT; kind++) {
        const bool detector = kind == LG_SURROGATE_KIND_COUNT;
        if (detector)
            build_detector(&b, LG_SWISH);
        else
            build_surrogate(&b, (lg_surrogate_kind)kind);
        assert_int_equal(lg_model_inputs(b.model), sizes[kind][0]);
        assert_int_equal(lg_model_outputs(b.model), sizes[kind][1]);
        assert_int_equal(lg_model_parameters(b.model), detector ? lg_cnn_parameters(&b.detector.net)
                                                                : lg_surrogate_parameters(&b.surrogate));
        build_free(&b);
    }
}

static void only_hamiltonians_move(void **state) {
    (void)state;
    for (int which = 0; which < 2; which++) {
        built b;
        if (which == 0)
            build_surrogate(&b, LG_SURROGATE_DISCRETE);
        else
            build_detector(&b, LG_SWISH);
        const lg_model *m = b.model;
        const lg_scheme *cf4 = lg_scheme_find("cf4");
        lg_model_user user = {NULL, NULL};
        lg_ode ode = {.user = &b};
        lg_stepper *stepper = NULL;
        double numbers[300] = {0};
        assert_int_equal(lg_model_input_size(m), 0);
        assert_int_equal(lg_model_tangent_size(m), 0);
        assert_int_equal(lg_model_stepper_size(m, cf4), 0);
        assert_status(lg_model_field(m, numbers, NULL, numbers + 150, b.work), LG_UNSUPPORTED);
        assert_status(lg_model_ode(m, &user, b.work, &ode), LG_UNSUPPORTED);
        assert_null(user.model);
        assert_ptr_equal(ode.user, &b);
        assert_status(lg_model_stepper_init(b.work, b.bytes, m, cf4, &stepper), LG_UNSUPPORTED);
        assert_null(stepper);
        assert_status(lg_model_linearise(m, numbers, NULL, numbers, numbers, numbers, b.work),
                      LG_UNSUPPORTED);
        assert_status(lg_model_deviation(m, numbers, numbers, numbers, b.work), LG_UNSUPPORTED);
        build_free(&b);
    }
    assert_int_equal(lg_model_work_size(NULL) + lg_model_input_size(NULL) + lg_model_tangent_size(NULL), 0);
}

/* ---- the field ---- */

/* The ambient velocity of the learned system. */
static void velocity(const built *b, const double *y, const double *input, double *out) {
    const lg_space space = space_of(b);
    double field[MOST_STATE];
    assert_ok(lg_model_field(b->model, y, input, field, b->work));
    lg_space_generator(&space, field, y, out);
}

/* The same system by hand, from the gradient. */
typedef struct by_hand {
    const built *b;
} by_hand;

/* Families whose field stands here. */
static const lg_hamiltonian_family *const by_hand_families[] = {&lg_hamiltonian_chain,
                                                                &lg_hamiltonian_separable};
enum { FAMILIES_BY_HAND = sizeof by_hand_families / sizeof *by_hand_families };

static bool is_by_hand(const built *b) {
    bool found = false;
    for (size_t i = 0; i < FAMILIES_BY_HAND; i++)
        found = found || by_hand_families[i] == b->hamiltonian.family;
    return found;
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

/* q' is that without input; p_i' has tau_i x q_i more, or u. */
static void inputs_act_beside_the_field(void **state) {
    (void)state;
    for (size_t family = 0; family < FAMILIES_BY_HAND; family++)
        for (uint32_t links = 1; links <= 3; links++) {
            built b;
            lg_rng rng;
            double y[MOST_STATE], u[MOST_INPUT], zero[MOST_INPUT] = {0}, free_run[MOST_STATE],
                                                 none[MOST_STATE], driven[MOST_STATE], field[MOST_STATE],
                                                 expected[MOST_STATE];
            build_hamiltonian(&b, by_hand_families[family], links, LG_POTENTIAL_MLP, LG_SWISH);
            const size_t d = lg_model_inputs(b.model), m = lg_model_input_size(b.model);
            lg_rng_seed(&rng, 3, links);
            draw_state(&b, &rng, y);
            for (size_t i = 0; i < m; i++) u[i] = lg_rng_normal(&rng);
            assert_ok(lg_model_field(b.model, y, NULL, field, b.work));
            hand_field(&(by_hand){&b}, 0.0, y, NULL, expected);
            for (size_t i = 0; i < d; i++) assert_close(field[i], expected[i], 1e-13, 1e-13);
            velocity(&b, y, NULL, free_run);
            velocity(&b, y, zero, none);
            velocity(&b, y, u, driven);
            assert_memory_equal(free_run, none, d * sizeof *none);
            for (uint32_t i = 0; i < links; i++) {
                double torque[3] = {0};
                if (is_chain(&b)) lg_cross3(u + 3 * i, y + 6 * i, torque);
                for (size_t c = 0; is_chain(&b) && c < 3; c++) {
                    assert_close(driven[6 * i + c], free_run[6 * i + c], 1e-13, 1e-13);
                    assert_close(driven[6 * i + 3 + c] - free_run[6 * i + 3 + c], torque[c], 1e-12, 1e-12);
                }
                if (is_chain(&b)) continue;
                assert_close(driven[i], free_run[i], 0.0, 0.0);
                assert_close(driven[links + i] - free_run[links + i], u[i], 1e-13, 1e-13);
            }
            build_free(&b);
        }
}

/* Power: dH/dt is tau.omega, omega = q x v, or u.dH/dp. */
static void inputs_do_work(void **state) {
    (void)state;
    for (size_t family = 0; family < FAMILIES_BY_HAND; family++) {
        built b;
        lg_rng rng;
        double y[MOST_STATE], u[MOST_INPUT], dy[MOST_STATE], gradient[MOST_STATE], work = 0.0, power = 0.0;
        build_hamiltonian(&b, by_hand_families[family], 2, LG_POTENTIAL_MLP, LG_TANH);
        const size_t d = lg_model_inputs(b.model);
        lg_rng_seed(&rng, 4, 0);
        draw_state(&b, &rng, y);
        for (size_t i = 0; i < lg_model_input_size(b.model); i++) u[i] = lg_rng_normal(&rng);
        velocity(&b, y, u, dy);
        lg_model_jacobian(b.model, y, NULL, gradient, b.work);
        for (size_t i = 0; i < d; i++) power += gradient[i] * dy[i];
        for (size_t i = 0; i < 2; i++) {
            double omega[3];
            lg_cross3(y + 6 * i, gradient + 6 * i + 3, omega);
            work += is_chain(&b) ? lg_dot3(u + 3 * i, omega) : u[i] * gradient[2 + i];
        }
        assert_true(fabs(work) > 1e-3);
        assert_close(power, work, 1e-12, 1e-12);
        build_free(&b);
    }
}

/* Of every family: without an input dH/dt = 0 on the manifold. */
static void fields_keep_the_energy(void **state) {
    (void)state;
    for (size_t family = 0; family < lg_hamiltonian_family_count(); family++)
        for (uint32_t n = 1; n <= 3; n++) {
            built b;
            lg_rng rng;
            double y[MOST_STATE], dy[MOST_STATE], dH[MOST_STATE], power = 0.0, size = 0.0;
            build_hamiltonian(&b, lg_hamiltonian_family_at(family), n, LG_POTENTIAL_MLP, LG_SWISH);
            const size_t d = lg_model_inputs(b.model);
            lg_rng_seed(&rng, 6, n);
            draw_state(&b, &rng, y);
            velocity(&b, y, NULL, dy);
            lg_model_jacobian(b.model, y, NULL, dH, b.work);
            for (size_t i = 0; i < d; i++) power += dH[i] * dy[i], size += fabs(dH[i] * dy[i]);
            assert_true(size > 1e-9);
            assert_close(power, 0.0, 0.0, 1e-14 * size);
            build_free(&b);
        }
}

/* ---- linearisation ---- */

/* The frame as the header tells it. */
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

/* Coordinates of an ambient vector at y: of R^d but for chains. */
static void in_coordinates(const built *b, const double *y, const double *vector, double *c) {
    if (!is_chain(b)) memcpy(c, vector, lg_model_inputs(b->model) * sizeof *c);
    for (uint32_t i = 0; is_chain(b) && i < b->hamiltonian.n; i++) {
        double e[2][3];
        expected_frame(y + 6 * i, e[0], e[1]);
        for (int j = 0; j < 2; j++) {
            c[4 * i + (uint32_t)j] = lg_dot3(e[j], vector + 6 * i);
            c[4 * i + 2 + (uint32_t)j] = lg_dot3(e[j], vector + 6 * i + 3);
        }
    }
}

/* The state that is y + step times the direction, taken back to the manifold: the difference is of second
 * order in the step, and the same for -step. */
static void along(const built *b, const double *y, const double *direction, size_t stride, double step,
                  double *out) {
    const lg_space space = space_of(b);
    for (size_t i = 0; i < space.dim; i++) out[i] = y[i] + step * direction[i * stride];
    lg_space_project(&space, out);
}

static void check_basis(const built *b, const double *y, const double *basis) {
    const size_t r = lg_model_tangent_size(b->model), d = lg_model_inputs(b->model);
    for (size_t j = 0; j < r; j++) {
        double direction[MOST_STATE], c[MOST_TANGENT];
        for (size_t i = 0; i < d; i++) direction[i] = basis[i * r + j];
        in_coordinates(b, y, direction, c);
        for (size_t i = 0; i < r; i++) assert_close(c[i], i == j ? 1.0 : 0.0, 0.0, 1e-15);
        for (size_t i = 0; is_chain(b) && i < d; i += 6) { /* |q|^2 and q.p stay */
            assert_close(lg_dot3(y + i, direction + i), 0.0, 0.0, 1e-15);
            assert_close(lg_dot3(y + i, direction + i + 3) + lg_dot3(y + i + 3, direction + i), 0.0, 0.0,
                         1e-15);
        }
    }
}

/* Central differences of the field along the manifold and in the input; h = 1e-5 leaves about 1e-9. */
static void check_linearisation(const built *b, const double *y, const double *input) {
    const double h = 1e-5;
    const size_t r = lg_model_tangent_size(b->model), m = lg_model_input_size(b->model);
    double A[MOST_TANGENT * MOST_TANGENT], B[MOST_TANGENT * MOST_INPUT], basis[MOST_STATE * MOST_TANGENT];
    double alone[MOST_STATE * MOST_TANGENT];
    double at[MOST_STATE], up[MOST_STATE], down[MOST_STATE], c[MOST_TANGENT], largest = 0.0;
    assert_ok(lg_model_linearise(b->model, y, input, A, B, basis, b->work));
    check_basis(b, y, basis);
    for (size_t i = 0; i < r * r; i++) largest = fmax(largest, fabs(A[i]));
    assert_true(largest > 1e-3);
    for (size_t j = 0; j < r; j++) {
        along(b, y, basis + j, r, h, at);
        velocity(b, at, input, up);
        along(b, y, basis + j, r, -h, at);
        velocity(b, at, input, down);
        for (size_t i = 0; i < lg_model_inputs(b->model); i++) up[i] = (up[i] - down[i]) / (2.0 * h);
        in_coordinates(b, y, up, c);
        for (size_t i = 0; i < r; i++) assert_close(A[i * r + j], c[i], 1e-7, 1e-8 * largest);
    }
    for (size_t j = 0; j < m; j++) {
        double u[MOST_INPUT] = {0};
        if (input != NULL) memcpy(u, input, m * sizeof *u);
        u[j] += 1.0;
        velocity(b, y, u, up);
        u[j] -= 2.0;
        velocity(b, y, u, down);
        for (size_t i = 0; i < lg_model_inputs(b->model); i++) up[i] = (up[i] - down[i]) / 2.0;
        in_coordinates(b, y, up, c);
        for (size_t i = 0; i < r; i++) assert_close(B[i * m + j], c[i], 1e-12, 1e-12);
    }
    /* Each of the three alone. */
    assert_ok(lg_model_linearise(b->model, y, input, alone, NULL, NULL, b->work));
    assert_memory_equal(alone, A, r * r * sizeof *A);
    assert_ok(lg_model_linearise(b->model, y, input, NULL, alone, NULL, b->work));
    assert_memory_equal(alone, B, r * m * sizeof *B);
    assert_ok(lg_model_linearise(b->model, y, input, NULL, NULL, alone, b->work));
    assert_memory_equal(alone, basis, lg_model_inputs(b->model) * r * sizeof *basis);
}

/* A random state made special; p keeps what is tangent. */
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

static void linearisation_matches_differences(void **state) {
    (void)state;
    for (size_t family = 0; family < lg_hamiltonian_family_count(); family++)
        for (uint32_t links = 1; links <= 3; links++)
            for (int potential = 0; potential < LG_POTENTIAL_KIND_COUNT; potential++)
                for (int what = 0; what < SPECIAL; what++) {
                    built b;
                    lg_rng rng;
                    double y[MOST_STATE], u[MOST_INPUT];
                    build_hamiltonian(&b, lg_hamiltonian_family_at(family), links,
                                      (lg_potential_kind)potential, LG_TANH);
                    lg_rng_seed(&rng, 5, (uint64_t)what);
                    draw_state(&b, &rng, y);
                    make_special(&b, what, y);
                    for (size_t i = 0; i < lg_model_input_size(b.model); i++) u[i] = lg_rng_normal(&rng);
                    check_linearisation(&b, y, NULL);
                    check_linearisation(&b, y, u);
                    build_free(&b);
                }
}

/* a' = b/m, b' = +-c a: eigenvalues +-sqrt(c/m) upright, +-i sqrt(c/m) hanging, each twice. */
static void pendulum_at_its_equilibria(void **state) {
    (void)state;
    const double m = 0.7, c = 2.3;
    built b;
    build_pendulum(&b, m, c);
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
        /* e_1 = (1, 0, 0), e_2 = (0, sign, 0): a torque about y pushes along sign x, one about x against y.
         */
        const double expected_B[12] = {0, 0, 0, 0, 0, 0, 0, sign, 0, -1, 0, 0};
        for (int i = 0; i < 12; i++) assert_close(B[i], expected_B[i], 0.0, 1e-15);
    }
    build_free(&b);
}

/* A small swing about the hanging position is a sum of cosines; the steps of the library against the
 * linearisation. */
static void small_swings_follow_the_linearisation(void **state) {
    (void)state;
    const double m = 0.7, c = 2.3, h = 0.01, eps = 1e-5, omega = sqrt(c / m);
    const double rest[6] = {0.0, 0.0, -1.0, 0.0, 0.0, 0.0}, start[4] = {1.0, -0.5, 0.2, 0.8};
    built b;
    lg_stepper *stepper;
    double y[6], basis[24], found[4];
    build_pendulum(&b, m, c);
    const lg_scheme *cf4 = lg_scheme_find("cf4");
    const size_t bytes = lg_model_stepper_size(b.model, cf4);
    void *memory = NULL;
    assert_int_equal(posix_memalign(&memory, 64, bytes), 0);
    assert_ok(lg_model_stepper_init(memory, bytes, b.model, cf4, &stepper));
    assert_ok(lg_model_linearise(b.model, rest, NULL, NULL, NULL, basis, b.work));
    memcpy(y, rest, sizeof y);
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 4; j++) y[i] += eps * basis[4 * i + j] * start[j];
    const lg_space space = space_of(&b);
    lg_space_project(&space, y);
    for (int n = 1; n <= 300; n++) {
        assert_ok(lg_step(stepper, 0.0, h, y, NULL, y));
        assert_ok(lg_model_deviation(b.model, rest, y, found, b.work));
        const double t = n * h;
        for (int j = 0; j < 2; j++) {
            const double a = start[j] * cos(omega * t) + start[2 + j] / (m * omega) * sin(omega * t);
            const double p = start[2 + j] * cos(omega * t) - start[j] * m * omega * sin(omega * t);
            assert_close(found[j] / eps, a, 0.0, 1e-8);
            assert_close(found[2 + j] / eps, p, 0.0, 1e-8);
        }
    }
    free(memory);
    build_free(&b);
}

/* y + basis c has coordinates c, and y itself 0. */
static void deviations_are_coordinates(void **state) {
    (void)state;
    for (size_t family = 0; family < lg_hamiltonian_family_count(); family++)
        for (uint32_t links = 1; links <= 3; links++) {
            built b;
            lg_rng rng;
            double y[MOST_STATE], other[MOST_STATE], basis[MOST_STATE * MOST_TANGENT], c[MOST_TANGENT],
                found[MOST_TANGENT];
            build_hamiltonian(&b, lg_hamiltonian_family_at(family), links, LG_POTENTIAL_MLP, LG_TANH);
            const size_t r = lg_model_tangent_size(b.model), d = lg_model_inputs(b.model);
            lg_rng_seed(&rng, 6, links);
            draw_state(&b, &rng, y);
            assert_ok(lg_model_linearise(b.model, y, NULL, NULL, NULL, basis, b.work));
            for (size_t j = 0; j < r; j++) c[j] = lg_rng_normal(&rng);
            for (size_t i = 0; i < d; i++) {
                other[i] = y[i];
                for (size_t j = 0; j < r; j++) other[i] += basis[i * r + j] * c[j];
            }
            assert_ok(lg_model_deviation(b.model, y, other, found, b.work));
            for (size_t j = 0; j < r; j++) assert_close(found[j], c[j], 1e-13, 1e-14);
            assert_ok(lg_model_deviation(b.model, y, y, found, b.work));
            for (size_t j = 0; j < r; j++) assert_close(found[j], 0.0, 0.0, 0.0);
            build_free(&b);
        }
}

/* ---- steps ---- */

typedef struct stepping {
    void *memory;
    size_t bytes;
    lg_stepper *stepper;
} stepping;

/* In exactly as many bytes as asked for. */
static void open_stepper(const built *b, const lg_scheme *scheme, stepping *s) {
    s->bytes = lg_model_stepper_size(b->model, scheme);
    assert_true(s->bytes > 0);
    assert_int_equal(posix_memalign(&s->memory, 64, s->bytes + 64), 0);
    memset(s->memory, 0x41, s->bytes + 64);
    assert_ok(lg_model_stepper_init(s->memory, s->bytes, b->model, scheme, &s->stepper));
}

static void close_stepper(stepping *s) {
    for (size_t i = 0; i < 64; i++) assert_int_equal(((unsigned char *)s->memory)[s->bytes + i], 0x41);
    free(s->memory);
}

static void check_scheme(const built *b, const lg_scheme *scheme, const double *start, const double *input) {
    if (!is_by_hand(b)) return;
    by_hand self = {b};
    const lg_space space = space_of(b);
    lg_ode ode = {.space = space, .field = hand_field, .user = &self};
    if (!is_chain(b)) {
        ode.force = hand_force, ode.velocity = hand_velocity;
        assert_ok(lg_space_init_rn(&ode.space, space.dim));
    }
    lg_stepper *expected_stepper;
    stepping s;
    double y[MOST_STATE], expected[MOST_STATE];
    const size_t d = ode.space.dim;
    assert_ok(lg_stepper_create(NULL, scheme, &ode, &expected_stepper));
    open_stepper(b, scheme, &s);
    memcpy(y, start, d * sizeof *y);
    memcpy(expected, start, d * sizeof *y);
    for (int n = 0; n < 5; n++) { /* with and without the input, in turn */
        const double *u = n % 2 == 0 ? input : NULL;
        assert_ok(lg_step(s.stepper, 0.0, 0.02, y, u, y)); /* in place */
        assert_ok(lg_step(expected_stepper, 0.0, 0.02, expected, u, expected));
        for (size_t i = 0; i < d; i++) assert_close(y[i], expected[i], 1e-13, 1e-13);
        assert_true(lg_space_manifold_error(&ode.space, y) <= 1e-14);
    }
    lg_stepper_destroy(NULL, expected_stepper);
    close_stepper(&s);
}

/* What stays on the manifold; on R^d what is not made for a group alone. */
static bool fits(const built *b, const lg_scheme *scheme) {
    if (scheme->kind == LG_SCHEME_VARIATIONAL || scheme->kind == LG_SCHEME_SLGI) return false;
    const lg_space space = space_of(b);
    if (scheme->kind == LG_SCHEME_SPLITTING) return b->hamiltonian.family->force != NULL;
    return lg_space_is_abelian(&space) || !scheme->ambient;
}

static void every_scheme_steps_or_is_refused(void **state) {
    (void)state;
    for (size_t family = 0; family < lg_hamiltonian_family_count(); family++)
        for (uint32_t links = 1; links <= 3; links++) {
            built b;
            lg_rng rng;
            double y[MOST_STATE], u[MOST_INPUT];
            build_hamiltonian(&b, lg_hamiltonian_family_at(family), links, LG_POTENTIAL_MLP, LG_SINE);
            lg_rng_seed(&rng, 7, links);
            draw_state(&b, &rng, y);
            for (size_t i = 0; i < lg_model_input_size(b.model); i++) u[i] = lg_rng_normal(&rng);
            for (size_t i = 0; i < lg_scheme_count(); i++) {
                const lg_scheme *scheme = lg_scheme_at(i);
                if (fits(&b, scheme)) {
                    check_scheme(&b, scheme, y, u);
                    continue;
                }
                lg_stepper *stepper = NULL;
                assert_int_equal(lg_model_stepper_size(b.model, scheme), 0);
                assert_status(lg_model_stepper_init(b.work, 1 << 20, b.model, scheme, &stepper),
                              LG_UNSUPPORTED);
                assert_status(lg_model_stepper_init(NULL, 0, b.model, scheme, &stepper), LG_UNSUPPORTED);
                assert_null(stepper);
            }
            build_free(&b);
        }
}

/* Classical Runge-Kutta of the ambient velocity in small steps, taken back to the manifold. */
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

/* A step with an input follows the field with that input. */
static void steps_with_inputs_integrate_the_field(void **state) {
    (void)state;
    static const char *const names[] = {"cf4", "rkmk4", "rkmk54", "stormer-verlet"};
    static const double tolerance[] = {1e-8, 1e-8, 1e-10, 1e-4};
    for (size_t family = 0; family < lg_hamiltonian_family_count(); family++)
        for (size_t i = 0; i < 4; i++) {
            built b;
            lg_rng rng;
            stepping s;
            double y[MOST_STATE], fine[MOST_STATE], u[MOST_INPUT], moved = 0.0;
            build_hamiltonian(&b, lg_hamiltonian_family_at(family), 2, LG_POTENTIAL_MLP, LG_TANH);
            if (!fits(&b, lg_scheme_find(names[i]))) {
                build_free(&b);
                continue;
            }
            lg_rng_seed(&rng, 8, 0);
            draw_state(&b, &rng, y);
            memcpy(fine, y, sizeof y);
            for (size_t j = 0; j < lg_model_input_size(b.model); j++) u[j] = lg_rng_normal(&rng);
            open_stepper(&b, lg_scheme_find(names[i]), &s);
            for (int n = 0; n < 50; n++) assert_ok(lg_step(s.stepper, 0.0, 0.01, y, u, y));
            fine_flow(&b, u, 0.5, fine);
            for (size_t j = 0; j < lg_model_inputs(b.model); j++) {
                assert_close(y[j], fine[j], tolerance[i], tolerance[i]);
                moved = fmax(moved, fabs(y[j]));
            }
            assert_true(moved > 0.1);
            close_stepper(&s);
            build_free(&b);
        }
}

static void refused_memory(void **state) {
    (void)state;
    built b;
    const lg_scheme *cf4 = lg_scheme_find("cf4");
    lg_scheme bad = *lg_scheme_find("rkmk4");
    lg_stepper *stepper = NULL;
    build_hamiltonian(&b, &lg_hamiltonian_chain, 1, LG_POTENTIAL_MLP, LG_TANH);
    const size_t bytes = lg_model_stepper_size(b.model, cf4);
    char *memory = aligned_alloc(64, (bytes + 127) / 64 * 64);
    assert_non_null(memory);
    assert_status(lg_model_stepper_init(memory, bytes - 1, b.model, cf4, &stepper), LG_INVALID_ARGUMENT);
    assert_status(lg_model_stepper_init(memory, 0, b.model, cf4, &stepper), LG_INVALID_ARGUMENT);
    assert_status(lg_model_stepper_init(NULL, bytes, b.model, cf4, &stepper), LG_INVALID_ARGUMENT);
    assert_status(lg_model_stepper_init(memory + 8, bytes, b.model, cf4, &stepper), LG_INVALID_ARGUMENT);
    assert_status(lg_model_stepper_init(memory, bytes, b.model, cf4, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_model_stepper_init(memory, bytes, NULL, cf4, &stepper), LG_INVALID_ARGUMENT);
    assert_status(lg_model_stepper_init(memory, bytes, b.model, NULL, &stepper), LG_INVALID_ARGUMENT);
    bad.b[0] += 0.5;
    assert_status(lg_model_stepper_init(memory, bytes, b.model, &bad, &stepper), LG_INVALID_ARGUMENT);
    assert_int_equal(lg_model_stepper_size(b.model, &bad), 0);
    assert_int_equal(lg_model_stepper_size(NULL, cf4) + lg_model_stepper_size(b.model, NULL), 0);
    assert_null(stepper);
    lg_model_user user;
    lg_ode ode;
    assert_status(lg_model_ode(b.model, NULL, b.work, &ode), LG_INVALID_ARGUMENT);
    assert_status(lg_model_ode(b.model, &user, b.work, NULL), LG_INVALID_ARGUMENT);
    assert_ok(lg_model_stepper_init(memory, bytes, b.model, cf4, &stepper));
    assert_non_null(stepper);
    free(memory);
    build_free(&b);
}

/* ---- what is not a number ---- */

static void assert_all_nan(const double *x, size_t n) {
    for (size_t i = 0; i < n; i++) assert_true(isnan(x[i]));
}

static void check_nan(const built *b, const double *y, const double *input) {
    const size_t d = lg_model_inputs(b->model), r = lg_model_tangent_size(b->model);
    double value = 0.0, gradient[MOST_STATE], A[MOST_TANGENT * MOST_TANGENT], next[MOST_STATE];
    bool found = false;
    lg_model_eval(b->model, y, &value, b->work);
    assert_true(isnan(value) || input != NULL);
    lg_model_jacobian(b->model, y, NULL, gradient, b->work);
    assert_ok(lg_model_linearise(b->model, y, input, A, NULL, NULL, b->work));
    for (size_t i = 0; i < r * r; i++) found = found || isnan(A[i]);
    /* Of a separable system A depends on q alone. */
    assert_true(found || (!is_chain(b) && !isnan(y[0])));
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        stepping s;
        if (!fits(b, lg_scheme_at(i))) continue;
        open_stepper(b, lg_scheme_at(i), &s);
        memset(next, 0, sizeof next);
        const lg_status status = lg_step(s.stepper, 0.0, 0.01, y, input, next);
        assert_true(status == LG_NOT_FINITE || status == LG_NO_CONVERGENCE);
        for (size_t j = 0; j < d; j++) assert_true(next[j] == 0.0);
        close_stepper(&s);
    }
}

static void nan_gives_nan(void **state) {
    (void)state;
    for (size_t family = 0; family < lg_hamiltonian_family_count(); family++)
        for (size_t at = 0; at < 2; at++) {
            built b;
            lg_rng rng;
            double y[MOST_STATE], u[MOST_INPUT] = {0}, kept;
            build_hamiltonian(&b, lg_hamiltonian_family_at(family), 2, LG_POTENTIAL_MLP, LG_TANH);
            const size_t index = at == 0 ? 0 : lg_model_inputs(b.model) - 1;
            lg_rng_seed(&rng, 9, at);
            draw_state(&b, &rng, y);
            kept = y[index];
            y[index] = NAN;
            check_nan(&b, y, NULL);
            y[index] = kept;
            u[0] = NAN;
            if (lg_model_input_size(b.model) > 0) check_nan(&b, y, u);
            build_free(&b);
        }
}

/* Also where a branch of ReLU hides the input. */
static void check_unfit(const built *b) {
    const size_t n = lg_model_inputs(b->model), m = lg_model_outputs(b->model);
    double *x = room(n), *y = room(m), *jacobian = room(m * n);
    for (size_t i = 0; i < n; i++) x[i] = 0.1 * (double)(1 + i % 7);
    for (size_t i = 0; i < n; i++) {
        const double finite = x[i];
        x[i] = i % 2 == 0 ? (double)NAN : (double)-INFINITY;
        lg_model_eval(b->model, x, y, b->work);
        assert_all_nan(y, m);
        memset(y, 0, m * sizeof *y);
        lg_model_jacobian(b->model, x, y, jacobian, b->work);
        assert_all_nan(y, m);
        assert_all_nan(jacobian, m * n);
        if (lg_model_kind_of(b->model) == LG_MODEL_HAMILTONIAN) {
            assert_ok(lg_model_field(b->model, x, NULL, jacobian, b->work));
            assert_all_nan(jacobian, n);
        }
        x[i] = finite;
    }
    free(jacobian);
    free(y);
    free(x);
}

static void one_input_makes_all_nan(void **state) {
    (void)state;
    built b;
    for (size_t family = 0; family < lg_hamiltonian_family_count(); family++) {
        build_hamiltonian(&b, lg_hamiltonian_family_at(family), 2, LG_POTENTIAL_MLP, LG_RELU);
        check_unfit(&b);
        build_free(&b);
    }
    for (int kind = 0; kind < LG_SURROGATE_KIND_COUNT; kind++) {
        build_surrogate(&b, (lg_surrogate_kind)kind);
        check_unfit(&b);
        build_free(&b);
    }
    build_detector(&b, LG_RELU);
    check_unfit(&b);
    build_free(&b);
}

static void a_singular_mass_gives_nan(void **state) {
    (void)state;
    for (uint32_t links = 1; links <= 2; links++) {
        built b;
        lg_rng rng;
        double y[MOST_STATE], value = 0.0, field[MOST_STATE], gradient[MOST_STATE],
                              A[MOST_TANGENT * MOST_TANGENT];
        build_hamiltonian(&b, &lg_hamiltonian_chain, links, LG_POTENTIAL_MLP, LG_TANH);
        const size_t n = lg_model_parameters(b.model), d = lg_model_inputs(b.model),
                     r = lg_model_tangent_size(b.model);
        for (size_t i = n - links * links - links; i < n; i++) b.theta[i] = 0.0;
        build_again(&b);
        lg_rng_seed(&rng, 10, links);
        draw_state(&b, &rng, y);
        lg_model_eval(b.model, y, &value, b.work);
        assert_true(isnan(value));
        lg_model_jacobian(b.model, y, &value, gradient, b.work);
        assert_true(isnan(value));
        assert_all_nan(gradient, d);
        assert_ok(lg_model_field(b.model, y, NULL, field, b.work));
        assert_all_nan(field, d);
        assert_ok(lg_model_linearise(b.model, y, NULL, A, NULL, NULL, b.work));
        assert_all_nan(A, r * r);
        check_nan(&b, y, NULL);
        build_free(&b);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sizes_are_those_of_the_kind),
        cmocka_unit_test(only_hamiltonians_move),
        cmocka_unit_test(inputs_act_beside_the_field),
        cmocka_unit_test(inputs_do_work),
        cmocka_unit_test(fields_keep_the_energy),
        cmocka_unit_test(linearisation_matches_differences),
        cmocka_unit_test(pendulum_at_its_equilibria),
        cmocka_unit_test(small_swings_follow_the_linearisation),
        cmocka_unit_test(deviations_are_coordinates),
        cmocka_unit_test(every_scheme_steps_or_is_refused),
        cmocka_unit_test(steps_with_inputs_integrate_the_field),
        cmocka_unit_test(refused_memory),
        cmocka_unit_test(nan_gives_nan),
        cmocka_unit_test(one_input_makes_all_nan),
        cmocka_unit_test(a_singular_mass_gives_nan),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
