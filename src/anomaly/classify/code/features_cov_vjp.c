/* Roots s_j are norms of the rows of g. Below 2^-22 of the largest, or what rounding leaves of nothing, they
 * count as 0. */
static real null_root(FOR_WINDOW const real *g) {
    real largest = REAL(0.0);
    for (int j = 0; j < SELECTED; j++) {
        const real s = SQRT(dot_of(SELECTED, g + j * SELECTED, g + j * SELECTED));
        if (s > largest) largest = s;
    }
    return (REAL(2.384185791015625e-7) + REAL_EPSILON * (real)SELECTED) * largest;
}

/* From the cotangent W (symmetric; df is its upper triangle, with off-diagonal entries doubled) of the root
 * S = sum_j s_j u_j u_j^T to that of the covariance: S K + K S = W, which between vectors u_i and u_j says
 * K_ij = W_ij/(s_i + s_j). Null vectors of the covariance stand for s = 0; on them K itself is taken as 0, so
 * that they need not be known:
 *   K = sum_j (W u_j - sum_i u_i (u_i.W u_j) s_i/(s_i + s_j))/s_j u_j^T
 * on everything that the covariance can be multiplied with. w, k (SELECTED, SELECTED), row (2 SELECTED). */
static void root_vjp(FOR_WINDOW const real *df, const real *g, real *w, real *k, real *row) {
    const real null = null_root(OF_WINDOW g), root = SQRT((real)NAME_LENGTH);
    for (int i = 0, e = 0; i < SELECTED; i++)
        for (int j = i; j < SELECTED; j++, e++)
            w[i * SELECTED + j] = w[j * SELECTED + i] = i == j ? df[e] : REAL(0.5) * df[e];
    for (int i = 0; i < SELECTED * SELECTED; i++) k[i] = REAL(0.0);
    for (int j = 0; j < SELECTED; j++) {
        const real *gj = g + j * SELECTED;
        const real sj = SQRT(dot_of(SELECTED, gj, gj));
        if (sj <= null) continue;
        for (int a = 0; a < SELECTED; a++) row[a] = dot_of(SELECTED, w + a * SELECTED, gj) / sj;
        for (int i = 0; i < SELECTED; i++) row[SELECTED + i] = row[i];
        for (int i = 0; i < SELECTED; i++) {
            const real *gi = g + i * SELECTED;
            const real si = SQRT(dot_of(SELECTED, gi, gi));
            if (si <= null) continue;
            const real common = dot_of(SELECTED, row + SELECTED, gi) / (si + sj) / si;
            for (int a = 0; a < SELECTED; a++) row[a] -= common * gi[a];
        }
        for (int a = 0; a < SELECTED; a++)
            for (int b = 0; b < SELECTED; b++) k[a * SELECTED + b] += row[a] * (root / sj) * (gj[b] / sj);
    }
}

/* After compute_features, with the same work: SELECTED (LENGTH + 3 SELECTED + 2). */
static void features_vjp(FOR_WINDOW const real *x, const real *df, real *dx, real *work) {
    real *g = work + SELECTED * NAME_LENGTH, *w = g + SELECTED * SELECTED, *k = w + SELECTED * SELECTED;
    root_vjp(OF_WINDOW df, g, w, k, k + SELECTED * SELECTED);
    centre_channels(OF_WINDOW x, work);
    for (int i = 0; i < SELECTED; i++) {
        real *to = dx + NAME_select[i] * NAME_LENGTH;
        const real outside = REAL(2.0) * INVERSE_SCALE(NAME_select[i]) / (real)NAME_LENGTH;
        for (int j = 0; j < SELECTED; j++) {
            const real factor = outside * k[i * SELECTED + j], *z = work + j * NAME_LENGTH;
            for (int t = 0; t < NAME_LENGTH; t++) to[t] += factor * z[t];
        }
    }
}
