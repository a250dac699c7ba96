/* The runs of a study, its table, its report and its plot. */
#include "lg-hamiltonian/study.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "files/frame.h"
#include "files/read_file.h"

const char *const study_names[STUDY_COLUMNS] = {"integrator", "substeps", "N",      "M",      "eps",
                                                "penalty",    "repeat",   "seed",   "loss",   "E1",
                                                "E2",         "seconds",  "epochs", "status", "protocol"};

/* ---- the runs ---- */

/* The axes from the fastest varying to the slowest; repeats vary slower than all axes. */
static const int order[AXES] = {AXIS_INTEGRATOR, AXIS_SUBSTEPS, AXIS_PENALTY, AXIS_M, AXIS_N, AXIS_EPS};

size_t study_cells(const study_table *table) {
    size_t cells = 1;
    for (size_t i = 0; i < AXES; i++) cells *= table->count[i];
    return cells;
}

size_t study_runs(const study_table *table) {
    return study_cells(table) * table->repeats;
}

size_t study_at(const study_table *table, size_t run, int axis) {
    for (const int *at = order; *at != axis; at++) run /= table->count[*at];
    return run % table->count[axis];
}

double study_value(const study_table *table, size_t run, int axis) {
    return table->value[axis][study_at(table, run, axis)];
}

uint64_t study_seed(const study_table *table, size_t run, uint64_t kind) {
    enum { KINDS = 8 };
    lg_rng rng;
    lg_rng_seed(&rng, table->seed, (run / study_cells(table) + 1) * KINDS + kind);
    return lg_rng_next(&rng) >> 1;
}

void study_set_protocol(study_table *table, const char *text) {
    char hash[LG_SHA256_TEXT];
    lg_sha256 sha;
    lg_sha256_init(&sha);
    lg_sha256_add(&sha, text, strlen(text));
    lg_sha256_finish(&sha, hash);
    (void)snprintf(table->protocol, sizeof table->protocol, "%.*s", STUDY_PROTOCOL_TEXT - 1, hash);
}

/* ---- reading and writing the table ---- */

void study_table_add(study_table *table, size_t run) {
    const study_result *result = &table->results[run];
    lg_columns *text = &table->text;
    lg_columns_text(text, table->integrators[study_at(table, run, AXIS_INTEGRATOR)]->name);
    for (int axis = AXIS_INTEGRATOR + 1; axis < AXES; axis++)
        lg_columns_number(text, study_value(table, run, axis));
    lg_columns_whole(text, run / study_cells(table) + 1);
    lg_columns_whole(text, study_seed(table, run, 0));
    lg_columns_numbers(text, result->value, MEASURES);
    lg_columns_whole(text, result->epochs);
    lg_columns_text(text, result->failed ? "failed" : "ok");
    lg_columns_text(text, table->protocol);
    lg_columns_end(text);
    table->changed = table->done[run] = true;
    table->rows++;
}

/* `x`: the numbers of a row, from the second column on. */
static bool is_run(const study_table *table, size_t run, const char *integrator, const double *x) {
    bool same = (double)(run / study_cells(table) + 1) == x[STUDY_REPEAT - 1] &&
                strcmp(table->integrators[study_at(table, run, AXIS_INTEGRATOR)]->name, integrator) == 0;
    for (int axis = AXIS_INTEGRATOR + 1; axis < AXES; axis++)
        same = same && study_value(table, run, axis) == x[axis - 1];
    return same;
}

/* Takes a row, whose text stays as it is. A row without a run is of an earlier grid with other values. */
static lg_status take_row(study_table *table, const lg_frame *f, size_t row, lg_error *error) {
    const double *x = f->value + row * f->width;
    const lg_frame_text *cell = f->text + row * f->texts;
    const size_t runs = study_runs(table);
    size_t run = 0;
    for (size_t i = 0; i < STUDY_COLUMNS; i++) {
        if (*cell[i] == '\0' && (i < STUDY_MEASURES || i >= STUDY_EPOCHS))
            return lg_frame_fail(f, row, study_names[i], error, "is empty");
        *cell[i] == '\0' ? lg_columns_empty(&table->text) : lg_columns_text(&table->text, cell[i]);
    }
    lg_columns_end(&table->text);
    if (strcmp(cell[STUDY_PROTOCOL], table->protocol) != 0)
        return lg_frame_fail(f, row, "protocol", error,
                             "the row belongs to a study with other settings (%s, not %s)",
                             cell[STUDY_PROTOCOL], table->protocol);
    table->rows++;
    while (run < runs && !is_run(table, run, cell[AXIS_INTEGRATOR], x)) run++;
    if (run == runs || table->done[run]) return LG_OK;
    memcpy(table->results[run].value, x + STUDY_MEASURES - 1, sizeof table->results[run].value);
    table->results[run].failed = strcmp(cell[STUDY_STATUS], "ok") != 0;
    table->done[run] = true;
    return LG_OK;
}

static lg_status read_table(study_table *table, lg_frame *f, lg_error *error) {
    char first;
    size_t got;
    LG_TRY(lg_read_first(f->path, &first, 1, &got, error));
    if (got == 0) return LG_OK;
    LG_TRY(lg_frame_open(f, error));
    if (f->header > 1) return lg_frame_fail(f, 0, NULL, error, "comes after other lines: remove them");
    do {
        LG_TRY(lg_frame_next(f, SIZE_MAX, error));
        for (size_t row = 0; row < f->rows; row++) LG_TRY(take_row(table, f, row, error));
    } while (f->rows > 0);
    return LG_OK;
}

lg_status study_table_open(study_table *table, const char *path, lg_error *error) {
    const size_t runs = study_runs(table);
    lg_frame_want want[STUDY_COLUMNS + STUDY_STATUS - 1]; /* all as texts, then the numbers */
    lg_frame f = {
        .path = path, .what = "table of a study", .want = want, .wants = LG_COUNT(want), .ours = true};
    table->path = path;
    table->text = (lg_columns){.text = app_text(), .shortest = true};
    table->results = app_alloc(runs, sizeof *table->results);
    table->done = app_alloc(runs, sizeof *table->done);
    for (size_t i = 0; i < STUDY_COLUMNS; i++) {
        lg_columns_name(&table->text, study_names[i]);
        want[i] = (lg_frame_want){.name = study_names[i], .as = LG_FRAME_TEXT};
        if (i >= 1 && i < STUDY_STATUS)
            want[STUDY_COLUMNS + i - 1] = (lg_frame_want){.name = study_names[i], .as = LG_FRAME_NUMBER};
    }
    lg_columns_end(&table->text);
    const lg_status status = read_table(table, &f, error);
    lg_frame_close(&f);
    table->changed = table->rows == 0;
    return status == LG_NOT_FOUND ? LG_OK : status;
}

lg_status study_table_save(study_table *table, lg_error *error) {
    if (!table->changed) return LG_OK;
    table->changed = false;
    return lg_file_write(app_running()->context, table->path, table->text.text.data, table->text.text.length,
                         error);
}

void study_table_close(study_table *table) {
    lg_text_destroy(&table->text.text);
    free(table->results);
    free(table->done);
}

/* ---- summaries ---- */

static bool is_chosen(const study_table *table, size_t run, size_t cell, unsigned axes, study_noise noise) {
    const bool noisy = study_value(table, run, AXIS_EPS) > 0;
    bool same = table->done[run] && (noise == STUDY_ANY || noisy == (noise == STUDY_WITH));
    for (int axis = 0; axis < AXES; axis++)
        same = same && ((axes >> axis & 1) == 0 || study_at(table, run, axis) == study_at(table, cell, axis));
    return same;
}

study_summary study_summarise(const study_table *table, size_t cell, unsigned axes, study_noise noise) {
    const size_t runs = study_runs(table);
    study_summary s = {.runs = 0};
    APP_FREE size_t *list = app_alloc(runs, sizeof *list);
    APP_FREE double *values = app_alloc(runs, sizeof *values);
    size_t n = 0;
    for (size_t i = 0; i < runs; i++) {
        if (!is_chosen(table, i, cell, axes, noise)) continue;
        s.runs++;
        if (!table->results[i].failed) list[n++] = i;
    }
    s.failed = s.runs - n;
    for (size_t k = 0; k < MEASURES; k++) {
        double logarithm = 0;
        for (size_t i = 0; i < n; i++) {
            values[i] = table->results[list[i]].value[k];
            logarithm += log(values[i]);
        }
        s.geometric[k] = n > 0 ? exp(logarithm / (double)n) : NAN;
        s.median[k] = lg_median(values, n);
    }
    return s;
}

/* ---- the report ---- */

/* A combination is summarised over all repeats and over all noise levels that are zero, or all that are
 * not. */
enum { BEST = 5, INTEGRATORS = 1u << AXIS_INTEGRATOR | 1u << AXIS_SUBSTEPS };
#define COMBINATION (STUDY_CELL & ~(1u << AXIS_EPS))

typedef struct combination {
    double e1; /* first: it sorts the combinations */
    size_t cell;
    study_summary summary;
} combination;

/* Writes a table row: the values on the given axes, the figures, and the numbers of runs and failed runs. */
static void put_row(app_json *out, const study_table *table, size_t cell, unsigned axes,
                    const study_summary *s, const double *figures) {
    app_json_open(out, NULL, '{');
    app_json_text(out, study_names[0], table->integrators[study_at(table, cell, AXIS_INTEGRATOR)]->name);
    for (int axis = AXIS_INTEGRATOR + 1; axis < AXES; axis++)
        if ((axes >> axis & 1) != 0) app_json_real(out, study_names[axis], study_value(table, cell, axis));
    for (size_t k = 0; k < MEASURES; k++) app_json_real(out, study_names[STUDY_MEASURES + k], figures[k]);
    APP_PUT(out, LG_AS_WHOLE("runs", s->runs), LG_AS_WHOLE("failed", s->failed));
    app_json_close(out, '}');
}

/* Writes the best combinations in rising order of the geometric mean of E1. */
static void put_best(app_json *out, const char *name, const study_table *table, study_noise noise) {
    const size_t all = study_cells(table) / table->count[AXIS_EPS];
    APP_FREE combination *list = app_alloc(all, sizeof *list);
    size_t n = 0;
    for (size_t i = 0; i < all; i++) {
        const study_summary s = study_summarise(table, i, COMBINATION, noise);
        if (s.runs > s.failed) list[n++] = (combination){s.geometric[STUDY_E1], i, s};
    }
    qsort(list, n, sizeof *list, lg_compare_doubles);
    if (n > 0)
        app_result_line(out, "\nBest combinations %s noise (geometric means)",
                        noise == STUDY_WITH ? "with" : "without");
    app_result_rows(out, name);
    for (size_t i = 0; i < n && i < BEST; i++)
        put_row(out, table, list[i].cell, COMBINATION, &list[i].summary, list[i].summary.geometric);
    app_result_rows_end(out);
}

void study_report(const app *self, const study_table *table, size_t fresh, double seconds) {
    const size_t integrators = table->count[AXIS_INTEGRATOR], substeps = table->count[AXIS_SUBSTEPS];
    app_json *out = self->out;
    APP_PUT(out, LG_WHOLE("planned", study_runs(table), "runs of the grid"),
            LG_WHOLE("done", table->rows, "runs of the table"), LG_WHOLE("new", fresh, NULL),
            LG_AS_TEXT("protocol", table->protocol));
    app_result_line(out, "\nMedians over the repeats");
    app_result_rows(out, "medians");
    for (size_t i = 0; i < study_cells(table); i++) {
        const study_summary s = study_summarise(table, i, STUDY_CELL, STUDY_ANY);
        if (s.runs > 0) put_row(out, table, i, STUDY_CELL, &s, s.median);
    }
    app_result_rows_end(out);
    app_result_line(out, "\nGeometric means over all runs of an integrator");
    app_result_rows(out, "geometric_means");
    for (size_t i = 0; i < integrators * substeps; i++) {
        const size_t cell = i / substeps + i % substeps * integrators;
        const study_summary s = study_summarise(table, cell, INTEGRATORS, STUDY_ANY);
        put_row(out, table, cell, INTEGRATORS, &s, s.geometric);
    }
    app_result_rows_end(out);
    put_best(out, "best_without_noise", table, STUDY_WITHOUT);
    put_best(out, "best_with_noise", table, STUDY_WITH);
    APP_PUT(out, LG_AS_WHOLE("threads", self->threads), LG_AS_TEXT("out", table->path),
            LG_REAL("seconds", seconds, NULL));
}

/* ---- the plot ---- */

/* Writes a block of data: the cells with integrator number i and value number m of M. A curve connects cells
 * that have the same settings except for the number of substeps. */
static void put_block(app_plot *plot, const study_table *table, size_t i, size_t m) {
    for (size_t c = 0; c < study_cells(table); c++) {
        if (study_at(table, c, AXIS_INTEGRATOR) != i || study_at(table, c, AXIS_M) != m ||
            study_at(table, c, AXIS_SUBSTEPS) != 0)
            continue;
        app_plot_gap(plot);
        for (size_t j = 0; j < table->count[AXIS_SUBSTEPS]; j++) {
            const size_t cell = c + j * table->count[AXIS_INTEGRATOR];
            const study_summary s = study_summarise(table, cell, STUDY_CELL, STUDY_ANY);
            if (s.runs > s.failed)
                APP_PLOT_ROW(plot, 9, s.median[STUDY_SECONDS], s.median[STUDY_E1],
                             table->value[AXIS_SUBSTEPS][j]);
        }
    }
    app_plot_block(plot);
}

void study_put(app_plot *plot, const void *of) {
    const study_table *table = of;
    const size_t integrators = table->count[AXIS_INTEGRATOR], points = table->count[AXIS_M];
    app_plot_text(plot, "%d\t%zu\t%zu", table->count[AXIS_SUBSTEPS] > 1, integrators, points);
    for (size_t i = 0; i < integrators; i++) app_plot_text(plot, "%s", table->integrators[i]->name);
    for (size_t m = 0; m < points; m++) app_plot_text(plot, "M = %.17g", table->value[AXIS_M][m]);
    for (size_t i = 0; i < integrators; i++)
        for (size_t m = 0; m < points; m++) put_block(plot, table, i, m);
}
