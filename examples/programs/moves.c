/* A program as a model that moves: it is saved with the space of its states, and loaded like a trained
 * model. A loop of steps also returns its motion, of which a further function computes a cost. */
#include "programs.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <liegrad/model.h>
#include <liegrad/ops.h>

enum { STEPS = 10 };

/* Evaluates `function` at x, u, h. `next` (2 numbers; the second one is NaN for a cost) may be the same array
 * as x. */
static lg_status evaluate(const lg_model *model, const char *function, double *x, double *u, double *h,
                          double *next, lg_error *error) {
    lg_plan *plan;
    lg_status status = lg_model_find(model, function, NULL, &plan, error);
    if (status != LG_OK) return status;
    double y[2] = {NAN, NAN};
    void *work = aligned_alloc(64, (lg_plan_work_size(plan) + 63) / 64 * 64 + 64);
    if (work != NULL)
        lg_plan_eval(plan, (const void *[]){x, u, h}, (void *[]){y, NULL}, work); /* the path is not wanted */
    memcpy(next, y, sizeof y);
    free(work);
    lg_plan_destroy(plan);
    return work != NULL ? LG_OK : LG_OUT_OF_MEMORY;
}

/* The mean square of the states in a motion of STEPS steps. */
static lg_status record_cost(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const lg_var motion = lg_program_call(tape, "steps", 1, x); /* y_path, (B, STEPS, 2) */
    (void)user, (void)theta;
    y[0] = lg_mean_axis(tape, lg_mean_axis(tape, lg_square(tape, motion), 2, false), 1, false);
    return lg_tape_status(tape);
}

/* Adds the function `steps`, which makes STEPS steps with a constant input, and the function `cost`, which
 * calls it. `steps` is a loop, both in memory and in exported C. */
static lg_status save(const char *path, lg_program *driven, lg_error *error) {
    const lg_carry carry = {"y", "x"};
    const char *const path_of[] = {"y"};
    const lg_port cost_port = {.name = "cost"};
    const lg_loop_spec loop = {.size = sizeof loop,
                               .name = "steps",
                               .function = "step",
                               .times = STEPS,
                               .carry = &carry,
                               .carry_count = 1,
                               .path = path_of,
                               .path_count = 1};
    lg_function_spec cost = {.name = "cost", .outputs = &cost_port, .output_count = 1, .record = record_cost};
    size_t step;
    lg_space space;
    lg_status status = lg_program_add_loop(driven, &loop, error);
    if (status == LG_OK) status = lg_program_find(driven, "step", &step, NULL);
    if (status == LG_OK) cost.inputs = lg_program_inputs(driven, step, &cost.input_count);
    if (status == LG_OK) status = lg_program_add_function(driven, &cost, error);
    if (status == LG_OK) status = lg_space_init_rn(&space, 2);
    return status == LG_OK ? lg_model_save(NULL, path, "driven", driven, &space, NULL, error) : status;
}

int moves(const char *folder, lg_program *driven) {
    char path[1024];
    lg_model_file file;
    lg_error error;
    double loop[2], cost[2] = {NAN}, mean = 0, x[2] = {1, 0}, u = 0.2, h = 0.1;
    (void)snprintf(path, sizeof path, "%s/driven-model.h5", folder);
    lg_status status = save(path, driven, &error);
    if (status == LG_OK) status = lg_model_load(NULL, path, NULL, &file, &error);
    if (status != LG_OK) return (void)fprintf(stderr, "%s\n", error.message), 0;
    status = evaluate(file.model, "steps", x, &u, &h, loop, &error);
    if (status == LG_OK) status = evaluate(file.model, "cost", x, &u, &h, cost, &error);
    for (int i = 0; i < STEPS && status == LG_OK; i++) {
        status = evaluate(file.model, "step", x, &u, &h, x, &error);
        mean += (x[0] * x[0] + x[1] * x[1]) / (2 * STEPS);
    }
    if (status != LG_OK) (void)fprintf(stderr, "%s\n", error.message);
    (void)printf("  saved as a model with %zu input: (%.6f, %.6f) after %d steps\n",
                 lg_model_input_dim(file.model), loop[0], loop[1], STEPS);
    lg_model_file_destroy(&file);
    return status == LG_OK && fabs(loop[0] - x[0]) + fabs(loop[1] - x[1]) + fabs(cost[0] - mean) < 1e-14;
}
