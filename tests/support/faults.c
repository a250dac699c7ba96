#define _GNU_SOURCE
#include "support/faults.h"

#include <dirent.h>
#include <errno.h>
#include <execinfo.h>
#include <fcntl.h>
#define H5_USE_110_API
#include <hdf5.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>
#include <yaml.h>

struct rlimit;

static struct {
    _Atomic long calls[FAULT_CLASSES], live, hits;
    fault_class of;
    fault_way way;
    _Atomic long from, to;
    fault_class noted;
    uint64_t *stacks;
    long room;
    void (*before)(void);
} faults;

void faults_arm(fault_class of, fault_way way, long from, long to) {
    faults.from = 0;
    for (int i = 0; i < FAULT_CLASSES; i++) faults.calls[i] = 0;
    faults.hits = 0;
    faults.of = of;
    faults.way = way;
    faults.to = to;
    faults.from = from;
}

static _Thread_local bool spared_here;

void faults_spare(bool spared) {
    spared_here = spared;
}

void faults_disarm(void) {
    faults.from = 0;
}

long faults_calls(fault_class of) {
    return faults.calls[of];
}

bool faults_hit(void) {
    return faults.hits > 0;
}

long faults_live(void) {
    return faults.live;
}

long faults_identifiers(void) {
    static const H5I_type_t types[] = {H5I_FILE,    H5I_GROUP, H5I_DATATYPE,   H5I_DATASPACE,
                                       H5I_DATASET, H5I_ATTR,  H5I_GENPROP_LST};
    hsize_t total = 0, count;
    for (size_t i = 0; i < sizeof types / sizeof *types; i++)
        if (H5Inmembers(types[i], &count) >= 0) total += count;
    return (long)total;
}

void faults_note_stacks(fault_class of, uint64_t *stacks, long room) {
    faults.noted = of;
    faults.room = room;
    faults.stacks = stacks;
}

void faults_interpose(void (*before)(void)) {
    faults.before = before;
}

static void note_stack(long call) {
    enum { FRAMES = 10, OURS = 3 };
    void *frames[FRAMES];
    uint64_t hash = 1469598103934665603u;
    const int count = backtrace(frames, FRAMES);
    for (int i = OURS; i < count; i++) hash = (hash ^ (uint64_t)(uintptr_t)frames[i]) * 1099511628211u;
    faults.stacks[call - 1] = hash;
}

typedef struct noted_call {
    uint64_t stack;
    long call;
} noted_call;

static int by_stack(const void *a, const void *b) {
    const noted_call *x = a, *y = b;
    return x->stack != y->stack ? (x->stack > y->stack) - (x->stack < y->stack)
                                : (x->call > y->call) - (x->call < y->call);
}

long faults_choose(const uint64_t *stacks, long noted, long calls, long most, long *chosen) {
    noted_call *sorted = malloc(((size_t)noted + 1) * sizeof *sorted);
    bool *taken = calloc((size_t)calls + 1, sizeof *taken);
    if (sorted == NULL || taken == NULL) abort();
    for (long i = 0; i < noted; i++) sorted[i] = (noted_call){stacks[i], i + 1};
    qsort(sorted, (size_t)noted, sizeof *sorted, by_stack);
    long different = 0, count = 0;
    for (long i = 0; i < noted; i++) {
        const bool first = i == 0 || sorted[i].stack != sorted[i - 1].stack;
        taken[sorted[i].call] = first;
        different += first;
    }
    for (long call = 1, i = 0; call <= noted; call++) {
        if (!taken[call]) continue;
        if (most == 0 || different <= most || i * most / different >= count) chosen[count++] = call;
        i++;
    }
    for (long step = most > 0 ? calls / most + 1 : 1, call = 1; call <= calls && count < most; call += step)
        if (!taken[call]) chosen[count++] = call;
    free(taken);
    free(sorted);
    return count;
}

/* Counts a call. Returns true if this call has to fail. */
static bool goes_wrong(fault_class of) {
    if (faults.before != NULL && of == FAULT_FILES) faults.before();
    if (spared_here) return false;
    const long call = ++faults.calls[of];
    if (faults.stacks != NULL && of == faults.noted && call <= faults.room) note_stack(call);
    const long from = faults.from;
    return from > 0 && of == faults.of && call >= from && call <= faults.to;
}

static bool fails(fault_class of, int code) {
    if (!goes_wrong(of) || faults.way != FAULT_FAIL) return false;
    faults.hits++;
    errno = code;
    return true;
}

/* Returns how many of `bytes` bytes a call may move. If the call has to fail, sets errno and returns -1. */
static ssize_t may_move(size_t bytes, int code) {
    if (!goes_wrong(FAULT_FILES) || (faults.way == FAULT_SHORT && bytes < 2)) return (ssize_t)bytes;
    faults.hits++;
    if (faults.way == FAULT_SHORT) return (ssize_t)(bytes / 2);
    errno = faults.way == FAULT_INTERRUPT ? EINTR : code;
    return -1;
}

/* The name of the real function. With the linker's option --wrap this name is __real_NAME. */
#ifdef LG_FAULTS_WRAPPED
#define REAL(name) __real_##name
#else
#define REAL(name) name
#endif

/* A call that does nothing when it fails. */
#define CALL(of, code, failed, type, name, parameters, values)                                               \
    type REAL(name) parameters;                                                                              \
    type __wrap_##name parameters;                                                                           \
    type __wrap_##name parameters {                                                                          \
        if (fails(of, code)) return failed;                                                                  \
        return REAL(name) values;                                                                            \
    }

/* A call that returns a new block. */
#define BLOCK(type, name, parameters, values)                                                                \
    type REAL(name) parameters;                                                                              \
    type __wrap_##name parameters;                                                                           \
    type __wrap_##name parameters {                                                                          \
        if (fails(FAULT_MEMORY, ENOMEM)) return NULL;                                                        \
        type block = REAL(name) values;                                                                      \
        faults.live += block != NULL;                                                                        \
        return block;                                                                                        \
    }

/* A stream in memory has no descriptor; standard output and error of the programs, which filter texts, have
 * none either. */
static fault_class class_of(FILE *file) {
    return fileno(file) < 0 && file != stdout && file != stderr ? FAULT_MEMORY : FAULT_FILES;
}

/* A call that closes its argument, even if it returns an error. */
#define CLOSE(name, of, type)                                                                                \
    int REAL(name)(type);                                                                                    \
    int __wrap_##name(type);                                                                                 \
    int __wrap_##name(type closed) {                                                                         \
        const bool failed = fails(of, EIO);                                                                  \
        const int code = REAL(name)(closed);                                                                 \
        if (failed) errno = EIO;                                                                             \
        return failed ? -1 : code;                                                                           \
    }

/* A call that moves bytes. The parameter `bytes` is the wanted number; `values` use `most`, the number that
 * may be moved. */
#define MOVE(code, name, parameters, values)                                                                 \
    ssize_t REAL(name) parameters;                                                                           \
    ssize_t __wrap_##name parameters;                                                                        \
    ssize_t __wrap_##name parameters {                                                                       \
        /* Messages reach standard output and standard error, so that they can be checked. */                \
        const ssize_t most = fd <= STDERR_FILENO ? (ssize_t)bytes : may_move(bytes, code);                   \
        return most < 0 ? -1 : REAL(name) values;                                                            \
    }

BLOCK(void *, malloc, (size_t bytes), (bytes))
BLOCK(void *, calloc, (size_t count, size_t bytes), (count, bytes))
BLOCK(void *, aligned_alloc, (size_t alignment, size_t bytes), (alignment, bytes))
BLOCK(char *, strdup, (const char *text), (text))
BLOCK(char *, realpath, (const char *path, char *out), (path, out))
CALL(FAULT_MEMORY, ENOMEM, NULL, FILE *, fdopen, (int fd, const char *mode), (fd, mode))
CALL(FAULT_MEMORY, ENOMEM, NULL, FILE *, open_memstream, (char **data, size_t *size), (data, size))
CALL(FAULT_MEMORY, ENOMEM, NULL, DIR *, fdopendir, (int fd), (fd))
CALL(FAULT_MEMORY, ENOMEM, EAGAIN, int, pthread_create,
     (pthread_t * thread, const pthread_attr_t *about, void *(*run)(void *), void *user),
     (thread, about, run, user))

CALL(FAULT_FILES, EMFILE, NULL, FILE *, fopen, (const char *path, const char *mode), (path, mode))
CALL(FAULT_FILES, EMFILE, NULL, DIR *, opendir, (const char *path), (path))
CALL(FAULT_FILES, EIO, -1, int, stat, (const char *path, struct stat *out), (path, out))
CALL(FAULT_FILES, EIO, -1, int, lstat, (const char *path, struct stat *out), (path, out))
CALL(FAULT_FILES, EIO, -1, int, fstat, (int fd, struct stat *out), (fd, out))
CALL(FAULT_FILES, EIO, -1, int, fstatat, (int folder, const char *path, struct stat *out, int flags),
     (folder, path, out, flags))
CALL(FAULT_FILES, EIO, -1, int, fsync, (int fd), (fd))
CALL(FAULT_FILES, EIO, -1, int, fdatasync, (int fd), (fd))
CALL(FAULT_FILES, EIO, -1, int, ftruncate, (int fd, off_t bytes), (fd, bytes))
CALL(FAULT_FILES, EIO, -1, int, fchmod, (int fd, mode_t mode), (fd, mode))
CALL(FAULT_FILES, EIO, -1, int, rename, (const char *from, const char *to), (from, to))
CALL(FAULT_FILES, EIO, -1, int, renameat, (int of, const char *from, int in, const char *to),
     (of, from, in, to))
CALL(FAULT_FILES, EIO, -1, int, renameat2, (int of, const char *from, int in, const char *to, unsigned flags),
     (of, from, in, to, flags))
CALL(FAULT_FILES, EIO, -1, int, linkat, (int of, const char *from, int in, const char *to, int flags),
     (of, from, in, to, flags))
CALL(FAULT_FILES, EIO, -1, int, unlink, (const char *path), (path))
CALL(FAULT_FILES, EIO, -1, int, unlinkat, (int folder, const char *path, int flags), (folder, path, flags))
CALL(FAULT_FILES, ENOSPC, -1, int, mkdir, (const char *path, mode_t mode), (path, mode))
CALL(FAULT_FILES, ENOSPC, -1, int, mkdirat, (int folder, const char *path, mode_t mode), (folder, path, mode))
CALL(FAULT_FILES, EIO, -1, int, rmdir, (const char *path), (path))
CALL(FAULT_FILES, ENOLCK, -1, int, flock, (int fd, int what), (fd, what))
CALL(FAULT_FILES, EMFILE, -1, int, dup, (int fd), (fd))
CALL(FAULT_FILES, EMFILE, -1, int, dup2, (int fd, int to), (fd, to))
CALL(FAULT_FILES, EMFILE, -1, int, pipe, (int ends[2]), (ends))
CALL(FAULT_FILES, ENOSPC, ENOSPC, int, posix_fallocate, (int fd, off_t from, off_t bytes), (fd, from, bytes))
CALL(FAULT_MEMORY, EAGAIN, -1, pid_t, fork, (void), ())
CALL(class_of(file), EIO, EOF, int, fflush, (FILE * file), (file))
CALL(FAULT_MEMORY, ENOMEM, 0, int, yaml_parser_initialize, (yaml_parser_t * parser), (parser))
CALL(FAULT_MEMORY, ENOMEM, 0, int, yaml_emitter_initialize, (yaml_emitter_t * emitter), (emitter))
CALL(FAULT_MEMORY, ENOMEM, 0, int, yaml_document_add_scalar,
     (yaml_document_t * in, const yaml_char_t *tag, const yaml_char_t *text, int length,
      yaml_scalar_style_t style),
     (in, tag, text, length, style))
CALL(FAULT_MEMORY, ENOMEM, 0, int, yaml_document_add_sequence,
     (yaml_document_t * in, const yaml_char_t *tag, yaml_sequence_style_t style), (in, tag, style))
CALL(FAULT_MEMORY, ENOMEM, 0, int, yaml_document_add_mapping,
     (yaml_document_t * in, const yaml_char_t *tag, yaml_mapping_style_t style), (in, tag, style))
CALL(FAULT_MEMORY, ENOMEM, 0, int, yaml_document_append_sequence_item,
     (yaml_document_t * in, int list, int item), (in, list, item))
CALL(FAULT_MEMORY, ENOMEM, 0, int, yaml_document_append_mapping_pair,
     (yaml_document_t * in, int map, int key, int value), (in, map, key, value))
/* The stream gets its error indicator: it is open for reading, so a character cannot be written to it. */
#define READ(name, parameters, values)                                                                       \
    size_t REAL(name) parameters;                                                                            \
    size_t __wrap_##name parameters;                                                                         \
    size_t __wrap_##name parameters {                                                                        \
        if (!fails(FAULT_FILES, EIO)) return REAL(name) values;                                              \
        (void)fputc(0, file);                                                                                \
        errno = EIO;                                                                                         \
        return 0;                                                                                            \
    }
READ(fread, (void *data, size_t size, size_t count, FILE *file), (data, size, count, file))
READ(__fread_chk, (void *data, size_t room, size_t size, size_t count, FILE *file),
     (data, room, size, count, file))
/* <sys/resource.h> declares these two with an enumeration of GNU. */
CALL(FAULT_CONFINE, EPERM, -1, int, getrlimit, (int of, struct rlimit *limit), (of, limit))
CALL(FAULT_CONFINE, EPERM, -1, int, setrlimit, (int of, const struct rlimit *limit), (of, limit))
#ifdef LG_SECCOMP
CALL(FAULT_CONFINE, ENOMEM, NULL, void *, seccomp_init, (uint32_t action), (action))
CALL(FAULT_CONFINE, ENOMEM, -ENOMEM, int, seccomp_rule_add_array,
     (void *filter, uint32_t action, int call, unsigned count, const void *conditions),
     (filter, action, call, count, conditions))
CALL(FAULT_CONFINE, EINVAL, -EINVAL, int, seccomp_load, (const void *filter), (filter))
#endif
CLOSE(close, FAULT_FILES, int)
CLOSE(fclose, class_of(closed), FILE *)
CLOSE(closedir, FAULT_FILES, DIR *)
MOVE(EIO, read, (int fd, void *data, size_t bytes), (fd, data, (size_t)most))
MOVE(ENOSPC, write, (int fd, const void *data, size_t bytes), (fd, data, (size_t)most))
MOVE(EIO, pread, (int fd, void *data, size_t bytes, off_t at), (fd, data, (size_t)most, at))
MOVE(ENOSPC, pwrite, (int fd, const void *data, size_t bytes, off_t at), (fd, data, (size_t)most, at))

/* ---- calls of HDF5 ----
 *
 * Left out are functions that fail only for a wrong identifier (queries of an open data type, H5Iget_type),
 * and functions that set how HDF5 reports errors. */

#define H5_CALL(type, name, parameters, values)                                                              \
    CALL(FAULT_HDF5, EIO, (type)-1, type, name, parameters, values)
/* A query of one identifier. */
#define H5_GET(type, name) CALL(FAULT_HDF5, EIO, (type)-1, type, name, (hid_t of), (of))
/* A call that closes its argument, even if it returns an error. */
#define H5_CLOSE(name)                                                                                       \
    herr_t REAL(name)(hid_t);                                                                                \
    herr_t __wrap_##name(hid_t);                                                                             \
    herr_t __wrap_##name(hid_t closed) {                                                                     \
        const bool failed = fails(FAULT_HDF5, EIO);                                                          \
        const herr_t code = REAL(name)(closed);                                                              \
        return failed ? -1 : code;                                                                           \
    }

H5_CLOSE(H5Aclose)
H5_CLOSE(H5Dclose)
H5_CLOSE(H5Fclose)
H5_CLOSE(H5Oclose)
H5_CLOSE(H5Pclose)
H5_CLOSE(H5Sclose)
H5_CLOSE(H5Tclose)
H5_GET(hid_t, H5Aget_space)
H5_GET(hid_t, H5Aget_type)
H5_GET(hid_t, H5Dget_create_plist)
H5_GET(haddr_t, H5Dget_offset)
H5_GET(hid_t, H5Dget_space)
H5_GET(hid_t, H5Dget_type)
H5_GET(hid_t, H5Pcreate)
H5_GET(int, H5Pget_external_count)
H5_GET(H5D_layout_t, H5Pget_layout)
H5_GET(int, H5Pget_nfilters)
H5_GET(int, H5Sget_simple_extent_ndims)
H5_GET(hssize_t, H5Sget_simple_extent_npoints)
H5_GET(H5S_class_t, H5Sget_simple_extent_type)
H5_GET(herr_t, H5Sselect_all)
H5_GET(hid_t, H5Tcopy)
H5_CALL(hid_t, H5Acreate2, (hid_t a, const char *b, hid_t c, hid_t d, hid_t e, hid_t f), (a, b, c, d, e, f))
H5_CALL(herr_t, H5Adelete_by_name, (hid_t a, const char *b, const char *c, hid_t d), (a, b, c, d))
H5_CALL(htri_t, H5Aexists_by_name, (hid_t a, const char *b, const char *c, hid_t d), (a, b, c, d))
H5_CALL(herr_t, H5Aiterate2,
        (hid_t a, H5_index_t b, H5_iter_order_t c, hsize_t *d, H5A_operator2_t e, void *f),
        (a, b, c, d, e, f))
H5_CALL(hid_t, H5Aopen, (hid_t a, const char *b, hid_t c), (a, b, c))
H5_CALL(hid_t, H5Aopen_by_name, (hid_t a, const char *b, const char *c, hid_t d, hid_t e), (a, b, c, d, e))
H5_CALL(herr_t, H5Aread, (hid_t a, hid_t b, void *c), (a, b, c))
H5_CALL(herr_t, H5Awrite, (hid_t a, hid_t b, const void *c), (a, b, c))
H5_CALL(hid_t, H5Dcreate2, (hid_t a, const char *b, hid_t c, hid_t d, hid_t e, hid_t f, hid_t g),
        (a, b, c, d, e, f, g))
H5_CALL(herr_t, H5Dread, (hid_t a, hid_t b, hid_t c, hid_t d, hid_t e, void *f), (a, b, c, d, e, f))
H5_CALL(herr_t, H5Dvlen_reclaim, (hid_t a, hid_t b, hid_t c, void *d), (a, b, c, d))
H5_CALL(herr_t, H5Dwrite, (hid_t a, hid_t b, hid_t c, hid_t d, hid_t e, const void *f), (a, b, c, d, e, f))
H5_CALL(hid_t, H5Fcreate, (const char *a, unsigned b, hid_t c, hid_t d), (a, b, c, d))
H5_CALL(herr_t, H5Fflush, (hid_t a, H5F_scope_t b), (a, b))
H5_CALL(ssize_t, H5Fget_file_image, (hid_t a, void *b, size_t c), (a, b, c))
H5_CALL(hid_t, H5Fopen, (const char *a, unsigned b, hid_t c), (a, b, c))
H5_CALL(hid_t, H5Gcreate2, (hid_t a, const char *b, hid_t c, hid_t d, hid_t e), (a, b, c, d, e))
H5_CALL(htri_t, H5Lexists, (hid_t a, const char *b, hid_t c), (a, b, c))
H5_CALL(herr_t, H5Literate, (hid_t a, H5_index_t b, H5_iter_order_t c, hsize_t *d, H5L_iterate_t e, void *f),
        (a, b, c, d, e, f))
H5_CALL(htri_t, H5Oexists_by_name, (hid_t a, const char *b, hid_t c), (a, b, c))
H5_CALL(hid_t, H5Oopen, (hid_t a, const char *b, hid_t c), (a, b, c))
H5_CALL(herr_t, H5Ovisit, (hid_t a, H5_index_t b, H5_iter_order_t c, H5O_iterate_t d, void *e),
        (a, b, c, d, e))
H5_CALL(int, H5Pget_chunk, (hid_t a, int b, hsize_t *c), (a, b, c))
H5_CALL(H5Z_filter_t, H5Pget_filter2,
        (hid_t a, unsigned b, unsigned int *c, size_t *d, unsigned *e, size_t f, char *g, unsigned *h),
        (a, b, c, d, e, f, g, h))
H5_CALL(herr_t, H5Pset_alloc_time, (hid_t a, H5D_alloc_time_t b), (a, b))
H5_CALL(herr_t, H5Pset_char_encoding, (hid_t a, H5T_cset_t b), (a, b))
H5_CALL(herr_t, H5Pset_create_intermediate_group, (hid_t a, unsigned b), (a, b))
H5_CALL(herr_t, H5Pset_elink_cb, (hid_t a, H5L_elink_traverse_t b, void *c), (a, b, c))
H5_CALL(herr_t, H5Pset_fapl_core, (hid_t a, size_t b, hbool_t c), (a, b, c))
H5_CALL(herr_t, H5Pset_file_image, (hid_t a, void *b, size_t c), (a, b, c))
H5_CALL(herr_t, H5Pset_file_locking, (hid_t a, hbool_t b, hbool_t c), (a, b, c))
H5_CALL(herr_t, H5Pset_fill_time, (hid_t a, H5D_fill_time_t b), (a, b))
H5_CALL(herr_t, H5Pset_layout, (hid_t a, H5D_layout_t b), (a, b))
H5_CALL(herr_t, H5Pset_obj_track_times, (hid_t a, hbool_t b), (a, b))
H5_CALL(herr_t, H5Pset_type_conv_cb, (hid_t a, H5T_conv_except_func_t b, void *c), (a, b, c))
H5_CALL(herr_t, H5Pset_virtual, (hid_t a, hid_t b, const char *c, const char *d, hid_t e), (a, b, c, d, e))
H5_CALL(hid_t, H5Screate, (H5S_class_t a), (a))
H5_CALL(hid_t, H5Screate_simple, (int a, const hsize_t *b, const hsize_t *c), (a, b, c))
H5_CALL(int, H5Sget_simple_extent_dims, (hid_t a, hsize_t *b, hsize_t *c), (a, b, c))
H5_CALL(herr_t, H5Sselect_hyperslab,
        (hid_t a, H5S_seloper_t b, const hsize_t *c, const hsize_t *d, const hsize_t *e, const hsize_t *f),
        (a, b, c, d, e, f))
H5_CALL(herr_t, H5Tset_cset, (hid_t a, H5T_cset_t b), (a, b))
H5_CALL(herr_t, H5Tset_size, (hid_t a, size_t b), (a, b))
H5_CALL(herr_t, H5Tset_strpad, (hid_t a, H5T_str_t b), (a, b))
H5_CALL(htri_t, H5Zfilter_avail, (H5Z_filter_t a), (a))

/* ---- calls of other forms ---- */

int REAL(posix_memalign)(void **, size_t, size_t);
int __wrap_posix_memalign(void **, size_t, size_t);
int __wrap_posix_memalign(void **out, size_t alignment, size_t bytes) {
    if (fails(FAULT_MEMORY, ENOMEM)) return ENOMEM;
    const int code = REAL(posix_memalign)(out, alignment, bytes);
    faults.live += code == 0;
    return code;
}

void *REAL(realloc)(void *, size_t);
void *__wrap_realloc(void *, size_t);
void *__wrap_realloc(void *block, size_t bytes) {
    if (fails(FAULT_MEMORY, ENOMEM)) return NULL;
    void *moved = REAL(realloc)(block, bytes);
    faults.live += block == NULL && moved != NULL;
    return moved;
}

void REAL(free)(void *);
void __wrap_free(void *);
void __wrap_free(void *block) {
    faults.live -= block != NULL;
    REAL(free)(block);
}

static mode_t mode_of(int flags, va_list more) {
    return (flags & O_CREAT) != 0 ? va_arg(more, mode_t) : 0;
}

int REAL(open)(const char *, int, ...);
int __wrap_open(const char *, int, ...);
int __wrap_open(const char *path, int flags, ...) {
    va_list more;
    va_start(more, flags);
    const mode_t mode = mode_of(flags, more);
    va_end(more);
    return fails(FAULT_FILES, EMFILE) ? -1 : REAL(open)(path, flags, mode);
}

int REAL(openat)(int, const char *, int, ...);
int __wrap_openat(int, const char *, int, ...);
int __wrap_openat(int folder, const char *path, int flags, ...) {
    va_list more;
    va_start(more, flags);
    const mode_t mode = mode_of(flags, more);
    va_end(more);
    return fails(FAULT_FILES, EMFILE) ? -1 : REAL(openat)(folder, path, flags, mode);
}

int REAL(prctl)(int, ...);
int __wrap_prctl(int, ...);
int __wrap_prctl(int what, ...) {
    va_list more;
    va_start(more, what);
    const unsigned long value = va_arg(more, unsigned long);
    va_end(more);
    return fails(FAULT_CONFINE, EINVAL) ? -1 : REAL(prctl)(what, value, 0ul, 0ul, 0ul);
}

#ifdef LG_SECCOMP
/* The project calls this function without conditions. */
int REAL(seccomp_rule_add)(void *, uint32_t, int, unsigned, ...);
int __wrap_seccomp_rule_add(void *, uint32_t, int, unsigned, ...);
int __wrap_seccomp_rule_add(void *filter, uint32_t action, int call, unsigned count, ...) {
    return fails(FAULT_CONFINE, ENOMEM) ? -ENOMEM : REAL(seccomp_rule_add)(filter, action, call, count);
}
#endif

/* The project calls fcntl only with a pointer to a lock, or without a third argument. */
int REAL(fcntl)(int, int, ...);
int __wrap_fcntl(int, int, ...);
int __wrap_fcntl(int fd, int what, ...) {
    va_list more;
    va_start(more, what);
    void *lock = va_arg(more, void *);
    va_end(more);
    return fails(FAULT_FILES, ENOLCK) ? -1 : REAL(fcntl)(fd, what, lock);
}
