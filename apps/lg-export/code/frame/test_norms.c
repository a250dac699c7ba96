static void fill(real *memory, int count, real value) {
    int i;
    for (i = 0; i < count; i++) memory[i] = value;
}

static double norm(const real *a, int size) {
    double sum = 0;
    int i;
    for (i = 0; i < size; i++) sum += (double)a[i] * (double)a[i];
    return sqrt(sum);
}

static double distance(const real *a, const real *b, int size) {
    double sum = 0;
    int i;
    for (i = 0; i < size; i++) sum += ((double)a[i] - (double)b[i]) * ((double)a[i] - (double)b[i]);
    return sqrt(sum);
}
