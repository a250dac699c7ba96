NAME_real NAME_hamiltonian(const NAME_real *state, NAME_real *work) {
    real energy;
    NAME_eval(state, &energy, work);
    return energy;
}
