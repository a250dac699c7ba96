/* Shared by the two forms of the pendulum chain.
 *
 * The masses are at x_l = sum_{i <= l} L_i q_i, so the kinetic energy is
 * 1/2 sum_l m_l |sum_{i <= l} L_i q_i'|^2. Its matrix (m_ij) is m = D U diag(m_l) U^T D with U_il = [i <= l],
 * D = diag(L). U^-1 is bidiagonal, so W = m^-1 is tridiagonal: W_ii = (1/m_i + [i > 1]/m_{i-1})/L_i^2,
 * W_{i,i+1} = -1/(m_i L_i L_{i+1}).
 */
#ifndef LG_CHAIN_H
#define LG_CHAIN_H

#include "mechanics/system.h"

extern const lg_parameter_entry lg_chain_parameters[];

#define number double
#include "mechanics/fields/chain_numbers.inc"
#undef number

static inline lg_chain lg_chain_of(const lg_system *system) {
    return chain_view(system->links, system->parameters, system->constants);
}

/* Writes the constants of the view from its parameters. */
static inline void lg_chain_constants(const lg_chain *c) {
    double mu = 0.0;
    for (size_t i = c->links; i-- > 0;) {
        const double m = c->mass[i], length = c->length[i];
        const double above = i > 0 ? 1.0 / c->mass[i - 1] : 0.0;
        mu += m;
        c->light[i] = 1.0 / m;
        c->diagonal[i] = 1.0 / m + above;
        c->curvature[i] = 1.0 / length;
        c->mu[i] = mu;
        c->weight[i] = mu * c->gravity * length;
        c->m_inverse[i] = 1.0 / (mu * length * length);
        c->w[i] = (1.0 / m + above) / (length * length);
        c->w_next[i] = i + 1 < c->links ? -1.0 / (m * length * c->length[i + 1]) : 0.0;
    }
}

/* v_i = dH/dp_i and g_i = dH/dq_i (3k numbers each) at a point y (6k) of the manifold, in O(k). With
 * G_il = q_i.q_l, u_i = q_i.(W p)_i and the Hadamard product o, lambda solves (W o G) lambda = u, a symmetric
 * positive definite tridiagonal system. Then v_i = sum_j W_ij (p_j - lambda_j q_j) and
 * g_i = -lambda_i v_i + dV/dq_i. work: 12k doubles. LG_NOT_FINITE: a pivot is not positive (NaN in y, or a
 * link of length 0); v and g are then undefined. */
lg_status lg_chain_gradient(const lg_chain *chain, const double *y, double *v, double *g, double *work);

/* Draws a start of kind LG_STARTS_PLANE: q_i at y + 6 i, and v. Errors: LG_UNSUPPORTED (more than
 * LG_PLANE_LINKS links), LG_NO_CONVERGENCE. */
lg_status lg_chain_plane_start(const lg_chain *chain, lg_rng *rng, double *y, double *v);

/* One step of SHAKE and RATTLE, in place on q_i at y + 6 i and on the velocities v; both are untouched on
 * failure. work: 11k doubles. */
lg_status lg_chain_rattle(const lg_chain *chain, double h, double *y, double *v, double *work);

/* The LIE fields on a tape. */
lg_status lg_chain_taped_lagrangian(const lg_system *system, lg_tape *tape, lg_taped_time t, const lg_var *y,
                                    lg_var input, lg_var parameters, lg_var *algebra);
lg_status lg_chain_taped_hamiltonian(const lg_system *system, lg_tape *tape, lg_taped_time t, const lg_var *y,
                                     lg_var input, lg_var parameters, lg_var *algebra);

#endif
