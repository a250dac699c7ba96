/* Each pair of classes votes for one of them; a term within 1/3, made of a class's decisions, orders classes
 * of equal votes. The first of the classes with the most votes has the largest score. A class without
 * support vectors is never given. work: CLASSES. */
static void scores_of(const real *y, real *score, real *work) {
    real *votes = work;
    int first = 0, largest = 0;
    for (int k = 0; k < NAME_CLASSES; k++) score[k] = votes[k] = REAL(0.0);
    for (int i = 0; i < NAME_CLASSES; i++)
        for (int j = i + 1; j < NAME_CLASSES; j++, y++) {
            if (NAME_vectors_of[i] > 0 && NAME_vectors_of[j] > 0) {
                votes[*y > REAL(0.0) ? i : j] += REAL(1.0);
                score[i] += *y;
                score[j] -= *y;
            } else {
                votes[i] += NAME_vectors_of[i] > 0 ? REAL(1.0) : REAL(0.0);
                votes[j] += NAME_vectors_of[j] > 0 ? REAL(1.0) : REAL(0.0);
            }
        }
    for (int k = 0; k < NAME_CLASSES; k++) {
        if (NAME_vectors_of[k] == 0)
            score[k] = votes[k] = -REAL(1.0);
        else
            score[k] = votes[k] + score[k] / (REAL(3.0) * (FABS(score[k]) + REAL(1.0)));
        if (votes[k] > votes[first]) first = k;
        if (score[k] > score[largest]) largest = k;
    }
    if (largest != first) score[first] = score[largest] + REAL_EPSILON * (FABS(score[largest]) + REAL(1.0));
}
