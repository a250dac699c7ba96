/* The outputs are constant between thresholds. */
void NAME_grad(const NAME_real *x, NAME_real *y, NAME_real *jacobian, NAME_real *work) {
    if (y != NULL) NAME_eval(x, y, work);
    for (int i = 0; i < NAME_OUTPUTS * NAME_INPUTS; i++) jacobian[i] = REAL(0.0);
    mark_unfit(NAME_INPUTS, x, NAME_OUTPUTS * NAME_INPUTS, jacobian);
}
