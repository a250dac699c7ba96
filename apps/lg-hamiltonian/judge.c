/* How good a learned Hamiltonian is. */
#include "lg-hamiltonian/learning.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

double default_tolerance(const lg_hamiltonian *model) {
    return model->potential == LG_POTENTIAL_LINEAR ? 1e-13 : 1e-10;
}

typedef struct learned {
    const lg_hamiltonian *model;
    const double *theta;
    void *work;
} learned;

static lg_status learned_field(void *user, double t, const double *y, const double *input, double *algebra) {
    const learned *self = user;
    (void)t;
    (void)input;
    lg_hamiltonian_field(self->model, self->theta, y, algebra, self->work);
    return LG_OK;
}

static lg_status learned_space(const lg_hamiltonian *model, lg_space *space) {
    const lg_space_factor links = {LG_SPACE_TS2, model->links};
    return model->family == LG_HAMILTONIAN_CHAIN ? lg_space_init(space, &links, 1)
                                                 : lg_space_init_rn(space, (size_t)model->links * 2);
}

lg_status learned_flow(const lg_context *context, const lg_hamiltonian *model, const double *theta,
                       double tolerance, const double *start, const double *times, size_t count, double *out,
                       lg_run_stats *stats) {
    learned self = {model, theta, app_alloc(lg_hamiltonian_work_size(model), 1)};
    lg_ode ode = {.field = learned_field, .user = &self};
    lg_control control;
    lg_control_init(&control);
    control.rtol = control.atol = tolerance;
    lg_stepper *stepper = NULL;
    const lg_scheme *scheme = lg_scheme_find(model->family == LG_HAMILTONIAN_CHAIN ? "rkmk54" : "dp54");
    lg_status status = learned_space(model, &ode.space);
    if (status == LG_OK) status = lg_stepper_create(context, scheme, &ode, &stepper);
    if (status == LG_OK)
        status = lg_integrate_adaptive(stepper, &control, times[0], start, times, count, out, stats);
    lg_stepper_destroy(context, stepper);
    free(self.work);
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
