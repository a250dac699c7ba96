/* Constraints g(q) = 0 of a user: projections, motions, refusals, and learned Hamiltonians on T*Q.
 * ctest-labels: src/hamiltonian */
#include <float.h>
#include <math.h>

#include "support/constraints.h"
#include "support/dense_solve.h"
#include "support/model_support.h"

enum { MOST_N = 4, STATES = 6 };

/* A learned Hamiltonian with random parameters under a constraint, and states on T*Q. */
typedef struct tied {
    lg_constraint *constraint;
    lg_hamiltonian model;
    double *theta, *y;
    size_t n, m;
    built b;
} tied;

static tied make_tied(size_t i, double scale) {
    const constraint_case *of = &constraint_cases[i];
    const uint32_t hidden[1] = {8};
    tied s = {.constraint = make_constraint(of, &plain_units), .n = of->n, .m = of->m};
    assert_ok(lg_hamiltonian_init(&s.model, &lg_hamiltonian_constrained, of->n, LG_POTENTIAL_MLP, hidden, 1,
                                  LG_SWISH));
    s.model.constraint = s.constraint;
    s.model.scales = (lg_hamiltonian_scales){scale, {1.5 * scale, 0.7 * scale}};
    s.theta = TEST_ARRAY(double, lg_hamiltonian_parameters(&s.model));
    lg_rng rng = test_rng(4, i);
    lg_hamiltonian_initialise(&s.model, &rng, s.theta);
    s.y = constraint_states(s.constraint, STATES, 1.0, NULL);
    s.b = build_from(&s.model, s.theta);
    return s;
}

/* G (m, n) by differences of the program's g. */
static void normals(const tied *s, const double *q, double *G) {
    const double h = 1e-6;
    for (size_t i = 0; i < s->n; i++) {
        double at[MOST_N], up[MOST_N], down[MOST_N];
        const double *in = at;
        memcpy(at, q, s->n * sizeof *at);
        at[i] = q[i] + h;
        assert_ok(lg_program_eval(NULL, lg_constraint_program(s->constraint), "constraint", 1, &in,
                                  &(double *){up}, NULL));
        at[i] = q[i] - h;
        assert_ok(lg_program_eval(NULL, lg_constraint_program(s->constraint), "constraint", 1, &in,
                                  &(double *){down}, NULL));
        for (size_t a = 0; a < s->m; a++) G[a * s->n + i] = (up[a] - down[a]) / (2 * h);
    }
}

/* x becomes P(q) x. */
static void projected(const tied *s, const double *q, double *x) {
    double G[MOST_N * MOST_N], S[MOST_N * MOST_N], r[MOST_N], k[MOST_N];
    normals(s, q, G);
    for (size_t a = 0; a < s->m; a++) {
        r[a] = 0;
        for (size_t i = 0; i < s->n; i++) r[a] += G[a * s->n + i] * x[i];
        for (size_t b = 0; b < s->m; b++) {
            S[a * s->m + b] = 0;
            for (size_t i = 0; i < s->n; i++) S[a * s->m + b] += G[a * s->n + i] * G[b * s->n + i];
        }
    }
    dense_solve(s->m, S, r, k);
    for (size_t a = 0; a < s->m; a++)
        for (size_t i = 0; i < s->n; i++) x[i] -= G[a * s->n + i] * k[a];
}

/* L[i][j] = d(P(q) p)_i/dq_j for fixed p. */
static void turning(const tied *s, const double *q, const double *p, double *L) {
    const double h = 1e-4;
    for (size_t j = 0; j < s->n; j++) {
        double at[MOST_N], up[MOST_N], down[MOST_N];
        memcpy(at, q, s->n * sizeof *at);
        memcpy(up, p, s->n * sizeof *up);
        memcpy(down, p, s->n * sizeof *down);
        at[j] = q[j] + h;
        projected(s, at, up);
        at[j] = q[j] - h;
        projected(s, at, down);
        for (size_t i = 0; i < s->n; i++) L[i * s->n + j] = (up[i] - down[i]) / (2 * h);
    }
}

/* out += sign A x, or A^T x. */
static void add_product(size_t n, const double *A, bool transposed, double sign, const double *x,
                        double *out) {
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) out[i] += sign * A[transposed ? j * n + i : i * n + j] * x[j];
}

/* q' = P dH/dp, p' = -P dH/dq + (P L^T P + L P - P L^T) dH/dp, (4.2.1) of the thesis. */
static void general_field(const tied *s, const double *y, const double *dH, double *out) {
    const size_t n = s->n;
    double L[MOST_N * MOST_N], Pv[MOST_N], part[MOST_N] = {0}, rest[MOST_N] = {0};
    memcpy(Pv, dH + n, n * sizeof *Pv);
    projected(s, y, Pv);
    turning(s, y, y + n, L);
    memcpy(out, Pv, n * sizeof *out);
    for (size_t i = 0; i < n; i++) part[i] = -dH[i];
    add_product(n, L, true, 1, Pv, part);
    add_product(n, L, true, -1, dH + n, part);
    projected(s, y, part);
    add_product(n, L, false, 1, Pv, rest);
    for (size_t i = 0; i < n; i++) out[n + i] = part[i] + rest[i];
}

TEST("the field of a constrained Hamiltonian is the general field (4.2.1), in any scales") {
    for (size_t i = 0; i < 2 * CONSTRAINTS; i++) {
        const tied s = make_tied(i % CONSTRAINTS, i < CONSTRAINTS ? 1.0 : 1.8);
        for (size_t k = 0; k < STATES; k++) {
            const double *y = s.y + 2 * s.n * k;
            double H, dH[2 * MOST_N], field[2 * MOST_N], expected[2 * MOST_N];
            lg_model_jacobian(s.b.model, y, &H, dH, s.b.work);
            assert_ok(lg_model_field(s.b.model, y, NULL, field, s.b.work));
            general_field(&s, y, dH, expected);
            assert_all_close(field, expected, 2 * s.n, 1e-5, 1e-5);
        }
    }
}

/* The formula of dH/dq holds off the manifold too. */
TEST("the gradient of a constrained Hamiltonian agrees with differences of its value") {
    for (size_t i = 0; i < CONSTRAINTS; i++) {
        const tied s = make_tied(i, 1.3);
        lg_rng rng = test_rng(8, i);
        for (size_t k = 0; k < STATES; k++) {
            double y[2 * MOST_N], H, dH[2 * MOST_N], quotient[2 * MOST_N];
            for (size_t j = 0; j < 2 * s.n; j++) y[j] = s.y[2 * s.n * k + j] + 0.02 * lg_rng_normal(&rng);
            lg_model_jacobian(s.b.model, y, &H, dH, s.b.work);
            for (size_t j = 0; j < 2 * s.n; j++) {
                const double kept = y[j], h = 1e-5;
                y[j] = kept + h;
                const double up = energy_of(&s.b, y);
                y[j] = kept - h;
                quotient[j] = (up - energy_of(&s.b, y)) / (2 * h);
                y[j] = kept;
            }
            assert_all_close(dH, quotient, 2 * s.n, 1e-6, 1e-7);
        }
    }
}

TEST("the flow conserves the constraint, the tangency of momenta and the energy; inputs act along Q") {
    for (size_t i = 0; i < CONSTRAINTS; i++) {
        const tied s = make_tied(i, 1.0);
        const double h = 1e-5;
        for (size_t k = 0; k < STATES; k++) {
            const double *y = s.y + 2 * s.n * k;
            double f[2 * MOST_N], driven[2 * MOST_N], up[2 * MOST_N], u[MOST_N], Pu[MOST_N];
            lg_constraint_view view;
            for (size_t j = 0; j < s.n; j++) u[j] = Pu[j] = 0.3 + 0.1 * (double)j;
            assert_ok(lg_model_field(s.b.model, y, NULL, f, s.b.work));
            assert_ok(lg_model_field(s.b.model, y, u, driven, s.b.work));
            projected(&s, y, Pu);
            for (size_t j = 0; j < s.n; j++) assert_close(driven[s.n + j] - f[s.n + j], Pu[j], 1e-7, 1e-8);
            for (size_t j = 0; j < 2 * s.n; j++) up[j] = y[j] + h * f[j];
            const double change = energy_of(&s.b, up) - energy_of(&s.b, y);
            assert_ok(lg_constraint_look(s.constraint, 1.0, up, &view, NULL));
            double speed = 0;
            for (size_t j = 0; j < 2 * s.n; j++) speed = fmax(speed, fabs(f[j]));
            const double second = h * h * (1 + speed * speed);
            assert_true(view.off < 10 * second && view.across < 10 * second && fabs(change) < 100 * second);
        }
    }
}

/* ---- points ---- */

TEST("a projection lands on the manifold to rounding, moves along the normals and keeps points of it") {
    for (size_t i = 0; i < CONSTRAINTS; i++) {
        const tied s = make_tied(i, 1.0);
        lg_rng rng = test_rng(6, i);
        for (size_t k = 0; k < STATES; k++) {
            double y[2 * MOST_N], moved[2 * MOST_N], step[MOST_N];
            const double *at = s.y + 2 * s.n * k;
            lg_constraint_view before, after;
            for (size_t j = 0; j < 2 * s.n; j++) y[j] = moved[j] = at[j] + 1e-3 * lg_rng_normal(&rng);
            assert_told(lg_constraint_look(s.constraint, 1.0, y, &before, &told));
            assert_told(lg_constraint_project(s.constraint, 1.0, moved, &told));
            assert_told(lg_constraint_look(s.constraint, 1.0, moved, &after, &told));
            assert_true(after.residual < 2e-15 && after.off < 2e-15 && after.across < 1e-14);
            assert_true(before.residual > 1e-5 && before.across > 1e-6);
            double size = 0, tangent = 0;
            for (size_t j = 0; j < s.n; j++) step[j] = moved[j] - y[j], size += step[j] * step[j];
            assert_close(before.off, sqrt(size), 0.02, 0);
            projected(&s, moved, step);
            for (size_t j = 0; j < s.n; j++) tangent += step[j] * step[j];
            assert_true(sqrt(tangent) < 1e-2 * sqrt(size));
            memcpy(y, moved, sizeof y);
            assert_ok(lg_constraint_project(s.constraint, 1.0, moved, NULL));
            assert_all_close(moved, y, 2 * s.n, 1e-14, 1e-15);
        }
    }
}

/* g = (x, x + user y), whose rank measure is known. */
static lg_status slanted(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    const double *eps = user;
    const lg_var x = lg_slice(tape, q[0], 1, 0, 1), y = lg_slice(tape, q[0], 1, 1, 1);
    const lg_var rows[2] = {x, lg_add(tape, x, lg_scale(tape, y, *eps))};
    (void)theta;
    *g = lg_concat(tape, rows, 2, 1);
    return lg_tape_status(tape);
}

static lg_constraint *constraint_with(const lg_function_spec *functions, size_t count) {
    lg_program_spec spec;
    lg_program *program;
    lg_constraint *made;
    lg_program_spec_init(&spec);
    spec.functions = functions, spec.function_count = count;
    assert_told(lg_program_build(NULL, &spec, &program, &told));
    lg_test_owns(program, release_constraint_program);
    assert_told(lg_constraint_create(NULL, program, &made, &told));
    return own_constraint(made);
}

/* Builds a constraint with the potential V, or without one. */
static lg_constraint *constraint_of(lg_record_function g, void *user, uint32_t n, lg_record_function V) {
    const lg_port q = {.name = "q", .shape = lg_shape1(n), .low = 0.5, .high = 1.5}, x = {.name = "x"};
    const lg_function_spec functions[] = {{"constraint", &q, 1, &x, 1, g, user},
                                          {"potential", &q, 1, &x, 1, V, NULL}};
    return constraint_with(functions, V != NULL ? 2 : 1);
}

TEST("the rank is the smallest singular value of the rows, and dependent rows are refused with the point") {
    static const double values[] = {1.0, 1e-3, 1e-5, 1e-7, 0.0};
    const double state[6] = {0, 0.25, 3, 0, 0, 1};
    for (size_t i = 0; i < LG_COUNT(values); i++) {
        double eps = values[i];
        lg_constraint_view view;
        lg_error why = {LG_OK, ""};
        const lg_constraint *c = constraint_of(slanted, &eps, 3, NULL);
        const lg_status status = lg_constraint_look(c, 0, state, &view, &why);
        const double cosine = 1 / sqrt(1 + eps * eps);
        assert_close(view.rank, eps > 0.1 ? sqrt(1 - cosine) : eps / sqrt(2), 1e-3, 1e-16);
        assert_int_equal(status, eps > 1e-6 ? LG_OK : LG_FORMAT);
        if (status != LG_OK) assert_says(why.message, "q = (0, 0.25, 3)");
        if (status != LG_OK) assert_says(why.message, "relative smallest singular value");
    }
}

/* (|q|^2 - 1)^2, whose gradient vanishes on the sphere. */
static lg_status flat_ball(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    (void)user, (void)theta;
    *g = lg_square(tape, lg_add_scalar(tape, lg_rownorm2(tape, q[0]), -1.0));
    return lg_tape_status(tape);
}

/* The cone x^2 + y^2 = z^2 with its tip at 0. */
static lg_status cone(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    const lg_var z = lg_square(tape, lg_slice(tape, q[0], 1, 2, 1));
    (void)user, (void)theta;
    *g = lg_sub(tape, lg_rownorm2(tape, q[0]), lg_scale(tape, z, 2.0));
    return lg_tape_status(tape);
}

static lg_status plane(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    (void)user, (void)theta;
    *g = lg_slice(tape, q[0], 1, 0, 1);
    return lg_tape_status(tape);
}

/* sqrt(x) - 1, which is not finite for x < 0. */
static lg_status half_space(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    (void)user, (void)theta;
    *g = lg_add_scalar(tape, lg_sqrt(tape, lg_slice(tape, q[0], 1, 0, 1)), -1.0);
    return lg_tape_status(tape);
}

/* exp(2 x) - 1, whose second derivative overflows before the first one. */
static lg_status explosive(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    (void)user, (void)theta;
    *g = lg_add_scalar(tape, lg_exp(tape, lg_scale(tape, lg_slice(tape, q[0], 1, 0, 1), 2.0)), -1.0);
    return lg_tape_status(tape);
}

/* 1e-200 x + 1e200, whose zero is beyond the range of doubles. */
static lg_status remote(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    (void)user, (void)theta;
    *g = lg_add_scalar(tape, lg_scale(tape, lg_slice(tape, q[0], 1, 0, 1), 1e-200), 1e200);
    return lg_tape_status(tape);
}

/* x^2 + 1 */
static lg_status hollow(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    (void)user, (void)theta;
    *g = lg_add_scalar(tape, lg_square(tape, lg_slice(tape, q[0], 1, 0, 1)), 1.0);
    return lg_tape_status(tape);
}

TEST("points are refused where the constraint is flat, at a tip, and where it is not finite") {
    const struct {
        lg_record_function g;
        double state[6], size;
        lg_status status;
    } rows[] = {{flat_ball, {0.6, 0, 0.8, 0, 1, 0}, 0, LG_FORMAT},
                {flat_ball, {0.6, 0, 1.8, 0, 1, 0}, 0, LG_OK},
                {cone, {3e-7, 4e-7, 5e-7, 0, 0, 0}, 1, LG_FORMAT},
                {cone, {3e-1, 4e-1, 5e-1, 0, 0, 0}, 1, LG_OK},
                {cone, {0, 0, 0, 0, 0, 0}, 0, LG_FORMAT},
                {half_space, {1, 0, 0, 0, 0, 1}, 0, LG_OK},
                {half_space, {-1, 0, 0, 0, 0, 1}, 0, LG_NOT_FINITE},
                {explosive, {300, 0, 0, 0, 0, 1}, 0, LG_OK},
                {explosive, {354.5, 0, 0, 0, 0, 1}, 0, LG_NOT_FINITE},
                {remote, {1, 0, 0, 0, 0, 1}, 0, LG_OK},
                {plane, {0, 0, 0, 0, 1, 0}, 0, LG_OK},
                {plane, {INFINITY, 0, 0, 0, 1, 0}, 0, LG_NOT_FINITE}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_constraint_view view;
        const lg_constraint *c = constraint_of(rows[i].g, NULL, 3, NULL);
        assert_status(lg_constraint_look(c, rows[i].size, rows[i].state, &view, NULL), rows[i].status);
    }
    /* The constraint has no point near the start, or the constraint has no point at all. */
    const struct {
        lg_record_function g;
        double x;
        lg_status status;
    } lost[] = {
        {half_space, -1, LG_NOT_FINITE}, {remote, 1, LG_NO_CONVERGENCE}, {hollow, 1, LG_NO_CONVERGENCE}};
    for (size_t i = 0; i < LG_COUNT(lost); i++) {
        double away[6] = {lost[i].x, 0, 0, 0, 0, 1};
        const lg_constraint *c = constraint_of(lost[i].g, NULL, 3, NULL);
        assert_status(lg_constraint_project(c, 0, away, NULL), lost[i].status);
        assert_true(away[0] == lost[i].x && away[5] == 1);
    }
    /* The message of a long q ends in dots. */
    enum { LONG = LG_CONSTRAINT_MOST_COORDINATES };
    double many[2 * LONG] = {0};
    lg_constraint_view view;
    lg_error why = {LG_OK, ""};
    for (size_t i = 0; i < LONG; i++) many[i] = -0.12345678 * pow(10.0, -(double)(i % 2));
    double length = 0;
    for (size_t i = 0; i < LONG; i++) length += many[i] * many[i];
    for (size_t i = 0; i < LONG; i++) many[i] /= sqrt(length);
    assert_status(lg_constraint_look(constraint_of(flat_ball, NULL, LONG, NULL), 0, many, &view, &why),
                  LG_FORMAT);
    assert_says(why.message, ", ...)");
}

/* (x + 100.1)^2 - 10221.3: near the zero, steps of Newton's method are noise of some 30 roundings. */
static lg_status noisy(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    const lg_var x = lg_add_scalar(tape, lg_slice(tape, q[0], 1, 0, 1), 100.1);
    (void)user, (void)theta;
    *g = lg_add_scalar(tape, lg_square(tape, x), -10221.3);
    return lg_tape_status(tape);
}

TEST("a projection ends where steps are as small as the noise of the constraint") {
    const lg_constraint *c = constraint_of(noisy, NULL, 2, NULL);
    for (double x = 0.5; x < 1.5; x += 0.01) {
        double state[4] = {x, 0, 0, 1};
        assert_told(lg_constraint_project(c, 1.0, state, &told));
        assert_close(state[0], sqrt(10221.3) - 100.1, 0, 1e-13);
    }
}

/* ---- what is no constraint ---- */

static lg_status same(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    (void)user, (void)tape, (void)theta;
    *g = q[0];
    return LG_OK;
}

static lg_status moving_mass(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *M) {
    (void)user, (void)theta;
    *M = lg_add_scalar(tape, lg_square(tape, q[0]), 1.0);
    return lg_tape_status(tape);
}

static lg_status fixed_mass(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *M) {
    (void)theta, (void)q;
    *M = lg_input_f64(tape, lg_shape2(3, 3), user);
    return lg_tape_status(tape);
}

static lg_status squared_mass(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *M) {
    const lg_status status = fixed_mass(user, tape, theta, q, M);
    *M = lg_square(tape, *M);
    return status == LG_OK ? lg_tape_status(tape) : status;
}

static lg_status fixed_masses(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *M) {
    (void)theta, (void)q;
    *M = lg_input_f64(tape, lg_shape1(3), user);
    return lg_tape_status(tape);
}

static lg_status standing(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    (void)user, (void)theta;
    *g = lg_reshape(tape, lg_slice(tape, q[0], 1, 0, 1), lg_shape3(lg_var_shape(tape, q[0]).dims[0], 1, 1));
    return lg_tape_status(tape);
}

static lg_status doubled(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    g[1] = lg_neg(tape, q[0]);
    return flat_ball(user, tape, theta, q, g);
}

/* A constraint with this g, the potential V and the diagonal mass 2, 3, 5; q is drawn from low to high. */
static lg_constraint *with_masses(lg_record_function g, lg_record_function V, double low, double high) {
    static double masses[3] = {2, 3, 5};
    const lg_port q = {.name = "q", .shape = lg_shape1(3), .low = low, .high = high}, x = {.name = "x"};
    const lg_function_spec functions[] = {{"constraint", &q, 1, &x, 1, g, NULL},
                                          {"potential", &q, 1, &x, 1, V, NULL},
                                          {"mass", &q, 1, &x, 1, fixed_masses, masses}};
    return constraint_with(functions, 3);
}

TEST("masses may be a vector: the diagonal") {
    double H;
    assert_ok(
        lg_constraint_energy(with_masses(plane, flat_ball, -1, 1), (double[]){0, 1, 0, 0, 6, 10}, &H, NULL));
    assert_close(H, 6.0 * 6.0 / (2 * 3) + 10.0 * 10.0 / (2 * 5), 1e-14, 0);
}

TEST("if the range of q has no point of the constraint, no start is drawn and the function fails") {
    static const double ranges[][2] = {{5, 6}, {-6, -5}};
    double data[12];
    lg_error why;
    lg_trajectory_options how;
    lg_trajectory_options_init(&how);
    how.trajectories = 1, how.points = 2;
    for (size_t i = 0; i < 2; i++) {
        const lg_constraint *c = with_masses(plane, flat_ball, ranges[i][0], ranges[i][1]);
        assert_status(lg_constraint_generate(c, &how, NULL, data, NULL, &why), LG_NO_CONVERGENCE);
        assert_says(why.message, "no start with g(q) = 0 was found");
    }
}

TEST("programs that are no constraint are refused, with the function") {
    static double skew[] = {1, 0.5, 0, 0, 1, 0, 0, 0, 1}, indefinite[] = {1, 2, 0, 2, 1, 0, 0, 0, 1},
                  huge[] = {1e200, 0, 0, 0, 1e200, 0, 0, 0, 1e200};
    const lg_port q = {.name = "q", .shape = lg_shape1(3)}, two = {.name = "r", .shape = lg_shape1(2)};
    const lg_port matrix = {.name = "q", .shape = {2, {3, 3}}}, x[] = {{.name = "x"}, {.name = "z"}},
                  one = {.name = "a", .shape = {1, {1}}},
                  common = {.name = "q", .shape = {2, {1, 3}}, .shared = true},
                  many = {.name = "q", .shape = {1, {LG_CONSTRAINT_MOST_COORDINATES + 1}}};
    const lg_port both[] = {q, two};
    const struct {
        const char *name;
        const lg_port *in;
        size_t inputs;
        lg_record_function record;
        void *user;
        const char *says;
    } rows[] = {{"restraint", &q, 1, flat_ball, NULL, "constraint"},
                {"constraint", both, 2, flat_ball, NULL, "2 inputs"},
                {"constraint", &q, 1, doubled, NULL, "2 outputs"},
                {"constraint", &matrix, 1, same, NULL, "must be a vector"},
                {"constraint", &common, 1, flat_ball, NULL, "must be a vector"},
                {"constraint", &many, 1, plane, NULL, "2 to 32 are possible"},
                {"constraint", &q, 1, fixed_masses, skew, "must give a vector"},
                {"constraint", &q, 1, standing, NULL, "must give a vector"},
                {"potential", &q, 1, fixed_masses, skew, "one number"},
                {"constraint", &q, 1, same, NULL, "1 to 2 numbers"},
                {"constraint", &one, 1, same, NULL, "takes 1 numbers"},
                {"potential", &two, 1, flat_ball, NULL, "takes 2 numbers"},
                {"potential", &q, 1, same, NULL, "one number"},
                {"mass", &q, 1, flat_ball, NULL, "gives 1 numbers"},
                {"mass", &q, 1, moving_mass, NULL, "depends on q"},
                {"mass", &q, 1, fixed_mass, skew, "not symmetric"},
                {"mass", &q, 1, squared_mass, huge, "not finite"},
                {"mass", &q, 1, fixed_mass, indefinite, "not positive definite"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const bool first = strstr(rows[i].name, "straint") != NULL;
        const lg_function_spec functions[] = {{"constraint", &q, 1, x, 1, flat_ball, NULL},
                                              {rows[i].name, rows[i].in, rows[i].inputs, x,
                                               rows[i].record == doubled ? 2 : 1, rows[i].record,
                                               rows[i].user}};
        lg_program_spec spec;
        lg_program *program;
        lg_constraint *made = NULL;
        lg_error why = {LG_OK, ""};
        lg_program_spec_init(&spec);
        spec.functions = functions + (first ? 1 : 0);
        spec.function_count = first ? 1 : 2;
        assert_told(lg_program_build(NULL, &spec, &program, &told));
        const lg_status status = rows[i].user == huge ? LG_NOT_FINITE : LG_FORMAT;
        assert_status(lg_constraint_create(NULL, program, &made, &why), status);
        assert_status(lg_constraint_create(NULL, program, &made, NULL), status);
        assert_int_equal(why.status, status);
        assert_says(why.message, rows[i].says);
        assert_null(made);
        lg_program_destroy(program);
    }
}

TEST("motions need a potential, and their settings are checked") {
    double y[12] = {1, 0, 0, 0, 0.5, 0}, out[24];
    const double t[2] = {0, 1};
    const lg_constraint *still = constraint_of(cone, NULL, 3, NULL);
    const lg_constraint *c = make_constraint(&constraint_cases[0], &plain_units);
    lg_trajectory_options how;
    lg_trajectory_options_init(&how);
    how.trajectories = 1, how.points = 2;
    assert_false(lg_constraint_moves(still));
    assert_status(lg_constraint_energy(still, y, out, NULL), LG_UNSUPPORTED);
    assert_status(lg_constraint_rattle(still, 2, 0.1, 1, 1, y, out, NULL), LG_UNSUPPORTED);
    assert_status(lg_constraint_flow(still, 1e-6, t, 2, y, out, NULL), LG_UNSUPPORTED);
    assert_status(lg_constraint_generate(still, &how, NULL, out, NULL, NULL), LG_UNSUPPORTED);
    assert_status(lg_constraint_rattle(c, 3, 0.1, 1, 1, y, out, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_constraint_rattle(c, 2, 0.0, 1, 1, y, out, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_constraint_rattle(c, 2, 0.1, 0, 1, y, out, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_constraint_rattle(c, 2, 0.1, 3, 2, y, out, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_constraint_rattle(c, 2, INFINITY, 1, 1, y, out, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_constraint_rattle(c, 2, 0.1, 1, 0, y, out, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_constraint_rattle(c, 2, 1e200, 1, 1, y, out, NULL), LG_NO_CONVERGENCE);
    lg_trajectory_options bad[8];
    for (size_t i = 0; i < LG_COUNT(bad); i++) bad[i] = how;
    bad[0].points = 1, bad[1].size = 3, bad[2].t_end = 0, bad[3].t_end = INFINITY, bad[4].low = 1;
    bad[5].high = INFINITY, bad[6].noise = -1, bad[7].noise = INFINITY;
    for (size_t i = 0; i < LG_COUNT(bad); i++)
        assert_status(lg_constraint_generate(c, &bad[i], NULL, out, NULL, NULL), LG_INVALID_ARGUMENT);
    how.noise_kind = (lg_noise)(LG_NOISE_UNIFORM + 1);
    assert_status(lg_constraint_generate(c, &how, NULL, out, NULL, NULL), LG_INVALID_ARGUMENT);
}

/* sqrt(y + 2) */
static lg_status steep(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *V) {
    (void)user, (void)theta;
    *V = lg_sqrt(tape, lg_add_scalar(tape, lg_slice(tape, q[0], 1, 1, 1), 2.0));
    return lg_tape_status(tape);
}

/* The energy does not tell where the normals are dependent; a field that is not finite ends a flow. */
TEST("motions fail where the constraint is singular or the field is not finite") {
    const double y[6] = {0, -3, 0, 0, 0.5, 0}, t[2] = {0, 1};
    double out[12], H;
    lg_error why = {LG_OK, ""};
    assert_status(lg_constraint_flow(with_masses(plane, steep, -1, 1), 1e-6, t, 2, y, out, &why),
                  LG_NOT_FINITE);
    assert_says(why.message, "from time 0 and q = (0, -3, 0)");
    const constraint_case flat = {"flat", flat_ball, hill, NULL, 3, 1};
    const double pole[6] = {1, 0, 0, 0, 0.5, 0};
    assert_ok(lg_constraint_energy(make_constraint(&flat, &plain_units), pole, &H, NULL));
    assert_true(isnan(H));
}

static lg_status move(const lg_context *context, const lg_program *program) {
    lg_constraint *c = NULL;
    lg_trajectory_options how;
    double data[2 * 2 * 6], y[6] = {1, 0, 0, 0, 0.5, 0}, *out = TEST_ARRAY(double, 12);
    lg_trajectory_options_init(&how);
    how.trajectories = 1, how.points = 2;
    how.trajectories = 2;
    lg_status status = lg_constraint_create(context, program, &c, NULL);
    if (status == LG_OK) status = lg_constraint_generate(c, &how, NULL, data, NULL, NULL);
    if (status == LG_OK) status = lg_constraint_rattle(c, 2, 1e-4, 1024, 1024, y, out, NULL);
    lg_constraint_destroy(c);
    return status;
}

TEST("samples and steps can be cancelled, and every allocation may fail") {
    lg_program *program = make_constraint_program(&constraint_cases[0], &plain_units);
    volatile int cancel = 0;
    lg_context_options options;
    lg_context *context;
    lg_constraint *c;
    lg_trajectory_options how;
    double y[6] = {1, 0, 0, 0, 0.5, 0}, out[12];
    lg_context_options_init(&options);
    options.cancel = &cancel;
    assert_ok(lg_context_create(&options, &context));
    lg_test_owns(context, release_context);
    assert_ok(lg_constraint_create(context, program, &c, NULL));
    own_constraint(c);
    lg_trajectory_options_init(&how);
    how.trajectories = 1, how.points = 2;
    cancel = 1;
    assert_status(lg_constraint_generate(c, &how, NULL, out, NULL, NULL), LG_CANCELLED);
    assert_ok(lg_constraint_rattle(c, 2, 1e-4, 1023, 1023, y, out, NULL));
    assert_status(lg_constraint_rattle(c, 2, 1e-4, 1024, 1024, y, out, NULL), LG_CANCELLED);
    EVERY_ALLOCATION_FAILS(failing, 8, { status = move(failing, program); });
}

/* ---- motions ---- */

TEST("the exact flow is projected at each of the times, however loose its tolerance is") {
    for (size_t i = 0; i < CONSTRAINTS; i++) {
        const tied s = make_tied(i, 1.0);
        const double times[] = {0, 0.7, 1.4};
        double path[3 * 2 * MOST_N];
        assert_told(lg_constraint_flow(s.constraint, 1e-3, times, 3, s.y, path, &told));
        for (size_t k = 1; k < 3; k++) {
            lg_constraint_view view;
            assert_told(lg_constraint_look(s.constraint, 1.0, path + 2 * s.n * k, &view, &told));
            assert_true(view.residual < 2e-15 && view.across < 1e-13);
        }
    }
}

/* By differences along the flow: P (M q'' + dV/dq) = 0, and p = P M q'. */
TEST("the exact flow obeys Newton's equations with forces along the normals") {
    for (size_t i = 0; i < CONSTRAINTS; i++) {
        const tied s = make_tied(i, 1.0);
        const size_t n = s.n, d = 2 * n;
        const double h = 1e-3, times[] = {0, h, 2 * h};
        double path[3 * 2 * MOST_N], M[16] = {0}, force[MOST_N], in[MOST_N];
        assert_ok(lg_constraint_flow(s.constraint, 1e-13, times, 3, s.y, path, NULL));
        for (size_t j = 0; j < n; j++) M[j * (n + 1)] = 1;
        const double *q = path + d;
        double *out = M;
        if (constraint_cases[i].M != NULL)
            assert_ok(lg_program_eval(NULL, lg_constraint_program(s.constraint), "mass", 1, &q, &out, NULL));
        for (size_t j = 0; j < n; j++) {
            double up, down;
            const double *at = in;
            memcpy(in, q, sizeof in);
            in[j] = q[j] + h;
            assert_ok(lg_program_eval(NULL, lg_constraint_program(s.constraint), "potential", 1, &at,
                                      &(double *){&up}, NULL));
            in[j] = q[j] - h;
            assert_ok(lg_program_eval(NULL, lg_constraint_program(s.constraint), "potential", 1, &at,
                                      &(double *){&down}, NULL));
            force[j] = (up - down) / (2 * h);
        }
        double velocity[MOST_N], momentum[MOST_N] = {0};
        for (size_t j = 0; j < n; j++) {
            velocity[j] = (path[2 * d + j] - path[j]) / (2 * h);
            const double rate = (path[2 * d + j] - 2 * path[d + j] + path[j]) / (h * h);
            for (size_t k = 0; k < n; k++)
                force[k] += M[k * n + j] * rate, momentum[k] += M[k * n + j] * velocity[j];
        }
        projected(&s, q, force);
        projected(&s, q, momentum);
        for (size_t j = 0; j < n; j++) assert_close(force[j], 0, 0, 2e-4);
        for (size_t j = 0; j < n; j++) assert_close(momentum[j], path[d + n + j], 1e-4, 1e-4);
    }
}

static double distance(const double *a, const double *b, size_t n) {
    double sum = 0;
    for (size_t i = 0; i < n; i++) sum += (a[i] - b[i]) * (a[i] - b[i]);
    return sqrt(sum);
}

TEST("RATTLE has order 2, and 4 when composed") {
    for (size_t i = 0; i < CONSTRAINTS; i++)
        for (int order = 2; order <= 4; order += 2) {
            const tied s = make_tied(i, 1.0);
            const double times[] = {0, 0.5};
            double exact[4 * MOST_N], out[4 * MOST_N];
            fit_line line = {0};
            assert_told(lg_constraint_flow(s.constraint, 1e-13, times, 2, s.y, exact, &told));
            for (size_t steps = 8; steps <= 256; steps *= 2) {
                assert_told(lg_constraint_rattle(s.constraint, order, 0.5 / (double)steps, steps, steps, s.y,
                                                 out, &told));
                const double error = distance(out + 2 * s.n, exact + 2 * s.n, 2 * s.n);
                if (error < 1e-11) continue;
                fit_add(&line, log2((double)steps), -log2(error));
            }
            print_message("  %-8s order %.3f\n", constraint_cases[i].name, fit_slope(&line));
            assert_close(fit_slope(&line), order, 0, 0.2);
        }
}

TEST("RATTLE stays on the manifold to rounding, and its energy in a band") {
    for (size_t i = 0; i < CONSTRAINTS; i++) constraint_long_run(i, 5000);
}

TEST("RATTLE is refused beyond a right angle of the normals, and where the rank drops") {
    const lg_constraint *c = make_constraint(&constraint_cases[0], &plain_units);
    const double y[6] = {1, 0, 0, 0, 1, 0};
    double out[12];
    lg_error why = {LG_OK, ""};
    assert_told(lg_constraint_rattle(c, 2, 0.5, 1, 1, y, out, &told));
    assert_status(lg_constraint_rattle(c, 2, 3.0, 1, 1, y, out, &why), LG_NO_CONVERGENCE);
    assert_says(why.message, "q = (1, 0, 0)");
    /* The potential throws the point to the other side, where Newton's method finds a root. */
    const double thrown[6] = {1, 0, 0, 0, 0.1, 0.7};
    assert_told(lg_constraint_rattle(c, 2, 0.8, 1, 1, thrown, out, &told));
    assert_status(lg_constraint_rattle(c, 2, 1.6, 1, 1, thrown, out, &why), LG_NO_CONVERGENCE);
    const constraint_case flat = {"flat", flat_ball, hill, NULL, 3, 1};
    assert_status(lg_constraint_rattle(make_constraint(&flat, &plain_units), 2, 0.1, 1, 1, y, out, &why),
                  LG_FORMAT);
    assert_says(why.message, "loses rank at q = (1, 0, 0)");
}

/* V = 0 */
static lg_status level(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *V) {
    (void)user, (void)theta;
    *V = lg_scale(tape, lg_slice(tape, q[0], 1, 0, 1), 0.0);
    return lg_tape_status(tape);
}

/* cos(a) (|(q_0, q_1)|^2 - 1) + sin(a) (|(q_2, q_3)|^2 - 1) for two angles a. */
static lg_status two_circles(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    const double *angle = user;
    lg_var x[4], rows[2];
    for (uint32_t i = 0; i < 4; i++) x[i] = lg_slice(tape, q[0], 1, i, 1);
    const lg_var both[2] = {circle(tape, x[0], 0, x[1], 0, 1), circle(tape, x[2], 0, x[3], 0, 1)};
    for (size_t i = 0; i < 2; i++)
        rows[i] = lg_linear_combination(tape, both, (double[]){cos(angle[i]), sin(angle[i])}, 2);
    (void)theta;
    *g = lg_concat(tape, rows, 2, 1);
    return lg_tape_status(tape);
}

/* In a step h a free point on a circle with the angular velocity w turns by asin(h w). */
TEST("RATTLE moves two free points on circles exactly, however the equations mix the circles") {
    enum { STEPS = 3 };
    const double h = 0.5;
    lg_rng rng = test_rng(11, 0);
    for (int i = 0; i < 300; i++) {
        double angle[2], w[2], y[8] = {1, 0, 1, 0}, out[(STEPS + 1) * 8];
        for (size_t k = 0; k < 2; k++) {
            angle[k] = lg_rng_uniform_in(&rng, 0.0, 3.14);
            w[k] = lg_rng_uniform_in(&rng, -1.98, 1.98);
            y[5 + 2 * k] = w[k];
        }
        if (fabs(sin(angle[0] - angle[1])) < 0.1) continue;
        const lg_constraint *c = constraint_of(two_circles, angle, 4, level);
        assert_told(lg_constraint_rattle(c, 2, h, STEPS, 1, y, out, &told));
        for (size_t j = 0; j <= STEPS; j++)
            for (size_t k = 0; k < 2; k++) {
                const double turn = (double)j * asin(h * w[k]), *q = out + 8 * j + 2 * k;
                assert_close(q[0], cos(turn), 0, 1e-12);
                assert_close(q[1], sin(turn), 0, 1e-12);
                assert_close(q[4], -w[k] * sin(turn), 0, 1e-11);
                assert_close(q[5], w[k] * cos(turn), 0, 1e-11);
            }
    }
}

/* x y, whose two lines cross at 0. */
static lg_status crossing(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    (void)user, (void)theta;
    *g = lg_mul(tape, lg_slice(tape, q[0], 1, 0, 1), lg_slice(tape, q[0], 1, 1, 1));
    return lg_tape_status(tape);
}

/* (x + y, x - y) */
static lg_status pinned(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    const lg_var x = lg_slice(tape, q[0], 1, 0, 1), y = lg_slice(tape, q[0], 1, 1, 1);
    const lg_var rows[2] = {lg_add(tape, x, y), lg_sub(tape, x, y)};
    (void)user, (void)theta;
    *g = lg_concat(tape, rows, 2, 1);
    return lg_tape_status(tape);
}

TEST("RATTLE is refused next to a crossing, where no point is near, and with masses of a ratio of 1e40") {
    static double masses[3] = {1, 1e40, 1};
    const lg_port q = {.name = "q", .shape = lg_shape1(3)}, x = {.name = "x"};
    const lg_function_spec uneven[] = {{"constraint", &q, 1, &x, 1, pinned, NULL},
                                       {"potential", &q, 1, &x, 1, level, NULL},
                                       {"mass", &q, 1, &x, 1, fixed_masses, masses}};
    const struct {
        const lg_constraint *c;
        double y[6], h;
        lg_status status;
        const char *says;
    } rows[] = {
        {constraint_of(crossing, NULL, 3, level), {1, 0, 0, -1, 0, 0}, 0.5, LG_OK, ""},
        {constraint_of(crossing, NULL, 3, level), {1, 0, 0, -1, 0, 0}, 1 - 1e-8, LG_FORMAT, "time 1: "},
        {constraint_of(remote, NULL, 3, level), {1, 0, 0, 0, 1, 0}, 0.5, LG_NO_CONVERGENCE, "time 0: "},
        {constraint_with(uneven, 3), {0, 0, 1, 0, 0, 1}, 0.5, LG_FORMAT, "singular at q = (0, 0, 1)"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        double out[12];
        lg_error why = {LG_OK, ""};
        assert_status(lg_constraint_rattle(rows[i].c, 2, rows[i].h, 1, 1, rows[i].y, out, &why),
                      rows[i].status);
        assert_says(why.message, rows[i].says);
    }
}

TEST("units of q and g change results by rounding only") {
    static const constraint_units units[] = {{1e9, 1e-9}, {1e-9, 1e9}, {1e9, 1.0}, {1.0, 1e-9}};
    for (size_t i = 0; i < CONSTRAINTS * LG_COUNT(units); i++) {
        const constraint_case *of = &constraint_cases[i % CONSTRAINTS];
        const constraint_units *in = &units[i / CONSTRAINTS];
        const lg_constraint *plain = make_constraint(of, &plain_units), *scaled = make_constraint(of, in);
        const size_t d = 2 * of->n;
        const double L = in->length;
        double *a = constraint_states(plain, STATES, 1.0, NULL),
               *b = constraint_states(scaled, STATES, L, NULL);
        double one[4 * MOST_N], other[4 * MOST_N];
        lg_constraint_view va, vb;
        for (size_t k = 0; k < STATES * d; k++) assert_close(b[k] / L, a[k], 1e-12, 1e-13);
        assert_ok(lg_constraint_look(plain, 0, a, &va, NULL));
        assert_ok(lg_constraint_look(scaled, 0, b, &vb, NULL));
        assert_close(va.rank, vb.rank, 1e-9, 0);
        assert_ok(lg_constraint_rattle(plain, 4, 0.01, 100, 100, a, one, NULL));
        assert_ok(lg_constraint_rattle(scaled, 4, 0.01, 100, 100, b, other, NULL));
        for (size_t k = 0; k < d; k++) assert_close(other[d + k] / L, one[d + k], 1e-10, 1e-11);
    }
}

TEST("samples lie on T*Q, have their energies, and depend on seed and number only") {
    const lg_constraint *c = make_constraint(&constraint_cases[1], &plain_units);
    enum { N = 8, M = 4, D = 6 };
    double t[M], data[N * M * D], energies[N], rest[3 * M * D], noisy[N * M * D];
    lg_trajectory_options how;
    lg_trajectory_options_init(&how);
    how.trajectories = 1, how.points = 2;
    how.trajectories = N, how.points = M, how.t_end = 0.6, how.seed = 9;
    assert_told(lg_constraint_generate(c, &how, t, data, energies, &told));
    assert_close(t[M - 1], 0.6, 1e-15, 0);
    for (size_t k = 0; k < (size_t)N * M; k++) {
        double H;
        lg_constraint_view view;
        assert_told(lg_constraint_look(c, 1.0, data + k * D, &view, &told));
        assert_ok(lg_constraint_energy(c, data + k * D, &H, NULL));
        assert_true(view.off < 2e-15);
        assert_close(H, energies[k / M], 1e-11, 1e-11);
    }
    how.first = 5, how.trajectories = 3;
    assert_ok(lg_constraint_generate(c, &how, NULL, rest, NULL, NULL));
    assert_memory_equal(rest, data + 5 * M * D, sizeof rest);
    how.first = 0, how.trajectories = N, how.noise = 1e-2;
    assert_ok(lg_constraint_generate(c, &how, NULL, noisy, NULL, NULL));
    double sum = 0;
    for (size_t k = 0; k < (size_t)N * M * D; k++) sum += (noisy[k] - data[k]) * (noisy[k] - data[k]);
    assert_memory_equal(noisy, data, D * sizeof *noisy);
    assert_close(sqrt(sum / (N * (M - 1) * D)), 1e-2, 0.2, 0);
    /* Noise of the first point, which is projected, does not change the noise of the others. */
    double *first = TEST_ARRAY(double, N *M *D), moved = 0;
    lg_constraint_view view;
    how.noise_first = true;
    assert_ok(lg_constraint_generate(c, &how, NULL, first, NULL, NULL));
    assert_memory_equal(first + D, noisy + D, (M - 1) * D * sizeof *first);
    assert_ok(lg_constraint_look(c, 1.0, first, &view, NULL));
    for (size_t k = 0; k < D; k++) moved = fmax(moved, fabs(first[k] - data[k]));
    assert_true(view.off < 2e-15 && moved > 1e-4 && moved < 0.1);
    how.noise_first = false, how.noise_kind = LG_NOISE_UNIFORM;
    assert_ok(lg_constraint_generate(c, &how, NULL, noisy, NULL, NULL));
    for (size_t k = 0; k < (size_t)N * M * D; k++) assert_true(fabs(noisy[k] - data[k]) <= 1e-2 + 1e-15);
}

/* ---- learning ---- */

TEST("a learned model has its constraint, potential and mass as functions, with the energy of the model") {
    for (size_t i = 0; i < CONSTRAINTS; i++) {
        const tied s = make_tied(i, 1.6);
        lg_constraint *again;
        double m[16], M[16], *out = M;
        const double *q = s.y;
        assert_told(lg_constraint_create(NULL, lg_model_program(s.b.model), &again, &told));
        own_constraint(again);
        for (size_t k = 0; k < STATES; k++) {
            double H;
            assert_ok(lg_constraint_energy(again, s.y + 2 * s.n * k, &H, NULL));
            assert_close(H, energy_of(&s.b, s.y + 2 * s.n * k), 1e-11, 1e-11);
        }
        assert_ok(lg_hamiltonian_mass(&s.model, s.theta, m));
        assert_ok(lg_program_eval(NULL, lg_model_program(s.b.model), "mass", 1, &q, &out, NULL));
        assert_all_close(M, m, s.n * s.n, 1e-11, 1e-11);
    }
}

static lg_var loss_at(lg_tape *tape, const lg_fit_problem *fit, lg_var theta) {
    const uint32_t samples[STATES] = {0, 1, 2, 3, 4, 5};
    lg_var loss;
    assert_ok(fit->loss(fit->user, tape, theta, samples, STATES, STATES, &loss));
    return loss;
}

TEST("the gradient of the training loss agrees with differences") {
    for (size_t i = 0; i < CONSTRAINTS; i++) {
        tied s = make_tied(i, 1.0);
        const uint32_t count = (uint32_t)lg_hamiltonian_parameters(&s.model);
        const size_t d = 2 * s.n;
        double *data = TEST_ARRAY(double, 3 * STATES * d), *moved = TEST_ARRAY(double, count);
        double *gradient = TEST_ARRAY(double, count), up = 0, down = 0, slope = 0;
        lg_trajectory_options how;
        lg_trajectory_options_init(&how);
        how.trajectories = 1, how.points = 2;
        how.trajectories = STATES, how.points = 3, how.t_end = 0.2;
        assert_ok(lg_constraint_generate(s.constraint, &how, NULL, data, NULL, NULL));
        const lg_hamiltonian_problem problem = {.model = &s.model,
                                                .scheme = lg_scheme_find("rk4"),
                                                .substeps = 1,
                                                .trajectories = STATES,
                                                .points = 3,
                                                .dt = 0.1,
                                                .data = data};
        lg_fit_problem fit;
        lg_hamiltonian_fit_problem(&problem, &fit);
        lg_tape *tape = test_tape(LG_F64);
        lg_var theta = lg_input_f64(tape, lg_shape1(count), s.theta), g;
        assert_ok(lg_grad(tape, loss_at(tape, &fit, theta), &theta, 1, &g));
        assert_ok(lg_read(tape, g, count, gradient));
        const double *direction = test_numbers(3, count, -1.0, 1.0), h = 1e-6;
        for (uint32_t k = 0; k < count; k++) slope += gradient[k] * direction[k];
        for (uint32_t k = 0; k < count; k++) moved[k] = s.theta[k] + h * direction[k];
        assert_ok(lg_read(tape, loss_at(tape, &fit, lg_input_f64(tape, lg_shape1(count), moved)), 1, &up));
        for (uint32_t k = 0; k < count; k++) moved[k] = s.theta[k] - h * direction[k];
        assert_ok(lg_read(tape, loss_at(tape, &fit, lg_input_f64(tape, lg_shape1(count), moved)), 1, &down));
        assert_close(slope, (up - down) / (2 * h), 1e-6, 1e-8);
        assert_true(fabs(slope) > 1e-6);
    }
}

TEST("units of q and g change the training loss by rounding only") {
    static const constraint_units units[] = {{1.0, 1.0}, {1e9, 1e-9}, {1e-9, 1e9}};
    for (size_t i = 0; i < CONSTRAINTS; i++) {
        double loss[LG_COUNT(units)];
        for (size_t u = 0; u < LG_COUNT(units); u++) {
            tied s = make_tied(i, 1.0);
            const uint32_t count = (uint32_t)lg_hamiltonian_parameters(&s.model);
            double *data = TEST_ARRAY(double, 3 * STATES * 2 * s.n);
            lg_trajectory_options how;
            lg_trajectory_options_init(&how);
            how.trajectories = 1, how.points = 2;
            how.trajectories = STATES, how.points = 3, how.t_end = 0.2, how.low = -units[u].length;
            how.high = units[u].length;
            s.model.constraint = make_constraint(&constraint_cases[i], &units[u]);
            assert_ok(lg_constraint_generate(s.model.constraint, &how, NULL, data, NULL, NULL));
            lg_hamiltonian_problem problem = {.model = &s.model,
                                              .scheme = lg_scheme_find("rk4"),
                                              .substeps = 1,
                                              .trajectories = STATES,
                                              .points = 3,
                                              .dt = 0.1,
                                              .data = data};
            assert_told(lg_hamiltonian_find_scales(&problem, &s.model.scales, &told));
            assert_told(lg_hamiltonian_weigh(&problem, &told));
            lg_fit_problem fit;
            lg_hamiltonian_fit_problem(&problem, &fit);
            lg_tape *tape = test_tape(LG_F64);
            const lg_var theta = lg_input_f64(tape, lg_shape1(count), s.theta);
            assert_ok(lg_read(tape, loss_at(tape, &fit, theta), 1, &loss[u]));
            assert_close(loss[u], loss[0], 1e-9, 0);
        }
        assert_true(loss[0] > 1e-9);
    }
}

TEST("training needs measured starts") {
    tied s = make_tied(1, 1.0);
    lg_hamiltonian_problem problem = {.model = &s.model,
                                      .scheme = lg_scheme_find("rk4"),
                                      .substeps = 1,
                                      .trajectories = 3,
                                      .points = 2,
                                      .dt = 0.1,
                                      .data = s.y};
    lg_error why = {LG_OK, ""};
    assert_told(lg_hamiltonian_problem_check(&problem, &told));
    problem.starts = LG_START_ESTIMATED;
    assert_status(lg_hamiltonian_problem_check(&problem, &why), LG_UNSUPPORTED);
    assert_says(why.message, "leave the constraint");
}
