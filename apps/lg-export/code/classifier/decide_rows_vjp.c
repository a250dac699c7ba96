/* Derivative of decision o by p. */
static void decide_vjp(int o, const real *p, real *dp, const real *work) {
    (void)p, (void)work;
    for (int i = 0; i < decisions.in; i++) dp[i] = NAME_weights[decisions.weight + i * NAME_OUTPUTS + o];
}
