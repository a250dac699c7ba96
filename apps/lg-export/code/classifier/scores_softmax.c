/* exp(y_i)/sum_j exp(y_j), the largest taken off before. */
static void scores_of(const real *logit, real *probability, real *work) {
    real most = logit[0], sum = REAL(0.0);
    (void)work;
    for (int i = 1; i < NAME_CLASSES; i++)
        if (logit[i] > most) most = logit[i];
    for (int i = 0; i < NAME_CLASSES; i++) sum += probability[i] = EXP(logit[i] - most);
    for (int i = 0; i < NAME_CLASSES; i++) probability[i] /= sum;
}
