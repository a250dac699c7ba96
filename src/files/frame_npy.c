/* The source of rows for files of numpy. Such a file has a magic number, a version, the length of the
 * header, the header (a Python dictionary as text) and the numbers
 * (https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html). */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "core/bytes.h"
#include "files/frame.h"
#include "files/h5.h"
#include "files/read_file.h"

enum { MAGIC = 8, LONGEST_HEADER = 1 << 16, MOST_BYTES = 8, CHECK = 1 << 16 };

typedef struct npy {
    FILE *from;
    char header[LONGEST_HEADER + 1];
    char kind; /* f, i, u or b, as in numpy */
    unsigned bytes;
    bool big_endian, fortran;
    unsigned long long rows, columns;
    off_t start; /* of the numbers in the file */
} npy;

static lg_status fail(const lg_frame *f, const char *what, lg_error *error) {
    return lg_fail(error, LG_FORMAT, "%s: %s", f->shown, what);
}

/* ---- the header ---- */

static lg_status cut(const lg_frame *f, const npy *n, lg_error *error) {
    return ferror(n->from) ? lg_fail(error, LG_FILE, "%s: cannot be read", f->shown)
                           : fail(f, "ends within numpy's header: save it again with numpy.save", error);
}

static lg_status read_header(const lg_frame *f, npy *n, lg_error *error) {
    unsigned char start[MAGIC + 4];
    if (fread(start, 1, MAGIC, n->from) != MAGIC) return cut(f, n, error);
    const unsigned version = start[6], wide = version == 1 ? 2 : 4;
    if (version < 1 || version > 3)
        return fail(f, "is of an unknown version of numpy's format: save it again with numpy.save", error);
    if (fread(start + MAGIC, 1, wide, n->from) != wide) return cut(f, n, error);
    const uint32_t length = (uint32_t)lg_bytes_get(start + MAGIC, wide);
    if (length > LONGEST_HEADER)
        return fail(f, "has a numpy header of more than 65536 bytes: save a plain array", error);
    if (fread(n->header, 1, length, n->from) != length) return cut(f, n, error);
    n->header[length] = '\0';
    return LG_OK;
}

/* Returns the text after 'key': in the dictionary, or NULL if the key is missing or occurs twice. */
static char *value_of(npy *n, const char *key) {
    char *at = strstr(n->header, key);
    if (at == NULL || strstr(at + 1, key) != NULL) return NULL;
    at += strlen(key);
    return at + strspn(at, " :");
}

/* Parses a type such as '<f8' or '|b1'. */
static lg_status parse_type(const lg_frame *f, npy *n, lg_error *error) {
    char *at = value_of(n, "'descr'");
    if (at == NULL || (*at != '\'' && *at != '[') || strlen(at) < 4)
        return fail(f, "does not hold a plain array of numbers (descr): save numpy.array(a, 'f8')", error);
    n->kind = at[2];
    n->bytes = (unsigned)(at[3] - '0');
    n->big_endian = at[1] == '>';
    const bool records = *at == '[';
    const bool whole = (n->kind == 'i' || n->kind == 'u') &&
                       (n->bytes == 1 || n->bytes == 2 || n->bytes == 4 || n->bytes == 8);
    const bool real = n->kind == 'f' && (n->bytes == 4 || n->bytes == 8);
    if (!records && strchr("<>=|", at[1]) != NULL && at[4] == '\'' &&
        (whole || real || (n->kind == 'b' && n->bytes == 1)))
        return LG_OK;
    const size_t length = strcspn(at, records ? "]" : ",") + records;
    return lg_fail(error, LG_FORMAT, "%s: holds %s of type %.*s; %s", f->shown,
                   records ? "records" : "values", (int)(length < 80 ? length : 80), lg_tamed(at),
                   records ? "save their columns as one array, numpy.column_stack([a[name] for name in "
                             "a.dtype.names]), or as CSV"
                           : "the types that can be read are f4, f8, i1 to i8, u1 to u8 and b1; convert with "
                             "a.astype('f8')");
}

static lg_status parse_shape(const lg_frame *f, npy *n, lg_error *error) {
    const char *order = value_of(n, "'fortran_order'");
    char *shape = value_of(n, "'shape'");
    unsigned long long dims[2] = {0, 1};
    size_t rank = 0;
    n->fortran = order != NULL && strncmp(order, "True", 4) == 0;
    if (order == NULL || (!n->fortran && strncmp(order, "False", 5) != 0) || shape == NULL || *shape != '(')
        return fail(f, "has no shape or no order in its header: save it again with numpy.save", error);
    const size_t length = strcspn(shape, ")");
    for (char *at = shape + 1, *end = at; *at != ')' && *at != '\0'; at = end + strspn(end, ", ")) {
        const unsigned long long value = strtoull(at, &end, 10);
        if (*at < '0' || *at > '9' || rank == 2)
            return lg_fail(error, LG_FORMAT,
                           "%s: has shape %.*s), expected (rows) or (rows, columns): save "
                           "a.reshape(len(a), -1)",
                           f->shown, (int)(length < 80 ? length : 80), lg_tamed(shape));
        dims[rank++] = value;
    }
    if (rank == 0) return fail(f, "is a single number, not an array: save numpy.atleast_1d(a)", error);
    n->rows = dims[0];
    n->columns = dims[1];
    if (n->rows == 0 || n->columns == 0)
        return fail(f, "has no numbers: one of its dimensions is 0; save at least one row", error);
    if (n->columns > LG_FRAME_MOST_COLUMNS)
        return fail(f, "has more than 65536 columns: save fewer, or a.T", error);
    return LG_OK;
}

/* The file must have exactly the numbers that the header declares. This is checked before memory is
 * allocated. */
static lg_status check_size(const lg_frame *f, npy *n, lg_error *error) {
    struct stat about;
    lg_read_options options;
    LG_TRY(lg_read_options_resolve(f->options, &options, error));
    const off_t at = n->start = ftello(n->from);
    if (at < 0 || fstat(fileno(n->from), &about) != 0)
        return lg_fail(error, LG_FILE, "%s: %s", f->shown, strerror(errno));
    const uint64_t have = (uint64_t)about.st_size - (uint64_t)at;
    if (n->rows > have / (n->columns * n->bytes))
        return lg_fail(error, LG_FORMAT,
                       "%s: is cut off: its header announces (%llu, %llu) numbers; save or copy it again",
                       f->shown, n->rows, n->columns);
    if (n->rows * n->columns * n->bytes < have)
        return lg_fail(error, LG_FORMAT, "%s: %llu bytes follow after its array; save one array per file",
                       f->shown, have - n->rows * n->columns * n->bytes);
    if (n->rows * n->columns > options.max_size / sizeof(double))
        return lg_fail(error, LG_FORMAT,
                       "%s: has (%llu, %llu) numbers; at most %llu are read: save fewer rows", f->shown,
                       n->rows, n->columns, (unsigned long long)(options.max_size / sizeof(double)));
    return LG_OK;
}

/* ---- numbers ---- */

/* Puts the bits of a number, as lg_frame_put_number takes them, into *out and returns its type. */
static char number_of(const npy *n, const unsigned char *raw, uint64_t *out) {
    unsigned char bytes[MOST_BYTES];
    const unsigned size = n->bytes;
    for (unsigned i = 0; i < size; i++) bytes[i] = raw[n->big_endian ? size - 1 - i : i];
    *out = lg_bytes_get(bytes, size);
    const uint64_t top = (uint64_t)1 << (8 * size - 1);
    if (n->kind == 'i') *out = (*out ^ top) - top; /* copies the sign to the bits above */
    if (n->kind != 'f') return n->kind == 'i' ? 'i' : 'u';
    if (size == 4) *out = lg_bits_of_f64((double)lg_f32_of_bits((uint32_t)*out));
    return size == 4 ? 'f' : 'd';
}

static lg_status read_number(lg_frame *f, npy *n, size_t row, uint32_t column, lg_error *error) {
    unsigned char raw[MOST_BYTES];
    uint64_t bits;
    if (fread(raw, 1, n->bytes, n->from) != n->bytes)
        return lg_fail(error, LG_FILE, "%s: cannot be read to its end", f->shown);
    if (!lg_frame_is_wanted(f, column)) return LG_OK;
    if (n->kind == 'b' && *raw > 1)
        return lg_frame_fail(f, row, f->name[column], error,
                             "a value of type b1 is %u, expected 0 or 1: save a.view('u1')", *raw);
    return lg_frame_put_number(f, row, column, number_of(n, raw, &bits), &bits, error);
}

/* The numbers of a row follow each other in C order, those of a column in Fortran order. */
static lg_status read_rows(lg_frame *f, size_t most, lg_error *error) {
    npy *n = f->source;
    LG_TRY(lg_frame_number_rows(f, most, n->rows - f->before, error));
    const uint64_t outer = n->fortran ? n->columns : f->rows, inner = n->fortran ? f->rows : n->columns;
    for (uint64_t a = 0; a < outer; a++) {
        const uint64_t at = n->fortran ? a * n->rows + f->before : (f->before + a) * n->columns;
        if ((a == 0 || n->fortran) && fseeko(n->from, n->start + (off_t)(at * n->bytes), SEEK_SET) != 0)
            return lg_fail(error, LG_FILE, "%s: %s", f->shown, strerror(errno));
        for (uint64_t b = 0; b < inner; b++) {
            if (b % CHECK == 0 && lg_cancelled(f->context)) return LG_CANCELLED;
            LG_TRY(read_number(f, n, (size_t)(n->fortran ? b : a), (uint32_t)(n->fortran ? a : b), error));
        }
    }
    return LG_OK;
}

/* ---- the file ---- */

static lg_status is_npy(const char *path, const unsigned char *first, size_t count, bool *is,
                        lg_error *error) {
    *is = count >= 6 && memcmp(first, "\x93NUMPY", 6) == 0;
    return LG_OK;
}

static lg_status open_npy(lg_frame *f, lg_error *error) {
    npy *n = f->source = lg_alloc(f->context, 1, sizeof *n);
    uint64_t bytes;
    if (n == NULL) return lg_frame_no_memory(f, error);
    LG_TRY(lg_read_open(f->path, &n->from, &bytes, error));
    LG_TRY(read_header(f, n, error));
    LG_TRY(parse_type(f, n, error));
    LG_TRY(parse_shape(f, n, error));
    LG_TRY(check_size(f, n, error));
    for (unsigned long long c = 0; c < n->columns; c++) {
        char name[24];
        (void)snprintf(name, sizeof name, "c%llu", c);
        LG_TRY(lg_frame_add_name(f, name, error));
    }
    return lg_frame_find(f, error);
}

static void close_npy(lg_frame *f) {
    npy *n = f->source;
    if (n != NULL && n->from != NULL) (void)fclose(n->from);
    lg_free(f->context, n);
}

const lg_frame_format lg_frame_npy = {"npy", "row", is_npy, open_npy, read_rows, close_npy};
