/* Decisions of a classifier and their Jacobian by the window, from its program and its features. */
#ifndef LG_TEST_DECISIONS_H
#define LG_TEST_DECISIONS_H

#include "support/fixtures.h"

#include "liegrad/classify.h"

/* Zeroed before the first call. Its memory belongs to the running test. */
typedef struct test_decider {
    lg_plan *value, *scores, *pull_back; /* a tree has no pull_back */
    double *features, *work, *by_features, *seed;
    void *memory;
} test_decider;

static inline void test_free_decider(void *of) {
    lg_plan *const *plan = of;
    for (int i = 0; i < 3; i++) lg_plan_destroy(plan[i]);
}

static inline void test_make_decider(const lg_classifier *c, test_decider *d) {
    static const char *const names[] = {"value", "scores", "adj1_value"};
    lg_program *program = NULL;
    lg_derivative what;
    size_t at, most = 0;
    const bool tree = c->method == LG_METHOD_TREE;
    lg_error error;
    if (lg_classifier_program(NULL, c, &program, &error) != LG_OK) fail_msg("%s", error.message);
    lg_derivative_init(&what);
    what.kind = LG_DERIVATIVE_ADJOINT;
    what.function = "value";
    if (!tree) assert_ok(lg_program_derive(program, &what, NULL));
    lg_plan **plan = TEST_ARRAY(lg_plan *, 3);
    lg_test_owns(plan, test_free_decider);
    for (int i = 0; i < 3 - tree; i++) {
        assert_ok(lg_program_find(program, names[i], &at, NULL));
        assert_ok(lg_plan_create(program, at, NULL, &plan[i], NULL));
        if (lg_plan_work_size(plan[i]) > most) most = lg_plan_work_size(plan[i]);
    }
    lg_program_destroy(program);
    d->value = plan[0], d->scores = plan[1], d->pull_back = plan[2];
    d->memory = lg_test_memory(most);
    d->features = TEST_ARRAY(double, c->pca.inputs);
    d->by_features = TEST_ARRAY(double, c->pca.inputs);
    d->seed = TEST_ARRAY(double, lg_plan_output_count(plan[0], 0));
    d->work = TEST_ARRAY(double, lg_features_work_size(&c->features) / sizeof(double) + 1);
}

/* y (outputs) and jacobian (outputs, inputs; may be NULL) at the window x. Both stay as they are if its
 * features cannot be computed. */
static inline lg_status test_decide(const lg_classifier *c, test_decider *d, const float *x, double *y,
                                    double *jacobian) {
    const size_t inputs = (size_t)c->features.channels * c->features.length;
    if (d->value == NULL) test_make_decider(c, d);
    const size_t outputs = lg_plan_output_count(d->value, 0);
    const lg_status status = lg_features_compute(&c->features, x, d->features, d->work);
    if (status != LG_OK) return status;
    lg_plan_eval(d->value, (const void *const[]){d->features}, (void *const[]){y}, d->memory);
    if (jacobian != NULL) memset(jacobian, 0, outputs * inputs * sizeof *jacobian);
    for (size_t o = 0; o < outputs && jacobian != NULL && d->pull_back != NULL; o++) {
        for (size_t k = 0; k < outputs; k++) d->seed[k] = k == o;
        lg_plan_eval(d->pull_back, (const void *const[]){d->features, d->seed},
                     (void *const[]){d->by_features}, d->memory);
        lg_features_reverse(&c->features, d->by_features, jacobian + o * inputs, d->work);
    }
    return LG_OK;
}

#endif
