/* Sum of w[i] x[i]: eight partial sums side by side, which compilers keep in one vector. */
static real dot(int n, const real *RESTRICT w, const real *RESTRICT x) {
    real s0 = REAL(0.0), s1 = s0, s2 = s0, s3 = s0, s4 = s0, s5 = s0, s6 = s0, s7 = s0;
    for (; n >= 8; n -= 8, w += 8, x += 8) {
        s0 += w[0] * x[0];
        s1 += w[1] * x[1];
        s2 += w[2] * x[2];
        s3 += w[3] * x[3];
        s4 += w[4] * x[4];
        s5 += w[5] * x[5];
        s6 += w[6] * x[6];
        s7 += w[7] * x[7];
    }
    for (; n > 0; n--) s0 += *w++ * *x++;
    return ((s0 + s4) + (s2 + s6)) + ((s1 + s5) + (s3 + s7));
}
