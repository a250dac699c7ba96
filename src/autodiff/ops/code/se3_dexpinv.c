/* The second half of dexp_(A, a)^-1(B, b) for n rows: b - m/2 + g2 (a x (A x B) + A x m) + A.a 2 g2' A x
 * (A x B), m = a x B + A x b */
static NOINLINE void se3_dexpinv(int n, const real *A, const real *a, const real *B, const real *b, real *y) {
    for (int r = 0; r < n; r++, A += 3, a += 3, B += 3, b += 3, y += 3) {
        const real w = dot3(A, A);
        const real g = dexpinv_coef(w, 0);
        const real slope = REAL(2.0) * dot3(A, a) * dexpinv_coef(w, 1);
        real AB[3];
        real AAB[3];
        real m[3];
        real t[3];
        real part[3];
        cross3(A, B, AB);
        cross3(A, AB, AAB);
        cross3(a, B, m);
        cross3(A, b, part);
        for (int i = 0; i < 3; i++) m[i] += part[i];
        cross3(a, AB, t);
        cross3(A, m, part);
        for (int i = 0; i < 3; i++)
            y[i] = (b[i] - REAL(0.5) * m[i]) + (slope * AAB[i] + g * (t[i] + part[i]));
    }
}
