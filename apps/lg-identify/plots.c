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

/* Writes the texts of the columns, then for each coordinate a panel of its positions, of its attitude and of
 * its velocities. A plot that is not of an evaluation also has a panel of all inputs. */
static void put_columns(app_plot *plot, const identify_plot *of) {
    const lg_machine_file *file = of->file;
    const bool predicted = of->runs != NULL;
    uint32_t first = file->column_count, count = 0;
    app_plot_text(plot, "%s\t%u\t%d", of->title, file->column_count, predicted && of->runs->bands != NULL);
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
    if (of->given == NULL) put_group(plot, "inputs", "", first, count, false);
}

static void put_row(app_plot *plot, const identify_plot *of, size_t row, double *logged) {
    const lg_machine_file *file = of->file;
    const lg_machine_log *log = of->log;
    const identify_runs *runs = of->runs;
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

/* ---- learned terms ---- */

/* The mean and the range of the finite numbers of a column. */
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

typedef struct slices {
    const identify_plot *of;
    /* The state around which the slices are drawn: the means of lines and angles; for the rest the first
     * complete row. */
    double middle[LG_MACHINE_POSITIONS];
    /* (lacking_count, velocities): velocities, and friction with the force that the model lacks. */
    size_t lacking_count;
    double *lacking_v, *lacking;
} slices;

/* Writes the share of the log's rows in each bin, as a strip along the axis. x: one number per row. */
static void put_density(app_plot *plot, const double *x, size_t rows, size_t stride, double low, double high,
                        bool angle) {
    size_t bins[BINS] = {0}, most = 1;
    const double middle = 0.5 * (low + high);
    for (size_t i = 0; i < rows; i++) {
        const double value = angle ? lg_machine_wrap(x[i * stride] - middle) + middle : x[i * stride];
        if (!(value >= low && value <= high)) continue;
        const size_t bin = (size_t)fmin(BINS - 1, (value - low) / (high - low) * BINS);
        if (++bins[bin] > most) most = bins[bin];
    }
    for (int i = 0; i < BINS; i++)
        APP_PLOT_ROW(plot, 7, low + (high - low) * (i + 0.5) / BINS, (double)bins[i] / (double)most);
    app_plot_block(plot);
}

/* Draws the potential along a position, or the friction along a velocity, at rest around the middle state:
 * the density of the log's rows, the learned curve, and for friction what the log says. */
static void put_term(app_plot *plot, const slices *s, const char *name, size_t index, bool friction,
                     bool angle) {
    const lg_machine_log *log = s->of->log;
    const lg_learned_machine *model = &s->of->given->model;
    const size_t nq = model->machine->positions, nv = model->machine->velocities, n = friction ? nv : nq;
    const size_t points = friction ? s->lacking_count : 0;
    const bool predicted = model->start_rows > 0 && !model->machine->accelerations;
    const double *rows = (!friction ? log->q : predicted ? s->of->runs->v : log->v) + index;
    APP_FREE double *q = app_alloc(GRID * nq, sizeof *q);
    APP_FREE double *v = app_alloc(GRID * nv, sizeof *v);
    APP_FREE double *y = app_alloc(GRID * (nv + 1), sizeof *y);
    double *x = (friction ? v : q) + index, low, high;
    (void)column_mean(rows, log->rows, n, &low, &high);
    if (friction && !(low < high)) (void)column_mean(s->of->runs->v + index, log->rows, n, &low, &high);
    if (angle && high - low > 6.3) low = -3.141592653589793, high = 3.141592653589793;
    app_plot_text(plot, "%s\t%s\t%zu", friction ? "friction" : "potential", name, points);
    put_density(plot, rows, log->rows, n, low, high, angle);
    for (size_t i = 0; i < GRID; i++) {
        memcpy(q + i * nq, s->middle, nq * sizeof *q);
        x[i * n] = low + (high - low) * (double)i / (GRID - 1);
    }
    identify_values(app_running(), model, GRID, q, v, friction ? NULL : y, friction ? y : NULL);
    APP_PLOT_COLUMNS(plot, 7, GRID, {x, n, 1}, {friction ? y + index : y, friction ? nv : 1, 1});
    app_plot_block(plot);
    if (points > 0)
        APP_PLOT_COLUMNS(plot, 7, points, {s->lacking_v + index, nv, 1}, {s->lacking + index, nv, 1});
    app_plot_block(plot);
}

static void put_terms(app_plot *plot, const identify_plot *of) {
    const lg_machine *machine = of->given->model.machine;
    const lg_machine_log *log = of->log;
    const size_t nq = machine->positions;
    const bool damped = lg_machine_has_part(machine, LG_MACHINE_DAMPING);
    slices s = {.of = of};
    size_t row = 0;
    double low, high;
    while (row + 1 < log->rows && !lg_machine_log_complete(machine, log, row, true)) row++;
    memcpy(s.middle, log->q + row * nq, nq * sizeof *s.middle);
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        if (at.velocities == 1)
            s.middle[at.position] = column_mean(log->q + at.position, log->rows, nq, &low, &high);
    }
    if (damped) s.lacking_count = identify_lacking(app_running(), of->given, &s.lacking_v, &s.lacking);
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        for (uint32_t k = at.velocity; k < at.velocity + at.velocities; k++) {
            char name[LG_MACHINE_NAME + 12];
            lg_machine_velocity_name(machine, k, name, sizeof name);
            if (at.velocities == 1 && lg_machine_sees(machine, LG_MACHINE_POTENTIAL, at.index))
                put_term(plot, &s, name, at.position, false, at.angle);
            if (damped) put_term(plot, &s, name, k, true, false);
        }
    }
}

_Static_assert(sizeof(lg_horizon) % sizeof(double) == 0, "the numbers of horizons are columns");

/* The first parts are one data block; blank lines break the curves at gaps. Then the errors of the model, and
 * of the guess that nothing changes, against the horizon, and the learned terms. */
void identify_put(app_plot *plot, const void *drawn) {
    const identify_plot *of = drawn;
    const lg_horizon *h = of->horizons;
    const size_t each = sizeof *h / sizeof(double);
    size_t rows = 0;
    /* Holds the previous row, so that quaternions do not change their sign. */
    double logged[LG_LOG_COLUMNS] = {0};
    put_columns(plot, of);
    for (size_t p = 0; p < of->parts; p++) {
        for (size_t row = of->log->first[p]; row < of->log->first[p + 1] && rows < MOST_ROWS; row++, rows++)
            put_row(plot, of, row, logged);
        app_plot_gap(plot);
    }
    app_plot_block(plot);
    if (of->given == NULL) return;
    app_plot_text(plot, "errors\t%d", LG_RUN_ERRORS);
    for (int e = 0; e < LG_RUN_ERRORS; e++)
        app_plot_text(plot, "%s", isfinite(h->pooled[e]) ? lg_run_error_names[e] : "");
    APP_PLOT_COLUMNS(plot, 7, of->horizon_count, {&h->seconds, each, 1}, {h->pooled, each, LG_RUN_ERRORS},
                     {h->unchanged, each, LG_RUN_ERRORS});
    app_plot_block(plot);
    put_terms(plot, of);
}
