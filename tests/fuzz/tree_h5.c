/* Converts trees to HDF5 files and back. */
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define H5_USE_110_API
#include <hdf5.h>

#include "fuzz.h"
#include "tree.h"

/* ---- types ---- */

static hid_t text_type(size_t bytes, H5T_str_t pad, H5T_cset_t set) {
    const hid_t type = H5Tcopy(H5T_C_S1);
    (void)H5Tset_size(type, bytes);
    (void)H5Tset_strpad(type, pad);
    (void)H5Tset_cset(type, set);
    return type;
}

static hid_t enumeration(hid_t base, const char *const *names, int count) {
    const hid_t type = H5Tenum_create(base);
    for (int i = 0; i < count; i++) {
        int value = i;
        (void)H5Tconvert(H5T_NATIVE_INT, base, 1, &value, NULL, H5P_DEFAULT);
        (void)H5Tenum_insert(type, names[i], &value);
    }
    return type;
}

static hid_t half(void) {
    const hid_t type = H5Tcopy(H5T_IEEE_F32LE);
    (void)H5Tset_fields(type, 15, 10, 5, 0, 10);
    (void)H5Tset_size(type, 2);
    (void)H5Tset_ebias(type, 15);
    return type;
}

/* An integer type with any precision and offset of its bits that HDF5 allows. */
static hid_t odd_whole(uint16_t size) {
    const hid_t type = H5Tcopy(H5T_STD_I64LE);
    (void)H5Tset_precision(type, 1 + (size & 63));
    (void)H5Tset_offset(type, (size >> 6) & 63);
    if ((size & 0x8000) != 0) (void)H5Tset_sign(type, H5T_SGN_NONE);
    return type;
}

static hid_t odd_real(uint16_t size) {
    const hid_t type = H5Tcopy(H5T_IEEE_F64LE);
    const size_t exponent = 1 + (size & 15), mantissa = 1 + ((size >> 4) & 63);
    (void)H5Tset_fields(type, exponent + mantissa, mantissa, exponent, 0, mantissa);
    (void)H5Tset_precision(type, exponent + mantissa + 1);
    if ((size & 0x8000) != 0) (void)H5Tset_norm(type, H5T_NORM_NONE);
    return type;
}

/* The caller closes the type. */
static hid_t type_of(const tree_record *r) {
    static const char *const truth[] = {"FALSE", "TRUE"};
    const size_t bytes = r->size == 0 ? 1 : r->size;
    const hsize_t two = 2;
    hid_t type;
    switch (r->type % TREE_TYPES) {
    case 0:
        return H5Tcopy(H5T_IEEE_F64LE);
    case 1:
        return H5Tcopy(H5T_IEEE_F64BE);
    case 2:
        return H5Tcopy(H5T_IEEE_F32LE);
    case 3:
        return H5Tcopy(H5T_IEEE_F32BE);
    case 4:
        return half();
    case 5:
        return H5Tcopy(H5T_STD_I8LE);
    case 6:
        return H5Tcopy(H5T_STD_U8LE);
    case 7:
        return H5Tcopy(H5T_STD_I16LE);
    case 8:
        return H5Tcopy(H5T_STD_U16BE);
    case 9:
        return H5Tcopy(H5T_STD_I32LE);
    case 10:
        return H5Tcopy(H5T_STD_U32LE);
    case 11:
        return H5Tcopy(H5T_STD_I64LE);
    case 12:
        return H5Tcopy(H5T_STD_U64LE);
    case 13:
        return H5Tcopy(H5T_STD_I64BE);
    case 14:
        return H5Tcopy(H5T_STD_U32BE);
    case TYPE_FIXED:
        return text_type(bytes, H5T_STR_NULLTERM, H5T_CSET_UTF8);
    case TYPE_BLANKS:
        return text_type(bytes, H5T_STR_SPACEPAD, H5T_CSET_ASCII);
    case TYPE_ZEROS:
        return text_type(bytes, H5T_STR_NULLPAD, H5T_CSET_UTF8);
    case TYPE_ANY_LENGTH:
        return text_type(H5T_VARIABLE, H5T_STR_NULLTERM, H5T_CSET_UTF8);
    case TYPE_BOOL:
        return enumeration(H5T_STD_I8LE, truth, 2);
    case TYPE_ENUM:
        return enumeration(H5T_STD_I32LE, truth, 2);
    case TYPE_COMPLEX:
        type = H5Tcreate(H5T_COMPOUND, 16);
        (void)H5Tinsert(type, "r", 0, H5T_IEEE_F64LE);
        (void)H5Tinsert(type, "i", 8, H5T_IEEE_F64LE);
        return type;
    case TYPE_OPAQUE:
        return H5Tcreate(H5T_OPAQUE, bytes);
    case TYPE_ARRAY:
        return H5Tarray_create2(H5T_IEEE_F64LE, 1, &two);
    case TYPE_ODD_WHOLE:
        return odd_whole(r->size);
    case TYPE_ODD_REAL:
        return odd_real(r->size);
    case TYPE_REFERENCE:
        return H5Tcopy(H5T_STD_REF_OBJ);
    case TYPE_BITS:
        return H5Tcopy(H5T_STD_B32LE);
    case TYPE_LONG_DOUBLE:
        return H5Tcopy(H5T_NATIVE_LDOUBLE);
    default:
        return H5Tvlen_create(H5T_IEEE_F64LE);
    }
}

static hid_t space_of(const tree_record *r, bool *endless) {
    hsize_t dims[TREE_RANK], most[TREE_RANK];
    if (r->rank == TREE_NO_SPACE) return H5Screate(H5S_NULL);
    if (r->rank == 0) return H5Screate(H5S_SCALAR);
    for (size_t i = 0; i < r->rank; i++) dims[i] = most[i] = r->dims[i];
    *endless = (r->kind & TREE_ENDLESS) != 0 && (r->kind & TREE_CHUNKED) != 0;
    if (*endless) most[0] = H5S_UNLIMITED;
    return H5Screate_simple(r->rank, dims, most);
}

/* ---- elements ---- */

/* Texts of variable length: the data are split at zeros, and are reused from the start if they are too
 * short. */
static void *texts_of(const tree_record *r, size_t count) {
    static char *pointers[TREE_BYTES / sizeof(char *)];
    static char words[65537];
    memcpy(words, r->data, r->length);
    words[r->length] = '\0';
    size_t at = 0;
    for (size_t i = 0; i < count; i++) {
        if (at >= r->length) at = 0;
        pointers[i] = words + at;
        at += strlen(words + at) + 1;
    }
    return pointers;
}

/* NULL: there is nothing to write. */
static const void *elements_of(const tree_record *r, hid_t type) {
    static union {
        uint8_t bytes[TREE_BYTES];
        hvl_t ragged[TREE_BYTES / sizeof(hvl_t)];
    } room;
    static double numbers[2];
    const size_t bytes = H5Tget_size(type), count = tree_count(r, bytes);
    if (count == 0 || count > TREE_BYTES) return NULL;
    if (r->type % TREE_TYPES == TYPE_ANY_LENGTH) return texts_of(r, count);
    if (r->type % TREE_TYPES == TYPE_RAGGED) {
        for (size_t i = 0; i < count; i++) room.ragged[i] = (hvl_t){i % 3, numbers};
        return room.ragged;
    }
    tree_fill(r, room.bytes, count * bytes);
    return room.bytes;
}

/* ---- records ---- */

static struct { hid_t access, creation, links, group, set; } lists;

static void make_lists(void) {
    if (lists.access > 0) return;
    (void)H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    /* no limit: the large tables of an open file are kept for reuse */
    (void)H5set_free_list_limits(-1, -1, -1, -1, -1, -1);
    lists.access = H5Pcreate(H5P_FILE_ACCESS);
    /* in memory; written to disk once, on closing */
    (void)H5Pset_fapl_core(lists.access, (size_t)1 << 13, true);
    (void)H5Pset_libver_bounds(lists.access, H5F_LIBVER_V18, H5F_LIBVER_V18);
    lists.creation = H5Pcreate(H5P_FILE_CREATE);
    lists.group = H5Pcreate(H5P_GROUP_CREATE);
    lists.set = H5Pcreate(H5P_DATASET_CREATE);
    lists.links = H5Pcreate(H5P_LINK_CREATE);
    (void)H5Pset_create_intermediate_group(lists.links, 1);
    /* Stores attributes and links in the object itself, which is the fastest layout. */
    (void)H5Pset_attr_phase_change(lists.creation, 255, 0);
    (void)H5Pset_attr_phase_change(lists.group, 255, 0);
    (void)H5Pset_link_phase_change(lists.group, 255, 0);
    (void)H5Pset_link_phase_change(lists.creation, 255, 0);
    (void)H5Pset_obj_track_times(lists.set, false);
}

static hid_t layout_of(const tree_record *r) {
    const hid_t list = H5Pcopy(lists.set);
    if ((r->kind & TREE_COMPACT) != 0) (void)H5Pset_layout(list, H5D_COMPACT);
    if ((r->kind & TREE_CHUNKED) != 0 && r->rank > 0 && r->rank != TREE_NO_SPACE) {
        hsize_t chunk[TREE_RANK];
        for (size_t i = 0; i < r->rank; i++)
            chunk[i] = r->dims[i] == 0 ? 1 : r->dims[i] > 16 ? 16 : r->dims[i];
        (void)H5Pset_chunk(list, r->rank, chunk);
        if ((r->kind & TREE_PACKED) != 0) (void)H5Pset_deflate(list, 1);
    }
    return list;
}

static void make_set(hid_t file, const char *name, const tree_record *r, hid_t type, hid_t space) {
    const bool plain = (r->kind & (TREE_COMPACT | TREE_CHUNKED)) == 0;
    const hid_t list = plain ? lists.set : layout_of(r);
    const hid_t set = H5Dcreate2(file, name, type, space, lists.links, list, H5P_DEFAULT);
    const void *elements = set >= 0 ? elements_of(r, type) : NULL;
    if (elements != NULL) (void)H5Dwrite(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, elements);
    if (set >= 0) (void)H5Dclose(set);
    if (!plain) (void)H5Pclose(list);
}

/* Opens the object of an attribute; makes a group if there is none. The object stays open until another one
 * is needed, because attributes of an object follow each other. */
static hid_t open_object(hid_t file, const char *name) {
    static char last[256];
    static hid_t object = H5I_INVALID_HID, of = H5I_INVALID_HID;
    if (name == NULL || of != file || strcmp(last, name) != 0) {
        if (object >= 0) (void)H5Oclose(object);
        object = H5I_INVALID_HID;
        of = H5I_INVALID_HID;
        if (name == NULL) return object;
        object = H5Oopen(file, *name == '\0' ? "/" : name, H5P_DEFAULT);
        if (object < 0) object = H5Gcreate2(file, name, lists.links, lists.group, H5P_DEFAULT);
        if (object < 0) return object;
        of = file;
        (void)snprintf(last, sizeof last, "%s", name);
    }
    return object;
}

static void make_attribute(hid_t file, char *name, const tree_record *r, hid_t type, hid_t space) {
    char *at = strrchr(name, '@');
    if (at != NULL) *at = '\0';
    const hid_t object = open_object(file, at != NULL ? name : "");
    if (object < 0 || tree_count(r, H5Tget_size(type)) > TREE_BYTES)
        return; /* HDF5 itself would allocate this memory */
    const hid_t attribute =
        H5Acreate2(object, at != NULL ? at + 1 : name, type, space, H5P_DEFAULT, H5P_DEFAULT);
    const void *elements = attribute >= 0 ? elements_of(r, type) : NULL;
    if (elements != NULL) (void)H5Awrite(attribute, type, elements);
    if (attribute >= 0) (void)H5Aclose(attribute);
}

static void make_link(hid_t file, const char *name, const tree_record *r) {
    char target[256];
    const size_t length = r->length < sizeof target ? r->length : sizeof target - 1;
    memcpy(target, r->data, length);
    target[length] = '\0';
    switch (r->kind & TREE_KIND) {
    case TREE_SOFT:
        (void)H5Lcreate_soft(target, file, name, lists.links, H5P_DEFAULT);
        break;
    case TREE_HARD:
        (void)H5Lcreate_hard(file, target, file, name, lists.links, H5P_DEFAULT);
        break;
    case TREE_EXTERNAL:
        (void)H5Lcreate_external("elsewhere.h5", target, file, name, lists.links, H5P_DEFAULT);
        break;
    default: {
        const hid_t group = H5Gcreate2(file, name, lists.links, lists.group, H5P_DEFAULT);
        if (group >= 0) (void)H5Gclose(group);
    }
    }
}

static void make_record(hid_t file, const tree_record *r) {
    char name[256];
    const unsigned kind = r->kind & TREE_KIND;
    memcpy(name, r->name, r->name_length);
    name[r->name_length] = '\0';
    if (kind != TREE_DATA && kind != TREE_ATTRIBUTE && kind < TREE_KINDS) {
        make_link(file, name, r);
        return;
    }
    bool endless = false;
    const hid_t type = type_of(r), space = space_of(r, &endless);
    if (type >= 0 && space >= 0 && kind == TREE_ATTRIBUTE) make_attribute(file, name, r, type, space);
    if (type >= 0 && space >= 0 && kind != TREE_ATTRIBUTE) make_set(file, name, r, type, space);
    if (space >= 0) (void)H5Sclose(space);
    if (type >= 0) (void)H5Tclose(type);
}

static bool make_file(const uint8_t *bytes, size_t size, const char *path) {
    static tree_record records[TREE_RECORDS];
    make_lists();
    const hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, lists.creation, lists.access);
    if (file < 0) return false;
    const size_t count = tree_read(bytes, size, records);
    for (size_t i = 0; i < count; i++) make_record(file, &records[i]);
    (void)open_object(file, NULL);
    return H5Fclose(file) >= 0;
}

const char *tree_file(const uint8_t *bytes, size_t size) {
    const char *path = fuzz_file("", 0);
    if (make_file(bytes, size, path)) return path;
    (void)fprintf(stderr, "fuzz: HDF5 makes no file\n");
    exit(1);
}

int tree_unpack(const uint8_t *bytes, size_t size, const char *path) {
    if (make_file(bytes, size, path)) return 0;
    (void)fprintf(stderr, "%s: cannot be written\n", path);
    return 1;
}

/* Replaces H5Fopen by the linker: the whole file is read at once, not object by object. */
hid_t __real_H5Fopen(const char *name, unsigned flags, hid_t access);
hid_t __wrap_H5Fopen(const char *name, unsigned flags, hid_t access);
hid_t __wrap_H5Fopen(const char *name, unsigned flags, hid_t access) {
    const hid_t list = access == H5P_DEFAULT ? H5Pcreate(H5P_FILE_ACCESS) : H5Pcopy(access);
    (void)H5Pset_fapl_core(list, (size_t)1 << 13, false);
    const hid_t file = __real_H5Fopen(name, flags, list);
    (void)H5Pclose(list);
    return file;
}

/* ---- HDF5 files to trees ---- */

typedef struct packing {
    uint8_t *out;
    size_t size, most;
    int failed;
} packing;

static void add(packing *to, const tree_record *r) {
    const size_t written = tree_write(r, 1, to->out + to->size, to->most - to->size);
    if (written == 0) {
        (void)fprintf(stderr, "%.*s: too large for the tree\n", (int)r->name_length, (const char *)r->name);
        to->failed = 1;
    }
    to->size += written;
}

/* Index of the type in the table; TREE_TYPES if it has none. */
static unsigned find_type(hid_t type, uint16_t *size) {
    const bool text = H5Tget_class(type) == H5T_STRING, any = text && H5Tis_variable_str(type) > 0;
    *size = text && !any ? (uint16_t)H5Tget_size(type) : 0;
    if (any) return TYPE_ANY_LENGTH;
    if (text)
        return H5Tget_strpad(type) == H5T_STR_SPACEPAD  ? TYPE_BLANKS
               : H5Tget_strpad(type) == H5T_STR_NULLPAD ? TYPE_ZEROS
                                                        : TYPE_FIXED;
    for (unsigned i = 0; i < TREE_TYPES; i++) {
        const tree_record like = {.type = (uint8_t)i};
        const hid_t candidate = type_of(&like);
        const bool same = H5Tequal(candidate, type) > 0;
        (void)H5Tclose(candidate);
        if (same) return i;
    }
    return TREE_TYPES;
}

/* Reads the elements of a data set or attribute. Returns 0 bytes if they do not fit. */
static size_t read_elements(hid_t id, bool attribute, hid_t type, hid_t space, unsigned kind, uint8_t *out) {
    const hssize_t points = H5Sget_simple_extent_npoints(space);
    const size_t count = points > 0 ? (size_t)points : 0, bytes = count * H5Tget_size(type);
    static union {
        uint8_t bytes[TREE_BYTES];
        char *text[TREE_BYTES / sizeof(char *)];
    } room;
    if (bytes == 0 || bytes > sizeof room) return 0;
    if ((attribute ? H5Aread(id, type, room.bytes)
                   : H5Dread(id, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, room.bytes)) < 0)
        return 0;
    if (kind != TYPE_ANY_LENGTH) {
        memcpy(out, room.bytes, bytes);
        return bytes;
    }
    size_t used = 0;
    for (size_t i = 0; i < count; i++) {
        const size_t length = room.text[i] == NULL ? 0 : strlen(room.text[i]);
        if (used + length + 1 > TREE_BYTES) break;
        if (length > 0) memcpy(out + used, room.text[i], length);
        used += length;
        out[used++] = '\0';
    }
    (void)H5Dvlen_reclaim(type, space, H5P_DEFAULT, room.bytes);
    return used;
}

static void pack_elements(packing *to, const char *name, hid_t id, bool attribute) {
    static uint8_t data[TREE_BYTES];
    tree_record r = {.kind = attribute ? TREE_ATTRIBUTE : TREE_DATA,
                     .name = (const uint8_t *)name,
                     .name_length = (uint8_t)strlen(name),
                     .data = data};
    const hid_t type = attribute ? H5Aget_type(id) : H5Dget_type(id);
    const hid_t space = attribute ? H5Aget_space(id) : H5Dget_space(id);
    const unsigned found = find_type(type, &r.size);
    hsize_t dims[H5S_MAX_RANK] = {0};
    const int rank = H5Sget_simple_extent_type(space) == H5S_NULL
                         ? TREE_NO_SPACE
                         : H5Sget_simple_extent_dims(space, dims, NULL);
    if (found == TREE_TYPES || (rank > TREE_RANK && rank != TREE_NO_SPACE)) {
        (void)fprintf(stderr, "%s: of a type that trees have not\n", name);
        to->failed = 1;
    } else {
        r.type = (uint8_t)found;
        r.rank = (uint8_t)rank;
        for (int i = 0; rank != TREE_NO_SPACE && i < rank; i++) r.dims[i] = (uint32_t)dims[i];
        r.length = (uint16_t)read_elements(id, attribute, type, space, found, data);
        add(to, &r);
    }
    (void)H5Sclose(space);
    (void)H5Tclose(type);
}

static herr_t pack_attribute(hid_t object, const char *name, const H5A_info_t *info, void *user) {
    (void)info;
    char full[512], path[256];
    if (H5Iget_name(object, path, sizeof path) < 0) path[0] = '\0';
    (void)snprintf(full, sizeof full, "%s@%s", path + (path[0] == '/'), name);
    full[255] = '\0';
    const hid_t attribute = H5Aopen(object, name, H5P_DEFAULT);
    pack_elements(user, full, attribute, true);
    return H5Aclose(attribute);
}

static herr_t pack_object(hid_t root, const char *name, const H5O_info_t *info, void *user) {
    const hid_t object = H5Oopen(root, name, H5P_DEFAULT);
    if (info->type == H5O_TYPE_DATASET) pack_elements(user, name, object, false);
    hsize_t at = 0;
    (void)H5Aiterate2(object, H5_INDEX_NAME, H5_ITER_NATIVE, &at, pack_attribute, user);
    return H5Oclose(object);
}

int tree_pack(const char *path, uint8_t *out, size_t most, size_t *size) {
    packing to = {.out = out, .most = most};
    make_lists();
    const hid_t file = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT);
    if (file < 0) {
        (void)fprintf(stderr, "%s: is no HDF5 file\n", path);
        return 1;
    }
    (void)H5Ovisit2(file, H5_INDEX_NAME, H5_ITER_NATIVE, pack_object, &to, H5O_INFO_BASIC);
    (void)H5Fclose(file);
    *size = to.size;
    return to.failed;
}
