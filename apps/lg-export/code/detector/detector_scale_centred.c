/* Mean of n numbers every `stride`, eight sums side by side. */
static NOINLINE real mean_of(int n, int stride, const real *x, real from) {
    real lane[8] = {0, 0, 0, 0, 0, 0, 0, 0};
    int t = 0;
    for (; t + 8 <= n; t += 8)
        for (int j = 0; j < 8; j++) lane[j] += x[(t + j) * stride] - from;
    for (; t < n; t++) lane[t % 8] += x[t * stride] - from;
    return (((lane[0] + lane[4]) + (lane[2] + lane[6])) + ((lane[1] + lane[5]) + (lane[3] + lane[7]))) /
           (real)n;
}

/* Channel by channel, x (channels, length) -> out (length, channels), each channel's own mean taken off
 * first: as differences to its first sample, which an offset does not round. */
static NOINLINE void scale_window(const real *RESTRICT x, real *RESTRICT out) {
    ROLLED
    for (int c = 0; c < NAME_CHANNELS; c++, x += NAME_LENGTH) {
        const real first = x[0], own = mean_of(NAME_LENGTH, 1, x, first);
        ROLLED
        for (int t = 0; t < NAME_LENGTH; t++)
            out[t * NAME_CHANNELS + c] =
                ((((x[t] - first) - own) - NAME_mean[c]) - NAME_mean_rest[c]) * NAME_inverse_scale[c];
    }
}

/* The derivative by the window as recorded from that by the scaled one: its own mean taken off too. */
static NOINLINE void scale_window_vjp(const real *RESTRICT dout, real *RESTRICT dx) {
    ROLLED
    for (int c = 0; c < NAME_CHANNELS; c++, dx += NAME_LENGTH) {
        const real own = mean_of(NAME_LENGTH, NAME_CHANNELS, dout + c, REAL(0.0));
        ROLLED
        for (int t = 0; t < NAME_LENGTH; t++)
            dx[t] = (dout[t * NAME_CHANNELS + c] - own) * NAME_inverse_scale[c];
    }
}
