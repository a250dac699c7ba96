/* What the two forms of the pendulum chain share.
 *
 * The positions are x_l = sum_{i <= l} L_i q_i, so the kinetic energy is 1/2 sum_l m_l |sum_{i <= l} L_i
 * q_i'|^2 and m = D U diag(m_l) U^T D with U_il = [i <= l], D = diag(L). U^-1 is bidiagonal, hence W = m^-1
 * is tridiagonal: W_ii = (1/m_i + [i > 1]/m_{i-1})/L_i^2, W_{i,i+1} = -1/(m_i L_i L_{i+1}).
 */
#ifndef LG_CHAIN_H
#define LG_CHAIN_H

#include "mechanics/system.h"

/* Rows of the table of parameters, for both forms. */
enum { CHAIN_GRAVITY, CHAIN_MASSES, CHAIN_LENGTHS };
extern const lg_parameter_entry lg_chain_parameters[];

/* Arrays that do not depend on the state, k entries each. */
typedef struct lg_chain {
    size_t links;
    double gravity;
    const double *mass, *length;
    double *light;     /* 1/m_i */
    double *diagonal;  /* 1/m_i + [i > 1]/m_{i-1} */
    double *curvature; /* 1/L_i */
    double *mu;        /* sum_{l >= i} m_l */
    double *weight;    /* mu_i g L_i */
    double *m_inverse; /* 1/m_ii */
    double *w;         /* W_ii */
    double *w_next;    /* W_{i,i+1}; the last is 0 */
} lg_chain;

enum { CHAIN_CONSTANTS = 8 };

/* The parameters stand in the order of their table. Inline, since every field evaluation calls it. */
static inline lg_chain lg_chain_of(const lg_system *system) {
    const size_t k = system->links;
    const double *p = system->parameters;
    double *c = system->constants;
    return (lg_chain){.links = k,
                      .gravity = p[0],
                      .mass = p + 1,
                      .length = p + 1 + k,
                      .light = c,
                      .diagonal = c + k,
                      .curvature = c + 2 * k,
                      .mu = c + 3 * k,
                      .weight = c + 4 * k,
                      .m_inverse = c + 5 * k,
                      .w = c + 6 * k,
                      .w_next = c + 7 * k};
}

/* Functions that both rows use. */
lg_status lg_chain_space(size_t links, lg_space *out);
size_t lg_chain_constants(size_t links);
void lg_chain_prepare(lg_system *system, double *constants);
extern const char *const lg_chain_invariants[];

/* ---- symmetric tridiagonal systems, diagonal d (k), upper diagonal e (k, the last is not used) ---- */

/* L D L^T in place: d the pivots, e the entries of L below the diagonal. LG_NOT_FINITE when a pivot is not
 * positive. */
lg_status lg_tridiagonal_factor(size_t k, double *d, double *e);
/* x may be b. */
void lg_tridiagonal_solve(size_t k, const double *d, const double *e, const double *b, double *x);

/* out_i = sum_j W_ij x_j; x_j the 3-vectors at x + stride j, out contiguous (k, 3); out does not overlap x.
 */
void lg_chain_apply_w(const lg_chain *chain, const double *x, size_t stride, double *out);
/* out_i = sum_j m_ij x_j, (k, 3) each; out does not overlap x. */
void lg_chain_apply_m(const lg_chain *chain, const double *x, double *out);

/* ---- velocities: q_i at y + 6 i, v contiguous (k, 3) ---- */

/* y = q, omega: v_i = omega_i x q_i, and back omega_i = q_i x v_i */
void lg_chain_velocity_of_omega(size_t links, const double *y, double *v);
void lg_chain_omega_of_velocity(size_t links, const double *v, double *y);
/* Writes p_i = P_i sum_j m_ij v_j into y; work: 3k doubles. */
void lg_chain_momentum_of_velocity(const lg_chain *chain, const double *v, double *y, double *work);
/* On the manifold. dH/dp_i -> v (3k), dH/dq_i -> g (3k), from y (6k). W = m^-1 is tridiagonal; with G_il =
 * q_i.q_l and u_i = q_i.(W p)_i, (W o G) lambda = u: v_i = sum_j W_ij (p_j - lambda_j q_j), dT/dq_i =
 * -lambda_i v_i, plus dV/dq. The k x k system is symmetric positive definite and tridiagonal: O(k). work:
 * 12k doubles. LG_NOT_FINITE: a pivot is not positive (NaN in y, or a link of length 0); v and g are then
 * undefined. */
lg_status lg_chain_gradient(const lg_chain *chain, const double *y, double *v, double *g, double *work);
/* Near the manifold: the gradient of T = 1/2 p^T W p + 1/2 u^T S^-1 r, symmetric
 * S_il = delta_il (1 - |q_i|^2)/m_ii + W_il G_il, r_i = q_i.p_i/m_ii - u_i. T equals the kinetic energy on
 * the manifold (k = 1: |p|^2/(2 m_11) everywhere). There its field equals that of lg_chain_gradient; v and g
 * themselves differ by parts that do not change the field. LG_NOT_FINITE: S is not positive definite. */
lg_status lg_chain_gradient_extended(const lg_chain *chain, const double *y, double *v, double *g,
                                     double *work);
/* v_i = dH/dp_i from y = q, p; work: CHAIN_MOMENTUM_WORK k doubles, beginning with dH/dq (k, 3). */
lg_status lg_chain_velocity_of_momentum(const lg_chain *chain, const double *y, double *v, double *work);
enum { CHAIN_MOMENTUM_WORK = 15 };

/* sum_l m_l e3.(x_l x x_l') from q at y + 6 i and v */
double lg_chain_vertical_momentum(const lg_chain *chain, const double *y, const double *v);
/* 1/2 sum_l m_l |x_l'|^2 + V */
double lg_chain_energy(const lg_chain *chain, const double *y, const double *v);

/* lg_system_observe: x_i and x_i' (k, 3) each from q_i at y + 6 i and v */
size_t lg_chain_observed(size_t links);
void lg_chain_nodes(const lg_chain *chain, const double *y, const double *v, double *out);
/* Starts of kind LG_STARTS_PLANE: q and v. LG_UNSUPPORTED above LG_PLANE_LINKS, LG_NO_CONVERGENCE. */
lg_status lg_chain_plane_start(const lg_chain *chain, lg_rng *rng, double *y, double *v);

/* One step of SHAKE and RATTLE; y holds q_i at y + 6 i, v the velocities; in place, untouched on failure.
 * work: CHAIN_STEP_WORK k doubles. */
lg_status lg_chain_rattle(const lg_chain *chain, double h, double *y, double *v, double *work);
enum { CHAIN_STEP_WORK = 11 };

/* The fields on a tape, LIE form. */
lg_status lg_chain_taped_lagrangian(const lg_system *system, lg_tape *tape, lg_taped_time t, const lg_var *y,
                                    lg_var input, lg_var parameters, lg_var *algebra);
lg_status lg_chain_taped_hamiltonian(const lg_system *system, lg_tape *tape, lg_taped_time t, const lg_var *y,
                                     lg_var input, lg_var parameters, lg_var *algebra);

#endif
