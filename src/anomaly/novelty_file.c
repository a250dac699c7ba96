/* Saving and loading of lg_novelty in archives. */
#include "anomaly/novelty_internal.h"

enum { SIZES = 4 };

static void list_sizes(lg_novelty *v, lg_stored out[SIZES]) {
    static const char *const names[SIZES] = {"novelty/channels", "novelty/length", "novelty/classes",
                                             "novelty/bands"};
    uint32_t *const sizes[SIZES] = {&v->channels, &v->length, &v->classes, &v->bands};
    for (size_t i = 0; i < SIZES; i++) out[i] = (lg_stored){names[i], LG_ELEMENT_U32, .data = sizes[i]};
}

lg_status lg_novelty_save(const lg_novelty *novelty, const lg_archive_writer *w, lg_error *error) {
    LG_NEEDS(error, novelty, w);
    lg_novelty v = *novelty; /* a copy that is only read, because the lists take pointers without const */
    lg_stored rows[SIZES + NOVELTY_ARRAYS];
    list_sizes(&v, rows);
    lg_novelty_list(&v, rows + SIZES);
    return lg_stored_save(w, rows, LG_COUNT(rows), error);
}

/* ---- reading ---- */

static lg_status read_sizes(const lg_archive_reader *r, lg_novelty *v, lg_error *error) {
    lg_stored rows[SIZES];
    list_sizes(v, rows);
    if (r->array(r->user, rows[0].path, LG_ELEMENT_U32, 0, NULL, &v->channels) == LG_NOT_FOUND)
        return LG_NOT_FOUND;
    LG_TRY(lg_as_format(lg_stored_load(r, rows, SIZES, error), error));
    const bool fits = v->channels >= 1 && v->channels <= LG_NOVELTY_FEATURES / NOVELTY_BAND &&
                      v->length >= 2 && v->length <= UINT32_MAX / v->channels && v->classes >= 1 &&
                      v->classes <= 65536 && v->bands == lg_spectrum_bands(v->length, v->bands) &&
                      (NOVELTY_BAND + v->bands) * v->channels <= LG_NOVELTY_FEATURES;
    return fits ? LG_OK
                : lg_fail(
                      error, LG_FORMAT,
                      "novelty: %u channels, %u samples, %u classes and %u bands are not possible together",
                      v->channels, v->length, v->classes, v->bands);
}

lg_status lg_novelty_load(const lg_context *context, const lg_archive_reader *r, lg_novelty *out,
                          lg_error *error) {
    LG_NEEDS(error, r, out);
    lg_stored rows[NOVELTY_ARRAYS];
    *out = (lg_novelty){.channels = 0};
    LG_CLEAN(lg_novelty_destroy) lg_novelty made = {.context = context};
    LG_TRY(read_sizes(r, &made, error));
    lg_novelty_list(&made, rows);
    LG_TRY(lg_as_format(lg_stored_make(context, r, rows, NOVELTY_ARRAYS, error), error));
    LG_TRY(lg_novelty_prepare(&made, error));
    LG_TRY(lg_novelty_factor(&made, error));
    return LG_GIVE(out, made);
}
