/* What all other headers use: statuses of functions, contexts (allocator, log, cancel flag), random numbers,
 * archives (how state is saved) and ranks (processes that compute together). The functions are in the library
 * liegrad, except lg_mpi_..., which are in liegrad_mpi.
 *
 * Rules for all headers; comments do not repeat them:
 *
 * - Errors. Every public function that can fail returns an lg_status, LG_OK on success, and writes a sentence
 *   about a failure to its lg_error. When it fails, its pure outputs are unchanged; a comment says what
 *   happens to an argument that is both input and output. Every function that needs memory may return
 *   LG_OUT_OF_MEMORY. The library never exits, aborts or prints.
 * - Ownership. What a function makes belongs to the caller, who frees it with the function ..._destroy of its
 *   type. This function takes NULL and zeroed structures, and leaves a structure zeroed. Other pointers that
 *   functions return, such as names, belong to their argument, or have static storage.
 * - NULL is allowed for a context (then the C library's allocator is used, without log and cancel flag), for
 *   an lg_error, for the argument of a function that destroys, and where a comment says so. For any other
 *   NULL pointer, a function that returns an lg_status returns LG_INVALID_ARGUMENT
 *   (tests/core/test_arguments.c calls these functions, and names the few exceptions). A function that
 *   returns something else, or nothing, must not be called with such a NULL pointer.
 * - Option structs begin with their own size. Fill them with their ..._init function, which sets `size` and
 *   all defaults, and then change single members.
 */
#ifndef LIEGRAD_CORE_H
#define LIEGRAD_CORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Marks a symbol of the public interface. The libraries hide all other symbols. */
#if defined(__GNUC__) && !defined(LG_STATIC)
#define LG_API __attribute__((visibility("default")))
#else
#define LG_API
#endif

#ifdef __cplusplus
#define LG_BEGIN_DECLS extern "C" {
#define LG_END_DECLS   }
#else
#define LG_BEGIN_DECLS
#define LG_END_DECLS
#endif

LG_BEGIN_DECLS

/* ---- statuses ---- */

/* X(code, value, sentence) for each status LG_<code>. The values are part of the interface: they do not
 * change, and a value is never used again for another status. */
#define LG_STATUS_LIST(X)                                                                                    \
    X(OK, 0, "success")                                                                                      \
    X(INVALID_ARGUMENT, 1, "an argument is outside its documented range")                                    \
    X(SHAPE, 2, "shapes do not fit the operation")                                                           \
    X(STALE_HANDLE, 3, "a variable does not belong to this tape, or was rewound")                            \
    X(OUT_OF_MEMORY, 4, "an allocation failed or a memory limit was reached")                                \
    X(NOT_FINITE, 5, "a value is NaN or infinite")                                                           \
    X(NO_CONVERGENCE, 6, "an iteration did not converge")                                                    \
    X(STEP_TOO_SMALL, 7, "the step size fell below the resolution of time")                                  \
    X(TOO_MANY_STEPS, 8, "the limit on the number of steps was reached")                                     \
    X(NOT_DIFFERENTIABLE, 9, "a derivative of this order is not available")                                  \
    X(NOT_FOUND, 10, "no such file, key or name")                                                            \
    X(FILE, 11, "a file could not be opened, read or written")                                               \
    X(FORMAT, 12, "a file's content is not what its format asks for")                                        \
    X(VERSION, 13, "a file was written by a newer major version of the format")                              \
    X(UNSUPPORTED, 14, "the combination asked for is not supported")                                         \
    X(CANCELLED, 15, "the caller asked to stop")                                                             \
    X(CHECK_FAILED, 16, "a check did not hold")

typedef enum lg_status {
#define LG_STATUS_ENUM(code, value, sentence) LG_##code = value,
    LG_STATUS_LIST(LG_STATUS_ENUM)
#undef LG_STATUS_ENUM
} lg_status;

/* Details of a failure: the status, and a message that says what exactly failed (file, key, line, shapes).
 * The caller owns the memory. Functions that take an `lg_error *` accept NULL. A failing function fills both
 * members; the message always ends with a null byte. Read them only after a failure: on success some
 * functions clear the message, and others leave the struct unchanged. */
typedef struct lg_error {
    lg_status status;
    char message[512];
} lg_error;

/* Returns the name of a status without its prefix: "OK", "SHAPE", ...; "UNKNOWN" for a value outside of
 * LG_STATUS_LIST. */
LG_API const char *lg_status_name(lg_status status);

/* Returns the sentence of LG_STATUS_LIST about a status, or "unknown status". */
LG_API const char *lg_status_sentence(lg_status status);

/* ---- contexts ----
 *
 * A context holds the allocator, the log callback and the cancel flag. It does not change after its creation,
 * and several threads may use it at once. All objects that were made with a context must be destroyed before
 * the context. */

typedef struct lg_context lg_context;

/* Type of the numbers of a tape, a parameter vector or a model: double or float. */
typedef enum lg_dtype { LG_F64 = 0, LG_F32 = 1 } lg_dtype;

typedef enum lg_log_level { LG_LOG_DEBUG, LG_LOG_INFO, LG_LOG_WARNING, LG_LOG_ERROR } lg_log_level;

/* Receives one log message: a complete sentence without a newline. It is only called on the thread that
 * called the library. */
typedef void (*lg_log_fn)(void *user, lg_log_level level, const char *message);

/* Allocates `bytes` > 0 bytes, aligned to 64 bytes. Returns NULL when there is no memory. Several threads may
 * call it at once. */
typedef void *(*lg_allocate_fn)(void *user, size_t bytes);
/* Releases memory that the allocate function returned. Several threads may call it at once. */
typedef void (*lg_release_fn)(void *user, void *memory);

/* Decides whether a writer may write the file `path`, and so replace the file that may exist there. `data` is
 * the beginning of the new content, `bytes` its length: all of it, except for files whose rows are written
 * one by one. If it returns a status other than LG_OK, the writer leaves the file unchanged and returns
 * this status and this `error`. Called on the thread that called the writer. */
typedef lg_status (*lg_replace_fn)(void *user, const char *path, const void *data, size_t bytes,
                                   lg_error *error);

typedef struct lg_context_options {
    size_t size;             /* sizeof(lg_context_options) */
    lg_allocate_fn allocate; /* NULL: the C library's allocator */
    lg_release_fn release;   /* NULL if and only if `allocate` is NULL */
    void *allocator_user;    /* passed to `allocate` and `release` */
    lg_log_fn log;           /* NULL: no log */
    void *log_user;          /* passed to `log` */
    /* NULL, or a flag that long computations read now and then. When it is not 0, they stop at the next point
     * where their state is consistent, and return LG_CANCELLED. */
    const volatile int *cancel;
    lg_replace_fn replace; /* NULL: writers replace every regular file */
    void *replace_user;    /* passed to `replace` */
} lg_context_options;

/* Sets the defaults: the C library's allocator, no log, no cancel flag. */
LG_API void lg_context_options_init(lg_context_options *options);

/* Creates a context. `options` is copied, NULL means the defaults. Errors: LG_INVALID_ARGUMENT (`size` is
 * wrong, or only one of `allocate` and `release` is given). */
LG_API lg_status lg_context_create(const lg_context_options *options, lg_context **out);
LG_API void lg_context_destroy(lg_context *context);

/* ---- version and machine ---- */

/* Returns the version of the library, such as "2.0.0". */
LG_API const char *lg_version(void);

/* Writes one line to `text` that names the instruction set of the kernels, the BLAS, the processor type for
 * which the BLAS computes, and the number of BLAS threads. At most `size` bytes are written, the terminating
 * null byte included. Returns the length that the whole line has, as snprintf does.
 *
 * The kernels use the best instruction set that the processor has. The environment variable LIEGRAD_ISA =
 * baseline, avx2, avx512 or neon selects another one; it is ignored when the processor does not have that
 * set. */
LG_API int lg_cpu_describe(char *text, size_t size);

/* Sets up OpenBLAS for this process: one thread, and, unless the environment variable OPENBLAS_CORETYPE is
 * set, kernels for AVX-512 on a processor that has it (an OpenBLAS older than the processor would take
 * slower ones). An executable should call this function once, before it creates threads. The library never
 * calls it. */
LG_API void lg_runtime_setup(void);

/* Lets OpenBLAS reserve the address space that it needs for `threads` threads, 128 MiB per thread (at most 32
 * threads are counted). Returns false when there is not so much address space; nothing is reserved then.
 * Returns true with another BLAS than OpenBLAS, which needs nothing. An executable that runs under a memory
 * limit (RLIMIT_AS) should call this function after lg_runtime_setup: when OpenBLAS finds no room later, it
 * tries again forever. */
LG_API bool lg_runtime_reserve(int threads);

/* ---- random numbers ----
 *
 * The generator is xoshiro256** (Blackman & Vigna 2018), seeded by splitmix64. Its whole state is in lg_rng,
 * which the caller owns: a program that saves these four words and restores them later gets the same random
 * numbers, bit by bit. One generator must not be used by several threads at once. */

typedef struct lg_rng {
    uint64_t s[4];
} lg_rng;

/* Sets the state from a seed and the number of a stream. Different pairs (seed, stream) give independent
 * sequences. */
LG_API void lg_rng_seed(lg_rng *rng, uint64_t seed, uint64_t stream);
LG_API uint64_t lg_rng_next(lg_rng *rng);                         /* 64 random bits */
LG_API double lg_rng_uniform(lg_rng *rng);                        /* uniform in [0, 1), 53 random bits */
LG_API double lg_rng_uniform_in(lg_rng *rng, double a, double b); /* uniform in [a, b); b only by rounding */
/* Returns a number with the normal distribution N(0, 1), by the polar method. The second number that the
 * method gives is thrown away, so that lg_rng stays the whole state. */
LG_API double lg_rng_normal(lg_rng *rng);
LG_API uint64_t lg_rng_below(lg_rng *rng, uint64_t n); /* uniform in 0..n-1, without bias; 0 for n = 0 */
/* Puts the n items in a random order (Fisher-Yates). */
LG_API void lg_rng_shuffle(lg_rng *rng, uint32_t *items, size_t n);

/* ---- archives ----
 *
 * Functions that save or load state do so as named arrays and texts, by the callbacks below, and so do not
 * depend on a file format. liegrad/files.h has callbacks for HDF5 files (library liegrad_io); a caller may
 * write its own. A path names an array or a text, such as "optimizer/adam/m". A callback that fails returns a
 * status other than LG_OK; the function that called it stops and returns this status. */

typedef enum lg_element {
    LG_ELEMENT_F64,
    LG_ELEMENT_F32,
    LG_ELEMENT_I64,
    LG_ELEMENT_U64,
    LG_ELEMENT_U32,
    LG_ELEMENT_U8
} lg_element;

typedef struct lg_archive_writer {
    void *user; /* passed to the callbacks */
    /* Stores an array of shape dims[0..rank-1], which has dims[0] * ... * dims[rank-1] elements. Rank 0: one
     * number; `dims` may be NULL. `data` is only valid during the call. */
    lg_status (*array)(void *user, const char *path, lg_element type, uint32_t rank, const uint64_t *dims,
                       const void *data);
    /* Stores a text, which ends with a null byte. */
    lg_status (*text)(void *user, const char *path, const char *value);
} lg_archive_writer;

typedef struct lg_archive_reader {
    void *user; /* passed to the callbacks */
    /* Reads an array into `out`, as elements of `type`. Any stored integer or float type is converted.
     * Errors: LG_SHAPE (the stored shape is not dims[0..rank-1]), LG_NOT_FOUND (no such path), LG_FORMAT
     * (what is stored are not numbers). */
    lg_status (*array)(void *user, const char *path, lg_element type, uint32_t rank, const uint64_t *dims,
                       void *out);
    /* Gives the shape of a stored array; *rank is at most LG_MAX_RANK (4). Errors: LG_NOT_FOUND (no such
     * path). */
    lg_status (*shape)(void *user, const char *path, uint32_t *rank, uint64_t dims[4]);
    /* Reads a text into `out`, with its null byte. Errors: LG_SHAPE (it does not fit into `size` bytes),
     * LG_NOT_FOUND (no such path). */
    lg_status (*text)(void *user, const char *path, char *out, size_t size);
} lg_archive_reader;

/* ---- ranks ----
 *
 * Ranks are processes that compute one result together. They are numbered from 0. The library needs two kinds
 * of exchange between them, the callbacks of lg_ranks. The next section implements the callbacks with MPI; a
 * caller may write its own.
 *
 * All ranks must call the same library functions in the same order with equal arguments (options, data, and
 * callbacks that return the same values). Then every rank gets the same result, equal to the last bit to the
 * result of a single process: the division of the work into pieces does not depend on the number of ranks,
 * and every rank adds up the pieces in the same order. This only holds when all processors are of one type,
 * because the processor decides which kernels and which BLAS code run.
 *
 * "Collective" means: all ranks must call the function, and it waits for the other ranks. */

typedef struct lg_ranks {
    size_t size;          /* sizeof(lg_ranks) */
    uint32_t rank, count; /* number of this process, and number of processes */
    void *user;           /* passed to the callbacks */
    /* Every rank contributes bytes[rank] bytes and receives the bytes of all ranks. `all` has bytes[0] + ...
     * + bytes[count - 1] bytes, in the order of the ranks. On entry a rank has its own bytes at their place
     * in `all`; the callback fills in the rest. Collective. */
    lg_status (*gather)(void *user, void *all, const size_t *bytes);
    /* Every rank sends bytes[rank] bytes from `mine`. Rank 0 receives the bytes of all ranks in `all`, in the
     * order of the ranks; its own `mine` may be the start of `all`. On other ranks `all` is not used and may
     * be NULL. Collective. */
    lg_status (*collect)(void *user, const void *mine, void *all, const size_t *bytes);
    /* Returns a sentence that says why an exchange has failed, or NULL if no exchange has failed. After one
     * failed exchange all others fail. The member may be NULL. */
    const char *(*reason)(void *user);
} lg_ranks;

/* Divides the items 0..total-1 into `count` contiguous parts whose sizes differ by at most one. *first is the
 * first item of part number `rank`, *end the item after its last one. */
LG_API void lg_ranks_part(uint32_t rank, uint32_t count, size_t total, size_t *first, size_t *end);
/* Copies the `bytes` bytes at `data` from rank `from` to `data` on all other ranks. Collective. Errors:
 * the status of the exchange. */
LG_API lg_status lg_ranks_share(const lg_ranks *ranks, uint32_t from, void *data, size_t bytes);
/* Makes all ranks return the same status: LG_OK when every rank passed LG_OK, else the status of the lowest
 * rank that passed a failure. Then `error` gets that rank's message on all ranks. Collective. Errors of its
 * own: the status of the exchange. */
LG_API lg_status lg_ranks_agree(const lg_ranks *ranks, lg_status status, lg_error *error);

/* ---- ranks of MPI (library liegrad_mpi) ----
 *
 * Link liegrad_mpi in addition to liegrad.
 *
 *   lg_ranks ranks;
 *   lg_status status = lg_mpi_begin(context, NULL, 30, &ranks, &error);
 *   options.ranks = &ranks;                              (lg_fit_options, lg_policy_train_options)
 *   ...
 *   status = lg_mpi_end(&ranks, &error);
 *
 * The exchanges send bytes by MPI_Iallgatherv, MPI_Ibcast, MPI_Isend and MPI_Irecv, on the thread that calls
 * the library. The library never lets MPI add numbers, because such a sum depends on the number of ranks.
 *
 * Ranks that are silent for `silence` seconds are lost (docs/operating.md, "Lost ranks"): the exchanges of
 * all others fail with LG_FILE. Signs of life need MPI_THREAD_MULTIPLE, with which lg_mpi_begin initialises
 * MPI. After a failed exchange the caller must not call MPI, except through lg_mpi_abort, because MPI may
 * still write to buffers that the caller frees. */

/* Fills *out with the ranks of a communicator. If the context (may be NULL) is cancelled and a rank does not
 * join an exchange, the exchange fails with LG_CANCELLED. It waits half of the time between the SIGTERM and
 * the SIGKILL of mpirun (1 s, or odls_base_sigkill_timeout of Open MPI). `silence`: in seconds; 0: for ever.
 * `communicator` points to an MPI_Comm, which is duplicated. NULL means MPI_COMM_WORLD; then MPI is
 * initialised if it has not been. Collective. All ranks fail when their processors use different kernels or
 * when they run different versions of the library, because their results would then differ in some bits.
 * Errors: LG_INVALID_ARGUMENT (`out` is NULL, a communicator is given before MPI was initialised, `silence`
 * is negative, or the ranks differ as said), LG_FILE (MPI does not start, or an exchange fails). */
LG_API lg_status lg_mpi_begin(const lg_context *context, const void *communicator, double silence,
                              lg_ranks *out, lg_error *error);
/* Releases what lg_mpi_begin made. Calls MPI_Finalize, which waits for all ranks, if lg_mpi_begin initialised
 * MPI. Collective. Error: LG_FILE (an exchange had failed, or a rank is lost now: nothing is released, and
 * MPI is not finalised). */
LG_API lg_status lg_mpi_end(lg_ranks *ranks, lg_error *error);
/* Ends all ranks at once, with this exit code (MPI_Abort). */
LG_API void lg_mpi_abort(int code);

LG_END_DECLS

#endif
