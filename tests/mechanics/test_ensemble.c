/* Ensembles: a member's bits do not depend on the other members; lanes agree with one member at a time for
 * all systems and schemes; events; failures; statistics that do not depend on the order.
 * ctest-labels: isa threads src/mechanics src/integrators */
#include "mechanics/system_check.h"

#include <float.h>

#include "core/exact_sum.h"
#include "integrators/event_search.h"
#include "liegrad/ensemble.h"
#include "mechanics/ensemble_member.h"
#include "support/fail_alloc.h"
#include "support/memory_archive.h"

enum { MOST = 64, DIM = 32 };

/* What a test records of the members. */
typedef struct seen {
    const lg_system *system;
    size_t count;     /* number of times */
    uint64_t first;   /* the first member that is recorded */
    bool vary, spoil; /* vary: parameters vary; spoil: some members get an invalid start or parameter */
    double *states;   /* (members, count, dim) */
    double events[MOST][2];
    lg_ensemble_member member[MOST];
    size_t kept;
} seen;

/* Draws a random point of the space: directions, rotations, and numbers in [-1, 1]. */
static lg_status random_start(void *user, uint64_t member, double *y, double *parameters) {
    const seen *my = user;
    const lg_space *space = lg_system_space(my->system);
    lg_rng rng = test_rng(5, member);
    for (size_t i = 0; i < space->dim; i++) y[i] = lg_rng_uniform_in(&rng, -1.0, 1.0);
    for (size_t f = 0, at = 0; f < space->factors; f++)
        for (size_t i = 0; i < space->factor[f].count; i++) {
            const lg_space_kind kind = space->factor[f].kind;
            if (kind == LG_SPACE_TS2) random_links(&rng, 1, y + at);
            if (kind == LG_SPACE_SO3 || kind == LG_SPACE_SE3) random_rotation(&rng, y + at);
            at += lg_space_kind_entry(kind)->state;
        }
    for (size_t i = 0; my->vary && i < lg_system_parameter_count(my->system); i++) {
        /* The entries of a direction are not varied, since it must stay a unit vector. */
        char label[32];
        lg_system_parameter_label(my->system, i, label);
        if (strncmp(label, "chi", 3) != 0) parameters[i] *= lg_rng_uniform_in(&rng, 0.9, 1.1);
    }
    if (my->spoil && member % 7 == 3) y[0] = member % 2 == 0 ? (double)NAN : y[0] + 0.1;
    if (my->spoil && my->vary && member % 7 == 5) parameters[1] = -1.0;
    return LG_OK;
}

static lg_status keep(void *user, const lg_ensemble_block *block) {
    seen *my = user;
    for (size_t m = 0; m < block->members; m++) {
        const size_t to = (size_t)(block->first + m - my->first);
        assert_true(to < MOST);
        my->member[to] = block->member[m];
        for (size_t i = 0; i < block->count * block->dim; i++)
            my->states[to * block->count * block->dim + i] = block->states[i * block->room + m];
        for (size_t e = 0; e < block->event_count; e++)
            my->events[to][e] = block->events[e * block->room + m];
    }
    __atomic_fetch_add(&my->kept, block->members, __ATOMIC_SEQ_CST);
    return LG_OK;
}

static const double times[] = {0.0, 0.3, 0.55, 1.0};

static lg_ensemble_options options_for(const lg_scheme *scheme, uint64_t members) {
    lg_ensemble_options o;
    lg_ensemble_options_init(&o);
    o.members = members;
    o.block = 16;
    o.scheme = scheme;
    o.times = times;
    o.count = LG_COUNT(times);
    o.control.rtol = o.control.atol = 1e-7;
    o.steps = scheme && scheme->embedded_order > 0 ? 0 : 40;
    return o;
}

static seen run(const lg_system *system, const lg_ensemble_options *o, bool vary, lg_ensemble_stats *stats) {
    seen my = {.system = system, .count = o->count, .first = o->first, .vary = vary};
    my.states = TEST_ARRAY(double, (size_t)o->members * o->count * lg_system_dim(system));
    assert_told(lg_ensemble_run(NULL, system, o, random_start, &my, keep, &my, stats, &told));
    assert_int_equal(my.kept, o->members);
    return my;
}

/* Whether the scheme can run on the system. */
static bool applies(const lg_system *system, const lg_scheme *scheme) {
    double *work = test_work(lg_system_work_size(system));
    lg_system_user user;
    lg_ode ode;
    assert_ok(lg_system_ode(system, lg_system_coordinates_for(scheme), &ode, &user, work));
    return lg_stepper_size(scheme, &ode) > 0;
}

/* Calls `visit` for every explicit scheme that fits and every system; chains have one and three links. */
static void each_pair(void (*visit)(const lg_system *, const lg_scheme *)) {
    static const double one = 1.0;
    const char *name, *form;
    for (size_t i = 0; lg_system_at(i, &name, &form); i++) {
        /* follows a path under control: random starts would fly away */
        if (strcmp(name, "quadrotors") == 0) continue;
        const bool links = strcmp(name, "pendulum-chain") == 0;
        for (size_t n = 1; n <= (links ? 3 : 1); n += 2) {
            lg_system_options options;
            lg_system_options_init(&options);
            options.form = form;
            options.links = n;
            lg_named_values given[8]; /* those without a default */
            options.parameters = given;
            for (const lg_parameter_entry *p = lg_system_parameters(name, form); p->key != NULL; p++)
                if (p->fallback == NULL)
                    given[options.parameter_count++] = (lg_named_values){p->key, &one, 1};
            const lg_system *system = make_system_with(name, &options);
            for (size_t s = 0; s < lg_scheme_count(); s++)
                if (applies(system, lg_scheme_at(s))) visit(system, lg_scheme_at(s));
        }
    }
}

/* ---- equal bits ---- */

static void check_company(const lg_system *system, const lg_scheme *scheme) {
    enum { MEMBERS = 37, CHOSEN = 17 };
    lg_ensemble_options o = options_for(scheme, MEMBERS);
    const bool vary = lg_system_parameter_count(system) > 0;
    const size_t row = LG_COUNT(times) * lg_system_dim(system);
    const lg_ensemble_event event = {.terms = 1, .index = {0}, .weight = {1.0}, .level = 0.05};
    o.varied = vary;
    o.events = &event;
    o.event_count = 1;
    const seen all = run(system, &o, vary, NULL);
    o.first = CHOSEN;
    o.members = 1;
    o.block = 1;
    const seen alone = run(system, &o, vary, NULL);
    o.first = 11;
    o.members = 13;
    o.block = 5;
    o.threads = 3;
    const seen some = run(system, &o, vary, NULL);
    assert_memory_equal(alone.states, all.states + CHOSEN * row, row * sizeof(double));
    assert_memory_equal(some.states + 6 * row, all.states + CHOSEN * row, row * sizeof(double));
    assert_memory_equal(alone.events[0], all.events[CHOSEN], sizeof(double));
    assert_memory_equal(some.events[6], all.events[CHOSEN], sizeof(double));
    assert_int_equal(alone.member[0].steps, all.member[CHOSEN].steps);
    assert_int_equal(some.member[6].rejected, all.member[CHOSEN].rejected);
}

TEST("a member alone has the same bits as among others on threads, for every system and scheme") {
    each_pair(check_company);
}

TEST("blocks and threads do not change the bits") {
    const lg_system *system = make_chain("lagrangian", 1, 9.81, NULL, NULL);
    lg_ensemble_options o = options_for(lg_scheme_find("dp85"), MOST);
    const seen few = run(system, &o, false, NULL);
    o.first = 0, o.block = 0, o.threads = 4;
    const seen other = run(system, &o, false, NULL);
    assert_memory_equal(few.states, other.states, MOST * LG_COUNT(times) * 6 * sizeof(double));
}

/* ---- lanes compared with one member at a time ---- */

/* The largest difference. Not compared: numbers that are NaN in both (failed members), and numbers above 1e3
 * in both (a coarse method diverged). */
static double worst_difference(const double *a, const double *b, size_t n) {
    double worst = 0.0;
    for (size_t i = 0; i < n; i++) {
        const bool lost = (isnan(a[i]) && isnan(b[i])) || (fabs(a[i]) > 1e3 && fabs(b[i]) > 1e3);
        if (!lost) worst = fmax(worst, isnan(a[i] - b[i]) ? INFINITY : fabs(a[i] - b[i]));
    }
    return worst;
}

static void check_lanes(const lg_system *system, const lg_scheme *scheme) {
    enum { MEMBERS = 11 };
    lg_ensemble_options o = options_for(scheme, MEMBERS);
    const size_t n = MEMBERS * LG_COUNT(times) * lg_system_dim(system);
    lg_ensemble_stats side, single;
    const bool vary = lg_system_parameter_count(system) > 0;
    o.varied = vary;
    const seen lanes = run(system, &o, vary, &side);
    o.one_by_one = true;
    const seen one = run(system, &o, vary, &single);
    const bool explicit_one = (scheme->kind == LG_SCHEME_RKMK && scheme->commutator_count == 0) ||
                              scheme->kind == LG_SCHEME_COMMUTATOR_FREE;
    const bool turns = lg_system_dim(system) >= 12 && strcmp(lg_system_name(system), "pendulum-chain") != 0;
    assert_int_equal(single.lanes, 1);
    static const char *const alone[] = {"satellite", "cart-pole", "rotary-pendulum", "two-link-arm"};
    bool listed = true;
    for (size_t i = 0; i < LG_COUNT(alone); i++)
        listed = listed && strcmp(lg_system_name(system), alone[i]) != 0;
    assert_int_equal(side.lanes > 1, listed && explicit_one && !(scheme->project && turns));
    const double worst = worst_difference(lanes.states, one.states, n);
    if (worst > 1e-8) fail_msg("%s %s: %g", lg_system_name(system), scheme->name, worst);
    for (size_t m = 0; m < MEMBERS; m++) assert_int_equal(lanes.member[m].status, one.member[m].status);
}

TEST("lanes and one member at a time agree, for every system and scheme") {
    each_pair(check_lanes);
}

TEST("truncated dexpinv on lanes agrees with one member at a time, and rotations stay rotations") {
    const lg_system *system = make_system("rigid-body-attitude", NULL, NULL, 0);
    lg_scheme scheme = *lg_scheme_find("rkmk4");
    lg_ensemble_options o = options_for(&scheme, 9);
    scheme.dexpinv = 2;
    const seen lanes = run(system, &o, false, NULL);
    o.one_by_one = true;
    const seen one = run(system, &o, false, NULL);
    assert_true(worst_difference(lanes.states, one.states, 9 * LG_COUNT(times) * 12) < 1e-13);
    o.one_by_one = false;
    o.steps = 4000;
    const seen many = run(system, &o, false, NULL);
    for (size_t m = 0; m < 9; m++)
        assert_true(lg_space_manifold_error(lg_system_space(system), many.states + (m * 4 + 3) * 12) < 5e-15);
}

TEST("every member has the parameters that it was given") {
    enum { MEMBERS = 9 };
    const double masses[] = {1.0, 1.3}, lengths[] = {1.0, 0.8};
    const lg_system *system = make_chain("lagrangian", 2, 9.81, masses, lengths);
    lg_ensemble_options o = options_for(lg_scheme_find("rkmk54"), MEMBERS);
    o.varied = true;
    o.control.rtol = o.control.atol = 1e-11;
    const seen all = run(system, &o, true, NULL);
    for (size_t m = 0; m < MEMBERS; m++) {
        double y0[12] = {0}, p[5], end[12];
        memcpy(p, lg_system_parameter_values(system), sizeof p);
        const seen draw = {.system = system, .vary = true};
        assert_ok(random_start((void *)(uintptr_t)&draw, m, y0, p));
        const lg_system *own = make_system_of("pendulum-chain", "lagrangian", 2, p);
        integrate(own, 1e-12, y0, (const double[]){1.0}, 1, end);
        assert_all_close(all.states + (m * LG_COUNT(times) + 3) * 12, end, 12, 0, 1e-8);
    }
}

/* ---- known solutions ---- */

/* q = r cos(t - a), where member m has r = 1 + m and a = 0.1 m. */
static lg_status circle_start(void *user, uint64_t member, double *y, double *parameters) {
    const double r = 1.0 + (double)member, a = 0.1 * (double)member;
    y[0] = r * cos(a);
    y[1] = r * sin(a);
    return LG_OK;
}

static seen run_circle(const lg_ensemble_options *o) {
    const lg_system *system = make_system("oscillator", NULL, NULL, 0);
    seen my = {.system = system, .count = o->count};
    my.states = TEST_ARRAY(double, (size_t)o->members * o->count * 2);
    assert_ok(lg_ensemble_run(NULL, system, o, circle_start, &my, keep, &my, NULL, NULL));
    return my;
}

TEST("events have the times and directions of the exact solution") {
    static const char *const schemes[] = {"dp54", "dp85", "rk4", "cf4", "stormer-verlet"};
    static const double tolerance[] = {1e-9, 1e-9, 1e-9, 1e-9, 1e-4}, end[] = {0.0, 10.0};
    const lg_ensemble_event events[] = {
        {.terms = 1, .index = {0}, .weight = {1.0}, .direction = 1},
        {.terms = 2, .index = {0, 1}, .weight = {1.0, -1.0}, .direction = -1}};
    for (size_t s = 0; s < LG_COUNT(schemes); s++)
        for (int one_by_one = 0; one_by_one < 2; one_by_one++) {
            lg_ensemble_options o = options_for(lg_scheme_find(schemes[s]), 13);
            o.times = end, o.count = 2;
            o.events = events, o.event_count = 2;
            o.one_by_one = one_by_one;
            o.control.rtol = o.control.atol = 1e-11;
            if (o.steps > 0) o.steps = 2000;
            const seen my = run_circle(&o);
            for (int m = 0; m < 13; m++) {
                /* q rises through 0 at t - a = 3 pi/2. p = -r sin(t - a), so q - p falls at t - a = 3
                 * pi/4. */
                assert_close(my.events[m][0], 4.71238898038469 + 0.1 * m, 0, tolerance[s]);
                assert_close(my.events[m][1], 2.356194490192345 + 0.1 * m, 0, tolerance[s]);
            }
        }
}

/* Number of evaluations until the root of exp(a x) = level in [0, 1] is known to 1e-12. */
static int looks_for(double a, double level) {
    lg_event_search s = {.low = 0.0, .high = 1.0, .g_low = 1.0 - level, .g_high = exp(a) - level};
    lg_event_guess(&s);
    while (!lg_event_narrow(&s, exp(a * s.fraction) - level, 1e-12)) continue;
    assert_close(s.fraction, log(level) / a, 0, 1e-12);
    return s.looks;
}

TEST("the search for an event needs few evaluations for a curved function") {
    assert_true(looks_for(0.5, 1.2) <= 8);
    assert_true(looks_for(5.0, 20.0) <= 20);
    assert_true(looks_for(-5.0, 0.1) <= 15);
}

/* 2 sinh(x/2)^2 = cosh x - 1. */
static double bowl(double x) {
    return 2.0 * sinh(0.5 * x) * sinh(0.5 * x);
}

/* Searches for a change of sign of size (cosh(a (x - m)) - 1 - depth) in [0, 1]. Returns its time, or NaN if
 * there is none. */
static double dip_at(double size, double a, double m, double depth, int direction) {
    lg_event_search s = {.direction = direction,
                         .g_low = size * (bowl(a * m) - depth),
                         .g_high = size * (bowl(a * (1.0 - m)) - depth),
                         .slope_low = -size * a * sinh(a * m),
                         .slope_high = size * a * sinh(a * (1.0 - m))};
    bool done = !lg_event_begin(&s);
    while (!done) {
        const double x = a * (s.fraction - m);
        done = lg_event_look(&s, size * (bowl(x) - depth), size * a * sinh(x), 1e-13);
        assert_true(s.looks <= 40);
    }
    return s.dips ? (double)NAN : s.fraction;
}

TEST("a function with a minimum just below 0 has its events, one with a minimum just above has none, in "
     "any units") {
    lg_rng rng = test_rng(7, 0);
    for (int k = 0; k < 20000; k++) {
        const double size = (k % 2 == 0 ? 1.0 : -1.0) * pow(10.0, lg_rng_uniform_in(&rng, -60.0, 60.0));
        const double a = lg_rng_uniform_in(&rng, 0.3, 5.0), m = lg_rng_uniform_in(&rng, 0.05, 0.95);
        const double edge = a * (m < 0.5 ? m : 1.0 - m);
        const double depth = bowl(edge) * pow(10.0, lg_rng_uniform_in(&rng, -9.0, -0.1));
        const double way = 2.0 * asinh(sqrt(0.5 * depth)) / a, error = 1e-14 / depth + 1e-12;
        const int down = size > 0.0 ? -1 : 1;
        assert_close(dip_at(size, a, m, depth, down), m - way, 0, error);
        assert_close(dip_at(size, a, m, depth, 0), m - way, 0, error);
        assert_close(dip_at(size, a, m, depth, -down), m + way, 0, error);
        assert_true(isnan(dip_at(size, a, m, -depth, 0)));
    }
}

/* Pendulums that are released at rest swing to x = -0.8 (1 + d) and back. |d| lies in 1e-4 .. 1e-1; every
 * second member has d < 0 and turns before it reaches -0.8. */
#define SWING_LEVEL 0.8

static double swing_beyond(uint64_t member) {
    lg_rng rng = test_rng(6, member);
    const double d = pow(10.0, lg_rng_uniform_in(&rng, -4.0, -1.0));
    return member % 2 == 0 ? d : -d;
}

static lg_status swing_start(void *user, uint64_t member, double *y, double *parameters) {
    const double x = SWING_LEVEL * (1.0 + swing_beyond(member));
    memset(y, 0, 6 * sizeof(*y));
    y[0] = x;
    y[2] = -sqrt(1.0 - x * x);
    return LG_OK;
}

/* Records the times when x falls, and then rises, through the level. */
static seen run_swings(const char *scheme, bool one_by_one, double tolerance, double h_max) {
    static const double end[] = {1.9};
    const lg_ensemble_event events[] = {
        {.terms = 1, .index = {0}, .weight = {1.0}, .level = -SWING_LEVEL, .direction = -1},
        {.terms = 1, .index = {0}, .weight = {1.0}, .level = -SWING_LEVEL, .direction = 1}};
    const lg_system *system = make_chain("lagrangian", 1, 9.81, NULL, NULL);
    lg_ensemble_options o = options_for(lg_scheme_find(scheme), MOST);
    o.times = end, o.count = 1, o.events = events, o.event_count = 2;
    o.one_by_one = one_by_one;
    o.control.rtol = o.control.atol = tolerance;
    o.control.h_max = h_max;
    o.control.max_steps = 100000;
    if (o.steps > 0) o.steps = 97;
    seen my = {.system = system, .count = 1};
    my.states = TEST_ARRAY(double, MOST * 6);
    assert_ok(lg_ensemble_run(NULL, system, &o, swing_start, &my, keep, &my, NULL, NULL));
    return my;
}

TEST("a value crossed twice within a step gives both events, one that is not reached gives none") {
    static const char *const schemes[] = {"dp54", "dp85", "rkmk54", "cf43", "rk4", "rkmk4", "cf4"};
    const seen fine = run_swings("dp85", false, 1e-12, 1e-3);
    for (size_t s = 0; s < LG_COUNT(schemes); s++)
        for (int k = 0; k < 16; k++) {
            const double tolerance = 1e-6 * pow(10.0, -0.2 * (k / 2));
            const seen my = run_swings(schemes[s], k % 2 == 1, tolerance, 0.0);
            for (int m = 0; m < MOST; m++)
                for (int e = 0; e < 2; e++) {
                    const double d = swing_beyond((uint64_t)m);
                    assert_int_equal(isnan(fine.events[m][e]), d < 0.0);
                    assert_int_equal(isnan(my.events[m][e]), d < 0.0);
                    if (d > 0.0) assert_close(my.events[m][e], fine.events[m][e], 0, 3e-6 / sqrt(d));
                }
        }
}

TEST("a member may have no event; a start on the level is not an event") {
    static const double end[] = {3.0};
    const lg_ensemble_event events[] = {
        {.terms = 1, .index = {0}, .weight = {1.0}, .level = 5.5, .direction = -1},
        {.terms = 1, .index = {0}, .weight = {1.0}, .level = 1.0}};
    lg_ensemble_options o = options_for(lg_scheme_find("dp54"), 8);
    o.times = end, o.count = 1, o.events = events, o.event_count = 2;
    const seen my = run_circle(&o);
    for (int m = 0; m < 8; m++) assert_int_equal(isnan(my.events[m][0]), (1.0 + m) <= 5.5);
    assert_true(isnan(my.events[0][1])); /* q = cos t leaves 1 at once and does not return */
}

TEST("states at times within steps, at their ends and at the start agree with the exact solution") {
    static const char *const schemes[] = {"dp54", "dp85", "rkmk54", "cf43", "rk4"};
    for (size_t s = 0; s < LG_COUNT(schemes); s++) {
        lg_ensemble_options o = options_for(lg_scheme_find(schemes[s]), 10);
        o.control.rtol = o.control.atol = 1e-11;
        if (o.steps > 0) o.steps = 4000;
        const seen my = run_circle(&o);
        for (int m = 0; m < 10; m++)
            for (size_t i = 0; i < LG_COUNT(times); i++)
                assert_close(my.states[(m * LG_COUNT(times) + i) * 2], (1.0 + m) * cos(times[i] - 0.1 * m), 0,
                             1e-7);
    }
}

/* A body with equal moments of inertia turns about its momentum: R = exp(t pi), which every step computes
 * exactly. */
static lg_status spinning_start(void *user, uint64_t member, double *y, double *parameters) {
    const double pi[3] = {0.01 * (double)(member + 1), 0.02, 0.05};
    for (int i = 0; i < 9; i++) y[i] = i % 4 == 0 ? 1.0 : 0.0;
    memcpy(y + 9, pi, sizeof(pi));
    return LG_OK;
}

TEST("on lanes time does not drift: a rotation up to t = 1e7") {
    enum { MEMBERS = 2 };
    static const double ones[3] = {1.0, 1.0, 1.0}, end[] = {1e7};
    const lg_system *system =
        make_system("rigid-body-attitude", NULL, &(lg_named_values){"inertia", ones, 3}, 1);
    lg_ensemble_options o = options_for(lg_scheme_find("cf32a"), MEMBERS);
    seen my = {.system = system, .count = 1};
    my.states = TEST_ARRAY(double, MEMBERS * 12);
    o.times = end;
    o.count = 1;
    o.control.max_steps = 10000000;
    assert_ok(lg_ensemble_run(NULL, system, &o, spinning_start, &my, keep, &my, NULL, NULL));
    for (int m = 0; m < MEMBERS; m++) {
        double turn[3], R[9];
        for (int i = 0; i < 3; i++) turn[i] = 1e7 * my.states[m * 12 + 9 + i];
        lg_so3_exp(turn, R);
        assert_all_close(my.states + m * 12, R, 9, 0.0, 1e-9);
    }
}

TEST("the upright pendulum stays, and a pendulum that is slightly off falls") {
    const double start[6] = {0.0, 0.0, 1.0, 0.0, 0.0, 0.0}, off[6] = {1e-6, 0.0, 1.0 - 5e-13, 0.0, 0.0, 0.0};
    const lg_system *system = make_chain("lagrangian", 1, 9.81, NULL, NULL);
    static const double end[] = {6.0};
    for (int k = 0; k < 2; k++) {
        lg_ensemble_options o = options_for(lg_scheme_find("rkmk54"), 3);
        seen my = {.system = system, .count = 1, .states = TEST_ARRAY(double, 18)};
        o.times = end, o.count = 1, o.start = k == 0 ? start : off;
        o.control.rtol = o.control.atol = 1e-12;
        assert_ok(lg_ensemble_run(NULL, system, &o, NULL, NULL, keep, &my, NULL, NULL));
        for (int m = 0; m < 3; m++) assert_int_equal(my.states[6 * m + 2] > 0.999999, k == 0);
    }
}

/* ---- failures ---- */

TEST("members that are refused or fail are counted, and the others keep their bits") {
    const lg_system *system = make_chain("lagrangian", 1, 9.81, NULL, NULL);
    enum { MEMBERS = 41 };
    for (int one_by_one = 0; one_by_one < 2; one_by_one++)
        for (int fixed = 0; fixed < 2; fixed++) {
            lg_ensemble_options o = options_for(lg_scheme_find(fixed ? "cf4" : "rkmk54"), MEMBERS);
            lg_ensemble_stats stats;
            o.varied = true;
            o.one_by_one = one_by_one;
            const seen sound = run(system, &o, true, NULL);
            seen my = {.system = system, .count = o.count, .vary = true, .spoil = true};
            my.states = TEST_ARRAY(double, MEMBERS *LG_COUNT(times) * 6);
            assert_ok(lg_ensemble_run(NULL, system, &o, random_start, &my, keep, &my, &stats, NULL));
            size_t failed = 0;
            for (size_t m = 0; m < MEMBERS; m++) {
                const bool bad = m % 7 == 3 || m % 7 == 5;
                const double *a = my.states + m * LG_COUNT(times) * 6,
                             *b = sound.states + m * LG_COUNT(times) * 6;
                failed += bad;
                assert_int_equal(my.member[m].status, bad ? LG_INVALID_ARGUMENT : LG_OK);
                for (size_t i = 0; i < LG_COUNT(times) * 6; i++)
                    assert_true(bad ? isnan(a[i]) : a[i] == b[i]);
            }
            assert_int_equal(stats.failed, failed);
        }
}

TEST("a member that needs too many steps reports when it stopped") {
    const lg_system *system = make_chain("lagrangian", 1, 9.81, NULL, NULL);
    for (int one_by_one = 0; one_by_one < 2; one_by_one++) {
        lg_ensemble_options o = options_for(lg_scheme_find("rkmk54"), 9);
        o.one_by_one = one_by_one;
        o.control.max_steps = 6;
        o.control.rtol = o.control.atol = 1e-10;
        const seen my = run(system, &o, false, NULL);
        for (size_t m = 0; m < 9; m++) {
            assert_int_equal(my.member[m].status, LG_TOO_MANY_STEPS);
            assert_true(my.member[m].reached > 0.0 && my.member[m].reached < 1.0);
            assert_int_equal(my.member[m].steps + my.member[m].rejected, 6);
            assert_true(isnan(my.states[(m * 4 + 3) * 6]) && my.states[m * 24] == my.states[m * 24]);
        }
    }
}

TEST("an ensemble refuses invalid options") {
    static const double down[] = {1.0, 0.5}, before[] = {-1.0, 1.0}, endless[] = {0.5, INFINITY};
    const lg_system *system = make_system("oscillator", NULL, NULL, 0);
    const lg_ensemble_event bad[] = {{.terms = 1, .index = {2}, .weight = {1.0}},
                                     {.terms = 0},
                                     {.terms = LG_EVENT_TERMS + 1},
                                     {.terms = 1, .weight = {1.0}, .direction = -2},
                                     {.terms = 1, .weight = {1.0}, .direction = 2},
                                     {.terms = 1, .weight = {1.0}, .level = NAN},
                                     {.terms = 1, .weight = {INFINITY}}};
    lg_error error;
    lg_ensemble_options good = options_for(lg_scheme_find("dp54"), 3), o = good;
#define REFUSED(status, part, ...)                                                                           \
    o = good, __VA_ARGS__;                                                                                   \
    assert_status(lg_ensemble_run(NULL, system, &o, NULL, NULL, NULL, NULL, NULL, &error), status);          \
    assert_says(error.message, part)
    REFUSED(LG_INVALID_ARGUMENT, "ascend", o.times = down, o.count = 2);
    REFUSED(LG_INVALID_ARGUMENT, "times that are 0 or later", o.times = before, o.count = 2);
    REFUSED(LG_INVALID_ARGUMENT, "last time", o.count = 0);
    REFUSED(LG_INVALID_ARGUMENT, "last time", o.times = NULL);
    REFUSED(LG_INVALID_ARGUMENT, "last time", o.count = 1); /* the time 0 */
    REFUSED(LG_INVALID_ARGUMENT, "ascend at index 1", o.times = endless, o.count = 2);
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        REFUSED(LG_INVALID_ARGUMENT, "event 0", o.events = &bad[i], o.event_count = 1);
    }
    REFUSED(LG_INVALID_ARGUMENT, "event_count", o.events = bad, o.event_count = LG_EVENTS_MAX + 1);
    REFUSED(LG_INVALID_ARGUMENT, "event_count", o.event_count = 1);
    REFUSED(LG_INVALID_ARGUMENT, "too many members", o.members = UINT64_MAX);
    REFUSED(LG_INVALID_ARGUMENT, "threads", o.threads = 0);
    REFUSED(LG_INVALID_ARGUMENT, "threads", o.threads = 1025);
    REFUSED(LG_INVALID_ARGUMENT, "options", o.size = 1);
    REFUSED(LG_INVALID_ARGUMENT, "control", o.control.rtol = -1.0);
    REFUSED(LG_UNSUPPORTED, "number of equal steps", o.scheme = lg_scheme_find("rk4"));
    REFUSED(LG_INVALID_ARGUMENT, "multiple of the step", o.scheme = lg_scheme_find("rk4"), o.steps = 7);
    REFUSED(LG_UNSUPPORTED, "", o.scheme = lg_scheme_find("slgi"), o.steps = 40);
#undef REFUSED
    assert_ok(lg_ensemble_run(NULL, system, &good, NULL, NULL, NULL, NULL, NULL, &error));
    good.members = 0;
    assert_ok(lg_ensemble_run(NULL, system, &good, NULL, NULL, NULL, NULL, NULL, &error));
}

TEST("the states of a block take 4 MiB at most, if it has more than 16 members") {
    lg_ensemble_options o = options_for(NULL, 3);
    o.block = 0;
    static const size_t counts[] = {4, 1 << 10, 1 << 20}, expected[] = {1024, 256, 16};
    for (size_t i = 0; i < LG_COUNT(counts); i++) {
        o.count = counts[i];
        assert_int_equal(lg_ensemble_block_size(&o, 2), expected[i]);
    }
}

TEST("a block whose memory no size_t counts is refused: there is no memory for it") {
    const lg_system *system = make_chain("lagrangian", 1, 9.81, NULL, NULL);
    const double start[6] = {1.0, 0.0, 0.0, 0.0, 0.0, 0.0};
    for (int one_by_one = 0; one_by_one < 2; one_by_one++)
        for (size_t bytes = 1; bytes <= 1024; bytes++) {
            lg_ensemble_options o = options_for(lg_scheme_find("rkmk54"), 2);
            o.one_by_one = one_by_one;
            o.varied = one_by_one;
            o.start = start;
            o.block = SIZE_MAX / bytes;
            assert_status(lg_ensemble_run(NULL, system, &o, NULL, NULL, NULL, NULL, NULL, NULL),
                          LG_OUT_OF_MEMORY);
        }
}

TEST("rows of one member are rejected if a size_t cannot hold their bytes") {
    const lg_system *system = make_chain("lagrangian", 1, 9.81, NULL, NULL);
    for (size_t less = 0; less < 8; less++) {
        const lg_lane_plan plan = {
            .run = {.scheme = lg_scheme_find("rkmk54"), .count = SIZE_MAX / lg_system_dim(system) - less},
            .space = *lg_system_space(system)};
        lg_one_by_one one = {0};
        assert_status(lg_one_by_one_begin(NULL, &plan, system, &one), LG_OUT_OF_MEMORY);
        lg_one_by_one_end(&one);
    }
}

TEST("without a scheme, dp54 runs on R^n and rkmk54 on other spaces") {
    const lg_system *systems[] = {make_system("oscillator", NULL, NULL, 0),
                                  make_chain("lagrangian", 1, 9.81, NULL, NULL)};
    static const char *const schemes[] = {"dp54", "rkmk54"};
    for (size_t i = 0; i < 2; i++) {
        lg_ensemble_options o = options_for(NULL, 3);
        o.steps = 0;
        const seen chosen = run(systems[i], &o, false, NULL);
        o.scheme = lg_scheme_find(schemes[i]);
        const seen named = run(systems[i], &o, false, NULL);
        assert_memory_equal(chosen.states, named.states,
                            3 * LG_COUNT(times) * lg_system_dim(systems[i]) * sizeof(double));
    }
}

static lg_status fail_start(void *user, uint64_t member, double *y, double *parameters) {
    return member == 2 ? LG_CHECK_FAILED : LG_OK;
}

TEST("an error from the function that draws starts ends the run") {
    lg_ensemble_options o = options_for(lg_scheme_find("dp54"), 3);
    assert_status(lg_ensemble_run(NULL, make_system("oscillator", NULL, NULL, 0), &o, fail_start, NULL, NULL,
                                  NULL, NULL, NULL),
                  LG_CHECK_FAILED);
}

static lg_status refuse(void *user, const lg_ensemble_block *block) {
    return block->first == 16 ? LG_CHECK_FAILED : LG_OK;
}

TEST("an error from the function that keeps blocks ends the run") {
    const lg_system *system = make_system("oscillator", NULL, NULL, 0);
    lg_ensemble_options o = options_for(lg_scheme_find("dp54"), 64);
    assert_status(lg_ensemble_run(NULL, system, &o, NULL, NULL, refuse, NULL, NULL, NULL), LG_CHECK_FAILED);
}

TEST("every allocation may fail") {
    const lg_system *system = make_chain("lagrangian", 1, 9.81, NULL, NULL);
    for (int one_by_one = 0; one_by_one < 2; one_by_one++) {
        lg_ensemble_options o = options_for(lg_scheme_find("rkmk54"), 2);
        o.one_by_one = one_by_one;
        const double start[6] = {1.0, 0.0, 0.0, 0.0, 0.0, 0.0};
        o.start = start;
        EVERY_ALLOCATION_FAILS(context, 5, {
            status = lg_ensemble_run(context, system, &o, NULL, NULL, NULL, NULL, NULL, NULL);
        });
    }
}

TEST("members with different numbers of steps keep the lanes busy") {
    enum { MEMBERS = 64 };
    const lg_system *system = make_chain("lagrangian", 1, 9.81, NULL, NULL);
    lg_ensemble_options o = options_for(lg_scheme_find("rkmk54"), MEMBERS);
    lg_ensemble_stats stats;
    o.block = MEMBERS;
    (void)run(system, &o, false, &stats);
    if (stats.lanes > 1) assert_true(stats.occupancy > 0.6 && stats.occupancy <= 1.0);
}

/* ---- sums and statistics ---- */

TEST("exact sums do not depend on the order, and cancel without loss") {
    enum { N = 2000 };
    lg_exact_sum up = {{0}}, down = {{0}}, half = {{0}}, rest = {{0}};
    double *x = TEST_ARRAY(double, N);
    lg_rng rng = test_rng(1, 2);
    for (int i = 0; i < N; i++) x[i] = ldexp(lg_rng_normal(&rng), (int)lg_rng_below(&rng, 600) - 300);
    for (int i = 0; i < N; i++) {
        lg_exact_add(&up, x[i]);
        lg_exact_add(&down, x[N - 1 - i]);
        lg_exact_add(i % 3 == 0 ? &half : &rest, x[i]);
    }
    lg_exact_merge(&half, &rest);
    assert_memory_equal(&up, &down, sizeof up);
    assert_memory_equal(&up, &half, sizeof up);
    for (int i = 0; i < N; i++) lg_exact_add(&up, -x[i]);
    assert_true(lg_exact_value(&up) == 0.0);
    const double parts[] = {1e300, 1.0, -1e300, 0x1p-1074, -0x1p-1074, 0.25, DBL_MAX, -DBL_MAX, 1e-320};
    lg_exact_sum few = {{0}};
    for (size_t i = 0; i < LG_COUNT(parts); i++) lg_exact_add(&few, parts[i]);
    assert_true(lg_exact_value(&few) == 1.25);
    lg_exact_add(&few, -3.0);
    assert_true(lg_exact_value(&few) == -1.75);
    lg_exact_sum least = {{0}};
    lg_exact_add(&least, -0x1p-1074);
    assert_true(lg_exact_value(&least) == -0x1p-1074);
}

RELEASES(release_statistics, lg_statistics_destroy)

static lg_statistics *make_statistics(size_t bins, const double *values, size_t count) {
    static const bool logarithmic[] = {false, true};
    lg_statistics *s;
    assert_ok(lg_statistics_create(NULL, 1, 2, bins, logarithmic, &s));
    lg_test_owns(s, release_statistics);
    for (size_t c = 0; c < 2; c++) {
        const lg_statistics_range range = lg_statistics_range_of(s, c, values, count);
        lg_statistics_set_range(s, 0, c, &range);
    }
    return s;
}

static void add_both(lg_statistics *s, const double *values, size_t count) {
    for (size_t c = 0; c < 2; c++) lg_statistics_add(s, 0, c, values, count);
}

TEST("mean, deviation, extremes and quantiles agree with those of the sorted numbers") {
    enum { N = 20000, BLOCK = 100 };
    double *x = TEST_ARRAY(double, N), sum = 0.0, square = 0.0;
    lg_rng rng = test_rng(3, 0);
    for (int i = 0; i < N; i++) x[i] = exp(9.0 + 0.01 * lg_rng_normal(&rng)), sum += x[i];
    for (int i = 0; i < N; i++) square += (x[i] - sum / N) * (x[i] - sum / N);
    lg_statistics *s = make_statistics(400, x, 256), *other = make_statistics(400, x, 256);
    for (int i = 0; i < N; i += BLOCK) add_both(s, x + i, BLOCK);
    for (int i = N - BLOCK; i >= 0; i -= BLOCK) add_both(other, x + i, BLOCK);
    for (int i = 1; i < N; i++) /* sorts x */
        for (int k = i; k > 0 && x[k] < x[k - 1]; k--) {
            const double y = x[k];
            x[k] = x[k - 1], x[k - 1] = y;
        }
    for (size_t c = 0; c < 2; c++) {
        const lg_statistics_cell cell = lg_statistics_of(s, 0, c), again = lg_statistics_of(other, 0, c);
        assert_int_equal(cell.count, N);
        assert_memory_equal(&cell, &again, sizeof cell);
        assert_close(cell.mean, sum / N, 1e-14, 0);
        assert_close(cell.deviation, sqrt(square / (N - 1)), 1e-10, 0);
        assert_true(cell.least == x[0] && cell.largest == x[N - 1]);
        const double close = c == 0 ? cell.resolution : cell.resolution * x[N / 2];
        for (double p = 0.05; p < 1.0; p += 0.1)
            assert_close(lg_statistics_quantile(s, 0, c, p), x[(int)(p * N)], 0, 1.5 * close);
        assert_true(lg_statistics_quantile(s, 0, c, 0.0) >= x[0]);
        assert_true(lg_statistics_quantile(s, 0, c, 1.0) == x[N - 1]);
    }
}

TEST("numbers beyond the range of the bins count, NaN and infinity do not") {
    const double x[] = {0.0, 1.0, 2.0, 3.0}, more[] = {-100.0, (double)NAN, 100.0, (double)INFINITY, 1.5};
    lg_statistics *s = make_statistics(8, x, 4);
    lg_statistics_add(s, 0, 0, more, 5);
    const lg_statistics_cell cell = lg_statistics_of(s, 0, 0);
    const uint64_t *bins = lg_statistics_bins(s, 0, 0);
    assert_int_equal(cell.count, 3);
    assert_true(cell.least == -100.0 && cell.largest == 100.0);
    assert_int_equal(bins[0], 1);
    assert_int_equal(bins[9], 1);
    assert_true(lg_statistics_quantile(s, 0, 0, 1.0) == 100.0);
    /* middles of the bins; their range is symmetric about 1.5, and 1.5 lies in the fifth bin */
    double middles[8];
    for (int i = 0; i < 8; i++) middles[i] = 1.5 + (i - 3.5) * cell.resolution;
    lg_statistics_add(s, 0, 0, middles, 8);
    for (int i = 0; i < 8; i++) assert_int_equal(bins[1 + i], i == 4 ? 2 : 1);
    assert_true(isnan(lg_statistics_quantile(s, 0, 1, 0.5)) && isnan(lg_statistics_of(s, 0, 1).mean));
}

TEST("numbers whose squares or sums overflow have no deviation or no mean, and no wrong one") {
    static const struct {
        double x, mean, deviation;
    } cases[] = {{1e150, 1e150, 1e150}, {1e155, 1e155, (double)NAN}, {8e307, (double)NAN, (double)NAN}};
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        lg_statistics *s = make_statistics(8, (const double[]){0.0}, 1);
        for (int k = 0; k < 3; k++) lg_statistics_add(s, 0, 0, (const double[]){k * cases[i].x}, 1);
        const lg_statistics_cell cell = lg_statistics_of(s, 0, 0);
        assert_true(cell.least == 0 && cell.largest == 2 * cases[i].x && cell.count == 3);
        assert_true(isnan(cases[i].mean) ? isnan(cell.mean) : fabs(cell.mean / cases[i].x - 1) < 1e-15);
        assert_true(isnan(cases[i].deviation) ? isnan(cell.deviation)
                                              : fabs(cell.deviation / cases[i].x - 1) < 1e-15);
    }
}

TEST("statistics are saved, loaded and merged without loss") {
    enum { N = 500 };
    const double *x = test_numbers(4, N, 0.1, 2.0);
    lg_statistics *whole = make_statistics(32, x, 50), *parts[2], *loaded = make_statistics(32, x, 1);
    for (int i = 0; i < 2; i++) {
        assert_ok(lg_statistics_create_like(whole, &parts[i]));
        lg_test_owns(parts[i], release_statistics);
    }
    for (int i = 0; i < N; i += 50) {
        add_both(whole, x + i, 50);
        add_both(parts[i / 50 % 2], x + i, 50);
    }
    memory_archive archive = {.count = 0};
    const lg_archive_writer to = memory_writer(&archive);
    const lg_archive_reader from = memory_reader(&archive);
    assert_ok(lg_statistics_merge(parts[1], parts[0]));
    assert_ok(lg_statistics_save(parts[1], &to));
    assert_ok(lg_statistics_load(loaded, &from));
    for (size_t c = 0; c < 2; c++) {
        const lg_statistics_cell a = lg_statistics_of(whole, 0, c), b = lg_statistics_of(loaded, 0, c);
        assert_memory_equal(&a, &b, sizeof a);
        assert_memory_equal(lg_statistics_bins(whole, 0, c), lg_statistics_bins(loaded, 0, c),
                            34 * sizeof(uint64_t));
        assert_true(lg_statistics_quantile(whole, 0, c, 0.3) == lg_statistics_quantile(loaded, 0, c, 0.3));
    }
    for (size_t i = 1, all = archive.count; i < all; i++) { /* the arrays from i are missing */
        lg_statistics *cut;
        assert_ok(lg_statistics_create_like(whole, &cut));
        lg_test_owns(cut, release_statistics);
        archive.count = i;
        assert_status(lg_statistics_load(cut, &from), LG_NOT_FOUND);
        memory_archive full = {.fail_after = i};
        const lg_archive_writer no_room = memory_writer(&full);
        assert_status(lg_statistics_save(whole, &no_room), LG_FILE);
    }
    lg_statistics *other = make_statistics(16, x, 50), *shifted = make_statistics(32, x + 100, 50);
    assert_status(lg_statistics_merge(other, whole), LG_SHAPE);
    assert_status(lg_statistics_merge(shifted, whole), LG_SHAPE);
    lg_statistics *linear, *logarithmic; /* equal ranges, one of them of logarithms */
    const bool yes = true;
    const lg_statistics_range range = {0};
    assert_ok(lg_statistics_create(NULL, 1, 1, 8, NULL, &linear));
    lg_test_owns(linear, release_statistics);
    assert_ok(lg_statistics_create(NULL, 1, 1, 8, &yes, &logarithmic));
    lg_test_owns(logarithmic, release_statistics);
    lg_statistics_set_range(linear, 0, 0, &range);
    lg_statistics_set_range(logarithmic, 0, 0, &range);
    assert_status(lg_statistics_merge(linear, logarithmic), LG_SHAPE);
    EVERY_ALLOCATION_FAILS(context, 2, {
        lg_statistics *made = NULL;
        status = lg_statistics_create(context, 3, 2, 10, NULL, &made);
        if (status == LG_OK) lg_statistics_destroy(made);
    });
}

TEST("statistics refuse sizes that are 0 or too large, and merge only equal sizes") {
    static const size_t wrong[][3] = {{0, 2, 8}, {3, 0, 8}, {3, 2, 0}, {3, 2, 65537}};
    lg_statistics *s[3];
    for (size_t i = 0; i < LG_COUNT(wrong); i++)
        assert_status(lg_statistics_create(NULL, wrong[i][0], wrong[i][1], wrong[i][2], NULL, &s[0]),
                      LG_INVALID_ARGUMENT);
    assert_status(lg_statistics_create(NULL, SIZE_MAX / 64, 2, 8, NULL, &s[0]), LG_OUT_OF_MEMORY);
    static const size_t sizes[][2] = {{3, 2}, {2, 2}, {3, 1}};
    for (size_t i = 0; i < 3; i++) {
        assert_ok(lg_statistics_create(NULL, sizes[i][0], sizes[i][1], 8, NULL, &s[i]));
        lg_test_owns(s[i], release_statistics);
    }
    assert_status(lg_statistics_merge(s[0], s[1]), LG_SHAPE);
    assert_status(lg_statistics_merge(s[0], s[2]), LG_SHAPE);
}

TEST("a single number has no deviation; if the first bin is empty, quantile 0 is the least number") {
    const double x = 0.5;
    lg_statistics *s;
    assert_ok(lg_statistics_create(NULL, 1, 1, 8, NULL, &s));
    lg_test_owns(s, release_statistics);
    lg_statistics_add(s, 0, 0, &x, 1);
    assert_true(lg_statistics_of(s, 0, 0).mean == 0.5 && isnan(lg_statistics_of(s, 0, 0).deviation));
    assert_true(lg_statistics_quantile(s, 0, 0, 0.0) == 0.5);
    assert_true(isnan(lg_statistics_quantile(s, 0, 0, -0.1)) && isnan(lg_statistics_quantile(s, 0, 0, 1.1)));
}

/* The arrays of one cell with 8 bins whose numbers lie in the first one. */
static lg_status load_cell(uint64_t count, double low, double high, double centre, double least,
                           double largest, int64_t sum, int64_t square, lg_statistics **out) {
    uint64_t bins[10] = {count};
    const uint64_t dims[3] = {1, 1, 10}, parts[3] = {1, 1, LG_EXACT_PARTS};
    int64_t sums[LG_EXACT_PARTS] = {sum}, squares[LG_EXACT_PARTS] = {square};
    const double *const numbers[] = {&least, &largest, &low, &high, &centre};
    static const char *const names[] = {"least", "largest", "low", "high", "centre"};
    memory_archive *archive = TEST_ARRAY(memory_archive, 1);
    const lg_archive_reader from = memory_reader(archive);
    assert_ok(memory_write(archive, "bins", LG_ELEMENT_U64, 3, dims, bins));
    assert_ok(memory_write(archive, "count", LG_ELEMENT_U64, 2, dims, &count));
    for (size_t i = 0; i < LG_COUNT(names); i++)
        assert_ok(memory_write(archive, names[i], LG_ELEMENT_F64, 2, dims, numbers[i]));
    assert_ok(memory_write(archive, "sum", LG_ELEMENT_I64, 3, parts, sums));
    assert_ok(memory_write(archive, "square", LG_ELEMENT_I64, 3, parts, squares));
    assert_ok(lg_statistics_create(NULL, 1, 1, 8, NULL, out));
    lg_test_owns(*out, release_statistics);
    return lg_statistics_load(*out, &from);
}

TEST("damaged statistics are refused, and sums that would overflow are not merged") {
    static const struct {
        uint64_t count;
        double low, high, centre, least, largest;
        int64_t sum, square;
    } bad[] = {{1, 1, 0, 0, 0, 0, 0, 0},
               {1, 0, 1, NAN, 0, 0, 0, 0},
               {1, 0, 1, 0, 1, 0, 0, 0},
               {1, 0, 1, 0, -INFINITY, 0, 0, 0},
               {1, 0, 1, 0, 0, INFINITY, 0, 0},
               {1, 0, 1, 0, 0, 0, ((int64_t)1 << 32) + 1, 0},
               {1, 0, 1, 0, 0, 0, 0, -((int64_t)1 << 32) - 1}};
    const int64_t most = (int64_t)1 << 62;
    lg_statistics *a, *b;
    for (size_t i = 0; i < LG_COUNT(bad); i++)
        assert_status(load_cell(bad[i].count, bad[i].low, bad[i].high, bad[i].centre, bad[i].least,
                                bad[i].largest, bad[i].sum, bad[i].square, &a),
                      LG_CHECK_FAILED);
    static const struct {
        uint64_t count;
        int64_t sum, square;
        lg_status status; /* of merging the cell with itself */
    } large[] = {{UINT64_MAX / 2 + 1, 0, 0, LG_CHECK_FAILED}, {UINT64_MAX / 2, most / 2, -most / 2, LG_OK},
                 {UINT64_MAX / 2, most, 0, LG_CHECK_FAILED},  {UINT64_MAX / 2, -most, 0, LG_CHECK_FAILED},
                 {UINT64_MAX / 2, 0, most, LG_CHECK_FAILED},  {UINT64_MAX / 2, 0, -most, LG_CHECK_FAILED}};
    for (size_t i = 0; i < LG_COUNT(large); i++) {
        assert_ok(load_cell(large[i].count, 0, 1, 0, 0, 0, large[i].sum, large[i].square, &a));
        assert_ok(load_cell(large[i].count, 0, 1, 0, 0, 0, large[i].sum, large[i].square, &b));
        assert_status(lg_statistics_merge(a, b), large[i].status);
        assert_int_equal(lg_statistics_of(a, 0, 0).count,
                         large[i].status == LG_OK ? UINT64_MAX - 1 : large[i].count);
    }
}
