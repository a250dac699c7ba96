/* what stands in test_motion.c, then A and B */
static void extra(const NAME_real *x, NAME_real *out, NAME_real *work) {
    NAME_real *A = out + NAME_FIELD_SIZE + NAME_STATE_SIZE;
    motion(x, out, work);
    NAME_linearise(x, golden_input, A, A + NAME_TANGENT * NAME_TANGENT, work);
}
