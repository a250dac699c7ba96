/* The loss of all samples, minimised to rounding: for models with few parameters. */
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "core/clean.h"
#include "liegrad/minimise.h"
#include "nn/fit_internal.h"

typedef struct whole {
    const lg_fit_problem *problem;
    lg_tape *tape;
    const uint32_t *samples;
} whole;

static lg_status objective(void *user, const double *x, double *value, double *gradient) {
    const whole *w = user;
    const lg_fit_problem *p = w->problem;
    void *to = gradient;
    lg_var theta, loss;
    lg_tape_reset(w->tape);
    LG_TRY(lg_fit_record(p, w->tape, x, false, w->samples, p->samples, p->samples, &theta, &loss));
    LG_TRY(lg_read(w->tape, loss, 1, value));
    return lg_backward_set(w->tape, loss, &theta, 1, &to);
}

lg_status lg_fit_newton(const lg_context *context, const lg_fit_problem *problem, double *theta,
                        lg_fit_newton_result *result) {
    if (problem == NULL || (problem->loss == NULL && problem->residuals == NULL) || theta == NULL)
        return LG_INVALID_ARGUMENT;
    const size_t n = problem->parameters, samples = problem->samples;
    if (n == 0 || n > LG_NEWTON_MAX_PARAMETERS || samples == 0 || samples > UINT32_MAX)
        return LG_INVALID_ARGUMENT;
    LG_TRY_SCRATCH(uint32_t, all, context, samples, LG_OUT_OF_MEMORY);
    LG_TRY_SCRATCH(double, x, context, n, LG_OUT_OF_MEMORY);
    LG_CLEAN(lg_tape_destroy_at) lg_tape *tape = NULL;
    LG_TRY(lg_tape_create(context, NULL, &tape));
    for (size_t i = 0; i < samples; i++) all[i] = (uint32_t)i;
    memcpy(x, theta, n * sizeof *x);
    lg_minimise_result found;
    const lg_status status =
        lg_minimise(context, n, objective, &(whole){problem, tape, all}, NULL, x, &found, NULL);
    if (status != LG_OK && status != LG_NO_CONVERGENCE) return status;
    memcpy(theta, x, n * sizeof *x);
    if (result != NULL) *result = (lg_fit_newton_result){found.iterations, found.value, found.gradient};
    return LG_OK;
}
