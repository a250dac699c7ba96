/* Finds cells of a table that lie far from the other cells of their column. Let m be the median of the
 * column, and D that of |x - m| over the cells that differ from m. The cells with |x - m| > 30 D are far if
 * together they make up more than half of the sum of (x - m)^2 and are few: at most 2 to 5 (1 % of the
 * column), or 0.1 % if this is more. More are far only if most of them are one value (a code such as -9999)
 * and they are at most a tenth of the column; of a second mode or a heavy tail the few farthest are, if
 * they make up 0.8 of it. */
#include <math.h>
#include <stdlib.h>

#include "core/clean.h"
#include "core/median.h"
#include "table/internal.h"

/* Half of the distance, because the distance itself may overflow. */
static double half_distance(double x, double median) {
    return fabs(0.5 * x - 0.5 * median);
}

bool lg_table_is_far(const lg_table_far *far, double x) {
    return half_distance(x, far->median) > far->limit;
}

static size_t count_beyond(const double *distance, size_t rows, double limit) {
    size_t beyond = 0;
    while (beyond < rows && distance[rows - 1 - beyond] > limit) beyond++;
    return beyond;
}

/* Raises the limit such that few cells are beyond it, unless these are a code such as -9999: most of them
 * equal, and at most a tenth of the cells. Returns the part of the sum of squares that far cells must have. x
 * and distance (rows) are sorted. */
static double raise_limit(const double *x, const double *distance, size_t rows, lg_table_far *far) {
    enum { PERCENT = 100, LEAST = 2, MOST = 5, PER_MILLE = 1000, CODE = 10 };
    static const double USUAL = 0.5, RAISED = 0.8;
    const size_t percent = rows / PERCENT, per_mille = rows / PER_MILLE;
    const size_t few = per_mille > MOST  ? per_mille
                       : percent > MOST  ? MOST
                       : percent > LEAST ? percent
                                         : LEAST;
    const size_t beyond = count_beyond(distance, rows, far->limit), middle = beyond / 2;
    size_t equal = 0;
    far->single = beyond <= few;
    if (far->single) return USUAL;
    /* The median of the cells beyond the limit, which are the first and the last ones. */
    const bool low = x[middle] < far->median && lg_table_is_far(far, x[middle]);
    const double code = x[low ? middle : rows - beyond + middle];
    for (size_t i = 0; i < rows; i++) equal += x[i] == code;
    if (2 * equal > beyond && beyond <= rows / CODE) return USUAL;
    far->limit = distance[rows - 1 - few];
    return RAISED;
}

/* Cells beyond the limit count as far only if they have more than this part of the sum of squared
 * distances. */
static void count_far(const double *distance, size_t rows, double part_of_all, lg_table_far *far) {
    const double largest = distance[rows - 1];
    double all = 0.0, beyond = 0.0;
    far->count = count_beyond(distance, rows, far->limit);
    for (size_t i = 0; i < rows && far->count > 0; i++) {
        const double part = distance[i] / largest;
        all += part * part;
        if (i >= rows - far->count) beyond += part * part;
    }
    if (beyond > part_of_all * all) return;
    far->count = 0;
    far->limit = INFINITY;
}

lg_status lg_table_find_far(const lg_context *context, const double *values, size_t stride, size_t rows,
                            lg_table_far *out) {
    static const double TIMES = 30.0;
    if (values == NULL || out == NULL || stride == 0 || rows == 0) return LG_INVALID_ARGUMENT;
    LG_TRY_SCRATCH(double, x, context, 2 * rows, LG_OUT_OF_MEMORY);
    double *distance = x + rows;
    lg_table_far made = {.limit = INFINITY};
    size_t still = 0;
    for (size_t i = 0; i < rows; i++) x[i] = values[i * stride];
    qsort(x, rows, sizeof *x, lg_compare_doubles);
    made.median = x[rows / 2];
    for (size_t i = 0; i < rows; i++) distance[i] = half_distance(x[i], made.median);
    qsort(distance, rows, sizeof *distance, lg_compare_doubles);
    while (still < rows && distance[still] == 0.0) still++;
    if (still < rows) made.limit = TIMES * distance[still + (rows - still) / 2];
    count_far(distance, rows, raise_limit(x, distance, rows, &made), &made);
    while (half_distance(values[made.farthest * stride], made.median) < distance[rows - 1]) made.farthest++;
    *out = made;
    return LG_OK;
}
