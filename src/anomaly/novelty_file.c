/* Saving and loading of lg_novelty in archives. */
#include <math.h>
#include <string.h>

#include "anomaly/novelty_internal.h"

#define ROOT "novelty/"

typedef struct item {
    const char *path;
    double **data;
    uint32_t rank;
    uint64_t dims[3];
    bool positive;
} item;

enum { ITEMS = 9, SIZES = 4 };

/* Lists the arrays with their shapes. The sizes in *v must be set. */
static void list(lg_novelty *v, item out[ITEMS]) {
    const uint64_t m = v->channels, k = v->classes, d = v->features;
    const item rows[ITEMS] = {{ROOT "mean", &v->mean, 1, {m}, false},
                              {ROOT "scale", &v->scale, 1, {m}, true},
                              {ROOT "still", &v->still, 1, {m}, true},
                              {ROOT "extreme", &v->extreme, 1, {m}, true},
                              {ROOT "windows", &v->windows, 1, {k}, false},
                              {ROOT "centre", &v->centre, 2, {k, d}, false},
                              {ROOT "spread", &v->spread, 1, {d}, true},
                              {ROOT "precision", &v->precision, 3, {k, d, d}, false},
                              {ROOT "limit", &v->limit, 1, {lg_novelty_groups(v)}, true}};
    memcpy(out, rows, sizeof rows);
}

static const char *const sizes[SIZES] = {ROOT "channels", ROOT "length", ROOT "classes", ROOT "bands"};

lg_status lg_novelty_save(const lg_novelty *novelty, const lg_archive_writer *w, lg_error *error) {
    LG_NEEDS(error, novelty, w);
    lg_novelty v = *novelty; /* a copy that is only read, because list takes a pointer without const */
    item items[ITEMS];
    const uint32_t size[SIZES] = {v.channels, v.length, v.classes, v.bands};
    lg_status status = LG_OK;
    list(&v, items);
    for (size_t i = 0; i < SIZES && status == LG_OK; i++)
        status = w->array(w->user, sizes[i], LG_ELEMENT_U32, 0, NULL, &size[i]);
    for (size_t i = 0; i < ITEMS && status == LG_OK; i++)
        status =
            w->array(w->user, items[i].path, LG_ELEMENT_F64, items[i].rank, items[i].dims, *items[i].data);
    return status == LG_OK
               ? LG_OK
               : lg_fail(error, status, "novelty could not be saved: %s", lg_status_sentence(status));
}

/* ---- reading ---- */

static lg_status refused(lg_status status, const char *path, lg_error *error) {
    if (status == LG_OK) return LG_OK;
    if (status == LG_SHAPE || status == LG_NOT_FOUND) status = LG_FORMAT;
    return lg_fail(error, status, "%s: %s", path, lg_status_sentence(status));
}

static lg_status read_sizes(const lg_archive_reader *r, uint32_t size[SIZES], lg_error *error) {
    if (r->array(r->user, sizes[0], LG_ELEMENT_U32, 0, NULL, &size[0]) == LG_NOT_FOUND) return LG_NOT_FOUND;
    for (size_t i = 0; i < SIZES; i++)
        LG_TRY(refused(r->array(r->user, sizes[i], LG_ELEMENT_U32, 0, NULL, &size[i]), sizes[i], error));
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

/* Compares the shapes in the file with the expected ones before any array of that size is allocated. */
static lg_status check_shapes(const lg_archive_reader *r, lg_novelty *sized, lg_error *error) {
    item items[ITEMS];
    list(sized, items);
    for (size_t i = 0; i < ITEMS; i++) {
        uint32_t rank;
        uint64_t dims[4];
        LG_TRY(refused(r->shape(r->user, items[i].path, &rank, dims), items[i].path, error));
        if (rank != items[i].rank || memcmp(dims, items[i].dims, rank * sizeof *dims) != 0)
            return refused(LG_SHAPE, items[i].path, error);
    }
    return LG_OK;
}

static lg_status read_item(const lg_archive_reader *r, const item *it, lg_error *error) {
    size_t count = 1;
    double *data = *it->data;
    LG_TRY(refused(r->array(r->user, it->path, LG_ELEMENT_F64, it->rank, it->dims, data), it->path, error));
    for (uint32_t i = 0; i < it->rank; i++) count *= (size_t)it->dims[i];
    for (size_t i = 0; i < count; i++) {
        if (!isfinite(data[i]))
            return lg_fail(error, LG_NOT_FINITE, "%s: entry %zu is %g", it->path, i, data[i]);
        if (it->positive && !(data[i] > 0))
            return lg_fail(error, LG_FORMAT, "%s: entry %zu is %g, expected more than 0", it->path, i,
                           data[i]);
    }
    return LG_OK;
}

lg_status lg_novelty_load(const lg_context *context, const lg_archive_reader *r, lg_novelty *out,
                          lg_error *error) {
    LG_NEEDS(error, r, out);
    uint32_t size[SIZES];
    item items[ITEMS];
    *out = (lg_novelty){.channels = 0};
    LG_TRY(read_sizes(r, size, error));
    lg_novelty made = lg_novelty_sized(size[0], size[1], size[2], size[3]);
    LG_TRY(check_shapes(r, &made, error));
    LG_TRY(lg_novelty_allocate(context, size[0], size[1], size[2], size[3], &made, error));
    list(&made, items);
    lg_status status = LG_OK;
    for (size_t i = 0; i < ITEMS && status == LG_OK; i++) status = read_item(r, &items[i], error);
    if (status == LG_OK) status = lg_novelty_factor(&made, error);
    if (status == LG_OK)
        *out = made;
    else
        lg_novelty_destroy(&made);
    return status;
}
