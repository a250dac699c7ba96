/* Learned Hamiltonian on R^2n, state q p: H = 1/2 |A p|^2 + V(q). */

/* Work. */
enum {
    SEPARABLE_AP = 0,                    /* (LINKS) A p */
    SEPARABLE_NET = SEPARABLE_AP + LINKS /* the network's */
};

/* ap = A p; the kinetic energy */
static real separable_kinetic(const real *p, real *ap) {
    real energy = REAL(0.0);
    for (int i = 0; i < LINKS; i++) {
        real sum = REAL(0.0);
        for (int j = 0; j < LINKS; j++) sum += NAME_kinetic[i * LINKS + j] * p[j];
        ap[i] = sum;
        energy += REAL(0.5) * sum * sum;
    }
    return energy;
}

/* dH/dp = A^T A p; the kinetic energy */
static real separable_velocity(const real *p, real *velocity, real *work) {
    real *ap = work + SEPARABLE_AP;
    const real energy = separable_kinetic(p, ap);
    for (int j = 0; j < LINKS; j++) {
        velocity[j] = REAL(0.0);
        for (int i = 0; i < LINKS; i++) velocity[j] += NAME_kinetic[i * LINKS + j] * ap[i];
    }
    return energy;
}

/* -dV/dq + input */
static void separable_force(const real *q, const real *input, real *force, real *work) {
    const real minus = REAL(-1.0);
    real potential;
    net_vjp(q, &minus, &potential, force, work + SEPARABLE_NET);
    if (input)
        for (int i = 0; i < LINKS; i++) force[i] += input[i];
}

NAME_real NAME_hamiltonian(const NAME_real *state, NAME_real *work) {
    real energy;
    net_value(state, &energy, work + SEPARABLE_NET);
    energy += separable_kinetic(state + LINKS, work + SEPARABLE_AP);
    mark_unfit(STATE, state, 1, &energy);
    return energy;
}

void NAME_eval(const NAME_real *x, NAME_real *y, NAME_real *work) {
    y[0] = NAME_hamiltonian(x, work);
}

void NAME_grad(const NAME_real *x, NAME_real *y, NAME_real *jacobian, NAME_real *work) {
    const real one = REAL(1.0);
    real potential, energy;
    net_vjp(x, &one, &potential, jacobian, work + SEPARABLE_NET);
    energy = separable_velocity(x + LINKS, jacobian + LINKS, work) + potential;
    mark_unfit(STATE, x, STATE, jacobian);
    mark_unfit(STATE, x, 1, &energy);
    if (y) y[0] = energy;
}

/* (q', p') = (dH/dp, -dH/dq + input) */
void NAME_field(const NAME_real *state, const NAME_real *input, NAME_real *field, NAME_real *work) {
    (void)separable_velocity(state + LINKS, field, work);
    separable_force(state, input, field + LINKS, work);
    mark_unfit(STATE, state, STATE, field);
}
