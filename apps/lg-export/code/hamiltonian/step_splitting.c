/* Splitting: in turn p += kick_i h (force(q) + input), q += drift_i h velocity(p). A force at an unchanged q
 * is not evaluated again inside a step. */

/* Work, behind that of NAME_field. */
enum { SPLITTING_FORCE = STEP_BEGIN, SPLITTING_VELOCITY = SPLITTING_FORCE + LINKS };

static void add_scaled(real c, const real *x, real *y) {
    for (int i = 0; i < LINKS; i++) y[i] += c * x[i];
}

void NAME_step(NAME_real h, const NAME_real *state, const NAME_real *input, NAME_real *next,
               NAME_real *work) {
    real *force = work + SPLITTING_FORCE, *velocity = work + SPLITTING_VELOCITY;
    int known = 0;
    if (step_is_none(h, state, next)) return;
    for (int i = 0; i < STATE; i++) next[i] = state[i];
    for (int i = 0; i < STAGES; i++) {
        if (splitting_acts[2 * i]) {
            if (!known) separable_force(next, input, force, work);
            known = 1;
            add_scaled(h * splitting[2 * i], force, next + LINKS);
        }
        if (splitting_acts[2 * i + 1]) {
            (void)separable_velocity(next + LINKS, velocity, work);
            add_scaled(h * splitting[2 * i + 1], velocity, next);
            known = 0;
        }
    }
}
