/* Channel by channel, x (channels, length) -> out (length, channels). The mean is a sum of two numbers: what
 * the first one's rounding leaves out is in the second. */
static NOINLINE void scale_window(const real *RESTRICT x, real *RESTRICT out) {
    ROLLED
    for (int c = 0; c < NAME_CHANNELS; c++, x += NAME_LENGTH) {
        ROLLED
        for (int t = 0; t < NAME_LENGTH; t++)
            out[t * NAME_CHANNELS + c] = ((x[t] - NAME_mean[c]) - NAME_mean_rest[c]) * NAME_inverse_scale[c];
    }
}

/* The derivative by the window as recorded from that by the scaled one. */
static NOINLINE void scale_window_vjp(const real *RESTRICT dout, real *RESTRICT dx) {
    ROLLED
    for (int c = 0; c < NAME_CHANNELS; c++, dx += NAME_LENGTH) {
        ROLLED
        for (int t = 0; t < NAME_LENGTH; t++) dx[t] = dout[t * NAME_CHANNELS + c] * NAME_inverse_scale[c];
    }
}
