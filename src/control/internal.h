/* Internals of control.h: parts of the caller's memory. */
#ifndef LG_CONTROL_INTERNAL_H
#define LG_CONTROL_INTERNAL_H

#include "kernels/matrix.h"
#include "liegrad/control.h"

/* Gives out parts of the caller's memory one after the other, each on a boundary of LG_ALIGNMENT. With base
 * NULL it counts alone. */
typedef struct lg_portions {
    char *base;
    size_t used;
} lg_portions;
void *lg_portion(lg_portions *from, size_t count, size_t size);
/* Memory from the caller: not NULL, aligned, enough. */
lg_status lg_portions_check(const void *memory, size_t bytes, size_t needed, lg_error *error);

#endif
