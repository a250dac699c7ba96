/* The statistics of an ensemble or of a part of it: how they are merged and freed. */
#include "lg-simulate/ensemble.h"

#include <string.h>

void result_free(result *self) {
    lg_statistics_destroy(self->states);
    lg_statistics_destroy(self->times);
    *self = (result){.what = NULL};
}

uint64_t result_failed(const result *self) {
    uint64_t sum = 0;
    for (size_t i = 0; i < STATUSES; i++) sum += self->failed[i];
    return sum;
}

void result_list(result *self, const failure *what) {
    size_t at = self->listed;
    if (at == LISTED && self->failures[LISTED - 1].member < what->member) return;
    if (at == LISTED) at--;
    for (; at > 0 && self->failures[at - 1].member > what->member; at--)
        self->failures[at] = self->failures[at - 1];
    self->failures[at] = *what;
    if (self->listed < LISTED) self->listed++;
}

lg_status result_merge(result *into, const result *from, lg_error *error) {
    if (strcmp(into->what, from->what) != 0)
        return app_error(error, LG_FORMAT, "it is a part of another ensemble: %.200s", from->what);
    lg_status status = lg_statistics_merge(into->states, from->states);
    if (status == LG_OK && into->times != NULL) status = lg_statistics_merge(into->times, from->times);
    if (status == LG_CHECK_FAILED || into->steps > UINT64_MAX - from->steps ||
        into->rejected > UINT64_MAX - from->rejected)
        return app_error(error, LG_FORMAT, "counts or sums overflow, so one of the parts is damaged");
    if (status != LG_OK)
        return app_error(error, LG_FORMAT, "its histograms have other cells or ranges than the other parts");
    into->members += from->members;
    into->steps += from->steps;
    into->rejected += from->rejected;
    for (size_t i = 0; i < STATUSES; i++) into->failed[i] += from->failed[i];
    for (size_t i = 0; i < from->listed; i++) result_list(into, &from->failures[i]);
    return LG_OK;
}
