/* Constraints of the user: what the files constraint*.c and separable.c share. */
#ifndef LG_HAMILTONIAN_CONSTRAINT_H
#define LG_HAMILTONIAN_CONSTRAINT_H

#include "liegrad/constraint.h"
#include "liegrad/ops.h"

enum { LG_CONSTRAINT_MOST = LG_CONSTRAINT_MOST_COORDINATES };

struct lg_constraint {
    const lg_context *context;
    uint32_t n, m;
    /* The functions of the user, and the functions `jacobian` (q) -> G, `bend` (q, v) -> G'[v] and `slope`
     * (q) -> dV/dq. */
    lg_program *own, *program;
    size_t jacobian;                    /* number of this function in `program` */
    lg_program *motion;                 /* `field` (x) -> x'; NULL without potential */
    lg_plan *g, *G, *bends;             /* bends: for n rows */
    lg_plan *potential, *slope, *field; /* NULL without potential */
    size_t work_size;                   /* of the largest plan */
    double mass[LG_CONSTRAINT_MOST * LG_CONSTRAINT_MOST], inverse[LG_CONSTRAINT_MOST * LG_CONSTRAINT_MOST];
};

/* ---- on a tape, for q, p, x (B, n); q times `unit` is in the units of the program ----
 *
 * inverse_mass: W (1, n, n). `constraint` NULL: no constraints, P = I. Errors stick to the tape. */

/* v */
lg_var lg_constraint_record_velocity(lg_tape *tape, const lg_constraint *constraint, double unit,
                                     lg_var inverse_mass, lg_var q, lg_var p);
/* dH = (dH/dq, dH/dp), where `slope` is dV/dq. */
void lg_constraint_record_gradient(lg_tape *tape, const lg_constraint *constraint, double unit,
                                   lg_var inverse_mass, lg_var q, lg_var p, lg_var slope, lg_var *dH);
/* y' = (q', p') of y = (q, p) from dH, with forces `input` (B, n) or LG_NONE; not for `constraint` NULL. */
void lg_constraint_record_field(lg_tape *tape, const lg_constraint *constraint, double unit, const lg_var *y,
                                const lg_var *dH, lg_var input, lg_var *out);

/* ---- numbers, with work memory for one thread ---- */

typedef struct lg_constraint_work {
    const lg_constraint *of;
    void *plans;
    double size;                                       /* L */
    double g[LG_CONSTRAINT_MOST];                      /* at the last point */
    double G[LG_CONSTRAINT_MOST * LG_CONSTRAINT_MOST]; /* (m, n) at the last point */
    double *bends;                                     /* (n, m, n) */
} lg_constraint_work;

lg_status lg_constraint_begin(const lg_constraint *constraint, double size, const double *q,
                              lg_constraint_work *work, lg_error *error);
void lg_constraint_end(lg_constraint_work *work);
/* Sets work->G at q. */
void lg_constraint_normals(lg_constraint_work *work, const double *q);
/* The view of q; sets work->g and work->G there. */
lg_status lg_constraint_view_of(lg_constraint_work *work, const double *q, lg_constraint_view *out,
                                lg_error *error);
/* x -= G^T (G K G^T)^-1 G K x with G of the work and K (n, n); NULL: the unit matrix. False: singular. */
bool lg_constraint_clear(const lg_constraint_work *work, const double *K, double *x);
/* Newton's method for g(q) = 0 along W F^T: from the start q, W and F (m, n) go to q - W `impulse`, where
 * `impulse` is F^T times the multipliers. W NULL stands for the unit matrix, F NULL for G at each iterate.
 * Sets work->G at the result. Returns false without convergence, or if det G W F^T <= 0 at the result. */
bool lg_constraint_land(lg_constraint_work *work, const double *W, const double *F, double *q,
                        double *impulse);
/* "q = (0.1, 0.2, ...)" for messages. */
typedef struct lg_constraint_text {
    char text[160];
} lg_constraint_text;
lg_constraint_text lg_constraint_show(const lg_constraint *constraint, const double *q);

#endif
