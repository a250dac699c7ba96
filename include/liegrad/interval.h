/* Interval evaluation of programs: bounds of the outputs of a function over boxes of its inputs. The library
 * is liegrad; docs/certificates.md is the guide.
 *
 *   lg_interval *f = NULL;
 *   const size_t functions[2] = {field, jac_field};
 *   status = lg_interval_create(program, functions, 2, NULL, &f, &error);
 *   void *work = aligned_alloc(64, lg_interval_work_size(f));
 *   status = lg_interval_eval(f, boxes, lower, upper, low, high, flags, work, &error);
 *
 * Meaning. The functions are functions of real numbers here: for every point of a box, the exact value lies
 * between the bounds. All bounds are rounded outward, for which the thread must round to nearest (the mode
 * FE_TONEAREST, the default). How far they are from the true range, in units of 2^-52
 * of the bound and 2^-1074: sums, products, quotients and roots 1; functions such as sin 12, exp and sigmoid
 * 14; whole powers 1.2 n more; dexpinv coefficients 180. sin and cos have 2^-100 |x| more, and -1 and 1 where
 * |x| exceeds 1e6. Stumpff functions at numbers have 132 units of their value at 0 for w >= 0 (c_0 2^-104
 * sqrt(w) more), of their own for w < 0; over boxes of w > 0 they are the value at the middle and a slope.
 * The values that lg_plan computes are rounded and may lie outside of bounds that are a few units apart.
 * Constants and parameters are the doubles that the program stores (`widen`: they, or any number up to one
 * unit in the last place away). Where an operation is not defined on all of a box (division by an interval
 * with 0, the root or the logarithm of a negative number), and where a bound would overflow, the bounds of
 * its result are -inf and inf. NaN never occurs. 0 x and x - x are 0, whatever the bounds of x are.
 *
 * Flags. Bounds alone do not show whether the function is defined, or whether it jumps. So each output of
 * each box has a flag, the highest level that its operations prove (docs/certificates.md, "Flags"). Two boxes
 * that meet at a jump never both pass.
 *
 * Choices. lg_ge and lg_sign are 0 or 1, -1 or 1, or both where the box does not decide; lg_select then has
 * the hull of both values. The derivative of a maximum (lg_max, lg_abs, lg_relu) at a kink is the hull of
 * both slopes. So the Jacobian over a box (lg_program_derive) contains all slopes of the function there, if
 * the function's flags are at least LG_INTERVAL_LIPSCHITZ and the Jacobian's at least LG_INTERVAL_DEFINED. */
#ifndef LIEGRAD_INTERVAL_H
#define LIEGRAD_INTERVAL_H

#include "liegrad/program.h"

LG_BEGIN_DECLS

typedef struct lg_interval lg_interval;

/* What holds on all of a box; each level contains those before it. */
typedef enum lg_interval_flag {
    LG_INTERVAL_UNDEFINED,     /* nothing is known: it may be undefined at points (IEEE 1788: trv) */
    LG_INTERVAL_DEFINED,       /* defined; it may jump (def) */
    LG_INTERVAL_CONTINUOUS,    /* continuous; a slope may be infinite, or stopped by lg_stop_gradient (dac) */
    LG_INTERVAL_LIPSCHITZ,     /* Lipschitz continuous; the derivative's bounds contain all slopes */
    LG_INTERVAL_DIFFERENTIABLE /* continuously differentiable. The standard's com is dac with finite bounds;
                                * its ill (not an interval) does not occur. */
} lg_interval_flag;

typedef struct lg_interval_options {
    size_t size; /* sizeof(lg_interval_options) */
    bool widen;  /* true: constants and parameters are widened by one unit in the last place; default false */
} lg_interval_options;

LG_API void lg_interval_options_init(lg_interval_options *options);
/* Prepares functions of a program, evaluated together for one row; the caller destroys the evaluator. All
 * functions must have the same inputs. `options` NULL means the defaults. The evaluator keeps nothing of the
 * program but its context. Errors: LG_UNSUPPORTED (an operation without interval form, which the message
 * names; more than a million operations on numbers; another rounding mode), LG_NOT_FOUND (no such function),
 * LG_INVALID_ARGUMENT (no functions, inputs that differ), LG_SHAPE. */
LG_API lg_status lg_interval_create(const lg_program *program, const size_t *functions, size_t count,
                                    const lg_interval_options *options, lg_interval **out, lg_error *error);
LG_API void lg_interval_destroy(lg_interval *interval);

/* ---- motions ---- */

typedef struct lg_interval_taylor_spec {
    size_t size;     /* sizeof(lg_interval_taylor_spec) */
    size_t function; /* of the program: (x (n), u (m)) -> x' (n), or (x) -> x' */
    uint32_t first,
        last;    /* the coefficients first to last, 1 <= first <= last <= 12; both are 1 by default. 0, 0: the
                  * function itself, of any inputs and outputs */
    bool slopes; /* their Jacobians instead of the coefficients */
    bool chords; /* with slopes: of chords from a point, which are about half as wide */
} lg_interval_taylor_spec;

LG_API void lg_interval_taylor_spec_init(lg_interval_taylor_spec *spec);
/* Prepares the Taylor coefficients in time of motions x' = f(x, u) with a constant u: x(t) = x + x_1 t + x_2
 * t^2 + ..., x_1 = f(x, u). Inputs are x and u, outputs the coefficients x_first to x_last, (last - first +
 * 1, n), or their Jacobians by x and u, (last - first + 1, n, n + m). Bounds of x_k over a tube, which holds
 * a motion during [0, h], bound the remainder: x(h) = x + ... + x_{k-1} h^{k-1} + x_k h^k with such an x_k.
 * With `chords` the inputs x and u are followed by a point x_0 and u_0 in them (a box that meets theirs), and
 * outputs are the coefficients at the point, then slopes S, (last - first + 1, n, n + m), with x_k(x, u) =
 * x_k(x_0, u_0) + S (x - x_0, u - u_0) for all numbers of the box.
 * At a kink that a box does not decide, x_1 and x_2 and the Jacobian of x_1 are hulls, which hold for
 * remainders, too; further ones are -inf to inf and LG_INTERVAL_UNDEFINED. Flags of coefficients say nothing
 * where the rate itself is not Lipschitz continuous. `options` NULL means the defaults. Errors: those of
 * lg_interval_create; LG_INVALID_ARGUMENT (orders, ports), LG_UNSUPPORTED (lg_stop_gradient, lg_select by a
 * value that is no comparison, Stumpff functions of too high an order). */
LG_API lg_status lg_interval_taylor(const lg_program *program, const lg_interval_taylor_spec *spec,
                                    const lg_interval_options *options, lg_interval **out, lg_error *error);

LG_API size_t lg_interval_inputs(const lg_interval *interval);  /* Numbers of one box: all inputs. */
LG_API size_t lg_interval_outputs(const lg_interval *interval); /* Of all functions. */
/* 1: the output, of all outputs in order, is an even function of all inputs together, f(-x) = f(x); -1: it
 * is odd; 0: its operations do not tell. That follows from the operations on exact numbers, and is not
 * tried at points. */
LG_API int lg_interval_parity(const lg_interval *interval, size_t output);
/* Number of operations on intervals per box. */
LG_API size_t lg_interval_operations(const lg_interval *interval);

/* Bytes of the memory for lg_interval_eval, which must be aligned to 64 bytes. */
LG_API size_t lg_interval_work_size(const lg_interval *interval);
/* Bounds for `boxes` boxes. lower, upper: (boxes, inputs); out_lower, out_upper: (boxes, outputs); flags:
 * (boxes, outputs) of lg_interval_flag, or NULL. A function with lg_stop_gradient, whose derivative is no
 * slope, has at most LG_INTERVAL_CONTINUOUS. Allocates
 * nothing and takes no lock; threads may share an evaluator, each with its own work memory. Bounds of a box
 * do not depend on the other boxes. Errors, with the box in the message; outputs are then untouched:
 * LG_UNSUPPORTED (another rounding mode than FE_TONEAREST), LG_NOT_FINITE (a bound of a box is not finite),
 * LG_INVALID_ARGUMENT (a lower bound above its upper bound,
 * NULL). */
LG_API lg_status lg_interval_eval(const lg_interval *interval, size_t boxes, const double *lower,
                                  const double *upper, double *out_lower, double *out_upper, uint8_t *flags,
                                  void *work, lg_error *error);

/* The rounding of a function that is computed with the unit of rounding `unit`, 2^-53 (f64) or 2^-24 (f32):
 * bound (outputs): bounds of |computed - exact| over the box low, high (inputs). Constants and inputs are
 * rounded to half a unit in the last place, too; sums in any order; +, -, *, / and the root err by at most
 * a unit times the result, functions as exp by 8, Stumpff functions by 64. Numbers below the smallest normal
 * one may become 0. A bound is inf where rounding may decide a jump, where a number may overflow or leave
 * the domain of an operation, and for coefficients of dexpinv. Errors: LG_INVALID_ARGUMENT (the unit, a box
 * that is empty or not finite), LG_NOT_FOUND, LG_UNSUPPORTED (no interval form; another rounding mode). */
LG_API lg_status lg_interval_rounding(const lg_program *program, size_t function, const double *low,
                                      const double *high, double unit, double *bound, lg_error *error);

LG_END_DECLS

#endif
