/* Newton's method with damping on the full batch, for models with few parameters. The Hessian comes from
 * forward over reverse mode. */
#include <math.h>
#include <string.h>

#include "kernels/lapack.h"
#include "liegrad/fit.h"
#include "nn/minimise_internal.h"

enum { MAX_ITERATIONS = 200 };
static const double GRADIENT_TOLERANCE = 1e-15;

typedef struct newton {
    const lg_context *context;
    const lg_fit_problem *problem;
    size_t n;
    lg_tape *tape;
    uint32_t *samples;
    double *theta, *trial, *gradient, *hessian, *system, *step;
} newton;

static void destroy(newton *w) {
    lg_tape_destroy(w->tape);
    LG_FREE_ALL(w->context, w->samples, w->theta);
}

static lg_status create(newton *w) {
    const size_t n = w->n;
    w->samples = lg_alloc(w->context, w->problem->samples, sizeof *w->samples);
    w->theta = lg_alloc(w->context, 4 * n + 2 * n * n, sizeof *w->theta);
    if (w->samples == NULL || w->theta == NULL) return LG_OUT_OF_MEMORY;
    w->trial = w->theta + n;
    w->gradient = w->trial + n;
    w->step = w->gradient + n;
    w->hessian = w->step + n;
    w->system = w->hessian + n * n;
    for (size_t i = 0; i < w->problem->samples; i++) w->samples[i] = (uint32_t)i;
    return lg_tape_create(w->context, NULL, &w->tape);
}

/* Records the loss of all samples with the parameters `at`; *value is its value. */
static lg_status record_loss(newton *w, const double *at, lg_var *theta, lg_var *loss, double *value) {
    lg_tape_reset(w->tape);
    *theta = lg_parameter(w->tape, lg_shape1((uint32_t)w->n), at);
    LG_TRY(w->problem->loss(w->problem->user, w->tape, *theta, w->samples, w->problem->samples,
                            w->problem->samples, loss));
    return lg_read(w->tape, *loss, 1, value);
}

static lg_status derivatives(newton *w, double *value) {
    lg_var theta, loss, gradient;
    LG_TRY(record_loss(w, w->theta, &theta, &loss, value));
    LG_TRY(lg_grad(w->tape, loss, &theta, 1, &gradient));
    LG_TRY(lg_read(w->tape, gradient, w->n, w->gradient));
    const lg_mark mark = lg_tape_mark(w->tape);
    for (size_t j = 0; j < w->n; j++) {
        void *unit;
        lg_var direction = lg_input_buffer(w->tape, lg_shape1((uint32_t)w->n), &unit), column;
        if (lg_is_none(direction)) return lg_tape_status(w->tape);
        for (size_t i = 0; i < w->n; i++) ((double *)unit)[i] = i == j ? 1.0 : 0.0;
        LG_TRY(lg_jvp(w->tape, &gradient, 1, &theta, &direction, 1, &column));
        LG_TRY(lg_read(w->tape, column, w->n, w->hessian + j * w->n));
        LG_TRY(lg_tape_rewind(w->tape, mark));
    }
    return LG_OK;
}

/* Solves (H + damping I) step = -gradient. Returns false if the matrix is not positive definite. */
static bool solve_step(newton *w, double damping) {
    const int n = (int)w->n, one = 1;
    int info = 0;
    memcpy(w->system, w->hessian, w->n * w->n * sizeof *w->system);
    for (size_t i = 0; i < w->n; i++) {
        w->system[i * w->n + i] += damping;
        w->step[i] = -w->gradient[i];
    }
    dposv_("L", &n, &one, w->system, &n, w->step, &n, &info);
    return info == 0;
}

/* Raises the damping until a step lowers the loss, and takes this step. *moved is false if no step does. */
static lg_status descend(newton *w, double value, double scale, double *damping, bool *moved) {
    *moved = false;
    for (int attempt = 0; attempt < 60 && !*moved; attempt++) {
        double next;
        lg_var theta, loss;
        if (solve_step(w, *damping * scale)) {
            for (size_t i = 0; i < w->n; i++) w->trial[i] = w->theta[i] + w->step[i];
            LG_TRY(record_loss(w, w->trial, &theta, &loss, &next));
            *moved = next < value;
        }
        *damping = *moved ? *damping * 0.1 : *damping * 10.0;
    }
    if (*moved) memcpy(w->theta, w->trial, w->n * sizeof *w->theta);
    return LG_OK;
}

static lg_status iterate(newton *w, lg_fit_newton_result *result) {
    double damping = 1e-3;
    for (result->iterations = 0; result->iterations < MAX_ITERATIONS; result->iterations++) {
        if (lg_cancelled(w->context)) return LG_CANCELLED;
        LG_TRY(derivatives(w, &result->loss));
        result->gradient_norm = lg_largest(w->gradient, w->n);
        const double scale = lg_largest(w->hessian, w->n * w->n);
        if (!isfinite(result->loss) || !isfinite(result->gradient_norm) || !isfinite(scale))
            return LG_NOT_FINITE;
        if (result->gradient_norm <= GRADIENT_TOLERANCE * scale) break;
        bool moved;
        LG_TRY(descend(w, result->loss, scale, &damping, &moved));
        if (!moved) break;
    }
    return LG_OK;
}

lg_status lg_fit_newton(const lg_context *context, const lg_fit_problem *problem, double *theta,
                        lg_fit_newton_result *result) {
    if (problem == NULL || problem->loss == NULL || theta == NULL) return LG_INVALID_ARGUMENT;
    if (problem->parameters == 0 || problem->parameters > LG_NEWTON_MAX_PARAMETERS || problem->samples == 0 ||
        problem->samples > UINT32_MAX)
        return LG_INVALID_ARGUMENT;
    newton w = {.context = context, .problem = problem, .n = problem->parameters};
    lg_fit_newton_result found = {0};
    lg_status status = create(&w);
    if (status == LG_OK) {
        memcpy(w.theta, theta, w.n * sizeof *theta);
        status = iterate(&w, &found);
    }
    if (status == LG_OK) {
        memcpy(theta, w.theta, w.n * sizeof *theta);
        if (result != NULL) *result = found;
    }
    destroy(&w);
    return status;
}
