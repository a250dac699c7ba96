/* Ranges, samples and noise of columns, and splines through inputs. */
#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "core/median.h"
#include "liegrad/geometry.h"
#include "machine/files/log_table.h"

size_t lg_log_file_end(const lg_log_table *table, size_t first) {
    size_t end = first + 1;
    while (end < table->rows && table->origin[end].file == table->origin[first].file) end++;
    return end;
}

void lg_log_range(const lg_log_table *table, uint32_t column) {
    lg_log_statistics *s = &table->out->columns[column];
    s->low = INFINITY, s->high = -INFINITY;
    for (size_t row = 0; row < table->rows; row++) {
        s->low = fmin(s->low, lg_log_row(table, row)[column]);
        s->high = fmax(s->high, lg_log_row(table, row)[column]);
    }
}

size_t lg_log_sample(const lg_log_table *table, uint32_t column, size_t first, size_t end, double *work) {
    size_t count = 0;
    for (size_t row = first; row < end; row += (end - first) / LG_LOG_SAMPLES + 1) {
        const double x = lg_log_row(table, row)[column];
        if (isfinite(x)) work[count++] = x;
    }
    qsort(work, count, sizeof *work, lg_compare_doubles);
    return count;
}

/* ---- noise ---- */

enum { FIRST_ORDER = 3, LAST_ORDER = 6, FEWEST_WINDOWS = 8 };
#define WHITE 0.8 /* residuals of white noise stay as large when the order rises */

/* Columns with one noise: one column, the numbers of an attitude, or (3) the velocity of a direction, whose
 * columns begin at `across` (an attitude: its own). */
typedef struct columns {
    uint32_t first, count, across;
} columns;

/* Divided difference of order k over rows row .. row + k, divided by the root of the sum of its squared
 * coefficients; of several columns the length. White noise makes each component a number with the noise's
 * standard deviation, whatever the time steps are. Noise of a direction makes noise of omega along it, which
 * the loss does not count. */
static double residual(const lg_log_table *table, const columns *of, size_t row, int k) {
    double sums[9] = {0}, squares = 0, length = 0, along = 0;
    const double span = lg_log_time(table, row + (size_t)k) - lg_log_time(table, row);
    for (int i = 0; i <= k; i++) {
        double below = 1;
        const double t = lg_log_time(table, row + (size_t)i);
        for (int j = 0; j <= k; j++)
            if (j != i) below *= (t - lg_log_time(table, row + (size_t)j)) / span;
        for (uint32_t c = 0; c < of->count; c++)
            sums[c] += lg_log_row(table, row + (size_t)i)[of->first + c] / below;
        squares += 1 / (below * below);
    }
    if (of->across != of->first) along = lg_dot3(sums, lg_log_row(table, row + (size_t)k / 2) + of->across);
    for (uint32_t c = 0; c < of->count; c++) length += sums[c] * sums[c];
    length -= along * along;
    return sqrt(length < 0 ? 0 : length / squares); /* NaN stays NaN */
}

/* Robust standard deviation of a component of the residuals of order k; NaN: too few rows. `work` has
 * LG_LOG_SAMPLES numbers. */
static double deviation(const lg_log_table *table, const columns *of, int k, double *work) {
    /* Medians of the length of 1, 2 and 3 standard normal numbers; times sqrt(2) for a matrix, whose nine
     * numbers have the squares of three angles twice. */
    static const double medians[] = {[1] = 0.6744897501960817,
                                     [3] = 1.1774100225154747,
                                     [4] = 1.5381722544550522,
                                     [9] = 2.1753040635163345};
    const size_t stride = table->rows / LG_LOG_SAMPLES + 1;
    size_t count = 0;
    double squares = 0;
    for (size_t part = 0; part < table->parts; part++) {
        for (size_t row = table->first[part]; row + (size_t)k < table->first[part + 1]; row += stride) {
            const double r = residual(table, of, row, k);
            if (!isfinite(r) || count == LG_LOG_SAMPLES) continue;
            squares += r * r;
            work[count++] = r;
        }
    }
    if (count < FEWEST_WINDOWS) return NAN;
    qsort(work, count, sizeof *work, lg_compare_doubles);
    const double median = work[count / 2] / medians[of->count];
    /* In a column of coarsely rounded numbers most residuals are 0. */
    return median > 0 ? median : sqrt(squares / (double)count);
}

lg_log_steps lg_log_steps_of(const lg_log_table *table, uint32_t column, size_t first, size_t end,
                             double *work) {
    const size_t count = lg_log_sample(table, column, first, end, work);
    size_t different = 0, inner = 0, inner_different = 0;
    lg_log_steps out = {.least = INFINITY};
    for (size_t i = 1; i < count; i++) {
        const bool between = work[i] > work[0] && work[i] < work[count - 1];
        const double gap = work[i] - work[i - 1];
        inner += between;
        if (gap > 0) out.least = fmin(out.least, gap), different++, inner_different += between;
    }
    out.coarse = different > 0 && 4 * inner_different <= 3 * inner;
    out.exact = different >= FEWEST_WINDOWS && 2 * different <= count;
    for (size_t i = 1; i < count && out.exact; i++) {
        const double steps = (work[i] - work[i - 1]) / out.least;
        out.exact = fabs(steps - round(steps)) <= 1e-3;
    }
    return out;
}

static void find_noise(const lg_log_table *table, const columns *of, double *work) {
    double noise = deviation(table, of, FIRST_ORDER, work);
    bool at_most = true;
    for (int k = FIRST_ORDER + 1; k <= LAST_ORDER && at_most; k++) {
        const double next = deviation(table, of, k, work);
        at_most = next < WHITE * noise;
        noise = fmin(noise, next); /* the last order is nearer to the noise, too: it has less of the motion */
    }
    for (uint32_t c = of->first; c < of->first + of->count; c++) {
        lg_log_statistics *s = &table->out->columns[c];
        /* Rounding to steps makes an error of step/sqrt(12). In a slow column the error is the same in many
         * rows, and differences do not show it. */
        const lg_log_steps steps = lg_log_steps_of(table, c, 0, table->rows, work);
        const bool rounded = steps.exact && table->machine->columns[c].role != LG_LOG_INPUT;
        const double rounding = rounded ? steps.least / sqrt(12) : 0;
        s->noise = noise, s->noise_at_most = at_most;
        if (rounding > noise) s->noise = rounding, s->noise_at_most = false;
        /* Rounding error is not noise. */
        if (s->noise < 4 * DBL_EPSILON * fmax(fabs(s->low), fabs(s->high))) s->noise = 0;
    }
}

lg_status lg_log_find_noise(const lg_log_table *table) {
    LG_TRY_SCRATCH(double, work, table->context, LG_LOG_SAMPLES, lg_log_no_memory(table));
    for (uint32_t i = 0; i < table->columns; i++)
        if (lg_log_is_value(table, i)) find_noise(table, &(columns){i, 1, i}, work);
    for (uint32_t i = 0; i < table->machine->machine.coordinate_count; i++) {
        const lg_log_coordinate *at = &table->machine->coordinates[i];
        const uint32_t a = at->attitude;
        if (at->attitudes > 0) find_noise(table, &(columns){a, at->attitudes, a}, work);
        if (at->attitudes == 3 && at->velocities == 3)
            find_noise(table, &(columns){at->velocity, 3, a}, work);
    }
    return LG_OK;
}

/* ---- splines ---- */

/* Second derivatives m (n) of the interpolating cubic spline with equal third derivatives on the first two
 * and on the last two intervals. `d` and `c` (n) are work space: the reduced right-hand side and upper
 * diagonal. */
static void second_derivatives(size_t n, const double *t, const double *y, size_t stride, double *m,
                               double *d, double *c) {
    const double first = (t[1] - t[0]) / (t[2] - t[1]);
    const double last = (t[n - 1] - t[n - 2]) / (t[n - 2] - t[n - 3]);
    for (size_t i = 1; i + 1 < n; i++) {
        const double h = t[i] - t[i - 1], g = t[i + 1] - t[i];
        double below = i > 1 ? h : 0, diagonal = 2 * (h + g), above = i + 2 < n ? g : 0;
        const double slopes =
            (y[(i + 1) * stride] - y[i * stride]) / g - (y[i * stride] - y[(i - 1) * stride]) / h;
        if (i == 1) diagonal += h * (1 + first), above -= h * first;   /* m_0 from m_1, m_2 */
        if (i + 2 == n) diagonal += g * (1 + last), below -= g * last; /* the same at the end */
        const double pivot = diagonal - (i > 1 ? below * c[i - 1] : 0);
        c[i] = above / pivot;
        d[i] = (6 * slopes - (i > 1 ? below * d[i - 1] : 0)) / pivot;
    }
    m[n - 2] = d[n - 2];
    for (size_t i = n - 2; i-- > 1;) m[i] = d[i] - c[i] * m[i + 1];
    m[0] = m[1] * (1 + first) - m[2] * first;
    m[n - 1] = m[n - 2] * (1 + last) - m[n - 3] * last;
}

static void spline(size_t n, const double *t, const double *y, size_t stride, size_t inputs, double *work,
                   double *u) {
    double *m = work;
    second_derivatives(n, t, y, stride, m, work + n, work + 2 * n);
    for (size_t i = 0; i + 1 < n; i++) {
        const double h = t[i + 1] - t[i];
        const double square = h * h * m[i] / 2, cube = h * h * (m[i + 1] - m[i]) / 6;
        double *to = u + 4 * i * inputs;
        to[0] = y[i * stride];
        to[inputs] = y[(i + 1) * stride] - y[i * stride] - square - cube;
        to[2 * inputs] = square;
        to[3 * inputs] = cube;
    }
}

void lg_log_act(lg_input_hold hold, size_t n, const double *t, const double *y, size_t stride, size_t inputs,
                double *work, double *u) {
    for (size_t i = 0; i < n; i++) {
        double *to = u + 4 * i * inputs;
        to[0] = y[i * stride];
        if (isnan(to[0])) to[0] = to[-(ptrdiff_t)(4 * inputs)];
        if (hold != LG_HOLD_ZERO && i + 1 < n) to[inputs] = y[(i + 1) * stride] - to[0];
    }
    if (hold == LG_HOLD_CUBIC && n >= 4) spline(n, t, y, stride, inputs, work, u);
}
