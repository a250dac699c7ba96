#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "files/h5_internal.h"
#include "files/read_file.h"

/* Upper bound on the bytes of data per byte of a compressed file. Files that declare more are refused. */
#define EXPANSION 8192u

/* ---- opening ---- */

/* Opens a copy in memory that may be changed. It reads the file itself: HDF5 would open the file for writing,
 * though nothing is written to it. */
static hid_t open_copy(const lg_h5 *h5, FILE *from, uint64_t bytes, hid_t access_list) {
    LG_SCRATCH(char, image, h5->context, bytes);
    if (image == NULL || fread(image, 1, (size_t)bytes, from) != bytes ||
        H5Pset_fapl_core(access_list, LG_CORE_INCREMENT, false) < 0 ||
        H5Pset_file_image(access_list, image, (size_t)bytes) < 0)
        return H5I_INVALID_HID;
    return H5Fopen(lg_h5_memory_name(h5).text, H5F_ACC_RDWR, access_list);
}

static lg_status open_handle(const lg_context *context, const char *path, const lg_read_options *options,
                             bool edit, lg_h5 **out, lg_error *error) {
    lg_read_options chosen;
    LG_CLEAN(lg_h5_close_at) lg_h5 *h5 = NULL;
    FILE *from = NULL;
    uint64_t bytes = 0;
    LG_TRY(lg_read_options_resolve(options, &chosen, error));
    LG_TRY(lg_h5_new(context, path, &h5, error));
    LG_TRY(lg_read_open(path, &from, &bytes, error));
    const uint64_t plausible = bytes > UINT64_MAX / EXPANSION ? UINT64_MAX : bytes * EXPANSION;
    h5->max_size = chosen.max_size < plausible ? chosen.max_size : plausible;
    LG_QUIET;
    LG_ID access = H5Pcreate(H5P_FILE_ACCESS);
#if H5_VERSION_GE(1, 10, 7)
    (void)H5Pset_file_locking(access, false, true);
#endif
    if (bytes > 0)
        h5->file = edit ? open_copy(h5, from, bytes, access) : H5Fopen(path, H5F_ACC_RDONLY, access);
    (void)fclose(from);
    if (bytes == 0) return lg_fail(error, LG_FORMAT, "%s: is empty: write it again", lg_shown_path(path));
    if (h5->file < 0)
        return lg_fail(error, LG_FORMAT,
                       "%s: is not an HDF5 file: give one; if it should be one, it is cut short, damaged or "
                       "still being written: write or copy it again",
                       lg_shown_path(path));
    return LG_MOVE(out, h5);
}

lg_status lg_h5_open(const lg_context *context, const char *path, const lg_read_options *options, lg_h5 **out,
                     lg_error *error) {
    return open_handle(context, path, options, false, out, error);
}

lg_status lg_h5_edit(const lg_context *context, const char *path, lg_h5 **out, lg_error *error) {
    return open_handle(context, path, NULL, true, out, error);
}

typedef struct read_call {
    const lg_context *context;
    const char *path;
    const lg_read_options *options;
    lg_status (*read)(void *user, lg_h5 *h5, lg_error *error);
    void *user;
} read_call;

static lg_status open_and_read(void *user, lg_error *error) {
    const read_call *call = user;
    LG_CLEAN(lg_h5_close_at) lg_h5 *h5 = NULL;
    LG_TRY(lg_h5_open(call->context, call->path, call->options, &h5, error));
    return call->read(call->user, h5, error);
}

lg_status lg_h5_read(const lg_context *context, const char *path, const lg_read_options *options,
                     lg_status (*read)(void *user, lg_h5 *h5, lg_error *error), void *user, lg_error *error) {
    read_call call = {context, path, options, read, user};
    LG_TRY(lg_probe(context, path, options, open_and_read, &call, error));
    return open_and_read(&call, error);
}

/* ---- data sets ---- */

void lg_dataset_close(const lg_dataset *d) {
    lg_id_close(&d->type);
    lg_id_close(&d->set);
}

hid_t lg_dataset_memory(const lg_dataset *d, hid_t type) {
    if (d->member == NULL) return H5Tcopy(type);
    hid_t record = H5Tcreate(H5T_COMPOUND, H5Tget_size(type));
    (void)H5Tinsert(record, d->member, 0, type);
    return record;
}

lg_status lg_dataset_error(const lg_h5 *h5, const char *name, const char *what, lg_error *error) {
    return lg_h5_fail(h5, error, "/%s: %s", name, what);
}

/* False if the data lies in other files, as in external storage and virtual data sets. Such data is not
 * read. */
static bool is_local(hid_t set) {
    LG_ID list = H5Dget_create_plist(set);
    const H5D_layout_t layout = H5Pget_layout(list);
    return (layout == H5D_COMPACT || layout == H5D_CONTIGUOUS || layout == H5D_CHUNKED) &&
           H5Pget_external_count(list) == 0;
}

static lg_status read_extent(const lg_h5 *h5, const char *name, size_t bytes, lg_dataset *d,
                             lg_error *error) {
    LG_ID space = H5Dget_space(d->set);
    H5S_class_t kind = H5Sget_simple_extent_type(space);
    int rank = kind == H5S_SIMPLE || kind == H5S_SCALAR ? H5Sget_simple_extent_ndims(space) : -1;
    hsize_t extent[H5S_MAX_RANK] = {0};
    if (rank > 0 && H5Sget_simple_extent_dims(space, extent, NULL) < 0) rank = -1;
    if (rank < 0)
        return lg_dataset_error(h5, name, "has no shape (a null data space); write an array", error);
    if (rank > LG_MAX_RANK)
        return lg_h5_fail(h5, error, "/%s: has rank %d, but at most %d can be read; write several data sets",
                          name, rank, LG_MAX_RANK);
    uint64_t most = h5->max_size / bytes;
    d->rank = (uint32_t)rank;
    d->count = 1;
    bool fits = true, none = false;
    for (int i = 0; i < rank; i++) {
        d->dims[i] = extent[i];
        none = none || extent[i] == 0;
        fits = fits && (extent[i] == 0 || d->count <= most / extent[i]);
        if (fits && extent[i] != 0) d->count *= extent[i];
    }
    if (!fits)
        return lg_dataset_error(
            h5, name, "declares more data than the file can hold or the limit allows; split it", error);
    if (none) d->count = 0;
    return LG_OK;
}

/* Opens a data set of any type. Fails with LG_FORMAT if it exceeds max_size at `bytes` bytes per element. */
static lg_status open_set(lg_h5 *h5, const char *name, size_t bytes, lg_dataset *d, lg_error *error) {
    if (!lg_path_exists(h5, name))
        return lg_fail(error, LG_NOT_FOUND,
                       "%s: has no /%s; write this data set, or rename the one that you mean",
                       lg_shown_path(h5->path), name);
    d->set = H5Oopen(h5->file, name, h5->links);
    if (d->set < 0)
        return lg_dataset_error(h5, name, "is a broken or external link, or of a newer HDF5", error);
    if (H5Iget_type(d->set) != H5I_DATASET)
        return lg_dataset_error(h5, name, "is not a data set; write an array under this name", error);
    if (!is_local(d->set))
        return lg_dataset_error(h5, name, "keeps its data in another file; write them into this one", error);
    if (H5Aexists_by_name(h5->file, name, "scale_factor", h5->links) > 0 ||
        H5Aexists_by_name(h5->file, name, "add_offset", h5->links) > 0)
        return lg_dataset_error(h5, name, "is packed (scale_factor, add_offset); write the values themselves",
                                error);
    d->type = H5Dget_type(d->set);
    return d->type >= 0 ? read_extent(h5, name, bytes, d, error)
                        : lg_dataset_error(h5, name, "has no type", error);
}

/* True if the bits that the type declares lie within its bytes. HDF5 does not check this, and with a damaged
 * file its conversions write beyond the stack's buffers. */
static bool is_sound(hid_t type) {
    const size_t bits = 8 * H5Tget_size(type), precision = H5Tget_precision(type);
    const int offset = H5Tget_offset(type);
    if (bits == 0 || bits > 256 || precision == 0 || offset < 0 || (size_t)offset + precision > bits)
        return false;
    if (H5Tget_class(type) == H5T_INTEGER) return true;
    size_t sign, exponent, exponents, mantissa, mantissas;
    return H5Tget_fields(type, &sign, &exponent, &exponents, &mantissa, &mantissas) >= 0 && sign < bits &&
           exponents > 0 && exponents <= 32 && exponent + exponents <= bits && mantissas > 0 &&
           mantissa + mantissas <= bits;
}

bool lg_is_number(hid_t type) {
    const H5T_class_t kind = H5Tget_class(type);
    return (kind == H5T_FLOAT || kind == H5T_INTEGER) && is_sound(type);
}

static lg_status open_numbers(lg_h5 *h5, const char *name, lg_dataset *d, lg_error *error) {
    LG_TRY(open_set(h5, name, sizeof(double), d, error));
    return lg_is_number(d->type) ? LG_OK : lg_dataset_error(h5, name, LG_NO_NUMBERS, error);
}

static H5T_conv_ret_t no_overflow(H5T_conv_except_t kind, hid_t from, hid_t to, void *source, void *target,
                                  void *user) {
    return kind == H5T_CONV_EXCEPT_RANGE_HI || kind == H5T_CONV_EXCEPT_RANGE_LOW ? H5T_CONV_ABORT
                                                                                 : H5T_CONV_UNHANDLED;
}

/* True if the data was written through a filter that is not available here; `name` becomes the filter's
 * name. */
static bool missing_filter(hid_t set, char *name, size_t size) {
    LG_ID list = H5Dget_create_plist(set);
    const int filters = H5Pget_nfilters(list);
    bool missing = false;
    for (int i = 0; i < filters && !missing; i++) {
        unsigned flags, config;
        size_t values = 0;
        const H5Z_filter_t filter =
            H5Pget_filter2(list, (unsigned)i, &flags, &values, NULL, size, name, &config);
        missing = filter >= 0 && H5Zfilter_avail(filter) <= 0;
        if (missing && name[0] == '\0') (void)snprintf(name, size, "%d", (int)filter);
    }
    name[size - 1] = '\0';
    return missing;
}

/* Reads part of a data set. HDF5 converts while it reads, in pieces of a megabyte. If `checked`, a number out
 * of range is an error; otherwise numbers beyond the range of a float become infinite. */
static lg_status read_part(lg_h5 *h5, const char *name, const lg_dataset *d, hid_t memory, hid_t room,
                           hid_t part, bool checked, void *out, lg_error *error) {
    char filter[64] = "";
    LG_ID transfer = H5Pcreate(H5P_DATASET_XFER), element = lg_dataset_memory(d, memory);
    if ((!checked || H5Pset_type_conv_cb(transfer, no_overflow, NULL) >= 0) &&
        H5Dread(d->set, element, room, part, transfer, out) >= 0)
        return LG_OK;
    if (missing_filter(d->set, filter, sizeof filter))
        return lg_h5_fail(h5, error,
                          "/%s: is compressed with '%s', which this HDF5 cannot undo: write it with gzip or "
                          "without compression",
                          name, filter);
    return lg_dataset_error(
        h5, name, "cannot be read: cut short, damaged, or a number out of range; write it again", error);
}

/* If integers of the file and of memory differ only in sign and byte order, HDF5 reverses the bytes and does
 * not check the range. A number out of range then has the same bits as a number in range, and its highest bit
 * is set. Whether there is such a number. */
static bool is_out_of_range(hid_t stored, hid_t memory, const unsigned char *values, uint64_t count) {
    const size_t size = H5Tget_size(memory), top = H5Tget_order(memory) == H5T_ORDER_LE ? size - 1 : 0;
    if (H5Tget_class(stored) != H5T_INTEGER || H5Tget_class(memory) != H5T_INTEGER ||
        H5Tget_size(stored) != size || H5Tget_sign(stored) == H5Tget_sign(memory))
        return false;
    uint64_t i = 0;
    while (i < count && (values[i * size + top] & 0x80) == 0) i++;
    return i < count;
}

void lg_shape_text(char text[LG_SHAPE_TEXT], uint32_t rank, const uint64_t *dims) {
    (void)snprintf(text, LG_SHAPE_TEXT, "(");
    for (uint32_t i = 0; i < rank; i++)
        lg_append(text, LG_SHAPE_TEXT, "%s%llu", i > 0 ? ", " : "", (unsigned long long)dims[i]);
    lg_append(text, LG_SHAPE_TEXT, ")");
}

/* Writes the indices of number `at` of an array as "(0, 2)". */
static void index_text(char text[LG_SHAPE_TEXT], uint32_t rank, const uint64_t *dims, uint64_t at) {
    uint64_t index[LG_MAX_RANK];
    for (uint32_t i = rank; i-- > 0; at /= dims[i]) index[i] = at % dims[i];
    lg_shape_text(text, rank, index);
}

/* True for integers that may be beyond 2^53. */
static bool is_long(hid_t type) {
    const H5T_class_t kind = H5Tget_class(type);
    return (kind == H5T_INTEGER || kind == H5T_ENUM) && H5Tget_size(type) > sizeof(int32_t);
}

hid_t lg_h5_long_type(hid_t stored) {
    return H5Tget_sign(stored) == H5T_SGN_NONE ? H5T_NATIVE_UINT64 : H5T_NATIVE_INT64;
}

static lg_status rounded(const lg_h5 *h5, const char *name, const lg_dataset *d, uint64_t at, bool minus,
                         uint64_t magnitude, lg_error *error) {
    char where[LG_SHAPE_TEXT];
    const uint64_t row = d->rank > 0 ? at / (d->count / d->dims[0]) : 0;
    index_text(where, d->rank, d->dims, at);
    return lg_h5_fail(h5, error, "/%s: row %llu, index %s: %s%llu is beyond 2^53 and " LG_ROUNDED, name,
                      (unsigned long long)row + 1, where, minus ? "-" : "", (unsigned long long)magnitude);
}

void lg_h5_fills(lg_h5 *h5, const char *name, double fill[LG_H5_FILLS]) {
    static const char *const attributes[] = {"_FillValue", "missing_value"};
    hssize_t used = 0;
    LG_QUIET;
    for (int i = 0; i < LG_H5_FILLS; i++) fill[i] = NAN;
    for (size_t a = 0; a < LG_COUNT(attributes); a++) {
        if (!lg_attribute_exists(h5, name, attributes[a])) continue;
        LG_ID at = H5Aopen_by_name(h5->file, name, attributes[a], H5P_DEFAULT, h5->links),
              stored = H5Aget_type(at), space = H5Aget_space(at);
        const hssize_t count = H5Sget_simple_extent_npoints(space);
        if (count > 0 && used + count <= LG_H5_FILLS && lg_is_number(stored) &&
            H5Aread(at, H5T_NATIVE_DOUBLE, fill + used) >= 0)
            used += count;
    }
}

bool lg_h5_is_fill(const double fill[LG_H5_FILLS], double value) {
    for (int i = 0; i < LG_H5_FILLS; i++) {
        const double near = fabs(fill[i]) <= (double)FLT_MAX ? (double)(float)fill[i] : 0.0;
        if (value == fill[i] || (near != 0.0 && value == near)) return true;
    }
    return false;
}

/* Reads `count` numbers as doubles; number `first` of the data set is the first one. Long integers are read
 * as they are, and converted in place unless they are to stay raw. */
static lg_status read_doubles(lg_h5 *h5, const char *name, const lg_dataset *d, hid_t room, hid_t part,
                              uint64_t first, uint64_t count, bool checked, lg_h5_long as, double *out,
                              lg_error *error) {
    const bool whole = is_long(d->type);
    const hid_t type = whole ? lg_h5_long_type(d->type) : H5T_NATIVE_DOUBLE;
    double fill[LG_H5_FILLS];
    LG_TRY(read_part(h5, name, d, type, room, part, whole || checked, out, error));
    if (as == LG_H5_RAW) return LG_OK;
    const bool negative = type == H5T_NATIVE_INT64; /* the macro calls HDF5 */
    lg_h5_fills(h5, name, fill);
    for (uint64_t i = 0; i < count; i++) {
        uint64_t bits;
        memcpy(&bits, &out[i], sizeof bits);
        const bool minus = negative && bits >> 63 != 0;
        const uint64_t magnitude = minus ? ~bits + 1 : bits;
        if (whole) out[i] = minus ? -(double)magnitude : (double)magnitude;
        if (lg_h5_is_fill(fill, out[i]))
            out[i] = NAN;
        else if (whole && lg_whole_is_rounded(magnitude))
            return rounded(h5, name, d, first + i, minus, magnitude, error);
    }
    return LG_OK;
}

static lg_status read_all(lg_h5 *h5, const char *name, const lg_dataset *d, hid_t memory, void *out,
                          lg_error *error) {
    if (d->count == 0) return LG_OK;
    if (memory == H5T_NATIVE_DOUBLE)
        return read_doubles(h5, name, d, H5S_ALL, H5S_ALL, 0, d->count, true, LG_H5_EXACT, out, error);
    LG_TRY(read_part(h5, name, d, memory, H5S_ALL, H5S_ALL, true, out, error));
    if (!is_out_of_range(d->type, memory, out, d->count)) return LG_OK;
    return lg_dataset_error(h5, name, "cannot be read: a number is out of range", error);
}

lg_status lg_h5_get(lg_h5 *h5, const char *name, lg_element type, uint32_t rank, const uint64_t *dims,
                    void *out, lg_error *error) {
    LG_QUIET;
    LG_DATASET(d);
    char have[LG_SHAPE_TEXT], want[LG_SHAPE_TEXT];
    LG_TRY(open_numbers(h5, name, &d, error));
    lg_shape_text(have, d.rank, d.dims);
    lg_shape_text(want, rank, dims);
    if (strcmp(have, want) != 0)
        return lg_fail(error, LG_SHAPE, "%s: /%s: has shape %s, expected %s", lg_shown_path(h5->path), name,
                       have, want);
    if (type != LG_ELEMENT_F64 && type != LG_ELEMENT_F32 && H5Tget_class(d.type) != H5T_INTEGER)
        return lg_dataset_error(h5, name, "does not hold integers: write it with an integer type", error);
    return read_all(h5, name, &d, lg_h5_memory_type(type), out, error);
}

lg_status lg_check_finite(const char *path, const char *name, uint32_t rank, const uint64_t *dims,
                          const double *data, lg_error *error) {
    uint64_t count = 1, at = 0;
    for (uint32_t i = 0; i < rank; i++) count *= dims[i];
    while (at < count && isfinite(data[at])) at++;
    if (at == count) return LG_OK;
    char where[LG_SHAPE_TEXT];
    index_text(where, rank, dims, at);
    return lg_fail(error, LG_NOT_FINITE, "%s: /%s: %s at index %s", lg_shown_path(path), name,
                   isnan(data[at]) ? "NaN" : "an infinity", where);
}

/* ---- arrays of any type ---- */

static lg_h5_class class_of(hid_t type) {
    const H5T_class_t kind = H5Tget_class(type);
    const bool number = lg_is_number(type);
    return kind == H5T_ENUM || (number && kind == H5T_INTEGER) ? LG_H5_WHOLE
           : number                                            ? LG_H5_REAL
           : kind == H5T_STRING                                ? LG_H5_WORDS
           : kind == H5T_COMPOUND                              ? LG_H5_TABLE
                                                               : LG_H5_OTHER;
}

static void describe(const lg_dataset *d, lg_h5_about *out) {
    const size_t bytes = H5Tget_size(d->type);
    const bool real = H5Tget_class(d->type) == H5T_FLOAT;
    hsize_t chunk[LG_MAX_RANK] = {0};
    LG_ID plist = H5Dget_create_plist(d->set);
    *out = (lg_h5_about){.kind = class_of(d->type), .rank = d->rank, .count = d->count};
    out->wide = bytes > (real ? sizeof(float) : 3);
    if (real) out->epsilon = bytes <= 2 ? 0x1p-10 : bytes <= 4 ? FLT_EPSILON : DBL_EPSILON;
    if (H5Pget_layout(plist) == H5D_CHUNKED && H5Pget_chunk(plist, LG_MAX_RANK, chunk) == (int)d->rank)
        memcpy(out->chunk, chunk, sizeof chunk);
    if (is_long(d->type)) out->raw = lg_h5_long_type(d->type) == H5T_NATIVE_INT64 ? 'i' : 'u';
    if (out->kind == LG_H5_TABLE) out->members = (uint32_t)H5Tget_nmembers(d->type);
    memcpy(out->dims, d->dims, sizeof d->dims);
}

lg_status lg_h5_look(lg_h5 *h5, const char *name, size_t bytes, lg_h5_about *out, lg_error *error) {
    LG_QUIET;
    LG_DATASET(d);
    LG_TRY(open_set(h5, name, bytes, &d, error));
    describe(&d, out);
    return LG_OK;
}

/* Makes `type` of the data set the type of its member. */
static lg_status choose_member(lg_h5 *h5, const char *name, lg_dataset *d, const char *member, int index,
                               lg_error *error) {
    hid_t type = H5Tget_member_type(d->type, (unsigned)index);
    if (index < 0 || type < 0) return lg_dataset_error(h5, name, "has no such member", error);
    lg_id_close(&d->type);
    d->type = type;
    d->member = member;
    return LG_OK;
}

lg_status lg_h5_look_member(lg_h5 *h5, const char *name, uint32_t index, char *text, size_t size,
                            lg_h5_about *out, lg_error *error) {
    LG_QUIET;
    LG_DATASET(d);
    LG_TRY(open_set(h5, name, sizeof(double), &d, error));
    char *member = H5Tget_member_name(d.type, index);
    const bool fits = member != NULL && strlen(member) < size;
    if (fits) (void)snprintf(text, size, "%s", member);
    (void)H5free_memory(member);
    if (!fits) return lg_dataset_error(h5, name, "has a member with a name that is too long", error);
    LG_TRY(choose_member(h5, name, &d, NULL, (int)index, error));
    describe(&d, out);
    return LG_OK;
}

uint64_t lg_h5_block(const lg_h5_about *about, uint32_t axis) {
    const uint64_t all = about->dims[axis], row = about->count / all, megabyte = (1u << 20) / sizeof(double);
    const uint64_t chunk = about->chunk[axis];
    uint64_t rows = row < megabyte ? megabyte / row : 1;
    if (chunk > 0 && chunk <= 64 * megabyte / row) rows = (rows + chunk - 1) / chunk * chunk;
    return rows < all ? rows : all;
}

lg_status lg_slice_open(lg_h5 *h5, const lg_h5_slice *slice, size_t bytes, lg_dataset *d, hid_t *part,
                        lg_error *error) {
    hsize_t start[LG_MAX_RANK] = {0}, extent[LG_MAX_RANK] = {0};
    LG_TRY(open_set(h5, slice->name, bytes, d, error));
    if (slice->member != NULL)
        LG_TRY(choose_member(h5, slice->name, d, slice->member, H5Tget_member_index(d->type, slice->member),
                             error));
    *part = H5Dget_space(d->set);
    if (d->rank == 0) return LG_OK;
    memcpy(extent, d->dims, sizeof d->dims);
    start[slice->axis] = slice->first;
    extent[slice->axis] = slice->count;
    if (slice->axis < d->rank && slice->count <= d->dims[slice->axis] &&
        slice->first <= d->dims[slice->axis] - slice->count &&
        H5Sselect_hyperslab(*part, H5S_SELECT_SET, start, NULL, extent, NULL) >= 0)
        return LG_OK;
    return lg_dataset_error(h5, slice->name, "cannot be read", error);
}

lg_status lg_h5_get_slice(lg_h5 *h5, const lg_h5_slice *slice, lg_h5_long as, double *out, lg_error *error) {
    LG_QUIET;
    LG_DATASET(d);
    LG_ID part = H5I_INVALID_HID;
    LG_TRY(lg_slice_open(h5, slice, sizeof(float), &d, &part, error));
    if (d.count == 0) return LG_OK;
    const uint64_t row = d.rank == 0 ? 1 : d.count / d.dims[slice->axis];
    const hsize_t extent = row * slice->count;
    LG_ID room = H5Screate_simple(1, &extent, NULL);
    return read_doubles(h5, slice->name, &d, room, part, slice->first * row, extent, false, as, out, error);
}

/* True for integers that a double holds exactly; false for fractions, NaN and magnitudes above 2^53. */
bool lg_is_whole(double x) {
    return fabs(x) <= 0x1p53 && floor(x) == x;
}

lg_status lg_h5_get_wholes(lg_h5 *h5, const char *name, const lg_h5_about *about, int64_t *out,
                           lg_error *error) {
    if (about->kind == LG_H5_WHOLE) {
        LG_QUIET;
        LG_DATASET(d);
        LG_TRY(open_set(h5, name, sizeof(double), &d, error));
        return read_all(h5, name, &d, H5T_NATIVE_INT64, out, error);
    }
    LG_TRY_SCRATCH(double, values, h5->context, about->count, lg_h5_no_memory(h5, error));
    LG_TRY(lg_h5_get(h5, name, LG_ELEMENT_F64, about->rank, about->dims, values, error));
    for (uint64_t i = 0; i < about->count; i++) {
        if (!lg_is_whole(values[i]))
            return lg_fail(error, isfinite(values[i]) ? LG_FORMAT : LG_NOT_FINITE,
                           "%s: /%s: %.17g at index (%llu) is not a whole number", lg_shown_path(h5->path),
                           name, values[i], (unsigned long long)i);
        out[i] = (int64_t)values[i];
    }
    return LG_OK;
}

lg_status lg_h5_narrow(const lg_h5 *h5, const char *name, const int64_t *values, uint64_t count,
                       uint32_t most, uint32_t *out, lg_error *error) {
    for (uint64_t i = 0; i < count; i++) {
        if (values[i] < 0 || values[i] > most)
            return lg_h5_fail(h5, error, "/%s: is %lld at index (%llu), expected 0 to %u", name,
                              (long long)values[i], (unsigned long long)i, most);
        out[i] = (uint32_t)values[i];
    }
    return LG_OK;
}

/* ---- whole files ---- */

typedef struct sweep {
    lg_h5 *h5;
    lg_status status;
    lg_error *error;
} sweep;

static herr_t sweep_attribute(hid_t location, const char *name, const H5A_info_t *info, void *user) {
    unsigned char small[LG_H5_TEXT];
    LG_ID attribute_id = H5Aopen(location, name, H5P_DEFAULT), type = H5Aget_type(attribute_id);
    if (attribute_id < 0) return -1;
    /* Texts of variable length are not read here. */
    if (H5Tis_variable_str(type) <= 0 && H5Tget_class(type) != H5T_VLEN &&
        H5Aget_storage_size(attribute_id) <= sizeof small)
        (void)H5Aread(attribute_id, type, small);
    return 0;
}

/* Data sets of other types are skipped; data sets of numbers must be readable. */
static lg_status sweep_numbers(lg_h5 *h5, const char *name, lg_error *error) {
    LG_DATASET(d);
    if (open_numbers(h5, name, &d, NULL) != LG_OK) return LG_OK;
    LG_TRY_SCRATCH(double, data, h5->context, d.count, lg_h5_no_memory(h5, error));
    if (d.count == 0) return LG_OK;
    return read_part(h5, name, &d, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, true, data, error);
}

static herr_t sweep_object(hid_t root, const char *name, const H5O_info_t *info, void *user) {
    sweep *s = user;
    if (lg_h5_is_deep(name)) {
        s->status = lg_h5_fail(s->h5, s->error, "groups are nested too deep: move the data to the root");
        return 1;
    }
    LG_ID object = H5Oopen(root, name, s->h5->links);
    if (object < 0) return 0;
    (void)H5Aiterate2(object, H5_INDEX_NAME, H5_ITER_NATIVE, NULL, sweep_attribute, s);
    if (info->type == H5O_TYPE_DATASET) s->status = sweep_numbers(s->h5, name, s->error);
    return s->status == LG_OK ? 0 : 1;
}

lg_status lg_h5_read_all(lg_h5 *h5, lg_error *error) {
    LG_QUIET;
    sweep s = {h5, LG_OK, error};
    const herr_t visited = H5Ovisit(h5->file, H5_INDEX_NAME, H5_ITER_NATIVE, sweep_object, &s);
    if (s.status == LG_OK && visited < 0)
        return lg_h5_fail(h5, error, "is cut short or damaged: write it again");
    return s.status;
}
