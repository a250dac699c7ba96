/* A piece is an operation with shapes and attributes. Pieces are taken from the cases of the gradient check
 * (liegrad/gradcheck.h), which cover every operation with all relevant shapes and attributes: each case is
 * recorded with its first and second derivatives, and each node on the tape becomes a piece. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "autodiff/ops/op_table.h"
#include "autodiff/random/random.h"
#include "gradcheck/cases.h"

enum { LARGEST = 160, EACH_ROW = 40 };

typedef struct row {
    piece *piece[EACH_ROW];
    uint32_t pieces;
} row;
static row rows[LG_OPS_MOST];

/* ---- the piece of a tape's node ---- */

static lg_attr plain_attr(const lg_node *n) {
    lg_attr attr = n->attr;
    for (uint32_t k = 0; k < LG_WHOLE_COUNT; k++)
        if (n->op->follows >> k & 1) attr.i[k] = 0;
    if (n->op->payload == LG_PAYLOAD_KEPT) attr.pointer = NULL;
    return attr;
}

static bool fits(const lg_tape *tape, const lg_node *n) {
    if (n->op->forward == NULL || n->op->payload == LG_PAYLOAD_IN_PROCESS || n->inputs > MOST_OPERANDS)
        return false;
    if (n->count == 0 || n->count > LARGEST) return false;
    for (uint32_t k = 0; k < n->inputs; k++) {
        const lg_node *in = &tape->nodes[tape->parents[n->parents + k]];
        if (in->count == 0 || in->count > LARGEST || in->value == NULL) return false;
    }
    return true;
}

/* Whether there is such a piece already. Real numbers in attributes and payload are not compared. */
static bool known(const lg_tape *tape, const lg_node *n, const lg_attr *attr) {
    const row *r = &rows[lg_op_place(n->op)];
    for (uint32_t p = 0; p < r->pieces; p++) {
        const piece *other = r->piece[p];
        bool same = other->inputs == n->inputs && memcmp(other->attr.i, attr->i, sizeof attr->i) == 0;
        for (uint32_t k = 0; same && k < n->inputs; k++)
            same = lg_same_shape(&other->in[k], &tape->nodes[tape->parents[n->parents + k]].shape);
        if (same) return true;
    }
    return false;
}

static void keep_payload(piece *p) {
    const size_t bytes = p->op->payload == LG_PAYLOAD_REALS     ? p->inputs * sizeof(double)
                         : p->op->payload == LG_PAYLOAD_INDICES ? p->attr.i[0] * sizeof(uint32_t)
                                                                : 0;
    if (bytes == 0) return;
    void *own = room(bytes, 1);
    memcpy(own, p->attr.pointer, bytes);
    p->attr.pointer = own;
}

/* ---- axes that can be rows ---- */

static bool holds_with(const piece *p, uint32_t set, uint32_t length) {
    const lg_shape *shapes[MOST_OPERANDS];
    lg_shape in[MOST_OPERANDS], out = p->out, wanted;
    for (uint32_t k = 0; k < p->inputs; k++) {
        in[k] = p->in[k];
        if (set >> k & 1) in[k].dims[0] = length;
        shapes[k] = &in[k];
    }
    out.dims[0] = length;
    wanted = out;
    return p->op->shape(shapes, p->inputs, &p->attr, &out) == LG_OK && lg_same_shape(&out, &wanted);
}

/* Finds the largest set of inputs whose first axis can have any length if the output's first axis has the
 * same length. */
static void find_batches(piece *p) {
    uint32_t best = 0;
    for (uint32_t set = 1; p->out.rank > 0 && set < 1u << p->inputs; set++) {
        bool holds = __builtin_popcount(set) > __builtin_popcount(best);
        for (uint32_t k = 0; holds && k < p->inputs; k++)
            holds = !(set >> k & 1) || (p->in[k].rank > 0 && p->in[k].dims[0] == p->out.dims[0]);
        for (uint32_t length = 1; holds && length <= 7; length++) holds = holds_with(p, set, length);
        if (holds) best = set;
    }
    p->batches = best != 0;
    for (uint32_t k = 0; k < p->inputs; k++) p->batched[k] = best >> k & 1;
}

/* Whether the operation is elementwise and accepts inputs of any common shape. */
static bool takes_any_shape(const piece *p) {
    static const lg_shape tried[] = {{0, {0}}, {1, {7}}, {2, {2, 5}}};
    const lg_shape *shapes[MOST_OPERANDS];
    bool takes = p->op->element != NULL;
    for (size_t i = 0; takes && i < LG_COUNT(tried); i++) {
        lg_shape out = tried[i];
        for (uint32_t k = 0; k < p->inputs; k++) shapes[k] = &tried[i];
        takes = p->op->shape(shapes, p->inputs, &p->attr, &out) == LG_OK && lg_same_shape(&out, &tried[i]);
    }
    return takes;
}

static void add_piece(const lg_tape *tape, const lg_node *n) {
    const lg_attr attr = plain_attr(n);
    row *r = &rows[lg_op_place(n->op)];
    if (r->pieces == EACH_ROW || !fits(tape, n) || known(tape, n, &attr)) return;
    piece *p = room(1, sizeof *p);
    *p = (piece){.op = n->op, .attr = attr, .inputs = n->inputs, .out = n->shape};
    keep_payload(p);
    for (uint32_t k = 0; k < p->inputs; k++) {
        const lg_node *in = &tape->nodes[tape->parents[n->parents + k]];
        p->in[k] = in->shape;
        p->point[k] = room(in->count, sizeof(double));
        memcpy(p->point[k], in->value, in->count * sizeof(double));
    }
    p->any_shape = takes_any_shape(p);
    find_batches(p);
    r->piece[r->pieces++] = p;
}

/* ---- pieces of all cases ---- */

static void put_inputs(lg_tape *tape, const lg_gradcheck_function *f, lg_rng *rng, lg_var *x) {
    for (uint32_t k = 0; k < f->inputs; k++) {
        const lg_gradcheck_argument *a = &f->arguments[k];
        const bool plain = a->low == 0.0 && a->high == 0.0;
        const size_t count = lg_shape_count(a->shape);
        double *values = room(count, sizeof *values);
        for (size_t i = 0; i < count; i++)
            values[i] = a->values != NULL
                            ? a->values[i]
                            : lg_rng_uniform_in(rng, plain ? -1.0 : a->low, plain ? 1.0 : a->high);
        x[k] = lg_input(tape, a->shape, values);
        free(values);
    }
}

/* A weighted sum of y. No symmetry can make the gradient vanish. */
static lg_var weighted(lg_tape *tape, lg_var y, lg_rng *rng) {
    const lg_shape shape = lg_var_shape(tape, y);
    const size_t count = lg_shape_count(shape);
    double *c = room(count + 1, sizeof *c);
    for (size_t i = 0; i < count; i++) c[i] = lg_rng_uniform_in(rng, 0.5, 1.5);
    const lg_var weights = lg_input(tape, shape, c);
    free(c);
    return lg_mul(tape, weights, y);
}

/* Records the case with its derivatives. An order that does not exist is refused, and the tape keeps this
 * error; what was recorded before stays usable. */
static void record_case(lg_tape *tape, const lg_gradcheck_function *f, lg_rng *rng) {
    lg_var x[LG_GRADCHECK_MAX_INPUTS], d[LG_GRADCHECK_MAX_INPUTS], g[LG_GRADCHECK_MAX_INPUTS], v;
    put_inputs(tape, f, rng, x);
    const lg_var y = f->build(f->user, tape, x);
    if (lg_grad(tape, lg_sum(tape, weighted(tape, y, rng)), x, f->inputs, g) != LG_OK) return;
    for (uint32_t k = 0; k < f->inputs; k++) d[k] = weighted(tape, x[k], rng);
    if (lg_jvp(tape, &y, 1, x, d, f->inputs, &v) != LG_OK) return;
    (void)lg_jvp(tape, g, f->inputs, x, d, f->inputs, d);
    (void)lg_grad(tape, lg_sum(tape, weighted(tape, g[0], rng)), x, f->inputs, g);
}

void find_pieces(void) {
    lg_tape *tape;
    lg_rng rng;
    lg_rng_seed(&rng, 1, 1);
    if (lg_tape_create(NULL, NULL, &tape) != LG_OK) stop("no memory");
    const lg_gradcheck_case *test;
    for (size_t i = 0; (test = lg_gradcheck_operation(i)) != NULL; i++) {
        lg_tape_reset(tape);
        record_case(tape, &test->function, &rng);
        for (uint32_t n = 0; n < tape->count; n++) add_piece(tape, &tape->nodes[n]);
    }
    lg_tape_destroy(tape);
    for (uint32_t i = 0; lg_ops[i] != NULL; i++)
        if (rows[i].pieces == 0 && lg_ops[i]->forward != NULL && lg_ops[i]->payload != LG_PAYLOAD_IN_PROCESS)
            stop("the registry of gradient checks has no operation '%s' that can be recorded here",
                 lg_ops[i]->name);
}

size_t rows_with_pieces(void) {
    size_t count = 0;
    for (uint32_t i = 0; lg_ops[i] != NULL; i++) count += rows[i].pieces > 0;
    return count;
}

static const piece *draw_of(lg_rng *rng, const row *r) {
    return r->piece[lg_rng_below(rng, r->pieces)];
}

/* All operations are equally likely; products, which plans turn into layers, are drawn more often. */
const piece *draw_piece(lg_rng *rng) {
    uint32_t ops = 0, layer = 0;
    for (; lg_ops[ops] != NULL; ops++)
        if (lg_ops[ops]->begins_layer != NULL) layer = ops;
    if (chance(rng, 0.08)) return draw_of(rng, &rows[layer]);
    for (;;) {
        const row *r = &rows[lg_rng_below(rng, ops)];
        if (r->pieces > 0) return draw_of(rng, r);
    }
}

const piece *draw_layer_end(lg_rng *rng) {
    for (uint32_t i = 0; lg_ops[i] != NULL; i++)
        if (lg_ops[i]->ends_layer) return draw_of(rng, &rows[i]);
    return draw_piece(rng);
}

const piece *piece_named(const char *operation) {
    const row *r = &rows[lg_op_place(lg_op_named(operation))];
    for (uint32_t p = 0; p < r->pieces; p++)
        if (r->piece[p]->any_shape) return r->piece[p];
    stop("no operation '%s' of any shape", operation);
}
