/* Warns of one or two rows far from all other values of their column. Refuses values so large that the other
 * values are lost in rounding. */
#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "core/median.h"
#include "files/h5.h"
#include "machine/files/log_table.h"

enum { MOST_SORTED = 50000, FEWEST = 20, LONGEST = 2 };
#define OUTSIDE 50  /* 1/50 of the values at each end does not count for the range */
#define FAR     5.0 /* least distance of an outlier from the range, in ranges */

/* The range of most values of a column; a value is far off if its distance from the range is above `far`. */
typedef struct bulk {
    double low, high, far;
} bulk;

/* If most values are equal, their size takes the place of their range. False: too few values, or all are
 * 0. */
static bool find_bulk(const lg_log_table *t, uint32_t column, size_t first, size_t end, double *work,
                      bulk *out) {
    const size_t stride = (end - first) / MOST_SORTED + 1;
    size_t n = 0;
    for (size_t row = first; row < end; row += stride) {
        const double x = lg_log_row(t, row)[column];
        if (isfinite(x)) work[n++] = x;
    }
    if (n < FEWEST) return false;
    qsort(work, n, sizeof *work, lg_compare_doubles);
    const size_t outside = n / OUTSIDE > LONGEST ? n / OUTSIDE : LONGEST;
    *out = (bulk){.low = work[outside], .high = work[n - 1 - outside]};
    const double range = out->high - out->low;
    out->far = FAR * (range > 0 ? range : fabs(out->low));
    return out->far > 0;
}

static double distance(const bulk *b, double x) {
    return x > b->high ? x - b->high : x < b->low ? b->low - x : 0;
}

/* Whether rows row .. after - 1, which are far off, are an outlier. At either end of a run they may also be a
 * step, since no return to the other values is seen; there they must be far beyond the size of all other
 * values, too. */
static bool is_outlier(const lg_log_table *t, uint32_t column, size_t row, size_t after, size_t first,
                       size_t end, const bulk *b) {
    const bool begins = row == first || t->origin[row - 1].run != t->origin[row].run,
               ends = after == end || t->origin[after].run != t->origin[row].run;
    const double size = fmax(fabs(b->low), fabs(b->high));
    return after - row <= LONGEST &&
           ((!begins && !ends) || (b->high > b->low && fabs(lg_log_row(t, row)[column]) > FAR * size));
}

static lg_status warn_of_column(lg_log_table *t, uint32_t column, size_t first, size_t end, double *work) {
    bulk b;
    size_t at = 0, count = 0;
    if (!find_bulk(t, column, first, end, work, &b)) return LG_OK;
    for (size_t row = first, after = first; row < end; row = after) {
        for (after = row; after < end && t->origin[after].run == t->origin[row].run; after++)
            if (!(distance(&b, lg_log_row(t, after)[column]) > b.far)) break;
        if (after == row)
            after++;
        else if (is_outlier(t, column, row, after, first, end, &b) && count++ == 0)
            at = row;
    }
    if (count == 0) return LG_OK;
    return lg_log_warn_at(t, at,
                          "column %s: jumps to %.6g and back, but most rows are between %.6g and %.6g; this "
                          "is the first of %zu such jumps: if these cells are outliers, leave them empty",
                          t->machine->columns[column].name, lg_log_row(t, at)[column], b.low, b.high, count);
}

/* Refuses a value whose square overflows, or at which rounding error is larger than the range of the
 * others. */
static lg_status refuse_huge(const lg_log_table *t, uint32_t column, size_t first, size_t end, double *work,
                             lg_error *error) {
    bulk b;
    const bool found = find_bulk(t, column, first, end, work, &b);
    for (size_t row = first; row < end; row++) {
        const double x = lg_log_row(t, row)[column];
        if (isnan(x) || (isfinite(x * x) && !(found && distance(&b, x) * DBL_EPSILON > b.far))) continue;
        char others[80] = "";
        if (found)
            (void)lg_format(others, sizeof others, " (most rows are between %.6g and %.6g)", b.low, b.high);
        return lg_log_fail(t, row, error,
                           "column %s: %.6g is so large that the other rows vanish in its rounding error%s: "
                           "if this cell is an outlier, leave it empty",
                           t->machine->columns[column].name, x, others);
    }
    return LG_OK;
}

/* Applies one of the two to each column of each file. */
static lg_status judge(lg_log_table *table, bool warn, lg_error *error) {
    double *work = lg_alloc(table->context, MOST_SORTED + 1, sizeof *work);
    lg_status status = work != NULL ? LG_OK : lg_log_no_memory(table->paths[0], error);
    for (size_t first = 0, end = 1; first < table->rows && status == LG_OK; first = end++) {
        while (end < table->rows && table->origin[end].file == table->origin[first].file) end++;
        for (uint32_t i = 0; i < table->columns && status == LG_OK; i++) {
            const lg_log_role role = table->machine->columns[i].role;
            if (role == LG_LOG_TIME || role == LG_LOG_RUN) continue;
            if (!warn)
                status = refuse_huge(table, i, first, end, work, error);
            else if (warn_of_column(table, i, first, end, work) != LG_OK)
                status = lg_log_no_memory(table->paths[0], error);
        }
    }
    lg_free(table->context, work);
    return status;
}

lg_status lg_log_refuse_huge(lg_log_table *table, lg_error *error) {
    return judge(table, false, error);
}

lg_status lg_log_warn_of_jumps(lg_log_table *table, lg_error *error) {
    return judge(table, true, error);
}
