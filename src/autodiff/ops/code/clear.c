static NOINLINE void clear(int n, real *y) {
    for (int i = 0; i < n; i++) y[i] = REAL(0.0);
}
