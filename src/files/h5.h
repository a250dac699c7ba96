/* An HDF5 file that is composed in memory or read. Paths start at the root and have no leading slash; "" is
 * the root. Every function silences HDF5's own messages while it runs. Error messages name the file and the
 * data set or attribute (the key). */
#ifndef LG_H5_H
#define LG_H5_H

#define H5_USE_110_API
#include <hdf5.h>
#include <string.h>

#include "core/clean.h"
#include "core/stored.h"
#include "core/text.h"
#include "liegrad/files.h"

#define LG_H5_TEXT 4096 /* longest text that is read or written, in bytes with the terminator */

typedef struct lg_h5 {
    const lg_context *context;
    char *path;
    hid_t file;
    hid_t links;       /* link access list that refuses external links */
    uint64_t max_size; /* for reading: size limit of an array, in bytes */
} lg_h5;

/* Returns the path, or only its end if it is long, so that the error message has room for the key. */
static inline const char *lg_shown_path(const char *path) {
    const size_t length = strlen(path);
    return length > 200 ? path + length - 200 : path;
}

/* Fails because there is no memory for what is in the file. */
static inline lg_status lg_no_memory_for(const char *path, lg_error *error) {
    return lg_fail(error, LG_OUT_OF_MEMORY, "%s: out of memory", lg_shown_path(path));
}

/* End of the message about a whole number that no double equals. */
#define LG_ROUNDED                                                                                           \
    "no floating-point number equals it: leave the column out, use it for classes, or write it with an "     \
    "exponent (1.2e18) if it may be rounded"
/* HDF5 finds an object by its path: objects in many nested groups take cubic time. */
enum { LG_H5_DEPTH = 32 };
static inline bool lg_h5_is_deep(const char *path) {
    int depth = 0;
    for (; *path != '\0'; path++) depth += *path == '/';
    return depth > LG_H5_DEPTH;
}

/* Replaces the control characters of a text by '?', so that an error message can contain the text (lg_tame).
 * */
static inline const char *lg_tamed(char *text) {
    (void)lg_tame(text);
    return text;
}

lg_status lg_h5_no_memory(const lg_h5 *h5, lg_error *error);
/* Fails with LG_FORMAT and a message that begins with the path of the file. */
lg_status lg_h5_fail(const lg_h5 *h5, lg_error *error, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* ---- composing; nothing touches the disk before lg_h5_commit ---- */
lg_status lg_h5_create(const lg_context *context, const char *path, lg_h5 **out, lg_error *error);
/* Writes an array, and creates missing groups of its path. `dims` has `rank` numbers. */
lg_status lg_h5_put(lg_h5 *h5, const char *name, lg_element type, uint32_t rank, const uint64_t *dims,
                    const void *data, lg_error *error);
/* Writes `count` texts. `texts` has `size` bytes per text, including the terminator. */
lg_status lg_h5_put_texts(lg_h5 *h5, const char *name, const char *texts, size_t size, uint64_t count,
                          lg_error *error);
/* The functions below write an attribute of a data set or of a group. A missing group is created. Texts are
 * stored as fixed-length UTF-8 and cut at LG_H5_TEXT - 1 bytes. */
lg_status lg_h5_put_text(lg_h5 *h5, const char *object, const char *name, const char *value, lg_error *error);
/* Writes a list of `count` texts as one attribute. `texts` has `size` bytes per text, including the
 * terminator. */
lg_status lg_h5_put_text_list(lg_h5 *h5, const char *object, const char *name, const char *texts, size_t size,
                              uint64_t count, lg_error *error);
lg_status lg_h5_put_number(lg_h5 *h5, const char *object, const char *name, lg_element type,
                           const void *value, lg_error *error);
/* Returns LG_OK if the attribute did not exist. */
lg_status lg_h5_remove_attribute(lg_h5 *h5, const char *object, const char *name, lg_error *error);
lg_status lg_h5_commit(lg_h5 *h5, lg_error *error);
/* Commits the file if `status` is LG_OK, and closes it. Returns the first failure. */
lg_status lg_h5_finish(lg_h5 *h5, lg_status status, lg_error *error);
/* Loads an existing file into memory, to be read and changed. lg_h5_commit then replaces the file. */
lg_status lg_h5_edit(const lg_context *context, const char *path, lg_h5 **out, lg_error *error);

/* ---- reading ---- */
lg_status lg_h5_open(const lg_context *context, const char *path, const lg_read_options *options, lg_h5 **out,
                     lg_error *error);
/* Whether the file has an object, or OBJECT@ATTRIBUTE. If HDF5 cannot tell, the functions return true, and a
 * later read fails. */
bool lg_h5_has(lg_h5 *h5, const char *name);
bool lg_h5_has_attribute(lg_h5 *h5, const char *object, const char *name);
/* Reads an array. Fails with LG_SHAPE if the stored shape differs from (rank, dims). Integers are read only
 * from integer types, and each number must fit into `type`; a double must equal each stored integer. */
lg_status lg_h5_get(lg_h5 *h5, const char *name, lg_element type, uint32_t rank, const uint64_t *dims,
                    void *out, lg_error *error);
/* The same for doubles, which must be finite. A missing array or another shape is LG_FORMAT. */
lg_status lg_h5_get_finite(lg_h5 *h5, const char *name, uint32_t rank, const uint64_t *dims, double *out,
                           lg_error *error);
/* An array of doubles in a list that says what a file holds. A size of 0 is not known: reading sets it to the
 * size in the file, which must not be 0, and `from` to the array's name. `what`: what it counts, in messages;
 * may be NULL. */
typedef struct lg_h5_size {
    uint64_t n;
    const char *what, *from;
} lg_h5_size;
typedef struct lg_h5_array {
    const char *name;
    double **data;       /* NULL at *data: is not written */
    lg_h5_size *dims[3]; /* as many as the rank */
    bool optional;       /* the file may lack it */
} lg_h5_array;
/* Writes the arrays, whose numbers must be finite. */
lg_status lg_h5_put_arrays(lg_h5 *h5, const lg_h5_array *arrays, size_t count, lg_error *error);
/* Reads the arrays into new memory. Their numbers must be finite. LG_FORMAT if an array is missing or its
 * shape does not fit the sizes. The caller frees them, also after a failure. */
lg_status lg_h5_get_arrays(lg_h5 *h5, const lg_h5_array *arrays, size_t count, lg_error *error);

/* ---- arrays of other programs, of any type ---- */
typedef enum lg_h5_class { LG_H5_WHOLE, LG_H5_REAL, LG_H5_WORDS, LG_H5_OTHER, LG_H5_TABLE } lg_h5_class;
typedef struct lg_h5_about {
    /* LG_H5_WHOLE: integers and enumerations. LG_H5_WORDS: texts of fixed or variable length. LG_H5_TABLE:
     * records with named members. */
    lg_h5_class kind;
    uint32_t rank; /* at most 4 */
    uint64_t dims[4], count;
    double epsilon; /* relative spacing of the stored type; 0 for types that are not real */
    /* A float cannot hold all numbers exactly: true for reals of more than 4 bytes and integers of 4 bytes or
     * more. */
    bool wide;
    char raw; /* i, u: integers above four bytes, which LG_H5_RAW gives as int64_t or uint64_t; else 0 */
    uint32_t members;  /* of a table */
    uint64_t chunk[4]; /* shape of a chunk; zeros without chunks */
} lg_h5_about;
/* Indices first .. first + count - 1 along one axis of a data set, and all along its other axes. `member`: of
 * a table, the member to read; else NULL. */
typedef struct lg_h5_slice {
    const char *name, *member;
    uint32_t axis;
    uint64_t first, count;
} lg_h5_slice;
/* Does for one array all that lg_h5_get_arrays does but reading: looks (lg_h5_look), compares the shape with
 * the sizes, and sets those that are not known. Where a list is wanted, shapes (n, 1) and (1, n) and a single
 * number are lists, too. `words`: it may hold texts. */
lg_status lg_h5_fit(lg_h5 *h5, const lg_h5_array *array, size_t bytes, bool words, lg_h5_about *about,
                    lg_error *error);
/* Returns the last axis whose length is not 1; 0 if all lengths are 1. */
static inline uint32_t lg_h5_long_axis(const lg_h5_about *about) {
    uint32_t axis = 0;
    for (uint32_t i = 1; i < about->rank; i++)
        if (about->dims[i] != 1) axis = i;
    return axis;
}
/* Whether an array of numbers or texts is one row or one column: (n), (n, 1), (1, n), ..., not one number. */
static inline bool lg_h5_is_vector(const lg_h5_about *about) {
    uint32_t wide = 0;
    for (uint32_t i = 0; i < about->rank; i++) wide += about->dims[i] != 1;
    return wide == 1;
}
/* Describes a data set without reading its data. LG_NOT_FOUND if there is no such data set, LG_FORMAT if it
 * exceeds max_size at `bytes` bytes per element. */
lg_status lg_h5_look(lg_h5 *h5, const char *name, size_t bytes, lg_h5_about *out, lg_error *error);
/* The same for member `index` of a table, whose name is written to `text`. */
lg_status lg_h5_look_member(lg_h5 *h5, const char *name, uint32_t index, char *text, size_t size,
                            lg_h5_about *out, lg_error *error);
/* Reads the numbers of a slice as doubles into the caller's memory, in the order of the file. LG_H5_EXACT:
 * missing numbers (lg_h5_fills) become NaN, an integer that no double equals is LG_FORMAT; LG_H5_RAW:
 * integers of more than four bytes are not converted, see lg_h5_about.raw. */
typedef enum lg_h5_long { LG_H5_EXACT, LG_H5_RAW } lg_h5_long;
lg_status lg_h5_get_slice(lg_h5 *h5, const lg_h5_slice *slice, lg_h5_long as, double *out, lg_error *error);
/* Number of indices along an axis that are best read at once: about a megabyte, or whole chunks if these have
 * at most 64 megabytes. The array must not be empty. */
uint64_t lg_h5_block(const lg_h5_about *about, uint32_t axis);
/* Reads integers, or reals that are integers (up to 2^53), which must fit into int64_t. Fails with LG_FORMAT,
 * or with LG_NOT_FINITE; the message has the index. */
lg_status lg_h5_get_wholes(lg_h5 *h5, const char *name, const lg_h5_about *about, int64_t *out,
                           lg_error *error);
/* Copies integers to uint32_t. Fails with LG_FORMAT if one is below 0 or above `most`; the message has its
 * index. */
lg_status lg_h5_narrow(const lg_h5 *h5, const char *name, const int64_t *values, uint64_t count,
                       uint32_t most, uint32_t *out, lg_error *error);
/* Calls visit(user, index, text, error) for each text of a data set, in order, until one call fails. Each
 * text must be shorter than LG_H5_TEXT; padding is removed. All dimensions but one must be 1. */
typedef lg_status (*lg_h5_visit)(void *user, uint64_t index, const char *text, lg_error *error);
lg_status lg_h5_each_text_of(lg_h5 *h5, const lg_h5_slice *slice, lg_h5_visit visit, void *user,
                             lg_error *error);
lg_status lg_h5_each_text(lg_h5 *h5, const char *name, lg_h5_visit visit, void *user, lg_error *error);
/* The same for the texts of an attribute, which is a single text or a list. A single text may have up to 64
 * KiB. If the attribute is missing or of another type, *words becomes false and visit is not called. If
 * `joint` is not NULL, a single text holds several names: the first character of `joint` separates them, and
 * its other characters are skipped before each name. */
lg_status lg_h5_each_name(lg_h5 *h5, const char *object, const char *name, const char *joint, bool *words,
                          lg_h5_visit visit, void *user, lg_error *error);

/* ---- attributes ---- */
lg_status lg_h5_text(lg_h5 *h5, const char *object, const char *name, char *out, size_t size,
                     lg_error *error);
/* Reads an attribute with one element. `type` is F64, I64, U64 or U32, and must hold the number exactly. */
lg_status lg_h5_number(lg_h5 *h5, const char *object, const char *name, lg_element type, void *out,
                       lg_error *error);
/* Reads netCDF's attributes _FillValue and missing_value: numbers that stand for a missing one; the others
 * become NaN. lg_h5_is_fill: whether `value` is one of them, or the float that is nearest to one. */
enum { LG_H5_FILLS = 9 };
void lg_h5_fills(lg_h5 *h5, const char *name, double fill[LG_H5_FILLS]);
bool lg_h5_is_fill(const double fill[LG_H5_FILLS], double value);
/* Reads every numeric data set and every attribute once. The probe of an archive does this. */
lg_status lg_h5_read_all(lg_h5 *h5, lg_error *error);
/* Whether the attribute `format` says that this library wrote the file. */
bool lg_h5_is_ours(lg_h5 *h5);
/* The attribute `kind`, or "" if the file does not have it or is of another format. */
enum { LG_H5_KIND = 64 };
lg_status lg_h5_kind(lg_h5 *h5, char text[LG_H5_KIND], lg_error *error);
/* Says what a file of this kind is, for the end of a message. */
const char *lg_h5_what_is(const char *kind);
/* Checks format, version and kind of the file. kind NULL accepts any kind. `foreign` also accepts files of
 * another format and files that name no format. */
lg_status lg_h5_check_format(lg_h5 *h5, const char *kind, bool foreign, lg_error *error);

void lg_h5_close(lg_h5 *h5); /* h5 may be NULL */
LG_AT(lg_h5_close, lg_h5)

/* Fails with LG_NOT_FINITE if `data` has a NaN or an infinity. The message has the key and the first such
 * index. */
lg_status lg_check_finite(const char *path, const char *name, uint32_t rank, const uint64_t *dims,
                          const double *data, lg_error *error);

/* Writes the attributes format, format_version, liegrad_version, conventions, kind, and from `provenance`
 * seed, command line and CPU. */
lg_status lg_h5_put_header(lg_h5 *h5, const char *kind, const lg_provenance *provenance, lg_error *error);
void lg_h5_provenance(lg_h5 *h5, lg_provenance *out);

/* ---- archives (archive.c) ---- */

#define LG_H5_PREFIX 64 /* bytes */

/* The `user` of an archive points to this. `failure` receives the error messages. A writer stores nothing
 * more after its first failure. */
typedef struct lg_h5_view {
    struct lg_h5_view *next;
    lg_h5 *h5;
    lg_error *failure;
    char prefix[LG_H5_PREFIX]; /* prepended to all paths; may be "" */
} lg_h5_view;
lg_archive_writer lg_h5_view_writer(lg_h5_view *view);
lg_archive_reader lg_h5_view_reader(lg_h5_view *view);

LG_AT(lg_file_writer_destroy, lg_file_writer)
LG_AT(lg_file_reader_destroy, lg_file_reader)
/* The HDF5 file behind a file writer or file reader. */
lg_h5 *lg_file_writer_h5(lg_file_writer *writer);
lg_h5 *lg_file_reader_h5(lg_file_reader *reader);

/* Add the numbers to the hash, as little-endian doubles or as little-endian four-byte numbers. */
void lg_sha256_add_doubles(lg_sha256 *state, const double *values, size_t count);
void lg_sha256_add_floats(lg_sha256 *state, const float *values, size_t count);
void lg_sha256_add_u32(lg_sha256 *state, const uint32_t *values, size_t count);

/* ---- probe ---- */

/* Runs read(user, error) in a forked child with limits on memory and CPU time. Returns the child's status and
 * message; or LG_FORMAT if the child dies; or LG_FILE if it stands still (uses no CPU time for
 * options->probe_seconds + 4 s); or LG_CANCELLED. After 3 s a log message says that the check goes on.
 * options NULL stands for the defaults. Without options->probe it returns LG_OK at once. A file that cannot
 * be opened gives LG_OK, because the reader that follows reports it. */
lg_status lg_probe(const lg_context *context, const char *path, const lg_read_options *options,
                   lg_status (*read)(void *user, lg_error *error), void *user, lg_error *error);
/* Opens the file and runs read(user, h5, error), first in the child process of lg_probe, then in this
 * process. */
lg_status lg_h5_read(const lg_context *context, const char *path, const lg_read_options *options,
                     lg_status (*read)(void *user, lg_h5 *h5, lg_error *error), void *user, lg_error *error);
/* Copies the options, or the defaults if `options` is NULL. Fails with LG_INVALID_ARGUMENT if options->size
 * is wrong. */
lg_status lg_read_options_resolve(const lg_read_options *options, lg_read_options *out, lg_error *error);

#endif
