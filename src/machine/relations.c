/* Machines: correlations of the numbers' errors, and directions that the logs leave open. */
#include <math.h>
#include <string.h>

#include "machine/internal.h"

static void correlate(size_t n, const double *covariance, const lg_identified *numbers, double *out) {
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) {
            const double product = covariance[i * n + i] * covariance[j * n + j];
            const bool told = isfinite(numbers[i].error) && isfinite(numbers[j].error) && product > 0.0;
            out[i * n + j] = i == j ? 1.0 : told ? covariance[i * n + j] / sqrt(product) : 0.0;
        }
}

/* ---- open directions ---- */

/* Replaces rows (m, n) by rows with the same span, each with one number that no other row has: Gauss-Jordan
 * elimination with the largest element as the pivot. Elements below 0.02 of the largest in their row become
 * 0. */
static void reduce(size_t m, size_t n, double *rows) {
    static const double nothing = 0.02;
    for (size_t k = 0; k < m; k++) {
        size_t row = k, column = 0;
        for (size_t i = k; i < m; i++)
            for (size_t j = 0; j < n; j++)
                /* Takes the first of nearly equal elements, so that pivots are the earlier numbers. */
                if (fabs(rows[i * n + j]) > 1.001 * fabs(rows[row * n + column])) row = i, column = j;
        for (size_t j = 0; j < n; j++) {
            const double swapped = rows[k * n + j];
            rows[k * n + j] = rows[row * n + j];
            rows[row * n + j] = swapped;
        }
        const double pivot = rows[k * n + column];
        for (size_t j = 0; j < n; j++) rows[k * n + j] /= pivot;
        for (size_t i = 0; i < m; i++) {
            const double factor = i == k ? 0.0 : rows[i * n + column];
            for (size_t j = 0; j < n; j++) rows[i * n + j] -= factor * rows[k * n + j];
        }
    }
    for (size_t k = 0; k < m; k++) {
        double largest = 0.0;
        for (size_t j = 0; j < n; j++)
            if (fabs(rows[k * n + j]) > 1.001 * fabs(largest)) largest = rows[k * n + j];
        for (size_t j = 0; j < n; j++) {
            rows[k * n + j] /= largest;
            if (fabs(rows[k * n + j]) < nothing) rows[k * n + j] = 0.0;
        }
    }
}

lg_status lg_machine_relate(const lg_context *context, size_t count, double *covariance,
                            lg_identification *out) {
    /* A direction is open if its relative variance is above 1: its numbers may then be off by as much as
     * their own values. */
    static const double open = 1.0;
    if (out->correlations != NULL) correlate(count, covariance, out->numbers, out->correlations);
    out->open_count = 0;
    if (out->open == NULL) return LG_OK;
    LG_TRY_SCRATCH(double, variances, context, count, LG_OUT_OF_MEMORY);
    const lg_status status = lg_fit_eigen(context, count, covariance, variances);
    for (size_t k = count; status == LG_OK && k-- > 0 && variances[k] > open;)
        memcpy(out->open + count * out->open_count++, covariance + k * count, count * sizeof *covariance);
    if (status == LG_OUT_OF_MEMORY) return status;
    reduce(out->open_count, count, out->open);
    return LG_OK;
}

/* ---- sentences ---- */

/* Lists the names of the numbers that move: "a, b and c". With `changes` each has its relative change. */
static void list_moving(const lg_identified *numbers, size_t count, const double *row, size_t moving,
                        bool changes, char *text, size_t size) {
    size_t told = 0;
    for (size_t i = 0; i < count; i++) {
        if (row[i] == 0.0) continue;
        lg_append(text, size, "%s%s", told == 0 ? "" : told + 1 == moving ? " and " : ", ", numbers[i].name);
        if (changes) lg_append(text, size, " by %+.2g %%", row[i]);
        told++;
    }
}

size_t lg_identification_sentence(const lg_identification *of, size_t count, size_t row, char *text,
                                  size_t size) {
    static const double close = 0.02;
    const double *move = of->open + row * count;
    size_t moving = 0, up = 0, down = 0;
    for (size_t i = 0; i < count; i++) {
        moving += move[i] != 0.0;
        up += fabs(move[i] - 1.0) < close;
        down += fabs(move[i] + 1.0) < close;
    }
    const bool equal = up == moving || down == moving, pair = moving == 2 && up == 1 && down == 1;
    if (size == 0) return moving;
    text[0] = '\0';
    list_moving(of->numbers, count, move, moving, !equal && !pair, text, size);
    lg_append(text, size, "%s: give one of them as known",
              pair          ? " appear only as a product"
              : !equal      ? " can change together without changing what the logs show"
              : moving == 2 ? " appear only as a ratio"
                            : " are determined only up to a common factor");
    return moving;
}
