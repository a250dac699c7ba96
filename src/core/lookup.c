#include "core/lookup.h"

#include "core/core.h"

#include <stdlib.h>
#include <string.h>

static int by_name(const void *a, const void *b) {
    const lg_lookup *x = a, *y = b;
    const int order = strcmp(x->name, y->name);
    return order != 0 ? order : (x->at > y->at) - (x->at < y->at);
}

void lg_lookup_sort(lg_lookup *entries, size_t count) {
    if (count > 0) qsort(entries, count, sizeof *entries, by_name);
}

const lg_lookup *lg_lookup_find(const lg_lookup *entries, size_t count, const char *name) {
    size_t low = 0, high = count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (strcmp(entries[middle].name, name) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return low < count && strcmp(entries[low].name, name) == 0 ? &entries[low] : NULL;
}

int lg_label_compare(const char *a, const char *b) {
    const bool p = lg_is_decimal(a), q = lg_is_decimal(b);
    const int order = p && q ? lg_decimal_compare(a, b) : (int)q - (int)p;
    return order != 0 ? order : strcmp(a, b);
}
