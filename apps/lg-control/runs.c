/* lg-control evaluate --out: a table of the states, inputs and costs of runs. */
#include <math.h>
#include <string.h>

#include "files/csv.h"
#include "lg-control/control_app.h"

/* ---- quantities ---- */

size_t control_list_quantities(const lg_policy_task *task, control_quantity *out) {
    size_t n = 0;
    uint32_t first = 0, error = 0;
    for (int velocity = 0; velocity < 2; velocity++, first = 0)
        for (uint32_t i = 0; i < task->coordinate_count; i++) {
            const lg_policy_coordinate *c = &task->coordinate[i];
            const lg_policy_motion_row *row = lg_policy_row_of(c);
            const double *start = velocity ? c->start_velocity : c->start;
            if (velocity && c->velocity[0] == '\0') continue;
            control_quantity *q = &out[n++];
            *q =
                (control_quantity){.motion = c->motion, .velocity = velocity, .first = first, .error = error};
            (void)snprintf(q->name, sizeof q->name, "%s", velocity ? c->velocity : c->name);
            q->count = velocity ? row->velocity : row->position;
            q->errors = velocity ? row->rates : row->errors;
            if (!velocity) memcpy(q->goal, c->goal, sizeof q->goal);
            memcpy(q->start, start, sizeof q->start);
            first += q->count, error += q->errors;
        }
    return n;
}

/* ---- runs ---- */

void control_runs_begin(const lg_policy *policy, uint64_t starts, bool whole, control_runs *out) {
    const lg_policy_regulator *r = lg_policy_regulator_of(policy);
    const lg_program *program = lg_policy_program(policy);
    const size_t steps = lg_policy_steps(policy);
    size_t period, ports;
    *out = (control_runs){.policy = policy, .task = lg_policy_task_of(policy)};
    (void)lg_program_find(program, "period", &period, NULL);
    const size_t state = lg_shape_count(lg_program_inputs(program, period, &ports)[0].shape);
    out->runs.path = app_keep((steps + 1) * starts * r->errors, sizeof(double));
    if (!whole) return;
    out->runs.motion = app_keep((steps + 1) * starts * state, sizeof(double));
    out->runs.input = app_keep(steps * starts * r->inputs, sizeof(double));
    out->runs.costs = app_keep(steps * starts, sizeof(double));
    out->runs.succeeded = app_keep(starts, sizeof(bool));
}

void control_find_states(const app *self, control_runs *runs) {
    static const char *const names[2] = {"positions", "velocities"};
    const size_t rows = (runs->runs.steps + 1) * runs->runs.count;
    control_quantity quantity[2 * LG_POLICY_COORDINATES];
    const size_t count = control_list_quantities(runs->task, quantity);
    for (size_t i = 0; i < count; i++) runs->numbers[quantity[i].velocity] += quantity[i].count;
    runs->seen[0] = runs->runs.motion; /* a plant without velocities: its state is the positions */
    for (int k = 0; k < 2 && runs->numbers[1] > 0; k++) {
        runs->seen[k] = app_keep(rows * runs->numbers[k], sizeof(double));
        APP_MUST(self, lg_program_eval(self->context, lg_policy_program(runs->policy), names[k], rows,
                                       (const double *const[]){runs->runs.motion},
                                       (double *const[]){runs->seen[k]}, &error));
    }
}

/* ---- the file ---- */

static void put_head(lg_columns *to, const lg_policy_task *task) {
    control_quantity quantity[2 * LG_POLICY_COORDINATES];
    const size_t count = control_list_quantities(task, quantity);
    lg_columns_names(to, "start,t");
    for (size_t i = 0; i < count; i++) {
        for (uint32_t k = 0; k < quantity[i].count; k++) {
            APP_FREE char *name = quantity[i].count > 1 ? app_format("%s.%u", quantity[i].name, k + 1)
                                                        : app_format("%s", quantity[i].name);
            lg_columns_name(to, name);
        }
    }
    for (uint32_t l = 0; l < task->input_count; l++) lg_columns_name(to, task->input[l].name);
    lg_columns_names(to, "cost");
    lg_columns_end(to);
}

void control_write_runs(const app *self, const control_runs *runs, const char *path) {
    const lg_policy_runs *r = &runs->runs;
    const size_t m = runs->task->input_count;
    lg_columns to = {.text = app_text()};
    put_head(&to, runs->task);
    for (size_t i = 0; i < r->count; i++)
        for (size_t k = 0; k <= r->steps; k++) {
            const size_t row = k * r->count + i;
            const bool moved = k < r->steps;
            lg_columns_whole(&to, i);
            lg_columns_number(&to, (double)k * runs->task->period);
            for (int part = 0; part < 2; part++)
                lg_columns_numbers(&to, runs->seen[part] + row * runs->numbers[part], runs->numbers[part]);
            for (size_t l = 0; l < m; l++)
                lg_columns_number(&to, moved ? r->input[row * m + l] : (double)NAN);
            lg_columns_number(&to, moved ? r->costs[row] : (double)NAN);
            lg_columns_end(&to);
        }
    APP_MUST_FILE(self, path, lg_columns_write(&to, self->context, path, &error));
}
