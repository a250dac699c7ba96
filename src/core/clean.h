/* Variables that are destroyed where their block ends. */
#ifndef LG_CLEAN_H
#define LG_CLEAN_H

#include <string.h>

#include "core/core.h"

/* Declares a variable that is destroyed where its block ends, by destroy(&variable). LG_AT(destroy, type)
 * defines destroy_at, which does this for a pointer to an object. */
#define LG_CLEAN(destroy) __attribute__((cleanup(destroy), unused))
#define LG_AT(destroy, type)                                                                                 \
    static inline void destroy##_at(type **at) {                                                             \
        destroy(*at);                                                                                        \
    }
LG_AT(lg_thread_pool_destroy, lg_thread_pool)
/* Gives the pointer `from` to its new owner: returns LG_OK, and `from` is not destroyed. */
#define LG_MOVE(to, from) (*(to) = (from), (from) = NULL, LG_OK)
/* The same for a structure, which becomes zeros. */
#define LG_GIVE(to, from) (*(to) = (from), memset(&(from), 0, sizeof(from)), LG_OK)
/* Memory that is freed where its block ends. LG_SCRATCH declares `name`, which points to `count` zeros, or is
 * NULL without memory. LG_KEEP(name) is its value, and from then on its owner must free it. */
typedef struct lg_owned {
    const lg_context *context;
    void *memory;
} lg_owned;
static inline void lg_owned_free(lg_owned *owned) {
    lg_free(owned->context, owned->memory);
}
#define LG_SCRATCH(type, name, context, count)                                                               \
    LG_CLEAN(lg_owned_free) lg_owned name##_owned = {context, lg_alloc(context, count, sizeof(type))};       \
    type *const name = name##_owned.memory
/* The same, but without memory the calling function returns `failure`. */
#define LG_TRY_SCRATCH(type, name, context, count, failure)                                                  \
    LG_SCRATCH(type, name, context, count);                                                                  \
    if (name == NULL) return failure
#define LG_KEEP(name) (name##_owned.memory = NULL, name)

#endif
