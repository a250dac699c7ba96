/* Windows of a log: pieces with rows at equal time steps. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "core/core.h"
#include "liegrad/table.h"
#include "core/median.h"
#include "files/h5.h"

/* Whether row i + 1 belongs to the same run as row i. */
static bool same_run(const lg_table_data *stamps, size_t i) {
    return stamps->label == NULL || stamps->label[i] == stamps->label[i + 1];
}

/* Returns the median of the positive time steps within runs; NaN if there are none. */
static double usual_step(const lg_table_data *stamps, double *scratch) {
    size_t n = 0;
    for (size_t i = 0; i + 1 < stamps->rows; i++) {
        const double h = stamps->values[i + 1] - stamps->values[i];
        if (h > 0 && same_run(stamps, i)) scratch[n++] = h;
    }
    return n > 0 ? lg_median(scratch, n) : (double)NAN;
}

/* Whether a window begins at row i: each of its steps is between half of h and one and a half h long. */
static bool is_window(const lg_table_data *stamps, size_t i, size_t steps, double h) {
    for (size_t k = i; k < i + steps; k++)
        if (!same_run(stamps, k) || !(fabs(stamps->values[k + 1] - stamps->values[k] - h) < 0.5 * h))
            return false;
    return true;
}

/* Appends the windows of the run `held` if `last` is true, otherwise the windows of all other runs. */
static void cut(const lg_table_data *stamps, lg_table_windows *w, uint32_t held, bool last, double h,
                size_t *count) {
    const size_t columns = w->data.columns, steps = w->steps;
    for (size_t i = 0; i + steps < stamps->rows; i++) {
        if ((stamps->label != NULL && stamps->label[i] == held) != last || !is_window(stamps, i, steps, h))
            continue;
        memcpy(w->rows + *count * (steps + 1) * columns, w->data.values + i * columns,
               (steps + 1) * columns * sizeof *w->rows);
        w->step[(*count)++] = (stamps->values[i + steps] - stamps->values[i]) / (double)steps;
        i += steps - 1;
    }
}

static lg_status fill(const lg_context *context, const char *path, const lg_table_data *stamps,
                      lg_table_windows *w, lg_error *error) {
    const size_t most = stamps->rows / w->steps + 1;
    const bool several = stamps->classes > 1;
    const uint32_t held = several ? stamps->classes - 1 : LG_TABLE_NO_CLASS;
    size_t all = 0;
    w->rows = lg_alloc(context, most, (w->steps + 1) * w->data.columns * sizeof *w->rows);
    w->step = lg_alloc(context, stamps->rows, sizeof *w->step);
    if (w->rows == NULL || w->step == NULL)
        return lg_fail(error, LG_OUT_OF_MEMORY, "%s: out of memory", lg_shown_path(path));
    const double h = usual_step(stamps, w->step);
    cut(stamps, w, held, false, h, &all);
    w->count = all;
    if (several) cut(stamps, w, held, true, h, &all);
    w->held = all - w->count;
    if (several) (void)snprintf(w->held_run, sizeof w->held_run, "%s", stamps->class_name[held]);
    if (w->count > 0) return LG_OK;
    return lg_fail(error, LG_FORMAT,
                   "%s: no %zu rows of one run follow each other at equal time steps: take fewer steps per "
                   "window, or a log with longer runs and fewer gaps",
                   lg_shown_path(path), w->steps + 1);
}

lg_status lg_table_windows_read(const lg_context *context, const char *path, const char *time,
                                const char *run, const char *const *names, uint32_t count, size_t steps,
                                lg_table_windows *out, lg_error *error) {
    LG_CLEAN(lg_table_data_destroy) lg_table_data stamps = {.rows = 0};
    LG_CLEAN(lg_table_windows_destroy) lg_table_windows made = {.steps = steps};
    LG_NEEDS(error, path, time, names, out);
    if (steps < 1 || steps >= UINT32_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT, "windows of %zu steps: expected at least one", steps);
    LG_TRY(lg_table_read(context, path, &time, 1, run, NULL, &stamps, error));
    LG_TRY(lg_table_read(context, path, names, count, NULL, NULL, &made.data, error));
    LG_TRY(lg_table_keep_complete((lg_table_data *[]){&stamps, &made.data}, 2, &made.left_out, error));
    LG_TRY(fill(context, path, &stamps, &made, error));
    return LG_GIVE(out, made);
}

void lg_table_windows_destroy(lg_table_windows *windows) {
    if (windows == NULL) return;
    LG_FREE_ALL(windows->data.context, windows->rows, windows->step);
    lg_table_data_destroy(&windows->data);
    *windows = (lg_table_windows){.count = 0};
}
