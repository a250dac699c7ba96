/* Lists of arrays: what a file holds is said once, for reading and for writing. */
#include <stdio.h>

#include "files/h5.h"

enum { SHAPE = 256 };

static uint32_t rank_of(const lg_h5_array *array) {
    uint32_t rank = 0;
    while (rank < LG_COUNT(array->dims) && array->dims[rank] != NULL) rank++;
    return rank;
}

lg_status lg_h5_put_arrays(lg_h5 *h5, const lg_h5_array *arrays, size_t count, lg_error *error) {
    for (const lg_h5_array *a = arrays; a < arrays + count; a++) {
        uint64_t dims[LG_COUNT(a->dims)];
        const uint32_t rank = rank_of(a);
        for (uint32_t i = 0; i < rank; i++) dims[i] = a->dims[i]->n;
        if (*a->data == NULL) continue;
        LG_TRY(lg_check_finite(h5->path, a->name, rank, dims, *a->data, error));
        LG_TRY(lg_h5_put(h5, a->name, LG_ELEMENT_F64, rank, dims, *a->data, error));
    }
    return LG_OK;
}

/* Formats a shape, of the file (`found`), or as it should be: "(5 curves as in /boundary, >= 1 nodes, 2)". */
static const char *show(const lg_h5_array *a, const uint64_t *found, char text[SHAPE]) {
    size_t used = 0;
    for (uint32_t i = 0; i < rank_of(a); i++) {
        const lg_h5_size *size = a->dims[i];
        const bool any = found == NULL && size->n == 0, named = found == NULL && size->from != NULL;
        used += (size_t)snprintf(text + used, SHAPE - used, "%s%s%llu%s%s%s%s", i > 0 ? ", " : "",
                                 any ? ">= " : "",
                                 (unsigned long long)(found != NULL ? found[i]
                                                      : any         ? 1
                                                                    : size->n),
                                 size->what != NULL ? " " : "", size->what != NULL ? size->what : "",
                                 named ? " as in /" : "", named ? size->from : "");
    }
    return text;
}

lg_status lg_h5_fit(lg_h5 *h5, const lg_h5_array *a, size_t bytes, bool words, lg_h5_about *about,
                    lg_error *error) {
    const char *shown = lg_shown_path(h5->path);
    char is[SHAPE], want[SHAPE];
    bool fits = true;
    LG_TRY(lg_as_format(lg_h5_look(h5, a->name, bytes, about, error), error));
    if (about->kind != LG_H5_WHOLE && about->kind != LG_H5_REAL && !(words && about->kind == LG_H5_WORDS))
        return lg_fail(error, LG_FORMAT, "%s: /%s: %s", shown, a->name,
                       words ? "holds neither numbers nor texts" : "does not hold numbers");
    if (about->rank != rank_of(a))
        return lg_fail(error, LG_FORMAT, "%s: /%s: has rank %u, expected %u: (%s)", shown, a->name,
                       about->rank, rank_of(a), show(a, NULL, want));
    if (about->rank > 1 && !lg_h5_is_vector(about) && lg_h5_has_attribute(h5, a->name, "MATLAB_class"))
        return lg_fail(error, LG_FORMAT,
                       "%s: /%s: MATLAB has saved it with its dimensions in reverse order: write it with "
                       "h5write and permute(x, %u:-1:1)",
                       shown, a->name, about->rank);
    for (uint32_t i = 0; i < about->rank; i++)
        fits = fits && (a->dims[i]->n > 0 ? about->dims[i] == a->dims[i]->n : about->dims[i] > 0);
    if (!fits)
        return lg_fail(error, LG_FORMAT, "%s: /%s: has shape (%s), expected (%s)", shown, a->name,
                       show(a, about->dims, is), show(a, NULL, want));
    for (uint32_t i = 0; i < about->rank; i++)
        if (a->dims[i]->n == 0) *a->dims[i] = (lg_h5_size){about->dims[i], a->dims[i]->what, a->name};
    return LG_OK;
}

lg_status lg_h5_get_arrays(lg_h5 *h5, const lg_h5_array *arrays, size_t count, lg_error *error) {
    for (const lg_h5_array *a = arrays; a < arrays + count; a++) {
        lg_h5_about about;
        if (a->optional && !lg_h5_has(h5, a->name)) continue;
        LG_TRY(lg_h5_fit(h5, a, sizeof(double), false, &about, error));
        *a->data = lg_alloc(h5->context, about.count, sizeof(double));
        if (*a->data == NULL)
            return lg_fail(error, LG_OUT_OF_MEMORY, "%s: /%s: out of memory", lg_shown_path(h5->path),
                           a->name);
        LG_TRY(lg_as_format(lg_h5_get(h5, a->name, LG_ELEMENT_F64, about.rank, about.dims, *a->data, error),
                            error));
        LG_TRY(lg_check_finite(h5->path, a->name, about.rank, about.dims, *a->data, error));
    }
    return LG_OK;
}
