/* z <- sin(z) */
static void activate(int n, real *z) {
    for (int i = 0; i < n; i++) z[i] = SIN(z[i]);
}
