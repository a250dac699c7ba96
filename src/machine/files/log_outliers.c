/* Outliers: one or two rows whose value is far from all others and comes back. Those of positions and
 * velocities are left out, with a warning; those of other columns, and at the ends of runs, cause a
 * warning. A value so large that the others are lost in rounding is refused.
 *
 * A position or velocity is compared with a cubic polynomial through four neighbours, two on each side
 * (near the end of a part, one neighbour on one side and three on the other). It is an outlier if two
 * conditions hold: the value is far from the polynomial, and without the value the neighbours are close
 * to their own polynomials. At a kink or a step the neighbours stay far from their polynomials, so the
 * value is kept. So is a value that the values of one side alone predict: a force that sets in at this
 * row bends the motion there.
 *
 * Inputs have no such smooth course. They are compared with the range of most values of their column. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/median.h"
#include "files/h5.h"
#include "machine/files/log_table.h"

enum { FEWEST = 20, BESIDE = 2, AROUND = 10, LONGEST = 2 };
static const double far = 20, near = 6; /* in standard deviations of the difference from the polynomial */
static const double steps = 6;          /* least distance of an outlier, in the smallest steps of a column */
/* Without the outlier, the neighbours' distances from their polynomials are at most this part of the
 * outlier's distance. */
static const double small = 0.125;
/* Next to a step of an input a value is kept that one side predicts within this part of its distance. */
static const double bent = 0.5;
static const double most = 0.05; /* share of a part's values: more of them are no outliers */
#define OUTSIDE 50               /* 1/50 of the values at each end does not count for the range */
#define FAR     5.0              /* least distance of an outlier from the range, in ranges */

typedef struct candidate {
    double off;
    size_t value;
} candidate;

/* The values of one column in one part of the log; missing ones are none. */
typedef struct trace {
    lg_log_table *table;
    uint32_t column;
    size_t begin, end;  /* rows of the part */
    size_t n, *row;     /* (n) the rows that have a value */
    double *off, *work; /* (n) difference from the polynomial */
    bool *out;          /* (n) values that are left out */
    bool *stepped;      /* (end - begin) an input steps in this row, the next or one of the AROUND before */
    candidate *all;     /* (n) */
} trace;

static double *cell(const trace *x, size_t i) {
    return lg_log_row(x->table, x->row[i]) + x->column;
}

/* ---- distance from the neighbours ---- */

/* The nearest values before (step -1) or after (step 1) value i that are not left out, at most `count`. */
static int beside(const trace *x, size_t i, int step, int count, size_t *at) {
    int found = 0;
    for (size_t j = i + (size_t)step; j < x->n && found < count; j += (size_t)step)
        if (!x->out[j]) at[found++] = j;
    return found;
}

/* Value i minus the polynomial through the values of `count` other rows. */
static double off_polynomial(const trace *x, size_t i, const size_t *at, int count) {
    double sum = 0, t[4];
    const double now = lg_log_time(x->table, x->row[i]);
    for (int k = 0; k < count; k++) t[k] = lg_log_time(x->table, x->row[at[k]]);
    for (int k = 0; k < count; k++) {
        double weight = 1;
        for (int j = 0; j < count; j++)
            if (j != k) weight *= (now - t[j]) / (t[k] - t[j]);
        sum += weight * *cell(x, at[k]);
    }
    return *cell(x, i) - sum;
}

/* Distance of value i from the cubic polynomial through four neighbours. NaN: one side has no neighbour,
 * or there are fewer than four. */
static double distance(const trace *x, size_t i) {
    size_t at[4], after[3];
    const int b = beside(x, i, -1, 3, at), a = beside(x, i, 1, 3, after);
    if (a == 0 || b == 0 || a + b < 4) return NAN;
    const int before = a == 1 ? 3 : b == 1 ? 1 : 2;
    for (int k = before; k < 4; k++) at[k] = after[k - before];
    return fabs(off_polynomial(x, i, at, 4));
}

/* The largest distance of the BESIDE values before and after value i, which is left out. */
static double rest_beside(const trace *x, size_t i) {
    double rest = 0;
    size_t at[BESIDE];
    for (int step = -1; step <= 1; step += 2)
        for (int k = beside(x, i, step, BESIDE, at); k-- > 0;) rest = fmax(rest, distance(x, at[k]));
    return rest;
}

/* The least distance of value i, which is left out, from the parabola through the three and the cubic through
 * the four nearest values of one side. */
static double one_sided(const trace *x, size_t i) {
    double least = INFINITY;
    size_t at[4];
    for (int step = -1; step <= 1; step += 2)
        for (int k = beside(x, i, step, 4, at); k >= 3; k--)
            least = fmin(least, fabs(off_polynomial(x, i, at, k)));
    return least;
}

/* ---- outliers of a motion ---- */

/* Standard deviation of the distances of values first .. end - 1. */
static double spread(const trace *x, size_t first, size_t end) {
    size_t count = 0;
    for (size_t i = first; i < end; i++)
        if (!isnan(x->off[i])) x->work[count++] = x->off[i];
    return count > 0 ? lg_median(x->work, count) / 0.6745 : INFINITY;
}

static double smallest_step(const trace *x) {
    double least = INFINITY;
    for (size_t i = 1; i < x->n; i++) {
        const double step = fabs(*cell(x, i) - *cell(x, i - 1));
        if (step > 0 && step < least) least = step;
    }
    return least;
}

/* Whether values i and j (i alone if j is i) are outliers by more than `far_off`. Then they are left out. */
static bool try_outliers(const trace *x, size_t i, size_t j, double far_off, double deviation) {
    x->out[i] = x->out[j] = true;
    const double own = distance(x, i), other = distance(x, j), least = fmin(own, other),
                 rest = fmax(rest_beside(x, i), rest_beside(x, j)),
                 alone = fmin(one_sided(x, i), one_sided(x, j)),
                 tolerated = fmax(small * least, near * deviation);
    const bool stepped = x->stepped[x->row[i] - x->begin] || x->stepped[x->row[j] - x->begin];
    const double bend = stepped ? fmax(bent * least, tolerated) : tolerated;
    const bool found = own > far_off && other > far_off && rest <= tolerated && alone > bend;
    if (!found) x->out[i] = x->out[j] = false;
    return found;
}

/* Tries value i alone, then together with each value that is so near that one hides the other. */
static void try_row(const trace *x, size_t i, double scale, double least) {
    size_t at[2 * BESIDE];
    const size_t low = i > AROUND ? i - AROUND : 0, high = i + AROUND < x->n ? i + AROUND + 1 : x->n;
    if (x->out[i]) return;
    const double deviation = fmax(scale, spread(x, low, high)), far_off = fmax(far * deviation, least);
    if (!(x->off[i] > 0.5 * far_off) || try_outliers(x, i, i, far_off, deviation)) return;
    for (int step = -1; step <= 1; step += 2) {
        const int count = beside(x, i, step, 2 * BESIDE, at);
        for (int k = 0; k < count; k++)
            if (try_outliers(x, i, at[k], far_off, deviation)) return;
    }
}

static int by_size(const void *a, const void *b) {
    const candidate *x = a, *y = b;
    if (x->off != y->off) return x->off < y->off ? 1 : -1;
    return (x->value > y->value) - (x->value < y->value);
}

/* Marks the outliers of a part in x->out, the largest first, and returns how many. */
static size_t find_outliers(const trace *x) {
    size_t candidates = 0, count = 0;
    for (size_t i = 0; i < x->n; i++) x->out[i] = false;
    if (x->n < FEWEST) return 0;
    for (size_t i = 0; i < x->n; i++) x->off[i] = distance(x, i);
    const double scale = spread(x, 0, x->n), least = steps * smallest_step(x);
    for (size_t i = 0; i < x->n; i++)
        if (x->off[i] > 0.5 * fmax(far * scale, least)) x->all[candidates++] = (candidate){x->off[i], i};
    qsort(x->all, candidates, sizeof *x->all, by_size);
    for (size_t k = 0; k < candidates; k++) try_row(x, x->all[k].value, scale, least);
    for (size_t i = 0; i < x->n; i++) count += x->out[i];
    return count;
}

/* Marks rows next to a change of an input that mostly keeps its value. */
static void mark_steps(const trace *x) {
    const size_t width = x->table->columns, rows = x->end - x->begin;
    memset(x->stepped, 0, rows * sizeof *x->stepped);
    for (uint32_t c = 0; c < width; c++) {
        const double *u = lg_log_row(x->table, x->begin) + c;
        size_t still = 0;
        if (x->table->machine->columns[c].role != LG_LOG_INPUT) continue;
        for (size_t i = 1; i < rows; i++) still += u[i * width] == u[(i - 1) * width];
        for (size_t i = 1; i < rows && 2 * still >= rows; i++)
            for (size_t k = i - 1; k < rows && k <= i + AROUND && u[i * width] != u[(i - 1) * width]; k++)
                x->stepped[k] = true;
    }
}

/* Positions of lines and angles, and velocities. An acceleration jumps and comes back where bodies touch. */
static bool is_continuous(const lg_log_table *t, uint32_t column) {
    const lg_log_column *c = &t->machine->columns[column];
    const bool motion = c->role == LG_LOG_POSITION || c->role == LG_LOG_VELOCITY;
    return motion && !t->machine->machine.accelerations && t->machine->coordinates[c->index].attitudes == 0;
}

static void take_part(trace *x, size_t part) {
    x->begin = x->table->first[part], x->end = x->table->first[part + 1], x->n = 0;
    for (size_t row = x->begin; row < x->end; row++)
        if (!isnan(lg_log_row(x->table, row)[x->column])) x->row[x->n++] = row;
    mark_steps(x);
}

/* How many outliers there are, and the first of them. */
typedef struct found {
    size_t count, row;
    double value;
} found;

static void mend_column(trace *x) {
    lg_log_table *t = x->table;
    const lg_log_column *c = &t->machine->columns[x->column];
    found of[2] = {{0}}; /* kept, left out */
    for (size_t part = 0; part < t->parts; part++) {
        take_part(x, part);
        const bool few = (double)find_outliers(x) <= most * (double)x->n;
        for (size_t i = 0; i < x->n; i++) {
            if (!x->out[i]) continue;
            if (of[few].count++ == 0) of[few].row = x->row[i], of[few].value = *cell(x, i);
            if (few) *cell(x, i) = NAN;
        }
    }
    t->out->columns[x->column].outliers = of[1].count;
    if (of[0].count > 0)
        LG_LOG_WARN_AT(t, of[0].row,
                       "column %s: %zu values jump away from their neighbours and return, the first is %.6g; "
                       "these are more than %g %% of a part, so they are kept",
                       c->name, of[0].count, of[0].value, 100 * most);
    if (of[1].count == 0) return;
    /* The range of an angle stays: it was measured before angles were unwrapped. */
    if (c->role != LG_LOG_POSITION || t->machine->machine.coordinates[c->index].kind != LG_COORDINATE_ANGLE)
        lg_log_range(t, x->column);
    LG_LOG_WARN_AT(
        t, of[1].row,
        "column %s: %.6g is an outlier: the value jumps away from its neighbours and returns; it is "
        "the first of %zu outliers, which are left out",
        c->name, of[1].value, of[1].count);
}

lg_status lg_log_leave_out_outliers(lg_log_table *t) {
    trace x = {.table = t};
    size_t longest = 0;
    for (size_t part = 0; part < t->parts; part++)
        if (t->first[part + 1] - t->first[part] > longest) longest = t->first[part + 1] - t->first[part];
    LG_TRY_SCRATCH(candidate, all, t->context, longest, lg_log_no_memory(t));
    LG_TRY_SCRATCH(size_t, row, t->context, longest, lg_log_no_memory(t));
    LG_TRY_SCRATCH(double, off, t->context, 2 * longest, lg_log_no_memory(t));
    LG_TRY_SCRATCH(bool, out, t->context, 2 * longest, lg_log_no_memory(t));
    x.all = all, x.row = row, x.off = off, x.work = off + longest, x.out = out, x.stepped = out + longest;
    for (x.column = 0; x.column < t->columns; x.column++)
        if (is_continuous(t, x.column)) mend_column(&x);
    return LG_OK;
}

/* ---- values far from the range of their column ---- */

/* The range of most values of a column; a value is far off if its distance from the range is above `far`. */
typedef struct bulk {
    double low, high, far;
} bulk;

/* How many of the n sorted values at one end (step 1: x[0], x[1], ...; step -1: x[0], x[-1], ...) do not
 * count for the range: 1/OUTSIDE of them, or all that are equal, up to a fifth, and far from the others:
 * marks of missing values, such as -9999. */
static size_t outside_at(const double *x, ptrdiff_t step, size_t n) {
    const size_t few = n / OUTSIDE > LONGEST ? n / OUTSIDE : LONGEST;
    size_t equal = 0;
    while (equal < n / 5 && x[(ptrdiff_t)equal * step] == *x) equal++;
    const double next = x[(ptrdiff_t)equal * step], last = x[(ptrdiff_t)(n - 1 - few) * step];
    return equal > few && next != last && fabs(*x - next) > FAR * fabs(next - last) ? equal : few;
}

/* If most values are equal, their size takes the place of their range. False: too few values, or all are
 * 0. */
static bool find_bulk(const lg_log_table *t, uint32_t column, size_t first, size_t end, double *work,
                      bulk *out) {
    const size_t n = lg_log_sample(t, column, first, end, work);
    if (n < FEWEST) return false;
    *out = (bulk){.low = work[outside_at(work, 1, n)], .high = work[n - 1 - outside_at(work + n - 1, -1, n)]};
    const double range = out->high - out->low;
    out->far = FAR * (range > 0 ? range : fabs(out->low));
    return out->far > 0;
}

static double beyond(const bulk *b, double x) {
    return x > b->high ? x - b->high : x < b->low ? b->low - x : 0;
}

/* Whether rows row .. after - 1, which are far off, are an outlier. At either end of a run they may also be a
 * step, since no return to the other values is seen; there they must be far beyond the size of all other
 * values, too. Only there the values of a motion are compared with the range. */
static bool is_outlier(const lg_log_table *t, uint32_t column, size_t row, size_t after, size_t first,
                       size_t end, const bulk *b) {
    const bool begins = row == first || t->origin[row - 1].run != t->origin[row].run,
               ends = after == end || t->origin[after].run != t->origin[row].run;
    const double size = fmax(fabs(b->low), fabs(b->high));
    if (after - row > LONGEST) return false;
    if (!begins && !ends) return !is_continuous(t, column);
    return b->high > b->low && fabs(lg_log_row(t, row)[column]) > FAR * size;
}

static void warn_of_jumps(lg_log_table *t, uint32_t column, size_t first, size_t end, const bulk *b) {
    size_t at = 0, count = 0;
    for (size_t row = first, after = first; row < end; row = after) {
        for (after = row; after < end && t->origin[after].run == t->origin[row].run; after++)
            if (!(beyond(b, lg_log_row(t, after)[column]) > b->far)) break;
        if (after == row)
            after++;
        else if (is_outlier(t, column, row, after, first, end, b) && count++ == 0)
            at = row;
    }
    if (count == 0) return;
    LG_LOG_WARN_AT(t, at,
                   "column %s: jumps to %.6g and back, but most rows are between %.6g and %.6g; this "
                   "is the first of %zu such jumps: if these cells are outliers, leave them empty",
                   t->machine->columns[column].name, lg_log_row(t, at)[column], b->low, b->high, count);
}

/* Refuses a value whose square overflows, or at which rounding error is larger than the range of the
 * others. */
static lg_status refuse_huge(const lg_log_table *t, uint32_t column, size_t first, size_t end,
                             const bulk *b) {
    for (size_t row = first; row < end; row++) {
        const double x = lg_log_row(t, row)[column];
        if (isnan(x) || (isfinite(x * x) && !(b != NULL && beyond(b, x) * DBL_EPSILON > b->far))) continue;
        char others[80] = "";
        if (b != NULL)
            (void)lg_format(others, sizeof others, " (most rows are between %.6g and %.6g)", b->low, b->high);
        return LG_LOG_FAIL(t, row,
                           "column %s: %.6g is so large that the other rows vanish in its rounding error%s: "
                           "if this cell is an outlier, leave it empty",
                           t->machine->columns[column].name, x, others);
    }
    return LG_OK;
}

lg_status lg_log_compare_with_range(lg_log_table *t) {
    LG_TRY_SCRATCH(double, work, t->context, LG_LOG_SAMPLES, lg_log_no_memory(t));
    for (size_t first = 0, end; first < t->rows; first = end) {
        end = lg_log_file_end(t, first);
        for (uint32_t i = 0; i < t->columns; i++) {
            bulk b;
            if (!lg_log_is_value(t, i)) continue;
            const bool known = find_bulk(t, i, first, end, work, &b);
            const lg_status status = refuse_huge(t, i, first, end, known ? &b : NULL);
            if (known) warn_of_jumps(t, i, first, end, &b);
            LG_TRY(status);
        }
    }
    return LG_OK;
}
