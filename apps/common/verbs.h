/* Commands that are the same for all kinds of models. The row of such a command (app_command.row) is the
 * program's train_task. */
#ifndef LG_APPS_VERBS_H
#define LG_APPS_VERBS_H

#include "common/search.h"

#define VERB(name, task) .run = verb_##name, .row = &(task)
/* Fields of a command `train`; the task's settings are its options. */
#define TRAIN_COMMAND(data, task) .name = "train", .arguments = data, VERB(train, task), .together = APP_RANKS

int verb_train(app *app);
int verb_search(app *app); /* options: SEARCH_SHARED; task->command is the command whose options vary */
/* Results of the model in argument 0 on the data in the others, by the trainer's `evaluate`. A task without a
 * recipe evaluates a model of any kind. Option: the row `plot` of train_files, where the task has `draw`. */
int verb_evaluate(app *app);

#endif
