/* Learned machines exported as C against the library: energy, gradient, field, steps, states and what a log
 * has, on random states in both types; long runs; self-tests by all compilers; what is refused.
 * ctest-labels: slow apps/lg-export src/machine */
#include "support/models.h"
#include "export_models.h"

#include <float.h>

#include "support/machine_models.h"

enum { ROWS = 1000, MOST = LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES };

typedef struct sample {
    const char *name, *yaml;
    const char *compiler, *flags;
} sample;

static const sample samples[] = {
    {"all", machine_of_all_kinds, "gcc", "-O2"}, {"body", machine_of_a_body, "clang", "-O3"},
    {"cart", machine_of_a_cart, "g++", "-O1"},   {"rod", machine_without_inputs, "gcc", "-O0"},
    {"top", machine_of_a_top, "clang", "-O1"},   {"chain", machine_of_a_chain, "gcc", "-O3"},
    {"arm", machine_of_an_arm, "gcc", "-O2"}};

/* The library's side. */
typedef struct learned {
    lg_machine_model_file *file;
    const lg_machine *machine;
    lg_space space;
    lg_model *model;
    lg_stepper *stepper;
    void *work;
} learned;

static void release_model(void *model) {
    lg_model_destroy(model);
}

static learned *learned_of(size_t i) {
    char path[1024], name[64];
    learned *l = TEST_ARRAY(learned, 1);
    l->file = make_machine_model(samples[i].yaml, 3);
    l->machine = &l->file->run.machine;
    (void)snprintf(name, sizeof name, "%s.h5", samples[i].name);
    cli_path(name, path, sizeof path);
    save_machine_model(l->file, path);
    assert_ok(lg_machine_space(l->machine, &l->space));
    assert_ok(test_machine_model(NULL, l->machine, l->file->theta, &l->model, NULL));
    lg_test_owns(l->model, release_model);
    l->work = test_work(lg_model_work_size(l->model));
    const size_t bytes = lg_model_stepper_size(l->model, lg_scheme_find("cf4"));
    assert_ok(lg_model_stepper_init(l->model, lg_scheme_find("cf4"), &l->stepper, test_work(bytes), bytes));
    return l;
}

/* Positions and velocities of size 1, directions and rotations anywhere. */
static void draw_logged(const learned *l, lg_rng *rng, double *q, double *v) {
    double y[MOST] = {0}, element[MOST], *part = y + l->machine->places;
    uint32_t at = 0;
    for (uint32_t i = 0; i < l->machine->directions; i++, part += 6) part[2] = 1;
    for (uint32_t i = 0; i < l->machine->rotations; i++, part += 9) part[0] = part[4] = part[8] = 1;
    for (size_t k = 0; k < l->space.algebra_dim; k++) element[k] = lg_rng_normal(rng);
    lg_space_act(&l->space, element, y, y);
    assert_ok(lg_model_machine_positions(l->model, y, q, l->work));
    for (uint32_t i = 0; i < l->machine->coordinate_count; i++) {
        const lg_coordinate_kind kind = l->machine->coordinates[i].kind;
        for (uint32_t k = 0; k < lg_coordinate_row_of(kind)->places; k++)
            q[at + k] = lg_rng_uniform_in(rng, -1, 2);
        at += lg_coordinate_positions(kind);
    }
    for (uint32_t k = 0; k < l->machine->velocities; k++) v[k] = lg_rng_uniform_in(rng, -1, 2);
}

static void draw(void *user, lg_rng *rng, double *x) {
    const learned *l = ((exported *)user)->model;
    double q[LG_MACHINE_POSITIONS], v[LG_MACHINE_VELOCITIES];
    draw_logged(l, rng, q, v);
    assert_ok(lg_model_machine_state(l->model, q, v, x, l->work));
}

static void reference(void *user, const double *x, double *y, double *jacobian) {
    const learned *l = ((exported *)user)->model;
    lg_model_jacobian(l->model, x, y, jacobian, l->work);
}

/* ---- the functions in doubles ---- */

static void call_field(const export_library *lib, const learned *l, const double *y, const double *u,
                       double *out) {
    void *in = export_reals(lib, y, l->space.dim), *with = export_reals(lib, u, l->machine->input_count),
         *field = export_reals(lib, y, l->space.dim);
    EXPORT_FUNCTION(lib, "field", void, (const void *, const void *, void *, void *), call);
    export_spoil(lib);
    call(in, with, field, lib->work);
    export_doubles(lib, field, out, l->space.algebra_dim);
    free(field);
    free(with);
    free(in);
}

/* In place but for the first. */
static void call_steps(const export_library *lib, const learned *l, double h, size_t steps, const double *y,
                       const double *u, double *out) {
    void *in = export_reals(lib, y, l->space.dim), *with = export_reals(lib, u, l->machine->input_count),
         *next = export_reals(lib, y, l->space.dim);
    EXPORT_FUNCTION(lib, "step", void, (double, const void *, const void *, void *, void *), of_double);
    EXPORT_FUNCTION(lib, "step", void, (float, const void *, const void *, void *, void *), of_float);
    export_spoil(lib);
    for (size_t i = 0; i < steps; i++) {
        if (lib->single)
            of_float((float)h, i == 0 ? in : next, with, next, lib->work);
        else
            of_double(h, i == 0 ? in : next, with, next, lib->work);
    }
    export_doubles(lib, next, out, l->space.dim);
    free(next);
    free(with);
    free(in);
}

static void call_one(const export_library *lib, const char *what, const double *x, size_t ins, double *y,
                     size_t outs) {
    void *in = export_reals(lib, x, ins), *out = export_reals(lib, y, outs);
    EXPORT_FUNCTION(lib, what, void, (const void *, void *, void *), call);
    export_spoil(lib);
    call(in, out, lib->work);
    export_doubles(lib, out, y, outs);
    free(out);
    free(in);
}

static void call_state(const export_library *lib, const learned *l, const double *q, const double *v,
                       double *y) {
    void *positions = export_reals(lib, q, l->machine->positions),
         *velocities = export_reals(lib, v, l->machine->velocities),
         *out = export_reals(lib, y, l->space.dim);
    EXPORT_FUNCTION(lib, "state", void, (const void *, const void *, void *, void *), call);
    export_spoil(lib);
    call(positions, velocities, out, lib->work);
    export_doubles(lib, out, y, l->space.dim);
    free(out);
    free(velocities);
    free(positions);
}

/* ---- comparisons ---- */

enum { FIELD, FREE_FIELD, STEP, FREE_STEP, STATE, VELOCITIES, POSITIONS, QUANTITIES };

typedef struct table {
    double of[QUANTITIES][2][ROWS * MOST];
} table;

static void fill_row(const export_library *lib, const learned *l, double h, lg_rng *rng, table *t, size_t r) {
    const size_t d = l->space.dim, a = l->space.algebra_dim, nq = l->machine->positions,
                 nv = l->machine->velocities;
    double q[LG_MACHINE_POSITIONS], v[LG_MACHINE_VELOCITIES], y[MOST] = {0}, u[LG_MACHINE_INPUTS];
    draw_logged(l, rng, q, v);
    for (size_t i = 0; i < nq; i++) q[i] = export_rounded(lib, q[i]);
    for (size_t i = 0; i < nv; i++) v[i] = export_rounded(lib, v[i]);
    for (size_t i = 0; i < l->machine->input_count; i++)
        u[i] = export_rounded(lib, lg_rng_uniform_in(rng, -1, 1));
    assert_ok(lg_model_machine_state(l->model, q, v, t->of[STATE][0] + r * d, l->work));
    call_state(lib, l, q, v, t->of[STATE][1] + r * d);
    for (size_t i = 0; i < d; i++) y[i] = export_rounded(lib, t->of[STATE][0][r * d + i]);
    assert_ok(lg_model_machine_velocities(l->model, y, t->of[VELOCITIES][0] + r * nv, l->work));
    call_one(lib, "velocities", y, d, t->of[VELOCITIES][1] + r * nv, nv);
    assert_ok(lg_model_machine_positions(l->model, y, t->of[POSITIONS][0] + r * nq, l->work));
    call_one(lib, "positions", y, d, t->of[POSITIONS][1] + r * nq, nq);
    for (int forced = 0; forced < 2; forced++) {
        const double *input = forced ? u : NULL;
        const int field = forced ? FIELD : FREE_FIELD, step = forced ? STEP : FREE_STEP;
        assert_ok(lg_model_field(l->model, y, input, t->of[field][0] + r * a, l->work));
        call_field(lib, l, y, input, t->of[field][1] + r * a);
        assert_ok(lg_step(l->stepper, 0, h, y, input, t->of[step][0] + r * d));
        call_steps(lib, l, h, 1, y, input, t->of[step][1] + r * d);
    }
}

static void compare_motion(exported *e) {
    static const char *const names[QUANTITIES] = {"field", "free field", "step",     "free step",
                                                  "state", "velocities", "positions"};
    const learned *l = e->model;
    const size_t d = l->space.dim, a = l->space.algebra_dim;
    const size_t sizes[QUANTITIES] = {a, a, d, d, d, l->machine->velocities, l->machine->positions};
    const double h = export_rounded(&e->lib, 0.02);
    table *t = TEST_ARRAY(table, 1);
    lg_rng rng;
    lg_rng_seed(&rng, 5, 1);
    assert_int_equal((size_t)export_constant(e->folder, "m", "STATE_SIZE"), d);
    assert_int_equal((size_t)export_constant(e->folder, "m", "FIELD_SIZE"), a);
    assert_int_equal((size_t)export_constant(e->folder, "m", "INPUT_SIZE"), l->machine->input_count);
    assert_int_equal((size_t)export_constant(e->folder, "m", "POSITIONS"), l->machine->positions);
    assert_int_equal((size_t)export_constant(e->folder, "m", "VELOCITIES"), l->machine->velocities);
    assert_int_equal((size_t)export_constant(e->folder, "m", "STEP_EVALUATIONS"), 4);
    for (size_t r = 0; r < ROWS; r++) fill_row(&e->lib, l, h, &rng, t, r);
    for (int i = 0; i < QUANTITIES; i++) {
        const double error = export_worst(t->of[i][1], t->of[i][0], ROWS, sizes[i]);
        print_message("%s: %s %.2e; tolerance %.2e\n", e->folder, names[i], error, e->lib.tolerance);
        assert_close(error, 0, 0, e->lib.tolerance);
    }
}

/* The value is that of NAME_eval; a step of 0 copies; two steps in place are two steps. */
static void check_single_states(exported *e) {
    const learned *l = e->model;
    const size_t bytes = l->space.dim * sizeof(double);
    double y[MOST] = {0}, once[MOST], twice[MOST], again[MOST], u[LG_MACHINE_INPUTS] = {0.3, -0.2, 0.1};
    lg_rng rng;
    lg_rng_seed(&rng, 6, 1);
    draw(e, &rng, y);
    for (size_t i = 0; i < l->space.dim; i++) y[i] = export_rounded(&e->lib, y[i]);
    call_steps(&e->lib, l, 0, 1, y, u, once);
    assert_memory_equal(once, y, bytes);
    call_steps(&e->lib, l, 0.02, 1, y, u, once);
    call_steps(&e->lib, l, 0.02, 1, once, u, twice);
    call_steps(&e->lib, l, 0.02, 2, y, u, again);
    assert_memory_equal(twice, again, bytes);
    y[0] = NAN;
    call_steps(&e->lib, l, 0.02, 1, y, u, once);
    assert_true(isnan(once[0]));
}

/* Damped: it comes to rest; what has a manifold stays on it. */
static void check_long_run(exported *e) {
    const learned *l = e->model;
    double y[MOST], worst = 0;
    lg_rng rng;
    lg_rng_seed(&rng, 8, 1);
    draw(e, &rng, y);
    for (int i = 0; i < 20; i++) {
        call_steps(&e->lib, l, 0.01, 1000, y, NULL, y);
        worst = fmax(worst, lg_space_manifold_error(&l->space, y));
    }
    print_message("%s: off the manifold by at most %.1e in 2e4 steps\n", e->folder, worst);
    assert_true(worst <= (e->lib.single ? 45 * (double)FLT_EPSILON : 1e-14));
}

static void more(exported *e) {
    compare_motion(e);
    check_single_states(e);
    check_long_run(e);
}

static const char *name_of(size_t i) {
    return samples[i].name;
}

static export_way way_of(size_t i) {
    return (export_way){samples[i].compiler, samples[i].flags};
}

static void *make(size_t i) {
    return learned_of(i);
}

static const export_kind machines = {.count = LG_COUNT(samples),
                                     .name = name_of,
                                     .way = way_of,
                                     .make = make,
                                     .draw = draw,
                                     .reference = reference,
                                     .more = more};

TEST_GROUP(export_begin, export_end)

TEST("machines in double agree with the library") {
    export_compare_all(&machines, "f64");
}

TEST("machines in single agree with the library") {
    export_compare_all(&machines, "f32");
}

TEST("self-tests pass with every compiler, objects need libm alone, the stack is as stated") {
    for (size_t i = 0; i < 2; i++) {
        static const char *const dtypes[] = {"f64", "f32"};
        exported e = export_saved(samples[i].name, dtypes[i], 7, learned_of(i));
        export_check_ways(e.folder, "m");
        export_check_objects(e.folder, "m");
        export_check_stack(e.folder);
    }
}

/* A (TANGENT, TANGENT), B (TANGENT, INPUT_SIZE) in doubles. */
static void call_linearise(const export_library *lib, const learned *l, const double *y, const double *u,
                           double *A, double *B) {
    const size_t r = lg_model_tangent_dim(l->model), m = l->machine->input_count;
    void *in = export_reals(lib, y, l->space.dim), *with = export_reals(lib, u, m),
         *a = export_reals(lib, A, r * r), *b = export_reals(lib, B, r * m);
    EXPORT_FUNCTION(lib, "linearise", void, (const void *, const void *, void *, void *, void *), call);
    export_spoil(lib);
    call(in, with, a, b, lib->work);
    export_doubles(lib, a, A, r * r);
    export_doubles(lib, b, B, r * m);
    free(b);
    free(a);
    free(with);
    free(in);
}

static void compare_linearisation(exported *e) {
    enum { POINTS = 100 };
    const learned *l = e->model;
    const size_t r = lg_model_tangent_dim(l->model), m = l->machine->input_count, size = r * (r + m);
    double *want = TEST_ARRAY(double, POINTS *size), *got = TEST_ARRAY(double, POINTS *size);
    lg_rng rng;
    lg_rng_seed(&rng, 9, 1);
    assert_int_equal((size_t)export_constant(e->folder, "m", "TANGENT"), r);
    for (size_t i = 0; i < POINTS; i++) {
        double y[MOST], u[LG_MACHINE_INPUTS];
        const double *input = i % 2 == 0 ? u : NULL;
        double *A = want + i * size, *mine = got + i * size;
        draw(e, &rng, y);
        for (size_t k = 0; k < l->space.dim; k++) y[k] = export_rounded(&e->lib, y[k]);
        for (size_t k = 0; k < m; k++) u[k] = export_rounded(&e->lib, lg_rng_uniform_in(&rng, -1, 1));
        assert_ok(lg_model_linearise(l->model, y, input, A, A + r * r, NULL, l->work));
        call_linearise(&e->lib, l, y, input, mine, NULL);
        call_linearise(&e->lib, l, y, input, NULL, mine + r * r);
    }
    const double error = export_worst(got, want, POINTS, size);
    print_message("%s: linearisation %.2e; tolerance %.2e\n", e->folder, error, e->lib.tolerance);
    assert_close(error, 0, 0, e->lib.tolerance);
}

TEST("with --functions linearise there is the linearisation of the library") {
    for (size_t i = 0; i < LG_COUNT(samples); i++)
        for (int single = 0; single < 2; single++) {
            char line[256], folder[32];
            const size_t mark = lg_test_owned();
            exported e = {.name = samples[i].name, .model = learned_of(i)};
            (void)snprintf(folder, sizeof folder, "%s-linear-%s", e.name, single ? "f32" : "f64");
            (void)snprintf(e.folder, sizeof e.folder, "%s", folder);
            (void)snprintf(line, sizeof line, "%s.h5 --out %s --name m --dtype %s --functions linearise",
                           e.name, folder, single ? "f32" : "f64");
            export_run(line);
            export_compile(&e, way_of(i));
            compare_linearisation(&e);
            export_close(&e.lib);
            if (i == 0 && !single) export_check_ways(folder, "m");
            if (i == 0) export_check_stack(folder);
            lg_test_give_back(mark);
        }
}

TEST("other functions of machines, and functions of other kinds, are refused") {
    static cli result;
    (void)learned_of(1);
    cli_expect("lg-export", "body.h5 --out refused --functions step", 2, "only linearise", &result);
    cli_expect("lg-export", "body.h5 --out refused --compact", 2, "for programs", &result);
}

TEST("the header tells state, inputs and the range of the data") {
    static char out[EXPORT_TEXT];
    exported e = export_saved("all", "f64", 7, learned_of(0));
    static const char *const words[] = {
        "x theta hull.x hull.y hull.z rod.q (3) rod.p (3) body.R (9, rows) hull.R", "u1 u2 as in the log",
        "theta -1 to 2", "cf4, order 4: 4 evaluations", "20 windows of 5 rows 0.02 apart"};
    char command[128];
    (void)snprintf(command, sizeof command, "cat %s/m.h", e.folder);
    assert_int_equal(export_shell(command, out), 0);
    for (size_t i = 0; i < LG_COUNT(words); i++) assert_says(out, words[i]);
}

TEST("schemes that leave the manifold are refused, other ones are taken") {
    static cli result;
    (void)learned_of(1);
    (void)learned_of(2);
    cli_expect("lg-export", "body.h5 --out refused --scheme rk4", 2, "", &result);
    export_run("cart.h5 --out rk4 --scheme rk4 --name m");
    export_run("body.h5 --out euler --scheme lie-euler --name m");
    assert_true(export_constant("euler", "m", "STEP_EVALUATIONS") == 1);
    export_expect("make -C rk4 test CFLAGS=-O1 && make -C euler test CFLAGS=-O1");
}
