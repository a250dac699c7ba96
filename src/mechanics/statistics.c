/* Statistics of many numbers in fixed memory. The order in which numbers are added does not matter. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "core/clean.h"
#include "core/exact_sum.h"
#include "liegrad/ensemble.h"

typedef struct cell {
    uint64_t count;
    double least, largest;
    lg_statistics_range range;
    lg_exact_sum sum, square; /* sums of (x - centre) and of (x - centre)^2 */
} cell;

struct lg_statistics {
    const lg_context *context;
    size_t rows, columns, bins;
    bool *logarithmic; /* (columns) */
    cell *cells;       /* (rows, columns) */
    uint64_t *bin;     /* (rows, columns, bins + 2) */
};

static cell *cell_of(const lg_statistics *s, size_t row, size_t column) {
    return &s->cells[row * s->columns + column];
}

static uint64_t *bins_of(const lg_statistics *s, size_t row, size_t column) {
    return s->bin + (row * s->columns + column) * (s->bins + 2);
}

lg_status lg_statistics_create(const lg_context *context, size_t rows, size_t columns, size_t bins,
                               const bool *logarithmic, lg_statistics **out) {
    if (!out || rows < 1 || columns < 1 || bins < 1 || bins > 65536) return LG_INVALID_ARGUMENT;
    if (rows > SIZE_MAX / sizeof(cell) / (bins + 2) / columns) return LG_OUT_OF_MEMORY;
    lg_statistics *s = lg_alloc(context, 1, sizeof(*s));
    if (!s) return LG_OUT_OF_MEMORY;
    *s = (lg_statistics){.context = context, .rows = rows, .columns = columns, .bins = bins};
    if (LG_ALLOC_ALL(context, LG_ARRAY(s->logarithmic, columns), LG_ARRAY(s->cells, rows * columns),
                     LG_ARRAY(s->bin, rows * columns * (bins + 2))) != LG_OK) {
        lg_statistics_destroy(s);
        return LG_OUT_OF_MEMORY;
    }
    if (logarithmic) memcpy(s->logarithmic, logarithmic, columns * sizeof(*logarithmic));
    for (size_t i = 0; i < rows * columns; i++)
        s->cells[i] = (cell){.least = INFINITY, .largest = -INFINITY, .range = {0.0, 1.0, 0.0}};
    *out = s;
    return LG_OK;
}

void lg_statistics_destroy(lg_statistics *statistics) {
    if (!statistics) return;
    LG_FREE_ALL(statistics->context, statistics->logarithmic, statistics->cells, statistics->bin, statistics);
}

lg_status lg_statistics_create_like(const lg_statistics *s, lg_statistics **out) {
    LG_NEEDS(NULL, s, out);
    LG_TRY(lg_statistics_create(s->context, s->rows, s->columns, s->bins, s->logarithmic, out));
    for (size_t i = 0; i < s->rows * s->columns; i++) (*out)->cells[i].range = s->cells[i].range;
    return LG_OK;
}

/* ---- ranges ---- */

/* x, or its logarithm in a logarithmic column. */
static double scaled(bool logarithmic, double x) {
    return logarithmic ? log(x > DBL_MIN ? x : DBL_MIN) : x;
}

void lg_statistics_set_range(lg_statistics *statistics, size_t row, size_t column,
                             const lg_statistics_range *range) {
    cell_of(statistics, row, column)->range = *range;
}

lg_statistics_range lg_statistics_range_of(const lg_statistics *s, size_t column, const double *values,
                                           size_t count) {
    const bool logarithmic = s->logarithmic[column];
    double low = INFINITY, high = -INFINITY, sum = 0.0;
    size_t n = 0;
    for (size_t i = 0; i < count; i++) {
        if (!isfinite(values[i])) continue;
        const double x = scaled(logarithmic, values[i]);
        low = x < low ? x : low;
        high = x > high ? x : high;
        sum += values[i];
        n++;
    }
    if (n == 0) return (lg_statistics_range){0.0, 1.0, 0.0};
    double more = 0.25 * (high - low);
    if (!(more > 1e-12 * fmax(fabs(low), fabs(high))))
        more = fmax(1e-12 * fmax(fabs(low), fabs(high)), 1e-300);
    const double centre = sum / (double)n;
    return (lg_statistics_range){low - more, high + more, isfinite(centre) ? centre : 0.0};
}

/* ---- adding numbers ---- */

static size_t bin_of(const lg_statistics *s, const lg_statistics_range *range, double x) {
    const double place = (x - range->low) / (range->high - range->low) * (double)s->bins;
    if (!(place >= 0.0)) return 0;
    return place < (double)s->bins ? 1 + (size_t)place : s->bins + 1;
}

void lg_statistics_add(lg_statistics *statistics, size_t row, size_t column, const double *values,
                       size_t count) {
    cell *at = cell_of(statistics, row, column);
    uint64_t *bins = bins_of(statistics, row, column);
    const bool logarithmic = statistics->logarithmic[column];
    double sum = 0.0, square = 0.0;
    for (size_t i = 0; i < count; i++) {
        const double x = values[i], z = x - at->range.centre;
        if (!isfinite(x)) continue;
        sum += z;
        square += z * z;
        at->least = x < at->least ? x : at->least;
        at->largest = x > at->largest ? x : at->largest;
        at->count++;
        bins[bin_of(statistics, &at->range, scaled(logarithmic, x))]++;
    }
    if (isfinite(sum)) lg_exact_add(&at->sum, sum);
    if (isfinite(square)) lg_exact_add(&at->square, square);
}

/* An addition changes a part of an exact sum by at most 2^32: the largest |part| after 2^30 additions. */
#define LARGEST_PART ((int64_t)1 << 62)

static bool sums_fit(const lg_exact_sum *a, const lg_exact_sum *b) {
    bool fit = true;
    for (int i = 0; i < LG_EXACT_PARTS; i++) {
        const int64_t x = a->part[i], y = b->part[i];
        fit = fit && (y >= 0 ? x <= LARGEST_PART - y : x >= -LARGEST_PART - y);
    }
    return fit;
}

lg_status lg_statistics_merge(lg_statistics *into, const lg_statistics *from) {
    LG_NEEDS(NULL, into, from);
    const size_t cells = into->rows * into->columns;
    if (into->rows != from->rows || into->columns != from->columns || into->bins != from->bins ||
        memcmp(into->logarithmic, from->logarithmic, into->columns * sizeof *into->logarithmic) != 0)
        return LG_SHAPE;
    for (size_t i = 0; i < cells; i++)
        if (memcmp(&into->cells[i].range, &from->cells[i].range, sizeof(lg_statistics_range)) != 0)
            return LG_SHAPE;
    for (size_t i = 0; i < cells; i++) {
        const cell *a = &into->cells[i], *b = &from->cells[i];
        if (a->count > UINT64_MAX - b->count || !sums_fit(&a->sum, &b->sum) ||
            !sums_fit(&a->square, &b->square))
            return LG_CHECK_FAILED;
    }
    for (size_t i = 0; i < cells; i++) {
        cell *a = &into->cells[i];
        const cell *b = &from->cells[i];
        a->count += b->count;
        a->least = b->least < a->least ? b->least : a->least;
        a->largest = b->largest > a->largest ? b->largest : a->largest;
        lg_exact_merge(&a->sum, &b->sum);
        lg_exact_merge(&a->square, &b->square);
    }
    for (size_t i = 0; i < cells * (into->bins + 2); i++) into->bin[i] += from->bin[i];
    return LG_OK;
}

/* ---- queries ---- */

lg_statistics_cell lg_statistics_of(const lg_statistics *s, size_t row, size_t column) {
    const cell *at = cell_of(s, row, column);
    const double n = (double)at->count, width = (at->range.high - at->range.low) / (double)s->bins;
    lg_statistics_cell out = {at->count, NAN, NAN, NAN, NAN, width};
    if (at->count == 0) return out;
    const double sum = lg_exact_value(&at->sum), square = lg_exact_value(&at->square);
    const double far = fmax(at->largest - at->range.centre, at->range.centre - at->least);
    if (isfinite(n * far)) out.mean = at->range.centre + sum / n;
    out.least = at->least;
    out.largest = at->largest;
    if (at->count > 1 && isfinite(n * far * far))
        out.deviation = sqrt(fmax(square - sum * (sum / n), 0.0) / (n - 1.0));
    return out;
}

/* Boundary number `end` between the bins, in the unit of the column, clamped to [least, largest]. */
static double bin_end(const lg_statistics *s, const cell *at, size_t column, size_t end) {
    const double width = (at->range.high - at->range.low) / (double)s->bins;
    const double x = at->range.low + (double)end * width, value = s->logarithmic[column] ? exp(x) : x;
    return fmin(fmax(value, at->least), at->largest);
}

double lg_statistics_quantile(const lg_statistics *s, size_t row, size_t column, double p) {
    const cell *at = cell_of(s, row, column);
    const uint64_t *bins = bins_of(s, row, column);
    if (at->count == 0 || !(p >= 0.0 && p <= 1.0)) return NAN;
    const double rank = p * (double)at->count;
    double before = 0.0;
    size_t i = 0;
    for (; i < s->bins + 1 && before + (double)bins[i] < rank; i++) before += (double)bins[i];
    const double low = i == 0 ? at->least : bin_end(s, at, column, i - 1);
    const double high = i == s->bins + 1 ? at->largest : bin_end(s, at, column, i);
    return bins[i] > 0 ? low + (high - low) * fmin((rank - before) / (double)bins[i], 1.0) : low;
}

const uint64_t *lg_statistics_bins(const lg_statistics *statistics, size_t row, size_t column) {
    return bins_of(statistics, row, column);
}

lg_statistics_range lg_statistics_range_at(const lg_statistics *statistics, size_t row, size_t column) {
    return cell_of(statistics, row, column)->range;
}

/* ---- archives: one array per member of the cells ---- */

typedef struct member {
    const char *name;
    size_t offset, count; /* offset in a cell; number of elements of 8 bytes */
    lg_element type;
} member;

static const member members[] = {
    {"count", offsetof(cell, count), 1, LG_ELEMENT_U64},
    {"least", offsetof(cell, least), 1, LG_ELEMENT_F64},
    {"largest", offsetof(cell, largest), 1, LG_ELEMENT_F64},
    {"low", offsetof(cell, range.low), 1, LG_ELEMENT_F64},
    {"high", offsetof(cell, range.high), 1, LG_ELEMENT_F64},
    {"centre", offsetof(cell, range.centre), 1, LG_ELEMENT_F64},
    {"sum", offsetof(cell, sum), LG_EXACT_PARTS, LG_ELEMENT_I64},
    {"square", offsetof(cell, square), LG_EXACT_PARTS, LG_ELEMENT_I64},
};

/* Writes the arrays to an archive, or reads them from one; the other one is NULL. */
static lg_status pass_arrays(lg_statistics *s, const lg_archive_writer *to, const lg_archive_reader *from) {
    const size_t cells = s->rows * s->columns;
    uint64_t dims[3] = {s->rows, s->columns, s->bins + 2};
    LG_TRY_SCRATCH(char, values, s->context, cells * 8 * LG_EXACT_PARTS, LG_OUT_OF_MEMORY);
    LG_TRY(to != NULL ? to->array(to->user, "bins", LG_ELEMENT_U64, 3, dims, s->bin)
                      : from->array(from->user, "bins", LG_ELEMENT_U64, 3, dims, s->bin));
    for (const member *m = members; m < members + LG_COUNT(members); m++) {
        const size_t size = 8 * m->count, rank = m->count > 1 ? 3 : 2;
        dims[2] = m->count;
        if (from != NULL) LG_TRY(from->array(from->user, m->name, m->type, rank, dims, values));
        for (size_t i = 0; i < cells; i++) {
            char *at = (char *)&s->cells[i] + m->offset, *value = values + i * size;
            memcpy(to != NULL ? value : at, to != NULL ? at : value, size);
        }
        if (to != NULL) LG_TRY(to->array(to->user, m->name, m->type, rank, dims, values));
    }
    return LG_OK;
}

lg_status lg_statistics_save(const lg_statistics *s, const lg_archive_writer *archive) {
    LG_NEEDS(NULL, s, archive);
    return pass_arrays((lg_statistics *)(uintptr_t)s, archive, NULL); /* only read */
}

/* Whether a sum of `count` numbers, added singly or in blocks, can have parts of this size. */
static bool is_sum(const lg_exact_sum *sum, uint64_t count) {
    const uint64_t most = (uint64_t)LARGEST_PART >> 32;
    const int64_t largest = (int64_t)(count < most ? count : most) << 32;
    bool is = true;
    for (int i = 0; i < LG_EXACT_PARTS; i++) is = is && sum->part[i] <= largest && sum->part[i] >= -largest;
    return is;
}

static bool is_cell(const lg_statistics *s, size_t index) {
    const cell *at = &s->cells[index];
    const uint64_t *bins = s->bin + index * (s->bins + 2);
    uint64_t left = at->count;
    for (size_t i = 0; i < s->bins + 2; i++) {
        if (bins[i] > left) return false;
        left -= bins[i];
    }
    const bool range = at->range.low < at->range.high && isfinite(at->range.centre);
    const bool ends =
        at->count == 0 || (at->least <= at->largest && isfinite(at->least) && isfinite(at->largest));
    return left == 0 && range && ends && is_sum(&at->sum, at->count) && is_sum(&at->square, at->count);
}

lg_status lg_statistics_load(lg_statistics *s, const lg_archive_reader *archive) {
    LG_NEEDS(NULL, s, archive);
    LG_TRY(pass_arrays(s, NULL, archive));
    for (size_t i = 0; i < s->rows * s->columns; i++)
        if (!is_cell(s, i)) return LG_CHECK_FAILED;
    return LG_OK;
}
