/* Looks up names in a sorted list by binary search. So a file with many names cannot make a reader slow. */
#ifndef LG_LOOKUP_H
#define LG_LOOKUP_H

#include <stddef.h>

typedef struct lg_lookup {
    const char *name; /* owned by the caller */
    size_t at;        /* the caller's number of this name */
} lg_lookup;

/* Sorts entries by name; entries with the same name are sorted by `at`. */
void lg_lookup_sort(lg_lookup *entries, size_t count);
/* Returns the first of the sorted entries with this name, or NULL. */
const lg_lookup *lg_lookup_find(const lg_lookup *entries, size_t count, const char *name);

/* Compares two labels: numbers come first, in rising order; equal numbers and other texts by their bytes. */
int lg_label_compare(const char *a, const char *b);

#endif
