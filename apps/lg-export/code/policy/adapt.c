void NAME_adapt_start(NAME_real *memory) {
    for (int i = 0; i < NAME_ADAPT_SIZE; i++) memory[i] = adapt_first[i];
}

void NAME_adapt(const NAME_real *x, const NAME_real *u, const NAME_real *next, NAME_real *memory,
                NAME_real *found, NAME_real *work) {
    real sum = REAL(0.0);
    NAME_adapt_next(x, u, next, memory, work, work + NAME_ADAPT_SIZE);
    for (int i = 0; i < NAME_ADAPT_SIZE; i++) sum += REAL(0.0) * work[i];
    for (int i = 0; i < NAME_ADAPT_SIZE && sum == REAL(0.0); i++) memory[i] = work[i];
    for (int i = 0; i < NAME_FOUND; i++) found[i] = adapt_range[i] * memory[i / 4 * 20 + i % 4];
}
