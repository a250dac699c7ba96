/* Archives: state is saved and loaded as named arrays and texts, independent of a file format. liegrad_io has
 * HDF5 implementations (liegrad/io.h); a caller may write its own. Paths look like "optimizer/adam/m". */
#ifndef LIEGRAD_ARCHIVE_H
#define LIEGRAD_ARCHIVE_H

#include <stddef.h>
#include <stdint.h>

#include "liegrad/export.h"
#include "liegrad/status.h"

LG_BEGIN_DECLS

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

LG_END_DECLS

#endif
