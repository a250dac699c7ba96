/* After compute_features, with the same work. */
static void features_vjp(FOR_WINDOW const real *x, const real *df, real *dx, real *work) {
    const real *deviation = work + NAME_LENGTH;
    for (int p = 0; p < PAIRS; p++, df += 2, deviation += 2 * SEGMENTS) {
        const real *a = deviation, *m = deviation + SEGMENTS;
        const int first = NAME_pair[2 * p] * NAME_LENGTH, second = NAME_pair[2 * p + 1] * NAME_LENGTH;
        const fitted_line l = fit_line(OF_WINDOW a, m);
        const real slope = l.level ? REAL(0.0) : (df[1] - l.mean_x * df[0]) / l.xx;
        for (int s = 0; s < SEGMENTS; s++) {
            const int begin = part_begin(OF_WINDOW s), count = part_begin(OF_WINDOW s + 1) - begin;
            const real da = a[s] - l.mean_x, dm = m[s] - l.mean_y,
                       by_a = slope * (dm - REAL(2.0) * l.slope * da) - l.slope * df[0] / (real)SEGMENTS,
                       by_m = slope * da + df[0] / (real)SEGMENTS;
            deviation_vjp(count, INVERSE_SCALE(NAME_pair[2 * p]), x + first + begin, by_a, dx + first + begin,
                          work);
            deviation_vjp(count, INVERSE_SCALE(NAME_pair[2 * p + 1]), x + second + begin, by_m,
                          dx + second + begin, work);
        }
    }
}
