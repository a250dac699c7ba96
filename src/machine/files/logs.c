/* Logs: cuts what was read into parts without gaps, cleans and checks it, and brings it into the machine's
 * order. */
#include <math.h>
#include <string.h>

#include "core/median.h"
#include "files/h5.h"
#include "machine/files/log_table.h"

#define DEFAULT_STEP 1.4  /* max_step by default, in median steps */
#define ROUNDING     1e-9 /* a time step that exceeds max_step by at most this fraction is not a gap */
#define OTHER_RATE   3.0  /* files whose median steps differ by more are warned of */

void lg_log_options_init(lg_log_options *options) {
    *options = (lg_log_options){.size = sizeof *options, .consistency = true};
    lg_read_options_init(&options->read);
}

static const char *first_path(const lg_log_table *t) {
    return lg_shown_path(t->paths[0]);
}

/* ---- steps ---- */

/* Appends the time steps of one file, from row *row on; *row becomes the first row of the next file. */
static lg_status steps_of_file(const lg_log_table *t, size_t *row, double *steps, size_t *count) {
    const lg_log_column *time = &t->machine->columns[t->machine->time];
    const uint32_t file = t->origin[*row].file;
    for (++*row; *row < t->rows && t->origin[*row].file == file; ++*row) {
        if (t->origin[*row].run != t->origin[*row - 1].run) continue;
        const double before = lg_log_time(t, *row - 1), now = lg_log_time(t, *row);
        if (!(now > before))
            return LG_LOG_FAIL(
                t, *row,
                "column %s: time does not increase: %.9g after %.9g. Two clocks, a restart, or rows out of "
                "order? Name a column that separates the runs (columns: {run: ...}), or sort the rows",
                time->name, now, before);
        steps[(*count)++] = now - before;
    }
    return LG_OK;
}

/* Finds the median time step of all files, and warns if the files' medians differ much. */
static lg_status find_steps(lg_log_table *t) {
    LG_TRY_SCRATCH(double, steps, t->context, t->rows, lg_log_no_memory(t));
    lg_logs *out = t->out;
    double least = INFINITY, most = 0;
    uint32_t slow = 0, fast = 0;
    size_t total = 0;
    for (size_t row = 0; row < t->rows;) {
        const uint32_t file = t->origin[row].file;
        size_t count = 0;
        LG_TRY(steps_of_file(t, &row, steps + total, &count));
        const double middle = lg_median(steps + total, count);
        if (middle < least) least = middle, fast = file;
        if (middle > most) most = middle, slow = file;
        total += count;
    }
    if (total == 0) return lg_fail(t->error, LG_FORMAT, "%s: no run has two rows or more", first_path(t));
    out->dt_median = lg_median(steps, total);
    out->dt_max = steps[total - 1];
    out->max_step = t->machine->max_step > 0 ? t->machine->max_step : DEFAULT_STEP * out->dt_median;
    if (most > OTHER_RATE * least)
        lg_log_warn(t, "the files have different rates: the median step is %.4g s in %s and %.4g s in %s",
                    most, lg_shown_path(t->paths[slow]), least, lg_shown_path(t->paths[fast]));
    return LG_OK;
}

/* ---- statistics of columns ---- */

/* Whether a row has all positions and all measured velocities. */
static bool row_is_complete(const lg_log_table *t, size_t row) {
    for (uint32_t i = 0; i < t->columns; i++) {
        const lg_log_role role = t->machine->columns[i].role;
        if ((role == LG_LOG_POSITION || role == LG_LOG_VELOCITY) && isnan(lg_log_row(t, row)[i]))
            return false;
    }
    return true;
}

/* Checks that a file has a complete row, and a value in each column of an input. */
static lg_status check_file(const lg_log_table *t, size_t first, size_t end) {
    const char *path = lg_shown_path(t->paths[t->origin[first].file]);
    size_t row = first;
    for (uint32_t i = 0; i < t->columns; i++) {
        if (!lg_log_is_value(t, i)) continue;
        for (row = first; row < end && isnan(lg_log_row(t, row)[i]);) row++;
        if (row == end)
            return lg_fail(t->error, LG_FORMAT, "%s: column %s: has no value at all", path,
                           t->machine->columns[i].name);
    }
    for (row = first; row < end && !row_is_complete(t, row);) row++;
    if (row < end) return LG_OK;
    return lg_fail(t->error, LG_FORMAT,
                   "%s: no row is complete: in each one a position or velocity is missing", path);
}

static lg_status measure_columns(const lg_log_table *t) {
    for (uint32_t i = 0; i < t->columns; i++) {
        lg_log_statistics *s = &t->out->columns[i];
        if (!lg_log_is_value(t, i)) continue;
        *s = (lg_log_statistics){.noise = NAN};
        for (size_t row = 0; row < t->rows; row++) s->missing += isnan(lg_log_row(t, row)[i]);
        lg_log_range(t, i);
    }
    for (size_t first = 0; first < t->rows; first = lg_log_file_end(t, first))
        LG_TRY(check_file(t, first, lg_log_file_end(t, first)));
    return LG_OK;
}

static void warn_of_columns(lg_log_table *t) {
    const lg_machine *m = &t->machine->machine;
    for (uint32_t i = 0; i < t->columns; i++) {
        const lg_log_column *c = &t->machine->columns[i];
        const lg_log_statistics *s = &t->out->columns[i];
        if (c->role == LG_LOG_INPUT && s->low == s->high)
            lg_log_warn(t, "column %s: the input is always %.6g: its effect cannot be learned", c->name,
                        s->low + 0.0); /* + 0.0 turns -0 into 0 */
    }
    for (uint32_t i = 0; i < m->coordinate_count; i++) {
        bool moves = false;
        const bool speeds = t->machine->measured >= LG_MEASURED_VELOCITIES_ONLY;
        const lg_log_role shows = speeds ? LG_LOG_VELOCITY : LG_LOG_POSITION;
        for (uint32_t k = 0; k < t->columns; k++) {
            const lg_log_column *c = &t->machine->columns[k];
            const lg_log_statistics *s = &t->out->columns[k];
            moves = moves || (c->role == shows && c->index == i && s->low < s->high);
        }
        if (!moves)
            lg_log_warn(t,
                        "coordinate %s never moves: its mass and forces cannot be learned and stay "
                        "near their starting values; leave it out of the machine, or log its motion",
                        m->coordinates[i].name);
    }
}

/* ---- parts ---- */

/* Delays inputs in a stretch without gaps: row j gets the input of row j - delay; the first rows get none. */
static void delay_inputs(const lg_log_table *t, size_t begin, size_t end) {
    for (uint32_t i = 0; i < t->columns; i++) {
        const lg_log_column *c = &t->machine->columns[i];
        const uint32_t delay = c->role == LG_LOG_INPUT ? t->out->delay[c->index] : 0;
        for (size_t row = end; delay > 0 && row-- > begin;)
            lg_log_row(t, row)[i] = row - begin >= delay ? lg_log_row(t, row - delay)[i] : NAN;
    }
}

/* Whether an input is missing; *needed: one that is not held. */
static bool input_is_missing(const lg_log_table *t, size_t row, bool *needed) {
    bool missing = *needed = false;
    for (uint32_t i = 0; i < t->columns; i++) {
        const lg_log_column *c = &t->machine->columns[i];
        if (c->role != LG_LOG_INPUT || !isnan(lg_log_row(t, row)[i])) continue;
        missing = true;
        *needed = *needed || t->machine->inputs[c->index].hold != LG_HOLD_ZERO;
    }
    return missing;
}

/* The part that is being built. Its rows move down in the table to row `kept`. */
typedef struct growing {
    size_t kept, begin; /* rows that are kept so far; first row of the open part */
} growing;

/* Closes the open part; drops it if it has only one row. */
static void close_part(lg_log_table *t, growing *g) {
    if (g->kept - g->begin >= 2) {
        t->first[++t->parts] = g->kept;
        g->begin = g->kept;
    }
    g->kept = g->begin;
}

/* Cuts a stretch where an input is missing. A held input is unknown after such a row: the row ends its part.
 * Other inputs are unknown before it, too: the row is dropped. */
static void cut_stretch(lg_log_table *t, growing *g, size_t begin, size_t end) {
    delay_inputs(t, begin, end);
    for (size_t row = begin; row < end; row++) {
        bool needed;
        const bool missing = input_is_missing(t, row, &needed);
        if (!needed && row != g->kept) {
            memcpy(lg_log_row(t, g->kept), lg_log_row(t, row), t->columns * sizeof *t->data);
            t->origin[g->kept] = t->origin[row];
        }
        g->kept += !needed;
        if (missing) close_part(t, g);
    }
    close_part(t, g);
}

/* Warns of files of which no row is used, if rows of other files are. */
static void warn_of_files(lg_log_table *t) {
    uint32_t file = 0;
    for (size_t part = 0; part <= t->parts; part++) {
        const uint32_t next = part < t->parts ? t->origin[t->first[part]].file : t->files;
        for (; file < next; file++)
            lg_log_warn(
                t, "%s: no row of this file is used: no two rows with inputs follow each other within %.4g s",
                lg_shown_path(t->paths[file]), t->out->max_step);
        file = next + 1;
    }
}

static lg_status cut(lg_log_table *t) {
    growing g = {0, 0};
    size_t steps = 0;
    bool late = false;
    for (uint32_t i = 0; i < t->machine->machine.input_count; i++) late = late || t->out->delay[i] > 0;
    t->first = lg_alloc(t->context, t->rows + 1, sizeof *t->first);
    if (t->first == NULL) return lg_log_no_memory(t);
    for (size_t begin = 0, end = 1; begin < t->rows; begin = end++) {
        while (end < t->rows && t->origin[end].run == t->origin[end - 1].run &&
               lg_log_time(t, end) - lg_log_time(t, end - 1) <= t->out->max_step * (1 + ROUNDING))
            end++, steps++;
        t->out->gaps += end < t->rows && t->origin[end].run == t->origin[end - 1].run;
        cut_stretch(t, &g, begin, end);
    }
    t->rows = g.kept;
    warn_of_files(t);
    if (t->parts > 0) return LG_OK;
    if (steps == 0)
        return lg_fail(
            t->error, LG_FORMAT,
            "%s: every step is longer than max_step (%.4g s), the median is %.4g s: is column %s in seconds? "
            "For milliseconds, set scale: {%s: 0.001}; otherwise set columns: {max_step: ...}",
            first_path(t), t->out->max_step, t->out->dt_median, t->machine->columns[t->machine->time].name,
            t->machine->columns[t->machine->time].name);
    return lg_fail(t->error, LG_FORMAT, "%s: no two rows with inputs follow each other%s", first_path(t),
                   late ? ": is the delay longer than the runs?" : "");
}

/* ---- integrals ---- */

/* Logs that measure velocities alone: positions are their integrals from 0 at the start of each part. Logs
 * that measure accelerations alone: velocities and positions are integrals without their drift, guesses from
 * which the starts of windows are estimated. */

/* out (rows, velocities): integrals of x from 0 at the start of each part; a missing number is the one
 * before. */
static void integrate(const lg_log_table *table, const double *x, double *out) {
    const size_t n = table->machine->machine.velocities;
    double held[LG_MACHINE_VELOCITIES], next[LG_MACHINE_VELOCITIES];
    for (size_t part = 0; part < table->parts; part++)
        for (size_t row = table->first[part], begin = row; row < table->first[part + 1]; row++)
            for (size_t k = 0; k < n; k++) {
                const double here = x[row * n + k];
                next[k] = !isnan(here) ? here : row > begin ? held[k] : 0.0;
                const double h = row > begin ? lg_log_time(table, row) - lg_log_time(table, row - 1) : 0.0;
                out[row * n + k] = row > begin ? out[(row - 1) * n + k] + 0.5 * h * (held[k] + next[k]) : 0.0;
                held[k] = next[k];
            }
}

/* A straight line, x0 + slope (t - t0). */
typedef struct line {
    double t0, x0, slope;
} line;

static line fit_line(const lg_log_table *table, const double *x, size_t k, size_t first, size_t end) {
    const size_t n = table->machine->machine.velocities;
    const double count = (double)(end - first);
    double t0 = 0, x0 = 0, tt = 0, tx = 0;
    for (size_t row = first; row < end; row++) {
        t0 += lg_log_time(table, row) / count;
        x0 += x[row * n + k] / count;
    }
    for (size_t row = first; row < end; row++) {
        const double t = lg_log_time(table, row) - t0;
        tt += t * t;
        tx += t * (x[row * n + k] - x0);
    }
    return (line){t0, x0, tt > 0 ? tx / tt : 0};
}

static double line_at(const line *of, double t) {
    return of->x0 + of->slope * (t - of->t0);
}

/* Subtracts from number k of rows first .. end - 1 what drifts: the lines through pieces of PIECE rows, half
 * of which each shares with the next, blended linearly from one to the next. work (rows) */
static void remove_drift(const lg_log_table *table, double *x, size_t k, size_t first, size_t end,
                         double *work) {
    enum { PIECE = 400, HALF = PIECE / 2 };
    const size_t n = table->machine->machine.velocities;
    line now = fit_line(table, x, k, first, end < first + PIECE ? end : first + PIECE), next = now;
    for (size_t begin = first; begin < end; begin += HALF) {
        const size_t stop = end < begin + HALF ? end : begin + HALF;
        const bool more = begin > first && begin + PIECE <= end;
        now = next;
        if (more) next = fit_line(table, x, k, begin, begin + PIECE);
        for (size_t row = begin; row < stop; row++) {
            const double t = lg_log_time(table, row), share = (double)(row - begin) / HALF;
            work[row] = (1 - share) * line_at(&now, t) + share * line_at(&next, t);
        }
    }
    for (size_t row = first; row < end; row++) x[row * n + k] -= work[row];
}

static void remove_drifts(const lg_log_table *table, double *x, double *work) {
    for (size_t part = 0; part < table->parts; part++)
        for (size_t k = 0; k < table->machine->machine.velocities; k++)
            remove_drift(table, x, k, table->first[part], table->first[part + 1], work);
}

/* Replaces what is not measured of the rows of `out`: positions with `measured: velocities-only`; with
 * `measured: accelerations`, where v holds these, it moves them to a and fills q and v. */
static lg_status integrate_all(const lg_log_table *table, lg_logs *out) {
    const size_t n = table->machine->machine.velocities;
    if (table->machine->measured == LG_MEASURED_VELOCITIES_ONLY) integrate(table, out->v, out->q);
    if (table->machine->measured != LG_MEASURED_ACCELERATIONS) return LG_OK;
    LG_TRY_SCRATCH(double, work, table->context, table->rows, LG_OUT_OF_MEMORY);
    out->a = lg_alloc(table->context, table->rows, n * sizeof *out->a);
    if (out->a == NULL) return LG_OUT_OF_MEMORY;
    memcpy(out->a, out->v, table->rows * n * sizeof *out->a);
    integrate(table, out->a, out->v);
    remove_drifts(table, out->v, work);
    integrate(table, out->v, out->q);
    remove_drifts(table, out->q, work);
    return LG_OK;
}

/* ---- logs in the machine's order ---- */

static void fill_state(const lg_log_table *t, size_t row, double *q, double *v) {
    const lg_machine *m = &t->machine->machine;
    const double *from = lg_log_row(t, row);
    for (uint32_t i = 0; i < m->coordinate_count; i++) {
        const lg_log_coordinate *c = &t->machine->coordinates[i];
        const uint32_t velocities = lg_coordinate_row_of(m->coordinates[i].kind)->velocities;
        memcpy(q, from + c->place, c->places * sizeof *q);
        q += c->places;
        if (c->attitudes == 3) memcpy(q, from + c->attitude, 3 * sizeof *q);
        if (c->attitudes > 3) lg_log_rotation(from + c->attitude, c->attitudes, q);
        q += c->attitudes > 3 ? 9 : c->attitudes;
        for (uint32_t k = 0; k < velocities; k++) *v++ = c->velocities > 0 ? from[c->velocity + k] : NAN;
    }
}

static lg_status fill(lg_log_table *t) {
    lg_logs *out = t->out;
    const lg_machine *m = &t->machine->machine;
    const size_t rows = t->rows, each = 1 + m->positions + m->velocities + 4 * m->input_count;
    out->t = lg_alloc(t->context, rows, each * sizeof *out->t);
    out->part_file = lg_alloc(t->context, t->parts, 2 * sizeof *out->part_file);
    if (out->t == NULL || out->part_file == NULL) return lg_log_no_memory(t);
    out->q = out->t + rows;
    out->v = out->q + rows * m->positions;
    out->u = out->v + rows * m->velocities;
    out->part_run = out->part_file + t->parts;
    LG_TRY_SCRATCH(double, work, t->context, 3 * rows, lg_log_no_memory(t));
    for (size_t row = 0; row < rows; row++) {
        out->t[row] = lg_log_time(t, row);
        fill_state(t, row, out->q + row * m->positions, out->v + row * m->velocities);
    }
    if (integrate_all(t, out) != LG_OK) return lg_log_no_memory(t);
    for (size_t part = 0; part < t->parts; part++) {
        out->part_file[part] = t->origin[t->first[part]].file;
        const size_t inputs = m->input_count, begin = t->first[part], end = t->first[part + 1];
        out->part_run[part] = t->origin[begin].run;
        for (uint32_t i = 0; i < t->columns; i++) {
            const lg_log_column *c = &t->machine->columns[i];
            if (c->role == LG_LOG_INPUT)
                lg_log_act(t->machine->inputs[c->index].hold, end - begin, out->t + begin,
                           lg_log_row(t, begin) + i, t->columns, inputs, work,
                           out->u + 4 * begin * inputs + c->index);
        }
    }
    out->first = t->first;
    t->first = NULL;
    out->log = (lg_machine_log){.rows = rows,
                                .parts = t->parts,
                                .first = out->first,
                                .t = out->t,
                                .q = out->q,
                                .v = out->v,
                                .u = m->input_count > 0 ? out->u : NULL,
                                .a = out->a};
    if (m->lags == 0) return LG_OK;
    LG_TRY(lg_machine_filter_create(t->context, m, &out->log, &out->filter, t->error));
    out->log.filter = out->filter;
    return LG_OK;
}

/* ---- reading ---- */

static lg_status read_logs(lg_log_table *t) {
    LG_TRY(lg_log_read_files(t));
    t->out->files = t->files;
    for (uint32_t i = 0; i < t->machine->machine.input_count; i++) {
        const lg_log_input *input = &t->machine->inputs[i];
        t->out->delay[i] = input->estimate_delay ? t->options->delay : input->delay;
    }
    LG_TRY(find_steps(t));
    LG_TRY(measure_columns(t));
    warn_of_columns(t);
    LG_TRY(lg_log_compare_with_range(t));
    LG_TRY(cut(t));
    LG_TRY(lg_log_clean(t));
    LG_TRY(lg_log_leave_out_outliers(t));
    LG_TRY(lg_log_find_noise(t));
    if (t->options->consistency) LG_TRY(lg_log_check(t));
    return t->failed || t->names.failed ? lg_log_no_memory(t) : fill(t);
}

lg_status lg_logs_read(const lg_context *context, const lg_machine_file *file, const char *const *paths,
                       size_t count, const lg_log_options *options, lg_logs *out, lg_error *error) {
    lg_log_options defaults;
    lg_log_options_init(&defaults);
    if (options == NULL) options = &defaults;
    if (file == NULL || paths == NULL || out == NULL || count < 1 || count > UINT32_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT, "logs: a machine file and at least one log are needed");
    if (options->size != sizeof *options)
        return lg_fail(error, LG_INVALID_ARGUMENT, "log options: wrong size");
    for (size_t i = 0; i < count; i++)
        if (paths[i] == NULL || *paths[i] == '\0')
            return lg_fail(error, LG_INVALID_ARGUMENT, "a log needs a name");
    lg_log_table t = {.context = context,
                      .machine = file,
                      .paths = paths,
                      .files = (uint32_t)count,
                      .options = options,
                      .names = {.context = context},
                      .error = error,
                      .columns = file->column_count};
    LG_TRY_SCRATCH(lg_logs, made, context, 1, lg_log_no_memory(&t));
    t.out = made;
    made->context = context;
    t.place = lg_alloc(context, count, sizeof *t.place);
    const lg_status status = t.place != NULL ? read_logs(&t) : lg_log_no_memory(&t);
    made->run_names = t.names.data;
    LG_FREE_ALL(context, t.place, t.data, t.origin, t.first);
    if (status == LG_OK)
        *out = *made;
    else
        lg_logs_destroy(made);
    return status;
}

void lg_logs_destroy(lg_logs *logs) {
    if (logs == NULL) return;
    lg_machine_filter_destroy(logs->filter);
    LG_FREE_ALL(logs->context, logs->first, logs->part_file, logs->t, logs->a, logs->warnings,
                logs->run_names);
    *logs = (lg_logs){.files = 0};
}
