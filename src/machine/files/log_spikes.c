/* Leaves out outliers of positions and velocities: one or two rows whose value jumps away from the
 * neighbouring values and returns.
 *
 * Each value is compared with a cubic polynomial through four neighbours, two on each side (near the end of
 * a part, one neighbour on one side and three on the other). A value is an outlier if two conditions hold:
 * the value is far from the polynomial, and without the value the neighbours are close to their own
 * polynomials.
 * At a kink or a step the neighbours stay far from their polynomials, so the value is kept. So is a value
 * that the values of one side alone predict: a force that sets in at this row bends the motion there. */
#include <math.h>
#include <stdlib.h>

#include "core/median.h"
#include "machine/files/log_table.h"

enum { FEWEST = 20, BESIDE = 2, AROUND = 10 };
static const double far = 20, near = 6; /* in standard deviations of the difference from the polynomial */
static const double steps = 6;          /* least distance of an outlier, in the smallest steps of a column */
/* Without the outlier, the neighbours' distances from their polynomials are at most this part of the
 * outlier's distance. */
static const double small = 0.125;
/* Next to a step of an input a value is kept that one side predicts within this part of its distance. */
static const double bent = 0.5;
static const double most = 0.05; /* share of a part's values: more of them are no outliers */

/* One column of one part of the log. previous and next link the rows that have a value; n stands for none. */
typedef struct trace {
    const lg_log_table *table;
    uint32_t column;
    size_t first, n, values; /* first row of the part in the table; numbers of rows and of values */
    size_t *previous, *next; /* (n) */
    double *off, *work;      /* (n) */
    bool *out;               /* (n) rows that are left out */
    bool *stepped;           /* (n) an input steps in this row, the next or one of the AROUND before */
} trace;

static double value(const trace *x, size_t i) {
    return lg_log_row(x->table, x->first + i)[x->column];
}

static double time_of(const trace *x, size_t i) {
    return lg_log_time(x->table, x->first + i);
}

/* ---- the list of values ---- */

static void link_values(trace *x) {
    size_t last = x->n;
    for (size_t i = 0; i < x->n; i++) {
        if (isnan(value(x, i))) continue;
        x->previous[i] = last;
        x->next[i] = x->n;
        if (last < x->n) x->next[last] = i;
        last = i;
    }
}

static void leave_out(trace *x, size_t i) {
    x->out[i] = true;
    if (x->previous[i] < x->n) x->next[x->previous[i]] = x->next[i];
    if (x->next[i] < x->n) x->previous[x->next[i]] = x->previous[i];
}

static void put_back(trace *x, size_t i) {
    x->out[i] = false;
    if (x->previous[i] < x->n) x->next[x->previous[i]] = i;
    if (x->next[i] < x->n) x->previous[x->next[i]] = i;
}

/* Value i minus the polynomial through the values of `count` other rows. */
static double off_polynomial(const trace *x, size_t i, const size_t *at, int count) {
    double sum = 0;
    for (int k = 0; k < count; k++) {
        double weight = 1;
        for (int j = 0; j < count; j++)
            if (j != k)
                weight *= (time_of(x, i) - time_of(x, at[j])) / (time_of(x, at[k]) - time_of(x, at[j]));
        sum += weight * value(x, at[k]);
    }
    return value(x, i) - sum;
}

/* Value i minus the cubic polynomial through four neighbours. `before` and `after` are the nearest neighbours
 * on the two sides. NaN: one side has no neighbour, or there are fewer than four neighbours. */
static double difference(const trace *x, size_t i, size_t before, size_t after) {
    if (before >= x->n || after >= x->n) return (double)NAN;
    size_t at[4] = {x->previous[before], before, after, x->next[after]};
    if (at[0] >= x->n && at[3] < x->n) at[0] = x->next[at[3]];
    if (at[3] >= x->n && at[0] < x->n) at[3] = x->previous[at[0]];
    if (at[0] >= x->n || at[3] >= x->n) return (double)NAN;
    return off_polynomial(x, i, at, 4);
}

static double difference_at(const trace *x, size_t i) {
    return difference(x, i, x->previous[i], x->next[i]);
}

/* ---- scales ---- */

/* Standard deviation of the differences of rows first .. end - 1, from their median. */
static double spread(const trace *x, size_t first, size_t end) {
    size_t count = 0;
    for (size_t i = first; i < end; i++)
        if (!isnan(x->off[i])) x->work[count++] = fabs(x->off[i]);
    return count > 0 ? lg_median(x->work, count) / 0.6745 : INFINITY;
}

static double smallest_step(const trace *x) {
    double least = INFINITY;
    for (size_t i = 0; i < x->n; i++) {
        if (isnan(value(x, i)) || x->next[i] >= x->n) continue;
        const double step = fabs(value(x, x->next[i]) - value(x, i));
        if (step > 0 && step < least) least = step;
    }
    return least;
}

/* ---- outliers ---- */

/* Value i, which is left out, minus the polynomial through the nearest values that are not. */
static double difference_of(const trace *x, size_t i) {
    size_t before = x->previous[i], after = x->next[i];
    while (before < x->n && x->out[before]) before = x->previous[before];
    while (after < x->n && x->out[after]) after = x->next[after];
    return difference(x, i, before, after);
}

/* The largest difference of the BESIDE values before and after row i, which is left out. */
static double rest_beside(const trace *x, size_t i) {
    double rest = 0;
    for (int side = 0; side < 2; side++) {
        const size_t *way = side == 0 ? x->previous : x->next;
        size_t at = way[i];
        for (int k = 0; k < BESIDE && at < x->n; at = way[at]) {
            if (x->out[at]) continue;
            const double off = fabs(difference_at(x, at));
            rest = fmax(rest, isnan(off) ? 0 : off);
            k++;
        }
    }
    return rest;
}

/* The least distance of value i, which is left out, from the parabola through the three and the cubic through
 * the four nearest values of one side. */
static double one_sided(const trace *x, size_t i) {
    double least = INFINITY;
    for (int side = 0; side < 2; side++) {
        const size_t *way = side == 0 ? x->previous : x->next;
        size_t at[4];
        int count = 0;
        for (size_t j = way[i]; j < x->n && count < 4; j = way[j]) {
            if (x->out[j]) continue;
            at[count++] = j;
            if (count >= 3) least = fmin(least, fabs(off_polynomial(x, i, at, count)));
        }
    }
    return least;
}

/* Whether rows i and j (i alone if j is i) are outliers by more than `distance`. Then they are left out. */
static bool try_outliers(trace *x, size_t i, size_t j, double distance, double deviation) {
    leave_out(x, i);
    if (j != i) leave_out(x, j);
    double least = fmin(fabs(difference_of(x, i)), fabs(difference_of(x, j)));
    if (isnan(difference_of(x, i)) || isnan(difference_of(x, j))) least = 0;
    const double rest = fmax(rest_beside(x, i), rest_beside(x, j)),
                 alone = fmin(one_sided(x, i), one_sided(x, j)),
                 tolerated = fmax(small * least, near * deviation),
                 bend = x->stepped[i] || x->stepped[j] ? fmax(bent * least, tolerated) : tolerated;
    if (least > distance && rest <= tolerated && alone > bend) return true;
    if (j != i) put_back(x, j);
    put_back(x, i);
    return false;
}

/* Tries row i alone, then together with each row that is so near that one hides the other. */
static bool try_row(trace *x, size_t i, double scale, double least) {
    const size_t low = i > AROUND ? i - AROUND : 0, high = i + AROUND < x->n ? i + AROUND + 1 : x->n;
    if (x->out[i]) return false;
    const double deviation = fmax(scale, spread(x, low, high)), distance = fmax(far * deviation, least);
    if (!(fabs(x->off[i]) > 0.5 * distance)) return false;
    if (try_outliers(x, i, i, distance, deviation)) return true;
    for (int side = 0; side < 2; side++) {
        const size_t *way = side == 0 ? x->previous : x->next;
        size_t j = way[i];
        for (int k = 0; k < 2 * BESIDE && j < x->n; k++, j = way[j])
            if (try_outliers(x, i, j, distance, deviation)) return true;
    }
    return false;
}

typedef struct candidate {
    double off;
    size_t row;
} candidate;

static int by_size(const void *a, const void *b) {
    const candidate *x = a, *y = b;
    if (x->off != y->off) return x->off < y->off ? 1 : -1;
    return (x->row > y->row) - (x->row < y->row);
}

/* Marks the outliers of a part in x->out, the largest first, and returns how many. `all` (n) is work. */
static size_t find_outliers(trace *x, candidate *all) {
    size_t candidates = 0, count = 0;
    x->values = 0;
    link_values(x);
    for (size_t i = 0; i < x->n; i++) {
        x->out[i] = false;
        x->off[i] = isnan(value(x, i)) ? (double)NAN : difference_at(x, i);
        x->values += !isnan(value(x, i));
    }
    if (x->values < FEWEST) return 0;
    const double scale = spread(x, 0, x->n), least = steps * smallest_step(x);
    for (size_t i = 0; i < x->n; i++)
        if (fabs(x->off[i]) > 0.5 * fmax(far * scale, least))
            all[candidates++] = (candidate){fabs(x->off[i]), i};
    qsort(all, candidates, sizeof *all, by_size);
    for (size_t k = 0; k < candidates; k++) (void)try_row(x, all[k].row, scale, least);
    for (size_t i = 0; i < x->n; i++) count += x->out[i];
    return count;
}

/* ---- steps of inputs ---- */

static bool keeps(const trace *x, size_t i, uint32_t column) {
    return lg_log_row(x->table, x->first + i)[column] == lg_log_row(x->table, x->first + i - 1)[column];
}

/* Marks rows next to a change of an input that mostly keeps its value. */
static void mark_steps(trace *x) {
    for (size_t i = 0; i < x->n; i++) x->stepped[i] = false;
    for (uint32_t c = 0; c < x->table->columns; c++) {
        size_t still = 0;
        if (x->table->machine->columns[c].role != LG_LOG_INPUT) continue;
        for (size_t i = 1; i < x->n; i++) still += keeps(x, i, c);
        for (size_t i = 1; i < x->n && 2 * still >= x->n; i++)
            for (size_t k = i - 1; k < x->n && k <= i + AROUND && !keeps(x, i, c); k++) x->stepped[k] = true;
    }
}

/* ---- columns ---- */

/* Positions of lines and angles, and velocities. An acceleration jumps and comes back where bodies touch. */
static bool is_continuous(const lg_log_table *t, uint32_t column) {
    const lg_log_column *c = &t->machine->columns[column];
    const bool motion = c->role == LG_LOG_POSITION || c->role == LG_LOG_VELOCITY;
    return motion && !t->machine->machine.accelerations && t->machine->coordinates[c->index].attitudes == 0;
}

/* How many outliers there are, and the first of them. */
typedef struct found {
    size_t count, row;
    double value;
} found;

/* Counts the outliers of a part, and leaves them out of the table if `out`. */
static void take(trace *x, bool out, found *all) {
    for (size_t i = 0; i < x->n; i++) {
        if (!x->out[i]) continue;
        double *cell = &lg_log_row(x->table, x->first + i)[x->column];
        if (all->count++ == 0) all->row = x->first + i, all->value = *cell;
        if (out) *cell = (double)NAN;
    }
}

/* The range without outliers. The range of an angle stays: it was measured before angles were unwrapped. */
static void measure_again(const lg_log_table *t, uint32_t column) {
    const lg_log_column *c = &t->machine->columns[column];
    const bool angle = t->machine->machine.coordinates[c->index].kind == LG_COORDINATE_ANGLE;
    lg_log_statistics *s = &t->out->columns[column];
    if (c->role == LG_LOG_POSITION && angle) return;
    s->low = INFINITY, s->high = -INFINITY;
    for (size_t row = 0; row < t->rows; row++) {
        s->low = fmin(s->low, lg_log_row(t, row)[column]);
        s->high = fmax(s->high, lg_log_row(t, row)[column]);
    }
}

static lg_status mend_column(lg_log_table *t, trace *x, candidate *all) {
    const char *name = t->machine->columns[x->column].name;
    found out = {0}, kept = {0};
    for (size_t part = 0; part < t->parts; part++) {
        x->first = t->first[part];
        x->n = t->first[part + 1] - x->first;
        mark_steps(x);
        const bool few = (double)find_outliers(x, all) <= most * (double)x->values;
        take(x, few, few ? &out : &kept);
    }
    t->out->columns[x->column].outliers = out.count;
    if (kept.count > 0)
        LG_TRY(lg_log_warn_at(
            t, kept.row,
            "column %s: %zu values jump away from their neighbours and return, the first is %.6g; "
            "these are more than %g %% of a part, so they are kept",
            name, kept.count, kept.value, 100 * most));
    if (out.count == 0) return LG_OK;
    measure_again(t, x->column);
    return lg_log_warn_at(
        t, out.row,
        "column %s: %.6g is an outlier: the value jumps away from its neighbours and returns; it is "
        "the first of %zu outliers, which are left out",
        name, out.value, out.count);
}

lg_status lg_log_leave_out_spikes(lg_log_table *t) {
    trace x = {.table = t};
    size_t longest = 0;
    for (size_t part = 0; part < t->parts; part++)
        if (t->first[part + 1] - t->first[part] > longest) longest = t->first[part + 1] - t->first[part];
    candidate *all = lg_alloc(t->context, longest, sizeof *all);
    x.previous = lg_alloc(t->context, 2 * longest, sizeof *x.previous);
    x.off = lg_alloc(t->context, 2 * longest, sizeof *x.off);
    x.out = lg_alloc(t->context, 2 * longest, sizeof *x.out);
    lg_status status = LG_OUT_OF_MEMORY;
    if (all != NULL && x.previous != NULL && x.off != NULL && x.out != NULL) {
        x.next = x.previous + longest;
        x.work = x.off + longest;
        x.stepped = x.out + longest;
        status = LG_OK;
        for (x.column = 0; x.column < t->columns && status == LG_OK; x.column++)
            if (is_continuous(t, x.column)) status = mend_column(t, &x, all);
    }
    lg_free(t->context, all);
    lg_free(t->context, x.previous);
    lg_free(t->context, x.off);
    lg_free(t->context, x.out);
    return status;
}
