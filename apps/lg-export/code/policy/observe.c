/* Extended Kalman filter. The estimate (ESTIMATE) has positions, then velocities; its covariance is L L^T.
 * memory holds the estimate, then L (ESTIMATE, ESTIMATE), row by row. */

/* Makes a (ESTIMATE, columns) lower triangular by reflections from the right, which keep a a^T. */
static void make_triangular(int columns, real *a) {
    for (int i = 0; i < ESTIMATE; i++) {
        real *row = a + i * columns, square = REAL(0.0);
        for (int k = i; k < columns; k++) square += row[k] * row[k];
        const real size = SQRT(square), end = row[i] > REAL(0.0) ? -size : size;
        const real length = square - end * row[i]; /* half of the square of the reflection's vector */
        if (!(length > REAL(0.0))) continue;
        row[i] -= end;
        for (int j = i + 1; j < ESTIMATE; j++) {
            real sum = REAL(0.0);
            for (int k = i; k < columns; k++) sum += a[j * columns + k] * row[k];
            for (int k = i; k < columns; k++) a[j * columns + k] -= sum / length * row[k];
        }
        row[i] = end;
        for (int k = i + 1; k < columns; k++) row[k] = REAL(0.0);
    }
}

/* Corrects the estimate x, whose covariance is a a^T (a has `columns` columns), by the measurement of
 * position i (Potter's square root update). A measurement that is not finite is left out. */
static void correct(int i, real measured, int columns, real *x, real *a) {
    const real *row = a + i * columns, noise = observe_sensor[i] * observe_sensor[i];
    real away = measured - x[i], square = noise;
    if (observe_turn[i] > REAL(0.0)) away -= observe_turn[i] * FLOOR(away / observe_turn[i] + REAL(0.5));
    if (!(away - away == REAL(0.0))) return;
    for (int k = 0; k < ESTIMATE; k++) square += row[k] * row[k];
    const real part = REAL(1.0) / (REAL(1.0) + SQRT(noise / square));
    /* Row i is an operand of all rows: it changes last. */
    for (int n = 1; n <= ESTIMATE; n++) {
        const int j = (i + n) % ESTIMATE;
        real gain = REAL(0.0);
        for (int k = 0; k < ESTIMATE; k++) gain += a[j * columns + k] * row[k];
        gain /= square;
        x[j] += gain * away;
        if (j != i)
            for (int k = 0; k < ESTIMATE; k++) a[j * columns + k] -= part * gain * row[k];
        else
            for (int k = 0; k < ESTIMATE; k++) a[j * columns + k] *= REAL(1.0) - part * gain;
    }
}

void NAME_observe_start(const NAME_real *y, NAME_real *memory) {
    real *root = memory + ESTIMATE;
    for (int i = 0; i < ESTIMATE; i++) {
        memory[i] = i < OBSERVED ? y[i] : REAL(0.0);
        for (int j = 0; j < ESTIMATE; j++)
            root[i * ESTIMATE + j] = i != j         ? REAL(0.0)
                                     : i < OBSERVED ? observe_sensor[i]
                                                    : observe_first[i - OBSERVED];
    }
}

void NAME_observe(const NAME_real *y, const NAME_real *u, NAME_real *memory, NAME_real *x, NAME_real *work) {
    const int columns = 2 * ESTIMATE - OBSERVED;
    real *next = work, *F = next + ESTIMATE, *a = F + ESTIMATE * ESTIMATE, *rest = a + ESTIMATE * columns;
    real *root = memory + ESTIMATE, sum = REAL(0.0);
    NAME_observe_step(memory, u, next, rest);
    NAME_jac_observe_step(memory, u, F, NULL, rest);
    for (int i = 0; i < ESTIMATE; i++) {
        for (int j = 0; j < columns; j++) a[i * columns + j] = REAL(0.0);
        for (int k = 0; k < ESTIMATE; k++)
            for (int j = 0; j < ESTIMATE; j++)
                a[i * columns + j] += F[i * ESTIMATE + k] * root[k * ESTIMATE + j];
        if (i >= OBSERVED) a[i * columns + ESTIMATE + i - OBSERVED] = observe_drift[i - OBSERVED];
    }
    make_triangular(columns, a);
    for (int i = 0; i < OBSERVED; i++) correct(i, y[i], columns, next, a);
    for (int i = 0; i < ESTIMATE; i++) {
        sum += REAL(0.0) * next[i];
        for (int j = 0; j < ESTIMATE; j++) sum += REAL(0.0) * a[i * columns + j];
    }
    for (int i = 0; i < ESTIMATE && sum == REAL(0.0); i++) {
        memory[i] = next[i];
        for (int j = 0; j < ESTIMATE; j++) root[i * ESTIMATE + j] = a[i * columns + j];
    }
    for (int i = 0; i < ESTIMATE; i++) x[i] = memory[i];
}
