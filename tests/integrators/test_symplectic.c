/* Symplecticity by the taped Jacobian, on R^2n and on T*SO(3) in right-trivialised coordinates. */
#include "mechanics/system_check.h"

#include "liegrad/ops.h"
#include "liegrad/taped.h"

/* ---- R^4: H = p1^2/2 + p2^2 + (p1 + p2)^4/8 + q1^2/2 + q2^2 + q1^2 q2/2 + q2^4/4 ---- */

static lg_var column(lg_tape *tape, lg_var x, uint32_t i) {
    return lg_slice(tape, x, 1, i, 1);
}

static lg_status force(void *user, lg_tape *tape, lg_taped_time t, lg_var q, lg_var input, lg_var *out) {
    lg_var q1 = column(tape, q, 0), q2 = column(tape, q, 1);
    lg_var first = lg_add(tape, q1, lg_mul(tape, q1, q2));
    const double weights[3] = {2.0, 0.5, 1.0};
    const lg_var terms[3] = {q2, lg_square(tape, q1), lg_pow(tape, q2, 3.0)};
    lg_var both[2] = {first, lg_linear_combination(tape, terms, weights, 3)};
    *out = lg_neg(tape, lg_concat(tape, both, 2, 1));
    return lg_tape_status(tape);
}

static lg_status mixed_velocity(void *user, lg_tape *tape, lg_taped_time t, lg_var p, lg_var input,
                                lg_var *out) {
    lg_var p1 = column(tape, p, 0), p2 = column(tape, p, 1);
    lg_var cube = lg_scale(tape, lg_pow(tape, lg_add(tape, p1, p2), 3.0), 0.5);
    lg_var both[2] = {lg_add(tape, p1, cube), lg_add(tape, lg_scale(tape, p2, 2.0), cube)};
    *out = lg_concat(tape, both, 2, 1);
    return lg_tape_status(tape);
}

TAPED_FIELD(field) {
    lg_var half[2];
    (void)mixed_velocity(user, tape, t, lg_slice(tape, y[0], 1, 2, 2), input, &half[0]);
    (void)force(user, tape, t, lg_slice(tape, y[0], 1, 0, 2), input, &half[1]);
    out[0] = lg_concat(tape, half, 2, 1);
}

enum { STEPS = 3 };

/* The Jacobian of three steps, (4, 4). */
static void flat_jacobian(const lg_scheme *scheme, double h, double *psi) {
    static const double y0[4] = {0.4, -0.9, 0.2, 0.7};
    const bool splitting = scheme->kind == LG_SCHEME_SPLITTING;
    lg_taped_ode ode = {.field = field, .force = force, .velocity = mixed_velocity};
    lg_var start[2], end[2];
    assert_ok(lg_space_init(&ode.space,
                            (lg_space_factor[]){{LG_SPACE_RN, splitting ? 2 : 4}, {LG_SPACE_RN, 2}},
                            splitting ? 2 : 1));
    lg_tape *tape = test_tape(LG_F64);
    lg_var y = lg_input(tape, lg_shape2(1, 4), y0);
    assert_ok(lg_taped_split(tape, &ode.space, y, start));
    assert_ok(lg_taped_integrate(tape, scheme, &ode, 0.0, h, STEPS, STEPS, start, end));
    assert_ok(lg_read(tape, lg_jacobian(tape, lg_taped_join(tape, &ode.space, end), y), 16, psi));
}

/* The largest element of Psi^T J Psi - J. */
static double flat_defect(const char *name, double h) {
    double psi[16], defect = 0.0;
    flat_jacobian(lg_scheme_find(name), h, psi);
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++) {
            double sum = 0.0;
            for (int l = 0; l < 2; l++)
                sum += psi[4 * l + i] * psi[4 * (l + 2) + j] - psi[4 * (l + 2) + i] * psi[4 * l + j];
            const double expected = j == i + 2 ? 1.0 : i == j + 2 ? -1.0 : 0.0;
            defect = fmax(defect, fabs(sum - expected));
            assert_true(isfinite(sum));
        }
    return defect;
}

TEST("symplectic schemes preserve the symplectic form on R^4") {
    for (size_t i = 0; i < lg_scheme_count(); i++)
        if (lg_scheme_at(i)->kind == LG_SCHEME_SPLITTING)
            assert_true(flat_defect(lg_scheme_at(i)->name, 0.1) <= 1e-14);
    assert_true(flat_defect("midpoint", 0.1) <= 1e-14);
}

TEST("other schemes do not preserve the form on R^4") {
    assert_true(flat_defect("euler", 0.1) > 1e-3);
    assert_true(flat_defect("implicit-euler", 0.1) > 1e-3);
    assert_true(flat_defect("rk4", 0.1) > 1e-7);
}

/* ---- T*SO(3): the heavy top ---- */

/* Inertia, mass, length, direction of the centre of mass, gravity. */
static const double skew_top[] = {1.0, 1.3, 0.6, 1.0, 1.0, 0.48, -0.6, 0.64, 0.0, 0.0, -9.81};

/* Three steps from (exp(e) Q0, mu0 + d): the momenta at start and end, and the tangents at the end (6, 6) in
 * the coordinates (xi, dmu) with dQ = hat(xi) Q, as derivatives by (e, d). */
typedef struct flow {
    double before[3], after[3], tangent[6][6];
} flow;

/* xi with dQ = hat(xi) Q, from column j of dQ (9, 6). */
static void angular(const double *Q, const double *dQ, int j, double xi[3]) {
    double S[3][3];
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            S[r][c] = 0.0;
            for (int l = 0; l < 3; l++) S[r][c] += dQ[6 * (3 * r + l) + j] * Q[3 * c + l];
        }
    xi[0] = 0.5 * (S[2][1] - S[1][2]);
    xi[1] = 0.5 * (S[0][2] - S[2][0]);
    xi[2] = 0.5 * (S[1][0] - S[0][1]);
}

static void top_flow(const lg_scheme *scheme, double h, flow *f) {
    static const double Q0[9] = {0.36, 0.48, -0.8, -0.8, 0.6, 0.0, 0.48, 0.64, 0.6},
                        mu0[3] = {0.7, -1.1, 2.0};
    static const double zero[6] = {0.0};
    lg_system_taped_user user;
    lg_taped_ode ode;
    lg_space rotations;
    double y1[12], jacobian[12 * 6];
    lg_var y[2], end[2];
    assert_ok(lg_space_init(&rotations, &(lg_space_factor){LG_SPACE_SO3, 1}, 1));
    lg_tape *tape = test_tape(LG_F64);
    assert_ok(lg_system_taped_ode(make_system_of("heavy-top", "cotangent", 0, skew_top), LG_COORDINATES_LIE,
                                  lg_input(tape, lg_shape1(LG_COUNT(skew_top)), skew_top), &ode, &user));
    lg_var moved = lg_input(tape, lg_shape3(1, 1, 6), zero), e = lg_slice(tape, moved, 2, 0, 3);
    lg_var Q = lg_input(tape, lg_shape3(1, 1, 9), Q0), mu = lg_input(tape, lg_shape3(1, 1, 3), mu0);
    assert_ok(lg_taped_act(tape, &rotations, &e, &Q, &y[0]));
    y[1] = lg_add(tape, mu, lg_slice(tape, moved, 2, 3, 3));
    assert_ok(lg_taped_integrate(tape, scheme, &ode, 0.0, h, STEPS, STEPS, y, end));
    lg_var joined = lg_taped_join(tape, &ode.space, end);
    assert_ok(lg_read(tape, joined, 12, y1));
    assert_ok(lg_read(tape, lg_jacobian(tape, joined, moved), 12 * 6, jacobian));
    memcpy(f->before, mu0, sizeof(mu0));
    memcpy(f->after, y1 + 9, sizeof(f->after));
    for (int j = 0; j < 6; j++) {
        angular(y1, jacobian, j, f->tangent[j]);
        for (int i = 0; i < 3; i++) f->tangent[j][3 + i] = jacobian[6 * (9 + i) + j];
    }
}

static double dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* omega((xi1, dmu1), (xi2, dmu2)) = <dmu2, xi1> - <dmu1, xi2> + sign <mu, [xi1, xi2]>. The canonical form has
 * sign -1. */
static double form(double sign, const double *mu, const double *a, const double *b) {
    const double bracket[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                               a[0] * b[1] - a[1] * b[0]};
    return dot(b + 3, a) - dot(a + 3, b) + sign * dot(mu, bracket);
}

/* The largest change of the form over all pairs of basis vectors. */
static double top_defect(const lg_scheme *scheme, double h, double sign) {
    flow f;
    double defect = 0.0;
    top_flow(scheme, h, &f);
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) {
            double a[6] = {0.0}, b[6] = {0.0};
            a[i] = b[j] = 1.0;
            const double change =
                form(sign, f.after, f.tangent[i], f.tangent[j]) - form(sign, f.before, a, b);
            assert_true(isfinite(change));
            defect = fmax(defect, fabs(change));
        }
    return defect;
}

TEST("slgi preserves the form on T*SO(3) for every theta") {
    static const double theta[] = {0.0, 0.3, 0.5, 1.0};
    for (size_t i = 0; i < sizeof(theta) / sizeof(*theta); i++) {
        lg_scheme scheme = *lg_scheme_find("slgi");
        scheme.theta = theta[i];
        const double defect = top_defect(&scheme, 0.05, -1.0);
        if (!(defect <= 1e-11)) fail_msg("theta = %g: the form changes by %.3g", theta[i], defect);
        assert_true(top_defect(&scheme, 0.05, 1.0) > 1e-2);
    }
}

TEST("other schemes do not preserve the form on T*SO(3)") {
    assert_true(top_defect(lg_scheme_find("rkmk4"), 0.05, -1.0) > 1e-8);
    assert_true(top_defect(lg_scheme_find("lie-euler"), 0.05, -1.0) > 1e-3);
}
