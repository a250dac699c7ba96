/* Reads and writes fields as attributes of HDF5 files. */
#include "settings/files/attributes.h"

#include <math.h>
#include <stdio.h>

#include "settings/settings.h"

/* Formats "/run: attribute lr" for error messages. Returns `text`. */
static const char *place_of(const lg_field *r, char *text, size_t size) {
    const bool root = r->group[0] == '\0';
    (void)snprintf(text, size, "%s%s%sattribute %s", root ? "" : "/", r->group, root ? "" : ": ", r->name);
    return text;
}

lg_status lg_field_write(lg_h5 *h5, const lg_field *r, const void *run, lg_error *error) {
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

static lg_status attribute_format(lg_h5 *h5, const lg_field *r, const char *what, const char *why,
                                  lg_error *error) {
    char place[64];
    return lg_h5_fail(h5, error, "%s %s%s", place_of(r, place, sizeof place), what, why);
}

static lg_status get_flag(lg_h5 *h5, const lg_field *r, bool *flag, lg_error *error) {
    uint32_t value;
    LG_TRY(lg_h5_number(h5, r->group, r->name, LG_ELEMENT_U32, &value, error));
    if (value > 1) return attribute_format(h5, r, "is neither 0 nor 1", "", error);
    *flag = value != 0;
    return LG_OK;
}

lg_status lg_field_check(const char *path, const lg_field *r, const void *run, lg_status status,
                         lg_error *error) {
    char place[64], range[64] = "";
    const double x = lg_field_number(r, run);
    const bool infinite = r->type == LG_FIELD_REAL && !isfinite(x);
    if (!infinite && lg_field_fits(r, run)) return LG_OK;
    if (r->above && r->low == 0)
        (void)snprintf(range, sizeof range, ": expected a positive number");
    else if (lg_field_name(r, 0) == NULL)
        (void)lg_format(range, sizeof range, ": expected %g to %g", r->low, r->high);
    return lg_fail(error, infinite ? LG_NOT_FINITE : status, "%s: %s is %s%s", lg_shown_path(path),
                   place_of(r, place, sizeof place), infinite ? "not finite" : "out of range", range);
}

/* Reads a text, list, name or phrase. An empty text is an empty list if the field allows a list of length
 * 0. */
static lg_status get_text(lg_h5 *h5, const lg_field *r, void *run, lg_error *error) {
    char text[LG_H5_TEXT];
    lg_error reason = {LG_OK, ""};
    const bool plain = r->type == LG_FIELD_TEXT;
    const lg_status status = lg_h5_text(h5, r->group, r->name, plain ? (char *)run + r->offset : text,
                                        plain ? r->size : sizeof text, error);
    if (status == LG_SHAPE) return attribute_format(h5, r, "is too long", "", error);
    if (status != LG_OK || plain) return status;
    if (text[0] == '\0' && r->type != LG_FIELD_NAME && r->type != LG_FIELD_PHRASE) {
        if (r->least > 0) return attribute_format(h5, r, "is empty", "", error);
        lg_field_fill(r, NULL, 0, run);
        return LG_OK;
    }
    if (lg_field_set(r, text, run, &reason) == LG_OK) return LG_OK;
    return attribute_format(h5, r, r->type == LG_FIELD_NAME ? "is not a known name: " : "", reason.message,
                            error);
}

lg_status lg_field_read(lg_h5 *h5, const lg_field *r, void *run, lg_error *error) {
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
    case LG_FIELD_WHOLES:
    case LG_FIELD_REALS:
    case LG_FIELD_PHRASE:
    case LG_FIELD_TEXT:
        return get_text(h5, r, run, error);
    default:
        break;
    }
    return LG_OK;
}

lg_status lg_field_get(lg_h5 *h5, const lg_field *r, void *run, lg_error *error) {
    LG_TRY(lg_as_format(lg_field_read(h5, r, run, error), error));
    return lg_field_check(h5->path, r, run, LG_FORMAT, error);
}
