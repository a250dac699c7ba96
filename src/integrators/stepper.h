/* Inside of a stepper. */
#ifndef LG_STEPPER_H
#define LG_STEPPER_H

#include "core/core.h"
#include "liegrad/integrators.h"

/* A field value and where it was taken. For splitting schemes y holds q and value the force. */
typedef struct lg_memo {
    bool valid;
    double t;
    double *y;     /* dim */
    double *value; /* a row */
    bool is_packed;
    double *packed[2]; /* for a packed stepper: y and value */
} lg_memo;

/* Newton's method for one implicit stage; m = algebra_dim. */
typedef struct lg_newton {
    double *z, *trial;   /* m: h times the field at the stage */
    double *residual;    /* m: z - h f(stage(z)) */
    double *step, *next; /* m: Newton corrections */
    double *scale;       /* m: the size of a component that rounding is measured by, > 0 */
    double *jacobian;    /* (m, m): of the residual, then its factors */
    size_t *pivot;       /* m */
} lg_newton;

/* The absolute tolerances of an adaptive run, and what they are made of where the step control gives a part
 * of the groups' sizes (integrators/groups.h). */
typedef struct lg_tolerance {
    double *atol;         /* (dim) */
    size_t groups, *end;  /* (groups) */
    double *size, *tried; /* (groups): the largest |y_i| up to now; with the attempt */
    double *noise;        /* (groups): of y', by rounding */
} lg_tolerance;

/* An element of the algebra is a row of whole blocks (LG_K_STAGE_BLOCK), aligned. The entries beyond
 * algebra_dim are 0. */
typedef struct lg_step_form lg_step_form;

struct lg_stepper {
    const lg_context *context; /* of lg_stepper_create */
    const lg_scheme *scheme;
    const lg_step_form *form; /* see stepper.c */
    lg_ode ode;
    size_t evaluations;
    double angle;  /* largest in the last step */
    double h;      /* the size of the last step */
    bool memoises; /* the first evaluation of a step may be known already */
    bool abelian;  /* the space is R^n: no angles */
    bool identity; /* dexpinv changes nothing: k_i is the field's value */
    bool dense;    /* the last step succeeded: dense output may look at it */
    const struct lg_kernels *kernels;
    lg_memo memo[2];
    size_t row_stride;                       /* numbers in a row, at least algebra_dim */
    double *k;                               /* (stages, row_stride) */
    const double *row[LG_SCHEME_MAX_STAGES]; /* k_i of this step: in k, or where a memo keeps it */
    double *sigma;                           /* row_stride */
    double *bracket;                         /* row_stride */
    double *most;                            /* LG_SE3_BLOCK: squares of angles, for packed steps */
    double difference[LG_SCHEME_MAX_STAGES]; /* RKMK: b less the weights of the embedded solution */
    double *point;                           /* (stages, dim) for commutator-free schemes, else dim */
    double *y_next; /* dim; for FSAL schemes memo[1].y, where the next step's first value waits */
    double *error;  /* dim */
    double *run[2]; /* dim each, for the loops over steps */
    lg_tolerance tolerance;
    lg_newton newton;
};

/* f(t, y) for a step of size about h, from memory when it is known; *f stays valid during the step. */
lg_status lg_stepper_first(lg_stepper *s, double t, double h, const double *y, const double *input,
                           const double **f);
/* f(t, y) at the end of a step of size about h, which the next step needs too; valid until then. */
lg_status lg_stepper_last(lg_stepper *s, double t, double h, const double *y, const double **f);
lg_status lg_stepper_evaluate(lg_stepper *s, double t, const double *y, const double *input, double *out);
/* Takes the angle of an exponent into account. */
void lg_stepper_turn(lg_stepper *s, const double *a);

/* Says whether the memo holds this time, up to rounding, and this y of n numbers. The second function sets
 * both. */
bool lg_memo_holds(const lg_memo *memo, size_t n, double t, double h, const double *y);
void lg_memo_keep(lg_memo *memo, size_t n, double t, const double *y);

/* Steps of single kinds: from (t, y) to s->y_next. */
lg_status lg_step_rkmk(lg_stepper *s, double t, double h, const double *y, const double *input);
lg_status lg_step_commutator_free(lg_stepper *s, double t, double h, const double *y, const double *input);
lg_status lg_step_splitting(lg_stepper *s, double t, double h, const double *y, const double *input);
lg_status lg_step_variational(lg_stepper *s, double t, double h, const double *y, const double *input);
lg_status lg_step_implicit(lg_stepper *s, double t, double h, const double *y, const double *input);
lg_status lg_step_slgi(lg_stepper *s, double t, double h, const double *y, const double *input);

/* RKMK for copies of T*S^2, packed; states and rows have room for whole blocks of copies. */
bool lg_packed_fits(const lg_scheme *scheme, const lg_space *space);
lg_status lg_step_packed(lg_stepper *s, double t, double h, const double *y, const double *input);
/* The state of the last step at which the k_i have these weights. */
void lg_dense_rkmk(const lg_stepper *s, const double *weight, double *y);
void lg_dense_packed(const lg_stepper *s, const double *weight, double *y);

/* Solves z = h f(t + theta h, stage(z)) into s->newton.z. `stage` writes the point of z. The caller sets
 * newton.scale. Errors: LG_NO_CONVERGENCE, LG_NOT_FINITE (the field at y is not finite), the field's. */
typedef void (*lg_stage_map)(const lg_stepper *s, const double *y, const double *z, double *point);
lg_status lg_newton_solve(lg_stepper *s, double t, double h, const double *y, const double *input,
                          lg_stage_map stage);
/* One factor SE(3), then perhaps one R^2m. */
bool lg_slgi_fits(const lg_space *space);

/* At the start run[0] of an adaptive run over a time `span`, where f = f(t, run[0]). The tolerances are then
 * those for choosing the first step: of each group as a whole, and a group that begins at 0 counts as large
 * as its velocity makes it in the whole run. Overwrites error, run[1], point, bracket. Errors: the field's.
 */
lg_status lg_tolerance_begin(lg_stepper *s, const lg_step_controller *control, double t, double span,
                             const double *f);
/* For an attempt of size h that ends at y_next; and when it is accepted. */
void lg_tolerance_try(lg_stepper *s, const lg_step_controller *control, double h, const double *y_next);
void lg_tolerance_accept(lg_stepper *s);

bool lg_all_finite(size_t n, const double *x);
bool lg_step_controller_valid(const lg_step_controller *control);

/* The estimated local error of the last step as an ambient vector (dim numbers); NULL when the scheme has no
 * embedded solution. RKMK: h sum (b_i - embedded_i) k_i, mapped by the generator at y_next. Commutator-free
 * schemes: the difference of the two solutions. */
const double *lg_stepper_error(const lg_stepper *stepper);
/* Root mean square of error_i / (atol_i + rtol max(|y_i|, |y_next_i|)); 0/0 counts as 0. All arrays have dim
 * numbers. */
double lg_error_norm(double rtol, const double *atol, const double *error, const double *y,
                     const double *y_next, size_t dim);

#endif
