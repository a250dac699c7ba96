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

/* ---- runs of the library (policy_loop.c) ---- */

/* A run of the library: what the controller sees (periods + 1, given + velocities) and its inputs (periods,
 * inputs), as numbers of the exported type, and states (periods + 1, state). */
typedef struct export_path {
    double *seen, *held, *state;
    size_t periods; /* at least 1 */
} export_path;
/* `noise` (given): of the positions that are seen; `more` (2 velocities): the plant has 0.3 of this offset
 * and of this damping more than the machine, as impulses once a period; NULL: none. */
export_path export_loop_run(const export_policy_job *job, uint64_t stream, const double *noise,
                            const double *more);

/* Adds the closed loop to the self-test. */
void export_policy_loop(export_policy_job *job);

/* ---- functions around the policy: they become functions of its program with a memory, with words and
 * declarations ---- */

/* observe (policy_observe.c) and adapt (policy_adapt.c). */
void export_policy_observe(export_policy_job *job);
void export_policy_adapt(export_policy_job *job);
/* Refuses a plant whose state is more than lines, angles, and one momentum for each; `function` is for the
 * message. */
void export_policy_simple(const export_policy_job *job, const char *function);
/* Adds the run of a function whose memory has `numbers` numbers, and its declarations, <function>.cin below
 * code/policy. The caller fills the run. */
export_memory *export_policy_keep(export_policy_job *job, const char *function, size_t numbers);
/* Adds the memory at the start as the array <function>_first, and the function's fragment. */
void export_policy_start(const export_policy_job *job, const export_memory *run);
/* Record the plant's state from positions and velocities; 1/x, or 0 where x is no normal number above 0. */
lg_var export_policy_state(lg_tape *tape, const export_policy_job *job, lg_var x);
lg_var export_policy_inverse(lg_tape *tape, const export_policy_job *job, lg_var x);

#endif
