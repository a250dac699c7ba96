/* Reads texts from data sets and attributes. Texts have fixed or variable length; there may be one or
 * many. */
#include <string.h>

#include "files/h5_internal.h"

#define PIECE_BYTES     ((size_t)1 << 20) /* bytes of fixed-length texts that are read at once */
#define PIECE_TEXTS     4096u             /* number of variable-length texts that are read at once */
#define ATTRIBUTE_BYTES ((size_t)1 << 16) /* longest single text of an attribute, in bytes */

/* Texts of one HDF5 type, which are read piece by piece into `memory`. A few texts need no allocation, so
 * that attributes can be read without one. */
typedef struct texts {
    lg_h5 *h5;
    hid_t type;         /* in memory; texts of fixed length have no padding and are terminated */
    bool variable;      /* texts have variable length */
    size_t size, piece; /* a text takes `size` bytes of memory; `piece` texts are read at once */
    size_t longest;     /* longest text allowed, in bytes with the terminator */
    char *memory;       /* (piece, size) */
    char none[1];
    _Alignas(char *) char few[LG_H5_TEXT + 1];
} texts;

static lg_status begin_texts(lg_h5 *h5, hid_t type, size_t longest, uint64_t count, const char *name,
                             texts *t, lg_error *error) {
    const size_t stored = H5Tget_size(type);
    *t = (texts){.h5 = h5, .type = H5Tcopy(type), .longest = longest};
    t->variable = H5Tis_variable_str(type) > 0;
    t->size = t->variable ? sizeof(char *) : stored + 1;
    if (!t->variable && (stored > longest || H5Tset_size(t->type, t->size) < 0 ||
                         H5Tset_strpad(t->type, H5T_STR_NULLTERM) < 0))
        return lg_h5_fail(
            h5, error,
            "/%s: has a type of %zu bytes for each text; at most %zu can be read: use a narrower "
            "type, or variable length",
            name, stored, longest);
    t->piece = t->variable ? PIECE_TEXTS : PIECE_BYTES / t->size;
    if (t->piece > count) t->piece = (size_t)count;
    t->memory = t->piece * t->size <= sizeof t->few ? t->few : lg_alloc(h5->context, t->piece, t->size);
    return t->memory != NULL ? LG_OK : lg_h5_no_memory(h5, error);
}

static void end_texts(texts *t) {
    lg_id_close(&t->type);
    if (t->memory != t->few) lg_free(t->h5->context, t->memory);
}

/* Returns text number `index` of the current piece, or NULL if it is too long. It is valid until the next
 * piece. */
static char *text_at(texts *t, size_t index) {
    char *text = t->variable ? ((char **)(void *)t->memory)[index] : t->memory + index * t->size;
    if (text == NULL) text = t->none;
    return strlen(text) < t->longest || !t->variable ? text : NULL;
}

static lg_status visit_piece(texts *t, uint64_t first, size_t count, const char *name, lg_h5_visit visit,
                             void *user, lg_error *error) {
    for (size_t i = 0; i < count; i++) {
        const char *text = text_at(t, i);
        if (text == NULL)
            return lg_h5_fail(t->h5, error,
                              "/%s: the text at index (%llu) is too long: shorten it to %zu bytes", name,
                              (unsigned long long)(first + i), t->longest - 1);
        LG_TRY(visit(user, first + i, text, error));
    }
    return LG_OK;
}

/* ---- data sets ---- */

static lg_status each_piece(texts *t, const lg_h5_slice *slice, lg_h5_visit visit, void *user,
                            lg_error *error) {
    for (uint64_t at = 0; at < slice->count; at += t->piece) {
        const uint64_t left = slice->count - at;
        lg_h5_slice piece = *slice;
        LG_DATASET(d);
        LG_ID part = H5I_INVALID_HID;
        piece.first += at;
        piece.count = left < t->piece ? left : t->piece;
        memset(t->memory, 0, (size_t)piece.count * t->size);
        LG_TRY(lg_slice_open(t->h5, &piece, 1, &d, &part, error));
        const hsize_t extent = piece.count;
        LG_ID memory = H5Screate_simple(1, &extent, NULL), element = lg_dataset_memory(&d, t->type);
        lg_status status = LG_OK;
        if (H5Dread(d.set, element, memory, part, H5P_DEFAULT, t->memory) < 0)
            status = lg_dataset_error(t->h5, slice->name,
                                      "cannot be read: cut short or damaged; write it again", error);
        if (status == LG_OK)
            status = visit_piece(t, piece.first, (size_t)piece.count, slice->name, visit, user, error);
        if (t->variable) (void)H5Dvlen_reclaim(t->type, memory, H5P_DEFAULT, t->memory);
        LG_TRY(status);
    }
    return LG_OK;
}

lg_status lg_h5_each_text_of(lg_h5 *h5, const lg_h5_slice *slice, lg_h5_visit visit, void *user,
                             lg_error *error) {
    LG_QUIET;
    LG_DATASET(d);
    LG_ID part = H5I_INVALID_HID;
    LG_CLEAN(end_texts) texts t = {.h5 = h5, .type = H5I_INVALID_HID};
    LG_TRY(lg_slice_open(h5, slice, 1, &d, &part, error));
    if (H5Tget_class(d.type) != H5T_STRING)
        return lg_dataset_error(h5, slice->name, "does not hold texts: write an array of strings", error);
    for (uint32_t i = 0; i < d.rank; i++)
        if (i != slice->axis && d.dims[i] != 1)
            return lg_dataset_error(h5, slice->name, "is not a list of texts: write one row or one column",
                                    error);
    LG_TRY(begin_texts(h5, d.type, LG_H5_TEXT, slice->count, slice->name, &t, error));
    return each_piece(&t, slice, visit, user, error);
}

lg_status lg_h5_each_text(lg_h5 *h5, const char *name, lg_h5_visit visit, void *user, lg_error *error) {
    lg_h5_about about;
    LG_TRY(lg_h5_look(h5, name, 1, &about, error));
    const uint32_t axis = lg_h5_long_axis(&about);
    const lg_h5_slice all = {.name = name, .axis = axis, .count = about.rank == 0 ? 1 : about.dims[axis]};
    return lg_h5_each_text_of(h5, &all, visit, user, error);
}

/* ---- attributes ---- */

/* Visits the names in a text, which is changed. */
static lg_status visit_names(char *text, const char *joint, lg_h5_visit visit, void *user, lg_error *error) {
    for (uint64_t i = 0;; i++) {
        text += strspn(text, joint + 1);
        char *end = strchr(text, *joint);
        if (end != NULL) *end = '\0';
        LG_TRY(visit(user, i, text, error));
        if (end == NULL) return LG_OK;
        text = end + 1;
    }
}

/* Messages call the attribute `name`. */
static lg_status visit_attribute(lg_h5 *h5, hid_t attribute, hid_t type, const char *name, const char *joint,
                                 lg_h5_visit visit, void *user, lg_error *error) {
    LG_ID space = H5Aget_space(attribute);
    const hssize_t count = H5Sget_simple_extent_npoints(space);
    LG_CLEAN(end_texts) texts t = {.h5 = h5, .type = H5I_INVALID_HID};
    if (count < 0 || (count > 1 && (uint64_t)count > h5->max_size))
        return lg_dataset_error(h5, name, "cannot be read: write it again", error);
    if (count == 0) return LG_OK;
    LG_TRY(
        begin_texts(h5, type, count == 1 ? ATTRIBUTE_BYTES : LG_H5_TEXT, (uint64_t)count, name, &t, error));
    if ((uint64_t)count > t.piece)
        return lg_dataset_error(h5, name, "has too many texts: write fewer", error);
    const bool read = H5Aread(attribute, t.type, t.memory) >= 0, names = joint != NULL && count == 1;
    char *text = read && names ? text_at(&t, 0) : NULL;
    const lg_status status = !read ? lg_dataset_error(h5, name, "cannot be read: write it again", error)
                             : text != NULL ? visit_names(text, joint, visit, user, error)
                                            : visit_piece(&t, 0, (size_t)count, name, visit, user, error);
    if (t.variable) (void)H5Dvlen_reclaim(t.type, space, H5P_DEFAULT, t.memory);
    return status;
}

lg_status lg_h5_each_name(lg_h5 *h5, const char *object, const char *name, const char *joint, bool *words,
                          lg_h5_visit visit, void *user, lg_error *error) {
    *words = false;
    if (!lg_h5_has_attribute(h5, object, name)) return LG_OK;
    char shown[256];
    (void)lg_format(shown, sizeof shown, "%s: attribute %s", object, name);
    LG_QUIET;
    LG_ID attribute = H5Aopen_by_name(h5->file, *object == '\0' ? "/" : object, name, H5P_DEFAULT, h5->links),
          type = H5Aget_type(attribute);
    if (type < 0) return lg_dataset_error(h5, shown, "cannot be read: write it again", error);
    *words = H5Tget_class(type) == H5T_STRING;
    return *words ? visit_attribute(h5, attribute, type, shown, joint, visit, user, error) : LG_OK;
}
