/* The description of a run: one table for saving, loading and comparing. */
#include "model/files/recipe.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "settings/names.h"

/* Row number `index` of a run: facts, then hyperparameters; NULL beyond the last. */
static const lg_field *row_at(const lg_recipe *kind, size_t index) {
    const lg_field *row = kind->facts;
    for (; row->name != NULL && index > 0; row++) index--;
    if (row->name == NULL) row = kind->hyperparameters;
    for (; row->name != NULL && index > 0; row++) index--;
    return row->name != NULL ? row : NULL;
}

/* Whether the member has the value of a file without the attribute. Attributes of /model are required. */
static bool is_unknown(const lg_recipe *kind, const lg_field *r, const void *run) {
    return strcmp(r->group, "run") == 0 &&
           memcmp((const char *)run + r->offset, (const char *)kind->defaults + r->offset, r->size) == 0;
}

static const char *place_name(const lg_field *r, char *text, size_t size) {
    (void)snprintf(text, size, "/%s: attribute %s", r->group, r->name);
    return text;
}

static lg_status check_row(const char *path, const lg_recipe *kind, const lg_field *r, const void *run,
                           lg_status status, lg_error *error) {
    char place[64];
    if (r->type == LG_FIELD_REAL && !isfinite(lg_field_number(r, run)))
        return lg_fail(error, LG_NOT_FINITE, "%s: %s is not finite", lg_shown_path(path),
                       place_name(r, place, sizeof place));
    if (!lg_field_fits(r, run) && !is_unknown(kind, r, run))
        return lg_fail(error, status, "%s: %s is out of range", lg_shown_path(path),
                       place_name(r, place, sizeof place));
    return LG_OK;
}

lg_status lg_run_check(const char *path, const lg_recipe *kind, const void *run, lg_error *error) {
    const lg_field *r;
    for (size_t i = 0; (r = row_at(kind, i)) != NULL; i++)
        LG_TRY(check_row(path, kind, r, run, LG_INVALID_ARGUMENT, error));
    const lg_status status = kind->check(run);
    if (status != LG_OK)
        return lg_fail(error, status, "%s: the model was not made by its init function", lg_shown_path(path));
    return LG_OK;
}

static lg_status put_row(lg_h5 *h5, const lg_field *r, const void *run, lg_error *error) {
    char text[LG_H5_TEXT];
    const double real = lg_field_number(r, run);
    uint64_t whole = 0;
    switch (r->type) {
    case LG_FIELD_REAL:
        return lg_h5_put_number(h5, r->group, r->name, LG_ELEMENT_F64, &real, error);
    case LG_FIELD_U64:
    case LG_FIELD_U32:
    case LG_FIELD_FLAG:
        whole = lg_field_whole(r, run);
        return lg_h5_put_number(h5, r->group, r->name, LG_ELEMENT_U64, &whole, error);
    default:
        lg_field_show(r, run, text, sizeof text);
        return lg_h5_put_text(h5, r->group, r->name, text, error);
    }
}

lg_status lg_run_put(lg_h5 *h5, const lg_recipe *kind, const void *run, lg_error *error) {
    const lg_field *r;
    for (size_t i = 0; (r = row_at(kind, i)) != NULL; i++) LG_TRY(put_row(h5, r, run, error));
    return kind->describe(h5, run, error);
}

/* ---- loading ---- */

static lg_status attribute_format(lg_h5 *h5, const lg_field *r, const char *what, lg_error *error) {
    char place[64];
    return lg_fail(error, LG_FORMAT, "%s: %s %s", lg_shown_path(h5->path), place_name(r, place, sizeof place),
                   what);
}

static lg_status get_name(lg_h5 *h5, const lg_field *r, void *run, lg_error *error) {
    char text[64];
    const lg_status status = lg_h5_text(h5, r->group, r->name, text, sizeof text, error);
    if (status != LG_OK && status != LG_SHAPE) return status;
    if (status == LG_OK && lg_field_set(r, text, run, NULL) == LG_OK) return LG_OK;
    return attribute_format(h5, r, "is not a known name", error);
}

static lg_status get_flag(lg_h5 *h5, const lg_field *r, bool *flag, lg_error *error) {
    uint32_t value;
    LG_TRY(lg_h5_number(h5, r->group, r->name, LG_ELEMENT_U32, &value, error));
    if (value > 1) return attribute_format(h5, r, "is neither 0 nor 1", error);
    *flag = value != 0;
    return LG_OK;
}

/* A list or a phrase. The empty text is the empty list. */
static lg_status get_list(lg_h5 *h5, const lg_field *r, void *run, lg_error *error) {
    char text[LG_H5_TEXT];
    lg_error reason = {LG_OK, ""};
    const lg_status status = lg_h5_text(h5, r->group, r->name, text, sizeof text, error);
    if (status != LG_OK && status != LG_SHAPE) return status;
    if (status == LG_SHAPE) return attribute_format(h5, r, "is too long", error);
    if (text[0] == '\0' && r->type != LG_FIELD_PHRASE) {
        lg_field_fill(r, NULL, 0, run);
        return LG_OK;
    }
    if (lg_field_set(r, text, run, &reason) == LG_OK) return LG_OK;
    return attribute_format(h5, r, reason.message, error);
}

static lg_status get_text(lg_h5 *h5, const lg_field *r, char *at, lg_error *error) {
    const lg_status status = lg_h5_text(h5, r->group, r->name, at, r->size, error);
    return status == LG_SHAPE ? attribute_format(h5, r, "is too long", error) : status;
}

static lg_status get_row(lg_h5 *h5, const lg_field *r, void *run, lg_error *error) {
    void *at = (char *)run + r->offset;
    switch (r->type) {
    case LG_FIELD_REAL:
        return lg_h5_number(h5, r->group, r->name, LG_ELEMENT_F64, at, error);
    case LG_FIELD_U64:
        return lg_h5_number(h5, r->group, r->name, LG_ELEMENT_U64, at, error);
    case LG_FIELD_U32:
        return lg_h5_number(h5, r->group, r->name, LG_ELEMENT_U32, at, error);
    case LG_FIELD_FLAG:
        return get_flag(h5, r, at, error);
    case LG_FIELD_NAME:
        return get_name(h5, r, run, error);
    case LG_FIELD_WHOLES:
    case LG_FIELD_REALS:
    case LG_FIELD_PHRASE:
        return get_list(h5, r, run, error);
    case LG_FIELD_TEXT:
        return get_text(h5, r, at, error);
    default:
        break;
    }
    return LG_OK;
}

lg_status lg_run_get(lg_h5 *h5, const lg_recipe *kind, bool complete, void *run, lg_error *error) {
    const lg_field *r;
    memcpy(run, kind->defaults, kind->run_size);
    for (size_t i = 0; (r = row_at(kind, i)) != NULL; i++) {
        const bool needed = !r->optional && (complete || strcmp(r->group, "model") == 0);
        if (!needed && !lg_h5_has_attribute(h5, r->group, r->name)) continue;
        LG_TRY(lg_missing_is_format(get_row(h5, r, run, error), error));
        LG_TRY(check_row(h5->path, kind, r, run, LG_FORMAT, error));
    }
    return kind->build(h5, run, error);
}

/* ---- comparing ---- */

static bool differs(const lg_field *r, const void *stored, const void *wanted, char have[LG_FIELD_TEXT_SIZE],
                    char want[LG_FIELD_TEXT_SIZE]) {
    lg_field_show(r, stored, have, LG_FIELD_TEXT_SIZE);
    lg_field_show(r, wanted, want, LG_FIELD_TEXT_SIZE);
    return strcmp(have, want) != 0;
}

lg_status lg_run_compare(const lg_recipe *kind, const void *stored, const void *wanted, const char *path,
                         lg_error *error) {
    char have[LG_FIELD_TEXT_SIZE], want[LG_FIELD_TEXT_SIZE];
    const lg_field *r;
    if (path == NULL || kind == NULL || stored == NULL || wanted == NULL) return LG_INVALID_ARGUMENT;
    /* Other data make other scales, too; they are told first. */
    for (size_t i = 0; (r = row_at(kind, i)) != NULL; i++)
        if (strcmp(r->name, "data_sha256") == 0 && differs(r, stored, wanted, have, want))
            return lg_fail(error, LG_INVALID_ARGUMENT, "%s: was written from other data: %s %s, not %s",
                           lg_shown_path(path), r->name, have, want);
    for (size_t i = 0; (r = row_at(kind, i)) != NULL; i++) {
        if (differs(r, stored, wanted, have, want))
            return lg_fail(error, LG_INVALID_ARGUMENT, "%s: was written with %s %s, not %s",
                           lg_shown_path(path), r->name, have, want);
    }
    return LG_OK;
}
