void NAME_grad(const NAME_real *x, NAME_real *y, NAME_real *jacobian, NAME_real *work) {
    real *seed = work + SEED;
    if (y != NULL) NAME_eval(x, y, work);
    compute_features(x, work + COMPUTED, work);
    for (int o = 0; o < NAME_OUTPUTS; o++, jacobian += NAME_INPUTS) {
        for (int k = 0; k < NAME_OUTPUTS; k++) seed[k] = (real)(k == o);
        NAME_pull_back(work + COMPUTED, seed, work + BY_FEATURES, work + PROGRAM);
        ROLLED
        for (int i = 0; i < NAME_INPUTS; i++) jacobian[i] = REAL(0.0);
        features_vjp(x, work + BY_FEATURES, jacobian, work);
        mark_unfit(NAME_INPUTS, x, NAME_INPUTS, jacobian);
    }
}
