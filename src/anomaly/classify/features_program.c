/* Features of a window, by the plan of their program. */
#include <math.h>

#include "anomaly/classify/features.h"

lg_var lg_features_chosen(lg_tape *t, const lg_features *f, lg_var x) {
    const uint32_t count = lg_features_channels(f);
    LG_SCRATCH(lg_var, chosen, NULL, count);
    bool all = count == f->channels;
    for (uint32_t i = 0; i < count; i++) all = all && lg_features_channel(f, i) == i;
    if (all || chosen == NULL) return all ? x : LG_NONE;
    for (uint32_t i = 0; i < count; i++) chosen[i] = lg_slice(t, x, 1, lg_features_channel(f, i), 1);
    return count == 1 ? chosen[0] : lg_concat(t, chosen, count, 1);
}

/* ---- the features of a window. work: the plan's memory, then the window in double precision ---- */

size_t lg_features_work_size(const lg_features *f) {
    const size_t numbers = (size_t)f->channels * f->length;
    return f->plan == NULL ? 0 : lg_plan_work_size(f->plan) + numbers * sizeof(double) + LG_ALIGNMENT;
}

lg_status lg_features_compute(const lg_features *f, const float *x, double *out, double *work) {
    LG_NEEDS(NULL, f, x, out, work);
    const size_t n = (size_t)f->channels * f->length;
    char *aligned = (char *)work + -(uintptr_t)work % LG_ALIGNMENT;
    double *window = (double *)(void *)(aligned + lg_plan_work_size(f->plan));
    for (size_t i = 0; i < n; i++) window[i] = (double)x[i];
    lg_plan_eval(f->plan, (const void *const[]){window}, (void *const[]){out}, aligned);
    for (uint32_t i = 0; i < f->count; i++)
        if (!isfinite(out[i])) return LG_NOT_FINITE;
    return LG_OK;
}
