void NAME_observe_start(const NAME_real *y, NAME_real *memory) {
    for (int i = 0; i < NAME_OBSERVE_SIZE; i++) memory[i] = i < NAME_GIVEN ? y[i] : observe_first[i];
}

void NAME_observe(const NAME_real *y, const NAME_real *u, NAME_real *memory, NAME_real *x, NAME_real *work) {
    real *seen = work + NAME_OBSERVE_SIZE, sum = REAL(0.0);
    for (int i = 0; i < NAME_GIVEN; i++) {
        const int measured = y[i] - y[i] == REAL(0.0);
        seen[i] = measured ? y[i] : REAL(0.0);
        seen[NAME_GIVEN + i] = measured ? REAL(1.0) : REAL(0.0);
    }
    NAME_observe_next(seen, u, memory, work, seen + 2 * NAME_GIVEN);
    for (int i = 0; i < NAME_OBSERVE_SIZE; i++) sum += REAL(0.0) * work[i];
    for (int i = 0; i < NAME_OBSERVE_SIZE && sum == REAL(0.0); i++) memory[i] = work[i];
    for (int i = 0; i < NAME_INPUTS; i++) x[i] = memory[i];
}
