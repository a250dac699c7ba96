/* A commutator-free scheme: k_i = f(Y_i), and Y_i and y1 are products of exponentials of combinations of the
 * k_j: exp(h sum_j c_nj k_j) ... exp(h sum_j c_1j k_j) . base. Row i has the exponentials cf_begin[i] ..
 * cf_begin[i + 1] - 1, and writes point cf_slot[i]; its base is point cf_base[i], or y where that is -1.
 * Algebra elements have as many numbers as states. */

/* Work, behind that of NAME_field. */
enum {
    CF_SIGMA = STEP_BEGIN,
    CF_K = CF_SIGMA + STATE,          /* (STAGES, STATE) */
    CF_POINTS = CF_K + STAGES * STATE /* (SLOTS, STATE) */
};

/* The point of the row: in `out`, or the base itself where there is no exponential. */
static const real *cf_point(int row, real h, const real *state, real *out, real *work) {
    const real *from = cf_base[row] < 0 ? state : work + CF_POINTS + cf_base[row] * STATE;
    for (int e = cf_begin[row]; e < cf_begin[row + 1]; e++) {
        combine(h, cf_coefficient + e * STAGES, STAGES, work + CF_K, work + CF_SIGMA);
        space_act(work + CF_SIGMA, from, out);
        from = out;
    }
    return from;
}

void NAME_step(NAME_real h, const NAME_real *state, const NAME_real *input, NAME_real *next,
               NAME_real *work) {
    const real *end;
    if (step_is_none(h, state, next)) return;
    for (int i = 0; i < STAGES; i++) {
        const real *point = cf_point(i, h, state, work + CF_POINTS + cf_slot[i] * STATE, work);
        NAME_field(point, input, work + CF_K + i * STATE, work);
    }
    end = cf_point(STAGES, h, state, next, work);
    for (int i = 0; i < STATE; i++) next[i] = end[i];
}
