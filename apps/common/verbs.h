/* Commands that are the same for all kinds of models. The row of such a command (app_command.row) is the
 * program's train_task. */
#ifndef LG_APPS_VERBS_H
#define LG_APPS_VERBS_H

#include "common/search.h"

#define VERB(name, task) .run = verb_##name, .row = &(task)
/* Fields of a command `train`; the task's settings are its options. */
#define TRAIN_COMMAND(data, task, kinds)                                                                     \
    .name = "train", .arguments = data, .plots = kinds, VERB(train, task), .together = APP_RANKS

void verb_train(app *app);
void verb_search(app *app); /* options: SEARCH_SHARED; task->command is the command whose options vary */
/* Results of the model in argument 0 on the data in the others, by the trainer's `evaluate`. A task without a
 * recipe evaluates a model of any kind. The plots of the command get the training (train_draw). */
void verb_evaluate(app *app);

/* Options of commands that integrate a learned flow; --tolerance is the last one. */
typedef struct flow_values {
    lg_reals initial;
    double t_end, tolerance; /* 0: not given */
    uint64_t points;
} flow_values;
extern flow_values flow_given;
extern const lg_field flow_options[];
/* The row of --metric, for a command that can also print a geometric mean of relative errors; the member is a
 * bool. `usual_`: the name of its other errors. */
#define RELATIVE(type, usual_, ...)                                                                          \
    LG_OPTION(type, relative, NAME, NULL, "relative: also the geometric mean of " __VA_ARGS__,               \
              .option = "metric", LG_NAMES(usual_, "relative"))
#define FLOW           APP_GIVEN(flow_options, flow_given)
#define FLOW_TOLERANCE APP_GIVEN(flow_options + 3, flow_given)

/* Integrates the field of a model from `start` at times[0] and writes the states at all `count` times to
 * `out`, (count, d). The scheme is adaptive. Its error per step is relative to the largest value so far of
 * the component's group (lg_step_controller with rtol = tolerance, atol = -tolerance). most: largest number
 * of steps, 0 for the default. stats may be NULL. The errors are those of lg_integrate_adaptive. */
lg_status app_flow(const lg_context *context, const lg_model *learned, const lg_scheme *scheme,
                   double tolerance, size_t most, const double *start, const double *times, size_t count,
                   double *out, lg_run_stats *stats);

#endif
