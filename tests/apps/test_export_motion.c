/* Compares exported Hamiltonians and machines with the library: value, gradient, field, steps, states and
 * linearisation at random states in both types. Also: steps stay on the manifold, and the maps of SE(3) alone
 * are accurate.
 * ctest-labels: slow apps/lg-export src/hamiltonian src/machine */
#include "export_models.h"

#include "liegrad/geometry.h"
#include "liegrad/integrators.h"
#include "hamiltonian/internal.h"
#include "support/machine_models.h"

#define CHAIN     (&lg_hamiltonian_chain)
#define SEPARABLE (&lg_hamiltonian_separable)
enum { MLP = LG_POTENTIAL_MLP, LINEAR = LG_POTENTIAL_LINEAR, DICTIONARY = LG_POTENTIAL_DICTIONARY };
enum {
    NONE = LG_SYMMETRY_NONE,
    EVEN = LG_SYMMETRY_EVEN,
    ODD = LG_SYMMETRY_ODD,
    AXIAL = LG_SYMMETRY_AXIAL,
    SPHERICAL = LG_SYMMETRY_SPHERICAL
};
enum { ROWS = 1000, MOST = 80 };

typedef struct example {
    export_row row;
    int evaluations; /* of the field in one step */
    double off;      /* allowed manifold error in a long run, in eps of float; 0: no such run */
    const char *machine;
    const lg_hamiltonian_family *family;
    uint32_t links;
    int potential, symmetry;
    lg_activation activation;
} example;

/* One scheme of each kind, from files: Kutta's of order 3 with dexpinv truncated after the fourth term (of
 * the odd terms only the first is not 0); the classical tableau with the state updated by brackets; a point
 * that is used again; McLachlan and Atela's of order 2. */
static const char truncated_yaml[] =
    "kind: rkmk\norder: 3\na: [[], [1/2], [-1, 2]]\nb: [1/6, 2/3, 1/6]\ndexpinv: 4\n";
static const char reused_yaml[] =
    "kind: commutator-free\norder: 1\nrows:\n  - []\n  - [1/4]\n  - {base: 2, exponentials: [[0, 1/4], "
    "[1/8, 1/8]]}\n  - {base: 3, exponentials: [[0, 0, 1/4]]}\n";
static const char splitting_yaml[] =
    "kind: splitting\norder: 2\nkick: [0.70710678118654752, 0.29289321881345248]\n"
    "drift: [0.29289321881345248, 0.70710678118654752]\n";

static const example examples[] = {
    {{"chain1", "gcc", "-O2", ""}, 4, 16, NULL, CHAIN, 1, MLP, NONE, LG_TANH},
    {{"chain2", "clang", "-O3", "rkmk4"}, 4, 16, NULL, CHAIN, 2, MLP, NONE, LG_SIGMOID},
    {{"chain3", "gcc", "-O1", "rkmk54"}, 6, 0, NULL, CHAIN, 3, MLP, NONE, LG_SWISH},
    {{"chain5", "gcc", "-O3", "lie-euler"}, 1, 0, NULL, CHAIN, 5, MLP, NONE, LG_SINE},
    {{"linear1", "clang", "-O0", "cf32a"}, 3, 0, NULL, CHAIN, 1, LINEAR, NONE, LG_TANH},
    {{"linear3", "gcc", "-O0", "rkmk4-2c"}, 4, 0, NULL, CHAIN, 3, LINEAR, NONE, LG_TANH},
    {{"relu2", "clang", "-O2", "cf43"}, 4, 0, NULL, CHAIN, 2, MLP, NONE, LG_RELU},
    {{"leaky1", "g++", "-O2", "lie-heun"}, 2, 0, NULL, CHAIN, 1, MLP, NONE, LG_LEAKY_RELU},
    {{"cg2", "clang++", "-O1", "cg3"}, 3, 0, NULL, CHAIN, 2, MLP, NONE, LG_TANH},
    {{"cut2", "gcc", "-O2", "truncated.yaml"}, 3, 0, NULL, CHAIN, 2, MLP, NONE, LG_TANH},
    {{"base1", "clang", "-O1", "reused.yaml"}, 3, 0, NULL, CHAIN, 1, MLP, NONE, LG_SWISH},
    {{"flat1", "gcc", "-O2", ""}, 2, 0, NULL, SEPARABLE, 1, MLP, NONE, LG_TANH},
    {{"flat2", "clang", "-O2", "rk4"}, 4, 0, NULL, SEPARABLE, 2, LINEAR, NONE, LG_TANH},
    {{"flat4", "gcc", "-O3", "splitting.yaml"}, 2, 0, NULL, SEPARABLE, 4, MLP, NONE, LG_SWISH},
    {{"pair2", "g++", "-O3", "dp54"}, 6, 0, NULL, SEPARABLE, 2, MLP, NONE, LG_SIGMOID},
    {{"free2", "clang", "-O3", "cf4"}, 4, 0, NULL, SEPARABLE, 2, MLP, NONE, LG_SINE},
    {{"moan2", "gcc", "-O2", "blanes-moan"}, 7, 0, NULL, SEPARABLE, 2, MLP, NONE, LG_TANH},
    {{"euler4", "gcc", "-O0", "symplectic-euler"}, 1, 0, NULL, SEPARABLE, 4, LINEAR, NONE, LG_TANH},
    {{"words2", "gcc", "-O2", ""}, 4, 0, NULL, CHAIN, 2, DICTIONARY, NONE, LG_TANH},
    {{"words3", "clang", "-O3", "dp54"}, 6, 0, NULL, SEPARABLE, 3, DICTIONARY, ODD, LG_TANH},
    {{"even2", "clang", "-O2", "cf4"}, 4, 0, NULL, CHAIN, 2, MLP, EVEN, LG_SWISH},
    {{"odd2", "g++", "-O2", "blanes-moan"}, 7, 0, NULL, SEPARABLE, 2, MLP, ODD, LG_TANH},
    {{"axial2", "gcc", "-O2", "cf4"}, 4, 16, NULL, CHAIN, 2, MLP, AXIAL, LG_TANH},
    {{"round3", "clang", "-O2", "rk4"}, 4, 0, NULL, SEPARABLE, 3, MLP, SPHERICAL, LG_SWISH},
    {.row = {"all", "gcc", "-O2", ""}, 4, 45, machine_of_all_kinds},
    {.row = {"body", "clang", "-O3", ""}, 4, 45, machine_of_a_body},
    {.row = {"cart", "g++", "-O1", ""}, 4, 45, machine_of_a_cart},
    {.row = {"rod", "gcc", "-O0", ""}, 4, 45, machine_without_inputs},
    {.row = {"top", "clang", "-O1", ""}, 4, 45, machine_of_a_top},
    {.row = {"chain", "gcc", "-O3", ""}, 4, 45, machine_of_a_chain},
    {.row = {"arm", "gcc", "-O2", ""}, 4, 45, machine_of_an_arm},
    {.row = {"motor", "clang", "-O2", ""}, 4, 45, machine_of_a_motor}};

static int begin(void **state) {
    if (export_begin(state) != 0) return -1;
    cli_write("truncated.yaml", truncated_yaml);
    cli_write("reused.yaml", reused_yaml);
    cli_write("splitting.yaml", splitting_yaml);
    return 0;
}

/* ---- models ---- */

/* A model with random parameters. */
static lg_hamiltonian_file hamiltonian_of(const example *of) {
    static const uint32_t hidden[] = {24, 16};
    lg_hamiltonian_file file = {.run = {.scheme = lg_scheme_find(of->family->scheme),
                                        .substeps = 1,
                                        .trajectories = 20,
                                        .points = 5,
                                        .dt = 0.025,
                                        .training = export_training()}};
    lg_hamiltonian *model = &file.run.model;
    const uint32_t most = of->family->most, links = most > 0 && of->links > most ? most : of->links;
    assert_ok(lg_hamiltonian_init(model, of->family, links, (lg_potential_kind)of->potential, hidden, 2,
                                  of->activation));
    assert_ok(lg_hamiltonian_set_symmetry(model, (lg_symmetry)of->symmetry));
    file.parameters = lg_hamiltonian_parameters(model);
    file.theta = TEST_ARRAY(double, file.parameters);
    lg_rng rng = test_rng(7, of->links);
    lg_hamiltonian_initialise(model, &rng, file.theta);
    return file;
}

static void save(const lg_hamiltonian_file *file, const char *name) {
    assert_told(lg_recipe_save(NULL, export_path(name), &lg_recipe_hamiltonian, file, NULL, &told));
}

static double *masses_of(const lg_hamiltonian_file *file) {
    return file->theta + lg_mlp_parameters(&file->run.model.net);
}

static void *make(const void *row) {
    const example *of = row;
    if (of->machine != NULL) {
        save_machine_model(make_machine_model(of->machine, 3), export_path(of->row.name));
        return NULL;
    }
    const lg_hamiltonian_file file = hamiltonian_of(of);
    double *gamma = masses_of(&file);
    const uint32_t k = of->links;
    for (uint32_t i = 0; i < k && strcmp(of->row.name, "stiff3") == 0; i++) {
        /* the last row of Gamma is nearly a linear combination of the others */
        gamma[(k - 1) * k + i] = 0.5 * gamma[i] - 0.7 * gamma[k + i] + 0.2 * gamma[(k - 1) * k + i];
        gamma[k * k + i] = 0;
    }
    save(&file, of->row.name);
    return NULL;
}

/* A random state that is on the manifold to the precision of the exported type. */
static void draw(void *user, lg_rng *rng, double *y) {
    const exported *e = user;
    const lg_space *space = lg_model_space(e->model);
    do { /* a matrix with determinant -1 has no rotation near it */
        for (size_t i = 0; i < space->dim; i++) y[i] = lg_rng_uniform_in(rng, -1, 1);
        lg_space_project(space, y);
    } while (isnan(lg_space_manifold_error(space, y)));
    for (size_t i = 0; i < space->dim; i++) y[i] = export_rounded(&e->lib, y[i]);
}

static void draw_input(const exported *e, lg_rng *rng, double *u) {
    for (size_t i = 0; i < lg_model_input_dim(e->model); i++)
        u[i] = export_rounded(&e->lib, lg_rng_uniform_in(rng, -1, 1));
}

/* ---- fields and steps ---- */

typedef struct motion {
    const exported *e;
    const example *of;
    const lg_space *space;
    const lg_scheme *scheme;
    lg_scheme *read; /* the scheme read from a file */
    lg_stepper *stepper;
    bool exact; /* the program's step moves lagged inputs exactly, the stepper does not */
    /* counts of numbers: state, field, input, and positions and velocities of a log */
    size_t d, a, m, nq, nv;
} motion;

RELEASES(release_scheme, lg_scheme_destroy)

static motion motion_of(const exported *e) {
    motion s = {.e = e, .of = (const example *)e->row, .space = lg_model_space(e->model)};
    const lg_machine_model_file *machine = lg_model_file_of(&e->file, &lg_recipe_machine_model);
    const char *scheme = e->row->scheme;
    if (scheme == NULL || scheme[0] == '\0') scheme = machine != NULL ? "cf4" : s.of->family->scheme;
    s.d = s.space->dim, s.a = s.space->algebra_dim, s.m = lg_model_input_dim(e->model);
    if (machine != NULL) s.nq = machine->run.machine.positions, s.nv = machine->run.machine.velocities;
    s.exact = machine != NULL && machine->run.machine.lags > 0;
    assert_true(s.d <= MOST && s.nq <= MOST);
    s.scheme = lg_scheme_find(scheme);
    if (s.scheme == NULL) {
        assert_ok(lg_scheme_read(NULL, cli_at(scheme), &s.read, NULL));
        lg_test_owns(s.read, release_scheme);
        s.scheme = s.read;
    }
    const size_t bytes = lg_model_stepper_size(e->model, s.scheme);
    assert_ok(lg_model_stepper_init(e->model, s.scheme, &s.stepper, lg_test_memory(bytes), bytes));
    assert_int_equal((size_t)export_constant(e->folder, "m", "STATE_SIZE"), s.d);
    assert_int_equal((size_t)export_constant(e->folder, "m", "INPUT_SIZE"), s.m);
    assert_int_equal((int)export_constant(e->folder, "m", "STEP_EVALUATIONS"), s.of->evaluations);
    if (machine == NULL) return s;
    assert_int_equal((size_t)export_constant(e->folder, "m", "FIELD_SIZE"), s.a);
    assert_int_equal((size_t)export_constant(e->folder, "m", "POSITIONS"), s.nq);
    assert_int_equal((size_t)export_constant(e->folder, "m", "VELOCITIES"), s.nv);
    return s;
}

/* Does `steps` steps. The first one writes to another array, the others work in place. */
static void call_steps(const motion *s, double h, size_t steps, const double *y, const double *input,
                       double *out) {
    const export_library *lib = &s->e->lib;
    void *in = export_reals(lib, y, s->d), *u = export_reals(lib, input, s->m),
         *next = export_reals(lib, y, s->d);
    EXPORT_FUNCTION(lib, "step", void, (double, const void *, const void *, void *, void *), of_double);
    EXPORT_FUNCTION(lib, "step", void, (float, const void *, const void *, void *, void *), of_float);
    export_spoil(lib);
    for (size_t i = 0; i < steps; i++) {
        if (lib->single)
            of_float((float)h, i == 0 ? in : next, u, next, lib->work);
        else
            of_double(h, i == 0 ? in : next, u, next, lib->work);
    }
    export_doubles(lib, next, out, s->d);
    free(next);
    free(u);
    free(in);
}

static void call_field(const motion *s, const double *y, const double *input, double *out) {
    export_call(&s->e->lib, "field", 3,
                (export_port[]){EXPORT_IN(y, s->d), EXPORT_IN(input, s->m), EXPORT_OUT(out, s->a)});
}

static double call_hamiltonian(const motion *s, const double *y) {
    const export_library *lib = &s->e->lib;
    void *in = export_reals(lib, y, s->d);
    EXPORT_FUNCTION(lib, "hamiltonian", double, (const void *, void *), of_double);
    EXPORT_FUNCTION(lib, "hamiltonian", float, (const void *, void *), of_float);
    export_spoil(lib);
    const double value = lib->single ? (double)of_float(in, lib->work) : of_double(in, lib->work);
    free(in);
    return value;
}

/* ---- random states ---- */

/* What is compared: field and step with and without an input, and for machines states, velocities and
 * positions. */
enum { FIELD, FREE_FIELD, STEP, FREE_STEP, STATE, VELOCITIES, POSITIONS, QUANTITIES };

typedef struct table {
    double of[QUANTITIES][2][ROWS * MOST];
    double off; /* largest manifold error of the exported steps */
} table;

static void fill_log(const motion *s, const double *y, table *t, size_t r) {
    const exported *e = s->e;
    double q[MOST], v[MOST], *positions = t->of[POSITIONS][0] + r * s->nq,
                             *velocities = t->of[VELOCITIES][0] + r * s->nv;
    assert_ok(lg_model_machine_velocities(e->model, y, velocities, e->work));
    export_call(&e->lib, "velocities", 2,
                (export_port[]){EXPORT_IN(y, s->d), EXPORT_OUT(t->of[VELOCITIES][1] + r * s->nv, s->nv)});
    assert_ok(lg_model_machine_positions(e->model, y, positions, e->work));
    export_call(&e->lib, "positions", 2,
                (export_port[]){EXPORT_IN(y, s->d), EXPORT_OUT(t->of[POSITIONS][1] + r * s->nq, s->nq)});
    for (size_t i = 0; i < s->nq; i++) q[i] = export_rounded(&e->lib, positions[i]);
    for (size_t i = 0; i < s->nv; i++) v[i] = export_rounded(&e->lib, velocities[i]);
    assert_ok(lg_model_machine_state(e->model, q, v, t->of[STATE][0] + r * s->d, e->work));
    export_call(&e->lib, "state", 3,
                (export_port[]){EXPORT_IN(q, s->nq), EXPORT_IN(v, s->nv),
                                EXPORT_OUT(t->of[STATE][1] + r * s->d, s->d)});
}

/* A step of the library. */
static void take_step(const motion *s, double h, const double *y, const double *input, double *out) {
    static const double none[MOST] = {0};
    const void *in[] = {y, input != NULL ? input : none, &h};
    void *const next[] = {out};
    lg_plan *plan;
    if (!s->exact) {
        assert_ok(lg_stepper_step(s->stepper, 0, h, y, input, out));
        return;
    }
    assert_ok(lg_model_find(s->e->model, "step", NULL, &plan, NULL));
    lg_plan_eval(plan, in, next, lg_test_memory(lg_plan_work_size(plan)));
    lg_plan_destroy(plan);
}

static void fill_row(const motion *s, double h, lg_rng *rng, table *t, size_t r) {
    const exported *e = s->e;
    double y[MOST], u[MOST];
    draw((void *)(uintptr_t)e, rng, y);
    draw_input(e, rng, u);
    for (int idle = 0; idle < 2; idle++) {
        const double *input = idle ? NULL : u;
        double *step = t->of[STEP + idle][1] + r * s->d;
        assert_ok(lg_model_field(e->model, y, input, t->of[FIELD + idle][0] + r * s->a, e->work));
        call_field(s, y, input, t->of[FIELD + idle][1] + r * s->a);
        take_step(s, h, y, input, t->of[STEP + idle][0] + r * s->d);
        call_steps(s, h, 1, y, input, step);
        t->off = fmax(t->off, lg_space_manifold_error(s->space, step));
    }
    if (s->nq > 0) fill_log(s, y, t, r);
}

static void compare_flow(const motion *s, double h, double tolerance) {
    static const char *const names[] = {"field", "free field", "step",     "free step",
                                        "state", "velocities", "positions"};
    const size_t sizes[QUANTITIES] = {s->a, s->a, s->d, s->d, s->d, s->nv, s->nq};
    const size_t mark = lg_test_owned();
    const double eps = s->e->lib.single ? (double)FLT_EPSILON : DBL_EPSILON;
    table *t = TEST_ARRAY(table, 1);
    lg_rng rng = test_rng(5, 1);
    for (size_t r = 0; r < ROWS; r++) fill_row(s, export_rounded(&s->e->lib, h), &rng, t, r);
    for (int i = 0; i < (s->nq > 0 ? QUANTITIES : STATE); i++) {
        const double error = export_worst(t->of[i][1], t->of[i][0], ROWS, sizes[i]);
        const double allowed = i == STEP || i == FREE_STEP ? tolerance : s->e->lib.tolerance;
        print_message("%s, h = %g: %s %.2e; tolerance %.2e\n", s->e->folder, h, names[i], error, allowed);
        assert_close(error, 0, 0, allowed);
    }
    assert_true(t->off <= 45 * eps);
    lg_test_give_back(mark);
}

/* ---- single states ---- */

static void check_zero_step(const motion *s, const double *y, const double *input) {
    double out[MOST], turned[MOST];
    memcpy(turned, y, s->d * sizeof *y);
    turned[1] = -0.0;
    for (int sign = -1; sign <= 1; sign += 2) {
        call_steps(s, sign * 0.0, 1, turned, input, out);
        assert_memory_equal(out, turned, s->d * sizeof *y);
    }
}

static bool has_nan(const double *x, size_t n) {
    bool found = false;
    for (size_t i = 0; i < n; i++) found = found || isnan(x[i]);
    return found;
}

/* With a NaN in the state, the field must be NaN where the library's is (the force of a linear potential does
 * not depend on q), and the next state must be all NaN. */
static void check_nan(const motion *s, const double *y) {
    const exported *e = s->e;
    double broken[MOST], out[MOST], want[MOST];
    for (size_t i = 0; i < s->d; i++) {
        memcpy(broken, y, s->d * sizeof *y);
        broken[i] = NAN;
        call_field(s, broken, NULL, out);
        assert_ok(lg_model_field(e->model, broken, NULL, want, e->work));
        for (size_t j = 0; j < s->a; j++) assert_int_equal(isnan(out[j]), isnan(want[j]));
        export_eval(&e->lib, broken, out);
        lg_model_eval(e->model, broken, want, e->work);
        assert_int_equal(isnan(out[0]), isnan(want[0]));
        call_steps(s, 0.025, 1, broken, NULL, out);
        assert_true(has_nan(out, s->d));
    }
    call_steps(s, (double)NAN, 1, y, NULL, out);
    assert_true(has_nan(out, s->d));
}

/* A step in place and a step into another array must have the same bits, also if the value is computed
 * too. */
static void check_in_place(const motion *s, const double *y, const double *input) {
    double once[MOST], twice[MOST], again[MOST], value;
    call_steps(s, 0.025, 1, y, input, once);
    call_steps(s, 0.025, 1, once, input, twice);
    call_steps(s, 0.025, 2, y, input, again);
    assert_memory_equal(twice, again, s->d * sizeof *y);
    export_eval(&s->e->lib, y, &value);
    const double named = call_hamiltonian(s, y);
    assert_memory_equal(&value, &named, sizeof value);
}

static void check_single_states(const motion *s) {
    double y[MOST], input[MOST];
    lg_rng rng = test_rng(6, 1);
    draw_input(s->e, &rng, input);
    for (int r = 0; r < 5; r++) {
        draw((void *)(uintptr_t)s->e, &rng, y);
        check_zero_step(s, y, input);
        check_in_place(s, y, input);
        if (r == 0) check_nan(s, y);
    }
}

/* Machines are damped and come to rest, so a fifth of the steps is enough for them. */
static void check_long_run(const motion *s) {
    double y[MOST], input[MOST] = {0}, worst = 0;
    lg_rng rng = test_rng(8, 1);
    draw((void *)(uintptr_t)s->e, &rng, y);
    for (int i = 0; i < (s->nq > 0 ? 20 : 100); i++) {
        call_steps(s, s->nq > 0 ? 0.01 : 0.025, 1000, y, input, y);
        worst = fmax(worst, lg_space_manifold_error(s->space, y));
        assert_false(has_nan(y, s->d));
    }
    print_message("%s: off the manifold by at most %.1e in a long run\n", s->e->folder, worst);
    assert_true(worst <= (s->e->lib.single ? s->of->off * (double)FLT_EPSILON : 1e-14));
}

static void more(exported *e) {
    const motion s = motion_of(e);
    compare_flow(&s, 0.025, e->lib.tolerance);
    compare_flow(&s, -0.1, e->lib.tolerance * s.of->evaluations);
    check_single_states(&s);
    if (s.of->off > 0) check_long_run(&s);
}

static const export_kind motions = EXPORT_KIND(examples, make, draw, NULL, more);

TEST_GROUP(begin, export_end)

#ifdef EVERY_WAY
TEST("every model is built by all compilers") {
    export_build_all(&motions);
    export_build(&motions, export_find(&motions, "chain2"), "f64", export_check_all_ways);
}
#else

TEST("every model agrees with the library in double precision") {
    export_compare_all(&motions, "f64");
}

TEST("every model agrees with the library in single precision") {
    export_compare_all(&motions, "f32");
}

/* Includes the families that are not among the examples. */
TEST("the self-test of every family passes") {
    for (size_t i = 0; i < lg_hamiltonian_family_count(); i++) {
        const lg_hamiltonian_family *family = lg_hamiltonian_family_at(i);
        const example of = {
            .row = {.name = family->name}, .family = family, .links = 2, .activation = LG_TANH};
        export_expect(test_text("make -C %s test CFLAGS=-O1", export_made(&motions, &of, "f64", "")->folder));
    }
}

/* A nearly singular mass matrix amplifies rounding errors. The stated tolerance accounts for it, and must not
 * be far above the errors that occur. */
TEST("for nearly singular masses the tolerance accounts for the condition number") {
    static const example of = {{"stiff3", "gcc", "-O2", ""}, 4, 0, NULL, CHAIN, 3, MLP, NONE, LG_TANH};
    for (int single = 0; single < 2; single++) {
        exported *e = export_opened(&motions, &of, single ? "f32" : "f64", "");
        const motion s = motion_of(e);
        const double plain = 20 * 4 * (single ? (double)FLT_EPSILON : DBL_EPSILON);
        assert_true(e->lib.tolerance > 5 * plain && e->lib.tolerance < 1e4 * plain);
        export_compare(&e->lib, e->folder, ROWS, draw, export_jacobian, e);
        compare_flow(&s, 1e-6, e->lib.tolerance);
    }
}

/* ---- large steps ---- */

/* Compares a step of Lie-Euler whose length turns the first link by `angle`. */
static double turn_first(const motion *s, double angle, lg_rng *rng) {
    double y[MOST], field[MOST], want[MOST], got[MOST];
    draw((void *)(uintptr_t)s->e, rng, y);
    assert_ok(lg_model_field(s->e->model, y, NULL, field, s->e->work));
    const double h = export_rounded(&s->e->lib, angle / sqrt(lg_dot3(field, field)));
    assert_ok(lg_stepper_step(s->stepper, 0, h, y, NULL, want));
    assert_close(lg_stepper_angle(s->stepper) >= angle * 0.999, 1, 0, 0);
    call_steps(s, h, 1, y, NULL, got);
    assert_true(lg_space_manifold_error(s->space, got) <=
                (s->e->lib.single ? 64 * (double)FLT_EPSILON : 1e-13));
    return export_norm(got, want, s->d) / export_norm(want, NULL, s->d) / (1 + lg_stepper_angle(s->stepper));
}

TEST("steps that turn a link by half a turn, a turn and more agree with the library") {
    static const double angles[] = {3.1, 3.141592653589793, 3.2, 6.2, 6.283185307179586, 6.3, 20};
    for (int single = 0; single < 2; single++) {
        double worst = 0;
        lg_rng rng = test_rng(11, 1);
        const exported *e =
            export_opened(&motions, export_find(&motions, "chain5"), single ? "f32" : "f64", "");
        const motion s = motion_of(e);
        for (size_t i = 0; i < LG_COUNT(angles); i++)
            for (int r = 0; r < 20; r++) {
                const double error = turn_first(&s, angles[i], &rng);
                worst = error <= worst ? worst : error;
            }
        print_message("%s: steps of up to a few turns to %.2e (1 + |u|)\n", e->folder, worst);
        assert_close(worst, 0, 0, e->lib.tolerance);
    }
}

/* ---- the maps of SE(3) ---- */

/* The maps are static functions: this compiles a copy of the code with two more functions that call them. */
static exported *open_geometry(const char *dtype) {
    static const example of = {{"geometry", "gcc", "-O2", "rkmk4"}, 4, 0, NULL, CHAIN, 1, MLP, NONE, LG_TANH};
    char command[1024];
    exported *e = export_made(&motions, &of, dtype, "");
    (void)snprintf(command, sizeof command,
                   "cd %s && printf '%%s\\n' 'void m_act(const real *, const real *, real *);' "
                   "'void m_dexpinv(const real *, real *);' "
                   "'void m_act(const real *a, const real *y, real *out) { real q[3], p[3]; "
                   "so3_exp(1, 1, a, y, q); se3_act(1, a, a + 3, y, y + 3, p); "
                   "for (int i = 0; i < 3; i++) { out[i] = q[i]; out[3 + i] = p[i]; } }' "
                   "'void m_dexpinv(const real *a, real *b) { real B[3], v[3]; so3_dexpinv(1, a, b, B); "
                   "se3_dexpinv(1, a, a + 3, b, b + 3, v); "
                   "for (int i = 0; i < 3; i++) { b[i] = B[i]; b[3 + i] = v[i]; } }' >> m.c",
                   e->folder);
    export_expect(command);
    export_compile(e, of.row.compiler, of.row.flags);
    return e;
}

/* Errors of both maps at |u| = angle, in units of eps (1 + |u| and the condition number near the pole of
 * dexpinv). */
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

TEST("the maps of SE(3) are accurate at every angle") {
    static const char angles[] = "0 1e-300 1e-20 1e-9 1e-5 1e-3 0.01 0.1 0.5 1 1.999999 2 2.000001 3 3.14159 "
                                 "3.141592653589793 3.15 4 5 6 6.28 6.283185307179586 6.29 7 9.42 12 30 100";
    for (int single = 0; single < 2; single++) {
        const exported *e = open_geometry(single ? "f32" : "f64");
        lg_rng rng = test_rng(9, 1);
        double worst[2] = {0, 0};
        for (const char *at = angles; at != NULL; at = strchr(at + 1, ' '))
            for (int r = 0; r < 100; r++) check_maps(&e->lib, strtod(at, NULL), &rng, worst);
        print_message("%s: exp acts to %.1f eps (1 + |u|), dexpinv to %.1f eps condition\n", e->folder,
                      worst[0], worst[1]);
        assert_true(worst[0] <= 10);
        assert_true(worst[1] <= 20);
    }
}

/* ---- linearisation ---- */

/* Compares A (TANGENT, TANGENT) and B (TANGENT, INPUT_SIZE), together and with only one of them requested. */
static void compare_linearisation(const exported *e) {
    enum { POINTS = 100 };
    const size_t d = lg_model_inputs(e->model), r = lg_model_tangent_dim(e->model),
                 m = lg_model_input_dim(e->model), size = r * (r + m);
    double *want = TEST_ARRAY(double, POINTS *size), *got = TEST_ARRAY(double, POINTS *size), y[MOST],
           u[MOST];
    lg_rng rng = test_rng(9, 1);
    assert_int_equal((size_t)export_constant(e->folder, "m", "TANGENT"), r);
    for (size_t i = 0; i < POINTS; i++) {
        const double *input = i % 2 == 0 ? u : NULL;
        double *A = want + i * size, *mine = got + i * size;
        draw((void *)(uintptr_t)e, &rng, y);
        draw_input(e, &rng, u);
        assert_ok(lg_model_linearise(e->model, y, input, A, A + r * r, NULL, e->work));
        for (int part = 0; part < 2; part++)
            export_call(&e->lib, "linearise", 4,
                        (export_port[]){EXPORT_IN(y, d), EXPORT_IN(input, m),
                                        EXPORT_OUT(part == 0 ? mine : NULL, r * r),
                                        EXPORT_OUT(part == 1 ? mine + r * r : NULL, r * m)});
    }
    const double error = export_worst(got, want, POINTS, size);
    print_message("%s: linearisation %.2e; tolerance %.2e\n", e->folder, error, e->lib.tolerance);
    assert_close(error, 0, 0, e->lib.tolerance);
}

/* The code for all kinds of coordinates is long, so with its linearisation it is compiled by all compilers
 * only once. */
TEST("--functions linearise exports the library's linearisation") {
    for (size_t i = 0; i < LG_COUNT(examples); i++)
        for (int single = 0; single < 2 && examples[i].machine != NULL; single++) {
            const size_t mark = lg_test_owned();
            const bool all = !single && examples[i].machine == machine_of_all_kinds;
            const exported *e =
                export_opened(&motions, &examples[i], single ? "f32" : "f64", "--functions linearise");
            compare_linearisation(e);
            if (all) export_check_ways(e->folder, "m");
            if (all) export_check_objects(e->folder, "m");
            if (all || (single && examples[i].machine == machine_of_a_cart)) export_check_stack(e->folder);
            lg_test_give_back(mark);
        }
}

/* ---- objects, headers, refusals ---- */

/* test_export_motion_ways has more compilers and models. */
TEST("self-tests pass with every compiler, objects need only libm, and the stack is as stated") {
    static const char *const some[] = {"chain2", "flat2", "body"};
    for (size_t i = 0; i < LG_COUNT(some); i++) {
        const exported *e = export_made(&motions, export_find(&motions, some[i]), i < 2 ? "f64" : "f32", "");
        if (i == 2) export_check_ways(e->folder, "m");
        export_check_objects(e->folder, "m");
        export_check_stack(e->folder);
    }
}

TEST("the header describes state and inputs, and gives the range of the data") {
    const exported *e = export_made(&motions, export_find(&motions, "all"), "f64", "");
    export_expect_words(test_text("%s/m.h", e->folder),
                        "x theta hull.x hull.y hull.z rod.q (3) rod.p (3) body.R (9, rows) hull.R|"
                        "u1 u2 as in the log|theta -1 to 2|cf4, order 4: 4 evaluations|"
                        "windows 20, dt 0.02|window 5,");
}

static void expect_header(const char *model, const char *words) {
    export_run(test_text("%s.h5 --out %s --name m", model, model));
    export_expect_words(test_text("%s/m.h", model), words);
}

/* The errors as `evaluate --record` writes them, with their test set. */
TEST("the header states the recorded errors") {
    const example *of = export_find(&motions, "flat1");
    lg_hamiltonian_file file = hamiltonian_of(of), judged = file;
    save(&file, "flat1");
    expect_header("flat1", "!E1  |!E2  |!test_sha256");
    judged.has_e1 = judged.has_e2 = true;
    judged.e1 = 1.23456e-7, judged.e2 = 3.45678e-4;
    judged.test = (lg_test_set){.trajectories = 100, .points = 15, .t_end = 1.5};
    (void)snprintf(judged.test.sha256, sizeof judged.test.sha256, "%064d", 7);
    assert_ok(lg_hamiltonian_save_errors(NULL, export_path("flat1"), &judged, NULL));
    expect_header("flat1", "E1            1.23456e-07: mean squared error|E2            0.000345678: mean |"
                           "test_trajectories  100\n|test_points   15\n|test_t_end    1.5\n|"
                           "test_sha256   0000000000000000000000000000000000000000000000000000000000000007\n|"
                           "!THE TRAINING DATA");
    judged.has_e2 = false;
    judged.test = (lg_test_set){.trajectories = 0};
    assert_ok(lg_hamiltonian_save_errors(NULL, export_path("flat1"), &judged, NULL));
    expect_header("flat1", "E1            1.23456e-07|!E2  |!test_trajectories|!test_sha256");
    file.has_e1 = true;
    file.test = (lg_test_set){.trajectories = 2, .points = 15, .t_end = 1.5};
    (void)snprintf(file.test.sha256, sizeof file.test.sha256, "%064d", 8);
    memcpy(file.run.data_sha256, file.test.sha256, sizeof file.run.data_sha256);
    save(&file, "own");
    expect_header("own", "0008: THE TRAINING DATA");
}

/* A singular mass matrix, and one whose inverse a float cannot hold. */
TEST("masses without an inverse are refused") {
    const lg_hamiltonian_file file = hamiltonian_of(export_find(&motions, "chain2"));
    double *masses = masses_of(&file);
    for (int i = 0; i < 6; i++) masses[i] = i == 0 ? 1 : 0;
    save(&file, "singular");
    cli_expect("lg-export", "singular.h5 --out no", 3, "not positive definite");
    for (int i = 0; i < 6; i++) masses[i] = i >= 4 ? 1e-44 : 0;
    save(&file, "light");
    cli_expect("lg-export", "light.h5 --out no --dtype f32", 3, "inverse");
    assert_false(cli_exists("no"));
}

/* test_refused has the schemes that are refused. */
TEST("schemes that stay on the manifold are accepted") {
    static const struct {
        const char *model, *scheme;
        int evaluations;
    } rows[] = {{"cart", "rk4", 4},
                {"body", "lie-euler", 1},
                {"top", "variational", 0},
                {"chain2", "variational", 0}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        example of = *(const example *)export_find(&motions, rows[i].model);
        of.row.scheme = rows[i].scheme;
        const exported *e = export_made(&motions, &of, "f64", "");
        assert_int_equal((int)export_constant(e->folder, "m", "STEP_EVALUATIONS"), rows[i].evaluations);
        export_expect(test_text("make -C %s test CFLAGS=-O1", e->folder));
    }
}
#endif
