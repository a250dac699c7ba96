/* what stands in test_machine.c, then A and B */
static void extra(const NAME_real *x, NAME_real *out, NAME_real *work) {
    NAME_real *A;
    motion(x, out, work);
    A = out + NAME_FIELD_SIZE + 2 * NAME_STATE_SIZE + NAME_POSITIONS + NAME_VELOCITIES;
    NAME_linearise(x, golden_input, A, A + NAME_TANGENT * NAME_TANGENT, work);
}
