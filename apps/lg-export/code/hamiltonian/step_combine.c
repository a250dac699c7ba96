/* sigma = h sum_{j < count} coefficient_j k_j */
static void combine(real h, const real *coefficient, int count, const real *k, real *sigma) {
    for (int i = 0; i < STATE; i++) sigma[i] = REAL(0.0);
    for (int j = 0; j < count; j++) {
        const real c = h * coefficient[j];
        if (coefficient[j] > REAL(0.0) || coefficient[j] < REAL(0.0))
            for (int i = 0; i < STATE; i++) sigma[i] += c * k[j * STATE + i];
    }
}
