/* Export of controllers: what the files of this folder share. */
#ifndef LG_EXPORT_POLICY_H
#define LG_EXPORT_POLICY_H

#include "control/policy.h"
#include "lg-export/export.h"

/* A controller that is being exported. */
typedef struct export_policy_job {
    const app *self;
    export_source *source;
    lg_policy *policy; /* For its task and regulator; the program is `program`. */
    const lg_policy_task *task;
    char *text;          /* The task as it was written. */
    lg_program *program; /* Has parameters that are rounded to the exported type. */
    /* Numbers of positions, of positions as NAME_control takes them, of velocities, of the plant's state. */
    size_t positions, given, velocities, state, inputs;
    text declarations; /* Of functions that are not in the program, for NAME.h. */
} export_policy_job;

/* ---- runs of the library (policy_loop.c) ---- */

/* The closed loop in the library: the plant and the policy, which sees positions and velocities. */
typedef struct export_loop {
    export_evaluation period, positions, velocities, policy, narrow;
    bool moves;
    double *seen;    /* Positions, velocities and weights: the inputs of `policy`. */
    double *x, *row; /* State and input: the inputs of `period`; and a row of results. */
    const export_policy_job *job;
} export_loop;
lg_status export_loop_open(const export_policy_job *job, export_loop *loop, lg_error *error);
void export_loop_close(export_loop *loop);
/* Moves the state x by one period; u (inputs; may be NULL) becomes the input. `single`: the policy computes
 * in single precision; the plant computes in double precision. */
void export_loop_step(export_loop *loop, bool single, double *x, double *u);

/* Adds the closed loop to the self-test. */
void export_policy_loop(export_policy_job *job);

/* ---- functions around the policy: they add code, words, declarations and a part of the self-test ---- */

/* NAME_observe and NAME_observe_start (policy_observe.c). */
void export_policy_observe(export_policy_job *job);
/* NAME_adapt and NAME_adapt_start (policy_adapt.c). */
void export_policy_adapt(export_policy_job *job);
/* Refuses a plant whose state is more than lines, angles, and one momentum for each; `function` is for the
 * message. */
void export_policy_simple(const export_policy_job *job, const char *function);
/* Add a constant and an array, whose type is "real" or "double". */
void export_policy_real(const export_policy_job *job, text *to, const char *name, double value);
void export_policy_reals(const export_policy_job *job, text *to, const char *type, const char *name,
                         const double *values, size_t count);
/* Writes into the header what a function needs: numbers of work in addition to the work of the hidden
 * functions, bytes of stack, and nested calls. */
void export_policy_need(export_source *source, size_t work, size_t stack, size_t calls);

#endif
