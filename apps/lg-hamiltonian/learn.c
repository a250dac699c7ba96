/* Training a learned Hamiltonian: what `train`, `study` and `demo` have in common. */
#include "lg-hamiltonian/learning.h"

#include <stdlib.h>
#include <string.h>

enum { STREAM_WEIGHTS = 1, ERROR_CHUNK = 128 };

lg_status describe_run(const lg_trajectories *data, lg_hamiltonian_run *run, lg_error *error) {
    const lg_mlp net = run->model.net;
    const lg_status status = lg_hamiltonian_init(&run->model, data->family, data->n, run->model.potential,
                                                 net.width + 1, net.layers - 1, net.activation);
    if (status != LG_OK) return app_error(error, status, "a network of this size cannot be made");
    memcpy(run->system, data->system, sizeof run->system);
    memcpy(run->data_sha256, data->sha256, sizeof run->data_sha256);
    run->trajectories = data->count;
    run->points = data->points;
    run->dt = data->dt;
    return LG_OK;
}

static lg_hamiltonian_problem problem_of(const learner *self, const lg_trajectories *data) {
    const lg_hamiltonian_run *run = &self->run;
    return (lg_hamiltonian_problem){.model = &run->model,
                                    .scheme = run->scheme,
                                    .substeps = run->substeps,
                                    .penalty = run->penalty,
                                    .penalty_form = run->penalty_form,
                                    .trajectories = data->count,
                                    .points = data->points,
                                    .dt = data->dt,
                                    .data = data->data};
}

lg_status learner_create(const lg_context *context, const lg_hamiltonian_run *run,
                         const lg_trajectories *data, const lg_fit_options *options, learner *out,
                         lg_error *error) {
    *out = (learner){.run = *run};
    out->problem = problem_of(out, data);
    lg_status status = lg_hamiltonian_problem_check(&out->problem, error);
    if (status != LG_OK) return status;
    lg_hamiltonian_fit_problem(&out->problem, &out->fit_problem);
    double *theta = app_alloc(lg_hamiltonian_parameters(&out->run.model), sizeof *theta);
    lg_rng rng;
    lg_rng_seed(&rng, run->training.seed, STREAM_WEIGHTS);
    lg_hamiltonian_initialise(&out->run.model, &rng, theta);
    lg_fit_options chosen = *options;
    lg_training_apply(&out->run.training, &chosen);
    status = lg_fit_create(context, &out->fit_problem, &chosen, theta, &out->fit, error);
    free(theta);
    return status;
}

void learner_destroy(learner *self) {
    lg_fit_destroy(self->fit);
    self->fit = NULL;
}

/* The sum of squares over all samples, chunk by chunk on one tape, as parts of one batch: their sum is the
 * mean. */
static lg_status add_chunks(lg_tape *tape, const lg_fit_problem *fit, const double *theta, double *sum) {
    uint32_t samples[ERROR_CHUNK];
    *sum = 0;
    for (size_t first = 0; first < fit->samples; first += ERROR_CHUNK) {
        const size_t left = fit->samples - first, count = left < ERROR_CHUNK ? left : ERROR_CHUNK;
        for (size_t i = 0; i < count; i++) samples[i] = (uint32_t)(first + i);
        lg_tape_reset(tape);
        lg_var loss, parameters = lg_parameter(tape, lg_shape1((uint32_t)fit->parameters), theta);
        lg_status status = fit->loss(fit->user, tape, parameters, samples, count, fit->samples, &loss);
        double part = 0;
        if (status == LG_OK) status = lg_read(tape, loss, 1, &part);
        if (status != LG_OK) return status;
        *sum += part;
    }
    return LG_OK;
}

lg_status mean_squared_error(const lg_context *context, const lg_hamiltonian_problem *problem,
                             const double *theta, double *out, lg_error *error) {
    lg_hamiltonian_problem plain = *problem;
    plain.penalty = 0;
    lg_fit_problem fit;
    lg_hamiltonian_fit_problem(&plain, &fit);
    lg_tape *tape = NULL;
    lg_status status = lg_tape_create(context, NULL, &tape);
    if (status == LG_OK) {
        status = add_chunks(tape, &fit, theta, out);
        if (status != LG_OK) (void)app_error(error, status, "%s", lg_tape_message(tape));
    } else {
        (void)app_error(error, status, "%s", lg_status_sentence(status));
    }
    lg_tape_destroy(tape);
    return status;
}

void warn_of_inputs(const app *self, const char *path, const lg_trajectories *data) {
    if (data->inputs != NULL)
        app_warn(self, "%s: /inputs (%u a step) are not used: the learned system has no inputs", path,
                 data->input_dim);
}

lg_status save_model(const app *self, const char *path, const learner *trained, const double *theta,
                     lg_error *error) {
    lg_hamiltonian_file file;
    memset(&file, 0, sizeof file);
    file.run = trained->run;
    file.parameters = lg_hamiltonian_parameters(&trained->run.model);
    file.provenance = app_provenance(self, trained->run.training.seed);
    file.theta = app_alloc(file.parameters, sizeof *file.theta);
    memcpy(file.theta, theta, file.parameters * sizeof *theta);
    const lg_status status = lg_model_save_hamiltonian(self->context, path, &file, trained->fit, error);
    free(file.theta);
    return status;
}
