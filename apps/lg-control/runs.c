/* lg-control evaluate: a table of the states, inputs and costs of runs (--out); the motion of some runs, the
 * starts of all, the inputs of some (--plot). */
#include <math.h>
#include <string.h>

#include "control/policy.h"
#include "files/csv.h"
#include "lg-control/control_app.h"

/* ---- quantities ---- */

/* A position, a velocity or an input. */
typedef struct control_quantity {
    char name[LG_POLICY_NAME + 16];
    lg_policy_motion motion;
    enum { POSITION, VELOCITY, INPUT } of;
    uint32_t coordinate;
    uint32_t first, count;  /* index of the first number in control_runs.seen[of], how many; time: 0 */
    uint32_t error, errors; /* in z: of the whole position or velocity */
    double goal[9];
    double start[2]; /* range of the starts, from the goal */
} control_quantity;
enum { QUANTITIES = 2 * LG_POLICY_COORDINATES + LG_POLICY_INPUTS };

/* The positions and velocities of a policy, then its inputs. */
static size_t list_quantities(const lg_policy *policy, control_quantity *out) {
    const lg_policy_task *task = &policy->task;
    size_t n = 0;
    for (int velocity = 0; velocity < 2; velocity++)
        for (uint32_t i = 0; i < task->coordinate_count; i++) {
            const lg_policy_coordinate *c = &task->coordinate[i];
            const lg_policy_motion_row *row = lg_policy_row_of(c);
            const lg_policy_place *at = &policy->layout.at[i];
            if (velocity && c->velocity[0] == '\0') continue;
            control_quantity *q = &out[n++];
            *q = (control_quantity){
                .motion = c->motion, .of = velocity ? VELOCITY : POSITION, .coordinate = i};
            (void)snprintf(q->name, sizeof q->name, "%s", velocity ? c->velocity : c->name);
            q->first = velocity ? at->velocity : at->position;
            q->count = velocity ? row->velocity : row->position;
            q->error = velocity ? at->rate : at->error;
            q->errors = velocity ? row->rates : row->errors;
            if (!velocity) memcpy(q->goal, c->goal, sizeof q->goal);
            memcpy(q->start, velocity ? c->start_velocity : c->start, sizeof q->start);
        }
    for (uint32_t l = 0; l < task->input_count; l++) {
        out[n] = (control_quantity){.motion = LG_POLICY_LINE, .of = INPUT, .first = l, .count = 1};
        (void)snprintf(out[n].name, sizeof out[n].name, "%s", task->input[l].name);
        n++;
    }
    return n;
}

/* ---- runs ---- */

void control_runs_begin(const lg_policy *policy, uint64_t starts, bool whole, control_runs *out) {
    const size_t steps = lg_policy_steps(policy);
    *out = (control_runs){.policy = policy, .task = &policy->task};
    out->runs.path = app_keep((steps + 1) * starts * policy->layout.errors, sizeof(double));
    if (!whole) return;
    out->runs.motion = app_keep((steps + 1) * starts * policy->state, sizeof(double));
    out->runs.input = app_keep(steps * starts * policy->inputs, sizeof(double));
    out->runs.costs = app_keep(steps * starts, sizeof(double));
    out->runs.succeeded = app_keep(starts, sizeof(bool));
}

static void find_states(const app *self, control_runs *runs) {
    const lg_policy *policy = runs->policy;
    const size_t rows = (runs->runs.steps + 1) * runs->runs.count;
    const size_t numbers[] = {policy->layout.positions, policy->layout.velocities, policy->inputs};
    memcpy(runs->numbers, numbers, sizeof numbers);
    for (int k = 0; k < INPUT; k++) runs->seen[k] = app_keep(rows * numbers[k], sizeof(double));
    runs->seen[INPUT] = runs->runs.input;
    APP_MUST(self, lg_policy_see(policy, runs->runs.motion, rows, runs->seen[POSITION], runs->seen[VELOCITY],
                                 &error));
}

/* ---- the file ---- */

static void put_head(lg_columns *to, const lg_policy *policy) {
    control_quantity quantity[QUANTITIES];
    const size_t count = list_quantities(policy, quantity);
    lg_columns_names(to, "start,t");
    for (size_t i = 0; i < count; i++) {
        for (uint32_t k = 0; k < quantity[i].count; k++) {
            APP_FREE char *name = quantity[i].count > 1 ? app_format("%s.%u", quantity[i].name, k + 1)
                                                        : app_format("%s", quantity[i].name);
            lg_columns_name(to, name);
        }
    }
    lg_columns_names(to, "cost");
    lg_columns_end(to);
}

static void write_runs(const app *self, const control_runs *runs, const char *path) {
    const lg_policy_runs *r = &runs->runs;
    const size_t m = runs->task->input_count;
    lg_columns to = {.text = app_text()};
    put_head(&to, runs->policy);
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

/* ---- the plot: quantities as axes ---- */

enum { MOTIONS = 40, STARTS = 5000, INPUTS = 8 };

static bool wraps(const control_quantity *q) {
    return q->motion == LG_POLICY_ANGLE && q->of == POSITION;
}

/* What an axis shows of step k of a run: a number, an angle within half a turn of the goal; of several
 * numbers the speed, or the angle from the goal, whose cosine is the product of both; of rotations the
 * product is 1 + 2 cos. */
static double shown(const control_runs *from, const control_quantity *q, size_t k, size_t start) {
    const double *x = from->seen[q->of] + (k * from->runs.count + start) * from->numbers[q->of] + q->first;
    double product = 0;
    if (q->count == 0) return (double)k * from->task->period;
    if (q->count == 1) return wraps(q) ? q->goal[0] + remainder(x[0] - q->goal[0], 6.283185307179586) : x[0];
    for (uint32_t c = 0; c < q->count; c++) product += (q->of == VELOCITY ? x[c] : q->goal[c]) * x[c];
    if (q->of == VELOCITY) return sqrt(product);
    if (q->motion == LG_POLICY_ROTATION) product = 0.5 * (product - 1);
    return isfinite(product) ? acos(fmin(fmax(product, -1), 1)) : product;
}

/* The axis at the goal. */
static double goal_of(const control_quantity *q) {
    return q->count == 1 ? q->goal[0] : 0;
}

/* Chooses the two axes along which the starts reach farthest, in sizes of the regulator's set {V < c}. Free
 * positions are left out. */
static void choose_map(const control_quantity *axis, size_t axes, const lg_policy_regulator *r,
                       const control_quantity **chosen) {
    double most[2] = {-1, -1};
    for (const control_quantity *q = axis; q < axis + axes; q++) {
        double stiff = q->errors > 0 ? 0 : NAN;
        for (uint32_t k = q->error; k < q->error + q->errors; k++)
            stiff = fmax(stiff, r->P[k * r->errors + k]);
        const double reach = fmax(fabs(q->start[0]), fabs(q->start[1])) * sqrt(stiff / r->c);
        const int at = reach > most[0] ? 0 : 1;
        if (!(reach > most[1])) continue;
        if (at == 0) most[1] = most[0], chosen[1] = chosen[0];
        most[at] = reach, chosen[at] = q;
    }
}

/* The first coordinate that turns and is not free, else the first, and its velocity; without velocities
 * another coordinate. */
static void choose_phase(const control_quantity *axis, size_t axes, const control_quantity **chosen) {
    chosen[0] = axis;
    for (size_t i = axes; i-- > 0;)
        if (axis[i].of == POSITION && axis[i].motion != LG_POLICY_LINE && axis[i].errors > 0)
            chosen[0] = axis + i;
    if (axes > 1) chosen[1] = axis + (size_t)(chosen[0] - axis + 1) % axes;
    for (const control_quantity *q = axis; q < axis + axes; q++)
        if (q->of == VELOCITY && q->coordinate == chosen[0]->coordinate) chosen[1] = q;
}

/* Writes a panel of the first runs, at most `most` of them: its texts, and a block for each end, with points
 * 0 to `last` of each run. A run turns around when it passes the far side of an angle: there the curve is
 * interrupted. */
static void put_panel(app_plot *plot, const control_runs *from, const char *what, size_t most,
                      const control_quantity *x, const control_quantity *y, size_t last) {
    const lg_policy_input *input = y->of == INPUT ? &from->task->input[y->first] : NULL;
    const size_t runs = most < from->runs.count ? most : from->runs.count;
    size_t drawn[2] = {0, 0};
    app_plot_text(plot, "%s %zu runs%s%s\t%s\t%s", what, runs, input != NULL ? ": " : "",
                  input != NULL ? y->name : "", x->name, y->name);
    for (int succeeded = 0; succeeded < 2; succeeded++) {
        for (size_t i = 0; i < runs; i++) {
            if (from->runs.succeeded[i] != (succeeded == 1)) continue;
            double before = NAN;
            for (size_t k = 0; k <= last; k++) {
                const double at = shown(from, x, k, i);
                if (wraps(x) && fabs(at - before) > 3.2) app_plot_gap(plot);
                APP_PLOT_ROW(plot, 7, at, shown(from, y, k, i));
                before = at;
            }
            if (last > 0) app_plot_gap(plot);
            drawn[succeeded]++;
        }
        app_plot_block(plot);
    }
    app_plot_text(plot, "%zu failed\t%zu succeeded\t%.9g\t%.9g", drawn[0], drawn[1],
                  input != NULL ? input->low : goal_of(x), input != NULL ? input->high : goal_of(y));
}

void control_put_runs(app_plot *plot, const void *shown_runs) {
    const control_runs *runs = shown_runs;
    static const control_quantity time = {.name = "t (s)"};
    control_quantity axis[QUANTITIES];
    const size_t inputs = runs->task->input_count, axes = list_quantities(runs->policy, axis) - inputs;
    const control_quantity *chosen[2] = {&time, &time};
    choose_phase(axis, axes, chosen);
    put_panel(plot, runs, "Motion of the first", MOTIONS, chosen[0], chosen[1], runs->runs.steps);
    chosen[0] = chosen[1] = &time;
    choose_map(axis, axes, lg_policy_regulator_of(runs->policy), chosen);
    put_panel(plot, runs, "Starts of", STARTS, chosen[0], chosen[1], 0);
    for (size_t l = 0; l < inputs; l++)
        put_panel(plot, runs, "Inputs of the first", INPUTS, &time, &axis[axes + l], runs->runs.steps - 1);
}

void control_show_runs(const app *self, control_runs *runs, const char *path) {
    find_states(self, runs);
    if (path != NULL) write_runs(self, runs, path);
    app_plot_draw(self, 0, runs);
}
