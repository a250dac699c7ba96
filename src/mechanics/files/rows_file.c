/* A file for the trajectories of an ensemble. HDF5 lays the file out first. Then rows are written in place
 * without HDF5, from any thread and in any order. A virtual data set in another file can join several
 * files. */
#define _DEFAULT_SOURCE /* flock */
#include <errno.h>
#include <string.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/core.h"
#include "files/h5_internal.h"

static const char KIND[] = "ensemble-trajectories";

struct lg_rows_file {
    const lg_context *context;
    char *path;
    lg_temporary temporary;
    uint64_t rows, offset; /* number of rows; offset of the first one in the file, bytes */
    size_t row_bytes;
};

LG_AT(lg_rows_file_destroy, lg_rows_file)

static lg_status failed(lg_error *error, const char *path, const char *what) {
    return lg_fail(error, lg_status_of(errno), "%s: %s: %s", lg_shown_path(path), what, strerror(errno));
}

/* ---- the layout ---- */

/* Creates the data set /trajectories: contiguous, allocated at once, not filled. *offset: its file offset.
 * If an object could not be made, HDF5 refuses its id in the next call. So only the results of the last calls
 * are checked. */
static bool lay_out(lg_h5 *h5, const uint64_t dims[3], uint64_t *offset) {
    const hsize_t extent[3] = {dims[0], dims[1], dims[2]};
    LG_ID space = H5Screate_simple(3, extent, NULL), create = H5Pcreate(H5P_DATASET_CREATE);
    const herr_t options = H5Pset_obj_track_times(create, false) | H5Pset_layout(create, H5D_CONTIGUOUS) |
                           H5Pset_alloc_time(create, H5D_ALLOC_TIME_EARLY) |
                           H5Pset_fill_time(create, H5D_FILL_TIME_NEVER);
    LG_ID set = H5Dcreate2(h5->file, "trajectories", H5T_IEEE_F64LE, space, H5P_DEFAULT, create, H5P_DEFAULT);
    const haddr_t place = H5Dget_offset(set);
    *offset = (uint64_t)place;
    return options >= 0 && place != HADDR_UNDEF;
}

/* Writes the file without its rows. */
static lg_status write_layout(lg_rows_file *file, const lg_rows_options *o, lg_error *error) {
    const uint64_t dims[3] = {o->rows, o->points, o->dim};
    LG_CLEAN(lg_h5_close_at) lg_h5 *h5 = NULL;
    LG_TRY(lg_h5_new(file->context, file->path, &h5, error));
    LG_QUIET;
    h5->file = H5Fcreate(file->temporary.name, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    if (h5->file < 0 || !lay_out(h5, dims, &file->offset))
        return lg_fail(error, LG_FILE, "%s: cannot be written", lg_shown_path(file->path));
    LG_TRY(lg_h5_put_header(h5, KIND, o->provenance, error));
    LG_TRY(lg_h5_put(h5, "t", LG_ELEMENT_F64, 1, &dims[1], o->t, error));
    LG_TRY(lg_h5_put_number(h5, "", "first", LG_ELEMENT_U64, &o->first, error));
    LG_TRY(lg_h5_put_text(h5, "", "layout", o->layout, error));
    if (o->run) LG_TRY(lg_h5_put_text(h5, "", "ensemble", o->run, error));
    if (H5Fflush(h5->file, H5F_SCOPE_LOCAL) >= 0) return LG_OK;
    return lg_fail(error, LG_FILE, "%s: cannot be written", lg_shown_path(file->path));
}

/* Fails if RLIMIT_FSIZE forbids a file of this size: HDF5 would be killed by SIGXFSZ. Beside the rows, the
 * times and the texts of the options the file has less than REST bytes. */
static lg_status check_limit(const lg_rows_file *file, const lg_rows_options *o, lg_error *error) {
    enum { REST = 1 << 16 };
    struct rlimit limit;
    const uint64_t texts = strlen(o->layout) + (o->run ? strlen(o->run) : 0);
    const uint64_t bytes = file->rows * file->row_bytes + o->points * sizeof(double) + texts + REST;
    if (getrlimit(RLIMIT_FSIZE, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY || bytes <= limit.rlim_cur)
        return LG_OK;
    errno = EFBIG;
    return failed(error, file->path, "cannot be written");
}

/* Lays out the temporary file, and allocates its whole size on the disk. HDF5 opens the file by its name and
 * locks it meanwhile (flock). */
static lg_status lay_out_file(lg_rows_file *file, const lg_rows_options *options, lg_error *error) {
    const int fd = file->temporary.fd;
    (void)flock(fd, LOCK_UN);
    LG_TRY(write_layout(file, options, error));
    const bool lost = flock(fd, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
    if (!lost) errno = posix_fallocate(fd, 0, (off_t)(file->offset + file->rows * file->row_bytes));
    return errno == 0 && !lost ? LG_OK : failed(error, file->path, "cannot be written");
}

lg_status lg_rows_file_create(const lg_context *context, const char *path, const lg_rows_options *options,
                              lg_rows_file **out, lg_error *error) {
    if (!path || !options || !out || options->rows < 1 || options->points < 1 || options->dim < 1)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "an argument is NULL, or the number of rows, points or numbers per state is 0");
    if (options->points > SIZE_MAX / 64 / options->dim ||
        options->rows > (uint64_t)INT64_MAX / 2 / (options->points * options->dim * sizeof(double)))
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: too many numbers", lg_shown_path(path));
    LG_CLEAN(lg_rows_file_destroy_at) lg_rows_file *file = lg_alloc(context, 1, sizeof(*file));
    if (file)
        *file = (lg_rows_file){.context = context,
                               .path = lg_strdup(context, path),
                               .temporary = {.fd = -1},
                               .rows = options->rows,
                               .row_bytes = options->points * options->dim * sizeof(double)};
    if (!file || !file->path) return lg_no_memory_for(path, error);
    LG_TRY(lg_may_replace(context, path, LG_H5_SIGNATURE, sizeof LG_H5_SIGNATURE - 1, error));
    LG_TRY(check_limit(file, options, error));
    LG_TRY(lg_temporary_create(context, path, false, &file->temporary, error));
    LG_TRY(lay_out_file(file, options, error));
    return LG_MOVE(out, file);
}

/* ---- rows ---- */

lg_status lg_rows_file_put(const lg_rows_file *file, uint64_t row, const double *values) {
    LG_NEEDS(NULL, file, values);
    const char *from = (const char *)values;
    size_t left = file->row_bytes;
    off_t to = (off_t)(file->offset + row * file->row_bytes);
    if (row >= file->rows) return LG_INVALID_ARGUMENT;
    while (left > 0) {
        const ssize_t n = pwrite(file->temporary.fd, from, left, to);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return LG_FILE;
        from += n, to += n, left -= (size_t)n;
    }
    return LG_OK;
}

lg_status lg_rows_file_commit(lg_rows_file *file, lg_error *error) {
    LG_NEEDS(error, file);
    LG_TRY(lg_temporary_publish(&file->temporary, file->path, error));
    lg_temporary_end(&file->temporary);
    file->temporary = (lg_temporary){.fd = -1};
    return LG_OK;
}

void lg_rows_file_destroy(lg_rows_file *file) {
    if (!file) return;
    if (file->temporary.fd >= 0) {
        (void)unlink(file->temporary.name);
        lg_temporary_end(&file->temporary);
    }
    LG_FREE_ALL(file->context, file->path, file);
}

/* ---- contents of a file ---- */

typedef struct look_call {
    lg_rows_about about;
    char *run;
    size_t size;
} look_call;

static lg_status look(void *user, lg_h5 *h5, lg_error *error) {
    look_call *call = user;
    lg_h5_about all;
    lg_h5_size rows = {0, "rows", NULL}, points = {0, "points", NULL}, dim = {0, "numbers per state", NULL};
    const lg_h5_array array = {"trajectories", NULL, {&rows, &points, &dim}, false};
    LG_TRY(lg_h5_check_format(h5, KIND, false, error));
    LG_TRY(lg_h5_number(h5, "", "first", LG_ELEMENT_U64, &call->about.first, error));
    if (call->run) LG_TRY(lg_h5_text(h5, "", "ensemble", call->run, call->size, error));
    LG_TRY(lg_h5_fit(h5, &array, sizeof(double), false, &all, error));
    call->about.rows = rows.n;
    call->about.points = points.n;
    call->about.dim = dim.n;
    return LG_OK;
}

lg_status lg_rows_file_look(const lg_context *context, const char *path, lg_rows_about *out, char *run,
                            size_t size, lg_error *error) {
    struct stat file;
    lg_read_options options;
    look_call call = {.run = run, .size = size};
    if (!path || !out) return lg_fail(error, LG_INVALID_ARGUMENT, "a file needs a name");
    lg_read_options_init(&options);
    /* The rows, which are not read here, may exceed the default max_size, but not the size of the file. */
    if (stat(path, &file) == 0 && (uint64_t)file.st_size > options.max_size)
        options.max_size = (uint64_t)file.st_size;
    LG_TRY(lg_h5_read(context, path, &options, look, &call, error));
    *out = call.about;
    return LG_OK;
}

/* ---- several files as one data set ---- */

/* The last component of a path: the parts must be in the same folder as the file that refers to them. */
static const char *base_of(const char *path) {
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

static bool map_part(hid_t create, hid_t whole, const lg_rows_part *part, uint64_t at,
                     const hsize_t extent[3]) {
    const hsize_t start[3] = {at, 0, 0}, count[3] = {part->rows, extent[1], extent[2]};
    LG_ID from = H5Screate_simple(3, count, NULL);
    return H5Sselect_hyperslab(whole, H5S_SELECT_SET, start, NULL, count, NULL) >= 0 &&
           H5Pset_virtual(create, whole, base_of(part->path), "trajectories", from) >= 0;
}

lg_status lg_file_writer_rows(lg_file_writer *writer, const lg_rows_part *parts, size_t count,
                              uint64_t points, uint64_t dim, lg_error *error) {
    LG_NEEDS(error, writer, parts);
    lg_h5 *h5 = lg_file_writer_h5(writer);
    hsize_t extent[3] = {0, points, dim};
    for (size_t i = 0; i < count; i++) extent[0] += parts[i].rows;
    LG_QUIET;
    LG_ID whole = H5Screate_simple(3, extent, NULL), create = H5Pcreate(H5P_DATASET_CREATE);
    uint64_t at = 0;
    bool made = H5Pset_obj_track_times(create, false) >= 0;
    for (size_t i = 0; made && i < count; at += parts[i++].rows)
        made = map_part(create, whole, &parts[i], at, extent);
    (void)H5Sselect_all(whole);
    LG_ID set =
        made ? H5Dcreate2(h5->file, "trajectories", H5T_IEEE_F64LE, whole, H5P_DEFAULT, create, H5P_DEFAULT)
             : H5I_INVALID_HID;
    return set >= 0 ? LG_OK : lg_fail(error, LG_OUT_OF_MEMORY, "/trajectories could not be stored in memory");
}
