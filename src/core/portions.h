/* Allocation in the caller's memory. */
#ifndef LG_CORE_PORTIONS_H
#define LG_CORE_PORTIONS_H

#include "core/core.h"

/* Hands out consecutive parts of the caller's memory, each aligned to LG_ALIGNMENT. If base is NULL, it only
 * counts the bytes; SIZE_MAX are too many for a size_t, and no allocation gives them. */
typedef struct lg_portions {
    char *base;
    size_t used;
} lg_portions;
void *lg_portion(lg_portions *from, size_t count, size_t size);
/* Checks that the caller's memory is not NULL, is aligned and has at least `needed` bytes. */
lg_status lg_portions_check(const void *memory, size_t bytes, size_t needed, lg_error *error);

#endif
