/* Plots of logs, predictions and learned terms: panels in rows. */
#include <math.h>
#include <string.h>

#include "lg-identify/identify.h"

enum { MOST_ROWS = 1000 /* rows of a run that are drawn */, GRID = 121, BINS = 60 };

/* ---- a run ---- */

/* A panel of a coordinate's columns or of inputs: its title, first column, number of columns, and whether
 * there is a prediction. */
static void put_group(app_plot *plot, const char *name, const char *what, uint32_t first, uint32_t count,
                      bool predicted) {
    if (count > 0)
        app_plot_text(plot, "columns\t%s%s%s\t%u\t%u\t%d", name, *what != '\0' ? ": " : "", what, first + 1,
                      count, predicted);
}

/* Begins a plot, with panels for the positions, the attitude and the velocities of each coordinate, then
 * one for all inputs. False: there is no --plot. */
static bool begin(app_plot *plot, const char *title, const lg_machine_file *file, bool inputs, bool predicted,
                  bool bands) {
    uint32_t first = file->column_count, count = 0;
    if (!app_plot_begin(plot, "machine")) return false;
    app_plot_text(plot, "%s\t%u\t%d", title, file->column_count, bands);
    for (uint32_t c = 0; c < file->column_count; c++) {
        const lg_log_column *at = &file->columns[c];
        const bool input = at->role == LG_LOG_INPUT;
        app_plot_text(plot, "%s\t%d", at->name, input && file->inputs[at->index].hold == LG_HOLD_ZERO);
        if (input && count++ == 0) first = c;
    }
    for (uint32_t i = 0; i < file->machine.coordinate_count; i++) {
        const lg_log_coordinate *at = &file->coordinates[i];
        const char *name = file->machine.coordinates[i].name;
        put_group(plot, name, "", at->place, at->places, predicted);
        put_group(plot, name, at->attitudes == 3 ? "direction" : "attitude", at->attitude, at->attitudes,
                  predicted);
        put_group(plot, name, "velocity", at->velocity, at->velocities, predicted);
    }
    if (inputs) put_group(plot, "inputs", "", first, count, false);
    return true;
}

static void put_row(app_plot *plot, const lg_machine_file *file, const lg_machine_log *log, size_t row,
                    const identify_runs *runs, double *logged) {
    const size_t nq = file->machine.positions, nv = file->machine.velocities, m = file->machine.input_count;
    const size_t n = file->column_count;
    double predicted[LG_LOG_COLUMNS];
    identify_to_columns(file, log->q + row * nq, lg_log_shown(log) + row * nv, logged, logged);
    for (uint32_t c = 0; c < n; c++) {
        if (file->columns[c].role == LG_LOG_INPUT) logged[c] = log->u[row * 4 * m + file->columns[c].index];
        predicted[c] = NAN;
    }
    if (runs != NULL) identify_to_columns(file, runs->q + row * nq, runs->v + row * nv, logged, predicted);
    const double *bands = runs != NULL && runs->bands != NULL ? runs->bands + row * n : NULL;
    const app_plot_column columns[] = {
        {log->t + row, 0, 1}, {logged, 0, n}, {predicted, 0, n}, {bands, 0, n}};
    app_plot_columns(plot, 9, 1, columns, bands != NULL ? 4 : 3);
}

/* Writes the first parts as one data block. Blank lines break the curves at gaps. */
static void put_run(app_plot *plot, const lg_machine_file *file, const lg_machine_log *log, size_t parts,
                    const identify_runs *runs) {
    size_t rows = 0;
    /* Holds the previous row, so that quaternions do not change their sign. */
    double logged[LG_LOG_COLUMNS] = {0};
    for (size_t p = 0; p < parts; p++) {
        for (size_t row = log->first[p]; row < log->first[p + 1] && rows < MOST_ROWS; row++, rows++)
            put_row(plot, file, log, row, runs, logged);
        app_plot_gap(plot);
    }
    app_plot_block(plot);
}

void identify_draw_run(const app *self, const char *title, const lg_machine_file *file,
                       const lg_machine_log *log, size_t parts, const identify_runs *runs) {
    app_plot plot;
    if (!begin(&plot, title, file, true, runs != NULL, runs != NULL && runs->bands != NULL)) return;
    put_run(&plot, file, log, parts, runs);
    app_plot_end(self, &plot);
}

/* ---- learned terms ---- */

/* A velocity of the machine. For lines and angles (scalar), also their position. */
typedef struct axis {
    char name[LG_MACHINE_NAME + 12];
    bool scalar, angle, seen; /* seen: the potential depends on the position. */
    uint32_t position, velocity;
    double low, high, slow, fast; /* Ranges of position (low, high) and velocity (slow, fast) in the log. */
} axis;

static size_t find_axes(const lg_machine *machine, axis *axes) {
    size_t n = 0;
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_machine_coordinate *c = &machine->coordinates[i];
        const uint32_t rates = lg_coordinate_row_of(c->kind)->velocities;
        for (uint32_t k = 0; k < rates; k++, n++) {
            axes[n] = (axis){.scalar = rates == 1,
                             .angle = c->kind == LG_COORDINATE_ANGLE,
                             .seen = rates == 1 && lg_machine_sees(machine, LG_MACHINE_POTENTIAL, i),
                             .position = lg_machine_offsets_of(machine, i).position,
                             .velocity = (uint32_t)n};
            lg_machine_velocity_name(machine, (uint32_t)n, axes[n].name, sizeof axes[n].name);
        }
    }
    return n;
}

static double column_mean(const double *x, size_t rows, size_t stride, double *low, double *high) {
    double sum = 0;
    size_t count = 0;
    *low = INFINITY, *high = -INFINITY;
    for (size_t i = 0; i < rows; i++) {
        const double value = x[i * stride];
        if (!isfinite(value)) continue;
        sum += value, count++;
        *low = fmin(*low, value), *high = fmax(*high, value);
    }
    return count > 0 ? sum / (double)count : 0;
}

typedef struct drawing {
    const identify_given *given;
    const lg_machine_log *log;
    const double *v; /* Predicted velocities at the rows of the log. */
    double middle[LG_MACHINE_POSITIONS];
    app_plot plot;
    /* (lacking_count, velocities): velocities, and friction with the force that the model lacks. */
    size_t lacking_count;
    double *lacking_v, *lacking;
} drawing;

/* Chooses the state around which the slices are drawn: the means of lines and angles; for the rest the first
 * complete row. Also sets the ranges of the axes. */
static void find_middle(drawing *d, axis *axes, size_t count) {
    const lg_machine *machine = d->given->model.machine;
    const lg_machine_log *log = d->log;
    const size_t nq = machine->positions, nv = machine->velocities;
    size_t row = 0;
    while (row + 1 < log->rows && !lg_machine_log_complete(machine, log, row, true)) row++;
    memcpy(d->middle, log->q + row * nq, nq * sizeof *d->middle);
    for (size_t i = 0; i < count; i++) {
        axis *a = &axes[i];
        if (a->scalar)
            d->middle[a->position] = column_mean(log->q + a->position, log->rows, nq, &a->low, &a->high);
        (void)column_mean(log->v + a->velocity, log->rows, nv, &a->slow, &a->fast);
        if (!(a->slow < a->fast)) (void)column_mean(d->v + a->velocity, log->rows, nv, &a->slow, &a->fast);
        if (a->angle && a->high - a->low > 6.3) a->low = -3.141592653589793, a->high = 3.141592653589793;
    }
}

/* Writes the share of the log's rows in each bin, as a strip along the axis. x: one number per row. */
static void put_density(drawing *d, const double *x, size_t stride, double low, double high, bool angle) {
    size_t bins[BINS] = {0}, most = 1;
    const double middle = 0.5 * (low + high);
    for (size_t i = 0; i < d->log->rows; i++) {
        const double value = angle ? lg_machine_wrap(x[i * stride] - middle) + middle : x[i * stride];
        if (!(value >= low && value <= high)) continue;
        const size_t bin = (size_t)fmin(BINS - 1, (value - low) / (high - low) * BINS);
        if (++bins[bin] > most) most = bins[bin];
    }
    for (int i = 0; i < BINS; i++)
        APP_PLOT_ROW(&d->plot, 7, low + (high - low) * (i + 0.5) / BINS, (double)bins[i] / (double)most);
    app_plot_block(&d->plot);
}

/* Draws the potential along an axis, or the friction along its velocity, at rest around the middle state: the
 * density of the log's rows, the learned curve, and for friction what the log says. */
static void put_term(const app *self, drawing *d, const axis *a, bool friction) {
    const lg_machine *machine = d->given->model.machine;
    const size_t nq = machine->positions, nv = machine->velocities, n = friction ? nv : nq;
    const size_t index = friction ? a->velocity : a->position;
    const size_t points = friction ? d->lacking_count : 0;
    const bool predicted = d->given->model.start_rows > 0 && !machine->accelerations;
    const double low = friction ? a->slow : a->low, high = friction ? a->fast : a->high;
    const double *rows = !friction ? d->log->q : predicted ? d->v : d->log->v;
    APP_FREE double *q = app_alloc(GRID * nq, sizeof *q);
    APP_FREE double *v = app_alloc(GRID * nv, sizeof *v);
    APP_FREE double *y = app_alloc(GRID * (nv + 1), sizeof *y);
    double *x = (friction ? v : q) + index;
    app_plot_text(&d->plot, "%s\t%s\t%zu", friction ? "friction" : "potential", a->name, points);
    put_density(d, rows + index, n, low, high, a->angle && !friction);
    for (size_t i = 0; i < GRID; i++) {
        memcpy(q + i * nq, d->middle, nq * sizeof *q);
        x[i * n] = low + (high - low) * (double)i / (GRID - 1);
    }
    identify_values(self, &d->given->model, GRID, q, v, friction ? NULL : y, friction ? y : NULL);
    APP_PLOT_COLUMNS(&d->plot, 7, GRID, {x, n, 1}, {friction ? y + index : y, friction ? nv : 1, 1});
    app_plot_block(&d->plot);
    APP_PLOT_COLUMNS(&d->plot, 7, points, {d->lacking_v + index, nv, 1}, {d->lacking + index, nv, 1});
    app_plot_block(&d->plot);
}

static void put_terms(const app *self, drawing *d) {
    const lg_machine *machine = d->given->model.machine;
    const bool damped = lg_machine_has_part(machine, LG_MACHINE_DAMPING);
    axis axes[LG_MACHINE_VELOCITIES];
    const size_t count = find_axes(machine, axes);
    find_middle(d, axes, count);
    if (damped) d->lacking_count = identify_lacking(self, d->given, &d->lacking_v, &d->lacking);
    for (size_t i = 0; i < count; i++) {
        if (axes[i].seen) put_term(self, d, &axes[i], false);
        if (damped) put_term(self, d, &axes[i], true);
    }
}

/* Writes the errors of the model, and of the guess that nothing changes, against the horizon. */
static void put_horizons(app_plot *plot, const lg_horizon *horizons, size_t count) {
    app_plot_text(plot, "errors\t%d", LG_RUN_ERRORS);
    for (int e = 0; e < LG_RUN_ERRORS; e++)
        app_plot_text(plot, "%s", isfinite(horizons[0].pooled[e]) ? lg_run_error_names[e] : "");
    for (size_t i = 0; i < count; i++) {
        double line[1 + 2 * LG_RUN_ERRORS] = {horizons[i].seconds};
        for (int e = 0; e < LG_RUN_ERRORS; e++) {
            line[1 + 2 * e] = horizons[i].pooled[e];
            line[2 + 2 * e] = horizons[i].unchanged[e];
        }
        app_plot_numbers(plot, 7, line, LG_COUNT(line));
    }
    app_plot_block(plot);
}

void identify_draw_evaluation(const app *self, const identify_given *given, const identify_runs *runs,
                              const lg_horizon *horizons, size_t horizon_count) {
    const lg_logs *logs = &given->data.logs;
    drawing d = {.given = given, .log = &logs->log, .v = runs->v};
    (void)begin(&d.plot,
                "First run of the log: logged (thick) and predicted from its start (thin); what was learned",
                &given->data.file, false, true, false);
    put_run(&d.plot, &given->data.file, d.log, identify_first_run(logs), runs);
    put_horizons(&d.plot, horizons, horizon_count);
    put_terms(self, &d);
    app_plot_end(self, &d.plot);
}
