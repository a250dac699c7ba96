enum { BLOCK = 64 };
/* Sum of the BLOCK numbers x, which are overwritten. Loops over a block, and of fixed lengths, become vectors
 * without the compiler's leave to change the order of a sum. */
static real sum_of(real *x) {
    for (int half = BLOCK / 2; half > 4; half /= 2)
        for (int i = 0; i < half; i++) x[i] += x[i + half];
    return ((x[0] + x[4]) + (x[2] + x[6])) + ((x[1] + x[5]) + (x[3] + x[7]));
}

/* The mean of x (n) in two parts: its first number, so that an offset is not rounded into the differences to
 * it, and the mean of these differences, which is at most sqrt(n) standard deviations. A constant has the
 * mean x[0] + 0. work: BLOCK. */
static NOINLINE void mean_of(int n, const real *RESTRICT x, real *mean, real *RESTRICT work) {
    const real first = x[0];
    for (int j = 0; j < BLOCK; j++) work[j] = REAL(0.0);
    for (int t = 0; t < n; t += BLOCK) {
        const int some = n - t < BLOCK ? n - t : BLOCK;
        for (int j = 0; j < some; j++) work[j] += x[t + j] - first;
    }
    mean[0] = first;
    mean[1] = sum_of(work) / (real)n;
}

/* z (n) becomes the deviations of x (n) from `mean`, times `factor`. */
static NOINLINE void deviate(int n, const real *RESTRICT x, const real *mean, real factor, real *RESTRICT z) {
    const real first = mean[0], rest = mean[1];
    for (int t = 0; t < n; t++) z[t] = ((x[t] - first) - rest) * factor;
}
