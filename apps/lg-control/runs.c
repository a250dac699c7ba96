/* lg-control evaluate: a table of the states, inputs and costs of runs (--out); the motion of some runs, the
 * starts of all, the inputs of some (--plot). */
#include <math.h>
#include <string.h>

#include "files/csv.h"
#include "lg-control/control_app.h"

/* ---- quantities ---- */

/* A quantity that is told of positions and velocities. */
typedef struct control_quantity {
    char name[LG_POLICY_NAME + 16];
    lg_policy_motion motion;
    bool velocity;
    uint32_t first, count;  /* of the positions or velocities: index of the first number, how many */
    uint32_t error, errors; /* in z: of the whole position or velocity */
    double goal[9];
    double start[2]; /* range of the starts, from the goal */
} control_quantity;
/* The positions and velocities of a task. */
static size_t list_quantities(const lg_policy_task *task, control_quantity *out) {
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

static void find_states(const app *self, control_runs *runs) {
    static const char *const names[2] = {"positions", "velocities"};
    const size_t rows = (runs->runs.steps + 1) * runs->runs.count;
    control_quantity quantity[2 * LG_POLICY_COORDINATES];
    const size_t count = list_quantities(runs->task, quantity);
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
    const size_t count = list_quantities(task, quantity);
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

static void write_runs(const app *self, const control_runs *runs, const char *path) {
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
            for (size_t l = 0; l < m; l++) lg_columns_number(&to, moved ? r->input[row * m + l] : NAN);
            lg_columns_number(&to, moved ? r->costs[row] : NAN);
            lg_columns_end(&to);
        }
    APP_MUST_FILE(self, path, lg_columns_write(&to, self->context, path, &error));
}

enum { MOTIONS = 40, STARTS = 5000, INPUTS = 8, AXES = 2 * LG_POLICY_COORDINATES };

typedef struct drawing {
    const control_runs *from;
    const lg_policy_task *task;
    const lg_policy_runs *runs;
    /* Quantities of the state; then, with no numbers, the time and the inputs. */
    control_quantity axis[AXES + 1 + LG_POLICY_INPUTS];
    size_t axes; /* without the time and the inputs */
    app_plot plot;
} drawing;

/* ---- the plot: quantities as axes ---- */

static double length_of(const double *v, uint32_t count) {
    double length = 0;
    for (uint32_t k = 0; k < count; k++) length = hypot(length, v[k]);
    return length;
}

/* The angle whose cosine is the product of q and the goal; of rotations the product is 1 + 2 cos. */
static double angle_between(const control_quantity *q, const double *x) {
    double product = 0;
    for (uint32_t k = 0; k < q->count; k++) product += q->goal[k] * x[k];
    if (q->motion == LG_POLICY_ROTATION) product = 0.5 * (product - 1);
    return isfinite(product) ? acos(fmin(fmax(product, -1), 1)) : product;
}

static bool wraps(const control_quantity *q) {
    return q->motion == LG_POLICY_ANGLE && !q->velocity;
}

/* What an axis shows of step k of a run: a number, an angle within half a turn of the goal; of several
 * numbers the angle from the goal, or the speed. */
static double shown(const drawing *d, size_t axis, size_t k, size_t start) {
    const control_quantity *q = &d->axis[axis];
    const double *x =
        d->from->seen[q->velocity] + (k * d->runs->count + start) * d->from->numbers[q->velocity] + q->first;
    if (axis == d->axes) return (double)k * d->task->period;
    if (axis > d->axes)
        return d->runs->input[(k * d->runs->count + start) * d->task->input_count + axis - d->axes - 1];
    if (q->count > 1) return q->velocity ? length_of(x, q->count) : angle_between(q, x);
    return wraps(q) ? q->goal[0] + remainder(x[0] - q->goal[0], 6.283185307179586) : x[0];
}

/* The axis at the goal. */
static double goal_of(const control_quantity *q) {
    return q->count == 1 ? q->goal[0] : 0;
}

/* ---- choosing ---- */

/* Half the range of starts, in sizes of the set {V < c} of the regulator. */
static double reach_of(const control_quantity *q, const lg_policy_regulator *r) {
    double stiff = 0;
    for (uint32_t k = q->error; k < q->error + q->errors; k++) stiff = fmax(stiff, r->P[k * r->errors + k]);
    return fmax(fabs(q->start[0]), fabs(q->start[1])) * sqrt(stiff / r->c);
}

/* The two axes along which the starts reach farthest. The second of a single one is the time, 0. */
static void choose_map(const drawing *d, const lg_policy_regulator *r, size_t *chosen) {
    double most[2] = {-1, -1};
    chosen[0] = chosen[1] = d->axes;
    for (size_t i = 0; i < d->axes; i++) {
        if (d->axis[i].errors == 0) continue; /* free */
        const double reach = reach_of(&d->axis[i], r);
        if (reach > most[0]) {
            most[1] = most[0], chosen[1] = chosen[0];
            most[0] = reach, chosen[0] = i;
        } else if (reach > most[1]) {
            most[1] = reach, chosen[1] = i;
        }
    }
}

static bool turns(const lg_policy_coordinate *c) {
    return c->motion != LG_POLICY_LINE && !c->free;
}

/* The first coordinate that turns and is not free, else the first, and its velocity; without velocities
 * another coordinate, or the time. */
static void choose_phase(const drawing *d, size_t *chosen) {
    size_t velocity = d->task->coordinate_count;
    size_t first = 0;
    while (first + 1 < d->task->coordinate_count && !turns(&d->task->coordinate[first])) first++;
    if (!turns(&d->task->coordinate[first])) first = 0;
    for (size_t i = 0; i < first; i++) velocity += d->task->coordinate[i].velocity[0] != '\0';
    const size_t other = d->axes > 1 ? (first + 1) % d->axes : d->axes;
    chosen[0] = first;
    chosen[1] = d->task->coordinate[first].velocity[0] != '\0' ? velocity : other;
}

/* ---- panels ---- */

/* Writes a panel of the first runs, at most `most` of them: its texts, and a block for each end, with points
 * 0 to `last` of each run. `numbers` are the two numbers of the panel. A run turns around when it passes the
 * far side of an angle: there the curve is interrupted. */
static void put_panel(drawing *d, const char *what, size_t most, const size_t *axes, size_t last,
                      const double *numbers) {
    const control_quantity *x = &d->axis[axes[0]], *y = &d->axis[axes[1]];
    const bool input = axes[1] > d->axes;
    const size_t runs = most < d->runs->count ? most : d->runs->count;
    size_t drawn[2] = {0, 0};
    app_plot_text(&d->plot, "%s %zu runs%s%s\t%s\t%s", what, runs, input ? ": " : "", input ? y->name : "",
                  x->name, y->name);
    for (int succeeded = 0; succeeded < 2; succeeded++) {
        for (size_t i = 0; i < runs; i++) {
            if (d->runs->succeeded[i] != (succeeded == 1)) continue;
            double before = NAN;
            for (size_t k = 0; k <= last; k++) {
                const double at = shown(d, axes[0], k, i);
                if (wraps(x) && fabs(at - before) > 3.2) app_plot_gap(&d->plot);
                APP_PLOT_ROW(&d->plot, 7, at, shown(d, axes[1], k, i));
                before = at;
            }
            if (last > 0) app_plot_gap(&d->plot);
            drawn[succeeded]++;
        }
        app_plot_block(&d->plot);
    }
    app_plot_text(&d->plot, "%zu failed\t%zu succeeded\t%.9g\t%.9g", drawn[0], drawn[1], numbers[0],
                  numbers[1]);
}

static void draw_runs(const app *self, const control_runs *runs) {
    drawing d = {.from = runs, .task = runs->task, .runs = &runs->runs};
    size_t axes[2];
    d.axes = list_quantities(d.task, d.axis);
    d.axis[d.axes] = (control_quantity){.name = "t (s)"};
    if (!app_plot_begin(&d.plot, "policy_runs")) return;
    choose_phase(&d, axes);
    put_panel(&d, "Motion of the first", MOTIONS, axes, d.runs->steps,
              (const double[]){goal_of(&d.axis[axes[0]]), goal_of(&d.axis[axes[1]])});
    choose_map(&d, lg_policy_regulator_of(runs->policy), axes);
    put_panel(&d, "Starts of", STARTS, axes, 0, (const double[]){0, 0});
    for (uint32_t l = 0; l < d.task->input_count; l++) {
        const lg_policy_input *in = &d.task->input[l];
        axes[0] = d.axes, axes[1] = d.axes + 1 + l;
        d.axis[axes[1]] = (control_quantity){.count = 0};
        (void)snprintf(d.axis[axes[1]].name, sizeof d.axis[axes[1]].name, "%s", in->name);
        put_panel(&d, "Inputs of the first", INPUTS, axes, d.runs->steps - 1,
                  (const double[]){in->low, in->high});
    }
    app_plot_end(self, &d.plot);
}

void control_show_runs(const app *self, control_runs *runs, const char *path) {
    find_states(self, runs);
    if (path != NULL) write_runs(self, runs, path);
    draw_runs(self, runs);
}
