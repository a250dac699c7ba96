/* The common part of reading and writing HDF5: number types, file handles, existence of objects. */
#include "files/h5_internal.h"

#include <stdio.h>
#include <string.h>

/* ---- types ---- */

static const struct {
    size_t bytes;
    const hid_t *memory, *file;
} elements[] = {
    [LG_ELEMENT_F64] = {8, &H5T_NATIVE_DOUBLE_g, &H5T_IEEE_F64LE_g},
    [LG_ELEMENT_F32] = {4, &H5T_NATIVE_FLOAT_g, &H5T_IEEE_F32LE_g},
    [LG_ELEMENT_I64] = {8, &H5T_NATIVE_INT64_g, &H5T_STD_I64LE_g},
    [LG_ELEMENT_U64] = {8, &H5T_NATIVE_UINT64_g, &H5T_STD_U64LE_g},
    [LG_ELEMENT_U32] = {4, &H5T_NATIVE_UINT32_g, &H5T_STD_U32LE_g},
    [LG_ELEMENT_U8] = {1, &H5T_NATIVE_UINT8_g, &H5T_STD_U8LE_g},
};

size_t lg_element_size(lg_element type) {
    return elements[type].bytes;
}

hid_t lg_h5_memory_type(lg_element type) {
    return H5open() >= 0 ? *elements[type].memory : H5I_INVALID_HID;
}

hid_t lg_h5_file_type(lg_element type) {
    const bool known = (size_t)type < LG_COUNT(elements);
    return known && H5open() >= 0 ? *elements[type].file : H5I_INVALID_HID;
}

/* ---- handles ---- */

static herr_t refuse_external(const char *parent_file, const char *parent_group, const char *child_file,
                              const char *child_object, unsigned *flags, hid_t access, void *user) {
    return -1;
}

lg_status lg_h5_new(const lg_context *context, const char *path, lg_h5 **out, lg_error *error) {
    if (path == NULL || *path == '\0') return lg_fail(error, LG_INVALID_ARGUMENT, "a file needs a name");
    LG_QUIET;
    LG_CLEAN(lg_h5_close_at) lg_h5 *h5 = lg_alloc(context, 1, sizeof *h5);
    if (h5 != NULL)
        *h5 = (lg_h5){.context = context,
                      .path = lg_strdup(context, path),
                      .file = H5I_INVALID_HID,
                      .links = H5Pcreate(H5P_LINK_ACCESS)};
    if (h5 == NULL || h5->path == NULL || H5Pset_elink_cb(h5->links, refuse_external, NULL) < 0)
        return lg_no_memory_for(path, error);
    return LG_MOVE(out, h5);
}

lg_h5_name lg_h5_memory_name(const lg_h5 *h5) {
    lg_h5_name name;
    (void)snprintf(name.text, sizeof name.text, "/dev/null/liegrad-in-memory-%p", (const void *)h5);
    return name;
}

lg_status lg_h5_no_memory(const lg_h5 *h5, lg_error *error) {
    return lg_no_memory_for(h5->path, error);
}

lg_status lg_h5_fail(const lg_h5 *h5, lg_error *error, const char *format, ...) {
    char text[sizeof error->message];
    va_list arguments;
    va_start(arguments, format);
    (void)lg_format_list(text, sizeof text, format, arguments);
    va_end(arguments);
    return lg_fail(error, LG_FORMAT, "%s: %s", lg_shown_path(h5->path), text);
}

void lg_h5_close(lg_h5 *h5) {
    if (h5 == NULL) return;
    LG_QUIET;
    (void)H5Fclose(h5->file);
    (void)H5Pclose(h5->links);
    LG_FREE_ALL(h5->context, h5->path, h5);
}

/* ---- existence of objects ---- */

bool lg_path_exists(lg_h5 *h5, const char *name) {
    char part[512];
    size_t length = strlen(name);
    if (length == 0) return true; /* the root group */
    if (length >= sizeof part) return false;
    memcpy(part, name, length + 1);
    for (size_t i = 1; i < length; i++) {
        if (part[i] != '/') continue;
        part[i] = '\0';
        bool there = H5Lexists(h5->file, part, h5->links) != 0;
        part[i] = '/';
        if (!there) return false;
    }
    return H5Lexists(h5->file, name, h5->links) != 0 && H5Oexists_by_name(h5->file, name, h5->links) != 0;
}

bool lg_attribute_exists(lg_h5 *h5, const char *object, const char *name) {
    return lg_path_exists(h5, object) &&
           H5Aexists_by_name(h5->file, *object == '\0' ? "/" : object, name, h5->links) != 0;
}

bool lg_h5_has(lg_h5 *h5, const char *name) {
    LG_QUIET;
    return lg_path_exists(h5, name);
}

bool lg_h5_has_attribute(lg_h5 *h5, const char *object, const char *name) {
    LG_QUIET;
    return lg_attribute_exists(h5, object, name);
}
