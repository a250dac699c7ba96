/* Internals of a stepper. */
#ifndef LG_STEPPER_H
#define LG_STEPPER_H

#include "core/core.h"
#include "liegrad/integrators.h"

/* A value of the field, with the time and the state at which it was computed. For splitting schemes y holds
 * q, and value holds the force. */
typedef struct lg_memo {
    bool valid;
    double t;
    double *y;     /* dim */
    double *value; /* row_stride numbers, algebra_dim of them used */
    bool is_packed;
    double *packed[2]; /* y and value in the packed layout, for steppers of the packed form */
} lg_memo;

/* Newton's method for one implicit stage; m = algebra_dim. */
typedef struct lg_newton {
    double *z, *trial;   /* m: the unknown z = h f(stage(z)), and a trial value of it */
    double *residual;    /* m: z - h f(stage(z)) */
    double *step, *next; /* m: Newton corrections */
    double *scale;       /* m, > 0: typical size of each component; errors are measured relative to it */
    double *jacobian;    /* (m, m): Jacobian of the residual, then its LU factors */
    size_t *pivot;       /* m */
} lg_newton;

/* The absolute tolerances of an adaptive run. Where the step controller's atol is negative, they are computed
 * from the sizes and the rounding noise of the state's groups (integrators/groups.h). */
typedef struct lg_tolerance {
    double *atol;         /* (dim) */
    size_t groups, *end;  /* number of groups; (groups): ends as lg_space_groups writes them */
    double *size, *tried; /* (groups): largest |y_i| over the accepted steps; the same with the attempt */
    double *noise;        /* (groups): change of y' by rounding */
} lg_tolerance;

/* A row holds an algebra element. It is aligned, its length is a multiple of LG_K_STAGE_BLOCK, and its
 * entries beyond algebra_dim are 0. */
typedef struct lg_step_form lg_step_form;

struct lg_stepper {
    const lg_context *context; /* as given to lg_stepper_create */
    const lg_scheme *scheme;
    const lg_step_form *form; /* see stepper.c */
    lg_ode ode;
    size_t evaluations;
    double angle; /* largest rotation angle in the last step */
    double t;     /* the start of the current step; with its input, of explicit schemes only */
    const double *input;
    double h;      /* the size of the last step */
    bool memoises; /* field values are kept, so that the first one of a step may be known already */
    bool abelian;  /* the space is R^n: no angles */
    bool identity; /* commutator-free, or dexpinv is the identity: k_i is the field's value */
    bool dense;    /* the last step succeeded and its scheme has dense output */
    const struct lg_kernels *kernels;
    lg_memo memo[2];
    size_t row_stride;                       /* numbers in a row, at least algebra_dim */
    double *k;                               /* (stages, row_stride) */
    const double *row[LG_SCHEME_MAX_STAGES]; /* k_i of this step: a row of `k`, or the value in a memo */
    double *sigma;                           /* row_stride */
    double *bracket;                         /* row_stride */
    double *most;                            /* LG_SE3_BLOCK: largest squared angles of a packed step */
    double difference[LG_SCHEME_MAX_STAGES]; /* RKMK: b - embedded */
    double *point;                           /* stage points: (stages, dim) if commutator-free, else (dim) */
    double *y_next; /* dim; FSAL: this is memo[1].y, as memo[1] keeps the first value of the next step */
    double *error;  /* dim: estimated error of the last step, an ambient vector */
    double *run[2]; /* dim each: the current and the next state of an integration */
    lg_tolerance tolerance;
    lg_newton newton;
};

/* *f = f(t, y) at the start of a step of size about h, from a memo if it is known. Valid during the step. */
lg_status lg_stepper_first(lg_stepper *s, double t, double h, const double *y, const double *input,
                           const double **f);
/* *f = f(t, y) at the end of a step of size about h, kept for the next step if possible. Valid until then. */
lg_status lg_stepper_last(lg_stepper *s, double t, double h, const double *y, const double **f);
lg_status lg_stepper_evaluate(lg_stepper *s, double t, const double *y, const double *input, double *out);
/* Raises s->angle to the rotation angle of the exponent a if that is larger. */
void lg_stepper_turn(lg_stepper *s, const double *a);

/* lg_memo_holds says whether the memo was taken at time t (up to rounding, for steps of size h) and at
 * exactly this y (n numbers). lg_memo_keep stores t and y and marks the memo as valid. */
bool lg_memo_holds(const lg_memo *memo, size_t n, double t, double h, const double *y);
void lg_memo_keep(lg_memo *memo, size_t n, double t, const double *y);

/* One step of size h from (t, y), one function per kind of scheme. The result is in s->y_next. */
lg_status lg_step_rkmk(lg_stepper *s, double t, double h, const double *y, const double *input);
lg_status lg_step_commutator_free(lg_stepper *s, double t, double h, const double *y, const double *input);
lg_status lg_step_splitting(lg_stepper *s, double t, double h, const double *y, const double *input);
lg_status lg_step_variational(lg_stepper *s, double t, double h, const double *y, const double *input);
lg_status lg_step_implicit(lg_stepper *s, double t, double h, const double *y, const double *input);
lg_status lg_step_slgi(lg_stepper *s, double t, double h, const double *y, const double *input);

/* RKMK on copies of T*S^2 in the kernels' packed layout. States and rows have room for whole blocks. */
bool lg_packed_fits(const lg_scheme *scheme, const lg_space *space);
lg_status lg_step_packed(lg_stepper *s, double t, double h, const double *y, const double *input);
/* Dense output: y = exp(h sum_i weight_i k_i) . y0 with the k_i, start y0 and size h of the last step. */
void lg_dense_rkmk(const lg_stepper *s, const double *weight, double *y);
void lg_dense_packed(const lg_stepper *s, const double *weight, double *y);

/* Solves z = h f(t + theta h, stage(z)); z is in s->newton.z. `stage` writes the stage point that belongs to
 * z. The caller sets newton.scale. Errors: LG_NO_CONVERGENCE, LG_NOT_FINITE (the field at y is not finite),
 * errors of the field. */
typedef void (*lg_stage_map)(const lg_stepper *s, const double *y, const double *z, double *point);
lg_status lg_newton_solve(lg_stepper *s, double t, double h, const double *y, const double *input,
                          lg_stage_map stage);
/* Whether the space is one copy of SE(3), optionally followed by one R^2m. */
bool lg_slgi_fits(const lg_space *space);

bool lg_all_finite(size_t n, const double *x);
bool lg_step_controller_valid(const lg_step_controller *control);

#endif
