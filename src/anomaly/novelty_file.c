/* Saving and loading of lg_novelty in archives. */
#include <string.h>

#include "anomaly/novelty_internal.h"
#include "core/stored.h"

#define ROOT "novelty/"

enum { ARRAYS = 9, SIZES = 4 };

/* Whether all numbers of an array must be above 0. */
static const bool positive[ARRAYS] = {[1] = true, [2] = true, [3] = true, [6] = true, [8] = true};

/* Lists the arrays with their shapes. The sizes in *v must be set. */
static void list(lg_novelty *v, lg_stored out[ARRAYS]) {
    const uint64_t m = v->channels, k = v->classes, d = v->features;
    const lg_stored rows[ARRAYS] = {
        {ROOT "mean", LG_ELEMENT_F64, 1, {m}, &v->mean, true},
        {ROOT "scale", LG_ELEMENT_F64, 1, {m}, &v->scale, true},
        {ROOT "still", LG_ELEMENT_F64, 1, {m}, &v->still, true},
        {ROOT "extreme", LG_ELEMENT_F64, 1, {m}, &v->extreme, true},
        {ROOT "windows", LG_ELEMENT_F64, 1, {k}, &v->windows, true},
        {ROOT "centre", LG_ELEMENT_F64, 2, {k, d}, &v->centre, true},
        {ROOT "spread", LG_ELEMENT_F64, 1, {d}, &v->spread, true},
        {ROOT "precision", LG_ELEMENT_F64, 3, {k, d, d}, &v->precision, true},
        {ROOT "limit", LG_ELEMENT_F64, 1, {lg_novelty_groups(v)}, &v->limit, true}};
    memcpy(out, rows, sizeof rows);
}

static void list_sizes(uint32_t size[SIZES], lg_stored out[SIZES]) {
    static const char *const names[SIZES] = {ROOT "channels", ROOT "length", ROOT "classes", ROOT "bands"};
    for (size_t i = 0; i < SIZES; i++) out[i] = (lg_stored){names[i], LG_ELEMENT_U32, .data = &size[i]};
}

lg_status lg_novelty_save(const lg_novelty *novelty, const lg_archive_writer *w, lg_error *error) {
    LG_NEEDS(error, novelty, w);
    lg_novelty v = *novelty; /* a copy that is only read, because list takes pointers without const */
    lg_stored rows[SIZES + ARRAYS];
    list_sizes((uint32_t[SIZES]){v.channels, v.length, v.classes, v.bands}, rows);
    list(&v, rows + SIZES);
    return lg_stored_save(w, rows, SIZES + ARRAYS, error);
}

/* ---- reading ---- */

static lg_status read_sizes(const lg_archive_reader *r, uint32_t size[SIZES], lg_error *error) {
    lg_stored rows[SIZES];
    list_sizes(size, rows);
    if (r->array(r->user, rows[0].path, LG_ELEMENT_U32, 0, NULL, size) == LG_NOT_FOUND) return LG_NOT_FOUND;
    LG_TRY(lg_as_format(lg_stored_load(r, rows, SIZES, error), error));
    const uint32_t channels = size[0], length = size[1], classes = size[2], bands = size[3];
    const bool fits = channels >= 1 && channels <= LG_NOVELTY_FEATURES / NOVELTY_BAND && length >= 2 &&
                      length <= UINT32_MAX / channels && classes >= 1 && classes <= 65536 &&
                      bands == lg_spectrum_bands(length, bands) &&
                      (NOVELTY_BAND + bands) * channels <= LG_NOVELTY_FEATURES;
    return fits ? LG_OK
                : lg_fail(
                      error, LG_FORMAT,
                      "novelty: %u channels, %u samples, %u classes and %u bands are not possible together",
                      channels, length, classes, bands);
}

/* Reads the arrays, whose shapes must be the right ones. */
static lg_status read_arrays(const lg_archive_reader *r, const lg_stored rows[ARRAYS], lg_error *error) {
    LG_TRY(lg_as_format(lg_stored_load(r, rows, ARRAYS, error), error));
    for (size_t a = 0; a < ARRAYS; a++) {
        const double *data = *(double **)rows[a].data;
        LG_TRY(lg_stored_finite(&rows[a], error));
        for (size_t i = 0; positive[a] && i < rows[a].dims[0]; i++)
            if (!(data[i] > 0))
                return lg_fail(error, LG_FORMAT, "%s: entry %zu is %g, expected more than 0", rows[a].path, i,
                               data[i]);
    }
    return LG_OK;
}

lg_status lg_novelty_load(const lg_context *context, const lg_archive_reader *r, lg_novelty *out,
                          lg_error *error) {
    LG_NEEDS(error, r, out);
    uint32_t size[SIZES];
    lg_stored rows[ARRAYS];
    *out = (lg_novelty){.channels = 0};
    LG_TRY(read_sizes(r, size, error));
    LG_CLEAN(lg_novelty_destroy) lg_novelty made = lg_novelty_sized(size[0], size[1], size[2], size[3]);
    list(&made, rows);
    LG_TRY(lg_as_format(lg_stored_check(r, rows, ARRAYS, error), error)); /* before memory is allocated */
    LG_TRY(lg_novelty_allocate(context, size[0], size[1], size[2], size[3], &made, error));
    LG_TRY(read_arrays(r, rows, error));
    LG_TRY(lg_novelty_factor(&made, error));
    return LG_GIVE(out, made);
}
