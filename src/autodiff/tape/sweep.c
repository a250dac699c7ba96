#include "autodiff/tape/sweep.h"

#include <string.h>

lg_node_range lg_range_of(const lg_var *newest, size_t n_newest, const lg_var *oldest, size_t n_oldest) {
    lg_node_range range = {UINT32_MAX, 0};
    for (size_t i = 0; i < n_oldest; i++) {
        if (oldest[i].index < range.lo) range.lo = oldest[i].index;
        if (oldest[i].index > range.hi) range.hi = oldest[i].index;
    }
    for (size_t i = 0; i < n_newest; i++)
        if (newest[i].index > range.hi) range.hi = newest[i].index;
    return range;
}

bool lg_valid_list(lg_tape *tape, const lg_var *list, size_t n, const char *name) {
    if (tape->status != LG_OK) return false;
    for (size_t i = 0; i < n; i++)
        if (lg_node_of(tape, list[i], name) == NULL) return false;
    return true;
}

bool lg_frozen(const lg_node *node, uint32_t input) {
    return input < 32 && ((node->op->frozen >> input) & 1u) != 0;
}

void lg_mark_reach(const lg_tape *tape, lg_node_range range, const lg_var *wrt, size_t n, uint8_t *reach) {
    for (size_t i = 0; i < n; i++) reach[wrt[i].index - range.lo] = 1;
    for (uint32_t i = range.lo; i <= range.hi; i++) {
        const lg_node *node = &tape->nodes[i];
        const uint32_t *parents = lg_parents_of(tape, node);
        for (uint32_t k = 0; k < node->inputs && !reach[i - range.lo]; k++)
            if (parents[k] >= range.lo && reach[parents[k] - range.lo] && !lg_frozen(node, k))
                reach[i - range.lo] = 1;
    }
}

bool lg_depends_on(lg_tape *tape, lg_var y, lg_var x) {
    if (!lg_valid_list(tape, (lg_var[]){y, x}, 2, "depends") || y.index < x.index) return false;
    const lg_node_range range = {x.index, y.index};
    const size_t length = (size_t)range.hi - range.lo + 1;
    uint8_t *reach = lg_pool_take(tape, length);
    if (reach == NULL) return false;
    memset(reach, 0, length);
    lg_mark_reach(tape, range, &x, 1, reach);
    const bool depends = reach[length - 1] != 0;
    lg_pool_give(tape, reach, length);
    return depends;
}

void lg_reverse_step(lg_tape *tape, lg_node_range range, const uint8_t *reach, struct lg_sweep *sweep,
                     uint32_t i, lg_var g, lg_var *in, bool *need, lg_var *out) {
    const lg_node *node = &tape->nodes[i];
    const uint32_t *parents = lg_parents_of(tape, node);
    lg_attr attr = node->attr;
    uint32_t inputs = node->inputs;
    for (uint32_t k = 0; k < inputs; k++) {
        in[k] = lg_var_at(tape, parents[k]);
        need[k] = parents[k] >= range.lo && reach[parents[k] - range.lo] && !lg_frozen(node, k);
        out[k] = LG_NONE;
    }
    const lg_op *op = lg_row_in_use(&tape->exchange, node->op);
    lg_reverse r = {op, tape, i, lg_var_at(tape, i), g, &attr, in, inputs, need, out, sweep, false};
    op->vjp(&r);
}
