/* The items of a model file: what it holds besides facts, hyperparameters, weights and functions. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "files/h5.h"
#include "liegrad/series.h"
#include "model/files/recipe.h"
#include "settings/files/attributes.h"

/* ---- arrays ---- */

/* The arrays of an item: one, or the two of a scaler. */
typedef struct arrays {
    char name[2][64];
    lg_h5_size size[2];
    lg_h5_array array[2];
    size_t count;
} arrays;

static void list_arrays(const lg_item *item, void *file, arrays *out) {
    void *at = (char *)file + item->offset;
    lg_scaler *scaler = at;
    const bool two = item->type == LG_ITEM_SCALER;
    double **const data[2] = {two ? &scaler->mean : at, two ? &scaler->scale : NULL};
    lg_h5_size *dims[2] = {NULL, NULL};
    out->count = two ? 2 : 1;
    for (size_t i = 0; i < LG_COUNT(dims) && item->dims[i].bytes + item->dims[i].offset > 0; i++) {
        const lg_item_size *size = &item->dims[i];
        const void *member = (const char *)file + size->offset;
        const uint64_t n = size->bytes == 0                  ? size->offset
                           : size->bytes == sizeof(uint32_t) ? *(const uint32_t *)member
                                                             : *(const size_t *)member;
        out->size[i] = (lg_h5_size){n, size->what, size->bytes > 0 && n > 0 ? "model" : NULL};
        dims[i] = &out->size[i];
    }
    for (size_t k = 0; k < out->count; k++) {
        (void)snprintf(out->name[k], sizeof *out->name, "%s%s", item->name,
                       !two     ? ""
                       : k == 0 ? "/mean"
                                : "/scale");
        out->array[k] = (lg_h5_array){out->name[k], data[k], {dims[0], dims[1]}, item->optional};
    }
}

static lg_status check_scale(const lg_h5 *h5, const lg_item *item, const void *at, lg_status status,
                             lg_error *error) {
    const lg_scaler *scaler = at;
    for (uint32_t c = 0; item->type == LG_ITEM_SCALER && c < scaler->channels; c++)
        if (!(scaler->scale[c] > 0))
            return lg_fail(error, status, "%s: /%s/scale: is %g at index (%u), expected more than 0",
                           lg_shown_path(h5->path), item->name, scaler->scale[c], c);
    return LG_OK;
}

static lg_status put_arrays(lg_h5 *h5, const lg_item *item, void *file, lg_error *error) {
    const lg_scaler *scaler = (const void *)((const char *)file + item->offset);
    arrays all;
    list_arrays(item, file, &all);
    if (item->type == LG_ITEM_SCALER &&
        (scaler->channels != all.size[0].n || scaler->mean == NULL || scaler->scale == NULL))
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: /%s: has %u %s, but the model has %u",
                       lg_shown_path(h5->path), item->name, scaler->channels, all.size[0].what,
                       (unsigned)all.size[0].n);
    LG_TRY(check_scale(h5, item, scaler, LG_INVALID_ARGUMENT, error));
    return lg_h5_put_arrays(h5, all.array, all.count, error);
}

static lg_status get_arrays(lg_h5 *h5, const lg_item *item, void *file, lg_error *error) {
    char *at = (char *)file + item->offset;
    arrays all;
    list_arrays(item, file, &all);
    if (item->type == LG_ITEM_SCALER)
        *(lg_scaler *)(void *)at = (lg_scaler){.channels = (uint32_t)all.size[0].n, .context = h5->context};
    LG_TRY(lg_h5_get_arrays(h5, all.array, all.count, error));
    for (size_t i = 0; i < LG_COUNT(item->dims); i++)
        if (item->dims[i].bytes == sizeof(size_t))
            *(size_t *)(void *)((char *)file + item->dims[i].offset) = (size_t)all.size[i].n;
    return check_scale(h5, item, at, LG_FORMAT, error);
}

/* ---- attributes ---- */

bool lg_item_is_known(const lg_item *item, const void *file) {
    const void *at = (const char *)file + item->field.offset;
    if (item->known != 0 && (!item->optional || !*((const bool *)file + item->known)))
        return *((const bool *)file + item->known);
    if (item->field.type == LG_FIELD_TEXT) return *(const char *)at != '\0';
    if (item->field.type == LG_FIELD_U64) return *(const uint64_t *)at > 0;
    return item->lenient ? *(const double *)at > 0 : !isnan(*(const double *)at);
}

static lg_status put_attribute(lg_h5 *h5, const lg_item *item, void *file, lg_error *error) {
    if (!lg_item_is_known(item, file)) return LG_OK;
    LG_TRY(lg_field_check(h5->path, &item->field, file, LG_INVALID_ARGUMENT, error));
    return lg_field_write(h5, &item->field, file, error);
}

static lg_status get_attribute(lg_h5 *h5, const lg_item *item, void *file, lg_error *error) {
    char *at = (char *)file + item->field.offset;
    const bool has = lg_h5_has_attribute(h5, "", item->field.name);
    if (item->known != 0 && !item->optional) *((bool *)file + item->known) = has;
    if (item->field.type == LG_FIELD_REAL && !item->lenient) *(double *)(void *)at = (double)NAN;
    if (!has) return LG_OK;
    const lg_status status = lg_field_get(h5, &item->field, file, item->lenient ? NULL : error);
    if (!item->lenient) return status;
    if (status != LG_OK || !lg_item_is_known(item, file)) memset(at, 0, item->field.size);
    return LG_OK;
}

/* ---- all items ---- */

typedef lg_status step(lg_h5 *h5, const lg_item *item, void *file, lg_error *error);

static lg_status each_item(lg_h5 *h5, const lg_recipe *kind, void *file, step *attribute, step *list,
                           lg_error *error) {
    for (const lg_item *item = kind->items; item != NULL && item->type != LG_ITEM_END; item++) {
        if (item->type == LG_ITEM_ATTRIBUTE)
            LG_TRY(attribute(h5, item, file, error));
        else if (item->name != NULL &&
                 (item->applies == NULL || item->applies((const char *)file + kind->file_run)))
            LG_TRY(list(h5, item, file, error));
    }
    return LG_OK;
}

lg_status lg_items_put(lg_h5 *h5, const lg_recipe *kind, const void *file, lg_error *error) {
    /* lists of arrays take pointers without const */
    return each_item(h5, kind, (void *)(uintptr_t)file, put_attribute, put_arrays, error);
}

lg_status lg_items_get(lg_h5 *h5, const lg_recipe *kind, void *file, lg_error *error) {
    return each_item(h5, kind, file, get_attribute, get_arrays, error);
}

void lg_items_release(const lg_context *context, const lg_recipe *kind, void *file) {
    for (const lg_item *item = kind->items; item != NULL && item->type != LG_ITEM_END; item++) {
        void *at = (char *)file + item->offset;
        if (item->type == LG_ITEM_SCALER)
            lg_scaler_destroy(at);
        else if (item->type == LG_ITEM_ARRAY)
            lg_free(context, *(void **)at);
    }
}
