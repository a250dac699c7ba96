/* Replaces HDF5 for the fuzzer: the HDF5 functions that the readers call, working on a tree in memory. HDF5
 * takes milliseconds for a small file; this takes microseconds, so readers are tested far more often. The
 * replay of the corpora and fuzzer_hdf5 use HDF5 itself.
 *
 * What a tree declares (links, shapes, types, missing data) appears as HDF5 would present it. All handles
 * that the library opens are counted. Closing a file before its other handles stops the fuzzer. */
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define H5_USE_110_API
#include <hdf5.h>

#include "fuzz.h"
#include "tree.h"

/* ---- objects of a file ---- */

enum { MOST_NODES = 2048, MOST_NAME = 256, SLOTS = 8192 };
typedef enum node_kind { NODE_GROUP, NODE_DATA, NODE_SOFT, NODE_EXTERNAL, NODE_ATTRIBUTE } node_kind;
typedef struct node {
    node_kind kind;
    char name[MOST_NAME]; /* "a/b"; for an attribute "3@name", where 3 is the number of its object */
    const tree_record *record;
    int same; /* for a hard link the number of the object that it links to, otherwise its own number */
} node;

static node nodes[MOST_NODES];
static int node_count, slots[SLOTS], used[MOST_NODES];
static tree_record records[TREE_RECORDS];

static unsigned slot_of(const char *name) {
    uint32_t hash = 2166136261u;
    for (; *name != '\0'; name++) hash = (hash ^ (unsigned char)*name) * 16777619u;
    unsigned at = hash % SLOTS;
    return at;
}

/* Index of the object; -1 if there is none. */
static int find(const char *name) {
    for (unsigned at = slot_of(name); slots[at] != 0; at = (at + 1) % SLOTS)
        if (strcmp(nodes[slots[at] - 1].name, name) == 0) return slots[at] - 1;
    return -1;
}

static int add(node_kind kind, const char *name, const tree_record *record) {
    if (node_count == MOST_NODES || find(name) >= 0) return -1;
    unsigned at = slot_of(name);
    while (slots[at] != 0) at = (at + 1) % SLOTS;
    used[node_count] = (int)at;
    slots[at] = node_count + 1;
    nodes[node_count] = (node){.kind = kind, .record = record, .same = node_count};
    (void)snprintf(nodes[node_count].name, MOST_NAME, "%s", name);
    return node_count++;
}

static void clear(void) {
    for (int i = 0; i < node_count; i++) slots[used[i]] = 0;
    node_count = 0;
    (void)add(NODE_GROUP, "", NULL);
}

/* Converts "/a//./b" to "a/b". */
static void plain_name(const char *from, char out[MOST_NAME]) {
    size_t length = 0;
    while (*from != '\0') {
        const size_t part = strcspn(from, "/");
        if (part > 0 && !(part == 1 && *from == '.') && length + part + 1 < MOST_NAME) {
            if (length > 0) out[length++] = '/';
            memcpy(out + length, from, part);
            length += part;
        }
        from += part + (from[part] == '/');
    }
    out[length] = '\0';
}

/* The object at a path, following links; -1 if there is none. */
static int resolve_within(const char *path, int depth) {
    char name[MOST_NAME], parent[MOST_NAME];
    plain_name(path, name);
    int at = find(name);
    if (at < 0 && depth < 8) { /* below a link to a group? */
        for (char *slash = strrchr(name, '/'); slash != NULL && at < 0; slash = NULL) {
            (void)snprintf(parent, sizeof parent, "%.*s", (int)(slash - name), name);
            const int of = resolve_within(parent, depth + 1);
            char there[2 * MOST_NAME];
            if (of < 0 || nodes[of].kind != NODE_GROUP) return -1;
            (void)snprintf(there, sizeof there, "%s/%s", nodes[of].name, slash + 1);
            if (strlen(there) >= MOST_NAME || strcmp(there, name) == 0) return -1;
            plain_name(there, name);
            at = find(name);
        }
    }
    if (at < 0 || depth >= 8 || nodes[at].kind == NODE_ATTRIBUTE) return -1;
    if (nodes[at].kind == NODE_EXTERNAL) return -1;
    if (nodes[at].kind != NODE_SOFT) return nodes[at].same;
    char target[MOST_NAME];
    const tree_record *r = nodes[at].record;
    (void)snprintf(target, sizeof target, "%.*s", (int)r->length, (const char *)r->data);
    return resolve_within(target, depth + 1);
}

static int resolve(const char *path) {
    return resolve_within(path, 0);
}

/* Adds the groups on the way to `name`. Returns false if another object is in the way. */
static bool make_way(const char *name) {
    char part[MOST_NAME];
    for (const char *slash = strchr(name, '/'); slash != NULL; slash = strchr(slash + 1, '/')) {
        (void)snprintf(part, sizeof part, "%.*s", (int)(slash - name), name);
        const int at = find(part);
        if (at < 0 && add(NODE_GROUP, part, NULL) < 0) return false;
        if (at >= 0 && nodes[at].kind != NODE_GROUP) return false;
    }
    return true;
}

static size_t bytes_of(const tree_record *r) {
    const unsigned type = r->type % TREE_TYPES;
    if (type == TYPE_ANY_LENGTH) return sizeof(char *);
    if (type == TYPE_RAGGED) return sizeof(hvl_t);
    const size_t bytes = tree_types[type].bytes;
    return bytes > 0 ? bytes : r->size > 0 ? r->size : 1;
}

static void make_attribute(char *name, const tree_record *r) {
    char key[2 * MOST_NAME], plain[MOST_NAME], *at = strrchr(name, '@');
    if (at != NULL) *at = '\0';
    plain_name(at != NULL ? name : "", plain);
    int object = resolve(plain);
    if (object < 0 && make_way(plain)) object = add(NODE_GROUP, plain, NULL);
    if (object < 0 || tree_count(r, bytes_of(r)) > TREE_BYTES) return;
    (void)snprintf(key, sizeof key, "%d@%s", object, at != NULL ? at + 1 : name);
    key[MOST_NAME - 1] = '\0';
    (void)add(NODE_ATTRIBUTE, key, r);
}

static void make_record(const tree_record *r) {
    static const node_kind kinds[] = {[TREE_DATA] = NODE_DATA,
                                      [TREE_GROUP] = NODE_GROUP,
                                      [TREE_SOFT] = NODE_SOFT,
                                      [TREE_EXTERNAL] = NODE_EXTERNAL};
    char name[MOST_NAME], plain[MOST_NAME], target[MOST_NAME];
    unsigned kind = r->kind & TREE_KIND;
    if (kind >= TREE_KINDS) kind = TREE_DATA;
    memcpy(name, r->name, r->name_length);
    name[r->name_length] = '\0';
    if (kind == TREE_ATTRIBUTE) {
        make_attribute(name, r);
        return;
    }
    plain_name(name, plain);
    if (plain[0] == '\0' || !make_way(plain)) return;
    if (kind != TREE_HARD) {
        (void)add(kinds[kind], plain, r);
        return;
    }
    (void)snprintf(target, sizeof target, "%.*s", (int)r->length, (const char *)r->data);
    const int object = resolve(target);
    const int made = object < 0 ? -1 : add(nodes[object].kind, plain, nodes[object].record);
    if (made >= 0) nodes[made].same = object;
}

/* The file on disk has only the signature, for code that checks whether a file is HDF5. */
const char *tree_file(const uint8_t *bytes, size_t size) {
    static const char sign[] = "\x89HDF\r\n\x1a\n";
    static char file[1 << 16];
    const size_t head = sizeof sign - 1, tail = size < sizeof file - head ? size : sizeof file - head;
    const size_t count = tree_read(bytes, size, records);
    clear();
    for (size_t i = 0; i < count; i++) make_record(&records[i]);
    memcpy(file, sign, head);
    if (tail > 0) memcpy(file + head, bytes, tail);
    return fuzz_file(file, head + tail);
}

/* ---- handles ---- */

typedef enum handle_kind { FREE, A_FILE, A_LIST, AN_OBJECT, AN_ATTRIBUTE, A_TYPE, A_SPACE } handle_kind;
typedef struct handle {
    handle_kind kind;
    const tree_record *record;
    int node;
    bool checked; /* a property list for reading: numbers out of range are errors */
    /* for types made by H5Tcopy and H5Tcreate: the type of HDF5 that was copied, or 0, and the part of a
     * complex number that is read: 1 "r", 2 "i", or 0 if the type has no members */
    hid_t native;
    int member;
    size_t size; /* bytes of a text in memory, which is terminated; 0: as in the file */
    /* for data spaces */
    unsigned rank;
    bool none, selected;
    hsize_t dims[TREE_RANK], start[TREE_RANK], count[TREE_RANK];
} handle;
enum { HANDLES = 64 };
static handle handles[HANDLES];
static const hid_t mark = (hid_t)1 << 40; /* differs from all handles of HDF5 */

/* A function of HDF5 that gets an invalid handle does nothing and fails. */
#define NEEDS(pointer)                                                                                       \
    if ((pointer) == NULL) return -1

static hid_t open_handle(handle_kind kind, const tree_record *record, int at) {
    for (int i = 0; i < HANDLES; i++) {
        if (handles[i].kind != FREE) continue;
        handles[i] = (handle){.kind = kind, .record = record, .node = at};
        return mark | i;
    }
    abort(); /* some handles are never closed */
}

static handle *get(hid_t id, handle_kind kind) {
    if ((id & ~(hid_t)(HANDLES - 1)) != mark) return NULL;
    handle *h = &handles[id & (HANDLES - 1)];
    return h->kind == kind ? h : NULL;
}

/* The record behind a handle; NULL if the handle is invalid. */
static const tree_record *record_of(hid_t id, handle_kind kind) {
    const handle *h = get(id, kind);
    return h == NULL ? NULL : h->record;
}

static herr_t close_handle(hid_t id, handle_kind kind) {
    handle *h = get(id, kind);
    if (id == H5I_INVALID_HID) return -1;
    if (h == NULL) abort(); /* closed twice, or of another kind */
    h->kind = FREE;
    return 0;
}

int H5Idec_ref(hid_t id) {
    const handle *h = &handles[id & (HANDLES - 1)];
    if (h->kind == FREE) abort(); /* closed twice */
    return close_handle(id, h->kind);
}

herr_t H5Eclear2(hid_t stack) {
    (void)stack;
    return 0;
}
herr_t H5Eget_auto2(hid_t stack, H5E_auto2_t *function, void **user) {
    (void)stack;
    *function = NULL;
    *user = NULL;
    return 0;
}
herr_t H5Eset_auto2(hid_t stack, H5E_auto2_t function, void *user) {
    (void)stack, (void)function, (void)user;
    return 0;
}

hid_t H5Fopen(const char *name, unsigned flags, hid_t access) {
    (void)name, (void)flags, (void)access;
    return open_handle(A_FILE, NULL, 0);
}
herr_t H5Fclose(hid_t file) {
    int open = 0;
    for (int i = 0; i < HANDLES; i++) open += handles[i].kind > A_LIST;
    if (open > 0) abort(); /* something was left open */
    return close_handle(file, A_FILE);
}
hid_t H5Pcreate(hid_t class) {
    (void)class;
    return open_handle(A_LIST, NULL, 0);
}
herr_t H5Pclose(hid_t list) {
    return close_handle(list, A_LIST);
}
herr_t H5Pset_elink_cb(hid_t list, H5L_elink_traverse_t call, void *user) {
    (void)list, (void)call, (void)user;
    return 0;
}
herr_t H5Pset_fapl_core(hid_t list, size_t increment, hbool_t backing) {
    (void)list, (void)increment, (void)backing;
    return 0;
}
herr_t H5Pset_file_locking(hid_t list, hbool_t use, hbool_t ignore) {
    (void)list, (void)use, (void)ignore;
    return 0;
}
herr_t H5Pset_type_conv_cb(hid_t list, H5T_conv_except_func_t call, void *user) {
    handle *h = get(list, A_LIST);
    (void)call, (void)user;
    NEEDS(h);
    h->checked = true;
    return 0;
}

/* ---- objects and links ---- */

htri_t H5Lexists(hid_t file, const char *name, hid_t list) {
    char plain[MOST_NAME];
    (void)file, (void)list;
    plain_name(name, plain);
    const int at = find(plain);
    return (at >= 0 && nodes[at].kind != NODE_ATTRIBUTE) || resolve(plain) >= 0;
}
htri_t H5Oexists_by_name(hid_t file, const char *name, hid_t list) {
    (void)file, (void)list;
    return resolve(name) >= 0;
}
hid_t H5Oopen(hid_t file, const char *name, hid_t list) {
    (void)file, (void)list;
    const int at = resolve(name);
    return at < 0 ? H5I_INVALID_HID : open_handle(AN_OBJECT, nodes[at].record, at);
}
herr_t H5Oclose(hid_t object) {
    return close_handle(object, AN_OBJECT);
}
herr_t H5Dclose(hid_t set) {
    return close_handle(set, AN_OBJECT);
}
H5I_type_t H5Iget_type(hid_t id) {
    const handle *h = get(id, AN_OBJECT);
    return h == NULL ? H5I_BADID : nodes[h->node].kind == NODE_DATA ? H5I_DATASET : H5I_GROUP;
}

/* Order of the root's members: by name. */
static int compare_names(const void *a, const void *b) {
    return strcmp(*(const char *const *)a, *(const char *const *)b);
}
herr_t H5Literate(hid_t group, H5_index_t by, H5_iter_order_t order, hsize_t *at, H5L_iterate_t visit,
                  void *user) {
    static const char *names[MOST_NODES];
    static char copies[MOST_NODES][MOST_NAME];
    int count = 0;
    (void)by, (void)order, (void)at;
    for (int i = 1; i < node_count; i++)
        if (nodes[i].kind != NODE_ATTRIBUTE && strchr(nodes[i].name, '/') == NULL) {
            memcpy(copies[count], nodes[i].name, MOST_NAME);
            names[count] = copies[count];
            count++;
        }
    qsort(names, (size_t)count, sizeof names[0], compare_names);
    for (int i = 0; i < count; i++) {
        const node *n = &nodes[find(names[i])];
        const H5L_info_t info = {.type = n->kind == NODE_SOFT       ? H5L_TYPE_SOFT
                                         : n->kind == NODE_EXTERNAL ? H5L_TYPE_EXTERNAL
                                                                    : H5L_TYPE_HARD};
        const herr_t result = visit(group, names[i], &info, user);
        if (result != 0) return result;
    }
    return 0;
}

/* ---- layouts of data sets ---- */

hid_t H5Dget_create_plist(hid_t set) {
    const tree_record *r = record_of(set, AN_OBJECT);
    NEEDS(r);
    return open_handle(A_LIST, r, 0);
}
static bool is_chunked(const tree_record *r) {
    return (r->kind & TREE_CHUNKED) != 0 && r->rank > 0 && r->rank != TREE_NO_SPACE;
}
H5D_layout_t H5Pget_layout(hid_t list) {
    const tree_record *r = record_of(list, A_LIST);
    NEEDS(r);
    return is_chunked(r) ? H5D_CHUNKED : (r->kind & TREE_COMPACT) != 0 ? H5D_COMPACT : H5D_CONTIGUOUS;
}
int H5Pget_external_count(hid_t list) {
    (void)list;
    return 0;
}
int H5Pget_chunk(hid_t list, int most, hsize_t *out) {
    const tree_record *r = record_of(list, A_LIST);
    NEEDS(r);
    for (int i = 0; i < most && i < r->rank; i++)
        out[i] = r->dims[i] == 0 ? 1 : r->dims[i] > 16 ? 16 : r->dims[i];
    return r->rank;
}
int H5Pget_nfilters(hid_t list) {
    const tree_record *r = record_of(list, A_LIST);
    NEEDS(r);
    return is_chunked(r) && (r->kind & TREE_PACKED) != 0;
}
H5Z_filter_t H5Pget_filter2(hid_t list, unsigned at, unsigned *flags, size_t *values, unsigned *value,
                            size_t size, char *name, unsigned *config) {
    (void)list, (void)at, (void)value;
    *flags = *config = 0;
    *values = 0;
    if (size > 0) name[0] = '\0';
    return H5Z_FILTER_DEFLATE;
}
htri_t H5Zfilter_avail(H5Z_filter_t filter) {
    return filter == H5Z_FILTER_DEFLATE;
}

/* ---- data spaces ---- */

static hid_t space_of(const tree_record *r) {
    NEEDS(r);
    const hid_t id = open_handle(A_SPACE, r, 0);
    handle *h = get(id, A_SPACE);
    h->none = r->rank == TREE_NO_SPACE;
    h->rank = h->none ? 0 : r->rank;
    for (unsigned i = 0; i < h->rank; i++) h->dims[i] = h->count[i] = r->dims[i];
    return id;
}
hid_t H5Dget_space(hid_t set) {
    return space_of(record_of(set, AN_OBJECT));
}
hid_t H5Aget_space(hid_t attribute) {
    return space_of(record_of(attribute, AN_ATTRIBUTE));
}
hid_t H5Screate_simple(int rank, const hsize_t *dims, const hsize_t *most) {
    (void)most;
    const hid_t id = open_handle(A_SPACE, NULL, 0);
    handle *h = get(id, A_SPACE);
    h->rank = (unsigned)rank;
    for (int i = 0; i < rank; i++) h->dims[i] = h->count[i] = dims[i];
    return id;
}
herr_t H5Sclose(hid_t space) {
    return close_handle(space, A_SPACE);
}
H5S_class_t H5Sget_simple_extent_type(hid_t space) {
    const handle *h = get(space, A_SPACE);
    if (h == NULL) return H5S_NO_CLASS;
    return h->none ? H5S_NULL : h->rank == 0 ? H5S_SCALAR : H5S_SIMPLE;
}
int H5Sget_simple_extent_ndims(hid_t space) {
    const handle *h = get(space, A_SPACE);
    NEEDS(h);
    return (int)h->rank;
}
int H5Sget_simple_extent_dims(hid_t space, hsize_t *dims, hsize_t *most) {
    const handle *h = get(space, A_SPACE);
    (void)most;
    NEEDS(h);
    for (unsigned i = 0; i < h->rank; i++) dims[i] = h->dims[i];
    return (int)h->rank;
}
static hsize_t points(const handle *h) {
    hsize_t count = h->none ? 0 : 1;
    for (unsigned i = 0; i < h->rank; i++) count *= h->count[i];
    return count;
}
hssize_t H5Sget_simple_extent_npoints(hid_t space) {
    const handle *h = get(space, A_SPACE);
    NEEDS(h);
    return (hssize_t)points(h);
}
herr_t H5Sselect_hyperslab(hid_t space, H5S_seloper_t operation, const hsize_t *start, const hsize_t *stride,
                           const hsize_t *count, const hsize_t *block) {
    handle *h = get(space, A_SPACE);
    (void)operation, (void)stride, (void)block;
    NEEDS(h);
    for (unsigned i = 0; i < h->rank; i++) {
        if (start[i] + count[i] > h->dims[i]) return -1;
        h->start[i] = start[i];
        h->count[i] = count[i];
    }
    return 0;
}

/* ---- types ---- */

hid_t H5Dget_type(hid_t set) {
    const tree_record *r = record_of(set, AN_OBJECT);
    NEEDS(r);
    return open_handle(A_TYPE, r, 0);
}
hid_t H5Aget_type(hid_t attribute) {
    const tree_record *r = record_of(attribute, AN_ATTRIBUTE);
    NEEDS(r);
    return open_handle(A_TYPE, r, 0);
}
herr_t H5Tclose(hid_t type) {
    return close_handle(type, A_TYPE);
}
static const tree_record *type_record(hid_t type) {
    static tree_record memory_records[6];
    const struct {
        hid_t type;
        const char *name; /* of tree_types */
    } memory[] = {{H5T_NATIVE_DOUBLE, "f8"}, {H5T_NATIVE_FLOAT, "f4"},  {H5T_NATIVE_INT64, "i8"},
                  {H5T_NATIVE_UINT64, "u8"}, {H5T_NATIVE_UINT32, "u4"}, {H5T_NATIVE_UINT8, "u1"}};
    for (size_t i = 0; i < sizeof memory / sizeof memory[0]; i++) {
        tree_record *r = &memory_records[i];
        if (type != memory[i].type) continue;
        while (strcmp(tree_types[r->type].name, memory[i].name) != 0) r->type++;
        return r;
    }
    return record_of(type, A_TYPE);
}
hid_t H5Tcopy(hid_t type) {
    const tree_record *r = type_record(type);
    NEEDS(r);
    const hid_t copy = open_handle(A_TYPE, r, 0);
    const handle *from = get(type, A_TYPE);
    get(copy, A_TYPE)->native = from == NULL ? type : from->native;
    return copy;
}

/* A complex number is a record of two numbers. */
static const char *const parts[] = {"r", "i"};
static bool is_complex(hid_t type) {
    const tree_record *r = record_of(type, A_TYPE);
    return r != NULL && r->type % TREE_TYPES == TYPE_COMPLEX;
}
int H5Tget_nmembers(hid_t type) {
    return is_complex(type) ? 2 : -1;
}
int H5Tget_member_index(hid_t type, const char *name) {
    for (int i = 0; i < 2 && is_complex(type); i++)
        if (strcmp(name, parts[i]) == 0) return i;
    return -1;
}
char *H5Tget_member_name(hid_t type, unsigned index) {
    return is_complex(type) && index < 2 ? strdup(parts[index]) : NULL;
}
hid_t H5Tget_member_type(hid_t type, unsigned index) {
    return is_complex(type) && index < 2 ? open_handle(A_TYPE, type_record(H5T_NATIVE_DOUBLE), 0)
                                         : H5I_INVALID_HID;
}
hid_t H5Tcreate(H5T_class_t class, size_t size) {
    (void)size;
    return class == H5T_COMPOUND ? open_handle(A_TYPE, NULL, 0) : H5I_INVALID_HID;
}
herr_t H5Tinsert(hid_t record, const char *name, size_t offset, hid_t type) {
    handle *h = get(record, A_TYPE);
    (void)offset;
    NEEDS(h);
    h->record = type_record(type);
    h->native = type;
    h->member = strcmp(name, parts[0]) == 0 ? 1 : 2;
    return 0;
}
H5T_class_t H5Tget_class(hid_t type) {
    if (type_record(type) == NULL) return H5T_NO_CLASS;
    const unsigned t = type_record(type)->type % TREE_TYPES;
    switch (t) {
    case TYPE_BOOL:
    case TYPE_ENUM:
        return H5T_ENUM;
    case TYPE_COMPLEX:
        return H5T_COMPOUND;
    case TYPE_OPAQUE:
        return H5T_OPAQUE;
    case TYPE_ARRAY:
        return H5T_ARRAY;
    case TYPE_ODD_WHOLE:
        return H5T_INTEGER;
    case TYPE_ODD_REAL:
        return H5T_FLOAT;
    case TYPE_REFERENCE:
        return H5T_REFERENCE;
    case TYPE_BITS:
        return H5T_BITFIELD;
    case TYPE_RAGGED:
        return H5T_VLEN;
    default:
        return tree_types[t].nature == NATURE_REAL   ? H5T_FLOAT
               : tree_types[t].nature == NATURE_TEXT ? H5T_STRING
                                                     : H5T_INTEGER;
    }
}
size_t H5Tget_size(hid_t type) {
    return type_record(type) == NULL ? 0 : bytes_of(type_record(type));
}
H5T_order_t H5Tget_order(hid_t type) {
    if (type_record(type) == NULL) return H5T_ORDER_ERROR;
    return tree_types[type_record(type)->type % TREE_TYPES].big != 0 ? H5T_ORDER_BE : H5T_ORDER_LE;
}
static bool is_signed(const tree_record *r) {
    const unsigned type = r->type % TREE_TYPES;
    return tree_types[type].name[0] == 'i' || type == TYPE_BOOL || type == TYPE_ENUM ||
           (type == TYPE_ODD_WHOLE && (r->size & 0x8000) == 0);
}
H5T_sign_t H5Tget_sign(hid_t type) {
    if (type_record(type) == NULL) return H5T_SGN_ERROR;
    return is_signed(type_record(type)) ? H5T_SGN_2 : H5T_SGN_NONE;
}
H5T_str_t H5Tget_strpad(hid_t type) {
    if (type_record(type) == NULL) return H5T_STR_ERROR;
    const unsigned t = type_record(type)->type % TREE_TYPES;
    return t == TYPE_BLANKS ? H5T_STR_SPACEPAD : t == TYPE_ZEROS ? H5T_STR_NULLPAD : H5T_STR_NULLTERM;
}
/* Only for texts of fixed length, which are terminated then. */
herr_t H5Tset_size(hid_t type, size_t size) {
    handle *h = get(type, A_TYPE);
    NEEDS(h);
    if (h->record == NULL || H5Tget_class(type) != H5T_STRING || size == 0) return -1;
    h->size = size;
    return 0;
}
herr_t H5Tset_strpad(hid_t type, H5T_str_t pad) {
    const handle *h = get(type, A_TYPE);
    NEEDS(h);
    return h->size > 0 && pad == H5T_STR_NULLTERM ? 0 : -1;
}
htri_t H5Tis_variable_str(hid_t type) {
    NEEDS(type_record(type));
    return type_record(type)->type % TREE_TYPES == TYPE_ANY_LENGTH;
}
size_t H5Tget_precision(hid_t type) {
    const tree_record *r = type_record(type);
    if (r == NULL) return 0;
    return r->type % TREE_TYPES == TYPE_ODD_WHOLE ? 1u + (r->size & 63u) : 8 * bytes_of(r);
}
int H5Tget_offset(hid_t type) {
    const tree_record *r = type_record(type);
    NEEDS(r);
    return r->type % TREE_TYPES == TYPE_ODD_WHOLE ? (r->size >> 6) & 63 : 0;
}
/* Fields of an odd type, as a damaged file may have it. */
herr_t H5Tget_fields(hid_t type, size_t *sign, size_t *exponent, size_t *exponents, size_t *mantissa,
                     size_t *mantissas) {
    const tree_record *r = type_record(type);
    NEEDS(r);
    const bool odd = r->type % TREE_TYPES == TYPE_ODD_REAL;
    const size_t bits = 8 * bytes_of(r);
    *exponents = odd ? r->size & 15u : bits == 16 ? 5 : bits == 32 ? 8 : bits == 64 ? 11 : 15;
    *mantissas = odd ? (r->size >> 4) & 63u : bits == 16 ? 10 : bits == 32 ? 23 : bits == 64 ? 52 : 64;
    *mantissa = 0;
    *exponent = *mantissas;
    *sign = *exponent + *exponents;
    return 0;
}

/* ---- elements ---- */

typedef struct number {
    bool real;
    double value;
    uint64_t whole; /* value of an integer; `negative`: in two's complement */
    bool negative;
} number;

static uint64_t bits_at(const uint8_t *at, size_t bytes, bool big) {
    uint64_t bits = 0;
    for (size_t i = 0; i < bytes && i < 8; i++) bits |= (uint64_t)at[big ? bytes - 1 - i : i] << 8 * i;
    return bits;
}

static double half_of(uint64_t bits) {
    const int exponent = (int)(bits >> 10 & 31);
    const double fraction = (double)(bits & 1023);
    const double value = exponent == 31  ? (fraction > 0 ? (double)NAN : (double)INFINITY)
                         : exponent == 0 ? ldexp(fraction, -24)
                                         : ldexp(1024 + fraction, exponent - 25);
    return (bits & 0x8000) != 0 ? -value : value;
}

static number number_of(const tree_record *r, const uint8_t *at) {
    const unsigned type = r->type % TREE_TYPES;
    const tree_type *t = &tree_types[type];
    uint64_t bits = bits_at(at, t->bytes, t->big != 0);
    number n = {.real = t->nature == NATURE_REAL || type == TYPE_ODD_REAL};
    if (n.real && t->bytes == 4) {
        const uint32_t low = (uint32_t)bits;
        float value;
        memcpy(&value, &low, sizeof value);
        n.value = (double)value;
    } else if (n.real && t->bytes == 2) {
        n.value = half_of(bits);
    } else if (n.real && t->bytes == 16) {
        n.value = (double)bits * 0x1p-60;
    } else if (n.real) {
        memcpy(&n.value, &bits, sizeof n.value);
    } else {
        unsigned width = 8u * t->bytes;
        if (type == TYPE_ODD_WHOLE) {
            width = 1u + (r->size & 63u);
            bits >>= (r->size >> 6) & 63;
            if (width < 64) bits &= (UINT64_C(1) << width) - 1;
        }
        n.negative = is_signed(r) && (bits >> (width - 1) & 1) != 0;
        if (n.negative && width < 64) bits |= ~((UINT64_C(1) << width) - 1);
        n.whole = bits;
        n.value = n.negative ? -(double)(~bits + 1) : (double)bits;
    }
    return n;
}

/* Clips a number that does not fit, or with `checked` returns an error. */
static bool store(number n, hid_t memory, bool checked, void *out) {
    if (memory == H5T_NATIVE_DOUBLE) {
        memcpy(out, &n.value, sizeof n.value);
        return true;
    }
    if (memory == H5T_NATIVE_FLOAT) {
        const bool beyond = isfinite(n.value) && fabs(n.value) > 3.4028234663852886e38;
        const float value = beyond ? (n.value < 0 ? -INFINITY : INFINITY) : (float)n.value;
        memcpy(out, &value, sizeof value);
        return !(beyond && checked);
    }
    const bool to_signed = memory == H5T_NATIVE_INT64;
    const size_t bytes = H5Tget_size(memory);
    const uint64_t most = to_signed ? (uint64_t)INT64_MAX : UINT64_MAX >> (64 - 8 * bytes);
    const double low = to_signed ? -0x1p63 : 0, high = ldexp(1.0, to_signed ? 63 : 8 * (int)bytes);
    uint64_t bits;
    bool fits;
    if (n.real) {
        fits = n.value >= low && n.value < high;
        bits = !fits                      ? (n.value >= high ? most : 0)
               : to_signed && n.value < 0 ? (uint64_t)(int64_t)n.value
                                          : (uint64_t)n.value;
        fits = fits || isnan(n.value);
    } else {
        fits = n.negative ? to_signed : n.whole <= most;
        bits = fits ? n.whole : n.negative ? 0 : most;
    }
    memcpy(out, &bits, bytes);
    return fits || !checked;
}

static bool is_number(const tree_record *r) {
    const unsigned type = r->type % TREE_TYPES;
    const tree_nature nature = tree_types[type].nature;
    return nature == NATURE_WHOLE || nature == NATURE_REAL || type == TYPE_ODD_WHOLE || type == TYPE_ODD_REAL;
}

/* Element `at` of a list of variable-length texts. The caller frees it, as with HDF5. */
static char *text_at(const tree_record *r, size_t at) {
    static char words[65537];
    memcpy(words, r->data, r->length);
    words[r->length] = '\0';
    size_t from = 0;
    for (size_t i = 0;; i++) {
        if (from >= r->length) from = 0;
        if (i == at) return strdup(words + from);
        from += strlen(words + from) + 1;
    }
}

/* Copies a text of fixed length without its padding, and ends it. */
static void put_text(const tree_record *r, const uint8_t *from, size_t stored, uint8_t *out, size_t size) {
    size_t length = 0;
    if (r->type % TREE_TYPES == TYPE_BLANKS)
        for (length = stored; length > 0 && from[length - 1] == ' '; length--) continue;
    else
        while (length < stored && from[length] != 0) length++;
    if (length > size - 1) length = size - 1;
    memset(out, 0, size);
    memcpy(out, from, length);
}

static herr_t read_elements(const tree_record *r, hid_t memory, const handle *part, bool checked, void *out) {
    static uint8_t bytes[TREE_BYTES];
    const size_t size = bytes_of(r), stored = tree_count(r, size);
    const handle *made = get(memory, A_TYPE);
    const int member = made == NULL ? 0 : made->member;
    if (made != NULL && made->native != 0) memory = made->native;
    if (member > 0 && r->type % TREE_TYPES != TYPE_COMPLEX) return -1;
    const tree_record *element = member > 0 ? type_record(H5T_NATIVE_DOUBLE) : r;
    const bool words = get(memory, A_TYPE) != NULL, there = stored <= TREE_BYTES;
    const size_t wanted = H5Tget_size(memory);
    if (words ? tree_types[r->type % TREE_TYPES].nature != NATURE_TEXT &&
                    tree_types[r->type % TREE_TYPES].nature != NATURE_OTHER
              : !is_number(element))
        if (!words || !is_number(element)) return -1;
    if (there) tree_fill(r, bytes, stored * size);
    const hsize_t count = points(part);
    for (hsize_t i = 0; i < count; i++) {
        hsize_t at = 0, rest = i, index[TREE_RANK] = {0};
        for (unsigned d = part->rank; d-- > 0; rest /= part->count[d])
            index[d] = part->start[d] + rest % part->count[d];
        for (unsigned d = 0; d < part->rank; d++) at = at * part->dims[d] + index[d];
        static const uint8_t zeros[65536];
        const uint8_t *from = there ? bytes + at * size + (member > 1 ? 8 : 0) : zeros;
        if (words && r->type % TREE_TYPES == TYPE_ANY_LENGTH)
            ((char **)out)[i] = there ? text_at(r, at) : NULL;
        else if (words && made != NULL && made->size > 0)
            put_text(r, from, size, (uint8_t *)out + i * made->size, made->size);
        else if (words)
            memcpy((uint8_t *)out + i * size, from, size);
        else if (!store(number_of(element, from), memory, checked, (uint8_t *)out + i * wanted))
            return -1;
    }
    return 0;
}

herr_t H5Dread(hid_t set, hid_t memory, hid_t room, hid_t part, hid_t list, void *out) {
    const handle *l = get(list, A_LIST), *selected = get(part, A_SPACE), *space = get(room, A_SPACE);
    const tree_record *r = record_of(set, AN_OBJECT);
    NEEDS(r);
    NEEDS(type_record(memory));
    if ((room != H5S_ALL && space == NULL) || (part != H5S_ALL && selected == NULL)) return -1;
    const hid_t all = selected == NULL ? space_of(r) : H5I_INVALID_HID;
    if (selected == NULL) selected = get(all, A_SPACE);
    const bool fits = space == NULL || points(space) == points(selected);
    const herr_t result = fits ? read_elements(r, memory, selected, l != NULL && l->checked, out) : -1;
    if (all >= 0) (void)H5Sclose(all);
    return result;
}
herr_t H5Dvlen_reclaim(hid_t type, hid_t space, hid_t list, void *texts) {
    const handle *h = get(space, A_SPACE);
    NEEDS(h);
    const hsize_t count = points(h);
    (void)type, (void)list;
    for (hsize_t i = 0; i < count; i++) free(((char **)texts)[i]);
    return 0;
}
herr_t H5free_memory(void *memory) {
    free(memory);
    return 0;
}

/* ---- attributes ---- */

static int find_attribute(int object, const char *name) {
    char key[2 * MOST_NAME];
    (void)snprintf(key, sizeof key, "%d@%s", object, name);
    key[MOST_NAME - 1] = '\0';
    return object < 0 ? -1 : find(key);
}
htri_t H5Aexists_by_name(hid_t file, const char *object, const char *name, hid_t list) {
    (void)file, (void)list;
    return find_attribute(resolve(object), name) >= 0;
}
hid_t H5Aopen_by_name(hid_t file, const char *object, const char *name, hid_t access, hid_t list) {
    (void)file, (void)access, (void)list;
    const int at = find_attribute(resolve(object), name);
    return at < 0 ? H5I_INVALID_HID : open_handle(AN_ATTRIBUTE, nodes[at].record, at);
}
herr_t H5Aclose(hid_t attribute) {
    return close_handle(attribute, AN_ATTRIBUTE);
}
herr_t H5Aread(hid_t attribute, hid_t memory, void *out) {
    const tree_record *r = record_of(attribute, AN_ATTRIBUTE);
    NEEDS(r);
    const hid_t all = space_of(r);
    const herr_t result = read_elements(r, memory, get(all, A_SPACE), false, out);
    (void)H5Sclose(all);
    return result;
}
