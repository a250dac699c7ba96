/* The state at the end of a step, with one Newton correction of |q| = 1 and q.p = 0 where rounding is what
 * violates them: without it rounding adds up over a run. Farther points keep their distance. */
static void arrive(const real *from, const real *to, real *next) {
    for (int link = 0; link < LINKS; link++, from += 6, to += 6, next += 6) {
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
}
