/* The options of training: from the command line, over a preset or a stored run, into what trains. */
#include "common/fit.h"

#include <stdlib.h>
#include <string.h>

const char *const fit_dtypes[] = {[LG_F64] = "f64", [LG_F32] = "f32", NULL};
const char *const fit_schedules[] = {
    [LG_SCHEDULE_CONSTANT] = "constant", [LG_SCHEDULE_STEP] = "step", [LG_SCHEDULE_COSINE] = "cosine", NULL};
const char *const fit_activations[] = {"tanh",       "sigmoid", "swish",    "relu",
                                       "leaky-relu", "sine",    "identity", NULL};

int fit_position_of(const char *const *names, const char *name, int otherwise) {
    for (int i = 0; names[i] != NULL; i++)
        if (strcmp(names[i], name) == 0) return i;
    return otherwise;
}

lg_training fit_training(const fit_values *values, uint64_t seed) {
    return (lg_training){.dtype = (lg_dtype)values->dtype,
                         .epochs = values->epochs,
                         .batch = values->batch,
                         .lr = values->lr,
                         .schedule = (lg_schedule_kind)values->schedule,
                         .lr_step = values->lr_step,
                         .lr_gamma = values->lr_gamma,
                         .weight_decay = values->weight_decay,
                         .adam_eps = values->adam_eps,
                         .clip = values->clip,
                         .validation = values->validation,
                         .shards = (uint32_t)values->shards,
                         .seed = seed};
}

void fit_adopt(app *self, fit_values *values, const lg_training *training, bool seed) {
    const struct {
        const char *option;
        uint64_t *target, value;
    } wholes[] = {{"epochs", &values->epochs, training->epochs},
                  {"batch", &values->batch, training->batch},
                  {"lr-step", &values->lr_step, training->lr_step},
                  {"shards", &values->shards, training->shards}};
    const struct {
        const char *option;
        double *target, value;
    } reals[] = {{"lr", &values->lr, training->lr},
                 {"lr-gamma", &values->lr_gamma, training->lr_gamma},
                 {"weight-decay", &values->weight_decay, training->weight_decay},
                 {"adam-eps", &values->adam_eps, training->adam_eps},
                 {"clip", &values->clip, training->clip},
                 {"validation", &values->validation, training->validation}};
    const struct {
        const char *option;
        int *target, value;
    } names[] = {{"dtype", &values->dtype, (int)training->dtype},
                 {"schedule", &values->schedule, (int)training->schedule}};
    for (size_t i = 0; i < APP_COUNT(wholes); i++)
        if (!app_given(self, wholes[i].option)) *wholes[i].target = wholes[i].value;
    for (size_t i = 0; i < APP_COUNT(reals); i++)
        if (!app_given(self, reals[i].option)) *reals[i].target = reals[i].value;
    for (size_t i = 0; i < APP_COUNT(names); i++)
        if (!app_given(self, names[i].option)) *names[i].target = names[i].value;
    if (seed && !self->seed_given) self->seed = training->seed;
}

int fit_check_outputs(const app *self, const fit_values *values) {
    if (values->out == NULL) return app_usage(self, "--out FILE is missing");
    char *checkpoint = fit_checkpoint_path(values);
    /* A run may go on in the checkpoint that it came from. */
    const bool same = values->resume != NULL && app_same_file(values->resume, checkpoint);
    const app_path paths[] = {{"resume", same ? NULL : values->resume, APP_READ},
                              {"out", values->out, APP_WRITTEN},
                              {"checkpoint", checkpoint, APP_WRITTEN},
                              {"history", values->history, APP_WRITTEN},
                              {"plot", values->plot, APP_DRAWN}};
    const int code = app_check_outputs(self, paths, APP_COUNT(paths));
    free(checkpoint);
    return code;
}

char *fit_checkpoint_path(const fit_values *values) {
    return values->checkpoint != NULL ? app_format("%s", values->checkpoint)
                                      : app_format("%s.checkpoint", values->out);
}
