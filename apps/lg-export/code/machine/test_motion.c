/* field and step with a constant input */
static void motion(const NAME_real *x, NAME_real *out, NAME_real *work) {
    NAME_field(x, golden_input, out, work);
    NAME_step(golden_step, x, golden_input, out + NAME_FIELD_SIZE, work);
}
