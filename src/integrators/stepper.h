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
    double *value; /* algebra_dim */
} lg_memo;

struct lg_stepper {
    const lg_scheme *scheme;
    lg_ode ode;
    size_t evaluations;
    double angle;  /* largest in the last step */
    bool memoises; /* the first evaluation of a step may be known already */
    lg_memo memo[2];
    double *k;      /* (stages, algebra_dim) */
    double *f;      /* algebra_dim */
    double *sigma;  /* algebra_dim */
    double *point;  /* (stages, dim) for commutator-free schemes, else dim */
    double *y_next; /* dim */
    double *error;  /* dim */
    double *run[2]; /* dim each, for the loops over steps */
};

/* f(t, y) for a step of size about h, from memory when it is known. */
lg_status lg_stepper_first(lg_stepper *s, double t, double h, const double *y, const double *input,
                           double *f);

bool lg_all_finite(size_t n, const double *x);

#endif
