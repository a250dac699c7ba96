void NAME_features(const NAME_real *window, NAME_real *features, NAME_real *work) {
    compute_features(window, features, work);
}

void NAME_eval(const NAME_real *x, NAME_real *y, NAME_real *work) {
    compute_features(x, work + COMPUTED, work);
    NAME_decide(work + COMPUTED, y, work + PROGRAM);
    mark_unfit(NAME_INPUTS, x, NAME_OUTPUTS, y);
}

int NAME_classify(const NAME_real *window, NAME_real *probability, NAME_real *work) {
    real *score = probability != NULL ? probability : work + SCORES;
    compute_features(window, work + COMPUTED, work);
    NAME_score(work + COMPUTED, score, work + PROGRAM);
    mark_unfit(NAME_INPUTS, window, NAME_CLASSES, score);
    return score[0] == score[0] ? class_of(score) : -1;
}
