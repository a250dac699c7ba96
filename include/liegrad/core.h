/* Core: the mark LG_API of public symbols, statuses, contexts, random numbers, archives and ranks. */
#ifndef LIEGRAD_CORE_H
#define LIEGRAD_CORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Symbols marked LG_API are the public interface; all other symbols are hidden. */
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

/* ---- statuses ----
 *
 * Statuses and sentences of failures.
 *
 * Every public function that can fail returns an lg_status. On failure pure outputs are untouched; in/out
 * arguments say in their own comment what happens to them. The library never exits, aborts or prints.
 *
 * NULL is fine for a context, an lg_error, what is to be destroyed, and where a comment says so. Functions
 * that return an lg_status refuse it elsewhere: LG_INVALID_ARGUMENT (tests/core/test_arguments.c calls them,
 * and names the few that it leaves out). Functions that return something else, or nothing, must not be given
 * NULL. */

/* X(code, value, sentence). Values are part of the interface and never reused. */
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

/* A status with a sentence about this very failure: file, key, line, shapes. Caller's memory; functions that
 * take an `lg_error *` accept NULL. The message is always terminated, empty after success. */
typedef struct lg_error {
    lg_status status;
    char message[512];
} lg_error;

/* "OK", "SHAPE", ...; "UNKNOWN" for a value outside the list. Static storage. */
LG_API const char *lg_status_name(lg_status status);

/* The sentence of the list. Static storage. */
LG_API const char *lg_status_sentence(lg_status status);

/* ---- contexts ----
 *
 * The context: the allocator, the log callback and the cancel flag.
 *
 * A context is immutable after creation and may be shared by threads. Objects made with it must be destroyed
 * before it. */

typedef struct lg_context lg_context;

/* Element type of a tape, a parameter vector, a model. */
typedef enum lg_dtype { LG_F64 = 0, LG_F32 = 1 } lg_dtype;

typedef enum lg_log_level { LG_LOG_DEBUG, LG_LOG_INFO, LG_LOG_WARNING, LG_LOG_ERROR } lg_log_level;

/* Called with a complete sentence without newline, only from the thread that calls the library. */
typedef void (*lg_log_fn)(void *user, lg_log_level level, const char *message);

/* Returns memory aligned to 64 bytes, or NULL. `bytes` > 0. Must be thread safe. */
typedef void *(*lg_allocate_fn)(void *user, size_t bytes);
typedef void (*lg_release_fn)(void *user, void *memory);

typedef struct lg_context_options {
    size_t size;             /* sizeof(lg_context_options) */
    lg_allocate_fn allocate; /* NULL: the C library's */
    lg_release_fn release;   /* NULL if and only if allocate is NULL */
    void *allocator_user;
    lg_log_fn log; /* NULL: silence */
    void *log_user;
    const volatile int *cancel; /* NULL, or a flag read at safe points: nonzero stops with LG_CANCELLED */
} lg_context_options;

/* Defaults: the C library's allocator, silence, no cancel flag. */
LG_API void lg_context_options_init(lg_context_options *options);

/* `options` may be NULL for the defaults. Errors: LG_INVALID_ARGUMENT, LG_OUT_OF_MEMORY. */
LG_API lg_status lg_context_create(const lg_context_options *options, lg_context **out);
LG_API void lg_context_destroy(lg_context *context); /* NULL is fine */

/* "2.0.0" */
LG_API const char *lg_version(void);

/* Writes one line that names the CPU, the chosen instruction set and the BLAS to `text` (at most `size` bytes
 * with the terminator). Returns the length without truncation, as snprintf does. The environment variable
 * LIEGRAD_ISA=baseline|avx2|avx512|neon forces an instruction set that the machine has. */
LG_API int lg_cpu_describe(char *text, size_t size);

/* For executables, before any thread: gives OpenBLAS one thread and, unless OPENBLAS_CORETYPE is set, the
 * core type that fits this CPU. The library never calls it by itself. */
LG_API void lg_runtime_setup(void);
/* For executables below a limit on their memory (RLIMIT_AS), after the set-up: takes the address space that
 * OpenBLAS needs for so many threads, 128 MiB each; without it OpenBLAS never returns. False: it is not
 * there. */
LG_API bool lg_runtime_reserve(int threads);

/* ---- random numbers ----
 *
 * Random numbers: xoshiro256** (Blackman & Vigna 2018) seeded through splitmix64. Caller's memory, no hidden
 * state; the four words are all there is to save for a bitwise restart. */

typedef struct lg_rng {
    uint64_t s[4];
} lg_rng;

/* Different (seed, stream) pairs give independent generators. */
LG_API void lg_rng_seed(lg_rng *rng, uint64_t seed, uint64_t stream);
LG_API uint64_t lg_rng_next(lg_rng *rng);
LG_API double lg_rng_uniform(lg_rng *rng);                          /* [0, 1), 53 bits */
LG_API double lg_rng_uniform_in(lg_rng *rng, double a, double b);   /* [a, b) */
LG_API double lg_rng_normal(lg_rng *rng);                           /* N(0, 1), polar method, no state kept */
LG_API uint64_t lg_rng_below(lg_rng *rng, uint64_t n);              /* {0..n-1} without bias; 0 for n = 0 */
LG_API void lg_rng_shuffle(lg_rng *rng, uint32_t *items, size_t n); /* Fisher-Yates */

/* ---- archives ----
 *
 * Archives: state is saved and loaded as named arrays and texts, independent of a file format. liegrad_io has
 * HDF5 implementations (liegrad/io.h); a caller may write its own. Paths look like "optimizer/adam/m". */

typedef enum lg_element {
    LG_ELEMENT_F64,
    LG_ELEMENT_F32,
    LG_ELEMENT_I64,
    LG_ELEMENT_U64,
    LG_ELEMENT_U32,
    LG_ELEMENT_U8
} lg_element;

typedef struct lg_archive_writer {
    void *user;
    /* Stores count = product of dims elements (rank 0: one). The data is copied. */
    lg_status (*array)(void *user, const char *path, lg_element type, uint32_t rank, const uint64_t *dims,
                       const void *data);
    lg_status (*text)(void *user, const char *path, const char *value);
} lg_archive_writer;

typedef struct lg_archive_reader {
    void *user;
    /* Reads into `out` with conversion from any integer or float type. The stored shape must equal (rank,
     * dims), else LG_SHAPE; missing: LG_NOT_FOUND; other type: LG_FORMAT. */
    lg_status (*array)(void *user, const char *path, lg_element type, uint32_t rank, const uint64_t *dims,
                       void *out);
    /* dims of a stored array, rank <= LG_MAX_RANK (4). */
    lg_status (*shape)(void *user, const char *path, uint32_t *rank, uint64_t dims[4]);
    /* Terminated text; LG_SHAPE when it does not fit into size bytes. */
    lg_status (*text)(void *user, const char *path, char *out, size_t size);
} lg_archive_reader;

/* ---- ranks ----
 *
 * Processes that compute one result together: ranks, numbered from 0. The library asks for two exchanges, and
 * liegrad_mpi (liegrad/mpi.h) has them over MPI; a caller may give its own.
 *
 * Every rank calls the same functions in the same order with the same arguments (options, data, callbacks
 * that return the same). Each then has the same result, with the bits of one process: pieces of work are
 * divided as recorded, whatever the number of ranks, and are summed in their order on every rank. That needs
 * processors of one type, since kernels and BLAS are chosen by it. */

typedef struct lg_ranks {
    size_t size; /* sizeof(lg_ranks) */
    uint32_t rank, count;
    void *user;
    /* all: bytes[0] + ... + bytes[count - 1] bytes, those of rank r behind those of the ranks before it. The
     * caller's own are in place; the others' are filled in. Collective. */
    lg_status (*gather)(void *user, void *all, const size_t *bytes);
    /* The same, but only rank 0 receives, in `all`; `mine` are the caller's own bytes. `all` is not read on
     * other ranks and may be NULL there. Collective. */
    lg_status (*collect)(void *user, const void *mine, void *all, const size_t *bytes);
} lg_ranks;

/* Part `rank` of `count` of 0..total-1: first and one behind the last; differs by one item at most. */
LG_API void lg_ranks_part(uint32_t rank, uint32_t count, size_t total, size_t *first, size_t *end);
/* `data` of rank `from` on all ranks. */
LG_API lg_status lg_ranks_share(const lg_ranks *ranks, uint32_t from, void *data, size_t bytes);
/* The first failure by number of rank, with its sentence, on all ranks; LG_OK where there is none. */
LG_API lg_status lg_ranks_agree(const lg_ranks *ranks, lg_status status, lg_error *error);

/* ---- ranks of MPI (library liegrad_mpi) ----
 *
 * Ranks of MPI: link liegrad_mpi beside liegrad.
 *
 *   lg_ranks ranks;
 *   lg_status status = lg_mpi_begin(NULL, &ranks, &error);
 *   options.ranks = &ranks;                              of lg_fit_options
 *   ...
 *   lg_mpi_end(&ranks);
 *
 * Exchanges are MPI_Allgatherv and MPI_Gatherv of bytes on the thread that calls the library
 * (MPI_THREAD_FUNNELED is enough). No sum is MPI's own: those depend on the number of ranks. */

/* The ranks of a communicator, which is duplicated; `communicator` points to an MPI_Comm. NULL:
 * MPI_COMM_WORLD, and MPI_Init first where that has not been done. Collective. Ranks whose processors take
 * other kernels, or that run another version of the library, are refused on all, since bits would differ.
 * Errors: LG_INVALID_ARGUMENT, LG_OUT_OF_MEMORY, LG_FILE (MPI does not start). */
LG_API lg_status lg_mpi_begin(const void *communicator, lg_ranks *out, lg_error *error);
/* Releases; MPI_Finalize, which waits for all ranks, where lg_mpi_begin initialised. Collective. */
LG_API void lg_mpi_end(lg_ranks *ranks);
/* Ends all ranks now, with this exit code. */
LG_API void lg_mpi_abort(int code);

LG_END_DECLS

#endif
