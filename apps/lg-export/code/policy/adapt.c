/* Recursive least squares, for each velocity alone. The plant's force less the machine's, over a period, is
 *   -damping v - coulomb sign(v) + offset - inertia v'
 * The four numbers are bounded; adapt_range (VELOCITIES, 4) scales them to at most 1. memory holds, for each
 * velocity, the scaled numbers (4), then their covariance (4, 4). */
static const real adapt_low[4] = {REAL(0.0), REAL(0.0), REAL(-1.0), REAL(-0.2)};

static real bounded(real s, real low) {
    return s < low ? low : s > REAL(1.0) ? REAL(1.0) : s;
}

/* Moves a number that left its bounds to the bound, and the others to where they are likeliest then. */
static void stay_inside(const real *P, real *s) {
    for (int k = 0; k < 4; k++) {
        const real by = bounded(s[k], adapt_low[k]) - s[k];
        for (int i = 0; i < 4 && by != REAL(0.0) && P[5 * k] > REAL(0.0); i++)
            s[i] += P[4 * i + k] / P[5 * k] * by;
    }
    for (int k = 0; k < 4; k++) s[k] = bounded(s[k], adapt_low[k]);
}

/* One update: `by` are the derivatives of the force by the numbers s, `away` is the force that they should
 * give. */
static void recur(const real *by, real away, real *s, real *P) {
    real Pb[4], size = ADAPT_NOISE, grown = REAL(0.0);
    for (int i = 0; i < 4; i++) {
        Pb[i] = REAL(0.0);
        for (int j = 0; j < 4; j++) Pb[i] += P[4 * i + j] * by[j];
        size += by[i] * Pb[i];
        away -= by[i] * s[i];
    }
    if (!(away - away == REAL(0.0)) || !(size < REAL_LARGEST)) return;
    for (int i = 0; i < 4; i++) {
        s[i] += Pb[i] / size * away;
        for (int j = 0; j < 4; j++) P[4 * i + j] -= Pb[i] * Pb[j] / size;
    }
    stay_inside(P, s);
    /* What is not excited is not forgotten: no variance grows beyond the one at the start, which is 1. */
    for (int i = 0; i < 4; i++) grown = P[5 * i] > grown ? P[5 * i] : grown;
    for (int i = 0; i < 16 && grown < ADAPT_KEEP; i++) P[i] /= ADAPT_KEEP;
}

void NAME_adapt_start(NAME_real *memory) {
    for (int i = 0; i < VELOCITIES; i++)
        for (int k = 0; k < 20; k++) memory[20 * i + k] = k >= 4 && (k - 4) % 5 == 0 ? REAL(1.0) : REAL(0.0);
}

void NAME_adapt(const NAME_real *x, const NAME_real *u, const NAME_real *next, NAME_real *memory,
                NAME_real *found, NAME_real *work) {
    real *force = work;
    NAME_adapt_force(x, u, next, force, force + VELOCITIES);
    for (int i = 0; i < VELOCITIES; i++, memory += 20) {
        const real v = x[VELOCITIES + i], w = next[VELOCITIES + i], middle = REAL(0.5) * (v + w);
        const real *range = adapt_range + 4 * i, slow = REAL(0.01) * adapt_speed[i];
        const real by[4] = {-range[0] * middle / adapt_scale[i],
                            -range[1] * middle / (FABS(middle) + slow) / adapt_scale[i],
                            range[2] / adapt_scale[i], -range[3] * (w - v) / (PERIOD * adapt_scale[i])};
        recur(by, force[i] / adapt_scale[i], memory, memory + 4);
        for (int k = 0; k < 4; k++) found[4 * i + k] = range[k] * memory[k];
    }
}
