/* Properties of every system of the table, at random parameters and random states on the manifold: the forms
 * of the field agree with each other, plain and on tapes of both types; invariants are constant along the
 * field; the field follows from the energy by the structure that the system states. A new system is tested
 * without changes here. lg-gradcheck compares the derivatives of every taped field, by states and parameters,
 * with differences. Here derivatives are central differences of order 8 along the action of the space, so
 * that no state leaves the manifold. */
#include "mechanics/system_check.h"

#include <float.h>

#include "liegrad/ops.h"

#include "mechanics/system.h"

enum { BATCH = 3, SEEDS = 3 };
static const size_t some_links[] = {1, 2, 3, 5};
static const double delays[BATCH] = {0.3, -0.2, 0.9}; /* added to the time of each row of a batch */

static double *take(size_t count) {
    return TEST_ARRAY(double, count);
}

/* ---- samples ---- */

typedef struct sample {
    char label[96];
    lg_system *system;
    const lg_space *space;
    lg_rng rng;
    double t, *work, *y; /* y (BATCH, dim) is on the manifold */
    size_t dim, algebra, parameters;
} sample;

static void draw(lg_rng *rng, size_t count, double *out) {
    for (size_t i = 0; i < count; i++) out[i] = lg_rng_uniform_in(rng, -1, 1);
}

static void normalise(size_t count, double *x) {
    double square = 0.0;
    for (size_t i = 0; i < count; i++) square += x[i] * x[i];
    for (size_t i = 0; i < count; i++) x[i] /= sqrt(square);
}

/* Draws numbers that the rule allows. */
static void draw_parameter(lg_rng *rng, lg_parameter_rule rule, size_t count, double *out) {
    for (size_t i = 0; i < count; i++) {
        const double sign = rule != LG_PARAMETER_POSITIVE && lg_rng_below(rng, 2) == 0 ? -1.0 : 1.0;
        out[i] = sign * lg_rng_uniform_in(rng, 0.5, 2);
    }
    if (rule == LG_PARAMETER_UNIT_VECTOR) normalise(count, out);
}

static lg_system *draw_system(lg_rng *rng, const char *name, const char *form, size_t links) {
    size_t count = 0;
    for (const lg_parameter_entry *row = lg_system_parameters(name, form); row->key; row++)
        count += system_numbers(row, links);
    double *numbers = take(count), *at = numbers;
    for (const lg_parameter_entry *row = lg_system_parameters(name, form); row->key; row++) {
        draw_parameter(rng, row->rule, system_numbers(row, links), at);
        at += system_numbers(row, links);
    }
    return make_system_of(name, form, links, numbers);
}

static lg_status try_field(const sample *s, lg_coordinates form, double t, const double *y, double *out) {
    lg_system_user user;
    lg_ode ode;
    assert_ok(lg_system_ode(s->system, form, &ode, &user, s->work));
    return ode.field(ode.user, t, y, NULL, out);
}

static void plain(const sample *s, lg_coordinates form, const double *y, double *out) {
    const lg_status status = try_field(s, form, s->t, y, out);
    if (status != LG_OK) fail_msg("%s: the plain field: %s", s->label, lg_status_name(status));
}

/* Draws random numbers and projects them. Draws again if they have no projection (determinant -1) or no field
 * there. */
static void draw_state(sample *s, double *y) {
    double *f = take(s->algebra);
    for (int tries = 0; tries < 1000; tries++) {
        draw(&s->rng, s->dim, y);
        lg_space_project(s->space, y);
        if (!(lg_space_manifold_error(s->space, y) <= 1e-12)) continue;
        if (try_field(s, LG_COORDINATES_LIE, s->t, y, f) == LG_OK) return;
    }
    fail_msg("%s: no state on the manifold where the field is defined", s->label);
}

static void open_sample(sample *s, const char *name, const char *form, size_t links, uint64_t seed) {
    (void)snprintf(s->label, sizeof s->label, "%s%s%s, %zu links, seed %d", name, form ? " " : "",
                   form ? form : "", links, (int)seed);
    lg_rng_seed(&s->rng, seed, links);
    s->system = draw_system(&s->rng, name, form, links);
    s->space = lg_system_space(s->system);
    s->t = lg_rng_uniform_in(&s->rng, -1, 1);
    s->dim = lg_system_dim(s->system);
    s->algebra = s->space->algebra_dim;
    s->parameters = lg_system_parameter_count(s->system);
    s->work = take(lg_system_work_size(s->system) / sizeof(double));
    s->y = take(BATCH * s->dim);
    for (size_t b = 0; b < BATCH; b++) draw_state(s, s->y + b * s->dim);
}

static bool has_links(const char *name, const char *form) {
    for (const lg_state_entry *row = lg_system_state(name, form); row->key; row++)
        if (row->outer == 0) return true;
    return false;
}

static void on_every_sample(void (*check)(sample *s)) {
    const char *name, *form;
    sample s;
    for (size_t i = 0; lg_system_at(i, &name, &form); i++)
        for (size_t k = 0; k < (has_links(name, form) ? LG_COUNT(some_links) : 1); k++)
            for (uint64_t seed = 1; seed <= SEEDS; seed++) {
                const size_t mark = lg_test_owned();
                open_sample(&s, name, form, has_links(name, form) ? some_links[k] : 0, seed);
                check(&s);
                lg_test_give_back(mark);
            }
}

static double largest(size_t count, const double *x) {
    double size = 0.0;
    for (size_t i = 0; i < count; i++) size = fmax(size, isnan(x[i]) ? INFINITY : fabs(x[i]));
    return size;
}

/* Fails unless the numbers are equal to the absolute tolerance. */
static void same(const sample *s, const char *what, size_t count, const double *a, const double *b,
                 double tolerance) {
    for (size_t i = 0; i < count; i++)
        if (!(fabs(a[i] - b[i]) <= tolerance))
            fail_msg("%s: %s, number %zu: %.17g and %.17g, difference %.3g, tolerance %.3g", s->label, what,
                     i, a[i], b[i], a[i] - b[i], tolerance);
}

/* ---- recording on a tape ---- */

static lg_status call_half(lg_taped_half_field half, const lg_taped_ode *ode, lg_tape *tape, double t,
                           lg_var x, lg_var *out) {
    return half(ode->user, tape, (lg_taped_time){.value = t}, x, LG_NONE, out);
}

typedef struct recording {
    lg_tape *tape;
    lg_var parameters, y; /* (P), (BATCH, dim) */
    lg_system_taped_user user;
    lg_taped_ode ode;
} recording;

static lg_status try_recording(const sample *s, lg_coordinates form, lg_dtype dtype, const double *y,
                               recording *r) {
    r->tape = test_tape(dtype);
    r->parameters =
        lg_input_f64(r->tape, lg_shape1((uint32_t)s->parameters), lg_system_parameter_values(s->system));
    r->y = lg_input_f64(r->tape, lg_shape2(BATCH, (uint32_t)s->dim), y);
    return lg_system_taped_ode(s->system, form, r->parameters, &r->ode, &r->user);
}

/* Joins the parts side by side, (BATCH, numbers). */
static lg_var flat(lg_tape *tape, lg_var *parts, size_t count) {
    for (size_t i = 0; i < count; i++) {
        const size_t numbers = lg_shape_count(lg_var_shape(tape, parts[i]));
        parts[i] = lg_reshape(tape, parts[i], lg_shape2(BATCH, (uint32_t)(numbers / BATCH)));
    }
    return lg_concat(tape, parts, count, 1);
}

/* Records the field; each row has its own time. */
static lg_var record_field(const sample *s, recording *r) {
    lg_var y[LG_TAPED_MAX_PARTS], out[LG_TAPED_MAX_PARTS];
    const lg_taped_time t = {.value = s->t, .rows = lg_input_f64(r->tape, lg_shape2(BATCH, 1), delays)};
    assert_ok(lg_taped_split(r->tape, &r->ode.space, r->y, y));
    const lg_status status = r->ode.field(r->ode.user, r->tape, t, y, LG_NONE, out);
    if (status != LG_OK) fail_msg("%s: %s", s->label, lg_tape_message(r->tape));
    return flat(r->tape, out, lg_taped_parts(&r->ode.space));
}

static void read_out(const sample *s, const recording *r, lg_var x, size_t count, double *out) {
    if (lg_tape_status(r->tape) != LG_OK) fail_msg("%s: %s", s->label, lg_tape_message(r->tape));
    assert_ok(lg_read(r->tape, x, count, out));
}

/* The plain field at the rows of y (BATCH, dim), each row at its own time, in the order of the parts. */
static void plain_rows(const sample *s, lg_coordinates form, const double *y, double *out) {
    const size_t n = form == LG_COORDINATES_LIE ? s->algebra : s->dim;
    double *row = take(n);
    for (size_t b = 0; b < BATCH; b++) {
        assert_ok(try_field(s, form, s->t + delays[b], y + b * s->dim, row));
        if (form == LG_COORDINATES_LIE)
            algebra_in_parts(s->space, row, out + b * n);
        else
            memcpy(out + b * n, row, n * sizeof *row);
    }
}

static void compare_forms(const sample *s, lg_coordinates form, const char *what, const double *y) {
    static const double tolerance[] = {[LG_F64] = 1e-12, [LG_F32] = 1e-3};
    const size_t n = BATCH * (form == LG_COORDINATES_LIE ? s->algebra : s->dim);
    double *expected = take(n), *taped = take(n);
    plain_rows(s, form, y, expected);
    for (int dtype = LG_F64; dtype <= LG_F32; dtype++) {
        recording r;
        assert_ok(try_recording(s, form, (lg_dtype)dtype, y, &r));
        read_out(s, &r, record_field(s, &r), n, taped);
        same(s, what, n, taped, expected, tolerance[dtype] * largest(n, expected));
    }
}

static void taped_field(sample *s) {
    compare_forms(s, LG_COORDINATES_LIE, "the field on a tape", s->y);
}

/* ---- ambient field ---- */

/* Compares the ambient field with the generator of the LIE field, for each row. */
static void compare_generator(const sample *s, const char *what, const double *y) {
    double *f = take(s->algebra), *generated = take(s->dim), *ambient = take(s->dim);
    for (size_t b = 0; b < BATCH; b++) {
        plain(s, LG_COORDINATES_LIE, y + b * s->dim, f);
        lg_space_generator(s->space, f, y + b * s->dim, generated);
        plain(s, LG_COORDINATES_AMBIENT, y + b * s->dim, ambient);
        same(s, what, s->dim, ambient, generated, 1e-12 * largest(s->dim, generated));
    }
}

/* Compares with the generator on the manifold. Unless the ambient field is an extension (row->extended), also
 * off the manifold and on a tape. */
static void ambient_field(sample *s) {
    double *off = take(BATCH * s->dim);
    compare_generator(s, "the ambient field", s->y);
    if (s->system->row->extended) {
        recording r;
        assert_status(try_recording(s, LG_COORDINATES_AMBIENT, LG_F64, s->y, &r), LG_UNSUPPORTED);
        return;
    }
    draw(&s->rng, BATCH * s->dim, off);
    for (size_t i = 0; i < BATCH * s->dim; i++) off[i] = s->y[i] + 0.05 * off[i];
    compare_generator(s, "the ambient field off the manifold", off);
    compare_forms(s, LG_COORDINATES_AMBIENT, "the ambient field on a tape", s->y);
    compare_forms(s, LG_COORDINATES_AMBIENT, "the ambient field on a tape off the manifold", off);
}

/* ---- force and velocity of separable systems ---- */

/* Compares one half of the field (BATCH, n), plain and on a tape, with `expected`. */
static void compare_half(const sample *s, const char *what, const double *x, const double *expected,
                         lg_half_field half, void *user, lg_taped_half_field taped, recording *r) {
    const size_t n = s->dim / 2;
    const double tolerance = 1e-12 * largest(BATCH * n, expected);
    double *found = take(BATCH * n);
    lg_var out = LG_NONE;
    for (size_t b = 0; b < BATCH; b++) assert_ok(half(user, s->t, x + b * n, NULL, found + b * n));
    same(s, what, BATCH * n, found, expected, tolerance);
    assert_ok(call_half(taped, &r->ode, r->tape, s->t,
                        lg_input_f64(r->tape, lg_shape2(BATCH, (uint32_t)n), x), &out));
    read_out(s, r, out, BATCH * n, found);
    same(s, what, BATCH * n, found, expected, tolerance);
}

/* For separable systems y' = (velocity(p), force(q)) must be the field. */
static void halves(sample *s) {
    const size_t n = s->dim / 2;
    const bool separable = lg_system_separable(s->system);
    double *x[2] = {take(BATCH * n), take(BATCH * n)}, *rate[2] = {take(BATCH * n), take(BATCH * n)};
    double *f = take(s->dim);
    lg_system_user user;
    lg_ode ode;
    recording r;
    assert_ok(lg_system_ode(s->system, LG_COORDINATES_AMBIENT, &ode, &user, s->work));
    assert_ok(try_recording(s, LG_COORDINATES_LIE, LG_F64, s->y, &r));
    if ((ode.force != NULL) != separable || (ode.velocity != NULL) != separable ||
        (r.ode.force != NULL) != separable || (r.ode.velocity != NULL) != separable)
        fail_msg("%s: separable %d, but force %d and velocity %d, on a tape %d and %d", s->label, separable,
                 ode.force != NULL, ode.velocity != NULL, r.ode.force != NULL, r.ode.velocity != NULL);
    for (size_t b = 0; separable && b < BATCH; b++) {
        plain(s, LG_COORDINATES_LIE, s->y + b * s->dim, f);
        for (size_t half = 0; half < 2; half++) {
            memcpy(x[half] + b * n, s->y + b * s->dim + half * n, n * sizeof *f);
            memcpy(rate[half] + b * n, f + half * n, n * sizeof *f);
        }
    }
    if (separable) {
        compare_half(s, "velocity", x[1], rate[0], ode.velocity, ode.user, r.ode.velocity, &r);
        compare_half(s, "force", x[0], rate[1], ode.force, ode.user, r.ode.force, &r);
    }
}

/* ---- differences ---- */

/* Central differences of order 6 and 8: f'(0) h = sum_k w_k (f(k h) - f(-k h)). Their distance, and the
 * rounding of f, bound the error of order 8. */
#define STEP 0.015625
static const double sixth[4] = {3.0 / 4, -3.0 / 20, 1.0 / 60, 0.0},
                    eighth[4] = {4.0 / 5, -1.0 / 5, 4.0 / 105, -1.0 / 280};

typedef double (*curve)(const void *of, double s);

typedef struct derivative {
    double value, error;
} derivative;

static derivative difference(curve f, const void *of, double h) {
    double low = 0.0, high = 0.0;
    /* lower bound of the size of the terms of f, as states and parameters have the size 1 */
    double size = 1.0;
    for (int k = 1; k <= 4; k++) {
        const double ahead = f(of, h * k), behind = f(of, -h * k);
        low += sixth[k - 1] * (ahead - behind) / h;
        high += eighth[k - 1] * (ahead - behind) / h;
        size = fmax(size, fmax(fabs(ahead), fabs(behind)));
    }
    return (derivative){high, fabs(high - low) + 32.0 * DBL_EPSILON * size / h};
}

/* f'(0): the best result of a few steps from `h` down; short steps are for steep f. */
static derivative derivative_of(curve f, const void *of, double h) {
    derivative best = {NAN, INFINITY};
    for (int i = 0; i < 3; i++, h /= 8.0) {
        const derivative now = difference(f, of, h);
        if (now.error < best.error) best = now;
    }
    return best;
}

typedef double (*scalar)(const void *of, const double *y);

/* The function s -> f(exp(s a) . y). */
typedef struct orbit {
    const sample *s;
    scalar f;
    const void *of;
    const double *y, *a;
} orbit;

static double on_orbit(const void *of, double by) {
    const orbit *o = of;
    const size_t mark = lg_test_owned();
    double *element = take(o->s->algebra), *moved = take(o->s->dim);
    for (size_t i = 0; i < o->s->algebra; i++) element[i] = by * o->a[i];
    lg_space_act(o->s->space, element, o->y, moved);
    const double value = o->f(o->of, moved);
    lg_test_give_back(mark);
    return value;
}

/* d/ds f(exp(s a) . y) at s = 0. *error gets its error. */
static double slope(const sample *s, scalar f, const void *of, const double *y, const double *a,
                    double *error) {
    const orbit o = {s, f, of, y, a};
    const double norm = largest(s->algebra, a);
    const derivative d = norm > 0.0 ? derivative_of(on_orbit, &o, STEP / norm) : (derivative){0.0, 0.0};
    *error = d.error;
    return d.value;
}

/* The slopes along the basis of the algebra. *error gets the largest of their errors. */
static void slopes(const sample *s, scalar f, const void *of, const double *y, double *out, double *error) {
    const size_t mark = lg_test_owned();
    double *basis = take(s->algebra), own;
    memset(basis, 0, s->algebra * sizeof *basis);
    *error = 0.0;
    for (size_t i = 0; i < s->algebra; i++) {
        basis[i] = 1.0;
        out[i] = slope(s, f, of, y, basis, &own);
        *error = fmax(*error, own);
        basis[i] = 0.0;
    }
    lg_test_give_back(mark);
}

/* ---- invariants ---- */

typedef struct quantity {
    const sample *s;
    size_t index;
} quantity;

static double invariant(const void *of, const double *y) {
    const quantity *q = of;
    return lg_system_invariant(q->s->system, q->index, y, q->s->work);
}

/* The slope along the field must be zero within its error and the rounding of the terms that it is a sum
 * of. */
static void check_invariant(const sample *s, size_t index, const double *y) {
    const size_t mark = lg_test_owned();
    const quantity q = {s, index};
    double *f = take(s->algebra), *along = take(s->algebra), error, others, size = 0.0;
    plain(s, LG_COORDINATES_LIE, y, f);
    slopes(s, invariant, &q, y, along, &others);
    for (size_t i = 0; i < s->algebra; i++) size += fabs(along[i] * f[i]);
    const double rate = slope(s, invariant, &q, y, f, &error);
    if (!(error <= 1e-7 * (size + largest(s->algebra, f))))
        fail_msg("%s: %s is too rough for differences, error %.3g", s->label,
                 lg_system_invariant_name(s->system, index), error);
    if (!(fabs(rate) <= 2.0 * error + 1e-11 * size))
        fail_msg("%s: %s changes along the field at the rate %.3g, terms of %.3g, error %.3g", s->label,
                 lg_system_invariant_name(s->system, index), rate, size, error);
    lg_test_give_back(mark);
}

static void invariants(sample *s) {
    for (size_t i = 0; i < lg_system_invariants(s->system); i++)
        for (size_t b = 0; b < BATCH; b++) check_invariant(s, i, s->y + b * s->dim);
}

/* ---- the field from the energy ---- */

static double generating(const void *of, const double *y) {
    const sample *s = of;
    return s->system->row->generating ? s->system->row->generating(s->system, y, s->work)
                                      : lg_system_hamiltonian(s->system, y, s->work);
}

static void cross(const double *a, const double *b, double *out) {
    for (int i = 0; i < 3; i++) out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

/* Functions that compute the velocity {y, H} for `copies` of a factor from the slopes d of H along the basis
 * of the factor's algebra. */

/* d = (dH/dq, dH/dp). */
static void canonical(size_t copies, const double *y, const double *d, double *out) {
    const size_t n = copies / 2;
    assert_true(copies == 2 * n);
    for (size_t i = 0; i < n; i++) {
        out[i] = d[n + i];
        out[n + i] = -d[i];
    }
}

/* Along (u, 0) q and p rotate, along (0, v) p changes by v x q: f = (d_v, -d_u). */
static void cotangent_sphere(size_t copies, const double *y, const double *d, double *out) {
    for (size_t i = 0; i < copies; i++, y += 6, d += 6, out += 6) {
        const double f[6] = {d[3], d[4], d[5], -d[0], -d[1], -d[2]};
        lg_space_kind_entry(LG_SPACE_TS2)->generator(1, f, y, out);
    }
}

/* For (R, pi): R' = hat(dH/dpi) R, pi' = -(slope of H when R alone rotates) + dH/dpi x pi. */
static void rotation_and_momentum(const double *y, const double *turn, const double *velocity, double *out) {
    lg_space_kind_entry(LG_SPACE_SO3)->generator(1, velocity, y, out);
    cross(velocity, y + 9, out + 9);
    for (int i = 0; i < 3; i++) out[9 + i] -= turn[i];
}

/* Along (u, 0) pi rotates too, which adds pi x dH/dpi to the slope. */
static void cotangent_rotations(size_t copies, const double *y, const double *d, double *out) {
    for (size_t i = 0; i < copies; i++, y += 12, d += 6, out += 12) {
        double turn[3];
        cross(y + 9, d + 3, turn);
        for (int c = 0; c < 3; c++) turn[c] = d[c] - turn[c];
        rotation_and_momentum(y, turn, d + 3, out);
    }
}

/* SO(3) and the R^3 that follows it: pi stays constant while R rotates. */
static void product_rotations(size_t copies, const double *y, const double *d, double *out) {
    assert_true(copies == 1);
    rotation_and_momentum(y, d, d + 3, out);
}

/* d = y x dH/dy = y'. */
static void body_momentum(size_t copies, const double *y, const double *d, double *out) {
    memcpy(out, d, 3 * copies * sizeof *out);
}

/* d_u = G x dH/dG + P x dH/dP = P', d_v = G x dH/dP = G'. */
static void body_momenta(size_t copies, const double *y, const double *d, double *out) {
    for (size_t i = 0; i < copies; i++, d += 6, out += 6) {
        memcpy(out, d + 3, 3 * sizeof *out);
        memcpy(out + 3, d, 3 * sizeof *out);
    }
}

static const struct {
    void (*velocity)(size_t copies, const double *y, const double *d, double *out);
    size_t factors; /* number of factors that it uses: this one, for SO(3) also the R^3 that follows */
} brackets[LG_SPACE_KINDS] = {
    [LG_SPACE_RN] = {canonical, 1},           [LG_SPACE_TS2] = {cotangent_sphere, 1},
    [LG_SPACE_SO3] = {product_rotations, 2},  [LG_SPACE_SE3] = {cotangent_rotations, 1},
    [LG_SPACE_SO3_DUAL] = {body_momentum, 1}, [LG_SPACE_SE3_DUAL] = {body_momenta, 1},
};

/* Whether this factor R^n has the positions and the next one their momenta. */
static bool is_first_of_pair(const lg_space *space, size_t f) {
    const lg_space_factor *at = &space->factor[f];
    return f + 1 < space->factors && at->kind == LG_SPACE_RN && at[1].kind == LG_SPACE_RN &&
           at[1].count == at->count;
}

/* {y, H} for the whole product. */
static void bracket_velocity(const sample *s, const double *y, const double *d, double *out) {
    for (size_t f = 0; f < s->space->factors;) {
        const lg_space_factor *factor = &s->space->factor[f];
        const bool pair = is_first_of_pair(s->space, f);
        const size_t taken = pair ? 2 : brackets[factor->kind].factors,
                     copies = factor->count * (pair ? 2 : 1);
        const lg_space_factor *next = taken == 2 && f + 1 < s->space->factors ? factor + 1 : NULL;
        if (taken == 0 || (taken == 2 && !pair && !(next && next->kind == LG_SPACE_RN && next->count == 3)))
            fail_msg("%s: the test has no bracket on this space", s->label);
        brackets[factor->kind].velocity(copies, y, d, out);
        for (size_t i = 0; i < taken; i++, f++) {
            const lg_space_entry *row = lg_space_kind_entry(s->space->factor[f].kind);
            y += s->space->factor[f].count * row->state;
            d += s->space->factor[f].count * row->algebra;
            out += s->space->factor[f].count * row->state;
        }
    }
}

static void check_hamiltonian(const sample *s, const double *y) {
    double *d = take(s->algebra), *f = take(s->algebra), *found = take(s->dim), *expected = take(s->dim),
           error;
    slopes(s, generating, s, y, d, &error);
    bracket_velocity(s, y, d, expected);
    plain(s, LG_COORDINATES_LIE, y, f);
    lg_space_generator(s->space, f, y, found);
    const double size = largest(s->dim, found) + largest(s->algebra, d);
    if (!(error <= 1e-8 * size)) fail_msg("%s: the energy is too rough for differences", s->label);
    same(s, "the field and {y, H}", s->dim, found, expected, 8.0 * error * (1.0 + largest(s->dim, y)));
}

/* ---- Euler-Lagrange equations ---- */

/* A state of `copies` blocks, each with `lead` numbers of position followed by as many of velocity. */
typedef struct tangent {
    size_t lead, copies;
    bool sphere;
} tangent;

static tangent tangent_of(const sample *s, const lg_space_factor *factor) {
    if (factor->kind == LG_SPACE_RN && factor->count % 2 == 0) return (tangent){factor->count / 2, 1, false};
    if (factor->kind != LG_SPACE_TS2) fail_msg("%s: the test has no Lagrangian on this space", s->label);
    return (tangent){3, factor->count, true};
}

/* K - V = H(q, v) - 2 H(q, 0). */
static double lagrangian(const void *of, const double *y) {
    const sample *s = of;
    const size_t mark = lg_test_owned();
    double *still = take(s->dim), *x = still;
    memcpy(still, y, s->dim * sizeof *still);
    for (size_t f = 0; f < s->space->factors; f++) {
        const tangent t = tangent_of(s, &s->space->factor[f]);
        for (size_t i = 0; i < t.copies; i++, x += 2 * t.lead) memset(x + t.lead, 0, t.lead * sizeof *x);
    }
    const double value = generating(s, y) - 2.0 * generating(s, still);
    lg_test_give_back(mark);
    return value;
}

/* Component `component` of the momentum of the copy whose state and algebra begin at `place`. On R^n it is
 * dL/dv; on TS^2 it is the derivative along the rotation of q, (d_v L) x q, as omega changes by v x q. */
typedef struct momentum_of {
    const sample *s;
    tangent t;
    size_t place, component;
} momentum_of;

static double slope_in_velocity(const momentum_of *m, const double *y, size_t component) {
    const size_t mark = lg_test_owned();
    double *basis = take(m->s->algebra), error;
    memset(basis, 0, m->s->algebra * sizeof *basis);
    basis[m->place + m->t.lead + component] = 1.0;
    const double value = slope(m->s, lagrangian, m->s, y, basis, &error);
    lg_test_give_back(mark);
    return value;
}

static double momentum(const void *of, const double *y) {
    const momentum_of *m = of;
    if (!m->t.sphere) return slope_in_velocity(m, y, m->component);
    const size_t a = (m->component + 1) % 3, b = (m->component + 2) % 3;
    return slope_in_velocity(m, y, a) * y[m->place + b] - slope_in_velocity(m, y, b) * y[m->place + a];
}

/* The momentum must change by the slope of L along the rotation (or shift) of the position, and q' must be
 * omega x q (or v). */
static void check_copy(momentum_of m, const double *y, const double *f, const double *velocity,
                       const double *d) {
    const sample *s = m.s;
    double *rate = take(m.t.lead), *moved = take(m.t.lead), error = 0.0, own;
    for (m.component = 0; m.component < m.t.lead; m.component++) {
        rate[m.component] = slope(s, momentum, &m, y, f, &own);
        error = fmax(error, own);
    }
    const double size = largest(m.t.lead, d + m.place) + largest(m.t.lead, rate);
    same(s, "the change of a momentum and dL/dq", m.t.lead, rate, d + m.place, 8.0 * error + 1e-9 * size);
    if (!(error <= 1e-6 * size)) fail_msg("%s: the energy is too rough for differences", s->label);
    memcpy(moved, y + m.place + m.t.lead, m.t.lead * sizeof *moved);
    if (m.t.sphere) cross(y + m.place + 3, y + m.place, moved);
    same(s, "q' and the velocity in the state", m.t.lead, velocity + m.place, moved,
         1e-13 * largest(m.t.lead, moved));
}

static void check_lagrangian(const sample *s, const double *y) {
    double *d = take(s->algebra), *f = take(s->algebra), *velocity = take(s->dim), error;
    plain(s, LG_COORDINATES_LIE, y, f);
    lg_space_generator(s->space, f, y, velocity);
    slopes(s, lagrangian, s, y, d, &error);
    momentum_of m = {.s = s, .place = 0};
    for (size_t i = 0; i < s->space->factors; i++) {
        m.t = tangent_of(s, &s->space->factor[i]);
        for (size_t copy = 0; copy < m.t.copies; copy++, m.place += 2 * m.t.lead)
            check_copy(m, y, f, velocity, d);
    }
}

/* A system with an energy must state how its field follows from it. */
static void structure(sample *s) {
    static void (*const check[])(const sample *, const double *) = {
        [LG_STRUCTURE_HAMILTONIAN] = check_hamiltonian,
        [LG_STRUCTURE_LAGRANGIAN] = check_lagrangian,
        [LG_STRUCTURE_OTHER] = NULL,
    };
    const lg_structure stated = s->system->row->structure;
    const char *first = lg_system_invariant_name(s->system, 0);
    const bool energy = first && strcmp(first, "energy") == 0;
    if (energy != (stated != LG_STRUCTURE_UNSTATED))
        fail_msg("%s: %s", s->label,
                 energy ? "has an energy, and its row does not state a structure"
                        : "has no energy, and its row states a structure");
    assert_true(stated < LG_COUNT(check));
    for (size_t b = 0; check[stated] && b < BATCH; b++) check[stated](s, s->y + b * s->dim);
}

/* ---- the variational step ---- */

/* The derivative of the step by h at h = 0 must be the field. */
static void variational_step(sample *s) {
    double *velocity = take(s->dim), *side[2] = {take(s->dim), take(s->dim)}, *rate = take(s->dim);
    lg_system_user user;
    lg_ode ode;
    assert_ok(lg_system_ode(s->system, LG_COORDINATES_AMBIENT, &ode, &user, s->work));
    if (!ode.step) return;
    plain(s, LG_COORDINATES_AMBIENT, s->y, velocity);
    const double h = STEP / (1.0 + largest(s->dim, velocity));
    memset(rate, 0, s->dim * sizeof *rate);
    for (int k = 1; k <= 4; k++) {
        for (int i = 0; i < 2; i++) {
            memcpy(side[i], s->y, s->dim * sizeof *rate);
            assert_ok(ode.step(ode.user, s->t, (i == 0 ? h : -h) * k, side[i]));
        }
        for (size_t i = 0; i < s->dim; i++) rate[i] += eighth[k - 1] * (side[0][i] - side[1][i]) / h;
    }
    same(s, "the variational step and the field", s->dim, rate, velocity, 1e-8 * largest(s->dim, velocity));
}

/* ---- the tests ---- */

TEST("every field on a tape of either type agrees with the plain field, with a time for each row") {
    on_every_sample(taped_field);
}

TEST("every ambient field is the generator of the field, also on a tape and off the manifold") {
    on_every_sample(ambient_field);
}

TEST("separable systems, and no others, have a velocity and a force that together are the field") {
    on_every_sample(halves);
}

TEST("every invariant is constant along the field") {
    on_every_sample(invariants);
}

TEST("every field follows from the energy by the structure that the system states") {
    on_every_sample(structure);
}

TEST("the derivative of every variational step at h = 0 is the field") {
    on_every_sample(variational_step);
}
