/* Reading attributes, and checking the file's own attributes: format, version, kind and provenance. */
#include <math.h>
#include <string.h>

#include "files/h5_internal.h"

typedef struct attribute {
    hid_t attribute, type;
    bool single; /* one element; false for an empty (null) data space */
} attribute;

static void close_attribute(const attribute *a) {
    lg_id_close(&a->type);
    lg_id_close(&a->attribute);
}
#define ATTRIBUTE(name)                                                                                      \
    LG_CLEAN(close_attribute) attribute name = {.attribute = H5I_INVALID_HID, .type = H5I_INVALID_HID}

static lg_status attribute_error(const lg_h5 *h5, const char *object, const char *name, lg_status status,
                                 const char *what, lg_error *error) {
    return lg_fail(error, status, "%s: /%s: attribute %s: %s", lg_shown_path(h5->path), object, name, what);
}

static lg_status open_attribute(lg_h5 *h5, const char *object, const char *name, attribute *a,
                                lg_error *error) {
    const char *at = *object == '\0' ? "/" : object;
    if (!lg_attribute_exists(h5, object, name))
        return attribute_error(h5, object, name, LG_NOT_FOUND, "is missing", error);
    a->attribute = H5Aopen_by_name(h5->file, at, name, H5P_DEFAULT, h5->links);
    a->type = H5Aget_type(a->attribute);
    LG_ID space = H5Aget_space(a->attribute);
    const hssize_t count = H5Sget_simple_extent_npoints(space);
    if (a->type < 0 || count < 0 || count > 1)
        return attribute_error(
            h5, object, name, LG_FORMAT,
            count > 1 ? "has more than one value, expected one: write a scalar" : "cannot be read", error);
    a->single = count == 1;
    return LG_OK;
}

typedef struct text_call {
    lg_h5 *h5;
    const char *object, *name;
    char *out;
    size_t size;
} text_call;

static lg_status copy_text(void *user, uint64_t index, const char *text, lg_error *error) {
    const text_call *call = user;
    const size_t length = strlen(text);
    if (length >= call->size)
        return attribute_error(call->h5, call->object, call->name, LG_SHAPE, "is too long", error);
    memcpy(call->out, text, length + 1);
    return LG_OK;
}

lg_status lg_h5_text(lg_h5 *h5, const char *object, const char *name, char *out, size_t size,
                     lg_error *error) {
    LG_QUIET;
    ATTRIBUTE(a);
    bool words = false;
    text_call call = {h5, object, name, out, size};
    LG_TRY(open_attribute(h5, object, name, &a, error));
    if (!a.single) *out = '\0';
    LG_TRY(lg_h5_each_attribute_text(h5, object, name, &words, copy_text, &call, error));
    return words ? LG_OK
                 : attribute_error(h5, object, name, LG_FORMAT, "is not a text: write it as a string", error);
}

/* Whether a type holds a whole number exactly. */
static bool holds(lg_element type, bool minus, uint64_t magnitude) {
    if (type == LG_ELEMENT_F64 || type == LG_ELEMENT_F32) return !lg_whole_is_rounded(magnitude);
    if (minus && magnitude > 0) return type == LG_ELEMENT_I64 && magnitude <= (uint64_t)1 << 63;
    return magnitude <= (type == LG_ELEMENT_U64   ? UINT64_MAX
                         : type == LG_ELEMENT_I64 ? (uint64_t)INT64_MAX
                                                  : UINT32_MAX);
}

lg_status lg_h5_number(lg_h5 *h5, const char *object, const char *name, lg_element type, void *out,
                       lg_error *error) {
    LG_QUIET;
    ATTRIBUTE(a);
    uint64_t value = 0, bits = 0; /* room for a number of any type; the bits of an integer */
    double real = 0;
    LG_TRY(open_attribute(h5, object, name, &a, error));
    const bool whole = H5Tget_class(a.type) == H5T_INTEGER,
               to_real = type == LG_ELEMENT_F64 || type == LG_ELEMENT_F32;
    if (!a.single || !lg_is_number(a.type))
        return attribute_error(
            h5, object, name, LG_FORMAT,
            to_real ? "is not a number: write it as one" : "is not an integer: write it as one", error);
    if (H5Aread(a.attribute, lg_h5_memory_type(type), &value) < 0 ||
        H5Aread(a.attribute, H5T_NATIVE_DOUBLE, &real) < 0 ||
        (whole && H5Aread(a.attribute, lg_h5_long_type(a.type), &bits) < 0))
        return attribute_error(h5, object, name, LG_FORMAT, "cannot be read", error);
    if (!to_real && !whole && !lg_is_whole(real))
        return attribute_error(h5, object, name, LG_FORMAT, "is not an integer: write it as one", error);
    /* HDF5 clips numbers that do not fit. */
    const bool minus = real < 0;
    const uint64_t magnitude = whole ? minus ? ~bits + 1 : bits : to_real ? 0 : (uint64_t)fabs(real);
    if (!holds(type, minus, magnitude))
        return attribute_error(h5, object, name, LG_FORMAT, "is out of range", error);
    memcpy(out, &value, lg_element_size(type));
    return LG_OK;
}

/* ---- the file's own attributes ---- */

static lg_status check_version(lg_h5 *h5, lg_error *error) {
    int64_t version;
    const char *shown = lg_shown_path(h5->path);
    if (!lg_h5_has_attribute(h5, "", "format_version")) return LG_OK;
    LG_TRY(lg_h5_number(h5, "", "format_version", LG_ELEMENT_I64, &version, error));
    if (version > LG_FORMAT_VERSION)
        return lg_fail(error, LG_VERSION, "%s: attribute format_version is %lld, this program reads up to %d",
                       shown, (long long)version, LG_FORMAT_VERSION);
    if (version < 1)
        return lg_fail(error, LG_FORMAT, "%s: attribute format_version is %lld, expected 1 or more", shown,
                       (long long)version);
    return LG_OK;
}

bool lg_h5_is_ours(lg_h5 *h5) {
    char text[16] = "";
    (void)lg_h5_text(h5, "", "format", text, sizeof text, NULL); /* on failure it stays empty */
    return strcmp(text, "liegrad") == 0;
}

lg_status lg_h5_check_format(lg_h5 *h5, const char *kind, bool foreign, lg_error *error) {
    char text[64] = "";
    const bool ours = lg_h5_is_ours(h5), has_kind = lg_h5_has_attribute(h5, "", "kind");
    const char *shown = lg_shown_path(h5->path);
    if (!ours && lg_h5_has_attribute(h5, "", "format")) {
        if (foreign) return LG_OK;
        (void)lg_h5_text(h5, "", "format", text, sizeof text, NULL);
        return lg_fail(error, LG_FORMAT, "%s: attribute format is '%s', expected 'liegrad'", shown,
                       lg_tamed(text));
    }
    LG_TRY(check_version(h5, error));
    if (kind == NULL || (foreign && !has_kind)) return LG_OK;
    if (!has_kind)
        return lg_fail(error, LG_FORMAT, "%s: attribute kind is missing, expected '%s'", shown, kind);
    LG_TRY(lg_as_format(lg_h5_text(h5, "", "kind", text, sizeof text, error), error));
    if (strcmp(text, kind) != 0 && (ours || !foreign))
        return lg_fail(error, LG_FORMAT, "%s: attribute kind is '%s', expected '%s': %s", shown,
                       lg_tamed(text), kind, lg_h5_what_is(text));
    return LG_OK;
}

void lg_h5_provenance(lg_h5 *h5, lg_provenance *out) {
    *out = (lg_provenance){0};
    (void)lg_h5_text(h5, "", "liegrad_version", out->liegrad_version, sizeof out->liegrad_version, NULL);
    (void)lg_h5_text(h5, "", "command", out->command, sizeof out->command, NULL);
    (void)lg_h5_text(h5, "", "cpu", out->cpu, sizeof out->cpu, NULL);
    out->has_seed = lg_h5_number(h5, "", "seed", LG_ELEMENT_U64, &out->seed, NULL) == LG_OK;
}
