/* Maps of so(3) and se(3) as single operations on the tape, because integrators on manifolds spend most of
 * their time in them. The last axis holds the vector, all other axes are batch. All vectors have the same
 * shape (..., 3), and so has the result. Differentiable to any order. A "second half" is the second vector of
 * a pair as liegrad/geometry.h defines it. */
#ifndef LG_LIE_H
#define LG_LIE_H

#include "liegrad/tape.h"

/* from + weight by, for any shape. */
lg_var lg_taped_moved(lg_tape *tape, lg_var from, double weight, lg_var by);
/* exp(u) x, or exp(u) X for row-major matrices X (..., 9). */
lg_var lg_so3_exp_rows(lg_tape *tape, lg_var u, lg_var x);
/* dexp_u(v) and dexp_u^-1(v). */
lg_var lg_so3_dexp_rows(lg_tape *tape, lg_var u, lg_var v);
lg_var lg_so3_dexpinv_rows(lg_tape *tape, lg_var u, lg_var v);
/* exp(u) p + dexp_u(v) x exp(u) q: the second half of exp(u, v) . (q, p). Its first half is exp(u) q. */
lg_var lg_se3_act_rows(lg_tape *tape, lg_var u, lg_var v, lg_var q, lg_var p);
/* The second half of dexp_(A, a)^-1(B, b). Its first half is dexp_A^-1(B). */
lg_var lg_se3_dexpinv_rows(lg_tape *tape, lg_var A, lg_var a, lg_var B, lg_var b);

#endif
