/* Adds 2 gamma coefficient K (vector - p) over the vectors of class `own` in the pair with `other`. */
static void add_gradient(int own, int other, const real *p, const real *kernel, real *dp) {
    const real *coefficient = coefficients_of(own, other);
    const int first = first_of(own);
    for (int v = 0; v < NAME_vectors_of[own]; v++) {
        const real factor = REAL(2.0) * GAMMA * coefficient[v] * kernel[first + v],
                   *vector = NAME_vector + (first + v) * PROJECTIONS;
        for (int i = 0; i < PROJECTIONS; i++) dp[i] += factor * (vector[i] - p[i]);
    }
}

/* Derivative of decision o by p, after decide with the same work. */
static void decide_vjp(int o, const real *p, real *dp, const real *work) {
    int i = 0, j = o;
    for (; j >= NAME_CLASSES - 1 - i; i++) j -= NAME_CLASSES - 1 - i;
    j += i + 1;
    for (int k = 0; k < PROJECTIONS; k++) dp[k] = REAL(0.0);
    if (NAME_CLASSES > 2 && (NAME_vectors_of[i] == 0 || NAME_vectors_of[j] == 0)) return;
    add_gradient(i, j, p, work, dp);
    add_gradient(j, i, p, work, dp);
}
