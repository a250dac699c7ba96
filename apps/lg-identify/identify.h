/* What the commands of lg-identify share: machines and logs, and how well a model does. Functions that return
 * int return an exit code and have told the user when it is not APP_EXIT_OK. */
#ifndef LG_APPS_IDENTIFY_H
#define LG_APPS_IDENTIFY_H

#include "common/app.h"
#include "machine/files/recipe.h"

extern const app_command check_command, fit_command, evaluate_command, predict_command, generate_command,
    demo_command;

/* ---- models and logs (data.c) ---- */

/* lg_machine_data_read; ends the command where something cannot be read. */
void identify_read(const app *self, const lg_machine_sources *from, lg_machine_data *out);

/* MODEL.h5 LOG..., the arguments of a command; the logs are read as the model's machine and delay say. */
typedef struct identify_given {
    lg_machine_model_file file;
    lg_machine_data data;
    lg_learned_machine model;
} identify_given;
/* Ends the command where something cannot be read, or momenta are measured. substeps 0: the model's. */
void identify_load(app *self, uint64_t substeps, identify_given *out);
void identify_given_destroy(identify_given *given);

#endif
