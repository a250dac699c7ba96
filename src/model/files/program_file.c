#include "model/files/program_file.h"

#include <stdio.h>
#include <string.h>

lg_program_key lg_program_below(const char *group, const char *name) {
    lg_program_key k;
    (void)snprintf(k.text, sizeof k.text, "%.180s/%.64s", group, name);
    return k;
}

const lg_program_column lg_program_operation_rows[OPERATION_COLUMNS] = {
    [OPERATION] = {"operation", LG_ELEMENT_U32, 1, false},
    [INPUTS] = {"inputs", LG_ELEMENT_U32, 1, false},
    [OPERATION_RANK] = {"rank", LG_ELEMENT_U32, 1, false},
    [SHAPE] = {"shape", LG_ELEMENT_I64, LG_MAX_RANK, true},
    [WHOLE] = {"whole", LG_ELEMENT_I64, LG_WHOLE_COUNT, true},
    [REAL] = {"real", LG_ELEMENT_F64, 1, false},
    [RECIPROCAL] = {"reciprocal", LG_ELEMENT_I64, 1, true},
    [REALS] = {"reals", LG_ELEMENT_U32, 1, false},
    [INDICES] = {"indices", LG_ELEMENT_U32, 1, false},
};

const lg_program_column lg_program_port_rows[PORT_COLUMNS] = {
    [PORT_RANK] = {"rank", LG_ELEMENT_U32, 1, false},
    [PORT_SHAPE] = {"shape", LG_ELEMENT_U32, LG_MAX_RANK, false},
    [SHARED] = {"shared", LG_ELEMENT_U32, 1, false},
    [RANGE] = {"range", LG_ELEMENT_F64, 2, false},
};

const lg_program_list lg_program_lists[LG_PROGRAM_LISTS] = {
    {"edges", LG_ELEMENT_U32, sizeof(uint32_t), offsetof(lg_operation, inputs),
     offsetof(lg_operation, input_count)},
    {"reals", LG_ELEMENT_F64, sizeof(double), offsetof(lg_operation, reals),
     offsetof(lg_operation, real_count)},
    {"indices", LG_ELEMENT_U32, sizeof(uint32_t), offsetof(lg_operation, indices),
     offsetof(lg_operation, index_count)},
};

_Static_assert(sizeof(lg_affine) == 2 * sizeof(int64_t), "pairs lie in files as in memory");

uint32_t lg_program_count_of(const lg_program_list *l, const lg_operation *o) {
    uint32_t count;
    memcpy(&count, (const char *)o + l->count, sizeof count);
    return count;
}

uint64_t lg_program_list_count(const lg_program_list *l, const lg_operation *operations, size_t n) {
    uint64_t total = 0;
    for (size_t i = 0; i < n; i++) total += lg_program_count_of(l, &operations[i]);
    return total;
}

size_t lg_program_row_size(const lg_program_column *c) {
    const size_t one = c->type == LG_ELEMENT_U32 ? sizeof(uint32_t) : 8;
    return one * c->width * (c->affine ? 2 : 1);
}

uint32_t lg_program_column_shape(const lg_program_column *c, uint64_t count, uint64_t dims[4]) {
    uint32_t rank = 0;
    dims[rank++] = count;
    if (c->width > 1) dims[rank++] = c->width;
    if (c->affine) dims[rank++] = 2;
    return rank;
}

void lg_program_free_columns(const lg_context *context, size_t n, void **columns) {
    for (size_t i = 0; i < n; i++) lg_free(context, columns[i]);
}

lg_status lg_program_no_memory(const lg_h5 *h5, lg_error *error) {
    return lg_fail(error, LG_OUT_OF_MEMORY, "%s: out of memory", lg_shown_path(h5->path));
}
