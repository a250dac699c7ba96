/* The score is positive for class 1. */
static void scores_of(const real *y, real *score, real *work) {
    (void)work;
    score[0] = -y[0];
    score[1] = y[0];
}
