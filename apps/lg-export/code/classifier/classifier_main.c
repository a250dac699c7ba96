void NAME_features(const NAME_real *window, NAME_real *features, NAME_real *work) {
    compute_features(window, features, work);
}

/* The numbers that the decision is made of; where in work they lie. */
static const real *judged_numbers(const real *x, real *work) {
    compute_features(x, work + COMPUTED, work + REST);
    standardise(work + COMPUTED, work + STANDARDISED);
    return project(work + STANDARDISED, work);
}

void NAME_eval(const NAME_real *x, NAME_real *y, NAME_real *work) {
    const real *p = judged_numbers(x, work);
    decide(p, y, work + KERNEL);
    mark_unfit(NAME_INPUTS, x, NAME_OUTPUTS, y);
}

int NAME_classify(const NAME_real *window, NAME_real *probability, NAME_real *work) {
    real *score = probability != 0 ? probability : work + SCORES;
    NAME_eval(window, work + DECIDED, work);
    scores_of(work + DECIDED, score, work + KERNEL);
    mark_unfit(NAME_INPUTS, window, NAME_CLASSES, score);
    return score[0] == score[0] ? class_of(score) : -1;
}
