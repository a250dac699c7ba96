/* y is NULL if the caller does not want this output. NOINLINE is needed: if gcc 12 inlines the function, it
 * concludes from the test that a caller's array may be NULL and warns (-Warray-bounds) about copies that
 * never happen. */
static NOINLINE void copy(int n, const real *x, real *y) {
    if (y == NULL) return;
    for (int i = 0; i < n; i++) y[i] = x[i];
}
