/* A step of length 0 gives the state as it is, to the bit. */
static int step_is_none(real h, const real *state, real *next) {
    if (h != REAL(0.0)) return 0;
    for (int i = 0; i < STATE; i++) next[i] = state[i];
    return 1;
}
