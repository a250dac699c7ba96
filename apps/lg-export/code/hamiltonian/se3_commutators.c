/* sigma += h^2 weight [k_first, k_second] for the commutators of this row */
static void space_commutators(int row, real h, const real *k, real *sigma) {
    for (int n = 0; n < COMMUTATORS; n++) {
        const real weight = h * h * commutator_weight[n];
        const real *first = k + commutator[3 * n + 1] * STATE, *second = k + commutator[3 * n + 2] * STATE;
        if (commutator[3 * n] != row) continue;
        for (int i = 0; i < LINKS; i++) {
            real bracket[6];
            se3_bracket(first + 6 * i, second + 6 * i, bracket);
            for (int c = 0; c < 6; c++) sigma[6 * i + c] += weight * bracket[c];
        }
    }
}
