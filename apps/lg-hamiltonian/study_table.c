/* The plan and the table of a study. */
#include "lg-hamiltonian/study.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "files/csv.h"

const char *const study_axis_names[AXES] = {"integrator", "substeps", "N", "M", "eps", "penalty"},
                  *const study_measure_names[MEASURES] = {"loss", "E1", "E2", "seconds"};
const uint32_t study_cell_axes[AXES] = {AXIS_INTEGRATOR, AXIS_SUBSTEPS, AXIS_N,
                                        AXIS_M,          AXIS_EPS,      AXIS_PENALTY};

/* ---- the plan ---- */

/* The axes from the fastest varying to the slowest; repeats vary slower than all axes. */
static const uint32_t order[AXES] = {AXIS_INTEGRATOR, AXIS_SUBSTEPS, AXIS_PENALTY, AXIS_M, AXIS_N, AXIS_EPS};

/* Writes nothing if the number is not finite. */
static void number_text(double value, char text[STUDY_TEXT]) {
    char digits[LG_SHORTEST] = "";
    if (isfinite(value)) lg_format_shortest(digits, value, false);
    (void)snprintf(text, STUDY_TEXT, "%.31s", digits);
}

void study_axis_add(study_axis *axis, const char *name, double number) {
    if (axis->count == LG_GRID_VALUES) abort(); /* a grid has at most so many values per axis */
    char *text = axis->text[axis->count];
    axis->number[axis->count++] = name != NULL ? (double)NAN : number;
    if (name != NULL)
        (void)snprintf(text, STUDY_TEXT, "%s", name);
    else
        number_text(number, text);
}

size_t study_cells(const study_plan *plan) {
    size_t cells = 1;
    for (uint32_t i = 0; i < AXES; i++) cells *= plan->axes[i].count;
    return cells;
}

size_t study_runs(const study_plan *plan) {
    return study_cells(plan) * plan->repeats;
}

uint64_t study_seed(uint64_t seed, uint64_t repeat, uint64_t kind) {
    enum { KINDS = 8 };
    lg_rng rng;
    lg_rng_seed(&rng, seed, repeat * KINDS + kind);
    return lg_rng_next(&rng) >> 1;
}

study_row study_run_at(const study_plan *plan, size_t index) {
    study_row row = {.failed = false};
    for (uint32_t i = 0; i < AXES; i++) {
        row.at[order[i]] = (uint32_t)(index % plan->axes[order[i]].count);
        index /= plan->axes[order[i]].count;
    }
    row.repeat = (uint32_t)index + 1;
    row.seed = study_seed(plan->seed, row.repeat, 0);
    return row;
}

/* The number of the row's run; study_runs(plan) or more if the plan does not have it. */
static size_t run_of(const study_plan *plan, const study_row *row) {
    size_t index = row->repeat - 1;
    bool has = row->repeat > 0;
    for (uint32_t i = AXES; i-- > 0;) {
        has = has && row->at[order[i]] < plan->axes[order[i]].count;
        index = index * plan->axes[order[i]].count + row->at[order[i]];
    }
    return has ? index : SIZE_MAX;
}

void study_set_protocol(study_plan *plan, const char *text) {
    char hash[LG_SHA256_TEXT];
    lg_sha256 sha;
    lg_sha256_init(&sha);
    lg_sha256_add(&sha, text, strlen(text));
    lg_sha256_finish(&sha, hash);
    (void)snprintf(plan->protocol, sizeof plan->protocol, "%.*s", STUDY_PROTOCOL_TEXT - 1, hash);
}

/* ---- reading the table ---- */

/* Sets *at to the value's index on its axis. A name or number that is not on the axis may be from an earlier
 * grid; it gets the index axis->count. False: the text is empty or not a number. */
static bool parse_value(const study_axis *axis, const char *text, uint32_t *at) {
    double number = (double)NAN;
    const bool named = isnan(axis->number[0]);
    if (text[0] == '\0' || (!named && lg_number_parse(text, &number) != LG_OK)) return false;
    for (*at = 0; *at < axis->count; ++*at)
        if (named ? strcmp(axis->text[*at], text) == 0 : axis->number[*at] == number) break;
    return true;
}

/* The columns: the axes, repeat, seed, the measures, epochs, status, protocol. */
enum { COLUMNS = AXES + MEASURES + 5 };

static bool parse_row(const study_plan *plan, char *line, const char **protocol, study_row *row) {
    char *field[COLUMNS], **next = field, *at = line;
    uint64_t repeat = 0;
    size_t n = 0;
    for (; n < COLUMNS && at != NULL; n++) {
        field[n] = at;
        at = strchr(at, ',');
        if (at != NULL) *at++ = '\0';
    }
    bool good = n == COLUMNS && at == NULL;
    for (uint32_t i = 0; i < AXES && good; i++) good = parse_value(&plan->axes[i], *next++, &row->at[i]);
    good = good && lg_integer_parse(*next++, &repeat) == LG_OK && repeat <= UINT32_MAX &&
           lg_integer_parse(*next++, &row->seed) == LG_OK;
    row->repeat = (uint32_t)repeat;
    for (uint32_t i = 0; i < MEASURES && good; i++, next++) {
        row->result[i] = (double)NAN; /* an empty field */
        good = **next == '\0' || lg_number_parse(*next, &row->result[i]) == LG_OK;
    }
    if (!good || lg_integer_parse(next[0], &row->epochs) != LG_OK) return false;
    row->failed = strcmp(next[1], "ok") != 0;
    *protocol = next[2];
    return true;
}

static lg_status parse_line(study_table *table, const lg_csv *csv, lg_error *error) {
    const char *path = table->text.path, *protocol;
    study_row row;
    (void)fprintf(table->text.stream, "%s\n", csv->line);
    if (!parse_row(table->plan, csv->line, &protocol, &row))
        return lg_fail(error, LG_FORMAT, "%s: line %zu: not a row of a study", path, csv->number);
    if (strcmp(protocol, table->plan->protocol) != 0)
        return lg_fail(error, LG_FORMAT,
                       "%s: line %zu: the row belongs to a study with other settings (protocol %s, not %s)",
                       path, csv->number, protocol, table->plan->protocol);
    const size_t run = run_of(table->plan, &row);
    table->count++;
    if (run >= study_runs(table->plan) || table->done[run]) return LG_OK;
    table->rows[run] = row;
    table->done[run] = true;
    return LG_OK;
}

static lg_status read_table(study_table *table, lg_csv *csv, lg_error *error) {
    bool more = true;
    (void)fflush(table->text.stream);
    APP_FREE char *header = app_format("%.*s", (int)table->text.length - 1, table->text.text);
    LG_TRY(lg_csv_next(csv, &more, error));
    if (more && strcmp(csv->line, header) != 0)
        return lg_fail(error, LG_FORMAT,
                       "%s: line 1: this is not the table of a study; first line expected: %s",
                       table->text.path, header);
    for (;;) {
        LG_TRY(lg_csv_next(csv, &more, error));
        if (!more || !csv->closed) return LG_OK;
        LG_TRY(parse_line(table, csv, error));
    }
}

lg_status study_table_open(const char *path, const study_plan *plan, study_table *out, lg_error *error) {
    lg_csv csv;
    *out = (study_table){.plan = plan,
                         .rows = app_alloc(study_runs(plan), sizeof *out->rows),
                         .done = app_alloc(study_runs(plan), sizeof *out->done)};
    app_file_begin(&out->text, path);
    for (uint32_t i = 0; i < AXES; i++) (void)fprintf(out->text.stream, "%s,", study_axis_names[i]);
    (void)fputs("repeat,seed", out->text.stream);
    for (uint32_t i = 0; i < MEASURES; i++) (void)fprintf(out->text.stream, ",%s", study_measure_names[i]);
    (void)fputs(",epochs,status,protocol\n", out->text.stream);
    lg_status status = lg_csv_open(NULL, path, "table of a study", &csv, error);
    if (status == LG_OK) status = read_table(out, &csv, error);
    lg_csv_close(&csv);
    out->changed = out->count == 0;
    if (status == LG_NOT_FOUND) return LG_OK;
    if (status != LG_OK) study_table_close(out);
    return status;
}

/* ---- writing the table ---- */

void study_table_add(study_table *table, size_t run) {
    const study_row *row = &table->rows[run];
    FILE *stream = table->text.stream;
    char number[STUDY_TEXT];
    for (uint32_t i = 0; i < AXES; i++) (void)fprintf(stream, "%s,", table->plan->axes[i].text[row->at[i]]);
    (void)fprintf(stream, "%u,%llu", row->repeat, (unsigned long long)row->seed);
    for (uint32_t i = 0; i < MEASURES; i++) {
        number_text(row->result[i], number);
        (void)fprintf(stream, ",%s", number);
    }
    (void)fprintf(stream, ",%llu,%s,%s\n", (unsigned long long)row->epochs, row->failed ? "failed" : "ok",
                  table->plan->protocol);
    table->changed = table->done[run] = true;
    table->count++;
}

lg_status study_table_save(study_table *table, lg_error *error) {
    const app_file *text = &table->text;
    if (!table->changed) return LG_OK;
    if (fflush(text->stream) != 0) return lg_fail(error, LG_OUT_OF_MEMORY, "out of memory");
    table->changed = false;
    return lg_file_write(app_running()->context, text->path, text->text, text->length, error);
}

void study_table_close(study_table *table) {
    if (table->text.stream != NULL) app_file_discard(&table->text);
    free(table->rows);
    free(table->done);
    *table = (study_table){.plan = NULL};
}

/* ---- summaries ---- */

typedef struct study_choice {
    const study_row *key;
    const uint32_t *axes;
    size_t count;
    study_noise noise;
} study_choice;

static bool is_chosen(const study_table *table, size_t run, const study_choice *of) {
    const study_row *row = &table->rows[run];
    const bool noisy = table->plan->axes[AXIS_EPS].number[row->at[AXIS_EPS]] > 0;
    bool same = table->done[run] && (of->noise == STUDY_ANY || noisy == (of->noise == STUDY_WITH));
    for (size_t a = 0; a < of->count; a++) same = same && row->at[of->axes[a]] == of->key->at[of->axes[a]];
    return same;
}

study_summary study_summarise(const study_table *table, const study_row *key, const uint32_t *axes,
                              size_t count, study_noise noise) {
    const study_choice of = {key, axes, count, noise};
    const size_t runs = study_runs(table->plan);
    study_summary s = {.runs = 0};
    for (size_t i = 0; i < runs; i++) s.runs += is_chosen(table, i, &of);
    APP_FREE double *values = app_alloc(s.runs, sizeof *values);
    for (size_t k = 0; k < MEASURES; k++) {
        double logarithm = 0;
        size_t n = 0;
        for (size_t i = 0; i < runs && n < s.runs; i++)
            if (is_chosen(table, i, &of) && !table->rows[i].failed) values[n++] = table->rows[i].result[k];
        for (size_t i = 0; i < n; i++) logarithm += log(values[i]);
        s.failed = s.runs - n;
        s.geometric[k] = n > 0 ? exp(logarithm / (double)n) : (double)NAN;
        s.median[k] = lg_median(values, n);
    }
    return s;
}
