/* Sets of series, windows and scalers that the running test owns. */
#ifndef LG_SERIES_SUPPORT_H
#define LG_SERIES_SUPPORT_H

#include "support/fixtures.h"

#include "liegrad/anomaly.h"

OWNED(lg_series, lg_series_destroy)
OWNED(lg_windows, lg_windows_destroy)
OWNED(lg_scaler, lg_scaler_destroy)
OWNED(lg_detector_data, lg_detector_data_destroy)

static inline lg_series make_series(size_t count, uint32_t channels, uint32_t length, uint32_t classes,
                                    bool group, bool run) {
    lg_series s = {.count = count, .channels = channels, .length = length, .classes = classes};
    assert_ok(lg_series_allocate(NULL, &s, group, run));
    for (size_t i = 0; i < count; i++) s.label[i] = (uint32_t)(i % classes);
    return *own_lg_series(s);
}

static inline lg_windows cut_windows(const lg_series *s, size_t length, size_t hop) {
    lg_windows w;
    assert_told(lg_windows_create(NULL, s, length, hop, &w, &told));
    return *own_lg_windows(w);
}

static inline lg_scaler fit_scaler(const lg_series *s, const lg_windows *w, const uint32_t *chosen,
                                   size_t count, bool centred) {
    lg_scaler scaler;
    assert_ok(lg_scaler_fit(NULL, s, w, chosen, count, centred, &scaler));
    return *own_lg_scaler(scaler);
}

#endif
