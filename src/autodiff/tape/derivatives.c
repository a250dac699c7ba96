/* Recorded reverse and forward mode, and functions built on them.
 *
 * Every sweep visits only the nodes lo..hi, where lo is the oldest variable of the request and hi the newest
 * output. A node takes part when it depends on one of the variables through inputs that are not frozen. */
#include "autodiff/tape/sweep.h"

#include <string.h>

/* ---- recorded reverse mode ---- */

static void recorded_sweep(lg_tape *tape, lg_node_range range, const uint8_t *reach, lg_var *adjoint) {
    lg_var in[LG_MAX_INPUTS], out[LG_MAX_INPUTS];
    bool need[LG_MAX_INPUTS];
    for (uint32_t i = range.hi + 1; i-- > range.lo && tape->status == LG_OK;) {
        lg_var g = adjoint[i - range.lo];
        uint32_t inputs = tape->nodes[i].inputs;
        if (inputs == 0 || lg_is_none(g) || !reach[i - range.lo]) continue;
        lg_reverse_step(tape, range, reach, NULL, i, g, in, need, out);
        for (uint32_t k = 0; k < inputs && tape->status == LG_OK; k++) {
            if (!need[k] || lg_is_none(out[k])) continue;
            lg_var *slot = &adjoint[in[k].index - range.lo];
            *slot = lg_add_or(tape, *slot, out[k]);
        }
    }
}

/* Sets out[i] to the derivative found for list[i], or to zeros when none was found. `out` is written only if
 * everything succeeded. */
static void collect(lg_tape *tape, lg_node_range range, lg_var *found, const lg_var *list, size_t n,
                    lg_var *out) {
    for (size_t i = 0; i < n && tape->status == LG_OK; i++) {
        lg_var *slot = &found[list[i].index - range.lo];
        if (lg_is_none(*slot)) *slot = lg_zeros_like(tape, list[i]);
    }
    for (size_t i = 0; i < n && tape->status == LG_OK; i++) out[i] = found[list[i].index - range.lo];
}

/* Checks that a request has what it needs: `pairs` variables and as many of the same shapes, a list of n
 * variables and, unless it is empty, a place for n results. */
static lg_status check_request(lg_tape *tape, const char *name, const lg_var *x, const lg_var *like,
                               size_t pairs, const lg_var *list, size_t n, const lg_var *out,
                               const char *fault) {
    const bool given =
        (pairs == 0 || (x != NULL && like != NULL)) && (n == 0 || (list != NULL && out != NULL));
    LG_TRY(lg_tape_needs(tape, name, given));
    if (!lg_valid_list(tape, x, pairs, name) || !lg_valid_list(tape, like, pairs, name) ||
        !lg_valid_list(tape, list, n, name))
        return tape->status;
    for (size_t j = 0; j < pairs && n > 0; j++)
        if (!lg_same_shape(&lg_node_at(tape, x[j])->shape, &lg_node_at(tape, like[j])->shape)) {
            lg_tape_fail(tape, LG_SHAPE, name, fault);
            return tape->status;
        }
    return LG_OK;
}

lg_status lg_vjp(lg_tape *tape, const lg_var *y, const lg_var *cotangent, size_t ny, const lg_var *wrt,
                 size_t n, lg_var *out) {
    LG_TRY(check_request(tape, "vjp", y, cotangent, ny, wrt, n, out,
                         "a cotangent has another shape than its output"));
    if (n == 0) return LG_OK;
    const lg_node_range range = lg_range_of(y, ny, wrt, n);
    size_t length = (size_t)range.hi - range.lo + 1;
    size_t bytes = length * (sizeof(lg_var) + 1);
    lg_var *adjoint = lg_pool_take(tape, bytes);
    if (adjoint == NULL) return tape->status;
    memset(adjoint, 0, bytes);
    uint8_t *reach = (uint8_t *)(adjoint + length);
    lg_mark_reach(tape, range, wrt, n, reach);
    for (size_t j = 0; j < ny; j++) {
        if (y[j].index < range.lo || !reach[y[j].index - range.lo]) continue;
        lg_var *slot = &adjoint[y[j].index - range.lo];
        *slot = lg_add_or(tape, *slot, cotangent[j]);
    }
    recorded_sweep(tape, range, reach, adjoint);
    collect(tape, range, adjoint, wrt, n, out);
    lg_pool_give(tape, adjoint, bytes);
    return tape->status;
}

lg_status lg_grad(lg_tape *tape, lg_var y, const lg_var *wrt, size_t n, lg_var *out) {
    LG_TRY(lg_tape_needs(tape, "grad", n == 0 || (wrt != NULL && out != NULL)));
    if (!lg_valid_list(tape, &y, 1, "grad") || !lg_valid_list(tape, wrt, n, "grad")) return tape->status;
    lg_var one = lg_full(tape, lg_node_at(tape, y)->shape, 1.0);
    if (tape->status != LG_OK) return tape->status;
    return lg_vjp(tape, &y, &one, 1, wrt, n, out);
}

/* ---- recorded forward mode ---- */

/* Clears `reach` for nodes that no output depends on. */
static void keep_needed(lg_tape *tape, lg_node_range range, const lg_var *y, size_t ny, uint8_t *reach,
                        uint8_t *needed) {
    for (size_t i = 0; i < ny; i++)
        if (y[i].index >= range.lo) needed[y[i].index - range.lo] = 1;
    for (uint32_t i = range.hi + 1; i-- > range.lo;) {
        if (!needed[i - range.lo]) {
            reach[i - range.lo] = 0;
            continue;
        }
        const lg_node *node = &tape->nodes[i];
        const uint32_t *parents = lg_parents_of(tape, node);
        for (uint32_t k = 0; k < node->inputs; k++)
            if (parents[k] >= range.lo && !lg_frozen(node, k)) needed[parents[k] - range.lo] = 1;
    }
}

/* If variable x[i] depends on another variable x[j], its tangent is the sum of its own direction and the
 * tangent that arrives through x[j]. This agrees with reverse mode, which returns total derivatives. */
static void forward_sweep(lg_tape *tape, lg_node_range range, const uint8_t *reach, lg_var *tangent) {
    lg_var in[LG_MAX_INPUTS], tangents[LG_MAX_INPUTS];
    for (uint32_t i = range.lo; i <= range.hi && tape->status == LG_OK; i++) {
        const lg_node *node = &tape->nodes[i];
        if (!reach[i - range.lo]) continue;
        const uint32_t *parents = lg_parents_of(tape, node);
        lg_attr attr = node->attr;
        bool any = false;
        for (uint32_t k = 0; k < node->inputs; k++) {
            in[k] = lg_var_at(tape, parents[k]);
            tangents[k] =
                parents[k] >= range.lo && !lg_frozen(node, k) ? tangent[parents[k] - range.lo] : LG_NONE;
            any = any || !lg_is_none(tangents[k]);
        }
        if (!any) continue;
        const lg_op *op = lg_row_in_use(&tape->exchange, node->op);
        const lg_forward f = {op, tape, lg_var_at(tape, i), &attr, in, tangents, node->inputs};
        tangent[i - range.lo] = lg_add_or(tape, tangent[i - range.lo], op->jvp(&f));
    }
}

lg_status lg_jvp(lg_tape *tape, const lg_var *y, size_t ny, const lg_var *x, const lg_var *direction,
                 size_t nx, lg_var *out) {
    LG_TRY(check_request(tape, "jvp", x, direction, nx, y, ny, out,
                         "a tangent has another shape than its variable"));
    if (ny == 0) return LG_OK;
    lg_node_range range = lg_range_of(y, ny, x, nx);
    for (size_t j = 0; j < ny; j++)
        if (y[j].index < range.lo) range.lo = y[j].index;
    size_t length = (size_t)range.hi - range.lo + 1;
    size_t bytes = length * (sizeof(lg_var) + 2);
    lg_var *tangent = lg_pool_take(tape, bytes);
    if (tangent == NULL) return tape->status;
    memset(tangent, 0, bytes);
    uint8_t *reach = (uint8_t *)(tangent + length), *needed = reach + length;
    lg_mark_reach(tape, range, x, nx, reach);
    keep_needed(tape, range, y, ny, reach, needed);
    for (size_t i = 0; i < nx; i++) {
        lg_var *slot = &tangent[x[i].index - range.lo];
        *slot = lg_add_or(tape, *slot, direction[i]);
    }
    forward_sweep(tape, range, reach, tangent);
    collect(tape, range, tangent, y, ny, out);
    lg_pool_give(tape, tangent, bytes);
    return tape->status;
}

/* ---- functions built on both modes ---- */

lg_var lg_unit_like(lg_tape *tape, lg_var v, size_t one) {
    const lg_node *like = lg_node_at(tape, v);
    const size_t count = like->count;
    void *values;
    const lg_var unit = lg_input_buffer(tape, like->shape, &values);
    if (lg_is_none(unit)) return unit;
    tape->k->fill(count, 0.0, values);
    tape->k->fill(1, 1.0, (unsigned char *)values + one * tape->k->size);
    return unit;
}

lg_var lg_record_copies(lg_tape *tape, lg_var x, uint32_t copies) {
    const lg_shape shape = lg_var_shape(tape, x);
    if (shape.rank == 0 || copies == 1) return x;
    const uint32_t rows = shape.dims[0], length = (uint32_t)(lg_shape_count(shape) / rows);
    lg_shape all = shape;
    all.dims[0] = rows * copies;
    const lg_var one = lg_reshape(tape, x, lg_shape3(rows, 1, length));
    return lg_reshape(tape, lg_broadcast_to(tape, one, lg_shape3(rows, copies, length)), all);
}

lg_var lg_record_units(lg_tape *tape, uint32_t rows, uint32_t count, ptrdiff_t first, uint32_t n) {
    void *values = NULL;
    const lg_var units = lg_input_buffer(tape, lg_shape3(1, count, n), &values);
    if (lg_is_none(units)) return units;
    tape->k->fill((size_t)count * n, 0.0, values);
    for (ptrdiff_t i = 0, at = first; i < count; i++, at++)
        if (at >= 0 && at < n)
            tape->k->fill(1, 1.0, (unsigned char *)values + (size_t)(i * n + at) * tape->k->size);
    const lg_var all = lg_broadcast_to(tape, units, lg_shape3(rows, count, n));
    return lg_reshape(tape, all, lg_shape2(rows * count, n));
}

static lg_var jacobian_row(lg_tape *tape, lg_var y, lg_var x, size_t row) {
    lg_var seed = lg_unit_like(tape, y, row), out = LG_NONE;
    if (lg_vjp(tape, &y, &seed, 1, &x, 1, &out) != LG_OK) return LG_NONE;
    return lg_reshape(tape, out, lg_shape2(1, (uint32_t)lg_node_at(tape, x)->count));
}

static lg_var jacobian_column(lg_tape *tape, lg_var y, lg_var x, size_t column) {
    lg_var seed = lg_unit_like(tape, x, column), out = LG_NONE;
    if (lg_jvp(tape, &y, 1, &x, &seed, 1, &out) != LG_OK) return LG_NONE;
    return lg_reshape(tape, out, lg_shape2((uint32_t)lg_node_at(tape, y)->count, 1));
}

lg_var lg_jacobian(lg_tape *tape, lg_var y, lg_var x) {
    if (!lg_valid_list(tape, &y, 1, "jacobian") || !lg_valid_list(tape, &x, 1, "jacobian")) return LG_NONE;
    size_t rows = lg_node_at(tape, y)->count, columns = lg_node_at(tape, x)->count;
    bool reverse = rows <= columns;
    size_t passes = reverse ? rows : columns;
    if (passes == 0) return lg_full(tape, lg_shape2((uint32_t)rows, (uint32_t)columns), 0.0);
    lg_var whole = LG_NONE;
    for (size_t at = 0; at < passes && tape->status == LG_OK;) {
        lg_var parts[LG_MAX_INPUTS];
        size_t n = 0;
        if (!lg_is_none(whole)) parts[n++] = whole;
        for (; n < LG_MAX_INPUTS && at < passes; at++)
            parts[n++] = reverse ? jacobian_row(tape, y, x, at) : jacobian_column(tape, y, x, at);
        whole = lg_concat(tape, parts, n, reverse ? 0 : 1);
    }
    return tape->status == LG_OK ? whole : LG_NONE;
}

lg_var lg_hvp(lg_tape *tape, lg_var y, lg_var x, lg_var v) {
    lg_var gradient, product, all[3] = {y, x, v};
    if (!lg_valid_list(tape, all, 3, "hvp")) return LG_NONE;
    if (lg_grad(tape, y, &x, 1, &gradient) != LG_OK) return LG_NONE;
    if (lg_jvp(tape, &gradient, 1, &x, &v, 1, &product) != LG_OK) return LG_NONE;
    return product;
}
