/* Files: rules and statuses for all files that the library reads and writes, complete writing of bytes,
 * temporary files, locks, SHA-256, and archives in HDF5. The files of one subject (Hamiltonians, series,
 * tables, ...) are in the header of the subject. Everything here and there that reads or writes files is in
 * the library liegrad_io, which needs HDF5 and libyaml. The guide is docs/files.md.
 *
 *   lg_file_writer *writer;
 *   lg_archive_writer archive;
 *   lg_file_writer_create(NULL, "state.h5", "my-state", NULL, &writer, &error);
 *   lg_file_writer_archive(writer, "", &archive);
 *   archive.array(archive.user, "x", LG_ELEMENT_F64, 1, &n, x);
 *   lg_status status = lg_file_writer_commit(writer, &error);
 *   lg_file_writer_destroy(writer);
 *
 * Rules for every function that reads or writes files:
 * - The sentence about a failure has the file, the key and, for YAML, the line.
 * - The messages of HDF5 itself are silenced while these functions run. HDF5 as Debian builds it is not
 *   thread-safe: only one thread of a process may read or write HDF5 files at a time.
 * - Writers compose the file in memory, write it under a temporary name in the folder of the target, fsync
 *   it, rename it to the target, and fsync the folder. The old file stays whole until the rename. After a
 *   failure the old file is still whole and no temporary file is left. The temporary file of a killed process
 *   is removed by the next writer of the same target. A target that exists and is not a regular file (a
 *   device, a folder) is refused. A full disk and the limit RLIMIT_FSIZE give LG_FILE.
 *
 * Statuses of readers (functions that read, load or open a file); comments name special cases only:
 *   LG_INVALID_ARGUMENT  a NULL path or output, read options of a wrong size
 *   LG_NOT_FOUND         there is no such file (a missing key is LG_FORMAT)
 *   LG_FILE              the file cannot be opened or read, or is not a regular file
 *   LG_FORMAT            the file is empty, truncated or of another kind, or a key has a wrong rank or type,
 *                        bad values, or sizes that do not fit or exceed the limit
 *   LG_NOT_FINITE        a number is NaN or infinite; the sentence has the key and the first such index
 *   LG_VERSION           the file has a newer major format version
 *   LG_CANCELLED
 * Statuses of writers (write, save): LG_INVALID_ARGUMENT, LG_NOT_FINITE, LG_FILE.
 */
#ifndef LIEGRAD_FILES_H
#define LIEGRAD_FILES_H

#include "liegrad/core.h"

LG_BEGIN_DECLS

/* The major version of the file format, the integer attribute `format_version`, of programs,
 * models and classifiers. Data files and checkpoints have version 1. Other versions are rejected. */
#define LG_FORMAT_VERSION 2

/* For executables, before the first file: stops HDF5 from running its clean-up when the process ends. That
 * clean-up is not needed, because files are composed in memory and closed when they are written; and it
 * crashes if HDF5 has run out of memory before. */
LG_API void lg_io_setup(void);

/* ---- options of readers ---- */

typedef struct lg_program lg_program; /* in liegrad/program.h */

typedef struct lg_read_options {
    size_t size; /* sizeof(lg_read_options) */
    /* Default true. HDF5 crashes or loops on some damaged files. With `probe` a forked child process first
     * reads the complete file, with limits on memory, CPU time and (far above it) wall time. If the child
     * dies the status is LG_FORMAT. If the child uses no CPU time for probe_seconds + 4 s the status is
     * LG_FILE. After 3 s a sentence goes to the log. If the child cannot be confined the status is LG_FILE:
     * the file is not read. With LIEGRAD_UNCONFINED=1 in the environment it is read in any case. Turn `probe`
     * off in a process that must not fork. */
    bool probe;
    uint32_t probe_seconds; /* CPU time of the child: default 20, plus one second per 32 MiB of the file */
    uint64_t max_size;      /* largest array in memory, bytes; default 8 GiB. A larger one gives LG_FORMAT */
    /* For trajectories: first points that are not on the manifold are projected to it. Default false. */
    bool project_starts;
    /* For trajectories: a program with the function `constraint` (liegrad/constraint.h), used instead of the
     * function in the file; borrowed. Default NULL. */
    const lg_program *constraint;
} lg_read_options;

/* Sets the defaults. A reader takes NULL for its options as these defaults. */
LG_API void lg_read_options_init(lg_read_options *options);

/* Every HDF5 file that liegrad writes begins with these 8 bytes. */
#define LG_H5_SIGNATURE "\x89HDF\r\n\x1a\n"

/* Sets *is: whether the file is in HDF5. Its signature is at byte 0, or behind a user block, at byte 512,
 * 1024, 2048, ... (files of MATLAB 7.3 have a user block of 512 bytes). Errors, *is is then false:
 * LG_NOT_FOUND, LG_FILE. */
LG_API lg_status lg_file_is_h5(const char *path, bool *is, lg_error *error);

/* Sets *ours: whether liegrad wrote the file, so that it is in HDF5 and its attribute `format` is `liegrad`.
 * *ours is false after a failure. */
LG_API lg_status lg_file_is_ours(const lg_context *context, const char *path, bool *ours, lg_error *error);

/* ---- writing bytes ---- */

/* Writes `bytes` bytes as the complete file `path`, by the steps of the rules above, unless the context's
 * `replace` rejects (liegrad/core.h). A symbolic link stays, and the file that it points to is replaced; if
 * it points to nothing, the status is LG_FILE. The writers of CSV, SVG and JSON files call this function. */
LG_API lg_status lg_file_write(const lg_context *context, const char *path, const void *data, size_t bytes,
                               lg_error *error);

/* A file or folder that is written under the temporary name .NAME.liegrad-tmp-INODE-PID in the folder of its
 * target, and renamed by its writer when it is complete. NAME is the last part of the target (its SHA-256 if
 * it has more than 90 bytes), INODE the number that the file itself has in the file system. The writer holds
 * a lock on it (flock), so what a killed process left can be told from a file that is being written. */
typedef struct lg_temporary {
    int fd;     /* descriptor of the file (for writing) or of the folder; holds the lock */
    char *name; /* the temporary name; the caller renames or removes it */
    const lg_context *context;
} lg_temporary;
/* Creates and locks a temporary file, or with `folder` a folder. Before that it removes the temporary files
 * and folders that killed writers of this target left: those whose names hold their own inode, that belong
 * to this user, and that nobody has locked. Folders with files stay. lg_lock_take removes them too. Errors:
 * LG_FILE if the file cannot be made, or if the target has the name of a lock or of a temporary file. */
LG_API lg_status lg_temporary_create(const lg_context *context, const char *target, bool folder,
                                     lg_temporary *out, lg_error *error);
/* Gives the complete temporary file the name `target`, for which lg_temporary_create made it: fsync of the
 * file, rename, fsync of the folder. After that the file survives a loss of power. If the file system cannot
 * sync folders, this is no error. Error: LG_FILE with a sentence; then the temporary file still has its
 * temporary name. */
LG_API lg_status lg_temporary_publish(lg_temporary *temporary, const char *target, lg_error *error);
/* Closes the descriptor and frees the name. Call it after lg_temporary_publish, the rename of a folder, or
 * the removal; this function reports no errors. */
LG_API void lg_temporary_end(lg_temporary *temporary);

/* A lock on an output, so that only one process at a time works on a file or folder: a lock (flock) on the
 * small file .NAME.liegrad-lock in the folder of `target` (docs/operating.md, "Locks"), which names the
 * process, the host and `words`. The kernel releases it when the process dies, and forked children do not
 * keep it. Readers need no lock, because files are replaced as a whole. */
typedef struct lg_lock {
    int fd; /* -1: no lock is held */
    long process;
    char *name;
    const lg_context *context;
} lg_lock;
/* Takes the lock. `words` says what the process does, for example its command line. `target` must be a path
 * whose links are resolved, because two names of a file would be two locks. If the path ends with a slash,
 * the lock is in this folder. Where the file system has no locks the result is LG_OK without a lock (fd -1).
 * Errors, *out is then without a lock: LG_FILE (a lock is held already, and the sentence says by which
 * process; the name of the lock is taken by another file; the lock cannot be written, also because the disk
 * is full; or the target has the name of a lock or of a temporary file), LG_OUT_OF_MEMORY (*out is
 * untouched). */
LG_API lg_status lg_lock_take(const lg_context *context, const char *target, const char *words, lg_lock *out,
                              lg_error *error);
/* Releases the lock and removes its file, if the name still leads to this file. In a forked child of the
 * process that took the lock it only frees the memory. A lock with fd -1 is fine. */
LG_API void lg_lock_release(lg_lock *lock);

/* ---- SHA-256 (FIPS 180-4) ---- */

typedef struct lg_sha256 {
    uint32_t h[8];
    uint64_t bytes;
    uint8_t block[64];
} lg_sha256;

#define LG_SHA256_TEXT 65 /* 64 lower-case hexadecimal digits and the terminator */

LG_API void lg_sha256_init(lg_sha256 *state);
LG_API void lg_sha256_add(lg_sha256 *state, const void *data, size_t bytes); /* appends to the hashed data */
LG_API void lg_sha256_finish(lg_sha256 *state, char text[LG_SHA256_TEXT]);   /* writes the hash as text */

/* ---- provenance ---- */

/* How a file came to be. A reader leaves texts empty that the file does not have, as files of other programs.
 * Writers put lg_version() for an empty `liegrad_version`. */
typedef struct lg_provenance {
    char liegrad_version[32];
    char command[2048]; /* the command line, cut if it is longer */
    char cpu[256];      /* the text of lg_cpu_describe: CPU, instruction set, BLAS */
    bool has_seed;
    uint64_t seed;
} lg_provenance;

/* ---- structures of model files ---- */

/* Members that the structures of all kinds of model files (lg_hamiltonian_file, lg_table_file, ...) begin
 * with:
 *   context      where the memory of the arrays comes from
 *   parameters   the model's number of parameters, as lg_hamiltonian_parameters(&run.model) gives it
 *   theta        (parameters), stored with the type run.training.dtype
 *   epochs_done  length of the series of the history
 *   history      (epochs_done) each, or NULL; NaN where there is no value (no validation part)
 *   provenance, and the run (run_) with the model and its hyperparameters */
#define LG_MODEL_HEAD                                                                                        \
    const lg_context *context;                                                                               \
    size_t parameters, epochs_done;                                                                          \
    double *theta, *history[LG_FIT_SERIES_COUNT];                                                            \
    lg_provenance provenance;
#define LG_MODEL_FILE(run_) LG_MODEL_HEAD run_ run

/* ---- writing an archive (one HDF5 file with named arrays) ---- */

/* A file that is composed in memory. Only one thread may use it at a time. */
typedef struct lg_file_writer lg_file_writer;

/* Begins a file. `kind` ("hamiltonian", "checkpoint", "trajectories", ...) becomes the attribute `kind`. The
 * attributes `format` ("liegrad"), `format_version`, `liegrad_version` and `conventions` and the provenance
 * (may be NULL) are written too. Nothing touches the disk before the commit. Errors: LG_INVALID_ARGUMENT. */
LG_API lg_status lg_file_writer_create(const lg_context *context, const char *path, const char *kind,
                                       const lg_provenance *provenance, lg_file_writer **out,
                                       lg_error *error);
/* Makes an archive (liegrad/core.h) whose paths are below `prefix`, such as "" or "fit" (copied, shorter than
 * 64 bytes). Arrays become datasets. A text becomes an attribute of the group that its path names: "a/b" is
 * attribute b of group /a. A path has fewer than 256 bytes and at most 32 slashes, also in a file that is
 * read. The archive is valid until the writer is destroyed. After a failing call of the archive nothing more
 * is stored, and the commit returns this failure. Errors: LG_INVALID_ARGUMENT. */
LG_API lg_status lg_file_writer_archive(lg_file_writer *writer, const char *prefix, lg_archive_writer *out);
/* Writes the file to the disk, by the steps of the rules above. Call it once; afterwards the writer can only
 * be destroyed, also after a failure. */
LG_API lg_status lg_file_writer_commit(lg_file_writer *writer, lg_error *error);
/* Frees the writer. Without a commit no file is made. NULL is fine. */
LG_API void lg_file_writer_destroy(lg_file_writer *writer);

/* ---- trajectories of an ensemble ---- */

typedef struct lg_rows_options {
    const lg_provenance *provenance; /* may be NULL */
    uint64_t first, rows;            /* the rows are the members first, first + 1, ..., first + rows - 1 */
    size_t points, dim;              /* points in time per row; numbers per point */
    const double *t;                 /* (points) times */
    const char *layout;              /* text that says what the `dim` numbers are; attribute `layout` */
    /* Text that identifies the ensemble, equal in all its files; attribute `ensemble`. May be NULL. */
    const char *run;
} lg_rows_options;

/* Begins a file with /t (points) and /trajectories (rows, points, dim). Each row is written directly to its
 * place on the disk; no row is kept in memory. The file gets its whole size at the start, so a disk that is
 * too small is noticed then. Rows that are never put are zeros. Errors: LG_INVALID_ARGUMENT (rows, points or
 * dim is 0 or too large), LG_FILE. */
typedef struct lg_rows_file lg_rows_file;
LG_API lg_status lg_rows_file_create(const lg_context *context, const char *path,
                                     const lg_rows_options *options, lg_rows_file **out, lg_error *error);
/* Writes row `row` (0..rows-1), values (points, dim). Any thread may call it; each row may be put once.
 * Errors: LG_INVALID_ARGUMENT, LG_FILE (errno says why). */
LG_API lg_status lg_rows_file_put(const lg_rows_file *file, uint64_t row, const double *values);
/* Syncs the file to the disk and renames it to its path. Errors: LG_FILE. */
LG_API lg_status lg_rows_file_commit(lg_rows_file *file, lg_error *error);
/* Frees the structure. Without a commit no file is left. NULL is fine. */
LG_API void lg_rows_file_destroy(lg_rows_file *file);

/* Reads the sizes of a file of lg_rows_file_create, without reading its rows. run (size bytes), or NULL,
 * becomes the text `run` of lg_rows_options. Errors: the statuses of readers; LG_FORMAT also for a file of
 * another kind. If `run` is not NULL: LG_NOT_FOUND for a file without this text, LG_SHAPE if it does not fit
 * into `size` bytes. */
typedef struct lg_rows_about {
    uint64_t first, rows, points, dim; /* as in lg_rows_options */
} lg_rows_about;
LG_API lg_status lg_rows_file_look(const lg_context *context, const char *path, lg_rows_about *out, char *run,
                                   size_t size, lg_error *error);

/* Adds /trajectories to the file of the writer: a virtual dataset that joins the rows of the files parts
 * (count), in their order. Only the last component of part->path is stored, because these files must be in
 * the same folder as the file of the writer. points and dim must be as in the parts. Errors:
 * LG_INVALID_ARGUMENT. */
typedef struct lg_rows_part {
    const char *path;
    uint64_t rows; /* number of rows in the file */
} lg_rows_part;
LG_API lg_status lg_file_writer_rows(lg_file_writer *writer, const lg_rows_part *parts, size_t count,
                                     uint64_t points, uint64_t dim, lg_error *error);

/* ---- reading an archive ---- */

typedef struct lg_file_reader lg_file_reader;

/* Opens a file of this kind; kind NULL accepts any kind. With options->probe the child process reads every
 * array and attribute of the file once. */
LG_API lg_status lg_file_reader_create(const lg_context *context, const char *path, const char *kind,
                                       const lg_read_options *options, lg_file_reader **out, lg_error *error);
/* Makes an archive whose paths are below `prefix`, as in lg_file_writer_archive. It is valid until the reader
 * is destroyed. Errors: LG_INVALID_ARGUMENT. */
LG_API lg_status lg_file_reader_archive(lg_file_reader *reader, const char *prefix, lg_archive_reader *out);
/* The sentence of the last failing archive call of this reader, or "". Valid until the next call. */
LG_API const char *lg_file_reader_message(const lg_file_reader *reader);
LG_API void lg_file_reader_provenance(const lg_file_reader *reader, lg_provenance *out);
LG_API void lg_file_reader_destroy(lg_file_reader *reader);

LG_END_DECLS

#endif
