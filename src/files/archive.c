/* Implements the archives of liegrad/core.h on top of an HDF5 file. */
#include <stdio.h>
#include <string.h>

#include "files/h5.h"

#define NAME_SIZE 256

struct lg_file_writer {
    const lg_context *context;
    lg_h5 *h5;
    lg_h5_view *views;
    lg_error failure; /* of a writer the first failure, of a reader the last one */
    bool committed;
};

struct lg_file_reader {
    lg_file_writer file; /* `committed` is not used */
};

static lg_status add_view(lg_file_writer *file, const char *prefix, lg_h5_view **out) {
    if (file == NULL || prefix == NULL || strlen(prefix) >= LG_H5_PREFIX) return LG_INVALID_ARGUMENT;
    lg_h5_view *view = lg_alloc(file->context, 1, sizeof *view);
    if (view == NULL) return LG_OUT_OF_MEMORY;
    *view = (lg_h5_view){.next = file->views, .h5 = file->h5, .failure = &file->failure};
    memcpy(view->prefix, prefix, strlen(prefix) + 1);
    *out = file->views = view;
    return LG_OK;
}

static lg_status full_name(lg_h5_view *view, const char *path, char name[NAME_SIZE]) {
    const char *slash = view->prefix[0] == '\0' ? "" : "/";
    const int length =
        path == NULL || *path == '\0' ? -1 : snprintf(name, NAME_SIZE, "%s%s%s", view->prefix, slash, path);
    if (length > 0 && length < NAME_SIZE && !lg_h5_is_deep(name)) return LG_OK;
    return lg_fail(view->failure, LG_INVALID_ARGUMENT, "a path is empty or too long");
}

/* Splits "a/b/c" into group "a/b" and attribute "c", in place. */
static const char *split(char *name, const char **group) {
    char *slash = strrchr(name, '/');
    *group = slash == NULL ? "" : name;
    if (slash != NULL) *slash = '\0';
    return slash == NULL ? name : slash + 1;
}

/* ---- writing ---- */

static lg_status write_array(void *user, const char *path, lg_element type, uint32_t rank,
                             const uint64_t *dims, const void *data) {
    lg_h5_view *view = user;
    char name[NAME_SIZE];
    LG_TRY(view->failure->status);
    LG_TRY(full_name(view, path, name));
    return lg_h5_put(view->h5, name, type, rank, dims, data, view->failure);
}

static lg_status write_text(void *user, const char *path, const char *value) {
    lg_h5_view *view = user;
    char name[NAME_SIZE];
    const char *group;
    LG_TRY(view->failure->status);
    LG_TRY(full_name(view, value != NULL ? path : NULL, name));
    const char *attribute = split(name, &group);
    return lg_h5_put_text(view->h5, group, attribute, value, view->failure);
}

lg_archive_writer lg_h5_view_writer(lg_h5_view *view) {
    return (lg_archive_writer){.user = view, .array = write_array, .text = write_text};
}

lg_status lg_file_writer_create(const lg_context *context, const char *path, const char *kind,
                                const lg_provenance *provenance, lg_file_writer **out, lg_error *error) {
    LG_NEEDS(error, path, kind, out);
    LG_CLEAN(lg_file_writer_destroy_at) lg_file_writer *writer = lg_alloc(context, 1, sizeof *writer);
    if (writer == NULL) return lg_no_memory_for(path, error);
    writer->context = context;
    LG_TRY(lg_h5_create(context, path, &writer->h5, error));
    LG_TRY(lg_h5_put_header(writer->h5, kind, provenance, error));
    return LG_MOVE(out, writer);
}

lg_status lg_file_writer_archive(lg_file_writer *writer, const char *prefix, lg_archive_writer *out) {
    lg_h5_view *view;
    LG_NEEDS(NULL, out);
    LG_TRY(add_view(writer, prefix, &view));
    *out = lg_h5_view_writer(view);
    return LG_OK;
}

lg_status lg_file_writer_commit(lg_file_writer *writer, lg_error *error) {
    if (writer == NULL || writer->committed)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the file was committed before, or the writer is NULL");
    writer->committed = true;
    if (writer->failure.status != LG_OK)
        return lg_fail(error, writer->failure.status, "%s", writer->failure.message);
    return lg_h5_commit(writer->h5, error);
}

void lg_file_writer_destroy(lg_file_writer *writer) {
    if (writer == NULL) return;
    lg_h5_close(writer->h5);
    for (lg_h5_view *view = writer->views, *next; view != NULL; view = next) {
        next = view->next;
        lg_free(writer->context, view);
    }
    lg_free(writer->context, writer);
}

/* ---- reading ---- */

static lg_status read_array(void *user, const char *path, lg_element type, uint32_t rank,
                            const uint64_t *dims, void *out) {
    lg_h5_view *view = user;
    char name[NAME_SIZE];
    LG_TRY(full_name(view, path, name));
    return lg_h5_get(view->h5, name, type, rank, dims, out, view->failure);
}

static lg_status read_shape(void *user, const char *path, uint32_t *rank, uint64_t dims[4]) {
    lg_h5_view *view = user;
    char name[NAME_SIZE];
    lg_h5_about about;
    LG_TRY(full_name(view, path, name));
    LG_TRY(lg_h5_look(view->h5, name, sizeof(double), &about, view->failure));
    *rank = about.rank;
    memcpy(dims, about.dims, sizeof about.dims);
    return LG_OK;
}

static lg_status read_text(void *user, const char *path, char *out, size_t size) {
    lg_h5_view *view = user;
    char name[NAME_SIZE];
    const char *group;
    LG_TRY(full_name(view, path, name));
    const char *attribute = split(name, &group);
    return lg_h5_text(view->h5, group, attribute, out, size, view->failure);
}

lg_archive_reader lg_h5_view_reader(lg_h5_view *view) {
    return (lg_archive_reader){.user = view, .array = read_array, .shape = read_shape, .text = read_text};
}

typedef struct open_call {
    const lg_context *context;
    const char *path, *kind;
    const lg_read_options *options;
    lg_h5 **h5;
} open_call;

static lg_status open_checked(void *user, lg_error *error) {
    open_call *call = user;
    LG_CLEAN(lg_h5_close_at) lg_h5 *h5 = NULL;
    LG_TRY(lg_h5_open(call->context, call->path, call->options, &h5, error));
    LG_TRY(lg_h5_check_format(h5, call->kind, false, error));
    return LG_MOVE(call->h5, h5);
}

static lg_status probe_all(void *user, lg_error *error) {
    open_call *call = user;
    LG_TRY(open_checked(call, error));
    return lg_h5_read_all(*call->h5, error);
}

lg_status lg_file_reader_create(const lg_context *context, const char *path, const char *kind,
                                const lg_read_options *options, lg_file_reader **out, lg_error *error) {
    LG_NEEDS(error, path, out);
    LG_CLEAN(lg_file_reader_destroy_at) lg_file_reader *reader = lg_alloc(context, 1, sizeof *reader);
    if (reader == NULL) return lg_no_memory_for(path, error);
    reader->file.context = context;
    open_call call = {context, path, kind, options, &reader->file.h5};
    LG_TRY(lg_probe(context, path, options, probe_all, &call, error));
    LG_TRY(open_checked(&call, error));
    return LG_MOVE(out, reader);
}

lg_status lg_file_reader_archive(lg_file_reader *reader, const char *prefix, lg_archive_reader *out) {
    lg_h5_view *view;
    LG_NEEDS(NULL, reader, out);
    LG_TRY(add_view(&reader->file, prefix, &view));
    *out = lg_h5_view_reader(view);
    return LG_OK;
}

const char *lg_file_reader_message(const lg_file_reader *reader) {
    return reader->file.failure.message;
}

void lg_file_reader_provenance(const lg_file_reader *reader, lg_provenance *out) {
    lg_h5_provenance(reader->file.h5, out);
}

void lg_file_reader_destroy(lg_file_reader *reader) {
    lg_file_writer_destroy((lg_file_writer *)reader); /* `file` is its first member */
}

lg_h5 *lg_file_writer_h5(lg_file_writer *writer) {
    return writer->h5;
}

lg_h5 *lg_file_reader_h5(lg_file_reader *reader) {
    return reader->file.h5;
}
