/* Integrators of ordinary differential equations in plain doubles. A reader finds here the spaces on which
 * states live, each with a transitive group action; the integration schemes, which are tables of numbers; the
 * stepper, which makes single steps with any scheme; and the loops over fixed and over adaptive steps. The
 * library is liegrad; the last section (files of schemes) is in liegrad_io. liegrad/taped.h has the same
 * schemes on a tape.
 *
 *   lg_ode ode = {.field = my_field, .user = &my_parameters};
 *   lg_space_init(&ode.space, &(lg_space_factor){LG_SPACE_TS2, links}, 1);
 *   lg_stepper *stepper;
 *   lg_stepper_create(context, lg_scheme_find("cf4"), &ode, &stepper);
 *   lg_integrate_fixed(stepper, 0.0, h, steps, NULL, 0, steps, y0, out, NULL);
 *   lg_stepper_destroy(stepper);
 *
 * Instead of lg_stepper_create, lg_stepper_size and lg_stepper_init build the stepper in the caller's memory;
 * then nothing is allocated at all. No function that takes a stepper allocates memory or locks, except
 * lg_stepper_destroy, which frees memory. Only one thread at a time may use a stepper. Arrays are borrowed
 * for the call. A pointer may be NULL only where a comment says so; otherwise functions that return a status
 * refuse NULL with LG_INVALID_ARGUMENT.
 *
 * A differential equation on a space M with a group action is y' = f(t, y) . y, where f has values in the
 * Lie algebra and a . y is the velocity d/ds exp(s a) . y at s = 0. On R^n the action is addition, and f
 * is the usual right-hand side. liegrad/geometry.h has the conventions of the groups. */
#ifndef LIEGRAD_INTEGRATORS_H
#define LIEGRAD_INTEGRATORS_H

#include "liegrad/core.h"

LG_BEGIN_DECLS

/* ---- Spaces ---- */

typedef enum lg_space_kind {
    /* R^n under addition. State and algebra have 1 number per copy, so n copies are R^n. */
    LG_SPACE_RN,
    /* T*S^2 (and TS^2) under SE(3). State (q, p), 6 numbers; algebra (u, v), 6 numbers. The action of (R,
     * r) is (R q, R p + r x R q). */
    LG_SPACE_TS2,
    /* SO(3) under itself. State R, 9 numbers row-major; algebra u, 3 numbers. The action of exp(u) is
     * exp(u) R. */
    LG_SPACE_SO3,
    /* SE(3) under itself. State (R, r), 12 numbers; algebra (u, v), 6 numbers. The action of exp(u, v) is
     * (exp(u) R, exp(u) r + dexp_u v). The space is also the right-trivialised T*SO(3); r is then the
     * spatial momentum. */
    LG_SPACE_SE3,
    /* so(3)* = R^3 under SO(3). State x, 3 numbers; algebra u, 3 numbers. The action of exp(u) is exp(u)
     * x. */
    LG_SPACE_SO3_DUAL,
    /* se(3)* = R^6 under SE(3). State (G, P), 6 numbers; algebra (u, v), 6 numbers. The action of (R, r)
     * is (R G, R P + r x R G), as on T*S^2, but |G| may have any value. */
    LG_SPACE_SE3_DUAL,
    LG_SPACE_KINDS
} lg_space_kind;

/* What the library knows about one kind of factor. The functions work on `count` copies, which lie one
 * after the other in each array. `out` may equal an input. */
typedef struct lg_space_entry {
    const char *name;
    size_t state;   /* Numbers in the state of one copy. */
    size_t algebra; /* Numbers in the algebra element of one copy, at most LG_SPACE_MAX_ALGEBRA. */
    /* The bracket is zero and dexpinv is the identity; `bracket` and `dexpinv` are then NULL. */
    bool abelian;
    void (*act)(size_t count, const double *a, const double *y, double *out); /* out = exp(a) . y */
    /* out = a . y, the velocity d/ds exp(s a) . y at s = 0, a vector of the ambient space. */
    void (*generator)(size_t count, const double *a, const double *y, double *out);
    void (*bracket)(size_t count, const double *a, const double *b, double *out);
    /* out = dexp_a^-1(b), closed form. */
    void (*dexpinv)(size_t count, const double *a, const double *b, double *out);
    void (*project)(size_t count, double *y); /* Replaces y by the nearby point of the manifold, in place. */
    /* The largest violation of a constraint of the manifold, absolute. NaN when y holds NaN. */
    double (*manifold_error)(size_t count, const double *y);
    /* The largest |u| of the rotations in a; 0 on R^n. */
    double (*angle)(size_t count, const double *a);
    /* Tangent coordinates c of vectors at y. The comment before lg_space_basis defines c. On R^n and on
     * the dual spaces c is the vector itself; `tangent` then equals `state`, and the four functions below
     * are NULL. */
    size_t tangent; /* Numbers in the coordinates c of one copy. */
    /* Writes the basis of the tangent space at y for one copy: a matrix (state, tangent) whose rows begin
     * `stride` numbers apart. */
    void (*basis)(const double *y, size_t stride, double *directions);
    void (*coordinates)(size_t count, const double *y, const double *vector, double *c);
    /* Writes the algebra element a whose generator at y is the tangent vector `vector`. */
    void (*lift)(size_t count, const double *y, const double *vector, double *a);
    /* Moves tangent vectors at y to tangent vectors at exp(a) . y: the derivative of `act` with respect to
     * y. */
    void (*carry)(size_t count, const double *a, const double *vector, double *out);
} lg_space_entry;

#define LG_SPACE_MAX_STATE   12
#define LG_SPACE_MAX_ALGEBRA 12
#define LG_SPACE_MAX_FACTORS 8

typedef struct lg_space_factor {
    lg_space_kind kind;
    size_t count; /* Number of copies; for LG_SPACE_RN the dimension n. */
} lg_space_factor;

/* A product of factors. The state has the states of the factors one after the other, in order; so has an
 * algebra element. Plain data, filled by lg_space_init; there is nothing to destroy. */
typedef struct lg_space {
    size_t factors;
    lg_space_factor factor[LG_SPACE_MAX_FACTORS];
    size_t dim;         /* Numbers in a state. */
    size_t algebra_dim; /* Numbers in an algebra element. */
    size_t tangent_dim; /* Numbers in the tangent coordinates of a vector. */
    /* Bit i says that each three numbers of factor i, which is R^3m, are a vector; it has no effect on other
     * factors. lg_space_init sets 0. */
    uint32_t vectors;
} lg_space;

/* Returns the entry of a kind of factor; NULL when `kind` is not one of the enumeration. The entry is
 * static and constant. */
LG_API const lg_space_entry *lg_space_kind_entry(lg_space_kind kind);

/* Fills `space` with the product of factors[0..count-1]. Errors: LG_INVALID_ARGUMENT (unknown kind, count
 * 0 or above LG_SPACE_MAX_FACTORS, a factor without copies or with so many that sizes would overflow). */
LG_API lg_status lg_space_init(lg_space *space, const lg_space_factor *factors, size_t count);
/* Fills `space` with R^n. Errors: those of lg_space_init. */
LG_API lg_status lg_space_init_rn(lg_space *space, size_t n);
/* True when every factor is R^n. Lie group schemes are then the classical schemes with the same
 * coefficients. */
LG_API bool lg_space_is_abelian(const lg_space *space);

/* Spaces as text, such as "T*S^2 x 3, R^2": the names of the factors in order; a factor with several
 * copies has their number after " x ", and R^n has its dimension n in the name. lg_space_text writes the
 * text with its terminator. lg_space_read accepts exactly the texts that lg_space_text writes. Errors of
 * lg_space_read: LG_FORMAT; `error` quotes the text from the place of the fault on. */
#define LG_SPACE_TEXT 256
LG_API void lg_space_text(const lg_space *space, char text[LG_SPACE_TEXT]);
LG_API lg_status lg_space_read(const char *text, lg_space *out, lg_error *error);

/* out = exp(a) . y. a has algebra_dim numbers, y and out have dim numbers; out may equal y. A result that
 * is within 1e-13 of T*S^2, SO(3) or SE(3) is projected there to first order, so that rounding errors do
 * not accumulate over many steps. A result farther away is not changed, so a start off the manifold keeps
 * its distance. */
LG_API void lg_space_act(const lg_space *space, const double *a, const double *y, double *out);
/* out = a . y, the ambient velocity (dim numbers) that the algebra element a gives at y; out may equal y. */
LG_API void lg_space_generator(const lg_space *space, const double *a, const double *y, double *out);
/* out = [a, b], the Lie bracket; algebra_dim numbers each. out may equal a or b. */
LG_API void lg_space_bracket(const lg_space *space, const double *a, const double *b, double *out);

#define LG_DEXPINV_EXACT (-1)
#define LG_DEXPINV_MAX   10
/* out = dexp_a^-1(b), algebra_dim numbers each; out may equal b. `truncation` is LG_DEXPINV_EXACT for the
 * closed form, or K in 0..LG_DEXPINV_MAX for the series up to k = K,
 *   sum_{k <= K} B_k/k! ad_a^k b = b - 1/2 [a, b] + 1/12 [a, [a, b]] + 0 - ... */
LG_API void lg_space_dexpinv(const lg_space *space, int truncation, const double *a, const double *b,
                             double *out);

/* Projects the state y onto the manifold, in place. On T*S^2, q becomes q / |q|, then p becomes
 * p - q (q.p). On SO(3) and SE(3), R becomes the nearest rotation, or NaN where its determinant is not
 * positive. R^n and the dual spaces are not changed. It is meant for starts that are off the manifold by
 * rounding, and for schemes with `project`. */
LG_API void lg_space_project(const lg_space *space, double *y);
/* Returns the largest violation of the constraints over all factors, absolute: on T*S^2 of | |q| - 1 | and
 * |q.p|; on SO(3) and SE(3) of the entries of R^T R - I, or 2 for a reflection; 0 on R^n and the dual
 * spaces. NaN when the state holds NaN. */
LG_API double lg_space_manifold_error(const lg_space *space, const double *y);
/* Returns the largest rotation angle |u| in the algebra element a; NaN when a holds NaN. */
LG_API double lg_space_angle(const lg_space *space, const double *a);

/* Tangent coordinates. The coordinates c (tangent_dim numbers) of an ambient vector at y come factor after
 * factor, and within a factor copy after copy:
 *   R^n, so(3)*, se(3)*  c is the vector
 *   T*S^2   c = (a_1, a_2, b_1, b_2): dq = a_1 e_1 + a_2 e_2, dp = b_1 e_1 + b_2 e_2 - q (dq.p);
 *           a_j = e_j.dq, b_j = e_j.dp. e_1 is the coordinate axis of the smallest |component| of q (of the
 *           first one if several are equal), made orthogonal to q and of length 1; e_2 = q x e_1.
 *   SO(3)   c is a rotation vector in the body: dR = R hat(c); c is the vector of the skew part of R^T dR.
 *   SE(3)   c = (rotation vector as on SO(3), dr)
 *
 * lg_space_basis writes a matrix `basis` (dim, tangent_dim), row-major: column j is the tangent vector
 * whose coordinates are 1 at place j and 0 elsewhere. lg_space_coordinates writes the coordinates c of
 * `vector` (dim). If `vector` is not tangent, c describes only a tangent part of it: the formulas above
 * are evaluated all the same. */
LG_API void lg_space_basis(const lg_space *space, const double *y, double *basis);
LG_API void lg_space_coordinates(const lg_space *space, const double *y, const double *vector, double *c);
/* out (dim) = exp(a) . y, where a is the algebra element whose generator at y is the tangent vector
 * `vector` (dim). On R^n and the dual spaces out = y + vector. If y is on the manifold, so is out. out may
 * be y. `carried` (may be NULL) becomes a matrix (tangent_dim, tangent_dim), row-major. The derivative of
 * the map y -> exp(a) . y with fixed a takes tangent vectors at y to tangent vectors at `out`; the matrix
 * takes their coordinates at y to their coordinates at `out`. On R^n and the dual spaces it is the unit
 * matrix. */
LG_API void lg_space_retract(const lg_space *space, const double *y, const double *vector, double *out,
                             double *carried);

/* ---- Differential equations ---- */

/* The right-hand side: writes algebra = f(t, y), ode.space.algebra_dim numbers. `y` has ode.space.dim
 * numbers. `input` is the input that lg_stepper_step got, or NULL. A status other than LG_OK ends the
 * integration, which returns it. One exception: after LG_NOT_FINITE an adaptive integration first tries
 * smaller steps. */
typedef lg_status (*lg_vector_field)(void *user, double t, const double *y, const double *input,
                                     double *algebra);
/* The right-hand side of one half of a separable system on R^2n, y = (q, p). For the force -dV/dq, `half`
 * is q; for the velocity dK/dp, `half` is p. `half` and `out` have n numbers each. `input` and the status
 * are as in lg_vector_field. */
typedef lg_status (*lg_half_field)(void *user, double t, const double *half, const double *input,
                                   double *out);

/* One step of a variational integrator that belongs to the system, in place: y at time t becomes y at
 * t + h. The function must keep nothing between steps. A status other than LG_OK ends the integration,
 * which returns it. */
typedef lg_status (*lg_variational_step)(void *user, double t, double h, double *y);

typedef struct lg_ode {
    lg_space space;
    lg_vector_field field;  /* May be NULL when only splitting or variational schemes are used. */
    lg_half_field force;    /* NULL when the system is not separable. */
    lg_half_field velocity; /* NULL if and only if `force` is NULL. */
    void *user;
    /* For equations in ambient coordinates, where `space` is R^n: the manifold in R^n on which the states
     * lie. Schemes with `project` project onto it, and tolerances use its groups (lg_step_controller).
     * factors = 0 means that there is no manifold. */
    lg_space manifold;
    lg_variational_step step; /* NULL when the system has no variational integrator. */
} lg_ode;

/* ---- Schemes ---- */

#define LG_SCHEME_MAX_STAGES       16
#define LG_SCHEME_MAX_EXPONENTIALS 4

/* The kinds of schemes, with the formulas of a step. h is the step, y the state at its start, y1 the state
 * at its end. */
typedef enum lg_scheme_kind {
    /* Runge-Kutta-Munthe-Kaas methods, explicit; on R^n they are the classical Runge-Kutta methods:
     *   sigma_i = h sum_j a_ij k_j
     *   Y_i     = exp(sigma_i) . y
     *   k_i     = dexpinv_{sigma_i} f(t + c_i h, Y_i)
     *   y1      = exp(h sum_i b_i k_i) . y */
    LG_SCHEME_RKMK,
    /* Commutator-free methods, explicit. With f_i = f(t + c_i h, Y_i), each stage Y_i and the end y1 are
     * products of exponentials of linear combinations of the f_j, applied to a point; lg_cf_row describes
     * such a product. */
    LG_SCHEME_COMMUTATOR_FREE,
    /* Splitting methods on R^2n. For i = 0..stages-1: p += kick_i h force(q), then q +=
     * drift_i h velocity(p). As long as q has not changed, the force is evaluated once only, within a step
     * and from one step to the next. */
    LG_SCHEME_SPLITTING,
    /* Implicit methods on R^n with one stage, 0 <= theta <= 1:
     *   Y  = y + theta h f(t + theta h, Y)
     *   y1 = y + h f(t + theta h, Y)
     * Newton's method solves for Y to rounding. Its Jacobian is a full matrix from difference quotients;
     * it takes 8 n^2 bytes of the stepper, and n is at most 16384. theta = 1 is implicit Euler,
     * theta = 1/2 the midpoint rule. */
    LG_SCHEME_IMPLICIT,
    /* Symplectic Lie group integrators (Celledoni, Marthinsen, Owren) on T*G, 0 <= theta <= 1, with
     * G = SO(3) x R^m. The space must be one factor SE(3), which may be followed by one factor R^2m with the
     * state (q, p).
     *   (xi, n) = h f(exp(theta xi) . g0, M_theta)
     *   M_theta = dexp_{-xi}^*(mu0 + Ad_{exp(theta xi)}^* n)
     *             - theta dexp_{-theta xi}^* Ad_{exp(theta xi)}^* n
     *   g1      = exp(xi) g0
     *   mu1     = Ad_{exp(-xi)}^* mu0 + Ad_{exp((theta - 1) xi)}^* n
     * Newton's method solves for (xi, n) to rounding. The order is 2 for theta = 1/2, otherwise 1. The
     * steps of this kind and of LG_SCHEME_IMPLICIT keep nothing from the step before. */
    LG_SCHEME_SLGI,
    /* The step is ode.step. Machines have a variational integrator (liegrad/machine.h). */
    LG_SCHEME_VARIATIONAL,
    LG_SCHEME_KINDS
} lg_scheme_kind;

#define LG_CF_START (-1)
/* One row of a commutator-free scheme. It gives the point
 *   exp(h sum_j coefficient[n-1][j] f_j) ... exp(h sum_j coefficient[0][j] f_j) . base
 * where n is `exponentials`. The exponential with coefficient[0] is applied first. */
typedef struct lg_cf_row {
    /* The point to which the exponentials are applied: LG_CF_START for y, or i >= 0 for the earlier stage
     * point Y_i, where stages count from 0. */
    int base;
    int exponentials; /* n; with 0 the point is the base itself. */
    double coefficient[LG_SCHEME_MAX_EXPONENTIALS][LG_SCHEME_MAX_STAGES];
} lg_cf_row;

/* A commutator of a scheme of kind LG_SCHEME_RKMK. It adds h^2 weight [k_first, k_second] to the exponent
 * sigma of stage `row` for 1 <= row < stages, and to the exponent of the whole step for row = stages.
 * Stages count from 0; first and second are below `row`. row = stages is not allowed when `fsal` is true:
 * the exponent of the last stage is then that of the step. */
typedef struct lg_commutator {
    int row, first, second;
    double weight;
} lg_commutator;

#define LG_DENSE_POWERS 5

/* A scheme is plain data. To make a new one, copy a scheme of the library and change it, or fill in all
 * members; lg_scheme_check checks it, and schemes need not be registered. Where only some kinds use a
 * member, its comment begins with these kinds. */
typedef struct lg_scheme {
    const char *name;
    lg_scheme_kind kind;
    /* A classical method, which works in the ambient space: the space must be R^n (LG_COORDINATES_AMBIENT
     * of a system). */
    bool ambient;
    int order;          /* Classical order of the solution. */
    int stages;         /* 1..LG_SCHEME_MAX_STAGES */
    int embedded_order; /* Order of the embedded solution; 0 means that there is none. */
    /* RKMK, first same as last: the last row of a equals b. So the last stage Y is y1, and f there is the
     * first f of the next step. */
    bool fsal;
    /* RKMK: LG_DEXPINV_EXACT, or the truncation K of lg_space_dexpinv. Order 3 needs K >= 1, orders 4 and
     * 5 need K >= 2. */
    int dexpinv;
    double c[LG_SCHEME_MAX_STAGES];
    double a[LG_SCHEME_MAX_STAGES][LG_SCHEME_MAX_STAGES]; /* RKMK: strictly lower triangular. */
    double b[LG_SCHEME_MAX_STAGES];                       /* RKMK: weights of the solution. */
    double embedded[LG_SCHEME_MAX_STAGES];                /* RKMK: weights of the embedded solution. */
    /* Commutator-free: one row per stage for Y_i, then one row for y1, then one row for the embedded
     * solution if there is one. The rows must outlive the scheme. */
    const lg_cf_row *rows;
    double kick[LG_SCHEME_MAX_STAGES];  /* Splitting: `stages` numbers. */
    double drift[LG_SCHEME_MAX_STAGES]; /* Splitting: `stages` numbers. */
    double theta;                       /* LG_SCHEME_IMPLICIT and LG_SCHEME_SLGI. */
    /* Ambient schemes only: each step, and each state from dense output, is projected onto ode.manifold if
     * there is one. */
    bool project;
    /* RKMK: `commutator_count` entries, which must outlive the scheme. A scheme with commutators usually
     * has dexpinv 0. */
    const lg_commutator *commutators;
    int commutator_count;
    /* Dense output, for RKMK without commutators. dense_order is its order; 0 means that there is none.
     * The state at t + s h is exp(h sum_i b_i(s) k_i) . y with b_i(s) = sum_j dense[i][j] s^(j+1). */
    int dense_order;
    double dense[LG_SCHEME_MAX_STAGES][LG_DENSE_POWERS];
} lg_scheme;

/* The schemes of the library, by name, which docs/simulate.md lists with their sources ("Choosing a method").
 * lg_scheme_at returns NULL for an index beyond the last one, lg_scheme_find for an unknown name. The schemes
 * are static and constant. */
LG_API size_t lg_scheme_count(void);
LG_API const lg_scheme *lg_scheme_at(size_t index);
LG_API const lg_scheme *lg_scheme_find(const char *name);

/* Checks that the numbers of a scheme are consistent, to 1e-12:
 * - All numbers are in their ranges, and stages and commutators use earlier stages only.
 * - c_i is the sum of row i of a (commutator-free: of the coefficients of row i and of its base). The weights
 *   sum to 1, the kicks to 1, the drifts to 1, and the weights of dense output to s. With `fsal` the last row
 *   of a equals b.
 * - What the kind cannot have is absent: embedded solution, dense output, commutators, projection.
 *
 * The order is not checked. Errors: LG_INVALID_ARGUMENT, with the reason in `error`. */
LG_API lg_status lg_scheme_check(const lg_scheme *scheme, lg_error *error);

/* ---- Steps ---- */

typedef struct lg_stepper lg_stepper;

/* Bytes of memory that lg_stepper_init needs for this scheme and equation; 0 for a scheme or an equation
 * that lg_stepper_init would refuse. */
LG_API size_t lg_stepper_size(const lg_scheme *scheme, const lg_ode *ode);
/* Builds a stepper in the caller's `memory` and writes its address to *out. `memory` is 64-byte aligned, has
 * at least lg_stepper_size bytes (`bytes` says how many) and must outlive the stepper. There is nothing to
 * destroy, and lg_stepper_destroy must not be called. `ode` is copied; `scheme` and ode->user must outlive
 * the stepper. Errors:
 * - LG_INVALID_ARGUMENT: memory too small or misaligned, an inconsistent scheme or space, a function that the
 *   scheme needs is missing, a manifold of another dimension than the space
 * - LG_UNSUPPORTED: an ambient, splitting or implicit scheme on a space that is not R^n; a splitting
 *   scheme on an odd dimension; LG_SCHEME_SLGI on a space that is not T*G; an implicit scheme with more
 *   than 16384 unknowns */
LG_API lg_status lg_stepper_init(const lg_scheme *scheme, const lg_ode *ode, lg_stepper **out, void *memory,
                                 size_t bytes);
/* Like lg_stepper_init, in memory that the function takes from the context (NULL: the C library's memory).
 * Errors: those of lg_stepper_init. */
LG_API lg_status lg_stepper_create(const lg_context *context, const lg_scheme *scheme, const lg_ode *ode,
                                   lg_stepper **out);
LG_API void lg_stepper_destroy(lg_stepper *stepper);

/* One step: y_next (dim) becomes the state at t + h, from the state y (dim) at t; y_next may equal y. h
 * may be negative. `input` goes to the field and is constant over the step; it may be NULL. When it is
 * NULL, a value of the field that is known from an earlier step at the same (t, y) is used again.
 * Therefore call lg_stepper_reset after you change data behind ode.user. Errors: those of the field;
 * LG_NOT_FINITE (y_next would not be finite); LG_NO_CONVERGENCE (Newton's method in implicit and
 * variational schemes). After an error y_next is untouched. */
LG_API lg_status lg_stepper_step(lg_stepper *stepper, double t, double h, const double *y,
                                 const double *input, double *y_next);
/* Forgets the values of the field that are kept from earlier steps. */
LG_API void lg_stepper_reset(lg_stepper *stepper);

/* Returns the largest rotation angle among all exponents of the last step; 0 on R^n. */
LG_API double lg_stepper_angle(const lg_stepper *stepper);
/* Dense output: writes the state (dim) at t + s h inside the last step, 0 <= s <= 1. On a space other than
 * R^n it lies on the manifold if the start of the step does. Errors: LG_UNSUPPORTED (the scheme's
 * dense_order is 0), LG_INVALID_ARGUMENT (no successful step yet, s outside 0..1). */
LG_API lg_status lg_stepper_dense(const lg_stepper *stepper, double s, double *y);
/* Number of evaluations of the field since lg_stepper_init. For splitting schemes it counts the force, for
 * variational schemes the calls of ode.step. */
LG_API size_t lg_stepper_evaluations(const lg_stepper *stepper);

/* ---- Integration ---- */

typedef struct lg_run_stats {
    size_t steps;       /* Accepted steps. */
    size_t rejected;    /* Rejected steps; 0 with fixed steps. */
    size_t evaluations; /* Evaluations in this call, counted as by lg_stepper_evaluations. */
    double max_angle;   /* Largest rotation angle of an accepted step. */
} lg_run_stats;

/* Makes `steps` steps of size h from the state y0 at t0; step n = 0, 1, ... starts at t0 + n h. `every`
 * must divide `steps`: out (steps/every + 1, dim) gets every `every`-th state, and its row 0 is y0. out
 * must not overlap y0. `inputs` is NULL or an array (steps, input_dim), whose row n is the constant input
 * of step n. `stats` may be NULL. Errors: LG_INVALID_ARGUMENT (steps or every is 0, every does not divide
 * steps, t0, h or y0 is not finite), those of lg_stepper_step. On failure the rows of the times that were
 * reached are written, the others are untouched, and `stats` is filled. */
LG_API lg_status lg_integrate_fixed(lg_stepper *stepper, double t0, double h, size_t steps,
                                    const double *inputs, size_t input_dim, size_t every, const double *y0,
                                    double *out, lg_run_stats *stats);

/* Called after each accepted step from t to t + h; y is the state at t + h (dim numbers). A status other
 * than LG_OK ends the integration, which returns it. */
typedef lg_status (*lg_step_observer)(void *user, double t, double h, const double *y);

typedef struct lg_step_controller {
    size_t size; /* sizeof(lg_step_controller) */
    /* Tolerances, default 1e-6 and -1e-9. A step's error in component i may be about atol_i + rtol
     * max(|y_i|), with the larger of |y_i| before and after the step; rtol >= 0.
     * - atol >= 0: atol_i = atol, in the unit of the state.
     * - atol < 0: atol_i = -atol S + h N, which suits states in any units. S is the largest |y_j| so far in
     *   this run among the numbers of the component's group. N is by how much rounding errors of the state
     *   change the velocity of that group; it is measured once, at the start, by one more evaluation of the
     *   field.
     *
     * A group is a set of numbers with one unit: each single coordinate of R^n, or each of its vectors
     * (lg_space.vectors); q and p of each copy of T*S^2; R of SO(3); R and r of SE(3); x of so(3)*; G and P
     * of se(3)*. Where the space is R^n and the ode has a `manifold`, the groups are those of the manifold.
     * With atol < 0 a coordinate of R^n that begins at 0 and rises as a high power of the time needs short
     * first steps; above the order of the scheme no step is short enough. */
    double rtol, atol;
    double safety;     /* In (0, 1); default 0.9. */
    double factor_min; /* In (0, 1); default 0.2. */
    double factor_max; /* Above 1; default 5. */
    /* First step > 0. Default 0: it is chosen from y0, f(t0, y0) and one more evaluation of f. */
    double h_initial;
    double h_max; /* Longest step; default 0: no bound. */
    /* A step with a larger rotation angle in any of its exponents is rejected. Radians; default pi. */
    double max_angle;
    size_t max_steps; /* Most steps, accepted and rejected together; default 1000000. */
    /* How states at times between the ends of steps are found. true: by dense output, if the scheme has
     * it. Otherwise steps are shortened so that they end at these times. A step always ends at the last
     * time. Default false. */
    bool dense;
    /* Above 0: this many equal steps, whatever their errors; of the other settings only `observe` is used. A
     * time between the ends of steps then needs dense output, else LG_UNSUPPORTED. Default 0. */
    size_t steps;
    lg_step_observer observe; /* Called after each accepted step; may be NULL. */
    void *observer;
} lg_step_controller;

LG_API void lg_step_controller_init(lg_step_controller *control);

typedef struct lg_step_history {
    double h;     /* The step that was just tried, > 0. */
    double angle; /* Its largest rotation angle. */
    /* The attempt before this one was rejected; then the step must not grow now. */
    bool rejected;
} lg_step_history;

typedef struct lg_step_decision {
    bool accept;
    double h; /* The next step to try, > 0. */
} lg_step_decision;

/* Decides whether a step is accepted, and the next step size; a pure function. `error` is the norm of the
 * estimated error relative to the tolerance: the step is accepted when error <= 1, and NaN rejects it.
 * `exponent` is 1/(k + 1), where k is the smaller of the orders of the solution and of the embedded solution.
 *   h_next = h clamp(safety error^-exponent, factor_min, factor_max), at most h_max where h_max > 0
 * When the attempt is rejected, or the one before it was, h_next is at most h. A step is also rejected
 * when its angle exceeds max_angle or is not finite; h_next is then at most h/2. h_next is also limited so
 * that its angle, taken as proportional to the step, stays below safety max_angle. */
LG_API lg_step_decision lg_step_controller_decide(const lg_step_controller *control, double exponent,
                                                  double error, const lg_step_history *history);

/* Integrates from the state y0 (dim) at t0 with adaptive steps; row i of out (count, dim) becomes the
 * state at times[i]. The times increase or decrease monotonically from t0, and neighbours may be equal.
 * control->dense says how times between steps are reached. `control` may be NULL for the defaults; `stats`
 * may be NULL. Errors: LG_UNSUPPORTED (the scheme has no embedded solution), LG_INVALID_ARGUMENT (times,
 * controller, a start that is not finite), LG_STEP_TOO_SMALL, LG_TOO_MANY_STEPS, LG_NOT_FINITE (the field
 * is not finite however small the step is), those of the field and of the observer. On failure the rows of
 * the times that were reached are written, the others are untouched, and `stats` is filled. */
LG_API lg_status lg_integrate_adaptive(lg_stepper *stepper, const lg_step_controller *control, double t0,
                                       const double *y0, const double *times, size_t count, double *out,
                                       lg_run_stats *stats);

/* Solves y' = f(t, y) . y in one call (on R^n: y' = f(t, y)). `space` is a text of lg_space_read, such as
 * "R^2" or "SO(3), R^3"; field and user are those of lg_ode. y0 (dim) is the state at times[0];
 * out (count, dim) becomes the states at `times`, which only rise or only fall. The scheme is rkmk54 (on
 * R^n it is dp54) with adaptive steps, whose relative error stays near `tolerance`, such as 1e-8 (rtol =
 * tolerance, atol = -tolerance).
 *
 *   static lg_status pendulum(void *user, double t, const double *y, const double *input, double *f) {
 *       f[0] = y[1], f[1] = -sin(y[0]);
 *       return LG_OK;
 *   }
 *   lg_ode_solve(NULL, "R^2", pendulum, NULL, 1e-8, times, 101, (double[]){1, 0}, out, &error);
 *
 * Errors, with the time that was reached in `error`: LG_FORMAT (the space), LG_INVALID_ARGUMENT (tolerance,
 * times, a start that is not finite), the other errors of lg_integrate_adaptive. Rows of times that were
 * reached are written. */
LG_API lg_status lg_ode_solve(const lg_context *context, const char *space, lg_vector_field field, void *user,
                              double tolerance, const double *times, size_t count, const double *y0,
                              double *out, lg_error *error);

/* ---- Files of schemes (library liegrad_io) ---- */

/* Reads a scheme from a YAML (or JSON) file, whose keys are in docs/files.md ("Schemes"), and checks it with
 * lg_scheme_check. lg_scheme_destroy allows no scheme of another origin. */
LG_API lg_status lg_scheme_read(const lg_context *context, const char *path, lg_scheme **out,
                                lg_error *error);
LG_API void lg_scheme_destroy(lg_scheme *scheme);

LG_END_DECLS

#endif
