/* Files: HDF5 data, models and checkpoints; YAML scenes and study grids. Library `liegrad_io`.
 *
 * Rules for every function here:
 * - A failure gives a status. When `error` is not NULL it also gives a sentence with the file, the key and,
 *   for YAML, the line. Outputs are untouched, and nothing leaks.
 * - A structure that owns memory is released by its own `_free` or `_destroy`, which leaves it zeroed. A
 *   zeroed structure may be freed.
 * - HDF5's own messages are silenced while these functions run and restored afterwards. HDF5 as Debian builds
 *   it is not thread-safe: only one thread of the process may read or write HDF5 at a time.
 * - Writers compose the file in memory, write it under a temporary name in the target's folder, fsync it,
 *   rename it, and fsync the folder. The old file stays whole until the rename. After a failure the old file
 *   is still whole, and no temporary file is left; what a killed process left is removed by the next writer
 *   of the file. A target that exists and is not a regular file (a device,
 *   a folder) is refused. A full disk and RLIMIT_FSIZE give LG_FILE.
 *
 * Statuses of readers:
 *   LG_NOT_FOUND      no such file (a missing key is LG_FORMAT)
 *   LG_FILE           the file cannot be opened or read, or is not a regular file
 *   LG_FORMAT         the file is empty, truncated, foreign, or has a wrong rank or type, sizes that do not
 *                     fit or exceed the limit, or bad values
 *   LG_NOT_FINITE     a NaN or infinity; the sentence has the key and the first index
 *   LG_VERSION        a newer major format version
 *   LG_OUT_OF_MEMORY
 */
#ifndef LIEGRAD_FILES_H
#define LIEGRAD_FILES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/core.h"

LG_BEGIN_DECLS

/* The newest major version of files (attribute `format_version`, an integer): files with functions, which are
 * programs and models, have it, data have version 1. Older versions are read, too. */
#define LG_FORMAT_VERSION 2

/* For executables, before any file: HDF5 does nothing when the process ends. Files are composed in memory
 * and closed when they are written, so nothing is open then; but HDF5 crashes there after it ran out of
 * memory. */
LG_API void lg_io_setup(void);

typedef struct lg_read_options {
    size_t size; /* sizeof(lg_read_options) */
    /* HDF5 crashes or loops on some damaged files. With probe, a forked child first reads the complete file,
     * with limits on memory, CPU time and, far above it, wall time. LG_FORMAT when the child dies, LG_FILE
     * when it stands still: probe_seconds and 4 s without CPU time. After 3 s a sentence goes to the log.
     * Default true. Turn it off in a process that must not fork. */
    bool probe;
    uint32_t probe_seconds; /* CPU time of the child, default 20 and more for large files */
    uint64_t max_size;      /* largest array in memory, default 8 GiB: beyond it LG_FORMAT */
    bool project_starts;    /* trajectories: first points off the manifold are brought back to it; false */
} lg_read_options;

/* Every `const lg_read_options *` may be NULL for these defaults. */
LG_API void lg_read_options_init(lg_read_options *options);

/* Writes `bytes` bytes as the complete file `path` by the steps listed above. CSV, SVG and JSON files are
 * written by it too. */
LG_API lg_status lg_file_write(const lg_context *context, const char *path, const void *data, size_t bytes,
                               lg_error *error);

/* A file or folder under a temporary name, `target`.tmp-PID-i, until it is whole and is renamed. Its writer
 * holds a lock on it (flock); what killed writers of the same target left is removed first. */
typedef struct lg_temporary {
    int fd;     /* of the file, for writing, or of the folder; holds the lock */
    char *name; /* to be renamed, or removed */
    const lg_context *context;
} lg_temporary;
/* Removes what killed writers of the target left; lg_temporary_create does it, too. */
LG_API void lg_temporary_sweep(const lg_context *context, const char *target);
/* Errors: LG_FILE with a sentence, LG_OUT_OF_MEMORY. */
LG_API lg_status lg_temporary_create(const lg_context *context, const char *target, bool folder,
                                     lg_temporary *out, lg_error *error);
/* Closes it, after the renaming; that fsync had no error is the caller's business. */
LG_API void lg_temporary_end(lg_temporary *temporary);

/* Who is at work on a file or folder: a lock on the file `target`.lock, which says process, host and `words`
 * (a command line, say). It is between processes, not threads, and over NFS too; where the file system has no
 * locks it is nobody's. The kernel lifts it when the process dies; the file is then taken over by the next
 * one. Readers need none: files are replaced whole. */
typedef struct lg_lock {
    int fd; /* -1: none is held */
    long process;
    char *name;
    const lg_context *context;
} lg_lock;
/* LG_FILE: another process holds it, and the sentence says which. `target` is a path whose links are
 * resolved: two names are two locks. Must not be taken twice in a process. */
LG_API lg_status lg_lock_take(const lg_context *context, const char *target, const char *words, lg_lock *out,
                              lg_error *error);
/* Removes the file, unless this is a child of the process that took it. */
LG_API void lg_lock_release(lg_lock *lock);

/* ---- SHA-256 (FIPS 180-4) ---- */

typedef struct lg_sha256 {
    uint32_t h[8];
    uint64_t bytes;
    uint8_t block[64];
} lg_sha256;

#define LG_SHA256_TEXT 65 /* 64 lower-case hexadecimal digits and the terminator */

LG_API void lg_sha256_init(lg_sha256 *state);
LG_API void lg_sha256_add(lg_sha256 *state, const void *data, size_t bytes);
LG_API void lg_sha256_finish(lg_sha256 *state, char text[LG_SHA256_TEXT]);

/* ---- where a file comes from ---- */

/* Files of other programs may lack these texts; they are then empty. Writers fill an empty
 * `liegrad_version`. */
typedef struct lg_provenance {
    char liegrad_version[32];
    char command[2048]; /* the command line, cut when longer */
    char cpu[256];      /* lg_cpu_describe: CPU, kernels, BLAS */
    bool has_seed;
    uint64_t seed;
} lg_provenance;

/* ---- named arrays in one HDF5 file: archives ---- */

/* A file under construction, in memory. One thread at a time. */
typedef struct lg_file_writer lg_file_writer;

/* `kind` ("hamiltonian", "checkpoint", "trajectories", ...) becomes attribute `kind`; `format` "liegrad",
 * `format_version`, `liegrad_version`, `conventions` and the provenance (may be NULL) are written too.
 * Nothing touches the disk before the commit. */
LG_API lg_status lg_file_writer_create(const lg_context *context, const char *path, const char *kind,
                                       const lg_provenance *provenance, lg_file_writer **out,
                                       lg_error *error);
/* An archive of paths below `prefix` ("" or "fit"; kept by copy, shorter than 64). Texts become attributes of
 * the group that their path names ("a/b" is attribute b of group /a). Valid until the writer is destroyed. A
 * failing call also sticks to the writer: the commit repeats it. */
LG_API lg_status lg_file_writer_archive(lg_file_writer *writer, const char *prefix, lg_archive_writer *out);
/* Writes the image to a temporary file, syncs and renames it. Call it once; after success or failure the
 * writer can only be destroyed. */
LG_API lg_status lg_file_writer_commit(lg_file_writer *writer, lg_error *error);
LG_API void
lg_file_writer_destroy(lg_file_writer *writer); /* NULL is fine; without a commit no file is made */

/* ---- trajectories of an ensemble, written as they come ---- */

typedef struct lg_rows_options {
    const lg_provenance *provenance; /* may be NULL */
    uint64_t first, rows;            /* members first, first + 1, ... */
    size_t points, dim;
    const double *t; /* (points) */
    const char *layout;
    const char *run; /* what the ensemble is, as its other files have it; may be NULL */
} lg_rows_options;

/* A file with /t and /trajectories (rows, points, dim), whose rows are written one by one into their places
 * on the disk: no row is kept in memory. All room is taken at once: a disk that is too small is known at the
 * start. Rows that are not put are zeros. */
typedef struct lg_rows_file lg_rows_file;
LG_API lg_status lg_rows_file_create(const lg_context *context, const char *path,
                                     const lg_rows_options *options, lg_rows_file **out, lg_error *error);
/* (points, dim). From any thread; each row once. LG_FILE: errno says why. */
LG_API lg_status lg_rows_file_put(const lg_rows_file *file, uint64_t row, const double *values);
/* Under its name once it is on the disk. */
LG_API lg_status lg_rows_file_commit(lg_rows_file *file, lg_error *error);
LG_API void lg_rows_file_destroy(lg_rows_file *file); /* NULL is fine; without a commit no file is left */

/* What such a file holds. No row is read, however many there are. `run` (size bytes) may be NULL. LG_FORMAT:
 * another file, or one that does not say which run it is of. */
typedef struct lg_rows_about {
    uint64_t first, rows, points, dim;
} lg_rows_about;
LG_API lg_status lg_rows_file_look(const lg_context *context, const char *path, lg_rows_about *out, char *run,
                                   size_t size, lg_error *error);

/* /trajectories of the writer's file: a virtual data set, the rows of these files in their order. The files
 * stand in the folder of the writer's file. */
typedef struct lg_rows_part {
    const char *path;
    uint64_t rows;
} lg_rows_part;
LG_API lg_status lg_file_writer_rows(lg_file_writer *writer, const lg_rows_part *parts, size_t count,
                                     uint64_t points, uint64_t dim, lg_error *error);

typedef struct lg_file_reader lg_file_reader;

/* `kind` NULL: any. With options->probe every array and attribute of the file is read once in the child. */
LG_API lg_status lg_file_reader_create(const lg_context *context, const char *path, const char *kind,
                                       const lg_read_options *options, lg_file_reader **out, lg_error *error);
LG_API lg_status lg_file_reader_archive(lg_file_reader *reader, const char *prefix, lg_archive_reader *out);
/* The sentence of the last failing archive call of this reader, "" if none. */
LG_API const char *lg_file_reader_message(const lg_file_reader *reader);
LG_API void lg_file_reader_provenance(const lg_file_reader *reader, lg_provenance *out);
LG_API void lg_file_reader_destroy(lg_file_reader *reader); /* NULL is fine */

LG_END_DECLS

#endif
