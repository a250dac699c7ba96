/* One Newton correction of |q| = 1 and q.p = 0 where rounding is what violates them: without it rounding adds
 * up over a run. Farther points keep their distance. `from`: the state before. */
static void settle_direction(const real *from, const real *to, real *next) {
    real norm = REAL(0.0), size = REAL(1.0), along = REAL(0.0), off;
    for (int i = 0; i < 3; i++) {
        norm += to[i] * to[i];
        size += from[3 + i] * from[3 + i] + to[3 + i] * to[3 + i];
    }
    off = norm - REAL(1.0);
    if (!(FABS(off) <= manifold_rounding)) off = REAL(0.0), size = REAL(0.0);
    for (int i = 0; i < 3; i++) {
        next[i] = to[i] - REAL(0.5) * off * to[i];
        along += next[i] * to[3 + i];
    }
    if (!(along * along <= size * (manifold_rounding * manifold_rounding))) along = REAL(0.0);
    for (int i = 0; i < 3; i++) next[3 + i] = to[3 + i] - along * next[i];
}

/* The same for R R^T = I: R - (R R^T - I) R / 2. */
static void settle_rotation(const real *to, real *next) {
    real off[9], worst = REAL(0.0);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            real sum = i == j ? REAL(-1.0) : REAL(0.0);
            for (int k = 0; k < 3; k++) sum += to[3 * i + k] * to[3 * j + k];
            off[3 * i + j] = sum;
            if (!(FABS(sum) <= worst)) worst = FABS(sum);
        }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            real sum = REAL(0.0);
            for (int k = 0; k < 3; k++) sum += off[3 * i + k] * to[3 * k + j];
            next[3 * i + j] = worst <= manifold_rounding ? to[3 * i + j] - REAL(0.5) * sum : to[3 * i + j];
        }
}

/* The state at the end of a step. */
static void arrive(const real *from, const real *to, real *next) {
    for (int f = 0; f < FACTORS; f++)
        for (int copy = 0; copy < factors[f][1]; copy++) {
            const int numbers = factors[f][0];
            if (numbers == DIRECTION)
                settle_direction(from, to, next);
            else if (numbers == ROTATION)
                settle_rotation(to, next);
            else
                next[0] = to[0];
            from += numbers, to += numbers, next += numbers;
        }
}
