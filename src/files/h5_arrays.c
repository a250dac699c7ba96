/* Lists of arrays: what a file holds is said once, for reading and for writing. */
#include "files/h5_internal.h"

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

/* Fails with the shape in the file and the wanted one: "(5 curves as in /boundary, >= 1 nodes, 2)". */
static lg_status misfit(const lg_h5 *h5, const lg_h5_array *a, const lg_h5_about *about, lg_error *error) {
    char have[LG_SHAPE_TEXT], want[256] = "";
    for (uint32_t i = 0; i < rank_of(a); i++) {
        const lg_h5_size *size = a->dims[i];
        lg_append(want, sizeof want, "%s%s%llu%s%s%s%s", i > 0 ? ", " : "", size->n == 0 ? ">= " : "",
                  (unsigned long long)(size->n == 0 ? 1 : size->n), size->what != NULL ? " " : "",
                  size->what != NULL ? size->what : "", size->from != NULL ? " as in /" : "",
                  size->from != NULL ? size->from : "");
    }
    lg_shape_text(have, about->rank, about->dims);
    return lg_h5_fail(h5, error, "/%s: has shape %s, expected (%s)", a->name, have, want);
}

lg_status lg_h5_fit(lg_h5 *h5, const lg_h5_array *a, size_t bytes, bool words, lg_h5_about *about,
                    lg_error *error) {
    LG_TRY(lg_as_format(lg_h5_look(h5, a->name, bytes, about, error), error));
    if (about->kind != LG_H5_WHOLE && about->kind != LG_H5_REAL && !(words && about->kind == LG_H5_WORDS))
        return lg_dataset_error(h5, a->name, words ? LG_NO_CELLS : LG_NO_NUMBERS, error);
    /* Where a list is wanted, a row, a column or a single number is one: MATLAB writes no others. */
    const bool list = rank_of(a) == 1 && (lg_h5_is_vector(about) || about->count == 1);
    const uint32_t rank = list ? 1 : about->rank;
    const uint64_t *dims = list ? &about->count : about->dims;
    bool fits = rank == rank_of(a);
    if (fits && rank > 1 && !lg_h5_is_vector(about) && lg_h5_has_attribute(h5, a->name, "MATLAB_class"))
        return lg_h5_fail(h5, error,
                          "/%s: MATLAB has saved it with its dimensions in reverse order: write it with "
                          "h5write and permute(x, %u:-1:1)",
                          a->name, rank);
    for (uint32_t i = 0; i < rank && fits; i++)
        fits = a->dims[i]->n > 0 ? dims[i] == a->dims[i]->n : dims[i] > 0;
    if (!fits) return misfit(h5, a, about, error);
    for (uint32_t i = 0; i < rank; i++)
        if (a->dims[i]->n == 0) *a->dims[i] = (lg_h5_size){dims[i], a->dims[i]->what, a->name};
    return LG_OK;
}

lg_status lg_h5_get_finite(lg_h5 *h5, const char *name, uint32_t rank, const uint64_t *dims, double *out,
                           lg_error *error) {
    LG_TRY(lg_as_format(lg_h5_get(h5, name, LG_ELEMENT_F64, rank, dims, out, error), error));
    return lg_check_finite(h5->path, name, rank, dims, out, error);
}

lg_status lg_h5_get_arrays(lg_h5 *h5, const lg_h5_array *arrays, size_t count, lg_error *error) {
    for (const lg_h5_array *a = arrays; a < arrays + count; a++) {
        lg_h5_about about;
        if (a->optional && !lg_h5_has(h5, a->name)) continue;
        LG_TRY(lg_h5_fit(h5, a, sizeof(double), false, &about, error));
        *a->data = lg_alloc(h5->context, about.count, sizeof(double));
        if (*a->data == NULL) return lg_h5_no_memory(h5, error);
        LG_TRY(lg_h5_get_finite(h5, a->name, about.rank, about.dims, *a->data, error));
    }
    return LG_OK;
}
