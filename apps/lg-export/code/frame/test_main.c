#ifdef GRADIENT
static void gradient(const real *x, real *out, real *work) {
    NAME_grad(x, NULL, out, work);
}

static void value_beside(const real *x, real *out, real *work) {
    static real jacobian[NAME_OUTPUTS * NAME_INPUTS];
    NAME_grad(x, out, jacobian, work);
}
#endif

int main(void) {
    int wrong = check("value", NAME_eval, golden_value, NAME_OUTPUTS);
#ifdef GRADIENT
    wrong += check("gradient", gradient, golden_gradient, NAME_OUTPUTS * NAME_INPUTS);
    wrong += check("value beside gradient", value_beside, golden_value, NAME_OUTPUTS);
#endif
#ifdef EXTRAS
    wrong += check(EXTRA_NAME, extra, golden_extra, EXTRAS);
#endif
    return wrong > 0;
}
