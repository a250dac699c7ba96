/* The chain of k spherical pendulums in Hamiltonian form on (T*S^2)^k. W is positive definite and so is its
 * Hadamard product with the Gram matrix of the q (Schur's product theorem). */
#include <math.h>
#include <string.h>

#include "liegrad/geometry.h"
#include "mechanics/chain.h"

/* Parts of the workspace. */
typedef struct chain_work {
    double *wp;            /* (k, 3) W p */
    double *x;             /* (k, 3) */
    double *u, *r, *d, *e; /* k each */
    double *lambda, *rho;  /* k each */
} chain_work;

static chain_work split_work(size_t k, double *work) {
    return (chain_work){.wp = work,
                        .x = work + 3 * k,
                        .u = work + 6 * k,
                        .r = work + 7 * k,
                        .d = work + 8 * k,
                        .e = work + 9 * k,
                        .lambda = work + 10 * k,
                        .rho = work + 11 * k};
}

/* Fills wp, u and the factor (d, e) of W o G, plus (1 - |q_i|^2)/m_ii on the diagonal when `extended`. */
static lg_status factor_gram(const lg_chain *chain, const double *y, bool extended, chain_work *work) {
    const size_t k = chain->links;
    lg_chain_apply_w(chain, y + 3, 6, work->wp);
    for (size_t i = 0; i < k; i++) {
        const double *q = y + 6 * i;
        const double qq = lg_dot3(q, q);
        work->u[i] = lg_dot3(q, work->wp + 3 * i);
        work->d[i] = chain->w[i] * qq;
        if (extended) work->d[i] += (1.0 - qq) * chain->m_inverse[i];
        work->e[i] = i + 1 < k ? chain->w_next[i] * lg_dot3(q, q + 6) : 0.0;
    }
    return lg_tridiagonal_factor(k, work->d, work->e);
}

static lg_status gradient(const lg_chain *chain, const double *y, double *v, double *g, double *memory) {
    const size_t k = chain->links;
    chain_work work = split_work(k, memory);
    LG_TRY(factor_gram(chain, y, false, &work));
    lg_tridiagonal_solve(k, work.d, work.e, work.u, work.lambda);
    for (size_t i = 0; i < k; i++)
        for (int c = 0; c < 3; c++) work.x[3 * i + c] = y[6 * i + 3 + c] - work.lambda[i] * y[6 * i + c];
    lg_chain_apply_w(chain, work.x, 3, v);
    for (size_t i = 0; i < k; i++) {
        for (int c = 0; c < 3; c++) g[3 * i + c] = -work.lambda[i] * v[3 * i + c];
        g[3 * i + 2] += chain->weight[i];
    }
    return LG_OK;
}

/* lambda = S^-1 u, rho = S^-1 r */
static lg_status solve_extended(const lg_chain *chain, const double *y, chain_work *work) {
    const size_t k = chain->links;
    LG_TRY(factor_gram(chain, y, true, work));
    for (size_t i = 0; i < k; i++)
        work->r[i] = lg_dot3(y + 6 * i, y + 6 * i + 3) * chain->m_inverse[i] - work->u[i];
    lg_tridiagonal_solve(k, work->d, work->e, work->u, work->lambda);
    lg_tridiagonal_solve(k, work->d, work->e, work->r, work->rho);
    return LG_OK;
}

/* d(1/2 u^T S^-1 r) = 1/2 (rho^T du + lambda^T dr - lambda^T dS rho) */
static lg_status gradient_extended(const lg_chain *chain, const double *y, double *v, double *g,
                                   double *memory) {
    const size_t k = chain->links;
    chain_work work = split_work(k, memory);
    const double *lambda = work.lambda, *rho = work.rho;
    LG_TRY(solve_extended(chain, y, &work));
    for (size_t i = 0; i < k; i++)
        for (int c = 0; c < 3; c++) work.x[3 * i + c] = 0.5 * (rho[i] - lambda[i]) * y[6 * i + c];
    lg_chain_apply_w(chain, work.x, 3, v);
    for (size_t i = 0; i < k; i++) {
        const double *q = y + 6 * i, *p = q + 3;
        const double own = 2.0 * lambda[i] * rho[i] * (chain->w[i] - chain->m_inverse[i]);
        const double last =
            i > 0 ? chain->w_next[i - 1] * (lambda[i] * rho[i - 1] + lambda[i - 1] * rho[i]) : 0.0;
        const double next =
            i + 1 < k ? chain->w_next[i] * (lambda[i] * rho[i + 1] + lambda[i + 1] * rho[i]) : 0.0;
        for (int c = 0; c < 3; c++) {
            double ds = own * q[c];
            if (i > 0) ds += last * q[c - 6];
            if (i + 1 < k) ds += next * q[c + 6];
            v[3 * i + c] += work.wp[3 * i + c] + 0.5 * lambda[i] * chain->m_inverse[i] * q[c];
            g[3 * i + c] = 0.5 * ((rho[i] - lambda[i]) * work.wp[3 * i + c] +
                                  lambda[i] * chain->m_inverse[i] * p[c] - ds);
        }
        g[3 * i + 2] += chain->weight[i];
    }
    return LG_OK;
}

static double hamiltonian(const lg_chain *chain, const double *y, double *memory) {
    chain_work work = split_work(chain->links, memory);
    if (solve_extended(chain, y, &work) != LG_OK) return NAN;
    double kinetic = 0.0, potential = 0.0;
    for (size_t i = 0; i < chain->links; i++) {
        kinetic += 0.5 * (lg_dot3(y + 6 * i + 3, work.wp + 3 * i) + work.lambda[i] * work.r[i]);
        potential += chain->weight[i] * y[6 * i + 2];
    }
    return kinetic + potential;
}

/* sum_i e3.(q_i x p_i): rotations about e3 are a symmetry. */
static double vertical_momentum(const lg_chain *chain, const double *y) {
    double sum = 0.0;
    for (size_t i = 0; i < chain->links; i++, y += 6) sum += y[0] * y[4] - y[1] * y[3];
    return sum;
}

static double invariant(const lg_system *system, size_t index, const double *y, double *work) {
    const lg_chain chain = lg_chain_of(system);
    return index == 0 ? hamiltonian(&chain, y, work) : vertical_momentum(&chain, y);
}

lg_status lg_chain_velocity_of_momentum(const lg_chain *chain, const double *y, double *v, double *work) {
    return gradient(chain, y, v, work, work + 3 * chain->links);
}

/* ---- vector fields ---- */

static lg_status field_lie(void *user, double t, const double *y, const double *input, double *algebra) {
    const lg_system_user *own = user;
    const lg_chain chain = lg_chain_of(own->system);
    const size_t k = chain.links;
    double *v = own->work, *g = v + 3 * k;
    (void)t, (void)input;
    LG_TRY(gradient(&chain, y, v, g, g + 3 * k));
    for (size_t i = 0; i < k; i++, y += 6, algebra += 6, v += 3, g += 3) {
        double gq[3], vp[3];
        lg_cross3(g, y, gq);
        lg_cross3(v, y + 3, vp);
        lg_cross3(y, v, algebra);
        for (int c = 0; c < 3; c++) algebra[3 + c] = gq[c] + vp[c];
    }
    return LG_OK;
}

static lg_status field_ambient(void *user, double t, const double *y, const double *input, double *out) {
    const lg_system_user *own = user;
    const lg_chain chain = lg_chain_of(own->system);
    const size_t k = chain.links;
    double *v = own->work, *g = v + 3 * k;
    (void)t, (void)input;
    LG_TRY(gradient_extended(&chain, y, v, g, g + 3 * k));
    for (size_t i = 0; i < k; i++, y += 6, out += 6, v += 3, g += 3) {
        const double qv = lg_dot3(y, v), qg = lg_dot3(y, g), pv = lg_dot3(y + 3, v);
        for (int c = 0; c < 3; c++) {
            out[c] = v[c] - y[c] * qv;
            out[3 + c] = -g[c] + y[c] * qg + y[3 + c] * qv - y[c] * pv;
        }
    }
    return LG_OK;
}

/* ---- a step of the variational integrator: with velocities ---- */

static lg_status step(void *user, double t, double h, double *y) {
    const lg_system_user *own = user;
    const lg_chain chain = lg_chain_of(own->system);
    double *v = own->work, *rest = v + 3 * chain.links;
    (void)t;
    LG_TRY(gradient(&chain, y, v, rest, rest + 3 * chain.links));
    LG_TRY(lg_chain_rattle(&chain, h, y, v, rest));
    lg_chain_momentum_of_velocity(&chain, v, y, rest);
    return LG_OK;
}

/* ---- what is seen, starts in a plane ---- */

static lg_status observe(const lg_system *system, const double *y, double *out, double *work) {
    const lg_chain chain = lg_chain_of(system);
    LG_TRY(lg_chain_velocity_of_momentum(&chain, y, work, work + 3 * chain.links));
    lg_chain_nodes(&chain, y, work, out);
    return LG_OK;
}

static lg_status plane(const lg_system *system, lg_rng *rng, double *y) {
    const lg_chain chain = lg_chain_of(system);
    double v[3 * LG_PLANE_LINKS], work[3 * LG_PLANE_LINKS];
    LG_TRY(lg_chain_plane_start(&chain, rng, y, v));
    lg_chain_momentum_of_velocity(&chain, v, y, work);
    return LG_OK;
}

static size_t work_of(size_t links) {
    return (6 + 12) * links; /* v and g, then the parts of chain_work */
}

static const lg_state_entry state[] = {
    {.key = "q", .outer = 0, .rows = 1, .columns = 3, .first = 0, .stride = 6},
    {.key = "p", .outer = 0, .rows = 1, .columns = 3, .first = 3, .stride = 6},
    {.key = NULL}};

const lg_system_row lg_system_row_chain_hamiltonian = {
    .name = "pendulum-chain",
    .form = "hamiltonian",
    .parameters = lg_chain_parameters,
    .state = state,
    .space = lg_chain_space,
    .constants = lg_chain_constants,
    .prepare = lg_chain_prepare,
    .work = work_of,
    .invariants = lg_chain_invariants,
    .invariant = invariant,
    .observed = lg_chain_observed,
    .observe = observe,
    .plane = plane,
    .structure = LG_STRUCTURE_HAMILTONIAN,
    .field = {[LG_COORDINATES_LIE] = field_lie, [LG_COORDINATES_AMBIENT] = field_ambient},
    .extended = true,
    .step = step,
    .taped = lg_chain_taped_hamiltonian,
};

/* ---- public parts ---- */

/* Results go through the workspace, so that v and g are unchanged on failure. */
static lg_status public_gradient(const lg_system *system, const double *y, double *v, double *g, double *work,
                                 lg_status (*evaluate)(const lg_chain *, const double *, double *, double *,
                                                       double *)) {
    if (!system || !y || !v || !g || !work) return LG_INVALID_ARGUMENT;
    if (system->row != &lg_system_row_chain_hamiltonian) return LG_UNSUPPORTED;
    const lg_chain chain = lg_chain_of(system);
    const size_t n = 3 * chain.links;
    LG_TRY(evaluate(&chain, y, work, work + n, work + 2 * n));
    memcpy(v, work, n * sizeof(*v));
    memcpy(g, work + n, n * sizeof(*g));
    return LG_OK;
}

lg_status lg_chain_gradient(const lg_system *system, const double *y, double *v, double *g, double *work) {
    return public_gradient(system, y, v, g, work, gradient);
}

lg_status lg_chain_gradient_extended(const lg_system *system, const double *y, double *v, double *g,
                                     double *work) {
    return public_gradient(system, y, v, g, work, gradient_extended);
}
