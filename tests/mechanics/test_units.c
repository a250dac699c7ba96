/* No unit is special: every system of the table, in other units of mass, length and time, has the same
 * relative error at the same tolerance. The table gives the units of parameters; the units of the parts of a
 * state are listed below.
 * ctest-labels: src/mechanics */
#include "mechanics/system_check.h"

#include "liegrad/ensemble.h"

enum { MASS, LENGTH, TIME, UNITS };
static const char *const unit_names[UNITS] = {"kg", "m", "s"};

/* ---- texts of units: "kg m^2", "m/s^2", "1/s" ---- */

/* The size of the unit `text` when kg, m and s have the sizes scale[]. */
static double read_unit(const char *text, const double scale[UNITS]) {
    double factor = 1.0;
    int sign = 1;
    for (const char *at = text; *at != '\0';) {
        int power = 1, unit = 0;
        if (*at == '/') sign = -1;
        if (*at == '/' || *at == ' ' || *at == '1') {
            at++;
            continue;
        }
        while (unit < UNITS && strncmp(at, unit_names[unit], strlen(unit_names[unit])) != 0) unit++;
        if (unit == UNITS) fail_msg("unknown unit '%s'", text);
        at += strlen(unit_names[unit]);
        if (*at == '^') power = (int)strtol(at + 1, (char **)&at, 10);
        factor *= pow(scale[unit], sign * power);
    }
    return factor;
}

/* The unit of a parameter: the text after the last comma of its meaning. Angles and directions have no
 * unit. */
static double parameter_unit(const lg_parameter_entry *p, const double scale[UNITS]) {
    const char *comma = strrchr(p->meaning, ',');
    const bool none = p->rule == LG_PARAMETER_UNIT_VECTOR || p->rule == LG_PARAMETER_ANGLE;
    return none || comma == NULL ? 1.0 : read_unit(comma + 2, scale);
}

static const struct {
    const char *key, *unit;
    bool moves; /* true: the part is zero at rest */
} state_units[] = {
    {"q", "", false},         {"R", "", false},          {"Q", "", false},         {"omega", "1/s", true},
    {"Omega", "1/s", true},   {"p", "kg m^2/s", true},   {"mu", "kg m^2/s", true}, {"pi", "kg m^2/s", true},
    {"Pi", "kg m^2/s", true}, {"Gamma", "m/s^2", false}, {"y", "m", false},        {"v", "m/s", true},
};

static size_t state_unit(const char *key) {
    for (size_t i = 0; i < LG_COUNT(state_units); i++)
        if (strcmp(state_units[i].key, key) == 0) return i;
    fail_msg("the unit of '%s' is not known here", key);
    return 0;
}

/* ---- a problem and its conversion to other units ---- */

enum { DIM = 48, PARAMETERS = 32, MEMBERS = 3 };
typedef struct problem {
    const char *name, *form;
    size_t links, dim, reported;
    double parameters[PARAMETERS], y0[DIM], t_end;
} problem;

/* The unit of number i of a part. The cart of a cart-pole is the only line among angles. */
static double number_unit(const problem *p, const lg_state_entry *s, size_t i, const double scale[UNITS]) {
    if (strcmp(p->name, "cart-pole") == 0 && i == 0)
        return read_unit(s->key[0] == 'q' ? "m" : "kg m/s", scale);
    return read_unit(state_units[state_unit(s->key)].unit, scale);
}

static void convert_state(const problem *p, const double scale[UNITS], const double *from, double *to) {
    memcpy(to, from, p->dim * sizeof(*to));
    for (const lg_state_entry *s = lg_system_state(p->name, p->form); s->key; s++)
        for (size_t block = 0; block < (s->outer > 0 ? s->outer : p->links); block++)
            for (size_t i = 0; i < s->rows * s->columns; i++)
                to[s->first + block * s->stride + i] /= number_unit(p, s, i, scale);
}

static problem convert(const problem *p, const double scale[UNITS]) {
    problem out = *p;
    double *at = out.parameters;
    for (const lg_parameter_entry *row = lg_system_parameters(p->name, p->form); row->key; row++)
        for (size_t i = 0; i < system_numbers(row, p->links); i++) *at++ /= parameter_unit(row, scale);
    convert_state(p, scale, p->y0, out.y0);
    out.t_end /= scale[TIME];
    return out;
}

/* Draws numbers of size 1 that the rules allow. */
static void draw_parameters(problem *p, lg_rng *rng) {
    double *at = p->parameters;
    for (const lg_parameter_entry *row = lg_system_parameters(p->name, p->form); row->key; row++)
        for (size_t i = 0; i < system_numbers(row, p->links); i++, at++)
            *at = row->fallback && row->count > 0 ? row->fallback[i] : lg_rng_uniform_in(rng, 0.8, 1.2);
}

static void draw_state(problem *p, lg_rng *rng, bool rest) {
    for (const lg_state_entry *s = lg_system_state(p->name, p->form); s->key; s++)
        for (size_t block = 0; block < (s->outer > 0 ? s->outer : p->links); block++) {
            double *to = p->y0 + s->first + block * s->stride;
            const size_t unit = state_unit(s->key), n = s->rows * s->columns;
            const double size = state_units[unit].moves && rest ? 0.0 : 1.0;
            for (size_t i = 0; i < n; i++) to[i] = size * lg_rng_uniform_in(rng, -1, 1);
            if (n == 9) random_rotation(rng, to);
        }
}

/* Draws a start in motion, or at rest. */
static problem draw_problem(const char *name, const char *form, size_t links, bool rest) {
    problem p = {.name = name, .form = form, .links = links, .t_end = 1.5};
    lg_rng rng = test_rng(3, links);
    draw_parameters(&p, &rng);
    const lg_system *system = make_system_of(name, form, links, p.parameters);
    p.dim = lg_system_dim(system);
    p.reported = lg_system_reported(system);
    draw_state(&p, &rng, rest);
    lg_space_project(lg_system_space(system), p.y0);
    return p;
}

static void solve(const problem *p, const lg_scheme *scheme, double rtol, double *out) {
    const lg_system *system = make_system_of(p->name, p->form, p->links, p->parameters);
    lg_system_user user;
    lg_ode ode;
    lg_stepper *stepper = NULL;
    lg_step_controller control;
    lg_step_controller_init(&control);
    assert_true(control.atol < 0.0);
    control.atol *= rtol / control.rtol;
    control.rtol = rtol;
    assert_ok(lg_system_ode(system, lg_system_coordinates_for(scheme), &ode, &user,
                            test_work(lg_system_work_size(system))));
    assert_ok(lg_stepper_create(NULL, scheme, &ode, &stepper));
    lg_test_owns(stepper, (void (*)(void *))lg_stepper_destroy);
    assert_ok(lg_integrate_adaptive(stepper, &control, 0.0, p->y0, &p->t_end, 1, out, NULL));
}

/* The largest error of a group of numbers relative to its size, in the units of p. */
static double error_of(const problem *p, const double *y, const double *exact) {
    double worst = 0.0;
    for (const lg_state_entry *s = lg_system_state(p->name, p->form); s->key; s++)
        for (size_t block = 0; block < (s->outer > 0 ? s->outer : p->links); block++) {
            const size_t at = s->first + block * s->stride;
            double error = 0.0, size = 0.0;
            for (size_t i = at; i < at + s->rows * s->columns; i++) {
                error = fmax(error, fabs(y[i] - exact[i]));
                size = fmax(size, fabs(exact[i]));
            }
            assert_true(isfinite(error));
            if (error > 0.0) worst = fmax(worst, error / size);
        }
    return worst;
}

/* ---- the same problem computed by an ensemble ---- */

static lg_status put_start(void *user, uint64_t member, double *y, double *parameters) {
    const problem *p = user;
    memcpy(y, p->y0, p->dim * sizeof(*y));
    return LG_OK;
}

typedef struct kept {
    double y[MEMBERS * DIM];
} kept;

static lg_status keep_end(void *user, const lg_ensemble_block *block) {
    kept *out = user;
    for (size_t m = 0; m < block->members; m++) {
        assert_status(block->member[m].status, LG_OK);
        for (size_t i = 0; i < block->dim; i++)
            out->y[m * block->dim + i] = block->states[i * block->room + m];
    }
    return LG_OK;
}

static void solve_in_lanes(const problem *p, const lg_scheme *scheme, double rtol, double *out) {
    const lg_system *system = make_system_of(p->name, p->form, p->links, p->parameters);
    lg_ensemble_options o;
    lg_error error;
    kept all;
    lg_ensemble_options_init(&o);
    o.members = MEMBERS;
    o.scheme = scheme;
    o.times = &p->t_end;
    o.count = 1;
    o.control.atol *= rtol / o.control.rtol;
    o.control.rtol = rtol;
    if (lg_ensemble_run(NULL, system, &o, put_start, (void *)(uintptr_t)p, keep_end, &all, NULL, &error) !=
        LG_OK)
        fail_msg("%s", error.message);
    memcpy(out, all.y, p->dim * sizeof(*out));
}

/* ---- the comparison ---- */

typedef void (*solver)(const problem *p, const lg_scheme *scheme, double rtol, double *out);

static double worst_ratio;

static void compare(const problem *p, const lg_scheme *scheme, double rtol, solver how, const double *exact,
                    size_t unit, double scale) {
    double scales[UNITS] = {1.0, 1.0, 1.0}, y[DIM], other[DIM], back[UNITS];
    scales[unit] = scale;
    for (int i = 0; i < UNITS; i++) back[i] = 1.0 / scales[i];
    how(p, scheme, rtol, y);
    const problem converted = convert(p, scales);
    how(&converted, scheme, rtol, other);
    convert_state(p, back, other, other);
    const double before = error_of(p, y, exact), after = error_of(p, other, exact);
    const double ratio = fmax(after / before, before / after);
    worst_ratio = fmax(worst_ratio, ratio);
    if (!(ratio <= 3.0))
        fail_msg("%s %s, %zu links, %s: error %.2e, and %.2e in units of %g %s", p->name,
                 p->form ? p->form : "", p->links, scheme->name, before, after, scale, unit_names[unit]);
}

static bool applies(const problem *p, const lg_scheme *scheme) {
    const lg_system *system = make_system_of(p->name, p->form, p->links, p->parameters);
    lg_system_user user;
    lg_ode ode;
    assert_ok(lg_system_ode(system, lg_system_coordinates_for(scheme), &ode, &user,
                            test_work(lg_system_work_size(system))));
    return scheme->embedded_order > 0 && lg_stepper_size(scheme, &ode) > 0;
}

static void compare_all(const problem *p, solver how, size_t units, double rtol) {
    static const double scales[] = {1e-9, 1e-6, 1e3, 1e9};
    double exact[DIM];
    solve(p, lg_scheme_find("rkmk54"), 1e-13, exact);
    for (size_t s = 0; s < lg_scheme_count(); s++) {
        if (!applies(p, lg_scheme_at(s))) continue;
        for (size_t i = 0; i < units * LG_COUNT(scales); i++) {
            const size_t mark = lg_test_owned();
            compare(p, lg_scheme_at(s), rtol, how, exact, i % units, scales[i / units]);
            lg_test_give_back(mark);
        }
    }
}

/* Runs every system whose parameters have units. The path of the quadrotors is fixed in metres and seconds,
 * so they are left out. */
static void each_problem(solver how, double rtol) {
    const char *name, *form;
    worst_ratio = 1.0;
    for (size_t i = 0; lg_system_at(i, &name, &form); i++) {
        const bool chain = strcmp(name, "pendulum-chain") == 0, body = strcmp(name, "rigid-body") == 0;
        const bool fixed = strcmp(name, "quadrotors") == 0;
        if (lg_system_parameters(name, form)->key == NULL) continue;
        for (size_t links = 1; links <= (chain ? 3 : 1); links += 2)
            for (int rest = 0; rest < (body || strcmp(name, "rigid-body-attitude") == 0 ? 1 : 2); rest++) {
                const problem p = draw_problem(name, form, chain ? links : 0, rest != 0);
                compare_all(&p, how, fixed ? 1 : UNITS, rtol);
            }
    }
    print_message("           largest ratio of errors %.3f\n", worst_ratio);
}

TEST("relative errors are the same in all units of mass, length and time") {
    each_problem(solve, 1e-7);
}

TEST("relative errors of an ensemble are the same in all units") {
    each_problem(solve_in_lanes, 1e-7);
}

/* ---- states at rest ---- */

/* y' = A y at an equilibrium of large terms, whose sum is only rounding. */
typedef struct balance {
    double force; /* size of each of the two terms that cancel */
} balance;

static lg_status balance_field(void *user, double t, const double *y, const double *input, double *out) {
    const double force = ((const balance *)user)->force;
    out[0] = y[1];
    out[1] =
        force * (sin(3.0 * y[0]) - sin(3.0 * 0.1)) - force * (sin(3.0 * (y[0] - 1e-17)) - sin(0.1 + 0.2));
    out[1] -= force * 1e-2 * (y[0] - 0.1);
    return LG_OK;
}

TEST("rounding of the field is not taken for an error: a body at rest stays, in any units, in few steps") {
    static const double forces[] = {1e-18, 1e-9, 1.0, 1e9, 1e18}, end = 1e3;
    for (size_t i = 0; i < LG_COUNT(forces); i++) {
        balance of = {forces[i]};
        const double t_end = end / sqrt(forces[i]), y0[2] = {0.1, 0.0};
        double y[2];
        lg_run_stats stats;
        lg_ode ode = {.field = balance_field, .user = &of};
        lg_stepper *stepper = NULL;
        lg_step_controller control;
        lg_step_controller_init(&control);
        control.rtol = 1e-9;
        control.atol = -1e-13;
        assert_ok(lg_space_init_rn(&ode.space, 2));
        assert_ok(lg_stepper_create(NULL, lg_scheme_find("dp54"), &ode, &stepper));
        lg_test_owns(stepper, (void (*)(void *))lg_stepper_destroy);
        assert_ok(lg_integrate_adaptive(stepper, &control, 0.0, y0, &t_end, 1, y, &stats));
        assert_close(y[0], 0.1, 1e-9, 0.0);
        assert_true(stats.steps + stats.rejected < 2000);
        print_message("           force %g: %zu steps, %zu rejected\n", forces[i], stats.steps,
                      stats.rejected);
    }
}

TEST("a given absolute tolerance is used unchanged") {
    const problem p = draw_problem("rigid-body", NULL, 0, false);
    const lg_system *system = make_system_of(p.name, p.form, 0, p.parameters);
    lg_system_user user;
    lg_ode ode;
    lg_run_stats small, large;
    lg_step_controller control;
    double y0[3], y[3];
    lg_step_controller_init(&control);
    control.rtol = 0.0;
    control.atol = 1e-9;
    assert_ok(lg_system_ode(system, LG_COORDINATES_LIE, &ode, &user, test_work(lg_system_work_size(system))));
    for (int i = 0; i < 3; i++) y0[i] = 1e-6 * p.y0[i];
    lg_stepper *stepper = NULL;
    assert_ok(lg_stepper_create(NULL, lg_scheme_find("rkmk54"), &ode, &stepper));
    lg_test_owns(stepper, (void (*)(void *))lg_stepper_destroy);
    const double slow = 1e6 * p.t_end;
    assert_ok(lg_integrate_adaptive(stepper, &control, 0.0, p.y0, &p.t_end, 1, y, &large));
    const size_t calls = lg_stepper_evaluations(stepper);
    assert_int_equal(calls, 2 + 6 * (large.steps + large.rejected)); /* no further evaluations of the field */
    assert_ok(lg_integrate_adaptive(stepper, &control, 0.0, y0, &slow, 1, y, &small));
    /* The same motion with momenta a million times smaller, for which 1e-9 is a coarser tolerance. */
    assert_true(small.steps < large.steps / 2);
}
