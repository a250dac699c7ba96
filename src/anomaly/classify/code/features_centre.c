/* Sum of a_i b_i in eight sums side by side, which a compiler turns into vectors. */
static real dot_of(int n, const real *a, const real *b) {
    real lane[8] = {0, 0, 0, 0, 0, 0, 0, 0}, rest = REAL(0.0);
    int i = 0;
    for (; i + 8 <= n; i += 8)
        for (int j = 0; j < 8; j++) lane[j] += a[i + j] * b[i + j];
    for (; i < n; i++) rest += a[i] * b[i];
    return rest + (((lane[0] + lane[4]) + (lane[2] + lane[6])) + ((lane[1] + lane[5]) + (lane[3] + lane[7])));
}

/* z (n) becomes (x - mean) factor; returns its standard deviation, denominator n. Differences to the first
 * number, so that an offset is not rounded into them; the mean is taken off twice, the second time what
 * rounding has left of it. A constant gives zeros. */
static real centre_numbers(int n, real factor, const real *x, real *z) {
    const real first = x[0];
    for (int t = 0; t < n; t++) z[t] = (x[t] - first) * factor;
    for (int pass = 0; pass < 2; pass++) {
        real lane[8] = {0, 0, 0, 0, 0, 0, 0, 0};
        int t = 0;
        for (; t + 8 <= n; t += 8)
            for (int j = 0; j < 8; j++) lane[j] += z[t + j];
        for (; t < n; t++) lane[t % 8] += z[t];
        const real sum = ((lane[0] + lane[4]) + (lane[2] + lane[6])) +
                         ((lane[1] + lane[5]) + (lane[3] + lane[7])),
                   mean = sum / (real)n;
        for (t = 0; t < n; t++) z[t] -= mean;
    }
    return SQRT(dot_of(n, z, z) / (real)n);
}
