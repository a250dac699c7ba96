/* The chain of k spherical pendulums in Hamiltonian form on (T*S^2)^k.
 *
 * The positions are x_l = sum_{i <= l} L_i q_i, so the kinetic energy is 1/2 sum_l m_l |sum_{i <= l} L_i
 * q_i'|^2 and m = D U diag(m_l) U^T D with U_il = [i <= l], D = diag(L). U^-1 is bidiagonal, hence W = m^-1
 * is tridiagonal: W_ii = (1/m_i + [i > 1]/m_{i-1})/L_i^2, W_{i,i+1} = -1/(m_i L_i L_{i+1}). W is positive
 * definite and so is its Hadamard product with the Gram matrix of the q (Schur's product theorem).
 */
#include <math.h>
#include <string.h>

#include "liegrad/geometry.h"
#include "mechanics/system.h"

void lg_chain_fill(lg_chain *chain, double gravity, const double *masses, const double *lengths) {
    const size_t k = chain->links;
    double mu = 0.0;
    for (size_t i = k; i-- > 0;) {
        const double m = masses ? masses[i] : 1.0, length = lengths ? lengths[i] : 1.0;
        const double above = i > 0 ? 1.0 / (masses ? masses[i - 1] : 1.0) : 0.0;
        mu += m;
        chain->length[i] = length;
        chain->mu[i] = mu;
        chain->weight[i] = mu * gravity * length;
        chain->m_inverse[i] = 1.0 / (mu * length * length);
        chain->w[i] = (1.0 / m + above) / (length * length);
        chain->w_next[i] = i + 1 < k ? -1.0 / (m * length * (lengths ? lengths[i + 1] : 1.0)) : 0.0;
    }
}

/* ---- tridiagonal symmetric systems, diagonal d (k), upper diagonal e (k, last unused) ---- */

/* L D L^T in place: d the pivots, e the entries of L below the diagonal. */
static lg_status tridiagonal_factor(size_t k, double *d, double *e) {
    for (size_t i = 0; i < k; i++) {
        if (!(d[i] > 0.0) || !isfinite(d[i])) return LG_NOT_FINITE;
        if (i + 1 == k) break;
        const double l = e[i] / d[i];
        d[i + 1] -= l * e[i];
        e[i] = l;
    }
    return LG_OK;
}

static void tridiagonal_solve(size_t k, const double *d, const double *e, const double *b, double *x) {
    x[0] = b[0];
    for (size_t i = 1; i < k; i++) x[i] = b[i] - e[i - 1] * x[i - 1];
    x[k - 1] /= d[k - 1];
    for (size_t i = k - 1; i-- > 0;) x[i] = x[i] / d[i] - e[i] * x[i + 1];
}

/* out_i = sum_j W_ij x_j; x_j the 3-vectors at x + stride j, out contiguous (k, 3); out does not overlap x.
 */
static void apply_w(const lg_chain *chain, const double *x, size_t stride, double *out) {
    const size_t k = chain->links;
    for (size_t i = 0; i < k; i++) {
        for (int c = 0; c < 3; c++) {
            double sum = chain->w[i] * x[stride * i + c];
            if (i > 0) sum += chain->w_next[i - 1] * x[stride * (i - 1) + c];
            if (i + 1 < k) sum += chain->w_next[i] * x[stride * (i + 1) + c];
            out[3 * i + c] = sum;
        }
    }
}

/* ---- kinetic energy ---- */

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
    apply_w(chain, y + 3, 6, work->wp);
    for (size_t i = 0; i < k; i++) {
        const double *q = y + 6 * i;
        const double qq = lg_dot3(q, q);
        work->u[i] = lg_dot3(q, work->wp + 3 * i);
        work->d[i] = chain->w[i] * qq;
        if (extended) work->d[i] += (1.0 - qq) * chain->m_inverse[i];
        work->e[i] = i + 1 < k ? chain->w_next[i] * lg_dot3(q, q + 6) : 0.0;
    }
    return tridiagonal_factor(k, work->d, work->e);
}

static lg_status chain_gradient(const lg_chain *chain, const double *y, double *v, double *g,
                                double *memory) {
    const size_t k = chain->links;
    chain_work work = split_work(k, memory);
    LG_TRY(factor_gram(chain, y, false, &work));
    tridiagonal_solve(k, work.d, work.e, work.u, work.lambda);
    for (size_t i = 0; i < k; i++)
        for (int c = 0; c < 3; c++) work.x[3 * i + c] = y[6 * i + 3 + c] - work.lambda[i] * y[6 * i + c];
    apply_w(chain, work.x, 3, v);
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
    tridiagonal_solve(k, work->d, work->e, work->u, work->lambda);
    tridiagonal_solve(k, work->d, work->e, work->r, work->rho);
    return LG_OK;
}

/* d(1/2 u^T S^-1 r) = 1/2 (rho^T du + lambda^T dr - lambda^T dS rho) */
static lg_status chain_gradient_extended(const lg_chain *chain, const double *y, double *v, double *g,
                                         double *memory) {
    const size_t k = chain->links;
    chain_work work = split_work(k, memory);
    const double *lambda = work.lambda, *rho = work.rho;
    LG_TRY(solve_extended(chain, y, &work));
    for (size_t i = 0; i < k; i++)
        for (int c = 0; c < 3; c++) work.x[3 * i + c] = 0.5 * (rho[i] - lambda[i]) * y[6 * i + c];
    apply_w(chain, work.x, 3, v);
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

static double chain_hamiltonian(const lg_system *system, const double *y, double *memory) {
    const lg_chain *chain = &system->chain;
    chain_work work = split_work(chain->links, memory);
    if (solve_extended(chain, y, &work) != LG_OK) return NAN;
    double kinetic = 0.0, potential = 0.0;
    for (size_t i = 0; i < chain->links; i++) {
        kinetic += 0.5 * (lg_dot3(y + 6 * i + 3, work.wp + 3 * i) + work.lambda[i] * work.r[i]);
        potential += chain->weight[i] * y[6 * i + 2];
    }
    return kinetic + potential;
}

/* ---- vector fields ---- */

static lg_status chain_field_lie(void *user, double t, const double *y, const double *input,
                                 double *algebra) {
    const lg_system_user *own = user;
    const lg_chain *chain = &own->system->chain;
    const size_t k = chain->links;
    double *v = own->work, *g = v + 3 * k;
    (void)t, (void)input;
    LG_TRY(chain_gradient(chain, y, v, g, g + 3 * k));
    for (size_t i = 0; i < k; i++, y += 6, algebra += 6, v += 3, g += 3) {
        double gq[3], vp[3];
        lg_cross3(g, y, gq);
        lg_cross3(v, y + 3, vp);
        lg_cross3(y, v, algebra);
        for (int c = 0; c < 3; c++) algebra[3 + c] = gq[c] + vp[c];
    }
    return LG_OK;
}

static lg_status chain_field_ambient(void *user, double t, const double *y, const double *input,
                                     double *out) {
    const lg_system_user *own = user;
    const lg_chain *chain = &own->system->chain;
    const size_t k = chain->links;
    double *v = own->work, *g = v + 3 * k;
    (void)t, (void)input;
    LG_TRY(chain_gradient_extended(chain, y, v, g, g + 3 * k));
    for (size_t i = 0; i < k; i++, y += 6, out += 6, v += 3, g += 3) {
        const double qv = lg_dot3(y, v), qg = lg_dot3(y, g), pv = lg_dot3(y + 3, v);
        for (int c = 0; c < 3; c++) {
            out[c] = v[c] - y[c] * qv;
            out[3 + c] = -g[c] + y[c] * qg + y[3 + c] * qv - y[c] * pv;
        }
    }
    return LG_OK;
}

/* sum_i e3.(q_i x p_i): rotations about e3 are a symmetry. */
static double chain_invariant(const lg_system *system, size_t index, const double *y) {
    double sum = 0.0;
    (void)index;
    for (size_t i = 0; i < system->chain.links; i++, y += 6) sum += y[0] * y[4] - y[1] * y[3];
    return sum;
}

static const char *const chain_invariants[] = {"vertical-angular-momentum", NULL};

const lg_system_row lg_system_row_chain = {
    .name = "pendulum-chain",
    .kind = LG_SPACE_TS2,
    .work = 6 + 12, /* v and g, then the parts of chain_work */
    .invariants = chain_invariants,
    .hamiltonian = chain_hamiltonian,
    .invariant = chain_invariant,
    .field = {[LG_FORM_LIE] = chain_field_lie, [LG_FORM_AMBIENT] = chain_field_ambient},
};

/* ---- public parts ---- */

static lg_status check_chain(const lg_system *system, const void *a, const void *b) {
    if (!system || !a || !b) return LG_INVALID_ARGUMENT;
    return system->row == &lg_system_row_chain ? LG_OK : LG_UNSUPPORTED;
}

lg_status lg_chain_mass_matrix(const lg_system *system, double *m) {
    LG_TRY(check_chain(system, m, m));
    const lg_chain *chain = &system->chain;
    for (size_t i = 0; i < chain->links; i++)
        for (size_t j = 0; j < chain->links; j++)
            m[i * chain->links + j] = chain->mu[i > j ? i : j] * chain->length[i] * chain->length[j];
    return LG_OK;
}

lg_status lg_chain_potential_weights(const lg_system *system, double *weights) {
    LG_TRY(check_chain(system, weights, weights));
    memcpy(weights, system->chain.weight, system->chain.links * sizeof(*weights));
    return LG_OK;
}

/* Results go through the workspace, so that a failure leaves v and g alone. */
static lg_status public_gradient(const lg_system *system, const double *y, double *v, double *g, double *work,
                                 lg_status (*gradient)(const lg_chain *, const double *, double *, double *,
                                                       double *)) {
    LG_TRY(check_chain(system, y, work));
    if (!v || !g) return LG_INVALID_ARGUMENT;
    const size_t n = 3 * system->chain.links;
    LG_TRY(gradient(&system->chain, y, work, work + n, work + 2 * n));
    memcpy(v, work, n * sizeof(*v));
    memcpy(g, work + n, n * sizeof(*g));
    return LG_OK;
}

lg_status lg_chain_gradient(const lg_system *system, const double *y, double *v, double *g, double *work) {
    return public_gradient(system, y, v, g, work, chain_gradient);
}

lg_status lg_chain_gradient_extended(const lg_system *system, const double *y, double *v, double *g,
                                     double *work) {
    return public_gradient(system, y, v, g, work, chain_gradient_extended);
}
