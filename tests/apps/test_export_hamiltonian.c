/* Learned Hamiltonians exported as C against the library: value, gradient, field and steps on random states
 * in both types; that steps stay on the manifold; the maps of SE(3) by themselves; what is refused.
 * ctest-labels: slow apps/lg-export src/hamiltonian */
#include "export_hamiltonian.h"

#include <float.h>

#include "liegrad/geometry.h"

enum { ROWS = 1000, STATE_MAX = 30, INPUT_MAX = 15 };

/* ---- both sides of a comparison ---- */

typedef struct pair {
    const sample *of;
    learned here;
    export_library lib;
    lg_stepper *stepper;
    void *memory, *work;
} pair;

static void *aligned(size_t bytes) {
    void *memory = aligned_alloc(64, (bytes + 63) / 64 * 64);
    assert_non_null(memory);
    return memory;
}

/* In place: the stepper points to the model. */
static void open_pair(pair *p, const sample *of, const char *dtype) {
    char folder[64];
    *p = (pair){.of = of, .here = learned_make(of)};
    learned_scheme(&p->here, of);
    learned_export(of, dtype, folder, sizeof folder);
    p->lib = export_open(folder, "m", export_has(of->compiler) ? of->compiler : "cc", of->flags);
    const size_t bytes = lg_model_stepper_size(p->here.model, p->here.scheme);
    p->memory = aligned(bytes);
    p->work = aligned(lg_model_work_size(p->here.model));
    assert_ok(lg_model_stepper_init(p->here.model, p->here.scheme, &p->stepper, p->memory, bytes));
    assert_int_equal(p->lib.inputs, p->here.n);
    assert_int_equal((size_t)export_constant(folder, "m", "INPUT_SIZE"), p->here.m);
}

static void close_pair(pair *p) {
    export_close(&p->lib);
    free(p->memory);
    free(p->work);
    learned_free(&p->here);
}

/* A state on the manifold as far as the exported type has it. */
static void draw_state(void *user, lg_rng *rng, double *y) {
    const pair *p = user;
    if (p->of->family == SEPARABLE) {
        for (size_t i = 0; i < p->here.n; i++) y[i] = export_rounded(&p->lib, lg_rng_uniform_in(rng, -1, 1));
        return;
    }
    for (uint32_t i = 0; i < p->of->links; i++, y += 6) {
        double u[3], norm = 0;
        for (int c = 0; c < 3; c++) y[c] = lg_rng_normal(rng), u[c] = lg_rng_uniform_in(rng, -1, 2);
        norm = sqrt(lg_dot3(y, y));
        for (int c = 0; c < 3; c++) y[c] /= norm;
        lg_cross3(y, u, y + 3);
        for (int c = 0; c < 6; c++) y[c] = export_rounded(&p->lib, y[c]);
    }
}

static void reference(void *user, const double *x, double *y, double *jacobian) {
    const pair *p = user;
    lg_model_jacobian(p->here.model, x, y, jacobian, p->work);
}

/* ---- NAME_hamiltonian, NAME_field, NAME_step in doubles ---- */

static double call_hamiltonian(const pair *p, const double *y) {
    void *in = export_reals(&p->lib, y, p->here.n);
    EXPORT_FUNCTION(&p->lib, "hamiltonian", double, (const void *, void *), of_double);
    EXPORT_FUNCTION(&p->lib, "hamiltonian", float, (const void *, void *), of_float);
    export_spoil(&p->lib);
    const double value = p->lib.single ? (double)of_float(in, p->lib.work) : of_double(in, p->lib.work);
    free(in);
    return value;
}

static void call_field(const pair *p, const double *y, const double *input, double *out) {
    void *in = export_reals(&p->lib, y, p->here.n), *u = export_reals(&p->lib, input, p->here.m);
    void *field = export_reals(&p->lib, y, p->here.n);
    EXPORT_FUNCTION(&p->lib, "field", void, (const void *, const void *, void *, void *), call);
    export_spoil(&p->lib);
    call(in, u, field, p->lib.work);
    export_doubles(&p->lib, field, out, p->here.n);
    free(field);
    free(u);
    free(in);
}

/* `steps` of them; the first one from one array into another, the others in place. */
static void call_steps(const pair *p, double h, size_t steps, const double *y, const double *input,
                       double *out) {
    void *in = export_reals(&p->lib, y, p->here.n), *u = export_reals(&p->lib, input, p->here.m);
    void *next = export_reals(&p->lib, y, p->here.n);
    EXPORT_FUNCTION(&p->lib, "step", void, (double, const void *, const void *, void *, void *), of_double);
    EXPORT_FUNCTION(&p->lib, "step", void, (float, const void *, const void *, void *, void *), of_float);
    export_spoil(&p->lib);
    for (size_t i = 0; i < steps; i++) {
        if (p->lib.single)
            of_float((float)h, i == 0 ? in : next, u, next, p->lib.work);
        else
            of_double(h, i == 0 ? in : next, u, next, p->lib.work);
    }
    export_doubles(&p->lib, next, out, p->here.n);
    free(next);
    free(u);
    free(in);
}

static double manifold_error(const pair *p, const double *y) {
    lg_space space;
    const lg_space_factor links = {LG_SPACE_TS2, p->of->links};
    if (p->of->family == SEPARABLE) return 0;
    assert_ok(lg_space_init(&space, &links, 1));
    return lg_space_manifold_error(&space, y);
}

/* ---- random states ---- */

/* Fields and steps of length h, with and without an input. */
typedef struct table {
    double field[2][ROWS * STATE_MAX], free_field[2][ROWS * STATE_MAX];
    double step[2][ROWS * STATE_MAX], free_step[2][ROWS * STATE_MAX];
    double off; /* largest manifold error of the exported steps */
} table;

static void fill_row(const pair *p, double h, const double *y, const double *input, table *t, size_t at) {
    assert_ok(lg_model_field(p->here.model, y, input, t->field[0] + at, p->work));
    assert_ok(lg_model_field(p->here.model, y, NULL, t->free_field[0] + at, p->work));
    assert_ok(lg_step(p->stepper, 0, h, y, input, t->step[0] + at));
    assert_ok(lg_step(p->stepper, 0, h, y, NULL, t->free_step[0] + at));
    call_field(p, y, input, t->field[1] + at);
    call_field(p, y, NULL, t->free_field[1] + at);
    call_steps(p, h, 1, y, input, t->step[1] + at);
    call_steps(p, h, 1, y, NULL, t->free_step[1] + at);
    t->off = fmax(t->off, manifold_error(p, t->step[1] + at));
}

static void compare_flow(const pair *p, const char *title, double h, double tolerance) {
    static table t;
    const size_t n = p->here.n;
    double y[STATE_MAX], input[INPUT_MAX];
    lg_rng rng;
    lg_rng_seed(&rng, 5, 1);
    t.off = 0;
    h = export_rounded(&p->lib, h);
    for (size_t r = 0; r < ROWS; r++) {
        draw_state((void *)p, &rng, y);
        for (size_t i = 0; i < p->here.m; i++)
            input[i] = export_rounded(&p->lib, lg_rng_uniform_in(&rng, -1, 1));
        fill_row(p, h, y, input, &t, r * n);
    }
    const double errors[] = {export_worst(t.field[1], t.field[0], ROWS, n),
                             export_worst(t.free_field[1], t.free_field[0], ROWS, n),
                             export_worst(t.step[1], t.step[0], ROWS, n),
                             export_worst(t.free_step[1], t.free_step[0], ROWS, n)};
    print_message(
        "%s: field %.2e, %.2e, step %g: %.2e, %.2e, off the manifold %.1e; tolerance %.2e, of steps "
        "%.2e\n",
        title, errors[0], errors[1], h, errors[2], errors[3], t.off, p->lib.tolerance, tolerance);
    for (int i = 0; i < 2; i++) assert_close(errors[i], 0, 0, p->lib.tolerance);
    for (int i = 2; i < 4; i++) assert_close(errors[i], 0, 0, tolerance);
    assert_true(t.off <= (p->lib.single ? 45 * FLT_EPSILON : 1e-14));
}

/* ---- single states ---- */

static void check_zero_step(const pair *p, const double *y, const double *input) {
    double out[STATE_MAX], turned[STATE_MAX];
    memcpy(turned, y, p->here.n * sizeof *y);
    turned[1] = -0.0;
    for (int sign = -1; sign <= 1; sign += 2) {
        call_steps(p, sign * 0.0, 1, turned, input, out);
        assert_memory_equal(out, turned, p->here.n * sizeof *y);
    }
}

static bool has_nan(const double *x, size_t n) {
    bool found = false;
    for (size_t i = 0; i < n; i++) found = found || isnan(x[i]);
    return found;
}

/* NaN anywhere: NaN where the library has it (the force of a linear potential does not see q), and always in
 * the next state. */
static void check_nan(const pair *p, const double *y) {
    double broken[STATE_MAX], out[STATE_MAX], want[STATE_MAX];
    for (size_t i = 0; i < p->here.n; i++) {
        memcpy(broken, y, p->here.n * sizeof *y);
        broken[i] = NAN;
        call_field(p, broken, NULL, out);
        assert_ok(lg_model_field(p->here.model, broken, NULL, want, p->work));
        for (size_t j = 0; j < p->here.n; j++) assert_int_equal(isnan(out[j]), isnan(want[j]));
        export_eval(&p->lib, broken, out);
        lg_model_eval(p->here.model, broken, want, p->work);
        assert_int_equal(isnan(out[0]), isnan(want[0]));
        call_steps(p, 0.025, 1, broken, NULL, out);
        assert_true(has_nan(out, p->here.n));
    }
    call_steps(p, (double)NAN, 1, y, NULL, out);
    assert_true(has_nan(out, p->here.n));
}

/* In place and from one array to another: the same bits, with the value beside. */
static void check_in_place(const pair *p, const double *y, const double *input) {
    double once[STATE_MAX], twice[STATE_MAX], again[STATE_MAX], value;
    call_steps(p, 0.025, 1, y, input, once);
    call_steps(p, 0.025, 1, once, input, twice);
    call_steps(p, 0.025, 2, y, input, again);
    assert_memory_equal(twice, again, p->here.n * sizeof *y);
    export_eval(&p->lib, y, &value);
    const double named = call_hamiltonian(p, y);
    assert_memory_equal(&value, &named, sizeof value);
}

static void check_single_states(const pair *p) {
    double y[STATE_MAX], input[INPUT_MAX];
    lg_rng rng;
    lg_rng_seed(&rng, 6, 1);
    for (size_t i = 0; i < p->here.m; i++) input[i] = lg_rng_uniform_in(&rng, -1, 1);
    for (int r = 0; r < 5; r++) {
        draw_state((void *)p, &rng, y);
        check_zero_step(p, y, input);
        check_in_place(p, y, input);
        if (r == 0) check_nan(p, y);
    }
}

static void check_sample(const sample *of, const char *dtype) {
    char title[64];
    (void)snprintf(title, sizeof title, "%s %s", of->folder, dtype);
    pair p;
    open_pair(&p, of, dtype);
    (void)snprintf(title, sizeof title, "%s-%s", of->folder, dtype);
    const double evaluations = export_constant(title, "m", "STEP_EVALUATIONS");
    assert_int_equal(evaluations, of->evaluations);
    export_compare(&p.lib, title, ROWS, draw_state, reference, &p);
    compare_flow(&p, title, 0.025, p.lib.tolerance);
    compare_flow(&p, title, -0.1, p.lib.tolerance * evaluations);
    check_single_states(&p);
    close_pair(&p);
}

TEST("every model agrees with the library") {
    for (size_t i = 0; i < SAMPLES; i++) {
        check_sample(&samples[i], "f64");
        check_sample(&samples[i], "f32");
    }
}

/* A mass matrix that is nearly singular multiplies rounding: the stated tolerance knows, and is not far above
 * what happens. */
/* Rows of the table that have no sample above, too. */
TEST("the self test of every family passes") {
    for (size_t i = 0; i < lg_hamiltonian_family_count(); i++) {
        const lg_hamiltonian_family *family = lg_hamiltonian_family_at(i);
        const sample of = {family->name, family, 2, MLP, NONE, LG_TANH, "", 0, "cc", "-O1"};
        char folder[64], command[128];
        learned made = learned_make(&of);
        learned_export(&of, "f64", folder, sizeof folder);
        (void)snprintf(command, sizeof command, "make -C %s test CFLAGS=-O1", folder);
        export_expect(command);
        learned_free(&made);
    }
}

TEST("nearly singular masses have a condition") {
    static const sample of = {"stiff3", CHAIN, 3, MLP, NONE, LG_TANH, "", 4, "gcc", "-O2"};
    static const char *const dtypes[] = {"f64", "f32"};
    for (int d = 0; d < 2; d++) {
        pair p;
        open_pair(&p, &of, dtypes[d]);
        const double plain = 20 * 4 * (d == 0 ? DBL_EPSILON : (double)FLT_EPSILON);
        assert_true(p.lib.tolerance > 5 * plain && p.lib.tolerance < 1e4 * plain);
        export_compare(&p.lib, dtypes[d], ROWS, draw_state, reference, &p);
        compare_flow(&p, dtypes[d], 1e-6, p.lib.tolerance);
        close_pair(&p);
    }
}

/* ---- long runs ---- */

static void check_long_run(const sample *of, const char *dtype, double bound) {
    double y[STATE_MAX], input[INPUT_MAX];
    double worst = 0;
    pair p;
    open_pair(&p, of, dtype);
    lg_rng rng;
    lg_rng_seed(&rng, 8, 1);
    draw_state(&p, &rng, y);
    for (size_t i = 0; i < p.here.m; i++) input[i] = 0.0;
    for (int i = 0; i < 100; i++) {
        call_steps(&p, 0.025, 1000, y, input, y);
        worst = fmax(worst, manifold_error(&p, y));
        assert_false(has_nan(y, p.here.n));
    }
    print_message("%s-%s: off the manifold by at most %.1e in 1e5 steps\n", of->folder, dtype, worst);
    assert_true(worst <= bound);
    close_pair(&p);
}

TEST("long runs stay on the manifold") {
    for (size_t i = 0; i < 2; i++) {
        check_long_run(&samples[i], "f64", 1e-14);
        check_long_run(&samples[i], "f32", 16 * (double)FLT_EPSILON);
    }
}

/* ---- large steps ---- */

/* The first link turns by this angle in a step of Lie-Euler, by the field at the state. */
static double turn_first(const pair *p, double angle, lg_rng *rng) {
    double y[STATE_MAX], field[STATE_MAX], want[STATE_MAX], got[STATE_MAX];
    draw_state((void *)p, rng, y);
    assert_ok(lg_model_field(p->here.model, y, NULL, field, p->work));
    const double h = export_rounded(&p->lib, angle / sqrt(lg_dot3(field, field)));
    assert_ok(lg_step(p->stepper, 0, h, y, NULL, want));
    assert_close(lg_stepper_angle(p->stepper) >= angle * 0.999, 1, 0, 0);
    call_steps(p, h, 1, y, NULL, got);
    assert_true(manifold_error(p, got) <= (p->lib.single ? 64 * (double)FLT_EPSILON : 1e-13));
    return export_norm(got, want, p->here.n) / export_norm(want, NULL, p->here.n) /
           (1 + lg_stepper_angle(p->stepper));
}

TEST("steps of a turn agree") {
    static const double angles[] = {3.1, 3.141592653589793, 3.2, 6.2, 6.283185307179586, 6.3, 20};
    static const char *const dtypes[] = {"f64", "f32"};
    for (int d = 0; d < 2; d++) {
        pair p;
        double worst = 0;
        lg_rng rng;
        lg_rng_seed(&rng, 11, 1);
        open_pair(&p, &samples[3], dtypes[d]);
        for (size_t i = 0; i < LG_COUNT(angles); i++)
            for (int r = 0; r < 20; r++) {
                const double error = turn_first(&p, angles[i], &rng);
                worst = error <= worst ? worst : error;
            }
        print_message("%s: steps of up to a few turns to %.2e (1 + |u|)\n", dtypes[d], worst);
        assert_close(worst, 0, 0, p.lib.tolerance);
        close_pair(&p);
    }
}

/* ---- the maps of SE(3) ---- */

/* They are static: a copy of the code with two more functions. */
static export_library open_geometry(const char *dtype) {
    char command[1024], folder[64];
    learned made = learned_make(&samples[0]);
    const sample of = {"geometry", CHAIN, 1, MLP, NONE, LG_TANH, "rkmk4", 4, "gcc", "-O2"};
    learned_save(&made, "geometry");
    learned_free(&made);
    learned_export(&of, dtype, folder, sizeof folder);
    (void)snprintf(command, sizeof command,
                   "cd %s && printf '%%s\\n' 'void m_act(const real *, const real *, real *);' "
                   "'void m_dexpinv(const real *, real *);' "
                   "'void m_act(const real *a, const real *y, real *out) { real q[3], p[3]; "
                   "so3_exp(1, 1, a, y, q); se3_act(1, a, a + 3, y, y + 3, p); "
                   "for (int i = 0; i < 3; i++) { out[i] = q[i]; out[3 + i] = p[i]; } }' "
                   "'void m_dexpinv(const real *a, real *b) { real B[3], v[3]; so3_dexpinv(1, a, b, B); "
                   "se3_dexpinv(1, a, a + 3, b, b + 3, v); "
                   "for (int i = 0; i < 3; i++) { b[i] = B[i]; b[3 + i] = v[i]; } }' >> m.c",
                   folder);
    export_expect(command);
    return export_open(folder, "m", of.compiler, of.flags);
}

/* Errors of both maps at one |u|, in eps (1 + |u| and what conditioning does near the pole of dexpinv). */
static void check_maps(const export_library *lib, double angle, lg_rng *rng, double worst[2]) {
    const double eps = lib->single ? (double)FLT_EPSILON : DBL_EPSILON;
    double a[6], y[6], b[6], want[6], got[6], norm;
    for (int i = 0; i < 6; i++)
        a[i] = lg_rng_normal(rng), y[i] = lg_rng_normal(rng), b[i] = lg_rng_normal(rng);
    norm = sqrt(lg_dot3(a, a));
    for (int i = 0; i < 3; i++) a[i] *= angle / norm;
    for (int i = 0; i < 6; i++) {
        a[i] = export_rounded(lib, a[i]);
        y[i] = export_rounded(lib, y[i]);
        b[i] = export_rounded(lib, b[i]);
    }
    void *ra = export_reals(lib, a, 6), *ry = export_reals(lib, y, 6), *rb = export_reals(lib, b, 6);
    EXPORT_FUNCTION(lib, "act", void, (const void *, const void *, void *), act);
    EXPORT_FUNCTION(lib, "dexpinv", void, (const void *, void *), dexpinv);
    act(ra, ry, ry);
    export_doubles(lib, ry, got, 6);
    lg_se3_exp_act(a, y, want);
    worst[0] = fmax(worst[0], export_norm(got, want, 6) / export_norm(want, NULL, 6) / eps / (1 + angle));
    dexpinv(ra, rb);
    export_doubles(lib, rb, got, 6);
    lg_se3_dexpinv(a, b, want);
    const double pole = fabs(remainder(angle, 6.2831853071795865));
    const double condition = angle < 3 ? 1 : (1 + angle) * (1 + angle) / pole;
    worst[1] = fmax(worst[1], export_norm(got, want, 6) / export_norm(want, NULL, 6) / eps / condition);
    free(rb);
    free(ry);
    free(ra);
}

TEST("maps are accurate at every angle") {
    static const double angles[] = {0,        1e-300,
                                    1e-20,    1e-9,
                                    1e-5,     1e-3,
                                    0.01,     0.1,
                                    0.5,      1,
                                    1.999999, 2,
                                    2.000001, 3,
                                    3.14159,  3.141592653589793,
                                    3.15,     4,
                                    5,        6,
                                    6.28,     6.283185307179586,
                                    6.29,     7,
                                    9.42,     12,
                                    30,       100};
    static const char *const dtypes[] = {"f64", "f32"};
    for (int d = 0; d < 2; d++) {
        export_library lib = open_geometry(dtypes[d]);
        lg_rng rng;
        lg_rng_seed(&rng, 9, 1);
        double worst[2] = {0, 0};
        for (size_t i = 0; i < LG_COUNT(angles); i++)
            for (int r = 0; r < 100; r++) check_maps(&lib, angles[i], &rng, worst);
        print_message("%s: exp acts to %.1f eps (1 + |u|), dexpinv to %.1f eps condition\n", dtypes[d],
                      worst[0], worst[1]);
        assert_true(worst[0] <= 10);
        assert_true(worst[1] <= 20);
        export_close(&lib);
    }
}

/* ---- objects ---- */

/* More compilers and models: test_export_hamiltonian_ways. */
TEST("objects need libm alone and little stack") {
    static const size_t some[] = {1, 12};
    for (size_t i = 0; i < 2; i++) {
        char folder[64];
        const sample *of = &samples[some[i]];
        learned made = learned_make(of);
        learned_export(of, "f64", folder, sizeof folder);
        export_check_objects(folder, "m");
        export_check_stack(folder);
        learned_free(&made);
    }
}

/* ---- what the header tells ---- */

static void assert_header(const char *folder, const char *const *lines, size_t count, bool there) {
    static char text[65536];
    char name[128];
    (void)snprintf(name, sizeof name, "%s/m.h", folder);
    cli_read(name, text, sizeof text);
    for (size_t i = 0; i < count; i++)
        if ((strstr(text, lines[i]) != NULL) != there)
            fail_msg("%s: '%s' is %s", name, lines[i], there ? "missing" : "there");
}

/* The errors as `evaluate --record` leaves them, with the test set they are of. */
TEST("the header tells the errors") {
    static const char *const errors[] = {
        "E1            1.2346e-07: mean squared error", "E2            3.4568e-04: mean |d - mean d|",
        "test set      100 trajectories of 15 points over a time of 1.5\n",
        "test SHA-256  0000000000000000000000000000000000000000000000000000000000000007\n"};
    static const char *const bare[] = {"E1            1.2346e-07", "test set      of unknown size"};
    static const char *const none[] = {"test set      none recorded"};
    static const char *const own[] = {"over a time of 1.5: THE TRAINING DATA"};
    char folder[64];
    learned made = learned_make(&samples[11]);
    lg_hamiltonian_file *file = &made.file;
    learned_export(&samples[11], "f64", folder, sizeof folder);
    assert_header(folder, none, 1, true);
    assert_header(folder, (const char *[]){"E1  ", "E2  ", "test SHA-256"}, 3, false);
    lg_hamiltonian_file judged = *file;
    judged.has_e1 = judged.has_e2 = true;
    judged.e1 = 1.23456e-7, judged.e2 = 3.45678e-4;
    judged.test = (lg_test_set){.trajectories = 100, .points = 15, .t_end = 1.5};
    (void)snprintf(judged.test.sha256, sizeof judged.test.sha256, "%064d", 7);
    char path[1024];
    cli_path("flat1.h5", path, sizeof path);
    assert_ok(lg_model_record_hamiltonian(NULL, path, &judged, NULL));
    export_run("flat1.h5 --out told --name m");
    assert_header("told", errors, 4, true);
    assert_header("told", none, 1, false);
    assert_header("told", own, 1, false);
    judged.has_e2 = false;
    judged.test = (lg_test_set){.trajectories = 0};
    assert_ok(lg_model_record_hamiltonian(NULL, path, &judged, NULL));
    export_run("flat1.h5 --out bare --name m");
    assert_header("bare", bare, 2, true);
    assert_header("bare", (const char *[]){"E2  ", "test SHA-256"}, 2, false);
    file->has_e1 = true;
    file->test = (lg_test_set){.trajectories = 2, .points = 15, .t_end = 1.5};
    (void)snprintf(file->test.sha256, sizeof file->test.sha256, "%064d", 8);
    memcpy(file->run.data_sha256, file->test.sha256, sizeof file->run.data_sha256);
    learned_save(&made, "own");
    export_run("own.h5 --out own --name m");
    assert_header("own", own, 1, true);
    learned_free(&made);
}

/* ---- what is refused ---- */

TEST("schemes without an explicit step are refused") {
    static const cli_bad rows[] = {
        {"chain1.h5 --out no --scheme rk4", 2, "Lie group"},
        {"chain1.h5 --out no --scheme stormer-verlet", 2, "Lie group"},
        {"chain1.h5 --out no --scheme slgi", 2, "Lie group"},
        {"chain1.h5 --out no --scheme midpoint", 2, "Lie group"},
        {"chain1.h5 --out no --scheme variational", 2, "Lie group"},
        {"flat1.h5 --out no --scheme midpoint", 2, "explicit"},
        {"flat1.h5 --out no --scheme implicit-euler", 2, "explicit"},
        {"flat1.h5 --out no --scheme variational", 2, "explicit"},
    };
    static cli result;
    for (size_t i = 0; i < SAMPLES; i++) {
        learned made = learned_make(&samples[i]);
        learned_free(&made);
    }
    cli_expect_refused("lg-export", rows, LG_COUNT(rows), &result);
    assert_false(cli_exists("no"));
}

/* A mass matrix that is singular, and one whose inverse a float cannot hold. */
TEST("masses without an inverse are refused") {
    static cli result;
    learned made = learned_make(&samples[1]);
    double *kinetic = made.file.theta + lg_mlp_parameters(&made.file.run.model.net);
    for (int i = 0; i < 6; i++) kinetic[i] = i == 0 ? 1 : 0;
    learned_save(&made, "singular");
    cli_expect("lg-export", "singular.h5 --out no", 3, "not positive definite", &result);
    for (int i = 0; i < 6; i++) kinetic[i] = i >= 4 ? 1e-44 : 0;
    learned_save(&made, "light");
    cli_expect("lg-export", "light.h5 --out no --dtype f32", 3, "inverse", &result);
    assert_false(cli_exists("no"));
    learned_free(&made);
}

TEST_GROUP(hamiltonians_begin, export_end)
