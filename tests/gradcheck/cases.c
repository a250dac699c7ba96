/* The list of all cases: every operation of the table with the shapes and attributes that matter, one family
 * after the other, followed by the tables of the rooms. */
#include <stdio.h>
#include <stdlib.h>

#include "gradcheck/table.h"

typedef const lg_gradcheck_case *(*table_fn)(size_t *count);
#define X(name) lg_gradcheck_##name,
static const table_fn operations[] = {LG_GRADCHECK_OPERATIONS NULL};
static const table_fn all[] = {LG_GRADCHECK_OPERATIONS LG_GRADCHECK_ROOMS NULL};

static const lg_gradcheck_case *at(const table_fn *table, size_t index) {
    for (; *table != NULL; table++) {
        size_t count;
        const lg_gradcheck_case *rows = (*table)(&count);
        if (index < count) return &rows[index];
        index -= count;
    }
    return NULL;
}

const lg_gradcheck_case *lg_gradcheck_operation(size_t index) {
    return at(operations, index);
}

const lg_gradcheck_case *lg_gradcheck_case_at(size_t index) {
    return at(all, index);
}

void *lg_gradcheck_alloc(size_t count, size_t size) {
    void *memory = calloc(count, size);
    if (memory != NULL) return memory;
    (void)fputs("no memory for the cases of the gradient check\n", stderr);
    exit(5);
}
