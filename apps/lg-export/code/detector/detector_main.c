int NAME_classify(const NAME_real *window, NAME_real *probability, NAME_real *work) {
    real *score = probability != NULL ? probability : work;
    NAME_probability(window, score, work + AT_NET);
    return score[0] == score[0] ? class_of(score) : -1;
}
