/* Reading attributes, and checking the file's own attributes: format, version, kind and provenance. */
#include <math.h>
#include <string.h>

#include "files/h5_internal.h"

/* An attribute in messages, and the memory for its text. */
typedef struct attribute {
    const lg_h5 *h5;
    const char *object, *name;
    char *out;
    size_t size;
} attribute;

static lg_status bad(const attribute *a, lg_status status, const char *what, lg_error *error) {
    return lg_fail(error, status, "%s: /%s: attribute %s: %s", lg_shown_path(a->h5->path), a->object, a->name,
                   what);
}

static lg_status copy_text(void *user, uint64_t index, const char *text, lg_error *error) {
    const attribute *a = user;
    const size_t length = strlen(text);
    *a->out = '\0';
    if (index > 0) return bad(a, LG_FORMAT, "has more than one text: write one string", error);
    if (length >= a->size) return bad(a, LG_SHAPE, "is too long: shorten it", error);
    memcpy(a->out, text, length + 1);
    return LG_OK;
}

lg_status lg_h5_text(lg_h5 *h5, const char *object, const char *name, char *out, size_t size,
                     lg_error *error) {
    attribute a = {h5, object, name, out, size};
    bool words = false;
    if (!lg_h5_has_attribute(h5, object, name)) return bad(&a, LG_NOT_FOUND, "is missing", error);
    *out = '\0';
    LG_TRY(lg_h5_each_name(h5, object, name, NULL, &words, copy_text, &a, error));
    return words ? LG_OK : bad(&a, LG_FORMAT, "is not a text: write it as a string", error);
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
    const attribute a = {.h5 = h5, .object = object, .name = name};
    const char *at = *object == '\0' ? "/" : object;
    const bool to_real = type == LG_ELEMENT_F64 || type == LG_ELEMENT_F32;
    const char *wrong = to_real ? "is not a number: write it as one" : "is not an integer: write it as one";
    uint64_t value = 0, bits = 0; /* room for a number of any type; the bits of an integer */
    double real = 0;
    LG_QUIET;
    if (!lg_attribute_exists(h5, object, name)) return bad(&a, LG_NOT_FOUND, "is missing", error);
    LG_ID attribute_id = H5Aopen_by_name(h5->file, at, name, H5P_DEFAULT, h5->links),
          stored = H5Aget_type(attribute_id), space = H5Aget_space(attribute_id);
    const hssize_t count = H5Sget_simple_extent_npoints(space);
    const bool whole = H5Tget_class(stored) == H5T_INTEGER;
    if (count > 1) return bad(&a, LG_FORMAT, "has more than one value, expected one: write a scalar", error);
    if (count == 0 || !lg_is_number(stored)) return bad(&a, LG_FORMAT, wrong, error);
    if (H5Aread(attribute_id, lg_h5_memory_type(type), &value) < 0 ||
        H5Aread(attribute_id, H5T_NATIVE_DOUBLE, &real) < 0 ||
        (whole && H5Aread(attribute_id, lg_h5_long_type(stored), &bits) < 0))
        return bad(&a, LG_FORMAT, "cannot be read: write it again", error);
    if (!to_real && !whole && !lg_is_whole(real)) return bad(&a, LG_FORMAT, wrong, error);
    /* HDF5 clips numbers that do not fit. */
    const bool minus = real < 0;
    const uint64_t magnitude = whole ? minus ? ~bits + 1 : bits : to_real ? 0 : (uint64_t)fabs(real);
    if (!holds(type, minus, magnitude)) return bad(&a, LG_FORMAT, "is out of range", error);
    memcpy(out, &value, lg_element_size(type));
    return LG_OK;
}

/* ---- the file's own attributes ---- */

bool lg_h5_is_ours(lg_h5 *h5) {
    char text[16] = "";
    (void)lg_h5_text(h5, "", "format", text, sizeof text, NULL); /* on failure it stays empty */
    return strcmp(text, "liegrad") == 0;
}

lg_status lg_h5_check_format(lg_h5 *h5, const char *kind, bool foreign, lg_error *error) {
    char text[64] = "";
    int64_t version = 1;
    const bool ours = lg_h5_is_ours(h5), has_kind = lg_h5_has_attribute(h5, "", "kind");
    if (!ours && lg_h5_has_attribute(h5, "", "format")) {
        if (foreign) return LG_OK;
        (void)lg_h5_text(h5, "", "format", text, sizeof text, NULL);
        return lg_h5_fail(h5, error, "attribute format is '%s', expected 'liegrad'", lg_tamed(text));
    }
    if (lg_h5_has_attribute(h5, "", "format_version"))
        LG_TRY(lg_h5_number(h5, "", "format_version", LG_ELEMENT_I64, &version, error));
    if (version > LG_FORMAT_VERSION)
        return lg_fail(error, LG_VERSION, "%s: attribute format_version is %lld, this program reads up to %d",
                       lg_shown_path(h5->path), (long long)version, LG_FORMAT_VERSION);
    if (version < 1)
        return lg_h5_fail(h5, error, "attribute format_version is %lld, expected 1 or more",
                          (long long)version);
    if (kind == NULL || (foreign && !has_kind)) return LG_OK;
    if (!has_kind) return lg_h5_fail(h5, error, "attribute kind is missing, expected '%s'", kind);
    LG_TRY(lg_as_format(lg_h5_text(h5, "", "kind", text, sizeof text, error), error));
    if (strcmp(text, kind) != 0 && (ours || !foreign))
        return lg_h5_fail(h5, error, "attribute kind is '%s', expected '%s': %s", lg_tamed(text), kind,
                          lg_h5_what_is(text));
    return LG_OK;
}

void lg_h5_provenance(lg_h5 *h5, lg_provenance *out) {
    *out = (lg_provenance){0};
    (void)lg_h5_text(h5, "", "liegrad_version", out->liegrad_version, sizeof out->liegrad_version, NULL);
    (void)lg_h5_text(h5, "", "command", out->command, sizeof out->command, NULL);
    (void)lg_h5_text(h5, "", "cpu", out->cpu, sizeof out->cpu, NULL);
    out->has_seed = lg_h5_number(h5, "", "seed", LG_ELEMENT_U64, &out->seed, NULL) == LG_OK;
}
