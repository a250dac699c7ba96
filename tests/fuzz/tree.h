/* The contents of an HDF5 file in a few bytes. Any bytes are a valid tree, so that the fuzzer tests the
 * readers and not HDF5 itself.
 *
 * A tree is a list of records, one after the other. Numbers are little-endian.
 *   kind u8      what it is (tree_kind in the low bits), and the layout of its data (TREE_CHUNKED ...)
 *   type u8      index into the table of types, modulo its length
 *   size u16     bytes of a text, or parameters of odd types
 *   rank u8      number of extents; TREE_NO_SPACE: no data space
 *   dims u32     (rank)
 *   length u8, name   "a/b"; of an attribute "a/b@name"
 *   length u16, data  the elements as stored in the file. Missing ones repeat the given ones. Texts of
 * variable length end with zeros.
 * An incomplete record at the end is ignored. */
#ifndef LG_FUZZ_TREE_H
#define LG_FUZZ_TREE_H

#include <stddef.h>
#include <stdint.h>

enum { TREE_RANK = 5, TREE_NO_SPACE = 255, TREE_RECORDS = 512 };
typedef enum tree_kind {
    TREE_DATA,
    TREE_ATTRIBUTE,
    TREE_GROUP,
    TREE_SOFT,     /* a soft link; data: its target */
    TREE_HARD,     /* a hard link to an earlier object; data: its target */
    TREE_EXTERNAL, /* a link to another file; data: its target */
    TREE_KINDS
} tree_kind;
enum { TREE_KIND = 0x07, TREE_CHUNKED = 0x10, TREE_PACKED = 0x20, TREE_COMPACT = 0x40, TREE_ENDLESS = 0x80 };

typedef struct tree_record {
    uint8_t kind, type, rank, name_length;
    uint16_t size, length;
    uint32_t dims[TREE_RANK];
    const uint8_t *name, *data; /* point into the tree's bytes */
} tree_record;

/* Indices into the table of types; numbers come before these. */
enum {
    TYPE_FIXED = 15,
    TYPE_BLANKS,
    TYPE_ZEROS,
    TYPE_ANY_LENGTH,
    TYPE_BOOL,
    TYPE_ENUM,
    TYPE_COMPLEX,
    TYPE_OPAQUE,
    TYPE_ARRAY,
    TYPE_ODD_WHOLE,
    TYPE_ODD_REAL,
    TYPE_REFERENCE,
    TYPE_BITS,
    TYPE_LONG_DOUBLE,
    TYPE_RAGGED,
    TREE_TYPES
};

/* Reads at most TREE_RECORDS records and returns their number. */
size_t tree_read(const uint8_t *bytes, size_t size, tree_record *out);
/* Writes as many whole records as fit into `most` bytes. Returns the number of bytes. */
size_t tree_write(const tree_record *records, size_t count, uint8_t *out, size_t most);

enum {
    TREE_BYTES = 1 << 15
}; /* most bytes of a record's elements that are written; of larger records only the shape is declared */
/* Number of elements of this size; TREE_BYTES + 1 if they are too large to be written. */
size_t tree_count(const tree_record *r, size_t bytes);
/* Writes the bytes of all elements. */
void tree_fill(const tree_record *r, uint8_t *out, size_t bytes);

/* Makes the tree an HDF5 file and returns its path. */
const char *tree_file(const uint8_t *bytes, size_t size);
/* tree_unpack writes the tree as an HDF5 file on disk, tree_pack converts such a file to a tree. They return
 * 0, or 1 with a message on stderr. */
int tree_unpack(const uint8_t *bytes, size_t size, const char *path);
int tree_pack(const char *path, uint8_t *out, size_t most, size_t *size);

/* ---- types, as far as mutations need them ---- */

typedef enum tree_nature { NATURE_WHOLE, NATURE_REAL, NATURE_TEXT, NATURE_OTHER } tree_nature;
typedef struct tree_type {
    const char *name;
    tree_nature nature;
    uint8_t bytes; /* bytes per element; 0: `size` of the record */
    uint8_t big;   /* big-endian */
} tree_type;
extern const tree_type tree_types[];
extern const size_t tree_type_count;

#endif
