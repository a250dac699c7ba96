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
#ifndef LIEGRAD_IO_H
#define LIEGRAD_IO_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/archive.h"
#include "liegrad/context.h"
#include "liegrad/detector.h"
#include "liegrad/elastica.h"
#include "liegrad/fields.h"
#include "liegrad/hamiltonian.h"
#include "liegrad/mechanics.h"
#include "liegrad/model.h"
#include "liegrad/nn.h"
#include "liegrad/novelty.h"
#include "liegrad/program.h"
#include "liegrad/random.h"
#include "liegrad/search.h"
#include "liegrad/series.h"
#include "liegrad/status.h"
#include "liegrad/surrogate.h"
#include "liegrad/table.h"

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

/* ---- named arrays in one HDF5 file: the archives of liegrad/archive.h ---- */

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

/* ---- trajectories ---- */

/* Systems have the names of liegrad/mechanics.h ("pendulum-chain", "quartic", "oscillator", ...). A data
 * set may have another name, or none; its layout then determines the family. */
#define LG_SYSTEM_NAME 64

/* N trajectories of M equidistant points of d numbers. */
typedef struct lg_trajectories {
    char system[LG_SYSTEM_NAME];         /* "" when the file does not say */
    const lg_hamiltonian_family *family; /* that learns them */
    uint32_t n;                          /* copies of its factors: links of a chain, degrees of freedom */
    size_t count, points;                /* N >= 1, M >= 2 */
    uint32_t state_dim;                  /* d */
    uint32_t input_dim;                  /* m, 0 without inputs */
    double dt;                           /* (t[M-1] - t[0])/(M-1) */
    double *t;                           /* (M) */
    double *data;                        /* (N, M, d) */
    double *hamiltonian;                 /* (N), energies of the starts, or NULL */
    double *inputs;                      /* (N, M-1, m), or NULL */
    bool guessed;      /* the file gives neither system nor layout: the family is the first that fits */
    double starts_off; /* how far first points were off the manifold before they were brought back */
    lg_system *truth;  /* the system that made them, or NULL: unknown; owned */
    char sha256[LG_SHA256_TEXT]; /* of t, data and inputs as little-endian doubles, one after the other; set
                                     by reader and writer */
    lg_provenance provenance;
    const lg_context *context; /* whose memory the arrays are in */
} lg_trajectories;

/* Sets system (may be ""), family, n, sizes, dt and t = 0, dt, ..., t_end; allocates t, data
 * and, where asked, hamiltonian and inputs, zeroed. `out` is overwritten. Errors: LG_INVALID_ARGUMENT (a
 * known system of another family or size), LG_OUT_OF_MEMORY. */
LG_API lg_status lg_trajectories_create(const lg_context *context, const char *system,
                                        const lg_hamiltonian_family *family, uint32_t n, size_t count,
                                        size_t points, double t_end, bool with_hamiltonian,
                                        uint32_t input_dim, lg_trajectories *out);
/* A copy of the system that made the data becomes data->truth, in the place of an earlier one. Errors:
 * LG_INVALID_ARGUMENT (a system of another name, family or size), LG_OUT_OF_MEMORY. */
LG_API lg_status lg_trajectories_set_truth(lg_trajectories *data, const lg_system *system);
/* Datasets /t (M), /trajectories (N, M, d), optional /hamiltonian (N), /inputs (N, M-1, m) and the
 * parameters of the system, /parameters/KEY (numbers), any integer or float type. `truth` is made when the
 * system is known and all its parameters are there. Attributes of the root (or of /trajectories), all
 * optional where they can be derived: `system`, `links` (chains), `layout`. Checked: /t increasing and
 * equidistant (each point within 1e-6 dt and the rounding of its stored type), everything finite, d fits
 * system and links, first points of a chain on T*S^2 within 1e-6 (later ones may carry noise; with
 * options->project_starts they too). */
LG_API lg_status lg_trajectories_read(const lg_context *context, const char *path,
                                      const lg_read_options *options, lg_trajectories *out, lg_error *error);
/* Fills data->sha256. Non-finite data is refused with LG_NOT_FINITE: a file that could not be read back is
 * not written. */
LG_API lg_status lg_trajectories_write(const lg_context *context, const char *path, lg_trajectories *data,
                                       lg_error *error);
LG_API void lg_trajectories_destroy(lg_trajectories *data);

/* ---- learned Hamiltonians ---- */

/* What training computes in: the units of the data, or scales and weights by the data
 * (lg_hamiltonian_find_scales, lg_hamiltonian_weigh). */
typedef enum lg_hamiltonian_units { LG_UNITS_GIVEN, LG_UNITS_DATA } lg_hamiltonian_units;

/* Model, training and data of a run. Models and checkpoints store it, and a resumed run is compared with
 * it. */
typedef struct lg_hamiltonian_run {
    lg_hamiltonian model;
    char system[LG_SYSTEM_NAME];
    const lg_scheme *scheme; /* of the library: attribute `integrator` */
    uint32_t substeps;
    double penalty; /* mu */
    lg_penalty_form penalty_form;
    uint32_t penalty_integral; /* lg_first_integral_at */
    uint32_t penalty_copy;     /* from 1; 0 is 1 */
    lg_penalty_points penalty_points;
    lg_hamiltonian_distance distance;
    bool scaled; /* lg_hamiltonian_scale before training */
    lg_hamiltonian_units units;
    lg_hamiltonian_starts starts;
    lg_training training;
    uint64_t trajectories, points; /* N, M */
    double dt;
    char data_sha256[LG_SHA256_TEXT];
} lg_hamiltonian_run;
LG_API extern const lg_field lg_hamiltonian_fields[]; /* of lg_hamiltonian_run */

/* The test set that a model was judged on. 0 and "": unknown. */
typedef struct lg_test_set {
    uint64_t trajectories, points; /* N, M */
    double t_end;                  /* from the first point to the last */
    char sha256[LG_SHA256_TEXT];   /* as in lg_trajectories */
} lg_test_set;

typedef struct lg_hamiltonian_file {
    lg_hamiltonian_run run;
    size_t parameters;       /* lg_hamiltonian_parameters(&run.model) */
    double *theta;           /* (parameters); stored as run.training.dtype */
    double *adam_m, *adam_v; /* (parameters), or both NULL */
    uint64_t adam_step;
    bool has_rng;
    lg_rng rng;
    size_t epochs_done;
    double *history[LG_FIT_SERIES_COUNT]; /* (epochs_done) each, or NULL; may hold NaN (no validation part) */
    bool has_e1, has_e2;
    double e1, e2;    /* errors on a test set, if one was evaluated: lg_model_record_hamiltonian */
    lg_test_set test; /* which one */
    lg_provenance provenance;
    const lg_context *context; /* whose memory the arrays are in */
} lg_hamiltonian_file;

/* /model/potential/layer1/{weight (in, out), bias} ..., /model/mass/{gamma (k, k), b (k)} or
 * /model/kinetic/A (n, n), /optimizer/adam/{m, v, step}, /rng, /train/history/{loss, validation, seconds,
 * rate}. `file` is borrowed with everything that it points to. A `fit` (may be NULL) replaces the file's
 * history by its own, and while it trains by Adam optimizer and rng too; the state of other methods is far
 * larger than the model and is kept in checkpoints alone. theta is always the file's. The model's functions
 * are written too (lg_model_save), with the scheme of `step`.
 * Errors also: LG_NOT_FINITE for parameters that are not finite, LG_INVALID_ARGUMENT for a model that
 * lg_hamiltonian_init would refuse. */
LG_API lg_status lg_model_save_hamiltonian(const lg_context *context, const char *path,
                                           const lg_hamiltonian_file *file, const lg_fit *fit,
                                           lg_error *error);
/* Checks that weights are finite and that lg_hamiltonian_init accepts the model. A model written by hand
 * needs `kind`, `family`, `links`, `potential`, `activation`, `hidden` and /model; everything else becomes
 * zero or the default. Files of earlier versions lack `schedule`; the schedule is then LG_SCHEDULE_STEP. */
LG_API lg_status lg_model_load_hamiltonian(const lg_context *context, const char *path,
                                           const lg_read_options *options, lg_hamiltonian_file *out,
                                           lg_error *error);
/* Writes the results on a test set (members has_e1 to test of `file`) into the model file at `path`, where
 * they replace earlier results. Everything else in the file stays as it is, entries unknown to this version
 * included. A failure changes nothing.
 *   E1 = mean over trajectories, coordinates and points (the first included) of the squared difference
 *        between the test trajectories and the accurately integrated learned flow
 *   E2 = mean |d - mean d|, d = true H - learned H at the starts. Trajectories determine H up to a function
 *        that is constant along the motion of every Hamiltonian. On T*S^2 and R^2n that is a number, which E2
 *        removes. On so(3)* it is a function of |mu|^2, which remains in E2.
 * Run and theta of `file` must be those of the file at `path`, as loaded or saved. Errors also:
 * LG_INVALID_ARGUMENT for another model, such as one trained in the meantime; LG_NOT_FINITE for E1 or E2 that
 * is not finite. */
LG_API lg_status lg_model_record_hamiltonian(const lg_context *context, const char *path,
                                             const lg_hamiltonian_file *file, lg_error *error);
LG_API void lg_hamiltonian_file_destroy(lg_hamiltonian_file *file);

/* ---- curves of the elastica ---- */

typedef struct lg_elastica_data {
    lg_elastica_curves curves;
    char sha256[LG_SHA256_TEXT]; /* of boundary, q and v as little-endian doubles; set by reader and writer */
    lg_provenance provenance;
} lg_elastica_data;

/* Datasets /boundary (n, 8) as q0, v0, qN, vN; /q, /v (n, N + 1, 2); optional /energy, /x (n) and /case (n; 0
 * both-ends, 1 right-end); any integer or float type, any byte order, chunked and compressed as well.
 * Attributes of the root, optional: `length`, `stiffness` (10), `values` ("discrete" or "continuous";
 * discrete).
 *
 * Without `length` the reader estimates it from the curves, in two ways. The first is the sum over the
 * intervals of chord (phi/2)/sin(phi/2), phi the turning of the tangent (arcs). The second is N times the
 * regression of the second differences of q_k on those of (v_k + v_{k+1})/2 (exact for minimisers of the
 * discrete energy). The reader takes the estimate that varies less over the curves, from the first to the
 * last tenth, and rounds its median to three significant digits (at most 0.5 %). A length with more digits
 * needs the attribute.
 *
 * Checked: everything finite, 2 <= N <= LG_ELASTICA_MAX_INTERVALS, |v| = 1 within 1e-6 at the ends, the first
 * and last nodes and tangents are the boundary's within 1e-6 (1 + their size), no ends farther apart than
 * `length`. */
LG_API lg_status lg_elastica_data_read(const lg_context *context, const char *path,
                                       const lg_read_options *options, lg_elastica_data *out,
                                       lg_error *error);
/* Fills data->sha256. LG_NOT_FINITE for data that could not be read back; LG_INVALID_ARGUMENT for a length or
 * stiffness that is not positive, an unknown case. */
LG_API lg_status lg_elastica_data_write(const lg_context *context, const char *path, lg_elastica_data *data,
                                        lg_error *error);
LG_API void lg_elastica_data_destroy(lg_elastica_data *data);

/* ---- surrogates of the elastica ---- */

typedef struct lg_surrogate_run {
    lg_surrogate model;
    lg_training training;
    double train_fraction, test_fraction;
    uint64_t most_curves; /* of the training part that are learned from; 0: all */
    uint64_t curves;      /* n of the data, before the split */
    bool continuous;      /* of the data's values */
    char data_sha256[LG_SHA256_TEXT];
} lg_surrogate_run;
/* The rows of lg_surrogate_run. The method is its network, in the order of lg_surrogate_kind. */
LG_API extern const lg_field lg_surrogate_fields[];

typedef struct lg_surrogate_file {
    lg_surrogate_run run;
    size_t parameters;
    double *theta; /* (parameters); stored as training.dtype */
    size_t trained_count;
    double *trained; /* (trained_count, 8): boundary conditions of the training part */
    double *modes;   /* loaded: the numbers behind run.model.modes; not read by lg_model_save_surrogate */
    bool has_errors;
    double train_mse, test_mse; /* test_mse NaN without a test part */
    size_t epochs_done;
    double *history[LG_FIT_SERIES_COUNT]; /* as in lg_hamiltonian_file */
    lg_provenance provenance;
    const lg_context *context; /* whose memory the arrays are in */
} lg_surrogate_file;

/* Kind "surrogate": /model/embedding, /model/layer1, ... as lg_net_slice names them, /trained (n, 8; may be
 * missing when written by hand: then NULL), attributes `train_mse` and `test_mse` of the root; otherwise like
 * the model files of learned Hamiltonians, with the same laws. A model written by hand needs `kind` and the
 * attributes of /model: `network`, `architecture`, `activation`, `embedding`, `hidden`, `layers`,
 * `normalise`, `mirror`, `boundary`, `intervals`, `length`, `centre`, and for `modes` above 0 the arrays
 * /model/mean (4(N - 1)) and /model/modes (K, 4(N - 1)): s_k u_k of liegrad/surrogate.h. `fit` as
 * above. */
LG_API lg_status lg_model_save_surrogate(const lg_context *context, const char *path,
                                         const lg_surrogate_file *file, const lg_fit *fit, lg_error *error);
LG_API lg_status lg_model_load_surrogate(const lg_context *context, const char *path,
                                         const lg_read_options *options, lg_surrogate_file *out,
                                         lg_error *error);
LG_API void lg_surrogate_file_destroy(lg_surrogate_file *file);
/* ---- labelled series ---- */

typedef struct lg_series_data {
    lg_series series;
    double noise;    /* factor on the sensors' noise, where known; NaN */
    double severity; /* r of the broken runs, where known; NaN */
    char housing[16];
    char sha256[LG_SHA256_TEXT]; /* of x as little-endian floats and label as u32; set by reader and writer */
    lg_provenance provenance;
} lg_series_data;

/* Datasets /X (n, channels, length), or (n, length) for one channel, any float or integer type, byte order
 * and chunking; read as floats without a second copy. /y (n) or (n, 1): whole numbers (integers, booleans,
 * floats with whole values, negative too) or texts (fixed or variable length, 1 to 63 bytes), at most 65536
 * different ones. All else is optional:
 *   - attribute `classes`: K names, joined by | or as a list of texts. Without it the labels are the names,
 *     in rising order. The first rule that holds says which label has which name:
 *       1. attribute `class_labels` (K texts, likewise): what /y holds for each class;
 *       2. if `like` (see below) has the same names in the same order and class_label: as in `like`. A number
 *          that is not among them is an error;
 *       3. /y of whole numbers within 1..K, K among them: counted from 1 (not in files written here);
 *       4. whole numbers within 0..K-1: counted from 0; with a warning where 0 does not occur, because the
 *          base is then a guess (no warning for files written here);
 *       5. texts that are all among the names: by name;
 *       6. there are K different labels: in rising order (texts bytewise).
 *     The result is series.class_label; with `like` it is that of `like`.
 *   - attribute `channels`: names, in the same form; `rate`: samples a second. In files of other programs a
 *     `rate` that is not such a number counts as unknown, with a warning.
 *   - /group, /run (n) or (n, 1): whole numbers 0 to 2^32 - 1, or texts, which become 0, 1, ... in rising
 *     order. If the windows of a run are not consecutive, the runs count as unknown, with a warning.
 *   - attributes `noise`, `severity`, `housing`, of files written here.
 *
 * Attributes `classes` and `channels` that are numbers are not names and are ignored. `like` (may be NULL) is
 * a series read before, or the names of a model (lg_file_reader_names). With it the classes are those of
 * `like`: the file's classes are matched by name, or by value if both names are whole numbers. In a file
 * without `classes` the labels must be among the class_label of `like`, or else among its names. If neither
 * are numbers, labels that start at 0 and are all numbers of classes of `like` count as such numbers, with a
 * warning.
 *
 * For X of more than single precision there is a warning if the rounding to floats (root mean square) is
 * above 1 % of a channel's standard deviation. Above 50 % the file is refused, unless the channel is constant
 * up to 1e-13 of its largest value. Errors also: LG_FORMAT for labels that are empty or not whole, a label or
 * class that `like` does not have, no window; LG_NOT_FINITE with window, channel and sample, also for numbers
 * that a float cannot hold. */
LG_API lg_status lg_series_read(const lg_context *context, const char *path, const lg_read_options *options,
                                const lg_series *like, lg_series_data *out, lg_error *error);
/* Kind "series": /X as f32, /y as u32 (class_label is not written), /group and /run if they are known. Names
 * that cannot be joined by | in 4095 bytes become data sets /classes, /channels of texts. Fills sha256.
 * Errors also: LG_NOT_FINITE; LG_INVALID_ARGUMENT for a label beyond the classes, empty or repeated class
 * names, a run whose windows are not consecutive. */
LG_API lg_status lg_series_write(const lg_context *context, const char *path, lg_series_data *data,
                                 lg_error *error);
LG_API void lg_series_data_destroy(lg_series_data *data);

/* Attributes `classes`, `class_labels`, `channels` and `rate` of a file of any kind, from series->classes,
 * class_name, class_label, channels, channel_name and rate; the rest of the series is not read. Names that
 * cannot be joined become data sets /classes, /channels. LG_INVALID_ARGUMENT: classes without names, empty or
 * repeated names. */
LG_API lg_status lg_file_writer_names(lg_file_writer *writer, const lg_series *series, lg_error *error);
/* Reads these attributes back. Without names of channels, channel_name is NULL and channels 0; without labels
 * class_label is NULL. Freed by lg_series_destroy with the reader's context. The series has no windows but
 * can serve as `like` above. LG_FORMAT: no `classes`. */
LG_API lg_status lg_file_reader_names(lg_file_reader *reader, lg_series *out, lg_error *error);

/* ---- detectors ---- */

typedef struct lg_detector_run {
    lg_detector model;
    lg_training training;
    lg_split split;
    double test_fraction, validation_fraction; /* of the windows; training.validation is 0 */
    uint32_t restarts;                         /* at most: lg_fit_options.restarts */
    uint64_t windows, window, hop;             /* windows cut from the data; samples */
    char data_sha256[LG_SHA256_TEXT];
} lg_detector_run;
/* The rows of lg_detector_run. There is one method, bit 0; rows with methods = 0 belong to the split of the
 * data, which the classical methods share. */
LG_API extern const lg_field lg_detector_fields[];

typedef struct lg_detector_file {
    lg_detector_run run;
    size_t parameters;
    double *theta; /* (parameters); stored as training.dtype */
    lg_scaler scaler;
    char (*class_name)[LG_SERIES_NAME];   /* (classes) */
    char (*class_label)[LG_SERIES_NAME];  /* (classes) or NULL; as in lg_series */
    char (*channel_name)[LG_SERIES_NAME]; /* (channels) or NULL */
    double rate;                          /* Hz, 0 unknown */
    lg_novelty novelty;                   /* of the training windows; channels 0: none */
    double accuracy, f1, test_mse;        /* on the test part; NaN without one */
    size_t epochs_done;
    double *history[LG_FIT_SERIES_COUNT];
    lg_provenance provenance;
    const lg_context *context; /* whose memory the arrays are in */
} lg_detector_file;

/* Kind "detector": /model/conv1/weight ... as lg_cnn_slice names them, /scaler/{mean, scale} (channels),
 * root attributes `classes`, `class_labels`, `channels`, `rate`, `accuracy`, `f1`, `test_mse`, and optional
 * /novelty (lg_novelty_save); laws as for the other kinds. The blocks are an attribute of /model, "12 kernel
 * 5 stride 1 padding 0 average 2/2, 24 kernel ...": channels, pooling `none` or `average`, `max` with
 * size/stride. A model written by hand needs `kind`, /scaler, the weights and the attributes of /model:
 * `channels`, `length`, `blocks` (from `stride` on optional: 1, 0, none), `plane`, `activation`, `classes`,
 * `loss`, `centred`; without root attribute `classes` they are "0", "1", ... */
LG_API lg_status lg_model_save_detector(const lg_context *context, const char *path,
                                        const lg_detector_file *file, const lg_fit *fit, lg_error *error);
LG_API lg_status lg_model_load_detector(const lg_context *context, const char *path,
                                        const lg_read_options *options, lg_detector_file *out,
                                        lg_error *error);
LG_API void lg_detector_file_destroy(lg_detector_file *file);

/* ---- table networks ---- */

#define LG_TABLE_NAME 64 /* bytes of a column's or a class' name */

/* One number for each slice of the parameters (lg_table_slice); none: 0. */
typedef struct lg_table_decay {
    uint32_t count;
    double value[LG_TABLE_SLICES];
} lg_table_decay;

typedef struct lg_table_run {
    lg_table model;
    lg_training training; /* validation: of the rows, drawn by the seed */
    lg_table_decay decay; /* of lg_table_problem, by slice */
    uint64_t rows;        /* complete rows of the data */
    char data_sha256[LG_SHA256_TEXT];
} lg_table_run;
LG_API extern const lg_field lg_table_fields[]; /* of lg_table_run */

typedef struct lg_table_file {
    lg_table_run run;
    size_t parameters;
    double *theta;                      /* (parameters); stored as training.dtype */
    lg_scaler inputs, outputs;          /* outputs: of a regression; else zeros */
    double *low, *high;                 /* (inputs): least and largest value of the training rows; NULL */
    char (*input_name)[LG_TABLE_NAME];  /* (inputs) */
    char (*output_name)[LG_TABLE_NAME]; /* (outputs) columns, or the names of the classes */
    char class_column[LG_TABLE_NAME];   /* of a classification, "" unknown */
    double rmse, accuracy, f1;          /* on the rows it was judged on, in scaled outputs; NaN: unknown */
    size_t epochs_done;
    double *history[LG_FIT_SERIES_COUNT];
    lg_provenance provenance;
    const lg_context *context; /* whose memory the arrays are in */
} lg_table_file;

/* Kind "table": /model/layer1/weight ... as lg_table_slice names them, /scaler/{inputs, outputs}/{mean,
 * scale}, /range/{low, high} (inputs), texts /names/{inputs, outputs}, root attributes `class_column`,
 * `rmse`, `accuracy`, `f1`; laws as for the other kinds. A model written by hand needs `kind`, the weights,
 * /scaler and the attributes of /model: `task` (regression, classification), `network`, `activation`,
 * `hidden` ("32,32"), `linear`, `inputs`, `outputs`; without /names columns are "x1", "x2", ... and "y1", ...
 * */
LG_API lg_status lg_model_save_table(const lg_context *context, const char *path, const lg_table_file *file,
                                     const lg_fit *fit, lg_error *error);
LG_API lg_status lg_model_load_table(const lg_context *context, const char *path,
                                     const lg_read_options *options, lg_table_file *out, lg_error *error);
LG_API void lg_table_file_destroy(lg_table_file *file);

/* ---- checkpoints of unfinished trainings ---- */

/* A recipe: how a kind of model is trained and stored. The functions below take an lg_hamiltonian_run,
 * lg_surrogate_run, lg_detector_run, lg_table_run or lg_machine_model_run by its address. Fields:
 * liegrad/fields.h. */
typedef struct lg_recipe lg_recipe;
LG_API extern const lg_recipe lg_recipe_hamiltonian, lg_recipe_surrogate, lg_recipe_detector, lg_recipe_table;
/* The list of all recipes, ended by NULL. A new kind of model is a row of this list. */
LG_API extern const lg_recipe *const lg_recipes[];
/* Finds the recipe with this name, the attribute `kind` of its model files. NULL: no recipe has the name. */
LG_API const lg_recipe *lg_recipe_find(const char *name);

/* A checkpoint holds the run's description under /run and the state of lg_fit under /fit:
 *   lg_checkpoint_create -> lg_file_writer_archive(writer, "fit", &archive) -> the fit's save ->
 *   lg_file_writer_commit
 * Kinds "checkpoint" (Hamiltonians), "surrogate-checkpoint", "detector-checkpoint",
 * "table-checkpoint". */
LG_API lg_status lg_checkpoint_create(const lg_context *context, const char *path, const lg_recipe *kind,
                                      const void *run, const lg_provenance *provenance, lg_file_writer **out,
                                      lg_error *error);
/* Opens a checkpoint and reads its run. lg_file_reader_archive(reader, "fit", &archive) opens /fit. */
LG_API lg_status lg_checkpoint_open(const lg_context *context, const char *path,
                                    const lg_read_options *options, const lg_recipe *kind, void *run,
                                    lg_file_reader **out, lg_error *error);
/* Compares everything that is stored of two runs. Errors: LG_INVALID_ARGUMENT when `stored` is not the run
 * `wanted`; the sentence names the first difference ("...: was written with batch 80, not 100"). `path` is
 * only for the sentence. */
LG_API lg_status lg_run_compare(const lg_recipe *kind, const void *stored, const void *wanted,
                                const char *path, lg_error *error);

/* ---- programs ---- */

/* Kind "program": parameters, functions and operations as they were recorded, numbers to the last bit;
 * docs/files.md has the layout. A loaded program makes plans, derivatives and C with the same bits, and the
 * same bytes when it is saved again. `provenance` may be NULL. The program keeps the context. */
LG_API lg_status lg_program_save(const lg_context *context, const char *path, const lg_program *program,
                                 const lg_provenance *provenance, lg_error *error);
/* Loads the functions of a program or of a model. Checks everything as lg_program_add_image
 * (liegrad/program_image.h) does for memory: a program that loads is sound. All arrays together are within
 * options->max_size. LG_FORMAT also for unknown operations, LG_VERSION for operations of a later revision. */
LG_API lg_status lg_program_load(const lg_context *context, const char *path, const lg_read_options *options,
                                 lg_program **out, lg_error *error);

/* Attribute `kind` of a file written here (or by hand, without `format`), which selects the loader. "" for a
 * file without `kind` or of another format. LG_INVALID_ARGUMENT: no room in `size` bytes; 64 are enough. */
LG_API lg_status lg_file_kind(const lg_context *context, const char *path, const lg_read_options *options,
                              char *kind, size_t size, lg_error *error);

/* Writes a model as functions: kind, program, and the space of the states (NULL: it does not move). What
 * lg_model_create takes becomes a file that lg_model_load, lg_program_load and lg-export read, whatever the
 * kind is called. `provenance` may be NULL. Errors: those of lg_program_save. */
LG_API lg_status lg_model_save(const lg_context *context, const char *path, const char *kind,
                               const lg_program *program, const lg_space *space,
                               const lg_provenance *provenance, lg_error *error);

/* A model file, loaded for use in a control program. */
typedef struct lg_model_file {
    const lg_context *context;
    const lg_recipe *recipe; /* NULL: no recipe has the file's kind */
    lg_model *model;         /* owned */
    void *contents;          /* owned: the recipe's file structure; lg_model_file_of gives it with its type */
} lg_model_file;
/* Loads the functions of a file of any kind (liegrad/model.h says which it needs), for a recipe its contents
 * too. Files of version 1 hold no functions: their recipe records them. Errors: those of the recipe's own
 * loader and of lg_program_load; LG_FORMAT for functions that lg_model_create refuses, and for files without
 * functions, with a sentence that says what the file is: checkpoints, data, classical classifiers (read by
 * lg_classifier_load). */
LG_API lg_status lg_model_load(const lg_context *context, const char *path, const lg_read_options *options,
                               lg_model_file *out, lg_error *error);
/* The contents where the file is of this recipe: an lg_hamiltonian_file of lg_recipe_hamiltonian and so on.
 * NULL where it is of another one. Borrowed. */
LG_API const void *lg_model_file_of(const lg_model_file *file, const lg_recipe *recipe);
/* The model's functions as a program, as lg_hamiltonian_program, lg_surrogate_program, ... make it; `scheme`
 * of its steps, NULL: the model's default. Without a recipe, or where the recipe has no scheme: the file's
 * functions and, where it has a space and no function `step`, a step made of the field: by rk4 on R^n, by cf4
 * on other spaces. A file that holds a function `step` takes no other scheme: LG_UNSUPPORTED. The caller
 * destroys the program. */
LG_API lg_status lg_model_file_program(const lg_model_file *file, const lg_scheme *scheme, lg_program **out,
                                       lg_error *error);
/* The scheme of the model's steps unless another one is chosen; NULL: the model has no steps, or no recipe
 * has a scheme and the file holds the function `step`. */
LG_API const lg_scheme *lg_model_file_scheme(const lg_model_file *file);
/* Part number `index` = 0, 1, ... of the parameters, as it lies below /model in the file: name, shape, and
 * its numbers (borrowed). False beyond the last. */
LG_API bool lg_model_file_slice(const lg_model_file *file, uint32_t index, lg_slice_info *out,
                                const double **values);
LG_API void lg_model_file_destroy(lg_model_file *file);

/* ---- random search ---- */

#define LG_SEARCH_FIXED_TEXT 64

/* The options that a search varies and those that it holds fixed: names and values as on the command line. */
typedef struct lg_search_file {
    lg_search_space space;
    size_t fixed_count;
    char fixed_name[LG_RANGE_MAX][LG_RANGE_NAME];
    char fixed_value[LG_RANGE_MAX][LG_SEARCH_FIXED_TEXT];
    uint32_t line[LG_RANGE_MAX], fixed_line[LG_RANGE_MAX]; /* of the file, for the caller's own messages */
} lg_search_file;
/* A YAML (or JSON) file:
 *   fixed: {network: discrete, batch: 32}
 *   ranges:
 *     architecture: {choice: [mlp, resnet]}
 *     layers: {integer: [0, 4]}
 *     gamma: {uniform: [0, 1e-2]}
 *     lr: {log-uniform: [1e-4, 1e-1]}
 * `fixed` may be missing. Errors: as for scenes, with the line; LG_FORMAT for what lg_search_space_check
 * refuses, a name that is both fixed and a range, names other than letters, digits, - and _. */
LG_API lg_status lg_search_file_read(const lg_context *context, const char *path, lg_search_file *out,
                                     lg_error *error);
/* Trials as CSV by rising number, one a line: trial, state, objective, parameters, epochs, seconds, one
 * column a range (choices by name), then the reports rung1, rung2, ... as far as any trial has them. Numbers
 * with 17 digits; nan, inf, -inf. The first line, `# seed S space HASH setting HASH`, ties the file to its
 * search: the ranges, and with the fixed options `setting` (NULL: ""), any text on what else the results
 * depend on, such as the SHA-256 of the data and the search's options. LG_INVALID_ARGUMENT: what
 * lg_search_space_check refuses, a trial that could not be read back. */
LG_API lg_status lg_trials_write(const lg_context *context, const char *path, const lg_search_file *search,
                                 uint64_t seed, const char *setting, const lg_trial *trials, size_t count,
                                 lg_error *error);
/* What the trials depend on, in short: the table's first line. */
#define LG_SEARCH_LABEL 96
LG_API void lg_search_label(const lg_search_file *search, uint64_t seed, const char *setting,
                            char label[LG_SEARCH_LABEL]);
/* Reads the trials of the same search: the ranges, fixed options, seed and setting that were written.
 * `trials` NULL and room 0: only counts them. A last line without its end is left out: that trial was not
 * saved and is to run again. LG_NOT_FOUND: no such file; LG_INVALID_ARGUMENT: of another search (the sentence
 * says what differs), or more than `room`; LG_FORMAT: with the line. */
LG_API lg_status lg_trials_read(const lg_context *context, const char *path, const lg_search_file *search,
                                uint64_t seed, const char *setting, size_t room, lg_trial *trials,
                                size_t *count, lg_error *error);

/* ---- scenes ---- */

/* A system of liegrad/mechanics.h with its parameters and a start. Keys and shapes are those of its tables
 * there. */
typedef struct lg_scene {
    lg_system *system; /* owned */
    bool has_initial;
    double *state;     /* owned: lg_system_dim numbers, in the system's form; NULL without `initial` until
                          lg_scene_draw_start */
    bool projected;    /* the start was off the manifold by rounding (<= 1e-6) and was projected */
    double projection; /* by how much */
    bool has_t_end;
    double t_end;
    bool has_starts; /* otherwise thesis, 1 segment */
    lg_starts starts;
    double low, high;   /* box: chains p = q x u, u ~ U[low,high]^3; others U[low,high]^d; -1, 1 */
    double ahead;       /* trajectories begin where their start is after a time of U[0, ahead]; 0 */
    uint32_t segments;  /* consecutive trajectories from one start, >= 1 */
    char ensemble[256]; /* what the members of an ensemble have of their own, as lg-simulate --vary; "" */
    uint32_t line_system, line_form, line_initial,
        line_starts;           /* for the caller's own messages; 0 when absent */
    const lg_context *context; /* whose memory the arrays are in */
} lg_scene;

/* A YAML (or JSON) file. Keys: `system`; `form`; the parameters of the system; `links` where lists have one
 * entry a link (else the lists determine it); `initial` with the parts of the state; `t_end`; `starts`
 * {kind, low, high, segments, ahead}; `ensemble`, a text; quadrotors: `reference` (parabola). Chains take
 * `omega` or `p` in either form and convert them: p_i = m_ii q_i' + P_i sum_{j != i} m_ij q_j', q_i' =
 * omega_i x q_i. If the system has the form `form_wanted`, the scene has this form, whatever `form` says. If
 * form_wanted is NULL, the form is `form`, else the first form whose state `initial` gives, else the
 * system's first. A projection is logged as a warning with its line. `out` is overwritten. */
LG_API lg_status lg_scene_read(const lg_context *context, const char *path, const char *form_wanted,
                               lg_scene *out, lg_error *error);
/* Draws the start of a scene without `initial` according to `starts`, `ahead` left out. It is the first
 * start of lg_generate_trajectories with this seed and ahead 0. Errors: LG_INVALID_ARGUMENT (the scene has
 * a start), LG_OUT_OF_MEMORY, those of lg_system_start. */
LG_API lg_status lg_scene_draw_start(lg_scene *scene, uint64_t seed);
/* With the context it was read with. Leaves it zeroed; NULL and a zeroed scene are fine. */
LG_API void lg_scene_destroy(lg_scene *scene);

/* ---- schemes ---- */

/* Reads a scheme from a YAML (or JSON) file and checks it with lg_scheme_check. Numbers are decimals or
 * quotients a/b. Keys of all kinds:
 *   name            default: the file's name
 *   kind            rkmk | runge-kutta (in the ambient space) | commutator-free | splitting
 *   order           of the method
 *   embedded_order  with `embedded`: order of the embedded solution, for adaptive steps
 * rkmk and runge-kutta:
 *   a               a list for each stage; the first one is empty
 *   b, embedded     one number for each stage
 *   c               default: the sums of the rows of a
 * rkmk only:
 *   dexpinv         exact or the truncation K; default exact, with commutators 0
 *   commutators     a list of [row, first, second, weight]; stages count from 1, row = stages + 1 is the step
 * commutator-free:
 *   rows            one row for each stage and one for the end of the step
 *   embedded        one row
 *   A row is a list of exponentials. An exponential is a list of coefficients; the first one in the row is
 *   applied first. A row with one exponential may be that list itself. {base: i, exponentials: [...]} starts
 *   at stage i.
 * splitting:
 *   kick, drift
 *
 * Example:
 *   kind: rkmk
 *   order: 3
 *   a: [[], [1/2], [-1, 2]]
 *   b: [1/6, 2/3, 1/6]
 *
 * lg_scheme_destroy frees the scheme; NULL is fine. */
LG_API lg_status lg_scheme_read(const lg_context *context, const char *path, lg_scheme **out,
                                lg_error *error);
LG_API void lg_scheme_destroy(lg_scheme *scheme);

/* ---- grids of `lg-hamiltonian study` ---- */

#define LG_GRID_VALUES 16

/* Runs are the product of the lists: integrators x N x M x eps x penalty x substeps x repeats. */
typedef struct lg_grid {
    lg_scene scene; /* in Hamiltonian form, owned; `scene: FILE` (relative to the grid's folder), or `system`
                       and the scene's keys in the grid itself */
    uint32_t integrator_count, n_count, m_count, eps_count, penalty_count, substeps_count;
    const lg_scheme *integrators[LG_GRID_VALUES];  /* required */
    uint32_t n[LG_GRID_VALUES], m[LG_GRID_VALUES]; /* required; keys N and M */
    double eps[LG_GRID_VALUES];                    /* 0 */
    double penalty[LG_GRID_VALUES];                /* 0 */
    uint32_t substeps[LG_GRID_VALUES];             /* 1 */
    uint32_t repeats;                              /* 1 */
    double t_end;                            /* of the grid, else of the scene; required in one of them */
    lg_hamiltonian_run run;                  /* hyperparameters that all runs share, each under its name in
                             * lg_hamiltonian_fields; the model is not made yet */
    lg_noise noise_kind;                     /* normal */
    uint32_t test_trajectories, test_points; /* 100, 15; key test: {trajectories, points} */
    uint64_t seed;                           /* 1 */
} lg_grid;

LG_API lg_status lg_grid_read(const lg_context *context, const char *path, lg_grid *out, lg_error *error);
LG_API void lg_grid_destroy(lg_grid *grid); /* as lg_scene_destroy */

LG_END_DECLS

#endif
