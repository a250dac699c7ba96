/* From a run and its curves to a trained surrogate. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-elastica/train.h"

enum { STREAM_WEIGHTS = 1 };

static part_indices indices_of(const uint8_t *parts, size_t n, lg_part wanted) {
    part_indices out = {app_alloc(n, sizeof *out.list), 0};
    for (size_t i = 0; i < n; i++)
        if (parts[i] == (uint8_t)wanted) out.list[out.count++] = (uint32_t)i;
    return out;
}

lg_status split_curves(const lg_surrogate_run *run, part_indices *train, part_indices *test,
                       lg_error *error) {
    const size_t n = (size_t)run->curves;
    uint8_t *parts = app_alloc(n, 1);
    const lg_status status =
        lg_surrogate_split(n, run->train_fraction, run->test_fraction, run->training.seed, parts);
    if (status == LG_OK) {
        *train = indices_of(parts, n, LG_PART_TRAIN);
        *test = indices_of(parts, n, LG_PART_TEST);
    } else {
        (void)app_error(error, status,
                        "fractions %g for training and %g for testing: more than 1 together, or no curve of "
                        "%zu to train on",
                        run->train_fraction, run->test_fraction, n);
    }
    free(parts);
    return status;
}

static lg_status no_room(const lg_surrogate *model, lg_error *error) {
    return app_error(error, LG_OUT_OF_MEMORY, "out of memory: the network has %zu parameters",
                     lg_surrogate_parameters(model));
}

lg_status learner_create(const lg_context *context, const lg_surrogate_run *run,
                         const lg_elastica_curves *curves, const part_indices *training,
                         const lg_fit_options *options, learner *out, lg_error *error) {
    *out = (learner){.run = *run};
    out->problem = (lg_surrogate_problem){&out->run.model, curves, training->list, training->count};
    lg_status status = lg_surrogate_problem_check(&out->problem, error);
    if (status != LG_OK) return status;
    lg_surrogate_fit_problem(&out->problem, &out->fit_problem);
    double *theta = app_try_alloc(lg_surrogate_parameters(&out->run.model), sizeof *theta);
    if (theta == NULL) return no_room(&out->run.model, error);
    lg_rng rng;
    lg_rng_seed(&rng, run->training.seed, STREAM_WEIGHTS);
    lg_net_initialise(&out->run.model.net, LG_INIT_FAN_IN, &rng, theta);
    status = lg_fit_create(context, &out->fit_problem, options, theta, &out->fit, error);
    free(theta);
    return status;
}

void learner_destroy(learner *learned) {
    lg_fit_destroy(learned->fit);
    learned->fit = NULL;
}

lg_status learner_errors(const lg_context *context, const learner *learned, const part_indices *part,
                         lg_surrogate_errors *out, lg_error *error) {
    const double none = (double)NAN;
    *out = (lg_surrogate_errors){none, none, none, none, none, none, none};
    if (part->count == 0) return LG_OK;
    double *theta = app_try_alloc(lg_surrogate_parameters(&learned->run.model), sizeof *theta);
    if (theta == NULL) return no_room(&learned->run.model, error);
    lg_fit_parameters(learned->fit, theta);
    const lg_status status =
        lg_surrogate_evaluate(context, &learned->run.model, theta, learned->problem.curves, part->list,
                              part->count, NULL, out, error);
    free(theta);
    return status;
}

lg_status save_model(const app *self, const char *path, const learner *learned, double train_mse,
                     double test_mse, lg_error *error) {
    const lg_surrogate_problem *problem = &learned->problem;
    lg_surrogate_file file;
    memset(&file, 0, sizeof file);
    file.run = learned->run;
    file.parameters = lg_surrogate_parameters(&learned->run.model);
    file.theta = app_alloc(file.parameters, sizeof *file.theta);
    lg_fit_parameters(learned->fit, file.theta);
    file.trained_count = problem->training_count;
    file.trained = app_alloc(8 * file.trained_count, sizeof *file.trained);
    for (size_t i = 0; i < file.trained_count; i++)
        memcpy(file.trained + 8 * i, problem->curves->boundary + 8 * (size_t)problem->training[i],
               8 * sizeof *file.trained);
    file.has_errors = true;
    file.train_mse = train_mse;
    file.test_mse = test_mse;
    file.provenance = app_provenance(self, learned->run.training.seed);
    const lg_status status = lg_model_save_surrogate(self->context, path, &file, learned->fit, error);
    free(file.theta);
    free(file.trained);
    return status;
}
