/* Finds cells of a table that lie far from the other cells of their column. */
#include <math.h>
#include <stddef.h>

#include "core/core.h"
#include "liegrad/table.h"

/* The element that would stand at index k if x (n) were sorted; changes the order of x. Hoare's FIND (Comm.
 * ACM 4 (1961) 321). */
static double element_of(double *x, size_t n, size_t k) {
    ptrdiff_t low = 0, high = (ptrdiff_t)n - 1;
    const ptrdiff_t at = (ptrdiff_t)k;
    while (low < high) {
        const double pivot = x[at];
        ptrdiff_t i = low, j = high;
        while (i <= j) {
            while (x[i] < pivot) i++;
            while (x[j] > pivot) j--;
            if (i > j) break;
            const double kept = x[i];
            x[i++] = x[j];
            x[j--] = kept;
        }
        if (j < at) low = i;
        if (i > at) high = j;
    }
    return x[k];
}

/* Half of the distance, because the distance itself may overflow. */
static double half_distance(double x, double median) {
    return fabs(0.5 * x - 0.5 * median);
}

bool lg_table_is_far(const lg_table_far *far, double x) {
    return half_distance(x, far->median) > far->limit;
}

/* Raises the limit such that few cells are beyond it, unless these are a code such as -9999: most of them
 * equal, and at most a tenth of the cells. Returns the part of the sum of squares that far cells must have. x
 * (rows): work space. */
static double raise_limit(const double *values, size_t stride, size_t rows, double *x, lg_table_far *far) {
    enum { PERCENT = 100, LEAST = 2, MOST = 5, PER_MILLE = 1000, CODE = 10 };
    static const double USUAL = 0.5, RAISED = 0.8;
    const size_t percent = rows / PERCENT, per_mille = rows / PER_MILLE;
    const size_t few = per_mille > MOST  ? per_mille
                       : percent > MOST  ? MOST
                       : percent > LEAST ? percent
                                         : LEAST;
    size_t beyond = 0, equal = 0;
    for (size_t i = 0; i < rows; i++)
        if (lg_table_is_far(far, values[i * stride])) x[beyond++] = values[i * stride];
    far->single = beyond <= few;
    if (far->single) return USUAL;
    const double code = element_of(x, beyond, beyond / 2);
    for (size_t i = 0; i < beyond; i++) equal += x[i] == code;
    if (2 * equal > beyond && beyond <= rows / CODE) return USUAL;
    for (size_t i = 0; i < rows; i++) x[i] = half_distance(values[i * stride], far->median);
    far->limit = element_of(x, rows, rows - 1 - few);
    return RAISED;
}

/* Cells beyond the limit count as far only if they have more than this part of the sum of squared
 * distances. */
static void count_far(const double *values, size_t stride, size_t rows, double part_of_all,
                      lg_table_far *far) {
    double largest = 0.0, all = 0.0, beyond = 0.0;
    for (size_t i = 0; i < rows; i++) {
        const double distance = half_distance(values[i * stride], far->median);
        if (distance > largest) largest = distance, far->farthest = i;
    }
    for (size_t i = 0; i < rows && largest > far->limit; i++) {
        const double part = half_distance(values[i * stride], far->median) / largest;
        all += part * part;
        if (!lg_table_is_far(far, values[i * stride])) continue;
        beyond += part * part;
        far->count++;
    }
    if (beyond > part_of_all * all) return;
    far->count = 0;
    far->limit = INFINITY;
}

lg_status lg_table_find_far(const lg_context *context, const double *values, size_t stride, size_t rows,
                            lg_table_far *out) {
    static const double TIMES = 30.0;
    if (values == NULL || out == NULL || stride == 0 || rows == 0) return LG_INVALID_ARGUMENT;
    double *x = lg_alloc(context, rows, sizeof *x);
    if (x == NULL) return LG_OUT_OF_MEMORY;
    lg_table_far made = {.limit = INFINITY};
    size_t moved = 0;
    for (size_t i = 0; i < rows; i++) x[i] = values[i * stride];
    made.median = element_of(x, rows, rows / 2);
    for (size_t i = 0; i < rows; i++) {
        const double distance = half_distance(x[i], made.median);
        if (distance > 0.0) x[moved++] = distance;
    }
    if (moved > 0) made.limit = TIMES * element_of(x, moved, moved / 2);
    count_far(values, stride, rows, raise_limit(values, stride, rows, x, &made), &made);
    lg_free(context, x);
    *out = made;
    return LG_OK;
}
