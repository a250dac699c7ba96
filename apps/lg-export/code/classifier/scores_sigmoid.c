/* 1/(1 + exp(y)) and 1/(1 + exp(-y)): neither loses digits where it is small. */
static void scores_of(const real *logit, real *probability, real *work) {
    (void)work;
    probability[0] = REAL(1.0) / (REAL(1.0) + EXP(logit[0]));
    probability[1] = REAL(1.0) / (REAL(1.0) + EXP(-logit[0]));
}
