/* What the recorded and the unrecorded sweeps share: the nodes between the oldest variable asked for and the
 * newest output, which of them take part, and one reverse step. */
#ifndef LG_SWEEP_H
#define LG_SWEEP_H

#include "autodiff/tape/tape_internal.h"

typedef struct lg_range {
    uint32_t lo, hi; /* inclusive */
} lg_range;

lg_range lg_range_of(const lg_var *newest, size_t n_newest, const lg_var *oldest, size_t n_oldest);
/* Resolves a list of handles; false with the error set when one is bad. */
bool lg_valid_list(lg_tape *tape, const lg_var *list, size_t n, const char *name);
/* Whether the operation is constant to differentiation in this input. */
bool lg_frozen(const lg_node *node, uint32_t input);
/* reach[i - lo] = 1 when node i depends on one of the variables. `reach` is zeroed. */
void lg_mark_reach(const lg_tape *tape, lg_range range, const lg_var *wrt, size_t n, uint8_t *reach);
/* Calls node i's vjp with cotangent g; out holds the inputs' cotangents. `sweep` is NULL when recorded. */
void lg_reverse_step(lg_tape *tape, lg_range range, const uint8_t *reach, struct lg_sweep *sweep, uint32_t i,
                     lg_var g, lg_var *in, bool *need, lg_var *out);

static inline const uint32_t *lg_parents_of(const lg_tape *tape, const lg_node *node) {
    return &tape->parents[node->parents];
}

#endif
