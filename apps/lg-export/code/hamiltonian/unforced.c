static void flow(const real *state, const real *input, real *field, real *work) {
    (void)input;
    NAME_flow(state, field, work);
}

static void advance(real h, const real *state, const real *input, real *next, real *work) {
    (void)input;
    NAME_advance(state, &h, next, work);
}
