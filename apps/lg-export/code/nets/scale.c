/* y <- slope y */
static void scale_by(int n, const real *RESTRICT slope, real *RESTRICT y) {
    for (int i = 0; i < n; i++) y[i] *= slope[i];
}
