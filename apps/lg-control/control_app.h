/* What the commands of lg-control share. */
#ifndef LG_APPS_CONTROL_H
#define LG_APPS_CONTROL_H

#include "common/app.h"
#include "liegrad/certify.h"
#include "liegrad/machine.h"
#include "liegrad/policy.h"

extern const app_command control_train_command, control_evaluate_command, control_certify_command,
    control_verify_command;

/* The machine in a file (plant.c), of which plants are made. */
typedef struct control_machine {
    const app *self;
    lg_machine_model_file model; /* of a model of lg-identify */
    lg_machine_file file;
    lg_machine machine;             /* its dry friction sticks */
    double width[LG_MACHINE_TERMS]; /* of friction in the file */
    const lg_scheme *scheme;
    double row;                        /* seconds between the rows of the log; 0: no log, then a period */
    uint32_t delay[LG_MACHINE_INPUTS]; /* of the inputs, in rows */
} control_machine;
void control_machine_destroy(control_machine *machine);

/* A plant from a file (plant.c): a model of lg-identify, a machine whose terms are all known, or a program
 * with the function field (x, u). The names of its coordinates and inputs are added to the task. If `lagged`,
 * the names of its lagged inputs are added, too; otherwise the controller does not know the lagged inputs.
 * task->dead_time becomes the delays of its inputs; a row of a machine file without a log is task->period.
 * `machine` becomes the plant, if it is one. Failures end the command. */
lg_program *control_load_plant(const app *self, const char *path, bool lagged, lg_policy_task *task,
                               control_machine *machine);
/* Reads a task and its plant, at the path `source`, which is relative to the task's folder. `keep`, the
 * machine of the plant, gives the task its soft friction, and must live as long as the task's policy. `text`
 * and `source`: freed with free. */
lg_program *control_read_task(const app *self, const char *path, lg_policy_task *task, char **text,
                              char **source, control_machine *keep);

/* Adds the task's draws to the policy: machines from the covariance of the fit whose model is the file
 * `path`, with the task's spread besides. Ends the command if that is no model of lg-identify. */
void control_add_draws(const app *self, lg_policy *policy, const char *path);

/* Errors of the model for a certificate: of each state's rate (`held`: of the next state) three standard
 * deviations over plants that are drawn in this way, at the worst of random states within `high` of the goal
 * and of inputs in their limits. */
void control_draw_error(const app *self, lg_policy *policy, const char *plant, bool held, const double *high,
                        double *out);

/* A policy, or a task with its controller before training (certify.c). `gains`: of a task of kind lqr, K row
 * by row; 0 of them: as the file says. *source, freed with free: the path of the task's plant; NULL: there is
 * no task. */
lg_policy *control_read_policy(const app *self, const char *path, const double *gains, size_t count,
                               char **source);

/* Says that a claim is about continuous inputs, of a loop whose inputs are held for `period`
 * (certify_report.c). */
void control_add_continuous(lg_text *claim, double period);
/* Whether the states of the certificate have the names of the policy's states (certify_report.c). */
bool control_has_states(const lg_policy *policy, const lg_certificate *file);

/* Prints and writes, as `robustness`, the success of a policy if a number of its machine changes by a factor
 * (robustness.c). machine->scheme NULL: the plant is a program, which has no numbers. */
void control_tell_robustness(const lg_policy *policy, control_machine *machine, uint64_t starts,
                             app_json *out);

/* ---- what runs did (runs.c) ---- */

/* Runs from `starts` random starts over the steps of the task. */
typedef struct control_runs {
    const lg_policy *policy;
    const lg_policy_task *task;
    lg_policy_runs runs; /* path; of whole runs also motion, input, costs, succeeded */
    /* After control_show_runs: positions, velocities (steps + 1, starts, numbers) and inputs (steps, ...) */
    size_t numbers[3];
    double *seen[3];
} control_runs;
void control_runs_begin(const lg_policy *policy, uint64_t starts, bool whole, control_runs *out);

/* With a path, writes a row for each period of each run: start, t, positions and velocities, inputs, cost of
 * the period; the last row of a run has no inputs and no cost. With --plot, draws three panels: the motion of
 * the first 40 runs, the starts of all runs, and the inputs of the first 8 runs. */
void control_show_runs(const app *self, control_runs *runs, const char *path);
void control_put_runs(app_plot *plot, const void *shown_runs);

/* Evaluates the policy from random starts; `runs` may be NULL. */
lg_policy_outcome control_evaluate(const app *self, const lg_policy *policy, lg_policy_test mode,
                                   uint64_t starts, uint64_t seed, lg_policy_runs *runs);
/* Adds success and costs to the results: for people below the heading, in JSON as the object `key`. */
void control_tell_outcome(app_json *out, const char *key, const char *heading,
                          const lg_policy_outcome *outcome);

#endif
