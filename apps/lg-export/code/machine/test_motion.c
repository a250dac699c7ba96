/* field and step with a constant input, positions and velocities, the state of these, A and B */
static void extra(const NAME_real *x, NAME_real *out, NAME_real *work) {
    NAME_field(x, golden_input, out, work);
    out += NAME_FIELD_SIZE;
    NAME_step(golden_step, x, golden_input, out, work);
    out += NAME_STATE_SIZE;
#ifdef NAME_POSITIONS
    NAME_positions(x, out, work);
    NAME_velocities(x, out + NAME_POSITIONS, work);
    NAME_state(out, out + NAME_POSITIONS, out + NAME_POSITIONS + NAME_VELOCITIES, work);
    out += NAME_POSITIONS + NAME_VELOCITIES + NAME_STATE_SIZE;
#endif
#ifdef NAME_TANGENT
    NAME_linearise(x, golden_input, out, out + NAME_TANGENT * NAME_TANGENT, work);
#endif
}
