/* Integrators: spaces with a transitive group action, schemes as data, one stepper for all of them (plain
 * doubles).
 *
 *   lg_ode ode = {.field = my_field, .user = &my_parameters};
 *   lg_space_init(&ode.space, &(lg_space_factor){LG_SPACE_TS2, links}, 1);
 *   lg_stepper *stepper;
 *   lg_stepper_create(context, lg_scheme_find("cf4"), &ode, &stepper);
 *   lg_integrate_fixed(stepper, 0.0, h, steps, NULL, 0, steps, y0, out, NULL);
 *   lg_stepper_destroy(stepper);
 *
 * or, without any allocation, lg_stepper_size and lg_stepper_init in the caller's memory. No function that
 * takes a stepper allocates or locks. A stepper belongs to one thread at a time.
 *
 * A differential equation on a space M with group action is y' = f(t, y) . y, f with values in the algebra;
 * on R^n the action is addition and f is the usual right-hand side. Conventions of the groups:
 * liegrad/geometry.h.
 */
#ifndef LIEGRAD_INTEGRATORS_H
#define LIEGRAD_INTEGRATORS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/core.h"

LG_BEGIN_DECLS

/* ---- Spaces ---- */

typedef enum lg_space_kind {
    LG_SPACE_RN,       /* R^n under addition: state 1, algebra 1 a copy; n copies are R^n */
    LG_SPACE_TS2,      /* T*S^2 (and TS^2) under SE(3): state (q, p) 6, algebra (u, v) 6 */
    LG_SPACE_SO3,      /* SO(3) under itself: state R row-major 9, algebra u 3; exp(u) R */
    LG_SPACE_SE3,      /* SE(3) under itself: state (R, r) 12, algebra (u, v) 6;
                        * (exp(u) R, exp(u) r + dexp_u v).
                        * This is the right-trivialised T*SO(3), where r is the spatial momentum. */
    LG_SPACE_SO3_DUAL, /* so(3)* = R^3 under SO(3): state 3, algebra u 3; exp(u) x */
    LG_SPACE_SE3_DUAL, /* se(3)* = R^6 under SE(3): state (G, P) 6, algebra (u, v) 6;
                        * (R G, R P + r x R G) as on T*S^2, with any |G| */
    LG_SPACE_KINDS
} lg_space_kind;

/* An entry of the table of factors. Functions work on `count` contiguous copies; `out` may equal an input. */
typedef struct lg_space_entry {
    const char *name;
    size_t state;   /* numbers in the state of one copy */
    size_t algebra; /* numbers in the algebra of one copy, at most LG_SPACE_MAX_ALGEBRA */
    bool abelian;   /* bracket zero, dexpinv the identity; `bracket` and `dexpinv` are then NULL */
    void (*act)(size_t count, const double *a, const double *y, double *out); /* exp(a) . y */
    void (*generator)(size_t count, const double *a, const double *y,
                      double *out); /* a . y, an ambient vector */
    void (*bracket)(size_t count, const double *a, const double *b, double *out);
    void (*dexpinv)(size_t count, const double *a, const double *b, double *out); /* closed form */
    void (*project)(size_t count, double *y); /* to the nearby point of the manifold, in place */
    double (*manifold_error)(size_t count, const double *y); /* largest violation of a constraint, absolute */
    double (*angle)(size_t count, const double *a);          /* largest |u| of the rotations in a; 0 on R^n */
    /* Tangent coordinates c; the functions at lg_space_basis say which. Where tangent = state, on R^n and the
     * duals, c is the vector itself and the rest is NULL. */
    size_t tangent; /* numbers in c of one copy */
    /* Writes the basis of one copy: a matrix (state, tangent), whose rows begin `stride` numbers apart. */
    void (*basis)(const double *y, size_t stride, double *directions);
    void (*coordinates)(size_t count, const double *y, const double *vector, double *c);
    void (*lift)(size_t count, const double *y, const double *vector,
                 double *a); /* the algebra element whose generator at y is the tangent `vector` */
    void (*carry)(size_t count, const double *a, const double *vector,
                  double *out); /* exp(a) on tangent vectors: the derivative of `act` */
} lg_space_entry;

#define LG_SPACE_MAX_STATE   12
#define LG_SPACE_MAX_ALGEBRA 12
#define LG_SPACE_MAX_FACTORS 8

typedef struct lg_space_factor {
    lg_space_kind kind;
    size_t count; /* copies; for LG_SPACE_RN the dimension */
} lg_space_factor;

/* A product of factors, each contiguous in state and algebra, in order. Plain data; fill it with
 * lg_space_init. */
typedef struct lg_space {
    size_t factors;
    lg_space_factor factor[LG_SPACE_MAX_FACTORS];
    size_t dim;         /* numbers in a state */
    size_t algebra_dim; /* numbers in an algebra element */
    size_t tangent_dim; /* numbers in the coordinates of a tangent vector */
} lg_space;

/* The entry of a kind; NULL outside the enumeration. Static, constant. */
LG_API const lg_space_entry *lg_space_kind_entry(lg_space_kind kind);

/* Errors: LG_INVALID_ARGUMENT (unknown kind, no factor or more than LG_SPACE_MAX_FACTORS, a count of 0,
 * overflow). */
LG_API lg_status lg_space_init(lg_space *space, const lg_space_factor *factors, size_t count);
/* R^n */
LG_API lg_status lg_space_init_rn(lg_space *space, size_t n);
/* True when every factor is R^n, where Lie group schemes are the classical ones. */
LG_API bool lg_space_is_abelian(const lg_space *space);

/* A space in words, "T*S^2 x 3, R^2": the names of the factors in order, with the number of copies where
 * there are several; R^n has n in its name. lg_space_read takes what lg_space_text writes and nothing else.
 * Errors: LG_FORMAT, with the place in the text. */
#define LG_SPACE_TEXT 256
LG_API void lg_space_text(const lg_space *space, char text[LG_SPACE_TEXT]);
LG_API lg_status lg_space_read(const char *text, lg_space *out, lg_error *error);

/* out = exp(a) . y. a has algebra_dim numbers; y and out have dim numbers; out may equal y. Points within
 * 1e-13 of T*S^2, SO(3) and SE(3) are projected to first order, so that rounding does not accumulate. Points
 * farther away keep their distance. */
LG_API void lg_space_act(const lg_space *space, const double *a, const double *y, double *out);
/* out = a . y, the ambient velocity of the algebra element a at y (dim numbers); out may equal y. */
LG_API void lg_space_generator(const lg_space *space, const double *a, const double *y, double *out);
/* out = [a, b]; out may equal a or b. */
LG_API void lg_space_bracket(const lg_space *space, const double *a, const double *b, double *out);

#define LG_DEXPINV_EXACT (-1)
#define LG_DEXPINV_MAX   10
/* out = dexp_a^-1(b); out may equal b. `truncation` is LG_DEXPINV_EXACT for the closed form, or K in
 * 0..LG_DEXPINV_MAX for the series
 *   sum_{k <= K} B_k/k! ad_a^k b = b - 1/2 [a, b] + 1/12 [a, [a, b]] + 0 - ... */
LG_API void lg_space_dexpinv(const lg_space *space, int truncation, const double *a, const double *b,
                             double *out);

/* Projects y in place. On each T*S^2: q / |q|, p - q (q.p). On SO(3) and SE(3): the nearest rotation, or NaN
 * where the determinant is not positive. This is for starts that are off by rounding, and for schemes with
 * `project`. */
LG_API void lg_space_project(const lg_space *space, double *y);
/* The largest violation over all factors: | |q| - 1 | and |q.p| on T*S^2; for rotations the entries of
 * R^T R - I, or 2 for a reflection; 0 on R^n and the duals. NaN when the state holds NaN. */
LG_API double lg_space_manifold_error(const lg_space *space, const double *y);
/* Largest rotation angle |u| in a; NaN when a holds NaN. */
LG_API double lg_space_angle(const lg_space *space, const double *a);

/* Tangent coordinates c (tangent_dim) of ambient vectors at y, factor after factor, copy after copy:
 *   R^n, so(3)*, se(3)*  c is the vector
 *   T*S^2   c = (a_1, a_2, b_1, b_2): dq = a_1 e_1 + a_2 e_2, dp = b_1 e_1 + b_2 e_2 - q (dq.p);
 *           a_j = e_j.dq, b_j = e_j.dp. e_1 is the coordinate axis of the smallest |component| of q (the
 *           first of equals), made orthogonal to q and of length 1; e_2 = q x e_1.
 *   SO(3)   c is a rotation vector in the body: dR = R hat(c); c is the vector of the skew part of R^T dR.
 *   SE(3)   c = (rotation vector as on SO(3), dr)
 *
 * basis (dim, tangent_dim): column j is the tangent vector with c = (0 .. 1 .. 0). The coordinates of a
 * vector that is not tangent are those of a part of it. */
LG_API void lg_space_basis(const lg_space *space, const double *y, double *basis);
LG_API void lg_space_coordinates(const lg_space *space, const double *y, const double *vector, double *c);
/* out: the point to which a step along the tangent `vector` (dim) leads: exp(a) . y with the algebra element
 * a whose generator at y is `vector`; on R^n and the duals y + vector. It is on the manifold; out may be y.
 * `carried` (NULL: not wanted) becomes a matrix (tangent_dim, tangent_dim). exp(a) moves a tangent vector
 * at y to a tangent vector at `out`; the matrix maps the vector's coordinates at y to its coordinates at
 * `out`. On R^n and the duals it is the unit matrix. */
LG_API void lg_space_retract(const lg_space *space, const double *y, const double *vector, double *out,
                             double *carried);

/* ---- Differential equations ---- */

/* algebra = f(t, y), ode.space.algebra_dim numbers. `input` is the input of lg_step, or NULL. A status other
 * than LG_OK ends the integration, which returns it; after LG_NOT_FINITE an adaptive integration first tries
 * smaller steps. */
typedef lg_status (*lg_vector_field)(void *user, double t, const double *y, const double *input,
                                     double *algebra);
/* For separable systems on R^2n, y = (q, p). `half` is q for the force -dV/dq, and p for the velocity dK/dp.
 * `half` and `out` have n numbers each. */
typedef lg_status (*lg_half_field)(void *user, double t, const double *half, const double *input,
                                   double *out);

/* One step of a variational integrator in the system's own coordinates, in place: y(t) -> y(t + h). It keeps
 * nothing between steps. */
typedef lg_status (*lg_variational_step)(void *user, double t, double h, double *y);

typedef struct lg_ode {
    lg_space space;
    lg_vector_field field;  /* may be NULL when only splitting schemes are used */
    lg_half_field force;    /* NULL when the system is not separable */
    lg_half_field velocity; /* NULL if and only if force is */
    void *user;
    lg_space manifold;        /* ambient forms: the manifold in R^n on which the states lie, for projection
                               * and tolerances; factors 0: no constraint */
    lg_variational_step step; /* NULL when the system has no variational integrator of its own */
} lg_ode;

/* ---- Schemes ---- */

#define LG_SCHEME_MAX_STAGES       16
#define LG_SCHEME_MAX_EXPONENTIALS 4

/* How an interpreter uses the data. h is the step, y the start of the step. */
typedef enum lg_scheme_kind {
    /* Runge-Kutta-Munthe-Kaas; on R^n the classical Runge-Kutta method:
     *   sigma_i = h sum_j a_ij k_j
     *   Y_i     = exp(sigma_i) . y
     *   k_i     = dexpinv_{sigma_i} f(t + c_i h, Y_i)
     *   y1      = exp(h sum_i b_i k_i) . y */
    LG_SCHEME_RKMK,
    /* f_i = f(t + c_i h, Y_i). lg_cf_row gives Y_i and y1 as products of exponentials of combinations of the
     * f_j. */
    LG_SCHEME_COMMUTATOR_FREE,
    /* On R^2n, for i = 0..stages-1: p += kick_i h force(q), q += drift_i h velocity(p). A force at an
     * unchanged q is not evaluated again, neither inside a step nor from one step to the next. */
    LG_SCHEME_SPLITTING,
    /* On R^n, one implicit stage, 0 <= theta <= 1:
     *   Y  = y + theta h f(t + theta h, Y)
     *   y1 = y + h f(t + theta h, Y)
     * Newton's method solves it to rounding, with a full Jacobian by differences (8 n^2 bytes of the stepper,
     * n <= 16384). theta = 1 is implicit Euler, theta = 1/2 the midpoint rule. */
    LG_SCHEME_IMPLICIT,
    /* Symplectic Lie group integrators (Celledoni, Marthinsen, Owren) on T*G, 0 <= theta <= 1, with
     * G = SO(3) x R^m: one factor SE(3), optionally followed by one R^2m as (q, p).
     *   (xi, n) = h f(exp(theta xi) . g0, M_theta)
     *   M_theta = dexp_{-xi}^*(mu0 + Ad_{exp(theta xi)}^* n)
     *             - theta dexp_{-theta xi}^* Ad_{exp(theta xi)}^* n
     *   g1      = exp(xi) g0
     *   mu1     = Ad_{exp(-xi)}^* mu0 + Ad_{exp((theta - 1) xi)}^* n
     * Newton's method solves it to rounding. The order is 2 for theta = 1/2, otherwise 1. Steps of implicit
     * kinds keep nothing from the step before. */
    LG_SCHEME_SLGI,
    LG_SCHEME_VARIATIONAL, /* ode.step; machines have one of their own (liegrad/machine.h) */
    LG_SCHEME_KINDS
} lg_scheme_kind;

#define LG_CF_START (-1)
/* point = exp(h sum_j coefficient[n-1][j] f_j) ... exp(h sum_j coefficient[0][j] f_j) . base: coefficient[0]
 * is applied first. */
typedef struct lg_cf_row {
    int base;         /* LG_CF_START: y; i >= 0: the earlier stage point Y_i (counted from 0) is reused */
    int exponentials; /* n; 0: the point is the base itself */
    double coefficient[LG_SCHEME_MAX_EXPONENTIALS][LG_SCHEME_MAX_STAGES];
} lg_cf_row;

/* RKMK: adds h^2 weight [k_first, k_second] to the exponent of stage `row` for 1 <= row < stages, and to the
 * exponent of the step for row = stages; first, second < row. row = stages is not allowed with fsal, where
 * the last stage is the step. */
typedef struct lg_commutator {
    int row, first, second;
    double weight;
} lg_commutator;

#define LG_DENSE_POWERS 5

/* A scheme is data: copy one of the library's and change it, or fill in your own; nothing is registered. */
typedef struct lg_scheme {
    const char *name;
    lg_scheme_kind kind;
    bool ambient;       /* a classical method: only for spaces R^n (the ambient form of a system) */
    int order;          /* classical order of the solution */
    int stages;         /* 1..LG_SCHEME_MAX_STAGES */
    int embedded_order; /* order of the embedded solution; 0: there is none */
    bool fsal;   /* RKMK: the last row of a is b: its Y is y1, and f there is the first f of the next step */
    int dexpinv; /* RKMK: LG_DEXPINV_EXACT or the truncation K; order 3 needs K >= 1, orders 4, 5 K >= 2 */
    double c[LG_SCHEME_MAX_STAGES];
    double a[LG_SCHEME_MAX_STAGES][LG_SCHEME_MAX_STAGES]; /* RKMK: strictly lower triangular */
    double b[LG_SCHEME_MAX_STAGES];                       /* RKMK */
    double embedded[LG_SCHEME_MAX_STAGES];                /* RKMK: weights of the embedded solution */
    const lg_cf_row
        *rows; /* commutator-free: `stages` rows of Y_i, one of y1, one of the embedded solution if any */
    double kick[LG_SCHEME_MAX_STAGES];  /* splitting */
    double drift[LG_SCHEME_MAX_STAGES]; /* splitting */
    double theta;                       /* implicit, symplectic Lie group integrators */
    bool project; /* ambient: each step (and dense output) ends with a projection to ode.manifold, if set */
    const lg_commutator *commutators; /* RKMK; with them, dexpinv is usually 0 */
    int commutator_count;
    /* Dense output of order dense_order (0: none), for RKMK without commutators. The state at t + s h is
     * exp(h sum_i b_i(s) k_i) . y with b_i(s) = sum_j dense[i][j] s^(j+1). */
    int dense_order;
    double dense[LG_SCHEME_MAX_STAGES][LG_DENSE_POWERS];
} lg_scheme;

/* The schemes of the library.
 *
 * Classical (ambient = true):
 * - euler, implicit-euler, midpoint, rk4, rk4-projected
 * - dp54: Dormand-Prince 5(4), adaptive
 * - dp85: the method of order 8 in DOP853 with an estimate of order 5, adaptive
 * Splitting:
 * - symplectic-euler (p first), stormer-verlet
 * - forest-ruth: Forest and Ruth (1990), order 4, 3 forces a step
 * - blanes-moan: SRKN_6^b of Blanes and Moan (2002), order 4 with a small error, 6 forces a step
 * Variational:
 * - variational: the integrator of the system, or of machines (liegrad/machine.h)
 * Lie group methods. dexpinv is exact, except in lie-heun and rkmk4-2c, which have none (truncation 0):
 * - lie-euler
 * - lie-heun: k_2 = f(exp(h k_1) y), y1 = exp(h/2 (k_1 + k_2)) y
 * - rkmk3: Kutta's tableau
 * - rkmk4: the classical tableau; rkmk4-2c: the classical tableau with two commutators
 * - rkmk5, rkmk54: Dormand-Prince; rkmk54 is adaptive, with dense output of order 4
 * - cg3: Crouch and Grossman, order 3
 * - cf4; cf43: cf4 with an embedded solution of order 3, adaptive
 * - cf32a, cf32b: 3(2), adaptive
 * - slgi: theta = 1/2; for another theta copy the scheme
 *
 * lg_scheme_at takes 0..lg_scheme_count()-1 and returns NULL beyond. lg_scheme_find returns NULL for an
 * unknown name. Rows are static and constant. */
LG_API size_t lg_scheme_count(void);
LG_API const lg_scheme *lg_scheme_at(size_t index);
LG_API const lg_scheme *lg_scheme_find(const char *name);

/* Checks that the data is consistent, to 1e-12:
 * - numbers are in their ranges; rows and commutators are explicit
 * - c_i are the sums of the rows; weights sum to 1, those of dense output to s; FSAL rows are equal
 * - parts that the kind does not have are absent (embedded solution, dense output, commutators, projection)
 * The order is not checked. Errors: LG_INVALID_ARGUMENT with the reason in `error` (may be NULL). */
LG_API lg_status lg_scheme_check(const lg_scheme *scheme, lg_error *error);

/* ---- Steps ---- */

typedef struct lg_stepper lg_stepper;

/* Bytes that lg_stepper_init needs for this pair; 0 for arguments that lg_stepper_init would refuse. */
LG_API size_t lg_stepper_size(const lg_scheme *scheme, const lg_ode *ode);
/* Builds a stepper in the caller's `memory`: 64-byte aligned, at least lg_stepper_size bytes, outliving the
 * stepper. There is nothing to destroy. `ode` is copied; `scheme` and ode->user must outlive the stepper.
 * Errors:
 * - LG_INVALID_ARGUMENT: memory too small or misaligned, inconsistent scheme or space, missing functions
 * - LG_UNSUPPORTED: an ambient, splitting or implicit scheme on a space that is not R^n; splitting on an odd
 *   dimension; slgi on a space that is not T*G; an implicit scheme with more than 16384 unknowns */
LG_API lg_status lg_stepper_init(const lg_scheme *scheme, const lg_ode *ode, lg_stepper **out, void *memory,
                                 size_t bytes);
/* The same in memory from the context (NULL: the C library). Errors: those of lg_stepper_init,
 * LG_OUT_OF_MEMORY. */
LG_API lg_status lg_stepper_create(const lg_context *context, const lg_scheme *scheme, const lg_ode *ode,
                                   lg_stepper **out);
LG_API void lg_stepper_destroy(lg_stepper *stepper); /* NULL is fine */

/* One step: y_next = Phi_h(t, y), dim numbers; y_next may equal y. h may be negative. `input` goes to the
 * field, constant over the step; it may be NULL. With input NULL, a field value known at the same (t, y) is
 * reused: call lg_stepper_reset after you change what ode.user points to. Errors: those of the field;
 * LG_NOT_FINITE when y_next is not finite; LG_NO_CONVERGENCE (implicit kinds). y_next is then untouched. */
LG_API lg_status lg_step(lg_stepper *stepper, double t, double h, const double *y, const double *input,
                         double *y_next);
/* Forget field values kept from earlier steps. */
LG_API void lg_stepper_reset(lg_stepper *stepper);

/* The largest rotation angle among all exponents of the last step. */
LG_API double lg_stepper_angle(const lg_stepper *stepper);
/* Dense output: the state at t + s h inside the last step, 0 <= s <= 1. It lies on the manifold. Errors:
 * LG_UNSUPPORTED (dense_order is 0), LG_INVALID_ARGUMENT (no step yet, s outside). */
LG_API lg_status lg_stepper_dense(const lg_stepper *stepper, double s, double *y);
/* Evaluations of the field (of the force for splitting schemes, of ode.step for variational ones) since
 * lg_stepper_init. */
LG_API size_t lg_stepper_evaluations(const lg_stepper *stepper);

/* ---- Integration ---- */

typedef struct lg_run_stats {
    size_t steps;       /* accepted */
    size_t rejected;    /* adaptive only */
    size_t evaluations; /* of the field or the force, in this call */
    double max_angle;   /* largest rotation angle of an accepted step */
} lg_run_stats;

/* Makes `steps` steps of size h from t0; step n starts at t0 + n h. out (steps/every + 1, dim) holds every
 * `every`-th state (every >= 1 divides steps); row 0 is y0; out must not overlap y0. `inputs` is NULL or
 * (steps, input_dim), where row n is constant over step n. `stats` may be NULL. Errors: LG_INVALID_ARGUMENT
 * (steps 0, `every` 0 or not a divisor, non-finite t0, h or y0), those of lg_step. On failure the rows
 * reached are written, the others are untouched, and stats are filled. */
LG_API lg_status lg_integrate_fixed(lg_stepper *stepper, double t0, double h, size_t steps,
                                    const double *inputs, size_t input_dim, size_t every, const double *y0,
                                    double *out, lg_run_stats *stats);

/* Called after each accepted step from t to t + h, with the state at its end (dim numbers). A status other
 * than LG_OK ends the integration, which returns it. */
typedef lg_status (*lg_step_observer)(void *user, double t, double h, const double *y);

typedef struct lg_step_controller {
    size_t size; /* sizeof(lg_step_controller) */
    /* Tolerance of component i: atol_i + rtol max(|y_i| before, after the step); rtol >= 0, 1e-6.
     * - atol >= 0: atol_i = atol, in the unit of the state.
     * - atol < 0, default -1e-9: atol_i = -atol S + h N, for states in any units. S is the largest |y_j| that
     *   the component's group has had in this run, N what rounding changes in its velocity, measured at the
     *   start by one more value of the field. Groups are the single coordinates of R^n; otherwise q and p, R,
     *   R and r, x, G and P of each copy. On R^n with a `manifold`, the groups are the manifold's. */
    double rtol, atol;
    double safety;     /* 0.9 */
    double factor_min; /* 0.2 */
    double factor_max; /* 5 */
    double h_initial;  /* > 0, or 0: chosen from y0, f(t0, y0) and one more value of f */
    double h_max;      /* > 0, or 0: no bound */
    double max_angle;  /* a step with a larger rotation angle in any exponent is rejected; pi */
    size_t max_steps;  /* accepted and rejected together; 1000000 */
    /* true: dense output gives the times between steps, where the scheme has it. Otherwise steps are clipped
     * to end at the times. A step always ends at the last time. Default: false. */
    bool dense;
    lg_step_observer observe; /* NULL: nobody */
    void *observer;
} lg_step_controller;

LG_API void lg_step_controller_init(lg_step_controller *control);

typedef struct lg_step_history {
    double h;      /* the step just tried, > 0 */
    double angle;  /* its largest rotation angle */
    bool rejected; /* the step before it was rejected: no growth now */
} lg_step_history;

typedef struct lg_step_decision {
    bool accept;
    double h; /* the next step to try, > 0 */
} lg_step_decision;

/* Decides on a step; a pure function. `error` is the norm relative to the tolerance: the step is accepted
 * when error <= 1, and NaN rejects it. `exponent` is 1/(embedded_order + 1).
 *   h_next = h clamp(safety error^-exponent, factor_min, factor_max), at most h_max where h_max > 0
 * After a rejection the step does not grow. A step is also rejected when its angle exceeds max_angle or is
 * not finite; the next one is then at most half as long. */
LG_API lg_step_decision lg_step_controller_decide(const lg_step_controller *control, double exponent,
                                                  double error, const lg_step_history *history);

/* Integrates from (t0, y0) to each of times[0..count-1]; out (count, dim). The times are monotone in either
 * direction from t0, and neighbours may be equal. control->dense says how times between steps are reached.
 * `control` may be NULL for the defaults; `stats` may be NULL. Errors: LG_UNSUPPORTED (no embedded solution),
 * LG_INVALID_ARGUMENT (times, tolerances, non-finite start), LG_STEP_TOO_SMALL, LG_TOO_MANY_STEPS,
 * LG_NOT_FINITE (the field is not finite however small the step), those of the field. On failure the rows
 * reached are written, the others are untouched, and stats are filled. */
LG_API lg_status lg_integrate_adaptive(lg_stepper *stepper, const lg_step_controller *control, double t0,
                                       const double *y0, const double *times, size_t count, double *out,
                                       lg_run_stats *stats);

/* ---- files of schemes (library liegrad_io) ---- */

/* Reads a scheme from a YAML (or JSON) file and checks it with lg_scheme_check. Numbers are decimals or
 * quotients a/b. Keys of all kinds:
 *   name            default: the file's name
 *   kind            rkmk | runge-kutta (in the ambient space) | commutator-free | splitting
 *   order           of the method
 *   embedded_order  with `embedded`: order of the embedded solution, for adaptive steps
 * rkmk and runge-kutta:
 *   a               a list for each stage; the first one is empty
 *   b, embedded     one number for each stage
 *   c               default: the sums of the rows of a
 * rkmk only:
 *   dexpinv         exact or the truncation K; default exact, with commutators 0
 *   commutators     a list of [row, first, second, weight]; stages count from 1, row = stages + 1 is the step
 * commutator-free:
 *   rows            one row for each stage and one for the end of the step
 *   embedded        one row
 *   A row is a list of exponentials. An exponential is a list of coefficients; the first one in the row is
 *   applied first. A row with one exponential may be that list itself. {base: i, exponentials: [...]} starts
 *   at stage i.
 * splitting:
 *   kick, drift
 *
 * Example:
 *   kind: rkmk
 *   order: 3
 *   a: [[], [1/2], [-1, 2]]
 *   b: [1/6, 2/3, 1/6]
 *
 * lg_scheme_destroy frees the scheme; NULL is fine. */
LG_API lg_status lg_scheme_read(const lg_context *context, const char *path, lg_scheme **out,
                                lg_error *error);
LG_API void lg_scheme_destroy(lg_scheme *scheme);

LG_END_DECLS

#endif
