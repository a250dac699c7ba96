/* Runge-Kutta-Munthe-Kaas: sigma_i = h sum_j a_ij k_j, k_i = dexp_sigma_i^-1 f(exp(sigma_i) . y),
 * y1 = exp(h sum_j b_j k_j) . y; b is the last row of `tableau`. Algebra elements have as many numbers as
 * states. */

/* Work, behind that of NAME_field. */
enum {
    RKMK_SIGMA = STEP_BEGIN,
    RKMK_POINT = RKMK_SIGMA + STATE,
    RKMK_K = RKMK_POINT + STATE /* (STAGES, STATE) */
};

static void rkmk_exponent(int row, real h, const real *k, real *sigma) {
    combine(h, tableau + row * STAGES, row, k, sigma);
    space_commutators(row, h, k, sigma);
}

void NAME_step(NAME_real h, const NAME_real *state, const NAME_real *input, NAME_real *next,
               NAME_real *work) {
    real *sigma = work + RKMK_SIGMA, *point = work + RKMK_POINT, *k = work + RKMK_K;
    if (step_is_none(h, state, next)) return;
    NAME_field(state, input, k, work);
    for (int i = 1; i < STAGES; i++) {
        rkmk_exponent(i, h, k, sigma);
        space_act(sigma, state, point);
        NAME_field(point, input, k + i * STATE, work);
        space_dexpinv(sigma, k + i * STATE);
    }
    rkmk_exponent(STAGES, h, k, sigma);
    space_act(sigma, state, next);
}
