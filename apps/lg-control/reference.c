/* lg-control evaluate --reference: a run along set points from a file. */
#include <math.h>
#include <string.h>

#include "lg-control/control_app.h"
#include "liegrad/table.h"

typedef struct following {
    const app *self;
    const lg_policy *policy;
    const lg_policy_task *task;
    size_t positions, velocities, numbers, inputs; /* numbers: in `reference` */
    uint32_t place[LG_POLICY_COORDINATES]; /* of a tracked coordinate: of its position, and velocity */
    const char *column[2 * LG_POLICY_COORDINATES + 1];
    uint32_t tracked, columns;
    lg_table_data table; /* time, set points, then their rates if the file has them */
} following;

static void lay_out(following *f, const char *path) {
    APP_CLEAN(lg_table_names_destroy) lg_table_names names = {.count = 0};
    bool rates = true;
    f->column[f->columns++] = "t";
    for (uint32_t i = 0; i < f->task->coordinate_count; i++) {
        const lg_policy_coordinate *c = &f->task->coordinate[i];
        if (c->motion > LG_POLICY_ANGLE)
            app_stop(f->self, LG_UNSUPPORTED,
                     "--reference: %s is a %s; runs along set points are for lines and angles", c->name,
                     lg_policy_motion_row_of(c->motion)->name);
        f->positions++;
        f->velocities += c->velocity[0] != '\0';
        if (!c->track) continue;
        f->place[f->tracked++] = i;
        f->column[f->columns++] = c->name;
    }
    if (f->tracked == 0)
        app_stop(f->self, LG_FORMAT,
                 "--reference: the policy's task tracks no coordinate; give it track: [NAME]");
    f->numbers = f->tracked * (f->velocities > 0 ? 2 : 1);
    APP_MUST_FILE(f->self, path, lg_table_names_read(f->self->context, path, NULL, &names, &error));
    for (uint32_t k = 0; k < f->tracked; k++) {
        const char *wanted = f->task->coordinate[f->place[k]].velocity;
        bool found = false;
        for (uint32_t i = 0; i < names.count; i++) found = found || strcmp(names.name[i], wanted) == 0;
        rates = rates && found && wanted[0] != '\0';
    }
    for (uint32_t k = 0; rates && k < f->tracked; k++)
        f->column[f->columns++] = f->task->coordinate[f->place[k]].velocity;
    APP_MUST_FILE(
        f->self, path,
        lg_table_read(f->self->context, path, f->column, f->columns, NULL, NULL, &f->table, &error));
    for (size_t i = 0; i < f->table.rows * f->columns; i++)
        if (!isfinite(f->table.values[i]))
            app_stop(f->self, LG_FORMAT, "%s: %s %zu: column %s has no number", path, f->table.place,
                     f->table.line[i / f->columns], f->column[i % f->columns]);
    for (size_t i = 1; i < f->table.rows; i++)
        if (!(f->table.values[i * f->columns] > f->table.values[(i - 1) * f->columns]))
            app_stop(f->self, LG_FORMAT, "%s: %s %zu: the time t does not increase", path, f->table.place,
                     f->table.line[i]);
}

/* Straight lines between the rows. Without columns of rates the rates are 0. *row: where to begin. */
static void reference_at(const following *f, double t, size_t *row, double *out) {
    const double *all = f->table.values;
    const size_t n = f->columns, last = f->table.rows - 1;
    while (*row < last && all[(*row + 1) * n] <= t) ++*row;
    const double *a = all + *row * n, *b = *row < last ? a + n : a;
    const double part = b > a ? (t - a[0]) / (b[0] - a[0]) : 0;
    memset(out, 0, f->numbers * sizeof *out);
    for (size_t i = 1; i < n; i++) out[i - 1] = a[i] + part * (b[i] - a[i]);
}

lg_plan *control_plan(const app *self, const lg_policy *policy, const char *function) {
    lg_plan *plan = NULL;
    size_t number;
    const lg_program *program = lg_policy_program(policy);
    APP_MUST(self, lg_program_find(program, function, &number, &error));
    APP_MUST(self, lg_plan_create(program, number, NULL, &plan, &error));
    return plan;
}

/* The functions of a run; without velocities the state is the positions, and the last three are NULL. */
enum { TRACK, PERIOD, MOMENTA, POSITIONS, VELOCITIES, FUNCTIONS };

typedef struct sums {
    double square, largest;
} sums;

static void run_along(const following *f, lg_plan *const *plan, double *x, void *work, sums *sum,
                      double *saturated) {
    const double begin = f->table.values[0], end = f->table.values[(f->table.rows - 1) * f->columns];
    const size_t steps = (size_t)((end - begin) / f->task->period) + 1, nq = f->positions;
    double seen[2 * LG_POLICY_COORDINATES] = {0}, reference[2 * LG_POLICY_COORDINATES], u[LG_POLICY_INPUTS];
    double *next = x + lg_plan_input_count(plan[PERIOD], 0);
    size_t row = 0;
    for (size_t i = 0; i < nq; i++) seen[i] = f->task->coordinate[i].goal[0];
    reference_at(f, begin, &row, reference);
    for (uint32_t k = 0; k < f->tracked; k++) seen[f->place[k]] = reference[k];
    if (plan[MOMENTA] != NULL)
        lg_plan_eval(plan[MOMENTA], (const void *[]){seen, seen + nq}, (void *[]){x}, work);
    else
        memcpy(x, seen, nq * sizeof *x);
    for (size_t s = 0; s < steps; s++) {
        reference_at(f, begin + (double)s * f->task->period, &row, reference);
        for (uint32_t k = 0; k < f->tracked; k++) {
            const double off = fabs(seen[f->place[k]] - reference[k]);
            sum[k].square += off * off / (double)steps;
            sum[k].largest = off <= sum[k].largest ? sum[k].largest : off;
        }
        lg_plan_eval(plan[TRACK], (const void *[]){seen, reference}, (void *[]){u}, work);
        for (size_t l = 0; l < f->inputs; l++) {
            const lg_policy_input *in = &f->task->input[l];
            if (u[l] > in->low + 1e-3 * (in->high - in->low) && u[l] < in->high - 1e-3 * (in->high - in->low))
                continue;
            *saturated += 1 / (double)steps;
            break;
        }
        lg_plan_eval(plan[PERIOD], (const void *[]){x, u}, (void *[]){next}, work);
        memcpy(x, next, lg_plan_input_count(plan[PERIOD], 0) * sizeof *x);
        if (plan[POSITIONS] != NULL) {
            lg_plan_eval(plan[POSITIONS], (const void *[]){x}, (void *[]){seen}, work);
            lg_plan_eval(plan[VELOCITIES], (const void *[]){x}, (void *[]){seen + nq}, work);
        } else {
            memcpy(seen, x, nq * sizeof *x);
        }
    }
}

static void tell(const following *f, app_json *out, const sums *sum, double saturated) {
    app_result_line(out, "along the set points:");
    app_json_open(out, "reference", '{');
    for (uint32_t k = 0; k < f->tracked; k++) {
        const char *name = f->task->coordinate[f->place[k]].name;
        APP_FREE char *rms = app_format("%s_rms", name), *largest = app_format("%s_largest", name);
        app_result_real(out, rms, sqrt(sum[k].square), "of the distance from the set point");
        app_result_real(out, largest, sum[k].largest, NULL);
    }
    app_result_real(out, "saturated", saturated, "share of the periods with an input at a limit");
    app_json_close(out, '}');
}

void control_follow(const app *self, const lg_policy *policy, const char *path, app_json *out) {
    static const char *const names[FUNCTIONS] = {"track", "period", "momenta", "positions", "velocities"};
    following f = {.self = self, .policy = policy, .task = lg_policy_task_of(policy)};
    lg_plan *plan[FUNCTIONS] = {NULL};
    sums sum[LG_POLICY_COORDINATES] = {{0, 0}};
    double saturated = 0;
    size_t bytes = 0;
    f.inputs = f.task->input_count;
    lay_out(&f, path);
    for (int i = 0; i < FUNCTIONS && (i <= PERIOD || f.velocities > 0); i++) {
        plan[i] = control_plan(self, policy, names[i]);
        const size_t own = lg_plan_work_size(plan[i]);
        bytes = own > bytes ? own : bytes;
    }
    APP_FREE double *x = app_alloc(2 * lg_plan_input_count(plan[PERIOD], 0), sizeof *x);
    APP_FREE void *work = app_alloc(bytes, 1);
    run_along(&f, plan, x, work, sum, &saturated);
    tell(&f, out, sum, saturated);
    for (int i = 0; i < FUNCTIONS; i++) lg_plan_destroy(plan[i]);
    lg_table_data_destroy(&f.table);
}
