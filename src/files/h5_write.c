#include <stdlib.h>
#include <string.h>

#include "files/h5_internal.h"

void lg_io_setup(void) {
    (void)H5dont_atexit();
}

lg_status lg_h5_create(const lg_context *context, const char *path, lg_h5 **out, lg_error *error) {
    enum { CACHE = 4 << 20 };
    LG_CLEAN(lg_h5_close_at) lg_h5 *h5 = NULL;
    void *volatile room = malloc(CACHE); /* without memory for the cache of a file, HDF5 1.10 would crash */
    free(room);
    if (room == NULL) return lg_no_memory_for(path, error);
    LG_TRY(lg_h5_new(context, path, &h5, error));
    LG_QUIET;
    LG_ID create = H5Pcreate(H5P_FILE_CREATE), access = H5Pcreate(H5P_FILE_ACCESS);
    /* No times are stored, so that the same content gives the same bytes. The core driver keeps the file in
     * memory; no file of this name is written. */
    if (H5Pset_obj_track_times(create, false) >= 0 && H5Pset_fapl_core(access, LG_CORE_INCREMENT, false) >= 0)
        h5->file = H5Fcreate(lg_h5_memory_name(h5).text, H5F_ACC_TRUNC, create, access);
    if (h5->file < 0) return lg_h5_no_memory(h5, error);
    return LG_MOVE(out, h5);
}

static lg_status not_stored(const lg_h5 *h5, const char *object, const char *name, lg_error *error) {
    return lg_fail(error, LG_OUT_OF_MEMORY, "%s: /%s%s%s could not be stored in memory",
                   lg_shown_path(h5->path), object, *name == '\0' ? "" : " attribute ", name);
}

/* A link creation list that creates the missing groups of a path and marks names as UTF-8. */
static hid_t intermediate(void) {
    hid_t list = H5Pcreate(H5P_LINK_CREATE);
    if (H5Pset_create_intermediate_group(list, 1) >= 0 && H5Pset_char_encoding(list, H5T_CSET_UTF8) >= 0)
        return list;
    (void)H5Pclose(list);
    return H5I_INVALID_HID;
}

static hid_t create_dataset(lg_h5 *h5, const char *name, hid_t type, uint32_t rank, const uint64_t *dims) {
    hsize_t extent[LG_MAX_RANK];
    for (uint32_t i = 0; i < rank; i++) extent[i] = dims[i];
    LG_ID space = rank == 0 ? H5Screate(H5S_SCALAR) : H5Screate_simple((int)rank, extent, NULL);
    LG_ID links = intermediate(), create = H5Pcreate(H5P_DATASET_CREATE);
    if (H5Pset_obj_track_times(create, false) < 0) return H5I_INVALID_HID;
    return H5Dcreate2(h5->file, name, type, space, links, create, H5P_DEFAULT);
}

lg_status lg_h5_put(lg_h5 *h5, const char *name, lg_element type, uint32_t rank, const uint64_t *dims,
                    const void *data, lg_error *error) {
    if (rank > LG_MAX_RANK || name == NULL || *name == '\0' || lg_h5_file_type(type) < 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: a data set needs a name, a type and rank <= %d",
                       lg_shown_path(h5->path), LG_MAX_RANK);
    uint64_t count = 1;
    for (uint32_t i = 0; i < rank; i++) count *= dims[i];
    LG_QUIET;
    LG_ID set = create_dataset(h5, name, lg_h5_file_type(type), rank, dims);
    const bool stored = set >= 0 && (count == 0 || H5Dwrite(set, lg_h5_memory_type(type), H5S_ALL, H5S_ALL,
                                                            H5P_DEFAULT, data) >= 0);
    return stored ? LG_OK : not_stored(h5, name, "", error);
}

/* A fixed-length UTF-8 text type. */
static hid_t text_type(size_t bytes, H5T_str_t padding) {
    hid_t type = H5Tcopy(H5T_C_S1);
    if (H5Tset_size(type, bytes) >= 0 && H5Tset_cset(type, H5T_CSET_UTF8) >= 0 &&
        H5Tset_strpad(type, padding) >= 0)
        return type;
    (void)H5Tclose(type);
    return H5I_INVALID_HID;
}

lg_status lg_h5_put_texts(lg_h5 *h5, const char *name, const char *texts, size_t size, uint64_t count,
                          lg_error *error) {
    LG_QUIET;
    LG_ID type = text_type(size, H5T_STR_NULLTERM), set = create_dataset(h5, name, type, 1, &count);
    const bool stored = H5Dwrite(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, texts) >= 0;
    return stored ? LG_OK : not_stored(h5, name, "", error);
}

/* Opens an object. If it does not exist, creates a group of this name. */
static hid_t open_or_make(lg_h5 *h5, const char *object) {
    if (*object == '\0') return H5Oopen(h5->file, "/", H5P_DEFAULT);
    if (lg_h5_has(h5, object)) return H5Oopen(h5->file, object, h5->links);
    LG_ID links = intermediate(), create = H5Pcreate(H5P_GROUP_CREATE);
    if (H5Pset_obj_track_times(create, false) < 0) return H5I_INVALID_HID;
    return H5Gcreate2(h5->file, object, links, create, H5P_DEFAULT);
}

/* Writes an attribute: one value, or a list of *count values. */
static lg_status put_attribute(lg_h5 *h5, const char *object, const char *name, hid_t stored, hid_t memory,
                               const hsize_t *count, const void *value, lg_error *error) {
    LG_QUIET;
    LG_ID at = open_or_make(h5, object);
    LG_ID space = count == NULL ? H5Screate(H5S_SCALAR) : H5Screate_simple(1, count, NULL);
    LG_ID attribute = H5Acreate2(at, name, stored, space, H5P_DEFAULT, H5P_DEFAULT);
    return H5Awrite(attribute, memory, value) >= 0 ? LG_OK : not_stored(h5, object, name, error);
}

lg_status lg_h5_put_text(lg_h5 *h5, const char *object, const char *name, const char *value,
                         lg_error *error) {
    const size_t length = strnlen(value, LG_H5_TEXT - 1);
    char padded[LG_H5_TEXT] = {0};
    memcpy(padded, value, length);
    LG_QUIET;
    LG_ID type = text_type(length == 0 ? 1 : length, H5T_STR_NULLPAD);
    return put_attribute(h5, object, name, type, type, NULL, padded, error);
}

lg_status lg_h5_put_text_list(lg_h5 *h5, const char *object, const char *name, const char *texts, size_t size,
                              uint64_t count, lg_error *error) {
    const hsize_t extent = count;
    size_t longest = 1;
    for (uint64_t i = 0; i < count; i++)
        if (strlen(texts + i * size) > longest) longest = strlen(texts + i * size);
    LG_QUIET;
    LG_ID stored = text_type(longest, H5T_STR_NULLPAD), memory = text_type(size, H5T_STR_NULLTERM);
    return put_attribute(h5, object, name, stored, memory, &extent, texts, error);
}

lg_status lg_h5_put_number(lg_h5 *h5, const char *object, const char *name, lg_element type,
                           const void *value, lg_error *error) {
    return put_attribute(h5, object, name, lg_h5_file_type(type), lg_h5_memory_type(type), NULL, value,
                         error);
}

lg_status lg_h5_remove_attribute(lg_h5 *h5, const char *object, const char *name, lg_error *error) {
    if (!lg_h5_has_attribute(h5, object, name)) return LG_OK;
    LG_QUIET;
    if (H5Adelete_by_name(h5->file, *object == '\0' ? "/" : object, name, h5->links) >= 0) return LG_OK;
    return not_stored(h5, object, name, error);
}

lg_status lg_h5_put_header(lg_h5 *h5, const char *kind, const lg_provenance *provenance, lg_error *error) {
    static const lg_provenance none;
    const lg_provenance *from = provenance != NULL ? provenance : &none;
    const int64_t version = 1; /* lg_program_put_functions changes it to 2 */
    const char *writer = from->liegrad_version[0] != '\0' ? from->liegrad_version : lg_version();
    LG_TRY(lg_h5_put_text(h5, "", "format", "liegrad", error));
    LG_TRY(lg_h5_put_number(h5, "", "format_version", LG_ELEMENT_I64, &version, error));
    LG_TRY(lg_h5_put_text(h5, "", "kind", kind, error));
    LG_TRY(lg_h5_put_text(h5, "", "liegrad_version", writer, error));
    LG_TRY(lg_h5_put_text(
        h5, "", "conventions",
        "row-major; e3 points up; y1 = exp(xi) y0, xi = (angular, linear); weights (in, out), y = x W + b",
        error));
    if (from->command[0] != '\0') LG_TRY(lg_h5_put_text(h5, "", "command", from->command, error));
    if (from->cpu[0] != '\0') LG_TRY(lg_h5_put_text(h5, "", "cpu", from->cpu, error));
    if (from->has_seed) LG_TRY(lg_h5_put_number(h5, "", "seed", LG_ELEMENT_U64, &from->seed, error));
    return LG_OK;
}

lg_status lg_h5_commit(lg_h5 *h5, lg_error *error) {
    LG_QUIET;
    const ssize_t bytes =
        H5Fflush(h5->file, H5F_SCOPE_GLOBAL) >= 0 ? H5Fget_file_image(h5->file, NULL, 0) : -1;
    if (bytes <= 0) return lg_h5_no_memory(h5, error);
    LG_SCRATCH(char, image, h5->context, (size_t)bytes);
    if (image == NULL || H5Fget_file_image(h5->file, image, (size_t)bytes) != bytes)
        return lg_h5_no_memory(h5, error);
    return lg_file_write(h5->context, h5->path, image, (size_t)bytes, error);
}

lg_status lg_h5_finish(lg_h5 *h5, lg_status status, lg_error *error) {
    if (status == LG_OK) status = lg_h5_commit(h5, error);
    lg_h5_close(h5);
    return status;
}
