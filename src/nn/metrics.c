/* Confusion matrices, metrics computed from them, and receiver operating characteristics. */
#include <math.h>
#include <string.h>

#include "core/clean.h"
#include "liegrad/series.h"

uint32_t lg_metrics_class(const double *score, uint32_t classes) {
    if (classes == 2) return score[1] >= score[0];
    uint32_t best = 0;
    for (uint32_t k = 1; k < classes; k++)
        if (score[k] > score[best]) best = k;
    return best;
}

/* ---- confusion ---- */

void lg_metrics_confusion(const uint32_t *truth, const uint32_t *given, size_t n, uint32_t classes,
                          uint64_t *confusion) {
    memset(confusion, 0, (size_t)classes * classes * sizeof *confusion);
    for (size_t i = 0; i < n; i++)
        if (truth[i] < classes && given[i] < classes) confusion[(size_t)truth[i] * classes + given[i]]++;
}

static double ratio(double a, double b) {
    return b > 0.0 ? a / b : 0.0;
}

lg_metrics lg_metrics_of(const uint64_t *confusion, uint32_t classes, uint32_t healthy) {
    lg_metrics m = {.false_positive_rate = NAN};
    const uint32_t left_out = classes != 2 ? LG_NO_CLASS : healthy == 1 ? 1 : 0;
    double all = 0.0, sum = 0.0, count = 0.0;
    for (uint32_t k = 0; k < classes; k++) {
        const double right = (double)confusion[(size_t)k * classes + k];
        double occurs = 0.0, given = 0.0; /* windows that have the class, or were given it */
        for (uint32_t j = 0; j < classes; j++) {
            occurs += (double)confusion[(size_t)k * classes + j];
            given += (double)confusion[(size_t)j * classes + k];
        }
        all += occurs;
        sum += right;
        if (k == healthy && occurs > 0.0) m.false_positive_rate = (occurs - right) / occurs;
        if (k == left_out || occurs + given == 0.0) continue;
        /* With precision p and recall r: f1 = 2 p r/(p + r) = 2 right/(occurs + given). */
        m.precision += ratio(right, given);
        m.recall += ratio(right, occurs);
        m.f1 += ratio(2.0 * right, occurs + given);
        count++;
    }
    m.accuracy = ratio(sum, all);
    m.precision /= count;
    m.recall /= count;
    m.f1 /= count;
    return m;
}

/* ---- receiver operating characteristic ---- */

/* The number that scores are sorted by. NaN becomes -infinity: such a window is called positive last. */
static double key_of(double score) {
    return isnan(score) ? -INFINITY : score;
}

/* Moves order[root] down in the heap order[0..count-1], which has the lowest score at its top. */
static void sift(uint32_t *order, const double *score, size_t root, size_t count) {
    const uint32_t one = order[root];
    const double key = key_of(score[one]);
    for (size_t child; (child = 2 * root + 1) < count; root = child) {
        if (child + 1 < count && key_of(score[order[child + 1]]) < key_of(score[order[child]])) child++;
        if (key_of(score[order[child]]) >= key) break;
        order[root] = order[child];
    }
    order[root] = one;
}

/* Sorts `order` by falling score; heap sort needs no extra memory. The order of equal scores does not matter,
 * since they form one point of the curve. */
static void sort_falling(uint32_t *order, const double *score, size_t n) {
    for (size_t i = 0; i < n; i++) order[i] = (uint32_t)i;
    for (size_t i = n / 2; i-- > 0;) sift(order, score, i, n);
    for (size_t count = n; count-- > 1;) {
        const uint32_t lowest = order[0];
        order[0] = order[count];
        order[count] = lowest;
        sift(order, score, 0, count);
    }
}

/* The points of lg_metrics_roc with numbers of windows in place of their fractions; returns their number.
 * `alarms` are windows of other classes than `positive`. */
static size_t count_points(const uint32_t *truth, const double *score, size_t n, uint32_t positive,
                           double *alarms, double *hits, double *threshold, uint32_t *order) {
    size_t points = 1;
    sort_falling(order, score, n);
    alarms[0] = hits[0] = 0.0;
    threshold[0] = INFINITY;
    for (size_t i = 0; i < n; points++) {
        threshold[points] = key_of(score[order[i]]);
        alarms[points] = alarms[points - 1];
        hits[points] = hits[points - 1];
        for (; i < n && key_of(score[order[i]]) == threshold[points]; i++)
            (truth[order[i]] == positive ? hits : alarms)[points]++;
    }
    return points;
}

size_t lg_metrics_roc(const uint32_t *truth, const double *score, size_t n, uint32_t positive, double *fpr,
                      double *tpr, double *threshold, uint32_t *order) {
    const size_t points = count_points(truth, score, n, positive, fpr, tpr, threshold, order);
    const double negatives = fpr[points - 1], positives = tpr[points - 1];
    for (size_t i = 0; i < points; i++) fpr[i] = ratio(fpr[i], negatives), tpr[i] = ratio(tpr[i], positives);
    return positives > 0.0 && negatives > 0.0 ? points : 0;
}

lg_status lg_metrics_auc(const lg_context *context, const uint32_t *truth, const double *score, size_t n,
                         uint32_t classes, double *auc) {
    if (truth == NULL || score == NULL || auc == NULL || classes == 0 || n > UINT32_MAX)
        return LG_INVALID_ARGUMENT;
    LG_TRY_SCRATCH(uint32_t, order, context, n, LG_OUT_OF_MEMORY);
    LG_TRY_SCRATCH(double, of_class, context, 4 * n + 3, LG_OUT_OF_MEMORY);
    double *alarms = of_class + n, *hits = alarms + n + 1, *threshold = hits + n + 1, sum = 0.0;
    uint32_t areas = 0;
    for (uint32_t k = classes == 2 ? 1 : 0; k < classes; k++) {
        for (size_t i = 0; i < n; i++) of_class[i] = score[i * classes + k];
        const size_t points = count_points(truth, of_class, n, k, alarms, hits, threshold, order);
        /* The pairs (positive, negative) in which the positive window has the higher score; ties count half
         * (Mann and Whitney 1947). */
        double pairs = 0.0, all = alarms[points - 1] * hits[points - 1];
        for (size_t i = 1; i < points; i++)
            pairs += (alarms[i] - alarms[i - 1]) * 0.5 * (hits[i] + hits[i - 1]);
        if (all > 0.0) sum += pairs / all;
        areas += all > 0.0;
    }
    *auc = areas > 0 ? sum / areas : NAN;
    return LG_OK;
}
