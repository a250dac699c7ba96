/* Linear decisions: y = p W + b. */
static void decide(const real *p, real *y, real *work) {
    (void)work;
    dense(&decisions, p, y);
}
