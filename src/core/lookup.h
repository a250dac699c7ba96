/* Finds one of many names without a comparison with all of them. A list of n names from a file is searched
 * in this way: for each of n others a search through all of them would take n^2 comparisons. */
#ifndef LG_LOOKUP_H
#define LG_LOOKUP_H

#include <stddef.h>

typedef struct lg_lookup {
    const char *name; /* owned by the caller */
    size_t at;        /* the caller's number of this name */
} lg_lookup;

/* Sorts entries by name, and those of one name by `at`. */
void lg_lookup_sort(lg_lookup *entries, size_t count);
/* The first of the sorted entries with this name, or NULL. */
const lg_lookup *lg_lookup_find(const lg_lookup *entries, size_t count, const char *name);

#endif
