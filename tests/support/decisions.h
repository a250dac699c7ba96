/* Decisions of a classifier and their Jacobian by the window, from its program. */
#ifndef LG_TEST_DECISIONS_H
#define LG_TEST_DECISIONS_H

#include "support/fixtures.h"

#include "liegrad/classify.h"

/* Zeroed before the first call. Its memory belongs to the running test. */
typedef struct test_decider {
    lg_plan *value, *scores, *grad;
    double *features, *work, *window, *y;
    void *memory;
} test_decider;

static inline void test_free_decider(void *of) {
    lg_plan *const *plan = of;
    for (int i = 0; i < 3; i++) lg_plan_destroy(plan[i]);
}

static inline void test_make_decider(const lg_classifier *c, test_decider *d) {
    static const char *const names[] = {"value", "score", "grad"};
    lg_program *program = NULL;
    size_t at, most = 0;
    lg_error error;
    if (lg_classifier_program(NULL, c, &program, &error) != LG_OK) fail_msg("%s", error.message);
    lg_plan **plan = TEST_ARRAY(lg_plan *, 3);
    lg_test_owns(plan, test_free_decider);
    for (int i = 0; i < 3; i++) {
        assert_ok(lg_program_find(program, names[i], &at, NULL));
        assert_ok(lg_plan_create(program, at, NULL, &plan[i], NULL));
        if (lg_plan_work_size(plan[i]) > most) most = lg_plan_work_size(plan[i]);
    }
    lg_program_destroy(program);
    d->value = plan[0], d->scores = plan[1], d->grad = plan[2];
    d->memory = lg_test_memory(most);
    d->features = TEST_ARRAY(double, c->pca.inputs);
    d->window = TEST_ARRAY(double, (size_t)c->features.channels * c->features.length);
    d->y = TEST_ARRAY(double, lg_plan_output_count(plan[0], 0));
    d->work = TEST_ARRAY(double, lg_features_work_size(&c->features) / sizeof(double) + 1);
}

/* y (outputs) and jacobian (outputs, inputs; may be NULL) at the window x. Both stay as they are if its
 * features cannot be computed. */
static inline lg_status test_decide(const lg_classifier *c, test_decider *d, const float *x, double *y,
                                    double *jacobian) {
    const size_t inputs = (size_t)c->features.channels * c->features.length;
    if (d->value == NULL) test_make_decider(c, d);
    const lg_status status = lg_features_compute(&c->features, x, d->features, d->work);
    if (status != LG_OK) return status;
    for (size_t i = 0; i < inputs; i++) d->window[i] = (double)x[i];
    lg_plan_eval(d->value, (const void *const[]){d->window}, (void *const[]){y}, d->memory);
    if (jacobian != NULL)
        lg_plan_eval(d->grad, (const void *const[]){d->window}, (void *const[]){d->y, jacobian}, d->memory);
    return LG_OK;
}

#endif
