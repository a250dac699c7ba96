/* The functions of the models of every recipe, evaluated in all ways: on a tape, as plans for many rows and
 * in both types, and compared with steps of the plain stepper. */
#include "support/malloc_count.h"
#include "autodiff/plan_ways.h"
#include "model/files/training.h"
#include "model/model_kinds.h"

RELEASES(release_model, lg_model_destroy)

typedef struct recorded {
    any_file file;
    lg_program *program;
} recorded;

static void release_recorded(void *of) {
    recorded *r = of;
    lg_program_destroy(r->program);
    destroy(&r->file);
}

static recorded *record(size_t kind, size_t which) {
    recorded *r = TEST_ARRAY(recorded, 1);
    kinds[kind].make(which, &r->file);
    assert_told(kinds[kind].recipe->program(NULL, r->file.bytes, NULL, &r->program, &told));
    lg_test_owns(r, release_recorded);
    return r;
}

TEST("every function of every recipe agrees with the tape as a plan of any rows, in both types") {
    for
        EACH_EXAMPLE(kind, which) {
            const size_t mark = lg_test_owned();
            check_all(test_text("%s %zu", kinds[kind].recipe->name, which), record(kind, which)->program);
            lg_test_give_back(mark);
        }
}

/* ---- results ---- */

static lg_status judge_ten(lg_training *self, double *theta, lg_error *error) {
    (void)theta, (void)error;
    for (int i = 0; i < 10; i++) LG_TELL(self, LG_REAL(i == 9 ? "last" : "other", i, NULL));
    return LG_OK;
}

TEST("a judgement is not made if there is no memory for its results") {
    static const lg_trainer trainer = {.judge = judge_ten};
    static const lg_recipe recipe = {.trainer = &trainer};
    EVERY_ALLOCATION_FAILS(context, 1, {
        lg_training training = {.context = context, .recipe = &recipe};
        lg_error error = {LG_OK, ""};
        status = lg_training_judge(&training, NULL, &error);
        if (status == LG_OK) assert_true(lg_result_find(&training, "last")->real == 9.0);
        lg_training_clear(&training);
    });
}

/* ---- Jacobians ---- */

static void value_at(const void *plan, const double *x, double *y) {
    const size_t mark = lg_test_owned();
    lg_plan_eval(plan, (const void *const[]){x}, (void *const[]){y}, test_work(lg_plan_work_size(plan)));
    lg_test_give_back(mark);
}

/* Compares the function `grad` with differences of `value`, with so small a step that it crosses no kink. */
static void check_gradient(const recorded *r) {
    size_t value, grad;
    assert_ok(lg_program_find(r->program, "value", &value, NULL));
    assert_ok(lg_program_find(r->program, "grad", &grad, NULL));
    const lg_plan *of_value = test_plan(r->program, value, NULL), *both = test_plan(r->program, grad, NULL);
    const size_t n = lg_plan_input_count(of_value, 0), m = lg_plan_output_count(of_value, 0);
    double *x = test_numbers(31, n, -1, 1), *y = TEST_ARRAY(double, m), *slope = TEST_ARRAY(double, m),
           *jacobian = TEST_ARRAY(double, m *n), largest = 0.0;
    assert_int_equal(lg_plan_output_count(both, 1), m * n);
    lg_plan_eval(both, (const void *const[]){x}, (void *const[]){y, jacobian},
                 test_work(lg_plan_work_size(both)));
    for (size_t i = 0; i < m * n; i++) largest = fmax(largest, fabs(jacobian[i]));
    assert_true(largest > 1e-6);
    for (size_t i = 0; i < n; i++) {
        test_slope(value_at, of_value, x, i, 1e-6, 1, m, slope);
        for (size_t o = 0; o < m; o++) assert_close(jacobian[o * n + i], slope[o], 1e-6, 1e-7 * largest);
    }
}

TEST("the gradient of every recipe agrees with differences of its value") {
    for
        EACH_EXAMPLE(kind, which) check_gradient(record(kind, which));
}

/* ---- steps ---- */

/* A random state on the manifold; a matrix with determinant -1 has no rotation near it. */
static double *state_on(const lg_space *space, uint64_t seed) {
    double *y;
    do {
        y = test_numbers(seed, space->dim, 0.2, 1.2);
        lg_space_project(space, y);
        seed += 100;
    } while (isnan(lg_space_manifold_error(space, y)));
    return y;
}

static lg_model *model_on(const recorded *r, const lg_scheme *scheme, const lg_space *space) {
    lg_program *program;
    lg_model *model;
    assert_ok(kinds[r->file.kind].recipe->program(NULL, r->file.bytes, scheme, &program, NULL));
    assert_int_equal(lg_model_create(NULL, program, space, &model, NULL), LG_OK); /* called once */
    lg_test_owns(model, release_model);
    return model;
}

/* Whether inputs of the model have lags: the program moves them exactly, the stepper by its scheme. */
static bool has_lags(const recorded *r) {
    const bool machine = kinds[r->file.kind].recipe == &lg_recipe_machine_model;
    return machine && ((const lg_machine_model_file *)r->file.bytes)->run.machine.lags > 0;
}

/* Compares the function `step` of the program with the stepper, which uses the field. */
static void check_step(recorded *r) {
    const double tolerance = has_lags(r) ? 1e-6 : 2e-13;
    size_t step;
    lg_space space;
    lg_stepper *stepper;
    const lg_recipe *recipe = kinds[r->file.kind].recipe;
    const lg_scheme *scheme = recipe->scheme(r->file.bytes);
    assert_ok(recipe->space(common_of(&r->file).run, &space));
    const lg_model *model = model_on(r, scheme, &space);
    const size_t bytes = lg_model_stepper_size(model, scheme), inputs = lg_model_input_dim(model);
    assert_ok(lg_model_stepper_init(model, scheme, &stepper, test_work(bytes), bytes));
    assert_ok(lg_program_find(r->program, "step", &step, NULL));
    const lg_plan *plan = test_plan(r->program, step, NULL);
    for (uint64_t seed = 0; seed < 3; seed++) {
        const double *y = state_on(&space, seed), *u = test_numbers(7 + seed, inputs + 1, -1, 1),
                     h = 0.01 * (double)(1 + seed);
        double *next = TEST_ARRAY(double, space.dim), *expected = TEST_ARRAY(double, space.dim);
        const void *const in[] = {y, inputs > 0 ? (const void *)u : &h, &h};
        lg_plan_eval(plan, in, (void *const[]){next}, test_work(lg_plan_work_size(plan)));
        assert_ok(lg_stepper_step(stepper, 0.0, h, y, inputs > 0 ? u : NULL, expected));
        assert_all_close(next, expected, space.dim, tolerance, tolerance);
    }
}

TEST("the step of every recipe with motion agrees with the plain stepper, with its inputs") {
    for
        EACH_EXAMPLE(kind, which) if (kinds[kind].recipe->space != NULL) check_step(record(kind, which));
}
