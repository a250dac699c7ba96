/* Inside of a system, and the row that each file of this room fills in. */
#ifndef LG_SYSTEM_H
#define LG_SYSTEM_H

#include "core/core.h"
#include "liegrad/mechanics.h"

/* Numbers of a chain that do not depend on the state; k each. W = m^-1 is tridiagonal. */
typedef struct lg_chain {
    size_t links;
    double *length;
    double *mu;        /* sum_{l >= i} m_l */
    double *weight;    /* mu_i g L_i */
    double *m_inverse; /* 1/m_ii */
    double *w;         /* W_ii */
    double *w_next;    /* W_{i,i+1}; the last is 0 */
} lg_chain;

typedef struct lg_system_row {
    const char *name;
    const char *layout; /* NULL: "q1 p1 q2 p2 ..." */
    lg_space_kind kind; /* the factor that the state consists of */
    size_t copies;      /* of it; 0: one a link */
    size_t work;        /* doubles of workspace a copy */
    bool separable;
    const char *const *invariants; /* names after "energy", ended by NULL */
    double (*hamiltonian)(const lg_system *system, const double *y, double *work);
    double (*invariant)(const lg_system *system, size_t index,
                        const double *y); /* index as in `invariants` */
    lg_field field[2];                    /* by lg_form; user is lg_system_user */
    lg_half_field force, velocity;
} lg_system_row;

struct lg_system {
    const lg_system_row *row;
    lg_space space;
    char *layout;
    lg_chain chain; /* zero for other systems */
};

extern const lg_system_row lg_system_row_chain, lg_system_row_quartic, lg_system_row_coupled;

/* Fills the arrays of `chain`, which point to k doubles each. masses and lengths may be NULL for ones. */
void lg_chain_fill(lg_chain *chain, double gravity, const double *masses, const double *lengths);

#endif
