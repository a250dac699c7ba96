/* Training by a recipe: the learner's hooks do what a kind of model needs, this the rest. */
#ifndef LG_APPS_LEARN_H
#define LG_APPS_LEARN_H

#include "common/search.h"
#include "common/train.h"
#include "model/files/learning.h"

typedef struct train_recipe {
    const lg_recipe *recipe;
    const app_settings *settings; /* of the command; the first one is the run */
    const char *only;             /* a search takes this method alone; NULL: any */
    void *state;                  /* of the learner; NULL: it is made */
    /* An exit code: with the data split, before training; may be NULL. */
    int (*check)(const app *app, const lg_learning *learning);
    /* For people; NULL: the results, a line each. */
    void (*print)(const train_session *session, const lg_learning *learning);
    int (*draw)(const train_session *session, const lg_learning *learning); /* NULL: the loss */
    lg_learning learning;                                                   /* the driver's */
} train_recipe;

/* A learning of the recipe with the command's arguments from number `argument` on. */
void learn_begin(train_recipe *self, const app *app, int argument);
/* A part of the results, as a part of a command's. */
void learn_put_results(app_json *out, const lg_learning *learning, size_t first, size_t end);
/* Results of a model file's contents on the arguments from the second on; the command ends where there are
 * none. APP_EXIT_NUMERIC: they are of no use, and a warning said why. */
int learn_evaluate(train_recipe *self, const app *app, const void *file);
int train_recipe_main(app *app, train_recipe *self);
/* The beginning of train_recipe_main, for a command that also trains without a recipe: options and files are
 * checked, the data are read. An exit code; then lg_learning_close, whatever it is. */
int train_recipe_read(app *app, train_recipe *self);
/* Arguments RANGES.yaml DATA; `train` is the command whose options are searched. */
int search_recipe_main(app *app, const app_command *train, train_recipe *self);

#endif
