/* Certificates of closed loops: proofs, by interval evaluation and branch and bound, that a Lyapunov function V
 * falls. The library is liegrad; docs/certificates.md is the guide.
 *
 *   lg_certify_spec spec;
 *   lg_certify_spec_init(&spec);
 *   spec.program = program;  spec.rate = "closed_loop";  spec.P = P;  spec.low = low;  spec.high = high;
 *   status = lg_certify_create(NULL, &spec, &certify, &error);
 *   status = lg_certify_run(certify, SIZE_MAX, 60, &result, &error);
 *   puts(result.claim);
 *
 * What is proved. Let S be the part of {V <= c} in the state box. Then (1) V > c on the boundary of the box, so S
 * is not left through it; (2) V' < 0 (for steps: V(F(x)) - V(x) < 0) on S, except where (3) V < eps within a small
 * neighbourhood N of the goal, outside of which V >= eps. Hence all motions from S reach {V < eps} and stay. If in
 * addition (4) the goal is an exact equilibrium and V' = x^T M x on N with interval matrices M that are negative
 * definite, they converge to the goal. Every inequality is proved with outward rounding. Points that refute the
 * claim are proved, too; nothing is sampled. Steps: the statements hold at the steps, not between them; and without
 * (4) motions reach {V < eps} again and again and stay in S. */
#ifndef LIEGRAD_CERTIFY_H
#define LIEGRAD_CERTIFY_H

#include <stdbool.h>
#include <stddef.h>

#include "liegrad/core.h"
#include "liegrad/program.h"

LG_BEGIN_DECLS

typedef struct lg_certify lg_certify;

typedef struct lg_certify_spec {
    size_t size; /* sizeof(lg_certify_spec) */
    /* A program with the closed loop: the function `rate` has one input, the state (n), and one output (n): x' as
     * a function of x, or the next state if `step`. 1 <= n <= 16. */
    const lg_program *program;
    const char *rate;
    bool step;
    /* V: a quadratic form of x - goal, P (n, n), symmetric and positive definite; or a function of the program with
     * one input (n) and one output, one number, twice differentiable. One of the two. */
    const double *P;
    const char *lyapunov;
    const double *goal;       /* (n); NULL: 0 */
    const double *low, *high; /* (n) the state box, around the goal; with P a side may be infinite */
    double level;             /* c; 0: the largest that is found */
    double eps;               /* 0: chosen, as large as the local argument (4) allows */
    /* (n) bounds of |error of rate|, per component; NULL: 0. Then motions reach {V < eps}, and (4) is left out. */
    const double *model_error;
    double resolution; /* with level 0: relative accuracy of the level; default 1/512 */
    int threads;       /* default 1; results are the same for any number */
} lg_certify_spec;

typedef struct lg_certify_result {
    bool verified;  /* (1) to (3) are proved */
    bool finished;  /* false: the work budget ended; lg_certify_run continues */
    bool converges; /* (4) is proved as well */
    double level, eps;
    /* A lower bound of the volume of S, and its part of the volume of the box (0 for an unbounded box). */
    double volume, fraction;
    size_t boxes;       /* boxes that were examined so far */
    double seconds;     /* of all runs so far */
    const char *claim;  /* the sentence; lives as long as the certificate */
    const char *reason; /* why it is not verified; "" if it is */
    /* (n) The box that fails, in states; NULL if none. */
    const double *failed_low, *failed_high;
} lg_certify_result;

LG_API void lg_certify_spec_init(lg_certify_spec *spec);
/* Prepares a proof; the caller destroys it. Nothing of `spec` is kept. Errors: LG_INVALID_ARGUMENT (sizes, a box
 * that does not hold the goal, P not positive definite), LG_NOT_FOUND (functions), LG_UNSUPPORTED (an operation
 * without interval form; steps without P), LG_OUT_OF_MEMORY. */
LG_API lg_status lg_certify_create(const lg_context *context, const lg_certify_spec *spec, lg_certify **out,
                                   lg_error *error);
LG_API void lg_certify_destroy(lg_certify *certify); /* NULL is allowed */
/* Works until the proof is finished, has failed, or `boxes` more boxes or about `seconds` are spent; a further
 * call continues. A run by boxes gives the same result on every call. Errors: LG_CANCELLED, LG_OUT_OF_MEMORY,
 * LG_INVALID_ARGUMENT. */
LG_API lg_status lg_certify_run(lg_certify *certify, size_t boxes, double seconds, lg_certify_result *result,
                                lg_error *error);

LG_END_DECLS

#endif
