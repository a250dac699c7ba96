/* One HDF5 file that is composed in memory or read. Paths start at the root and have no leading slash; "" is
 * the root. Every function silences HDF5's own messages while it runs. Failures give a sentence with the file
 * and the key. */
#ifndef LG_H5_H
#define LG_H5_H

#define H5_USE_110_API
#include <hdf5.h>

#include "core/core.h"
#include "liegrad/io.h"

#define LG_H5_TEXT 4096 /* longest text read or written, with its terminator */

typedef struct lg_h5 {
    const lg_context *context;
    char *path;
    hid_t file;
    hid_t links;       /* link access list that refuses external links */
    uint64_t max_size; /* reading: the largest array */
} lg_h5;

/* The end of a long path, so that a sentence keeps room for its key. */
const char *lg_shown_path(const char *path);

/* A text of a file as it may stand in a sentence: control characters become '?'. */
static inline const char *lg_tamed(char *text) {
    for (char *c = text; *c != '\0'; c++)
        if ((unsigned char)*c < ' ' || *c == '\x7f') *c = '?';
    return text;
}

/* ---- composing; nothing touches the disk before lg_h5_commit ---- */
lg_status lg_h5_create(const lg_context *context, const char *path, lg_h5 **out, lg_error *error);
/* Missing groups of the path are made. dims has rank numbers. */
lg_status lg_h5_put(lg_h5 *h5, const char *name, lg_element type, uint32_t rank, const uint64_t *dims,
                    const void *data, lg_error *error);
/* Texts of `size` bytes each, terminators included, (count, size). */
lg_status lg_h5_put_texts(lg_h5 *h5, const char *name, const char *texts, size_t size, uint64_t count,
                          lg_error *error);
/* Attributes of a data set, or of a group, which is made if it is missing. Texts are fixed-length UTF-8, cut
 * at LG_H5_TEXT - 1 bytes. */
lg_status lg_h5_put_text(lg_h5 *h5, const char *object, const char *name, const char *value, lg_error *error);
/* A list of texts of `size` bytes each, terminators included, (count, size). */
lg_status lg_h5_put_text_list(lg_h5 *h5, const char *object, const char *name, const char *texts, size_t size,
                              uint64_t count, lg_error *error);
lg_status lg_h5_put_number(lg_h5 *h5, const char *object, const char *name, lg_element type,
                           const void *value, lg_error *error);
/* LG_OK when there was none. */
lg_status lg_h5_remove_attribute(lg_h5 *h5, const char *object, const char *name, lg_error *error);
lg_status lg_h5_commit(lg_h5 *h5, lg_error *error);
/* A copy in memory of an existing file, to be read and changed; lg_h5_commit replaces the file. */
lg_status lg_h5_edit(const lg_context *context, const char *path, lg_h5 **out, lg_error *error);

/* ---- reading ---- */
lg_status lg_h5_open(const lg_context *context, const char *path, const lg_read_options *options, lg_h5 **out,
                     lg_error *error);
bool lg_h5_has(lg_h5 *h5, const char *name);
bool lg_h5_has_attribute(lg_h5 *h5, const char *object, const char *name);
/* Shape of a numeric data set of rank <= 4 whose elements fit into max_size as doubles. `epsilon` (may be
 * NULL): relative spacing of the stored type, 0 for integers. LG_NOT_FOUND: no such data set. */
lg_status lg_h5_shape(lg_h5 *h5, const char *name, uint32_t *rank, uint64_t dims[4], double *epsilon,
                      lg_error *error);
/* LG_SHAPE when the stored shape differs from (rank, dims). Integers are read from integers only and must
 * fit. */
lg_status lg_h5_get(lg_h5 *h5, const char *name, lg_element type, uint32_t rank, const uint64_t *dims,
                    void *out, lg_error *error);
/* The same into new memory (lg_free); dims becomes the shape. LG_FORMAT: another rank. Doubles must be
 * finite. */
lg_status lg_h5_get_doubles(lg_h5 *h5, const char *name, uint32_t rank, uint64_t dims[4], double **out,
                            lg_error *error);
/* ---- arrays of other programs, of any type ---- */
typedef enum lg_h5_class { LG_H5_WHOLE, LG_H5_REAL, LG_H5_WORDS, LG_H5_OTHER } lg_h5_class;
typedef struct lg_h5_about {
    lg_h5_class kind; /* LG_H5_WHOLE: integers and enumerations; LG_H5_WORDS: texts of any sort */
    uint32_t rank;    /* <= 4 */
    uint64_t dims[4], count;
    bool wide; /* a float may round the numbers: reals of more than 4 bytes, integers of 4 bytes and more */
} lg_h5_about;
/* Reads nothing. LG_NOT_FOUND: no such data set; LG_FORMAT: with `bytes` an element it exceeds max_size. */
lg_status lg_h5_look(lg_h5 *h5, const char *name, size_t bytes, lg_h5_about *out, lg_error *error);
/* All numbers into the caller's memory, without a second array for any stored type. Finiteness is not
 * checked: numbers beyond the range of a float become infinite. */
lg_status lg_h5_get_floats(lg_h5 *h5, const char *name, float *out, lg_error *error);
/* The same numbers as doubles, in order, in blocks of whole rows of the first extent: visit(user, row, rows,
 * values). A block takes about a megabyte, or one chunk of up to 64 megabytes. */
typedef void (*lg_h5_rows)(void *user, uint64_t row, uint64_t rows, const double *values);
lg_status lg_h5_each_rows(lg_h5 *h5, const char *name, lg_h5_rows visit, void *user, lg_error *error);
/* Integers that fit, or reals that are whole (up to 2^53). Errors: LG_FORMAT, LG_NOT_FINITE with the index.
 */
lg_status lg_h5_get_wholes(lg_h5 *h5, const char *name, const lg_h5_about *about, int64_t *out,
                           lg_error *error);
/* visit(user, index, text, error) for each text of a data set in order, until one fails. Shorter than
 * LG_H5_TEXT each, padding removed. All extents but the first are 1. */
typedef lg_status (*lg_h5_visit)(void *user, uint64_t index, const char *text, lg_error *error);
lg_status lg_h5_each_text(lg_h5 *h5, const char *name, lg_h5_visit visit, void *user, lg_error *error);
/* The same for the texts of an attribute, one or a list; a single one may have up to 64 KiB. *words is false
 * when the attribute is missing or of another type; nothing is visited then. */
lg_status lg_h5_each_attribute_text(lg_h5 *h5, const char *object, const char *name, bool *words,
                                    lg_h5_visit visit, void *user, lg_error *error);

/* ---- attributes ---- */
lg_status lg_h5_text(lg_h5 *h5, const char *object, const char *name, char *out, size_t size,
                     lg_error *error);
/* One element: F64, I64, U64 or U32; rank 0 or one element. */
lg_status lg_h5_number(lg_h5 *h5, const char *object, const char *name, lg_element type, void *out,
                       lg_error *error);
/* Reads every numeric data set and every attribute once: what the probe of an archive does. */
lg_status lg_h5_read_all(lg_h5 *h5, lg_error *error);
/* Attribute `kind`; "" for a file without it or of another format. */
enum { LG_H5_KIND = 64 };
lg_status lg_h5_kind(lg_h5 *h5, char text[LG_H5_KIND], lg_error *error);
/* Checks version and kind; kind NULL: any. `foreign` allows files of another format or without one. */
lg_status lg_h5_check_format(lg_h5 *h5, const char *kind, bool foreign, lg_error *error);

/* LG_NOT_FOUND and LG_SHAPE of a key become LG_FORMAT, in the result and in `error` (may be NULL). */
lg_status lg_as_format(lg_status status, lg_error *error);

void lg_h5_close(lg_h5 *h5); /* NULL is fine */

/* LG_NOT_FINITE with key and first index when data has a NaN or infinity. */
lg_status lg_check_finite(const char *path, const char *name, uint32_t rank, const uint64_t *dims,
                          const double *data, lg_error *error);

/* format, format_version, liegrad_version, conventions, kind, seed, command line, CPU. */
lg_status lg_h5_put_header(lg_h5 *h5, const char *kind, const lg_provenance *provenance, lg_error *error);
void lg_h5_provenance(lg_h5 *h5, lg_provenance *out);

/* ---- archives (archive.c) ---- */

#define LG_H5_PREFIX 64 /* bytes */

/* What an archive's `user` points to. `failure` receives the sentences; after a failure nothing is written.
 */
typedef struct lg_h5_view {
    struct lg_h5_view *next;
    lg_h5 *h5;
    lg_error *failure;
    char prefix[LG_H5_PREFIX]; /* of all paths; "": none */
} lg_h5_view;
lg_archive_writer lg_h5_view_writer(lg_h5_view *view);
lg_archive_reader lg_h5_view_reader(lg_h5_view *view);

/* What stands behind a file's archives. */
lg_h5 *lg_file_writer_h5(lg_file_writer *writer);
lg_h5 *lg_file_reader_h5(lg_file_reader *reader);

/* LG_NOT_FOUND of a key becomes LG_FORMAT, in the result and in `error` (may be NULL). */
lg_status lg_missing_is_format(lg_status status, lg_error *error);

/* Adds them as little-endian doubles, or numbers of four bytes. */
void lg_sha256_add_doubles(lg_sha256 *state, const double *values, size_t count);
void lg_sha256_add_floats(lg_sha256 *state, const float *values, size_t count);
void lg_sha256_add_u32(lg_sha256 *state, const uint32_t *values, size_t count);

/* ---- probe ---- */

/* Runs read(user, error) in a forked child with limits on memory and CPU time. Returns the status and
 * sentence of the child, or LG_FORMAT when it dies, LG_FILE when it stands still (no use of the processor for
 * options->probe_seconds and 4 s), LG_CANCELLED. After 3 s a sentence says that it goes on. options NULL: the
 * defaults; without options->probe: LG_OK at once. A file that cannot be opened gives LG_OK; the reader that
 * follows reports it. */
lg_status lg_probe(const lg_context *context, const char *path, const lg_read_options *options,
                   lg_status (*read)(void *user, lg_error *error), void *user, lg_error *error);
/* Opens the file and runs read(user, h5, error), first in the child of lg_probe, then here. */
lg_status lg_h5_read(const lg_context *context, const char *path, const lg_read_options *options,
                     lg_status (*read)(void *user, lg_h5 *h5, lg_error *error), void *user, lg_error *error);
/* options with the defaults filled in; LG_INVALID_ARGUMENT for a wrong size. */
lg_status lg_read_options_resolve(const lg_read_options *options, lg_read_options *out, lg_error *error);

#endif
