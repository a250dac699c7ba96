/* Internals of the taped interpreter: tuples of variables, and functions that its files share. */
#ifndef LG_TAPED_INTERNAL_H
#define LG_TAPED_INTERNAL_H

#include "autodiff/ops/lie.h"
#include "core/core.h"
#include "liegrad/ops.h"
#include "liegrad/program.h"
#include "liegrad/taped.h"

/* A point of a space or an element of its algebra. */
typedef struct lg_parts {
    lg_var part[LG_TAPED_MAX_PARTS];
} lg_parts;

/* An lg_taped_interval in the interpreter's form. The step size is h, times `rows` if that is not LG_NONE. */
typedef struct lg_taped_span {
    lg_taped_time t; /* start of the step; t.step is LG_NONE */
    double h;
    lg_var rows; /* (B, 1) or LG_NONE */
    lg_var tall; /* `rows` with shape (B, 1, 1), to multiply parts of shape (B, k, d) */
    lg_var input;
} lg_taped_span;

/* Whether the parts have the shapes of a state of the space (of an algebra element if `algebra`). If `like`
 * is not NULL, they must also have the batch size of the parts `like` and, on R^n, their shape. If false, the
 * error is on the tape. */
bool lg_taped_fits(lg_tape *tape, const lg_space *space, bool algebra, const lg_var *parts,
                   const lg_var *like, const char *operation);

/* The time t + c h of a stage. Records nothing: the sum is recorded when a field uses the time. */
lg_taped_time lg_taped_stage_time(const lg_taped_span *over, double c);
/* x times over->rows, where x is a part of an algebra element; x itself if the step is a constant. */
lg_var lg_taped_by_rows(lg_tape *tape, const lg_taped_span *over, lg_var x);

/* Sets part[i] to the index of the part to which number i of a state belongs, for i < dim. */
void lg_taped_number_parts(const lg_space *space, uint8_t *part);

/* Convert algebra elements from the plain interpreter's layout, (B, algebra_dim), to parts, and back. */
lg_status lg_taped_split_algebra(lg_tape *tape, const lg_space *space, lg_var a, lg_var *parts);
lg_var lg_taped_join_algebra(lg_tape *tape, const lg_space *space, const lg_var *parts);

/* out = [a, b]; all three are arrays of parts. Zero on R^n. `out` may be an input. */
lg_status lg_taped_bracket(lg_tape *tape, const lg_space *space, const lg_var *a, const lg_var *b,
                           lg_var *out);

/* out = the projection of y onto the manifold, as lg_space_project computes it; both are arrays of parts. */
lg_status lg_taped_project(lg_tape *tape, const lg_space *manifold, const lg_var *y, lg_var *out);

/* One step of LG_SCHEME_IMPLICIT or LG_SCHEME_SLGI; `out` may be `y`. */
lg_status lg_taped_implicit_step(lg_tape *tape, const lg_scheme *scheme, const lg_taped_ode *ode,
                                 const lg_taped_span *over, const lg_parts *y, lg_parts *out);

/* Adds the function step (x, u, h) -> next; x, and u if it is there, are the inputs of the function field. */
lg_status lg_program_put_step(lg_program *program, double h_low, double h_high, lg_record_function record,
                              void *user, lg_error *error);
/* Adds the functions velocity (x, u) -> x' and jac_velocity, unless the program has them, to a program with
 * the function field (x, u -> algebra element of the space); u may be missing. */
lg_status lg_program_add_velocity(lg_program *program, const lg_space *space, lg_error *error);

/* Equations r(x) = 0 of independent rows, whose results do not depend on each other; x and r are (B, n). They
 * may use variables that were made before, and must not keep variables that they make. */
typedef struct lg_root {
    lg_status (*equations)(void *user, lg_tape *tape, lg_var x, lg_var *r);
    void *user;
    double scale; /* usual size of x, or of what x is added to */
    /* NULL: a row without a solution becomes NaN. Otherwise that is an error, and the iteration starts at 0;
     * part(user, k, n) sets the equations to those of k/n of the step. */
    void (*part)(void *user, int part, int parts);
} lg_root;
/* Solves for x near `first` (B, n) by Newton's method. First and second derivatives of *x are exact. Errors
 * with `part` that are not put on the tape (lg_root_failed): LG_NO_CONVERGENCE, LG_NOT_FINITE (at 0). In a
 * program, without `part`, six steps are recorded; rows that these do not solve become infinite or NaN. */
lg_status lg_taped_root(lg_tape *tape, const lg_root *root, lg_var first, lg_var *x);
bool lg_root_failed(lg_status status);

/* Joins the arrays (B, ...) along their second axis. */
static inline lg_var lg_joined(lg_tape *tape, const lg_var *parts, uint32_t n) {
    return n == 1 ? parts[0] : lg_concat(tape, parts, n, 1);
}

#endif
