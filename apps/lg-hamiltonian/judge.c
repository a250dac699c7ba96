/* Measures the errors of a learned Hamiltonian. */
#include "common/verbs.h"
#include "hamiltonian/learned.h"
#include "lg-hamiltonian/training.h"

#include <math.h>

static const double RELATIVE_LEAST = 1e-8; /* added to each relative error */

double default_tolerance(const lg_hamiltonian *model) {
    return model->potential == LG_POTENTIAL_LINEAR ? 1e-13 : 1e-10;
}

/* Limit of the number of steps: a constant, and a number per point. A good model needs about ten steps from
 * point to point. */
enum { MOST_STEPS = 20000, MOST_STEPS_A_POINT = 2000 };

lg_status land(const lg_hamiltonian *model, size_t count, double *y, lg_error *error) {
    const size_t d = lg_hamiltonian_state_dim(model);
    lg_status status = LG_OK;
    for (size_t i = 0; model->constraint != NULL && status == LG_OK && i < count; i++)
        status = lg_constraint_project(model->constraint, 0, y + i * d, error);
    return status;
}

typedef struct judgement {
    const lg_context *context;
    const lg_hamiltonian *model;
    const lg_model *learned;
    const lg_trajectories *test;
    double tolerance;
    double *predicted; /* (N, M, d) */
} judgement;

static lg_status judge_one(void *user, size_t i, lg_error *error) {
    const judgement *self = user;
    const lg_trajectories *test = self->test;
    const size_t size = test->points * test->state_dim, most = MOST_STEPS + MOST_STEPS_A_POINT * test->points;
    double *y = self->predicted + i * size;
    lg_status status = app_interrupted() ? LG_CANCELLED : LG_OK;
    if (status == LG_OK)
        status = app_flow(self->context, self->learned, lg_scheme_find(self->model->family->accurate),
                          self->tolerance, most, test->data + i * size, test->t, test->points, y, NULL);
    if (status == LG_OK) status = land(self->model, test->points, y, NULL);
    if (status == LG_OK) return LG_OK;
    if (status == LG_TOO_MANY_STEPS)
        return lg_fail(
            error, LG_TOO_MANY_STEPS,
            "the learned flow of test trajectory %zu needs more than %zu steps at tolerance %g: the "
            "model is far from a flow of these data; train it longer, or give a larger --tolerance",
            i, most, self->tolerance);
    return lg_fail(error, status, "the learned flow of test trajectory %zu: %s", i,
                   lg_status_sentence(status));
}

void energies_of(const lg_model *learned, const double *states, size_t count, size_t stride, double *out) {
    APP_FREE void *work = app_alloc(lg_model_work_size(learned), 1);
    for (size_t i = 0; i < count; i++) lg_model_eval(learned, states + i * stride, out + i, work);
}

/* Mean |d - mean d|; the mean is subtracted because H is determined only up to a constant. */
static double energy_error(const lg_model *learned, const lg_trajectories *test) {
    if (test->hamiltonian == NULL) return NAN;
    APP_FREE double *d = app_alloc(test->count, sizeof *d);
    double mean = 0, error = 0;
    energies_of(learned, test->data, test->count, test->points * test->state_dim, d);
    for (size_t i = 0; i < test->count; i++) {
        d[i] = test->hamiltonian[i] - d[i];
        mean += d[i];
    }
    mean /= (double)test->count;
    for (size_t i = 0; i < test->count; i++) error += fabs(d[i] - mean);
    return error / (double)test->count;
}

/* Mean of the squared differences; each trajectory's are added first. */
static double mean_square(const lg_trajectories *test, const double *predicted) {
    const size_t size = test->points * test->state_dim;
    double sum = 0;
    for (size_t i = 0; i < test->count; i++) {
        double squares = 0;
        for (size_t k = i * size; k < (i + 1) * size; k++)
            squares += (predicted[k] - test->data[k]) * (predicted[k] - test->data[k]);
        sum += squares;
    }
    return sum / ((double)test->count * (double)test->points * (double)test->state_dim);
}

lg_status judge(const lg_context *context, uint64_t threads, const lg_hamiltonian *model, const double *theta,
                const lg_trajectories *test, double tolerance, double *predicted, verdict *out,
                lg_error *error) {
    lg_model *learned = NULL;
    LG_TRY(lg_hamiltonian_learned(context, model, theta, &learned, error));
    judgement work = {context, model, learned, test, tolerance, predicted};
    const lg_status status = lg_jobs_run(context, threads, test->count, judge_one, &work, error);
    if (status == LG_OK)
        *out = (verdict){.e1 = mean_square(test, predicted), .e2 = energy_error(learned, test)};
    lg_model_destroy(learned);
    return status;
}

/* ---- relative errors ---- */

lg_status judge_relative(const lg_trajectories *test, const double *predicted, verdict *out,
                         lg_error *error) {
    const size_t size = lg_system_observed(test->truth), d = test->state_dim;
    APP_FREE double *z = app_alloc(2 * size, sizeof *z); /* what is observed of two states */
    APP_FREE double *work = app_alloc(lg_system_work_size(test->truth), 1);
    double sum = 0, largest = -INFINITY;
    for (size_t i = 0; i < test->count; i++) {
        double logarithms = 0;
        for (size_t at = i * test->points; at < (i + 1) * test->points; at++) {
            double difference = 0, total = 0;
            lg_status status = lg_system_observe(test->truth, test->data + at * d, z, work);
            if (status == LG_OK) status = lg_system_observe(test->truth, predicted + at * d, z + size, work);
            if (status != LG_OK)
                return lg_fail(error, status, "test trajectory %zu: %s", i, lg_status_sentence(status));
            for (size_t k = 0; k < size; k++) {
                difference += (z[k] - z[size + k]) * (z[k] - z[size + k]);
                total += (z[k] + z[size + k]) * (z[k] + z[size + k]);
            }
            logarithms += log(sqrt(difference / total) + RELATIVE_LEAST);
        }
        const double mean = logarithms / (double)test->points;
        sum += mean;
        largest = fmax(largest, mean);
    }
    out->relative = exp(sum / (double)test->count);
    out->relative_worst = exp(largest);
    return LG_OK;
}
