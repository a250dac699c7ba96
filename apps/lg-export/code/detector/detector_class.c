/* The class of the largest score: of two equal ones class 1, of more the first. */
static int class_of(const real *score) {
    int best = 0;
    if (NAME_CLASSES == 2) return score[1] >= score[0];
    for (int k = 1; k < NAME_CLASSES; k++)
        if (score[k] > score[best]) best = k;
    return best;
}
