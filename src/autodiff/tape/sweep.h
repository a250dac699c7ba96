/* Functions that the recorded and the unrecorded sweeps share: the range of nodes between the oldest wanted
 * variable and the newest output, the nodes of it that take part, and one reverse step. */
#ifndef LG_SWEEP_H
#define LG_SWEEP_H

#include "autodiff/tape/tape_internal.h"

typedef struct lg_node_range {
    uint32_t lo, hi; /* inclusive */
} lg_node_range;

lg_node_range lg_range_of(const lg_var *newest, size_t n_newest, const lg_var *oldest, size_t n_oldest);
/* Checks a list of handles. Returns false, with the error set, when one is invalid. */
bool lg_valid_list(lg_tape *tape, const lg_var *list, size_t n, const char *name);
/* Whether differentiation treats this input of the node as a constant. */
bool lg_frozen(const lg_node *node, uint32_t input);
/* Sets reach[i - lo] = 1 for every node i that is one of the variables or depends on one. `reach` must be
 * zeroed by the caller. */
void lg_mark_reach(const lg_tape *tape, lg_node_range range, const lg_var *wrt, size_t n, uint8_t *reach);
/* A tensor of v's shape that is 1 at element `one` and 0 elsewhere. */
lg_var lg_unit_like(lg_tape *tape, lg_var v, size_t one);
/* Repeats each row of x `copies` times in succession: (B, ...) -> (B copies, ...). */
lg_var lg_record_copies(lg_tape *tape, lg_var x, uint32_t copies);
/* Unit vectors e_first, e_(first + 1), ... with n numbers, `count` of them for each of `rows` rows: (rows
 * count, n). Where there is no such unit vector, the numbers are 0. */
lg_var lg_record_units(lg_tape *tape, uint32_t rows, uint32_t count, ptrdiff_t first, uint32_t n);
/* Calls node i's vjp with cotangent g. Afterwards `out` holds the cotangents of the inputs. `sweep` is NULL
 * in a recorded sweep. */
void lg_reverse_step(lg_tape *tape, lg_node_range range, const uint8_t *reach, struct lg_sweep *sweep,
                     uint32_t i, lg_var g, lg_var *in, bool *need, lg_var *out);

static inline const uint32_t *lg_parents_of(const lg_tape *tape, const lg_node *node) {
    return &tape->parents[node->parents];
}

#endif
