/* Certificates of closed loops: proofs, by interval evaluation and branch and bound, that a Lyapunov
 * function V falls. The library is liegrad; docs/certificates.md is the guide.
 *
 *   lg_certify_spec spec;
 *   lg_certify_spec_init(&spec);
 *   spec.program = program;  spec.rate = "closed_loop";  spec.P = P;  spec.low = low;  spec.high = high;
 *   status = lg_certify_create(NULL, &spec, &certify, &error);
 *   status = lg_certify_run(certify, SIZE_MAX, 60, &result, &error);
 *   puts(result.claim);
 *
 * What is proved about S, the part of {V <= c} in the state box: (1) V > c on the boundary of the box, so S
 * is not left through it; (2) V' < 0 (for steps: V(F(x)) - V(x) < 0) on S, except where (3) V < eps within a
 * small neighbourhood N of the goal, outside of which V >= eps. Hence all motions from S reach {V < eps} and
 * stay. If in addition (4) the goal is an exact equilibrium and V' = x^T M x on N with interval matrices M
 * that are negative definite, they converge to the goal. docs/certificates.md ("The claim") says how this is
 * proved, and what it means for steps, for held inputs (`control`) and where the loop may jump. */
#ifndef LIEGRAD_CERTIFY_H
#define LIEGRAD_CERTIFY_H

#include "liegrad/program.h"

LG_BEGIN_DECLS

typedef struct lg_certify lg_certify;

typedef struct lg_certify_spec {
    size_t size; /* sizeof(lg_certify_spec) */
    /* A program with the closed loop: the function `rate` has one input, the state (n), and one output (n):
     * x' as a function of x, or the next state if `step`. 1 <= n <= 16. */
    const lg_program *program;
    const char *rate;
    bool step;
    /* A held loop: `rate` is x' as a function of the state and the input (x (n), u (m)), `control` is u as a
     * function of x (n), and u = control(x) is held for `period`. The proof is about the exact motion of x' =
     * rate(x, u) over a period, however it is integrated. NULL: none. */
    const char *control;
    double period;
    /* Held loops: the unit of rounding of the arithmetic in which `control` is computed, 2^-53 (f64), 2^-24
     * (f32) or 0 (exact; the default). The proof then holds for all inputs that differ from control(x) by at
     * most the bounds of lg_interval_rounding over {V <= c}; (4) is about exact arithmetic. */
    double unit;
    /* V: a quadratic form of x - goal, P (n, n), symmetric and positive definite; or a function of the
     * program with one input (n) and one output, one number, twice differentiable. One of the two. */
    const double *P;
    const char *lyapunov;
    const double *goal;       /* (n); NULL: 0 */
    const double *low, *high; /* (n) the state box, around the goal; with P a side may be infinite */
    double level;             /* c; 0: the largest that is found */
    double most;              /* with level 0: c is not larger than this; 0: no bound but the box */
    /* 0: chosen, as large as the local argument (4) allows, or else as small as V' < 0 allows, to a factor
     * of 1.5 */
    double eps;
    /* (n) bounds of |error of rate|, per component; NULL: 0. Then motions reach {V < eps}, and (4) is left
     * out. */
    const double *model_error;
    double resolution; /* with level 0: relative accuracy of the level; default 1/512 */
    int threads;       /* default 1; results are the same for any number */
} lg_certify_spec;

typedef struct lg_certify_result {
    bool verified;  /* (1) to (3) are proved */
    bool finished;  /* false: the work budget ended; lg_certify_run continues */
    bool converges; /* (4) is proved as well */
    double level, eps;
    /* Held loops: V <= `between` also between the samples, for motions from S (of the model, without
     * model_error). Otherwise 0. */
    double between;
    /* With `unit`: the largest bound of the rounding of an input; inf: there is none, and rounding is not
     * covered. With it motions from S reach {V < eps_rounded} (and stay there if (4) is proved). */
    double input_error, eps_rounded;
    /* A lower bound of the volume of S, and its part of the volume of the box (0 for an unbounded box). */
    double volume, fraction;
    /* (n) The largest |x_i - goal_i| on {V <= level}, to rounding; NULL: not verified, or V is no quadratic
     * form. */
    const double *width;
    size_t boxes;       /* boxes that were examined so far */
    double seconds;     /* of all runs so far */
    const char *claim;  /* the sentence; lives as long as the certificate */
    const char *reason; /* why it is not verified; "" if it is */
    /* (n) The box that fails, in states; a point, up to rounding, if a point refutes the claim. NULL if
     * none. */
    const double *failed_low, *failed_high;
} lg_certify_result;

LG_API void lg_certify_spec_init(lg_certify_spec *spec);
/* Prepares a proof. Nothing of `spec` is kept. Errors: LG_INVALID_ARGUMENT (sizes, a box that does not hold
 * the goal, P not positive definite), LG_NOT_FOUND (functions), LG_UNSUPPORTED (an operation without interval
 * form or Taylor coefficients; steps and held loops without P; a thread whose rounding mode is not
 * FE_TONEAREST). */
LG_API lg_status lg_certify_create(const lg_context *context, const lg_certify_spec *spec, lg_certify **out,
                                   lg_error *error);
LG_API void lg_certify_destroy(lg_certify *certify);
/* Works until the proof is finished, has failed, or `boxes` more boxes or about `seconds` are spent; a
 * further call continues. A run by boxes gives the same result on every call. Errors: LG_CANCELLED (a further
 * call continues), LG_OUT_OF_MEMORY (boxes are lost: the proof has failed, and no further call verifies it),
 * LG_UNSUPPORTED (the rounding mode of the thread is not FE_TONEAREST), LG_INVALID_ARGUMENT. */
LG_API lg_status lg_certify_run(lg_certify *certify, size_t boxes, double seconds, lg_certify_result *result,
                                lg_error *error);

/* ---- certificates as files ---- */

/* Scalar code: each line is one operation on the results of earlier lines (docs/certificates.md has the
 * operations). The last number is that of "number" and "pow", as a whole number of "in", "stumpff" and
 * "dexpinv". */
typedef struct lg_certificate_line {
    uint32_t op, in[3]; /* the operation's place in the table of the format; lines */
    double number;
} lg_certificate_line;
typedef struct lg_certificate_code {
    uint32_t inputs, lines, outputs;
    lg_certificate_line *line;
    uint32_t *output; /* lines */
} lg_certificate_code;

enum { LG_CERTIFICATE_STATES = 16, LG_CERTIFICATE_NAME = 64, LG_CERTIFICATE_CLAIM = 1024 };
#define LG_CERTIFICATE_SHA256 65

/* Everything that a third party needs to prove a claim of lg_certify again, for a quadratic V: what a file
 * holds. Coordinates y of the proof: x = goal + T y. docs/certificates.md is the guide. */
typedef struct lg_certificate {
    char claim[LG_CERTIFICATE_CLAIM], names[LG_CERTIFICATE_STATES][LG_CERTIFICATE_NAME]; /* of the states */
    /* Names for people, not empty, which nothing checks; bytes that are not UTF-8 are saved as '?' */
    char plant[LG_CERTIFICATE_NAME], controller[LG_CERTIFICATE_NAME];
    /* Of the code of each in the file; set by lg_certificate_load */
    char plant_sha256[LG_CERTIFICATE_SHA256], controller_sha256[LG_CERTIFICATE_SHA256];
    uint32_t states, inputs;           /* n, m */
    double period;                     /* of held inputs; 0: inputs are continuous */
    lg_certificate_code rate, control; /* (x (n), u (m)) -> x' (n) and x -> u; m = 0: the loop is closed */
    double goal[LG_CERTIFICATE_STATES], low[LG_CERTIFICATE_STATES], high[LG_CERTIFICATE_STATES];
    double P[LG_CERTIFICATE_STATES * LG_CERTIFICATE_STATES], error[LG_CERTIFICATE_STATES]; /* P (n, n) */
    double level, eps, between; /* as in lg_certify_result */
    bool converges;
    double T[LG_CERTIFICATE_STATES * LG_CERTIFICATE_STATES]; /* (n, n) */
    uint32_t order, steps; /* held loops: of the Taylor polynomials; steps in a period, a power of 2 */
    double near[LG_CERTIFICATE_STATES]; /* N = {|y_i| <= near_i} */
    bool even;                          /* V and its fall are even in y: half of the box is examined */
    double from[LG_CERTIFICATE_STATES], to[LG_CERTIFICATE_STATES]; /* the root box, in y */
    uint64_t boxes;                                                /* of the tree */
    /* A line for each depth, with a character for each box: 'a' + i: it is halved along y_i, and the lower
     * halves of all boxes come before all upper halves; 'o': V > c on the box; 'n': it lies in N; a digit k:
     * V falls, which is shown with steps 2^k. */
    char *tree;
    const lg_context *context; /* of the memory */
} lg_certificate;

/* Makes the certificate of a proof that succeeded. `spec` is that of the proof, with a quadratic V; or, of
 * continuous inputs, it may have the two functions of a held loop and the period 0. The tree is proved again,
 * from the code that `out` holds, on at most `seconds`. `out` gets everything but names and hashes; it is
 * destroyed on failure. Errors: LG_INVALID_ARGUMENT (a proof that did not succeed), LG_UNSUPPORTED (steps, V
 * that is no quadratic form, operations that files cannot hold), LG_CHECK_FAILED (no tree of a million boxes
 * proves it, or none in the time), those of lg_certify_create. */
LG_API lg_status lg_certificate_make(const lg_context *context, const lg_certify_spec *spec,
                                     const lg_certify_result *proved, double seconds, lg_certificate *out,
                                     lg_error *error);
/* Frees what the certificate points to, and clears it; NULL is allowed. */
LG_API void lg_certificate_destroy(lg_certificate *certificate);
/* Prepares to prove the certificate again; lg_certify_run does. Its claim is made from the numbers; a reader
 * compares it with certificate->claim. The certificate must live as long as `out`, and be unchanged. Errors:
 * those of lg_certify_create, LG_INVALID_ARGUMENT for numbers that are no certificate. */
LG_API lg_status lg_certify_open(const lg_context *context, const lg_certificate *certificate, int threads,
                                 lg_certify **out, lg_error *error);
/* Whether functions of a program, as in lg_certify_spec, have the code of the certificate, operation by
 * operation. Errors: LG_INVALID_ARGUMENT, LG_NOT_FOUND, LG_UNSUPPORTED. */
LG_API lg_status lg_certificate_compare(const lg_certificate *certificate, const lg_program *program,
                                        const char *rate, const char *control, bool *same_plant,
                                        bool *same_controller, lg_error *error);
/* Library liegrad_io: writes the certificate as JSON, and reads it. A file has at most 1 MiB. Errors of
 * lg_certificate_save: LG_INVALID_ARGUMENT (no names of plant and controller), LG_UNSUPPORTED (it would be
 * larger), those of writers. lg_certificate_load says what is wrong, and in which line; `out` is destroyed by
 * the caller. Errors: LG_FORMAT, LG_CHECK_FAILED (the hash of the code does not fit), those of readers. */
LG_API lg_status lg_certificate_save(const lg_context *context, const char *path,
                                     const lg_certificate *certificate, lg_error *error);
LG_API lg_status lg_certificate_load(const lg_context *context, const char *path, lg_certificate *out,
                                     lg_error *error);

/* ---- torque-limited pendulums: energy with saturation ---- */

/* The loop M q'' = -g(q) - b q' - (sat(s(q) + k q') - sat(s(q))) with one coordinate q on the real line (an
 * angle is counted), where M > 0, and g is the slope of all potentials together with sat(s(q)): for the
 * pendulum m l^2 q'' = m g l sin q - b q' - sat(k q + k_v q') it is g(q) = sat(k q) - m g l sin q. V = M
 * q'^2/2 + int g is positive and grows without bound, and V' <= -b q'^2; by LaSalle's theorem every motion
 * converges to q = 0, if
 *   g(0) = 0, g' > 0 near 0, g > 0 for q > 0, g < 0 for q < 0, |g| >= a margin > 0 far away, b > 0, k >= 0.
 * The form of the loop, and that g is periodic beyond `saturated`, is the caller's statement; the rest is
 * proved. */
typedef struct lg_certify_energy_spec {
    size_t size; /* sizeof(lg_certify_energy_spec) */
    const lg_program *program;
    const char *slope; /* the function g: q (1) -> one number */
    double damping;    /* a lower bound of b */
    double gain;       /* k */
    /* For |q| >= saturated, g(q + period) = g(q): sat(s(q)) is at its limit, the potential is periodic. */
    double saturated, period;
} lg_certify_energy_spec;

typedef struct lg_certify_energy_result {
    bool verified;
    double margin; /* a lower bound of |g| for |q| >= saturated, to 1e-3 of itself */
    double near;   /* g' > 0 is proved for |q| <= near, the sign of g beyond */
    size_t boxes;
    double failed_low,
        failed_high; /* where g has the wrong sign, or could not be shown to have the right one */
    char claim[512], reason[128];
} lg_certify_energy_result;

LG_API void lg_certify_energy_spec_init(lg_certify_energy_spec *spec);
/* Errors: LG_INVALID_ARGUMENT (numbers, ports), LG_NOT_FOUND, LG_UNSUPPORTED (no interval form). A claim that
 * does not hold is no error: `verified` is false, the result says where. */
LG_API lg_status lg_certify_energy(const lg_context *context, const lg_certify_energy_spec *spec,
                                   lg_certify_energy_result *result, lg_error *error);

/* ---- attitude: energy on SO(3) ---- */

typedef struct lg_certify_attitude_result {
    bool verified;
    double critical[3]; /* lower bounds of Phi at the three further critical rotations, ascending */
    double level;       /* critical[0] */
    char claim[512], reason[128];
} lg_certify_attitude_result;

/* The loop J w' + w x J w = -grad Phi(Q) - D w with Q = R_goal^T R, Phi = tr(A (1 - Q)), A (3, 3) symmetric,
 * J and D positive definite (`damping` is a lower bound of D's eigenvalues). V = w.J w/2 + Phi falls with
 * w.D w. Phi is critical at Q = 1 and at rotations by pi about the eigenvectors of A, with the values 2 (a_j
 * + a_k) of the other two eigenvalues. If all of them are positive, Q = 1 is the only critical rotation of
 * {V < the lowest}, and by LaSalle's theorem motions from there converge to it. No continuous feedback
 * converges from all rotations. The function does not check that the loop has this form. Errors:
 * LG_INVALID_ARGUMENT (A not symmetric to 1e-12), LG_NOT_FINITE. */
LG_API lg_status lg_certify_attitude(const double *A, double damping, lg_certify_attitude_result *result,
                                     lg_error *error);

/* ---- attitude: feedback of the half angle, with limits of the inputs ---- */

/* The loop J w' + w x J w = -k z - D w with R' = R hat(w), z = 2 sin(a/2) cos(a/2)/r(cos(a/2)) n, r(x) =
 * sqrt(x^2 + 1e-6), where a in [0, pi] is the angle and n the axis of Q = R_goal^T R: the feedback of the
 * kind energy of liegrad/policy.h, which is smooth. V = w.J w/2 + Phi, Phi = 4 k (r(1) - r(cos(a/2))), falls
 * with w.D w. Phi is critical at Q = 1, and at the angle pi, where it is 4 k (r(1) - 1e-3) = 3.996 k. Where
 * V is below 3.996 k the angle is below pi; by LaSalle's theorem motions converge to Q = 1. The inputs
 * u_l = -g_l.(k_p z + k_d w) give this torque while they stay within their limits: the level is the largest
 * c up to 3.996 k at which |g_l.z| <= |g_l| |z| and |g_l.w|^2 <= g_l.J^-1 g_l 2 (c - Phi) prove |u_l| <=
 * limit_l. The caller states the form of the loop; it is not checked. */
typedef struct lg_certify_rotation_spec {
    size_t size;        /* sizeof(lg_certify_rotation_spec) */
    double J[9];        /* (3, 3) symmetric, positive definite */
    double stiffness;   /* k */
    double damping;     /* a lower bound of the eigenvalues of (D + D^T)/2 */
    size_t inputs;      /* 1 to 16 */
    double map[16 * 3]; /* (inputs, 3): g_l */
    double gains[2];    /* k_p, k_d >= 0 */
    double limit[16];   /* (inputs), above 0 */
} lg_certify_rotation_spec;

typedef struct lg_certify_rotation_result {
    bool verified;
    double level;    /* c */
    double critical; /* 3.996 k, V at rest at the angle pi: the level without limits */
    double angle;    /* radians: every rotation at rest up to this angle is in {V < c} */
    char claim[640], reason[128];
} lg_certify_rotation_result;

LG_API void lg_certify_rotation_spec_init(lg_certify_rotation_spec *spec);
/* Errors: LG_INVALID_ARGUMENT (sizes, J not symmetric to 1e-9 or not positive definite, limits or gains out
 * of range), LG_NOT_FINITE. */
LG_API lg_status lg_certify_rotation(const lg_certify_rotation_spec *spec, lg_certify_rotation_result *result,
                                     lg_error *error);

LG_END_DECLS

#endif
