/* lg-control evaluate --plot: the motion of some runs, the starts of all, the inputs of some. */
#include <math.h>
#include <stdlib.h>

#include "lg-control/control_app.h"

enum { IN_ROW = 3, WIDTH = 460, HEIGHT = 380, MOTIONS = 40, STARTS = 5000, INPUTS = 8 };

/* How a run ended: the blocks of data and the legends of each panel have this order. */
static const char *const ends[] = {"failed", "succeeded"};

typedef struct drawing {
    const control_runs *from;
    const lg_policy_task *task;
    const lg_policy_runs *runs;
    control_quantity axis[2 * LG_POLICY_COORDINATES + 1]; /* the last one, with no numbers: the time */
    size_t axes;                                          /* without the time */
    app_plot plot;
} drawing;

/* ---- quantities as axes ---- */

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
    const double *x = d->from->state + (k * d->runs->count + start) * d->from->numbers + q->first;
    if (q->count == 0) return (double)k * d->task->period;
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

static size_t least(size_t a, size_t b) {
    return a < b ? a : b;
}

/* Writes a panel of the first runs, at most `most` of them: its texts, and a block for each end. `put` writes
 * what there is of a run; `numbers` are the two numbers of the panel. */
static void put_panel(drawing *d, size_t most, const size_t *axes, const char *x, const char *y,
                      const double *numbers,
                      void (*put)(const drawing *d, size_t start, const size_t *axes)) {
    app_plot_text(&d->plot, "%s", x);
    app_plot_text(&d->plot, "%s", y);
    for (size_t e = 0; e < LG_COUNT(ends); e++) {
        size_t drawn = 0;
        for (size_t i = 0; i < d->runs->count && i < most; i++) {
            if (d->runs->succeeded[i] != (e == 1)) continue;
            put(d, i, axes);
            drawn++;
        }
        if (drawn == 0) (void)fputs("nan nan\n", d->plot.data);
        app_plot_block(&d->plot);
        app_plot_text(&d->plot, "%zu %s", drawn, ends[e]);
    }
    for (int k = 0; k < 2; k++) app_plot_text(&d->plot, "%.9g", numbers[k]);
}

/* A run turns around when it passes the far side of an angle: there the curve is interrupted. */
static void put_motion(const drawing *d, size_t start, const size_t *axes) {
    FILE *stream = d->plot.data;
    double before = NAN;
    for (size_t k = 0; k <= d->runs->steps; k++) {
        const double x = shown(d, axes[0], k, start);
        if (wraps(&d->axis[axes[0]]) && fabs(x - before) > 3.2) (void)fputc('\n', stream);
        (void)fprintf(stream, "%.7g %.7g\n", x, shown(d, axes[1], k, start));
        before = x;
    }
    (void)fputc('\n', stream);
}

static void draw_phase(drawing *d) {
    size_t axes[2];
    choose_phase(d, axes);
    const control_quantity *x = &d->axis[axes[0]], *y = &d->axis[axes[1]];
    const double goal[2] = {goal_of(x), goal_of(y)};
    app_plot_text(&d->plot, "Motion of the first %zu runs", least(MOTIONS, d->runs->count));
    put_panel(d, MOTIONS, axes, x->name, y->name, goal, put_motion);
}

static void put_start(const drawing *d, size_t start, const size_t *axes) {
    (void)fprintf(d->plot.data, "%.7g %.7g\n", shown(d, axes[0], 0, start), shown(d, axes[1], 0, start));
}

static void draw_starts(drawing *d, const lg_policy_regulator *r) {
    static const double none[2] = {0, 0};
    size_t axes[2];
    choose_map(d, r, axes);
    app_plot_text(&d->plot, "Starts of %zu runs", least(STARTS, d->runs->count));
    put_panel(d, STARTS, axes, d->axis[axes[0]].name, d->axis[axes[1]].name, none, put_start);
}

/* axes[0]: the input. */
static void put_input(const drawing *d, size_t start, const size_t *axes) {
    FILE *stream = d->plot.data;
    const size_t m = d->task->input_count;
    for (size_t k = 0; k < d->runs->steps; k++)
        (void)fprintf(stream, "%.7g %.7g\n", (double)k * d->task->period,
                      d->runs->input[(k * d->runs->count + start) * m + axes[0]]);
    (void)fputc('\n', stream);
}

static void draw_input(drawing *d, size_t input) {
    const lg_policy_input *in = &d->task->input[input];
    const double limits[2] = {in->low, in->high};
    app_plot_text(&d->plot, "Inputs of the first %zu runs: %s", least(INPUTS, d->runs->count), in->name);
    put_panel(d, INPUTS, &input, "t (s)", in->name, limits, put_input);
}

void control_draw_runs(const app *self, const control_runs *runs, const char *picture) {
    drawing d = {.from = runs, .task = runs->task, .runs = &runs->runs};
    d.axes = control_list_quantities(d.task, d.axis);
    d.axis[d.axes] = (control_quantity){.name = "t (s)"};
    const size_t panels = 2 + d.task->input_count, rows = (panels + IN_ROW - 1) / IN_ROW;
    app_plot_begin(&d.plot, "policy_runs", picture, WIDTH * IN_ROW, HEIGHT * (int)rows);
    app_plot_text(&d.plot, "%zu", rows);
    app_plot_text(&d.plot, "%zu", panels);
    draw_phase(&d);
    draw_starts(&d, lg_policy_regulator_of(runs->policy));
    for (size_t l = 0; l < d.task->input_count; l++) draw_input(&d, l);
    APP_MUST_FILE(self, picture, app_plot_end(self, &d.plot, &error));
}
