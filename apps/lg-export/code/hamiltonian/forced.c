static const real no_input[INPUT] = {REAL(0.0)};

static void flow(const real *state, const real *input, real *field, real *work) {
    NAME_flow(state, input != NULL ? input : no_input, field, work);
}

static void advance(real h, const real *state, const real *input, real *next, real *work) {
    NAME_advance(state, input != NULL ? input : no_input, &h, next, work);
}
