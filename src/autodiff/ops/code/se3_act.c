/* The second half of exp(u, v) . (q, p) for n rows: R p + r x R q, R = exp(u), r = dexp_u(v) */
static NOINLINE void se3_act(int n, const real *u, const real *v, const real *q, const real *p, real *y) {
    for (int i = 0; i < n; i++, u += 3, v += 3, q += 3, p += 3, y += 3) {
        real c[4];
        real r[3];
        real turned[3];
        real moved[3];
        so3_coefficients(dot3(u, u), c);
        so3_function(c[2], c[3], u, v, r);
        so3_function(c[1], c[2], u, q, turned);
        cross3(r, turned, moved);
        so3_function(c[1], c[2], u, p, y);
        for (int k = 0; k < 3; k++) y[k] += moved[k];
    }
}
