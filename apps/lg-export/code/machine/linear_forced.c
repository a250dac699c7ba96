static void linear(const real *state, const real *input, real *jx, real *ju, real *work) {
    NAME_linear(state, input != NULL ? input : no_input, jx, ju, work);
}
