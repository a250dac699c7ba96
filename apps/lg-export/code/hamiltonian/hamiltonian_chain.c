/* Learned Hamiltonian of a chain, state q_1 p_1 q_2 p_2 ... on (T*S^2)^k:
 *   H = 1/2 sum_i (p_i.(W p)_i - u_i lambda_i) + V(q), u_i = q_i.(W p)_i, (W o G) lambda = u,
 *   G_ij = q_i.q_j, W = m^-1;
 *   dH/dp_i = v_i = sum_j W_ij (p_j - lambda_j q_j), dH/dq_i = g_i = dV/dq_i - lambda_i v_i. */

/* Work. */
enum {
    CHAIN_Q = 0,                             /* (LINKS, 3) */
    CHAIN_G = CHAIN_Q + 3 * LINKS,           /* (LINKS, 3) */
    CHAIN_V = CHAIN_G + 3 * LINKS,           /* (LINKS, 3) W p, then v */
    CHAIN_LAMBDA = CHAIN_V + 3 * LINKS,      /* (LINKS) */
    CHAIN_U = CHAIN_LAMBDA + LINKS,          /* (LINKS) */
    CHAIN_FACTOR = CHAIN_U + LINKS,          /* (LINKS, LINKS) of W o G, lower triangle */
    CHAIN_NET = CHAIN_FACTOR + LINKS * LINKS /* the network's */
};

/* Cholesky's factor of s (LINKS, LINKS), lower triangle, in place; NaN where s is not positive definite. */
static void chain_factor(real *s) {
    for (int j = 0; j < LINKS; j++)
        for (int i = j; i < LINKS; i++) {
            real sum = s[i * LINKS + j];
            for (int l = 0; l < j; l++) sum -= s[i * LINKS + l] * s[j * LINKS + l];
            if (i > j)
                s[i * LINKS + j] = sum / s[j * LINKS + j];
            else
                s[i * LINKS + j] = sum > REAL(0.0) ? SQRT(sum) : (real)NAN;
        }
}

/* x <- s^-T s^-1 x */
static void chain_solve(const real *s, real *x) {
    for (int i = 0; i < LINKS; i++) {
        for (int j = 0; j < i; j++) x[i] -= s[i * LINKS + j] * x[j];
        x[i] /= s[i * LINKS + i];
    }
    for (int i = LINKS - 1; i >= 0; i--) {
        for (int j = i + 1; j < LINKS; j++) x[i] -= s[j * LINKS + i] * x[j];
        x[i] /= s[i * LINKS + i];
    }
}

/* Fills W p, u and lambda; the kinetic energy. */
static real chain_kinetic(const real *state, real *work) {
    real *wp = work + CHAIN_V, *u = work + CHAIN_U, *lambda = work + CHAIN_LAMBDA, *s = work + CHAIN_FACTOR;
    real energy = REAL(0.0);
    for (int i = 0; i < LINKS; i++) {
        const real *row = NAME_mass_inverse + i * LINKS;
        for (int c = 0; c < 3; c++) {
            real sum = REAL(0.0);
            for (int j = 0; j < LINKS; j++) sum += row[j] * state[6 * j + 3 + c];
            wp[3 * i + c] = sum;
        }
        u[i] = lambda[i] = dot3(state + 6 * i, wp + 3 * i);
        for (int j = 0; j <= i; j++) s[i * LINKS + j] = row[j] * dot3(state + 6 * i, state + 6 * j);
    }
    chain_factor(s);
    chain_solve(s, lambda);
    for (int i = 0; i < LINKS; i++)
        energy += REAL(0.5) * (dot3(state + 6 * i + 3, wp + 3 * i) - u[i] * lambda[i]);
    return energy;
}

static void chain_positions(const real *state, real *q) {
    for (int i = 0; i < LINKS; i++)
        for (int c = 0; c < 3; c++) q[3 * i + c] = state[6 * i + c];
}

/* Leaves g and v in work; H. */
static real chain_gradient(const real *state, real *work) {
    real *g = work + CHAIN_G, *v = work + CHAIN_V;
    const real *lambda = work + CHAIN_LAMBDA, one = REAL(1.0);
    real potential, energy;
    chain_positions(state, work + CHAIN_Q);
    net_vjp(work + CHAIN_Q, &one, &potential, g, work + CHAIN_NET);
    energy = chain_kinetic(state, work) + potential;
    for (int i = 0; i < LINKS; i++)
        for (int c = 0; c < 3; c++) {
            real sum = REAL(0.0);
            for (int j = 0; j < LINKS; j++)
                sum +=
                    NAME_mass_inverse[i * LINKS + j] * (state[6 * j + 3 + c] - lambda[j] * state[6 * j + c]);
            v[3 * i + c] = sum;
            g[3 * i + c] -= lambda[i] * sum;
        }
    return energy;
}

NAME_real NAME_hamiltonian(const NAME_real *state, NAME_real *work) {
    real energy;
    chain_positions(state, work + CHAIN_Q);
    net_value(work + CHAIN_Q, &energy, work + CHAIN_NET);
    energy += chain_kinetic(state, work);
    mark_unfit(STATE, state, 1, &energy);
    return energy;
}

void NAME_eval(const NAME_real *x, NAME_real *y, NAME_real *work) {
    y[0] = NAME_hamiltonian(x, work);
}

void NAME_grad(const NAME_real *x, NAME_real *y, NAME_real *jacobian, NAME_real *work) {
    real energy = chain_gradient(x, work);
    mark_unfit(STATE, x, 1, &energy);
    if (y) y[0] = energy;
    for (int i = 0; i < LINKS; i++)
        for (int c = 0; c < 3; c++) {
            jacobian[6 * i + c] = work[CHAIN_G + 3 * i + c];
            jacobian[6 * i + 3 + c] = work[CHAIN_V + 3 * i + c];
        }
    mark_unfit(STATE, x, STATE, jacobian);
}

/* xi = q x v, eta = g x q + v x p + tau */
void NAME_field(const NAME_real *state, const NAME_real *input, NAME_real *field, NAME_real *work) {
    (void)chain_gradient(state, work);
    for (int i = 0; i < LINKS; i++) {
        const real *q = state + 6 * i, *g = work + CHAIN_G + 3 * i, *v = work + CHAIN_V + 3 * i;
        real *xi = field + 6 * i, *eta = xi + 3, vp[3];
        cross3(q, v, xi);
        cross3(g, q, eta);
        cross3(v, q + 3, vp);
        for (int c = 0; c < 3; c++) {
            eta[c] += vp[c];
            if (input) eta[c] += input[3 * i + c];
        }
    }
    mark_unfit(STATE, state, STATE, field);
}
