/* Inside of the taped interpreter: tuples of variables, and what its files need of each other. */
#ifndef LG_TAPED_INTERNAL_H
#define LG_TAPED_INTERNAL_H

#include "core/core.h"
#include "liegrad/taped.h"

/* A point of a space or an element of its algebra. */
typedef struct lg_parts {
    lg_var part[LG_TAPED_MAX_PARTS];
} lg_parts;

/* An interval as the interpreter uses it. The step is h, times rows where that is not LG_NONE. */
typedef struct lg_taped_span {
    lg_taped_time t; /* `step` is LG_NONE */
    double h;
    lg_var rows; /* (B, 1) */
    lg_var tall; /* the same as (B, 1, 1), for parts (B, k, d) */
    lg_var input;
} lg_taped_span;

/* Whether the parts have the shapes of a state of the space, or of an algebra element; `like`: other parts
 * with as many rows and, on R^n, of the same shape, or NULL. If not, the error is on the tape. */
bool lg_taped_fits(lg_tape *tape, const lg_space *space, bool algebra, const lg_var *parts,
                   const lg_var *like, const char *operation);

/* t + c h; nothing is recorded. */
lg_taped_time lg_taped_stage_time(const lg_taped_span *over, double c);
/* x, a part of an algebra element, times the rows of the step: x itself where the step is a constant. */
lg_var lg_taped_by_rows(lg_tape *tape, const lg_taped_span *over, lg_var x);

/* part[i]: the part that number i of a state (dim numbers) belongs to. */
void lg_taped_number_parts(const lg_space *space, uint8_t *part);

/* Elements of the algebra as the plain interpreter has them, (B, algebra_dim), to parts, and back. */
lg_status lg_taped_split_algebra(lg_tape *tape, const lg_space *space, lg_var a, lg_var *parts);
lg_var lg_taped_join_algebra(lg_tape *tape, const lg_space *space, const lg_var *parts);

/* out = [a, b]; arrays of parts, zeros on R^n. `out` may be an input. */
lg_status lg_taped_bracket(lg_tape *tape, const lg_space *space, const lg_var *a, const lg_var *b,
                           lg_var *out);

/* out = the nearby point of the manifold as lg_space_project finds it; arrays of parts. */
lg_status lg_taped_project(lg_tape *tape, const lg_space *manifold, const lg_var *y, lg_var *out);

/* from + weight by */
lg_var lg_taped_moved(lg_tape *tape, lg_var from, double weight, lg_var by);

/* The inverse of a (n, n) in place, by Gauss-Jordan with row pivots; false: singular. `swaps`: n numbers. */
bool lg_taped_invert(size_t n, double *a, double *swaps);

/* One step of LG_SCHEME_IMPLICIT or LG_SCHEME_SLGI; `out` may be `y`. */
lg_status lg_taped_implicit_step(lg_tape *tape, const lg_scheme *scheme, const lg_taped_ode *ode,
                                 const lg_taped_span *over, const lg_parts *y, lg_parts *out);

#endif
