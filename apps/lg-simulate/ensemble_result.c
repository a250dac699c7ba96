/* The statistics of an ensemble or of a part of it: how they are merged and freed. */
#include "lg-simulate/ensemble.h"

#include <string.h>

void result_free(result *self) {
    lg_statistics_destroy(self->states);
    lg_statistics_destroy(self->times);
    *self = (result){.what = NULL};
}

const bool *result_logarithmic(const result *self) {
    bool *out = app_keep(self->columns, sizeof *out);
    for (size_t i = 0; i < self->columns; i++) out[i] = strncmp(self->column[i], "drift of ", 9) == 0;
    return out;
}

uint64_t result_failed(const result *self) {
    uint64_t sum = 0;
    for (size_t i = 0; i < STATUSES; i++) sum += self->failed[i];
    return sum;
}

void result_list(result *self, uint64_t member, uint64_t status, double t) {
    size_t at = 0;
    while (at < self->listed && self->who[at][0] < member) at++;
    if (at == LISTED) return;
    if (self->listed < LISTED) self->listed++;
    const size_t behind = self->listed - at - 1;
    memmove(self->who + at + 1, self->who + at, behind * sizeof *self->who);
    memmove(self->when + at + 1, self->when + at, behind * sizeof *self->when);
    self->who[at][0] = member;
    self->who[at][1] = status;
    self->when[at] = t;
}

lg_status result_merge(result *into, const result *from, lg_error *error) {
    if (strcmp(into->what, from->what) != 0)
        return lg_fail(error, LG_FORMAT, "it is a part of another ensemble: %.200s", from->what);
    lg_status status = lg_statistics_merge(into->states, from->states);
    if (status == LG_OK && into->times != NULL) status = lg_statistics_merge(into->times, from->times);
    if (status == LG_CHECK_FAILED || into->steps > UINT64_MAX - from->steps ||
        into->rejected > UINT64_MAX - from->rejected)
        return lg_fail(error, LG_FORMAT, "counts or sums overflow, so one of the parts is damaged");
    if (status != LG_OK)
        return lg_fail(error, LG_FORMAT, "its histograms have other cells or ranges than the other parts");
    into->members += from->members;
    into->steps += from->steps;
    into->rejected += from->rejected;
    for (size_t i = 0; i < STATUSES; i++) into->failed[i] += from->failed[i];
    for (size_t i = 0; i < from->listed; i++)
        result_list(into, from->who[i][0], from->who[i][1], from->when[i]);
    return LG_OK;
}
