/* Declarations that the commands of lg-fit share. */
#ifndef LG_APPS_FIT_H
#define LG_APPS_FIT_H

#include "common/search.h"
#include "table/files/recipe.h"

extern const app_command train_command, evaluate_command, predict_command, search_command;

/* The outcome of judging a model: draw_judgement draws predicted against true values, or the confusion
 * matrix; judgement_print prints the errors. */
void draw_judgement(const app *self, const char *path, const lg_table_state *of);
void judgement_print(const lg_table_state *of);

#endif
