/* Adds cotangent times the derivative of the standard deviation of factor x (n) to dx; 0 where it is 0. z: n
 * numbers of work. */
static void deviation_vjp(int n, real factor, const real *x, real cotangent, real *dx, real *z) {
    const real deviation = centre_numbers(n, factor, x, z);
    const real scale = deviation > REAL(0.0) ? cotangent * factor / ((real)n * deviation) : REAL(0.0);
    for (int t = 0; t < n; t++) dx[t] += scale * z[t];
}
