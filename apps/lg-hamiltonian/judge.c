/* How good a learned Hamiltonian is. */
#include "lg-hamiltonian/learning.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

double default_tolerance(const lg_hamiltonian *model) {
    return model->potential == LG_POTENTIAL_LINEAR ? 1e-13 : 1e-10;
}

lg_status learned_flow(const lg_context *context, const lg_hamiltonian *model, const double *theta,
                       double tolerance, const double *start, const double *times, size_t count, double *out,
                       lg_run_stats *stats) {
    const lg_model learned = {.kind = LG_MODEL_HAMILTONIAN, .hamiltonian = *model, .theta = theta};
    const lg_scheme *scheme = lg_scheme_find(model->family == LG_HAMILTONIAN_CHAIN ? "rkmk54" : "dp54");
    void *work = app_alloc(lg_model_work_size(&learned), 1);
    lg_model_user user;
    lg_ode ode;
    lg_step_controller control;
    lg_stepper *stepper = NULL;
    lg_step_controller_init(&control);
    control.rtol = control.atol = tolerance;
    lg_status status = lg_model_ode(&learned, &user, work, &ode);
    if (status == LG_OK) status = lg_stepper_create(context, scheme, &ode, &stepper);
    if (status == LG_OK)
        status = lg_integrate_adaptive(stepper, &control, times[0], start, times, count, out, stats);
    lg_stepper_destroy(context, stepper);
    free(work);
    return status;
}

typedef struct judgement {
    const lg_context *context;
    const lg_hamiltonian *model;
    const double *theta;
    const lg_trajectories *test;
    double tolerance;
    double *predicted; /* (N, M, d), or NULL */
    double *squares;   /* (N) */
    lg_status *status; /* (N) */
} judgement;

static void judge_one(void *user, size_t i) {
    const judgement *self = user;
    const lg_trajectories *test = self->test;
    const size_t size = test->points * test->state_size;
    const double *given = test->data + i * size;
    double *own = self->predicted == NULL ? app_alloc(size, sizeof *own) : NULL;
    double *y = own != NULL ? own : self->predicted + i * size;
    if (app_interrupted()) {
        self->status[i] = LG_CANCELLED;
    } else {
        self->status[i] = learned_flow(self->context, self->model, self->theta, self->tolerance, given,
                                       test->t, test->points, y, NULL);
        for (size_t k = 0; self->status[i] == LG_OK && k < size; k++)
            self->squares[i] += (y[k] - given[k]) * (y[k] - given[k]);
    }
    free(own);
}

void learned_energies(const lg_hamiltonian *model, const double *theta, const double *states, size_t count,
                      size_t stride, double *out) {
    void *work = app_alloc(lg_hamiltonian_work_size(model), 1);
    for (size_t i = 0; i < count; i++) out[i] = lg_hamiltonian_value(model, theta, states + i * stride, work);
    free(work);
}

/* Mean |d - mean d|: H is determined up to a constant. */
static double energy_error(const lg_hamiltonian *model, const double *theta, const lg_trajectories *test) {
    if (test->hamiltonian == NULL) return (double)NAN;
    double *d = app_alloc(test->count, sizeof *d), mean = 0, error = 0;
    learned_energies(model, theta, test->data, test->count, test->points * test->state_size, d);
    for (size_t i = 0; i < test->count; i++) {
        d[i] = test->hamiltonian[i] - d[i];
        mean += d[i];
    }
    mean /= (double)test->count;
    for (size_t i = 0; i < test->count; i++) error += fabs(d[i] - mean);
    free(d);
    return error / (double)test->count;
}

lg_status record_verdict(const lg_context *context, const char *path, const lg_hamiltonian_run *run,
                         double *theta, const lg_trajectories *test, const verdict *result, lg_error *error) {
    lg_hamiltonian_file file = {.run = *run,
                                .parameters = lg_hamiltonian_parameters(&run->model),
                                .theta = theta,
                                .has_e1 = true,
                                .e1 = result->e1,
                                .has_e2 = test->hamiltonian != NULL,
                                .e2 = result->e2,
                                .test = {.trajectories = test->count,
                                         .points = test->points,
                                         .t_end = test->t[test->points - 1] - test->t[0]}};
    memcpy(file.test.sha256, test->sha256, sizeof test->sha256);
    return lg_model_record_hamiltonian(context, path, &file, error);
}

lg_status judge(const lg_context *context, uint64_t threads, const lg_hamiltonian *model, const double *theta,
                const lg_trajectories *test, double tolerance, double *predicted, verdict *out,
                lg_error *error) {
    judgement work = {.context = context,
                      .model = model,
                      .theta = theta,
                      .test = test,
                      .tolerance = tolerance,
                      .predicted = predicted};
    work.squares = app_alloc(test->count, sizeof *work.squares);
    work.status = app_alloc(test->count, sizeof *work.status);
    app_parallel(threads, test->count, judge_one, &work);
    lg_status status = LG_OK;
    double sum = 0;
    for (size_t i = 0; i < test->count && status == LG_OK; i++) {
        status = work.status[i];
        sum += work.squares[i];
        if (status != LG_OK && error != NULL) {
            error->status = status;
            (void)snprintf(error->message, sizeof error->message,
                           "the learned flow of test trajectory %zu: %s", i, lg_status_sentence(status));
        }
    }
    if (status == LG_OK) {
        out->e1 = sum / ((double)test->count * (double)test->points * (double)test->state_size);
        out->e2 = energy_error(model, theta, test);
    }
    free(work.squares);
    free(work.status);
    return status;
}
