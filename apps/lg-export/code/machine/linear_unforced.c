static void linear(const real *state, const real *input, real *jx, real *ju, real *work) {
    (void)input, (void)ju;
    NAME_linear(state, jx, work);
}
