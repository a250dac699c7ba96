/* The command of lg-fit that is not the same for all kinds of models. */
#ifndef LG_APPS_FIT_H
#define LG_APPS_FIT_H

#include "common/verbs.h"
#include "table/files/recipe.h"

extern const app_command predict_command;

#endif
