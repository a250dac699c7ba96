/* If clang knows n, it would unroll the loop of `dot`, or merge several such loops into one with gather
 * instructions. The pragma in AS_IT_STANDS prevents both. IN_PLACE lets clang inline the function. */
#if defined(__clang__)
#define AS_IT_STANDS _Pragma("clang loop vectorize(disable) unroll(disable)")
#define IN_PLACE     inline
#else
#define AS_IT_STANDS
#define IN_PLACE
#endif

/* Sum of w[i] x[i]. The eight partial sums are independent, so compilers keep them in one vector. */
static IN_PLACE real dot(int n, const real *RESTRICT w, const real *RESTRICT x) {
    real s0 = REAL(0.0), s1 = s0, s2 = s0, s3 = s0, s4 = s0, s5 = s0, s6 = s0, s7 = s0;
    const int whole = n - n % 8;
    AS_IT_STANDS
    for (int i = 0; i < whole; i += 8) {
        s0 += w[i] * x[i];
        s1 += w[i + 1] * x[i + 1];
        s2 += w[i + 2] * x[i + 2];
        s3 += w[i + 3] * x[i + 3];
        s4 += w[i + 4] * x[i + 4];
        s5 += w[i + 5] * x[i + 5];
        s6 += w[i + 6] * x[i + 6];
        s7 += w[i + 7] * x[i + 7];
    }
    for (int i = whole; i < n; i++) s0 += w[i] * x[i];
    return ((s0 + s4) + (s2 + s6)) + ((s1 + s5) + (s3 + s7));
}
