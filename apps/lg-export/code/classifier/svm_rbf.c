/* The first support vector of a class. */
static int first_of(int class_number) {
    int first = 0;
    for (int k = 0; k < class_number; k++) first += NAME_vectors_of[k];
    return first;
}

/* Coefficients of the vectors of class `own` in the pair with `other`: row `row`, from the class's first. */
static const real *coefficients_of(int own, int other) {
    return NAME_coefficient + (other > own ? other - 1 : other) * VECTORS + first_of(own);
}

/* Decisions of the pairs of classes (i, j), i < j: sum over their vectors of coefficient exp(-gamma |vector -
 * p|^2), less rho; positive for i. The exponentials stay in work (VECTORS). */
static void decide(const real *p, real *y, real *work) {
    const real *vector = NAME_vector;
    for (int v = 0; v < VECTORS; v++, vector += PROJECTIONS)
        work[v] = EXP(-GAMMA * square_distance(vector, p));
    for (int i = 0, pair = 0; i < NAME_CLASSES; i++)
        for (int j = i + 1; j < NAME_CLASSES; j++, pair++) {
            const int a = NAME_vectors_of[i], b = NAME_vectors_of[j];
            if (NAME_CLASSES == 2 || (a > 0 && b > 0))
                y[pair] = dot_of(a, coefficients_of(i, j), work + first_of(i)) +
                          dot_of(b, coefficients_of(j, i), work + first_of(j)) - NAME_rho[pair];
            else
                y[pair] = (real)(a > 0) - (real)(b > 0);
        }
}
