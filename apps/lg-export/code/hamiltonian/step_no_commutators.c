static void space_commutators(int row, real h, const real *k, real *sigma) {
    (void)row;
    (void)h;
    (void)k;
    (void)sigma;
}
