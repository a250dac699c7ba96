/* Export of controllers: what the files of this folder share. */
#ifndef LG_EXPORT_POLICY_H
#define LG_EXPORT_POLICY_H

#include "control/policy.h"
#include "lg-export/export.h"

/* A controller that is being exported. */
typedef struct export_policy_job {
    const app *self;
    export_source *source;
    lg_policy *policy;
    const lg_policy_task *task;
    lg_program *program; /* The policy's; its parameters are rounded to the exported type. */
    /* Numbers of positions as NAME_control takes them, of velocities, of the plant's state, of inputs. */
    size_t given, velocities, state, inputs;
    text declarations; /* Of functions that are not in the program, for NAME.h. */
} export_policy_job;

/* Adds the closed loop to the self-test (policy_loop.c). */
void export_policy_loop(export_policy_job *job);

/* Add the functions observe and adapt, with their descriptions and reference runs (policy_memory.c). */
void export_policy_observe(export_policy_job *job);
void export_policy_adapt(export_policy_job *job);

#endif
