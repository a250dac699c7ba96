/* Pictures of logs, predictions and learned terms: panels in rows. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-identify/identify.h"

enum {
    IN_ROW = 3,
    WIDTH = 430,
    HEIGHT = 290,
    MOST_ROWS = 1000, /* Rows of a run that are drawn. */
    MOST_GROUPS = 3 * LG_MACHINE_COORDINATES + 1,
    GRID = 121,
    BINS = 60
};
/* ---- groups of columns that share a panel ---- */

typedef struct group {
    char title[LG_MACHINE_NAME + 24];
    uint32_t first, count; /* Columns of the machine file. */
} group;

static void add_group(group *groups, size_t *n, const char *what, const char *name, uint32_t first,
                      uint32_t count) {
    if (count == 0) return;
    (void)snprintf(groups[*n].title, sizeof groups[*n].title, "%s%s%s", name, *what != '\0' ? ": " : "",
                   what);
    groups[*n].first = first, groups[*n].count = count;
    ++*n;
}

/* Makes a group for the positions, the attitude and the velocities of each coordinate; then one group for all
 * inputs. */
static size_t find_groups(const lg_machine_file *file, bool inputs, group *groups) {
    size_t n = 0;
    uint32_t first = file->column_count, count = 0;
    for (uint32_t i = 0; i < file->machine.coordinate_count; i++) {
        const lg_log_coordinate *at = &file->coordinates[i];
        const char *name = file->machine.coordinates[i].name;
        add_group(groups, &n, "", name, at->place, at->places);
        add_group(groups, &n, at->attitudes == 3 ? "direction" : "attitude", name, at->attitude,
                  at->attitudes);
        add_group(groups, &n, "velocity", name, at->velocity, at->velocities);
    }
    for (uint32_t c = 0; c < file->column_count; c++)
        if (file->columns[c].role == LG_LOG_INPUT) {
            if (count == 0) first = c;
            count++;
        }
    if (inputs) add_group(groups, &n, "", "inputs", first, count);
    return n;
}

/* ---- data ---- */

static void put_row(FILE *stream, const lg_machine_file *file, const lg_machine_log *log, size_t row,
                    const double *q, const double *v, const double *bands, double *logged) {
    const size_t nq = file->machine.positions, nv = file->machine.velocities, m = file->machine.input_count;
    double predicted[LG_LOG_COLUMNS];
    identify_to_columns(file, log->q + row * nq, lg_log_shown(log) + row * nv, logged, logged);
    for (uint32_t c = 0; c < file->column_count; c++)
        if (file->columns[c].role == LG_LOG_INPUT) logged[c] = log->u[row * 4 * m + file->columns[c].index];
    for (uint32_t c = 0; c < file->column_count; c++) predicted[c] = (double)NAN;
    if (q != NULL) identify_to_columns(file, q + row * nq, v + row * nv, logged, predicted);
    (void)fprintf(stream, "%.9g", log->t[row]);
    for (uint32_t c = 0; c < file->column_count; c++) (void)fprintf(stream, " %.7g", logged[c]);
    for (uint32_t c = 0; c < file->column_count; c++) (void)fprintf(stream, " %.7g", predicted[c]);
    for (uint32_t c = 0; c < file->column_count && bands != NULL; c++)
        (void)fprintf(stream, " %.7g", bands[row * file->column_count + c]);
    (void)fputc('\n', stream);
}

/* Writes the first parts as one data block. Blank lines break the curves at gaps. */
static void put_run(FILE *stream, const lg_machine_file *file, const lg_machine_log *log, size_t parts,
                    const double *q, const double *v, const double *bands) {
    size_t rows = 0;
    /* Holds the previous row, so that quaternions do not change their sign. */
    double logged[LG_LOG_COLUMNS] = {0};
    for (size_t p = 0; p < parts; p++) {
        for (size_t row = log->first[p]; row < log->first[p + 1] && rows < MOST_ROWS; row++, rows++)
            put_row(stream, file, log, row, q, v, bands, logged);
        (void)fputc('\n', stream);
    }
    (void)fputc('\n', stream);
}

/* ---- panels of a run ---- */

/* Begins a picture of these groups, of the errors if there are any, and of `terms` learned terms. */
static void begin(app_plot *plot, const char *picture, const char *title, const lg_machine_file *file,
                  const group *groups, size_t count, bool predicted, bool bands, size_t errors,
                  size_t terms) {
    const size_t panels = count + (errors > 0) + terms, columns = panels < IN_ROW ? panels : (size_t)IN_ROW;
    const size_t rows = (panels + columns - 1) / columns;
    app_plot_begin(plot, "machine", picture, WIDTH * (int)columns, HEIGHT * (int)rows + 40);
    app_plot_text(plot, "%s", title);
    const size_t numbers[] = {rows, columns, file->column_count, count, bands, errors, terms};
    for (size_t i = 0; i < LG_COUNT(numbers); i++) app_plot_text(plot, "%zu", numbers[i]);
    for (uint32_t c = 0; c < file->column_count; c++) app_plot_text(plot, "%s", file->columns[c].name);
    for (uint32_t c = 0; c < file->column_count; c++) {
        const lg_log_column *at = &file->columns[c];
        app_plot_text(plot, "%d", at->role == LG_LOG_INPUT && file->inputs[at->index].hold == LG_HOLD_ZERO);
    }
    for (const group *g = groups; g < groups + count; g++) {
        app_plot_text(plot, "%s", g->title);
        app_plot_text(plot, "%u", g->first + 1);
        app_plot_text(plot, "%u", g->count);
        app_plot_text(plot, "%d", predicted && file->columns[g->first].role != LG_LOG_INPUT);
    }
}

void identify_draw_run(const app *self, const char *picture, const char *title, const lg_machine_file *file,
                       const lg_machine_log *log, size_t parts, const double *q, const double *v,
                       const double *bands) {
    app_plot plot;
    group groups[MOST_GROUPS];
    const size_t count = find_groups(file, true, groups);
    begin(&plot, picture, title, file, groups, count, q != NULL, bands != NULL, 0, 0);
    put_run(plot.data, file, log, parts, q, v, bands);
    APP_MUST_FILE(self, picture, app_plot_end(self, &plot, &error));
}

/* ---- panels of learned terms ---- */

/* A velocity of the machine. For lines and angles (scalar), also their position. */
typedef struct axis {
    char name[LG_MACHINE_NAME + 12];
    bool scalar, angle, seen; /* seen: the potential depends on the position. */
    uint32_t position, velocity;
    double low, high, slow, fast; /* Ranges of position (low, high) and velocity (slow, fast) in the log. */
} axis;

static size_t find_axes(const lg_machine *machine, axis *axes) {
    size_t n = 0;
    uint32_t position = 0;
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_machine_coordinate *c = &machine->coordinates[i];
        const uint32_t rates = lg_coordinate_row_of(c->kind)->velocities;
        for (uint32_t k = 0; k < rates; k++, n++) {
            axes[n] = (axis){.scalar = rates == 1,
                             .angle = c->kind == LG_COORDINATE_ANGLE,
                             .seen = rates == 1 && identify_sees(machine, LG_MACHINE_POTENTIAL, i),
                             .position = position,
                             .velocity = (uint32_t)n};
            if (rates == 1)
                (void)snprintf(axes[n].name, sizeof axes[n].name, "%s", c->name);
            else
                (void)snprintf(axes[n].name, sizeof axes[n].name, "%s.%u", c->name, k + 1);
        }
        position += lg_coordinate_positions(c->kind);
    }
    return n;
}

static bool has_part(const lg_machine *machine, lg_machine_part part) {
    for (uint32_t i = 0; i < machine->term_count; i++)
        if (machine->terms[i].part == part) return true;
    return false;
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
    const double *q, *v; /* Predicted states at the rows of the log. */
    double middle[LG_MACHINE_POSITIONS];
    app_plot plot;
    /* (lacking_count, velocities): velocities, and friction with the force that the model lacks. */
    size_t lacking_count;
    double *lacking_v, *lacking;
    double *at_q, *at_v, *y; /* (GRID, ...): states along an axis, and the values drawn over them. */
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

/* A panel: a learned function over one number from low to high, with the density of this number in the
 * log. */
typedef struct curve {
    const double *x, *y; /* x: one number per row of the log. y (GRID): learned values. */
    size_t x_stride, y_stride;
    double low, high;
    bool angle, level; /* level: drawn relative to its least value. */
    /* (point_count): logged points, drawn with the curve, every `y_stride` numbers. NULL: no points. */
    const double *point_x, *point_y;
    size_t point_count;
} curve;

/* Writes the share of the log's rows in each bin, as a strip along the axis. */
static void put_density(app_plot *plot, size_t rows, const curve *c) {
    size_t bins[BINS] = {0}, most = 1;
    const double middle = 0.5 * (c->low + c->high);
    for (size_t i = 0; i < rows; i++) {
        const double x = c->x[i * c->x_stride], value = c->angle ? lg_machine_wrap(x - middle) + middle : x;
        if (!(value >= c->low && value <= c->high)) continue;
        const size_t bin = (size_t)fmin(BINS - 1, (value - c->low) / (c->high - c->low) * BINS);
        if (++bins[bin] > most) most = bins[bin];
    }
    for (int i = 0; i < BINS; i++)
        (void)fprintf(plot->data, "%.7g %.7g\n", c->low + (c->high - c->low) * (i + 0.5) / BINS,
                      (double)bins[i] / (double)most);
    app_plot_block(plot);
}

static void put_curve(app_plot *plot, size_t rows, const curve *c) {
    double least = INFINITY;
    app_plot_text(plot, "%zu", c->point_count);
    put_density(plot, rows, c);
    for (size_t i = 0; i < GRID; i++) least = fmin(least, c->y[i * c->y_stride]);
    for (size_t i = 0; i < GRID; i++)
        (void)fprintf(plot->data, "%.7g %.7g\n", c->low + (c->high - c->low) * (double)i / (GRID - 1),
                      c->y[i * c->y_stride] - (c->level ? least : 0));
    app_plot_block(plot);
    if (c->point_count == 0) (void)fputs("nan nan\n", plot->data);
    for (size_t i = 0; i < c->point_count; i++)
        (void)fprintf(plot->data, "%.7g %.7g\n", c->point_x[i * c->y_stride], c->point_y[i * c->y_stride]);
    app_plot_block(plot);
}

/* Fills the slice: GRID states at rest around the middle state, in which number `index` of x (GRID, n) runs
 * from low to high. */
static void fill_slice(const drawing *d, double *x, size_t n, size_t index, double low, double high) {
    const lg_machine *machine = d->given->model.machine;
    memset(d->at_v, 0, GRID * machine->velocities * sizeof *d->at_v);
    for (size_t i = 0; i < GRID; i++) {
        memcpy(d->at_q + i * machine->positions, d->middle, machine->positions * sizeof *d->at_q);
        x[i * n + index] = low + (high - low) * (double)i / (GRID - 1);
    }
}

static void put_potential(const app *self, drawing *d, const axis *a) {
    const size_t nq = d->given->model.machine->positions;
    app_plot_text(&d->plot, "potential along %s, from its least", a->name);
    app_plot_text(&d->plot, "%s", a->name);
    fill_slice(d, d->at_q, nq, a->position, a->low, a->high);
    identify_values(self, &d->given->model, GRID, d->at_q, d->at_v, d->y, NULL);
    put_curve(&d->plot, d->log->rows,
              &(curve){d->log->q + a->position, d->y, nq, 1, a->low, a->high, a->angle, true, NULL, NULL, 0});
}

static void put_friction(const app *self, drawing *d, const axis *a) {
    const size_t nv = d->given->model.machine->velocities;
    const bool guessed = d->given->model.machine->accelerations, lacking = d->lacking_count > 0;
    const double *v = d->given->model.start_rows > 0 && !guessed ? d->v : d->log->v;
    app_plot_text(&d->plot, "friction force on %s", a->name);
    app_plot_text(&d->plot, "velocity of %s", a->name);
    fill_slice(d, d->at_v, nv, a->velocity, a->slow, a->fast);
    identify_values(self, &d->given->model, GRID, d->at_q, d->at_v, NULL, d->y);
    put_curve(&d->plot, d->log->rows,
              &(curve){v + a->velocity, d->y + a->velocity, nv, nv, a->slow, a->fast, false, false,
                       lacking ? d->lacking_v + a->velocity : NULL, lacking ? d->lacking + a->velocity : NULL,
                       d->lacking_count});
}

static void put_slices(const app *self, drawing *d, axis *axes, size_t count) {
    const lg_machine *machine = d->given->model.machine;
    APP_FREE double *q = d->at_q = app_alloc(GRID * machine->positions, sizeof *q);
    APP_FREE double *v = d->at_v = app_alloc(GRID * machine->velocities, sizeof *v);
    APP_FREE double *y = d->y = app_alloc(GRID * (machine->velocities + 1), sizeof *y);
    find_middle(d, axes, count);
    if (has_part(machine, LG_MACHINE_DAMPING))
        d->lacking_count = identify_lacking(self, d->given, &d->lacking_v, &d->lacking);
    for (size_t i = 0; i < count; i++) {
        if (axes[i].seen) put_potential(self, d, &axes[i]);
        if (has_part(machine, LG_MACHINE_DAMPING)) put_friction(self, d, &axes[i]);
    }
    free(d->lacking_v);
    free(d->lacking);
}

/* Writes the errors of the model, and of the guess that nothing changes, against the horizon. */
static void put_horizons(app_plot *plot, const lg_horizon *horizons, size_t count) {
    for (int e = 0; e < LG_RUN_ERRORS; e++)
        app_plot_text(plot, "%s", isfinite(horizons[0].pooled[e]) ? lg_run_error_names[e] : "");
    for (size_t i = 0; i < count; i++) {
        (void)fprintf(plot->data, "%.7g", horizons[i].seconds);
        for (int e = 0; e < LG_RUN_ERRORS; e++)
            (void)fprintf(plot->data, " %.7g %.7g", horizons[i].pooled[e], horizons[i].unchanged[e]);
        (void)fputc('\n', plot->data);
    }
    app_plot_block(plot);
}

void identify_draw_evaluation(const app *self, const char *picture, const identify_given *given,
                              const double *q, const double *v, const lg_horizon *horizons,
                              size_t horizon_count) {
    const lg_machine_file *file = &given->data.file;
    const lg_logs *logs = &given->data.logs;
    drawing d = {.given = given, .log = &logs->log, .q = q, .v = v};
    group groups[MOST_GROUPS];
    axis axes[LG_MACHINE_VELOCITIES];
    const lg_machine *machine = given->model.machine;
    const size_t count = find_groups(file, false, groups), lines = find_axes(machine, axes);
    size_t terms = has_part(machine, LG_MACHINE_DAMPING) ? lines : 0;
    for (size_t i = 0; i < lines; i++) terms += axes[i].seen;
    begin(&d.plot, picture,
          "First run of the log: logged (thick) and predicted from its start (thin); what was learned", file,
          groups, count, true, false, LG_RUN_ERRORS, terms);
    put_run(d.plot.data, file, d.log, identify_first_run(logs), q, v, NULL);
    put_horizons(&d.plot, horizons, horizon_count);
    put_slices(self, &d, axes, lines);
    APP_MUST_FILE(self, picture, app_plot_end(self, &d.plot, &error));
}
