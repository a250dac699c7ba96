/* Internals of a system, and the row that each file of this folder fills in.
 *
 * A new system is a file with its row (one for each form) and a line in the list at the end (docs/adding.md).
 * Its parameters and the parts of its state are tables; scenes, messages, layouts and gradients read them.
 */
#ifndef LG_SYSTEM_H
#define LG_SYSTEM_H

#include "core/core.h"
#include "integrators/lanes.h"
#include "liegrad/mechanics.h"
#include "liegrad/taped.h"

/* How the field follows from the energy H, the first invariant. A test of all rows checks the field against
 * the energy. */
typedef enum lg_structure {
    LG_STRUCTURE_UNSTATED, /* only where there is no energy */
    /* y' = {y, H} with the bracket of the space:
     * - R^2n and T*S^2: canonical in (q, p);
     * - T*SO(3): (R, pi) with the spatial momentum pi, as SE(3) or SO(3) x R^3;
     * - so(3)*: the body momentum, mu' = mu x dH/dmu;
     * - se(3)*: (Gamma, Pi), Gamma' = Gamma x dH/dPi, Pi' = Pi x dH/dPi + Gamma x dH/dGamma. */
    LG_STRUCTURE_HAMILTONIAN,
    /* Euler-Lagrange equations of L = K - V, V(q) = H(q, 0), K = H - V; y is (q, q') on R^2n and (q, omega)
     * on TS^2. */
    LG_STRUCTURE_LAGRANGIAN,
    LG_STRUCTURE_OTHER /* the field only keeps H */
} lg_structure;

typedef struct lg_system_row {
    const char *name, *form;              /* form NULL: the only one */
    const lg_parameter_entry *parameters; /* ended by a key NULL */
    const lg_state_entry *state;          /* ended by a key NULL */
    const char *layout;                   /* NULL: from `state`, in the order of offsets */
    bool separable;                       /* the row has force and velocity, plain and on a tape */
    size_t unreported;                    /* numbers at the end of the state that are not reported */
    lg_status (*space)(size_t links, lg_space *out);
    size_t (*constants)(size_t links); /* how many numbers `prepare` makes from the parameters; NULL: none */
    void (*prepare)(lg_system *system, double *constants);
    size_t (*work)(size_t links);  /* doubles of workspace; NULL: none */
    const char *const *invariants; /* names, ended by NULL; "energy" first where there is one */
    double (*invariant)(const lg_system *system, size_t index, const double *y, double *work);
    /* lg_system_observe: how many numbers, and the numbers. Both NULL: the reported part of the state. */
    size_t (*observed)(size_t links);
    lg_status (*observe)(const lg_system *system, const double *y, double *out, double *work);
    /* A start of kind PLANE; NULL: none. */
    lg_status (*plane)(const lg_system *system, lg_rng *rng, double *y);
    lg_structure structure;
    /* The function that takes the place of H in the structure; NULL: the energy. */
    double (*generating)(const lg_system *system, const double *y, double *work);
    /* By lg_coordinates; AMBIENT NULL: the generator of the other one. The user is lg_system_user. */
    lg_vector_field field[2];
    lg_lane_system lanes; /* the same fields on lanes; LG_LANES_NONE: there are none */
    bool extended; /* field[AMBIENT] is not the generator of the other one off the manifold, and has no taped
                      form */
    lg_half_field force, velocity;
    lg_variational_step step; /* NULL: none; user is lg_system_user */
    /* The LIE field on a tape, for batches as in liegrad/taped.h; parameters: all of them, (P), in the order
     * of the table. It is differentiable to any order in y and parameters, unless the row says otherwise. */
    lg_status (*taped)(const lg_system *system, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                       lg_var parameters, lg_var *algebra);
    /* For splitting schemes; NULL: none. */
    lg_status (*taped_force)(const lg_system *system, lg_tape *tape, lg_taped_time t, lg_var q, lg_var input,
                             lg_var parameters, lg_var *out);
    lg_status (*taped_velocity)(const lg_system *system, lg_tape *tape, lg_taped_time t, lg_var p,
                                lg_var input, lg_var parameters, lg_var *out);
} lg_system_row;

/* One block of memory with all it points to. */
struct lg_system {
    const lg_context *context;
    const lg_system_row *row;
    size_t links; /* 0 where the system has none */
    lg_space space;
    char *layout;
    size_t parameter_count;
    double *parameters; /* in the order of the table */
    double *constants;
};

size_t lg_system_constants(const lg_system *system);

/* The numbers of the parameter at `index` of the row's table. */
const double *lg_system_parameter(const lg_system *system, size_t index);
/* The same on a tape: the slice of `parameters`, shape (count). */
lg_var lg_system_taped_parameter(const lg_system *system, lg_tape *tape, lg_var parameters, size_t index);

/* ---- tables of parameters, ended by a key NULL ---- */

/* Numbers of one parameter. */
size_t lg_parameter_numbers(const lg_parameter_entry *parameter, size_t links);
/* LG_INVALID_ARGUMENT: there is no such key; the sentence names `system` and lists the keys. */
lg_status lg_parameter_find(const char *system, const lg_parameter_entry *table, const char *key,
                            const lg_parameter_entry **out, lg_error *error);
/* Numbers against the rule of their parameter. */
lg_status lg_parameter_check(const lg_parameter_entry *p, const double *x, size_t n, lg_error *error);
/* "m2", of all numbers of the table counted together; empty beyond. */
#define LG_PARAMETER_LABEL 32
void lg_parameter_label(const lg_parameter_entry *table, size_t links, size_t index, char *text);

/* `field` and `taped` of a separable system on R^2n, y = (q, p), from its halves: y' = (velocity(p),
 * force(q)). */
lg_status lg_separable_field(void *user, double t, const double *y, const double *input, double *out);
lg_status lg_separable_taped(const lg_system *system, lg_tape *tape, lg_taped_time t, const lg_var *y,
                             lg_var input, lg_var parameters, lg_var *algebra);

/* The rows. The first form of each system stands first. */
extern const lg_system_row lg_system_row_oscillator, lg_system_row_quartic, lg_system_row_coupled;
extern const lg_system_row lg_system_row_chain_lagrangian, lg_system_row_chain_hamiltonian;
extern const lg_system_row lg_system_row_rigid_body, lg_system_row_attitude;
extern const lg_system_row lg_system_row_top_cotangent, lg_system_row_top_direct,
    lg_system_row_top_lie_poisson, lg_system_row_top_quadratic;
extern const lg_system_row lg_system_row_quadrotors;

#endif
