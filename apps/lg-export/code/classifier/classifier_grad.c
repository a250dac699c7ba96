void NAME_grad(const NAME_real *x, NAME_real *y, NAME_real *jacobian, NAME_real *work) {
    const real *p = judged_numbers(x, work);
    decide(p, y != 0 ? y : work + DECIDED, work + KERNEL);
    for (int o = 0; o < NAME_OUTPUTS; o++, jacobian += NAME_INPUTS) {
        decide_vjp(o, p, work + BY_PROJECTED, work + KERNEL);
        project_vjp(work + BY_PROJECTED, work + BY_FEATURES);
        ROLLED
        for (int i = 0; i < NAME_INPUTS; i++) jacobian[i] = REAL(0.0);
        features_vjp(x, work + BY_FEATURES, jacobian, work + REST);
        mark_unfit(NAME_INPUTS, x, NAME_INPUTS, jacobian);
    }
    if (y != 0) mark_unfit(NAME_INPUTS, x, NAME_OUTPUTS, y);
}
