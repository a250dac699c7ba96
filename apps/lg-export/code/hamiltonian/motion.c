void NAME_field(const NAME_real *state, const NAME_real *input, NAME_real *field, NAME_real *work) {
    (void)input;
    NAME_flow(state, GIVEN field, work);
}

/* A step of length 0 gives the state as it is, to the bit. */
void NAME_step(NAME_real h, const NAME_real *state, const NAME_real *input, NAME_real *next,
               NAME_real *work) {
    (void)input;
    if (h == REAL(0.0)) {
        for (int i = 0; i < STATE; i++) next[i] = state[i];
        return;
    }
    NAME_advance(state, GIVEN & h, work, work + STATE);
    arrive(state, work, next);
}
