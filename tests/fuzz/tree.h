/* The contents of an HDF5 file in a few bytes, of which any make a file: HDF5 itself is out of the game, and
 * what is tested are the readers.
 *
 * A tree is a list of records, one after the other. Numbers are little-endian.
 *   kind u8      what it is (tree_kind in the low bits), and how its data is laid out (TREE_CHUNKED ...)
 *   type u8      number in the table of types, modulo its length
 *   size u16     bytes of a text, parameters of odd types
 *   rank u8      extents; TREE_NO_SPACE: none at all
 *   dims u32     (rank)
 *   length u8, name   "a/b"; of an attribute "a/b@name"
 *   length u16, data  of the elements as in the file; too few are repeated; texts of any length end by zeros
 * A record that is cut off is left out. */
#ifndef LG_FUZZ_TREE_H
#define LG_FUZZ_TREE_H

#include <stddef.h>
#include <stdint.h>

enum { TREE_RANK = 5, TREE_NO_SPACE = 255, TREE_RECORDS = 512 };
typedef enum tree_kind {
    TREE_DATA,
    TREE_ATTRIBUTE,
    TREE_GROUP,
    TREE_SOFT,     /* a link; data: its target */
    TREE_HARD,     /* likewise, to what stands before it */
    TREE_EXTERNAL, /* likewise, in another file */
    TREE_KINDS
} tree_kind;
enum { TREE_KIND = 0x07, TREE_CHUNKED = 0x10, TREE_PACKED = 0x20, TREE_COMPACT = 0x40, TREE_ENDLESS = 0x80 };

typedef struct tree_record {
    uint8_t kind, type, rank, name_length;
    uint16_t size, length;
    uint32_t dims[TREE_RANK];
    const uint8_t *name, *data; /* within the bytes */
} tree_record;

/* Places in the table of types: numbers come before. */
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

/* Records (at most TREE_RECORDS); how many. */
size_t tree_read(const uint8_t *bytes, size_t size, tree_record *out);
/* The bytes of records, as far as whole ones fit into `most`; how many bytes. */
size_t tree_write(const tree_record *records, size_t count, uint8_t *out, size_t most);

enum {
    TREE_BYTES = 1 << 15
}; /* of the elements of a record that are written; of more the shape alone is declared */
/* How many elements of so many bytes; TREE_BYTES + 1: more than are written. */
size_t tree_count(const tree_record *r, size_t bytes);
/* The bytes of all elements. */
void tree_fill(const tree_record *r, uint8_t *out, size_t bytes);

/* The tree as an HDF5 file: its path. */
const char *tree_file(const uint8_t *bytes, size_t size);
/* Writes the same file to disk; the other way round. 0, or 1 with a sentence on stderr. */
int tree_unpack(const uint8_t *bytes, size_t size, const char *path);
int tree_pack(const char *path, uint8_t *out, size_t most, size_t *size);

/* ---- mutation (mutate.c) ---- */

typedef enum tree_nature { NATURE_WHOLE, NATURE_REAL, NATURE_TEXT, NATURE_OTHER } tree_nature;
typedef struct tree_type {
    const char *name;
    tree_nature nature;
    uint8_t bytes; /* of an element; 0: `size` of the record */
    uint8_t big;   /* the first byte is the highest */
} tree_type;
extern const tree_type tree_types[];
extern const size_t tree_type_count;

/* Changes a tree in place by its structure; `bytes_mutate` changes plain bytes. The new size. */
size_t tree_mutate(uint8_t *data, size_t size, size_t most, unsigned seed,
                   size_t (*bytes_mutate)(uint8_t *data, size_t size, size_t most));
/* A tree with records of both. */
size_t tree_cross(const uint8_t *a, size_t size_a, const uint8_t *b, size_t size_b, uint8_t *out, size_t most,
                  unsigned seed);

#endif
