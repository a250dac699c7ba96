static void scores_of(const real *y, real *score, real *work) {
    (void)work;
    for (int k = 0; k < NAME_CLASSES; k++) score[k] = y[k];
}
