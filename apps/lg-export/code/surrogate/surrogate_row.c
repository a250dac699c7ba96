/* Component i of pairs (x, y): y-components are reflected. */
static real reflected(int i, real sign, real value) {
    return i % 2 == 1 ? sign * value : value;
}

/* The boundary conditions as the network sees them: places from q0 on, reflected, scaled. */
static void fill_row(const real *x, real sign, real *row) {
    for (int i = 0; i < 8; i++) row[i] = reflected(i, sign, i % 4 < 2 ? x[i] - x[i % 2] : x[i]);
    if (NORMALISE) {
        row[0] = (row[0] - CENTRE) / CENTRE;
        row[4] = (row[4] - CENTRE) / CENTRE;
    }
}

/* Derivative of row[i] by x[i], i >= 2; by q0 it is what it is by qN, with the other sign. */
static real row_slope(int i, real sign) {
    return NORMALISE && i == 4 ? REAL(1.0) / CENTRE : reflected(i, sign, REAL(1.0));
}
