/* field and step with a constant input, positions and velocities, and the state of these */
static void motion(const NAME_real *x, NAME_real *out, NAME_real *work) {
    NAME_real *next = out + NAME_FIELD_SIZE, *q = next + NAME_STATE_SIZE, *v = q + NAME_POSITIONS;
    NAME_field(x, golden_input, out, work);
    NAME_step(golden_step, x, golden_input, next, work);
    NAME_positions(x, q, work);
    NAME_velocities(x, v, work);
    NAME_state(q, v, v + NAME_VELOCITIES, work);
}
