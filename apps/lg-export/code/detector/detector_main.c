void NAME_eval(const NAME_real *x, NAME_real *y, NAME_real *work) {
    scale_window(x, cnn_open(cnn_places_eval, 0, work));
    cnn_run_blocks(cnn_places_eval, 0, work);
    cnn_run_dense(cnn_places_eval, 0, y, work);
    mark_unfit(NAME_INPUTS, x, NAME_OUTPUTS, y);
}

void NAME_grad(const NAME_real *x, NAME_real *y, NAME_real *jacobian, NAME_real *work) {
    real *logit = y != 0 ? y : work + LOGIT;
    scale_window(x, cnn_open(cnn_places_grad, 0, work));
    cnn_run_blocks(cnn_places_grad, 1, work);
    cnn_run_dense(cnn_places_grad, 1, logit, work);
    for (int o = 0; o < NAME_OUTPUTS; o++) scale_window_vjp(cnn_reverse(o, work), jacobian + o * NAME_INPUTS);
    mark_unfit(NAME_INPUTS, x, NAME_OUTPUTS * NAME_INPUTS, jacobian);
    if (y != 0) mark_unfit(NAME_INPUTS, x, NAME_OUTPUTS, y);
}

int NAME_classify(const NAME_real *window, NAME_real *probability, NAME_real *work) {
    real *score = probability != 0 ? probability : work + PROBABILITY;
    NAME_eval(window, work + LOGIT, work);
    scores_of(work + LOGIT, score, work);
    mark_unfit(NAME_INPUTS, window, NAME_CLASSES, score);
    return score[0] == score[0] ? class_of(score) : -1;
}
