/* Transposes kept by the tape, and products that use them. The transpose of a node's value belongs to the
 * node; the transpose of memory declared constant belongs to the tape and outlives the node. */
#include "autodiff/tape/tape_internal.h"

void lg_tape_constant(lg_tape *tape, const void *memory, size_t bytes) {
    for (uint32_t i = 0; i < tape->lasting_count; i++) {
        const lg_lasting *l = &tape->lasting[i];
        lg_pool_give(tape, l->transposed, (size_t)l->rows * l->cols * tape->k->size);
    }
    tape->lasting_count = 0;
    tape->constant = memory;
    tape->constant_bytes = bytes;
}

void lg_forget_transposes(lg_tape *tape, uint32_t node) {
    uint32_t kept = 0, end = 0;
    if (tape->transposed_end <= node) return;
    for (uint32_t i = 0; i < tape->transposed_count; i++) {
        uint32_t owner = tape->transposed[i];
        if (owner < node) {
            tape->transposed[kept++] = owner;
            if (owner >= end) end = owner + 1;
        } else {
            lg_node *n = &tape->nodes[owner];
            lg_pool_give(tape, n->transposed, n->count * tape->k->size);
            n->transposed = NULL;
        }
    }
    tape->transposed_count = kept;
    tape->transposed_end = end;
}

static bool is_constant(const lg_tape *tape, const lg_node *node) {
    const uintptr_t at = (uintptr_t)node->value - (uintptr_t)tape->constant;
    return at < tape->constant_bytes && node->count * tape->k->size <= tape->constant_bytes - at;
}

static uint32_t columns_of(const lg_node *node) {
    return node->shape.dims[node->shape.rank - 1];
}

static uint32_t rows_of(const lg_node *node) {
    return node->shape.rank == 3 ? node->shape.dims[0] * node->shape.dims[1] : node->shape.dims[0];
}

static void *lasting_transpose(const lg_tape *tape, const lg_node *node) {
    for (uint32_t i = 0; i < tape->lasting_count; i++) {
        const lg_lasting *l = &tape->lasting[i];
        if (l->value == node->value && l->rows == rows_of(node) && l->cols == columns_of(node))
            return l->transposed;
    }
    return NULL;
}

static void *make_transpose(lg_tape *tape, const lg_node *node) {
    void *memory = lg_pool_take(tape, node->count * tape->k->size);
    if (memory != NULL) tape->k->transpose(rows_of(node), columns_of(node), node->value, memory);
    return memory;
}

static void *new_lasting(lg_tape *tape, const lg_node *node) {
    if (!lg_grow(tape, (void **)&tape->lasting, &tape->lasting_capacity, tape->lasting_count + 1,
                 sizeof *tape->lasting))
        return NULL;
    void *memory = make_transpose(tape, node);
    if (memory == NULL) return NULL;
    tape->lasting[tape->lasting_count++] = (lg_lasting){node->value, memory, rows_of(node), columns_of(node)};
    return memory;
}

static void *new_owned(lg_tape *tape, const lg_node *node, uint32_t index) {
    if (!lg_grow(tape, (void **)&tape->transposed, &tape->transposed_capacity, tape->transposed_count + 1,
                 sizeof *tape->transposed))
        return NULL;
    void *memory = make_transpose(tape, node);
    if (memory == NULL) return NULL;
    tape->transposed[tape->transposed_count++] = index;
    if (index >= tape->transposed_end) tape->transposed_end = index + 1;
    return memory;
}

const void *lg_transposed(lg_tape *tape, uint32_t index) {
    lg_node *node = &tape->nodes[index];
    if (node->transposed != NULL) return node->transposed;
    if (is_constant(tape, node)) {
        node->transposed = lasting_transpose(tape, node);
        if (node->transposed == NULL) node->transposed = new_lasting(tape, node);
    } else {
        node->transposed = new_owned(tape, node, index);
    }
    return node->transposed;
}

const void *lg_kept_transpose(lg_tape *tape, lg_transpose_use use, uint32_t node) {
    if (use == LG_TRANSPOSE_NONE || use == LG_TRANSPOSE_FIXED) return NULL;
    if (use == LG_TRANSPOSE_IF_KEPT && tape->nodes[node].transposed == NULL) return NULL;
    return lg_transposed(tape, node);
}

void lg_gemm(lg_tape *tape, uint32_t variant, size_t m, size_t n, size_t k, const void *a, uint32_t b_node,
             void *c, bool accumulate) {
    const lg_crew crew = lg_tape_crew(tape);
    const lg_product_size size = {variant, m, n, k};
    const void *b = tape->nodes[b_node].value;
    const void *transposed = lg_kept_transpose(tape, lg_product_transpose(&size, &crew), b_node);
    if (tape->status != LG_OK) return;
    const size_t bytes = transposed != NULL ? 0 : lg_product_scratch(tape->k, &size, &crew);
    void *scratch = bytes > 0 ? lg_pool_take(tape, bytes) : NULL;
    if (bytes > 0 && scratch == NULL) return;
    lg_product(tape->k, &crew, &size, a, b, transposed, c, accumulate, scratch);
    if (bytes > 0) lg_pool_give(tape, scratch, bytes);
}
