/* Gather and scatter of rows; each is the adjoint of the other. attr.pointer = indices (payload), attr.i =
 * {number of indices, rows of the tensor that they index}. */
#include "autodiff/ops/op_c.h"
#include "autodiff/ops/op_rows.h"
#include "autodiff/program/scalars.h"
#include "autodiff/tape/tape_internal.h"

#include <string.h>

extern const lg_op lg_op_gather, lg_op_scatter;

static lg_status gather_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                              lg_shape *out) {
    if (in[0]->rank == 0 || in[0]->dims[0] != attr->i[1]) return LG_SHAPE;
    *out = *in[0];
    out->dims[0] = attr->i[0];
    return LG_OK;
}

static lg_status scatter_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                               lg_shape *out) {
    if (in[0]->rank == 0 || in[0]->dims[0] != attr->i[0]) return LG_SHAPE;
    *out = *in[0];
    out->dims[0] = attr->i[1];
    return LG_OK;
}

static size_t row_length(const lg_shape *x) {
    return x->dims[0] == 0 ? 0 : lg_shape_count(*x) / x->dims[0];
}

static lg_status gather_forward(lg_evaluation *e) {
    const uint32_t *indices = e->attr->pointer;
    size_t bytes = row_length(e->in[0]) * e->k->size;
    for (size_t i = 0; i < e->attr->i[0]; i++)
        memcpy((unsigned char *)e->y + i * bytes, (const unsigned char *)e->x[0] + indices[i] * bytes, bytes);
    return LG_OK;
}

/* In f32, sums that may have more than 32 terms are computed in double. */
static size_t scatter_scratch(const lg_evaluation *e) {
    return e->k->dtype == LG_F32 && e->attr->i[0] > 32 ? e->count * sizeof(double) : 0;
}

static void scatter_in_double(lg_evaluation *e, size_t length) {
    const uint32_t *indices = e->attr->pointer;
    const float *x = e->x[0];
    double *sum = e->scratch;
    memset(sum, 0, e->count * sizeof *sum);
    for (size_t i = 0; i < e->attr->i[0]; i++)
        for (size_t j = 0; j < length; j++) sum[indices[i] * length + j] += (double)x[i * length + j];
    e->k->convert_in(e->count, sum, e->y);
}

static lg_status scatter_forward(lg_evaluation *e) {
    const uint32_t *indices = e->attr->pointer;
    size_t length = row_length(e->in[0]), bytes = length * e->k->size;
    if (scatter_scratch(e) > 0) {
        scatter_in_double(e, length);
        return LG_OK;
    }
    e->k->fill(e->count, 0.0, e->y);
    for (size_t i = 0; i < e->attr->i[0]; i++)
        e->k->axpy(length, 1.0, (const unsigned char *)e->x[0] + i * bytes,
                   (unsigned char *)e->y + indices[i] * bytes);
    return LG_OK;
}

static void gather_c(lg_c *c, const lg_evaluation *e) {
    lg_c_indices(c, e->attr->pointer, e->attr->i[0]);
    lg_c_call(c, "gather(%u, %zu, $i, $0, $y)", e->attr->i[0], row_length(e->in[0]));
}

static void scatter_c(lg_c *c, const lg_evaluation *e) {
    lg_c_indices(c, e->attr->pointer, e->attr->i[0]);
    lg_c_call(c, "scatter(%u, %zu, %u, $i, $0, $y)", e->attr->i[0], row_length(e->in[0]), e->attr->i[1]);
}

static void scatter_expand(lg_scalars *s, const lg_evaluation *e, const lg_scalar *const *x, lg_scalar *y) {
    const uint32_t *indices = e->attr->pointer;
    const size_t length = row_length(e->in[0]);
    for (size_t i = 0; i < e->count; i++) y[i] = lg_s_constant(s, 0.0);
    for (size_t i = 0; i < e->attr->i[0] * length; i++) {
        lg_scalar *to = &y[indices[i / length] * length + i % length];
        *to = lg_s_add(s, *to, x[0][i]);
    }
}

/* Derivatives share the indices, which lie in the tape's memory. */
static void gather_vjp(lg_reverse *r) {
    if (r->need[0]) r->out[0] = lg_record(r->tape, &lg_op_scatter, &r->g, 1, r->attr);
}
const lg_op lg_op_gather = {LG_OP("gather", 0, 1, 1, gather_shape, gather_forward, gather_vjp, lg_linear_jvp),
                            .payload = LG_PAYLOAD_INDICES, .write_c = gather_c, .expand = lg_moved_expand,
                            .terms = lg_no_terms};

static void scatter_vjp(lg_reverse *r) {
    if (r->need[0]) r->out[0] = lg_record(r->tape, &lg_op_gather, &r->g, 1, r->attr);
}
const lg_op lg_op_scatter = {
    LG_OP("scatter", 0, 1, 1, scatter_shape, scatter_forward, scatter_vjp, lg_linear_jvp),
    .payload = LG_PAYLOAD_INDICES, .write_c = scatter_c, .expand = scatter_expand,
    .scratch = scatter_scratch};

static lg_var index_rows(lg_tape *tape, const lg_op *op, lg_var x, const uint32_t *indices, uint32_t n,
                         uint32_t rows) {
    for (uint32_t i = 0; i < n; i++)
        if (indices[i] >= rows)
            return lg_tape_fail(tape, LG_INVALID_ARGUMENT, op->name,
                                "an index is not less than the number of rows");
    uint32_t *kept = lg_payload_allocate(tape, (size_t)n * sizeof *kept);
    if (kept == NULL) return LG_NONE;
    if (n > 0) memcpy(kept, indices, (size_t)n * sizeof *kept);
    return lg_record(tape, op, &x, 1, &(lg_attr){.i = {n, rows, 0, 0}, .pointer = kept});
}

lg_var lg_gather(lg_tape *tape, lg_var x, const uint32_t *indices, uint32_t n) {
    const lg_node *node = lg_node_of(tape, x, "gather");
    if (node == NULL) return LG_NONE;
    return index_rows(tape, &lg_op_gather, x, indices, n, node->shape.rank == 0 ? 0 : node->shape.dims[0]);
}

lg_var lg_scatter(lg_tape *tape, lg_var x, const uint32_t *indices, uint32_t n, uint32_t rows) {
    if (tape->status != LG_OK) return LG_NONE;
    return index_rows(tape, &lg_op_scatter, x, indices, n, rows);
}
